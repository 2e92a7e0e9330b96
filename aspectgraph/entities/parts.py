"""Parts of entities: stretches of straight edges and runs of rims and arcs, as values with a text form.

A stretch reaches from one share of its edge's length to another, counted from the edge's first vertex: ``17[1/4:1/2]``.
A run reaches from one joint of a rim's or arc's chords to another, counted from 0: ``r11[3:22]`` holds the chords 3 to
21. On a rim it may pass joint 0: ``r11[22:3]``. So two parts that follow each other share their cut.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from fractions import Fraction
from operator import index
from typing import Any

from aspectgraph.exceptions import EntityError

FINEST_CUT = 1 << 20
"""Largest denominator of a stretch's ends: the grid has no more steps over the part."""

_MAY_BE = "must be a part of an edge, rim or arc, such as 17[0:1/4] or r11[3:22]"
_SHARE = r"\d{1,7}(?:/\d{1,7})?"
_STRETCH = re.compile(rf"e?(\d{{1,300}})\[({_SHARE}):({_SHARE})\]", re.ASCII)
_RUN = re.compile(r"([ra]\d{1,300})\[(\d{1,9}):(\d{1,9})\]", re.ASCII)
_WHOLE = re.compile(r"(?:[ra]|e?)\d{1,300}", re.ASCII)


@dataclass(frozen=True)
class Stretch:
    """A stretch of a straight edge.

    Parameters
    ----------
    edge : int
        Id of the edge.
    start, end : Fraction, int, (int, int) or str
        Shares of the edge's length from its first vertex, 0 ≤ start < end ≤ 1: ``Fraction(1, 4)``,
        ``(1, 4)`` or ``"1/4"``.

    Attributes
    ----------
    edge : int
        Id of the edge.
    start, end : Fraction
        Shares of the edge's length from its first vertex.

    Raises
    ------
    EntityError
        If the shares are out of order, not exact, or those of the whole edge.

    Examples
    --------
    >>> from aspectgraph import Stretch
    >>> str(Stretch(17, 0, "1/4"))
    '17[0:1/4]'
    """

    edge: int
    start: Fraction
    end: Fraction

    def __post_init__(self) -> None:
        object.__setattr__(self, "edge", _count(self.edge, "edge"))
        for name in ("start", "end"):
            object.__setattr__(self, name, _share(getattr(self, name), name))
        if not 0 <= self.start < self.end <= 1:
            raise EntityError.of_rule(
                "start and end", "must be in order and in 0..1", f"{self.start} and {self.end}"
            )
        if self.end - self.start == 1:
            raise EntityError.of_rule(
                "start and end", "must leave out a part of the edge", f"0 and 1 of edge {self.edge}"
            )

    @property
    def share(self) -> Fraction:
        """Share of the edge's length."""
        return self.end - self.start

    @property
    def name(self) -> str:
        """Default name of its entity, ``"e17[0:1/4]"``."""
        return f"e{self}"

    def __str__(self) -> str:
        """Return the text form, which `parse_part` reads."""
        return f"{self.edge}[{self.start}:{self.end}]"


@dataclass(frozen=True)
class Run:
    """A run of a rim or an arc: consecutive chords.

    Parameters
    ----------
    curve : str
        Id of the rim or arc.
    first, last : int
        The joints where it starts and ends, counted from 0 along the curve's `vertices`. On a rim
        it may pass joint 0.

    Raises
    ------
    EntityError
        If the joints are the same, or in the wrong order on an arc.

    Examples
    --------
    >>> from aspectgraph import Run
    >>> str(Run("r11", 3, 22))
    'r11[3:22]'
    """

    curve: str
    first: int
    last: int

    def __post_init__(self) -> None:
        if not isinstance(self.curve, str) or not re.fullmatch(
            r"[ra]\d{1,300}", self.curve, re.ASCII
        ):
            raise EntityError.of_rule(
                "curve", "must be the id of a rim or arc, such as r11", repr(self.curve)
            )
        for name in ("first", "last"):
            object.__setattr__(self, name, _count(getattr(self, name), name))
        if self.first == self.last or (self.curve[0] == "a" and self.first > self.last):
            raise EntityError.of_rule(
                "first and last",
                "must be two joints, on an arc in order",
                f"{self.first} and {self.last} of {self.curve}",
            )

    @property
    def name(self) -> str:
        """Default name of its entity, its text form."""
        return str(self)

    def __str__(self) -> str:
        """Return the text form, which `parse_part` reads."""
        return f"{self.curve}[{self.first}:{self.last}]"


Part = Stretch | Run
"""A part of an entity."""


def _count(value: Any, name: str) -> int:
    try:
        whole = -1 if isinstance(value, bool) else index(value)
    except TypeError:
        whole = -1
    if whole < 0:
        raise EntityError.of_rule(name, "must be a whole number from 0", repr(value)[:80])
    return whole


def _share(value: Any, name: str) -> Fraction:
    """Return an exact share: a rounded one would not say where the cut is."""
    try:
        if isinstance(value, bool | float):
            raise TypeError
        share = Fraction(*value) if isinstance(value, tuple) else Fraction(value)
    except (TypeError, ValueError, ZeroDivisionError):
        raise EntityError.of_rule(
            name, "must be an exact share such as '1/4' or (1, 4)", repr(value)[:80]
        ) from None
    if share.denominator > FINEST_CUT:
        raise EntityError.of_rule(
            name, f"must have a denominator of at most {FINEST_CUT}", str(share)[:80]
        )
    return share


def is_part_text(value: object) -> bool:
    """Return whether something looks like the text form of a part: an id and a pair in brackets."""
    return isinstance(value, str) and bool(_STRETCH.fullmatch(value) or _RUN.fullmatch(value))


def parse_part(text: str) -> Part:
    """Read the text form of a part.

    Parameters
    ----------
    text : str
        ``"17[0:1/4]"``, ``"e17[0:1/4]"`` or ``"r11[3:22]"``.

    Returns
    -------
    Stretch or Run
        The part; ``str`` of it is the text again, without the ``e``.

    Raises
    ------
    EntityError
        If the text has another form, or its numbers break a rule of `Stretch` or `Run`.

    Examples
    --------
    >>> from aspectgraph import parse_part
    >>> parse_part("17[0:1/4]").end
    Fraction(1, 4)
    """
    if isinstance(text, str):
        stretch = _STRETCH.fullmatch(text)
        if stretch:
            return Stretch(int(stretch[1]), stretch[2], stretch[3])  # type: ignore[arg-type]  # made exact
        run = _RUN.fullmatch(text)
        if run:
            return Run(run[1], int(run[2]), int(run[3]))
    raise EntityError.of_rule("part", _MAY_BE, repr(text)[:80])


def entity_order(entity_id: int | str | Part) -> tuple[int, int, Any, Any]:
    """Return a key that sorts ids of entities and parts: edges, rims, arcs, each before its parts.

    Parameters
    ----------
    entity_id : int, str, Stretch or Run
        An id, or a part or its text form.

    Returns
    -------
    tuple
        For ``sorted``.

    Raises
    ------
    EntityError
        If it is none of these.

    Examples
    --------
    >>> from aspectgraph import Stretch, entity_order
    >>> sorted(["r2", 17, Stretch(17, 0, "1/4"), "r2[0:5]", 3], key=entity_order)[1:3]
    [17, Stretch(edge=17, start=Fraction(0, 1), end=Fraction(1, 4))]
    """
    part = parse_part(entity_id) if is_part_text(entity_id) else entity_id  # type: ignore[arg-type]
    if isinstance(part, Stretch):
        return 0, part.edge, part.start, part.end
    if isinstance(part, Run):
        return "era".index(part.curve[0]), int(part.curve[1:]), part.first, part.last
    text = str(part)
    if isinstance(part, bool) or not _WHOLE.fullmatch(text):
        raise EntityError.of_rule(
            "entity_id", "must be the id of an edge, rim or arc, or a part", repr(part)[:80]
        )
    kind = text[0] if text[0] in "ra" else "e"
    return "era".index(kind), int(text.lstrip("era")), -1, -1
