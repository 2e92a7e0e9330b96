import numpy as np
import pytest
from edge_examples import CAMERA, EDGE, PAPER_COVARIANCE, PITCH, F, random_covariance, random_edges

from errors import (
    SegmentQuantization,
    binomial_interval,
    displace,
    image_segment,
    project,
    simulate_measurement,
    simulate_success,
    success_probability,
)

CALL = {**CAMERA, "pose_covariance": PAPER_COVARIANCE, "accuracy": 0.98}


def test_against_poses_drawn_and_projected_step_by_step():
    rng = np.random.default_rng(0)
    for edge in random_edges(4, rng):
        covariance = random_covariance(rng, 0.05)
        delta = rng.multivariate_normal(np.zeros(6), covariance, size=400_000)
        ends = project(displace(edge, delta[:, None, :]), focal_length_mm=F)
        ends = ends + rng.uniform(-0.5, 0.5, ends.shape) * PITCH
        length = image_segment(edge, focal_length_mm=F)[0]
        frequency = (
            np.abs(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) - length) <= 0.02 * length
        ).mean()
        estimate = simulate_success(
            edge, **CAMERA, pose_covariance=covariance, accuracy=0.98, samples=400_000
        )
        assert estimate.probability == pytest.approx(frequency, abs=0.004)


@pytest.mark.uncompiled
def test_same_seed_same_numbers():
    one, other = (simulate_success(EDGE, **CALL, samples=1000, rng=5).probability for _ in range(2))
    assert one == other
    assert one != simulate_success(EDGE, **CALL, samples=1000, rng=6).probability
    assert success_probability(EDGE, **CALL, model="montecarlo", samples=1000, rng=5) == one


def test_result_of_an_edge_does_not_depend_on_the_batch():
    edges = random_edges(4, np.random.default_rng(1)).reshape(2, 2, 2, 3)
    whole = simulate_success(edges, **CALL, samples=70_000, rng=2)
    alone = simulate_success(edges[1, 0], **CALL, samples=70_000, rng=2)
    assert whole.probability.shape == whole.lower.shape == whole.upper.shape == (2, 2)
    assert whole.probability[1, 0] == alone.probability


def test_binomial_interval_by_hand():
    # Clopper-Pearson has closed forms at the ends: no success in n gives 1 - (alpha/2)^(1/n).
    lower, upper = binomial_interval([0, 20], 20, 0.95)
    np.testing.assert_allclose(lower, [0.0, 0.025 ** (1 / 20)])
    np.testing.assert_allclose(upper, [1.0 - 0.025 ** (1 / 20), 1.0])


def test_interval_covers_as_often_as_it_says():
    truth = simulate_success(EDGE, **CALL, samples=1_000_000, rng=99).probability
    covered = 0
    for seed in range(200):
        estimate = simulate_success(EDGE, **CALL, samples=500, rng=seed)
        covered += estimate.lower <= truth <= estimate.upper
    # At least 95 % by construction; 180 of 200 is four standard deviations below.
    assert covered >= 180


def test_quantization_alone():
    edge = np.array([[-15.0, -4.0, -875.0], [15.0, 8.0, -875.0]])
    call = {**CAMERA, "pose_covariance": np.zeros((6, 6)), "accuracy": 0.993}
    length, angle = image_segment(edge, focal_length_mm=F)
    law = SegmentQuantization(angle, PITCH)
    expected = law.cdf(0.007 * length) - law.cdf(-0.007 * length)
    estimate = simulate_success(edge, **call, samples=400_000, confidence=0.9999)
    assert estimate.lower < expected < estimate.upper
    assert simulate_success(edge, **call, samples=10, quantization="none").probability == 1.0
    # A pose that never moves sees the same pixels every time.
    assert simulate_success(edge, **call, samples=10, quantization="grid").probability in (0.0, 1.0)


def test_grid_is_the_detector_that_counts_whole_columns_and_rows():
    for edge in random_edges(3, np.random.default_rng(4)):
        grid = simulate_success(edge, **CALL, samples=30_000, rng=1, quantization="grid")
        twin = simulate_measurement(edge, **CALL, samples=30_000, rng=1, detector="axes")
        assert grid.probability == twin.probability


@pytest.mark.uncompiled
def test_a_pose_behind_the_edge_is_a_failure():
    edge = np.array([[-1.0, 0.0, F - 10.0], [1.0, 0.0, F - 10.0]])
    wild = np.diag([0.0, 0.0, 400.0, 0.0, 0.0, 0.0])
    call = {**CAMERA, "pose_covariance": wild, "accuracy": 0.01}
    # Accepted: dz between 10 (1 - 1/0.01) and 10 (1 - 1/1.99), i.e. below 4.97 mm; failures include 31 % behind.
    assert simulate_success(edge, **call, samples=100_000).probability == pytest.approx(
        0.598, abs=0.01
    )
    assert simulate_measurement(edge, **call, samples=20_000).probability == pytest.approx(
        0.598, abs=0.02
    )
