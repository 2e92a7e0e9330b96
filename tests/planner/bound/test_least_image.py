"""The least image length is a proof: no pose, however certain, may reach the probability with a shorter image."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from grid_box import EDGES, BoxSpace

from errors import SegmentQuantization, success_probability
from planner import Camera, PoseUncertainty
from planner.bound.pose_space import _SAFETY, least_images_mm, quantization_quantile
from planner.request.constraints import Requirements
from planner.request.models import EdgeModels
from planner.request.problem import Problem
from planner.request.targets import edge_target
from planner.search.columns import Judge

CAMERA = Camera(8.0, (0.00345, 0.005), (2448, 2048), 8.0, 400.0)


@pytest.mark.parametrize("probability", [0.3, 0.9, 0.99])
def test_quantile_along_one_axis_is_that_of_the_triangular_law(probability):
    # P(|T| <= h) = 1 - (1 - h)^2; across the finer axis no direction is better by much, and none is worse
    along = 1 - math.sqrt(1 - probability)
    assert 0.93 * along < quantization_quantile((0.01, 0.01), probability) / 0.01 <= along + 1e-9


@pytest.mark.parametrize("accuracy", [0.9, 0.98])
def test_no_shorter_image_reaches_the_probability(accuracy):
    space = BoxSpace((120.0, 80.0, 60.0), [[-900.0] * 3, [1100.0] * 3], EDGES)
    tiny = PoseUncertainty.isotropic(translation_mm=1e-6, rotation_rad=1e-8)
    judge = Judge(Problem(space, space.entity_names, CAMERA, tiny, accuracy, 0.9))
    (needed,) = set(least_images_mm(judge.problem).tolist())
    assert needed >= judge.constraints.min_length_mm
    rng = np.random.default_rng(1)
    depth = 300.0
    turn = rng.uniform(0, 2 * np.pi, 3000)
    length = (
        rng.uniform(0.3, 0.999, 3000) * 0.99 * quantization_quantile(CAMERA.pixel_pitch_mm, 0.9)
    )
    length /= 0.5 * (math.log(2 - accuracy) - math.log(accuracy))
    assert needed == pytest.approx(max(length.max(), judge.constraints.min_length_mm), rel=0.01)
    half = length / 2 * depth / CAMERA.image_distance_mm
    side = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(3000)]) * half[:, None]
    # image plane at 0, lens at d, object a depth beyond the lens
    middle = np.array([0.0, 0.0, CAMERA.image_distance_mm - depth])
    probability = success_probability(
        np.stack([middle - side, middle + side], axis=1),
        focal_length_mm=CAMERA.image_distance_mm,
        pixel_pitch_mm=CAMERA.pixel_pitch_mm,
        pose_covariance=tiny.paper_covariance(CAMERA.image_distance_mm),
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
            camera=CAMERA,
            constraints=SimpleNamespace(min_length_mm=0.0),
            accuracy=0.98,
            targets=[edge_target("edge", np.eye(3)[:2])],
        )
        half_width = 0.5 * (math.log(2.0 - 0.98) - math.log(0.98))
        asked = quantization_quantile(CAMERA.pixel_pitch_mm, probability - 5e-5)
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
