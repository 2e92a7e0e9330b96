"""Vertices made one, and facets that say nothing dropped."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree


def weld(vertices: np.ndarray, distance_mm: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Merge vertices that are equal or, if a distance is given, linked by steps no longer than it.

    Returns
    -------
    vertices : ndarray, shape (m, 3)
        In order of first appearance; of merged ones the first stays where it is.
    new : ndarray of int, shape (n,)
        The new index of every old vertex.
    """
    if distance_mm > 0:
        pairs = cKDTree(vertices).query_pairs(distance_mm, output_type="ndarray")
        n = len(vertices)
        links = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
        label = connected_components(links, directed=False)[1]
    else:
        label = _label_rows(vertices)
    _, first = np.unique(label, return_index=True)
    order = np.argsort(first)
    rank = np.empty(len(first), dtype=np.int64)
    rank[order] = np.arange(len(first))
    return vertices[first[order]], rank[label]


def _label_rows(rows: np.ndarray) -> np.ndarray:
    """Number the rows of an array, equal ones alike."""
    order = np.lexsort(rows.T)
    ordered = rows[order]
    label = np.zeros(len(rows), dtype=np.int64)
    label[order[1:]] = np.cumsum((ordered[1:] != ordered[:-1]).any(axis=1))
    return label


def is_closed(triangles: np.ndarray) -> bool:
    """Return whether every edge, whichever way it runs, has exactly two triangles."""
    if not len(triangles):
        return False
    start = triangles.ravel()
    end = np.roll(triangles, -1, axis=1).ravel()
    key = np.minimum(start, end) * (int(triangles.max()) + 1) + np.maximum(start, end)
    return bool((np.unique(key, return_counts=True)[1] == 2).all())


def drop_repetitions(triangles: np.ndarray, notes: list[str]) -> np.ndarray:
    """Drop triangles that use a vertex twice, and all but the first of equal ones; note how many."""
    whole = (triangles != np.roll(triangles, 1, axis=1)).all(axis=1)
    if not whole.all():
        notes.append(f"dropped {int((~whole).sum())} facets that use a vertex twice")
        triangles = triangles[whole]
    if not len(triangles):
        return triangles
    turn = np.argmin(triangles, axis=1)[:, None] + np.arange(3)
    canonical = np.take_along_axis(triangles, turn % 3, axis=1)
    first = np.unique(_label_rows(canonical), return_index=True)[1]
    first.sort()
    if len(first) < len(triangles):
        notes.append(f"dropped {len(triangles) - len(first)} repeated facets")
    return triangles[first]


def drop_thin(
    vertices: np.ndarray, triangles: np.ndarray, width_mm: float, notes: list[str]
) -> np.ndarray:
    """Drop triangles no wider than `width_mm`; note how many."""
    corners = vertices[triangles]
    doubled_area = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    longest = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).max(axis=1)
    thin = doubled_area <= width_mm * longest
    if thin.any():
        notes.append(f"dropped {int(thin.sum())} facets without area")
    return triangles[~thin]
