"""A way around what blocks a straight joint move: two trees that grow towards each other.

RRT-Connect (Kuffner and LaValle, 2000), then shortcuts. Every piece of the result is proven free by
`planner.motion.free_move`. The same seed gives the same way.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from planner.motion.free_move import JointSpace, check_move
from planner.motion.move_time import JointRates, move_times

# a shortcut must save this share of the time
_LEAST_GAIN = 0.02


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
    """

    trials: int = 400
    step_rad: float = 0.5
    shortcuts: int = 20


class _Tree:
    """Joints that are connected to a root by free moves."""

    def __init__(self, root: np.ndarray):
        self.joints = [root]
        self.parents = [-1]

    def nearest(self, target: np.ndarray) -> int:
        gaps = np.abs(np.array(self.joints) - target).max(axis=1)
        return int(gaps.argmin())

    def add(self, joints: np.ndarray, parent: int) -> int:
        self.joints.append(joints)
        self.parents.append(parent)
        return len(self.joints) - 1

    def way_to(self, node: int) -> list[np.ndarray]:
        """Return the joints from the root to a node."""
        way = []
        while node >= 0:
            way.append(self.joints[node])
            node = self.parents[node]
        return way[::-1]


class Detours:
    """Finds ways around obstacles in one space.

    Parameters
    ----------
    space : JointSpace
        The robot and its surroundings.
    rates : JointRates
        Of its joints; shortcuts save time.
    effort : DetourEffort
        How long to seek.
    """

    def __init__(
        self,
        space: JointSpace,
        rates: JointRates,
        effort: DetourEffort | None = None,
    ):
        self._space = space
        self.rates = rates
        self._effort = effort or DetourEffort()

    def find(
        self, start: np.ndarray, end: np.ndarray, seed: int | list[int] = 0
    ) -> np.ndarray | None:
        """Return joints (m, k) from start to end, proven free in between; None if no way is found.

        Parameters
        ----------
        start, end : array (k,)
            Joints, rad.
        seed : int or list of int
            Of the random joints.
        """
        rng = np.random.default_rng(seed)
        way = self._connect(np.asarray(start), np.asarray(end), rng)
        return None if way is None else self._shortened(np.array(way), rng)

    def is_free(self, start: np.ndarray, end: np.ndarray) -> bool:
        """Return whether the straight move is proven free."""
        return check_move(self._space, start, end).free

    def _connect(
        self, start: np.ndarray, end: np.ndarray, rng: np.random.Generator
    ) -> list[np.ndarray] | None:
        trees = [_Tree(start), _Tree(end)]
        limits = (self._space.lower, self._space.upper)
        # near both ends, and every other pair of times as far as the joints go
        boxes = [
            np.clip([np.minimum(start, end) - around, np.maximum(start, end) + around], *limits)
            for around in (np.pi / 2, 2 * np.pi)
        ]
        for trial in range(self._effort.trials):
            growing = trial % 2
            first = trees[growing]
            other = trees[1 - growing]
            low, high = boxes[trial // 2 % 2]
            target = _drawn(low, high, rng)
            node = self._grown(first, target, greedy=False)
            if node is None:
                continue
            met = self._grown(other, first.joints[node], greedy=True)
            if met is not None and np.array_equal(other.joints[met], first.joints[node]):
                way = first.way_to(node) + other.way_to(met)[::-1][1:]
                return way if growing == 0 else way[::-1]
        return None

    def _grown(self, tree: _Tree, target: np.ndarray, *, greedy: bool) -> int | None:
        """Grow a tree towards joints by one step, or on as far as it is free; return the last node."""
        node = tree.nearest(target)
        last = None
        while True:
            here = tree.joints[node]
            turn = target - here
            length = float(np.abs(turn).max())
            if length == 0.0:
                return node
            arrives = length <= self._effort.step_rad
            there = target if arrives else here + turn * (self._effort.step_rad / length)
            if not self.is_free(here, there):
                return last
            node = tree.add(there, node)
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
        """Leave out joints between which the straight move is free and quicker, first ones first."""
        k = 1
        while k < len(way) - 1:
            shorter = np.delete(way, k, axis=0)
            quicker = self.seconds(shorter) < self.seconds(way)
            if quicker and self.is_free(way[k - 1], way[k + 1]):
                way = shorter
                k = max(k - 1, 1)
            else:
                k += 1
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
