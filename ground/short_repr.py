"""Short texts of records: one line for a notebook, a debugger or a message."""

from __future__ import annotations

from dataclasses import MISSING, fields, is_dataclass
from typing import Any, Final

LONGEST: Final = 120
"""Characters of a text, at most."""

_LONGEST_VALUE = 40


def count(n: int, singular: str, plural: str | None = None) -> str:
    """Return a number with its noun.

    Parameters
    ----------
    n : int
        The number.
    singular, plural : str
        The noun. Default of the plural: with an s.

    Examples
    --------
    >>> count(1, "entity", "entities"), count(2, "domain")
    ('1 entity', '2 domains')
    """
    return f"{n} {singular if n == 1 else plural or singular + 's'}"


def short_repr(record: Any) -> str:
    """Return a record as one line of at most 120 characters.

    A class uses it as its method: ``__repr__ = short_repr``. The line has the fields that differ
    from their defaults, in order, as many as there is room for. Arrays are given by their shapes,
    vectors in space by their numbers, long values by their lengths.

    Parameters
    ----------
    record : dataclass or named tuple
        The record.

    Examples
    --------
    >>> from planner import Effort
    >>> Effort(viewpoints=10)
    Effort(viewpoints=10)
    """
    text = f"{type(record).__qualname__}("
    pieces = [f"{name}={_value(value)}" for name, value in _fields(record)]
    for k, piece in enumerate(pieces):
        comma = ", " if k else ""
        last = k == len(pieces) - 1
        if len(text) + len(comma) + len(piece) > LONGEST - (len(")") if last else len(", …)")):
            return f"{text}{comma}…)"
        text += comma + piece
    return f"{text})"


def _fields(record: Any) -> list[tuple[str, Any]]:
    """Return names and values of the fields that differ from their defaults."""
    if not is_dataclass(record):
        defaults = record._field_defaults
        pairs = zip(record._fields, record, strict=True)
        return [(k, v) for k, v in pairs if k not in defaults or not _same(v, defaults[k])]
    shown = []
    for item in fields(record):
        value = getattr(record, item.name)
        default = item.default
        if item.default_factory is not MISSING:
            default = item.default_factory()
        # what is computed from other fields says nothing new
        if item.repr and item.init and (default is MISSING or not _same(value, default)):
            shown.append((item.name, value))
    return shown


def _same(value: Any, default: Any) -> bool:
    """Return whether two values are the same; arrays and NaN are only if they are identical."""
    if value is default:
        return True
    if type(value) is not type(default) or hasattr(value, "shape"):
        return False
    try:
        # NaN as default stands for no value
        return bool(value == default or (value != value and default != default))
    except ValueError:
        # of arrays in containers
        return False


def _value(value: Any) -> str:
    shape = getattr(value, "shape", ())
    if shape == (3,):
        return f"({', '.join(f'{number:.6g}' for number in value)})"
    if shape:
        return f"<{' × '.join(map(str, shape))} array>"
    text = f"{value:.6g}" if isinstance(value, float) else repr(value)
    if type(value) is tuple and value and all(type(number) is float for number in value):
        # noise of a conversion of units says nothing
        short = ", ".join(repr(float(f"{number:.6g}")) for number in value)
        text = f"({short}{',' * (len(value) == 1)})"
    if len(text) <= _LONGEST_VALUE and "\n" not in text:
        return text
    if isinstance(value, str):
        return f"{text[: _LONGEST_VALUE - 2]}…{text[0]}"
    if isinstance(value, tuple | list | dict | set | frozenset) and not hasattr(value, "_fields"):
        return f"<{len(value)} item{'s' * (len(value) != 1)}>"
    return f"<{type(value).__name__}>"
