"""One feature of each pattern is planned, if asked so: every output counts the others as not planned."""

from __future__ import annotations

import csv
import io
import json

import numpy as np
import pytest
from plan_examples import plan, planned_dimension

from errors.measurands import Line, Localisation
from planner import Dimension, RequestError, read_plan
from planner.report import terminal_tables
from planner.report.page import _figures, _lead
from planner.report.wording import features_cell, verdict
from planner.request.words import features_text, n_not_planned

TEXT = "3 dimensions, 32 characteristics: 29 not planned"


def dimension(name, n_features):
    line = Line(*np.array(plan().entities[name]))
    return planned_dimension(
        "length", (name,), (line,), 1.0, Localisation.gaussian(0.1), n_features=n_features
    )


@pytest.fixture(scope="module")
def patterns():
    """Dimensions on 30, 1 and 1 features: 3 of 32 could be planned, 2 are, as one is not inspectable."""
    counts = {"top front": 30, "top right": 1, "bottom": 1}
    return plan(dimensions={name: dimension(name, n) for name, n in counts.items()})


def test_ctc_04_in_words():
    """Its drawing: diameters on 6, 30, 4, 30 and 1 features, and one distance."""
    assert features_text([1, 6, 30, 4, 30, 1]) == "6 dimensions, 72 characteristics: 66 not planned"
    assert features_text([4]) == "1 dimension, 4 characteristics: 3 not planned"
    assert (features_text([1, 1]), features_text([]), n_not_planned([])) == ("", "", 0)


@pytest.mark.parametrize("value", [0, -1, 1.0, True, "30"])
def test_a_number_of_features_is_whole_and_positive(value):
    with pytest.raises(RequestError, match=r"n_features must be a whole number, 1 or more\. Got"):
        Dimension("diameter", ("r0",), max_error=0.1, n_features=value)


def test_a_plan_counts_them(patterns):
    assert (patterns.n_features, patterns.n_features_not_planned) == (32, 29)
    assert TEXT in repr(patterns)
    assert TEXT in patterns._repr_html_()
    assert TEXT in verdict(patterns)


def test_a_plan_of_single_features_says_nothing_of_them():
    found = plan(dimensions={name: dimension(name, 1) for name in plan().entities})
    assert (found.n_features, found.n_features_not_planned) == (3, 0)
    for text in (
        repr(found),
        found._repr_html_(),
        verdict(found),
        _lead(found),
        str(_figures(found)),
    ):
        assert "feature" not in text
        assert "characteristic" not in text


def test_tables_and_report_name_the_pattern(patterns, capsys):
    terminal_tables.print_plan(patterns)
    printed = capsys.readouterr().out
    assert TEXT in printed
    assert "1 of 30 features" in " ".join(printed.split())
    terminal_tables.print_simulation(patterns, patterns.simulate(20))
    assert TEXT in capsys.readouterr().out
    assert TEXT in _lead(patterns)
    assert ("2 / 32", "characteristics inspected") in _figures(patterns)
    assert features_cell(patterns.dimensions["top front"]) == "1 of 30 features"
    assert features_cell(patterns.dimensions["bottom"]) == ""


def test_rows_and_csv_hold_the_number(patterns):
    rows = list(csv.DictReader(io.StringIO(patterns.to_csv())))
    counts = {(row["name"], row["n_features"]) for row in rows}
    assert counts == {("top front", "30"), ("top right", "1"), ("bottom", "1")}
    assert {row["n_features"] for row in plan().rows()} == {1}


def test_the_file_holds_them(patterns, tmp_path):
    path = tmp_path / "plan.json"
    patterns.write(path)
    stored = json.loads(path.read_text())
    assert stored["targets"]["top front"]["n_features"] == 30
    assert read_plan(path) == patterns
