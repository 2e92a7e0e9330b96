"""Cells: what is reached is free, whatever the order of asking, the part's frame or the side of the mirror."""

import pickle
import re
import sys

import numpy as np
import pytest
from robot_cells import (
    CAM2FLANGE,
    CAMERA_BODY,
    NAMES,
    TABLE,
    from_text,
    made_cell,
    made_robot,
    pose,
    random_joints,
    random_pose,
    urdf_text,
    views,
)
from scipy.spatial.transform import Rotation

from aspectgraph import Solid
from planner import Box, Cell, Fixturing, RobotError
from planner.robotcell import branches
from planner.robotcell.bodies import hull_of
from planner.robotcell.cell import CellRegion
from planner.robotcell.urdf import compose, invert

SIZE = np.array([200.0, 120.0, 80.0])


def box_part(low=(0.0, 0.0, 0.0), high=SIZE, moved=None):
    """Return a box as a part, carried by a pose (4, 4)."""
    corners = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)])
    vertices = np.where(corners, high, low)
    if moved is not None:
        vertices = vertices @ moved[:3, :3].T + moved[:3, 3]
    faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
    return Solid(vertices, faces)


@pytest.fixture(scope="module", params=NAMES)
def asked(request):
    """A cell with a part, poses, and what is reached of them."""
    cell = made_cell(request.param).with_part(box_part())
    poses = views(np.random.default_rng(3), 300, SIZE)
    return cell, poses, cell.reach(poses, "up", all_branches=True)


def test_what_is_reached_brings_the_camera_there_and_is_free(asked):
    cell, poses, answers = asked
    reached = [one.reached for one in answers]
    assert 0.2 < np.mean(reached) < 0.95
    for one, wanted in zip(answers, poses, strict=True):
        assert one.reached == (len(one.branches) > 0)
        poses = cell.cam2world(one.branches, "up")
        np.testing.assert_allclose(poses, np.broadcast_to(wanted, poses.shape), atol=1e-3)
        assert cell.free(one.branches, "up").all()
        for q in one.branches:
            assert cell.blocked_by(q, "up") == ""
            assert cell.clearance(q, "up").mm >= 0


def test_the_hand_first_changes_no_answer(asked):
    cell, poses, answers = asked
    for one, flange in zip(answers, cell.flange(poses, "up"), strict=True):
        every = cell.robot.branches(flange)
        free = every[cell.free(every, "up")]
        assert sorted(free.tolist()) == sorted(one.branches.tolist())


def test_the_first_branch_is_the_first_of_all(asked):
    cell, poses, answers = asked
    for first, one in zip(cell.reach(poses, "up"), answers, strict=True):
        assert first.why == one.why
        np.testing.assert_array_equal(first.branches, one.branches[:1])


def test_reasons_are_words_a_user_knows(asked):
    reasons = {one.why for one in asked[2]}
    assert "" in reasons
    assert {"camera touches table", "camera touches part"} & reasons
    assert all("touches" in one or one in WORDS for one in reasons)


WORDS = ("", "beyond the arm's reach", "no joints lead to this pose", "joint limit")


def test_the_same_question_has_the_same_answer(asked):
    cell, poses, answers = asked
    order = np.random.default_rng(0).permutation(len(poses))
    again = cell.reach(poses[order], "up", all_branches=True)
    for number, one in zip(order, again, strict=True):
        assert one.why == answers[number].why
        np.testing.assert_array_equal(one.branches, answers[number].branches)


def test_a_packed_cell_gives_the_same_answers(asked):
    cell, poses, answers = asked
    packed = pickle.dumps(cell)
    again = pickle.loads(packed)
    assert again.state_name == cell.state_name
    for one, other in zip(again.reach(poses, "up", all_branches=True), answers, strict=True):
        assert one.why == other.why
        np.testing.assert_array_equal(one.branches, other.branches)
    assert len(packed) < 100_000


def test_clearances_and_slacks_agree(asked):
    cell = asked[0]
    q = random_joints(cell.robot, np.random.default_rng(2), 60)
    exact = np.array(
        [cell.clearance(one, "up", links_mm=np.inf, with_constant=True).mm for one in q]
    )
    distances = np.maximum(cell.slack_bound(q, "up", share=0.0), 0.0)
    np.testing.assert_allclose(distances, exact, atol=1e-9)
    quick = np.maximum(cell.slack_bound(q, "up", 20.0, share=0.0), 0.0)
    assert (quick <= exact + 1e-9).all()
    np.testing.assert_allclose(quick[quick < 20.0], exact[quick < 20.0], atol=1e-9)
    slack = cell.slack_bound(q, "up")
    assert ((slack >= 0) == cell.free(q, "up")).all()
    assert (cell.slack_bound(q, "up", share=0.5) >= slack).all()


def test_two_links_are_the_closest_only_where_they_nearly_touch(asked):
    cell = asked[0]
    links = set(cell.robot.segment_names) | {"camera"}
    q = random_joints(cell.robot, np.random.default_rng(2), 80)
    own = 0
    for one in q:
        every = cell.clearance(one, "up", links_mm=np.inf)
        told = cell.clearance(one, "up")
        if {told.first, told.second} <= links:
            own += 1
            assert told == every
            assert told.mm < 5.0
        else:
            assert {told.first, told.second} & {"table", "part"}
            # nearer links are left out, unless they nearly touch
            assert every.mm == told.mm or (every.mm >= 5.0 and {every.first, every.second} <= links)
    assert 0 < own < len(q)


def test_no_point_moves_farther_than_the_levers_say(asked):
    cell = asked[0]
    rng = np.random.default_rng(4)
    q = random_joints(cell.robot, rng, 40)
    steps = rng.normal(size=(40, 6)) * 0.05
    before = cell.robot.chain.frames(q)
    after = cell.robot.chain.frames(q + steps)
    allowed = (cell.levers_mm * np.abs(steps)).sum(axis=1)
    for body in cell._arm.bodies:
        corners = body.hull.corners
        moved = [
            np.einsum("nij,cj->nci", frames[:, body.segment, :3, :3], corners)
            + frames[:, body.segment, None, :3, 3]
            for frames in (before, after)
        ]
        distances = np.linalg.norm(moved[1] - moved[0], axis=2).max(axis=1)
        assert (distances <= allowed).all()


@pytest.mark.parametrize("name", NAMES)
def test_moving_the_part_with_its_frame_changes_no_answer(name):
    rng = np.random.default_rng(8)
    poses = views(rng, 120, SIZE)
    fixed = made_cell(name).with_part(box_part())
    motion = random_pose(rng, 300.0)
    y = pose((700.0, 0.0, 0.0))
    fixturings = {"up": Fixturing(y @ invert(motion), {"table": TABLE})}
    moved = made_cell(name, fixturings=fixturings).with_part(box_part(moved=motion))
    assert_same_answers(fixed.reach(poses, "up"), moved.reach(compose(motion, poses), "up"))


def assert_same_answers(first, second, signs=1.0):
    # the base is named after the link whose frame it is
    reasons = [one.why.replace("world", "base_link") for one in second]
    assert [one.why for one in first] == reasons
    for one, other in zip(first, second, strict=True):
        np.testing.assert_allclose(one.branches * signs, other.branches, atol=1e-6)
    assert 0 < sum(one.reached for one in first) < len(first)


def test_moving_the_robot_and_all_else_changes_no_answer(tmp_path):
    shift = (120.0, -340.0, 560.0)
    turn = Rotation.from_euler("xyz", (0.4, -0.3, 1.1)).as_matrix()
    motion = pose(shift, turn)
    origin = '<origin xyz="0.12 -0.34 0.56" rpy="0.4 -0.3 1.1"/>'
    joint = f'<joint name="w" type="fixed"><parent link="world"/><child link="base_link"/>{origin}</joint>'
    text = urdf_text("made_wrist").replace("</robot>", f'<link name="world"/>{joint}</robot>')
    robot = from_text(tmp_path, text, base="world")
    table = Box(TABLE.low, TABLE.high, motion)
    fixturing = Fixturing(motion @ pose((700.0, 0.0, 0.0)), {"table": table})
    cell = Cell(robot, CAM2FLANGE, camera_body=CAMERA_BODY, fixturings={"up": fixturing})
    poses = views(np.random.default_rng(8), 120, SIZE)
    part = box_part()
    assert_same_answers(
        made_cell("made_wrist").with_part(part).reach(poses, "up"),
        cell.with_part(part).reach(poses, "up"),
    )


def test_a_mirrored_cell_gives_mirrored_answers():
    # the made robot is its own mirror image in y = 0, with joints 1, 4 and 6 turning the other way
    mirror = np.diag([1.0, -1.0, 1.0, 1.0])
    post = Box((500.0, 150.0, 0.0), (560.0, 230.0, 400.0))
    y = pose((700.0, 40.0, 0.0))
    cells = []
    for box, part2base, part in (
        (post, y, box_part()),
        (
            Box((500.0, -230.0, 0.0), (560.0, -150.0, 400.0)),
            pose((700.0, -40.0, 0.0)),
            box_part((0.0, -SIZE[1], 0.0), (SIZE[0], 0.0, SIZE[2])),
        ),
    ):
        fixturing = Fixturing(part2base, {"table": TABLE, "post": box})
        cells.append(made_cell("made_wrist", fixturings={"up": fixturing}).with_part(part))
    poses = views(np.random.default_rng(8), 200, SIZE)
    signs = np.array([-1.0, 1.0, 1.0, -1.0, 1.0, -1.0])
    first = cells[0].reach(poses, "up", all_branches=True)
    second = cells[1].reach(mirror @ poses @ mirror, "up", all_branches=True)
    assert [one.why for one in first] == [one.why for one in second]
    for one, other in zip(first, second, strict=True):
        assert sorted((one.branches * signs).round(6).tolist()) == sorted(
            other.branches.round(6).tolist()
        )
    assert any("post" in one.why for one in first)
    assert any(one.reached for one in first)


@pytest.mark.parametrize("name", NAMES)
def test_no_camera_is_below_the_table(name):
    wide = Box((250.0, -2000.0, -100.0), (3000.0, 2000.0, 0.0))
    cell = made_cell(name, fixturings={"up": Fixturing(pose((700.0, 0.0, 0.0)), {"table": wide})})
    poses = views(np.random.default_rng(1), 200, SIZE)
    poses[:, 2, 3] = np.random.default_rng(2).uniform(-90.0, 0.0, 200)
    answers = cell.reach(poses, "up")
    assert not any(one.reached for one in answers)
    assert any(one.why == "camera touches table" for one in answers)


def test_a_camera_inside_the_part_touches_it():
    # larger than the camera's body, so that no surface is touched
    part = box_part((0.0, 0.0, 0.0), (500.0, 500.0, 500.0))
    down = Rotation.from_euler("x", 180, degrees=True).as_matrix()
    inside = pose((250.0, 250.0, 200.0), down)[None]
    fixturings = {"up": Fixturing(pose((400.0, -250.0, 0.0)))}
    cell = made_cell("made_wrist", fixturings=fixturings)
    assert cell.reach(inside, "up")[0].reached
    assert cell.with_part(part).reach(inside, "up")[0].why == "camera touches part"


def test_the_clearance_is_kept_to_the_tenth_of_a_millimetre():
    # straight above the table, the front of the camera is the lowest of all
    down = Rotation.from_euler("x", 180, degrees=True).as_matrix()
    cell = made_cell(clearance_mm=5.0)
    for height, reached in ((4.9, False), (5.1, True)):
        answer = cell.reach(pose((0.0, 0.0, height), down)[None], "up")[0]
        assert answer.reached is reached
        assert answer.why == ("" if reached else "camera touches table")
    closest = cell.clearance(answer.branches[0], "up")
    assert {closest.first, closest.second} == {"camera", "table"}
    assert closest.mm == pytest.approx(5.1, abs=1e-3)


def test_what_is_as_near_at_all_joints_is_told_once():
    cell = Cell.from_toml("examples/cell.toml")
    name = next(iter(cell.fixturings))
    always = cell.constant_clearance(name)
    assert {always.first, always.second} == {"link_1", "pedestal"}
    for angle in (-2.0, 0.3, 2.9):
        shapes = {
            body: corners
            for body, _, corners, _ in cell.shapes([angle, -1.9, 1.7, 0.0, 1.6, 0.0], name)
        }
        # the pedestal's top is level and wider than the link
        apart = shapes["link_1"][:, 2].min() - shapes["pedestal"][:, 2].max()
        assert always.mm == pytest.approx(apart, abs=1e-6)
    q = random_joints(cell.robot, np.random.default_rng(5), 40)
    for one in q:
        told = cell.clearance(one, name)
        assert {told.first, told.second} != {"link_1", "pedestal"}
        every = cell.clearance(one, name, with_constant=True)
        assert every.mm == pytest.approx(min(told.mm, always.mm), abs=1e-6)


def test_the_nearest_branch_to_home_comes_first():
    cell = made_cell()
    target = pose((0.0, 0.0, 300.0), Rotation.from_euler("x", 180, degrees=True).as_matrix())[None]
    every = cell.reach(target, "up", all_branches=True)[0].branches
    assert len(every) > 2
    for one in every:
        first = cell.with_home(one).reach(target, "up")[0].branches[0]
        np.testing.assert_allclose(first, one, atol=1e-9)


def test_fixturings_change_without_a_new_arm():
    cell = made_cell().with_part(box_part())
    far = cell.with_fixturings({"far": Fixturing(pose((3000.0, 0.0, 0.0)))})
    assert far._arm is cell._arm
    poses = views(np.random.default_rng(0), 5, SIZE)
    assert {one.why for one in far.reach(poses, "far")} == {"beyond the arm's reach"}
    assert list(cell.fixturings) == ["up"]
    with pytest.raises(RobotError, match=r"fixturing must be one of 'far'. Got 'up'"):
        far.reach(poses, "up")


def test_a_pose_is_reached_if_one_fixturing_does():
    near = Fixturing(pose((700.0, 0.0, 0.0)), {"table": TABLE})
    far = Fixturing(pose((3000.0, 0.0, 0.0)))
    cell = made_cell(fixturings={"far": far, "near": near})
    poses = views(np.random.default_rng(3), 50, SIZE)
    expected = [1.0 if one.reached else -1.0 for one in cell.reach(poses, "near")]
    region = CellRegion(cell)
    np.testing.assert_array_equal(region.pose_margin(poses), expected)
    assert region.pose_margin(poses[:0]).shape == (0,)


def test_names_of_states_tell_cells_apart():
    one = made_cell()
    others = [
        made_cell("made_wrist"),
        made_cell(clearance_mm=11.0),
        made_cell(camera_body=()),
        made_cell(obstacles={"post": Box((500, 0, 0), (510, 10, 10))}),
        made_cell(fixturings={"up": Fixturing(pose((701.0, 0.0, 0.0)), {"table": TABLE})}),
        made_cell(fixturings={"up": Fixturing(pose((700.0, 0.0, 0.0)))}),
        made_cell(home=[0.0, -1.5, 1.5, 0.0, 0.0, 0.0]),
    ]
    assert len({cell.state_name for cell in [one, *others]}) == len(others) + 1
    assert made_cell().state_name == one.state_name


INVERSE = pose((0.0, 0.0, -90.0))
SCALED = np.diag([0.001, 0.001, 0.001, 1.0])
THROUGH = {"up": Fixturing(pose((700.0, 0.0, -30.0)), {"table": TABLE})}
IN_BASE = {"up": Fixturing(pose((-100.0, -50.0, 20.0)))}


POST = {"post": Box((780.0, 40.0, -50.0), (800.0, 60.0, 300.0))}
HULL = hull_of(POST["post"].corners(), "post")
MESH_POST = {"post": (HULL.corners, HULL.triangles)}


@pytest.mark.parametrize("post", [POST, MESH_POST], ids=["box", "mesh"])
@pytest.mark.parametrize("place", ["fixturing", "cell", "turntable"])
def test_a_post_through_the_part_is_refused(post, place):
    """No corner of the post or of the part is in the other one."""
    fixturing = Fixturing(pose((700.0, 0.0, 0.0)))
    changes = {}
    if place == "fixturing":
        fixturing = Fixturing(pose((700.0, 0.0, 0.0)), post)
    elif place == "cell":
        changes = {"obstacles": post}
    else:
        axis = ((800.0, 60.0, 0.0), (0.0, 0.0, 1.0))
        fixturing = Fixturing(pose((700.0, 0.0, 0.0)), axis=axis, angles=4, turning=post)
    cell = made_cell(fixturings={"up": fixturing}, **changes)
    with pytest.raises(
        RobotError, match=r"through other objects .* mm deep in post, 1 mm permitted"
    ):
        cell.with_part(box_part())


@pytest.mark.parametrize(
    ("x", "message"),
    [
        (np.eye(3), r"cam2flange must have shape \(4, 4\). Got \(3, 3\)"),
        ("up", "cam2flange must have shape"),
        (np.full((4, 4), np.nan), "cam2flange must hold finite numbers"),
        (np.diag([1.0, 1.0, -1.0, 1.0]), "must have a determinant of 1, not a mirror image"),
        (SCALED, "cam2flange must hold a rotation"),
        (pose((0.0, 0.0, 90.0)).T, "cam2flange must have the last row 0 0 0 1"),
        (
            pose((0.0, 0.0, 0.09)),
            "cam2flange must be in mm. Got a lever of 0.09 mm; is it in metres",
        ),
        (INVERSE, "a camera that looks at its own flange; is it the inverse, flange2cam"),
    ],
)
def test_hand_eye_calibrations_that_are_none(x, message):
    fixturings = {"up": Fixturing(np.eye(4))}
    with pytest.raises(RobotError, match=message):
        Cell(made_robot("made_wrist"), x, fixturings=fixturings)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"clearance_mm": -1.0}, "clearance_mm must be finite and not negative"),
        ({"fixturings": {}}, "fixturings must name at least one way the part lies. Got none"),
        ({"fixturings": {"up": np.eye(4)}}, "fixturings must hold a Fixturing for 'up'"),
        ({"home": [0.0] * 5}, "home must be 6 finite angles in rad"),
        (
            {"home": [0, -90, 90, 0, 0, 0]},
            "within the limits of joint 2. Got -90 rad.*; is it in deg",
        ),
        (
            {"home": [0.0, 0.5, 0.0, 0.0, 0.0, 0.0]},
            "home must be free of collisions in fixturing 'up'. Got .* touches table",
        ),
        (
            {"obstacles": {"table": TABLE}},
            "obstacles must have names that no other object has. Got 'table'",
        ),
        ({"obstacles": {"part": TABLE}}, "must have names that no other object has. Got 'part'"),
        ({"obstacles": {"post": "post.step"}}, "obstacle 'post' must be a mesh file"),
        ({"camera_body": ["lens.stl"]}, "camera_body must be a file that can be read"),
    ],
)
def test_cells_that_are_none(changes, message):
    with pytest.raises((RobotError, ValueError), match=message):
        made_cell(**changes)


@pytest.mark.parametrize(
    ("fixturings", "message"),
    [
        (
            THROUGH,
            "through other objects in fixturing 'up'. Got .* mm, where the part is 30 mm deep in table",
        ),
        (
            IN_BASE,
            "through other objects in fixturing 'up'. Got .* mm, where the part is inside base_link",
        ),
        (
            {"up": Fixturing(pose((0.65, 0.15, 0.1)))},
            r"Got \(0.65, 0.15, 0.1\) mm, where the part is .*; 0.65 m are 650\.",
        ),
    ],
    ids=["table", "base", "metres"],
)
def test_a_part_through_other_bodies_is_refused(fixturings, message):
    cell = made_cell(fixturings=fixturings)
    with pytest.raises(RobotError, match=message):
        cell.with_part(box_part())


def test_home_inside_the_part_is_refused():
    cell = made_cell(home=[0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    high = {"up": Fixturing(pose((1000.0, -400.0, 0.0)))}
    with pytest.raises(RobotError, match="home must be free of collisions in fixturing 'up'"):
        cell.with_fixturings(high).with_part(box_part(high=(200.0, 200.0, 300.0)))


@pytest.mark.parametrize("missing", ["eaik.IK_HP", "fcl"])
def test_without_the_extra_a_cell_says_what_to_install(missing, monkeypatch, tmp_path):
    robot = from_text(tmp_path, urdf_text())
    branches.needed.cache_clear()
    monkeypatch.setitem(sys.modules, missing, None)
    with pytest.raises(RobotError, match=r"pip install '\.\[robot\]'"):
        Cell(robot, CAM2FLANGE, fixturings={"up": Fixturing(np.eye(4))})
    branches.needed.cache_clear()


def without_bodies(folder, links, **options):
    """Return the made robot without bodies of some links."""
    text = urdf_text("made_wrist")
    for link in links:
        text = re.sub(
            f'(<link name="{link}">).*?</link>', r"\1</link>", text, count=1, flags=re.DOTALL
        )
    return from_text(folder, text, **options)


def cell_of(robot, **changes):
    options = {
        "camera_body": CAMERA_BODY,
        "fixturings": {"up": Fixturing(pose((700.0, 0.0, 0.0)), {"table": TABLE})},
    }
    return Cell(robot, CAM2FLANGE, **(options | changes))


LINKS = tuple(f"link_{number}" for number in range(1, 7))


@pytest.mark.parametrize(
    ("links", "field"),
    [(("link_3",), r'bodiless_links = \["link_3"\]'), (LINKS, 'bodiless_links = "all"')],
)
def test_a_link_without_a_body_must_be_named(links, field, tmp_path):
    message = f"robot 'made_wrist' must have geometry .* Got none of {', '.join(links)}; {field}"
    with pytest.raises(RobotError, match=message):
        cell_of(without_bodies(tmp_path, links))
    stated = "all" if links == LINKS else list(links)
    cell = cell_of(without_bodies(tmp_path, links, bodiless_links=stated))
    words = f"collisions of links without geometry in the URDF were NOT checked: {', '.join(links)}"
    assert cell.robot.unchecked == words
    assert cell.to_dict()["bodiless_links"] == list(links)
    assert pickle.loads(pickle.dumps(cell)).robot.unchecked == words


def test_a_base_without_a_body_is_no_matter(tmp_path):
    """It moves against nothing but its own arm."""
    assert cell_of(without_bodies(tmp_path, ["base_link"])).robot.unchecked == ""


def near_wrist(gap, **changes):
    """Return a cell whose camera begins so far before link_5 (mm), about the axis of the last joint."""
    robot = made_robot("made_wrist")
    link_5 = np.concatenate([hull.corners for hull in robot.hulls[5]])
    frames = robot.chain.frames(np.zeros((1, 6)))[0]
    tip = invert(compose(frames[6], robot.chain.tip))
    heights = (compose(tip, frames[5]) @ np.c_[link_5, np.ones(len(link_5))].T)[2]
    start = heights.max() + gap
    body = Box((-30.0, -30.0, start - 60.0), (30.0, 30.0, 10.0))
    return Cell(
        robot,
        pose((0.0, 0.0, 60.0)),
        camera_body=[body],
        fixturings={"up": Fixturing(pose((700.0, 0.0, 0.0)))},
        **changes,
    )


HOME = np.array([0.0, 0.0, 0.0, 0.0, 0.5, 0.0])


def test_a_camera_mounted_near_its_own_wrist_may_stay_there():
    """The last joint turns the camera about its own axis, so the gap is the same in all joints."""
    cell = near_wrist(3.0, home=HOME)
    for q6 in (0.0, 0.4, 2.0):
        q = np.array([*HOME[:5], q6])
        assert cell.free(q[None], "up").all()
        assert cell.slack_bound(q[None], "up")[0] > 0
    assert cell.near_by_mount == (
        "camera is mounted 3 mm from link_5, nearer than clearance_mm = 10 mm: these two must only not touch",
    )
    assert near_wrist(11.0, home=HOME).near_by_mount == ()


def test_a_camera_mounted_into_its_own_wrist_is_refused():
    with pytest.raises(RobotError, match=r"home must be free .* Got camera touches link_5"):
        near_wrist(-1.0, home=HOME)


def test_what_home_is_too_near_to_is_told_in_mm():
    """The camera looks down; its front is 3 mm above the box."""
    robot = made_robot("made_wrist")
    looks_down = np.array([0.0, 0.0, 0.0, 0.0, np.pi / 2, 0.0])
    assert robot.forward(looks_down)[2, 2] == pytest.approx(-1.0)
    front = robot.forward(looks_down)[:3, 3] - [0.0, 0.0, 70.0]
    box = Box((front - [50, 50, 53]).tolist(), (front - [-50, -50, 3]).tolist())
    with pytest.raises(RobotError, match="Got camera is 3 mm from block; 10 mm are required"):
        near_wrist(30.0, home=looks_down, obstacles={"block": box})


# A cell names in what it differs from the cell of a plan.


POST_CELL_IDENTITY = Box((500.0, 200.0, 0.0), (510.0, 210.0, 10.0))
HOME_CELL_IDENTITY = [0.0, -1.5, 1.5, 0.0, 0.0, 0.0]
UP = pose((700.0, 0.0, 0.0))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({}, ""),
        ({"clearance_mm": 11.0}, "clearance_mm"),
        ({"camera_body": ()}, "camera_body"),
        ({"obstacles": {"post": POST_CELL_IDENTITY}}, "obstacles"),
        ({"home": HOME_CELL_IDENTITY}, "home"),
        ({"fixturings": {"up": Fixturing(UP)}}, "fixturing 'up'"),
        (
            {"fixturings": {"up": Fixturing(pose((701.0, 0, 0)), {"table": TABLE})}},
            "fixturing 'up'",
        ),
        (
            {"fixturings": {"over": Fixturing(UP, {"table": TABLE})}, "clearance_mm": 9.0},
            "clearance_mm, fixturing 'up' (gone) and fixturing 'over' (new)",
        ),
        (
            {"fixturings": {"up": Fixturing(UP, {"table": TABLE}, axis=((0, 0, 0), (0, 0, 1)))}},
            "fixturing 'up'",
        ),
    ],
)
def test_a_cell_names_what_differs(changes, words):
    assert made_cell(**changes).difference(made_cell().to_dict()) == words


def test_another_robot_or_another_calibration_is_named():
    before = made_cell().to_dict()
    assert made_cell("made_wrist").difference(before).startswith("robot")
    cell = made_cell()
    other = Cell(
        cell.robot,
        pose((0.0, 0.0, 91.0)),
        camera_body=CAMERA_BODY,
        fixturings=cell.fixturings,
    )
    assert other.difference(before) == "cam2flange"


def test_plans_that_name_no_parts():
    before = made_cell().to_dict()
    assert made_cell(clearance_mm=9.0).difference({}) == ""
    del before["parts"]
    assert made_cell().difference(before) == ""
    assert made_cell(clearance_mm=9.0).difference(before) == (
        "something that the plan does not name"
    )


def test_the_record_is_as_the_schema_says():
    record = made_cell().to_dict()
    assert set(record) == {"robot", "digest", "fixturings", "parts"}
    assert np.array(record["fixturings"]["up"]).shape == (4, 4)
    assert all(len(value) == 16 for value in record["parts"].values())
