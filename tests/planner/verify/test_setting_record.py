"""Search windows against closed forms and against poses that are drawn and turned exactly."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from planner import Camera, PoseUncertainty, look_at
from planner.verify.setting_record import search_window_px

PLAIN = Camera.named("basler-acA2440-20gm-8mm")
SCALE = PLAIN.matrix[0, 0]
BENT = Camera.from_opencv(
    PLAIN.matrix,
    [-0.12, 0.05, 1e-3, -8e-4, 0.0],
    PLAIN.resolution,
    pixel_pitch_mm=PLAIN.pixel_pitch_mm[0],
    f_number=PLAIN.f_number,
    focus_distance_mm=PLAIN.focus_distance_mm,
)
DRAWN = 40_000


@pytest.mark.parametrize(
    ("axis", "sigma", "expected"),
    [
        (0, 0.2, SCALE * 0.2 / 400.0),  # along x: f t / z
        (1, 0.2, SCALE * 0.2 / 400.0),
        (2, 0.2, 0.0),  # along the axis, a point on it stays
        (3, 1e-3, SCALE * 1e-3),  # about x: f phi
        (4, 1e-3, SCALE * 1e-3),
        (5, 1e-3, 0.0),
    ],
)
def test_a_point_on_the_axis_moves_as_similar_triangles_say(axis, sigma, expected):
    covariance = np.zeros((6, 6))
    covariance[axis, axis] = sigma**2
    window = search_window_px(
        np.eye(4), np.array([[0.0, 0.0, 400.0]]), PLAIN, PoseUncertainty(covariance)
    )
    assert window == pytest.approx(3 * expected, abs=1e-9)


def test_of_several_points_the_one_that_moves_most_counts():
    turns = PoseUncertainty(np.diag([0, 0, 0, 0, 0, 1e-6]))
    points = np.array([[10.0, 0.0, 400.0], [0.0, 60.0, 400.0]])
    assert search_window_px(np.eye(4), points, PLAIN, turns) == pytest.approx(
        3 * SCALE * 60 / 400 * 1e-3
    )


@pytest.mark.parametrize("camera", [PLAIN, BENT], ids=["plain", "distorted"])
@pytest.mark.parametrize("seed", range(4))
def test_windows_agree_with_poses_that_are_drawn(camera, seed):
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(6, 6)) * np.repeat([0.04, 4e-4], 3)[:, None]
    covariance = root @ root.T
    pose = look_at(
        rng.uniform(-1, 1, (1, 3)) * 60 + [0, 0, 380], [0, 0, 0], roll=rng.uniform(0, 6)
    )[0]
    ends = rng.uniform(-40, 40, (2, 3))
    moves = rng.multivariate_normal(np.zeros(6), covariance, DRAWN)
    # the real pose is the planned one times the displacement, see PoseUncertainty
    turned = pose[:3, :3] @ Rotation.from_rotvec(moves[:, 3:]).as_matrix()
    places = pose[:3, 3] + moves[:, :3] @ pose[:3, :3].T
    local = np.einsum("nik,nei->nek", turned, ends - places[:, None])
    slopes = local[..., :2] / local[..., 2:]
    if camera.distortion is not None:
        slopes = camera.distortion.distort(slopes)
    pixels = slopes * np.diag(camera.matrix)[:2]
    drawn = max(np.linalg.eigvalsh(np.cov(pixels[:, e].T)).max() for e in range(2))
    # a sample variance is off by sqrt(2 / n) of itself, a standard deviation by half of that
    window = search_window_px(pose, ends, camera, PoseUncertainty(covariance))
    assert window == pytest.approx(3 * np.sqrt(drawn), rel=5 * np.sqrt(0.5 / DRAWN))
