import numpy as np
import pytest
from edge_examples import EDGE, F, random_edges
from hypothesis import given, settings
from hypothesis import strategies as st

from errors import displace, image_segment, length_expansion

pytestmark = pytest.mark.uncompiled


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


@settings(max_examples=50, deadline=None)
@given(seed=st.integers(0, 10_000), turn=st.floats(-0.3, 0.3))
def test_turning_about_the_optical_axis_changes_no_length(seed, turn):
    edge = random_edges(1, np.random.default_rng(seed))[0]
    nominal, gradient, hessian = length_expansion(edge, focal_length_mm=F)
    assert abs(gradient[5]) < 1e-12 * nominal * 1e3
    assert abs(hessian[5, 5]) < 1e-9 * nominal
    assert length(edge, np.array([0, 0, 0, 0, 0, turn])) == pytest.approx(float(nominal))


def test_swapping_the_ends_changes_nothing():
    edges = random_edges(5, np.random.default_rng(1))
    for one, other in zip(
        length_expansion(edges, focal_length_mm=F),
        length_expansion(edges[:, ::-1], focal_length_mm=F),
        strict=True,
    ):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9)


def test_shapes():
    edges = random_edges(6, np.random.default_rng(1)).reshape(2, 3, 2, 3)
    shapes = [part.shape for part in length_expansion(edges, focal_length_mm=F)]
    assert shapes == [(2, 3), (2, 3, 6), (2, 3, 6, 6)]
    assert length_expansion(np.empty((0, 2, 3)), focal_length_mm=F)[1].shape == (0, 6)
