"""The shortest round through all settings: their order, and the branch of each, chosen together.

The round begins and ends at home. Costs are an array (n + 1, n + 1, b, b): entry [i, j, a, c] is the
time from place i in branch a to place j in branch c. Place 0 is home, which has branch 0 only; inf
stands for branches that a place does not have. Times are symmetric: [i, j, a, c] = [j, i, c, a].
Only sums and comparisons decide, so every processor finds the same round.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

# How long a straight joint move takes: all joints start, accelerate and stop together.
#
# A straight line from p to q is one number s from 0 to 1, with joints p + s (q - p). With speeds
# v and accelerations a of the joints, s may change at V = min v / abs(q - p) per second and A =
# min a / abs(q - p) per second squared. From rest to rest it takes 1 / V + V / A if the speed V
# is reached, 2 sqrt(1 / A) otherwise: a trapezoid or a triangle of speed.


class JointRates(NamedTuple):
    """How fast the joints may turn.

    Attributes
    ----------
    speeds : array (k,)
        Largest speed of each joint, rad/s.
    accelerations : array (k,)
        Largest acceleration of each joint, rad/s².
    """

    speeds: np.ndarray
    accelerations: np.ndarray

    def scaled(self, share: float) -> JointRates:
        """Return the rates with a share of the speeds; accelerations stay."""
        return JointRates(self.speeds * share, self.accelerations)


def move_times(starts: np.ndarray, ends: np.ndarray, rates: JointRates) -> np.ndarray:
    """Return how long straight joint moves take, from rest to rest.

    Parameters
    ----------
    starts, ends : array (..., k)
        Joints, rad; the shapes are broadcast.
    rates : JointRates
        Of the robot.

    Returns
    -------
    array (...)
        Seconds.
    """
    distances = np.abs(np.asarray(ends) - np.asarray(starts))
    # seconds at full speed, and seconds squared at full acceleration, of the joint that limits
    cruise = (distances / rates.speeds).max(axis=-1)
    square = (distances / rates.accelerations).max(axis=-1)
    # the speed is reached where 1 / V >= V / A
    reached = cruise * cruise >= square
    at_speed = cruise + np.divide(square, cruise, out=np.zeros_like(square), where=cruise > 0)
    return np.where(reached, at_speed, 2.0 * np.sqrt(square))


class LeadingAxis(NamedTuple):
    """Speed and acceleration of the joint that turns farthest in a move.

    Attributes
    ----------
    speed : float
        rad/s.
    acceleration : float
        rad/s².
    """

    speed: float
    acceleration: float


def leading_axis(start: np.ndarray, end: np.ndarray, rates: JointRates) -> LeadingAxis:
    """Return the rates that a controller must give the joint that turns farthest; the others follow.

    Parameters
    ----------
    start, end : array (k,)
        Joints, rad.
    rates : JointRates
        Of the robot.

    Returns
    -------
    LeadingAxis
        A move at these rates takes as long as `move_times` says.
    """
    distances = np.abs(np.asarray(end) - np.asarray(start))
    largest = float(distances.max())
    if largest == 0.0:
        return LeadingAxis(float(rates.speeds.min()), float(rates.accelerations.min()))
    cruise = float((distances / rates.speeds).max())
    square = float((distances / rates.accelerations).max())
    return LeadingAxis(largest / cruise, largest / square)


class Profile(NamedTuple):
    """A straight joint move in time: between its instants the acceleration is constant.

    Attributes
    ----------
    seconds : array (m,)
        Instants from 0; three for a triangle of speed, four for a trapezoid.
    shares : array (m,)
        Share of the way that is driven.
    rates : array (m,)
        How fast this share grows, 1/s; 0 at both ends.
    """

    seconds: np.ndarray
    shares: np.ndarray
    rates: np.ndarray


def profile(start: np.ndarray, end: np.ndarray, rates: JointRates) -> Profile:
    """Return how a straight joint move runs from rest to rest.

    Parameters
    ----------
    start, end : array (k,)
        Joints, rad; they differ.
    rates : JointRates
        Of the robot.

    Returns
    -------
    Profile
        It ends after the time that `move_times` says.
    """
    distances = np.abs(np.asarray(end) - np.asarray(start))
    cruise = float((distances / rates.speeds).max())
    square = float((distances / rates.accelerations).max())
    total = float(move_times(start, end, rates))
    if cruise * cruise < square:
        peak = 2.0 / total
        return Profile(
            np.array([0.0, total / 2, total]), np.array([0.0, 0.5, 1.0]), np.array([0.0, peak, 0.0])
        )
    rising = square / cruise
    driven = rising / cruise / 2
    return Profile(
        np.array([0.0, rising, total - rising, total]),
        np.array([0.0, driven, 1.0 - driven, 1.0]),
        np.array([0.0, 1.0 / cruise, 1.0 / cruise, 0.0]),
    )


# Local search for long rounds: reversals and relocations, each judged with branches chosen anew.
#
# For the present order, ``way[i, j]`` (b, b) holds the shortest way from the i-th to the j-th
# place by branches at both ends. Any reversal or relocation is then a chain of at most six such
# matrices, so that all of them are judged together with sums and minima of arrays.


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
        Seconds, as for `planner.robotprogram.tour.shortest_tour`.
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


EXACT_UP_TO = 10
"""Up to this many settings the round is the shortest of all."""


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
    # between settings: from (place, branch) to (place, branch)
    between = costs[1:, 1:].transpose(0, 2, 1, 3).reshape(n * b, n, b)
    # best[s, (i, a)]: shortest way from home through the subset s that ends in place i, branch a
    best = np.full((1 << n, n * b), np.inf)
    before = np.full((1 << n, n, b), -1)
    for i in range(n):
        best[1 << i, i * b : (i + 1) * b] = costs[0, i + 1, 0]
    for subset in range(1, 1 << n):
        outside = np.flatnonzero(~(subset >> np.arange(n)) & 1)
        if outside.size == 0:
            continue
        via = best[subset][:, None, None] + between[:, outside]
        last = via.argmin(axis=0)
        length = np.take_along_axis(via, last[None], axis=0)[0]
        for place, seconds, origin in zip(outside, length, last, strict=True):
            grown = subset | (1 << int(place))
            part = best[grown, place * b : (place + 1) * b]
            shorter = seconds < part
            part[shorter] = seconds[shorter]
            before[grown, place, shorter] = origin[shorter]
    end = int((best[-1] + costs[1:, 0, :, 0].reshape(-1)).argmin())
    return _followed_back(before, end, n, b)


def _followed_back(before: np.ndarray, end: int, n: int, b: int) -> list[int]:
    """Return the places on the way that ends in (place, branch) number ``end``."""
    subset = (1 << n) - 1
    order = []
    while end >= 0:
        place, branch = divmod(end, b)
        order.append(place + 1)
        origin = int(before[subset, place, branch])
        subset &= ~(1 << place)
        end = origin
    if len(order) < n:
        # a setting is out of reach: any order will do
        return list(range(1, n + 1))
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


# Which of many branches a round chooses from: on a turntable a setting may have two hundred.


_MOST = 24
_MOST_IN_LONG_ROUNDS = 12


def few_branches(
    branches: Sequence[np.ndarray], home: np.ndarray, rates: JointRates
) -> list[np.ndarray]:
    """Return at most 24 branches of each setting, in rounds of more than 10 settings at most 12.

    The angles that serve most settings come first, one after the other until each setting has one,
    and then the branches that are near home; they stay in their order. So a round can do with few turns of the table.

    Parameters
    ----------
    branches : sequence of array (b, k)
        Of each setting; the last number is the angle of the turntable.
    home : array (k,)
        Joints at which the round begins and ends, rad.
    rates : JointRates
        Of all of them.
    """
    preferred = common_angles([set(group[:, -1].tolist()) for group in branches])
    most = _MOST if len(branches) <= EXACT_UP_TO else _MOST_IN_LONG_ROUNDS
    result = []
    for group in branches:
        places = [preferred.index(a) if a in preferred else len(preferred) for a in group[:, -1]]
        seconds = np.round(move_times(group, home[None], rates), 6)
        order = np.lexsort((seconds, np.array(places, dtype=int)))
        result.append(group[np.sort(order[:most])])
    return result


def common_angles(options: Sequence[set[float]]) -> list[float]:
    """Return angles of which each setting has one, greedily those that serve most; the nearest to 0 of equal ones.

    Parameters
    ----------
    options : sequence of set of float
        The angles of each setting, rad; settings without one are left out.
    """
    left = [angles for angles in options if angles]
    chosen: list[float] = []
    while left:
        every = sorted(set().union(*left), key=lambda angle: (abs(angle), -angle))
        best = max(every, key=lambda angle: sum(angle in angles for angles in left))
        chosen.append(best)
        left = [angles for angles in left if best not in angles]
    return chosen
