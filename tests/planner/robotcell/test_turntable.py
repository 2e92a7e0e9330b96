"""A turntable: an angle is a further branch, and what turns with the part is never touched on the way."""

import json
import math
import pickle

import numpy as np
import pytest
from robot_cells import CAMERA_BODY, NAMES, TABLE, made_cell, pose, random_joints, views
from robot_programs import HOME, SIZE, block
from scipy.spatial.transform import Rotation

from planner import Box, Cell, Fixturing, RobotError
from planner.robotcell.cell import CellRegion
from planner.robotcell.urdf import compose
from planner.robotprogram.moves import FixturedArm, check_move

AXIS = ((800.0, 60.0, 0.0), (0.0, 0.0, 1.0))
PART2BASE = pose((700.0, 0.0, 30.0))
CLAMP = {"clamp": Box((680.0, -40.0, 30.0), (695.0, 160.0, 130.0))}


def on_table(**changes):
    """The block on a turntable about its middle, with a clamp on its side."""
    given = {"axis": AXIS, "angles": 8, "turning": CLAMP, **changes}
    return Fixturing(PART2BASE, {"table": TABLE}, **given)


def cell_of(fixturing, name="made_parallel"):
    return made_cell(name, fixturings={"up": fixturing}, home=HOME).with_part(block())


@pytest.fixture(scope="module", params=NAMES)
def known(request):
    cell = made_cell(request.param, fixturings={"up": on_table()}).with_part(block())
    return cell, views(np.random.default_rng(3), 50, SIZE)


def test_a_turned_part_is_a_part_that_lies_turned(known):
    cell, poses = known
    for angle in (0.0, math.radians(45.0), math.radians(-135.0)):
        turned = cell.with_fixturings({"up": cell.fixturings["up"].at(angle)})
        told = cell.reach(poses, "up", all_branches=True, angle=angle)
        plain = turned.reach(poses, "up", all_branches=True)
        assert [one.why for one in told] == [one.why for one in plain]
        for one, other in zip(told, plain, strict=True):
            np.testing.assert_array_equal(one.branches, other.branches)
        assert 0 < sum(one.reached for one in told) < len(told)


def test_all_angles_together_are_each_alone(known):
    cell, poses = known
    every = cell.reach(poses, "up", all_branches=True)
    first = cell.reach(poses, "up")
    for k, one in enumerate(every):
        alone = [
            cell.reach(poses[k : k + 1], "up", all_branches=True, angle=angle)[0]
            for angle in cell.angles("up")
        ]
        assert len(one.branches) == sum(len(other.branches) for other in alone)
        assert one.reached == any(other.reached for other in alone)
        if one.reached:
            assert set(one.branches[:, 6]) == {
                angle
                for angle, other in zip(cell.angles("up"), alone, strict=True)
                if other.reached
            }
            np.testing.assert_array_equal(first[k].branches, one.branches[:1])
            assert cell.free(one.branches, "up").all()
            camera = cell.cam2world(one.branches, "up")
            np.testing.assert_allclose(
                camera, np.broadcast_to(poses[k], camera.shape), rtol=0, atol=1e-3
            )
    # more is reached than from any single angle
    at_zero = cell.reach(poses, "up", angle=0.0)
    assert sum(one.reached for one in every) > sum(one.reached for one in at_zero)


def test_a_table_about_the_axis_of_the_first_joint_turns_only_that_joint():
    fixturing = Fixturing(PART2BASE, axis=((0, 0, 0), (0, 0, 1)), angles=[0.0, math.radians(30.0)])
    cell = made_cell("made_wrist", fixturings={"up": fixturing})
    compared = 0
    for camera in views(np.random.default_rng(1), 40, SIZE):
        straight, turned = (
            cell.reach(camera[None], "up", all_branches=True, angle=angle)[0].branches
            for angle in cell.angles("up")
        )
        straight = straight + np.array([math.radians(30.0), 0, 0, 0, 0, 0])
        # within the limits of the first joint
        if len(straight) == len(turned) > 0 and (np.abs(straight[:, 0]) < 2.8).all():
            order = [np.lexsort(q.round(6).T) for q in (straight, turned)]
            np.testing.assert_allclose(straight[order[0]], turned[order[1]], atol=1e-6)
            compared += 1
    assert compared > 10


def test_one_angle_of_0_is_a_part_that_does_not_turn(known):
    cell, poses = known
    alone = cell.with_fixturings({"up": on_table(angles=1)})
    plain = cell.with_fixturings({"up": on_table().at(0.0)})
    for one, other in zip(alone.reach(poses, "up"), plain.reach(poses, "up"), strict=True):
        assert one.why == other.why
        np.testing.assert_array_equal(one.joints, other.branches)
        assert (one.branches[:, 6] == 0.0).all()
    segments = np.array([[[0.0, 0.0, 80.0], [200.0, 0.0, 80.0]]])
    owner = np.array([0])
    wanted = np.ones((len(poses), 1), dtype=bool)
    seen = [CellRegion(one).inspectable(poses, segments, owner, wanted) for one in (alone, plain)]
    np.testing.assert_array_equal(*seen)
    assert 0 < seen[0].sum() < len(poses)


def test_proven_shares_are_free_while_joints_and_table_turn():
    cell = made_cell(fixturings={"up": on_table()}, clearance_mm=10.0).with_part(block())
    rng = np.random.default_rng(3)
    low, high = cell.limits("up")
    q = rng.uniform(low, high, (300, 7))
    q = q[cell.free(q, "up")][:20]
    partly = 0
    for joints in q:
        turn = np.append(rng.uniform(-1.0, 1.0, 6), rng.uniform(-3.0, 3.0))
        share = cell.free_shares(joints[None], turn, np.full(1, 0.5), 0.5, fixturing="up")[0]
        assert 0 < share <= 0.5
        partly += share < 0.5
        inside = rng.uniform(-share, share, 30)
        inside[:2] = [-share * (1 - 1e-9), share * (1 - 1e-9)]
        slack = cell.slack_bound(joints + inside[:, None] * turn, "up", 1.0, share=0.5)
        assert (slack > -1e-6).all()
    assert partly > 3


def test_a_turn_of_the_table_alone_is_blocked_by_the_camera_in_its_way():
    """The post on the part sweeps past the camera, which stands still."""
    cell = cell_of(on_table(turning={"post": Box((860.0, 40.0, 110.0), (880.0, 60.0, 300.0))}))
    down = Rotation.from_euler("x", 180, degrees=True).as_matrix()
    # 70 mm from the axis towards the robot, above the part and below the top of the post
    camera = pose((30.0, 60.0, 200.0), down)
    told = cell.reach(camera[None], "up", angle=0.0)[0]
    assert told.reached
    start = np.append(told.branches[0], 0.0)
    turned = [start + np.array([0, 0, 0, 0, 0, 0, math.radians(d)]) for d in (90.0, 180.0)]
    space = FixturedArm(cell, "up")
    assert check_move(space, start, turned[0]).free
    found = check_move(space, start, turned[1])
    assert not found.free
    assert 0.5 < found.blocked_at <= 1.0
    assert not cell.free(turned[1][None], "up")[0]


def test_angles_are_spread_over_a_turn_the_nearest_to_0_first():
    degrees = np.degrees(on_table(angles=4).angles).round(9).tolist()
    assert degrees == [0.0, 90.0, -90.0, 180.0]
    assert len(Fixturing(PART2BASE, axis=AXIS).angles) == 24
    listed = on_table(angles=[2.0, -1.0]).angles
    assert listed == (-1.0, 2.0)
    assert on_table(angles=[2.0, -1.0]).table.range == (-1.0, 2.0)
    assert on_table(angles=[2.0, 1.0]).table.range == (0.0, 2.0)


def test_a_packed_cell_on_a_turntable_gives_the_same_answers(known):
    cell, poses = known
    again = pickle.loads(pickle.dumps(cell))
    assert again.state_name == cell.state_name
    for one, other in zip(again.reach(poses, "up"), cell.reach(poses, "up"), strict=True):
        np.testing.assert_array_equal(one.branches, other.branches)


def test_names_of_states_tell_turntables_apart():
    cells = [
        cell_of(on_table().at(0.0)),
        cell_of(on_table()),
        cell_of(on_table(angles=4)),
        cell_of(on_table(turn_speed=0.6)),
        cell_of(on_table(turning={})),
        cell_of(on_table(axis=((801.0, 60.0, 0.0), (0.0, 0.0, 1.0)))),
    ]
    assert len({cell.state_name for cell in cells}) == len(cells)


def test_a_moved_turntable_turns_as_before():
    motion = pose((100.0, -50.0, 20.0), Rotation.from_euler("z", 30, degrees=True).as_matrix())
    moved = on_table().moved(motion)
    for angle in (0.7, -2.0):
        np.testing.assert_allclose(
            moved.at(angle).part2base, compose(motion, on_table().at(angle).part2base), atol=1e-9
        )
    assert moved.angles == on_table().angles


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"axis": (0, 0, 1)}, "axis must be a point in mm and a direction"),
        ({"axis": ((0, 0, 0), (0, 0, 0))}, "axis must have a direction other than 0"),
        ({"axis": ((0, 0, 0), (0, np.inf, 0))}, "axis must be a point in mm and a direction"),
        ({"angles": 0}, "angles must be a number from 1 to 360 or a list"),
        ({"angles": True}, "angles must be a number from 1 to 360"),
        ({"angles": "24"}, "angles must be a number from 1 to 360"),
        ({"angles": [0, 90, 180]}, "angles must be .* within a turn. Got .*are they in degrees"),
        ({"angles": [1.0, 1.0]}, "angles must differ from each other"),
        ({"turn_speed": 0.0}, "turn_speed must be"),
        ({"turn_acceleration": math.nan}, "turn_acceleration must be"),
        ({"axis": None, "turning": {}}, "angles must be given with axis only. Got 8"),
        ({"axis": None, "angles": None}, "turning must be given with axis only"),
    ],
)
def test_turntables_that_are_none(changes, message):
    with pytest.raises(ValueError, match=message):
        on_table(**changes)


def test_what_turns_must_not_hit_what_stands():
    wall = Box((670.0, 40.0, 0.0), (690.0, 80.0, 200.0))
    fixturing = Fixturing(PART2BASE, {"table": TABLE, "wall": wall}, axis=AXIS)
    assert made_cell(fixturings={"up": fixturing.at(0.0)}).with_part(block())
    with pytest.raises(
        RobotError, match=r"axis must not turn part into .* 'up'. Got wall at -?\d+"
    ):
        made_cell(fixturings={"up": fixturing}).with_part(block())
    clamp = {"clamp": Box((940.0, 50.0, 30.0), (950.0, 70.0, 60.0))}
    far = Box((790.0, 200.0, 0.0), (810.0, 230.0, 200.0))
    fixturing = Fixturing(PART2BASE, {"far": far}, axis=AXIS, turning=clamp)
    with pytest.raises(
        RobotError, match=r"must not turn clamp into other objects in 'up'. Got far"
    ):
        made_cell(fixturings={"up": fixturing})
    # the range of the angles stops before
    given = {"axis": AXIS, "turning": clamp, "angles": [0.0, -1.0]}
    assert made_cell(fixturings={"up": Fixturing(PART2BASE, {"far": far}, **given)})
    with pytest.raises(RobotError, match=r"must have names that no other object has. Got 'table'"):
        made_cell(fixturings={"up": on_table(turning={"table": CAMERA_BODY[0]})})


TOML = """
cam2flange = {{ xyz = [0, 0, 90] }}
[robot]
urdf = "{robot}"
packages = {{ made_robots = "{folder}" }}
[fixturings.up]
part2base = {{ xyz = [700, 0, 30] }}
axis = {{ point = [800, 60, 0], direction = [0, 0, 1] }}
{more}
[fixturings.up.turning.clamp]
low = [680, -40, 30]
high = [695, 160, 130]
"""


def cell_file(tmp_path, more):
    from robot_cells import ROBOTS

    path = tmp_path / "cell.toml"
    robot = (ROBOTS / "made_parallel.urdf").as_posix()
    path.write_text(TOML.format(robot=robot, folder=ROBOTS.as_posix(), more=more), "utf-8")
    return path


def test_a_cell_file_states_a_turntable(tmp_path):
    path = cell_file(tmp_path, "angles_deg = [0, 45, -90]\nturn_speed = 0.25")
    fixturing = Cell.from_toml(path).fixturings["up"]
    assert np.degrees(fixturing.angles).round(9).tolist() == [0.0, 45.0, -90.0]
    assert fixturing.table.speed == 0.25
    assert list(fixturing.turning) == ["clamp"]
    record = Cell.from_toml(cell_file(tmp_path, "angles = 8")).to_dict()
    assert record["turntables"] == {
        "up": {"point": [800.0, 60.0, 0.0], "direction": [0.0, 0.0, 1.0]}
    }
    json.dumps(record)


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ("angles = 0", r"fixturings.up.angles must be a number from 1"),
        ("angles = 4\nangles_deg = [0]", "fixturings.up.angles_deg must not be given with angles"),
        ("angles_deg = [0, 'x']", r"fixturings.up.angles_deg\[1\] must be a number"),
        ("turn_speed = -1", "fixturings.up.turn_speed must be"),
        ("turning_speed = 1", "turning_speed must be left out, or renamed to one of part2base"),
    ],
)
def test_cell_files_with_a_wrong_turntable(tmp_path, more, message):
    with pytest.raises(RobotError, match=message):
        Cell.from_toml(cell_file(tmp_path, more))


def test_random_joints_have_the_camera_where_the_part_sees_it():
    """The camera stands still in the base; the part turns below it, so it is seen turned back."""
    cell = cell_of(on_table())
    q = random_joints(cell.robot, np.random.default_rng(0), 5)
    angle = math.radians(90.0)
    straight = cell.cam2world(q, "up")
    turned = cell.cam2world(np.column_stack([q, np.full(5, angle)]), "up")
    back = Rotation.from_rotvec([0, 0, -angle]).as_matrix()
    # seen from the axis, which is at (100, 60) in the part's frame
    centre = np.array([100.0, 60.0, 0.0])
    np.testing.assert_allclose(
        turned[:, :3, 3] - centre, (straight[:, :3, 3] - centre) @ back.T, atol=1e-9
    )


def test_a_needle_between_angles_of_a_grid_is_met():
    """A blade 2 mm wide, 390 mm from the axis, meets a post at 17.5° and nothing that is farther out."""
    blade = {"blade": Box((800.0, 59.0, 30.0), (1190.0, 61.0, 40.0))}
    turn = math.radians(17.5)
    for radius_mm, is_met in ((385.0, True), (400.0, False)):
        x = 800.0 + radius_mm * math.cos(turn)
        y = 60.0 + radius_mm * math.sin(turn)
        post = Box((x - 2.0, y - 2.0, 0.0), (x + 2.0, y + 2.0, 100.0))
        fixturing = Fixturing(PART2BASE, {"post": post}, axis=AXIS, turning=blade)
        if not is_met:
            assert made_cell(fixturings={"up": fixturing})
            continue
        with pytest.raises(
            RobotError, match=r"must not turn blade .* Got post at (-34[123]|1[78])"
        ):
            made_cell(fixturings={"up": fixturing})
        # angles that end before the post do no harm
        given = {"axis": AXIS, "turning": blade, "angles": [0.0, math.radians(16.0)]}
        assert made_cell(fixturings={"up": Fixturing(PART2BASE, {"post": post}, **given)})
