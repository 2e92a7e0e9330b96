"""Which constraint fixes the pose of a setting: how near each is to its limit, on one scale."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from planner.request.focus_reserve import FocusReserve
from planner.request.shares import probability_share, rooms, shares

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
    """How near a setting is to a constraint.

    Attributes
    ----------
    name : str
        The constraint in words.
    share : float
        Share of its room that is left; 0: at its limit.
    meaning : str
        What a small share means.
    key : str or None
        Its margin's key in the setting's margins; None of the probability, which is no margin.
    """

    name: str
    share: float
    meaning: str
    key: str | None = None


def nearest_limits(plan: InspectionPlan, setting: SensorSetting) -> list[LimitShare]:
    """Return constraints by what they leave, the one that binds first.

    The rooms are those of `planner.request.shares`. What is met or missed without a number, such as visibility, is not
    among them.

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
    reserve_mm = 0.0
    if plan.requirements.get("focus_sigmas", 0.0) > 0.0:
        reserve_mm = FocusReserve.of(plan.camera, plan.pose_uncertainty).on_axis_mm
    room = rooms(plan.camera, plan.workspace, plan.requirements, reserve_mm)
    least = probability_share(min(setting.promise.values()), plan.probability)
    found = [LimitShare("probability", float(least), _MEANS["probability"])]
    finite = {key: margin for key, margin in setting.margins.items() if np.isfinite(margin)}
    for key, share in shares(finite, room).items():
        name = key.rpartition("_")[0].replace("_", " ")
        found.append(LimitShare(name, float(share), _MEANS[name], key))
    return sorted(found, key=lambda one: one.share)
