"""The solid on its integer grid, and the shadows that its pieces cast from an entity."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping, Sequence
from fractions import Fraction
from itertools import pairwise
from math import gcd
from typing import NamedTuple

import numpy as np

from aspectgraph.entities.entity import Entity, Stretch
from aspectgraph.exact.grid import (
    DISPLACED_RESOLUTION,
    Grid,
    Listing,
    face_planes,
    height,
    list_solid,
    own_frame,
    plane_through,
    resolving_grid,
    side_of,
    turned,
)
from aspectgraph.exceptions import EntityError, SolidError
from aspectgraph.solid.solid import Solid
from aspectgraph.solid.topology import Face, triangulate_face
from ground.decorators import entry_kernel, kernel, kernel_without_refcounts, put

# A solid on its grid, as everything that asks for visibility needs it, and the entities' places
# there.


# A time by which a computation ends, whether or not it is complete.


class DeadlineError(Exception):
    """The deadline has passed. It never leaves the package."""


def check_deadline(deadline: float) -> None:
    """Raise `DeadlineError` if a time (`time.time`, which other machines share) has passed."""
    if time.time() > deadline:
        raise DeadlineError


# Convex pieces of a solid's faces: what can stand in the way of a line of sight.
#
# Triangles of a face are joined across their common sides as long as the result stays convex
# (Hertel and Mehlhorn, "Fast triangulation of simple polygons", FCT 1983: at most four times as
# many pieces as the fewest possible). Convexity is decided by exact integer orientation in the
# face's projection along its dominant axis.


class Pieces(NamedTuple):
    """Convex polygons, counter-clockwise seen from outside.

    Attributes
    ----------
    vertices : ndarray of int32
        Vertex numbers of all loops, one after the other.
    first : ndarray of int32, shape (n + 1,)
        Where each loop starts.
    face : ndarray of int32, shape (n,)
        The face of the solid each piece belongs to.
    """

    vertices: np.ndarray
    first: np.ndarray
    face: np.ndarray


def convex_pieces(
    solid: Solid, points: np.ndarray, normals: np.ndarray, listing: Listing
) -> Pieces:
    """Cut every face of a solid into convex pieces, in the part's own order.

    Parameters
    ----------
    solid : Solid
    points : ndarray of int64, shape (n, 3)
        Its vertices on the grid.
    normals : ndarray of int64, shape (f, 3)
        Outward normals of its faces on the grid, of any length.
    listing : Listing
    """
    ranked = points[listing.vertex]
    drawn: dict[tuple[int, bool], list[list[int]]] = {}
    loops: list[list[int]] = []
    faces: list[int] = []
    for face, number in zip(listing.faces, listing.face.tolist(), strict=True):
        axis = int(np.abs(normals[number]).argmax())
        view = axis, bool(normals[number][axis] < 0)
        xy = drawn[view] = drawn.get(view) or _project(ranked, *view)
        if not face.holes and _is_convex(face.outer, xy):
            parts = [list(face.outer)]
        else:
            parts = _join(
                _triangles(
                    ranked, face, normals[number], listing.rank[solid.face_triangles[number]]
                ),
                xy,
            )
        loops += parts
        faces += [number] * len(parts)
    first = np.concatenate([[0], np.cumsum([len(loop) for loop in loops])])
    vertices = listing.vertex[np.concatenate(loops)]
    return Pieces(vertices.astype(np.int32), first.astype(np.int32), np.array(faces, np.int32))


def _is_convex(loop: Sequence[int], xy: list[list[int]]) -> bool:
    return _convex_at(loop, range(len(loop)), xy)


def _triangles(
    points: np.ndarray, face: Face, normal: np.ndarray, fallback: np.ndarray
) -> list[list[int]]:
    """Triangles of a face as it lies on the grid, or the known ones where a corner snapped straight leaves too few."""
    try:
        return triangulate_face(points.astype(float), face, normal).tolist()
    except SolidError:
        return fallback.tolist()


def _project(points: np.ndarray, axis: int, from_below: bool) -> list[list[int]]:
    """Drop an axis, seen from above or from below it."""
    keep = [(axis + 1) % 3, (axis + 2) % 3]
    if from_below:
        keep.reverse()
    return points[:, keep].tolist()


def _join(triangles: list[list[int]], xy: list[list[int]]) -> list[list[int]]:
    """Join triangles to convex polygons, longest common sides first."""
    loops: dict[int, list[int]] = dict(enumerate(triangles))
    owner = {(loop[k - 1], loop[k]): n for n, loop in loops.items() for k in range(len(loop))}
    sides = [side for side in owner if side[0] < side[1] and side[::-1] in owner]
    sides.sort(
        key=lambda side: (
            -((xy[side[0]][0] - xy[side[1]][0]) ** 2 + (xy[side[0]][1] - xy[side[1]][1]) ** 2)
        )
    )
    for i, j in sides:
        n = owner[i, j]
        m = owner[j, i]
        if n == m:
            continue
        merged = _merge(loops[n], loops[m], i, j)
        if merged is None or not _convex_at(merged, (merged.index(i), merged.index(j)), xy):
            continue
        for k in range(len(loops[m])):
            owner[loops[m][k - 1], loops[m][k]] = n
        loops[n] = merged
        del loops[m]
    return list(loops.values())


def _merge(loop: list[int], other: list[int], i: int, j: int) -> list[int] | None:
    """Splice `other`, which runs j to i, into `loop`, which runs i to j; None if they meet elsewhere too."""
    if len(set(loop) & set(other)) != 2:
        return None
    at = loop.index(j)
    back = other.index(i)
    return loop[at:] + loop[:at] + (other[back:] + other[:back])[1:-1]


def _convex_at(loop: Sequence[int], places: Iterable[int], xy: list[list[int]]) -> bool:
    for k in places:
        (ax, ay) = xy[loop[k - 1]]
        (bx, by) = xy[loop[k]]
        (cx, cy) = xy[loop[(k + 1) % len(loop)]]
        if (bx - ax) * (cy - by) - (by - ay) * (cx - bx) < 0:
            return False
    return True


# Where entities end on the grid: at vertices, or at cuts inside an edge, where a stretch ends.
#
# A cut is the point of the grid on the edge's line nearest to its share of the edge, if that is
# within a step; then everything is exact as for edges. Otherwise it is the grid's nearest point,
# off the line by less than a step. Then the vertices of the solid count as lying on a plane
# within the resolution of a displaced part, as if snapping had displaced the end of an edge.


_Point = tuple[int, int, int]


class Cut(NamedTuple):
    """A point of the grid at which an edge is cut, and whether it is on the edge's line."""

    point: _Point
    on_line: bool


def cut_point(start: Iterable[int], end: Iterable[int], share: Fraction) -> Cut:
    """Return the grid's point for a share of an edge, the same for the edge the other way round.

    Parameters
    ----------
    start, end : iterable of 3 int
        Ends of the edge on the grid.
    share : Fraction
        From the start, between 0 and 1.
    """
    a = tuple(int(x) for x in start)
    b = tuple(int(x) for x in end)
    if b < a:
        a, b = b, a
        share = 1 - share
    way = [q - p for p, q in zip(a, b, strict=True)]
    parts = gcd(*way)
    whole = round(share * parts)
    miss = abs(share - Fraction(whole, parts))
    if miss * miss * sum(x * x for x in way) <= 1:
        x, y, z = (p + w // parts * whole for p, w in zip(a, way, strict=True))
        return Cut((x, y, z), on_line=True)
    x, y, z = (round(p + share * w) for p, w in zip(a, way, strict=True))
    return Cut((x, y, z), on_line=False)


def with_cuts(solid: Solid, points: np.ndarray, entities: Iterable[Entity]) -> np.ndarray:
    """Return the vertices on the grid, int64, (n, 3), and after them the cuts of all stretches, each once, in order.

    Raises
    ------
    EntityError
        If a stretch has no length on the grid.
    """
    cuts: set[_Point] = set()
    for entity in entities:
        if not isinstance(entity.part, Stretch):
            continue
        ends = _end_points(solid, points, entity.part)
        if ends[0] == ends[1]:
            raise EntityError(f"a stretch must be longer than a grid step. Got {entity.part}.")
        vertices = {tuple(points[v].tolist()) for v in solid.edges[entity.part.edge].vertices}
        cuts |= {end for end in ends if end not in vertices}
    if not cuts:
        return points
    return np.concatenate([points, np.array(sorted(cuts), np.int64)])


def _end_points(solid: Solid, points: np.ndarray, stretch: Stretch) -> tuple[_Point, _Point]:
    a, b = (points[v].tolist() for v in solid.edges[stretch.edge].vertices)
    return cut_point(a, b, stretch.start).point, cut_point(a, b, stretch.end).point


def cut_numbers(
    solid: Solid, points: np.ndarray, stretch: Stretch, line: tuple[int, int]
) -> tuple[int, int]:
    """Return the numbers of a stretch's ends among vertices and cuts, sorted by their places; `line` ends its edge."""
    first, last = sorted(_end_points(solid, points, stretch))
    return _number(solid, points, line, first), _number(solid, points, line, last)


def _number(solid: Solid, points: np.ndarray, line: tuple[int, int], point: _Point) -> int:
    for v in line:
        if tuple(points[v].tolist()) == point:
            return v
    first = len(solid.vertices)
    (rows,) = np.nonzero((points[first:] == point).all(axis=1))
    return first + int(rows[0])


def cuts_on_line(solid: Solid, points: np.ndarray, stretch: Stretch) -> bool:
    """Return whether both ends of a stretch are on its edge's line."""
    a, b = (points[v].tolist() for v in solid.edges[stretch.edge].vertices)
    return all(cut_point(a, b, share).on_line for share in (stretch.start, stretch.end))


def cut_displacement_mm(
    solid: Solid, points: np.ndarray, stretch: Stretch, steps_mm: np.ndarray
) -> float:
    """Return the larger distance of a stretch's ends from their shares of the edge on the grid, in mm."""
    largest = 0.0
    a, b = (points[v].tolist() for v in solid.edges[stretch.edge].vertices)
    for share in (stretch.start, stretch.end):
        cut = cut_point(a, b, share).point
        off = [float(p + share * (q - p) - x) for p, q, x in zip(a, b, cut, strict=True)]
        largest = max(largest, float(np.linalg.norm(off * steps_mm)))
    return largest


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


# Casting blocked sets: which pieces may hide something of a convex hull of vertices, and what
# bounds their sets.
#
# Notation
# --------
# O     a convex piece of a face, P its plane with the outward side positive
# hull  the ends of a straight entity, or the corners of a flat convex polygon, in order
# B     the blocked set of O for the hull (see `blocked_sets`)
#
# B is cut out by P and by every plane that has O and the hull on opposite sides, touches both,
# and passes through an edge of O and a corner in front of P, or through a vertex of O and a side
# of the hull.


# Blocked sets of several straight pieces as those of one entity.
#
# The planes stay as they were cast for each piece, so the region carved by all sets is exactly
# the intersection of the pieces' regions; only planes that are equal become one, and sets that
# several pieces have in common are kept once.


class Blockers(NamedTuple):
    """Convex sets {side · (plane) > 0 for all their planes}, largest first.

    Attributes
    ----------
    first : ndarray of int32, shape (n + 1,)
        Where each set's planes start.
    plane, side : ndarray, shape (m,)
        Plane number and the side (1 or -1) the set lies on.
    planes : ndarray of int64, shape (p, 4)
        The planes: those of the faces, then those cast for this entity.
    origin : ndarray of int32, shape (p, 4)
        How each plane came about: kind and three vertex or face numbers.
    """

    first: np.ndarray
    plane: np.ndarray
    side: np.ndarray
    planes: np.ndarray
    origin: np.ndarray


def united(parts: Sequence[Blockers]) -> Blockers:
    """Return the sets of all parts under one table of planes, the largest of every part first, and so on.

    Parameters
    ----------
    parts : sequence of Blockers
        Of one solid, so that their tables start with the same planes of faces.
    """
    planes = np.concatenate([part.planes for part in parts])
    origin = np.concatenate([part.origin for part in parts])
    leading = np.take_along_axis(planes, np.argmax(planes != 0, axis=1)[:, None], axis=1)
    canonical = planes * np.sign(leading)
    _, first, number = np.unique(canonical, axis=0, return_index=True, return_inverse=True)
    # in the order in which the planes come first, so that those of the faces keep their numbers
    order = np.argsort(first, kind="stable")
    rank = np.empty(len(order), np.int64)
    rank[order] = np.arange(len(order))
    number = rank[number.ravel()]
    rows = first[order]
    flip = np.where((planes == planes[rows][number]).all(axis=1), 1, -1)
    offsets = np.cumsum([0] + [len(part.planes) for part in parts])
    sets: dict[tuple[tuple[int, int], ...], int] = {}
    for part, offset in zip(parts, offsets, strict=False):
        plane = number[offset + part.plane].tolist()
        side = (flip[offset + part.plane] * part.side).tolist()
        bounds = part.first.tolist()
        for k, (i, j) in enumerate(pairwise(bounds)):
            key = tuple(zip(plane[i:j], side[i:j], strict=True))
            sets[key] = min(k, sets.get(key, k))
    largest_first = sorted(sets, key=sets.__getitem__)
    flat = np.array([half for key in largest_first for half in key]).reshape(-1, 2)
    return Blockers(
        np.cumsum([0] + [len(key) for key in largest_first]).astype(np.int32),
        flat[:, 0].astype(np.int32),
        flat[:, 1].astype(np.int8),
        planes[rows],
        origin[rows],
    )


# how a plane came about: FACE (face, -1, -1), EDGE_AND_END (edge's two vertices, end of the entity), or
# VERTEX_AND_ENTITY (vertex, both ends of the entity), or, of lamps, CONTRAST (both ends of the entity, brighter face)
FACE, EDGE_AND_END, VERTEX_AND_ENTITY, CONTRAST = range(4)


class Jobs(NamedTuple):
    """Pieces, each with a convex hull of vertices that it may hide, largest in appearance first.

    Attributes
    ----------
    piece : ndarray of int64, shape (n,)
    first : ndarray of int64, shape (n + 1,)
        Where each hull's corners start.
    corner : ndarray of int64
        Vertex numbers of all hulls: two ends, or a convex polygon in order.
    """

    piece: np.ndarray
    first: np.ndarray
    corner: np.ndarray


def in_the_way(scene: Scene, corners: np.ndarray, *wedge: np.ndarray) -> np.ndarray:
    """Pieces that may hide something of the hull of some vertices, the largest in appearance first."""
    chosen = _facing(scene, corners, *wedge)
    size = _apparent_size(scene.points, scene.pieces, chosen, corners)
    return np.asarray(chosen[np.argsort(-size, kind="stable")])


def cast_all(
    scene: Scene,
    wedge: tuple[np.ndarray, np.ndarray, np.ndarray],
    jobs: Jobs,
    settle_thin: bool,
    line: tuple[int, int] | None = None,
) -> Blockers:
    """The sets of a wedge, then those of all jobs. A plane through both ends of a stretch is that of its `line`."""
    wedge_first, wedge_plane, wedge_side = wedge
    n_face_planes = len(scene.planes)
    n_corners = np.diff(scene.pieces.first)[jobs.piece]
    room = n_face_planes + int((2 * n_corners * np.diff(jobs.first)).sum())
    planes = np.empty((room, 4), np.int64)
    planes[:n_face_planes] = scene.planes
    origin = np.empty((room, 4), np.int32)
    origin[:n_face_planes] = (FACE, -1, -1, -1)
    origin[scene.plane_of_face[::-1], 1] = np.arange(len(scene.plane_of_face))[::-1]
    piece_plane = scene.plane_of_face[scene.pieces.face]
    piece_side = scene.side_of_face[scene.pieces.face]
    first, plane, side, n_planes = _cast(
        scene.points,
        scene.pieces,
        tuple(jobs),
        (piece_plane, piece_side),
        planes,
        n_face_planes,
        origin,
        np.array([] if line is None else line, np.int64),
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


@entry_kernel
def _facing(scene, corners, wedge_first, wedge_plane, wedge_side):
    """Pieces with a corner of the entity in front of them that are not wholly inside one blocked set of the wedge."""
    points = scene.points
    pieces = scene.pieces
    result = np.empty(len(pieces.face), np.int64)
    n = 0
    for piece in range(len(pieces.face)):
        face = pieces.face[piece]
        plane = scene.planes[scene.plane_of_face[face]]
        side = scene.side_of_face[face]
        in_front = False
        for v in corners:
            in_front |= side * side_of(plane, points[v], scene.resolution) > 0
        if not in_front:
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
def _apparent_size(points, pieces, chosen, corners):
    """Rough solid angle of pieces seen from the middle of the entity; only orders the work."""
    size = np.zeros(len(chosen))
    middle = np.zeros(3)
    for v in corners:
        for axis in range(3):
            middle[axis] += points[v, axis]
    for axis in range(3):
        middle[axis] *= 1.0 / len(corners)
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
                p[axis] = points[loop[i], axis] - middle[axis]
                q[axis] = points[loop[(i + 1) % len(loop)], axis] - middle[axis]
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
def _splits(points, trio, loop, hull, resolution):
    """Whether the plane of three points has O or the hull on both sides, or both on one, beyond doubt.

    In doubles, whose rounding is far below the step that is left for it: most candidates end here.
    """
    normal_x = normal_y = normal_z = 0.0
    px = np.float64(points[trio[0], 0])
    py = np.float64(points[trio[0], 1])
    pz = np.float64(points[trio[0], 2])
    qx = points[trio[1], 0] - px
    qy = points[trio[1], 1] - py
    qz = points[trio[1], 2] - pz
    rx = points[trio[2], 0] - px
    ry = points[trio[2], 1] - py
    rz = points[trio[2], 2] - pz
    normal_x = qy * rz - qz * ry
    normal_y = qz * rx - qx * rz
    normal_z = qx * ry - qy * rx
    length = np.sqrt(normal_x * normal_x + normal_y * normal_y + normal_z * normal_z)
    # a step more than counts as on the plane
    band = (resolution + 1.0) * length
    ahead = behind = False
    for v in loop:
        h = (
            normal_x * (points[v, 0] - px)
            + normal_y * (points[v, 1] - py)
            + normal_z * (points[v, 2] - pz)
        )
        ahead |= h > band
        behind |= h < -band
    if ahead and behind:
        return True
    hull_ahead = hull_behind = False
    for v in hull:
        h = (
            normal_x * (points[v, 0] - px)
            + normal_y * (points[v, 1] - py)
            + normal_z * (points[v, 2] - pz)
        )
        hull_ahead |= h > band
        hull_behind |= h < -band
    return (hull_ahead and (hull_behind or ahead)) or (hull_behind and behind)


@kernel_without_refcounts
def _separates(plane, points, loop, hull, settle_thin, resolution):
    """Side of the plane on which the loop lies with the hull on the opposite side or on the plane; 0 if none."""
    positive = negative = thin = False
    for tolerance in (resolution, 0.0):
        for v in loop:
            s = side_of(plane, points[v], tolerance)
            positive |= s > 0
            negative |= s < 0
        if positive or negative or not settle_thin:
            break
        # an end just in front of P and far from O: without this plane the set would be open to that side
        thin = True
        resolution = 0.0
    hull_positive = hull_negative = False
    for v in hull:
        s = side_of(plane, points[v], resolution)
        hull_positive |= s > 0
        hull_negative |= s < 0
    if positive and negative and thin and hull_positive != hull_negative:
        # vertices of a snapped face lie on either side, but all within the resolution
        return -1 if hull_positive else 1
    if positive == negative or (hull_positive if positive else hull_negative):
        return 0
    return 1 if positive else -1


@kernel_without_refcounts
def _farthest_side(plane, points, vertices, left_out):
    """Side of the plane on which the farthest of some vertices lies, but for some; 0 if there are none."""
    farthest = np.int64(0)
    for v in vertices:
        if v != left_out[0] and v != left_out[1]:
            h = height(plane, points[v])
            if abs(h) > abs(farthest):
                farthest = h
    return np.sign(farthest)


@kernel_without_refcounts
def _side_of_set(plane, points, loop, hull, trio, kind, settle_thin, resolution):
    """Side of the plane on which the set lies: that of O, or where O lies in the plane, away from the hull's rest."""
    if settle_thin and resolution > 0.0:
        flat = True
        for v in loop:
            flat &= side_of(plane, points[v], resolution) == 0
        if flat:
            left_out = (trio[2], trio[2] if kind == EDGE_AND_END else trio[1])
            side = _farthest_side(plane, points, hull, left_out)
            if side != 0:
                return -side
    return 1 if _farthest_side(plane, points, loop, (-1, -1)) > 0 else -1


@kernel_without_refcounts
def _opposite(plane, side, other, other_side):
    """Whether half-spaces of two nearly equal planes look in opposite directions."""
    along = 0.0
    for axis in range(3):
        along += np.float64(plane[axis]) * np.float64(other[axis])
    return along * side * other_side < 0


@kernel
def _watch(chains, planes, k, points, corners, resolution):
    """Append plane k to the chain of every corner that it passes; return the chains, with more room if need be."""
    ends, plane_of, following = chains
    for slot in range(len(corners)):
        if side_of(planes[k], points[corners[slot]], resolution) != 0:
            continue
        n = ends[-1, 0]
        if n == len(plane_of):
            plane_of = np.concatenate((plane_of, np.empty_like(plane_of)))
            following = np.concatenate((following, np.empty_like(following)))
        plane_of[n] = k
        following[n] = -1
        if ends[slot, 0] < 0:
            ends[slot, 0] = n
        else:
            following[ends[slot, 1]] = n
        ends[slot, 1] = n
        ends[-1, 0] = n + 1
    return ends, plane_of, following


@kernel
def _find_watched(chains, slot, planes, points, trio, resolution):
    """`find_plane`, of planes that pass a corner of the trio: most do not, and are not looked at."""
    ends, plane_of, following = chains
    n = ends[slot, 0]
    while n >= 0:
        k = plane_of[n]
        if (
            side_of(planes[k], points[trio[0]], resolution) == 0
            and side_of(planes[k], points[trio[1]], resolution) == 0
            and side_of(planes[k], points[trio[2]], resolution) == 0
        ):
            return k
        n = following[n]
    return np.int64(-1)


@kernel
def _chains(planes, n, points, corners, resolution):
    """Chains of the first n planes by the corners that they pass; see `_watch`."""
    # first and last link of each corner's chain; the last row holds the number of links
    ends = np.full((len(corners) + 1, 2), -1)
    ends[-1, 0] = 0
    chains = (ends, np.empty(1024, np.int64), np.empty(1024, np.int64))
    for k in range(n):
        chains = _watch(chains, planes, k, points, corners, resolution)
    return chains


@kernel_without_refcounts
def _choose_trio(trio, loop, i, hull, k, line):
    """Write the three vertices of candidate k at vertex i of O and return its kind, corners of the hull first."""
    trio[0] = loop[i]
    if k < len(hull):
        trio[1] = loop[(i + 1) % len(loop)]
        trio[2] = hull[k]
        return EDGE_AND_END
    if len(line) > 0:
        trio[1] = line[0]
        trio[2] = line[1]
        return VERTEX_AND_ENTITY
    trio[1] = hull[k - len(hull)]
    trio[2] = hull[(k - len(hull) + 1) % len(hull)]
    return VERTEX_AND_ENTITY


@kernel_without_refcounts
def _index(values, start, end, value):
    """Where a value stands between two places, or `end`."""
    while start < end and values[start] != value:
        start += 1
    return start


@entry_kernel
def _cast(points, pieces, jobs, placed, planes, n_planes, origin, line, settle_thin, resolution):
    """Blocked sets of pieces for hulls of some vertices; appends their planes to `planes` and `origin`.

    A job is a piece and a hull: a convex polygon of vertices in order, or two of them. The plane through both is that
    of `line`, if it is given.
    """
    order, hull_first, hull_corners = jobs
    n_face_planes = n_planes
    watched = np.unique(np.concatenate((hull_corners, line)))
    chains = _chains(planes, n_planes, points, watched, resolution)
    # room for the planes is room for all candidates
    plane_list = np.empty(len(order) + len(planes) - n_planes, np.int32)
    side_list = np.empty(len(plane_list), np.int8)
    first = np.zeros(len(order) + 1, np.int32)
    piece_plane, piece_side = placed
    trio = np.empty(3, np.int64)
    n = 0
    for row in range(len(order)):
        piece = order[row]
        loop = pieces.vertices[pieces.first[piece] : pieces.first[piece + 1]]
        hull = hull_corners[hull_first[row] : hull_first[row + 1]]
        face_plane = piece_plane[piece]
        outward = piece_side[piece]
        plane_list[n] = face_plane
        side_list[n] = -outward
        start = n
        n = n + 1
        # edge of O with a corner in front of P, or vertex of O with a side of the hull; a segment has one side
        n_candidates = len(hull) + (len(hull) if len(hull) > 2 else 1)
        for candidate in range(len(loop) * n_candidates):
            k = candidate % n_candidates
            kind = _choose_trio(trio, loop, candidate // n_candidates, hull, k, line)
            place = outward * side_of(planes[face_plane], points[trio[2]], resolution)
            if kind == EDGE_AND_END and place <= 0:
                continue
            if _splits(points, trio, loop, hull, resolution):
                continue
            plane = plane_through(points[trio[0]], points[trio[1]], points[trio[2]])
            if not plane.any() or not _separates(
                plane, points, loop, hull, settle_thin, resolution
            ):
                continue
            slot = np.searchsorted(watched, trio[2])
            number = _find_watched(chains, slot, planes, points, trio, resolution)
            place = _index(plane_list, start, n, number)
            if place < n:
                side = _side_of_set(plane, points, loop, hull, trio, kind, settle_thin, resolution)
                if not settle_thin or not _opposite(planes[number], side_list[place], plane, side):
                    continue
                # as O looks thinner than the resolution: one plane would leave the set half open
                number = np.int64(-1)
            if number < 0:
                number = n_planes
                put(planes[number], plane)
                origin[number, 0] = kind
                put(origin[number, 1:], trio)
                n_planes += 1
                chains = _watch(chains, planes, number, points, watched, resolution)
            plane_list[n] = number
            side_list[n] = _side_of_set(
                planes[number], points, loop, hull, trio, kind, settle_thin, resolution
            )
            n += 1
        first[row + 1] = n
    return first, plane_list[:n].copy(), side_list[:n].copy(), max(n_planes, n_face_planes)
