"""Geometric tolerances of a CAD model, what they are attached to, and why edges show them or do not.

Reference: ISO 1101 and ASME Y14.5 for the characteristics; ISO 2692 for material conditions.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from aspectgraph.dimensions.datum_frames import (
    DatumFrame,
    NotShownError,
    Seat,
    Shown,
    seats_of_hole,
    seats_of_slot,
)
from aspectgraph.dimensions.features import (
    Attachments,
    Axis,
    EntityId,
    Feature,
    ModelDimension,
    Plane,
    Sight,
    Way,
    describe_shape,
    unique_names,
)
from ground.notebook import NotebookTable, NotebookView, ShownInNotebook, Toned
from ground.short_repr import count

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

_NO_CYLINDER = "the file states no cylindrical zone"
_NO_SLOT = "the two faces of one slot or tab are measured"

_TO_SIZE = {"diameter": 1.0, "radius": 2.0, "distance": 1.0}
"""Kinds of sizes, and what makes them diameters or widths."""


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
        With a material condition, for each feature the limits of its size that the model states. They are deviations
        from the size of the geometry, mm. None where the model states none.
    measured_as : str
        Kind of the dimension that measures it: "position", "width_position" (of a slot or tab), "symmetry" or
        "coaxiality"; empty if none does.
    groups : tuple of int
        Number of entities of each datum among `entities`, if one has two or there is a pattern, whose other rims
        follow.

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
    measured_as: str = ""
    groups: tuple[int, ...] = ()

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
        for key in ("datums", "attached", "feature_reasons", "groups"):
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
class ModelRequirements(ShownInNotebook):
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
    <ModelRequirements: 12 dimensions, 6 geometric tolerances, 14 measurable>
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
        dimensions = count(len(self.dimensions), "dimension")
        tolerances = count(len(self.tolerances), "geometric tolerance")
        return f"<ModelRequirements: {dimensions}, {tolerances}, {self.n_measurable} measurable>"

    def _notebook_view(self) -> NotebookView:
        rows = []
        for requirement in self:
            shown: str | Toned = Toned(requirement.reason or "", "open")
            if requirement.entities is not None:
                shown = ", ".join(map(entity_text, requirement.entities))
            kind = requirement.kind.replace("_", " ")
            rows.append((requirement.name, f"{kind} {_required_text(requirement)}", shown))
        headings = ("requirement", "value", "entities, or why none")
        title = f"{count(len(self), 'requirement')}, {self.n_measurable} measurable"
        return NotebookView(title, self.disagreements, NotebookTable(headings, rows))

    @property
    def n_measurable(self) -> int:
        """Number of requirements that edges show."""
        return sum(requirement.entities is not None for requirement in self)


def entity_text(entity: EntityId) -> str:
    """Return the id of an entity as plans and pages print it, such as ``"e12"`` or ``"r3"``."""
    if isinstance(entity, str):
        return entity
    return f"e{entity}"


def _required_text(requirement: ModelDimension | GeometricTolerance) -> str:
    """Return what a model requires, with its unit."""
    if isinstance(requirement, GeometricTolerance):
        return requirement.frame
    texts = []
    if requirement.nominal is not None:
        texts.append(f"{requirement.nominal:.6g} {requirement.unit}")
    if requirement.tolerance_class is not None:
        texts.append(requirement.tolerance_class)
    if requirement.tolerance is not None:
        lower, upper = requirement.tolerance
        limits = (f"{limit:+g}" if limit else "0" for limit in (upper, lower))
        texts.append(f"±{upper:g}" if lower == -upper else "/".join(limits))
    return " ".join(texts)


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
    of_datums: dict[str, Sequence[Feature] | None] = {}
    for letter, shapes in datums.items():
        has_targets = any(shape["kind"] == "target" for shape in shapes)
        of_datums[letter] = None if has_targets else attachments.features(shapes)
    titles = [row["name"] or f"{row['characteristic']} {k}" for k, row in enumerate(rows, 1)]
    tolerances = []
    for row, name in zip(rows, unique_names(titles), strict=True):
        features = attachments.features(row["shapes"])
        reason = _reason(row, features)
        measured = _Measured("", (), ())
        if reason is None:
            frame = DatumFrame(sight, row["datums"], of_datums)
            measured = _measured(row["characteristic"], features, frame)
            if measured.kind == "":
                reason = measured.reasons[0]
        sizes: tuple[tuple[float, float] | None, ...] = ()
        if reason is None and row["material"]:
            sizes = tuple(
                _size_of([shown.way for shown in choices], measured.n_first, dimensions)
                for choices in measured.features
            )
        ways = [tuple(shown.way for shown in choices) for choices in measured.features]
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
                max(1, len(measured.features) or len(features)),
                reason,
                next((choices[0] for choices in ways if choices), None),
                tuple(ways) if reason is None else (),
                measured.reasons if reason is None else (),
                _note(row, sizes),
                sizes,
                measured.kind,
                measured.groups,
            )
        )
    return tuple(tolerances)


@dataclass(frozen=True)
class _Measured:
    """How a position, symmetry or coaxiality is measured.

    Attributes
    ----------
    kind : str
        Kind of the dimension; empty if no feature is measured.
    features : tuple of tuple of Shown
        For each feature what measures it, best first.
    reasons : tuple of str or None
        For each feature why it is not measured.
    groups : tuple of int
        Number of entities of each datum, if they are not one each.
    """

    kind: str
    features: tuple[tuple[Shown, ...], ...]
    reasons: tuple[str | None, ...]
    groups: tuple[int, ...] = ()

    @property
    def n_first(self) -> int:
        """Number of entities that have the place."""
        return 2 if self.kind in ("width_position", "symmetry") else 1


def _measured(characteristic: str, features: Sequence[Feature], frame: DatumFrame) -> _Measured:
    """Return how the place of holes and pins, or of a slot, is measured."""
    holes: list[Axis] = []
    planes: list[Plane] = []
    for feature in features:
        if isinstance(feature, Axis):
            holes.append(feature)
        elif isinstance(feature, Plane):
            planes.append(feature)
    choices: list[tuple[Shown, ...]] = []
    reasons: list[str | None] = []
    items: Sequence[Axis | list[Plane]] = holes or [planes]
    for item in items:
        try:
            others: list[Axis] = []
            if isinstance(item, Axis):
                seats = seats_of_hole(frame.sight, item)
                others = [hole for hole in holes if hole is not item]
            else:
                seats = seats_of_slot(frame.sight, item)
            choices.append(_shown(frame, seats, others))
            reasons.append(None)
        except NotShownError as error:
            choices.append(())
            reasons.append(f"{characteristic}: {error}")
    first = next((shown[0] for shown in choices if shown), None)
    if first is None:
        return _Measured("", (), tuple(reasons))
    kind = characteristic if characteristic in ("position", "symmetry") else "coaxiality"
    if planes:
        kind = "symmetry" if first.groups == (2,) and kind == "symmetry" else "width_position"
    # of a usual frame each datum has one entity
    is_usual = set(first.groups) == {1} and not first.n_pattern
    groups = () if is_usual or kind == "symmetry" else first.groups
    return _Measured(kind, tuple(choices), tuple(reasons), groups)


def _shown(frame: DatumFrame, seats: Sequence[Seat], others: Sequence[Axis]) -> tuple[Shown, ...]:
    """Return what measures a feature by each of its rims or pairs of edges that show its datums, too."""
    every = []
    faults = []
    for seat in seats:
        try:
            every.append(frame.show(seat, others))
        except NotShownError as error:
            faults.append(error)
    if not every:
        raise faults[0]
    return tuple(shown for shown in every if shown.groups == every[0].groups)


def _size_of(
    ways: Sequence[Way], n_first: int, dimensions: Sequence[ModelDimension]
) -> tuple[float, float] | None:
    """Return the limits of the size of a hole, pin or slot that a model states, from the value of its geometry."""
    rims = {frozenset(way[:n_first]) for way in ways}
    for dimension in dimensions:
        factor = _TO_SIZE.get(dimension.kind)
        if factor is None or dimension.tolerance is None:
            continue
        on_rims = any(frozenset(way) in rims for choices in dimension.features for way in choices)
        if on_rims and dimension.nominal is not None and dimension.geometry is not None:
            apart = dimension.nominal - dimension.geometry
            lower, upper = dimension.tolerance
            return factor * (apart + lower), factor * (apart + upper)
    return None


def _reason(row: dict[str, Any], features: Sequence[Feature]) -> str | None:
    """Return why edges do not show a tolerance; None of a position of holes or pins."""
    kind = row["characteristic"]
    if kind in _REASONS:
        return _REASONS[kind]
    around_axes = bool(features) and all(isinstance(feature, Axis) for feature in features)
    if kind in _ORIENTATIONS:
        if around_axes:
            return f"{kind} of an axis: needs both of its rims, and its datum face"
        return f"{kind} of a face: {_SURFACE}"
    if row["projected_mm"] is not None:
        return "projected zone: a rim does not show the axis outside the part"
    if not features:
        return f"{kind}: it is attached to no plane, edge or axis"
    if around_axes:
        if row["diametral"] and row["zone_mm"]:
            return None
        return f"{kind}: {_NO_CYLINDER}"
    if all(isinstance(feature, Plane) for feature in features) and row["zone_mm"]:
        if len(features) == 2:
            return None
        return f"{kind} of {len(features)} faces: {_NO_SLOT}"
    return f"{kind}: only holes, pins, slots and tabs have one that edges show"


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
