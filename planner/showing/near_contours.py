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
        Ends (k, 2, 3), number (k,) of what they belong to; of that, relations (r, m), vertices (w,) and where those of
        each begin (r + 1,).
    limits : tuple of float
        How near, and how near to its own vertices an entity's neighbours may be, px.
    found : tuple
        To be written: number of the pair (c,), distance in px (c,), place in mm (c, 3). What does not fit is counted.
    """
    vertices, edge_ends = contours[0], contours[1]
    ends, belongs, relations, own_vertices, first = entities
    reach, near_own = limits
    active = np.empty(len(edge_ends), np.int64)
    image, corners = np.empty((len(vertices), 3)), np.empty((len(vertices), 2))
    boxes = np.empty((len(edge_ends), 4))
    n_active, last, count = 0, -1, 0
    for p in range(len(pairs)):
        pose, k = poses[pairs[p, 0]], pairs[p, 1]
        if pairs[p, 0] != last:
            last = pairs[p, 0]
            n_active = _project(pose, scale, contours, active, image, boxes)
        r = belongs[k]
        a, b = _seen(pose, scale, ends[k, 0]), _seen(pose, scale, ends[k, 1])
        if a[2] <= _NEAREST_MM or b[2] <= _NEAREST_MM:
            continue
        low_x, high_x = min(a[0], b[0]) - reach, max(a[0], b[0]) + reach
        low_y, high_y = min(a[1], b[1]) - reach, max(a[1], b[1]) + reach
        n_corners = first[r + 1] - first[r]
        for w in range(n_corners):
            corner = image[own_vertices[first[r] + w]]
            corners[w, 0], corners[w, 1] = corner[0], corner[1]
        for i in range(n_active):
            if boxes[i, 2] < low_x or boxes[i, 0] > high_x or boxes[i, 3] < low_y or boxes[i, 1] > high_y:
                continue
            e = active[i]
            one, other = image[edge_ends[e, 0]], image[edge_ends[e, 1]]
            relation = relations[r, e]
            if relation == OWN:
                continue
            line = (one[0], one[1], other[0], other[1])
            best = _nearest(line, a, b)
            if _apart(line, best, a, b) >= reach:
                continue
            low, high = _edge_of(line, best, 0.0, a, b, reach), _edge_of(line, best, 1.0, a, b, reach)
            if relation == CONNECTED and _beside(line, low, high, corners[:n_corners], near_own):
                continue
            samples = _MORE if relation == CONNECTED else _SAMPLES
            for s in range(samples + 1):
                t = best if s == samples else low + (high - low) * s / (samples - 1)
                if relation == CONNECTED and _beside(line, t, t, corners[:n_corners], near_own):
                    continue
                if count < len(found[0]):
                    # depths are linear in the image as their inverses
                    z0, z1 = one[2], other[2]
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
def _project(pose: Any, scale: Any, contours: Any, active: Any, image: Any, boxes: Any) -> int:
    """Write images and depths of the vertices, which edges may be contours and the boxes around them; return how many.

    Those behind are left out.
    """
    vertices, edge_ends, planes, kinds = contours
    for v in range(len(vertices)):
        image[v, 0], image[v, 1], image[v, 2] = _seen(pose, scale, vertices[v])
    n, eye = 0, pose[:3, 3]
    for e in range(len(edge_ends)):
        # nothing of a part so far beyond the stand-off is partly behind the camera and near to an edge in focus
        if image[edge_ends[e, 0], 2] <= _NEAREST_MM or image[edge_ends[e, 1], 2] <= _NEAREST_MM:
            continue
        if shown_here(planes[e], kinds[e], eye):
            active[n] = e
            one, other = image[edge_ends[e, 0]], image[edge_ends[e, 1]]
            for c in range(2):
                boxes[n, c], boxes[n, 2 + c] = min(one[c], other[c]), max(one[c], other[c])
            n += 1
    return n


@nb.njit(cache=True, error_model="numpy")
def _beside(line: Any, low: float, high: float, corners: Any, near: float) -> bool:
    """Tell whether a piece of a line is near to one of the corners, as both its ends are."""
    for w in range(len(corners)):
        within = True
        for t in (low, high):
            x, y = line[0] + t * (line[2] - line[0]), line[1] + t * (line[3] - line[1])
            within &= math.hypot(x - corners[w, 0], y - corners[w, 1]) < near
        if within:
            return True
    return False


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
    """Return where a line is nearest to the segment ab: at an end, beside an end of the segment, or where they meet."""
    ux, uy, vx, vy = line[2] - line[0], line[3] - line[1], b[0] - a[0], b[1] - a[1]
    ax, ay = a[0] - line[0], a[1] - line[1]
    square, cross = ux * ux + uy * uy, ux * vy - uy * vx
    best, least = 0.0, _apart(line, 0.0, a, b)
    for k in range(4):
        if k == 0:
            t = 1.0
        elif k == 1:
            t = (ax * ux + ay * uy) / square if square > 0.0 else 0.0
        elif k == 2:
            t = ((ax + vx) * ux + (ay + vy) * uy) / square if square > 0.0 else 0.0
        else:
            t = (ax * vy - ay * vx) / cross if cross != 0.0 else 0.0
        t = min(1.0, max(0.0, t))
        apart = _apart(line, t, a, b)
        if apart < least:
            best, least = t, apart
    return best


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
