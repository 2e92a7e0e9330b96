"""The lower bound: nothing that a pose inspects may be missing from its box, nor weigh more than the box's bound."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from grid_box import EDGES, BoxSpace
from scipy.spatial.transform import Rotation
from test_inspection import CAMERA, UNCERTAINTY, WORKSPACE, random_poses

from planner.camera import Camera
from planner.columns import Judge
from planner.conflicts import Cells
from planner.cover import min_cover
from planner.image import field_of_view_slacks, focus_slacks
from planner.looks import LookTree, raise_bound, spread_weights, view_of
from planner.pose import world_to_cam
from planner.posebox import Boxes, heaviest, rotation
from planner.subdivision import PoseTree

SIZES = [(120.0, 80.0, 60.0), (400.0, 260.0, 240.0)]


def request_for(size):
    judge = Judge(BoxSpace(size, WORKSPACE, EDGES), EDGES, CAMERA, UNCERTAINTY, 0.98, 0.9)
    return judge, Cells([judge.space.covering_cells([name]) for name in EDGES])


def tree_for(judge, regions, y, rounds=9, conflict=None):
    """A tree whose boxes have all been split so many times."""
    conflict = np.zeros((len(EDGES), len(EDGES)), dtype=bool) if conflict is None else conflict
    tree = LookTree(judge, np.arange(len(EDGES)), regions, conflict, y)
    for _ in range(rounds):
        tree.split(np.arange(len(tree.possible)), -1.0)
    return tree


def pose_of(tree, box, look, turn):
    """The pose (4, 4) that looks at a point with the rotation of a chart and a vector."""
    pose = np.eye(4)
    rotation(tree.boxes.chart[box], turn, pose[:3, :3])
    pose[:3, 3] = look - tree.view.middle * pose[:3, 2]
    return pose


def poses_within(tree, rng, n):
    """Random boxes, and a pose inside each."""
    rows = rng.integers(len(tree.possible), size=n)
    boxes = tree.boxes
    look = boxes.look[rows] + rng.uniform(-1, 1, (n, 3)) * boxes.half[rows]
    turn = boxes.turn[rows] + rng.uniform(-1, 1, (n, 3)) * boxes.span[rows]
    return rows, np.array([pose_of(tree, *each) for each in zip(rows, look, turn, strict=True)])


@pytest.mark.parametrize("size", SIZES)
def test_what_a_pose_inspects_is_possible_in_its_box_and_within_its_weight(size):
    judge, regions = request_for(size)
    rng = np.random.default_rng(3)
    y = np.sort(rng.uniform(0.1, 1.0, len(EDGES)))[::-1]
    tree = tree_for(judge, regions, y, rounds=11)
    tree.heavy(0.0)
    rows, poses = poses_within(tree, rng, 60_000)
    inspects = judge(poses).inspects
    assert (inspects.sum(axis=1) > 1).sum() > 20
    assert not (inspects & ~tree.possible[rows]).any()
    assert (inspects @ y <= tree.weight[rows] + 1e-9).all()
    # all edges of the smaller box fit into the image at once; of the larger one, windows lie apart
    assert (tree.weight < tree.possible @ y - 1e-9).any() == (size[0] > 300)


def test_every_pose_lies_in_a_root():
    """Up to half a turn about the camera's axis, which leaves what it inspects as it is."""
    judge, regions = request_for(SIZES[0])
    tree = tree_for(judge, regions, np.ones(len(EDGES)), rounds=0)
    found = np.empty((2, 3, 3))
    for turned in Rotation.random(200, random_state=1):
        best = np.inf
        for half, chart in itertools.product((Rotation.identity(), Rotation.from_rotvec([0, 0, np.pi])), (0, 1)):
            base = Rotation.identity() if chart == 0 else Rotation.from_rotvec([np.pi, 0, 0])
            x, y, z, w = (base.inv() * turned * half).as_quat()
            v = np.array([x, y, z]) / w
            if abs(v).max() <= 1.0:
                rotation(chart, v, found[chart])
                best = min(best, np.abs(found[chart] - (turned * half).as_matrix()).max())
        assert best < 1e-9
    points = judge.ends.reshape(-1, 3)
    rng = np.random.default_rng(0)
    corner = np.array([tree.view.tan_x, tree.view.tan_y, 1.0]) * rng.choice([-1, 1], (50, 3))
    depth = rng.choice([tree.view.near, tree.view.far], 50)
    offset = np.abs(corner) * [1, 1, 0] * depth[:, None] + np.outer(depth - tree.view.middle, [0, 0, 1])
    assert (np.linalg.norm(offset, axis=1) <= tree.view.radius + 1e-9).all()
    reach = np.abs(points[:, None] + np.linalg.norm(offset, axis=1)[:, None] * np.eye(3)[0] - tree.boxes.look[0])
    assert (reach <= tree.boxes.half[0] + 1e-9).all()


@pytest.mark.parametrize("seed", range(6))
def test_the_heaviest_windows_are_those_of_the_heaviest_pose(seed):
    """For a fixed rotation: by trying every pose at which some three of the constraints hold exactly."""
    size = (200.0, 130.0, 120.0)
    judge, regions = request_for(size)
    rng = np.random.default_rng(seed)
    y = np.sort(rng.uniform(0.1, 1.0, len(EDGES)))[::-1]
    tree = LookTree(judge, np.arange(len(EDGES)), regions, np.zeros((12, 12), dtype=bool), y)
    view, turn = tree.view, rng.uniform(-1, 1, 3)
    look = np.array(size) / 2
    box = Boxes(look[None], np.full((1, 3), 300.0), np.array([seed % 2]), turn[None], np.full((1, 3), 1e-12))
    weight = np.empty(1)
    heaviest(box, tree.entities, view, tree.conflict, np.ones((1, 12), dtype=bool), y, 0.0, weight)
    pose = np.eye(4)
    rotation(seed % 2, turn, pose[:3, :3])
    s = (tree.entities.ends - look) @ pose[:3, :3]
    best = 0.0
    for z in (s[..., 2] + view.middle - view.far).max(axis=1):
        depth = s[..., 2] - z + view.middle
        lefts = (s[..., 0] - view.tan_x * depth).max(axis=1)
        lows = (s[..., 1] - view.tan_y * depth).max(axis=1)
        for x, low in itertools.product(lefts, lows):
            eye = pose.copy()
            eye[:3, 3] = look + pose[:3, :3] @ ([x, low, z] - np.array([0, 0, view.middle]))
            ends = world_to_cam(tree.entities.ends, eye[None])
            ok = (focus_slacks(CAMERA, ends).min(axis=-1) >= -1e-6)[0]
            ok &= (field_of_view_slacks(CAMERA, ends, judge.requirements.field_margin_px).min(axis=-1) >= -1e-6)[0]
            inside = np.abs(pose[:3, :3] @ [x, low, z]).max() <= 300.0
            best = max(best, y[ok].sum() if inside else 0.0)
    assert best > 0.0
    assert weight[0] >= best - 1e-9
    # the box of the point looked at, turned into the camera's axes, is a little larger
    assert weight[0] <= best + 0.2 * y.sum()


def test_of_entities_that_exclude_each_other_one_counts():
    judge, regions = request_for(SIZES[0])
    y = np.linspace(1.0, 0.5, len(EDGES))
    every = ~np.eye(len(EDGES), dtype=bool)
    tree = tree_for(judge, regions, y, rounds=4, conflict=every)
    tree.heavy(0.0)
    assert tree.weight.max() == pytest.approx(1.0)


def test_spread_weights_are_a_dual_of_the_cover():
    """A ring of six entities seen in neighbouring pairs: three columns, and one half each is the symmetric dual."""
    ring = np.eye(6, dtype=bool) | np.roll(np.eye(6, dtype=bool), 1, axis=1)
    y = spread_weights(ring)
    assert (ring @ y).max() == pytest.approx(1.0)
    assert 2.0 < y.sum() <= 3.0 + 1e-9
    assert (y > 0).sum() > 3


def test_weights_raise_the_bound_but_not_above_what_poses_reach():
    """Twelve edges, of which a view takes in some: more than one setting is needed, and a cover is enough."""
    judge, regions = request_for(SIZES[1])
    columns = judge(random_poses(judge, 20_000, seed=2)).inspects
    columns = columns[columns.any(axis=1)]
    none = np.zeros((12, 12), dtype=bool)
    bound, made = raise_bound(judge, np.arange(12), regions, none, columns, 1, 12, max_nodes=20_000, progress=None)
    assert 2 <= bound <= len(min_cover(columns).chosen)
    assert made <= 20_000


def test_depth_without_end_is_cut_at_the_size_of_the_workspace():
    """Focused beyond the hyperfocal distance, 2319 mm: nothing is too far to be sharp."""
    far_off = Camera(8.0, (0.00345, 0.00345), (2448, 2048), 8.0, 3000.0)
    wide = [[-4000.0] * 3, [4100.0] * 3]
    judge = Judge(BoxSpace(SIZES[1], wide, EDGES), EDGES, far_off, UNCERTAINTY, 0.98, 0.9)
    view = view_of(judge)
    assert np.isinf(far_off.depth_of_field_mm[1])
    assert view.far == pytest.approx(8100.0 * np.sqrt(3))
    assert view.near == far_off.depth_of_field_mm[0] < view.middle < view.far


def leaves_of(tree, pose):
    """Leaves with the position and direction of a pose; they differ by roll or by excluded entities."""
    near = np.all(np.abs(pose[:3, 3] - tree.center) <= tree.half + 1e-9, axis=1)
    axis = pose[:3, 2]
    face = 2 * np.argmax(np.abs(axis)) + (axis[np.argmax(np.abs(axis))] < 0)
    u, v = (axis[(face // 2 + i) % 3] / abs(axis[face // 2]) for i in (1, 2))
    patch = tree.patch
    near &= (tree.face == face) & (patch[:, 0] <= u) & (u <= patch[:, 1]) & (patch[:, 2] <= v) & (v <= patch[:, 3])
    return np.flatnonzero(near)


@pytest.mark.parametrize("size", SIZES)
def test_every_inspected_set_is_inside_the_leaf_of_its_pose(size):
    """The larger box does not fit into the image or between the sharp planes: its edges exclude each other there."""
    judge, regions = request_for(size)
    tree = PoseTree(judge, np.arange(len(EDGES)), regions, np.zeros((12, 12), dtype=bool))
    for _ in range(9):
        tree.split(np.arange(len(tree.face)))
    poses = random_poses(judge, 400, seed=2)
    judged = judge(poses)
    assert (judged.inspects.sum(axis=1) > 1).any()
    for pose, inspected in zip(poses, judged.inspects, strict=True):
        if inspected.any():
            near = leaves_of(tree, pose)
            assert (tree.sets[near] >= inspected).all(axis=1).any()
