"""The shortest round through all settings: their order, and the branch of each, chosen together.

The round begins and ends at home. Costs are an array (n + 1, n + 1, b, b): entry [i, j, a, c] is the
time from place i in branch a to place j in branch c. Place 0 is home, which has branch 0 only; inf
stands for branches that a place does not have. Times are symmetric: [i, j, a, c] = [j, i, c, a].
Only sums and comparisons decide, so every processor finds the same round.
"""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np

from planner.motion.tour_search import KICKS, improved_order

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
