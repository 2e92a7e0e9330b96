"""Candidate poses that are good enough: no genetic algorithm for those, and what is stated still holds."""

from dataclasses import replace

import pytest
from box_requests import CAMERA, UNCERTAINTY, WORKSPACE
from grid_box import EDGES, BoxSpace

from planner.effort import Effort
from planner.inspection import plan_inspection
from planner.verify.simulate_plan import simulate_plan

SMALL = Effort(viewpoints=30, pricing_rounds=15, refutations=0, bound_nodes=1000)


@pytest.fixture(scope="module")
def searched():
    """For each preference, the plan, and how many columns the genetic algorithm improved."""
    space = BoxSpace((120.0, 80.0, 60.0), WORKSPACE, EDGES)

    def plan(enough):
        effort = replace(SMALL, good_enough=enough)
        runs = []

        def progress(done, total, label):
            if label == "genetic algorithm":
                runs.append(done)

        found = plan_inspection(
            space.solid,
            space.entities,
            CAMERA,
            UNCERTAINTY,
            space=space,
            rng=3,
            effort=effort,
            progress=progress,
        )
        return found, len(runs)

    return {enough: plan(enough) for enough in (0.0, 1.0)}


def test_only_candidates_that_are_not_enough_are_improved(searched):
    assert searched[0.0][1] == 0
    assert searched[1.0][1] >= len(searched[1.0][0].settings)


def test_plans_of_candidates_are_as_complete_and_hold_what_they_state(searched):
    plain, best = (searched[enough][0] for enough in (0.0, 1.0))
    assert plain.complete
    assert len(plain.settings) == len(best.settings)
    assert simulate_plan(plain, n=20_000, rng=5).confirmed
    assert min(p for setting in plain.settings for p in setting.p_all.values()) >= plain.probability


def test_boxes_fall_in_proportion_beyond_the_targets_they_are_for():
    quick = Effort.named("quick")
    most = quick.bound_targets
    assert quick.boxes_for(1) == quick.boxes_for(most) == quick.bound_nodes
    assert quick.boxes_for(3 * most) == pytest.approx(quick.bound_nodes / 3, abs=1)
    assert Effort().boxes_for(121) == Effort().bound_nodes
