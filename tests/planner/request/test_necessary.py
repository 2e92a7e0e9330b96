"""Necessary conditions: no point, segment or pair that the camera sees sharp breaks them, and some come close."""

import numpy as np
import pytest
from plan_examples import CAMERA

from planner.request.camera_limits import (
    boxes_reach,
    focus_reach_mm,
    longest_image_mm,
    widest_view_mm,
)


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
