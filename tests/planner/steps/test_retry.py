"""Targets that are short of P_all are tried again: from other settings, from other columns, and alone."""

from dataclasses import replace

import numpy as np
import pytest
from grid_box import EDGES, BoxSpace
from plan_examples import request_with

from planner import Camera, PoseUncertainty, look_at
from planner.effort.effort import Effort, Support
from planner.request.request import Request
from planner.resume import PlanningState
from planner.search.plan_setting import setting_at
from planner.search.run import Run
from planner.search.settle import ShortTargets, _without_short
from planner.sensor_setting import Outcome, Reason, ReasonKind

CAMERA = Camera(8.0, (0.00345, 0.00345), (2448, 2048), 8.0, 400.0)
# two edges of the top that meet its front and its back
FRONT = "+z-y"
BACK = "+z+y"
NAMES = (FRONT, BACK)
SPACE = BoxSpace((120.0, 80.0, 60.0), [[-900.0] * 3, [1100.0] * 3], EDGES)
ABOVE = look_at([[60.0, 40.0, 460.0]], [60.0, 40.0, 60.0])[0]
# below the top, the edge at the back is hidden
BEFORE = look_at([[60.0, -390.0, 30.0]], [60.0, 0.0, 60.0])[0]


def run_of(sigma_mm=0.05, sigma_rad=0.001, **support):
    uncertainty = PoseUncertainty.isotropic(translation_mm=sigma_mm, rotation_rad=sigma_rad)
    request = Request(SPACE, NAMES, CAMERA, uncertainty, 0.98, 0.9)
    asked = request_with(seed=0, effort=Effort(support=Support(**support)))
    return Run(request, asked, PlanningState({}))


def stated(run, pose, p_all):
    made = setting_at(run.request, pose, tuple(p_all), "given")
    return replace(made, p_all=p_all, p_all_together=min(p_all.values()), p_all_poses=1000)


def centre(settings):
    """Move nothing; say what a count would say of these poses, where all is far from every limit."""
    return [
        replace(one, p_all=dict.fromkeys(one.entities, 0.99), p_all_together=0.99, p_all_poses=1000)
        for one in settings
    ]


def never(settings):
    raise AssertionError("no setting should be added")


def test_another_setting_measures_the_target_if_it_can():
    """From above, both edges are 120 mm long in a field of 400 mm, in the middle of the depth of field."""
    run = run_of()
    settled = _without_short(
        run, [stated(run, BEFORE, {BACK: 0.5}), stated(run, ABOVE, {FRONT: 0.99})], never
    )
    (only,) = settled.settings
    assert not settled.lost
    assert set(only.entities) == set(NAMES)
    assert (only.cam2world == ABOVE).all()
    assert min(only.p_all.values()) >= 0.9


def test_a_pose_of_another_column_is_added_for_it():
    """The setting that stays looks from below the top and sees no edge at the back; a column does."""
    run = run_of()
    both = np.array([[name in NAMES for name in run.names]])
    run.pool.add(both, ABOVE[None], np.ones((1, len(NAMES))))
    first = stated(run, BEFORE, {FRONT: 0.99})
    settled = _without_short(run, [replace(first), stated(run, BEFORE, {BACK: 0.5})], centre)
    assert not settled.lost
    kept, added = settled.settings
    assert kept.entities == (FRONT,)
    # what has its probability elsewhere is not measured twice
    assert added.entities == (BACK,)
    assert (added.cam2world == ABOVE).all()


def test_a_search_for_the_target_alone_is_the_last_try():
    run = run_of()
    run.memo.put((BACK,), Outcome(setting_at(run.request, ABOVE, (BACK,), "found alone")))
    settled = _without_short(
        run, [stated(run, BEFORE, {FRONT: 0.99}), stated(run, BEFORE, {BACK: 0.5})], centre
    )
    assert not settled.lost
    assert [one.entities for one in settled.settings] == [(FRONT,), (BACK,)]


def test_what_is_short_everywhere_is_lost_with_the_most_that_was_found():
    """Its own search finds a pose of P_all .8, more than the .5 of the plan: the reason states .8."""
    run = run_of()
    run.memo.put((BACK,), Outcome(setting_at(run.request, ABOVE, (BACK,), "found alone")))

    def short(settings):
        return [replace(one, p_all={BACK: 0.8}, p_all_poses=1000) for one in settings]

    kept = stated(run, BEFORE, {FRONT: 0.99})
    settled = _without_short(run, [kept, stated(run, BEFORE, {BACK: 0.5})], short)
    assert [one.entities for one in settled.settings] == [(FRONT,)]
    reason = settled.lost[BACK]
    assert reason.kind is ReasonKind.PROBABILITY_TOO_LOW
    assert "reaches P_all = 0.8000, below the required 0.9." in reason


def test_a_search_that_finds_nothing_leaves_the_reason_as_it_is():
    run = run_of()
    nothing = Reason.of(ReasonKind.UNOBSERVABLE, "nothing.")
    run.memo.put((BACK,), Outcome(reason=nothing))
    settled = _without_short(run, [stated(run, BEFORE, {BACK: 0.5})], never)
    assert settled.settings == []
    assert "reaches P_all = 0.5000" in settled.lost[BACK]


@pytest.mark.parametrize(("retried", "tries"), [(1, 1), (3, 3), (8, 5)])
def test_no_more_poses_are_simulated_than_the_effort_allows(retried, tries, monkeypatch):
    """Five columns contain the target and none is supported: each is tried once, up to the limit."""
    run = run_of(retried=retried)
    column = np.array([[name == BACK for name in run.names]])
    poses = [look_at([[60.0 + k, 40.0, 460.0]], [60.0, 40.0, 60.0])[0] for k in range(5)]
    run.pool.membership = np.repeat(column, 5, axis=0)
    run.pool.poses = np.array(poses)
    run.pool.quality = np.linspace(0.9, 0.99, 5)
    seen = []

    def contradicted(setting):
        seen.append(setting.cam2world[0, 3])
        return dict.fromkeys(setting.entities, 0.1)

    monkeypatch.setattr(run.promises, "contradicted_in", contradicted)
    short = ShortTargets(run, [], {BACK: 0.5}, never)
    assert short._other_columns() == []
    # the most probable first
    assert seen == [60.0 + k for k in (4, 3, 2, 1, 0)][:tries]
