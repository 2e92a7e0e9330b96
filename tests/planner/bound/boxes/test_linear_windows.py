"""Linear windows of boxes of small turns: no pose breaks a side of what it inspects, and whether they meet is right."""

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
from planner.bound.view import View
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
    find_apart,
    linear_sides,
    may_meet,
    most_turn,
    rotation,
    swings,
)
from planner.camera.pose import world_to_cam


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
