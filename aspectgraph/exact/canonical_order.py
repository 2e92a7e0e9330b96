"""One order for the vertices and faces of a part, whatever order its user lists them in.

Vertices are ranked by their places on the grid, loops start at their least vertex, and faces and holes are sorted by
the ranks of theirs. Whatever depends on an order of work (which plane of several that agree is kept, how a face is cut
into pieces, in which order cells are cut) then depends on the part alone. Numbers stay the user's everywhere.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from aspectgraph.solid.solid import Solid
from aspectgraph.solid.topology import Face


class Listing(NamedTuple):
    """The part's own order.

    Attributes
    ----------
    rank : ndarray of int, shape (n,)
        Of each vertex.
    vertex : ndarray of int, shape (n,)
        The vertex of each rank.
    faces : tuple of Face
        The user's faces, sorted, their loops in ranks.
    face : ndarray of int, shape (f,)
        The user's number of each of them.
    """

    rank: np.ndarray
    vertex: np.ndarray
    faces: tuple[Face, ...]
    face: np.ndarray


def list_solid(solid: Solid, points: np.ndarray) -> Listing:
    """Order a solid by its vertices' places on the grid, (n, 3) integers."""
    vertex = np.lexsort(points.T[::-1])
    rank = np.empty_like(vertex)
    rank[vertex] = np.arange(len(vertex))
    faces = []
    for number, face in enumerate(solid.faces):
        outer, *holes = (_from_least(loop, rank) for loop in face.loops)
        faces.append((outer, tuple(sorted(holes)), number))
    faces.sort()
    return Listing(
        rank,
        vertex,
        tuple(Face(outer, holes) for outer, holes, _ in faces),
        np.array([number for *_, number in faces]),
    )


def _from_least(loop: Iterable[int], rank: np.ndarray) -> tuple[int, ...]:
    ranks = rank[list(loop)].tolist()
    start = ranks.index(min(ranks))
    return (*ranks[start:], *ranks[:start])
