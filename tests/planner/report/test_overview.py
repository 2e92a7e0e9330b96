"""The list of targets beside the 3-D view: one entry per setting and target, its lines, and what it says."""

import re
from dataclasses import replace

import numpy as np
import pytest
from grid_box import EDGES, BoxSpace
from plan_examples import plan, planned_dimension, setting, witness

from errors.measurands import Line
from planner.camera.camera import Camera
from planner.report.figure import color_of
from planner.report.page import (
    NOT_INSPECTED,
    _target,
    choose_views,
    overview,
    target_colors,
    target_picker,
)
from planner.report.predicted_image import PictureMaker

ENDS = np.array([[0.0, 0.0, 0.0], [30.0, 0.0, 0.0]])


def rail(y, names):
    """A distance of 20 mm between two parallel lines."""
    pair = (
        Line(ENDS[0] + [0, y, 0], ENDS[1] + [0, y, 0]),
        Line(ENDS[0] + [0, y + 20, 0], ENDS[1] + [0, y + 20, 0]),
    )
    return witness("distance", names, pair)


def picked():
    ways = rail(0.0, ("e1", "e2")), rail(50.0, ("e3[0:1/4]", "e4[3/4:1]"))
    width = planned_dimension(
        "distance",
        ways[0].entities,
        ways[0].geometry,
        0.1,
    )
    width = replace(width, witnesses=ways)
    settings = (
        setting((0.0, 0.0, 500.0), ["width"]),
        replace(
            setting((0.0, 50.0, 500.0), ["width", "edge"]),
            witness={"width": 1},
            passed_over={"width": {"e1, e2": "hidden"}},
        ),
    )
    made = plan(
        entities={"width": ENDS, "edge": ENDS, "a<b>": ENDS},
        settings=settings,
        dimensions={"width": width},
        uninspectable={"a<b>": "unobservable: </script> & gone"},
    )
    return target_picker(made)


def test_each_setting_lists_its_targets_and_the_rest_comes_last():
    groups = picked().groups
    assert list(groups) == ["Setting 1", "Setting 2", "Not inspected"]
    assert [list(names.values()) for names in groups.values()] == [
        ["width"],
        ["width", "edge"],
        ["a<b>"],
    ]


@pytest.mark.parametrize(
    ("value", "y", "other"), [("1:0", 0.0, 50.0), ("2:0", 50.0, 0.0)], ids=["first", "second"]
)
def test_the_witness_that_is_used_is_apart_from_the_others(value, y, other):
    one = picked().data[value]
    assert [line[0][1] for line in one["lines"]] == [y, y + 20.0]
    assert [line[0][1] for line in one["others"]] == [other, other + 20.0]
    assert [line[1][0] - line[0][0] for line in one["lines"]] == [30.0, 30.0]


def test_it_says_by_what_a_setting_measures_and_why_not_by_the_others():
    data = picked().data
    assert data["1:0"]["text"] == (
        "Setting 1 measures width by e1 and e2, one of 2 ways. Measured in setting 2, too."
    )
    assert data["2:0"]["text"] == (
        "Setting 2 measures width by e3 from 0 to 25 % and e4 from 75 to 100 %, one of 2 ways. "
        "Not used: e1, e2: hidden. Measured in setting 1, too."
    )
    assert data["2:1"]["text"] == "Setting 2 measures edge."
    assert data["2:1"]["others"] == []
    assert data["none:0"]["setting"] is None
    assert data["none:0"]["text"] == "a<b> is not inspected: unobservable: </script> & gone"


def test_a_plan_of_nothing_has_no_list():
    empty = plan(entities={}, settings=(), uninspectable={})
    assert target_picker(empty) == ({}, {})


# The part with all targets called out: each once, in its setting's colour, where it is visible.


SPACE = BoxSpace((80.0, 50.0, 60.0), [[-900.0] * 3, [900.0] * 3], EDGES)
NAMES = tuple(SPACE.entities)


def box_plan(names):
    first, second, *rest = names
    return plan(
        entities={name: SPACE.entities[name].endpoints for name in names},
        settings=(
            setting((40.0, -180.0, 620.0), [first, second], probability=0.95),
            setting((250.0, 40.0, 600.0), [second], probability=0.99),
        ),
        uninspectable=dict.fromkeys(rest, "no view"),
    )


def test_a_target_has_the_colour_of_the_setting_that_measures_it_best():
    colors = target_colors(box_plan(NAMES[:3]))
    assert list(colors.values()) == [color_of(0), color_of(1), NOT_INSPECTED]


def test_every_target_is_drawn_and_named_once_for_a_desktop_and_once_for_a_phone():
    page = overview(box_plan(NAMES), SPACE.solid)
    for kind in ("wide", "narrow"):
        pictures = re.findall(rf'<svg class="shot overview {kind}".*?</svg>', page)
        assert len(pictures) == 2
        assert sorted(re.findall(r">([^<]*)</text>", "".join(pictures))) == sorted(NAMES)
    assert page.count('class="entity"') == len(NAMES) == 12
    # a phone shows the drawing of the desktop
    assert page.count("<use ") == 2
    assert "Red targets are not inspected." in page
    assert (
        overview(plan(entities={}, settings=(), uninspectable={}, lower_bound=0), SPACE.solid) == ""
    )


def test_names_that_are_too_small_for_a_phone_are_printed(monkeypatch):
    """Paper shows the picture of a phone, which has no names then."""
    named = overview(box_plan(NAMES), SPACE.solid)
    assert 'class="unnamed"' not in named
    assert "A wider window" not in named
    monkeypatch.setattr("planner.report.page._LEAST_FONT_PT", 100.0)
    unnamed = overview(box_plan(NAMES), SPACE.solid)
    assert 'class="unnamed"' in unnamed
    assert '<span class="narrow">A wider window shows their names.</span>' in unnamed


def test_two_views_from_opposite_corners_show_all_edges_of_a_box():
    """From a corner a box shows nine edges, and from the opposite one the other three."""
    camera = Camera(10.0, (0.002, 0.002), (2400, 2400), 8.0, 500.0)
    maker = PictureMaker(SPACE.solid, camera)
    share = np.linspace(0.1, 0.9, 9)[:, None]
    samples = {
        name: (1 - share) * one.endpoints[0] + share * one.endpoints[1]
        for name, one in SPACE.entities.items()
    }
    views = choose_views(maker, samples)
    assert [len(view.names) for view in views] == [9, 3]
    assert set(views[0].names) | set(views[1].names) == set(NAMES)
    # z points up in both, and the pose is one
    for view in views:
        turn = view.cam2world[:3, :3]
        assert turn @ turn.T == pytest.approx(np.eye(3))
        assert np.linalg.det(turn) == pytest.approx(1)
        assert turn[2, 1] < 0
        assert turn[2, 0] == pytest.approx(0)


def test_a_line_joins_the_middles_of_both_entities_of_a_dimension():
    above = np.array([[0.0, 0.0, 10.0], [20.0, 0.0, 10.0]])
    below = above - (0.0, 0.0, 10.0)
    assert _target([above, below]).span == pytest.approx(np.array([[10, 0, 10], [10, 0, 0]]))
    assert _target([above]).span is None


def test_names_cannot_smuggle_markup():
    ends = SPACE.entities[NAMES[0]].endpoints
    made = plan(entities={"<b>": ends}, settings=(), uninspectable={"<b>": "so"}, lower_bound=0)
    assert "&lt;b&gt;" in overview(made, SPACE.solid)
    assert "<b>" not in overview(made, SPACE.solid)
