"""Checks on coordinates: finite, in range, with an area, planar, outward."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import chain

import numpy as np
import shapely
from numpy.typing import ArrayLike

from aspectgraph.exceptions import (
    OrientationError,
    PlanarityError,
    SelfIntersectionError,
    SolidError,
    TouchingError,
)
from aspectgraph.phases import report_phase
from aspectgraph.solid.topology import (
    Face,
    FaceLoops,
    FacetedSurface,
    describe_edge,
    describe_point,
    newell_area_vector,
    signed_volume,
)

RELATIVE_PLANARITY = 1e-6
"""Default planarity tolerance as a fraction of the bounding box diagonal."""

FARTHEST_MM = 1e60
"""Coordinates beyond are refused: products of several would overflow."""


def check_vertices(vertices: ArrayLike) -> np.ndarray:
    """Return `vertices` as a read-only float64 array of shape (n, 3).

    Raises
    ------
    SolidError
        The shape is wrong, a coordinate is not finite, or products of coordinates would overflow.
    """
    points = np.array(vertices, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3 or len(points) < 4:
        raise SolidError(f"vertices must have shape (n, 3) with n >= 4. Got shape {points.shape}.")
    bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if len(bad):
        raise SolidError(
            f"vertices must be finite. Got {points[bad[0]].tolist()} at vertex {bad[0]}."
        )
    if np.abs(points).max() > FARTHEST_MM:
        raise SolidError(f"coordinates must be below 1e60 mm. Got {np.abs(points).max():.3g}.")
    points.flags.writeable = False
    return points


def check_indices(vertices: np.ndarray, loops: FaceLoops) -> None:
    """Check that loops have three or more distinct, existing vertices at distinct places.

    Raises
    ------
    SolidError
        An index is out of range, a loop is short or visits a vertex twice, or two vertices coincide.
    """
    n_faces = int(loops.loop_face[-1]) + 1 if len(loops.loop_face) else 0
    if n_faces < 4:
        raise SolidError(f"a solid must have at least 4 faces. Got {n_faces}.")
    bad = np.flatnonzero((loops.size < 3) | _visits_twice(loops) | _leaves(loops, len(vertices)))
    if len(bad):
        first = loops.first[bad[0]]
        loop = tuple(loops.start[first : first + loops.size[bad[0]]].tolist())
        fault = f"Got {loop} in face {loops.loop_face[bad[0]]}"
        if len(loop) < 3 or len(set(loop)) != len(loop):
            raise SolidError(f"a loop must have at least 3 vertices, all distinct. {fault}.")
        raise SolidError(f"vertex indices must be in 0..{len(vertices) - 1}. {fault}.")
    used = np.unique(loops.start)
    _check_places(vertices, used)


def _visits_twice(loops: FaceLoops) -> np.ndarray:
    """Return which loops visit a vertex twice, shape (l,)."""
    twice = np.zeros(len(loops.size), dtype=bool)
    for which, half_edges in loops.by_size():
        visits = np.sort(loops.start[half_edges], axis=1)
        twice[which] = (visits[:, 1:] == visits[:, :-1]).any(axis=1)
    return twice


def _leaves(loops: FaceLoops, n: int) -> np.ndarray:
    """Return which loops name a vertex that is none of 0..n-1, shape (l,)."""
    outside = (loops.start < 0) | (loops.start >= n)
    loop = np.repeat(np.arange(len(loops.size)), loops.size)
    return np.bincount(loop, outside, minlength=len(loops.size)) > 0


def _check_places(vertices: np.ndarray, used: np.ndarray) -> None:
    """Check that vertices in use lie at distinct places."""
    points = vertices[used]
    order = np.lexsort(points.T[::-1])
    begin = np.flatnonzero((np.diff(points[order], axis=0, prepend=np.nan) != 0.0).any(axis=1))
    counts = np.diff(begin, append=len(order))
    if (counts > 1).any():
        place = describe_point(points[order[begin[counts > 1][0]]])
        raise SolidError(
            f"vertices in use must lie at distinct points. Got {counts.max()} at {place}."
        )


def default_planarity_mm(vertices: np.ndarray) -> float:
    """Return the default planarity tolerance in mm: 10⁻⁶ of the bounding box diagonal."""
    return RELATIVE_PLANARITY * float(np.linalg.norm(np.ptp(vertices, axis=0)))


def face_area_vectors(vertices: np.ndarray, faces: Sequence[Face] | FaceLoops) -> np.ndarray:
    """Return the area vector (outward normal times area, mm²) of every face, shape (f, 3)."""
    loops = FaceLoops.of(faces)
    of_loop = np.empty((len(loops.size), 3))
    for which, half_edges in loops.by_size():
        of_loop[which] = newell_area_vector(vertices[loops.start[half_edges]])
    of_face = np.zeros((int(loops.loop_face[-1]) + 1, 3))
    np.add.at(of_face, loops.loop_face, of_loop)
    return of_face


def check_areas(vertices: np.ndarray, loops: FaceLoops, area_vectors: np.ndarray) -> None:
    """Check that every face has an area, told apart from rounding.

    Raises
    ------
    SolidError
        The area is zero to within rounding of the coordinates.
    """
    areas = np.linalg.norm(area_vectors, axis=1)
    scale = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    sides = np.linalg.norm(vertices[loops.end] - vertices[loops.start], axis=1)
    longest = np.maximum.reduceat(sides, loops.first)[loops.outer]
    flat = np.flatnonzero(areas <= 1e-15 * scale * longest)
    if len(flat):
        place = describe_point(vertices[loops.start[loops.first[loops.outer[flat[0]]]]])
        raise SolidError(
            f"a face must have an area above zero. Got {areas[flat[0]]:.3g} mm² for face {flat[0]} at {place}."
        )


def check_planarity(
    vertices: np.ndarray, loops: FaceLoops, normals: np.ndarray, planarity_mm: float
) -> None:
    """Check that every face is planar.

    Raises
    ------
    PlanarityError
        A vertex is farther than `planarity_mm` from the plane of its face.
    """
    if not planarity_mm > 0:
        raise SolidError(f"planarity_mm must be positive. Got {planarity_mm}.")
    local = vertices - vertices.mean(axis=0)
    heights = np.einsum("ij,ij->i", local[loops.start], normals[loops.face])
    first = loops.first[loops.outer]
    spread = np.maximum.reduceat(heights, first) - np.minimum.reduceat(heights, first)
    uneven = np.flatnonzero((0.5 * spread > planarity_mm) & ~loops.is_triangle)
    if len(uneven):
        f = int(uneven[0])
        place = describe_point(vertices[loops.start[first[f]]])
        raise PlanarityError(
            f"a face must be planar within {planarity_mm:.3g} mm. "
            f"Got {0.5 * spread[f]:.3g} mm for face {f} at {place}."
        )


# Shells: which way they face, and which lies inside which.
#
# A shell with positive volume bounds material from outside, one with negative volume bounds a
# void. The winding number of a point with respect to a closed shell is a sum of solid angles (Van
# Oosterom and Strackee, IEEE Trans. Biomed. Eng. 30, 1983): 1 inside a shell with positive
# volume, -1 inside one with negative volume, and 0 outside.


def winding_number(point: np.ndarray, corners: np.ndarray) -> int:
    """Return how often closed triangles wind around a point that is not on them.

    Parameters
    ----------
    point : ndarray, shape (3,)
    corners : ndarray, shape (t, 3, 3)
        Triangle corners.
    """
    a, b, c = (corners - point).swapaxes(0, 1)
    la, lb, lc = (np.linalg.norm(x, axis=1) for x in (a, b, c))
    dot_ab, dot_bc, dot_ca = (np.einsum("ij,ij->i", x, y) for x, y in ((a, b), (b, c), (c, a)))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c))
    half_angles = np.arctan2(volume, la * lb * lc + dot_ab * lc + dot_bc * la + dot_ca * lb)
    return round(float(half_angles.sum()) / (2.0 * np.pi))


def shell_windings(vertices: np.ndarray, triangles: np.ndarray, shell: np.ndarray) -> np.ndarray:
    """Return the winding number of every shell around one vertex of every other.

    Parameters
    ----------
    vertices : ndarray, shape (n, 3)
    triangles : ndarray of int, shape (t, 3)
    shell : ndarray of int, shape (t,)
        The shell 0..s-1 of each triangle.

    Returns
    -------
    ndarray of int, shape (s, s)
        Entry (i, j): shell j around a vertex of shell i; 0 on the diagonal.
    """
    corners = [vertices[triangles[shell == s]] for s in range(int(shell.max()) + 1)]
    lows, highs = (
        [extreme(c.reshape(-1, 3), axis=0) for c in corners] for extreme in (np.min, np.max)
    )
    windings = np.zeros((len(corners), len(corners)), dtype=np.int64)
    for i, shell_corners in enumerate(corners):
        for j, other in enumerate(corners):
            if (
                i != j
                and (lows[j] <= shell_corners[0, 0]).all()
                and (shell_corners[0, 0] <= highs[j]).all()
            ):
                windings[i, j] = winding_number(shell_corners[0, 0], other)
    return windings


def shell_volumes(vertices: np.ndarray, triangles: np.ndarray, shell: np.ndarray) -> np.ndarray:
    """Return the signed volume of every shell in mm³, shape (s,)."""
    return np.array(
        [signed_volume(vertices, triangles[shell == s]) for s in range(int(shell.max()) + 1)]
    )


def check_shells(vertices: np.ndarray, triangles: np.ndarray, shell: np.ndarray) -> None:
    """Check that shells face outwards and that solids and voids alternate from outside in.

    Raises
    ------
    OrientationError
        A shell is inside out.
    SelfIntersectionError
        A solid lies inside the material of another.
    """
    volumes = shell_volumes(vertices, triangles, shell)
    around = shell_windings(vertices, triangles, shell).sum(axis=1)
    for s, (volume, depth) in enumerate(zip(volumes, around, strict=True)):
        place = describe_point(vertices[triangles[shell == s][0, 0]])
        if volume > 0 and depth > 0:
            raise SelfIntersectionError(
                f"solids must not overlap. Got one inside the material of another at {place}."
            )
        if volume <= 0 and depth != 1:
            raise OrientationError(
                f"faces must run counter-clockwise seen from outside. "
                f"Got a shell of volume {volume:.6g} mm³ at {place}."
            )


def face_outwards(
    vertices: np.ndarray, triangles: np.ndarray, shell: np.ndarray
) -> tuple[np.ndarray, int]:
    """Turn inside-out bodies right.

    An outermost shell with negative volume is turned together with everything inside it.

    Returns
    -------
    triangles : ndarray of int, shape (t, 3)
    n_turned : int
        How many outermost shells were turned.
    """
    volumes = shell_volumes(vertices, triangles, shell)
    inside = shell_windings(vertices, triangles, shell) != 0
    turn = np.zeros(len(volumes), dtype=bool)
    inverted = np.flatnonzero(~inside.any(axis=1) & (volumes < 0))
    for root in inverted:
        turn |= inside[:, root]
        turn[root] = True
    return np.where(turn[shell][:, None], triangles[:, ::-1], triangles), len(inverted)


# Where a closed surface crosses or touches itself.
#
# Two faces that meet outside their common vertices do so where an edge of one meets the other, so
# every edge is held against every triangle it shares no vertex with. Distances are computed in
# float64, whose rounding is some 10⁻¹⁵ of the part's size; whatever comes closer than 10⁻⁹ of it
# counts as contact, so no crossing can hide in the rounding.


RELATIVE_CONTACT = 1e-9
"""Parts of the surface closer than this fraction of the bounding box diagonal touch."""

_FOLDED_DEG = 180.0 - 1e-6
# of so many, the triangles near them fit in memory
_EDGES_AT_ONCE = 100_000
_LABEL = "look for contacts"


def check_contacts(solid: FacetedSurface) -> None:
    """Check that the surface meets itself only in common edges and vertices.

    Raises
    ------
    SelfIntersectionError
        Faces cross, solids overlap, or two faces are folded onto each other.
    TouchingError
        Faces that are no neighbours touch without crossing.
    """
    for edge in solid.edges:
        if abs(edge.dihedral_deg) > _FOLDED_DEG:
            text = describe_edge(solid.vertices, *edge.vertices)
            raise SelfIntersectionError(
                f"neighbouring faces must not be folded onto each other. Got so at the {text}."
            )
    points = solid.vertices - solid.vertices.mean(axis=0)
    tolerance = RELATIVE_CONTACT * float(np.linalg.norm(np.ptp(points, axis=0)))
    ends = _pairs(edge.vertices for edge in solid.edges)
    sides = np.unique(ends.min(axis=1) * len(points) + ends.max(axis=1))
    contacts = []
    for edge_idx, triangle_idx in _near_pairs(solid, points, ends, tolerance):
        triangles = solid.triangles[triangle_idx]
        rim = _on_rim(triangles, sides, len(points))
        gap, pierces = segment_triangle_gap(
            points[ends[edge_idx]], points[triangles], rim, tolerance
        )
        close = gap <= tolerance
        contacts.append((edge_idx[close], triangle_idx[close], pierces[close]))
    edge_idx, triangle_idx, pierces = map(np.concatenate, zip(*contacts, strict=True))
    if len(edge_idx):
        first = int(np.argmax(pierces))
        _complain(
            solid,
            int(edge_idx[first]),
            int(triangle_idx[first]),
            bool(pierces[first]),
            len(edge_idx),
        )


def _pairs(pairs: Iterable[tuple[int, int]]) -> np.ndarray:
    """Return pairs as an array, shape (n, 2)."""
    return np.fromiter(chain.from_iterable(pairs), dtype=np.int64).reshape(-1, 2)


def _complain(
    solid: FacetedSurface, edge_id: int, triangle: int, pierces: bool, n_contacts: int
) -> None:
    edge = solid.edges[edge_id]
    face = int(solid.triangle_face[triangle])
    same = solid.face_shell[face] == solid.face_shell[edge.faces[0]]
    place = (
        f"{describe_edge(solid.vertices, *edge.vertices)} and face {face} ({n_contacts} such pairs)"
    )
    if pierces:
        rule = "the surface must not cross itself" if same else "solids must not overlap"
        raise SelfIntersectionError(f"{rule}. Got a crossing of the {place}.")
    rule = (
        "parts of the surface that are no neighbours must not touch"
        if same
        else "solids must not touch"
    )
    raise TouchingError(f"{rule}. Got a contact of the {place}.")


def _near_pairs(
    solid: FacetedSurface, points: np.ndarray, ends: np.ndarray, tolerance: float
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield edges and triangles whose boxes meet and that are no neighbours, some edges at a time."""
    edge_faces = _pairs(edge.faces for edge in solid.edges)
    corners = points[solid.triangles]
    low = corners.min(axis=1)
    high = corners.max(axis=1)
    x, y, z = np.argsort(-np.ptp(points, axis=0), kind="stable")
    tree = shapely.STRtree(shapely.box(low[:, x], low[:, y], high[:, x], high[:, y]))
    for begin in range(0, len(ends), _EDGES_AT_ONCE):
        report_phase(begin, len(ends), _LABEL)
        here = ends[begin : begin + _EDGES_AT_ONCE]
        edge_low = points[here].min(axis=1) - tolerance
        edge_high = points[here].max(axis=1) + tolerance
        edge_idx, triangle_idx = tree.query(
            shapely.box(edge_low[:, x], edge_low[:, y], edge_high[:, x], edge_high[:, y])
        )
        keep = (edge_low[edge_idx, z] <= high[triangle_idx, z]) & (
            edge_high[edge_idx, z] >= low[triangle_idx, z]
        )
        edge_idx = edge_idx[keep] + begin
        triangle_idx = triangle_idx[keep]
        faces = solid.triangle_face[triangle_idx]
        keep = (edge_faces[edge_idx] != faces[:, None]).all(axis=1)
        edge_idx = edge_idx[keep]
        triangle_idx = triangle_idx[keep]
        shared = (ends[edge_idx][:, :, None] == solid.triangles[triangle_idx][:, None, :]).any(
            axis=(1, 2)
        )
        yield edge_idx[~shared], triangle_idx[~shared]
    report_phase(len(ends), len(ends), _LABEL)


def _on_rim(triangles: np.ndarray, edges: np.ndarray, n: int) -> np.ndarray:
    """Return which sides of triangles are edges of the solid rather than cuts through a face, shape (t, 3).

    `edges` holds, in rising order, the lower vertex of each times n and its higher one.
    """
    sides = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=-1).astype(np.int64)
    keys = sides.min(axis=-1) * n + sides.max(axis=-1)
    place = np.minimum(np.searchsorted(edges, keys), len(edges) - 1)
    return edges[place] == keys


def segment_triangle_gap(
    segments: np.ndarray, triangles: np.ndarray, rim: np.ndarray, tolerance: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return how close segments come to triangles, and which go through.

    Parameters
    ----------
    segments : ndarray, shape (n, 2, 3)
    triangles : ndarray, shape (n, 3, 3)
    rim : ndarray of bool, shape (n, 3)
        Whether the side from corner k to the next is a rim of the surface; a segment may pierce the other sides.
    tolerance : float
        Distances above it need not be exact: infinity is returned for pairs separated by the triangle's plane.

    Returns
    -------
    gap : ndarray, shape (n,)
    pierces : ndarray of bool, shape (n,)
        The segment passes through the triangle, by more than the tolerance beyond both ends and every rim.
    """
    gap = np.full(len(segments), np.inf)
    pierces = np.zeros(len(segments), dtype=bool)
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    heights = np.einsum("nij,nj->ni", segments - triangles[:, :1], normals)
    near = np.flatnonzero((heights.min(axis=1) <= tolerance) & (heights.max(axis=1) >= -tolerance))
    segments = segments[near]
    triangles = triangles[near]
    rim = rim[near]
    normals = normals[near]
    heights = heights[near]
    (p, q) = segments.swapaxes(0, 1)
    (hp, hq) = heights.T
    best = np.full(len(near), np.inf)
    for point, height in ((p, hp), (q, hq)):
        inside = (side_distances(point, triangles, normals) >= 0).all(axis=1)
        best = np.where(inside, np.minimum(best, np.abs(height)), best)
    for k in range(3):
        best = np.minimum(best, segment_distance(p, q, triangles[:, k], triangles[:, (k + 1) % 3]))
    across = hp * hq < 0
    share = np.divide(hp, hp - hq, out=np.zeros_like(hp), where=across)
    insets = side_distances(p + share[:, None] * (q - p), triangles, normals)
    gap[near] = np.where(across & (insets >= 0).all(axis=1), 0.0, best)
    through = across & (np.abs(heights).min(axis=1) > tolerance)
    pierces[near] = through & (insets > np.where(rim, tolerance, -tolerance)).all(axis=1)
    return gap, pierces


def side_distances(points: np.ndarray, triangles: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Return the distances of points, seen along the normal, from the sides, shape (n, 3): positive inside."""
    insets = []
    for k in range(3):
        start = triangles[:, k]
        end = triangles[:, (k + 1) % 3]
        inward = np.cross(normals, end - start)
        inward /= np.maximum(np.linalg.norm(inward, axis=1, keepdims=True), 1e-300)
        insets.append(np.einsum("ij,ij->i", points - start, inward))
    return np.stack(insets, axis=1)


def segment_distance(p: np.ndarray, q: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the distances between segments pq and ab, all arrays of shape (n, 3); a segment may be a point."""
    u = q - p
    v = b - a
    w = p - a
    uu, uv, vv = (np.einsum("ij,ij->i", x, y) for x, y in ((u, u), (u, v), (v, v)))
    uw, vw = (np.einsum("ij,ij->i", x, w) for x in (u, v))
    uu = np.maximum(uu, 1e-300)
    vv = np.maximum(vv, 1e-300)
    spread = uu * vv - uv * uv
    slanted = spread > 1e-24 * uu * vv
    s = np.clip(
        np.divide(uv * vw - vv * uw, spread, out=np.zeros_like(spread), where=slanted), 0.0, 1.0
    )
    best = np.full(len(p), np.inf)
    # The nearest points either lie inside both segments or involve an end point of one.
    for s_try in (s, np.zeros_like(s), np.ones_like(s)):
        t = np.clip((uv * s_try + vw) / vv, 0.0, 1.0)
        best = np.minimum(best, np.linalg.norm(w + s_try[:, None] * u - t[:, None] * v, axis=1))
    for t_try in (np.zeros_like(s), np.ones_like(s)):
        r = np.clip((uv * t_try - uw) / uu, 0.0, 1.0)
        best = np.minimum(best, np.linalg.norm(w + r[:, None] * u - t_try[:, None] * v, axis=1))
    return best
