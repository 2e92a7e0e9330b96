"""Distances of arm and surroundings against dense samples, and how far straight moves stay free."""

import numpy as np
import pytest
from robot_cells import CAM2FLANGE, NAMES, made_cell, made_robot, pose, random_joints, random_pose
from scipy.optimize import nnls
from scipy.spatial.transform import Rotation

from planner import Box, Cell, Fixturing, RobotError
from planner.robotcell.bodies import (
    Standing,
    grown,
    hull_of,
    mesh_of,
    round_points,
    standing_bodies,
    surface_of,
)
from planner.robotcell.collisions import Advance, Arm, Moving, PairGroup, static_levers
from planner.robotcell.urdf import carry

CUBE = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)


def pair(hull, standing, clearance_mm=0.0):
    """Return a group of one moving hull, in frame 6, and one body that stands."""
    arm = Arm([Moving("link", 6, hull)], 6)
    return PairGroup(arm, [standing], [0], [], clearance_mm)


def frames_at(pose):
    frames = np.zeros((1, 7, 4, 4))
    frames[:, 6] = pose
    return frames


def distance_between(first, second):
    """Return two numbers that hold the distance of two hulls of points between them.

    The upper one is the distance of two of their points, the lower one their gap along the line through these.
    """
    sizes = (len(first), len(second))
    sums = 1e4 * np.repeat(np.eye(2), sizes, axis=1)
    rows = np.concatenate([np.concatenate([first, -second]).T / 100.0, sums])
    weights = nnls(rows, [0.0, 0.0, 0.0, 1e4, 1e4], maxiter=2000)[0]
    parts = np.split(weights, [sizes[0]])
    gap = parts[1] / parts[1].sum() @ second - parts[0] / parts[0].sum() @ first
    upper = np.linalg.norm(gap)
    direction = gap / upper
    return (second @ direction).min() - (first @ direction).max(), upper


@pytest.mark.parametrize("seed", range(12))
def test_distances_of_hulls_are_between_a_gap_and_two_points(seed):
    rng = np.random.default_rng(seed)
    moving = hull_of(rng.normal(size=(10, 3)) * 40.0, "body")
    still = Standing("box", random_pose(rng), hull_of(CUBE * [60.0, 30.0, 10.0], "body"))
    at = random_pose(rng, 200.0)
    at[0, 3] += 300.0
    group = pair(moving, still)
    corners = carry(still.pose, still.shape.corners)
    lower, upper = distance_between(carry(at, moving.corners), corners)
    assert 0 < upper < lower + 0.1
    frames = frames_at(at)
    assert lower - 1e-4 < group.distance(0, frames[0]) < upper + 1e-4
    assert group.bounds(frames)[0, 0] < upper


@pytest.mark.parametrize("seed", range(12))
def test_a_mesh_of_a_convex_body_is_as_far_as_its_hull(seed):
    rng = np.random.default_rng(100 + seed)
    moving = hull_of(rng.normal(size=(30, 3)) * 40.0, "body")
    box = hull_of(CUBE * [60.0, 30.0, 40.0], "body")
    still = random_pose(rng)
    at = frames_at(random_pose(rng, 120.0))
    solid = pair(moving, Standing("box", still, box))
    mesh = pair(moving, Standing("mesh", still, surface_of(box.corners, box.triangles)))
    assert mesh.distance(0, at[0]) == pytest.approx(solid.distance(0, at[0]), abs=1e-5)
    assert mesh.bounds(at)[0, 0] <= mesh.distance(0, at[0]) + 1e-6


@pytest.mark.parametrize("mesh", [False, True], ids=["box", "mesh"])
@pytest.mark.parametrize(("gap", "near"), [(4.9, True), (5.1, False), (0.0, True), (40.0, False)])
def test_boxes_with_a_clearance_of_five(gap, near, mesh):
    box = hull_of(CUBE * 50.0, "body")
    shape = surface_of(box.corners, box.triangles) if mesh else box
    group = pair(box, Standing("other", np.eye(4), shape), clearance_mm=5.0)
    at = np.eye(4)
    at[2, 3] = 100.0 + gap
    frames = frames_at(at)
    assert (group.blocker(frames[0], group.bounds(frames)[0]) == 0) is near
    assert group.distance(0, frames[0]) == pytest.approx(gap, abs=1e-6)


def test_what_is_wholly_inside_touches():
    part = hull_of(CUBE * 100.0, "body")
    small = hull_of(CUBE * 5.0, "body")
    for shape in (part, surface_of(part.corners, part.triangles)):
        for moving, still in ((small, shape), (part, hull_of(CUBE * 5.0, "body"))):
            group = pair(moving, Standing("part", np.eye(4), still), clearance_mm=1.0)
            frames = frames_at(np.eye(4))
            assert group.distance(0, frames[0]) == 0.0
            assert group.blocker(frames[0], group.bounds(frames)[0]) == 0


def test_a_hollow_is_no_inside():
    outer = hull_of(CUBE * 100.0, "body")
    inner = hull_of(CUBE * 60.0, "body")
    corners = np.concatenate([outer.corners, inner.corners])
    triangles = np.concatenate([outer.triangles, inner.triangles[:, ::-1] + len(outer.corners)])
    shell = surface_of(corners, triangles)
    assert shell.closed
    group = pair(hull_of(CUBE * 5.0, "body"), Standing("part", np.eye(4), shell), clearance_mm=1.0)
    frames = frames_at(np.eye(4))
    assert group.distance(0, frames[0]) == pytest.approx(55.0)
    in_wall = frames_at(np.eye(4))
    in_wall[0, 6, 0, 3] = 80.0
    assert group.distance(0, in_wall[0]) == 0.0


def test_the_closest_of_many_is_found():
    arm = Arm([Moving("link", 6, hull_of(CUBE, "body"))], 6)
    names = {f"box {k}": Box((5.0 * k + 2, -1, -1), (5.0 * k + 3, 1, 1)) for k in range(1, 5)}
    group = PairGroup(arm, standing_bodies(names, "obstacle"), [0], [], 10.0)
    frames = frames_at(np.eye(4))
    bounds = group.bounds(frames)
    mm, column = group.closest(frames[0], bounds[0], np.zeros(4), np.inf)
    assert mm == pytest.approx(6.0)
    assert group.names(column) == ("link", "box 1")
    # what is far enough is bounded only
    assert group.closest(frames[0], bounds[0], np.zeros(4), 1.0) == (bounds[0].min(), -1)


def test_a_box_standing_elsewhere_shares_its_geometry():
    box = Standing("part", np.eye(4), hull_of(CUBE, "body"))
    at = np.eye(4)
    at[0, 3] = 50.0
    moved = box.at(at)
    assert moved.geometry is box.geometry
    np.testing.assert_allclose(moved.distance_bound(np.zeros((1, 3))), [49.0])


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


# Hulls contain what they stand for, and spheres cover hulls.


CUBE_BODIES = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)


def inside(hull, rng, count):
    """Return drawn points (n, 3) of a hull: means of its corners with drawn weights."""
    weights = rng.dirichlet(np.full(len(hull.corners), 0.2), count)
    return weights @ hull.corners


def covered(hull, points):
    apart = np.linalg.norm(points[:, None] - hull.centres, axis=2)
    return (apart <= hull.radii).any(axis=1)


def heights(hull, points):
    """Return how far points (n, 3) are outside of the planes of a hull, (n,)."""
    sides = hull.corners[hull.triangles]
    normals = np.cross(sides[:, 1] - sides[:, 0], sides[:, 2] - sides[:, 0])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    return ((points[:, None] - sides[:, 0]) * normals).sum(axis=2).max(axis=1)


@pytest.mark.parametrize("seed", range(6))
def test_spheres_cover_a_hull(seed):
    rng = np.random.default_rng(seed)
    hull = hull_of(rng.normal(size=(60, 3)) * rng.choice([10.0, 50.0, 400.0], 3), "body")
    assert covered(hull, inside(hull, rng, 2000)).all()
    assert covered(hull, hull.corners).all()


@pytest.mark.parametrize("name", NAMES)
def test_spheres_cover_the_links(name):
    rng = np.random.default_rng(0)
    for hulls in made_robot(name).hulls:
        for hull in hulls:
            assert covered(hull, inside(hull, rng, 300)).all()


def test_a_long_body_has_slim_spheres():
    box = hull_of(CUBE_BODIES * [600.0, 100.0, 100.0], "body")
    assert len(box.radii) > 2
    # one ball about all of it has 308 mm
    assert box.radii.max() < 110.0


@pytest.mark.parametrize("seed", range(4))
def test_a_grown_hull_contains_what_is_near(seed):
    rng = np.random.default_rng(seed)
    hull = hull_of(rng.normal(size=(8 if seed % 2 else 200, 3)) * 50.0, "body")
    outer = grown(hull, 7.0)
    steps = rng.normal(size=(2000, 3))
    steps *= 7.0 / np.linalg.norm(steps, axis=1)[:, None]
    assert heights(outer, inside(hull, rng, 2000) + steps).max() < 1e-6


def test_a_grown_box_keeps_the_distance_of_its_sides():
    outer = grown(hull_of(CUBE_BODIES * 100.0, "body"), 5.0)
    np.testing.assert_allclose(outer.corners.min(axis=0), [-5.0] * 3, atol=1e-9)
    np.testing.assert_allclose(outer.corners.max(axis=0), [105.0] * 3, atol=1e-9)


@pytest.mark.parametrize("length", [0.0, 80.0])
def test_round_bodies_are_within_their_hulls(length):
    hull = hull_of(round_points(30.0, length), "body")
    rng = np.random.default_rng(0)
    points = rng.normal(size=(3000, 3))
    if length:
        points[:, :2] *= 30.0 / np.linalg.norm(points[:, :2], axis=1)[:, None]
        points[:, 2] = rng.uniform(-length / 2, length / 2, 3000)
    else:
        points *= 30.0 / np.linalg.norm(points, axis=1)[:, None]
    assert heights(hull, points).max() < 1e-9
    assert np.linalg.norm(hull.corners[:, :2], axis=1).max() < 31.5


def test_a_box_may_be_turned():
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    box = Box((0, 0, 0), (10, 20, 30), pose((100.0, 0.0, 0.0), turn))
    np.testing.assert_allclose(box.corners().min(axis=0), (80.0, 0.0, 0.0))
    np.testing.assert_allclose(box.corners().max(axis=0), (100.0, 10.0, 30.0))


@pytest.mark.parametrize(
    ("low", "high", "message"),
    [
        ((0, 0, 0), (1, 1, 0), "low must be below high in every coordinate"),
        ((0, 0), (1, 1, 1), r"low must be three finite numbers. Got \(0, 0\)"),
        ((0, 0, 0), (1, float("inf"), 1), "high must be three finite numbers"),
        ("abc", (1, 1, 1), "low must be three finite numbers"),
    ],
)
def test_boxes_that_are_none(low, high, message):
    with pytest.raises(RobotError, match=message):
        Box(low, high)


@pytest.mark.parametrize(
    ("body", "message"),
    [
        (3, "camera_body must be a Box, a mesh file, or corners and triangles. Got 3"),
        ((CUBE_BODIES, [[0, 1, 8]]), "must number its corners from 0. Got 8 of 8"),
        ((CUBE_BODIES, [[0, 1]]), r"must have corners \(v, 3\) that are finite and triangles"),
        ("lens.step", r"must be a mesh file \(.stl, .obj, .ply, .off\). Got 'lens.step'"),
        ("no.stl", "must be a file that can be read. Got 'no.stl'"),
    ],
)
def test_bodies_that_are_none(body, message):
    with pytest.raises(RobotError, match=message):
        mesh_of(body, "camera_body")


def test_a_damaged_mesh_is_refused(tmp_path):
    path = tmp_path / "lens.stl"
    path.write_bytes(b"solid x\nfacet\nvertex 1 2\n")
    with pytest.raises(RobotError, match="camera_body must be an intact mesh"):
        mesh_of(path, "camera_body")


def test_only_a_closed_surface_has_an_inside():
    hull = hull_of(CUBE_BODIES, "body")
    assert surface_of(hull.corners, hull.triangles).closed
    assert not surface_of(hull.corners, hull.triangles[1:]).closed
    assert not surface_of(hull.corners, np.concatenate([hull.triangles, hull.triangles[:1]])).closed


def turns_about(axis, angle):
    return Rotation.from_rotvec(np.asarray(axis) * angle).as_matrix()


@pytest.mark.parametrize("name", NAMES)
def test_frames_are_products_of_poses(name):
    robot = made_robot(name)
    q = random_joints(robot, np.random.default_rng(4), 20)
    for joints, frames in zip(q, robot.chain.frames(q), strict=True):
        expected = np.eye(4)
        for k, step in enumerate(robot.chain.steps):
            expected = expected @ step @ pose(rotation=turns_about([0.0, 0.0, 1.0], joints[k]))
            np.testing.assert_allclose(frames[k + 1], expected, atol=1e-9)


@pytest.mark.parametrize("name", NAMES)
def test_moves_are_bounded_by_the_same_spheres_as_poses(name):
    """Shares of a move that one joint makes: the compiled loop against distances of spheres, and levers drawn."""
    cell = made_cell(name)
    rng = np.random.default_rng(6)
    q = random_joints(cell.robot, rng, 40)
    around = cell._around("up", cell._hand.standing("up", 0.0)).all
    advance = Advance(cell.robot.chain, around.arm, around)
    frames = cell.robot.chain.frames(q)
    bounds = around.bounds(frames)
    turn = np.zeros(6)
    turn[0] = 0.5
    shares, motions, _ = advance.approaches(frames, turn, np.full(40, 1.0), 1.0)
    moves = motions > 0
    np.testing.assert_allclose(
        shares[moves] * motions[moves], (bounds - around.required)[moves], rtol=1e-12, atol=1e-9
    )
    # the first joint moves no pair of the arm's own bodies, except against the base
    for column, (first, second, is_own) in enumerate(around.pairs):
        segments = (
            around.arm.bodies[first].segment,
            around.arm.bodies[second].segment if is_own else 0,
        )
        assert moves[:, column].all() == (min(segments) == 0)
    # points of bodies move no farther than stated
    for column, (first, _, is_own) in enumerate(around.pairs):
        if is_own:
            continue
        body = around.arm.bodies[first]
        points = carry(frames[:, body.segment], body.hull.corners)
        axis = frames[:, 1, :3, 2][:, None]
        apart = points - frames[:, 1, :3, 3][:, None]
        radii = np.linalg.norm(np.cross(np.broadcast_to(axis, apart.shape), apart), axis=-1).max(
            axis=1
        )
        assert (0.5 * radii <= motions[:, column] + 1e-6).all()
