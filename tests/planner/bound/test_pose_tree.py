"""What the tree of poses says of a node holds for every pose in it, up to the last digits."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from planner.bound.pose_tree import Nodes, _nearest_depth, _patch_frames
from planner.bound.view import Frustum

pytestmark = pytest.mark.uncompiled


def test_the_least_depth_of_a_node_is_not_overstated():
    aside = 2e-6
    ahead = 400.0
    spread = 0.5
    ray = np.array([aside, 0.0, ahead])
    axis = np.array([[0.0, 0.0, 1.0]])
    node = Nodes(
        np.zeros((1, 3)), np.zeros(1), axis, np.array([spread]), np.eye(3)[None], np.zeros(1)
    )
    found = _nearest_depth(
        ray, node, 0, Frustum(10.0, 1e4, 2.0, 2.0, math.atan(math.hypot(2.0, 2.0)))
    )
    assert found <= math.hypot(aside, ahead) * math.cos(math.atan2(aside, ahead) + spread) + 1e-9


def test_the_angle_to_a_corner_of_a_small_patch_is_exact_to_the_last_digits():
    width = 1e-6
    patch = np.array([[-width, width, -width, width]])
    _, spread, _ = _patch_frames(np.array([4]), patch, np.zeros(1))
    assert abs(spread[0] - math.atan(math.hypot(width, width))) < 1e-15


def test_no_pose_of_a_node_sees_a_point_nearer_than_its_least_depth_nor_one_that_it_cannot_see():
    """Poses drawn in balls of positions, cones of directions and ranges of rolls, and the point projected."""
    view = Frustum(300.0, 500.0, 0.5, 0.4, math.atan(math.hypot(0.5, 0.4)))
    rng = np.random.default_rng(3)
    n_seen = n_never = 0
    for _ in range(600):
        radius = rng.choice([0.0, 5.0, 50.0])
        spread = rng.choice([0.01, 0.1, 0.5])
        roll = rng.choice([0.0, 0.1, 0.5])
        frame = Rotation.random(random_state=rng).as_matrix()
        share = rng.uniform(-1.4, 1.4, 2)
        depth = rng.uniform(200.0, 600.0)
        ray = frame @ [share[0] * 0.5 * depth, share[1] * 0.4 * depth, depth]
        turned = roll * math.sin(view.cone)
        node = Nodes(
            np.zeros((1, 3)), *(np.array([x]) for x in (radius, frame[:, 2], spread, frame, turned))
        )
        least = _nearest_depth(ray, node, 0, view)
        n_never += least < 0.0
        for _ in range(10):
            way = rng.uniform(0.0, 2.0 * math.pi)
            tilt = spread * rng.random() * np.array([math.cos(way), math.sin(way), 0.0])
            turn = Rotation.from_rotvec(tilt) * Rotation.from_rotvec(
                [0.0, 0.0, rng.uniform(-roll, roll)]
            )
            aside = rng.normal(size=3)
            eye = radius * rng.random() * aside / np.linalg.norm(aside)
            x, y, z = (frame @ turn.as_matrix()).T @ (ray - eye)
            if view.near <= z <= view.far and abs(x) <= view.tan_x * z and abs(y) <= view.tan_y * z:
                n_seen += 1
                assert 0.0 <= least <= z
    assert n_seen > 500
    assert n_never > 100
