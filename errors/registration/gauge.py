"""What an image does not determine: directions of the unknowns of which the posterior knows as little as the prior."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

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
