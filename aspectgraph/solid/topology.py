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
from aspectgraph.solid.places import describe_point


@dataclass(frozen=True)
class Face:
    """A planar face: vertex-index loops, counter-clockwise seen from outside; holes run the other way round.

    Attributes
    ----------
    outer : tuple of int
        The outer loop.
    holes : tuple of tuple of int
        The inner loops.
    curved : bool
        The face is a facet of a tessellated curved surface.
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
        The edge is a chord of a curved or smooth edge of the part, or lies inside a tessellated curved face; such an
        edge is never an entity.
    surface_turn_deg : float or None
        Largest turn of the surfaces' normal along the edge in degrees, where the CAD model is known and a face beside
        the edge is curved: its facets turn by less.
    """

    id: int
    vertices: tuple[int, int]
    faces: tuple[int, int]
    dihedral_deg: float
    curved: bool
    surface_turn_deg: float | None = None

    @property
    def turn_deg(self) -> float:
        """The turn that decides whether the edge is sharp: that of the surfaces where known, with the facets' sign."""
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


def _loop(indices: Iterable[Any]) -> tuple[int, ...]:
    loop = tuple(indices)
    if any(isinstance(i, bool) or not isinstance(i, int | np.integer) for i in loop):
        raise SolidError(f"faces must be loops of integer vertex indices. Got {loop}.")
    return tuple(int(i) for i in loop)


def describe_edge(vertices: np.ndarray, i: int, j: int) -> str:
    """Return the edge between vertices `i` and `j` as text for a message."""
    return f"edge from {describe_point(vertices[i])} to {describe_point(vertices[j])} (vertices {i} and {j})"


def pair_edges(vertices: np.ndarray, faces: Sequence[Face]) -> tuple[np.ndarray, np.ndarray]:
    """Match every directed edge with its reverse.

    Parameters
    ----------
    vertices : ndarray, shape (n, 3)
        Used in messages only.
    faces : sequence of Face
        The faces.

    Returns
    -------
    edge_vertices, edge_faces : ndarray of int, shape (m, 2)
        In order of first appearance; see `Edge`.

    Raises
    ------
    OpenSolidError, NonManifoldError, OrientationError
        An edge has one face, more than two, or two that traverse it in the same direction.
    """
    users: dict[tuple[int, int], list[tuple[int, bool]]] = {}
    for f, face in enumerate(faces):
        for i, j in face.directed_edges():
            users.setdefault((min(i, j), max(i, j)), []).append((f, i < j))
    _check_users(vertices, users)
    edge_vertices = [(a, b) if uses[0][1] else (b, a) for (a, b), uses in users.items()]
    edge_faces = [(uses[0][0], uses[1][0]) for uses in users.values()]
    return np.array(edge_vertices, dtype=np.int64), np.array(edge_faces, dtype=np.int64)


def _check_users(
    vertices: np.ndarray, users: dict[tuple[int, int], list[tuple[int, bool]]]
) -> None:
    """Raise for the first edge that is not used once in each direction."""
    crowded = [edge for edge, uses in users.items() if len(uses) > 2]
    if crowded:
        text = describe_edge(vertices, *crowded[0])
        n = len(users[crowded[0]])
        raise NonManifoldError(
            f"every edge must have exactly two faces. Got {n} at the {text} ({len(crowded)} such edges); "
            "solids that touch along an edge or a face are not one solid."
        )
    lonely = [edge for edge, uses in users.items() if len(uses) == 1]
    if lonely:
        text = describe_edge(vertices, *lonely[0])
        raise OpenSolidError(
            f"the surface must be closed. Got one face only at the {text} ({len(lonely)} such edges)."
        )
    for edge, uses in users.items():
        if uses[0][1] == uses[1][1]:
            text = describe_edge(vertices, *edge)
            raise OrientationError(
                f"faces must run in opposite directions along an edge. Got the same at the {text}."
            )


def check_fans(vertices: np.ndarray, faces: Sequence[Face]) -> None:
    """Check that the face corners around every vertex form one closed fan.

    Parameters
    ----------
    vertices : ndarray, shape (n, 3)
        Used in messages only.
    faces : sequence of Face
        Faces whose edges are already known to pair up.

    Raises
    ------
    NonManifoldError
        A vertex has more than one fan, as where two solids touch in a point.
    """
    following: dict[tuple[int, int], int] = {}
    corners: dict[int, list[int]] = {}
    for face in faces:
        for at, after, before in _corners(vertices, face):
            following[at, after] = before
            corners.setdefault(at, []).append(after)
    for at, ends in corners.items():
        end = following[at, ends[0]]
        n = 1
        while end != ends[0] and n <= len(ends):
            end = following[at, end]
            n = n + 1
        if n != len(ends):
            place = describe_point(vertices[at])
            raise NonManifoldError(
                f"the faces around a vertex must form one fan. Got more at {place} (vertex {at}); "
                "solids that touch in a point are not one solid."
            )


def _corners(vertices: np.ndarray, face: Face) -> Iterator[tuple[int, int, int]]:
    """Yield the corners (at, after, before) of a face, each between the edge to `after` and that from `before`."""
    visits: dict[int, list[tuple[int, int]]] = {}
    for loop in face.loops:
        for before, at, after in zip(
            (loop[-1], *loop[:-1]), loop, (*loop[1:], loop[0]), strict=True
        ):
            visits.setdefault(at, []).append((after, before))
    for at, pairs in visits.items():
        if len(pairs) > 1:
            pairs = _pair_around(vertices, face, at, pairs)
        yield from ((at, after, before) for after, before in pairs)


def _pair_around(
    vertices: np.ndarray, face: Face, at: int, pairs: list[tuple[int, int]]
) -> list[tuple[int, int]]:
    """Pair the edges of a face that touches itself in a vertex: a corner reaches left from `after` to the next edge."""
    ring = vertices[list(face.outer)] - vertices[at]
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
