"""The request as compiled loops take it, and what a box of camera poses cannot inspect. Compiled loops."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ground.decorators import entry_kernel, kernel, kernel_without_refcounts
from ground.shared import Shared
from planner.request.reach import cells_of

if TYPE_CHECKING:
    from aspectgraph.cells.arrays import Cell

# What the compiled loops know of a request: the camera's frustum, the entities, and the cells of
# their regions.


# rows of a box of poses (4, 3): the middle point looked at and the half sizes, the middle turn and its spans
LOOK, HALF, TURN, SPAN = range(4)
# the first coordinate along which a box of poses is halved: of the point looked at, of the turn, of the nodal point
OF_LOOK = 0
OF_TURN = 3
OF_NODAL = 6
# sides of the view, in the order of windows and their linear sides
RIGHT, LEFT, BOTTOM, TOP, NEAR, FAR = range(6)


class Frustum(NamedTuple):
    """What the camera takes in: nearest and farthest sharp depth, mm; tangents of the half angles of view.

    ``cone`` is the angle between the axis and a corner, rad. ``far`` may be infinite.
    """

    near: float
    far: float
    tan_x: float
    tan_y: float
    cone: float


class View(NamedTuple):
    """What the camera takes in: nearest, farthest and middle sharp depth, mm; tangents of the half angles of view.

    ``far`` is finite: no more than the workspace is wide. ``radius`` is the distance of the farthest point of that
    frustum from the point looked at, mm.
    """

    near: float
    far: float
    middle: float
    tan_x: float
    tan_y: float
    radius: float


class SearchTask(NamedTuple):
    """What a search is for: a pose whose entities weigh more than a limit.

    ``conflict`` (e, e) tells which entities exclude each other anyhow, ``y`` (e,) are the weights. It looks at
    ``max_nodes`` boxes at most, and ends when another thread sets ``stop`` (1,).
    """

    conflict: np.ndarray
    y: np.ndarray
    limit: float
    max_nodes: int
    stop: np.ndarray


class Segments(NamedTuple):
    """Two points of each item that must both be in the image and in focus: ends (e, 2, 3) and their distance (e,), mm.

    ``length_ratio`` (e,) is the length that the image of the segment must have at least, over the image distance; 0
    where nothing is known of that. An item may be an edge, whose ends they are, or a dimension.
    """

    ends: np.ndarray
    lengths: np.ndarray
    length_ratio: np.ndarray


class Entities(NamedTuple):
    """The `Segments` of the items, and the cells of their regions as in `cells.Cells`.

    The normals of the cells' planes have length 1. An entity must be visible from the nodal point and all around it, in
    the ``directions`` (d, 3) at the distance ``around``, mm.
    """

    ends: np.ndarray
    lengths: np.ndarray
    length_ratio: np.ndarray
    planes: np.ndarray
    plane_start: np.ndarray
    boxes: np.ndarray
    entity_start: np.ndarray
    around: float
    directions: np.ndarray


# The convex cells of entities' regions in flat arrays, as compiled loops take them.


class CellArrays(NamedTuple):
    """The arrays of `Cells`."""

    planes: NDArray[np.float64]
    plane_start: NDArray[np.int_]
    corners: NDArray[np.float64]
    corner_start: NDArray[np.int_]
    boxes: NDArray[np.float64]
    entity_start: NDArray[np.int_]


class Cells:
    """The convex cells of several entities' regions in flat arrays, for compiled loops.

    Parameters
    ----------
    cell_sets : sequence of CellSet
        One per entity.

    Attributes
    ----------
    planes : array (p, 4)
        Half-spaces of all cells; of cell c those from ``plane_start[c]`` to ``plane_start[c + 1]``.
    corners : array (v, 3)
        Corners likewise, by ``corner_start``.
    boxes : array (c, 2, 3)
        Bounding boxes.
    entity_start : array (e + 1,)
        The cells of entity e are those from ``entity_start[e]`` to ``entity_start[e + 1]``.
    """

    def __init__(self, cell_sets: Iterable[Iterable[Cell]]):
        # any iterable will do, and only one of the sets need exist at a time
        cells = [
            [(np.asarray(c.half_spaces, float), np.asarray(c.vertices, float)) for c in cs]
            for cs in cell_sets
        ]
        flat = [cell for group in cells for cell in group]
        self.planes = np.concatenate([np.zeros((0, 4)), *(planes for planes, _ in flat)])
        self.corners = np.concatenate([np.zeros((0, 3)), *(corners for _, corners in flat)])
        self.plane_start = _starts(len(planes) for planes, _ in flat)
        self.corner_start = _starts(len(corners) for _, corners in flat)
        self.entity_start = _starts(map(len, cells))
        boxes = [(corners.min(axis=0), corners.max(axis=0)) for _, corners in flat]
        self.boxes = np.array(boxes).reshape(-1, 2, 3)

    @classmethod
    def joined(cls, parts: Iterable[Cells]) -> Cells:
        """Return the cells of several groups of entities, of one after the other."""
        cell_sets = list(parts)
        whole = cls(())
        for name in ("planes", "corners", "boxes"):
            setattr(
                whole,
                name,
                np.concatenate(
                    [getattr(whole, name), *(getattr(part, name) for part in cell_sets)]
                ),
            )
        for name in ("plane_start", "corner_start", "entity_start"):
            setattr(
                whole,
                name,
                _starts(size for part in cell_sets for size in np.diff(getattr(part, name))),
            )
        return whole

    @property
    def arrays(self) -> CellArrays:
        """All arrays, as the compiled functions take them."""
        return CellArrays(
            self.planes,
            self.plane_start,
            self.corners,
            self.corner_start,
            self.boxes,
            self.entity_start,
        )


def _starts(sizes: Iterable[int]) -> NDArray[np.int_]:
    return np.cumsum([0, *sizes])


def entity_cells(shared: Shared, name: str) -> Cells:
    """Return the cells of an entity's region, as a task; ``shared`` holds the request."""
    return Cells([cells_of(shared.value.space, [name])])


# Which cells the nodal points of a box may enter, and which ends are out of range. Compiled
# loops.
#
# The notation is that of `windows`.


# What every pose that inspects an item fulfils: the home of each necessary condition of the
# bound. Compiled loops.
#
# Of nodal points only a ball or a box is known. A condition fails there if it fails for all of
# them. A ``view`` is anything that has the ``near`` and ``far`` sharp depths and the tangents
# ``tan_x`` and ``tan_y`` of the half angles.


# more than the rounding of planes, corners and viewpoints: cells that only touch count as meeting
TOUCH_MM = 1e-6
# for rounding, relative
_EPS = 1e-9


@kernel_without_refcounts
def slant(view):
    """Return how much farther away than deep a corner of the view is: 1 / cos(cone)."""
    return math.sqrt(1.0 + view.tan_x**2 + view.tan_y**2)


@entry_kernel
def focus_reach(view):
    """Return how far from the nodal point a point in view and in focus can be, mm."""
    return view.far * slant(view)


@kernel_without_refcounts
def out_of_focus(distance, radius, view):
    """Tell whether a point is too near or too far for a ball of nodal points, given its distance from the middle."""
    return distance - radius > focus_reach(view) or distance + radius < view.near


@kernel_without_refcounts
def ends_out_of_focus(ends, eye, view):
    """Tell whether one of two ends is too near or too far for a box (2, 3) of nodal points."""
    reach = focus_reach(view)
    for i in range(2):
        nearest = 0.0
        farthest = 0.0
        for k in range(3):
            nearest += max(eye[0, k] - ends[i, k], ends[i, k] - eye[1, k], 0.0) ** 2
            farthest += max(eye[1, k] - ends[i, k], ends[i, k] - eye[0, k]) ** 2
        if nearest > reach * reach or farthest < view.near * view.near:
            return True
    return False


@kernel_without_refcounts
def too_short(ends, length, ratio, c, radius, view):
    """Tell whether an image is too short from every nodal point of a ball: a depth is at least distance cos(cone).

    ``ratio`` is the length that it must have at least, over the image distance; 0 asks for none.
    """
    if ratio <= 0.0:
        return False
    depths = 1.0
    for i in range(2):
        distance = math.sqrt(
            (ends[i, 0] - c[0]) ** 2 + (ends[i, 1] - c[1]) ** 2 + (ends[i, 2] - c[2]) ** 2
        )
        depths *= max(view.near, (distance - radius) / slant(view))
    return too_short_at(ends, length, ratio, c, radius, depths)


@kernel_without_refcounts
def too_short_at(ends, length, ratio, c, radius, depths):
    """Tell whether an image is too short from a ball, given the product of the least depths of its ends.

    By eq 16 with ||w x v|| <= ||w||, the image over the image distance is at most twice the area of the triangle of
    nodal point and ends, over that product.
    """
    w0 = ends[1, 0] - ends[0, 0]
    w1 = ends[1, 1] - ends[0, 1]
    w2 = ends[1, 2] - ends[0, 2]
    o0 = c[0] - ends[0, 0]
    o1 = c[1] - ends[0, 1]
    o2 = c[2] - ends[0, 2]
    area = math.sqrt((o1 * w2 - o2 * w1) ** 2 + (o2 * w0 - o0 * w2) ** 2 + (o0 * w1 - o1 * w0) ** 2)
    return area + radius * length < ratio * depths * (1.0 - _EPS)


@kernel_without_refcounts
def outside(planes, first, last, middle, half):
    """Tell whether a box lies wholly outside of a cell, that of the planes from ``first`` to ``last``."""
    for p in range(first, last):
        p0 = planes[p, 0]
        p1 = planes[p, 1]
        p2 = planes[p, 2]
        value = planes[p, 3] + p0 * middle[0] + p1 * middle[1] + p2 * middle[2]
        if value - abs(p0) * half[0] - abs(p1) * half[1] - abs(p2) * half[2] > TOUCH_MM:
            return True
    return False


# Groups of entities that all exclude each other: of each group one pose inspects one at most.
# Compiled loops.


@kernel
def exclusive_groups(members, conflict, group):
    """Write a group for each member such that those of one group all exclude each other; numbered from 0."""
    m = len(members)
    # the last member that a group has no room for
    barred = np.full(m + 1, -1)
    for a in range(m):
        for b in range(a):
            if not conflict[members[a], members[b]]:
                barred[group[b]] = a
        g = 0
        while barred[g] == a:
            g += 1
        group[a] = g


@kernel_without_refcounts
def keep_cells(entities, cells, c, h, swing, rest, eye):
    """Move to the front the cells that some nodal point of a box, or a point around it, may lie in; return how many.

    0 if no nodal point itself lies in one; -1 if all of them, with the points around them, lie in one: that one is the
    first then. The nodal points are those about c, given how far the point looked at and the turn move them, that are
    in the box ``eye`` (2, 3).
    """
    # by their own names: else much of the time goes into counting references
    around = entities.around
    planes = entities.planes
    plane_start = entities.plane_start
    boxes = entities.boxes
    n_cells = 0
    met = False
    for cell in cells:
        apart = False
        holds = True
        for k in range(3):
            if boxes[cell, 0, k] > eye[1, k] + around or boxes[cell, 1, k] < eye[0, k] - around:
                apart = True
        inside = not apart
        for p in range(plane_start[cell], plane_start[cell + 1]):
            if apart:
                break
            p0 = planes[p, 0]
            p1 = planes[p, 1]
            p2 = planes[p, 2]
            low = high = planes[p, 3]
            value = low + p0 * c[0] + p1 * c[1] + p2 * c[2]
            slack = abs(p0) * h[0] + abs(p1) * h[1] + abs(p2) * h[2] + rest
            for k in range(3):
                slack += abs(p0 * swing[k, 0] + p1 * swing[k, 1] + p2 * swing[k, 2])
            if p0 > 0.0:
                low = low + p0 * eye[0, 0]
                high = high + p0 * eye[1, 0]
            else:
                low = low + p0 * eye[1, 0]
                high = high + p0 * eye[0, 0]
            if p1 > 0.0:
                low = low + p1 * eye[0, 1]
                high = high + p1 * eye[1, 1]
            else:
                low = low + p1 * eye[1, 1]
                high = high + p1 * eye[0, 1]
            if p2 > 0.0:
                low = low + p2 * eye[0, 2]
                high = high + p2 * eye[1, 2]
            else:
                low = low + p2 * eye[1, 2]
                high = high + p2 * eye[0, 2]
            low = max(low, value - slack)
            high = min(high, value + slack)
            apart = low > around + TOUCH_MM
            holds = holds and low <= TOUCH_MM
            inside = inside and high + around <= 0.0
        if not apart:
            cells[n_cells] = cell
            n_cells += 1
            met = met or holds
            if inside:
                cells[0] = cell
                return -1
    return n_cells if met else 0


@kernel_without_refcounts
def holds_point(entities, cell, c):
    """Tell whether a cell contains a nodal point."""
    for p in range(entities.plane_start[cell], entities.plane_start[cell + 1]):
        plane = entities.planes[p]
        if plane[3] + plane[0] * c[0] + plane[1] * c[1] + plane[2] * c[2] > TOUCH_MM:
            return False
    return True


@kernel_without_refcounts
def hidden_around(entities, cells, eye):
    """Tell whether for every nodal point of a small box (2, 3) the same point around it is in none of the cells."""
    if (
        max(eye[1, 0] - eye[0, 0], eye[1, 1] - eye[0, 1], eye[1, 2] - eye[0, 2])
        > 2.0 * entities.around
    ):
        return False
    for d in range(len(entities.directions)):
        x = (eye[0, 0] + eye[1, 0]) / 2 + entities.around * entities.directions[d, 0]
        y = (eye[0, 1] + eye[1, 1]) / 2 + entities.around * entities.directions[d, 1]
        z = (eye[0, 2] + eye[1, 2]) / 2 + entities.around * entities.directions[d, 2]
        half = (eye[1, 0] - eye[0, 0]) / 2, (eye[1, 1] - eye[0, 1]) / 2, (eye[1, 2] - eye[0, 2]) / 2
        seen = False
        for cell in cells:
            first = entities.plane_start[cell]
            last = entities.plane_start[cell + 1]
            if not outside(entities.planes, first, last, (x, y, z), half):
                seen = True
                break
        if not seen:
            return True
    return False


@kernel_without_refcounts
def out_of_range(ends, q, h, radius):
    """Tell whether an end is farther from the whole box of q than any point in view is from the point looked at."""
    for i in range(2):
        square = 0.0
        for k in range(3):
            square += max(abs(ends[i, k] - q[k]) - h[k], 0.0) ** 2
        if square > radius * radius:
            return True
    return False
