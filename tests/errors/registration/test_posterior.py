"""The joint posterior against a direct computation with a covariance of all rows."""

import numpy as np
import pytest

from errors.registration import Rows, bias_variance_of, posterior


def example(rng, n=5, groups=3, m=7):
    prior = np.diag(rng.uniform(0.5, 2.0, n)) + 0.1
    truth = rng.normal(size=n)
    rows = []
    for _ in range(groups):
        unknowns = np.sort(rng.choice(n, 3, replace=False))
        design = rng.normal(size=(m, 3))
        residual = design @ truth[unknowns] + rng.normal(size=m)
        rows.append(Rows(unknowns, design, residual, rng.uniform(0.5, 3.0, m)))
    return prior, rows


@pytest.mark.parametrize("bias", [0.0, 0.3])
def test_against_the_covariance_of_all_rows(bias):
    """Kalman's form, mean P Aᵀ S⁻¹ r and covariance P − P Aᵀ S⁻¹ A P, with the biases inside S."""
    prior, rows = example(np.random.default_rng(3))
    design = np.zeros((21, 5))
    noise = np.zeros((21, 21))
    for k, group in enumerate(rows):
        own = slice(7 * k, 7 * k + 7)
        design[own, group.unknowns] = group.design
        noise[own, own] = np.diag(1 / group.weight) + bias
    gain = prior @ design.T @ np.linalg.inv(design @ prior @ design.T + noise)
    found = posterior(prior, rows, bias)
    right = np.concatenate([group.residual for group in rows])
    np.testing.assert_allclose(found.mean, gain @ right, atol=1e-10)
    np.testing.assert_allclose(found.covariance, prior - gain @ design @ prior, atol=1e-10)


def test_nothing_found_leaves_the_prior():
    prior, _ = example(np.random.default_rng(0))
    found = posterior(prior, [], 0.1)
    np.testing.assert_allclose(found.covariance, prior, atol=1e-12)
    assert not found.mean.any()


def test_a_bias_that_can_be_anything_takes_what_all_rows_have_in_common():
    """One unknown that moves all rows of a group alike says nothing if the group's bias is unknown."""
    row = Rows(np.array([0]), np.ones((50, 1)), np.ones(50), np.full(50, 1e4))
    found = posterior(np.eye(1), [row], 1e6)
    assert found.mean[0] == pytest.approx(0.0, abs=1e-5)
    assert found.covariance[0, 0] == pytest.approx(1.0, abs=1e-5)


def test_a_free_unknown_takes_its_rows_from_the_others():
    """A group that an unknown of its own moves like another one tells nothing of that other one."""
    rng = np.random.default_rng(1)
    design = np.repeat(rng.normal(size=(30, 1)), 2, axis=1)
    found = posterior(
        np.diag([1.0, 1e8]), [Rows(np.array([0, 1]), design, design[:, 0], np.full(30, 1e3))], 0.0
    )
    assert found.covariance[0, 0] == pytest.approx(1.0, abs=1e-4)
    assert found.mean[0] == pytest.approx(0.0, abs=1e-4)


@pytest.mark.parametrize(
    ("prior", "message"),
    [
        (np.ones((2, 3)), r"prior_covariance must have shape \(n, n\)"),
        (np.diag([1.0, 0.0]), "prior_covariance must have positive variances"),
        (np.ones((2, 2)), "prior_covariance must be positive definite"),
    ],
)
def test_refusals(prior, message):
    with pytest.raises(ValueError, match=message):
        posterior(prior, [], 0.0)


def test_biases_with_modes_against_the_covariance_of_all_rows():
    """As above, with two biases of each group: all rows alike, and their ends against each other."""
    prior, rows = example(np.random.default_rng(4))
    modes = np.stack([np.ones(7), np.linspace(-0.5, 0.5, 7)], axis=1)
    rows = [group._replace(modes=modes) for group in rows]
    design = np.zeros((21, 5))
    noise = np.zeros((21, 21))
    for k, group in enumerate(rows):
        own = slice(7 * k, 7 * k + 7)
        design[own, group.unknowns] = group.design
        noise[own, own] = np.diag(1 / group.weight) + 0.3 * modes @ modes.T
    gain = prior @ design.T @ np.linalg.inv(design @ prior @ design.T + noise)
    found = posterior(prior, rows, 0.3)
    right = np.concatenate([group.residual for group in rows])
    np.testing.assert_allclose(found.mean, gain @ right, atol=1e-10)
    np.testing.assert_allclose(found.covariance, prior - gain @ design @ prior, atol=1e-10)


def test_unknowns_that_no_row_moves_keep_their_prior():
    """They are left out of what is solved, unless the prior ties them to others."""
    row = Rows(np.array([1]), np.ones((4, 1)), np.full(4, 2.0), np.full(4, 1.0))
    found = posterior(np.diag([3.0, 1.0, 5.0]), [row], 0.0)
    np.testing.assert_allclose(found.mean, [0.0, 1.6, 0.0])
    np.testing.assert_allclose(found.covariance, np.diag([3.0, 0.2, 5.0]), atol=1e-12)
    tied = np.array([[1.0, 0.5], [0.5, 1.0]])
    # the other one moves by its correlation: 0.5 of 1.6
    both = posterior(tied, [row], 0.0)
    np.testing.assert_allclose(both.mean, [0.8, 1.6])
    assert both.covariance[0, 0] == pytest.approx(1 - 0.25 * 0.8)


def test_rows_show_how_large_their_biases_are():
    """From 400 groups with biases of 0.5, stated as 0.1: known to 4 %, two standard deviations 7 %."""
    rng = np.random.default_rng(2)
    prior = np.eye(2)
    rows = []
    for _ in range(400):
        design = rng.normal(size=(6, 2))
        bias = rng.normal(0.0, 0.5)
        noise = rng.normal(0.0, 0.1, 6)
        rows.append(
            Rows(np.arange(2), design, design @ [0.3, -1.0] + bias + noise, np.full(6, 100.0))
        )
    variance = 0.01
    for _ in range(30):
        variance = bias_variance_of(rows, posterior(prior, rows, variance), variance)
    assert np.sqrt(variance) == pytest.approx(0.5, rel=0.08)
