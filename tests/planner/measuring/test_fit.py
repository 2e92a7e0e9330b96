"""Fits of lines and circles in their own freedoms, with points of which some are wrong."""

import numpy as np
import pytest

from errors.measurands import Line, MeasuredCircle
from planner.measuring.fit import robust_fit, uneven_px

CIRCLE = MeasuredCircle([0, 0, 0], [0, 0, 1], 10.0)
LINE = Line([-20, 0, 0], [20, 0, 0])


def circle_points(rng, n=200, noise=0.0, centre=(0.2, -0.1), radius=10.3):
    angle = np.linspace(0, 2 * np.pi, n, endpoint=False)
    far = radius + rng.normal(0, 1, n) * noise
    return np.c_[np.cos(angle), np.sin(angle)] * far[:, None] + centre


def test_exact_points():
    rng = np.random.default_rng(0)
    fit, kept = robust_fit(CIRCLE, circle_points(rng), np.full(200, 7.0))
    np.testing.assert_allclose(fit.fitted, [0.2, -0.1, 10.3], atol=1e-9)
    assert kept.all()
    x = np.linspace(-20, 20, 50)
    fit, kept = robust_fit(LINE, np.c_[x, 0.05 + 0.002 * x], np.full(50, 7.0))
    np.testing.assert_allclose(fit.fitted, [0.05, 0.002], atol=1e-12)


def test_a_shadow_on_a_quarter_of_a_rim_is_left_out():
    rng = np.random.default_rng(1)
    points = circle_points(rng, noise=0.005)
    points[:50] *= 1.04
    fit, kept = robust_fit(CIRCLE, points, np.full(200, 7.0))
    np.testing.assert_allclose(fit.fitted, [0.2, -0.1, 10.3], atol=0.005)
    assert not kept[:50].any()
    assert kept[50:].mean() > 0.97


def test_covariance_is_the_spread_of_fits():
    """300 fits of noisy points: variances of what is fitted, per px², within what their number tells."""
    rng = np.random.default_rng(2)
    noise = 0.01
    angle = np.linspace(0, 4.0, 80)
    scale = np.full(80, 5.0)
    found = []
    for _ in range(300):
        far = 10.0 + rng.normal(0, noise, 80)
        points = np.c_[np.cos(angle), np.sin(angle)] * far[:, None]
        fit, _ = robust_fit(CIRCLE, points, scale)
        found.append(fit.fitted)
    spread = np.var(found, axis=0)
    # .01 mm are .05 px; a variance of 300 is known to 8 %
    np.testing.assert_allclose(spread, np.diag(fit.covariance) * 0.05**2, rtol=0.3)


def test_what_all_points_have_in_common_is_the_radius_or_the_offset():
    rng = np.random.default_rng(0)
    fit, _ = robust_fit(CIRCLE, circle_points(rng), np.full(200, 7.0))
    np.testing.assert_allclose(fit.common[:, 0], [0, 0, 1 / 7], atol=1e-9)
    # opposite sides together: the centre, by half a px
    np.testing.assert_allclose(fit.common[:2, 1:], np.eye(2) / 14, atol=1e-9)
    x = np.linspace(-20, 20, 50)
    fit, _ = robust_fit(LINE, np.c_[x, 0 * x], np.full(50, 4.0))
    np.testing.assert_allclose(fit.common, [[0.25, 0], [0, 0.125 / 20]], atol=1e-12)


@pytest.mark.parametrize("share", [0.3, 0.45])
def test_many_wrong_points_do_not_bend_a_line(share):
    rng = np.random.default_rng(4)
    x = np.linspace(-20, 20, 100)
    y = 0.01 * rng.normal(size=100)
    y[: int(100 * share)] += 0.6
    fit, _ = robust_fit(LINE, np.c_[x, y], np.full(100, 7.0))
    assert np.isfinite(fit.fitted).all()


def test_points_on_a_line_are_no_circle_and_no_crash():
    """Three points that a first circle is drawn through may lie on a line: here most do."""
    turn = np.linspace(0.0, 2 * np.pi, 8, endpoint=False)
    flat = np.column_stack([np.linspace(-1.0, 1.0, 30), np.zeros(30)])
    flat = np.concatenate([flat, np.column_stack([np.cos(turn), np.sin(turn)])])
    fit, kept = robust_fit(
        MeasuredCircle([0, 0, 0], [0, 0, 1], 1.0), flat, np.full(len(flat), 20.0)
    )
    assert np.isfinite(fit.fitted).all()
    assert len(kept) == len(flat)


def test_a_stretch_that_is_off_is_told_from_noise_of_single_points():
    """Noise alone: less than a third of it. A fifth of the points off by 0.4 px: the root of a fifth of that square."""
    rng = np.random.default_rng(3)
    noise = rng.normal(0.0, 0.05, 400)
    assert uneven_px(noise, 2.5) < 0.05 / 3
    off = noise.copy()
    off[100:180] += 0.4
    assert uneven_px(off, 2.5) == pytest.approx(0.4 * np.sqrt(0.2), rel=0.05)
    assert uneven_px(np.array([0.3]), 2.5) == 0.0


def test_points_that_overlap_in_the_image_are_not_a_stretch_that_is_off():
    """Neighbours 2.5 px apart that have half of their error in common are counted as fewer points, not as a stretch."""
    rng = np.random.default_rng(4)
    single = rng.normal(0.0, 0.05, 4001)
    noise = (single[1:] + single[:-1]) / np.sqrt(2)
    assert uneven_px(noise, 2.5) < 0.05 / 4
    assert uneven_px(noise, 5.0) == pytest.approx(0.05 / np.sqrt(2), rel=0.1)
