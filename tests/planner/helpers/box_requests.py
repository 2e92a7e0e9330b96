"""Requests to inspect boxes, random poses and boxes of poses about them, and the search of one."""

from __future__ import annotations

import weakref

import numpy as np
from grid_box import EDGES, BoxSpace
from scipy.spatial.transform import Rotation

from planner import Camera, PoseUncertainty
from planner.bound.boxes import search, viewpoints_for
from planner.bound.pose_space import PoseSpace
from planner.bound.view import Cells, SearchTask
from planner.bound.windows import rotation
from planner.effort import NORMAL
from planner.request.problem import Problem
from planner.search.columns import Judge

CAMERA = Camera(8.0, (0.00345, 0.00345), (2448, 2048), 8.0, 400.0)
UNCERTAINTY = PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.001)
WORKSPACE = [[-900.0] * 3, [1100.0] * 3]
# grown once: what they hold does not depend on weights and limits
TREES = weakref.WeakKeyDictionary()
SIZES = [(120.0, 80.0, 60.0), (400.0, 260.0, 240.0)]


def random_poses(judge, n, seed=0):
    from planner.search.columns import entity_poses

    poses = np.concatenate([entity_poses(judge, name, 10, seed) for name in judge.names])
    return poses[np.random.default_rng(seed).permutation(len(poses))[:n]]


def request_for(size, effort=NORMAL):
    space = BoxSpace(size, WORKSPACE, EDGES)
    judge = Judge(Problem(space, EDGES, CAMERA, UNCERTAINTY, 0.98, 0.9), effort)
    return judge, Cells([judge.space.covering_cells([name]) for name in EDGES])


def space_for(judge, regions, conflict=None):
    conflict = np.zeros((len(EDGES), len(EDGES)), dtype=bool) if conflict is None else conflict
    return PoseSpace(judge.problem, np.arange(len(EDGES)), regions, conflict)


def found_in(space, part, y, limit, max_nodes=100_000):
    """Search one part of the space: outcome, boxes looked at, pose, what it inspects."""
    pose = np.empty((4, 4))
    inspected = np.zeros(len(y), dtype=bool)
    chart, box = part
    order = np.argsort(-y, kind="stable")
    if space not in TREES:
        TREES[space] = viewpoints_for(space.nodal_points, space.entities, space.view, y, limit)
    stop = np.zeros(1, dtype=bool)
    task = SearchTask(space.conflict, y, limit, max_nodes, stop)
    return (
        *search(box, chart, order, space.entities, space.view, TREES[space], task, pose, inspected),
        pose,
        inspected,
    )


def pose_of(view, chart, look, turn):
    """The pose (4, 4) that looks at a point with the rotation of a chart and a vector."""
    pose = np.eye(4)
    rotation(chart, turn, pose[:3, :3])
    pose[:3, 3] = look - view.middle * pose[:3, 2]
    return pose


def poses_of(view, chart, looks, turns):
    """What `pose_of` gives for each of n points and vectors (n, 3), by rotations of another library."""
    turned = Rotation.from_quat(np.column_stack([turns, np.ones(len(turns))]))
    half_turn = Rotation.from_rotvec([np.pi * chart, 0, 0])
    poses = np.tile(np.eye(4), (len(turns), 1, 1))
    poses[:, :3, :3] = (half_turn.inv() * turned).as_matrix()
    poses[:, :3, 3] = looks - view.middle * poses[:, :3, 2]
    return poses


def box_around(rng, view, size, small):
    """A random box (4, 3) of poses near a part with a corner in the origin, and poses in it."""
    chart = int(rng.integers(2))
    look = rng.uniform(-0.2, 1.2, 3) * size
    turn = rng.uniform(-1, 1, 3)
    box = np.array([look, np.full(3, 60.0 * small), turn, np.full(3, 0.2 * small)])
    at = rng.uniform(-1, 1, (400, 2, 3))
    inside = poses_of(view, chart, look + box[1] * at[:, 0], turn + box[3] * at[:, 1])
    return (chart, box), inside


def sets_of(tree):
    """What may be inspected from each box of a tree of viewpoints, (n, e) of bool."""
    return np.unpackbits(tree.sets.view(np.uint8), axis=1, bitorder="little")[
        :, : len(EDGES)
    ].astype(bool)


def assert_tree_has(tree, poses, inspects, least):
    """All boxes that hold a pose have what it inspects; more poses than that inspect something."""
    sets = sets_of(tree)
    some = np.flatnonzero(inspects.any(axis=1))
    assert len(some) > least
    for k in some:
        eye = poses[k, :3, 3]
        holding = np.flatnonzero(
            ((tree.boxes[:, 0] <= eye) & (eye <= tree.boxes[:, 1])).all(axis=1)
        )
        assert (tree.second[holding] == 0).any()
        assert sets[holding][:, inspects[k]].all()
