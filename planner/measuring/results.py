"""What was measured on one part: all results, and their files."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aspectgraph.entities.spreadsheet_text import csv_text
from errors.measurands import Decision, DecisionRule
from errors.measurands.conformity import COVERAGE
from planner.files import write_text
from planner.measuring.image.picture import Picture
from planner.measuring.merge import Result
from planner.measuring.poses.registered import Registered
from planner.measuring.qif import qif_text
from planner.measuring.reading import SOURCES, Reading

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
        "tolerance": None if one.tolerance is None else list(one.tolerance),
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
    lower, upper = (None, None) if one.tolerance is None else one.tolerance
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
