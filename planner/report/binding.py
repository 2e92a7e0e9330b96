"""Which constraint fixes the pose of a setting: how near each is to its limit, on one scale."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from planner.plan import InspectionPlan
    from planner.setting.sensor_setting import SensorSetting

_MEANS = {
    "focus": "the depth of field fixes the distance",
    "field of view": "a target is close to the side of the sensor",
    "resolution": "farther away, the image of an edge would be too short",
    "workspace": "the camera is at a wall of its workspace",
    "clearance": "the camera is as close to the part as it may be",
    "separation": "another line is close to an edge in the image",
    "corner": "the lines at the end of an edge meet at a small angle in the image",
    "probability": "the required probability fixes the pose",
}


class LimitShare(NamedTuple):
    """A constraint: its name, which share of its room is left (0: at its limit), and what that means."""

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
