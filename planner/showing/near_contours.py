"""Which points of contours come near to an edge in the image, before it is asked whether they are hidden; compiled."""

from __future__ import annotations

import math
from typing import Any

import numba as nb
import numpy as np

from planner.showing.contours import CONNECTED, CONVEX, OWN, SHARP

# points looked at on the piece of a contour that is near
_SAMPLES = 12
# of a neighbour, whose nearest points are excepted
_MORE = 48
_STEPS = 30
# what is nearer than this to the plane of the nodal point is cut off, mm
_NEAREST_MM = 1e-3


@nb.njit(cache=True, error_model="numpy")
def near_contours(poses: Any, pairs: Any, scale: Any, contours: Any, entities: Any, limits: Any, found: Any) -> int:
    """Write points of contours that are near to edges in the image; return how many there are.

    Parameters
    ----------
    poses : array (n, 4, 4)
        Cam2world.
    pairs : array of int (p, 2)
        Pose and entity, in rising order of the poses.
    scale : array (4,)
        Pixels per unit of slope in x and y, and the principal point, px.
    contours : tuple
        Vertices, ends, planes and kinds of `Contours`.
    entities : tuple
        Ends (k, 2, 3), relations (k, m), vertices (w,) and where those of each entity begin (k + 1,).
    limits : tuple of float
        How near, and how near to its own vertices an entity's neighbours may be, px.
    found : tuple
        To be written: number of the pair (c,), distance in px (c,), place in mm (c, 3). What does not fit is counted.
    """
    vertices, edge_ends, planes, kinds = contours
    ends, relations, own_vertices, first = entities
    reach, near_own = limits
    active = np.empty(len(edge_ends), np.int64)
    image = np.empty((len(edge_ends), 4))
    depth = np.empty((len(edge_ends), 2))
    n_active, last, count = 0, -1, 0
    for p in range(len(pairs)):
        pose, k = poses[pairs[p, 0]], pairs[p, 1]
        if pairs[p, 0] != last:
            last = pairs[p, 0]
            n_active = _project(pose, scale, vertices, edge_ends, planes, kinds, active, image, depth)
        a, b = _seen(pose, scale, ends[k, 0]), _seen(pose, scale, ends[k, 1])
        if a[2] <= _NEAREST_MM or b[2] <= _NEAREST_MM:
            continue
        low_x, high_x = min(a[0], b[0]) - reach, max(a[0], b[0]) + reach
        low_y, high_y = min(a[1], b[1]) - reach, max(a[1], b[1]) + reach
        for i in range(n_active):
            line, e = image[i], active[i]
            if max(line[0], line[2]) < low_x or min(line[0], line[2]) > high_x:
                continue
            if max(line[1], line[3]) < low_y or min(line[1], line[3]) > high_y:
                continue
            relation = relations[k, e]
            if relation == OWN:
                continue
            best = _nearest(line, a, b)
            if _apart(line, best, a, b) >= reach:
                continue
            low, high = _edge_of(line, best, 0.0, a, b, reach), _edge_of(line, best, 1.0, a, b, reach)
            samples = _MORE if relation == CONNECTED else _SAMPLES
            for s in range(samples + 1):
                t = best if s == samples else low + (high - low) * s / (samples - 1)
                if relation == CONNECTED:
                    x, y = line[0] + t * (line[2] - line[0]), line[1] + t * (line[3] - line[1])
                    excepted = False
                    for w in range(first[k], first[k + 1]):
                        corner = _seen(pose, scale, vertices[own_vertices[w]])
                        excepted |= math.hypot(x - corner[0], y - corner[1]) < near_own
                    if excepted:
                        continue
                if count < len(found[0]):
                    # depths are linear in the image as their inverses
                    z0, z1 = depth[i]
                    share = t * z0 / ((1.0 - t) * z1 + t * z0)
                    u, v = vertices[edge_ends[e, 0]], vertices[edge_ends[e, 1]]
                    found[0][count], found[1][count] = p, _apart(line, t, a, b)
                    for c in range(3):
                        found[2][count, c] = u[c] + share * (v[c] - u[c])
                count += 1
    return count


@nb.njit(cache=True, error_model="numpy")
def shown_here(planes: Any, kind: int, eye: Any) -> bool:
    """Whether an edge may be a contour from a viewpoint, as far as its own two faces tell."""
    front = 0
    for f in range(2):
        front += planes[f, 0] * eye[0] + planes[f, 1] * eye[1] + planes[f, 2] * eye[2] > planes[f, 3]
    if kind & SHARP:
        return front > 0 if kind & CONVEX else front == 2
    return front == 1


@nb.njit(cache=True, error_model="numpy")
def _seen(pose: Any, scale: Any, point: Any) -> tuple[float, float, float]:
    """Return the image of a point in px, and its depth."""
    x, y, z = point[0] - pose[0, 3], point[1] - pose[1, 3], point[2] - pose[2, 3]
    u = pose[0, 0] * x + pose[1, 0] * y + pose[2, 0] * z
    v = pose[0, 1] * x + pose[1, 1] * y + pose[2, 1] * z
    w = pose[0, 2] * x + pose[1, 2] * y + pose[2, 2] * z
    safe = max(w, _NEAREST_MM)
    return scale[0] * u / safe + scale[2], scale[1] * v / safe + scale[3], w


@nb.njit(cache=True, error_model="numpy")
def _project(
    pose: Any, scale: Any, vertices: Any, edge_ends: Any, planes: Any, kinds: Any, active: Any, image: Any, depth: Any
) -> int:
    """Write the images of the edges that may be contours; return how many there are. Those behind are left out."""
    eye = pose[:3, 3]
    n = 0
    for e in range(len(edge_ends)):
        if not shown_here(planes[e], kinds[e], eye):
            continue
        one, other = _seen(pose, scale, vertices[edge_ends[e, 0]]), _seen(pose, scale, vertices[edge_ends[e, 1]])
        # nothing of a part so far beyond the stand-off is partly behind the camera and near to an edge in focus
        if one[2] <= _NEAREST_MM or other[2] <= _NEAREST_MM:
            continue
        active[n] = e
        image[n, 0], image[n, 1], image[n, 2], image[n, 3] = one[0], one[1], other[0], other[1]
        depth[n, 0], depth[n, 1] = one[2], other[2]
        n += 1
    return n


@nb.njit(cache=True, error_model="numpy")
def _apart(line: Any, t: float, a: Any, b: Any) -> float:
    """Return the distance of a point of a line from the segment ab."""
    x, y = line[0] + t * (line[2] - line[0]) - a[0], line[1] + t * (line[3] - line[1]) - a[1]
    dx, dy = b[0] - a[0], b[1] - a[1]
    square = dx * dx + dy * dy
    share = min(1.0, max(0.0, (x * dx + y * dy) / square)) if square > 0.0 else 0.0
    return math.hypot(x - share * dx, y - share * dy)


@nb.njit(cache=True, error_model="numpy")
def _nearest(line: Any, a: Any, b: Any) -> float:
    """Return where a line is nearest to the segment ab: the distance is convex along it, so thirds are left out."""
    low, high = 0.0, 1.0
    for _ in range(2 * _STEPS):
        third = (high - low) / 3.0
        if _apart(line, low + third, a, b) <= _apart(line, high - third, a, b):
            high -= third
        else:
            low += third
    return (low + high) / 2.0


@nb.njit(cache=True, error_model="numpy")
def _edge_of(line: Any, inside: float, limit: float, a: Any, b: Any, reach: float) -> float:
    """Return how far from a near point towards an end of the line it stays near, by halving."""
    if _apart(line, limit, a, b) < reach:
        return limit
    near, far = inside, limit
    for _ in range(_STEPS):
        middle = (near + far) / 2.0
        if _apart(line, middle, a, b) < reach:
            near = middle
        else:
            far = middle
    return near
