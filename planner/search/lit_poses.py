"""Settings in which a lamp shows what they measure: where none does, other poses are looked for.

The search for poses knows nothing of lamps. If lamps are asked for, what no lamp shows in any of the chosen settings is
looked at from other poses that inspect it: those kept in the pool, and some drawn anew. Where a lamp shows it from one
of these, the settings are chosen once more, among the old ones and these, by what is shown of each.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from aspectgraph.solid.solid import RayScene
from planner.callbacks import Deadline
from planner.cover import few_columns
from planner.executors import checked_by
from planner.light.area_light import EdgePoints, shown_of_plan
from planner.light.light_plan import eyes_of
from planner.light.lighting import Lighting
from planner.light.mounted_light import flat_normals
from planner.light.plan_light import chosen_lamps
from planner.plan import InspectionPlan
from planner.progress import TimeIsUpError, TimeLeft
from planner.request.part_entities import parts_of
from planner.request.problem import Problem
from planner.search.columns import derive_seed, entity_poses, perturbed
from planner.search.incumbents import SearchRun, as_simulated, assembled
from planner.search.plan_setting import setting_at, without
from planner.sensor_setting import Reason, ReasonKind, SensorSetting

if TYPE_CHECKING:
    from planner.camera.camera import Camera
    from planner.camera.pose import PoseUncertainty

# viewpoints drawn for each unlit entity, in addition to the poses of the pool
_LIGHT_VIEWPOINTS = 60
# poses tried around each planned pose of the entity, which may keep the other targets of the
# setting
_LIGHT_AROUND = 400
# poses of each entity whose light is computed
_LIGHT_TRIED = 48
# of the poses where the entity is lit, keep this many as candidates: those that inspect most
# entities with the highest probability
_LIGHT_KEPT = 8
# sine of the angle between an image's way up and a normal, from which on a camera can be turned to it
_NEARLY_PARALLEL = 0.1
# lamp positions tried in addition to the chosen ones, for lamps without fixed positions
_LIGHT_PLACES = 1000
# multiples of it, without their whole parts, are spread evenly
_GOLDEN = (5**0.5 - 1) / 2


def unlit_witnesses(problem: Problem, lighting: Lighting | None) -> frozenset[str]:
    """Return the witnesses of which no lamp lights all, wherever the camera is: no pose is worth a search for them.

    An edge shows if one of its faces, which need not be the same everywhere, is lit with the step of grey values. So
    somewhere along an edge that no lamp lights like that, both faces turn away from each lamp, or nearly. Shadows do
    not count. Between the positions that are tried in a box or dome, the light of a face changes as little as the
    distance to the next one allows.

    Parameters
    ----------
    problem : Problem
        The request; see `Problem.single`.
    lighting : Lighting or None
        What is asked of the lamps. Nothing is left out for a ring, a light with an area, a bright ground, or lamps that
        are on together.
    """
    lamps = None if lighting is None or lighting.together else lighting.given
    if lighting is None or lamps is None or lighting.ground != "dark":
        return frozenset()
    gap_mm = 0.0
    if not isinstance(lamps, np.ndarray):
        lamps = lamps.places(_LIGHT_PLACES)
        near, _ = cKDTree(lamps).query(lamps, k=min(2, len(lamps)))
        gap_mm = float(near.max())
    solid = problem.space.solid
    return frozenset(
        target.name
        for target in problem.single.targets
        if not all(
            _may_be_lit(EdgePoints.of(solid, part.edge_ids), lamps, gap_mm, lighting.step)
            for part in parts_of(target, solid, target.name)
        )
    )


def _may_be_lit(
    edges: EdgePoints, lamps: NDArray[np.float64], gap_mm: float, least_step: float
) -> bool:
    """Return whether a lamp (n, 3), or one at most a gap from it, may light all of some edges with a step."""
    towards = lamps[:, None] - edges.points
    distance = np.linalg.norm(towards, axis=-1)
    light = np.einsum("nmk,mfk->nmf", towards, edges.normals).max(axis=-1) + gap_mm
    return bool((light >= least_step * distance).all(axis=1).any())


def never_lit(problem: Problem, lighting: Lighting | None) -> dict[str, Reason]:
    """Return the targets without a witness that a lamp may light, and the reason."""
    unlit = np.isin(problem.single.names, sorted(problem.unlit))
    if lighting is None or not unlit.any():
        return {}
    lamps = lighting.given
    if not isinstance(lamps, np.ndarray):
        start = f"no position in {lamps} lights"
    elif len(lamps) > 1:
        start = f"none of {len(lamps)} lamps lights"
    else:
        start = "the lamp does not light"
    text = f"{start} all of it, wherever the camera is: somewhere both of its faces turn away."
    return {
        name: Reason.of(ReasonKind.NOT_SHOWN, text)
        for k, name in enumerate(problem.names)
        if unlit[problem.owner == k].all()
    }


class _Posed(NamedTuple):
    """Some settings of a plan and what they measure, as `planner.light` asks for it."""

    settings: Sequence[SensorSetting]
    targets: Mapping[str, Any]
    camera: Camera
    pose_uncertainty: PoseUncertainty
    accuracy: float
    requirements: Mapping[str, float]


def with_lamps(run: SearchRun, lighting: Lighting, draft: InspectionPlan) -> InspectionPlan:
    """Return a plan with lamps, of other settings where that shows more.

    **Guarantee.** It measures what the draft measures, as surely as is asked. What a lamp shows in a setting of the
    draft, a lamp shows in one of the result. No new setting is taken unless that holds; else the draft's are kept.

    Parameters
    ----------
    run : SearchRun
        Its pool holds other poses.
    lighting : Lighting
        What is asked of the lamps.
    draft : InspectionPlan
        The settings chosen without them.
    """
    lighting = lighting.on_part(run.problem.space.solid, draft.camera)
    lit = _lit(run, lighting, draft)
    return _with_other_poses(run, lighting, draft, lit)


def with_lamps_in_time(
    run: SearchRun, lighting: Lighting, draft: InspectionPlan, until: float
) -> InspectionPlan:
    """Return a plan that a time limit ended with lamps, and with other poses as far as there is time for them.

    Parameters
    ----------
    run, lighting, draft
        As of `with_lamps`.
    until : float
        When that ends, as `time.time` counts.

    Returns
    -------
    InspectionPlan
        The draft, without lamps, if there is no time for these.
    """
    lighting = lighting.on_part(run.problem.space.solid, draft.camera)
    limit_s = None if until == math.inf else max(until - time.time(), 1e-3)
    deadline = Deadline(limit_s, run.callbacks.deadline.gap)
    deadline.arm()
    run.callbacks = replace(run.callbacks, deadline=deadline)
    lit = draft
    try:
        with checked_by(deadline.check_now):
            lit = _lit(run, lighting, draft, until)
            return _with_other_poses(run, lighting, draft, lit, until)
    except TimeIsUpError:
        return lit


def _lit(
    run: SearchRun,
    lighting: Lighting,
    plan: InspectionPlan,
    until: float = math.inf,
    also: ArrayLike = (),
) -> InspectionPlan:
    """Return a plan with lamps, some of which may be at places (n, 3). What is begun before a deadline is ended."""
    progress = run.callbacks.report if until == math.inf else run.callbacks.progress
    light = chosen_lamps(
        lighting,
        plan,
        run.problem.space.solid,
        progress,
        also,
        run.problem.reads,
        run.executor,
        until,
    )
    return replace(plan, light=light)


def _with_other_poses(
    run: SearchRun,
    lighting: Lighting,
    draft: InspectionPlan,
    lit: InspectionPlan,
    until: float = math.inf,
) -> InspectionPlan:
    """Return a lit plan of other settings where these show more; other poses are looked for in half of the time."""
    assert lit.light is not None
    if lit.light.complete or lighting.together:
        return lit
    dark = lit.unlit
    places = lamp_places(lighting, lit)
    half = until if until == math.inf else (time.time() + until) / 2.0
    others = _shown_from_elsewhere(run, lighting, lit, places, half) if dark else []
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
    missing = [name for name in plan.uninspectable if name in draft.uninspectable]
    reasons = {name: draft.uninspectable[name] for name in missing}
    plan = replace(plan, uninspectable={**plan.uninspectable, **reasons})
    better = _lit(run, lighting, plan, until, places)
    return better if set(better.unlit) <= set(dark) else lit


def lamp_places(lighting: Lighting, plan: InspectionPlan) -> NDArray[np.float64]:
    """Return places of lamps (n, 3) to try: those of the plan, and others if they may be placed; none of a ring."""
    assert plan.light is not None
    places = lighting.given
    if places is None:
        return np.empty((0, 3))
    if isinstance(places, np.ndarray):
        return places
    return np.concatenate([plan.light.lamps, places.places(_LIGHT_PLACES)])


def _shown_from_elsewhere(
    run: SearchRun,
    lighting: Lighting,
    plan: InspectionPlan,
    places: NDArray[np.float64],
    until: float = math.inf,
) -> list[SensorSetting]:
    """Return settings in which lamps at some places show entities that are dark so far, and what else they show.

    Those for which there is no time until then, as `time.time` counts, are left out.
    """
    elsewhere: list[SensorSetting] = []
    dark = plan.unlit
    time_left = TimeLeft(until)
    run.callbacks.report(0, len(dark), "poses in the light")
    for k, name in enumerate(dark):
        if not time_left.fits_another():
            break
        square_on = lighting.area is not None and lighting.area.square_on
        poses = _poses_that_inspect(run, plan, name, _LIGHT_TRIED, square_on=square_on)
        settings = [
            setting_at(run.problem, pose, [name], "pose in which a lamp shows it") for pose in poses
        ]
        lit = shown_by_lamps(run, lighting, plan, settings, places)
        seen = [setting for setting, names in zip(settings, lit, strict=True) if name in names]
        seen_from = np.array([setting.cam2world for setting in seen]).reshape(-1, 4, 4)
        more = run.judge(seen_from).inspects.sum(axis=1)
        order = sorted(range(len(seen)), key=lambda i: (-more[i], -seen[i].fitness))
        elsewhere += [seen[i] for i in order[:_LIGHT_KEPT]]
        run.callbacks.report(k + 1, len(dark), "poses in the light")
    full = _with_all(run, elsewhere)
    lit = shown_by_lamps(run, lighting, plan, full, places)
    cut = [
        without(run.problem, setting, [name for name in setting.entities if name not in names])
        for setting, names in zip(full, lit, strict=True)
    ]
    return [setting for setting in cut if setting.entities]


def _with_all(run: SearchRun, settings: Sequence[SensorSetting]) -> list[SensorSetting]:
    """Return settings with all that their poses inspect and simulation does not contradict; none that state nothing."""
    full = []
    for setting in settings:
        names = run.names_of(run.judge(setting.cam2world[None]).inspects[0])
        seed = derive_seed(run.seed, names)
        full.append(setting_at(run.problem, setting.cam2world, names, setting.message, seed=seed))
    for k, _ in enumerate(run.simulate(full), 1):
        run.callbacks.report(k, len(full), "counts in the light")
    return as_simulated(run, full)


def _poses_that_inspect(
    run: SearchRun, plan: InspectionPlan, name: str, most_poses: int, *, square_on: bool = False
) -> NDArray[np.float64]:
    """Return poses (n, 4, 4) that inspect an entity, so many at most: half inspect most, half are spread.

    If asked, all of them look square at a flat face beside it.
    """
    column = run.names.index(name)
    seed = derive_seed(run.seed, ["light", name])
    pooled = run.pool.poses[run.pool.membership[:, column]]
    drawn = entity_poses(run.judge, name, _LIGHT_VIEWPOINTS, seed)
    planned = np.array([setting.cam2world for setting in plan.settings if name in setting.entities])
    near = np.repeat(planned, _LIGHT_AROUND, axis=0)
    near = perturbed(near, run.problem.camera.focus_distance_mm, np.random.default_rng(seed))
    poses = np.concatenate([pooled, drawn, near])
    if square_on:
        poses = _squared(run, plan, name, poses)
    inspects = run.judge(poses).inspects
    poses = poses[inspects[:, column]]
    more = inspects[inspects[:, column]].sum(axis=1)
    if len(poses) <= most_poses:
        return poses
    # of many that inspect as much, some from everywhere: neighbours in the list have the same viewpoint
    spread = np.modf(np.arange(len(poses)) * _GOLDEN)[0]
    richest = np.lexsort((spread, -more))[: most_poses // 2]
    remaining = np.setdiff1d(np.arange(len(poses)), richest)
    others = remaining[
        np.linspace(0, len(remaining) - 1, most_poses - len(richest)).round().astype(int)
    ]
    return np.asarray(poses[np.concatenate([richest, others])])


def _squared(
    run: SearchRun, plan: InspectionPlan, name: str, poses: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return poses (n, 4, 4) turned about the place in focus until they look square at a flat face beside a target."""
    solid = run.problem.space.solid
    distance = run.problem.camera.focus_distance_mm
    focus = poses[:, :3, 3] + distance * poses[:, :3, 2]
    turned = []
    for part in parts_of(plan.targets[name], solid, name):
        for normal in flat_normals(EdgePoints.of(solid, part.edge_ids)):
            rolled = poses.copy()
            # the way up of the image stays as near as it can be
            right = np.cross(poses[:, :3, 1], -normal)
            lengths = np.linalg.norm(right, axis=1)
            right /= np.maximum(lengths, _NEARLY_PARALLEL)[:, None]
            down = np.cross(-normal, right)
            axes = np.broadcast_to(-normal, right.shape)
            rolled[:, :3, :3] = np.stack([right, down, axes], axis=-1)
            rolled[:, :3, 3] = focus + distance * normal
            turned.append(rolled[lengths > _NEARLY_PARALLEL])
    return np.concatenate(turned) if turned else poses


def shown_by_lamps(
    run: SearchRun,
    lighting: Lighting,
    plan: InspectionPlan,
    settings: Sequence[SensorSetting],
    places: NDArray[np.float64],
) -> list[set[str]]:
    """Return what lamps at some places, or the ring on the camera, show in each setting, whichever lamp it takes."""
    names_shown: list[set[str]] = [set() for _ in settings]
    if not settings:
        return names_shown
    posed = _Posed(
        settings,
        plan.targets,
        plan.camera,
        plan.pose_uncertainty,
        plan.accuracy,
        plan.requirements,
    )
    if lighting.area is not None:
        solid = run.problem.space.solid
        scene = RayScene(solid.vertices, solid.triangles, n_threads=1)
        shown = shown_of_plan(
            lighting.area, posed, solid, scene, lighting.limits, run.problem.reads
        )
        return [set(setting.contrast) for setting in shown]
    served = lighting.served(
        posed, run.problem.space.solid, run.callbacks.silent.report, run.problem.reads
    )
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
    run: SearchRun, plan: InspectionPlan, others: Sequence[SensorSetting]
) -> list[SensorSetting]:
    """Return the fewest settings, of a plan and others, that show what any of them shows; the rest stays for now."""
    assert plan.light is not None
    dark = plan.unlit
    shown = {name for setting in others for name in setting.entities} | {
        n for n in plan.promises if n not in dark
    }
    old = []
    for setting, shadows in zip(plan.settings, plan.light.unlit, strict=True):
        needless = [name for name in shadows if name in shown]
        old.append(without(run.problem, setting, needless) if needless else setting)
    options = [setting for setting in (*old, *others) if setting.entities]
    if not others:
        return options
    columns = np.array([np.isin(run.names, setting.entities) for setting in options])
    covered = columns.any(axis=0)
    quality = np.array([setting.fitness / len(setting.entities) for setting in options])
    chosen = few_columns(columns[:, covered], run.nodes(), run.rng("light"), quality)
    return [options[c] for c in chosen]
