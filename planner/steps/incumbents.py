"""The best plan so far, while a run goes on: an upper bound that can be used at once.

An incumbent is a whole plan: a cover by the columns found so far, each with the candidate pose it was found at,
supported by simulation. It is told of whenever it or its bound gets better. Nothing in a run depends on it, so a run
that is watched ends with the same plan as one that is not.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from planner.columns.candidates import column_seed, first_poses
from planner.columns.pool import ColumnPool
from planner.columns.realise_column import best_supported, without_contradicted
from planner.cover.exchange_search import exchange_columns
from planner.cover.few_columns import few_columns
from planner.cover.set_cover import greedy_cover
from planner.plan import InspectionPlan
from planner.setting.pose_setting import setting_at
from planner.setting.sensor_setting import SensorSetting
from planner.steps.assemble import assembled
from planner.steps.run import SHARES, Run
from planner.steps.told_on_grid import told_on_grid, without
from planner.watch import Watch

_TRIVIAL = "Fewer settings than one inspect nothing; the proof of a larger bound had not begun."
_SO_FAR = (
    "Covering by optimistic columns, boxes of camera poses checked against necessary conditions (visibility, focus, "
    "sensor size, length of the image), as far as the proof had got."
)


@dataclass(frozen=True)
class Improving:
    """How hard a better incumbent is looked for.

    Attributes
    ----------
    exchanges : int
        Steps of the exchange search for a cover of one column less.
    rounds : int
        Of column generation, from one look to the next.
    directions : tuple of int
        From so many each entity is looked at, at the first glances.
    others : int
        Candidate poses simulated at most for an entity that simulation takes out of a plan.
    """

    exchanges: int = 300
    others: int = 3
    rounds: int = 5
    directions: tuple[int, ...] = (4, 32)


IMPROVING = Improving()


class Incumbents:
    """The best plan so far of one run.

    Parameters
    ----------
    tell : callable, optional
        ``tell(plan)`` is called whenever the plan or its bound is better.
    watch : Watch
        Without anybody to tell, plans are made only if the time is limited.

    Attributes
    ----------
    best : InspectionPlan or None
        The plan.
    """

    def __init__(self, tell: Callable[[InspectionPlan], object] | None, watch: Watch):
        self.best: InspectionPlan | None = None
        self._tell, self._watch = tell, watch
        self._wanted = tell is not None or watch.limited
        self._bound, self._bounded = 0, np.zeros(0, dtype=bool)
        # what the best one was made of: how many entities, and in how many columns
        self._made_of = (0, 0)
        # entities that simulation took out of a plan, and no other candidate pose gave back
        # what simulation supports instead of a candidate pose, as long as the same edges are counted on the grid
        self._tried: dict[tuple[bytes, tuple[str, ...], tuple[str, ...]], SensorSetting] = {}
        self._in_vain: set[str] = set()

    def glance(self, run: Run) -> None:
        """Make a plan of very few poses, so that there is one at once; the run does not take these poses in."""
        if not self._wanted:
            return
        for directions in IMPROVING.directions:
            pool, poses = ColumnPool(len(run.names)), first_poses(run.judge, directions, run.seed)
            judged = run.judge(poses)
            pool.add(judged.inspects, poses, judged.probability)
            self._offer_greedy(run, pool)

    def sampled(self, run: Run) -> None:
        """Take in what was sampled: what comes at once, then what is better."""
        if self._wanted:
            self._offer_greedy(run, run.pool, IMPROVING.exchanges)
            self.offer(run)

    def _offer_greedy(self, run: Run, pool: ColumnPool, exchanges: int = 0) -> None:
        """See whether the greedy cover by columns of a pool, or a shorter one near it, is a better plan."""
        seen = pool.membership.any(axis=0)
        if not seen.any():
            return
        columns = _nearly_greedy(pool.membership[:, seen], exchanges, run.rng("at once"))
        settings = candidate_settings(run, pool, columns)
        settings, counted = _as_simulated(run, settings)
        if exchanges:
            settings += _regained(run, settings, self._in_vain)
        found = assembled(run, settings, *self._proven(run, settings), counted=counted, unfinished=True)
        if settings and (self.best is None or _worth(found) > _worth(self.best)):
            self.end(found)

    def offer(self, run: Run) -> None:
        """See whether the columns of a run make a better plan."""
        columns = self._better_columns(run) if self._wanted else None
        if columns is None:
            return
        self._made_of = (int(run.pool.membership.any(axis=0).sum()), -len(columns))
        settings, counted = _supported(run, columns, self._tried)
        settings += _regained(run, settings, self._in_vain)
        found = assembled(run, settings, *self._proven(run, settings), counted=counted, unfinished=True)
        if self.best is None or _worth(found) > _worth(self.best):
            self.end(found)
        self._watch.arm()

    def raised(self, run: Run, bound: int, inspected: NDArray[np.bool_]) -> None:
        """Take in a bound that was proven for some entities (k,)."""
        if bound <= self._bound and np.array_equal(inspected, self._bounded):
            return
        self._bound, self._bounded = bound, inspected
        if self.best is not None:
            known, proof = self._proven(run, self.best.settings)
            if known > self.best.lower_bound:
                self.end(replace(self.best, lower_bound=known, bound_proof=proof))

    @property
    def latest(self) -> InspectionPlan:
        """The best plan, once there is one."""
        assert self.best is not None
        return self.best

    def forget(self) -> None:
        """What was found so far was judged by other rules than those from now on."""
        self._watch.disarm()
        self.best, self._made_of = None, (0, 0)
        self._in_vain.clear()
        self._bound, self._bounded = 0, np.zeros(0, dtype=bool)

    def end(self, plan: InspectionPlan) -> None:
        """Take in the plan of the whole run, and tell of it."""
        self.best = plan
        if self._tell is not None:
            self._tell(plan)

    def _better_columns(self, run: Run) -> NDArray[np.int_] | None:
        """Choose columns that cover more entities than before, or as many in fewer columns; None if none are found."""
        membership = run.pool.membership
        covered = membership.any(axis=0)
        membership, (known, n) = membership[:, covered], self._made_of
        if not covered.any():
            return None
        columns = None
        if covered.sum() > known:
            columns = few_columns(membership, run.nodes(SHARES.refuting), run.rng("incumbent"))
            n = -len(columns)
        while -n > 1:
            found = exchange_columns(membership, -n - 1, steps=IMPROVING.exchanges, rng=run.rng("incumbent"))
            if found.missing:
                break
            columns, n = np.sort(found.chosen), -len(found.chosen)
        return columns

    def _proven(self, run: Run, settings: tuple[SensorSetting, ...] | list[SensorSetting]) -> tuple[int, str]:
        """Return the bound that holds for what settings inspect, and what it rests on."""
        if not settings:
            return 0, "No entity is inspected."
        seen = {name for setting in settings for name in setting.entities}
        for_these = self._bound > 1 and all(
            name in seen for name, one in zip(run.names, self._bounded, strict=True) if one
        )
        return (self._bound, _SO_FAR) if for_these else (1, _TRIVIAL)


def _worth(found: InspectionPlan) -> tuple[int, int]:
    """Return what the better one has more of."""
    return len(found.inspected), -len(found.settings)


_Stated = tuple[list[SensorSetting], tuple[str, ...]]


def _supported(
    run: Run, columns: NDArray[np.int_], tried: dict[tuple[bytes, tuple[str, ...], tuple[str, ...]], SensorSetting]
) -> _Stated:
    """Return the candidate poses of columns as settings, and what of them was counted, as simulation supports it.

    What was tried for the same column before is not tried again.
    """
    settings = []
    for candidate in candidate_settings(run, run.pool, columns):
        key = candidate.cam2world.tobytes(), candidate.entities, run.request.on_grid
        if key not in tried:
            tried[key] = best_supported(run.judge, [candidate], column_seed(run.seed, candidate.entities))
        settings.append(tried[key])
    return _as_simulated(run, without_contradicted(run.judge, settings, run.seed))


def _nearly_greedy(membership: NDArray[np.bool_], exchanges: int, rng: np.random.Generator) -> NDArray[np.int_]:
    """Return the greedy cover by columns (c, e), or a shorter one that a few exchanges lead to."""
    chosen = np.array(greedy_cover(membership))
    while exchanges and len(chosen) > 1:
        found = exchange_columns(membership, len(chosen) - 1, steps=exchanges, rng=rng)
        if found.missing:
            break
        chosen = found.chosen
    return chosen


def candidate_settings(run: Run, pool: ColumnPool, columns: NDArray[np.int_]) -> list[SensorSetting]:
    """Return the poses of columns as settings."""
    wanted = [(pool.poses[c], run.names_of(pool.membership[c])) for c in columns]
    return [
        setting_at(run.request, pose, names, "candidate pose", seed=column_seed(run.seed, names))
        for pose, names in wanted
    ]


def _as_simulated(run: Run, settings: Sequence[SensorSetting]) -> _Stated:
    """Return settings that state what simulation does not contradict, and the edges counted on the pixel grid."""
    told = told_on_grid(run, settings)
    supported = []
    for setting in told.settings:
        wrong = run.contradicted_in(setting)
        supported.append(without(run, setting, list(wrong)) if wrong else setting)
    return [setting for setting in supported if setting.entities], told.counted


def _regained(run: Run, settings: Sequence[SensorSetting], in_vain: set[str]) -> list[SensorSetting]:
    """Return further settings for what simulation took out of a plan: other candidate poses, which it supports.

    What none gives back is added to those that are not tried again.
    """
    stated = {name for setting in settings for name in setting.entities}
    further: list[SensorSetting] = []
    for i in np.flatnonzero(run.pool.membership.any(axis=0)):
        name = run.names[i]
        if name in stated or name in in_vain:
            continue
        columns = np.flatnonzero(run.pool.membership[:, i])
        best = columns[np.argsort(-run.pool.quality[columns], kind="stable")[: IMPROVING.others]]
        for setting in candidate_settings(run, run.pool, best):
            wrong = run.contradicted_in(setting)
            if name not in wrong:
                further.append(without(run, setting, list(wrong)) if wrong else setting)
                stated.update(further[-1].entities)
                break
        else:
            in_vain.add(name)
    return further
