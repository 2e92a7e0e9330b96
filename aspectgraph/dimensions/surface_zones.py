"""In which zone the faces lie that carry the entities of a dimension, as flatness and profile tolerances say.

A point of the image is carried back to a plane: that of a circle, or that of two lines. A plane of the model carries an
entity if it has this normal and the entity bounds its face.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from aspectgraph.dimensions.features import Attachments, FloatArray, Plane, parallel
from aspectgraph.dimensions.records import EntityId, ModelDimension, SurfaceZone, Way


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
