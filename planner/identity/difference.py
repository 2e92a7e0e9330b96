"""In what two requests differ, in the words of the caller."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

# fields of a request that a call in Python knows under another name
_KEYWORDS = {
    "seed": "rng",
    "lighting": "lamps",
    "ring": "space",
    # the default of the margin is a reserve for each point
    "focus_reserve": "focus_margin_mm",
}
# fields whose own fields are the words of the caller
_GROUPS = ("requirements", "showing", "lighting")
_UNNAMED = "unnamed"
# what a user calls the entities of a target
_IN_WORDS = "entities in words"


def keyword(field: str) -> str:
    """Return the name under which `plan_inspection` takes a field of a request."""
    return _KEYWORDS.get(field, field)


def first_difference(
    now: Mapping[str, Any],
    before: Mapping[str, Any],
    words: Callable[[str], str] = str,
    tolerance: float = 0.0,
) -> str | None:
    """Return the first difference of two identities, or None if they are of the same request.

    Parameters
    ----------
    now, before : mapping
        Identities of two requests.
    words : callable
        Returns what the caller calls a keyword of `plan_inspection`. Default: its name.
    tolerance : float
        Relative difference up to which two numbers are the same.

    Returns
    -------
    str or None
        Such as ``seed was 5 and is now 6``.
    """
    change = _first_change((), _by_name(now), _by_name(before), tolerance)
    if change is not None:
        return _described(change, words)
    orders = [[target["name"] for target in one.get("targets") or ()] for one in (now, before)]
    return None if orders[0] == orders[1] else "the order of the targets changed"


class _Change(NamedTuple):
    """The names of the fields that lead to a difference, and both values."""

    path: tuple[str, ...]
    now: Any
    before: Any


def _by_name(identity: Mapping[str, Any]) -> dict[str, Any]:
    """Return an identity with its targets by name, each with its entities in words."""
    targets = identity.get("targets")
    if targets is None:
        return dict(identity)
    named = {target["name"]: {_IN_WORDS: _entities_of(target), **target} for target in targets}
    return {**identity, "targets": named}


def _first_change(path: tuple[str, ...], now: Any, before: Any, tolerance: float) -> _Change | None:
    """Return the first thing that differs in two plain values; what is not there is None."""
    if isinstance(now, Mapping) and isinstance(before, Mapping):
        if _UNNAMED in now or _UNNAMED in before:
            # nobody can know whether these are the same
            return _Change(path, None, None)
        keys = list(dict.fromkeys([*before, *now]))
        if path:
            # a number of its own says more than one inside a record
            keys.sort(key=lambda key: isinstance(before.get(key, now.get(key)), Mapping))
        changes = (
            _first_change((*path, key), now.get(key), before.get(key), tolerance) for key in keys
        )
        return next((change for change in changes if change is not None), None)
    return None if _is_same(now, before, tolerance) else _Change(path, now, before)


def _is_same(now: Any, before: Any, tolerance: float) -> bool:
    if isinstance(now, list | tuple) and isinstance(before, list | tuple):
        return len(now) == len(before) and all(
            _first_change((), *pair, tolerance) is None for pair in zip(now, before, strict=True)
        )
    if isinstance(now, int | float) and isinstance(before, int | float):
        return now == before or math.isclose(now, before, rel_tol=tolerance, abs_tol=0.0)
    return bool(now == before)


def _described(change: _Change, words: Callable[[str], str]) -> str:
    """Say what changed: a keyword of the caller's, a target, or something inside one."""
    if change.path == ("part", "digest"):
        return "the shape of the part changed"
    field, *inside = [name for name in change.path if name not in _GROUPS] or change.path[-1:]
    values = _values(change)
    if field == "part":
        return f"the part {values or 'changed'}"
    if field == "targets" and inside:
        subject = f"target {inside.pop(0)!r}"
        if not inside:
            return f"{subject} is {'new' if change.before is None else 'no longer wanted'}"
        if inside == [_IN_WORDS]:
            return f"{subject} was {change.before} and is now {change.now}"
    else:
        subject = "the targets" if field == "targets" else words(keyword(field))
    if inside and values:
        what = " of ".join(reversed(inside)).replace("_", " ")
        return f"{subject} changed: {what} {values}"
    return f"{subject} {values or 'changed'}" if not inside else f"{subject} changed"


def _values(change: _Change) -> str:
    """Return a sentence with both values, if they are short."""
    if change.before == change.now or not (_is_short(change.before) and _is_short(change.now)):
        return ""
    return f"was {_text(change.before)} and is now {_text(change.now)}"


def _is_short(value: object) -> bool:
    if isinstance(value, list | tuple):
        return len(value) <= 3 and all(isinstance(item, int | float) for item in value)
    return value is None or isinstance(value, str | int | float)


def _text(value: object) -> str:
    if value is None:
        return "not given"
    if isinstance(value, bool):
        return "on" if value else "off"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_text, value))}]"
    return f"{value:.9g}" if isinstance(value, float) else repr(value)


def _entities_of(target: Mapping[str, Any]) -> str:
    """Return the ids of a target's entities as a user gives them."""
    return ", ".join(
        f"{entity['kind']} of edges {entity['edges']}"
        if len(entity["edges"]) > 1
        else f"{entity['kind']} {''.join(map(str, entity['edges']))}"
        for entity in target.get("entities", ())
    )
