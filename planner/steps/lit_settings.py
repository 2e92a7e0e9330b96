"""Settings in which a lamp shows what they measure: where none does, other poses are looked for.

The search for poses knows nothing of lamps. If lamps are asked for, what no lamp shows in any of the chosen settings is
looked at from other poses that inspect it: those kept in the pool, and some drawn anew. Where a lamp shows it from one
of these, the settings are chosen once more, among the old ones and these, by what is shown of each.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from planner.columns.candidates import derive_seed, entity_poses
from planner.columns.perturb import perturbed
from planner.cover.few_columns import few_columns
from planner.light.lighting import Lighting, eyes_of
from planner.light.plan_light import chosen_lamps
from planner.plan import InspectionPlan
from planner.progress import report
from planner.setting.pose_setting import setting_at, without
from planner.setting.sensor_setting import SensorSetting
from planner.steps.assemble import assembled
from planner.steps.run import Run

if TYPE_CHECKING:
    from planner.camera.camera import Camera


# multiples of it, without their whole parts, are spread evenly
_GOLDEN = (5**0.5 - 1) / 2


class _Posed(NamedTuple):
    """Settings and what they measure, as `planner.light` asks for it."""

    settings: Sequence[SensorSetting]
    targets: Mapping[str, Any]
    camera: Camera
    requirements: Mapping[str, float]


def with_lamps(run: Run, lighting: Lighting, draft: InspectionPlan) -> InspectionPlan:
    """Return a plan with lamps, of other settings where that shows more.

    **Guarantee.** It measures what the draft measures, as surely as is asked. What a lamp shows in a setting of the
    draft, a lamp shows in one of the result. No new setting is taken unless that holds; else the draft's are kept.

    Parameters
    ----------
    run : Run
        Its pool holds other poses.
    lighting : Lighting
        What is asked of the lamps.
    draft : InspectionPlan
        The settings chosen without them.
    """
    lit = replace(
        draft,
        light=chosen_lamps(lighting, draft, run.request.space.solid, run.callbacks.silent.report),
    )
    assert lit.light is not None
    if lit.light.complete or lighting.together:
        return lit
    dark = unlit(lit)
    places = _places(run, lighting, lit)
    others = _shown_from_elsewhere(run, lighting, lit, dark, places) if dark else []
    settings = _chosen_among(run, lit, others)
    if settings == list(lit.settings):
        return lit
    plan = assembled(
        run,
        settings,
        draft.lower_bound,
        draft.bound_proof,
        unfinished=draft.unfinished,
    )
    better = replace(
        plan,
        light=chosen_lamps(
            lighting, plan, run.request.space.solid, run.callbacks.silent.report, places
        ),
    )
    return better if set(unlit(better)) <= set(dark) else lit


def unlit(plan: InspectionPlan) -> list[str]:
    """Return the names of the targets that no lamp lights in any setting, in the order of the plan."""
    assert plan.light is not None
    lit = {
        n
        for setting, dark in zip(plan.settings, plan.light.unlit, strict=True)
        for n in setting.entities
        if n not in dark
    }
    return [name for name in plan.entities if name in plan.inspected and name not in lit]


def _places(run: Run, lighting: Lighting, plan: InspectionPlan) -> NDArray[np.float64]:
    """Return places of lamps (n, 3) to try: those of the plan, and others if they may be placed; none of a ring."""
    assert plan.light is not None
    given = lighting.given
    if given is None:
        return np.empty((0, 3))
    if isinstance(given, np.ndarray):
        return given
    return np.concatenate([plan.light.lamps, given.places(run.effort.stages.looking.places)])


def _shown_from_elsewhere(
    run: Run,
    lighting: Lighting,
    plan: InspectionPlan,
    dark: Sequence[str],
    places: NDArray[np.float64],
) -> list[SensorSetting]:
    """Return settings in which lamps at some places show entities that are dark so far, and what else they show."""
    kept: list[SensorSetting] = []
    for k, name in enumerate(dark):
        poses = _poses_that_inspect(run, plan, name)
        settings = [
            setting_at(run.request, pose, [name], "pose in which a lamp shows it") for pose in poses
        ]
        lit = _shown(run, lighting, plan, settings, places)
        seen = [setting for setting, names in zip(settings, lit, strict=True) if name in names]
        seen_from = np.array([setting.cam2world for setting in seen]).reshape(-1, 4, 4)
        more = run.judge(seen_from).inspects.sum(axis=1)
        order = sorted(range(len(seen)), key=lambda i: (-more[i], -seen[i].fitness))
        kept += [seen[i] for i in order[: run.effort.stages.looking.kept]]
        report(run.callbacks.progress, k + 1, len(dark), "poses in the light")
    full = [setting for setting in map(_with_all(run), kept) if setting.entities]
    lit = _shown(run, lighting, plan, full, places)
    cut = [
        without(run.request, setting, [name for name in setting.entities if name not in names])
        for setting, names in zip(full, lit, strict=True)
    ]
    return [setting for setting in cut if setting.entities]


def _with_all(run: Run) -> Any:
    """Return a function that takes into a setting all that its pose inspects and simulation does not contradict."""

    def with_all(setting: SensorSetting) -> SensorSetting:
        pose = setting.cam2world
        names = run.names_of(run.judge(pose[None]).inspects[0])
        full = setting_at(
            run.request, pose, names, setting.message, seed=derive_seed(run.seed, names)
        )
        wrong = run.promises.contradicted_in(full)
        return run.promises.with_bounds(without(run.request, full, list(wrong)) if wrong else full)

    return with_all


def _poses_that_inspect(run: Run, plan: InspectionPlan, name: str) -> NDArray[np.float64]:
    """Return poses (n, 4, 4) that inspect an entity, `Looking.tried` at most: half inspect most, half are spread."""
    looking = run.effort.stages.looking
    column = run.names.index(name)
    seed = derive_seed(run.seed, ["light", name])
    known = run.pool.poses[run.pool.membership[:, column]]
    drawn = entity_poses(run.judge, name, looking.viewpoints, seed)
    planned = np.array([setting.cam2world for setting in plan.settings if name in setting.entities])
    near = np.repeat(planned, looking.around, axis=0)
    near = perturbed(near, run.request.camera.focus_distance_mm, np.random.default_rng(seed))
    poses = np.concatenate([known, drawn, near])
    inspects = run.judge(poses).inspects
    poses = poses[inspects[:, column]]
    more = inspects[inspects[:, column]].sum(axis=1)
    if len(poses) <= looking.tried:
        return poses
    # of many that inspect as much, some from everywhere: neighbours in the list have the same viewpoint
    spread = np.modf(np.arange(len(poses)) * _GOLDEN)[0]
    most = np.lexsort((spread, -more))[: looking.tried // 2]
    rest = np.setdiff1d(np.arange(len(poses)), most)
    others = rest[np.linspace(0, len(rest) - 1, looking.tried - len(most)).round().astype(int)]
    return np.asarray(poses[np.concatenate([most, others])])


def _shown(
    run: Run,
    lighting: Lighting,
    plan: InspectionPlan,
    settings: Sequence[SensorSetting],
    places: NDArray[np.float64],
) -> list[set[str]]:
    """Return what lamps at some places, or the ring on the camera, show in each setting, whichever lamp it takes."""
    names_shown: list[set[str]] = [set() for _ in settings]
    if not settings:
        return names_shown
    posed = _Posed(settings, plan.targets, plan.camera, plan.requirements)
    served = lighting.served(posed, run.request.space.solid, run.callbacks.silent.report)
    if lighting.is_ring:
        served.keep_own(eyes_of(posed))
    elif lighting.is_fixed:
        served.keep(places)
    else:
        served.add(places)
    lit = np.asarray((served.contrast > 0).any(axis=0))
    for pair, is_lit in zip(served.pairs, lit, strict=True):
        if is_lit:
            names_shown[pair.setting].add(pair.name)
    return names_shown


def _chosen_among(
    run: Run, plan: InspectionPlan, others: Sequence[SensorSetting]
) -> list[SensorSetting]:
    """Return the fewest settings, of a plan and others, that show what any of them shows; the rest stays measured."""
    assert plan.light is not None
    dark = unlit(plan)
    shown = {name for setting in others for name in setting.entities} | {
        n for n in plan.inspected if n not in dark
    }
    old = []
    for setting, shadows in zip(plan.settings, plan.light.unlit, strict=True):
        needless = [name for name in shadows if name in shown]
        old.append(without(run.request, setting, needless) if needless else setting)
    options = [setting for setting in (*old, *others) if setting.entities]
    if not others:
        return options
    columns = np.array([np.isin(run.names, setting.entities) for setting in options])
    covered = columns.any(axis=0)
    quality = np.array([setting.fitness / len(setting.entities) for setting in options])
    chosen = few_columns(
        columns[:, covered], run.nodes(), run.rng("light"), quality, run.effort.cover
    )
    return [options[c] for c in chosen]
