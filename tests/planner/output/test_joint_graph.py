"""The joint graph beside a plan: where it can be afforded, and what is said where it cannot."""

import re

import numpy as np
import pytest

from aspectgraph import compute_regions, read_solid, resolve_entities
from planner import read_plan
from planner.report import plan_folder
from planner.report.plan_folder import FEW_GRAPH_ENTITIES, _joint_graph


@pytest.fixture(scope="module")
def regions():
    solid = read_solid("examples/two_pocket_block.off")
    entities = resolve_entities(solid, {f"e{k}": k for k in range(FEW_GRAPH_ENTITIES + 2)})
    return compute_regions(solid, entities)


def test_of_many_entities_it_is_there_where_it_can_be_afforded(regions):
    graph, notes = _joint_graph(regions, None)
    assert graph.entity_names == regions.entity_names
    assert notes == []


def test_else_the_regions_are_summed_up(regions, monkeypatch):
    monkeypatch.setattr(plan_folder, "AFFORDABLE_BYTES", 1)
    graph, notes = _joint_graph(regions, None)
    assert graph is None
    assert "--graph-limit 26 builds it anyway" in notes[0]
    low, high = regions.workspace
    # drawn with another seed: a share of 10,000 is known to 1.5 %, three standard deviations
    seen = regions.observable(np.random.default_rng(1).uniform(low, high, (10_000, 3)))
    numbers = [float(one) / 100 for one in re.findall(r"([\d.]+) %", notes[1])]
    shares = seen.mean(axis=0)
    assert numbers == pytest.approx([shares.min(), shares.max(), shares.mean()], abs=0.02)
    assert f"more than {seen.sum(axis=1).max()} of the 26 entities." in notes[1]


def test_a_limit_that_is_given_is_kept(regions):
    graph, notes = _joint_graph(regions, 25)
    assert graph is None
    assert "the limit is 25; --graph-limit changes it" in notes[0]


def test_a_deadline_ends_it_between_two_entities(regions, monkeypatch):
    """The clock goes on by a second with every look, which is one for every entity."""
    seconds = iter(range(1000))
    monkeypatch.setattr(plan_folder.time, "time", lambda: float(next(seconds)))
    seen = []
    ended = plan_folder._ended_at(3.0, lambda done, total, label: seen.append(done))
    graph, notes = _joint_graph(regions, None, ended)
    assert graph is None
    assert notes == ["graph.graphml was not written: the time limit ended before it was complete."]
    assert 1 < len(seen) < len(regions.entity_names)


def test_a_report_of_targets_whose_regions_were_late(regions):
    """The report shows what is known; the other targets are in its list with their reason."""
    plan = read_plan("examples/two_pocket_block_plan.json")
    names = list(plan.entities)
    solid = read_solid("examples/two_pocket_block.off")
    known = compute_regions(solid, {names[0]: plan.entities[names[0]]}, workspace=plan.workspace)
    space = plan_folder._space(plan, known)
    assert list(space.entity_names) == names[:1]
