"""Arrays, and what holds them, as values that JSON can hold, bit for bit and shorter than as lists of numbers.

An array becomes ``{"array": type, "shape": [...], "base64": bytes}``: little-endian, row by row; Booleans as bits.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping
from typing import Any

import numpy as np

_TYPES = ("<f8", "<i8", "bits")


def packed(value: object) -> Any:
    """Return a value with all arrays in it packed.

    Parameters
    ----------
    value : object
        Plain values, arrays of numbers or Booleans, and dicts, lists and tuples of them; what can be called is called
        and what it returns is taken.
    """
    if callable(value):
        return packed(value())
    if isinstance(value, np.ndarray):
        return _packed_array(value)
    if isinstance(value, Mapping):
        return {key: packed(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [packed(item) for item in value]
    return value.item() if isinstance(value, np.generic) else value


def unpacked(value: object) -> Any:
    """Return what `packed` was given; tuples come back as lists.

    Raises
    ------
    ValueError
        If something looks like a packed array and is none.
    """
    if isinstance(value, dict):
        return (
            _unpacked_array(value)
            if "base64" in value
            else {key: unpacked(item) for key, item in value.items()}
        )
    return [unpacked(item) for item in value] if isinstance(value, list) else value


def _packed_array(array: np.ndarray) -> dict[str, Any]:
    if array.dtype == bool:
        kind = "bits"
        content = np.packbits(array.ravel()).tobytes()
    else:
        kind = "<i8" if np.issubdtype(array.dtype, np.integer) else "<f8"
        content = np.ascontiguousarray(array, dtype=kind).tobytes()
    return {
        "array": kind,
        "shape": list(array.shape),
        "base64": base64.b64encode(content).decode("ascii"),
    }


def _unpacked_array(data: dict[str, Any]) -> np.ndarray:
    kind = data.get("array")
    shape = data.get("shape")
    if kind not in _TYPES or not isinstance(shape, list):
        raise ValueError(
            f"array must be one of {', '.join(_TYPES)}, with a shape. Got {kind!r} and {shape!r}"
        )
    content = base64.b64decode(data["base64"], validate=True)
    if kind == "bits":
        bits = np.unpackbits(np.frombuffer(content, dtype=np.uint8))
        n = int(np.prod(shape, dtype=np.int64))
        if not 0 <= len(bits) - n < 8:
            raise ValueError(f"array of the shape {shape} must have {n} bits. Got {len(bits)}")
        return bits[:n].astype(bool).reshape(shape)
    return np.frombuffer(content, dtype=kind).reshape(shape).copy()
