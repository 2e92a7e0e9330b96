"""Viewpoints drawn uniformly from the covering domains, as far as the lens can focus there.

An entity's end at depth z is at most z / cos(θ) away, θ being the angle of the sensor's corner. So in every feasible
setting each end is between D_min and D_max / cos(θ) from the nodal point: the viewpoint lies in the *shell*, the
intersection of one spherical shell per end. In a wide workspace the shell is a small part of the covering domains and
plain volume-weighted draws would hardly ever hit it.

Guarantee: every viewpoint returned lies in the covering domains and in the shell, and is uniform there. That holds
because each of the three ways to propose viewpoints is uniform on a set that contains the intersection, and what lies
outside the intersection is rejected. The way with the smallest such set is taken.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from planner.camera.camera import Camera
from planner.request.necessary import boxes_reach, focus_reach_mm

if TYPE_CHECKING:
    from aspectgraph import CellSet

_BATCH = 4096


class ViewpointSampler:
    """Uniform draws from the intersection of convex cells and the focus shell.

    Parameters
    ----------
    cells : CellSet
        The covering domains.
    ends : array (k, 2, 3)
        Ends of the entities, mm.
    camera : Camera
        Gives D_min, D_max and θ.

    Attributes
    ----------
    bounds : array (2, 3)
        Box that contains the intersection, mm; `empty` if it is known to be empty.
    proposal : {"cells", "shell", "boxes"}
        How viewpoints are proposed.
    """

    def __init__(self, cells: CellSet, ends: np.ndarray, camera: Camera) -> None:
        self.cells = cells
        self.points = ends.reshape(-1, 3)
        self.near, self.far = focus_reach_mm(camera)
        # a mean of the ends: no viewpoint is farther from it than from the farthest end
        self._centre = self.points.mean(axis=0)
        spread = np.linalg.norm(self.points - self._centre, axis=1).max()
        self._radii = max(self.near - spread, 0.0), self.far
        self._clip_boxes()
        if not self.empty:
            self._choose_proposal()

    def _clip_boxes(self) -> None:
        """Clip the bounding box of every cell to the box that contains the shell."""
        self._parts = list(self.cells)
        corners = np.array(
            [[part.vertices.min(axis=0), part.vertices.max(axis=0)] for part in self._parts]
        )
        corners = corners.reshape(-1, 2, 3)
        low = np.maximum(corners[:, 0], (self.points - self.far).max(axis=0))
        high = np.minimum(corners[:, 1], (self.points + self.far).min(axis=0))
        self._kept = np.flatnonzero(
            (low < high).all(axis=1) & boxes_reach(low, high, self.points, self.near, self.far)
        )
        self._low = low[self._kept]
        self._high = high[self._kept]
        self.empty = not len(self._kept)
        self.bounds = (
            np.empty((2, 0))
            if self.empty
            else np.array([self._low.min(axis=0), self._high.max(axis=0)])
        )

    def _choose_proposal(self) -> None:
        inner, outer = self._radii
        sizes = {
            "cells": float(self.cells.volume),
            "shell": 4 / 3 * np.pi * (outer**3 - inner**3) if np.isfinite(outer) else np.inf,
            "boxes": float(np.prod(self._high - self._low, axis=1).sum()),
        }
        self.proposal = min(sizes, key=sizes.__getitem__)

    def in_shell(self, positions: np.ndarray) -> np.ndarray:
        """Return which positions (n, 3) have every end at a distance that can be in focus; (n,) bool."""
        local = positions - self._centre
        (inner, outer) = self._radii
        squared = (local**2).sum(axis=1)
        result = (squared >= inner**2) & (squared <= outer**2)
        rows = np.flatnonzero(result)
        ends = self.points - self._centre
        of_ends = squared[rows, None] - 2 * local[rows] @ ends.T + (ends**2).sum(axis=1)
        result[rows] = (of_ends.min(axis=1) >= self.near**2) & (of_ends.max(axis=1) <= self.far**2)
        return result

    def sample(self, n: int, rng: np.random.Generator, max_proposals: int = 500_000) -> np.ndarray:
        """Draw up to n viewpoints (m, 3); fewer (perhaps none) if so many proposals do not yield more."""
        found = []
        total = 0
        proposed = 0
        while not self.empty and total < n and proposed < max_proposals:
            batch = self._propose(_BATCH, rng)
            proposed += _BATCH
            found.append(batch)
            total += len(batch)
        return np.concatenate(found)[:n] if found else np.empty((0, 3))

    def _propose(self, n: int, rng: np.random.Generator) -> np.ndarray:
        """Propose n viewpoints and return those in cells and shell."""
        if self.proposal == "cells":
            positions = self.cells.sample(n, rng)
            return positions[self.in_shell(positions)]
        if self.proposal == "shell":
            positions = self._shell_points(n, rng)
            positions = positions[self.in_shell(positions)]
            return positions[self.cells.contains(positions)] if len(positions) else positions
        return self._box_points(n, rng)

    def _shell_points(self, n: int, rng: np.random.Generator) -> np.ndarray:
        direction = rng.normal(size=(n, 3))
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        inner, outer = self._radii
        radius = np.cbrt(rng.uniform(inner**3, outer**3, n))
        return self._centre + radius[:, None] * direction

    def _box_points(self, n: int, rng: np.random.Generator) -> np.ndarray:
        """Draw from the cells' boxes by volume; keep what lies in that very cell (cells do not overlap)."""
        volumes = np.prod(self._high - self._low, axis=1)
        chosen = rng.choice(len(volumes), size=n, p=volumes / volumes.sum())
        positions = rng.uniform(self._low[chosen], self._high[chosen])
        keep = self.in_shell(positions)
        positions = positions[keep]
        chosen = chosen[keep]
        planes = self._half_spaces[chosen]
        return positions[
            ((planes[..., :3] @ positions[:, :, None])[..., 0] + planes[..., 3] <= 0).all(axis=1)
        ]

    @property
    def _half_spaces(self) -> np.ndarray:
        """Half-spaces (m, s, 4) of the kept cells, padded with 0·x − 1 <= 0, which always holds."""
        if not hasattr(self, "_padded"):
            planes = [np.asarray(self._parts[i].half_spaces, dtype=float) for i in self._kept]
            self._padded = np.tile([0.0, 0.0, 0.0, -1.0], (len(planes), max(map(len, planes)), 1))
            for row, own in zip(self._padded, planes, strict=True):
                row[: len(own)] = own
        return self._padded

    def cell_of(self, position: np.ndarray) -> np.ndarray | None:
        """Return the half-spaces (s, 4) of the cell that contains a position (3,), or None."""
        inside = (self._half_spaces[..., :3] @ position + self._half_spaces[..., 3] <= 0).all(
            axis=1
        )
        return self._half_spaces[np.argmax(inside)] if inside.any() else None


class WorkspaceSampler(ViewpointSampler):
    """Uniform draws from the whole workspace: what the restriction to the covering domains is measured against."""

    def __init__(
        self, cells: CellSet, ends: np.ndarray, camera: Camera, workspace: np.ndarray
    ) -> None:
        super().__init__(cells, ends, camera)
        if not self.empty:
            self.bounds = np.array(workspace, dtype=np.float64)
            self.proposal = "workspace"

    def _propose(self, n: int, rng: np.random.Generator) -> np.ndarray:
        return rng.uniform(self.bounds[0], self.bounds[1], (n, 3))
