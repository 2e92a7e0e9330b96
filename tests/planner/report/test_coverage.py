"""What of a drawing a plan covers, by a plan made by hand: every requirement once, with a mark and the reason."""

from __future__ import annotations

from dataclasses import replace

import measured_plate as plate
import pytest
from plan_examples import changed

from aspectgraph import ModelDimension
from aspectgraph.dimensions.geometric import GeometricTolerance
from errors.measurands import Circle, Line
from planner import dimensions_to_plan, read_plan
from planner.report.coverage import (
    ALL,
    NONE,
    SOME,
    boxes_of,
    coverage,
    coverage_html,
    joined_settings,
    requirement_name,
    verdict_text,
)
from planner.request.dimension import MaterialCondition
from planner.sensor_setting import SplitValue

TOP = plate.TOP
RIM = Circle([20.0, 25.0, TOP], plate.UP, 8.0)
OTHER = Circle([60.0, 25.0, TOP], plate.UP, 6.0)
FRONT = Line([0.0, 0.0, TOP], [80.0, 0.0, TOP])
BACK = Line([0.0, 50.0, TOP], [80.0, 50.0, TOP])


@pytest.fixture(scope="module")
def plan():
    made = plate.measured_plan(plate.thick_plate(), ("left", "right", "width"), 1)
    targets = (
        *(replace(made.targets[name], name=name) for name in ("width",)),
        replace(made.targets["left"], name="bore [1 of 2]"),
        replace(made.targets["right"], name="bore [2 of 2]"),
    )
    setting = replace(
        made.settings[0],
        entities=("width", "bore [1 of 2]"),
        probability=dict.fromkeys(("width", "bore [1 of 2]"), 0.95),
    )
    return changed(
        made,
        targets=targets,
        settings=(setting,),
        uninspectable={"bore [2 of 2]": "outside the field of view"},
        not_planned={"Flatness.1": "flatness of a face: edges do not show it"},
    )


def test_each_requirement_is_marked_once_with_settings_or_the_reason(plan):
    rows = coverage(plan)
    assert [(row.name, row.mark) for row in rows] == [
        ("width", ALL),
        ("bore", SOME),
        ("Flatness.1", NONE),
    ]
    assert rows[0].text == "setting 1"
    assert rows[1].text == "1 of 2; setting 1; outside the field of view"
    assert rows[1].boxes == ["2× ⌀", "16 ±0.1"]
    assert verdict_text(rows) == "1 of 3 requirements covered. 1 requirement in part."


def test_what_is_not_planned_stands_in_its_frame_after_reading_too(plan, tmp_path):
    """As ISO 1101 writes it: symbol, zone, datums."""
    face = GeometricTolerance(
        "Perp.1", "perpendicularity", 1.5, False, "", ("A",), None, (), 1, "no edge"
    )
    profile = GeometricTolerance(
        "Prof.1", "surface profile", 1.25, False, "M", ("A", "B(M)", "C"), None, (), 1, "no edge"
    )
    size = ModelDimension(
        "Size.1", "diameter", 20.0, (-0.1, 0.05), None, "no rim", geometry=20.0, role="reference"
    )
    _, left_out = dimensions_to_plan([face, profile, size])
    written = replace(plan, not_planned=left_out).write(tmp_path / "plan.json")
    for read in (replace(plan, not_planned=left_out), read_plan(written)):
        rows = coverage(read)[-3:]
        assert [row.boxes for row in rows] == [
            ["⊥", "1.5", "A"],
            ["surface profile", "1.25 (M)", "A", "B(M)", "C"],
            ["⌀", "(20 +0.05/-0.1)"],
        ]
        assert rows[0].text == "no edge"
    page = str(coverage_html(read_plan(written)))
    assert "<span>⊥</span><span>1.5</span><span>A</span>" in page


def test_a_long_reason_stands_once(plan):
    """Two flatness tolerances without an edge: the second refers to the first, a short reason does not."""
    long = "needs the surface, not its edges, as the form of a face is nothing that an edge shows"
    reasons = {"A": long, "B": "no edge", "C": long, "D": "no edge"}
    rows = coverage(replace(plan, not_planned=reasons))[-4:]
    assert [row.text for row in rows] == [long, "no edge", "the same as of A", "no edge"]


def test_settings_that_show_a_position_together_are_named():
    made = plate.measured_plan(plate.thick_plate(), ("left", "right", "width"), 2)
    left, right = (made.targets[name].entities[0] for name in ("left", "right"))
    bolt = plate.dimension("position", (left, "front", right), (RIM, FRONT, OTHER), (0.0, 0.25))
    # tables show the zone, and not the nominal deviation, which is always 0
    assert bolt.nominal_text == f"⌀0.25 mm | front | {right}"
    assert made.targets["width"].nominal_text == "50 mm"
    shown = (("left",), ("right", "width"))
    plan = changed(
        made,
        targets=(*made.targets.values(), replace(bolt, name="bolt")),
        settings=tuple(
            replace(setting, entities=names, probability=dict.fromkeys(names, 0.95))
            for setting, names in zip(made.settings, shown, strict=True)
        ),
        uninspectable={"bolt": "outside the field of view"},
    )
    assert joined_settings(plan, "bolt") == [1, 2]
    assert joined_settings(plan, "left") == []
    text = "outside the field of view; settings 1, 2 show its rim and datums apart, so measure may read it"
    assert coverage(plan)[-1].text == text
    # the datum edge is in no setting
    fewer = replace(plan.settings[1], entities=("right",), probability={"right": 0.95})
    missing = {"bolt": "outside the field of view", "width": "too large"}
    plan = changed(plan, settings=(plan.settings[0], fewer), uninspectable=missing)
    assert joined_settings(plan, "bolt") == []


def test_the_page_escapes_names_and_has_a_frame_for_each_value(plan):
    odd = changed(plan, not_planned={"<b>": "needs the surface"})
    page = str(coverage_html(odd))
    assert "&lt;b&gt;" in page
    assert page.count('class="frame"') == 2
    assert page.count("<li") == 3


def test_a_position_has_its_zone_condition_and_datums_in_boxes():
    bolt = plate.dimension("position", ("r0", "e17", "r 4"), (RIM, FRONT, OTHER), (0.0, 0.25))
    bolt = replace(bolt, material=MaterialCondition("M", 15.9, True))
    assert boxes_of(bolt) == ["⊕", "⌀0.25 (M)", "e17", "r 4"]
    slot = plate.dimension("symmetry", ("e1", "e2", "e3", "e4"), (FRONT, BACK) * 2, (0.0, 0.1))
    assert boxes_of(slot) == ["≡", "0.1", "e3-e4"]


@pytest.mark.parametrize(
    ("name", "requirement"),
    [("bolts [2 of 6]", "bolts"), ("size [H7]", "size [H7]"), ("w [2 of 3 places]", "w")],
)
def test_features_and_positions_of_one_requirement_share_its_name(name, requirement):
    assert requirement_name(name) == requirement


def test_a_dimension_of_two_settings_names_both(plan):
    both = ("width", "bore [1 of 2]")
    first = replace(plan.settings[0], ends={"width": 0})
    second = replace(
        plan.settings[0], entities=("width",), probability={"width": 0.95}, ends={"width": 1}
    )
    split = changed(
        plan, settings=(first, second), split={"width": SplitValue(0.95, 0.94, 20_000, 0.01)}
    )
    assert set(both) <= set(split.inspected)
    assert next(row.text for row in coverage(split)) == "settings 1, 2"


def test_what_no_lamp_shows_is_not_covered(plan, monkeypatch):
    monkeypatch.setattr(type(plan), "unlit", ("width",))
    width, bore, _ = coverage(plan)
    assert (width.mark, width.text) == (NONE, "no lamp shows it")
    assert bore.mark == SOME
