"""The reserve of focus of each end: a camera that turns moves an end off the axis in depth."""

from __future__ import annotations

import numpy as np
import pytest
from plan_examples import CAMERA
from scipy.spatial.transform import Rotation
from scipy.stats import norm

from planner import Camera, PoseUncertainty
from planner.options import InspectionOptions
from planner.request.camera_limits import (
    LEAST_SIGMAS,
    NO_RESERVE,
    FocusReserve,
    boxes_reach,
    focus_reach_mm,
    longest_image_mm,
    probability_share,
    rooms,
    shares,
    sigmas_left,
    widest_view_mm,
)
from planner.request.constraints import FOCUS, Lens, image_slacks

CAMERA_FOCUS_RESERVE = Camera(
    8.0, (0.00345, 0.00345), (2448, 2048), f_number=8.0, focus_distance_mm=300.0
)
# so narrow that three standard deviations do not fit
NARROW = Camera(25.0, (0.00345, 0.00345), (2448, 2048), f_number=4.0, focus_distance_mm=120.0)
TURNING = PoseUncertainty(np.diag([0.0, 0.0, 0.0, 0.001**2, 0.001**2, 0.001**2]))


def _correlated():
    mixing = np.random.default_rng(4).normal(size=(6, 6))
    scale = np.array([0.05] * 3 + [0.001] * 3)
    return PoseUncertainty(scale[:, None] * (mixing @ mixing.T / 6) * scale)


def _depths(point, uncertainty, n, seed=0):
    """Depths of a point from n cameras near the origin: exact rotations."""
    moves = np.random.default_rng(seed).multivariate_normal(np.zeros(6), uncertainty.covariance, n)
    turns = Rotation.from_rotvec(moves[:, 3:]).inv()
    return turns.apply(point - moves[:, :3])[:, 2]


def test_a_turn_alone_moves_a_point_in_depth_by_its_distance_from_the_axis():
    """By hand: 100 mm off the axis and 1 mrad are 0.1 mm; on the axis, nothing."""
    reserve = FocusReserve.of(CAMERA_FOCUS_RESERVE, TURNING)
    points = np.array([[0, 0, 300.0], [100, 0, 300], [0, -100, 300], [60, 80, 300]])
    np.testing.assert_allclose(reserve.sigma_mm(points), [0, 0.1, 0.1, 0.1], atol=1e-12)
    np.testing.assert_allclose(reserve.margin_mm(points), [0, 0.3, 0.3, 0.3], atol=1e-12)
    assert reserve.on_axis_mm == 0.0


@pytest.mark.parametrize("uncertainty", [TURNING, _correlated()])
def test_the_standard_deviation_is_that_of_displaced_poses(uncertainty):
    for point in ([90.0, -60.0, 310.0], [-90.0, -60.0, 290.0], [0.0, 80.0, 300.0]):
        drawn = _depths(np.array(point), uncertainty, 60_000).std()
        found = FocusReserve.of(CAMERA_FOCUS_RESERVE, uncertainty).sigma_mm(point)
        assert found == pytest.approx(drawn, rel=0.02)


def test_in_focus_is_as_probable_as_the_slack_over_the_standard_deviation():
    """Rotation only: the probability is Φ(slack / (σ·hypot(x, y)))."""
    near = CAMERA_FOCUS_RESERVE.depth_of_field_mm[0]
    point = np.array([60.0, 80.0, near + 0.13])
    expected = norm.cdf(0.13 / (0.001 * 100.0))
    sharp = np.mean(_depths(point, TURNING, 60_000) >= near)
    assert sharp == pytest.approx(expected, abs=0.005)
    assert sigmas_left(point[None], CAMERA_FOCUS_RESERVE, TURNING) == pytest.approx(1.3)


@pytest.mark.parametrize("camera", [CAMERA_FOCUS_RESERVE, NARROW])
def test_an_end_at_the_limit_of_the_constraint_stays_in_focus(camera):
    """Where the constraint just allows a corner of the image, 95 % of displaced poses have it in focus at least."""
    uncertainty = PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.002)
    need = InspectionOptions().requirements(camera, uncertainty)
    near, far = camera.depth_of_field_mm
    lens = Lens.of(camera, 0.0, 0.0, need.focus_margin_mm, need.focus_reserve)
    half = np.array(camera.sensor_size_mm) / 2 / camera.image_distance_mm
    for column, limit, inwards in ((0, near, 1.0), (2, far, -1.0)):
        low = 0.0
        high = (far - near) / 2
        for _ in range(50):
            middle = (low + high) / 2
            z = limit + inwards * middle
            ends = np.array([[*(half * z), z], [0.0, 0.0, (near + far) / 2]])
            kept = image_slacks(lens, ends[None, None])[0, 0, FOCUS][column] >= 0
            low, high = (low, middle) if kept else (middle, high)
        depth = _depths(np.array([*(half * z), z]), uncertainty, 60_000)
        sharp = np.mean(inwards * (depth - limit) >= 0)
        assert sharp > 0.94
        assert sharp < 1.0


def test_in_a_narrow_depth_of_field_some_of_it_is_left():
    uncertainty = PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.0)
    near, far = NARROW.depth_of_field_mm
    assert (far - near) / 8 < 3 * 0.05
    assert FocusReserve.of(NARROW, uncertainty).on_axis_mm == max(
        (far - near) / 8, LEAST_SIGMAS * 0.05
    )


@pytest.mark.uncompiled
@pytest.mark.parametrize("camera", [CAMERA_FOCUS_RESERVE, NARROW])
def test_the_compiled_pass_keeps_the_reserve_of_each_end(camera):
    uncertainty = _correlated()
    reserve = FocusReserve.of(camera, uncertainty)
    near, far = camera.depth_of_field_mm
    ends = np.random.default_rng(1).normal(size=(50, 2, 2, 3)) * [80, 80, 5] + [0, 0, near]
    margin = np.maximum(0.02, reserve.margin_mm(ends))
    depth = ends[..., 2]
    expected = np.concatenate([depth - near - margin, far - margin - depth], axis=-1)
    found = image_slacks(Lens.of(camera, 0.0, 0.0, 0.02, reserve), ends)[..., FOCUS]
    np.testing.assert_allclose(found, expected, atol=1e-9)
    # no end keeps less than the constant margin, which is what the lower bound takes from the depth of field
    assert margin.min() >= 0.02


def test_points_between_ends_in_focus_are_in_focus():
    """The standard deviation is convex, so an edge keeps what its ends keep."""
    reserve = FocusReserve.of(CAMERA_FOCUS_RESERVE, _correlated())
    rng = np.random.default_rng(2)
    near = CAMERA_FOCUS_RESERVE.depth_of_field_mm[0]
    ends = rng.normal(size=(500, 2, 3)) * [90, 90, 3] + [0, 0, near + 1.0]
    kept = (ends[..., 2] - 3 * reserve.sigma_mm(ends) >= near).all(axis=1)
    assert 20 < kept.sum() < 480
    share = rng.uniform(size=(500, 1))
    between = share * ends[:, 0] + (1 - share) * ends[:, 1]
    assert (between[kept, 2] - 3 * reserve.sigma_mm(between[kept]) >= near - 1e-12).all()


def test_a_margin_that_is_said_is_the_same_for_all_ends():
    need = InspectionOptions(focus_margin_mm=0.4).requirements(CAMERA_FOCUS_RESERVE, TURNING)
    assert (need.focus_margin_mm, need.focus_reserve) == (0.4, NO_RESERVE)
    assert "focus_sigmas" not in need.to_dict()
    usual = InspectionOptions().requirements(CAMERA_FOCUS_RESERVE, TURNING)
    assert usual.to_dict()["focus_sigmas"] == 3.0


# Necessary conditions: no point, segment or pair that the camera sees sharp breaks them, and some
# come close.


def sharp_points(n, seed=0):
    """Random points of the image's pyramid between D_min and D_max, in the camera frame, and their images in mm."""
    rng = np.random.default_rng(seed)
    half = np.array(CAMERA.sensor_size_mm) / 2
    image = rng.choice([-1.0, 1.0, 0.3], (n, 2)) * half
    depth = rng.choice([*CAMERA.depth_of_field_mm, CAMERA.focus_distance_mm], n)
    return np.column_stack([image * depth[:, None] / CAMERA.image_distance_mm, depth]), image


def test_sharp_points_are_within_the_reach_of_focus():
    distance = np.linalg.norm(sharp_points(500)[0], axis=1)
    near, far = focus_reach_mm(CAMERA)
    assert np.all(distance >= near)
    assert distance.max() == pytest.approx(far, rel=1e-12)


def test_no_two_sharp_points_are_farther_apart_than_the_widest_view():
    points = sharp_points(500)[0]
    apart = np.linalg.norm(points[:, None] - points, axis=-1).max()
    assert apart == pytest.approx(widest_view_mm(CAMERA), rel=1e-12)


def test_no_short_segment_has_a_longer_image_than_is_said():
    """The stretch is greatest for a segment at the corner, across the line of sight in the plane of the axis."""
    points, image = sharp_points(500)
    ends = points + 1e-4 * np.random.default_rng(1).normal(size=points.shape)
    ends[:, 2] = np.maximum(ends[:, 2], CAMERA.depth_of_field_mm[0])
    moved = np.linalg.norm(ends[:, :2] * CAMERA.image_distance_mm / ends[:, 2:] - image, axis=1)
    assert np.all(
        moved <= longest_image_mm(CAMERA, np.linalg.norm(ends - points, axis=1)) * (1 + 1e-6)
    )


def test_boxes_reach_by_hand():
    """From the origin the unit box at x = 3 is 3 to sqrt(18) away."""
    low = np.array([[3.0, 0.0, 0.0]])
    high = np.array([[4.0, 1.0, 1.0]])
    origin = np.zeros((1, 3))
    assert boxes_reach(low, high, origin, 1.0, 3.0).tolist() == [True]
    assert boxes_reach(low, high, origin, 1.0, 2.9).tolist() == [False]
    assert boxes_reach(low, high, origin, np.sqrt(18.0), 9.0).tolist() == [True]
    assert boxes_reach(low, high, origin, 4.3, 9.0).tolist() == [False]


# Rooms and shares, by hand.


CAMERA_SHARES = Camera(8.0, (0.00345, 0.00345), (2448, 2048), 8.0, 300.0)
WORKSPACE = np.array([[0.0, 0.0, 0.0], [500.0, 400.0, 900.0]])
NEEDS = {
    "field_margin_px": 20.0,
    "surround_px": 4.0,
    "min_length_px": 20.0,
    "stand_off_mm": 80.0,
    "separation_px": 5.0,
    "focus_margin_mm": 0.5,
}


def test_rooms_are_what_a_practitioner_calls_full():
    near, far = CAMERA_SHARES.depth_of_field_mm
    found = rooms(CAMERA_SHARES, WORKSPACE, NEEDS, 2.0)
    assert found["focus_mm"] == pytest.approx((far - near) / 2 - 2.0)
    assert rooms(CAMERA_SHARES, WORKSPACE, NEEDS)["focus_mm"] == pytest.approx(
        (far - near) / 2 - 0.5
    )
    assert found["field_of_view_px"] == 1024.0 - 24.0
    assert found["resolution_mm"] == pytest.approx(20.0 * 0.00345)
    assert found["clearance_mm"] == 80.0
    assert found["workspace_mm"] == 40.0
    assert found["separation_px"] == 5.0
    # nothing is asked of corners
    assert "corner_deg" not in found


def test_a_share_is_a_slack_over_its_room_and_one_at_most():
    room = {"focus_mm": 4.0, "clearance_mm": 80.0}
    found = shares({"focus_mm": [1.0, 8.0], "clearance_mm": 20.0, "visibility": 1.0}, room)
    assert found["focus_mm"].tolist() == [0.25, 1.0]
    assert found["clearance_mm"] == 0.25
    assert set(found) == {"focus_mm", "clearance_mm"}
    assert probability_share(0.95, 0.9) == pytest.approx(0.5)
