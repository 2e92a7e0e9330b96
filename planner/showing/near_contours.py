"""Which points of contours come near to an edge in the image, before it is asked whether they are hidden; compiled."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from aspectgraph.exact.lean import compiled, lean
from planner.showing.contours import CONNECTED, OWN, SHOWS

# points looked at on the piece of a contour that is near
_SAMPLES = 12
# of a neighbour, whose nearest points are excepted
_MORE = 48
# halvings on the way to where a line leaves the strip: a hundred-thousandth of its length
_STEPS = 17
# what is nearer than this to the plane of the nodal point is cut off, mm
_NEAREST_MM = 1e-3


@compiled(error_model="numpy")
def near_contours(
    poses: Any, pairs: Any, scale: Any, contours: Any, entities: Any, limits: Any, found: Any
) -> int:
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
        `PartLines.compiled`.
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
    image, corners = np.empty(vertices.shape), np.empty((vertices.shape[1], 2))
    boxes, front = np.empty((4, len(edge_ends))), np.empty(contours[2].shape[1], np.uint8)
    within = np.empty(len(edge_ends), np.uint8)
    n_active, last, count = 0, -1, 0
    for p in range(len(pairs)):
        pose, k = poses[pairs[p, 0]], pairs[p, 1]
        if pairs[p, 0] != last:
            last = pairs[p, 0]
            n_active = _project(pose, scale, contours, (active, image, boxes, front))
        r = belongs[k]
        a, b = _seen(pose, scale, ends[k, 0]), _seen(pose, scale, ends[k, 1])
        if a[2] <= _NEAREST_MM or b[2] <= _NEAREST_MM:
            continue
        low_x, high_x = min(a[0], b[0]) - reach, max(a[0], b[0]) + reach
        low_y, high_y = min(a[1], b[1]) - reach, max(a[1], b[1]) + reach
        n_corners = first[r + 1] - first[r]
        for w in range(n_corners):
            own = own_vertices[first[r] + w]
            corners[w, 0], corners[w, 1] = image[0, own], image[1, own]
        _overlap(boxes, low_x, low_y, high_x, high_y, within[:n_active])
        for i in range(n_active):
            if not within[i]:
                continue
            e = active[i]
            one, other = edge_ends[e, 0], edge_ends[e, 1]
            relation = relations[r, e]
            if relation == OWN:
                continue
            line = (image[0, one], image[1, one], image[0, other], image[1, other])
            start, stop = 0.0, 1.0
            if relation == CONNECTED:
                start, stop = _beyond(line, corners[:n_corners], near_own)
            if start >= stop:
                continue
            best = _nearest(line, start, stop, a, b)
            if _apart(line, best, a, b) >= reach:
                continue
            low = _edge_of(line, best, start, a, b, reach)
            high = _edge_of(line, best, stop, a, b, reach)
            samples = _MORE if relation == CONNECTED else _SAMPLES
            for s in range(samples + 1):
                t = best if s == samples else low + (high - low) * s / (samples - 1)
                if relation == CONNECTED and _beside(line, t, corners[:n_corners], near_own):
                    continue
                if count < len(found[0]):
                    share = _share_in_space(t, image[2, one], image[2, other])
                    found[0][count], found[1][count] = p, _apart(line, t, a, b)
                    for c in range(3):
                        u, v = vertices[c, one], vertices[c, other]
                        found[2][count, c] = u + share * (v - u)
                count += 1
    return count


@lean(error_model="numpy")
def _share_in_space(share: float, start_depth: float, end_depth: float) -> float:
    """Return the share of a line in space from its share in the image, where inverse depths are linear."""
    return share * start_depth / ((1.0 - share) * end_depth + share * start_depth)


@lean(error_model="numpy")
def _seen(pose: Any, scale: Any, point: Any) -> tuple[float, float, float]:
    """Return the image of a point in px, and its depth."""
    x, y, z = point[0] - pose[0, 3], point[1] - pose[1, 3], point[2] - pose[2, 3]
    u = pose[0, 0] * x + pose[1, 0] * y + pose[2, 0] * z
    v = pose[0, 1] * x + pose[1, 1] * y + pose[2, 1] * z
    w = pose[0, 2] * x + pose[1, 2] * y + pose[2, 2] * z
    safe = max(w, _NEAREST_MM)
    return scale[0] * u / safe + scale[2], scale[1] * v / safe + scale[3], w


@lean(error_model="numpy")
def _project(pose: Any, scale: Any, contours: Any, found: Any) -> int:
    """Write which edges may be contours, images and depths of the vertices, boxes around the edges, and front faces.

    Returns how many edges there are. Those behind are left out.
    """
    vertices, edge_ends, planes, faces, kinds = contours
    active, image, boxes, front = found
    _images(pose, scale, vertices, image)
    _front_faces((pose[0, 3], pose[1, 3], pose[2, 3]), planes, front)
    m = n = 0
    for e in range(len(edge_ends)):
        # no branch, as it would be guessed wrong too often
        active[m] = e
        m += SHOWS[kinds[e], front[faces[e, 0]] + front[faces[e, 1]]]
    for i in range(m):
        one, other = edge_ends[active[i], 0], edge_ends[active[i], 1]
        # nothing of a part so far beyond the stand-off is partly behind the camera and near to an edge in focus
        if image[2, one] <= _NEAREST_MM or image[2, other] <= _NEAREST_MM:
            continue
        active[n] = active[i]
        for c in range(2):
            boxes[c, n] = min(image[c, one], image[c, other])
            boxes[2 + c, n] = max(image[c, one], image[c, other])
        n += 1
    return n


@lean(error_model="numpy")
def _images(pose: Any, scale: Any, points: Any, image: Any) -> None:
    """Write `_seen` of points (3, v); a loop without calls, so that several are computed at once."""
    px, py, pz = pose[0, 3], pose[1, 3], pose[2, 3]
    ux, uy, uz = pose[0, 0], pose[1, 0], pose[2, 0]
    vx, vy, vz = pose[0, 1], pose[1, 1], pose[2, 1]
    wx, wy, wz = pose[0, 2], pose[1, 2], pose[2, 2]
    x0, x1, x2 = points[0], points[1], points[2]
    i0, i1, i2 = image[0], image[1], image[2]
    for k in range(len(x0)):
        x, y, z = x0[k] - px, x1[k] - py, x2[k] - pz
        depth = wx * x + wy * y + wz * z
        safe = depth if depth > _NEAREST_MM else _NEAREST_MM
        i0[k] = scale[0] * (ux * x + uy * y + uz * z) / safe + scale[2]
        i1[k] = scale[1] * (vx * x + vy * y + vz * z) / safe + scale[3]
        i2[k] = depth


@lean(error_model="numpy")
def _front_faces(eye: Any, planes: Any, front: Any) -> None:
    """Write of which planes (4, f) the eye is in front; computed as `_images` is."""
    x, y, z = eye
    nx, ny, nz, offset = planes[0], planes[1], planes[2], planes[3]
    for f in range(len(nx)):
        front[f] = nx[f] * x + ny[f] * y + nz[f] * z > offset[f]


@lean(error_model="numpy")
def _overlap(
    boxes: Any, low_x: float, low_y: float, high_x: float, high_y: float, within: Any
) -> None:
    """Write which boxes overlap with one; a loop without branches, so that several are compared at once."""
    x0, y0, x1, y1 = boxes[0], boxes[1], boxes[2], boxes[3]
    for i in range(len(within)):
        within[i] = (x1[i] >= low_x) & (x0[i] <= high_x) & (y1[i] >= low_y) & (y0[i] <= high_y)


@lean(error_model="numpy")
def _beyond(line: Any, corners: Any, near: float) -> tuple[float, float]:
    """Return what is left of a line when its ends are cut off as far as they are near to corners."""
    low, high = 0.0, 1.0
    dx, dy = line[2] - line[0], line[3] - line[1]
    square = dx * dx + dy * dy
    for w in range(len(corners)):
        x, y = corners[w, 0] - line[0], corners[w, 1] - line[1]
        if square <= 0.0:
            continue
        middle, off = (x * dx + y * dy) / square, (x * dy - y * dx) / square
        half = near * near / square - off * off
        if half <= 0.0:
            continue
        first, last = middle - math.sqrt(half), middle + math.sqrt(half)
        if first <= low:
            low = max(low, last)
        if last >= high:
            high = min(high, first)
    return low, high


@lean(error_model="numpy")
def _beside(line: Any, t: float, corners: Any, near: float) -> bool:
    """Tell whether a point of a line is near to one of the corners."""
    x, y = line[0] + t * (line[2] - line[0]), line[1] + t * (line[3] - line[1])
    within = False
    for w in range(len(corners)):
        within |= (x - corners[w, 0]) ** 2 + (y - corners[w, 1]) ** 2 < near * near
    return within


@lean(error_model="numpy")
def _apart(line: Any, t: float, a: Any, b: Any) -> float:
    """Return the distance of a point of a line from the segment ab."""
    x, y = line[0] + t * (line[2] - line[0]) - a[0], line[1] + t * (line[3] - line[1]) - a[1]
    dx, dy = b[0] - a[0], b[1] - a[1]
    square = dx * dx + dy * dy
    share = min(1.0, max(0.0, (x * dx + y * dy) / square)) if square > 0.0 else 0.0
    x, y = x - share * dx, y - share * dy
    return math.sqrt(x * x + y * y)


@lean(error_model="numpy")
def _nearest(line: Any, start: float, stop: float, a: Any, b: Any) -> float:
    """Return where a piece of a line is nearest to ab: at an end, beside an end of ab, or where they meet."""
    ux, uy, vx, vy = line[2] - line[0], line[3] - line[1], b[0] - a[0], b[1] - a[1]
    ax, ay = a[0] - line[0], a[1] - line[1]
    square, cross = ux * ux + uy * uy, ux * vy - uy * vx
    best, least = start, _apart(line, start, a, b)
    for k in range(4):
        if k == 0:
            t = stop
        elif k == 1:
            t = (ax * ux + ay * uy) / square if square > 0.0 else 0.0
        elif k == 2:
            t = ((ax + vx) * ux + (ay + vy) * uy) / square if square > 0.0 else 0.0
        else:
            t = (ax * vy - ay * vx) / cross if cross != 0.0 else 0.0
        t = min(stop, max(start, t))
        apart = _apart(line, t, a, b)
        if apart < least:
            best, least = t, apart
    return best


@lean(error_model="numpy")
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
