"""An arm of each maker, in its proportions: joints of poses by independent matrices, and a program that drives it."""

import json
import re

import numpy as np
import pytest
from made_arms import ARMS, COUPLED, dh_forward, joint_poses, made_arm, urdf_of
from robot_cells import pose
from robot_programs import block, plan_of
from scipy.spatial.transform import Rotation

from planner import Box, Cell, Fixturing, Robot, RobotError, program_text, robot_program

CAM2FLANGE = pose((0.0, 0.0, 140.0))
LANGUAGES = {"abb": "rapid", "kuka_kr6": "krl", "ur5e": "urscript", "fanuc": "fanuc"}
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
    if name in COUPLED:
        data = json.loads(program_text(made, "json"))
        assert data["coupled"] == [list(row) for row in COUPLED[name]]


@pytest.mark.parametrize("name", COUPLED)
def test_a_coupled_axis_is_the_angle_of_the_forearm_to_the_horizon(name):
    robot = made_arm(name)
    rng = np.random.default_rng(5)
    for q in rng.uniform(-0.8, 0.8, (6, 6)):
        axes = robot.controller.of(q)
        leaned = axes + 0.3 * np.eye(6)[1]
        # the rod keeps the forearm, and with it the whole hand, as it was
        joints = leaned - [0.0, 0.0, leaned[1], 0.0, 0.0, 0.0]
        before, after = dh_forward(name, np.array([q, joints]))
        np.testing.assert_allclose(after[:3, :3], before[:3, :3], atol=1e-12)
        np.testing.assert_allclose(robot.controller.of(joints), leaned, atol=1e-12)
        upper_arm = ARMS[name][0][2][0]
        moved = np.linalg.norm(after[:3, 3] - before[:3, 3])
        assert moved == pytest.approx(2 * upper_arm * np.sin(0.15))


UR_LINKS = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")


def calibrated_ur(folder, measured, **options):
    """Write a UR5e as `ur_description` names it, and the measured origins of its joints as `ur_calibration` does."""
    text = urdf_of("ur5e", *ARMS["ur5e"])
    for number, link in enumerate(UR_LINKS, start=1):
        text = text.replace(f'"link_{number}"', f'"left_{link}_link"')
    (folder / "ur5e.urdf").write_text(text, encoding="utf-8")
    lines = ["kinematics:"]
    for link, origin in zip(UR_LINKS, measured, strict=True):
        angles = Rotation.from_matrix(origin[:3, :3]).as_euler("xyz")
        values = zip(("x", "y", "z"), origin[:3, 3] / 1000, strict=True)
        values = [*values, *zip(("roll", "pitch", "yaw"), angles, strict=True)]
        lines += [f"  {link}:", *(f"    {key}: {float(value)!r}" for key, value in values)]
    lines.append("  hash: calib_12788084448423163542")
    (folder / "calibration.yaml").write_text("\n".join(lines), encoding="utf-8")
    return Robot.from_urdf(folder / "ur5e.urdf", calibration=folder / "calibration.yaml", **options)


def measured_origins(seed):
    """Return the origins of a UR5e's joints, each off by up to 0.5 mm and 1 mrad."""
    rng = np.random.default_rng(seed)
    origins = joint_poses("ur5e")
    origins[:, :3, 3] += rng.uniform(-0.5, 0.5, (6, 3))
    turns = Rotation.from_rotvec(rng.uniform(-1e-3, 1e-3, (6, 3))).as_matrix()
    origins[:, :3, :3] = origins[:, :3, :3] @ turns
    return origins


def driven(origins, q):
    """Return poses (n, 4, 4) of the tip by products of the measured origins, mm."""
    poses = np.tile(np.eye(4), (len(q), 1, 1))
    for k, origin in enumerate(origins):
        turns = np.tile(np.eye(4), (len(q), 1, 1))
        turns[:, :3, :3] = Rotation.from_rotvec(np.outer(q[:, k], [0.0, 0.0, 1.0])).as_matrix()
        poses = poses @ origin @ turns
    return poses


def test_a_calibrated_arm_is_solved_on_its_own_lengths(tmp_path):
    origins = measured_origins(4)
    robot = calibrated_ur(tmp_path, origins)
    q = np.random.default_rng(9).uniform(-3.0, 3.0, (60, 6))
    # bent elbows and wrists: two branches that meet fix fewer digits
    bent = (np.abs(np.sin(q[:, 2])) > 0.2) & (np.abs(np.sin(q[:, 4])) > 0.2)
    flanges = driven(origins, q[bent])
    np.testing.assert_allclose(robot.forward(q[bent]), flanges, atol=1e-9)
    # the nominal arm misses by what was measured
    missed = np.linalg.norm((dh_forward("ur5e", q[bent]) - flanges)[:, :3, 3], axis=1)
    assert missed.min() > 0.1
    refound = 0
    for joints, flange, branches in zip(q[bent], flanges, robot.branches_of(flanges), strict=True):
        reached = driven(origins, branches) - flange
        assert np.abs(reached[:, :3, :3]).max() < 1e-9
        assert np.abs(reached[:, :3, 3]).max() < 1e-6
        turned = np.abs(branches - joints)
        turned = np.abs(turned - 2 * np.pi * np.round(turned / (2 * np.pi)))
        refound += bool((turned.max(axis=1) < 1e-6).any())
    assert refound == bent.sum() > 20


def test_a_number_of_a_calibration_needs_no_point(tmp_path):
    """YAML 1.2 has numbers such as 1e-05, which YAML 1.1 took as words."""
    calibrated_ur(tmp_path, joint_poses("ur5e"))
    path = tmp_path / "calibration.yaml"
    text = re.sub(r"yaw: \S+", "yaw: 1e-05", path.read_text("utf-8"), count=1)
    path.write_text(text, encoding="utf-8")
    robot = Robot.from_urdf(tmp_path / "ur5e.urdf", calibration=path)
    turned = made_arm("ur5e").forward(np.array([1e-5, 0.0, 0.0, 0.0, 0.0, 0.0]))
    np.testing.assert_allclose(robot.forward(np.zeros(6)), turned, atol=1e-9)


def test_joints_that_are_off_lead_where_the_arm_is(tmp_path):
    nominal = made_arm("ur5e")
    offsets = np.radians([0.1, -0.2, 0.05, 0.3, -0.1, 0.2])
    (tmp_path / "arm.urdf").write_text(urdf_of("ur5e", *ARMS["ur5e"]), encoding="utf-8")
    robot = Robot.from_urdf(tmp_path / "arm.urdf", joint_offsets=offsets.tolist())
    q = np.random.default_rng(2).uniform(-3.0, 3.0, (20, 6))
    np.testing.assert_allclose(robot.forward(q), nominal.forward(q + offsets), atol=1e-9)
    assert (robot.lower == nominal.lower).all()
    assert robot.state_name != nominal.state_name


def test_a_calibration_that_is_none_is_refused(tmp_path):
    origins = measured_origins(1)
    far = origins.copy()
    far[2, 0, 3] += 80.0
    with pytest.raises(
        RobotError, match=r"calibration: forearm must be within 50 mm .* Got 80.* mm"
    ):
        calibrated_ur(tmp_path, far)
    calibrated_ur(tmp_path, origins)
    path = tmp_path / "calibration.yaml"
    text = path.read_text("utf-8")
    wrong = {
        text.replace("forearm:", "fore:"): r"calibration must name joints .* Got 'fore'; there are",
        text.replace("roll", "rol", 1): r"calibration: shoulder: rol ",
        "shoulder: {x: 0}": r"calibration must hold the mapping kinematics",
        "kinematics: [": r"calibration must be YAML",
        "kinematics: {shoulder: 3}": r"calibration: shoulder must hold x, y, z, roll, pitch and yaw",
    }
    for content, message in wrong.items():
        path.write_text(content, encoding="utf-8")
        with pytest.raises(RobotError, match=message):
            Robot.from_urdf(tmp_path / "ur5e.urdf", calibration=path)
    with pytest.raises(RobotError, match="calibration must be a file that can be read"):
        Robot.from_urdf(tmp_path / "ur5e.urdf", calibration=tmp_path / "none.yaml")
    for offsets, message in (([0.1], "must have a number for each"), ([1.0] * 6, "at most 0.1")):
        with pytest.raises(RobotError, match=f"joint_offsets {message}|joint_offsets must be"):
            Robot.from_urdf(tmp_path / "ur5e.urdf", joint_offsets=offsets)
