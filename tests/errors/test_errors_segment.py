import numpy as np
import pytest
from edge_examples import CAMERA, EDGE, PAPER_COVARIANCE, PITCH, F, random_covariance, random_edges
from scipy.integrate import quad, trapezoid
from scipy.stats import chisquare

from errors import (
    AxisDisplacement,
    SegmentDisplacement,
    SegmentError,
    SegmentQuantization,
    image_segment,
    point_displacement,
    success_probability,
)

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


def test_a_million_samples_fit():
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
