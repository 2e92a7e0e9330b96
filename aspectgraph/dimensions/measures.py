"""How a dimension between given features can be measured: its kind, its value in the geometry, and its entities.

* diameter, radius: a rim or arc of the cylinder.
* distance: two parallel edges, one on each plane or line, across the direction of the dimension. They lie in one plane
  with that direction, or in two parallel ones.
* centre_to_edge: a rim or arc, and an edge across its axis. centre_distance: two rims or arcs. Where the two lie in one
  plane, their distance is the dimension; else it is their distance along the direction of the dimension.
* angle: two edges across the line in which the planes meet.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import product
from typing import Any, TypeAlias, cast

import numpy as np

from aspectgraph.dimensions.features import (
    Attachments,
    Axis,
    Feature,
    FloatArray,
    Plane,
    Sight,
    StraightLine,
    arc_order,
    parallel,
    perpendicular,
)
from aspectgraph.dimensions.records import Way
from aspectgraph.solid.rims import Arc

_NO_CIRCLE = "no sharp circular edge bounds this feature"
_UNREAD = "the file attaches it to an item of this feature that could not be read"
_Pair: TypeAlias = tuple[Arc, Arc | int]


@dataclass(frozen=True)
class Measure:
    """How a dimension can be measured.

    Attributes
    ----------
    kind : str
        See `ModelDimension`.
    values : tuple of float
        The value in the geometry, of each feature of a pattern; empty if it has none.
    ways : tuple of tuple
        For each feature the entities that measure it, best first.
    reason : str
        Why there are none, if there are none.
    direction : ndarray, shape (3,), or None
        Of a distance.
    note : str
        What to mind when the first entities are used.
    n_features : int
        How many features it applies to; of those of a pattern each is one.
    missing : tuple of str or None
        For each feature why nothing measures it; None where something does.
    """

    kind: str
    values: tuple[float, ...] = ()
    ways: tuple[tuple[Way, ...], ...] = ()
    reason: str = ""
    direction: FloatArray | None = field(default=None, compare=False)
    note: str = ""
    n_features: int = 1
    missing: tuple[str | None, ...] = (None,)


class Measurer:
    """Finds the measures of dimensions of one solid.

    Parameters
    ----------
    attachments : Attachments
        Of the solid.
    sight : Sight
        Of the same solid.
    """

    def __init__(self, attachments: Attachments, sight: Sight):
        self.match_mm = attachments.match_mm
        self.coaxial = attachments.coaxial
        self.sight = sight
        self.ends = {
            edge.id: ends for edge, ends in zip(attachments.edges, attachments.ends, strict=True)
        }

    def size(self, kind: str, features: Sequence[Feature], n_unread: int = 0) -> Measure:
        """Return how a diameter or radius is measured.

        Parameters
        ----------
        kind : {"diameter", "radius"}
            Which of them.
        features : sequence of Feature
            All it is attached to; several cylinders are a pattern.
        n_unread : int
            How many more items it is attached to, of which the geometry is not known. Each counts as one feature.
        """
        axes = [
            feature
            for feature in features
            if isinstance(feature, Axis) and feature.radius_mm is not None
        ]
        n_features = len(axes) + n_unread
        if not axes:
            reason = "it is attached to no cylinder and no circle"
            return Measure(kind, reason=reason, n_features=max(n_features, 1))
        factor = 2.0 if kind == "diameter" else 1.0
        ways = tuple(tuple((arc.id,) for arc in circles) for circles in self._of_pattern(axes))
        missing = (
            tuple(None if axis_ways else _NO_CIRCLE for axis_ways in ways) + (_UNREAD,) * n_unread
        )
        ways += ((),) * n_unread
        reason = "" if any(ways) else "no sharp circular edge bounds what it is attached to"
        values = tuple(factor * (axis.radius_mm or 0.0) for axis in axes)
        return Measure(kind, values, ways, reason, n_features=n_features, missing=missing)

    def between(self, feature: Feature, other: Feature) -> Measure:
        """Return how the distance of two features is measured.

        Parameters
        ----------
        feature, other : Feature
            A plane, line or axis each.
        """
        if isinstance(feature, Axis):
            return (
                self._centre_distance(feature, other)
                if isinstance(other, Axis)
                else self._centre_to_edge(feature, other)
            )
        if isinstance(other, Axis):
            return self._centre_to_edge(other, feature)
        direction = _across(feature, other)
        if direction is None:
            return Measure("distance", reason="the two features it is attached to are not parallel")
        value = abs(float((other.point - feature.point) @ direction))
        if value <= self.match_mm:
            return Measure(
                "distance",
                (value,),
                reason="both of its ends are attached to the same plane or line",
            )
        ways = self._edge_pairs(feature, other, direction)
        reason = "" if ways else "no two parallel sharp straight edges bound what it is attached to"
        return Measure("distance", (value,), (ways,), reason, direction)

    def angle(self, feature: Feature, other: Feature) -> Measure:
        """Return how the angle of two features is measured; its values are the angle and its supplement.

        Parameters
        ----------
        feature, other : Feature
            Planes, or lines.
        """
        if isinstance(feature, Plane) and isinstance(other, Plane):
            first = feature.normal
            second = other.normal
        elif isinstance(feature, StraightLine) and isinstance(other, StraightLine):
            first = feature.along
            second = other.along
        else:
            return Measure(
                "angle", reason="it is attached to other than two planes or two straight edges"
            )
        if parallel(first, second):
            return Measure("angle", reason="the two features it is attached to are parallel")
        turn = math.degrees(
            math.atan2(float(np.linalg.norm(np.cross(first, second))), float(first @ second))
        )
        fold = np.cross(first, second) / np.linalg.norm(np.cross(first, second))
        pairs = [
            (a, b)
            for a, b in product(feature.edges, other.edges)
            if a != b and self._both_across(a, b, fold)
        ]
        pairs.sort(key=lambda pair: self._pair_order(pair[0], pair[1], fold))
        reason = (
            ""
            if pairs
            else "no two sharp straight edges across its fold bound what it is attached to"
        )
        return Measure("angle", (turn, 180.0 - turn), (tuple(pairs),), reason)

    def _of_pattern(self, axes: Sequence[Axis]) -> list[list[Arc]]:
        """Return the circles of each feature, best first.

        Among equally good ones, those that face like the first feature's best one come first: one
        image can show many of them.
        """
        circles_of_axes: list[list[Arc]] = []
        lead: FloatArray | None = None
        for axis in axes:
            circles = sorted(axis.circles, key=partial(self._order_beside, lead))
            circles_of_axes.append(circles)
            if lead is None and circles:
                lead = circles[0].axis
        return circles_of_axes

    def _order_beside(
        self, lead: FloatArray | None, arc: Arc
    ) -> tuple[bool, bool, float, bool, int]:
        is_open, hidden, span, number = arc_order(self.sight, arc)
        faces_away = lead is not None and float(arc.axis @ lead) <= 0.0
        return is_open, hidden, span, faces_away, number

    def _along(self, edge_id: int) -> FloatArray:
        start, end = self.ends[edge_id]
        return np.asarray((end - start) / np.linalg.norm(end - start), dtype=np.float64)

    def _both_across(self, a: int, b: int, direction: FloatArray) -> bool:
        return perpendicular(self._along(a), direction) and perpendicular(self._along(b), direction)

    def _edge_pairs(
        self, feature: Plane | StraightLine, other: Plane | StraightLine, direction: FloatArray
    ) -> tuple[Way, ...]:
        """Return the pairs of parallel edges across a direction, best first."""
        pairs = [
            (a, b)
            for a, b in product(feature.edges, other.edges)
            if self._both_across(a, b, direction) and parallel(self._along(a), self._along(b))
        ]
        keys = {
            pair: self._pair_order(*pair, np.cross(self._along(pair[0]), direction))
            for pair in pairs
        }
        return tuple(sorted(pairs, key=keys.__getitem__))

    def _pair_order(
        self, a: int, b: int, beside: FloatArray
    ) -> tuple[bool, bool, float, float, int, int]:
        """Return a key for a pair of edges; `beside` is the normal of the plane in which they should both lie."""
        offset = abs(float((self.ends[b][0] - self.ends[a][0]) @ beside))
        apart = offset > self.match_mm
        shorter = min(self.sight.length_mm(a), self.sight.length_mm(b))
        return not self.sight.together(a, b), apart, -shorter, round(offset, 6), a, b

    def _centre_distance(self, axis: Axis, other: Axis) -> Measure:
        if not parallel(axis.along, other.along):
            return Measure(
                "centre_distance", reason="the two axes it is attached to are not parallel"
            )
        if self.coaxial(axis, other):
            return Measure(
                "centre_distance", (0.0,), reason="both of its ends are attached to the same axis"
            )
        offset = other.point - axis.point
        across = offset - (offset @ axis.along) * axis.along
        value = float(np.linalg.norm(across))
        apart: dict[_Pair, float] = {
            (a, b): self._apart(a.centre - b.centre, axis.along)
            for a, b in product(axis.circles, other.circles)
        }
        reason = "" if apart else "no sharp circular edge is around one of its axes"
        return self._with_circle("centre_distance", value, apart, reason, across / value)

    def _centre_to_edge(self, axis: Axis, other: Plane | StraightLine) -> Measure:
        direction = other.normal if isinstance(other, Plane) else np.cross(axis.along, other.along)
        if isinstance(other, StraightLine) and not perpendicular(axis.along, other.along):
            return Measure(
                "centre_to_edge",
                reason="the edge and the axis it is attached to are not perpendicular",
            )
        if isinstance(other, Plane) and not perpendicular(axis.along, other.normal):
            return Measure(
                "centre_to_edge", reason="the plane and the axis it is attached to are not parallel"
            )
        value = abs(float((axis.point - other.point) @ direction))
        apart: dict[_Pair, float] = {
            (arc, edge): self._apart(arc.centre - self.ends[edge][0], axis.along)
            for arc, edge in product(axis.circles, other.edges)
            if perpendicular(self._along(edge), axis.along)
        }
        reason = (
            ""
            if apart
            else "no sharp circular edge, or no sharp straight edge across its axis, bounds it"
        )
        return self._with_circle("centre_to_edge", value, apart, reason, direction)

    def _apart(self, offset: FloatArray, along: FloatArray) -> float:
        """Return how far two entities are apart along an axis in mm, 0 if they lie in one plane across it."""
        apart = abs(float(offset @ along))
        return round(apart, 6) if apart > self.match_mm else 0.0

    def _with_circle(
        self,
        kind: str,
        value: float,
        apart: Mapping[_Pair, float],
        reason: str,
        direction: FloatArray,
    ) -> Measure:
        """Return the measure by pairs of a circle and another entity, given how far they are apart along the axis."""

        def key(pair: _Pair) -> tuple[object, ...]:
            arc, other = pair
            order = (
                arc_order(self.sight, other)
                if isinstance(other, Arc)
                else (-self.sight.length_mm(other), other)
            )
            return (
                not self.sight.together(arc, other),
                apart[pair],
                *arc_order(self.sight, arc),
                *order,
            )

        ranked = sorted(apart, key=cast("Callable[[_Pair], Any]", key))
        offset = apart[ranked[0]] if ranked else 0.0
        note = f"its entities lie {offset:.6g} mm apart along the axis; it is measured along its direction"
        ways = tuple(
            (arc.id, other.id if isinstance(other, Arc) else other) for arc, other in ranked
        )
        return Measure(kind, (value,), (ways,), reason, direction, note if offset else "")


def _across(feature: Plane | StraightLine, other: Plane | StraightLine) -> FloatArray | None:
    """Return the unit direction in which two planes or lines are apart; None if they are not parallel."""
    if isinstance(feature, StraightLine) and isinstance(other, StraightLine):
        offset = other.point - feature.point
        beside = offset - (offset @ feature.along) * feature.along
        length = float(np.linalg.norm(beside))
        return beside / length if parallel(feature.along, other.along) and length > 0.0 else None
    if isinstance(feature, Plane) and isinstance(other, Plane):
        return feature.normal if parallel(feature.normal, other.normal) else None
    plane, line = (feature, other) if isinstance(feature, Plane) else (other, feature)
    assert isinstance(plane, Plane), "one of the two is a plane"
    assert isinstance(line, StraightLine), "and the other a line"
    return plane.normal if perpendicular(plane.normal, line.along) else None
