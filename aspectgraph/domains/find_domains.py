"""Viewing domains: connected unions of equally labelled cells, and what they share.

Slivers. Where snapping displaced vertices, planes that ought to meet in one line or point miss each other and leave
cells thinner than any robot can aim. A *sliver* is a cell that holds no ball as wide as the least width at its place;
snapping turns planes, so slivers widen with distance, and so does the least width (`Ruler`). Only where a wide cell
runs out into a thinner one of its list, a *tail* (`find_tails`), the two belong together, as they do where no plane
cuts them apart. The graph is that of the partition with its slivers shrunk to nothing:

* two other cells *touch* where they share a face, and where faces of theirs lie opposite each other across slivers;
  it counts where their sets of cells do so in a plane region that holds a disc as wide as the least width;
* a domain is a component of equally labelled cells that touch, and two domains are adjacent where cells of theirs touch
  in a region half as wide again.

So a sliver neither joins nor parts anything, whatever its own label, and a cut that takes a sliver off a wide cell
changes nothing. Its volume goes to the domain with its label if that borders on it in a wide face; else it is counted,
and its volume goes to the neighbour it shares most boundary with.
"""

from __future__ import annotations

from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import shapely
from scipy.optimize import linprog
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull
from scipy.spatial.distance import cdist

from aspectgraph.cells.arrays import (
    INSIDE,
    Complex,
    cell_sizes,
    face_polygon,
    half_spaces,
    inner_balls,
    interfaces,
)
from aspectgraph.cells.split import leaves
from aspectgraph.domains.carve import pieces_across
from aspectgraph.exceptions import WidthError

# Which cells and polygons are wide enough to count, by the largest balls and discs in them.
#
# All sizes are doubles in grid steps. Nothing here decides what is observable.


# A strip that slivers leave where two boundaries cross is as wide as they are thick, times the cosecant of the angle.
_CONTACT_WIDTHS = 1.5

# domains next to a displaced part that are thinner than this share of its extent are slivers
_MIN_WIDTH_SHARE = 1e-4

# gaps this share of the least width do not part the pieces of a contact
_GAP_SHARE = 0.1


class Ruler(NamedTuple):
    """The least width of cells, in grid steps.

    It is `min_width` up to the distance `reach` from the part's centre, and beyond it grows with the distance.
    """

    min_width: float
    reach: float

    def least_width(self, distance: np.ndarray) -> np.ndarray:
        """Least width at a distance, or an array of distances, from the part's centre (the grid's zero), in steps."""
        return self.min_width * np.maximum(1.0, distance / self.reach)

    def for_contacts(self) -> Ruler:
        """The least width of contacts: one and a half times that of cells."""
        return self._replace(min_width=_CONTACT_WIDTHS * self.min_width)


def largest_extent(points: np.ndarray) -> float:
    """Largest distance between two of (n, 3) points that do not lie in one plane: the same however they are turned."""
    hull = points[ConvexHull(points - points.mean(axis=0)).vertices].astype(float)
    return max(
        float(cdist(part, hull).max()) for part in np.array_split(hull, 1 + len(hull) // 1000)
    )


class _Programme(NamedTuple):
    """Linear programme of the balls in {a·x + b·y + c·z + d <= 0 for all rows}, in units of `scale`.

    Its unknowns are the centre, the radius, and m: the largest of `reach` and the magnitudes of the centre's
    coordinates, to which the least radius is proportional by `slope`.
    """

    coefficients: np.ndarray
    limits: np.ndarray
    bounds: list[tuple[float | None, float | None]]
    scale: float
    slope: float

    def maximise(self, radius: float, m: float) -> Any:
        """Solve for the largest sum of the radius and m, times their weights."""
        return linprog(
            [0, 0, 0, -radius, -m],
            self.coefficients,
            self.limits,
            bounds=self.bounds,
            method="highs",
        )


def _programme(rows: np.ndarray, ruler: Ruler, normal: np.ndarray | None = None) -> _Programme:
    scale = np.abs(rows[:, 3]).max() or 1.0
    thickness = (
        np.ones(len(rows))
        if normal is None
        else np.linalg.norm(np.cross(rows[:, :3], normal), axis=1)
    )
    first = 0 if normal is None else 1
    flat = np.zeros((2, 3)) if normal is None else rows[[0, 0], :3] * [[1], [-1]]
    unit = np.eye(3)
    columns = [
        np.column_stack([rows[first:, :3], thickness[first:], np.zeros(len(rows) - first)]),
        np.column_stack([flat, np.zeros((2, 2))]),
        np.column_stack([unit, np.zeros(3), -np.ones(3)]),
        np.column_stack([-unit, np.zeros(3), -np.ones(3)]),
    ]
    level = np.zeros(2) if normal is None else np.array([-1.0, 1.0]) * rows[0, 3]
    limits = np.concatenate([-rows[first:, 3], level, np.zeros(6)]) / scale
    bounds: list[tuple[float | None, float | None]] = [(None, None)] * 3 + [
        (0, None),
        (ruler.reach / scale, None),
    ]
    return _Programme(
        np.concatenate(columns), limits, bounds, scale, 0.5 * ruler.min_width / ruler.reach
    )


def has_room(rows: np.ndarray, ruler: Ruler, normal: np.ndarray | None = None) -> bool:
    """Whether a ball inside {a·x + b·y + c·z + d <= 0 for all rows} is as wide as the least width at its place.

    With `normal`, the first row holds with equality and the ball is a disc in that plane.
    """
    programme = _programme(rows, ruler, normal)
    result = programme.maximise(1.0, -programme.slope)
    return bool(result.success and result.fun <= 0.0)


def largest_ball(rows: np.ndarray, ruler: Ruler) -> tuple[np.ndarray, float]:
    """Centre and radius of the largest ball in {a·x + b·y + c·z + d <= 0 for all rows}.

    Where there are balls as wide as the least width at their place, the largest of them.
    """
    programme = _programme(rows, ruler)
    attempts = [programme]
    if ruler.min_width > 0.0:
        is_wide = [[0.0, 0.0, 0.0, -1.0, programme.slope]]
        coefficients = np.concatenate([programme.coefficients, is_wide])
        limits = np.append(programme.limits, 0.0)
        attempts.insert(0, programme._replace(coefficients=coefficients, limits=limits))
    for attempt in attempts:
        result = attempt.maximise(1.0, 0.0)
        if result.success:
            return result.x[:3] * programme.scale, float(result.x[3] * programme.scale)
    return np.zeros(3), 0.0


def disc_has_room(corners: np.ndarray, ruler: Ruler) -> bool:
    """Whether a disc inside a convex polygon, (m, 3) corners in order, is as wide as the least width at its place."""
    normal = _unit_normal(corners)
    sides = np.roll(corners, -1, axis=0) - corners
    length = np.linalg.norm(sides, axis=1)
    nonzero = length > 0.0
    outward = np.cross(sides[nonzero], normal) / length[nonzero, None]
    walls = np.column_stack([outward, -(outward * corners[nonzero]).sum(axis=1)])
    return has_room(
        np.concatenate([[[*normal, -(normal @ corners.mean(axis=0))]], walls]), ruler, normal
    )


def union_has_room(polygons: list[np.ndarray], ruler: Ruler) -> bool:
    """Whether a disc as wide as the least width at its place fits the union of convex polygons.

    Polygons count as lying in one plane if they do to within the least width.
    """
    polygons = sorted(polygons, key=lambda corners: -shapely.Polygon(_flat(corners, corners)).area)
    while len(polygons) > 1:
        first = polygons[0]
        normal = _unit_normal(polygons[0])
        near = [
            bool((abs((p - first[0]) @ normal) <= _least_width_at(p, ruler)).all())
            for p in polygons
        ]
        level = [p for p, flag in zip(polygons, near, strict=True) if flag]
        if len(level) > 1 and _level_union_has_room(level, ruler):
            return True
        polygons = [p for p, flag in zip(polygons[1:], near[1:], strict=True) if not flag]
    return False


def _level_union_has_room(polygons: list[np.ndarray], ruler: Ruler) -> bool:
    distances = np.linalg.norm(np.concatenate(polygons), axis=1)
    flat = [shapely.Polygon(_flat(corners, polygons[0])) for corners in polygons]
    foot = shapely.Point(_flat(np.zeros((1, 3)), polygons[0])[0])
    distance = max(ruler.reach, distances.min())
    # a disc at most that far away that is as wide as the least width there; doubled until it reaches all of the union
    while True:
        width = float(ruler.least_width(distance))
        grown = shapely.union_all([polygon.buffer(_GAP_SHARE * width) for polygon in flat])
        roomy = grown.buffer(-(0.5 + _GAP_SHARE) * width)
        if not roomy.is_empty and roomy.distance(foot) <= distance:
            return True
        if distance >= distances.max():
            return False
        distance *= 2.0


def _least_width_at(points: np.ndarray, ruler: Ruler) -> np.ndarray:
    return ruler.least_width(np.linalg.norm(points, axis=1))


def _unit_normal(corners: np.ndarray) -> np.ndarray:
    normal = np.cross(corners - corners[0], np.roll(corners, -1, axis=0) - corners).sum(axis=0)
    return normal / np.linalg.norm(normal)


def _flat(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Coordinates of points in the plane of a polygon, (m, 2)."""
    normal = _unit_normal(corners)
    across = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    across /= np.linalg.norm(across)
    return (points - corners[0]) @ np.column_stack([across, np.cross(normal, across)])


class CellWidths:
    """Volumes of cells and the largest balls inside them; balls are computed when needed.

    Parameters
    ----------
    cx : Complex
    cells : ndarray of int
        The cells to be asked about.
    n : int
        More than the largest cell number.
    """

    def __init__(self, cx: Complex, cells: np.ndarray, n: int) -> None:
        self._cx = cx
        self._cells = cells
        self.volume = np.zeros(n)
        surface = np.zeros(n)
        self.volume[cells], surface[cells] = cell_sizes(cx, cells).T
        self.thickness = 2.0 * self.volume / np.maximum(surface, 1e-300)
        # a convex body's volume is at least a third of its inscribed radius times its surface
        self._bound = 1.5 * self.thickness

    def are_thin(self, ruler: Ruler, sides: np.ndarray, label: np.ndarray) -> np.ndarray:
        """Whether a cell is a sliver, for all n cells; False for others.

        A sliver holds no ball as wide as the least width at its place, nor does it with any equally labelled neighbour.

        Parameters
        ----------
        ruler : Ruler
        sides : ndarray of int64, shape (k, 4)
            Faces between the cells (`measure.interfaces`).
        label : ndarray of int, shape (n,)
        """
        thin = np.zeros(len(self.volume), bool)
        if ruler.min_width == 0.0:
            return thin
        balls = inner_balls(self._cx, self._cells)
        distance = np.linalg.norm(balls[:, :3], axis=1)
        roomy = 2.0 * balls[:, 3] >= ruler.least_width(distance)
        # as a share of the least width, the width of the largest ball is at most this
        share = np.zeros(len(thin))
        share[self._cells] = (
            2.0
            * self._bound[self._cells]
            / ruler.least_width(np.maximum(distance - balls[:, 4], 0.0))
        )
        thin[self._cells] = ~roomy
        for cell in self._cells[~roomy & (share[self._cells] >= 1.0)].tolist():
            thin[cell] = not has_room(half_spaces(self._cx, cell), ruler)
        # a ball cut in two leaves one of half its radius in one of the parts
        alike = thin[sides[:, :2]].all(axis=1) & (label[sides[:, 0]] == label[sides[:, 1]])
        for part, other, plane, _ in sides[
            alike & (share[sides[:, :2]] >= 0.5).any(axis=1)
        ].tolist():
            # what lies in all other half-spaces of both lies in one of the two
            rows = [half_spaces(self._cx, cell, plane) for cell in (part, other)]
            if thin[[part, other]].any() and has_room(np.concatenate(rows), ruler):
                thin[[part, other]] = False
        return thin

    def largest_ball(self, cells: np.ndarray, ruler: Ruler) -> tuple[np.ndarray, float]:
        """Centre and radius of the largest ball inside one of the cells; see the function of that name."""
        best = (np.zeros(3), -1.0)
        for cell in cells[np.argsort(-self._bound[cells], kind="stable")].tolist():
            if self._bound[cell] <= best[1]:
                break
            best = max(
                best, largest_ball(half_spaces(self._cx, cell), ruler), key=lambda ball: ball[1]
            )
        return best


def check_min_width(min_width_mm: float | None, extent_mm: float, displaced_mm: float) -> float:
    """Return the width below which a domain next to the part is a sliver, in mm.

    Parameters
    ----------
    min_width_mm : float, optional
        As asked for. Default: a share of the part's extent, and 0 where snapping displaced nothing.
    extent_mm, displaced_mm : float
        Extent of the part, and by how much snapping may displace a partition plane.

    Raises
    ------
    WidthError
        If it is out of range.
    """
    if min_width_mm is None:
        return _MIN_WIDTH_SHARE * extent_mm if displaced_mm else 0.0
    if not displaced_mm <= min_width_mm < extent_mm:
        raise WidthError(
            f"min_width_mm must be at least {displaced_mm:g} mm, by which snapping may displace a partition plane, and "
            f"below the part's {extent_mm:g} mm. Got {min_width_mm}."
        )
    return float(min_width_mm)


# Tails: cells too thin to count that a wide cell of their list runs out into.


# Slivers that snapping leaves are thinner, as a share of the least width, than nearly all thin ends of wide domains.
_TAIL_SHARE = 0.1


def find_tails(
    cx: Complex,
    sides: np.ndarray,
    areas: np.ndarray,
    label: np.ndarray,
    is_thin: np.ndarray,
    ruler: Ruler,
) -> np.ndarray:
    """The wide cell, or the tail before it, that each tail carries on: one, so that no tail joins what others part.

    A tail is a thin cell that holds a ball a tenth as wide as the least width at its place, and shares a face with a
    wide cell or another tail of its list; it carries on the one it shares the largest face with.

    Parameters
    ----------
    cx : Complex
    sides : ndarray of int64, shape (k, 4)
        Faces between cells (`measure.interfaces`).
    areas : ndarray, shape (k,)
        Their areas, in squared grid steps.
    label : ndarray of int, shape (n,)
    is_thin : ndarray of bool, shape (n,)
    ruler : Ruler

    Returns
    -------
    ndarray of int, shape (n,)
        A cell, -1 for all cells that are no tails.
    """
    carried_on = np.full(len(is_thin), -1)
    alike = (label[sides[:, 0]] == label[sides[:, 1]]) & is_thin[sides[:, :2]].any(axis=1)
    order = np.flatnonzero(alike)[np.argsort(-areas[alike], kind="stable")]
    pairs = sides[order, :2]
    is_counted = ~is_thin
    is_tried = ~is_thin
    while True:
        rows = np.flatnonzero(is_counted[pairs].sum(axis=1) == 1)
        column = is_counted[pairs[rows, 0]].astype(int)
        cells, first = np.unique(pairs[rows, column], return_index=True)
        fresh = ~is_tried[cells]
        if not fresh.any():
            return carried_on
        cells = cells[fresh]
        first = first[fresh]
        is_tried[cells] = True
        is_tail = _have_room(cx, cells, ruler._replace(min_width=_TAIL_SHARE * ruler.min_width))
        carried_on[cells[is_tail]] = pairs[rows[first], 1 - column[first]][is_tail]
        is_counted[cells[is_tail]] = True


def _have_room(cx: Complex, cells: np.ndarray, ruler: Ruler) -> np.ndarray:
    """Whether each cell holds a ball as wide as the least width at its place."""
    balls = inner_balls(cx, cells)
    roomy = 2.0 * balls[:, 3] >= ruler.least_width(np.linalg.norm(balls[:, :3], axis=1))
    for k in np.flatnonzero(~roomy).tolist():
        roomy[k] = has_room(half_spaces(cx, cells[k]), ruler)
    return roomy


# Where wide cells touch: on faces between them, and across slivers.


class Touching:
    """Convex polygons on which two wide cells touch, and whether they are wide enough to count.

    Attributes
    ----------
    cells : ndarray of int, shape (k, 2)
    area : ndarray, shape (k,)
        In squared grid steps.
    """

    def __init__(
        self, cx: Complex, sides: np.ndarray, sizes: np.ndarray, is_thin: np.ndarray, ruler: Ruler
    ) -> None:
        direct = ~is_thin[sides[:, :2]].any(axis=1)
        self._cx = cx
        self._sides = sides[direct]
        self._pieces = pieces_across(cx, sides, is_thin, ruler.min_width)
        ends = np.array([piece.cells for piece in self._pieces], np.int64).reshape(-1, 2)
        self.cells = np.concatenate([self._sides[:, :2], ends])
        across = np.array([polygon_sizes(piece.corners) for piece in self._pieces]).reshape(-1, 3)
        self.area, self._width, self._farthest = np.concatenate([sizes[direct], across]).T
        self._judge(ruler)

    def judged_by(self, ruler: Ruler) -> Touching:
        """The same polygons with another least width, no smaller than the first."""
        other = copy(self)
        other._judge(ruler)
        return other

    def _judge(self, ruler: Ruler) -> None:
        # two points of a convex polygon are at most half the perimeter apart
        nearest = np.maximum(self._farthest - self.area / np.maximum(self._width, 1e-300), 0.0)
        self._ruler = ruler
        self._certain = self._width >= ruler.least_width(self._farthest)
        self._possible = 2.0 * self._width >= ruler.least_width(nearest)
        self._known: dict[int, bool] = {}

    def planes(self, k: int) -> tuple[int, ...]:
        """Planes crossed on the way from one cell to the other."""
        n = len(self._sides)
        return (int(self._sides[k, 2]),) if k < n else self._pieces[k - n].planes

    def certainly_wide(self) -> np.ndarray:
        """Whether a disc of the least width fits each polygon for certain, as (k,) bool."""
        return self._certain

    def doubtful(self, rows: np.ndarray) -> list[int]:
        """Those of the polygons for which `is_wide` must look closely, widest first."""
        rows = rows[self._possible[rows] & ~self._certain[rows]]
        return rows[np.argsort(-self._width[rows], kind="stable")].tolist()

    def corners(self, k: int) -> np.ndarray:
        """Corners of polygon k in order, in grid steps, shape (m, 3)."""
        n = len(self._sides)
        return face_polygon(self._cx, self._sides[k, 3]) if k < n else self._pieces[k - n].corners

    def is_wide(self, k: int) -> bool:
        """Whether a disc in polygon k is as wide as the least width at its place."""
        if k not in self._known:
            self._known[k] = disc_has_room(self.corners(k), self._ruler)
        return self._known[k]

    def are_wide_together(self, rows: np.ndarray) -> bool:
        """Whether such a disc lies in the union of some polygons none of which is wide by itself."""
        if len(rows) < 2 or 4.0 * self.area[rows].sum() < np.pi * self._ruler.min_width**2:
            return False
        return union_has_room([self.corners(k) for k in rows.tolist()], self._ruler)


def polygon_sizes(corners: np.ndarray) -> tuple[float, float, float]:
    """Area, twice the area over the perimeter, and largest distance from the grid's zero (`measure.interfaces`)."""
    sides = np.roll(corners, -1, axis=0) - corners
    area = 0.5 * float(np.linalg.norm(np.cross(corners - corners[0], sides).sum(axis=0)))
    perimeter = float(np.linalg.norm(sides, axis=1).sum())
    return area, 2.0 * area / max(perimeter, 1e-300), float(np.linalg.norm(corners, axis=1).max())


@dataclass(repr=False)
class Domain:
    """One viewing domain.

    Attributes
    ----------
    label : tuple of int
        Words of the entities' bits.
    cells : ndarray of int
        Its convex cells.
    volume : float
        In cubic grid steps.
    viewpoint : ndarray, shape (3,)
        Centre of the largest ball inside one of its cells, among balls as wide as the least width at their place.
    clearance : float
        Radius of that ball, in grid steps.
    """

    label: tuple[int, ...]
    cells: np.ndarray
    volume: float
    viewpoint: np.ndarray
    clearance: float

    def __repr__(self) -> str:
        """Return a one-line summary."""
        return f"<Domain: {len(self.cells)} cells, {self.volume:.4g} cubic steps, clearance {self.clearance:.4g} steps>"


@dataclass
class Contact:
    """Common boundary of two domains: its area in squared steps, by plane."""

    area: float = 0.0
    planes: dict[int, float] = field(default_factory=dict)


@dataclass
class Domains:
    """All viewing domains of a complex.

    Attributes
    ----------
    domains : list of Domain
    contacts : dict
        Contact of each pair (i, j), i < j, of adjacent domains.
    of_cell : ndarray of int, shape (n,)
        Domain of each cell, -1 inside the solid.
    n_slivers : int
        Connected, equally labelled slivers that joined a domain with another list.
    """

    domains: list[Domain]
    contacts: dict[tuple[int, int], Contact]
    of_cell: np.ndarray
    n_slivers: int


class _Borders(NamedTuple):
    """Faces between pairs of cells: the cells (n, 2), areas, widths and distances of the farthest corner, in steps."""

    pairs: np.ndarray
    areas: np.ndarray
    widths: np.ndarray
    farthest: np.ndarray

    def at(self, chosen: np.ndarray) -> _Borders:
        """Return those with a chosen cell on a side."""
        rows = chosen[self.pairs].any(axis=1)
        return _Borders(*(column[rows] for column in self))


def find_domains(cx: Complex, ruler: Ruler) -> Domains:
    """Merge equally labelled cells that touch.

    Parameters
    ----------
    cx : Complex
        Labelled, and carved.
    ruler : Ruler
        What is too narrow to count.
    """
    present = leaves(cx)
    free = present[(cx.label[present, -1] & INSIDE) == 0]
    n = int(present.max()) + 1
    labels, label_of = np.unique(cx.label[free], axis=0, return_inverse=True)
    label = np.full(n, -1)
    label[free] = label_of.ravel()
    sides, sizes = interfaces(cx)
    keep = (label[sides[:, :2]] >= 0).all(axis=1)
    sides = sides[keep]
    sizes = sizes[keep]
    widths = CellWidths(cx, free, n)
    is_thin = widths.are_thin(ruler, sides, label)
    tails = find_tails(cx, sides, sizes[:, 0], label, is_thin, ruler)
    is_sliver = is_thin & (tails < 0)
    touching = Touching(cx, sides, sizes, is_sliver, ruler)
    of_cell, n_domains = _join(touching, label, free[~is_sliver[free]], tails)
    n_slivers = 0
    if is_sliver.any():
        borders = _Borders(sides[:, :2], *sizes.T).at(is_sliver)
        n_domains, n_slivers = _absorb(
            of_cell, n_domains, label, free, widths.volume, borders, ruler
        )
    members = _members(of_cell, free, n_domains)
    domains = [_domain(cells, labels, label, is_thin, widths, ruler) for cells in members]
    order = sorted(range(n_domains), key=lambda d: _order_key(domains[d]))
    rank = np.empty(n_domains, int)
    rank[order] = np.arange(n_domains)
    of_cell[of_cell >= 0] = rank[of_cell[of_cell >= 0]]
    return Domains(
        [domains[d] for d in order],
        _contacts(of_cell, touching.judged_by(ruler.for_contacts())),
        of_cell,
        n_slivers,
    )


def _join(
    touching: Touching, label: np.ndarray, counted: np.ndarray, tails: np.ndarray
) -> tuple[np.ndarray, int]:
    """Domain of each cell, -1 for slivers and inside the solid, and the number of domains."""
    tail = np.flatnonzero(tails >= 0)
    same = np.flatnonzero(label[touching.cells[:, 0]] == label[touching.cells[:, 1]])
    links = [
        touching.cells[same[touching.certainly_wide()[same]]],
        np.column_stack([tail, tails[tail]]),
    ]
    group = _components(np.concatenate(links), len(label))
    for k in touching.doubtful(same):
        target, other = group[touching.cells[k]]
        if target != other and touching.is_wide(k):
            group[group == other] = target
    joined = True
    while joined:
        joined = False
        for _, rows in list(_by_pair(group[touching.cells], same)):
            target, other = group[touching.cells[rows[0]]]
            if target != other and touching.are_wide_together(rows):
                group[group == other] = target
                joined = True
    of_cell = np.full(len(label), -1)
    names, of_cell[counted] = np.unique(group[counted], return_inverse=True)
    return of_cell, len(names)


def _by_pair(ends: np.ndarray, rows: np.ndarray) -> Iterator[tuple[tuple[int, int], np.ndarray]]:
    """Yield each pair of different ends, lower first, and those of the rows that have it."""
    pairs = np.sort(ends[rows], axis=1)
    outer = pairs[:, 0] != pairs[:, 1]
    if outer.any():
        names, place = np.unique(pairs[outer], axis=0, return_inverse=True)
        order = np.argsort(place.ravel(), kind="stable")
        parts = np.split(
            rows[outer][order], np.searchsorted(place.ravel()[order], np.arange(1, len(names)))
        )
        yield from zip(map(tuple, names.tolist()), parts, strict=True)


def _components(links: np.ndarray, n: int) -> np.ndarray:
    return connected_components(
        coo_array((np.ones(len(links)), links.T), shape=(n, n)), directed=False
    )[1]


def _absorb(
    of_cell: np.ndarray,
    n_domains: int,
    label: np.ndarray,
    free: np.ndarray,
    volume: np.ndarray,
    borders: _Borders,
    ruler: Ruler,
) -> tuple[int, int]:
    """Give every sliver a domain, in place; return the number of domains and of slivers with another list than theirs.

    Slivers that border on no domain, as between displaced faces of the solid, stay without, unless there is no domain.
    """
    pairs = borders.pairs
    areas = borders.areas
    alike = (label[pairs[:, 0]] == label[pairs[:, 1]]) & (
        borders.widths >= ruler.least_width(borders.farthest)
    )
    _spread(of_cell, np.arange(len(of_cell)), pairs[alike], areas[alike])
    orphans = free[of_cell[free] < 0]
    sliver = _components(pairs[alike & (of_cell[pairs] < 0).all(axis=1)], len(of_cell))
    n_slivers = len(np.unique(sliver[orphans]))
    if n_domains == 0:
        of_cell[
            orphans[sliver[orphans] == np.argmax(np.bincount(sliver[orphans], volume[orphans]))]
        ] = 0
        n_domains = 1
        n_slivers = n_slivers - 1
    _spread(of_cell, sliver, pairs, areas)
    return n_domains, n_slivers


def _spread(of_cell: np.ndarray, unit: np.ndarray, pairs: np.ndarray, areas: np.ndarray) -> None:
    """Give units of cells without a domain that of the neighbours they share most boundary with, until none is left."""
    while True:
        pair_domains = of_cell[pairs]
        rows = np.flatnonzero((pair_domains >= 0).sum(axis=1) == 1)
        if not len(rows):
            return
        column = (pair_domains[rows, 0] >= 0).astype(int)
        lacking = unit[pairs[rows, column]]
        keys, place = np.unique(
            np.column_stack([lacking, pair_domains[rows, 1 - column]]), axis=0, return_inverse=True
        )
        shared = np.bincount(place.ravel(), areas[rows])
        best = np.lexsort([shared, keys[:, 0]])
        chosen = np.full(len(unit), -1)
        chosen[keys[best, 0]] = keys[best, 1]
        open_cells = np.flatnonzero(of_cell < 0)
        open_cells = open_cells[np.isin(unit[open_cells], keys[:, 0])]
        of_cell[open_cells] = chosen[unit[open_cells]]


def _members(of_cell: np.ndarray, free: np.ndarray, n_domains: int) -> list[np.ndarray]:
    placed = free[of_cell[free] >= 0]
    order = placed[np.argsort(of_cell[placed], kind="stable")]
    return np.split(order, np.searchsorted(of_cell[order], np.arange(1, n_domains)))


def _domain(
    cells: np.ndarray,
    labels: np.ndarray,
    label: np.ndarray,
    is_thin: np.ndarray,
    widths: CellWidths,
    ruler: Ruler,
) -> Domain:
    wide = cells[~is_thin[cells]]
    core = wide if len(wide) else cells
    centre, radius = widths.largest_ball(core, ruler)
    words = tuple(int(word) for word in labels[label[core[0]]])
    return Domain(words, cells, float(widths.volume[cells].sum()), centre, radius)


def _order_key(domain: Domain) -> tuple[Any, ...]:
    """Longest lists first, then by entity, then by place: the same for the same part."""
    bits = sum(word << (64 * k) for k, word in enumerate(domain.label))
    members = [k for k in range(bits.bit_length()) if bits >> k & 1]
    return (-len(members), members, [round(float(x), 3) for x in domain.viewpoint])


def _contacts(of_cell: np.ndarray, touching: Touching) -> dict[tuple[int, int], Contact]:
    contacts = {}
    is_certain = touching.certainly_wide()
    for pair, rows in _by_pair(of_cell[touching.cells], np.arange(len(touching.cells))):
        if (
            is_certain[rows].any()
            or any(map(touching.is_wide, touching.doubtful(rows)))
            or touching.are_wide_together(rows)
        ):
            contacts[pair] = Contact(float(touching.area[rows].sum()))
            for k in rows.tolist():
                for plane in touching.planes(k):
                    contacts[pair].planes[plane] = contacts[pair].planes.get(plane, 0.0) + float(
                        touching.area[k]
                    )
    return contacts
