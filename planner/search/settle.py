"""Last step: the final cover is chosen, and every setting in it gets the best pose that simulation supports.

That pose is moved off its limits, and what it promises is counted.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from planner.cover.few_columns import few_columns
from planner.executors import in_order
from planner.plan import InspectionPlan
from planner.progress import report
from planner.search.candidates import derive_seed
from planner.search.evolution import Centring
from planner.search.incumbents import as_simulated, candidate_settings, in_order_of_arm
from planner.search.plan_setting import setting_at, without
from planner.search.realise_column import (
    ALL_TRIALS,
    JOINT_POSES,
    JOINT_SURE_POSES,
    Supported,
    centre_setting,
    joint_bounds,
    keeps,
    with_p_all,
    without_contradicted,
)
from planner.search.run import Run
from planner.sensor_setting import Reason, ReasonKind, SensorSetting
from planner.verify.p_all import MOST_REQUIRED

# for what a plan states: displaced poses times targets, in all of its settings together
_JOINT_ALL_POSES = 400_000
# for a target that lacks the required P_all in the final settings: poses of other columns that
# are simulated for it
_RETRIED = 8
# least gain in the sum of the probabilities. A smaller gain is rounding.
_FITNESS_GAIN = 1e-6

# Another try for targets that lack the required P_all in the final settings, before they are
# given up.
#
# In this order, and only as long as some are left:
#
# 1. The poses of the other settings: one of them may measure the target as well. 2. The poses of
# other columns that contain it, as simulation supports them. 3. A setting of its own, searched
# for it alone.
#
# Poses that were added are moved off their limits like all others. What is still short then is
# lost; the largest P_all that was found on the way is what its reason states.


Centre = Callable[[list[SensorSetting]], list[SensorSetting]]


class ShortTargets:
    """Targets that lack the required P_all, and where they may have it.

    Parameters
    ----------
    run : Run
        Its request says what is asked, its pool has other columns.
    settings : sequence of SensorSetting
        The others, which have it.
    reached : dict of str to float
        The largest P_all found of each target that lacks it.
    centre : callable
        Moves settings off their limits, and counts their P_all.

    Attributes
    ----------
    settings : list of SensorSetting
        Those given, and the ones that were added.
    reached : dict of str to float
        The largest P_all found of each target that still lacks it.
    """

    def __init__(
        self,
        run: Run,
        settings: Sequence[SensorSetting],
        reached: dict[str, float],
        centre: Centre,
    ):
        self._run = run
        self._centre = centre
        self.settings = list(settings)
        self.reached = dict(reached)

    def retry(self) -> None:
        """Try all that there is, until no target is left."""
        self.join_settings()
        for propose in (self._other_columns, self._own_settings):
            proposed = propose() if self.reached else []
            if proposed:
                self._add(self._centre(proposed))

    def join_settings(self) -> None:
        """Let settings that are there measure the targets, where they can."""
        judge = self._run.judge
        for name in list(self.reached):
            self._run.callbacks.deadline.check()
            own = judge.names.index(name)
            bounds = {}
            for k, setting in enumerate(self.settings):
                if judge(setting.cam2world[None]).inspects[0, own]:
                    found = joint_bounds(judge, setting.cam2world, (name,), self._run.seed)
                    bounds[k] = found[name][0]
            if not bounds:
                continue
            best = max(bounds, key=lambda k: bounds[k])
            self._reach(name, bounds[best])
            if keeps(judge, bounds[best]):
                self._join(best, name)

    def _join(self, k: int, name: str) -> None:
        run = self._run
        setting = self.settings[k]
        names = (*setting.entities, name)
        joined = setting_at(
            run.request, setting.cam2world, names, setting.message, setting.seed, setting.nfev
        )
        poses = max(setting.p_all_poses, JOINT_POSES)
        joined = with_p_all(run.judge, joined, run.seed, poses)
        # by other draws the one or the other may be short
        if all(keeps(run.judge, p) for p in joined.p_all.values()):
            self.settings[k] = joined
            del self.reached[name]

    def _other_columns(self) -> list[SensorSetting]:
        """Return poses of other columns that simulation supports for some of the targets."""
        run = self._run
        short = np.isin(run.names, list(self.reached))
        columns = run.pool.membership & short
        rows = np.flatnonzero(columns.any(axis=1))
        worth = columns[rows].sum(axis=1) + run.pool.quality[rows] / 2.0
        rows = rows[np.argsort(-worth, kind="stable")]
        left = short.copy()
        tried = np.zeros(len(run.names), dtype=int)
        proposed = []
        for c in rows.tolist():
            wanted = columns[c] & left & (tried < _RETRIED)
            if not wanted.any():
                continue
            tried += wanted
            run.callbacks.deadline.check()
            (candidate,) = candidate_settings(run, run.pool, [c])
            others = [n for n in candidate.entities if n not in run.names_of(wanted)]
            for one in as_simulated(run, [without(run.request, candidate, others)]):
                left &= ~np.isin(run.names, one.entities)
                proposed.append(one)
        return proposed

    def _own_settings(self) -> list[SensorSetting]:
        """Return the best poses that a search for each of the targets alone finds."""
        run = self._run
        sets = [(name,) for name in self.reached]
        found = [one.setting for one in run.realise(sets)]
        supported = run.supported([[one] for one in found if one is not None])
        return [one.setting for one in supported]

    def _add(self, settings: Sequence[SensorSetting]) -> None:
        """Take the settings in, for the targets that have the required P_all there and were short."""
        for one in settings:
            for name, p in one.p_all.items():
                self._reach(name, p)
            useless = [
                name
                for name in one.entities
                if name not in self.reached or not keeps(self._run.judge, one.p_all[name])
            ]
            kept = without(self._run.request, one, useless) if useless else one
            if kept.entities:
                self.settings.append(kept)
            for name in kept.entities:
                del self.reached[name]

    def _reach(self, name: str, p_all: float) -> None:
        if name in self.reached:
            self.reached[name] = max(self.reached[name], p_all)


Proven = Callable[[Run, Sequence[SensorSetting]], tuple[int, str]]


class Settled(NamedTuple):
    """The settings of the final cover.

    Attributes
    ----------
    settings : list of SensorSetting
        With what they promise.
    lost : dict of str to Reason
        Targets of the cover that have the required P_all in none of them.
    """

    settings: list[SensorSetting]
    lost: dict[str, Reason]


def settle(run: Run, inspected: np.ndarray, *, moves: bool = True) -> Settled:
    """Choose the final cover and give every column in it the best pose that simulation supports.

    Parameters
    ----------
    run : Run
        Its pools hold the columns.
    inspected : array of bool (k,)
        Entities that are to be covered.
    moves : bool
        Whether the poses are moved off their limits.
    """
    pool = run.pool
    request = run.request
    chosen = few_columns(
        pool.membership[:, inspected],
        run.nodes(),
        run.rng("settings"),
        pool.quality,
    )
    candidates = [
        setting_at(
            request, pool.poses[c], names, "candidate pose", seed=derive_seed(run.seed, names)
        )
        for c, names in ((c, run.names_of(pool.membership[c])) for c in chosen)
    ]
    settings = without_contradicted(request, _supported(run, candidates))
    centring = Centring.of(run.effort)
    if not moves:
        centring = centring._replace(give_up=0.0)

    def centre(some: Sequence[SensorSetting]) -> list[SensorSetting]:
        return centre_all(run, some, centring)

    return _without_short(run, centre(settings), centre)


def _supported(run: Run, candidates: Sequence[SensorSetting]) -> list[Supported]:
    """Return for each candidate pose the best pose that simulation supports, the candidate itself if it is enough."""
    enough = run.effort.good_enough
    good = [k for k, one in enumerate(candidates) if min(one.probability.values()) > enough]
    # what was simulated on the way is not simulated again
    for _ in run.simulate([candidates[k] for k in good]):
        pass
    plain = [k for k in good if not run.promises.contradicted_in(candidates[k])]
    kept = {k: Supported(candidates[k], frozenset(candidates[k].entities)) for k in plain}
    rest = [k for k in range(len(candidates)) if k not in kept]
    searched = _searched(run, [candidates[k] for k in rest])
    kept.update(zip(rest, searched, strict=True))
    return [kept[k] for k in range(len(candidates))]


def _searched(run: Run, candidates: Sequence[SensorSetting]) -> list[Supported]:
    """Search a better pose for each candidate pose, and return the better one that simulation supports."""
    options = []
    outcomes = run.realise([one.entities for one in candidates])
    for candidate, outcome in zip(candidates, outcomes, strict=True):
        found = outcome.setting
        both = [candidate]
        if found is not None and _holds(run, found, candidate.entities):
            both.insert(found.fitness < candidate.fitness - _FITNESS_GAIN, found)
        options.append(both)
    return run.supported(options)


def settle_early(run: Run, plan: InspectionPlan, proven: Proven) -> InspectionPlan:
    """Return a plan that a time limit ended with its settings moved off their limits, and what they promise.

    Parameters
    ----------
    run : Run
        Its request says what is asked.
    plan : InspectionPlan
        The best plan so far.
    proven : callable
        ``proven(run, settings)`` returns the bound for what settings inspect, and what it rests on.
    """
    moved = centre_all(
        run,
        plan.settings,
        Centring.of(run.effort).shorter(),
        until=run.callbacks.deadline.of_settling(),
    )
    settled = _without_short(run, moved)
    settings = settled.settings
    if run.request.requirements.cell is not None:
        settings = in_order_of_arm(run.request, settings, unfinished=True)
    bound, proof = proven(run, settings)
    return replace(
        plan,
        settings=tuple(settings),
        lower_bound=bound,
        bound_proof=proof,
        uninspectable={**plan.uninspectable, **settled.lost},
    )


def _without_short(
    run: Run, settings: Sequence[SensorSetting], centre: Centre | None = None
) -> Settled:
    """Take from settings the targets that lack the required P_all there; return why some are in none any more.

    Where it is said how settings are moved off their limits, these are tried again before they are given up.
    """
    threshold = min(run.request.probability, MOST_REQUIRED)
    short = [{n for n, p in one.p_all.items() if p < threshold} for one in settings]
    fewer = [
        without(run.request, one, sorted(missing)) if missing else one
        for one, missing in zip(settings, short, strict=True)
    ]
    kept = {name for one in fewer for name in one.entities}
    reached: dict[str, float] = {}
    for one, missing in zip(settings, short, strict=True):
        for name in missing - kept:
            reached[name] = max(one.p_all[name], reached.get(name, 0.0))
    fewer = [one for one in fewer if one.entities]
    if reached and centre is not None:
        tried = ShortTargets(run, fewer, reached, centre)
        tried.retry()
        fewer = tried.settings
        reached = tried.reached
    lost = {
        name: Reason.of(
            ReasonKind.PROBABILITY_TOO_LOW,
            f"the best pose found reaches P_all = {best:.4f}, below the required "
            f"{run.request.probability:g}.",
        )
        for name, best in reached.items()
    }
    return Settled(fewer, lost)


def centre_all(
    run: Run, settings: Sequence[SensorSetting], centring: Centring, *, until: float | None = None
) -> list[SensorSetting]:
    """Move settings off their limits, and count what they promise.

    Parameters
    ----------
    run : Run
        Its request says what is asked.
    settings : sequence of SensorSetting
        Settings that simulation supports.
    centring : Centring
        How long to search.
    until : float, optional
        The time limit has passed, which is not asked again. Fewer poses are displaced, and from this time on, as
        `time.time` counts, poses are not moved.

    Returns
    -------
    list of SensorSetting
        In the same order, for the same targets.
    """
    poses = JOINT_POSES
    early = until is not None
    if not early:
        each = _JOINT_ALL_POSES // max(sum(len(one.entities) for one in settings), 1)
        poses = min(JOINT_SURE_POSES, max(each, poses))
    tasks = [
        (
            run.shared,
            setting,
            derive_seed(run.seed, setting.entities),
            poses,
            centring,
            # a pose that needs a neighbour is left as it is
            ALL_TRIALS if early else len(settings),
            math.inf if until is None else until,
        )
        for setting in settings
    ]
    check = (lambda: None) if early else run.callbacks.check
    moved = []
    for setting in in_order(run.executor, centre_setting, tasks, check):
        moved.append(setting)
        # where the time is up already, it is not asked again
        report(run.callbacks.progress, len(moved), len(settings), "margins")
    return moved


def _holds(run: Run, setting: SensorSetting, names: tuple[str, ...]) -> bool:
    """Judge a setting anew: whether it inspects all these entities."""
    return bool(run.judge(setting.cam2world[None]).inspects[0, np.isin(run.names, names)].all())
