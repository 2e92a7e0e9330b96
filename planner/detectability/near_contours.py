"""Which points of contours come near to an edge in the image, before it is asked whether they are hidden; compiled."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ground.decorators import entry_kernel, kernel_without_refcounts
from planner.detectability.corners import CONNECTED, OWN, SHOWS

# points looked at on the piece of a contour that is near
_SAMPLES = 12
# of a neighbour, whose nearest points are excepted
_MORE = 48
# beside a point, where that is twice as long as what is asked for at most: one each two pixels, but so many
_FEW = 4
# halvings on the way to where a line leaves the strip: a hundred-thousandth of its length
_STEPS = 17
# upright strips of the image, in which edges are looked up where a pose has at least so many pairs
_BINS = 64
_MANY_PAIRS = 24
# of the curve of a chord: each as straight as its chord is in a hundredth of the bulge
_PIECES = 10
# of the curve of a chord beside an edge: so many that each leaves the curve by so many px, which distances lose; but at
# most so many pieces, and then they lose more
_SAG_PX = 0.03
# and distances lose this share of the bulge, by which a parabola leaves the arc of a chord of 45°
_UNTRUE = 0.01
_MOST_PIECES = 24
# steps to the point of a distorted line that is nearest
_NEWTON_STEPS = 3
# of the image of a length away from the axis to that on the axis, for fields up to 60° off it
_LONGER = 2.0
# what is nearer than this to the plane of the nodal point is cut off, mm
_NEAREST_MM = 1e-3
# if only some visible point of a pair is asked for, one of so many is looked at first
_EVERY = 6


@entry_kernel(error_model="numpy")
def near_contours(
    poses: Any,
    pairs: Any,
    scale: Any,
    lens: Any,
    contours: Any,
    bulges: Any,
    entities: Any,
    limits: Any,
    found: Any,
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
    lens : array (5,) or (0,)
        Coefficients of the distortion, as `Distortion.coefficients`; empty without it. Distances are in the image that
        the camera delivers. Where lines may be near is looked up in the one without distortion.
    contours : tuple
        `PartLines.compiled`.
    bulges : array (m, 3)
        `PartLines.bulges`. Distances are from curves, not from their chords; those of edges may be too short by
        `_SAG_PX` and a hundredth of the bulge, and are never too long for that.
    entities : tuple
        Ends (k, 2, 3), number (k,) of what they belong to; of that, relations (r, m), vertices (w,) and where those of
        each begin (r + 1,).
    limits : tuple of float
        How near, and how near to its own vertices an entity's neighbours may be, px; how many times as far what is
        so near may be in the image without distortion; and how many times as long a short way in that image may be
        in the camera's.
    found : tuple
        To be written: number of the pair (c,), distance in px (c,), place in mm (c, 3). What does not fit is counted.
    """
    vertices = contours[0]
    edge_ends = contours[1]
    ends, belongs, relations, own_vertices, first = entities
    reach, near_own, widen, n_samples = limits
    wide = reach * widen
    active = np.empty(len(edge_ends), np.int64)
    image = np.empty(vertices.shape)
    corners = np.empty((vertices.shape[1], 6))
    boxes = np.empty((4, len(edge_ends)))
    front = np.empty(contours[2].shape[1], np.uint8)
    within = np.empty(len(edge_ends) + 1, np.int64)
    of_bins = np.empty(_BINS + 1, np.int64)
    # an edge is in all bins at most
    in_bins = np.empty(_BINS * len(edge_ends), np.int64)
    extra = np.empty(len(edge_ends))
    n_active = 0
    last = -1
    count = 0
    for p in range(len(pairs)):
        pose = poses[pairs[p, 0]]
        k = pairs[p, 1]
        if pairs[p, 0] != last:
            last = pairs[p, 0]
            n_active = _project(pose, scale, contours, bulges, (active, image, boxes, front, extra))
            _sort_into_bins(boxes, n_active * _are_many(pairs, p), scale, of_bins, in_bins)
        r = belongs[k]
        a = _seen(pose, scale, ends[k, 0])
        b = _seen(pose, scale, ends[k, 1])
        if a[2] <= _NEAREST_MM or b[2] <= _NEAREST_MM:
            continue
        n_corners = _corner_images(
            own_vertices, first[r], first[r + 1], image, (scale, lens), corners
        )
        near = (corners[:n_corners], near_own, wide)
        window = _around(a, b, wide)
        n_within = _overlap(boxes, n_active, window, (of_bins, in_bins, scale), within)
        for i in within[:n_within]:
            e = active[i]
            first_end = edge_ends[e, 0]
            other = edge_ends[e, 1]
            relation = relations[r, e]
            if relation == OWN:
                continue
            line = (image[0, first_end], image[1, first_end], image[0, other], image[1, other])
            curve = (pose, (scale, lens), bulges[e])
            place = (vertices, first_end, other, image[2, first_end], image[2, other], 0.0, 1.0)
            contour = (line, (a, b), relation, extra[i], reach, n_samples)
            count = _write_contour(p, contour, near, curve, place, found, count)
    return count


@entry_kernel(error_model="numpy")
def choose_tested(
    pair: Any, distance: Any, reach: float, is_first: bool, has: Any, rows: Any
) -> int:
    """Write which near points are looked at if some visible one of a pair is enough; return how many there are.

    Parameters
    ----------
    pair : array of int (c,)
        Which pair each point is near to.
    distance : array (c,)
        How near, px.
    reach : float
        How near a point has to be.
    is_first : bool
        Whether these are the first that are looked at, or the others.
    has : array of bool (p,)
        Pairs that have a visible point.
    rows : array of int (c,)
        To be written.
    """
    count = 0
    for c in range(len(pair)):
        rows[count] = c
        # no branch, as it would be guessed wrong too often
        count += (distance[c] < reach) & ((c % _EVERY == 0) == is_first) & (not has[pair[c]])
    return count


@entry_kernel(error_model="numpy")
def rays_to(poses: Any, rows: Any, places: Any, centre: Any, rays: Any) -> None:
    """Write rays from cameras to places, as `RayScene.are_blocked` takes them.

    Parameters
    ----------
    poses : array (n, 4, 4)
        Cam2world.
    rows : array of int (q,)
        The pose of each ray.
    places : array (q, 3)
        Where they go, mm.
    centre : array (3,)
        See `RayScene`.
    rays : array of float32 (q, 6)
        To be written.
    """
    for q in range(len(rows)):
        for i in range(3):
            eye = poses[rows[q], i, 3]
            rays[q, i] = eye - centre[i]
            rays[q, 3 + i] = places[q, i] - eye


@kernel_without_refcounts(error_model="numpy")
def _write_contour(
    p: int, contour: Any, near: Any, curve: Any, place: Any, found: Any, count: int
) -> int:
    """Write points of a contour that comes near to an edge or point; return how many there are in all."""
    line, (a, b), relation, extra, reach, n_samples = contour
    ends = (place[0], place[1], place[2])
    scanned = a[0] == b[0] and a[1] == b[1]
    if extra > 0.0 and scanned and relation != CONNECTED:
        return int(_write_curve(p, a, reach, curve, ends, found, count))
    if extra > 0.0:
        arc = (line, (a, b), relation, extra, n_samples)
        return int(_write_arc(p, arc, near, curve, ends, found, count))
    samples = _MORE if relation == CONNECTED else _SAMPLES
    piece = (line, (a, b), relation, samples, 0.0)
    return int(_write_line(p, piece, near, curve[1], place, found, count))


@kernel_without_refcounts(error_model="numpy")
def _corner_images(
    own_vertices: Any, begin: int, end: int, image: Any, view: Any, corners: Any
) -> int:
    """Write the images of an entity's own vertices and how distortion stretches there; return how many there are."""
    for w in range(end - begin):
        vertex = own_vertices[begin + w]
        corners[w, 0] = image[0, vertex]
        corners[w, 1] = image[1, vertex]
        # without distortion, nothing stretches
        corners[w, 2] = 1.0
        corners[w, 3] = 0.0
        corners[w, 4] = 0.0
        corners[w, 5] = 1.0
        if len(view[1]) > 0:
            stretch = _stretch(image[0, vertex], image[1, vertex], view)
            for c in range(4):
                corners[w, 2 + c] = stretch[c]
    return end - begin


@kernel_without_refcounts(error_model="numpy")
def _write_arc(
    p: int, piece: Any, near: Any, curve: Any, place: Any, found: Any, count: int
) -> int:
    """Write points of a curve that comes near to an edge, as of straight pieces; return how many there are in all.

    A piece leaves the curve by its share of the bulge at most, squared. Distances are less by that.
    """
    line, (a, b), relation, extra, n_samples = piece
    corners, near_own, reach = near
    pose, view, bulge = curve
    vertices, first_end, other = place
    best = _nearest(line, 0.0, 1.0, a, b)
    if _apart(line, best, a, b) >= reach + extra:
        return count
    n = int(min(math.ceil(math.sqrt(extra / _SAG_PX)), _MOST_PIECES))
    loss = extra * (1.0 / (n * n) + _UNTRUE) * n_samples
    samples = max(2, (_MORE if relation == CONNECTED else _SAMPLES) // n)
    wider = (corners, near_own, reach + loss)
    before = _on_curve(pose, view[0], bulge, vertices, first_end, other, 0.0)
    for s in range(n):
        after = _on_curve(pose, view[0], bulge, vertices, first_end, other, (s + 1) / n)
        part = ((before[0], before[1], after[0], after[1]), (a, b), relation, samples, loss)
        on_chord = (vertices, first_end, other, before[2], after[2], s / n, 1.0 / n)
        count = _write_line(p, part, wider, view, on_chord, found, count)
        before = after
    return count


@kernel_without_refcounts(error_model="numpy")
def _write_line(
    p: int, piece: Any, near: Any, view: Any, place: Any, found: Any, count: int
) -> int:
    """Write points of the part of a contour that comes near to an edge; return how many there are in all."""
    line, (a, b), relation, samples, loss = piece
    corners, near_own, reach = near
    start = 0.0
    stop = 1.0
    if relation == CONNECTED:
        start, stop = _beyond(line, corners, near_own)
    if start >= stop:
        return count
    best = _nearest(line, start, stop, a, b)
    if _apart(line, best, a, b) >= reach:
        return count
    low = _edge_of(line, best, start, a, b, reach)
    high = _edge_of(line, best, stop, a, b, reach)
    if len(view[1]) > 0:
        best = _nearest_in_view(line, (best, start, stop), a, b, view)
    sampled = (line, (best, low, high), (a, b), relation, samples, loss)
    return int(_write_samples(p, sampled, near, view, place, found, count))


@kernel_without_refcounts(error_model="numpy")
def _write_samples(
    p: int, piece: Any, near: Any, view: Any, place: Any, found: Any, count: int
) -> int:
    """Write points of a piece of a contour that comes near to an edge; return how many there are in all."""
    line, (best, low, high), (a, b), relation, samples, loss = piece
    corners, near_own, reach = near
    vertices, first_end, other, start_depth, end_depth, begin, width = place
    if a[0] == b[0] and a[1] == b[1]:
        samples = max(_FEW, int(reach))
    for s in range(samples + 1):
        t = best if s == samples else low + (high - low) * s / (samples - 1)
        if relation == CONNECTED and _beside(line, t, corners, near_own):
            continue
        if count < len(found[0]):
            share = begin + width * _share_in_space(t, start_depth, end_depth)
            found[0][count] = p
            found[1][count] = max(0.0, _apart_in_view(line, t, a, b, view) - loss)
            for c in range(3):
                u = vertices[c, first_end]
                v = vertices[c, other]
                found[2][count, c] = u + share * (v - u)
        count += 1
    return count


@kernel_without_refcounts(error_model="numpy")
def _write_curve(
    p: int, a: Any, reach: float, curve: Any, place: Any, found: Any, count: int
) -> int:
    """Write where the pieces of a curve that come near to a point are nearest to it; return how many there are in all.

    What is written is on the chord, since the part consists of chords where rays look for what hides it.
    """
    pose, view, bulge = curve
    vertices, first_end, other = place
    x, y = _in_view(a[0], a[1], view)
    start = _on_curve(pose, view[0], bulge, vertices, first_end, other, 0.0)
    before = _in_view(start[0], start[1], view)
    for s in range(1, _PIECES + 1):
        share = s / _PIECES
        end = _on_curve(pose, view[0], bulge, vertices, first_end, other, share)
        after = _in_view(end[0], end[1], view)
        dx = after[0] - before[0]
        dy = after[1] - before[1]
        square = dx * dx + dy * dy
        along = (x - before[0]) * dx + (y - before[1]) * dy
        along = min(1.0, max(0.0, along / square)) if square > 0.0 else 0.0
        distance = math.hypot(before[0] + along * dx - x, before[1] + along * dy - y)
        if distance < reach:
            if count < len(found[0]):
                share = (s - 1 + along) / _PIECES
                found[0][count] = p
                found[1][count] = distance
                for c in range(3):
                    u = vertices[c, first_end]
                    found[2][count, c] = u + share * (vertices[c, other] - u)
            count += 1
        before = after
    return count


@kernel_without_refcounts(error_model="numpy")
def _on_curve(
    pose: Any, scale: Any, bulge: Any, vertices: Any, one: int, other: int, share: float
) -> tuple[float, float, float]:
    """Return the image of a point of a curve in px, and its depth."""
    lift = 4.0 * share * (1.0 - share)
    point = (
        vertices[0, one] + share * (vertices[0, other] - vertices[0, one]) + lift * bulge[0],
        vertices[1, one] + share * (vertices[1, other] - vertices[1, one]) + lift * bulge[1],
        vertices[2, one] + share * (vertices[2, other] - vertices[2, one]) + lift * bulge[2],
    )
    return _seen(pose, scale, point)


@kernel_without_refcounts(error_model="numpy")
def _share_in_space(share: float, start_depth: float, end_depth: float) -> float:
    """Return the share of a line in space from its share in the image, where inverse depths are linear."""
    return share * start_depth / ((1.0 - share) * end_depth + share * start_depth)


@kernel_without_refcounts(error_model="numpy")
def _seen(pose: Any, scale: Any, point: Any) -> tuple[float, float, float]:
    """Return the image of a point in px, and its depth."""
    x = point[0] - pose[0, 3]
    y = point[1] - pose[1, 3]
    z = point[2] - pose[2, 3]
    u = pose[0, 0] * x + pose[1, 0] * y + pose[2, 0] * z
    v = pose[0, 1] * x + pose[1, 1] * y + pose[2, 1] * z
    w = pose[0, 2] * x + pose[1, 2] * y + pose[2, 2] * z
    safe = max(w, _NEAREST_MM)
    return scale[0] * u / safe + scale[2], scale[1] * v / safe + scale[3], w


@kernel_without_refcounts(error_model="numpy")
def _project(pose: Any, scale: Any, contours: Any, bulges: Any, found: Any) -> int:
    """Write which edges may be contours, images and depths of the vertices, boxes around the edges, and front faces.

    And how far curves leave their chords, px: boxes are for curves. Returns how many edges there are. Those behind are
    left out.
    """
    vertices, edge_ends, planes, faces, kinds = contours
    active, image, boxes, front, extra = found
    _images(pose, scale, vertices, image)
    _front_faces((pose[0, 3], pose[1, 3], pose[2, 3]), planes, front)
    m = n = 0
    for e in range(len(edge_ends)):
        # no branch, as it would be guessed wrong too often
        active[m] = e
        m += SHOWS[kinds[e], front[faces[e, 0]] + front[faces[e, 1]]]
    for i in range(m):
        first_end = edge_ends[active[i], 0]
        other = edge_ends[active[i], 1]
        # nothing of a part so far beyond the stand-off is partly behind the camera and near to an edge in focus
        if image[2, first_end] <= _NEAREST_MM or image[2, other] <= _NEAREST_MM:
            continue
        active[n] = active[i]
        bulge = bulges[active[n]]
        size = math.sqrt(bulge[0] * bulge[0] + bulge[1] * bulge[1] + bulge[2] * bulge[2])
        px = max(abs(scale[0]), abs(scale[1])) / min(image[2, first_end], image[2, other])
        # oblique images of a bulge are a little longer off the axis
        extra[n] = _LONGER * size * px
        for c in range(2):
            boxes[c, n] = min(image[c, first_end], image[c, other]) - extra[n]
            boxes[2 + c, n] = max(image[c, first_end], image[c, other]) + extra[n]
        n += 1
    return n


@kernel_without_refcounts(error_model="numpy")
def _images(pose: Any, scale: Any, points: Any, image: Any) -> None:
    """Write `_seen` of points (3, v); a loop without calls, so that several are computed at once."""
    px = pose[0, 3]
    py = pose[1, 3]
    pz = pose[2, 3]
    ux = pose[0, 0]
    uy = pose[1, 0]
    uz = pose[2, 0]
    vx = pose[0, 1]
    vy = pose[1, 1]
    vz = pose[2, 1]
    wx = pose[0, 2]
    wy = pose[1, 2]
    wz = pose[2, 2]
    x0 = points[0]
    x1 = points[1]
    x2 = points[2]
    i0 = image[0]
    i1 = image[1]
    i2 = image[2]
    for k in range(len(x0)):
        x = x0[k] - px
        y = x1[k] - py
        z = x2[k] - pz
        depth = wx * x + wy * y + wz * z
        safe = depth if depth > _NEAREST_MM else _NEAREST_MM
        i0[k] = scale[0] * (ux * x + uy * y + uz * z) / safe + scale[2]
        i1[k] = scale[1] * (vx * x + vy * y + vz * z) / safe + scale[3]
        i2[k] = depth


@kernel_without_refcounts(error_model="numpy")
def _front_faces(eye: Any, planes: Any, front: Any) -> None:
    """Write of which planes (4, f) the eye is in front; computed as `_images` is."""
    x, y, z = eye
    nx = planes[0]
    ny = planes[1]
    nz = planes[2]
    offset = planes[3]
    for f in range(len(nx)):
        front[f] = nx[f] * x + ny[f] * y + nz[f] * z > offset[f]


@kernel_without_refcounts(error_model="numpy")
def _around(a: Any, b: Any, reach: float) -> tuple[float, float, float, float]:
    """Return the left, upper, right and lower side of a window so far around a line ab."""
    return (
        min(a[0], b[0]) - reach,
        min(a[1], b[1]) - reach,
        max(a[0], b[0]) + reach,
        max(a[1], b[1]) + reach,
    )


@kernel_without_refcounts(error_model="numpy")
def _bin(x: float, scale: Any) -> int:
    """Return the upright strip of the image that holds a coordinate x; the outer ones have no end."""
    width = max(2.0 * abs(scale[2]), 1.0) / _BINS
    return int(min(max(x / width, 0.0), _BINS - 1.0))


@kernel_without_refcounts(error_model="numpy")
def _sort_into_bins(boxes: Any, n: int, scale: Any, of_bins: Any, in_bins: Any) -> None:
    """Write which of n boxes each strip of the image holds, and where those of each strip begin (bins + 1,)."""
    of_bins[:] = 0
    for i in range(n):
        for s in range(_bin(boxes[0, i], scale), _bin(boxes[2, i], scale) + 1):
            of_bins[s + 1] += 1
    for s in range(_BINS):
        of_bins[s + 1] += of_bins[s]
    total = of_bins[_BINS]
    for i in range(n - 1, -1, -1):
        for s in range(_bin(boxes[0, i], scale), _bin(boxes[2, i], scale) + 1):
            of_bins[s + 1] -= 1
            in_bins[of_bins[s + 1]] = i
    # each start is in the place of the next one
    for s in range(_BINS):
        of_bins[s] = of_bins[s + 1]
    of_bins[_BINS] = total


@kernel_without_refcounts(error_model="numpy")
def _are_many(pairs: Any, p: int) -> bool:
    """Return whether `_MANY_PAIRS` have the same pose, from one on; they are in the order of poses."""
    last = p + _MANY_PAIRS - 1
    return last < len(pairs) and pairs[last, 0] == pairs[p, 0]


@kernel_without_refcounts(error_model="numpy")
def _overlap(boxes: Any, n_active: int, window: Any, bins: Any, within: Any) -> int:
    """Write which of the first boxes overlap with a window; return how many do. Strips may be without boxes."""
    low_x, low_y, high_x, high_y = window
    if bins[0][_BINS] > 0:
        return int(_overlap_in_bins(boxes, window, bins, within))
    n = 0
    for i in range(n_active):
        within[n] = i
        # no branch, as below
        n += (
            (boxes[2, i] >= low_x)
            & (boxes[0, i] <= high_x)
            & (boxes[3, i] >= low_y)
            & (boxes[1, i] <= high_y)
        )
    return n


@kernel_without_refcounts(error_model="numpy")
def _overlap_in_bins(boxes: Any, window: Any, bins: Any, within: Any) -> int:
    """Do what `_overlap` does, of the boxes in the strips of the window."""
    low_x, low_y, high_x, high_y = window
    of_bins, in_bins, scale = bins
    first = _bin(low_x, scale)
    n = 0
    for s in range(first, _bin(high_x, scale) + 1):
        for q in range(of_bins[s], of_bins[s + 1]):
            i = in_bins[q]
            within[n] = i
            # of several strips that hold both, the first one counts; no branch, as it would be guessed wrong too often
            counts = (s == first) | (_bin(boxes[0, i], scale) == s)
            n += (
                counts
                & (boxes[2, i] >= low_x)
                & (boxes[0, i] <= high_x)
                & (boxes[3, i] >= low_y)
                & (boxes[1, i] <= high_y)
            )
    return n


@kernel_without_refcounts(error_model="numpy")
def _beyond(line: Any, corners: Any, near: float) -> tuple[float, float]:
    """Return what is left of a line when its ends are cut off as far as they are near to corners."""
    low = 0.0
    high = 1.0
    for w in range(len(corners)):
        dx, dy = _stretched(line[2] - line[0], line[3] - line[1], corners[w])
        square = dx * dx + dy * dy
        x, y = _stretched(corners[w, 0] - line[0], corners[w, 1] - line[1], corners[w])
        if square <= 0.0:
            continue
        middle = (x * dx + y * dy) / square
        off = (x * dy - y * dx) / square
        half = near * near / square - off * off
        if half <= 0.0:
            continue
        first = middle - math.sqrt(half)
        last = middle + math.sqrt(half)
        if first <= low:
            low = max(low, last)
        if last >= high:
            high = min(high, first)
    return low, high


@kernel_without_refcounts(error_model="numpy")
def _beside(line: Any, t: float, corners: Any, near: float) -> bool:
    """Tell whether a point of a line is near to one of the corners."""
    x = line[0] + t * (line[2] - line[0])
    y = line[1] + t * (line[3] - line[1])
    within = False
    for w in range(len(corners)):
        dx, dy = _stretched(x - corners[w, 0], y - corners[w, 1], corners[w])
        within |= dx**2 + dy**2 < near * near
    return within


@kernel_without_refcounts(error_model="numpy")
def _stretched(x: float, y: float, corner: Any) -> tuple[float, float]:
    """Return a short way from a corner as it is in the camera's image; see `_corner_images`."""
    return corner[2] * x + corner[3] * y, corner[4] * x + corner[5] * y


@kernel_without_refcounts(error_model="numpy")
def _in_view(x: float, y: float, view: Any) -> tuple[float, float]:
    """Return where a camera images what it would image at (x, y) without distortion, px."""
    scale, lens = view
    if len(lens) == 0:
        return x, y
    u = (x - scale[2]) / scale[0]
    v = (y - scale[3]) / scale[1]
    square = u * u + v * v
    radial = 1.0 + square * (lens[0] + square * (lens[1] + square * lens[4]))
    across = u * radial + 2.0 * lens[2] * u * v + lens[3] * (square + 2.0 * u * u)
    down = v * radial + lens[2] * (square + 2.0 * v * v) + 2.0 * lens[3] * u * v
    return scale[0] * across + scale[2], scale[1] * down + scale[3]


@kernel_without_refcounts(error_model="numpy")
def _stretch(x: float, y: float, view: Any) -> tuple[float, float, float, float]:
    """Return how `_in_view` changes with x and y: across with both, and down with both."""
    scale, lens = view
    if len(lens) == 0:
        return 1.0, 0.0, 0.0, 1.0
    u = (x - scale[2]) / scale[0]
    v = (y - scale[3]) / scale[1]
    square = u * u + v * v
    radial = 1.0 + square * (lens[0] + square * (lens[1] + square * lens[4]))
    slope = 2.0 * (lens[0] + square * (2.0 * lens[1] + 3.0 * square * lens[4]))
    mixed = slope * u * v + 2.0 * lens[2] * u + 2.0 * lens[3] * v
    return (
        radial + slope * u * u + 2.0 * lens[2] * v + 6.0 * lens[3] * u,
        mixed * scale[0] / scale[1],
        mixed * scale[1] / scale[0],
        radial + slope * v * v + 6.0 * lens[2] * v + 2.0 * lens[3] * u,
    )


@kernel_without_refcounts(error_model="numpy")
def _apart_in_view(line: Any, t: float, a: Any, b: Any, view: Any) -> float:
    """Return the distance of a point of a line from the segment ab in the camera's image, where both are curves."""
    if len(view[1]) == 0:
        return float(_apart(line, t, a, b))
    px = line[0] + t * (line[2] - line[0])
    py = line[1] + t * (line[3] - line[1])
    dx = b[0] - a[0]
    dy = b[1] - a[1]
    square = dx * dx + dy * dy
    share = 0.0
    if square > 0.0:
        share = min(1.0, max(0.0, ((px - a[0]) * dx + (py - a[1]) * dy) / square))
    x, y = _in_view(px, py, view)
    u, v = _in_view(a[0] + share * dx, a[1] + share * dy, view)
    nearest = math.hypot(x - u, y - v)
    for _ in range(_NEWTON_STEPS):
        s = _stretch(a[0] + share * dx, a[1] + share * dy, view)
        along = s[0] * dx + s[1] * dy
        down = s[2] * dx + s[3] * dy
        square = along * along + down * down
        if square <= 0.0:
            break
        share = min(1.0, max(0.0, share + ((x - u) * along + (y - v) * down) / square))
        u, v = _in_view(a[0] + share * dx, a[1] + share * dy, view)
        nearest = min(nearest, math.hypot(x - u, y - v))
    return nearest


@kernel_without_refcounts(error_model="numpy")
def _nearest_in_view(line: Any, shares: Any, a: Any, b: Any, view: Any) -> float:
    """Return where a piece of a line is nearest to ab in the camera's image, if it is near; see `_nearest`.

    So near to each other, distortion is the same linear map for both.
    """
    best, start, stop = shares
    x = line[0] + best * (line[2] - line[0])
    y = line[1] + best * (line[3] - line[1])
    s = _stretch(x, y, view)
    ways = (line[0] - x, line[1] - y, line[2] - x, line[3] - y)
    there = (
        s[0] * ways[0] + s[1] * ways[1],
        s[2] * ways[0] + s[3] * ways[1],
        s[0] * ways[2] + s[1] * ways[3],
        s[2] * ways[2] + s[3] * ways[3],
    )
    ends = (a[0] - x, a[1] - y, b[0] - x, b[1] - y)
    from_end = (s[0] * ends[0] + s[1] * ends[1], s[2] * ends[0] + s[3] * ends[1])
    to_end = (s[0] * ends[2] + s[1] * ends[3], s[2] * ends[2] + s[3] * ends[3])
    t = _nearest(there, start, stop, from_end, to_end)
    if _apart_in_view(line, t, a, b, view) < _apart_in_view(line, best, a, b, view):
        return float(t)
    return float(best)


@kernel_without_refcounts(error_model="numpy")
def _apart(line: Any, t: float, a: Any, b: Any) -> float:
    """Return the distance of a point of a line from the segment ab."""
    x = line[0] + t * (line[2] - line[0]) - a[0]
    y = line[1] + t * (line[3] - line[1]) - a[1]
    dx = b[0] - a[0]
    dy = b[1] - a[1]
    square = dx * dx + dy * dy
    share = min(1.0, max(0.0, (x * dx + y * dy) / square)) if square > 0.0 else 0.0
    x = x - share * dx
    y = y - share * dy
    return math.sqrt(x * x + y * y)


@kernel_without_refcounts(error_model="numpy")
def _nearest(line: Any, start: float, stop: float, a: Any, b: Any) -> float:
    """Return where a piece of a line is nearest to ab: at an end, beside an end of ab, or where they meet."""
    ux = line[2] - line[0]
    uy = line[3] - line[1]
    vx = b[0] - a[0]
    vy = b[1] - a[1]
    ax = a[0] - line[0]
    ay = a[1] - line[1]
    square = ux * ux + uy * uy
    cross = ux * vy - uy * vx
    best = start
    nearest = _apart(line, start, a, b)
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
        if apart < nearest:
            best = t
            nearest = apart
    return best


@kernel_without_refcounts(error_model="numpy")
def _edge_of(line: Any, inside: float, limit: float, a: Any, b: Any, reach: float) -> float:
    """Return how far from a near point towards an end of the line it stays near, by halving."""
    if _apart(line, limit, a, b) < reach:
        return limit
    near = inside
    far = limit
    for _ in range(_STEPS):
        middle = (near + far) / 2.0
        if _apart(line, middle, a, b) < reach:
            near = middle
        else:
            far = middle
    return near
