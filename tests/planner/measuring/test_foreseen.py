"""A plan foresees the uncertainty that `measure` states of a rendered part, under the same state of edges."""

import csv
import io
import math
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "helpers"))
import measured_plate as plate
from part_images import Optics, PartImages
from plan_examples import changed
from rendered_images import Lamp

from errors.measurands import DecisionRule, acceptance_limits
from planner import (
    Camera,
    InspectionPlan,
    MeasureOptions,
    Measurer,
    PlanFileError,
    PoseUncertainty,
    Registration,
)
from planner.measuring.foreseen import (
    foreseen_in_time,
    foreseen_uncertainties,
    surest,
    with_foreseen,
)
from planner.progress import TimeLeft
from planner.report.measured_report import measured_html
from planner.report.setting_report import dimensions_table
from planner.report.wording import unstated_edges_text
from planner.request.registration import OWN_EDGES, PoseKnowledge, RegistrationRecord
from planner.request.words import amount_text
from planner.sensor_setting import Foreseen
from planner.text_table import digits_text
from planner.verify.setting_record import measurements

SURFACES_MM = 0.005
CAMERA = Camera(25.0, (0.0069, 0.0069), (1280, 1024), 8.0, 300.0)
SOLID = plate.thick_plate()
SURE = PoseUncertainty.isotropic(translation_mm=0.01, rotation_rad=0.0001)


def plan_of(method):
    plan = plate.measured_plan(
        SOLID, settings=1, camera=CAMERA, pose_uncertainty=SURE, surfaces_mm=SURFACES_MM
    )
    if method == "planned":
        return plan
    settings = [
        replace(setting, registered=PoseKnowledge(SURE.covariance)) for setting in plan.settings
    ]
    return changed(
        plan, registration=RegistrationRecord(OWN_EDGES, SURFACES_MM), settings=tuple(settings)
    )


def measured(plan, size, limits):
    mesh = plate.broken_plate([(size, 0.0), (0.0, size)]) if size else plate.fine_plate()
    optics = Optics(CAMERA.matrix, CAMERA.resolution, noise=0.005, samples=3, every=4)
    pose = plate.POSES[0]
    image = PartImages(*mesh, optics).image(pose, [Lamp(pose[:3, 3])], np.random.default_rng(1))
    how = Registration.own_edges(SURFACES_MM)
    options = MeasureOptions(how, edge_break_mm=limits, response="linear")
    return Measurer(plan, SOLID).measure({1: image}, options)


@pytest.mark.parametrize("method", ["planned", "own edges"])
@pytest.mark.parametrize(("size", "limits"), [(0.0, None), (0.1, (0.05, 0.15))])
def test_the_foreseen_uncertainty_is_that_of_the_image(method, size, limits):
    plan = plan_of(method)
    results = measured(plan, size, limits)
    read = {result.name: result for result in results if result.measured}
    assert {"right", "width"} <= set(read)
    rows = {row.name: row for row in foreseen_uncertainties(plan, SOLID, limits)}
    for name, result in read.items():
        ratio = rows[name].expanded_uncertainty / result.expanded_uncertainty
        assert 0.85 < ratio < 1.15
        if limits is None:
            unseen = results.unseen.uncertainties[name]
            assert 0.85 < rows[name].unseen_uncertainty / unseen < 1.15
            assert rows[name].limit_mm == pytest.approx(results.unseen.limit_mm, rel=0.02)


def test_results_show_it_next_to_their_uncertainty():
    plan = replace(plan_of("planned"), foreseen=())
    assert all(math.isnan(result.foreseen_uncertainty) for result in measured(plan, 0.0, None))
    wide = Foreseen("right", 0, 0.0314, 0.1, 0.1, False)
    # not that of a setting without an image
    rows = (wide, replace(wide, setting=1, expanded_uncertainty=0.001))
    results = measured(replace(plan, foreseen=rows), 0.0, None)
    assert results["right"].foreseen_uncertainty == 0.0314
    shown = {
        row["name"]: row["U_foreseen"] for row in csv.DictReader(io.StringIO(results.to_csv()))
    }
    assert shown == {"left": "", "right": "0.031", "apart": "", "width": ""}
    stored = {row["name"]: row["U_foreseen"] for row in results.to_dict()["results"]}
    assert stored == {"left": None, "right": 0.0314, "apart": None, "width": None}
    assert "U foreseen by the plan" in measured_html(results)
    assert measured_html(results).count("not foreseen") == 3
    (first, *_) = results
    assert "U foreseen" not in measured_html(replace(results, results={"left": first}))


def test_nothing_is_foreseen_of_what_no_lamp_shows():
    measurer = Measurer.__new__(Measurer)
    rows = [Foreseen("right", 0, 0.0314, 0.1, 0.1, False)]
    results = measured(plan_of("planned"), 0.0, None)
    for unlit, foreseen in (((), True), (("right",), False)):
        measurer.plan = SimpleNamespace(unlit=unlit, foreseen=rows)
        result = measurer._with_foreseen(replace(results["right"], foreseen_uncertainty=math.nan))
        assert math.isfinite(result.foreseen_uncertainty) is foreseen


def test_sharp_edges_leave_the_floor_of_the_detector():
    plan = plan_of("planned")
    (row,) = [row for row in foreseen_uncertainties(plan, SOLID, (0.0, 0.0)) if row.name == "right"]
    read = {result.name: result for result in measured(plan, 0.0, (0.0, 0.0))}
    # the rest of U of an image is what its own points show, which a plan cannot know
    assert row.expanded_uncertainty == pytest.approx(read["right"].expanded_uncertainty, rel=0.4)
    assert row.unseen_uncertainty == row.expanded_uncertainty
    assert not row.is_open


def test_what_is_foreseen_stands_among_the_notes_of_a_plan():
    plan = plan_of("own edges")
    plan = with_foreseen(plan, SOLID)
    text = unstated_edges_text(plan)
    best = surest(plan.foreseen)
    n_open = sum(row.is_open for row in best.values())
    assert n_open > 0
    assert f"it is open for {n_open} of {len(best)} dimensions" in text


def test_a_target_without_usable_points_is_left_out(monkeypatch):
    # a U of nan ended plans whose targets all have other lines next to them
    monkeypatch.setattr("planner.measuring.foreseen._APART_PX", 1e4)
    assert foreseen_uncertainties(plan_of("planned"), SOLID) == []


def test_a_plan_without_time_for_it_says_so():
    plan = plan_of("planned")
    same, (sentence,) = foreseen_in_time(plan, SOLID, TimeLeft(0.0))
    assert same is plan
    assert "--time-limit" in sentence
    assert foreseen_in_time(plan, SOLID, TimeLeft()) == (with_foreseen(plan, SOLID), [])


@pytest.mark.parametrize("limits", [None, (0.0, 0.0)], ids=["unstated", "sharp"])
def test_the_table_of_a_plan_shows_what_measure_will_use(limits):
    """Where no edges are stated, U and the accepted values of the plan stand in brackets."""
    plan = changed(plan_of("own edges"), edge_break_mm=limits)
    plan = with_foreseen(plan, SOLID)
    table = dimensions_table(plan)
    heads = [column.title for column in table.columns]
    foreseen = {row.name: row for row in plan.foreseen}
    rows = {row[0][0].text: dict(zip(heads, row, strict=True)) for row in table.rows}
    for name, row in rows.items():
        planned = measurements(plan, plan.settings[0])[name].expanded_uncertainty
        amounts = [planned] if limits else [foreseen[name].expanded_uncertainty, planned]
        texts = [f"{amount_text(digits_text(amount, 3), 'mm')}" for amount in amounts]
        texts[1:] = [f"({text})" for text in texts[1:]]
        assert [line.text.replace("\xa0", " ") for line in row["U (k = 2)"]] == texts
        assert [line.style for line in row["U (k = 2)"]] == ["", "note"][: len(texts)]
        accepted = acceptance_limits(
            plan.dimensions[name].tolerance, amounts[0] / 2, DecisionRule.iso14253()
        )
        low, high = (
            float(word.removesuffix("mm")) - plan.dimensions[name].nominal
            for word in row["Accepted from, to"][0].text.replace("\xa0", "").split(" to ")
        )
        # rounded inwards, to two digits of U
        assert accepted[0] <= low <= accepted[0] + amounts[0] / 10
        assert accepted[1] - amounts[0] / 10 <= high <= accepted[1]


def test_a_plan_without_tolerances_has_no_column_about_them():
    plan = plan_of("planned")
    bare = tuple(replace(target, tolerance=None) for target in plan.request.targets)
    free = dimensions_table(changed(plan, targets=bare))
    about = {"U/T", "Accepted from, to"}
    assert not about.intersection(column.title for column in free.columns)
    assert about < {column.title for column in dimensions_table(plan).columns}
    assert {len(row) for row in free.rows} == {len(free.columns)}


def test_a_plan_holds_what_is_foreseen():
    plan = with_foreseen(plan_of("own edges"), SOLID)
    assert plan.foreseen == tuple(foreseen_uncertainties(plan, SOLID))
    data = plan.to_dict()
    assert InspectionPlan.from_dict(data).foreseen == plan.foreseen
    rows = {row["name"]: row for row in plan.rows()}
    for foreseen in plan.foreseen:
        row = rows[foreseen.name]
        assert row["measured_uncertainty"] == foreseen.expanded_uncertainty
        assert row["unseen_uncertainty"] == foreseen.unseen_uncertainty
    heading = plan.to_csv().splitlines()[0]
    assert "measured_uncertainty" in heading.split(",")
    # a file of before is read as it is
    del data["foreseen"]
    older = InspectionPlan.from_dict(data)
    assert older.foreseen == ()
    assert {row["measured_uncertainty"] for row in older.rows()} == {None}


@pytest.mark.parametrize(
    ("key", "value", "rule"),
    [
        (
            "setting",
            1,
            r"foreseen\[0\].setting must be the number of a setting, from 0 to 0. Got 1",
        ),
        ("name", "none", r"foreseen\[0\].name must be a dimension that setting 0 measures"),
        ("unseen_uncertainty", 0.0, "must be at least expanded_uncertainty. Got 0"),
        ("expanded_uncertainty", -1.0, "must not be negative"),
    ],
)
def test_what_is_foreseen_must_be_of_the_plan(key, value, rule):
    data = with_foreseen(plan_of("planned"), SOLID).to_dict()
    rows = [dict(row) for row in data["foreseen"]]
    rows[0][key] = value
    with pytest.raises(PlanFileError, match=rule):
        InspectionPlan.from_dict({**data, "foreseen": rows})
    with pytest.raises(PlanFileError, match=r"name must stand once for setting 0"):
        InspectionPlan.from_dict({**data, "foreseen": [data["foreseen"][0]] * 2})
