"""Facets without area taken out of a closed surface, without moving a vertex.

A facet whose corners lie on one line has its middle corner on its longest side. The facet on the other side of that
side passes the corner by. Turning the side (an edge flip) makes it end at the corner, and the facet without area is
gone; the surface is the same. Longest facets go first: where two without area are neighbours, the side turned is then
the longest of both, and it becomes shorter.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterable

import numpy as np

_MOST_TURNS = 50
"""Turns tried for every facet without area, before what is left is left as it is."""


def turn_thin(
    vertices: np.ndarray, triangles: np.ndarray, width_mm: float, notes: list[str]
) -> np.ndarray:
    """Take out the facets no wider than `width_mm` by turning their longest sides; note how many.

    Parameters
    ----------
    vertices : ndarray, shape (n, 3)
        In mm.
    triangles : ndarray of int, shape (t, 3)
        Closed and oriented.
    width_mm : float
        Facets no wider have no area; the surface moves by no more than this.
    notes : list of str
        Gets a line if anything was done.

    Returns
    -------
    ndarray of int, shape (t', 3)
        Closed and oriented, with the same vertices in use. A facet whose middle corner is as close as `width_mm` to
        another one stays, and so does one whose turn would join two vertices a second time.
    """
    n_thin = _count_thin(vertices, triangles, width_mm)
    if not n_thin:
        return triangles
    surface = _Turner(vertices, triangles, width_mm)
    for _ in range(_MOST_TURNS * n_thin):
        if not surface.turn_next():
            break
    left = surface.rows()
    n_gone = n_thin - _count_thin(vertices, left, width_mm)
    if n_gone:
        notes.append(f"took out {n_gone} facets without area by turning their longest sides")
    return left


def _count_thin(vertices: np.ndarray, triangles: np.ndarray, width_mm: float) -> int:
    return int((_widths(vertices, triangles)[0] <= width_mm).sum())


def _widths(vertices: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the heights of triangles over their longest sides, and these, in mm."""
    corners = vertices[triangles]
    doubled_area = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    longest = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).max(axis=1)
    return np.divide(doubled_area, longest, out=np.zeros_like(longest), where=longest > 0), longest


class _Turner:
    """State of `turn_thin`: the triangles, their directed sides, and the thin ones in order."""

    def __init__(self, vertices: np.ndarray, triangles: np.ndarray, width_mm: float) -> None:
        self.vertices = vertices
        self.width_mm = width_mm
        self.triangles: list[tuple[int, int, int]] = [tuple(row) for row in triangles.tolist()]
        self.side = {pair: t for t, row in enumerate(self.triangles) for pair in _sides(row)}
        self.queue: list[tuple[float, int, tuple[int, int, int]]] = []
        self._note_thin(range(len(self.triangles)))

    def rows(self) -> np.ndarray:
        """Return the triangles as an array."""
        return np.array(self.triangles, dtype=np.int64).reshape(-1, 3)

    def turn_next(self) -> bool:
        """Turn the longest side of the next thin triangle, if it may be; return whether there was one."""
        if not self.queue:
            return False
        _, t, row = heapq.heappop(self.queue)
        if self.triangles[t] != row:
            return True
        p, q, apex = self._longest_side(row)
        across = self.side[q, p]
        far = next(v for v in self.triangles[across] if v not in (p, q))
        joined = far == apex or (far, apex) in self.side or (apex, far) in self.side
        if joined or not self._between(p, q, apex):
            return True
        for pair in (*_sides(row), *_sides(self.triangles[across])):
            del self.side[pair]
        for k, new in ((t, (p, far, apex)), (across, (far, q, apex))):
            self.triangles[k] = new
            self.side.update(dict.fromkeys(_sides(new), k))
        self._note_thin((t, across))
        return True

    def _note_thin(self, which: Iterable[int]) -> None:
        index = np.array(list(which), dtype=np.int64)
        width, length = _widths(
            self.vertices, np.array([self.triangles[t] for t in index.tolist()])
        )
        for t, size in zip(
            index[width <= self.width_mm].tolist(), length[width <= self.width_mm], strict=True
        ):
            heapq.heappush(self.queue, (-float(size), t, self.triangles[t]))

    def _longest_side(self, row: tuple[int, int, int]) -> tuple[int, int, int]:
        sizes = [float(np.linalg.norm(self.vertices[b] - self.vertices[a])) for a, b in _sides(row)]
        k = int(np.argmax(sizes))
        return row[k], row[(k + 1) % 3], row[(k + 2) % 3]

    def _between(self, p: int, q: int, apex: int) -> bool:
        """Return whether a vertex lies between two others, and not at one of them."""
        start, end, middle = self.vertices[[p, q, apex]]
        return bool(
            min(np.linalg.norm(middle - start), np.linalg.norm(middle - end)) > self.width_mm
        )


def _sides(row: tuple[int, int, int]) -> tuple[tuple[int, int], ...]:
    a, b, c = row
    return (a, b), (b, c), (c, a)
