"""URDF files that are refused, in one line that says why, and what of a file counts."""

import json
import pickle
import re
from functools import cache
from itertools import product
from xml.etree import ElementTree

import numpy as np
import pytest
from robot_cells import (
    NAMES,
    PACKAGES,
    ROBOTS,
    from_text,
    made_cell,
    made_robot,
    pose,
    random_joints,
    urdf_text,
    views,
)
from robot_programs import FIXTURINGS, SIZE, block, plan_of
from scipy.spatial.transform import Rotation

from planner import (
    Cell,
    Robot,
    RobotError,
    program_text,
    read_program,
    robot_program,
    write_program,
)
from planner.robotcell.arm import ControllerAxes
from planner.robotcell.urdf import collada_points, read_urdf

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
    "five": (
        FOURTH,
        FOURTH.replace("revolute", "fixed"),
        "must have six or seven joints .* Got 5: axis_1",
    ),
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


def test_limits_in_degrees_are_noticed(tmp_path):
    text = TEXT.replace('lower="-1.7453" upper="1.9199"', 'lower="-100" upper="110"')
    assert text != TEXT
    with pytest.raises(
        RobotError, match=r"limits of joint 'axis_2' .* Got -100 and 110 rad; are they in degrees"
    ):
        from_text(tmp_path, text)


def test_eight_joints_are_refused(tmp_path):
    tool = '<joint name="tool0_joint" type="fixed">'
    limits = '<limit lower="-1" upper="1" velocity="1"/>'
    more = (
        '<link name="wrist"/><joint name="one_more" type="revolute"><parent link="wrist"/>'
        f'<child link="tool0"/>{limits}</joint>'
    )
    text = TEXT.replace(tool, tool.replace("fixed", "revolute") + limits)
    text = text.replace('<child link="tool0"/>', '<child link="wrist"/>')
    text = text.replace("</robot>", f"{more}</robot>")
    with pytest.raises(
        RobotError, match=r"must have six or seven joints between base and 'tool0'. Got 8"
    ):
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
        RobotError, match="accelerations must be a positive number of rad/s², or one for each joint"
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
    with pytest.raises(
        RobotError, match="speeds must be a positive number of rad/s, or one for each joint"
    ):
        from_text(tmp_path, text, speeds=[1.0, 2.0])


# Where the links are: against a second reading of the file, and by hand.


def second_reading(name, q):
    """Return the pose of the tip, straight from the file's elements, joint after joint."""
    root = ElementTree.parse(ROBOTS / f"{name}.urdf").getroot()
    result = np.eye(4)
    angles = iter(q)
    for joint in root.findall("joint"):
        origin = joint.find("origin")
        step = np.eye(4)
        numbers = [float(word) for word in origin.get("xyz", "0 0 0").split()]
        step[:3, 3] = 1000.0 * np.array(numbers)
        fixed = [float(word) for word in origin.get("rpy", "0 0 0").split()]
        step[:3, :3] = Rotation.from_euler("xyz", fixed).as_matrix()
        if joint.get("type") == "revolute":
            axis = np.array([float(word) for word in joint.find("axis").get("xyz").split()])
            turn = np.eye(4)
            turn[:3, :3] = Rotation.from_rotvec(next(angles) * axis).as_matrix()
            step = step @ turn
        result = result @ step
    return result


@pytest.mark.parametrize("name", NAMES)
def test_forward_kinematics_are_those_of_the_file(name):
    robot = made_robot(name)
    q = random_joints(robot, np.random.default_rng(1), 50)
    expected = [second_reading(name, one) for one in q]
    np.testing.assert_allclose(robot.forward(q), expected, atol=1e-9)
    np.testing.assert_allclose(robot.forward(q[0]), expected[0], atol=1e-9)


def test_the_tip_at_zero_is_where_the_lengths_add_up_to():
    tip = made_robot("made_parallel").forward(np.zeros(6))
    np.testing.assert_allclose(tip[:3, 3], (612.7 + 571.55, -174.15 - 116.55, 180.7 - 119.85))
    # the tool looks along -y
    np.testing.assert_allclose(tip[:3, 2], (0.0, -1.0, 0.0), atol=1e-15)


@pytest.mark.parametrize("elbow", [0.3, 1.2, 2.4, -0.9])
def test_the_wrist_of_a_planar_arm_obeys_the_law_of_cosines(elbow):
    robot = made_robot("made_parallel")
    q = np.array([0.4, -0.8, elbow, 0.2, 0.0, 0.0])
    links = robot.link_poses(q[None])[0]
    shoulder = links[2, :3, 3]
    wrist = links[4, :3, 3]
    # the wrist is beside the plane of the two long links
    apart = np.linalg.norm(wrist - shoulder) ** 2 - 174.15**2
    a = 612.7
    b = 571.55
    assert apart == pytest.approx(a**2 + b**2 + 2 * a * b * np.cos(elbow), rel=1e-12)


@pytest.mark.parametrize("name", NAMES)
def test_the_jacobian_is_the_derivative_of_the_tip(name):
    robot = made_robot(name)
    q = random_joints(robot, np.random.default_rng(2), 10)
    step = 1e-6
    for joint in range(6):
        moved = q.copy()
        back = q.copy()
        moved[:, joint] += step
        back[:, joint] -= step
        after = robot.forward(moved)
        before = robot.forward(back)
        speed = (after[:, :3, 3] - before[:, :3, 3]) / (2 * step)
        turn = (
            Rotation.from_matrix(after[:, :3, :3]) * Rotation.from_matrix(before[:, :3, :3]).inv()
        )
        jacobian = robot.jacobian(q)[:, :, joint]
        np.testing.assert_allclose(jacobian[:, :3], speed, atol=1e-4)
        np.testing.assert_allclose(jacobian[:, 3:], turn.as_rotvec() / (2 * step), atol=1e-7)


def test_a_stretched_arm_is_singular():
    robot = made_robot("made_parallel")
    stretched = np.array([[0.3, -0.5, 0.0, 0.4, 1.0, 0.2]])
    bent = np.array([[0.3, -1.2, 1.6, 0.4, 1.0, 0.2]])
    assert robot.singular_value(stretched)[0] < 1e-9
    assert robot.singular_value(bent)[0] > 0.05


def test_wrist_axes_in_line_are_singular():
    straight = np.array([[0.3, -0.5, 0.4, 0.4, 0.0, 0.2]])
    assert made_robot("made_wrist").singular_value(straight)[0] < 1e-9


def test_the_distance_to_limits_is_that_of_the_nearest_joint():
    robot = made_robot("made_wrist")
    q = np.zeros((2, 6))
    q[1, 3] = robot.upper[3] + 0.25
    np.testing.assert_allclose(robot.to_limit_rad(q), [1.0472, -0.25])


# Axes that a controller counts in another way than the URDF: a parallel rod, by its own geometry.


ROD = [(3, 2, 1.0)]
HOME = (0.0, 0.1, -0.2, 0.0, 1.2, 0.0)


@cache
def rod_robot(**options):
    return Robot.from_urdf(
        ROBOTS / "made_wrist.urdf",
        packages=PACKAGES,
        coupled=ROD,
        **{k: [v] for k, v in options.items()},
    )


def turn(axis, angle):
    """Rotation about x, y or z, written out."""
    c = np.cos(angle)
    s = np.sin(angle)
    first, second = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    found = np.eye(3)
    found[first, first] = found[second, second] = c
    found[first, second] = -s
    found[second, first] = s
    return found


def rod_forward(axes):
    """Pose of the tip by the geometry of the arm, mm: axis 3 is the forearm's angle to the horizon.

    615 mm up and 100 mm out to axis 2; 705 mm of upper arm; forearm 135 mm up and 755 mm out; 85 mm of hand.
    """
    base = turn("z", axes[0])
    forearm = base @ turn("y", axes[2])
    hand = forearm @ turn("x", axes[3]) @ turn("y", axes[4])
    place = np.array([0.0, 0.0, 615.0]) + base @ [100.0, 0.0, 0.0]
    place += base @ turn("y", axes[1]) @ [0.0, 0.0, 705.0]
    place += forearm @ [755.0, 0.0, 135.0] + hand @ [85.0, 0.0, 0.0]
    return pose(place, hand @ turn("x", axes[5]) @ turn("y", np.pi / 2))


def test_axes_of_a_rod_lead_to_the_same_pose():
    robot = rod_robot()
    for joints in random_joints(robot, np.random.default_rng(1), 20):
        axes = robot.controller.of(joints)
        np.testing.assert_allclose(rod_forward(axes), robot.forward(joints), atol=1e-8)
        np.testing.assert_allclose(robot.controller.joints(axes), joints, atol=1e-12)


def test_a_rod_keeps_the_hand_level_while_joint_2_turns():
    robot = rod_robot()
    axes = np.array([[0.3, angle, 0.2, 0.1, 0.5, 0.0] for angle in (-0.4, 0.0, 0.4)])
    tips = robot.forward(robot.controller.joints(axes))
    np.testing.assert_allclose(tips[0, :3, :3], tips[2, :3, :3], atol=1e-12)


@cache
def rod_cell(**options):
    return made_cell_of(rod_robot(**options))


def made_cell_of(robot):
    known = made_cell("made_wrist", fixturings=FIXTURINGS)
    state = known.__getstate__()
    state.pop("part")
    return Cell(**{**state, "robot": robot, "home": HOME})


@cache
def rod_poses():
    poses = views(np.random.default_rng(3), 30, SIZE)
    known = rod_cell().with_part(block())
    return np.array(
        [one for one, found in zip(poses, known.reach(poses, "up"), strict=True) if found.reached]
    )


@cache
def rod_program():
    return robot_program(plan_of(rod_poses()[:3]), block(), rod_cell())


def rapid_axes(text):
    return {
        name: np.radians([float(angle) for angle in angles.split(",")])
        for name, angles in re.findall(r"jointtarget (\w+):=\[\[(.*?)\]", text)
    }


def krl_axes(text):
    return [
        np.radians([float(word.split()[1]) for word in words.split(",")])
        for words in re.findall(r"PTP \{(.*?)\}", text)
    ]


def test_controllers_are_given_their_own_axes():
    """The images of the program are taken where the rod's own geometry puts the flange."""
    rows = [r for tour in rod_program().tours for m in tour.moves for r in m.joints[1:]]
    tips = rod_cell().robot.forward(np.array(rows))
    rapid = rapid_axes(program_text(rod_program(), "rapid"))
    np.testing.assert_allclose(
        rod_forward(rapid.pop("jHome")), rod_cell().robot.forward(HOME), atol=1e-4
    )
    script = re.findall(r"movej\(\[(.*?)\]", program_text(rod_program(), "urscript"))
    texts = {
        "rapid": list(rapid.values()),
        "urscript": [[float(angle) for angle in words.split(",")] for words in script],
    }
    for axes in texts.values():
        assert len(axes) == len(rows)
        np.testing.assert_allclose([rod_forward(one) for one in axes], tips, atol=1e-4)
    homes = len(rod_program().tours)
    assert len(krl_axes(program_text(rod_program(), "krl"))) == len(rows) + homes
    np.testing.assert_allclose(
        rod_forward(krl_axes(program_text(rod_program(), "krl"))[1]), tips[0], atol=1e-4
    )


def test_a_coupled_axis_that_leads_has_its_own_rate():
    """Time from the rates in the text and the way of the farthest axis, by hand."""
    here = rod_program().controller.of(np.array(HOME))
    seconds = 0.0
    text = program_text(rod_program(), "urscript")
    for words, a, v in re.findall(r"movej\(\[(.*?)\], a=(.*), v=(.*)\)", text):
        there = np.array([float(angle) for angle in words.split(",")])
        way = np.abs(there - here).max()
        rise = float(a)
        top = float(v)
        seconds += way / top + top / rise if way > top**2 / rise else 2 * np.sqrt(way / rise)
        here = there
    assert seconds == pytest.approx(rod_program().seconds, rel=1e-4)


def test_ros_keeps_the_joints_and_tables_name_both():
    data = json.loads(program_text(rod_program(), "ros"))
    assert data["start_at"]["positions"] == list(HOME)
    assert any("driver of the robot must couple" in line for line in data["about"])
    table = program_text(rod_program(), "csv")
    lines = [line.split(",") for line in table.splitlines() if not line.startswith("#")]
    assert lines[0][-1] == "axis_3_of_controller_rad"
    for row in lines[1:]:
        # fixturing, step, seconds, setting and image stand before the joints
        assert float(row[6]) + float(row[7]) == pytest.approx(float(row[-1]), abs=2e-8)


@pytest.mark.parametrize("language", ["rapid", "krl", "urscript", "csv", "ros"])
def test_the_head_says_which_axis_is_coupled(language):
    text = program_text(rod_program(), language)
    assert "Axis 3 of the controller is joint 3 + 1 x joint 2." in text


def test_a_program_file_keeps_the_coupling(tmp_path):
    again = read_program(write_program(rod_program(), tmp_path / "program.json"))
    assert again.controller.coupled == ((3, 2, 1.0),)
    assert program_text(again, "rapid") == program_text(rod_program(), "rapid")


def test_limits_of_an_axis_hold_for_poses_and_moves():
    high = float(np.sort([ControllerAxes(ROD).of(q)[2] for q in stop_joints(rod_program())])[-1])
    limit = (3, -1.0472, high - 0.01)
    narrow = rod_cell(axis_limits=limit)
    assert narrow.state_name != rod_cell().state_name
    assert pickle.loads(pickle.dumps(narrow.robot)).controller.limits == (limit,)
    found = robot_program(plan_of(rod_poses()[:3]), block(), narrow)
    for tour in found.tours:
        for move in tour.moves:
            third = move.joints[:, 2] + move.joints[:, 1]
            assert (third <= limit[2]).all()
            assert (third >= limit[1]).all()
    joints = random_joints(narrow.robot, np.random.default_rng(2), 50)
    inside = narrow.robot.to_limit_rad(joints) >= 0
    sums = joints[:, 1] + joints[:, 2]
    np.testing.assert_array_equal(inside, (sums >= limit[1]) & (sums <= limit[2]))


def stop_joints(program):
    return [stop.joints for tour in program.tours for stop in tour.stops]


def test_an_uncoupled_robot_is_the_one_of_before():
    plain = made_robot("made_wrist")
    assert plain.controller.is_plain
    assert plain.state_name != rod_robot().state_name
    assert "coupled" not in json.dumps(
        robot_program(plan_of(rod_poses()[:1]), block(), made_cell_of(plain)).to_dict()
    )


@pytest.mark.parametrize(
    ("coupled", "limits", "message"),
    [
        (3, [], "coupled must hold three numbers each"),
        ([3, 2, 1.0], [], "coupled must hold three numbers each"),
        ([[3, 2]], [], "coupled must hold three numbers each"),
        ([["3", 2, 1.0]], [], "coupled must hold three numbers each"),
        ([[7, 2, 1.0]], [], "coupled must begin with the number of an axis, from 1 to 6"),
        ([[2.5, 2, 1.0]], [], "coupled must begin with the number of an axis"),
        ([[3, 3, 1.0]], [], "coupled must name another joint"),
        ([[3, 2.5, 1.0]], [], "coupled must name another joint"),
        ([[3, 2, 0.0]], [], "coupled must have a factor that is not 0"),
        ([[3, 2, 1e300]], [], "coupled must have a factor that is not 0 and at most 10"),
        ([[3, 2, float("nan")]], [], "coupled must be finite"),
        ([[3, 2, 1.0], [3, 2, 1.0]], [], "coupled must name a pair once"),
        ([[3, 2, 1.0], [2, 3, 1.0]], [], "coupled must leave joints that follow from the axes"),
        ([], [[3, 1.0, -1.0]], "axis_limits must go from a smaller angle to a larger one"),
        ([], [[3, 1.0]], "axis_limits must hold three numbers each"),
    ],
)
def test_what_cannot_be_is_refused(coupled, limits, message):
    with pytest.raises(RobotError, match=message):
        ControllerAxes(coupled, limits)


def test_a_box_of_axes_is_within_its_spread_of_joints():
    """Of all corners of a box of the axes, none has a joint farther off than the spread says."""
    axes = ControllerAxes([(3, 2, 1.0), (4, 3, -0.5)])
    corners = np.array(list(product((-1.0, 1.0), repeat=6)))
    farthest = np.abs(axes.joints(corners)).max(axis=0)
    assert (axes.spread() >= farthest - 1e-12).all()
    assert axes.spread()[2] == pytest.approx(2.0)


def test_the_link_base_is_the_frame_of_the_pendant():
    text = urdf_text()
    base = (
        '<link name="base"/><joint name="base_link-base" type="fixed"><parent link="base_link"/>'
        '<child link="base"/><origin xyz="0 0 0.1" rpy="0 0 3.141592653589793"/></joint></robot>'
    )
    arm = read_urdf(text.replace("</robot>", base), "tool0")
    expected = np.diag([-1.0, -1.0, 1.0, 1.0])
    expected[2, 3] = 100.0
    np.testing.assert_allclose(arm.pendant, expected, atol=1e-9)
    assert read_urdf(text, "tool0").pendant is None


# Meshes of COLLADA.


DAE = """<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
 <asset>{asset}</asset>
 <library_geometries><geometry id="box"><mesh>
  <source id="corners"><float_array id="numbers" count="24">
   0 0 0 2 0 0 0 3 0 2 3 0 0 0 5 2 0 5 0 3 5 2 3 5</float_array></source>
  <vertices id="points"><input semantic="POSITION" source="#corners"/></vertices>
 </mesh></geometry></library_geometries>
 <library_visual_scenes><visual_scene id="scene">{nodes}</visual_scene></library_visual_scenes>
 <scene><instance_visual_scene url="#scene"/></scene>
</COLLADA>"""
INSTANCE = '<instance_geometry url="#box"/>'


def span(asset, nodes):
    points = collada_points(DAE.format(asset=asset, nodes=nodes).encode(), "a.dae")
    return points.min(axis=0).tolist(), points.max(axis=0).tolist()


def test_corners_of_collada_are_where_its_nodes_put_them():
    z_up = "<up_axis>Z_UP</up_axis>"
    # in ROS z of the file is z of the link, whatever points up in the program that wrote it
    for asset in (z_up, "<up_axis>Y_UP</up_axis>", "<up_axis>X_UP</up_axis>", ""):
        assert span(asset, f"<node>{INSTANCE}</node>") == ([0, 0, 0], [2, 3, 5])
    millimetres = f'<unit name="mm" meter="0.001"/>{z_up}'
    np.testing.assert_allclose(
        span(millimetres, f"<node>{INSTANCE}</node>"), [[0, 0, 0], [0.002, 0.003, 0.005]]
    )
    # first scaled, then turned from x to y, then shifted; the parent shifts once more
    inner = "<node><translate>10 0 0</translate><rotate>0 0 1 90</rotate><scale>1 2 1</scale>"
    nodes = f"<node><matrix>1 0 0 0 0 1 0 0 0 0 1 7 0 0 0 1</matrix>{inner}{INSTANCE}</node></node>"
    np.testing.assert_allclose(span(z_up, nodes), [[4, 0, 7], [10, 2, 12]], atol=1e-12)


def test_links_with_collada_are_those_with_other_meshes(tmp_path):
    # cube.obj reaches from -0.5 to 0.5
    centred = f"<node><translate>-1 -1.5 -2.5</translate>{INSTANCE}</node>"
    content = DAE.format(asset="<up_axis>Z_UP</up_axis>", nodes=centred)
    (tmp_path / "box.dae").write_text(content, encoding="utf-8")
    text = urdf_text("made_wrist")
    cube = 'filename="package://made_robots/cube.obj" scale="0.45 0.36 0.34"'
    assert cube in text
    text = text.replace(cube, 'filename="box.dae" scale="0.225 0.12 0.068"')
    read = from_text(tmp_path, text)
    plain = made_robot("made_wrist")
    for hulls, others in zip(read.hulls, plain.hulls, strict=True):
        for hull, other in zip(hulls, others, strict=True):
            corners = [np.unique(points.corners.round(6), axis=0) for points in (hull, other)]
            np.testing.assert_allclose(*corners, atol=1e-5)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("<COLLADA/>", "must have a scene with geometry"),
        ("<robot/>", "must hold the element COLLADA"),
        ("<!DOCTYPE x [<!ENTITY e '1'>]><COLLADA/>", "must hold no DOCTYPE"),
        ("<COLLADA", "must be XML"),
        (DAE.format(asset='<unit meter="one"/>', nodes=""), "unit of a.dae"),
        (
            DAE.format(asset="", nodes=f"<node>{INSTANCE}</node>").replace("3 5</f", "3 x</f"),
            "finite numbers",
        ),
        (
            DAE.format(asset="", nodes=f"<node>{INSTANCE}</node>").replace(" 5</f", "</f"),
            "24 finite numbers",
        ),
    ],
)
def test_wrong_collada_is_refused(content, message):
    with pytest.raises(RobotError, match=message):
        collada_points(content.encode(), "a.dae")


def test_a_package_is_found_where_makers_keep_it(tmp_path):
    """The URDF in its package, or beside it; a folder above the package is named as such."""
    package = tmp_path / "maker"
    (package / "urdf").mkdir(parents=True)
    (package / "meshes").mkdir()
    (package / "meshes" / "a.obj").write_bytes((ROBOTS / "cube.obj").read_bytes())
    text = urdf_text("made_wrist").replace("made_robots/cube.obj", "maker/meshes/a.obj")
    for folder in (package / "urdf", tmp_path):
        (folder / "arm.urdf").write_text(text, encoding="utf-8")
        assert Robot.from_urdf(folder / "arm.urdf").n_joints == 6
    message = (
        r"packages\.maker must be its folder\. Got the folder above it.*the package is .*maker"
    )
    with pytest.raises(RobotError, match=message):
        Robot.from_urdf(tmp_path / "arm.urdf", packages={"maker": tmp_path})
    (package / "meshes" / "a.obj").unlink()
    with pytest.raises(RobotError, match="packages must name the folder of package 'maker'"):
        Robot.from_urdf(tmp_path / "arm.urdf")
