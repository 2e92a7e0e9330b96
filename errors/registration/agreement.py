"""Whether an estimate agrees with what was said of the unknowns before.

Notation
--------
m   estimate of the unknowns      P   their prior covariance      C   their posterior covariance

If the prior is right, m is normal with mean 0 and covariance P − C: what was learnt. In units of the prior, this
covariance has eigenvalues between 0 (nothing was learnt along a direction) and 1.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

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
