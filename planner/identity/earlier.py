"""Requests as earlier programs stored them, in the words of this one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from planner.light.lamps import RING

# a place of lamps that was all of them at once, before `Lighting` had a field for it
_TOGETHER = "LampsTogether"


def in_words_of_now(identity: Mapping[str, Any]) -> dict[str, Any]:
    """Return the stored identity of a request as this program stores it.

    Parameters
    ----------
    identity : mapping
        Of this program, or of an earlier one. What cannot be understood stays as it is.

    Returns
    -------
    dict of str to value
        A new mapping.
    """
    lighting = identity.get("lighting")
    if not isinstance(lighting, Mapping) or "lamps" not in lighting:
        return dict(identity)
    return {**identity, "lighting": {**lighting, **_lamps_of_now(lighting["lamps"])}}


def _lamps_of_now(lamps: Any) -> dict[str, Any]:
    if lamps is None:
        return {"lamps": RING}
    if isinstance(lamps, Mapping) and lamps.get("kind") == _TOGETHER:
        return {"lamps": lamps.get("lamps"), "together": True}
    return {"lamps": lamps}
