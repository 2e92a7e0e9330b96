"""P_all against answers that are known without it."""

from dataclasses import replace

import numpy as np
import pytest
from grid_box import BoxSpace
from scipy.stats import norm

from planner import Camera, PoseUncertainty, look_at
from planner.camera.pose import world_to_cam
from planner.request.constraints import Requirements
from planner.request.problem import Problem
from planner.verify.joint_counts import DisplacedChecks, lower_bound, poses_needed, without_reserves

CAMERA = Camera(8.0, (0.00345, 0.00345), (2448, 2048), 8.0, 400.0)
WORKSPACE = [[-900.0] * 3, [1100.0] * 3]
SIZE = (120.0, 80.0, 60.0)
BOX = BoxSpace(SIZE, WORKSPACE, ("+z-y", "+z+x"))
N = 20_000


def request_of(uncertainty, camera=CAMERA, accuracy=0.9, names=("+z-y",), **need):
    return Problem(BOX, names, camera, uncertainty, accuracy, 0.9, Requirements(**need))


def frequency(request, pose, name=None):
    counts = DisplacedChecks(request, request.names).count(pose, N, seed=1)
    return counts, counts.successes[0 if name is None else request.names.index(name)] / N


def within(found, expected):
    """Four standard errors of a frequency."""
    return found == pytest.approx(expected, abs=4.0 * np.sqrt(expected * (1 - expected) / N) + 1e-9)


def test_rotation_alone_leaves_the_depth_of_field_as_often_as_the_normal_distribution_says():
    """P(focus) = Φ(slack / (σ·hypot(x, y))) of the end that is nearest to a limit; the other is far from both."""
    sigma = 0.002
    uncertainty = PoseUncertainty(np.diag([0.0, 0.0, 0.0, sigma**2, sigma**2, 0.0]))
    narrow = replace(CAMERA, f_number=2.0)
    near, _ = narrow.depth_of_field_mm
    pose = look_at([[60.0, 0.0, 60.0 + near + 3.0]], [60.0, 0.0, 60.0])[0]
    # tilted about the image's vertical, so that one end of the edge comes near the limit
    turn = np.eye(4)
    angle = 0.05
    turn[:3, :3] = [
        [np.cos(angle), 0, np.sin(angle)],
        [0, 1, 0],
        [-np.sin(angle), 0, np.cos(angle)],
    ]
    pose = pose @ turn
    request = request_of(uncertainty, narrow)
    local = world_to_cam(request.ends[0], pose)
    slack = local[:, 2].min() - near
    x, y, _ = local[np.argmin(local[:, 2])]
    pose = pose.copy()
    # as near to the limit as 0.7 standard deviations
    wanted = 0.7 * sigma * np.hypot(x, y)
    pose[:3, 3] += (slack - wanted) * pose[:3, 2]
    counts, share = frequency(request, pose)
    assert within(share, norm.cdf(0.7))
    assert counts.failures["focus"][0] == N - counts.successes[0]


def test_where_nothing_else_can_fail_it_is_the_probability_of_the_error():
    """Far from every limit: the model's P, which is the paper's density."""
    uncertainty = PoseUncertainty.isotropic(translation_mm=0.3, rotation_rad=0.003)
    request = request_of(uncertainty, accuracy=0.9985)
    pose = look_at([[60.0, -250.0, 310.0]], [60.0, 0.0, 60.0])[0]
    stated = request.objective.probability(pose[None])[0, 0]
    assert 0.3 < stated < 0.97
    counts, share = frequency(request, pose)
    assert share == pytest.approx(stated, abs=4.0 * np.sqrt(stated * (1 - stated) / N) + 0.002)
    assert counts.failures["error"][0] == N - counts.successes[0]


def test_leaving_the_picture_and_losing_sight_are_independent_and_multiply():
    """A turn moves the image; a shift along the viewing direction of a face's plane hides the edge."""
    turn = 0.003
    shift = 1.5
    # own axes: x is the world's, z looks down; t_z moves the camera through the plane z = 60
    low = Camera(8.0, (0.00345, 0.00345), (2448, 2048), 11.0, 250.0)
    box = BoxSpace(SIZE, WORKSPACE, ("+z+y",))
    # level with the top of the box, behind it: the edge is seen from above z = 60 only
    pose = look_at([[60.0, -170.0, 60.8]], [60.0, 80.0, 60.0])[0]
    down = pose[:3, 1]
    assert abs(down[2]) > 0.99
    uncertainty = PoseUncertainty(np.diag([0.0, shift**2, 0.0, 0.0, 0.0, 0.0]))
    request = Problem(box, ("+z+y",), low, uncertainty, 0.5, 0.9, Requirements())
    _, seen = frequency(request, pose)
    assert within(seen, norm.cdf(0.8 / (shift * abs(down[2]))))
    # put the edge's end near the side of the picture: 0.5 standard deviations of a turn about y
    turned = pose.copy()
    local = world_to_cam(request.ends[0], turned)
    u = local[:, 0] / local[:, 2]
    side = (2448 - 0.5 - low.matrix[0, 2]) / low.matrix[0, 0]
    # a turn about y by a moves a ray's angle by a, exactly
    angle = np.arctan(side) - np.arctan(u.max()) - 0.5 * turn
    about_y = np.eye(4)
    about_y[:3, :3] = [
        [np.cos(-angle), 0, np.sin(-angle)],
        [0, 1, 0],
        [-np.sin(-angle), 0, np.cos(-angle)],
    ]
    turned = turned @ about_y
    alone = PoseUncertainty(np.diag([0.0, 0.0, 0.0, 0.0, turn**2, 0.0]))
    _, inside = frequency(replace(request, pose_uncertainty=alone), turned)
    assert within(inside, norm.cdf(0.5))
    together = PoseUncertainty(np.diag([0.0, shift**2, 0.0, 0.0, turn**2, 0.0]))
    counts, share = frequency(replace(request, pose_uncertainty=together), turned)
    assert within(share, norm.cdf(0.8 / (shift * abs(down[2]))) * norm.cdf(0.5))
    assert counts.together == counts.successes[0]


def test_what_is_counted_for_a_target_depends_on_no_other():
    uncertainty = PoseUncertainty.isotropic(translation_mm=0.5, rotation_rad=0.005)
    pose = look_at([[250.0, -250.0, 310.0]], [100.0, 20.0, 60.0])[0]
    both = request_of(uncertainty, accuracy=0.998, names=("+z-y", "+z+x"))
    together = DisplacedChecks(both, both.names).count(pose, 4000, seed=2)
    for k, name in enumerate(both.names):
        alone = DisplacedChecks(both, [name]).count(pose, 4000, seed=2)
        assert alone.successes == (together.successes[k],)
        assert 0 < alone.successes[0] < 4000
    assert together.together <= min(together.successes)


def test_reserves_are_not_asked_of_displaced_poses():
    need = Requirements(
        field_margin_px=50.0, focus_margin_mm=2.0, visibility_radius_mm=1.0, stand_off_mm=70.0
    )
    bare = without_reserves(need)
    assert (bare.field_margin_px, bare.focus_margin_mm, bare.visibility_radius_mm) == (0, 0, 0)
    assert bare.min_length_px == need.min_length_px
    assert bare.showing == need.showing


def test_bounds_are_those_of_clopper_and_pearson_and_enough_poses_are_drawn():
    """After n successes of n the one-sided bound is (1 - confidence)^(1/n)."""
    assert lower_bound(1000, 1000) == pytest.approx(0.001 ** (1 / 1000), rel=1e-9)
    assert lower_bound(0, 10) == 0.0
    for probability in (0.9, 0.99, 0.999, 0.9999):
        n = poses_needed(probability, 1000)
        assert lower_bound(n, n) > probability
    assert poses_needed(1 - 1e-9, 1000) == 200_000
