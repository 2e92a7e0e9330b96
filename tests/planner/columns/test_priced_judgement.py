"""Poses judged with prices: what is worth more than 1 is judged as without, and all else inspects nothing."""

import numpy as np
import pytest
from pocket_block import entities, two_pocket_block

from aspectgraph import compute_regions
from planner import Camera, Detectability, PoseUncertainty, Requirements
from planner.request.defaults import default_workspace
from planner.request.problem import Problem
from planner.search.columns import Judge, entity_poses

CAMERA = Camera.named("basler-acA2440-20gm-8mm")
UNCERTAINTY = PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.001)


@pytest.fixture(scope="module")
def judge():
    solid = two_pocket_block()
    wanted = entities()
    space = compute_regions(solid, wanted, workspace=default_workspace(solid, CAMERA))
    need = Requirements(showing=Detectability(separation_px=8.0, min_corner_deg=25.0))
    return Judge(Problem(space, space.entity_names, CAMERA, UNCERTAINTY, 0.97, 0.9, need))


@pytest.fixture(scope="module")
def poses(judge):
    return np.concatenate([entity_poses(judge, name, 12, 5) for name in judge.names])


def test_the_conditions_are_told_apart(judge, poses):
    """Or else what follows would say little: some edges have no corner, and of the others some are near to a line."""
    seen = judge._missed(poses) == 0.0
    corners = judge.constraints.image.corners(poses, seen)
    apart = judge.constraints.image.separations(poses, seen)
    assert (corners[seen] < 0).any()
    assert (apart[seen & (corners >= 0)] < 0).any()
    assert judge(poses).inspects.any()


@pytest.mark.parametrize("seed", range(4))
def test_what_is_worth_more_than_one_is_judged_as_without_prices(judge, poses, seed):
    rng = np.random.default_rng(seed)
    prices = rng.uniform(0.0, 0.9, len(judge.names)) * (rng.random(len(judge.names)) < 0.8)
    whole = judge(poses)
    priced = judge(poses, prices)
    worthy = whole.nearly @ prices > 1.0 + 1e-6
    assert worthy.any()
    assert not worthy.all()
    for name in ("inspects", "nearly"):
        assert np.array_equal(getattr(priced, name)[worthy], getattr(whole, name)[worthy])
        # no more than without, elsewhere
        assert not (getattr(priced, name) & ~getattr(whole, name)).any()
    told = whole.nearly & worthy[:, None]
    assert np.array_equal(priced.probability[told], whole.probability[told])
    assert np.array_equal(priced.promise, whole.promise)


def test_poses_show_all_if_every_edge_shows(judge, poses):
    some = judge.constraints.image
    for n in (10, len(poses)):
        wanted = np.ones((n, len(judge.names)), dtype=bool)
        assert np.array_equal(some.show_all(poses[:n]), some.shown(poses[:n], wanted).all(axis=1))
    few = Judge(judge.problem.restricted_to(judge.names[:3]))
    image = few.constraints.image
    expected = image.shown(poses, np.ones((len(poses), 3), dtype=bool)).all(axis=1)
    assert expected.any()
    assert np.array_equal(image.show_all(poses), expected)
