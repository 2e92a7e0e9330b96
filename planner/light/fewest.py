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
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import csr_matrix

from planner.cover.set_cover import maximal_columns, min_cover

Jobs = frozenset[int]
Decide = Callable[[Jobs], bool]
"""Looks for a place that does some jobs at once, and adds it; returns whether it is proven that there is none."""

# beyond so many jobs the sets are not listed: the jobs are shared out among ever more lamps instead
_MOST_LISTED = 14
_MOST_DECISIONS = 300
_NODES = 20_000


@dataclass
class LampSearch:
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
            return self._shared_out()
        while True:
            open_sets = self._optimistic()
            cover = min_cover(open_sets)
            chosen = [frozenset(np.flatnonzero(open_sets[c]).tolist()) for c in cover.chosen]
            new = [jobs for jobs in chosen if not self._realised(jobs) and jobs not in self.tried]
            if not new or len(self.tried) >= _MOST_DECISIONS:
                return cover.lower_bound
            for jobs in new:
                self._try(jobs)

    def _shared_out(self) -> int:
        """Raise the bound from jobs that exclude each other as long as no way to share out jobs is left."""
        bound = self._clique()
        while bound < len(min_cover(self.columns()).chosen):
            groups = self._sharing(bound)
            if groups is None:
                bound += 1
                continue
            new = [jobs for jobs in groups if not self._realised(jobs) and jobs not in self.tried]
            if not new or len(self.tried) >= _MOST_DECISIONS:
                break
            for jobs in new:
                self._try(jobs)
        return bound

    def _sharing(self, n_lamps: int) -> list[Jobs] | None:
        """Share out the jobs among lamps so that no lamp has a refuted set; None if that is proven impossible.

        An integer programme in x[job, lamp]: every job has a lamp, and of every refuted set a lamp lacks a job. The
        first jobs take the first lamps, as lamps are alike. If it is undecided, nothing is shared out.
        """
        n = self.n * n_lamps
        place = np.arange(n).reshape(self.n, n_lamps)
        rows = []
        most = []
        for jobs in sorted(self.refuted, key=sorted):
            for lamp in range(n_lamps):
                row = np.zeros(n)
                row[place[sorted(jobs), lamp]] = 1
                rows.append(row)
                most.append(len(jobs) - 1)
        each = np.zeros((self.n, n))
        for job in range(self.n):
            each[job, place[job]] = 1
        free = np.ones((self.n, n_lamps))
        free[np.arange(n_lamps) > np.arange(self.n)[:, None]] = 0
        limits = [LinearConstraint(csr_matrix(each), 1, 1)]
        if rows:
            limits.append(LinearConstraint(csr_matrix(np.array(rows)), -np.inf, most))
        found = milp(
            np.zeros(n),
            integrality=np.ones(n),
            bounds=Bounds(0, free.ravel()),
            constraints=limits,
            options={"node_limit": _NODES},
        )
        if found.x is None:
            return None if found.status == 2 else []
        lamps = found.x.reshape(self.n, n_lamps) > 0.5
        return [frozenset(np.flatnonzero(column).tolist()) for column in lamps.T if column.any()]

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
