"""A camera as the text of a TOML file."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any


def toml_text(fields: Mapping[str, Any]) -> str:
    """Return fields as TOML, one to a line; None is left out, because TOML has no word for it.

    Parameters
    ----------
    fields : mapping of str to value
        Texts, numbers, and sequences of them.
    """
    lines = [f"{key} = {_value(value)}" for key, value in fields.items() if value is not None]
    return "\n".join(lines) + "\n"


def _value(value: Any) -> str:
    if isinstance(value, str):
        # TOML forbids DEL, which JSON leaves as it is
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, tuple | list):
        return f"[{', '.join(map(_value, value))}]"
    # the shortest digits that give the same number back
    return repr(value)
