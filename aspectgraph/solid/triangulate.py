"""Triangles of planar faces with holes, using the faces' own vertices only."""

from __future__ import annotations

import numpy as np
import shapely

from aspectgraph.exceptions import SolidError
from aspectgraph.solid.topology import Face


def newell_area_vector(points: np.ndarray) -> np.ndarray:
    """Return the area vector of a closed polygon: its length is the area, its direction the normal.

    Parameters
    ----------
    points : ndarray, shape (k, 3)
        The loop, in mm.
    """
    local = points - points[0]
    return 0.5 * np.cross(local, np.roll(local, -1, axis=0)).sum(axis=0)


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
    if not face.holes and len(face.outer) == 3:
        return np.array([face.outer], dtype=np.int32)
    # Dropping one coordinate keeps the others bit for bit, so corners are recognised by their coordinates afterwards.
    keep = _projection_axes(normal)
    loops = [vertices[list(loop)][:, keep] for loop in face.loops]
    corners = np.vstack(loops)
    index = {
        (x, y): i
        for (x, y), i in zip(corners.tolist(), np.concatenate(face.loops).tolist(), strict=True)
    }
    polygon = shapely.Polygon(loops[0], loops[1:])
    if not shapely.is_valid(polygon):
        raise SolidError(
            f"the loops of a face must not cross. Got {name}: {shapely.is_valid_reason(polygon)}."
        )
    parts = shapely.constrained_delaunay_triangles(polygon)
    rings = shapely.get_coordinates(parts).reshape(-1, 4, 2)[:, :3]
    area = _signed_areas(rings)
    rings[area < 0] = rings[area < 0][:, ::-1]
    triangles = np.array(
        [[index[x, y] for x, y in ring] for ring in rings.tolist()], dtype=np.int32
    )
    # a hole that touches another loop in a vertex is joined to it there, and two triangles fewer are needed
    n_expected = len(corners) + 2 * len(face.holes) - 2 - 2 * (len(corners) - len(index))
    if len(triangles) != n_expected or not np.isclose(np.abs(area).sum(), polygon.area, rtol=1e-9):
        raise SolidError(
            f"the loops of a face must bound one region. Got {name} with {len(face.loops)} loops."
        )
    return triangles


def _projection_axes(normal: np.ndarray) -> list[int]:
    """Return the two axes to keep, in the order that leaves a loop about `normal` counter-clockwise."""
    drop = int(np.argmax(np.abs(normal)))
    keep = [(drop + 1) % 3, (drop + 2) % 3]
    return keep if normal[drop] > 0 else keep[::-1]


def _signed_areas(rings: np.ndarray) -> np.ndarray:
    a = rings[:, 1] - rings[:, 0]
    b = rings[:, 2] - rings[:, 0]
    return 0.5 * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])


def signed_volume(vertices: np.ndarray, triangles: np.ndarray) -> float:
    """Return the volume enclosed by closed triangles in mm³, positive if they face outwards."""
    local = vertices - vertices.mean(axis=0)
    a, b, c = (local[triangles[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)
