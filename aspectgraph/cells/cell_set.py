"""Sets of convex cells as users see them: in millimetres, to measure, to draw from and to look at."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from aspectgraph.cells.arrays import (
    N_CELLS,
    Complex,
    cell_sizes,
    cell_triangles,
    half_spaces,
    holds,
    measured,
    spans,
    tree_of,
)
from aspectgraph.exact.grid import Grid, turned


@dataclass(frozen=True, repr=False)
class Cell:
    """A convex polytope.

    Attributes
    ----------
    half_spaces : ndarray, shape (k, 4)
        Rows (a, b, c, d) with unit normals: a·x + b·y + c·z + d <= 0 inside, in mm. `PartitionSurface.plane` and its
        GraphML attribute have the opposite d.
    vertices : ndarray, shape (v, 3)
        Corners in mm, and points of its boundary where edges of other cells end.
    volume : float
        In mm³.
    """

    half_spaces: np.ndarray
    vertices: np.ndarray
    volume: float

    def __repr__(self) -> str:
        """Return a one-line summary."""
        return f"<Cell: {len(self.half_spaces)} half-spaces, {self.volume:.4g} mm³>"


class CellSet:
    """A union of convex cells of one partition of the workspace.

    Parameters
    ----------
    cx : Complex
        The partition.
    cells : array_like of int
        The cells of the set.
    grid : Grid
        The integer grid the partition lies on.

    Attributes
    ----------
    volumes : ndarray, shape (m,)
        Volume of each cell in mm³.
    """

    def __init__(self, cx: Complex, cells: np.ndarray, grid: Grid) -> None:
        self._cx = cx
        self._cells = np.asarray(cells, np.int64)
        self._grid = grid
        self._measured = measured(cx, grid)
        self._sizes = cell_sizes(self._measured, self._cells)
        self.volumes = self._sizes[:, 0] * grid.step_mm**3

    def __repr__(self) -> str:
        """Return a one-line summary."""
        return f"<CellSet: {len(self)} cells, {self.volume:.4g} mm³>"

    def __len__(self) -> int:
        return len(self._cells)

    def __iter__(self) -> Iterator[Cell]:
        return (self[k] for k in range(len(self)))

    def __getitem__(self, k: int) -> Cell:
        cell = int(self._cells[k])
        grid = self._grid
        rows = half_spaces(self._measured, cell)
        rows[:, 3] = rows[:, 3] * grid.step_mm - rows[:, :3] @ grid.origin_mm
        rows[:, :3] = turned(grid.frame.T, rows[:, :3])
        corners = cell_triangles(self._cx, cell).reshape(-1, 3)
        # np.unique does the same, and takes five times as long for so few rows
        corners = corners[np.lexsort(corners.T[::-1])]
        corners = corners[np.append(True, (corners[1:] != corners[:-1]).any(axis=1))]
        return Cell(rows, grid.to_mm(corners), float(self.volumes[k]))

    @property
    def volume(self) -> float:
        """Total volume in mm³."""
        return float(self.volumes.sum())

    @cached_property
    def bounds(self) -> np.ndarray:
        """Lowest and highest corner in mm, shape (2, 3).

        Raises
        ------
        ValueError
            If the set is empty.
        """
        if not len(self):
            raise ValueError("bounds need at least one cell. The set is empty.")
        grid = self._grid
        return spans(self._cx, self._cells, grid.frame.T * grid.steps_mm) + turned(
            grid.frame.T, grid.origin_mm
        )

    def contains(self, points: ArrayLike) -> np.ndarray:
        """Whether the closed set contains points, exactly.

        Parameters
        ----------
        points : array_like, shape (n, 3)
            Points in mm. They are rounded to 2**-20 of a grid step, and the answer for the rounded
            point is exact.

        Returns
        -------
        ndarray of bool, shape (n,)
            True on the boundary too.
        """
        flag = np.zeros(int(self._cx.count[N_CELLS]), bool)
        flag[self._cells] = True
        return holds(
            tree_of(self._cx), flag, self._grid.to_points(np.asarray(points, float).reshape(-1, 3))
        )

    def sample(self, n: int, rng: int | np.random.Generator = 0) -> np.ndarray:
        """Draw points uniformly from the union.

        Parameters
        ----------
        n : int
            How many points.
        rng : int or numpy.random.Generator
            Seed or source of chance.

        Returns
        -------
        ndarray of float64, shape (n, 3)
            Points in mm.

        Raises
        ------
        ValueError
            If the set is empty.
        """
        if not len(self):
            raise ValueError("sample needs at least one cell. The set is empty.")
        generator = np.random.default_rng(rng)
        corners, volumes = self._tetrahedra
        chosen = corners[generator.choice(len(volumes), size=n, p=volumes / volumes.sum())]
        weights = generator.exponential(size=(n, 4))
        weights /= weights.sum(axis=1, keepdims=True)
        return self._grid.to_mm(np.einsum("nk,nkc->nc", weights, chosen))

    @cached_property
    def _tetrahedra(self) -> tuple[np.ndarray, np.ndarray]:
        """Tetrahedra that tile the cells: corners in grid steps, shape (t, 4, 3), and volumes."""
        parts = []
        for cell in self._cells:
            triangles = cell_triangles(self._cx, cell)
            apex = np.broadcast_to(triangles.reshape(-1, 3).mean(axis=0), (len(triangles), 1, 3))
            parts.append(np.concatenate([apex, triangles], axis=1))
        corners = np.concatenate(parts)
        edges = corners[:, 1:] - corners[:, :1]
        volumes = np.abs(np.linalg.det(edges)) / 6.0
        return corners, volumes
