"""A convex cell complex cut by planes, exactly.

Notation
--------
vertex  the common point of three planes (``predicates``)
edge    two vertices and the two planes whose line carries it
face    a convex polygon on one plane, an unordered list of edges, and the cells on its positive and negative side
cell    a convex polyhedron, a list of faces and a list of all its corners; once split by plane h it keeps h and its two
        children, so the cells of a complex form a binary space partition tree whose leaves are the present cells

Neighbours share their faces and edges: splitting a cell splits what it shares, and the other owner looks its lists up
again through the children (`_refresh_face`, `_refresh_cell`) when it is next touched.

Guarantee: the leaves always tile the starting box without gap or overlap, two leaves share exactly the faces that
carry both of their numbers, and no decision depends on rounding.
"""

from typing import NamedTuple

import numba as nb
import numpy as np

from .predicates import LIMBS, meet, sign_at_vertex

# columns of Complex.vertex: plane of the remembered sign, that sign, mark
SIGN_PLANE, SIGN, VERTEX_MARK = range(3)
# columns of Complex.edge: two vertices, two planes, two parts, mark
ENDS, LINE, EDGE_CHILD, EDGE_MARK = 0, 2, 4, 6
# columns of Complex.face: plane, cells on the positive and negative side, two parts, place in the list of edges
FACE_PLANE, SIDES, FACE_CHILD, FACE_FIRST, FACE_SIZE = 0, 1, 3, 5, 6
# columns of Complex.cell: plane that split it, two parts, places in the lists of faces and corners
CELL_PLANE, CELL_CHILD, CELL_FIRST, CELL_SIZE, CORNER_FIRST, CORNER_SIZE = 0, 1, 3, 4, 5, 6
# rows of Complex.lists
EDGE_LIST, FACE_LIST, CORNER_LIST = range(3)
# entries of Complex.count; the lengths of the lists follow N_LIST
N_VERTICES, N_EDGES, N_FACES, N_CELLS, MARK, N_LIST = range(6)

POSITIVE, NEGATIVE, CROSSED = 1, 2, 3


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
    count: np.ndarray


def allocate(planes: np.ndarray, n_cells: int, n_words: int = 1) -> Complex:
    """Return an empty complex with room for about `n_cells` cells over the (p, 4) int64 plane table.

    The arrays are not touched, so the operating system commits memory only for the rows that come into use.
    """
    n_vertices, n_edges, n_faces = 8 * n_cells + 64, 16 * n_cells + 128, 10 * n_cells + 64
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


def with_room(build, n_cells=1024, limit=1 << 24):
    """Call `build(n_cells)` with doubled room until it fits.

    Raises
    ------
    MemoryError
        If `limit` cells are not enough.
    """
    while True:
        try:
            return build(n_cells)
        except MemoryError:
            n_cells *= 4
            if n_cells > limit:
                raise MemoryError(f"the cell complex needs more than {limit} cells.") from None


@nb.njit(cache=True)
def _require(used, extra, room):
    if used + extra > room:
        raise MemoryError


@nb.njit(cache=True)
def add_vertex(cx, p, q, r):
    """Append the common point of planes p, q and r."""
    v = cx.count[N_VERTICES]
    _require(v, 1, len(cx.vertices))
    meet(cx.planes, p, q, r, cx.vertices, cx.coordinates, v)
    cx.vertex[v, SIGN_PLANE] = -1
    cx.vertex[v, VERTEX_MARK] = -1
    cx.count[N_VERTICES] = v + 1
    return v


@nb.njit(cache=True)
def add_edge(cx, v, w, p, q):
    """Append the edge from vertex v to w on the line of planes p and q."""
    e = cx.count[N_EDGES]
    _require(e, 1, len(cx.edge))
    cx.edge[e, ENDS], cx.edge[e, ENDS + 1] = v, w
    cx.edge[e, LINE], cx.edge[e, LINE + 1] = p, q
    cx.edge[e, EDGE_CHILD] = -1
    cx.edge[e, EDGE_MARK] = -1
    cx.count[N_EDGES] = e + 1
    return e


@nb.njit(cache=True)
def add_face(cx, plane, positive, negative):
    """Append a face without edges; `push_edge` fills the newest face."""
    f = cx.count[N_FACES]
    _require(f, 1, len(cx.face))
    cx.face[f, FACE_PLANE] = plane
    cx.face[f, SIDES], cx.face[f, SIDES + 1] = positive, negative
    cx.face[f, FACE_FIRST], cx.face[f, FACE_SIZE] = cx.count[N_LIST + EDGE_LIST], 0
    cx.face[f, FACE_CHILD] = -1
    cx.count[N_FACES] = f + 1
    return f


@nb.njit(cache=True)
def push_edge(cx, f, e):
    """Append edge e to the face whose list was opened last."""
    k = cx.count[N_LIST + EDGE_LIST]
    _require(k, 1, cx.lists.shape[1])
    cx.lists[EDGE_LIST, k] = e
    cx.face[f, FACE_SIZE] += 1
    cx.count[N_LIST + EDGE_LIST] = k + 1


@nb.njit(cache=True)
def add_cell(cx):
    """Append a cell without faces; `push_face` fills the newest cell."""
    c = cx.count[N_CELLS]
    _require(c, 1, len(cx.cell))
    cx.cell[c, CELL_FIRST], cx.cell[c, CELL_SIZE] = cx.count[N_LIST + FACE_LIST], 0
    cx.cell[c, CORNER_FIRST], cx.cell[c, CORNER_SIZE] = cx.count[N_LIST + CORNER_LIST], 0
    cx.cell[c, CELL_PLANE] = -1
    cx.cell[c, CELL_CHILD] = -1
    cx.label[c] = 0
    cx.count[N_CELLS] = c + 1
    return c


@nb.njit(cache=True)
def push_face(cx, c, f):
    """Append face f to the cell whose list was opened last."""
    k = cx.count[N_LIST + FACE_LIST]
    _require(k, 1, cx.lists.shape[1])
    cx.lists[FACE_LIST, k] = f
    cx.cell[c, CELL_SIZE] += 1
    cx.count[N_LIST + FACE_LIST] = k + 1


@nb.njit(cache=True)
def push_corner(cx, c, v):
    """Append vertex v to the corners of the newest cell."""
    k = cx.count[N_LIST + CORNER_LIST]
    _require(k, 1, cx.lists.shape[1])
    cx.lists[CORNER_LIST, k] = v
    cx.cell[c, CORNER_SIZE] += 1
    cx.count[N_LIST + CORNER_LIST] = k + 1


@nb.njit(cache=True)
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


@nb.njit(cache=True)
def vertex_sign(cx, h, v):
    """Sign of plane h at vertex v, remembered until another plane asks."""
    if cx.vertex[v, SIGN_PLANE] != h:
        cx.vertex[v, SIGN_PLANE] = h
        cx.vertex[v, SIGN] = sign_at_vertex(cx.planes, h, cx.vertices, cx.coordinates, v)
    return cx.vertex[v, SIGN]


@nb.njit(cache=True)
def _push_edge_leaves(cx, f, e):
    if cx.edge[e, EDGE_CHILD] < 0:
        push_edge(cx, f, e)
    else:
        _push_edge_leaves(cx, f, cx.edge[e, EDGE_CHILD])
        _push_edge_leaves(cx, f, cx.edge[e, EDGE_CHILD + 1])


@nb.njit(cache=True)
def refresh_face(cx, f):
    """Replace edges of face f that were split since by their parts."""
    first, size = cx.face[f, FACE_FIRST], cx.face[f, FACE_SIZE]
    stale = False
    for k in range(first, first + size):
        if cx.edge[cx.lists[EDGE_LIST, k], EDGE_CHILD] >= 0:
            stale = True
            break
    if stale:
        cx.face[f, FACE_FIRST], cx.face[f, FACE_SIZE] = cx.count[N_LIST + EDGE_LIST], 0
        for k in range(first, first + size):
            _push_edge_leaves(cx, f, cx.lists[EDGE_LIST, k])


@nb.njit(cache=True)
def _push_face_leaves(cx, c, f):
    if cx.face[f, FACE_CHILD] < 0:
        push_face(cx, c, f)
    else:
        _push_face_leaves(cx, c, cx.face[f, FACE_CHILD])
        _push_face_leaves(cx, c, cx.face[f, FACE_CHILD + 1])


@nb.njit(cache=True)
def refresh_cell(cx, c):
    """Replace faces of cell c that were split since by their parts, and refresh those."""
    first, size = cx.cell[c, CELL_FIRST], cx.cell[c, CELL_SIZE]
    stale = False
    for k in range(first, first + size):
        if cx.face[cx.lists[FACE_LIST, k], FACE_CHILD] >= 0:
            stale = True
            break
    if stale:
        cx.cell[c, CELL_FIRST], cx.cell[c, CELL_SIZE] = cx.count[N_LIST + FACE_LIST], 0
        for k in range(first, first + size):
            _push_face_leaves(cx, c, cx.lists[FACE_LIST, k])
    for k in range(cx.cell[c, CELL_FIRST], cx.cell[c, CELL_FIRST] + cx.cell[c, CELL_SIZE]):
        refresh_face(cx, cx.lists[FACE_LIST, k])


@nb.njit(cache=True)
def face_side(cx, f, h):
    """POSITIVE, NEGATIVE, CROSSED, or 0 where face f lies in plane h."""
    side = 0
    for k in range(cx.face[f, FACE_FIRST], cx.face[f, FACE_FIRST] + cx.face[f, FACE_SIZE]):
        e = cx.lists[EDGE_LIST, k]
        for end in range(2):
            s = vertex_sign(cx, h, cx.edge[e, ENDS + end])
            if s > 0:
                side |= POSITIVE
            elif s < 0:
                side |= NEGATIVE
        if side == CROSSED:
            return side
    return side


@nb.njit(cache=True)
def cell_side(cx, c, h):
    """POSITIVE, NEGATIVE or CROSSED: where the open cell c lies from plane h."""
    side = 0
    for k in range(cx.cell[c, CORNER_FIRST], cx.cell[c, CORNER_FIRST] + cx.cell[c, CORNER_SIZE]):
        s = vertex_sign(cx, h, cx.lists[CORNER_LIST, k])
        if s > 0:
            side |= POSITIVE
        elif s < 0:
            side |= NEGATIVE
        if side == CROSSED:
            return side
    return side


@nb.njit(cache=True)
def _split_edge(cx, e, h):
    """Split edge e, whose ends lie on opposite sides of h, into its positive and negative part."""
    v, w = cx.edge[e, ENDS], cx.edge[e, ENDS + 1]
    p, q = cx.edge[e, LINE], cx.edge[e, LINE + 1]
    m = add_vertex(cx, p, q, h)
    cx.vertex[m, SIGN_PLANE] = h
    cx.vertex[m, SIGN] = 0
    if vertex_sign(cx, h, v) < 0:
        v, w = w, v
    positive = add_edge(cx, v, m, p, q)
    negative = add_edge(cx, m, w, p, q)
    cx.edge[e, EDGE_CHILD], cx.edge[e, EDGE_CHILD + 1] = positive, negative


@nb.njit(cache=True)
def split_face(cx, f, h):
    """Split face f, crossed by plane h, into its positive and negative part; return their common edge.

    The two ends of the cut are the only vertices of the face on h, because the face is convex and crossed.
    """
    refresh_face(cx, f)
    first, size = cx.face[f, FACE_FIRST], cx.face[f, FACE_SIZE]
    for k in range(first, first + size):
        e = cx.lists[EDGE_LIST, k]
        if vertex_sign(cx, h, cx.edge[e, ENDS]) * vertex_sign(cx, h, cx.edge[e, ENDS + 1]) < 0:
            _split_edge(cx, e, h)
    refresh_face(cx, f)
    first, size = cx.face[f, FACE_FIRST], cx.face[f, FACE_SIZE]
    start = end = -1
    for k in range(first, first + size):
        for side in range(2):
            v = cx.edge[cx.lists[EDGE_LIST, k], ENDS + side]
            if vertex_sign(cx, h, v) == 0:
                if start < 0:
                    start = v
                elif v != start:
                    end = v
    cut = add_edge(cx, start, end, cx.face[f, FACE_PLANE], h)
    for child in range(2):
        part = add_face(cx, cx.face[f, FACE_PLANE], cx.face[f, SIDES], cx.face[f, SIDES + 1])
        cx.face[f, FACE_CHILD + child] = part
        for k in range(first, first + size):
            e = cx.lists[EDGE_LIST, k]
            s = vertex_sign(cx, h, cx.edge[e, ENDS]) + vertex_sign(cx, h, cx.edge[e, ENDS + 1])
            if (s > 0) == (child == 0):
                push_edge(cx, part, e)
        push_edge(cx, part, cut)
    return cut


@nb.njit(cache=True)
def _push_cut_edges(cx, cap, f, h, mark):
    """Append the edges of face f that lie in plane h to the face `cap`, each once."""
    for k in range(cx.face[f, FACE_FIRST], cx.face[f, FACE_FIRST] + cx.face[f, FACE_SIZE]):
        e = cx.lists[EDGE_LIST, k]
        if (
            cx.edge[e, EDGE_MARK] != mark
            and vertex_sign(cx, h, cx.edge[e, ENDS]) == 0
            and vertex_sign(cx, h, cx.edge[e, ENDS + 1]) == 0
        ):
            cx.edge[e, EDGE_MARK] = mark
            push_edge(cx, cap, e)


@nb.njit(cache=True)
def _own(cx, f, old, new):
    for side in range(2):
        if cx.face[f, SIDES + side] == old:
            cx.face[f, SIDES + side] = new


@nb.njit(cache=True)
def _push_corners(cx, c, part, cap, h, side):
    """Corners of the part of cell c on one side of h: those of c on that side, and those of the cap."""
    cx.count[MARK] += 1
    mark = cx.count[MARK]
    for k in range(cx.cell[c, CORNER_FIRST], cx.cell[c, CORNER_FIRST] + cx.cell[c, CORNER_SIZE]):
        v = cx.lists[CORNER_LIST, k]
        if vertex_sign(cx, h, v) == side:
            push_corner(cx, part, v)
    for k in range(cx.face[cap, FACE_FIRST], cx.face[cap, FACE_FIRST] + cx.face[cap, FACE_SIZE]):
        for end in range(2):
            v = cx.edge[cx.lists[EDGE_LIST, k], ENDS + end]
            if cx.vertex[v, VERTEX_MARK] != mark:
                cx.vertex[v, VERTEX_MARK] = mark
                push_corner(cx, part, v)


@nb.njit(cache=True)
def split_cell(cx, c, h):
    """Split cell c, crossed by plane h, into its positive and its negative part."""
    refresh_cell(cx, c)
    first, size = cx.cell[c, CELL_FIRST], cx.cell[c, CELL_SIZE]
    for k in range(first, first + size):
        f = cx.lists[FACE_LIST, k]
        if face_side(cx, f, h) == CROSSED:
            split_face(cx, f, h)
    refresh_cell(cx, c)
    first, size = cx.cell[c, CELL_FIRST], cx.cell[c, CELL_SIZE]
    cx.count[MARK] += 1
    mark = cx.count[MARK]
    cap = add_face(cx, h, -1, -1)
    for k in range(first, first + size):
        _push_cut_edges(cx, cap, cx.lists[FACE_LIST, k], h, mark)
    for child in range(2):
        part = add_cell(cx)
        cx.label[part] = cx.label[c]
        cx.cell[c, CELL_CHILD + child] = part
        cx.face[cap, SIDES + child] = part
        for k in range(first, first + size):
            f = cx.lists[FACE_LIST, k]
            if (face_side(cx, f, h) == POSITIVE) == (child == 0):
                push_face(cx, part, f)
                _own(cx, f, c, part)
        push_face(cx, part, cap)
        _push_corners(cx, c, part, cap, h, 1 if child == 0 else -1)
    cx.cell[c, CELL_PLANE] = h


@nb.njit(cache=True)
def leaves(cx):
    """Numbers of the present cells, refreshed, in ascending order."""
    n = cx.count[N_CELLS]
    result = np.empty(n, np.int64)
    m = 0
    for c in range(n):
        if cx.cell[c, CELL_CHILD] < 0:
            refresh_cell(cx, c)
            result[m] = c
            m += 1
    return result[:m]
