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

from __future__ import annotations

import numpy as np

from aspectgraph.cells.arrays import (
    CELL_CHILD,
    CELL_FIRST,
    CELL_PLANE,
    CELL_SIZE,
    CORNER_FIRST,
    CORNER_LIST,
    CORNER_SIZE,
    CROSSED,
    EDGE_CHILD,
    EDGE_LIST,
    EDGE_MARK,
    ENDS,
    FACE_CHILD,
    FACE_FIRST,
    FACE_LIST,
    FACE_PLANE,
    FACE_SIZE,
    INSIDE,
    LINE,
    MARK,
    N_CELLS,
    N_EDGES,
    N_FACES,
    N_LIST,
    N_VERTICES,
    NEGATIVE,
    POSITIVE,
    SIDES,
    SIGN,
    SIGN_PLANE,
    VERTEX_MARK,
    Complex,
    add_box,
    add_cell,
    add_edge,
    add_face,
    add_vertex,
    allocate,
    push_corner,
    push_edge,
    push_face,
    require,
)
from aspectgraph.exact.grid import sign_at_vertex
from ground.decorators import entry_kernel, holds_value, kernel, kernel_without_refcounts, put


@kernel_without_refcounts
def vertex_sign(cx, h, v):
    """Sign of plane h at vertex v, remembered until another plane asks."""
    if cx.vertex[v, SIGN_PLANE] != h:
        cx.vertex[v, SIGN_PLANE] = h
        cx.vertex[v, SIGN] = sign_at_vertex(cx.planes, h, cx.vertices, cx.coordinates, v)
    return cx.vertex[v, SIGN]


@kernel_without_refcounts
def _push_edge_leaves(cx, f, e):
    """Append the parts of edge e that are not split, the positive part of each before the negative one.

    Negative parts wait at the far end of the row of lists. Each of them will need a place in the list itself, so the
    two meet only where the row is too short anyway.
    """
    end = cx.lists.shape[1]
    first_waiting = end
    while True:
        while cx.edge[e, EDGE_CHILD] >= 0:
            first_waiting -= 1
            require(cx.count[N_LIST + EDGE_LIST], 1, first_waiting)
            cx.lists[EDGE_LIST, first_waiting] = cx.edge[e, EDGE_CHILD + 1]
            e = np.int64(cx.edge[e, EDGE_CHILD])
        push_edge(cx, f, e)
        if first_waiting == end:
            return
        e = np.int64(cx.lists[EDGE_LIST, first_waiting])
        first_waiting += 1


@kernel_without_refcounts
def refresh_face(cx, f):
    """Replace edges of face f that were split since by their parts."""
    first = cx.face[f, FACE_FIRST]
    size = cx.face[f, FACE_SIZE]
    stale = False
    for k in range(first, first + size):
        if cx.edge[cx.lists[EDGE_LIST, k], EDGE_CHILD] >= 0:
            stale = True
            break
    if stale:
        cx.face[f, FACE_FIRST] = cx.count[N_LIST + EDGE_LIST]
        cx.face[f, FACE_SIZE] = 0
        for k in range(first, first + size):
            _push_edge_leaves(cx, f, cx.lists[EDGE_LIST, k])


@kernel_without_refcounts
def _push_face_leaves(cx, c, f):
    """Append the parts of face f that are not split; see `_push_edge_leaves`."""
    end = cx.lists.shape[1]
    first_waiting = end
    while True:
        while cx.face[f, FACE_CHILD] >= 0:
            first_waiting -= 1
            require(cx.count[N_LIST + FACE_LIST], 1, first_waiting)
            cx.lists[FACE_LIST, first_waiting] = cx.face[f, FACE_CHILD + 1]
            f = np.int64(cx.face[f, FACE_CHILD])
        push_face(cx, c, f)
        if first_waiting == end:
            return
        f = np.int64(cx.lists[FACE_LIST, first_waiting])
        first_waiting += 1


@kernel_without_refcounts
def refresh_cell(cx, c):
    """Replace faces of cell c that were split since by their parts, and refresh those."""
    first = cx.cell[c, CELL_FIRST]
    size = cx.cell[c, CELL_SIZE]
    stale = False
    for k in range(first, first + size):
        if cx.face[cx.lists[FACE_LIST, k], FACE_CHILD] >= 0:
            stale = True
            break
    if stale:
        cx.cell[c, CELL_FIRST] = cx.count[N_LIST + FACE_LIST]
        cx.cell[c, CELL_SIZE] = 0
        for k in range(first, first + size):
            _push_face_leaves(cx, c, cx.lists[FACE_LIST, k])
    for k in range(cx.cell[c, CELL_FIRST], cx.cell[c, CELL_FIRST] + cx.cell[c, CELL_SIZE]):
        refresh_face(cx, cx.lists[FACE_LIST, k])


@kernel_without_refcounts
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


@kernel_without_refcounts
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


@kernel_without_refcounts
def _split_edge(cx, e, h):
    """Split edge e, whose ends lie on opposite sides of h, into its positive and negative part."""
    v = cx.edge[e, ENDS]
    w = cx.edge[e, ENDS + 1]
    p = cx.edge[e, LINE]
    q = cx.edge[e, LINE + 1]
    m = add_vertex(cx, p, q, h)
    # the new vertex lies on h by construction
    cx.vertex[m, SIGN_PLANE] = h
    cx.vertex[m, SIGN] = 0
    if vertex_sign(cx, h, v) < 0:
        v, w = w, v
    positive = add_edge(cx, v, m, p, q)
    negative = add_edge(cx, m, w, p, q)
    cx.edge[e, EDGE_CHILD] = positive
    cx.edge[e, EDGE_CHILD + 1] = negative


@kernel_without_refcounts
def split_face(cx, f, h):
    """Split face f, crossed by plane h, into its positive and negative part; return their common edge.

    The two ends of the cut are the only vertices of the face on h, because the face is convex and crossed.
    """
    refresh_face(cx, f)
    first = cx.face[f, FACE_FIRST]
    size = cx.face[f, FACE_SIZE]
    for k in range(first, first + size):
        e = cx.lists[EDGE_LIST, k]
        if vertex_sign(cx, h, cx.edge[e, ENDS]) * vertex_sign(cx, h, cx.edge[e, ENDS + 1]) < 0:
            _split_edge(cx, e, h)
    refresh_face(cx, f)
    first = cx.face[f, FACE_FIRST]
    size = cx.face[f, FACE_SIZE]
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


@kernel_without_refcounts
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


@kernel_without_refcounts
def _own(cx, f, old, new):
    for side in range(2):
        if cx.face[f, SIDES + side] == old:
            cx.face[f, SIDES + side] = new


@kernel_without_refcounts
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


@kernel_without_refcounts
def split_cell(cx, c, h):
    """Split cell c, crossed by plane h, into its positive and its negative part."""
    refresh_cell(cx, c)
    first = cx.cell[c, CELL_FIRST]
    size = cx.cell[c, CELL_SIZE]
    for k in range(first, first + size):
        f = cx.lists[FACE_LIST, k]
        if face_side(cx, f, h) == CROSSED:
            split_face(cx, f, h)
    refresh_cell(cx, c)
    first = cx.cell[c, CELL_FIRST]
    size = cx.cell[c, CELL_SIZE]
    cx.count[MARK] += 1
    mark = cx.count[MARK]
    # the cell is convex, so one face in h closes both parts
    cap = add_face(cx, h, -1, -1)
    for k in range(first, first + size):
        _push_cut_edges(cx, cap, cx.lists[FACE_LIST, k], h, mark)
    for child in range(2):
        part = add_cell(cx)
        # word by word: assigning a row would allocate
        for word in range(cx.label.shape[1]):
            cx.label[part, word] = cx.label[c, word]
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


@entry_kernel
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


# Few convex cells from many: a partition built from the facets that really separate.
#
# Cutting a complex by blocked sets leaves far more cells than the regions need. Only the faces
# between differently labelled cells matter; `partition` cuts a cell along the planes of such
# facets alone, each part only by the facets inside it (a binary space partition of the facets,
# Fuchs, Kedem and Naylor 1980). The last facet that cut a part off tells what the part is.


_CANDIDATES = 10


def simplify(old: Complex, box: np.ndarray, n_cells: int) -> Complex:
    """Return a complex of the same box with the same labels everywhere, in fewer cells.

    Parameters
    ----------
    old : Complex
    box : ndarray of int, shape (6,)
        Planes of the starting box, in both complexes.
    n_cells : int
        Room for that many cells.
    """
    present = leaves(old)
    cx = allocate(old.planes, n_cells, old.label.shape[1])
    root = add_box(cx, box)
    cx.label[root] = old.label[present[0]]
    facets = _copy_facets(old, cx)
    partition(cx, np.array([root]), np.array([0, len(facets)]), facets, old.label)
    return cx


@entry_kernel
def _copy_facets(old, cx):
    """Copy the faces of `old` between differently labelled cells to `cx`; their sides name cells of `old`."""
    n = old.count[N_FACES]
    facets = np.empty(n, np.int64)
    m = 0
    new_vertex = np.full(old.count[N_VERTICES], -1, np.int64)
    new_edge = np.full(old.count[N_EDGES], -1, np.int64)
    for f in range(n):
        positive = old.face[f, SIDES]
        negative = old.face[f, SIDES + 1]
        if old.face[f, FACE_CHILD] >= 0 or positive < 0 or negative < 0:
            continue
        if _same(old.label[positive], old.label[negative]):
            continue
        edges = old.lists[
            EDGE_LIST, old.face[f, FACE_FIRST] : old.face[f, FACE_FIRST] + old.face[f, FACE_SIZE]
        ]
        for e in edges:
            if new_edge[e] < 0:
                for end in range(2):
                    v = old.edge[e, ENDS + end]
                    if new_vertex[v] < 0:
                        new_vertex[v] = _copy_vertex(old, cx, v)
                new_edge[e] = add_edge(
                    cx,
                    new_vertex[old.edge[e, ENDS]],
                    new_vertex[old.edge[e, ENDS + 1]],
                    old.edge[e, LINE],
                    old.edge[e, LINE + 1],
                )
        facets[m] = add_face(cx, old.face[f, FACE_PLANE], positive, negative)
        for e in edges:
            push_edge(cx, facets[m], new_edge[e])
        m += 1
    return facets[:m]


@kernel
def _same(label, other):
    same = True
    for word in range(len(label)):
        same &= label[word] == other[word]
    return same


@kernel
def _copy_vertex(old, cx, v):
    w = add_vertex(cx, 0, 2, 4)
    for row in range(4):
        put(cx.vertices[w, row], old.vertices[v, row])
    put(cx.coordinates[w], old.coordinates[v])
    return w


@kernel
def _grown(pool, room):
    if room <= len(pool):
        return pool
    larger = np.empty(2 * room, pool.dtype)
    put(larger, pool)
    return larger


@kernel
def _choose(cx, facets):
    """The facet whose plane splits few others, carries many, and balances the rest."""
    best = 0
    best_cost = np.inf
    stride = max(1, len(facets) // _CANDIDATES)
    seen = np.full(_CANDIDATES + 2, -1, np.int64)
    n_seen = 0
    for j in range(0, len(facets), stride):
        h = cx.face[facets[j], FACE_PLANE]
        if n_seen == len(seen) or holds_value(seen[:n_seen], h):
            continue
        seen[n_seen] = h
        n_seen += 1
        ahead = behind = crossed = coplanar = 0
        for f in facets:
            side = 0 if cx.face[f, FACE_PLANE] == h else face_side(cx, f, h)
            if side == POSITIVE:
                ahead += 1
            elif side == NEGATIVE:
                behind += 1
            elif side == CROSSED:
                crossed += 1
            else:
                coplanar += 1
        cost = 4.0 * crossed + 0.25 * abs(ahead - behind) - 2.0 * coplanar
        if cost < best_cost:
            best = j
            best_cost = cost
    return facets[best]


@kernel_without_refcounts
def _retire(cx, f):
    """Take a free facet that did its work out of everybody's sight: its sides are not cells of this complex."""
    cx.face[f, SIDES : SIDES + 2] = -1


@entry_kernel
def partition(cx, roots, first, facets, labels):
    """Cut each cell `roots[k]` along the free facets number `first[k]` to `first[k + 1]` and label the parts.

    The sides of a facet name the rows of `labels` that hold on its positive and its negative side. A root
    that no facet cuts keeps its label.
    """
    pool = facets.copy()
    used = len(facets)
    # all parts of a root come before the next root
    stack = [(roots[k], first[k], first[k + 1] - first[k]) for k in range(len(roots) - 1, -1, -1)]
    while len(stack) > 0:
        cell, start, size = stack.pop()
        while size > 0:
            chosen = _choose(cx, pool[start : start + size])
            h = cx.face[chosen, FACE_PLANE]
            if cell_side(cx, cell, h) == CROSSED:
                break
            # only where facets are not exactly planar: what lies on the cell's own boundary separates nothing in it
            slot = start
            for k in range(start, start + size):
                if cx.face[pool[k], FACE_PLANE] != h:
                    pool[slot] = pool[k]
                    slot += 1
                else:
                    _retire(cx, pool[k])
            size = slot - start
        if size == 0:
            continue
        split_cell(cx, cell, h)
        pool = _grown(pool, used + 2 * size)
        ahead = used
        behind = used + size
        n_ahead = n_behind = 0
        for k in range(start, start + size):
            f = pool[k]
            refresh_face(cx, f)
            side = 0 if cx.face[f, FACE_PLANE] == h else face_side(cx, f, h)
            if side == CROSSED:
                split_face(cx, f, h)
            if side & POSITIVE:
                pool[ahead + n_ahead] = cx.face[f, FACE_CHILD] if side == CROSSED else f
                n_ahead += 1
            if side & NEGATIVE:
                pool[behind + n_behind] = cx.face[f, FACE_CHILD + 1] if side == CROSSED else f
                n_behind += 1
            if side == 0 and f != chosen:
                _retire(cx, f)
        used += 2 * size
        for child in range(2):
            part = cx.cell[cell, CELL_CHILD + child]
            put(cx.label[part], labels[cx.face[chosen, SIDES + child]])
            refresh_cell(cx, part)
        _retire(cx, chosen)
        stack.append((np.int64(cx.cell[cell, CELL_CHILD]), ahead, n_ahead))
        stack.append((np.int64(cx.cell[cell, CELL_CHILD + 1]), behind, n_behind))


def n_leaves(cx: Complex) -> int:
    """Number of present cells."""
    return int((cx.cell[: cx.count[N_CELLS], CELL_CHILD] < 0).sum())


# Crop a complex to the workspace.
#
# Regions are computed in a cube along the grid's axes that is wide against any workspace
# (`Grid.cube_planes`), and cut to the workspace at the end. So neither the turn nor the size of
# the workspace has a say in how the cells inside are cut.


N_LIMITS = 6


def crop(cx: Complex, first: int) -> None:
    """Cut cells along the planes first, …, first + 5 of a box; clear the labels outside and flag them as `INSIDE`.

    Parameters
    ----------
    cx : Complex
    first : int
        Number of the plane x_min; x_max, y_min, y_max, z_min, z_max follow, all with the same positive side.
    """
    _crop(cx, first, INSIDE)


@entry_kernel
def _crop(cx, first, flag):
    for leaf in leaves(cx):
        c = leaf
        for h in range(first, first + N_LIMITS):
            inner = (h - first) % 2
            place = cell_side(cx, c, h)
            if (place == POSITIVE) if inner == 0 else (place == NEGATIVE):
                continue
            outer = c
            if place == CROSSED:
                split_cell(cx, c, h)
                outer = np.int64(cx.cell[c, CELL_CHILD + 1 - inner])
                c = np.int64(cx.cell[c, CELL_CHILD + inner])
            cx.label[outer] = 0
            cx.label[outer, cx.label.shape[1] - 1] = flag
            if outer == c:
                break


def at_limits(cx: Complex, first: int) -> np.ndarray:
    """Whether each cell has a face on one of the planes it was cropped by, as (c,) bool."""
    faces = cx.face[: int(cx.count[N_FACES])]
    on_limit = (
        (faces[:, FACE_PLANE] >= first)
        & (faces[:, FACE_PLANE] < first + N_LIMITS)
        & (faces[:, FACE_CHILD] < 0)
    )
    result = np.zeros(int(cx.count[N_CELLS]), bool)
    sides = faces[on_limit, SIDES : SIDES + 2]
    result[sides[sides >= 0]] = True
    return result
