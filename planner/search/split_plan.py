"""Plans whose targets may be measured by two settings, one entity each, where that inspects more or saves a setting.

A plan of whole targets comes first. Then ends join the columns of its poses, and of poses that are searched for targets
without a setting. A cover of these columns is settled as any other one. It replaces the plan if it inspects more
targets, or as many in fewer settings. A target that is measured as a whole stays so.
"""

from __future__ import annotations

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
from planner.search.incumbents import SearchRun, assembled
from planner.search.plan_setting import without
from planner.search.stages import settle
from planner.sensor_setting import Reason, ReasonKind, SensorSetting, SplitValue, kind_of
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
    names = split_names(run.problem)
    missing = [
        name
        for name in names
        if name in plan.uninspectable
        and kind_of(plan.uninspectable[name]) is not ReasonKind.NOT_FOUND_YET
    ]
    inspected = [name for name in run.names if name in plan.inspected]
    present = [name for name in names if name in plan.inspected]
    if len(plan.settings) <= plan.lower_bound:
        present = []
    if not missing and not present:
        return None
    poses = np.concatenate([pool.poses for pool in run.pools])
    settings = np.array([setting.cam2world for setting in plan.settings]).reshape(-1, 4, 4)
    poses = np.concatenate([settings, poses])
    ends = _EndPoses(run, poses)
    missing = ends.seen(missing, search=True)
    present = ends.seen(present, search=False)
    if not missing and not present:
        return None
    wanted = [name for name in run.names if name in inspected or name in missing]
    split = split_problem(run.problem.restricted_to(wanted), {*missing, *present}, present)
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
        seen = judged.inspects.any(axis=0)
        if search:
            tasks = [
                (child.shared, name, run.effort.viewpoints, run.seed)
                for name, is_seen in zip(child.names, seen, strict=True)
                if not is_seen
            ]
            for poses, drawn in in_order(run.executor, judged_poses, tasks, run.callbacks.check):
                useful = drawn.inspects.any(axis=1)
                seen |= drawn.inspects.any(axis=0)
                self.poses = np.concatenate([self.poses, poses[useful]])
            self._realise(child, seen)
        both = [seen[alone.owner == column].all() for column in range(len(names))]
        return [name for name, is_seen in zip(names, both, strict=True) if is_seen]

    def _realise(self, child: SearchRun, seen: NDArray[np.bool_]) -> None:
        """Give ends that no pose inspects a run of the genetic algorithm each, as long as the other end has a pose."""
        for column in range(0, len(seen), 2):
            hidden = [k for k in (column, column + 1) if not seen[k]]
            for k in hidden:
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
        settings = settle(child, inspected).settings
        return self._assembled(settings)

    def _whole_targets(self, inspected: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return which ends (e,) are inspected together with all others of their target."""
        owner = self._split.owner
        lost = np.unique(owner[~inspected])
        return np.asarray(inspected & ~np.isin(owner, lost))

    def _assembled(self, settings: Sequence[SensorSetting]) -> InspectionPlan | None:
        """Return the plan of settings of the request with ends."""
        lost: dict[str, Reason] = {}
        while True:
            kept = self._without_needless(settings, lost)
            if not kept:
                return None
            # so many settings do what the plan does, and what it proves holds for more targets
            bound = min(self._plan.lower_bound, len(kept))
            draft = assembled(self._child, kept, bound, self._plan.bound_proof)
            renamed = tuple(self._as_targets(setting) for setting in draft.settings)
            values = self._values(renamed)
            short = {name: value for name, value in values.items() if not self._is_enough(value)}
            if not short:
                break
            lost |= {name: _too_low(value, self._run) for name, value in short.items()}
        names = {name for setting in renamed for name in setting.entities}
        reasons = {**self._plan.uninspectable, **lost}
        bound, proof = self._bound([name for name in self._run.names if name in names], bound)
        return replace(
            self._plan,
            settings=renamed,
            lower_bound=min(bound, len(renamed)),
            bound_proof=proof,
            uninspectable={n: reason for n, reason in reasons.items() if n not in names},
            split=values,
            light=None,
        )

    def _bound(self, names: Sequence[str], bound: int) -> tuple[int, str]:
        """Return a bound for what settings inspect, and what it rests on: that of the plan, or ends that exclude others."""
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
        kept: list[set[str]] = [set() for _ in settings]
        for target, entities in places.items():
            if target in lost:
                continue
            if WHOLE in entities:
                for k in entities[WHOLE]:
                    names = [
                        name
                        for name in settings[k].entities
                        if target_and_end(name)[0] == target
                        and self._entity_of(settings[k], name) == WHOLE
                    ]
                    kept[k].add(names[0])
                continue
            pairs = [(i, j) for i in entities.get(0, []) for j in entities.get(1, []) if i != j]
            if not pairs:
                continue
            first, second = max(
                pairs,
                key=lambda pair: min(
                    settings[k].promise[end_name(target, entity)] for entity, k in enumerate(pair)
                ),
            )
            kept[first].add(end_name(target, 0))
            kept[second].add(end_name(target, 1))
        fewer = []
        for setting, names in zip(settings, kept, strict=True):
            dropped = [name for name in setting.entities if name not in names]
            fewer.append(without(self._split.problem, setting, dropped) if dropped else setting)
        return [setting for setting in fewer if setting.entities]

    def _as_targets(self, setting: SensorSetting) -> SensorSetting:
        """Return a setting under the names of targets, which says of which it measures one entity."""
        names = {name: target_and_end(name)[0] for name in setting.entities}
        entity = {name: self._entity_of(setting, name) for name in names}
        several = {t.name for t in self._run.problem.targets if len(t.witnesses) > 1}
        witness = {}
        passed_over = {}
        for name, target in names.items():
            if target not in several:
                continue
            witness[target] = setting.witness.get(name, 0) if entity[name] == WHOLE else 0
            ways = {", ".join(way) for way in self._run.problem.find_target(target).ways}
            over = {
                way: why for way, why in setting.passed_over.get(name, {}).items() if way in ways
            }
            if entity[name] == WHOLE and over:
                passed_over[target] = over
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
            ends={names[name]: k for name, k in entity.items() if k != WHOLE},
            passed_over=passed_over,
            registered=registered,
        )

    def _values(self, settings: Sequence[SensorSetting]) -> dict[str, SplitValue]:
        """Return how sure each target is that two settings measure."""
        ends: dict[str, dict[int, SensorSetting]] = {}
        for setting in settings:
            for name, entity in setting.ends.items():
                ends.setdefault(name, {})[entity] = setting
        return {name: self._value(name, of[0], of[1]) for name, of in sorted(ends.items())}

    def _value(self, name: str, *settings: SensorSetting) -> SplitValue:
        run = self._run
        target = run.problem.measured[name]
        if len(target.witnesses) > 1:
            target = target.choosing(settings[0].witness[name])
        assert isinstance(target, PlannedDimension)
        means = replace(run.request.means, localisation=target.localisation)
        models = [target.description(means_at(means, setting, name)) for setting in settings]
        poses = np.array([np.linalg.inv(setting.cam2world) for setting in settings])
        model = SplitModel(*models)
        cameras = SplitCameras(
            target,
            [setting.cam2world for setting in settings],
            [setting.registered for setting in settings],
            run.problem.camera,
            run.problem.pose_uncertainty,
        )
        checks = [
            checks_of(self._split.problem, setting.cam2world, end_name(name, k))
            for k, setting in enumerate(settings)
        ]
        n = poses_needed(run.problem.probability, _POSES)
        hits = split_successes(cameras, checks, n, [derive_seed(run.seed, ["split", name])])
        probability = model.probability(poses)
        return SplitValue(
            probability,
            min(lower_bound(hits, n), probability),
            n,
            model.standard_uncertainty(poses),
        )


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
