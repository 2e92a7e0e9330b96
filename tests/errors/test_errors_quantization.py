import itertools

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import chisquare

from errors import AxisQuantization, SegmentQuantization

PITCH = (0.01, 0.013)
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
