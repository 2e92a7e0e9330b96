"""Errors in a plane: closed forms, an exact table, and drawn samples."""

from __future__ import annotations

import math
import tracemalloc

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.stats import ncx2

from errors import CovarianceError, InvalidParameterError
from errors.measurands import Decision, DecisionRule, disc
from errors.measurands.disc import (
    Bonus,
    decide_position,
    deviation_interval,
    disc_probability,
    position_conformance,
    quadratic_disc_probability,
    quadratic_interval_probability,
)


@pytest.mark.parametrize(
    ("variances", "radius", "p"),
    [
        ((1.0, 1.0), 2.0, -math.expm1(-2.0)),
        ((1.0, 0.25), 2.0, 0.9454546),
        ((1.0, 0.25), 1.0, 0.5900953),
        ((1.0, 0.01), 2.0, 0.9542272),
        # the length of a vector along a line is that of one number
        ((1.0, 0.0), 2.0, math.erf(2.0 / math.sqrt(2.0))),
    ],
)
def test_the_probability_of_a_disc_is_that_of_the_exact_table(variances, radius, p):
    assert disc_probability(np.diag(variances), radius) == pytest.approx(p, abs=1e-6)
    # the other integral, about a mean that is hardly one, and second order without any
    assert disc_probability(np.diag(variances), radius, (0.0, 1e-12)) == pytest.approx(p, abs=1e-4)
    root = np.sqrt(np.diag(variances))
    exact = quadratic_disc_probability(root, np.zeros((2, 2, 2)), np.zeros((2, 2)), radius)
    if min(variances) > 0.0:
        assert exact == pytest.approx(p, abs=1e-6)


@pytest.mark.parametrize("distance", [0.1, 0.35, 0.4, 0.6, 1.5])
@pytest.mark.parametrize("sigma", [0.002, 0.05, 0.5])
def test_a_round_error_is_a_non_central_chi_squared_one(distance, sigma):
    centre = distance * np.array([math.cos(0.7), math.sin(0.7)])
    p = disc_probability(sigma**2 * np.eye(2), 0.4, centre)
    assert p == pytest.approx(ncx2.cdf((0.4 / sigma) ** 2, 2, (distance / sigma) ** 2), abs=1e-9)


def test_a_turned_frame_changes_no_probability():
    turn = np.array([[math.cos(1.1), -math.sin(1.1)], [math.sin(1.1), math.cos(1.1)]])
    covariance = np.diag([0.04, 0.01])
    centre = np.array([0.3, 0.2])
    p = disc_probability(covariance, 0.4, centre)
    assert disc_probability(turn @ covariance @ turn.T, 0.4, turn @ centre) == pytest.approx(p)


def test_second_order_agrees_with_drawn_errors():
    rng = np.random.default_rng(5)
    gradient = rng.normal(size=(2, 5)) * [[0.05], [0.02]]
    hessian = rng.normal(size=(2, 5, 5)) * 0.02
    hessian += hessian.transpose(0, 2, 1)
    noise = np.array([[4e-4, 1e-4], [1e-4, 3e-4]])
    delta = rng.normal(size=(400_000, 5))
    bent = 0.5 * np.stack([np.einsum("ni,ni->n", delta @ h, delta) for h in hessian], axis=1)
    errors = delta @ gradient.T + bent + rng.multivariate_normal([0, 0], noise, 400_000)
    for radius in (0.05, 0.15, 0.4):
        drawn = np.mean(np.hypot(*errors.T) <= radius)
        p = quadratic_disc_probability(gradient, hessian, noise, radius)
        assert p == pytest.approx(drawn, abs=4 * math.sqrt(drawn * (1 - drawn) / 400_000) + 1e-6)
        # the bend counts here: it is no noise of the same variance
        flat = quadratic_disc_probability(gradient, 0 * hessian, noise, radius)
        assert abs(flat - drawn) > 0.01


def bent_error(thin):
    """Return gradient, hessian and noise of an error that is wide along a leaning axis, and thin across it."""
    lean = np.array([[math.cos(0.4), -math.sin(0.4)], [math.sin(0.4), math.cos(0.4)]])
    gradient = np.array([[0.5, 0.1, 0.0, 0.0], [0.0, 0.0, 0.8 * thin, 0.3 * thin]])
    hessian = np.zeros((2, 4, 4))
    hessian[0, 0, 0] = 0.1
    hessian[0, 0, 2] = hessian[0, 2, 0] = 0.05
    hessian[1] = 0.3 * thin * np.eye(4)
    noise = np.diag([0.01, (0.2 * thin) ** 2])
    return lean @ gradient, np.einsum("ab,bij->aij", lean, hessian), lean @ noise @ lean.T


@pytest.mark.parametrize("thin", [0.02, 0.006, 0.004])
def test_a_thin_error_is_as_likely_along_its_axis_as_in_the_plane(thin, monkeypatch):
    error = bent_error(thin)
    in_plane = quadratic_disc_probability(*error, 1.0)
    monkeypatch.setattr(disc, "_THIN", (1.0, 1.0))
    along_axis = quadratic_disc_probability(*error, 1.0)
    # the thin component is correlated with the square of the wide one, and its own square is small
    assert along_axis == pytest.approx(in_plane, abs=0.25 * thin**2)


@pytest.mark.parametrize(("thin", "wide"), [(0.029, 5.7), (0.03, 2.4), (0.02, 1.8)])
def test_a_bent_error_that_leaves_the_disc_is_integrated_along_its_axis(thin, wide, monkeypatch):
    # as of a camera that turns: across its path an error is the square of what it is along it
    gradient = np.array([[wide], [0.0]])
    hessian = np.array([[[0.0]], [[math.sqrt(2.0) * thin]]])
    noise = np.diag([1e-4, 1e-6])
    along_axis = quadratic_disc_probability(gradient, hessian, noise, 1.0)
    monkeypatch.setattr(disc, "_THIN", (0.0, 0.0))
    assert along_axis == pytest.approx(
        quadratic_disc_probability(gradient, hessian, noise, 1.0), abs=2e-4
    )


def test_an_error_as_thin_as_a_line_takes_no_more_memory_than_others():
    gradient, hessian, noise = bent_error(1e-7)
    delta = np.random.default_rng(3).normal(size=(400_000, 4))
    bent = 0.5 * np.stack([np.einsum("ni,ni->n", delta @ h, delta) for h in hessian], axis=1)
    wide = np.random.default_rng(4).normal(size=400_000)[:, None] * math.sqrt(np.trace(noise))
    errors = delta @ gradient.T + bent + wide * [math.cos(0.4), math.sin(0.4)]
    drawn = np.mean(np.hypot(*errors.T) <= 0.5)
    tracemalloc.start()
    p = quadratic_disc_probability(gradient, hessian, noise, 0.5)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert p == pytest.approx(drawn, abs=4 * math.sqrt(drawn * (1 - drawn) / 400_000))
    assert peak < 50e6


def test_noise_across_a_line_alone_is_no_negative_variance_along_it():
    """The wide axis is at right angles to all noise, in any frame: rounding must not refuse it."""
    for angle in np.linspace(0.01, 3.1, 200):
        lean = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
        gradient = lean @ np.array([[0.5], [0.0]])
        noise = lean @ np.diag([0.0, 1e-8]) @ lean.T
        noise = (noise + noise.T) / 2.0
        p = quadratic_disc_probability(gradient, np.zeros((2, 1, 1)), noise, 1.0)
        assert p == pytest.approx(math.erf(2.0 / math.sqrt(2.0)), abs=1e-6)


def test_an_error_far_smaller_than_its_disc_stays_in_it():
    gradient, hessian, noise = bent_error(0.5)
    for radius in (1e3, 1e6, 1e12):
        assert quadratic_disc_probability(gradient, hessian, noise, radius) == 1.0
        assert quadratic_interval_probability(gradient[0], hessian[0], 0.01, radius) == 1.0


@pytest.mark.parametrize(("m", "p"), [(0.30, 0.9730623), (0.32, 0.9369972), (0.35, 0.8245996)])
def test_the_probability_that_a_position_conforms(m, p):
    assert position_conformance((m, 0.0), 0.05**2 * np.eye(2), 0.8) == pytest.approx(p, abs=1e-6)


@pytest.mark.parametrize(
    ("sigma", "radius", "largest"),
    [(0.05, 0.4, 0.3142287), (0.1, 0.4, 0.2185487), (0.02, 0.1, 0.0646097)],
)
def test_the_largest_deviation_that_conforms_is_less_than_in_one_dimension(sigma, radius, largest):
    def lacking(m):
        return position_conformance((0.0, m), sigma**2 * np.eye(2), 2 * radius) - 0.95

    assert brentq(lacking, 0.0, radius) == pytest.approx(largest, abs=1e-6)
    assert largest < radius - 1.645 * sigma


def test_a_material_condition_widens_the_zone_by_an_uncertain_bonus():
    covariance = 0.02**2 * np.eye(2)
    with_bonus = position_conformance((0.12, 0.0), covariance, 0.2, Bonus(0.06, 0.02))
    assert with_bonus == pytest.approx(0.6460991, abs=1e-6)
    assert position_conformance((0.12, 0.0), covariance, 0.2) == pytest.approx(0.1374852, abs=1e-6)
    # a size that is beyond its limit gives none, and takes none
    beyond = position_conformance((0.12, 0.0), covariance, 0.2, Bonus(-1.0, 0.02))
    assert beyond == pytest.approx(0.1374852, abs=1e-6)


def test_a_size_that_goes_with_the_position_is_drawn_with_it():
    joint = np.array([[4e-4, 1e-4, 2e-4], [1e-4, 9e-4, -3e-4], [2e-4, -3e-4, 4e-4]])
    drawn = np.random.default_rng(1).multivariate_normal([0.11, 0.05, 0.01], joint, 400_000)
    zone = 0.2 + np.maximum(0.0, drawn[:, 2])
    p = position_conformance((0.11, 0.05), joint[:2, :2], 0.2, Bonus(0.01, 0.02, (2e-4, -3e-4)))
    assert p == pytest.approx(np.mean(2 * np.hypot(*drawn[:, :2].T) <= zone), abs=0.003)


def test_the_interval_of_a_small_position_stays_above_zero():
    # about 0 the deviation of a round error is a Rayleigh variable
    low, high = deviation_interval((0.0, 0.0), 0.01**2 * np.eye(2))
    assert low == pytest.approx(0.02 * math.sqrt(-2 * math.log(0.975)), rel=1e-6)
    assert high == pytest.approx(0.02 * math.sqrt(-2 * math.log(0.025)), rel=1e-6)
    # far from it the deviation is normal, by the error along it
    low, high = deviation_interval((1.0, 0.0), np.diag([1e-4, 4e-4]))
    assert (low, high) == pytest.approx((2 - 0.0392, 2 + 0.0392), abs=1e-3)


def test_a_decision_needs_its_level_on_either_side():
    rule = DecisionRule.iso14253()
    assert decide_position(0.95, rule) is Decision.CONFORMS
    assert decide_position(0.5, rule) is Decision.UNDECIDED
    assert decide_position(0.05, rule) is Decision.DOES_NOT_CONFORM
    assert decide_position(0.51, DecisionRule.simple()) is Decision.CONFORMS
    with pytest.raises(InvalidParameterError, match="rule must be iso14253-1 or simple"):
        decide_position(0.5, DecisionRule.guard())


def test_what_is_no_covariance_is_refused():
    with pytest.raises(CovarianceError, match="covariance must be symmetric"):
        disc_probability([[1.0, 0.5], [0.0, 1.0]], 1.0)
    with pytest.raises(InvalidParameterError, match="radius"):
        disc_probability(np.eye(2), -1.0)
