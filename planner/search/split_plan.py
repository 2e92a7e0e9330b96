"""Plans whose targets may be measured by two settings, one entity each, where that inspects more or saves a setting.

A plan of whole targets comes first. Then ends join the columns of its poses, and of poses that are searched for targets
without a setting. A cover of these columns is settled as any other one. It replaces the plan if it inspects more
targets, or as many in fewer settings. A target that is measured as a whole stays so.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from errors.measurands import SplitModel
from planner.bound.lower_bound import exclusion_proof, exclusive_entities
from planner.cover import few_columns
from planner.executors import in_order
from planner.plan import InspectionPlan
from planner.progress import TimeIsUpError
from planner.request.problem import Problem
from planner.request.registration import means_at
from planner.request.split import (
    NEVER,
    WHOLE,
    Split,
    end_name,
    split_names,
    split_problem,
    target_and_end,
)
from planner.request.targets import PlannedDimension
from planner.resume import PlanningState
from planner.search.columns import WarmStart, derive_seed, judged_poses, price_poses
from planner.search.counted_columns import CountedColumns
from planner.search.incumbents import SearchRun, assembled
from planner.search.plan_setting import without
from planner.search.stages import settle
from planner.sensor_setting import Reason, ReasonKind, SensorSetting, SplitValue
from planner.verify.simulate_setting import MOST_REQUIRED, lower_bound, poses_needed
from planner.verify.simulate_split import SplitCameras, checks_of, split_successes

# rounds of column generation with ends: the poses of the plan are there already
_ROUNDS = 12
# displaced poses of each camera of a split target
_POSES = 20_000
_NO_SETTING = Reason("no setting")


def with_split(run: SearchRun, plan: InspectionPlan) -> InspectionPlan:
    """Return a plan in which settings measure entities of some targets apart, if it is better.

    **Guarantee.** It inspects all that the plan inspects. It is another plan only if it inspects more, or as much in
    fewer settings.

    Parameters
    ----------
    run : SearchRun
        The run that made the plan; its pools hold other poses.
    plan : InspectionPlan
        The plan of whole targets.
    """
    if run.request.split == NEVER or plan.unfinished:
        return plan
    try:
        other = _other_plan(run, plan)
    except TimeIsUpError:
        return replace(plan, unfinished=True)
    if other is None:
        return plan
    more = len(other.inspected) - len(plan.inspected)
    lost = set(plan.inspected) - set(other.inspected)
    is_better = more > 0 or (more == 0 and len(other.settings) < len(plan.settings))
    return other if is_better and not lost else plan


def _other_plan(run: SearchRun, plan: InspectionPlan) -> InspectionPlan | None:
    missing = []
    present = []
    for name in split_names(run.problem):
        if name in plan.uninspectable:
            missing.append(name)
        elif len(plan.settings) > plan.lower_bound:
            present.append(name)
    if not missing and not present:
        return None
    parts = [run.pools.realised.poses, run.pools.near.poses]
    for setting in plan.settings:
        parts.append(setting.cam2world[None])
    ends = _EndPoses(run, np.concatenate(parts))
    missing = ends.seen(missing, search=True)
    present = ends.seen(present, search=False)
    if not missing and not present:
        return None
    targets = [name for name in run.names if name in plan.inspected or name in missing]
    split = split_problem(run.problem.restricted_to(targets), {*missing, *present}, present)
    return _SplitSearch(run, plan, split).plan(ends.poses)


class _EndPoses:
    """Poses, and which ends of targets they inspect.

    Parameters
    ----------
    run : SearchRun
        The run.
    poses : array (n, 4, 4)
        Poses that it knows.
    """

    def __init__(self, run: SearchRun, poses: NDArray[np.float64]) -> None:
        self._run = run
        self.poses = poses

    def seen(self, names: Sequence[str], *, search: bool) -> list[str]:
        """Return the targets of which some poses inspect each end; more poses are drawn, if asked."""
        if not names:
            return []
        run = self._run
        alone = split_problem(run.problem.restricted_to(names), names)
        child = child_run(run, alone.problem)
        judged = child.judge(self.poses)
        seen: NDArray[np.bool_] = np.asarray(judged.inspects.any(axis=0))
        if search:
            tasks = []
            for column in np.flatnonzero(~seen):
                tasks.append((child.shared, child.names[column], run.effort.viewpoints, run.seed))
            for poses, drawn in in_order(run.executor, judged_poses, tasks, run.callbacks.check):
                useful = drawn.inspects.any(axis=1)
                seen |= drawn.inspects.any(axis=0)
                self.poses = np.concatenate([self.poses, poses[useful]])
            self._realise(child, seen)
        return [name for k, name in enumerate(names) if seen[alone.owner == k].all()]

    def _realise(self, child: SearchRun, seen: NDArray[np.bool_]) -> None:
        """Give ends that no pose inspects a run of the genetic algorithm each, as long as the other end has a pose."""
        for column in range(0, len(seen), 2):
            for k in (column, column + 1):
                if seen[k]:
                    continue
                (outcome,) = child.realise([(child.names[k],)])
                if outcome.setting is None:
                    break
                pose = outcome.setting.cam2world[None]
                inspects = child.judge(pose).inspects[0]
                if not inspects[k]:
                    break
                seen |= inspects
                self.poses = np.concatenate([self.poses, pose])


def child_run(run: SearchRun, problem: Problem) -> SearchRun:
    """Return a run of another problem with the means of a run; nothing of it is kept."""
    memo = PlanningState(run.request.identity(), None)
    request = replace(run.request, targets=problem.targets)
    return SearchRun(problem, request, memo, executor=run.executor, callbacks=run.callbacks.silent)


class _SplitSearch:
    """The search for settings that measure whole targets and ends.

    Parameters
    ----------
    run : SearchRun
        The run that made the plan.
    plan : InspectionPlan
        The plan of whole targets.
    split : Split
        The request with ends.
    """

    def __init__(self, run: SearchRun, plan: InspectionPlan, split: Split) -> None:
        self._run = run
        self._plan = plan
        self._split = split
        self._child = child_run(run, split.problem)
        # of what no setting measures; the reasons are those of the plan
        self._child.state.uninspectable = dict.fromkeys(self._child.names, _NO_SETTING)

    def plan(self, poses: NDArray[np.float64]) -> InspectionPlan | None:
        """Return the best plan with ends that is found; None if it can be no better.

        Parameters
        ----------
        poses : array (n, 4, 4)
            Poses to begin with.
        """
        child = self._child
        child.pools.add(poses, child.judge(poses), child.judge.steady)
        rounds = min(child.effort.pricing_rounds, _ROUNDS)
        everything = np.ones(len(child.names), dtype=bool)
        price_poses(
            child.shared,
            child.pools,
            derive_seed(child.seed, ["split"]),
            rounds,
            child.executor,
            child.callbacks,
            WarmStart(coverable=everything),
        )
        inspected = self._whole_targets(child.pool.inspected)
        n_targets = len(np.unique(self._split.owner[inspected]))
        membership = child.pool.membership[:, inspected]
        n_settings = len(few_columns(membership, child.nodes(), child.rng("known")))
        if n_targets <= len(self._plan.inspected) and n_settings >= len(self._plan.settings):
            return None
        columns = CountedColumns(child, inspected)
        columns.repair(columns.count_cover())
        settings = settle(child, inspected, columns.counted).settings
        return self._assembled(settings)

    def _whole_targets(self, inspected: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return which ends (e,) are inspected together with all others of their target."""
        owner = self._split.owner
        lost = np.unique(owner[~inspected])
        return np.asarray(inspected & ~np.isin(owner, lost))

    def _assembled(self, settings: Sequence[SensorSetting]) -> InspectionPlan | None:
        """Return the plan of settings of the request with ends; None if these lose a target that the plan inspects."""
        lost: dict[str, Reason] = {}
        while True:
            needed = self._without_needless(settings, lost)
            if not needed:
                return None
            # so many settings do what the plan does, and what it proves holds for more targets
            bound = min(self._plan.lower_bound, len(needed))
            draft = assembled(self._child, needed, bound, self._plan.bound_proof)
            renamed = tuple(map(self._as_targets, draft.settings))
            values = self._values(renamed)
            n_lost = len(lost)
            for name, value in values.items():
                if not self._is_enough(value):
                    lost[name] = _too_low(value, self._run)
            if len(lost) == n_lost:
                break
        measured = {name for setting in renamed for name in setting.entities}
        if not measured.issuperset(self._plan.inspected):
            # moved off its limits, a setting may fall short of the required P_all
            return None
        reasons = {**self._plan.uninspectable, **lost}
        for name in measured:
            reasons.pop(name, None)
        inspected = [name for name in self._run.names if name not in reasons]
        bound, proof = self._bound(inspected, bound)
        return replace(
            self._plan,
            settings=renamed,
            lower_bound=min(bound, len(renamed)),
            bound_proof=proof,
            uninspectable=reasons,
            split=values,
            light=None,
        )

    def _bound(self, names: Sequence[str], bound: int) -> tuple[int, str]:
        """Return a bound for what settings inspect, and what it rests on: that of the plan, or ends that exclude."""
        problem = self._run.problem.restricted_to(names)
        apart = split_problem(problem, split_names(problem), any_way=True)
        columns = []
        for owner, entity in zip(apart.owner.tolist(), apart.entity.tolist(), strict=True):
            whole = names[owner]
            end = end_name(whole, entity)
            columns.append(self._child.names.index(end if end in self._child.names else whole))
        membership = self._child.pool.membership[:, columns]
        every = np.arange(len(columns))
        exclusive = exclusive_entities(apart.problem, every, membership, self._run.executor)
        if len(exclusive) <= bound:
            return bound, self._plan.bound_proof
        return len(exclusive), exclusion_proof(apart.problem, len(exclusive))

    def _is_enough(self, value: SplitValue) -> bool:
        return value.p_all >= min(self._run.problem.probability, MOST_REQUIRED)

    def _entity_of(self, setting: SensorSetting, name: str) -> int:
        """Return which entity of its target an end is in a setting; `WHOLE` if the setting measures all of it."""
        target, entity = target_and_end(name)
        if entity == WHOLE or name not in setting.witness:
            return entity
        n_whole = len(self._run.problem.find_target(target).witnesses)
        return entity if setting.witness[name] >= n_whole else WHOLE

    def _without_needless(
        self, settings: Sequence[SensorSetting], lost: Mapping[str, Reason]
    ) -> list[SensorSetting]:
        """Return settings with each end once, none of a target that one of them measures as a whole."""
        places: dict[str, dict[int, list[int]]] = {}
        for k, setting in enumerate(settings):
            for name in setting.entities:
                target, _ = target_and_end(name)
                entities = places.setdefault(target, {})
                entities.setdefault(self._entity_of(setting, name), []).append(k)
        needed: dict[int, list[str]] = {}
        for target, entities in places.items():
            if target in lost:
                continue
            for k in entities.get(WHOLE, []):
                needed.setdefault(k, []).append(self._whole_name(settings[k], target))
            if WHOLE in entities:
                continue
            pair = _surest_pair(settings, target, entities)
            for entity, k in enumerate(pair):
                needed.setdefault(k, []).append(end_name(target, entity))
        fewer = []
        for k in sorted(needed):
            dropped = sorted(set(settings[k].entities) - set(needed[k]))
            fewer.append(
                without(self._split.problem, settings[k], dropped) if dropped else settings[k]
            )
        return fewer

    def _whole_name(self, setting: SensorSetting, target: str) -> str:
        """Return the name under which a setting measures all of a target."""
        if target in setting.entities:
            return target
        first = end_name(target, 0)
        if first in setting.entities and self._entity_of(setting, first) == WHOLE:
            return first
        return end_name(target, 1)

    def _as_targets(self, setting: SensorSetting) -> SensorSetting:
        """Return a setting under the names of targets, which says of which it measures one entity."""
        names = {name: target_and_end(name)[0] for name in setting.entities}
        ends: dict[str, int] = {}
        witness: dict[str, int] = {}
        passed_over: dict[str, dict[str, str]] = {}
        for name, target in names.items():
            entity = self._entity_of(setting, name)
            if entity != WHOLE:
                ends[target] = entity
            ways = self._run.problem.find_target(target).ways
            if len(ways) > 1:
                witness[target] = setting.witness.get(name, 0) if entity == WHOLE else 0
            over = setting.passed_over.get(name, {})
            for way in ways if entity == WHOLE else ():
                text = ", ".join(way)
                if text in over:
                    passed_over.setdefault(target, {})[text] = over[text]
        registered = setting.registered
        if registered is not None:
            registered = replace(
                registered,
                by_surfaces=_renamed(registered.by_surfaces, names),
                by_edge=_renamed(registered.by_edge, names),
            )
        return replace(
            setting,
            entities=tuple(names.values()),
            probability=_renamed(setting.probability, names),
            p_all=_renamed(setting.p_all, names),
            lines_in_window_px=_renamed(setting.lines_in_window_px, names),
            witness=witness,
            ends=ends,
            passed_over=passed_over,
            registered=registered,
        )

    def _values(self, settings: Sequence[SensorSetting]) -> dict[str, SplitValue]:
        """Return how sure each target is that two settings measure."""
        ends: dict[str, dict[int, SensorSetting]] = {}
        for setting in settings:
            for name, entity in setting.ends.items():
                ends.setdefault(name, {})[entity] = setting
        values = {}
        for name in sorted(ends):
            values[name] = self._value(name, ends[name][0], ends[name][1])
        return values

    def _value(self, name: str, *settings: SensorSetting) -> SplitValue:
        run = self._run
        target = run.problem.measured[name]
        if len(target.witnesses) > 1:
            target = target.choosing(settings[0].witness[name])
        assert isinstance(target, PlannedDimension)
        means = replace(run.request.means, localisation=target.localisation)
        models = []
        poses = []
        knowledge = []
        checks = []
        for k, setting in enumerate(settings):
            pose = setting.cam2world
            models.append(target.description(means_at(means, setting, name)))
            poses.append(pose)
            knowledge.append(setting.registered)
            checks.append(checks_of(self._split.problem, pose, end_name(name, k)))
        model = SplitModel(*models)
        uncertainty = run.problem.pose_uncertainty
        cameras = SplitCameras(target, poses, knowledge, run.problem.camera, uncertainty)
        world_to_camera = np.linalg.inv(np.array(poses))
        n = poses_needed(run.problem.probability, _POSES)
        hits = split_successes(cameras, checks, n, [derive_seed(run.seed, ["split", name])])
        probability = model.probability(world_to_camera)
        return SplitValue(
            probability,
            min(lower_bound(hits, n), probability),
            n,
            model.standard_uncertainty(world_to_camera),
        )


def _surest_pair(
    settings: Sequence[SensorSetting], target: str, entities: Mapping[int, Sequence[int]]
) -> tuple[int, ...]:
    """Return two different settings that measure one end of a target each, as surely as any; empty without such."""
    best: tuple[int, ...] = ()
    largest = -1.0
    for pair in itertools.product(entities.get(0, ()), entities.get(1, ())):
        first, second = pair
        surest = min(
            settings[first].promise[end_name(target, 0)],
            settings[second].promise[end_name(target, 1)],
        )
        if first != second and surest > largest:
            best = pair
            largest = surest
    return best


def _renamed(values: Mapping[str, Any], names: Mapping[str, str]) -> dict[str, Any]:
    """Return values under the names of targets."""
    return {names[name]: value for name, value in values.items() if name in names}


def _too_low(value: SplitValue, run: SearchRun) -> Reason:
    """Return why a target is not inspected whose ends are."""
    return Reason.of(
        ReasonKind.PROBABILITY_TOO_LOW,
        "its ends are seen by two settings, but not well enough together: "
        f"P_all = {value.p_all:.4f}, below the required {run.request.probability:g}.",
    )
