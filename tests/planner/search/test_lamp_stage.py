"""The stage that looks for lamps: what it leaves if it ends early, and if settings that stay in place lose a target."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from holed_plate import holed_plate
from lit_parts import block
from plan_examples import BRIEF, plan, setting

from aspectgraph import compute_light
from planner import (
    Camera,
    Detectability,
    LampDome,
    Lighting,
    LightPlan,
    PoseUncertainty,
    inspection,
    plan_inspection,
)
from planner.callbacks import Callbacks
from planner.inspection import shown_only
from planner.light.light_plan import LitImage
from planner.measuring.samples import circle_of
from planner.progress import TimeIsUpError
from planner.search import lit_poses, stages
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


def witnesses_of(plate):
    """A request for each rim of a plate, as `unlit_witnesses` asks for it."""
    targets = [SimpleNamespace(name=rim.id, geometry=(circle_of(rim),)) for rim in plate.rims()]
    return SimpleNamespace(
        space=SimpleNamespace(solid=plate), single=SimpleNamespace(targets=targets)
    )


def test_no_pose_is_searched_for_rims_that_no_lamp_lights():
    """Of a bore, lamps above light the lower rim's wall on one side at most, and its lower face never."""
    plate = holed_plate()
    upper = {rim.id for rim in plate.rims() if rim.centre[2] > plate.bounds[0][2] + 1.0}
    assert upper
    lower = {rim.id for rim in plate.rims()} - upper
    dome = LampDome((40.0, 25.0, 0.0), 400.0, 100.0)
    lighting = Lighting(dome)
    assert lit_poses.unlit_witnesses(witnesses_of(plate), lighting) == lower
    # whatever is left out shows under no lamp where its light is computed
    lamps = dome.places(300)
    light = compute_light(plate, {name: name for name in upper | lower}, contrast=0.1)
    shown = light.showing(lamps).any(axis=0)
    assert not shown[[name in lower for name in light.entity_names]].any()
    for other in (Lighting(dome, ground="bright"), Lighting("ring"), None):
        assert not lit_poses.unlit_witnesses(witnesses_of(plate), other)
    below = Lighting([(0.0, 0.0, -400.0), (80.0, 50.0, -400.0)])
    assert lit_poses.unlit_witnesses(witnesses_of(plate), below) == upper


# as high above the top of the block as in front of its face x = 0: both are equally bright
EVEN = (-400.0, 25.0, 460.0)


def test_a_plan_that_its_limit_ended_gets_other_poses_in_the_light(monkeypatch):
    """As one that ended by itself: a lamp shows the edge where one of its faces is seen alone."""

    def ended(run, incumbents, lighting):
        stages.run_stages(run, incumbents)
        raise TimeIsUpError

    monkeypatch.setattr(inspection, "run_stages", ended)

    def planned(seed, lamps):
        return plan_inspection(
            block(),
            {"left": [[0.0, 0, 60], [0, 50, 60]]},
            Camera.named("basler-acA2440-20gm-8mm"),
            PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.001),
            effort=BRIEF,
            showing=Detectability(0, 0, 0),
            lamps=lamps,
            rng=seed,
            time_limit_s=600.0,
        )

    dark = [seed for seed in range(6) if sees_both(planned(seed, None))]
    assert dark
    lit = [made for made in (planned(seed, [EVEN]) for seed in dark) if made.inspected]
    # few poses are drawn, and not always one in which the lamp shows it
    assert len(lit) >= len(dark) / 2
    for made in lit:
        assert made.unfinished
        assert made.light.complete
        assert made.settings[0].message == "pose in which a lamp shows it"


def sees_both(made):
    """Whether the camera of its one setting sees both faces that meet at the edge."""
    (one,) = made.settings
    return one.position[0] < 0 and one.position[2] > 60


def test_a_plan_stays_without_lamps_where_there_is_no_time_for_them(monkeypatch):
    def late(*_):
        raise TimeIsUpError

    monkeypatch.setattr(lit_poses, "chosen_lamps", late)
    draft = plan(settings=(setting((0.0, 0.0, 300.0), ["top front", "top right"]),))
    problem = SimpleNamespace(space=SimpleNamespace(solid=block()), reads=None)
    run = SimpleNamespace(problem=problem, callbacks=Callbacks(), executor=None)
    assert lit_poses.with_lamps_in_time(run, Lighting([EVEN]), draft, 0.0) is draft
