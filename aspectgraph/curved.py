"""Facets of curved surfaces in a mesh that no longer says what it was.

A mesh file knows triangles only. This is how the flat facets of cylinders, fillets and the like are told from faces
that were meant flat, so that chords of a hole's rim are not offered as straight edges.

Rules
-----
* An edge is *gentle* if the normal turns by less than `GENTLE_DEG` there.
* The *width* of a face is its area over the length of its longest gentle edge. A face matches a neighbour if it is no
  wider than `WIDTH_RATIO` times that.
* Where a plane runs into an arc, it turns by half of what neighbouring facets of the arc do. A gentle edge is *tangent*
  for a face if it turns by less than `TANGENT_SHARE` of what the face across turns, the same way, at another edge.
* A face is a *facet* of a curved surface if it has two or more gentle edges to matching neighbours that turn the same
  way, not all of them tangent, and an arc through the face that turns by the mean of the two largest turns would stand
  off from it by no more than `RELATIVE_SAGITTA` of the part's bounding box diagonal.
* So is a face that matches a facet across a gentle edge that is not tangent for it.
* Curved, and thus no candidate, are the gentle edges of facets, and the edges of facets that start at a gentle edge of
  theirs (the chords of a rim). An edge of a facet that meets no gentle one is a straight end of the surface and stays.

A prism that really has twelve or more sides is therefore taken for a cylinder; read it from STEP to keep its edges.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from aspectgraph.topology import Face, pair_edges, signed_dihedrals_deg
from aspectgraph.validation import face_area_vectors

GENTLE_DEG = 31.0
"""Largest turn between neighbouring facets of a curved surface: twelve facets to a full turn, and some rounding."""

RELATIVE_SAGITTA = 0.0125
"""Largest distance of a facet from its arc, as a fraction of the bounding box diagonal: 0.012 for a whole cylinder of
twelve facets."""

WIDTH_RATIO = 4.0
"""How much wider than its neighbour a facet of a curved surface may be."""

TANGENT_SHARE = 0.75
"""Between the half of a tangent plane and the whole of an even arc, nearer to the whole: arcs are seldom uneven."""

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
    bends = _bends(len(faces), edge_faces[gentle], turns[gentle], widths)
    facet = np.array([_is_facet(around, width, sagitta_mm) for around, width in zip(bends, widths, strict=True)])
    facet |= np.array([any(facet[b.across] and b.matches and not b.tangent for b in around) for around in bends])
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


class _Bend(NamedTuple):
    """A gentle edge as one of its faces sees it."""

    turn: float
    across: int
    matches: bool
    tangent: bool


def _bends(n_faces: int, edge_faces: np.ndarray, turns: np.ndarray, widths: np.ndarray) -> list[list[_Bend]]:
    """Return the gentle edges of every face that are not flat."""
    around: list[list[float]] = [[] for _ in range(n_faces)]
    pairs = [(f, g, t) for (f, g), t in zip(edge_faces.tolist(), turns.tolist(), strict=True) if abs(t) > _FLAT_DEG]
    for f, g, turn in pairs:
        around[f].append(turn)
        around[g].append(turn)
    bends: list[list[_Bend]] = [[] for _ in range(n_faces)]
    for f, g, turn in pairs:
        for face, across in ((f, g), (g, f)):
            tangent = abs(turn) < TANGENT_SHARE * _largest_other(around[across], turn)
            bends[face].append(_Bend(turn, across, bool(widths[face] <= WIDTH_RATIO * widths[across]), tangent))
    return bends


def _largest_other(turns: list[float], turn: float) -> float:
    """Return the largest of `turns` the same way as `turn`, leaving that one out once; 0 if there is none."""
    others = sorted(abs(t) for t in turns if t * turn > 0)
    others.remove(abs(turn))
    return others[-1] if others else 0.0


def _is_facet(bends: list[_Bend], width: float, sagitta_mm: float) -> bool:
    for way in (1.0, -1.0):
        same = sorted((b for b in bends if b.matches and b.turn * way > 0), key=lambda b: -abs(b.turn))
        if len(same) >= 2 and not all(bend.tangent for bend in same):
            # A chord of width w under an arc that turns by t: the arc stands off by w / 2 tan(t / 4).
            turn = 0.5 * (abs(same[0].turn) + abs(same[1].turn))
            if 0.5 * width * np.tan(np.radians(turn) / 4.0) <= sagitta_mm:
                return True
    return False


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
