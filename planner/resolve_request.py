"""From the arguments of a call to the request: entities and targets are found on the part, defaults become numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from errors.measurands.geometry import Localisation
from planner.argument_kinds import check_accuracy, check_fraction, check_kinds
from planner.camera.camera import Camera
from planner.camera.pose import PoseUncertainty, checked_poses
from planner.effort import Effort
from planner.exceptions import RequestError
from planner.identity import PartRecord, Request, RingRecord
from planner.options import InspectionOptions
from planner.request.camera_limits import check_seed, default_workspace
from planner.request.dimension import Dimension
from planner.request.dimension_files import (
    localisation_or_default,
    surfaces_or_default,
    with_surfaces_of_call,
)
from planner.request.edge_state import checked_break
from planner.request.problem import Problem, choice_for
from planner.request.reach import Space, TargetSpace
from planner.request.split import AUTO
from planner.request.targets import Target, check_is_edge, edge_targets

if TYPE_CHECKING:
    from aspectgraph import Solid
    from planner.light.lighting import Lighting


MOST_MM = 1e7
"""Largest coordinate of a part, mm: files hold distances of a hundred times that."""


class ResolvedRequest(NamedTuple):
    """A request, and what of the part it stands for.

    Attributes
    ----------
    request : Request
        The request.
    entities : mapping of str to Entity
        What must be seen.
    """

    request: Request
    entities: Mapping[str, Any]


class ResolvedTargets(NamedTuple):
    """What is wanted, found on the part.

    Attributes
    ----------
    entities : mapping of str to Entity
        What must be seen.
    targets : tuple of Target
        What is measured.
    localisation : Localisation
        How well points are found.
    """

    entities: Mapping[str, Any]
    targets: tuple[Target, ...]
    localisation: Localisation


def resolve_request(
    solid: Solid,
    wanted: Mapping[str, Any] | Sequence[Any],
    camera: Camera,
    pose_uncertainty: PoseUncertainty,
    options: InspectionOptions,
) -> ResolvedRequest:
    """Return the request that the arguments of `plan_inspection` make.

    Parameters
    ----------
    solid, wanted, camera, pose_uncertainty, options
        As `plan_inspection` takes them.

    Raises
    ------
    RequestError
        If an argument breaks its rule.
    """
    check_accuracy(options.accuracy)
    part = solid if options.space is None else options.space.solid
    options = _in_light_of_cell(options, part)
    _check_extent(part)
    entities, targets, localisation = resolve_targets(solid, wanted, camera, options)
    options = replace(options, localisation=localisation)
    if options.effort is None and not all(target.in_image for target in targets):
        options = replace(options, effort=Effort.for_dimensions())
    request = replace(
        request_of_any_part(camera, pose_uncertainty, options),
        part=PartRecord.of(part),
        targets=targets,
        workspace=_workspace(solid, camera, options),
        ring=_ring(options, options.lighting),
        lighting=None if options.lighting is None else options.lighting.on_part(part, camera),
    )
    if options.cell is not None:
        check_kinds(cell=(options.cell, "Cell"))
        need = replace(request.requirements, cell=options.cell.region(part))
        request = replace(request, requirements=need)
    return ResolvedRequest(request, entities)


def _in_light_of_cell(options: InspectionOptions, part: Solid) -> InspectionOptions:
    """Return options with the light of the cell, which must be the one that is asked for, if one is."""
    if options.cell is None:
        return options
    from planner.light.area_lights import in_material, light_of_cell
    from planner.light.lighting import Lighting

    light = light_of_cell(options.cell)
    lighting = options.lighting
    if light is None:
        return options
    light.check_part(part)
    if lighting is None:
        return replace(options, lamps=Lighting(light))
    word = f"{light.kind}:{light.name}"
    placed = light if lighting.material is None else in_material(light, lighting.material)
    is_word = isinstance(lighting.lamps, str) and lighting.lamps.lower() == word
    if not is_word and lighting.area != placed:
        rule = f"must be left out, or be that of the cell, {word}"
        got = lighting.lamps if isinstance(lighting.lamps, str) else f"{lighting.area or 'lamps'}"
        raise RequestError.of_rule("lamps", rule, got)
    return replace(options, lamps=replace(lighting, lamps=placed))


def resolve_targets(
    solid: Solid,
    wanted: Mapping[str, Any] | Sequence[Any],
    camera: Camera,
    options: InspectionOptions,
) -> ResolvedTargets:
    """Return what is measured on a part, and how well points are found, if that is not said.

    Parameters
    ----------
    solid, wanted, camera, options
        As `plan_inspection` takes them.

    Raises
    ------
    RequestError
        If an argument breaks its rule.
    """
    items = wanted if isinstance(wanted, Mapping) else _named(solid, wanted)
    localisation = localisation_or_default(
        options.localisation, items.values(), options.edge_break_mm
    )
    items = with_surfaces_of_call(items, options.surfaces_mm, localisation)
    options = replace(options, localisation=localisation)
    return ResolvedTargets(*_resolved(solid, items, camera, options), localisation)


def _check_extent(part: Solid) -> None:
    """Refuse a part so far out that numbers about its plan would be none for a file."""
    if np.abs(part.bounds).max() > MOST_MM:
        low, high = (" ".join(f"{x:g}" for x in corner) for corner in part.bounds)
        rule = f"the part must lie within {MOST_MM:g} mm of the origin"
        hint = "its unit may be another one"
        raise RequestError.of_rule("", rule, f"one from {low} to {high} mm", hint=hint)


def request_of_any_part(
    camera: Camera, pose_uncertainty: PoseUncertainty, options: InspectionOptions
) -> Request:
    """Return a request without what depends on the part: targets, workspace and ring light.

    A field that has the name of an option is that option; so is one that is added.

    Parameters
    ----------
    camera, pose_uncertainty, options
        As `plan_inspection` takes them.

    Raises
    ------
    RequestError
        If an argument breaks its rule.
    """
    values: dict[str, Any] = {
        "part": None,
        "targets": (),
        "workspace": None,
        "ring": None,
        "camera": camera,
        "pose_uncertainty": pose_uncertainty,
        "accuracy": check_accuracy(options.accuracy),
        "probability": check_fraction("probability", options.probability),
        "seed": check_seed(options.rng),
        "requirements": options.requirements(camera, pose_uncertainty),
        "localisation": options.localisation or Localisation.rounding(),
        "surfaces_mm": surfaces_or_default(options.surfaces_mm, options.localisation),
        "registration": options.registration_record,
        "lighting": options.lighting,
        "effort": options.effort or Effort(),
    }
    if options.poses is not None:
        values["poses"] = checked_poses(options.poses)
    if options.edge_break_mm is not None:
        values["edge_break_mm"] = checked_break(options.edge_break_mm)
    for field in fields(Request):
        if field.name not in values and hasattr(options, field.name):
            values[field.name] = getattr(options, field.name)
    return Request(**values)


def problem_on(
    request: Request,
    space: Space,
    targets: Sequence[Target],
    registered: PoseUncertainty | None = None,
) -> Problem:
    """Return a request with where its targets are observable.

    Parameters
    ----------
    request : Request
        What is asked.
    space : VisibilityRegions or EntityAspectGraph
        Tells from where which entities are observable.
    targets : sequence of Target
        Those of the request that are planned.
    registered : PoseUncertainty, optional
        How poses are known when values are read. Default: no better than planned.
    """
    joined = TargetSpace.of(space, targets)
    return Problem(
        joined,
        joined.entity_names,
        request.camera,
        request.pose_uncertainty,
        request.accuracy,
        request.probability,
        request.requirements,
        tuple(targets),
        request.localisation,
        request.surfaces_mm,
        registered,
        request.edges,
    )


def _resolved(
    solid: Solid,
    items: Mapping[str, Any],
    camera: Camera,
    options: InspectionOptions,
) -> tuple[Mapping[str, Any], tuple[Target, ...]]:
    """Return the entities and the targets."""
    from aspectgraph import resolve_entities
    from planner.request.resolve import is_circle, resolve_wanted

    localisation = options.localisation
    rounded = localisation is None or localisation.model == "rounding"
    if rounded and not any(
        isinstance(item, Dimension) or is_circle(item) for item in items.values()
    ):
        present = {} if options.space is None else options.space.entities
        others = {name: item for name, item in items.items() if name not in present}
        resolved = resolve_entities(solid, others) if others else {}
        entities = {name: present[name] if name in present else resolved[name] for name in items}
        for name, entity in entities.items():
            check_is_edge(name, entity)
        return entities, edge_targets(entities, tuple(entities))
    effort = options.effort or Effort.for_dimensions()
    choice = choice_for(camera, effort.witnesses, apart=options.split == AUTO)
    return resolve_wanted(solid, items, options.accuracy, as_lengths=not rounded, choice=choice)


def _named(solid: Solid, entities: Sequence[Any]) -> Mapping[str, Any]:
    """Return entities without names under their ids."""
    from aspectgraph import resolve_entities

    return resolve_entities(solid, entities)


def _workspace(solid: Solid, camera: Camera, options: InspectionOptions) -> np.ndarray:
    from aspectgraph.visibility.visibility_regions import check_workspace

    if options.space is not None:
        return np.array(options.space.workspace, dtype=np.float64)
    box = options.workspace
    return check_workspace(default_workspace(solid, camera) if box is None else box, solid)


def _ring(options: InspectionOptions, lighting: Lighting | None) -> RingRecord | None:
    """Return contrast and step of a space in which the lamp is on the camera."""
    if options.space is not None:
        contrast = getattr(options.space, "contrast", None)
        step = getattr(options.space, "step", None)
        return None if contrast is None else RingRecord(contrast, step)
    if lighting is not None and lighting.is_ring:
        return RingRecord(lighting.contrast, lighting.step)
    return None
