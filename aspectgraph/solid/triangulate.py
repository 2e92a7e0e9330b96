"""Triangles of planar faces with holes, using the faces' own vertices only."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import shapely

from aspectgraph.exceptions import SolidError
from aspectgraph.solid.face_loops import FaceLoops
from aspectgraph.solid.topology import Face


def newell_area_vector(points: np.ndarray) -> np.ndarray:
    """Return the area vector of closed polygons: its length is the area, its direction the normal.

    Parameters
    ----------
    points : ndarray, shape (..., k, 3)
        The loops, in mm.

    Returns
    -------
    ndarray, shape (..., 3)
        In mm².
    """
    local = points - points[..., :1, :]
    return 0.5 * np.cross(local, np.roll(local, -1, axis=-2)).sum(axis=-2)


def triangulate_face(
    vertices: np.ndarray, face: Face, normal: np.ndarray, name: str = "face"
) -> np.ndarray:
    """Cut a face into triangles, counter-clockwise seen from outside.

    Parameters
    ----------
    vertices : ndarray, shape (n, 3)
        All vertices, in mm.
    face : Face
        The face; collinear vertices in its loops are kept.
    normal : ndarray, shape (3,)
        Its outward unit normal.
    name : str
        How a message calls the face.

    Returns
    -------
    ndarray of int32, shape (m, 3)
        Vertex indices. Guarantee: every directed edge of the loops is a side of exactly one triangle and every other
        side is shared by two, so the triangles of neighbouring faces meet edge to edge.

    Raises
    ------
    SolidError
        The loops cross, or a hole is not inside the outer loop.
    """
    loops = FaceLoops.of([face])
    return triangulate_faces(vertices, loops, normal[None], lambda _: name)[0]


def triangulate_faces(
    vertices: np.ndarray,
    loops: FaceLoops,
    normals: np.ndarray,
    name: Callable[[int], str] = "face {}".format,
) -> tuple[np.ndarray, ...]:
    """Cut faces into triangles; see `triangulate_face`.

    Parameters
    ----------
    vertices : ndarray, shape (n, 3)
        All vertices, in mm.
    loops : FaceLoops
        The loops of the faces.
    normals : ndarray, shape (f, 3)
        Their outward unit normals.
    name : callable
        Returns how a message calls a face.

    Returns
    -------
    tuple of ndarray of int32, shape (m, 3)
        The triangles of each face.

    Raises
    ------
    SolidError
        The loops of a face cross, or a hole is not inside the outer loop.
    """
    whole = np.flatnonzero(loops.is_triangle)
    first = loops.first[loops.outer[whole]]
    rows = loops.start[first[:, None] + np.arange(3)].astype(np.int32)
    if len(whole) == len(normals):
        return tuple(rows[:, None])
    cut: list[np.ndarray] = [rows[:0]] * len(normals)
    for face, row in zip(whole.tolist(), rows[:, None], strict=True):
        cut[face] = row
    others = np.flatnonzero(~loops.is_triangle)
    for face, triangles in zip(
        others.tolist(), _cut_polygons(vertices, loops, normals, others, name), strict=True
    ):
        cut[face] = triangles
    return tuple(cut)


def _cut_polygons(
    vertices: np.ndarray,
    loops: FaceLoops,
    normals: np.ndarray,
    faces: np.ndarray,
    name: Callable[[int], str],
) -> list[np.ndarray]:
    """Return the triangles of faces that are more than one."""
    rank = np.full(len(normals), -1)
    rank[faces] = np.arange(len(faces))
    half_edges = np.flatnonzero(rank[loops.face] >= 0)
    of_face = rank[loops.face[half_edges]]
    corners = loops.start[half_edges]
    # Dropping one coordinate keeps the others bit for bit, so corners are recognised by their coordinates afterwards.
    flat = vertices[corners[:, None], _projection_axes(normals[faces])[of_face]]
    which = rank[loops.loop_face] >= 0
    ring = np.repeat(np.arange(int(which.sum())), loops.size[which])
    polygons = shapely.polygons(
        shapely.linearrings(flat, indices=ring), indices=rank[loops.loop_face[which]]
    )
    crossed = np.flatnonzero(~shapely.is_valid(polygons))
    # of several faces that are wrong the first is named
    n_sound = int(crossed[0]) if len(crossed) else len(faces)
    parts = shapely.constrained_delaunay_triangles(polygons[:n_sound])
    points, owner = shapely.get_coordinates(parts, return_index=True)
    rings = points.reshape(-1, 4, 2)[:, :3]
    owner = owner[::4]
    area = _signed_areas(rings)
    rings[area < 0] = rings[area < 0][:, ::-1]
    places = zip(of_face.tolist(), *flat.T.tolist(), strict=True)
    index = dict(zip(places, corners.tolist(), strict=True))
    # a hole that touches another loop in a vertex is joined to it there, and two triangles fewer are needed
    n_places = np.bincount(np.fromiter((key[0] for key in index), dtype=np.int64))
    n_corners = np.bincount(of_face)
    n_loops = loops.n_loops[faces]
    n_expected = (2 * n_places - n_corners + 2 * n_loops - 4)[:n_sound]
    covered = np.bincount(owner, np.abs(area), minlength=n_sound)
    one_region = np.isclose(covered, shapely.area(polygons[:n_sound]), rtol=1e-9)
    n_triangles = np.bincount(owner, minlength=n_sound)
    wrong = np.flatnonzero((n_triangles != n_expected) | ~one_region)
    if len(wrong):
        raise SolidError(
            f"the loops of a face must bound one region. Got {name(int(faces[wrong[0]]))} "
            f"with {n_loops[wrong[0]]} loops."
        )
    if len(crossed):
        raise SolidError(
            f"the loops of a face must not cross. Got {name(int(faces[n_sound]))}: "
            f"{shapely.is_valid_reason(polygons[n_sound])}."
        )
    keys = zip(np.repeat(owner, 3).tolist(), *rings.reshape(-1, 2).T.tolist(), strict=True)
    triangles = np.array([index[key] for key in keys], dtype=np.int32).reshape(-1, 3)
    return np.split(triangles, np.cumsum(n_triangles)[:-1])


def _projection_axes(normals: np.ndarray) -> np.ndarray:
    """Return the two axes to keep, in the order that leaves a loop about a normal counter-clockwise, shape (f, 2)."""
    drop = np.argmax(np.abs(normals), axis=1)
    keep = np.stack([(drop + 1) % 3, (drop + 2) % 3], axis=1)
    upwards = np.take_along_axis(normals, drop[:, None], axis=1) > 0
    return np.where(upwards, keep, keep[:, ::-1])


def _signed_areas(rings: np.ndarray) -> np.ndarray:
    a = rings[:, 1] - rings[:, 0]
    b = rings[:, 2] - rings[:, 0]
    return 0.5 * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])


def signed_volume(vertices: np.ndarray, triangles: np.ndarray) -> float:
    """Return the volume enclosed by closed triangles in mm³, positive if they face outwards."""
    local = vertices - vertices.mean(axis=0)
    a, b, c = (local[triangles[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)
