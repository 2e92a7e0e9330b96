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

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from aspectgraph.solid.checks import face_area_vectors
from aspectgraph.solid.topology import Face, pair_edges, signed_dihedrals_deg

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
    areas = np.linalg.norm(area_vectors, axis=1)
    normals = area_vectors / np.maximum(areas[:, None], 1e-300)
    turns = signed_dihedrals_deg(vertices, normals, edge_vertices, edge_faces)
    gentle = np.abs(turns) < GENTLE_DEG
    strip = _pair_triangles(faces, edge_faces[gentle], np.abs(turns[gentle]))
    edge_strips = strip[edge_faces]
    inner = edge_strips[:, 0] == edge_strips[:, 1]
    bend = gentle & ~inner & (np.abs(turns) > _FLAT_DEG)
    lengths = np.linalg.norm(vertices[edge_vertices[:, 1]] - vertices[edge_vertices[:, 0]], axis=1)
    widths = _widths(
        np.bincount(strip, weights=areas), edge_strips[gentle & ~inner], lengths[gentle & ~inner]
    )
    sagitta_mm = RELATIVE_SAGITTA * float(np.linalg.norm(np.ptp(vertices, axis=0)))
    bends = _bends(len(widths), edge_strips[bend], turns[bend], widths)
    facet = np.array(
        [_is_facet(around, width, sagitta_mm) for around, width in zip(bends, widths, strict=True)]
    )
    facet |= np.array(
        [any(facet[b.across] and b.matches and not b.tangent for b in around) for around in bends]
    )
    smooth = gentle & ~_sharp(turns, edge_strips, facet, bends)
    curved = _chords(facet, edge_vertices, edge_strips, smooth, inner)
    pairs = {(min(a, b), max(a, b)) for a, b in edge_vertices[curved].tolist()}
    return [replace(face, curved=bool(facet[strip[f]])) for f, face in enumerate(faces)], pairs


def _pair_triangles(faces: list[Face], edge_faces: np.ndarray, turns: np.ndarray) -> np.ndarray:
    """Number the strips: a strip is a face, or two triangles that are nearly flat across the flattest edge of both."""
    flattest: dict[int, tuple[float, int]] = {}
    steepest = np.zeros(len(faces))
    for (f, g), turn in zip(edge_faces.tolist(), turns.tolist(), strict=True):
        for face, across in ((f, g), (g, f)):
            steepest[face] = max(steepest[face], turn)
            if len(faces[face].outer) == 3:
                flattest[face] = min(flattest.get(face, (np.inf, -1)), (turn, across))
    strip = np.arange(len(faces))
    for f, (turn, g) in flattest.items():
        if (
            g < f
            and g in flattest
            and flattest[g][1] == f
            and turn <= FLAT_SHARE * min(steepest[f], steepest[g])
        ):
            strip[f] = g
    return np.unique(strip, return_inverse=True)[1].ravel()


def _widths(areas: np.ndarray, edge_strips: np.ndarray, lengths: np.ndarray) -> np.ndarray:
    """Return the width of every strip across its gentle edges: area over the length of the longest of them."""
    longest = np.zeros(len(areas))
    for side in (0, 1):
        np.maximum.at(longest, edge_strips[:, side], lengths)
    return np.divide(areas, longest, out=np.full(len(areas), np.inf), where=longest > 0)


class _Bend(NamedTuple):
    """A gentle edge as one of its faces sees it."""

    turn: float
    across: int
    matches: bool
    tangent: bool


def _bends(
    n_strips: int, edge_strips: np.ndarray, turns: np.ndarray, widths: np.ndarray
) -> list[list[_Bend]]:
    """Return the gentle edges of every strip that are not flat."""
    around: list[list[float]] = [[] for _ in range(n_strips)]
    pairs = [(f, g, t) for (f, g), t in zip(edge_strips.tolist(), turns.tolist(), strict=True)]
    for f, g, turn in pairs:
        around[f].append(turn)
        around[g].append(turn)
    bends: list[list[_Bend]] = [[] for _ in range(n_strips)]
    for f, g, turn in pairs:
        for strip, across in ((f, g), (g, f)):
            tangent = abs(turn) < TANGENT_SHARE * _largest_other(around[across], turn)
            bends[strip].append(
                _Bend(turn, across, bool(widths[strip] <= WIDTH_RATIO * widths[across]), tangent)
            )
    return bends


def _largest_other(turns: list[float], turn: float) -> float:
    """Return the largest of `turns` the same way as `turn`, leaving that one out once; 0 if there is none."""
    others = sorted(abs(t) for t in turns if t * turn > 0)
    others.remove(abs(turn))
    return others[-1] if others else 0.0


def _is_facet(bends: list[_Bend], width: float, sagitta_mm: float) -> bool:
    for way in (1.0, -1.0):
        same = sorted(
            (b for b in bends if b.matches and b.turn * way > 0), key=lambda b: -abs(b.turn)
        )
        if len(same) >= 2 and not all(bend.tangent for bend in same):
            # A chord of width w under an arc that turns by t: the arc stands off by w / 2 tan(t / 4).
            turn = 0.5 * (abs(same[0].turn) + abs(same[1].turn))
            if 0.5 * width * np.tan(np.radians(turn) / 4.0) <= sagitta_mm:
                return True
    return False


def _sharp(
    turns: np.ndarray, edge_strips: np.ndarray, facet: np.ndarray, bends: list[list[_Bend]]
) -> np.ndarray:
    """Return the edges where a curved surface ends at a plane by turning much more than it does inside."""
    sharp = np.zeros(len(turns), dtype=bool)
    for e in np.flatnonzero(facet[edge_strips[:, 0]] != facet[edge_strips[:, 1]]).tolist():
        f, g = edge_strips[e].tolist()
        inside = [abs(b.turn) for b in bends[f if facet[f] else g] if facet[b.across]]
        sharp[e] = bool(inside) and abs(turns[e]) > SHARP_SHARE * max(inside)
    return sharp


def _chords(
    facet: np.ndarray,
    edge_vertices: np.ndarray,
    edge_strips: np.ndarray,
    smooth: np.ndarray,
    inner: np.ndarray,
) -> np.ndarray:
    of_facet = facet[edge_strips]
    curved = smooth & of_facet.any(axis=1)
    rims: set[tuple[int, int]] = set()
    around = curved & ~inner
    for (a, b), pair, mask in zip(
        edge_vertices[around].tolist(), edge_strips[around], of_facet[around], strict=True
    ):
        rims.update((v, int(f)) for f in pair[mask] for v in (a, b))
    for e in np.flatnonzero(of_facet.any(axis=1) & ~smooth).tolist():
        sides = [int(f) for f in edge_strips[e] if facet[f]]
        curved[e] = any((int(v), f) in rims for v in edge_vertices[e] for f in sides)
    return curved
