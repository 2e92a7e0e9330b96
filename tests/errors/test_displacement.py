"""Tests of `displacement`."""

import itertools

import numpy as np
import pytest
from edge_examples import F, random_covariance
from scipy.integrate import quad
from scipy.spatial.transform import Rotation
from scipy.special import erf
from scipy.stats import chisquare, multivariate_normal, norm

from errors import (
    NormalRatio,
    displace,
    displacement_terms,
    image_segment,
    point_displacement,
    project,
)

POINTS = np.array(
    [[10.0, -20.0, -200.0], [-35.0, 4.0, -80.0], [0.0, 0.0, -300.0], [60.0, 45.0, -500.0]]
)


def test_projection_by_hand():
    np.testing.assert_allclose(project([20.0, -10.0, -75.0], focal_length_mm=25.0), [5.0, -2.5])
    length, angle = image_segment([[0.0, 0.0, -75.0], [12.0, 16.0, -75.0]], focal_length_mm=25.0)
    assert (length, angle) == pytest.approx((5.0, np.arctan2(4.0, 3.0)))


def test_displace_is_the_exact_rotation():
    delta = np.array([1.0, -2.0, 3.0, 0.3, -0.5, 0.8])
    expected = Rotation.from_rotvec(delta[3:]).apply(POINTS) + delta[:3]
    np.testing.assert_allclose(displace(POINTS, delta), expected, atol=1e-12)
    np.testing.assert_array_equal(displace(POINTS, np.zeros(6)), POINTS)


def test_terms_are_exact_for_the_small_angle_displacement():
    rng = np.random.default_rng(0)
    n_u, n_v, d_mean, d = displacement_terms(POINTS, focal_length_mm=F)
    for _ in range(20):
        delta = rng.normal(size=6) * [0.5, 0.5, 0.5, 0.05, 0.05, 0.05]
        moved = POINTS + np.cross(delta[3:], POINTS) + delta[:3]
        shift = project(moved, focal_length_mm=F) - project(POINTS, focal_length_mm=F)
        np.testing.assert_allclose(n_u @ delta / (d_mean + d @ delta), shift[:, 0], atol=1e-12)
        np.testing.assert_allclose(n_v @ delta / (d_mean + d @ delta), shift[:, 1], atol=1e-12)


def test_terms_against_finite_differences_of_the_exact_rotation():
    n_u, n_v, d_mean, d = displacement_terms(POINTS, focal_length_mm=F)
    step = 1e-5
    for k in range(6):
        delta = np.zeros(6)
        delta[k] = step
        plus, minus = (project(displace(POINTS, s * delta), focal_length_mm=F) for s in (1, -1))
        slope = (plus - minus) / (2 * step)
        np.testing.assert_allclose(n_u[:, k] / d_mean, slope[:, 0], atol=1e-7)
        np.testing.assert_allclose(n_v[:, k] / d_mean, slope[:, 1], atol=1e-7)
        # D / (f - C3) is the depth after the displacement, which the translation and the rotation change linearly.
        depth = [F - displace(POINTS, s * delta)[:, 2] for s in (1, -1)]
        np.testing.assert_allclose(
            d[:, k] / (F - POINTS[:, 2]), (depth[0] - depth[1]) / (2 * step), atol=1e-7
        )


def test_numerator_u_is_the_papers():
    c1, c2, c3 = POINTS.T
    phi_x = 0.01
    phi_y = -0.02
    phi_z = 0.03
    dx = 0.4
    dz = -0.5
    paper = F * (
        c1 * c2 * phi_x
        + ((F - c3) * c3 - c1**2) * phi_y
        - c2 * (F - c3) * phi_z
        + (F - c3) * dx
        + c1 * dz
    )
    terms = displacement_terms(POINTS, focal_length_mm=F)
    delta = np.array([dx, 0.7, dz, phi_x, phi_y, phi_z])
    np.testing.assert_allclose(terms.n_u @ delta, paper)
    np.testing.assert_allclose(
        terms.d_mean + terms.d @ delta, (F - c3) * ((F - c3) - c2 * phi_x + c1 * phi_y - dz)
    )


@pytest.mark.parametrize("axis", [0, 1])
def test_law_of_the_displacement_fits_a_million_poses(axis):
    rng = np.random.default_rng(7)
    covariance = random_covariance(rng, 0.02)
    law = point_displacement(POINTS[0], focal_length_mm=F, pose_covariance=covariance)[axis]
    delta = rng.multivariate_normal(np.zeros(6), covariance, size=1_000_000)
    moved = POINTS[0] + np.cross(delta[:, 3:], POINTS[0]) + delta[:, :3]
    shift = (project(moved, focal_length_mm=F) - project(POINTS[0], focal_length_mm=F))[:, axis]
    edges = np.linspace(-4, 4, 41) * float(law.std)
    expected = np.diff(np.concatenate([[0.0], law.cdf(edges), [1.0]])) * len(shift)
    observed = np.histogram(shift, np.concatenate([[-np.inf], edges, [np.inf]]))[0]
    assert chisquare(observed, expected, sum_check=False).pvalue > 1e-3


def test_no_displacement_is_a_point_mass():
    law = point_displacement(POINTS[0], focal_length_mm=F, pose_covariance=np.zeros((6, 6)))[0]
    np.testing.assert_array_equal(law.cdf([-1e-9, 0.0, 1e-9]), [0.0, 1.0, 1.0])


W = np.array([-3.0, -1.0, -0.2, 0.0, 0.3, 1.0, 2.5])
CASES = [
    (1.0, 0.04, 0.0, 1.0),
    (1.0, 0.04, 0.12, 1.0),
    (1.0, 0.04, -0.19, 1.0),
    (0.5, 1.0, 0.3, 1.0),
    (2.0, 9.0, -3.0, 1.5),
]


def paper_pdf(w, var_n, var_d, cov, mu):
    """The density as the design states it, symbol by symbol."""
    sn = np.sqrt(var_n)
    sd = np.sqrt(var_d)
    rho = cov / (sn * sd)
    a = np.sqrt(w**2 / sn**2 - 2 * rho * w / (sn * sd) + 1 / sd**2)
    b = mu / sd**2 - rho * mu * w / (sn * sd)
    c = mu**2 / sd**2
    k = np.exp((b**2 - c * a**2) / (2 * (1 - rho**2) * a**2))
    root = np.sqrt(1 - rho**2)
    first = (
        b
        * k
        / (np.sqrt(2 * np.pi) * sn * sd * a**3)
        * (norm.cdf(b / (root * a)) - norm.cdf(-b / (root * a)))
    )
    return first + root / (np.pi * sn * sd * a**2) * np.exp(-c / (2 * (1 - rho**2)))


@pytest.mark.parametrize("case", CASES)
def test_pdf_is_the_papers(case):
    np.testing.assert_allclose(NormalRatio(*case).pdf(W), paper_pdf(W, *case), rtol=1e-9)


@pytest.mark.parametrize("case", CASES)
def test_pdf_against_quadrature_over_the_denominator(case):
    var_n, var_d, cov, mu = case
    joint = multivariate_normal([0.0, mu], [[var_n, cov], [cov, var_d]])
    sd = np.sqrt(var_d)
    for w in W:
        pieces = np.unique(
            np.clip([mu - 12 * sd, 0.0, mu, mu + 12 * sd], mu - 12 * sd, mu + 12 * sd)
        )
        value = sum(
            quad(lambda d, w=w: abs(d) * joint.pdf([w * d, d]), a, b, epsabs=1e-12, limit=200)[0]
            for a, b in itertools.pairwise(pieces)
        )
        assert float(NormalRatio(*case).pdf(w)) == pytest.approx(value, abs=1e-8)


@pytest.mark.parametrize(
    "case", [*CASES, (1.0, 0.04, 0.2, 1.0), (1.0, 0.04, -0.2, 1.0), (1.0, 0.0, 0.0, 2.0)]
)
def test_cdf_is_the_integral_of_the_pdf(case):
    law = NormalRatio(*case)
    step = 1e-6
    slope = (law.cdf(W + step) - law.cdf(W - step)) / (2 * step)
    np.testing.assert_allclose(law.pdf(W), slope, atol=1e-8)
    np.testing.assert_allclose(law.cdf([-1e12, 1e12]), [0.0, 1.0], atol=1e-6)


@pytest.mark.parametrize("case", [*CASES, (1.0, 0.04, 0.2, 1.0)])
def test_a_million_samples_fit(case):
    law = NormalRatio(*case)
    edges = np.linspace(-4.0, 4.0, 61)
    expected = np.diff(np.concatenate([[0.0], law.cdf(edges), [1.0]])) * 1_000_000
    observed = np.histogram(
        law.sample(1_000_000, rng=11), np.concatenate([[-np.inf], edges, [np.inf]])
    )[0]
    keep = expected > 10
    assert chisquare(observed[keep], expected[keep], sum_check=False).pvalue > 1e-3


@pytest.mark.parametrize("rho", [1.0, -1.0])
def test_full_correlation_is_the_limit(rho):
    near = NormalRatio(1.0, 0.04, rho * 0.2 * (1 - 1e-12), 1.0)
    full = NormalRatio(1.0, 0.04, rho * 0.2, 1.0)
    np.testing.assert_allclose(full.pdf(W), near.pdf(W), atol=1e-5)
    np.testing.assert_allclose(full.cdf(W), near.cdf(W), atol=1e-5)
    # N = rho 5 (D - 1), so N/D <= w is D <= 1 / (1 - w/5) for rho = 1 and w < 5, up to the chance of a negative D.
    if rho == 1.0:
        np.testing.assert_allclose(full.cdf(W), norm.cdf((1 / (1 - W / 5) - 1) / 0.2), atol=1e-6)


def test_a_ratio_that_is_never_reached_has_no_density():
    # N = 5 (D - 1), so N/D = 5 - 5/D never is 5
    assert NormalRatio(1.0, 0.04, 0.2, 1.0).pdf(5.0) == 0.0


def test_constant_denominator_is_normal():
    law = NormalRatio(1.0, 0.0, 0.0, 2.0)
    np.testing.assert_allclose(law.pdf(W), norm(scale=0.5).pdf(W))
    np.testing.assert_allclose(law.cdf(W), norm(scale=0.5).cdf(W))


@pytest.mark.parametrize("var_d", [0.0, 0.01])
def test_zero_numerator_is_a_point_mass(var_d):
    law = NormalRatio(0.0, var_d, 0.0, 2.0)
    np.testing.assert_array_equal(law.cdf([-1.0, 0.0, 1.0]), [0.0, 1.0, 1.0])
    np.testing.assert_array_equal(law.pdf([-1.0, 0.0, 1.0]), [0.0, np.inf, 0.0])
    np.testing.assert_array_equal(law.sample(3), np.zeros(3))


@pytest.mark.parametrize(
    "case", [(1.0, 0.01, 0.05, 1.0), (1.0, 0.01, 0.1, 1.0), (1.0, 0.0, 0.0, 1.0)]
)
def test_characteristic_function_is_the_fourier_transform(case):
    law = NormalRatio(*case)
    for t in (0.0, 0.7, 2.5):
        real = quad(lambda w, t=t: law.pdf(w) * np.cos(t * w), -20, 20, limit=400, points=[0.0])[0]
        imag = quad(lambda w, t=t: law.pdf(w) * np.sin(t * w), -20, 20, limit=400, points=[0.0])[0]
        assert complex(law.characteristic(t)) == pytest.approx(complex(real, imag), abs=3e-6)


def test_parameters_broadcast():
    law = NormalRatio(np.ones((3, 1)), 0.04, np.array([0.0, 0.1]), 1.0)
    assert law.pdf(0.5).shape == law.cdf(0.5).shape == law.std.shape == (3, 2)
    assert law.sample(4).shape == (4, 3, 2)
    assert law.cdf(W[:, None, None]).shape == (len(W), 3, 2)


def test_erf_and_the_papers_bracket_are_the_same():
    x = np.linspace(-3, 3, 13)
    np.testing.assert_allclose(norm.cdf(x) - norm.cdf(-x), erf(x / np.sqrt(2)), atol=1e-15)
