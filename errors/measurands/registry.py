"""Kinds of dimensions by name: a kind is one class in one file, and nothing else has a branch for it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from errors.exceptions import InvalidParameterError, MeasurandError
from errors.measurands.geometry import Geometry
from errors.measurands.measurand import Measurand

_KINDS: dict[str, type[Measurand]] = {}


def kind(name: str) -> Callable[[type[Any]], type[Any]]:
    """Return a decorator that makes a class the kind of that name."""

    def register(cls: type[Any]) -> type[Any]:
        cls.kind = name
        _KINDS[name] = cls
        return cls

    return register


def kinds() -> tuple[str, ...]:
    """Return the names of all kinds."""
    return tuple(_KINDS)


def measurand(name: str, geometry: Sequence[Geometry], direction: Any = None) -> Measurand:
    """Return a value over lines and circles.

    Parameters
    ----------
    name : str
        Kind, one of `kinds`.
    geometry : sequence of Line or Circle
        Its entities in the part's frame.
    direction : array (3,), optional
        Direction of a distance. Default: across the lines.

    Returns
    -------
    Measurand
        The value, its planes and its derivatives.

    Raises
    ------
    MeasurandError
        If the kind is unknown, or its value is not defined for these entities.
    """
    if name not in _KINDS:
        raise MeasurandError.of_rule("kind", f"must be one of {', '.join(_KINDS)}", repr(name))
    cls = _KINDS[name]
    if len(geometry) != len(cls.takes):
        raise MeasurandError(
            f"a {name} must have {_several(cls.takes)}. Got {len(geometry)} of them."
        )
    for one, wanted in zip(geometry, cls.takes, strict=True):
        if not isinstance(one, wanted):
            raise MeasurandError(
                f"a {name} must have {_several(cls.takes)}. Got a {type(one).__name__.lower()}."
            )
    try:
        return cls(tuple(geometry), direction)
    except InvalidParameterError as error:
        raise MeasurandError(str(error)) from error


def _several(takes: Sequence[type]) -> str:
    words = {"Line": "straight edge", "Circle": "rim or arc"}
    return " and ".join("one " + words[one.__name__] for one in takes)
