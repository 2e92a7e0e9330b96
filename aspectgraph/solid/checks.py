"""Checks on coordinates: finite, in range, with an area, planar, outward."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from aspectgraph.exceptions import PlanarityError, SolidError
from aspectgraph.solid.face_loops import FaceLoops
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
        where = f"Got {loop} in face {loops.loop_face[bad[0]]}"
        if len(loop) < 3 or len(set(loop)) != len(loop):
            raise SolidError(f"a loop must have at least 3 vertices, all distinct. {where}.")
        raise SolidError(f"vertex indices must be in 0..{len(vertices) - 1}. {where}.")
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
            f"vertices in use must lie at distinct places. Got {counts.max()} at {place}."
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
