"""Values larger than the field of view: two settings measure one end each."""

import math
from dataclasses import replace

import numpy as np
import pytest
from measured_plate import thick_plate, upper_rims
from plan_examples import witness

from errors.measurands import End, Line, Localisation, SplitModel, measurand, split_model
from planner import (
    Camera,
    Dimension,
    Effort,
    InspectionPlan,
    PoseUncertainty,
    RequestError,
    measure,
    plan_inspection,
)
from planner.bound.lower_bound import exclusive_entities
from planner.camera.pose import look_at
from planner.exceptions import PlanFileError
from planner.measuring.rehearsal import Rehearsal
from planner.report.wording import brief_verdict
from planner.request.reach import entity_space
from planner.request.resolve import resolve_wanted
from planner.request.split import WHOLE, split_problem, target_and_end
from planner.request.targets import (
    END_SHARE,
    MeasuredPart,
    WitnessChoice,
    end_of,
    kept_witnesses,
    targets_of,
)
from planner.search import split_plan
from planner.search.columns import perturbed
from planner.search.plan_setting import setting_at, without
from planner.sensor_setting import setting_name
from planner.verify.simulate_split import cameras_of

CAMERA = Camera.named("basler-acA2440-20gm-35mm")
UNCERTAINTY = PoseUncertainty.isotropic(translation_mm=0.03, rotation_rad=1e-4)
EFFORT = Effort(
    viewpoints=20, pricing_rounds=3, refutations=1, bound_nodes=1000, margin_generations=3
)
# the field is 52 x 43 mm
LENGTH_MM = 80.0
ERROR_MM = 0.1


@pytest.fixture(scope="module")
def solid():
    return thick_plate()


@pytest.fixture(scope="module")
def wanted(solid):
    """A bore, and a length of 80 mm."""
    sides = [[[x, 0.0, 40.0], [x, 50.0, 40.0]] for x in (0.0, LENGTH_MM)]
    return {
        "bore": Dimension.diameter(upper_rims(solid)[0], max_error_mm=ERROR_MM),
        "length": Dimension.distance(*sides, max_error_mm=ERROR_MM),
    }


def planned(solid, wanted, **options):
    options = {"effort": EFFORT, "probability": 0.8, **options}
    return plan_inspection(solid, wanted, CAMERA, UNCERTAINTY, **options)


@pytest.fixture(scope="module")
def plan(solid, wanted):
    return planned(solid, wanted)


def test_one_image_does_not_hold_the_length(solid, wanted):
    whole = planned(solid, wanted, split="never")
    assert list(whole.inspected) == ["bore"]
    assert "larger than the field of view" in whole.uninspectable["length"]
    assert not whole.split


def test_a_length_larger_than_the_field_is_measured_by_two_settings(plan):
    assert plan.complete
    assert sorted(plan.ends["length"]) == [0, 1]
    first, second = (plan.settings[plan.ends["length"][k]] for k in range(2))
    assert first is not second
    # each end has its own entity, and 1/sqrt(2) of the error
    for k, setting in enumerate((first, second)):
        end = targets_of(plan.targets, setting)["length"]
        assert end.entities == (plan.targets["length"].entities[k],)
        assert end.permitted_error == pytest.approx(ERROR_MM / math.sqrt(2))
        assert setting.p_all["length"] >= plan.probability
    value = plan.split["length"]
    assert plan.inspected["length"] == value.p_all
    assert plan.probability <= value.p_all <= value.probability


def test_ends_are_told_apart_whatever_objects_they_are(plan):
    """Lights keep the edges of what a setting reads: keyed by name alone, an end would get those of the other."""
    keys = {MeasuredPart.of("length", setting) for setting in plan.settings}
    assert keys == {("length", None, 0), ("length", None, 1)}
    assert {MeasuredPart.of("bore", setting) for setting in plan.settings} == {("bore", None, None)}


def test_settings_that_lose_a_target_give_no_other_plan(solid, wanted, monkeypatch):
    """Moved off its limits, the setting of the bore falls short of the required P_all."""

    settle = split_plan.settle

    def settled(run, inspected, counted, **options):
        known = settle(run, inspected, counted, **options)
        fewer = [
            without(run.problem, setting, ["bore"]) if "bore" in setting.entities else setting
            for setting in known.settings
        ]
        return known._replace(settings=[setting for setting in fewer if setting.entities])

    monkeypatch.setattr(split_plan, "settle", settled)
    other = planned(solid, wanted)
    assert list(other.inspected) == ["bore"]
    assert not other.split


def test_the_variance_is_that_of_both_cameras(plan):
    """Straight above its entity, a camera that is off by t and turned by φ reads it off by t + z φ; both add up.

    The settings are tilted a little and off their entity, so the closed form holds within a few percent.
    """
    variance = 0.0
    for k in range(2):
        setting = plan.settings[plan.ends["length"][k]]
        middle = targets_of(plan.targets, setting)["length"].points.mean(axis=0)
        distance = float(np.linalg.norm(setting.position - middle))
        variance += 0.03**2 + (distance * 1e-4) ** 2 + 0.02**2 * 0.3**2
    assert plan.split["length"].standard_uncertainty == pytest.approx(math.sqrt(variance), rel=0.15)


def test_draws_without_error_models_agree(plan, solid):
    result = plan.simulate(20_000)
    rate = result.split["length"]
    assert rate.predicted == plan.split["length"].probability
    assert rate.confirms
    assert result.confirmed
    # P_all is a lower bound of what also asks for visibility, focus and the field
    assert plan.split["length"].p_all <= rate.high


def test_a_face_that_carries_both_entities_has_one_deviation(plan):
    """From two cameras straight above, both entities seem to move alike: the length hardly changes."""
    whole = replace(plan.targets["length"], surfaces_mm=0.5)
    poses = look_at([[x, 25.0, 290.0] for x in (0.0, LENGTH_MM)], [0.0, 25.0, 40.0], roll=0.0)
    poses[1, :3, :3] = poses[0, :3, :3]
    cameras = replace(cameras_of(plan, "length"), target=whole, planned=list(poses))
    exact = replace(cameras, target=replace(whole, surfaces_mm=0.0))
    spreads = []
    for each in (cameras, exact):
        draws = each.draws([1])
        still = [np.tile(pose, (2000, 1, 1)) for pose in poses]
        spreads.append(float(each.errors(draws, still)[0].std()))
    assert spreads[0] == pytest.approx(spreads[1], rel=0.1)


def test_the_bound_counts_each_entity(plan):
    """No image holds both sides, so two settings are needed; one would do if the bound were that of a whole."""
    assert plan.lower_bound == len(plan.settings) == 2
    assert "no two can be inspected together" in plan.bound_proof


@pytest.fixture(scope="module")
def three(solid):
    """Each side with its bore needs an image; the distance of the bores needs a third one, or both of these."""
    left, right = upper_rims(solid)
    sides = [[[x, 0.0, 40.0], [x, 50.0, 40.0]] for x in (0.0, LENGTH_MM)]
    return {
        "left": Dimension.centre_to_edge(left, sides[0], max_error_mm=ERROR_MM),
        "right": Dimension.centre_to_edge(right, sides[1], max_error_mm=ERROR_MM),
        "apart": Dimension.centre_distance(left, right, max_error_mm=ERROR_MM),
    }


def test_a_setting_is_saved(solid, three):
    saving = planned(solid, three)
    assert saving.complete
    assert list(saving.split) == ["apart"]
    assert len(saving.settings) == saving.lower_bound == 2
    assert saving.whole_bound == 0
    # other targets have the witnesses and all that they had as a whole
    for setting in saving.settings:
        (whole,) = set(setting.entities) - set(setting.ends)
        assert setting.p_all[whole] > 0.99


def test_a_plan_without_split_values_states_both_bounds(solid, three, monkeypatch, tmp_path):
    """Three settings are needed without split values, and two with them: the plan before ends is that of "never"."""
    monkeypatch.setattr(split_plan, "_other_plan", lambda *_: None)
    both = planned(solid, three)
    whole = planned(solid, three, split="never")
    assert both.settings == whole.settings
    assert whole.lower_bound == both.whole_bound == len(both.settings) == 3
    assert both.lower_bound == 2
    assert whole.whole_bound == 0
    assert "at least 2 are needed, and at least 3 without split values" in brief_verdict(both)
    assert InspectionPlan.read(both.write(tmp_path / "plan.json")) == both
    wrong = {**both.to_dict(), "whole_bound": 2}
    with pytest.raises(PlanFileError, match="whole_bound must be 0, or 3 to 3"):
        InspectionPlan.from_dict(wrong)


def test_an_end_that_falls_short_is_searched_again(solid, wanted, plan, monkeypatch):
    """One end is measured from the worst pose that serves: only a better one makes the value as sure as it was."""
    settle = split_plan.settle
    value_of = split_plan._SplitSearch._value
    sure = plan.split["length"].p_all - 0.002
    values = []

    def settled(run, inspected, counted, **options):
        known = settle(run, inspected, counted, **options)
        (index,) = (k for k, other in enumerate(known.settings) if "bore" not in other.entities)
        setting = known.settings[index]
        rng = np.random.default_rng(1)
        poses = perturbed(np.repeat(setting.cam2world[None], 3000, axis=0), 250.0, rng)
        judged = run.judge(poses)
        column = run.names.index(setting.entities[0])
        sureness = np.where(judged.inspects[:, column], judged.probability[:, column], 1.0)
        pose = poses[np.argmin(sureness)]
        worse = setting_at(run.problem, pose, setting.entities, "worse", 0)
        settings = [*known.settings[:index], worse, *known.settings[index + 1 :]]
        return known._replace(settings=settings)

    def valued(search, name, *settings):
        values.append(value_of(search, name, *settings))
        return values[-1]

    monkeypatch.setattr(split_plan, "settle", settled)
    monkeypatch.setattr(split_plan._SplitSearch, "_value", valued)
    monkeypatch.setattr(split_plan._SplitSearch, "_is_enough", lambda _, value: value.p_all >= sure)
    surer = planned(solid, wanted)
    assert values[0].p_all < sure
    assert surer.complete
    assert surer.split["length"].p_all >= sure


def problem_of(solid, wanted):
    from planner.inspection import visible_regions
    from planner.options import InspectionOptions
    from planner.resolve_request import problem_on, resolve_request

    options = InspectionOptions(effort=EFFORT, probability=0.8)
    request, entities = resolve_request(solid, wanted, CAMERA, UNCERTAINTY, options)
    regions = visible_regions(solid, entities, request)
    return problem_on(request, regions, request.targets)


@pytest.fixture(scope="module")
def short_problem(solid):
    """The problem of a distance that an image holds."""
    rims = upper_rims(solid)
    apart = Dimension.centre_distance(*rims, max_error_mm=ERROR_MM)
    bore = Dimension.diameter(rims[0], max_error_mm=ERROR_MM)
    return problem_of(solid, {"bore": bore, "apart": apart})


def test_ends_are_targets_that_a_whole_counts_for(short_problem):
    split = split_problem(short_problem, ["apart"], ["apart"])
    assert split.owner.tolist() == [0, 1, 1]
    assert split.entity.tolist() == [WHOLE, 0, 1]
    first = split.problem.targets[1]
    assert target_and_end(first.name) == ("apart", 0)
    whole = first.choosing(0)
    end = first.choosing(1)
    assert whole.permitted_error == ERROR_MM
    assert end.permitted_error == pytest.approx(END_SHARE * ERROR_MM)
    assert isinstance(end.measurand, End)
    # a witness that was chosen stays as it is
    assert end.choosing(0).permitted_error == end.permitted_error
    assert entity_space(split.problem.space) is entity_space(short_problem.space)
    nothing = split_problem(short_problem, [])
    assert nothing.problem is short_problem


def test_no_pose_inspects_a_whole_without_the_conditions_of_its_ends(short_problem):
    """What the proof needs: at a pose that meets all constraints for the whole, each end meets those of the bound."""
    split = split_problem(short_problem, ["apart"], any_way=True)
    rng = np.random.default_rng(3)
    eyes = np.array([40.0, 25.0, 290.0]) + rng.normal(size=(4000, 3)) * [2.0, 2.0, 1.0]
    targets = np.array([40.0, 25.0, 40.0]) + rng.normal(size=(4000, 3)) * [2.0, 2.0, 0.0]
    poses = np.concatenate(
        [look_at(eye[None], at, roll=0.0) for eye, at in zip(eyes, targets, strict=True)]
    )
    names = ("focus_mm", "field_of_view_px", "visibility")
    whole = short_problem.constraints.margins(poses, names)
    ends = split.problem.constraints.margins(poses, names)
    met = np.logical_and.reduce([whole[name][:, 1] >= 0 for name in names])
    assert 20 < met.sum() < 3900
    for name in names:
        assert (ends[name][met][:, 1:] >= 0).all()


def test_ends_too_far_apart_exclude_each_other(solid, wanted):
    alone = problem_of(solid, {"length": wanted["length"]})
    split = split_problem(alone, ["length"], any_way=True)
    exclusive = exclusive_entities(split.problem, np.arange(2), np.eye(2, dtype=bool))
    assert exclusive.tolist() == [0, 1]


def test_registered_poses_have_covariances_of_their_own():
    """Two poses known to s₁ and s₂: the variance of the sum is that of both."""
    lines = [Line([0.0, y, 0.0], [40.0, y, 0.0]) for y in (0.0, 200.0)]

    def model(sigma):
        return measurand("distance", lines).model(
            image_distance_mm=26.0,
            pixel_pitch_mm=(0.0035, 0.0035),
            pose_covariance=np.diag([sigma**2] * 3 + [1e-18] * 3),
            localisation=Localisation.gaussian(0.0, floor_px=0.0),
            permitted_error=0.05,
        )

    above = np.array([[1, 0, 0, -20], [0, -1, 0, 0], [0, 0, -1, 200], [0, 0, 0, 1.0]])
    other = above + np.array([[0, 0, 0, 0], [0, 0, 0, 200], [0, 0, 0, 0], [0, 0, 0, 0]])
    split = SplitModel(model(0.03), model(0.04))
    assert split.end_uncertainties([above, other]) == pytest.approx([0.03, 0.04], rel=1e-6)
    assert split.standard_uncertainty([above, other]) == pytest.approx(0.05, rel=1e-6)
    assert split.probability([above, other]) == pytest.approx(math.erf(1 / math.sqrt(2)), abs=2e-4)


def test_a_plan_file_keeps_both_settings(plan, tmp_path):
    path = plan.simulated(500).write(tmp_path / "plan.json")
    again = InspectionPlan.read(path)
    assert again == plan.simulated(500)
    assert again.ends == plan.ends
    assert again.request.split == "auto"


def without_value(data):
    del data["split"]


def without_end(data):
    for setting in data["settings"]:
        setting["ends"] = dict.fromkeys(setting.get("ends", {}), 0)


def unsure(data):
    data["split"]["length"]["p_all"] = 0.1


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (without_value, "split.length must be given"),
        (without_end, "split.length must have each of its two ends in one setting"),
        (unsure, "split.length.p_all must be at least the required probability"),
    ],
)
def test_a_plan_file_that_contradicts_itself_is_refused(plan, damage, message):
    data = plan.to_dict()
    damage(data)
    with pytest.raises(PlanFileError, match=message):
        InspectionPlan.from_dict(data)


def test_the_word_is_checked(solid, wanted):
    with pytest.raises(RequestError, match="split must be 'auto' or 'never'"):
        planned(solid, wanted, split="always")


def test_registered_values_of_rendered_images_lie_within_u(solid, plan):
    rehearsal = Rehearsal(plan, solid, seed=2)
    images = {rendered.shot.name: rendered.grey for rendered in rehearsal.images()}
    results = measure(plan, solid, images)
    length = results["length"]
    assert length.measured, length.reason
    (truth,) = {
        values["length"] for values in rehearsal.truth.values.values() if "length" in values
    }
    assert abs(length.value - truth) <= length.expanded_uncertainty
    images_of_ends = [setting_name(plan.ends["length"][k]) for k in range(2)]
    assert [reading.image for reading in length.readings] == images_of_ends


def bolt_of(solid):
    """The position of the left bore to the right side and the right bore."""
    left, right = upper_rims(solid)
    side = next(
        k
        for k in range(len(solid.edges))
        if np.allclose(solid.edge_points(k).mean(axis=0), [LENGTH_MM, 25.0, 40.0])
    )
    return Dimension.position(left, [side, right], 1.2, share=0.25)


@pytest.mark.parametrize("seed", [0, 2])
def test_the_search_splits_a_position(solid, wanted, seed):
    """Its entities are 73 mm apart, and the image covers 69 mm where the lens focuses."""
    asked = {"bore": wanted["bore"], "bolt": bolt_of(solid)}
    plan = planned(solid, asked, effort=Effort.named("quick"), rng=seed)
    assert list(plan.split) == ["bolt"]
    assert len(plan.settings) == 2
    assert plan.inspected["bolt"] >= 0.8
    whole = planned(solid, asked, effort=EFFORT, split="never")
    assert "larger than the field of view" in whole.uninspectable["bolt"]


@pytest.fixture(scope="module")
def bolt_plan(solid, plan):
    """The left bore is 60 mm from its datums, the right side and the right bore: an image for each end."""
    _, (bolt,) = resolve_wanted(solid, {"bolt": bolt_of(solid)}, 0.8)
    request = replace(plan.request, targets=(plan.targets["bore"], bolt))
    poses = look_at([[x, 25.0, 290.0] for x in (20.0, 61.5)], [40.0, 25.0, 40.0], roll=0.0)
    settings = []
    for k, pose in enumerate(poses):
        straight = pose.copy()
        # the side of 50 mm lies along the longer side of the image
        straight[:3, :3] = [[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]
        settings.append(
            replace(
                plan.settings[0],
                cam2world=straight,
                entities=("bolt",),
                ends={"bolt": k},
                witness={},
                probability={"bolt": 0.9},
                p_all={"bolt": 0.9},
            )
        )
    first = replace(
        settings[0],
        entities=("bore", "bolt"),
        probability={"bore": 0.9, "bolt": 0.9},
        p_all={"bore": 0.9, "bolt": 0.9},
    )
    value = replace(plan.split["length"], probability=0.9, p_all=0.9)
    return replace(
        plan,
        request=request,
        settings=(first, settings[1]),
        uninspectable={},
        split={"bolt": value},
        simulation=None,
    )


def test_a_hole_far_from_its_datums_is_an_end_of_its_own(bolt_plan):
    """Both are 60 mm apart, and the field is 52 x 43 mm."""
    bolt = bolt_plan.targets["bolt"]
    ends = [targets_of(bolt_plan.targets, setting)["bolt"] for setting in bolt_plan.settings]
    assert [len(end.entities) for end in ends] == [1, 2]
    assert ends[0].entities + ends[1].entities == bolt.entities
    assert ends[0].permitted_error == pytest.approx(END_SHARE * bolt.permitted_error)


def test_draws_without_error_models_agree_for_a_position(bolt_plan):
    """Cameras, points and faces are drawn, and the frame is found from what is fitted."""
    cameras = cameras_of(bolt_plan, "bolt")
    means = replace(bolt_plan.request.means, localisation=bolt_plan.targets["bolt"].localisation)
    model = split_model(cameras.target.description(means))
    poses = np.linalg.inv(np.array(cameras.planned))
    predicted = model.probability(poses)
    n = 20_000
    draws = cameras.draws([5])
    error, outside = cameras.errors(draws, draws.poses(n))
    assert not outside.any()
    assert 0.5 < predicted < 0.999
    permitted = cameras.target.permitted_error
    assert predicted == pytest.approx(np.mean(np.abs(error) <= permitted), abs=0.01)
    # straight above, a camera is off by its place, and by its tilt times the height
    least = 2 * math.sqrt(2 * (0.03**2 + (250 * 1e-4) ** 2))
    assert model.standard_uncertainty(poses) == pytest.approx(least, rel=0.2)


def test_a_split_value_says_why_its_image_cannot_be_used(solid, plan):
    """An image without any edge cannot be registered, and each target of it says so."""
    width, height = CAMERA.resolution
    images = {f"setting_{k:02}": np.full((height, width), 120 + k, dtype=np.uint8) for k in (1, 2)}
    results = measure(plan, solid, images)
    reason = results["length"].reason
    for name in ("setting_01", "setting_02"):
        assert f"{name}: the image cannot be registered" in reason


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_rendered_holes_lie_within_u_of_their_positions(solid, bolt_plan, seed):
    # `benchmarks/images/rendered_positions.py` counts over hundreds of draws
    rehearsal = Rehearsal(bolt_plan, solid, seed=seed)
    images = {rendered.shot.name: rendered.grey for rendered in rehearsal.images()}
    bolt = measure(bolt_plan, solid, images)["bolt"]
    assert bolt.measured, bolt.reason
    assert [reading.image for reading in bolt.readings] == ["setting_01"] + 2 * ["setting_02"]
    truths = [values["bolt"] for values in rehearsal.truth.values.values()]
    assert abs(bolt.value - truths[0]) <= bolt.expanded_uncertainty


def test_edges_longer_than_the_field_have_stretches():
    """Two edges of 160 mm, 100 mm apart, and three stretches of each: no image of 60 mm holds a pair."""

    def pair(first, last):
        lines = [Line([first, y, 0.0], [last, y, 0.0]) for y in (0.0, 100.0)]
        return witness("distance", (f"a{first}", f"b{first}"), lines)

    witnesses = [pair(0.0, 160.0), pair(10.0, 30.0), pair(70.0, 90.0), pair(130.0, 150.0)]
    choice = WitnessChoice(4, 60.0, 20.0, apart=True)
    assert kept_witnesses(witnesses, choice) == [2]
    assert kept_witnesses(witnesses, choice._replace(apart=False)) == [0]
    # whole edges that an image holds one by one stay whole
    assert kept_witnesses(witnesses, choice._replace(widest_mm=165.0, apart=True))[0] == 1
    assert kept_witnesses(witnesses[:1], choice._replace(widest_mm=170.0)) == [0]


def test_the_end_of_a_value_has_its_share(plan):
    whole = plan.targets["length"]
    end = end_of(whole, 1)
    assert end.nominal == pytest.approx(LENGTH_MM)
    assert end.tolerance is None
    assert end.geometry == whole.geometry[1:]
