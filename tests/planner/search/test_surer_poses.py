"""Poses moved to where counts find more, against probabilities and optima that are known without counting."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from grid_box import BoxSpace
from scipy.stats import norm

from planner import Camera, PoseUncertainty, look_at
from planner.camera.pose import world_to_cam
from planner.request.problem import Problem
from planner.search.columns import Judge
from planner.search.surer_poses import _Climb, surer_pose
from planner.verify.joint_counts import DisplacedChecks, share_to_show

CAMERA = replace(Camera(8.0, (0.00345, 0.00345), (2448, 2048), 8.0, 400.0), f_number=2.0)
SIZE = (120.0, 80.0, 60.0)
WORKSPACE = [[-900.0] * 3, [1100.0] * 3]
SIGMA_MM = 1.5
ALONG_THE_AXIS = PoseUncertainty(np.diag([0.0, 0.0, SIGMA_MM**2, 0.0, 0.0, 0.0]))
REQUIRED = 0.9


def judge_of(names, uncertainty=ALONG_THE_AXIS, accuracy=0.9):
    space = BoxSpace(SIZE, WORKSPACE, names)
    return Judge(Problem(space, names, CAMERA, uncertainty, accuracy, REQUIRED))


def above_the_box(depth_mm):
    """A pose that looks down on the top, which is so far below it."""
    middle = np.array([SIZE[0] / 2, SIZE[1] / 2, SIZE[2]])
    return look_at(middle[None] + [0.0, 0.0, depth_mm], middle)[0]


def stated(judge, probability=REQUIRED):
    return dict.fromkeys(judge.names, probability)


def in_focus(judge, pose):
    """The least probability that both ends of an edge are in focus, by the normal distribution of the depth."""
    depth = world_to_cam(judge.problem.ends, pose)[..., 2]
    near, far = CAMERA.depth_of_field_mm
    tails = norm.sf((far - depth.max(axis=1)) / SIGMA_MM) + norm.sf(
        (depth.min(axis=1) - near) / SIGMA_MM
    )
    return float((1.0 - tails).min())


@pytest.mark.parametrize("limit", [0, 1])
def test_a_pose_at_the_end_of_the_depth_of_field_moves_into_it(limit):
    """At 0.7 standard deviations from either limit P(focus) is Φ(0.7) = 0.758; 0.9 is required."""
    judge = judge_of(("+z-y", "+z+x"))
    inward = 1.0 - 2.0 * limit
    start = above_the_box(CAMERA.depth_of_field_mm[limit] + inward * 0.7 * SIGMA_MM)
    assert in_focus(judge, start) == pytest.approx(norm.cdf(0.7), abs=1e-6)
    found = surer_pose(judge, start, stated(judge), seed=0)
    assert in_focus(judge, found) > share_to_show(REQUIRED)
    assert judge(found[None]).inspects.all()
    # only along the axis a shift changes what displaced poses show
    np.testing.assert_allclose(found[:3, :3], start[:3, :3], atol=1e-9)
    np.testing.assert_allclose(found[:2, 3], start[:2, 3], atol=1e-9)
    # draws that the search has not seen say the same
    counts = DisplacedChecks(judge.problem, judge.names).count(found, 20_000, seed=99)
    assert min(counts.lower.values()) > REQUIRED


def test_what_is_stated_is_aimed_at_too():
    """Where 0.999 is stated, 0.95 would contradict it: the pose moves farther from the limit."""
    judge = judge_of(("+z-y", "+z+x"))
    start = above_the_box(CAMERA.depth_of_field_mm[0] + 0.7 * SIGMA_MM)
    found = surer_pose(judge, start, stated(judge, 0.999), seed=0)
    assert in_focus(judge, found) > 0.99


def test_where_it_is_sure_enough_or_no_better_nothing_is_moved():
    judge = judge_of(("+z-y",))
    near, far = CAMERA.depth_of_field_mm
    assert surer_pose(judge, above_the_box((near + far) / 2), stated(judge), seed=0) is None
    # far out of focus all fail, and there is no slope
    assert surer_pose(judge, above_the_box(near - 30.0), stated(judge), seed=0) is None


def halves(climb, sides):
    """What holds if each target needs ``direction . z < limit`` of the draws; (n, k)."""
    return np.column_stack([climb._normal @ direction < limit for direction, limit in sides])


def shift_of(start, end):
    """The shift between two poses along the axes of the first, in standard deviations of 0.1 mm."""
    return (end[:3, 3] - start[:3, 3]) @ start[:3, :3] / 0.1


def test_a_step_leads_to_the_best_shift():
    """Success at z0 < 0.5 is as probable as Φ(0.5 - shift): the step goes down z0 as far as it may."""
    uncertainty = PoseUncertainty.isotropic(translation_mm=0.1, rotation_rad=0.001)
    judge = judge_of(("+z-y", "+z+x"), uncertainty)
    climb = _Climb(judge, stated(judge), seed=3)
    start = above_the_box(400.0)
    x, y = np.eye(6)[:2]
    one = climb.step(start, halves(climb, [(x, 0.5), (x, 1.0)]), length=1.0)
    assert shift_of(start, one)[0] == pytest.approx(-1.0, abs=1e-9)
    # two that pull apart meet in the middle: 0.5 - s = 1.5 + s at s = -0.5, whatever the length allows
    two = climb.step(start, halves(climb, [(x, 0.5), (-x, 1.5)]), length=3.0)
    assert shift_of(start, two)[0] == pytest.approx(-0.5, abs=0.1)
    # a direction of its own for each: both are taken
    both = climb.step(start, halves(climb, [(x, 0.0), (y, 0.0)]), length=1.0)
    np.testing.assert_allclose(shift_of(start, both)[:2], [-1.0, -1.0], atol=1e-9)


def test_what_a_count_is_to_show_is_what_its_bound_reaches():
    """It is a little above what is required: by the chance of a count of 20,000 poses, and by less than 1."""
    for required in (0.5, 0.9, 0.95, 0.99):
        share = share_to_show(required)
        assert required < share < required + 4.0 * np.sqrt(required * (1 - required) / 20_000)
    assert 0.9999 < share_to_show(0.9999) <= 1.0
    # more than can be counted is not asked for
    assert share_to_show(0.999999) <= 1.0
