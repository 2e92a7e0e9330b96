"""Arms of seven joints: turns about axes written here, the circle of the elbow, and cells and programs with them."""

import math
from functools import cache

import numpy as np
import pytest
from made_arms import ARMS, made_arm
from robot_cells import pose, views
from robot_programs import SIZE, block, plan_of

from planner import (
    ArmUncertainty,
    Box,
    Cell,
    Fixturing,
    RequestError,
    RobotError,
    program_text,
    read_poses,
    robot_program,
    write_program,
)

COUNTS = {"kuka_iiwa": 200, "franka": 200, "kinova_gen3": 60, "sawyer": 50}
SEVEN = tuple(COUNTS)
HOME = np.radians([0.0, 20.0, 0.0, -90.0, 0.0, 70.0, 0.0])


def forward(name, joints):
    """Poses of the tip by the matrices of Denavit and Hartenberg, without planner.robotcell."""
    rows, flange_mm, _ = ARMS[name]
    poses = np.tile(np.eye(4), (len(joints), 1, 1))
    for k, (a, alpha, d, theta, *_) in enumerate(rows):
        c = np.cos(joints[:, k] + math.radians(theta))
        s = np.sin(joints[:, k] + math.radians(theta))
        ca = math.cos(math.radians(alpha))
        sa = math.sin(math.radians(alpha))
        step = np.zeros((len(joints), 4, 4))
        step[:, 0] = np.stack([c, -s, 0 * c, 0 * c + a], axis=1)
        step[:, 1] = np.stack([s * ca, c * ca, 0 * c - sa, 0 * c - sa * d], axis=1)
        step[:, 2] = np.stack([s * sa, c * sa, 0 * c + ca, 0 * c + ca * d], axis=1)
        step[:, 3, 3] = 1.0
        poses = poses @ step
    tip = np.eye(4)
    tip[2, 3] = flange_mm
    return poses @ tip


def drawn(name, count, seed=5):
    robot = made_arm(name)
    q = np.random.default_rng(seed).uniform(robot.lower, robot.upper, (count, 7))
    return robot, q, forward(name, q)


@pytest.mark.parametrize(("name", "count"), list(COUNTS.items()))
def test_poses_of_drawn_joints_are_solved_exactly(name, count):
    robot, _, flanges = drawn(name, count)
    solutions = robot.branches_of(flanges)
    assert sum(map(len, solutions)) > 5 * count
    assert np.mean([len(q) > 0 for q in solutions]) >= 0.99
    for flange, q in zip(flanges, solutions, strict=True):
        error = np.abs(forward(name, q) - flange)
        assert error[:, :3, 3].max(initial=0.0) < 1e-6
        assert error[:, :3, :3].max(initial=0.0) < 1e-9
        assert (robot.to_limit_rad(q) >= 0).all()


@pytest.mark.parametrize("name", SEVEN)
def test_what_is_out_of_reach_is_refused(name):
    robot, _, flanges = drawn(name, 5)
    flanges[:, :3, 3] *= (
        2.0 * robot.chain.reach_mm()[0] / np.linalg.norm(flanges[:, :3, 3], axis=1)[:, None]
    )
    assert all(len(q) == 0 for q in robot.branches_of(flanges))
    assert not robot.solvable(flanges).any()


def test_elbows_of_a_pose_lie_on_a_circle_all_around():
    robot, _, flanges = drawn("kuka_iiwa", 40)
    shoulder = np.array([0.0, 0.0, 360.0])
    filled = 0
    for flange, q in zip(flanges, robot.branches_of(flanges), strict=True):
        wrist = flange[:3, 3] - 126.0 * flange[:3, 2]
        line = wrist - shoulder
        length = np.linalg.norm(line)
        # law of cosines with an upper arm of 420 mm and a forearm of 400 mm
        along = (length**2 + 420.0**2 - 400.0**2) / (2 * length)
        elbows = robot.link_poses(q)[:, 4, :3, 3] - shoulder
        np.testing.assert_allclose(elbows @ line / length, along, atol=1e-6)
        radius = math.sqrt(420.0**2 - along**2)
        across = elbows - along * line / length
        np.testing.assert_allclose(np.linalg.norm(across, axis=1), radius, atol=1e-6)
        first = across[0] / radius
        second = np.cross(line / length, first)
        angles = np.sort(np.degrees(np.arctan2(across @ second, across @ first)) % 360)
        gaps = np.diff(np.append(angles, angles[0] + 360))
        filled += gaps.max() < 15.1
    # limits of joints take pieces out of some circles
    assert 4 <= filled < 40


def test_the_curve_is_moved_into_limits_that_leave_little_of_it():
    _, q, flanges = drawn("kuka_iiwa", 20)
    narrow = made_arm("kuka_iiwa", around=tuple(q[0]), within=0.02)
    solutions = narrow.branches(flanges[0])
    assert len(solutions) >= 1
    assert np.abs(solutions - q[0]).max() <= 0.02 + 1e-9


def test_the_uncertainty_of_seven_joints_is_that_of_drawn_ones():
    robot, q, _ = drawn("franka", 1)
    cam2flange = pose((20.0, 0.0, 90.0))
    sigma = np.linspace(1e-4, 4e-4, 7)
    stated = ArmUncertainty(sigma).covariances(robot, q, cam2flange, np.eye(4))[0]
    rng = np.random.default_rng(1)
    cameras = forward("franka", q + sigma * rng.normal(size=(20_000, 7))) @ cam2flange
    at = (forward("franka", q) @ cam2flange)[0]
    moved = np.einsum("ji,njk->nik", at[:3, :3], cameras[:, :3, :3])
    turns = np.stack([moved[:, 2, 1], moved[:, 0, 2], moved[:, 1, 0]], axis=1)
    shifts = (cameras[:, :3, 3] - at[:3, 3]) @ at[:3, :3]
    measured = np.cov(np.concatenate([shifts, turns], axis=1).T)
    size = np.sqrt(np.diag(stated))
    np.testing.assert_allclose(
        measured / np.outer(size, size), stated / np.outer(size, size), atol=0.05
    )


@cache
def seven_cell(turns=False, posts=()):
    table = {"axis": ((550.0, 0.0, 0.0), (0.0, 0.0, 1.0)), "angles": 4} if turns else {}
    lying = pose((450.0, -60.0, 10.0))
    obstacles = {"table": Box((250.0, -500.0, -100.0), (1000.0, 500.0, 0.0))}
    obstacles |= {f"post {k}": Box(*post) for k, post in enumerate(posts)}
    fixturing = Fixturing(lying, obstacles, **table)
    camera = (Box((-30.0, -30.0, -90.0), (30.0, 30.0, 0.0)),)
    robot = made_arm("kuka_iiwa")
    return Cell(
        robot, pose((0.0, 0.0, 90.0)), camera_body=camera, fixturings={"up": fixturing}, home=HOME
    )


@cache
def settings():
    poses = views(np.random.default_rng(2), 30, SIZE, (150.0, 300.0))
    reached = [one.reached for one in seven_cell().with_part(block()).reach(poses, "up")]
    assert sum(reached) >= 5
    return poses[reached][:4]


@cache
def program(turns=False):
    return robot_program(plan_of(settings()), block(), seven_cell(turns), speed=0.5)


def test_another_swivel_is_taken_where_the_first_one_is_blocked():
    cell = seven_cell()
    first = cell.reach(settings()[:1], "up")[0].joints[0]
    elbow = cell.robot.link_poses(first[None])[0, 4, :3, 3]
    post = (tuple(elbow - 30.0), tuple(elbow + 30.0))
    other = seven_cell(posts=(post,)).reach(settings()[:1], "up")[0]
    assert other.reached
    swung = cell.robot.link_poses(other.joints[:1])[0, 4, :3, 3]
    assert np.linalg.norm(swung - elbow) > 60.0
    np.testing.assert_allclose(
        forward("kuka_iiwa", other.joints[:1]), forward("kuka_iiwa", first[None]), atol=1e-6
    )


def test_a_program_drives_seven_joints_through_free_space():
    cell = seven_cell().with_part(block())
    made = program()
    assert made.complete
    assert len(made.joint_names) == 7
    for stop in made.tours[0].stops:
        camera = forward("kuka_iiwa", stop.joints[None])[0] @ cell.cam2flange
        np.testing.assert_allclose(
            np.linalg.inv(pose((450.0, -60.0, 10.0))) @ camera,
            settings()[stop.setting_idx],
            atol=1e-6,
        )
        # a curve of joints leaves some that are far from limits
        assert stop.arm.to_limit_rad >= 0.05
    for move in made.tours[0].moves:
        for start, end in zip(move.joints, move.joints[1:], strict=False):
            steps = start + np.linspace(0, 1, 40)[:, None] * (end - start)
            assert cell.slack_bound(steps, "up", 5.0, share=0.5).min() >= 0


@pytest.mark.parametrize("turns", [False, True])
@pytest.mark.parametrize(
    ("format", "file"), [("rapid", "i.mod"), ("csv", "i.csv"), ("ros", "i.json")]
)
def test_programs_of_seven_joints_are_read_again(turns, format, file, tmp_path):
    path = write_program(program(turns), tmp_path / file, format=format)
    again = read_poses(path, cell=seven_cell(turns)).poses
    assert len(again) == len(settings())
    for given in again:
        number = int(given.name.removeprefix("setting_")) - 1
        np.testing.assert_allclose(given.cam2world, settings()[number], atol=1e-3)


def test_rapid_has_the_third_joint_as_its_seventh_axis():
    text = program_text(program(True), "rapid")
    assert "eax_a is axis 7 of the arm, between its axes 2 and 3: joint axis_3." in text
    assert "eax_b is the turntable" in text
    home = "[[0.000000,20.000000,-90.000000,0.000000,70.000000,0.000000],[0.000000,0.000000,9E9"
    assert f"jHome:={home}" in text


@pytest.mark.parametrize("format", ["krl", "urscript"])
def test_languages_of_six_axes_refuse_seven(format):
    with pytest.raises(
        RequestError, match=r"format must be rapid, ros, csv or json for an arm of 7"
    ):
        program_text(program(), format)


def test_home_and_speeds_need_a_number_for_each_joint(tmp_path):
    with pytest.raises(RobotError, match="home must be 7 finite angles in rad"):
        Cell(
            made_arm("kuka_iiwa"),
            pose((0.0, 0.0, 90.0)),
            fixturings={"up": Fixturing(pose())},
            home=HOME[:6],
        )
    with pytest.raises(
        RobotError, match=r"speeds must be one number, or one for each of the 7 joints. Got 6"
    ):
        made_arm("kuka_iiwa", speeds=(1.0,) * 6)
