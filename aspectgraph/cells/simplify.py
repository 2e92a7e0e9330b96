"""Few convex cells from many: a partition built from the facets that really separate.

Cutting a complex by blocked sets leaves far more cells than the regions need. Only the faces between differently
labelled cells matter; `partition` cuts a cell along the planes of such facets alone, each part only by the facets
inside it (a binary space partition of the facets, Fuchs, Kedem and Naylor 1980). The last facet that cut a part off
tells what the part is.
"""

from __future__ import annotations

import numpy as np

from aspectgraph.cells.arrays import (
    CELL_CHILD,
    CROSSED,
    EDGE_LIST,
    ENDS,
    FACE_CHILD,
    FACE_FIRST,
    FACE_PLANE,
    FACE_SIZE,
    LINE,
    N_CELLS,
    N_EDGES,
    N_FACES,
    N_VERTICES,
    NEGATIVE,
    POSITIVE,
    SIDES,
    Complex,
    add_box,
    add_edge,
    add_face,
    add_vertex,
    allocate,
    push_edge,
)
from aspectgraph.cells.split import (
    cell_side,
    face_side,
    leaves,
    refresh_cell,
    refresh_face,
    split_cell,
    split_face,
)
from compiled.decorators import entry_kernel, holds_value, kernel, kernel_without_refcounts, put

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
            kept = start
            for k in range(start, start + size):
                if cx.face[pool[k], FACE_PLANE] != h:
                    pool[kept] = pool[k]
                    kept += 1
                else:
                    _retire(cx, pool[k])
            size = kept - start
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
