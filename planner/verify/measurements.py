"""How sure each dimension of a setting is measured, and what limits it: computed from the plan alone."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.camera.camera import Camera
from planner.camera.imaging import image_of
from planner.camera.pose import world_to_cam


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
        What has the smallest relative margin: "probability" (P − p as a share of 1 − p), "focus" (the nearest limit
        as a share of half the depth of field) or "field of view" (distance from the sensor's side as a share of half
        the shorter side).
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
    target = plan.targets[name]
    described = target.describe(setting.cam2world, plan.means)
    points = world_to_cam(target.points, setting.cam2world)
    margins = {
        "probability": (setting.probability[name] - plan.probability) / (1 - plan.probability),
        **_image_margins(points, plan.camera),
    }
    return Measurement(
        described.standard_uncertainty,
        described.expanded_uncertainty,
        described.bias,
        dict(described.budget),
        target.permitted_error_px(setting.cam2world, plan.camera),
        min(margins, key=lambda key: margins[key]),
    )


def _image_margins(points: NDArray[np.float64], camera: Camera) -> dict[str, float]:
    """Return what is left of focus and field of view for points (n, 3) in the camera frame, as shares."""
    near, far = camera.depth_of_field_mm
    half_depth = (far - near) / 2 if np.isfinite(far) else camera.focus_distance_mm
    depth = points[:, 2]
    pixels = image_of(camera, points / depth[:, None])
    size = np.array(camera.resolution)
    sides = np.minimum(pixels + 0.5, size - 0.5 - pixels)
    return {
        "focus": float(min((depth - near).min(), (far - depth).min()) / half_depth),
        "field of view": float(sides.min() / (size.min() / 2)),
    }
