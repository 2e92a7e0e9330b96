"""The values of one camera, found by any of their names: numbers, sizes and words, checked."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from planner.argument_kinds import shown
from planner.camera.readers.key_names import HARMLESS, READ, plain
from planner.camera.readers.stated_calibration import check_finite
from planner.exceptions import CameraError

_MATRIX_KEYS = {"rows", "cols", "dt", "data", "typeid"}
# OpenCV's letters for the number types of one channel
_ONE_CHANNEL = ("u", "c", "w", "s", "i", "f", "d", "h")


class NamedValues:
    """Values of a mapping, by plain names; messages name the file and the key as it stands there.

    Parameters
    ----------
    path : pathlib.Path
        The file.
    values : dict
        What it says of one camera.

    Raises
    ------
    CameraError
        If two keys are the same, or a key is not known: it might change the meaning.
    """

    def __init__(self, path: Path, values: dict[str, Any]) -> None:
        self.path = path
        self._values: dict[str, tuple[str, Any]] = {}
        for key, value in values.items():
            name = plain(key)
            if name in self._values:
                other = self._values[name][0]
                raise CameraError(f"{path}: {key} must stand once. Got {other}, too.")
            self._values[name] = (key, value)
        for name, (key, _) in self._values.items():
            if name not in READ and name not in HARMLESS:
                raise CameraError(
                    f"{path}: {shown(key, str)} must be a key that is known here, "
                    "as another may change what the numbers mean. Got an unknown key."
                )

    def error(self, key: str, rule: str, got: object) -> CameraError:
        """Return the error of a value that breaks a rule; names file, key, rule and value."""
        return CameraError(f"{self.path}: {key} {rule}. Got {got}.")

    def key(self, names: tuple[str, ...]) -> str | None:
        """Return the key that is there of several names for one thing, or None.

        Raises
        ------
        CameraError
            If there are two.
        """
        keys = [self._values[name][0] for name in names if name in self._values]
        if len(keys) > 1:
            raise self.error(keys[0], "must stand alone", f"{keys[1]}, too")
        return keys[0] if keys else None

    def entries(self, names: tuple[str, ...]) -> list[tuple[str, Any]]:
        """Return keys and values of all the names that are there."""
        return [self._values[name] for name in names if name in self._values]

    def needed(self, names: tuple[str, ...], usual: str) -> tuple[str, Any]:
        """Return the key and the value of a thing that must be there."""
        key = self.key(names)
        if key is None:
            keys = ", ".join(other for other, _ in self._values.values())
            raise self.error(usual, "must be given", shown(keys, str))
        return self._values[plain(key)]

    def count(self, key: str, value: Any) -> int:
        """Return a whole number that is not negative."""
        if (
            isinstance(value, bool)
            or not isinstance(value, int | float)
            or not math.isfinite(value)
            or value != int(value)
            or value < 0
        ):
            raise self.error(key, "must be a whole number", shown(value))
        return int(value)

    def numbers(self, key: str, value: Any, names: tuple[str, ...]) -> list[float]:
        """Return the finite numbers of a list, a nested list, or a matrix with rows and cols."""
        shape = None
        if isinstance(value, dict):
            shape, value = self._matrix(key, value)
        flat = self._flat(key, value)
        if shape is not None and shape[0] * shape[1] != len(flat):
            raise self.error(
                key, f"must hold rows x cols numbers, {shape[0]} x {shape[1]}", len(flat)
            )
        square = math.isqrt(len(names))
        if shape is not None and shape != (square, square) and min(shape, default=0) > 1:
            raise self.error(key, "must have rows and cols that fit", f"{shape[0]} x {shape[1]}")
        check_finite(f"{self.path}: {key}", flat, names)
        return flat

    def _matrix(self, key: str, value: dict[str, Any]) -> tuple[tuple[int, int] | None, Any]:
        entries = {plain(name): entry for name, entry in value.items()}
        for name in value:
            if plain(name) not in _MATRIX_KEYS:
                raise self.error(key, "must hold rows, cols, dt and data", shown(name, str))
        if "data" not in entries:
            raise self.error(key, "must hold data", shown(", ".join(value)))
        if entries.get("dt", "d") not in _ONE_CHANNEL:
            raise self.error(
                key,
                "must have one number a place, such as dt: d",
                f"dt: {shown(entries['dt'], str)}",
            )
        if "rows" not in entries and "cols" not in entries:
            return None, entries["data"]
        rows = self.count(f"rows of {key}", entries.get("rows"))
        cols = self.count(f"cols of {key}", entries.get("cols"))
        return (rows, cols), entries["data"]

    def _flat(self, key: str, value: Any) -> list[float]:
        if not isinstance(value, list):
            raise self.error(key, "must be a list of numbers", shown(value))
        flat: list[float] = []
        for item in value:
            if isinstance(item, list):
                flat += self._row(key, item)
            else:
                flat += self._row(key, [item])
        return flat

    def _row(self, key: str, row: list[Any]) -> list[float]:
        for item in row:
            if isinstance(item, bool) or not isinstance(item, int | float):
                raise self.error(key, "must hold numbers", shown(item))
        return [float(item) for item in row]
