"""Plans whose targets may be measured by two settings, one end each, where that inspects more or saves a setting.

A plan of whole targets comes first, with its bound. Then ends join the columns of its poses, and of poses that are
searched for targets without a setting. A cover of these columns is settled as any other one, but settings of the plan
that serve for a column stay where they are. It replaces the plan if it inspects more targets, or as many in fewer
settings. A target that is measured as a whole stays so.

The bound of the plan does not hold for plans that split targets. So another one follows, of ends.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from errors.measurands import End, SplitModel, split_model
from errors.measurands.position import Position
from ground.shared import Shared
from planner.bound.lower_bound import exclusion_proof, lower_bound
from planner.cover import few_columns, maximal_columns
from planner.executors import in_order
from planner.plan import InspectionPlan
from planner.progress import TimeIsUpError
from planner.request.problem import Problem
from planner.request.registration import means_at
from planner.request.split import (
    WHOLE,
    Split,
    end_name,
    ends_apart,
    split_names,
    split_problem,
    target_and_end,
)
from planner.request.targets import END_SHARE, PlannedDimension
from planner.resume import PlanningState
from planner.search.columns import Judge, WarmStart, derive_seed, judged_poses, price_poses
from planner.search.counted_columns import CountedColumns
from planner.search.evolution import Centring
from planner.search.incumbents import TRIVIAL, SearchRun, assembled, may_split
from planner.search.plan_setting import setting_at, without
from planner.search.realise_column import centre_setting, keeps, poses_stated, realise
from planner.search.stages import settle, without_unproven
from planner.sensor_setting import Reason, ReasonKind, SensorSetting, SplitValue
from planner.verify.joint_counts import MOST_REQUIRED, poses_needed
from planner.verify.joint_counts import lower_bound as p_all_bound
from planner.verify.simulate_split import SplitCameras, checks_of, split_successes

Array = NDArray[np.float64]

# rounds of column generation with ends: the poses of the plan are there already
_ROUNDS = 12
# so many times as many viewpoints are drawn for the end of a position as for a target: no more is done for it, and of
# few viewpoints it is often chance that finds one
_MORE_VIEWPOINTS = 8
# displaced poses of each camera of a split target
_POSES = 20_000
# times that a target which falls short is improved, and the least share of its error that an end is permitted then
_MOST_IMPROVED = 2
_LEAST_SHARE = 0.35
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
        The plan of whole targets, with a bound for such plans.
    """
    if not may_split(run):
        return plan
    proof = _BoundOfEnds(run)
    best = proof.first(plan)
    if plan.unfinished:
        return best
    try:
        other = _other_plan(run, best, proof)
        if other is not None and _is_better(other, plan):
            best = other
        return proof.of(best)
    except TimeIsUpError:
        return replace(best, unfinished=True)


def _is_better(other: InspectionPlan, plan: InspectionPlan) -> bool:
    more = len(other.promises) - len(plan.promises)
    fewer = len(other.settings) < len(plan.settings)
    return (more > 0 or (more == 0 and fewer)) and set(plan.promises) <= set(other.promises)


def _other_plan(run: SearchRun, plan: InspectionPlan, proof: _BoundOfEnds) -> InspectionPlan | None:
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
    targets = [name for name in run.names if name in plan.promises or name in missing]
    split = split_problem(run.problem.restricted_to(targets), {*missing, *present}, present)
    proof.poses.append(ends.poses)
    return _SplitSearch(run, plan, split).plan(ends.poses)


class _BoundOfEnds:
    """How many settings plans need at least that may split targets.

    Parameters
    ----------
    run : SearchRun
        The run that made a plan of whole targets.

    Attributes
    ----------
    poses : list of array (n, 4, 4)
        Poses that are known.
    """

    def __init__(self, run: SearchRun) -> None:
        self._run = run
        self.poses = [run.pools.realised.poses, run.pools.near.poses]
        if run.state.weighing is not None:
            self.poses.append(run.state.weighing.realised.poses)

    def first(self, plan: InspectionPlan) -> InspectionPlan:
        """Return a plan of whole targets with the bound of ends that exclude each other, and its own beside it."""
        n = min(1, len(plan.settings))
        exclusive = self._run.state.incompatible_ends
        lost = set(exclusive) - set(plan.promises)
        n = max(n, len(exclusive) - len(lost))
        return self._stated(plan, n, exclusion_proof(self._run.problem, n) if n > 1 else TRIVIAL)

    def of(self, plan: InspectionPlan) -> InspectionPlan:
        """Return a plan with what can be proven of ends.

        Known poses that cover all ends are a limit of any such proof. So it aims at no more.
        """
        run = self._run
        enough = len(plan.settings)
        if enough <= max(1, plan.lower_bound):
            return plan
        apart = ends_apart(run.problem, list(plan.promises))
        judge = Judge(without_unproven(apart.problem) or apart.problem, run.effort)
        at_settings = np.array([setting.cam2world for setting in plan.settings])
        columns = judge(np.concatenate([*self.poses, at_settings])).inspects
        columns[-enough:] |= _measured(plan, apart)
        columns = columns[maximal_columns(columns)]
        if columns.any(axis=0).all():
            cover = few_columns(columns, run.nodes(), run.rng("known ends"))
            enough = min(enough, len(cover))
        enough = run.callbacks.deadline.wanted_bound(enough)
        if enough <= plan.lower_bound:
            return plan
        # what it proves on the way is of ends, which nobody knows outside
        silent = replace(run.callbacks, on_bound=None)
        n, proof, _ = lower_bound(
            apart.problem,
            enough,
            columns,
            effort=run.effort,
            executor=run.executor,
            callbacks=silent,
        )
        return self._stated(plan, n, proof) if n > plan.lower_bound else plan

    def _stated(self, plan: InspectionPlan, n: int, proof: str) -> InspectionPlan:
        """Return a plan with a bound of all plans; that of whole targets stays, if it says more."""
        of_whole = plan.whole_bound or plan.lower_bound
        if plan.split or of_whole <= n:
            of_whole = 0
        # the proof of whole targets proves no more for them if the bounds are equal
        return replace(plan, lower_bound=n, bound_proof=proof, whole_bound=of_whole)


def _measured(plan: InspectionPlan, apart: Split) -> NDArray[np.bool_]:
    """Return which ends (s, e) the settings of a plan measure, alone or in the whole target."""
    names = list(plan.promises)
    measured = np.zeros((len(plan.settings), len(apart.owner)), dtype=bool)
    for row, setting in zip(measured, plan.settings, strict=True):
        for k, (owner, entity) in enumerate(zip(apart.owner, apart.entity, strict=True)):
            name = names[owner]
            if name in setting.ends:
                row[k] = setting.ends[name] == entity
            else:
                row[k] = name in setting.entities
    return measured


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
            for column in np.flatnonzero(~seen).tolist():
                times = _MORE_VIEWPOINTS if self._is_position(child, column) else 1
                n_viewpoints = times * run.effort.viewpoints
                tasks.append((child.shared, child.names[column], n_viewpoints, run.seed))
            for poses, drawn in in_order(run.executor, judged_poses, tasks, run.callbacks.check):
                useful = drawn.inspects.any(axis=1)
                seen |= drawn.inspects.any(axis=0)
                self.poses = np.concatenate([self.poses, poses[useful]])
            self._realise(child, seen)
        return [name for k, name in enumerate(names) if seen[alone.owner == k].all()]

    def _realise(self, child: SearchRun, seen: NDArray[np.bool_]) -> None:
        """Give ends that no pose inspects a run of the genetic algorithm each, as long as the other end has a pose.

        Not those of positions, whose probability is an integral: such a run may take a minute.
        """
        for column in range(0, len(seen), 2):
            for k in (column, column + 1):
                if seen[k] or self._is_position(child, k):
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

    @staticmethod
    def _is_position(child: SearchRun, column: int) -> bool:
        target = child.problem.measured[child.names[column]]
        assert isinstance(target, PlannedDimension)
        value = target.measurand
        return isinstance(value, End) and isinstance(value.whole, Position)


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
        child.pools.add_missing(poses, child.judge(poses))
        inspected = self._whole_targets(child.pool.inspected)
        n_targets = len(np.unique(self._split.owner[inspected]))
        membership = child.pool.membership[:, inspected]
        n_settings = len(few_columns(membership, child.nodes(), child.rng("known")))
        if n_targets <= len(self._plan.promises) and n_settings >= len(self._plan.settings):
            return None
        columns = CountedColumns(child, inspected)
        columns.repair(columns.count_cover())
        settings = settle(child, inspected, columns.counted, ready=self._plan.settings).settings
        return self._assembled(settings)

    def _whole_targets(self, inspected: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return which ends (e,) are inspected together with all others of their target."""
        owner = self._split.owner
        lost = np.unique(owner[~inspected])
        return np.asarray(inspected & ~np.isin(owner, lost))

    def _assembled(self, settings: Sequence[SensorSetting]) -> InspectionPlan | None:
        """Return the plan of settings of the request with ends; None if these lose a target that the plan inspects."""
        lost: dict[str, Reason] = {}
        tried: list[str] = []
        while True:
            needed = self._without_needless(settings, lost)
            if not needed:
                return None
            # so many settings do what the plan does, and what it proves holds for more targets
            bound = min(self._plan.lower_bound, len(needed))
            draft = assembled(self._child, needed, bound, self._plan.bound_proof)
            renamed = tuple(map(self._as_targets, draft.settings))
            values = self._values(renamed)
            short = [name for name, value in values.items() if not self._is_enough(value)]
            if not short:
                break
            settings = draft.settings
            for name in short:
                better = None
                if tried.count(name) < _MOST_IMPROVED:
                    better = self._improved(settings, name, values[name])
                tried.append(name)
                if better is None:
                    lost[name] = _too_low(values[name], self._run)
                else:
                    settings = better
        measured = {name for setting in renamed for name in setting.entities}
        if not measured.issuperset(self._plan.promises):
            # moved off its limits, a setting may fall short of the required P_all
            return None
        reasons = {**self._plan.uninspectable, **lost}
        for name in measured:
            reasons.pop(name, None)
        return replace(
            self._plan,
            settings=renamed,
            lower_bound=bound,
            uninspectable=reasons,
            split=values,
            light=None,
            whole_bound=0,
        )

    def _improved(
        self, settings: Sequence[SensorSetting], name: str, value: SplitValue
    ) -> list[SensorSetting] | None:
        """Return settings in which a target is more likely to be measured well; None if none are found.

        The entity with the larger share of the variance is searched again. It is permitted what the rest leaves of the
        permitted error: a² = r² - (z u_rest)².
        """
        pair = [self._index(settings, end_name(name, k)) for k in range(2)]
        model, poses = self._model(name, *(self._as_targets(settings[k]) for k in pair))
        of_ends = model.end_uncertainties(poses)
        worse = int(np.argmax(of_ends))
        remainder = value.standard_uncertainty**2 - of_ends[worse] ** 2
        permitted = model.whole.permitted_error
        remaining = (
            permitted**2 - float(ndtri((1 + self._run.problem.probability) / 2)) ** 2 * remainder
        )
        # where the remainder takes all of it, the entity becomes as sure as it can
        share = max(remaining, (_LEAST_SHARE * permitted) ** 2) ** 0.5 / permitted
        return self._with_surer(settings, pair[worse], name, worse, share, value)

    def _with_surer(
        self,
        settings: Sequence[SensorSetting],
        index: int,
        name: str,
        entity: int,
        share: float,
        value: SplitValue,
    ) -> list[SensorSetting] | None:
        """Return settings of which one measures an entity better: all of one setting, or it in a setting of its own."""
        end = end_name(name, entity)
        child = self._child
        strict = Judge(_with_share(child.problem, end, share), child.effort)
        setting = settings[index]
        for names in (setting.entities, (end,)):
            outcome = realise(
                Shared(strict),
                names,
                derive_seed(child.seed, [*names, "surer"]),
                setting.cam2world[None],
            )
            if outcome.setting is None:
                continue
            pose = outcome.setting.cam2world
            if not child.judge(pose[None]).inspects[0, np.isin(child.names, names)].all():
                continue
            poses = poses_stated(sum(len(other.entities) for other in settings))
            moved = setting_at(child.problem, pose, names, "surer", outcome.setting.seed)
            # the surest pose may lie at a limit, where its entity often leaves the image
            moved = centre_setting(
                child.shared,
                moved,
                derive_seed(child.seed, names),
                poses,
                Centring.of(child.effort),
                len(settings),
            )
            if not all(keeps(child.judge, p) for p in moved.p_all.values()):
                continue
            others = [*settings[:index], *settings[index + 1 :], moved]
            fewer = [other for other in setting.entities if other not in names]
            if fewer:
                others.append(without(self._split.problem, setting, list(names)))
            pair = [self._index(others, end_name(name, k)) for k in range(2)]
            again = self._value(name, *(self._as_targets(others[k]) for k in pair))
            if again.p_all > value.p_all:
                return others
        return None

    def _index(self, settings: Sequence[SensorSetting], end: str) -> int:
        return next(k for k, setting in enumerate(settings) if end in setting.entities)

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

    def _model(self, name: str, *settings: SensorSetting) -> tuple[SplitModel, Array]:
        """Return the model of a target that two settings measure, and their poses (2, 4, 4), world to camera."""
        run = self._run
        target = self._target(name, settings[0])
        means = replace(run.request.means, localisation=target.localisation)
        first, second = (target.description(means_at(means, setting, name)) for setting in settings)
        poses = np.array([setting.cam2world for setting in settings])
        return split_model(first, second), np.linalg.inv(poses)

    def _target(self, name: str, setting: SensorSetting) -> PlannedDimension:
        target = self._run.problem.measured[name]
        if len(target.witnesses) > 1:
            target = target.choosing(setting.witness[name])
        assert isinstance(target, PlannedDimension)
        return target

    def _value(self, name: str, *settings: SensorSetting) -> SplitValue:
        run = self._run
        model, world_to_camera = self._model(name, *settings)
        checks = [
            checks_of(self._split.problem, setting.cam2world, end_name(name, k))
            for k, setting in enumerate(settings)
        ]
        cameras = SplitCameras(
            self._target(name, settings[0]),
            [setting.cam2world for setting in settings],
            [setting.registered for setting in settings],
            run.problem.camera,
            run.problem.pose_uncertainty,
        )
        n = poses_needed(run.problem.probability, _POSES)
        hits = split_successes(cameras, checks, n, [derive_seed(run.seed, ["split", name])])
        probability = model.probability(world_to_camera)
        return SplitValue(
            probability,
            min(p_all_bound(hits, n), probability),
            n,
            model.standard_uncertainty(world_to_camera),
        )


def _with_share(problem: Problem, end: str, share: float) -> Problem:
    """Return a request in which an end is permitted a share of the error of its target."""
    targets = []
    for target in problem.targets:
        if target.name == end:
            assert isinstance(target, PlannedDimension)
            # `END_SHARE` of it counts already
            target = replace(target, permitted_error=share / END_SHARE * target.permitted_error)
        targets.append(target)
    return replace(problem, targets=tuple(targets))


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
