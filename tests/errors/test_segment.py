"""Tests of `segment`."""

import itertools

import numpy as np
import pytest
from edge_examples import CAMERA, EDGE, PAPER_COVARIANCE, PITCH, F, random_covariance, random_edges
from scipy.integrate import quad, trapezoid
from scipy.stats import chisquare

from errors import (
    AxisDisplacement,
    AxisQuantization,
    SegmentDisplacement,
    SegmentError,
    SegmentQuantization,
    image_segment,
    point_displacement,
    success_probability,
)

ANGLES = np.radians([0.0, 1e-6, 0.5, 20.0, 40.0, 50.0, 89.99, 90.0, 135.0, 180.0, 270.0])


def mixture_cdf(error, angle):
    """Independent route: the average of the wider triangular law over the narrower one, by quadrature."""
    wide, narrow = sorted(
        [PITCH[0] * abs(np.cos(angle)), PITCH[1] * abs(np.sin(angle))], reverse=True
    )
    law = AxisQuantization(wide)
    if narrow < 1e-12:
        return float(law.cdf(error))
    knots = sorted(
        {float(np.clip((x - error) / narrow, -1.0, 1.0)) for x in (-wide, 0.0, wide)}
        | {-1.0, 0.0, 1.0}
    )
    pieces = [
        quad(lambda y: (1.0 - abs(y)) * law.cdf(error + narrow * y), a, b, epsabs=1e-13)[0]
        for a, b in itertools.pairwise(knots)
    ]
    return sum(pieces)


def test_triangular_by_hand():
    law = AxisQuantization(0.01)
    np.testing.assert_allclose(law.pdf([-0.02, -0.005, 0.0, 0.0075]), [0.0, 50.0, 100.0, 25.0])
    np.testing.assert_allclose(
        law.cdf([-1.0, -0.005, 0.0, 0.005, 1.0]), [0.0, 0.125, 0.5, 0.875, 1.0]
    )


@pytest.mark.parametrize("angle", ANGLES)
def test_cdf_against_quadrature(angle):
    law = SegmentQuantization(angle, PITCH)
    for error in np.linspace(-0.018, 0.018, 25):
        assert law.cdf(error) == pytest.approx(mixture_cdf(error, angle), abs=1e-9)


@pytest.mark.parametrize("angle", ANGLES)
def test_pdf_is_the_derivative_of_the_cdf(angle):
    law = SegmentQuantization(angle, PITCH)
    step = 1e-7
    # Points off the kinks at 0 and at sums of the widths.
    errors = np.linspace(-0.0173, 0.0171, 40)
    slope = (law.cdf(errors + step) - law.cdf(errors - step)) / (2.0 * step)
    np.testing.assert_allclose(law.pdf(errors), slope, atol=2e-3)


@pytest.mark.parametrize("angle", ANGLES)
def test_pdf_integrates_to_one_with_the_stated_std(angle):
    law = SegmentQuantization(angle, PITCH)
    knots = sorted(
        {s * w + t * v for w, v in [law.widths_mm] for s in (-1, 0, 1) for t in (-1, 0, 1)}
    )
    pieces = list(itertools.pairwise(knots))
    assert sum(quad(law.pdf, a, b)[0] for a, b in pieces) == pytest.approx(1.0, abs=1e-9)
    variance = sum(quad(lambda x: x * x * law.pdf(x), a, b)[0] for a, b in pieces)
    assert np.sqrt(variance) == pytest.approx(float(law.std), rel=1e-6)


@pytest.mark.parametrize("angle", np.radians([20.0, 40.0, 50.0]))
def test_at_its_knots_the_law_is_that_of_its_neighbours(angle):
    """Density and probability are continuous, and exactly at a knot the pieces must not be mixed up."""
    law = SegmentQuantization(angle, PITCH)
    widths = [float(width) for width in law.widths_mm]
    for knot in (min(widths), -min(widths), max(widths), sum(widths), -sum(widths), 0.0):
        for value in (law.pdf, law.cdf):
            beside = value([knot - 1e-12, knot + 1e-12])
            assert value(knot) == pytest.approx(beside.mean(), abs=1e-6)


@pytest.mark.parametrize("angle", np.radians([0.0, 40.0, 50.0, 90.0]))
def test_a_million_samples_fit(angle):
    law = SegmentQuantization(angle, PITCH)
    sample = law.sample(1_000_000, rng=3)
    edges = np.linspace(-0.95, 0.95, 41) * sum(law.widths_mm)
    expected = np.diff(np.concatenate([[0.0], law.cdf(edges), [1.0]])) * len(sample)
    observed = np.histogram(sample, np.concatenate([[-np.inf], edges, [np.inf]]))[0]
    assert (
        chisquare(observed[expected > 10], expected[expected > 10], sum_check=False).pvalue > 1e-3
    )


def test_axis_samples_fit():
    law = AxisQuantization(0.01)
    edges = np.linspace(-0.01, 0.01, 31)
    observed = np.histogram(law.sample(1_000_000, rng=5), edges)[0]
    assert chisquare(observed, np.diff(law.cdf(edges)) * 1_000_000).pvalue > 1e-3


@pytest.mark.parametrize("angle", [0.0, np.pi / 2])
def test_along_an_axis_it_is_the_triangular_law(angle):
    errors = np.linspace(-0.015, 0.015, 31)
    pitch = PITCH[0] if angle == 0.0 else PITCH[1]
    law = SegmentQuantization(angle, PITCH)
    axis = AxisQuantization(pitch)
    np.testing.assert_allclose(law.pdf(errors), axis.pdf(errors), atol=1e-9)
    np.testing.assert_allclose(law.cdf(errors), axis.cdf(errors), atol=1e-12)


def test_angles_and_errors_broadcast():
    law = SegmentQuantization(ANGLES[:, None], PITCH)
    errors = np.linspace(-0.01, 0.01, 7)
    assert law.pdf(errors).shape == law.cdf(errors).shape == (len(ANGLES), 7)
    assert SegmentQuantization(ANGLES, PITCH).sample(5).shape == (5, len(ANGLES))
    single = SegmentQuantization(ANGLES[4], PITCH)
    np.testing.assert_array_equal(law.cdf(errors)[4], single.cdf(errors))


def test_characteristic_function_is_the_fourier_transform():
    law = SegmentQuantization(np.radians(40.0), PITCH)
    for t in (0.0, 100.0, 700.0):
        value = quad(lambda x, t=t: law.pdf(x) * np.cos(t * x), -0.017, 0.017, limit=200)[0]
        assert float(law.characteristic(t)) == pytest.approx(value, abs=1e-8)


POSE = {"focal_length_mm": F, "pose_covariance": PAPER_COVARIANCE}


def fits(law, sample):
    edges = np.linspace(-4, 4, 41) * float(law.std)
    expected = np.diff(np.concatenate([[0.0], law.cdf(edges), [1.0]])) * len(sample)
    observed = np.histogram(sample, np.concatenate([[-np.inf], edges, [np.inf]]))[0]
    return chisquare(observed, expected, sum_check=False).pvalue > 1e-3


@pytest.mark.parametrize(("axis", "index"), [("u", 0), ("v", 1)])
def test_eqs_12_and_13_are_the_correlation_integral_of_eq_11(axis, index):
    first, second = (point_displacement(end, **POSE)[index] for end in EDGE)
    law = AxisDisplacement(EDGE, axis, **POSE)
    reach = 8.0 * float(first.std)
    for error in np.array([-2.0, -0.5, 0.0, 1.0, 2.5]) * float(law.std):
        value = quad(
            lambda x, e=error: second.pdf(x + e) * first.pdf(x),
            -reach,
            reach,
            points=[0.0],
            limit=200,
        )[0]
        assert float(law.pdf(error)) == pytest.approx(value, rel=1e-5)


def test_eq_14_is_the_convolution_of_the_axes():
    law = SegmentDisplacement(EDGE, **POSE)
    angle = float(image_segment(EDGE, focal_length_mm=F)[1])
    u = AxisDisplacement(EDGE, "u", **POSE)
    v = AxisDisplacement(EDGE, "v", **POSE)
    x = np.linspace(-10.0, 10.0, 4001) * float(u.std)
    for error in (-1.0, 0.0, 2.0):
        # Average over the horizontal error of the density of what the vertical one must then contribute.
        value = trapezoid(u.pdf(x) * v.pdf((error - x * np.cos(angle)) / np.sin(angle)), x) / abs(
            np.sin(angle)
        )
        assert float(law.pdf(error)) == pytest.approx(value, rel=1e-4)


def test_eq_15_is_the_convolution_with_quantization():
    small = np.diag([1e-4] * 3 + [1e-9] * 3)
    law = SegmentError(EDGE, **CAMERA, pose_covariance=small)
    displacement = SegmentDisplacement(EDGE, focal_length_mm=F, pose_covariance=small)
    quantization = SegmentQuantization(image_segment(EDGE, focal_length_mm=F)[1], PITCH)
    q = np.linspace(-0.02, 0.02, 8001)
    for error in (-0.01, 0.0, 0.004, 0.02):
        density = trapezoid(quantization.pdf(q) * displacement.pdf(error - q), q)
        below = trapezoid(quantization.pdf(q) * displacement.cdf(error - q), q)
        assert float(law.pdf(error)) == pytest.approx(density, rel=1e-4, abs=1e-6)
        assert float(law.cdf(error)) == pytest.approx(below, abs=1e-5)


def test_a_million_samples_of_displacements_fit():
    for law, seed in (
        (SegmentDisplacement(EDGE, **POSE), 1),
        (SegmentError(EDGE, **CAMERA, pose_covariance=PAPER_COVARIANCE), 2),
    ):
        assert fits(law, law.sample(1_000_000, rng=seed))
    axis = AxisDisplacement(EDGE, "u", **POSE)
    assert fits(axis, axis.sample(1_000_000, rng=3))


def test_cdf_is_the_integral_of_the_pdf():
    law = SegmentError(EDGE, **CAMERA, pose_covariance=PAPER_COVARIANCE)
    step = 1e-4
    errors = np.linspace(-5, 5, 21)
    np.testing.assert_allclose(
        (law.cdf(errors + step) - law.cdf(errors - step)) / (2 * step), law.pdf(errors), atol=1e-6
    )
    np.testing.assert_array_equal(law.cdf([-1e3, 1e3]), [0.0, 1.0])
    np.testing.assert_array_equal(law.pdf([-1e3, 1e3]), [0.0, 0.0])


def test_only_quantization_left_without_displacement():
    law = SegmentError(EDGE, **CAMERA, pose_covariance=np.zeros((6, 6)))
    errors = np.linspace(-0.015, 0.015, 31)
    np.testing.assert_allclose(law.cdf(errors), law.quantization.cdf(errors), atol=2e-5)
    still = SegmentDisplacement(EDGE, focal_length_mm=F, pose_covariance=np.zeros((6, 6)))
    np.testing.assert_array_equal(still.cdf([-1e-9, 0.0, 1e-9]), [0.0, 1.0, 1.0])
    np.testing.assert_array_equal(still.pdf([-1e-9, 0.0]), [0.0, np.inf])


def test_independent_probability_is_the_frequency_of_its_own_samples():
    rng = np.random.default_rng(4)
    for edge in random_edges(3, rng):
        covariance = random_covariance(rng, 0.001)
        law = SegmentError(edge, **CAMERA, pose_covariance=covariance)
        tolerance = 0.02 * image_segment(edge, focal_length_mm=F)[0]
        frequency = (np.abs(law.sample(1_000_000, rng)) <= tolerance).mean()
        p = success_probability(
            edge, **CAMERA, pose_covariance=covariance, accuracy=0.98, model="independent"
        )
        assert p == pytest.approx(frequency, abs=0.002)


def test_independence_overstates_the_error():
    # The design's finding: eq 12 makes a fairly certain measurement look hopeless.
    call = {**CAMERA, "pose_covariance": PAPER_COVARIANCE, "accuracy": 0.98}
    assert success_probability(EDGE, **call, model="independent") < 0.1
    assert success_probability(EDGE, **call, model="montecarlo") > 0.9


def test_batches_agree_with_single_edges():
    edges = random_edges(6, np.random.default_rng(8)).reshape(2, 3, 2, 3)
    call = {**CAMERA, "pose_covariance": PAPER_COVARIANCE, "accuracy": 0.98, "model": "independent"}
    whole = success_probability(edges, **call)
    np.testing.assert_allclose(whole[1, 2], success_probability(edges[1, 2], **call), atol=1e-7)
    assert whole.shape == (2, 3)
