"""Cells of the table of dimensions and what options say of localisation: words and numbers known in advance."""

from types import SimpleNamespace

import pytest
from plan_examples import planned_dimension

from errors.measurands import Circle, Line, Localisation
from planner import RequestError
from planner.app.job import read_localisation
from planner.exceptions import PlanFileError
from planner.report.setting_report import (
    _accepted,
    _budget,
    _images_text,
    _nominal,
    _what,
    budget_percents,
    localisation_text,
)
from planner.verify.setting_record import _check_same


def dimension(**fields):
    return SimpleNamespace(
        **{
            "kind": "length",
            "nominal": 20.0,
            "tolerance": (-0.1, 0.3),
            "unit": "mm",
            "geometry": (),
            **fields,
        }
    )


def texts(lines):
    return [line.text for line in lines]


def accepted(u, **fields):
    (line,) = _accepted(dimension(**fields), u)
    return line.text


def test_tolerances_are_told_with_their_signs():
    assert texts(_nominal(dimension())) == ["20 mm", "+0.3", "-0.1"]
    assert texts(_nominal(dimension(tolerance=(-0.1, 0.0)))) == ["20 mm", "0", "-0.1"]
    assert texts(_nominal(dimension(tolerance=None))) == ["20 mm"]


def test_a_stretch_of_an_edge_is_named_by_percentages():
    lines = [Line([0, y, 0], [10, y, 0]) for y in (0, 5)]
    width = planned_dimension("distance", ("e5[0:1/2]", "e3"), lines, 0.1)
    assert _what(width) == "distance of e5 from 0 to 50 %, e3"


def test_a_position_has_a_zone_and_no_limits():
    """Limits of the length of a deviation would refuse a hole at its true position."""
    zone = {"kind": "position", "nominal": 0.0, "tolerance": (0.0, 0.2), "material": None}
    given = dimension(**zone, datum_names=("A", "B"))
    assert texts(_nominal(given)) == ["⌀0.2 | A | B"]
    assert texts(_accepted(given, 0.01)) == ["decided in a disc"]


def test_the_permitted_error_is_a_share_of_the_tolerance():
    circle = Circle((0, 0, 0), (0, 0, 1), 10.0, (1, 0, 0))
    given = ("diameter", ("r1",), (circle,), 0.0125, Localisation.gaussian())
    assert planned_dimension(*given, (-0.05, 0.05)).share_text == "25 % of ±0.05"
    # half the width of -0.1 to +0.0 is 0.05
    uneven = planned_dimension(*given, (-0.1, 0.0))
    assert uneven.share_text == "25 % of T/2"
    assert uneven.requirement_texts[0].endswith(" 0/-0.1")
    assert planned_dimension(*given).share_text == ""


def test_what_is_accepted_is_the_tolerance_less_guard_bands_on_both_sides():
    # 1.644854 u inside the limits 19.9 and 20.3: 19.9411 and 20.2589, inwards in the digits of U = 0.050
    assert accepted(0.025) == "19.942\u00a0mm to 20.258\u00a0mm"
    assert "nothing" in accepted(0.25)
    assert accepted(0.05, tolerance=None) == "no tolerance stated"


def test_shares_sum_to_a_hundred_percent_or_are_none():
    """Thirds: 33.3 % each, and the tenth that is left goes to the first."""
    assert budget_percents({"a": 1.0, "b": 1.0, "c": 1.0}) == {"a": 33.4, "b": 33.3, "c": 33.3}
    assert budget_percents({"a": 0.0, "b": 0.0}) == {"a": 0.0, "b": 0.0}
    assert budget_percents({"a": float("inf"), "b": 1.0}) == {"a": 0.0, "b": 0.0}


def test_a_report_says_what_does_not_average_out_and_where_that_comes_from():
    how = Localisation.gaussian(0.1, floor_px=0.08)
    with_both = SimpleNamespace(localisation=how, surfaces_mm=0.02, surfaces_from="")
    (text,) = _images_text(SimpleNamespace(dimensions={"bore": with_both}))
    assert "an error of 0.08 px across it" in text
    assert "30 path-traced images" in text
    assert "off their position by 0.02 mm (default)" in text
    of_model = SimpleNamespace(localisation=how, surfaces_mm=0.0289, surfaces_from="profile 0.1 mm")
    given = SimpleNamespace(localisation=how, surfaces_mm=0.05, surfaces_from="")
    (text,) = _images_text(SimpleNamespace(dimensions={"a": of_model, "b": given}))
    assert "0.0289 mm (profile 0.1 mm in the model) or 0.05 mm (as given)" in text
    without = SimpleNamespace(localisation=Localisation.rounding(), surfaces_mm=0.0)
    assert _images_text(SimpleNamespace(dimensions={"bore": without})) == []


def test_a_short_arc_has_no_budget():
    arc = Circle((0, 0, 0), (0, 0, 1), 5.0, (1, 0, 0), 0.3)
    assert _budget(dimension(geometry=(arc,)), SimpleNamespace(budget={"rotation": 1.0})) == []


def test_a_source_that_does_not_count_has_no_share():
    budget = {"rotation": 1.0, "edge_state": 0.0}
    shares = _budget(dimension(geometry=()), SimpleNamespace(budget=budget))
    assert [(share.source, share.percent) for share in shares] == [("rotation", 100.0)]


@pytest.mark.parametrize(
    ("text", "model", "words"),
    [
        ("rounding", Localisation.rounding(), "rounding (every point on a whole pixel, 20 points per line or circle)"),
        ("gaussian:0.04", Localisation.gaussian(0.04, floor_px=0.05),
         "gaussian (standard deviation 0.04 px, 20 points per line or circle; 0.05 px common to all of them)"),
        ("gaussian:0.04:0", Localisation.gaussian(0.04, floor_px=0.0),
         "gaussian (standard deviation 0.04 px, 20 points per line or circle)"),
        (" fit:0.5:4:0.02", Localisation("fit", 0.5, correlation_px=4.0, floor_px=0.02),
         "fit (standard deviation 0.5 px, one independent point per 4 px of the image, no better than 0.02 px)"),
    ],
)  # fmt: skip
def test_options_and_reports_speak_of_the_same_model(text, model, words):
    assert read_localisation(text) == model
    assert localisation_text(model).replace(f"{model.points} points", "20 points").startswith(words)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("guess", r"must be rounding, gaussian\[:SIGMA\[:FLOOR\]\] or fit.* Got 'guess'"),
        ("rounding:1", r"Got 'rounding:1'"),
        ("gaussian:wide", r"must hold numbers of px after the model\. Got 'gaussian:wide'"),
        (
            "gaussian:0.1:-1",
            r"--localisation: floor_px must be finite and not negative\. Got -1\.0",
        ),
        ("gaussian:0.1:0.05:1", r"Got 'gaussian:0.1:0.05:1'"),
        ("gaussian:-1", r"--localisation: sigma_px must be finite and not negative\. Got -1\.0"),
        ("fit:1:0", r"--localisation: correlation_px must be positive\. Got 0"),
    ],
)
def test_words_for_no_model_are_refused(text, message):
    with pytest.raises(RequestError, match=message):
        read_localisation(text)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"a": 1.0}, r"^here\.b must be given\. Got none"),
        ({"a": 1.0, "b": "x", "c": 3}, r"^here\.c must be of an item of the setting"),
        ({"a": 1.001, "b": "x"}, r"^here\.a must be that of the pose, 1\.0\. Got 1\.001"),
        ({"a": 1.0, "b": "y"}, r'^here\.b must be that of the pose, "x"\. Got "y"'),
        ([1.0, "x"], r"^here must be that of the pose"),
    ],
)
def test_what_follows_from_a_pose_must_be_stated_as_it_is(given, message):
    _check_same("here", {"a": 1.0 + 1e-12, "b": "x"}, {"a": 1.0, "b": "x"})
    with pytest.raises(PlanFileError, match=message):
        _check_same("here", given, {"a": 1.0, "b": "x"})
