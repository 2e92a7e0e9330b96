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

import heapq
from collections.abc import Iterable
from typing import Any

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from aspectgraph.exceptions import OrientationError, ReadError
from aspectgraph.phases import phase
from aspectgraph.read.glb import parse_glb
from aspectgraph.read.join_faces import Tessellation, assemble, find_twins
from aspectgraph.read.limits import ReadLimits, more_of
from aspectgraph.read.mesh_formats import parse_obj, parse_off, parse_ply, parse_stl
from aspectgraph.solid.checks import (
    check_vertices,
    default_planarity_mm,
    face_area_vectors,
    face_outwards,
)
from aspectgraph.solid.solid import Solid
from aspectgraph.solid.topology import (
    FaceLoops,
    describe_edge,
    label_shells,
    pair_edges,
    triangulate_faces,
)

# Facets without area taken out of a closed surface, without moving a vertex.
#
# A facet whose corners lie on one line has its middle corner on its longest side. The facet on
# the other side of that side passes the corner by. Turning the side (an edge flip) makes it end
# at the corner, and the facet without area is gone; the surface is the same. Longest facets go
# first: where two without area are neighbours, the side turned is then the longest of both, and
# it becomes shorter.


_MOST_TURNS = 50
"""Turns tried for every facet without area, before what is left is left as it is."""


def turn_thin(
    vertices: np.ndarray, triangles: np.ndarray, width_mm: float, notes: list[str]
) -> np.ndarray:
    """Take out the facets no wider than `width_mm` by turning their longest sides; note how many.

    Parameters
    ----------
    vertices : ndarray, shape (n, 3)
        In mm.
    triangles : ndarray of int, shape (t, 3)
        Closed and oriented.
    width_mm : float
        Facets no wider have no area; the surface moves by no more than this.
    notes : list of str
        Gets a line if anything was done.

    Returns
    -------
    ndarray of int, shape (t', 3)
        Closed and oriented, with the same vertices in use. A facet whose middle corner is as close as `width_mm` to
        another one stays, and so does one whose turn would join two vertices a second time.
    """
    n_thin = _count_thin(vertices, triangles, width_mm)
    if not n_thin:
        return triangles
    surface = _Turner(vertices, triangles, width_mm)
    for _ in range(_MOST_TURNS * n_thin):
        if not surface.turn_next():
            break
    rows = surface.rows()
    n_gone = n_thin - _count_thin(vertices, rows, width_mm)
    if n_gone:
        notes.append(f"took out {n_gone} facets without area by turning their longest sides")
    return rows


def _count_thin(vertices: np.ndarray, triangles: np.ndarray, width_mm: float) -> int:
    return int((_widths(vertices, triangles)[0] <= width_mm).sum())


def _widths(vertices: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the heights of triangles over their longest sides, and these, in mm."""
    corners = vertices[triangles]
    doubled_area = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    longest = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).max(axis=1)
    return np.divide(doubled_area, longest, out=np.zeros_like(longest), where=longest > 0), longest


class _Turner:
    """State of `turn_thin`: the triangles, their directed sides, and the thin ones in order."""

    def __init__(self, vertices: np.ndarray, triangles: np.ndarray, width_mm: float) -> None:
        self.vertices = vertices
        self.width_mm = width_mm
        self.triangles: list[tuple[int, int, int]] = [tuple(row) for row in triangles.tolist()]
        self.side = {pair: t for t, row in enumerate(self.triangles) for pair in _sides(row)}
        self.queue: list[tuple[float, int, tuple[int, int, int]]] = []
        self._note_thin(range(len(self.triangles)))

    def rows(self) -> np.ndarray:
        """Return the triangles as an array."""
        return np.array(self.triangles, dtype=np.int64).reshape(-1, 3)

    def turn_next(self) -> bool:
        """Turn the longest side of the next thin triangle, if it may be; return whether there was one."""
        if not self.queue:
            return False
        _, t, row = heapq.heappop(self.queue)
        if self.triangles[t] != row:
            return True
        p, q, apex = self._longest_side(row)
        across = self.side[q, p]
        far = next(v for v in self.triangles[across] if v not in (p, q))
        joined = far == apex or (far, apex) in self.side or (apex, far) in self.side
        if joined or not self._between(p, q, apex):
            return True
        for pair in (*_sides(row), *_sides(self.triangles[across])):
            del self.side[pair]
        for k, new in ((t, (p, far, apex)), (across, (far, q, apex))):
            self.triangles[k] = new
            self.side.update(dict.fromkeys(_sides(new), k))
        self._note_thin((t, across))
        return True

    def _note_thin(self, which: Iterable[int]) -> None:
        index = np.array(list(which), dtype=np.int64)
        width, length = _widths(
            self.vertices, np.array([self.triangles[t] for t in index.tolist()])
        )
        for t, size in zip(
            index[width <= self.width_mm].tolist(), length[width <= self.width_mm], strict=True
        ):
            heapq.heappush(self.queue, (-float(size), t, self.triangles[t]))

    def _longest_side(self, row: tuple[int, int, int]) -> tuple[int, int, int]:
        sizes = [float(np.linalg.norm(self.vertices[b] - self.vertices[a])) for a, b in _sides(row)]
        k = int(np.argmax(sizes))
        return row[k], row[(k + 1) % 3], row[(k + 2) % 3]

    def _between(self, p: int, q: int, apex: int) -> bool:
        """Return whether a vertex lies between two others, and not at one of them."""
        start, end, middle = self.vertices[[p, q, apex]]
        return bool(
            min(np.linalg.norm(middle - start), np.linalg.norm(middle - end)) > self.width_mm
        )


def _sides(row: tuple[int, int, int]) -> tuple[tuple[int, int], ...]:
    a, b, c = row
    return (a, b), (b, c), (c, a)


# Vertices made one, and facets that say nothing dropped.


def weld(vertices: np.ndarray, distance_mm: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Merge vertices that are equal or, if a distance is given, linked by steps no longer than it.

    Returns
    -------
    vertices : ndarray, shape (m, 3)
        In order of first appearance; of merged ones the first stays where it is.
    new : ndarray of int, shape (n,)
        The new index of every old vertex.
    """
    if distance_mm > 0:
        pairs = cKDTree(vertices).query_pairs(distance_mm, output_type="ndarray")
        n = len(vertices)
        links = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
        label = connected_components(links, directed=False)[1]
    else:
        label = _label_rows(vertices)
    _, first = np.unique(label, return_index=True)
    order = np.argsort(first)
    rank = np.empty(len(first), dtype=np.int64)
    rank[order] = np.arange(len(first))
    return vertices[first[order]], rank[label]


def _label_rows(rows: np.ndarray) -> np.ndarray:
    """Number the rows of an array, equal ones alike."""
    order = np.lexsort(rows.T)
    ordered = rows[order]
    label = np.zeros(len(rows), dtype=np.int64)
    label[order[1:]] = np.cumsum((ordered[1:] != ordered[:-1]).any(axis=1))
    return label


def is_closed(triangles: np.ndarray) -> bool:
    """Return whether every edge, whichever way it runs, has exactly two triangles."""
    if not len(triangles):
        return False
    start = triangles.ravel()
    end = np.roll(triangles, -1, axis=1).ravel()
    key = np.minimum(start, end) * (int(triangles.max()) + 1) + np.maximum(start, end)
    return bool((np.unique(key, return_counts=True)[1] == 2).all())


def drop_repetitions(triangles: np.ndarray, notes: list[str]) -> np.ndarray:
    """Drop triangles that use a vertex twice, and all but the first of equal ones; note how many."""
    whole = (triangles != np.roll(triangles, 1, axis=1)).all(axis=1)
    if not whole.all():
        notes.append(f"dropped {int((~whole).sum())} facets that use a vertex twice")
        triangles = triangles[whole]
    if not len(triangles):
        return triangles
    turn = np.argmin(triangles, axis=1)[:, None] + np.arange(3)
    canonical = np.take_along_axis(triangles, turn % 3, axis=1)
    first = np.unique(_label_rows(canonical), return_index=True)[1]
    first.sort()
    if len(first) < len(triangles):
        notes.append(f"dropped {len(triangles) - len(first)} repeated facets")
    return triangles[first]


def drop_thin(
    vertices: np.ndarray, triangles: np.ndarray, width_mm: float, notes: list[str]
) -> np.ndarray:
    """Drop triangles no wider than `width_mm`; note how many."""
    corners = vertices[triangles]
    doubled_area = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    longest = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).max(axis=1)
    thin = doubled_area <= width_mm * longest
    if thin.any():
        notes.append(f"dropped {int(thin.sum())} facets without area")
    return triangles[~thin]


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
    max_triangles = (limits or ReadLimits()).triangles
    # a signalling NaN warns when it is widened; numbers that are not finite are refused below
    with phase("read the facets"), np.errstate(all="ignore"):
        vertices, polygons = _parse(data, suffix, notes, max_triangles)
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
