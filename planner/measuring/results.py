"""What was measured on one part: all results, and their files."""

from __future__ import annotations

import json
import math
import os
import re
import uuid
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from aspectgraph.entities.entity_rules import table_text
from errors.checks import chi_squared_quantile
from errors.many_images import best_weights
from errors.measurands import Decision as Decision
from errors.measurands import DecisionRule as DecisionRule
from errors.measurands import (
    acceptance_limits,
    conformance_probability,
    decide,
    decide_deviation,
    deviation_interval,
)
from errors.measurands.measurand import COVERAGE
from ground.convert import Key, Meta, NullIs, Shape, json_schema, to_plain
from ground.notebook import NotebookTable, NotebookView, ShownInNotebook, Toned
from planner.camera.camera import Camera
from planner.files import write_text
from planner.measuring.images import Picture
from planner.measuring.reading import SOURCES, Reading
from planner.measuring.registered import NumberOrNull, Registered
from planner.measuring.response import ResponseRecord
from planner.request.dimension import plain_tolerance
from planner.request.edge_state import TYPICAL_BREAK_MM, EdgeState
from planner.request.targets import Target
from planner.request.words import tolerance_text

# Results: the readings of one target merged, its expanded uncertainty, and the decision.


CONSISTENT = 0.99
"""Readings of one target that differ more than with this probability are said to disagree."""


_LEAST_VARIANCE = 1e-24
# errors that readings from several images have in common beside poses and surfaces
_ALIKE = ("localisation floor", "response", "edge state")


_Limits = tuple[Annotated[float, NullIs(-math.inf)], Annotated[float, NullIs(math.inf)]]


# How results are shown: values with the digits that their uncertainty leaves, and decisions in
# words.


# colours of decisions in a notebook
_TONES = {
    Decision.CONFORMS: "good",
    Decision.DOES_NOT_CONFORM: "bad",
    Decision.UNDECIDED: "open",
    Decision.NOT_MEASURED: "bad",
}
# of decisions whose words differ for several targets
_SEVERAL = {"conforms": "conform", "does not conform": "do not conform"}


def number_text(value: float, uncertainty: float) -> str:
    """Return a value with as many decimals as its uncertainty has with two digits."""
    return f"{value:.{decimals_of(uncertainty)}f}"


def decimals_of(uncertainty: float) -> int:
    """Return the decimals that an uncertainty has with two digits, at most 6."""
    for decimals in range(6):
        if uncertainty * 10**decimals >= 9.5:
            return decimals
    return 6


def nominal_text(result: Result) -> str:
    """Return the nominal value with its unit and tolerance."""
    tolerance = "" if result.tolerance is None else f" {tolerance_text(result.tolerance)}"
    return f"{result.nominal:.6g} {result.unit}{tolerance}"


def value_texts(result: Result) -> tuple[str, str]:
    """Return a value and its U; nothing of what was not measured."""
    if not result.measured:
        return "", ""
    u = result.expanded_uncertainty
    return number_text(result.value, u), number_text(u, u)


def verdict(results: MeasurementResults) -> str:
    """Say in a sentence or two what was measured."""
    measured = sum(result.measured for result in results)
    parts = [
        f"{n} {name if n == 1 else _SEVERAL.get(name, name)}" for name, n in results.counts.items()
    ]
    n_targets = len(results)
    n_images = len(results.images)
    return (
        f"{measured} of {n_targets} target{'s' * (n_targets != 1)} measured in "
        f"{n_images} image{'s' * (n_images != 1)}. "
        f"Decisions ({results.rule}): {', '.join(parts) or 'none'}."
    )


def _decision_cell(decision: Decision) -> str | Toned:
    tone = _TONES.get(decision)
    return decision.value if tone is None else Toned(decision.value, tone)


@dataclass(frozen=True)
class Result(ShownInNotebook):
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
    accepted : (float, float) or None
        Deviations between which the rule says that a part conforms; None without a value or a tolerance, or if nothing
        is left between the guard bands.
    advice : str
        What to change in the shop if it was not measured; empty if nothing is known.
    deviation : float
        Measured value minus nominal value.
    expanded_uncertainty : float
        U, two standard uncertainties.
    """

    name: str
    kind: str
    unit: Annotated[str, Meta(pattern="^(mm|deg)$")]
    nominal: float
    tolerance: Annotated[
        _Limits | None,
        Meta(description="Lower and upper deviation; null in place of one is no limit."),
    ]
    value: NumberOrNull
    standard_uncertainty: Annotated[NumberOrNull, Key("u")]
    decision: Decision
    conformance_probability: Annotated[NumberOrNull, Key("P_conforms")]
    reason: str
    readings: tuple[Reading, ...]
    notes: tuple[str, ...] = ()
    accepted: Annotated[
        _Limits | None,
        Meta(description="Deviations between which the rule accepts; null: it accepts none."),
    ] = None
    advice: str = ""
    deviation: NumberOrNull = field(init=False)
    expanded_uncertainty: Annotated[NumberOrNull, Key("U")] = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "deviation", self.value - self.nominal)
        object.__setattr__(self, "expanded_uncertainty", COVERAGE * self.standard_uncertainty)

    @property
    def measured(self) -> bool:
        """Whether it has a value."""
        return not self.reason

    @property
    def budget(self) -> dict[str, float]:
        """Variance by source of the reading with the smallest uncertainty; empty if none was measured.

        Of a value whose entities are in different images, that of both.
        """
        measured = [reading for reading in self.readings if reading.measured]
        if not measured:
            return {}
        if measured[0].entity:
            return _budget_of_ends(measured, self.standard_uncertainty)
        return min(measured, key=lambda one: one.standard_uncertainty).budget

    def __repr__(self) -> str:
        """Return a one-line summary."""
        value, u = value_texts(self)
        measured = f"{value} ± {u} {self.unit}, " if self.measured else ""
        return f"<Result {self.name!r}: {measured}{self.decision.value}>"

    def _notebook_view(self) -> NotebookView:
        value, u = value_texts(self)
        rows = [
            ("nominal", nominal_text(self)),
            ("value", f"{value} {self.unit}" if value else self.reason),
            ("U (k = 2)", f"{u} {self.unit}" if u else ""),
            ("decision", _decision_cell(self.decision)),
        ]
        for reading in self.readings:
            share = f"{100 * reading.found_share:.0f} % of its points found"
            rows.append((f"in {reading.image}", reading.reason or share))
        notes = {f"note {n}": note for n, note in enumerate(self.notes, start=1)}
        filled = [row for row in rows if str(row[1])]
        return NotebookView(
            f"{self.name} ({self.kind})", table=NotebookTable(("", ""), filled), items=notes
        )


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
        return Result(*target_fields, *nothing, reason, tuple(readings), advice=advice)
    if good[0].deviation_mm and target.tolerance is not None:
        return _position_result(name, target, readings, rule)
    return _measured(name, target, readings, _weighted(good, common), rule)


def joined_ends(
    name: str,
    target: Target,
    ends: Sequence[Reading],
    rule: DecisionRule,
    common: NDArray[np.float64],
) -> Result:
    """Return the result of a target whose entities are read in different images.

    The deviation is the sum of those by each entity. Localisation and its floor are errors of each entity. Response and
    broken edges may move both alike, so their standard deviations are added up.

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
    variance = float(common.sum()) + math.fsum(_of_points(ends).values())
    where = ", ".join(f"{end.entity} in {end.image}" for end in ends)
    notes = (f"no image shows all of it: {where}",)
    combined = _Combined(value, math.sqrt(variance), notes)
    return _measured(name, target, ends, combined, rule)


def _of_points(ends: Sequence[Reading]) -> dict[str, float]:
    """Return the variance of the sum of readings of different entities by each source but poses and surfaces."""
    variances = {
        source: math.fsum(end.budget[source] for end in ends)
        for source in ("localisation", "localisation floor")
    }
    for source in ("response", "edge state"):
        variances[source] = math.fsum(math.sqrt(end.budget[source]) for end in ends) ** 2
    return variances


def _budget_of_ends(ends: Sequence[Reading], u: float) -> dict[str, float]:
    """Return variance by source of a value whose entities are read in different images.

    What poses and surfaces have in common is divided among them as the readings have it.
    """
    of_points = _of_points(ends)
    parts = {
        source: math.fsum(end.budget[source] for end in ends)
        for source in SOURCES
        if source not in of_points
    }
    total = math.fsum(parts.values())
    rest = max(u**2 - math.fsum(of_points.values()), 0.0)
    share = rest / total if total > 0 else 0.0
    return {
        source: of_points[source] if source in of_points else share * parts[source]
        for source in SOURCES
    }


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
    best = min(good, key=lambda reading: float(np.trace(np.array(reading.covariance_mm2))))
    tolerance = target.tolerance or (0.0, 0.0)
    covariance = np.array(best.covariance_mm2)
    decision, probability = decide_deviation(best.deviation_mm, covariance, tolerance[1], rule)
    e = ", ".join(f"{component:+.4f}" for component in best.deviation_mm)
    notes = [
        f"e = ({e}) mm in the plane of the rim and the axes of the datum frame; a rim does not show the axis"
    ]
    if len(best.deviation_mm) == 2:
        low, high = deviation_interval(best.deviation_mm, covariance)
        notes.append(f"{low:.4f} to {high:.4f} mm with 95 %")
    if len(good) > 1:
        notes.append(f"from {best.image}, the surest of {len(good)} images")
    notes += dict.fromkeys(note for reading in good for note in reading.notes)
    return Result(
        *(name, target.kind, target.unit, target.nominal, tolerance),
        *(best.value, best.standard_uncertainty, decision, probability),
        *("", tuple(readings), tuple(notes)),
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


def edges_text(results: Sequence[Result], states: Mapping[str, EdgeState]) -> str:
    """Say by how much edges are taken to be broken, and what a break would do where none is stated.

    Parameters
    ----------
    results : sequence of Result
        What was measured.
    states : mapping of str to EdgeState
        By target.

    Returns
    -------
    str
        Without a full stop.
    """
    common = list(dict.fromkeys(states.values()))
    if len(common) == 1:
        texts = [str(common[0])]
    else:
        texts = [f"{name}: {state}" for name, state in states.items() if state.stated]
    if not all(state.stated for state in states.values()) and len(common) > 1:
        texts.append(f"others: {EdgeState()}")
    shifts = break_shifts(results, states)
    affected = [result for result in results if result.name in shifts]
    if affected:
        worst = max(affected, key=lambda result: shifts[result.name] / result.expanded_uncertainty)
        texts.append(
            f"a break of {TYPICAL_BREAK_MM:g} mm would move {worst.name} by up to {shifts[worst.name]:.2g} "
            f"{worst.unit}, its U is {worst.expanded_uncertainty:.2g} {worst.unit} (state it with edge_break_mm "
            "or --edges)"
        )
    return "; ".join(texts)


def break_shifts(results: Sequence[Result], states: Mapping[str, EdgeState]) -> dict[str, float]:
    """Return how far a usual break of 0.1 mm would move each value whose edges are not stated, in its unit.

    Parameters
    ----------
    results : sequence of Result
        What was measured.
    states : mapping of str to EdgeState
        By target.
    """
    shifts = {}
    for result in results:
        if not result.measured or result.name not in states or states[result.name].stated:
            continue
        shift = TYPICAL_BREAK_MM * _largest_shift(result)
        if shift > 0:
            shifts[result.name] = shift
    return shifts


def _largest_shift(result: Result) -> float:
    """Return how far a break of 1 mm moves a value at most, in the reading that it moves least."""
    shifts = [reading.edge_shift for reading in result.readings if reading.measured]
    return min((shift for shift in shifts if math.isfinite(shift)), default=0.0)


# Results as QIF 3.0 (ANSI/DMSC, ISO 23952): characteristics, their measurements and statuses, as
# XML.
#
# Characteristics are identified by a UUID of the part's shape and the target's name. So the files
# of many parts of one plan name the same characteristics. Features are not written: an image
# shows edges, and QIF's features are surfaces.


NAMESPACE = "http://qifstandards.org/xsd/qif3"

STATUSES = {
    Decision.CONFORMS: "PASS",
    Decision.DOES_NOT_CONFORM: "FAIL",
    Decision.UNDECIDED: "INDETERMINATE",
    Decision.NOT_MEASURED: "NOT_ANALYZED",
    Decision.NO_TOLERANCE: "UNDEFINED",
}
"""Statuses of characteristics by decision."""
CHARACTERISTICS = {
    "diameter": "Diameter",
    "radius": "Radius",
    "length": "Length",
    "distance": "DistanceBetween",
    "centre_distance": "DistanceBetween",
    "centre_to_edge": "DistanceBetween",
    "angle": "AngleBetween",
}
"""Characteristics of QIF by kind of target."""

# UUIDs of names below this one are the program's own
_OWN = uuid.UUID("6f1c3f0e-6f3b-5a53-9d5b-1e3f0a3b7c11")
_STANDARDS = {
    "iso14253-1": ("14253-1", "2017"),
    # what ISO publishes of JCGM 106, which knows the other rules
    "simple": ("IEC Guide 98-4", "2012"),
    "guard U": ("IEC Guide 98-4", "2012"),
}
_DEGREE = "0.0174532925199433"
# of mm and degrees. With six digits before the point there are 16, as many as every reader of XML must know
_DECIMALS = 10
# XML 1.0 has no way to write these
_FORBIDDEN = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


class _Ids:
    """Numbers of the document's elements, from 1."""

    def __init__(self) -> None:
        self.last = 0

    def next(self) -> str:
        """Return a new one."""
        self.last += 1
        return str(self.last)


def qif_text(results: MeasurementResults) -> str:
    """Return results as a document of QIF 3.0.

    Parameters
    ----------
    results : MeasurementResults
        The results of one part.

    Returns
    -------
    str
        XML. The same results give the same text: its date is theirs, and its UUID is that of what it says.
    """
    ids = _Ids()
    root = ET.Element("QIFDocument", {"xmlns": NAMESPACE, "idMax": "0", "versionQIF": "3.0.0"})
    _add(root, "QPId", _uuid(json.dumps(results.to_dict(), sort_keys=True)))
    _header(root, results)
    standard = ids.next()
    _standards(root, standard, results.rule.name)
    _units(root)
    items = _characteristics(root, results, standard, ids)
    _results(root, results, items, ids)
    root.set("idMax", str(ids.last))
    ET.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def _header(root: ET.Element, results: MeasurementResults) -> None:
    header = _add(root, "Header")
    application = _add(header, "Application")
    _add(application, "Name", f"aspectgraph {results.source.program}")
    part = results.source.part or "part"
    names = [result.name for result in results if result.kind not in CHARACTERISTICS]
    also = ""
    if names:
        also = f"; not in this file: {', '.join(names)}"
    _add(header, "Description", f"{part}; decisions by {results.rule}; u is combined{also}")
    _add(header, "Scope", "Results")


def _standards(root: ET.Element, number: str, rule: str) -> None:
    """Write by which standard it was decided."""
    designator, year = _STANDARDS[rule]
    standard = _add(_list(root, "StandardsDefinitions", 1), "Standard", id=number)
    _add(_add(standard, "Organization"), "StandardsOrganizationEnum", "ISO")
    _add(standard, "Designator", designator)
    _add(standard, "Year", year)


def _units(root: ET.Element) -> None:
    units = _add(_add(root, "FileUnits"), "PrimaryUnits")
    for element, si_name, name, factor in (
        ("AngularUnit", "radian", "degree", _DEGREE),
        ("LinearUnit", "meter", "mm", "0.001"),
    ):
        unit = _add(units, element)
        _add(unit, "SIUnitName", si_name)
        _add(unit, "UnitName", name)
        _add(_add(unit, "UnitConversion"), "Factor", factor)


def _characteristics(
    root: ET.Element, results: MeasurementResults, standard: str, ids: _Ids
) -> list[str]:
    """Write definition, nominal and item of each target; return the ids of the items."""
    lists = _add(root, "Characteristics")
    _add(lists, "FormalStandardId", standard)
    every = _written(results)
    definitions = [ids.next() for _ in every]
    nominals = [ids.next() for _ in every]
    items = [ids.next() for _ in every]
    parent = _list(lists, "CharacteristicDefinitions", len(every))
    for result, number in zip(every, definitions, strict=True):
        _definition(_add(parent, f"{_characteristic(result)}Definition", id=number), result)
    parent = _list(lists, "CharacteristicNominals", len(every))
    for result, number, definition in zip(every, nominals, definitions, strict=True):
        element = _add(parent, f"{_characteristic(result)}Nominal", id=number)
        _add(element, "CharacteristicDefinitionId", definition)
        _add(element, "Name", result.name)
        _add(element, "TargetValue", _decimal(result.nominal))
        if "Between" in element.tag:
            _add(element, "AnalysisMode", "THREEDIMENSIONAL")
    parent = _list(lists, "CharacteristicItems", len(every))
    for result, number, nominal in zip(every, items, nominals, strict=True):
        element = _add(parent, f"{_characteristic(result)}Item", id=number)
        _add(element, "Name", result.name)
        designator = _add(element, "CharacteristicDesignator")
        _add(designator, "Designator", result.name)
        _add(designator, "UUID", _uuid(f"{results.source.part_digest} {result.name}"))
        _add(element, "CharacteristicNominalId", nominal)
    return items


def _written(results: MeasurementResults) -> list[Result]:
    """Return the results that the file can hold: a position would need its datums as features."""
    return [result for result in results if result.kind in CHARACTERISTICS]


def _definition(element: ET.Element, one: Result) -> None:
    if one.tolerance is None:
        _add(element, "NonTolerance", "MEASURED")
        return
    lower, upper = one.tolerance
    tolerance = _add(element, "Tolerance")
    for name, limit in (("MaxValue", upper), ("MinValue", lower)):
        if math.isfinite(limit):
            _add(tolerance, name, _decimal(limit))
    _add(tolerance, "DefinedAsLimit", "false")


def _results(
    root: ET.Element, results: MeasurementResults, items: Sequence[str], ids: _Ids
) -> None:
    """Write the measurements of all characteristics, and the status of the part."""
    parent = _add(root, "Results")
    sets = _list(parent, "MeasurementResultsSet", 1)
    measured = _add(sets, "MeasurementResults", id=ids.next())
    part = ids.next()
    _traceability(measured, results.source)
    images = results.source.images
    if images:
        files = _list(measured, "ExternalFileReferences", len(images))
        for name, digest in images.items():
            file = _add(files, "ExternalFileReference")
            _add(file, "URI", name)
            _add(_add(file, "FileSpec"), "OtherFileSpec", "image")
            _add(file, "Description", f"SHA-256 {digest}")
    lists = _add(measured, "MeasuredCharacteristics")
    parent_list = _list(lists, "CharacteristicMeasurements", len(items))
    for result, item in zip(_written(results), items, strict=True):
        element = _add(parent_list, f"{_characteristic(result)}Measurement", id=ids.next())
        _measurement(element, result, item, part)
    status = _part_status(results)
    _add(_add(measured, "InspectionStatus"), "InspectionStatusEnum", status)
    _add(_list(measured, "ActualComponentIds", 1), "Id", part)
    components = _list(_list(parent, "ActualComponentSets", 1), "ActualComponentSet", 1)
    component = _add(components, "ActualComponent", id=part)
    if results.serial:
        _add(component, "SerialNumber", results.serial)
    _add(_add(component, "Status"), "InspectionStatusEnum", status)


def _traceability(measured: ET.Element, source: Source) -> None:
    """Write when and by whom it was measured, as far as it is known."""
    if not source.date and not source.operator:
        return
    traceability = _add(measured, "InspectionTraceability")
    if source.date:
        _add(traceability, "InspectionEnd", source.date)
    if source.operator:
        _add(_add(traceability, "InspectionOperator"), "Name", source.operator)


def _measurement(element: ET.Element, one: Result, item: str, part: str) -> None:
    notes = [text for text in (one.reason, one.advice) if text] if one.reason else list(one.notes)
    if notes:
        attributes = _list(element, "Attributes", 1)
        name = "reason" if one.reason else "note"
        _add(attributes, "AttributeStr", name=name, value=_plain("; ".join(notes)))
    _add(_add(element, "Status"), "CharacteristicStatusEnum", STATUSES[one.decision])
    _add(element, "CharacteristicItemId", item)
    _add(element, "ActualComponentId", part)
    if one.measured:
        # the schema has either both or none
        accuracy = {"combinedUncertainty": _decimal(one.standard_uncertainty), "meanError": "0"}
        _add(element, "Value", _decimal(one.value), **accuracy)


def _part_status(results: MeasurementResults) -> str:
    """Return PASS if all conforms, FAIL if something certainly does not, otherwise UNDEFINED."""
    if any(result.decision is Decision.DOES_NOT_CONFORM for result in results):
        return "FAIL"
    decided = any(result.decision is Decision.CONFORMS for result in results)
    return "PASS" if results.conforms and decided else "UNDEFINED"


def _characteristic(one: Result) -> str:
    return f"{CHARACTERISTICS[one.kind]}Characteristic"


def _add(parent: ET.Element, tag: str, text: str = "", **attributes: str) -> ET.Element:
    element = ET.SubElement(parent, tag, attributes)
    if text:
        element.text = _plain(text)
    return element


def _list(parent: ET.Element, tag: str, count: int) -> ET.Element:
    """Add a list, which states its length."""
    return _add(parent, tag, n=str(count))


def _plain(text: str) -> str:
    """Return text with what XML cannot hold replaced."""
    return _FORBIDDEN.sub("\ufffd", text)


def _decimal(value: float) -> str:
    """Return a number without an exponent, which a decimal of XML does not have, and with few digits."""
    whole, _, decimals = f"{value:.{_DECIMALS}f}".partition(".")
    return f"{whole}.{decimals.rstrip('0') or '0'}"


def _uuid(name: str) -> str:
    return str(uuid.uuid5(_OWN, _plain(name)))


FORMAT: Final = "aspectgraph-results"

COLUMNS = (
    *("name", "kind", "unit", "nominal", "lower", "upper", "value", "deviation", "u", "U", "k"),
    *(
        "decision",
        "P_conforms",
        "accepted_from",
        "accepted_to",
        "images",
        "found",
        "rms_px",
        "overexposed",
    ),
    *(f"u_{source.replace(' ', '_')}" for source in SOURCES),
    *("reason", "advice"),
)
"""Columns of the table."""

_WITH_UNIT = frozenset(
    ("nominal", "lower", "upper", "value", "deviation", "u", "U", "accepted_from", "accepted_to")
)
# shares and pixels
_NOMINAL_DECIMALS = 5
_DECIMALS_OF = {"P_conforms": 6, "found": 3, "rms_px": 4, "overexposed": 4}


@dataclass(frozen=True, eq=False)
class MeasurementResults(ShownInNotebook):
    """The results of one part.

    Attributes
    ----------
    results : dict of str to Result
        By target, in the plan's order.
    images : dict of str to Registered
        Pose and surfaces of each image that was registered.
    failed : dict of str to str
        Images that could not be registered, and why.
    rule : DecisionRule
        How it was decided.
    serial : str
        Name of the part that was measured.
    correlation : array (n, n)
        Correlation of the values that were measured, by the poses and surfaces they have in common.
    source : Source
        Names and SHA-256 of part and images.
    notes : tuple of str
        What the user should know.
    pictures : dict of str to Picture
        The images.
    responses : dict of str to ResponseRecord
        How much light their grey values stand for, and what says so.
    edges : str
        By how much edges are taken to be broken.
    break_shifts : dict of str to float
        How far a break of 0.1 mm would move each value whose edges are not stated, in its unit.
    """

    results: Mapping[str, Result]
    images: Mapping[str, Registered]
    failed: Mapping[str, str]
    rule: DecisionRule
    serial: str
    correlation: NDArray[np.float64]
    source: Source
    notes: tuple[str, ...] = ()
    pictures: Mapping[str, Picture] = field(default_factory=dict)
    responses: Mapping[str, ResponseRecord] = field(default_factory=dict)
    edges: str = ""
    break_shifts: Mapping[str, float] = field(default_factory=dict)

    def __iter__(self) -> Iterator[Result]:
        """Go through the results in the plan's order."""
        return iter(self.results.values())

    def __len__(self) -> int:
        """Return their number."""
        return len(self.results)

    def __getitem__(self, name: str) -> Result:
        """Return the result of a target."""
        return self.results[name]

    def __repr__(self) -> str:
        """Return a one-line summary."""
        counts = ", ".join(f"{n} {name}" for name, n in self.counts.items())
        part = self.serial or self.source.part or "a part"
        return f"<MeasurementResults of {part!r}: {counts or 'nothing'}>"

    def _notebook_view(self) -> NotebookView:
        headings = ("target", "nominal", "value", f"U (k = {COVERAGE:g})", "decision")
        rows = [
            (
                result.name,
                nominal_text(result),
                *value_texts(result),
                _decision_cell(result.decision),
            )
            for result in self
        ]
        remarks = {
            result.name: "; ".join(filter(None, (result.reason, *result.notes))) for result in self
        }
        items = {name: text for name, text in (*remarks.items(), *self.failed.items()) if text}
        return NotebookView(
            f"Measured: {self.serial or self.source.part or 'a part'}",
            (verdict(self), *self.notes),
            NotebookTable(headings, rows, right=(1, 2, 3)),
            items,
        )

    @property
    def readings(self) -> dict[str, tuple[Reading, ...]]:
        """The readings of each target."""
        return {name: result.readings for name, result in self.results.items()}

    @property
    def counts(self) -> dict[str, int]:
        """Number of targets by decision."""
        decisions = [result.decision for result in self]
        return {str(d.value): decisions.count(d) for d in Decision if d in decisions}

    @property
    def measured(self) -> bool:
        """Whether every target has a value."""
        return all(result.measured for result in self)

    @property
    def conforms(self) -> bool:
        """Whether every target was measured, and those with a tolerance conform."""
        fine = (Decision.CONFORMS, Decision.NO_TOLERANCE)
        return all(result.decision in fine for result in self)

    def to_dict(self) -> dict[str, Any]:
        """Return everything but points and pictures as plain values, ready for JSON.

        Returns
        -------
        dict
            What `write` writes.
        """
        file = ResultsFile(
            format=FORMAT,
            version=1,
            serial=self.serial,
            rule=Rule(self.rule.name, self.rule.level, COVERAGE),
            source=self.source,
            notes=self.notes,
            edges=self.edges,
            results=tuple(self),
            measured=tuple(result.name for result in self if result.measured),
            correlation=self.correlation,
            images=self.images,
            failed=self.failed,
            white={
                name: WhiteRecord(picture.white, picture.white_from)
                for name, picture in self.pictures.items()
            },
            response=self.responses,
        )
        return to_plain(file, defaults=True)

    def write(self, path: str | os.PathLike[str]) -> Path:
        """Write the results as JSON, see `results_schema`.

        Parameters
        ----------
        path : str or os.PathLike
            The file. An existing one is replaced.

        Returns
        -------
        pathlib.Path
            The file.

        Raises
        ------
        OutputError
            If it cannot be written.
        """
        text = json.dumps(self.to_dict(), indent=1, allow_nan=False, ensure_ascii=False)
        write_text(path, text + "\n")
        return Path(path)

    def qif(self, path: str | os.PathLike[str]) -> Path:
        """Write the results as QIF 3.0, for software of coordinate measuring machines and statistics.

        Parameters
        ----------
        path : str or os.PathLike
            The file. An existing one is replaced.

        Returns
        -------
        pathlib.Path
            The file.

        Raises
        ------
        OutputError
            If it cannot be written.
        """
        write_text(path, qif_text(self))
        return Path(path)

    def rows(self) -> list[dict[str, Any]]:
        """Return the table.

        Returns
        -------
        list of dict
            For each target its values by column; None where there is no number.
        """
        return [_row(result) for result in self]

    def to_csv(self) -> str:
        """Return the table as CSV.

        Returns
        -------
        str
            With a heading that states units; lines end with CR LF. Values have the digits of their U, as
            in the report, and parts of u one more. What is accepted is rounded inwards. Text that a
            spreadsheet would run begins with an apostrophe.
        """
        units = " or ".join(sorted({result.unit for result in self}))
        heading = [
            f"{name} ({units})" if name in _WITH_UNIT or name.startswith("u_") else name
            for name in COLUMNS
        ]
        rows = [list(_rounded_row(row).values()) for row in self.rows()]
        return table_text(heading, rows)

    def write_csv(self, path: str | os.PathLike[str]) -> Path:
        """Write the table as CSV.

        Parameters
        ----------
        path : str or os.PathLike
            The file. An existing one is replaced.

        Returns
        -------
        pathlib.Path
            The file.

        Raises
        ------
        OutputError
            If it cannot be written.
        """
        write_text(path, self.to_csv())
        return Path(path)


@dataclass(frozen=True)
class Rule:
    """How it was decided: the name, the probability of a right decision, and U as a multiple of u."""

    name: Annotated[str, Meta(pattern="^(iso14253-1|simple|guard U)$")]
    level: float
    k: float


@dataclass(frozen=True)
class Source:
    """What was measured, when, by whom and with what.

    Attributes
    ----------
    program : str
        The program's version.
    part, part_digest : str
        The part with its SHA-256.
    images : mapping of str to str
        The SHA-256 of each image.
    date : str
        When, in the form of ISO 8601 (UTC).
    operator : str
        Who measured; empty if not stated.
    plan_digest : str
        SHA-256 of the plan as its file has it.
    camera : Camera or None
        The calibration by which pixels became directions.
    """

    program: str
    part: str
    part_digest: str
    images: Mapping[str, str]
    date: str = ""
    operator: str = ""
    plan_digest: str = ""
    camera: Camera | None = None


@dataclass(frozen=True)
class WhiteRecord:
    """Grey value of full exposure of an image, and what says so.

    The camera does, a plateau of the image's brightest pixels, or the depth that its values need.
    """

    level: Annotated[float, Meta(gt=0)]
    origin: Annotated[str, Key("from"), Meta(pattern="^(camera|plateau|depth)$")]


@dataclass(frozen=True, eq=False)
class ResultsFile:
    """What results.json holds."""

    format: Literal["aspectgraph-results"]
    version: Literal[1]
    serial: str
    rule: Rule
    source: Source
    notes: tuple[str, ...]
    edges: str
    results: tuple[Result, ...]
    measured: tuple[str, ...]
    correlation: Annotated[NDArray[np.float64], Shape(None, None)]
    images: Mapping[str, Registered]
    failed: Annotated[Mapping[str, str], Key("not_registered")]
    white: Mapping[str, WhiteRecord]
    response: Mapping[str, ResponseRecord]


def results_schema() -> dict[str, Any]:
    """Return the JSON Schema of results.json."""
    title = (
        "Results of measuring one part in images of a plan; "
        "lengths in mm, angles in degrees, null where there is no number"
    )
    return json_schema(ResultsFile, defaults=True, title=title)


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _rounded_row(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return a row of the table with the digits that its values are known to."""
    decimals = decimals_of(row["U"]) if row["U"] else 6
    rounded = dict(row)
    for name, value in row.items():
        if not isinstance(value, float):
            continue
        if name in ("value", "deviation", "u", "U"):
            rounded[name] = round(value, decimals + (name == "u"))
        elif name == "nominal":
            # a double's last digits are no drawing's
            rounded[name] = round(value, max(decimals + 2, _NOMINAL_DECIMALS))
        elif name.startswith("u_"):
            rounded[name] = round(value, decimals + 1)
        elif name in _DECIMALS_OF:
            rounded[name] = round(value, _DECIMALS_OF[name])
    if row["P_conforms"] is not None:
        # near 1 it is a bound
        rounded["P_conforms"] = min(rounded["P_conforms"], 0.999999)
    if row["accepted_from"] is not None:
        rounded["accepted_from"] = rounded_up(row["accepted_from"], decimals)
    if row["accepted_to"] is not None:
        rounded["accepted_to"] = -rounded_up(-row["accepted_to"], decimals)
    return rounded


def rounded_up(value: float, decimals: int) -> float:
    """Return the smallest decimal number with so many decimals that is not below a value.

    Parameters
    ----------
    value : float
        The value.
    decimals : int
        Digits behind the point.
    """
    # noise of a double is no reason for another step
    return math.ceil(value * 10**decimals - 1e-9) / 10**decimals


def _row(one: Result) -> dict[str, Any]:
    lower, upper = plain_tolerance(one.tolerance) or (None, None)
    readings = [reading for reading in one.readings if reading.measured] or list(one.readings)
    counts: dict[str, int] = {}
    for reading in readings:
        for name, n in reading.counts.items():
            counts[name] = counts.get(name, 0) + n
    total = sum(counts.values())
    budget = one.budget
    values = (
        *(one.name, one.kind, one.unit, one.nominal, lower, upper),
        *map(_number, (one.value, one.deviation, one.standard_uncertainty)),
        *(_number(one.expanded_uncertainty), COVERAGE, one.decision.value),
        _number(one.conformance_probability),
        *(plain_tolerance(one.accepted) or (None, None)),
        " ".join(reading.image for reading in readings),
        _number(max((reading.found_share for reading in readings), default=math.nan)),
        _number(min((reading.rms_px for reading in readings), default=math.nan)),
        counts.get("overexposed", 0) / total if total else None,
        *(math.sqrt(budget[source]) if budget else None for source in SOURCES),
        *(one.reason, one.advice),
    )
    return dict(zip(COLUMNS, values, strict=True))
