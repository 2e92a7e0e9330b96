"""Plans whose values are read from registered images: what registration is said to tell is what `measure` finds."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg
from plan_examples import changed

from aspectgraph import Solid
from errors.registration import _free_ways, posterior
from planner import (
    Camera,
    Dimension,
    Effort,
    InspectionOptions,
    Measurer,
    PoseUncertainty,
    Registration,
    RequestError,
    Search,
    look_at,
    plan_inspection,
    read_plan,
)
from planner.app.quantities import registration
from planner.bound.pose_space import least_images_mm
from planner.callbacks import Deadline
from planner.camera.pose import world_to_cam
from planner.inspection import _problem
from planner.measuring import task as solving
from planner.measuring.planned_edges import planned_edges, registered_problem
from planner.measuring.registered import displaced, prior_covariance, surface_variances
from planner.measuring.samples import POSE, PartModel
from planner.measuring.task import registration_task
from planner.request.registration import PLANNED, PoseKnowledge, RegistrationRecord
from planner.resolve_request import resolve_request
from planner.verify.setting_record import search_windows_px
from planner.verify.simulate_plan import simulate_plan
from planner.verify.simulate_setting import ValuePoses

CAMERA = Camera.named("basler-acA2440-20gm-8mm")
ROBOT = PoseUncertainty.isotropic(translation_mm=0.7, rotation_rad=0.007)
SEARCH = Search(max_generations=5, attempts=1, refine_starts=1, spread_starts=1, turned_starts=1)
QUICK = Effort(
    viewpoints=5, pricing_rounds=1, refutations=0, bound_nodes=100, search=SEARCH
).giving_up(0)
OWN_EDGES = Registration.own_edges(surfaces_mm=0.03)


@pytest.fixture(scope="module")
def block():
    return Solid.read("examples/two_pocket_block.off")


def planned(block, registration=None, **more):
    wanted = {
        "width": Dimension.distance(25, 27, tolerance_mm=(-0.24, 0.24)),
        "height": Dimension.distance(24, 26, tolerance_mm=(-0.24, 0.24)),
    }
    return plan_inspection(
        block, wanted, CAMERA, ROBOT, effort=QUICK, registration=registration, **more
    )


@pytest.fixture(scope="module")
def registered(block):
    return planned(block, OWN_EDGES)


def requested(block, plan):
    """The request of a plan, without registration."""
    asked = plan.request
    items = {target.name: target.item_of(block) for target in asked.targets}
    options = replace(InspectionOptions.of_request(asked), registration=None)
    resolved = resolve_request(block, items, asked.camera, asked.pose_uncertainty, options)
    return _problem(block, resolved, options, Deadline(None, 0.0))


def at(plan, setting, name, known=None):
    """What a target is described as, with the knowledge of the setting or another one."""
    means = plan.means if known is None else known.of_target(plan.means, name)
    return plan.targets[name].describe(setting.cam2world, means)


def test_a_robot_that_is_not_accurate_enough_is_with_registration(block, registered):
    before = planned(block)
    assert set(before.uninspectable) == {"width", "height"}
    assert registered.complete
    assert registered.pose_uncertainty == ROBOT
    # windows keep the robot's uncertainty
    assert registered.requirements == before.requirements


def test_what_is_stated_follows_from_what_the_setting_knows(registered):
    (setting,) = registered.settings
    for name in setting.entities:
        found = at(registered, setting, name, setting.registered)
        assert setting.probability[name] == pytest.approx(found.probability, abs=2e-4)
        assert setting.p_all[name] <= setting.probability[name]
        # the robot alone is not good enough there
        assert at(registered, setting, name).probability < 0.9


def test_exact_poses_drawn_from_it_confirm_what_is_stated(registered):
    assert simulate_plan(registered, 4000, rng=3).confirmed


def test_a_plan_in_a_file_is_the_same_and_plans_again(registered, tmp_path):
    path = registered.write(tmp_path / "plan.json")
    again = read_plan(path)
    assert again == registered
    assert again.settings[0].registered.by_surfaces == registered.settings[0].registered.by_surfaces
    asked = again.request
    assert InspectionOptions.of_request(asked).registration == asked.registration
    assert (asked.registration.method, asked.registration.surfaces_mm) == ("own edges", 0.03)


def test_measuring_takes_the_surfaces_of_the_plan(block, registered):
    measurer = Measurer(registered, block)
    assert measurer._surfaces_mm(Registration.own_edges()) == 0.03
    assert measurer._surfaces_mm(Registration.own_edges(0.07)) == 0.07


def registration_of(model, cam2world, free=()):
    """Joint covariance that `measure` has after it finds every sample, 0.15 px off; some surfaces may be free."""
    prior = prior_covariance(model, ROBOT.covariance, 0.03)
    prior[POSE:, POSE:] = np.diag(surface_variances(model, 0.03, CAMERA, free))
    task = registration_task(model, CAMERA, cam2world, prior, 0.15)
    nothing = np.zeros(len(prior))
    design = task.design(nothing, task.predicted(nothing)[1])
    variance = 0.15**2 * solving.CORRELATION_PX / solving.STEP_PX
    rows = solving.rows_of(task, design, np.zeros(len(design)), np.full(len(design), 1 / variance))
    return posterior(prior, rows, 0.15**2).covariance


def test_no_pose_is_said_to_be_known_better_than_registration_finds_it(block, registered):
    """Along every direction, from poses all around that see something of the part."""
    model = PartModel(block, registered.targets)
    request = requested(block, registered)
    edges = planned_edges(request, 0.03)
    places = np.random.default_rng(5).normal(size=(40, 3))
    places = [30.0, 30.0, 20.0] + 300.0 * places / np.linalg.norm(places, axis=1, keepdims=True)
    ratios = []
    for pose in look_at(places, [30.0, 30.0, 20.0]):
        known = edges.poses(np.linalg.inv(pose)[None]).covariance[0]
        exact = registration_of(model, pose)[:POSE, :POSE]
        # standard deviations along the directions that matter most to their difference
        ratios.append(np.sqrt(scipy.linalg.eigh(known, exact, eigvals_only=True)))
    ratios = np.array(ratios)
    assert ratios.min() > 0.99
    assert np.median(ratios) < 1.5


def test_values_are_said_to_be_no_better_than_registration_finds_them(block, registered):
    """The variance by pose and surfaces together, with derivatives that the prediction does not share."""
    (setting,) = registered.settings
    model = PartModel(block, registered.targets)
    pose = np.asarray(setting.cam2world)
    for name in setting.entities:
        covariance = registration_of(model, pose, model.free_of[name])
        found = at(registered, setting, name, setting.registered).budget
        stated = found["translation"] + found["rotation"] + found["surfaces"]
        gradient = value_gradient(model, registered.targets[name], name, pose)
        exact = gradient @ covariance @ gradient
        assert exact < stated * 1.05
        assert stated < 16 * exact


def value_gradient(model, target, name, pose):
    """Derivatives of a value by pose and surfaces: points carried back to planes that are moved."""
    measurand = target.measurand
    gradient = np.zeros(model.n_unknowns)
    for i in range(len(gradient)):
        step = 1e-5 if 3 <= i < POSE else 1e-3
        values = []
        for sign in (1, -1):
            x = np.zeros(model.n_unknowns)
            x[i] = sign * step
            seen_from = displaced(pose, x[:POSE])[0]
            fitted = []
            for edge, frame in zip(model.measured[name], measurand.frames, strict=True):
                ends = np.array([edge.geometry.p, edge.geometry.q])
                normal = np.cross(frame.x, frame.y)
                # the real edge is off with its surfaces, across its plane
                off = model.displacement(edge, ends) @ x[model.unknowns_of(edge)] @ normal
                real = ends + off[:, None] * normal
                local = world_to_cam(real, seen_from)
                ways = local / local[:, 2:] @ pose[:3, :3].T
                reach = (frame.origin - pose[:3, 3]) @ normal / (ways @ normal)
                flat = pose[:3, 3] + reach[:, None] * ways - frame.origin
                x_ = flat @ frame.x
                y_ = flat @ frame.y
                slope = (y_[1] - y_[0]) / (x_[1] - x_[0])
                fitted.append(np.array([[y_.mean() - slope * x_.mean(), slope]]))
            values.append(measurand.value(fitted)[0])
        gradient[i] = (values[0] - values[1]) / (2 * step)
    return gradient


def test_another_arm_begins_with_another_uncertainty(block, registered):
    """What edges add does not depend on it."""
    arm = PoseUncertainty.isotropic(translation_mm=0.25, rotation_rad=0.004)
    request = replace(requested(block, registered), pose_uncertainty=arm)
    pose = np.asarray(registered.settings[0].cam2world)
    exact = planned_edges(request, 0.03).poses(np.linalg.inv(pose)[None]).covariance[0]
    known = registered.settings[0].registered
    found = known.with_prior(ROBOT.covariance, arm.covariance).pose_uncertainty.covariance
    scale = np.sqrt(np.diag(exact))
    np.testing.assert_allclose(
        found / np.outer(scale, scale), exact / np.outer(scale, scale), atol=1e-4
    )
    same = known.with_prior(ROBOT.covariance, ROBOT.covariance).pose_uncertainty
    np.testing.assert_allclose(same.sigmas, known.pose_uncertainty.sigmas, rtol=1e-4)


def test_hidden_edges_do_not_count(block, registered):
    known = planned_edges(requested(block, registered), 0.03).stretches
    model = PartModel(block, registered.targets)
    counts = np.bincount(known.edge)
    normals = np.concatenate(
        [
            edge.at((np.arange(n) + 0.5) / n)[2]
            for edge, n in zip(model.edges.edges, counts, strict=True)
        ]
    )
    seen = 0
    for place in np.random.default_rng(2).normal(size=(30, 3)):
        pose = np.eye(4)
        pose[:3, 3] = [30.0, 30.0, 20.0] + 300.0 * place / np.linalg.norm(place)
        visible = model.edges._visible(known.points, normals, np.zeros(len(normals)), pose)
        counted = [_free_ways(known, m, pose[:3, 3]) == 4 for m in range(len(visible))]
        assert not (counted & ~visible).any()
        seen += np.sum(counted) / visible.sum()
    assert seen / 30 > 0.8


@pytest.fixture(scope="module")
def edges_of_block(block):
    """A request for edges, whose lengths are measured on whole pixels."""
    ids = [edge.id for edge in block.straight_edges()][::4]
    options = InspectionOptions(effort=QUICK)
    resolved = resolve_request(block, ids, CAMERA, ROBOT, options)
    return _problem(block, resolved, options, Deadline(None, 0.0))


def test_lengths_of_edges_are_as_probable_as_with_the_covariance_that_is_left(edges_of_block):
    before = replace(edges_of_block, accuracy=0.998)
    request = replace(before, registered=planned_edges(before, 0.03))
    (pose,) = look_at([[150.0, -120.0, 260.0]], [30.0, 30.0, 20.0])
    stated = request.objective.probability(pose[None])[0]
    known = request.known_at(pose, request.names)
    assert known.by_surfaces == {}
    for k, name in enumerate(request.names):
        left = known.of_target(request.means, name).pose_uncertainty
        given = replace(before, registered=left).objective.probability(pose[None])[0]
        assert given[k] == pytest.approx(stated[k], abs=1e-6)
    assert stated.sum() > before.objective.probability(pose[None])[0].sum() + 0.01


def test_the_bound_uses_no_registration(edges_of_block):
    """What it asks of images is necessary however well poses are known."""
    exact = PoseUncertainty.isotropic(translation_mm=1e-4, rotation_rad=1e-6)
    request = replace(edges_of_block, registered=exact)
    least = least_images_mm(request)
    np.testing.assert_array_equal(least, least_images_mm(edges_of_block))
    assert request.requirements == edges_of_block.requirements
    places = np.random.default_rng(7).normal(size=(400, 3))
    places *= np.random.default_rng(8).uniform(400, 3000, (400, 1)) / np.linalg.norm(
        places, axis=1, keepdims=True
    )
    poses = look_at(places, [30.0, 30.0, 20.0])
    local = world_to_cam(request.ends, poses)
    images = local[..., :2] / local[..., 2:] * CAMERA.image_distance_mm
    length = np.linalg.norm(images[..., 1, :] - images[..., 0, :], axis=-1)
    short = length < least
    assert short.sum() > 100
    assert request.objective.probability(poses)[short].max() < request.probability
    assert (request.objective.probability(poses) >= request.probability).sum() > 100


def test_a_given_covariance_counts_for_values_alone(block):
    exact = PoseUncertainty.isotropic(translation_mm=0.01, rotation_rad=0.0001)
    plan = planned(block, exact)
    assert plan.complete
    for setting in plan.settings:
        assert setting.registered.pose_uncertainty == exact
        for name in setting.entities:
            means = replace(plan.means, pose_uncertainty=exact)
            stated = plan.targets[name].describe(setting.cam2world, means).probability
            assert setting.probability[name] == pytest.approx(stated, abs=1e-9)
    windows = search_windows_px(plan, plan.settings[0])
    shown = changed(plan, pose_uncertainty=exact)
    assert min(windows.values()) > 10 * max(search_windows_px(shown, plan.settings[0]).values())


@pytest.mark.parametrize(
    ("how", "words"),
    [
        ("edges", "registration must be Registration.own_edges"),
        (Registration.given({1: np.eye(4)}), "given poses without one"),
    ],
)
def test_what_a_plan_cannot_know_is_refused_before_any_work(block, how, words):
    with pytest.raises(RequestError, match=words):
        planned(block, how)


def test_a_word_of_the_command_line_is_no_method():
    """It would be measured as from planned poses."""
    with pytest.raises(RequestError, match=r"method must be one of 'planned', .* Got 'edges'\."):
        Registration("edges")


def test_planned_poses_are_no_registration(block):
    options = InspectionOptions(registration=Registration.none())
    record = options.registration_record
    assert record == RegistrationRecord(PLANNED)
    assert registration("none") == record
    problem = registered_problem(problem_of(block, ASKED), record)
    assert problem.registered is None
    assert not problem.reads.registers
    assert registered_problem(problem_of(block, ASKED), None).reads.registers


ASKED = {
    "width": Dimension.distance(25, 27, tolerance_mm=(-0.24, 0.24)),
    "height": Dimension.distance(24, 26, tolerance_mm=(-0.24, 0.24)),
    "angle": Dimension.angle(24, 25, tolerance_deg=(-0.3, 0.3)),
    "other": Dimension.angle(26, 27, tolerance_deg=(-0.3, 0.3)),
    "edge": 24,
}


def problem_of(block, items):
    options = InspectionOptions(effort=QUICK)
    resolved = resolve_request(block, items, CAMERA, ROBOT, options)
    return _problem(block, resolved, options, Deadline(None, 0.0))


@pytest.fixture(scope="module")
def much_asked(block):
    return problem_of(block, ASKED)


def poses_above(count, seed=2):
    places = np.random.default_rng(seed).normal(size=(count, 3))
    places[:, 2] = 2.0 + np.abs(places[:, 2])
    places = 300.0 * places / np.linalg.norm(places, axis=1, keepdims=True)
    return look_at(np.array([30.0, 30.0, 20.0]) + places, [30.0, 30.0, 20.0])


def with_edges(problem):
    return replace(problem, registered=planned_edges(problem, 0.03))


def test_what_else_is_asked_does_not_change_how_sure_a_target_is(much_asked):
    """To the last bit, for random requests and poses."""
    rng = np.random.default_rng(11)
    alone = {name: with_edges(much_asked.restricted_to([name])) for name in ASKED}
    for pose in poses_above(4):
        chosen = [str(name) for name in rng.permutation(list(ASKED))[: rng.integers(2, 6)]]
        known = with_edges(much_asked.restricted_to(chosen)).known_at(pose, chosen)
        for name in chosen:
            single = alone[name].known_at(pose, [name])
            np.testing.assert_array_equal(known.covariance, single.covariance)
            assert known.by_surfaces.get(name) == single.by_surfaces.get(name)


def test_registered_is_never_worse_than_unregistered(much_asked):
    """The uncertainty of values with the same surfaces, whatever is asked beside them."""
    registered = with_edges(much_asked)
    gains = []
    for pose in poses_above(6, seed=3):
        known = registered.known_at(pose, list(ASKED))
        for target in registered.targets:
            before = target.describe(pose, replace(much_asked.means, surfaces_mm=0.03))
            after = target.describe(pose, known.of_target(registered.means, target.name))
            gains.append(after.standard_uncertainty / before.standard_uncertainty)
    assert max(gains) <= 1 + 1e-9
    assert min(gains) < 0.5


def test_lengths_of_edges_have_poses_of_their_own(block):
    """The faces at an edge's ends are free for its length alone; what a camera does not see tells it nothing."""
    edges = problem_of(block, {f"edge {k}": k for k in (24, 25, 26)})
    registered = with_edges(edges)
    alone = with_edges(edges.restricted_to(["edge 24"]))
    scale = np.sqrt(np.diag(ROBOT.covariance))
    units = np.outer(scale, scale)
    for pose in poses_above(3, seed=4):
        known = registered.known_at(pose, edges.names)
        single = alone.known_at(pose, ["edge 24"])
        np.testing.assert_array_equal(known.by_edge["edge 24"], single.by_edge["edge 24"])
        for covariance in known.by_edge.values():
            assert np.linalg.eigvalsh((ROBOT.covariance - covariance) / units).min() > -1e-6
            assert np.linalg.eigvalsh((covariance - known.covariance) / units).min() > -1e-9
    away = look_at([[30.0, 30.0, 400.0]], [30.0, 30.0, 900.0])[0]
    known = registered.known_at(away, ["edge 24"])
    for covariance in (known.covariance, known.by_edge["edge 24"]):
        np.testing.assert_allclose(covariance / units, np.eye(6), rtol=1e-6, atol=1e-9)


def test_draws_for_a_length_have_the_covariance_of_its_edge():
    """The same draws as those of the setting, scaled: so all values of a draw are of one pose."""
    (pose,) = look_at([[0.0, 0.0, 300.0]], [0.0, 0.0, 0.0])
    wide = {"edge": 4 * ROBOT.covariance, "same": ROBOT.covariance}
    values = ValuePoses(pose, PoseKnowledge(ROBOT.covariance, by_edge=wide), [1])
    drawn = values.of(np.zeros((50, 4, 4)))
    np.testing.assert_array_equal(values.for_target("same", drawn), drawn)
    np.testing.assert_array_equal(values.for_target("other", drawn), drawn)
    off = values.for_target("edge", drawn)[:, :3, 3] - pose[:3, 3]
    np.testing.assert_allclose(off, 2 * (drawn[:, :3, 3] - pose[:3, 3]), atol=1e-12)
