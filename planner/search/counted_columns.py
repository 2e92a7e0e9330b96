"""Columns counted over displaced poses: what is short is taken out, the cover is chosen again, and others are searched.

Judging a pose asks whether everything holds there, and in a few displaced images. A plan asks more: everything must
hold in the required share of many displaced poses. To count that for every column would take far longer than the
search, so columns are counted only where a cover makes use of them. This is row generation: the pool is a relaxation
of what can be counted, and is tightened where its optimum is.

1. Choose a cover of the columns that are counted and those that are not.
2. Count what is new in it. What holds joins the counted columns, and the judged column leaves the pool. Where little is
   missing, a pose nearby of which a count shows more is searched, and joins them, too (`planner.search.surer_poses`).
3. Repeat until all columns of the cover are counted.
4. Search more columns by prices, which now tell where columns were lost, and begin again.
5. Where the cover is still larger than one of the columns as judged, better poses are searched for the columns of
   that one that no counted column contains. They join the counted columns, and the cover is chosen once more.

Targets that no counted column contains any more are left to the search for settings of their own, see
`planner.search.stages.ShortTargets`.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.callbacks import Checkpoint
from planner.cover import few_columns
from planner.executors import in_order
from planner.search.columns import ColumnPool, Pools, WarmStart, derive_seed, price_poses
from planner.search.incumbents import REFUTING_SHARE, SearchRun, candidate_settings
from planner.search.plan_setting import setting_at
from planner.search.realise_column import (
    Supported,
    keeps,
    poses_stated,
    with_p_all,
    without_contradicted,
)
from planner.search.surer_poses import surer_pose_near
from planner.sensor_setting import SensorSetting

# rounds of column generation between two covers
_ROUNDS = 10
# the search ends after this many covers that are no better than one before
_IN_VAIN = 2
# least gain in the sum of the probabilities. A smaller gain is rounding.
_FITNESS_GAIN = 1e-6
# a pose that is short of the required P_all by this at most is worth a search nearby
_WITHIN_REACH = 0.2
_MOVED = "moved to where more is counted"


class CountedColumns:
    """Columns of which every target has the required P_all, as far as covers make use of them.

    **Guarantee.** Each column of ``counted`` has a pose at which simulation contradicts none of its targets, and at
    which each has the required P_all. Counts do not depend on interruptions, nor on the number of processes.

    Parameters
    ----------
    run : SearchRun
        Its pools hold the columns as judged; they stay as they are.
    inspected : array of bool (k,)
        Targets to cover.

    Attributes
    ----------
    counted : ColumnPool
        What was counted.
    candidates : ColumnPool
        Columns that no cover has used.
    """

    def __init__(self, run: SearchRun, inspected: NDArray[np.bool_]):
        self._run = run
        self._inspected = inspected
        self.counted = ColumnPool(len(run.names))
        self.candidates = ColumnPool.from_dict(run.pool.to_dict())
        self._turn = 0
        self._n_short = 0
        self._in_vain = 0
        self._best = len(inspected) + 1

    @classmethod
    def resumed(
        cls, run: SearchRun, inspected: NDArray[np.bool_], entry: dict[str, Any] | None
    ) -> CountedColumns:
        """Return where an earlier run had got, by an entry of its checkpoint; the beginning without one."""
        columns = cls(run, inspected)
        # targets that are short matter at the beginning only
        if entry is not None:
            columns.counted = ColumnPool.from_dict(entry["counted"])
            columns.candidates = ColumnPool.from_dict(entry["candidates"])
            columns._turn = entry["turn"]
            columns._in_vain = entry["in_vain"]
            columns._best = entry["best"]
        return columns

    def entry(self) -> dict[str, Any]:
        """Return how far this has got, for `resumed`."""
        return {
            "counted": self.counted.to_dict(),
            "candidates": self.candidates.to_dict(),
            "turn": self._turn,
            "in_vain": self._in_vain,
            "best": self._best,
        }

    def search(self, rounds: int, bound: int, checkpoint: Checkpoint) -> None:
        """Count covers and search columns in turn, until covers get no shorter.

        Parameters
        ----------
        rounds : int
            Rounds of column generation at most.
        bound : int
            Settings that are needed at least: fewer are not looked for.
        checkpoint : Checkpoint
            Keeps after each turn how far this has got, as "counted".
        """
        while True:
            needed = self.count_cover()
            self._in_vain = 0 if needed < self._best else self._in_vain + 1
            self._best = min(needed, self._best)
            remaining = rounds - self._turn * _ROUNDS
            nothing_short = not self._turn and not self._n_short
            if nothing_short or needed <= bound or remaining <= 0 or self._in_vain >= _IN_VAIN:
                break
            self._turn += 1
            self._search_columns(min(_ROUNDS, remaining))
            checkpoint.put("counted", self.entry())
        if not nothing_short and needed > bound:
            self.repair(needed)

    def repair(self, needed: int) -> None:
        """Let a cover of the columns as judged join, each column at the best pose that simulation supports.

        Those that a counted column contains are there already. Where that cover alone would do with fewer settings, the
        cover of all counted columns has no more either.

        Parameters
        ----------
        needed : int
            Settings that the counted columns take. A cover of as many columns as judged is of no use.
        """
        run = self._run
        covered = run.pool.inspected & self._inspected
        membership = run.pool.membership[:, covered]
        chosen = few_columns(membership, run.nodes(), run.rng("settings"), run.pool.quality)
        if needed <= len(chosen) + int((self._inspected & ~covered).sum()):
            return
        uncounted = [
            c for c in chosen if self.counted.best_containing(run.pool.membership[c]) is None
        ]
        candidates = candidate_settings(run, run.pool, np.array(uncounted, dtype=int))
        for setting, supported in supported_settings(run, candidates):
            self._add(setting, supported)
        self.count_cover()

    def count_cover(self) -> int:
        """Choose covers until all columns of one are counted; return how many settings that takes.

        Targets that no counted column contains are taken to need one each.
        """
        run = self._run
        nodes = run.nodes(REFUTING_SHARE)
        while True:
            membership = np.concatenate([self.candidates.membership, self.counted.membership])
            quality = np.concatenate([self.candidates.quality, self.counted.quality])
            covered = membership.any(axis=0) & self._inspected
            n_missing = int((self._inspected & ~covered).sum())
            if not covered.any():
                return n_missing
            chosen = few_columns(membership[:, covered], nodes, run.rng("counting"), quality)
            new = chosen[chosen < len(self.candidates)]
            if not new.size:
                return len(chosen) + n_missing
            self._count(new)

    def _count(self, columns: NDArray[np.int_]) -> None:
        """Count candidate columns: what holds of them joins the counted ones."""
        run = self._run
        settings = candidate_settings(run, self.candidates, columns)
        remain = np.ones(len(self.candidates), dtype=bool)
        remain[columns] = False
        self.candidates = _some(self.candidates, remain)
        for k, _ in enumerate(run.simulate(settings), 1):
            run.callbacks.report(k, len(settings), "counted poses")
        nearly = []
        for setting in settings:
            short = run.promises.contradicted_in(setting)
            self._add(setting, set(setting.entities) - set(short))
            self._n_short += len(short)
            if short and max(short.values()) <= _WITHIN_REACH:
                nearly.append(setting)
        for setting in self._surer(nearly):
            self._add(setting, set(setting.entities) - set(run.promises.contradicted_in(setting)))

    def _add(self, setting: SensorSetting, holds: Collection[str]) -> None:
        """Let what holds of a setting join the counted columns."""
        names = self._run.names
        column = np.isin(names, list(holds))
        sure = np.array([setting.probability.get(name, 0.0) for name in names])
        self.counted.add(column[None], setting.cam2world[None], sure[None])

    def _surer(self, nearly: Sequence[SensorSetting]) -> list[SensorSetting]:
        """Return settings near those that are short of little, as far as there are better ones; simulated."""
        run = self._run
        tasks = [
            (
                run.shared,
                setting.cam2world,
                setting.probability,
                derive_seed(run.seed, setting.entities),
            )
            for setting in nearly
        ]
        moved = []
        for k, pose in enumerate(
            in_order(run.executor, surer_pose_near, tasks, run.callbacks.check)
        ):
            run.callbacks.report(k + 1, len(tasks), "surer poses")
            if pose is not None:
                moved.append(
                    setting_at(run.problem, pose, nearly[k].entities, _MOVED, nearly[k].seed)
                )
        for _ in run.simulate(moved):
            pass
        return moved

    def _search_columns(self, rounds: int) -> None:
        """Add candidates by column generation, with prices of what is counted and of what is not counted yet."""
        run = self._run
        both = ColumnPool.from_dict(self.candidates.to_dict())
        both.membership = np.concatenate([both.membership, self.counted.membership])
        both.poses = np.concatenate([both.poses, self.counted.poses])
        both.quality = np.concatenate([both.quality, self.counted.quality])
        old = _keys(both)
        price_poses(
            run.shared,
            Pools(both, run.pools.near),
            derive_seed(run.seed, ["counting", str(self._turn)]),
            rounds,
            run.executor,
            run.callbacks.silent,
            WarmStart(coverable=self._inspected),
        )
        new = _some(both, np.array([key not in old for key in _keys(both)], dtype=bool))
        self.candidates.add(
            new.membership,
            new.poses,
            np.broadcast_to(new.quality[:, None], new.membership.shape),
        )


def _some(pool: ColumnPool, rows: NDArray[np.bool_]) -> ColumnPool:
    """Return some columns of a pool."""
    return ColumnPool.from_dict({name: values[rows] for name, values in pool.to_dict().items()})


def _keys(pool: ColumnPool) -> list[tuple[bytes, bytes]]:
    """Return what tells columns of different poses or targets apart."""
    return [
        (pose.tobytes(), row.tobytes())
        for pose, row in zip(pool.poses, pool.membership, strict=True)
    ]


# Settings of the final cover.


def chosen_settings(
    run: SearchRun, counted: ColumnPool, inspected: NDArray[np.bool_]
) -> list[SensorSetting]:
    """Choose the final cover from counted columns, and return for each the best pose that simulation supports.

    Parameters
    ----------
    run : SearchRun
        Its request says what is asked.
    counted : ColumnPool
        The columns.
    inspected : array of bool (k,)
        Targets to cover, as far as these columns contain them.
    """
    covered = counted.inspected & inspected
    chosen = few_columns(
        counted.membership[:, covered], run.nodes(), run.rng("settings"), counted.quality
    )
    supported = supported_settings(run, candidate_settings(run, counted, chosen))
    return without_contradicted(run.problem, supported)


def already_there(
    run: SearchRun, chosen: Sequence[SensorSetting], ready: Sequence[SensorSetting]
) -> tuple[list[SensorSetting], list[SensorSetting]]:
    """Return settings of another plan that serve for chosen ones from where they are, and the other chosen ones.

    Parameters
    ----------
    run : SearchRun
        Its request says what is asked.
    chosen : sequence of SensorSetting
        One for each column of the cover.
    ready : sequence of SensorSetting
        Settings of the other plan, off their limits already.
    """
    if not ready:
        return [], list(chosen)
    there = []
    others = []
    unused = list(ready)
    inspects = list(run.judge(np.array([setting.cam2world for setting in ready])).inspects)
    poses = poses_stated(sum(len(setting.entities) for setting in chosen))
    for candidate in chosen:
        names = candidate.entities
        column = np.isin(run.names, names)
        index = next((k for k in range(len(unused)) if inspects[k][column].all()), None)
        if index is None:
            others.append(candidate)
            continue
        old = unused[index]
        setting = setting_at(run.problem, old.cam2world, names, old.message, old.seed, old.nfev)
        setting = replace(setting, generations=old.generations)
        contradicted = run.promises.contradicted_in(setting)
        setting = with_p_all(run.judge, setting, derive_seed(run.seed, names), poses)
        if contradicted or not all(keeps(run.judge, p) for p in setting.p_all.values()):
            others.append(candidate)
            continue
        there.append(setting)
        del unused[index], inspects[index]
    return there, others


def supported_settings(run: SearchRun, candidates: Sequence[SensorSetting]) -> list[Supported]:
    """Return for each candidate pose the best pose that simulation supports, the candidate itself if it is enough.

    Parameters
    ----------
    run : SearchRun
        Its effort says what is enough.
    candidates : sequence of SensorSetting
        As judged.
    """
    enough = run.effort.good_enough
    good = [
        k for k, candidate in enumerate(candidates) if min(candidate.probability.values()) > enough
    ]
    # what was simulated on the way is not simulated again
    for _ in run.simulate([candidates[k] for k in good]):
        pass
    plain = [k for k in good if not run.promises.contradicted_in(candidates[k])]
    supported = {k: Supported(candidates[k], frozenset(candidates[k].entities)) for k in plain}
    others = [k for k in range(len(candidates)) if k not in supported]
    searched = _searched(run, [candidates[k] for k in others])
    supported.update(zip(others, searched, strict=True))
    return [supported[k] for k in range(len(candidates))]


def _searched(run: SearchRun, candidates: Sequence[SensorSetting]) -> list[Supported]:
    """Search a better pose for each candidate pose, and return the better one that simulation supports."""
    options = []
    outcomes = run.realise([column.entities for column in candidates])
    for candidate, outcome in zip(candidates, outcomes, strict=True):
        setting = outcome.setting
        both = [candidate]
        if setting is not None and _holds(run, setting, candidate.entities):
            both.insert(setting.fitness < candidate.fitness - _FITNESS_GAIN, setting)
        options.append(both)
    return run.supported(options)


def _holds(run: SearchRun, setting: SensorSetting, names: tuple[str, ...]) -> bool:
    """Judge a setting anew: whether it inspects all these entities."""
    return bool(run.judge(setting.cam2world[None]).inspects[0, np.isin(run.names, names)].all())
