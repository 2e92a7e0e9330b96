"""Faces, edges, vertex fans and shells: what follows from the vertex indices of the loops alone.

Notation
--------
A *loop* is a cycle of vertex indices. It *traverses* the directed edge (i, j) when j follows i. In a closed oriented
surface every directed edge is traversed exactly once, and so is its reverse, by the face on the other side.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from aspectgraph.exceptions import NonManifoldError, OpenSolidError, OrientationError, SolidError
from aspectgraph.solid.face_loops import FaceLoops
from aspectgraph.solid.places import describe_point


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
    return [Face(own[0], tuple(own[1:]), flag) for own, flag in zip(cycles, flags, strict=True)]


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
        where = np.flatnonzero(count > 2)
        worst = where[np.argmin(first[where])]
        raise NonManifoldError(
            f"every edge must have exactly two faces. Got {count[worst]} at the "
            f"{_describe_half_edge(vertices, loops, first[worst])} ({len(where)} such edges); "
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
    _, where = np.unique(fan, return_index=True)
    n_fans = np.bincount(loops.start[corner[where]])
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
        least = length[:, 0] == 0.0
        along[least] /= np.abs(along[least]).max(axis=1, keepdims=True)
        length[least] = np.linalg.norm(along[least], axis=1, keepdims=True)
    along /= length
    sine = np.einsum("ij,ij->i", np.cross(before, after), along)
    return np.degrees(np.arctan2(sine, np.einsum("ij,ij->i", before, after)))
