"""Which cells and polygons are wide enough to count, by the largest balls and discs in them.

All sizes are doubles in grid steps. Nothing here decides what is observable.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import shapely
from scipy.optimize import linprog
from scipy.spatial import ConvexHull
from scipy.spatial.distance import cdist

from aspectgraph.cells.arrays import Complex
from aspectgraph.cells.measure import cell_sizes, half_spaces, inner_balls
from aspectgraph.exceptions import WidthError

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
    kept = length > 0.0
    outward = np.cross(sides[kept], normal) / length[kept, None]
    walls = np.column_stack([outward, -(outward * corners[kept]).sum(axis=1)])
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
        for one, other, plane, _ in sides[
            alike & (share[sides[:, :2]] >= 0.5).any(axis=1)
        ].tolist():
            # what lies in all other half-spaces of both lies in one of the two
            rows = [half_spaces(self._cx, cell, plane) for cell in (one, other)]
            if thin[[one, other]].any() and has_room(np.concatenate(rows), ruler):
                thin[[one, other]] = False
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
