"""Limits of a request: the reserve of focus, and that the plan's file tells all of them."""

from __future__ import annotations

import json

import numpy as np
import pytest
from plan_examples import CAMERA, UNCERTAINTY, plan

from planner import PoseUncertainty
from planner.exceptions import PlanFileError, RequestError
from planner.options import InspectionOptions
from planner.plan import InspectionPlan
from planner.report.wording import requirement_rows
from planner.request.constraints import Requirements
from planner.request.image_constraints import FOCUS, Lens, image_slacks

LIMITS = Requirements(20.0, 27.0, stand_off_mm=50.0, visibility_radius_mm=0.6, focus_margin_mm=0.8)


def test_a_focus_margin_narrows_the_depth_of_field_at_both_ends():
    near, far = CAMERA.depth_of_field_mm
    depths = near + 0.5, far - 0.25
    ends = np.array([[[[0.0, 0.0, depths[0]], [0.0, 0.0, depths[1]]]]])
    slacks = image_slacks(Lens.of(CAMERA, focus_margin_mm=2.0), ends)[0, 0, FOCUS]
    # by definition: depth - (near + 2) of both ends, then (far - 2) - depth of both
    expected = [0.5 - 2.0, far - near - 0.25 - 2.0, far - near - 0.5 - 2.0, 0.25 - 2.0]
    np.testing.assert_allclose(slacks, expected, atol=1e-9)


def test_a_focus_margin_must_leave_a_depth_of_field():
    near, far = CAMERA.depth_of_field_mm
    just_less = InspectionOptions(focus_margin_mm=0.49 * (far - near)).requirements(
        CAMERA, UNCERTAINTY
    )
    assert just_less.focus_margin_mm == 0.49 * (far - near)
    for value, rule in (
        (0.51 * (far - near), "less than half the depth of field"),
        (-1.0, "not negative"),
    ):
        with pytest.raises(RequestError, match=f"focus_margin_mm must be .*{rule}"):
            InspectionOptions(focus_margin_mm=value).requirements(CAMERA, UNCERTAINTY)


def test_the_file_keeps_the_limits(tmp_path):
    found = plan(requirements=LIMITS)
    data = json.loads(json.dumps(found.to_dict()))
    stored = data["request"]["requirements"]
    assert {name: stored[name] for name in found.requirements} == found.requirements
    assert found.requirements == {
        "min_length_px": 20.0,
        "field_margin_px": 27.0,
        "focus_margin_mm": 0.8,
        "stand_off_mm": 50.0,
        "visibility_radius_mm": 0.6,
    }
    assert InspectionPlan.from_dict(data) == found
    stored["stand_off_mm"] = -1
    with pytest.raises(
        PlanFileError, match=r"requirements\.stand_off_mm must not be negative\. Got -1"
    ):
        InspectionPlan.from_dict(data)


def test_the_report_tells_the_limits():
    rows = requirement_rows(plan(requirements=LIMITS))
    assert rows["Stand-off"] == "at least 50 mm from the part"
    assert rows["Margin of the field of view"].startswith("no target within 27 px ")
    assert rows["Margin of focus"].startswith("0.8 mm ")
    # the camera's place has a standard deviation of 0.05 mm along every axis
    assert rows["Margin of focus"].endswith(
        " (16 standard deviations of the camera along its axis)"
    )
    assert rows["Margin of visibility"].endswith(" (12 standard deviations of its position)")


def test_the_report_tells_the_field_of_views_usual_reserve_in_standard_deviations():
    usual = InspectionOptions().requirements(CAMERA, UNCERTAINTY)
    told = requirement_rows(plan(requirements=usual))["Margin of the field of view"]
    assert told.endswith(" (4 standard deviations of an image point in the corners)")
    exact = PoseUncertainty(np.zeros((6, 6)))
    assert "deviation" not in " ".join(
        requirement_rows(plan(requirements=usual, pose_uncertainty=exact)).values()
    )
