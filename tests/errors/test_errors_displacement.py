import numpy as np
import pytest
from edge_examples import F, random_covariance
from scipy.spatial.transform import Rotation
from scipy.stats import chisquare

from errors import displace, displacement_terms, image_segment, point_displacement, project

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
