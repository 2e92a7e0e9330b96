"""A time limit that ends the computation of visible regions: what is complete is planned, the rest is named."""

import numpy as np
import pytest

from aspectgraph import compute_regions, read_solid
from planner import Camera, Effort, PoseUncertainty, RequestError, plan_inspection
from planner.callbacks import Deadline
from planner.sensor_setting import ReasonKind

RIMS = {"e1": [[60, 20, 10], [60, 40, 10]], "e4": [[20, 60, 10], [40, 60, 10]]}
SMALL = Effort(viewpoints=10, pricing_rounds=2, refutations=1, bound_nodes=1000)


@pytest.fixture(scope="module")
def call():
    block = read_solid("examples/two_pocket_block.off")
    camera = Camera.named("basler-acA2440-20gm-8mm")
    uncertainty = PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.001)

    def plan(known, **options):
        space = compute_regions(block, {name: RIMS[name] for name in known})
        arguments = (block, RIMS, camera, uncertainty)
        return plan_inspection(*arguments, accuracy=0.95, effort=SMALL, space=space, **options)

    return plan


def test_a_target_without_a_region_is_left_out_with_the_reason(call, tmp_path):
    published = []
    state = tmp_path / "state.json"
    plan = call(["e1"], time_limit_s=1000.0, state=state, on_incumbent=published.append)
    assert plan.unfinished
    assert not plan.complete
    assert list(plan.uninspectable) == ["e4"]
    assert plan.uninspectable["e4"].kind is ReasonKind.NOT_FOUND_YET
    assert "time limit" in plan.uninspectable["e4"]
    assert list(plan.entities) == ["e1", "e4"]
    assert np.array_equal(plan.entities["e4"], RIMS["e4"])
    assert {name for setting in plan.settings for name in setting.entities} == {"e1"}
    # plans on the way say the same, and a search for some targets is not kept for all of them
    assert all("e4" in found.uninspectable and found.unfinished for found in published)
    assert not state.exists()


def test_without_a_limit_a_space_must_hold_all_targets(call):
    with pytest.raises(RequestError, match=r"space must hold all entities .* Got no 'e4'\."):
        call(["e1"])


def test_a_limit_that_leaves_no_target_is_named(call):
    with pytest.raises(RequestError, match=r"time_limit_s must be long enough .* Got 1000\."):
        call([], time_limit_s=1000.0)


def test_what_knows_only_the_rest_of_a_limit_states_the_whole(call):
    """The command line and a batch compute regions first, and pass on what is left."""
    rest = 0.001
    rule = r"time_limit_s must be long enough .* Got 8\."
    with pytest.raises(RequestError, match=rule), Deadline(8.0).stated_whole():
        call([], time_limit_s=rest)


@pytest.mark.parametrize("limit", [None, 8.0])
def test_other_errors_are_as_they_are(limit):
    with pytest.raises(RequestError, match=r"Got 2\.0\."), Deadline(limit).stated_whole():
        raise RequestError.of_rule("accuracy", "must be in (0, 1)", "2.0")
