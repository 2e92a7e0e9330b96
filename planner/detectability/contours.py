"""Lines that a part may show in an image: its sharp edges, and contours where curved faces turn away.

A *contour* is an edge that shows from a viewpoint: a sharp one, unless a face beside it hides it there, or one between
two facets of a curved surface, the one facing the camera and the other not.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from aspectgraph.solid.edge_ends import edges_that_show

if TYPE_CHECKING:
    from aspectgraph import Solid

# what an edge of the part is to an entity
OTHER = 0
OWN = 1
CONNECTED = 2
# bits of `Contours.kinds`
SHARP = 1
CONVEX = 2
CURVED = 4
# whether an edge shows, by its kind and how many of its faces turn to the camera: smooth ones where one turns away,
# sharp ones where none does, and convex ones in both cases
SHOWS = np.array(
    [[0, not kind & SHARP or kind & CONVEX > 0, kind & SHARP > 0] for kind in range(8)], np.int64
)


class Contours(NamedTuple):
    """Edges (m) of a part that may be contours.

    Attributes
    ----------
    vertices : array (v, 3)
        Corners of the part, mm.
    ends : array of int (m, 2)
        Vertex numbers.
    planes : array (f, 4)
        Unit normals and offsets of the part's faces: n·x > o in front.
    faces : array of int (m, 2)
        Their faces.
    kinds : array of uint8 (m,)
        Bits `SHARP`, `CONVEX` and `CURVED`, which are chords.
    ids : array of int (m,)
        Numbers in ``solid.edges``.
    """

    vertices: NDArray[np.float64]
    ends: NDArray[np.int64]
    planes: NDArray[np.float64]
    faces: NDArray[np.int64]
    kinds: NDArray[np.uint8]
    ids: NDArray[np.int64]


def contours_of(solid: Solid) -> Contours:
    """Return the edges of a part that may be contours from some viewpoint.

    Parameters
    ----------
    solid : Solid
        The part.

    Returns
    -------
    Contours
        Without the smooth edges of hollows, which are hidden wherever one of their faces turns away.
    """
    shows = edges_that_show(solid)
    turns = np.array([edge.dihedral_deg for edge in solid.edges])
    ids = np.flatnonzero(shows | (turns > 0))
    edges = [solid.edges[i] for i in ids]
    ends = np.array([edge.vertices for edge in edges], np.int64).reshape(-1, 2)
    faces = np.array([edge.faces for edge in edges], np.int64).reshape(-1, 2)
    vertices = np.ascontiguousarray(solid.vertices, np.float64)
    normals = np.asarray(solid.normals, np.float64)
    offsets = np.zeros(len(normals))
    offsets[faces] = np.einsum("efk,ek->ef", normals[faces], vertices[ends[:, 0]])
    curved = np.array([edge.curved for edge in edges], bool)
    kinds = (
        np.where(shows[ids], SHARP, 0)
        | np.where(turns[ids] > 0, CONVEX, 0)
        | np.where(curved, CURVED, 0)
    )
    planes = np.ascontiguousarray(np.column_stack([normals, offsets]))
    return Contours(vertices, ends, planes, faces, kinds.astype(np.uint8), ids.astype(np.int64))


Meeting = dict[int, list[int]]
"""Vertex to the contours that end there."""


def meeting(contours: Contours) -> Meeting:
    """Return which contours end at which vertex."""
    at: Meeting = {}
    for e, (a, b) in enumerate(contours.ends.tolist()):
        at.setdefault(a, []).append(e)
        at.setdefault(b, []).append(e)
    return at


def relation_to(
    contours: Contours, at: Meeting, edge_ids: Sequence[int], radius_mm: float
) -> NDArray[np.uint8]:
    """Return what each edge (m,) is to an entity: another one, its own, or connected to it at a vertex.

    Connected are the edges that meet it, and of curves that meet it the next chords.

    Parameters
    ----------
    contours : Contours
        Of the part.
    at : dict
        See `meeting`.
    edge_ids : sequence of int
        Edges of the entity.
    radius_mm : float
        How far from the vertex chords still count as connected.
    """
    relation = np.full(len(contours.ids), OTHER, np.uint8)
    own = np.isin(contours.ids, list(edge_ids))
    for vertex in np.unique(contours.ends[own]).tolist():
        distance = np.linalg.norm(contours.vertices - contours.vertices[vertex], axis=1)
        reached = {vertex}
        waiting = [vertex]
        while waiting:
            here = waiting.pop()
            for e in at[here]:
                if here != vertex and not contours.kinds[e] & CURVED:
                    continue
                relation[e] = CONNECTED
                for other in contours.ends[e].tolist() if contours.kinds[e] & CURVED else ():
                    if other not in reached and distance[other] <= radius_mm:
                        reached.add(other)
                        waiting.append(other)
    relation[own] = OWN
    return relation
