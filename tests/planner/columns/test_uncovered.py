"""Column generation that looks for entities which no column has yet."""

import numpy as np
import pytest
from grid_box import EDGES, BoxSpace

from planner import Camera, PoseUncertainty
from planner.executors import Shared
from planner.request.problem import Problem
from planner.search import columns as candidates
from planner.search.columns import (
    _UNCOVERED,
    ColumnPool,
    Judge,
    Pools,
    WarmStart,
    entity_poses,
    price_poses,
)

CAMERA = Camera(25.0, (0.00345, 0.00345), (2448, 2048), 8.0, 400.0)
UNCERTAINTY = PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.001)
NAMES = tuple(EDGES)[:8]
KNOWN = NAMES[::2]


@pytest.fixture(scope="module")
def judge():
    space = BoxSpace((120.0, 80.0, 60.0), [[-900.0] * 3, [1100.0] * 3], NAMES)
    return Judge(Problem(space, NAMES, CAMERA, UNCERTAINTY, 0.98, 0.9))


def pools_of(judge, names, nearly=True):
    """Pools of poses drawn for some entities, without the others; nearly inspected is what is so by these."""
    pools = Pools(ColumnPool(len(NAMES)), ColumnPool(len(NAMES)))
    poses = np.concatenate([entity_poses(judge, name, 25, seed=1) for name in names])
    judged = judge(poses)
    some = np.isin(NAMES, names)
    pools.realised.add(judged.inspects & some, poses, judged.probability)
    if nearly:
        pools.near.add(judged.nearly & some, poses, judged.probability)
    return pools


def prices_asked(judge, monkeypatch, pools, warm_start, rounds):
    """Return the prices of each round; the pools are changed."""
    asked = []
    improve = candidates._improve

    def watched(shared, pools, breed, prices, rng, executor):
        asked.append(prices.copy())
        return improve(shared, pools, breed, prices, rng, executor)

    monkeypatch.setattr(candidates, "_improve", watched)
    price_poses(Shared(judge), pools, 5, rounds, warm_start=warm_start)
    return asked


def test_what_is_sought_is_found_and_joins_the_cover(judge, monkeypatch):
    pools = pools_of(judge, KNOWN)
    assert pools.realised.inspected.tolist() == [name in KNOWN for name in NAMES]
    asked = prices_asked(judge, monkeypatch, pools, WarmStart(coverable=np.ones(8, dtype=bool)), 12)
    assert (asked[0][1::2] == _UNCOVERED).all()
    found = pools.realised.inspected
    assert found[1::2].sum() >= 2
    # what some column has is worth what the cover says, and no setting of its own
    joined = np.array(asked)[:, found]
    assert (joined[-1] <= 1.0 + 1e-9).all()
    assert (np.array(asked)[:, ~found] == _UNCOVERED).all()


def test_what_is_given_up_is_not_sought(judge, monkeypatch):
    pools = pools_of(judge, KNOWN)
    sought = np.arange(8) != 7
    asked = prices_asked(judge, monkeypatch, pools, WarmStart(coverable=sought), 1)
    assert asked[0][7] == 0.0
    assert (asked[0][1:7:2] == _UNCOVERED).all()


def test_without_being_sought_they_are_worth_nothing(judge, monkeypatch):
    asked = prices_asked(judge, monkeypatch, pools_of(judge, KNOWN), None, 5)
    assert len(asked) == 5
    assert not np.array(asked)[:, 1::2].any()


def test_it_begins_with_what_is_nearly_inspected_or_not_at_all(judge):
    nothing = Pools(ColumnPool(len(NAMES)), ColumnPool(len(NAMES)))
    price_poses(
        Shared(judge), nothing, 5, 3, warm_start=WarmStart(coverable=np.ones(8, dtype=bool))
    )
    assert not len(nothing.realised)
    pools = pools_of(judge, NAMES[:2])
    pools = Pools(ColumnPool(len(NAMES)), pools.near)
    price_poses(Shared(judge), pools, 5, 6, warm_start=WarmStart(coverable=np.ones(8, dtype=bool)))
    assert pools.realised.inspected[:2].all()


def test_a_pool_tells_what_is_inspected():
    pool = ColumnPool(3)
    assert pool.inspected.tolist() == [False] * 3
    pool.add(
        np.array([[1, 0, 0], [1, 0, 1]], dtype=bool), np.tile(np.eye(4), (2, 1, 1)), np.ones((2, 3))
    )
    assert pool.inspected.tolist() == [True, False, True]
