"""A simulation that ends in time."""

from __future__ import annotations

import math
import time
from importlib import import_module

import pytest

from aspectgraph import read_solid
from planner import RequestError, read_plan, simulate_plan
from planner.progress import TimeLeft
from planner.verify.simulate_plan import NOT_COUNTED, NOT_SIMULATED, simulate_in_time

# the face has a function of the same name
in_time = import_module("planner.verify.simulate_plan")


@pytest.fixture(scope="module")
def block():
    return read_solid("examples/two_pocket_block.off")


@pytest.fixture(scope="module")
def plan():
    return read_plan("examples/two_pocket_block_plan.json")


@pytest.mark.parametrize("until", [math.inf, time.time() + 1e6], ids=["never", "late"])
def test_time_enough_changes_nothing(plan, block, until):
    found, notes = simulate_in_time(plan, 500, 3, None, block, TimeLeft(until))
    assert found == simulate_plan(plan, 500, 3, solid=block)
    assert notes == []


def test_without_time_there_is_no_simulation_and_the_reason_is_said(plan, block):
    found, notes = simulate_in_time(plan, 500, 3, None, block, TimeLeft(time.time() - 1.0))
    assert found is None
    assert notes == [NOT_SIMULATED]


def test_less_time_means_fewer_poses(plan, block, monkeypatch):
    monkeypatch.setattr(in_time, "_fitting", lambda *_: 300)
    found, notes = simulate_in_time(plan, 500, 3, None, block, TimeLeft(time.time() + 1e6))
    assert found.n == 300
    assert found == simulate_plan(plan, 300, 3, solid=block)
    (note,) = notes
    assert "used 300 instead of 500 displaced poses" in note
    assert "--time-limit" in note


def test_the_number_of_poses_follows_the_time(plan):
    """As many as fit, none where fewer than 200 would."""
    assert in_time._fitting(plan, 5000, 3, 1e6) == 5000
    assert in_time._fitting(plan, 5000, 3, 1e-9) == 0
    some = in_time._fitting(plan, 10**9, 3, 1.0)
    assert 200 <= some < 10**9
    assert some % 100 == 0


def test_what_the_images_have_no_time_for_is_said(plan, block, monkeypatch):
    """The clock passes the deadline while the settings are simulated."""
    monkeypatch.setattr(in_time, "_fitting", lambda *_: 500)
    ticks = iter([0.0, 0.0, 2.0])
    found, notes = simulate_in_time(plan, 500, 3, None, block, TimeLeft(1.0, lambda: next(ticks)))
    assert found == simulate_plan(plan, 500, 3)
    assert notes == [NOT_COUNTED]


def test_what_is_no_plan(block, plan):
    with pytest.raises(RequestError, match="plan must be an InspectionPlan"):
        simulate_plan(block, plan)
