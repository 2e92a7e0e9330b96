"""The floor and surfaces in the simulation of dimensions: answers in closed form, and the model's uncertainty."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
from holed_plate import CAMERA, UNCERTAINTY, holed_plate, upper_rims
from known_box import BoxSpace
from one_grid import OneGrid
from plan_examples import planned_dimension
from scipy.optimize import least_squares
from scipy.stats import binom, norm

from aspectgraph import compute_regions
from errors.measurands import Circle, Line
from planner import (
    Camera,
    Dimension,
    Localisation,
    PoseUncertainty,
    RequestError,
    look_at,
    plan_setting,
    simulate_setting,
)
from planner.camera.camera import image_of
from planner.request.models import Means
from planner.request.problem import Problem
from planner.request.reach import TargetSpace
from planner.request.resolve import resolve_wanted
from planner.search.realise_column import _trials_of
from planner.verify.joint_counts import DisplacedChecks, lower_bound, successes_needed
from planner.verify.simulate_setting import (
    carry_back,
    clopper_pearson,
    displaced_poses,
    fit_circles,
    image_points,
    measured_errors,
)

CAMERA_SIMULATE_SETTING = Camera(25.0, (0.01, 0.013), (640, 480), 8.0, 400.0, largest_blur_mm=0.03)
EXACT = PoseUncertainty.isotropic(translation_mm=0.0, rotation_rad=0.0)


def setting_at(distance, names, probability=None):
    pose = look_at([[0.0, 0.0, distance]], [0, 0, 0])[0]
    return SimpleNamespace(cam2world=pose, entities=names, probability=probability or {})


def test_without_uncertainty_only_rounding_is_left():
    """A vertical edge whose image ends are chosen on and off the pixel grid: success or failure by hand."""
    d = CAMERA_SIMULATE_SETTING.image_distance_mm
    (pitch_x, _) = CAMERA_SIMULATE_SETTING.pixel_pitch_mm
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
            CAMERA_SIMULATE_SETTING,
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
    camera = Camera(25.0, (1e-4, 1e-4), (10**5, 10**5), 8.0, depth)
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
    per_pixel = 0.01 * 400 / CAMERA_SIMULATE_SETTING.image_distance_mm
    entities = {"edge": np.array([[0.0, 0, 0], [20.25, 0, 0]]) * per_pixel}
    covariance = np.zeros((6, 6))
    covariance[0, 0] = 1.0
    slide = PoseUncertainty(covariance)
    # 1.3 % of 20.25 px is 0.26 px: only 20 px is accurate; one grid gives it with chance 0.75
    options = {"accuracy": 1 - 0.26 / 20.25, "n": 20_000}
    fixed = simulate_setting(
        setting_at(400.0, ("edge",)),
        entities,
        CAMERA_SIMULATE_SETTING,
        slide,
        rng=OneGrid(),
        **options,
    )["edge"]
    assert fixed.frequency == pytest.approx(0.75, abs=0.015)
    # two independent uniform errors: |difference| <= 0.26 has the chance 1 - (1 - 0.26)²
    free = simulate_setting(
        setting_at(400.0, ("edge",)), entities, CAMERA_SIMULATE_SETTING, slide, **options
    )["edge"]
    assert free.frequency == pytest.approx(1 - 0.74**2, abs=0.015)


def test_an_end_that_leaves_the_image_is_a_failure_unless_limits_are_ignored():
    half_width = 320 * 0.01 / CAMERA_SIMULATE_SETTING.image_distance_mm * 400
    entities = {"edge": np.array([[0, 0, 0], [half_width - 0.05, 0, 0]])}
    jitter = PoseUncertainty.isotropic(translation_mm=0.5, rotation_rad=0.0)
    limited = simulate_setting(
        setting_at(400.0, ("edge",)), entities, CAMERA_SIMULATE_SETTING, jitter, n=4000
    )["edge"]
    free = simulate_setting(
        setting_at(400.0, ("edge",)),
        entities,
        CAMERA_SIMULATE_SETTING,
        jitter,
        n=4000,
        sensor_limits=False,
    )["edge"]
    assert limited.outside == free.outside > 1000
    assert free.successes > 3900
    assert limited.successes <= 4000 - limited.outside


def test_an_entity_behind_the_camera_is_never_measured():
    entities = {"edge": np.array([[0, 0, 500.0], [10, 0, 500.0]])}
    rate = simulate_setting(
        setting_at(400.0, ("edge",)), entities, CAMERA_SIMULATE_SETTING, EXACT, n=10
    )["edge"]
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
    setting = plan_setting(
        space, ["x00", "z00"], CAMERA_SIMULATE_SETTING, uncertainty, field_margin_px=80
    )
    rates = simulate_setting(
        setting, space.entities, CAMERA_SIMULATE_SETTING, uncertainty, n=40_000, sensor_limits=False
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
            setting_at(400.0, ("edge",), {"edge": p}),
            entities,
            CAMERA_SIMULATE_SETTING,
            jitter,
            n=2000,
            rng=3,
        )["edge"]
        for p in (0.2, 0.9999)
    )
    assert first.successes == second.successes
    assert not first.confirms
    assert math.isnan(
        simulate_setting(
            setting_at(400.0, ("edge",)), entities, CAMERA_SIMULATE_SETTING, EXACT, n=5
        )["edge"].predicted
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"accuracy": 1.2}, r"accuracy must be in \(0, 1\)\. Got 1\.2\."),
        ({"confidence": 0.0}, r"confidence must be in \(0, 1\)\. Got 0\.0\."),
        ({"n": 0}, r"n must be an integer of at least 1\. Got 0\."),
    ],
)
def test_bad_arguments_are_refused(arguments, message):
    entities = {"edge": np.zeros((2, 3))}
    with pytest.raises(RequestError, match=message):
        simulate_setting(
            setting_at(400.0, ("edge",)), entities, CAMERA_SIMULATE_SETTING, EXACT, **arguments
        )


@pytest.mark.parametrize("ends", [np.zeros((3, 3)), np.zeros((2, 2)), np.zeros(6), 5, "edge", None])
def test_an_edge_without_two_ends_is_refused(ends):
    setting = setting_at(400.0, ("edge",))
    rule = r"^entities must be entities, or two ends of the shape \(2, 3\)\. Got .* for 'edge'\.$"
    with pytest.raises(RequestError, match=rule):
        simulate_setting(setting, {"edge": ends}, CAMERA_SIMULATE_SETTING, EXACT, n=5)


# The floor and surfaces in the simulation of dimensions: answers in closed form, and the model's
# uncertainty.


CAMERA_SIMULATED_COMMON_ERRORS = Camera(25.0, (0.004, 0.005), (2000, 1600), 8.0, 300.0)
Z = 300.0
OVERHEAD = look_at([[0.0, 0.0, Z]], [0, 0, 0])[0]
SLANTED = look_at([[130.0, -70.0, 240.0]], [5.0, -3, 2])[0]
S = 0.05
FLOOR = Localisation.gaussian(0.0, floor_px=S)
EXACT_SIMULATED_COMMON_ERRORS = Localisation.gaussian(0.0, floor_px=0.0)
DRAWS = 4000
RIM = Circle((4.0, -3.0, 0.0), (0, 0, 1), 12.0)
KINDS = {
    "diameter": (RIM,),
    "length": (Line((-15, 2, 0), (15, 6, 4)),),
    "distance": (Line((-15, -10, 0), (15, -10, 0)), Line((-12, 9, 5), (14, 9, 5))),
    "angle": (Line((-10, 0, 0), (10, 0, 0)), Line((-10, -10, 0), (10, 10, 0))),
    "centre_distance": (RIM, Circle((-20, 8, 6), (0, 0, 1), 5.0)),
    "centre_to_edge": (RIM, Line((-15, 20, 3), (15, 24, 3))),
}


def dimension(kind, how, surfaces_mm=0.0, direction=None):
    return planned_dimension(
        kind, ("a",), KINDS[kind], 0.05, how, direction=direction, surfaces_mm=surfaces_mm
    )


def errors_of(one, pose, poses=None, seed=3):
    still = np.tile(pose, (DRAWS, 1, 1)) if poses is None else poses
    found, outside = measured_errors(
        one, pose, still, CAMERA_SIMULATED_COMMON_ERRORS, np.random.default_rng(seed)
    )
    assert not outside.any()
    return found


def test_the_floor_of_a_rim_is_that_of_its_whole_size():
    square = Camera(25.0, (0.005, 0.005), (2000, 1600), 8.0, 300.0)
    found, _ = measured_errors(
        planned_dimension("diameter", ("a",), (Circle((0, 0, 0), (0, 0, 1), 12.0),), 0.05, FLOOR),
        OVERHEAD,
        np.tile(OVERHEAD, (DRAWS, 1, 1)),
        square,
        np.random.default_rng(0),
    )
    step = S * 0.005 * Z / square.image_distance_mm
    assert found.std() == pytest.approx(2 * step, rel=0.04)
    # a normal law, and not an average over points
    assert np.mean(np.abs(found) <= 2 * step) == pytest.approx(math.erf(1 / math.sqrt(2)), abs=0.03)


def test_a_face_that_is_off_scales_a_rim():
    found = errors_of(dimension("diameter", EXACT_SIMULATED_COMMON_ERRORS, 0.1), OVERHEAD)
    assert found.std() == pytest.approx(24.0 * 0.1 / Z, rel=0.04)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("pose", [OVERHEAD, SLANTED], ids=["overhead", "slanted"])
@pytest.mark.parametrize(
    ("how", "surfaces_mm"),
    [(FLOOR, 0.0), (EXACT_SIMULATED_COMMON_ERRORS, 0.1)],
    ids=["floor", "surfaces"],
)
def test_each_common_error_alone_is_that_of_the_model(kind, pose, how, surfaces_mm):
    one = dimension(kind, how, surfaces_mm, (0, 1, 0) if kind == "distance" else None)
    still = Means(CAMERA_SIMULATED_COMMON_ERRORS, PoseUncertainty(np.zeros((6, 6))))
    told = one.describe(pose, still).standard_uncertainty
    found = errors_of(one, pose)
    assert found.std() == pytest.approx(told, rel=0.05, abs=1e-9)
    assert abs(found.mean()) <= 4 * told / math.sqrt(DRAWS) + 1e-5


@pytest.mark.parametrize("kind", ["diameter", "distance", "centre_to_edge", "length"])
def test_u_covers_what_is_simulated_with_everything(kind):
    one = dimension(
        kind, Localisation.gaussian(0.1), 0.05, (0, 1, 0) if kind == "distance" else None
    )
    uncertainty = PoseUncertainty.isotropic(translation_mm=0.02, rotation_rad=0.0003)
    told = one.describe(SLANTED, Means(CAMERA_SIMULATED_COMMON_ERRORS, uncertainty))
    # breaks of edges are not normal, and tested with P
    assert min(v for source, v in told.budget.items() if source != "edge_state") > 0
    poses = displaced_poses(SLANTED, uncertainty, DRAWS, np.random.default_rng(4))
    found = errors_of(one, SLANTED, poses)
    held = np.mean(np.abs(found) <= told.expanded_uncertainty)
    # 2 standard deviations of a normal law, and four of the count
    assert held == pytest.approx(math.erf(math.sqrt(2)), abs=4 * math.sqrt(0.0455 / DRAWS))


def test_without_common_errors_the_same_numbers_are_drawn_as_before():
    how = Localisation.gaussian(0.1, floor_px=0.0)
    one = dimension("diameter", how)
    rng = np.random.default_rng(3)
    errors_of(one, OVERHEAD)
    found, _ = measured_errors(one, OVERHEAD, OVERHEAD[None], CAMERA_SIMULATED_COMMON_ERRORS, rng)
    # one normal number for each coordinate of each point, and no other
    other = np.random.default_rng(3)
    other.normal(0.0, 0.1, (1, how.points, 2))
    assert rng.random() == other.random()
    assert np.isfinite(found).all()


# The compiled loops of simulation against computations of other libraries, and counts that end
# early.


RNG = np.random.default_rng(5)
SCALE = np.array([1200.0, 1250.0, 610.0, 505.0])
MATRIX = np.array([[1200.0, 0.0, 610.0], [0.0, 1250.0, 505.0], [0.0, 0.0, 1.0]])


def fitted(flat, radius):
    found = np.empty((len(flat), 3))
    fit_circles(np.ascontiguousarray(flat), radius, found)
    return found


def on_circle(angles, centre, radius):
    return np.stack([np.cos(angles), np.sin(angles)], axis=1) * radius + centre


def test_points_of_a_circle_give_it_back():
    angles = np.arange(16) * (2 * np.pi / 16)
    flat = np.array([on_circle(angles, (3.0, -2.0), 7.0), on_circle(angles / 4, (90.0, 5.0), 8.0)])
    assert fitted(flat, 7.5) == pytest.approx(np.array([[3.0, -2.0, 7.0], [90.0, 5.0, 8.0]]))


@pytest.mark.parametrize("span", [2 * np.pi, 2.0])
def test_fits_are_those_of_least_squares(span):
    angles = (np.arange(16) + 0.5) * (span / 16)
    flat = on_circle(angles, (1.0, 2.0), 7.0) + RNG.normal(0.0, 0.05, (20, 16, 2))

    def best(points):
        def residuals(circle):
            return np.linalg.norm(points - circle[:2], axis=1) - circle[2]

        return least_squares(residuals, [0.0, 0.0, 6.0], xtol=1e-14, ftol=1e-14, gtol=1e-14).x

    assert fitted(flat, 7.0) == pytest.approx(np.array([best(one) for one in flat]), abs=1e-6)


def test_points_that_are_none_spoil_their_own_circle_only():
    angles = np.arange(16) * (2 * np.pi / 16)
    flat = np.array([on_circle(angles, (0.0, 0.0), 7.0)] * 3)
    flat[1, 4] = np.nan
    found = fitted(flat, 7.0)
    assert np.isnan(found[1]).all()
    assert found[[0, 2]] == pytest.approx(np.array([[0.0, 0.0, 7.0]] * 2), abs=1e-9)


def test_images_are_those_of_the_matrix_and_come_back():
    poses = look_at(RNG.uniform((-40, -40, 260), (40, 40, 340), (5, 3)), [0.0, 0.0, 0.0])
    origin = np.array([1.0, -2.0, 3.0])
    frame = np.array([origin, [0.6, 0.0, 0.8], [0.0, 1.0, 0.0]])
    flat = RNG.uniform(-20, 20, (7, 2))
    points = np.ascontiguousarray(origin + flat @ frame[1:])
    images = np.empty((5, 7, 2))
    image_points(points, poses, SCALE, images)
    for pose, image in zip(poses, images, strict=True):
        local = np.linalg.solve(pose, np.column_stack([points, np.ones(7)]).T)[:3]
        homogeneous = MATRIX @ local
        assert image == pytest.approx((homogeneous[:2] / homogeneous[2]).T)
    back = np.empty((1, 7, 2))
    carry_back(np.ascontiguousarray(images[2:3]), poses[2].copy(), SCALE, frame, back)
    assert back[0] == pytest.approx(flat)


def test_what_is_behind_the_camera_has_no_image():
    images = np.empty((1, 2, 2))
    image_points(
        np.array([[0.0, 0.0, 5.0], [0.0, 0.0, -5.0]]), np.eye(4)[None].copy(), SCALE, images
    )
    assert images[0, 0] == pytest.approx([610.0, 505.0])
    assert np.isnan(images[0, 1]).all()


@pytest.mark.parametrize("bound", [0.5, 0.95, 0.9999])
def test_needed_successes_are_the_fewest_with_the_bound(bound):
    needed = successes_needed(bound, 2000)
    assert needed > 2000 or lower_bound(needed, 2000) >= bound
    assert lower_bound(needed - 1, 2000) < bound
    assert successes_needed(0.0, 2000) == successes_needed(-np.inf, 2000) == 0


def test_a_count_ends_early_only_where_the_bound_is_out_of_reach():
    plate = holed_plate()
    wanted = {"bore": Dimension.diameter(upper_rims(plate)[0], max_error_mm=0.1)}
    entities, targets = resolve_wanted(plate, wanted, 0.98)
    regions = compute_regions(plate, entities, workspace=[[-200, -200, -200], [300, 300, 500]])
    request = Problem(
        TargetSpace.of(regions, targets),
        ("bore",),
        CAMERA,
        UNCERTAINTY,
        targets=targets,
        localisation=Localisation.gaussian(1.0),
    )
    pose = look_at([[20.0, 25.0, 400.0]], [20.0, 25.0, 10.0])[0]
    checks = DisplacedChecks(request, ["bore"])
    whole = checks.count(pose, 5000, 3)
    (hits,) = whole.successes
    assert 0 < hits < 5000
    assert checks.count(pose, 5000, 3, hits) == whole
    short = checks.count(pose, 5000, 3, hits + 1)
    assert short.n == 5000
    assert hits <= short.successes[0] <= hits + 1000
    # almost all would have to succeed: the first thousand tell that they do not
    soon = checks.count(pose, 5000, 3, 5000)
    assert soon.successes[0] >= hits
    assert sum(sum(of) for of in soon.failures.values()) < sum(
        sum(of) for of in whole.failures.values()
    )


def test_settings_of_a_plan_share_their_trials():
    assert _trials_of(1) == _trials_of(10) == 100
    assert _trials_of(40) == 25
    assert _trials_of(10**6) == 1
