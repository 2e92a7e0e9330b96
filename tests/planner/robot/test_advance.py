"""What is proven free around joints is free: by distances of many joints of the move."""

import numpy as np
import pytest
from robot_cells import CAM2FLANGE, NAMES, made_cell, made_robot, pose, random_joints

from planner import Box, Cell, Fixturing
from planner.robotcell.collisions import static_levers


def links_in_base(cell, q):
    """Corners of all moving bodies (n, c, 3) in the base, by their links' poses."""
    frames = cell.robot.chain.frames(q)
    return [
        frames[:, body.segment, None, :3, :3] @ body.hull.corners[None, :, :, None]
        + frames[:, body.segment, None, :3, 3, None]
        for body in cell._arm.bodies
    ]


@pytest.mark.parametrize("name", NAMES)
def test_no_corner_is_farther_from_an_axis_than_its_lever(name):
    cell = made_cell(name)
    robot = cell.robot
    q = random_joints(robot, np.random.default_rng(2), 300)
    frames = robot.chain.frames(q)
    levers = static_levers(robot.chain, cell._arm)
    corners = links_in_base(cell, q)
    for number, body in enumerate(cell._arm.bodies):
        for joint in range(body.segment):
            axis = frames[:, joint + 1, None, :3, 2]
            apart = corners[number][..., 0] - frames[:, joint + 1, None, :3, 3]
            farthest = np.linalg.norm(np.cross(apart, axis), axis=-1).max()
            assert farthest <= levers[joint, number] + 1e-9
            # an estimate that is far too large would be as true, and useless
            assert levers[joint, number] <= 3 * farthest + 100


@pytest.mark.parametrize("name", NAMES)
def test_proven_shares_are_free(name):
    rng = np.random.default_rng(3)
    cell = made_cell(name)
    q = random_joints(cell.robot, rng, 400)
    q = q[cell.free(q, "up")][:25]
    reach = np.full(1, 0.5)
    partly = 0
    for joints in q:
        turn = rng.uniform(-2, 2, 6)
        share = cell.free_shares(joints[None], turn, reach, 0.5, fixturing="up")[0]
        assert 0 < share <= 0.5
        partly += share < 0.5
        inside = rng.uniform(-share, share, 60)
        inside[:2] = [-share * (1 - 1e-9), share * (1 - 1e-9)]
        slack = cell.slack_bound(joints + inside[:, None] * turn, "up", 1.0, share=0.5)
        assert (slack > -1e-6).all()
    assert partly > 5


def test_joints_that_touch_something_are_not_free():
    cell = made_cell()
    q = random_joints(cell.robot, np.random.default_rng(4), 400)
    q = q[cell.slack_bound(q, "up", 1.0) < 0][:20]
    shares = cell.free_shares(q, np.full(6, 0.5), np.full(len(q), 0.5), 1.0, fixturing="up")
    assert (shares <= 0).all()


def test_a_turn_of_the_wrist_costs_only_the_hand():
    """The last joint moves the camera alone, so a wall near the elbow does not matter."""
    home = np.array([0.0, -1.2, 1.6, -1.9, -1.57, 0.0])
    elbow = made_robot("made_parallel").link_poses(home[None])[0, 3, :3, 3]
    low = np.array([-60.0, -60.0, 130.0])
    wall = Box(elbow + low, elbow + low * [-1.0, -1.0, 1.1])
    cell = Cell(
        made_robot("made_parallel"),
        CAM2FLANGE,
        fixturings={"up": Fixturing(pose((700.0, 0.0, 0.0)), {"wall": wall})},
        clearance_mm=1.0,
    )
    assert cell.clearance(home, "up").mm < 150
    turn = np.array([0.0, 0, 0, 0, 0, 0.5])
    assert cell.free_shares(home[None], turn, np.array([1.0]), 1.0, fixturing="up")[0] == 1.0
    turn = np.array([0.5, 0, 0, 0, 0, 0])
    assert cell.free_shares(home[None], turn, np.array([1.0]), 1.0, fixturing="up")[0] < 0.3
