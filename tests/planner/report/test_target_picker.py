"""The list of targets beside the 3-D view: one entry per setting and target, its lines, and what it says."""

from dataclasses import replace

import numpy as np
import pytest
from plan_examples import plan, planned_dimension, setting, witness

from errors.measurands import Line
from planner.report.overview import target_picker

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
        "Setting 2 measures width by e3[0:1/4] and e4[3/4:1], one of 2 ways. Not used: e1, e2: hidden. "
        "Measured in setting 1, too."
    )
    assert data["2:1"]["text"] == "Setting 2 measures edge."
    assert data["2:1"]["others"] == []
    assert data["none:0"]["setting"] is None
    assert data["none:0"]["text"] == "a<b> is not inspected: unobservable: </script> & gone"


def test_a_plan_of_nothing_has_no_list():
    empty = plan(entities={}, settings=(), uninspectable={})
    assert target_picker(empty) == ({}, {})
