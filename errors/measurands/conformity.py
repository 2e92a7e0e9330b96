"""What a measurement error means for a tolerance: uncertainty ratio, acceptance limits.

The probability of the model is that of a small *error*. It is not the probability that a part conforms, which depends
on how parts vary, too (JCGM 106:2012).
"""

from __future__ import annotations

from errors.checks import check_positive
from errors.exceptions import InvalidParameterError

COVERAGE = 2.0
"""Coverage factor k of the expanded uncertainty U = k u (JCGM 100:2008, 6.2)."""


def uncertainty_ratio(expanded: float, tolerance: tuple[float, float]) -> float:
    """Return U / T with T the tolerance's whole width.

    Parameters
    ----------
    expanded : float
        Expanded uncertainty U, in the tolerance's unit.
    tolerance : (float, float)
        Lower and upper deviation.

    Returns
    -------
    float
        U divided by upper minus lower deviation.
    """
    lower, upper = tolerance
    return expanded / check_positive(upper - lower, "tolerance")


def acceptance_limits(
    tolerance: tuple[float, float], expanded: float
) -> tuple[float, float] | None:
    """Return the deviations between which a measured part is proven to conform (ISO 14253-1: guard band of U).

    Parameters
    ----------
    tolerance : (float, float)
        Lower and upper deviation that the drawing allows.
    expanded : float
        Expanded uncertainty U, not negative.

    Returns
    -------
    (float, float) or None
        The tolerance less U at either side; None if nothing is left, so that conformity cannot be proven.

    Raises
    ------
    InvalidParameterError
        If the uncertainty is negative.
    """
    if not expanded >= 0:
        raise InvalidParameterError(f"expanded must not be negative. Got {expanded!r}.")
    lower = tolerance[0] + expanded
    upper = tolerance[1] - expanded
    return (lower, upper) if lower <= upper else None
