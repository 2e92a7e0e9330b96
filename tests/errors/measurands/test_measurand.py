"""Answers in closed form, straight on: the camera looks along the part's z axis from a height Z."""

import math

import numpy as np
import pytest
import scipy.linalg
from dimension_examples import EXAMPLES, PITCH, F, geometry_of, isotropic
from measured_exactly import look_at, measure, random_view
from scipy.spatial.transform import Rotation

from errors import InvalidParameterError, InvalidShapeError
from errors.measurands import (
    Circle,
    Decision,
    DecisionRule,
    Line,
    Localisation,
    MeasurandError,
    MeasurandModel,
    conformance_probability,
    decide,
)
from errors.measurands.measurand import measurand, uncorrelated_root
from ground.convert import from_plain, to_plain

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
    "centre_distance": (
        Circle((-10, 0, 0), (0, 0, 1), 4.0),
        Circle((10, 0, 0), (0, 0, 1), 6.0),
    ),
    "centre_to_edge": (
        Circle((0, 10, 0), (0, 0, 1), 4.0),
        Line((-15, -10, 0), (15, -10, 0)),
    ),
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


@pytest.mark.uncompiled
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


@pytest.mark.uncompiled
def test_error_along_the_axis_does_not_change_an_angle():
    assert predict("angle", KINDS["angle"], axis(2, 0.3)).standard_uncertainty == pytest.approx(
        0.0, abs=1e-12
    )


@pytest.mark.uncompiled
@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "angle"])
def test_probability_is_that_of_a_normal_error(kind):
    # 3 um along the axis: linear to a hundred-thousandth, so P(|e| <= 1.3 s.d.) = erf(1.3 / sqrt 2)
    sigma = 0.003
    nominal = measurand(kind, KINDS[kind]).nominal
    found = predict(kind, KINDS[kind], axis(2, sigma), permitted=1.3 * nominal * sigma / Z)
    assert found.probability == pytest.approx(math.erf(1.3 / math.sqrt(2)), abs=2e-5)


@pytest.mark.uncompiled
def test_a_distance_along_a_given_direction_grows_when_the_lines_turn():
    # along the direction, lines turned by phi are D / cos phi apart: mean error D sigma^2 / 2
    found = predict("distance", LINES, axis(5, 0.01), way=(0, 1, 0))
    assert found.bias == pytest.approx(20.0 * 0.01**2 / 2, rel=1e-9)


@pytest.mark.uncompiled
@pytest.mark.parametrize("kind", KINDS)
def test_turns_about_the_optical_axis_and_shifts_across_it_make_no_error(kind):
    for index in (0, 1, 5):
        found = predict(kind, KINDS[kind], axis(index, 0.01))
        assert found.standard_uncertainty == pytest.approx(0.0, abs=1e-9 * found.nominal)
        assert found.bias == pytest.approx(0.0, abs=1e-9 * found.nominal)


@pytest.mark.uncompiled
@pytest.mark.parametrize("kind", KINDS)
def test_sure_without_any_error(kind):
    found = predict(kind, KINDS[kind], STILL)
    assert (found.probability, found.standard_uncertainty, found.bias) == (1.0, 0.0, 0.0)


@pytest.mark.uncompiled
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


@pytest.mark.uncompiled
@pytest.mark.parametrize("points", [8, 16, 50])
def test_localisation_of_lines(points):
    sigma = 0.2 * SQUARE[0] * Z / F
    how = Localisation.gaussian(0.2, points, floor_px=0.0)
    distance = predict("distance", LINES, STILL, how).standard_uncertainty
    assert distance == pytest.approx(sigma * math.sqrt(2 / points), rel=1e-9)
    # centre and foot of the perpendicular are half way along the edge: a centre and the middle of a line
    edge = predict("centre_to_edge", KINDS["centre_to_edge"], STILL, how).standard_uncertainty
    assert edge == pytest.approx(sigma * math.sqrt(3 / points), rel=1e-9)


@pytest.mark.uncompiled
def test_localisation_of_an_angle():
    # slope of a line of N points, at the middles of equal parts of its length l: variance 12 s^2 / (N l^2 (1 - 1/N^2))
    n = 20
    sigma = 0.2 * SQUARE[0] * Z / F
    variance = sum(12 * sigma**2 / (n * one.length**2 * (1 - 1 / n**2)) for one in KINDS["angle"])
    found = predict("angle", KINDS["angle"], STILL, Localisation.gaussian(0.2, n, floor_px=0.0))
    assert found.standard_uncertainty == pytest.approx(math.degrees(math.sqrt(variance)), rel=1e-9)


@pytest.mark.uncompiled
def test_localisation_of_a_length_is_that_of_two_ends():
    sigma = 0.2 * SQUARE[0] * Z / F
    found = predict("length", KINDS["length"], STILL, Localisation.gaussian(0.2, floor_px=0.0))
    assert found.standard_uncertainty == pytest.approx(sigma * math.sqrt(2), rel=1e-9)


@pytest.mark.uncompiled
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


@pytest.mark.uncompiled
def test_pixels_that_are_not_square_of_a_circle():
    # radial variance: sum of cos^2 s_x^2 + sin^2 s_y^2 over N^2
    found = predict(
        "radius", (RIM,), STILL, Localisation.gaussian(0.2, 16, floor_px=0.0), pitch=PITCH
    )
    mean_square = (PITCH[0] ** 2 + PITCH[1] ** 2) / 2
    assert found.standard_uncertainty == pytest.approx(
        0.2 * math.sqrt(mean_square / 16) * Z / F, rel=1e-9
    )


@pytest.mark.uncompiled
def test_fit_averages_over_the_image():
    # circumference of the image 2 pi R f / Z in px, over the correlation length; inscribed polygon of 16: sin(x)/x
    found = predict("radius", (RIM,), STILL, Localisation.fit(0.3, 2.0, 0.0))
    along = 2 * math.pi * 10 * F / Z / SQUARE[0]
    expected = 0.3 * SQUARE[0] * Z / F / math.sqrt(along / 2.0)
    assert found.standard_uncertainty == pytest.approx(expected, rel=0.005)


@pytest.mark.uncompiled
def test_no_fit_is_better_than_its_floor():
    how = Localisation.fit(0.3, 1e-6, 0.02)
    assert predict("radius", (RIM,), STILL, how).standard_uncertainty == pytest.approx(
        0.02 * SQUARE[0] * Z / F
    )
    distance = predict("distance", LINES, STILL, how).standard_uncertainty
    assert distance == pytest.approx(math.sqrt(2) * 0.02 * SQUARE[0] * Z / F)


@pytest.mark.uncompiled
@pytest.mark.parametrize("index", [3, 4])
def test_a_rim_turned_about_its_diameter(index):
    # to first order its points move outward on one side by as much as inward on the other: the radius stays
    small, double = (predict("radius", (RIM,), axis(index, sigma)) for sigma in (0.001, 0.002))
    assert 0 < small.standard_uncertainty < 10.0 * 0.001 / 100
    assert double.standard_uncertainty == pytest.approx(4 * small.standard_uncertainty, rel=1e-9)
    assert double.bias == pytest.approx(4 * small.bias, rel=1e-9)


@pytest.mark.uncompiled
def test_distance_of_lines_at_two_heights():
    # along z only: the line at height h is Z - h away; its offset y is wrong by y t / (Z - h)
    low = Line((-15, -10, 0), (15, -10, 0))
    high = Line((-15, 10, 40), (15, 10, 40))
    found = predict("distance", (low, high), axis(2, 0.003), way=(0, 1, 0))
    assert found.nominal == pytest.approx(20.0)
    assert found.standard_uncertainty == pytest.approx(0.003 * (10 / Z + 10 / (Z - 40)), rel=1e-6)


@pytest.mark.uncompiled
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


@pytest.mark.uncompiled
def test_budget_sums_to_the_total_and_no_part_is_negative():
    rng = np.random.default_rng(3)
    factor = rng.normal(size=(6, 6)) * [[0.1], [0.1], [0.1], [0.003], [0.003], [0.003]]
    correlated = factor @ factor.T
    apart = scipy.linalg.block_diag(correlated[:3, :3], correlated[3:, 3:])
    for kind, shapes in KINDS.items():
        for covariance in (correlated, apart):
            whole = predict(kind, shapes, covariance, Localisation.gaussian(0.3, floor_px=0.0))
            assert math.fsum(whole.budget.values()) == pytest.approx(
                whole.standard_uncertainty**2, rel=1e-12
            )
            assert min(whole.budget.values()) >= 0
        # of independent motions, a half each of what they do as a product
        halves = [np.zeros((6, 6)), np.zeros((6, 6))]
        for half, part in zip(halves, (slice(3), slice(3, 6)), strict=True):
            half[part, part] = apart[part, part]
        alone = [predict(kind, shapes, half).standard_uncertainty ** 2 for half in halves]
        product = (whole.standard_uncertainty**2 - whole.budget["localisation"] - sum(alone)) / 2
        assert whole.budget["translation"] == pytest.approx(alone[0] + product, rel=1e-6, abs=1e-12)


def test_correlated_motions_are_parted_where_one_follows_from_the_other():
    """With a correlation c, √K of K = [[1, c], [c, 1]] holds (√(1+c) ± √(1−c)) / 2."""
    sigmas = np.array([0.1, 0.2, 0.3, 0.001, 0.002, 0.003])
    covariance = np.diag(sigmas**2)
    c = -0.8
    covariance[0, 4] = covariance[4, 0] = c * sigmas[0] * sigmas[4]
    root = uncorrelated_root(covariance)
    np.testing.assert_allclose(root @ root.T, covariance, atol=1e-15)
    near, far = (math.sqrt(1 + c) + sign * math.sqrt(1 - c) for sign in (1, -1))
    np.testing.assert_allclose(root[0, [0, 4]], sigmas[0] / 2 * np.array([near, far]), atol=1e-15)
    # a turn of the axes turns the columns, and leaves each part as large
    turn = scipy.linalg.block_diag(*Rotation.random(2, rng=np.random.default_rng(1)).as_matrix())
    gradient = np.arange(1.0, 7.0)
    parts = np.square(root.T @ gradient).reshape(2, 3).sum(axis=1)
    turned = uncorrelated_root(turn @ covariance @ turn.T)
    again = np.square(turned.T @ turn @ gradient).reshape(2, 3).sum(axis=1)
    np.testing.assert_allclose(again, parts, rtol=1e-9)
    # an exact direction stays exact
    covariance[2, 2] = 0.0
    root = uncorrelated_root(covariance)
    np.testing.assert_allclose(root @ root.T, covariance, atol=1e-15)


@pytest.mark.uncompiled
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


# What dimensions, their entities and the ways to find these refuse, and what they say of
# themselves.


LOW = Line((-15, -10, 0), (15, -10, 0))
HIGH = Line((-15, 10, 0), (15, 10, 0))
LEFT = Circle((-10, 0, 0), (0, 0, 1), 4.0)
RIGHT = Circle((10, 0, 0), (0, 0, 1), 6.0)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: Localisation("guess", 0.1), r"must be one of .*Got 'guess'"),
        (
            lambda: Localisation("gaussian", -0.1),
            r"sigma_px must be finite and not negative\. Got -0\.1",
        ),
        (
            lambda: Localisation("gaussian", True),
            r"sigma_px must be finite and not negative\. Got True",
        ),
        (lambda: Localisation("fit", 0.1), r"correlation_px must be positive\. Got 0"),
        (
            lambda: Localisation("gaussian", 0.1, points=2),
            r"points must be an integer of at least 3\. Got 2",
        ),
        (lambda: Localisation("gaussian", 0.1, points=3.0), r"at least 3\. Got 3\.0"),
        (
            lambda: Line((1, 2, 3), (1, 2, 3)),
            r"two different ends\. Got \[1\.0, 2\.0, 3\.0\] twice",
        ),
        (lambda: Line((1, 2), (1, 2, 3)), r"p must be three finite numbers\. Got \(1, 2\)"),
        (
            lambda: Circle((0, 0, 0), (0, 0, 0), 1.0),
            r"axis must have a length\. Got \[0\.0, 0\.0, 0\.0\]",
        ),
        (
            lambda: Circle((0, 0, 0), (0, 0, 1), math.inf),
            r"radius_mm must be positive\. Got inf",
        ),
        (
            lambda: Circle((0, 0, 0), (0, 0, 1), 1.0, (1, 0, 0), 7.0),
            r"span_rad must be in \(0, 2 pi\]\. Got 7\.0",
        ),
        (
            lambda: Circle((0, 0, 0), (0, 0, 1), 1.0, (0, 0, -3), 1.0),
            r"start must not run along the axis\. Got \[0",
        ),
    ],
)
def test_numbers_out_of_range_are_refused(call, message):
    with pytest.raises(InvalidParameterError, match=message):
        call()


@pytest.mark.parametrize(
    ("kind", "entities", "direction", "message"),
    [
        ("distance", (LOW, Line((0, 10, 0), (0, 20, 0))), None, r"must be parallel\. Got 90 degrees"),
        ("distance", (LOW, Line((20, -10, 0), (30, -10, 0))), None, r"must lie apart\. Got one line"),
        ("distance", (LOW, HIGH), (1, 0, 0), r"must not run along the edges of a distance\. Got one that"),
        ("distance", (LOW, HIGH), (0, 0, 1), r"must lie apart along its direction\. Got 0 mm"),
        ("centre_distance", (LEFT, RIGHT), (0, 0, 1), r"must not run along the rims' axis\. Got one that does"),
        ("centre_distance", (LEFT, RIGHT), (0, 1, 0), r"must lie apart\. Got two on one axis"),
    ],
)  # fmt: skip
def test_directions_that_measure_nothing_are_refused(kind, entities, direction, message):
    with pytest.raises(MeasurandError, match=message):
        measurand(kind, entities, direction)


def test_a_distance_of_centres_along_a_direction_is_its_share():
    """20 mm apart along x; along a direction at 60 degrees, half of that, whichever way it points and however long."""
    for sign in (1.0, -3.0):
        way = sign * np.array([0.5, math.sqrt(0.75), 0.0])
        assert measurand("centre_distance", (LEFT, RIGHT), way).nominal == pytest.approx(10.0)
    # what lies along the rims' axis does not count
    assert measurand("centre_distance", (LEFT, RIGHT), (1.0, 0.0, 5.0)).nominal == pytest.approx(
        20.0
    )


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"pose_covariance": np.zeros((2, 6, 6))}, InvalidShapeError, r"shape \(6, 6\)\. Got shape \(2, 6, 6\)"),
        ({"permitted_error": 20.0}, InvalidParameterError, r"smaller than the nominal value 20\. Got 20\.0"),
    ],
)  # fmt: skip
def test_a_model_is_checked_once(changes, error, message):
    given = {
        "image_distance_mm": F,
        "pixel_pitch_mm": PITCH,
        "pose_covariance": isotropic(0.01, 0.001),
        "localisation": Localisation.gaussian(0.1, floor_px=0.0),
        "permitted_error": 0.05,
    }
    with pytest.raises(error, match=message):
        MeasurandModel(measurand("distance", (LOW, HIGH)), **{**given, **changes})
    with pytest.raises(
        InvalidShapeError, match=r"world_to_camera must have shape \(n, 4, 4\)\. Got \(4, 4\)"
    ):
        MeasurandModel(measurand("distance", (LOW, HIGH)), **given).probability(np.eye(4))


@pytest.mark.parametrize("one", [LOW, LEFT, Circle((1, 2, 3), (0, 1, 0), 5.0, (1, 0, 0), 2.0)])
def test_lines_and_circles_come_back_from_plain_values(one):
    again = from_plain(type(one), to_plain(one), InvalidParameterError)
    assert type(again) is type(one)
    for name, value in vars(one).items():
        assert np.array_equal(getattr(again, name), value)


@pytest.mark.parametrize(
    ("localisation", "words"),
    [
        (Localisation.rounding(), "rounding to whole pixels"),
        (Localisation.gaussian(0.25, floor_px=0.0), "gaussian, 0.25 px per point"),
        (Localisation.gaussian(0.25), "gaussian, 0.25 px per point, 0.05 px per entity"),
        (
            Localisation("fit", 0.5, correlation_px=4.0, floor_px=0.02),
            "fit, 0.5 px per 4 px of image, 0.02 px at best",
        ),
    ],
)
def test_a_report_says_how_points_are_found(localisation, words):
    assert str(localisation) == words
    assert from_plain(Localisation, to_plain(localisation), InvalidParameterError) == localisation


# Decisions by a measured value: known answers of JCGM 106 and ISO 14253-1.


ISO = DecisionRule.iso14253()
WIDE = (-1.0, 1.0)


def test_probability_half_at_a_limit():
    """At a limit that is far from the other one, half of the true values are beyond it."""
    assert conformance_probability(1.0, 0.01, WIDE) == pytest.approx(0.5, abs=1e-12)


def test_probability_of_jcgm_106_one_sided():
    """JCGM 106:2012, 7.3: one standard uncertainty inside one limit, the probability is 0.8413."""
    assert conformance_probability(0.9, 0.1, (-math.inf, 1.0)) == pytest.approx(0.841345, abs=1e-6)


def test_probability_with_a_tolerance_of_four_u():
    """T = 4 u and the value in the middle: within two standard deviations, 0.9545."""
    assert conformance_probability(0.0, 0.5, WIDE) == pytest.approx(0.954500, abs=1e-6)


@pytest.mark.parametrize("in_u", [-40.0, -9.0, -3.0, -0.5, 0.0, 0.5, 3.0, 9.0])
def test_probability_with_one_limit_is_that_of_one_tail(in_u):
    """The normal distribution's tail beyond the limit; far tails keep their digits."""
    wanted = math.erfc(-in_u / math.sqrt(2)) / 2
    upper = conformance_probability(0.1 - in_u * 0.01, 0.01, (-math.inf, 0.1))
    lower = conformance_probability(-0.1 + in_u * 0.01, 0.01, (-0.1, math.inf))
    assert upper == pytest.approx(wanted, rel=1e-9, abs=0)
    assert lower == pytest.approx(wanted, rel=1e-9, abs=0)


@pytest.mark.parametrize("side", [-1, 1])
def test_decisions_with_one_limit(side):
    """The side without a limit never decides; 1.645 u is the 95 % point of the normal distribution."""
    tolerance = (-math.inf, 0.1) if side > 0 else (-0.1, math.inf)
    rule = DecisionRule.iso14253()
    for deviation, decision in (
        (-1e6, Decision.CONFORMS),
        (0.1 - 0.0165, Decision.CONFORMS),
        (0.1 - 0.0164, Decision.UNDECIDED),
        (0.1 + 0.0164, Decision.UNDECIDED),
        (0.1 + 0.0165, Decision.DOES_NOT_CONFORM),
    ):
        assert decide(side * deviation, 0.01, tolerance, rule) is decision
    for rule in (DecisionRule.simple(), DecisionRule.guard()):
        assert decide(side * -1e6, 0.01, tolerance, rule) is Decision.CONFORMS
        assert decide(side * 0.2, 0.01, tolerance, rule) is Decision.DOES_NOT_CONFORM


def test_a_value_without_error():
    assert conformance_probability(1.0, 0.0, WIDE) == 1.0
    assert conformance_probability(1.0 + 1e-12, 0.0, WIDE) == 0.0


@pytest.mark.parametrize("side", [-1, 1])
def test_guard_band_of_iso_is_1645_thousandths_of_u(side):
    """Of a wide tolerance each limit has one side: the 95 % quantile of the normal distribution."""
    u = 0.1
    inside = side * (1.0 - 1.6449 * u)
    outside = side * (1.0 + 1.6449 * u)
    assert decide(inside, u, WIDE, ISO) is Decision.CONFORMS
    assert decide(inside + side * 2e-5, u, WIDE, ISO) is Decision.UNDECIDED
    assert decide(outside, u, WIDE, ISO) is Decision.DOES_NOT_CONFORM
    assert decide(outside - side * 2e-5, u, WIDE, ISO) is Decision.UNDECIDED


def test_a_narrow_tolerance_cannot_be_proven():
    """T = 3.9 u: even in the middle less than 95 % lie inside; of 4 u more do."""
    assert decide(0.0, 2 / 3.9, WIDE, ISO) is Decision.UNDECIDED
    assert decide(0.0, 2 / 4.0, WIDE, ISO) is Decision.CONFORMS


def test_other_rules():
    assert decide(0.99, 0.1, WIDE, DecisionRule.simple()) is Decision.CONFORMS
    assert decide(1.01, 0.1, WIDE, DecisionRule.simple()) is Decision.DOES_NOT_CONFORM
    guard = DecisionRule.guard()
    assert decide(0.79, 0.1, WIDE, guard) is Decision.CONFORMS
    assert decide(0.81, 0.1, WIDE, guard) is Decision.UNDECIDED
    assert decide(1.21, 0.1, WIDE, guard) is Decision.DOES_NOT_CONFORM
    assert decide(0.0, 0.1, None, guard) is Decision.NO_TOLERANCE


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: DecisionRule("best"), "rule must be one of iso14253-1, simple, guard U"),
        (lambda: DecisionRule.iso14253(0.5), "level must be above 0.5. Got 0.5"),
        (lambda: DecisionRule.iso14253(1.0), r"level must be in \(0, 1\)"),
        (lambda: conformance_probability(0, -1, WIDE), "standard_uncertainty must not be negative"),
    ],
)
def test_refusals(make, message):
    with pytest.raises(ValueError, match=message):
        make()


# The floor of localisation and surfaces that are off: answers in closed form, and against exact
# measurements.


S = 0.05
FLOOR = Localisation.gaussian(0.0, floor_px=S)
STEP = S * SQUARE[0] * Z / F
"""The floor in the plane Z away, mm."""


@pytest.mark.uncompiled
@pytest.mark.parametrize(
    ("kind", "expected"),
    [
        ("diameter", 2 * STEP),
        ("radius", STEP),
        ("distance", math.sqrt(2) * STEP),
        ("length", math.sqrt(2) * STEP),
        # the centre of a rim that grows stays where it is; the line is shifted
        ("centre_distance", 0.0),
        ("centre_to_edge", STEP),
        ("angle", 0.0),
    ],
)
def test_floor_square_on(kind, expected):
    found = predict(kind, KINDS[kind], STILL, FLOOR)
    assert found.standard_uncertainty == pytest.approx(expected, rel=1e-9, abs=1e-12)
    assert found.budget["localisation_floor"] == pytest.approx(expected**2, rel=1e-9, abs=1e-20)
    assert found.budget["localisation"] == found.budget["surfaces"] == 0.0


@pytest.mark.uncompiled
def test_no_number_of_points_averages_the_floor_out():
    for points in (4, 16, 400):
        how = Localisation.gaussian(0.2, points, floor_px=S)
        found = predict("diameter", KINDS["diameter"], STILL, how)
        random = 2 * 0.2 * SQUARE[0] * Z / F / math.sqrt(points)
        assert found.standard_uncertainty == pytest.approx(math.hypot(random, 2 * STEP), rel=1e-9)


@pytest.mark.uncompiled
def test_the_radius_of_a_short_arc_grows_by_the_floor_as_that_of_a_rim():
    # all of its points move outward about the same centre, so the fit is leveraged by nothing
    arc = Circle((0, 0, 0), (0, 0, 1), 10.0, (1, 0, 0), 2.0)
    found = predict("radius", (arc,), STILL, FLOOR)
    assert math.sqrt(found.budget["localisation_floor"]) == pytest.approx(STEP, rel=1e-9)


@pytest.mark.uncompiled
def test_floor_of_pixels_that_are_not_square():
    # lines along x are shifted across it, by pixels of the pitch along y; and the other way round
    for order, pitch in (([0, 1, 2], PITCH[1]), ([1, 0, 2], PITCH[0])):
        lines = tuple(Line(one.p[order], one.q[order]) for one in KINDS["distance"])
        found = predict("distance", lines, STILL, FLOOR, pitch=PITCH)
        assert found.standard_uncertainty == pytest.approx(
            math.sqrt(2) * S * pitch * Z / F, rel=1e-9
        )


@pytest.mark.uncompiled
def test_a_probability_counts_the_floor_as_a_normal_error():
    found = predict("diameter", KINDS["diameter"], STILL, FLOOR, permitted=1.3 * 2 * STEP)
    assert found.probability == pytest.approx(math.erf(1.3 / math.sqrt(2)), abs=2e-5)


@pytest.mark.uncompiled
@pytest.mark.parametrize("across", [(0.0, 0.0), (40.0, -25.0)])
@pytest.mark.parametrize(("kind", "size"), [("diameter", 20.0), ("radius", 10.0)])
def test_a_face_that_is_off_scales_its_circle(across, kind, size):
    # between parallel planes the projection is a homothety of 1 + delta / Z, on the axis and off it
    rim = (Circle((*across, 0), (0, 0, 1), 10.0),)
    found = predict(kind, rim, STILL, surfaces=0.02)
    assert found.standard_uncertainty == pytest.approx(0.02 * size / Z, rel=1e-9)
    assert found.budget["surfaces"] == pytest.approx((0.02 * size / Z) ** 2, rel=1e-9)


@pytest.mark.uncompiled
def test_seen_at_a_slant_the_plane_s_distance_counts():
    pose = look_at(np.array([120.0, -50, 260]), [3.0, 4, 0], 0.3)
    found = predict("diameter", KINDS["diameter"], STILL, pose=pose, surfaces=0.02)
    assert found.standard_uncertainty == pytest.approx(0.02 * 20 / 260, rel=1e-9)


@pytest.mark.uncompiled
def test_entities_of_one_face_share_its_deviation_and_others_do_not():
    lines = Line((-15, 10, 0), (15, 10, 0)), Line((-15, 30, 0), (15, 30, 0))
    one = predict("distance", lines, STILL, surfaces=0.02, way=(0, 1, 0))
    assert one.standard_uncertainty == pytest.approx(0.02 * 20 / Z, rel=1e-9)
    raised = lines[0], Line((-15, 30, 40), (15, 30, 40))
    two = predict("distance", raised, STILL, surfaces=0.02, way=(0, 1, 0))
    # each line moves by its own y delta / height, away from the foot of the axis
    expected = 0.02 * math.hypot(10 / Z, 30 / (Z - 40))
    assert two.standard_uncertainty == pytest.approx(expected, rel=1e-9)


@pytest.mark.uncompiled
def test_surfaces_of_the_other_kinds_square_on():
    found = {
        kind: predict(kind, KINDS[kind], STILL, surfaces=0.02).standard_uncertainty
        for kind in ("centre_distance", "centre_to_edge", "angle", "length")
    }
    # homothety again: distances in one face grow by delta / Z, angles stay
    assert found["centre_distance"] == pytest.approx(0.02 * 20 / Z, rel=1e-9)
    assert found["centre_to_edge"] == pytest.approx(0.02 * 20 / Z, rel=1e-9)
    assert found["angle"] == pytest.approx(0.0, abs=1e-12)
    # an edge in the middle of the image: only its depth counts
    assert found["length"] == pytest.approx(0.02 * 20 / Z, rel=1e-9)


@pytest.mark.uncompiled
@pytest.mark.parametrize("name", sorted(EXAMPLES))
def test_derivatives_against_exact_measurements(name):
    """One standard deviation of each common error alone, measured by another program from slanted views."""
    kind, plain, direction = EXAMPLES[name]
    value = measurand(kind, geometry_of(plain), direction)
    rng = np.random.default_rng(5)
    still = np.zeros((1, 6))
    surface, _ = value.surfaces
    for _ in range(6):
        pose = random_view(rng)
        for how, off in ((FLOOR, 0.0), (EXACT, 0.02)):
            found = MeasurandModel(
                value,
                image_distance_mm=F,
                pixel_pitch_mm=PITCH,
                pose_covariance=STILL,
                localisation=how,
                permitted_error=0.01,
                surfaces_mm=off,
            ).describe(pose)
            square = 0.0
            for common in _each(kind, len(plain), surface, off):
                two = [
                    measure(
                        kind, plain, pose, still, f=F, direction=direction, pitch=PITCH,
                        common={part: sign * one for part, one in common.items()},
                    )[0]
                    for sign in (1, -1)
                ]  # fmt: skip
                square += ((two[0] - two[1]) / 2) ** 2
            assert found.standard_uncertainty == pytest.approx(
                math.sqrt(square), rel=2e-3, abs=1e-7
            )


def _each(kind, n, surface, off):
    """The independent common errors, one after the other, one standard deviation each."""
    if kind == "length":
        return [{"places": off * way} for way in np.eye(2)] if off else [
            {"ends_px": S * way} for way in np.eye(2)
        ]  # fmt: skip
    if not off:
        return [{"floor_px": S * way} for way in np.eye(n)]
    return [{"surfaces_mm": off * (np.asarray(surface) == one)} for one in dict.fromkeys(surface)]


@pytest.mark.uncompiled
def test_simulated_errors_stay_within_what_is_stated():
    """2u holds 95 % of exact measurements that have all errors at once, drawn independently."""
    rng = np.random.default_rng(11)
    covariance = isotropic(0.02, 0.0003)
    n = 4000
    moves = rng.multivariate_normal(np.zeros(6), covariance, n)
    for name in ("diameter", "distance", "centre_to_edge"):
        kind, plain, direction = EXAMPLES[name]
        value = measurand(kind, geometry_of(plain), direction)
        pose = random_view(rng)
        how = Localisation.gaussian(0.1, floor_px=S)
        told = MeasurandModel(
            value,
            image_distance_mm=F,
            pixel_pitch_mm=PITCH,
            pose_covariance=covariance,
            localisation=how,
            permitted_error=1.0,
            surfaces_mm=0.05,
        ).describe(pose)
        surface, _ = value.surfaces
        common = {
            "floor_px": rng.normal(0, S, (n, len(plain))),
            "surfaces_mm": rng.normal(0, 0.05, (n, len(plain)))[:, surface],
        }
        sigma = tuple(0.1 * pitch for pitch in PITCH)
        error = measure(
            kind, plain, pose, moves, f=F, sigma_mm=sigma, rng=rng, direction=direction,
            pitch=PITCH, common=common,
        )  # fmt: skip
        assert told.standard_uncertainty == pytest.approx(error.std(), rel=0.04)
        held = np.mean(np.abs(error) <= told.expanded_uncertainty)
        assert held == pytest.approx(math.erf(math.sqrt(2)), abs=0.012)


@pytest.mark.uncompiled
@pytest.mark.parametrize("wrong", [-0.01, math.nan, "much"])
def test_surfaces_are_checked(wrong):
    with pytest.raises(InvalidParameterError, match="surfaces_mm must"):
        predict("diameter", KINDS["diameter"], STILL, surfaces=wrong)


@pytest.mark.uncompiled
def test_whole_pixels_have_no_floor():
    with pytest.raises(InvalidParameterError, match=r"floor_px must be 0 with rounding\. Got 0\.1"):
        Localisation("rounding", 0.3, floor_px=0.1)


@pytest.mark.uncompiled
def test_surfaces_are_found_from_planes():
    assert OVERHEAD[2, 3] == Z
    level = measurand("distance", KINDS["distance"], (0, 1, 0))
    assert level.surfaces[0].tolist() == [0, 0]
    raised = Line((-15, -10, 0), (15, -10, 0)), Line((-15, 10, 5), (15, 10, 5))
    index, normals = measurand("distance", raised, (0, 1, 0)).surfaces
    assert index.tolist() == [0, 1]
    assert np.abs(normals[:, 2]).tolist() == [1.0, 1.0]
