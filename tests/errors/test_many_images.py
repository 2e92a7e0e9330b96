"""Tests of one posterior over many images: known answers, and two independent ways to the same numbers."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from errors.exceptions import CovarianceError, InvalidShapeError
from errors.many_images import (
    Estimate,
    Evidence,
    ManyImages,
    Prior,
    Slope,
    View,
    best_weights,
    evidence_of,
)
from errors.registration import Rows, posterior


def covariance_of(joint, first, second):
    """Covariance of two values that are pairs of slope and prior."""
    return joint.covariance(Estimate(*first), Estimate(*second))


NONE = Prior(np.empty(0, dtype=np.int64), np.empty(0))
SHARED = 7
OWN = 3


def rows_of(rng, count=4, noise=0.1):
    """Groups of rows that each move with all of a view's own unknowns and with some of the shared ones."""
    groups = []
    for _ in range(count):
        shared = OWN + rng.choice(SHARED, 3, replace=False)
        unknowns = np.concatenate([np.arange(OWN), np.sort(shared)])
        design = rng.normal(size=(6, len(unknowns)))
        weight = rng.uniform(0.5, 2.0, 6) / noise**2
        groups.append(Rows(unknowns, design, rng.normal(size=6), weight))
    return groups


def drawn(seed, views=3):
    """Variances of shared unknowns, priors of views, and their rows."""
    rng = np.random.default_rng(seed)
    variances = rng.uniform(0.01, 1.0, SHARED)
    priors = []
    for _ in range(views):
        root = rng.normal(size=(OWN, OWN))
        priors.append(root @ root.T + 0.1 * np.eye(OWN))
    return variances, priors, [rows_of(rng) for _ in range(views)], rng


def joined(variances, priors, rows):
    size = OWN + SHARED
    views = [
        View(prior, evidence_of(groups, size, 0.01))
        for prior, groups in zip(priors, rows, strict=True)
    ]
    return ManyImages(variances, views)


def dense(variances, priors, rows, prior):
    """The same by `errors.registration.posterior`, with all unknowns in one matrix: poses first."""
    own = OWN * len(priors)
    covariance = np.zeros((own + SHARED, own + SHARED))
    for k, one in enumerate(priors):
        covariance[OWN * k : OWN * (k + 1), OWN * k : OWN * (k + 1)] = one
    before = variances.copy()
    before[prior.free] = prior.variances
    covariance[own:, own:] = np.diag(before)
    groups = []
    for k, of_view in enumerate(rows):
        places = np.concatenate([OWN * k + np.arange(OWN), own + np.arange(SHARED)])
        groups += [group._replace(unknowns=places[group.unknowns]) for group in of_view]
    return posterior(covariance, groups, 0.01)


def gradient_of(value, views):
    total = np.zeros(OWN * views + SHARED)
    for k, part in value.by_view.items():
        total[OWN * k : OWN * (k + 1)] += part
    total[OWN * views :] = value.shared
    return total


def values_of(rng, views=3):
    values = []
    for _ in range(4):
        shown = rng.choice(views, 2, replace=False)
        own = {int(k): rng.normal(size=OWN) for k in shown}
        free = np.sort(rng.choice(SHARED, 2, replace=False))
        values.append((Slope(own, rng.normal(size=SHARED)), Prior(free, np.full(2, 50.0))))
    return values


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000))
def test_elimination_and_freeing_give_the_posterior_of_one_large_matrix(seed):
    variances, priors, rows, rng = drawn(seed)
    joint = joined(variances, priors, rows)
    for value, prior in values_of(rng):
        exact = dense(variances, priors, rows, prior)
        slope = gradient_of(value, 3)
        assert joint.mean(value, prior) == pytest.approx(slope @ exact.mean, rel=1e-8, abs=1e-10)
        variance = covariance_of(joint, (value, prior), (value, prior))
        assert variance == pytest.approx(slope @ exact.covariance @ slope, rel=1e-8)
        mean, covariance = joint.of_view(1, prior)
        at = np.concatenate([OWN + np.arange(OWN), 3 * OWN + np.arange(SHARED)])
        np.testing.assert_allclose(mean, exact.mean[at], rtol=1e-7, atol=1e-9)
        np.testing.assert_allclose(covariance, exact.covariance[np.ix_(at, at)], atol=1e-9)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000))
def test_the_order_of_images_does_not_matter(seed):
    variances, priors, rows, rng = drawn(seed)
    joint = joined(variances, priors, rows)
    turned = joined(variances, priors[::-1], rows[::-1])
    for value, prior in values_of(rng):
        other = Slope({2 - k: part for k, part in value.by_view.items()}, value.shared)
        assert turned.mean(other, prior) == pytest.approx(joint.mean(value, prior), rel=1e-9)
        pair = (other, prior), (other, prior)
        before = covariance_of(joint, (value, prior), (value, prior))
        assert covariance_of(turned, *pair) == pytest.approx(before, rel=1e-9)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000))
def test_more_images_and_rows_never_make_a_value_less_sure(seed):
    """And no images leave what was known before: so registered is never worse than not."""
    variances, priors, rows, rng = drawn(seed)
    values = values_of(rng, 2)
    unseen = [[], []]
    before = joined(variances, priors[:2], unseen)
    fewer = joined(variances, priors[:2], rows[:2])
    more = joined(variances, priors, rows)
    for value, prior in values:
        u = [covariance_of(one, (value, prior), (value, prior)) for one in (before, fewer, more)]
        stated = variances.copy()
        stated[prior.free] = prior.variances
        exact = (value.shared**2 * stated).sum()
        exact += sum(part @ priors[k] @ part for k, part in value.by_view.items())
        assert u[0] == pytest.approx(exact, rel=1e-9)
        assert u[2] <= u[1] * (1 + 1e-9) <= u[0] * (1 + 1e-8)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000))
def test_covariances_of_many_values_have_no_negative_eigenvalue(seed):
    variances, priors, rows, rng = drawn(seed)
    joint = joined(variances, priors, rows)
    values = values_of(rng) + values_of(rng)
    matrix = np.array([[covariance_of(joint, a, b) for b in values] for a in values])
    np.testing.assert_allclose(matrix, matrix.T, rtol=1e-9, atol=1e-12)
    assert np.linalg.eigvalsh(matrix).min() > -1e-9 * matrix.max()


def test_covariance_of_two_values_with_one_prior_is_what_draws_show():
    """Unknowns are drawn from the prior, rows from the unknowns, and both values are estimated from the rows."""
    variances, priors, rows, rng = drawn(5, views=2)
    prior = Prior(np.array([1, 4]), np.array([4.0, 9.0]))
    stated = variances.copy()
    stated[prior.free] = prior.variances
    values = [(value, prior) for value, _ in values_of(rng, 2)[:2]]
    n = 3000
    errors = np.empty((n, 2))
    for i in range(n):
        shared = rng.normal(size=SHARED) * np.sqrt(stated)
        true = [np.concatenate([rng.multivariate_normal(np.zeros(OWN), p), shared]) for p in priors]
        made = [
            [
                group._replace(
                    residual=group.design @ x[group.unknowns]
                    + rng.normal(size=6) / np.sqrt(group.weight)
                    + 0.1 * rng.normal()
                )
                for group in of_view
            ]
            for x, of_view in zip(true, rows, strict=True)
        ]
        joint = joined(variances, priors, made)
        for j, (value, _) in enumerate(values):
            exact = value.shared @ shared
            exact += sum(part @ true[k][:OWN] for k, part in value.by_view.items())
            errors[i, j] = joint.mean(value, prior) - exact
    stated_covariance = [[covariance_of(joint, a, b) for b in values] for a in values]
    scale = np.sqrt(np.diag(stated_covariance))
    # a standard deviation of 3,000 draws is known to 1.3 %
    np.testing.assert_allclose(errors.std(axis=0) / scale, 1.0, atol=0.06)
    drawn_covariance = np.cov(errors.T) / np.outer(scale, scale)
    np.testing.assert_allclose(
        drawn_covariance, stated_covariance / np.outer(scale, scale), atol=0.1
    )


def seen(sigma_own, sigma_rows):
    """A view of one own unknown and one shared one: rows show their sum."""
    information = np.full((2, 2), 1 / sigma_rows**2)
    return View(np.array([[sigma_own**2]]), Evidence(information, np.zeros(2)))


def test_two_images_of_a_rim_halve_what_is_independent():
    """Of the deviation of a face that carries it, nothing averages out: no row tells of it."""
    nothing = Evidence.nothing(2)
    joint = ManyImages(np.array([0.02**2]), [View(np.array([[0.05**2]]), nothing)] * 2)
    each = [Slope({k: np.ones(1)}, np.ones(1)) for k in range(2)]
    alone = covariance_of(joint, (each[0], NONE), (each[0], NONE))
    assert alone == pytest.approx(0.05**2 + 0.02**2)
    mean = each[0].times(0.5) + each[1].times(0.5)
    both = covariance_of(joint, (mean, NONE), (mean, NONE))
    assert both == pytest.approx(0.05**2 / 2 + 0.02**2)


@pytest.mark.parametrize(("parallel", "expected"), [(True, 0.01), (False, np.hypot(0.01, 0.04))])
def test_distance_of_two_rims_in_two_images(parallel, expected):
    """Each is known to 0.01 across; a face that carries both, off by 0.02, cancels if views are parallel."""
    nothing = Evidence.nothing(2)
    joint = ManyImages(np.array([0.02**2]), [View(np.array([[0.01**2 / 2]]), nothing)] * 2)
    lift = 1.0 if parallel else -1.0
    ends = [Slope({0: np.ones(1)}, np.ones(1)), Slope({1: np.ones(1)}, np.array([lift]))]
    distance = ends[0] + ends[1].times(-1.0)
    assert covariance_of(joint, (distance, NONE), (distance, NONE)) == pytest.approx(expected**2)


def test_an_image_that_shows_nothing_of_the_surfaces_changes_nothing():
    variances, priors, rows, rng = drawn(8)
    joint = joined(variances, priors, rows)
    size = OWN + SHARED
    only_own = np.zeros((size, size))
    only_own[:OWN, :OWN] = 40 * np.eye(OWN)
    views = [View(p, evidence_of(r, size, 0.01)) for p, r in zip(priors, rows, strict=True)]
    other = View(np.eye(OWN), Evidence(only_own, np.append(rng.normal(size=OWN), np.zeros(SHARED))))
    more = ManyImages(variances, [*views, other])
    for value, prior in values_of(rng):
        assert more.mean(value, prior) == joint.mean(value, prior)
        pair = (value, prior), (value, prior)
        assert covariance_of(more, *pair) == covariance_of(joint, *pair)


def test_an_unknown_that_a_value_measures_itself_is_not_pulled():
    """Rows say 1 to 0.1; stated to 0.01 it stays near 0, and free it is where the rows have it."""
    view = View(np.eye(1), Evidence(np.diag([0.0, 100.0]), np.array([0.0, 100.0])))
    joint = ManyImages(np.array([1e-4]), [view])
    value = Slope({}, np.ones(1))
    assert joint.mean(value, NONE) == pytest.approx(1 / 101)
    free = Prior(np.zeros(1, dtype=np.int64), np.array([1e4]))
    assert joint.mean(value, free) == pytest.approx(1.0, abs=1e-5)
    assert covariance_of(joint, (value, free), (value, free)) == pytest.approx(0.01, rel=1e-5)


def test_best_weights_are_those_of_least_squares():
    rng = np.random.default_rng(3)
    root = rng.normal(size=(3, 3))
    covariance = np.eye(3) + 0.1 * root @ root.T
    whiten = np.linalg.inv(np.linalg.cholesky(covariance))
    exact = np.linalg.lstsq((whiten @ np.ones(3))[:, None], whiten, rcond=None)[0]
    np.testing.assert_allclose(best_weights(covariance), exact[0], rtol=1e-12)


def test_a_worse_reading_with_the_same_errors_counts_nothing():
    covariance = np.outer([1.0, 2.0], [1.0, 2.0]) + 0.01 * np.eye(2)
    assert best_weights(covariance).tolist() == [1.0, 0.0]


def test_wrong_variances_and_shapes_are_refused():
    with pytest.raises(CovarianceError, match="variances must be positive"):
        ManyImages(np.zeros(1), [])
    with pytest.raises(InvalidShapeError, match="evidence must have shape"):
        ManyImages(np.ones(2), [seen(1.0, 1.0)])
