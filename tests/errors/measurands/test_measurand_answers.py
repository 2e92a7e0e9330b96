"""Answers in closed form, straight on: the camera looks along the part's z axis from a height Z."""

import math

import numpy as np
import pytest
from dimension_examples import PITCH, F, isotropic

from errors.measurands import Circle, Line, Localisation, MeasurandModel
from errors.measurands.measurand import measurand

pytestmark = pytest.mark.uncompiled

Z = 300.0
OVERHEAD = np.array([[1.0, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, Z], [0, 0, 0, 1]])
SQUARE = (0.005, 0.005)
RIM = Circle((0, 0, 0), (0, 0, 1), 10.0)
LINES = Line((-15, -10, 0), (15, -10, 0)), Line((-15, 10, 0), (15, 10, 0))
EXACT = Localisation.gaussian(0.0, floor_px=0.0)
STILL = np.zeros((6, 6))
KINDS = {
    "length": (Line((-10, 0, 0), (10, 0, 0)),),
    "distance": LINES,
    "diameter": (RIM,),
    "radius": (RIM,),
    "centre_distance": (Circle((-10, 0, 0), (0, 0, 1), 4.0), Circle((10, 0, 0), (0, 0, 1), 6.0)),
    "centre_to_edge": (Circle((0, 10, 0), (0, 0, 1), 4.0), Line((-15, -10, 0), (15, -10, 0))),
    "angle": (Line((-10, 0, 0), (10, 0, 0)), Line((-10, -10, 0), (10, 10, 0))),
}


def predict(
    kind,
    geometry,
    covariance,
    localisation=EXACT,
    *,
    permitted=0.05,
    pitch=SQUARE,
    pose=OVERHEAD,
    way=None,
    surfaces=0.0,
):
    model = MeasurandModel(
        measurand(kind, geometry, way),
        image_distance_mm=F,
        pixel_pitch_mm=pitch,
        pose_covariance=covariance,
        localisation=localisation,
        permitted_error=permitted,
        surfaces_mm=surfaces,
    )
    return model.describe(pose)


def axis(index, sigma):
    covariance = np.zeros((6, 6))
    covariance[index, index] = sigma**2
    return covariance


@pytest.mark.parametrize(
    "kind", ["length", "distance", "diameter", "radius", "centre_distance", "centre_to_edge"]
)
def test_error_along_the_axis_scales_everything(kind):
    # the image of a plane at Z seen from Z - t is larger by Z / (Z - t) = 1 + t / Z + t^2 / Z^2
    sigma = 0.3
    found = predict(kind, KINDS[kind], axis(2, sigma))
    first = found.nominal * sigma / Z
    # the square term adds its own variance, 2 D^2 (sigma / Z)^4, and a mean error
    assert found.standard_uncertainty == pytest.approx(
        first * math.sqrt(1 + 2 * (sigma / Z) ** 2), rel=1e-9
    )
    assert found.bias == pytest.approx(found.nominal * (sigma / Z) ** 2, rel=1e-9)
    assert found.budget["translation"] == pytest.approx(found.standard_uncertainty**2, rel=1e-12)
    assert found.budget["rotation"] == found.budget["localisation"] == 0.0


def test_error_along_the_axis_does_not_change_an_angle():
    assert predict("angle", KINDS["angle"], axis(2, 0.3)).standard_uncertainty == pytest.approx(
        0.0, abs=1e-12
    )


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "angle"])
def test_probability_is_that_of_a_normal_error(kind):
    # 3 um along the axis: linear to a hundred-thousandth, so P(|e| <= 1.3 s.d.) = erf(1.3 / sqrt 2)
    sigma = 0.003
    nominal = measurand(kind, KINDS[kind]).nominal
    found = predict(kind, KINDS[kind], axis(2, sigma), permitted=1.3 * nominal * sigma / Z)
    assert found.probability == pytest.approx(math.erf(1.3 / math.sqrt(2)), abs=2e-5)


def test_a_distance_along_a_given_direction_grows_when_the_lines_turn():
    # along the direction, lines turned by phi are D / cos phi apart: mean error D sigma^2 / 2
    found = predict("distance", LINES, axis(5, 0.01), way=(0, 1, 0))
    assert found.bias == pytest.approx(20.0 * 0.01**2 / 2, rel=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_turns_about_the_optical_axis_and_shifts_across_it_make_no_error(kind):
    for index in (0, 1, 5):
        found = predict(kind, KINDS[kind], axis(index, 0.01))
        assert found.standard_uncertainty == pytest.approx(0.0, abs=1e-9 * found.nominal)
        assert found.bias == pytest.approx(0.0, abs=1e-9 * found.nominal)


@pytest.mark.parametrize("kind", KINDS)
def test_sure_without_any_error(kind):
    found = predict(kind, KINDS[kind], STILL)
    assert (found.probability, found.standard_uncertainty, found.bias) == (1.0, 0.0, 0.0)


@pytest.mark.parametrize("points", [8, 16, 50])
def test_localisation_of_a_whole_circle(points):
    # A'A of (cos, sin, 1) over a full circle is diag(N / 2, N / 2, N)
    sigma_px = 0.2
    sigma = 0.2 * SQUARE[0] * Z / F
    how = Localisation.gaussian(sigma_px, points, floor_px=0.0)
    radius = sigma / math.sqrt(points)
    assert predict("radius", (RIM,), STILL, how).standard_uncertainty == pytest.approx(
        radius, rel=1e-9
    )
    assert predict("diameter", (RIM,), STILL, how).standard_uncertainty == pytest.approx(
        2 * radius, rel=1e-9
    )
    two = predict("centre_distance", KINDS["centre_distance"], STILL, how).standard_uncertainty
    assert two == pytest.approx(math.sqrt(2) * sigma * math.sqrt(2 / points), rel=1e-9)


@pytest.mark.parametrize("points", [8, 16, 50])
def test_localisation_of_lines(points):
    sigma = 0.2 * SQUARE[0] * Z / F
    how = Localisation.gaussian(0.2, points, floor_px=0.0)
    distance = predict("distance", LINES, STILL, how).standard_uncertainty
    assert distance == pytest.approx(sigma * math.sqrt(2 / points), rel=1e-9)
    # centre and foot of the perpendicular are half way along the edge: a centre and the middle of a line
    edge = predict("centre_to_edge", KINDS["centre_to_edge"], STILL, how).standard_uncertainty
    assert edge == pytest.approx(sigma * math.sqrt(3 / points), rel=1e-9)


def test_localisation_of_an_angle():
    # slope of a line of N points, at the middles of equal parts of its length l: variance 12 s^2 / (N l^2 (1 - 1/N^2))
    n = 20
    sigma = 0.2 * SQUARE[0] * Z / F
    variance = sum(12 * sigma**2 / (n * one.length**2 * (1 - 1 / n**2)) for one in KINDS["angle"])
    found = predict("angle", KINDS["angle"], STILL, Localisation.gaussian(0.2, n, floor_px=0.0))
    assert found.standard_uncertainty == pytest.approx(math.degrees(math.sqrt(variance)), rel=1e-9)


def test_localisation_of_a_length_is_that_of_two_ends():
    sigma = 0.2 * SQUARE[0] * Z / F
    found = predict("length", KINDS["length"], STILL, Localisation.gaussian(0.2, floor_px=0.0))
    assert found.standard_uncertainty == pytest.approx(sigma * math.sqrt(2), rel=1e-9)


@pytest.mark.parametrize(("order", "pitch"), [([0, 1, 2], PITCH[1]), ([1, 0, 2], PITCH[0])])
def test_pixels_that_are_not_square(order, pitch):
    # lines along x are found across it, with the pitch along y; and the other way round
    lines = tuple(Line(one.p[order], one.q[order]) for one in LINES)
    found = predict(
        "distance", lines, STILL, Localisation.gaussian(0.2, 16, floor_px=0.0), pitch=PITCH
    )
    assert found.standard_uncertainty == pytest.approx(
        0.2 * pitch * Z / F * math.sqrt(2 / 16), rel=1e-9
    )


def test_pixels_that_are_not_square_of_a_circle():
    # radial variance: sum of cos^2 s_x^2 + sin^2 s_y^2 over N^2
    found = predict(
        "radius", (RIM,), STILL, Localisation.gaussian(0.2, 16, floor_px=0.0), pitch=PITCH
    )
    mean_square = (PITCH[0] ** 2 + PITCH[1] ** 2) / 2
    assert found.standard_uncertainty == pytest.approx(
        0.2 * math.sqrt(mean_square / 16) * Z / F, rel=1e-9
    )


def test_fit_averages_over_the_image():
    # circumference of the image 2 pi R f / Z in px, over the correlation length; inscribed polygon of 16: sin(x)/x
    found = predict("radius", (RIM,), STILL, Localisation.fit(0.3, 2.0, 0.0))
    along = 2 * math.pi * 10 * F / Z / SQUARE[0]
    expected = 0.3 * SQUARE[0] * Z / F / math.sqrt(along / 2.0)
    assert found.standard_uncertainty == pytest.approx(expected, rel=0.005)


def test_no_fit_is_better_than_its_floor():
    how = Localisation.fit(0.3, 1e-6, 0.02)
    assert predict("radius", (RIM,), STILL, how).standard_uncertainty == pytest.approx(
        0.02 * SQUARE[0] * Z / F
    )
    distance = predict("distance", LINES, STILL, how).standard_uncertainty
    assert distance == pytest.approx(math.sqrt(2) * 0.02 * SQUARE[0] * Z / F)


@pytest.mark.parametrize("index", [3, 4])
def test_a_rim_turned_about_its_diameter(index):
    # to first order its points move outward on one side by as much as inward on the other: the radius stays
    small, double = (predict("radius", (RIM,), axis(index, sigma)) for sigma in (0.001, 0.002))
    assert 0 < small.standard_uncertainty < 10.0 * 0.001 / 100
    assert double.standard_uncertainty == pytest.approx(4 * small.standard_uncertainty, rel=1e-9)
    assert double.bias == pytest.approx(4 * small.bias, rel=1e-9)


def test_distance_of_lines_at_two_heights():
    # along z only: the line at height h is Z - h away; its offset y is wrong by y t / (Z - h)
    low = Line((-15, -10, 0), (15, -10, 0))
    high = Line((-15, 10, 40), (15, 10, 40))
    found = predict("distance", (low, high), axis(2, 0.003), way=(0, 1, 0))
    assert found.nominal == pytest.approx(20.0)
    assert found.standard_uncertainty == pytest.approx(0.003 * (10 / Z + 10 / (Z - 40)), rel=1e-6)


def test_plane_of_a_default_distance_holds_both_lines():
    # without a direction the plane is inclined; height and offset together: distance is sqrt(20^2 + 40^2)
    low = Line((-15, -10, 0), (15, -10, 0))
    high = Line((-15, 10, 40), (15, 10, 40))
    found = predict("distance", (low, high), axis(2, 0.003))
    assert found.nominal == pytest.approx(math.hypot(20, 40))
    # a point (y, z) of the plane y = -10 + s, z = 2 s goes along its ray displaced by -t: with n = (2, -1) / sqrt 5,
    # X' = (C - t) c / (n.(C - t)), in camera coordinates C = (y, Z - z)
    step = 1e-4
    n = np.array([2.0, 1.0]) / math.sqrt(5)
    away = np.array([1.0, -2.0]) / math.sqrt(5)

    def place(y, z, t):
        real = np.array([y, Z - z - t])
        return away @ (real * (n @ np.array([y, Z - z])) / (n @ real))

    slope = [(place(y, z, step) - place(y, z, -step)) / (2 * step) for y, z in ((-10, 0), (10, 40))]
    assert found.standard_uncertainty == pytest.approx(0.003 * abs(slope[1] - slope[0]), rel=1e-5)


def test_budget_sums_to_the_total_and_shares_what_is_common():
    rng = np.random.default_rng(3)
    factor = rng.normal(size=(6, 6)) * [[0.1], [0.1], [0.1], [0.003], [0.003], [0.003]]
    covariance = factor @ factor.T
    for kind, geometry in KINDS.items():
        whole = predict(kind, geometry, covariance, Localisation.gaussian(0.3, floor_px=0.0))
        assert math.fsum(whole.budget.values()) == pytest.approx(
            whole.standard_uncertainty**2, rel=1e-12
        )
        apart = [covariance.copy(), covariance.copy()]
        apart[0][3:] = 0
        apart[0][:, 3:] = 0
        apart[1][:3] = 0
        apart[1][:, :3] = 0
        alone = [predict(kind, geometry, one).standard_uncertainty ** 2 for one in apart]
        common = (whole.standard_uncertainty**2 - whole.budget["localisation"] - sum(alone)) / 2
        assert whole.budget["translation"] == pytest.approx(alone[0] + common, rel=1e-6, abs=1e-12)


def test_independent_errors_of_a_view_do_not_depend_on_the_order_of_entities():
    covariance = isotropic(0.1, 0.003)
    pose = np.array([[1.0, 0, 0, 3], [0, -0.8, 0.6, -2], [0, -0.6, -0.8, Z], [0, 0, 0, 1]])
    for kind in ("distance", "angle", "centre_distance"):
        one = predict(
            kind, KINDS[kind], covariance, Localisation.gaussian(0.3, floor_px=0.0), pose=pose
        )
        other = predict(
            kind, KINDS[kind][::-1], covariance, Localisation.gaussian(0.3, floor_px=0.0), pose=pose
        )
        assert one.probability == pytest.approx(other.probability, abs=1e-9)
        assert one.standard_uncertainty == pytest.approx(other.standard_uncertainty, rel=1e-9)
