"""The stage that looks for lamps: what it leaves if it ends early, and if settings that stay in place lose a target."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from plan_examples import plan, setting

from planner import LightPlan
from planner.callbacks import Callbacks
from planner.inspection import shown_only
from planner.light.light_plan import LitImage
from planner.search import stages
from planner.search.incumbents import Incumbents
from planner.sensor_setting import ReasonKind

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


def test_a_plan_states_only_what_its_light_shows():
    """Of three settings one is dark, one loses a target that another one shows; every lamp stays where it is."""
    shown = [(), (LitImage((0,), {"top front": 0.3}),), (LitImage((0,), {"bottom": 0.3}),)]
    dark = (
        {"top right": "in the shadow", "top front": "in the shadow"},
        {"top right": "too steep"},
        {"top front": "no contrast"},
    )
    light = replace(LIGHT, images=tuple(shown), unlit=dark)
    settings = (
        setting((0.0, 0.0, 300.0), ["top front", "top right"]),
        setting((0.0, 20.0, 300.0), ["top front", "top right"]),
        setting((0.0, 40.0, 300.0), ["top front", "bottom"]),
    )
    poses_only = plan(settings=settings, uninspectable={}, lower_bound=3, light=light)
    assert poses_only.unlit == ("top right",)
    made = shown_only(poses_only)
    assert [one.entities for one in made.settings] == [("top front",), ("bottom",)]
    assert [list(one.probability) for one in made.settings] == [["top front"], ["bottom"]]
    assert made.settings[0].fitness == made.settings[0].probability["top front"]
    assert made.light == replace(light, images=light.images[1:], unlit=({}, {}))
    assert made.uninspectable == {"top right": "not readable in the light: in the shadow"}
    assert made.uninspectable["top right"].kind is ReasonKind.NOT_SHOWN
    # three settings for three targets, so two for two of them
    assert (made.lower_bound, made.unlit, list(made.inspected)) == (2, (), ["top front", "bottom"])
    assert shown_only(poses_only, lambda names: len(names) - 1).lower_bound == 2
    assert shown_only(replace(poses_only, lower_bound=1)).lower_bound == 1
    proof = " Without 1 target that the light does not show, at least 2 of 3 remain."
    assert made.bound_proof == poses_only.bound_proof + proof
    assert shown_only(made) is made


def test_a_setting_that_adds_nothing_in_the_light_is_left_out():
    """Without what no lamp shows, the first setting measures what the second one does, too."""
    shown = (
        (LitImage((0,), {"top front": 0.3}),),
        (LitImage((0,), {"top front": 0.3, "bottom": 0.2}),),
    )
    light = replace(LIGHT, images=shown, unlit=(DARK, {}))
    settings = (
        setting((0.0, 0.0, 300.0), ["top front", "top right"]),
        setting((0.0, 20.0, 300.0), ["top front", "bottom"]),
    )
    made = shown_only(plan(settings=settings, uninspectable={}, light=light))
    assert [one.entities for one in made.settings] == [("top front", "bottom")]
    assert made.light.images == shown[1:]
