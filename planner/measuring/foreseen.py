"""The uncertainty that `measure` will state, foreseen by a plan: the same quantity under the same state of edges.

A plan counts what it needs for its promise: a localisation of few points, and of breaks that are stated the worst that
light can do. `measure` has the points of the whole entity, a small floor of its detector, and a lamp that tells where
the steps of broken edges are. So the U of a plan may be twice that of `measure`. Here U is computed as `measure` does
it, with the nominal part, the planned pose and light, and no image. Without planned light, a lamp on the camera stands
for it, as in rendered images. Without a planned registration, edges tell the pose, as `measure` does it by default.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from errors.measurands import Circle, Decision, DecisionRule, decide
from errors.measurands.geometry import DETECTOR_FLOOR_PX, FLOOR_PX, Localisation, is_short
from errors.measurands.measurand import COVERAGE
from errors.measurands.position import Position
from planner.executors import check_on_the_way, checked_by
from planner.measuring.breaks import (
    BreakShift,
    FoundPoints,
    break_shifts,
    entity_breaks,
    lit_breaks,
)
from planner.measuring.fit import CORRELATION_PX
from planner.measuring.images import WELL_EXPOSED
from planner.measuring.measurer import Measurer, witness_key
from planner.measuring.planned_edges import edges_bias_px
from planner.measuring.reading import entity_scale, slopes_by_fitted, spacing_of
from planner.measuring.registered import Faces, Lamp
from planner.measuring.rehearsal import BLUR_PX, BRIGHT_GROUND, SHADOW_SHARE
from planner.measuring.samples import BESIDE_PX, PartEdge, across_of, pixels_of
from planner.measuring.seen_breaks import unseen_mm
from planner.measuring.verdict import Sampled
from planner.progress import TimeIsUpError, TimeLeft
from planner.request.dimension import POSITIONS, is_one_sided
from planner.request.edge_state import EdgeState, spread_of
from planner.request.registration import OWN_EDGES
from planner.sensor_setting import Foreseen
from planner.verify.setting_record import Measurement, measurements

if TYPE_CHECKING:
    from aspectgraph import Solid
    from errors.measurands.geometry import Frame, Geometry
    from errors.measurands.measurand import Measurand
    from planner.camera.camera import Camera
    from planner.measuring.samples import Samples
    from planner.plan import InspectionPlan
    from planner.request.targets import Target

Array = NDArray[np.float64]

_MARGIN_PX = 4.0
_NOT_FORESEEN = (
    "The plan lacks the uncertainties that 'measure' will state: the time limit ended. A longer "
    "--time-limit computes them."
)
# lines of the part that are nearer than this leave a sample out
_APART_PX = 5.0
# that have a distance from each other
_FEWEST_POINTS = 2
# in which a position may be off, in half a turn
_DIRECTIONS = 8


def foreseen_uncertainties(
    plan: InspectionPlan, solid: Solid, edge_break_mm: tuple[float, float] | None = None
) -> list[Foreseen]:
    """Return the uncertainties that `measure` will state.

    Parameters
    ----------
    plan : InspectionPlan
        The plan.
    solid : Solid
        Its part.
    edge_break_mm : (float, float), optional
        Breaks of edges that are stated to `measure`, mm. Default: what the plan states.

    Returns
    -------
    list of Foreseen
        Of each dimension in each setting. Lengths of edges, targets that two settings measure together, and those of
        which an image shows no point apart from other lines, are left out.
    """
    if not plan.settings or not plan.dimensions:
        return []
    measurer = Measurer(plan, solid)
    rows = []
    for number, setting in enumerate(plan.settings):
        view = _View(measurer, number, _lamp(plan, number, solid))
        for name, planned in measurements(plan, setting).items():
            if name in setting.ends or plan.dimensions[name].measurand.in_image:
                continue
            if any(map(is_short, plan.dimensions[name].geometry)):
                # these have quantiles instead of variances
                continue
            check_on_the_way()
            state = EdgeState.of(
                plan.dimensions[name].edge_break_mm, edge_break_mm, plan.request.edge_break_mm
            )
            row = _foreseen(view, name, planned, state)
            if row is not None:
                rows.append(row)
    return rows


def _by_own_edges(plan: InspectionPlan) -> bool:
    """Tell whether `measure` will know poses from the part's own edges: it does, unless something else is planned."""
    registration = plan.request.registration
    return registration is None or registration.method == OWN_EDGES


def with_foreseen(plan: InspectionPlan, solid: Solid) -> InspectionPlan:
    """Return a plan with the uncertainties that `measure` will state, for its lamps and its breaks of edges."""
    return replace(plan, foreseen=tuple(foreseen_uncertainties(plan, solid)))


def foreseen_in_time(
    plan: InspectionPlan, solid: Solid, time_left: TimeLeft
) -> tuple[InspectionPlan, list[str]]:
    """Return a plan with these uncertainties; as it was, with a sentence for the reader, if the time ends before."""
    try:
        with checked_by(lambda: time_left.check):
            check_on_the_way()
            return with_foreseen(plan, solid), []
    except TimeIsUpError:
        return plan, [_NOT_FORESEEN]


def surest(rows: Sequence[Foreseen]) -> dict[str, Foreseen]:
    """Return what is foreseen of each target in the setting that measures it best."""
    best: dict[str, Foreseen] = {}
    for row in sorted(rows, key=lambda row: row.expanded_uncertainty):
        best.setdefault(row.name, row)
    return best


@dataclass(frozen=True)
class _View:
    """A setting of a plan, and the lamp that `measure` finds; None if it does not."""

    measurer: Measurer
    number: int
    lamp: Lamp | None

    @property
    def pose(self) -> Array:
        return np.asarray(self.measurer.plan.settings[self.number].cam2world, dtype=np.float64)

    @property
    def camera(self) -> Camera:
        return self.measurer.plan.camera


@dataclass(frozen=True)
class _EntityView:
    """An entity in an image: its samples (m) and their places, px."""

    edge: PartEdge
    frame: Frame
    samples: Samples
    points: FoundPoints


def _lamp(plan: InspectionPlan, number: int, solid: Solid) -> Lamp | None:
    """Return the lamp of a setting: that of its first image, or one on the camera where none is planned.

    None where `measure` does not find it: under a light with an area, and where edges do not tell the pose.
    """
    eye = np.asarray(plan.settings[number].cam2world, dtype=np.float64)[:3, 3]
    middle = (solid.vertices.min(axis=0) + solid.vertices.max(axis=0)) / 2
    place = eye
    ground = SHADOW_SHARE
    light = plan.light
    if not _by_own_edges(plan):
        # a lamp is fitted to what registration finds
        return None
    if light is not None:
        if light.area is not None:
            return None
        ground = BRIGHT_GROUND if light.ground == "bright" else SHADOW_SHARE
        images = light.images[number]
        if images:
            place = np.asarray(light.lamps[list(images[0].lamps)]).mean(axis=0)
    unit = float(np.linalg.norm(place - middle))
    return Lamp(place, 2.0, unit, WELL_EXPOSED, SHADOW_SHARE, 0.0, ground)


def _foreseen(view: _View, name: str, planned: Measurement, state: EdgeState) -> Foreseen | None:
    """Return what will be stated of a target; None if an entity has no usable points."""
    key = witness_key(view.measurer.plan.settings[view.number], name)
    target = view.measurer.by_witness[key]
    entities = _entities(view, key, target)
    if not entities:
        return None
    nominal = [_as_designed(entity.edge.geometry) for entity in entities]
    without = _by_points(planned, target.localisation, entities)
    pose = _by_pose(planned) * _pose_share(view.measurer.plan, target.localisation, state)
    without += pose
    variance = max(
        _by_breaks(view, entities, slopes, state) for slopes in _slopes(target.measurand, nominal)
    )
    total = COVERAGE * math.sqrt(without + variance)
    wider = total
    limit = 0.0
    if not state.stated:
        plan = view.measurer.plan
        limit = unseen_mm(plan.camera, view.measurer.model.solid, [view.pose])
        # steps move in proportion to narrow breaks
        wider = COVERAGE * math.sqrt(without + variance * max(limit / state.high_mm, 1.0) ** 2)
    # not a value that is open anyhow, as of a position, whose nominal value is at its lower limit
    is_open = _is_open(target, wider) and not _is_open(target, total)
    return Foreseen(name, view.number, total, wider, limit, is_open)


def _is_open(target: Target, expanded: float) -> bool:
    """Return whether it is open that a part in the middle of its limits conforms; of a position, one without error."""
    if target.tolerance is None or is_one_sided(target.tolerance):
        return False
    middle = 0.0 if target.kind in POSITIONS else sum(target.tolerance) / 2
    return (
        decide(middle, expanded / COVERAGE, target.tolerance, DecisionRule.iso14253())
        != Decision.CONFORMS
    )


def _entities(view: _View, key: str, target: Target) -> list[_EntityView]:
    """Return the entities of a target as an image shows them, nominal part and pose; none if one has no points."""
    model = view.measurer.model
    edges = list(model.measured[key])
    samples = model.edges.samples(view.pose, view.camera, edges, _MARGIN_PX)
    shown = model.shown(view.pose, view.camera)
    centres = pixels_of(samples.points, view.pose, view.camera)
    samples.apart[:] = shown.apart(edges, samples.edge, centres, _APART_PX)
    entities = []
    for k, (edge, frame) in enumerate(zip(edges, target.measurand.frames, strict=True)):
        chosen = samples.of(k)
        chosen = chosen.chosen(chosen.usable)
        if len(chosen.points) < _FEWEST_POINTS:
            return []
        across = across_of(chosen.points, chosen.tangents, view.pose, view.camera)
        pixels = pixels_of(chosen.points, view.pose, view.camera)
        scale = entity_scale(edge.geometry, frame, chosen.points, across, view.pose, view.camera)
        points = FoundPoints(pixels, across, chosen.points, scale)
        entities.append(_EntityView(edge, frame, chosen, points))
    return entities


def _as_designed(geometry: Geometry) -> Array:
    """Return what is fitted of an entity (p,) where the part is as designed."""
    if isinstance(geometry, Circle):
        return np.array([0.0, 0.0, geometry.radius_mm])
    return np.zeros(2)


def _slopes(measurand: Measurand, nominal: Sequence[Array]) -> Iterator[list[Array]]:
    """Yield the derivatives of a value by what is fitted of each entity (p,); of a position, in several directions.

    A position is the length of a vector, so it has no derivative as designed, and one in each direction off that.
    """
    if not isinstance(measurand, Position):
        yield slopes_by_fitted(measurand, nominal)
        return
    n_components = len(measurand.frame.errors)
    angles = np.pi * np.arange(_DIRECTIONS if n_components > 1 else 1) / _DIRECTIONS
    for shares in np.stack([np.cos(angles), np.sin(angles)], axis=1)[:, :n_components]:
        # the value is twice the length
        yield slopes_by_fitted(measurand.along(2.0 * shares), nominal)


def _by_points(
    planned: Measurement, localisation: Localisation, entities: Sequence[_EntityView]
) -> float:
    """Return the variance of a value by its points: those of the whole entity, and the detector's floor."""
    budget = planned.budget
    random = budget["localisation"]
    if localisation.model == "gaussian":
        # points that are near each other are not independent
        independent = min(
            len(entity.points.pixels) / max(1.0, CORRELATION_PX / spacing_of(entity.points.pixels))
            for entity in entities
        )
        random *= localisation.points / max(independent, 1.0)
    floor = budget["localisation_floor"]
    if localisation.floor_px == FLOOR_PX:
        floor *= (DETECTOR_FLOOR_PX / FLOOR_PX) ** 2
    return random + floor


def _by_pose(planned: Measurement) -> float:
    """Return the variance of a value by its pose and surfaces, as planned."""
    return math.fsum(planned.budget[source] for source in ("translation", "rotation", "surfaces"))


def _pose_share(plan: InspectionPlan, localisation: Localisation, state: EdgeState) -> float:
    """Return how much of this variance is left where edges tell the pose, whose biases are smaller than planned.

    `measure` takes biases that are as large as images show, so they are never taken for larger than planned.
    """
    if not _by_own_edges(plan) or not localisation.floor_px:
        return 1.0
    floor_px = DETECTOR_FLOOR_PX if localisation.floor_px == FLOOR_PX else localisation.floor_px
    shown = edges_bias_px(plan.camera, floor_px, state)
    counted = edges_bias_px(
        plan.camera, localisation.floor_px, EdgeState.planned(plan.request.edge_break_mm)
    )
    return min((shown / counted) ** 2, 1.0)


def _by_breaks(
    view: _View, entities: Sequence[_EntityView], slopes: Sequence[Array], state: EdgeState
) -> float:
    """Return the variance of a value by broken edges, from its derivatives by what is fitted of each entity (p,)."""
    if state.is_sharp:
        return 0.0
    shifts = [
        _shift(view, entity, slope, state) for entity, slope in zip(entities, slopes, strict=True)
    ]
    means = np.array([shift.mean for shift in shifts])
    squares = np.array([shift.mean_square for shift in shifts])
    return spread_of(means, squares, state)[1]


def _shift(view: _View, entity: _EntityView, slope: Array, state: EdgeState) -> BreakShift:
    """Return how far the break of an entity shifts a value under the lamp of a setting."""
    pose = view.pose
    points = entity.points
    samples = entity.samples
    breaks = entity_breaks(
        entity.edge, entity.frame, samples, state, samples.points, points.across, pose, view.camera
    )
    lamp = view.lamp
    if lamp is not None and len(samples.points):
        scene = view.measurer.model.edges.scene
        alone = replace(samples, edge=np.zeros_like(samples.edge))
        sampled = Sampled(scene, view.camera, pose, [entity.edge], alone)
        faces, on_part = sampled.beside(points.across, BESIDE_PX + breaks.band_px)
        levels = np.where(on_part, faces.shaded(lamp), lamp.background)
        middle = samples.points.mean(axis=0)
        near = Faces(samples.points, breaks.normals[:, 0], pose[:3, 3], middle, scene)
        breaks = lit_breaks(breaks, samples, lamp, near, levels, BLUR_PX)
    return break_shifts(breaks, entity.edge, entity.frame, points, pose, view.camera, slope)
