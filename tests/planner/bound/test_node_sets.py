"""No view that a pose has of two entities is called impossible; some that none has are."""

import math
from dataclasses import dataclass

import numpy as np
import pytest
from grid_box import BoxCell
from scipy.spatial.transform import Rotation

from planner import Camera
from planner.bound.boxes import _grow, search
from planner.bound.pose_tree import (
    Nodes,
    _in_view,
    _nearest_depth,
    _patch_frames,
    _share_viewpoint,
    too_far_apart,
)
from planner.bound.view import Cells, Frustum, Segments
from planner.camera.pose import look_at

pytestmark = pytest.mark.uncompiled

# a short distance and a wide aperture: 1 mm of depth
CAMERA = Camera(25.0, (0.00345, 0.00345), (2448, 2048), 8.0, 120.0)


def frustum(camera=CAMERA, far=None):
    near, deep = camera.depth_of_field_mm
    tan_x, tan_y = (
        n / 2 * camera.pixel_pitch_mm[0] / camera.image_distance_mm for n in camera.resolution
    )
    return Frustum(near, far or deep, tan_x, tan_y, math.atan(math.hypot(tan_x, tan_y)))


def pair(points):
    ends = np.asarray(points, dtype=float).reshape(2, 2, 3)
    return Segments(ends, np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1), np.zeros(2))


@pytest.mark.parametrize("far", [None, 180.0, 1e4])
@pytest.mark.parametrize("at_limits", [False, True])
def test_what_a_pose_sees_is_possible_for_every_ball_around_its_eye(far, at_limits):
    view = frustum(far=far)
    rng = np.random.default_rng(5)
    for _ in range(3000):
        eye = rng.uniform(-200, 200, 3)
        pose = look_at(eye, eye + rng.normal(size=3), roll=rng.uniform(-np.pi, np.pi)).reshape(4, 4)
        share = rng.uniform(-1, 1, (4, 3))
        if at_limits:
            share = np.sign(share) * (1 - 1e-9)
        depth = view.near + (share[:, 2] + 1) / 2 * (view.far - view.near)
        seen = np.column_stack(
            [share[:, 0] * view.tan_x * depth, share[:, 1] * view.tan_y * depth, depth]
        )
        points = seen @ pose[:3, :3].T + eye
        radius = rng.choice([0.0, 1e-6, 1.0, 30.0, 200.0])
        away = rng.normal(size=3)
        centre = eye + radius * rng.uniform(0, 1) * away / np.linalg.norm(away)
        assert _in_view(centre, radius, pair(points), view)


def at(view_angle_deg, distance):
    """A point seen from the origin at an angle from the z axis."""
    turn = math.radians(view_angle_deg)
    return [distance * math.sin(turn), 0.0, distance * math.cos(turn)]


def possible(*points, radius=0.0):
    return _in_view(np.zeros(3), radius, pair(points), frustum())


def test_points_at_the_nearest_distance_are_sharp_only_on_the_axis():
    """Depth is distance times cosine, so at z- / cos(5°) the axis is at most 5° off."""
    near = CAMERA.depth_of_field_mm[0]
    for distance, together in (
        (near / math.cos(math.radians(5.01)), True),
        (near / math.cos(math.radians(4.99)), False),
    ):
        ends = at(-5, distance), at(5, distance)
        assert possible(*ends, *ends) == together
        # two ends of one entity, with another entity between them
        between = at(0, near + 0.5), at(0, near + 0.5)
        assert possible(*ends, *between) == possible(*between, *ends) == together
    # a ball so large that the eye may be farther away
    ends = at(-5, near + 0.1), at(5, near + 0.1)
    assert not possible(*ends, *ends)
    assert possible(*ends, *ends, radius=1.0)


def test_an_axis_along_a_line_longer_than_the_depth_of_field_has_one_end_out_of_focus():
    """Of two points 4 mm apart in 1 mm of depth the axis is at most asin(1/4) from square to their line."""
    near, far = CAMERA.depth_of_field_mm
    limit = math.degrees(math.asin((far - near) / 4))
    middle = np.array(at(0, (near + far) / 2))
    for tilt, together in ((limit - 0.5, True), (limit + 25, False), (89, False)):
        turn = math.radians(tilt)
        half = 2 * np.array([math.cos(turn), 0.0, math.sin(turn)])
        ends = middle - half, middle + half
        assert possible(*ends, *ends) == together


def test_of_two_points_on_one_line_of_sight_farther_apart_than_the_depth_of_field_one_is_not_sharp():
    """Each alone can be sharp, the farther one in a corner of the image; together they are 2 mm apart in depth."""
    near, far = CAMERA.depth_of_field_mm
    assert far - near < 1.1
    first = at(0, near + 0.5)
    second = at(0, near + 2.5)
    assert possible(first, first, first, first)
    assert possible(second, second, second, second)
    assert not possible(first, second, first, second)
    assert possible(first, at(0, far - 0.1), first, at(0, far - 0.1))


def test_an_image_that_must_be_longer_than_it_can_be_excludes():
    """An edge of 4 mm, square to the axis at the nearest sharp distance, is imaged 4 / near image distances long."""
    near = CAMERA.depth_of_field_mm[0]
    ends = np.array([[-2.0, 0.0, near + 0.1], [2.0, 0.0, near + 0.1]])
    for ratio, together in ((0.0, True), (0.95 * 4 / near, True), (1.1 * 4 / near, False)):
        for which in (0, 1):
            ratios = np.zeros(2)
            ratios[which] = ratio
            both = Segments(np.array([ends, ends]), np.full(2, 4.0), ratios)
            assert _in_view(np.zeros(3), 0.0, both, frustum()) == together
    # from somewhere in a large ball it may be longer
    both = Segments(np.array([ends, ends]), np.full(2, 4.0), np.full(2, 1.1 * 4 / near))
    assert _in_view(np.zeros(3), 20.0, both, frustum())


def test_what_is_wider_than_the_frustum_does_not_fit():
    """Its farthest two points are opposite corners of the farthest sharp plane, or one of them of the nearest."""
    view = frustum()
    corner = np.array([view.tan_x, view.tan_y, 1.0])
    opposite = corner * [-1, -1, 1]
    widest = max(
        np.linalg.norm(a * corner - b * opposite)
        for a in (view.near, view.far)
        for b in (view.near, view.far)
    )
    tangents = np.array([view.tan_x, view.tan_y])
    for between, fits in ((0.999 * widest, True), (1.001 * widest, False)):
        ends = np.array(
            [[[0.0, 0, 0], [1, 0, 0]], [[1, 0, 0], [between, 0, 0]], [[0.5, 0, 0], [0.6, 0, 0]]]
        )
        conflict = np.zeros((3, 3), dtype=bool)
        conflict[0, 1] = conflict[1, 0] = not fits
        assert too_far_apart(CAMERA, ends, tangents).tolist() == conflict.tolist()
    # an entity too long by itself excludes others, not itself
    assert not too_far_apart(CAMERA, np.array([[[0.0, 0, 0], [2 * widest, 0, 0]]]), tangents).any()
    # beyond the hyperfocal distance everything far is sharp
    endless = Camera(25.0, (0.00345, 0.00345), (2448, 2048), 8.0, 30_000.0)
    assert endless.depth_of_field_mm[1] == np.inf
    assert not too_far_apart(endless, 1e6 * np.arange(12.0).reshape(2, 2, 3), tangents).any()


def test_a_point_nearly_too_near_keeps_the_axis_close_to_it():
    """Its axis is at most acos(near / distance) off it, so a point behind it by more than the depth of field over the
    cosine of that is not sharp; whichever of the two is named first."""
    near, far = CAMERA.depth_of_field_mm
    distance = near + 0.2
    most = (far - near) * distance / near
    for between, together in ((0.995 * (far - near), True), (1.003 * most, False)):
        first = at(0, distance)
        second = at(0, distance + between)
        middle = at(0, distance + between / 2)
        assert possible(first, second, middle, middle) == together
        assert possible(second, first, middle, middle) == together


def box(low, high):
    return BoxCell(np.array(low, dtype=float), np.array(high, dtype=float))


def test_a_viewpoint_is_shared_where_one_cell_of_each_meets_in_focus():
    """Two edges of 1 mm side by side, sharp from about 120 mm before them; regions are boxes."""
    both = pair([[[0, 0, 0], [1, 0, 0]], [[0, 1, 0], [1, 1, 0]]])
    before = box([-10, -10, -125], [10, 10, -115])
    aside = box([500, -10, -125], [510, 10, -115])
    behind = box([-10, -10, -300], [10, 10, -200])
    around = box([-30, -30, -320], [30, 30, -90])
    for own, other, shared in (
        ([before], [around], True),
        # each alone decides, whichever is listed first
        ([before, aside], [around], True),
        ([aside, before], [around], True),
        ([around], [aside, behind, before], True),
        # they do not meet; they meet where nothing is sharp
        ([aside], [around], False),
        ([behind, aside], [around], False),
        ([before], [behind, aside], False),
    ):
        cells = Cells([own, other]).arrays
        assert _share_viewpoint(0, 1, cells, both, frustum()) == shared
        assert (
            _share_viewpoint(
                1,
                0,
                cells,
                Segments(*(values[::-1].copy() for values in both)),
                frustum(),
            )
            == shared
        )


BOTH = pair([[[0, 0, 0], [1, 0, 0]], [[0, 1, 0], [1, 1, 0]]])


def test_a_viewpoint_is_found_and_refuted_in_parts_of_what_cells_share():
    """The same edges. The middle of what is shared is out of focus, so that it must be halved; they are sharp in one
    place near an end or near the middle, or nowhere."""
    near, far = CAMERA.depth_of_field_mm
    view = frustum()
    # no eye farther away has the origin in focus
    reach = view.far * math.sqrt(1 + view.tan_x**2 + view.tan_y**2)
    sharp = (near + far) / 2
    for low, high, shared in (
        ([-10, -10, -sharp - 190], [10, 10, -sharp + 1], True),
        ([-10, -10, -sharp - 1], [10, 10, -10], True),
        # beside the middle, on either side; all of the other half is out of focus
        ([-0.3, -0.3, -sharp - 65], [0.3, 0.3, -sharp + 55], True),
        ([-0.3, -0.3, -sharp - 55], [0.3, 0.3, -sharp + 65], True),
        ([-60, -60, -300], [60, 60, -reach - 1], False),
        ([-60, -60, -near + 1], [60, 60, 60], True),
        # its farthest corner is nearer than the nearest sharp depth
        ([-45, -45, -0.8 * near], [45, 45, 0.0], False),
    ):
        cells = Cells([[box(low, high)], [box(np.subtract(low, 1), np.add(high, 1))]]).arrays
        assert _share_viewpoint(0, 1, cells, BOTH, view) == shared


@dataclass(frozen=True)
class Prism:
    """A triangle of the x-z plane between two planes square to y, as a cell."""

    half_spaces: np.ndarray
    vertices: np.ndarray


def prism(side, gap):
    """Half of the square of 20 mm about (0, -120), on one side of the diagonal and half a gap away from it."""
    slant = np.array([side, 0.0, side]) / math.sqrt(2)
    walls = [
        [1, 0, 0, -10],
        [-1, 0, 0, -10],
        [0, 1, 0, -10],
        [0, -1, 0, -10],
        [0, 0, 1, 110],
        [0, 0, -1, -130],
    ]
    edge = -side * gap / math.sqrt(2)
    corner = -10.0 * side
    triangle = [
        (corner, -corner + edge - 120),
        (-corner + edge, corner - 120),
        (corner, corner - 120),
    ]
    planes = np.array([*walls, [*slant, gap / 2 + side * 120 / math.sqrt(2)]])
    return Prism(planes, np.array([(x, y, z) for x, z in triangle for y in (-10.0, 10.0)]))


@pytest.mark.parametrize(("gap", "shared"), [(0.05, False), (0.0, True)])
def test_cells_on_two_sides_of_a_slanted_plane_share_nothing_unless_they_touch(gap, shared):
    """Their bounding boxes are nearly the same, and the gap is far narrower than the finest box."""
    cells = [prism(1, gap), prism(-1, gap)]
    for cell in cells:
        heights = cell.vertices @ cell.half_spaces[:, :3].T + cell.half_spaces[:, 3]
        assert heights.max() == pytest.approx(0.0, abs=1e-9)
    arrays = Cells([[cell] for cell in cells]).arrays
    assert _share_viewpoint(0, 1, arrays, BOTH, frustum()) == shared


def test_a_ball_about_a_point_itself_may_hold_an_eye_that_sees_it():
    """Where the middle is on a point, its line of sight has no direction, so nothing follows from it."""
    depth = sum(CAMERA.depth_of_field_mm) / 2
    first = np.array([-2.0, 0.0, depth])
    second = np.array([2.0, 0.0, depth])
    assert possible(first, second, first, second)
    for middle in (first, second):
        assert _in_view(
            middle, np.linalg.norm(middle), pair([first, second, first, second]), frustum()
        )


@pytest.mark.skipif(not hasattr(_share_viewpoint, "targetoptions"), reason="loops run uncompiled")
@pytest.mark.parametrize("loop", [_share_viewpoint, _grow, search])
def test_what_threads_call_lets_the_others_run(loop):
    assert loop.targetoptions["nogil"]


# What the tree of poses says of a node holds for every pose in it, up to the last digits.


def test_the_least_depth_of_a_node_is_not_overstated():
    aside = 2e-6
    ahead = 400.0
    spread = 0.5
    ray = np.array([aside, 0.0, ahead])
    axis = np.array([[0.0, 0.0, 1.0]])
    node = Nodes(
        np.zeros((1, 3)), np.zeros(1), axis, np.array([spread]), np.eye(3)[None], np.zeros(1)
    )
    found = _nearest_depth(
        ray, node, 0, Frustum(10.0, 1e4, 2.0, 2.0, math.atan(math.hypot(2.0, 2.0)))
    )
    assert found <= math.hypot(aside, ahead) * math.cos(math.atan2(aside, ahead) + spread) + 1e-9


def test_the_angle_to_a_corner_of_a_small_patch_is_exact_to_the_last_digits():
    width = 1e-6
    patch = np.array([[-width, width, -width, width]])
    _, spread, _ = _patch_frames(np.array([4]), patch, np.zeros(1))
    assert abs(spread[0] - math.atan(math.hypot(width, width))) < 1e-15


def test_no_pose_of_a_node_sees_a_point_nearer_than_its_least_depth_nor_one_that_it_cannot_see():
    """Poses drawn in balls of positions, cones of directions and ranges of rolls, and the point projected."""
    view = Frustum(300.0, 500.0, 0.5, 0.4, math.atan(math.hypot(0.5, 0.4)))
    rng = np.random.default_rng(3)
    n_seen = n_never = 0
    for _ in range(600):
        radius = rng.choice([0.0, 5.0, 50.0])
        spread = rng.choice([0.01, 0.1, 0.5])
        roll = rng.choice([0.0, 0.1, 0.5])
        frame = Rotation.random(random_state=rng).as_matrix()
        share = rng.uniform(-1.4, 1.4, 2)
        depth = rng.uniform(200.0, 600.0)
        ray = frame @ [share[0] * 0.5 * depth, share[1] * 0.4 * depth, depth]
        turned = roll * math.sin(view.cone)
        node = Nodes(
            np.zeros((1, 3)), *(np.array([x]) for x in (radius, frame[:, 2], spread, frame, turned))
        )
        least = _nearest_depth(ray, node, 0, view)
        n_never += least < 0.0
        for _ in range(10):
            way = rng.uniform(0.0, 2.0 * math.pi)
            tilt = spread * rng.random() * np.array([math.cos(way), math.sin(way), 0.0])
            turn = Rotation.from_rotvec(tilt) * Rotation.from_rotvec(
                [0.0, 0.0, rng.uniform(-roll, roll)]
            )
            aside = rng.normal(size=3)
            eye = radius * rng.random() * aside / np.linalg.norm(aside)
            x, y, z = (frame @ turn.as_matrix()).T @ (ray - eye)
            if view.near <= z <= view.far and abs(x) <= view.tan_x * z and abs(y) <= view.tan_y * z:
                n_seen += 1
                assert 0.0 <= least <= z
    assert n_seen > 500
    assert n_never > 100
