"""The stages of a plan: the state is kept after each, and a planning goes on with the stage that it names."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from grid_box import EDGES, BoxSpace

from planner import Camera, Effort, PoseUncertainty, callbacks, plan_inspection
from planner.callbacks import Callbacks, Deadline
from planner.files import encoded
from planner.plan_file import packed, unpacked
from planner.progress import TimeIsUpError
from planner.search import stages
from planner.search.candidates import Pools
from planner.search.run import PlanState, empty_pools
from planner.sensor_setting import Reason, ReasonKind

CAMERA = Camera(25.0, (0.00345, 0.00345), (2448, 2048), 8.0, 400.0)
UNCERTAINTY = PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.001)
SPACE = BoxSpace((120.0, 80.0, 60.0), [[-900.0] * 3, [1100.0] * 3], list(EDGES)[:3])


class Stop(Exception):
    pass


def plan(path=None):
    return plan_inspection(
        SPACE.solid,
        SPACE.entities,
        CAMERA,
        UNCERTAINTY,
        space=SPACE,
        effort=Effort(5, 2, 1, 300, 20),
        state=path,
    )


@pytest.fixture(scope="module")
def whole():
    return json.dumps(plan().to_dict())


def watched(monkeypatch, begun, stop_at=None):
    """Note which stages begin; stop in one of them."""

    def watched_stage(stage):
        def run(state, tools):
            begun.append(stage.name)
            stage.run(state, tools)
            if stage.name == stop_at:
                raise Stop

        return stage._replace(run=run)

    monkeypatch.setattr(stages, "STAGES", tuple(watched_stage(one) for one in stages.STAGES))


@pytest.mark.parametrize("k", range(len(stages.STAGES)))
def test_a_planning_goes_on_with_the_stage_that_its_state_names(k, whole, tmp_path, monkeypatch):
    path = tmp_path / "state.json"
    names = [stage.name for stage in stages.STAGES]
    begun = []
    with monkeypatch.context() as patch:
        watched(patch, begun, stop_at=names[k])
        with pytest.raises(Stop):
            plan(path)
    assert begun == names[: k + 1]
    assert json.loads(path.read_text())["checkpoint"]["stage"] == names[k]
    begun.clear()
    watched(monkeypatch, begun)
    assert json.dumps(plan(path).to_dict()) == whole
    assert begun == names[k:]


def test_a_state_packs_itself_whole():
    """What comes back from a file is what was packed, field by field."""
    pools = empty_pools(2)
    pools.realised.add(np.array([[True, False]]), np.eye(4)[None], np.array([[0.95, 0.0]]))
    weighing = empty_pools(2)
    weighing.near.add(np.array([[True, True]]), 2.0 * np.eye(4)[None], np.full((1, 2), 0.5))
    hidden = Reason.of(ReasonKind.NOT_FOUND_YET, "not yet.")
    state = PlanState(
        pools,
        stage="lower bound",
        entries={"proven": [2, "boxes"]},
        uninspectable={"b": hidden},
        incompatible=("a", "b"),
        weighing=weighing,
        inspected=np.array([True, False]),
        known=3,
        joined=1,
        bound=2,
        proof="by hand",
        plan=plan(),
    )
    text = json.dumps(encoded(packed(state.pack())), allow_nan=False)
    again = PlanState.unpack(unpacked(json.loads(text)))
    for name in ("stage", "entries", "uninspectable", "incompatible", "known", "joined", "bound"):
        assert getattr(again, name) == getattr(state, name)
    assert again.uninspectable["b"].kind is ReasonKind.NOT_FOUND_YET
    assert again.proof == "by hand"
    assert again.plan == state.plan
    assert np.array_equal(again.inspected, state.inspected)
    for first, second in ((state.pools, again.pools), (state.weighing, again.weighing)):
        for name in Pools._fields:
            one = getattr(first, name).to_dict()
            other = getattr(second, name).to_dict()
            assert all(np.array_equal(one[key], other[key]) for key in one)


def test_callbacks_pass_everything_on_and_end_the_work():
    calls = []
    heard = Callbacks(
        on_stage=lambda name: calls.append(("stage", name)),
        on_best=lambda found: calls.append(("best", found)),
        on_bound=lambda bound, weights: calls.append(("bound", bound)),
        progress=lambda done, total, label: calls.append((label, done, total)),
        deadline=Deadline(time_limit_s=1e-9),
    )
    heard.stage("lamps")
    heard.best("plan")
    heard.bound(3)
    heard.report(1, 2, "work")
    heard.silent.report(1, 2, "other work")
    assert calls == [("stage", "lamps"), ("best", "plan"), ("bound", 3), ("work", 1, 2)]
    # the time is up as soon as there is something to end with
    heard.deadline.arm()
    with pytest.raises(TimeIsUpError):
        heard.silent.report(2, 2, "other work")
    assert heard.wants_plans
    nobody = Callbacks()
    nobody.stage("lamps")
    nobody.best("plan")
    nobody.bound(3)
    nobody.report(1, 2, "work")
    assert not nobody.wants_plans
    assert nobody.check is None


def test_every_stage_and_bound_is_passed_on(whole):
    from planner.inspection import _request
    from planner.options import InspectionOptions
    from planner.resolve_request import resolve_request
    from planner.resume import PlanningState
    from planner.search.incumbents import Incumbents
    from planner.search.run import Run

    options = InspectionOptions(space=SPACE, effort=Effort(5, 2, 1, 300, 20))
    resolved = resolve_request(SPACE.solid, SPACE.entities, CAMERA, UNCERTAINTY, options)
    names = []
    bounds = []
    callbacks = Callbacks(
        on_stage=names.append, on_bound=lambda bound, weights: bounds.append(bound)
    )
    request = _request(SPACE.solid, resolved, options, Deadline())
    memo = PlanningState(resolved.request.identity())
    run = Run(request, resolved.request, memo, callbacks=callbacks)
    found = stages.run_stages(run, Incumbents(callbacks))
    assert json.dumps(found.to_dict()) == whole
    assert names == [stage.name for stage in stages.STAGES]
    assert max(bounds) == found.lower_bound


def test_a_first_plan_is_something_to_end_with_only_some_seconds_later(monkeypatch):
    """A better one may come at once; the limit counts from when the program began."""
    clock = [1000.0]
    monkeypatch.setattr(callbacks.time, "monotonic", lambda: clock[0])
    deadline = Deadline(time_limit_s=3.0, begun=996.0)
    deadline.check()
    deadline.arm_soon()
    clock[0] += callbacks.LEAST_SEARCH_S - 0.1
    deadline.arm_soon()
    deadline.check()
    clock[0] += 0.2
    with pytest.raises(TimeIsUpError):
        deadline.check()
    patient = Deadline(time_limit_s=100.0, begun=996.0)
    patient.arm()
    patient.check()


def test_work_that_comes_late_has_half_of_what_is_left(monkeypatch):
    clock = [50.0]
    monkeypatch.setattr(callbacks.time, "monotonic", lambda: clock[0])
    monkeypatch.setattr(callbacks.time, "time", lambda: clock[0] + 7000.0)
    deadline = Deadline(time_limit_s=100.0, begun=50.0)
    assert deadline.time_left(0.8).until == pytest.approx(7130.0)
    clock[0] = 140.0
    assert deadline.time_left(0.8).until == pytest.approx(7145.0)
    assert deadline.time_left(0.8, least_s=9.0).until == pytest.approx(7149.0)
    assert Deadline().time_left(0.8).until == math.inf
