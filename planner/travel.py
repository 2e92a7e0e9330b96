"""The order in which the robot visits the settings: a shortest open path through poses.

The distance between two poses is ``|translation| + radian_mm * |rotation angle|``, a metric on rigid motions: a turn of
one radian counts as much as ``radian_mm`` of travel.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.spatial.transform import Rotation

RADIAN_MM = 200.0
_EXACT_UP_TO = 12
# of so many paths, each improved, the shortest is taken
_STARTS = 16


def pose_distances(cam2worlds: np.ndarray, radian_mm: float = RADIAN_MM) -> np.ndarray:
    """Compute the travel between every two poses.

    Parameters
    ----------
    cam2worlds : array_like, shape (n, 4, 4)
        Poses, millimetres.
    radian_mm : float
        Travel in millimetres that a turn of one radian is worth.

    Returns
    -------
    ndarray, shape (n, n)
        Symmetric, zero on the diagonal, millimetres.
    """
    poses = np.asarray(cam2worlds, dtype=float).reshape(-1, 4, 4)
    if len(poses) == 0:
        return np.zeros((0, 0))
    moves = np.linalg.norm(poses[:, None, :3, 3] - poses[None, :, :3, 3], axis=-1)
    relative = np.einsum("aji,bjk->abik", poses[:, :3, :3], poses[:, :3, :3])
    turns = Rotation.from_matrix(relative.reshape(-1, 3, 3)).magnitude().reshape(moves.shape)
    distances = moves + radian_mm * turns
    np.fill_diagonal(distances, 0.0)
    return np.minimum(distances, distances.T)


def path_length(distances: np.ndarray, order: Sequence[int]) -> float:
    """Add up the distances along an open path."""
    path = np.asarray(order, dtype=int)
    return float(np.asarray(distances)[path[:-1], path[1:]].sum())


def travel_order(cam2worlds: np.ndarray, radian_mm: float = RADIAN_MM) -> tuple[int, ...]:
    """Order poses so that the robot's travel is short.

    **Guarantee.** The result is a permutation of all poses. For up to 12 poses, it is the shortest
    open path. For more, no reversal or relocation of a piece shortens the path. It starts at the
    end with the smaller index.

    Parameters
    ----------
    cam2worlds : array_like, shape (n, 4, 4)
        Poses, mm.
    radian_mm : float
        Travel in mm that counts the same as a turn of one radian.

    Returns
    -------
    tuple of int
        Indices of the poses in the order of travel.

    Examples
    --------
    >>> from planner import look_at, travel_order
    >>> poses = look_at([[0, 0, 100], [300, 0, 100], [100, 0, 100], [200, 0, 100]], [0, 0, 0])
    >>> travel_order(poses)
    (0, 2, 3, 1)
    """
    return order_by(pose_distances(cam2worlds, radian_mm))


def order_by(distances: np.ndarray, starts: int = _STARTS) -> tuple[int, ...]:
    """Return `travel_order` for distances (n, n); beyond 12 poses, paths from so many of them are improved."""
    n = len(distances)
    if n < 3:
        return tuple(range(n))
    order = shortest_path(distances) if n <= _EXACT_UP_TO else improved_path(distances, starts)
    return tuple(order if order[0] < order[-1] else order[::-1])


def shortest_path(distances: np.ndarray) -> list[int]:
    """Find the shortest open path through all points by dynamic programming over subsets (Held and Karp 1962)."""
    distances = np.asarray(distances, dtype=float)
    n = len(distances)
    # length[s, j]: shortest path through the points of subset s that ends in j
    length = np.full((1 << n, n), np.inf)
    length[1 << np.arange(n), np.arange(n)] = 0.0
    before = np.full((1 << n, n), -1)
    for subset in range(1, 1 << n):
        outside = np.flatnonzero(~(subset >> np.arange(n)) & 1)
        if outside.size == 0:
            continue
        via = length[subset][:, None] + distances[:, outside]
        best = via.argmin(axis=0)
        grown = subset | (1 << outside)
        found = via[best, np.arange(outside.size)]
        better = found < length[grown, outside]
        length[grown[better], outside[better]] = found[better]
        before[grown[better], outside[better]] = best[better]
    subset = (1 << n) - 1
    last = int(length[-1].argmin())
    order = [last]
    while before[subset, last] >= 0:
        subset, last = subset & ~(1 << last), int(before[subset, last])
        order.append(last)
    return order[::-1]


def improved_path(distances: np.ndarray, starts: int = _STARTS) -> list[int]:
    """Improve nearest-neighbour paths by reversing and relocating pieces until neither helps (2-opt, or-opt)."""
    distances = np.asarray(distances, dtype=float)
    paths = (
        _improve(distances, _nearest_neighbour(distances, start))
        for start in range(min(len(distances), starts))
    )
    return min(paths, key=lambda order: path_length(distances, order))


def _nearest_neighbour(distances: np.ndarray, start: int) -> list[int]:
    order = [start]
    left = set(range(len(distances))) - {start}
    while left:
        order.append(min(left, key=lambda j: (distances[order[-1], j], j)))
        left.remove(order[-1])
    return order


def _improve(distances: np.ndarray, order: list[int]) -> list[int]:
    length = path_length(distances, order)
    improved = True
    while improved:
        improved = False
        for candidate in _variations(order):
            candidate_length = path_length(distances, candidate)
            if candidate_length < length - 1e-9:
                order = candidate
                length = candidate_length
                improved = True
                break
    return order


def _variations(order: list[int]) -> Iterator[list[int]]:
    """Yield every path that differs by one reversed or one relocated piece (of up to three points)."""
    n = len(order)
    for i in range(n):
        for j in range(i + 2, n + 1):
            yield order[:i] + order[i:j][::-1] + order[j:]
    for i in range(n):
        for size in (1, 2, 3):
            piece = order[i : i + size]
            rest = order[:i] + order[i + size :]
            for k in range(len(rest) + 1):
                yield rest[:k] + piece + rest[k:]
