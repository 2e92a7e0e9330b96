"""The stage that looks for lamps: what it leaves if it ends early, and if settings that stay in place lose a target."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from plan_examples import plan, setting

from planner import LightPlan
from planner.callbacks import Callbacks
from planner.search import stages
from planner.search.incumbents import Incumbents

DARK = {"top right": "in the shadow"}
LIGHT = LightPlan("placed", 0.1, 0.1, "dark", np.zeros((1, 3)), ((),), (DARK,), 1, "by hand")


@pytest.fixture
def stage():
    settled = plan(settings=(setting((0.0, 0.0, 300.0), ["top front", "top right"]),))
    state = SimpleNamespace(plan=settled, inspected=np.ones(2, dtype=bool), counted=(), bound=1)
    state.proof = "by hand"
    state.uninspectable = dict(settled.uninspectable)
    told = []
    incumbents = Incumbents(Callbacks(on_best=told.append))
    return state, SimpleNamespace(run=None, lighting=(), incumbents=incumbents), told


def test_a_search_for_lamps_that_is_ended_leaves_the_plan(stage, monkeypatch):
    state, tools, told = stage
    settled = state.plan

    def ended(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(stages, "with_lamps", ended)
    with pytest.raises(KeyboardInterrupt):
        stages._light(state, tools)
    assert [made.settings for made in told] == [settled.settings]
    assert told[0].unfinished


def test_settings_that_lose_a_target_where_they_are_not_moved_are_left(stage, monkeypatch):
    """Nothing is assembled from them: their plan would miss a target without a reason."""
    state, tools, _ = stage
    lit = replace(state.plan, light=LIGHT)
    assert lit.unlit == ("top right",)
    monkeypatch.setattr(stages, "with_lamps", lambda *_: lit)
    unmoved = stages.Settled([], {"top front": "too low"})
    monkeypatch.setattr(stages, "settle", lambda *_, **__: unmoved)
    stages._light(state, tools)
    assert state.plan is lit
