"""Facets of curved surfaces in a mesh that no longer says what it was.

A mesh file knows triangles only. This is how the flat facets of cylinders, fillets and the like are told from faces
that were meant flat, so that chords of a hole's rim are not offered as straight edges.

Rules
-----
* An edge is *gentle* if the normal turns by less than `GENTLE_DEG` there. A *strip* is a face, or two triangles nearly
  flat across the edge that is the flattest of both.
* The *width* of a strip is its area over the length of its longest gentle edge. A strip matches a neighbour if it is no
  wider than `WIDTH_RATIO` times that.
* Where a plane runs into an arc, it turns by half of what neighbouring strips of the arc do. A gentle edge is *tangent*
  for a strip if it turns by less than `TANGENT_SHARE` of what the strip across turns, the same way, at another edge.
* A strip is a *facet* of a curved surface if it has two or more gentle edges to matching neighbours that turn the same
  way, not all of them tangent, and an arc through the strip that turns by the mean of the two largest turns would stand
  off from it by no more than `RELATIVE_SAGITTA` of the part's bounding box diagonal.
* So is a strip that matches a facet across a gentle edge that is not tangent for it.
* Curved, and thus no candidate, are the gentle edges of facets, and the edges of facets that start at a gentle edge of
  theirs (the chords of a rim). Not so an edge that meets no gentle one, the straight end of the surface, nor one to a
  plane that turns by more than `SHARP_SHARE` times what the surface turns inside.

A prism that really has twelve or more sides is therefore taken for a cylinder; read it from STEP to keep its edges.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from aspectgraph.solid.checks import face_area_vectors
from aspectgraph.solid.face_loops import FaceLoops
from aspectgraph.solid.topology import pair_edges, signed_dihedrals_deg

GENTLE_DEG = 33.0
"""Largest turn between neighbouring facets of a curved surface: twelve facets to a full turn, and some rounding."""

RELATIVE_SAGITTA = 0.0125
"""Largest distance of a facet from its arc, as a fraction of the bounding box diagonal: 0.012 for a whole cylinder of
twelve facets."""

WIDTH_RATIO = 4.0
"""How much wider than its neighbour a facet of a curved surface may be."""

TANGENT_SHARE = 0.75
"""Between the half of a tangent plane and the whole of an even arc, nearer to the whole: arcs are seldom uneven."""

FLAT_SHARE = 0.25
"""Two triangles are one strip if they turn by no more than this share of what they turn to others."""

SHARP_SHARE = 2.0
"""A curved surface ends where it turns by more than this many times what it turns inside."""

# a turn that rounding of the vertices explains
_FLAT_DEG = 1e-3


def find_curved(vertices: np.ndarray, loops: FaceLoops) -> tuple[np.ndarray, np.ndarray]:
    """Find the faces that are facets of curved surfaces, and their chords.

    Parameters
    ----------
    vertices : ndarray, shape (n, 3)
        In mm.
    loops : FaceLoops
        The faces of a closed surface, coplanar triangles joined.

    Returns
    -------
    curved : ndarray of bool, shape (f,)
        Which faces are such facets.
    chords : ndarray of int, shape (e, 2)
        Vertex pairs, lower index first.
    """
    edge_vertices, edge_faces = pair_edges(vertices, loops)
    area_vectors = face_area_vectors(vertices, loops)
    areas = np.linalg.norm(area_vectors, axis=1)
    normals = area_vectors / np.maximum(areas[:, None], 1e-300)
    turns = signed_dihedrals_deg(vertices, normals, edge_vertices, edge_faces)
    gentle = np.abs(turns) < GENTLE_DEG
    strip = _pair_triangles(loops.size[loops.outer] == 3, edge_faces[gentle], np.abs(turns[gentle]))
    edge_strips = strip[edge_faces]
    inner = edge_strips[:, 0] == edge_strips[:, 1]
    bend = gentle & ~inner & (np.abs(turns) > _FLAT_DEG)
    lengths = np.linalg.norm(vertices[edge_vertices[:, 1]] - vertices[edge_vertices[:, 0]], axis=1)
    widths = _widths(
        np.bincount(strip, weights=areas), edge_strips[gentle & ~inner], lengths[gentle & ~inner]
    )
    sagitta_mm = RELATIVE_SAGITTA * float(np.linalg.norm(np.ptp(vertices, axis=0)))
    bends = _bends(edge_strips[bend], turns[bend], widths)
    facet = _are_facets(bends, widths, sagitta_mm)
    beside = bends.strip[facet[bends.across] & bends.matches & ~bends.tangent]
    facet[beside] = True
    smooth = gentle & ~_sharp(turns, edge_strips, facet, bends)
    chord = _chords(facet, edge_vertices, edge_strips, smooth, inner)
    return facet[strip], np.sort(edge_vertices[chord], axis=1)


def _pair_triangles(
    triangular: np.ndarray, edge_faces: np.ndarray, turns: np.ndarray
) -> np.ndarray:
    """Number the strips: a strip is a face, or two triangles that are nearly flat across the flattest edge of both."""
    face = edge_faces.ravel()
    across = edge_faces[:, ::-1].ravel()
    turn = np.repeat(turns, 2)
    steepest = np.zeros(len(triangular))
    np.maximum.at(steepest, face, turn)
    # the flattest edge of each triangle; of equals, that to the lower face
    order = np.lexsort((across, turn, face))
    order = order[np.diff(face[order], prepend=-1) > 0]
    flattest = np.full(len(triangular), np.inf)
    beyond = np.full(len(triangular), -1)
    flattest[face[order]] = turn[order]
    beyond[face[order]] = across[order]
    beyond[~triangular] = -1
    strip = np.arange(len(triangular))
    f = np.flatnonzero((beyond >= 0) & (beyond < strip))
    g = beyond[f]
    one = (beyond[g] == f) & (flattest[f] <= FLAT_SHARE * np.minimum(steepest[f], steepest[g]))
    strip[f[one]] = g[one]
    return np.unique(strip, return_inverse=True)[1].ravel()


def _widths(areas: np.ndarray, edge_strips: np.ndarray, lengths: np.ndarray) -> np.ndarray:
    """Return the width of every strip across its gentle edges: area over the length of the longest of them."""
    longest = np.zeros(len(areas))
    for side in (0, 1):
        np.maximum.at(longest, edge_strips[:, side], lengths)
    return np.divide(areas, longest, out=np.full(len(areas), np.inf), where=longest > 0)


class _Bends(NamedTuple):
    """The gentle edges that are not flat, each as one of its strips sees it; all of shape (2 e,)."""

    strip: np.ndarray
    across: np.ndarray
    turn: np.ndarray
    matches: np.ndarray
    tangent: np.ndarray


def _bends(edge_strips: np.ndarray, turns: np.ndarray, widths: np.ndarray) -> _Bends:
    """Return the gentle edges of all strips that are not flat."""
    strip = edge_strips.ravel()
    across = edge_strips[:, ::-1].ravel()
    turn = np.repeat(turns, 2)
    size = np.abs(turn)
    largest, second = _two_largest(_way(strip, turn), size, 2 * len(widths))
    # what the strip across turns the same way at another edge
    other = _way(across, turn)
    elsewhere = np.where(largest[other] == size, second[other], largest[other])
    matches = widths[strip] <= WIDTH_RATIO * widths[across]
    return _Bends(strip, across, turn, matches, size < TANGENT_SHARE * elsewhere)


def _way(strip: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """Number the two ways in which strips turn."""
    return 2 * strip + (turn > 0)


def _two_largest(
    group: np.ndarray, size: np.ndarray, n_groups: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return the largest and the second largest size in each group, 0 where there is none."""
    order = np.lexsort((-size, group))
    begins = np.diff(group[order], prepend=-1) > 0
    largest = np.zeros(n_groups)
    largest[group[order[begins]]] = size[order[begins]]
    follows = np.flatnonzero(begins[:-1] & ~begins[1:]) + 1
    second = np.zeros(n_groups)
    second[group[order[follows]]] = size[order[follows]]
    return largest, second


def _are_facets(bends: _Bends, widths: np.ndarray, sagitta_mm: float) -> np.ndarray:
    """Return which strips have matching neighbours on two sides, and stand off little from the arc through these."""
    kept = bends.matches
    group = _way(bends.strip[kept], bends.turn[kept])
    n = 2 * len(widths)
    largest, second = _two_largest(group, np.abs(bends.turn[kept]), n)
    n_bends = np.bincount(group, minlength=n)
    n_tangent = np.bincount(group[bends.tangent[kept]], minlength=n)
    # A chord of width w under an arc that turns by t: the arc stands off by w / 2 tan(t / 4).
    turn = 0.5 * (largest + second)
    likely = np.flatnonzero((n_bends >= 2) & (n_tangent < n_bends))
    stands_off = 0.5 * widths[likely // 2] * np.tan(np.radians(turn[likely]) / 4.0)
    facet = np.zeros(len(widths), dtype=bool)
    facet[likely[stands_off <= sagitta_mm] // 2] = True
    return facet


def _sharp(
    turns: np.ndarray, edge_strips: np.ndarray, facet: np.ndarray, bends: _Bends
) -> np.ndarray:
    """Return the edges where a curved surface ends at a plane by turning much more than it does inside."""
    inside = facet[bends.across]
    steepest = np.zeros(len(facet))
    np.maximum.at(steepest, bends.strip[inside], np.abs(bends.turn[inside]))
    ends = facet[edge_strips[:, 0]] != facet[edge_strips[:, 1]]
    side = np.where(facet[edge_strips[:, 0]], edge_strips[:, 0], edge_strips[:, 1])
    # what bends turns by more than zero
    limit = steepest[side]
    return ends & (limit > 0.0) & (np.abs(turns) > SHARP_SHARE * limit)


def _chords(
    facet: np.ndarray,
    edge_vertices: np.ndarray,
    edge_strips: np.ndarray,
    smooth: np.ndarray,
    inner: np.ndarray,
) -> np.ndarray:
    of_facet = facet[edge_strips]
    curved = smooth & of_facet.any(axis=1)
    # a vertex and a facet whose gentle edge ends there
    keys = edge_vertices[:, :, None] * len(facet) + edge_strips[:, None, :]
    here = np.broadcast_to(of_facet[:, None, :], keys.shape)
    around = curved & ~inner
    rims = np.unique(keys[around][here[around]])
    ends = np.flatnonzero(of_facet.any(axis=1) & ~smooth)
    curved[ends] = (np.isin(keys[ends], rims) & here[ends]).any(axis=(1, 2))
    return curved
