"""What a run keeps and knows: bounds by what excludes each other, checkpoints, what simulation says of a promise."""

from __future__ import annotations

import gc
import json
import math
import pickle
import tempfile
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from box_requests import CAMERA, UNCERTAINTY, WORKSPACE
from grid_box import EDGES, BoxSpace
from plan_examples import BRIEF, request_with
from scipy.stats import binom

from aspectgraph import compute_regions, read_solid
from planner import (
    Camera,
    Effort,
    PoseUncertainty,
    RequestError,
    callbacks,
    look_at,
    plan_inspection,
)
from planner.callbacks import NOBODY, Callbacks, Deadline
from planner.files import encoded
from planner.plan_file import packed, unpacked
from planner.progress import TimeIsUpError
from planner.request.problem import Problem
from planner.resume import PlanningState
from planner.search import lit_poses, stages
from planner.search import stages as prove_bound
from planner.search import stages as settle
from planner.search.columns import ColumnPool, Pools
from planner.search.incumbents import Incumbents, PlanState, SearchRun, empty_pools
from planner.search.plan_setting import setting_at
from planner.search.realise_column import joint_bounds
from planner.search.stages import ShortTargets, _without_short, without_spare
from planner.sensor_setting import Outcome, Reason, ReasonKind
from planner.verify.joint_counts import JointCounts
from planner.verify.simulate_plan import simulate_plan

CAMERA_ROUNDS = Camera(25.0, (0.00345, 0.00345), (2448, 2048), 8.0, 400.0)
UNCERTAINTY_ROUNDS = PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.001)
NAMES = list(EDGES)[:4]
SPACE = BoxSpace((120.0, 80.0, 60.0), [[-900.0] * 3, [1100.0] * 3], NAMES)


def run_with(columns):
    """A run whose pool has these sets of entities, each from some pose."""
    request = Problem(SPACE, tuple(NAMES), CAMERA_ROUNDS, UNCERTAINTY_ROUNDS, 0.98, 0.9)
    asked = request_with(seed=0, effort=Effort(viewpoints=1, pricing_rounds=3, cover_nodes=50))
    run = SearchRun(request, asked, PlanningState({}))
    membership = np.array(columns, dtype=bool)
    run.pool.add(membership, np.tile(np.eye(4), (len(columns), 1, 1)), np.ones(membership.shape))
    return run


def unwatched():
    return Incumbents(NOBODY)


def test_what_excludes_each_other_is_a_bound_without_a_search(monkeypatch):
    """Of a plan of 4 settings 3 are proven so, and the search comes to 2, or to 4."""
    found = [2]
    monkeypatch.setattr(
        prove_bound, "lower_bound", lambda *given, **how: (found[0], "by search", None)
    )
    run = run_with(np.eye(4))
    run.state.incompatible = tuple(NAMES[:3])
    found_bound = prove_bound.prove_bound(run, unwatched())
    assert found_bound.n == 3
    assert found_bound.proof.startswith("Of 3 edges no two can be inspected together")
    found[0] = 4
    run.save({})
    again = prove_bound.prove_bound(run, unwatched())
    assert (again.n, again.proof) == (4, "by search")


def test_where_that_is_all_there_is_to_prove_nothing_is_searched(monkeypatch):
    monkeypatch.setattr(prove_bound, "lower_bound", None)
    run = run_with(np.eye(4))
    run.state.incompatible = tuple(NAMES)
    assert prove_bound.prove_bound(run, unwatched()).n == 4
    # what is resumed there knows it
    assert prove_bound.prove_bound(run, unwatched()).n == 4


def test_of_what_is_not_inspected_nothing_is_proven(monkeypatch):
    monkeypatch.setattr(prove_bound, "lower_bound", lambda *given, **how: (1, "by search", None))
    run = run_with([[1, 1, 0, 0], [0, 0, 1, 0]])
    run.state.incompatible = tuple(NAMES[1:])
    one = prove_bound.prove_bound(run, unwatched())
    assert (one.n, one.proof) == (1, "by search")


def test_a_checkpoint_tells_what_excludes_each_other():
    run = run_with(np.eye(4))
    run.state.incompatible = tuple(NAMES[:2])
    run.save({"done": 3})
    other = PlanState.unpack(run.memo.last())
    assert other.entries == {"done": 3}
    assert other.incompatible == tuple(NAMES[:2])
    assert np.array_equal(other.pools.realised.membership, run.pool.membership)


def test_what_simulation_says_of_a_promise_does_not_depend_on_the_others(monkeypatch):
    """A run that is watched simulates more, and must end the same: dimensions take draws of their own, each alone."""
    asked = []

    def too_much(judge, setting, seed):
        asked.append(setting.entities)
        return {name: 0.1 for name in setting.entities if name == NAMES[2]}

    monkeypatch.setattr("planner.search.realise_column.promised_too_much", too_much)
    monkeypatch.setattr(
        "planner.search.realise_column.joint_bounds", lambda judge, pose, names, seed: {}
    )
    run = run_with(np.eye(4))
    in_image = dict(zip(NAMES, [True, False, True, False], strict=True))
    run.judge.problem = SimpleNamespace(
        find_target=lambda name: SimpleNamespace(in_image=in_image[name])
    )
    setting = SimpleNamespace(
        cam2world=np.eye(4), entities=tuple(NAMES), probability=dict.fromkeys(NAMES, 0.95)
    )
    assert run.promises.contradicted_in(setting) == {NAMES[2]: 0.1}
    assert asked == [(NAMES[0], NAMES[2]), (NAMES[1],), (NAMES[3],)]
    # known by now, with fewer stated, too; another promise is asked for
    fewer = SimpleNamespace(cam2world=np.eye(4), entities=(NAMES[2],), probability={NAMES[2]: 0.95})
    other = SimpleNamespace(cam2world=np.eye(4), entities=(NAMES[2],), probability={NAMES[2]: 0.9})
    assert run.promises.contradicted_in(fewer) == {NAMES[2]: 0.1}
    assert len(asked) == 3
    assert run.promises.contradicted_in(other) == {NAMES[2]: 0.1}
    assert asked[3:] == [(NAMES[2],)]


def test_a_count_goes_on_until_a_look_decides_and_only_the_last_part_may_end_early(monkeypatch):
    """A count that ends early states too much of others: no later one would mend what it said of them."""
    asked = []
    # the first is sure at once, the second is sure after 4000, the third never, the fourth is surely too low
    share = {"sure": 1.0, "later": 0.962, "open": 0.951, "low": 0.8}

    class Counted:
        def __init__(self, problem, names):
            self.names = tuple(names)

        def count(self, cam2world, n, seed, needed):
            asked.append((self.names, n, seed, needed))
            hits = tuple(round(share[name] * n) for name in self.names)
            return JointCounts(self.names, n, hits, min(hits), {})

    monkeypatch.setattr("planner.search.realise_column.DisplacedChecks", Counted)
    problem = SimpleNamespace(at_pose=lambda cam2world, names: None)
    judge = SimpleNamespace(threshold=0.95, problem=problem)
    bounds = joint_bounds(judge, np.eye(4), tuple(share), 0, needed=0.7)
    parts = [(names, n) for names, n, _, _ in asked]
    assert parts == [
        (tuple(share), 1000),
        (("later", "open"), 1000),
        (("later", "open"), 2000),
        (("open",), 4000),
        (("open",), 12_000),
    ]
    # each part has draws of its own
    assert len({seed for _, _, seed, _ in asked}) == len(asked)
    # nothing of what is there already, 0.951 of 8000, has to be hit again: 0.7 of 20,000, and what chance adds
    assert [needed for *_, needed in asked[:4]] == [0] * 4
    last = asked[4][3] + round(0.951 * 8000)
    one = binom.sf(last - 1, 20_000, 0.7)
    assert one <= 0.001 / 5 < binom.sf(last - 2, 20_000, 0.7)
    decided = {name: n for name, (_, n) in bounds.items()}
    assert decided == {"sure": 1000, "later": 4000, "open": 20_000, "low": 1000}
    # each of five looks errs with a fifth of what one may
    assert bounds["sure"][0] == pytest.approx((0.001 / 5.0) ** (1.0 / 1000.0), rel=1e-9)
    assert binom.sf(round(0.962 * 4000) - 1, 4000, bounds["later"][0]) == pytest.approx(0.001 / 5.0)
    # a probability that takes 200,000 displaced poses is counted once
    asked.clear()
    judge = SimpleNamespace(threshold=0.9999, problem=problem)
    joint_bounds(judge, np.eye(4), ("open",), 0, needed=0.7)
    assert [(names, n) for names, n, _, _ in asked] == [(("open",), 200_000)]


def test_a_bound_after_several_looks_is_rarely_above_the_truth(monkeypatch):
    """The probability is 0.9 exactly: any look may say more than that, and all together do so in 0.1 % of counts."""
    rng = np.random.default_rng(5)
    n_targets = 4000
    names = tuple(f"t{k}" for k in range(n_targets))

    class Drawn:
        def __init__(self, problem, names):
            self.names = names

        def count(self, cam2world, n, seed, needed):
            hits = tuple(rng.binomial(n, 0.9, len(self.names)).tolist())
            return JointCounts(self.names, n, hits, min(hits), {})

    monkeypatch.setattr("planner.search.realise_column.DisplacedChecks", Drawn)
    problem = SimpleNamespace(at_pose=lambda cam2world, names: None)
    judge = SimpleNamespace(threshold=0.9, problem=problem)
    bounds = joint_bounds(judge, np.eye(4), names, 0)
    n_wrong = sum(lower > 0.9 for lower, _ in bounds.values())
    # 4 of 4000 are expected at most; more than 12 would happen once in 4000 times
    assert binom.sf(12, n_targets, 0.001) < 1 / 2000
    assert n_wrong <= 12
    # and the looks are not so careful that none is ever wrong
    assert len({n for _, n in bounds.values()}) == 5


def test_a_promise_that_leaves_the_picture_too_often_counts_as_contradicted(monkeypatch):
    """Simulation supports the error of both; P_all of one is too low, and is asked once."""
    asked = []

    def bounds(judge, pose, names, seed):
        asked.append(names)
        return {NAMES[0]: (0.93, 1000), NAMES[1]: (0.85, 1000)}

    monkeypatch.setattr(
        "planner.search.realise_column.promised_too_much", lambda judge, setting, seed: {}
    )
    monkeypatch.setattr("planner.search.realise_column.joint_bounds", bounds)
    run = run_with(np.eye(4))
    setting = SimpleNamespace(
        cam2world=np.eye(4), entities=tuple(NAMES[:2]), probability=dict.fromkeys(NAMES, 0.95)
    )
    for _ in range(2):
        (name, short), *others = run.promises.contradicted_in(setting).items()
        assert (name, others) == (NAMES[1], [])
        # 0.9 is required
        assert abs(short - 0.05) < 1e-12
    assert asked == [tuple(NAMES[:2])]


def test_several_processes_find_what_one_does(monkeypatch):
    """What is found beforehand, in any order of work, is not simulated again."""
    run = run_with(np.eye(4))
    request = run.problem
    poses = look_at([[20.0, 30.0, 300.0 + k] for k in range(3)], [0, 0, 0])
    settings = [setting_at(request, pose, tuple(NAMES[:2]), "", seed=0) for pose in poses]
    alone = [run.promises.contradicted_in(setting) for setting in settings]
    assert any(alone)
    with ThreadPoolExecutor(2) as executor:
        other = run_with(np.eye(4))
        other.executor = executor
        assert list(other.simulate([*settings, settings[0]])) == [*settings, settings[0]]
    monkeypatch.setattr("planner.search.realise_column.simulate_promises", None)
    assert [other.promises.contradicted_in(setting) for setting in settings] == alone
    assert list(other.simulate(settings)) == []


# The stages of a plan: the state is kept after each, and a planning goes on with the stage that
# it names.


CAMERA_STAGES = Camera(25.0, (0.00345, 0.00345), (2448, 2048), 8.0, 400.0)
UNCERTAINTY_STAGES = PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.001)
SPACE_STAGES = BoxSpace((120.0, 80.0, 60.0), [[-900.0] * 3, [1100.0] * 3], list(EDGES)[:3])


class Stop(Exception):
    pass


def plan(path=None):
    return plan_inspection(
        SPACE_STAGES.solid,
        SPACE_STAGES.entities,
        CAMERA_STAGES,
        UNCERTAINTY_STAGES,
        space=SPACE_STAGES,
        effort=Effort(5, 2, 1, 300, 20, margin_generations=3),
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
        n_known=3,
        joined=1,
        bound=2,
        proof="by hand",
        counted=weighing.near,
        plan=plan(),
    )
    text = json.dumps(encoded(packed(state.pack())), allow_nan=False)
    again = PlanState.unpack(unpacked(json.loads(text)))
    for name in ("stage", "entries", "uninspectable", "incompatible", "n_known", "joined", "bound"):
        assert getattr(again, name) == getattr(state, name)
    assert again.uninspectable["b"].kind is ReasonKind.NOT_FOUND_YET
    assert again.proof == "by hand"
    assert again.plan == state.plan
    assert np.array_equal(again.inspected, state.inspected)
    assert np.array_equal(again.counted.membership, weighing.near.membership)
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
    from planner.inspection import _problem
    from planner.options import InspectionOptions
    from planner.resolve_request import resolve_request
    from planner.resume import PlanningState
    from planner.search.incumbents import Incumbents, SearchRun

    options = InspectionOptions(
        space=SPACE_STAGES, effort=Effort(5, 2, 1, 300, 20, margin_generations=3)
    )
    resolved = resolve_request(
        SPACE_STAGES.solid, SPACE_STAGES.entities, CAMERA_STAGES, UNCERTAINTY_STAGES, options
    )
    names = []
    bounds = []
    callbacks = Callbacks(
        on_stage=names.append, on_bound=lambda bound, weights: bounds.append(bound)
    )
    request = _problem(SPACE_STAGES.solid, resolved, options, Deadline())
    memo = PlanningState(resolved.request.identity())
    run = SearchRun(request, resolved.request, memo, callbacks=callbacks)
    found = stages.run_stages(run, Incumbents(callbacks))
    assert json.dumps(found.to_dict()) == whole
    assert names == [stage.name for stage in stages.STAGES]
    assert max(bounds) == found.lower_bound


def test_a_plan_ends_at_its_limit_and_without_one_the_search_soon_after(monkeypatch):
    """The limit counts from when the program began; what follows the search needs the rest of three seconds."""
    clock = [1000.0]
    monkeypatch.setattr(callbacks.time, "monotonic", lambda: clock[0])
    monkeypatch.setattr(callbacks.time, "time", lambda: clock[0] + 7000.0)
    deadline = Deadline(time_limit_s=5.0, begun=996.0)
    assert deadline.of_regions() == pytest.approx(8000.0 + 1.0)
    search = deadline.of_search()
    clock[0] = 1001.9
    search.check()
    search.arm()
    with pytest.raises(TimeIsUpError):
        search.check()
    clock[0] = 1002.1
    with pytest.raises(TimeIsUpError):
        deadline.of_search().check()
    assert deadline.time_left(0.88, least_s=2.0).until <= 8002.0
    assert deadline.of_settling() <= clock[0] + 7000.0
    patient = Deadline(time_limit_s=100.0, begun=996.0)
    patient.arm()
    patient.check()
    assert patient.of_regions() == pytest.approx(8002.1 + (8076.0 - 8002.1) * 2.0 / 3.0)
    # what is shorter than five seconds leaves the least time for a first plan
    short = Deadline(time_limit_s=3.0, begun=996.0).of_search()
    short.check()
    short.arm_soon()
    clock[0] += callbacks.LEAST_SEARCH_S - 0.1
    short.arm_soon()
    short.check()
    clock[0] += 0.2
    with pytest.raises(TimeIsUpError):
        short.check()
    # a longer one ends with whatever plan there is
    kept = Deadline(time_limit_s=20.0, begun=clock[0]).of_search()
    clock[0] += 15.9
    kept.arm_soon()
    kept.check()
    clock[0] += 0.2
    with pytest.raises(TimeIsUpError):
        kept.check()
    assert Deadline().of_regions() == math.inf
    assert not Deadline().of_search().limited


@pytest.mark.parametrize(("passed_s", "settling_s"), [(4.0, 0.7), (5.2, 0.7), (5.5, 0.0)])
def test_settings_are_moved_only_where_the_least_time_fits(passed_s, settling_s, monkeypatch):
    """A limit of 5 s leaves 1 s beyond it: 0.7 s fit until 5.3 s."""
    monkeypatch.setattr(callbacks.time, "monotonic", lambda: 1000.0)
    monkeypatch.setattr(callbacks.time, "time", lambda: 8000.0)
    deadline = Deadline(time_limit_s=5.0, begun=1000.0 - passed_s)
    assert deadline.of_settling() - 8000.0 == pytest.approx(settling_s)


def test_tasks_of_other_processes_end_when_the_search_does(monkeypatch):
    clock = [1000.0]
    monkeypatch.setattr(callbacks.time, "monotonic", lambda: clock[0])
    monkeypatch.setattr(callbacks.time, "time", lambda: clock[0] + 7000.0)
    search = Deadline(time_limit_s=20.0, begun=1000.0).of_search()
    # nothing to end with yet: until when there must be a first plan
    waits = search.check_now().__self__.until
    assert waits == pytest.approx(8000.0 + 20.0 + 1.0)
    search.arm()
    assert search.check_now().__self__.until == pytest.approx(8000.0 + 0.8 * 20.0)
    assert Deadline().check_now().__self__.until == math.inf
    monkeypatch.undo()
    late = Deadline(time_limit_s=6.0, begun=-100.0)
    late.arm()
    with pytest.raises(TimeIsUpError):
        pickle.loads(pickle.dumps(late.check_now()))()


def test_tasks_given_before_there_is_a_plan_end_when_the_search_does(monkeypatch, tmp_path):
    """What says that there is a plan reaches tasks of other processes, and is gone with the search."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    clock = [1000.0]
    monkeypatch.setattr(callbacks.time, "monotonic", lambda: clock[0])
    monkeypatch.setattr(callbacks.time, "time", lambda: clock[0] + 7000.0)
    search = Deadline(time_limit_s=20.0, begun=1000.0).of_search()
    check = pickle.loads(pickle.dumps(search.check_now()))
    # the search has 16 s, a first plan more
    clock[0] += 18.0
    check()
    search.arm_soon()
    with pytest.raises(TimeIsUpError):
        check()
    search.arm()
    with pytest.raises(TimeIsUpError):
        check()
    assert len(list(tmp_path.iterdir())) == 1
    del search
    gc.collect()
    assert not list(tmp_path.iterdir())
    check()


def test_without_a_folder_for_files_tasks_end_when_a_first_plan_would_be_late(monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", "/nowhere")
    clock = [1000.0]
    monkeypatch.setattr(callbacks.time, "monotonic", lambda: clock[0])
    monkeypatch.setattr(callbacks.time, "time", lambda: clock[0] + 7000.0)
    search = Deadline(time_limit_s=20.0, begun=1000.0).of_search()
    check = search.check_now()
    search.arm()
    clock[0] += 20.9
    check()
    clock[0] += 0.2
    with pytest.raises(TimeIsUpError):
        check()


def test_work_that_comes_late_has_half_of_what_is_left(monkeypatch):
    clock = [50.0]
    monkeypatch.setattr(callbacks.time, "monotonic", lambda: clock[0])
    monkeypatch.setattr(callbacks.time, "time", lambda: clock[0] + 7000.0)
    deadline = Deadline(time_limit_s=100.0, begun=50.0)
    assert deadline.time_left(0.8).until == pytest.approx(7130.0)
    clock[0] = 140.0
    assert deadline.time_left(0.8).until == pytest.approx(7145.0)
    assert deadline.time_left(0.8, least_s=9.0).until == pytest.approx(7149.0)
    clock[0] = 148.0
    assert deadline.time_left(0.8, least_s=9.0).until == pytest.approx(7151.0)
    assert Deadline().time_left(0.8).until == math.inf


# Targets that are short of P_all are tried again: from other settings, from other columns, and
# alone.


CAMERA_RETRY = Camera(8.0, (0.00345, 0.00345), (2448, 2048), 8.0, 400.0)
# two edges of the top that meet its front and its back
FRONT = "+z-y"
BACK = "+z+y"
NAMES_RETRY = (FRONT, BACK)
SPACE_RETRY = BoxSpace((120.0, 80.0, 60.0), [[-900.0] * 3, [1100.0] * 3], EDGES)
ABOVE = look_at([[60.0, 40.0, 460.0]], [60.0, 40.0, 60.0])[0]
# below the top, the edge at the back is hidden
BEFORE = look_at([[60.0, -390.0, 30.0]], [60.0, 0.0, 60.0])[0]


def run_of(sigma_mm=0.05, sigma_rad=0.001):
    uncertainty = PoseUncertainty.isotropic(translation_mm=sigma_mm, rotation_rad=sigma_rad)
    request = Problem(SPACE_RETRY, NAMES_RETRY, CAMERA_RETRY, uncertainty, 0.98, 0.9)
    return SearchRun(request, request_with(seed=0), PlanningState({}))


def stated(run, pose, p_all):
    made = setting_at(run.problem, pose, tuple(p_all), "given")
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
    assert set(only.entities) == set(NAMES_RETRY)
    assert (only.cam2world == ABOVE).all()
    assert min(only.p_all.values()) >= 0.9


def test_a_setting_is_spared_where_another_one_measures_its_targets():
    """The one from below the top sees the edge in front; so does the one from above, which is of the other edge."""
    run = run_of()
    given = [stated(run, ABOVE, {BACK: 0.99}), stated(run, BEFORE, {FRONT: 0.99})]
    assert run.judge(BEFORE[None]).inspects[0].tolist() == [name == FRONT for name in run.names]
    (only,) = without_spare(run, given, never)
    assert (only.cam2world == ABOVE).all()
    assert set(only.entities) == set(NAMES_RETRY)
    assert min(only.p_all.values()) >= 0.9


def test_what_two_settings_state_already_joins_neither():
    run = run_of()
    both = stated(run, ABOVE, {BACK: 0.99, FRONT: 0.99})
    assert without_spare(run, [stated(run, BEFORE, {FRONT: 0.99}), both], never) == [both]


def test_no_setting_is_spared_where_the_counts_forbid_it(monkeypatch):
    run = run_of()
    given = [stated(run, ABOVE, {BACK: 0.99}), stated(run, BEFORE, {FRONT: 0.99})]
    monkeypatch.setattr(
        settle, "joint_bounds", lambda judge, pose, names, seed: {names[0]: (0.8, 1000)}
    )
    assert without_spare(run, given, never) == given
    assert without_spare(run, given[1:], never) == given[1:]
    assert without_spare(run, [], never) == []


def test_a_pose_of_another_column_is_added_for_it():
    """The setting that stays looks from below the top and sees no edge at the back; a column does."""
    run = run_of()
    both = np.array([[name in NAMES_RETRY for name in run.names]])
    run.pool.add(both, ABOVE[None], np.ones((1, len(NAMES_RETRY))))
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
    run.memo.put((BACK,), Outcome(setting_at(run.problem, ABOVE, (BACK,), "found alone")))
    settled = _without_short(
        run, [stated(run, BEFORE, {FRONT: 0.99}), stated(run, BEFORE, {BACK: 0.5})], centre
    )
    assert not settled.lost
    assert [one.entities for one in settled.settings] == [(FRONT,), (BACK,)]


def test_several_processes_fill_settings_as_one_does():
    """From above both edges are measured, whichever was sought there; each pose is counted once, and told of."""
    told = []
    filled = []
    for executor in (None, ThreadPoolExecutor(2)):
        run = run_of()
        run.executor = executor
        run.callbacks = Callbacks(progress=lambda *state: told.append(state))
        sought = [setting_at(run.problem, ABOVE, (BACK,), ""), stated(run, BEFORE, {FRONT: 0.99})]
        filled.append(lit_poses._with_all(run, sought))
    assert [set(one.entities) for one in filled[0]] == [set(NAMES_RETRY), {FRONT}]
    assert [one.p_all for one in filled[0]] == [one.p_all for one in filled[1]]
    assert told == [(1, 2, "counts in the light"), (2, 2, "counts in the light")] * 2


def test_what_is_short_everywhere_is_lost_with_the_most_that_was_found():
    """Its own search finds a pose of P_all .8, more than the .5 of the plan: the reason states .8."""
    run = run_of()
    run.memo.put((BACK,), Outcome(setting_at(run.problem, ABOVE, (BACK,), "found alone")))

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


def test_a_reason_does_not_depend_on_what_was_counted_for_plans_on_the_way(monkeypatch):
    """How many of these are counted is a matter of the clock, and a resumed run has counted none."""

    def bounds(judge, pose, names, seed):
        return dict.fromkeys(names, (pose[0, 3] / 100.0, 1000))

    monkeypatch.setattr("planner.search.realise_column.promised_too_much", lambda *_: {})
    monkeypatch.setattr("planner.search.realise_column.joint_bounds", bounds)
    nothing = Outcome(reason=Reason.of(ReasonKind.UNOBSERVABLE, "nothing."))
    column = np.array([name == BACK for name in NAMES_RETRY])
    pose = look_at([[60.0, 40.0, 460.0]], [60.0, 40.0, 60.0])
    elsewhere = look_at([[70.0, 40.0, 460.0]], [60.0, 40.0, 60.0])[0]
    reasons = []
    for on_the_way in ([], [elsewhere]):
        run = run_of()
        run.memo.put((BACK,), nothing)
        run.pool.add(column[None], pose, np.full((1, len(NAMES_RETRY)), 0.95))
        for other in on_the_way:
            assert run.promises.contradicted_in(setting_at(run.problem, other, (BACK,), ""))
        settled = settle.settle(run, column, ColumnPool(len(NAMES_RETRY)))
        assert settled.settings == []
        reasons.append(settled.lost[BACK])
    assert reasons[0] == reasons[1]
    assert "reaches P_all = 0.6000, below the required 0.9." in reasons[0]


@pytest.mark.parametrize(("retried", "tries"), [(1, 1), (3, 3), (8, 5)])
def test_no_more_poses_are_simulated_than_the_effort_allows(retried, tries, monkeypatch):
    """Five columns contain the target and none is supported: each is tried once, up to the limit."""
    monkeypatch.setattr(settle, "_RETRIED", retried)
    run = run_of()
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


# What becomes of targets that lack the required P_all when the settings are fixed.


CAMERA_SETTLED = Camera(8.0, (0.00345, 0.00345), (2448, 2048), 8.0, 400.0)
UNCERTAINTY_SETTLED = PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.001)
NAMES_SETTLED = tuple(EDGES[:3])
REQUEST = Problem(
    BoxSpace((120.0, 80.0, 60.0), [[-900.0] * 3, [1100.0] * 3], NAMES_SETTLED),
    NAMES_SETTLED,
    CAMERA_SETTLED,
    UNCERTAINTY_SETTLED,
    0.98,
    0.9,
)
POSE = look_at([[60.0, -280.0, 380.0]], [60.0, 40.0, 60.0])[0]


def setting(p_all):
    made = setting_at(REQUEST, POSE, tuple(p_all), "given")
    return replace(made, p_all=p_all, p_all_together=0.5, p_all_poses=1000)


def test_a_target_is_dropped_where_it_is_short_and_lost_where_it_is_so_everywhere():
    """The first is short in one of two settings, the second in its only one, the third in none."""
    first, second, third = NAMES_SETTLED
    settled = _without_short(
        SimpleNamespace(problem=REQUEST, request=REQUEST),
        [setting({first: 0.85, second: 0.89}), setting({first: 0.95, third: 0.9})],
    )
    # nothing is left of the first setting
    assert [one.entities for one in settled.settings] == [(first, third)]
    assert list(settled.lost) == [second]
    assert settled.lost[second].kind is ReasonKind.PROBABILITY_TOO_LOW
    assert "P_all = 0.8900, below the required 0.9." in settled.lost[second]


def test_a_setting_keeps_what_is_stated_of_its_other_targets():
    first, second, _ = NAMES_SETTLED
    (kept,) = _without_short(
        SimpleNamespace(problem=REQUEST, request=REQUEST), [setting({first: 0.85, second: 0.93})]
    ).settings
    assert kept.p_all == {second: 0.93}
    assert set(kept.probability) == {second}


# Candidate poses that are good enough: no genetic algorithm for those, and what is stated still
# holds.


SMALL = Effort(
    viewpoints=30, pricing_rounds=15, refutations=0, bound_nodes=1000, margin_generations=3
)


@pytest.fixture(scope="module")
def searched():
    """For each preference, the plan, and how many columns the genetic algorithm improved."""
    space = BoxSpace((120.0, 80.0, 60.0), WORKSPACE, EDGES)

    def plan(enough):
        effort = replace(SMALL, good_enough=enough)
        runs = []

        def progress(done, total, label):
            if label == "improving poses":
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


# A time limit that ends the computation of visible regions: what is complete is planned, the rest
# is named.


RIMS = {"e1": [[60, 20, 10], [60, 40, 10]], "e4": [[20, 60, 10], [40, 60, 10]]}


@pytest.fixture(scope="module")
def call():
    block = read_solid("examples/two_pocket_block.off")
    camera = Camera.named("basler-acA2440-20gm-8mm")
    uncertainty = PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.001)

    def plan(known, **options):
        space = compute_regions(block, {name: RIMS[name] for name in known})
        arguments = (block, RIMS, camera, uncertainty)
        return plan_inspection(*arguments, accuracy=0.95, effort=BRIEF, space=space, **options)

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
