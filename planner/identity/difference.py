"""In what two requests differ, in the words of the caller."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

# what a call in Python knows the fields of a request as, where it is not their own name
KEYWORDS = {
    "targets": "entities",
    "part": "solid",
    "seed": "rng",
    "lighting": "lamps",
    "ring": "space",
    # the default of the margin is a reserve for each point
    "focus_reserve": "focus_margin_mm",
}


def keyword(name: str) -> str:
    """Return what a call of `plan_inspection` knows a field as."""
    return KEYWORDS.get(name, name)


# fields whose own fields are the words of the caller
_GROUPS = ("requirements", "showing", "lighting")
_UNSURE = "unnamed"


class Change(NamedTuple):
    """The first thing in which two requests differ.

    Attributes
    ----------
    path : tuple of str
        Where: names of fields.
    before, now
        The two values.
    """

    path: tuple[str, ...]
    before: Any
    now: Any


def first_difference(
    now: Mapping[str, Any],
    before: Mapping[str, Any],
    words: Callable[[str], str] = keyword,
    *,
    tolerance: float = 0.0,
    partial: bool = False,
) -> str | None:
    """Return in what two identities differ, or None if they are of the same request.

    Parameters
    ----------
    now, before : mapping
        Identities of two requests.
    words : callable
        Returns what the caller knows a field as.
    tolerance : float
        Share by which numbers may differ, which were computed on another machine.
    partial : bool
        Whether ``before`` tells only of some fields, as plans of earlier programs do: of the others nothing is known.

    Returns
    -------
    str or None
        Such as ``seed was 5 and is now 6``.
    """
    for name in dict.fromkeys([*now, *before]):
        if name in now and name in before:
            compare = _Comparison(tolerance, partial)
            if name == "targets":
                found = _targets(now[name], before[name], compare)
            else:
                change = compare.first_change((name,), now[name], before[name])
                found = None if change is None else _described(change, words)
            if found is not None:
                return found
        elif not partial:
            return _described(Change((name,), before.get(name), now.get(name)), words)
    return None


class _Comparison(NamedTuple):
    tolerance: float
    partial: bool

    def first_change(self, path: tuple[str, ...], now: Any, before: Any) -> Change | None:
        """Return the first thing that differs in two plain values."""
        if isinstance(now, Mapping) and isinstance(before, Mapping):
            if _UNSURE in now or _UNSURE in before:
                # nobody can know whether these are the same
                return Change(path, None, None)
            for key in dict.fromkeys([*now, *before]):
                if self.partial and key not in before:
                    continue
                change = self.first_change((*path, key), now.get(key), before.get(key))
                if change is not None:
                    return change
            return None
        if isinstance(now, list | tuple) and isinstance(before, list | tuple):
            same = len(now) == len(before) and all(
                self.first_change(path, *pair) is None for pair in zip(now, before, strict=True)
            )
            return None if same else Change(path, before, now)
        return None if self._same(now, before) else Change(path, before, now)

    def _same(self, first: Any, second: Any) -> bool:
        if first is second or first == second:
            return True
        if isinstance(first, int | float) and isinstance(second, int | float):
            return math.isclose(first, second, rel_tol=self.tolerance, abs_tol=0.0)
        return False


def _described(change: Change, words: Callable[[str], str]) -> str:
    """Say what changed: a field of the caller's, or something inside one."""
    if change.path == ("part", "digest"):
        return "the shape of the part changed"
    if change.path == ("part", "name"):
        return f"the part {_values(change)}"
    names = [name for name in change.path if name not in _GROUPS]
    if not names:
        return f"{words(change.path[-1])} changed"
    values = _values(change)
    if len(names) == 1:
        return f"{words(names[0])} {values or 'changed'}"
    inside = " of ".join(reversed([name.replace("_", " ") for name in names[1:]]))
    return f"{words(names[0])} changed" + (f": {inside} {values}" if values else "")


def _values(change: Change) -> str:
    """Return a sentence with both values, if they are short."""
    if change.before == change.now or not all(map(_is_short, (change.before, change.now))):
        return ""
    return f"was {_text(change.before)} and is now {_text(change.now)}"


def _is_short(value: object) -> bool:
    return value is None or isinstance(value, str | int | float)


def _text(value: object) -> str:
    if value is None:
        return "not given"
    if isinstance(value, bool):
        return "on" if value else "off"
    return f"{value:.9g}" if isinstance(value, float) else repr(value)


def _targets(now: Any, before: Any, compare: _Comparison) -> str | None:
    """Say which target differs, and in what."""
    if now is None or before is None:
        return None if now is before else "the targets changed"
    first = {target["name"]: target for target in before}
    second = {target["name"]: target for target in now}
    for name in first:
        if name not in second:
            return f"target {name!r} is no longer wanted"
    for name, target in second.items():
        if name not in first:
            return f"target {name!r} is new"
        change = compare.first_change((), target, first[name])
        if change is not None:
            return f"target {name!r} {_change_of(change, target, first[name])}"
    if list(first) != list(second):
        return "the order of the targets changed"
    return None


def _change_of(change: Change, now: Mapping[str, Any], before: Mapping[str, Any]) -> str:
    """Say in what a target differs."""
    if change.path[:1] in (("ends",), ("entities",)):
        were = _entities_of(before)
        are = _entities_of(now)
        if were and are and were != are:
            return f"was {were} and is now {are}"
        return "is another one"
    what = " of ".join(reversed([name.replace("_", " ") for name in change.path]))
    if isinstance(change.before, Sequence) and isinstance(change.now, Sequence):
        return f"changed: {what} was {list(change.before)} and is now {list(change.now)}"
    return f"changed: {what} {_values(change)}"


def _entities_of(target: Mapping[str, Any]) -> str:
    """Return the ids of a target's entities as a user gives them."""
    return ", ".join(
        f"{entity['kind']} of edges {entity['edges']}"
        if len(entity["edges"]) > 1
        else f"{entity['kind']} {''.join(map(str, entity['edges']))}"
        for entity in target.get("entities", ())
    )
