"""An arm of each maker, in its proportions: joints of poses by independent matrices, and a program that drives it."""

import numpy as np
import pytest
from made_arms import ARMS, dh_forward, made_arm
from robot_cells import pose
from robot_programs import block, plan_of

from planner import Box, Cell, Fixturing, program_text, robot_program

CAM2FLANGE = pose((0.0, 0.0, 140.0))
LANGUAGES = {"abb": "rapid", "kuka_kr6": "krl", "ur5e": "urscript"}
# Abbes and Poisson (2024) find up to 16 for FANUC's CRX
MOST = {"fanuc_crx10ia": 16}


def language_of(name):
    return next((word for start, word in LANGUAGES.items() if name.startswith(start)), "ros")


@pytest.mark.parametrize("name", ARMS)
def test_joints_of_every_maker_are_found_from_their_poses(name):
    robot = made_arm(name)
    q = np.random.default_rng(8).uniform(robot.lower, robot.upper, (12, robot.n_joints))
    flanges = dh_forward(name, q)
    np.testing.assert_allclose(robot.forward(q), flanges, atol=1e-6)
    for joints, flange, branches in zip(q, flanges, robot.branches_of(flanges), strict=True):
        assert len(branches)
        assert np.abs(dh_forward(name, branches) - flange).max() < 1e-3
        assert (robot.to_limit_rad(branches) >= 0).all()
        if robot.n_joints == 6:
            assert len(branches) <= MOST.get(name, 8)
            turned = np.abs(branches - joints)
            turned = np.abs(turned - 2 * np.pi * np.round(turned / (2 * np.pi)))
            assert turned.max(axis=1).min() < 1e-4


@pytest.mark.parametrize("name", ARMS)
def test_every_maker_has_a_program(name):
    robot = made_arm(name)
    reach = robot.chain.reach_mm()[0]
    part2base = pose((0.6 * reach, -60.0, 0.0))
    camera = (Box((-20.0, -20.0, -60.0), (20.0, 20.0, 0.0)),)
    cell = Cell(
        robot,
        CAM2FLANGE,
        camera_body=camera,
        fixturings={"up": Fixturing(part2base)},
        clearance_mm=5.0,
    )
    inside = cell.with_part(block())
    q = np.random.default_rng(3).uniform(robot.lower, robot.upper, (400, robot.n_joints))
    q = q[inside.free(q, "up") & (robot.to_limit_rad(q) > 0.1)][:3]
    cameras = dh_forward(name, q[1:]) @ CAM2FLANGE
    plan = plan_of(np.linalg.inv(part2base) @ cameras)
    made = robot_program(plan, block(), cell.with_home(q[0]))
    assert made.complete
    for stop in made.tours[0].stops:
        reached = dh_forward(name, stop.joints[None])[0] @ CAM2FLANGE
        np.testing.assert_allclose(reached, cameras[stop.setting_idx], atol=1e-3)
    assert program_text(made, language_of(name))
