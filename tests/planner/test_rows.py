"""Rows of what is measured: sizes in the image from a lens's own formula, u from displaced poses, warnings by hand."""

from dataclasses import replace

import numpy as np
import pytest
from plan_examples import CAMERA, LIGHT, UNCERTAINTY, changed, plan, planned_dimension, setting
from scipy.spatial.transform import Rotation

from errors.measurands import Line, Localisation
from errors.measurands.measurand import SOURCES
from planner.plan_tables import WarningKind, measured_rows
from planner.verify.simulate_plan import SimulationResult
from planner.verify.simulate_setting import SuccessRate

LENGTH_MM = 80.0
DEPTH_MM = 560.0


def square_on(**changes):
    """An edge of 80 mm, seen square-on from 560 mm, along the image's x."""
    one = setting((40.0, 0.0, 60.0 + DEPTH_MM), ["top front"], target=(40.0, 0.0, 60.0))
    turned = np.array(one.cam2world)
    turned[:3, :3] = [[1, 0, 0], [0, -1, 0], [0, 0, -1]]
    one = type(one)(**{**vars(one), "cam2world": turned})
    return plan(
        settings=(one,),
        entities={"top front": [[0.0, 0.0, 60.0], [LENGTH_MM, 0.0, 60.0]]},
        uninspectable={},
        **changes,
    )


def with_dimension(how):
    """The same as a dimension, with a permitted error of a thousandth."""
    found = square_on()
    ends = found.entities["top front"]
    one = planned_dimension("length", ("top front",), (Line(*ends),), LENGTH_MM / 1000)
    return changed(found, entities={}, dimensions={"top front": one}, localisation=how)


def rate(frequency, predicted, n=1000):
    successes = round(frequency * n)
    half = 0.01
    return SuccessRate(
        successes, n, max(0.0, frequency - half), min(1.0, frequency + half), 0.99, 0, predicted
    )


def warnings_with(simulated, **changes):
    found = square_on(**changes)
    result = SimulationResult(({"top front": rate(simulated, 0.95)},), 1000, 0, 0.99)
    (row,) = measured_rows(replace(found, simulation=result))[0]
    return tuple(warning.text for warning in row.warnings)


def test_permitted_error_in_the_image_is_that_of_the_lens():
    (row,) = measured_rows(square_on())[0]
    # two hundredths of the image of 80 mm at 560 mm
    assert row.permitted_error_px == pytest.approx(
        0.02 * LENGTH_MM * CAMERA.image_distance_mm / DEPTH_MM / 0.00345, rel=1e-9
    )
    assert row.permitted_error == pytest.approx(1.6)
    assert (row.kind, row.unit, row.nominal) == ("length", "mm", LENGTH_MM)


def test_standard_uncertainty_is_the_spread_over_displaced_poses():
    (row,) = measured_rows(square_on())[0]
    rng = np.random.default_rng(0)
    n = 40_000
    moved = rng.multivariate_normal(np.zeros(6), UNCERTAINTY.covariance, n)
    ends = np.array([[-LENGTH_MM / 2, 0.0, DEPTH_MM], [LENGTH_MM / 2, 0.0, DEPTH_MM]])
    turns = Rotation.from_rotvec(moved[:, 3:]).as_matrix()
    seen = np.einsum("nij,ej->nei", turns, ends) + moved[:, None, :3]
    pixels = CAMERA.image_distance_mm * seen[..., :2] / seen[..., 2:] / CAMERA.pixel_pitch_mm
    # whole pixels of a grid whose phase is random
    pixels += rng.uniform(-0.5, 0.5, pixels.shape)
    planned = LENGTH_MM * CAMERA.image_distance_mm / DEPTH_MM
    measured = (
        LENGTH_MM
        * np.linalg.norm((pixels[:, 1] - pixels[:, 0]) * CAMERA.pixel_pitch_mm, axis=1)
        / planned
    )
    assert row.standard_uncertainty == pytest.approx(measured.std(), rel=0.02)
    assert sum(row.budget.values()) == pytest.approx(row.standard_uncertainty**2)
    assert tuple(row.budget) == SOURCES


def test_a_tolerance_under_two_pixels_is_told():
    assert measured_rows(square_on())[0][0].warnings == ()
    (row,) = measured_rows(square_on(accuracy=0.999))[0]
    ((kind, text),) = row.warnings
    assert kind == WarningKind.FEW_PIXELS
    assert text.startswith("tolerance of 1.1 px, under two pixels: P is the mean over parts")


def test_a_simulation_that_differs_is_told():
    assert warnings_with(0.95) == ()
    # better by more than the interval but by no more than two hundredths: nothing to look at
    assert warnings_with(0.965) == ()
    assert warnings_with(0.99) == ("simulation gives 0.9900, 0.04 better than stated",)
    (told,) = warnings_with(0.8)
    assert told == "simulation gives 0.8000 instead of 0.9500: contradicted"


def test_rows_stand_in_the_order_of_the_settings():
    rows = measured_rows(plan())
    assert [[(row.setting, row.name) for row in one] for one in rows] == [
        [(1, "top front"), (1, "top right")],
        [(2, "top right")],
    ]


def test_only_whole_pixels_make_a_small_tolerance_doubtful():
    rounded, fitted = (
        measured_rows(with_dimension(how))[0][0]
        for how in (Localisation.rounding(), Localisation.gaussian(0.1))
    )
    # one thousandth of the image of 80 mm, in the coarser pixels, the same for both
    wanted = 0.001 * LENGTH_MM * CAMERA.image_distance_mm / DEPTH_MM / 0.0035
    assert rounded.permitted_error_px == fitted.permitted_error_px == pytest.approx(wanted)
    assert [warning.kind for warning in rounded.warnings] == [WarningKind.FEW_PIXELS]
    assert fitted.warnings == ()


def test_what_no_lamp_shows_is_warned_of():
    """First of all: the probability is that of an edge that is found."""
    light = replace(LIGHT, unlit=({"top right": "none of 2 lamps shows it."}, {}))
    first, second = measured_rows(plan(light=light))
    assert {row.name: [one.kind for one in row.warnings] for row in first} == {
        "top front": [],
        "top right": [WarningKind.UNLIT],
    }
    assert first[1].warnings[0].text == "not visible under any lamp: none of 2 lamps shows it."
    assert not second[0].warnings
