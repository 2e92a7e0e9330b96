"""Which constraint fixes a pose: shares computed by hand from margins written by hand."""

import pytest
from plan_examples import CAMERA, plan, setting

from planner.report.tables import nearest_limits

NEED = {
    "min_length_px": 20.0,
    "field_margin_px": 27.0,
    "focus_margin_mm": 0.0,
    "stand_off_mm": 50.0,
    "visibility_radius_mm": 0.6,
}


def limits(margins, requirements=None):
    one = setting((40.0, -180.0, 620.0), ["top front"])
    one = type(one)(**{**vars(one), "margins": margins})
    found = plan(
        settings=(one,),
        entities={"top front": [[0, 0, 60], [80, 0, 60]]},
        uninspectable={},
        requirements=requirements or {},
    )
    return {near.name: near.share for near in nearest_limits(found, one)}


def test_each_share_is_of_the_room_its_constraint_has():
    near, far = CAMERA.depth_of_field_mm
    margins = {
        "resolution_mm": 0.2,
        "focus_mm": (far - near) / 8,
        "field_of_view_px": 102.4,
        "workspace_mm": 90.0,
        "clearance_mm": 150.0,
        "visibility": 1.0,
    }
    told = limits(margins, NEED)
    assert told == pytest.approx(
        {
            # 0.95 of a required 0.9: half of what is above it
            "probability": 0.5,
            "focus": 0.25,
            # of half of 2048 px, without 27 px of border
            "field of view": 102.4 / (1024 - 27),
            # of a tenth of 1800 mm
            "workspace": 0.5,
            # 50 mm are asked for, and three times as much is left
            "clearance": 1.0,
            # 0.2 mm longer than 20 px of 0.0035 mm
            "resolution": 1.0,
        }
    )
    assert next(iter(told)) == "field of view"
    assert set(list(told)[-2:]) == {"clearance", "resolution"}


def test_what_a_plan_does_not_know_is_left_out():
    assert set(limits({"resolution_mm": 0.2, "clearance_mm": 150.0, "focus_mm": float("inf")})) == {
        "probability"
    }
