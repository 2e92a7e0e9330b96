"""Facets of curved surfaces in a mesh that no longer says what it was.

A mesh file knows triangles only. This is how the flat facets of cylinders, fillets and the like are told from faces
that were meant flat, so that chords of a hole's rim are not offered as straight edges.

Rules
-----
* An edge is *gentle* if the normal turns by less than `GENTLE_DEG` there.
* The *width* of a face is its area over the length of its longest gentle edge. Neighbours match a face if they are at
  least 1 / `WIDTH_RATIO` times as wide.
* A face is a *facet* of a curved surface if at least two gentle edges to matching neighbours turn the same way, and an
  arc through the face that turns by the mean of both turns would stand off from it by no more than `RELATIVE_SAGITTA`
  of the part's bounding box diagonal. So is a face across a gentle edge of a facet that the facet matches.
* Curved, and thus no candidate, are the gentle edges of facets, and the edges of facets that start at a gentle edge of
  theirs (the chords of a rim). An edge of a facet that meets no gentle one is a straight end of the surface and stays.

A prism that really has twelve or more sides is therefore taken for a cylinder; read it from STEP to keep its edges.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from aspectgraph.topology import Face, pair_edges, signed_dihedrals_deg
from aspectgraph.validation import face_area_vectors

GENTLE_DEG = 31.0
"""Largest turn between neighbouring facets of a curved surface: twelve facets to a full turn, and some rounding."""

RELATIVE_SAGITTA = 0.02
"""Largest distance of a facet from its arc, as a fraction of the bounding box diagonal."""

WIDTH_RATIO = 2.0
"""How much wider than its neighbour the last facet of a curved surface may be."""

_FLAT_DEG = 1e-3


def find_curved(vertices: np.ndarray, faces: list[Face]) -> tuple[list[Face], set[tuple[int, int]]]:
    """Mark the faces that are facets of curved surfaces and find their chords.

    Parameters
    ----------
    vertices : ndarray, shape (n, 3)
        In mm.
    faces : list of Face
        The faces of a closed surface, coplanar triangles joined.

    Returns
    -------
    faces : list of Face
        With ``curved`` set.
    curved_edges : set of (int, int)
        Vertex pairs, lower index first.
    """
    edge_vertices, edge_faces = pair_edges(vertices, faces)
    area_vectors = face_area_vectors(vertices, faces)
    normals = area_vectors / np.maximum(np.linalg.norm(area_vectors, axis=1, keepdims=True), 1e-300)
    turns = signed_dihedrals_deg(vertices, normals, edge_vertices, edge_faces)
    gentle = np.abs(turns) < GENTLE_DEG
    widths = _widths(vertices, faces, area_vectors, edge_vertices, edge_faces, gentle)
    sagitta_mm = RELATIVE_SAGITTA * float(np.linalg.norm(np.ptp(vertices, axis=0)))
    facet = _first_facets(len(faces), edge_faces, turns, gentle, widths, sagitta_mm)
    facet = _with_ends(facet, edge_faces[gentle], widths)
    curved = _chords(facet, edge_vertices, edge_faces, gentle)
    pairs = {(min(a, b), max(a, b)) for a, b in edge_vertices[curved].tolist()}
    return [replace(face, curved=bool(facet[f])) for f, face in enumerate(faces)], pairs


def _widths(vertices, faces, area_vectors, edge_vertices, edge_faces, gentle) -> np.ndarray:
    """Return the width of every face across its gentle edges: area over the length of the longest of them."""
    lengths = np.linalg.norm(vertices[edge_vertices[:, 1]] - vertices[edge_vertices[:, 0]], axis=1)
    longest = np.zeros(len(faces))
    for side in (0, 1):
        np.maximum.at(longest, edge_faces[gentle, side], lengths[gentle])
    areas = np.linalg.norm(area_vectors, axis=1)
    return np.divide(areas, longest, out=np.full(len(faces), np.inf), where=longest > 0)


def _first_facets(n_faces: int, edge_faces, turns, gentle, widths, sagitta_mm: float) -> np.ndarray:
    bends: list[list[float]] = [[] for _ in range(n_faces)]
    for (f, g), turn in zip(edge_faces[gentle].tolist(), turns[gentle].tolist(), strict=True):
        for face, neighbour in ((f, g), (g, f)):
            if abs(turn) > _FLAT_DEG and widths[face] <= WIDTH_RATIO * widths[neighbour]:
                bends[face].append(turn)
    facet = np.zeros(n_faces, dtype=bool)
    for f, around in enumerate(bends):
        for way in (1.0, -1.0):
            same = sorted((turn * way for turn in around if turn * way > 0), reverse=True)
            if len(same) >= 2:
                # Chord of width w that turns by the angle t: the arc stands off by w / 2 tan(t / 4).
                stand_off = 0.5 * widths[f] * np.tan(np.radians(0.5 * (same[0] + same[1])) / 4.0)
                facet[f] |= bool(stand_off <= sagitta_mm)
    return facet


def _with_ends(facet: np.ndarray, gentle_pairs: np.ndarray, widths: np.ndarray) -> np.ndarray:
    """Add the faces across gentle edges of facets that are about as narrow."""
    ends = facet.copy()
    for f, g in np.concatenate([gentle_pairs, gentle_pairs[:, ::-1]]).tolist():
        if facet[f] and widths[g] <= WIDTH_RATIO * widths[f]:
            ends[g] = True
    return ends


def _chords(facet: np.ndarray, edge_vertices: np.ndarray, edge_faces: np.ndarray, gentle: np.ndarray) -> np.ndarray:
    of_facet = facet[edge_faces]
    curved = gentle & of_facet.any(axis=1)
    rims: set[tuple[int, int]] = set()
    for (a, b), pair, mask in zip(edge_vertices[curved].tolist(), edge_faces[curved], of_facet[curved], strict=True):
        rims.update((v, int(f)) for f in pair[mask] for v in (a, b))
    for e in np.flatnonzero(of_facet.any(axis=1) & ~gentle).tolist():
        sides = [int(f) for f in edge_faces[e] if facet[f]]
        curved[e] = any((int(v), f) in rims for v in edge_vertices[e] for f in sides)
    return curved
