"""The bound with a choice of witnesses: a target counts once, where any of its witnesses may be inspected."""

from __future__ import annotations

import numpy as np
import pytest
from box_requests import CAMERA, SIZES, UNCERTAINTY, WORKSPACE, box_around, found_in
from grid_box import EDGES, BoxSpace

from planner.bound.boxes import PROVEN
from planner.bound.lower_bound import lower_bound
from planner.bound.pose_space import PoseSpace, WitnessSets
from planner.bound.pose_tree import PoseTree, TargetLeaves
from planner.bound.view import Cells
from planner.cover import min_cover
from planner.effort import NORMAL, Effort
from planner.request.problem import Problem
from planner.request.reach import TargetSpace
from planner.request.targets import EdgeTarget, edge_target
from planner.search.columns import Judge, entity_poses

# twelve edges of a box, three of them for each target, and one edge in two targets
CHOICES = [(0, 5, 9), (1, 4, 11), (2, 7, 8), (3, 6, 10, 0)]


def judge_of(size, choices=CHOICES):
    space = BoxSpace(size, WORKSPACE, EDGES)
    edges = [edge_target(name, space.entities[name].endpoints).witness for name in EDGES]
    targets = tuple(
        EdgeTarget(f"target {k}", tuple(edges[e] for e in own)) for k, own in enumerate(choices)
    )
    names = tuple(target.name for target in targets)
    joined = TargetSpace.of(space, targets)
    return Judge(Problem(joined, names, CAMERA, UNCERTAINTY, 0.98, 0.9, targets=targets), NORMAL)


def poses_of(judge, n=30):
    return np.concatenate([entity_poses(judge, name, n, 5) for name in judge.names])


def regions_of(judge):
    single = judge.single
    return Cells([single.space.covering_cells([name]) for name in single.names])


@pytest.mark.parametrize("size", SIZES)
def test_a_pose_inspects_a_target_by_any_of_its_witnesses(size):
    judge = judge_of(size)
    edges = BoxSpace(size, WORKSPACE, EDGES)
    plain = Judge(Problem(edges, EDGES, CAMERA, UNCERTAINTY, 0.98, 0.9), NORMAL)
    poses = poses_of(judge)
    got = judge(poses)
    each = plain(poses)
    for k, own in enumerate(CHOICES):
        assert np.array_equal(got.inspects[:, k], each.inspects[:, own].any(axis=1))
        assert np.array_equal(got.nearly[:, k], each.nearly[:, own].any(axis=1))
        best = np.where(each.inspects[:, own], each.probability[:, own], 0.0).max(axis=1)
        rows = got.inspects[:, k]
        assert got.probability[rows, k] == pytest.approx(best[rows], abs=1e-9)
    assert got.inspects.any(axis=0).all()


def test_prices_count_a_target_once():
    """Two witnesses in view are worth one target: no more than what the target costs."""
    judge = judge_of(SIZES[0])
    poses = poses_of(judge)
    free = judge(poses)
    prices = np.full(len(CHOICES), 0.6)
    priced = judge(poses, prices)
    worth = free.nearly @ prices > 1.0
    assert 0 < worth.sum() < len(worth)
    assert not priced.inspects[~worth].any()
    assert np.array_equal(priced.inspects[worth], free.inspects[worth])


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("small", [1.0, 0.3])
def test_no_pose_exceeds_what_is_proven_of_its_box(size, small):
    judge = judge_of(size)
    witnesses = WitnessSets.of(judge.problem)
    n = len(judge.single.names)
    conflict = witnesses.one_each(np.zeros((n, n), bool))
    space = PoseSpace(judge.single, np.arange(n), regions_of(judge), conflict, witnesses)
    rng = np.random.default_rng(4)
    y = rng.uniform(0.2, 1.0, len(CHOICES))
    proven = tight = 0
    for _ in range(40):
        part, poses = box_around(rng, space.view, size, small)
        best = float((judge(poses).inspects @ y).max())
        proven += found_in(space, part, y[witnesses.owner], 1.02 * best + 1e-3, 3000)[0] == PROVEN
        if best > 0:
            tight += 1
            assert found_in(space, part, y[witnesses.owner], 0.999 * best, 3000)[0] != PROVEN
    # without counting each target once, hardly a box with several witnesses in view would be proven
    assert proven > 5
    assert tight > 5


def test_leaves_hold_what_poses_in_them_inspect():
    judge = judge_of(SIZES[0])
    witnesses = WitnessSets.of(judge.problem)
    n = len(judge.single.names)
    none = np.zeros((n, n), bool)
    tree = PoseTree(judge.single, np.arange(n), regions_of(judge), none, witnesses.one_each(none))
    leaves = TargetLeaves(tree, witnesses)
    for _ in range(6):
        leaves.split(np.arange(min(len(leaves.sets), 200)))
    poses = poses_of(judge)
    inspects = judge(poses).inspects
    y = np.array([1.0, 0.7, 0.5, 0.3])
    most = leaves.weights(np.arange(len(leaves.sets)), y)
    # every set that is inspected is part of some leaf's, and weighs no more than the heaviest leaf
    for row in np.unique(inspects, axis=0):
        holding = (leaves.sets | ~row).all(axis=1)
        assert holding.any()
        assert most[holding].max() >= row @ y - 1e-9
    # a leaf never weighs more than its targets
    assert (most <= leaves.sets @ y + 1e-9).all()


def test_the_bound_never_exceeds_a_cover_that_is_known():
    """Opposite edges exclude each other on a large box; with either as witness one setting may do."""
    effort = Effort(bound_nodes=4000)
    found = {}
    for name, choices in {"alone": [(0,), (5,), (9,), (11,)], "any": CHOICES}.items():
        judge = judge_of(SIZES[1], choices)
        inspects = judge(poses_of(judge, 60)).inspects
        columns = np.unique(inspects[inspects.any(axis=1)], axis=0)
        known = len(min_cover(columns).chosen)
        bound, _, _ = lower_bound(judge.problem, known, columns, effort=effort)
        assert 1 <= bound <= known
        found[name] = known
    assert found["any"] <= found["alone"]


def test_targets_exclude_each_other_only_if_all_their_witnesses_do():
    witnesses = WitnessSets(np.array([0, 0, 1, 2, 2]))
    rng = np.random.default_rng(1)
    for _ in range(100):
        conflict = rng.random((5, 5)) < 0.7
        conflict = (conflict | conflict.T) & ~np.eye(5, dtype=bool)
        apart = witnesses.targets_apart(conflict)
        members = [[0, 1], [2], [3, 4]]
        for t, u in ((0, 1), (0, 2), (1, 2)):
            expected = all(conflict[a, b] for a in members[t] for b in members[u])
            assert apart[t, u] == apart[u, t] == expected
        assert not apart.diagonal().any()
        counted = witnesses.one_each(conflict)
        assert counted[0, 1]
        assert counted[3, 4]
