"""Poses with several entities in focus: directions by a closed form, and what they find that chance does not."""

import numpy as np
import pytest
from grid_box import EDGES, BoxSpace

from ground.shared import Shared
from planner import Camera, PoseUncertainty
from planner.camera.pose import look_at
from planner.cover import is_cover, min_cover
from planner.request.problem import Problem
from planner.search import columns
from planner.search.columns import (
    _CHILDREN,
    _DRAWN_POSES,
    ColumnPool,
    Judge,
    Judgement,
    Pools,
    WarmStart,
    _Breed,
    _drawn,
    _flat_directions,
    judged_poses,
    poses_in_focus,
    price_poses,
)

# a depth of field of 7 mm, on a block of 30 mm
CAMERA = Camera(25.0, (0.00345, 0.00345), (2448, 2048), 11.0, 250.0)
UNCERTAINTY = PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.001)
NAMES = list(EDGES)


@pytest.fixture(scope="module")
def judge():
    space = BoxSpace((30.0, 20.0, 15.0), [[-400.0] * 3, [400.0] * 3], NAMES)
    return Judge(Problem(space, NAMES, CAMERA, UNCERTAINTY, 0.98, 0.9))


def anywhere(judge, n, seed):
    """Poses that look from anywhere, at any distance in focus, at points between two edges."""
    rng = np.random.default_rng(seed)
    middles = judge.ends.mean(axis=1)
    one, other = middles[rng.integers(len(middles), size=(2, n))]
    targets = one + rng.random((n, 1)) * (other - one)
    away = rng.normal(size=(n, 3))
    away *= (rng.uniform(*CAMERA.depth_of_field_mm, n) / np.linalg.norm(away, axis=1))[:, None]
    return look_at(targets + away, targets, roll=rng.uniform(-np.pi, np.pi, n))


def n_in_focus(poses, ends):
    """Return how many entities each pose (n, 4, 4) has between the limits of focus with both ends."""
    depth = np.einsum("keni,ni->nke", ends[:, :, None] - poses[:, :3, 3], poses[:, :3, 2])
    nearest, farthest = CAMERA.depth_of_field_mm
    return ((depth >= nearest) & (depth <= farthest)).all(axis=2).sum(axis=1)


def test_directions_are_as_likely_as_the_closed_form_says():
    """Of a flat cross, the squares of the coordinates are chi-squares, and their ratio is of Student's t."""
    width = 10.0
    flat = 2.0
    n = 40_000
    cross = width * np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]], dtype=float)
    axis = _flat_directions(np.tile(cross, (n, 1, 1)), np.full(n, flat), np.random.default_rng(2))
    assert np.linalg.norm(axis, axis=1) == pytest.approx(np.ones(n))
    variance = width**2 / 2 + flat**2
    for along in (0.3, 0.8, 0.95, 0.99):
        ratio = np.sqrt(2 * along**2 / (1 - along**2) * flat**2 / variance)
        expected = 1 - ratio / np.sqrt(2 + ratio**2)
        share = (np.abs(axis[:, 2]) > along).mean()
        assert share == pytest.approx(expected, abs=4 * np.sqrt(0.25 / n))
    assert np.abs(axis.mean(axis=0)).max() < 4 / np.sqrt(n)


def test_entities_are_drawn_as_often_as_they_are_worth():
    worth = np.array([[0.0, 3.0, 0.0, 1.0], [2.0, 0.0, 2.0, 0.0]])
    row = np.repeat([0, 1], 20_000)
    drawn = _drawn(np.cumsum(worth, axis=1), row, np.random.default_rng(0))
    for k in range(2):
        shares = np.bincount(drawn[row == k], minlength=4) / 20_000
        assert shares == pytest.approx(worth[k] / 4, abs=0.02)
        assert not shares[worth[k] == 0].any()


def test_an_entity_that_alone_is_worth_something_is_in_focus(judge):
    for k in (0, 5, 11):
        prices = np.zeros(len(NAMES))
        prices[k] = 0.4
        poses = poses_in_focus(judge, prices, 8, 25, np.random.default_rng(k))
        assert poses.shape == (200, 4, 4)
        # an edge deeper than the depth of field has no distance at which all of it is in focus
        assert (n_in_focus(poses, judge.ends[k : k + 1]) == 1).mean() > 0.6


def test_more_entities_are_in_focus_than_from_anywhere(judge):
    prices = np.ones(len(NAMES))
    drawn = poses_in_focus(judge, prices, 64, 60, np.random.default_rng(1))
    chance = anywhere(judge, len(drawn), 1)
    several = [(n_in_focus(poses, judge.ends) >= 3).mean() for poses in (drawn, chance)]
    assert several[0] > 3 * several[1]


@pytest.mark.parametrize("seed", range(3))
def test_columns_are_not_beaten_by_poses_from_anywhere(judge, seed):
    """A short search of 20 rounds, and a pool of 40,000 poses with the cover that is proven to be smallest."""
    shared = Shared(judge)
    pools = Pools(ColumnPool(len(NAMES)), ColumnPool(len(NAMES)))
    for name in NAMES:
        poses, judged = judged_poses(shared, name, 20, seed)
        pools.add(poses, judged)
    price_poses(shared, pools, seed, 20, warm_start=WarmStart(coverable=np.ones(12, dtype=bool)))
    chance = ColumnPool(len(NAMES))
    poses = anywhere(judge, 40_000, seed)
    judged = judge(poses)
    chance.add(judged.inspects, poses, judged.probability)
    assert pools.realised.inspected.sum() >= chance.inspected.sum()
    ours = pools.realised.membership[:, chance.inspected]
    chosen = min_cover(ours).chosen
    assert is_cover(ours, chosen)
    assert len(chosen) <= len(min_cover(chance.membership[:, chance.inspected]).chosen)


def test_fewer_poses_are_drawn_anew_while_none_of_them_improves_the_cover():
    """And more near misses are tried instead: a round has as many poses within one parent's children."""
    rounds = [_Breed(np.zeros((0, 4, 4)), in_vain) for in_vain in range(12)]
    drawn = [one.n_drawn for one in rounds]
    assert drawn == sorted(drawn, reverse=True)
    assert drawn[1] == drawn[0] / 2
    assert drawn[-1] > 0
    in_all = [one.n_drawn * _DRAWN_POSES + one.n_hopeful * _CHILDREN for one in rounds]
    assert max(in_all) - min(in_all) < _CHILDREN


@pytest.mark.parametrize("improves", [True, False])
def test_that_ends_as_soon_as_one_improves_it(judge, monkeypatch, improves):
    """The first pose drawn is said to inspect everything, or nothing."""
    pools = Pools(ColumnPool(len(NAMES)), ColumnPool(len(NAMES)))
    pools.add(np.tile(np.eye(4), (12, 1, 1)), judgement(np.eye(12, dtype=bool)))

    def judged(shared, poses, prices):
        inspects = np.zeros((len(poses), len(prices)), dtype=bool)
        inspects[0] = improves
        return judgement(inspects)

    monkeypatch.setattr(columns, "_judged", judged)
    before = _Breed(pools.realised.poses, 3)
    rng = np.random.default_rng(0)
    after = columns._improve(Shared(judge), pools, before, np.ones(12), rng, None)
    assert after.in_vain == (0 if improves else 4)


def judgement(inspects):
    """Return a judgement in which what is inspected is certain."""
    return Judgement(inspects, inspects, inspects, inspects * 1.0, inspects * 1.0)
