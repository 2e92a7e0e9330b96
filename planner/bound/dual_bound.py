"""The linear part of the lower bound: weights that no single pose exceeds, and the poses that do.

The entities get weights y >= 0. If no pose inspects more than W of them, sum(y) / W settings are needed at least
(linear programming duality). The space of poses (`planner.bound.pose_space`) is searched for poses that inspect more
than the next number of settings allows. If there is none, that number is proven. If there are some, what they inspect
is added to the columns that the weights come from, and they are computed anew. This is column generation with an exact
oracle (Gilmore & Gomory 1961), so the same search also finds poses for the plan that no random search has come across.

What is proven for some weights and a limit is proven for weights nowhere larger and for larger limits. So the limit
leaves some to spare, and a few poses that exceed it only make the weights of what they inspect smaller; new weights,
for which every part of the space is to be searched again, are computed when that no longer does.

The weights are the mean of several optimal duals of the cover by these columns: a single one rests on few entities, so
that a box either holds one more of them or does not, where with the mean every bit that it is smaller tells.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linprog
from scipy.sparse import csr_matrix

from planner.bound.boxes.search import PROVEN, SPENT
from planner.bound.pose_space import Found, PoseSpace
from planner.cover.relaxation import mean_dual
from planner.cover.set_cover import maximal_columns
from planner.ledger import Ledger
from planner.progress import report

_DUALS = 16
# duals are looked for that maximise the weights times factors from 1 to this
_BIAS = 1.5
_LEAST_WEIGHT = 1e-3
_SLACK = 1e-6
# no pose may weigh more than this share less than would do, so that a few that do need no new weights; at most this
# share of what the limit is above 1
_SPARE, _SPARE_OF_ROOM = 0.01, 0.25
# weights keep away from poses found by so much
_LESS = 0.999
# boxes looked at in a part of the space of poses: at first, and so many times more where that does not decide
_FIRST_NODES = 8000
_MORE_NODES = 4
# after so many times as many as at first, the weights had better keep away
_HARD = 16
# of the boxes that a proof needed before, for other weights
_NEEDED_AGAIN = 1.5
# so many sweeps of all parts must be possible
_LEAST_SWEEPS = 8
# of the boxes left, for a number of settings below which others are still to be proven
_SHARE_AT_FIRST = 0.65
# once one is proven, of the boxes that may have been looked at when the next one is given up
_SHARE_OF_NEXT = 0.6
# no number of settings is aimed at first that needs weights to be closer to the limit, nor after one is proven
_LEAST_LIMIT, _LEAST_LIMIT_OF_NEXT = 1.15, 1.06
# nor any longer once poses found bring the limit this near to 1, or one setting this near to a whole one
_NEAR_ONE, _NEAR_SETTING = 0.02, 0.3
# too heavy poses taken from one part at a time
_MOST_FOUND = 8


def spread_weights(columns: np.ndarray) -> np.ndarray:
    """Return weights (e,) of entities, the heaviest of the columns (c, e) weighing 1; small ones are made 0."""
    columns = columns[maximal_columns(columns)]
    y = mean_dual(columns, _BIAS, _DUALS)
    y[y < _LEAST_WEIGHT] = 0.0
    return y / (columns @ y).max()


def limit_for(y: np.ndarray, target: int) -> float:
    """Return what no pose may weigh for weights y (e,) to prove so many settings, with some to spare."""
    limit = float(y.sum()) / max(1, target - 1)
    return limit - min(_SPARE * limit, _SPARE_OF_ROOM * abs(limit - 1.0)) - _SLACK


def relieved(y: np.ndarray, sets: np.ndarray, limit: float) -> np.ndarray:
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


class _Parts:
    """What is known of the parts of the space of poses: which have a proof for the present weights, and what it took.

    Those that had one for earlier weights are likely to have one again, so they wait until the others are done.
    """

    def __init__(self, n: int, first: int):
        self.proven, self.waits = np.zeros((2, n), dtype=bool)
        # boxes to be looked at when a part is searched next
        self.worth, self.first = np.full(n, first), first

    def next_ones(self, affordable: int) -> tuple[np.ndarray, np.ndarray] | None:
        """Return the parts to be searched next and how many boxes of each; None if that is more than affordable."""
        if (self.proven | self.waits).all():
            self.waits[:] = False
        parts = np.flatnonzero(~self.proven & ~self.waits)
        return (parts, self.worth[parts]) if self.worth[parts].sum() <= affordable else None

    def learn(self, parts: np.ndarray, outcomes: np.ndarray, made: np.ndarray) -> np.ndarray:
        """Take in what a search of some parts gave, and how many boxes that took; tell which are too hard.

        There, some set of entities weighs too much and nearly can be inspected.
        """
        proven, spent = outcomes == PROVEN, outcomes == SPENT
        self.proven[parts] = proven
        self.worth[parts[proven]] = np.maximum(_NEEDED_AGAIN * made[proven], self.first)
        self.worth[parts[spent]] = _MORE_NODES * made[spent]
        hard = spent & (made >= _HARD * self.first)
        self.worth[parts[hard]] = self.first
        return hard

    def ease(self) -> None:
        """The limit is about to be raised: what is proven stays so, and the rest may take little."""
        self.worth[~self.proven] = self.first

    def renew(self) -> None:
        """The weights or the limit are about to change."""
        self.waits |= self.proven
        self.proven = np.zeros_like(self.proven)

    def to_dict(self) -> dict:
        """Return copies of the fields, for `from_dict`."""
        arrays = {name: getattr(self, name).copy() for name in ("proven", "waits", "worth")}
        return {**arrays, "first": self.first}

    @classmethod
    def from_dict(cls, data: dict) -> _Parts:
        """Build from the result of `to_dict`."""
        parts = cls(len(data["worth"]), data["first"])
        parts.proven, parts.waits, parts.worth = data["proven"], data["waits"], data["worth"]
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
    """

    bound: int
    target: int
    y: np.ndarray
    limit: float
    least: float
    allowed: float
    undecided: bool
    parts: _Parts

    def to_dict(self) -> dict:
        """Return the fields, for `from_dict`; the arrays do not change any more."""
        return {**self.__dict__, "y": self.y.copy(), "parts": self.parts.to_dict()}

    @classmethod
    def from_dict(cls, data: dict) -> _Course:
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
        ``improve(poses)`` is told of poses (f, 4, 4) that inspect more than the weights foresee; it returns the columns
        known to be realisable from then on.
    ledger : Ledger, optional
        Is told how far this has got, at every sweep and part; what it holds already is where this goes on.

    Attributes
    ----------
    made : int
        Boxes of poses looked at.
    found : array of bool (f, e)
        What the poses found inspect, by the necessary conditions, or might inspect where that is hard to tell.
    """

    def __init__(
        self,
        space: PoseSpace,
        columns: np.ndarray,
        improve: Callable[[np.ndarray], np.ndarray] | None = None,
        ledger: Ledger | None = None,
    ):
        self.space, self.improve = space, improve
        self.ledger = ledger or Ledger()
        self.columns = np.asarray(columns, dtype=bool)
        self.found = self.columns[:0]
        self.made = 0
        self._poses: list[np.ndarray] = []
        # of a sweep that was interrupted, what came out of its first parts
        self._swept: list[Found] = []

    def raise_from(self, bound: int, n_settings: int, *, max_nodes: int, progress=None) -> int:
        """Return what is proven, given what is proven already; at most ``n_settings``.

        Looks at ``max_nodes`` boxes of poses at most. A large number of settings is aimed at first: what is found on
        the way counts for the smaller ones as well, and what is proven of a part holds for larger limits.
        """
        kept = self.ledger("linear")
        at = self._start(bound, n_settings, max_nodes) if kept is None else self._resume(kept)
        parts = at.parts
        while at.bound < at.target:
            # weights prove no more than their sum, and hardly that
            hopeless = at.limit <= at.least or at.undecided
            asked = None if hopeless else parts.next_ones(int(at.allowed) - self.made)
            if asked is None:
                # what is proven for a smaller limit is proven for this one; what is to spare must not make it smaller
                parts.ease()
                at.target, at.undecided = at.target - 1, False
                at.allowed = self._share(max_nodes, at.target - at.bound)
                at.limit = max(at.limit, limit_for(at.y, at.target))
                continue
            outcomes, made, sets, doubts = self._sweep(at, *asked, max_nodes, progress)
            hard = parts.learn(asked[0], outcomes, made)
            sets = np.concatenate([sets, doubts[hard]])
            if len(sets):
                self._make_room(at, sets)
            elif parts.proven.all():
                at.bound = max(at.bound, at.target)
                parts.renew()
                at.target, at.allowed = min(at.bound + 1, n_settings), _SHARE_OF_NEXT * max_nodes
                at.limit, at.least = limit_for(at.y, at.target), _LEAST_LIMIT_OF_NEXT
            else:
                # boxes too small to be halved: more of them would not decide
                at.undecided = not (outcomes == SPENT).any() and not parts.waits.any()
        self._improve()
        return at.bound

    def _start(self, bound: int, n_settings: int, max_nodes: int) -> _Course:
        """Return where to begin."""
        n_parts = len(self.space.parts)
        parts = _Parts(n_parts, min(_FIRST_NODES, max_nodes // (_LEAST_SWEEPS * n_parts) + 1))
        y = self._weights()
        target = min(n_settings, max(bound, int(float(y.sum()) / _LEAST_LIMIT)) + 1)
        least = 1.0 + min(_NEAR_ONE, _NEAR_SETTING / max(1, target - 1))
        allowed = self._share(max_nodes, target - bound)
        return _Course(bound, target, y, limit_for(y, target), least, allowed, False, parts)

    def _resume(self, kept: dict) -> _Course:
        """Go on from what was told of a sweep; return where that is."""
        self.found, self.made = kept["found"], kept["made"]
        self._poses = [kept["poses"]] if len(kept["poses"]) else []
        self.space.regrow(kept["viewpoints"])
        self._swept = _unpacked(kept["swept"])
        return _Course.from_dict(kept["course"])

    def _make_room(self, at: _Course, sets: np.ndarray) -> None:
        """Make the weights smaller where sets found exceed the limit; compute them anew if that is too much."""
        self.found = np.concatenate([self.found, sets])
        lighter = relieved(at.y, sets, at.limit)
        if lighter.sum() > at.limit * (at.target - 1) + _SLACK:
            # what is proven for larger weights is proven for these
            at.y = lighter
            return
        self._improve()
        at.parts.renew()
        at.y = self._weights()
        at.limit = limit_for(at.y, at.target)

    def _share(self, max_nodes: int, ahead: int) -> float:
        """Return how many boxes may have been looked at when a number of settings so far ahead is given up."""
        return max_nodes if ahead <= 1 else self.made + _SHARE_AT_FIRST * (max_nodes - self.made)

    def _weights(self) -> np.ndarray:
        return spread_weights(np.concatenate([self.columns, self.found]))

    def _improve(self) -> None:
        """Tell of the poses found since the last time."""
        if self._poses and self.improve is not None:
            self.columns = self.improve(np.concatenate(self._poses))
        self._poses = []

    def _sweep(self, at: _Course, parts: np.ndarray, most: np.ndarray, max_nodes: int, progress) -> tuple:
        """Search parts of the space; return outcomes, boxes looked at, what poses found inspect, and doubts."""

        def tick() -> None:
            report(progress, min(self.made, max_nodes), max_nodes, "lower bound")

        tell = self._teller(at)
        done, self._swept = self._swept, []
        self.made += sum(found.made for found in done)
        left = slice(len(done), None)
        search = self.space.search(at.y, at.limit, most[left], tick, parts=parts[left], most=_MOST_FOUND)
        with closing(search) as results:
            for found in results:
                done.append(found)
                self.made += found.made
                tell(tuple(done))
                tick()
        self._poses.extend(found.poses for found in done if len(found.poses))
        outcomes, made = np.array([(found.outcome, found.made) for found in done]).T
        return outcomes, made, np.concatenate([found.sets for found in done]), np.array([found.doubt for found in done])

    def _teller(self, at: _Course) -> Callable[[tuple[Found, ...]], None]:
        """Return what tells the ledger of a sweep's parts that are done; all else is as it is before the sweep."""
        poses = np.concatenate([np.zeros((0, 4, 4)), *self._poses])
        before = {"course": at.to_dict(), "found": self.found, "made": self.made, "poses": poses}

        def tell(done: tuple[Found, ...]) -> None:
            viewpoints = self.space.grown_for()
            self.ledger.tell("linear", {**before, "viewpoints": viewpoints, "swept": lambda: _packed(done)})

        return tell


def _packed(done: tuple[Found, ...]) -> dict:
    """Return what came out of parts, one at least, as a few arrays, for `_unpacked`."""
    return {
        "outcome": np.array([found.outcome for found in done]),
        "made": np.array([found.made for found in done]),
        "doubt": np.array([found.doubt for found in done]),
        "n_poses": np.array([len(found.poses) for found in done]),
        "poses": np.concatenate([found.poses for found in done]),
        "sets": np.concatenate([found.sets for found in done]),
    }


def _unpacked(packed: dict) -> list[Found]:
    """Return what `_packed` made few arrays of."""
    cuts = np.cumsum(packed["n_poses"])[:-1]
    poses, sets = np.split(packed["poses"], cuts), np.split(packed["sets"], cuts)
    rows = zip(packed["outcome"].tolist(), packed["made"].tolist(), poses, sets, packed["doubt"], strict=True)
    return [Found(*row) for row in rows]
