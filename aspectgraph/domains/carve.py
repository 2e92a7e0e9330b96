"""Take the inside of the solid out of a joint complex.

Points inside the solid see no entity, so only cells with an empty list need cutting: along the convex pieces of the
faces that pass through them. A piece enters the complex as a free facet on the plane of its face; its sides are cut out
by planes through its sides and (to the grid) perpendicular to the face, which themselves never cut a cell.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from aspectgraph.cells.arrays import (
    CELL_CHILD,
    CELL_PLANE,
    CROSSED,
    FACE_CHILD,
    FACE_PLANE,
    INSIDE,
    N_CELLS,
    NEGATIVE,
    POSITIVE,
    UNKNOWN,
    Complex,
    add_edge,
    add_face,
    add_vertex,
    cell_centre,
    face_polygon,
    push_edge,
)
from aspectgraph.cells.split import face_side, partition, refresh_cell, refresh_face, split_face
from aspectgraph.exact.grid import as_queries, plane_through, sign_at_point
from aspectgraph.visibility.scene import Scene
from ground.decorators import entry_kernel, kernel, put

# reach of the perpendicular planes, in steps: enough to be perpendicular to 1e-5, little enough for 63 bits
_NORMAL_STEPS = 1 << 16


class Facets(NamedTuple):
    """Convex polygons on known planes.

    Attributes
    ----------
    planes : ndarray of int64, shape (m, 4)
        Perpendicular planes through the sides, loop after loop.
    first : ndarray of int32, shape (n + 1,)
        Where the sides of each polygon start.
    face : ndarray of int32, shape (n,)
        The face each polygon belongs to.
    """

    planes: np.ndarray
    first: np.ndarray
    face: np.ndarray


def surface_facets(scene: Scene) -> Facets:
    """Convex facets of the solid's whole surface."""
    faces = scene.pieces.face
    normals = scene.planes[scene.plane_of_face[faces], :3] * scene.side_of_face[faces, None]
    lengths = np.linalg.norm(normals.astype(float), axis=1, keepdims=True)
    steps = np.rint(normals / lengths * _NORMAL_STEPS).astype(np.int64)
    planes, sizes = _perpendicular_planes(scene.points, scene.pieces, steps, scene.resolution)
    has_facets = sizes > 0
    first = np.concatenate([[0], np.cumsum(sizes[has_facets])]).astype(np.int32)
    return Facets(planes, first, faces[has_facets])


@entry_kernel
def _perpendicular_planes(points, pieces, steps, resolution):
    """Planes through the sides of every piece and its normal, and how many each has; none for a piece without area."""
    planes = np.empty((len(pieces.vertices), 4), np.int64)
    sizes = np.zeros(len(pieces.face), np.int64)
    n = 0
    for k in range(len(pieces.face)):
        loop = _true_corners(
            points, pieces.vertices[pieces.first[k] : pieces.first[k + 1]], resolution
        )
        if len(loop) < 3:
            continue
        sizes[k] = len(loop)
        for i in range(len(loop)):
            p = points[loop[i]]
            q = points[loop[(i + 1) % len(loop)]]
            put(planes[n], plane_through(p, q, p + steps[k]))
            n += 1
    return planes[:n].copy(), sizes


@kernel
def _true_corners(points, loop, resolution):
    """Drop vertices within the resolution of the line through their neighbours."""
    corners = [v for v in loop]  # noqa: C416 - numba makes no list of an array otherwise
    k = 0
    while k < len(corners) and len(corners) > 2:
        before = points[corners[k - 1]]
        here = points[corners[k]]
        after = points[corners[(k + 1) % len(corners)]]
        turn = length = 0.0
        for axis in range(3):
            i = (axis + 1) % 3
            j = (axis + 2) % 3
            u = np.float64(after[i] - before[i]), np.float64(after[j] - before[j])
            w = np.float64(here[i] - before[i]), np.float64(here[j] - before[j])
            turn += (u[0] * w[1] - u[1] * w[0]) ** 2
            length += np.float64(after[axis] - before[axis]) ** 2
        # the cross product over the length is the distance from the line
        if turn <= resolution * resolution * length:
            corners.pop(k)
            k = max(0, k - 1)
        else:
            k += 1
    return corners


def carve(cx: Complex, scene: Scene, facets: Facets, n_box: int) -> None:
    """Cut cells with an empty list along the solid's surface and flag those inside it.

    Parameters
    ----------
    cx : Complex
        Its plane table: box, faces, others, and last the facets' perpendicular planes.
    scene, facets
        The solid on its grid and the facets of its surface.
    n_box : int
        Number of box planes.
    """
    free = _insert_facets(
        cx,
        facets.first,
        n_box + scene.plane_of_face[facets.face],
        scene.side_of_face[facets.face],
        len(facets.planes),
    )
    words = cx.label.shape[1]
    labels = np.zeros((2, words), np.uint64)
    # Facets of displaced vertices overlap or gape by a step: their sides tell only where snapping was exact.
    labels[:, -1] = (0, INSIDE) if scene.resolution == 0.0 else UNKNOWN
    partition(cx, *_hand_down(cx, free), labels)
    for c in _unknown(cx):
        inside = is_inside(scene, cell_centre(cx, c))
        cx.label[c, -1] = INSIDE if inside else np.uint64(0)


@entry_kernel
def _insert_facets(cx, first, plane, side, n_perpendicular):
    """Add the polygons as free faces; their sides name the label rows outside (0) and inside (1)."""
    offset = len(cx.planes) - n_perpendicular
    faces = np.empty(len(first) - 1, np.int64)
    for k in range(len(first) - 1):
        start = first[k]
        size = first[k + 1] - first[k]
        corner = np.empty(size, np.int64)
        for i in range(size):
            corner[i] = add_vertex(
                cx, plane[k], offset + start + (i + size - 1) % size, offset + start + i
            )
        edge = np.empty(size, np.int64)
        for i in range(size):
            edge[i] = add_edge(cx, corner[i], corner[(i + 1) % size], plane[k], offset + start + i)
        outside_positive = side[k] > 0
        faces[k] = add_face(
            cx, plane[k], 0 if outside_positive else 1, 1 if outside_positive else 0
        )
        for i in range(size):
            push_edge(cx, faces[k], edge[i])
    return faces


@kernel
def _is_empty(label):
    anything = np.uint64(0)
    for word in label:
        anything |= word
    return anything == 0


@entry_kernel
def _hand_down(cx, facets):
    """Hand the facets down the tree to the leaves with an empty list and mark those.

    Returns the leaves, where the facets of each begin in the list of all, and that list.
    """
    leaves = [np.int64(0) for _ in range(0)]
    first = [np.int64(0)]
    handed = [np.int64(0) for _ in range(0)]
    stack = [(0, facets)]
    while len(stack) > 0:
        cell, cell_facets = stack.pop()
        if cx.cell[cell, CELL_CHILD] < 0:
            if _is_empty(cx.label[cell]):
                cx.label[cell, cx.label.shape[1] - 1] = UNKNOWN
                refresh_cell(cx, cell)
                leaves.append(np.int64(cell))
                for f in cell_facets:
                    handed.append(f)
                first.append(np.int64(len(handed)))
            continue
        h = cx.cell[cell, CELL_PLANE]
        parts = np.empty((2, len(cell_facets)), np.int64)
        n_ahead = n_behind = 0
        for f in cell_facets:
            refresh_face(cx, f)
            side = 0 if cx.face[f, FACE_PLANE] == h else face_side(cx, f, h)
            if side == CROSSED:
                split_face(cx, f, h)
            if side & POSITIVE:
                parts[0, n_ahead] = cx.face[f, FACE_CHILD] if side == CROSSED else f
                n_ahead += 1
            if side & NEGATIVE:
                parts[1, n_behind] = cx.face[f, FACE_CHILD + 1] if side == CROSSED else f
                n_behind += 1
        stack.append((np.int64(cx.cell[cell, CELL_CHILD]), parts[0, :n_ahead].copy()))
        stack.append((np.int64(cx.cell[cell, CELL_CHILD + 1]), parts[1, :n_behind].copy()))
    return np.array(leaves), np.array(first), np.array(handed)


def _unknown(cx: Complex) -> list[int]:
    n = int(cx.count[N_CELLS])
    return np.flatnonzero((cx.cell[:n, CELL_CHILD] < 0) & (cx.label[:n, -1] == UNKNOWN)).tolist()


def is_inside(scene: Scene, position: np.ndarray) -> bool:
    """Whether a point, given in grid steps, lies inside the solid: parity of the crossings of a ray.

    A ray that passes too close to an edge for doubles to tell is replaced by one along another axis, then by one from a
    point a hair aside.
    """
    first = scene.pieces.first
    loop = scene.pieces.vertices
    nudge = np.zeros(3)
    generator = np.random.default_rng(0)
    while True:
        point = as_queries(position + nudge)
        for axis in range(3):
            parity = _parity(
                point,
                axis,
                scene.points,
                first,
                loop,
                scene.pieces.face,
                scene.planes,
                scene.plane_of_face,
            )
            if parity >= 0:
                return parity == 1
        nudge = generator.uniform(-1e-3, 1e-3, 3)


@entry_kernel
def _parity(point, axis, points, first, loop, face, planes, plane_of_face):
    """Parity of the pieces that the ray from `point` in the direction of an axis crosses; -1 if in doubt."""
    i = (axis + 1) % 3
    j = (axis + 2) % 3
    crossings = 0
    scale = np.int64(1) << 20
    for piece in range(len(face)):
        h = plane_of_face[face[piece]]
        slope = planes[h, axis]
        if slope == 0:
            continue
        # seen along the axis the ray is a point: it meets a convex piece that has it on one side of all edges
        on_left = on_right = doubtful = False
        for k in range(first[piece], first[piece + 1]):
            v = loop[k]
            w = loop[k + 1] if k + 1 < first[piece + 1] else loop[first[piece]]
            ax = np.float64(points[v, i] * scale - point[i])
            ay = np.float64(points[v, j] * scale - point[j])
            bx = np.float64(points[w, i] * scale - point[i])
            by = np.float64(points[w, j] * scale - point[j])
            turn = ax * by - ay * bx
            # rounding might have turned the sign
            if abs(turn) <= 1e-15 * (abs(ax * by) + abs(ay * bx)):
                doubtful = True
            on_left |= turn > 0
            on_right |= turn < 0
        if on_left and on_right:
            continue
        if doubtful:
            return -1
        # the plane is ahead if its values still have to grow along the ray
        if sign_at_point(planes, h, point) * (1 if slope > 0 else -1) < 0:
            crossings += 1
    return crossings % 2


# What touches across slivers: cells too thin to count, shrunk to nothing.
#
# A face of a wide cell that borders on a sliver is pushed along its normal, sliver after sliver,
# and cut to what of it leaves each sliver through each face opposite, until it arrives at another
# wide cell. The pieces that arrive are where the two cells touch.


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
