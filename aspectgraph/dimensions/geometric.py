"""Geometric tolerances of a CAD model, what they are attached to, and why edges show them or do not.

Reference: ISO 1101 and ASME Y14.5 for the characteristics; ISO 2692 for material conditions.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from aspectgraph.dimensions.features import (
    Attachments,
    Axis,
    EntityId,
    Feature,
    ModelDimension,
    Plane,
    Sight,
    Way,
    arc_order,
    describe_shape,
    parallel,
    perpendicular,
    unique_names,
)
from aspectgraph.solid.rims import Arc

_SURFACE = "needs the surface, not its edges"
_FORM = "edges do not show it"

_REASONS = {
    "circular run-out": "needs the surface while the part turns about its datum axis",
    "cylindricity": f"form of a surface: {_FORM}",
    "flatness": f"flatness of a face: {_FORM}",
    "line profile": "needs the line on the surface, not its edges",
    "roundness": f"roundness in every section: {_FORM}",
    "straightness": f"straightness of lines on a surface: {_FORM}",
    "surface profile": _SURFACE,
    "total run-out": "needs the surface while the part turns about its datum axis",
}
"""Why the edges of a part do not show a characteristic, in the words of the trade."""

_ORIENTATIONS = ("angularity", "parallelism", "perpendicularity")
"""Characteristics that say how a face or axis is turned to a datum."""

_NO_FRAME = "only positions of holes and pins are measured against datums"
_NO_CYLINDER = "position: the file states no cylindrical zone"

_TO_DIAMETER = {"diameter": 1.0, "radius": 2.0}
"""Kinds of sizes, and what makes them diameters."""

_MOST_RIMS = 4
"""Rims of a hole that are offered for its position."""


@dataclass(frozen=True)
class GeometricTolerance:
    """A geometric tolerance that a CAD model states.

    Attributes
    ----------
    name : str
        Unique name: the name in the model, or characteristic and number.
    kind : str
        Its characteristic, such as ``"position"``, ``"surface profile"`` or ``"total run-out"``.
    zone_mm : float or None
        Width of the zone, or its diameter if it is ``diametral``. None if the model states none.
    diametral : bool
        The zone is a cylinder or a circle.
    material : str
        ``"M"`` or ``"L"`` for the maximum or least material condition; otherwise empty.
    datums : tuple of str
        The datums in their order, such as ``"A"``, ``"B(M)"`` or ``"A-B"``.
    projected_mm : float or None
        Height of a projected zone. None if it is not projected.
    attached : tuple of str
        The elements of the model that it refers to.
    n_features : int
        Number of features: each hole of a pattern is one.
    reason : str or None
        Why edges do not show it. None if they do.
    entities : tuple or None
        Ids of the solid's entities that measure it in one image: of a position its rim, then what shows its datums.
        None if nothing does.
    features : tuple of tuple of tuple
        For each feature all entities that measure it there, best first.
    feature_reasons : tuple of str or None
        For each feature why it is not measured; None where it is.
    note : str
        Sentence on what could not be read; empty if there is none.
    sizes : tuple of (float, float) or None
        With a material condition, for each feature the limits of its diameter that the model states, as deviations
        from the diameter of the geometry, mm. None where it states none.

    Examples
    --------
    >>> from aspectgraph import read_requirements, read_solid
    >>> part = "examples/nist_ctc_01_ap242.stp"
    >>> stated = read_requirements(part, read_solid(part)).tolerances
    >>> stated[0]
    <GeometricTolerance 'Position.1': position 0.75 mm | A | B | C>
    >>> stated[-1].frame, stated[-1].reason
    ('0.2 mm', 'flatness of a face: edges do not show it')
    """

    name: str
    kind: str
    zone_mm: float | None
    diametral: bool
    material: str
    datums: tuple[str, ...]
    projected_mm: float | None
    attached: tuple[str, ...]
    n_features: int
    reason: str | None
    entities: Way | None = None
    features: tuple[tuple[Way, ...], ...] = ()
    feature_reasons: tuple[str | None, ...] = ()
    note: str = ""
    sizes: tuple[tuple[float, float] | None, ...] = ()

    @property
    def frame(self) -> str:
        """The zone and the datums as in a feature control frame, such as ``"⌀0.5 mm (M) | A | B"``."""
        zone = "no zone"
        if self.zone_mm is not None:
            zone = f"{self.zone_mm:.6g} mm"
        material = f" ({self.material})" if self.material else ""
        projected = "" if self.projected_mm is None else f" (P) {self.projected_mm:.6g} mm"
        first = f"{'⌀' if self.diametral else ''}{zone}{material}{projected}"
        return " | ".join((first, *self.datums))

    def to_dict(self) -> dict[str, Any]:
        """Return the tolerance as JSON values: every attribute by name.

        Returns
        -------
        dict
            The attributes in their order, then ``unit``.
        """
        values = asdict(self)
        for key in ("datums", "attached", "feature_reasons"):
            values[key] = list(values[key])
        values["sizes"] = [None if size is None else list(size) for size in self.sizes]
        values["features"] = [[list(way) for way in ways] for ways in self.features]
        if self.entities is not None:
            values["entities"] = list(self.entities)
        return {**values, "unit": "mm"}

    def __repr__(self) -> str:
        """Return a one-line summary."""
        return f"<GeometricTolerance {self.name!r}: {self.kind} {self.frame}>"


@dataclass(frozen=True)
class ModelRequirements:
    """All that a CAD model requires of its part. Iteration goes through the dimensions, then the tolerances.

    Attributes
    ----------
    dimensions : tuple of ModelDimension
        The dimensions in the order of the file.
    tolerances : tuple of GeometricTolerance
        The geometric tolerances in the order of the file.
    disagreements : tuple of str
        Sentences on tolerances that the text of the file states and the kernel does not read, or the reverse.

    Examples
    --------
    >>> from aspectgraph import read_requirements, read_solid
    >>> part = "examples/nist_ctc_01_ap242.stp"
    >>> read_requirements(part, read_solid(part))
    <ModelRequirements: 12 dimensions, 6 geometric tolerances, 12 measurable>
    """

    dimensions: tuple[ModelDimension, ...] = ()
    tolerances: tuple[GeometricTolerance, ...] = ()
    disagreements: tuple[str, ...] = ()

    def __iter__(self) -> Iterator[ModelDimension | GeometricTolerance]:
        yield from self.dimensions
        yield from self.tolerances

    def __len__(self) -> int:
        return len(self.dimensions) + len(self.tolerances)

    def __repr__(self) -> str:
        """Return a one-line summary."""
        counts = f"{len(self.dimensions)} dimensions, {len(self.tolerances)} geometric tolerances"
        return f"<ModelRequirements: {counts}, {self.n_measurable} measurable>"

    @property
    def n_measurable(self) -> int:
        """Number of requirements that edges show."""
        return sum(requirement.entities is not None for requirement in self)


def list_tolerances(
    attachments: Attachments,
    sight: Sight,
    rows: Sequence[dict[str, Any]],
    datums: Mapping[str, Sequence[Any]],
    dimensions: Sequence[ModelDimension] = (),
) -> tuple[GeometricTolerance, ...]:
    """Return the geometric tolerances of a file in its order.

    Parameters
    ----------
    attachments : Attachments
        Finds the features of shapes.
    sight : Sight
        From where their entities are seen.
    rows : sequence of dict
        See `semantic_dimensions.describe_tolerances`.
    datums : mapping of str to sequence of dict
        The shapes of each datum, by its letter.
    dimensions : sequence of ModelDimension
        The dimensions of the file, among them the sizes of holes and pins.
    """
    of_datums: dict[str, list[Feature] | None] = {}
    for letter, shapes in datums.items():
        has_targets = any(shape["kind"] == "target" for shape in shapes)
        of_datums[letter] = None if has_targets else attachments.features(shapes)
    titles = [row["name"] or f"{row['characteristic']} {k}" for k, row in enumerate(rows, 1)]
    tolerances = []
    for row, name in zip(rows, unique_names(titles), strict=True):
        features = attachments.features(row["shapes"])
        reason: str | None = _reason(row, features)
        ways: list[list[Way]] = []
        reasons: list[str | None] = []
        if reason is None:
            for feature in features:
                assert isinstance(feature, Axis), "only positions of axes have no reason"
                try:
                    ways.append(_position_ways(sight, feature, row["datums"], of_datums))
                    reasons.append(None)
                except _NotShownError as error:
                    ways.append([])
                    reasons.append(f"position: {error}")
            if not any(ways):
                reason = reasons[0]
        measured = reason is None
        sizes: tuple[tuple[float, float] | None, ...] = ()
        if measured and row["material"]:
            sizes = tuple(_size_of(choices, dimensions) for choices in ways)
        tolerances.append(
            GeometricTolerance(
                name,
                row["characteristic"],
                row["zone_mm"],
                row["diametral"],
                row["material"],
                tuple(row["datums"]),
                row["projected_mm"],
                tuple(dict.fromkeys(describe_shape(shape) for shape in row["shapes"])),
                max(1, len(features)),
                reason,
                next((found_ways[0] for found_ways in ways if found_ways), None),
                tuple(map(tuple, ways)) if measured else (),
                tuple(reasons) if measured else (),
                _note(row, sizes),
                sizes,
            )
        )
    return tuple(tolerances)


def _size_of(
    ways: Sequence[Way], dimensions: Sequence[ModelDimension]
) -> tuple[float, float] | None:
    """Return the limits of the diameter of a hole or pin that a model states, from the value of its geometry."""
    rims = {way[0] for way in ways}
    for dimension in dimensions:
        factor = _TO_DIAMETER.get(dimension.kind)
        if factor is None or dimension.tolerance is None:
            continue
        on_rims = any(
            way[0] in rims for choices in dimension.features for way in choices if len(way) == 1
        )
        if on_rims and dimension.nominal is not None and dimension.geometry is not None:
            apart = dimension.nominal - dimension.geometry
            lower, upper = dimension.tolerance
            return factor * (apart + lower), factor * (apart + upper)
    return None


class _NotShownError(Exception):
    """No rim or edge shows a position or one of its datums; the text says which."""


def _position_ways(
    sight: Sight,
    hole: Axis,
    letters: Sequence[str],
    of_datums: Mapping[str, Sequence[Feature] | None],
) -> list[Way]:
    """Return sets of a rim and the entities that show the datums in their order, best first.

    Raises
    ------
    _NotShownError
        If there is none.
    """
    rims = sorted(hole.circles, key=lambda arc: arc_order(sight, arc))
    if not rims:
        raise _NotShownError("no sharp circular edge bounds this feature")
    ways = []
    faults = []
    for rim in rims[:_MOST_RIMS]:
        try:
            ways.append(_with_datums(sight, rim, letters, of_datums))
        except _NotShownError as error:
            faults.append(error)
    if not ways:
        raise faults[0]
    return ways


def _with_datums(
    sight: Sight,
    rim: Arc,
    letters: Sequence[str],
    of_datums: Mapping[str, Sequence[Feature] | None],
) -> Way:
    """Return a rim with the entities that show its datums."""
    way: list[EntityId] = [rim.id]
    fixed_turn = False
    n_shifts = 0
    for letter in letters:
        features = of_datums.get(letter.partition("(")[0], ())
        if features is None:
            raise _NotShownError(f"datum {letter} is stated by datum targets, not by a feature")
        if len(features) != 1:
            words = f"{len(features)} features" if features else "no feature"
            raise _NotShownError(f"the file attaches datum {letter} to {words}, not to one")
        (datum,) = features
        if isinstance(datum, Plane) and parallel(datum.normal, rim.axis):
            # it fixes nothing in the plane of the rim
            continue
        if n_shifts == 2 and fixed_turn:
            break
        if isinstance(datum, Axis) and parallel(datum.along, rim.axis):
            way.append(_rim_of_datum(rim, datum, letter))
            fixed_turn = fixed_turn or n_shifts == 2
            n_shifts = 2
        elif isinstance(datum, Plane) and perpendicular(datum.normal, rim.axis):
            way.append(_edge_of_datum(sight, rim, datum, letter))
            fixed_turn = True
            n_shifts = min(2, n_shifts + 1)
        else:
            raise _NotShownError(f"the rim is inclined to datum {letter}")
    # about a datum hole alone, the deviation along the radius counts
    if n_shifts < 2:
        raise _NotShownError("its datums leave a translation free")
    if not sight.together(rim, *(entity for entity in way[1:] if isinstance(entity, int))):
        raise _NotShownError("no direction shows its rim and the edges of its datums together")
    return tuple(way)


def _rim_of_datum(rim: Arc, datum: Axis, letter: str) -> EntityId:
    """Return the rim of a datum hole that is nearest to the plane of a rim and looks the same way."""
    circles = [arc for arc in datum.circles if float(arc.axis @ rim.axis) > 0.0 and arc is not rim]
    if not circles:
        raise _NotShownError(f"no rim on the same side shows datum {letter}")
    return min(circles, key=lambda arc: abs(float((arc.centre - rim.centre) @ rim.axis))).id


def _edge_of_datum(sight: Sight, rim: Arc, datum: Plane, letter: str) -> EntityId:
    """Return the edge of a datum plane that lies nearest to the plane of a rim, and is longest there."""
    edges = []
    for edge_id in datum.edges:
        ends = sight.solid.edge_points(edge_id)
        along = ends[1] - ends[0]
        if perpendicular(along / np.linalg.norm(along), rim.axis) and sight.together(edge_id, rim):
            depth = round(abs(float((ends[0] - rim.centre) @ rim.axis)), 3)
            edges.append((depth, -sight.length_mm(edge_id), edge_id))
    if not edges:
        raise _NotShownError(f"no edge that is seen with the rim shows datum {letter}")
    return min(edges)[2]


def _reason(row: dict[str, Any], features: Sequence[Feature]) -> str | None:
    """Return why edges do not show a tolerance; None of a position of holes or pins."""
    kind = row["characteristic"]
    if kind in _REASONS:
        return _REASONS[kind]
    around_axes = bool(features) and all(isinstance(feature, Axis) for feature in features)
    if kind in _ORIENTATIONS:
        return (
            f"{kind} of an axis: needs both of its rims, and its datum face"
            if around_axes
            else f"{kind} of a face: {_SURFACE}"
        )
    if row["projected_mm"] is not None:
        return "projected zone: a rim does not show the axis outside the part"
    if not features:
        return f"{kind}: it is attached to no plane, edge or axis"
    if kind == "position" and around_axes:
        return None if row["diametral"] and row["zone_mm"] else _NO_CYLINDER
    if any(isinstance(feature, Plane) for feature in features) and len(features) != 2:
        return f"{kind} of faces: {_SURFACE}"
    return f"{kind}: {_NO_FRAME}"


def _note(row: dict[str, Any], sizes: Sequence[Any]) -> str:
    """Return what of a tolerance was not read."""
    if row["zone_mm"] is None:
        return "its zone could not be read"
    if row["unread"]:
        items = "1 item" if row["unread"] == 1 else f"{row['unread']} items"
        return f"{items} that it is attached to could not be read"
    if row["material"] and not (sizes and all(sizes)):
        return f"the model states no limits of size for ({row['material']}), so no bonus is used: this is stricter"
    if row["per_unit"]:
        return "it holds for each unit of length or area"
    return ""
