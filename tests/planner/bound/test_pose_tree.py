"""What the tree of poses says of a node holds for every pose in it, up to the last digits."""

import math

import numpy as np
import pytest

from planner.bound.boxes.view import Frustum
from planner.bound.node_sets import Nodes, _nearest_depth
from planner.bound.pose_tree import _patch_frames

pytestmark = pytest.mark.uncompiled


def test_the_least_depth_of_a_node_is_not_overstated():
    aside, ahead, spread = 2e-6, 400.0, 0.5
    ray, axis = np.array([aside, 0.0, ahead]), np.array([[0.0, 0.0, 1.0]])
    node = Nodes(np.zeros((1, 3)), np.zeros(1), axis, np.array([spread]), np.eye(3)[None], np.zeros(1))
    found = _nearest_depth(ray, node, 0, Frustum(10.0, 1e4, 2.0, 2.0, math.atan(math.hypot(2.0, 2.0))))
    assert found <= math.hypot(aside, ahead) * math.cos(math.atan2(aside, ahead) + spread) + 1e-9


def test_the_angle_to_a_corner_of_a_small_patch_is_exact_to_the_last_digits():
    width = 1e-6
    patch = np.array([[-width, width, -width, width]])
    _, spread, _ = _patch_frames(np.array([4]), patch, np.zeros(1))
    assert abs(spread[0] - math.atan(math.hypot(width, width))) < 1e-15
