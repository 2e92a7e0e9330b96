"""Settings in which a lamp shows what they measure."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from lit_parts import block
from plan_examples import plan, setting

from aspectgraph import LightError, compute_regions
from planner import (
    Camera,
    Detectability,
    Effort,
    LampBox,
    Lighting,
    PoseUncertainty,
    plan_inspection,
    plan_light,
)
from planner.identity import plain_value
from planner.light.light_plan import LightPlan
from planner.request.defaults import default_workspace
from planner.search import plan_setting as pose_setting
from planner.search import stages as module

# between the top, z = 60, and the face x = 0
LEFT = {"left": [[0.0, 0, 60], [0, 50, 60]]}
# as high above the top as in front of the face: both are equally bright, so from where both are seen, nothing shows
EVEN = (-400.0, 25.0, 460.0)
CAMERA = Camera.named("basler-acA2440-20gm-8mm")
HOW = {
    "accuracy": 0.98,
    "effort": Effort(viewpoints=10, pricing_rounds=2, refutations=1, bound_nodes=1000),
    "showing": Detectability(0, 0, 0),
}
UNCERTAINTY = PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.001)


def planned(**more):
    return plan_inspection(block(), LEFT, CAMERA, UNCERTAINTY, **HOW, **more)


def sees_both(found):
    (one,) = found.settings
    return one.position[0] < 0 and one.position[2] > 60


def test_a_pose_is_found_from_which_the_lamp_shows_an_edge():
    """Beside the ground, which is dark, one face alone shows; both faces do not differ."""
    seed = next(seed for seed in range(20) if sees_both(planned(rng=seed)))
    dark = plan_light(planned(rng=seed), block(), [EVEN])
    assert not dark.complete
    found = planned(rng=seed, lamps=[EVEN])
    assert found.complete
    assert found.light.complete
    assert not sees_both(found)
    assert (found.lower_bound, len(found.settings)) == (1, 1)
    assert found.settings[0].message == "pose in which a lamp shows it"
    # nothing changes where all shows anyway
    above = planned(rng=seed, lamps=[(200.0, 25.0, 900.0)])
    assert above.settings == planned(rng=seed).settings
    assert above.light == plan_light(above, block(), [(200.0, 25.0, 900.0)])


def test_what_is_shown_from_nowhere_stays_measured():
    """Below the part, a lamp shows neither the top nor, from behind the face, that one."""
    found = planned(lamps=[(200.0, 25.0, -300.0)])
    assert found.complete
    assert list(found.light.unlit[0]) == ["left"]


def test_a_ring_light_needs_no_space_of_its_own():
    found = planned(lamps="ring")
    assert found.light.kind == "ring"
    assert found.light.complete


def _contrast_of_a_ring(plan):
    """Between the top and the face x = 0, by the heights of the camera over them; 1 if it sees one face only."""
    x, _, z = plan.settings[0].position
    top = max(z - 60, 0)
    left = max(-x, 0)
    return abs(top - left) / (top + left)


def test_what_the_ring_does_not_show_is_looked_for_from_other_poses():
    """Where all viewpoints are taken, the first pose may see both faces at angles that hardly differ."""
    space = compute_regions(block(), LEFT, workspace=default_workspace(block(), CAMERA))
    lighting = Lighting("ring", contrast=0.8)
    drafts = {seed: planned(space=space, rng=seed) for seed in range(8)}
    seed = next(seed for seed, one in drafts.items() if _contrast_of_a_ring(one) < 0.8)
    assert not plan_light(drafts[seed], block(), "ring", contrast=0.8).complete
    found = planned(space=space, rng=seed, lamps=lighting)
    assert found.light.complete
    (one,) = found.settings
    assert one.message == "pose in which a lamp shows it"
    assert _contrast_of_a_ring(found) >= 0.8
    assert found.light.lamps.tolist() == [one.position.tolist()]


def test_lamps_are_part_of_what_a_state_belongs_to(tmp_path):
    state = tmp_path / "state.json"
    first = planned(lamps=[EVEN], state=state)
    assert planned(lamps=Lighting([EVEN]), state=state) == first
    with pytest.raises(Exception, match=r"contrast was 0\.1 and is now 0\.2"):
        planned(lamps=Lighting([EVEN], contrast=0.2), state=state)
    with pytest.raises(Exception, match="lamps changed"):
        planned(state=state)


def test_a_lamp_inside_the_part_is_refused_before_any_work():
    with pytest.raises(LightError, match="inside"):
        planned(lamps=[(40.0, 25.0, 30.0)], progress=lambda *_: pytest.fail("work was done"))


def test_a_setting_does_not_measure_what_only_another_one_shows(monkeypatch):
    settings = setting((0.0, 0.0, 300.0), ["left", "right"]), setting((50.0, 0.0, 300.0), ["left"])
    light = LightPlan(
        "fixed", 0.1, 0.1, "dark", [EVEN], ((), ()), ({"left": "dark", "right": "dark"}, {}), 1
    )
    two = replace(
        plan(settings=settings, uninspectable={}, entities={**LEFT, "right": LEFT["left"]}),
        light=light,
    )
    monkeypatch.setattr(
        pose_setting, "setting_at", lambda _, pose, names, *args, **how: setting(pose[:3, 3], names)
    )
    run = SimpleNamespace(problem=None, names=["left", "right"])
    # what nothing shows is measured where it was
    assert [one.entities for one in module._chosen_among(run, two, [])] == [("right",), ("left",)]


def test_lighting_tells_what_is_asked():
    assert repr(Lighting(LampBox((0, 0, 0), (1, 1, 1)), 0.2)).startswith(
        "<Lighting by the box of lamps: contrast 0.2"
    )
    assert plain_value(Lighting([EVEN])) == plain_value(Lighting(np.array([EVEN])))
    assert plain_value(Lighting([EVEN])) != plain_value(Lighting([EVEN], step=0.3))
