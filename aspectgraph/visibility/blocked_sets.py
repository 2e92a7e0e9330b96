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
from collections.abc import Callable, Sequence
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np

from aspectgraph.exact.grid import plane_through, side_of
from aspectgraph.solid.solid import Solid
from aspectgraph.visibility.scene import (
    Blockers,
    Jobs,
    Scene,
    cast_all,
    check_deadline,
    chords,
    end_resolution,
    entity_ends,
    in_the_way,
    line_ends,
    united,
)
from ground.decorators import entry_kernel

if TYPE_CHECKING:
    from aspectgraph.entities.entity import Entity

Sides: TypeAlias = Callable[[np.ndarray], np.ndarray]


# Free discs: rims that can be seen as one flat polygon instead of chord by chord.
#
# Notation
# --------
# D    the convex polygon of a rim's chords, Pi its plane
# Q    the pyramid from a viewpoint v to D; its sides are the triangles of v and the chords
# O    a piece of surface, B(O, D) its blocked set {q + t (q - p) : q in O, p in D, t >= 0}
#
# D is *free* if its relative interior meets no interior of the solid: the opening of a hole, the
# floor of a blind one. A shell of the surface is *certified* for viewpoints on one side of Pi if
# it has a vertex on the other side, or one on Pi outside D.
#
# Guarantee (docs/mathematics/visibility.md, section 5): for a free disc and a piece O of a shell
# that is certified for a generic viewpoint in B(O, D), some chord is not observable from it. For
# the material behind O has a vertex that Q does not hold, and cannot leave Q through D, so it
# crosses the triangle of a chord. One convex set thus does the work of one for every chord.
#
# Where snapping displaced vertices, a vertex within the resolution of Pi counts as on it, as
# everywhere. From a viewpoint so near Pi that the corners do not look convex, B(O, D) may then
# hide more than the chords' sets, never less.


_Point = tuple[int, int]
# vertices that are looked at before the next ones are converted
_AT_ONCE = 64
# planes whose surroundings are kept: the two sides of a plate, and the floors of its pockets
_LEVELS = 16


class Disc(NamedTuple):
    """A free disc.

    Attributes
    ----------
    corners : ndarray of int64, shape (m,)
        Vertex numbers of D, in order around it.
    plane : ndarray of int64, shape (4,)
        Its plane.
    certified : ndarray of bool, shape (shells, 2)
        Which shells of the surface are, for viewpoints on its positive and on its negative side.
    """

    corners: np.ndarray
    plane: np.ndarray
    certified: np.ndarray


def free_disc(scene: Scene, solid: Solid, entity: Entity) -> Disc | None:
    """Return the disc of a rim, or None if it is not flat, not convex, or not known to be free."""
    corners = _corners(solid, entity)
    if corners is None:
        return None
    plane = _common_plane(scene, solid, entity, corners)
    if plane is None:
        return None
    level = _level(_made_once(_Surface(scene, solid)), *plane.tolist())
    outline = _counter_clockwise([(x, y) for x, y in level.flat[corners].tolist()])
    if outline is None:
        return None
    shape = _Shape(scene, solid, level, outline)
    if not shape.is_free(entity.edge_ids, corners):
        return None
    return Disc(corners, plane, shape.certified())


def _corners(solid: Solid, entity: Entity) -> np.ndarray | None:
    """Vertex numbers of a rim's chords in order; None where they do not close."""
    edges = [solid.edges[edge_id].vertices for edge_id in entity.edge_ids]
    if entity.kind != "rim" or len(edges) < 3:
        return None
    corners: list[int] = []
    for chord, other in zip(edges, [*edges[1:], edges[0]], strict=True):
        common = set(chord) & set(other)
        if len(common) != 1:
            return None
        corners += common
    return np.array(corners) if len(set(corners)) == len(corners) else None


def _common_plane(
    scene: Scene, solid: Solid, entity: Entity, corners: np.ndarray
) -> np.ndarray | None:
    """A plane that all corners are on: exactly, or else to within the resolution, if possible that of a face."""
    points = scene.points[corners]
    third = len(points) // 3
    plane = plane_through(points[0], points[third], points[2 * third])
    if not plane.any():
        return None
    if (points @ plane[:3] == plane[3]).all():
        return np.asarray(plane)
    next_to = solid.edges[entity.edge_ids[0]].faces
    candidates = [scene.planes[scene.plane_of_face[face]] for face in next_to]
    for candidate in [*candidates, plane]:
        if not _heights(points, candidate, scene.resolution).any():
            return np.asarray(candidate)
    return None


def _heights(points: np.ndarray, plane: np.ndarray, resolution: float) -> np.ndarray:
    """Heights of points over a plane, in multiples of a step: 0 within the resolution."""
    heights = points @ plane[:3] - plane[3]
    if resolution > 0.0:
        length = np.sqrt((plane[:3].astype(float) ** 2).sum())
        heights[np.abs(heights) <= resolution * length] = 0
    return np.asarray(heights)


def _counter_clockwise(outline: list[_Point]) -> list[_Point] | None:
    """A polygon in counter-clockwise order; None if it is not convex."""
    for polygon in (outline, outline[::-1]):
        sides = list(pairwise([*polygon, polygon[0]]))
        if all(_turn(*side, p) >= 0 for side in sides for p in polygon):
            return polygon
    return None


def _turn(a: _Point, b: _Point, p: _Point) -> int:
    """Twice the area of the triangle a, b, p: positive where p is to the left of a to b."""
    return (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])


def _length(vector: Sequence[int]) -> float:
    return math.sqrt(sum(x * x for x in vector))


class _Surface:
    """A solid on its grid; equal to another one that has the same arrays.

    Parameters
    ----------
    scene, solid
        The solid on its grid, and itself.
    """

    def __init__(self, scene: Scene, solid: Solid) -> None:
        self.scene = scene
        self.solid = solid

    def __eq__(self, other: object) -> bool:
        return (
            isinstance(other, _Surface)
            and self.scene.points is other.scene.points
            and self.scene.resolution == other.scene.resolution
            and self.solid is other.solid
        )

    def __hash__(self) -> int:
        return hash((id(self.scene.points), id(self.solid)))

    @cached_property
    def edge_ends(self) -> np.ndarray:
        """Vertices of all edges, int64, (n, 2)."""
        return np.array([edge.vertices for edge in self.solid.edges])

    @cached_property
    def flat(self) -> list[np.ndarray]:
        """All vertices without one coordinate, int64, (n, 2): the first, the second, the third."""
        return [np.delete(self.scene.points, axis, axis=1) for axis in range(3)]

    @cached_property
    def shell_vertices(self) -> list[np.ndarray]:
        """For each shell, the numbers of its vertices, in order."""
        pieces = self.scene.pieces
        shell_of = np.repeat(self.solid.face_shell[pieces.face], np.diff(pieces.first))
        return [
            np.unique(pieces.vertices[shell_of == shell]) for shell in range(self.solid.n_shells)
        ]


class _Level:
    """A plane, and how the surface lies about it: what all discs in one plane have in common.

    Parameters
    ----------
    surface : _Surface
    plane : ndarray of int64, shape (4,)

    Attributes
    ----------
    plane
    flat : ndarray of int64, shape (n, 2)
        All vertices without the coordinate that the plane is farthest across.
    heights : ndarray of int64, shape (n,)
        Of all vertices over the plane, in multiples of a step.
    crossing : ndarray of int64, shape (k,)
        Pieces that reach it, of faces that have vertices on both of its sides.
    crossing_box : ndarray of int64, shape (k, 2, 2)
        Least and largest coordinates of these, without the same one.
    edges : ndarray of int64, shape (m,)
        Edges in it.
    edge_box : ndarray of int64, shape (m, 2, 2)
        Their least and largest coordinates.
    reached : ndarray of bool, shape (shells, 2)
        Whether each shell has vertices below and above it.
    beside : list of ndarray of int64
        Of each shell, the vertices in it.
    """

    def __init__(self, surface: _Surface, plane: np.ndarray) -> None:
        scene = surface.scene
        self.plane = plane
        self.flat = surface.flat[int(np.abs(plane[:3]).argmax())]
        self.heights = _heights(scene.points, plane, scene.resolution)
        self.crossing, self.crossing_box = self._pieces_across(scene, len(surface.solid.faces))
        ends = surface.edge_ends
        self.edges = np.flatnonzero((self.heights == 0)[ends].all(axis=1))
        places = self.flat[ends[self.edges]]
        self.edge_box = np.stack([places.min(axis=1), places.max(axis=1)], axis=1)
        heights = [self.heights[vertices] for vertices in surface.shell_vertices]
        self.reached = np.array([((h < 0).any(), (h > 0).any()) for h in heights])
        self.beside = [
            vertices[h == 0] for vertices, h in zip(surface.shell_vertices, heights, strict=True)
        ]

    def _pieces_across(self, scene: Scene, n_faces: int) -> tuple[np.ndarray, np.ndarray]:
        pieces = scene.pieces
        height = self.heights[pieces.vertices]
        starts = pieces.first[:-1]
        low = np.minimum.reduceat(height, starts)
        high = np.maximum.reduceat(height, starts)
        face_low = np.zeros(n_faces, np.int64)
        face_high = np.zeros(n_faces, np.int64)
        np.minimum.at(face_low, pieces.face, low)
        np.maximum.at(face_high, pieces.face, high)
        both = (face_low[pieces.face] < 0) & (face_high[pieces.face] > 0)
        flat = self.flat[pieces.vertices]
        box = np.stack(
            [np.minimum.reduceat(flat, starts), np.maximum.reduceat(flat, starts)], axis=1
        )
        across = np.flatnonzero(both & (low <= 0) & (high >= 0))
        return across, box[across]


@lru_cache(maxsize=1)
def _made_once(surface: _Surface) -> _Surface:
    """Return the first of equal surfaces, so that all rims of a part share its arrays."""
    return surface


@lru_cache(maxsize=_LEVELS)
def _level(surface: _Surface, a: int, b: int, c: int, d: int) -> _Level:
    """Return a plane of a solid: holes that end on one face share it."""
    return _Level(surface, np.array([a, b, c, d]))


class _Shape:
    """The surface around a disc, with exact integers throughout.

    Parameters
    ----------
    scene, solid
        The solid on its grid, and itself.
    level : _Level
        The disc's plane.
    outline : list of (int, int)
        Corners of the disc in the level's view, counter-clockwise.
    """

    def __init__(self, scene: Scene, solid: Solid, level: _Level, outline: list[_Point]) -> None:
        self._scene = scene
        self._solid = solid
        self._level = level
        self._plane = level.plane
        self._heights = level.heights
        self._flat = level.flat
        self._outline = outline
        self._sides = list(pairwise([*outline, outline[0]]))
        box = np.array(outline)
        self._size = _length(np.ptp(box, axis=0).tolist())
        self._low = box.min(axis=0)
        self._high = box.max(axis=0)

    def is_free(self, chords: Sequence[int], corners: np.ndarray) -> bool:
        """Whether no interior of the solid meets the disc's relative interior.

        The part of D inside the solid is open in D. If it is neither empty nor all of D, its boundary runs along a face
        that crosses the plane, or along an edge in it that has the solid on one side. At a chord, it does not begin.
        """
        return (
            not any(self._begins_inside(edge_id, corners) for edge_id in chords)
            and not self._is_crossed()
            and not any(self._parts(edge_id) for edge_id in self._edges_within(set(chords)))
        )

    def certified(self) -> np.ndarray:
        """Which shells are certified for which side; see `Disc`."""
        reached = self._level.reached
        beside = [
            not below_and_above.all() and self._is_any_outside(vertices)
            for below_and_above, vertices in zip(reached, self._level.beside, strict=True)
        ]
        return np.asarray(reached | np.array(beside)[:, None])

    def _is_any_outside(self, vertices: np.ndarray) -> bool:
        """Whether one of these vertices in the plane is outside the disc; nearly always, one of the first is."""
        return any(
            self._is_outside((x, y))
            for begin in range(0, len(vertices), _AT_ONCE)
            for x, y in self._flat[vertices[begin : begin + _AT_ONCE]].tolist()
        )

    def _is_outside(self, p: _Point) -> bool:
        return any(_turn(a, b, p) < 0 for a, b in self._sides)

    def _begins_inside(self, edge_id: int, corners: np.ndarray) -> bool:
        """Whether the disc runs into the solid from a chord."""
        a, b = self._solid.edges[edge_id].vertices
        start, end = (tuple(p) for p in self._flat[[a, b]].tolist())
        inner = max(corners.tolist(), key=lambda v: abs(_turn(start, end, tuple(self._flat[v]))))
        towards = [int(x) for x in self._scene.points[inner] - self._scene.points[a]]
        return self._is_inward(edge_id, towards)

    def _is_inward(self, edge_id: int, direction: Sequence[int]) -> bool:
        """Whether a direction from an edge leads into the solid, strictly."""
        edge = self._solid.edges[edge_id]
        behind = []
        for face in edge.faces:
            normal = self._scene.planes[self._scene.plane_of_face[face], :3].tolist()
            along = sum(n * d for n, d in zip(normal, direction, strict=True))
            if abs(along) * self._size <= self._scene.resolution * _length(normal) * _length(
                direction
            ):
                along = 0
            behind.append(along * int(self._scene.side_of_face[face]) < 0)
        return all(behind) if edge.dihedral_deg > 0 else any(behind)

    def _is_crossed(self) -> bool:
        """Whether a face that has vertices on both sides of the plane meets the disc's relative interior."""
        near = self._near(self._level.crossing_box)
        return any(self._meets(piece) for piece in self._level.crossing[near].tolist())

    def _near(self, box: np.ndarray) -> np.ndarray:
        """Whether boxes (n, 2, 2) overlap that of the disc, (n,)."""
        return np.asarray(
            (box[:, 0] < self._high).all(axis=1) & (box[:, 1] > self._low).all(axis=1)
        )

    def _meets(self, piece: int) -> bool:
        """Whether the part of a piece in the plane, a segment, meets the disc's relative interior."""
        pieces = self._scene.pieces
        loop = pieces.vertices[pieces.first[piece] : pieces.first[piece + 1]]
        places = [tuple(p) for p in self._flat[loop].tolist()]
        heights = self._heights[loop].tolist()
        ends = [(x, y, 1) for (x, y), height in zip(places, heights, strict=True) if height == 0]
        for k, height in enumerate(heights):
            if height * heights[k - 1] < 0:
                weights = abs(heights[k - 1]), abs(height)
                x, y = places[k]
                u, v = places[k - 1]
                ends.append(
                    (
                        x * weights[0] + u * weights[1],
                        y * weights[0] + v * weights[1],
                        sum(weights),
                    )
                )
        return self._crosses(ends)

    def _crosses(self, ends: Sequence[tuple[int, int, int]]) -> bool:
        """Whether the hull of points (x, y, w), x/w and y/w in the view and all on a line, meets the open outline.

        Two convex sets in a plane are apart if a line along a side of one of them parts them.
        """
        for a, b in self._sides:
            if all(
                (b[0] - a[0]) * (y - a[1] * w) - (b[1] - a[1]) * (x - a[0] * w) <= 0
                for x, y, w in ends
            ):
                return False
        (x, y, w) = ends[0]
        for u, v, s in ends[1:]:
            run = u * w - x * s, v * w - y * s
            if run != (0, 0):
                turns = [run[0] * (q * w - y) - run[1] * (p * w - x) for p, q in self._outline]
                return min(turns) < 0 < max(turns)
        return True

    def _edges_within(self, chords: set[int]) -> list[int]:
        """Edges in the plane, other than the chords, that meet the disc's relative interior."""
        return [
            edge_id
            for edge_id in self._level.edges[self._near(self._level.edge_box)].tolist()
            if edge_id not in chords and self._crosses(self._ends(edge_id))
        ]

    def _ends(self, edge_id: int) -> list[tuple[int, int, int]]:
        """Ends of an edge, as `_crosses` has them."""
        ends = self._flat[list(self._solid.edges[edge_id].vertices)].tolist()
        return [(x, y, 1) for x, y in ends]

    def _parts(self, edge_id: int) -> bool:
        """Whether the solid is in the plane next to an edge there, on either side of the edge."""
        a, b = self._solid.edges[edge_id].vertices
        run = [int(x) for x in self._scene.points[b] - self._scene.points[a]]
        up = self._plane[:3].tolist()
        across = [
            up[(k + 1) % 3] * run[(k + 2) % 3] - up[(k + 2) % 3] * run[(k + 1) % 3]
            for k in range(3)
        ]
        return self._is_inward(edge_id, across) or self._is_inward(edge_id, [-x for x in across])


def blockers(
    scene: Scene,
    solid: Solid,
    entity: Entity,
    deadline: float = math.inf,
    sides_of: Sides | None = None,
) -> Blockers:
    """Blocked sets of one entity whose union are all: first the faces next to it, then other pieces in its way.

    Those of a rim or arc are the blocked sets of all its chords, for a viewpoint that misses a part of one misses a
    part of the whole. Of a rim with a free disc they are the blocked sets of the disc (see `free_discs`).

    Parameters
    ----------
    scene, solid
        The solid on its grid, and itself.
    entity : Entity
    deadline : float
        Time (`time.time`) by which to end.
    sides_of : callable, optional
        Takes planes (n, 4); returns on which of their sides, positive and negative, the faces next to the entity leave
        viewpoints, (n, 2) bool. Sets that miss these viewpoints may be missing.

    Raises
    ------
    DeadlineError
        If they are not complete by then.
    """
    disc = free_disc(scene, solid, entity)
    matters = _behind_which_some_are_left(scene, sides_of)
    if disc is not None:
        on_side = np.ones(2, bool) if sides_of is None else sides_of(disc.plane[None])[0]
        by_disc = (disc.certified | ~on_side).all(axis=1)
        if by_disc.any():
            check_deadline(deadline)
            return _disc_blockers(scene, solid, entity, disc.corners, by_disc, matters)
    parts = []
    for chord in chords(entity):
        check_deadline(deadline)
        settle_thin = entity.kind != "edge" or entity.part is not None
        parts.append(_chord_blockers(scene, solid, chord, matters, settle_thin))
    return parts[0] if len(parts) == 1 else united(parts)


def wedge_blockers(scene: Scene, solid: Solid, entity: Entity) -> Blockers:
    """Blocked sets of the faces next to an entity alone."""
    none = np.empty(0, np.int64)
    return cast_all(scene, _wedge(scene, solid, entity), Jobs(none, np.zeros(1, int), none), True)


def _behind_which_some_are_left(scene: Scene, sides_of: Sides | None) -> np.ndarray:
    """Whether viewpoints are left behind each piece, (n,) bool; it blocks no others."""
    if sides_of is None:
        return np.ones(len(scene.pieces.face), bool)
    sides = sides_of(scene.planes)
    behind = (scene.side_of_face[scene.pieces.face] > 0).astype(int)
    return np.asarray(sides[scene.plane_of_face[scene.pieces.face], behind])


def _disc_blockers(
    scene: Scene,
    solid: Solid,
    entity: Entity,
    corners: np.ndarray,
    by_disc: np.ndarray,
    matters: np.ndarray,
) -> Blockers:
    """Blocked sets of a rim with a free disc: those of its faces, then one per piece and, where need be, chord.

    `by_disc`: for which shells the disc does.
    """
    wedge = _wedge(scene, solid, entity)
    order = in_the_way(scene, corners, *_behind_disc(scene, corners, *wedge))
    by_piece = by_disc[solid.face_shell[scene.pieces.face]]
    jobs = Jobs(*_disc_jobs(scene, order[matters[order]], corners, by_piece))
    return cast_all(scene, wedge, jobs, True)


def _behind_disc(
    scene: Scene, corners: np.ndarray, first: np.ndarray, plane: np.ndarray, side: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Those sets of a wedge of which every plane has the whole disc on its other side, or on it."""
    beyond = _beyond(scene, corners, plane, side)
    sets = [k for k in range(len(first) - 1) if beyond[first[k] : first[k + 1]].all()]
    rows = [np.arange(first[k], first[k + 1]) for k in sets]
    flat = np.concatenate(rows) if rows else np.empty(0, int)
    return np.cumsum([0] + [len(row) for row in rows]), plane[flat], side[flat]


@entry_kernel
def _beyond(scene, corners, plane, side):
    """Whether no corner is on the given side of each plane."""
    result = np.ones(len(plane), np.bool_)
    for j in range(len(plane)):
        for v in corners:
            if side[j] * side_of(scene.planes[plane[j]], scene.points[v], scene.resolution) > 0:
                result[j] = False
    return result


@entry_kernel
def _disc_jobs(scene, order, corners, by_disc):
    """Hulls to cast sets for: of each piece the part of the disc in front of it, and chords that cross its plane.

    A hull ends at corners, so what is in front of the piece between the last one and its plane is left to the chord.
    """
    m = len(corners)
    piece = [np.int64(0) for _ in range(0)]
    first = [np.int64(0)]
    hulls = [np.int64(0) for _ in range(0)]
    place = np.empty(m, np.int64)
    for k in order:
        face = scene.pieces.face[k]
        plane = scene.planes[scene.plane_of_face[face]]
        behind = -1
        for j in range(m):
            place[j] = scene.side_of_face[face] * side_of(
                plane, scene.points[corners[j]], scene.resolution
            )
            if place[j] < 0:
                behind = j
        as_polygon = by_disc[k] and (place >= 0).sum() > 2
        if as_polygon:
            # in order around the disc, from behind the plane if it crosses
            for i in range(m):
                j = (behind + 1 + i) % m
                if place[j] >= 0:
                    hulls.append(np.int64(corners[j]))
            piece.append(k)
            first.append(len(hulls))
        for j in range(m):
            i = (j + 1) % m
            if (place[i] > 0 or place[j] > 0) and (not as_polygon or place[i] < 0 or place[j] < 0):
                hulls.append(np.int64(corners[j]))
                hulls.append(np.int64(corners[i]))
                piece.append(k)
                first.append(len(hulls))
    return np.array(piece), np.array(first), np.array(hulls)


def _chord_blockers(
    scene: Scene, solid: Solid, entity: Entity, matters: np.ndarray, settle_thin: bool
) -> Blockers:
    """All blocked sets of one straight entity.

    `settle_thin`: where an end is so little in front of a far piece that the plane through it and an edge of the piece
    is the piece's own to within the resolution, take the exact sides. Chords, of which there are many at all angles,
    meet this; an edge's sets stay as they always were, open to that side.
    """
    scene = scene._replace(resolution=end_resolution(scene, solid, entity))
    ends = np.array(entity_ends(scene, solid, entity))
    wedge = _wedge(scene, solid, entity)
    order = in_the_way(scene, ends, *wedge)
    order = order[matters[order]]
    hulls = np.tile(ends, len(order))
    jobs = Jobs(order, np.arange(0, len(hulls) + 1, len(ends)), hulls)
    return cast_all(scene, wedge, jobs, settle_thin, line_ends(scene, solid, entity))


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
    return first, flat[:, 0].copy(), flat[:, 1].copy()
