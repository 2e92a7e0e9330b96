"""All joints for a pose: checked by forward kinematics, by symmetries of wrists, and by joints a pose was made from."""

import numpy as np
import pytest
from robot_cells import NAMES, from_text, made_robot, pose, random_joints, urdf_text

from planner import RobotError


@pytest.fixture(scope="module", params=NAMES)
def drawn(request):
    """A robot, drawn joints, the poses they lead to, and the branches of these."""
    robot = made_robot(request.param)
    q = random_joints(robot, np.random.default_rng(5), 300)
    flanges = robot.forward(q)
    return robot, q, flanges, robot.branches_of(flanges)


def test_every_branch_leads_to_its_pose_within_limits(drawn):
    robot, _, flanges, found = drawn
    for flange, branches in zip(flanges, found, strict=True):
        error = np.abs(robot.forward(branches) - flange)
        assert error[:, :3, 3].max() < 1e-3
        assert error[:, :3, :3].max() < 1e-6
        assert (robot.to_limit_rad(branches) >= 0).all()


def test_there_are_at_most_eight(drawn):
    counts = {len(branches) for branches in drawn[3]}
    # the shoulder of the wrist robot cannot lean back far enough for the other four
    assert max(counts) == {"made_parallel": 8, "made_wrist": 4}[drawn[0].name]
    assert counts <= {2, 4, 6, 8}


def test_joints_a_pose_was_made_from_are_found(drawn):
    robot, q, _, found = drawn
    for joints, branches in zip(q, found, strict=True):
        turned = np.abs(branches - joints)
        turned = np.abs(turned - 2 * np.pi * np.round(turned / (2 * np.pi)))
        # where the arm is nearly singular, other joints lead to the same pose
        near = 1e-6 / float(robot.singular_value(joints[None])[0])
        assert turned.max(axis=1).min() < max(near, 1e-6)


def test_a_spherical_wrist_has_a_twin():
    robot = made_robot("made_wrist")
    q = np.array([0.3, 0.2, -0.4, 0.5, 0.8, -0.6])
    twin = q + np.array([0.0, 0.0, 0.0, -np.pi, -2 * 0.8, np.pi])
    branches = robot.branches(robot.forward(q))
    for one in (q, twin):
        assert np.abs(branches - one).max(axis=1).min() < 1e-9


def test_branches_are_in_one_order(drawn):
    robot, _, flanges, found = drawn
    order = np.random.default_rng(0).permutation(len(flanges))
    again = robot.branches_of(flanges[order])
    for number, branches in zip(order, again, strict=True):
        np.testing.assert_array_equal(branches, found[number])
        assert branches.tolist() == sorted(branches.tolist())


@pytest.mark.parametrize("name", NAMES)
def test_no_joints_lead_out_of_reach(name):
    robot = made_robot(name)
    assert robot.branches(pose((5000.0, 0.0, 0.0))).shape == (0, 6)
    assert robot.branches_of(np.empty((0, 4, 4))) == []


def test_limits_take_branches_away(tmp_path):
    text = urdf_text()
    free = made_robot("made_parallel")
    q = np.array([0.4, -1.0, 1.1, 0.3, 0.8, 0.2])
    flange = free.forward(q)
    assert (free.branches(flange)[:, 2] < 0).any()
    elbow = 'lower="-3.141592653589793" upper="3.141592653589793"'
    assert text.count(elbow) == 1
    bound = from_text(tmp_path, text.replace(elbow, 'lower="0.1" upper="3.14"'))
    left = bound.branches(flange)
    expected = [one for one in free.branches(flange).tolist() if 0.1 <= one[2] <= 3.14]
    np.testing.assert_allclose(left, expected, atol=1e-9)
    assert 0 < len(left) < len(free.branches(flange))


def test_limits_beyond_half_a_turn_are_met_by_a_whole_one(tmp_path):
    elbow = 'lower="-3.141592653589793" upper="3.141592653589793"'
    far = from_text(tmp_path, urdf_text().replace(elbow, 'lower="3.5" upper="6.2"'))
    q = np.array([0.4, -1.0, 5.0, 0.3, 0.8, 0.2])
    found = far.branches(far.forward(q))
    assert np.abs(found - q).max(axis=1).min() < 1e-9


def test_turns_are_all_whole_ones_within_limits():
    robot = made_robot("made_parallel")
    q = np.array([0.5, -1.0, 1.1, 0.3, 0.8, 0.2])
    turns = robot.turns(q)
    # two turns of each joint but the elbow, whose limits are half a turn
    assert len(turns) == 2**5
    np.testing.assert_array_equal(turns[0], q)
    np.testing.assert_allclose(
        robot.forward(turns), np.repeat(robot.forward(q)[None], 32, 0), atol=1e-9
    )
    assert len(np.unique(turns.round(6), axis=0)) == 32


def test_a_pose_must_be_one():
    with pytest.raises(RobotError, match=r"flange must have shape \(4, 4\)"):
        made_robot("made_wrist").branches(np.eye(3))


def test_an_arm_without_closed_form_is_refused(tmp_path):
    text = urdf_text("made_wrist").replace(
        '<origin xyz="0.085 0 0"/>', '<origin xyz="0.085 0.03 0.02"/>'
    )
    text = text.replace('<axis xyz="0 1 0"/>', '<axis xyz="0.1 0.9 0.3"/>', 1)
    text = text.replace('<origin xyz="0.755 0 0"/>', '<origin xyz="0.755 0.05 0.01"/>')
    robot = from_text(tmp_path, text)
    with pytest.raises(RobotError, match="spherical wrist or three parallel axes"):
        robot.branches(robot.forward(np.zeros(6)))
