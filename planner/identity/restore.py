"""A request from its identity, as plan files store it: so a plan can be made again."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, fields
from typing import Any, get_type_hints

from planner.exceptions import PlanFileError, PlannerError
from planner.identity.earlier import in_words_of_now
from planner.identity.inspection_request import SOURCE, InspectionRequest
from planner.identity.plain import restored_value
from planner.inspection_options import InspectionOptions
from planner.records.schema import field_name, shown


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
    identity = in_words_of_now(identity)
    known = {field.name: field for field in fields(InspectionRequest)}
    kinds = get_type_hints(InspectionRequest)
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
            values[name] = restored_value(kinds[name], value)
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            if isinstance(error, PlannerError):
                raise PlanFileError(f"request.{name}: {error}") from None
            raise PlanFileError(
                f"request.{name} must be as this program writes it. Got {shown(value)}."
            ) from None
    return InspectionRequest(**values)


def restored_options(request: InspectionRequest) -> InspectionOptions:
    """Return the options of `plan_inspection` that make a request again."""
    need = request.requirements
    values: dict[str, Any] = {
        field.name: getattr(record, field.name)
        for record in (need, request)
        for field in fields(InspectionOptions)
        if hasattr(record, field.name)
    }
    if need.focus_reserve.sigmas > 0:
        # the reserve of each point stands for a margin that was not given
        values["focus_margin_mm"] = None
    if any(target.surfaces_from for target in request.targets or ()):
        # tolerances of the model count only where no value was given
        values["surfaces_mm"] = None
    return InspectionOptions(**{**values, "lamps": request.lighting})
