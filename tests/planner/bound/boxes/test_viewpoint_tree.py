"""What may be inspected from where: no box of viewpoints may lack what a pose in it inspects, all around or not."""

from __future__ import annotations

import numpy as np
import pytest
from box_requests import (
    CAMERA,
    SIZES,
    UNCERTAINTY,
    WORKSPACE,
    assert_tree_has,
    box_around,
    found_in,
    random_poses,
    request_for,
    sets_of,
    space_for,
)
from grid_box import EDGES, BoxCell, BoxSpace

from planner.bound.boxes import PROVEN, Asked, PosesBox, heavy_members, viewpoints_for
from planner.bound.pose_space import PoseSpace
from planner.bound.view import Cells
from planner.bound.windows import most_turn, rotation, swings
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
            strict.request, np.arange(len(pair)), regions, np.zeros((2, 2), dtype=bool)
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
