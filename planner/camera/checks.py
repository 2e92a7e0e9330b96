"""Checks of a camera's numbers, and the reading of its file: errors name the field, the rule and the value."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

from planner.argument_kinds import shown
from planner.exceptions import CameraError

try:
    import tomllib
except ModuleNotFoundError:  # Python 3.10
    import tomli as tomllib  # type: ignore[no-redef]

# numbers outside are slips of the pen, and what is derived from them is not finite
_SMALLEST = 1e-9
_LARGEST = 1e9


def read_toml(path: Path) -> tuple[str, dict[str, Any]]:
    """Return the text of a TOML file and what it says, or raise `CameraError` with file and line."""
    from aspectgraph.files import check_plain, read_text

    try:
        text = read_text(path)
        content = tomllib.loads(text)
    except OSError as error:
        raise CameraError(f"{path}: camera file cannot be read: {error.strerror}.") from None
    except UnicodeDecodeError as error:
        raise CameraError(
            f"{path}: camera file must be UTF-8 text. Got byte {error.object[error.start]:#04x}."
        ) from None
    except tomllib.TOMLDecodeError as error:
        found = re.search(r"line (\d+)", str(error))
        line = int(found.group(1)) if found else len(text.splitlines())
        raise CameraError(f"{path}:{line}: camera file must be TOML. {error}.") from None
    except RecursionError:
        raise CameraError(
            f"{path}: camera file must not nest arrays or tables so deep. Got too many levels."
        ) from None
    except ValueError:
        # Python reads no integer of more than some thousand digits
        raise CameraError(
            f"{path}: camera file must hold numbers of a sensible length. Got a longer one."
        ) from None
    try:
        check_plain(content)
    except ValueError as error:
        raise CameraError(f"{path}: camera file must be TOML for a camera. Got: {error}.") from None
    return text, content


def line_of(field: str, text: str) -> int:
    """Return the line that assigns a field; 1 when the field is missing."""
    pattern = re.compile(rf"\s*[\"']?{re.escape(field)}[\"']?\s*[=.\]]")
    return next(
        (i for i, line in enumerate(text.splitlines(), 1) if pattern.match(line.lstrip("["))), 1
    )


def check_pair(field: str, values: Any) -> tuple[Any, ...]:
    """Return two values of a field, or raise `CameraError`."""
    try:
        pair = tuple(values)
    except TypeError:
        pair = ()
    if len(pair) != 2 or isinstance(values, str):
        raise CameraError.of_rule(field, "must be two numbers, across and down", shown(values))
    return pair


def check_number(field: str, value: Any) -> float:
    """Return a finite number, or raise `CameraError`."""
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if not math.isfinite(number) or isinstance(value, str | bool):
        raise CameraError.of_rule(field, "must be finite", shown(value))
    return number


def check_positive(field: str, value: Any) -> float:
    """Return a positive number of a sensible size, or raise `CameraError`."""
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = math.nan
    except OverflowError:
        number = math.inf
    if not (math.isfinite(number) and number > 0) or isinstance(value, str | bool):
        raise CameraError.of_rule(field, "must be finite and positive", shown(value))
    if not _SMALLEST <= number <= _LARGEST:
        raise CameraError.of_rule(field, f"must be in [{_SMALLEST:g}, {_LARGEST:g}]", f"{number:g}")
    return number


def check_count(field: str, value: object) -> int:
    """Return a positive whole number, or raise `CameraError`."""
    number = check_positive(field, value)
    if number != int(number):
        raise CameraError.of_rule(field, "must be whole pixels", shown(value))
    return int(number)
