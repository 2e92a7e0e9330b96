"""What the bound takes a camera to take in: no less than any admissible setting needs."""

import numpy as np
from box_requests import CAMERA, UNCERTAINTY, WORKSPACE, random_poses
from grid_box import EDGES, BoxSpace

from planner.bound.pose_space import frustum_of, view_of
from planner.camera.pose import moved, world_to_cam
from planner.options import InspectionOptions
from planner.request.problem import Problem
from planner.search.columns import Judge


def test_all_that_a_pose_inspects_is_between_the_depths_of_the_bound():
    """Only what every end keeps is taken from the depth of field: an end on the axis keeps less than one off it."""
    need = InspectionOptions().requirements(CAMERA, UNCERTAINTY)
    space = BoxSpace((120.0, 80.0, 60.0), WORKSPACE, EDGES)
    judge = Judge(Problem(space, EDGES, CAMERA, UNCERTAINTY, 0.98, 0.9, need))
    frustum = frustum_of(judge.problem)
    view = view_of(judge.problem)
    near, far = CAMERA.depth_of_field_mm
    assert (frustum.near, frustum.far) == (near + 0.15, far - 0.15)
    assert (view.near, view.far) == (frustum.near, frustum.far)
    poses = random_poses(judge, 400)
    # forwards and backwards, so that ends come to the limits
    steps = np.zeros((61, 6))
    steps[:, 2] = np.linspace(-80.0, 80.0, 61)
    poses = np.concatenate([moved(pose, steps, 1.0) for pose in poses])
    inspects = judge(poses).inspects
    depth = world_to_cam(judge.ends, poses)[..., 2]
    assert inspects.sum() > 500
    kept = depth[inspects]
    assert kept.min() >= frustum.near
    assert kept.max() <= frustum.far
