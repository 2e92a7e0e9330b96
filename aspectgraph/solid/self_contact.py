"""Where a closed surface crosses or touches itself.

Two faces that meet outside their common vertices do so where an edge of one meets the other, so every edge is held
against every triangle it shares no vertex with. Distances are computed in float64, whose rounding is some 10⁻¹⁵ of the
part's size; whatever comes closer than 10⁻⁹ of it counts as contact, so no crossing can hide in the rounding.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import chain
from typing import Protocol

import numpy as np
import shapely

from aspectgraph.exceptions import SelfIntersectionError, TouchingError
from aspectgraph.phases import report_phase
from aspectgraph.solid.topology import Edge, describe_edge

RELATIVE_CONTACT = 1e-9
"""Parts of the surface closer than this fraction of the bounding box diagonal touch."""

_FOLDED_DEG = 180.0 - 1e-6
# of so many, the triangles near them fit in memory
_EDGES_AT_ONCE = 100_000
_LABEL = "look for contacts"


class ContactSurface(Protocol):
    """What is read of a solid here; see `Solid` for shapes and units."""

    @property
    def vertices(self) -> np.ndarray: ...  # noqa: D102

    @property
    def edges(self) -> Sequence[Edge]: ...  # noqa: D102

    @property
    def triangles(self) -> np.ndarray: ...  # noqa: D102

    @property
    def triangle_face(self) -> np.ndarray: ...  # noqa: D102

    @property
    def face_shell(self) -> np.ndarray: ...  # noqa: D102


def check_contacts(solid: ContactSurface) -> None:
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
    solid: ContactSurface, edge_id: int, triangle: int, pierces: bool, n_contacts: int
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
    solid: ContactSurface, points: np.ndarray, ends: np.ndarray, tolerance: float
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
