"""URDF files that are refused, in one line that says why, and what of a file counts."""

import pickle
import re

import numpy as np
import pytest
from robot_cells import PACKAGES, ROBOTS, from_text, made_robot, pose, urdf_text

from planner import Robot, RobotError

TEXT = urdf_text("made_wrist")
FOURTH = '<joint name="axis_4" type="revolute">'
LIMITS = '<limit lower="-3.4907" upper="3.4907" velocity="6.2832" effort="100"/>'
MESH = '<mesh filename="package://made_robots/cube.obj" scale="0.016 0.08 0.08"/>'
FINGER = (
    '<link name="finger"/><joint name="finger" type="revolute"><parent link="tool0"/>'
    '<child link="finger"/><limit lower="0" upper="1" velocity="1"/>'
)

CASES = {
    "prismatic": (FOURTH, FOURTH.replace("revolute", "prismatic"), "prismatic for joint 4"),
    "five": (FOURTH, FOURTH.replace("revolute", "fixed"), "must have six joints .* Got 5: axis_1"),
    "no limits": (LIMITS, "", "must state lower of joint 'axis_4'"),
    "no speed": (
        LIMITS,
        LIMITS.replace("velocity", "speed"),
        "must state velocity of joint 'axis_4'",
    ),
    "speed 0": (
        LIMITS,
        LIMITS.replace("6.2832", "0"),
        "positive velocity for joint 'axis_4'. Got 0; a cell file states it in .robot. as speeds",
    ),
    "limits swapped": (
        LIMITS,
        LIMITS.replace('"-3.4907"', '"4"'),
        "lower below upper for joint 'axis_4'. Got 4 and 3.4907",
    ),
    "no number": (LIMITS, LIMITS.replace('"3.4907"', '"x"'), "1 finite numbers for upper of joint"),
    "no axis": (
        '<axis xyz="0 0 1"/>',
        '<axis xyz="0 0 0"/>',
        "must have an axis for joint 'axis_1'",
    ),
    "in mm": ('xyz="0.1 0 0.615"', 'xyz="100 0 615"', "an arm that is 625 m long; are its lengths"),
    "mesh in mm": (
        MESH,
        MESH.replace('"0.016', '"300'),
        "a solid that is 300 m long; is its mesh in mm",
    ),
    "no package": ("made_robots", "other", "must name the folder of package 'other'"),
    "no mesh": (
        "cube.obj",
        "ball.obj",
        "must name meshes that exist: package://made_robots/ball.obj",
    ),
    "visual format": ("cube.obj", "cube.dae", "must name meshes that exist"),
    "doctype": ("<robot", '<!DOCTYPE robot [<!ENTITY a "b">]><robot', "must hold no DOCTYPE"),
    "xacro at another address": (
        "</robot>",
        '<x:include xmlns:x="http://wiki.ros.org/xacro" filename="a.xacro"/></robot>',
        "Got a xacro file; xacrodoc",
    ),
    "xacro": ('xyz="0.1 0 0.615"', 'xyz="${a} 0 0"', "Got a xacro file; xacrodoc"),
    "not XML": ("</robot>", "", "must be XML"),
    "another element": ("robot", "model", "must hold the element robot"),
    "no link": (
        '<child link="link_3"/>',
        '<child link="link_9"/>',
        "in joint 'axis_3'. Got 'link_9'",
    ),
    "two joints": (
        '<child link="link_3"/>',
        '<child link="link_2"/>',
        "must hang every link on one",
    ),
    "circle": (
        '<parent link="base_link"/>',
        '<parent link="tool0"/>',
        "must not close a circle of joints",
    ),
    "no geometry": (MESH, "", "must have a mesh, box, cylinder or sphere in link 'link_6'"),
    "negative box": (MESH, '<box size="1 -1 1"/>', "positive size for box of link 'link_6'"),
    "a box without one edge": (
        MESH,
        '<box size="1 0 1"/>',
        "positive size for box of link 'link_6'",
    ),
    "two links of one name": (
        '<link name="tool0"/>',
        '<link name="tool0"/><link name="link_6"/>',
        "'robot.urdf' must give every link a name of its own. Got 2 called 'link_6'",
    ),
    "two joints of one name": (
        FOURTH,
        FOURTH.replace("axis_4", "axis_3"),
        "'robot.urdf' must give every joint a name of its own. Got 2 called 'axis_3'",
    ),
    "second root": (
        '<link name="tool0"/>',
        '<link name="tool0"/><link name="gripper"/>',
        "'robot.urdf' must have one link that hangs on no joint. Got 2: 'base_link' and 'gripper'",
    ),
    "mimic in the chain": (
        FOURTH,
        FOURTH + '<mimic joint="axis_3"/>',
        "'robot.urdf' must have joints that move by themselves. Got mimic: joint 'axis_4' follows 'axis_3'",
    ),
    "mimic of the chain": (
        "</robot>",
        FINGER + '<mimic joint="axis_3"/></joint></robot>',
        "Got mimic: joint 'finger' follows 'axis_3'",
    ),
    "mimic with an offset": (
        "</robot>",
        FINGER + '<mimic joint="other" offset="0.1"/></joint></robot>',
        "Got mimic: joint 'finger' follows 'other'",
    ),
    "flat": (MESH, MESH.replace("0.016", "0"), "link 'link_6' must be a solid with a volume"),
}


@pytest.mark.parametrize("case", CASES)
def test_bad_files_are_refused(case, tmp_path):
    old, new, message = CASES[case]
    assert old in TEXT
    text = TEXT.replace(old, new)
    with pytest.raises(RobotError, match=message) as raised:
        from_text(tmp_path, text)
    assert "\n" not in str(raised.value)


def test_seven_joints_are_refused(tmp_path):
    tool = '<joint name="tool0_joint" type="fixed">'
    limits = '<limit lower="-1" upper="1" velocity="1"/>'
    text = TEXT.replace(tool, tool.replace("fixed", "revolute") + limits)
    with pytest.raises(RobotError, match=r"must have six joints between base and 'tool0'. Got 7"):
        from_text(tmp_path, text)


def test_a_missing_tip_names_the_links():
    with pytest.raises(
        RobotError, match=r"tip must be a link .* Got 'flange'; there are base_link, .*"
    ):
        Robot.from_urdf(ROBOTS / "made_wrist.urdf", tip="flange", packages=PACKAGES)


def test_a_base_that_moves_is_refused():
    with pytest.raises(
        RobotError, match=r"base must be a link before the first joint. Got 'link_2'"
    ):
        Robot.from_urdf(ROBOTS / "made_wrist.urdf", base="link_2", packages=PACKAGES)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(RobotError, match=re.escape(str(tmp_path / "no.urdf"))):
        Robot.from_urdf(tmp_path / "no.urdf")


@pytest.mark.parametrize("value", [0.0, -1.0, [1.0] * 5, "fast", [1.0] * 5 + [float("nan")]])
def test_accelerations_must_be_one_or_six(value):
    with pytest.raises(
        RobotError, match="accelerations must be a positive number of rad/s², or six"
    ):
        Robot.from_urdf(ROBOTS / "made_wrist.urdf", packages=PACKAGES, accelerations=value)


def test_accelerations_and_speeds_are_those_given():
    six = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
    robot = Robot.from_urdf(ROBOTS / "made_wrist.urdf", packages=PACKAGES, accelerations=six)
    np.testing.assert_array_equal(robot.accelerations, six)
    assert [joint.speed for joint in robot.joints] == [2.618] * 3 + [6.2832] * 2 + [7.854]
    assert robot.joints[1].name == "axis_2"
    assert (robot.joints[1].lower, robot.joints[1].upper) == (-1.7453, 1.9199)


def test_another_base_sees_the_same_tip(tmp_path):
    extra = (
        '<link name="pendant"/><joint name="p" type="fixed"><parent link="base_link"/>'
        '<child link="pendant"/><origin xyz="0.1 0.2 0.3" rpy="0 0 3.141592653589793"/></joint></robot>'
    )
    robot = from_text(tmp_path, TEXT.replace("</robot>", extra), base="pendant")
    q = np.array([0.3, 0.2, -0.4, 0.5, 0.8, -0.6])
    placed = pose((100.0, 200.0, 300.0), np.diag([-1.0, -1.0, 1.0]))
    np.testing.assert_allclose(
        placed @ robot.forward(q), made_robot("made_wrist").forward(q), atol=1e-9
    )


def test_what_is_fixed_behind_a_joint_moves_with_it(tmp_path):
    extra = (
        '<link name="gripper"><collision><geometry><sphere radius="0.05"/></geometry></collision></link>'
        '<joint name="g" type="fixed"><parent link="tool0"/><child link="gripper"/>'
        '<origin xyz="0 0 0.1"/></joint></robot>'
    )
    robot = from_text(tmp_path, TEXT.replace("</robot>", extra))
    assert [len(hulls) for hulls in robot.hulls] == [1] * 6 + [2]
    centre = robot.chain.tip @ [0.0, 0.0, 100.0, 1.0]
    distances = np.linalg.norm(robot.hulls[6][1].corners - centre[:3], axis=1)
    # the hull contains the ball, and little more
    assert distances.min() >= 50.0
    assert distances.max() < 52.0


def test_a_continuous_joint_has_a_turn_to_either_side(tmp_path):
    text = TEXT.replace(FOURTH, FOURTH.replace("revolute", "continuous"))
    robot = from_text(tmp_path, text)
    assert robot.joints[3].lower == -2 * np.pi
    assert robot.joints[3].upper == 2 * np.pi


def test_a_robot_that_was_packed_is_the_same():
    robot = made_robot("made_parallel")
    again = pickle.loads(pickle.dumps(robot))
    assert again.state_name == robot.state_name
    q = np.array([0.3, -1.0, 1.2, 0.5, 0.8, -0.6])
    np.testing.assert_array_equal(
        again.branches(again.forward(q)), robot.branches(robot.forward(q))
    )


def test_names_of_states_tell_robots_apart(tmp_path):
    robot = made_robot("made_wrist")
    slower = Robot.from_urdf(ROBOTS / "made_wrist.urdf", packages=PACKAGES, accelerations=1.0)
    other = from_text(tmp_path, TEXT.replace(MESH, MESH.replace("0.016", "0.017")))
    assert len({one.state_name for one in (robot, slower, other, made_robot("made_parallel"))}) == 4


@pytest.mark.parametrize(
    "comment",
    [
        '<!-- was: <xacro:include filename="$(find cell)/a.xacro"/> and ${width} -->',
        "<!-- <!DOCTYPE robot> -->",
    ],
)
def test_text_of_comments_does_not_count(comment, tmp_path):
    robot = from_text(tmp_path, TEXT.replace("</robot>", f"{comment}</robot>"))
    q = np.array([0.3, 0.2, -0.4, 0.5, 0.8, -0.6])
    np.testing.assert_array_equal(robot.forward(q), made_robot("made_wrist").forward(q))


def test_what_other_programs_replace_does_not_count(tmp_path):
    """Plugins of simulators hold such words in an expanded URDF."""
    plugin = "<gazebo><plugin><parameters>$(find cell)/a.yaml</parameters></plugin></gazebo>"
    assert from_text(tmp_path, TEXT.replace("</robot>", f"{plugin}</robot>")).notes == ()


def test_a_dummy_of_size_0_is_no_body(tmp_path):
    dummy = (
        '<link name="world"><collision><geometry><box size="0 0 0"/></geometry></collision></link>'
        '<joint name="stand" type="fixed"><parent link="world"/><child link="base_link"/></joint>'
    )
    robot = from_text(tmp_path, TEXT.replace("</robot>", f"{dummy}</robot>"))
    assert [len(hulls) for hulls in robot.hulls] == [1] * 7
    assert robot.notes == ("the box of link 'world' has size 0 and is no body",)


def test_a_finger_that_follows_a_finger_stands_at_zero(tmp_path):
    other = FINGER.replace("finger", "other") + "</joint>"
    text = TEXT.replace("</robot>", f'{other}{FINGER}<mimic joint="other"/></joint></robot>')
    assert len(from_text(tmp_path, text).joints) == 6


def test_speeds_may_come_from_elsewhere(tmp_path):
    text = re.sub('velocity="[0-9.]*"', 'velocity="0"', TEXT)
    with pytest.raises(RobotError, match="positive velocity for joint 'axis_1'"):
        from_text(tmp_path, text)
    robot = from_text(tmp_path, text, speeds=2.0)
    np.testing.assert_array_equal(robot.speeds, [2.0] * 6)
    again = pickle.loads(pickle.dumps(robot))
    np.testing.assert_array_equal(again.speeds, robot.speeds)
    assert again.state_name == robot.state_name
    assert robot.state_name != from_text(tmp_path, text, speeds=1.0).state_name
    with pytest.raises(RobotError, match="speeds must be a positive number of rad/s, or six"):
        from_text(tmp_path, text, speeds=[1.0, 2.0])
