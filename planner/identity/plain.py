"""Values of a request as plain values: texts, numbers, lists and mappings, the same in every process; and back."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import MISSING, fields, is_dataclass
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints

import numpy as np

from planner.exceptions import PlanFileError
from planner.light.lamps import LampBox, LampDome
from planner.request.reach import BoxRegion, SphereRegion, reach_identity

# fields that hold values of several kinds: the kind belongs to the value
_OF_SEVERAL_KINDS = ("lamps",)
_KINDS = {kind.__name__: kind for kind in (BoxRegion, SphereRegion, LampBox, LampDome)}


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
    if name in ("reach", "cell"):
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


def completed_value(kind: Any, value: Any) -> Any:
    """Return plain values of a record with the fields they lack, which have their defaults.

    Parameters
    ----------
    kind : type
        What the field that holds them is declared as.
    value
        Plain values, such as an earlier program wrote: it did not know all fields.
    """
    kind = _without_none(kind)
    if not (_is_record(kind) and isinstance(value, Mapping)):
        return value
    kinds = get_type_hints(kind)
    known = {name: completed_value(kinds.get(name), item) for name, item in value.items()}
    defaults = {name: plain_value(item, name) for name, item in _defaults(kind).items()}
    return {**defaults, **known}


def restored_value(kind: Any, value: Any) -> Any:
    """Return the value that `plain_value` made plain.

    Parameters
    ----------
    kind : type
        What the field that holds it is declared as.
    value
        Plain values.

    Raises
    ------
    PlanFileError
        If it is of a reach that no file can hold.
    KeyError, TypeError, ValueError, AttributeError
        If it is not as `plain_value` writes it.
    """
    if value is None and get_origin(kind) in (Union, UnionType):
        return None
    kind = _without_none(kind)
    if kind is Any:
        if not isinstance(value, Mapping):
            return value
        value = dict(value)
        name = value.pop("kind", None)
        if name not in _KINDS:
            got = name or next(iter(value.values()), "nothing")
            raise PlanFileError(f"reach must be a box or a ball to be in a file. Got {got}.")
        kind = _KINDS[name]
    if hasattr(kind, "from_dict"):
        return kind.from_dict(value)
    if _is_record(kind):
        kinds = get_type_hints(kind)
        return kind(**{name: restored_value(kinds[name], own) for name, own in value.items()})
    if get_origin(kind) is tuple:
        return tuple(restored_value(get_args(kind)[0], item) for item in value)
    if kind is np.ndarray:
        return np.array(value, dtype=np.float64)
    return float(value) if kind is float and isinstance(value, str) else value


def _is_record(kind: Any) -> bool:
    return is_dataclass(kind) or hasattr(kind, "_asdict")


def _defaults(kind: Any) -> dict[str, Any]:
    """Return the defaults of a dataclass or a named tuple, by field."""
    if not is_dataclass(kind):
        return dict(kind._field_defaults)
    made = {
        field.name: field.default_factory()
        for field in fields(kind)
        if field.default_factory is not MISSING
    }
    given = {field.name: field.default for field in fields(kind) if field.default is not MISSING}
    return {**made, **given}


def _without_none(kind: Any) -> Any:
    """Return the type that a field has where it is given; Any if there are several."""
    if get_origin(kind) not in (Union, UnionType):
        return kind
    others = [other for other in get_args(kind) if other is not NoneType]
    return others[0] if len(others) == 1 else Any
