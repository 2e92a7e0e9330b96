"""Local search for long rounds: reversals and relocations, each judged with branches chosen anew.

For the present order, ``way[i, j]`` (b, b) holds the shortest way from the i-th to the j-th place by
branches at both ends. Any reversal or relocation is then a chain of at most six such matrices, so
that all of them are judged together with sums and minima of arrays.
"""

from __future__ import annotations

import itertools

import numpy as np

KICKS = 24
"""How often the best round is disturbed and improved again."""

_LONGEST_PIECE = 3
# an improvement must be more than rounding, s
_LEAST_S = 1e-9


def improved_order(
    costs: np.ndarray, kicks: int = KICKS, start: list[int] | None = None
) -> list[int]:
    """Return a short order that no reversal or relocation shortens.

    Parameters
    ----------
    costs : array (n + 1, n + 1, b, b)
        Seconds, as for `planner.motion.tour.shortest_tour`.
    kicks : int
        How often the best order is disturbed and improved again.
    start : list of int, optional
        An order of the places to begin with. Default: always on to the nearest place.

    Returns
    -------
    list of int
        Places 1 to n.
    """
    n = len(costs) - 1
    finite = np.where(np.isfinite(costs), costs, 1e9)
    order = _improved(finite, _nearest_first(finite) if start is None else start)
    best = _length(finite, order)
    rng = np.random.default_rng(n)
    for _ in range(kicks):
        candidate = _improved(finite, _disturbed(order, rng))
        length = _length(finite, candidate)
        if length < best - _LEAST_S:
            best = length
            order = candidate
    return order if order[0] < order[-1] else order[::-1]


def quick_length(costs: np.ndarray) -> float:
    """Return about the length of the shortest round: of one that no reversal shortens, s.

    Parameters
    ----------
    costs : array (n + 1, n + 1, b, b)
        Seconds.
    """
    finite = np.where(np.isfinite(costs), costs, 1e9)
    order = _improved(finite, _nearest_first(finite), longest_piece=0)
    return _length(finite, order)


def _nearest_first(costs: np.ndarray) -> list[int]:
    """Go to the nearest place that is left, in its nearest branch."""
    here = 0
    branch = 0
    left = list(range(1, len(costs)))
    order = []
    while left:
        options = costs[here, left, branch]
        nearest, branch = divmod(int(options.argmin()), options.shape[1])
        here = left.pop(nearest)
        order.append(here)
    return order


def _disturbed(order: list[int], rng: np.random.Generator) -> list[int]:
    """Exchange two pieces in the middle, which no reversal undoes (a double bridge)."""
    first, second, third = sorted(rng.choice(np.arange(1, len(order)), 3, replace=False).tolist())
    return order[:first] + order[second:third] + order[first:second] + order[third:]


def _length(costs: np.ndarray, order: list[int]) -> float:
    length = costs[0, order[0], 0]
    for i, j in itertools.pairwise(order):
        length = (length[:, None] + costs[i, j]).min(axis=0)
    return float((length + costs[order[-1], 0, :, 0]).min())


def _improved(
    costs: np.ndarray, order: list[int], longest_piece: int = _LONGEST_PIECE
) -> list[int]:
    """Improve until no reversal and no relocation of a piece helps."""
    length = _length(costs, order)
    while True:
        candidate = _best_neighbour(costs, order, longest_piece)
        found = _length(costs, candidate)
        if found >= length - _LEAST_S:
            return order
        order = candidate
        length = found


def _best_neighbour(costs: np.ndarray, order: list[int], longest_piece: int) -> list[int]:
    path = np.array([0, *order, 0])
    ways = _Ways(costs, path)
    found = [ways.best_reversal()]
    back = _Ways(costs, path[::-1].copy()) if longest_piece else ways
    for size in range(1, longest_piece + 1):
        found.append(ways.best_relocation(size))
        length, path_back = back.best_relocation(size)
        found.append((length, path_back[::-1]))
    _, path = min(found, key=lambda one: one[0])
    return [int(place) for place in path[1:-1]]


class _Ways:
    """The shortest ways between all places of a path, home at both ends.

    Attributes
    ----------
    path : array (m,)
        Places; the first and the last are home.
    leg : array (m, m, b, b)
        Time of the direct move between two positions of the path.
    way : array (m, m, b, b)
        Time along the path from one position to a later one.
    """

    def __init__(self, costs: np.ndarray, path: np.ndarray):
        m = len(path)
        b = costs.shape[2]
        self.path = path
        self.leg = costs[path[:, None], path[None, :]]
        self.way = np.full((m, m, b, b), np.inf)
        places = np.arange(m)
        self.way[places, places] = np.where(np.eye(b, dtype=bool), 0.0, np.inf)
        for gap in range(1, m):
            first = np.arange(m - gap)
            legs = self.leg[first + gap - 1, first + gap]
            self.way[first, first + gap] = _chained(self.way[first, first + gap - 1], legs)

    def best_reversal(self) -> tuple[float, np.ndarray]:
        """Return length and path of the best reversal of a piece."""
        m = len(self.path)
        first, last = np.triu_indices(m - 2, 1)
        first = first + 1
        last = last + 1
        start = _onward(self.way[0, first - 1, 0], self.leg[first - 1, last])
        start = _onward(start, self.way[first, last].transpose(0, 2, 1))
        start = _onward(start, self.leg[first, last + 1])
        lengths = (start + self.way[last + 1, m - 1, :, 0]).min(axis=-1)
        k = int(lengths.argmin())
        i = int(first[k])
        j = int(last[k]) + 1
        path = np.concatenate([self.path[:i], self.path[i:j][::-1], self.path[j:]])
        return float(lengths[k]), path

    def best_relocation(self, size: int) -> tuple[float, np.ndarray]:
        """Return length and path of the best move of a piece of so many places to a later position."""
        m = len(self.path)
        first, target = np.nonzero(np.tri(m, m, -size, dtype=bool).T)
        inside = (first >= 1) & (target <= m - 2)
        first = first[inside]
        target = target[inside]
        if len(first) == 0:
            return np.inf, self.path
        last = first + size - 1
        # the way to `target` without the piece
        start = _onward(self.way[0, first - 1, 0], self.leg[first - 1, last + 1])
        start = _onward(start, self.way[last + 1, target])
        home = self.way[target + 1, m - 1, :, 0]
        found = []
        for entry, leaving in ((first, last), (last, first)):
            piece = self.way[first, last]
            if entry is last:
                piece = piece.transpose(0, 2, 1)
            end = _onward(_onward(start, self.leg[target, entry]), piece)
            end = _onward(end, self.leg[leaving, target + 1])
            lengths = (end + home).min(axis=-1)
            k = int(lengths.argmin())
            found.append((float(lengths[k]), k, entry is last))
            if size == 1:
                break
        length, k, reverse = min(found)
        i = int(first[k])
        stop = i + size
        after = int(target[k]) + 1
        piece_path = self.path[i:stop]
        moved = piece_path[::-1] if reverse else piece_path
        path = np.concatenate([self.path[:i], self.path[stop:after], moved, self.path[after:]])
        return length, path


def _chained(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return the shortest ways (n, b, b) by any branch in the middle."""
    found = first[:, :, 0, None] + second[:, 0, None, :]
    for middle in range(1, first.shape[2]):
        np.minimum(found, first[:, :, middle, None] + second[:, middle, None, :], out=found)
    return found


def _onward(length: np.ndarray, legs: np.ndarray) -> np.ndarray:
    """Return the shortest ways (n, b) to the end of legs (n, b, b)."""
    found = length[..., 0, None] + legs[:, 0]
    for branch in range(1, legs.shape[1]):
        np.minimum(found, length[..., branch, None] + legs[:, branch], out=found)
    return found
