"""What a measurement error means for a tolerance: uncertainty ratio, acceptance limits.

The probability of the model is that of a small *error*. It is not the probability that a part conforms, which depends
on how parts vary, too (JCGM 106:2012). `decide` states that of a measured part, about which nothing else is known.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

from errors.checks import check_not_negative, check_positive, check_probability
from errors.exceptions import InvalidParameterError

COVERAGE = 2.0
"""Coverage factor k of the expanded uncertainty U = k u (JCGM 100:2008, 6.2)."""


def uncertainty_ratio(expanded: float, tolerance: tuple[float, float]) -> float:
    """Return U / T with T the tolerance's whole width; 0 of a tolerance with one limit.

    Parameters
    ----------
    expanded : float
        Expanded uncertainty U, in the tolerance's unit.
    tolerance : (float, float)
        Lower and upper deviation; an infinite one is no limit.

    Returns
    -------
    float
        U divided by upper minus lower deviation.
    """
    lower, upper = tolerance
    if math.isinf(upper - lower) and upper > lower:
        return 0.0
    return expanded / check_positive(upper - lower, "tolerance")


def acceptance_limits(
    tolerance: tuple[float, float], expanded: float
) -> tuple[float, float] | None:
    """Return the deviations between which a measured part is proven to conform (ISO 14253-1: guard band of U).

    Parameters
    ----------
    tolerance : (float, float)
        Lower and upper deviation that the drawing allows; an infinite one is no limit.
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


class Decision(StrEnum):
    """What a measured value says of a part. The values are those of files."""

    CONFORMS = "conforms"
    DOES_NOT_CONFORM = "does not conform"
    UNDECIDED = "undecided"
    NOT_MEASURED = "not measured"
    NO_TOLERANCE = "no tolerance"


@dataclass(frozen=True)
class DecisionRule:
    """How a value and its uncertainty decide.

    Make it with one of its class methods.

    Attributes
    ----------
    name : {"iso14253-1", "simple", "guard U"}
        Its name.
    level : float
        Probability that a decision is right, for ``iso14253-1``.

    Raises
    ------
    InvalidParameterError
        If the name is unknown, or the level is not in (0.5, 1).

    Examples
    --------
    >>> from planner import DecisionRule
    >>> str(DecisionRule.iso14253())
    'ISO 14253-1, 95 %'
    """

    name: str
    level: float = 0.95

    def __post_init__(self) -> None:
        if self.name not in ("iso14253-1", "simple", "guard U"):
            raise InvalidParameterError.of_rule(
                "rule", "must be one of iso14253-1, simple, guard U", repr(self.name)
            )
        level = check_probability(self.level, "level")
        if level <= 0.5:
            raise InvalidParameterError.of_rule("level", "must be above 0.5", repr(self.level))

    @classmethod
    def iso14253(cls, level: float = 0.95) -> DecisionRule:
        """Return the rule of ISO 14253-1:2017: a decision is right with this probability.

        A guard band of 1.65 u at 0.95 lies at each limit where the tolerance is wider than about 4 u. Both limits count
        where it is narrower (JCGM 106:2012, 7 and 8).

        Parameters
        ----------
        level : float
            The probability, in (0.5, 1).

        Returns
        -------
        DecisionRule
            The rule.
        """
        return cls("iso14253-1", level)

    @classmethod
    def simple(cls) -> DecisionRule:
        """Return simple acceptance: a value within the tolerance conforms, any other does not.

        Returns
        -------
        DecisionRule
            The rule.
        """
        return cls("simple")

    @classmethod
    def guard(cls) -> DecisionRule:
        """Return the rule of ISO 14253-1:1998: guard bands of the whole U.

        Returns
        -------
        DecisionRule
            The rule.
        """
        return cls("guard U")

    def __str__(self) -> str:
        """Return what a report says of it."""
        if self.name == "simple":
            return "simple acceptance"
        if self.name == "guard U":
            return "guard bands of U"
        return f"ISO 14253-1, {100 * self.level:g} %"


def conformance_probability(
    deviation: float, standard_uncertainty: float, tolerance: tuple[float, float]
) -> float:
    """Return the probability that a measured part is within its tolerance (JCGM 106:2012, 7.1).

    The true value is normal about the measured one.

    Parameters
    ----------
    deviation : float
        Measured value minus nominal value.
    standard_uncertainty : float
        Its standard uncertainty u, not negative.
    tolerance : (float, float)
        Lower and upper deviation that the drawing allows; an infinite one is no limit.

    Returns
    -------
    float
        In [0, 1].
    """
    u = check_not_negative(standard_uncertainty, "standard_uncertainty")
    lower, upper = tolerance
    if u == 0:
        return float(lower <= deviation <= upper)
    to_lower = (lower - deviation) / u
    to_upper = (upper - deviation) / u
    if to_lower > 0:
        # as the mirror image: a difference of tails keeps the digits that one of numbers near 1 loses
        return _below(-to_lower) - _below(-to_upper)
    if to_upper == math.inf:
        return _below(-to_lower)
    return _below(to_upper) - _below(to_lower)


def decide(
    deviation: float,
    standard_uncertainty: float,
    tolerance: tuple[float, float] | None,
    rule: DecisionRule,
) -> Decision:
    """Return what a measured deviation says of a part.

    Parameters
    ----------
    deviation : float
        Measured value minus nominal value.
    standard_uncertainty : float
        Its standard uncertainty u.
    tolerance : (float, float) or None
        Lower and upper deviation that the drawing allows; an infinite one is no limit.
    rule : DecisionRule
        How it is decided.

    Returns
    -------
    Decision
        The decision.
    """
    if tolerance is None:
        return Decision.NO_TOLERANCE
    lower, upper = tolerance
    if rule.name == "iso14253-1":
        p = conformance_probability(deviation, standard_uncertainty, tolerance)
        if p >= rule.level:
            return Decision.CONFORMS
        return Decision.DOES_NOT_CONFORM if 1 - p >= rule.level else Decision.UNDECIDED
    guard = COVERAGE * standard_uncertainty if rule.name == "guard U" else 0.0
    if lower + guard <= deviation <= upper - guard:
        return Decision.CONFORMS
    if deviation < lower - guard or deviation > upper + guard:
        return Decision.DOES_NOT_CONFORM
    return Decision.UNDECIDED


def _below(x: float) -> float:
    """Return the probability that a standard normal variable is below x."""
    return 0.5 * math.erfc(-x / math.sqrt(2))
