"""A proven lower bound on the number of sensor settings, by subdividing the space of poses.

Notation
--------
node       a box of positions (centre c, half sizes h) times a patch of viewing directions times an interval of rolls
S(node)    its optimistic set: every entity that *may* be inspected by *some* pose of the node; where S contains two
           entities that exclude each other (`planner.bound.pose_tree`), the node is split into two with the same
           poses, one without the first entity, one without all that it excludes
y          weights of the entities, y >= 0

Every pose lies in some leaf of the subdivision, so what it inspects is part of that leaf's S, and no plan has fewer
settings than a cover by leaves' sets has columns. What a clique of entities that exclude each other proves
(`planner.bound.lower_bound`) is known at once. For each larger number of settings, the leaves of a cover by fewer are
split, some rounds long: quick where pairs that exclude each other decide. If nothing in any leaf's S weighs more than
1, at least sum(y) settings are needed (linear programming duality), and only leaves of weight at least 1 - (K - sum(y))
can be in a cover of K columns (reduced-cost fixing). Where this gets no further, weights alone go on: those of the
columns that are known to be realisable, all leaves that weigh too much being split; of entities that exclude each other
at a leaf's poses only one counts. In the end, boxes about the point looked at take over (`planner.bound.lower_bound`),
which are searched depth first and need no memory; what is visible together from where is found beforehand
(`planner.bound.boxes`).

S(node) uses necessary conditions only: visibility (the box meets a cell of the entity's region), distance and depth
(focus), the rectangle of the sensor, the resolution, and the length of image without which quantization alone keeps
the probability below the threshold (`planner.bound.pose_space`). All slack that a node's size causes is added. So the
bound holds for any search.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import Executor
from contextlib import closing
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linprog
from scipy.sparse import csr_matrix

from ground.shared import Shared
from planner.bound.boxes import PROVEN, SPENT
from planner.bound.pose_space import PoseSpace, SearchedPart, WitnessSets
from planner.bound.pose_tree import PoseTree, TargetLeaves, find_conflicts
from planner.bound.view import Cells, entity_cells
from planner.callbacks import NOBODY, Callbacks, Checkpoint
from planner.cover import cover_within, distinct_rows, fractional_cover, maximal_columns, mean_dual
from planner.effort import Effort
from planner.executors import in_order
from planner.request.problem import Problem

# The linear part of the lower bound: weights that no single pose exceeds, and the poses that do.
#
# The entities get weights y >= 0. If no pose inspects more than W of them, sum(y) / W settings
# are needed at least (linear programming duality). The space of poses
# (`planner.bound.pose_space`) is searched for poses that inspect more than the next number of
# settings allows. If there is none, that number is proven. If there are some, what they inspect
# is added to the columns that the weights come from, and they are computed anew. This is column
# generation with an exact oracle (Gilmore & Gomory 1961), so the same search also finds poses for
# the plan that no random search has come across.
#
# What is proven for some weights and a limit is proven for weights nowhere larger and for larger
# limits. So the limit leaves some to spare, and a few poses that exceed it only make the weights
# of what they inspect smaller; new weights, for which every part of the space is to be searched
# again, are computed when that no longer does.


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
    expanded = np.zeros(len(of))
    expanded[of] = weights
    return expanded


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
    limit, least_limit : float
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
    least_limit: float
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
        self._swept: list[SearchedPart] = []

    def raise_from(self, bound: int, n_settings: int, *, max_nodes: int) -> int:
        """Return what is proven, given what is proven already; at most ``n_settings``.

        Looks at ``max_nodes`` boxes of poses at most. A large number of settings is aimed at first: what is found on
        the way counts for the smaller ones as well, and what is proven of a part holds for larger limits.
        """
        entry = self.checkpoint.get("linear")
        at = self._start(bound, n_settings, max_nodes) if entry is None else self._resume(entry)
        parts = at.parts
        while at.bound < at.target:
            # weights prove no more than their sum, and hardly that
            hopeless = at.limit <= at.least_limit or at.undecided
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
                at.least_limit = _LEAST_LIMIT_OF_NEXT
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
        lowest_limit = 1.0 + min(_NEAR_ONE, _NEAR_SETTING / max(1, target - 1))
        allowed = self._share(max_nodes, target - bound)
        limit = limit_for(y, target)
        return _Course(bound, target, y, limit, lowest_limit, allowed, False, parts)

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
        return limit_for(y, at.target) > at.least_limit

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
        remaining = slice(len(done), None)
        most_found = _MOST_FOUND
        search = self.space.search(
            at.y, at.limit, most[remaining], tick, parts=parts[remaining], most=most_found
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

    def _teller(self, at: _Course) -> Callable[[tuple[SearchedPart, ...]], None]:
        """Return what keeps the parts of a sweep that are done; all else is as it is before the sweep."""
        poses = np.concatenate([np.zeros((0, 4, 4)), *self._poses])
        before = {"course": at.to_dict(), "found": self.found, "made": self.made, "poses": poses}

        def tell(done: tuple[SearchedPart, ...]) -> None:
            viewpoints = self.space.grown_for()
            self.checkpoint.put(
                "linear", {**before, "viewpoints": viewpoints, "swept": lambda: _packed(done)}
            )

        return tell


def _packed(done: tuple[SearchedPart, ...]) -> dict[str, NDArray[Any]]:
    """Return what came out of parts, one at least, as a few arrays, for `_unpacked`."""
    return {
        "outcome": np.array([result.outcome for result in done]),
        "made": np.array([result.made for result in done]),
        "doubt": np.array([result.doubt for result in done]),
        "n_poses": np.array([len(result.poses) for result in done]),
        "poses": np.concatenate([result.poses for result in done]),
        "sets": np.concatenate([result.sets for result in done]),
    }


def _unpacked(packed: dict[str, NDArray[Any]]) -> list[SearchedPart]:
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
    return [SearchedPart(*row) for row in rows]


# largest number of nodes with boxes of positions. Proofs from pairs that exclude each other need
# few.
_TREE_NODES = 32_000
# the tree does not split nodes smaller than this angle, seen from the camera
_FINEST_RAD = 2e-3
# largest number of nodes split between two checks of whether they suffice
_BATCH = 6000
# largest number of sets of an integer cover. With more, it proves nothing.
_COVER_COLUMNS = 4000
# largest number of branch-and-bound nodes of one integer cover
_COVER_NODES = 2000
# for each number of settings, each of this many first rounds has an integer cover
_COVER_ROUNDS = 20
# after that, one round in this many has one
_ROUNDS_PER_COVER = 10
# largest number of linear programs. Then all weights are divided by that of the heaviest leaf.
_DUAL_ROUNDS = 60
# a leaf may weigh this much more than 1
_TOLERANCE = 1e-7
# leaves checked in a round, those that weigh most
_VIOLATED = 2000
# constraints added in a round
_ADDED = 150
# keep only constraints of leaves that weigh more than this for the next time
_KEPT_WEIGHT = 0.5

# Entities of which no two can be inspected together: a bound without any search.


# greedy cliques from every entity, this many times
_ROUNDS = 5
# the first time by degree, then with so much chance in it
_CHANCE = 1.5


def large_clique(conflict: NDArray[np.bool_]) -> NDArray[np.int_]:
    """Return entities that exclude each other pairwise, as many as a greedy search finds.

    No setting inspects two of them, so each needs one of its own.

    Parameters
    ----------
    conflict : array of bool (e, e)
        Symmetric, false on the diagonal.

    Returns
    -------
    array of int, ascending
    """
    conflict = np.asarray(conflict, dtype=bool)
    rng = np.random.default_rng(0)
    best = np.zeros(0, dtype=int)
    for trial in range(_ROUNDS * len(conflict)):
        clique = [trial % len(conflict)]
        neighbours = np.flatnonzero(conflict[trial % len(conflict)])
        while len(neighbours) and len(clique) + len(neighbours) > len(best):
            # the one that leaves most to choose from
            leaves = conflict[np.ix_(neighbours, neighbours)].sum(axis=1) + _CHANCE * rng.random(
                len(neighbours)
            ) * (trial >= len(conflict))
            chosen = neighbours[np.argmax(leaves)]
            clique.append(int(chosen))
            neighbours = neighbours[conflict[chosen, neighbours]]
        if len(clique) > len(best):
            best = np.sort(clique)
    return best


# of what is told while the tree of poses grows
_GROWING = "growing"
# for rounding sums of weights
_SLACK = 1e-6


def lower_bound(
    problem: Problem,
    n_settings: int,
    columns: NDArray[np.bool_],
    *,
    effort: Effort,
    improve: Callable[[NDArray[np.float64]], NDArray[np.bool_]] | None = None,
    checkpoint: Checkpoint | None = None,
    executor: Executor | None = None,
    callbacks: Callbacks = NOBODY,
) -> tuple[int, str, NDArray[np.float64] | None]:
    """Prove how many settings are needed at least.

    Parameters
    ----------
    problem : Problem
        The request for the entities to be covered: visibility, camera and constraints.
    n_settings : int
        Size of the cover that is known; the proof stops when it gets there.
    columns : array of bool (c, e)
        Columns known to be realisable; they start the weights.
    effort : Effort
        Boxes of poses, at most, and how they are searched.
    improve : callable, optional
        Gets poses worth knowing, see `planner.bound.lower_bound.LinearBound`.
    checkpoint : Checkpoint, optional
        Keeps how far the proof has got. The proof goes on from its entries, if it has some for the same arguments, and
        proves the same.
    executor : concurrent.futures.Executor, optional
        Computes the cells of entities' regions.
    callbacks : Callbacks
        Progress, and every number of settings that is proven, are reported to them.

    Returns
    -------
    bound : int
        No plan for these entities has fewer settings.
    proof : str
        What it rests on, in one sentence.
    weights : array (e,) or None
        Weights of the entities of which no pose inspects more than 1 together, where such weights prove it.
    """
    if n_settings <= 1:
        proof = "Fewer settings than one inspect nothing."
        return n_settings, proof if n_settings else "No entity is inspected.", None
    checkpoint = checkpoint or Checkpoint()
    witnesses = WitnessSets.of(problem)
    single = problem.single
    entity_idx = np.arange(len(single.names))
    regions = _regions(single, entity_idx, executor)
    first = checkpoint.get("covers")
    if first is None:
        grown = checkpoint.get(_GROWING)
        conflict = (
            find_conflicts(single, entity_idx, witnesses.of_columns(columns), regions)
            if grown is None
            else grown["conflict"]
        )
        tree = PoseTree(single, entity_idx, regions, conflict, witnesses.one_each(conflict))
        # a pair excludes each other for a reason of its own; so do the pairs of a clique
        alone = max(1, len(large_clique(witnesses.targets_apart(conflict))))
        callbacks.bound(min(alone, n_settings))
        growing = _Growing(checkpoint, conflict)
        leaves = TargetLeaves(tree, witnesses)
        boxes = effort.boxes_for(columns.shape[1])
        proven, weights = _by_covers(leaves, columns, alone, n_settings, growing, boxes, callbacks)
        first = {"conflict": conflict, "weights": weights, "bound": proven}
        first |= {"made": tree.made, "alone": alone}
    checkpoint.put("covers", first)
    checkpoint.put(_GROWING, None)
    callbacks.bound(first["bound"], first["weights"])
    conflict = witnesses.one_each(first["conflict"])
    space = PoseSpace(single, entity_idx, regions, conflict, witnesses)
    linear = LinearBound(space, columns, improve, checkpoint, callbacks)
    boxes = effort.boxes_for(len(problem.names))
    bound = linear.raise_from(first["bound"], n_settings, max_nodes=max(0, boxes - first["made"]))
    callbacks.report(boxes, boxes, "lower bound")
    if bound <= first["alone"]:
        return bound, exclusion_proof(problem, bound), None
    apart = int(witnesses.targets_apart(first["conflict"]).sum()) // 2
    weights = first["weights"] if bound == first["bound"] else linear.weights
    return bound, _proof(first["made"] + linear.made, apart, _items(problem)), weights


def exclusive_entities(
    problem: Problem,
    entity_idx: NDArray[np.int_],
    columns: NDArray[np.bool_],
    executor: Executor | None = None,
) -> NDArray[np.int_]:
    """Find entities of which no two can be inspected together: a bound that takes seconds.

    Parameters
    ----------
    problem : Problem
        The request.
    entity_idx : array of int (e,)
        Entities among which they are looked for, as columns of the request.
    columns : array of bool (c, e)
        Columns known to be realisable: their pairs are not asked about.
    executor : concurrent.futures.Executor, optional
        Computes the cells of entities' regions.

    Returns
    -------
    array of int (n,)
        Columns of the request, ascending. Whatever inspects all of them needs n settings; `exclusion_proof` says why.
    """
    restricted = problem.restricted_to([problem.names[i] for i in entity_idx])
    witnesses = WitnessSets.of(restricted)
    single = restricted.single
    every = np.arange(len(single.names))
    regions = _regions(single, every, executor)
    inspected = witnesses.of_columns(columns)
    conflict = find_conflicts(single, every, inspected, regions)
    return entity_idx[large_clique(witnesses.targets_apart(conflict))]


def exclusion_proof(problem: Problem, n: int) -> str:
    """Say what a bound of so many entities that exclude each other rests on."""
    return _proof_of_clique(n, _items(problem))


def _regions(problem: Problem, entity_idx: NDArray[np.int_], executor: Executor | None) -> Cells:
    """Return the cells of entities' regions."""
    shared = Shared(problem)
    return Cells.joined(
        in_order(executor, entity_cells, [(shared, problem.names[i]) for i in entity_idx])
    )


def _items(problem: Problem) -> str:
    edges = all(target.in_image for target in problem.targets)
    return "edges" if edges else "items"


def _by_covers(
    tree: TargetLeaves,
    columns: NDArray[np.bool_],
    proven: int,
    n_settings: int,
    growing: _Growing,
    max_nodes: int,
    callbacks: Callbacks,
) -> tuple[int, NDArray[np.float64] | None]:
    """Return how many settings covers by leaves' sets prove; the tree is grown as far as they need it.

    ``proven`` is the bound so far, ``n_settings`` the one that is aimed at in the end. Returned are also weights
    that prove it, if there are some: what a search of covers proves, weights may not.
    """
    weights = _Weights(np.asarray(columns, dtype=bool))
    guide = fractional_cover(columns)[1]
    target, rounds = growing.resume(tree, weights) or (proven + 1, 0)
    while target <= n_settings and tree.made < min(_TREE_NODES, max_nodes):
        growing.tell(tree, weights, target, rounds)
        rounds += 1
        sets_first = rounds <= _COVER_ROUNDS or rounds % _ROUNDS_PER_COVER == 0
        y = weights.solve(tree.sets) if sets_first else guide
        find = _to_split if sets_first else _above
        heavy = find(tree, y, target)
        if heavy is None:
            weights.proving = _proving(y, target, sets_first)
            callbacks.bound(target, weights.proving)
            target = target + 1
            rounds = 0
            continue
        if not heavy.size:
            break
        tree.split(heavy, sets_first)
        callbacks.report(min(tree.made, max_nodes), max_nodes, "lower bound")
    return min(target - 1, n_settings), weights.proving


def _proving(y: NDArray[np.float64], target: int, sets_first: bool) -> NDArray[np.float64] | None:
    """Return weights of which no leaf has more than 1, if it was weights that proved so many settings."""
    if not sets_first:
        return y / _limit(y, target)
    return y if float(y.sum()) > target - 1 + _SLACK else None


def _limit(y: NDArray[np.float64], target: int) -> float:
    """Return what no leaf may weigh for weights to prove so many settings."""
    return float(y.sum()) / (target - 1) - _SLACK


class _Growing:
    """Tells how far covers by leaves' sets have got, and goes on from there another time.

    Parameters
    ----------
    checkpoint : Checkpoint
    conflict : array of bool (e, e)
        Pairs that exclude each other: they take long to find, too.
    """

    def __init__(self, checkpoint: Checkpoint, conflict: NDArray[np.bool_]):
        self._checkpoint = checkpoint
        self._conflict = conflict

    def tell(self, tree: TargetLeaves, weights: _Weights, target: int, rounds: int) -> None:
        """Tell where a round begins."""
        grown = {"tree": tree.to_dict(), "rows": weights.rows, "target": target, "rounds": rounds}
        entry = {"conflict": self._conflict, "proving": weights.proving}
        self._checkpoint.put(_GROWING, {**entry, **grown})

    def resume(self, tree: TargetLeaves, weights: _Weights) -> tuple[int, int] | None:
        """Return the number of settings aimed at, and the rounds done, if this was told before."""
        grown = self._checkpoint.get(_GROWING)
        if grown is None:
            return None
        tree.regrow(grown["tree"])
        weights.rows = grown["rows"]
        weights.proving = grown["proving"]
        return grown["target"], grown["rounds"]


def _proof_of_clique(n: int, what: str) -> str:
    """Say what a bound rests on that needs no search."""
    if n == 1:
        return "Fewer settings than one inspect nothing."
    return (
        f"Of {n} {what} no two can be inspected together, as no viewpoint meets the necessary conditions (visibility, "
        "focus, sensor size, length of the image) for both, so each needs a setting of its own."
    )


def _proof(boxes: int, pairs: int, what: str = "edges") -> str:
    """Say what a bound rests on."""
    checked = "1 box of camera poses was" if boxes == 1 else f"{boxes} boxes of camera poses were"
    excluded = f"1 pair of {what} was" if pairs == 1 else f"{pairs or 'no'} pairs of {what} were"
    return (
        f"Covering by optimistic columns: {checked} checked against necessary conditions (visibility, focus, sensor "
        f"size, length of the image), and {excluded} found to exclude each other."
    )


def _to_split(tree: TargetLeaves, y: NDArray[np.float64], target: int) -> NDArray[np.int_] | None:
    """Choose the nodes to split to prove ``target``; none if nothing is left to split, None if it is proven."""
    weight = tree.sets @ y
    splittable = tree.size > _FINEST_RAD
    # what a cover with fewer settings may waste
    spare = target - 1 - float(y.sum())
    if spare < -_SLACK:
        return None
    usable = np.flatnonzero(weight >= 1.0 - spare - _SLACK)
    first, of_distinct = distinct_rows(tree.sets[usable])
    distinct = tree.sets[usable[first]]
    heaviest = np.argsort(-(distinct @ y), kind="stable")[: 4 * _COVER_COLUMNS]
    columns = heaviest[maximal_columns(distinct[heaviest])][:_COVER_COLUMNS]
    exhaustive = len(distinct) <= 4 * _COVER_COLUMNS and len(columns) < _COVER_COLUMNS
    if not distinct[columns].any(axis=0).all():
        return None if exhaustive else _heaviest(usable[splittable[usable]], weight)
    chosen, decided = cover_within(distinct[columns], target - 1, node_limit=_COVER_NODES)
    if exhaustive and chosen is None and decided:
        return None
    if chosen is None:
        return _heaviest(usable[splittable[usable]], weight)
    nodes = usable[np.isin(of_distinct, columns[chosen])]
    return nodes[splittable[nodes]][:_BATCH]


def _above(tree: TargetLeaves, y: NDArray[np.float64], target: int) -> NDArray[np.int_] | None:
    """Choose the nodes that weigh too much for the weights to prove ``target``, the heaviest first; None if none do."""
    limit = _limit(y, target)
    nodes = np.flatnonzero(tree.sets @ y > limit)
    weight = tree.weights(nodes, y)
    nodes = nodes[weight > limit]
    weight = weight[weight > limit]
    if not nodes.size:
        return None
    fine = tree.size[nodes] > _FINEST_RAD
    return nodes[fine][np.argsort(-weight[fine], kind="stable")[:_BATCH]]


def _heaviest(nodes: NDArray[np.int_], weight: NDArray[np.float64]) -> NDArray[np.int_]:
    return nodes[np.argsort(-weight[nodes], kind="stable")[:_BATCH]]


class _Weights:
    """The dual of the fractional cover over all leaves, by constraint generation."""

    def __init__(self, columns: NDArray[np.bool_]):
        self._columns = columns[distinct_rows(columns)[0]]
        self.rows = self._columns[:0]
        # those that prove the present bound, if it is weights that prove it
        self.proving: NDArray[np.float64] | None = None

    def solve(self, sets: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Return the weights y (e,) of largest sum such that no leaf and no known column weighs more than 1."""
        self._forget(sets)
        for _ in range(_DUAL_ROUNDS):
            y = self._solve()
            weight = sets @ y
            violated = np.flatnonzero(weight > 1.0 + _TOLERANCE)
            if not violated.size:
                break
            worst = violated[np.argsort(-weight[violated], kind="stable")[:_VIOLATED]]
            new = sets[worst[distinct_rows(sets[worst])[0]]]
            new = new[np.argsort(-(new @ y), kind="stable")[:_ADDED]]
            self.rows = np.concatenate([self.rows, new])
        self.rows = self.rows[self.rows @ y > _KEPT_WEIGHT]
        return y / max(1.0, float((sets @ y).max(initial=0.0)))

    def _solve(self) -> NDArray[np.float64]:
        rows = np.concatenate([self._columns, self.rows])
        result = linprog(
            -np.ones(rows.shape[1]),
            A_ub=csr_matrix(rows.astype(float)),
            b_ub=np.ones(len(rows)),
            bounds=(0.0, 1.0),
        )
        return np.clip(result.x, 0.0, None)

    def _forget(self, sets: NDArray[np.bool_]) -> None:
        """Drop the sets of leaves that have been split since: they would hold the weights down for ever."""
        if len(self.rows):
            present = {row.tobytes() for row in np.packbits(sets, axis=1)}
            self.rows = self.rows[
                [row.tobytes() in present for row in np.packbits(self.rows, axis=1)]
            ]
