import numpy as np
import pytest
from edge_examples import CAMERA, F

from errors import (
    SegmentQuantization,
    coverage_image,
    measure_lengths,
    simulate_measurement,
    success_probability,
)

PITCH = (0.01, 0.013)


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
