"""Results: the readings of one target merged, its expanded uncertainty, and the decision."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from scipy.stats import chi2 as chi_squared

from errors.measurands import Decision, DecisionRule, conformance_probability, decide
from errors.measurands.conformity import COVERAGE
from planner.measuring.reading import Reading
from planner.wanted.planned import PlannedTarget

CONSISTENT = 0.99
"""Readings of one target that differ more than with this probability are said to disagree."""

# errors that readings from several images have in common
_COMMON = ("surfaces", "localisation floor")


@dataclass(frozen=True)
class Result:
    """One target, measured.

    Attributes
    ----------
    name, kind, unit : str
        The target.
    nominal : float
        Nominal value, mm (angles: degrees), as everything here.
    tolerance : (float, float) or None
        Lower and upper deviation that the drawing allows.
    value : float
        Measured value; nan if it was not measured.
    standard_uncertainty : float
        Its u.
    decision : Decision
        What it says of the part.
    conformance_probability : float
        Probability that the part is within its tolerance; nan without value or tolerance.
    reason : str
        Why it was not measured; empty if it was.
    readings : tuple of Reading
        In the order of the images.
    notes : tuple of str
        What the user should know.
    """

    name: str
    kind: str
    unit: str
    nominal: float
    tolerance: tuple[float, float] | None
    value: float
    standard_uncertainty: float
    decision: Decision
    conformance_probability: float
    reason: str
    readings: tuple[Reading, ...]
    notes: tuple[str, ...] = field(default=())

    @property
    def measured(self) -> bool:
        """Whether it has a value."""
        return not self.reason

    @property
    def deviation(self) -> float:
        """Measured value minus nominal value."""
        return self.value - self.nominal

    @property
    def expanded_uncertainty(self) -> float:
        """U, two standard uncertainties."""
        return COVERAGE * self.standard_uncertainty

    @property
    def budget(self) -> dict[str, float]:
        """Variance by source of the reading with the smallest uncertainty; empty if none was measured."""
        measured = [one for one in self.readings if one.measured]
        if not measured:
            return {}
        return min(measured, key=lambda one: one.standard_uncertainty).budget


def merged(
    name: str,
    target: PlannedTarget,
    readings: Sequence[Reading],
    rule: DecisionRule,
    missing: str = "",
) -> Result:
    """Return the result of a target.

    Readings are weighted by their variances. What pose and single points do is independent between images. The
    deviations of surfaces and the floor of the localisation are common, and do not average out.

    Parameters
    ----------
    name : str
        The target's name.
    target : PlannedTarget
        The target.
    readings : sequence of Reading
        Its readings.
    rule : DecisionRule
        How it is decided.
    missing : str
        Why there is no reading at all.
    """
    known = (name, target.kind, target.unit, target.nominal, target.tolerance)
    good = [one for one in readings if one.measured]
    if not good:
        reason = missing or "; ".join(dict.fromkeys(f"{r.image}: {r.reason}" for r in readings))
        nothing = (math.nan, math.nan, Decision.NOT_MEASURED, math.nan)
        return Result(*known, *nothing, reason or "no image shows it", tuple(readings))
    value, u, notes = _weighted(good)
    notes += tuple(dict.fromkeys(note for one in good for note in one.notes))
    deviation = value - target.nominal
    decision = decide(deviation, u, target.tolerance, rule)
    probability = math.nan
    if target.tolerance is not None:
        probability = conformance_probability(deviation, u, target.tolerance)
    return Result(*known, value, u, decision, probability, "", tuple(readings), notes)


def _weighted(readings: Sequence[Reading]) -> tuple[float, float, tuple[str, ...]]:
    """Return the weighted mean of readings, its standard uncertainty, and notes."""
    if len(readings) == 1:
        return readings[0].value, readings[0].standard_uncertainty, ()
    inverse = [1 / max(one.standard_uncertainty, 1e-12) ** 2 for one in readings]
    weights = [one / math.fsum(inverse) for one in inverse]
    value = math.fsum(w * one.value for w, one in zip(weights, readings, strict=True))
    common = math.fsum(
        w * math.sqrt(math.fsum(one.budget[source] for source in _COMMON))
        for w, one in zip(weights, readings, strict=True)
    )
    own = math.fsum(
        w**2 * (one.standard_uncertainty**2 - math.fsum(one.budget[s] for s in _COMMON))
        for w, one in zip(weights, readings, strict=True)
    )
    u = math.sqrt(max(common**2 + own, 0.0))
    spread = math.fsum(
        (one.value - value) ** 2 * i for one, i in zip(readings, inverse, strict=True)
    )
    freedoms = len(readings) - 1
    if spread <= chi_squared.ppf(CONSISTENT, freedoms):
        return value, u, ()
    note = f"{len(readings)} readings disagree: u is enlarged by their spread"
    return value, u * math.sqrt(spread / freedoms), (note,)
