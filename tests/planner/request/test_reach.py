"""Visibility asked for pairs of viewpoint and target is the same as asked for one target after the other."""

from __future__ import annotations

import numpy as np
import pytest

from aspectgraph import compute_regions, graph_of, read_solid
from planner.request.reach import Seen, TargetSpace, visibility_slacks, visible_where

NAMES = ("e1", "e4", "both")


def _targets(space):
    ends = np.zeros((2, 3))
    one = {name: Seen([[name]], ends) for name in ("e1", "e4")}
    # seen where the first edge is, or where the other two are together
    return TargetSpace(space, {**one, "both": Seen([["e1"], ["e4", "e2"]], ends)})


@pytest.fixture(scope="module")
def spaces():
    block = read_solid("examples/two_pocket_block.off")
    edges = {
        "e1": [[60, 20, 10], [60, 40, 10]],
        "e2": [[60, 20, 10], [60, 20, 30]],
        "e4": [[20, 60, 10], [40, 60, 10]],
    }
    regions = compute_regions(block, edges, workspace=[[-300.0] * 3, [400.0] * 3])
    return {"regions": _targets(regions), "graph": _targets(graph_of(regions))}


@pytest.mark.parametrize("kind", ["regions", "graph"])
@pytest.mark.parametrize("names", [("e4", "e1"), NAMES])
@pytest.mark.parametrize("radius_mm", [0.0, 8.0])
def test_pairs_are_answered_as_columns_are(spaces, kind, names, radius_mm):
    rng = np.random.default_rng(4)
    # some lie outside the workspace
    positions = rng.uniform(-330.0, 430.0, (300, 3))
    wanted = rng.random((300, len(names))) < 0.4
    found = visible_where(spaces[kind], positions, names, wanted, radius_mm)
    for k, name in enumerate(names):
        alone = visibility_slacks(spaces[kind], positions, [name], radius_mm)[:, 0, 0] > 0
        assert 0 < alone.sum() < len(alone)
        assert np.array_equal(found[:, k], alone & wanted[:, k])


def test_nothing_wanted_is_nothing_seen(spaces):
    positions = np.zeros((4, 3)) + 200.0
    assert not visible_where(spaces["regions"], positions, NAMES, np.zeros((4, 3), bool), 1.0).any()


class HalfLit:
    """A space that is dark in half of its regions, and does not answer for the points around a viewpoint."""

    def __init__(self, space):
        self.regions = space.space
        self.workspace = space.workspace
        self.asked = 0

    @property
    def nearby(self):
        return self.regions

    def observable(self, points, names):
        self.asked += len(points)
        return self.regions.observable(points, names) & (points[:, :1] > 50.0)


@pytest.mark.parametrize("count", [20, 300])
def test_points_around_a_viewpoint_are_asked_of_the_space_nearby(spaces, count):
    lit = HalfLit(spaces["regions"])
    targets = TargetSpace(lit, spaces["regions"].entities)
    positions = np.random.default_rng(6).uniform(-290.0, 390.0, (count, 3))
    shown = visibility_slacks(targets, positions, NAMES, 8.0)[..., 0] > 0
    assert lit.asked == count
    visible = visibility_slacks(spaces["regions"], positions, NAMES, 8.0)[..., 0] > 0
    assert np.array_equal(shown, visible & (positions[:, :1] > 50.0))
    wanted = np.ones_like(shown)
    assert np.array_equal(visible_where(targets, positions, NAMES, wanted, 8.0), shown)
    # of pairs, one target is asked after the other
    assert lit.asked == (1 + len(NAMES)) * count
