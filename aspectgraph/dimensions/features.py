"""What dimensions are attached to: planes, lines and axes of the CAD model, with the entities of the solid on them.

A plane is seen by the straight sharp edges around its faces, a line by the edges on it, the axis of a cylinder or of a
circle by the rims and arcs around it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from aspectgraph.dimensions.records import EntityId, ModelDimension, SurfaceZone, Way
from aspectgraph.solid.rims import Arc, Rim
from aspectgraph.solid.solid import Solid
from aspectgraph.solid.topology import describe_point

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
        self.edges = solid.straight_edges()
        self.ends = np.array([solid.edge_points(edge.id) for edge in self.edges]).reshape(-1, 2, 3)
        self.circles: tuple[Arc, ...] = (*solid.rims(), *solid.arcs())
        lowest, highest = solid.bounds
        self.match_mm = RELATIVE_MATCH * float(np.linalg.norm(highest - lowest))

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
