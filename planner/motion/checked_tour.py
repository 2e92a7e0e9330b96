"""The shortest round whose moves are all proven free: checked only where the round goes.

Times begin as those of straight moves. The moves of the shortest round are checked, and a blocked
one counts as longer by about the mean of the ways around that are known. Where the shortest round still
needs it, a way around is sought, and its own time counts. This ends when the round holds moves only
that are proven free.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from planner.motion.detour import Detours
from planner.motion.move_time import JointRates, move_times
from planner.motion.program_record import Move
from planner.motion.tour import EXACT_UP_TO, Tour, shortest_tour
from planner.motion.tour_search import KICKS

# of a move without a way
_BLOCKED_S = 1e6
# how much longer a way around takes than the straight move, before one is known
_LONGER = 1.25
# how often a round is disturbed when all of its moves are known
_KICKS_AGAIN = 2
# place and branch
_End = tuple[int, int]
_HOME: _End = (0, 0)
# an end that no way leads to is cut off after so many failures
_FAILURES = 2
_FAILURES_OF_HOME = 6
# place and branch at both ends of a move
_Leg = tuple[int, int, int, int]


class CheckedTour(NamedTuple):
    """A round of moves that are proven free.

    Attributes
    ----------
    order : tuple of int
        The settings, from 0, in the order of the visits.
    branches : tuple of int
        The branch in each of them.
    moves : tuple of Move
        From home to the first, from each to the next, and back.
    dropped : tuple of int
        Settings that no free way was found to.
    """

    order: tuple[int, ...]
    branches: tuple[int, ...]
    moves: tuple[Move, ...]
    dropped: tuple[int, ...]


def straight_costs(
    home: np.ndarray, branches: Sequence[np.ndarray], rates: JointRates
) -> np.ndarray:
    """Return the times of straight moves between all branches, as `shortest_tour` takes them.

    Parameters
    ----------
    home : array (k,)
        Joints, rad.
    branches : sequence of array (b, k)
        The branches of each setting, at least one.
    rates : JointRates
        Of the robot.

    Returns
    -------
    array (n + 1, n + 1, b, b)
        Seconds; inf for branches that a setting does not have.
    """
    n = len(branches) + 1
    most = max((len(group) for group in branches), default=1)
    joints = np.full((n, most, len(home)), np.nan)
    joints[0, 0] = home
    for place, group in enumerate(branches, 1):
        joints[place, : len(group)] = group
    known = ~np.isnan(joints[..., 0])
    usable = known[:, None, :, None] & known[None, :, None, :]
    filled = np.where(np.isnan(joints), 0.0, joints)
    times = move_times(filled[:, None, :, None], filled[None, :, None, :], rates)
    return np.where(usable, times, np.inf)


class TourChecker:
    """Finds the round through settings in one fixturing.

    Parameters
    ----------
    detours : Detours
        Checks moves, and finds ways around.
    home : array (k,)
        Joints at which the round begins and ends, rad.
    branches : sequence of array (b, k)
        The branches of each setting, at least one.
    penalties : array (n, b)
        Seconds by which a branch must be quicker than another one to be preferred.
    seed : int
        Of the ways around.
    """

    def __init__(
        self,
        detours: Detours,
        home: np.ndarray,
        branches: Sequence[np.ndarray],
        penalties: np.ndarray,
        seed: int = 0,
    ):
        self._detours = detours
        self._joints = [home[None], *branches]
        self._costs = straight_costs(home, branches, detours.rates)
        self._penalties = np.zeros(self._costs.shape[1:3])
        self._penalties[1:] = penalties / 2
        self._moves: dict[_Leg, Move | None] = {}
        # seconds of straight moves that are blocked, whose ways around are not known
        self._blocked: dict[_Leg, float] = {}
        self._longer: list[float] = []
        self._linked: set[_End] = set()
        self._failures: Counter[_End] = Counter()
        self._left = list(range(len(branches)))
        self._order: list[int] | None = None
        self._seed = seed

    def run(self) -> CheckedTour:
        """Return the round; settings without a free way are dropped one by one."""
        kicks = KICKS
        while self._left:
            tour = self._tour(kicks)
            legs = self._legs(tour)
            unchecked = [leg for leg in legs if leg not in self._moves]
            for leg in unchecked:
                self._check(leg)
            if unchecked:
                kicks = 0
                continue
            blocked = [leg for leg in legs if self._moves[leg] is None]
            if not blocked and kicks == 0 and len(self._left) > EXACT_UP_TO:
                # only a round that is known as a whole is worth disturbing again
                kicks = _KICKS_AGAIN
                continue
            if not blocked:
                order = tuple(self._left[k] for k in tour.order)
                return CheckedTour(order, tour.branches, self._driven(legs), self._dropped)
            self._left.remove(self._worst(blocked))
        return CheckedTour((), (), (), self._dropped)

    @property
    def _dropped(self) -> tuple[int, ...]:
        return tuple(k for k in range(len(self._joints) - 1) if k not in self._left)

    def _tour(self, kicks: int) -> Tour:
        """Return the shortest round through the settings that are left, by the times known."""
        places = [0, *(k + 1 for k in self._left)]
        chosen = np.ix_(places, places)
        penalties = self._penalties[places]
        extra = penalties[:, None, :, None] + penalties[None, :, None, :]
        costs = self._costs[chosen] + extra
        if self._order is None:
            tour = shortest_tour(costs)
        else:
            # a few times have changed since
            start = [self._left.index(k) + 1 for k in self._order if k in self._left]
            tour = shortest_tour(costs, kicks, start)
        self._order = [self._left[k] for k in tour.order]
        return tour

    def _legs(self, tour: Tour) -> list[_Leg]:
        places = [(0, 0)]
        places += [
            (self._left[k] + 1, branch) for k, branch in zip(tour.order, tour.branches, strict=True)
        ]
        places.append((0, 0))
        return [(*first, *last) for first, last in pairwise(places)]

    def _check(self, leg: _Leg) -> None:
        """Check the straight move of a leg; if it is known to be blocked, seek a way around."""
        first, branch, last, branch_there = leg
        if first > last:
            # both directions are one way
            self._check((last, branch_there, first, branch))
            return
        start = self._joints[first][branch]
        end = self._joints[last][branch_there]
        if leg in self._blocked:
            self._go_around(leg, start, end)
            return
        straight = np.array([start, end])
        seconds = self._detours.seconds(straight)
        if self._detours.is_free(start, end):
            self._settle(leg, straight, seconds)
        else:
            self._blocked[leg] = seconds
            self._set_cost(leg, self._estimate * seconds)

    def _go_around(self, leg: _Leg, start: np.ndarray, end: np.ndarray) -> None:
        """Seek a way around for a blocked leg, and learn from it how much longer others may be."""
        straight = self._blocked.pop(leg)
        way = self._detours.find(start, end, [self._seed, *leg])
        if way is None:
            self._settle(leg, None, _BLOCKED_S)
            self._count_failure(leg[:2], leg[2:])
            self._count_failure(leg[2:], leg[:2])
            return
        seconds = self._detours.seconds(way)
        self._settle(leg, way, seconds)
        self._longer.append(seconds / straight)
        for other, alone in self._blocked.items():
            self._set_cost(other, self._estimate * alone)

    def _count_failure(self, end: _End, other: _End) -> None:
        """Cut off an end that no way leads to from ends that others do lead to."""
        if end in self._linked:
            return
        if end != _HOME and other != _HOME and other not in self._linked:
            return
        self._failures[end] += 1
        if self._failures[end] < (_FAILURES_OF_HOME if end == _HOME else _FAILURES):
            return
        branches = [(i, a) for i, group in enumerate(self._joints) for a in range(len(group))]
        for there in branches:
            leg = (*min(end, there), *max(end, there))
            if leg not in self._moves and there[0] != end[0]:
                self._blocked.pop(leg, None)
                self._settle(leg, None, _BLOCKED_S)

    @property
    def _estimate(self) -> float:
        # the first guess counts once, since a single long way around says little of others
        return (_LONGER + sum(self._longer)) / (1 + len(self._longer))

    def _settle(self, leg: _Leg, way: np.ndarray | None, seconds: float) -> None:
        """Keep the way of a leg, and the same way back."""
        first, branch, last, branch_there = leg
        back = (last, branch_there, first, branch)
        if way is not None:
            self._linked |= {(first, branch), (last, branch_there)}
        self._moves[leg] = None if way is None else Move(way, seconds)
        self._moves[back] = None if way is None else Move(way[::-1], seconds)
        self._set_cost(leg, seconds)

    def _set_cost(self, leg: _Leg, seconds: float) -> None:
        first, branch, last, branch_there = leg
        self._costs[first, last, branch, branch_there] = seconds
        self._costs[last, first, branch_there, branch] = seconds

    def _worst(self, blocked: list[_Leg]) -> int:
        """Return the setting at most blocked moves; of several the last one."""
        ends = [place for leg in blocked for place in (leg[0], leg[2]) if place > 0]
        return max(set(ends), key=lambda place: (ends.count(place), place)) - 1

    def _driven(self, legs: list[_Leg]) -> tuple[Move, ...]:
        return tuple(move for leg in legs if (move := self._moves[leg]) is not None)
