"""A plan for a calibrated camera: what it promises, OpenCV's projection and a simulation confirm."""

from dataclasses import replace
from itertools import product

import cv2
import numpy as np
import pytest

from aspectgraph import Solid
from planner import (
    Camera,
    Dimension,
    Effort,
    Localisation,
    PoseUncertainty,
    look_at,
    plan_inspection,
    predict,
    read_plan,
)
from planner.options import InspectionOptions
from planner.request.resolve import resolve_wanted
from planner.verify.simulate_setting import displaced_poses, measured_errors

FACES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
BOX = Solid(list(product((0, 40), (0, 30), (0, 20))), FACES, name="box")
K = np.array([[2320.0, 0.0, 1251.5], [0.0, 2326.0, 1009.0], [0.0, 0.0, 1.0]])
LENS = np.array([-0.21, 0.08, 1e-3, -6e-4, -0.01])
CAMERA = Camera.from_opencv(
    K, LENS, (2448, 2048), pixel_pitch_mm=0.00345, f_number=8.0, focus_distance_mm=300.0
)
SIGMA = PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.001)
EFFORT = Effort(viewpoints=10, pricing_rounds=2, refutations=1, bound_nodes=1000)
EDGES = {
    "top": [[0, 0, 20], [40, 0, 20]],
    "side": [[40, 0, 20], [40, 30, 20]],
    "low": [[0, 30, 0], [40, 30, 0]],
}


@pytest.fixture(scope="module")
def plan():
    return plan_inspection(BOX, EDGES, CAMERA, SIGMA, accuracy=0.98, effort=EFFORT)


def test_every_edge_is_wholly_in_the_distorted_image(plan):
    assert set(plan.inspected) == set(EDGES)
    margin = plan.requirements["field_margin_px"]
    assert margin > 5
    for setting in plan.settings:
        pose = setting.cam2world
        for name in setting.entities:
            points = np.linspace(*np.array(EDGES[name], dtype=float), 50)
            local = (points - pose[:3, 3]) @ pose[:3, :3]
            seen = cv2.projectPoints(local, np.zeros(3), np.zeros(3), K, LENS)[0][:, 0]
            assert (seen >= margin - 0.5).all()
            assert (seen <= np.array([2448, 2048]) - 0.5 - margin).all()


def test_simulation_confirms_it(plan):
    result = plan.simulate(20_000)
    assert result.confirmed
    assert plan.lower_bound <= len(plan.settings)


def test_plan_is_read_back(plan, tmp_path):
    plan.write(tmp_path / "plan.json")
    again = read_plan(tmp_path / "plan.json")
    assert again.camera == CAMERA
    assert again == plan


def test_what_is_half_outside_the_image_is_never_measured():
    wanted = {
        "width": Dimension.distance(EDGES["top"], [[0, 30, 20], [40, 30, 20]], max_error_mm=0.1)
    }
    _, targets = resolve_wanted(BOX, wanted, 0.98, as_lengths=True)
    planned = replace(targets[0], localisation=Localisation.fit(0.1))
    # x = 0 is seen at the tangent 0.5, x = 40 at 0.63; the side is at 0.55
    pose = look_at([[-150.0, 15.0, 320.0]], [-150.0, 15.0, 20.0])[0]
    poses = np.repeat(pose[None], 10, axis=0)
    error, outside = measured_errors(planned, pose, poses, CAMERA, np.random.default_rng(0))
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
    told = predict(BOX, wanted, pose, CAMERA, SIGMA, options=box)["width"]
    _, targets = resolve_wanted(BOX, wanted, 0.98, as_lengths=True)
    rng = np.random.default_rng(5)
    planned = targets[0]
    error, outside = measured_errors(
        planned, pose, displaced_poses(pose, SIGMA, 4000, rng), CAMERA, rng
    )
    assert not outside.any()
    assert abs(np.mean(error)) < told.standard_uncertainty
    assert 0.3 * told.standard_uncertainty < np.std(error) < 1.1 * told.standard_uncertainty
