"""Entities by rule: ``"length > 20 and face = top and convex"``.

Conditions are joined by *and*. Each is one of

==========================================  =======================================================================
``length > 20``                             mm of an edge; of a rim or arc, its radius
``radius <= 5``                             mm, of rims and arcs only
``turn <= 90``                              degrees
``convex``, ``reentrant``                   by the sign of the turn
``kind = edge`` (``rim``, ``arc``, ``any``)  without it, edges; with ``radius``, rims and arcs
``direction = x`` (``y``, ``z``, ``1,0,2``)  parallel within half a degree, of a rim or arc its axis
``face = top`` (``bottom``, ``left``, …)    all of it on that side of the part's box: top is +z, right +x, back +y
``near 10,20,30 < 5``                       distance from a point, mm
==========================================  =======================================================================

A unit may follow a number, ``mm`` or ``deg``. An error names the condition that was probably meant.
"""

from __future__ import annotations

import operator
import re
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aspectgraph.exceptions import EntityError
from aspectgraph.solid.rims import Rim
from aspectgraph.solid.solid import Solid, check_solid

PARALLEL_DEG = 0.5
"""Largest angle between an edge and a direction to which it counts as parallel, degrees."""

ON_SIDE = 1e-6
"""Largest distance from a side of the part's box, as a fraction of its diagonal, to count as on it."""

_COMPARE: dict[str, Callable[[float, float], bool]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}
_SIDES = {
    "left": (0, 0),
    "right": (1, 0),
    "front": (0, 1),
    "back": (1, 1),
    "bottom": (0, 2),
    "top": (1, 2),
}
_AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?"
_POINT = rf"{_NUMBER}(?:\s*,\s*{_NUMBER}){{2}}"
_KINDS = ("edge", "rim", "arc")
_KIND = re.compile(r"kind\s*=\s*(edge|rim|arc|any)")
_SIZE = re.compile(rf"(length|radius)\s*(<=|>=|<|>)\s*({_NUMBER})\s*(?:mm)?")
_Test = Callable[["_Candidate"], bool]


@dataclass(frozen=True)
class _Candidate:
    """An edge, rim or arc with what rules ask of it: lengths in mm, points (n, 3) in mm, angle in degrees."""

    id: int | str
    kind: str
    size_mm: float
    turn_deg: float
    points: NDArray[np.float64]
    along: NDArray[np.float64]


def select_entities(solid: Solid, rule: str) -> list[int | str]:
    """Return the ids of the edges, rims and arcs that satisfy a rule.

    Parameters
    ----------
    solid : Solid
        The part.
    rule : str
        Conditions joined by *and*: ``length > 20``, ``radius > 5``, ``turn < 100``, ``convex``,
        ``reentrant``, ``kind = rim``, ``direction = z``, ``face = top``, ``near 10,20,30 < 5``.
        A rule with ``radius`` selects rims and arcs. Any other rule without ``kind`` selects edges.

    Returns
    -------
    list of int or str
        Ids for `resolve_entities`: edges, then rims, then arcs, each in order.

    Raises
    ------
    EntityError
        If a condition is not one of these, or no entity satisfies all conditions.

    Examples
    --------
    >>> from aspectgraph import read_solid, select_entities
    >>> block = read_solid("examples/two_pocket_block.off")
    >>> select_entities(block, "length >= 60 and face = bottom")
    [0, 5, 20, 22]
    """
    check_solid(solid)
    conditions = _conditions(rule)
    tests = [_test(text, solid) for text in conditions]
    kinds = _selected_kinds(conditions)
    selected = [
        candidate.id
        for candidate in _candidates(solid)
        if candidate.kind in kinds and all(test(candidate) for test in tests)
    ]
    if not selected:
        named = ", ".join(kind for kind in _KINDS if kind in (kinds or _KINDS))
        named = " or ".join(named.rsplit(", ", 1))
        raise EntityError.of_rule(
            "select", f"must hold for at least one {named}", f"none for {rule!r}"
        )
    return selected


def check_selection(rule: str) -> None:
    """Refuse a rule that means nothing, before there is a part.

    Parameters
    ----------
    rule : str
        As `select_entities` takes it.

    Raises
    ------
    EntityError
        If a condition is none of those that there are.
    """
    for text in _conditions(rule):
        _test(text, None)


def _selected_kinds(conditions: list[str]) -> set[str]:
    """Return the kinds of entity that conditions can hold for."""
    kinds = set(_KINDS)
    is_stated = False
    for text in map(str.lower, conditions):
        if match := _KIND.fullmatch(text):
            is_stated = True
            kinds &= kinds if match[1] == "any" else {match[1]}
        elif (match := _SIZE.fullmatch(text)) and match[1] == "radius":
            is_stated = True
            kinds -= {"edge"}
    return kinds if is_stated else {"edge"}


def _conditions(rule: str) -> list[str]:
    parts = re.split(r"\s+and\s+", rule.strip(), flags=re.IGNORECASE)
    return [text.strip() for text in parts]


def _candidates(solid: Solid) -> list[_Candidate]:
    """Return all that can be measured."""
    candidates = []
    for edge in solid.straight_edges():
        ends = np.asarray(solid.edge_points(edge.id), dtype=np.float64)
        along = ends[1] - ends[0]
        candidates.append(
            _Candidate(edge.id, "edge", float(np.linalg.norm(along)), edge.turn_deg, ends, along)
        )
    for curve in (*solid.rims(), *solid.arcs()):
        kind = "rim" if isinstance(curve, Rim) else "arc"
        turn = solid.edges[curve.edge_ids[0]].turn_deg
        points = np.asarray(solid.vertices[list(curve.vertices)], dtype=np.float64)
        candidates.append(
            _Candidate(curve.id, kind, float(curve.radius_mm), turn, points, np.asarray(curve.axis))
        )
    return candidates


def _test(text: str, solid: Solid | None) -> _Test:
    """Return the test a condition stands for; without a part, what must be known of one always holds."""
    lower = text.lower()
    if lower in ("convex", "reentrant", "re-entrant"):
        sign = 1 if lower == "convex" else -1
        return lambda item: sign * item.turn_deg > 0
    if match := _SIZE.fullmatch(lower):
        compare = _COMPARE[match[2]]
        limit = float(match[3])
        return lambda item: compare(item.size_mm, limit)
    if match := re.fullmatch(rf"turn\s*(<=|>=|<|>)\s*({_NUMBER})\s*(?:deg|°)?", lower):
        compare = _COMPARE[match[1]]
        limit = float(match[2])
        return lambda item: compare(abs(item.turn_deg), limit)
    if _KIND.fullmatch(lower):
        # see `_selected_kinds`
        return lambda item: True
    if match := re.fullmatch(rf"direction\s*=\s*([xyz]|{_POINT})", lower):
        return _parallel(np.array(_AXES.get(match[1]) or _numbers(match[1])), text)
    if match := re.fullmatch(rf"face\s*=\s*({'|'.join(_SIDES)})", lower):
        return _on_side(solid, *_SIDES[match[1]]) if solid is not None else lambda item: True
    if match := re.fullmatch(rf"near\s+({_POINT})\s*<\s*({_NUMBER})\s*(?:mm)?", lower):
        point = np.array(_numbers(match[1]))
        radius = float(match[2])
        return lambda item: _distance(item, point) < radius
    raise EntityError.of_rule(
        "select",
        "must be conditions joined by 'and': length > 20, radius > 5, turn < 100, convex, "
        "reentrant, kind = rim, direction = z, face = top, near 10,20,30 < 5",
        repr(text),
        hint=_meant(text),
    )


_WORDS = (
    *("length", "radius", "turn", "convex", "reentrant", "kind", "direction", "face", "near"),
    *("edge", "rim", "arc", "any"),
    *_SIDES,
)


def _meant(text: str) -> str:
    """Return a hint with the words that were probably meant; empty if none are known."""
    import difflib

    guess = text
    for word in dict.fromkeys(re.findall(r"[A-Za-z-]{3,}", text)):
        close = difflib.get_close_matches(word.lower(), _WORDS, n=1, cutoff=0.7)
        if close and close[0] != word.lower():
            guess = re.sub(rf"(?<![A-Za-z-]){word}(?![A-Za-z-])", close[0], guess)
    if guess == text:
        return ""
    return f"{guess!r} may be meant"


def _numbers(text: str) -> list[float]:
    return [float(word) for word in text.split(",")]


def _parallel(direction: NDArray[np.float64], text: str) -> _Test:
    if not direction.any():
        raise EntityError.of_rule("direction", "must have a length", repr(text))
    unit = direction / np.linalg.norm(direction)
    threshold = np.cos(np.radians(PARALLEL_DEG))
    return lambda item: bool(abs(item.along @ unit) >= threshold * np.linalg.norm(item.along))


def _on_side(solid: Solid, which: int, axis: int) -> _Test:
    low_high = np.asarray(solid.bounds, dtype=np.float64)
    near = ON_SIDE * float(np.linalg.norm(low_high[1] - low_high[0]))
    place = low_high[which, axis]
    return lambda item: bool((abs(item.points[:, axis] - place) <= near).all())


def _distance(item: _Candidate, point: NDArray[np.float64]) -> float:
    """Return the distance of a point from the nearest chord, mm."""
    start = item.points if item.kind == "rim" else item.points[:-1]
    step = (np.roll(item.points, -1, axis=0) if item.kind == "rim" else item.points[1:]) - start
    share = np.clip(((point - start) * step).sum(axis=1) / (step**2).sum(axis=1), 0.0, 1.0)
    return float(np.linalg.norm(start + share[:, None] * step - point, axis=1).min())
