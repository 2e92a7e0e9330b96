"""Where wide cells touch: on faces between them, and across slivers."""

from __future__ import annotations

from copy import copy

import numpy as np

from aspectgraph.cells.arrays import Complex
from aspectgraph.cells.measure import face_polygon
from aspectgraph.domains.across_slivers import pieces_across
from aspectgraph.domains.width import Ruler, disc_has_room, union_has_room


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
