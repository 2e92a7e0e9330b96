"""Checks of records of numbers, and of what is in them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import is_dataclass
from functools import cache
from typing import Any, get_type_hints

from planner.argument_kinds import NOT_NEGATIVE, NumberRule, check_count, check_number

# types of fields that hold floats
_FLOATS = (float, tuple[float, ...])
_NOT_NEGATIVE = NumberRule("must be a finite number, 0 or more", NOT_NEGATIVE.holds)
# numbers of things of which there may be none
_MAY_BE_NONE = {
    "around",
    "cover_rounds",
    "displaced",
    "exchanges",
    "most_trials",
    "neighbours",
    "nodes",
    "pause",
    "retried",
    "viewpoints",
}


def is_record(value: Any) -> bool:
    """Return whether a value is a dataclass or a named tuple."""
    return is_dataclass(value) or hasattr(value, "_asdict")


def fields_of(record: Any) -> Iterator[tuple[str, bool, Any]]:
    """Yield name, whether it holds floats, and value of each field of a record."""
    kind: Any = type(record)
    for name, is_float in _kinds(kind).items():
        yield name, is_float, getattr(record, name)


@cache
def _kinds(record: type) -> dict[str, bool]:
    return {name: kind in _FLOATS for name, kind in get_type_hints(record).items()}


def check_record(owner: str, record: Any) -> None:
    """Raise `RequestError` unless all numbers of a record have their type and are not negative.

    Records inside it are checked as well.

    Parameters
    ----------
    owner : str
        Its name in messages, such as ``pricing``.
    record : dataclass or named tuple
        Its fields are numbers, tuples of numbers, or records.
    """
    for name, is_float, value in fields_of(record):
        full = f"{owner}.{name}"
        if is_record(value):
            check_record(full, value)
            continue
        for number in value if isinstance(value, tuple) else (value,):
            if is_float:
                check_number(full, number, _NOT_NEGATIVE)
            else:
                check_count(full, number, 0 if name in _MAY_BE_NONE else 1)


def with_floats(record: Any) -> Any:
    """Return a named tuple whose numbers are of the declared kinds: compiled loops are made for kinds of numbers."""
    values = []
    for _, is_float, value in fields_of(record):
        if is_record(value):
            values.append(with_floats(value))
        else:
            values.append(float(value) if is_float else int(value))
    return type(record)(*values)
