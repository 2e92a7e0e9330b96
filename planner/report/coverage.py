"""What of a drawing a plan covers: each requirement in its frame, ticked or crossed, with the reason.

A requirement is written as a drawing writes it: the symbol of its characteristic, its value or zone, and its datums in
boxes. Characteristics of one pattern are one requirement.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, NamedTuple

from planner.request.dimension import POSITIONS, zone_text
from planner.request.targets import Target, targets_of
from planner.request.words import frame_of, tolerance_text
from planner.text_table import count

if TYPE_CHECKING:
    from markupsafe import Markup

    from planner.plan import InspectionPlan

_SYMBOLS = {
    "angle": "∠",
    "angularity": "∠",
    "centre_distance": "↔",
    "centre_to_edge": "↔",
    "coaxiality": "◎",
    "circular run-out": "↗",
    "diameter": "⌀",
    "distance": "↔",
    "flatness": "▱",
    "length": "↔",
    "parallelism": "∥",
    "perpendicularity": "⊥",
    "position": "⊕",
    "radius": "R",
    "roundness": "○",
    "symmetry": "≡",
    "width_position": "⊕",
}
"""Symbols of characteristics like those of ISO 1101 and ISO 129, of characters that every font has."""

ALL = "✓"
SOME = "◐"
NONE = "✗"

_SHORT = 60
"""Reasons of up to so many characters may be repeated."""

_CLASSES = {ALL: "good", SOME: "open", NONE: "bad"}


class Covered(NamedTuple):
    """A requirement, and whether the plan covers it.

    Attributes
    ----------
    mark : str
        `ALL`, `SOME` or `NONE` of its characteristics are inspected.
    style : str
        Class of the page: "good", "open" or "bad".
    name : str
        Its name.
    boxes : list of str
        Symbol, value or zone, and datums; empty if the plan does not hold them.
    text : str
        Which settings measure it, or why none does.
    """

    mark: str
    style: str
    name: str
    boxes: list[str]
    text: str


def coverage(plan: InspectionPlan) -> list[Covered]:
    """Return what is asked of the part, each with whether the plan covers it.

    Parameters
    ----------
    plan : InspectionPlan
        The plan.

    Returns
    -------
    list of Covered
        The targets in their order, then what the model requires and the plan leaves out. A long reason stands once.
    """
    groups: dict[str, list[str]] = {}
    for name in plan.entities:
        groups.setdefault(requirement_name(name), []).append(name)
    settings: dict[str, list[int]] = {}
    for number, setting in enumerate(plan.settings, start=1):
        for name in setting.entities:
            settings.setdefault(name, []).append(number)
    for name in plan.unlit:
        del settings[name]
    rows = [_of_targets(plan, name, members, settings) for name, members in groups.items()]
    rows += [
        Covered(NONE, _CLASSES[NONE], name, _boxes_left_out(reason), reason)
        for name, reason in plan.not_planned.items()
    ]
    return _said_once(rows)


def _said_once(rows: Iterable[Covered]) -> list[Covered]:
    """Return the rows with each long reason once; further rows name the first one that has it."""
    first: dict[str, str] = {}
    result = []
    for row in rows:
        if row.mark == NONE and len(row.text) > _SHORT:
            if row.text in first:
                row = row._replace(text=f"the same as of {first[row.text]}")
            else:
                first[row.text] = row.name
        result.append(row)
    return result


def requirement_name(name: str) -> str:
    """Return the name of the requirement that a characteristic is from, such as "bolts" of "bolts [2 of 6]".

    Parameters
    ----------
    name : str
        Name of a target.
    """
    head, bracket, tail = name.rpartition(" [")
    return head if bracket and tail.endswith("]") and " of " in tail else name


def _of_targets(
    plan: InspectionPlan, name: str, members: Sequence[str], settings: dict[str, list[int]]
) -> Covered:
    inspected = [member for member in members if member in settings]
    mark = NONE
    if inspected:
        mark = ALL if len(inspected) == len(members) else SOME
    # a target that several settings show is taken from the first, or from one for each of its entities
    shown_by = [
        settings[member] if member in plan.ends else settings[member][:1] for member in inspected
    ]
    numbers = sorted(set(itertools.chain.from_iterable(shown_by)))
    texts = []
    if len(members) > 1:
        texts.append(f"{len(inspected)} of {len(members)}")
    if numbers:
        shown = ", ".join(map(str, numbers))
        texts.append(f"{'setting' if len(numbers) == 1 else 'settings'} {shown}")
    reasons = [
        str(plan.uninspectable[member]) for member in members if member in plan.uninspectable
    ]
    texts += dict.fromkeys(reasons)
    apart = [joined_settings(plan, member) for member in members if member not in settings]
    if any(apart):
        shown = ", ".join(map(str, sorted(set(itertools.chain.from_iterable(apart)))))
        texts.append(f"settings {shown} show its rim and datums apart, so measure may read it")
    if set(plan.unlit) & set(members):
        texts.append("no lamp shows it")
    boxes = boxes_of(plan.targets[members[0]])
    if len(members) > 1:
        boxes[0] = f"{len(members)}× {boxes[0]}"
    return Covered(mark, _CLASSES[mark], name, boxes, "; ".join(texts))


def joined_settings(plan: InspectionPlan, name: str) -> list[int]:
    """Return the numbers, from 1, of settings that together show the rim and datums of a position which none inspects.

    From registered images of these, `planner.measure` reads the position. A plan promises nothing of it, because its
    probability is that of two components over several poses.

    Parameters
    ----------
    plan : InspectionPlan
        The plan.
    name : str
        Name of a target.

    Returns
    -------
    list of int
        Empty if it is no position, or an entity is in no setting.
    """
    target = plan.targets[name]
    if target.kind not in POSITIONS:
        return []
    shown: dict[str, int] = {}
    for number, setting in enumerate(plan.settings, start=1):
        here = targets_of(plan.targets, setting)
        for entity in itertools.chain(*(here[other].entities for other in setting.entities)):
            shown.setdefault(entity, number)
    numbers = {shown.get(entity, 0) for entity in target.entities}
    return [] if 0 in numbers or len(numbers) < 2 else sorted(numbers)


def boxes_of(target: Target) -> list[str]:
    """Return the boxes of a requirement as a drawing has them.

    Parameters
    ----------
    target : Target
        What is asked.

    Returns
    -------
    list of str
        Symbol; value with its tolerance, or zone; and the datums in their order.
    """
    symbol = _SYMBOLS.get(target.kind, target.kind.replace("_", " "))
    if target.kind not in POSITIONS or target.tolerance is None:
        tolerance = "" if target.tolerance is None else f" {tolerance_text(target.tolerance)}"
        unit = "°" if target.unit == "deg" else ""
        return [symbol, f"{target.nominal:.6g}{unit}{tolerance}"]
    return [symbol, zone_of(target), *target.datum_names]


def _boxes_left_out(reason: str) -> list[str]:
    """Return the boxes of a requirement that is not planned; empty if the plan does not hold them."""
    if not (frame := frame_of(reason)):
        return []
    kind, *others = frame
    return [_SYMBOLS.get(kind, kind.replace("_", " ")), *others]


def zone_of(target: Target) -> str:
    """Return the zone of a position with its material condition, such as ⌀0.2 (M)."""
    assert target.tolerance is not None, "a position has a zone"
    condition = "" if target.material is None else f" ({target.material.condition})"
    return f"{zone_text(target.kind, target.tolerance[1])}{condition}"


def verdict_text(rows: Iterable[Covered]) -> str:
    """Return how many requirements are covered, in a sentence.

    Parameters
    ----------
    rows : iterable of Covered
        See `coverage`.
    """
    every = list(rows)
    n_all = sum(row.mark == ALL for row in every)
    n_some = sum(row.mark == SOME for row in every)
    parts = f" {count(n_some, 'requirement')} in part." if n_some else ""
    return f"{n_all} of {count(len(every), 'requirement')} covered.{parts}"


def coverage_html(plan: InspectionPlan) -> Markup:
    """Return the requirements as a page shows them: frames with a tick or a cross, and the reason.

    Parameters
    ----------
    plan : InspectionPlan
        The plan.
    """
    from ground.templates import render

    rows = coverage(plan)
    return render(
        "planner", "report/templates/coverage.html", rows=rows, sentence=verdict_text(rows)
    )
