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
from typing import Annotated, Any, Final, Literal
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray

from aspectgraph.entities.entity_rules import table_text
from errors.measurands import Decision as Decision
from errors.measurands import DecisionRule as DecisionRule
from errors.measurands.measurand import COVERAGE
from ground.convert import Key, Meta, NullIs, Shape, json_schema, to_plain
from ground.notebook import NotebookTable, NotebookView, ShownInNotebook, Toned
from planner.argument_kinds import check_path
from planner.camera.camera import Camera
from planner.files import write_text
from planner.measuring.images import Picture
from planner.measuring.reading import SOURCES, Reading
from planner.measuring.registered import NumberOrNull, Registered
from planner.measuring.response import ResponseRecord
from planner.request.dimension import POSITIONS, plain_tolerance, zone_text
from planner.request.words import amount_text, tolerance_text
from planner.text_table import count, data_frame

# Results: the readings of one target merged, its expanded uncertainty, and the decision.


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
    return f"{value:z.{decimals_of(uncertainty)}f}"


def decimals_of(uncertainty: float) -> int:
    """Return the decimals that an uncertainty has with two digits, at most 6."""
    for decimals in range(6):
        if uncertainty * 10**decimals >= 9.5:
            return decimals
    return 6


def nominal_text(result: Result) -> str:
    """Return the nominal value with its unit and tolerance; of a position its zone, with the bonus."""
    if result.kind in POSITIONS and result.tolerance is not None:
        bonus = f" + {result.bonus_mm:.3g} bonus" if math.isfinite(result.bonus_mm) else ""
        condition = f" ({result.material})" if result.material else ""
        zone = f"{zone_text(result.kind, result.tolerance[1])}{bonus} {result.unit}{condition}"
        return " | ".join((zone, *result.datums))
    tolerance = "" if result.tolerance is None else f" {tolerance_text(result.tolerance)}"
    return f"{amount_text(f'{result.nominal:.6g}', result.unit)}{tolerance}"


def value_texts(result: Result) -> tuple[str, str]:
    """Return a value and its U; of a position the interval instead, and nothing of what was not measured."""
    if not result.measured:
        return "", ""
    u = result.expanded_uncertainty
    if result.interval is not None:
        return number_text(result.value, u), interval_text(result.interval, u)
    return number_text(result.value, u), number_text(u, u)


def interval_text(interval: tuple[float, float], uncertainty: float) -> str:
    """Return an interval of a value with 95 %, with the digits of its uncertainty."""
    low, high = (number_text(end, uncertainty) for end in interval)
    return f"{low} .. {high}"


NOT_PLANNED = "not planned: "
"""How the reason begins of a target that the plan does not inspect."""

NOT_INSPECTED = "the plan does not inspect it: "
"""How a note begins of such a target that images show nevertheless."""


def verdict(results: MeasurementResults) -> str:
    """Say in a sentence or two how many of the planned targets were measured, and what was decided."""
    planned = [result.measured for result in results if result.is_planned]
    others = [result.measured for result in results if not result.is_planned]
    parts = [
        f"{n} {name if n == 1 else _SEVERAL.get(name, name)}" for name, n in results.counts.items()
    ]
    more = ""
    if others:
        values = f", {sum(others)} of them measured" if any(others) else ""
        more = f"; {len(others)} more {'is' if len(others) == 1 else 'are'} not planned{values}"
    return (
        f"{sum(planned)} of {count(len(planned), 'planned target')} measured in "
        f"{count(len(results.images), 'image')}{more}. "
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
    interval : (float, float) or None
        Of a position, the interval that its value lies in with 95 %: near 0, U does not describe it.
    bonus_mm : float
        By how much the measured size widens the zone of a position; nan without a material condition.
    material : str
        Its material condition, "M" or "L"; otherwise empty.
    datums : tuple of str
        Of a position, its datums in their order. The drawing names them, otherwise their entities do.
    foreseen_uncertainty : float
        U as the plan foresaw it, in the surest setting that has an image; nan if it did not.
    is_planned : bool
        Whether the plan inspects the target. Images may show another one nevertheless.
    deviation : float
        Measured value minus nominal value.
    expanded_uncertainty : float
        U, two standard uncertainties.

    Examples
    --------
    >>> import numpy as np
    >>> from aspectgraph import read_solid
    >>> from planner import measure, read_plan
    >>> plan = read_plan("examples/two_pocket_block_plan.json")
    >>> dark = {1: np.zeros(plan.camera.resolution[::-1], np.uint8)}
    >>> results = measure(plan, read_solid("examples/two_pocket_block.off"), dark)
    >>> results["e1"]
    <Result 'e1': not measured>
    >>> results["e1"].reason[:44]
    'setting_01: the image cannot be registered: '
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
    interval: tuple[float, float] | None = None
    bonus_mm: NumberOrNull = math.nan
    material: str = ""
    datums: tuple[str, ...] = ()
    foreseen_uncertainty: Annotated[NumberOrNull, Key("U_foreseen")] = math.nan
    is_planned: Annotated[bool, Key("planned")] = True
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
        if self.interval is not None:
            measured = f"{value} ({u}) {self.unit}, "
        return f"<Result {self.name!r}: {measured}{self.decision.value}>"

    def _notebook_view(self) -> NotebookView:
        value, u = value_texts(self)
        rows = [
            ("nominal", nominal_text(self)),
            ("value", f"{value} {self.unit}" if value else self.reason),
            ("U (k = 2)" if self.interval is None else "95 %", f"{u} {self.unit}" if u else ""),
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


def variances_of_points(ends: Sequence[Reading]) -> dict[str, float]:
    """Return the variance of the sum of readings of different entities by each source but poses and surfaces."""
    variances = {
        source: math.fsum(end.budget[source] for end in ends)
        for source in ("localisation", "localisation floor")
    }
    variances["response"] = math.fsum(math.sqrt(end.budget["response"]) for end in ends) ** 2
    # entities are broken independently, about a mean that all have
    apart = math.fsum(max(end.budget["edge state"] - end.break_mean**2, 0.0) for end in ends)
    variances["edge state"] = apart + math.fsum(end.break_mean for end in ends) ** 2
    return variances


def _budget_of_ends(ends: Sequence[Reading], u: float) -> dict[str, float]:
    """Return variance by source of a value whose entities are read in different images.

    What poses and surfaces have in common is divided among them as the readings have it.
    """
    of_points = variances_of_points(ends)
    parts = {
        source: math.fsum(end.budget[source] for end in ends)
        for source in SOURCES
        if source not in of_points
    }
    total = math.fsum(parts.values())
    remainder = max(u**2 - math.fsum(of_points.values()), 0.0)
    share = remainder / total if total > 0 else 0.0
    return {
        source: of_points[source] if source in of_points else share * parts[source]
        for source in SOURCES
    }


@dataclass(frozen=True)
class UnseenBreaks:
    """What breaks that nobody states and images do not show would do to uncertainties.

    Attributes
    ----------
    limit_mm : float
        Images would show larger breaks, mm.
    uncertainties : dict of str to float
        U of values, if their edges are broken by anything from 0 to this limit.
    open_decisions : tuple of str
        Targets that are then undecided.
    """

    limit_mm: float
    uncertainties: Annotated[Mapping[str, float], Key("U")]
    open_decisions: tuple[str, ...] = ()


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

POSITION_CHARACTERISTICS = {"position": "Position", "width_position": "Position"}
"""The same of kinds that have a zone and a datum reference frame."""
_ZONES = {"position": "DiametricalZone", "width_position": "NonDiametricalZone"}
_MODIFIERS = {"": "REGARDLESS", "M": "MAXIMUM", "L": "LEAST"}
_PRECEDENCES = ("PRIMARY", "SECONDARY", "TERTIARY", "QUATERNARY", "QUINARY")

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
    if results.source.date:
        _add(_add(root, "Version"), "TimeCreated", results.source.date)
    _header(root, results)
    standard = ids.next()
    _standards(root, standard, results.rule.name)
    _units(root)
    frames = _frames(root, results, ids)
    items = _characteristics(root, results, standard, ids, frames)
    _results(root, results, items, ids)
    root.set("idMax", str(ids.last))
    ET.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def _header(root: ET.Element, results: MeasurementResults) -> None:
    header = _add(root, "Header")
    application = _add(header, "Application")
    _add(application, "Name", results.source.program)
    part = results.source.part or "part"
    written = {result.name for result in _written(results)}
    names = [result.name for result in results if result.name not in written]
    also = ""
    if names:
        also = f"; not in this file: {', '.join(names)}"
    by = ""
    if results.source.camera is not None:
        by = f"; camera {results.source.camera.name or 'without a name'}"
    _add(header, "Description", f"{part}; decisions by {results.rule}; u is combined{by}{also}")
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


def _frames(root: ET.Element, results: MeasurementResults, ids: _Ids) -> dict[tuple[str, ...], str]:
    """Write the datums and their reference frames; return the ids of the frames by their datums."""
    frames = dict.fromkeys(result.datums for result in _written(results) if result.datums)
    if not frames:
        return {}
    labels = dict.fromkeys(label for datums in frames for label in datums)
    parent = _list(root, "DatumDefinitions", len(labels))
    definitions = {}
    for label in labels:
        definitions[label] = ids.next()
        datum = _add(parent, "DatumDefinition", id=definitions[label])
        _add(datum, "DatumLabel", re.sub(r"[^\w.-]", "_", label, flags=re.ASCII))
    parent = _list(root, "DatumReferenceFrames", len(frames))
    numbers = {}
    for datums in frames:
        numbers[datums] = ids.next()
        frame = _add(parent, "DatumReferenceFrame", id=numbers[datums])
        listed = _list(frame, "Datums", len(datums))
        for label, precedence in zip(datums, _PRECEDENCES, strict=False):
            datum = _add(listed, "Datum")
            simple = _add(datum, "SimpleDatum")
            _add(simple, "DatumDefinitionId", definitions[label])
            _add(simple, "MaterialModifier", _MODIFIERS[""])
            _add(simple, "ReferencedComponent", "ACTUAL")
            _add(_add(datum, "Precedence"), "PrecedenceEnum", precedence)
    return numbers


def _characteristics(
    root: ET.Element,
    results: MeasurementResults,
    standard: str,
    ids: _Ids,
    frames: Mapping[tuple[str, ...], str],
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
        element = _add(parent, f"{_characteristic(result)}Definition", id=number)
        if result.kind in POSITION_CHARACTERISTICS:
            _position_definition(element, result, frames)
        else:
            _definition(element, result)
    parent = _list(lists, "CharacteristicNominals", len(every))
    for result, number, definition in zip(every, nominals, definitions, strict=True):
        element = _add(parent, f"{_characteristic(result)}Nominal", id=number)
        _add(element, "CharacteristicDefinitionId", definition)
        _add(element, "Name", result.name)
        if result.kind not in POSITION_CHARACTERISTICS:
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
    """Return the results that the file holds: values, and positions with their zones."""
    return [
        result
        for result in results
        if result.kind in CHARACTERISTICS
        or (
            result.kind in POSITION_CHARACTERISTICS
            and result.tolerance is not None
            and len(result.datums) <= len(_PRECEDENCES)
        )
    ]


def _position_definition(
    element: ET.Element, result: Result, frames: Mapping[tuple[str, ...], str]
) -> None:
    """Write the zone of a position, its datum reference frame and its material condition."""
    assert result.tolerance is not None, "a position has a zone"
    _add(element, "ToleranceValue", _decimal(result.tolerance[1]))
    if result.datums:
        _add(element, "DatumReferenceFrameId", frames[result.datums])
    _add(element, "MaterialCondition", _MODIFIERS[result.material])
    _add(_add(element, "ZoneShape"), _ZONES[result.kind])


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
    named = results.source.image_files
    references = [
        # a URI has no blanks
        (quote(named.get(name, name), safe=""), "image", digest)
        for name, digest in results.source.images.items()
    ]
    if results.source.plan_digest:
        references.insert(0, ("plan.json", "inspection plan", results.source.plan_digest))
    if references:
        files = _list(measured, "ExternalFileReferences", len(references))
        for name, kind, digest in references:
            file = _add(files, "ExternalFileReference")
            _add(file, "URI", name)
            _add(_add(file, "FileSpec"), "OtherFileSpec", kind)
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
    return f"{(CHARACTERISTICS | POSITION_CHARACTERISTICS)[one.kind]}Characteristic"


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
    "serial",
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
    *("reason", "advice", "interval_from", "interval_to", "bonus", "U_foreseen"),
    *("date", "operator"),
)
"""Columns of the table. `unit` states the unit of all values that are not in pixels or shares."""

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
    unseen : UnseenBreaks or None
        What breaks that nobody states and images do not show would do; None if edges are stated.

    Examples
    --------
    >>> from aspectgraph import read_solid
    >>> from planner import measure, read_plan
    >>> plan = read_plan("examples/measured/plan.json")
    >>> solid = read_solid("examples/nist_ctc_01_ap242.stp")
    >>> results = measure(plan, solid, "examples/measured/images")
    >>> results.measured, results.counts
    (True, {'conforms': 4})
    >>> results["bore_25"]
    <Result 'bore_25': 24.822 ± 0.055 mm, conforms>
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
    unseen: UnseenBreaks | None = None

    def __iter__(self) -> Iterator[Result]:
        """Go through the results in the plan's order."""
        return iter(self.results.values())

    def __len__(self) -> int:
        """Return their number."""
        return len(self.results)

    def __getitem__(self, name: str) -> Result:
        """Return the result of a target, or raise a `KeyError` that lists the targets."""
        if name not in self.results:
            targets = ", ".join(self.results)
            raise KeyError(f"results must be asked for a target: {targets}. Got {name!r}.")
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
            unseen_breaks=self.unseen,
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
            For each target its values by column; None where there is no number. `serial`, `date` and
            `operator` are those of results.json.
        """
        return [_row(result, self) for result in self]

    def to_dataframe(self) -> Any:
        """Return `rows` as a data frame of pandas.

        Returns
        -------
        pandas.DataFrame
            One row per target.

        Raises
        ------
        ImportError
            If pandas is not installed.
        """
        return data_frame(self.rows())

    def to_csv(self) -> str:
        """Return the table as CSV.

        Returns
        -------
        str
            With a heading that states units; lines end with CR LF. Values have the digits of their U, as
            in the report, and parts of u one more. What is accepted is rounded inwards. Text that a
            spreadsheet would run begins with an apostrophe.
        """
        return table_of_parts([self])

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
        check_path("path", path)
        write_text(path, self.to_csv())
        return Path(path)


def table_of_parts(
    parts: Sequence[MeasurementResults], not_measured: Mapping[str, str] | None = None
) -> str:
    """Return the tables of several parts as one, as `MeasurementResults.to_csv` returns it.

    Parameters
    ----------
    parts : sequence of MeasurementResults
        The parts.
    not_measured : mapping of str to str, optional
        Serials of parts without results, and why; each has a row.

    Returns
    -------
    str
        Rows in the order of the serials; those of one part in the plan's order.
    """
    rows = [_rounded_row(row) for part in parts for row in part.rows()]
    empty = dict.fromkeys(COLUMNS)
    why = {"decision": Decision.NOT_MEASURED.value}
    rows += [
        {**empty, **why, "serial": serial, "reason": reason}
        for serial, reason in (not_measured or {}).items()
    ]
    rows.sort(key=lambda row: row["serial"])
    return table_text(COLUMNS, [list(row.values()) for row in rows])


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
        Name and version of the program.
    part, part_digest : str
        The part, and the SHA-256 of its vertices and triangles.
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
    part_file_sha256 : str
        SHA-256 of the part's file; empty if it is not known.
    image_files : mapping of str to str
        The name of the file of each image; an array has none.
    """

    program: str
    part: str
    part_digest: str
    images: Mapping[str, str]
    date: str = ""
    operator: str = ""
    plan_digest: str = ""
    camera: Camera | None = None
    part_file_sha256: str = ""
    image_files: Mapping[str, str] = field(default_factory=dict)


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
    unseen_breaks: UnseenBreaks | None
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
        if name in ("value", "deviation", "u", "U", "interval_from", "interval_to", "bonus"):
            # no -0.0
            rounded[name] = round(value, decimals + (name == "u")) + 0.0
        elif name == "U_foreseen":
            rounded[name] = round(value, decimals_of(value))
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


def _row(one: Result, part: MeasurementResults) -> dict[str, Any]:
    lower, upper = plain_tolerance(one.tolerance) or (None, None)
    readings = [reading for reading in one.readings if reading.measured] or list(one.readings)
    counts: dict[str, int] = {}
    for reading in readings:
        for name, n in reading.counts.items():
            counts[name] = counts.get(name, 0) + n
    total = sum(counts.values())
    budget = one.budget
    values = (
        part.serial,
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
        *(one.interval or (None, None)),
        *map(_number, (one.bonus_mm, one.foreseen_uncertainty)),
        *(part.source.date, part.source.operator),
    )
    return dict(zip(COLUMNS, values, strict=True))
