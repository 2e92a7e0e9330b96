"""Coplanar triangles found and grouped.

Notation
--------
Half-edge ``h = 3 t + k`` runs from corner k of triangle t to the next corner. ``twin[h]`` is the half-edge on the other
side, which runs the other way. A *group* is a set of triangles that becomes one face.
"""

from __future__ import annotations

import math

import numpy as np


def find_twins(triangles: np.ndarray) -> np.ndarray:
    """Return the twin of every half-edge of closed, oriented triangles, shape (3 t,)."""
    start = triangles.astype(np.int64).ravel()
    end = np.roll(triangles, -1, axis=1).astype(np.int64).ravel()
    n = int(start.max()) + 1
    forward = start * n + end
    backward = end * n + start
    order = np.argsort(forward)
    return order[np.searchsorted(forward, backward, sorter=order)]


def group_coplanar(
    vertices: np.ndarray,
    triangles: np.ndarray,
    twin: np.ndarray,
    joinable: np.ndarray,
    tolerance_mm: float,
) -> np.ndarray:
    """Label triangles that lie in one plane and hang together.

    Groups grow from the largest triangle left. The plane is refitted whenever the area has doubled; a group that ends
    up uneven all the same is taken apart again.

    Parameters
    ----------
    vertices : ndarray, shape (n, 3)
        In mm.
    triangles : ndarray of int, shape (t, 3)
        Closed and oriented.
    twin : ndarray of int, shape (3 t,)
        See `find_twins`.
    joinable : ndarray of bool, shape (3 t,)
        Whether a group may grow across a half-edge.
    tolerance_mm : float
        Largest distance of a corner from the plane of its group.

    Returns
    -------
    ndarray of int, shape (t,)
        Labels 0, 1, ... in order of each group's first triangle.
    """
    corners = (vertices - vertices.mean(axis=0))[triangles]
    area_vectors = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    neighbour = twin // 3
    reachable = np.where(joinable, neighbour, -1).reshape(-1, 3)
    grower = _Grower(corners, area_vectors, reachable, tolerance_mm)
    stays_alone = _stays_alone(corners, area_vectors, reachable, 2.0 * tolerance_mm).tolist()
    for seed in np.argsort(-np.linalg.norm(area_vectors, axis=1), kind="stable").tolist():
        if grower.label[seed] < 0:
            grower.grow(seed, stays_alone[seed])
    label = np.array(grower.label)
    _adopt_slivers(label, grower.areas, corners, neighbour.reshape(-1, 3), tolerance_mm)
    return _in_order(label)


def _stays_alone(
    corners: np.ndarray, area_vectors: np.ndarray, neighbour: np.ndarray, band_mm: float
) -> np.ndarray:
    """Return which triangles are groups of their own if a group begins there: no neighbour lies in their plane."""
    length = np.linalg.norm(area_vectors, axis=1, keepdims=True)
    normal = np.divide(area_vectors, length, out=np.zeros_like(area_vectors), where=length > 0)
    own = np.einsum("tij,tj->ti", corners, normal)
    height = 0.5 * (own.min(axis=1) + own.max(axis=1))
    # `_fits` decides where rounding could
    slack_mm = 1e-6 * band_mm + 1e-12 * float(np.abs(corners).max())
    alone = np.ones(len(corners), dtype=bool)
    for k in range(3):
        other = neighbour[:, k]
        off = np.abs(np.einsum("tij,tj->ti", corners[other], normal) - height[:, None]).max(axis=1)
        alone &= (other < 0) | (off > band_mm + slack_mm)
    return alone


def _in_order(label: np.ndarray) -> np.ndarray:
    _, first, inverse = np.unique(label, return_index=True, return_inverse=True)
    rank = np.empty(len(first), dtype=np.int64)
    rank[np.argsort(first)] = np.arange(len(first))
    return rank[inverse]


class _Grower:
    """State of `group_coplanar`."""

    def __init__(
        self,
        corners: np.ndarray,
        area_vectors: np.ndarray,
        neighbour: np.ndarray,
        tolerance_mm: float,
    ) -> None:
        self.corners = corners
        self.area_vectors = area_vectors
        self.areas = np.linalg.norm(area_vectors, axis=1)
        self.neighbour = neighbour.tolist()
        self.tolerance_mm = tolerance_mm
        self.label: list[int] = [-1] * len(corners)
        self.n_groups = 0

    def grow(self, seed: int, stays_alone: bool) -> None:
        """Collect a new group around triangle `seed`."""
        members = [seed] if stays_alone else self._flood(seed, 2.0 * self.tolerance_mm)
        if len(members) > 1 and self._unevenness(members) > self.tolerance_mm:
            members = self._flood(seed, 0.5 * self.tolerance_mm)
            if self._unevenness(members) > self.tolerance_mm:
                members = [seed]
        for t in members:
            self.label[t] = self.n_groups
        self.n_groups += 1

    def _flood(self, seed: int, band_mm: float) -> list[int]:
        members = [seed]
        seen = {seed}
        # plain numbers: arrays of three take longer
        x, y, z = self.area_vectors[seed].tolist()
        fitted_area = float(self.areas[seed])
        normal, height = self._plane(np.array([x, y, z]), members)
        plane = (*normal.tolist(), height)
        front = [seed]
        while front:
            for t in self.neighbour[front.pop()]:
                if t < 0 or t in seen or self.label[t] >= 0:
                    continue
                if not self._fits(t, plane, band_mm):
                    continue
                seen.add(t)
                members.append(t)
                front.append(t)
                dx, dy, dz = self.area_vectors[t].tolist()
                x += dx
                y += dy
                z += dz
                area = math.sqrt(x * x + y * y + z * z)
                if area > 2.0 * fitted_area:
                    fitted_area = area
                    normal, height = self._plane(np.array([x, y, z]), members)
                    plane = (*normal.tolist(), height)
        return members

    def _fits(self, t: int, plane: tuple[float, float, float, float], band_mm: float) -> bool:
        u, v, w, height = plane
        (ax, ay, az), (bx, by, bz), (cx, cy, cz) = self.corners[t].tolist()
        if (
            abs(ax * u + ay * v + az * w - height) > band_mm
            or abs(bx * u + by * v + bz * w - height) > band_mm
            or abs(cx * u + cy * v + cz * w - height) > band_mm
        ):
            return False
        longest = max(
            max(ax, bx, cx) - min(ax, bx, cx),
            max(ay, by, cy) - min(ay, by, cy),
            max(az, bz, cz) - min(az, bz, cz),
        )
        x, y, z = self.area_vectors[t].tolist()
        return bool(x * u + y * v + z * w > -band_mm * longest)

    def _plane(self, total: np.ndarray, members: list[int]) -> tuple[np.ndarray, float]:
        length = np.linalg.norm(total)
        normal = total / length if length > 0 else total
        heights = self.corners[members] @ normal
        return normal, 0.5 * float(heights.min() + heights.max())

    def _unevenness(self, members: list[int]) -> float:
        normal, height = self._plane(self.area_vectors[members].sum(axis=0), members)
        return float(np.abs(self.corners[members] @ normal - height).max())


def _adopt_slivers(
    label: np.ndarray,
    areas: np.ndarray,
    corners: np.ndarray,
    neighbour: np.ndarray,
    tolerance_mm: float,
) -> None:
    """Give triangles without width that stayed alone to the group across their longest side."""
    sides = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    alone = np.bincount(label)[label] == 1
    thin = 2.0 * areas <= tolerance_mm * 1e-3 * sides.max(axis=1)
    for t in np.flatnonzero(alone & thin):
        label[t] = label[neighbour[t, int(np.argmax(sides[t]))]]
