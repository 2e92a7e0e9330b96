"""Geometric tolerances of a CAD model, what they are attached to, and why edges show them or do not.

Reference: ISO 1101 and ASME Y14.5 for the characteristics; ISO 2692 for material conditions.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from aspectgraph.dimensions.features import (
    Attachments,
    Axis,
    Feature,
    ModelDimension,
    Plane,
    describe_shape,
    unique_names,
)

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

_NO_FRAME = "measuring against a datum reference frame is not available"


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
    reason : str
        Why edges do not show it.
    note : str
        Sentence on what could not be read; empty if there is none.

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
    reason: str
    note: str = ""

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
            The attributes in their order, then ``entities``, which is null, and ``unit``.
        """
        values = asdict(self)
        for key in ("datums", "attached"):
            values[key] = list(values[key])
        return {**values, "entities": None, "unit": "mm"}

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
        return sum(dimension.entities is not None for dimension in self.dimensions)


def list_tolerances(
    attachments: Attachments, rows: Sequence[dict[str, Any]]
) -> tuple[GeometricTolerance, ...]:
    """Return the geometric tolerances of a file in its order.

    Parameters
    ----------
    attachments : Attachments
        Finds the features of shapes.
    rows : sequence of dict
        See `semantic_dimensions.describe_tolerances`.
    """
    titles = [row["name"] or f"{row['characteristic']} {k}" for k, row in enumerate(rows, 1)]
    tolerances = []
    for row, name in zip(rows, unique_names(titles), strict=True):
        features = attachments.features(row["shapes"])
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
                _reason(row, features),
                _note(row),
            )
        )
    return tuple(tolerances)


def _reason(row: dict[str, Any], features: Sequence[Feature]) -> str:
    """Return why edges do not show a tolerance."""
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
    if any(isinstance(feature, Plane) for feature in features) and len(features) != 2:
        return f"{kind} of faces: {_SURFACE}"
    return f"{kind}: {_NO_FRAME}"


def _note(row: dict[str, Any]) -> str:
    """Return what of a tolerance was not read."""
    if row["zone_mm"] is None:
        return "its zone could not be read"
    if row["unread"]:
        items = "1 item" if row["unread"] == 1 else f"{row['unread']} items"
        return f"{items} that it is attached to could not be read"
    if row["per_unit"]:
        return "it holds for each unit of length or area"
    return ""
