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
from importlib import resources
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from aspectgraph.entities.entity_files import csv_text
from errors.measurands import Decision as Decision
from errors.measurands import DecisionRule as DecisionRule
from errors.measurands.measurand import COVERAGE
from planner.files import write_text
from planner.measuring.images import Picture
from planner.measuring.reading import SOURCES, Reading, Result
from planner.measuring.registered import Registered
from planner.request.dimension import plain_tolerance

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


class Measured(Protocol):
    """What is written of a measured part, see `planner.measuring.results.MeasurementResults`."""

    @property
    def rule(self) -> DecisionRule:
        """How it was decided."""

    @property
    def serial(self) -> str:
        """Name of the part."""

    @property
    def source(self) -> Mapping[str, Any]:
        """What it was measured from."""

    @property
    def conforms(self) -> bool:
        """Whether everything conforms."""

    def __iter__(self) -> Iterator[Result]:
        """Go through the results."""

    def to_dict(self) -> dict[str, Any]:
        """Return everything as plain values."""


class _Ids:
    """Numbers of the document's elements, from 1."""

    def __init__(self) -> None:
        self.last = 0

    def next(self) -> str:
        """Return a new one."""
        self.last += 1
        return str(self.last)


def qif_text(results: Measured) -> str:
    """Return results as a document of QIF 3.0.

    Parameters
    ----------
    results : MeasurementResults
        The results of one part.

    Returns
    -------
    str
        XML. The same results give the same text: it has no date, and its UUID is that of what it was measured from.
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


def _header(root: ET.Element, results: Measured) -> None:
    header = _add(root, "Header")
    application = _add(header, "Application")
    _add(application, "Name", f"aspectgraph {results.source.get('program', 'unknown')}")
    part = results.source.get("part")
    _add(header, "Description", f"{part or 'part'}; decisions by {results.rule}; u is combined")
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


def _characteristics(root: ET.Element, results: Measured, standard: str, ids: _Ids) -> list[str]:
    """Write definition, nominal and item of each target; return the ids of the items."""
    lists = _add(root, "Characteristics")
    _add(lists, "FormalStandardId", standard)
    every = list(results)
    definitions = [ids.next() for _ in every]
    nominals = [ids.next() for _ in every]
    items = [ids.next() for _ in every]
    parent = _list(lists, "CharacteristicDefinitions", len(every))
    for one, number in zip(every, definitions, strict=True):
        _definition(_add(parent, f"{_characteristic(one)}Definition", id=number), one)
    parent = _list(lists, "CharacteristicNominals", len(every))
    for one, number, definition in zip(every, nominals, definitions, strict=True):
        element = _add(parent, f"{_characteristic(one)}Nominal", id=number)
        _add(element, "CharacteristicDefinitionId", definition)
        _add(element, "Name", one.name)
        _add(element, "TargetValue", _decimal(one.nominal))
        if "Between" in element.tag:
            _add(element, "AnalysisMode", "THREEDIMENSIONAL")
    parent = _list(lists, "CharacteristicItems", len(every))
    digest = str(results.source.get("part_digest", ""))
    for one, number, nominal in zip(every, items, nominals, strict=True):
        element = _add(parent, f"{_characteristic(one)}Item", id=number)
        _add(element, "Name", one.name)
        designator = _add(element, "CharacteristicDesignator")
        _add(designator, "Designator", one.name)
        _add(designator, "UUID", _uuid(f"{digest} {one.name}"))
        _add(element, "CharacteristicNominalId", nominal)
    return items


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


def _results(root: ET.Element, results: Measured, items: Sequence[str], ids: _Ids) -> None:
    """Write the measurements of all characteristics, and the status of the part."""
    parent = _add(root, "Results")
    sets = _list(parent, "MeasurementResultsSet", 1)
    measured = _add(sets, "MeasurementResults", id=ids.next())
    part = ids.next()
    images = results.source.get("images", {})
    if images:
        files = _list(measured, "ExternalFileReferences", len(images))
        for name, digest in images.items():
            file = _add(files, "ExternalFileReference")
            _add(file, "URI", name)
            _add(_add(file, "FileSpec"), "OtherFileSpec", "image")
            _add(file, "Description", f"SHA-256 {digest}")
    lists = _add(measured, "MeasuredCharacteristics")
    parent_list = _list(lists, "CharacteristicMeasurements", len(items))
    for one, item in zip(results, items, strict=True):
        element = _add(parent_list, f"{_characteristic(one)}Measurement", id=ids.next())
        _measurement(element, one, item, part)
    status = _part_status(results)
    _add(_add(measured, "InspectionStatus"), "InspectionStatusEnum", status)
    _add(_list(measured, "ActualComponentIds", 1), "Id", part)
    components = _list(_list(parent, "ActualComponentSets", 1), "ActualComponentSet", 1)
    component = _add(components, "ActualComponent", id=part)
    if results.serial:
        _add(component, "SerialNumber", results.serial)
    _add(_add(component, "Status"), "InspectionStatusEnum", status)


def _measurement(element: ET.Element, one: Result, item: str, part: str) -> None:
    notes = [one.reason] if one.reason else list(one.notes)
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


def _part_status(results: Measured) -> str:
    """Return PASS if all conforms, FAIL if something certainly does not, otherwise UNDEFINED."""
    if any(one.decision is Decision.DOES_NOT_CONFORM for one in results):
        return "FAIL"
    decided = any(one.decision is Decision.CONFORMS for one in results)
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


FORMAT = "aspectgraph-results"
VERSION = 1

COLUMNS = (
    *("name", "kind", "unit", "nominal", "lower", "upper", "value", "deviation", "u", "U", "k"),
    *("decision", "P_conforms", "images", "found", "rms_px", "overexposed"),
    *(f"u_{source.replace(' ', '_')}" for source in SOURCES),
    "reason",
)
"""Columns of the table."""


@dataclass(frozen=True, eq=False)
class MeasurementResults:
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
    source : dict of str to str
        Names and SHA-256 of plan, part and images.
    notes : tuple of str
        What the user should know.
    pictures : dict of str to Picture
        The images.
    """

    results: Mapping[str, Result]
    images: Mapping[str, Registered]
    failed: Mapping[str, str]
    rule: DecisionRule
    serial: str
    correlation: NDArray[np.float64]
    source: Mapping[str, Any]
    notes: tuple[str, ...] = ()
    pictures: Mapping[str, Picture] = field(default_factory=dict)

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
        return f"<MeasurementResults of {self.serial or 'a part'!r}: {counts or 'nothing'}>"

    @property
    def readings(self) -> dict[str, tuple[Reading, ...]]:
        """The readings of each target."""
        return {name: one.readings for name, one in self.results.items()}

    @property
    def counts(self) -> dict[str, int]:
        """Number of targets by decision."""
        found = [one.decision for one in self]
        return {str(d.value): found.count(d) for d in Decision if d in found}

    @property
    def measured(self) -> bool:
        """Whether every target has a value."""
        return all(one.measured for one in self)

    @property
    def conforms(self) -> bool:
        """Whether every target was measured, and those with a tolerance conform."""
        fine = (Decision.CONFORMS, Decision.NO_TOLERANCE)
        return all(one.decision in fine for one in self)

    def to_dict(self) -> dict[str, Any]:
        """Return everything but points and pictures as plain values, ready for JSON.

        Returns
        -------
        dict
            What `write` writes.
        """
        return {
            "format": FORMAT,
            "version": VERSION,
            "serial": self.serial,
            "rule": {"name": self.rule.name, "level": self.rule.level, "k": COVERAGE},
            "source": dict(self.source),
            "notes": list(self.notes),
            "results": [_result_dict(one) for one in self],
            "measured": [one.name for one in self if one.measured],
            "correlation": self.correlation.tolist(),
            "images": {name: _image_dict(one) for name, one in self.images.items()},
            "not_registered": dict(self.failed),
            "white": {
                name: {"level": one.white, "from": one.white_from}
                for name, one in self.pictures.items()
            },
        }

    def write(self, path: str | os.PathLike[str]) -> Path:
        """Write the results as JSON, see ``results_schema.json``.

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
        return [_row(one) for one in self]

    def to_csv(self) -> str:
        """Return the table as CSV.

        Returns
        -------
        str
            With a heading; lines end with CR LF. Text that a spreadsheet would run begins with an
            apostrophe.
        """
        return csv_text(COLUMNS, self.rows())

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


def results_schema() -> dict[str, Any]:
    """Return the JSON Schema of results.json."""
    text = resources.files("planner.measuring").joinpath("results_schema.json").read_text("utf-8")
    schema: dict[str, Any] = json.loads(text)
    return schema


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _result_dict(one: Result) -> dict[str, Any]:
    return {
        "name": one.name,
        "kind": one.kind,
        "unit": one.unit,
        "nominal": one.nominal,
        "tolerance": plain_tolerance(one.tolerance),
        "value": _number(one.value),
        "deviation": _number(one.deviation),
        "u": _number(one.standard_uncertainty),
        "U": _number(one.expanded_uncertainty),
        "decision": one.decision.value,
        "P_conforms": _number(one.conformance_probability),
        "reason": one.reason,
        "notes": list(one.notes),
        "readings": [_reading_dict(reading) for reading in one.readings],
    }


def _reading_dict(one: Reading) -> dict[str, Any]:
    return {
        "image": one.image,
        "value": _number(one.value),
        "u": _number(one.standard_uncertainty),
        "variance": dict(one.budget),
        "found_share": one.found_share,
        "rms_px": _number(one.rms_px),
        "U_drawn": _number(one.drawn_uncertainty),
        "samples": dict(one.counts),
        "reason": one.reason,
        "notes": list(one.notes),
    }


def _image_dict(one: Registered) -> dict[str, Any]:
    return {
        "method": one.method,
        "cam2world": one.cam2world.tolist(),
        "pose_covariance": one.covariance[:6, :6].tolist(),
        "deviations": one.deviations.tolist(),
        "shift_px": one.shift_px,
        "used": one.used,
        "offered": one.offered,
        "misfit_px": _number(one.misfit_px),
        "blur_px": _number(one.blur_px),
        "chi2": _number(one.chi2),
        "notes": list(one.notes),
    }


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
        " ".join(reading.image for reading in readings),
        _number(max((reading.found_share for reading in readings), default=math.nan)),
        _number(min((reading.rms_px for reading in readings), default=math.nan)),
        counts.get("overexposed", 0) / total if total else None,
        *(_signed_root(budget[source]) if budget else None for source in SOURCES),
        one.reason,
    )
    return dict(zip(COLUMNS, values, strict=True))


def _signed_root(variance: float) -> float:
    """Return the root of a variance; what two sources have in common may be negative."""
    return math.copysign(math.sqrt(abs(variance)), variance)
