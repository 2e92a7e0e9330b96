"""Pairs of entities that no setting can inspect together, each for a reason that is a proof.

* They do not fit: two of their ends are farther apart than any two points of the frustum between the nearest and the
  farthest sharp plane.
* No viewpoint serves both. Space is subdivided into boxes; a box is discarded when it is outside the one's or the
  other's region, when an end in it cannot be at a distance the lens can focus on, when two ends are farther apart in
  angle than the corners of the sensor, or when an image is too short (`planner.bound.least_image`). The pair excludes
  each other if no box is left.

The second test stops at boxes of half a millimetre, so it may miss a conflict, but it never invents one.
"""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor

import numba as nb
import numpy as np

from planner.bound.least_image import least_image_mm
from planner.executors import THREADS

# more than the rounding of planes and corners of cells; cells that only touch count as meeting
_ROUNDING_MM = 1e-6
_FINEST_MM = 0.5
_MOST_BOXES = 200_000
_STACK = 256


def find_conflicts(judge, entity_idx, columns, regions) -> np.ndarray:
    """Find the pairs of entities that exclude each other.

    Parameters
    ----------
    judge : Judge
        The request.
    entity_idx : array of int (e,)
        Entities, as columns of the judge.
    columns : array of bool (c, e)
        Sets known to be inspected by some pose; their pairs need no test.
    regions : Cells
        The cells of each entity's region.

    Returns
    -------
    array of bool (e, e)
        Symmetric, false on the diagonal.
    """
    columns = np.asarray(columns, dtype=bool)
    ends = judge.ends[entity_idx]
    together = columns.T.astype(int) @ columns.astype(int) > 0
    tangents = sensor_tangents(judge.camera, judge.requirements.field_margin_px)
    conflict = too_far_apart(judge.camera, ends, tangents) & ~together
    near, far = judge.camera.depth_of_field_mm
    cone = math.atan(math.hypot(*tangents))
    far /= math.cos(cone)
    ratio = least_image_mm(judge) / judge.camera.image_distance_mm
    limits = near, far, cone, ratio

    def excludes(pair) -> bool:
        return not _share_viewpoint(*pair, *regions.arrays, ends[pair].reshape(-1, 3), limits)

    pairs = np.argwhere(np.triu(~conflict & ~together, k=1))
    with ThreadPoolExecutor(THREADS) as pool:
        found = pairs[np.fromiter(pool.map(excludes, pairs), bool, len(pairs))]
    conflict[found[:, 0], found[:, 1]] = conflict[found[:, 1], found[:, 0]] = True
    return conflict


def sensor_tangents(camera, margin_px: float) -> np.ndarray:
    """Return the tangents (2,) of the half angles of view, less a margin at the sides of the sensor."""
    half = np.array(camera.sensor_size_mm) / 2 - margin_px * np.array(camera.pixel_pitch_mm)
    return np.maximum(half, 0.0) / camera.image_distance_mm


def too_far_apart(camera, ends: np.ndarray, tangents: np.ndarray) -> np.ndarray:
    """Return which pairs of entities (ends: (e, 2, 3), mm) do not fit into the frustum together; (e, e) bool."""
    near, far = camera.depth_of_field_mm
    if not np.isfinite(far):
        return np.zeros((len(ends), len(ends)), dtype=bool)
    corners = np.array([[x, y, 1.0] for x in (-1, 1) for y in (-1, 1)]) * [*tangents, 1.0]
    corners = np.concatenate([near * corners, far * corners])
    # the two farthest points of a convex polytope are two of its corners
    diameter = np.linalg.norm(corners[:, None] - corners, axis=-1).max()
    distance = np.linalg.norm(ends[:, None, :, None] - ends[None, :, None], axis=-1).max(axis=(2, 3))
    result = distance > diameter
    np.fill_diagonal(result, False)
    return result


@nb.njit(cache=True, nogil=True)
def _share_viewpoint(a, b, planes, plane_start, corners, corner_start, boxes, entity_start, points, limits):
    """Tell whether some cell of entity a may meet some cell of entity b where the lens can take all points at once."""
    stack = np.empty((_STACK, 2, 3))
    for i in range(entity_start[a], entity_start[a + 1]):
        for j in range(entity_start[b], entity_start[b + 1]):
            if not _overlap(boxes, i, j, stack[0]):
                continue
            if _apart(i, j, planes, plane_start, corners, corner_start):
                continue
            if _apart(j, i, planes, plane_start, corners, corner_start):
                continue
            if _search(stack, i, j, planes, plane_start, points, limits):
                return True
    return False


@nb.njit(cache=True, nogil=True)
def _overlap(boxes, i, j, common):
    """Tell whether boxes i and j meet; write the centre and half size of what they share."""
    for k in range(3):
        low, high = max(boxes[i, 0, k], boxes[j, 0, k]), min(boxes[i, 1, k], boxes[j, 1, k])
        if high - low < -_ROUNDING_MM:
            return False
        common[0, k], common[1, k] = (low + high) / 2, (high - low) / 2
    return True


@nb.njit(cache=True, nogil=True)
def _search(stack, i, j, planes, plane_start, points, limits):
    """Subdivide the box on the stack; true when a viewpoint is found or the effort is spent."""
    size = 1
    for _ in range(_MOST_BOXES):
        if size == 0:
            return False
        size -= 1
        center, half = stack[size, 0].copy(), stack[size, 1].copy()
        if _excluded(center, half, i, planes, plane_start) or _excluded(center, half, j, planes, plane_start):
            continue
        if not _in_view(center, math.sqrt(np.sum(half**2)), points, limits):
            continue
        axis = np.argmax(half)
        if half[axis] < _FINEST_MM or size + 2 > _STACK:
            return True
        point = np.zeros(3)
        if (
            not _excluded(center, point, i, planes, plane_start)
            and not _excluded(center, point, j, planes, plane_start)
            and _in_view(center, 0.0, points, limits)
        ):
            return True
        half[axis] /= 2
        for sign in (-1.0, 1.0):
            stack[size, 0], stack[size, 1] = center, half
            stack[size, 0, axis] += sign * half[axis]
            size += 1
    return True


@nb.njit(cache=True, nogil=True)
def _excluded(center, half, cell, planes, plane_start):
    """Tell whether a box is outside of a cell."""
    for p in range(plane_start[cell], plane_start[cell + 1]):
        lowest = planes[p, 3]
        for k in range(3):
            lowest += planes[p, k] * center[k] - abs(planes[p, k]) * half[k]
        if lowest > _ROUNDING_MM:
            return True
    return False


@nb.njit(cache=True, nogil=True)
def _in_view(center, radius, points, limits):
    """Tell whether some viewpoint of a ball may have all points in focus, within the sensor, and long enough images."""
    near, far, cone, ratio = limits
    angle = 2.0 * cone
    n = points.shape[0]
    for k in range(n):
        distance = _distance(points[k], center)
        if distance - radius > far or distance + radius < near:
            return False
    for k in range(n):
        first_length = _distance(points[k], center)
        for m in range(k + 1, n):
            second_length = _distance(points[m], center)
            if radius >= first_length or radius >= second_length:
                continue
            cosine = 0.0
            for c in range(3):
                cosine += (points[k, c] - center[c]) * (points[m, c] - center[c])
            cosine /= first_length * second_length
            between = math.acos(min(1.0, max(-1.0, cosine)))
            if between - math.asin(radius / first_length) - math.asin(radius / second_length) > angle + 1e-9:
                return False
    long_enough = True
    for k in range(0, n, 2):
        long_enough = long_enough and _long_enough(center, radius, points[k], points[k + 1], near, cone, ratio)
    return long_enough


@nb.njit(cache=True, nogil=True)
def _distance(point, other):
    x, y, z = point[0] - other[0], point[1] - other[1], point[2] - other[2]
    return math.sqrt(x * x + y * y + z * z)


@nb.njit(cache=True, nogil=True)
def _long_enough(center, radius, first, second, near, cone, ratio):
    """Tell whether the image from some viewpoint of a ball may be long enough: eq 16, depth >= distance cos(cone)."""
    line, offset = second - first, center - first
    x = offset[1] * line[2] - offset[2] * line[1]
    y = offset[2] * line[0] - offset[0] * line[2]
    z = offset[0] * line[1] - offset[1] * line[0]
    # twice the area of the triangle of viewpoint and edge
    area = math.sqrt(x * x + y * y + z * z) + radius * math.sqrt(np.sum(line**2))
    depth = 1.0
    for point in (first, second):
        depth *= max(near, (_distance(point, center) - radius) * math.cos(cone))
    return area >= ratio * depth * (1.0 - 1e-9)


@nb.njit(cache=True, nogil=True)
def _apart(i, j, planes, plane_start, corners, corner_start):
    """Tell whether a plane of cell i has all corners of cell j outside."""
    for p in range(plane_start[i], plane_start[i + 1]):
        separates = True
        for v in range(corner_start[j], corner_start[j + 1]):
            height = planes[p, 3]
            for k in range(3):
                height += planes[p, k] * corners[v, k]
            if height < _ROUNDING_MM:
                separates = False
                break
        if separates:
            return True
    return False
