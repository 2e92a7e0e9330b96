"""Which rims and edges show a hole, pin, slot or tab, and the datums of its position, in the plane of its rim.

Datums are taken in their order. Each fixes what is still free of a rotation and two translations. A plane across, seen
as an edge, fixes the rotation and the translation across it, and so does a slot by its two edges. A hole or pin, seen
as its rim, fixes both translations, or then the rotation. A pattern of holes fixes all that is free, by least squares.
A plane that is parallel to that of the rim fixes nothing.

Reference: ISO 5459 and ASME Y14.5, datum reference frames.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from aspectgraph.dimensions.features import (
    Axis,
    EntityId,
    Feature,
    FloatArray,
    Plane,
    Sight,
    Way,
    arc_order,
    parallel,
    perpendicular,
)
from aspectgraph.solid.rims import Arc

DatumFeatures: TypeAlias = Mapping[str, Sequence[Feature] | None]
"""The features of each datum, by its letter; None of one that is stated by datum targets."""

_DatumFeature: TypeAlias = Axis | list[Plane] | tuple[Axis, ...]
"""A hole or pin; a plane, or the two of a slot; or the holes of a pattern."""

NO_DATUM = (0,)
"""Numbers of entities of the datums of a pattern without any: only the distances of its rims count."""

_MOST_SEATS = 4
"""Rims of a hole, or pairs of edges of a slot, that are offered for its position."""

_SAME_DEPTH_MM = 1e-3
"""Edges are in one plane if their depths differ by less."""


class NotShownError(Exception):
    """No rim or edge shows a position or one of its datums; the text says which."""


@dataclass(frozen=True, eq=False)
class Seat:
    """The rim of a hole or pin, or the two edges of a slot or tab.

    Attributes
    ----------
    axis : array (3,)
        Unit normal of its plane.
    centre : array (3,)
        A point of this plane, mm.
    shown_by : tuple of int or Arc
        What must be seen.
    across : array (3,) or None
        Of a slot, the unit vector from its first edge to the second.
    """

    axis: FloatArray
    centre: FloatArray
    shown_by: tuple[int | Arc, ...]
    across: FloatArray | None = None

    @property
    def ids(self) -> Way:
        """Ids of its entities."""
        return tuple(map(_id_of, self.shown_by))

    def depth_mm(self, point: FloatArray) -> float:
        """Return how far a point is from its plane."""
        return round(abs(float((point - self.centre) @ self.axis)), 3)


@dataclass(frozen=True)
class Shown:
    """Entities that measure a position in one image.

    Attributes
    ----------
    way : tuple
        Ids of the rim or the edges that have the position, then those of each datum, then the other rims of a pattern.
    groups : tuple of int
        Number of entities of each datum.
    n_pattern : int
        Number of the other rims of the pattern.
    """

    way: Way
    groups: tuple[int, ...]
    n_pattern: int = 0


def seats_of_hole(sight: Sight, hole: Axis) -> list[Seat]:
    """Return the rims of a hole or pin, best first.

    Parameters
    ----------
    sight : Sight
        Of the solid.
    hole : Axis
        The hole.

    Raises
    ------
    NotShownError
        There is none.
    """
    rims = sorted(hole.circles, key=lambda arc: arc_order(sight, arc))
    if not rims:
        raise NotShownError("no sharp circular edge bounds this feature")
    return [Seat(rim.axis, rim.centre, (rim,)) for rim in rims[:_MOST_SEATS]]


def seats_of_slot(sight: Sight, planes: Sequence[Plane]) -> list[Seat]:
    """Return the pairs of edges in one plane that show the width between two parallel planes, longest first.

    Parameters
    ----------
    sight : Sight
        Of the solid.
    planes : sequence of two Plane
        The walls of the slot or tab.

    Raises
    ------
    NotShownError
        There is none.
    """
    first, second = planes
    if not parallel(first.normal, second.normal):
        raise NotShownError("its faces are not parallel")
    pairs = []
    for edge in first.edges:
        for other in second.edges:
            seat = _pair(sight, edge, other, first.normal)
            if seat is not None and sight.together(*seat.shown_by):
                length = min(sight.length_mm(edge), sight.length_mm(other))
                pairs.append(((-length, edge, other), seat))
    if not pairs:
        raise NotShownError("no two edges in one plane show this width")
    pairs.sort(key=lambda pair: pair[0])
    return [seat for _, seat in pairs[:_MOST_SEATS]]


def _pair(sight: Sight, edge: int, other: int, normal: FloatArray) -> Seat | None:
    """Return the seat of two edges that are parallel, face each other, and lie across the walls' normal."""
    ends = [sight.solid.edge_points(number) for number in (edge, other)]
    along, direction = ((pair[1] - pair[0]) / np.linalg.norm(pair[1] - pair[0]) for pair in ends)
    if not parallel(along, direction):
        return None
    middle = ends[0].mean(axis=0)
    axis = np.cross(normal, along)
    if abs(float((ends[1].mean(axis=0) - middle) @ axis)) > _SAME_DEPTH_MM:
        return None
    reach = [np.sort((pair - middle) @ along) for pair in ends]
    if min(reach[0][1], reach[1][1]) <= max(reach[0][0], reach[1][0]):
        return None
    apart = float((ends[1].mean(axis=0) - middle) @ normal)
    return Seat(axis, middle, (edge, other), np.sign(apart) * normal)


def _id_of(part: int | Arc) -> EntityId:
    if isinstance(part, Arc):
        return part.id
    return part


class DatumFrame:
    """The datums of a tolerance.

    Parameters
    ----------
    sight : Sight
        Of the solid.
    letters : sequence of str
        The datums in their order, such as "A" or "B(M)".
    features : mapping of str to sequence of Feature
        Those of each datum.
    """

    def __init__(self, sight: Sight, letters: Sequence[str], features: DatumFeatures):
        self.sight = sight
        self.letters = tuple(letters)
        self.features = features

    def show(self, seat: Seat, others: Sequence[Axis] = ()) -> Shown:
        """Return a seat with what shows its datums.

        Parameters
        ----------
        seat : Seat
            What has the position.
        others : sequence of Axis
            The other holes of its pattern. What the datums leave free is fitted to all of them.

        Raises
        ------
        NotShownError
            A datum is not shown, is inclined to the plane of the rim, or leaves free what nothing fits.
        """
        way: list[EntityId] = list(seat.ids)
        seen: list[int | Arc] = list(seat.shown_by)
        groups = []
        fixed_turn = False
        across: list[FloatArray] = []
        for letter, datum in self._in_plane(seat):
            if fixed_turn and len(across) == 2:
                break
            parts = self._shown_by(seat, letter, datum)
            way += map(_id_of, parts)
            seen += parts
            groups.append(len(parts))
            if isinstance(datum, Axis):
                fixed_turn = fixed_turn or len(across) == 2
                across = list(np.eye(2, 3))
            elif isinstance(datum, tuple):
                fixed_turn = True
                across = list(np.eye(2, 3))
            else:
                fixed_turn = True
                across = [*across, datum[0].normal][:2]
        pattern: list[Arc] = []
        if not (fixed_turn and len(across) == 2):
            pattern = [_rim_beside(seat, other) for other in others]
        self._check_fixed(seat, fixed_turn, across, pattern)
        if not self.sight.together(*seen, *pattern):
            raise NotShownError("no direction shows its rim and the edges of its datums together")
        way += [rim.id for rim in pattern]
        return Shown(tuple(way), tuple(groups) or NO_DATUM, len(pattern))

    @staticmethod
    def _check_fixed(
        seat: Seat, fixed_turn: bool, across: Sequence[FloatArray], pattern: Sequence[Arc]
    ) -> None:
        """Refuse a frame that leaves free what counts."""
        if pattern:
            return
        if seat.across is not None:
            is_fixed = len(across) == 2 or any(parallel(normal, seat.across) for normal in across)
            if not fixed_turn or not is_fixed:
                raise NotShownError("its datums leave the translation across it free")
            return
        # about a datum hole alone, the deviation along the radius counts
        if len(across) < 2:
            raise NotShownError("its datums leave a translation free")

    def _in_plane(self, seat: Seat) -> Iterator[tuple[str, _DatumFeature]]:
        """Go through the datums that may fix something in the plane of a seat."""
        for letter in self.letters:
            features = self.features.get(letter.partition("(")[0], ())
            if features is None:
                raise NotShownError(f"datum {letter} is stated by datum targets, not by a feature")
            planes = [feature for feature in features if isinstance(feature, Plane)]
            is_slot = (
                len(features) == len(planes) == 2
                and parallel(planes[0].normal, planes[1].normal)
                and abs(float((planes[1].point - planes[0].point) @ planes[0].normal))
                > _SAME_DEPTH_MM
            )
            holes = tuple(feature for feature in features if isinstance(feature, Axis))
            if len(features) == len(holes) > 1:
                if not all(parallel(hole.along, seat.axis) for hole in holes):
                    raise NotShownError(f"the rim is inclined to datum {letter}")
                if _are_apart(holes):
                    yield letter, holes
                    continue
            if len(features) != 1 and not is_slot:
                count = f"{len(features) or 'no'} feature{'s' * (len(features) != 1)}"
                raise NotShownError(f"the file attaches datum {letter} to {count}, not to one")
            datum = features[0]
            if planes and parallel(planes[0].normal, seat.axis):
                # it fixes nothing in the plane of the rim
                continue
            if isinstance(datum, Axis) and parallel(datum.along, seat.axis):
                yield letter, datum
            elif planes and perpendicular(planes[0].normal, seat.axis):
                yield letter, planes
            else:
                raise NotShownError(f"the rim is inclined to datum {letter}")

    def _shown_by(self, seat: Seat, letter: str, datum: _DatumFeature) -> list[int | Arc]:
        """Return the rims, edge or edges that show a datum nearest to the plane of a seat."""
        if isinstance(datum, tuple):
            return [self._shown_by(seat, letter, hole)[0] for hole in datum]
        if isinstance(datum, Axis):
            circles = []
            for arc in datum.circles:
                same_side = float(arc.axis @ seat.axis) > 0.0 or seat.across is not None
                if same_side and arc not in seat.shown_by:
                    circles.append(arc)
            if not circles:
                raise NotShownError(f"no rim on the same side shows datum {letter}")
            return [min(circles, key=lambda arc: seat.depth_mm(arc.centre))]
        if len(datum) == 2:
            try:
                pairs = seats_of_slot(self.sight, datum)
            except NotShownError as error:
                raise NotShownError(f"datum {letter}: {error}") from None
            pairs = [pair for pair in pairs if parallel(pair.axis, seat.axis)]
            if not pairs:
                raise NotShownError(f"no edges in planes of the rim show datum {letter}")
            return list(min(pairs, key=lambda pair: seat.depth_mm(pair.centre)).shown_by)
        return [self._edge(seat, letter, datum[0])]

    def _edge(self, seat: Seat, letter: str, datum: Plane) -> int:
        """Return the edge of a datum plane that lies nearest to the plane of a seat, and is longest there."""
        edges = []
        for edge_id in datum.edges:
            ends = self.sight.solid.edge_points(edge_id)
            along = ends[1] - ends[0]
            lies_across = perpendicular(along / np.linalg.norm(along), seat.axis)
            if lies_across and self.sight.together(edge_id, *seat.shown_by):
                edges.append((seat.depth_mm(ends[0]), -self.sight.length_mm(edge_id), edge_id))
        if not edges:
            raise NotShownError(f"no edge that is seen with the rim shows datum {letter}")
        return min(edges)[2]


def _are_apart(holes: Sequence[Axis]) -> bool:
    """Return whether no two holes with parallel axes are about one axis."""
    for k, hole in enumerate(holes):
        for other in holes[:k]:
            if np.linalg.norm(np.cross(other.point - hole.point, hole.along)) <= _SAME_DEPTH_MM:
                return False
    return True


def _rim_beside(seat: Seat, hole: Axis) -> Arc:
    """Return the rim of a hole that is nearest to the plane of a seat and looks the same way."""
    circles = [arc for arc in hole.circles if float(arc.axis @ seat.axis) > 0.0]
    if not circles or not parallel(hole.along, seat.axis):
        raise NotShownError("no rim on the same side shows another hole of its pattern")
    return min(circles, key=lambda arc: seat.depth_mm(arc.centre))
