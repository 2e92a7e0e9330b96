"""Covers by candidate poses of which simulation supports what is counted on.

A cover by columns as judged may promise more than a simulation of their poses supports: the probability is of second
order, and does not count ends that leave the image. So what a cover takes is simulated, what is contradicted is taken
out of these columns, and a cover is chosen again, until all of it has been simulated: a relaxation, tightened where a
cover makes use of it.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from planner.columns.candidates import derive_seed
from planner.columns.pool import ColumnPool
from planner.cover.exchange_search import exchange_columns
from planner.cover.set_cover import bound_columns, greedy_cover
from planner.setting.pose_setting import setting_at, without
from planner.setting.sensor_setting import SensorSetting
from planner.steps.run import SILENT_S, Run


class SupportedColumns:
    """What simulation supports of the candidate poses that were tried, each of them once."""

    def __init__(self) -> None:
        # None if nothing is stated of the pose
        self._tried: dict[tuple[bytes, tuple[str, ...]], SensorSetting | None] = {}
        # poses that promise an edge, and that simulation contradicts there
        self._in_vain: Counter[str] = Counter()

    def cover(
        self, run: Run, pool: ColumnPool, beaten: tuple[int, int], covers: int | None = None
    ) -> list[SensorSetting] | None:
        """Choose few columns of a pool that simulation supports, for as many entities as possible.

        Parameters
        ----------
        run : Run
            Its request says what is asked, its seed how poses are displaced.
        pool : ColumnPool
        beaten : (int, int)
            Entities of a plan known, and minus its settings: what is not better is not looked for further.
        covers : int
            Covers that are simulated at most. Default: as many as the effort says.

        Returns
        -------
        list of SensorSetting or None
            None if none better was found.
        """
        trying = run.effort.stages.trying
        covers = trying.covers if covers is None else covers
        membership, done = self._corrected(run, pool)
        chosen = _short_cover(membership, beaten, run.rng("incumbent"), trying.exchanges)
        for k in range(covers):
            if chosen is None:
                return None
            new = [c for c in chosen.tolist() if not done[c]]
            if not new:
                break
            begun = time.monotonic()
            untried = [c for c in new if _key(run, pool, c) not in self._tried]
            for i, _ in enumerate(run.simulate(candidate_settings(run, pool, untried)), 1):
                # what is soon done needs no line
                if time.monotonic() - begun > SILENT_S:
                    run.callbacks.report(i, len(untried), "checked poses")
            for c in new:
                membership[c] = self._supported(run, pool, c)
                done[c] = True
            self._give_up(run, membership, done)
            if k + 1 < covers:
                chosen = _short_cover(membership, beaten, run.rng("incumbent"), trying.exchanges)
            known = np.where(done[:, None], membership, False)
            own = _short_cover(known, beaten, run.rng("incumbent"), trying.exchanges)
            if k + 1 == covers or (
                own is not None and chosen is not None and _as_good(membership, own, chosen)
            ):
                chosen = own
        return None if chosen is None else self._as_settings(run, pool, chosen)

    def _corrected(self, run: Run, pool: ColumnPool) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Return the columns of a pool (c, k) as far as they are known to be supported, and which (c,) were tried."""
        membership = pool.membership.copy()
        done = np.zeros(len(pool), dtype=bool)
        for c in range(len(pool) if self._tried else 0):
            if _key(run, pool, c) in self._tried:
                membership[c] = self._supported(run, pool, c)
                done[c] = True
        self._give_up(run, membership, done)
        return membership, done

    def _give_up(self, run: Run, membership: NDArray[np.bool_], done: NDArray[np.bool_]) -> None:
        """Clear the edges that no pose tried supports, although many promise them."""
        in_vain = run.effort.stages.trying.in_vain
        often = np.array([self._in_vain[name] >= in_vain for name in run.names])
        membership[:, often & ~membership[done].any(axis=0)] = False

    def _supported(self, run: Run, pool: ColumnPool, c: int) -> NDArray[np.bool_]:
        """Return which entities (k,) of a column simulation supports; it is tried if it was not."""
        key = _key(run, pool, c)
        if key not in self._tried:
            supported = as_simulated(run, candidate_settings(run, pool, [c]))
            tried = supported[0] if supported else None
            self._tried[key] = tried
            self._in_vain.update(set(key[1]) - set(_entities(tried)))
        return np.isin(run.names, _entities(self._tried[key]))

    def _as_settings(
        self, run: Run, pool: ColumnPool, chosen: NDArray[np.int_]
    ) -> list[SensorSetting]:
        tried = [self._tried[_key(run, pool, c)] for c in chosen.tolist()]
        return [setting for setting in tried if setting is not None]


def candidate_settings(run: Run, pool: ColumnPool, columns: Iterable[int]) -> list[SensorSetting]:
    """Return the poses of columns as settings."""
    wanted = [(pool.poses[c], run.names_of(pool.membership[c])) for c in columns]
    return [
        setting_at(run.request, pose, names, "candidate pose", seed=derive_seed(run.seed, names))
        for pose, names in wanted
    ]


def as_simulated(run: Run, settings: Iterable[SensorSetting]) -> list[SensorSetting]:
    """Return settings that state what simulation does not contradict; those that state nothing are left out."""
    supported = []
    for setting in settings:
        wrong = run.promises.contradicted_in(setting)
        kept = without(run.request, setting, list(wrong)) if wrong else setting
        supported.append(run.promises.with_bounds(kept))
    return [setting for setting in supported if setting.entities]


def _key(run: Run, pool: ColumnPool, c: int) -> tuple[bytes, tuple[str, ...]]:
    return pool.poses[c].tobytes(), run.names_of(pool.membership[c])


def _entities(tried: SensorSetting | None) -> tuple[str, ...]:
    return () if tried is None else tried.entities


def _short_cover(
    membership: NDArray[np.bool_], beaten: tuple[int, int], rng: np.random.Generator, steps: int
) -> NDArray[np.int_] | None:
    """Return few columns that cover all that columns (c, k) contain, or None if that is not better than a plan known.

    It is better if it has more entities, or as many in fewer columns. The greedy cover, and what
    exchanges make of it in so many steps.
    """
    covered = membership.any(axis=0)
    membership = membership[:, covered]
    known = beaten[0]
    fewer_than = -beaten[1]
    if not covered.any() or covered.sum() < known:
        return None
    chosen: NDArray[np.int_] | None = None
    if covered.sum() > known:
        chosen = np.array(greedy_cover(membership))
        fewer_than = len(chosen)
    fewest = bound_columns(membership)
    while fewer_than > fewest:
        found = exchange_columns(membership, fewer_than - 1, steps=steps, rng=rng)
        if found.missing:
            break
        chosen = found.chosen
        fewer_than = len(found.chosen)
    return None if chosen is None else np.sort(chosen)


def _as_good(
    membership: NDArray[np.bool_], some: NDArray[np.int_], other: NDArray[np.int_]
) -> bool:
    """Tell whether some columns cover as many entities as others, and are no more."""
    return len(some) <= len(other) and bool(
        membership[some].any(axis=0).sum() >= membership[other].any(axis=0).sum()
    )
