"""Which constraint fixes the pose of a setting: how near each is to its limit, on one scale."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from planner.plan import InspectionPlan
    from planner.setting.sensor_setting import SensorSetting

_MEANS = {
    "focus": "the distance is held by the depth of field",
    "field of view": "what is measured would come too near to the sensor's side",
    "resolution": "the camera must be so near that the image is long enough",
    "workspace": "the camera stands at a wall of its workspace",
    "clearance": "the camera stands as near to the part as it may",
    "separation": "another line would come too near to an edge in the image",
    "corner": "the lines at an end would leave it at too small an angle in the image",
    "probability": "the pose is fixed by how sure the measurement must be",
}


class LimitShare(NamedTuple):
    """How much a constraint leaves: its name, the share of its room (0: at its limit), and what that means."""

    name: str
    share: float
    meaning: str


def nearest_limits(plan: InspectionPlan, setting: SensorSetting) -> list[LimitShare]:
    """Return constraints by what they leave, the one that binds first.

    The room of each is: half the depth of field; half the sensor's shorter side; the image's length, of the shortest;
    half the workspace's shortest side; the distance from the part; the separation and the angle asked for, which may be
    exceeded; 1 − p for the probability. What is met or missed without a number, such as visibility, is not among them.

    Parameters
    ----------
    plan : InspectionPlan
        Gives the request.
    setting : SensorSetting
        One of its settings.

    Returns
    -------
    list of LimitShare
        Those the plan knows enough of.
    """
    rooms = _rooms(plan, setting)
    shares = {
        "probability": (min(setting.probability.values()) - plan.probability)
        / (1 - plan.probability)
    }
    for key, margin in setting.margins.items():
        name = key.rpartition("_")[0].replace("_", " ")
        room = rooms.get(key)
        if room is not None and np.isfinite(margin) and room > 0:
            shares[name] = min(margin / room, 1.0)
    order = sorted(shares, key=lambda name: shares[name])
    return [LimitShare(name, shares[name], _MEANS[name]) for name in order]


def _rooms(plan: InspectionPlan, setting: SensorSetting) -> dict[str, float]:
    """Return what a constraint would leave at most, in its own unit, by the key of its margin."""
    camera = plan.camera
    need = plan.requirements
    margins = setting.margins
    near, far = camera.depth_of_field_mm
    rooms = {
        "focus_mm": (far - near) / 2 if np.isfinite(far) else camera.focus_distance_mm,
        "field_of_view_px": min(camera.resolution) / 2,
        "workspace_mm": float(np.ptp(np.asarray(plan.workspace), axis=0).min()) / 2,
    }
    if need:
        if "clearance_mm" in margins:
            rooms["clearance_mm"] = margins["clearance_mm"] + need["stand_off_mm"]
        rooms["separation_px"] = need.get("separation_px", 0.0)
        rooms["corner_deg"] = need.get("min_corner_deg", 0.0)
        if "resolution_mm" in margins:
            rooms["resolution_mm"] = margins["resolution_mm"] + need["min_length_px"] * max(
                camera.pixel_pitch_mm
            )
    return rooms
