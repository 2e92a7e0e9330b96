"""What windows say of a box of poses, against poses drawn in it by rotations of another library; in a box of one pose
they are the sides of the view."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from planner.bound.view import BOTTOM, FAR, LEFT, NEAR, RIGHT, TOP, View
from planner.bound.windows import (
    Turn,
    extent,
    farthest,
    is_empty,
    most_turn,
    rotation,
    seen_from,
    window,
)

pytestmark = pytest.mark.uncompiled

VIEW = View(90.0, 110.0, 100.0, 0.3, 0.2, math.hypot(10.0, 110 * math.hypot(0.3, 0.2)))
ANYWHERE = np.full(3, 1e6)


def matrix_of(chart, v):
    """Camera to part, of a chart and a vector."""
    flip = Rotation.from_rotvec([np.pi * chart, 0, 0])
    return (flip * Rotation.from_quat([*v, 1.0])).as_matrix()


def box_of(chart, v, u):
    """The middle rotation, and the turns, of a box."""
    matrix = np.empty((3, 3))
    n = rotation(chart, v, matrix)
    return matrix, Turn(v, u, n, *most_turn(v, u, n))


def windows_of(ends, q, matrix, turn, far=(VIEW.far, VIEW.far)):
    s = np.empty((2, 3))
    least = np.empty(6)
    scores = np.zeros(6)
    seen_from(ends, q, matrix, s)
    window(s, np.array(far), turn, VIEW, ANYWHERE, least, 1.0, scores)
    return least, s


def forms_of(w):
    """-n.w for the six sides, in their order."""
    x, y, z = w
    values = np.empty(6)
    values[[RIGHT, LEFT]] = x - VIEW.tan_x * z, -x - VIEW.tan_x * z
    values[[BOTTOM, TOP]] = y - VIEW.tan_y * z, -y - VIEW.tan_y * z
    values[[NEAR, FAR]] = -z, z
    return values


def ends_in_view(rng, camera, looked_at):
    """Ends of an edge that a pose sees, their depths, and the length of its image for a unit of depth."""
    depth = rng.uniform(90, 110, 2)
    seen = np.column_stack(
        [rng.uniform(-0.3, 0.3, 2) * depth, rng.uniform(-0.2, 0.2, 2) * depth, depth]
    )
    image = np.linalg.norm(seen[0, :2] / depth[0] - seen[1, :2] / depth[1])
    return (seen - [0, 0, VIEW.middle]) @ camera.T + looked_at, depth, image


def draws(seed, n, small):
    """Boxes of poses and poses of them: chart, v0, u, q0, h, and those of the pose."""
    rng = np.random.default_rng(seed)
    for k in range(n):
        v = rng.uniform(-0.7, 0.7, 3)
        u = rng.uniform(0.2, 1.0, 3) * small
        h = rng.uniform(0.0, 20.0, 3)
        at, of = rng.uniform(-1, 1, (2, 3))
        if k % 3 == 0:
            at = np.sign(at)
            of = np.sign(of)
        q = rng.uniform(-30, 30, 3)
        yield rng, k % 2, v, u, q, h, q + at * h, v + of * u


@pytest.mark.parametrize("chart", [0, 1])
def test_a_rotation_is_that_of_its_quaternion(chart):
    for v in np.random.default_rng(0).uniform(-1, 1, (20, 3)):
        matrix = np.empty((3, 3))
        assert rotation(chart, v, matrix) == pytest.approx(1 + v @ v)
        assert matrix == pytest.approx(matrix_of(chart, v))


@pytest.mark.parametrize("small", [0.3, 0.05, 0.002])
def test_a_turn_of_a_box_is_no_larger_than_told_and_may_nearly_be_so(small):
    largest = 0.0
    for _, chart, v, u, _, _, _, turned in draws(1, 200, small):
        matrix, turn = box_of(chart, v, u)
        relative = Rotation.from_matrix(matrix.T @ matrix_of(chart, turned))
        tangent = math.tan(relative.magnitude() / 2)
        assert tangent <= turn.t + 1e-12
        assert abs(v @ (turned - v)) / turn.n <= turn.nu + 1e-12
        largest = max(largest, tangent / turn.t)
    assert largest > {0.3: 0.6, 0.05: 0.9, 0.002: 0.95}[small]


def test_a_turn_of_a_box_of_nearly_all_rotations_is_not_bounded():
    v = np.full(3, 0.9)
    u = np.full(3, 1.3)
    assert most_turn(v, u, 1 + v @ v)[0] == 1e3
    # nu is 0.97 here: 3 * 0.9 * 1.232 / 3.43
    t, nu = most_turn(v, np.full(3, 1.232), 1 + v @ v)
    assert nu == pytest.approx(0.97, abs=1e-3)
    assert t == pytest.approx(1.232 * math.sqrt(3 / 3.43) / (1 - nu))


@pytest.mark.parametrize("small", [0.3, 0.02])
def test_what_is_looked_at_is_within_the_room_told(small):
    closest = np.zeros(3)
    for _, chart, v, u, q, h, looked_at, turned in draws(2, 200, small):
        matrix, turn = box_of(chart, v, u)
        room = np.empty(3)
        extent(matrix, h, turn.t, room)
        w = np.abs(matrix_of(chart, turned).T @ (looked_at - q))
        assert (w <= room + 1e-9).all()
        closest = np.maximum(closest, w / room)
    # the corners of a box come near
    assert (closest > {0.3: 0.4, 0.02: 0.9}[small]).all()


@pytest.mark.parametrize("small", [0.3, 0.05, 0.005])
def test_a_pose_that_has_both_ends_in_view_is_within_the_window(small):
    inside = outside = refused = 0
    for rng, chart, v, u, q, _, looked_at, turned in draws(3, 400, small):
        matrix, turn = box_of(chart, v, u)
        camera = matrix_of(chart, turned)
        # from the pose, at the sides of the view or beyond
        depth = rng.uniform(88, 112, 2)
        seen = np.column_stack(
            [rng.uniform(-0.33, 0.33, 2) * depth, rng.uniform(-0.22, 0.22, 2) * depth, depth]
        )
        ends = (seen - [0, 0, VIEW.middle]) @ camera.T + looked_at
        shown = (np.abs(seen[:, :2]) <= np.outer(depth, [VIEW.tan_x, VIEW.tan_y])).all()
        shown &= ((depth >= VIEW.near) & (depth <= VIEW.far)).all()
        least, _ = windows_of(ends, q, matrix, turn)
        kept = (forms_of(camera.T @ (looked_at - q)) >= least).all()
        assert kept or not shown
        inside = inside + shown
        outside = outside + (not shown)
        refused = refused + (not kept)
    assert inside > 100
    assert refused > {0.3: 0.0, 0.05: 0.4, 0.005: 0.9}[small] * outside


@pytest.mark.parametrize("small", [0.6, 0.2])
def test_what_is_on_a_side_of_the_view_from_a_corner_of_a_box_is_within_the_window(small):
    """Anywhere on the plane of that side, also far out of view: each side by itself must hold."""
    for rng, chart, v, u, q, _, looked_at, _ in draws(7, 300, small):
        matrix, turn = box_of(chart, v, u)
        camera = matrix_of(chart, v + rng.choice([-1.0, 1.0], 3) * u)
        w = forms_of(camera.T @ (looked_at - q))
        for side in range(6):
            at = rng.uniform(-150, 150, 3)
            if side in (NEAR, FAR):
                at[2] = (VIEW.near if side == NEAR else VIEW.far) - VIEW.middle
            else:
                k, tangent = (0, VIEW.tan_x) if side in (RIGHT, LEFT) else (1, VIEW.tan_y)
                at[k] = (1 if side in (RIGHT, BOTTOM) else -1) * tangent * (at[2] + VIEW.middle)
            end = camera @ at + looked_at
            least, _ = windows_of(np.array([end, end]), q, matrix, turn)
            assert w[side] >= least[side] - 1e-7


def test_the_window_of_one_pose_is_the_view_and_a_nearer_limit_of_depth_counts():
    """Of a box of one rotation; both ends on the axis of the middle pose, at middle depth."""
    matrix, turn = box_of(1, np.array([0.1, -0.2, 0.3]), np.full(3, 1e-12))
    q = np.array([1.0, 2.0, 3.0])
    least, _ = windows_of(np.array([q, q]), q, matrix, turn)
    half = [VIEW.tan_x * 100.0] * 2 + [VIEW.tan_y * 100.0] * 2 + [10.0, 10.0]
    assert least == pytest.approx(-np.array(half), abs=1e-6)
    for far in ((103.0, 110.0), (110.0, 103.0)):
        nearer, _ = windows_of(np.array([q, q]), q, matrix, turn, far)
        assert nearer[FAR] == pytest.approx(-3.0, abs=1e-6)
        assert nearer[:FAR] == pytest.approx(least[:FAR])


def test_a_window_outside_the_room_is_empty():
    matrix, turn = box_of(0, np.array([0.1, -0.2, 0.3]), np.full(3, 1e-12))
    for side, width in enumerate((30.0, 20.0, 10.0)):
        for sign in (-1.0, 1.0):
            for beyond in (-0.1, 0.1):
                # an end so far to one side that the point looked at must follow it, out of a room of 5 mm
                away = np.zeros(3)
                away[side] = sign * (width + 5.0 + beyond)
                if side < 2:
                    # the nearest end of the room is where the view is widest
                    away[side] += sign * (VIEW.tan_x, VIEW.tan_y)[side] * 5.0
                least, _ = windows_of(np.array([away, away]) @ matrix.T, np.zeros(3), matrix, turn)
                assert is_empty(least, np.full(3, 5.0), VIEW) == (beyond > 0)


@pytest.mark.parametrize("small", [0.3, 0.02])
def test_an_image_long_enough_has_no_end_deeper_than_told(small):
    nearest = np.inf
    limited = 0
    for rng, chart, v, u, q, h, looked_at, turned in draws(4, 600, small):
        matrix, turn = box_of(chart, v, u)
        camera = matrix_of(chart, turned)
        room = np.empty(3)
        extent(matrix, h, turn.t, room)
        ends, depth, image = ends_in_view(rng, camera, looked_at)
        s = np.empty((2, 3))
        far = np.empty(2)
        opened = np.empty(2)
        seen_from(ends, q, matrix, s)
        # the image is just long enough
        farthest(s, np.linalg.norm(ends[1] - ends[0]), image, turn.t, room, VIEW, far, opened)
        assert (depth <= far + 1e-6).all()
        assert (opened >= 0).all()
        limited += (far < VIEW.far).any()
        nearest = min(nearest, (far - depth).min())
        farthest(s, np.linalg.norm(ends[1] - ends[0]), 0.0, turn.t, room, VIEW, far, opened)
        assert (far == VIEW.far).all()
        assert (opened == 0).all()
    assert limited > {0.3: 0, 0.02: 20}[small]
    assert nearest < 5.0


def test_of_one_pose_nothing_is_open_of_how_deep_an_end_may_be():
    """Neither the point looked at nor the turn is unknown, so the depths are those that the lengths of images allow."""
    for rng, chart, v, _, q, _, _, _ in draws(5, 100, 0.1):
        matrix, turn = box_of(chart, v, np.full(3, 1e-13))
        ends, depth, image = ends_in_view(rng, matrix, q)
        s = np.empty((2, 3))
        far = np.empty(2)
        opened = np.empty(2)
        seen_from(ends, q, matrix, s)
        farthest(
            s, np.linalg.norm(ends[1] - ends[0]), image, turn.t, np.zeros(3), VIEW, far, opened
        )
        assert far == pytest.approx(depth, abs=1e-5)
        assert opened == pytest.approx(np.zeros(2), abs=1e-6)


@pytest.mark.parametrize("one", [0, 1, 2])
def test_only_a_coordinate_of_the_turn_that_is_not_known_scores(one):
    """The ends are beside the axis, so that any turn moves them; the room is large, so that all sides cut it."""
    for _, chart, v, _, q, _, _, _ in draws(6, 10, 0.1):
        matrix, turn = box_of(chart, v, 0.05 * np.eye(3)[one])
        s = np.empty((2, 3))
        least = np.empty(6)
        scores = np.zeros(6)
        seen_from(q + np.array([[9.0, 5.0, 4.0], [-8.0, 7.0, -3.0]]), q, matrix, s)
        window(s, np.full(2, VIEW.far), turn, VIEW, ANYWHERE, least, 1.0, scores)
        assert scores[3 + one] > 0.0
        assert np.delete(scores[3:], one) == pytest.approx(np.zeros(2))
        # a smaller box of points looked at would help, too, in no direction more than in another
        assert scores[0] == scores[1] == scores[2] > 0.0
        # but not while the camera may turn by much
        matrix, turn = box_of(chart, v, 0.9 * np.ones(3))
        scores[:] = 0.0
        window(s, np.full(2, VIEW.far), turn, VIEW, ANYWHERE, least, 1.0, scores)
        assert not scores[:3].any()
        assert scores[3:].all()
