"""Arrays of a convex cell complex, and how vertices, edges, faces and cells are added to them.

What the complex is and promises stands in `split`, which cuts it.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from aspectgraph.exact.predicates import LIMBS, meet
from aspectgraph.exceptions import MemoryLimitError
from compiled.decorators import entry_kernel, kernel_without_refcounts

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
    for one, other, used in zip(cx.lists, larger.lists, cx.count[N_LIST:], strict=True):
        _copy_rows(one[:used], other)
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
