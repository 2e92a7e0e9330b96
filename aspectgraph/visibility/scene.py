"""A solid on its grid, as everything that asks for visibility needs it, and the entities' places there."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping, Sequence
from fractions import Fraction
from itertools import pairwise
from math import gcd
from typing import NamedTuple

import numpy as np

from aspectgraph.entities.entity import Entity, Stretch
from aspectgraph.exact.canonical import Listing, list_solid, own_frame, resolving_grid
from aspectgraph.exact.grid import DISPLACED_RESOLUTION, Grid, turned
from aspectgraph.exact.planes import face_planes
from aspectgraph.exceptions import EntityError, SolidError
from aspectgraph.solid.solid import Solid
from aspectgraph.solid.topology import Face, triangulate_face

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
