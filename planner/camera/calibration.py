"""What calibration programs say of a camera, as the fields of `Camera`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from planner.argument_kinds import shown
from planner.camera.checks import check_pair, check_positive
from planner.camera.distortion import Distortion
from planner.exceptions import CameraError

_NEEDED = ("pixel_pitch_mm", "f_number", "focus_distance_mm")


def opencv_fields(
    matrix: ArrayLike,
    distortion: ArrayLike | Distortion | None,
    image_size: tuple[int, int],
    lens: Mapping[str, Any],
) -> dict[str, Any]:
    """Return the fields of the camera that OpenCV calibrated; see `Camera.from_opencv`."""
    try:
        k = np.asarray(matrix, dtype=float)
    except (TypeError, ValueError):
        k = np.empty(0)
    if (
        k.shape != (3, 3)
        or not np.isfinite(k).all()
        or k[0, 1]
        or k[1, 0]
        or (k[2] != [0.0, 0.0, 1.0]).any()
    ):
        raise CameraError.of_rule(
            "matrix", "must be [[f_x, 0, c_x], [0, f_y, c_y], [0, 0, 1]]", shown(matrix)
        )
    scale_x = check_positive("f_x", k[0, 0])
    scale_y = check_positive("f_y", k[1, 1])
    for name in _NEEDED:
        if name not in lens:
            rule = "must be given: a calibration in pixels does not know it"
            raise CameraError.of_rule(name, rule, "none")
    pitch = check_positive("pixel_pitch_mm", lens["pixel_pitch_mm"])
    focus = check_positive("focus_distance_mm", lens["focus_distance_mm"])
    distance = scale_x * pitch
    return {
        **lens,
        "focal_length_mm": 1.0 / (1.0 / distance + 1.0 / focus),
        "pixel_pitch_mm": (pitch, distance / scale_y),
        "resolution": check_pair("image_size", image_size),
        "principal_point_px": (float(k[0, 2]), float(k[1, 2])),
        "distortion": Distortion.of(distortion),
    }
