"""A request from its identity, as plan files store it: so a plan can be made again."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import MISSING, fields
from typing import Any

import numpy as np

from errors.measurands.localisation import Localisation
from planner.camera.camera import Camera
from planner.camera.pose_uncertainty import PoseUncertainty
from planner.exceptions import PlanFileError, RequestError
from planner.identity.inspection_request import InspectionRequest, PartRecord, RingRecord
from planner.identity.of_plan import SOURCE
from planner.identity.target_record import TargetRecord
from planner.inspection_options import InspectionOptions
from planner.light.lamps import RING, LampBox, LampDome, LampsTogether
from planner.light.lighting import Lighting
from planner.records.schema import field_name, shown
from planner.request.constraints import Requirements
from planner.request.effort import Effort
from planner.request.focus_reserve import FocusReserve
from planner.request.reach import BoxRegion, Reach, SphereRegion
from planner.showing.showing import Showing


def restored_request(identity: Mapping[str, Any]) -> InspectionRequest:
    """Return the request whose identity this is.

    Parameters
    ----------
    identity : mapping
        As `InspectionRequest.identity` returns it, and as plan files hold it under ``request``.

    Raises
    ------
    PlanFileError
        If a field is missing, wrong or unknown, or cannot be in a file; names it.
    """
    known = {field.name: field for field in fields(InspectionRequest)}
    for name in identity:
        if name not in known and name != SOURCE:
            raise PlanFileError(
                f"{field_name('request', name)} must be known to this program. Got an unknown field."
            )
    values = {}
    for name, field in known.items():
        if name not in identity and field.default is MISSING:
            raise PlanFileError(f"request.{name} must be given. Got none.")
        value = identity.get(name, field.default)
        try:
            make = _MAKERS.get(name)
            values[name] = value if make is None or value is None else make(value)
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            if isinstance(error, PlanFileError | RequestError):
                raise PlanFileError(f"request.{name}: {error}") from None
            raise PlanFileError(
                f"request.{name} must be as this program writes it. Got {shown(value)}."
            ) from None
    return InspectionRequest(**values)


def restored_options(request: InspectionRequest) -> InspectionOptions:
    """Return the options of `plan_inspection` that make a request again."""
    need = request.requirements
    own = {field.name: field for field in fields(InspectionOptions)}
    values: dict[str, Any] = {
        name: getattr(record, name)
        for record in (need, request)
        for name in own
        if hasattr(record, name)
    }
    if need.focus_reserve.sigmas > 0:
        # the reserve of each point stands for a margin that was not given
        values["focus_margin_mm"] = None
    return InspectionOptions(**{**values, "lamps": request.lighting})


def _requirements(data: Mapping[str, Any]) -> Requirements:
    made = {
        "showing": Showing(**data["showing"]),
        "reach": _reach(data["reach"]),
        "focus_reserve": FocusReserve(
            **{name: float(x) for name, x in data["focus_reserve"].items()}
        ),
    }
    return Requirements(**{**data, **made})


def _reach(data: Mapping[str, Any] | None) -> Reach | None:
    if data is None:
        return None
    if data.get("kind") == "BoxRegion":
        return BoxRegion(tuple(data["low"]), tuple(data["high"]))
    if data.get("kind") == "SphereRegion":
        return SphereRegion(tuple(data["centre"]), data["radius_mm"])
    name = next(iter(data.values()), "nothing")
    raise PlanFileError(f"reach must be a box or a ball to be in a file. Got {name}.")


def _lighting(data: Mapping[str, Any]) -> Lighting:
    return Lighting(**{**data, "lamps": _lamps(data["lamps"])})


def _lamps(data: Any) -> Any:
    if data is None:
        return RING
    if not isinstance(data, Mapping):
        return data
    fields_of = {key: value for key, value in data.items() if key != "kind"}
    kinds: dict[str, Callable[..., Any]] = {"LampBox": LampBox, "LampDome": LampDome}
    if data["kind"] == "LampsTogether":
        return LampsTogether(_lamps(data["lamps"]))
    for name in ("low", "high", "centre"):
        if name in fields_of:
            fields_of[name] = tuple(fields_of[name])
    if "reach" in fields_of:
        fields_of["reach"] = _reach(fields_of["reach"])
    return kinds[data["kind"]](**fields_of)


_MAKERS: dict[str, Callable[[Any], Any]] = {
    "part": lambda data: PartRecord(**data),
    "targets": lambda data: tuple(map(TargetRecord.from_dict, data)),
    "camera": Camera.from_dict,
    "pose_uncertainty": PoseUncertainty.from_dict,
    "localisation": Localisation.from_dict,
    "requirements": _requirements,
    "workspace": lambda data: np.array(data, dtype=np.float64),
    "lighting": _lighting,
    "ring": lambda data: RingRecord(**data),
    "effort": lambda data: Effort(**data),
}
