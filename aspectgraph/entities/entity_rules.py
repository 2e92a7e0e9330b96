"""Entities chosen by rules and in files."""

from __future__ import annotations

import csv
import io
import json
import math
import operator
import re
import reprlib
import tomllib
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from numpy.typing import NDArray

from aspectgraph.entities.entity import Entity, is_part_text, parse_part, resolve_entities
from aspectgraph.exceptions import EntityError
from aspectgraph.files import check_plain, read_text
from aspectgraph.solid.rims import Arc, Rim, reference_direction
from aspectgraph.solid.solid import Solid, check_solid

# Rules that select entities, and the lines and circles that carry them.


# Carriers: the planes, cylinders and cones that carry the faces of a part, and how an edge moves
# with them.
#
# A surface deviates by three numbers, mm. Those of a plane are its offset along its normal, and
# how far two tilts lift it at its extent. Those of a cylinder are its radius and the place of its
# axis; those of a cone its offset along its normal, and the place of its axis. An edge lies on
# two surfaces and moves by the least vector that meets both: pinv([n1; n2]) [r1; r2], with their
# unit normals n and offsets r.


FloatArray = npt.NDArray[np.float64]

PARAMETERS = 3
"""Numbers that a surface deviates by."""

# planes whose normals and offsets agree to these digits carry their faces together
_NORMAL_DIGITS = 5
_OFFSET_DIGITS = 3
# cosine from which on a face is perpendicular to an axis, and up to which it is parallel to it
_PERPENDICULAR = 0.999
_PARALLEL = 0.02
# normals that differ by less than this share do not fix how an edge moves along their difference
_ALIKE = 0.05
# faces that differ by less are as level with an axis as each other
_AS_LEVEL = 0.05
# share of a cone's radius by which the axis of its other rim may be off
_OFF_AXIS = 1e-3


@dataclass(frozen=True)
class Carrier:
    """A plane, cylinder or cone.

    Attributes
    ----------
    point : ndarray, shape (3,)
        A point of the plane, or of the axis, mm.
    axis : ndarray, shape (3,)
        Unit normal of the plane, or direction of the axis.
    radius_mm : float
        0 for a plane; of a cone, at the edge that it carries.
    extent_mm : float
        Largest distance of the plane's faces from the point; tilts count there.
    lean : float
        How far the unit normals of a cone go along its axis; 0 for planes and cylinders.
    """

    point: FloatArray
    axis: FloatArray
    radius_mm: float
    extent_mm: float
    lean: float = 0.0

    @property
    def is_plane(self) -> bool:
        """Whether it is a plane."""
        return self.radius_mm == 0.0

    def normals(self, points: FloatArray) -> FloatArray:
        """Return unit normals (n, 3) at points (n, 3); of cylinders and cones away from the axis."""
        if self.is_plane:
            return np.tile(self.axis, (len(points), 1))
        off = points - self.point
        off = off - (off @ self.axis)[:, None] * self.axis
        out = off / np.linalg.norm(off, axis=1, keepdims=True)
        return np.asarray(np.sqrt(1.0 - self.lean**2) * out + self.lean * self.axis)

    def offsets(self, points: FloatArray) -> FloatArray:
        """Return how far (n, 3) the surface is off along its normal at points (n, 3) for each of its numbers."""
        x = reference_direction(self.axis)
        y = np.cross(self.axis, x)
        if self.is_plane:
            off = (points - self.point) / self.extent_mm
        else:
            off = self.normals(points)
        return np.stack([np.ones(len(points)), off @ x, off @ y], axis=1)


def faces_along(solid: Solid, edge_ids: Sequence[int], axis: FloatArray) -> npt.NDArray[np.int64]:
    """Return the faces (n, 2) of the chords of a rim or arc: in each column those of one side of it.

    Faces of an edge come in the order of their numbers, in which the facets of a wall may lie around the face that it
    ends at. The side that is more level with the axis comes first.
    """
    faces = np.array([solid.edges[i].faces for i in edge_ids])
    along = solid.normals[faces] @ axis
    level = np.abs(along)
    alike = np.isclose(level[:, 0], level[:, 1], rtol=0.0, atol=_AS_LEVEL)
    is_second = np.where(alike, along[:, 0] < along[:, 1], level[:, 0] < level[:, 1])
    return np.where(is_second[:, None], faces[:, ::-1], faces)


class Carriers:
    """The planes, cylinders and cones of a part that carry its sharp edges, rims and arcs.

    Parameters
    ----------
    solid : Solid
        The part.

    Attributes
    ----------
    surfaces : list of Carrier
        Those that carry an edge asked for so far.
    """

    def __init__(self, solid: Solid) -> None:
        self.surfaces: list[Carrier] = []
        self._solid = solid
        self._planes: dict[tuple[float, ...], int] = {}
        self._cylinders: dict[tuple[float, ...], int] = {}
        self._cones: dict[int, int] = {}
        self._members: dict[tuple[float, ...], list[int]] = {}
        for face, normal in enumerate(solid.normals):
            self._members.setdefault(self._plane_key(face, normal), []).append(face)

    def of_edge(self, edge_id: int) -> tuple[int, int]:
        """Return the two surfaces that carry a straight edge, as numbers in `surfaces`."""
        first, second = self._solid.edges[edge_id].faces
        return self._plane(first), self._plane(second)

    def of_curve(self, curve: Arc) -> tuple[int, int]:
        """Return the two surfaces that carry a rim or arc: what fixes where it is along its axis, and what is round.

        The first is what is level with it, or else a cone; the second a cylinder, or else a cone. A cone may stand for
        any surface that is neither level nor parallel to the axis. What is missing is a plane or a cylinder of the
        curve's own.
        """
        faces = faces_along(self._solid, curve.edge_ids, curve.axis)
        cosines = np.abs(self._solid.normals[faces] @ curve.axis)
        level = np.all(cosines >= _PERPENDICULAR, axis=0)
        parallel = bool(np.any(np.all(cosines <= _PARALLEL, axis=0)))
        leaning = np.flatnonzero(np.all(cosines > _PARALLEL, axis=0) & ~level)
        cone = self._cone(curve, faces[:, leaning[0]]) if len(leaning) else None
        if level.any():
            first = self._plane(int(faces[0, np.flatnonzero(level)[0]]))
            if cone is not None:
                return first, cone
        elif cone is not None:
            first = cone
        else:
            first = self._add(Carrier(curve.centre, curve.axis, 0.0, max(curve.radius_mm, 1.0)))
        return first, self._cylinder(curve, shared=parallel)

    def displacement(self, pair: Sequence[int], points: FloatArray) -> FloatArray:
        """Return how points of an edge move with its surfaces.

        Parameters
        ----------
        pair : sequence of int
            The two surfaces that carry it.
        points : ndarray, shape (n, 3)
            On the edge, mm.

        Returns
        -------
        ndarray, shape (n, 3, 6)
            Displacement in mm by the numbers of both surfaces.
        """
        both = [self.surfaces[k] for k in pair]
        # those of planes are the same everywhere
        samples = points[:1] if all(surface.is_plane for surface in both) else points
        normals = np.stack([surface.normals(samples) for surface in both], axis=1)
        inverse = np.linalg.pinv(normals, rcond=_ALIKE)
        moved = [
            inverse[:, :, k, None] * surface.offsets(points)[:, None, :]
            for k, surface in enumerate(both)
        ]
        return np.concatenate(moved, axis=2)

    def _plane_key(self, face: int, normal: FloatArray) -> tuple[float, ...]:
        offset = float(normal @ self._solid.vertices[self._solid.faces[face].outer[0]])
        return (*(np.round(normal, _NORMAL_DIGITS) + 0.0), round(offset, _OFFSET_DIGITS) + 0.0)

    def _plane(self, face: int) -> int:
        key = self._plane_key(face, self._solid.normals[face])
        if key not in self._planes:
            members = self._members[key]
            corners = sorted({v for i in members for v in self._solid.faces[i].outer})
            points = self._solid.vertices[corners]
            middle = (points.min(axis=0) + points.max(axis=0)) / 2
            normal = self._solid.normals[face]
            middle = middle - ((middle - points[0]) @ normal) * normal
            extent = float(np.linalg.norm(points - middle, axis=1).max())
            self._planes[key] = self._add(Carrier(middle, normal, 0.0, extent))
        return self._planes[key]

    def _cylinder(self, curve: Arc, *, shared: bool) -> int:
        axis = curve.axis * (1.0 if curve.axis[int(np.argmax(np.abs(curve.axis)))] > 0 else -1.0)
        foot = curve.centre - (curve.centre @ axis) * axis
        rounded = np.round([*axis, *foot, curve.radius_mm], _OFFSET_DIGITS) + 0.0
        key = tuple(rounded.tolist())
        if not shared:
            return self._add(Carrier(curve.centre, axis, curve.radius_mm, curve.radius_mm))
        if key not in self._cylinders:
            carrier = Carrier(curve.centre, axis, curve.radius_mm, curve.radius_mm)
            self._cylinders[key] = self._add(carrier)
        return self._cylinders[key]

    def _cone(self, curve: Arc, faces: npt.NDArray[np.int64]) -> int:
        """Return the cone that the faces (n,) on one side of a curve are of, one for each of its chords.

        Two curves about one axis have one cone if their faces are the same or meet in an edge of a facet.
        """
        wall = set(faces.tolist()).union(*(self._smooth[face] for face in faces.tolist()))
        shared = {self._cones[face] for face in wall & self._cones.keys()}
        number = next((k for k in sorted(shared) if self._widened(k, curve)), None)
        if number is None:
            number = self._add(self._cone_beside(curve, faces))
        self._cones.update(dict.fromkeys(faces.tolist(), number))
        return number

    def _widened(self, number: int, curve: Arc) -> bool:
        """Let a cone pass through another curve, if this is about its axis; return whether it is."""
        cone = self.surfaces[number]
        way = curve.centre - cone.point
        height = float(way @ cone.axis)
        off = np.linalg.norm(way - height * cone.axis)
        is_about = (
            abs(curve.axis @ cone.axis) >= _PERPENDICULAR and off <= _OFF_AXIS * cone.radius_mm
        )
        rise = curve.radius_mm - cone.radius_mm
        if not is_about or height == 0.0 or rise == 0.0:
            return False
        # of the circles, as facets between them lean a little less
        lean = -rise * math.copysign(1.0, height) / math.hypot(rise, height)
        if abs(lean - cone.lean) > _AS_LEVEL:
            return False
        self.surfaces[number] = replace(cone, lean=lean)
        return True

    @cached_property
    def _smooth(self) -> dict[int, set[int]]:
        """Which faces each one meets in edges that are no chords of a rim or arc."""
        curves = [*self._solid.rims(), *self._solid.arcs()]
        chords = {edge_id for curve in curves for edge_id in curve.edge_ids}
        meeting: dict[int, set[int]] = defaultdict(set)
        for number, edge in enumerate(self._solid.edges):
            if number not in chords:
                first, second = edge.faces
                meeting[first].add(second)
                meeting[second].add(first)
        return meeting

    def _cone_beside(self, curve: Arc, faces: npt.NDArray[np.int64]) -> Carrier:
        """Return the cone that touches the faces (n,) on one side of a curve, one for each of its chords."""
        normals = self._solid.normals[faces]
        ends = [self._solid.edge_points(i) for i in curve.edge_ids]
        middles = np.array([(start + end) / 2 for start, end in ends]) - curve.centre
        # away from the axis, as the normals of carriers are
        side = np.sign((normals * middles).sum(axis=1).mean())
        lean = float(side * (normals @ curve.axis).mean())
        return Carrier(curve.centre, curve.axis, curve.radius_mm, curve.radius_mm, lean)

    def _add(self, carrier: Carrier) -> int:
        self.surfaces.append(carrier)
        return len(self.surfaces) - 1


# Entities by rule: ``"length > 20 and face = top and convex"``.
#
# Conditions are joined by *and*. Each is one of
#
# * ``length > 20``: mm of an edge; of a rim or arc, its radius
# * ``radius <= 5``, ``diameter = 12``: mm, of rims and arcs only; equal within `SAME_SIZE_MM`
# * ``turn <= 90``: degrees
# * ``convex``, ``reentrant``: by the sign of the turn
# * ``kind = edge`` (``rim``, ``arc``, ``any``): without it, edges; with a radius or diameter, rims
#   and arcs
# * ``direction = x`` (``y``, ``z``, ``1,0,2``): parallel within half a degree, of a rim or arc its
#   axis
# * ``face = top`` (``bottom``, ``left``, …): all of it on that side of the part's box: top is +z,
#   right +x, back +y
# * ``near 10,20,30 < 5``: distance from a point, mm
#
# A unit may follow a number, ``mm`` or ``deg``. An error names the condition that was probably
# meant.


PARALLEL_DEG = 0.5
"""Largest angle between an edge and a direction to which it counts as parallel, degrees."""

ON_SIDE = 1e-6
"""Largest distance from a side of the part's box, as a fraction of its diagonal, to count as on it."""

SAME_SIZE_MM = 0.01
"""Largest difference of two lengths, radii or diameters that count as equal, mm.

CAD models state sizes to 0.001 mm or better, and drill sizes differ by 0.05 mm or more.
"""

_COMPARE: dict[str, Callable[[float, float], bool]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
    # an edge of 20 mm plus exactly the tolerance is equal to 20 mm, in spite of rounding
    "=": lambda size, limit: abs(size - limit) <= SAME_SIZE_MM * (1.0 + 1e-9),
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
_SIZE = re.compile(rf"(length|radius|diameter)\s*(<=|>=|<|>|=)\s*({_NUMBER})\s*(?:mm)?")
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
        Conditions joined by *and*: ``length > 20``, ``radius > 5``, ``diameter = 12``,
        ``turn < 100``, ``convex``, ``reentrant``, ``kind = rim``, ``direction = z``,
        ``face = top``, ``near 10,20,30 < 5``. Sizes are equal if they differ by at most 0.01 mm
        (`SAME_SIZE_MM`). A rule with ``radius`` or ``diameter`` selects rims and arcs. Any other
        rule without ``kind`` selects edges.

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
    if not isinstance(rule, str):
        raise EntityError.of_rule(
            "rule", "must be a text such as 'length > 20'", reprlib.repr(rule)
        )
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
        elif (match := _SIZE.fullmatch(text)) and match[1] != "length":
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
        times = 2.0 if match[1] == "diameter" else 1.0
        return lambda item: compare(times * item.size_mm, limit)
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
        "must be conditions joined by 'and': length > 20, radius > 5, diameter = 12, turn < 100, convex, "
        "reentrant, kind = rim, direction = z, face = top, near 10,20,30 < 5",
        repr(text),
        hint=_meant(text),
    )


_WORDS = (
    *(
        "length",
        "radius",
        "diameter",
        "turn",
        "convex",
        "reentrant",
        "kind",
        "direction",
        "face",
        "near",
    ),
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


# Entities as the command line takes them: all edges, ids, or a file of names.


# Tables of comma-separated values that a spreadsheet shows and does not run.
#
# Excel, LibreOffice and Google Sheets take text that begins with ``=``, ``+``, ``-`` or ``@`` for
# a formula, and tabs and line breaks for the border of a cell. So such text gets an apostrophe in
# front, which Excel and OWASP advise. Numbers stay as they are. `text_of_cell` takes the
# apostrophe away. Control characters, which a terminal obeys, are shown as Python writes them.
# All tables are written here.


# full-width signs start formulas where Excel runs in Japanese; blanks before a sign are no shelter
_FORMULA = re.compile(r"[\s']*?[=+\-@\t\r\n\0\uff1d\uff0b\uff0d\uff20]")
# C0 but for tab and line ends, DEL, C1; signs that turn the direction; halves of characters
_CONTROL = re.compile(
    "[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069\ud800-\udfff]"
)


class NumberText(str):
    """A number that is written out already, such as with a number of decimals; a table takes it as it is."""

    __slots__ = ()


def cell_of_text(text: str) -> str:
    """Return a text as a cell that no spreadsheet takes for a formula.

    Parameters
    ----------
    text : str
        The text.

    Returns
    -------
    str
        With an apostrophe in front if a formula could begin so, otherwise the text itself.

    Examples
    --------
    >>> cell_of_text("=1+1"), cell_of_text("bore"), cell_of_text("it's")
    ("'=1+1", 'bore', "it's")
    """
    return f"'{text}" if _FORMULA.match(text) else text


def text_of_cell(cell: str) -> str:
    """Return the text that `cell_of_text` made a cell of.

    Parameters
    ----------
    cell : str
        The cell.

    Returns
    -------
    str
        Without the apostrophe in front if a formula could begin behind it.

    Examples
    --------
    >>> text_of_cell("'=1+1"), text_of_cell("'bore'")
    ('=1+1', "'bore'")
    """
    return cell[1:] if cell.startswith("'") and _FORMULA.match(cell[1:]) else cell


def csv_text(columns: Sequence[str], rows: Iterable[Mapping[str, Any]]) -> str:
    r"""Return a table as comma-separated values with a heading, as RFC 4180 defines them.

    Parameters
    ----------
    columns : sequence of str
        Keys of the rows.
    rows : iterable of mapping
        Values as `table_text` takes them.

    Returns
    -------
    str
        Lines end with ``\r\n``, so that a cell with a line break of any kind is quoted.
    """
    return table_text(columns, ([row[column] for column in columns] for row in rows))


def table_text(
    heading: Sequence[str],
    rows: Iterable[Sequence[Any]],
    head: Sequence[str] = (),
    line_end: str = "\r\n",
) -> str:
    """Return rows of values as comma-separated values; names of columns may come twice.

    Parameters
    ----------
    heading : sequence of str
        Names of the columns.
    rows : iterable of sequence
        Text is written by `cell_of_text`, with control characters shown; numbers without loss,
        None as nothing.
    head : sequence of str, optional
        Lines of a comment before the heading; each gets ``# `` in front.
    line_end : str, optional
        What ends a line.

    Returns
    -------
    str
        As `csv_text` returns it.
    """
    text = io.StringIO()
    for line in head:
        text.write(f"# {_without_control(' '.join(line.split()))}{line_end}")
    writer = csv.writer(text, lineterminator=line_end)
    writer.writerow(map(_cell, heading))
    writer.writerows(map(_cell, row) for row in rows)
    return text.getvalue()


def _cell(value: Any) -> Any:
    if isinstance(value, NumberText) or not isinstance(value, str):
        return value
    return _without_control(cell_of_text(value))


def _without_control(text: str) -> str:
    return _CONTROL.sub(_shown, text)


def _shown(character: re.Match[str]) -> str:
    code = ord(character[0])
    return f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}"


# Python reads no integer of more than some thousand digits
_ID = r"[era]?\d{1,300}"
_IDS = re.compile(rf"{_ID}(-{_ID})?", re.ASCII)
_ENDS = re.compile(r"\(([^()]*)\)\s*-\s*\(([^()]*)\)")
_LONGEST_RANGE = 100_000


def read_entities(
    text_or_path: str | Path, solid: Solid, tolerance_mm: float | None = None
) -> dict[str, Entity]:
    """Read entities from text or a file, as the command line does.

    Parameters
    ----------
    text_or_path : str or Path
        ``"all"`` selects every straight sharp edge. Ids are ``"17, 18"``, ``"e17 e18"``, ranges
        like ``"17-21"``, or ``"r3, a0"`` for rims and arcs. Parts are ``"17[0:1/4]"`` for the first
        quarter of an edge and ``"r3[0:8]"`` for the first eight chords of a rim. End points such as
        ``"(0,0,10)-(25,0,10)"`` are named p1, p2 and so on. A .toml or .json file has ``name =
        17``, ``name = "e17"``, ``name = "r3"`` or ``name = [[x, y, z], [x, y, z]]``, at top level or in a table
        ``entities``. A .csv file has rows of a name and an id, or of a name and six coordinates. In
        a .csv file, an apostrophe before a name that a spreadsheet would run, such as ``'=1+1``, is
        not part of the name.
    solid : Solid
        The part.
    tolerance_mm : float, optional
        See `resolve_entities`.

    Returns
    -------
    dict of str to Entity
        By name, in the order given.

    Raises
    ------
    EntityError
        The text has another form, or an entity is not a sharp straight edge, rim or arc.

    Examples
    --------
    >>> from itertools import product
    >>> from aspectgraph import Solid
    >>> faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    >>> box = Solid(list(product((0, 40), (0, 30), (0, 20))), faces, name="box")
    >>> from aspectgraph import read_entities
    >>> list(read_entities("0-2, 5", box))
    ['e0', 'e1', 'e2', 'e5']
    """
    check_solid(solid)
    text = str(text_or_path).strip()
    if text.lower() == "all":
        return resolve_entities(solid, _every_edge(solid), tolerance_mm)
    if Path(text).suffix.lower() in (".toml", ".json"):
        return resolve_entities(solid, _read_file(Path(text)), tolerance_mm)
    if Path(text).suffix.lower() == ".csv":
        return resolve_entities(solid, _read_csv(Path(text)), tolerance_mm)
    points = [(_point(match[1]), _point(match[2])) for match in _ENDS.finditer(text)]
    words = [word for word in re.split(r"[\s,;]+", _ENDS.sub(" ", text)) if word]
    bad = [word for word in words if not (_IDS.fullmatch(word) or is_part_text(word))]
    if bad or not (words or points):
        raise EntityError.of_rule(
            "entities",
            "must be 'all', ids such as 17,18 or r3,a0, ranges such as 17-21, end "
            "points such as (0,0,10)-(25,0,10), or the path of a .toml, .json or .csv file",
            repr(bad[0] if bad else text),
        )
    ids = list(dict.fromkeys(entity_id for word in words for entity_id in _ids(word)))
    named: dict[str, Any] = {_name(entity_id): entity_id for entity_id in ids}
    return resolve_entities(
        solid, {**named, **{f"p{k}": ends for k, ends in enumerate(points, start=1)}}, tolerance_mm
    )


def _every_edge(solid: Solid) -> list[int]:
    """Return the ids of all sharp straight edges; a part of revolution has none."""
    ids = [edge.id for edge in solid.straight_edges()]
    if not ids:
        raise EntityError.of_rule(
            "entities",
            "must name rims or arcs of a part without a sharp straight edge",
            f"'all' for one with {len(solid.rims())} rims and {len(solid.arcs())} arcs",
        )
    return ids


def _name(entity_id: int | str) -> str:
    if isinstance(entity_id, int):
        return f"e{entity_id}"
    return parse_part(entity_id).name if is_part_text(entity_id) else entity_id


def _point(text: str) -> list[float]:
    """Return three numbers."""
    try:
        x, y, z = (float(word) for word in text.split(","))
    except ValueError:
        raise EntityError(
            f"an end point must be three numbers such as (0,0,10). Got ({text})."
        ) from None
    return [x, y, z]


def _ids(word: str) -> list[int | str]:
    """Return the ids of a word: ``17``, ``e17``, ``r3``, ``17-21`` or ``r0-r5``."""
    if is_part_text(word):
        return [word]
    first, _, last = word.partition("-")
    kind = first[0] if first[0] in "ra" else ""
    low = int(first.lstrip("era"))
    high = int(last.lstrip("era")) if last else low
    if last and (last.lstrip("e0123456789") or kind) and last[0] != kind:
        raise EntityError(f"a range must be of one kind, such as 17-21 or r0-r5. Got {word!r}.")
    if not low <= high <= low + _LONGEST_RANGE:
        raise EntityError(f"a range must go upwards, by at most {_LONGEST_RANGE}. Got {word!r}.")
    return [f"{kind}{i}" if kind else i for i in range(low, high + 1)]


def _read_csv(path: Path) -> dict[str, Any]:
    """Return what the rows of a CSV file name; a first row of words is a heading."""
    try:
        # a cell in quotes may hold line breaks
        text = io.StringIO(read_text(path, "utf-8-sig", newline=""), newline="")
        rows = [row for row in csv.reader(text) if any(row)]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise EntityError.of_rule(
            "entities", "must name a CSV file that can be read", f"{str(path)!r}: {error}"
        ) from None
    entities: dict[str, Any] = {}
    for number, row in enumerate(rows, start=1):
        name, *values = (cell.strip() for cell in row)
        name = text_of_cell(name)
        if number == 1 and values and not any(character.isdigit() for character in values[0]):
            continue
        if name in entities:
            raise EntityError(
                f"a CSV file must name an entity once. Got {name!r} again in {path.name}, row {number}."
            )
        if len(values) == 1 and (re.fullmatch(_ID, values[0], re.ASCII) or is_part_text(values[0])):
            entities[name] = _ids(values[0])[0]
        elif len(values) == 6:
            entities[name] = [_point(",".join(values[:3])), _point(",".join(values[3:]))]
        else:
            raise EntityError(
                "a CSV row must be a name and an id, or a name and six coordinates. "
                f"Got {','.join(row)!r} in {path.name}, row {number}."
            )
    return entities


def parse_names(path: Path) -> Any:
    """Return what a .toml or .json file holds.

    Parameters
    ----------
    path : Path
        The file; without the ending .json it is TOML.

    Raises
    ------
    ValueError
        It cannot be read, or is not of its format; the message is the reason alone.
    """
    try:
        text = read_text(path)
        is_json = path.suffix.lower() == ".json"
        content = json.loads(text, object_pairs_hook=_once) if is_json else tomllib.loads(text)
    except OSError as error:
        raise ValueError(error.strerror or str(error)) from error
    except RecursionError as error:
        raise ValueError("it is nested too deep") from error
    except (json.JSONDecodeError, tomllib.TOMLDecodeError) as error:
        if (bare := _bare_id(str(error), text)) is None:
            raise
        raise ValueError(f'{error}; write "{bare}" in quotes') from error
    except UnicodeDecodeError:
        raise
    except _TwiceError:
        raise
    except ValueError as error:
        # Python reads no integer of more than some thousand digits
        raise ValueError("it holds a number of too many digits") from error
    check_plain(content)
    return content


_AT = re.compile(r"line (\d+),? column (\d+)")
_BARE_ID = re.compile(r"[era]\d+(\[[\d:/]+\])?(?!\w)")


def _bare_id(message: str, text: str) -> str | None:
    """Return the id without quotes that stands where an error of TOML or JSON points; None if none does."""
    position = _AT.search(message)
    if position is None:
        return None
    line = text.split("\n")[int(position[1]) - 1]
    bare = _BARE_ID.match(line, int(position[2]) - 1)
    return None if bare is None else bare[0]


class _TwiceError(ValueError):
    """A name that stands twice, of which JSON would silently keep the last."""


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return the names of a JSON object and what they stand for; TOML itself refuses a name twice."""
    content = dict(pairs)
    if len(content) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise _TwiceError(f"the name {twice!r} stands in it twice")
    return content


def _read_file(path: Path) -> Any:
    if not path.is_file():
        raise EntityError.of_rule("entities", "must name an existing file", repr(str(path)))
    try:
        content = parse_names(path)
    except ValueError as error:
        raise EntityError(
            f"an entity file must be valid {path.suffix[1:].upper()}. Got {path.name}: {error}."
        ) from error
    if isinstance(content, dict) and isinstance(content.get("entities"), dict | list):
        content = content["entities"]
    if not isinstance(content, dict | list):
        raise EntityError(
            f"an entity file must hold names or edge ids. Got {path.name} with {type(content).__name__}."
        )
    return content
