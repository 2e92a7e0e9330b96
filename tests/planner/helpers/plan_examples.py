"""A hand-made plan that needs no search, for the tests of everything that comes after one."""

from dataclasses import fields, replace

import numpy as np

from errors.measurands import Localisation
from errors.measurands.measurand import measurand
from planner import (
    Camera,
    Detectability,
    Effort,
    Exposure,
    LightPlan,
    LitImage,
    PoseUncertainty,
    SensorSetting,
    look_at,
)
from planner.identity import PartRecord, Request
from planner.plan import InspectionPlan
from planner.request.constraints import Requirements
from planner.request.targets import EntityRecord, PlannedDimension, Witness, edge_target

# a plan within a second, with margins that are hardly moved
BRIEF = Effort(
    viewpoints=10, pricing_rounds=2, refutations=1, bound_nodes=1000, margin_generations=3
)

CAMERA = Camera(25.0, (0.00345, 0.0035), (2448, 2048), 8.0, 600.0, name="test camera")
UNCERTAINTY = PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.001)
ENTITIES = {
    "top front": [[0.0, 0.0, 60.0], [80.0, 0.0, 60.0]],
    "top right": [[80.0, 0.0, 60.0], [80.0, 50.0, 60.0]],
    "bottom": [[0.0, 0.0, 0.0], [80.0, 0.0, 0.0]],
}
LIGHT = LightPlan(
    "placed",
    0.1,
    0.05,
    "dark",
    np.array([[40.0, -300.0, 500.0], [300.0, 25.0, 90.0]]),
    (
        (
            LitImage(
                (0,),
                {"top front": 0.3, "top right": 1.0},
                ("top right",),
                Exposure("top right", (1200, 800), "top front", 2.5),
            ),
        ),
        (LitImage((1,), {"top right": 0.76}),),
    ),
    ({}, {}),
    1,
    "test",
)


def setting(position, names, target=(40.0, 25.0, 60.0), roll=0.3, probability=0.95):
    return SensorSetting(
        cam2world=look_at([position], target, roll=roll)[0],
        entities=tuple(names),
        probability={name: probability - 0.01 * k for k, name in enumerate(names)},
        margins={"resolution_mm": 0.4, "focus_mm": 12.5, "reach": float("inf")},
        fitness=probability * len(names),
        nfev=1200,
        generations=7,
        message="converged",
        seed=3,
    )


REQUEST = Request(
    part=PartRecord("block", "0" * 64),
    targets=tuple(edge_target(name, ends) for name, ends in ENTITIES.items()),
    camera=CAMERA,
    pose_uncertainty=UNCERTAINTY,
    localisation=Localisation.rounding(),
    accuracy=0.98,
    probability=0.9,
    requirements=Requirements(),
    workspace=np.array([[-900.0, -900.0, -900.0], [900.0, 900.0, 900.0]]),
    lighting=None,
    ring=None,
    seed=5,
    effort=Effort(),
)


def witness(kind, entities, geometry, direction=None):
    """A set of entities by their names, and what is measured of them."""
    records = tuple(EntityRecord(name, "edge") for name in entities)
    return Witness(records, measurand(kind, geometry, direction))


def planned_dimension(
    kind, entities, geometry, permitted_error, localisation=None, tolerance=None, **fields
):
    """A dimension as a plan holds it, by the names and lines of its entities."""
    found = witness(kind, entities, geometry, fields.get("direction"))
    if localisation is not None:
        fields["localisation"] = localisation
    return PlannedDimension("it", (found,), kind, permitted_error, tolerance, **fields)


def request_with(request=REQUEST, entities=None, dimensions=None, **changes):
    """A request with other fields; edges by their ends, and dimensions in their place by name."""
    if isinstance(changes.get("part"), str):
        changes["part"] = PartRecord(changes["part"], "0" * 64)
    limits = changes.get("requirements")
    if isinstance(limits, dict):
        of_images = {field.name: limits.get(field.name, 0.0) for field in fields(Detectability)}
        others = {name: value for name, value in limits.items() if name not in of_images}
        nothing = dict.fromkeys(("min_length_px", "stand_off_mm"), 0.0)
        changes["requirements"] = Requirements(
            **(nothing | others), showing=Detectability(**of_images)
        )
    if entities is not None or dimensions is not None:
        ends = ENTITIES if entities is None else entities
        edges = {name: edge_target(name, points) for name, points in ends.items()}
        known = {name: replace(one, name=name) for name, one in (dimensions or {}).items()}
        changes["targets"] = tuple((edges | known).values())
    return replace(request, **changes)


def plan_with(request=REQUEST, **changes):
    """A plan of this request with other fields, those of the request among them."""
    own = {field.name for field in fields(InspectionPlan)}
    asked = {name: value for name, value in changes.items() if name not in own}
    planned = {name: value for name, value in changes.items() if name in own}
    return InspectionPlan(request_with(request, **asked), **planned)


def changed(plan, **changes):
    """The same plan with other fields, those of its request among them."""
    own = {field.name: getattr(plan, field.name) for field in fields(InspectionPlan)}
    return plan_with(own.pop("request"), **(own | changes))


def plan(request=REQUEST, **changes):
    known = {
        "settings": (
            setting((40.0, -180.0, 620.0), ["top front", "top right"]),
            setting((250.0, 40.0, 600.0), ["top right"], probability=0.99),
        ),
        "lower_bound": 1,
        "uninspectable": {"bottom": "unobservable: no viewpoint of the workspace sees all of it."},
        "bound_proof": "test",
    }
    return plan_with(request, **(known | changes))
