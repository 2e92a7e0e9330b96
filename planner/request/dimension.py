"""What a drawing asks for: a named quantity over one or more entities, with how wrong its measurement may be."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from difflib import get_close_matches
from typing import TYPE_CHECKING, Annotated, Any, TypedDict, Unpack

from ground.convert import Meta
from ground.short_repr import short_repr
from planner.argument_kinds import (
    ABOVE_0_TO_1,
    NOT_NEGATIVE,
    POSITIVE,
    NumberRule,
    check_accuracy,
    check_count,
    check_number,
    kind_shown,
    names_meant,
    show_keywords,
    shown,
    with_article,
)
from planner.exceptions import RequestError
from planner.request.edge_state import checked_break

if TYPE_CHECKING:
    from aspectgraph import Solid
    from aspectgraph.solid.rims import Arc


# Tolerance classes of ISO 286 in a request: checked where they are given, and resolved on the
# part.


def checked_class(text: str, kind: str, name: str = "tolerance") -> str:
    """Return a tolerance class as ISO 286 writes it.

    Parameters
    ----------
    text : str
        Such as "H7".
    kind : str
        Kind of its dimension.
    name : str
        What an error calls it.

    Raises
    ------
    RequestError
        If it is no class, or a dimension of this kind has none.
    """
    from aspectgraph import ToleranceError
    from aspectgraph.dimensions.tolerances import KINDS_WITH_CLASS, ToleranceClass

    try:
        class_text = str(ToleranceClass.of(text))
    except ToleranceError as error:
        half = _half_of(text)
        if half is None:
            raise RequestError.of_rule(name, error.rule, error.got, hint=error.hint) from None
        rule = "must be two numbers, lower and upper deviation, or a class such as H7"
        hint = f"write [-{half:g}, {half:g}] without quotes"
        raise RequestError.of_rule(name, rule, error.got, hint=hint) from None
    if kind not in KINDS_WITH_CLASS:
        raise RequestError.of_rule(
            "tolerance",
            f"must be two numbers, because only a {', '.join(KINDS_WITH_CLASS[:-1])} or {KINDS_WITH_CLASS[-1]} "
            "has a tolerance class",
            f"{class_text!r} for {_words_of(kind)}",
        )
    return class_text


def _entities_of(items: Iterable[Target]) -> tuple[Target, ...]:
    """Return the entities of a witness, edges by their numbers: "e17" is 17."""
    from aspectgraph.entities.entity import edge_number

    return tuple(map(edge_number, items))


def _words_of(kind: str) -> str:
    """Return what a sentence calls a kind."""
    return with_article(kind.replace("_", " "))


def _check_kind(kind: object) -> None:
    """Refuse what is no kind of dimension."""
    from errors.measurands.measurand import kinds

    if not isinstance(kind, str) or kind not in kinds():
        raise RequestError.of_rule("kind", f"must be one of {', '.join(kinds())}", shown(kind))


def _half_of(text: str) -> float | None:
    """Return half of a symmetric tolerance that is written as on a drawing, such as ±0.1; None of all else."""
    match = re.fullmatch(r"(?:±|\+/?-|\+-)? ?(\d*[.,]?\d+)(?: ?mm)?", text.strip())
    return None if match is None else float(match[1].replace(",", "."))


def class_limits(tolerance_class: str, nominal_mm: float) -> tuple[float, float]:
    """Return the limit deviations of a tolerance class that was checked, mm.

    Parameters
    ----------
    tolerance_class : str
        Such as "H7".
    nominal_mm : float
        Nominal size.

    Raises
    ------
    RequestError
        If ISO 286 has no limits of this class for the nominal size.
    """
    from aspectgraph import ToleranceError, tolerance_class_deviations

    try:
        return tolerance_class_deviations(tolerance_class, nominal_mm)
    except ToleranceError as error:
        raise RequestError.of_rule("tolerance", error.rule, error.got, hint=error.hint) from None


def check_side(tolerance_class: str, solid: Solid, arcs: Sequence[Arc]) -> None:
    """Refuse the class of a shaft for the rim of a hole, and that of a hole for the rim of a shaft.

    Parameters
    ----------
    tolerance_class : str
        Such as "H7"; capitals are for holes.
    solid : Solid
        The part.
    arcs : sequence of Rim or Arc
        What is measured. A circle that is neither is not checked.

    Raises
    ------
    RequestError
        If they contradict each other.
    """
    from aspectgraph.dimensions.tolerances import is_in_hole

    for_hole = tolerance_class.isupper()
    for arc in arcs:
        in_hole = is_in_hole(solid, arc)
        if in_hole is not None and in_hole != for_hole:
            rule = "holes, in capitals" if in_hole else "shafts, in small letters"
            side = "a hole" if in_hole else "a shaft"
            raise RequestError.of_rule(
                "tolerance",
                f"must be a class of {rule}, because {arc.id} is the rim of {side}",
                repr(tolerance_class),
            )


POSITION = "position"
"""The kind of a dimension that is the position of a rim."""

WIDTH_POSITION = "width_position"
"""That of a slot or tab, by its two edges."""

POSITIONS = (POSITION, WIDTH_POSITION, "symmetry", "coaxiality")
"""Kinds whose value is twice a deviation from a true place, so that the nominal value is 0."""

_WIDTHS = (WIDTH_POSITION, "symmetry")


@dataclass(frozen=True)
class MaterialCondition:
    """The limit of size from which a material condition widens the zone of a position (ISO 2692).

    Attributes
    ----------
    condition : str
        "M" for the maximum material condition, "L" for the least one.
    limit_mm : float
        Diameter of the hole or pin at this condition, mm.
    is_hole : bool
        Whether it is a hole.
    """

    condition: Annotated[str, Meta(pattern="^[ML]$", title="must be M or L")]
    limit_mm: Annotated[float, Meta(gt=0, title="must be positive and finite")]
    is_hole: bool

    @classmethod
    def of(
        cls, condition: str, deviations: tuple[float, float], nominal_mm: float, is_hole: bool
    ) -> MaterialCondition:
        """Return the condition of a size with its deviations.

        Parameters
        ----------
        condition : str
            "M" or "L".
        deviations : (float, float)
            Lower and upper deviation of the diameter, mm.
        nominal_mm : float
            Its nominal value.
        is_hole : bool
            Whether it is a hole.

        Raises
        ------
        RequestError
            The size has no limit at this condition.
        """
        lower, upper = deviations
        limit = lower if is_hole == (condition == "M") else upper
        if not math.isfinite(limit):
            side = "lower" if limit < 0 else "upper"
            raise RequestError.of_rule(
                "size", f"must have a {side} limit for ({condition})", f"[{lower:g}, {upper:g}]"
            )
        return cls(condition, nominal_mm + limit, is_hole)

    @property
    def has_lower_limit(self) -> bool:
        """Whether the zone grows with the size."""
        return self.is_hole == (self.condition == "M")

    def surplus_mm(self, size_mm: float) -> float:
        """Return by how much a size has left its limit; negative beyond it.

        Parameters
        ----------
        size_mm : float
            A diameter, mm.
        """
        apart = size_mm - self.limit_mm
        return apart if self.has_lower_limit else -apart

    def deviations(self, nominal_mm: float) -> tuple[float, float]:
        """Return deviations of a size that have this limit, as `Dimension` takes them.

        Parameters
        ----------
        nominal_mm : float
            The nominal diameter.
        """
        limit = self.limit_mm - nominal_mm
        return (limit, math.inf) if self.has_lower_limit else (-math.inf, limit)


MATERIAL_CONDITIONS = ("M", "L")
"""Conditions that widen a zone: maximum and least material."""

QUARTER = 0.25
"""Share of a tolerance's half width that a measurement error may take: the usual 4 : 1 test uncertainty ratio."""

_POSITIVE = NumberRule("must be a positive number", POSITIVE.holds)

MOST_PLACES = 100
"""Places along an edge at most."""

_REQUIREMENTS = ("tolerance", "tolerance_class", "max_error", "accuracy")

Target = Any
"""What stands for an entity: an id (17 or "e17", "r3", "a0"), an `Edge`, `Rim` or `Entity`, or two end points in mm."""


# The keywords of the constructors: what `Dimension` has, where deviations and errors have their unit in the name.


class Requirement(TypedDict, total=False):
    """What every constructor of a `Dimension` takes."""

    accuracy: float | None
    share: float
    direction: Sequence[float] | None
    tolerance_class: str | None
    surfaces_mm: float | None
    places: int
    material: str
    size: Sequence[float | None] | str | None
    frame: tuple[str, ...]


class RequirementInMm(Requirement, total=False):
    """What a constructor of a length takes; a text of ``tolerance`` is a class, such as "H7"."""

    tolerance_mm: Sequence[float | None] | None
    max_error_mm: float | None
    tolerance: str


class RequirementInDeg(Requirement, total=False):
    """What the constructor of an angle takes."""

    tolerance_deg: Sequence[float | None] | None
    max_error_deg: float | None


@names_meant
@dataclass(frozen=True)
class Dimension:
    """A quantity to measure in one image, with the permitted error.

    Give at most one of ``tolerance``, ``tolerance_class``, ``max_error`` and ``accuracy``. Without
    any, the accuracy of the call applies. A tolerance with one limit has no width, so it states no
    permitted error: ``max_error`` or ``accuracy`` may be stated besides.

    Parameters
    ----------
    kind : str
        "length", "distance", "angle", "diameter", "radius", "centre_distance", "centre_to_edge",
        "position", "width_position", "symmetry" or "coaxiality", or another kind registered with
        `errors.measurands`.
    entities : tuple
        Entities that must be visible: ids (``17``, ``"r3"``, ``"a0"``), `Edge`, `Rim` or `Entity`
        objects, or two end points in mm.
    tolerance : (float, float), optional
        Lower and upper deviation from the nominal value that the drawing allows, mm (angles: degrees).
        None or an infinite one is no limit; one of both must be finite. A text is a tolerance class.
    max_error : float, optional
        Largest permitted error of the measurement, mm (angles: degrees).
    accuracy : float, optional
        A in (0, 1). The permitted error is the fraction 1 − A of the nominal value, as in the
        paper.
    share : float
        Permitted error as a share of half the tolerance's width.
    direction : (float, float, float), optional
        Direction of a distance in the part's frame. Default: across the two lines.
    n_features : int
        Number of features that the dimension stands for, such as the holes of a pattern. The
        entities measure one of them. Plans and reports count the others as not planned. To measure
        all of them, see `dimensions_to_plan`.
    alternatives : tuple of tuple
        Other sets of entities that give the same value, such as the lower rim of a through hole. A
        setting measures the dimension by any one set. See `any_of`.
    tolerance_class : str, optional
        A class of ISO 286 instead of the tolerance, such as ``"H7"`` for a hole or ``"g6"`` for a
        shaft. Its limits are those of the nominal value. Only a diameter, a distance or a length
        can have one.
    surfaces_mm : float, optional
        Standard deviation of the position of its faces along their normals, mm. Default: that of
        the call.
    surfaces_from : str
        The tolerance of the model that `surfaces_mm` follows from. A value of the call replaces
        it. Empty if you state it.
    places : int
        Number of positions along two edges at which a distance is measured, 100 at most. Each is a
        characteristic of its own, such as ``"width [2 of 3 places]"``, on its own stretches. They
        divide the length over which the edges face each other into equal parts.
    edge_break_mm : (float, float), optional
        By how much its edges are broken along their faces, least and most, mm. Default: what the
        call states of the whole part.
    material : str
        ``"M"`` or ``"L"`` if the maximum or least material condition widens the zone of a position.
        It needs ``size``.
    size : (float, float), optional
        Lower and upper deviation of the diameter of the hole or pin, mm, or a class such as
        ``"H7"``. The diameter is measured with the position, on the same rim.
    groups : tuple of int
        Of a position, the number of entities of each datum: 2 of a slot, those of a pattern of holes,
        otherwise 1. Entities after these are the other rims of its own pattern, (0,) without a datum.
        Empty if each datum has one, and there is no pattern.
    frame : tuple of str
        Names of the datums of a position in the drawing, in their order, with those that are parallel
        to the plane of its rim. Reports show them. Empty: reports name the entities.

    Raises
    ------
    RequestError
        If a value breaks its rule.

    Examples
    --------
    >>> from planner import Dimension
    >>> Dimension.diameter("r3", tolerance_mm=(-0.05, 0.05)).permitted_error(12.0)
    0.0125
    >>> Dimension.diameter("r3", tolerance="H7").with_limits(20.0).tolerance
    (0.0, 0.021)
    >>> Dimension.distance(17, 18, tolerance_mm=(None, 0.1), max_error_mm=0.02).tolerance
    (-inf, 0.1)
    """

    kind: str
    entities: tuple[Target, ...]
    tolerance: tuple[float, float] | None = None
    max_error: float | None = None
    accuracy: float | None = None
    share: float = QUARTER
    direction: tuple[float, float, float] | None = None
    n_features: int = 1
    alternatives: tuple[tuple[Target, ...], ...] = ()
    tolerance_class: str | None = None
    surfaces_mm: float | None = None
    surfaces_from: str = ""
    places: int = 1
    edge_break_mm: tuple[float, float] | None = None
    material: str = ""
    size: tuple[float, float] | str | None = None
    groups: tuple[int, ...] = ()
    frame: tuple[str, ...] = ()

    __repr__ = short_repr

    def __post_init__(self) -> None:
        _check_kind(self.kind)
        object.__setattr__(self, "entities", _entities_of(self.entities))
        object.__setattr__(self, "alternatives", tuple(map(_entities_of, self.alternatives)))
        object.__setattr__(self, "frame", tuple(map(str, self.frame)))
        self._check_requirements()
        if self.tolerance_class is not None:
            object.__setattr__(
                self, "tolerance_class", checked_class(self.tolerance_class, self.kind)
            )
        if self.max_error is not None:
            check_number("max_error", self.max_error, _POSITIVE)
        if self.accuracy is not None:
            check_accuracy(self.accuracy)
        check_number("share", self.share, ABOVE_0_TO_1)
        if self.direction is not None:
            object.__setattr__(self, "direction", _checked_direction(self.direction))
        if self.surfaces_mm is not None:
            check_number("surfaces_mm", self.surfaces_mm, NOT_NEGATIVE)
        if self.edge_break_mm is not None:
            object.__setattr__(self, "edge_break_mm", checked_break(self.edge_break_mm))
        self._check_material()
        whole = isinstance(self.n_features, int) and not isinstance(self.n_features, bool)
        if not (whole and self.n_features >= 1):
            raise RequestError.of_rule(
                "n_features", "must be a whole number, 1 or more", repr(self.n_features)
            )
        check_count("places", self.places, 1, MOST_PLACES)
        if self.places > 1 and (self.kind != "distance" or len(self.entities) != 2):
            raise RequestError.of_rule(
                "places",
                "must be 1 unless it is a distance of two edges",
                f"{self.places} for {_words_of(self.kind)}",
            )

    def _check_material(self) -> None:
        """Check the material condition of a position, and the limits of its size."""
        if not self.material and self.size is None:
            return
        if self.kind not in POSITIONS:
            got = f"{self.material or self.size!r} for {_words_of(self.kind)}"
            raise RequestError.of_rule("material and size", "must be those of a position", got)
        if self.material not in MATERIAL_CONDITIONS:
            raise RequestError.of_rule(
                "material", "must be M or L where a size is stated", repr(self.material)
            )
        if self.size is None:
            rule = "must be stated with a material condition: its two deviations, or a class"
            raise RequestError.of_rule("size", rule, "none")
        if isinstance(self.size, str):
            try:
                size_class = checked_class(self.size, "diameter")
            except RequestError:
                rule = "must be two deviations, a class such as H7, or in a file the name of a diameter or width"
                raise RequestError.of_rule("size", rule, repr(self.size)) from None
            object.__setattr__(self, "size", size_class)
            return
        try:
            object.__setattr__(self, "size", checked_tolerance(self.size))
        except RequestError as error:
            raise RequestError(str(error).replace("tolerance", "size", 1)) from error

    def _check_requirements(self) -> None:
        """Check that one thing is asked; a text of a tolerance is a class, and None in it an infinite limit."""
        tolerance: Any = self.tolerance
        if isinstance(tolerance, str):
            object.__setattr__(self, "tolerance", None)
            if self.tolerance_class is None:
                object.__setattr__(self, "tolerance_class", tolerance)
        elif tolerance is not None:
            object.__setattr__(self, "tolerance", checked_tolerance(tolerance))
        stated = [name for name in _REQUIREMENTS if getattr(self, name) is not None]
        if self.tolerance is not None and is_one_sided(self.tolerance):
            stated.remove("tolerance")
        if isinstance(tolerance, str) and self.tolerance_class != tolerance:
            stated.insert(0, "tolerance")
        if len(stated) > 1:
            raise RequestError(
                f"a dimension must have one of tolerance, max_error and accuracy. Got {', '.join(stated)}."
            )

    @classmethod
    def length(cls, edge: Target, **requirement: Unpack[RequirementInMm]) -> Dimension:
        """Return the length of an edge, as in the paper.

        Parameters
        ----------
        edge : int, str, Edge, Entity or end points
            The edge.
        **requirement
            ``tolerance_mm`` (lower, upper), ``tolerance`` (a class, ``"H7"``),
            ``max_error_mm`` or ``accuracy``; and ``share``, see `Dimension`.

        Returns
        -------
        Dimension
            The new dimension.
        """
        return cls("length", (edge,), **_in_mm(requirement))

    @classmethod
    def distance(
        cls, first: Target, second: Target, **requirement: Unpack[RequirementInMm]
    ) -> Dimension:
        """Return the distance of two parallel edges.

        Parameters
        ----------
        first, second : int, str, Edge, Entity or end points
            The edges.
        **requirement
            ``tolerance_mm`` (lower, upper), ``tolerance`` (a class, ``"H7"``),
            ``max_error_mm`` or ``accuracy``; ``share``, ``direction``, ``places``: `Dimension`.

        Returns
        -------
        Dimension
            The new dimension.
        """
        return cls("distance", (first, second), **_in_mm(requirement))

    @classmethod
    def angle(
        cls, first: Target, second: Target, **requirement: Unpack[RequirementInDeg]
    ) -> Dimension:
        """Return the angle of two edges.

        Parameters
        ----------
        first, second : int, str, Edge, Entity or end points
            The edges.
        **requirement
            ``tolerance_deg`` (lower, upper), ``max_error_deg`` or ``accuracy``; and ``share``, see `Dimension`.

        Returns
        -------
        Dimension
            The new dimension.
        """
        return cls("angle", (first, second), **_renamed(requirement, "deg"))

    @classmethod
    def diameter(cls, rim: Target, **requirement: Unpack[RequirementInMm]) -> Dimension:
        """Return the diameter of a rim or arc.

        Parameters
        ----------
        rim : str, Rim, Arc or Entity
            The rim or arc.
        **requirement
            ``tolerance_mm`` (lower, upper), ``tolerance`` (a class, ``"H7"``),
            ``max_error_mm`` or ``accuracy``; and ``share``, see `Dimension`.

        Returns
        -------
        Dimension
            The new dimension.

        Raises
        ------
        RequestError
            If a value breaks its rule.
        """
        return cls("diameter", (rim,), **_in_mm(requirement))

    @classmethod
    def radius(cls, rim: Target, **requirement: Unpack[RequirementInMm]) -> Dimension:
        """Return the radius of a rim or arc.

        Parameters
        ----------
        rim : str, Rim, Arc or Entity
            The rim or arc.
        **requirement
            ``tolerance_mm`` (lower, upper), ``max_error_mm`` or ``accuracy``; and ``share``, see `Dimension`.

        Returns
        -------
        Dimension
            The new dimension.
        """
        return cls("radius", (rim,), **_in_mm(requirement))

    @classmethod
    def centre_distance(
        cls, first: Target, second: Target, **requirement: Unpack[RequirementInMm]
    ) -> Dimension:
        """Return the distance of the centres of two rims or arcs.

        Parameters
        ----------
        first, second : str, Rim, Arc or Entity
            The rims or arcs.
        **requirement
            ``tolerance_mm`` (lower, upper), ``max_error_mm`` or ``accuracy``; ``share``, ``direction``: `Dimension`.

        Returns
        -------
        Dimension
            The new dimension.
        """
        return cls("centre_distance", (first, second), **_in_mm(requirement))

    @classmethod
    def centre_to_edge(
        cls, rim: Target, edge: Target, **requirement: Unpack[RequirementInMm]
    ) -> Dimension:
        """Return the distance from a rim's centre to the line of an edge.

        Parameters
        ----------
        rim : str, Rim, Arc or Entity
            The rim or arc.
        edge : int, str, Edge, Entity or end points
            The edge.
        **requirement
            ``tolerance_mm`` (lower, upper), ``max_error_mm`` or ``accuracy``; and ``share``, see `Dimension`.

        Returns
        -------
        Dimension
            The new dimension.
        """
        return cls("centre_to_edge", (rim, edge), **_in_mm(requirement))

    @classmethod
    def position(
        cls,
        rim: Target,
        datums: Sequence[Target],
        zone_mm: float,
        *,
        pattern: Sequence[Target] = (),
        **requirement: Unpack[RequirementInMm],
    ) -> Dimension:
        """Return the position of a hole, pin or slot against datums, in the plane of its rim.

        Parameters
        ----------
        rim : Target
            The rim, or its id (``"r3"``). Of a slot or tab, a list of its two edges.
        datums : sequence of Target
            Entities that show the datums, in the order of the drawing. An edge shows a plane across, a rim a hole or
            pin. A list of two edges is a slot or tab, a list of rims a pattern of holes, fitted by least squares.
            Leave out a datum that is parallel to the plane of the rim.
        zone_mm : float
            Diameter of the zone, mm; of a slot its width.
        pattern : sequence of Target
            The other rims of a pattern, all in one image. What the datums leave free is fitted to all rims.
        **requirement
            As for `Dimension`: ``share``, ``surfaces_mm``, or ``material`` with ``size``. The error
            of the position must stay in a disc, whose radius is the share of half of the zone.

        Returns
        -------
        Dimension
            The position 2‖e‖, where e is the deviation from the true position, from 0 to the zone.

        Raises
        ------
        RequestError
            If the zone or a requirement breaks its rule.

        Examples
        --------
        >>> from planner import Dimension
        >>> bolt = Dimension.position("r3", [17, 18], 0.2)
        >>> bolt.entities, bolt.tolerance, bolt.permitted_error(0.0)
        (('r3', 17, 18), (0.0, 0.2), 0.05)
        """
        kind = WIDTH_POSITION if _is_pair(rim) else POSITION
        return cls._placed(kind, rim, datums, zone_mm, pattern, requirement)

    @classmethod
    def symmetry(
        cls,
        edges: Sequence[Target],
        datum: Sequence[Target],
        zone_mm: float,
        **requirement: Unpack[RequirementInMm],
    ) -> Dimension:
        """Return the symmetry of a slot or tab to another one.

        Parameters
        ----------
        edges : sequence of two Target
            The edges of the slot or tab, parallel, in one plane.
        datum : sequence of two Target
            Those of the slot or tab that is the datum.
        zone_mm : float
            Width of the zone, mm.
        **requirement
            As for `position`.

        Returns
        -------
        Dimension
            Twice the distance of the mid-lines, in the middle of the first one.

        Raises
        ------
        RequestError
            If the zone or a requirement breaks its rule.

        Examples
        --------
        >>> from planner import Dimension
        >>> Dimension.symmetry([17, 18], [3, 4], 0.1).entities
        (17, 18, 3, 4)
        """
        if not _is_pair(edges) or not _is_pair(datum):
            rule = "must be two edges each"
            raise RequestError.of_rule("edges and datum", rule, f"{edges!r} and {datum!r}")
        return cls._placed("symmetry", edges, [datum], zone_mm, (), requirement)

    @classmethod
    def coaxiality(
        cls, rim: Target, datum: Target, zone_mm: float, **requirement: Unpack[RequirementInMm]
    ) -> Dimension:
        """Return the coaxiality of two circles in parallel planes, in the plane of the first one.

        Parameters
        ----------
        rim, datum : Target
            The rims. Concentricity of circles is the same value.
        zone_mm : float
            Diameter of the zone, mm.
        **requirement
            As for `position`.

        Returns
        -------
        Dimension
            Twice the distance of the axes. It is measured in the planes of the rims, and does not show how the axes
            lean.

        Raises
        ------
        RequestError
            If the zone or a requirement breaks its rule.

        Examples
        --------
        >>> from planner import Dimension
        >>> Dimension.coaxiality("r3", "r1", 0.1).permitted_error(0.0)
        0.025
        """
        return cls._placed("coaxiality", rim, [datum], zone_mm, (), requirement)

    @classmethod
    def _placed(
        cls,
        kind: str,
        first: Target,
        datums: Sequence[Target],
        zone_mm: float,
        pattern: Sequence[Target],
        requirement: RequirementInMm,
    ) -> Dimension:
        """Return what has a place in a frame of datums."""
        check_number("zone_mm", zone_mm, _POSITIVE)
        _check_entities("datums", datums)
        _check_entities("pattern", pattern)
        items = [first] if kind not in _WIDTHS else list(first)
        groups = tuple(len(datum) if _is_several(datum) else 1 for datum in datums)
        entities = list(items)
        for datum, n in zip(datums, groups, strict=True):
            entities += list(datum) if n > 1 or _is_several(datum) else [datum]
        entities += pattern
        if len(set(map(str, entities))) < len(entities):
            rule = "must differ from the rim and from each other"
            raise RequestError.of_rule("datums", rule, f"{list(datums)} for {first!r}")
        usual = not pattern and (set(groups) <= {1} or kind == "symmetry")
        return cls(
            kind,
            tuple(entities),
            tolerance=(0.0, float(zone_mm)),
            groups=() if usual else groups or (0,),
            **_in_mm(requirement),
        )

    @classmethod
    def any_of(cls, dimensions: Sequence[Dimension]) -> Dimension:
        """Return one dimension from several that give the same value by different entities.

        Parameters
        ----------
        dimensions : sequence of Dimension
            They differ only in their entities. The first is preferred where several serve equally.

        Returns
        -------
        Dimension
            The first, with the entities of the others as ``alternatives``.

        Raises
        ------
        RequestError
            If there is none, or two of them differ in more than their entities.

        Examples
        --------
        >>> from planner import Dimension
        >>> upper, lower = (Dimension.diameter(rim, tolerance_mm=(0, 0.1)) for rim in ("r3", "r7"))
        >>> Dimension.any_of([upper, lower]).witnesses
        (('r3',), ('r7',))
        """
        choices = tuple(dimensions)
        if not choices:
            raise RequestError.of_rule("any_of", "must hold at least one dimension", "none")
        first = choices[0]
        for other in choices[1:]:
            if replace(other, entities=first.entities, alternatives=first.alternatives) != first:
                raise RequestError.of_rule(
                    "any_of", "must hold dimensions that differ only in their entities", repr(other)
                )
        others = [way for choice in choices for way in choice.witnesses][1:]
        return replace(first, alternatives=tuple(others))

    @property
    def witnesses(self) -> tuple[tuple[Target, ...], ...]:
        """The sets of entities, each of which gives the value; ``entities`` first."""
        return (self.entities, *self.alternatives)

    def with_accuracy(self, accuracy: float) -> Dimension:
        """Return the dimension with an accuracy, where it has no requirement of its own.

        Parameters
        ----------
        accuracy : float
            A in (0, 1).

        Returns
        -------
        Dimension
            The same dimension, if it has a requirement.
        """
        two_sided = self.tolerance is not None and not is_one_sided(self.tolerance)
        if two_sided or any(getattr(self, name) is not None for name in _REQUIREMENTS[1:]):
            return self
        return replace(self, accuracy=accuracy)

    def with_limits(self, nominal: float) -> Dimension:
        """Return the dimension with the limits of its tolerance class as its tolerance.

        Parameters
        ----------
        nominal : float
            Nominal value, mm.

        Returns
        -------
        Dimension
            The same dimension, if it has no tolerance class.

        Raises
        ------
        RequestError
            If ISO 286 has no limits of this class for the nominal value.
        """
        if self.tolerance_class is None:
            return self
        limits = class_limits(self.tolerance_class, nominal)
        return replace(self, tolerance=limits, tolerance_class=None)

    def permitted_error(self, nominal: float, accuracy: float | None = None) -> float:
        """Return the largest permitted error of the measurement, in the unit of the nominal value.

        Parameters
        ----------
        nominal : float
            Nominal value, mm (angles: degrees), positive.
        accuracy : float, optional
            Accuracy where the dimension has no requirement of its own.

        Returns
        -------
        float
            Half the tolerance's width times the share; or the error given; or (1 − A) times the nominal value.

        Raises
        ------
        RequestError
            If there is no requirement, or the permitted error is not smaller than the nominal value.
        """
        dimension = self.with_accuracy(accuracy) if accuracy is not None else self
        dimension = dimension.with_limits(nominal)
        if dimension.tolerance is not None and not is_one_sided(dimension.tolerance):
            error = dimension.share * half_width(dimension.kind, dimension.tolerance)
        elif dimension.max_error is not None:
            error = float(dimension.max_error)
        elif dimension.accuracy is not None:
            return (1 - dimension.accuracy) * nominal
        else:
            got = "none" if self.tolerance is None else "a tolerance with one limit"
            rule = "needs a tolerance, max_error or accuracy"
            raise RequestError(f"a {self.kind} {rule}. Got {got}.")
        if error >= nominal and dimension.kind not in POSITIONS:
            raise RequestError(
                f"the permitted error of a {self.kind} must be smaller than its nominal value {nominal:.6g}. "
                f"Got {error:.6g}."
            )
        return error


def _show_requirements() -> None:
    """Let completion list what the constructors of a dimension take, with the defaults of its fields."""
    defaults = {item.name: item.default for item in fields(Dimension)}
    kinds: dict[Any, type] = {
        f"Unpack[{kind.__name__}]": kind for kind in (RequirementInMm, RequirementInDeg)
    }
    for maker in vars(Dimension).values():
        function = getattr(maker, "__func__", maker)
        kind = kinds.get(getattr(function, "__annotations__", {}).get("requirement"))
        if kind is not None:
            show_keywords(function, kind, defaults)


_show_requirements()


def _check_entities(name: str, entities: object) -> None:
    """Raise `RequestError` for one entity where a list of them is needed."""
    if isinstance(entities, str) or not hasattr(entities, "__len__"):
        hint = f"write [{entities!r}] for one" if isinstance(entities, str | int) else ""
        got = kind_shown(entities)
        raise RequestError.of_rule(name, "must be a list of entities", got, hint=hint)


def _is_several(target: Target) -> bool:
    """Return whether a target is several entities, and not the two end points of one edge."""
    if not isinstance(target, list | tuple) or not target:
        return False
    if len(target) != 2 or any(isinstance(end, str) for end in target):
        return True
    return not all(hasattr(end, "__len__") and len(end) == 3 for end in target)


def _is_pair(target: Target) -> bool:
    """Return whether a target is two entities, such as the edges of a slot, and not two end points."""
    return _is_several(target) and len(target) == 2


def zone_text(kind: str, zone_mm: float) -> str:
    """Return the zone of a position, such as ⌀0.2; of a slot its width."""
    return f"{'' if kind in _WIDTHS else '⌀'}{zone_mm:.6g}"


def _in_mm(requirement: RequirementInMm) -> dict[str, Any]:
    return _renamed(requirement, "mm")


def _renamed(requirement: Mapping[str, Any], unit: str) -> dict[str, Any]:
    """Take the unit off the names of what is asked; refuse names and units that are not known."""
    names = {f"tolerance_{unit}": "tolerance", f"max_error_{unit}": "max_error"}
    names |= {name: name for name in Requirement.__annotations__}
    if isinstance(requirement.get("tolerance"), str):
        # deviations have their unit in the name; a class has none
        names["tolerance"] = "tolerance_class"
    unknown = [name for name in requirement if name not in names]
    if unknown:
        words = list(names)
        if unit == "mm" and "tolerance" not in names:
            words.insert(1, "tolerance")
        if unknown[0] in words:
            rule = "must be a class such as 'H7'"
            hint = f"deviations are {unknown[0]}_{unit}"
            raise RequestError.of_rule(unknown[0], rule, shown(requirement[unknown[0]]), hint=hint)
        rule = f"a requirement of a dimension must be one of {', '.join(words)}"
        hint = _meant(unknown[0], unit, words)
        raise RequestError.of_rule("", rule, repr(unknown[0]), hint=hint)
    for name, value in requirement.items():
        # named as here, with the unit
        if name == f"tolerance_{unit}" and isinstance(value, str):
            # a diameter has every class
            checked_class(value, "diameter", name)
        elif name == f"tolerance_{unit}" and value is not None:
            checked_tolerance(value, name)
        if name == f"max_error_{unit}" and value is not None:
            check_number(name, value, _POSITIVE)
    return {names[name]: value for name, value in requirement.items()}


def _meant(name: str, unit: str, words: Sequence[str]) -> str:
    """Return a hint on the name of a requirement that is not known."""
    for stem in ("tolerance", "max_error"):
        if name.startswith(stem):
            return f"use {stem}_{unit}"
    starting = [word for word in words if word.startswith(name)]
    near = starting or get_close_matches(name, words)
    return f"did you mean {near[0]}?" if near else ""


def half_width(kind: str, tolerance: tuple[float, float]) -> float:
    """Return half of the width of a tolerance; of a position, which is twice a deviation, the whole zone."""
    width = tolerance[1] - tolerance[0]
    if kind in POSITIONS:
        return width
    return width / 2


def is_one_sided(tolerance: tuple[float, float]) -> bool:
    """Return whether a tolerance has only one limit: then it has no width."""
    return math.isinf(tolerance[0]) or math.isinf(tolerance[1])


def plain_tolerance(tolerance: tuple[float, float] | None) -> list[float | None] | None:
    """Return a tolerance for JSON: a limit that is not stated is null, as is a tolerance that is not."""
    if tolerance is None:
        return None
    return [limit if math.isfinite(limit) else None for limit in tolerance]


def checked_tolerance(
    given: Sequence[float | None], name: str = "tolerance"
) -> tuple[float, float]:
    """Return lower and upper deviation; None in their place is no limit, and an infinite deviation.

    Parameters
    ----------
    given : (lower, upper)
        The deviations.
    name : str
        What an error calls them.

    Raises
    ------
    RequestError
        If they are not two numbers in order, or no limit is left.
    """
    try:
        lower, upper = given
        lower = -math.inf if lower is None else float(lower)
        upper = math.inf if upper is None else float(upper)
    except (OverflowError, TypeError, ValueError) as error:
        rule = "must be two numbers, lower and upper deviation, or a class such as H7"
        hint = ""
        if isinstance(given, int | float) and math.isfinite(given) and given:
            hint = f"write [-{abs(given):g}, {abs(given):g}] for ±{abs(given):g}"
        raise RequestError.of_rule(name, rule, repr(given), hint=hint) from error
    is_limited = math.isfinite(lower) or math.isfinite(upper)
    if not is_limited or math.isnan(lower + upper) or lower == math.inf or upper == -math.inf:
        rule = "must have a finite limit, and -inf or inf only where there is none"
        raise RequestError.of_rule(name, rule, repr(given))
    if lower >= upper:
        raise RequestError.of_rule(
            name,
            "must have its lower deviation below its upper one",
            f"[{lower:g}, {upper:g}]",
        )
    return lower, upper


def _checked_direction(given: Sequence[float]) -> tuple[float, float, float]:
    try:
        values = tuple(float(value) for value in given)
    except (OverflowError, TypeError, ValueError) as error:
        raise RequestError.of_rule("direction", "must be three numbers", repr(given)) from error
    size = math.hypot(*values)
    if len(values) != 3 or not (math.isfinite(size) and size > 0):
        raise RequestError.of_rule(
            "direction", "must be three numbers, not all of them 0", repr(given)
        )
    return values[0] / size, values[1] / size, values[2] / size
