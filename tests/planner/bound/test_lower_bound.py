"""The lower bound: nothing that a pose inspects may be missing from its box, nor weigh more than the box's bound."""

from __future__ import annotations

import itertools
from types import SimpleNamespace

import networkx as nx
import numpy as np
import pytest
from box_requests import (
    CAMERA,
    SIZES,
    UNCERTAINTY,
    WORKSPACE,
    box_around,
    found_in,
    pose_of,
    random_poses,
    request_for,
    space_for,
)
from grid_box import EDGES, BoxCell, BoxCells, BoxSpace
from scipy.spatial.transform import Rotation

from ground.shared import Shared
from planner import Camera, PoseUncertainty
from planner.bound import pose_space
from planner.bound.boxes import FOUND, PROVEN
from planner.bound.lower_bound import (
    _FINEST_RAD,
    LinearBound,
    _above,
    _proof,
    _proof_of_clique,
    _to_split,
    large_clique,
    lower_bound,
    spread_weights,
)
from planner.bound.pose_space import PoseSpace, WitnessSets, view_of
from planner.bound.pose_tree import PoseTree, TargetLeaves
from planner.bound.view import Cells, entity_cells
from planner.bound.windows import (
    extent,
    farthest,
    may_exceed,
    most_turn,
    rotation,
    seen_from,
    weight_at,
)
from planner.camera.pose import look_at, world_to_cam
from planner.cover import columns_of_covers, core_columns, fractional_cover, min_cover
from planner.effort import NORMAL, Effort
from planner.request.constraints import Requirements, field_of_view_slacks, focus_slacks
from planner.request.problem import Problem
from planner.request.reach import TargetSpace
from planner.request.targets import EdgeTarget, edge_target
from planner.search.columns import Judge, entity_poses


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("small", [1.0, 0.3, 0.05])
def test_no_pose_exceeds_what_the_search_proves_of_its_box(size, small):
    judge, regions = request_for(size)
    space = space_for(judge, regions)
    rng = np.random.default_rng(3)
    y = rng.uniform(0.1, 1.0, len(EDGES))
    proven = tight = 0
    for _ in range(60):
        part, poses = box_around(rng, space.view, size, small)
        best = float((judge(poses).inspects @ y).max())
        # above the best of the poses tried, and below it
        outcome = found_in(space, part, y, 1.02 * best + 1e-3, 3000)[0]
        proven += outcome == PROVEN
        if best > 0:
            tight += 1
            assert found_in(space, part, y, 0.999 * best, 3000)[0] != PROVEN
    assert proven > 10
    assert tight > 5


def test_the_pose_found_inspects_what_is_said():
    """By the judge's own constraints, with no stand-off, visibility at the position alone, and no probability asked."""
    size = SIZES[1]
    judge, regions = request_for(size)
    lenient = Judge(
        Problem(
            judge.space,
            EDGES,
            CAMERA,
            UNCERTAINTY,
            0.98,
            1e-6,
            Requirements(stand_off_mm=0.0, visibility_radius_mm=0.0),
        )
    )
    space = space_for(judge, regions)
    y = np.random.default_rng(5).uniform(0.1, 1.0, len(EDGES))
    n_found = 0
    for part in space.parts[::2]:
        outcome, _, pose, inspected = found_in(space, part, y, 1.0, 2000)
        if outcome == FOUND:
            n_found += 1
            assert y[inspected].sum() > 1.0
            slacks = lenient.constraints.slacks(
                pose[None], only=["field_of_view_px", "focus_mm", "visibility"]
            )
            for slack in slacks.values():
                assert slack[0, inspected].min() >= -1e-6
    assert n_found > 5


@pytest.mark.uncompiled
def test_every_pose_lies_in_a_part():
    """Up to half a turn about the camera's axis, which leaves what it inspects as it is."""
    judge, regions = request_for(SIZES[0])
    space = space_for(judge, regions)
    boxes = np.array([box for _, box in space.parts])
    charts = np.array([chart for chart, _ in space.parts])
    found = np.empty((3, 3))
    for turned in Rotation.random(200, random_state=1):
        best = np.inf
        for half, chart in itertools.product(
            (Rotation.identity(), Rotation.from_rotvec([0, 0, np.pi])), (0, 1)
        ):
            flip = Rotation.from_rotvec([np.pi * chart, 0, 0])
            x, y, z, w = (flip * turned * half).as_quat()
            v = np.array([x, y, z]) / w if w else np.full(3, np.inf)
            if np.abs(v).max() <= 1.0:
                rotation(chart, v, found)
                assert (
                    charts[np.all(np.abs(v - boxes[:, 2]) <= boxes[:, 3], axis=1)] == chart
                ).any()
                best = min(best, np.abs(found - (turned * half).as_matrix()).max())
        assert best < 1e-9
    low = (boxes[:, 0] - boxes[:, 1]).min(axis=0)
    high = (boxes[:, 0] + boxes[:, 1]).max(axis=0)
    volume = np.prod(2 * boxes[:, 1], axis=1) * np.prod(boxes[:, 3], axis=1)
    assert volume.sum() == pytest.approx(2 * np.prod(high - low))
    # whatever has an edge in view looks at a point not farther from it than the corners of the view are
    view = space.view
    points = judge.ends.reshape(-1, 3)
    corner = np.array(
        [
            [x * view.tan_x * z, y * view.tan_y * z, z - view.middle]
            for x in (-1, 1)
            for y in (-1, 1)
            for z in (view.near, view.far)
        ]
    )
    assert np.linalg.norm(corner, axis=1).max() <= view.radius + 1e-9
    assert (low <= points.min(axis=0) - view.radius + 1e-9).all()
    assert (high >= points.max(axis=0) + view.radius - 1e-9).all()


@pytest.mark.uncompiled
@pytest.mark.parametrize("small", [0.5, 0.1, 0.0])
def test_images_long_enough_are_not_deeper_than_said(small):
    """Projected poses of random boxes: no end is deeper, and of a single pose's the limit is where eq 16 has it."""
    judge, regions = request_for(SIZES[1])
    view = space_for(judge, regions).view
    ratio = 0.12
    rng = np.random.default_rng(7)
    s = np.empty((2, 3))
    far = np.empty(2)
    opened = np.empty(2)
    room = np.empty(3)
    n_long = n_short = 0
    for _ in range(300):
        (chart, box), poses = box_around(rng, view, SIZES[1], small)
        matrix = np.empty((3, 3))
        n = rotation(chart, box[2], matrix)
        t, _ = most_turn(box[2], box[3], n)
        extent(matrix, box[1], t, room)
        ends = box[0] + rng.choice([25.0, 150.0]) * rng.uniform(-1, 1, (2, 3))
        seen_from(ends, box[0], matrix, s)
        farthest(s, float(np.linalg.norm(ends[1] - ends[0])), ratio, t, room, view, far, opened)
        at = world_to_cam(ends, poses)
        image = at[..., :2] / at[..., 2:]
        depth = at[..., 2]
        seen = (np.abs(image) <= [view.tan_x, view.tan_y]).all(axis=(1, 2))
        seen &= ((depth >= view.near) & (depth <= view.far)).all(axis=1)
        long = seen & (np.linalg.norm(image[:, 1] - image[:, 0], axis=1) >= ratio)
        assert (depth[long] <= far + 1e-6).all()
        n_long += long.any()
        if small == 0.0 and seen.all() and not long.any():
            n_short += 1
            assert (depth > far * (1.0 - 1e-6)).any()
    assert n_long > 20
    assert small > 0.0 or n_short > 20


def test_of_one_part_several_different_poses_are_found():
    judge, regions = request_for(SIZES[1])
    space = space_for(judge, regions)
    y = np.random.default_rng(5).uniform(0.1, 1.0, len(EDGES))
    several = list(space.search(y, 1.0, 2000, most=4))
    assert 2 <= max(len(found.sets) for found in several) <= 4
    for found in several:
        assert (found.sets @ y > 1.0).all()
        assert len({tuple(row) for row in found.sets.tolist()}) == len(found.sets)
        assert (found.outcome == FOUND) == (len(found.poses) > 0)
    some = [found.made for found in space.search(y, 1.0, 2000, parts=[7, 3], most=4)]
    assert some == [several[7].made, several[3].made]


@pytest.mark.uncompiled
@pytest.mark.parametrize("seed", range(6))
def test_for_a_fixed_rotation_the_limit_is_the_heaviest_pose(seed):
    """By trying every pose at which some three of the constraints hold exactly; all edges are visible everywhere."""
    size = (200.0, 130.0, 120.0)
    judge, _ = request_for(size)
    regions = Cells([[BoxCell(np.full(3, -1e4), np.full(3, 1e4))]] * len(EDGES))
    rng = np.random.default_rng(seed)
    y = rng.uniform(0.1, 1.0, len(EDGES))
    space = space_for(judge, regions)
    turn = rng.uniform(-1, 1, 3)
    view = space.view
    look = np.array(size) / 2
    pose = pose_of(view, seed % 2, look, turn)
    s = (space.entities.ends - look) @ pose[:3, :3]
    best = 0.0
    for z in (s[..., 2] + view.middle - view.far).max(axis=1):
        depth = s[..., 2] - z + view.middle
        lefts = (s[..., 0] - view.tan_x * depth).max(axis=1)
        lows = (s[..., 1] - view.tan_y * depth).max(axis=1)
        for x, low in itertools.product(lefts, lows):
            eye = pose.copy()
            eye[:3, 3] = look + pose[:3, :3] @ ([x, low, z] - np.array([0, 0, view.middle]))
            ends = world_to_cam(space.entities.ends, eye[None])
            ok = (focus_slacks(CAMERA, ends).min(axis=-1) >= -1e-6)[0]
            ok &= (
                field_of_view_slacks(CAMERA, ends, judge.requirements.field_margin_px).min(axis=-1)
                >= -1e-6
            )[0]
            best = max(best, y[ok].sum())
    assert best > 0.0
    part = seed % 2, np.array([look, np.full(3, 400.0), turn, np.full(3, 1e-9)])
    assert found_in(space, part, y, 1.001 * best)[0] == PROVEN
    outcome, _, _, inspected = found_in(space, part, y, 0.98 * best)
    assert outcome == FOUND
    assert y[inspected].sum() == pytest.approx(best, rel=0.02)


def weights_on(points, least, y, view):
    """Weights (n,) of the windows (m, 6) that contain the points (n, 3): no value is below its least."""
    x, upward, z = points.T
    beside = view.tan_x * z
    above = view.tan_y * z
    values = [x - beside, -x - beside, upward - above, -upward - above, -z, z]
    inside = np.ones((len(points), len(y)), dtype=bool)
    for value, limit in zip(values, least.T, strict=True):
        inside &= value[:, None] >= limit
    return inside @ y


@pytest.mark.uncompiled
def test_windows_meet_where_a_fine_grid_says():
    """Random windows: the heaviest point of a grid is never above what may meet, and the answer yes has a witness."""
    judge, regions = request_for(SIZES[0])
    view = space_for(judge, regions).view
    rng = np.random.default_rng(1)
    room = np.array([view.tan_x, view.tan_y, 0.2]) * view.middle
    grid = np.stack(np.meshgrid(*[np.linspace(-r, r, 25) for r in room]), axis=-1).reshape(-1, 3)
    n_yes = 0
    for _ in range(60):
        m = int(rng.integers(2, 12))
        middle = rng.uniform(-1, 1, (m, 3)) * room
        half = rng.uniform(0.2, 0.8, (m, 3)) * room
        least = np.stack([middle - half, -middle - half], axis=-1).reshape(m, 6)
        # the upper side of z comes before the lower one
        least[:, 4:] = least[:, 5:3:-1]
        y = np.sort(rng.uniform(0.1, 1.0, m))[::-1]
        own = np.arange(m)
        w = np.empty(3)
        weights = weights_on(grid, least, y, view)
        for k in (0, len(grid) // 2, weights.argmax()):
            assert weight_at(least, own, y, grid[k], view) == pytest.approx(weights[k])
        best = weights.max()
        assert may_exceed(least, own, y, best - 1e-9, room, view, w)
        if may_exceed(least, own, y, best + 0.05, room, view, w):
            n_yes += 1
            assert weight_at(least - room.max() / 256, own, y, w, view) > best + 0.05
    assert 0 < n_yes < 60


def test_of_entities_that_exclude_each_other_one_counts():
    judge, regions = request_for(SIZES[0])
    y = np.linspace(1.0, 0.5, len(EDGES))
    every = space_for(judge, regions, ~np.eye(len(EDGES), dtype=bool))
    none = space_for(judge, regions)
    assert all(found.outcome == PROVEN for found in every.search(y, 1.0, 10_000))
    assert not all(found.outcome == PROVEN for found in none.search(y, 1.0, 10_000))


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
    fewest = len(min_cover(columns).chosen)
    linear = LinearBound(space_for(judge, regions), columns)
    assert 2 <= linear.raise_from(1, 12, max_nodes=200_000) <= fewest
    again = LinearBound(space_for(judge, regions), columns)
    again.raise_from(1, 12, max_nodes=200_000)
    assert again.made == linear.made
    few = LinearBound(space_for(judge, regions), columns)
    assert few.raise_from(1, 12, max_nodes=5000) <= fewest
    assert 0 < few.made <= 5000


def test_the_search_can_be_cancelled_within_a_part(monkeypatch):
    monkeypatch.setattr(pose_space, "_TICK_S", 0.0)
    judge, regions = request_for(SIZES[1])
    calls = []

    def tick():
        calls.append(len(calls))
        if len(calls) == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        for _ in space_for(judge, regions).search(
            np.linspace(1.0, 0.5, len(EDGES)), 1.05, 10**9, tick
        ):
            pass
    assert calls == [0, 1, 2]


def test_a_pose_that_weighs_too_much_changes_the_weights():
    """Told of single edges only, the bound starts from weights of one each, which no view that sees two allows."""
    judge, regions = request_for(SIZES[1])
    linear = LinearBound(space_for(judge, regions), np.eye(len(EDGES), dtype=bool))
    bound = linear.raise_from(3, 12, max_nodes=300_000)
    seen = judge(random_poses(judge, 20_000, seed=2)).inspects
    assert len(linear.found) > 0
    assert linear.found.sum(axis=1).min() > 1
    assert 3 <= bound <= len(min_cover(seen[seen.any(axis=1)]).chosen)


def test_depth_without_end_is_cut_at_the_size_of_the_workspace():
    """Focused beyond the hyperfocal distance, 2319 mm: nothing is too far to be sharp."""
    far_off = Camera(8.0, (0.00345, 0.00345), (2448, 2048), 8.0, 3000.0)
    wide = [[-4000.0] * 3, [4100.0] * 3]
    judge = Judge(Problem(BoxSpace(SIZES[1], wide, EDGES), EDGES, far_off, UNCERTAINTY, 0.98, 0.9))
    view = view_of(judge.problem)
    assert np.isinf(far_off.depth_of_field_mm[1])
    assert view.far == pytest.approx(8100.0 * np.sqrt(3))
    assert view.near == far_off.depth_of_field_mm[0] < view.middle < view.far


def test_cells_of_entities_one_by_one_are_those_of_all():
    judge, regions = request_for(SIZES[1])
    none = Cells([[]])
    one_by_one = [entity_cells(Shared(judge), name) for name in EDGES]
    for joined in (
        Cells.joined(one_by_one),
        Cells.joined([Cells.joined(one_by_one[:5]), *one_by_one[5:]]),
    ):
        for mine, theirs in zip(joined.arrays, regions.arrays, strict=True):
            assert np.array_equal(mine, theirs)
    assert len(regions.boxes) > len(EDGES)
    assert Cells.joined([none, one_by_one[0]]).entity_start.tolist() == [
        0,
        0,
        len(one_by_one[0].boxes),
    ]


def leaves_of(tree, pose):
    """Leaves with the position and direction of a pose; they differ by roll or by excluded entities."""
    near = np.all(np.abs(pose[:3, 3] - tree.centre) <= tree.half + 1e-9, axis=1)
    axis = pose[:3, 2]
    face = 2 * np.argmax(np.abs(axis)) + (axis[np.argmax(np.abs(axis))] < 0)
    u, v = (axis[(face // 2 + i) % 3] / abs(axis[face // 2]) for i in (1, 2))
    patch = tree.patch
    near &= (
        (tree.face == face)
        & (patch[:, 0] <= u)
        & (u <= patch[:, 1])
        & (patch[:, 2] <= v)
        & (v <= patch[:, 3])
    )
    return np.flatnonzero(near)


@pytest.mark.parametrize(
    ("size", "splits", "n_poses"),
    [
        *((size, 9, 400) for size in SIZES),
        pytest.param(SIZES[1], 6, 200, marks=pytest.mark.uncompiled),
    ],
)
def test_every_inspected_set_is_inside_the_leaf_of_its_pose(size, splits, n_poses):
    """The larger box does not fit into the image or between the sharp planes: its edges exclude each other there."""
    judge, regions = request_for(size)
    tree = PoseTree(judge.problem, np.arange(len(EDGES)), regions, np.zeros((12, 12), dtype=bool))
    for _ in range(splits):
        tree.split(np.arange(len(tree.face)))
    poses = random_poses(judge, n_poses, seed=2)
    judged = judge(poses)
    assert (judged.inspects.sum(axis=1) > 1).any()
    y = np.linspace(0.0, 1.0, len(EDGES))
    bounds = tree.weights(np.arange(len(tree.face)), y)
    assert (bounds <= tree.sets @ y + 1e-9).all()
    assert (bounds < tree.sets @ y - 1e-9).any() == (size == SIZES[1])
    for pose, inspected in zip(poses, judged.inspects, strict=True):
        if inspected.any():
            near = leaves_of(tree, pose)
            holding = near[(tree.sets[near] >= inspected).all(axis=1)]
            assert bounds[holding].max() >= inspected @ y - 1e-9


def test_a_tree_of_viewpoints_grown_again_is_the_same_and_so_are_later_ones():
    """How fine a tree is depends on those grown before it."""
    judge, regions = request_for(SIZES[1])
    even, odd = np.where(np.arange(len(EDGES)) % 2 == 0, [[1.0], [0.2]], [[0.2], [1.0]])
    first = space_for(judge, regions)
    first._viewpoints(even, 1.0)
    again = space_for(judge, regions)
    again.regrow(first.grown_for())
    assert first.grown_for()["finest"] == again.grown_for()["finest"]
    # for the same weights the tree is not grown anew, for others it is
    for y, limit in ((even, 1.1), (odd, 0.9), (odd, 0.3)):
        one = first._viewpoints(y, limit)
        other = again._viewpoints(y, limit)
        assert all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))
    assert space_for(judge, regions).grown_for() is None


# What the lower bound's document called open, and is closed: docs/mathematics/lower-bound.md,
# section 9.


PAIR = ("+z+y", "+z-y")
WORKSPACE_LOWER_BOUND_OPEN = np.array([[-900.0] * 3, [1100.0] * 3])
CERTAIN = PoseUncertainty.isotropic(translation_mm=1e-6, rotation_rad=1e-8)


class Slab(BoxSpace):
    """Two edges, one visible from z = 460 upwards, the other up to half a micrometre above that."""

    low = 460.0
    high = 460.0005

    def _in_front(self, points, name):
        return points[:, 2] >= self.low if name == PAIR[0] else points[:, 2] <= self.high

    def covering_cells(self, names):
        low, high = WORKSPACE_LOWER_BOUND_OPEN.copy()
        low[2] = self.low if PAIR[0] in names else low[2]
        high[2] = self.high if PAIR[1] in names else high[2]
        return BoxCells([BoxCell(low, high)])


def test_a_viewpoint_in_a_slab_of_half_a_micrometre_serves_both_edges():
    camera = Camera(8.0, (0.00345, 0.00345), (2448, 2048), 8.0, 400.0)
    judge = Judge(
        Problem(
            Slab((120.0, 80.0, 60.0), WORKSPACE_LOWER_BOUND_OPEN, PAIR),
            PAIR,
            camera,
            CERTAIN,
            0.98,
            0.9,
        )
    )
    pose = look_at([[60.0, 40.0, 460.00025]], [60.0, 40.0, 60.0])
    if not judge(pose).inspects.all():
        pytest.fail("the pose must inspect both edges", pytrace=False)
    effort = Effort(bound_nodes=100_000)
    assert lower_bound(judge.problem, 2, np.eye(2, dtype=bool), effort=effort)[0] == 1


# Cliques are cliques, and on small graphs the largest ones.


@pytest.mark.parametrize("density", [0.0, 0.2, 0.5, 0.8, 1.0])
def test_a_clique_is_one_and_as_large_as_any(density):
    rng = np.random.default_rng(4)
    for n in (1, 2, 7, 16, 24):
        upper = np.triu(rng.random((n, n)) < density, k=1)
        conflict = upper | upper.T
        found = large_clique(conflict)
        assert (conflict[np.ix_(found, found)] | np.eye(len(found), dtype=bool)).all()
        assert len(set(found.tolist())) == len(found)
        assert len(found) == max(
            len(clique) for clique in nx.find_cliques(nx.from_numpy_array(conflict))
        )


# Which nodes of a tree of poses are split, by hand on trees that are no more than their sets.


COARSE = 1.0
FINE = _FINEST_RAD / 2


def tree_of(sets, size=None):
    sets = np.array(sets, dtype=bool)
    size = np.full(len(sets), COARSE) if size is None else np.array(size)
    return SimpleNamespace(sets=sets, size=size, weights=lambda nodes, y: sets[nodes] @ y)


def test_nodes_that_weigh_more_than_their_share_are_split_the_heaviest_first():
    """Weights of 0.4, 0.5 and 0.6 for two settings of at least 0.75 each: {0, 1} and {1, 2} weigh 0.9 and 1.1."""
    y = np.array([0.4, 0.5, 0.6])
    sets = [[1, 1, 0], [1, 0, 0], [0, 1, 1], [0, 1, 1]]
    assert _above(tree_of(sets), y, 3).tolist() == [2, 3, 0]
    # what is fine is not split any more, though it still stands in the way of the proof
    assert _above(tree_of(sets, [COARSE, COARSE, FINE, COARSE]), y, 3).tolist() == [3, 0]
    assert _above(tree_of(sets, [FINE] * 4), y, 3).tolist() == []
    # of one setting each must weigh 1.5: none does, and two settings are proven
    assert _above(tree_of(sets), y, 2) is None


def test_without_a_cover_by_the_sets_there_is_nothing_to_split():
    """Three entities, no two together: two settings do not cover them; with a pair they may."""
    single = np.eye(3, dtype=bool)
    y = np.full(3, 1.0)
    assert _to_split(tree_of(single), y, 3) is None
    pairs = [[1, 1, 0], [0, 0, 1], [0, 1, 0]]
    assert sorted(_to_split(tree_of(pairs), np.full(3, 0.5), 3).tolist()) == [0, 1]
    assert _to_split(tree_of(pairs, [FINE, COARSE, COARSE]), np.full(3, 0.5), 3).tolist() == [1]
    # an entity that is in no set needs no search
    assert _to_split(tree_of([[1, 1, 0]]), np.full(3, 0.5), 3) is None


@pytest.mark.parametrize(
    ("told", "words"),
    [
        (_proof_of_clique(1, "edges"), "Fewer settings than one inspect nothing."),
        (_proof_of_clique(3, "dimensions"), "Of 3 dimensions no two can be inspected together"),
        (_proof(1, 1), "1 box of camera poses was checked"),
        (_proof(5, 0, "dimensions"), "and no pairs of dimensions were found to exclude each other"),
        (_proof(5, 1), "and 1 pair of edges was found"),
    ],
)
def test_what_a_bound_rests_on_is_told(told, words):
    assert words in told


def test_columns_of_small_covers():
    """A triangle of pairs and a single: of covers of two, the single 0 alone cannot be one; of all three it can."""
    membership = np.array([[1, 1, 0], [0, 1, 1], [1, 0, 1], [1, 0, 0]], dtype=bool)
    assert fractional_cover(membership[:, :0]) == (0.0, pytest.approx(np.zeros(0)))
    pairs = {0, 1, 2}
    assert pairs <= set(columns_of_covers(membership, 2).tolist())
    assert pairs | {3} == set(columns_of_covers(membership, 3).tolist())
    assert membership[core_columns(membership)].any(axis=0).all()


# The bound with a choice of witnesses: a target counts once, where any of its witnesses may be
# inspected.


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
