"""The joint posterior of unknowns from linear rows with biases that all rows of a group have in common.

Notation
--------
x   unknowns, normal with mean 0 and covariance P before     r   residuals of rows
A   how unknowns move rows                                   w   weights: 1 / variance of single rows
b   biases of a group, independent, with variance t each     M   how far they move the group's rows

With r = A x + M b + noise, the biases of a group are eliminated: its rows have the covariance diag(1/w) + t M Mᵀ, whose
inverse is W = diag(w) − diag(w) M (1/t + Mᵀ diag(w) M)⁻¹ Mᵀ diag(w) (Woodbury, 1950). The posterior is normal with
covariance C = (P⁻¹ + Σ Aᵀ W A)⁻¹ and mean C Σ Aᵀ W r over groups.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from errors.checks import check_finite, check_not_negative
from errors.exceptions import CovarianceError, InvalidShapeError

# Whether an estimate agrees with what was said of the unknowns before.
#
# Notation -------- m   estimate of the unknowns      P   their prior covariance      C   their
# posterior covariance
#
# If the prior is right, m is normal with mean 0 and covariance P − C: what was learnt. In units
# of the prior, this covariance has eigenvalues between 0 (nothing was learnt along a direction)
# and 1.


Array = NDArray[np.float64]

LEARNT = 0.25
"""Share of the prior's variance along a direction from which on the estimate says something of the prior."""


def surprise(mean: Array, covariance: Array, prior: Array) -> tuple[float, int]:
    """Return how much larger an estimate is than its prior lets expect.

    Parameters
    ----------
    mean : array (n,)
        The estimate.
    covariance, prior : array (n, n)
        Of the unknowns after and before; the prior is positive definite.

    Returns
    -------
    (float, int)
        Sum of squares along the directions that were learnt, each over its expected value; and their number. If the
        prior is right, the sum has a chi-squared distribution with so many degrees of freedom. If true unknowns are s
        times larger than stated, it is about s² times larger, or less.

    Examples
    --------
    One unknown is stated to 1 and was measured to 0.1 as 5:

    >>> import numpy as np
    >>> total, n = surprise(np.array([5.0]), np.array([[0.01]]), np.eye(1))
    >>> round(total, 2), n
    (25.25, 1)
    """
    if not len(mean):
        return 0.0, 0
    inverse = np.linalg.inv(np.linalg.cholesky(prior))
    learnt = np.eye(len(prior)) - inverse @ covariance @ inverse.T
    values, vectors = np.linalg.eigh((learnt + learnt.T) / 2)
    chosen = values >= LEARNT
    along = vectors[:, chosen].T @ (inverse @ mean)
    return float((along**2 / values[chosen]).sum()), int(chosen.sum())


# What an image does not determine: directions of the unknowns of which the posterior knows as
# little as the prior.


RESTS_SHARE = 0.8
"""A value rests on the prior if its standard deviation falls to no less than this share of it."""


def undetermined(covariance: Array, prior: Array, share: float = RESTS_SHARE) -> Array:
    """Return the directions of the unknowns that were learnt little about.

    Parameters
    ----------
    covariance, prior : array (n, n)
        Of the unknowns after and before; the prior is positive definite.
    share : float
        Least share of the prior's standard deviation that is left along a direction.

    Returns
    -------
    array (k, n)
        Directions, each one standard deviation of the prior long, those that were learnt least about first.
    """
    root = np.linalg.cholesky(prior)
    inverse = np.linalg.inv(root)
    values, vectors = np.linalg.eigh(inverse @ covariance @ inverse.T)
    chosen = np.flatnonzero(values >= share**2)[::-1]
    return np.asarray((root @ vectors[:, chosen]).T)


def rests_on_prior(
    covariance: Array, prior: Array, gradient: Array, standard_uncertainty: float
) -> bool:
    """Return whether a value is known from the prior rather than from the image.

    Parameters
    ----------
    covariance, prior : array (n, n)
        Of the unknowns after and before.
    gradient : array (n,)
        Of the value by the unknowns.
    standard_uncertainty : float
        Its whole u.

    Returns
    -------
    bool
        True if the unknowns are half of its variance or more, and their part of its standard deviation has fallen by
        less than a fifth (`RESTS_SHARE`).
    """
    after = float(gradient @ covariance @ gradient)
    before = float(gradient @ prior @ gradient)
    if after < 0.5 * standard_uncertainty**2:
        return False
    return after >= RESTS_SHARE**2 * before


class Rows(NamedTuple):
    """Rows of one group.

    Attributes
    ----------
    unknowns : array of int (k,)
        Which unknowns move them.
    design : array (m, k)
        How far, for each unit of these.
    residual : array (m,)
        How far off the rows were found.
    weight : array (m,)
        1 over the variance of each.
    modes : array (m, q) or None
        How far each bias of the group moves its rows. None is one bias, which moves all of them alike.
    """

    unknowns: NDArray[np.int64]
    design: Array
    residual: Array
    weight: Array
    modes: Array | None = None

    @property
    def biases(self) -> Array:
        """How far each bias moves the rows (m, q)."""
        return np.ones((len(self.weight), 1)) if self.modes is None else self.modes


@dataclass(frozen=True)
class Posterior:
    """What is known of the unknowns afterwards.

    Attributes
    ----------
    mean : array (n,)
        Their estimate.
    covariance : array (n, n)
        Its covariance.
    """

    mean: Array
    covariance: Array


def posterior(prior_covariance: Array, rows: Iterable[Rows], bias_variance: float) -> Posterior:
    """Return the posterior of unknowns.

    Parameters
    ----------
    prior_covariance : array (n, n)
        What is known before, about 0; positive definite.
    rows : iterable of Rows
        The rows of each group.
    bias_variance : float
        Variance of each bias of a group, in the square of the unit of the residuals.

    Returns
    -------
    Posterior
        Mean and covariance.

    Raises
    ------
    InvalidParameterError
        If the bias is negative, or the covariance is not positive definite.
    """
    prior = _check_prior(prior_covariance)
    bias = check_not_negative(bias_variance, "bias_variance")
    groups = list(rows)
    moving = _moving(prior, groups)
    scale = np.sqrt(np.diag(prior))[moving]
    # millimetres and radians are far apart: solved in units of the prior
    information = np.linalg.inv(prior[np.ix_(moving, moving)] / np.outer(scale, scale))
    right = np.zeros(len(moving))
    for group in groups:
        places = np.searchsorted(moving, group.unknowns)
        design = group.design * scale[places]
        weighted = design.T * group.weight
        modes, free = _freed(group, bias)
        common = weighted @ modes
        information[np.ix_(places, places)] += weighted @ design - common @ free @ common.T
        right[places] += weighted @ group.residual - common @ free @ (
            modes.T @ (group.weight * group.residual)
        )
    covariance = np.linalg.inv(information)
    covariance = (covariance + covariance.T) / 2
    mean = np.zeros(len(prior))
    mean[moving] = scale * (covariance @ right)
    every = prior.copy()
    every[np.ix_(moving, moving)] = covariance * np.outer(scale, scale)
    return Posterior(mean, every)


def bias_variance_of(rows: Iterable[Rows], estimate: Posterior, bias_variance: float) -> float:
    """Return the variance of the biases of groups that their rows show, given an estimate with another one.

    A step of expectation and maximization (Dempster, Laird and Rubin, 1977): the mean square of the biases, of what is
    estimated of them and of what remains unknown. Repeated, it ends at the variance that makes the rows most likely.

    Parameters
    ----------
    rows : iterable of Rows
        The rows of each group.
    estimate : Posterior
        Estimate of the unknowns from them.
    bias_variance : float
        The variance of each bias that it was estimated with, positive.

    Returns
    -------
    float
        The variance; the given one if there are no rows.
    """
    total = 0.0
    count = 0
    for group in rows:
        modes, free = _freed(group, bias_variance)
        gain = free @ (modes.T * group.weight)
        residual = group.residual - group.design @ estimate.mean[group.unknowns]
        moved = gain @ group.design
        covariance = estimate.covariance[np.ix_(group.unknowns, group.unknowns)]
        total += float(
            ((gain @ residual) ** 2).sum() + np.trace(free) + np.trace(moved @ covariance @ moved.T)
        )
        count += modes.shape[1]
    return total / count if count else bias_variance


def _freed(group: Rows, bias: float) -> tuple[Array, Array]:
    """Return how far biases move a group's rows (m, q), and the covariance (q, q) of the biases if only they did."""
    modes = group.biases
    if not bias > 0:
        return modes, np.zeros((modes.shape[1], modes.shape[1]))
    return modes, np.asarray(
        np.linalg.inv(np.eye(modes.shape[1]) / bias + (modes.T * group.weight) @ modes)
    )


def _moving(prior: Array, groups: list[Rows]) -> NDArray[np.int64]:
    """Return the unknowns that rows say something of: of the others only the prior tells.

    An image shows few of a large part's surfaces. All are returned if the prior ties the others to these.
    """
    mask = np.zeros(len(prior), dtype=bool)
    for group in groups:
        mask[group.unknowns] = True
    if prior[np.ix_(mask, ~mask)].any():
        return np.arange(len(prior))
    return np.flatnonzero(mask)


def _check_prior(value: Array) -> Array:
    """Return a covariance (n, n) that is positive definite."""
    prior = check_finite(value, "prior_covariance")
    if prior.ndim != 2 or prior.shape[0] != prior.shape[1]:
        raise InvalidShapeError.of_rule(
            "prior_covariance", "must have shape (n, n)", f"shape {prior.shape}"
        )
    variances = np.diag(prior)
    if not (variances > 0).all():
        raise CovarianceError.of_rule(
            "prior_covariance", "must have positive variances", f"{variances.min():g}"
        )
    # what is tied to nothing else is positive definite by its variance
    tied = np.flatnonzero(np.count_nonzero(prior, axis=1) > 1)
    scale = np.sqrt(variances[tied])
    correlation = prior[np.ix_(tied, tied)] / np.outer(scale, scale)
    try:
        # a third of the work of eigenvalues
        np.linalg.cholesky(correlation)
    except np.linalg.LinAlgError:
        lowest = float(np.linalg.eigvalsh(correlation).min())
        raise CovarianceError.of_rule(
            "prior_covariance", "must be positive definite", f"the (scaled) eigenvalue {lowest:g}"
        ) from None
    return prior
