"""Triangle meshes: welded, cleaned, turned outwards and joined into faces. Every repair is noted, nothing is guessed.

What is done, in this order
---------------------------
1. Coordinates are converted to mm; polygons are cut into triangles; equal vertices become one.
2. Facets that use a vertex twice, and repetitions of a facet, are dropped.
3. If the surface is not closed then: facets without area are dropped; then vertices closer than ``weld_mm`` become one.
   A step is kept only if the surface is closed after it. A T-junction or a missing facet stays an error.
4. Facets that disagree with their neighbours are reversed, then bodies that are inside out.
5. Facets without area that are left are taken out by turning their longest sides, where no vertex need move.
6. Coplanar facets become faces, and facets of curved surfaces are recognised (see `curved_facets`).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from aspectgraph.exceptions import OrientationError, ReadError
from aspectgraph.phases import phase
from aspectgraph.read.coplanar import find_twins
from aspectgraph.read.glb import parse_glb
from aspectgraph.read.join_faces import assemble
from aspectgraph.read.limits import ReadLimits, more_of
from aspectgraph.read.obj_off import parse_obj, parse_off
from aspectgraph.read.ply import parse_ply
from aspectgraph.read.repair import drop_repetitions, drop_thin, is_closed, turn_thin, weld
from aspectgraph.read.stl import parse_stl
from aspectgraph.read.tessellation import Tessellation
from aspectgraph.solid.checks import check_vertices, default_planarity_mm, face_area_vectors
from aspectgraph.solid.face_loops import FaceLoops
from aspectgraph.solid.shells import face_outwards
from aspectgraph.solid.solid import Solid
from aspectgraph.solid.topology import describe_edge, label_shells, pair_edges
from aspectgraph.solid.triangulate import triangulate_faces

UNITS_MM = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "um": 1e-3, "inch": 25.4, "ft": 304.8}
"""Millimetres in one of each unit."""

_RELATIVE_WIDTH = 1e-3
"""Facets narrower than this share of the planarity tolerance have no area."""


def read_mesh(
    data: bytes,
    suffix: str,
    *,
    units: str | None = None,
    planarity_mm: float | None = None,
    name: str = "",
    limits: ReadLimits | None = None,
) -> Solid:
    """Return the solid bounded by the triangles of a mesh file.

    Parameters
    ----------
    data : bytes
        The file, unpacked.
    suffix : {".stl", ".obj", ".ply", ".off", ".glb"}
        Its format.
    units : str, optional
        A key of `UNITS_MM`; default "m" for .glb, "mm" otherwise.
    planarity_mm : float, optional
        See `assemble`; also the ``weld_mm`` of the module's description. Default: 10⁻⁶ of the bounding box diagonal.
    name : str
        Name of the part.
    limits : ReadLimits, optional
        Most triangles to make of the file.

    Raises
    ------
    ReadError
        The file is damaged or exceeds a limit, a coordinate is not finite, or `units` is unknown.
    SolidError
        The surface is open, not manifold, or crosses or touches itself.
    """
    notes: list[str] = []
    scale = _scale(units, suffix)
    most = (limits or ReadLimits()).triangles
    # a signalling NaN warns when it is widened; numbers that are not finite are refused below
    with phase("read the facets"), np.errstate(all="ignore"):
        vertices, polygons = _parse(data, suffix, notes, most)
    bad = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
    if len(bad):
        raise ReadError(
            f"coordinates must be finite. Got {vertices[bad[0]].tolist()} at vertex {bad[0]} of the file."
        )
    with np.errstate(over="ignore"):
        vertices = check_vertices(vertices * scale)
    with phase("repair the facets"):
        mesh, tolerance = repair_facets(vertices, polygons, planarity_mm, notes)
    return assemble(mesh, name=name, planarity_mm=tolerance, notes=notes)


def repair_facets(
    vertices: np.ndarray, polygons: Any, planarity_mm: float | None, notes: list[str]
) -> tuple[Tessellation, float]:
    """Do steps 1 to 5 of the module's description.

    Parameters
    ----------
    vertices : ndarray, shape (n, 3)
        In mm.
    polygons : ndarray of int, shape (t, 3), or list of list of int
        Triangles, or polygons of any size.
    planarity_mm : float, optional
        See `read_mesh`.
    notes : list of str
        Extended by what was repaired.

    Returns
    -------
    facets : Tessellation
        One patch of facets, closed, oriented outwards.
    tolerance_mm : float
        The planarity tolerance, or its default.

    Raises
    ------
    ReadError
        There are fewer than four facets.
    SolidError
        The surface is open, not manifold, or has one side only.
    """
    vertices, triangles = _welded_triangles(vertices, polygons, notes)
    if len(triangles) < 4:
        raise ReadError(f"a closed mesh must have at least 4 facets. Got {len(triangles)}.")
    tolerance = default_planarity_mm(vertices) if planarity_mm is None else planarity_mm
    vertices, triangles = _close(vertices, triangles, tolerance, notes)
    triangles = turn_thin(
        vertices, _orient(vertices, triangles, notes), tolerance * _RELATIVE_WIDTH, notes
    )
    patch = np.zeros(len(triangles), dtype=np.int64)
    flat = np.zeros(1, dtype=bool)
    return Tessellation(vertices, triangles, patch, flat, faceted_patches={0}), tolerance


def _parse(
    data: bytes, suffix: str, notes: list[str], most_triangles: int
) -> tuple[np.ndarray, np.ndarray | list[list[int]]]:
    """Return vertices and polygons as the format has them."""
    if suffix == ".glb":
        return parse_glb(data, notes, most_triangles)
    polygons: np.ndarray | list[list[int]]
    if suffix == ".stl":
        vertices, polygons = parse_stl(data, notes)
    elif suffix == ".obj":
        vertices, polygons = parse_obj(data, notes)
    else:
        vertices, polygons = (parse_ply if suffix == ".ply" else parse_off)(data)
    n = (
        len(polygons)
        if isinstance(polygons, np.ndarray)
        else sum(len(polygon) - 2 for polygon in polygons)
    )
    if n > most_triangles:
        raise ReadError.of_rule(
            "",
            f"a mesh file must hold at most triangles={most_triangles} triangles",
            str(n),
            **more_of("triangles"),
        )
    return vertices, polygons


def check_units(units: str) -> None:
    """Refuse a unit that is not known.

    Parameters
    ----------
    units : str
        Must be a key of `UNITS_MM`.

    Raises
    ------
    ReadError
        If it is not.
    """
    if units not in UNITS_MM:
        raise ReadError.of_rule("units", f"must be one of {', '.join(UNITS_MM)}", repr(units))


def _scale(units: str | None, suffix: str) -> float:
    units = units or ("m" if suffix == ".glb" else "mm")
    check_units(units)
    return UNITS_MM[units]


def _welded_triangles(
    vertices: np.ndarray, polygons: Any, notes: list[str]
) -> tuple[np.ndarray, np.ndarray]:
    """Merge equal vertices and cut polygons into triangles."""
    vertices, new = weld(vertices)
    if isinstance(polygons, np.ndarray):
        return vertices, drop_repetitions(new[polygons], notes)
    loops = [_without_repetitions([int(new[v]) for v in polygon]) for polygon in polygons]
    # what has no area stays as a triangle without one
    triangles = [np.repeat(new[polygon[0]], 3)[None] for polygon in polygons]
    whole = [f for f, loop in enumerate(loops) if len(loop) >= 3]
    for f, cut in zip(whole, _cut_polygons(vertices, loops, whole), strict=True):
        triangles[f] = cut
    return vertices, drop_repetitions(np.concatenate(triangles).astype(np.int64), notes)


def _without_repetitions(loop: list[int]) -> list[int]:
    """Return a loop without vertices that follow themselves."""
    return [v for v, before in zip(loop, [loop[-1], *loop[:-1]], strict=True) if v != before]


def _cut_polygons(
    vertices: np.ndarray, polygons: list[list[int]], whole: list[int]
) -> tuple[np.ndarray, ...]:
    """Return the triangles of these polygons, by their numbers in the file."""
    if not whole:
        return ()
    loops = FaceLoops.of_cycles([[polygons[f]] for f in whole])
    normals = face_area_vectors(vertices, loops)
    for f, normal in zip(whole, normals, strict=True):
        loop = polygons[f]
        if len(loop) > 3 and (len(set(loop)) < len(loop) or not normal.any()):
            raise ReadError(
                f"a polygon must be simple and have an area. Got polygon {f} of the file."
            )
    return triangulate_faces(
        vertices, loops, normals, lambda face: f"polygon {whole[face]} of the file"
    )


def _close(
    vertices: np.ndarray, triangles: np.ndarray, weld_mm: float, notes: list[str]
) -> tuple[np.ndarray, np.ndarray]:
    """Try the repairs of step 3; return the mesh unchanged if none of them closes it."""
    if is_closed(triangles):
        return vertices, triangles
    attempt_notes: list[str] = []
    attempt = drop_thin(vertices, triangles, weld_mm * _RELATIVE_WIDTH, attempt_notes)
    if is_closed(attempt):
        notes.extend(attempt_notes)
        return vertices, attempt
    merged, new = weld(vertices, weld_mm)
    if len(merged) < len(vertices):
        attempt_notes = [
            f"merged {len(vertices) - len(merged)} vertices closer than {weld_mm:.3g} mm to another"
        ]
        attempt = drop_repetitions(new[triangles], attempt_notes)
        if not is_closed(attempt):
            attempt = drop_thin(merged, attempt, weld_mm * _RELATIVE_WIDTH, attempt_notes)
        if is_closed(attempt):
            notes.extend(attempt_notes)
            return merged, attempt
    _complain(vertices, triangles)
    return vertices, triangles


def _complain(vertices: np.ndarray, triangles: np.ndarray) -> None:
    """Raise what is wrong with a surface that is not closed, with the place."""
    pair_edges(vertices, FaceLoops.of_triangles(triangles))


def _orient(vertices: np.ndarray, triangles: np.ndarray, notes: list[str]) -> np.ndarray:
    triangles, n_reversed = _agree(vertices, triangles)
    if n_reversed:
        notes.append(f"reversed {n_reversed} facets that disagreed with their neighbours")
    twin = find_twins(triangles)
    pairs = np.stack([np.arange(len(twin)) // 3, twin // 3], axis=1)
    triangles, n_turned = face_outwards(vertices, triangles, label_shells(len(triangles), pairs))
    if n_turned:
        notes.append(f"turned {n_turned} bodies that were inside out")
    return triangles


def _agree(vertices: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, int]:
    """Reverse facets until neighbours agree; in every piece the larger party stays."""
    neighbours, agrees = _neighbours(triangles)
    if agrees.all():
        return triangles, 0
    party = np.full(len(triangles), -1, dtype=np.int64)
    turn = np.zeros(len(triangles), dtype=bool)
    for seed in range(len(triangles)):
        if party[seed] >= 0:
            continue
        party[seed] = 0
        front = [seed]
        piece = [seed]
        while front:
            t = front.pop()
            for k in range(3):
                n = neighbours[t, k]
                side = party[t] ^ (not agrees[t, k])
                if party[n] < 0:
                    party[n] = side
                    front.append(n)
                    piece.append(n)
                elif party[n] != side:
                    text = describe_edge(vertices, *np.roll(triangles[t], -k)[:2].tolist())
                    raise OrientationError(
                        f"a surface must have two sides. Got one side only at the {text}."
                    )
        minority = 1 if 2 * party[piece].sum() <= len(piece) else 0
        turn[piece] = party[piece] == minority
    return np.where(turn[:, None], triangles[:, ::-1], triangles), int(turn.sum())


def _neighbours(triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return for every half-edge of a closed surface the triangle across, and whether it runs the other way there."""
    start = triangles.ravel()
    end = np.roll(triangles, -1, axis=1).ravel()
    key = np.minimum(start, end) * (int(triangles.max()) + 1) + np.maximum(start, end)
    order = np.argsort(key, kind="stable").reshape(-1, 2)
    across = np.empty(len(key), dtype=np.int64)
    across[order[:, 0]] = order[:, 1]
    across[order[:, 1]] = order[:, 0]
    return (across // 3).reshape(-1, 3), (start == end[across]).reshape(-1, 3)
