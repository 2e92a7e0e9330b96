import numpy as np
import pytest

from planner.camera.calibration import Distortion
from planner.exceptions import CameraError


def test_distort_known_point():
    # by hand: r² = 0.25, radial 1 + 0.025 + 0.0125 + 0.0046875
    lens = Distortion(k1=0.1, k2=0.2, p1=0.01, p2=0.02, k3=0.3)
    radial = 1.0421875
    expected = [0.3 * radial + 0.0024 + 0.02 * 0.43, 0.4 * radial + 0.01 * 0.57 + 0.0048]
    np.testing.assert_allclose(lens.distort([0.3, 0.4]), expected, rtol=0, atol=1e-15)


def test_undistort_inverts_distort():
    lens = Distortion(k1=-0.2, k2=0.05, p1=1e-3, p2=-2e-3, k3=-0.01)
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (1000, 2))
    np.testing.assert_allclose(lens.undistort(lens.distort(points)), points, rtol=0, atol=1e-10)


def test_no_ideal_point_beyond_the_fold():
    # x(1 - x²) is at most 2/(3 sqrt 3) = 0.385
    with pytest.raises(CameraError, match="folds"):
        Distortion(k1=-1.0).undistort([0.5, 0.0])


def test_coefficient_must_be_finite():
    with pytest.raises(CameraError, match="k2 must be finite"):
        Distortion(k2=float("nan"))
