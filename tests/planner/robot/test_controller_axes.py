"""Axes that a controller counts in another way than the URDF: a parallel rod, by its own geometry."""

import json
import pickle
import re
from functools import cache
from itertools import product

import numpy as np
import pytest
from robot_cells import PACKAGES, ROBOTS, made_cell, made_robot, pose, random_joints, views
from robot_programs import FIXTURINGS, SIZE, block, plan_of

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
