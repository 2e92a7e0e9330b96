"""Rooms and shares, by hand."""

import numpy as np
import pytest

from planner import Camera
from planner.request.camera_limits import probability_share, rooms, shares

CAMERA = Camera(8.0, (0.00345, 0.00345), (2448, 2048), 8.0, 300.0)
WORKSPACE = np.array([[0.0, 0.0, 0.0], [500.0, 400.0, 900.0]])
NEEDS = {
    "field_margin_px": 20.0,
    "surround_px": 4.0,
    "min_length_px": 20.0,
    "stand_off_mm": 80.0,
    "separation_px": 5.0,
    "focus_margin_mm": 0.5,
}


def test_rooms_are_what_a_practitioner_calls_full():
    near, far = CAMERA.depth_of_field_mm
    found = rooms(CAMERA, WORKSPACE, NEEDS, 2.0)
    assert found["focus_mm"] == pytest.approx((far - near) / 2 - 2.0)
    assert rooms(CAMERA, WORKSPACE, NEEDS)["focus_mm"] == pytest.approx((far - near) / 2 - 0.5)
    assert found["field_of_view_px"] == 1024.0 - 24.0
    assert found["resolution_mm"] == pytest.approx(20.0 * 0.00345)
    assert found["clearance_mm"] == 80.0
    assert found["workspace_mm"] == 40.0
    assert found["separation_px"] == 5.0
    # nothing is asked of corners
    assert "corner_deg" not in found


def test_a_share_is_a_slack_over_its_room_and_one_at_most():
    room = {"focus_mm": 4.0, "clearance_mm": 80.0}
    found = shares({"focus_mm": [1.0, 8.0], "clearance_mm": 20.0, "visibility": 1.0}, room)
    assert found["focus_mm"].tolist() == [0.25, 1.0]
    assert found["clearance_mm"] == 0.25
    assert set(found) == {"focus_mm", "clearance_mm"}
    assert probability_share(0.95, 0.9) == pytest.approx(0.5)
