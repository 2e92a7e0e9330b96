"""Blocked sets: from where a convex piece of surface hides part of an entity.

Notation
--------
ab   the entity, a closed segment between two vertices of the solid, or between two points of an edge (see `cuts`)
O    a convex piece of a face, P its plane with the outward side positive; O hides something only from points p of ab
     in front of P, because every blocked line of sight enters the solid somewhere
B    {q + t (q - p) : q in O, p in ab in front of P, t >= 0}, the blocked set of O, convex and unbounded

B is cut out by P and by every plane that separates O from ab, touches both, and passes through

* an edge of O and an end of ab in front of P (type B, or A where it is a face next to the entity), or
* ab and a vertex of O (likewise).

Where P separates a from b, the part of ab in front of P ends on P, and the planes through that end and an edge of O
are P itself. So every bounding plane passes through vertices of the solid and ends of ab: quadrics (type C) never bound
a domain of whole-edge observability. Nothing here asks ab to be a whole edge, so it holds for stretches too.

The faces next to the entity block by themselves: from behind both of them at a convex edge, from behind either at a
re-entrant one.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from aspectgraph.exact.planes import find_plane, height, plane_through, side_of
from aspectgraph.solid.solid import Solid
from aspectgraph.visibility.deadline import check_deadline
from aspectgraph.visibility.scene import Scene, chords, end_resolution, entity_ends, line_ends
from aspectgraph.visibility.united_sets import Blockers, united
from compiled.decorators import entry_kernel, kernel_without_refcounts, put

if TYPE_CHECKING:
    from aspectgraph.entities.straight_edges import Entity

# how a plane came about: FACE (face, -1, -1), EDGE_AND_END (edge's two vertices, end of the entity), or
# VERTEX_AND_ENTITY (vertex, both ends of the entity), or, of lamps, CONTRAST (both ends of the entity, brighter face)
FACE, EDGE_AND_END, VERTEX_AND_ENTITY, CONTRAST = range(4)


def blockers(scene: Scene, solid: Solid, entity: Entity, deadline: float = math.inf) -> Blockers:
    """All blocked sets of one entity: the faces next to it first, then every other piece in its way.

    Those of a rim or arc are the blocked sets of all its chords, for a viewpoint that misses a part of one misses a
    part of the whole.
    """
    parts = []
    for chord in chords(entity):
        check_deadline(deadline)
        settle_thin = entity.kind != "edge" or entity.part is not None
        parts.append(_chord_blockers(scene, solid, chord, settle_thin))
    return parts[0] if len(parts) == 1 else united(parts)


def _chord_blockers(scene: Scene, solid: Solid, entity: Entity, settle_thin: bool) -> Blockers:
    """All blocked sets of one straight entity.

    `settle_thin`: where an end is so little in front of a far piece that the plane through it and an edge of the piece
    is the piece's own to within the resolution, take the exact sides. Chords, of which there are many at all angles,
    meet this; an edge's sets stay as they always were, open to that side.
    """
    a, b = entity_ends(scene, solid, entity)
    line = line_ends(scene, solid, entity)
    scene = scene._replace(resolution=end_resolution(scene, solid, entity))
    wedge_first, wedge_plane, wedge_side = _wedge(scene, solid, entity)
    n_face_planes = len(scene.planes)
    room = n_face_planes + 3 * len(scene.pieces.vertices)
    planes = np.empty((room, 4), np.int64)
    planes[:n_face_planes] = scene.planes
    origin = np.full((room, 4), -1, np.int32)
    origin[:n_face_planes, 0] = FACE
    origin[scene.plane_of_face[::-1], 1] = np.arange(len(scene.plane_of_face))[::-1]
    in_the_way = _facing(scene, a, b, wedge_first, wedge_plane, wedge_side)
    size = _apparent_size(scene.points, scene.pieces, in_the_way, a, b)
    order = in_the_way[np.argsort(-size, kind="stable")]
    piece_plane = scene.plane_of_face[scene.pieces.face]
    piece_side = scene.side_of_face[scene.pieces.face]
    first, plane, side, n_planes = _cast(
        scene.points,
        scene.pieces,
        order,
        (piece_plane, piece_side),
        planes,
        n_face_planes,
        origin,
        np.array([a, b, *line]),
        settle_thin,
        scene.resolution,
    )
    return Blockers(
        np.concatenate([wedge_first, wedge_first[-1] + first[1:]]).astype(np.int32),
        np.concatenate([wedge_plane, plane]).astype(np.int32),
        np.concatenate([wedge_side, side]).astype(np.int8),
        planes[:n_planes].copy(),
        origin[:n_planes].copy(),
    )


def _wedge(scene: Scene, solid: Solid, entity: Entity) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The blocked sets of the faces next to the entity, as first, plane, side."""
    sets: set[tuple[tuple[int, int], ...]] = set()
    for edge_id in entity.edge_ids:
        edge = solid.edges[edge_id]
        behind = [(int(scene.plane_of_face[f]), -int(scene.side_of_face[f])) for f in edge.faces]
        sets |= {tuple(sorted(behind))} if edge.dihedral_deg > 0 else {(half,) for half in behind}
    ordered = sorted(sets)
    first = np.cumsum([0] + [len(halves) for halves in ordered])
    flat = np.array([half for halves in ordered for half in halves])
    return first, flat[:, 0], flat[:, 1]


@entry_kernel
def _facing(scene, a, b, wedge_first, wedge_plane, wedge_side):
    """Pieces with an end of the entity in front of them that are not wholly inside one blocked set of the wedge."""
    points = scene.points
    pieces = scene.pieces
    result = np.empty(len(pieces.face), np.int64)
    n = 0
    for piece in range(len(pieces.face)):
        face = pieces.face[piece]
        plane = scene.planes[scene.plane_of_face[face]]
        side = scene.side_of_face[face]
        if (
            side * side_of(plane, points[a], scene.resolution) <= 0
            and side * side_of(plane, points[b], scene.resolution) <= 0
        ):
            continue
        hidden = False
        for k in range(len(wedge_first) - 1):
            inside = True
            for j in range(wedge_first[k], wedge_first[k + 1]):
                for i in range(pieces.first[piece], pieces.first[piece + 1]):
                    point = points[pieces.vertices[i]]
                    if (
                        wedge_side[j]
                        * side_of(scene.planes[wedge_plane[j]], point, scene.resolution)
                        < 0
                    ):
                        inside = False
            hidden |= inside
        if not hidden:
            result[n] = piece
            n += 1
    return result[:n]


@entry_kernel
def _apparent_size(points, pieces, chosen, a, b):
    """Rough solid angle of pieces seen from the middle of the entity; only orders the work."""
    size = np.zeros(len(chosen))
    p = np.zeros(3)
    q = np.zeros(3)
    centre = np.zeros(3)
    normal = np.zeros(3)
    for k in range(len(chosen)):
        loop = pieces.vertices[pieces.first[chosen[k]] : pieces.first[chosen[k] + 1]]
        for axis in range(3):
            centre[axis] = normal[axis] = 0.0
        for i in range(len(loop)):
            for axis in range(3):
                eye = 0.5 * (points[a, axis] + points[b, axis])
                p[axis] = points[loop[i], axis] - eye
                q[axis] = points[loop[(i + 1) % len(loop)], axis] - eye
                centre[axis] += p[axis] / len(loop)
            for axis in range(3):
                j = (axis + 1) % 3
                m = (axis + 2) % 3
                normal[axis] += p[j] * q[m] - p[m] * q[j]
        square = along = 0.0
        for axis in range(3):
            square += centre[axis] * centre[axis]
            along += normal[axis] * centre[axis]
        size[k] = abs(along) / max(np.sqrt(square), 1.0) ** 3
    return size


@kernel_without_refcounts
def _separates(plane, points, loop, others, settle_thin, resolution):
    """Side of the plane on which the loop lies with `others` on the opposite side or on the plane; 0 if none."""
    positive = negative = False
    for tolerance in (resolution, 0.0):
        for v in loop:
            s = side_of(plane, points[v], tolerance)
            positive |= s > 0
            negative |= s < 0
        if positive or negative or not settle_thin:
            break
        # an end just in front of P and far from O: without this plane the set would be open to that side
        resolution = 0.0
    if positive == negative:
        return 0
    side = 1 if positive else -1
    for v in others:
        if side * side_of(plane, points[v], resolution) > 0:
            return 0
    return side


@kernel_without_refcounts
def _side_of_loop(plane, points, loop):
    """Side of the plane on which the loop's farthest vertex lies."""
    farthest = np.int64(0)
    for v in loop:
        h = height(plane, points[v])
        if abs(h) > abs(farthest):
            farthest = h
    return 1 if farthest > 0 else -1


@kernel_without_refcounts
def _side_of_set(plane, points, loop, others, settle_thin, resolution):
    """Side of the plane on which the set lies: that of O, or where O lies in the plane, away from the other end."""
    if settle_thin and resolution > 0.0 and len(others) == 1:
        flat = True
        for v in loop:
            flat &= side_of(plane, points[v], resolution) == 0
        if flat:
            return -side_of(plane, points[others[0]], 0.0)
    return _side_of_loop(plane, points, loop)


@entry_kernel
def _cast(points, pieces, order, placed, planes, n_planes, origin, ends, settle_thin, resolution):
    """Blocked sets of the pieces in the given order; appends their planes to `planes` and `origin`."""
    n_face_planes = n_planes
    room = len(order) + 3 * len(pieces.vertices)
    first = np.zeros(len(order) + 1, np.int32)
    plane_list = np.empty(room, np.int32)
    side_list = np.empty(room, np.int8)
    piece_plane, piece_side = placed
    n = 0
    for row in range(len(order)):
        piece = order[row]
        loop = pieces.vertices[pieces.first[piece] : pieces.first[piece + 1]]
        own = piece_plane[piece]
        outward = piece_side[piece]
        plane_list[n] = own
        side_list[n] = -outward
        start = n
        n = n + 1
        for i in range(len(loop)):
            following = loop[(i + 1) % len(loop)]
            for kind in range(3):
                # kind 0 and 1: edge of O with an end in front of P; kind 2: vertex of O with ab
                if kind < 2:
                    if outward * side_of(planes[own], points[ends[kind]], resolution) <= 0:
                        continue
                    trio = np.array([loop[i], following, ends[kind]])
                    others = ends[1 - kind : 2 - kind]
                else:
                    # the plane of a stretch is that of its edge's line
                    trio = np.array([loop[i], ends[2], ends[3]])
                    others = ends[:0]
                plane = plane_through(points[trio[0]], points[trio[1]], points[trio[2]])
                if (
                    not plane.any()
                    or _separates(plane, points, loop, others, settle_thin, resolution) == 0
                ):
                    continue
                known = find_plane(planes, n_planes, points, trio, resolution)
                if known < 0:
                    known = n_planes
                    put(planes[known], plane)
                    origin[known, 0] = EDGE_AND_END if kind < 2 else VERTEX_AND_ENTITY
                    put(origin[known, 1:], trio)
                    n_planes += 1
                repeated = False
                for k in range(start, n):
                    repeated |= plane_list[k] == known
                if not repeated:
                    plane_list[n] = known
                    side_list[n] = _side_of_set(
                        planes[known], points, loop, others, settle_thin, resolution
                    )
                    n += 1
        first[row + 1] = n
    return first, plane_list[:n].copy(), side_list[:n].copy(), max(n_planes, n_face_planes)
