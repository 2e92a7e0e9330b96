"""The best plan so far: told of as it gets better, returned when the time is up, and without influence on the end."""

import itertools
import json
import math

import numpy as np
import pytest
from grid_box import EDGES, BoxSpace

from planner import Camera, PoseUncertainty
from planner.effort import Effort
from planner.exceptions import RequestError
from planner.inspection import plan_inspection
from planner.plan import InspectionPlan, read_plan
from planner.report.tables import nearest_limits

# a narrow field of view, so that there is something to improve and to prove
CAMERA = Camera(25.0, (0.00345, 0.00345), (2448, 2048), 8.0, 400.0)
UNCERTAINTY = PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.001)
NAMES = list(EDGES)[:8]
EFFORT = Effort(viewpoints=6, pricing_rounds=15, refutations=2, bound_nodes=20_000)


@pytest.fixture(scope="module")
def space():
    return BoxSpace((120.0, 80.0, 60.0), [[-900.0] * 3, [1100.0] * 3], NAMES)


def plan_box(space, **options):
    options = {"effort": EFFORT, "rng": 3, **options}
    return plan_inspection(space.solid, space.entities, CAMERA, UNCERTAINTY, space=space, **options)


@pytest.fixture(scope="module")
def whole(space):
    """The plan, and all that was told of on the way."""
    told = []
    return plan_box(space, on_incumbent=told.append), told


def exact(plan):
    return json.dumps(plan.to_dict())


def test_a_plan_that_is_watched_is_the_plan(space, whole):
    assert exact(plan_box(space)) == exact(whole[0])


def test_incumbents_get_better(whole):
    plan, told = whole
    assert len(told) > 3
    assert told[-1] is plan
    for earlier, later in itertools.pairwise(told[:-1]):
        worth = [
            (len(one.inspected), -len(one.settings), one.lower_bound) for one in (earlier, later)
        ]
        assert worth[0] < worth[1]
    assert len(told[0].inspected) < len(plan.inspected) or len(told[0].settings) > len(
        plan.settings
    )
    assert {one.lower_bound for one in told} > {1}


def test_entities_that_exclude_each_other_prove_a_bound_before_the_search_for_one(whole):
    plan, told = whole
    early = next(one for one in told if one.lower_bound > 1)
    assert early.unfinished
    assert early.bound_proof.startswith(
        f"Of {early.lower_bound} edges no two can be inspected together"
    )
    assert len(early.settings) > len(plan.settings)


def test_incumbents_keep_what_they_promise(whole):
    for k, plan in enumerate(whole[1]):
        # a glance may miss some
        assert plan.complete or k <= 1
        assert len(plan.inspected) + len(plan.uninspectable) == len(NAMES)
        assert plan.unfinished == (plan is not whole[0])
        assert min(plan.inspected.values()) >= plan.probability
        assert plan.lower_bound <= len(whole[0].settings)
        simulation = plan.simulate(4000, rng=17)
        assert not simulation.verdicts["contradicted"]


def is_moved(plan, best):
    """Whether a plan is the best one so far, but for the margins of its poses."""
    same = [one.entities for one in plan.settings] == [one.entities for one in best.settings]
    return (
        same
        and plan.lower_bound == best.lower_bound
        and min(least_shares(plan)) >= min(least_shares(best))
    )


def least_shares(plan):
    return [nearest_limits(plan, one)[0].share for one in plan.settings]


def test_when_the_time_is_up_the_best_plan_so_far_is_returned_and_the_state_goes_on(
    space, whole, tmp_path
):
    told = []
    state = tmp_path / "state.json"
    plan = plan_box(space, time_limit_s=1e-9, on_incumbent=told.append, state=state)
    assert plan.unfinished
    assert plan.complete
    # a glance is no plan to end with
    *before, last = told
    assert 1 <= len(before) < len(whole[1])
    assert [exact(one) for one in before] == [exact(one) for one in whole[1][: len(before)]]
    assert exact(plan) == exact(last)
    assert is_moved(plan, before[-1])
    plan.write(tmp_path / "plan.json")
    assert read_plan(tmp_path / "plan.json") == plan
    assert exact(plan_box(space, state=state)) == exact(whole[0])


def test_the_time_is_up_while_others_work(space, whole):
    from concurrent.futures import ThreadPoolExecutor

    with ThreadPoolExecutor(2) as executor:
        plan = plan_box(space, time_limit_s=1e-9, executor=executor)
    assert plan.unfinished
    assert plan.complete
    assert any(is_moved(plan, one) for one in whole[1])


def test_time_enough_changes_nothing(space, whole):
    assert exact(plan_box(space, time_limit_s=3600)) == exact(whole[0])


@pytest.mark.parametrize("gap", [0.3, 0.6, 0.9])
def test_a_gap_is_reached_and_not_more_is_proven(space, whole, gap):
    plan = plan_box(space, gap=gap)
    n = len(plan.settings)
    assert not plan.unfinished
    assert plan.complete
    # as good as asked for, or as good as it gets
    assert plan.gap <= gap or plan.lower_bound == whole[0].lower_bound
    # what entities that exclude each other prove is known before
    assert plan.lower_bound <= max(math.ceil(n * (1 - gap)), whole[1][1].lower_bound)
    assert plan.gap == pytest.approx((n - plan.lower_bound) / n)


def test_an_error_of_the_listener_ends_the_work(space):
    class Enough(Exception):
        pass

    def listener(plan):
        assert isinstance(plan, InspectionPlan)
        raise Enough

    with pytest.raises(Enough):
        plan_box(space, on_incumbent=listener)


def test_what_has_no_view_yet_is_said_to_have_none_yet(space, monkeypatch):
    """One entity gets no candidate poses, so its own run finds the first."""
    from planner.search import incumbents
    from planner.search import stages as find_columns

    monkeypatch.setattr(incumbents, "first_poses", lambda *_: np.zeros((0, 4, 4)))
    drawn = find_columns.judged_poses

    def without_one(shared, name, n_viewpoints, seed):
        return drawn(shared, NAMES[1], n_viewpoints, seed)

    monkeypatch.setattr(find_columns, "judged_poses", without_one)
    told = []
    plan = plan_box(space, on_incumbent=told.append)
    assert plan.complete
    first = told[0]
    assert first.uninspectable
    assert set(first.uninspectable.values()) == {"no view found yet: planning stopped early."}
    assert first.lower_bound == 1


@pytest.mark.parametrize("limit", [0, -1.0, math.nan, math.inf, True, "10"])
def test_a_limit_is_a_positive_number_of_seconds(space, limit):
    with pytest.raises(RequestError, match="time_limit_s must be a positive number of seconds"):
        plan_box(space, time_limit_s=limit)


@pytest.mark.parametrize("gap", [1, -0.1, math.nan, True, "0.2", None])
def test_a_gap_is_a_share(space, gap):
    with pytest.raises(RequestError, match=r"gap must be in \[0, 1\)"):
        plan_box(space, gap=gap)


def test_efforts_have_names():
    assert Effort.named("standard") == Effort()
    quick = Effort.named("quick")
    thorough = Effort.named("thorough")
    assert quick.bound_nodes < Effort().bound_nodes < thorough.bound_nodes
    with pytest.raises(
        RequestError, match=r"effort must be one of quick, standard, thorough\. Got 'slow'"
    ):
        Effort.named("slow")
