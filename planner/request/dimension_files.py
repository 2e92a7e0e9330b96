"""Dimensions and entities as a file of the command line holds them, or as they are picked in a notebook."""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from aspectgraph.dimensions.features import unique_names
from aspectgraph.dimensions.geometric import GeometricTolerance
from aspectgraph.entities.entity import edge_number
from aspectgraph.entities.entity_rules import parse_names
from aspectgraph.exceptions import MissingExtraError, how_to_install
from errors.checks import check_not_negative
from errors.exceptions import InvalidParameterError
from errors.measurands.geometry import DETECTOR_FLOOR_PX, FLOOR_PX, Localisation
from planner.argument_kinds import (
    POSITIVE,
    check_kinds,
    check_number,
    kind_shown,
    shown,
    suggests_names,
    with_article,
)
from planner.exceptions import RequestError
from planner.request.dimension import POSITION, POSITIONS, QUARTER, Dimension
from planner.request.words import LeftOut, characteristic_name, tolerance_text

if TYPE_CHECKING:
    from aspectgraph import ModelDimension, Solid
    from aspectgraph.dimensions.features import SurfaceZone, Way


# What is assumed of points in the image and of the part's faces where a request does not say it.


SURFACES_MM = 0.02
"""Standard deviation of a face's position along its normal, mm, where it is not given.

A place within a zone of 0.07 mm has it, if all of the zone is equally likely: 0.07 / sqrt(12). That is between the
tolerance grades IT8 (0.054 mm) and IT9 (0.087 mm) of sizes of 80 to 120 mm (ISO 286-1), which milling holds.
"""


def surfaces_of_zone(zone: SurfaceZone | None) -> tuple[float | None, str]:
    """Return how far a face is off its place by a tolerance of the model, and that tolerance in words.

    Every place in a zone of width t is taken as equally likely: t / sqrt(12), the standard deviation where only limits
    are known (JCGM 100:2008, 4.3.7). A zone that does not say where the face is makes nothing better than the default.

    Parameters
    ----------
    zone : SurfaceZone or None
        The zone; None if the model states none.

    Returns
    -------
    (float or None, str)
        One standard deviation, mm, and such as "profile 0.1 mm". None and an empty text without a zone.
    """
    if zone is None:
        return None, ""
    sigma = zone.width_mm / math.sqrt(12.0)
    return (
        sigma if zone.places else max(sigma, SURFACES_MM),
        f"{zone.tolerance} {zone.width_mm:.4g} mm",
    )


def with_surfaces_of_call(
    items: Mapping[str, Any], surfaces_mm: float | None, localisation: Localisation
) -> dict[str, Any]:
    """Return what is wanted without the positions of faces that follow from the model, if those of the call apply.

    Parameters
    ----------
    items : mapping of str to value
        What is wanted, by name.
    surfaces_mm : float or None
        Position of the faces, as it was given. If it was, it takes the place of the model's.
    localisation : Localisation
        With whole pixels, faces are where the model has them, if nothing was given.
    """
    if surfaces_mm is None and localisation.model != "rounding":
        return dict(items)
    return {
        name: replace(item, surfaces_mm=None, surfaces_from="")
        if isinstance(item, Dimension) and item.surfaces_from
        else item
        for name, item in items.items()
    }


def localisation_or_default(
    localisation: Localisation | None, items: Iterable[Any], edges: object = None
) -> Localisation:
    """Return how well points are found.

    Parameters
    ----------
    localisation : Localisation or None
        As it was given.
    items : iterable
        What is wanted. Without a `Dimension`, values of edges, rims and arcs are measured as in the paper.
    edges : object
        By how much edges are broken. If it is stated, it is an error of its own, and the floor that of the detector.

    Returns
    -------
    Localisation
        By default that of sub-pixel work for dimensions and where breaks of edges are stated, otherwise whole pixels.

    Raises
    ------
    RequestError
        If breaks of edges are stated, but only lengths on whole pixels are wanted: that model has no breaks.
    """
    has_dimension = any(isinstance(item, Dimension) for item in items)
    if localisation is not None:
        if edges is not None and localisation.model == "rounding" and not has_dimension:
            rule = "must be given without the localisation rounding, a model that counts no breaks"
            hint = "gaussian or fit counts them"
            raise RequestError.of_rule("edge_break_mm", rule, shown(edges), hint=hint)
        return localisation
    if has_dimension or edges is not None:
        floor_px = FLOOR_PX if edges is None else DETECTOR_FLOOR_PX
        return Localisation.gaussian(floor_px=floor_px)
    return Localisation.rounding()


def surfaces_or_default(surfaces_mm: float | None, localisation: Localisation | None) -> float:
    """Return how far faces are off their place, one standard deviation, mm.

    Parameters
    ----------
    surfaces_mm : float or None
        As it was given.
    localisation : Localisation or None
        With whole pixels, which are the paper's model, nothing is assumed; None is whole pixels.

    Returns
    -------
    float
        0 or more, mm.

    Raises
    ------
    RequestError
        If it is negative or not finite.
    """
    if surfaces_mm is None:
        rounded = localisation is None or localisation.model == "rounding"
        return 0.0 if rounded else SURFACES_MM
    try:
        return check_not_negative(surfaces_mm, "surfaces_mm")
    except InvalidParameterError as error:
        raise RequestError.of_rule(
            "surfaces_mm", error.rule or "must be a number", error.got or repr(surfaces_mm)
        ) from None


SAME_VALUE_MM = 1e-6
"""A stated value that is this near to that of the geometry is the same, mm or degrees."""

PARALLEL = "parallel"
"""Stands for a datum plane that is parallel to the plane of the rim: it fixes nothing there."""

_OPTIONS = (
    *("tolerance", "max_error", "accuracy", "share", "direction", "places", "unit", "any"),
    *("edge_break_mm", "zone", "datums", "pattern", "material", "size", "frame"),
)
# in the unit of the values, mm or degrees
_UNITS = {"mm": 1.0, "um": 1e-3, "in": 25.4, "inch": 25.4, "deg": 1.0, "rad": 57.29577951308232}
_ANGLES = ("deg", "rad")


def read_wanted(path: str | Path, kinds: tuple[str, ...], share: float = QUARTER) -> dict[str, Any]:
    """Read what is to be inspected from a .toml or .json file.

    Each name stands for an edge (``rim = 17`` or two end points: its length at the call's accuracy), or for a table
    with a kind and its entities, and what is asked: ``bore = { diameter = "r3", tolerance = [-0.05, 0.05] }``,
    ``step = { distance = [17, 18], max_error = 0.02 }``, ``rim = { edge = 17, max_error = 0.05 }``. Values are mm
    (angles: degrees), or of the ``unit`` given. A tolerance may be a class, ``tolerance = "H7"``, or one limit,
    ``tolerance = { upper = 0.05 }``, with ``max_error`` or ``accuracy`` besides. Other entities that
    give the same value follow as ``any``: ``step = { distance = [17, 18], any = [[21, 22]], max_error = 0.02 }``.
    A distance may be asked for at ``places`` along its edges: ``step = { distance = [17, 18], places = 3 }``.
    A position has a zone and datums, which a table ``datums`` may name:
    ``bolt = { position = "r3", zone = 0.2, datums = [17, 18] }``. With ``material = "M"`` or ``"L"``, ``size`` names
    the diameter of the file (of a slot, the distance) that has the limits, or states its deviations or class. A slot
    is its two edges, ``slot = { position = [17, 18], zone = 0.1, datums = ["r4", [3, 4]] }``. ``pattern`` holds the
    other rims of a pattern, to which the rest that datums leave free is fitted. ``symmetry`` takes two edges,
    ``coaxiality`` a rim.
    ``edge_break_mm = [0.1, 0.3]`` states by how much the edges of the dimension are broken, in mm whatever the unit.

    Parameters
    ----------
    path : str or Path
        The file; names stand at top level or in a table ``dimensions``.
    kinds : tuple of str
        Kinds of dimensions that are known.
    share : float
        Permitted error as a share of half the tolerance's width, of dimensions that state none.

    Returns
    -------
    dict of str to Dimension or edge
        By name, in the file's order.

    Raises
    ------
    RequestError
        If the file cannot be read, or what it says breaks a rule.
    """
    content = _content(Path(path))
    datums = content.get("datums", {})
    _check_tables(content, (*kinds, "edge"))
    content = content.get("dimensions", {key: content[key] for key in content if key != "datums"})
    if not isinstance(datums, Mapping):
        raise RequestError.of_rule("datums", "must be a table of names and entities", repr(datums))
    if not isinstance(content, dict) or not content:
        raise RequestError(
            f"a file of dimensions must hold one name at least. Got none in {Path(path).name}."
        )
    items = {}
    for name, value in content.items():
        stated = _with_size(name, _with_datums(value, datums), content, kinds)
        items[name] = _wanted(name, stated, kinds, share)
    return items


def _check_tables(content: Mapping[str, Any], kinds: tuple[str, ...]) -> None:
    """Refuse what stands beside the table dimensions and would not be read, and [datum] for [datums]."""
    tables = ("dimensions", "datums")
    for key, value in content.items():
        near = difflib.get_close_matches(key, tables, n=1)
        is_table = isinstance(value, Mapping) and not any(kind in value for kind in kinds)
        if key not in tables and ("dimensions" in content or (is_table and near)):
            hint = f"{near[0]!r} may be meant" if near else ""
            rule = "must stand in the table dimensions, or be the table datums"
            raise RequestError.of_rule(
                "what a file of dimensions holds", rule, repr(key), hint=hint
            )


def _with_size(name: str, stated: Any, content: Mapping[str, Any], kinds: tuple[str, ...]) -> Any:
    """Return what is wanted with the limits of its size in place of the name of a dimension that states them."""
    size = stated.get("size") if isinstance(stated, Mapping) else None
    if not isinstance(size, str) or size not in content:
        return stated
    is_slot = isinstance(stated.get("position"), list)
    return {**stated, "size": _size_of(name, size, is_slot, _wanted(size, content[size], kinds))}


def _size_of(name: str, size: str, is_slot: bool, dimension: Any) -> Any:
    """Return the limits of a diameter, or of the width of a slot, that is the size of a position: mm, or a class."""
    kind = "distance" if is_slot else "diameter"
    is_limited = isinstance(dimension, Dimension) and dimension.kind == kind
    limits = (dimension.tolerance or dimension.tolerance_class) if is_limited else None
    if limits is None:
        rule = f"must name a {kind} of the file with a tolerance"
        raise RequestError(f"dimension {name!r}: size {rule}. Got {size!r}.")
    return limits


def _with_datums(value: Any, named: Mapping[str, Any]) -> Any:
    """Return what is wanted with the entities of its datums in place of their names."""
    if not (isinstance(value, Mapping) and isinstance(value.get("datums"), list)):
        return value
    datums = []
    frame = []
    for datum in value["datums"]:
        is_name = isinstance(datum, str) and not re.fullmatch(r"[era]\d+.*", datum)
        if isinstance(datum, list) and not _is_end_points(datum):
            datums.append(list(map(edge_number, datum)))
            frame.append("-".join(map(_entity_text, datum)))
            continue
        if is_name and datum not in named and datum != PARALLEL:
            listed = ", ".join(map(repr, named))
            rule = f"must name entities, or a name in the table datums, which has {listed}"
            if not named:
                rule = "must name entities, because the file has no names in a table [datums]"
            raise RequestError.of_rule("datums", rule, repr(datum))
        shown_by = named.get(datum, datum) if is_name else datum
        frame.append(_entity_text(datum))
        if isinstance(shown_by, list) and not _is_end_points(shown_by):
            shown_by = list(map(edge_number, shown_by))
        if shown_by != PARALLEL:
            datums.append(edge_number(shown_by))
    # without a name of its own, a datum is named by its entities as everywhere
    is_named = any(str(datum) in named for datum in value["datums"])
    is_named &= not any(
        isinstance(datum, list) and _is_end_points(datum) for datum in value["datums"]
    )
    return {**value, "datums": datums, **({"frame": frame} if is_named else {})}


def _entity_text(stated: Any) -> str:
    """Return what a datum of a file is called: a name or an id as it is, "e7" for the edge 7."""
    is_edge = isinstance(stated, int) or (isinstance(stated, str) and stated.isdecimal())
    return f"e{stated}" if is_edge else str(stated)


def _content(path: Path) -> dict[str, Any]:
    if not path.is_file():
        raise RequestError.of_rule(
            "dimensions", "must be 'all' or name an existing file", repr(str(path))
        )
    try:
        content = parse_names(path)
    except ValueError as error:
        raise RequestError(
            f"a file of dimensions must be valid TOML or JSON. Got {path.name}: {error}."
        ) from error
    if not isinstance(content, dict):
        raise RequestError(
            f"a file of dimensions must hold names. Got {path.name} with {type(content).__name__}."
        )
    return content


def _wanted(name: str, value: Any, kinds: tuple[str, ...], share: float = QUARTER) -> Any:
    if not isinstance(value, Mapping):
        return value
    kind = [key for key in value if key in kinds or key == "edge"]
    allowed = (*kinds, "edge", *_OPTIONS)
    unknown = [key for key in value if key not in allowed]
    if unknown:
        starting = [key for key in allowed if key.startswith(str(unknown[0]))]
        near = starting or difflib.get_close_matches(str(unknown[0]), allowed, n=1)
        meant = f"; {near[0]!r} may be meant" if near else ""
        raise RequestError(
            f"dimension {name!r} must be made of a kind (edge, {', '.join(kinds)}) and {', '.join(_OPTIONS)}. "
            f"Got {unknown[0]!r}{meant}."
        )
    if len(kind) != 1:
        raise RequestError(
            f"dimension {name!r} must have one kind. Got {', '.join(kind) or 'none'}."
        )
    try:
        stated = {"share": share, **value}
        return _dimension("length" if kind[0] == "edge" else kind[0], value[kind[0]], stated)
    except RequestError as error:
        raise RequestError(f"dimension {name!r}: {error}") from error


def _dimension(kind: str, entities: Any, value: Mapping[str, Any]) -> Dimension:
    unit = value.get("unit", "deg" if kind == "angle" else "mm")
    units = [name for name in _UNITS if (name in _ANGLES) == (kind == "angle")]
    if unit not in units:
        raise RequestError.of_rule("unit", f"must be one of {', '.join(units)}", repr(unit))
    apart = ("unit", "any", "zone", "datums", "pattern", "material", "size", "frame")
    options = {key: value[key] for key in _OPTIONS if key in value and key not in apart}
    factor = _UNITS[unit]
    if kind in POSITIONS:
        return _position(kind, entities, value, options, factor)
    for names in (("zone", "datums"), ("material", "size"), ("frame",)):
        if any(name in value for name in names):
            raise RequestError(
                f"{' and '.join(names)} must be those of a position. Got them for {with_article(kind)}."
            )
    if isinstance(options.get("tolerance"), Mapping):
        options["tolerance"] = _limits(options["tolerance"])
    if isinstance(options.get("tolerance"), list):
        options["tolerance"] = tuple(
            _scaled(deviation, factor) for deviation in options["tolerance"]
        )
    if "max_error" in options:
        options["max_error"] = _scaled(options["max_error"], factor)
    others = value.get("any", [])
    if not isinstance(others, list):
        raise RequestError.of_rule("any", "must be a list of sets of entities", repr(others))
    return Dimension(
        kind, _entities(entities), alternatives=tuple(map(_entities, others)), **options
    )


def _position(
    kind: str, first: Any, value: Mapping[str, Any], options: dict[str, Any], factor: float
) -> Dimension:
    """Return the position that a table states."""
    if "tolerance" in options:
        raise RequestError(f"a {kind} must have a zone instead of a tolerance. Got a tolerance.")
    datums = value.get("datums")
    pattern = value.get("pattern", [])
    if not isinstance(pattern, list):
        raise RequestError.of_rule("pattern", "must be a list of rims", repr(pattern))
    if not isinstance(datums, list) or not (datums or pattern):
        raise RequestError.of_rule("datums", "must be a list of one entity at least", repr(datums))
    edge_break_mm = options.pop("edge_break_mm", None)
    zone_mm = _scaled(value.get("zone"), factor)
    check_number("zone", zone_mm, POSITIVE)
    options["material"] = value.get("material", "")
    # deviations of another diameter of the file are in mm already, and a tuple
    options["size"] = value.get("size")
    options["frame"] = _frame(value)
    if isinstance(options["size"], list):
        options["size"] = tuple(_scaled(limit, factor) for limit in options["size"])
    if isinstance(first, list) and not _is_end_points(first):
        first = list(map(edge_number, first))
    if kind in ("symmetry", "coaxiality"):
        if len(datums) != 1 or pattern:
            raise RequestError.of_rule("datums", f"must be one of a {kind}", repr(datums))
        position = getattr(Dimension, kind)(first, datums[0], zone_mm, **options)
    else:
        position = Dimension.position(first, datums, zone_mm, pattern=pattern, **options)
    return replace(position, edge_break_mm=edge_break_mm)


def _frame(value: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the names of the datums in the drawing; empty if none is stated."""
    frame = value.get("frame", [])
    if not isinstance(frame, list) or not all(isinstance(name, str) for name in frame):
        raise RequestError.of_rule("frame", "must be a list of names of datums", repr(frame))
    return tuple(frame)


def _limits(stated: Mapping[str, Any]) -> list[Any]:
    """Return lower and upper deviation of a table of one or both."""
    if not stated or any(key not in ("lower", "upper") for key in stated):
        rule = "must be a table of lower, upper or both"
        raise RequestError.of_rule("tolerance", rule, repr(dict(stated)))
    return [stated.get("lower"), stated.get("upper")]


def _entities(given: Any) -> tuple[Any, ...]:
    several = isinstance(given, list) and not _is_end_points(given)
    return tuple(map(edge_number, given)) if several else (edge_number(given),)


def _scaled(value: Any, factor: float) -> Any:
    if not isinstance(value, int | float) or isinstance(value, bool):
        return value
    try:
        return value * factor
    except OverflowError:
        # a whole number beyond all others is refused like one that is infinite
        return math.inf if value > 0 else -math.inf


def _is_end_points(value: list[Any]) -> bool:
    """Whether a list is two points of three numbers rather than two entities."""
    return len(value) == 2 and all(
        isinstance(point, list)
        and len(point) == 3
        and all(isinstance(x, int | float) for x in point)
        for point in value
    )


# Picking in a notebook: the picker page as a widget that holds what is clicked.


_HEIGHT_PX = 640


def pick(solid: Solid) -> Any:
    """Show a part in a notebook, to pick its edges, rims and arcs with the mouse.

    The widget shows the page that ``aspectgraph info --picture`` writes. Names, tolerances and the
    share of them that is permitted as error are typed in it. Show the widget as the last line of a
    cell; another cell reads what is picked.

    Parameters
    ----------
    solid : Solid
        The part.

    Returns
    -------
    anywidget.AnyWidget
        A widget with these traits, which follow each click:

        * ``entities``, a dict from names to ids, such as ``{"front": 17, "bore": "r3"}``, and
        * ``dimensions``, a dict from names to `Dimension`, also of what lies between two entities.
          It is empty while the page refuses a tolerance.
        * ``fault`` is the page's sentence on what it refuses, otherwise empty.

        `plan_inspection` takes both dicts.

    Raises
    ------
    aspectgraph.MissingExtraError
        The package anywidget is not installed.

    Examples
    --------
    >>> from aspectgraph import read_solid
    >>> from planner import pick
    >>> block = read_solid("examples/two_pocket_block.off")
    >>> picker = pick(block)  # doctest: +SKIP
    >>> picker  # doctest: +SKIP
    >>> plan = plan_inspection(block, picker.entities, camera, uncertainty)  # doctest: +SKIP
    """
    from aspectgraph.plot.picker import picker_html

    check_kinds(solid=(solid, "Solid"))
    widget = _picker_class()
    return widget(page=picker_html(solid), part=solid.name, height_px=_HEIGHT_PX)


@cache
def _picker_class() -> Any:
    """Return the class of the widget; the package that it needs is an extra."""
    try:
        import anywidget
        import traitlets
    except ImportError as error:
        raise MissingExtraError(
            f"picking in a notebook needs the package anywidget. Got {error}; "
            f"{how_to_install('notebook')}"
        ) from error
    from ground.templates import asset

    class Picker(anywidget.AnyWidget):  # type: ignore[misc, unused-ignore]
        """A part of which edges, rims and arcs are picked."""

        _esm = str(asset("aspectgraph.plot", "page/widget.js"))
        page = traitlets.Unicode().tag(sync=True)
        height_px = traitlets.Int().tag(sync=True)
        # what the page said last
        picked = traitlets.Dict().tag(sync=True)
        part = traitlets.Unicode()
        entities = traitlets.Dict(read_only=True)
        dimensions = traitlets.Dict(read_only=True)
        fault = traitlets.Unicode(read_only=True)

        @traitlets.observe("picked")
        def _follow(self, change: Mapping[str, Any]) -> None:
            rows = change["new"].get("rows", ())
            entities, dimensions, fault = _picked(rows)
            with self.hold_trait_notifications():
                self.set_trait("entities", entities)
                self.set_trait("dimensions", dimensions)
                self.set_trait("fault", fault)

        def __repr__(self) -> str:
            # as the page counts: what lies between two entities is one, too
            n_rows = len(self.picked.get("rows", ()))
            return f"<Picker of {self.part!r}: {n_rows} picked>"

    return Picker


def _picked(rows: Any) -> tuple[dict[str, Any], dict[str, Any], str]:
    """Return entities, dimensions and what is refused, of what the page has in its list."""
    from errors.measurands.measurand import kinds

    # what lies between two is a dimension only
    entities = {row["key"]: row["entity"] for row in rows if "entity" in row}
    faults = [f"{row['key']}: {row['fault']}" for row in rows if row["fault"]]
    if faults:
        return entities, {}, faults[0]
    content = {row["key"]: row["asked"] for row in rows}
    dimensions = {}
    for name, value in content.items():
        stated = _with_size(name, value, content, kinds())
        dimensions[name] = _wanted(name, stated, kinds())
    return entities, dimensions, ""


# Dimensions of a CAD model as a request: one characteristic for each feature of a pattern.


ROLE_REASONS = {
    "reference": "it is a reference dimension, given for information only",
    "basic": "it is a basic dimension, theoretically exact and without a tolerance of its own",
    "position": "positions, symmetry and coaxiality are left out of this plan",
}
"""Why a dimension of the model is not planned although it can be measured, by its role."""


@suggests_names
def dimensions_to_plan(
    stated: Iterable[ModelDimension | GeometricTolerance],
    *,
    share: float = QUARTER,
    one_per_pattern: bool = False,
    reference: bool = False,
    basic: bool = True,
    positions: bool = True,
) -> tuple[dict[str, Dimension], dict[str, str]]:
    """Turn dimensions of a CAD model into a request for `plan_inspection`.

    A characteristic is one dimension on one feature. A dimension of 30 holes becomes 30
    characteristics, such as ``"Linear Size.11 [3 of 30]"``. Each has its own entities.
    Reference dimensions are left out, because they are given for information only.

    Parameters
    ----------
    stated : iterable of ModelDimension or GeometricTolerance
        The dimensions, as `aspectgraph.read_dimensions` returns them, or all requirements, as
        `aspectgraph.read_requirements` does.
    share : float
        Permitted error as a share of half the tolerance's width, in (0, 1].
    one_per_pattern : bool
        Measure each dimension on one of its features. The plan then counts the others as not
        planned.
    reference : bool
        Plan reference dimensions, too.
    basic : bool
        Plan basic dimensions, which are theoretically exact. They have no tolerance of their own,
        so the accuracy of the call applies.
    positions : bool
        Plan positions, symmetry and coaxiality. Their datums must be in the same image.

    Returns
    -------
    wanted : dict of str to Dimension
        The characteristics that can be measured, in the order of the model.
    left_out : dict of str to str
        The others, with the reason. Their frames go into a plan that gets them as ``not_planned``.

    Raises
    ------
    RequestError
        If a tolerance or the share breaks its rule, or `stated` holds what is no requirement of a
        model.

    Examples
    --------
    >>> from aspectgraph import read_dimensions, read_solid
    >>> from planner import dimensions_to_plan
    >>> part = "examples/nist_ctc_03_ap242.stp.gz"
    >>> stated = read_dimensions(part, read_solid(part))
    >>> wanted, left_out = dimensions_to_plan(stated)
    >>> len(stated), len(wanted)
    (10, 13)
    >>> left_out
    {'Linear Size.11': 'it is a reference dimension, given for information only'}
    >>> [name for name in wanted if name.startswith("Linear Size.5")]
    ['Linear Size.5 [1 of 2]', 'Linear Size.5 [2 of 2]']
    """
    if isinstance(stated, str) or not isinstance(stated, Iterable):
        rule = "must be a list of ModelDimension"
        hint = "read_dimensions returns one"
        raise RequestError.of_rule("stated", rule, kind_shown(stated), hint=hint)
    omitted = [
        role
        for role, planned in (("reference", reference), ("basic", basic), ("position", positions))
        if not planned
    ]
    items = [
        (name, item if isinstance(item, Dimension) else LeftOut(item, _frame_of_model(statement)))
        for statement in stated
        for name, item in _items(statement, share, one_per_pattern, omitted)
    ]
    # the model may already use a name that a feature of a pattern gets
    names = unique_names([name for name, _ in items])
    named: dict[str, Dimension] = {}
    left_out: dict[str, str] = {}
    for name, (_, item) in zip(names, items, strict=True):
        if isinstance(item, Dimension):
            named[name] = item
        else:
            left_out[name] = item
    return named, left_out


def _frame_of_model(stated: ModelDimension | GeometricTolerance) -> tuple[str, ...]:
    """Return kind, value or zone, and datums of a requirement; empty without a value."""
    if isinstance(stated, GeometricTolerance):
        if stated.zone_mm is None:
            return ()
        # mm goes without saying, as on a drawing
        return stated.kind, *stated.frame.replace(" mm", "").split(" | ")
    if stated.nominal is None:
        return ()
    value = f"{stated.nominal:.6g}{'°' * (stated.kind == 'angle')}"
    if stated.tolerance is not None:
        value += f" {tolerance_text(stated.tolerance)}"
    if stated.role == "reference":
        value = f"({value})"
    return stated.kind, value


def _items(
    stated: ModelDimension | GeometricTolerance,
    share: float,
    one_per_pattern: bool,
    omitted: Sequence[str],
) -> list[tuple[str, Dimension | str]]:
    """Return the name of each characteristic, with its request or the reason why it has none."""
    if isinstance(stated, GeometricTolerance):
        if stated.reason is None and "position" in omitted:
            return [(stated.name, ROLE_REASONS["position"])]
        return _positions(stated, share, one_per_pattern)
    check_kinds(stated=(stated, "ModelDimension"))
    if stated.role is not None and stated.role in omitted:
        return [(stated.name, ROLE_REASONS[stated.role])]
    if stated.entities is None:
        return [(stated.name, stated.reason or "")]
    # without a list of features the entities are those of the only one
    places = [k for k, ways in enumerate(stated.features) if ways and ways[0] == stated.entities]
    first = stated.features[places[0]] if places else (stated.entities,)
    n = len(stated.features)
    # of records that were made by hand, none may be stated
    zones = stated.surfaces or (None,) * n
    if one_per_pattern or n == 1:
        zone = zones[places[0]] if places else None
        count = stated.n_features if one_per_pattern else 1
        return [(stated.name, _dimension_of_model_dimensions(stated, first, share, zone, count))]
    result: list[tuple[str, Dimension | str]] = []
    for k, (ways, reason) in enumerate(zip(stated.features, stated.feature_reasons, strict=True)):
        item = (
            _dimension_of_model_dimensions(stated, ways, share, zones[k]) if ways else reason or ""
        )
        result.append((characteristic_name(stated.name, k + 1, n), item))
    return result


def _positions(
    stated: GeometricTolerance, share: float, one_per_pattern: bool
) -> list[tuple[str, Dimension | str]]:
    """Return the positions that a tolerance asks for, each on its feature, or the reason why it is not measured."""
    if stated.reason is not None or stated.zone_mm is None:
        return [(stated.name, stated.reason or "its zone could not be read")]
    result: list[tuple[str, Dimension | str]] = []
    n = len(stated.features)
    for k, (ways, reason) in enumerate(
        zip(stated.features, stated.feature_reasons, strict=True), start=1
    ):
        name = stated.name if n == 1 else characteristic_name(stated.name, k, n)
        if not ways:
            result.append((name, reason or ""))
            continue
        of_size: dict[str, Any] = {}
        size = stated.sizes[k - 1] if stated.sizes else None
        if size is not None:
            of_size = {"material": stated.material, "size": size}
        first, *others = ways
        item = Dimension(
            stated.measured_as or POSITION,
            first,
            tolerance=(0.0, stated.zone_mm),
            share=share,
            alternatives=tuple(others),
            groups=stated.groups,
            frame=stated.datums,
            **of_size,
        )
        result.append((name, item))
    if one_per_pattern:
        return [item for item in result if isinstance(item[1], Dimension)][:1] or result[:1]
    return result


def _about_geometry(stated: ModelDimension) -> tuple[float, float] | None:
    """Return the tolerance from the value of the geometry: the limits are those of the stated value.

    A drawing in inches states 0.187 for a hole of 4.7625 mm.
    """
    if stated.tolerance is None or stated.nominal is None or stated.geometry is None:
        return stated.tolerance
    apart = stated.nominal - stated.geometry
    if abs(apart) <= SAME_VALUE_MM:
        return stated.tolerance
    lower, upper = stated.tolerance
    return apart + lower, apart + upper


def _dimension_of_model_dimensions(
    stated: ModelDimension,
    ways: Sequence[Way],
    share: float,
    zone: SurfaceZone | None,
    n_features: int = 1,
) -> Dimension:
    """Return a dimension of the model, on any of the sets of entities given, with its own tolerance."""
    along = stated.direction if stated.kind in ("distance", "centre_distance") else None
    surfaces_mm, surfaces_from = surfaces_of_zone(zone)
    try:
        return Dimension(
            stated.kind,
            ways[0],
            tolerance=_about_geometry(stated),
            share=share,
            direction=along,
            n_features=n_features,
            alternatives=tuple(ways[1:]),
            surfaces_mm=surfaces_mm,
            surfaces_from=surfaces_from,
        )
    except RequestError as error:
        raise RequestError(f"dimension {stated.name!r}: {error}") from error
