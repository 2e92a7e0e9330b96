"""Where to draw the nodes of an aspect graph."""

from __future__ import annotations

from collections.abc import Hashable, Iterator

import networkx as nx
import numpy as np

# up to so many nodes there is time for more starts, and for distances between all pairs
_FEW, _MANY = 30, 250
_RANDOM_STARTS = 6


def layout(graph: nx.Graph) -> dict[Hashable, np.ndarray]:
    """Place nodes so that distances in the picture follow those in the graph, the longest lists on top.

    Kamada and Kawai (1989) from several starts; the result with the fewest crossings is turned upright.

    Returns
    -------
    dict of node to ndarray, shape (2,)
    """
    candidates = [np.array([placed[node] for node in graph]) for placed in _placements(graph)]
    points = candidates[0] if len(candidates) == 1 else min(candidates, key=lambda p: crossings(graph, p))
    points = points - points.mean(axis=0)
    rank = np.array([_rank(data) for _, data in graph.nodes(data=True)], float)
    up = points.T @ (rank - rank.mean())
    length = np.linalg.norm(up)
    if length > 1e-9:
        up = up / length
        points = points @ np.array([[up[1], up[0]], [-up[0], up[1]]])
    return dict(zip(graph, points, strict=True))


def _placements(graph: nx.Graph) -> Iterator[dict]:
    if len(graph) < 3:
        yield nx.circular_layout(graph)
        return
    if len(graph) > _MANY or not nx.is_connected(graph):
        yield nx.spring_layout(graph, seed=0)
        return
    distances = dict(nx.all_pairs_shortest_path_length(graph))
    planar, _ = nx.check_planarity(graph)
    starts = [nx.circular_layout(graph), nx.spectral_layout(graph), *([nx.planar_layout(graph)] if planar else [])]
    if len(graph) <= _FEW:
        starts += [nx.random_layout(graph, seed=seed) for seed in range(_RANDOM_STARTS)]
    for start in starts:
        yield nx.kamada_kawai_layout(graph, dist=distances, pos=start)


def crossings(graph: nx.Graph, points: np.ndarray) -> int:
    """Count the pairs of lines that cross when the nodes lie at (n, 2) points."""
    place = {node: k for k, node in enumerate(graph)}
    pairs = np.array([(place[i], place[j]) for i, j in graph.edges], int).reshape(-1, 2)
    start, end = points[pairs[:, 0]], points[pairs[:, 1]]

    def side(q):
        d, r = (end - start)[:, None], q[None] - start[:, None]
        return d[..., 0] * r[..., 1] - d[..., 1] * r[..., 0]

    apart = side(start) * side(end) < 0
    shared = (pairs[:, None, :, None] == pairs[None, :, None, :]).any(axis=(2, 3))
    return int((apart & apart.T & ~shared).sum() // 2)


def _rank(data: dict) -> int:
    return len(data["observable"]) if "observable" in data else data.get("n_visible", 0)
