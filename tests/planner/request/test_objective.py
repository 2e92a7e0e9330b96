from types import SimpleNamespace

import numpy as np
import pytest
from known_box import BoxSpace
from scipy.spatial.transform import Rotation

from planner import Camera, PoseUncertainty, RequestError, look_at, simulate_setting
from planner.request.models import Means
from planner.request.problem import Objective

CAMERA = Camera(25.0, (0.01, 0.013), (640, 480), 8.0, 400.0, largest_blur_mm=0.03)
PAPER = PoseUncertainty(np.diag([0.03] * 3 + [0.003] * 3))


def poses(n, rng):
    directions = rng.normal(size=(n, 3))
    positions = directions / np.linalg.norm(directions, axis=1, keepdims=True) * 400
    return look_at(positions, [30, 20, 15], *rng.uniform(-0.1, 0.1, (2, n)), rng.uniform(-3, 3, n))


def measured_frequency(pose, ends, uncertainty, accuracy, n, rng):
    """Frequency of |error| <= (1 - A)·L by exact displacements in world coordinates and uniform quantization."""
    moves = rng.multivariate_normal(np.zeros(6), uncertainty.covariance, n)
    world = np.concatenate([np.zeros((1, 6)), moves])
    rotations = pose[:3, :3] @ Rotation.from_rotvec(world[:, 3:]).as_matrix()
    positions = pose[:3, 3] + world[:, :3] @ pose[:3, :3].T
    local = np.einsum("npk,nkj->npj", ends[None] - positions[:, None], rotations)
    image = CAMERA.image_distance_mm * local[..., :2] / local[..., 2:]
    image[1:] += rng.uniform(-0.5, 0.5, image[1:].shape) * CAMERA.pixel_pitch_mm
    length = np.linalg.norm(image[:, 1] - image[:, 0], axis=1)
    return np.mean(np.abs(length[1:] - length[0]) <= (1 - accuracy) * length[0])


@pytest.mark.parametrize("kind", ["isotropic", "correlated"])
def test_probability_is_what_displaced_cameras_measure(kind):
    """The whole chain: camera displacement in OpenCV axes, the paper's frame, and the error model."""
    rng = np.random.default_rng(7)
    uncertainty = PAPER
    if kind == "correlated":
        mixing = rng.normal(size=(6, 6)) * np.repeat([1.5, 0.015], 3)[:, None]
        uncertainty = PoseUncertainty(mixing @ mixing.T)
    ends = np.array([entity.endpoints for entity in BoxSpace().entities.values()])[:6]
    objective = Objective.of_edges(ends, Means(CAMERA, uncertainty, 0.98))
    for pose in poses(3, rng):
        predicted = objective.probability(pose[None])[0]
        for end, p in zip(ends, predicted, strict=True):
            assert p == pytest.approx(
                measured_frequency(pose, end, uncertainty, 0.98, 40_000, rng), abs=0.012
            )
        assert predicted.min() < 0.97


def test_large_rotations_about_the_nodal_point_are_met_to_a_thousandth():
    """At the paper's 3 degrees the offset of the paper's origin from the nodal point would cost 0.004."""
    space = BoxSpace(size=(20.0, 20.0, 20.0))
    names = ("x00", "y00", "z00")
    fine = Camera(25.0, (0.0005, 0.00065), (12800, 9600), 8.0, 300.0, largest_blur_mm=0.03)
    pose = look_at([[-180.0, -160.0, -170.0]], [10, 10, 10], 0.04, -0.03, 0.5)[0]
    ends = np.array([space.entities[name].endpoints for name in names])
    predicted = Objective.of_edges(ends, Means(fine, PAPER, 0.98)).probability(pose[None])[0]
    setting = SimpleNamespace(cam2world=pose, entities=names, probability={})
    rates = simulate_setting(setting, space.entities, fine, PAPER, n=400_000, sensor_limits=False)
    measured = np.array([rate.frequency for rate in rates.values()])
    assert 0.85 < measured.min() < 0.98
    assert np.abs(measured - predicted).max() < 0.002


def test_fitness_is_the_sum_or_the_smallest_probability():
    ends = np.array([entity.endpoints for entity in BoxSpace().entities.values()])[:3]
    many = poses(20, np.random.default_rng(1))
    probability = Objective.of_edges(ends, Means(CAMERA, PAPER, 0.98)).probability(many)
    assert probability.shape == (20, 3)
    assert Objective.of_edges(ends, Means(CAMERA, PAPER, 0.98), "sum").fitness(
        many
    ) == pytest.approx(probability.sum(axis=1))
    assert Objective.of_edges(ends, Means(CAMERA, PAPER, 0.98), "min").fitness(
        many
    ) == pytest.approx(probability.min(axis=1))


def test_what_is_behind_the_camera_has_probability_zero():
    ends = np.array([[[0, 0, 0], [50.0, 0, 0]], [[0, 0, 900.0], [50, 0, 900]]])
    pose = look_at([[0.0, 0.0, 400.0]], [0, 0, 0])
    probability = Objective.of_edges(ends, Means(CAMERA, PAPER, 0.98)).probability(pose)[0]
    assert probability[0] > 0.5
    assert probability[1] == 0


def test_probability_grows_with_the_tolerance():
    ends = np.array([entity.endpoints for entity in BoxSpace().entities.values()])
    many = poses(10, np.random.default_rng(3))
    strict, loose = (
        Objective.of_edges(ends, Means(CAMERA, PAPER, a)).probability(many) for a in (0.99, 0.95)
    )
    assert np.all(loose > strict)


@pytest.mark.parametrize("accuracy", [0.0, 1.0, 1.2, -0.5, float("nan")])
def test_accuracy_outside_the_open_interval_is_refused(accuracy):
    with pytest.raises(RequestError, match=rf"accuracy must be in \(0, 1\)\. Got {accuracy}\."):
        Objective.of_edges(np.eye(3)[None, :2], Means(CAMERA, PAPER, accuracy))


def test_an_unknown_objective_is_refused():
    with pytest.raises(RequestError, match=r"objective must be 'sum' or 'min'\. Got 'max'\."):
        Objective.of_edges(np.eye(3)[None, :2], Means(CAMERA, PAPER, 0.98), "max")
