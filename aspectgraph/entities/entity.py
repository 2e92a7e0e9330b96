"""Entities of interest: straight edges, named and picked by id or by end points, and rims and arcs, picked by id."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import lru_cache
from itertools import pairwise
from math import ceil, floor
from operator import index
from typing import Any

import numpy as np

from aspectgraph.exceptions import EntityError
from aspectgraph.solid.checks import FARTHEST_MM
from aspectgraph.solid.rims import Arc, Circle, FloatArray, Rim, angles_of
from aspectgraph.solid.solid import Solid, check_solid
from aspectgraph.solid.topology import Edge, describe_point
from ground.short_repr import short_repr

# Parts of entities: stretches of straight edges and runs of rims and arcs, as values with a text
# form.
#
# A stretch reaches from one share of its edge's length to another, counted from the edge's first
# vertex: ``17[1/4:1/2]``. A run reaches from one joint of a rim's or arc's chords to another,
# counted from 0: ``r11[3:22]`` holds the chords 3 to 21. On a rim it may pass joint 0:
# ``r11[22:3]``. So two parts that follow each other share their cut.


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
        object.__setattr__(self, "edge", _count(edge_number(self.edge), "edge"))
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


# Rims and arcs of a solid, picked by id or as objects.


# Python reads no integer of more than some thousand digits
_CURVE_ID = re.compile(r"[ra]\d{1,300}", re.ASCII)
_EDGE_ID = re.compile(r"e\d{1,300}", re.ASCII)


def is_curve_id(target: object) -> bool:
    """Return whether something is the id of a rim or an arc: ``"r0"`` or ``"a0"``, ``"r1"`` or ``"a1"`` and so on."""
    return isinstance(target, str) and _CURVE_ID.fullmatch(target) is not None


def edge_number(target: Any) -> Any:
    """Return the id of an edge that is written as tables show it, such as "e17"; all else as it is.

    Parameters
    ----------
    target : object
        What stands for an entity.
    """
    is_edge = isinstance(target, str) and _EDGE_ID.fullmatch(target)
    return int(target[1:]) if is_edge else target


def for_name(name: str, entity: object) -> str:
    """Return which name stands for an entity, to end a message; empty where it is named like itself."""
    if name == entity:
        return ""
    return f" for {name!r}"


@lru_cache(maxsize=2)
def _curves_of(solid: Solid) -> dict[str, Arc]:
    """Return all rims and arcs of a solid by id: each of hundreds of dimensions looks for its own."""
    return {curve.id: curve for curve in (*solid.rims(0.0), *solid.arcs(0.0))}


def find_curve(solid: Solid, target: str | Arc, name: str, min_dihedral_deg: float) -> Arc:
    """Return the rim or arc of a solid that an id or an object stands for.

    Parameters
    ----------
    solid : Solid
        The part.
    target : str or Rim or Arc
        Its id, or itself.
    name : str
        Of the entity, for messages.
    min_dihedral_deg : float
        Smallest turn of the normal across its chords.

    Raises
    ------
    EntityError
        The solid has no such rim or arc, or it is blunter.
    """
    curves = _curves_of(solid)
    curve_id = target if isinstance(target, str) else target.id
    match = curves.get(curve_id)
    if match is None or not (isinstance(target, str) or match == target):
        n_rims, n_arcs = (
            sum(isinstance(c, Rim) is is_rim for c in curves.values()) for is_rim in (True, False)
        )
        raise EntityError(
            f"a rim or arc must be one of the solid's {n_rims} rims and {n_arcs} arcs, r0, r1, … and a0, a1, …. "
            f"Got {curve_id!r}{for_name(name, curve_id)}{'' if match is None else ', that of another solid'}."
            f"{_of_choice(solid)}"
        )
    if match.dihedral_deg < min_dihedral_deg:
        raise EntityError(
            f"an entity's faces must turn by at least {min_dihedral_deg:g} degrees. "
            f"Got {match.dihedral_deg:.3g} at {match.id} for {name!r}."
        )
    return match


def curve_points(solid: Solid, curve: Arc) -> FloatArray:
    """Return the ends of a rim's or arc's chords in order, shape (m, 3)."""
    return np.asarray(solid.vertices[list(curve.vertices)], dtype=np.float64)


def curve_ends(points: FloatArray, curve: Arc) -> FloatArray:
    """Return the two ends of an arc, or two opposite points of a rim, shape (2, 3)."""
    other = len(points) // 2 if isinstance(curve, Rim) else len(points) - 1
    return np.asarray(points[[0, other]], dtype=np.float64)


# Which parts of edges, rims and arcs are worth looking at: the default pieces of each.


MOST_PIECES = 12
"""Default for the largest number of pieces of an edge, and for the number of runs of a rim."""

COVERAGE = 0.8
"""Default for the share of a rim's chords that a run holds."""

# Parts whose coordinates are round have grids of many twos, so such a cut is a point of the grid.
_EVEN_CUTS = 1 << 8
_FACING_CUTS = 1 << 10
# of projected ends, in parts of a cut
_ROUNDING = 1e-6


def pieces_of_edge(
    solid: Solid,
    edge: int,
    length_mm: float,
    at_most: int = MOST_PIECES,
    cuts: Iterable[Fraction] = (),
) -> tuple[Stretch, ...]:
    """Cut an edge into stretches of about equal length.

    Parameters
    ----------
    solid : Solid
        The part.
    edge : int
        Id of the edge.
    length_mm : float
        Wanted largest length of a piece in mm.
    at_most : int
        Largest number of pieces, not counting those that `cuts` make.
    cuts : iterable of Fraction
        Further shares at which to cut the edge, such as those of `facing_cuts`.

    Returns
    -------
    tuple of Stretch
        In order along the edge, without gaps. It is empty if the whole edge is one piece.

    Raises
    ------
    EntityError
        If the solid has no such edge, or a number is out of range.

    Examples
    --------
    >>> from itertools import product
    >>> from aspectgraph import Solid, pieces_of_edge
    >>> faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    >>> box = Solid(list(product((0, 40), (0, 30), (0, 20))), faces, name="box")
    >>> [str(piece) for piece in pieces_of_edge(box, 1, 20.0)]
    ['1[0:1/2]', '1[1/2:1]']
    """
    _check_edge(solid, edge)
    if not length_mm > 0:
        raise EntityError.of_rule("length_mm", "must be positive", str(length_mm))
    if at_most < 1:
        raise EntityError.of_rule("at_most", "must be at least 1", str(at_most))
    n = int(min(at_most, max(1, ceil(solid.edge_length_mm(edge) / length_mm - 1e-9))))
    places = {_rounded(Fraction(k, n), _EVEN_CUTS) for k in range(n + 1)}
    places |= {Fraction(cut) for cut in cuts if 0 < cut < 1}
    if len(places) == 2:
        return ()
    return tuple(Stretch(edge, *ends) for ends in pairwise(sorted(places)))


def facing_cuts(solid: Solid, edge: int, other: int) -> tuple[Fraction, ...]:
    """Return where an edge begins and ceases to face another one: the other's ends, projected on it.

    Parameters
    ----------
    solid : Solid
        The part.
    edge, other : int
        Ids of the two edges.

    Returns
    -------
    tuple of Fraction
        None, one or two shares of the edge's length from its first vertex, ascending. They are
        rounded to 1/1024 of it, into the part that faces the other edge.

    Raises
    ------
    EntityError
        If the solid has no such edge.

    Examples
    --------
    >>> from aspectgraph import facing_cuts, read_solid
    >>> block = read_solid("examples/two_pocket_block.off")
    >>> [round(60 * cut, 2) for cut in map(float, facing_cuts(block, 0, 11))]
    [20.04, 39.96]
    """
    for edge_id in (edge, other):
        _check_edge(solid, edge_id)
    start, end = solid.edge_points(edge)
    along = end - start
    shares = sorted(
        sum(p * q for p, q in zip(point - start, along, strict=True)) / (along**2).sum()
        for point in solid.edge_points(other)
    )
    first = ceil(_FACING_CUTS * float(shares[0]) - _ROUNDING)
    last = floor(_FACING_CUTS * float(shares[1]) + _ROUNDING)
    if not max(first, 0) < min(last, _FACING_CUTS):
        return ()
    cuts = (Fraction(first, _FACING_CUTS), Fraction(last, _FACING_CUTS))
    return tuple(cut for cut in cuts if 0 < cut < 1)


def runs_of(curve: Arc, coverage: float = COVERAGE, at_most: int = MOST_PIECES) -> tuple[Run, ...]:
    """Return runs of a rim or arc that hold a share of its chords, evenly spread.

    Parameters
    ----------
    curve : Rim or Arc
        The rim or arc.
    coverage : float
        Least share of its chords that a run holds, above 0 and at most 1.
    at_most : int
        Largest number of runs.

    Returns
    -------
    tuple of Run
        In order of their first joint, without the whole curve.

    Raises
    ------
    EntityError
        If a number is out of range.

    Examples
    --------
    >>> from aspectgraph import read_solid, runs_of
    >>> rim = read_solid("examples/nist_ctc_01_ap242.stp").rims()[0]
    >>> [str(run) for run in runs_of(rim, 0.75, 2)]
    ['r0[0:9]', 'r0[6:3]']
    """
    if not 0 < coverage <= 1:
        raise EntityError.of_rule("coverage", "must be above 0 and at most 1", str(coverage))
    if at_most < 1:
        raise EntityError.of_rule("at_most", "must be at least 1", str(at_most))
    n = len(curve.edge_ids)
    held = ceil(coverage * n - 1e-9)
    if held >= n:
        return ()
    if isinstance(curve, Rim):
        at_most = min(at_most, n)
        firsts = [k * n // at_most for k in range(at_most)]
        return tuple(Run(curve.id, first, (first + held) % n) for first in firsts)
    spare = n - held
    steps = max(1, min(at_most - 1, spare))
    firsts = sorted({k * spare // steps for k in range(steps + 1)})[:at_most]
    return tuple(Run(curve.id, first, first + held) for first in firsts)


def _rounded(share: Fraction, parts: int) -> Fraction:
    return Fraction(round(share * parts), parts)


def _of_choice(solid: Solid) -> str:
    """Return a sentence for an id that is not there: another choice of the file's solids has other ids."""
    if solid.file_solids is None or not solid.file_solids.is_choice:
        return ""
    return " Ids are those of the chosen solids."


def _check_edge(solid: Solid, edge: int) -> None:
    if isinstance(edge, bool) or not 0 <= edge < len(solid.edges):
        raise EntityError.of_rule(
            "edge", f"must be one of the solid's, 0..{len(solid.edges) - 1}", repr(edge)
        )


# Where parts of entities lie on a solid, in mm.


def stretch_ends(solid: Solid, stretch: Stretch) -> FloatArray:
    """Return the two ends of a stretch.

    Parameters
    ----------
    solid : Solid
        The part.
    stretch : Stretch
        A stretch of one of its edges.

    Returns
    -------
    ndarray of float64, shape (2, 3)
        In mm, in the order of ``Edge.vertices``.

    Raises
    ------
    EntityError
        If the solid has no such edge.
    """
    if stretch.edge >= len(solid.edges):
        raise EntityError(
            f"an edge id must be in 0..{len(solid.edges) - 1}. Got {stretch.edge} in {stretch}."
        )
    ends = solid.edge_points(stretch.edge)
    return np.array([_at(ends, stretch.start), _at(ends, stretch.end)])


def _at(ends: FloatArray, share: Fraction) -> FloatArray:
    """Return the point at a share of the way; an end is exactly that end."""
    point = ends[1] if share == 1 else ends[0] + float(share) * (ends[1] - ends[0])
    return np.asarray(point, dtype=np.float64)


def run_arc(solid: Solid, run: Run) -> Arc:
    """Return a run as an arc of its circle.

    Parameters
    ----------
    solid : Solid
        The part.
    run : Run
        A run of one of its rims or arcs.

    Returns
    -------
    Arc
        Its id is the text form of the run.

    Raises
    ------
    EntityError
        If the solid has no such rim or arc, or that has no such joints.

    Examples
    --------
    >>> from aspectgraph import Run, read_solid, run_arc
    >>> part = read_solid("examples/nist_ctc_01_ap242.stp")
    >>> arc = run_arc(part, Run("r0", 1, 4))
    >>> arc.id, len(arc.edge_ids), len(arc.vertices)
    ('r0[1:4]', 3, 4)
    """
    curves = {curve.id: curve for curve in (*solid.rims(0.0), *solid.arcs(0.0))}
    if run.curve not in curves:
        raise EntityError.of_rule("curve", "must be one of the solid's rims or arcs", str(run))
    return run_of_curve(solid, curves[run.curve], run)


def run_of_curve(solid: Solid, curve: Arc, run: Run) -> Arc:
    """Return a run of a given rim or arc as an arc."""
    chords = run_chords(curve, run)
    joints = [*chords, chords[-1] + 1]
    n = len(curve.vertices)
    vertices = tuple(curve.vertices[joint % n] for joint in joints)
    start, span = angles_of(solid.vertices[list(vertices)], curve.circle)
    fields = {name: getattr(curve, name) for name in _OF_THE_CURVE}
    return Arc(
        id=str(run),
        edge_ids=tuple(curve.edge_ids[chord % n] for chord in chords),
        vertices=vertices,
        start_rad=start,
        end_rad=start + span,
        **fields,
    )


_OF_THE_CURVE = (
    "centre",
    "axis",
    "radius_mm",
    "residual_mm",
    "chord_mm",
    "dihedral_deg",
    "fitted",
)


def run_chords(curve: Arc, run: Run) -> list[int]:
    """Return the chords of a run, counted from 0; those of a rim past joint 0 from its number of chords on."""
    n = len(curve.edge_ids)
    last = n - 1 if isinstance(curve, Rim) else n
    if max(run.first, run.last) > last:
        raise EntityError.of_rule(
            "first and last", f"must be joints of {curve.id}, 0..{last}", f"{run}"
        )
    return list(range(run.first, run.last if run.last > run.first else run.last + n))


RELATIVE_TOLERANCE = 1e-4
"""Default distance within which given end points match vertices, as a fraction of the bounding box diagonal."""

_STRAIGHT_EDGES_MAY_BE = (
    "an entity must be the id of a rim or arc, an edge id or two finite end points."
)


@dataclass(frozen=True)
class Entity:
    """A named edge, chain of collinear edges, rim or arc to measure, or a part of one.

    Attributes
    ----------
    name : str
        Name of the entity.
    endpoints : ndarray, shape (2, 3), read-only
        Its two ends in mm. For a rim, which has none, two opposite vertices.
    edge_ids : tuple of int
        Ids of its edges in the solid, ordered from ``endpoints[0]`` to ``endpoints[1]``. For a rim
        or arc, all its chords, counter-clockwise about the circle's axis.
    kind : str
        ``"edge"`` (also for a chain or a stretch), ``"rim"`` or ``"arc"`` (also for a run).
    circle : Circle or None
        The circle of a rim or arc.
    points : ndarray, shape (m, 3), read-only
        The ends of the chords of a rim or arc in order, in mm, or the two ends of an edge. A rim
        does not repeat its first point.
    part : Stretch or Run or None
        What it is a part of an edge, rim or arc. None if it is a whole one.
    """

    name: str
    endpoints: np.ndarray = field(compare=False)
    edge_ids: tuple[int, ...]
    kind: str = "edge"
    circle: Circle | None = field(default=None, compare=False)
    points: np.ndarray = field(default=None, compare=False)  # type: ignore[arg-type]  # that of the ends
    part: Part | None = None

    __repr__ = short_repr

    def __post_init__(self) -> None:
        for name, value in (("endpoints", self.endpoints), ("points", self.points)):
            array = np.array(self.endpoints if value is None else value, dtype=np.float64)
            array.flags.writeable = False
            object.__setattr__(self, name, array)

    @property
    def outline(self) -> np.ndarray:
        """The polyline of its edges in mm, shape (k, 3). For a rim it ends where it starts."""
        return np.vstack([self.points, self.points[:1]]) if self.kind == "rim" else self.points

    @property
    def length_mm(self) -> float:
        """Distance of the end points in mm: the chord of an arc, about the diameter of a rim."""
        return float(np.linalg.norm(self.endpoints[1] - self.endpoints[0]))


def resolve_entities(
    solid: Solid,
    mapping: Mapping[str, Any] | Iterable[Any],
    tolerance_mm: float | None = None,
    min_dihedral_deg: float = 5.0,
) -> dict[str, Entity]:
    """Find the edges, rims, arcs and parts of them for names, ids or end points.

    Parameters
    ----------
    solid : Solid
        The part.
    mapping : mapping or iterable
        ``{name: 17}`` or ``{name: "e17"}`` with the id of an edge, ``{name: "r3"}`` with that of a
        rim or arc, or ``{name: (p, q)}`` with end points in mm. End points may span a chain of
        collinear edges. An `Edge`, `Rim`, `Arc`, `Stretch`, `Run` or `Entity` of this solid can
        replace an id, and so can the text of a part, ``"17[0:1/4]"``. Items without names are named
        ``"e<id>"``, ``"r<n>"``, ``"a<n>"``, and parts ``"e17[0:1/4]"`` and ``"r11[3:22]"``. Those
        of a set are sorted.
    tolerance_mm : float, optional
        Largest distance of a given end point from its vertex. Default: 10⁻⁴ of the bounding box
        diagonal.
    min_dihedral_deg : float
        Smallest turn of the normal across an edge that is visible as an edge, in degrees.

    Returns
    -------
    dict
        Name to `Entity`, in the order given.

    Raises
    ------
    EntityError
        There is no such edge, rim or arc. Or the edge belongs to a curve, is smooth, has no length
        or is named twice.

    Examples
    --------
    >>> from itertools import product
    >>> from aspectgraph import Solid
    >>> faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    >>> box = Solid(list(product((0, 40), (0, 30), (0, 20))), faces, name="box")
    >>> from aspectgraph import resolve_entities
    >>> entity = resolve_entities(box, {"top": [[0, 0, 20], [40, 0, 20]]})["top"]
    >>> entity.kind, entity.points.tolist()
    ('edge', [[0.0, 0.0, 20.0], [40.0, 0.0, 20.0]])
    """
    check_solid(solid)
    if not isinstance(mapping, Mapping):
        mapping = {_id_name(item): item for item in _distinct(unnamed_entities(mapping))}
    if not mapping:
        raise EntityError.of_rule("entities", "must name at least one edge, rim or arc", "none")
    if tolerance_mm is None:
        tolerance_mm = RELATIVE_TOLERANCE * float(np.linalg.norm(np.ptp(solid.bounds, axis=0)))
    if not tolerance_mm > 0:
        raise EntityError.of_rule("tolerance_mm", "must be positive", str(tolerance_mm))
    entities: dict[str, Entity] = {}
    named: dict[tuple[frozenset[int], Part | None], str] = {}
    for name, target in mapping.items():
        if not isinstance(name, str) or not name.strip():
            raise EntityError(f"an entity's name must be text. Got {name!r}.")
        entity = _resolve(solid, name, target, tolerance_mm, min_dihedral_deg)
        for edge_id in entity.edge_ids if entity.kind == "edge" else ():
            _check_edge_of_straight_edges(solid.edges[edge_id], name, min_dihedral_deg)
        key = (frozenset(entity.edge_ids), entity.part)
        if key in named:
            place = f"edge {min(entity.edge_ids)}" if entity.part is None else str(entity.part)
            raise EntityError(
                f"an edge must be named once. Got {named[key]!r} and {name!r} for {place}."
            )
        named[key] = name
        entities[name] = entity
    return entities


_TEXTS = "read_entities reads a text, and select_entities takes a rule"


def unnamed_entities(items: Any) -> list[Any]:
    """Return entities without names as a list.

    Parameters
    ----------
    items : iterable
        Such as a sequence or an array of ids. Those of a set are sorted.

    Raises
    ------
    EntityError
        If it is none, or a text.
    """
    if isinstance(items, AbstractSet):
        items = sorted(items, key=lambda item: entity_order(_id_name(item)))
    is_point = isinstance(items, np.ndarray) and items.ndim == 0
    if is_point or isinstance(items, str | bytes) or not isinstance(items, Iterable):
        raise EntityError.of_rule(
            "entities", "must be a mapping or sequence", repr(items)[:80], hint=_TEXTS
        )
    return list(map(edge_number, items))


def _id_name(item: Any) -> str:
    item = edge_number(item)
    if isinstance(item, Edge):
        return f"e{item.id}"
    if isinstance(item, Arc):
        return item.id
    if is_curve_id(item):
        return str(item)
    if isinstance(item, Stretch | Run) or is_part_text(item):
        return (parse_part(item) if isinstance(item, str) else item).name
    if isinstance(item, bool) or not isinstance(item, int | np.integer):
        raise EntityError.of_rule("edge ids", "must be integers", repr(item)[:80])
    return f"e{item}"


def _distinct(items: list[Any]) -> list[Any]:
    for i, item in enumerate(items):
        if any(
            item is other or item == other
            for other in items[:i]
            if np.isscalar(item) and np.isscalar(other)
        ):
            raise EntityError(f"an edge must be named once. Got edge {item} twice.")
    return items


def _resolve(
    solid: Solid, name: str, target: Any, tolerance_mm: float, min_dihedral_deg: float
) -> Entity:
    target = edge_number(target)
    if isinstance(target, Entity):
        if not target.edge_ids or not all(0 <= i < len(solid.edges) for i in target.edge_ids):
            raise EntityError(
                f"edge ids must be in 0..{len(solid.edges) - 1}. Got {target.edge_ids} for {name!r}."
            )
        return replace(target, name=name)
    if isinstance(target, Arc) or is_curve_id(target):
        return _curve_entity(solid, name, find_curve(solid, target, name, min_dihedral_deg))
    if isinstance(target, Stretch | Run) or is_part_text(target):
        part = parse_part(target) if isinstance(target, str) else target
        return _part_entity(solid, name, part, min_dihedral_deg)
    if isinstance(target, Edge):
        if not (0 <= target.id < len(solid.edges) and solid.edges[target.id] == target):
            raise EntityError(
                f"an edge must be one of the solid's. Got another solid's edge {target.id} for {name!r}."
            )
        target = target.id
    if isinstance(target, int | np.integer) and not isinstance(target, bool):
        if not 0 <= target < len(solid.edges):
            raise EntityError(
                f"an edge id must be in 0..{len(solid.edges) - 1}. Got {target}{for_name(name, f'e{target}')}."
                f"{_of_choice(solid)}"
            )
        return Entity(name, solid.edge_points(int(target)), (int(target),))
    try:
        ends = np.array(target, dtype=np.float64)
    except (OverflowError, TypeError, ValueError) as error:
        raise EntityError(
            f"{_STRAIGHT_EDGES_MAY_BE} Got {repr(target)[:200]}{for_name(name, target)}."
        ) from error
    if ends.shape != (2, 3) or not (np.abs(ends) <= FARTHEST_MM).all():
        raise EntityError(
            f"{_STRAIGHT_EDGES_MAY_BE} Got {repr(target)[:200]}{for_name(name, target)}."
        )
    if np.linalg.norm(ends[1] - ends[0]) <= tolerance_mm:
        raise EntityError(
            f"an entity must have a length. Got two end points at {describe_point(ends[0])} for {name!r}."
        )
    return _find_chain(solid, name, ends, tolerance_mm)


def _curve_entity(solid: Solid, name: str, curve: Arc) -> Entity:
    points = curve_points(solid, curve)
    kind = "rim" if isinstance(curve, Rim) else "arc"
    return Entity(name, curve_ends(points, curve), curve.edge_ids, kind, curve.circle, points)


def _part_entity(solid: Solid, name: str, part: Part, min_dihedral_deg: float) -> Entity:
    if isinstance(part, Stretch):
        whole = _resolve(solid, name, part.edge, 1.0, min_dihedral_deg)
        ends = stretch_ends(solid, part)
        return replace(whole, endpoints=ends, points=ends, part=part)
    curve = find_curve(solid, part.curve, name, min_dihedral_deg)
    run = run_of_curve(solid, curve, part)
    return replace(_curve_entity(solid, name, run), part=part)


def _check_edge_of_straight_edges(edge: Edge, name: str, min_dihedral_deg: float) -> None:
    if edge.curved:
        raise EntityError(
            "an entity must be a straight, sharp edge. "
            f"Got edge {edge.id}, part of a curve or of an occluder, for {name!r}."
        )
    if abs(edge.turn_deg) < min_dihedral_deg:
        raise EntityError(
            f"an entity's faces must turn by at least {min_dihedral_deg:g} degrees. "
            f"Got {abs(edge.turn_deg):.3g} at edge {edge.id} for {name!r}."
        )


def _find_chain(solid: Solid, name: str, ends: np.ndarray, tolerance_mm: float) -> Entity:
    """Walk from the vertex at the first end point to the one at the second along edges on the line between."""
    distance = np.linalg.norm(solid.vertices[:, None] - ends, axis=2)
    start, goal = (int(v) for v in np.argmin(distance, axis=0))
    if max(distance[start, 0], distance[goal, 1]) > tolerance_mm:
        raise EntityError(_no_edge(solid, name, ends, tolerance_mm))
    line = solid.vertices[[start, goal]]
    along = (line[1] - line[0]) / np.linalg.norm(line[1] - line[0])
    offset = solid.vertices - line[0]
    progress = offset @ along
    on_line = np.linalg.norm(offset - progress[:, None] * along, axis=1) <= tolerance_mm
    steps: dict[int, list[tuple[int, int]]] = {}
    for edge in solid.edges:
        a, b = edge.vertices
        if on_line[a] and on_line[b]:
            a, b = (a, b) if progress[a] < progress[b] else (b, a)
            steps.setdefault(a, []).append((b, edge.id))
    path = _walk(steps, start, goal)
    if path is None:
        raise EntityError(_no_edge(solid, name, ends, tolerance_mm))
    return Entity(name, line, tuple(path))


def _walk(steps: dict[int, list[tuple[int, int]]], start: int, goal: int) -> list[int] | None:
    """Return the edge ids of a path, which only ever goes forward, or None."""
    came: dict[int, tuple[int, int]] = {}
    front = [start]
    while front:
        vertex = front.pop()
        for ahead, edge_id in steps.get(vertex, ()):
            if ahead not in came:
                came[ahead] = (vertex, edge_id)
                front.append(ahead)
    if goal not in came:
        return None
    path = []
    while goal != start:
        goal, edge_id = came[goal]
        path.append(edge_id)
    return path[::-1]


def _no_edge(solid: Solid, name: str, ends: np.ndarray, tolerance_mm: float) -> str:
    points = np.array([solid.edge_points(edge.id) for edge in solid.edges])
    gaps = [
        np.linalg.norm(points[:, order] - ends, axis=2).max(axis=1) for order in ([0, 1], [1, 0])
    ]
    gap = np.minimum(*gaps)
    nearest = int(np.argmin(gap))
    a, b = (describe_point(p) for p in points[nearest])
    return (
        f"end points must lie within {tolerance_mm:.3g} mm of the ends of an edge. Got {name!r} from "
        f"{describe_point(ends[0])} to {describe_point(ends[1])}; the nearest is edge {nearest} from {a} to {b}, "
        f"{gap[nearest]:.3g} mm off."
    )
