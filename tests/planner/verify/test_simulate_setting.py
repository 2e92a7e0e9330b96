import math
from types import SimpleNamespace

import numpy as np
import pytest
from known_box import BoxSpace
from one_grid import OneGrid
from scipy.stats import binom, norm

from planner import Camera, PoseUncertainty, RequestError, look_at, plan_setting, simulate_setting
from planner.camera.imaging import image_of
from planner.verify.simulate_setting import clopper_pearson, displaced_poses

CAMERA = Camera(25.0, (0.01, 0.013), (640, 480), 8.0, 400.0, largest_blur_mm=0.03)
EXACT = PoseUncertainty.isotropic(translation_mm=0.0, rotation_rad=0.0)


def setting_at(distance, names, probability=None):
    pose = look_at([[0.0, 0.0, distance]], [0, 0, 0])[0]
    return SimpleNamespace(cam2world=pose, entities=names, probability=probability or {})


def test_without_uncertainty_only_rounding_is_left():
    """A vertical edge whose image ends are chosen on and off the pixel grid: success or failure by hand."""
    d = CAMERA.image_distance_mm
    (pitch_x, _) = CAMERA.pixel_pitch_mm
    depth = 400.0
    per_pixel = pitch_x * depth / d
    # the principal point is at column 319.5: 10.5 px to either side are whole pixels; 10.2 px round to 10.5
    entities = {
        "whole": np.array([[-10.5, 0, 0], [10.5, 0, 0]]) * per_pixel,
        "rounded": np.array([[-10.2, 0, 0], [10.2, 0, 0]]) * per_pixel,
    }
    names = ("whole", "rounded")
    for accuracy, expected in ((0.99, (100, 0)), (0.96, (100, 100))):  # 0.6 px of 20.4 px is 2.9 %
        rates = simulate_setting(
            setting_at(depth, names),
            entities,
            CAMERA,
            EXACT,
            accuracy=accuracy,
            n=100,
            rng=OneGrid(),
        )
        assert tuple(rates[name].successes for name in names) == expected


def test_a_pure_change_of_distance_by_hand():
    """Only dz is uncertain: the image length is d·L/(s − dz), so success is an interval of dz."""
    sigma = 4.0
    depth = 400.0
    covariance = np.zeros((6, 6))
    covariance[2, 2] = sigma**2
    camera = Camera(25.0, (1e-5, 1e-5), (10**6, 10**6), 8.0, depth)
    entities = {"edge": np.array([[-30.0, 0, 0], [30.0, 0, 0]])}
    rate = simulate_setting(
        setting_at(depth, ("edge",)), entities, camera, PoseUncertainty(covariance), n=50_000
    )["edge"]
    low = depth * (1 - 1 / 0.98)
    high = depth * (1 - 1 / 1.02)
    expected = norm.cdf(high / sigma) - norm.cdf(low / sigma)
    assert 0.9 < expected < 0.99
    assert rate.low <= expected <= rate.high
    assert rate.frequency == rate.successes / 50_000


@pytest.mark.parametrize("distortion", [None, (-0.25, 0.1, 1e-3, -2e-3, 0.02)])
def test_lengths_are_those_of_the_undistorted_image(distortion):
    """With fine pixels an edge near the corner is measured to 3e-4; its distorted image is some per cent shorter."""
    matrix = [[26700.0, 0, 20_100.0], [0, 26700.0, 14_900.0], [0, 0, 1]]
    lens = {"pixel_pitch_mm": 0.001, "f_number": 8.0, "focus_distance_mm": 400.0}
    camera = Camera.from_opencv(matrix, distortion, (40_000, 30_000), **lens)
    entities = {"edge": np.array([[150.0, 50.0, 0], [220.0, 110.0, 0]])}
    rates = simulate_setting(
        setting_at(400.0, ("edge",)), entities, camera, EXACT, accuracy=0.9997, n=100
    )
    assert rates["edge"].successes == 100
    seen = image_of(camera, np.array([[150.0, -50.0, 400.0], [220.0, -110.0, 400.0]]) / 400.0)
    shorter = np.hypot(*(seen[1] - seen[0])) / (26700 * np.hypot(70, 60) / 400)
    assert shorter == pytest.approx(1.0, abs=1e-9) if distortion is None else shorter < 0.97


def test_ends_off_a_distorted_sensor_are_lost():
    camera = Camera.from_opencv(
        [[2000.0, 0, 999.5], [0, 2000.0, 999.5], [0, 0, 1]],
        (-0.25, 0.1, 0, 0, 0),
        (2000, 2000),
        pixel_pitch_mm=0.004,
        f_number=8.0,
        focus_distance_mm=400.0,
    )
    # the side is where x (1 - 0.25 x² + 0.1 x⁴) = 0.5: x = 0.5342, 213.7 mm
    entities = {
        "in": np.array([[0.0, 0, 0], [213.0, 0, 0]]),
        "out": np.array([[0.0, 0, 0], [214.4, 0, 0]]),
    }
    rates = simulate_setting(
        setting_at(400.0, ("in", "out")), entities, camera, EXACT, accuracy=0.99, n=50
    )
    assert (rates["in"].outside, rates["out"].outside) == (0, 50)


def test_displaced_poses_have_the_given_covariance_and_exact_rotations():
    rng = np.random.default_rng(0)
    mixing = rng.normal(size=(6, 6)) * 0.1
    uncertainty = PoseUncertainty(mixing @ mixing.T)
    pose = look_at([[100.0, 50.0, 300.0]], [0, 0, 0], 0.1, 0.2, 0.3)[0]
    drawn = displaced_poses(pose, uncertainty, 30_000, rng)
    rotations = drawn[:, :3, :3]
    assert rotations @ np.swapaxes(rotations, 1, 2) == pytest.approx(
        np.tile(np.eye(3), (30_000, 1, 1)), abs=1e-12
    )
    shifts = (drawn[:, :3, 3] - pose[:3, 3]) @ pose[:3, :3]
    scale = np.abs(uncertainty.covariance[:3, :3]).max()
    assert np.cov(shifts.T) == pytest.approx(uncertainty.covariance[:3, :3], abs=0.04 * scale)


def test_one_grid_and_random_phases_differ_for_a_short_edge():
    """An image of 20.25 px moved along the rows: on one grid it is 20 px long in 3 of 4 cases, otherwise 21."""
    per_pixel = 0.01 * 400 / CAMERA.image_distance_mm
    entities = {"edge": np.array([[0.0, 0, 0], [20.25, 0, 0]]) * per_pixel}
    covariance = np.zeros((6, 6))
    covariance[0, 0] = 1.0
    slide = PoseUncertainty(covariance)
    # 1.3 % of 20.25 px is 0.26 px: only 20 px is accurate; one grid gives it with chance 0.75
    options = {"accuracy": 1 - 0.26 / 20.25, "n": 20_000}
    fixed = simulate_setting(
        setting_at(400.0, ("edge",)), entities, CAMERA, slide, rng=OneGrid(), **options
    )["edge"]
    assert fixed.frequency == pytest.approx(0.75, abs=0.015)
    # two independent uniform errors: |difference| <= 0.26 has the chance 1 - (1 - 0.26)²
    free = simulate_setting(setting_at(400.0, ("edge",)), entities, CAMERA, slide, **options)[
        "edge"
    ]
    assert free.frequency == pytest.approx(1 - 0.74**2, abs=0.015)


def test_an_end_that_leaves_the_image_is_a_failure_unless_limits_are_ignored():
    half_width = 320 * 0.01 / CAMERA.image_distance_mm * 400
    entities = {"edge": np.array([[0, 0, 0], [half_width - 0.05, 0, 0]])}
    jitter = PoseUncertainty.isotropic(translation_mm=0.5, rotation_rad=0.0)
    limited = simulate_setting(setting_at(400.0, ("edge",)), entities, CAMERA, jitter, n=4000)[
        "edge"
    ]
    free = simulate_setting(
        setting_at(400.0, ("edge",)), entities, CAMERA, jitter, n=4000, sensor_limits=False
    )["edge"]
    assert limited.outside == free.outside > 1000
    assert free.successes > 3900
    assert limited.successes <= 4000 - limited.outside


def test_an_entity_behind_the_camera_is_never_measured():
    entities = {"edge": np.array([[0, 0, 500.0], [10, 0, 500.0]])}
    rate = simulate_setting(setting_at(400.0, ("edge",)), entities, CAMERA, EXACT, n=10)["edge"]
    assert (rate.successes, rate.outside) == (0, 10)


def test_clopper_pearson_against_the_binomial_tails():
    """The definition: at the lower limit P(X >= k) is half of what is left, at the upper P(X <= k)."""
    low, high = clopper_pearson(87, 100, 0.95)
    assert binom.sf(86, 100, low) == pytest.approx(0.025)
    assert binom.cdf(87, 100, high) == pytest.approx(0.025)
    assert clopper_pearson(0, 50, 0.9)[0] == 0
    assert clopper_pearson(50, 50, 0.9) == (pytest.approx(0.05 ** (1 / 50)), 1.0)


def test_a_planned_setting_keeps_its_promise():
    space = BoxSpace()
    uncertainty = PoseUncertainty.isotropic(translation_mm=2.0, rotation_rad=0.05)
    setting = plan_setting(space, ["x00", "z00"], CAMERA, uncertainty, field_margin_px=80)
    rates = simulate_setting(
        setting, space.entities, CAMERA, uncertainty, n=40_000, sensor_limits=False
    )
    for name, rate in rates.items():
        assert rate.predicted == setting.probability[name] < 0.9999
        # the error model is accurate to 0.001 beside the sampling error
        assert rate.low - 0.002 <= rate.predicted <= rate.high + 0.002


def test_same_seed_same_counts_and_confirmation():
    entities = {"edge": np.array([[-30.0, 0, 0], [30.0, 0, 0]])}
    jitter = PoseUncertainty.isotropic(translation_mm=2.0, rotation_rad=0.01)
    first, second = (
        simulate_setting(
            setting_at(400.0, ("edge",), {"edge": p}), entities, CAMERA, jitter, n=2000, rng=3
        )["edge"]
        for p in (0.2, 0.9999)
    )
    assert first.successes == second.successes
    assert not first.confirms
    assert math.isnan(
        simulate_setting(setting_at(400.0, ("edge",)), entities, CAMERA, EXACT, n=5)[
            "edge"
        ].predicted
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"accuracy": 1.2}, r"accuracy must be in \(0, 1\)\. Got 1\.2\."),
        ({"confidence": 0.0}, r"confidence must be in \(0, 1\)\. Got 0\.0\."),
        ({"n": 0}, r"n must be at least 1\. Got 0\."),
    ],
)
def test_bad_arguments_are_refused(arguments, message):
    entities = {"edge": np.zeros((2, 3))}
    with pytest.raises(RequestError, match=message):
        simulate_setting(setting_at(400.0, ("edge",)), entities, CAMERA, EXACT, **arguments)
