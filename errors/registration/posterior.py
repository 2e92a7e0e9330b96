"""The joint posterior of unknowns from linear rows with a bias that all rows of a group have in common.

Notation
--------
x   unknowns, normal with mean 0 and covariance P before     r   residuals of rows
A   how unknowns move rows                                   w   weights: 1 / variance of single rows
b   bias of a group of rows, normal with variance t          G   groups

With r = A x + b + noise, the bias of a group is eliminated: its rows have the covariance diag(1/w) + t 1 1ᵀ, whose
inverse is diag(w) − w wᵀ / (1/t + Σ w) (Sherman and Morrison, 1950). The posterior is normal with covariance
C = (P⁻¹ + Σ Aᵀ W A)⁻¹ and mean C Σ Aᵀ W r over groups.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from errors.checks import check_finite, check_not_negative
from errors.exceptions import CovarianceError, InvalidShapeError

Array = NDArray[np.float64]


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
    """

    unknowns: NDArray[np.int64]
    design: Array
    residual: Array
    weight: Array


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
        Variance of the bias of each group, in the square of the unit of the residuals.

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
    scale = np.sqrt(np.diag(prior))
    # millimetres and radians are far apart: solved in units of the prior
    information = np.linalg.inv(prior / np.outer(scale, scale))
    right = np.zeros(len(prior))
    for group in rows:
        design = group.design * scale[group.unknowns]
        weighted = design.T * group.weight
        total = 1 / bias + group.weight.sum() if bias > 0 else np.inf
        common = weighted.sum(axis=1)
        at = np.ix_(group.unknowns, group.unknowns)
        information[at] += weighted @ design - np.outer(common, common) / total
        right[group.unknowns] += weighted @ group.residual - common * (
            (group.weight @ group.residual) / total
        )
    covariance = np.linalg.inv(information)
    covariance = (covariance + covariance.T) / 2
    return Posterior(scale * (covariance @ right), covariance * np.outer(scale, scale))


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
    scale = np.sqrt(variances)
    correlation = prior / np.outer(scale, scale)
    try:
        # a third of the work of eigenvalues
        np.linalg.cholesky(correlation)
    except np.linalg.LinAlgError:
        lowest = float(np.linalg.eigvalsh(correlation).min())
        raise CovarianceError.of_rule(
            "prior_covariance", "must be positive definite", f"the (scaled) eigenvalue {lowest:g}"
        ) from None
    return prior
