"""How sure each dimension of a setting is measured, and what limits it: computed from the plan alone."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.camera.imaging import image_of
from planner.camera.pose import world_to_cam
from planner.request.focus_reserve import NO_RESERVE, FocusReserve
from planner.request.shares import probability_share, rooms, shares
from planner.wanted.planned import targets_of
from planner.wanted.pose_knowledge import means_at


@dataclass(frozen=True)
class Measurement:
    """How sure a dimension is measured from a setting.

    Attributes
    ----------
    standard_uncertainty, expanded_uncertainty : float
        u, and U with k = 2, mm (angles: degrees); of a short arc from quantiles, see `errors.measurands.Prediction`.
    bias : float
        Mean error, mm (angles: degrees).
    budget : dict of str to float
        Variance by "translation", "rotation", "localisation", "localisation_floor" and "surfaces", mm² (angles:
        degrees²).
    permitted_error_px : float or None
        The permitted error times the image's scale d / (z r), with the mean depth z of the entities and the larger
        pixel pitch r; None of an angle.
    binding : str
        What has the smallest share of its room left (`planner.request.shares`): "probability", "focus" or
        "field of view".
    """

    standard_uncertainty: float
    expanded_uncertainty: float
    bias: float
    budget: dict[str, float]
    permitted_error_px: float | None
    binding: str


def measurements(plan: Any, setting: Any) -> dict[str, Measurement]:
    """Return how sure each dimension that a setting inspects is measured.

    Parameters
    ----------
    plan : InspectionPlan
        Gives dimensions, camera and pose uncertainty.
    setting : Any
        One of its settings.

    Returns
    -------
    dict of str to Measurement
        By name, in the setting's order; nothing of edges.
    """
    return {
        name: _measurement(plan, setting, name)
        for name in setting.entities
        if name in plan.dimensions
    }


def measurements_dict(plan: Any, setting: Any) -> dict[str, dict[str, Any]]:
    """Return the same as plain values for a plan file.

    Parameters
    ----------
    plan : InspectionPlan
        The plan.
    setting : Any
        One of its settings.

    Returns
    -------
    dict
        Fields of each `Measurement` by name.
    """
    return {name: asdict(one) for name, one in measurements(plan, setting).items()}


def _measurement(plan: Any, setting: Any, name: str) -> Measurement:
    target = targets_of(plan.targets, setting)[name]
    described = target.describe(setting.cam2world, means_at(plan.means, setting, name))
    points = world_to_cam(target.points, setting.cam2world)
    margins = {
        "probability": float(probability_share(setting.promise[name], plan.probability)),
        **_image_shares(plan, points),
    }
    return Measurement(
        described.standard_uncertainty,
        described.expanded_uncertainty,
        described.bias,
        dict(described.budget),
        target.permitted_error_px(setting.cam2world, plan.camera),
        min(margins, key=lambda key: margins[key]),
    )


def _image_shares(plan: Any, points: NDArray[np.float64]) -> dict[str, float]:
    """Return the shares of focus and field of view that are left for points (n, 3) in the camera frame."""
    camera = plan.camera
    need = plan.requirements
    reserve = NO_RESERVE
    if need.get("focus_sigmas", 0.0) > 0.0:
        reserve = FocusReserve.of(camera, plan.pose_uncertainty)
    room = rooms(camera, plan.workspace, need, reserve.on_axis_mm)
    near, far = camera.depth_of_field_mm
    depth = points[:, 2]
    kept = np.maximum(reserve.margin_mm(points), need.get("focus_margin_mm", 0.0))
    focus = np.minimum(depth - near, far - depth) - kept
    pixels = image_of(camera, points / depth[:, None])
    sides = np.minimum(pixels + 0.5, np.array(camera.resolution) - 0.5 - pixels)
    border = need.get("field_margin_px", 0.0) + need.get("surround_px", 0.0)
    margins = {"focus_mm": focus.min(), "field_of_view_px": sides.min() - border}
    found = shares(margins, room)
    return {
        name: float(found[key])
        for key, name in (("focus_mm", "focus"), ("field_of_view_px", "field of view"))
        if key in found
    }
