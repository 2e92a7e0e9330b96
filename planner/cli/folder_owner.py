"""An output folder belongs to one plan: another one does not replace it by accident."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from planner.camera.camera import Camera
from planner.camera.pose_uncertainty import PoseUncertainty
from planner.cli.light import light_request
from planner.exceptions import OutputError, PlanFileError
from planner.inspection_options import InspectionOptions
from planner.plan import InspectionPlan, read_plan

# numbers that went through a file keep all digits; those computed again may differ in the last
_SAME = 1e-9
_RULE = "--out must be a folder without another plan; --force replaces it."


def request_of(plan: InspectionPlan) -> dict[str, Any]:
    """Return what a plan was asked for, as plain values by the name a user knows."""
    return {
        "part": plan.part,
        "set of entities": sorted(plan.entities),
        "camera": plan.camera.to_dict(),
        "pose uncertainty": plan.pose_uncertainty.covariance.tolist(),
        "accuracy": plan.accuracy,
        "probability": plan.probability,
        "seed": plan.seed,
        "workspace": plan.workspace.tolist(),
        "limits": dict(plan.requirements),
        "light": _light_of(plan),
    }


def asked_request(
    options: Any,
    part: str,
    names: Mapping[str, Any],
    camera: Camera,
    uncertainty: PoseUncertainty,
    how: InspectionOptions,
) -> dict[str, Any]:
    """Return the same of a request that is not planned yet; ``how`` holds its limits and its workspace."""
    return {
        "part": part,
        "set of entities": sorted(names),
        "camera": camera.to_dict(),
        "pose uncertainty": uncertainty.covariance.tolist(),
        "accuracy": options.accuracy,
        "probability": options.probability,
        "seed": options.seed,
        "workspace": np.asarray(how.workspace, dtype=float).tolist(),
        "limits": how.requirements(camera, uncertainty).to_dict(),
        "light": light_request(options),
    }


def check_owner(folder: Path, asked: Mapping[str, Any], *, force: bool) -> None:
    """Refuse a folder that holds the plan of another request.

    Parameters
    ----------
    folder : pathlib.Path
        The output folder.
    asked : mapping
        See `asked_request`.
    force : bool
        Replace whatever is there.

    Raises
    ------
    OutputError
        If there is a plan, and it is of another request or cannot be read; names the first difference.
    """
    path = folder / "plan.json"
    if force or not path.exists():
        return
    try:
        found = request_of(read_plan(path))
    except PlanFileError as error:
        raise OutputError(f"{_RULE} Got {error}") from None
    for name, value in asked.items():
        # a file of an earlier program knows no limits
        if found[name] != {} and not _same(found[name], value):
            told = (
                f", {found[name]!r} and not {value!r}"
                if isinstance(value, str | int | float)
                else ""
            )
            raise OutputError(f"{_RULE} Got {path} with another {name}{told}.")


def _light_of(plan: InspectionPlan) -> dict[str, Any]:
    """Return what was asked of the lamps of a plan; nothing if it has none, as any may be added."""
    light = plan.light
    return (
        {}
        if light is None
        else {
            "kind": light.kind,
            "contrast": light.contrast,
            "step": light.step,
            "ground": light.ground,
            "together": light.together,
        }
    )


def _same(first: Any, second: Any) -> bool:
    """Compare plain values, numbers up to rounding."""
    if isinstance(first, Mapping) and isinstance(second, Mapping):
        return first.keys() == second.keys() and all(
            _same(first[key], second[key]) for key in first
        )
    if isinstance(first, list | tuple) and isinstance(second, list | tuple):
        return len(first) == len(second) and all(map(_same, first, second))
    if isinstance(first, int | float) and isinstance(second, int | float):
        return abs(first - second) <= _SAME * max(abs(first), abs(second))
    return bool(first == second)
