"""The order in which places are visited: the shortest round from home, or the shortest open path.

The round begins and ends at home. Costs are an array (n + 1, n + 1, b, b): entry [i, j, a, c] is the
time from place i in branch a to place j in branch c. Place 0 is home, which has branch 0 only; inf
stands for branches that a place does not have. Times are symmetric: [i, j, a, c] = [j, i, c, a].
An open path is a round whose home is as near as can be to every place.
Only sums and comparisons decide, so every processor finds the same round.

The distance between two poses is ``|translation| + radian_mm * |rotation angle|``, a metric on rigid motions: a turn of
one radian counts as much as ``radian_mm`` of travel.
"""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from ground.decorators import njit
from planner.argument_kinds import suggests_names
from planner.exceptions import RequestError

RADIAN_MM = 200.0
EXACT_UP_TO = 10
"""Up to this many settings a round is the shortest of all."""

# an open path has one branch a place, so its exact solution goes farther
_EXACT_PATH_UP_TO = 12

KICKS = 24
"""How often the best round is disturbed and improved again."""

_LONGEST_PIECE = 3
# an improvement must be more than rounding, s
_LEAST_S = 1e-9


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

    Raises
    ------
    RequestError
        If the poses have another shape.
    """
    poses = np.asarray(cam2worlds, dtype=float)
    if poses.size and (poses.ndim not in {2, 3} or poses.shape[-2:] != (4, 4)):
        raise RequestError.of_rule("cam2worlds", "must have the shape (n, 4, 4)", str(poses.shape))
    poses = poses.reshape(-1, 4, 4)
    if len(poses) == 0:
        return np.zeros((0, 0))
    moves = np.linalg.norm(poses[:, None, :3, 3] - poses[None, :, :3, 3], axis=-1)
    relative = np.einsum("aji,bjk->abik", poses[:, :3, :3], poses[:, :3, :3])
    turns = Rotation.from_matrix(relative.reshape(-1, 3, 3)).magnitude().reshape(moves.shape)
    distances = moves + radian_mm * turns
    np.fill_diagonal(distances, 0.0)
    return np.minimum(distances, distances.T)


@suggests_names
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

    Raises
    ------
    RequestError
        If the poses have another shape.

    Examples
    --------
    >>> from planner import look_at, travel_order
    >>> poses = look_at([[0, 0, 100], [300, 0, 100], [100, 0, 100], [200, 0, 100]], [0, 0, 0])
    >>> travel_order(poses)
    (0, 2, 3, 1)
    """
    return order_by(pose_distances(cam2worlds, radian_mm))


def order_by(distances: np.ndarray, kicks: int = KICKS) -> tuple[int, ...]:
    """Return `travel_order` for distances (n, n); beyond 12 poses, the path is disturbed so many times."""
    n = len(distances)
    if n < 3:
        return tuple(range(n))
    costs = np.zeros((n + 1, n + 1, 1, 1))
    costs[1:, 1:, 0, 0] = distances
    order = exact_order(costs) if n <= _EXACT_PATH_UP_TO else improved_order(costs, kicks)
    return tuple(place - 1 for place in order)


class Tour(NamedTuple):
    """A round through all settings.

    Attributes
    ----------
    order : tuple of int
        The settings, from 0, in the order of the visits.
    branches : tuple of int
        The branch in each of them, in the same order.
    seconds : float
        Time of all moves, from home to home.
    """

    order: tuple[int, ...]
    branches: tuple[int, ...]
    seconds: float


def shortest_tour(costs: np.ndarray, kicks: int = KICKS, start: list[int] | None = None) -> Tour:
    """Find a short round.

    **Guarantee.** Up to 10 settings it is the shortest over all orders and branches. Beyond, no
    reversal and no relocation of up to three settings, with branches chosen anew, shortens it.

    Parameters
    ----------
    costs : array (n + 1, n + 1, b, b)
        Seconds, see the module.
    kicks : int
        Beyond 10 settings, how often the best round is disturbed and improved again.
    start : list of int, optional
        Beyond 10 settings, an order of places 1 to n to begin with.

    Returns
    -------
    Tour
        Of all settings; its seconds are inf if a setting cannot be reached.
    """
    n = len(costs) - 1
    if n == 0:
        return Tour((), (), 0.0)
    order = exact_order(costs) if n <= EXACT_UP_TO else improved_order(costs, kicks, start)
    return best_branches(costs, order)


def exact_order(costs: np.ndarray) -> list[int]:
    """Return the order of the shortest round by dynamic programming (Held and Karp 1962).

    Parameters
    ----------
    costs : array (n + 1, n + 1, b, b)
        Seconds.

    Returns
    -------
    list of int
        Places 1 to n. Of two directions it is the one that begins with the smaller number.
    """
    n = len(costs) - 1
    b = costs.shape[2]
    # into a place and branch: from every (place, branch), which stands last to be contiguous
    into = costs[1:, 1:].transpose(1, 3, 0, 2).reshape(n, b, n * b).copy()
    # best[s, (i, a)]: shortest way from home through the subset s that ends in place i, branch a
    best = np.full((1 << n, n * b), np.inf)
    for i in range(n):
        best[1 << i, i * b : (i + 1) * b] = costs[0, i + 1, 0]
    subsets = np.arange(1 << n)
    sizes = ((subsets[:, None] >> np.arange(n)) & 1).sum(axis=1)
    # a way through a subset has only one way without its last place, so all of one size are independent
    for size in range(1, n):
        layer = subsets[sizes == size]
        for i in range(n):
            without = layer[(layer >> i) & 1 == 0]
            ways = best[without, None] + into[i]
            best[without | (1 << i), i * b : (i + 1) * b] = ways.min(axis=-1)
    end = int((best[-1] + costs[1:, 0, :, 0].reshape(-1)).argmin())
    if np.isinf(best[-1, end]):
        # a setting is out of reach: any order will do
        return list(range(1, n + 1))
    return _followed_back(best, into, end)


def _followed_back(best: np.ndarray, into: np.ndarray, end: int) -> list[int]:
    """Return the places on the way that ends in (place, branch) number ``end``."""
    n, b, _ = into.shape
    subset = (1 << n) - 1
    order = []
    while subset:
        place, branch = divmod(end, b)
        order.append(place + 1)
        subset &= ~(1 << place)
        end = int((best[subset] + into[place, branch]).argmin())
    return order if order[0] < order[-1] else order[::-1]


def best_branches(costs: np.ndarray, order: list[int]) -> Tour:
    """Choose the branch of each place for a given order, by dynamic programming.

    Parameters
    ----------
    costs : array (n + 1, n + 1, b, b)
        Seconds.
    order : list of int
        Places 1 to n.

    Returns
    -------
    Tour
        The shortest with this order.
    """
    length = costs[0, order[0], 0]
    origins = []
    for i, j in itertools.pairwise(order):
        via = length[:, None] + costs[i, j]
        origins.append(via.argmin(axis=0))
        length = via.min(axis=0)
    home = length + costs[order[-1], 0, :, 0]
    branches = [int(home.argmin())]
    for origin in reversed(origins):
        branches.append(int(origin[branches[-1]]))
    settings = tuple(place - 1 for place in order)
    return Tour(settings, tuple(branches[::-1]), float(home.min()))


# Local search for long rounds: reversals and relocations, each judged with branches chosen anew.
#
# For the present order, ``ways[i, j]`` (b, b) holds the shortest way from the i-th to the j-th
# place by branches at both ends. Any reversal or relocation is then a chain of at most six such
# matrices. Compiled: a long round is improved hundreds of times while its moves are checked.


def improved_order(
    costs: np.ndarray, kicks: int = KICKS, start: list[int] | None = None
) -> list[int]:
    """Return a short order that no reversal or relocation shortens.

    Parameters
    ----------
    costs : array (n + 1, n + 1, b, b)
        Seconds, as for `shortest_tour`.
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
    unvisited = list(range(1, len(costs)))
    order = []
    while unvisited:
        options = costs[here, unvisited, branch]
        nearest, branch = divmod(int(options.argmin()), options.shape[1])
        here = unvisited.pop(nearest)
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
        candidate_length = _length(costs, candidate)
        if candidate_length >= length - _LEAST_S:
            return order
        order = candidate
        length = candidate_length


def _best_neighbour(costs: np.ndarray, order: list[int], longest_piece: int) -> list[int]:
    path = np.array([0, *order, 0])
    legs = np.ascontiguousarray(costs[path[:, None], path[None, :]])
    neighbours = [(_best_reversal(legs, _ways(legs)), path)]
    if longest_piece:
        # a piece moves to a later position; to an earlier one on the way back
        for direction in (path, path[::-1]):
            legs = np.ascontiguousarray(costs[direction[:, None], direction[None, :]])
            neighbours.append((_best_relocation(legs, _ways(legs), longest_piece), direction))
    (_, first, size, target, is_turned), path = min(neighbours, key=lambda one: one[0][0])
    piece = path[first : first + size]
    others = np.delete(path, np.arange(first, first + size))
    moved = np.insert(others, target, piece[::-1] if is_turned else piece)
    return [int(place) for place in moved[1:-1]]


@njit(error_model="numpy")
def _ways(legs: np.ndarray) -> np.ndarray:
    """Return the times (m, m, b, b) along a path from one position to a later one, by branches at both ends.

    ``legs`` (m, m, b, b) are the times of the direct moves between two positions.
    """
    m = legs.shape[0]
    b = legs.shape[2]
    ways = np.full((m, m, b, b), np.inf)
    for first in range(m):
        for a in range(b):
            ways[first, first, a, a] = 0.0
        for last in range(first + 1, m):
            for a in range(b):
                for c in range(b):
                    shortest = np.inf
                    for via in range(b):
                        length = ways[first, last - 1, a, via] + legs[last - 1, last, via, c]
                        shortest = min(shortest, length)
                    ways[first, last, a, c] = shortest
    return ways


@njit(error_model="numpy")
def _go_on(lengths: np.ndarray, steps: np.ndarray, onward: np.ndarray) -> None:
    """Write the shortest ways (b,) to the end of moves (b, b) that go on from ways (b,)."""
    b = len(lengths)
    for end in range(b):
        shortest = np.inf
        for via in range(b):
            shortest = min(shortest, lengths[via] + steps[via, end])
        onward[end] = shortest


@njit(error_model="numpy")
def _best_reversal(legs: np.ndarray, ways: np.ndarray) -> tuple[float, int, int, int, bool]:
    """Return the best reversal of a piece: length of the path, where it begins, its size, where it goes, True."""
    m = legs.shape[0]
    here = np.empty(legs.shape[2])
    there = np.empty(legs.shape[2])
    best = (np.inf, 1, 2, 1, True)
    for first in range(1, m - 2):
        for last in range(first + 1, m - 1):
            _go_on(ways[0, first - 1, 0], legs[first - 1, last], here)
            _go_on(here, ways[first, last].T, there)
            _go_on(there, legs[first, last + 1], here)
            length = (here + ways[last + 1, m - 1, :, 0]).min()
            if length < best[0]:
                best = (length, first, last + 1 - first, first, True)
    return best


@njit(error_model="numpy")
def _best_relocation(
    legs: np.ndarray, ways: np.ndarray, longest_piece: int
) -> tuple[float, int, int, int, bool]:
    """Return the best move of a piece to a later position: as `_best_reversal`, and whether it is turned round."""
    m = legs.shape[0]
    here = np.empty(legs.shape[2])
    there = np.empty(legs.shape[2])
    without = np.empty(legs.shape[2])
    best = (np.inf, 1, 1, 1, False)
    for size in range(1, longest_piece + 1):
        for first in range(1, m - 1 - size):
            last = first + size - 1
            _go_on(ways[0, first - 1, 0], legs[first - 1, last + 1], here)
            for target in range(last + 1, m - 1):
                _go_on(here, ways[last + 1, target], without)
                for is_turned in range(1 if size == 1 else 2):
                    entry = last if is_turned else first
                    leaving = first if is_turned else last
                    piece = ways[first, last].T if is_turned else ways[first, last]
                    _go_on(without, legs[target, entry], there)
                    length = np.inf
                    for end in range(len(here)):
                        shortest = np.inf
                        for via in range(len(here)):
                            shortest = min(shortest, there[via] + piece[via, end])
                        for home in range(len(here)):
                            onward = shortest + legs[leaving, target + 1, end, home]
                            length = min(length, onward + ways[target + 1, m - 1, home, 0])
                    if length < best[0]:
                        best = (length, first, size, target + 1 - size, is_turned == 1)
    return best
