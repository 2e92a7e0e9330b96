"""What may be inspected from where: no box of viewpoints may lack what a pose in it inspects, all around or not."""

from __future__ import annotations

import numpy as np
import pytest
from box_requests import (
    CAMERA,
    SIZES,
    TREES,
    UNCERTAINTY,
    WORKSPACE,
    assert_tree_has,
    box_around,
    found_in,
    pose_of,
    random_poses,
    request_for,
    sets_of,
    space_for,
)
from grid_box import EDGES, BoxCell, BoxSpace

from planner.bound.boxes import (
    FOUND,
    NEARLY,
    PROVEN,
    SPENT,
    UNRESOLVED,
    Asked,
    PosesBox,
    Viewpoints,
    _grow,
    heavy_members,
    viewpoints_for,
)
from planner.bound.pose_space import PoseSpace
from planner.bound.view import Cells
from planner.bound.windows import most_turn, rotation, swings
from planner.camera.pose import world_to_cam
from planner.request.constraints import Requirements
from planner.request.problem import Problem
from planner.search.columns import Judge


def around(size, radius):
    """A request with visibility asked all around, and its space of poses."""
    need = Requirements(visibility_radius_mm=radius)
    judge = Judge(
        Problem(BoxSpace(size, WORKSPACE, EDGES), EDGES, CAMERA, UNCERTAINTY, 0.98, 0.9, need)
    )
    return judge, space_for(judge, Cells([judge.space.covering_cells([name]) for name in EDGES]))


@pytest.mark.parametrize("radius", [0.0, 4.0])
@pytest.mark.parametrize("size", SIZES)
def test_what_a_pose_inspects_is_in_every_box_of_viewpoints_around_it(size, radius):
    judge, space = around(size, radius)
    y = np.random.default_rng(4).uniform(0.1, 1.0, len(EDGES))
    tree = viewpoints_for(space.nodal_points, space.entities, space.view, y, 0.5)
    poses = random_poses(judge, 4000, seed=6)
    inspects = judge(poses).inspects
    sets = sets_of(tree)
    assert_tree_has(tree, poses, inspects, 100)
    # and much is told apart
    leaves = sets[tree.second == 0]
    assert (leaves @ y <= 0.5).mean() > 0.02
    assert len({row.tobytes() for row in leaves}) > 20


def test_visible_all_around_decides_where_regions_only_touch():
    """Two edges, one visible above a plane and one below it: on the plane both are, all around nowhere both."""
    pair = EDGES[:2]
    judge, _ = request_for(SIZES[0])
    low, high = (np.asarray(corner, dtype=float) for corner in WORKSPACE)
    middle = (low[2] + high[2]) / 2
    regions = Cells(
        [
            [BoxCell(np.array([*low[:2], middle]), high)],
            [BoxCell(low, np.array([*high[:2], middle]))],
        ]
    )
    for radius, together in ((0.0, True), (2.0, False)):
        need = Requirements(visibility_radius_mm=radius)
        strict = Judge(Problem(judge.space, EDGES, CAMERA, UNCERTAINTY, 0.98, 0.9, need))
        space = PoseSpace(
            strict.problem, np.arange(len(pair)), regions, np.zeros((2, 2), dtype=bool)
        )
        tree = viewpoints_for(
            space.nodal_points, space.entities, space.view, np.ones(2), 1.5, finest=4.0
        )
        leaves = tree.sets[tree.second == 0, 0]
        assert (leaves == 3).any() == together
        assert {1, 2} <= set(leaves.tolist())


@pytest.mark.parametrize("radius", [0.0, 4.0])
def test_no_pose_visible_all_around_exceeds_what_is_proven(radius):
    size = SIZES[0]
    judge, space = around(size, radius)
    rng = np.random.default_rng(8)
    y = rng.uniform(0.1, 1.0, len(EDGES))
    tight = 0
    for _ in range(60):
        part, poses = box_around(rng, space.view, size, 0.1)
        best = float((judge(poses).inspects @ y).max())
        if best > 0:
            tight += 1
            assert found_in(space, part, y, 0.999 * best, 3000)[0] != PROVEN
    assert tight > 5


def test_where_members_may_be_inspected_together_shrinks_to_what_weighs_enough():
    """Of the nodal points of a box of poses, none at which enough is inspected is lost, nor what is inspected there."""
    judge, space = around(SIZES[1], 1.0)
    rng = np.random.default_rng(9)
    y = rng.uniform(0.1, 1.0, len(EDGES))
    tree = viewpoints_for(space.nodal_points, space.entities, space.view, y, 0.5)
    members = np.arange(len(EDGES))
    lost = 0
    kept = 0
    shrunk = 0
    for _ in range(150):
        (chart, box), poses = box_around(rng, space.view, SIZES[1], 0.3)
        matrix = np.empty((3, 3))
        swing = np.empty((3, 3))
        n = rotation(chart, box[2], matrix)
        t, nu = most_turn(box[2], box[3], n)
        rest = swings(matrix, box[2], box[3], n, t, nu, space.view.middle, swing)
        nodal = box[0] - space.view.middle * matrix[:, 2]
        reach = box[1] + np.abs(swing).sum(axis=0) + rest
        eye = np.array([nodal - reach, nodal + reach])
        live = np.zeros(tree.sets.shape[1], np.uint64)
        before = np.prod(eye[1] - eye[0])
        limit = rng.uniform(0.3, 3.0)
        asked = Asked(members, y, members, limit)
        around_it = PosesBox(nodal, matrix, box[1], swing, rest)
        share = heavy_members(tree, around_it, eye, asked, live)
        inspects = judge(poses).inspects
        heavy = inspects @ y > limit
        at = poses[heavy, :3, 3]
        assert ((at >= eye[0] - 1e-9) & (at <= eye[1] + 1e-9)).all()
        seen = np.unpackbits(live.view(np.uint8), bitorder="little")[: len(EDGES)].astype(bool)
        assert seen[inspects[heavy].any(axis=0)].all()
        assert 0.0 <= share <= 1.0 + 1e-9
        lost += not live.any()
        kept += heavy.any()
        shrunk += np.prod(eye[1] - eye[0]) < 0.5 * before
    assert min(lost, kept, shrunk) > 3


# The search of boxes of poses and its tree of viewpoints, on so few boxes that no compiler is
# needed.


def coarse_tree(space, y, limit, halvings=2):
    """A tree of viewpoints whose boxes are halved that often in each direction, at most."""
    finest = (space.nodal_points[1] - space.nodal_points[0]).max() / 2.0**halvings
    return Viewpoints(
        *_grow(
            space.nodal_points,
            space.entities,
            space.view,
            y,
            limit,
            finest,
        ),
        finest,
    )


def all_around(size, radius):
    """A request with visibility asked all around, and its space of poses."""
    need = Requirements(visibility_radius_mm=radius)
    judge = Judge(
        Problem(BoxSpace(size, WORKSPACE, EDGES), EDGES, CAMERA, UNCERTAINTY, 0.98, 0.9, need)
    )
    return judge, space_for(judge, Cells([judge.space.covering_cells([name]) for name in EDGES]))


def in_view(view, ends, poses):
    """Which segments (p, e) lie in the frustum of a view, both ends."""
    at = world_to_cam(ends, poses)
    depth = at[..., 2]
    seen = ((depth >= view.near) & (depth <= view.far)).all(axis=2)
    return seen & (np.abs(at[..., :2]) <= depth[..., None] * [view.tan_x, view.tan_y]).all(
        axis=(2, 3)
    )


@pytest.mark.uncompiled
@pytest.mark.parametrize("radius", [0.0, 4.0])
def test_a_coarse_tree_has_what_poses_inspect(radius):
    judge, space = all_around(SIZES[1], radius)
    y = np.random.default_rng(4).uniform(0.1, 1.0, len(EDGES))
    tree = coarse_tree(space, y, 0.5)
    sets = sets_of(tree)
    poses = random_poses(judge, 300, seed=6)
    inspects = judge(poses).inspects
    assert_tree_has(tree, poses, inspects, 10)
    # a half has no more in it than the whole
    for node in np.flatnonzero(tree.second):
        assert (sets[[node + 1, tree.second[node]]] <= sets[node]).all()


@pytest.mark.uncompiled
@pytest.mark.parametrize(("radius", "size", "small"), [(0.0, SIZES[1], 0.3), (4.0, SIZES[0], 0.05)])
def test_of_few_boxes_too_no_pose_exceeds_what_is_proven(radius, size, small):
    judge, space = all_around(size, radius)
    rng = np.random.default_rng(8)
    y = rng.uniform(0.1, 1.0, len(EDGES))
    TREES[space] = coarse_tree(space, y, 0.5)
    outcomes = []
    tight = 0
    for _ in range(8):
        part, poses = box_around(rng, space.view, size, small)
        best = float((judge(poses).inspects @ y).max())
        outcomes.append(found_in(space, part, y, 1.02 * best + 1e-3, 30)[0])
        if best > 0:
            tight += 1
            outcome, made, _, _ = found_in(space, part, y, 0.999 * best, 30)
            assert outcome != PROVEN
            assert made <= 30
            outcomes.append(outcome)
    assert {PROVEN, FOUND} <= set(outcomes)
    assert tight > 2


def thin(space):
    """Let the space have a depth of field of 40 mm: boxes are soon small enough for windows linear in the turn."""
    space.view = space.view._replace(near=space.view.middle - 20.0, far=space.view.middle + 20.0)
    return space.view


@pytest.mark.uncompiled
def test_nor_does_a_pose_of_a_thin_view():
    judge, regions = request_for(SIZES[0])
    space = space_for(judge, regions)
    rng = np.random.default_rng(4)
    view = thin(space)
    y = rng.uniform(0.1, 1.0, len(EDGES))
    TREES[space] = coarse_tree(space, y, 0.5)
    outcomes = []
    tight = 0
    for _ in range(16):
        part, poses = box_around(rng, view, SIZES[0], 0.2)
        inspects = judge(poses).inspects & in_view(view, space.entities.ends, poses)
        best = float((inspects @ y).max())
        outcomes.append(found_in(space, part, y, 1.02 * best + 1e-3, 8)[0])
        if best > 0:
            tight += 1
            outcomes.append(found_in(space, part, y, 0.999 * best, 8)[0])
            assert outcomes[-1] != PROVEN
    assert outcomes.count(PROVEN) > 3
    assert tight > 1


@pytest.mark.uncompiled
@pytest.mark.parametrize("is_thin", [False, True])
def test_a_pose_found_has_in_view_what_is_said(is_thin):
    """Around a pose that sees some edges, each visible everywhere: what is found sees as many, by projecting them."""
    judge, _ = request_for(SIZES[0])
    space = space_for(judge, Cells([[BoxCell(np.full(3, -1e4), np.full(3, 1e4))]] * len(EDGES)))
    space.entities = space.entities._replace(length_ratio=np.zeros(len(EDGES)))
    view = thin(space) if is_thin else space.view
    rng = np.random.default_rng(2)
    y = np.ones(len(EDGES))
    n_found = 0
    for k in range(20):
        look = rng.uniform(0.0, 1.0, 3) * SIZES[0]
        turn = rng.uniform(-1, 1, 3)
        weight = in_view(view, space.entities.ends, pose_of(view, k % 2, look, turn)[None])[0].sum()
        if weight == 0:
            continue
        part = k % 2, np.array([look, np.full(3, 3.0), turn, np.full(3, 0.01)])
        outcome, _, pose, inspected = found_in(space, part, y, weight - 0.5, 200)
        assert outcome == FOUND
        n_found += 1
        assert inspected.sum() > weight - 0.5
        assert in_view(view, space.entities.ends, pose[None])[0, inspected].all()
    assert n_found > 3


@pytest.mark.uncompiled
@pytest.mark.parametrize("is_thin", [False, True])
def test_boxes_too_small_to_be_halved_are_told(is_thin):
    """Two edges of the top, one visible where x < 60 and one where x > 60; both from nowhere, by 0.01 mm."""
    judge, _ = request_for(SIZES[0])
    low = np.full(3, -1e4)
    high = np.full(3, 1e4)
    pair = EDGES[:2]
    below = BoxCell(low, np.array([59.995, *high[1:]]))
    above = BoxCell(np.array([60.005, *low[1:]]), high)
    space = PoseSpace(
        judge.problem, np.arange(len(pair)), Cells([[below], [above]]), np.zeros((2, 2), dtype=bool)
    )
    if is_thin:
        thin(space)
    y = np.ones(2)
    TREES[space] = coarse_tree(space, y, 1.5, halvings=0)
    # from above, straight down
    at = np.array([60.01, 40.0, 60.0]), np.full(3, 0.02), np.zeros(3), np.full(3, 1e-5)
    outcome, _, _, inspected = found_in(space, (1, np.array(at)), y, 1.5, 100)
    assert outcome == (NEARLY if is_thin else UNRESOLVED)
    assert not is_thin or inspected.all()
    # one of them is seen
    outcome, _, pose, inspected = found_in(space, (1, np.array(at)), y, 0.5, 100)
    assert outcome == FOUND
    assert inspected.tolist() == [pose[0, 3] < 59.995, pose[0, 3] > 60.005]
    # and a larger box has too many
    assert (
        found_in(
            space, (1, np.array([at[0], np.full(3, 30.0), at[2], np.full(3, 0.3)])), y, 1.5, 3
        )[0]
        == SPENT
    )
