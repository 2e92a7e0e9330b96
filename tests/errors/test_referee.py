"""Tests of `referee`."""

import numpy as np
import pytest
from edge_examples import CAMERA, EDGE, PAPER_COVARIANCE, PITCH, F, random_covariance, random_edges

from errors import (
    InvalidParameterError,
    SegmentQuantization,
    binomial_interval,
    coverage_image,
    displace,
    image_segment,
    measure_lengths,
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


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((5, 3), "hits must be integers from 0 to samples, 3. Got 5."),
        (([1, -1], 3), "hits must be integers from 0 to samples, 3. Got -1."),
        ((0.5, 3), "hits must be integers from 0 to samples, 3. Got 0.5."),
        ((0, 0), "samples must be an integer >= 1. Got 0."),
        ((1, 3, 1.0), "confidence must be in (0, 1). Got 1.0."),
    ],
)
def test_binomial_interval_of_what_cannot_be(arguments, message):
    with pytest.raises(InvalidParameterError) as refused:
        binomial_interval(*arguments)
    assert str(refused.value) == message


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


def frontal_edge(angle_deg, depth=300.0, length=50.0, tilt=0.43):
    angle = np.radians(angle_deg)
    lateral = np.sqrt(1.0 - tilt**2)
    direction = np.array([np.cos(angle) * lateral, np.sin(angle) * lateral, tilt])
    return np.array([0.0, 0.0, F - depth]) + np.array([[-0.5], [0.5]]) * length * direction


@pytest.mark.uncompiled
def test_whole_pixels_by_hand():
    # From 0.4 to 3.6 pixels: 0.6 of the first pixel, 0.6 of the fourth and two whole ones, so four count.
    segments = np.array(
        [[[0.4, 0.0], [3.6, 0.0]], [[0.6, 0.0], [3.4, 0.0]], [[0.6, 0.2], [3.6, 4.9]]]
    )
    expected = [4.0, 2.0, np.hypot(3.0, 5.0)]
    np.testing.assert_allclose(measure_lengths(segments, pixel_pitch_mm=(1.0, 1.0)), expected)
    np.testing.assert_allclose(
        measure_lengths(segments[:, ::-1], pixel_pitch_mm=(1.0, 1.0)), expected
    )
    np.testing.assert_allclose(
        measure_lengths(segments[:2], pixel_pitch_mm=(1.0, 1.0), detector="area"), expected[:2]
    )


@pytest.mark.uncompiled
def test_short_segments_cover_no_pixel():
    segment = np.array([[0.4, 0.5], [0.8, 0.5]])
    assert measure_lengths(segment, pixel_pitch_mm=(1.0, 1.0)) == 0.0
    assert np.isnan(measure_lengths(segment, pixel_pitch_mm=(1.0, 1.0), detector="area"))


@pytest.mark.uncompiled
def test_coverage_against_counted_points():
    segment = np.array([[0.013, 0.021], [0.072, 0.049]])
    image, (i, j) = coverage_image(segment, pixel_pitch_mm=PITCH)
    assert image.sum() * PITCH[0] * PITCH[1] == pytest.approx(
        np.linalg.norm(segment[1] - segment[0]) * 3 * 0.013
    )
    n = 64
    sub = (np.arange(n) + 0.5) / n
    along = (segment[1] - segment[0]) / np.linalg.norm(segment[1] - segment[0])
    for row, column in ((4, 4), (4, 5), (3, 3), (6, 8), (5, 9)):
        u, v = np.meshgrid((i + column + sub) * PITCH[0], (j + row + sub) * PITCH[1])
        relative = np.stack([u, v], axis=-1) - segment[0]
        s = relative @ along
        across = relative @ [-along[1], along[0]]
        inside = (
            (s > 0) & (s < np.linalg.norm(segment[1] - segment[0])) & (np.abs(across) < 1.5 * 0.013)
        )
        assert image[row, column] == pytest.approx(inside.mean(), abs=0.02)


@pytest.mark.parametrize("angle_deg", [0.0, 15.0, 40.0, 75.0, 90.0])
def test_whole_pixels_of_lines_anywhere_follow_eq_3(angle_deg):
    angle = np.radians(angle_deg)
    rng = np.random.default_rng(1)
    lengths = rng.uniform(1.0, 2.0, 20_000)
    along = np.array([np.cos(angle), np.sin(angle)])
    segments = (
        rng.normal(size=(20_000, 1, 2)) + np.array([[-0.5], [0.5]]) * lengths[:, None, None] * along
    )
    errors = measure_lengths(segments, pixel_pitch_mm=PITCH) - lengths
    law = SegmentQuantization(angle, PITCH)
    assert errors.mean() == pytest.approx(0.0, abs=2e-4)
    assert errors.std() == pytest.approx(float(law.std), rel=0.03)


@pytest.mark.parametrize("detector", ["axes", "area"])
@pytest.mark.parametrize("angle_deg", [0.0, 20.0, 45.0, 90.0])
@pytest.mark.parametrize("depth", [150.0, 300.0])
def test_prediction_holds_where_the_tolerance_is_several_pixels(detector, angle_deg, depth):
    call = {**CAMERA, "pose_covariance": np.diag([0.03] * 3 + [0.003] * 3), "accuracy": 0.98}
    edge = frontal_edge(angle_deg, depth)
    measured = simulate_measurement(
        edge, **call, samples=20_000, detector=detector, confidence=0.999
    )
    assert measured.lower - 0.003 < success_probability(edge, **call) < measured.upper + 0.003


def test_prediction_fails_where_the_length_moves_less_than_a_pixel():
    # Along a row a length is a whole number of pixels: within a tolerance under one pixel there may be one or none.
    call = {
        **CAMERA,
        "pose_covariance": np.diag([0.03, 0.03, 1e-4, 0.0, 0.0, 0.0]),
        "accuracy": 0.999,
    }
    edges = [frontal_edge(0.0, length=length, tilt=0.0) for length in np.linspace(50.0, 50.12, 9)]
    predicted = np.array([success_probability(edge, **call) for edge in edges])
    measured = np.array(
        [simulate_measurement(edge, **call, samples=4000).probability for edge in edges]
    )
    assert np.abs(predicted - measured).max() > 0.1
    # Averaged over the length's own place on the grid the model is right again.
    assert predicted.mean() == pytest.approx(measured.mean(), abs=0.06)
