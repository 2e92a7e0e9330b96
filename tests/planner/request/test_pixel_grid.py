"""Edges whose tolerance is under two pixels: what the pixel grid says, and that the plan follows it."""

from __future__ import annotations

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest

from aspectgraph import compute_regions, read_solid
from planner import Camera, Effort, PlanFileError, PoseUncertainty, plan_inspection, read_plan
from planner.bound.least_image import least_images_mm
from planner.columns.judge import Judge
from planner.request.objective import Objective
from planner.request.pixel_grid import GRID, GridObjective, lowered, tolerance_px
from planner.request.request import Request
from planner.setting.sensor_setting import SensorSetting
from planner.verify.simulate_setting import simulate_setting

CAMERA = Camera(8.0, (0.00345, 0.00345), (2448, 2048), f_number=8.0, focus_distance_mm=300.0)
DEPTH = 300.0
RIMS = {"e1": [[60, 20, 10], [60, 40, 10]], "e4": [[20, 60, 10], [40, 60, 10]]}
EFFORT = Effort(viewpoints=20, pricing_rounds=2, refutations=1, bound_nodes=1000)


def _objective(ends, uncertainty, accuracy):
    ends = np.asarray(ends, dtype=float).reshape(-1, 2, 3)
    smooth = Objective(ends, CAMERA, uncertainty, accuracy)
    return GridObjective(smooth, np.arange(len(ends)), CAMERA, uncertainty, accuracy)


def _across(length_px):
    """An edge along the image's x axis, so many pixels long, seen from the origin along z."""
    half = 0.5 * length_px * CAMERA.pixel_pitch_mm[0] * DEPTH / CAMERA.image_distance_mm
    return np.array([[-half, 0.0, DEPTH], [half, 0.0, DEPTH]])


@pytest.mark.uncompiled
@pytest.mark.parametrize(
    ("length_px", "expected"),
    [
        # shifted along itself, an image of 50 + f px is read as 51 px with probability f, else as 50
        (50.0, 1.0),
        (50.1, 0.9),
        (50.2, 0.8),
        # 50 is wrong by .4 and 51 by .6, and .25 is allowed
        (50.4, 0.0),
        (50.9, 0.9),
    ],
)
def test_an_edge_across_the_image_is_read_as_one_of_two_lengths(length_px, expected):
    covariance = np.zeros((6, 6))
    covariance[0, 0] = 2.0**2  # mm: some tens of pixels, so that all phases are as probable
    uncertainty = PoseUncertainty(covariance)
    objective = _objective(_across(length_px), uncertainty, 1.0 - 0.25 / 50.0)
    found = objective.frequencies(_across(length_px)[None])[0]
    assert found == pytest.approx(expected, abs=4 * np.sqrt(0.25 / GRID.draws))


@pytest.mark.uncompiled
def test_counting_agrees_with_the_simulation_of_settings():
    rng = np.random.default_rng(5)
    uncertainty = PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.002)
    differences = []
    for _ in range(12):
        ends = np.array([0.0, 0.0, DEPTH]) + rng.normal(size=(2, 3)) * [6.0, 6.0, 8.0]
        counted = _objective(ends, uncertainty, 0.99).frequencies(ends[None])[0]
        setting = SensorSetting(np.eye(4), ("e",), {"e": 1.0}, {}, 1.0, 1, 0, "")
        rate = simulate_setting(
            setting, {"e": ends}, CAMERA, uncertainty, accuracy=0.99, n=20_000, rng=1
        )["e"]
        error = np.sqrt(max(counted * (1 - counted), 1e-4) * (1 / GRID.draws + 1 / 20_000))
        differences.append((counted - rate.frequency) / error)
    assert np.abs(differences).max() < 4.0
    # they are not all 0 or 1, where agreement is cheap
    assert np.std(differences) > 0.1


@pytest.mark.uncompiled
def test_an_end_outside_the_image_counts_as_a_failure():
    still = PoseUncertainty.isotropic(translation_mm=1e-9, rotation_rad=1e-12)
    outside = _across(50.0) + np.array([200.0, 0.0, 0.0])
    assert _objective(outside, still, 0.9).frequencies(outside[None])[0] == 0.0


def test_the_tolerance_is_the_share_of_the_image_that_may_be_wrong():
    pose = np.eye(4)[None]
    assert tolerance_px(_across(50.0)[None], pose, CAMERA, 0.98)[0, 0] == pytest.approx(1.0)


def test_what_was_best_by_luck_is_not_promised():
    # of 5000 fair counts the best is nearly four standard errors too high; lowered by three, it is within one
    frequency = np.random.default_rng(1).binomial(GRID.draws, 0.7, 5000) / GRID.draws
    assert frequency.max() > 0.72
    assert lowered(frequency).max() <= 0.7 + np.sqrt(0.7 * 0.3 / GRID.draws)


def _request():
    solid = read_solid("examples/two_pocket_block.off")
    camera = Camera.named("basler-acA2440-20gm-8mm")
    uncertainty = PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.0005)
    return solid, camera, uncertainty


@pytest.mark.uncompiled
def test_of_counted_edges_the_bound_claims_no_more_than_the_request():
    solid, camera, uncertainty = _request()
    request = Request(compute_regions(solid, RIMS), tuple(RIMS), camera, uncertainty, 0.997, 0.65)
    by_density = least_images_mm(Judge(request))
    counted = least_images_mm(Judge(replace(request, on_grid=("e4",))))
    assert counted[0] == by_density[0] > request.constraints.min_length_mm
    assert counted[1] == request.constraints.min_length_mm


@pytest.fixture(scope="module")
def fine_plan():
    solid, camera, uncertainty = _request()
    return plan_inspection(
        solid, RIMS, camera, uncertainty, accuracy=0.9985, probability=0.65, effort=EFFORT
    )


def test_what_the_density_refuses_is_planned_on_the_grid_and_simulation_agrees(fine_plan):
    solid, camera, uncertainty = _request()
    regions = compute_regions(solid, RIMS)
    request = Request(regions, tuple(RIMS), camera, uncertainty, 0.9985, 0.65)
    rng = np.random.default_rng(0)
    assert fine_plan.complete
    assert fine_plan.on_grid == ("e1", "e4")
    # by the density no pose near those of the plan would do
    poses = np.repeat([s.cam2world for s in fine_plan.settings], 200, axis=0)
    poses[:, :3, 3] += rng.normal(size=(len(poses), 3)) * 20.0
    assert request.objective.probability(poses).max() < 0.65
    simulated = fine_plan.simulate(20_000, rng=3)
    for rates in simulated.rates:
        for rate in rates.values():
            assert rate.low >= 0.65
            assert rate.predicted <= rate.high


def test_the_plan_says_so_and_comes_back(fine_plan, tmp_path):
    fine_plan.write(tmp_path / "plan.json")
    assert json.loads((tmp_path / "plan.json").read_text())["on_grid"] == ["e1", "e4"]
    assert read_plan(tmp_path / "plan.json") == fine_plan


def test_a_plan_file_may_count_only_its_own_edges(fine_plan):
    data = fine_plan.to_dict()
    with pytest.raises(
        PlanFileError, match=r"on_grid\[1\] must be one of the plan's edges. Got \"other\""
    ):
        type(fine_plan).from_dict({**data, "on_grid": ["e1", "other"]})


def test_an_interrupted_count_goes_on_to_the_same_plan(fine_plan, tmp_path):
    solid, camera, uncertainty = _request()

    class Stop(Exception):
        pass

    def stop(done, total, label):
        if label == "lower bound" or (label == "pixel grid" and done == total):
            raise Stop

    state = tmp_path / "state.json"
    wanted = {"accuracy": 0.9985, "probability": 0.65, "effort": EFFORT, "state": state}
    with pytest.raises(Stop):
        plan_inspection(solid, RIMS, camera, uncertainty, progress=stop, **wanted)
    assert plan_inspection(solid, RIMS, camera, uncertainty, **wanted) == fine_plan


def test_where_the_tolerance_is_two_pixels_and_more_nothing_is_counted():
    solid, camera, uncertainty = _request()
    plan = plan_inspection(
        solid, RIMS, camera, uncertainty, accuracy=0.95, probability=0.9, effort=EFFORT
    )
    assert plan.complete
    assert plan.on_grid == ()
    assert "on_grid" not in plan.to_dict()


@pytest.mark.uncompiled
def test_distorted_images_are_rounded_where_the_sensor_is():
    """Counted again with OpenCV's projection and its own inverse, by other displacements."""
    k, lens = (
        np.array([[2320.0, 0, 1230.0], [0, 2320.0, 1010.0], [0, 0, 1]]),
        np.array([-0.2, 0.05, 1e-3, 0, 0]),
    )
    pitch = {"pixel_pitch_mm": 0.00345, "f_number": 8.0, "focus_distance_mm": 300.0}
    camera = Camera.from_opencv(k, lens, (2448, 2048), **pitch)
    uncertainty = PoseUncertainty.isotropic(translation_mm=0.3, rotation_rad=1e-5)
    ends = np.array([[90.0, 60.0, 300.0], [98.0, 66.0, 300.0]])
    accuracy = 0.991
    smooth = Objective(ends[None], camera, uncertainty, accuracy)
    counted = GridObjective(smooth, np.arange(1), camera, uncertainty, accuracy).frequencies(
        ends[None]
    )[0]
    moves = np.random.default_rng(8).normal(0.0, 0.3, (20_000, 3))
    seen, _ = cv2.projectPoints(
        (ends - moves[:, None]).reshape(-1, 3), np.zeros(3), np.zeros(3), k, lens
    )
    ideal = cv2.undistortPoints(np.rint(seen), k, lens, P=k).reshape(-1, 2, 2)
    length = np.linalg.norm(ideal[:, 1] - ideal[:, 0], axis=1)
    nominal = 2320 * np.hypot(8, 6) / 300
    expected = np.mean(np.abs(length - nominal) <= (1 - accuracy) * nominal)
    assert 0.1 < expected < 0.95
    # five standard errors of the fewer draws
    assert counted == pytest.approx(expected, abs=5 * np.sqrt(0.25 / GRID.draws))
