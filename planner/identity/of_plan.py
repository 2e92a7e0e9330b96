"""The request of a plan: as its file stores it, or what is known of it where the file is of an earlier program."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from planner.identity.difference import keyword
from planner.identity.inspection_request import InspectionRequest
from planner.identity.plain import plain_value
from planner.plan import InspectionPlan
from planner.showing.showing import NOT_ASKED

# beside the request: how the part's file was read
SOURCE = "source"
# numbers that went through a file keep all digits; those computed again may differ in the last
_SAME = 1e-9
_OF_DIMENSIONS = ("kind", "permitted_error", "tolerance", "direction")


def plan_difference(
    request: InspectionRequest, plan: InspectionPlan, words: Callable[[str], str] = keyword
) -> str | None:
    """Return in what the request of an earlier plan differs from a request.

    Parameters
    ----------
    request : InspectionRequest
        What is asked now.
    plan : InspectionPlan
        The earlier plan. If its file does not store the request, what the plan tells is compared.
    words : callable
        Returns what the caller knows a field as.

    Returns
    -------
    str or None
        The first difference; None if it is the same request.
    """
    if plan.request:
        stored = {name: value for name, value in plan.request.items() if name != SOURCE}
        return request.difference(stored, words, tolerance=_SAME)
    return request.difference(_told_by(plan), words, tolerance=_SAME, partial=True)


def _told_by(plan: InspectionPlan) -> dict[str, Any]:
    """Return what a plan without its request tells of it."""
    targets = []
    dimensions = {name: one.to_dict() for name, one in plan.dimensions.items()}
    for name, ends in plan.entities.items():
        more = {key: dimensions[name][key] for key in _OF_DIMENSIONS if name in dimensions}
        targets.append({"name": name, "ends": ends.tolist(), **more})
    known: dict[str, Any] = {
        "part": {"name": plan.part},
        "targets": targets,
        "camera": plain_value(plan.camera),
        "pose_uncertainty": plain_value(plan.pose_uncertainty),
        "accuracy": plan.accuracy,
        "probability": plan.probability,
        "workspace": plan.workspace.tolist(),
        "seed": plan.seed,
    }
    for one in dimensions.values():
        known["localisation"] = one["localisation"]
    if plan.requirements:
        asked = plain_value(NOT_ASKED)
        limits = dict(plan.requirements)
        known["requirements"] = {
            **{name: value for name, value in limits.items() if name not in asked},
            "showing": {name: limits.get(name, value) for name, value in asked.items()},
        }
    if plan.light is not None:
        light = plan.light
        known["lighting"] = {
            "contrast": light.contrast,
            "step": light.step,
            "ground": light.ground,
        }
    return known
