"""Tests of `joint`."""

import itertools
import tracemalloc

import numpy as np
import pytest
from edge_examples import CAMERA, EDGE, PAPER_COVARIANCE, PITCH, F, random_covariance, random_edges
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.stats import chi2, ncx2, norm

from errors import (
    SegmentQuantization,
    displace,
    image_segment,
    length_expansion,
    simulate_success,
    success_probability,
)
from errors.model import quadratic_probability

CALL = {**CAMERA, "accuracy": 0.98}


def probability_by_diagonalisation(edge, covariance, accuracy):
    """The joint model by another route: eigenvalues in whitened coordinates and adaptive Gil-Pelaez quadrature."""
    length, gradient, hessian = length_expansion(edge, focal_length_mm=F)
    hessian = hessian - np.outer(gradient, gradient) / length
    root = np.linalg.cholesky(covariance)
    lam, vectors = np.linalg.eigh(root.T @ hessian @ root)
    b = vectors.T @ root.T @ gradient
    angle = image_segment(edge, focal_length_mm=F)[1]
    quantization = SegmentQuantization(angle, PITCH)
    low = length * np.log(accuracy)
    high = length * np.log(2.0 - accuracy)

    def integrand(t):
        value = np.prod(
            (1 - 1j * t * lam) ** -0.5 * np.exp(-0.5 * t * t * b**2 / (1 - 1j * t * lam))
        )
        value *= quantization.characteristic(t)
        return ((np.exp(-1j * t * low) - np.exp(-1j * t * high)) * value).imag / (np.pi * t)

    scale = 1.0 / np.sqrt(np.sum(b**2) + 0.5 * np.sum(lam**2) + float(quantization.std) ** 2)
    # The characteristic function falls off as a power of t at worst, so a few decades of pieces suffice.
    knots = (
        np.concatenate([[1e-12], np.linspace(0.5, 40.0, 80), np.geomspace(45.0, 400.0, 60)]) * scale
    )
    return sum(
        quad(integrand, a, b, epsabs=1e-10, limit=200)[0] for a, b in itertools.pairwise(knots)
    )


@pytest.mark.uncompiled
@pytest.mark.parametrize("rotation_std", [1e-4, 0.002, 0.01, 0.055])
@pytest.mark.parametrize("accuracy", [0.9, 0.98, 0.998])
def test_against_diagonalisation_and_adaptive_quadrature(rotation_std, accuracy):
    rng = np.random.default_rng(1)
    for edge in random_edges(3, rng):
        covariance = random_covariance(rng, rotation_std)
        p = success_probability(edge, **CAMERA, pose_covariance=covariance, accuracy=accuracy)
        assert p == pytest.approx(
            probability_by_diagonalisation(edge, covariance, accuracy), abs=5e-5
        )


@pytest.mark.parametrize(
    ("rotation_std", "bound"), [(0.002, 0.001), (0.01, 0.001), (0.03, 0.003), (0.055, 0.006)]
)
def test_accuracy_table_against_a_million_poses(rotation_std, bound):
    rng = np.random.default_rng(2001)
    edges = random_edges(20, rng)
    covariance = np.array([random_covariance(rng, rotation_std) for _ in edges])
    joint = success_probability(edges, **CALL, pose_covariance=covariance)
    referee = simulate_success(edges, **CALL, pose_covariance=covariance, samples=1_000_000, rng=7)
    assert np.abs(joint - referee.probability).max() < bound
    if rotation_std == 0.055:
        assert joint.min() < 0.8


@pytest.mark.uncompiled
@pytest.mark.parametrize("accuracy", [0.98, 0.998])
@pytest.mark.parametrize("turn", [0.0, 0.4, np.pi / 2])
def test_without_displacement_it_is_eq_3(accuracy, turn):
    direction = np.array([np.cos(turn), np.sin(turn), 0.0])
    edge = np.array([0.0, 0.0, -900.0]) + np.array([[-0.5], [0.5]]) * 30.0 * direction
    length, angle = image_segment(edge, focal_length_mm=F)
    law = SegmentQuantization(angle, PITCH)
    tolerance = (1.0 - accuracy) * length
    p = success_probability(edge, **CAMERA, pose_covariance=np.zeros((6, 6)), accuracy=accuracy)
    assert p == pytest.approx(float(law.cdf(tolerance) - law.cdf(-tolerance)), abs=2e-4)


@pytest.mark.uncompiled
def test_pure_depth_error_by_hand():
    # A frontal edge moved by dz: L'/L = depth / (depth - dz); pixels so fine that they do not matter.
    edge = np.array([[-20.0, 0.0, -275.0], [20.0, 0.0, -275.0]])
    sigma = 4.0
    depth = 300.0
    covariance = np.diag([0.0, 0.0, sigma**2, 0.0, 0.0, 0.0])
    p = success_probability(
        edge,
        focal_length_mm=F,
        pixel_pitch_mm=(1e-6, 1e-6),
        pose_covariance=covariance,
        accuracy=0.98,
    )
    expected = norm.cdf(depth * (1 - 1 / 1.02) / sigma) - norm.cdf(depth * (1 - 1 / 0.98) / sigma)
    assert p == pytest.approx(expected, abs=1e-4)


@pytest.mark.uncompiled
@pytest.mark.parametrize("degrees", [1, 2, 4, 6])
def test_a_sum_of_squares_has_the_law_of_chi_square(degrees):
    """Where only the Hessian counts: delta'H delta / 2 with H the projection on some axes, in a turned basis; and with
    a gradient in these axes, b.u + u.u / 2 = |u + b|^2 / 2 - |b|^2 / 2."""
    rng = np.random.default_rng(degrees)
    # columns are axes of the standard normals; the root turns and stretches, which H and g undo
    turn = np.linalg.qr(rng.normal(size=(6, 6)))[0]
    root = rng.normal(size=(6, 6))
    back = np.linalg.inv(root)
    hessian = back.T @ turn[:, :degrees] @ turn[:, :degrees].T @ back
    quiet = np.zeros((1, 3))
    for low, high in ((-1.0, 0.5), (0.3, 2.0), (1.0, 9.0), (-30.0, 30.0), (60.0, 70.0)):
        for sign in (1.0, -1.0):
            limits = np.sort(sign * np.array([[low, high]]))
            for b in (0.0, 0.7, 3.0):
                gradient = back.T @ turn[:, 0] * b
                p = quadratic_probability(gradient[None], sign * hessian[None], root, quiet, limits)
                law = ncx2(degrees, b * b) if b else chi2(degrees)
                expected = law.cdf(2 * high + b * b) - law.cdf(max(0.0, 2 * low + b * b))
                assert p == pytest.approx(expected, abs=2e-4), (low, high, sign, b)


@pytest.mark.uncompiled
def test_what_cannot_err_is_within_limits_that_hold_zero():
    nothing = np.zeros((4, 6)), np.zeros((4, 6, 6)), np.eye(6), np.zeros((4, 3))
    limits = np.array([[-1.0, 1.0], [0.0, 1.0], [-1.0, 0.0], [0.1, 1.0]])
    assert quadratic_probability(*nothing, limits).tolist() == [1.0, 1.0, 1.0, 0.0]


@pytest.mark.uncompiled
def test_batches_agree_with_single_edges_and_covariances_broadcast():
    rng = np.random.default_rng(3)
    edges = random_edges(6, rng).reshape(2, 3, 2, 3)
    covariance = np.array([random_covariance(rng, 0.02) for _ in range(3)])
    whole = success_probability(edges, **CALL, pose_covariance=covariance)
    for i in range(2):
        for j in range(3):
            assert whole[i, j] == success_probability(
                edges[i, j], **CALL, pose_covariance=covariance[j]
            )
    fanned = success_probability(edges[0, 0], **CALL, pose_covariance=covariance)
    assert fanned.shape == (3,)
    assert fanned[0] == whole[0, 0]
    assert success_probability(
        np.empty((0, 2, 3)), **CALL, pose_covariance=PAPER_COVARIANCE
    ).shape == (0,)
    assert np.ndim(success_probability(EDGE, **CALL, pose_covariance=PAPER_COVARIANCE)) == 0


@pytest.mark.uncompiled
def test_views_need_not_be_contiguous():
    edges = random_edges(8, np.random.default_rng(5))
    call = {**CALL, "pose_covariance": PAPER_COVARIANCE}
    np.testing.assert_array_equal(
        success_probability(edges[::-2], **call), success_probability(edges, **call)[::-2]
    )
    swapped = np.asfortranarray(edges)
    np.testing.assert_array_equal(
        success_probability(swapped, **call), success_probability(edges, **call)
    )


@pytest.mark.uncompiled
def test_symmetries():
    rng = np.random.default_rng(6)
    edges = random_edges(20, rng)
    covariance = random_covariance(rng, 0.02)
    p = success_probability(edges, **CALL, pose_covariance=covariance)
    np.testing.assert_allclose(
        success_probability(edges[:, ::-1], **CALL, pose_covariance=covariance), p, atol=1e-6
    )
    # Mirrored in the vertical plane: C1, dx flip, rotations about the other two axes flip.
    flip = np.diag([-1.0, 1.0, 1.0, 1.0, -1.0, -1.0])
    mirrored = success_probability(
        edges * [-1.0, 1.0, 1.0], **CALL, pose_covariance=flip @ covariance @ flip
    )
    np.testing.assert_allclose(mirrored, p, atol=1e-6)


@pytest.mark.uncompiled
def test_probability_grows_with_the_tolerance():
    accuracies = np.linspace(0.9, 0.9995, 30)
    p = [
        success_probability(EDGE, **CAMERA, pose_covariance=PAPER_COVARIANCE, accuracy=a)
        for a in accuracies
    ]
    assert (np.diff(p) <= 1e-5).all()
    assert p[0] > 0.99 > 0.2 > p[-1]


def test_memory_stays_bounded():
    edges = np.broadcast_to(EDGE, (1_000_000, 2, 3))
    success_probability(EDGE, **CALL, pose_covariance=PAPER_COVARIANCE)
    tracemalloc.start()
    p = success_probability(edges, **CALL, pose_covariance=np.diag([0.03] * 3 + [1e-6] * 3))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert p.shape == (1_000_000,)
    # The result is 8 MB and the check for finite values 6 MB.
    assert peak < 40e6


def length(edge, delta):
    return float(image_segment(displace(edge, delta), focal_length_mm=F)[0])


def differences(function, delta_scale):
    """Gradient and Hessian at zero by central differences, each parameter with its own step."""
    n = len(delta_scale)
    unit = np.diag(delta_scale)
    gradient = np.array([function(u) - function(-u) for u in unit]) / (2.0 * delta_scale)
    hessian = np.empty((n, n))
    for i in range(n):
        for j in range(n):
            a = unit[i]
            b = unit[j]
            mixed = function(a + b) - function(a - b) - function(b - a) + function(-a - b)
            hessian[i, j] = mixed / (4.0 * delta_scale[i] * delta_scale[j])
    return gradient, hessian


@pytest.mark.uncompiled
@pytest.mark.parametrize("edge", [EDGE, *random_edges(8, np.random.default_rng(2))])
def test_derivatives_against_finite_differences_of_the_exact_length(edge):
    scale = np.array([3e-2] * 3 + [2e-4] * 3)
    gradient, hessian = differences(lambda delta: length(edge, delta), scale)
    exact_length, exact_gradient, exact_hessian = length_expansion(edge, focal_length_mm=F)
    assert exact_length == pytest.approx(length(edge, np.zeros(6)))
    # Compared as changes of the length over one step, so that every parameter counts alike.
    np.testing.assert_allclose(exact_gradient * scale, gradient * scale, atol=1e-9)
    outer = scale[:, None] * scale
    np.testing.assert_allclose(exact_hessian * outer, hessian * outer, atol=1e-10)
    np.testing.assert_array_equal(exact_hessian, exact_hessian.T)


@pytest.mark.uncompiled
@settings(max_examples=50, deadline=None)
@given(seed=st.integers(0, 10_000), turn=st.floats(-0.3, 0.3))
def test_turning_about_the_optical_axis_changes_no_length(seed, turn):
    edge = random_edges(1, np.random.default_rng(seed))[0]
    nominal, gradient, hessian = length_expansion(edge, focal_length_mm=F)
    assert abs(gradient[5]) < 1e-12 * nominal * 1e3
    assert abs(hessian[5, 5]) < 1e-9 * nominal
    assert length(edge, np.array([0, 0, 0, 0, 0, turn])) == pytest.approx(float(nominal))


@pytest.mark.uncompiled
def test_swapping_the_ends_changes_nothing():
    edges = random_edges(5, np.random.default_rng(1))
    for one, other in zip(
        length_expansion(edges, focal_length_mm=F),
        length_expansion(edges[:, ::-1], focal_length_mm=F),
        strict=True,
    ):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9)


@pytest.mark.uncompiled
def test_shapes():
    edges = random_edges(6, np.random.default_rng(1)).reshape(2, 3, 2, 3)
    shapes = [part.shape for part in length_expansion(edges, focal_length_mm=F)]
    assert shapes == [(2, 3), (2, 3, 6), (2, 3, 6, 6)]
    assert length_expansion(np.empty((0, 2, 3)), focal_length_mm=F)[1].shape == (0, 6)
