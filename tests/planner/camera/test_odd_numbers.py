"""Numbers that no camera has, and camera files that no computer should read: refused by name, shortly."""

import numpy as np
import pytest

from planner import Camera, CameraError, PoseUncertainty
from planner.exceptions import UncertaintyError

GOOD = {
    "focal_length_mm": 25.0,
    "pixel_pitch_mm": (0.00345, 0.00345),
    "resolution": (2448, 2048),
    "f_number": 8.0,
    "focus_distance_mm": 600.0,
}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"focal_length_mm": None}, r"focal_length_mm must be finite and positive\. Got None"),
        (
            {"focal_length_mm": 10**400},
            r"focal_length_mm must be finite and positive\. Got an integer of 1329 bits",
        ),
        ({"f_number": "8"}, r"f_number must be finite and positive\. Got '8'"),
        (
            {"focus_distance_mm": 1e12},
            r"focus_distance_mm must be in \[1e-09, 1e\+09\]\. Got 1e\+12",
        ),
        (
            {"pixel_pitch_mm": 0.00345},
            r"pixel_pitch_mm must be two numbers, across and down\. Got 0\.00345",
        ),
        ({"resolution": "24"}, r"resolution must be two numbers, across and down\. Got '24'"),
        ({"resolution": (2448, 2048.5)}, r"resolution must be whole pixels\. Got 2048\.5"),
        ({"name": ["n"] * 100}, r"name must be text\. Got \['n', .*\.\.\.\.$"),
        ({"principal_point_px": (None, 3.0)}, r"principal_point_px must be finite\. Got None"),
        ({"principal_point_px": (True, 3.0)}, r"principal_point_px must be finite\. Got True"),
        (
            {"principal_point_px": (-0.5, 3.0)},
            r"principal_point_px must be on the sensor\. Got \(-0\.5, 3\.0\)",
        ),
    ],
)
def test_what_no_camera_has(changes, message):
    with pytest.raises(CameraError, match=message) as caught:
        Camera(**{**GOOD, **changes})
    assert len(str(caught.value)) < 180


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("focal_length_mm = " + "[" * 100_000, "must not nest arrays or tables so deep"),
        ("focal_length_mm = " + "1" * 10_000, "must hold numbers of a sensible length"),
        ("focal_length_mm = 25.0\n[camera", r"camera\.toml:2: camera file must be TOML"),
    ],
)
def test_files_that_are_odd(tmp_path, text, message):
    path = tmp_path / "camera.toml"
    path.write_text(text)
    with pytest.raises(CameraError, match=message) as caught:
        Camera.from_toml(path)
    assert len(str(caught.value)) < len(str(path)) + 180


def test_odd_uncertainties():
    good = PoseUncertainty.isotropic(translation_mm=0.1, rotation_rad=0.01)
    still = {
        f"{one}_{what}": 0.0
        for one in ("robot", "hand_eye")
        for what in ("translation_mm", "rotation_rad")
    }
    with pytest.raises(
        UncertaintyError, match=r"cam2flange must have the shape \(4, 4\)\. Got \(3, 3\)"
    ):
        PoseUncertainty.robot_hand_eye(**still, cam2flange=np.eye(3))
    with pytest.raises(UncertaintyError, match=r"covariance must be given\. Got covariances"):
        PoseUncertainty.from_dict({"covariances": 1})
    with pytest.raises(UncertaintyError, match=r"Got nothing"):
        PoseUncertainty.from_dict({})
    assert good != "an uncertainty"
    assert good == PoseUncertainty.from_dict(good.to_dict())
