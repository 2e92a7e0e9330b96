"""Regions that are not complete by a deadline are left out; the others are what they are without one."""

import numpy as np
import pytest

from aspectgraph import compute_light, compute_regions, read_solid
from aspectgraph.visibility import scene as clock

pytestmark = pytest.mark.uncompiled

EDGES = {"e1": [[60, 20, 10], [60, 40, 10]], "e4": [[20, 60, 10], [40, 60, 10]]}
BOX = [[-200.0, -200, -200], [200, 200, 200]]


@pytest.fixture
def block(request):
    return read_solid(request.config.rootpath / "examples/two_pocket_block.off")


@pytest.fixture
def passing_time(monkeypatch):
    """A clock that goes on by a second with every look."""
    seconds = iter(range(10_000))
    monkeypatch.setattr(clock.time, "time", lambda: float(next(seconds)))


@pytest.mark.parametrize("compute", [compute_regions, compute_light])
def test_after_the_deadline_nothing_is_computed(block, compute):
    regions = compute(block, EDGES, workspace=BOX, deadline=0.0)
    assert regions.entity_names == ()
    assert regions.observable([[0, 0, 100]]).shape == (1, 0)


def test_what_is_complete_by_the_deadline_is_kept(block, passing_time):
    """The first edge takes two looks at the clock: before its chord, and before its sets."""
    regions = compute_regions(block, EDGES, BOX, deadline=1.0)
    assert regions.entity_names == ("e1",)
    points = np.random.default_rng(1).uniform(*BOX, (500, 3))
    whole = compute_regions(block, EDGES, BOX)
    assert np.array_equal(regions.observable(points)[:, 0], whole.observable(points)[:, 0])


def test_a_region_is_ended_between_its_sets(block, monkeypatch):
    """With one set between two looks, the end comes within the first region, and cells do not depend on it."""
    whole = compute_regions(block, EDGES, BOX)
    monkeypatch.setattr("aspectgraph.visibility.entity_region._SETS_AT_A_TIME", 1)
    same = compute_regions(block, EDGES, BOX)
    for name in EDGES:
        for ours, theirs in zip(same._regions[name].tree, whole._regions[name].tree, strict=True):
            assert np.array_equal(ours, theirs)
    seconds = iter(range(10_000))
    monkeypatch.setattr(clock.time, "time", lambda: float(next(seconds)))
    assert compute_regions(block, EDGES, BOX, deadline=2.0).entity_names == ()
