"""The fewest lamps for sets of pairs, with a proof: columns from places that were found, and sets proven impossible.

A *job* is what one lamp has to show at once: all of a setting, or one entity where no lamp shows all. A set of jobs is
*realised* by a place that does them all, and *refuted* where no place of the space can, as the exact regions have no
cell there. Both pass to subsets and supersets. The smallest cover by sets that are not refuted bounds the number from
below; its sets are decided one after the other until it is realised, or too many were tried.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from planner.cover.set_cover import maximal_columns, min_cover

Jobs = frozenset[int]
Decide = Callable[[Jobs], bool]
"""Looks for a place that does some jobs at once, and adds it; returns whether it is proven that there is none."""

# beyond so many jobs the sets are not listed, and pairs that exclude each other bound the number
_MOST_LISTED = 14
_MOST_DECISIONS = 200


@dataclass
class Search:
    """What is known of sets of jobs."""

    n: int
    columns: Callable[[], NDArray[np.bool_]]
    decide: Decide
    refuted: set[Jobs] = field(default_factory=set)
    tried: set[Jobs] = field(default_factory=set)

    def bound(self) -> int:
        """Decide sets until the bound is reached by the columns, or can no longer be raised; return it."""
        for i, j in combinations(range(self.n), 2):
            self._try(frozenset((i, j)))
        if self.n > _MOST_LISTED:
            return self._clique()
        while True:
            open_sets = self._optimistic()
            cover = min_cover(open_sets)
            chosen = [frozenset(np.flatnonzero(open_sets[c]).tolist()) for c in cover.chosen]
            new = [jobs for jobs in chosen if not self._realised(jobs) and jobs not in self.tried]
            if not new or len(self.tried) >= _MOST_DECISIONS:
                return cover.lower_bound
            for jobs in new:
                self._try(jobs)

    def _realised(self, jobs: Jobs) -> bool:
        return bool(self.columns()[:, sorted(jobs)].all(axis=1).any())

    def _try(self, jobs: Jobs) -> None:
        if len(self.tried) >= _MOST_DECISIONS or jobs in self.tried or self._realised(jobs):
            return
        self.tried.add(jobs)
        if self.decide(jobs):
            self.refuted.add(jobs)

    def _optimistic(self) -> NDArray[np.bool_]:
        """Return the largest sets of jobs that are not refuted, as rows."""
        sets = (np.arange(1, 1 << self.n)[:, None] >> np.arange(self.n)) & 1 == 1
        for jobs in self.refuted:
            sets = sets[~sets[:, sorted(jobs)].all(axis=1)]
        return np.asarray(sets[maximal_columns(sets)])

    def _clique(self) -> int:
        """Return how many jobs were found of which no two can be done at once."""
        best = 1
        for first in range(self.n):
            apart = [first]
            for job in range(self.n):
                if all(frozenset((job, other)) in self.refuted for other in apart):
                    apart.append(job)
            best = max(best, len(apart))
        return best
