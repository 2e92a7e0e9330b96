"""The least image length is a proof: no pose, however certain, may reach the probability with a shorter image."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from box_requests import CAMERA, UNCERTAINTY, WORKSPACE, random_poses
from grid_box import EDGES, BoxSpace

from errors import SegmentQuantization, success_probability
from planner import Camera, PoseUncertainty
from planner.bound.pose_space import (
    _SAFETY,
    frustum_of,
    least_images_mm,
    quantization_quantile,
    view_of,
)
from planner.camera.pose import moved, world_to_cam
from planner.options import InspectionOptions
from planner.request.constraints import Requirements
from planner.request.models import EdgeModels
from planner.request.problem import Problem
from planner.request.targets import edge_target
from planner.search.columns import Judge

CAMERA_LEAST_IMAGE = Camera(8.0, (0.00345, 0.005), (2448, 2048), 8.0, 400.0)


@pytest.mark.parametrize("probability", [0.3, 0.9, 0.99])
def test_quantile_along_one_axis_is_that_of_the_triangular_law(probability):
    # P(|T| <= h) = 1 - (1 - h)^2; across the finer axis no direction is better by much, and none is worse
    along = 1 - math.sqrt(1 - probability)
    assert 0.93 * along < quantization_quantile((0.01, 0.01), probability) / 0.01 <= along + 1e-9


@pytest.mark.parametrize("accuracy", [0.9, 0.98])
def test_no_shorter_image_reaches_the_probability(accuracy):
    space = BoxSpace((120.0, 80.0, 60.0), [[-900.0] * 3, [1100.0] * 3], EDGES)
    tiny = PoseUncertainty.isotropic(translation_mm=1e-6, rotation_rad=1e-8)
    judge = Judge(Problem(space, space.entity_names, CAMERA_LEAST_IMAGE, tiny, accuracy, 0.9))
    (needed,) = set(least_images_mm(judge.problem).tolist())
    assert needed >= judge.constraints.min_length_mm
    rng = np.random.default_rng(1)
    depth = 300.0
    turn = rng.uniform(0, 2 * np.pi, 3000)
    length = (
        rng.uniform(0.3, 0.999, 3000)
        * 0.99
        * quantization_quantile(CAMERA_LEAST_IMAGE.pixel_pitch_mm, 0.9)
    )
    length /= 0.5 * (math.log(2 - accuracy) - math.log(accuracy))
    assert needed == pytest.approx(max(length.max(), judge.constraints.min_length_mm), rel=0.01)
    half = length / 2 * depth / CAMERA_LEAST_IMAGE.image_distance_mm
    side = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(3000)]) * half[:, None]
    # image plane at 0, lens at d, object a depth beyond the lens
    middle = np.array([0.0, 0.0, CAMERA_LEAST_IMAGE.image_distance_mm - depth])
    probability = success_probability(
        np.stack([middle - side, middle + side], axis=1),
        focal_length_mm=CAMERA_LEAST_IMAGE.image_distance_mm,
        pixel_pitch_mm=CAMERA_LEAST_IMAGE.pixel_pitch_mm,
        pose_covariance=tiny.paper_covariance(CAMERA_LEAST_IMAGE.image_distance_mm),
        accuracy=accuracy,
    )
    assert probability.max() < 0.9
    assert probability.max() > 0.8


def least_quantile(pitch, probability):
    """From the exact law of eq 3, between the directions that the code looks at."""
    law = SegmentQuantization(np.radians(np.linspace(0.0, 90.0, 4501)), pitch)
    low = np.zeros(4501)
    high = np.full(4501, sum(pitch))
    for _ in range(45):
        h = (low + high) / 2
        enough = 2.0 * law.cdf(h) - 1.0 >= probability
        low = np.where(enough, low, h)
        high = np.where(enough, h, high)
    return high.min()


@pytest.mark.parametrize("ratio", [1.0, 1.45, 3.0, 10.0, 1000.0])
def test_no_direction_has_a_smaller_quantile(ratio):
    pitch = (0.01, 0.01 * ratio)
    for probability in (1e-4, 0.01, 0.05, 0.3, 0.35, 0.5, 0.7, 0.9, 0.95, 0.99, 0.999, 1.0 - 1e-6):
        exact = least_quantile(pitch, probability)
        found = quantization_quantile(pitch, probability)
        assert exact * (1.0 - 0.0018) <= found <= exact / (1.0 + 0.0017)


def test_an_error_of_the_probability_asks_for_no_longer_image():
    for probability in (1e-5, 0.3, 0.9, 1.0 - 1e-6):
        request = SimpleNamespace(
            probability=probability,
            camera=CAMERA_LEAST_IMAGE,
            constraints=SimpleNamespace(min_length_mm=0.0),
            accuracy=0.98,
            targets=[edge_target("edge", np.eye(3)[:2])],
        )
        half_width = 0.5 * (math.log(2.0 - 0.98) - math.log(0.98))
        asked = quantization_quantile(CAMERA_LEAST_IMAGE.pixel_pitch_mm, probability - 5e-5)
        assert least_images_mm(request).max() <= _SAFETY * asked / half_width


def test_no_image_shorter_than_the_least_reaches_a_small_probability():
    camera = Camera(8.0, (0.002, 0.02), (4000, 400), 8.0, 400.0)
    tiny = PoseUncertainty.isotropic(translation_mm=1e-6, rotation_rad=1e-8)
    space = BoxSpace((120.0, 80.0, 60.0), [[-900.0] * 3, [1100.0] * 3], EDGES)
    judge = Judge(
        Problem(space, EDGES, camera, tiny, 0.9995, 0.02, Requirements(min_length_px=1.0))
    )
    depth = 300.0
    half = 0.99 * least_images_mm(judge.problem)[0] / 2 * depth / camera.image_distance_mm
    shorter = np.array([[[[-half, 0.0, depth], [half, 0.0, depth]]]])
    assert EdgeModels(shorter, judge.problem.means).probability_of(shorter).max() < 0.02


# What the bound takes a camera to take in: no less than any admissible setting needs.


def test_all_that_a_pose_inspects_is_between_the_depths_of_the_bound():
    """Only what every end keeps is taken from the depth of field: an end on the axis keeps less than one off it."""
    need = InspectionOptions().requirements(CAMERA, UNCERTAINTY)
    space = BoxSpace((120.0, 80.0, 60.0), WORKSPACE, EDGES)
    judge = Judge(Problem(space, EDGES, CAMERA, UNCERTAINTY, 0.98, 0.9, need))
    frustum = frustum_of(judge.problem)
    view = view_of(judge.problem)
    near, far = CAMERA.depth_of_field_mm
    assert (frustum.near, frustum.far) == (near + 0.15, far - 0.15)
    assert (view.near, view.far) == (frustum.near, frustum.far)
    poses = random_poses(judge, 400)
    # forwards and backwards, so that ends come to the limits
    steps = np.zeros((61, 6))
    steps[:, 2] = np.linspace(-80.0, 80.0, 61)
    poses = np.concatenate([moved(pose, steps, 1.0) for pose in poses])
    inspects = judge(poses).inspects
    depth = world_to_cam(judge.ends, poses)[..., 2]
    assert inspects.sum() > 500
    kept = depth[inspects]
    assert kept.min() >= frustum.near
    assert kept.max() <= frustum.far
