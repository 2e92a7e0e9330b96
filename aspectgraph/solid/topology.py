"""Faces, edges, vertex fans and shells: what follows from the vertex indices of the loops alone.

Notation
--------
A *loop* is a cycle of vertex indices. It *traverses* the directed edge (i, j) when j follows i. In a closed oriented
surface every directed edge is traversed exactly once, and so is its reverse, by the face on the other side.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from typing import Any, Protocol

import numpy as np
import shapely
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from aspectgraph.exceptions import NonManifoldError, OpenSolidError, OrientationError, SolidError
from ground.short_repr import short_repr

# The loops of all faces as arrays: what holds for every face is computed for all of them at once.
#
# Notation
# --------
# Half-edge h is a directed edge of a loop. Half-edges are numbered face by face, loop by loop, and
# along each loop, outer loops first.


class FaceLoops:
    """Loops of faces.

    Parameters
    ----------
    start : ndarray of int, shape (h,)
        The vertex where each half-edge starts.
    size : ndarray of int, shape (l,)
        The number of half-edges of each loop.
    loop_face : ndarray of int, shape (l,)
        The face of each loop, in rising order; every face has a loop.

    Attributes
    ----------
    start, size, loop_face
        As given.
    """

    def __init__(self, start: np.ndarray, size: np.ndarray, loop_face: np.ndarray) -> None:
        self.start = start
        self.size = size
        self.loop_face = loop_face

    @classmethod
    def of(cls, faces: Sequence[Face] | FaceLoops) -> FaceLoops:
        """Return the loops of faces; loops are returned as they are."""
        if isinstance(faces, FaceLoops):
            return faces
        return cls.of_cycles([face.loops for face in faces])

    @classmethod
    def of_cycles(cls, cycles: Sequence[Sequence[Sequence[int]]]) -> FaceLoops:
        """Return the loops of faces, each given as its loops of vertex indices."""
        loops = list(chain.from_iterable(cycles))
        size = _integers(map(len, loops))
        n_loops = _integers(map(len, cycles))
        start = _integers(chain.from_iterable(loops))
        return cls(start, size, np.repeat(np.arange(len(n_loops)), n_loops))

    @classmethod
    def of_triangles(cls, triangles: np.ndarray) -> FaceLoops:
        """Return the loops of triangles, shape (t, 3)."""
        n = len(triangles)
        return cls(triangles.astype(np.int64).ravel(), np.full(n, 3), np.arange(n))

    @cached_property
    def first(self) -> np.ndarray:
        """The first half-edge of each loop, shape (l,)."""
        return np.cumsum(self.size) - self.size

    @cached_property
    def following(self) -> np.ndarray:
        """The next half-edge of the same loop, shape (h,)."""
        following = np.arange(1, len(self.start) + 1)
        following[self.first + self.size - 1] = self.first
        return following

    @cached_property
    def preceding(self) -> np.ndarray:
        """The half-edge before, of the same loop, shape (h,)."""
        preceding = np.arange(-1, len(self.start) - 1)
        preceding[self.first] = self.first + self.size - 1
        return preceding

    @cached_property
    def end(self) -> np.ndarray:
        """The vertex where each half-edge ends, shape (h,)."""
        return self.start[self.following]

    @cached_property
    def face(self) -> np.ndarray:
        """The face of each half-edge, shape (h,)."""
        return np.repeat(self.loop_face, self.size)

    @cached_property
    def outer(self) -> np.ndarray:
        """The outer loop of each face, shape (f,)."""
        return np.flatnonzero(np.diff(self.loop_face, prepend=-1))

    @cached_property
    def n_loops(self) -> np.ndarray:
        """The number of loops of each face, shape (f,)."""
        return np.bincount(self.loop_face)

    @cached_property
    def is_triangle(self) -> np.ndarray:
        """Which faces are triangles without holes, shape (f,)."""
        return (self.n_loops == 1) & (self.size[self.outer] == 3)

    @cached_property
    def groups(self) -> tuple[np.ndarray, np.ndarray]:
        """Half-edges sorted by the two vertices they join, lower ones first, and where each group begins."""
        low = np.minimum(self.start, self.end)
        high = np.maximum(self.start, self.end)
        key = low * (int(high.max(initial=0)) + 1) + high
        order = np.argsort(key, kind="stable")
        return order, np.flatnonzero(np.diff(key[order], prepend=-1))

    @cached_property
    def twin(self) -> np.ndarray:
        """The half-edge on the other side, shape (h,); for loops whose edges pair up."""
        order = self.groups[0]
        twin = np.empty_like(order)
        twin[order[0::2]] = order[1::2]
        twin[order[1::2]] = order[0::2]
        return twin

    def only(self, chosen: np.ndarray) -> FaceLoops:
        """Return the loops of some faces, numbered anew; `chosen` says which, shape (f,)."""
        number = np.cumsum(chosen) - 1
        which = chosen[self.loop_face]
        return FaceLoops(
            self.start[chosen[self.face]], self.size[which], number[self.loop_face[which]]
        )

    def loops_of(self, face: int) -> list[tuple[int, ...]]:
        """Return the loops of one face, the outer one first."""
        loop = int(self.outer[face])
        return [
            tuple(self.start[self.first[k] : self.first[k] + self.size[k]].tolist())
            for k in range(loop, loop + int(self.n_loops[face]))
        ]

    def by_size(self) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Go through the loops, those of one size k at a time.

        Yields
        ------
        tuple of ndarray of int, shapes (m,) and (m, k)
            The loops, and their half-edges.
        """
        for k in np.unique(self.size).tolist():
            which = np.flatnonzero(self.size == k)
            yield which, self.first[which][:, None] + np.arange(k)


def _integers(values: Iterable[int]) -> np.ndarray:
    return np.fromiter(values, dtype=np.int64)


# Places in words, for messages.


def describe_point(point: Iterable[float]) -> str:
    """Return a point as text for a message, in millimetres."""
    return "(" + ", ".join(f"{float(c):.6g}" for c in point) + ")"


@dataclass(frozen=True)
class Face:
    """A planar face: loops of vertex indices, counter-clockwise seen from outside.

    Holes run clockwise.

    Attributes
    ----------
    outer : tuple of int
        The outer loop.
    holes : tuple of tuple of int
        The inner loops.
    curved : bool
        Whether the face is a facet of a tessellated curved surface.
    """

    outer: tuple[int, ...]
    holes: tuple[tuple[int, ...], ...] = ()
    curved: bool = False

    __repr__ = short_repr

    @property
    def loops(self) -> tuple[tuple[int, ...], ...]:
        """All loops, the outer one first."""
        return (self.outer, *self.holes)

    def directed_edges(self) -> Iterator[tuple[int, int]]:
        """Go through the directed edges of all loops in order.

        Yields
        ------
        tuple of int
            Vertex indices (i, j) of one edge; the outer loop comes first.
        """
        for loop in self.loops:
            yield from zip(loop, (*loop[1:], loop[0]), strict=True)


@dataclass(frozen=True)
class Edge:
    """An edge between two faces.

    Attributes
    ----------
    id : int
        Position in ``Solid.edges``: the order of first appearance in the loops.
    vertices : tuple of int
        Its two vertices, as ``faces[0]`` traverses them.
    faces : tuple of int
        ``faces[0]`` traverses the vertices forwards, ``faces[1]`` backwards.
    dihedral_deg : float
        Signed turn of the outward normal across the edge in degrees: 0 coplanar, positive convex, negative re-entrant.
    curved : bool
        Whether the edge is a chord of a curved or smooth edge, or lies inside a tessellated curved
        face. Such an edge is never an entity.
    surface_turn_deg : float or None
        Largest turn of the surfaces' normal along the edge, in degrees. It is known for edges of
        curved faces in a CAD model, whose facets turn by less. Otherwise None.
    """

    id: int
    vertices: tuple[int, int]
    faces: tuple[int, int]
    dihedral_deg: float
    curved: bool
    surface_turn_deg: float | None = None

    @property
    def turn_deg(self) -> float:
        """The turn that decides whether the edge is sharp, in degrees.

        It is the turn of the CAD surfaces if known, with the sign of the facets.
        """
        if self.surface_turn_deg is None:
            return self.dihedral_deg
        return math.copysign(self.surface_turn_deg, self.dihedral_deg)


def as_face(face: Face | Sequence[Any]) -> Face:
    """Return `face` as a `Face`; accepts a loop, ``(outer, [hole, ...])`` or a `Face`."""
    if isinstance(face, Face):
        return face
    parts = list(face)
    if len(parts) == 2 and not np.isscalar(parts[0]):
        return Face(_loop(parts[0]), tuple(_loop(hole) for hole in parts[1]))
    return Face(_loop(parts))


def faces_of(loops: FaceLoops, curved: Iterable[bool]) -> list[Face]:
    """Return the faces with these loops, curved or not."""
    flags = list(curved)
    rows = zip(loops.loop_face.tolist(), loops.first.tolist(), loops.size.tolist(), strict=True)
    start = loops.start.tolist()
    cycles: list[list[tuple[int, ...]]] = [[] for _ in flags]
    for face, first, size in rows:
        cycles[face].append(tuple(start[first : first + size]))
    return [
        Face(face_cycles[0], tuple(face_cycles[1:]), flag)
        for face_cycles, flag in zip(cycles, flags, strict=True)
    ]


def is_index(value: object) -> bool:
    """Return whether a value is an integer, and no truth value."""
    return isinstance(value, int | np.integer) and not isinstance(value, bool)


def _loop(indices: Iterable[Any]) -> tuple[int, ...]:
    loop = tuple(indices)
    if not all(map(is_index, loop)):
        raise SolidError(f"faces must be loops of integer vertex indices. Got {loop}.")
    return tuple(int(i) for i in loop)


def describe_edge(vertices: np.ndarray, i: int, j: int) -> str:
    """Return the edge between vertices `i` and `j` as text for a message."""
    return f"edge from {describe_point(vertices[i])} to {describe_point(vertices[j])} (vertices {i} and {j})"


def pair_edges(
    vertices: np.ndarray, faces: Sequence[Face] | FaceLoops
) -> tuple[np.ndarray, np.ndarray]:
    """Match every directed edge with its reverse.

    Parameters
    ----------
    vertices : ndarray, shape (n, 3)
        Used in messages only.
    faces : sequence of Face or FaceLoops
        The faces, or their loops.

    Returns
    -------
    edge_vertices, edge_faces : ndarray of int, shape (m, 2)
        In order of first appearance; see `Edge`.

    Raises
    ------
    OpenSolidError, NonManifoldError, OrientationError
        An edge has one face, more than two, or two that traverse it in the same direction.
    """
    loops = FaceLoops.of(faces)
    order, begin = loops.groups
    count = np.diff(begin, append=len(order))
    first = order[begin]
    _check_users(vertices, loops, first, count)
    second = order[begin + 1]
    _check_directions(vertices, loops, first, second)
    rank = np.argsort(first)
    uses = np.stack([first[rank], second[rank]], axis=1)
    ends = np.stack([loops.start[uses[:, 0]], loops.end[uses[:, 0]]], axis=1)
    return ends, loops.face[uses]


def _check_users(
    vertices: np.ndarray, loops: FaceLoops, first: np.ndarray, count: np.ndarray
) -> None:
    """Raise for the first edge that has not two faces; `first` are half-edges, `count` their uses."""
    if (count > 2).any():
        rows = np.flatnonzero(count > 2)
        worst = rows[np.argmin(first[rows])]
        raise NonManifoldError(
            f"every edge must have exactly two faces. Got {count[worst]} at the "
            f"{_describe_half_edge(vertices, loops, first[worst])} ({len(rows)} such edges); "
            "solids that touch along an edge or a face are not one solid."
        )
    if (count == 1).any():
        lonely = first[count == 1]
        raise OpenSolidError(
            "the surface must be closed. Got one face only at the "
            f"{_describe_half_edge(vertices, loops, lonely.min())} ({len(lonely)} such edges)."
        )


def _check_directions(
    vertices: np.ndarray, loops: FaceLoops, first: np.ndarray, second: np.ndarray
) -> None:
    """Raise for the first edge that both of its faces traverse in the same direction."""
    alike = first[loops.start[first] == loops.start[second]]
    if len(alike):
        raise OrientationError(
            "faces must run in opposite directions along an edge. Got the same at the "
            f"{_describe_half_edge(vertices, loops, alike.min())}."
        )


def _describe_half_edge(vertices: np.ndarray, loops: FaceLoops, half_edge: int) -> str:
    """Return an edge as text for a message, its lower vertex first."""
    ends = sorted((int(loops.start[half_edge]), int(loops.end[half_edge])))
    return describe_edge(vertices, *ends)


def check_fans(vertices: np.ndarray, faces: Sequence[Face] | FaceLoops) -> None:
    """Check that the face corners around every vertex form one closed fan.

    Parameters
    ----------
    vertices : ndarray, shape (n, 3)
        Used in messages only.
    faces : sequence of Face or FaceLoops
        Faces, or their loops, whose edges are already known to pair up.

    Raises
    ------
    NonManifoldError
        A vertex has more than one fan, as where two solids touch in a point.
    """
    loops = FaceLoops.of(faces)
    folded = _vertices_of_folded_faces(loops)
    plain = np.ones(int(loops.start.max()) + 1, dtype=bool)
    plain[folded] = False
    broken = _plain_vertices_with_more_fans(loops, plain)
    broken += [v for v in folded.tolist() if not _has_one_fan(vertices, loops, v)]
    if broken:
        # the first one that the loops visit
        at = int(loops.start[np.flatnonzero(np.isin(loops.start, broken))[0]])
        place = describe_point(vertices[at])
        raise NonManifoldError(
            f"the faces around a vertex must form one fan. Got more at {place} (vertex {at}); "
            "solids that touch in a point are not one solid."
        )


def _vertices_of_folded_faces(loops: FaceLoops) -> np.ndarray:
    """Return the vertices in which a face touches itself."""
    h = np.flatnonzero(~loops.is_triangle[loops.face])
    n = int(loops.start.max()) + 1
    visit, count = np.unique(loops.face[h] * n + loops.start[h], return_counts=True)
    return np.unique(visit[count > 1] % n)


def _plain_vertices_with_more_fans(loops: FaceLoops, plain: np.ndarray) -> list[int]:
    """Return the vertices with more than one fan, of those that each face visits once at most."""
    # a corner reaches left from its half-edge to the edge before, where the next corner begins
    turned = loops.twin[loops.preceding]
    corner = np.flatnonzero(plain[loops.start])
    n = len(turned)
    links = coo_array((np.ones(len(corner), dtype=bool), (corner, turned[corner])), shape=(n, n))
    fan = connected_components(links, directed=False)[1][corner]
    _, rows = np.unique(fan, return_index=True)
    n_fans = np.bincount(loops.start[corner[rows]])
    return np.flatnonzero(n_fans > 1).tolist()


def _has_one_fan(vertices: np.ndarray, loops: FaceLoops, at: int) -> bool:
    """Return whether the corners at a vertex form one closed fan; faces may visit it more than once."""
    following: dict[int, int] = {}
    for face in np.unique(loops.face[loops.start == at]).tolist():
        following.update(_corners(vertices, loops.loops_of(face), at))
    begin = next(iter(following))
    end = following[begin]
    n = 1
    while end != begin and n <= len(following):
        end = following[end]
        n = n + 1
    return n == len(following)


def _corners(
    vertices: np.ndarray, loops: Sequence[tuple[int, ...]], at: int
) -> list[tuple[int, int]]:
    """Return the corners (after, before) of a face at a vertex, each between the edges to and from these."""
    pairs = [
        (after, before)
        for loop in loops
        for before, v, after in zip((loop[-1], *loop[:-1]), loop, (*loop[1:], loop[0]), strict=True)
        if v == at
    ]
    return pairs if len(pairs) == 1 else _pair_around(vertices, loops[0], at, pairs)


def _pair_around(
    vertices: np.ndarray, outer: tuple[int, ...], at: int, pairs: list[tuple[int, int]]
) -> list[tuple[int, int]]:
    """Pair the edges of a face that touches itself in a vertex: a corner reaches left from `after` to the next edge."""
    ring = vertices[list(outer)] - vertices[at]
    normal = np.cross(ring, np.roll(ring, -1, axis=0)).sum(axis=0)

    def turn(after: int, before: int) -> float:
        a = vertices[after] - vertices[at]
        b = vertices[before] - vertices[at]
        sine = np.cross(a, b) @ normal / np.linalg.norm(normal)
        return float(np.arctan2(sine, a @ b)) % (2.0 * np.pi)

    return [
        (after, min((before for _, before in pairs), key=lambda b: turn(after, b)))
        for after, _ in pairs
    ]


def label_shells(n_faces: int, edge_faces: np.ndarray) -> np.ndarray:
    """Label each face with its shell (connected component across edges).

    Returns
    -------
    ndarray of int, shape (n_faces,)
        Labels 0, 1, ... in order of each shell's first face.
    """
    links = coo_array(
        (np.ones(len(edge_faces)), (edge_faces[:, 0], edge_faces[:, 1])), shape=(n_faces, n_faces)
    )
    labels = connected_components(links, directed=False)[1]
    _, first = np.unique(labels, return_index=True)
    rank = np.empty(len(first), dtype=np.int64)
    rank[np.argsort(first)] = np.arange(len(first))
    return rank[labels]


def signed_dihedrals_deg(
    vertices: np.ndarray, normals: np.ndarray, edge_vertices: np.ndarray, edge_faces: np.ndarray
) -> np.ndarray:
    """Return the signed turn of the normal across each edge in degrees, shape (m,); see `Edge`."""
    before = normals[edge_faces[:, 0]]
    after = normals[edge_faces[:, 1]]
    along = vertices[edge_vertices[:, 1]] - vertices[edge_vertices[:, 0]]
    length = np.linalg.norm(along, axis=1, keepdims=True)
    if not length.all():
        # the squares of a length below 1e-162 are zero
        is_zero = length[:, 0] == 0.0
        along[is_zero] /= np.abs(along[is_zero]).max(axis=1, keepdims=True)
        length[is_zero] = np.linalg.norm(along[is_zero], axis=1, keepdims=True)
    along /= length
    sine = np.einsum("ij,ij->i", np.cross(before, after), along)
    return np.degrees(np.arctan2(sine, np.einsum("ij,ij->i", before, after)))


# Triangles of planar faces with holes, using the faces' own vertices only.


def newell_area_vector(points: np.ndarray) -> np.ndarray:
    """Return the area vector of closed polygons: its length is the area, its direction the normal.

    Parameters
    ----------
    points : ndarray, shape (..., k, 3)
        The loops, in mm.

    Returns
    -------
    ndarray, shape (..., 3)
        In mm².
    """
    local = points - points[..., :1, :]
    return 0.5 * np.cross(local, np.roll(local, -1, axis=-2)).sum(axis=-2)


def triangulate_face(
    vertices: np.ndarray, face: Face, normal: np.ndarray, name: str = "face"
) -> np.ndarray:
    """Cut a face into triangles, counter-clockwise seen from outside.

    Parameters
    ----------
    vertices : ndarray, shape (n, 3)
        All vertices, in mm.
    face : Face
        The face; collinear vertices in its loops are kept.
    normal : ndarray, shape (3,)
        Its outward unit normal.
    name : str
        How a message calls the face.

    Returns
    -------
    ndarray of int32, shape (m, 3)
        Vertex indices. Guarantee: every directed edge of the loops is a side of exactly one triangle and every other
        side is shared by two, so the triangles of neighbouring faces meet edge to edge.

    Raises
    ------
    SolidError
        The loops cross, or a hole is not inside the outer loop.
    """
    loops = FaceLoops.of([face])
    return triangulate_faces(vertices, loops, normal[None], lambda _: name)[0]


def triangulate_faces(
    vertices: np.ndarray,
    loops: FaceLoops,
    normals: np.ndarray,
    name: Callable[[int], str] = "face {}".format,
) -> tuple[np.ndarray, ...]:
    """Cut faces into triangles; see `triangulate_face`.

    Parameters
    ----------
    vertices : ndarray, shape (n, 3)
        All vertices, in mm.
    loops : FaceLoops
        The loops of the faces.
    normals : ndarray, shape (f, 3)
        Their outward unit normals.
    name : callable
        Returns how a message calls a face.

    Returns
    -------
    tuple of ndarray of int32, shape (m, 3)
        The triangles of each face.

    Raises
    ------
    SolidError
        The loops of a face cross, or a hole is not inside the outer loop.
    """
    whole = np.flatnonzero(loops.is_triangle)
    first = loops.first[loops.outer[whole]]
    rows = loops.start[first[:, None] + np.arange(3)].astype(np.int32)
    if len(whole) == len(normals):
        return tuple(rows[:, None])
    cut: list[np.ndarray] = [rows[:0]] * len(normals)
    for face, row in zip(whole.tolist(), rows[:, None], strict=True):
        cut[face] = row
    others = np.flatnonzero(~loops.is_triangle)
    for face, triangles in zip(
        others.tolist(), _cut_polygons(vertices, loops, normals, others, name), strict=True
    ):
        cut[face] = triangles
    return tuple(cut)


def _cut_polygons(
    vertices: np.ndarray,
    loops: FaceLoops,
    normals: np.ndarray,
    faces: np.ndarray,
    name: Callable[[int], str],
) -> list[np.ndarray]:
    """Return the triangles of faces that are more than one."""
    rank = np.full(len(normals), -1)
    rank[faces] = np.arange(len(faces))
    half_edges = np.flatnonzero(rank[loops.face] >= 0)
    of_face = rank[loops.face[half_edges]]
    corners = loops.start[half_edges]
    # Dropping one coordinate keeps the others bit for bit, so corners are recognised by their coordinates afterwards.
    flat = vertices[corners[:, None], _projection_axes(normals[faces])[of_face]]
    which = rank[loops.loop_face] >= 0
    ring = np.repeat(np.arange(int(which.sum())), loops.size[which])
    polygons = shapely.polygons(
        shapely.linearrings(flat, indices=ring), indices=rank[loops.loop_face[which]]
    )
    crossed = np.flatnonzero(~shapely.is_valid(polygons))
    # of several faces that are wrong the first is named
    n_sound = int(crossed[0]) if len(crossed) else len(faces)
    parts = shapely.constrained_delaunay_triangles(polygons[:n_sound])
    points, owner = shapely.get_coordinates(parts, return_index=True)
    rings = points.reshape(-1, 4, 2)[:, :3]
    owner = owner[::4]
    area = _signed_areas(rings)
    rings[area < 0] = rings[area < 0][:, ::-1]
    places = zip(of_face.tolist(), *flat.T.tolist(), strict=True)
    index = dict(zip(places, corners.tolist(), strict=True))
    # a hole that touches another loop in a vertex is joined to it there, and two triangles fewer are needed
    n_places = np.bincount(np.fromiter((key[0] for key in index), dtype=np.int64))
    n_corners = np.bincount(of_face)
    n_loops = loops.n_loops[faces]
    n_expected = (2 * n_places - n_corners + 2 * n_loops - 4)[:n_sound]
    covered = np.bincount(owner, np.abs(area), minlength=n_sound)
    one_region = np.isclose(covered, shapely.area(polygons[:n_sound]), rtol=1e-9)
    n_triangles = np.bincount(owner, minlength=n_sound)
    wrong = np.flatnonzero((n_triangles != n_expected) | ~one_region)
    if len(wrong):
        raise SolidError(
            f"the loops of a face must bound one region. Got {name(int(faces[wrong[0]]))} "
            f"with {n_loops[wrong[0]]} loops."
        )
    if len(crossed):
        raise SolidError(
            f"the loops of a face must not cross. Got {name(int(faces[n_sound]))}: "
            f"{shapely.is_valid_reason(polygons[n_sound])}."
        )
    keys = zip(np.repeat(owner, 3).tolist(), *rings.reshape(-1, 2).T.tolist(), strict=True)
    triangles = np.array([index[key] for key in keys], dtype=np.int32).reshape(-1, 3)
    return np.split(triangles, np.cumsum(n_triangles)[:-1])


def _projection_axes(normals: np.ndarray) -> np.ndarray:
    """Return the two axes to keep, in the order that leaves a loop about a normal counter-clockwise, shape (f, 2)."""
    drop = np.argmax(np.abs(normals), axis=1)
    keep = np.stack([(drop + 1) % 3, (drop + 2) % 3], axis=1)
    upwards = np.take_along_axis(normals, drop[:, None], axis=1) > 0
    return np.where(upwards, keep, keep[:, ::-1])


def _signed_areas(rings: np.ndarray) -> np.ndarray:
    a = rings[:, 1] - rings[:, 0]
    b = rings[:, 2] - rings[:, 0]
    return 0.5 * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])


def signed_volume(vertices: np.ndarray, triangles: np.ndarray) -> float:
    """Return the volume enclosed by closed triangles in mm³, positive if they face outwards."""
    local = vertices - vertices.mean(axis=0)
    a, b, c = (local[triangles[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


class FacetedSurface(Protocol):
    """What modules below `Solid` read of one; see there for shapes and units."""

    @property
    def vertices(self) -> np.ndarray: ...  # noqa: D102

    @property
    def faces(self) -> tuple[Face, ...]: ...  # noqa: D102

    @property
    def edges(self) -> tuple[Edge, ...]: ...  # noqa: D102

    @property
    def normals(self) -> np.ndarray: ...  # noqa: D102

    @property
    def triangles(self) -> np.ndarray: ...  # noqa: D102

    @property
    def triangle_face(self) -> np.ndarray: ...  # noqa: D102

    @property
    def face_shell(self) -> np.ndarray: ...  # noqa: D102
