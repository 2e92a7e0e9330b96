"""A part in the hand before a fixed camera is the mirror image of a camera in the hand before a fixed part."""

import json
import pickle

import numpy as np
import pytest
from pocket_block import two_pocket_block
from robot_cells import NAMES, ROBOTS, TABLE, made_cell, made_robot, pose, random_joints, views
from robot_programs import SIZE, block, plan_of
from scipy.spatial.transform import Rotation

from planner import (
    ArmUncertainty,
    Box,
    Cell,
    Fixturing,
    Grip,
    HeldPartCell,
    PoseUncertainty,
    RobotError,
    program_text,
    propose_placements,
    robot_program,
)
from planner.report.figure import arm_figure, stands_of
from planner.robotcell.urdf import compose, invert

CAMERA_BODY = Box((-30.0, -30.0, -90.0), (30.0, 30.0, 0.0))
DOWN = Rotation.from_euler("x", 180, degrees=True).as_matrix()
CAM2BASE = pose((700.0, 0.0, 800.0), DOWN)
PART2FLANGE = pose((-100.0, -60.0, 40.0))
HOME = (0.0, -1.6, 1.4, -1.4, -1.57, 0.0)
JAWS = {"jaws": Box((-30.0, -30.0, 0.0), (30.0, 30.0, 30.0))}


def held(name="made_parallel", **changes):
    given = {
        "camera_body": (CAMERA_BODY,),
        "obstacles": {"table": TABLE},
        "fixturings": {"grip": Grip(PART2FLANGE, JAWS)},
        "home": HOME,
        **changes,
    }
    return HeldPartCell(made_robot(name), CAM2BASE, **given)


@pytest.mark.parametrize("name", NAMES)
def test_it_is_the_mirror_image_of_a_camera_in_the_hand(name):
    """The part is the other cell's camera, and the camera is its part: the same relative poses are reached."""
    cell = held(name, home=None).with_part(block())
    whole = block()
    part = (np.asarray(whole.vertices), np.asarray(whole.triangles))
    jaws = Box(JAWS["jaws"].low, JAWS["jaws"].high, invert(PART2FLANGE))
    camera = Box(CAMERA_BODY.low, CAMERA_BODY.high, CAM2BASE)
    mirror = Cell(
        made_robot(name),
        PART2FLANGE,
        camera_body=[jaws, part],
        obstacles={"table": TABLE, "lens": camera},
        fixturings={"grip": Fixturing(CAM2BASE)},
    )
    poses = views(np.random.default_rng(3), 150, SIZE)
    told = cell.reach(poses, "grip", all_branches=True)
    other = mirror.reach(invert(poses), "grip", all_branches=True)
    for one, two in zip(told, other, strict=True):
        assert one.reached == two.reached
        np.testing.assert_allclose(one.branches, two.branches, atol=1e-9)
    assert 3 < sum(one.reached for one in told) < len(told) - 10
    words = {one.why for one in told}
    assert "camera touches part" in words


@pytest.mark.parametrize("name", NAMES)
def test_what_is_reached_has_the_part_before_the_camera_and_is_free(name):
    cell = held(name, home=None).with_part(block())
    poses = views(np.random.default_rng(3), 100, SIZE)
    compared = 0
    for camera, one in zip(poses, cell.reach(poses, "grip", all_branches=True), strict=True):
        for q in one.branches:
            tip = cell.robot.forward(q)
            np.testing.assert_allclose(tip @ PART2FLANGE @ camera, CAM2BASE, atol=1e-3)
            assert cell.blocked_by(q, "grip") == ""
            compared += 1
        if one.reached:
            back = cell.cam2world(one.branches, "grip")
            np.testing.assert_allclose(back, np.broadcast_to(camera, back.shape), atol=1e-3)
    assert compared > 2


def test_the_jaws_hide_what_is_behind_them():
    cell = held()
    # the underside, in the middle of which the jaws hold the part
    segments = np.array([[[90.0, 60.0, 0.0], [110.0, 60.0, 0.0]], [[0.0, 0, 0], [0.0, 120.0, 0]]])
    below = pose((100.0, 60.0, -400.0))
    assert cell.hidden_by(below[None], segments, "grip").tolist() == [["jaws", ""]]
    wall = Box((-2000.0, -2000.0, 500.0), (2000.0, 2000.0, 520.0))
    behind = held(obstacles={"wall": wall}, home=None)
    above = pose((100.0, 60.0, 700.0), DOWN)
    top = np.array([[[0.0, 0.0, 80.0], [200.0, 0.0, 80.0]]])
    assert behind.hidden_by(above[None], top, "grip").tolist() == [["wall"]]
    near = pose((100.0, 60.0, 300.0), DOWN)
    assert behind.hidden_by(near[None], top, "grip").tolist() == [[""]]


def reached_poses():
    inside = held().with_part(block())
    drawn = views(np.random.default_rng(5), 60, SIZE)
    reached = [one.reached for one in inside.reach(drawn, "grip")]
    return drawn[reached][:3]


def test_a_program_carries_the_part_before_the_camera():
    cell = held()
    plan = plan_of(reached_poses())
    uncertainty = ArmUncertainty(1e-4)
    made = robot_program(plan, block(), cell, uncertainty=uncertainty, simulate=0)
    assert made.complete
    inside = cell.with_part(block())
    for stop in made.tours[0].stops:
        camera = plan.settings[stop.setting_idx].cam2world
        tip = cell.robot.forward(stop.joints)
        np.testing.assert_allclose(tip @ PART2FLANGE @ camera, CAM2BASE, atol=1e-3)
    for move in made.tours[0].moves:
        for start, end in zip(move.joints, move.joints[1:], strict=False):
            steps = np.linspace(0.0, 1.0, 40)[:, None]
            slack = inside.slack_bound(start + steps * (end - start), "grip", 1.0, share=0.5)
            assert (slack > -1e-6).all()
    assert "movej(" in program_text(made, "urscript")
    driven = [
        type(one)(**{**one.__dict__, "fixturing": "grip", "joints": tuple(stop.joints.tolist())})
        for one, stop in zip(plan.settings, made.tours[0].stops, strict=True)
    ]
    figure = arm_figure(stands_of(plan_of([], settings=tuple(driven))), block(), inside)
    assert sum(trace.name == "part" for trace in figure.data) == len(driven)


def test_the_covariance_is_that_of_drawn_joints():
    """The camera stands still; the part is displaced by the joints, and the camera as seen from it."""
    robot = made_robot("made_parallel")
    rng = np.random.default_rng(0)
    q = random_joints(robot, rng, 1)
    sigma = 1e-4
    part = PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=2e-4)
    known = robot.forward(q[0]) @ PART2FLANGE
    camera = invert(known) @ CAM2BASE
    found = ArmUncertainty(sigma, part=part).covariances_held(robot, q, PART2FLANGE, camera)[0]
    drawn = q + rng.normal(size=(20_000, 6)) * sigma
    shifts = rng.normal(size=(20_000, 3)) * 0.05
    turns = Rotation.from_rotvec(rng.normal(size=(20_000, 3)) * 2e-4).as_matrix()
    moved = np.tile(np.eye(4), (20_000, 1, 1))
    moved[:, :3, :3] = turns
    moved[:, :3, 3] = shifts
    seen = invert(compose(compose(robot.forward(drawn), PART2FLANGE), moved)) @ CAM2BASE
    off = np.linalg.inv(camera) @ seen
    vectors = np.concatenate(
        [off[:, :3, 3], Rotation.from_matrix(off[:, :3, :3]).as_rotvec()], axis=1
    )
    measured = np.cov(vectors.T)
    scale = np.sqrt(np.outer(np.diag(measured), np.diag(measured)))
    assert (np.abs(found - measured) / scale).max() < 0.05


def test_a_packed_cell_gives_the_same_answers():
    cell = held().with_part(block())
    again = pickle.loads(pickle.dumps(cell))
    assert again.state_name == cell.state_name
    poses = views(np.random.default_rng(3), 20, SIZE)
    for one, other in zip(again.reach(poses, "grip"), cell.reach(poses, "grip"), strict=True):
        assert one.why == other.why
        np.testing.assert_array_equal(one.branches, other.branches)


def test_a_cell_names_what_differs():
    before = held().to_dict()
    json.dumps(before)
    assert held().difference(before) == ""
    assert held(clearance_mm=5.0).difference(before) == "clearance_mm"
    other = held(fixturings={"grip": Grip(PART2FLANGE)})
    assert other.difference(before) == "fixturing 'grip'"
    assert "cam2base" in made_cell().difference(before)


TOML = """
cam2base = {{ xyz = [700, 0, 800], rpy_deg = [180, 0, 0] }}
camera_body = [{{ low = [-30, -30, -90], high = [30, 30, 0] }}]
robot = {{ urdf = "{folder}/made_parallel.urdf", packages = {{ made_robots = "{folder}" }} }}
{more}
[fixturings.grip]
part2flange = {{ xyz = [-100, -60, 40] }}
[fixturings.grip.gripper.jaws]
low = [-30, -30, 0]
high = [30, 30, 30]
[obstacles.table]
low = [300, -500, -100]
high = [1300, 500, 0]
"""


def test_a_cell_file_has_the_part_in_the_hand(tmp_path):
    path = tmp_path / "cell.toml"
    path.write_text(TOML.format(folder=ROBOTS.as_posix(), more=""), "utf-8")
    cell = Cell.from_toml(path)
    assert isinstance(cell, HeldPartCell)
    poses = views(np.random.default_rng(3), 20, SIZE)
    other = held(home=None).reach(poses, "grip")
    for one, two in zip(cell.reach(poses, "grip"), other, strict=True):
        np.testing.assert_allclose(one.branches, two.branches, atol=1e-6)
    path.write_text(
        TOML.format(folder=ROBOTS.as_posix(), more="cam2flange = { xyz = [0, 0, 9] }"), "utf-8"
    )
    with pytest.raises(RobotError, match="cam2base must not be given with cam2flange"):
        Cell.from_toml(path)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"fixturings": {}}, "fixturings must name at least one way the robot holds the part"),
        ({"fixturings": {"up": Fixturing(np.eye(4))}}, "fixturings must hold a Grip for 'up'"),
        ({"obstacles": {"jaws": TABLE}}, "must have names that no other object has. Got 'jaws'"),
        ({"home": [0.0, 0.5, 0.0, 0.0, 0.0, 0.0]}, "home must be free of collisions in fix"),
    ],
)
def test_cells_that_are_none(changes, message):
    with pytest.raises(RobotError, match=message):
        held(**changes)


def test_a_grip_needs_a_camera_that_stands_still():
    with pytest.raises(RobotError, match="a Grip needs a HeldPartCell"):
        made_cell(fixturings={"grip": Grip(PART2FLANGE)})
    with pytest.raises(RobotError, match="cell must hold the part on a fixturing"):
        propose_placements(plan_of(reached_poses()), block(), held(), x=(0, 1), y=(0, 1))


def test_a_gripper_through_the_part_is_refused():
    """The finger runs through the block, with no corner inside it; the jaws end 10 mm before it."""
    held().with_part(block())
    finger = {"finger": Box((-10.0, -10.0, 0.0), (10.0, 10.0, 400.0))}
    cell = held(fixturings={"grip": Grip(PART2FLANGE, finger)}, home=None)
    with pytest.raises(RobotError, match=r"part2flange must not put the part .* deep in finger"):
        cell.with_part(block())


def probe(y_mm, x_mm=30.0):
    """A camera (4, 4) in the part's frame that looks along -y, with its nodal point in or before a pocket."""
    turn = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    return pose((x_mm, y_mm, 20.0), turn)


def test_a_thin_camera_looks_into_a_pocket_of_the_part():
    """The pocket is 20 mm wide and its floor is at y = 50 mm; the box about the part ends at y = 60 mm."""
    stick = Box((-3.0, -3.0, -10.0), (3.0, 3.0, 0.0))
    grip = {"grip": Grip(pose((-30.0, -30.0, 40.0)))}
    changes = {"camera_body": (stick,), "fixturings": grip, "obstacles": {}, "home": None}
    cell = held(clearance_mm=2.0, **changes).with_part(two_pocket_block())
    inside = cell.reach(probe(53.0)[None], "grip")[0]
    assert inside.reached
    near = cell.clearance(inside.branches[0], "grip")
    assert {near.first, near.second} == {"part", "camera"}
    assert near.mm == pytest.approx(3.0, abs=1e-6)
    for camera in (probe(51.5), probe(49.0), probe(53.0, 22.0), probe(20.0, 10.0)):
        answer = cell.reach(camera[None], "grip")[0]
        assert answer.why == "camera touches part"
