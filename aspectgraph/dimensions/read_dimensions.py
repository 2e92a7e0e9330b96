"""`read_dimensions`, `read_requirements`: what a STEP file requires of its part, and the entities that measure it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from aspectgraph.dimensions.features import (
    Attachments,
    Feature,
    MeasuringWays,
    ModelDimension,
    Sight,
    SurfaceZones,
    Way,
    WaysFinder,
    describe_shape,
    unique_names,
)
from aspectgraph.dimensions.geometric import ModelRequirements, list_tolerances
from aspectgraph.dimensions.tolerances import (
    DIGITS,
    Statement,
    deviations,
    is_in_hole,
    read_statements,
    resolve_stated_class,
)
from aspectgraph.exceptions import ReadError
from aspectgraph.files import ReadLimits
from aspectgraph.phases import phase
from aspectgraph.read.part_file import STEP_SUFFIXES, plain_step_file
from aspectgraph.read.step.step_file import StepKernel
from aspectgraph.solid.solid import Solid, check_solid, kind_text

AGREEMENT_MM = 0.013
"""A stated length and the geometry agree within half of a thousandth of an inch, to which drawings round."""

AGREEMENT_DEG = 0.05
"""The same for angles: half of a tenth of a degree."""

MOST_ALTERNATIVES = 8
"""Pairs of edges are many; the best ones are enough."""


def read_dimensions(
    path: str | Path,
    solid: Solid,
    *,
    agreement_mm: float = AGREEMENT_MM,
    agreement_deg: float = AGREEMENT_DEG,
    limits: ReadLimits | None = None,
) -> tuple[ModelDimension, ...]:
    """Read the dimensions of a STEP file (AP242), with the entities that measure each.

    Parameters
    ----------
    path : str or Path
        A .step or .stp file; it may be compressed as .gz.
    solid : Solid
        The part, read from the same file with `read_solid`.
    agreement_mm, agreement_deg : float
        Largest difference between a stated value and that of the geometry it is attached to. A dimension that differs
        by more is not measurable, and its reason names both values. Default: half of the last digit on a drawing, 0.013
        mm (a thousandth of an inch) and 0.05 degrees.
    limits : ReadLimits, optional
        Limits of time, memory and size for the reading. Default: ``ReadLimits()``.

    Returns
    -------
    tuple of ModelDimension
        In the order of the file. Empty for files without semantic dimensions, such as those of
        AP203 and AP214. Objects that only draw a dimension or a label do not count.

    Raises
    ------
    PartFileNotFoundError
        There is no such file.
    ReadError
        The file is not a STEP file, is damaged or exceeds a limit, a parameter is out of range, or the solid is
        of another file.
    MissingExtraError
        The package cadquery-ocp-novtk is not installed.

    Notes
    -----
    An assembly may contain a part several times. The result then lists its dimensions for each
    instance. Dimensions of solids that were not read say so.

    Examples
    --------
    >>> from aspectgraph import read_dimensions, read_solid
    >>> part = "examples/nist_ctc_01_ap242.stp"
    >>> dimensions = read_dimensions(part, read_solid(part))
    >>> dimensions[3].name, dimensions[3].kind, dimensions[3].nominal, dimensions[3].tolerance
    ('Linear Size.1', 'diameter', 35.0, (-0.2, 0.0))
    >>> len(dimensions), sum(one.entities is not None for one in dimensions)
    (12, 12)
    """
    read = read_requirements(
        path, solid, agreement_mm=agreement_mm, agreement_deg=agreement_deg, limits=limits
    )
    return read.dimensions


def read_requirements(
    path: str | Path,
    solid: Solid,
    *,
    agreement_mm: float = AGREEMENT_MM,
    agreement_deg: float = AGREEMENT_DEG,
    limits: ReadLimits | None = None,
) -> ModelRequirements:
    """Read all requirements of a STEP file (AP242): its dimensions and its geometric tolerances.

    Parameters
    ----------
    path : str or Path
        See `read_dimensions`.
    solid : Solid
        The part, read from the same file with `read_solid`.
    agreement_mm, agreement_deg : float
        See `read_dimensions`.
    limits : ReadLimits, optional
        See `read_dimensions`.

    Returns
    -------
    ModelRequirements
        Empty for files without any, such as those of AP203 and AP214.

    Raises
    ------
    SolidError
        It is no solid, or the two arguments are exchanged.
    PartFileNotFoundError
        There is no such file.
    ReadError
        The file is not a STEP file, is damaged or exceeds a limit, or a parameter is out of range.
    MissingExtraError
        The package cadquery-ocp-novtk is not installed.

    Examples
    --------
    >>> from aspectgraph import read_requirements, read_solid
    >>> part = "examples/nist_ctc_01_ap242.stp"
    >>> stated = read_requirements(part, read_solid(part))
    >>> len(stated), len(stated.dimensions), len(stated.tolerances), stated.n_measurable
    (18, 12, 6, 14)
    """
    check_solid(solid, path, "path, solid")
    if not isinstance(path, str | PathLike):
        raise ReadError.of_rule("path", "must be a path", kind_text(path))
    for label, value in (("agreement_mm", agreement_mm), ("agreement_deg", agreement_deg)):
        if not 0 < value < float("inf"):
            raise ReadError(f"{label} must be positive and finite. Got {value}.")
    if not Path(path).name.lower().removesuffix(".gz").endswith(STEP_SUFFIXES):
        raise ReadError(
            f"dimensions are read from {' and '.join(STEP_SUFFIXES)} files. Got {Path(path).name!r}."
        )
    limits = limits or ReadLimits()
    with (
        plain_step_file(Path(path), limits) as plain,
        StepKernel(Path(path).name, limits) as kernel,
        phase("read the dimensions"),
    ):
        answer, _ = kernel.ask("dimensions", path=str(plain.absolute()), name=Path(path).name)
    reader = _Reader(solid, agreement_mm, agreement_deg)
    reader.check_same_part(answer, Path(path).name)
    dimensions = _listed_dimensions(reader, answer)
    return ModelRequirements(
        dimensions,
        list_tolerances(
            reader.attachments,
            reader.measurer.sight,
            answer["tolerances"],
            answer["datums"],
            dimensions,
        ),
        tuple(answer["disagreements"]),
    )


def _listed_dimensions(reader: _Reader, answer: dict[str, Any]) -> tuple[ModelDimension, ...]:
    """Return the dimensions of a file in its order."""
    rows = answer["found"]
    dimensions = []
    titles = []
    statements = read_statements(rows, answer["stated"])
    for k, (row, statement) in enumerate(zip(rows, statements, strict=True), start=1):
        placed = _placed_rows(row, statement)
        for placed_row in placed:
            dimensions.append(reader.dimension(placed_row, statement))
            title = row["name"] or f"{dimensions[-1].kind} {k}"
            titles.append(
                f"{title} ({_listed(placed_row['solids'])})" if len(placed) > 1 else title
            )
    zones = SurfaceZones(reader.attachments, answer["surfaces"])
    return tuple(
        replace(dimension, name=name, surfaces=zones.of_dimension(dimension))
        for dimension, name in zip(dimensions, unique_names(titles), strict=True)
    )


def _placed_rows(row: dict[str, Any], statement: Statement) -> list[dict[str, Any]]:
    """Return a dimension once for each instance of its part; once with the reason if these are not known."""
    instances = row["instances"]
    if len(instances) > 1 and statement.of_occurrence:
        reason = (
            f"the file attaches it to one of {len(instances)} instances of the part, "
            "and which one is not read"
        )
        return [{**row, "solids": [], "unresolved": reason}]
    if not instances:
        return [{**row, "solids": []}]
    return [{**row, **instance} for instance in instances]


def _listed(solids: Sequence[int]) -> str:
    """Return solids in words."""
    if len(solids) == 1:
        return f"solid {solids[0]}"
    return f"solids {', '.join(map(str, solids[:-1]))} and {solids[-1]}"


class _Reader:
    """Turns what a file states into dimensions of one solid."""

    def __init__(self, solid: Solid, agreement_mm: float, agreement_deg: float):
        self.solid = solid
        self.attachments = Attachments(solid)
        self.measurer = WaysFinder(self.attachments, Sight(solid))
        self.agreement_mm = agreement_mm
        self.agreement_deg = agreement_deg
        self.file_solids = solid.file_solids

    def dimension(self, row: dict[str, Any], stated: Statement) -> ModelDimension:
        """Return a dimension, as yet without a name."""
        measure = self._measure(row)
        value = _nearest(measure.values, stated)
        nominal = stated.nominal
        note = _and(stated.note, measure.note, _unread_text(row))
        if nominal is None and value is not None:
            nominal = round(value, DIGITS)
            note = _and(note, "the file states no nominal value; this is the geometry's")
        tolerance = stated.tolerance
        if stated.limits is not None and nominal is not None:
            tolerance = deviations(nominal, stated.limits)
        of_class = resolve_stated_class(
            replace(stated, tolerance=tolerance),
            row.get("name", ""),
            measure.kind,
            nominal,
            self._in_hole(measure),
        )
        tolerance = tolerance or of_class.deviations
        note = _and(note, of_class.note)
        reason = (
            row["unresolved"]
            or self._unread(row["solids"])
            or stated.fault
            or of_class.fault
            or self._disagreement(measure, stated)
            or measure.reason
            or None
        )
        features = () if reason else tuple(ways[: MOST_ALTERNATIVES + 1] for ways in measure.ways)
        missing = sum(not ways for ways in features)
        if missing:
            note = _and(note, f"{missing} of its {len(features)} features cannot be measured")
        return ModelDimension(
            name="",
            kind=measure.kind,
            nominal=nominal,
            tolerance=tolerance,
            entities=next((ways[0] for ways in features if ways), None),
            reason=reason,
            alternatives=_others(features),
            features=features,
            geometry=value,
            direction=_direction(measure),
            attached=_in_words(row["sides"]),
            note=note,
            n_features=measure.n_features,
            solids=tuple(row["solids"]),
            feature_reasons=() if reason else measure.missing,
            tolerance_class=of_class.name,
            role=stated.role or None,
        )

    def check_same_part(self, answer: dict[str, Any], name: str) -> None:
        """Refuse a solid that has none of the edges that dimensions are attached to: it is of another file."""
        rows = answer["found"]
        statements = read_statements(rows, answer["stated"])
        placed = [
            placed_row
            for row, statement in zip(rows, statements, strict=True)
            for placed_row in _placed_rows(row, statement)
        ]
        shapes = [
            shape
            for row in placed
            if not self._unread(row["solids"])
            for side in row["sides"]
            for shape in side
        ]
        edges = [edge for shape in shapes for edge in (shape, *shape.get("edges", ()))]
        lines = [edge for edge in edges if edge["kind"] in ("line", "circle")]
        if lines and not any(self.attachments.has_vertex_on(edge) for edge in lines):
            rule = f"must be the part of {name}"
            got = (
                f"{self.solid.name!r}, which has no edge that the file's dimensions are attached to"
            )
            raise ReadError.of_rule("solid", rule, got, hint="read it with read_solid")

    def _in_hole(self, measure: MeasuringWays) -> bool | None:
        """Return whether a diameter is one of holes; None if it is not known, or differs."""
        arcs = {arc.id: arc for arc in self.attachments.circles}
        first = [ways[0][0] for ways in measure.ways if ways and measure.kind == "diameter"]
        sides = {is_in_hole(self.solid, arcs[arc_id]) for arc_id in first if arc_id in arcs}
        return sides.pop() if len(sides) == 1 else None

    def _unread(self, solids: Sequence[int]) -> str:
        """Return why solids are not measured, or nothing if they are."""
        if self.file_solids is None:
            return ""
        hidden = [i for i in solids if i in self.file_solids.occluders]
        if hidden:
            return f"{_listed(hidden)} only {'stands' if len(hidden) == 1 else 'stand'} in the way"
        missing = [i for i in solids if i not in self.file_solids.measured]
        if missing:
            return (
                f"{_listed(missing)} of the file {'was' if len(missing) == 1 else 'were'} not read"
            )
        return ""

    def _measure(self, row: dict[str, Any]) -> MeasuringWays:
        kind = _kind(row)
        first, second = (self.attachments.features(side) for side in row["sides"])
        n_unread = sum(row["unread"])
        if kind in ("diameter", "radius"):
            return self.measurer.size(kind, first + second, n_unread)
        round_values = _round_values(kind, row["sides"])
        if kind not in ("distance", "angle") or round_values:
            quantity = "angle of a cone" if kind == "angle" else kind.replace("_", " ")
            return MeasuringWays(
                kind,
                round_values,
                reason=f"no edges, rims and arcs measure the {quantity}",
                n_features=self._n_round(row["sides"], first + second) + n_unread,
            )
        ends = _two_ends(first, second, bool(row["sides"][1]))
        if isinstance(ends, str):
            return MeasuringWays(kind, reason=ends)
        return self.measurer.angle(*ends) if kind == "angle" else self.measurer.between(*ends)

    def _n_round(
        self, sides: Sequence[Sequence[dict[str, Any]]], features: Sequence[Feature]
    ) -> int:
        """Return on how many features the angle of cones or the radius of spheres is stated."""
        centres: list[np.ndarray] = []
        for shape in (shape for side in sides for shape in side if shape["kind"] == "sphere"):
            centre = np.array(shape["point"])
            near = (np.linalg.norm(centre - old) <= self.attachments.match_mm for old in centres)
            if not any(near):
                centres.append(centre)
        return max(1, len(centres) or len(features))

    def _disagreement(self, measure: MeasuringWays, stated: Statement) -> str | None:
        """Return how the stated value differs from the geometry of a feature, or None if it does not."""
        unit, allowed = (
            ("degrees", self.agreement_deg)
            if measure.kind == "angle"
            else ("mm", self.agreement_mm)
        )
        bounds = (stated.nominal, stated.nominal) if stated.nominal is not None else stated.limits
        if bounds is None:
            return None
        values = measure.values
        if measure.kind == "angle" and values:
            values = (min(values, key=lambda value: abs(value - bounds[0])),)
        wrong = [
            value for value in values if not bounds[0] - allowed <= value <= bounds[1] + allowed
        ]
        if not wrong:
            return None
        text = (
            f"{bounds[0]:.6g}"
            if stated.nominal is not None
            else f"{bounds[0]:.6g} to {bounds[1]:.6g}"
        )
        return f"the file states {text} {unit}, the geometry it is attached to has {wrong[0]:.6g} {unit}"


def _kind(row: dict[str, Any]) -> str:
    """Return the kind of a dimension by its words in the file, which are there where the kernel's type is not."""
    words = row["words"].lower()
    kernel_type = row["type"]
    if "spherical" in words:
        return "spherical_diameter" if "diameter" in words else "spherical_radius"
    if "curve" in words or "arc" in words.split() or "Path" in kernel_type:
        return "curve_length"
    for kind in ("angle", "diameter", "radius"):
        if kind in words or (kind == "angle" and "Angular" in kernel_type):
            return kind
    return "distance"


def _two_ends(
    first: Sequence[Feature], second: Sequence[Feature], apart: bool
) -> tuple[Feature, Feature] | str:
    """Return the two features between which a dimension lies, or why there are not two.

    `apart`: the file says which shapes are at which end.
    """
    if apart:
        if len(first) != 1 or len(second) != 1:
            return f"each of its ends needs one plane, edge or axis. Got {len(first)} and {len(second)}"
        return first[0], second[0]
    if len(first) != 2:
        return f"it needs two ends, each a plane, edge or axis. Got {len(first)}"
    return first[0], first[1]


def _round_values(kind: str, sides: Sequence[Sequence[dict[str, Any]]]) -> tuple[float, ...]:
    """Return what the geometry has for the angle of cones, or the radius or diameter of spheres."""
    shapes = [shape for side in sides for shape in side]
    if kind == "angle":
        return tuple(shape["angle_deg"] for shape in shapes if shape["kind"] == "cone")
    factor = {"spherical_radius": 1.0, "spherical_diameter": 2.0}.get(kind, 0.0)
    return tuple(
        factor * shape["radius"] for shape in shapes if shape["kind"] == "sphere" and factor
    )


def _nearest(values: Sequence[float], stated: Statement) -> float | None:
    """Return the value of the geometry nearest to what is stated; the first if nothing is."""
    if not values or stated.nominal is None:
        return values[0] if values else None
    nominal = stated.nominal
    return min(values, key=lambda value: abs(value - nominal))


def _others(features: Sequence[Sequence[Way]]) -> tuple[Way, ...]:
    """Return all ways but the first."""
    return tuple(way for ways in features for way in ways)[1:]


def _direction(measure: MeasuringWays) -> tuple[float, float, float] | None:
    if measure.direction is None:
        return None
    x, y, z = (float(c) + 0.0 for c in measure.direction)
    return x, y, z


def _in_words(sides: Sequence[Sequence[dict[str, Any]]]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(describe_shape(shape) for side in sides for shape in side))


def _unread_text(row: dict[str, Any]) -> str:
    """Say what a dimension is attached to and the kernel did not read; nothing if it read everything."""
    if not row["compared"]:
        return "the text of the file could not be compared: it may apply to more features"
    n_unread = sum(row["unread"])
    if not n_unread or not any(row["sides"]):
        # of a dimension without any shape the reason says it
        return ""
    items = "1 item" if n_unread == 1 else f"{n_unread} items"
    return f"{items} that it is attached to could not be read"


def _and(*notes: str) -> str:
    return "; ".join(note for note in notes if note)
