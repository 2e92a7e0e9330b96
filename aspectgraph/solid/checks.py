"""Checks on coordinates: finite, in range, with an area, planar, outward."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from aspectgraph.exceptions import PlanarityError, SolidError
from aspectgraph.solid.places import describe_point
from aspectgraph.solid.topology import Face
from aspectgraph.solid.triangulate import newell_area_vector

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


def check_indices(vertices: np.ndarray, faces: Sequence[Face]) -> None:
    """Check that loops have three or more distinct, existing vertices at distinct places.

    Raises
    ------
    SolidError
        An index is out of range, a loop is short or visits a vertex twice, or two vertices coincide.
    """
    if len(faces) < 4:
        raise SolidError(f"a solid must have at least 4 faces. Got {len(faces)}.")
    for f, face in enumerate(faces):
        for loop in face.loops:
            if len(loop) < 3 or len(set(loop)) != len(loop):
                raise SolidError(
                    f"a loop must have at least 3 vertices, all distinct. Got {loop} in face {f}."
                )
            if min(loop) < 0 or max(loop) >= len(vertices):
                raise SolidError(
                    f"vertex indices must be in 0..{len(vertices) - 1}. Got {loop} in face {f}."
                )
    used = np.unique(np.concatenate([loop for face in faces for loop in face.loops]))
    _, first, counts = np.unique(vertices[used], axis=0, return_index=True, return_counts=True)
    if (counts > 1).any():
        place = describe_point(vertices[used[first[counts > 1][0]]])
        raise SolidError(
            f"vertices in use must lie at distinct places. Got {counts.max()} at {place}."
        )


def default_planarity_mm(vertices: np.ndarray) -> float:
    """Return the default planarity tolerance in mm: 10⁻⁶ of the bounding box diagonal."""
    return RELATIVE_PLANARITY * float(np.linalg.norm(np.ptp(vertices, axis=0)))


def face_area_vectors(vertices: np.ndarray, faces: Sequence[Face]) -> np.ndarray:
    """Return the area vector (outward normal times area, mm²) of every face, shape (f, 3)."""
    return np.array(
        [sum(newell_area_vector(vertices[list(loop)]) for loop in face.loops) for face in faces]
    )


def check_areas(vertices: np.ndarray, faces: Sequence[Face], area_vectors: np.ndarray) -> None:
    """Check that every face has an area, told apart from rounding.

    Raises
    ------
    SolidError
        The area is zero to within rounding of the coordinates.
    """
    areas = np.linalg.norm(area_vectors, axis=1)
    scale = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    perimeter = np.array([_longest_side(vertices[list(face.outer)]) for face in faces])
    flat = np.flatnonzero(areas <= 1e-15 * scale * perimeter)
    if len(flat):
        place = describe_point(vertices[faces[flat[0]].outer[0]])
        raise SolidError(
            f"a face must have an area above zero. Got {areas[flat[0]]:.3g} mm² for face {flat[0]} at {place}."
        )


def _longest_side(points: np.ndarray) -> float:
    return float(np.linalg.norm(points - np.roll(points, 1, axis=0), axis=1).max())


def plane_deviation_mm(vertices: np.ndarray, face: Face, normal: np.ndarray) -> float:
    """Return the largest distance of the face's vertices from the plane through their mid-range along `normal`."""
    heights = vertices[np.concatenate(face.loops)] @ normal
    return float(np.ptp(heights)) / 2.0


def check_planarity(
    vertices: np.ndarray, faces: Sequence[Face], normals: np.ndarray, planarity_mm: float
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
    for f, (face, normal) in enumerate(zip(faces, normals, strict=True)):
        if len(face.outer) == 3 and not face.holes:
            continue
        deviation = plane_deviation_mm(local, face, normal)
        if deviation > planarity_mm:
            place = describe_point(vertices[face.outer[0]])
            raise PlanarityError(
                f"a face must be planar within {planarity_mm:.3g} mm. Got {deviation:.3g} mm for face {f} at {place}."
            )
