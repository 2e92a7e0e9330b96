"""A plan as rows, as CSV and as a notebook's table. The numbers are those of the hand-made plan, seen another way."""

import csv
import io
import re
from dataclasses import replace

import numpy as np
import pytest
from plan_examples import LIGHT, plan, setting
from scipy.spatial.transform import Rotation

from errors.checks import probability_text
from planner import read_plan
from planner.exceptions import OutputError
from planner.report.wording import light_sentence
from planner.sensor_setting import Foreseen
from planner.text_table import digits_text


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
        turn = Rotation.from_rotvec([row[f"rotvec_{axis}"] for axis in "xyz"], degrees=True)
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
    assert row["nominal"] == "0.333333333"
    assert row["simulated"] == row["reason"] == ""
    assert row["unit"] == "mm"
    assert row["x (mm)"] == "40.0"
    exact = found.rows()[0]
    assert exact["nominal"] == 1 / 3
    u = exact["standard_uncertainty"]
    assert float(row["standard_uncertainty"]) == pytest.approx(u, rel=5e-3)
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
    # a heading and a row of the settings, and the same of what they measure
    assert html.count("<tr>") == 4
    assert "40.0, -180.0, 620.0" in html
    assert "0.9500" in html


def cells_of(html):
    """Texts of the rows of all tables of a view."""
    return [re.findall("<td[^>]*>([^<]*)</td>", row) for row in re.findall("<tr>(.*?)</tr>", html)]


def test_notebooks_show_each_dimension_with_its_tolerance_u_and_p():
    found = read_plan("examples/measured/plan.json")
    cells = {row[0]: row for row in cells_of(found._repr_html_()) if row}
    assert list(found.targets) == [name for name in cells if name in found.targets]
    for name in found.targets:
        row = max((r for r in found.rows() if r["name"] == name), key=lambda r: r["p_all"])
        u = digits_text(2 * row["standard_uncertainty"], 2)
        texts = [probability_text(row[key], found.probability) for key in ("p_all", "probability")]
        stated = [html_of(text) for text in texts]
        # nothing is foreseen in this plan, and nobody states its edges
        assert cells[name][2:] == [f"{u} mm *", *stated]
    assert "* as planned, with sharp edges" in found._repr_html_()
    assert cells["slot_width"][1] == "distance 50 mm ±0.3"


def html_of(text):
    return text.replace(">", "&gt;")


def test_notebooks_show_the_u_that_measure_will_state():
    found = read_plan("examples/measured/plan.json")
    (setting,) = [k for k, made in enumerate(found.settings) if "bore_25" in made.entities]
    stated = Foreseen("bore_25", setting, 0.1875, 0.25, 0.5, True)
    html = replace(found, foreseen=(stated,))._repr_html_()
    amounts = {row[0]: row[2] for row in cells_of(html) if row and row[0] in found.targets}
    assert amounts["bore_25"] == "0.19 mm"
    assert all(text.endswith(" mm *") for name, text in amounts.items() if name != "bore_25")
    stated = replace(found, request=replace(found.request, edge_break_mm=(0.0, 0.0)))
    assert " mm *" not in stated._repr_html_()


def test_notebooks_show_the_first_targets_of_a_long_plan():
    names = [f"edge {k}" for k in range(20)]
    found = plan(
        settings=[setting((40.0, -180.0, 620.0), names)],
        entities={name: [[0, k, 0], [80, k, 0]] for k, name in enumerate(names)},
        uninspectable={},
    )
    html = found._repr_html_()
    shown = [row[0] for row in cells_of(html) if row and row[0] in names]
    assert shown == names[:12]
    assert "and 8 more: plan.rows() and plan.to_dataframe() list all." in html
    assert " more: " not in plan()._repr_html_()
    length = [row[1] for row in cells_of(html) if row[:1] == ["edge 0"]]
    assert length == ["length 80.000 mm, error up to 2 %"]


def test_notebooks_show_where_lamps_are():
    html = replace(plan(), light=LIGHT)._repr_html_()
    headings = re.findall("<th[^>]*>([^<]*)</th>", html)
    column = headings.index("lamp at (mm)")
    for k, images in enumerate(LIGHT.images):
        lamps = [LIGHT.lamps[lamp] for image in images for lamp in image.lamps]
        text = "; ".join(", ".join(f"{c:.1f}" for c in lamp) for lamp in lamps)
        assert cells_of(html)[k + 1][column] == text
    assert light_sentence(replace(plan(), light=LIGHT)) in html
    dark = plan()._repr_html_()
    assert "lamp at (mm)" not in dark
    assert "Light is not planned, so nothing is promised of contrast." in dark


def test_a_simulated_plan_shows_the_smallest_frequency():
    found = plan().simulated(100, rng=0)
    # both edges are measured well from every displaced pose, which is told as a count
    assert all(rate.successes == 100 for rates in found.simulation.rates for rate in rates.values())
    assert "100 of 100" in found._repr_html_()
    assert "1.0000" not in found._repr_html_()
    assert "not yet" in plan()._repr_html_()
    assert "not yet" not in found._repr_html_()
