"""Partition surfaces: the planes that bound viewing domains, and where they come from (paper section 3.4)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from aspectgraph.entities.straight_edges import Entity
from aspectgraph.exact.grid import Grid
from aspectgraph.solid.solid import Solid
from aspectgraph.visibility.casting import CONTRAST, EDGE_AND_END, VERTEX_AND_ENTITY
from aspectgraph.visibility.entity_region import Region
from aspectgraph.visibility.overlay import SharedPlanes
from aspectgraph.visibility.scene import Scene


@dataclass(frozen=True)
class PartitionSurface:
    """A plane across which one entity appears or disappears.

    Attributes
    ----------
    type : str
        ``"A"``: the plane of a face next to the entity. ``"B"``: a plane through the entity and a
        vertex, or through an end of the entity and another edge. ``"L"``, for lamps: a plane
        through the entity on which its contrast is the required one.
    entity : str
        Name of the entity.
    vertices, edges, faces : tuple of int
        Elements of the solid that span the plane, by number. For type A, this is a face. For type
        B, it is an edge and an end of the entity, or a vertex and the entity's edges, or a face in
        the same plane. For type L, it is the entity's edges and the brighter face. For a rim or
        arc, the face is next to one of its chords, and end and edge are those of a chord. An end of
        a stretch inside its edge is no vertex, so the edge of such a plane stands alone.
    plane : tuple of float
        (a, b, c, d) with unit normal, a·x + b·y + c·z = d in mm; `Cell.half_spaces` have the opposite d.
    """

    type: str
    entity: str
    vertices: tuple[int, ...]
    edges: tuple[int, ...]
    faces: tuple[int, ...]
    plane: tuple[float, float, float, float]


class Provenance:
    """Looks up which surfaces a shared plane stands for.

    Parameters
    ----------
    solid, scene, grid
        The solid, and itself on its grid.
    entities : sequence of Entity
    regions : sequence of Region
        Region of each entity.
    shared : SharedPlanes
        Their planes.
    """

    def __init__(
        self,
        solid: Solid,
        scene: Scene,
        grid: Grid,
        entities: Sequence[Entity],
        regions: Sequence[Region],
        shared: SharedPlanes,
    ) -> None:
        self._solid = solid
        self._scene = scene
        self._in_mm = grid.planes_to_mm(shared.planes)
        self._entities = entities
        self._regions = regions
        self._shared = shared
        self._edge_of_pair = {frozenset(edge.vertices): edge.id for edge in solid.edges}
        self._rows = [
            {int(n): row for row, n in reversed(list(enumerate(number)))}
            for number in shared.number
        ]

    def surfaces(
        self, planes: Iterable[int], changed: Iterable[int]
    ) -> tuple[PartitionSurface, ...]:
        """Surfaces on the given shared planes for the entities (by position) that change across them."""
        found = []
        for k in changed:
            for plane in planes:
                row = self._rows[k].get(plane)
                if row is not None and self._regions[k].origin[row, 0] >= 0:
                    found.append(self._surface(k, row, plane))
        return tuple(found)

    def _surface(self, k: int, row: int, plane: int) -> PartitionSurface:
        entity = self._entities[k]
        kind, *numbers = self._regions[k].origin[row].tolist()
        next_to = tuple(
            f
            for edge_id in entity.edge_ids
            for f in self._solid.edges[edge_id].faces
            if self._same_plane(
                self._scene.planes[self._scene.plane_of_face[f]], self._shared.planes[plane]
            )
        )
        vertices: tuple[int, ...] = ()
        edges: tuple[int, ...] = ()
        faces: tuple[int, ...] = next_to
        if not next_to:
            if kind == EDGE_AND_END:
                edge = self._edge_of_pair.get(frozenset(numbers[:2]))
                edges = () if edge is None else (edge,)
                ends = numbers[2:] if edges else numbers
                # an end of a stretch is no vertex
                vertices = tuple(v for v in ends if v < len(self._solid.vertices))
            elif kind == VERTEX_AND_ENTITY:
                vertices = (numbers[0],)
                edges = self._spanning(entity, numbers[1:])
            elif kind == CONTRAST:
                edges = self._spanning(entity, numbers[:2])
                faces = (numbers[2],)
            else:
                faces = (numbers[0],)
        in_mm = tuple(self._in_mm[plane].tolist())
        kind_of = "A" if next_to else "B"
        if kind == CONTRAST and not next_to:
            kind_of = "L"
        return PartitionSurface(kind_of, entity.name, vertices, edges, faces, in_mm)

    def _spanning(self, entity: Entity, ends: list[int]) -> tuple[int, ...]:
        """The edges of an entity between two of its vertices: all of an edge or chain, one chord of a rim or arc."""
        chord = self._edge_of_pair.get(frozenset(ends))
        return entity.edge_ids if entity.kind == "edge" or chord is None else (chord,)

    @staticmethod
    def _same_plane(plane: np.ndarray, other: np.ndarray) -> bool:
        return bool((plane == other).all() or (plane == -other).all())
