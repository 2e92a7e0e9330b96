"""From the arguments of a call to the request: entities and targets are found on the part, defaults become numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from errors.measurands.geometry import Localisation
from planner.argument_kinds import check_fraction, check_kinds
from planner.camera.camera import Camera
from planner.camera.pose import PoseUncertainty
from planner.effort import Effort
from planner.exceptions import RequestError
from planner.identity import InspectionRequest, PartRecord, RingRecord, target_records
from planner.options import InspectionOptions
from planner.request.defaults import check_seed, default_workspace
from planner.request.dimension import Dimension
from planner.request.dimension_files import (
    localisation_or_default,
    surfaces_or_default,
    with_surfaces_of_call,
)
from planner.request.request import choice_for
from planner.request.targets import Target, check_is_edge, edge_targets

if TYPE_CHECKING:
    from aspectgraph import Solid
    from planner.light.lighting import Lighting


MOST_MM = 1e7
"""Largest coordinate of a part, mm: files hold distances of a hundred times that."""


class Promise(NamedTuple):
    """What is required of every measurement, and the seed that repeats the plan.

    Attributes
    ----------
    accuracy, probability : float
        In (0, 1).
    rng : int or numpy.random.Generator
        The seed; a generator is asked for one.
    """

    accuracy: float
    probability: float
    rng: int | np.random.Generator = 0


class ResolvedRequest(NamedTuple):
    """A request, and what of the part it stands for.

    Attributes
    ----------
    request : InspectionRequest
        The request.
    entities : mapping of str to Entity
        What must be seen.
    targets : tuple of Target
        What is measured.
    """

    request: InspectionRequest
    entities: Mapping[str, Any]
    targets: tuple[Target, ...]


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
    promise: Promise,
    options: InspectionOptions,
) -> ResolvedRequest:
    """Return the request that the arguments of `plan_inspection` make.

    Parameters
    ----------
    solid, wanted, camera, pose_uncertainty, options
        As `plan_inspection` takes them.
    promise : Promise
        Accuracy, probability and seed.

    Raises
    ------
    RequestError
        If an argument breaks its rule.
    """
    lighting = options.lighting
    accuracy = check_fraction("accuracy", promise.accuracy)
    space = options.space
    part = solid if space is None else space.solid
    _check_extent(part)
    entities, targets, found_by = resolve_targets(solid, wanted, camera, accuracy, options)
    options = replace(options, localisation=found_by)
    known = {
        "part": PartRecord.of(part),
        "targets": target_records(entities, targets),
        "workspace": _workspace(solid, camera, options),
        "ring": _ring(options, lighting),
        **promised(camera, pose_uncertainty, promise, options),
    }
    if options.cell is not None:
        check_kinds(cell=(options.cell, "Cell"))
        need = known["requirements"]
        known["requirements"] = replace(need, cell=options.cell.region(part))
    if options.effort is None and not all(target.in_image for target in targets):
        known["effort"] = Effort.for_dimensions()
    return ResolvedRequest(InspectionRequest(**known), entities, targets)


def resolve_targets(
    solid: Solid,
    wanted: Mapping[str, Any] | Sequence[Any],
    camera: Camera,
    accuracy: float,
    options: InspectionOptions,
) -> ResolvedTargets:
    """Return what is measured on a part, and how well points are found, if that is not said.

    Parameters
    ----------
    solid, wanted, camera, options
        As `plan_inspection` takes them.
    accuracy : float
        Required of what has no requirement of its own.

    Raises
    ------
    RequestError
        If an argument breaks its rule.
    """
    items = wanted if isinstance(wanted, Mapping) else _named(solid, wanted)
    found_by = localisation_or_default(options.localisation, items.values())
    items = with_surfaces_of_call(items, options.surfaces_mm, found_by)
    entities, targets = _resolved(
        solid, items, camera, accuracy, replace(options, localisation=found_by)
    )
    return ResolvedTargets(entities, targets, found_by)


def _check_extent(part: Solid) -> None:
    """Refuse a part so far out that numbers about its plan would be none for a file."""
    if np.abs(part.bounds).max() > MOST_MM:
        low, high = (" ".join(f"{x:g}" for x in corner) for corner in part.bounds)
        rule = f"the part must lie within {MOST_MM:g} mm of the origin"
        hint = "its unit may be another one"
        raise RequestError.of_rule("", rule, f"one from {low} to {high} mm", hint=hint)


def promised(
    camera: Camera,
    pose_uncertainty: PoseUncertainty,
    promise: Promise,
    options: InspectionOptions,
) -> dict[str, Any]:
    """Return the fields of a request that do not depend on the part, by name.

    A field that has the name of an option is that option; so is one that is added.
    """
    known: dict[str, Any] = {
        "camera": camera,
        "pose_uncertainty": pose_uncertainty,
        "accuracy": check_fraction("accuracy", promise.accuracy),
        "probability": check_fraction("probability", promise.probability),
        "seed": check_seed(promise.rng),
        "requirements": options.requirements(camera, pose_uncertainty),
        "localisation": options.localisation or Localisation.rounding(),
        "surfaces_mm": surfaces_or_default(options.surfaces_mm, options.localisation),
        "registration": options.registration_record,
        "lighting": options.lighting,
        "effort": options.effort or Effort(),
    }
    apart = ("part", "targets", "workspace", "ring")
    for field in fields(InspectionRequest):
        if field.name not in known and field.name not in apart and hasattr(options, field.name):
            known[field.name] = getattr(options, field.name)
    return known


def _resolved(
    solid: Solid,
    items: Mapping[str, Any],
    camera: Camera,
    accuracy: float,
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
        known = {} if options.space is None else options.space.entities
        others = {name: item for name, item in items.items() if name not in known}
        resolved = resolve_entities(solid, others) if others else {}
        entities = {name: known[name] if name in known else resolved[name] for name in items}
        for name, entity in entities.items():
            check_is_edge(name, entity)
        return entities, edge_targets(entities, tuple(entities))
    effort = options.effort or Effort.for_dimensions()
    choice = choice_for(camera, effort.witnesses)
    return resolve_wanted(solid, items, accuracy, as_lengths=not rounded, choice=choice)


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
