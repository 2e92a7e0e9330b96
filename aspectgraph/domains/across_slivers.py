"""What touches across slivers: cells too thin to count, shrunk to nothing.

A face of a wide cell that borders on a sliver is pushed along its normal, sliver after sliver, and cut to what of it
leaves each sliver through each face opposite, until it arrives at another wide cell. The pieces that arrive are where
the two cells touch.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from aspectgraph.cells.arrays import Complex
from aspectgraph.cells.measure import face_polygon
from compiled.decorators import entry_kernel, kernel, put

# a face counts as opposite where its outward normal leans less than this from the direction of the push, as a cosine
_OPPOSITE = 1e-3


class Piece(NamedTuple):
    """Part of the common boundary of two wide cells.

    Attributes
    ----------
    cells : tuple of int
    planes : tuple of int
        The planes crossed from one cell to the other.
    corners : ndarray, shape (m, 3)
        A convex polygon, in order, in grid steps.
    """

    cells: tuple[int, int]
    planes: tuple[int, ...]
    corners: np.ndarray


def pieces_across(
    cx: Complex, sides: np.ndarray, is_thin: np.ndarray, least_width: float
) -> list[Piece]:
    """Where wide cells touch across slivers.

    Parameters
    ----------
    cx : Complex
    sides : ndarray of int64, shape (k, 4)
        Faces between cells (`measure.interfaces`).
    is_thin : ndarray of bool
        Whether each cell is a sliver.
    least_width : float
        Pieces certainly narrower than that, in steps, are left out.
    """
    thin_ends = is_thin[sides[:, :2]]
    rows = np.flatnonzero(thin_ends.any(axis=1))
    if not len(rows):
        return []
    ends = np.concatenate([sides[rows, 0], sides[rows, 1]])
    rows_twice = np.concatenate([rows, rows])
    order = np.argsort(ends, kind="stable")
    first = np.searchsorted(ends[order], np.arange(len(is_thin) + 1))
    starts = np.flatnonzero(thin_ends.sum(axis=1) == 1)
    cells, lengths, paths, sizes, corners = _push_all(
        cx, sides, is_thin, first, rows_twice[order], starts, float(least_width)
    )
    path_ends = np.cumsum(lengths)
    corner_ends = np.cumsum(sizes)
    points = np.array(corners).reshape(-1, 3)
    return [
        Piece((int(u), int(v)), tuple(map(int, paths[p - length : p])), points[c - size : c])
        for (u, v), p, length, c, size in zip(
            cells, path_ends, lengths, corner_ends, sizes, strict=True
        )
    ]


@kernel
def _frame(normal):
    """Two unit vectors that with a unit normal form a right-handed frame, as rows."""
    axis = np.argmin(np.abs(normal))
    frame = np.empty((2, 3))
    first = np.zeros(3)
    first[axis] = 1.0
    first = first - normal[axis] * normal
    put(frame[0], first / np.sqrt((first * first).sum()))
    for k in range(3):
        i = (k + 1) % 3
        j = (k + 2) % 3
        frame[1, k] = normal[i] * frame[0, j] - normal[j] * frame[0, i]
    return frame


@kernel
def _flatten(corners, origin, frame):
    """Polygon in the frame's coordinates, counter-clockwise."""
    flat = np.empty((len(corners), 2))
    for k in range(len(corners)):
        for axis in range(2):
            flat[k, axis] = ((corners[k] - origin) * frame[axis]).sum()
    return flat if _doubled_area(flat) >= 0.0 else flat[::-1].copy()


@kernel
def _doubled_area(flat):
    total = 0.0
    for k in range(1, len(flat) - 1):
        p = flat[k] - flat[0]
        q = flat[k + 1] - flat[0]
        total += p[0] * q[1] - p[1] * q[0]
    return total


@kernel
def _perimeter(flat):
    total = 0.0
    for k in range(len(flat)):
        side = flat[k] - flat[k - 1]
        total += np.sqrt((side * side).sum())
    return total


@kernel
def _clip(flat, clipper):
    """Common part of two convex counter-clockwise polygons (Sutherland and Hodgman 1974)."""
    for k in range(len(clipper)):
        if len(flat) < 3:
            break
        a = clipper[k - 1]
        along = clipper[k] - a
        cut = np.empty((2 * len(flat), 2))
        n = 0
        for i in range(len(flat)):
            p = flat[i - 1]
            q = flat[i]
            s = along[0] * (p[1] - a[1]) - along[1] * (p[0] - a[0])
            t = along[0] * (q[1] - a[1]) - along[1] * (q[0] - a[0])
            if (s < 0.0 < t) or (t < 0.0 < s):
                put(cut[n], p + s / (s - t) * (q - p))
                n += 1
            if t >= 0.0:
                put(cut[n], q)
                n += 1
        flat = cut[:n].copy()
    return flat


@kernel
def _normal_out_of(cx, sides, row, cell):
    """Unit normal of a face that points out of one of its two cells."""
    plane = cx.planes[sides[row, 2]]
    normal = np.array([np.float64(plane[0]), np.float64(plane[1]), np.float64(plane[2])])
    normal /= np.sqrt((normal * normal).sum())
    return -normal if sides[row, 0] == cell else normal


@entry_kernel
def _push_all(cx, sides, is_thin, first, rows, starts, least_width):
    """Push the faces `starts`; `rows[first[c]:first[c + 1]]` are the faces of sliver c."""
    cells = [(0, 0) for _ in range(0)]
    lengths = [0 for _ in range(0)]
    paths = [0 for _ in range(0)]
    sizes = [0 for _ in range(0)]
    corners = [0.0 for _ in range(0)]
    for start in starts:
        wide = sides[start, 0]
        sliver = sides[start, 1]
        if is_thin[wide]:
            wide, sliver = sliver, wide
        polygon = face_polygon(cx, sides[start, 3])
        origin = polygon[0].copy()
        direction = _normal_out_of(cx, sides, start, wide)
        frame = _frame(direction)
        flat = _flatten(polygon, origin, frame)
        # the state of each level of the descent: sliver, next of its faces, polygon that entered it, face it entered by
        slivers = [sliver]
        following = [first[sliver]]
        entered = [flat]
        path = [start]
        while len(slivers) > 0:
            here = slivers[-1]
            if following[-1] == first[here + 1] or _is_narrow(entered[-1], least_width):
                slivers.pop()
                following.pop()
                entered.pop()
                path.pop()
                continue
            row = rows[following[-1]]
            following[-1] += 1
            if (
                row == path[-1]
                or (_normal_out_of(cx, sides, row, here) * direction).sum() < _OPPOSITE
            ):
                continue
            piece = _clip(entered[-1], _flatten(face_polygon(cx, sides[row, 3]), origin, frame))
            if _is_narrow(piece, least_width):
                continue
            there = sides[row, 1] if sides[row, 0] == here else sides[row, 0]
            if is_thin[there]:
                if there not in slivers:
                    slivers.append(there)
                    following.append(first[there])
                    entered.append(piece)
                    path.append(row)
            elif wide < there:
                cells.append((wide, there))
                lengths.append(len(path) + 1)
                for crossed in path:
                    paths.append(sides[crossed, 2])
                paths.append(sides[row, 2])
                sizes.append(len(piece))
                for point in piece:
                    for axis in range(3):
                        corners.append(
                            origin[axis] + point[0] * frame[0, axis] + point[1] * frame[1, axis]
                        )
    return cells, lengths, paths, sizes, corners


@kernel
def _is_narrow(flat, least_width):
    """Whether no disc of the least width fits for certain: its radius is at most twice the area over the perimeter."""
    return len(flat) < 3 or 2.0 * _doubled_area(flat) < least_width * _perimeter(flat)
