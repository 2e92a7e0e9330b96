"""The readings of one target merged: its value, its expanded uncertainty, and the decision."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from errors.checks import chi_squared_quantile
from errors.many_images import best_weights
from errors.measurands import (
    Bonus,
    Decision,
    DecisionRule,
    End,
    Measurand,
    Position,
    acceptance_limits,
    conformance_probability,
    decide,
    decide_deviation,
    deviation_interval,
)
from errors.measurands.measurand import COVERAGE
from planner.measuring.reading import Reading
from planner.measuring.results import Result, variances_of_points
from planner.request.dimension import POSITIONS, MaterialCondition
from planner.request.targets import Target
from planner.text_table import enumerated

CONSISTENT = 0.99
"""Readings of one target that differ more than with this probability are said to disagree."""

_LEAST_VARIANCE = 1e-24
# errors that readings from several images have in common beside poses and surfaces
_ALIKE = ("localisation floor", "response", "edge state")


def merged(
    name: str,
    target: Target,
    readings: Sequence[Reading],
    rule: DecisionRule,
    missing: str = "",
    *,
    common: NDArray[np.float64] | None = None,
) -> Result:
    """Return the result of a target.

    Readings have the weights that make the variance least, see `errors.many_images.best_weights`. Single points are
    independent between images. The floor of the localisation, the response and broken edges are common, and do not
    average out.

    Parameters
    ----------
    name : str
        The target's name.
    target : Target
        The target.
    readings : sequence of Reading
        Its readings.
    rule : DecisionRule
        How it is decided.
    missing : str
        Why there is no reading at all.
    common : array (n, n), optional
        Covariance of the measured readings by poses and surfaces. Default: poses are independent, and surfaces common.
    """
    target_fields = (name, target.kind, target.unit, target.nominal, target.tolerance)
    good = [reading for reading in readings if reading.measured]
    if not good:
        reason = missing or "; ".join(dict.fromkeys(f"{r.image}: {r.reason}" for r in readings))
        nothing = (math.nan, math.nan, Decision.NOT_MEASURED, math.nan)
        # of the image in which most of it was found
        advised = sorted(
            (r for r in readings if r.advice), key=lambda r: r.found_share, reverse=True
        )
        advice = advised[0].advice if advised else ""
        reason = reason or "no image shows it"
        unread = Result(*target_fields, *nothing, reason, tuple(readings), advice=advice)
        return replace(unread, **_zone_of(target))
    if good[0].deviation_mm and target.tolerance is not None:
        return _position_result(name, target, readings, rule)
    return _measured(name, target, readings, _weighted(good, common), rule)


def _zone_of(target: Target) -> dict[str, Any]:
    """Return what widens the zone of a position, and its datums; nothing of another target."""
    if target.kind not in POSITIONS:
        return {}
    material = "" if target.material is None else target.material.condition
    return {"material": material, "datums": target.datum_names}


def joined_ends(
    name: str,
    target: Target,
    ends: Sequence[Reading],
    rule: DecisionRule,
    common: NDArray[np.float64],
) -> Result:
    """Return the result of a target whose entities are read in different images.

    The deviation is the sum of those by each entity. Localisation and its floor are errors of each entity. The response
    may move both alike, so its standard deviations are added up. Breaks that nobody stated have one mean for all.

    Parameters
    ----------
    name : str
        The target's name.
    target : Target
        The target.
    ends : sequence of Reading (n,)
        The reading of each entity.
    rule : DecisionRule
        How it is decided.
    common : array (n, n)
        Covariance of the readings by poses and surfaces.
    """
    value = target.nominal + math.fsum(end.value - target.nominal for end in ends)
    variance = float(common.sum()) + math.fsum(variances_of_points(ends).values())
    combined = _Combined(value, math.sqrt(variance), (_where_text(ends),))
    return _measured(name, target, ends, combined, rule)


def joined_reading(ends: Sequence[Reading], common: NDArray[np.float64]) -> Reading:
    """Return a component of a position whose entities are read in different images, as if one image showed it.

    Parameters
    ----------
    ends : sequence of Reading (n,)
        The reading of each entity.
    common : array (n, n)
        Covariance of the readings by poses and surfaces.
    """
    variance = float(common.sum()) + math.fsum(variances_of_points(ends).values())
    return Reading(
        ends[0].name,
        ", ".join(dict.fromkeys(end.image for end in ends)),
        ends[0].setting,
        value=math.fsum(end.value for end in ends),
        standard_uncertainty=math.sqrt(max(variance, 0.0)),
    )


def joined_position(
    target: Target, joined: Reading, ends: Sequence[Reading], rule: DecisionRule
) -> Result:
    """Return the result of a position whose rim and datums are read in different images.

    Parameters
    ----------
    target : Target
        The position.
    joined : Reading
        Its deviation with covariance.
    ends : sequence of Reading
        The reading of each entity along the deviation.
    rule : DecisionRule
        How it is decided.
    """
    values, axes = np.linalg.eigh(np.array(joined.covariance_mm2))
    # what moves all edges alike is added up without its signs, so that an eigenvalue may be below 0
    covariance = (axes * np.maximum(values, 0.0)) @ axes.T
    counted = replace(joined, covariance_mm2=tuple(map(tuple, covariance.tolist())))
    result = _position_result(target.name, target, [counted], rule)
    notes = [_where_text(ends), *result.notes]
    notes += dict.fromkeys(note for end in ends for note in end.notes)
    return replace(result, readings=tuple(ends), notes=tuple(notes))


class ScannedEnd(NamedTuple):
    """One entity of a target in an image.

    Attributes
    ----------
    read : callable
        Returns the reading of what the entity has in a value.
    first : Reading
        That of its share in the target; of a position, in its first component.
    spread : float
        Standard deviation of this; of a position, of all components.
    """

    read: Callable[[End], Reading]
    first: Reading
    spread: float


def read_with(
    value: Measurand, read: Callable[[Measurand], Reading], *, with_size: bool = False
) -> Reading:
    """Return the reading of a value; a position is read by its components.

    Parameters
    ----------
    value : Measurand
        The value.
    read : callable
        Reads a value that is nearly linear in what is fitted.
    with_size : bool
        Whether the diameter of a position's rim is read, too.

    Returns
    -------
    Reading
        Of a position 2‖e‖ the uncertainty is that along e, and ``deviation_mm`` and ``covariance_mm2`` are those of e.
        With a size, the covariance has a further row and column for it.
    """
    if not isinstance(value, Position):
        return read(value)
    n = len(value.frame.errors)
    first = read(value.along(np.eye(n)[0]))
    if not first.measured:
        return first
    # of sums of two, the variance tells their covariance
    shares = np.eye(n + with_size)
    m = len(shares)
    readings = {
        (i, j): read(value.along(row[:n], float(row[n:].sum())))
        for i in range(m)
        for j in range(i, m)
        for row in (shares[i] + (i != j) * shares[j],)
    }
    variances = {pair: reading.standard_uncertainty**2 for pair, reading in readings.items()}
    covariance = np.diag([variances[k, k] for k in range(m)])
    for (i, j), variance in variances.items():
        if i != j:
            both = 0.5 * (variance - variances[i, i] - variances[j, j])
            covariance[i, j] = covariance[j, i] = both
    e = np.array([readings[k, k].value for k in range(n)])
    size_mm = math.nan
    if with_size:
        size_mm = value.size_mm + readings[n, n].value
    axis = np.linalg.eigh(covariance[:n, :n])[1][:, -1]
    distance = float(np.linalg.norm(e))
    if distance > 0.0:
        axis = e / distance
    reading = read(value.along(2.0 * axis))
    return replace(
        reading,
        value=2.0 * distance,
        deviation_mm=tuple(e.tolist()),
        covariance_mm2=tuple(map(tuple, covariance.tolist())),
        size_mm=size_mm,
    )


def position_of_ends(
    target: Target,
    entities: Sequence[ScannedEnd],
    common_of: Callable[[Sequence[Reading]], NDArray[np.float64]],
    rule: DecisionRule,
) -> Result:
    """Return the result of a position whose rim and datums are in different images.

    Parameters
    ----------
    target : Target
        The position.
    entities : sequence of ScannedEnd
        What shows each of its entities best.
    common_of : callable
        Returns the covariance of readings by poses and surfaces.
    rule : DecisionRule
        How it is decided.
    """
    readings: list[Reading] = []

    def read(component: Measurand) -> Reading:
        readings[:] = [entity.read(End(component, k)) for k, entity in enumerate(entities)]
        return joined_reading(readings, common_of(readings))

    joined = read_with(target.measurand, read, with_size=target.material is not None)
    # the last ones are those along e
    return joined_position(target, joined, readings, rule)


def _where_text(ends: Sequence[Reading]) -> str:
    places = ", ".join(f"{end.entity} in {end.image}" for end in ends)
    if len({end.image for end in ends}) == 1:
        entities = enumerated([end.entity for end in ends])
        return f"no setting is planned for all of it, so each entity is read by itself in {ends[0].image}: {entities}"
    return f"no image shows all of it: {places}"


class _Combined(NamedTuple):
    """The value of several readings, its standard uncertainty, and what the user should know."""

    value: float
    u: float
    notes: tuple[str, ...] = ()


def _measured(
    name: str,
    target: Target,
    readings: Sequence[Reading],
    combined: _Combined,
    rule: DecisionRule,
) -> Result:
    """Return the result of a target that has a value."""
    value, u, notes = combined
    notes += tuple(dict.fromkeys(note for r in readings if r.measured for note in r.notes))
    deviation = value - target.nominal
    decision = decide(deviation, u, target.tolerance, rule)
    probability = math.nan
    accepted = None
    if target.tolerance is not None:
        probability = conformance_probability(deviation, u, target.tolerance)
        accepted = acceptance_limits(target.tolerance, u, rule)
    return Result(
        *(name, target.kind, target.unit, target.nominal, target.tolerance),
        *(value, u, decision, probability),
        *("", tuple(readings), notes, accepted),
    )


def _position_result(
    name: str, target: Target, readings: Sequence[Reading], rule: DecisionRule
) -> Result:
    """Return the result of a position, by its best reading: two components, decided in a disc."""
    good = [reading for reading in readings if reading.measured]
    best = surest(good)
    tolerance = target.tolerance or (0.0, 0.0)
    n = len(best.deviation_mm)
    joint = np.array(best.covariance_mm2)
    covariance = joint[:n, :n]
    bonus = _bonus(target.material, best)
    decision, probability = decide_deviation(
        best.deviation_mm, covariance, tolerance[1], rule, bonus
    )
    e = ", ".join(f"{component:+.4f}" for component in best.deviation_mm)
    notes = [
        f"e = ({e}) mm in the plane of the rim and the axes of the datum frame; a rim does not show the axis"
    ]
    bonus_mm = math.nan
    if bonus is not None:
        bonus_mm = max(0.0, bonus.surplus_mm)
        condition = target.material.condition if target.material is not None else ""
        notes.append(
            f"bonus {bonus_mm:.4f} mm by ({condition}): the size is {best.size_mm:.4f} mm, "
            f"U = {COVERAGE * bonus.u_mm:.2g} mm"
        )
    if len(good) > 1:
        notes.append(f"from {best.image}, the surest of {len(good)} images")
    notes += dict.fromkeys(note for reading in good for note in reading.notes)
    return Result(
        *(name, target.kind, target.unit, target.nominal, tolerance),
        *(best.value, best.standard_uncertainty, decision, probability),
        *("", tuple(readings), tuple(notes)),
        interval=deviation_interval(best.deviation_mm, covariance),
        bonus_mm=bonus_mm,
        material="" if target.material is None else target.material.condition,
        datums=target.datum_names,
    )


def surest(readings: Sequence[Reading]) -> Reading:
    """Return the reading of a position whose deviation has the least covariance; its size does not count.

    Parameters
    ----------
    readings : sequence of Reading
        Measured ones, at least one.
    """

    def spread(reading: Reading) -> float:
        n = len(reading.deviation_mm)
        return float(np.trace(np.array(reading.covariance_mm2)[:n, :n]))

    return min(readings, key=spread)


def _bonus(material: MaterialCondition | None, reading: Reading) -> Bonus | None:
    """Return what the measured size of a position adds to its zone, with what it has in common with the position."""
    if material is None or not math.isfinite(reading.size_mm):
        return None
    *shared, variance = reading.covariance_mm2[-1]
    sign = 1.0 if material.has_lower_limit else -1.0
    return Bonus(
        material.surplus_mm(reading.size_mm),
        math.sqrt(max(variance, 0.0)),
        tuple(sign * each for each in shared),
    )


def weights_of(
    readings: Sequence[Reading], common: NDArray[np.float64] | None
) -> NDArray[np.float64]:
    """Return the weights of measured readings of one target, see `merged` and `joined_ends`."""
    if len(readings) == 1 or readings[0].entity:
        return np.ones(len(readings))
    return best_weights(_apart(readings, common) + _alike(readings))


def _apart(readings: Sequence[Reading], common: NDArray[np.float64] | None) -> NDArray[np.float64]:
    """Return the covariance (n, n) of measured readings but for what moves those of all images alike."""
    if common is not None:
        return common + np.diag([reading.budget["localisation"] for reading in readings])
    surfaces = np.sqrt([reading.budget["surfaces"] for reading in readings])
    covariance = np.outer(surfaces, surfaces)
    each = [
        reading.standard_uncertainty**2 - math.fsum(reading.budget[source] for source in _ALIKE)
        for reading in readings
    ]
    np.fill_diagonal(covariance, np.maximum(each, _LEAST_VARIANCE))
    return covariance


def _alike(readings: Sequence[Reading]) -> NDArray[np.float64]:
    """Return the covariance (n, n) of readings by what moves those of all images alike."""
    sigmas = [np.sqrt([reading.budget[source] for reading in readings]) for source in _ALIKE]
    return np.sum([np.outer(sigma, sigma) for sigma in sigmas], axis=0)


def _weighted(readings: Sequence[Reading], common: NDArray[np.float64] | None) -> _Combined:
    """Return the weighted mean of readings, its standard uncertainty, and notes."""
    if len(readings) == 1:
        return _Combined(readings[0].value, readings[0].standard_uncertainty)
    apart = _apart(readings, common)
    alike = _alike(readings)
    weights = best_weights(apart + alike)
    values = np.array([reading.value for reading in readings])
    value = float(weights @ values)
    u = math.sqrt(max(float(weights @ (apart + alike) @ weights), 0.0))
    # what readings may have in common, they need not have: they may differ by it
    inverse = np.linalg.inv(apart + np.diag(np.diag(alike)))
    off = values - (inverse @ values).sum() / inverse.sum()
    spread = float(off @ inverse @ off)
    freedoms = len(readings) - 1
    if spread <= chi_squared_quantile(CONSISTENT, freedoms):
        return _Combined(value, u)
    note = f"{len(readings)} readings disagree: u is enlarged by their spread"
    return _Combined(value, u * math.sqrt(spread / freedoms), (note,))
