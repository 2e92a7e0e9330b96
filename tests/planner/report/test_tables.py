"""The head of a report: few warnings are told one by one, many by kind; nothing is lost either way."""

import re
from dataclasses import replace

import numpy as np
import pytest
from plan_examples import CAMERA, plan, setting

from ground.templates import render
from planner.report import tables
from planner.report.tables import FEW, binding_sentence, focus_note, nearest_limits
from planner.request.words import amount_text
from planner.rows import Row, Warned, WarningKind
from planner.sensor_setting import Reason, ReasonKind


def row(number, name, *warnings):
    return Row(number, name, "length", 80.0, "mm", 1.6, 1.0, 0.95, None, 0.1, 12.0, {}, warnings)


def part(**values):
    values = {"notices": [], "not_inspected": None, **values}
    return render("planner", "report/templates/attention.html", **values).strip()


def attention(rows, unsharp=()):
    return part(notices=tables.attention(rows, unsharp))


def not_inspected(reasons):
    return part(not_inspected=tables.not_inspected(reasons, "edge"))


def text(html):
    return re.sub(r"<[^>]*>", "", html)


def test_nothing_to_look_at_takes_no_room():
    assert attention([[row(1, "a")], []]) == ""
    assert not_inspected({}) == ""


def test_few_warnings_are_told_one_by_one():
    html = attention(
        [
            [row(1, "a&b", Warned(WarningKind.FEW_PIXELS, "tolerance of 1.1 px"))],
            [row(2, "c", Warned(WarningKind.BETTER, "0.04 better"))],
        ]
    )
    assert html.count("<li>") == 2
    # those of one kind, too
    html_of_a_kind = attention(
        [
            [
                row(1, "a", Warned(WarningKind.FEW_PIXELS, "1.1 px")),
                row(1, "b", Warned(WarningKind.FEW_PIXELS, "1.2 px")),
            ]
        ]
    )
    assert re.findall("<li>(.*?)</li>", html_of_a_kind)[1].startswith("<b>b</b>")
    assert "a&amp;b (setting 1): tolerance of 1.1 px" in text(html)
    assert "c (setting 2): 0.04 better" in text(html)


def test_targets_with_one_warning_stand_together():
    dark = Warned(WarningKind.UNLIT, "no position found")
    html = attention([[row(1, "a", dark), row(1, "b", dark)], [row(2, "a", dark)]])
    assert html.count("<li>") == 2
    assert "a, b (setting 1): no position found" in text(html)
    assert "a (setting 2): no position found" in text(html)


def test_many_warnings_of_a_kind_are_one_line_with_every_name_once():
    fine = Warned(WarningKind.FEW_PIXELS, "tolerance of 1.1 px")
    names = [f"e{i}" for i in range(FEW)]
    html = attention([[row(1, name, fine) for name in names], [row(2, "e0", fine)]])
    assert html.count("<li>") == 1
    assert f"{WarningKind.FEW_PIXELS.value} in {FEW + 1} measurements: e0 (1, 2), e1 (1), " in text(
        html
    )
    assert 'href="#setting-2"' in html


def test_settings_with_little_room_in_focus_are_named():
    assert "Narrow margin of focus in setting 2: a point is less than" in text(
        attention([[row(1, "a")]], [2])
    )
    assert "Narrow margin of focus in settings 2, 3: a point is less than" in text(
        attention([], [2, 3])
    )


def test_few_reasons_stand_at_the_head():
    html = not_inspected({"a": "unobservable: <b>"})
    assert "unobservable: &lt;b&gt;" in html
    assert "#reasons" not in html


def test_many_reasons_are_counted_at_the_head_and_listed_below():
    low = ReasonKind.PROBABILITY_TOO_LOW
    reasons = {f"e{i}": Reason.of(low, f"P = 0.{i}") for i in range(FEW)}
    # the kind is no part of the text
    reasons["x"] = Reason("x: y", ReasonKind.UNOBSERVABLE)
    html = not_inspected(reasons)
    head = text(html)
    assert f"probability too low ({FEW}): e0, e1, " in head
    assert "unobservable (1): x" in head
    assert "P = 0.3" not in head
    assert 'href="#reasons"' in html
    assert tables.not_inspected(reasons, "edge").table.rows == list(reasons.items())


# Which constraint fixes a pose: shares computed by hand from margins written by hand.


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


# What is said below a setting's pictures: numbers of hand-made margins.


def with_margins(margins, requirements=None):
    one = setting((40.0, -180.0, 620.0), ["top front"])
    one = type(one)(**{**vars(one), "margins": margins})
    found = plan(
        settings=(one,),
        entities={"top front": [[0, 0, 60], [80, 0, 60]]},
        uninspectable={},
        requirements=requirements or {},
    )
    return found, one


def test_the_nearest_limit_comes_first():
    told = binding_sentence(*with_margins({"field_of_view_px": 10.24, "workspace_mm": 90.0}))
    # 10.24 px of half of 2048, 90 mm of a tenth of 1800
    assert told.startswith(
        "Tightest constraint: field of view, with 1 % of its margin left: a target is close to"
    )
    assert told.endswith("Next: probability 50 %, workspace 50 %.")
    told = binding_sentence(*with_margins({"field_of_view_px": 0.0003}))
    assert told.startswith(
        "Tightest constraint: field of view, with less than 0.01 % of its margin left:"
    )


@pytest.mark.parametrize(
    ("across_mm", "above_mm", "sigmas"),
    [
        # the camera's place has a standard deviation of 0.05 mm
        (0.0, 0.1, "2"),
        (0.0, 0.16, None),
        # 40 mm off the axis a turn of 1 mrad moves the edge by 0.04 mm, as well: hypot(0.05, 0.04) = 0.064 mm
        (40.0, 0.16, "2.5"),
        (40.0, 0.2, None),
    ],
)
def test_a_point_that_displaced_poses_may_not_have_in_focus_is_told(across_mm, above_mm, sigmas):
    near = CAMERA.depth_of_field_mm[0]
    pose = np.eye(4)
    pose[:3, :3] = np.diag([1.0, -1.0, -1.0])
    pose[:3, 3] = [across_mm, 0.0, near + above_mm]
    one = replace(setting((0.0, 0.0, 600.0), ["short"]), cam2world=pose)
    ends = {"short": [[-0.01, 0.0, 0.0], [0.01, 0.0, 0.0]]}
    note = focus_note(plan(settings=(one,), entities=ends, uninspectable={}), one)
    if sigmas is None:
        assert note == ""
    else:
        assert f" only {sigmas} standard deviations of its depth from a limit" in note


def test_amounts_have_their_unit_as_people_write_it():
    assert amount_text("45", "deg") == "45°"
    assert amount_text("12", "mm") == "12 mm"
