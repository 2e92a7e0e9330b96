"""What the compiled loops know of a request: the camera's frustum, the entities, and the cells of their regions."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from planner.effort.bound import BoxEffort
from planner.executors import Shared
from planner.request.reach import cells_of

if TYPE_CHECKING:
    from aspectgraph.cells.arrays import Cell


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
    ``max_nodes`` boxes at most, and ends when another thread sets ``stop`` (1,). ``effort`` says how closely it looks.
    """

    conflict: np.ndarray
    y: np.ndarray
    limit: float
    max_nodes: int
    stop: np.ndarray
    effort: BoxEffort


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
        given = list(parts)
        whole = cls(())
        for name in ("planes", "corners", "boxes"):
            setattr(
                whole,
                name,
                np.concatenate([getattr(whole, name), *(getattr(part, name) for part in given)]),
            )
        for name in ("plane_start", "corner_start", "entity_start"):
            setattr(
                whole,
                name,
                _starts(size for part in given for size in np.diff(getattr(part, name))),
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
