"""Directions that an image says nothing about: a camera farther away, and everything larger."""

import numpy as np
import pytest

from errors.registration import Rows, posterior, rests_on_prior, undetermined

PRIOR = np.diag([1.0, 4.0])


def seen(known):
    """Rows that see only the difference of x0 and x1 / 2."""
    return posterior(
        PRIOR, [Rows(np.arange(2), known, np.zeros(len(known)), np.full(len(known), 1e6))], 0.0
    )


def test_the_sum_is_undetermined_if_only_the_difference_is_seen():
    covariance = seen(np.array([[1.0, -0.5]])).covariance
    (direction,) = undetermined(covariance, PRIOR)
    # both together, each by its standard deviation over the root of two
    np.testing.assert_allclose(np.abs(direction), [np.sqrt(0.5), 2 * np.sqrt(0.5)], rtol=1e-3)
    assert direction[0] * direction[1] > 0


def test_nothing_is_undetermined_if_both_are_seen():
    assert len(undetermined(seen(np.eye(2)).covariance, PRIOR)) == 0


@pytest.mark.parametrize(
    ("gradient", "rests"), [([1.0, -0.5], False), ([1.0, 0.5], True), ([0.0, 0.0], False)]
)
def test_a_value_rests_on_the_prior_along_such_a_direction(gradient, rests):
    covariance = seen(np.array([[1.0, -0.5]])).covariance
    g = np.array(gradient)
    u = float(np.sqrt(g @ covariance @ g)) + 1e-3
    assert rests_on_prior(covariance, PRIOR, g, u) is rests


def test_what_the_fit_adds_hides_the_prior():
    covariance = seen(np.array([[1.0, -0.5]])).covariance
    assert not rests_on_prior(covariance, PRIOR, np.array([1.0, 0.5]), 10.0)
