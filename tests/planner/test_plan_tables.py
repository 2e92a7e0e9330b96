"""A plan as rows, as CSV and as a notebook's table. The numbers are those of the hand-made plan, seen another way."""

import csv
import io
import re

import numpy as np
import pytest
from plan_examples import plan, setting
from scipy.spatial.transform import Rotation

from planner.exceptions import OutputError


def test_a_row_per_setting_and_entity_then_what_is_not_inspected():
    rows = plan().rows()
    assert [(row["setting"], row["name"]) for row in rows] == [
        (1, "top front"),
        (1, "top right"),
        (2, "top right"),
        (None, "bottom"),
    ]
    assert [row["probability"] for row in rows] == [0.95, 0.94, 0.99, None]
    assert [row["nominal"] for row in rows] == [80.0, 50.0, 50.0, 80.0]
    # A = 0.98 permits two hundredths of the length
    assert [row["permitted_error"] for row in rows] == pytest.approx([1.6, 1.0, 1.0, 1.6])
    assert rows[3]["reason"].startswith("unobservable")
    assert {tuple(row) for row in rows} == {tuple(rows[0])}


def test_place_and_turn_give_the_pose_back():
    found = plan()
    for row in found.rows()[:3]:
        pose = found.settings[row["setting"] - 1].cam2world
        turn = Rotation.from_rotvec([row["rx"], row["ry"], row["rz"]], degrees=True)
        assert np.allclose(turn.as_matrix(), pose[:3, :3], atol=1e-12)
        assert [row["x"], row["y"], row["z"]] == pose[:3, 3].tolist()
        assert row["margin_focus_mm"] == 12.5


def test_simulated_frequencies_stand_beside_what_is_stated():
    found = plan().simulated(200, rng=1)
    for row in found.rows()[:3]:
        rate = found.simulation.rates[row["setting"] - 1][row["name"]]
        assert row["simulated"] == rate.successes / 200
        assert row["verdict"] == rate.verdict
    assert [row["simulated"] for row in plan().rows()] == [None] * 4


def test_csv_has_units_and_the_digits_that_are_known(tmp_path):
    name = 'a "quoted", name'
    found = plan(
        settings=[setting((40.0, -180.0, 620.0), [name])],
        entities={name: [[0, 0, 0], [1 / 3, 0, 0]]},
        uninspectable={},
    )
    text = found.to_csv(tmp_path / "rows.csv")
    assert (tmp_path / "rows.csv").read_bytes().decode() == text
    (row,) = csv.DictReader(io.StringIO(text))
    assert row["name"] == name
    assert row["nominal (mm)"] == "0.333333333"
    assert row["simulated"] == row["reason"] == ""
    assert row["x (mm)"] == "40.0"
    exact = found.rows()[0]
    assert exact["nominal"] == 1 / 3
    u = exact["standard_uncertainty"]
    assert float(row["standard_uncertainty (mm)"]) == pytest.approx(u, rel=5e-3)
    assert not re.search(r"\d{10}", text)


@pytest.mark.parametrize("name", ["=HYPERLINK(1)", "+1", "-1", "@SUM(A1)", "\t=1", "\r=1", "'=1"])
def test_no_spreadsheet_runs_a_name(name):
    found = plan(
        settings=[setting((-40.0, -180.0, 620.0), [name])],
        entities={name: [[0, 0, 0], [1, 0, 0]]},
        uninspectable={},
    )
    (row,) = csv.DictReader(io.StringIO(found.to_csv(), newline=""))
    assert row["name"] == "'" + name
    # numbers are no text
    assert row["x (mm)"] == "-40.0"
    assert found.rows()[0]["name"] == name


def test_csv_of_an_empty_plan_is_a_heading():
    assert (
        plan(settings=(), entities={}, uninspectable={}, lower_bound=0).to_csv()
        == "setting,name\r\n"
    )


def test_csv_into_no_folder_is_refused(tmp_path):
    with pytest.raises(OutputError, match="must be in a folder"):
        plan().to_csv(tmp_path / "none" / "rows.csv")


def test_notebooks_show_a_table_with_names_escaped():
    name = "<script>"
    entities = {name: [[0, 0, 0], [80, 0, 0]], "b&d": [[0, 0, 0], [0, 50, 0]]}
    found = plan(
        settings=[setting((40.0, -180.0, 620.0), [name])],
        entities=entities,
        uninspectable={"b&d": "<no>"},
        part="x<y",
    )
    html = found._repr_html_()
    assert "<script>" not in html
    assert "&lt;script&gt;" in html
    assert "x&lt;y: 1 of 2 inspected in 1 setting (at least 1 needed), A = 0.98, P ≥ 0.9" in html
    assert "<li>b&amp;d: &lt;no&gt;</li>" in html
    assert html.count("<tr>") == 2
    assert "40.0, -180.0, 620.0" in html
    assert "0.9500" in html


def test_a_simulated_plan_shows_the_smallest_frequency():
    found = plan().simulated(100, rng=0)
    # both edges are measured well from every displaced pose, which is told as a count
    assert all(rate.successes == 100 for rates in found.simulation.rates for rate in rates.values())
    assert "100 of 100" in found._repr_html_()
    assert "1.0000" not in found._repr_html_()
    assert "not yet" in plan()._repr_html_()
    assert "not yet" not in found._repr_html_()
