"""What a run keeps and knows: bounds by what excludes each other, checkpoints, what simulation says of a promise."""

from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import numpy as np
from grid_box import EDGES, BoxSpace
from plan_examples import request_with

from planner import Camera, PoseUncertainty, look_at
from planner.callbacks import NOBODY
from planner.effort.effort import Effort
from planner.request.request import Request
from planner.resume import PlanningState
from planner.search import stages as prove_bound
from planner.search.incumbents import Incumbents
from planner.search.plan_setting import setting_at
from planner.search.run import PlanState, Run

CAMERA = Camera(25.0, (0.00345, 0.00345), (2448, 2048), 8.0, 400.0)
UNCERTAINTY = PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.001)
NAMES = list(EDGES)[:4]
SPACE = BoxSpace((120.0, 80.0, 60.0), [[-900.0] * 3, [1100.0] * 3], NAMES)


def run_with(columns):
    """A run whose pool has these sets of entities, each from some pose."""
    request = Request(SPACE, tuple(NAMES), CAMERA, UNCERTAINTY, 0.98, 0.9)
    asked = request_with(seed=0, effort=Effort(viewpoints=1, pricing_rounds=3, cover_nodes=50))
    run = Run(request, asked, PlanningState({}))
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
    run.judge.request = SimpleNamespace(
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
    request = run.request
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
