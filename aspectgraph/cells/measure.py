"""Sizes of cells and faces, in doubles: for weighting and for users' eyes, never to decide topology."""

from __future__ import annotations

import numpy as np

from aspectgraph.cells.arrays import (
    CELL_CHILD,
    CELL_FIRST,
    CELL_SIZE,
    EDGE_LIST,
    ENDS,
    FACE_CHILD,
    FACE_FIRST,
    FACE_LIST,
    FACE_PLANE,
    FACE_SIZE,
    N_FACES,
    N_VERTICES,
    SIDES,
    Complex,
)
from aspectgraph.exact.grid import Grid
from compiled.decorators import entry_kernel, holds_value, kernel, put


@entry_kernel
def cell_centre(cx, c):
    """Mean of the corners of cell c as its faces list them, in grid steps."""
    total = np.zeros(3)
    n = 0
    for k in range(cx.cell[c, CELL_FIRST], cx.cell[c, CELL_FIRST] + cx.cell[c, CELL_SIZE]):
        f = cx.lists[FACE_LIST, k]
        for m in range(cx.face[f, FACE_FIRST], cx.face[f, FACE_FIRST] + cx.face[f, FACE_SIZE]):
            for end in range(2):
                v = cx.edge[cx.lists[EDGE_LIST, m], ENDS + end]
                for axis in range(3):
                    total[axis] += cx.coordinates[v, axis]
                n += 1
    for axis in range(3):
        total[axis] /= n
    return total


@kernel
def face_area(cx, f):
    """Area, perimeter and largest distance from the grid's zero of face f, in squared steps and steps."""
    first = cx.face[f, FACE_FIRST]
    size = cx.face[f, FACE_SIZE]
    centre = np.zeros(3)
    p = np.zeros(3)
    q = np.zeros(3)
    for k in range(first, first + size):
        e = cx.lists[EDGE_LIST, k]
        for end in range(2):
            for axis in range(3):
                centre[axis] += cx.coordinates[cx.edge[e, ENDS + end], axis]
    for axis in range(3):
        centre[axis] /= 2 * size
    area = perimeter = farthest = 0.0
    for k in range(first, first + size):
        e = cx.lists[EDGE_LIST, k]
        turn = length = to_p = to_q = 0.0
        for axis in range(3):
            p[axis] = cx.coordinates[cx.edge[e, ENDS], axis] - centre[axis]
            q[axis] = cx.coordinates[cx.edge[e, ENDS + 1], axis] - centre[axis]
            length += (p[axis] - q[axis]) ** 2
            to_p += (p[axis] + centre[axis]) ** 2
            to_q += (q[axis] + centre[axis]) ** 2
        for axis in range(3):
            i = (axis + 1) % 3
            j = (axis + 2) % 3
            turn += (p[i] * q[j] - p[j] * q[i]) ** 2
        area += 0.5 * np.sqrt(turn)
        perimeter += np.sqrt(length)
        farthest = max(farthest, max(np.sqrt(to_p), np.sqrt(to_q)))
    return area, perimeter, farthest


@entry_kernel
def _cell_sizes(cx, cells):
    """Volume and surface of cells, in cubic and square steps, as (n, 2)."""
    sizes = np.zeros((len(cells), 2))
    for row in range(len(cells)):
        c = cells[row]
        centre = cell_centre(cx, c)
        for k in range(cx.cell[c, CELL_FIRST], cx.cell[c, CELL_FIRST] + cx.cell[c, CELL_SIZE]):
            f = cx.lists[FACE_LIST, k]
            area, _, _ = face_area(cx, f)
            plane = cx.planes[cx.face[f, FACE_PLANE]]
            a = np.float64(plane[0])
            b = np.float64(plane[1])
            d = np.float64(plane[2])
            distance = abs(a * centre[0] + b * centre[1] + d * centre[2] - plane[3]) / np.sqrt(
                a * a + b * b + d * d
            )
            sizes[row, 0] += area * distance / 3
            sizes[row, 1] += area
    return sizes


def cell_sizes(cx: Complex, cells: np.ndarray) -> np.ndarray:
    """Volume and surface of cells, in cubic and square grid steps, shape (n, 2)."""
    return _cell_sizes(cx, np.asarray(cells, np.int64))


@entry_kernel
def _spans(cx, cells, directions):
    low = np.full(len(directions), np.inf)
    high = np.full(len(directions), -np.inf)
    for c in cells:
        for k in range(cx.cell[c, CELL_FIRST], cx.cell[c, CELL_FIRST] + cx.cell[c, CELL_SIZE]):
            f = cx.lists[FACE_LIST, k]
            for m in range(cx.face[f, FACE_FIRST], cx.face[f, FACE_FIRST] + cx.face[f, FACE_SIZE]):
                for end in range(2):
                    corner = cx.coordinates[cx.edge[cx.lists[EDGE_LIST, m], ENDS + end]]
                    for row in range(len(directions)):
                        along = 0.0
                        for axis in range(3):
                            along += directions[row, axis] * corner[axis]
                        low[row] = min(low[row], along)
                        high[row] = max(high[row], along)
    return low, high


def spans(cx: Complex, cells: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Least and largest product of the cells' corners, in grid steps, with each of (m, 3) directions, shape (2, m)."""
    return np.array(_spans(cx, np.asarray(cells, np.int64), np.ascontiguousarray(directions)))


@entry_kernel
def _interfaces(cx):
    n = cx.count[N_FACES]
    sides = np.empty((n, 4), np.int64)
    sizes = np.empty((n, 3))
    m = 0
    for f in range(n):
        positive = cx.face[f, SIDES]
        negative = cx.face[f, SIDES + 1]
        if (
            cx.face[f, FACE_CHILD] >= 0
            or positive < 0
            or negative < 0
            or not _has_face(cx, positive, f)
        ):
            continue
        sides[m, 0] = positive
        sides[m, 1] = negative
        sides[m, 2] = cx.face[f, FACE_PLANE]
        sides[m, 3] = f
        area, perimeter, sizes[m, 2] = face_area(cx, f)
        sizes[m, 0] = area
        sizes[m, 1] = 2.0 * area / perimeter if perimeter > 0 else 0.0
        m += 1
    return sides[:m], sizes[:m]


@kernel
def _has_face(cx, c, f):
    """Whether f bounds cell c; free facets carry label rows, not cells, on their sides."""
    if cx.cell[c, CELL_CHILD] >= 0:
        return False
    first = cx.cell[c, CELL_FIRST]
    return holds_value(cx.lists[FACE_LIST, first : first + cx.cell[c, CELL_SIZE]], f)


def interfaces(cx: Complex) -> tuple[np.ndarray, np.ndarray]:
    """Faces between present cells.

    Returns
    -------
    sides : ndarray of int64, shape (n, 4)
        Positive cell, negative cell, plane, face.
    sizes : ndarray, shape (n, 3)
        Area in squared steps; width in steps: twice the area over the perimeter, at least the inscribed radius and at
        most twice that; largest distance from the grid's zero in steps.
    """
    return _interfaces(cx)


@entry_kernel
def face_polygon(cx, f):
    """Corners of face f in order around it, in grid steps, shape (m, 3)."""
    first = cx.face[f, FACE_FIRST]
    size = cx.face[f, FACE_SIZE]
    edges = cx.lists[EDGE_LIST, first : first + size].copy()
    corners = np.empty((size, 3))
    here = cx.edge[edges[0], ENDS]
    for k in range(size):
        put(corners[k], cx.coordinates[here])
        for m in range(k, size):
            start = cx.edge[edges[m], ENDS]
            end = cx.edge[edges[m], ENDS + 1]
            if here in (start, end):
                edges[k], edges[m] = edges[m], edges[k]
                here = end if here == start else start
                break
    return corners


@entry_kernel
def _inner_balls(cx, cells):
    balls = np.empty((len(cells), 5))
    for row in range(len(cells)):
        c = cells[row]
        centre = cell_centre(cx, c)
        radius = np.inf
        farthest = 0.0
        for k in range(cx.cell[c, CELL_FIRST], cx.cell[c, CELL_FIRST] + cx.cell[c, CELL_SIZE]):
            f = cx.lists[FACE_LIST, k]
            plane = cx.planes[cx.face[f, FACE_PLANE]]
            a = np.float64(plane[0])
            b = np.float64(plane[1])
            d = np.float64(plane[2])
            distance = abs(a * centre[0] + b * centre[1] + d * centre[2] - plane[3]) / np.sqrt(
                a * a + b * b + d * d
            )
            radius = min(radius, distance)
            for m in range(cx.face[f, FACE_FIRST], cx.face[f, FACE_FIRST] + cx.face[f, FACE_SIZE]):
                for end in range(2):
                    away = cx.coordinates[cx.edge[cx.lists[EDGE_LIST, m], ENDS + end]] - centre
                    farthest = max(farthest, (away * away).sum())
        put(balls[row], centre)
        balls[row, 3] = radius
        balls[row, 4] = np.sqrt(farthest)
    return balls


def inner_balls(cx: Complex, cells: np.ndarray) -> np.ndarray:
    """A ball inside each cell, not the largest: centre, radius, and distance to the farthest corner, shape (n, 5)."""
    return _inner_balls(cx, np.asarray(cells, np.int64))


@entry_kernel
def _cell_planes(cx, c):
    """Planes of cell c, each once, with the side (1 or -1) the cell lies on."""
    size = cx.cell[c, CELL_SIZE]
    planes = np.empty(size, np.int64)
    side = np.empty(size, np.int64)
    n = 0
    for k in range(cx.cell[c, CELL_FIRST], cx.cell[c, CELL_FIRST] + size):
        f = cx.lists[FACE_LIST, k]
        if not holds_value(planes[:n], cx.face[f, FACE_PLANE]):
            planes[n] = cx.face[f, FACE_PLANE]
            side[n] = 1 if cx.face[f, SIDES] == c else -1
            n += 1
    return planes[:n], side[:n]


def half_spaces(cx: Complex, c: int, without: int = -1) -> np.ndarray:
    """Rows (a, b, c, d) with a·x + b·y + c·z + d <= 0 inside cell c, unit normals, in grid steps, shape (k, 4).

    The plane `without` is left out.
    """
    planes, side = _cell_planes(cx, c)
    side = side[planes != without]
    planes = planes[planes != without]
    rows = cx.planes[planes].astype(float) * -side[:, None]
    rows[:, 3] *= -1
    return rows / np.linalg.norm(rows[:, :3], axis=1, keepdims=True)


@entry_kernel
def cell_triangles(cx, c):
    """Triangles that tile the surface of cell c, as (t, 3, 3) corners in grid steps."""
    n = 0
    for k in range(cx.cell[c, CELL_FIRST], cx.cell[c, CELL_FIRST] + cx.cell[c, CELL_SIZE]):
        n += cx.face[cx.lists[FACE_LIST, k], FACE_SIZE]
    triangles = np.empty((n, 3, 3))
    n = 0
    for k in range(cx.cell[c, CELL_FIRST], cx.cell[c, CELL_FIRST] + cx.cell[c, CELL_SIZE]):
        f = cx.lists[FACE_LIST, k]
        first = cx.face[f, FACE_FIRST]
        size = cx.face[f, FACE_SIZE]
        anchor = cx.coordinates[cx.edge[cx.lists[EDGE_LIST, first], ENDS]]
        for m in range(first, first + size):
            e = cx.lists[EDGE_LIST, m]
            put(triangles[n, 0], anchor)
            put(triangles[n, 1], cx.coordinates[cx.edge[e, ENDS]])
            put(triangles[n, 2], cx.coordinates[cx.edge[e, ENDS + 1]])
            n += 1
    return triangles


def measured(cx: Complex, grid: Grid) -> Complex:
    """The complex with corners and planes in units of `Grid.step_mm` along all axes, for measuring only.

    With one step for all axes that is the complex itself; else its planes are doubles.
    """
    if (grid.scale == 1.0).all():
        return cx
    coordinates = cx.coordinates[: int(cx.count[N_VERTICES])] * grid.scale
    return cx._replace(coordinates=coordinates, planes=cx.planes / np.append(grid.scale, 1.0))
