"""A solid on its grid, as everything that asks for visibility needs it, and the entities' places there."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from aspectgraph.entities.parts import Stretch
from aspectgraph.entities.straight_edges import Entity
from aspectgraph.exact.canonical_axes import own_frame
from aspectgraph.exact.canonical_order import list_solid
from aspectgraph.exact.grid import DISPLACED_RESOLUTION, Grid, turned
from aspectgraph.exact.planes import face_planes
from aspectgraph.exact.small_details import resolving_grid
from aspectgraph.solid.solid import Solid
from aspectgraph.visibility.convex_pieces import Pieces, convex_pieces
from aspectgraph.visibility.cuts import cut_numbers, cuts_on_line, with_cuts


class Scene(NamedTuple):
    """A solid on its grid, as the shadows need it.

    Attributes
    ----------
    points : ndarray of int64, shape (n, 3)
        Vertices in grid steps, then the ends of stretches that are none (see `cuts`).
    resolution : float
        See `grid.Grid`.
    planes : ndarray of int64, shape (p, 4)
        Planes of the faces.
    plane_of_face : ndarray, shape (f,)
    side_of_face : ndarray, shape (f,)
        1 where the outward side of a face is the positive side of its plane, else -1.
    pieces : Pieces
    """

    points: np.ndarray
    resolution: float
    planes: np.ndarray
    plane_of_face: np.ndarray
    side_of_face: np.ndarray
    pieces: Pieces


def own_order(scene: Scene, solid: Solid, entities: Iterable[Entity]) -> list[int]:
    """Positions of entities in an order that depends on their places on the part alone."""
    ends = [_places(scene, solid, entity) for entity in entities]
    return sorted(range(len(ends)), key=ends.__getitem__)


def _places(scene: Scene, solid: Solid, entity: Entity) -> list[int]:
    """Coordinates on the grid of an edge's ends, or of all chords' ends, in an order of their own."""
    if entity.kind == "edge":
        ends = list(entity_ends(scene, solid, entity))
    else:
        used = {v for edge_id in entity.edge_ids for v in solid.edges[edge_id].vertices}
        ends = sorted(used, key=lambda v: scene.points[v].tolist())
    return [int(x) for x in scene.points[ends].ravel()]


def chords(entity: Entity) -> list[Entity]:
    """Return the straight pieces that must be seen, each by itself: an edge is one, a rim or arc all its chords."""
    if entity.kind == "edge":
        return [entity]
    ends = list(pairwise(entity.outline))
    return [
        Entity(entity.name, np.array(pair), (e,))
        for pair, e in zip(ends, entity.edge_ids, strict=True)
    ]


def line_ends(scene: Scene, solid: Solid, entity: Entity) -> tuple[int, int]:
    """Vertex numbers of the two ends of a straight entity's edges, sorted by their places on the grid."""
    ends: set[int] = set()
    for edge_id in entity.edge_ids:
        ends ^= set(solid.edges[edge_id].vertices)
    first, last = sorted(ends, key=lambda v: scene.points[v].tolist())
    return first, last


def entity_ends(scene: Scene, solid: Solid, entity: Entity) -> tuple[int, int]:
    """Numbers of the points where a straight entity ends, sorted by their places: those of a stretch may be cuts."""
    line = line_ends(scene, solid, entity)
    if not isinstance(entity.part, Stretch):
        return line
    return cut_numbers(solid, scene.points, entity.part, line)


def end_resolution(scene: Scene, solid: Solid, entity: Entity) -> float:
    """Distance in steps up to which a point counts as lying on a plane for one straight entity."""
    if not isinstance(entity.part, Stretch) or scene.resolution > 0.0:
        return scene.resolution
    exact = cuts_on_line(solid, scene.points, entity.part)
    return scene.resolution if exact else DISPLACED_RESOLUTION


def make_scene(solid: Solid, entities: Mapping[str, Entity] | None = None) -> tuple[Grid, Scene]:
    """Lay a solid on its grid, in its own frame and order; entities tell the sides of a symmetric part apart."""
    marks = [] if entities is None else [entities[name].edge_ids for name in sorted(entities)]
    frame = own_frame(solid, marks)
    grid = resolving_grid(solid, frame)
    listing = list_solid(solid, grid.points)
    loops = [np.empty(0, int)] * len(solid.faces)
    for face, number in zip(listing.faces, listing.face, strict=True):
        loops[number] = listing.vertex[list(face.outer)]
    planes, plane_of_face, side_of_face = face_planes(
        grid, loops, turned(frame, solid.normals), listing.face
    )
    pieces = convex_pieces(
        solid, grid.points, planes[plane_of_face, :3] * side_of_face[:, None], listing
    )
    points = with_cuts(solid, grid.points, [] if entities is None else entities.values())
    return grid, Scene(points, grid.resolution, planes, plane_of_face, side_of_face, pieces)
