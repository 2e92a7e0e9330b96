"""What windows say of a box of poses, against poses drawn in it by rotations of another library; in a box of one pose
they are the sides of the view.
"""

from __future__ import annotations

import itertools
import math
from fractions import Fraction

import numpy as np
import pytest
from box_requests import SIZES, box_around, found_in, request_for, space_for
from grid_box import EDGES
from scipy.optimize import linprog
from scipy.spatial.transform import Rotation

from planner.bound.boxes import PROVEN, agree, new_work, planted
from planner.bound.view import BOTTOM, FAR, LEFT, NEAR, RIGHT, TOP, View
from planner.bound.windows import (
    NO,
    UNDECIDED,
    YES,
    Members,
    Seat,
    Sides,
    Turn,
    _of_length,
    extent,
    farthest,
    find_apart,
    is_empty,
    linear_sides,
    may_meet,
    most_turn,
    rotation,
    seen_from,
    swings,
    window,
)
from planner.camera.pose import world_to_cam

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


@pytest.mark.uncompiled
@pytest.mark.parametrize("chart", [0, 1])
def test_a_rotation_is_that_of_its_quaternion(chart):
    for v in np.random.default_rng(0).uniform(-1, 1, (20, 3)):
        matrix = np.empty((3, 3))
        assert rotation(chart, v, matrix) == pytest.approx(1 + v @ v)
        assert matrix == pytest.approx(matrix_of(chart, v))


@pytest.mark.uncompiled
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


@pytest.mark.uncompiled
def test_a_turn_of_a_box_of_nearly_all_rotations_is_not_bounded():
    v = np.full(3, 0.9)
    u = np.full(3, 1.3)
    assert most_turn(v, u, 1 + v @ v)[0] == 1e3
    # nu is 0.97 here: 3 * 0.9 * 1.232 / 3.43
    t, nu = most_turn(v, np.full(3, 1.232), 1 + v @ v)
    assert nu == pytest.approx(0.97, abs=1e-3)
    assert t == pytest.approx(1.232 * math.sqrt(3 / 3.43) / (1 - nu))


@pytest.mark.uncompiled
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


@pytest.mark.uncompiled
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


@pytest.mark.uncompiled
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


@pytest.mark.uncompiled
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


@pytest.mark.uncompiled
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


@pytest.mark.uncompiled
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


@pytest.mark.uncompiled
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


@pytest.mark.uncompiled
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


# Linear windows of boxes of small turns: no pose breaks a side of what it inspects, and whether
# they meet is right.


def sides_of(space, chart, box):
    """The sides of a box of poses, and where its coordinates are counted from."""
    stack = planted(box, np.arange(len(EDGES)), space.entities, np.array([[-1e4] * 3, [1e4] * 3]))
    work = new_work(len(EDGES))
    view = space.view
    n = rotation(chart, box[2], work.matrix)
    t, nu = most_turn(box[2], box[3], n)
    rest = swings(work.matrix, box[2], box[3], n, t, nu, view.middle, work.swing)
    assert agree(stack, 0, work, rest, view.middle)
    extent(work.matrix, stack.half[0], t, work.room)
    k = linear_sides(stack, 0, space.entities, view, work, rest)
    find_apart(work, k, box[3], work.apart)
    return (work.rows[:k], work.rhs[:k], work.owner[:k]), stack.look[0], work.matrix, work.apart


def coordinates(poses, chart, look, turn, middle):
    """w and d (p, 6) of poses, by rotations of another library."""
    flip = Rotation.from_rotvec([np.pi * chart, 0, 0])
    quaternion = (flip * Rotation.from_matrix(poses[:, :3, :3])).as_quat()
    d = quaternion[:, :3] / quaternion[:, 3:] - turn
    looked_at = poses[:, :3, 3] + middle * poses[:, :3, 2]
    return np.hstack([np.einsum("pji,pj->pi", poses[:, :3, :3], looked_at - look), d])


@pytest.mark.uncompiled
@pytest.mark.parametrize("ratio", [None, 0.12])
@pytest.mark.parametrize("small", [0.4, 0.1, 0.01])
def test_no_pose_breaks_a_side_of_what_it_inspects(small, ratio):
    judge, regions = request_for(SIZES[1])
    space = space_for(judge, regions)
    if ratio:
        space.entities = space.entities._replace(length_ratio=np.full(len(EDGES), ratio))
    view = space.view
    least = space.entities.length_ratio
    rng = np.random.default_rng(11)
    n_inspected = n_broken = n_out = 0
    for _ in range(30):
        (chart, box), poses = box_around(rng, view, SIZES[1], small)
        sides, look, _, _ = sides_of(space, chart, box)
        x = coordinates(poses, chart, look, box[2], view.middle)
        holds = x @ sides[0].T <= sides[1] + 1e-6
        assert holds[:, sides[2] < 0].all()
        at = world_to_cam(space.entities.ends, poses)
        image = at[..., :2] / at[..., 2:]
        depth = at[..., 2]
        seen = (np.abs(image) <= [view.tan_x, view.tan_y]).all(axis=(2, 3))
        seen &= ((depth >= view.near) & (depth <= view.far)).all(axis=2)
        seen &= np.linalg.norm(image[:, :, 1] - image[:, :, 0], axis=2) >= least
        kept = np.stack([holds[:, sides[2] == e].all(axis=1) for e in range(len(EDGES))], axis=1)
        assert kept[seen].all()
        n_inspected += seen.sum()
        n_out += (~seen).sum()
        n_broken += (~kept & ~seen).sum()
    assert n_inspected > 250
    # and little else keeps to them: the more so, the smaller the box
    assert n_broken > {0.4: 0.85, 0.1: 0.95, 0.01: 0.97}[small] * n_out


@pytest.mark.uncompiled
@pytest.mark.parametrize("small", [0.1, 0.01])
def test_members_that_exclude_each_other_in_a_box_are_inspected_together_by_no_pose_of_it(small):
    judge, regions = request_for(SIZES[0])
    space = space_for(judge, regions)
    rng = np.random.default_rng(5)
    view = space.view
    n_apart = n_together = 0
    for _ in range(100):
        (chart, box), poses = box_around(rng, view, SIZES[0], small)
        apart = sides_of(space, chart, box)[3]
        image = world_to_cam(space.entities.ends, poses)
        depth = image[..., 2]
        seen = (np.abs(image[..., :2]) <= depth[..., None] * [view.tan_x, view.tan_y]).all(
            axis=(2, 3)
        )
        seen &= ((depth >= view.near) & (depth <= view.far)).all(axis=2)
        together = seen.T.astype(int) @ seen.astype(int) > 0
        assert (apart == apart.T).all()
        assert not (apart & together).any()
        n_apart += apart.sum()
        n_together += together.sum() - np.trace(together)
    assert n_apart > 50
    assert n_together > 50


def test_no_thin_view_exceeds_what_the_search_proves_of_its_box():
    judge, regions = request_for(SIZES[1])
    space = space_for(judge, regions)
    rng = np.random.default_rng(4)
    view = space.view = space.view._replace(
        near=space.view.middle - 20.0, far=space.view.middle + 20.0
    )
    y = rng.uniform(0.1, 1.0, len(EDGES))
    proven = tight = 0
    for _ in range(100):
        part, poses = box_around(rng, view, SIZES[1], 0.2)
        inspects = judge(poses).inspects
        depth = world_to_cam(space.entities.ends, poses)[..., 2]
        inspects &= ((depth >= view.near) & (depth <= view.far)).all(axis=2)
        best = float((inspects @ y).max())
        proven += found_in(space, part, y, 1.02 * best + 1e-3, 3000)[0] == PROVEN
        if best > 0:
            tight += 1
            assert found_in(space, part, y, 0.999 * best, 3000)[0] != PROVEN
    assert proven > 15
    assert tight >= 2


@pytest.mark.parametrize(
    ("grouped", "n_problems", "m"),
    [(False, 40, 6), (True, 40, 6), pytest.param(True, 24, 4, marks=pytest.mark.uncompiled)],
)
def test_the_answer_is_that_of_linear_programs(grouped, n_problems, m):
    """Random sides: every subset that is heavy enough is asked by linear programming."""
    rng = np.random.default_rng(2)
    answers = []
    for _ in range(n_problems):
        owner = np.repeat(np.arange(-1, m), 3)
        rows = rng.normal(size=(len(owner), 6))
        point = rng.uniform(-0.5, 0.5, 6)
        # of six coordinates that all count, too many parts would be asked
        rows *= rng.random((len(owner), 6)) < 0.4
        rhs = rows @ point + rng.uniform(-0.6, 0.5, len(owner))
        rhs[owner < 0] = (rows @ point)[owner < 0] + 0.3
        y = np.sort(rng.uniform(0.2, 1.0, m))[::-1].copy()
        group = np.array([0, 1, 2, 0, 3, 1])[:m] if grouped else np.arange(m)
        limit = rng.uniform(0.3, 0.9) * y.sum()
        possible = False
        for chosen in itertools.product([False, True], repeat=m):
            held = np.array(chosen)
            weight = sum(y[held & (group == g)].max(initial=0.0) for g in range(m))
            if weight > limit and not possible:
                own = np.concatenate([[True], held])[owner + 1]
                possible = linprog(np.zeros(6), rows[own], rhs[own], bounds=(-1, 1)).status == 0
        box = (np.full(6, -1.0), np.full(6, 1.0))
        seat = Seat(np.zeros(3), np.zeros((3, 3)))
        x = np.empty(6)
        meets = np.empty(m, dtype=bool)
        most = 50_000 if m == 6 else 400
        answer, made = may_meet(
            Sides(rows, rhs, owner), Members(group, y), limit, box, seat, most, x, meets
        )
        answers.append(answer)
        assert 1 <= made <= most + 1
        assert answer != (NO if possible else YES)
        if answer == YES:
            assert sum(y[meets & (group == g)].max(initial=0.0) for g in range(m)) > limit
            assert (np.abs(x) <= 1.0).all()
            assert (rows @ x <= rhs + 1e-12)[np.concatenate([[True], meets])[owner + 1]].all()
    assert min(answers.count(NO), answers.count(YES)) > n_problems / 8
    assert answers.count(UNDECIDED) < n_problems / 5


def test_edges_nearly_in_a_plane_across_the_axis_are_not_said_to_have_shorter_images():
    """There |X| and X.a are nearly equal; the area they leave is compared with that of exact fractions."""
    view = View(near=300.0, far=300.001, middle=300.0005, tan_x=0.5, tan_y=0.4, radius=1.0)
    rng = np.random.default_rng(0)
    ratio = 1e-5
    still = Turn(np.zeros(3), np.zeros(3), 1.0, 0.0, 0.0)
    rows = np.zeros((1, 6))
    rhs = np.zeros(1)
    n_kept = 0
    for _ in range(500):
        ends = rng.uniform(-300.0, 300.0, (2, 3))
        eye = rng.uniform(-300.0, 300.0, 3)
        ends[1, 2], eye[2] = ends[0, 2] + 1e-6 * rng.normal(size=2)
        kept = _of_length(
            (ends, ratio, np.zeros((2, 3))), np.array([eye, eye]), still, view, np.eye(3), rows, rhs
        )
        if kept:
            n_kept += 1
            first, second, nodal = ([Fraction(float(x)) for x in point] for point in (*ends, eye))
            e, o = ([b - a for a, b in zip(first, point, strict=True)] for point in (second, nodal))
            area = math.hypot(float(o[1] * e[2] - o[2] * e[1]), float(o[2] * e[0] - o[0] * e[2]))
            both = math.sqrt(4.0 * area / ratio + (view.far - view.near) ** 2)
            assert rhs[0] >= both / 2.0 - view.middle
    assert n_kept > 400
