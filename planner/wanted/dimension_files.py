"""Dimensions and entities as a file of the command line holds them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from aspectgraph.entities.entity_files import parse_names
from planner.exceptions import RequestError
from planner.wanted.dimension import QUARTER, Dimension

_OPTIONS = ("tolerance", "max_error", "accuracy", "share", "direction", "places", "unit", "any")
# in the unit of the values, mm or degrees
_UNITS = {"mm": 1.0, "um": 1e-3, "in": 25.4, "deg": 1.0, "rad": 57.29577951308232}
_ANGLES = ("deg", "rad")


def read_wanted(path: str | Path, kinds: tuple[str, ...], share: float = QUARTER) -> dict[str, Any]:
    """Read what is to be inspected from a .toml or .json file.

    Each name stands for an edge (``rim = 17`` or two end points: its length at the call's accuracy), or for a table
    with a kind and its entities, and what is asked: ``bore = { diameter = "r3", tolerance = [-0.05, 0.05] }``,
    ``step = { distance = [17, 18], max_error = 0.02 }``, ``rim = { edge = 17, max_error = 0.05 }``. Values are mm
    (angles: degrees), or of the ``unit`` given. A tolerance may be a class: ``tolerance = "H7"``. Other entities that
    give the same value follow as ``any``: ``step = { distance = [17, 18], any = [[21, 22]], max_error = 0.02 }``.
    A distance may be asked for at ``places`` along its edges: ``step = { distance = [17, 18], places = 3 }``.

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
    content = content.get("dimensions", content)
    if not isinstance(content, dict) or not content:
        raise RequestError(
            f"a file of dimensions must hold one name at least. Got none in {Path(path).name}."
        )
    return {name: _wanted(name, value, kinds, share) for name, value in content.items()}


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


def _wanted(name: str, value: Any, kinds: tuple[str, ...], share: float) -> Any:
    if not isinstance(value, Mapping):
        return value
    kind = [key for key in value if key in kinds or key == "edge"]
    unknown = [key for key in value if key not in (*kinds, "edge", *_OPTIONS)]
    if unknown:
        raise RequestError(
            f"dimension {name!r} must be made of a kind (edge, {', '.join(kinds)}) and {', '.join(_OPTIONS)}. "
            f"Got {unknown[0]!r}."
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
    known = [name for name in _UNITS if (name in _ANGLES) == (kind == "angle")]
    if unit not in known:
        raise RequestError.of_rule("unit", f"must be one of {', '.join(known)}", repr(unit))
    options = {key: value[key] for key in _OPTIONS if key in value and key not in ("unit", "any")}
    factor = _UNITS[unit]
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


def _entities(given: Any) -> tuple[Any, ...]:
    several = isinstance(given, list) and not _is_end_points(given)
    return tuple(given) if several else (given,)


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
