"""Values checked against the schema of the files, ``schema.json``, field by field.

The schema is plain JSON Schema (draft 2020-12), for other programs as well. Here a number must also be finite, and an
integer written as one. Unknown fields are refused: whoever adds a field raises the version, because a reader that does
not know a field cannot know what it changes, and a misspelt field would be lost silently.
"""

from __future__ import annotations

import json
import math
import re
from functools import cache
from importlib import resources
from typing import Any

from planner.exceptions import PlanFileError

_LONGEST = 60


def read_schema() -> dict[str, Any]:
    """Return the JSON Schema of plan and state files."""
    return json.loads(
        resources.files("planner.records").joinpath("schema.json").read_text(encoding="utf-8")
    )


def check_schema(data: Any, kind: str) -> None:
    """Refuse values that are not as the schema says.

    Parameters
    ----------
    data
        Plain values as JSON has them.
    kind : str
        Name of a definition of the schema, such as "plan" or "state".

    Raises
    ------
    PlanFileError
        Names the first wrong field by its path, the rule and the value.
    """
    for error in _validator(kind).iter_errors(data):
        raise PlanFileError(_message(error))


def field_name(*parts: object) -> str:
    """Return the path of a field as a reader would write it: ``settings[2].probability["long edge"]``."""
    text = ""
    for part in parts:
        if isinstance(part, int):
            text += f"[{part}]"
        elif isinstance(part, str) and re.fullmatch(r"\w[\w-]*", part) and len(part) <= _LONGEST:
            text += f".{part}" if text else part
        else:
            text += f"[{shown(part)}]"
    return text


def shown(value: object) -> str:
    """Return a value in JSON's notation, shortened to a readable length."""
    if isinstance(value, dict) and set(value) == {"not finite"}:
        value = value["not finite"]
        return {"nan": "NaN", "inf": "Infinity", "-inf": "-Infinity"}.get(str(value), shown(value))
    if isinstance(value, int) and value.bit_length() > 4 * _LONGEST:
        return f"an integer of {value.bit_length()} bits"
    text = json.dumps(value, ensure_ascii=False, default=repr)
    text = text if text.isprintable() else ascii(text)
    if len(text) <= _LONGEST:
        return text
    if isinstance(value, dict | list):
        kind, what = ("an object", "field") if isinstance(value, dict) else ("an array", "item")
        return f"{kind} of {len(value)} {what}{'s' * (len(value) != 1)}"
    return f"{text[: _LONGEST - 3]}..."


def _message(error: Any) -> str:
    """Say what is wrong: the title of a definition is the rule."""
    path = list(error.absolute_path)
    value = error.instance
    if error.validator == "required":
        missing = next(name for name in error.validator_value if name not in value)
        return f"{field_name(*path, missing)} must be given. Got none."
    if error.validator == "additionalProperties":
        known = error.schema.get("properties", {})
        unknown = next(name for name in value if name not in known)
        return (
            f"{field_name(*path, unknown)} must be one of {', '.join(known)}. Got an unknown field."
        )
    rule = error.schema["title"]
    found = _shape(value) if "shape" in rule else shown(value)
    return f"{field_name(*path) or 'file'} {rule}. Got {found}."


def _shape(value: object) -> str:
    """Return the shape of nested arrays; of arrays that differ, that of the first."""
    if not isinstance(value, list):
        return shown(value)
    shape = []
    while isinstance(value, list):
        shape.append(len(value))
        value = value[0] if value else None
    return str(tuple(shape))


@cache
def _validator(kind: str) -> Any:
    # imported where a file is read, not wherever the package is
    from jsonschema import Draft202012Validator
    from jsonschema.validators import extend

    types = {
        "number": lambda _, value: _is_number(value),
        "integer": lambda _, value: _is_integer(value),
    }
    strict = extend(
        Draft202012Validator, type_checker=Draft202012Validator.TYPE_CHECKER.redefine_many(types)
    )
    return strict({"$ref": f"#/$defs/{kind}", "$defs": read_schema()["$defs"]})


def _is_number(value: object) -> bool:
    """Tell whether a value is a number that a float can hold."""
    return math.isfinite(value) if isinstance(value, float) else _is_integer(value)


def _is_integer(value: object) -> bool:
    # larger ones are no floats, and limits are asked only of what is a number
    return isinstance(value, int) and not isinstance(value, bool) and value.bit_length() <= 1000
