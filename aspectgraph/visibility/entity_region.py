"""From where one entity is observable: its region, as an exact binary space partition.

Guarantee: for every viewpoint that lies on none of the region's planes, the region holds it iff the open triangle of
viewpoint and entity misses the interior of the solid; on a plane, iff a neighbouring viewpoint's does.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from aspectgraph.cells.arrays import (
    CELL_CHILD,
    CORNER_FIRST,
    CORNER_LIST,
    CORNER_SIZE,
    CROSSED,
    N_CELLS,
    N_VERTICES,
    NEGATIVE,
    POSITIVE,
    SIGN_PLANE,
    Complex,
    Tree,
    add_box,
    allocate,
    tree_of,
    with_room,
)
from aspectgraph.cells.split import cell_side, n_leaves, simplify, split_cell, vertex_sign
from aspectgraph.solid.solid import Solid
from aspectgraph.visibility.blocked_sets import blockers, wedge_blockers
from aspectgraph.visibility.casting import Blockers
from aspectgraph.visibility.scene import Scene, check_deadline
from ground.decorators import entry_kernel, kernel, kernel_without_refcounts

if TYPE_CHECKING:
    from aspectgraph.entities.entity import Entity


_BOX = np.arange(6)
# cells from which simplifying pays, and cells to reserve room for at first
_SIMPLIFY_ABOVE = 4096
_ROOM = 1 << 11
# labels: of cells with unblocked parts, and of cells whose first part was cut off and not the second
_OPEN = np.uint64(1)
_FIRST_CUT_OFF = np.uint64(2)
# planes of a set whose crossing is remembered
_BITS = 64
# blocked sets between two looks at the clock
_SETS_AT_A_TIME = 64


class Region(NamedTuple):
    """The region of one entity.

    Attributes
    ----------
    tree : Tree
        Binary space partition of a cube around the workspace; its first six planes are that cube.
    origin : ndarray of int32, shape (p, 4)
        How each plane came about, see `blocked_sets.Blockers`; -1 for the box.
    observable : ndarray of bool, shape (n,)
        For each leaf, whether the whole entity is observable from there.
    """

    tree: Tree
    origin: np.ndarray
    observable: np.ndarray

    @property
    def n_leaves(self) -> int:
        """Number of convex cells of the partition."""
        return int((self.tree.plane < 0).sum())


def observable_region(
    scene: Scene, solid: Solid, entity: Entity, box: np.ndarray, deadline: float = math.inf
) -> Region:
    """Compute the region of one entity.

    Parameters
    ----------
    scene, solid
        The solid on its grid, and itself.
    entity : Entity
    box : ndarray of int64, shape (6, 4)
        Planes of a box around the workspace.
    deadline : float
        Time (`time.time`) by which to end.

    Raises
    ------
    DeadlineError
        If the region is not complete by then.
    """
    remainder = None
    if entity.kind != "edge":
        wedge = wedge_blockers(scene, solid, entity)
        remainder = _Left(_complex(wedge, box, deadline))
        if not remainder.any:
            return carved_region(wedge, box, deadline)
    sets = blockers(scene, solid, entity, deadline, remainder)
    return carved_region(sets, box, deadline, least_first=entity.kind != "edge")


class _Left:
    """What a complex leaves unblocked.

    Parameters
    ----------
    cx : Complex
    """

    def __init__(self, cx: Complex) -> None:
        self._cx = cx
        n_cells = cx.count[N_CELLS]
        is_leaf = cx.cell[:n_cells, CELL_CHILD] < 0
        self._cells = np.flatnonzero(is_leaf & (cx.label[:n_cells, 0] == _OPEN))

    @property
    def any(self) -> bool:
        """Whether it leaves anything."""
        return len(self._cells) > 0

    def sides(self, planes: np.ndarray) -> np.ndarray:
        """Return, for planes (n, 4), whether it leaves anything on the positive and the negative side: (n, 2) bool."""
        table = np.concatenate([self._cx.planes, planes])
        return np.asarray(
            _sides(self._cx._replace(planes=table), self._cells, len(self._cx.planes))
        )


@entry_kernel
def _sides(cx, cells, first):
    """Whether any of some cells has a part on the positive, and on the negative side of each plane from `first` on."""
    # the planes may have the numbers of others that were asked for before
    for v in range(cx.count[N_VERTICES]):
        cx.vertex[v, SIGN_PLANE] = -1
    result = np.zeros((len(cx.planes) - first, 2), np.bool_)
    for row in range(len(result)):
        for c in cells:
            place = cell_side(cx, c, first + row)
            result[row, 0] |= (place & POSITIVE) != 0
            result[row, 1] |= (place & NEGATIVE) != 0
            if result[row, 0] and result[row, 1]:
                break
    return result


def carved_region(
    shadows: Blockers,
    box: np.ndarray,
    deadline: float = math.inf,
    *,
    least_first: bool = False,
) -> Region:
    """Return the region of all points of a box, planes (6, 4), that no blocked set holds.

    `least_first` changes how cells are cut: faster, above all for sets of many planes. Edges stay as they always were.
    """
    cx = _complex(shadows, box, deadline, least_first)
    box_origin = np.full((len(box), 4), -1, np.int32)
    return compact(cx, np.concatenate([box_origin, shadows.origin]))


def _complex(
    shadows: Blockers, box: np.ndarray, deadline: float, least_first: bool = False
) -> Complex:
    """Return cells of a box, labelled `_OPEN` where no blocked set holds them; its planes come first."""
    planes = np.concatenate([box, shadows.planes])
    shifted = shadows._replace(plane=shadows.plane + len(box))
    return with_room(
        lambda n_cells: _cut(planes, shifted, n_cells, deadline, least_first),
        n_cells=max(_ROOM, 32 * len(shadows.first)),
    )


def _cut(
    planes: np.ndarray, shadows: Blockers, n_cells: int, deadline: float, least_first: bool
) -> Complex:
    """Cut the box by all blocked sets, simplifying whenever the cells have multiplied, and at the end."""
    cx = allocate(planes, n_cells)
    cx.label[add_box(cx, _BOX)] = 1
    n_sets = len(shadows.first) - 1
    done = 0
    limit = _SIMPLIFY_ABOVE
    n_simple = int(cx.count[N_CELLS])
    while True:
        check_deadline(deadline)
        end = min(done + _SETS_AT_A_TIME, n_sets)
        done = _insert(
            cx,
            shadows.first,
            shadows.plane,
            shadows.side,
            (done, end),
            limit,
            n_simple,
            least_first,
        )
        if done < n_sets and cx.count[N_CELLS] <= limit:
            continue
        cx = simplify(cx, _BOX, n_cells)
        if done == n_sets:
            return cx
        limit = max(_SIMPLIFY_ABOVE, 16 * n_leaves(cx))
        n_simple = int(cx.count[N_CELLS])
        _open_inner_cells(cx)


@entry_kernel
def _open_inner_cells(cx):
    """Label every split cell `_OPEN`, as a cell with unblocked parts; `_insert` finds out where there are none."""
    for c in range(cx.count[N_CELLS]):
        if cx.cell[c, CELL_CHILD] >= 0:
            cx.label[c, 0] = _OPEN


@kernel_without_refcounts
def _meets(cx, c, plane, side, crossing):
    """Whether the set may meet unblocked parts of cell c, and which planes may still cross those, one bit each.

    Parts that are all blocked close a split cell for good. Planes beyond the last bit always may cross.
    """
    child = cx.cell[c, CELL_CHILD]
    if (
        child >= 0
        and cx.label[c, 0] != 0
        and cx.label[child, 0] == 0
        and cx.label[cx.cell[c, CELL_CHILD + 1], 0] == 0
    ):
        cx.label[c, 0] = 0
    if cx.label[c, 0] == 0:
        return False, crossing
    for j in range(len(plane)):
        bit = np.uint64(1) << np.uint64(j) if j < _BITS else np.uint64(0)
        if bit != 0 and crossing & bit == 0:
            continue
        place = cell_side(cx, c, plane[j])
        if place == (2 if side[j] > 0 else 1):
            return False, crossing
        if place != CROSSED:
            crossing &= ~bit
    return True, crossing


@kernel_without_refcounts
def _cut_off(cx, c, plane, side):
    """Split cell c and return the part on the given side; the other one comes first in the order of work."""
    split_cell(cx, c, plane)
    keep = 0 if side > 0 else 1
    cx.label[c, 0] = _OPEN | (_FIRST_CUT_OFF if keep == 1 else np.uint64(0))
    return np.int64(cx.cell[c, CELL_CHILD + keep])


@kernel
def _block(cx, c, plane, side, crossing):
    """Cut the set out of leaf c, which it may meet, by its planes in order."""
    inside = c
    for j in range(len(plane)):
        if j < _BITS and not (crossing >> np.uint64(j)) & np.uint64(1):
            continue
        place = cell_side(cx, inside, plane[j])
        if place == CROSSED:
            inside = _cut_off(cx, inside, plane[j], side[j])
        elif place == (2 if side[j] > 0 else 1):
            # beyond one plane: the set misses the rest
            return
    # what remains lies in all half-spaces of the set
    cx.label[inside, 0] = 0


@kernel
def _block_least(cx, c, plane, side, crossing):
    """Cut the set out of leaf c, which it may meet, by the plane first that leaves the fewest corners.

    Sets of many planes miss about half of the leaves that none of their planes misses. That shows after fewer cuts.
    """
    inside = c
    todo = np.empty(len(plane), np.int64)
    n = 0
    for j in range(len(plane)):
        if j >= _BITS or (crossing >> np.uint64(j)) & np.uint64(1):
            todo[n] = j
            n += 1
    while n > 0:
        best_share = np.inf
        best = n_open = 0
        for i in range(n):
            j = todo[i]
            place = cell_side(cx, inside, plane[j])
            if place == (2 if side[j] > 0 else 1):
                return
            if place != CROSSED:
                continue
            share = _share_ahead(cx, inside, plane[j], side[j])
            if share < best_share:
                best_share = share
                best = n_open
            todo[n_open] = j
            n_open += 1
        if n_open > 0:
            j = todo[best]
            todo[best] = todo[n_open - 1]
            n_open -= 1
            inside = _cut_off(cx, inside, plane[j], side[j])
        n = n_open
    cx.label[inside, 0] = 0


@kernel_without_refcounts
def _share_ahead(cx, c, plane, side):
    """Share of the corners of cell c on the given side of a plane."""
    first = cx.cell[c, CORNER_FIRST]
    n = 0
    for k in range(first, first + cx.cell[c, CORNER_SIZE]):
        if vertex_sign(cx, plane, cx.lists[CORNER_LIST, k]) * side > 0:
            n += 1
    return n / cx.cell[c, CORNER_SIZE]


@kernel
def _leaves_met(cx, plane, side, n_simple):
    """Leaves of the tree's first `n_simple` cells that the set may meet, by number, and planes that may cross each."""
    cells = [np.int64(0) for _ in range(0)]
    planes = [np.uint64(0) for _ in range(0)]
    stack = [(np.int64(0), ~np.uint64(0))]
    while len(stack) > 0:
        c, crossing = stack.pop()
        met, crossing = _meets(cx, c, plane, side, crossing)
        if not met:
            continue
        child = np.int64(cx.cell[c, CELL_CHILD])
        if child < 0 or child >= n_simple:
            cells.append(c)
            planes.append(crossing)
        else:
            stack.append((child, crossing))
            stack.append((np.int64(cx.cell[c, CELL_CHILD + 1]), crossing))
    order = np.argsort(np.array(cells))
    return [(cells[k], planes[k]) for k in order]


@entry_kernel
def _insert(cx, first, plane, side, sets, limit, n_simple, least_first):
    """Block sets `sets[0]` up to `sets[1]`, or until the complex has `limit` cells; return the next set's number.

    A blocked cell is not cut again, and a set that misses a cell does not cut it, nor look at its parts. The cells are
    cut in the order of a list of all unblocked cells: at first the leaves among the first `n_simple` cells by their
    number, and later in the place of a cell its parts, those cut off first.
    """
    for k in range(sets[0], sets[1]):
        if cx.count[N_CELLS] > limit:
            return k
        own_plane = plane[first[k] : first[k + 1]]
        own_side = side[first[k] : first[k + 1]]
        for root in _leaves_met(cx, own_plane, own_side, n_simple):
            stack = [root]
            while len(stack) > 0:
                c, crossing = stack.pop()
                met, crossing = _meets(cx, c, own_plane, own_side, crossing)
                if not met:
                    continue
                child = np.int64(cx.cell[c, CELL_CHILD])
                if child < 0:
                    if least_first:
                        _block_least(cx, c, own_plane, own_side, crossing)
                    else:
                        _block(cx, c, own_plane, own_side, crossing)
                    continue
                cut_off = 0 if cx.label[c, 0] & _FIRST_CUT_OFF else 1
                stack.append((np.int64(cx.cell[c, CELL_CHILD + 1 - cut_off]), crossing))
                stack.append((np.int64(cx.cell[c, CELL_CHILD + cut_off]), crossing))
    return sets[1]


def compact(cx: Complex, origin: np.ndarray) -> Region:
    """Keep of a complex only its tree and the planes that tree uses."""
    _, plane, child = tree_of(cx)
    used = np.unique(np.concatenate([_BOX, plane[plane >= 0]]))
    number = np.full(len(cx.planes), -1, np.int32)
    number[used] = np.arange(len(used))
    inner = plane >= 0
    plane[inner] = number[plane[inner]]
    return Region(
        Tree(cx.planes[used], plane, child), origin[used], (cx.label[: len(plane), 0] == 1) & ~inner
    )
