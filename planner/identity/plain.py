"""Values of a request as plain values: texts, numbers, lists and mappings, the same in every process."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from planner.request.reach import reach_identity

# fields that hold values of several kinds: the kind belongs to the value
_OF_SEVERAL_KINDS = ("lamps",)


def plain_value(value: Any, name: str = "") -> Any:
    """Return a value as plain values that JSON can hold.

    Parameters
    ----------
    value
        A number, text, array, mapping, sequence, dataclass, or anything with ``to_dict`` and ``from_dict``.
    name : str
        Name of the field that holds it.

    Raises
    ------
    TypeError
        If it is none of these: then it cannot tell requests apart.
    """
    if name == "reach":
        return reach_identity(value)
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and math.isinf(value):
        # JSON has no such number; float() reads the text
        return str(value)
    if value is None or isinstance(value, str | bool | int | float):
        return value
    if hasattr(value, "_asdict"):
        return plain_value(value._asdict())
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, Mapping):
        return {str(key): plain_value(item, str(key)) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain_value(item) for item in value]
    # what comes back from its values with nothing lost
    if hasattr(value, "to_dict") and hasattr(value, "from_dict"):
        return plain_value(value.to_dict())
    if is_dataclass(value):
        kind = {"kind": type(value).__name__} if name in _OF_SEVERAL_KINDS else {}
        return kind | plain_fields(value)
    raise TypeError(
        f"{name or 'a value'} of a request must have to_dict and from_dict. Got {value!r}."
    )


def plain_fields(record: Any) -> dict[str, Any]:
    """Return all fields of a dataclass as plain values, by name; a whole number in a field of floats is a float."""
    values = {}
    for field in fields(record):
        value = plain_value(getattr(record, field.name), field.name)
        whole = isinstance(value, int) and not isinstance(value, bool)
        values[field.name] = float(value) if whole and "float" in str(field.type) else value
    return values
