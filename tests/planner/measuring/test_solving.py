"""Steps of a registration: where they end, how badly unknowns explain an image, and steps that are too long."""

import numpy as np
import pytest
from measured_plate import CAMERA, POSES, UNCERTAINTY, fine_plate, photograph, thick_plate
from scipy.stats import multivariate_normal

from errors.registration import Rows, posterior
from planner.measuring.fit import CORRELATION_PX, TUKEY
from planner.measuring.images import Picture
from planner.measuring.register import MOST_HALVINGS, Scanner
from planner.measuring.registered import FREE_PX, prior_covariance
from planner.measuring.samples import STEP_PX, PartModel
from planner.measuring.task import Found, cost_of, damped, noise_of, registration_task

NOISE = 0.1
VARIANCE = NOISE**2 * CORRELATION_PX / STEP_PX


@pytest.fixture(scope="module")
def task():
    model = PartModel(thick_plate(), {})
    prior = prior_covariance(model, UNCERTAINTY.covariance, 0.02, CAMERA)
    return registration_task(model, CAMERA, POSES[0], prior, 0.15)


def found_at(offset, good=None):
    count = len(offset)
    every = np.ones(count, dtype=bool) if good is None else good
    return [Found(offset, every, np.zeros(count, dtype=int), np.zeros(count))]


def test_steps_end_at_the_posterior():
    rng = np.random.default_rng(4)
    prior = np.diag([1.0, 4.0, 1e4])
    rows = [
        Rows(np.array([0, 1]), rng.normal(size=(9, 2)), rng.normal(size=9), np.full(9, 2.0))
        for _ in range(3)
    ]
    x = np.array([0.0, 0.0, 7.0])
    for _ in range(60):
        x = damped(prior, x, rows, 0.3)
    np.testing.assert_allclose(x[:2], posterior(prior, rows, 0.3).mean[:2], rtol=1e-12)
    # no row says anything of the third
    assert x[2] == 7.0


def test_a_step_along_what_hardly_shows_is_half_as_long():
    rows = [Rows(np.array([0]), np.full((1, 1), 1e-6), np.array([1.0]), np.array([1.0]))]
    begin = np.array([3.0])
    assert damped(np.eye(1), begin, rows, 0.0)[0] == pytest.approx(1.5, abs=1e-5)


def test_the_cost_is_a_logarithm_of_the_density(task):
    """Of two findings without outliers, it differs by -2 times what the dense normal distribution says."""
    rng = np.random.default_rng(7)
    n = len(task.samples.edge)
    pairs = [
        (
            0.01 * rng.normal(size=n),
            0.1 * rng.normal(size=len(task.prior)) * np.sqrt(np.diag(task.prior)),
        )
        for _ in range(2)
    ]
    cost = [cost_of(task, x, found_at(offset), NOISE) for offset, x in pairs]
    dense = 0.0
    for sign, (offset, x) in zip((1, -1), pairs, strict=True):
        dense += sign * multivariate_normal(cov=task.prior).logpdf(x)
        for own in task.own:
            m = own.stop - own.start
            covariance = VARIANCE * np.eye(m) + task.bias_px**2 * np.ones((m, m))
            dense += sign * multivariate_normal(cov=covariance).logpdf(offset[own])
    assert cost[0] - cost[1] == pytest.approx(-2 * dense, rel=1e-6)


def test_what_is_not_found_costs_as_much_as_an_outlier(task):
    n = len(task.samples.edge)
    nothing = np.zeros(len(task.prior))
    each = (TUKEY * NOISE) ** 2 / VARIANCE
    lost = np.arange(n) % 7 == 0
    assert cost_of(task, nothing, found_at(np.zeros(n)), NOISE) == 0
    assert cost_of(task, nothing, found_at(np.zeros(n), ~lost), NOISE) == pytest.approx(
        lost.sum() * each
    )
    off = np.where(lost, 4.0, 0.0)
    assert cost_of(task, nothing, found_at(off), NOISE) == pytest.approx(lost.sum() * each)
    # an edge that is found elsewhere as a whole costs no more than if it were not found
    own = max(task.own, key=lambda one: one.stop - one.start)
    off = np.zeros(n)
    off[own] = 50.0
    most = (own.stop - own.start) * each
    assert cost_of(task, nothing, found_at(off), NOISE) == pytest.approx(most)


def test_a_step_that_is_too_long_is_shortened(task):
    picture = Picture.of("one", photograph(fine_plate(), POSES[:1])[1], CAMERA)
    scanner = Scanner(task, [picture], [np.zeros(len(task.samples.edge), dtype=bool)])
    right = np.zeros(len(task.prior))
    off = right.copy()
    off[:2] = 0.3
    there = scanner.signed(right, 4.0, task.samples.edge)
    away = scanner.at(off, 4.0)
    noise = noise_of(task, there.found)
    assert cost_of(task, off, away.found, noise) > cost_of(task, right, there.found, noise) + 100
    # towards the truth a step is taken as it is, and away from it hardly any
    assert scanner.no_worse(there, away, 4.0) is there
    np.testing.assert_allclose(scanner.no_worse(away, there, 4.0).x, off / 2**MOST_HALVINGS)


@pytest.mark.parametrize("surfaces", [0.02, 20.0])
def test_of_a_measured_surface_nothing_is_assumed(surfaces):
    """Edges are searched half as far as its standard deviation; of the others the stated one is known."""
    model = PartModel(thick_plate(), {})
    model.free = {0}
    prior = np.sqrt(np.diag(prior_covariance(model, UNCERTAINTY.covariance, surfaces, CAMERA)))[6:]
    alone = np.sqrt(np.diag(prior_covariance(model, UNCERTAINTY.covariance, surfaces)))[6:]
    pixel = CAMERA.focus_distance_mm * 0.0138 / CAMERA.image_distance_mm
    np.testing.assert_allclose(prior[:3], np.maximum(alone[:3], FREE_PX * pixel), rtol=1e-9)
    np.testing.assert_array_equal(prior[3:], alone[3:])
