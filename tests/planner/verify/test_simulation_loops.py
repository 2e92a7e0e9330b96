"""The compiled loops of simulation against computations of other libraries, and counts that end early."""

from __future__ import annotations

import numpy as np
import pytest
from holed_plate import CAMERA, UNCERTAINTY, holed_plate, upper_rims
from scipy.optimize import least_squares

from aspectgraph import compute_regions
from planner import Dimension, Localisation
from planner.camera.pose import look_at
from planner.request.problem import Problem
from planner.request.reach import TargetSpace
from planner.request.resolve import resolve_wanted
from planner.search.realise_column import _trials_of
from planner.verify.p_all import DisplacedChecks, lower_bound, successes_needed
from planner.verify.simulate_setting import carry_back, fit_circles, image_points

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
