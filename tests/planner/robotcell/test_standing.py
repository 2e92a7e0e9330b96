"""What an obstacle hides: by hand, and against many rays."""

import numpy as np
import pytest
from robot_cells import pose, random_pose
from scipy.spatial.transform import Rotation

from planner import Box, Fixturing, RobotError
from planner.robotcell.bodies import (
    SKIN_MM,
    Standing,
    hull_of,
    standing_bodies,
    sunk_mm,
    surface_of,
)
from planner.robotcell.urdf import compose

EYE = np.array([[0.0, 0.0, 300.0]])
LINE = np.array([[[-50.0, 0.0, 0.0], [50.0, 0.0, 0.0]]])


def hides(box, eyes=EYE, segments=LINE):
    return standing_bodies({"box": box}, "obstacle")[0].hides(eyes, segments)


@pytest.mark.parametrize(
    ("low", "high", "hidden"),
    [
        # a plate between eye and line
        ((-100, -100, 100), (100, 100, 120), True),
        # beside it, behind it, above the eye
        ((-100, 10, 100), (100, 100, 120), False),
        ((-100, -100, -50), (100, 100, 0), False),
        ((-100, -100, 320), (100, 100, 340), False),
        # a thin post before the middle of the line, which hides neither end
        ((-5, -5, 40), (5, 5, 60), True),
        # as far into the table as what a part may sink into it, and farther
        ((-100, -100, -50), (100, 100, SKIN_MM * 0.9), False),
        ((-100, -100, -50), (100, 100, SKIN_MM * 1.5), True),
        # thinner than the skin
        ((-100, -100, 100), (100, 100, 101), False),
    ],
)
def test_boxes_hide_what_is_behind_them(low, high, hidden):
    assert hides(Box(low, high)).tolist() == [[hidden]]


def inside(point, box):
    local = np.linalg.inv(box.pose) @ [*point, 1.0]
    return np.all(local[:3] > np.array(box.low) + SKIN_MM) and np.all(
        local[:3] < np.array(box.high) - SKIN_MM
    )


@pytest.mark.parametrize("seed", range(8))
def test_a_box_hides_what_a_point_of_the_triangle_is_inside_of(seed):
    rng = np.random.default_rng(seed)
    box = Box((-40, -25, -10), (40, 25, 10), random_pose(rng, 60.0))
    eyes = rng.uniform(-150.0, 150.0, (5, 3))
    segments = rng.uniform(-150.0, 150.0, (6, 2, 3))
    hidden = hides(box, eyes, segments)
    weights = rng.dirichlet(np.ones(3), 600)
    for i, eye in enumerate(eyes):
        for j, segment in enumerate(segments):
            points = weights @ np.array([eye, *segment])
            if any(inside(point, box) for point in points):
                assert hidden[i, j]
            # what is not hidden can be parted from the box by a plane between both
            if not hidden[i, j]:
                assert not inside(points.mean(axis=0), box)
    assert 0 < hidden.sum() < hidden.size


@pytest.mark.parametrize("seed", range(4))
def test_hiding_does_not_depend_on_the_frame(seed):
    rng = np.random.default_rng(seed)
    box = Box((-40, -25, -10), (40, 25, 10), random_pose(rng, 60.0))
    eyes = rng.uniform(-150.0, 150.0, (20, 3))
    segments = rng.uniform(-150.0, 150.0, (20, 2, 3))
    motion = random_pose(rng, 500.0)
    moved = Box(box.low, box.high, motion @ box.pose)
    carried = segments @ motion[:3, :3].T + motion[:3, 3]
    again = hides(moved, eyes @ motion[:3, :3].T + motion[:3, 3], carried)
    np.testing.assert_array_equal(hides(box, eyes, segments), again)


def test_a_mesh_hides_what_its_box_does():
    rng = np.random.default_rng(0)
    box = Box((-40, -25, -10), (40, 25, 10))
    hull = hull_of(box.corners(), "body")
    mesh = standing_bodies({"mesh": (hull.corners, hull.triangles)}, "obstacle")[0]
    eyes = rng.uniform(-1.0, 1.0, (30, 3)) * 80.0 + [0.0, 0.0, 200.0]
    segments = rng.uniform(-1.0, 1.0, (30, 2, 3)) * 60.0 - [0.0, 0.0, 150.0]
    seen = mesh.hides(eyes, segments)
    whole = hides(box, eyes, segments)
    # rays meet the skin, and miss what is between them
    assert (seen != whole).mean() < 0.05
    assert 0.1 < seen.mean() < 0.9
    assert not mesh.hides(EYE, LINE + np.array([0.0, 0.0, 100.0])).any()


def test_moved_fixturings_take_their_obstacles_along():
    corners = hull_of(np.random.default_rng(0).normal(size=(20, 3)) * 30.0, "body")
    obstacles = {
        "table": Box((0, 0, 0), (100, 100, 10)),
        "clamp": (corners.corners, corners.triangles),
    }
    motion = pose((10.0, 20.0, 30.0), Rotation.from_euler("z", 90, degrees=True).as_matrix())
    moved = Fixturing(pose((1.0, 0.0, 0.0)), obstacles).moved(motion)
    np.testing.assert_allclose(moved.part2base[:3, 3], (10.0, 21.0, 30.0))
    np.testing.assert_allclose(moved.obstacles["table"].corners().min(axis=0), (-90.0, 20.0, 30.0))
    first = corners.corners[0] @ motion[:3, :3].T + motion[:3, 3]
    np.testing.assert_allclose(moved.obstacles["clamp"][0][0], first)


def test_a_fixturing_needs_a_rigid_pose():
    with pytest.raises(RobotError, match="part2base must hold a rotation"):
        Fixturing(np.diag([2.0, 1.0, 1.0, 1.0]))


def test_a_standing_body_knows_how_far_points_are():
    box = Standing("box", pose((0.0, 0.0, 10.0)), hull_of(Box((0, 0, 0), (1, 1, 1)).corners(), "b"))
    np.testing.assert_allclose(
        box.distance_bound(np.array([[0.5, 0.5, 0.0], [4.0, 0.5, 14.0]])), [10.0, np.hypot(3, 3)]
    )


# a plate of 200 x 120 x 80 mm with a square bore of 40 mm through its middle, along z
PLATE = np.array([200.0, 120.0, 80.0])


def bored_plate():
    """Return the plate as a closed surface."""
    outer = np.array([(0, 0), (200, 0), (200, 120), (0, 120)], dtype=float)
    inner = np.array([(80, 40), (120, 40), (120, 80), (80, 80)], dtype=float)
    flat = np.concatenate([outer, inner])
    corners = np.concatenate([np.c_[flat, np.full(8, z)] for z in (0.0, PLATE[2])])
    triangles = []
    for k in range(4):
        n = (k + 1) % 4
        # the top and the bottom between outline and bore, then the sides and the bore
        triangles += [(8 + k, 8 + n, 12 + n), (8 + k, 12 + n, 12 + k)]
        triangles += [(k, 4 + n, n), (k, 4 + k, 4 + n)]
        triangles += [(k, n, 8 + n), (k, 8 + n, 8 + k)]
        triangles += [(4 + k, 12 + n, 4 + n), (4 + k, 12 + k, 12 + n)]
    return surface_of(corners, np.array(triangles))


def boxed(low, high, kind):
    """Return a box as an obstacle, or the same as a mesh."""
    box = Box(low, high)
    hull = hull_of(box.corners(), "box")
    body = box if kind == "box" else (hull.corners, hull.triangles)
    return standing_bodies({"body": body}, "obstacle")[0]


SUNK = {
    # a table below: in contact, 3 mm apart, and 0.5 mm and 30 mm too high
    "contact": ((-300, -300, -50), (500, 500, 0), 0.0),
    "apart": ((-300, -300, -50), (500, 500, -3), 0.0),
    "half a millimetre": ((-300, -300, -50), (500, 500, 0.5), 0.5),
    "through the table": ((-300, -300, -50), (500, 500, 30), 30.0),
    # a post whose corners are all outside, through 80 mm of the plate; its middle is 20 mm from its sides
    "post": ((20, 40, -100), (60, 80, 200), 40.0),
    # in the bore: 40 mm square, as wide as the bore or less
    "in the bore": ((85, 45, -100), (115, 75, 200), 0.0),
    "fills the bore": ((80, 40, -100), (120, 80, 200), 0.0),
    # wholly inside the material, 5 mm below the top
    "buried": ((30, 30, 65), (50, 50, 75), 15.0),
    # a block about the whole plate, whose outer corners are 100 mm from its sides
    "around": ((-100, -100, -100), (300, 220, 180), 100.0),
}


@pytest.mark.parametrize("kind", ["box", "mesh"])
@pytest.mark.parametrize("case", SUNK)
@pytest.mark.parametrize("seed", [None, 1])
def test_how_deep_a_body_is_in_the_part(case, kind, seed):
    low, high, mm = SUNK[case]
    surface = bored_plate()
    assert surface.closed
    part = Standing("part", np.eye(4), surface)
    body = boxed(low, high, kind)
    if seed is not None:
        # the answer is the same from another frame
        motion = random_pose(np.random.default_rng(seed))
        part = part.at(motion)
        body = body.at(compose(motion, body.pose))
    least = {"post": 30.0, "buried": 14.0, "around": 100.0}.get(case, mm)
    most = {"post": 40.0, "around": 180.0}.get(case, mm)
    assert least - 0.02 <= sunk_mm(part, body) <= most + 0.02
    assert sunk_mm(body, part) == sunk_mm(part, body)


def test_an_open_mesh_in_the_part_is_in_it():
    """A sheet without thickness, 20 mm below the top."""
    corners = np.array([(10.0, 10.0, 60.0), (70.0, 10.0, 60.0), (10.0, 70.0, 60.0)])
    sheet = standing_bodies({"sheet": (corners, np.array([[0, 1, 2]]))}, "obstacle")[0]
    part = Standing("part", np.eye(4), bored_plate())
    # the deepest point is 20 mm below the top, and farther from all sides; the corner is 10 mm from two
    assert sunk_mm(part, sheet) == pytest.approx(20.0, abs=0.02)
