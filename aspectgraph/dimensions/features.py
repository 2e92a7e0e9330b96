"""What a dimension states, the features of the solid it is attached to, and the entities that measure it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import partial
from itertools import product
from typing import Any, TypeAlias, cast

import numpy as np
import numpy.typing as npt

from aspectgraph.solid.rims import Arc, Rim
from aspectgraph.solid.solid import Solid
from aspectgraph.solid.topology import describe_point

# A dimension of the CAD model, as the caller gets it.


EntityId: TypeAlias = int | str
"""Id of a straight edge (``17``), rim (``"r3"``) or arc (``"a0"``) of the solid."""

Way: TypeAlias = tuple[EntityId, ...]
"""Entities that measure a dimension together, in one image."""


@dataclass(frozen=True)
class SurfaceZone:
    """The zone in which a face lies, as a flatness or profile tolerance of the model says.

    Attributes
    ----------
    tolerance : str
        ``"flatness"`` or ``"profile"``.
    width_mm : float
        Width of the zone, mm.
    places : bool
        Whether the zone also says where the face is, not only how true to form it is.
    """

    tolerance: str
    width_mm: float
    places: bool


@dataclass(frozen=True)
class ModelDimension:
    """A dimension that a CAD model states, and how it can be measured.

    Attributes
    ----------
    name : str
        Unique name: the name in the model, or kind and number. If the assembly contains its part
        several times, the numbers of its solids follow, as in ``"diameter 1 (solid 2)"``.
    kind : str
        ``"diameter"``, ``"radius"``, ``"distance"``, ``"centre_distance"``, ``"centre_to_edge"`` or
        ``"angle"``; or a kind that is never measurable, such as ``"spherical_radius"``.
    nominal : float or None
        Nominal value in mm, of angles in degrees. None if neither the model nor its geometry has a
        value.
    tolerance : tuple of float or None
        Lower and upper deviation permitted from the nominal value, in the same unit. None if the model states none.
    entities : tuple or None
        Ids of the solid's entities that measure it in one image. None if that is impossible.
    reason : str or None
        Why it cannot be measured. None if it can be.
    alternatives : tuple of tuple
        Other entities that measure it, best first.
    features : tuple of tuple of tuple
        For each feature (each hole of a pattern), all entities that can measure it, best first.
        Empty for a feature that cannot be measured. ``entities`` are the best ones of the first
        measurable feature.
    geometry : float or None
        The value in the model's geometry, in the same unit.
    direction : tuple of float or None
        Unit vector along which a distance is measured.
    attached : tuple of str
        The elements of the model that it refers to.
    note : str
        Sentence on inferred or repaired values; empty if there are none.
    n_features : int
        Number of features, measurable or not. Each hole of a pattern is one.
    solids : tuple of int
        The solids of the file that it refers to, counted from 0 in the order of the file. Empty if
        unknown.
    feature_reasons : tuple of str or None
        For each feature why it cannot be measured. None where it can be. Empty like ``features``
        if no feature can be measured.
    tolerance_class : str or None
        The class of ISO 286 that the model states, such as ``"H7"``. ``tolerance`` has its limits.
    role : str or None
        ``"reference"`` for a dimension that is given for information only (in parentheses on a
        drawing); ``"basic"`` for one that is theoretically exact (in a box). None for others.
    surfaces : tuple of SurfaceZone or None
        For each feature the zone of the faces that carry its best entities. None where the model
        states no flatness or profile tolerance of them.
    """

    name: str
    kind: str
    nominal: float | None
    tolerance: tuple[float, float] | None
    entities: Way | None
    reason: str | None
    alternatives: tuple[Way, ...] = ()
    features: tuple[tuple[Way, ...], ...] = ()
    geometry: float | None = None
    direction: tuple[float, float, float] | None = None
    attached: tuple[str, ...] = ()
    note: str = ""
    n_features: int = 1
    solids: tuple[int, ...] = ()
    feature_reasons: tuple[str | None, ...] = ()
    tolerance_class: str | None = None
    role: str | None = None
    surfaces: tuple[SurfaceZone | None, ...] = ()

    @property
    def unit(self) -> str:
        """Unit of its values: ``"mm"`` or ``"deg"``."""
        return "deg" if self.kind == "angle" else "mm"

    def to_dict(self) -> dict[str, Any]:
        """Return the dimension as JSON values: every attribute by name, and ``unit``.

        Returns
        -------
        dict
            Its keys in the order of the attributes; ``unit`` comes last.
        """
        return {**_plain(asdict(self)), "unit": self.unit}

    def __repr__(self) -> str:
        """Return a one-line summary."""
        value = "no value" if self.nominal is None else f"{self.nominal:.6g} {self.unit}"
        note = (
            f"not measurable: {self.reason}"
            if self.entities is None
            else f"by {list(self.entities)}"
        )
        return f"<ModelDimension {self.name!r}: {self.kind} {value}, {note}>"


def _plain(value: Any) -> Any:
    """Return a value with lists for tuples, at any depth."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    return [_plain(item) for item in value] if isinstance(value, list | tuple) else value


def unique_names(names: Sequence[str]) -> list[str]:
    """Return names with ``" #2"``, ``" #3"``, … behind each that occurred before.

    Parameters
    ----------
    names : sequence of str
        In their order, which is kept.
    """
    unique: list[str] = []
    for name in names:
        candidates = (name if k == 1 else f"{name} #{k}" for k in range(1, len(names) + 1))
        unique.append(next(candidate for candidate in candidates if candidate not in unique))
    return unique


# What dimensions are attached to: planes, lines and axes of the CAD model, with the entities of
# the solid on them.
#
# A plane is seen by the straight sharp edges around its faces, a line by the edges on it, the
# axis of a cylinder or of a circle by the rims and arcs around it.


FloatArray: TypeAlias = npt.NDArray[np.float64]

RELATIVE_MATCH = 1e-5
"""An edge lies on a line of the CAD model if it leaves it by less, as a fraction of the bounding box diagonal.

Vertices of real parts lie on the ends of their edges to 2·10⁻⁵ mm (see `fit`); the solid welds them within a tenth of
this.
"""

RELATIVE_CIRCLE = 1e-4
"""The same for circles, as a fraction of the radius: writers round the two halves of a circle separately."""

PARALLEL = 1e-4
"""Directions that differ by less, in radians, are parallel: 0.01 mm over a length of 100 mm."""


@dataclass(frozen=True)
class Plane:
    """A plane: a point in mm, its unit normal, and the ids of the edges around the faces in it."""

    point: FloatArray
    normal: FloatArray
    edges: tuple[int, ...]


@dataclass(frozen=True)
class StraightLine:
    """A straight edge: a point in mm, its unit direction, and the ids of its edges."""

    point: FloatArray
    along: FloatArray
    edges: tuple[int, ...]


@dataclass(frozen=True)
class Axis:
    """Coaxial cylinders and circles of one radius: a point in mm, its unit direction, and the circles to be seen.

    The radius is None where several were put together.
    """

    point: FloatArray
    along: FloatArray
    radius_mm: float | None
    circles: tuple[Arc, ...]


Feature: TypeAlias = Plane | StraightLine | Axis


class Attachments:
    """Finds the features of attached shapes in a solid.

    Parameters
    ----------
    solid : Solid
        The part, read from the same file.
    """

    def __init__(self, solid: Solid):
        self.vertices = solid.vertices
        self.edges = solid.straight_edges()
        self.ends = np.array([solid.edge_points(edge.id) for edge in self.edges]).reshape(-1, 2, 3)
        self.circles: tuple[Arc, ...] = (*solid.rims(), *solid.arcs())
        lowest, highest = solid.bounds
        self.match_mm = RELATIVE_MATCH * float(np.linalg.norm(highest - lowest))

    def has_vertex_on(self, edge: dict[str, Any]) -> bool:
        """Return whether the solid has a vertex at an end of a line, or on a circle.

        Parameters
        ----------
        edge : dict
            A shape that is a line or a circle, see `semantic_dimensions.describe`.
        """
        if edge["kind"] == "line":
            apart = np.linalg.norm(self.vertices[:, None] - np.array(edge["ends"]), axis=2)
            return bool(apart.min() <= self.match_mm)
        off = self.vertices - np.array(edge["point"])
        above = off @ np.array(edge["axis"])
        beside = np.linalg.norm(off - above[:, None] * np.array(edge["axis"]), axis=1)
        apart = np.hypot(above, beside - edge["radius"])
        return bool(apart.min() <= self._circle_mm(self._bare(edge)))

    def features(self, shapes: Sequence[dict[str, Any]]) -> list[Feature]:
        """Return the features of shapes, each once, in their order; shapes that are none of them are left out.

        Parameters
        ----------
        shapes : sequence of dict
            See `semantic_dimensions.describe`.

        Returns
        -------
        list of Plane, StraightLine or Axis
            Faces in one plane are one feature, coaxial cylinders and circles of one radius are one.
        """
        features: list[Feature] = []
        for shape in shapes:
            feature = self._feature(shape)
            same = next(
                (
                    k
                    for k, old in enumerate(features)
                    if feature is not None and self._same(old, feature)
                ),
                None,
            )
            if feature is not None and same is None:
                features.append(feature)
            elif feature is not None and same is not None:
                features[same] = _joined(features[same], feature)
        return features

    def _feature(self, shape: dict[str, Any]) -> Feature | None:
        if shape["kind"] == "plane":
            edges = {
                i
                for edge in shape["edges"]
                if edge["kind"] == "line"
                for i in self._edges_on(edge["ends"])
            }
            return Plane(np.array(shape["point"]), np.array(shape["axis"]), tuple(sorted(edges)))
        if shape["kind"] == "line":
            start, end = np.array(shape["ends"])
            return StraightLine(
                start,
                (end - start) / np.linalg.norm(end - start),
                tuple(self._edges_on(shape["ends"])),
            )
        circles = [edge for edge in (shape, *shape.get("edges", ())) if edge["kind"] == "circle"]
        if shape["kind"] in ("circle", "cylinder"):
            around = Axis(np.array(shape["point"]), np.array(shape["axis"]), shape["radius"], ())
        else:
            return self._axis_of_revolved(circles)
        circles = [circle for circle in circles if self._same(around, self._bare(circle))]
        return Axis(around.point, around.along, around.radius_mm, self.circles_on(circles))

    def _axis_of_revolved(self, circles: list[dict[str, Any]]) -> Axis | None:
        """Return the axis of a cone or free-form face, if all circles around it that are not seams share one."""
        axes = [self._bare(circle) for circle in circles]
        if not axes or not all(self.coaxial(axes[0], axis) for axis in axes):
            return None
        return Axis(axes[0].point, axes[0].along, None, self.circles_on(circles))

    def _bare(self, circle: dict[str, Any]) -> Axis:
        return Axis(np.array(circle["point"]), np.array(circle["axis"]), circle["radius"], ())

    def coaxial(self, axis: Axis, other: Axis) -> bool:
        """Return whether two axes are the same line."""
        beside = np.cross(other.point - axis.point, axis.along)
        return parallel(axis.along, other.along) and float(
            np.linalg.norm(beside)
        ) <= self._circle_mm(axis, other)

    def _circle_mm(self, *axes: Axis) -> float:
        return max(self.match_mm, *(RELATIVE_CIRCLE * (axis.radius_mm or 0.0) for axis in axes))

    def _same(self, feature: Feature, other: Feature) -> bool:
        if isinstance(feature, Plane) and isinstance(other, Plane):
            away = abs(float((other.point - feature.point) @ feature.normal))
            return parallel(feature.normal, other.normal) and away <= self.match_mm
        if isinstance(feature, StraightLine) and isinstance(other, StraightLine):
            beside = float(np.linalg.norm(np.cross(other.point - feature.point, feature.along)))
            return parallel(feature.along, other.along) and beside <= self.match_mm
        if isinstance(feature, Axis) and isinstance(other, Axis):
            if feature.radius_mm is None or other.radius_mm is None:
                return feature.radius_mm is other.radius_mm and self.coaxial(feature, other)
            alike = abs(feature.radius_mm - other.radius_mm) <= self._circle_mm(feature, other)
            return alike and self.coaxial(feature, other)
        return False

    def _edges_on(self, ends: Sequence[Sequence[float]]) -> list[int]:
        """Return the ids of the sharp straight edges on a segment."""
        start, end = np.array(ends)
        length = float(np.linalg.norm(end - start))
        along = (end - start) / length
        offset = self.ends - start
        place = offset @ along
        beside = np.linalg.norm(offset - place[..., None] * along, axis=2)
        inside = (
            (place >= -self.match_mm)
            & (place <= length + self.match_mm)
            & (beside <= self.match_mm)
        )
        return [self.edges[k].id for k in np.flatnonzero(inside.all(axis=1)).tolist()]

    def circles_on(self, circles: Sequence[dict[str, Any]]) -> tuple[Arc, ...]:
        """Return the rims and arcs of the solid that lie on some circles of the CAD model.

        Parameters
        ----------
        circles : sequence of dict
            See `semantic_dimensions.describe`.
        """
        return tuple(
            arc
            for arc in self.circles
            if any(self._lies_on(arc, self._bare(circle)) for circle in circles)
        )

    def _lies_on(self, arc: Arc, circle: Axis) -> bool:
        allowed = self._circle_mm(circle)
        near = float(np.linalg.norm(arc.centre - circle.point)) <= allowed
        return (
            near
            and abs(arc.radius_mm - (circle.radius_mm or 0.0)) <= allowed
            and parallel(arc.axis, circle.along)
        )


def parallel(vector: FloatArray, other: FloatArray) -> bool:
    """Return whether two unit vectors are parallel, either way."""
    return float(np.linalg.norm(np.cross(vector, other))) <= PARALLEL


def perpendicular(vector: FloatArray, other: FloatArray) -> bool:
    """Return whether two unit vectors are perpendicular."""
    return abs(float(vector @ other)) <= PARALLEL


def _joined(feature: Feature, other: Feature) -> Feature:
    """Return a feature with the entities of another that is the same."""
    if isinstance(feature, Axis) and isinstance(other, Axis):
        more = tuple(arc for arc in other.circles if arc not in feature.circles)
        return Axis(feature.point, feature.along, feature.radius_mm, feature.circles + more)
    if isinstance(feature, Plane) and isinstance(other, Plane):
        return Plane(feature.point, feature.normal, tuple(sorted({*feature.edges, *other.edges})))
    assert isinstance(feature, StraightLine), "only features of one type are joined"
    assert isinstance(other, StraightLine), "only features of one type are joined"
    return StraightLine(feature.point, feature.along, tuple(sorted({*feature.edges, *other.edges})))


def describe_shape(shape: dict[str, Any]) -> str:
    """Return an attached shape in words: kind, size and place."""
    kind = shape["kind"]
    if kind == "plane":
        return f"plane through {describe_point(np.array(shape['point']))}"
    if kind == "line":
        start, end = np.array(shape["ends"])
        return f"edge from {describe_point(start)} to {describe_point(end)}"
    if kind in ("cylinder", "circle"):
        return f"{kind} of radius {shape['radius']:.6g} mm at {describe_point(np.array(shape['point']))}"
    if "point" in shape:
        return f"{kind} at {describe_point(np.array(shape['point']))}"
    return f"{kind} face or edge"


# Which of several entities, or pairs of them, to offer first.
#
# Order: those that some direction sees together, judged by their own faces alone; those in one
# plane; closed circles before open ones, the longer shorter edge; the lower ids. Nothing is left
# out: what hides an entity is for the aspect graph to say.


N_DIRECTIONS = 500
"""Directions tried: 10 degrees apart."""


class Sight:
    """From which directions the faces beside an entity let it be seen.

    Parameters
    ----------
    solid : Solid
        The part.
    """

    def __init__(self, solid: Solid):
        self.solid = solid
        self.directions = _directions()
        self._seen: dict[tuple[int, ...], npt.NDArray[np.bool_]] = {}

    def together(self, *entities: int | Arc) -> bool:
        """Return whether some direction sees all of the entities.

        Parameters
        ----------
        *entities : int or Arc
            Ids of edges, rims and arcs.
        """
        return bool(np.all([self._of(entity) for entity in entities], axis=0).any())

    def length_mm(self, edge_id: int) -> float:
        """Return the length of an edge, rounded so that equal edges are equal.

        Parameters
        ----------
        edge_id : int
            Its id.
        """
        return round(self.solid.edge_length_mm(edge_id), 6)

    def _of(self, entity: int | Arc) -> npt.NDArray[np.bool_]:
        ids = entity.edge_ids if isinstance(entity, Arc) else (entity,)
        if ids not in self._seen:
            self._seen[ids] = np.all([self._of_edge(i) for i in ids], axis=0)
        return self._seen[ids]

    def _of_edge(self, edge_id: int) -> npt.NDArray[np.bool_]:
        edge = self.solid.edges[edge_id]
        front = self.directions @ self.solid.normals[list(edge.faces)].T > 0.0
        # a convex edge shows with either face, a re-entrant one with both
        seen = front.any(axis=1) if edge.dihedral_deg > 0 else front.all(axis=1)
        return np.asarray(seen, dtype=np.bool_)


def arc_order(sight: Sight, arc: Arc) -> tuple[bool, bool, float, int]:
    """Return a key that sorts rims and arcs, the one to be preferred first.

    Parameters
    ----------
    sight : Sight
        Of the solid.
    arc : Arc
        A rim or arc.
    """
    span = round(arc.end_rad - arc.start_rad, 6)
    return not isinstance(arc, Rim), not sight.together(arc), -span, int(arc.id[1:])


def _directions() -> FloatArray:
    """Return unit vectors spread evenly (a Fibonacci lattice), shape (n, 3)."""
    k = np.arange(N_DIRECTIONS) + 0.5
    z = 1.0 - 2.0 * k / N_DIRECTIONS
    turn = np.pi * (1.0 + np.sqrt(5.0)) * k
    across = np.sqrt(1.0 - z * z)
    return np.column_stack([across * np.cos(turn), across * np.sin(turn), z])


# In which zone the faces lie that carry the entities of a dimension, as flatness and profile
# tolerances say.
#
# A point of the image is carried back to a plane: that of a circle, or that of two lines. A plane
# of the model carries an entity if it has this normal and the entity bounds its face.


@dataclass(frozen=True)
class _Face:
    """A toleranced plane: its unit normal, the entities that bound it, and its zone."""

    normal: FloatArray
    entities: frozenset[EntityId]
    zone: SurfaceZone


class SurfaceZones:
    """Zones of the plane faces of a part.

    Parameters
    ----------
    attachments : Attachments
        Of the solid.
    surfaces : sequence of dict
        See `semantic_dimensions.read_semantic_dimensions`.
    """

    def __init__(self, attachments: Attachments, surfaces: Sequence[dict[str, Any]]):
        self._along = {
            edge.id: (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
            for edge, ends in zip(attachments.edges, attachments.ends, strict=True)
        }
        self._axes = {arc.id: arc.axis for arc in attachments.circles}
        self._faces = [face for row in surfaces if (face := _face(attachments, row)) is not None]

    def of_dimension(self, dimension: ModelDimension) -> tuple[SurfaceZone | None, ...]:
        """Return for each feature of a dimension the zone of the faces that carry its first entities.

        Parameters
        ----------
        dimension : ModelDimension
            With its features.
        """
        return tuple(
            self.of_way(ways[0], dimension.direction) if ways else None
            for ways in dimension.features
        )

    def of_way(self, way: Way, direction: Sequence[float] | None) -> SurfaceZone | None:
        """Return the zone of the faces that carry some entities; None if the model states none.

        Of several faces the widest zone counts. It says where they are only if each of theirs does.

        Parameters
        ----------
        way : tuple of int or str
            Ids of the entities.
        direction : sequence of float or None
            Of a distance.
        """
        normal = self._normal(way, direction)
        if normal is None:
            return None
        zones = [self._carrying(entity, normal) for entity in way]
        stated = [zone for zone in zones if zone is not None]
        if not stated:
            return None
        widest = max(stated, key=lambda zone: zone.width_mm)
        all_place = len(stated) == len(zones) and all(zone.places for zone in stated)
        return SurfaceZone(widest.tolerance, widest.width_mm, all_place)

    def _normal(self, way: Way, direction: Sequence[float] | None) -> FloatArray | None:
        """Return the normal of the planes in which entities are measured; None if they have none."""
        axes = [self._axes[entity] for entity in way if entity in self._axes]
        if axes:
            return axes[0]
        lines = [self._along[entity] for entity in way if entity in self._along]
        if len(lines) != 2:
            return None
        across = np.cross(lines[0], lines[1] if direction is None else np.array(direction))
        size = float(np.linalg.norm(across))
        return across / size if size > 0.0 else None

    def _carrying(self, entity: EntityId, normal: FloatArray) -> SurfaceZone | None:
        """Return the zone of the face with a normal that an entity bounds.

        Of several, those that say where the face is come first, and of these the widest.
        """
        zones = [
            face.zone
            for face in self._faces
            if entity in face.entities and parallel(face.normal, normal)
        ]
        return max(zones, key=lambda zone: (zone.places, zone.width_mm), default=None)


def _face(attachments: Attachments, row: dict[str, Any]) -> _Face | None:
    features = attachments.features([row["face"]])
    feature = features[0] if features else None
    if not isinstance(feature, Plane):
        return None
    circles = [edge for edge in row["face"]["edges"] if edge["kind"] == "circle"]
    bounding = [arc.id for arc in attachments.circles_on(circles)]
    zone = SurfaceZone(row["tolerance"], float(row["width_mm"]), bool(row["places"]))
    return _Face(feature.normal, frozenset([*feature.edges, *bounding]), zone)


# How a dimension between given features can be measured: its kind, its value in the geometry, and
# its entities.
#
# * diameter, radius: a rim or arc of the cylinder.
# * distance: two parallel edges, one on each plane or line, across the direction of the dimension. They lie in one
#   plane with that direction, or in two parallel ones.
# * centre_to_edge: a rim or arc, and an edge across its axis. centre_distance: two rims or arcs. Where the two lie in
#   one plane, their distance is the dimension; else it is their distance along the direction of the dimension.
# * angle: two edges across the line in which the planes meet.


_NO_CIRCLE = "no sharp circular edge bounds this feature"
_UNREAD = "the file attaches it to an item of this feature that could not be read"
_Pair: TypeAlias = tuple[Arc, Arc | int]


@dataclass(frozen=True)
class MeasuringWays:
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


class WaysFinder:
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

    def size(self, kind: str, features: Sequence[Feature], n_unread: int = 0) -> MeasuringWays:
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
            return MeasuringWays(kind, reason=reason, n_features=max(n_features, 1))
        factor = 2.0 if kind == "diameter" else 1.0
        ways = tuple(tuple((arc.id,) for arc in circles) for circles in self._of_pattern(axes))
        missing = (
            tuple(None if axis_ways else _NO_CIRCLE for axis_ways in ways) + (_UNREAD,) * n_unread
        )
        ways += ((),) * n_unread
        reason = "" if any(ways) else "no sharp circular edge bounds what it is attached to"
        values = tuple(factor * (axis.radius_mm or 0.0) for axis in axes)
        return MeasuringWays(kind, values, ways, reason, n_features=n_features, missing=missing)

    def between(self, feature: Feature, other: Feature) -> MeasuringWays:
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
            return MeasuringWays(
                "distance", reason="the two features it is attached to are not parallel"
            )
        value = abs(float((other.point - feature.point) @ direction))
        if value <= self.match_mm:
            return MeasuringWays(
                "distance",
                (value,),
                reason="both of its ends are attached to the same plane or line",
            )
        ways = self._edge_pairs(feature, other, direction)
        reason = "" if ways else "no two parallel sharp straight edges bound what it is attached to"
        return MeasuringWays("distance", (value,), (ways,), reason, direction)

    def angle(self, feature: Feature, other: Feature) -> MeasuringWays:
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
            return MeasuringWays(
                "angle", reason="it is attached to other than two planes or two straight edges"
            )
        if parallel(first, second):
            return MeasuringWays("angle", reason="the two features it is attached to are parallel")
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
        return MeasuringWays("angle", (turn, 180.0 - turn), (tuple(pairs),), reason)

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

    def _centre_distance(self, axis: Axis, other: Axis) -> MeasuringWays:
        if not parallel(axis.along, other.along):
            return MeasuringWays(
                "centre_distance", reason="the two axes it is attached to are not parallel"
            )
        if self.coaxial(axis, other):
            return MeasuringWays(
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

    def _centre_to_edge(self, axis: Axis, other: Plane | StraightLine) -> MeasuringWays:
        direction = other.normal if isinstance(other, Plane) else np.cross(axis.along, other.along)
        if isinstance(other, StraightLine) and not perpendicular(axis.along, other.along):
            return MeasuringWays(
                "centre_to_edge",
                reason="the edge and the axis it is attached to are not perpendicular",
            )
        if isinstance(other, Plane) and not perpendicular(axis.along, other.normal):
            return MeasuringWays(
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
    ) -> MeasuringWays:
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
        return MeasuringWays(kind, (value,), (ways,), reason, direction, note if offset else "")


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
