"""The arrays of a cell complex: what they hold, how they are read, and sets of cells in millimetres."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from aspectgraph.exact.grid import LIMBS, POINT_BITS, Grid, as_points, meet, sign_at_point, turned
from aspectgraph.exceptions import MemoryLimitError, WorkspaceError
from ground.decorators import entry_kernel, holds_value, kernel, kernel_without_refcounts, put
from ground.short_repr import count

# Arrays of a convex cell complex, and how vertices, edges, faces and cells are added to them.
#
# What the complex is and promises stands in `split`, which cuts it.


# columns of Complex.vertex: plane of the remembered sign, that sign, mark
SIGN_PLANE, SIGN, VERTEX_MARK = range(3)
# columns of Complex.edge: two vertices, two planes, two parts, mark
ENDS = 0
LINE = 2
EDGE_CHILD = 4
EDGE_MARK = 6
# columns of Complex.face: plane, cells on the positive and negative side, two parts, place in the list of edges
FACE_PLANE = 0
SIDES = 1
FACE_CHILD = 3
FACE_FIRST = 5
FACE_SIZE = 6
# columns of Complex.cell: plane that split it, two parts, places in the lists of faces and corners
CELL_PLANE = 0
CELL_CHILD = 1
CELL_FIRST = 3
CELL_SIZE = 4
CORNER_FIRST = 5
CORNER_SIZE = 6
# rows of Complex.lists
EDGE_LIST, FACE_LIST, CORNER_LIST = range(3)
# entries of Complex.count; the lengths of the lists follow N_LIST
N_VERTICES, N_EDGES, N_FACES, N_CELLS, MARK, N_LIST = range(6)

POSITIVE = 1
NEGATIVE = 2
CROSSED = 3

# flags in the last word of a label
INSIDE = np.uint64(1 << 63)
UNKNOWN = np.uint64(1 << 62)


class Complex(NamedTuple):
    """Arrays of a cell complex; only the first ``count`` rows of each are in use, and -1 means none.

    Attributes
    ----------
    planes : ndarray of int64, shape (p, 4)
    vertices, coordinates : ndarray, shapes (v, 4, LIMBS) of int64 and (v, 3) of float64
        Corners, exact and rounded (see `predicates`).
    vertex, edge, face, cell : ndarray of int32, shapes (·, 3), (·, 7), (·, 7), (·, 7)
        Links, by the columns named above.
    label : ndarray of uint64, shape (c, words)
        What is known of each cell.
    lists : ndarray of int32, shape (3, l)
        Edges of faces, faces of cells and corners of cells, one after the other.
    count : ndarray of int64, shape (8,)
    """

    planes: np.ndarray
    vertices: np.ndarray
    coordinates: np.ndarray
    vertex: np.ndarray
    edge: np.ndarray
    face: np.ndarray
    cell: np.ndarray
    label: np.ndarray
    lists: np.ndarray
    count: np.ndarray  # type: ignore[assignment]  # hides tuple.count, which nobody asks


def allocate(planes: np.ndarray, n_cells: int, n_words: int = 1) -> Complex:
    """Return an empty complex with room for about `n_cells` cells over the (p, 4) int64 plane table.

    The arrays are not touched, so the operating system commits memory only for the rows that come into use.
    """
    n_vertices = 8 * n_cells + 64
    n_edges = 16 * n_cells + 128
    n_faces = 10 * n_cells + 64
    return Complex(
        planes=planes,
        vertices=np.empty((n_vertices, 4, LIMBS), np.int64),
        coordinates=np.empty((n_vertices, 3)),
        vertex=np.empty((n_vertices, 3), np.int32),
        edge=np.empty((n_edges, 7), np.int32),
        face=np.empty((n_faces, 7), np.int32),
        cell=np.empty((2 * n_cells + 8, 7), np.int32),
        label=np.empty((2 * n_cells + 8, n_words), np.uint64),
        lists=np.empty((3, 64 * n_cells + 512), np.int32),
        count=np.zeros(N_LIST + 3, np.int64),
    )


def bytes_in_use(cx: Complex) -> int:
    """Return the memory of the rows in use: what the operating system had to commit."""
    vertices, edges, faces, cells = (
        int(cx.count[which]) for which in (N_VERTICES, N_EDGES, N_FACES, N_CELLS)
    )
    of_vertex = sum(part[:1].nbytes for part in (cx.vertices, cx.coordinates, cx.vertex))
    of_cell = cx.cell[:1].nbytes + cx.label[:1].nbytes
    listed = cx.lists.itemsize * int(cx.count[N_LIST:].sum())
    return (
        vertices * of_vertex
        + edges * cx.edge[:1].nbytes
        + faces * cx.face[:1].nbytes
        + cells * of_cell
        + listed
    )


class RoomFullError(Exception):
    """The arrays of a complex are full: more room is needed, which the process may well have."""


def with_room(
    build: Callable[[int], Complex], n_cells: int = 1024, limit: int = 1 << 24
) -> Complex:
    """Call `build(n_cells)` until the room suffices: with more room if it was full, with less if there is no more.

    Raises
    ------
    MemoryLimitError
        If `limit` cells are not enough, or the process gets no memory for enough of them.
    """
    # the largest room known to be too small
    full = 0
    reason = f"have at most {limit} cells. Got more"
    while True:
        try:
            return build(n_cells)
        except MemoryLimitError:
            raise
        except RoomFullError:
            full = n_cells
            n_cells *= 4
        except MemoryError as error:
            n_cells //= 2
            limit = n_cells
            reason = (
                f"fit the memory. Got a process that gets no memory for more than {limit} cells "
                f"({str(error).rstrip('.') or 'no reason given'})"
            )
        if n_cells > limit or n_cells <= full:
            raise MemoryLimitError(f"the cell complex must {reason}.")


def enlarged(cx: Complex, n_cells: int) -> Complex:
    """Return a copy of a complex with room for about `n_cells` cells.

    Raises
    ------
    RoomFullError
        If that is too little for the cells it has.
    """
    larger = allocate(cx.planes, n_cells, cx.label.shape[1])
    rows = {
        N_VERTICES: ("vertices", "coordinates", "vertex"),
        N_EDGES: ("edge",),
        N_FACES: ("face",),
        N_CELLS: ("cell", "label"),
    }
    for which, names in rows.items():
        used = int(cx.count[which])
        for name in names:
            _copy_rows(getattr(cx, name)[:used], getattr(larger, name))
    for entries, other, used in zip(cx.lists, larger.lists, cx.count[N_LIST:], strict=True):
        _copy_rows(entries[:used], other)
    larger.count[:] = cx.count
    return larger


def _copy_rows(rows: np.ndarray, place: np.ndarray) -> None:
    if len(rows) > len(place):
        raise RoomFullError
    place[: len(rows)] = rows


def cut_further(cx: Complex, cut: Callable[[Complex], None], n_cells: int = 1024) -> Complex:
    """Return a copy of a complex that `cut(copy)` has cut further; it is begun anew if the room was full.

    Parameters
    ----------
    cx : Complex
        It stays as it is.
    cut : callable
        Changes the complex it gets.
    n_cells : int
        Cells to reserve room for at first; at least those of the complex.

    Raises
    ------
    MemoryLimitError
        See `with_room`.
    """

    def build(room: int) -> Complex:
        copy = enlarged(cx, room)
        cut(copy)
        return copy

    return with_room(build, max(n_cells, int(cx.count[N_CELLS])))


@kernel_without_refcounts
def require(used, extra, room):
    """Raise `RoomFullError` where the room is full; see `with_room`."""
    if used + extra > room:
        raise RoomFullError


@kernel_without_refcounts
def add_vertex(cx, p, q, r):
    """Append the common point of planes p, q and r."""
    v = cx.count[N_VERTICES]
    require(v, 1, len(cx.vertices))
    meet(cx.planes, p, q, r, cx.vertices, cx.coordinates, v)
    cx.vertex[v, SIGN_PLANE] = -1
    cx.vertex[v, VERTEX_MARK] = -1
    cx.count[N_VERTICES] = v + 1
    return v


@kernel_without_refcounts
def add_edge(cx, v, w, p, q):
    """Append the edge from vertex v to w on the line of planes p and q."""
    e = cx.count[N_EDGES]
    require(e, 1, len(cx.edge))
    cx.edge[e, ENDS] = v
    cx.edge[e, ENDS + 1] = w
    cx.edge[e, LINE] = p
    cx.edge[e, LINE + 1] = q
    cx.edge[e, EDGE_CHILD] = -1
    cx.edge[e, EDGE_MARK] = -1
    cx.count[N_EDGES] = e + 1
    return e


@kernel_without_refcounts
def add_face(cx, plane, positive, negative):
    """Append a face without edges; `push_edge` fills the newest face."""
    f = cx.count[N_FACES]
    require(f, 1, len(cx.face))
    cx.face[f, FACE_PLANE] = plane
    cx.face[f, SIDES] = positive
    cx.face[f, SIDES + 1] = negative
    cx.face[f, FACE_FIRST] = cx.count[N_LIST + EDGE_LIST]
    cx.face[f, FACE_SIZE] = 0
    cx.face[f, FACE_CHILD] = -1
    cx.count[N_FACES] = f + 1
    return f


@kernel_without_refcounts
def push_edge(cx, f, e):
    """Append edge e to the face whose list was opened last."""
    k = cx.count[N_LIST + EDGE_LIST]
    require(k, 1, cx.lists.shape[1])
    cx.lists[EDGE_LIST, k] = e
    cx.face[f, FACE_SIZE] += 1
    cx.count[N_LIST + EDGE_LIST] = k + 1


@kernel_without_refcounts
def add_cell(cx):
    """Append a cell without faces; `push_face` fills the newest cell."""
    c = cx.count[N_CELLS]
    require(c, 1, len(cx.cell))
    cx.cell[c, CELL_FIRST] = cx.count[N_LIST + FACE_LIST]
    cx.cell[c, CELL_SIZE] = 0
    cx.cell[c, CORNER_FIRST] = cx.count[N_LIST + CORNER_LIST]
    cx.cell[c, CORNER_SIZE] = 0
    cx.cell[c, CELL_PLANE] = -1
    # both, as trees are copied out of these columns, kept in files and compared
    cx.cell[c, CELL_CHILD] = -1
    cx.cell[c, CELL_CHILD + 1] = -1
    cx.label[c] = 0
    cx.count[N_CELLS] = c + 1
    return c


@kernel_without_refcounts
def push_face(cx, c, f):
    """Append face f to the cell whose list was opened last."""
    k = cx.count[N_LIST + FACE_LIST]
    require(k, 1, cx.lists.shape[1])
    cx.lists[FACE_LIST, k] = f
    cx.cell[c, CELL_SIZE] += 1
    cx.count[N_LIST + FACE_LIST] = k + 1


@kernel_without_refcounts
def push_corner(cx, c, v):
    """Append vertex v to the corners of the newest cell."""
    k = cx.count[N_LIST + CORNER_LIST]
    require(k, 1, cx.lists.shape[1])
    cx.lists[CORNER_LIST, k] = v
    cx.cell[c, CORNER_SIZE] += 1
    cx.count[N_LIST + CORNER_LIST] = k + 1


@entry_kernel
def add_box(cx, box):
    """Start the complex with one cell; `box` holds the planes x_min, x_max, y_min, y_max, z_min, z_max."""
    c = add_cell(cx)
    corner = np.empty((2, 2, 2), np.int64)
    for i in range(2):
        for j in range(2):
            for k in range(2):
                corner[i, j, k] = add_vertex(cx, box[i], box[2 + j], box[4 + k])
                push_corner(cx, c, corner[i, j, k])
    edge = np.empty((3, 2, 2), np.int64)
    for i in range(2):
        for j in range(2):
            edge[0, i, j] = add_edge(cx, corner[0, i, j], corner[1, i, j], box[2 + i], box[4 + j])
            edge[1, i, j] = add_edge(cx, corner[i, 0, j], corner[i, 1, j], box[i], box[4 + j])
            edge[2, i, j] = add_edge(cx, corner[i, j, 0], corner[i, j, 1], box[i], box[2 + j])
    for axis in range(3):
        for side in range(2):
            f = add_face(cx, box[2 * axis + side], c if side == 0 else -1, -1 if side == 0 else c)
            for k in range(2):
                if axis == 0:
                    push_edge(cx, f, edge[1, side, k])
                    push_edge(cx, f, edge[2, side, k])
                elif axis == 1:
                    push_edge(cx, f, edge[0, side, k])
                    push_edge(cx, f, edge[2, k, side])
                else:
                    push_edge(cx, f, edge[0, k, side])
                    push_edge(cx, f, edge[1, k, side])
            push_face(cx, c, f)
    return c


# Sizes of cells and faces, in doubles: for weighting and for users' eyes, never to decide
# topology.


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
    spans = np.empty((len(cells), 2, len(directions)))
    for i in range(len(cells)):
        c = cells[i]
        low = spans[i, 0]
        high = spans[i, 1]
        for row in range(len(directions)):
            low[row] = np.inf
            high[row] = -np.inf
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
    return spans


def spans(cx: Complex, cells: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Least and largest product of each cell's corners, in grid steps, with each of (m, 3) directions; (n, 2, m)."""
    return np.asarray(_spans(cx, np.asarray(cells, np.int64), np.ascontiguousarray(directions)))


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


# Exact point location in a binary space partition, vectorised over query points.


_POINT_STEP = 2.0**-POINT_BITS
# see predicates: rounding of four coefficients, three coordinates, three products and three sums
_FILTER = 16 * np.finfo(np.float64).eps


class Tree(NamedTuple):
    """A binary space partition; inner nodes cut, leaves are the cells.

    Attributes
    ----------
    planes : ndarray of int64, shape (p, 4)
        Planes in grid steps.
    plane : ndarray of int32, shape (n,)
        Plane of each node, -1 at leaves.
    child : ndarray of int32, shape (n, 2)
        Positive and negative child of inner nodes, -1 at leaves.
    """

    planes: np.ndarray
    plane: np.ndarray
    child: np.ndarray


def tree_of(cx: Complex) -> Tree:
    """The partition whose leaves are the present cells of a complex; node numbers are cell numbers."""
    n = int(cx.count[N_CELLS])
    return Tree(
        cx.planes, cx.cell[:n, CELL_PLANE].copy(), cx.cell[:n, CELL_CHILD : CELL_CHILD + 2].copy()
    )


@kernel
def _rows(tree, points):
    """For every node its plane in doubles, and the value it must exceed at any of the points for a certain sign."""
    reach = 0.0
    for k in range(len(points)):
        for axis in range(3):
            reach = max(reach, abs(np.float64(points[k, axis])))
    reach *= _POINT_STEP
    rows = np.zeros((len(tree.plane), 5))
    for node in range(len(tree.plane)):
        if tree.plane[node] >= 0:
            for column in range(4):
                rows[node, column] = np.float64(tree.planes[tree.plane[node], column])
            a = abs(rows[node, 0])
            b = abs(rows[node, 1])
            c = abs(rows[node, 2])
            d = abs(rows[node, 3])
            rows[node, 4] = ((a + b + c) * reach + d) * _FILTER
    return rows


@entry_kernel
def holds(tree, flag, points):
    """Whether the closure of a flagged leaf holds each of (n, 3) int64 query points (`Grid.to_points`), as (n,) bool.

    A point on a plane belongs to both sides of it.
    """
    planes = tree.planes
    plane = tree.plane
    child = tree.child
    rows = _rows(tree, points)
    result = np.zeros(len(points), np.bool_)
    waiting = np.empty(len(plane) + 1, np.int64)
    for k in range(len(points)):
        x = points[k, 0] * _POINT_STEP
        y = points[k, 1] * _POINT_STEP
        z = points[k, 2] * _POINT_STEP
        # unsigned, so that indexing need not look for negative numbers
        node = np.uint64(0)
        n_waiting = 0
        while True:
            if plane[node] >= 0:
                value = rows[node, 0] * x + rows[node, 1] * y + rows[node, 2] * z - rows[node, 3]
                if abs(value) > rows[node, 4]:
                    node = np.uint64(child[node, np.uint64(value < 0)])
                    continue
                s = sign_at_point(planes, plane[node], points[k])
                if s == 0:
                    waiting[n_waiting] = child[node, 1]
                    n_waiting += 1
                node = np.uint64(child[node, np.uint64(s < 0)])
            elif flag[node]:
                result[k] = True
                break
            elif n_waiting == 0:
                break
            else:
                n_waiting -= 1
                node = np.uint64(waiting[n_waiting])
    return result


@entry_kernel
def locate(tree, points):
    """Leaf that holds each of (n, 3) int64 query points, as (n,) int64; on a plane, the leaf on its positive side."""
    planes = tree.planes
    plane = tree.plane
    child = tree.child
    rows = _rows(tree, points)
    result = np.empty(len(points), np.int64)
    for k in range(len(points)):
        x = points[k, 0] * _POINT_STEP
        y = points[k, 1] * _POINT_STEP
        z = points[k, 2] * _POINT_STEP
        node = np.uint64(0)
        while plane[node] >= 0:
            value = rows[node, 0] * x + rows[node, 1] * y + rows[node, 2] * z - rows[node, 3]
            behind = value < 0
            if abs(value) <= rows[node, 4]:
                behind = sign_at_point(planes, plane[node], points[k]) < 0
            node = np.uint64(child[node, np.uint64(behind)])
        result[k] = node
    return result


# Sets of convex cells as users see them: in millimetres, to measure, to draw from and to look at.


@dataclass(frozen=True, repr=False)
class Cell:
    """A convex polytope.

    Attributes
    ----------
    half_spaces : ndarray, shape (k, 4)
        Rows (a, b, c, d) with unit normals: a·x + b·y + c·z + d <= 0 inside, in mm. `PartitionSurface.plane` and its
        GraphML attribute have the opposite d.
    vertices : ndarray, shape (v, 3)
        Corners in mm, and points of its boundary where edges of other cells end.
    volume : float
        In mm³.
    """

    half_spaces: np.ndarray
    vertices: np.ndarray
    volume: float

    def __repr__(self) -> str:
        """Return a one-line summary."""
        return f"<Cell: {len(self.half_spaces)} half-spaces, {self.volume:.4g} mm³>"


class CellSet:
    """A union of convex cells of one partition of the workspace.

    Parameters
    ----------
    cx : Complex
        The partition.
    cells : array_like of int
        The cells of the set.
    grid : Grid
        The integer grid the partition lies on.

    Attributes
    ----------
    volumes : ndarray, shape (m,)
        Volume of each cell in mm³.
    """

    def __init__(self, cx: Complex, cells: np.ndarray, grid: Grid) -> None:
        self._cx = cx
        self._cells = np.asarray(cells, np.int64)
        self._grid = grid
        self._measured = measured(cx, grid)
        self._sizes = cell_sizes(self._measured, self._cells)
        self.volumes = self._sizes[:, 0] * grid.step_mm**3

    def __repr__(self) -> str:
        """Return a one-line summary."""
        return f"<CellSet: {count(len(self), 'cell')}, {self.volume:.4g} mm³>"

    def __len__(self) -> int:
        return len(self._cells)

    def __iter__(self) -> Iterator[Cell]:
        return (self[k] for k in range(len(self)))

    def __getitem__(self, k: int) -> Cell:
        cell = int(self._cells[k])
        grid = self._grid
        rows = half_spaces(self._measured, cell)
        rows[:, 3] = rows[:, 3] * grid.step_mm - rows[:, :3] @ grid.origin_mm
        rows[:, :3] = turned(grid.frame.T, rows[:, :3])
        corners = cell_triangles(self._cx, cell).reshape(-1, 3)
        # np.unique does the same, and takes five times as long for so few rows
        corners = corners[np.lexsort(corners.T[::-1])]
        corners = corners[np.append(True, (corners[1:] != corners[:-1]).any(axis=1))]
        return Cell(rows, grid.to_mm(corners), float(self.volumes[k]))

    @property
    def volume(self) -> float:
        """Total volume in mm³."""
        return float(self.volumes.sum())

    def in_front_of(self, point: np.ndarray, normal: np.ndarray) -> CellSet:
        """Return the cells that reach in front of a plane.

        Parameters
        ----------
        point : ndarray, shape (3,)
            A point of the plane, mm.
        normal : ndarray, shape (3,)
            Its normal, to the front.

        Returns
        -------
        CellSet
            Without the cells behind the plane.
        """
        heights = [float(((cell.vertices - point) @ normal).max()) for cell in self]
        # cells that end in the plane do so within the rounding of their corners
        reaching = np.array(heights) > 1e-6 * self._grid.step_mm
        return CellSet(self._cx, self._cells[reaching], self._grid)

    @cached_property
    def boxes(self) -> np.ndarray:
        """Lowest and highest corner of the box around each cell in mm, shape (n, 2, 3)."""
        grid = self._grid
        return spans(self._cx, self._cells, grid.frame.T * grid.steps_mm) + turned(
            grid.frame.T, grid.origin_mm
        )

    @property
    def bounds(self) -> np.ndarray:
        """Lowest and highest corner in mm, shape (2, 3).

        Raises
        ------
        ValueError
            If the set is empty.
        """
        if not len(self):
            raise ValueError("bounds need at least one cell. The set is empty.")
        return np.array([self.boxes[:, 0].min(axis=0), self.boxes[:, 1].max(axis=0)])

    def contains(self, points: ArrayLike) -> np.ndarray:
        """Whether the closed set contains points, exactly.

        Parameters
        ----------
        points : array_like, shape (n, 3)
            Points in mm. They are rounded to 2**-20 of a grid step, and the answer for the rounded
            point is exact.

        Returns
        -------
        ndarray of bool, shape (n,)
            True on the boundary too.

        Raises
        ------
        WorkspaceError
            If the points have another shape.
        """
        flag = np.zeros(int(self._cx.count[N_CELLS]), bool)
        flag[self._cells] = True
        return holds(tree_of(self._cx), flag, self._grid.to_points(as_points(points)))

    def sample(self, n: int, rng: int | np.random.Generator = 0) -> np.ndarray:
        """Draw points uniformly from the union.

        Parameters
        ----------
        n : int
            How many points.
        rng : int or numpy.random.Generator
            Seed or source of chance.

        Returns
        -------
        ndarray of float64, shape (n, 3)
            Points in mm.

        Raises
        ------
        ValueError
            If the set is empty.
        WorkspaceError
            If `n` is no integer from 0.
        """
        if not isinstance(n, int | np.integer) or isinstance(n, bool) or n < 0:
            raise WorkspaceError.of_rule("n", "must be an integer of at least 0", repr(n))
        if not len(self):
            raise ValueError("sample needs at least one cell. The set is empty.")
        generator = np.random.default_rng(rng)
        corners, volumes = self._tetrahedra
        chosen = corners[generator.choice(len(volumes), size=n, p=volumes / volumes.sum())]
        weights = generator.exponential(size=(n, 4))
        weights /= weights.sum(axis=1, keepdims=True)
        return self._grid.to_mm(np.einsum("nk,nkc->nc", weights, chosen))

    @cached_property
    def _tetrahedra(self) -> tuple[np.ndarray, np.ndarray]:
        """Tetrahedra that tile the cells: corners in grid steps, shape (t, 4, 3), and volumes."""
        parts = []
        for cell in self._cells:
            triangles = cell_triangles(self._cx, cell)
            apex = np.broadcast_to(triangles.reshape(-1, 3).mean(axis=0), (len(triangles), 1, 3))
            parts.append(np.concatenate([apex, triangles], axis=1))
        corners = np.concatenate(parts)
        edges = corners[:, 1:] - corners[:, :1]
        volumes = np.abs(np.linalg.det(edges)) / 6.0
        return corners, volumes
