"""The linear part of the lower bound: weights that no single pose exceeds, and the poses that do.

The entities get weights y >= 0. If no pose inspects more than W of them, sum(y) / W settings are needed at least
(linear programming duality). The space of poses (`planner.looks`) is searched for poses that inspect more than the next
number of settings allows. If there is none, that number is proven. If there are some, what they inspect is added to the
columns that the weights come from, and they are computed anew. This is column generation with an exact oracle (Gilmore
& Gomory 1961), so the same search also finds poses for the plan that no random search has come across.

The weights are the mean of several optimal duals of the cover by these columns: a single one rests on few entities, so
that a box either holds one more of them or does not, where with the mean every bit that it is smaller tells.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing

import numpy as np

from planner.cover import maximal_columns, mean_dual
from planner.looks import PoseSpace
from planner.posesearch import PROVEN, SPENT
from planner.progress import report

_DUALS = 8
# duals are looked for that maximise the weights times factors from 1 to this
_BIAS = 1.5
_LEAST_WEIGHT = 1e-3
_SLACK = 1e-6
# boxes looked at in a part of the space of poses: at first, and so many times more where that does not decide
_FIRST_NODES = 8000
_MORE_NODES = 4
# of the boxes that a proof needed before, for other weights
_NEEDED_AGAIN = 1.5
# so many sweeps of all parts must be possible
_LEAST_SWEEPS = 8
# of the boxes, for the number of settings that is aimed at first
_SHARE_AT_FIRST = 0.88
# once that is proven, of the boxes that may have been looked at when the next one is decided
_SHARE_OF_NEXT = 0.5
# no number of settings is aimed at first that needs weights to be closer to the limit
_LEAST_LIMIT = 1.15
# too heavy poses taken from one part at a time
_MOST_FOUND = 8


def spread_weights(columns: np.ndarray) -> np.ndarray:
    """Return weights (e,) of entities, the heaviest of the columns (c, e) weighing 1; small ones are made 0."""
    columns = columns[maximal_columns(columns)]
    y = mean_dual(columns, _BIAS, _DUALS)
    y[y < _LEAST_WEIGHT] = 0.0
    return y / (columns @ y).max()


class _Parts:
    """Which parts of the space of poses have a proof for the present weights.

    Those that had one for earlier weights are likely to have one again, so they wait until the others are done.
    """

    def __init__(self, n: int):
        self.proven, self.waits = np.zeros((2, n), dtype=bool)
        self.needed = np.zeros(n, dtype=int)

    def learn(self, parts: np.ndarray, proven: np.ndarray, made: np.ndarray) -> None:
        """Take in what a sweep of some parts proved, and how many boxes that took."""
        self.proven[parts] = proven
        self.needed[parts[proven]] = made[proven]

    def all_wait(self) -> bool:
        """Tell whether all parts without a proof wait."""
        return bool((self.proven | self.waits).all())

    def renew(self) -> None:
        """The weights or the limit are about to change."""
        self.waits |= self.proven
        self.proven = np.zeros_like(self.proven)


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

    Attributes
    ----------
    made : int
        Boxes of poses looked at.
    found : array of bool (f, e)
        What the poses found inspect, by the necessary conditions.
    """

    def __init__(
        self, space: PoseSpace, columns: np.ndarray, improve: Callable[[np.ndarray], np.ndarray] | None = None
    ):
        self.space, self.improve = space, improve
        self.columns = np.asarray(columns, dtype=bool)
        self.found = self.columns[:0]
        self.made = 0

    def raise_from(self, bound: int, n_settings: int, *, max_nodes: int, progress=None) -> int:
        """Return what is proven, given what is proven already; at most ``n_settings``.

        Looks at ``max_nodes`` boxes of poses at most. A large number of settings is aimed at first: what is found on
        the way counts for the smaller ones as well, and what is proven of a part holds for larger limits.
        """
        parts = _Parts(len(self.space.parts))
        first = min(_FIRST_NODES, max_nodes // (_LEAST_SWEEPS * len(parts.proven)) + 1)
        y = self._weights()
        target = min(n_settings, max(bound, int(float(y.sum()) / _LEAST_LIMIT)) + 1)
        most, allowed = first, _SHARE_AT_FIRST * max_nodes
        while bound < target:
            limit = float(y.sum()) / (target - 1) - _SLACK
            if parts.all_wait():
                parts.waits[:] = False
                most = first
            left = np.flatnonzero(~parts.proven & ~parts.waits)
            # sum(y) is all that weights can prove
            asked = np.maximum(most, (_NEEDED_AGAIN * parts.needed[left]).astype(int))
            if limit <= 1.0 or self.made + most * len(left) > allowed:
                n_settings = target = target - 1
                most, allowed = first, max_nodes
                continue
            outcomes, made, poses, sets = self._sweep(left, y, limit, asked, max_nodes, progress)
            parts.learn(left, outcomes == PROVEN, made)
            n_spent = int((outcomes == SPENT).sum())
            most *= _MORE_NODES
            if self.made + most * n_spent > allowed:
                # what is proven for a smaller limit is proven for this one
                n_settings = target = target - 1
                most, allowed = first, max_nodes
            if len(sets):
                self._learn(poses, sets)
                parts.renew()
                y, most = self._weights(), first
            elif parts.proven.all():
                bound, most = max(bound, target), first
                parts.renew()
                target, allowed = min(bound + 1, n_settings), min(allowed, _SHARE_OF_NEXT * max_nodes)
            elif n_spent == 0 and not parts.waits.any():
                # boxes too small to be halved
                break
        return bound

    def _weights(self) -> np.ndarray:
        return spread_weights(np.concatenate([self.columns, self.found]))

    def _learn(self, poses: np.ndarray, sets: np.ndarray) -> None:
        """Take in poses that are too heavy and what they inspect, by the necessary conditions."""
        self.found = np.concatenate([self.found, sets])
        if self.improve is not None:
            self.columns = self.improve(poses)

    def _sweep(self, parts: np.ndarray, y: np.ndarray, limit: float, most, max_nodes: int, progress) -> tuple:
        """Search parts of the space; return outcomes and boxes looked at, and poses found with what they inspect."""

        def tick() -> None:
            report(progress, min(self.made, max_nodes), max_nodes, "lower bound")

        done = []
        with closing(self.space.search(y, limit, most, tick, parts=parts, most=_MOST_FOUND)) as results:
            for found in results:
                done.append(found)
                self.made += found.made
                tick()
        poses, sets = (np.concatenate([getattr(found, name) for found in done]) for name in ("poses", "sets"))
        outcomes, made = np.array([(found.outcome, found.made) for found in done]).T
        return outcomes, made, poses, sets
