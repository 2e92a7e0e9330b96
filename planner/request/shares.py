"""How much of its room a condition leaves: its slack as a share of what a practitioner would call full.

The room of each condition, by the name of its margin:

focus_mm          half the depth of field, less the reserve on the axis
field_of_view_px  half the sensor's shorter side, less the strip along its sides
resolution_mm     the least length that is asked for
clearance_mm      the stand-off
workspace_mm      a tenth of the workspace's shortest side
separation_px     the separation asked for
corner_deg        the angle asked for

The room of a probability is 1 - p. A share of 0 is at the limit. What is met or missed without a number, such as
visibility, has no share.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.camera.camera import Camera

FULL = 1.0
"""Share beyond which more room is of no use."""

_WALL_SHARE = 10.0


def rooms(
    camera: Camera,
    workspace: NDArray[np.float64],
    requirements: Mapping[str, float],
    focus_reserve_mm: float = 0.0,
) -> dict[str, float]:
    """Return the room of each condition, in its own unit, by the name of its margin.

    Parameters
    ----------
    camera : Camera
        Gives depth of field and sensor.
    workspace : array (2, 3)
        Lowest and highest corner, mm.
    requirements : mapping of str to float
        As `Requirements.to_dict` returns them; conditions that it does not name have no room.
    focus_reserve_mm : float
        What points on the axis keep from both limits of the depth of field.
    """
    near, far = camera.depth_of_field_mm
    depth = (far - near) / 2 if np.isfinite(far) else camera.focus_distance_mm
    border_px = requirements.get("field_margin_px", 0.0) + requirements.get("surround_px", 0.0)
    found = {
        "focus_mm": depth - max(focus_reserve_mm, requirements.get("focus_margin_mm", 0.0)),
        "field_of_view_px": min(camera.resolution) / 2 - border_px,
        "resolution_mm": requirements.get("min_length_px", 0.0) * max(camera.pixel_pitch_mm),
        "clearance_mm": requirements.get("stand_off_mm", 0.0),
        "workspace_mm": float(np.ptp(np.asarray(workspace), axis=0).min()) / _WALL_SHARE,
        "separation_px": requirements.get("separation_px", 0.0),
        "corner_deg": requirements.get("min_corner_deg", 0.0),
    }
    return {name: float(room) for name, room in found.items() if room > 0.0}


def shares(margins: Mapping[str, Any], room: Mapping[str, float]) -> dict[str, NDArray[np.float64]]:
    """Return margins as shares of their rooms, `FULL` at most; of those conditions that have one."""
    return {
        name: np.minimum(np.asarray(margin) / room[name], FULL)
        for name, margin in margins.items()
        if name in room
    }


def probability_share(probability: ArrayLike, required: float) -> Any:
    """Return (P - p) / (1 - p) of probabilities, p the required one."""
    return (np.asarray(probability) - required) / (1.0 - required)
