"""All joints for a pose: checked by forward kinematics, by symmetries of wrists, and by joints a pose was made from."""

import itertools
import math
import pickle

import numpy as np
import pytest
from made_arms import made_arm
from robot_cells import NAMES, from_text, made_robot, pose, random_joints, urdf_text
from scipy.spatial.transform import Rotation

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


def test_an_arm_without_closed_form_is_solved_from_drawn_joints(tmp_path):
    text = urdf_text("made_wrist").replace(
        '<origin xyz="0.085 0 0"/>', '<origin xyz="0.085 0.03 0.02"/>'
    )
    text = text.replace('<axis xyz="0 1 0"/>', '<axis xyz="0.1 0.9 0.3"/>', 1)
    text = text.replace('<origin xyz="0.755 0 0"/>', '<origin xyz="0.755 0.05 0.01"/>')
    robot = from_text(tmp_path, text)
    q = random_joints(robot, np.random.default_rng(2), 40)
    refound = 0
    for joints, branches in zip(q, robot.branches_of(robot.forward(q)), strict=True):
        error = np.abs(robot.forward(branches) - robot.forward(joints))
        assert error.max(initial=0.0) < 1e-6
        turned = np.abs(branches - joints)
        gaps = np.abs(turned - 2 * np.pi * np.round(turned / (2 * np.pi))).max(axis=1)
        refound += gaps.min(initial=np.inf) < 1e-5
    assert refound >= 38


# Arms that nearly have a closed form: all joints of their poses, against kinematics of this file.
# The lengths are in the proportions of arms of several makers, the texts are made here. URDF
# files write 1.5708 for a right angle, turn single axes round, and hold what a calibration
# measured.


RIGHT = math.pi / 2
Z = (0.0, 0.0, 1.0)
# per joint: xyz in metres, rpy with r for a right angle and h for a half turn
PARALLEL = {
    "jaka": "0 0 .12015:0 0 0|0 0 0:r 0 0|.43 0 0:0 0 0|.3685 0 -.11401:0 0 0|0 -.1135 0:r 0 0|0 .1175 0:-r 0 0",
    "dobot": "0 0 .1765:0 0 0|0 0 0:r r 0|-.607 0 0:0 0 0|-.568 0 .191:0 0 -r|0 -.125 0:r 0 0|0 .1084 0:-r 0 0",
    "elite": "0 0 .14:0 0 0|0 0 0:r 0 h|.418 0 0:0 0 0|.398 0 .122:0 0 0|0 -.098 0:r 0 0|0 .089 0:-r 0 0",
    "fairino": "0 0 .14:0 0 0|0 0 0:r 0 0|-.28 0 0:0 0 0|-.24 0 .102:0 0 0|0 -.102 0:r 0 0|0 .1 0:-r 0 0",
    "elephant": "0 0 .1316:0 0 0|0 0 0:0 r -r|-.1104 0 0:0 0 0|-.096 0 .0646:0 0 -r|0 -.0732 0:r -r 0|0 .0456 0:-r 0 0",
    "aubo": "0 0 .122:0 0 h|0 .1215 0:-r -r 0|.408 0 0:-h 0 0|.376 0 0:h 0 r|0 .1025 0:-r 0 0|0 -.094 0:r 0 0",
    "ur": "0 0 .1625:0 0 0|0 0 0:r 0 0|-.425 0 0:0 0 0|-.3922 0 .1333:0 0 0|0 -.0997 0:r 0 0|0 .0996 0:r h h",
}
WRIST = {
    "doosan": "0 0 .1525:0 0 0|0 .0345 0:0 -r -r|.62 0 0:0 0 r|0 -.559 0:r 0 0|0 0 0:-r 0 0|0 -.121 0:r 0 0",
    "welder": "0 0 .4:0 0 0|.18 0 0:-r 0 0|0 -.6 0:0 0 0|.12 0 0:-r 0 0|0 0 .62:r 0 0|0 0 0:-r 0 0",
}
ARMS = PARALLEL | WRIST


class Made:
    """An arm as numbers, its file, and its kinematics."""

    def __init__(self, table, right=RIGHT, half=math.pi):
        signs = {"r": right, "h": half}
        joints = [joint.split(":") for joint in table.split("|")]
        self.xyz = np.array([[float(word) for word in joint[0].split()] for joint in joints])
        self.rpy = np.array(
            [[_angle(word, signs) for word in joint[1].split()] for joint in joints]
        )
        self.axes = np.tile(Z, (6, 1))

    def changed(self, xyz=0.0, rpy=0.0, signs=1.0):
        """Return the arm with lengths and angles added, and axes multiplied by signs."""
        arm = Made.__new__(Made)
        arm.xyz = self.xyz + xyz
        arm.rpy = self.rpy + rpy
        arm.axes = self.axes * np.reshape(signs, (-1, 1))
        return arm

    def text(self, limit=2 * math.pi):
        """Return the URDF."""
        parts = ['<robot name="made"><link name="base_link"/>']
        before = "base_link"
        for k in range(6):
            xyz, rpy, axis = (
                " ".join(map(repr, row.tolist()))
                for row in (self.xyz[k], self.rpy[k], self.axes[k])
            )
            name = "tool0" if k == 5 else f"l{k}"
            parts.append(
                f'<link name="{name}"/><joint name="j{k}" type="revolute"><parent link="{before}"/>'
                f'<child link="{name}"/><origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/>'
                f'<limit lower="{-limit!r}" upper="{limit!r}" velocity="2" effort="1"/></joint>'
            )
            before = name
        return "\n".join([*parts, "</robot>"])

    def forward(self, q):
        """Return the poses (n, 4, 4) of the tip, mm."""
        result = np.tile(np.eye(4), (len(q), 1, 1))
        for k in range(6):
            step = np.tile(np.eye(4), (len(q), 1, 1))
            fixed = Rotation.from_euler("xyz", self.rpy[k]).as_matrix()
            turn = Rotation.from_rotvec(q[:, k, None] * self.axes[k]).as_matrix()
            step[:, :3, :3] = fixed @ turn
            step[:, :3, 3] = 1000.0 * self.xyz[k]
            result = result @ step
        return result


def _angle(word, signs):
    number = word.strip("-")
    value = signs[number] if number in signs else float(number)
    return -value if word.startswith("-") else value


def drawn_near_arms(count, seed=1):
    """Return joints (n, 6) within a turn."""
    return np.random.default_rng(seed).uniform(-math.pi, math.pi, (count, 6))


def apart(branches, q):
    """Return how far the nearest of branches (k, 6) is from joints (6,), whole turns aside."""
    turned = branches - q
    turned -= 2 * math.pi * np.round(turned / (2 * math.pi))
    return np.abs(turned).max(axis=1).min(initial=np.inf)


def check(arm, robot, q):
    """Check that all branches lead to the poses of joints (n, 6); return branches, and the number found again."""
    flanges = arm.forward(q)
    found = robot.branches_of(flanges)
    for flange, branches in zip(flanges, found, strict=True):
        error = np.abs(arm.forward(branches) - flange)
        assert error[:, :3, 3].max(initial=0.0) < 1e-3
        assert error[:, :3, :3].max(initial=0.0) < 1e-6
    return found, sum(apart(*pair) < 1e-5 for pair in zip(found, q, strict=True))


@pytest.mark.parametrize("name", ARMS)
@pytest.mark.parametrize("digits", [2, 4, 8])
def test_angles_of_few_digits_cost_no_branches(tmp_path, name, digits):
    # 3 digits behind the point and more are usual, and 2 of them are still within 20 mrad: 1.57
    exact = Made(ARMS[name])
    rough = Made(ARMS[name], round(RIGHT, digits), round(math.pi, digits))
    q = drawn_near_arms(60)
    expected, all_of_them = check(exact, from_text(tmp_path, exact.text()), q)
    found, again = check(rough, from_text(tmp_path, rough.text()), q)
    assert all_of_them == 60
    assert again >= (57 if digits == 2 else 59)
    # two of them meet or part at the bound of what the arm reaches
    same = [len(a) == len(b) for a, b in zip(expected, found, strict=True)]
    assert sum(same) >= (52 if digits == 2 else 58)


@pytest.mark.parametrize("name", ARMS)
def test_lengths_off_by_their_last_digit_cost_no_branches(tmp_path, name):
    arm = Made(ARMS[name]).changed(xyz=np.random.default_rng(0).choice([-1e-5, 1e-5], (6, 3)))
    _, again = check(arm, from_text(tmp_path, arm.text()), drawn_near_arms(60))
    assert again >= 59


def test_turning_axes_round_negates_their_joints(tmp_path):
    arm = Made(PARALLEL["ur"])
    plain = from_text(tmp_path, arm.text())
    q = drawn_near_arms(5)
    flanges = arm.forward(q)
    expected = plain.branches_of(flanges)
    assert all(apart(*pair) < 1e-6 for pair in zip(expected, q, strict=True))
    for signs in itertools.product((1.0, -1.0), repeat=6):
        turned = from_text(tmp_path, arm.changed(signs=signs).text())
        for branches, others in zip(turned.branches_of(flanges), expected, strict=True):
            assert len(branches) == len(others)
            assert all(apart(others, q * signs) < 1e-6 for q in branches)


@pytest.mark.parametrize("name", ["ur", "welder"])
@pytest.mark.parametrize("seed", range(4))
def test_a_calibrated_arm_has_the_branches_of_the_nominal_one(tmp_path, name, seed):
    rng = np.random.default_rng(seed)
    nominal = Made(ARMS[name])
    arm = nominal.changed(rng.uniform(-5e-4, 5e-4, (6, 3)), rng.uniform(-1e-3, 1e-3, (6, 3)))
    q = drawn_near_arms(60)
    found, again = check(arm, from_text(tmp_path, arm.text()), q)
    assert again >= 57
    nominal_found, _ = check(nominal, from_text(tmp_path, nominal.text()), q)
    same = [len(a) == len(b) for a, b in zip(nominal_found, found, strict=True)]
    assert sum(same) >= 52
    # the nominal arm, driven by its own joints, misses by what was calibrated
    missed = arm.forward(q)[:, :3, 3] - nominal.forward(q)[:, :3, 3]
    assert 0.3 < np.linalg.norm(missed, axis=1).mean() < 5.0


@pytest.mark.parametrize("name", ARMS)
def test_the_pose_of_all_zeros_has_the_zeros_among_its_branches(tmp_path, name):
    for arm in (Made(ARMS[name]), Made(ARMS[name], 1.5708, 3.1416)):
        found, again = check(arm, from_text(tmp_path, arm.text()), np.zeros((1, 6)))
        assert len(found[0])
        assert again == 1


@pytest.mark.parametrize("name", ARMS)
def test_wrist_axes_in_line_keep_a_branch(tmp_path, name):
    q = drawn_near_arms(40)
    for fifth in (0.0, 1e-9, 1e-6, 1e-4):
        q[:, 4] = fifth
        for arm in (Made(ARMS[name]), Made(ARMS[name], 1.5708, 3.1416)):
            robot = from_text(tmp_path, arm.text())
            found, _ = check(arm, robot, q)
            assert all(len(branches) for branches in found)
            assert robot.solvable(arm.forward(q)).all()


def test_of_a_turning_wrist_the_joints_near_zero_stand_for_all():
    # the pose fixes the sum of two joints: the least squares halve it, or halve what a turn leaves of it
    robot = made_robot("made_wrist")
    q = np.array([0.3, 0.2, -0.4, 0.9, 0.0, -0.5])
    branches = robot.branches(robot.forward(q))
    straight = branches[np.abs(branches[:, 4]) < 1e-6]
    assert apart(straight, np.array([0.3, 0.2, -0.4, 0.2, 0.0, 0.2])) < 1e-5
    sums = straight[:, 3] + straight[:, 5] - 0.4
    np.testing.assert_allclose(sums / (2 * np.pi), np.round(sums / (2 * np.pi)), atol=1e-6)


def test_a_stretched_arm_keeps_its_branch(tmp_path):
    q = drawn_near_arms(40)
    q[:, 2] = 0.0
    for half in (RIGHT, 1.5708):
        arm = Made(PARALLEL["jaka"], half)
        found, _ = check(arm, from_text(tmp_path, arm.text()), q)
        assert all(len(branches) for branches in found)


@pytest.mark.parametrize("decimals", [11, 10, 9, 8, 6])
def test_a_pose_of_few_decimals_has_the_branches_of_the_pose(decimals):
    robot = made_robot("made_parallel")
    for flange in robot.forward(drawn_near_arms(50)):
        rounded = flange.copy()
        rounded[:3, :3] = np.round(flange[:3, :3], decimals)
        expected = robot.branches(flange)
        found = robot.branches(rounded)
        assert abs(len(found) - len(expected)) in (0, 2)
        for q in expected:
            bound = 10 * 10.0**-decimals / float(robot.singular_value(q[None])[0])
            assert bound > 0.1 or apart(found, q) < max(bound, 1e-6)


def test_the_nearest_rotation_is_the_polar_factor():
    from planner.robotcell.urdf import check_rotations

    poses = np.tile(np.eye(4), (50, 1, 1))
    poses[:, :3, :3] = Rotation.random(50, random_state=0).as_matrix()
    rounded = poses.copy()
    # all rotations of 6 decimals pass: 5e-7 in nine numbers is 1.74e-6 in their products at most
    rounded[:, :3, :3] = np.round(poses[:, :3, :3], 6)
    projected = check_rotations("poses", rounded)
    u, _, vt = np.linalg.svd(rounded[:, :3, :3])
    np.testing.assert_allclose(projected[:, :3, :3], u @ vt, atol=1e-15)
    np.testing.assert_array_equal(check_rotations("poses", projected), projected)
    np.testing.assert_array_equal(check_rotations("poses", np.eye(4)), np.eye(4))


@pytest.mark.parametrize("factor", [1 + 2e-6, 0.9, np.nan])
def test_what_is_no_rotation_is_refused(factor):
    robot = made_robot("made_parallel")
    flange = robot.forward(np.full(6, 0.5))
    flange[:3, :3] *= factor
    with pytest.raises(RobotError, match="flanges must hold a rotation"):
        robot.branches_of(flange[None])
    with pytest.raises(RobotError, match="flanges must hold a rotation"):
        robot.solvable(flange[None])


def test_an_arm_whose_joints_are_not_found_again_is_refused(tmp_path, monkeypatch):
    """The file is named, also after pickling."""
    from planner.robotcell.branches import Branches

    closed_form = Branches._closed_form

    def worse(self, tips):
        q, owner, is_flagged = closed_form(self, tips)
        return q[owner > 0] + 1.0, owner[owner > 0], is_flagged[owner > 0]

    robot = from_text(tmp_path, urdf_text())
    monkeypatch.setattr(Branches, "_closed_form", worse)
    for refused in (robot, pickle.loads(pickle.dumps(robot))):
        with pytest.raises(RobotError, match=r"robot .*robot\.urdf must be an arm"):
            refused.check_solvable()


def test_an_arm_without_closed_form_that_leads_back_to_other_joints_is_refused(monkeypatch):
    """With four starts for each pose, nearly all poses are solved, but many by other joints than the drawn ones."""
    from planner.robotcell import redundancy

    chain = made_arm("fanuc_crx10ia").chain
    turn = np.full(6, np.pi)
    assert redundancy.RedundantBranches(chain, -turn, turn)
    monkeypatch.setattr(redundancy, "_NEAREST_OF_SIX", 4)
    with pytest.raises(RobotError, match="must be an arm whose joints are found"):
        redundancy.RedundantBranches(chain, -turn, turn)


def test_a_welder_whose_wrist_does_not_meet_is_solved(tmp_path):
    arm = Made(WRIST["welder"]).changed(xyz=np.outer([0, 0, 0, 0, 0, 1], [0.05, 0.04, 0.0]))
    robot = from_text(tmp_path, arm.text())
    robot.check_solvable()
    _, again = check(arm, robot, drawn_near_arms(40))
    assert again >= 38


def test_limits_far_from_zero_and_at_the_joints_are_kept(tmp_path):
    arm = Made(PARALLEL["ur"])
    text = arm.text()
    low = f'lower="{-2 * math.pi!r}" upper="{2 * math.pi!r}"'
    assert text.count(low) == 6
    # the third joint turns between the fourth and the fifth half turn, and ends at the drawn one
    q = np.array([0.4, -1.0, 1.1, 0.3, 0.8, 0.2])
    far = from_text(tmp_path, _replaced(text, low, f'lower="12" upper="{1.1 + 4 * math.pi!r}"', 2))
    branches = far.branches(arm.forward(q[None])[0])
    assert np.abs(branches - q - np.eye(6)[2] * 4 * math.pi).max(axis=1).min() < 1e-9
    assert (far.to_limit_rad(branches) >= 0).all()


def _replaced(text, old, new, number):
    """Return a text in which one of several equal places is changed."""
    parts = text.split(old)
    return old.join(parts[: number + 1]) + new + old.join(parts[number + 1 :])


def test_a_hand_eye_of_nine_decimals_reaches_what_the_whole_one_does():
    from robot_cells import made_cell

    from planner import Cell

    q = np.radians([20.0, -80.0, 110.0, -30.0, 40.0, 10.0])
    turn = Rotation.from_euler("xyz", [1.0, 0.4, -0.7]).as_matrix()
    cell = made_cell()
    for decimals in (15, 9, 6):
        hand_eye = pose((0.0, 0.0, 90.0), np.round(turn, decimals))
        rounded = Cell(cell.robot, hand_eye, fixturings=dict(cell.fixturings))
        turned = rounded.cam2flange[:3, :3]
        np.testing.assert_allclose(turned @ turned.T, np.eye(3), atol=1e-15)
        cam2world = rounded.cam2world(q[None], "up")
        (answer,) = rounded.reach(cam2world, "up", all_branches=True)
        assert apart(answer.branches, q) < 1e-9
        # and so do poses of the camera that are rounded themselves
        (answer,) = rounded.reach(np.round(cam2world, decimals), "up", all_branches=True)
        assert apart(answer.branches, q) < 1e-3
    with pytest.raises(RobotError, match="cam2world must hold a rotation"):
        rounded.reach(1.001 * cam2world, "up")
