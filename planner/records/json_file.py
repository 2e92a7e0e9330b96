"""Reading JSON strictly: whatever the bytes are, the outcome is plain values or one clear line.

Beyond what Python's reader refuses, a key may not come twice, the nesting must be shallow, and every text must be
writable as UTF-8. NaN and numbers too large for a float pass as such: the schema refuses them and can say where.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from planner.exceptions import PlanFileError

# files of this package are nested seven deep at most
_DEEPEST = 40


def read_json(path: str | os.PathLike[str], what: str) -> Any:
    """Return what a JSON file holds.

    Parameters
    ----------
    path : path
    what : str
        What the file is called in messages, such as "plan file".

    Raises
    ------
    PlanFileError
        If the file cannot be read or is not JSON in UTF-8; the message names the file and, for malformed JSON, line and
        column.
    """
    from aspectgraph.files import read_text

    path = Path(path)
    try:
        text = read_text(path, large=True)
        data = json.loads(text, object_pairs_hook=_different_keys)
        _check_depth_and_text(data)
        return data
    except OSError as error:
        raise PlanFileError(f"{path}: {what} must be readable. Got: {error.strerror}.") from None
    except UnicodeDecodeError:
        raise PlanFileError(f"{path}: {what} must be UTF-8 text. Got other bytes.") from None
    except json.JSONDecodeError as error:
        found = f": {error.msg}" if text.strip() else " an empty file"
        raise PlanFileError(
            f"{path}:{error.lineno}:{error.colno}: {what} must be JSON. Got{found}."
        ) from None
    except RecursionError:
        raise PlanFileError(
            f"{path}: {what} must be nested at most {_DEEPEST} deep. Got more."
        ) from None
    except _Refused as error:
        raise PlanFileError(f"{path}: {what} {error}") from None
    except ValueError:
        # Python reads no integer of more than some thousand digits
        raise PlanFileError(
            f"{path}: {what} must hold numbers of a sensible length. Got a longer one."
        ) from None


def encoded(value: object) -> Any:
    """Replace numbers JSON has no notation for, such as the margin of a constraint that was not set."""
    if isinstance(value, Mapping):
        return {key: encoded(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [encoded(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return {"not finite": str(value)}
    return value


def print_json(record: Any) -> None:
    """Print plain values as JSON; numbers that are not finite as in plan files."""
    text = json.dumps(encoded(record), indent=1, allow_nan=False)
    # the one control character that JSON writes as it is
    print(text.replace("\x7f", "\\u007f"))


def number(value: Any) -> float:
    """Return a number as it was before `encoded`."""
    return float(value["not finite"]) if isinstance(value, Mapping) else value


class _Refused(Exception):
    """What is wrong with values that are JSON."""


def _different_keys(pairs: list[tuple[str, object]]) -> dict[str, Any]:
    data = dict(pairs)
    if len(data) < len(pairs):
        keys = [key for key, _ in pairs]
        twice = next(key for key in keys if keys.count(key) > 1)
        raise _Refused(f"must hold every key of an object once. Got {ascii(twice)[:60]} twice.")
    return data


def _check_depth_and_text(data: Any) -> None:
    """Walk through all values without recursion, so that depth cannot hurt."""
    level = [data]
    depth = 0
    while level:
        depth += 1
        if depth > _DEEPEST:
            raise _Refused(f"must be nested at most {_DEEPEST} deep. Got more.")
        below = []
        for value in level:
            if isinstance(value, dict):
                below += [*value, *value.values()]
            elif isinstance(value, list):
                below += value
            elif isinstance(value, str) and not value.isascii():
                _check_text(value)
        level = below


def _check_text(text: str) -> None:
    try:
        text.encode()
    except UnicodeEncodeError:
        raise _Refused(
            f"must hold text of whole characters. Got half of one in {ascii(text)[:60]}."
        ) from None
