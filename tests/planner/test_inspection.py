"""The whole inspection on a box whose visibility is known by hand, so that the least number of settings is, too.

From one viewpoint at most three faces of a box can be seen, and with them nine of its twelve edges; the three edges
of the opposite corner need another. A cube as large as the field of view shows one face at a time: four edges, so
three settings at least for twelve.
"""

import json
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor

import numpy as np
import pytest
from box_requests import CAMERA, UNCERTAINTY, WORKSPACE, random_poses
from grid_box import EDGES, BoxSpace
from plan_examples import BRIEF

from aspectgraph import read_solid
from planner import Camera, PoseUncertainty
from planner.bound.lower_bound import exclusion_proof, exclusive_entities, lower_bound
from planner.bound.pose_tree import find_conflicts
from planner.bound.view import Cells
from planner.camera.pose import moved
from planner.effort import Effort
from planner.exceptions import PlanFileError, RequestError
from planner.inspection import plan_inspection
from planner.request.camera_limits import default_workspace
from planner.request.dimension import Dimension
from planner.request.problem import Problem
from planner.resume import PlanningState
from planner.search.columns import ColumnPool, Judge, perturbed, price_poses
from planner.search.plan_setting import setting_at
from planner.search.realise_column import best_supported, without_contradicted
from planner.sensor_setting import Outcome
from planner.verify.simulate_plan import promises_too_much
from planner.verify.simulate_setting import simulate_setting

QUICK = Effort(
    viewpoints=30, pricing_rounds=15, refutations=2, bound_nodes=4000, margin_generations=3
)


@pytest.fixture(scope="module")
def space():
    return BoxSpace((120.0, 80.0, 60.0), WORKSPACE, EDGES)


def plan_box(space, camera=CAMERA, uncertainty=UNCERTAINTY, **options):
    return plan_inspection(
        space.solid,
        space.entities,
        camera,
        uncertainty,
        space=space,
        **{"effort": QUICK, **options},
    )


@pytest.fixture(scope="module")
def plan(space):
    return plan_box(space, rng=3)


def test_two_settings_see_all_edges_of_a_box_and_that_is_proven(plan):
    assert len(plan.settings) == plan.lower_bound == 2
    assert plan.minimal
    assert plan.complete
    assert "optimistic columns" in plan.bound_proof


def test_every_promise_of_a_setting_holds(space, plan):
    for setting in plan.settings:
        assert set(setting.probability) == set(setting.entities)
        assert min(setting.probability.values()) >= 0.9
        assert min(setting.margins.values()) >= 0
        assert space.observable(setting.position[None], setting.entities).all()
    assert {name for setting in plan.settings for name in setting.entities} == set(EDGES)


def test_simulation_confirms_the_plan(plan):
    result = plan.simulate(4000, rng=1)
    assert result.confirmed
    assert len(result.rates) == 2
    assert plan.simulated(100, rng=1).simulation == plan.simulate(100, rng=1)


def test_edges_of_one_face_need_one_setting(space):
    names = [name for name in EDGES if "+z" in name]
    top = BoxSpace(space.size, WORKSPACE, names)
    plan = plan_box(top)
    assert len(plan.settings) == plan.lower_bound == 1


@pytest.mark.parametrize("pool", [ThreadPoolExecutor, ProcessPoolExecutor])
def test_same_seed_same_plan_with_any_executor_or_none(space, plan, pool):
    with pool(2) as executor:
        assert plan_box(space, rng=3, executor=executor) == plan


class Cancelled(Exception):
    pass


def test_interrupted_plan_resumes_to_the_same_plan(space, plan, tmp_path):
    state = tmp_path / "state.json"

    def stop(done, total, label):
        if label == "improving poses" and done == 1:
            raise Cancelled

    with pytest.raises(Cancelled):
        plan_box(space, rng=3, state=state, progress=stop)
    assert len(json.loads(state.read_text())["outcomes"]) == 1
    runs = []
    resumed = plan_box(
        space,
        rng=3,
        state=state,
        progress=lambda done, total, label: runs.append((label, done, total)),
    )
    assert resumed == plan
    assert [total for label, _, total in runs if label == "improving poses"] == [1]


def test_a_resumed_plan_takes_in_the_poses_that_the_proof_came_across(space, tmp_path, monkeypatch):
    proofs = []
    state = tmp_path / "state.json"

    def proof(request, _, __, *, improve, **___):
        proofs.append(improve(random_poses(Judge(request), 300, seed=9)))
        return 1, "by assumption", None

    def stop(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("planner.search.stages.lower_bound", proof)
    plan = plan_box(space, rng=3)
    with monkeypatch.context() as patch:
        patch.setattr("planner.search.stages.assembled", stop)
        with pytest.raises(KeyboardInterrupt):
            plan_box(space, rng=3, state=state)
    assert plan_box(space, rng=3, state=state) == plan
    # the proof is not done again, and its poses are in the pools all the same
    assert len(proofs) == 2
    assert (proofs[0] == proofs[1]).all()


def test_a_proof_that_goes_on_improves_the_columns_as_it_would_have(space, tmp_path, monkeypatch):
    """Each batch of poses has a seed of its own, by its number."""
    state = tmp_path / "state.json"
    after = []
    stops = [True]

    def proof(request, _, __, *, improve, checkpoint, **___):
        if checkpoint.get("first") is None:
            improve(random_poses(Judge(request), 40, seed=9))
            checkpoint.put("first", {"done": True})
        if stops.pop():
            raise KeyboardInterrupt
        after.append((improve(random_poses(Judge(request), 40, seed=10)), seeds[-1]))
        return 1, "by assumption", None

    def price(shared, pools, seed, *arguments, **options):
        seeds.append(seed)
        price_poses(shared, pools, seed, *arguments, **options)

    seeds = []
    monkeypatch.setattr("planner.search.stages.lower_bound", proof)
    monkeypatch.setattr("planner.search.stages.price_poses", price)
    with pytest.raises(KeyboardInterrupt):
        plan_box(space, rng=3, state=state)
    stops += [False, False]
    resumed = plan_box(space, rng=3, state=state)
    assert plan_box(space, rng=3) == resumed
    assert np.array_equal(after[0][0], after[1][0])
    assert after[0][1] == after[1][1]


@pytest.mark.parametrize(
    ("effort", "message"),
    [
        ({"viewpoints": 0}, r"viewpoints must be an integer of at least 1\. Got 0\."),
        ({"bound_nodes": -1}, r"bound_nodes must be an integer of at least 0\. Got -1\."),
        ({"refutations": 0.5}, r"refutations must be an integer of at least 0\. Got 0\.5\."),
    ],
)
def test_bad_effort_is_refused(effort, message):
    with pytest.raises(RequestError, match=message):
        Effort(**effort)


def test_least_effort_still_covers_everything(space):
    plan = plan_box(
        space, rng=3, effort=Effort(viewpoints=1, pricing_rounds=0, refutations=0, bound_nodes=0)
    )
    assert set().union(*(setting.entities for setting in plan.settings)) | set(
        plan.uninspectable
    ) == set(EDGES)
    assert plan.lower_bound <= len(plan.settings)


def test_state_of_another_request_is_refused(space, tmp_path):
    PlanningState({"seed": 1}, tmp_path / "state.json").put(["a"], Outcome(reason="no view"))
    with pytest.raises(
        PlanFileError,
        match=r"must belong to the same request .* Got another one: rng was 1 and is now 0",
    ):
        plan_box(space, state=tmp_path / "state.json")


def test_damaged_state_is_refused(tmp_path):
    (tmp_path / "state.json").write_text("{")
    with pytest.raises(PlanFileError, match=r"state\.json:1:2: state file must be JSON"):
        PlanningState({}, tmp_path / "state.json")
    (tmp_path / "state.json").write_text("{}")
    with pytest.raises(PlanFileError, match="must be a planning state of version 4"):
        PlanningState({}, tmp_path / "state.json")


def test_progress_names_every_stage(space):
    seen = {}
    plan_box(
        space, progress=lambda done, total, label: seen.setdefault(label, []).append((done, total))
    )
    assert list(seen) == [
        "candidate poses",
        "combining targets",
        "lower bound",
        "counted poses",
        "improving poses",
        "widening margins",
    ]
    assert all(reports[-1][0] == reports[-1][1] for reports in seen.values())


def test_unobservable_edge_is_listed_with_the_reason():
    # the box stands on the floor of the workspace, so the edges of its bottom are seen from their side faces only
    names = ["+z+x", "-z-x"]
    walled = BoxSpace((120.0, 80.0, 60.0), [[0.0, -900.0, 0.0], [900.0, 1000.0, 900.0]], names)
    plan = plan_box(walled)
    assert set(plan.uninspectable) == {"-z-x"}
    assert plan.uninspectable["-z-x"].startswith("unobservable: ")
    assert not plan.complete


def test_edge_too_short_for_the_resolution_is_listed_with_the_reason():
    tiny = BoxSpace((120.0, 80.0, 1.0), WORKSPACE, ["+y+x", "+z+x"])
    plan = plan_box(tiny, min_length_px=30)
    assert set(plan.uninspectable) == {"+y+x"}
    assert plan.uninspectable["+y+x"].startswith("too short for the resolution: ")


def test_part_out_of_focus_everywhere_is_listed_with_the_reason(space):
    cramped = BoxSpace(space.size, [[-60.0] * 3, [180.0, 140.0, 120.0]], ["+z+x"])
    plan = plan_box(cramped)
    assert plan.uninspectable["+z+x"].startswith("out of focus: ")
    assert plan.settings == ()
    assert plan.lower_bound == 0


def test_probability_too_low_is_listed_with_the_best_found(space):
    shaky = PoseUncertainty.isotropic(translation_mm=20.0, rotation_rad=0.001)
    one = BoxSpace(space.size, WORKSPACE, ["+z+x"])
    plan = plan_box(one, uncertainty=shaky, accuracy=0.995)
    reason = plan.uninspectable["+z+x"]
    assert reason.startswith("probability too low: the best pose found reaches P = 0.")
    assert "below the required 0.9" in reason


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"accuracy": 1.2}, r"accuracy must be in \(0, 1\). Got 1.2"),
        ({"accuracy": 0.02}, r"accuracy must be at least 0\.5.* Got 0\.02; write 0\.98"),
        ({"probability": 0}, r"probability must be in \(0, 1\). Got 0"),
        ({"probability": float("nan")}, r"probability must be in \(0, 1\). Got nan"),
        ({"rng": -1}, "rng must be a non-negative integer or a numpy Generator. Got -1"),
        ({"rng": "x"}, "rng must be a non-negative integer"),
    ],
)
def test_bad_arguments_are_named(space, options, message):
    with pytest.raises(RequestError, match=message):
        plan_box(space, **options)


def test_no_entities_are_refused(space):
    with pytest.raises(RequestError, match="entities must hold at least one entity"):
        plan_inspection(space.solid, {}, CAMERA, UNCERTAINTY, space=space)


def test_margin_keeps_displaced_corners_in_the_image():
    from planner.request.camera_limits import corner_margin_px
    from planner.verify.simulate_setting import displaced_poses

    margin = corner_margin_px(CAMERA, UNCERTAINTY, sigmas=4.0)
    near = CAMERA.depth_of_field_mm[0]
    # the point whose image is the margin away from two sides
    u, v = np.array([margin, margin]) - CAMERA.matrix[:2, 2] - 0.5
    point = near * np.array([u / CAMERA.matrix[0, 0], v / CAMERA.matrix[1, 1], 1.0])
    poses = displaced_poses(np.eye(4), UNCERTAINTY, 40_000, np.random.default_rng(0))
    local = np.einsum("nji,nj->ni", poses[:, :3, :3], point - poses[:, :3, 3])
    pixels = local[:, :2] / local[:, 2:] * np.diag(CAMERA.matrix)[:2] + CAMERA.matrix[:2, 2]
    spread = pixels.std(axis=0).max()
    assert margin == pytest.approx(4 * spread, rel=0.02)
    assert np.mean((pixels < -0.5).any(axis=1)) < 2e-4


def test_default_workspace_lets_the_lens_focus_on_every_side(space):
    low, high = default_workspace(space.solid, CAMERA)
    assert np.all(low <= -CAMERA.depth_of_field_mm[1])
    assert np.all(high >= space.size + CAMERA.depth_of_field_mm[1])


# --- the parts ------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def judge(space):
    return Judge(Problem(space, EDGES, CAMERA, UNCERTAINTY, 0.98, 0.9))


def test_judge_agrees_with_constraints_one_entity_at_a_time(space, judge):
    from planner.request.constraints import Constraints

    poses = random_poses(judge, 300)
    judged = judge(poses)
    assert judged.inspects.any()
    assert not judged.inspects.all()
    for k, name in enumerate(EDGES):
        alone = Constraints(space, [name], CAMERA, judge.requirements).feasible(poses)
        assert np.array_equal(judged.inspects[:, k], alone & (judged.probability[:, k] >= 0.9))
    assert np.all(judged.nearly >= judged.inspects)
    assert np.all(judged.promise[judged.inspects] == 1.0)


def test_prices_skip_only_poses_that_are_worth_too_little(judge):
    poses = random_poses(judge, 300)
    prices = np.full(len(EDGES), 0.3)
    everything = judge(poses)
    priced = judge(poses, prices)
    skipped = ~priced.nearly.any(axis=1)
    assert skipped.any()
    assert np.array_equal(priced.inspects[~skipped], everything.inspects[~skipped])
    assert np.all(everything.inspects[skipped].sum(axis=1) <= 3)


def test_pool_keeps_maximal_sets_with_their_best_pose():
    pool = ColumnPool(3)
    poses = np.arange(4.0)[:, None, None] * np.ones((4, 4))
    sets = np.array([[1, 0, 0], [1, 1, 0], [1, 1, 0], [0, 0, 0]], dtype=bool)
    pool.add(sets, poses, np.array([[1.0, 0, 0], [0.91, 0.92, 0], [0.95, 0.96, 0], [0, 0, 0]]))
    assert pool.membership.tolist() == [[True, True, False]]
    assert pool.poses[0, 0, 0] == 2.0
    assert pool.quality[0] == pytest.approx(0.955)


def test_perturbed_poses_stay_rigid_and_change(judge):
    poses = np.repeat(random_poses(judge, 5), 40, axis=0)
    moved = perturbed(poses, 400.0, np.random.default_rng(0))
    rotation = moved[:, :3, :3]
    assert rotation @ rotation.transpose(0, 2, 1) == pytest.approx(
        np.tile(np.eye(3), (200, 1, 1)), abs=1e-12
    )
    assert np.linalg.det(rotation) == pytest.approx(np.ones(200))
    assert np.all(np.linalg.norm(moved[:, :3, 3] - poses[:, :3, 3], axis=1) > 0)


def test_bound_is_never_above_what_sampled_poses_reach(judge):
    """Optimistic sets must contain what any pose inspects, so a cover by real columns is never below the bound."""
    poses = random_poses(judge, 4000, seed=5)
    pool = ColumnPool(len(EDGES))
    judged = judge(poses)
    pool.add(judged.inspects, poses, judged.probability)
    bound, _, _ = lower_bound(judge.problem, 12, pool.membership, effort=Effort(bound_nodes=3000))
    assert bound == 2


@pytest.mark.uncompiled
def test_conflicts_are_real(judge):
    regions = Cells([judge.space.covering_cells([name]) for name in EDGES])
    idx = np.arange(len(EDGES))
    assert not find_conflicts(judge.problem, idx, np.zeros((0, 12), dtype=bool), regions).any()
    # opposite vertical edges of a long box: 900 mm apart, more than the frustum holds (670 mm)
    long = BoxSpace((900.0, 80.0, 60.0), WORKSPACE, ["-y+x", "-y-x", "+y+x"])
    far = Judge(Problem(long, long.entity_names, CAMERA, UNCERTAINTY, 0.98, 0.9))
    cells = Cells([long.covering_cells([name]) for name in long.entity_names])
    found = find_conflicts(far.problem, np.arange(3), np.zeros((0, 3), dtype=bool), cells)
    assert found.tolist() == [[False, True, False], [True, False, True], [False, True, False]]
    # the middle one excludes both others, so two of them are a largest clique; the two outer ones alone are none
    exclusive = exclusive_entities(far.problem, np.arange(3), np.zeros((0, 3), dtype=bool))
    assert exclusive.tolist() in ([0, 1], [1, 2])
    assert exclusion_proof(far.problem, 2).startswith("Of 2 edges no two can be inspected together")
    assert len(exclusive_entities(far.problem, np.array([0, 2]), np.zeros((0, 2), dtype=bool))) == 1
    assert exclusion_proof(far.problem, 1) == "Fewer settings than one inspect nothing."


@pytest.mark.uncompiled
def test_edges_of_opposite_faces_exclude_each_other_in_a_narrow_workspace():
    """With walls flush with the front, +z-y is seen from above only and -z+y from below or behind only."""
    flush = BoxSpace(
        (120.0, 80.0, 60.0),
        [[-900.0, 0.0, -900.0], [1000.0, 80.0, 900.0]],
        ["+z-y", "-z+y", "+z+y"],
    )
    judge = Judge(Problem(flush, flush.entity_names, CAMERA, UNCERTAINTY, 0.98, 0.9))
    cells = Cells([flush.covering_cells([name]) for name in flush.entity_names])
    found = find_conflicts(judge.problem, np.arange(3), np.zeros((0, 3), dtype=bool), cells)
    assert found.tolist() == [[False, True, False], [True, False, True], [False, True, False]]


def test_what_simulation_contradicts_is_left_to_the_setting_where_it_is_supported(
    judge, monkeypatch
):
    """Of three entities in two settings: one contradicted in the first only, one in both, one in neither."""
    pose = random_poses(judge, 1)[0]
    settings = [setting_at(judge.problem, pose, EDGES[:3], str(k), seed=k) for k in range(2)]
    excess = {
        "0": dict(zip(EDGES, [0.02, 0.02, 0.0], strict=False)),
        "1": dict(zip(EDGES, [0, 0.02, 0], strict=False)),
    }
    monkeypatch.setattr(
        "planner.search.realise_column._excess", lambda _, setting, __: excess[setting.message]
    )
    monkeypatch.setattr("planner.search.realise_column._near", lambda *given: iter(()))
    monkeypatch.setattr("planner.search.realise_column.shortfalls", lambda *given: {})
    supported = [best_supported(judge, [setting], 0) for setting in settings]
    assert [one.entities for one in supported] == [{EDGES[2]}, {EDGES[0], EDGES[2]}]
    first, second = without_contradicted(judge.problem, supported)
    assert first.entities == tuple(first.probability) == tuple(EDGES[1:3])
    assert first.fitness == pytest.approx(sum(first.probability.values()))
    assert (first.seed, first.message) == (0, "0")
    assert second is settings[1]


def test_a_pose_that_simulation_contradicts_is_replaced_by_one_near_it(judge):
    """An end at the sensor's side leaves the image of a displaced camera; from a pose near it, it does not."""
    poses = random_poses(judge, 4000)
    inspects = judge(poses).inspects
    turns = np.zeros((400, 6))
    turns[:, 4] = np.linspace(0.0, 0.8, 400)
    contradicted = 0
    for k in np.flatnonzero(inspects.any(axis=1))[:3]:
        row = inspects[k]
        turned = moved(poses[k], turns, 1.0)
        # as far as all of it is on the sensor; a displaced camera moves the image by 2 px or so
        pose = turned[judge(turned).inspects[:, row].all(axis=1)][-1]
        setting = setting_at(judge.problem, pose, tuple(np.array(EDGES)[row]), "given", seed=0)
        if promised_too_much(setting, judge):
            contradicted += 1
            better, supported = best_supported(judge, [setting], seed=1)
            assert set(better.entities) == supported == set(setting.entities)
            assert judge(better.cam2world[None]).inspects[0, row].all()
            assert not promised_too_much(better, judge)
    assert contradicted > 0


def promised_too_much(setting, judge):
    ends = dict(zip(judge.names, judge.ends, strict=True))
    rates = simulate_setting(
        setting, ends, CAMERA, UNCERTAINTY, accuracy=judge.accuracy, n=20_000, rng=7
    )
    return any(promises_too_much(rate) for rate in rates.values())


def test_ids_without_names_are_named_by_them():
    block = read_solid("examples/two_pocket_block.off")
    effort = BRIEF
    camera = Camera.named("basler-acA2440-20gm-8mm")
    uncertainty = PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.001)
    plans = [
        plan_inspection(block, wanted, camera, uncertainty, effort=effort)
        for wanted in ([17], {"e17": 17})
    ]
    assert plans[0] == plans[1]
    assert list(plans[0].entities) == ["e17"]


def test_ids_of_arrays_and_sets_are_planned_like_those_of_lists():
    block = read_solid("examples/two_pocket_block.off")
    effort = Effort(viewpoints=5, pricing_rounds=1, refutations=1, bound_nodes=10)
    camera = Camera.named("basler-acA2440-20gm-8mm")
    plans = [
        plan_inspection(block, wanted, camera, UNCERTAINTY, effort=effort)
        for wanted in ([8, 17], np.array([8, 17]), {17, 8})
    ]
    assert plans[0] == plans[1] == plans[2]


@pytest.mark.parametrize(
    ("entities", "message"),
    [
        ("all", "entities must be a mapping or sequence. Got 'all'; read_entities reads a text, "),
        (1, "entities must be a mapping or sequence. Got 1; "),
        (None, "entities must be a mapping or sequence. Got None; "),
        (
            [17, Dimension.distance(17, 8)],
            "entities must name each dimension. Got a list with Dimension(kind='distance', "
            'entities=(17, 8)); write {"name": Dimension(...)}.',
        ),
        ((Dimension.length(3),), "entities must name each dimension. Got a tuple with Dimension("),
    ],
)
def test_entities_of_another_kind_are_refused_in_one_line(space, entities, message):
    with pytest.raises(RequestError) as caught:
        plan_inspection(space.solid, entities, CAMERA, UNCERTAINTY)
    assert str(caught.value).startswith(message)
