"""The linear part of the lower bound: weights that no single pose exceeds, and the poses that do.

The entities get weights y >= 0. If no pose inspects more than W of them, sum(y) / W settings are needed at least
(linear programming duality). The space of poses (`planner.bound.pose_space`) is searched for poses that inspect more
than the next number of settings allows. If there is none, that number is proven. If there are some, what they inspect
is added to the columns that the weights come from, and they are computed anew. This is column generation with an exact
oracle (Gilmore & Gomory 1961), so the same search also finds poses for the plan that no random search has come across.

What is proven for some weights and a limit is proven for weights nowhere larger and for larger limits. So the limit
leaves some to spare, and a few poses that exceed it only make the weights of what they inspect smaller; new weights,
for which every part of the space is to be searched again, are computed when that no longer does.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linprog
from scipy.sparse import csr_matrix

from planner.bound.boxes.search import PROVEN, SPENT
from planner.bound.pose_space import Found, PoseSpace
from planner.callbacks import NOBODY, Callbacks, Checkpoint
from planner.cover.few_columns import mean_dual
from planner.cover.set_cover import maximal_columns

# number of optimal duals of the cover. The weights are their mean, because a single one depends
# on few entities.
_DUALS = 16
# largest factor of the weights in the search for duals. The smallest is 1.
_BIAS = 1.5
# smaller weights become 0, because they would only lengthen the search
_LEAST_WEIGHT = 1e-3
# safety margin below the largest permitted weight of a pose, as a share. With it, a few heavier
# poses need no new weights.
_SPARE = 0.01
# upper limit of this margin, as a share of the limit's excess over 1
_SPARE_OF_ROOM = 0.25
# factor by which weights stay below the limit where poses exceeded it
_LESS = 0.999
# boxes checked in a part at first
_FIRST_BOXES = 8000
# factor of more boxes for an undecided part
_MORE_BOXES = 4
# after this multiple of the first boxes, the program prefers other weights, if there are any
_HARD = 16
# multiple of the boxes of an earlier proof, for other weights
_AGAIN = 1.5
# smallest number of sweeps of all parts that must be possible
_LEAST_SWEEPS = 8
# largest number of poses beyond the limit taken from one part at a time
_MOST_FOUND = 8
# share of the remaining boxes for a number, if smaller numbers are not yet proven
_SHARE_AT_FIRST = 0.65
# once a number is proven, share of all boxes after which the proof stops the next one
_SHARE_OF_NEXT = 0.6
# the first number needs no pose limit smaller than this. The limit is the largest permitted
# weight of a pose. The heaviest known column weighs 1.
_LEAST_LIMIT = 1.15
# the proof stops later numbers when their limit is no larger than this
_LEAST_LIMIT_OF_NEXT = 1.06
# the proof stops the first number when its limit exceeds 1 by no more than this, and
# `_NEAR_SETTING` holds as well
_NEAR_ONE = 0.02
# the limit times the next smaller number of settings exceeds that number by no more than this
_NEAR_SETTING = 0.3

# Weights of entities for the linear bound, and what no pose may weigh.
#
# The weights are the mean of several optimal duals of the cover by these columns: a single one
# rests on few entities, so that a box either holds one more of them or does not, where with the
# mean every bit that it is smaller tells.


# for rounding sums of weights
SLACK = 1e-6


def spread_weights(columns: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return weights (e,) of entities, the heaviest of the columns (c, e) weighing 1; small ones are made 0."""
    columns = columns[maximal_columns(columns)]
    y = mean_dual(columns, _BIAS, _DUALS)
    y[y < _LEAST_WEIGHT] = 0.0
    return y / (columns @ y).max()


def limit_for(y: NDArray[np.float64], target: int) -> float:
    """Return what no pose may weigh for weights y (e,) to prove so many settings, with some to spare."""
    limit = float(y.sum()) / max(1, target - 1)
    spare = min(_SPARE * limit, _SPARE_OF_ROOM * abs(limit - 1.0))
    return limit - spare - SLACK


def relieved(y: NDArray[np.float64], sets: NDArray[np.bool_], limit: float) -> NDArray[np.float64]:
    """Return weights (e,) nowhere larger than y, such that none of the sets (s, e) weighs more than nearly a limit.

    Their sum is the largest there is.
    """
    excess = sets @ y - _LESS * limit
    result = linprog(
        np.ones(len(y)),
        A_ub=csr_matrix(-sets[excess > 0.0].astype(float)),
        b_ub=-excess[excess > 0.0],
        bounds=np.stack([np.zeros(len(y)), y], axis=1),
    )
    return np.zeros_like(y) if result.x is None else np.clip(y - result.x, 0.0, y)


# What is proven of all targets of a cover, and what that says of some of them.


@dataclass(frozen=True, eq=False)
class ProvenBound:
    """How many settings some targets need at least.

    Attributes
    ----------
    n : int
        So many.
    proof : str
        What that rests on.
    of : array of bool (k,)
        The targets.
    weights : array (k,) or None
        Weights of targets of which no pose inspects more than 1 together, where the proof gives some.
    """

    n: int
    proof: str
    of: NDArray[np.bool_] = field(repr=False)
    weights: NDArray[np.float64] | None = field(default=None, repr=False)

    def for_some(self, kept: NDArray[np.bool_]) -> int:
        """Return how many settings are needed for some targets (k,) at least.

        A plan for these and one setting for each of the others is a plan for all, so the bound falls by the number of
        those that are not kept. Or it is the sum of the weights of those that are: what holds for all sets of targets
        that poses inspect holds without some of their members.
        """
        bounds = [self.n - int((self.of & ~kept).sum()), int(kept.any())]
        if self.weights is not None:
            bounds.append(math.ceil(math.fsum(self.weights[kept].tolist()) - SLACK))
        return min(self.n, max(bounds))


def of_all(weights: NDArray[np.float64], of: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return weights of some of the targets as weights of all, given which (k,) they are."""
    found = np.zeros(len(of))
    found[of] = weights
    return found


class _Parts:
    """What is known of the parts of the space of poses: which have a proof for the present weights, and what it took.

    Those that had one for earlier weights are likely to have one again, so they wait until the others are done.
    """

    def __init__(self, n: int, first: int):
        self.proven, self.waits = np.zeros((2, n), dtype=bool)
        # boxes to be looked at when a part is searched next
        self.worth = np.full(n, first)
        self.first = first

    def next_ones(self, affordable: int) -> tuple[NDArray[np.int_], NDArray[np.int_]] | None:
        """Return the parts to be searched next and how many boxes of each; None if that is more than affordable."""
        if (self.proven | self.waits).all():
            self.waits[:] = False
        parts = np.flatnonzero(~self.proven & ~self.waits)
        return (parts, self.worth[parts]) if self.worth[parts].sum() <= affordable else None

    def learn(
        self, parts: NDArray[np.int_], outcomes: NDArray[np.int_], made: NDArray[np.int_]
    ) -> NDArray[np.bool_]:
        """Take in what a search of some parts gave, and how many boxes that took; tell which are too hard.

        There, some set of entities weighs too much and nearly can be inspected.
        """
        proven = outcomes == PROVEN
        spent = outcomes == SPENT
        self.proven[parts] = proven
        self.worth[parts[proven]] = np.maximum(_AGAIN * made[proven], self.first)
        self.worth[parts[spent]] = _MORE_BOXES * made[spent]
        hard = spent & (made >= _HARD * self.first)
        self.worth[parts[hard]] = self.first
        return hard

    def insist(self, parts: NDArray[np.int_], made: NDArray[np.int_]) -> None:
        """Let hard parts be searched further: so many boxes were made of each."""
        self.worth[parts] = _MORE_BOXES * made

    def ease(self) -> None:
        """The limit is about to be raised: what is proven stays so, and the rest may take little."""
        self.worth[~self.proven] = self.first

    def renew(self) -> None:
        """The weights or the limit are about to change."""
        self.waits |= self.proven
        self.proven = np.zeros_like(self.proven)

    def to_dict(self) -> dict[str, Any]:
        """Return copies of the fields, for `from_dict`."""
        arrays = {name: getattr(self, name).copy() for name in ("proven", "waits", "worth")}
        return {**arrays, "first": self.first}

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> _Parts:
        """Build from the result of `to_dict`."""
        parts = cls(len(data["worth"]), data["first"])
        parts.proven = data["proven"]
        parts.waits = data["waits"]
        parts.worth = data["worth"]
        return parts


@dataclass
class _Course:
    """What goes on from sweep to sweep while a bound is raised.

    Attributes
    ----------
    bound, target : int
        Proven, and aimed at.
    y : array (e,)
        Weights.
    limit, least : float
        What no pose may weigh, and below which the target is given up.
    allowed : float
        Boxes that may have been looked at when the target is given up.
    undecided : bool
        More boxes would not decide.
    parts : _Parts
    weights : array (e,) or None
        Weights that prove the bound, of which no pose weighs more than 1; None if these did not.
    """

    bound: int
    target: int
    y: NDArray[np.float64]
    limit: float
    least: float
    allowed: float
    undecided: bool
    parts: _Parts
    weights: NDArray[np.float64] | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return the fields, for `from_dict`; the arrays do not change any more."""
        return {**self.__dict__, "y": self.y.copy(), "parts": self.parts.to_dict()}

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> _Course:
        """Build from the result of `to_dict`."""
        return cls(**{**data, "parts": _Parts.from_dict(data["parts"])})


class LinearBound:
    """A lower bound that is raised by weights, as far as the boxes of poses allowed suffice.

    Parameters
    ----------
    space : PoseSpace
    columns : array of bool (c, e)
        Columns known to be realisable; the weights start from them.
    improve : callable, optional
        ``improve(poses)`` gets poses (f, 4, 4) that inspect more than the weights foresee. It returns the columns that
        are known to be realisable from then on.
    callbacks : Callbacks
        Progress, and every number of settings that is proven, are reported to them.
    checkpoint : Checkpoint, optional
        Keeps how far this has got, at every sweep and part. If it holds an entry, this goes on from there.

    Attributes
    ----------
    made : int
        Boxes of poses looked at.
    weights : array (e,) or None
        Weights that prove what was raised, of which no pose weighs more than 1.
    found : array of bool (f, e)
        What the poses found inspect, by the necessary conditions, or might inspect where that is hard to tell.
    """

    def __init__(
        self,
        space: PoseSpace,
        columns: ArrayLike,
        improve: Callable[[NDArray[np.float64]], NDArray[np.bool_]] | None = None,
        checkpoint: Checkpoint | None = None,
        callbacks: Callbacks = NOBODY,
    ):
        self.space = space
        self.improve = improve
        self.checkpoint = checkpoint or Checkpoint()
        self.callbacks = callbacks
        self.columns = np.asarray(columns, dtype=bool)
        self.found = self.columns[:0]
        self.weights: NDArray[np.float64] | None = None
        self.made = 0
        self._poses: list[NDArray[np.float64]] = []
        # of a sweep that was interrupted, what came out of its first parts
        self._swept: list[Found] = []

    def raise_from(self, bound: int, n_settings: int, *, max_nodes: int) -> int:
        """Return what is proven, given what is proven already; at most ``n_settings``.

        Looks at ``max_nodes`` boxes of poses at most. A large number of settings is aimed at first: what is found on
        the way counts for the smaller ones as well, and what is proven of a part holds for larger limits.
        """
        kept = self.checkpoint.get("linear")
        at = self._start(bound, n_settings, max_nodes) if kept is None else self._resume(kept)
        parts = at.parts
        while at.bound < at.target:
            # weights prove no more than their sum, and hardly that
            hopeless = at.limit <= at.least or at.undecided
            chosen = None if hopeless else parts.next_ones(int(at.allowed) - self.made)
            if chosen is None:
                # what is proven for a smaller limit is proven for this one; what is to spare must not make it smaller
                parts.ease()
                at.target = at.target - 1
                at.undecided = False
                at.allowed = self._share(max_nodes, at.target - at.bound)
                at.limit = max(at.limit, limit_for(at.y, at.target))
                continue
            outcomes, made, sets, doubts = self._sweep(at, *chosen, max_nodes)
            hard = parts.learn(chosen[0], outcomes, made)
            if hard.any() and not self._leaves_hope(at, np.concatenate([sets, doubts[hard]])):
                # that such sets can be inspected is not known: it takes more boxes to tell
                parts.insist(chosen[0][hard], made[hard])
                hard[:] = False
            sets = np.concatenate([sets, doubts[hard]])
            if len(sets):
                self._make_room(at, sets)
            elif parts.proven.all():
                if at.target > at.bound:
                    at.weights = at.y / at.limit
                at.bound = max(at.bound, at.target)
                self.callbacks.bound(at.bound, at.weights)
                parts.renew()
                at.target = min(at.bound + 1, n_settings)
                at.allowed = _SHARE_OF_NEXT * max_nodes
                at.limit = limit_for(at.y, at.target)
                at.least = _LEAST_LIMIT_OF_NEXT
            else:
                # boxes too small to be halved: more of them would not decide
                at.undecided = not (outcomes == SPENT).any() and not parts.waits.any()
        self._improve()
        self.weights = at.weights
        return at.bound

    def _start(self, bound: int, n_settings: int, max_nodes: int) -> _Course:
        """Return where to begin."""
        n_parts = len(self.space.parts)
        affordable = max_nodes // (_LEAST_SWEEPS * n_parts) + 1
        parts = _Parts(n_parts, min(_FIRST_BOXES, affordable))
        y = self._weights()
        target = min(n_settings, max(bound, int(float(y.sum()) / _LEAST_LIMIT)) + 1)
        least = 1.0 + min(_NEAR_ONE, _NEAR_SETTING / max(1, target - 1))
        allowed = self._share(max_nodes, target - bound)
        limit = limit_for(y, target)
        return _Course(bound, target, y, limit, least, allowed, False, parts)

    def _resume(self, kept: dict[str, Any]) -> _Course:
        """Go on from what was told of a sweep; return where that is."""
        self.found = kept["found"]
        self.made = kept["made"]
        self._poses = [kept["poses"]] if len(kept["poses"]) else []
        self.space.regrow(kept["viewpoints"])
        self._swept = _unpacked(kept["swept"])
        return _Course.from_dict(kept["course"])

    def _leaves_hope(self, at: _Course, sets: NDArray[np.bool_]) -> bool:
        """Tell whether there are weights for the number aimed at by which these sets are not too heavy either."""
        if relieved(at.y, sets, at.limit).sum() > at.limit * (at.target - 1) + SLACK:
            return True
        y = spread_weights(np.concatenate([self.columns, self.found, sets]))
        return limit_for(y, at.target) > at.least

    def _make_room(self, at: _Course, sets: NDArray[np.bool_]) -> None:
        """Make the weights smaller where sets found exceed the limit; compute them anew if that is too much."""
        self.found = np.concatenate([self.found, sets])
        lighter = relieved(at.y, sets, at.limit)
        if lighter.sum() > at.limit * (at.target - 1) + SLACK:
            # what is proven for larger weights is proven for these
            at.y = lighter
            return
        self._improve()
        at.parts.renew()
        at.y = self._weights()
        at.limit = limit_for(at.y, at.target)

    def _share(self, max_nodes: int, ahead: int) -> float:
        """Return how many boxes may have been looked at when a number of settings so far ahead is given up."""
        if ahead <= 1:
            return max_nodes
        share = _SHARE_AT_FIRST
        return self.made + share * (max_nodes - self.made)

    def _weights(self) -> NDArray[np.float64]:
        return spread_weights(np.concatenate([self.columns, self.found]))

    def _improve(self) -> None:
        """Tell of the poses found since the last time."""
        if self._poses and self.improve is not None:
            self.columns = self.improve(np.concatenate(self._poses))
        self._poses = []

    def _sweep(
        self,
        at: _Course,
        parts: NDArray[np.int_],
        most: NDArray[np.int_],
        max_nodes: int,
    ) -> tuple[NDArray[np.int_], NDArray[np.int_], NDArray[np.bool_], NDArray[np.bool_]]:
        """Search parts of the space; return outcomes, boxes looked at, what poses found inspect, and doubts."""

        def tick() -> None:
            self.callbacks.report(min(self.made, max_nodes), max_nodes, "lower bound")

        tell = self._teller(at)
        done = self._swept
        self._swept = []
        self.made += sum(part_result.made for part_result in done)
        left = slice(len(done), None)
        most_found = _MOST_FOUND
        search = self.space.search(
            at.y, at.limit, most[left], tick, parts=parts[left], most=most_found
        )
        with closing(search) as results:
            for part_result in results:
                done.append(part_result)
                self.made += part_result.made
                tell(tuple(done))
                tick()
        self._poses.extend(part_result.poses for part_result in done if len(part_result.poses))
        outcomes, made = np.array(
            [(part_result.outcome, part_result.made) for part_result in done]
        ).T
        return (
            outcomes,
            made,
            np.concatenate([part_result.sets for part_result in done]),
            np.array([part_result.doubt for part_result in done]),
        )

    def _teller(self, at: _Course) -> Callable[[tuple[Found, ...]], None]:
        """Return what keeps the parts of a sweep that are done; all else is as it is before the sweep."""
        poses = np.concatenate([np.zeros((0, 4, 4)), *self._poses])
        before = {"course": at.to_dict(), "found": self.found, "made": self.made, "poses": poses}

        def tell(done: tuple[Found, ...]) -> None:
            viewpoints = self.space.grown_for()
            self.checkpoint.put(
                "linear", {**before, "viewpoints": viewpoints, "swept": lambda: _packed(done)}
            )

        return tell


def _packed(done: tuple[Found, ...]) -> dict[str, NDArray[Any]]:
    """Return what came out of parts, one at least, as a few arrays, for `_unpacked`."""
    return {
        "outcome": np.array([found.outcome for found in done]),
        "made": np.array([found.made for found in done]),
        "doubt": np.array([found.doubt for found in done]),
        "n_poses": np.array([len(found.poses) for found in done]),
        "poses": np.concatenate([found.poses for found in done]),
        "sets": np.concatenate([found.sets for found in done]),
    }


def _unpacked(packed: dict[str, NDArray[Any]]) -> list[Found]:
    """Return what `_packed` made few arrays of."""
    cuts = np.cumsum(packed["n_poses"])[:-1]
    poses = np.split(packed["poses"], cuts)
    sets = np.split(packed["sets"], cuts)
    rows = zip(
        packed["outcome"].tolist(),
        packed["made"].tolist(),
        poses,
        sets,
        packed["doubt"],
        strict=True,
    )
    return [Found(*row) for row in rows]
