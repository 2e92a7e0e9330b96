"""Planes on the integer grid.

A plane through three vertices of a part (integer triples, see `grid`) is an integer quadruple (a, b, c, d),
a·x + b·y + c·z = d, reduced by its greatest common divisor. Where snapping displaced vertices, one within the grid's
resolution of a plane counts as lying on it; that is decided once, when planes are built, and everything after is exact.
"""

from __future__ import annotations

import numpy as np

from aspectgraph.exact.grid import Grid
from aspectgraph.exceptions import SolidError
from ground.decorators import entry_kernel, kernel_without_refcounts


@entry_kernel
def plane_through(p, q, r):
    """Plane through three integer points, reduced and oriented by the turn p, q, r; all zero if they are collinear."""
    plane = np.zeros(4, np.int64)
    for k in range(3):
        i = (k + 1) % 3
        j = (k + 2) % 3
        # cross product of two sides
        plane[k] = (q[i] - p[i]) * (r[j] - p[j]) - (q[j] - p[j]) * (r[i] - p[i])
    divisor = np.gcd(np.gcd(plane[0], plane[1]), plane[2])
    if divisor:
        for k in range(3):
            plane[k] //= divisor
            plane[3] += plane[k] * p[k]
    return plane


@kernel_without_refcounts
def height(plane, point):
    """a·x + b·y + c·z - d at an integer point of the part, exact in int64."""
    return plane[0] * point[0] + plane[1] * point[1] + plane[2] * point[2] - plane[3]


@kernel_without_refcounts
def side_of(plane, point, resolution):
    """Sign of a plane at an integer point of the part; 0 within `resolution` steps of it."""
    h = height(plane, point)
    if resolution > 0.0:
        square = np.float64(plane[0]) ** 2 + np.float64(plane[1]) ** 2 + np.float64(plane[2]) ** 2
        # the distance is h over the length of (a, b, c)
        if np.float64(h) ** 2 <= resolution * resolution * square:
            return 0
    if h > 0:
        return 1
    return -1 if h < 0 else 0


@entry_kernel
def find_plane(planes, n, points, trio, resolution):
    """Number of the first of the first n planes through all three points, or -1."""
    for k in range(n):
        if (
            side_of(planes[k], points[trio[0]], resolution) == 0
            and side_of(planes[k], points[trio[1]], resolution) == 0
            and side_of(planes[k], points[trio[2]], resolution) == 0
        ):
            return k
    return -1


@entry_kernel
def find_parallel(planes, points, trio, resolution, plane):
    """The plane through the three points exactly parallel to that of `planes` nearest to parallel, or `plane`.

    Near enough is half the resolution: it must leave some to other vertices on the plane.
    """
    best = -1
    best_spread = 0.5 * resolution
    level = np.int64(0)
    for k in range(len(planes)):
        low = high = height(planes[k], points[trio[0]])
        for i in range(1, 3):
            h = height(planes[k], points[trio[i]])
            low = min(low, h)
            high = max(high, h)
        square = (
            np.float64(planes[k, 0]) ** 2
            + np.float64(planes[k, 1]) ** 2
            + np.float64(planes[k, 2]) ** 2
        )
        # how far apart the three points lie across the parallel planes
        spread = np.float64(high - low) / np.sqrt(square)
        if spread <= best_spread:
            best = k
            best_spread = spread
            level = low + (high - low) // 2
    if best < 0:
        return plane
    parallel = planes[best].copy()
    # halfway between the outermost of the three points
    parallel[3] += level
    return parallel


@entry_kernel
def _widest_triangle(points, loop):
    """Three of the loop's points that span nearly the largest triangle, in the loop's cyclic order."""
    # the farthest vertex from the farthest one: nearly the longest chord
    a = loop[0]
    for _ in range(2):
        b = a
        best = -1.0
        for v in loop:
            length = 0.0
            for k in range(3):
                length += np.float64(points[v, k] - points[a, k]) ** 2
            if length > best:
                b = v
                best = length
        a, b = b, a
    # and the farthest from that chord
    c = a
    best = -1.0
    for v in loop:
        area = 0.0
        for k in range(3):
            i = (k + 1) % 3
            j = (k + 2) % 3
            area += (
                np.float64(points[b, i] - points[a, i]) * np.float64(points[v, j] - points[a, j])
                - np.float64(points[b, j] - points[a, j]) * np.float64(points[v, i] - points[a, i])
            ) ** 2
        if area > best:
            c = v
            best = area
    return a, b, c


def face_planes(
    grid: Grid, loops: list[np.ndarray], normals: np.ndarray, order: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Integer planes of all faces, coplanar faces sharing one, larger faces first.

    Where snapping displaced vertices, a face that is parallel to a larger one to within the resolution gets an exactly
    parallel plane; otherwise the two would meet far away, and domains that they part would touch there.

    Parameters
    ----------
    grid : Grid
    loops : list of f int arrays
        Vertices of each face's outer loop.
    normals : ndarray, shape (f, 3)
        Outward unit normals in the grid's frame.
    order : ndarray of int, shape (f,), optional
        Order of equally large faces, last first. Default: as they are listed.

    Returns
    -------
    planes : ndarray of int64, shape (p, 4)
    plane_of_face : ndarray of int, shape (f,)
    side_of_face : ndarray of int8, shape (f,)
        1 where the face's outward side is the plane's positive side, else -1.

    Raises
    ------
    SolidError
        If a face vanishes on the grid.
    """
    planes: list[np.ndarray] = []
    plane_of_face = np.empty(len(loops), np.int64)
    side_of_face = np.empty(len(loops), np.int8)
    sizes = np.array([np.ptp(grid.points[loop], axis=0).sum() for loop in loops])
    order = np.arange(len(loops)) if order is None else order
    for face in order[np.argsort(sizes[order], kind="stable")[::-1]]:
        loop = np.asarray(loops[face], np.int64)
        trio = _widest_triangle(grid.points, loop)
        plane = plane_through(*grid.points[list(trio)])
        if not plane.any():
            raise SolidError(
                f"face {face} must be wider than the grid step of {grid.step_mm:g} mm. It vanishes on it."
            )
        table = np.array(planes, np.int64).reshape(-1, 4)
        number = _same_plane(table, grid.points[loop], grid.resolution)
        if number < 0:
            number = len(planes)
            planes.append(_made_parallel(plane, table, grid.points[loop], grid.resolution))
        plane_of_face[face] = number
        side_of_face[face] = 1 if normals[face] @ planes[number][:3] > 0 else -1
    return np.array(planes), plane_of_face, side_of_face


def _made_parallel(
    plane: np.ndarray, planes: np.ndarray, points: np.ndarray, resolution: float
) -> np.ndarray:
    """The plane parallel to one of `planes` nearest to all the points, or `plane` if none is near enough."""
    # half the resolution, to leave some to other vertices on the plane
    heights = points @ planes[:, :3].T
    low = heights.min(axis=0)
    high = heights.max(axis=0)
    near = high - low <= resolution * np.linalg.norm(planes[:, :3].astype(float), axis=1)
    if resolution == 0.0 or not near.any():
        return plane
    k = int(np.argmax(near))
    return np.array([*planes[k, :3], low[k] + (high[k] - low[k]) // 2])


@entry_kernel
def _same_plane(planes, points, resolution):
    for k in range(len(planes)):
        contains = True
        for i in range(len(points)):
            if side_of(planes[k], points[i], resolution) != 0:
                contains = False
                break
        if contains:
            return k
    return -1
