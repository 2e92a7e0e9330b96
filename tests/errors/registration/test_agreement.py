"""Whether estimates agree with what was stated: drawn unknowns, of which some directions are not measured."""

import numpy as np
import pytest

from errors.registration import Rows, posterior, surprise


def total(times, seed):
    """Sum and number of what 40 unknowns, of which 25 are measured, surprise by if they are some times too large."""
    rng = np.random.default_rng(seed)
    n = 40
    root = rng.normal(size=(n, n)) / 4 + np.eye(n)
    prior = root @ root.T
    truth = times * root @ rng.normal(size=n)
    design = rng.normal(size=(25, n))
    rows = [Rows(np.arange(n), design, design @ truth + rng.normal(0, 0.1, 25), np.full(25, 100.0))]
    found = posterior(prior, rows, 0.0)
    return surprise(found.mean, found.covariance, prior)


@pytest.mark.parametrize("times", [1.0, 3.0])
def test_the_sum_is_as_large_as_the_square_of_what_was_not_stated(times):
    sums = [total(times, seed) for seed in range(60)]
    assert {n for _, n in sums} == {25}
    # a mean of 60 sums of 25 squares: known to 1.83 %, three standard deviations 5.5 %
    assert np.mean([one for one, _ in sums]) == pytest.approx(25 * times**2, rel=0.055)


def test_nothing_that_was_learnt_surprises():
    prior = np.diag([1.0, 4.0])
    assert surprise(np.array([0.1, 0.1]), 0.9 * prior, prior) == (0.0, 0)
    assert surprise(np.empty(0), np.empty((0, 0)), np.empty((0, 0))) == (0.0, 0)
