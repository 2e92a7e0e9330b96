"""Where to draw the nodes of an aspect graph."""

from __future__ import annotations

from collections.abc import Hashable, Iterator
from typing import Any

import networkx as nx
import numpy as np

from aspectgraph.plot.style import listed_on

# up to so many nodes there is time for more starts, and for distances between all pairs
_FEW = 30
_MANY = 250
_RANDOM_STARTS = 6

# in units of one line
_STEPS = 500
_STILL = 1e-4
_TOUCHING = 1e-9
_NEAR = 0.15


def layout(graph: nx.Graph) -> dict[Hashable, np.ndarray]:
    """Place nodes so that distances in the picture follow those in the graph, the longest lists on top.

    Stress majorization (Gansner, Koren and North 2004) from several starts; the result with the fewest lines that
    cross or run over other nodes is turned upright.

    Returns
    -------
    dict of node to ndarray, shape (2,)
    """
    candidates = list(_placements(graph))
    points = (
        candidates[0]
        if len(candidates) == 1
        else min(candidates, key=lambda p: crossings(graph, p) + hits(graph, p))
    )
    points = points - points.mean(axis=0)
    rank = np.array([_rank(data) for _, data in graph.nodes(data=True)], float)
    up = points.T @ (rank - rank.mean())
    length = np.linalg.norm(up)
    if length > 1e-9:
        up = up / length
        points = points @ np.array([[up[1], up[0]], [-up[0], up[1]]])
    return dict(zip(graph, points, strict=True))


def _placements(graph: nx.Graph) -> Iterator[np.ndarray]:
    if len(graph) > _MANY or not nx.is_connected(graph):
        yield _array(graph, nx.spring_layout(graph, seed=0))
        return
    lengths = dict(nx.all_pairs_shortest_path_length(graph))
    distances = np.array([[lengths[i][j] for j in graph] for i in graph], float)
    starts = [nx.circular_layout(graph)]
    if len(graph) > 2:
        starts.append(nx.spectral_layout(graph))
    if nx.check_planarity(graph)[0]:
        starts.append(nx.planar_layout(graph))
    if len(graph) <= _FEW:
        starts += [nx.random_layout(graph, seed=seed) for seed in range(_RANDOM_STARTS)]
    for start in starts:
        yield least_stress(distances, _array(graph, start))


def _array(graph: nx.Graph, places: dict[str, Any]) -> np.ndarray:
    return np.array([places[node] for node in graph], float).reshape(-1, 2)


def least_stress(distances: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Move points in the plane until their distances are as close as they get to those wanted.

    Parameters
    ----------
    distances : ndarray, shape (n, n)
        Wanted; the square of an error counts by the inverse square of the distance.
    points : ndarray, shape (n, 2)
        To start from.

    Returns
    -------
    ndarray, shape (n, 2)
    """
    n = len(points)
    apart = distances > 0
    weights = np.where(apart, 1.0 / np.where(apart, distances, 1.0) ** 2, 0.0)
    # V X' = B(X) X, V singular only for a common shift
    inverse = np.linalg.inv(np.diag(weights.sum(axis=1)) - weights + 1.0 / n)
    for _ in range(_STEPS):
        now = np.linalg.norm(points[:, None] - points[None], axis=2)
        pull = np.where(
            apart & (now > _TOUCHING),
            weights * distances / np.where(now > _TOUCHING, now, 1.0),
            0.0,
        )
        moved = inverse @ (pull.sum(axis=1)[:, None] * points - pull @ points)
        if np.abs(moved - points).max() < _STILL:
            return moved
        points = moved
    return points


def crossings(graph: nx.Graph, points: np.ndarray) -> int:
    """Count the pairs of lines that cross when the nodes lie at (n, 2) points."""
    place = {node: k for k, node in enumerate(graph)}
    pairs = np.array([(place[i], place[j]) for i, j in graph.edges], int).reshape(-1, 2)
    start = points[pairs[:, 0]]
    end = points[pairs[:, 1]]

    def side(q: np.ndarray) -> np.ndarray:
        d = (end - start)[:, None]
        r = q[None] - start[:, None]
        return d[..., 0] * r[..., 1] - d[..., 1] * r[..., 0]

    apart = side(start) * side(end) < 0
    shared = (pairs[:, None, :, None] == pairs[None, :, None, :]).any(axis=(2, 3))
    return int((apart & apart.T & ~shared).sum() // 2)


def hits(graph: nx.Graph, points: np.ndarray) -> int:
    """Count the pairs of a line and a node, not one of its ends, that it runs over or close by."""
    place = {node: k for k, node in enumerate(graph)}
    pairs = np.array([(place[i], place[j]) for i, j in graph.edges], int).reshape(-1, 2)
    start = points[pairs[:, :1]]
    along = points[pairs[:, 1:]] - points[pairs[:, :1]]
    length2 = np.maximum((along**2).sum(axis=2), _TOUCHING)
    share = np.clip(((points[None] - start) * along).sum(axis=2) / length2, 0.0, 1.0)
    distance = np.linalg.norm(points[None] - start - share[..., None] * along, axis=2)
    ends = (pairs[:, :, None] == np.arange(len(points))).any(axis=1)
    return int(((distance < _NEAR) & ~ends).sum())


def _rank(data: dict[str, Any]) -> int:
    listed = listed_on(data)
    return data.get("n_visible", 0) if listed is None else len(listed)
