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

import numpy as np
from numpy.typing import ArrayLike, NDArray

from compiled.decorators import entry_kernel, kernel, kernel_without_refcounts, put
from planner.bound.boxes.box_conditions import TOUCH_MM, out_of_focus, outside, too_short
from planner.bound.boxes.cells import Cells
from planner.bound.boxes.view import Segments
from planner.bound.segments import frustum_of, segments_of, sensor_tangents
from planner.camera.camera import Camera
from planner.effort.effort import NORMAL, Effort
from planner.executors import THREADS
from planner.request.request import Request

# of angles, rad
_EPS_RAD = 1e-7
# places of a box in the stack
_MIDDLE, _HALF = range(2)


def find_conflicts(
    request: Request,
    entity_idx: NDArray[np.int_],
    columns: ArrayLike,
    regions: Cells,
    effort: Effort = NORMAL,
) -> NDArray[np.bool_]:
    """Find the pairs of entities that exclude each other.

    Parameters
    ----------
    request : Request
        The request.
    entity_idx : array of int (e,)
        Entities, as columns of the request.
    columns : array of bool (c, e)
        Sets known to be inspected by some pose; their pairs need no test.
    regions : Cells
        The cells of each entity's region.
    effort : Effort
        How far space is subdivided.

    Returns
    -------
    array of bool (e, e)
        Symmetric, false on the diagonal.
    """
    known = np.asarray(columns, dtype=bool)
    segments = segments_of(request, entity_idx)
    frustum = frustum_of(request)
    cells = regions.arrays
    together = known.T.astype(int) @ known.astype(int) > 0
    tangents = sensor_tangents(request.camera, request.requirements.border_px)
    conflict = too_far_apart(request.camera, segments.ends, tangents) & ~together

    def excludes(pair: NDArray[np.int_]) -> bool:
        a, b = pair
        both = Segments(*(values[pair] for values in segments))
        return not _share_viewpoint(a, b, cells, both, frustum, effort.bound.subdivision)

    pairs = np.argwhere(np.triu(~conflict & ~together, k=1))
    with ThreadPoolExecutor(THREADS) as pool:
        found = pairs[np.fromiter(pool.map(excludes, pairs), bool, len(pairs))]
    conflict[found[:, 0], found[:, 1]] = conflict[found[:, 1], found[:, 0]] = True
    return conflict


def too_far_apart(
    camera: Camera, ends: NDArray[np.float64], tangents: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Return which pairs of entities (ends: (e, 2, 3), mm) do not fit into the frustum together; (e, e) bool."""
    near, far = camera.depth_of_field_mm
    if not np.isfinite(far):
        return np.zeros((len(ends), len(ends)), dtype=bool)
    corners = np.array([[x, y, 1.0] for x in (-1, 1) for y in (-1, 1)]) * [*tangents, 1.0]
    corners = np.concatenate([near * corners, far * corners])
    # the two farthest points of a convex polytope are two of its corners
    diameter = np.linalg.norm(corners[:, None] - corners, axis=-1).max()
    distance = np.linalg.norm(ends[:, None, :, None] - ends[None, :, None], axis=-1).max(
        axis=(2, 3)
    )
    result = distance > diameter
    np.fill_diagonal(result, False)
    return result


# threads run it side by side
@entry_kernel(nogil=True)
def _share_viewpoint(a, b, cells, pair, frustum, subdivision):
    """Tell whether some cell of entity a may meet some cell of entity b where the lens can take both at once.

    ``pair`` are the segments of the two.
    """
    planes = cells.planes
    plane_start = cells.plane_start
    entity_start = cells.entity_start
    stack = np.empty((subdivision.waiting, 2, 3))
    for i in range(entity_start[a], entity_start[a + 1]):
        for j in range(entity_start[b], entity_start[b + 1]):
            if not _overlap(cells.boxes, i, j, stack[0]):
                continue
            if _apart(i, j, cells) or _apart(j, i, cells):
                continue
            if _search(stack, i, j, planes, plane_start, pair, frustum, subdivision):
                return True
    return False


@kernel_without_refcounts
def _overlap(boxes, i, j, common):
    """Tell whether boxes i and j meet; write the centre and half size of what they share."""
    for k in range(3):
        low = max(boxes[i, 0, k], boxes[j, 0, k])
        high = min(boxes[i, 1, k], boxes[j, 1, k])
        if high - low < -TOUCH_MM:
            return False
        common[_MIDDLE, k] = (low + high) / 2
        common[_HALF, k] = (high - low) / 2
    return True


@kernel
def _search(stack, i, j, planes, plane_start, pair, frustum, subdivision):
    """Subdivide the box on the stack; true when a viewpoint is found or the effort is spent."""
    size = 1
    for _ in range(subdivision.boxes):
        if size == 0:
            return False
        size -= 1
        centre = stack[size, _MIDDLE].copy()
        half = stack[size, _HALF].copy()
        if not _in_both(centre, half, i, j, planes, plane_start):
            continue
        if not _in_view(centre, math.sqrt(np.sum(half**2)), pair, frustum):
            continue
        axis = np.argmax(half)
        if half[axis] < subdivision.finest_mm or size + 2 > subdivision.waiting:
            return True
        point = np.zeros(3)
        if _in_both(centre, point, i, j, planes, plane_start) and _in_view(
            centre, 0.0, pair, frustum
        ):
            return True
        half[axis] /= 2
        for sign in (-1.0, 1.0):
            put(stack[size, _MIDDLE], centre)
            put(stack[size, _HALF], half)
            stack[size, _MIDDLE, axis] += sign * half[axis]
            size += 1
    return True


@kernel_without_refcounts
def _in_both(centre, half, i, j, planes, plane_start):
    """Tell whether a box may meet both cells."""
    return not (
        outside(planes, plane_start[i], plane_start[i + 1], centre, half)
        or outside(planes, plane_start[j], plane_start[j + 1], centre, half)
    )


@kernel
def _in_view(centre, radius, pair, frustum):
    """Tell whether some viewpoint of a ball may have all ends in focus, within the sensor, and long enough images."""
    points = pair.ends.reshape(-1, 3)
    n = len(points)
    for k in range(n):
        if out_of_focus(_distance(points[k], centre), radius, frustum):
            return False
    away = np.empty(n)
    deep = frustum.far - frustum.near + TOUCH_MM
    for k in range(n):
        away[k] = _from_axis(_distance(points[k], centre), radius, frustum)
    for k in range(n):
        for m in range(k + 1, n):
            if _apart_in_view(points[k], points[m], centre, away[k] + away[m]):
                return False
            if _one_behind_the_other(points[k], points[m], centre, deep, away[k]):
                return False
            if _one_behind_the_other(points[m], points[k], centre, deep, away[m]):
                return False
    for e in range(2):
        if too_short(pair.ends[e], pair.lengths[e], pair.length_ratio[e], centre, radius, frustum):
            return False
    return True


@kernel_without_refcounts
def _from_axis(distance, radius, frustum):
    """Return how far off the axis, rad, a point may be seen, given its distance from the middle of a ball of eyes.

    The angle is that at the middle. A point is no farther off than a corner of the sensor, and than where its depth,
    which is its distance times the cosine, falls below the nearest sharp one.
    """
    if radius >= distance:
        return math.pi
    off = math.acos(min(1.0, (frustum.near - TOUCH_MM) / (distance + radius)))
    return min(frustum.cone, off) + math.asin(radius / distance)


@kernel_without_refcounts
def _apart_in_view(point, other, centre, most):
    """Tell whether two points are seen farther apart than an angle, rad."""
    cosine = 0.0
    for c in range(3):
        cosine += (point[c] - centre[c]) * (other[c] - centre[c])
    cosine /= max(_distance(point, centre) * _distance(other, centre), TOUCH_MM)
    return math.acos(min(1.0, max(-1.0, cosine))) > most + _EPS_RAD


@kernel_without_refcounts
def _one_behind_the_other(point, other, centre, deep, off):
    """Tell whether no axis that is at most ``off`` the first point, rad, has both within a depth of ``deep``, mm.

    Such an axis is nearly square to the line through both.
    """
    between = _distance(point, other)
    if between <= deep:
        return False
    square = 0.0
    for c in range(3):
        square += (point[c] - centre[c]) * (other[c] - point[c])
    first = _distance(point, centre)
    if first <= TOUCH_MM:
        return False
    slant = math.asin(deep / between)
    turned = math.asin(min(1.0, abs(square) / (first * between)))
    return turned > slant + off + _EPS_RAD


@kernel_without_refcounts
def _distance(point, other):
    x = point[0] - other[0]
    y = point[1] - other[1]
    z = point[2] - other[2]
    return math.sqrt(x * x + y * y + z * z)


@kernel_without_refcounts
def _apart(i, j, cells):
    """Tell whether a plane of cell i has all corners of cell j outside."""
    planes = cells.planes
    corners = cells.corners
    for p in range(cells.plane_start[i], cells.plane_start[i + 1]):
        separates = True
        for v in range(cells.corner_start[j], cells.corner_start[j + 1]):
            height = planes[p, 3]
            for k in range(3):
                height += planes[p, k] * corners[v, k]
            if height < TOUCH_MM:
                separates = False
                break
        if separates:
            return True
    return False
