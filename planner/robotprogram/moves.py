"""The shortest round whose moves are all proven free: checked only where the round goes.

Times begin as those of straight moves. The moves of the shortest round are checked, and a blocked
one counts as longer by about the mean of the ways around that are known. Where the shortest round still
needs it, a way around is sought, and its own time counts. This ends when the round holds moves only
that are proven free.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from planner.robotprogram.program import JointRates, Move, move_times
from planner.travel import EXACT_UP_TO, KICKS, Tour, best_branches, improved_order, shortest_tour

if TYPE_CHECKING:
    from planner.robotcell import Cell

# Straight joint moves that are proven free: conservative advancement.
#
# At any joints of the line, the distances of all bodies prove that a share of the whole move to
# both sides is free too: no body can move far enough to touch another. The middle is asked first,
# and what it leaves open is halved again. Steps would miss thin bodies.


MOST_POSES = 4000
"""A line that needs more poses counts as blocked."""
_LEAST_SHARE = 2e-5
# moves keep this share of the distances that poses keep: near a pose at the limit, none could start
KEPT_SHARE = 0.5
# of an axis that stands at its limit, rad
_ROUNDED = 1e-9


@dataclass(frozen=True)
class FixturedArm:
    """The arm in one fixturing of a cell, as moves are checked in it.

    Attributes
    ----------
    cell : Cell
        With the part.
    fixturing : str
        One of its fixturings.
    """

    cell: Cell
    fixturing: str

    @property
    def lower(self) -> np.ndarray:
        """Least joints (k,), rad."""
        return self.cell.limits(self.fixturing)[0]

    @property
    def upper(self) -> np.ndarray:
        """Largest joints (k,), rad."""
        return self.cell.limits(self.fixturing)[1]

    def free_shares(self, joints: np.ndarray, turn: np.ndarray, reach: np.ndarray) -> np.ndarray:
        """Return which share of a turn (k,) is free to both sides of joints (n, k): at most reach (n,)."""
        shares = self.cell.free_shares(joints, turn, reach, KEPT_SHARE, fixturing=self.fixturing)
        if not self.cell.robot.controller.limits:
            return shares
        return np.minimum(shares, self._within_axes(joints, turn))

    def _within_axes(self, joints: np.ndarray, turn: np.ndarray) -> np.ndarray:
        """Return which share of a turn keeps the controller's axes (n,) within their limits, to both sides."""
        controller = self.cell.robot.controller
        n = len(controller.lower)
        axes = controller.of(joints[:, :n])
        speeds = np.abs(controller.of(turn[:n]))
        margins = np.minimum(axes - controller.lower, controller.upper - axes) + _ROUNDED
        with np.errstate(divide="ignore"):
            shares = np.where(margins < 0, -1.0, margins / speeds)
        return np.asarray(shares.min(axis=1))


class MoveCheck(NamedTuple):
    """Result of a check.

    Attributes
    ----------
    free : bool
        Whether the move is proven to keep the distance.
    poses : int
        Poses whose distances were computed.
    blocked_at : float
        Where it could not be proven, as a share of the move; nan if it is free.
    """

    free: bool
    poses: int
    blocked_at: float = np.nan


def check_move(space: FixturedArm, start: np.ndarray, end: np.ndarray) -> MoveCheck:
    """Prove that a straight joint move is free, or say where that fails.

    Parameters
    ----------
    space : FixturedArm
        The robot and its surroundings.
    start, end : array (k,)
        Joints, rad.

    Returns
    -------
    MoveCheck
        Free only if proven. A line on which less than 0.00002 of it is free around some joints
        counts as blocked.
    """
    turn = np.asarray(end) - np.asarray(start)
    open_parts = np.array([[0.0, 1.0]])
    n_poses = 0
    while len(open_parts):
        middles = (open_parts[:, 0] + open_parts[:, 1]) / 2
        halves = (open_parts[:, 1] - open_parts[:, 0]) / 2
        shares = space.free_shares(start + middles[:, None] * turn, turn, halves)
        n_poses += len(middles)
        blocked = shares < np.minimum(halves, _LEAST_SHARE)
        if blocked.any() or n_poses > MOST_POSES:
            return MoveCheck(False, n_poses, float(middles[int(shares.argmin())]))
        open_parts = _left_open(open_parts, middles, shares)
    return MoveCheck(True, n_poses)


def _left_open(parts: np.ndarray, middles: np.ndarray, shares: np.ndarray) -> np.ndarray:
    """Return what the middles do not prove: up to two parts of each."""
    n = len(parts)
    both = np.empty((2 * n, 2))
    both[:n, 0] = parts[:, 0]
    both[:n, 1] = middles - shares
    both[n:, 0] = middles + shares
    both[n:, 1] = parts[:, 1]
    # what rounding leaves of a part is less than any share that is asked for
    return both[both[:, 1] - both[:, 0] > 1e-12]


def check_path(space: FixturedArm, path: np.ndarray) -> MoveCheck:
    """Check the straight moves between the joints (n, k) of a path, see `check_move`."""
    n_poses = 0
    for start, end in itertools.pairwise(path):
        check = check_move(space, start, end)
        n_poses += check.poses
        if not check.free:
            return MoveCheck(False, n_poses, check.blocked_at)
    return MoveCheck(True, n_poses)


# A way around what blocks a straight joint move: trees that grow towards each other.
#
# RRT-Connect (Kuffner and LaValle, 2000) on trees that are kept from one way to the next, as a
# roadmap (Kavraki, Svestka, Latombe and Overmars, 1996), then shortcuts. Every piece of the result
# is proven free by `check_move`. The same ways sought in the same order are the same.


# a shortcut must save this share of the time
_LEAST_GAIN = 0.02
# joints of earlier ways that a new end is linked to if it can be
_LINKS = 4
# how many times as many trials a move is worth whose setting would be dropped otherwise
_THOROUGH = 12


class DetourEffort(NamedTuple):
    """How long a way around is sought.

    Attributes
    ----------
    trials : int
        Random joints that the trees grow towards.
    step_rad : float
        Longest piece added at a time, over the joints.
    shortcuts : int
        Pieces that a straight move may replace.
    spare : int
        Further trials for all ways together: those that are not found are sought on with them.
    """

    trials: int = 400
    step_rad: float = 0.5
    shortcuts: int = 60
    spare: int = 24_000


class _Roadmap:
    """Joints linked by moves that are proven free, in one or more separate parts.

    Attributes
    ----------
    part : list of int
        Of each place (a row of joints), the number of the part that it belongs to.
    """

    def __init__(self, n_joints: int):
        self._rows = np.empty((64, n_joints))
        self._parts = np.empty(64, dtype=int)
        self._n = 0
        self._links: list[tuple[int, int]] = []

    @property
    def joints(self) -> np.ndarray:
        """All joints (n, k)."""
        return self._rows[: self._n]

    @property
    def parts(self) -> np.ndarray:
        """Number of the part that each place (n,) belongs to."""
        return self._parts[: self._n]

    def place_of(self, joints: np.ndarray) -> int | None:
        """Return the place that has these joints (k,); None if there is none."""
        (same,) = np.nonzero((self.joints == joints).all(axis=1))
        return int(same[0]) if len(same) else None

    def nearest(self, part: int, target: np.ndarray) -> int:
        """Return the place of a part whose joints are nearest to a target (k,)."""
        (places,) = np.nonzero(self.parts == part)
        gaps = np.abs(self.joints[places] - target).max(axis=1)
        return int(places[gaps.argmin()])

    def add(self, joints: np.ndarray, parent: int | None = None) -> int:
        """Add joints (k,) that the move from a parent leads to; without one they are a part of their own."""
        place = self._n
        if place == len(self._rows):
            self._rows = np.concatenate([self._rows, np.empty_like(self._rows)])
            self._parts = np.concatenate([self._parts, np.empty_like(self._parts)])
        self._n += 1
        self._rows[place] = joints
        self._parts[place] = place
        if parent is not None:
            self.link(parent, place)
        return place

    def link(self, first: int, second: int) -> None:
        """Keep that the straight move between two places is free: their parts are one."""
        self._links.append((first, second))
        number = self.parts[first]
        self.parts[self.parts == self.parts[second]] = number

    def way(self, start: int, end: int, rates: JointRates) -> np.ndarray:
        """Return the joints (m, k) of the quickest way between two places of a part."""
        first, second = np.array(self._links).T
        seconds = move_times(self.joints[first], self.joints[second], rates)
        graph = csr_array((seconds, (first, second)), shape=(self._n, self._n))
        before = dijkstra(graph, directed=False, indices=start, return_predecessors=True)[1]
        places = [end]
        while places[-1] != start:
            places.append(int(before[places[-1]]))
        return np.array(self.joints[places[::-1]])


class Detours:
    """Finds ways around obstacles in one space.

    Parameters
    ----------
    space : FixturedArm
        The robot and its surroundings.
    rates : JointRates
        Of its joints; shortcuts save time.
    effort : DetourEffort
        How long to seek.
    """

    def __init__(
        self,
        space: FixturedArm,
        rates: JointRates,
        effort: DetourEffort | None = None,
    ):
        self._space = space
        self.rates = rates
        self._effort = effort or DetourEffort()
        self._spare = self._effort.spare
        self._roadmap = _Roadmap(len(rates.speeds))

    def find(
        self,
        start: np.ndarray,
        end: np.ndarray,
        seed: int | list[int] = 0,
        *,
        thorough: bool = False,
    ) -> np.ndarray | None:
        """Return joints (m, k) from start to end, proven free in between; None if no way is found.

        What earlier ways found to be free is used. As long as spare trials are left, a way is sought as
        thoroughly without being asked.

        Parameters
        ----------
        start, end : array (k,)
            Joints, rad.
        seed : int or list of int
            Of the random joints.
        thorough : bool
            Whether to take twelve times as many trials.
        """
        rng = np.random.default_rng(seed)
        usual = self._effort.trials
        further = usual * (_THOROUGH - 1)
        first = self._entered(np.asarray(start))
        last = self._entered(np.asarray(end))
        if not thorough:
            further = min(further, self._spare)
        used = self._connect(first, last, rng, usual + further)
        if not thorough:
            self._spare -= max(0, used - usual)
        if self._roadmap.parts[first] != self._roadmap.parts[last]:
            return None
        way = _without_repeats(self._roadmap.way(first, last, self.rates))
        way = self._shortened(way, rng)
        self._keep(way, first)
        return way

    def _entered(self, joints: np.ndarray) -> int:
        """Return the place of joints (k,) in the roadmap, linked to near places of its parts."""
        roadmap = self._roadmap
        place = roadmap.place_of(joints)
        if place is not None:
            return place
        gaps = np.abs(roadmap.joints - joints).max(axis=1)
        near = np.argsort(gaps, kind="stable")
        place = roadmap.add(joints)
        checks = 0
        for other in near.tolist():
            if checks == _LINKS:
                break
            if roadmap.parts[other] == roadmap.parts[place]:
                continue
            checks += 1
            if self.is_free(joints, roadmap.joints[other]):
                roadmap.link(other, place)
        return place

    def _keep(self, way: np.ndarray, first: int) -> None:
        """Keep the joints of a way that begins at a place."""
        here = first
        for joints in way[1:]:
            place = self._roadmap.place_of(joints)
            if place is None:
                place = self._roadmap.add(joints, here)
            else:
                self._roadmap.link(here, place)
            here = place

    def is_free(self, start: np.ndarray, end: np.ndarray) -> bool:
        """Return whether the straight move is proven free."""
        return check_move(self._space, start, end).free

    def _connect(self, start: int, end: int, rng: np.random.Generator, trials: int) -> int:
        """Grow the parts of two places until they are one; return how many trials that took."""
        roadmap = self._roadmap
        ends = roadmap.joints[[start, end]]
        # near both ends, and every other pair of times as far as the joints go
        boxes = [
            np.clip(
                [ends.min(axis=0) - around, ends.max(axis=0) + around],
                self._space.lower,
                self._space.upper,
            )
            for around in (np.pi / 2, 2 * np.pi)
        ]
        for trial in range(trials):
            if roadmap.parts[start] == roadmap.parts[end]:
                return trial
            growing, other = (start, end) if trial % 2 else (end, start)
            low, high = boxes[trial // 2 % 2]
            node = self._grown(growing, _drawn(low, high, rng), greedy=False)
            if node is None:
                continue
            target = roadmap.joints[node]
            met = self._grown(other, target, greedy=True)
            if met is not None and np.array_equal(roadmap.joints[met], target):
                roadmap.link(node, met)
        return trials

    def _grown(self, of_place: int, target: np.ndarray, *, greedy: bool) -> int | None:
        """Grow a place's part towards joints by one step, or on as far as it is free; return the last place."""
        roadmap = self._roadmap
        node = roadmap.nearest(roadmap.parts[of_place], target)
        last = None
        while True:
            here = roadmap.joints[node]
            turn = target - here
            length = float(np.abs(turn).max())
            if length == 0.0:
                return node
            arrives = length <= self._effort.step_rad
            there = target if arrives else here + turn * (self._effort.step_rad / length)
            if not self.is_free(here, there):
                return last
            node = roadmap.add(there, node)
            last = node
            if arrives or not greedy:
                return last

    def _shortened(self, way: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Replace pieces between random points of the way by straight moves that are free and quicker."""
        way = self._straightened(way)
        for _ in range(self._effort.shortcuts):
            if len(way) == 2:
                break
            legs = np.sort(rng.choice(len(way) - 1, 2, replace=False))
            first, last = (
                way[leg] + share * (way[leg + 1] - way[leg])
                for leg, share in zip(legs, rng.uniform(0, 1, 2), strict=True)
            )
            shorter = np.concatenate([way[: legs[0] + 1], [first, last], way[legs[1] + 1 :]])
            shorter = _without_repeats(shorter)
            is_worth = self.seconds(shorter) < (1.0 - _LEAST_GAIN) * self.seconds(way)
            if is_worth and self.is_free(first, last):
                way = shorter
        return self._straightened(way)

    def _straightened(self, way: np.ndarray) -> np.ndarray:
        """Leave out joints between which the straight move is free and quicker, many at a time first."""
        size = len(way) - 2
        while size > 0:
            k = 1
            while k + size < len(way):
                shorter = np.delete(way, np.s_[k : k + size], axis=0)
                quicker = self.seconds(shorter) < self.seconds(way)
                if quicker and self.is_free(way[k - 1], way[k + size]):
                    way = shorter
                else:
                    k += (size + 1) // 2
            size = min(size // 2, len(way) - 2)
        return way

    def seconds(self, way: np.ndarray) -> float:
        """Return the time of a way (m, k) with a stop at each of its joints."""
        return float(move_times(way[:-1], way[1:], self.rates).sum())


def _drawn(low: np.ndarray, high: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return random joints (k,); one that cannot turn takes no random number."""
    joints = low.copy()
    turns = high > low
    joints[turns] = rng.uniform(low[turns], high[turns])
    return joints


def _without_repeats(way: np.ndarray) -> np.ndarray:
    changed = np.abs(np.diff(way, axis=0)).max(axis=1) > 0
    return way[np.concatenate([[True], changed])]


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


# settings up to which the shortest round is found anew whenever a time changes
_ALWAYS_EXACT_UP_TO = 5
# moves of a round that are sought with many more trials, before a setting is dropped
_PATIENCE = 3


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


def _ends(leg: _Leg) -> tuple[_End, _End]:
    return leg[:2], leg[2:]


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
    width = max((len(group) for group in branches), default=1)
    joints = np.full((n, width, len(home)), np.nan)
    joints[0, 0] = home
    for place, group in enumerate(branches, 1):
        joints[place, : len(group)] = group
    exists = ~np.isnan(joints[..., 0])
    usable = exists[:, None, :, None] & exists[None, :, None, :]
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
        self._settings = list(range(len(branches)))
        # the shortest round by the costs as they are, until one of them changes
        self._exact: Tour | None = None
        # legs that a way may still be sought for with more trials
        self._patience = _PATIENCE
        self._order: list[int] | None = None
        self._seed = seed

    def run(self) -> CheckedTour:
        """Return the round; settings without a free way are dropped one by one."""
        kicks = KICKS
        while self._settings:
            tour = self._tour(kicks)
            legs = self._legs(tour)
            unchecked = [leg for leg in legs if leg not in self._moves]
            for leg in unchecked:
                self._check(leg)
            if unchecked:
                kicks = 0
                continue
            if kicks == 0:
                # only a round that is known as a whole is worth solving anew
                kicks = _KICKS_AGAIN
                continue
            blocked = [leg for leg in legs if self._moves[leg] is None]
            if not blocked:
                order = tuple(self._settings[k] for k in tour.order)
                return CheckedTour(order, tour.branches, self._driven(legs), self._dropped)
            if self._sought_harder(blocked):
                continue
            self._settings.remove(self._worst(blocked))
            self._exact = None
        return CheckedTour((), (), (), self._dropped)

    @property
    def _dropped(self) -> tuple[int, ...]:
        return tuple(k for k in range(len(self._joints) - 1) if k not in self._settings)

    def _tour(self, kicks: int) -> Tour:
        """Return a short round through the settings that are left, by the times known.

        Without kicks the last round is only improved; with them, up to 10 settings, it is the shortest.
        """
        if self._exact is not None:
            return self._exact
        places = [0, *(k + 1 for k in self._settings)]
        chosen = np.ix_(places, places)
        penalties = self._penalties[places]
        extra = penalties[:, None, :, None] + penalties[None, :, None, :]
        costs = self._costs[chosen] + extra
        is_exact = len(self._settings) <= (EXACT_UP_TO if kicks else _ALWAYS_EXACT_UP_TO)
        if self._order is None or is_exact:
            tour = shortest_tour(costs)
        else:
            # a few times have changed since
            start = [self._settings.index(k) + 1 for k in self._order if k in self._settings]
            tour = best_branches(costs, improved_order(costs, kicks, start))
        self._order = [self._settings[k] for k in tour.order]
        if len(self._settings) <= EXACT_UP_TO and (kicks or is_exact):
            self._exact = tour
        return tour

    def _legs(self, tour: Tour) -> list[_Leg]:
        places = [(0, 0)]
        places += [
            (self._settings[k] + 1, branch)
            for k, branch in zip(tour.order, tour.branches, strict=True)
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

    def _sought_harder(self, blocked: list[_Leg]) -> bool:
        """Seek a way for one of the blocked legs with many more trials; return whether one was found."""
        while self._patience and blocked:
            leg = min((*min(leg[:2], leg[2:]), *max(leg[:2], leg[2:])) for leg in blocked)
            blocked = [other for other in blocked if set(_ends(other)) != set(_ends(leg))]
            self._patience -= 1
            start = self._joints[leg[0]][leg[1]]
            end = self._joints[leg[2]][leg[3]]
            way = self._detours.find(start, end, [self._seed, *leg, 1], thorough=True)
            if way is not None:
                self._settle(leg, way, self._detours.seconds(way))
                return True
        return False

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
        self._moves[leg] = None if way is None else Move(seconds, way)
        self._moves[back] = None if way is None else Move(seconds, way[::-1])
        self._set_cost(leg, seconds)

    def _set_cost(self, leg: _Leg, seconds: float) -> None:
        first, branch, last, branch_there = leg
        if self._costs[first, last, branch, branch_there] == seconds:
            return
        self._costs[first, last, branch, branch_there] = seconds
        self._costs[last, first, branch_there, branch] = seconds
        self._exact = None

    def _worst(self, blocked: list[_Leg]) -> int:
        """Return the setting at most blocked moves; of several the last one."""
        ends = [place for leg in blocked for place in (leg[0], leg[2]) if place > 0]
        return max(set(ends), key=lambda place: (ends.count(place), place)) - 1

    def _driven(self, legs: list[_Leg]) -> tuple[Move, ...]:
        return tuple(move for leg in legs if (move := self._moves[leg]) is not None)


# Which of many branches a round chooses from: on a turntable, or with seven joints, a setting may have two hundred.


_MOST = 24
_MOST_IN_LONG_ROUNDS = 12


def few_branches(
    branches: Sequence[np.ndarray], home: np.ndarray, rates: JointRates, *, turns: bool
) -> list[np.ndarray]:
    """Return at most 24 branches of each setting, in rounds of more than 10 settings at most 12.

    The angles that serve most settings come first, one after the other until each setting has one,
    and then the branches that are near home; they stay in their order. So a round can do with few turns of the table.

    Parameters
    ----------
    branches : sequence of array (b, k)
        Of each setting.
    home : array (k,)
        Joints at which the round begins and ends, rad.
    rates : JointRates
        Of all of them.
    turns : bool
        Whether the last number of a branch is the angle of a turntable.
    """
    preferred: list[float] = []
    if turns:
        preferred = common_angles([set(group[:, -1].tolist()) for group in branches])
    limit = _MOST if len(branches) <= EXACT_UP_TO else _MOST_IN_LONG_ROUNDS
    result = []
    for group in branches:
        places = [preferred.index(a) if a in preferred else len(preferred) for a in group[:, -1]]
        seconds = np.round(move_times(group, home[None], rates), 6)
        order = np.lexsort((seconds, np.array(places, dtype=int)))
        result.append(group[np.sort(order[:limit])])
    return result


def common_angles(options: Sequence[set[float]]) -> list[float]:
    """Return angles of which each setting has one, greedily those that serve most; the nearest to 0 of equal ones.

    Parameters
    ----------
    options : sequence of set of float
        The angles of each setting, rad; settings without one are left out.
    """
    unserved = [angles for angles in options if angles]
    chosen: list[float] = []
    while unserved:
        every = sorted(set().union(*unserved), key=lambda angle: (abs(angle), -angle))
        best = max(every, key=lambda angle: sum(angle in angles for angles in unserved))
        chosen.append(best)
        unserved = [angles for angles in unserved if best not in angles]
    return chosen
