"""Dimensions from the request to the plan: resolved, planned, simulated, kept."""

import json
import math
import re
from dataclasses import replace
from itertools import product
from pathlib import Path

import cv2
import numpy as np
import pytest
from holed_plate import (
    BACK,
    CAMERA,
    FRONT,
    HOLES,
    LEFT,
    QUICK,
    UNCERTAINTY,
    holed_plate,
    upper_rims,
)
from plan_examples import BRIEF

from aspectgraph import Solid
from errors.measurands.measurand import kinds
from planner import (
    Camera,
    Dimension,
    InspectionOptions,
    Localisation,
    PlanFileError,
    PoseUncertainty,
    ReasonKind,
    RequestError,
    look_at,
    plan_inspection,
    predict,
    read_plan,
)
from planner.bound.pose_space import least_images_mm
from planner.report.terminal_tables import print_plan
from planner.request.problem import Problem
from planner.request.reach import TargetSpace
from planner.request.resolve import resolve_wanted
from planner.verify.simulate_setting import displaced_poses, measured_errors

FINE = Localisation.gaussian(0.1)


@pytest.fixture(scope="module")
def solid():
    return holed_plate()


@pytest.fixture(scope="module")
def wanted(solid):
    left, right = upper_rims(solid)
    return {
        "bore": Dimension.diameter(left, max_error_mm=0.09),
        "pitch": Dimension.centre_distance(left, right, max_error_mm=0.1),
        "depth": Dimension.distance(FRONT, BACK, max_error_mm=0.1),
        "margin": Dimension.centre_to_edge(right, LEFT, max_error_mm=0.15),
        "corner": Dimension.angle(FRONT, LEFT, max_error_deg=0.2),
        "front": FRONT,
    }


@pytest.fixture(scope="module")
def plan(solid, wanted):
    options = {"localisation": FINE, "effort": QUICK, "accuracy": 0.98, "probability": 0.8}
    return plan_inspection(solid, wanted, CAMERA, UNCERTAINTY, **options)


def test_the_plan_measures_what_was_asked_and_simulation_agrees(plan, wanted):
    assert plan.complete
    assert set(plan.inspected) == set(wanted)
    assert plan.dimensions["pitch"].nominal == pytest.approx(40.0)
    assert plan.dimensions["bore"].nominal == pytest.approx(2 * HOLES["left"][1])
    assert plan.dimensions["margin"].nominal == pytest.approx(60.0)
    assert plan.dimensions["corner"].nominal == pytest.approx(90.0)
    assert 1 <= plan.lower_bound <= len(plan.settings)
    found = plan.simulate(6000, rng=1)
    assert found.confirmed
    assert found.worst_difference < 0.02


def test_a_plan_comes_back_as_it_was_written(plan, tmp_path):
    plan.write(tmp_path / "plan.json")
    assert read_plan(tmp_path / "plan.json") == plan
    data = json.loads((tmp_path / "plan.json").read_text())
    stored = data["targets"]
    assert stored["depth"]["unit"] == "mm"
    for change, message in (
        (
            {"targets": {**stored, "depth": {**stored["depth"], "nominal": 51.0}}},
            r"targets\.depth\.nominal must be that",
        ),
        ({"targets": {**stored, "width": stored["depth"]}}, "must name every target once"),
    ):
        (tmp_path / "damaged.json").write_text(json.dumps({**data, **change}))
        with pytest.raises(PlanFileError, match=message):
            read_plan(tmp_path / "damaged.json")


def test_a_source_of_variance_is_missed_in_a_file(plan):
    data = json.loads(json.dumps(plan.to_dict()))
    for setting in data["settings"]:
        for measurement in setting["measurements"].values():
            measurement["budget"].pop("localisation_floor")
    with pytest.raises(PlanFileError, match=r"budget\.localisation_floor must be given"):
        type(plan).from_dict(data)


def test_the_default_of_dimensions_is_that_of_sub_pixel_work(solid, wanted):
    pose = look_at([[20.0, 25.0, 410.0]], [20.0, 25.0, 10.0])[0]
    bore = {"bore": wanted["bore"]}
    by_default = predict(solid, bore, pose, CAMERA, UNCERTAINTY)["bore"]
    how = Localisation("gaussian", 0.1, floor_px=0.05)
    options = InspectionOptions(surfaces_mm=0.02)
    told = predict(solid, bore, pose, CAMERA, UNCERTAINTY, localisation=how, options=options)
    assert by_default == told["bore"]
    # all points farther out by 0.05 px, at 400 mm, on both sides
    pixel = 400 / CAMERA.image_distance_mm * CAMERA.pixel_pitch_mm[0]
    floor = math.sqrt(by_default.budget["localisation_floor"])
    assert floor == pytest.approx(2 * 0.05 * pixel, rel=0.01)
    diameter = 2 * HOLES["left"][1]
    assert math.sqrt(by_default.budget["surfaces"]) == pytest.approx(
        diameter * 0.02 / 400, rel=0.01
    )
    # the paper's rule of an entity without a kind stays: whole pixels, and faces where they are
    rim = predict(solid, {"bore": wanted["bore"].entities[0]}, pose, CAMERA, UNCERTAINTY)["bore"]
    assert rim.budget["localisation_floor"] == rim.budget["surfaces"] == 0.0


@pytest.mark.parametrize("how", [Localisation.gaussian(0.0, floor_px=0.0), FINE, None])
def test_the_bound_asks_no_length_of_an_image_whatever_its_errors(solid, wanted, how):
    """What it uses is necessary without any error, so a floor or a face that is off cannot break it."""
    from aspectgraph import compute_regions

    entities, targets = resolve_wanted(solid, wanted, 0.98, as_lengths=True)
    regions = compute_regions(solid, entities, workspace=[[-400] * 3, [500] * 3])
    space = TargetSpace.of(regions, targets)
    names = tuple(target.name for target in targets)
    request = Problem(
        space, names, CAMERA, UNCERTAINTY, targets=targets, localisation=how, surfaces_mm=0.5
    )
    assert least_images_mm(request).tolist() == [0.0] * len(targets)


def test_edges_alone_are_planned_as_before(solid):
    plan = plan_inspection(solid, {"front": FRONT}, CAMERA, UNCERTAINTY, effort=QUICK)
    assert plan.dimensions == {}
    assert plan.to_dict()["targets"]["front"]["kind"] == "edge"


def test_a_dimension_is_observable_where_all_its_entities_are(solid, wanted):
    from aspectgraph import compute_regions

    entities, targets = resolve_wanted(solid, wanted, 0.98)
    # the edge has its own name, the others their ids; no entity comes twice
    assert "front" in entities
    assert len({entity.edge_ids for entity in entities.values()}) == len(entities) == 5
    regions = compute_regions(solid, entities, workspace=[[-400] * 3, [500] * 3])
    space = TargetSpace.of(regions, targets)
    points = np.random.default_rng(0).uniform(-400, 500, (3000, 3))
    seen = dict(zip(entities, regions.observable(points).T, strict=True))
    for target, column in zip(targets, space.observable(points).T, strict=True):
        assert (column == np.all([seen[name] for name in target.witness.entities], axis=0)).all()
        inside = space.covering_cells([target.name]).sample(200, 0)
        assert space.observable(inside, [target.name]).all()
    assert not space.observable(points).all()
    assert space.observable(points).any(axis=0).all()


def test_the_circle_is_inside_what_must_be_in_the_picture(solid, wanted):
    """Margins of the polygon around it are smaller than those of 500 points on it, but not by much."""
    from aspectgraph import compute_regions

    entities, targets = resolve_wanted(solid, {"bore": wanted["bore"]}, 0.98)
    regions = compute_regions(solid, entities, workspace=[[-400] * 3, [500] * 3])
    (bore,) = targets
    space = TargetSpace.of(regions, targets)
    constraints = Problem(space, ("bore",), CAMERA, UNCERTAINTY, targets=targets).constraints
    rng = np.random.default_rng(4)
    poses = look_at(
        rng.uniform([-20, -50, 350], [60, 90, 450], (300, 3)),
        [20.0, 25.0, 10.0],
        roll=rng.uniform(0, 6, 300),
    )
    margin = constraints.margins(poses)["field_of_view_px"][:, 0]
    circle = bore.measurand.geometry[0]
    points = circle.points(np.linspace(0, 2 * np.pi, 500))
    local = (points[None] - poses[:, None, :3, 3]) @ poses[:, :3, :3]
    pixels = (local / local[..., 2:] @ CAMERA.matrix.T)[..., :2]
    own = np.minimum(pixels + 0.5, np.array(CAMERA.resolution) - 0.5 - pixels).min(axis=(1, 2))
    assert (margin <= own + 1e-9).all()
    assert (margin >= own - 0.03 * np.ptp(pixels, axis=(1, 2))).all()


def test_prediction_from_a_pose(solid, wanted):
    pose = look_at([[40.0, 25.0, 410.0]], [40.0, 25.0, 10.0])[0]
    told = predict(solid, wanted, pose, CAMERA, UNCERTAINTY, localisation=FINE)
    assert list(told) == list(wanted)
    # straight on: 0.05 mm at 400 mm; 0.1 px on 16 points of both lines; turns move them by less
    depth = told["depth"]
    assert depth.observable
    assert depth.budget["translation"] == pytest.approx((50 * 0.05 / 400) ** 2, rel=0.01)
    pixel = CAMERA.pixel_pitch_mm[0] * 400 / CAMERA.image_distance_mm
    assert depth.budget["localisation"] == pytest.approx((0.1 * pixel) ** 2 * 2 / 16, rel=0.01)
    assert sum(depth.budget.values()) == pytest.approx(depth.standard_uncertainty**2)
    below = predict(
        solid, wanted, look_at([[40.0, 25.0, -390.0]], [40.0, 25.0, 10.0])[0], CAMERA, UNCERTAINTY
    )
    assert not below["depth"].observable
    assert not below["depth"].inspected
    assert math.isnan(below["depth"].probability)
    assert below["depth"].missed["visibility"] == 1.0


def test_a_prediction_says_which_constraint_is_missed_and_by_how_much(solid, wanted):
    """Not inspected, and not sure enough, are two things: an image too short says nothing of the probability."""
    pose = look_at([[40.0, 25.0, 410.0]], [40.0, 25.0, 10.0])[0]
    plain = predict(solid, wanted, pose, CAMERA, UNCERTAINTY, localisation=FINE)["depth"]
    assert plain.inspected
    assert plain.missed == {}
    assert plain.conditional_probability == plain.probability > 0.5
    length_px = plain.margins["resolution_mm"] / CAMERA.pixel_pitch_mm[0] + 20.0
    strict = InspectionOptions(min_length_px=length_px + 10.0)
    found = predict(solid, wanted, pose, CAMERA, UNCERTAINTY, localisation=FINE, options=strict)[
        "depth"
    ]
    assert found.observable
    assert not found.inspected
    assert math.isnan(found.probability)
    assert found.conditional_probability == plain.probability
    assert found.missed == {
        "resolution_mm": pytest.approx(10.0 * max(CAMERA.pixel_pitch_mm), rel=1e-6)
    }
    # improbable is not missed: the same pose, far less certain
    vague = PoseUncertainty.isotropic(translation_mm=30.0, rotation_rad=0.0)
    loose = InspectionOptions(focus_margin_mm=0.0, field_margin_px=0.0, visibility_radius_mm=0.0)
    unsure = predict(solid, wanted, pose, CAMERA, vague, localisation=FINE, options=loose)["depth"]
    assert unsure.inspected
    assert 0.0 < unsure.probability < 0.2


def test_of_what_is_behind_the_camera_there_is_no_probability(solid, wanted):
    pose = look_at([[40.0, 25.0, 410.0]], [40.0, 25.0, 800.0])[0]
    found = predict(solid, wanted, pose, CAMERA, UNCERTAINTY)["depth"]
    assert math.isnan(found.probability)
    assert math.isnan(found.conditional_probability)
    assert found.missed["focus_mm"] > 0
    assert found.missed["field_of_view_px"] > 0


@pytest.mark.parametrize(
    ("name", "item", "message"),
    [
        (
            "tilt",
            Dimension.distance(FRONT, LEFT),
            "dimension 'tilt': the edges of a distance must be parallel",
        ),
        (
            "same",
            Dimension.angle(FRONT, BACK),
            "dimension 'same': the edges of an angle must not be parallel",
        ),
        ("bore", Dimension.diameter("r99"), "dimension 'bore': .*r99"),
        (
            "bore",
            Dimension.diameter("r0", max_error_mm=0.01),
            "dimension 'bore': rim r0 must have at least .* chords",
        ),
        (
            "bore",
            Dimension.diameter(FRONT),
            "dimension 'bore': a diameter must have one rim or arc. Got one straight edge",
        ),
    ],
)
def test_what_cannot_be_measured_as_asked_is_refused_by_name(solid, name, item, message):
    with pytest.raises(RequestError, match=message):
        plan_inspection(solid, {name: item}, CAMERA, UNCERTAINTY, effort=QUICK)


# A plan for a calibrated camera: what it promises, OpenCV's projection and a simulation confirm.


FACES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
BOX = Solid(list(product((0, 40), (0, 30), (0, 20))), FACES, name="box")
K = np.array([[2320.0, 0.0, 1251.5], [0.0, 2326.0, 1009.0], [0.0, 0.0, 1.0]])
LENS = np.array([-0.21, 0.08, 1e-3, -6e-4, -0.01])
CAMERA_CALIBRATED_PLAN = Camera.from_opencv(
    K, LENS, (2448, 2048), pixel_pitch_mm=0.00345, f_number=8.0, focus_distance_mm=300.0
)
SIGMA = PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.001)
EDGES = {
    "top": [[0, 0, 20], [40, 0, 20]],
    "side": [[40, 0, 20], [40, 30, 20]],
    "low": [[0, 30, 0], [40, 30, 0]],
}


@pytest.fixture(scope="module")
def plan_calibrated_plan():
    return plan_inspection(BOX, EDGES, CAMERA_CALIBRATED_PLAN, SIGMA, accuracy=0.98, effort=BRIEF)


def test_every_edge_is_wholly_in_the_distorted_image(plan_calibrated_plan):
    assert set(plan_calibrated_plan.inspected) == set(EDGES)
    margin = plan_calibrated_plan.requirements["field_margin_px"]
    assert margin > 5
    for setting in plan_calibrated_plan.settings:
        pose = setting.cam2world
        for name in setting.entities:
            points = np.linspace(*np.array(EDGES[name], dtype=float), 50)
            local = (points - pose[:3, 3]) @ pose[:3, :3]
            seen = cv2.projectPoints(local, np.zeros(3), np.zeros(3), K, LENS)[0][:, 0]
            assert (seen >= margin - 0.5).all()
            assert (seen <= np.array([2448, 2048]) - 0.5 - margin).all()


def test_simulation_confirms_it(plan_calibrated_plan):
    result = plan_calibrated_plan.simulate(20_000)
    assert result.confirmed
    assert plan_calibrated_plan.lower_bound <= len(plan_calibrated_plan.settings)


def test_plan_is_read_back(plan_calibrated_plan, tmp_path):
    plan_calibrated_plan.write(tmp_path / "plan.json")
    again = read_plan(tmp_path / "plan.json")
    assert again.camera == CAMERA_CALIBRATED_PLAN
    assert again == plan_calibrated_plan


def test_what_is_half_outside_the_image_is_never_measured():
    wanted = {
        "width": Dimension.distance(EDGES["top"], [[0, 30, 20], [40, 30, 20]], max_error_mm=0.1)
    }
    _, targets = resolve_wanted(BOX, wanted, 0.98, as_lengths=True)
    planned = replace(targets[0], localisation=Localisation.fit(0.1))
    # x = 0 is seen at the tangent 0.5, x = 40 at 0.63; the side is at 0.55
    pose = look_at([[-150.0, 15.0, 320.0]], [-150.0, 15.0, 20.0])[0]
    poses = np.repeat(pose[None], 10, axis=0)
    error, outside = measured_errors(
        planned, pose, poses, CAMERA_CALIBRATED_PLAN, np.random.default_rng(0)
    )
    assert outside.all()
    assert not np.isfinite(error).any()


def test_a_length_measured_near_the_corner_is_undistorted():
    """Rounded to pixels of the distorted image and carried back, a distance is as sure as `predict` says, or surer."""
    wanted = {
        "width": Dimension.distance(EDGES["top"], [[0, 30, 20], [40, 30, 20]], max_error_mm=0.1)
    }
    pose = look_at([[-60.0, -50.0, 320.0]], [-70.0, -40.0, 20.0])[0]
    local = (BOX.vertices - pose[:3, 3]) @ pose[:3, :3]
    seen, plain = (
        cv2.projectPoints(local, np.zeros(3), np.zeros(3), K, lens)[0] for lens in (LENS, None)
    )
    assert np.linalg.norm(seen - plain, axis=-1).max() > 30
    box = InspectionOptions(workspace=[[-400, -400, -400], [440, 430, 420]])
    told = predict(BOX, wanted, pose, CAMERA_CALIBRATED_PLAN, SIGMA, options=box)["width"]
    _, targets = resolve_wanted(BOX, wanted, 0.98, as_lengths=True)
    rng = np.random.default_rng(5)
    planned = targets[0]
    error, outside = measured_errors(
        planned, pose, displaced_poses(pose, SIGMA, 4000, rng), CAMERA_CALIBRATED_PLAN, rng
    )
    assert not outside.any()
    assert abs(np.mean(error)) < told.standard_uncertainty
    assert 0.3 * told.standard_uncertainty < np.std(error) < 1.1 * told.standard_uncertainty


def test_what_is_not_sure_enough_says_which_share_would_do_and_that_share_does(solid):
    options = {"localisation": FINE, "effort": QUICK, "probability": 0.8}

    def planned(share):
        depth = Dimension.distance(FRONT, BACK, tolerance_mm=(-0.2, 0.2), share=share)
        return plan_inspection(solid, {"depth": depth}, CAMERA, UNCERTAINTY, **options)

    reason = planned(0.05).uninspectable["depth"]
    share = float(re.search(r"a share of ([0-9.]+), would do there\. The largest part", reason)[1])
    assert 0.05 < share < 1.0
    assert f"An error of up to {share * 0.2:.4g} mm" in reason
    plan = planned(share)
    assert plan.complete
    assert plan.inspected["depth"] >= 0.85


def test_a_dimension_that_broken_edges_limit_says_so(solid, capsys):
    """Its share of the variance is the largest, however sure the pose is and however large the image."""
    depth = Dimension.distance(FRONT, BACK, tolerance_mm=(-0.05, 0.05))
    options = {
        "localisation": FINE,
        "effort": QUICK,
        "probability": 0.8,
        "edge_break_mm": (0.3, 0.3),
    }
    plan = plan_inspection(solid, {"depth": depth}, CAMERA, UNCERTAINTY, **options)
    reason = plan.uninspectable["depth"]
    assert reason.endswith(
        "is by the edges, broken by 0.3 mm. State smaller breaks if the part has them."
    )
    # no camera is proposed, because none helps
    assert reason.kind is ReasonKind.LIMITED_BY_PART
    print_plan(plan)
    assert "another camera" not in capsys.readouterr().out
    # 90 % of a normal error are within 1.645 standard deviations
    target = plan.targets["depth"]
    limit = target.permitted_error / 1.6449
    assert target.is_limited_by_part({"edge_state": 1.01 * limit**2}, 0.9)
    assert not target.is_limited_by_part({"edge_state": 0.99 * limit**2, "rotation": 1.0}, 0.9)


def test_every_kind_of_dimension_is_documented():
    page = Path("docs/dimensions.md").read_text("utf-8")
    for kind in kinds():
        assert f'"{kind}"' in str(Dimension.__doc__)
        assert f"`{kind}`" in page


def test_a_tolerance_too_narrow_for_any_share_says_so(solid):
    depth = Dimension.distance(FRONT, BACK, tolerance_mm=(-0.01, 0.01), share=0.5)
    _, (target,) = resolve_wanted(solid, {"depth": depth}, 0.8)
    assert target.remedy(0.2, 0.9) == "No share of the tolerance would do there."
    budget = {"translation": 1.0, "rotation": 2.0, "localisation": 2.0, "surfaces": 1.0}
    assert target.remedy(0.2, 0.9, budget) == (
        "No share of the tolerance would do there. The largest part of the variance (50 %) is by the uncertain pose "
        "of the camera. A surer pose is needed, or registered images: --register edges (in Python: "
        "registration=Registration.own_edges())."
    )
    # 1 - 0.95 on both sides is 1.96 of the standard deviations of which 0.8 is 1.28
    assert "a share of 0.77," in target.remedy(0.8, 0.9)
    # what to change without another share follows
    assert "A surer pose is needed" in target.remedy(0.8, 0.9, budget)
    depth = Dimension.distance(FRONT, BACK, max_error_mm=0.01)
    _, (target,) = resolve_wanted(solid, {"depth": depth}, 0.8)
    assert target.remedy(0.8, 0.9) == ""
