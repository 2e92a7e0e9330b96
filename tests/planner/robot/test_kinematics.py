"""Where the links are: against a second reading of the file, and by hand."""

from xml.etree import ElementTree

import numpy as np
import pytest
from robot_cells import NAMES, ROBOTS, made_robot, random_joints
from scipy.spatial.transform import Rotation


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
