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
    CROSSED,
    N_CELLS,
    Complex,
    add_box,
    allocate,
    with_room,
)
from aspectgraph.cells.point_location import Tree, tree_of
from aspectgraph.cells.simplify import n_leaves, simplify
from aspectgraph.cells.split import cell_side, split_cell
from aspectgraph.solid.solid import Solid
from aspectgraph.visibility.blocked_sets import blockers
from aspectgraph.visibility.deadline import check_deadline
from aspectgraph.visibility.scene import Scene
from aspectgraph.visibility.united_sets import Blockers
from compiled.decorators import entry_kernel, kernel_without_refcounts

if TYPE_CHECKING:
    from aspectgraph.entities.straight_edges import Entity

_BOX = np.arange(6)
# cells from which simplifying pays, and cells to reserve room for at first
_SIMPLIFY_ABOVE = 4096
_ROOM = 1 << 11
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
    return carved_region(blockers(scene, solid, entity, deadline), box, deadline)


def carved_region(shadows: Blockers, box: np.ndarray, deadline: float = math.inf) -> Region:
    """Return the region of all points of a box, planes (6, 4), that no blocked set holds."""
    planes = np.concatenate([box, shadows.planes])
    shifted = shadows._replace(plane=shadows.plane + len(box))
    cx = with_room(
        lambda n_cells: _cut(planes, shifted, n_cells, deadline),
        n_cells=max(_ROOM, 32 * len(shadows.first)),
    )
    box_origin = np.full((len(box), 4), -1, np.int32)
    return compact(cx, np.concatenate([box_origin, shadows.origin]))


def _cut(planes: np.ndarray, shadows: Blockers, n_cells: int, deadline: float) -> Complex:
    """Cut the box by all blocked sets, simplifying whenever the cells have multiplied, and at the end."""
    cx = allocate(planes, n_cells)
    cx.label[add_box(cx, _BOX)] = 1
    n_sets = len(shadows.first) - 1
    done = 0
    limit = _SIMPLIFY_ABOVE
    open_cells = _open_cells(cx)
    while True:
        check_deadline(deadline)
        end = min(done + _SETS_AT_A_TIME, n_sets)
        done, open_cells = _insert(
            cx, shadows.first, shadows.plane, shadows.side, (done, end), limit, open_cells
        )
        if done < n_sets and cx.count[N_CELLS] <= limit:
            continue
        cx = simplify(cx, _BOX, n_cells)
        if done == n_sets:
            return cx
        limit = max(_SIMPLIFY_ABOVE, 16 * n_leaves(cx))
        open_cells = _open_cells(cx)


def _open_cells(cx: Complex) -> np.ndarray:
    """Return the numbers of all leaves that no set blocks."""
    n_cells = cx.count[N_CELLS]
    is_leaf = cx.cell[:n_cells, CELL_CHILD] < 0
    return np.flatnonzero(is_leaf & (cx.label[:n_cells, 0] == 1))


@kernel_without_refcounts
def _disjoint(cx, c, plane, side):
    """Whether one of the set's own planes separates it from cell c."""
    for j in range(len(plane)):
        if cell_side(cx, c, plane[j]) == (2 if side[j] > 0 else 1):
            return True
    return False


@entry_kernel
def _insert(cx, first, plane, side, sets, limit, unblocked):
    """Block sets `sets[0]` up to `sets[1]`, or until the complex has `limit` cells.

    Return the number of the next set, and the cells that are still unblocked. A blocked cell is not cut again, and a
    set that misses a cell does not cut it.
    """
    open_cells = [np.int64(c) for c in unblocked]
    for k in range(sets[0], sets[1]):
        if cx.count[N_CELLS] > limit:
            return k, np.array(open_cells)
        own_plane = plane[first[k] : first[k + 1]]
        own_side = side[first[k] : first[k + 1]]
        still_open = [np.int64(0) for _ in range(0)]
        for c in open_cells:
            if _disjoint(cx, c, own_plane, own_side):
                still_open.append(c)
                continue
            inside = c
            for j in range(len(own_plane)):
                place = cell_side(cx, inside, own_plane[j])
                if place == CROSSED:
                    split_cell(cx, inside, own_plane[j])
                    keep = 0 if own_side[j] > 0 else 1
                    still_open.append(np.int64(cx.cell[inside, CELL_CHILD + 1 - keep]))
                    inside = np.int64(cx.cell[inside, CELL_CHILD + keep])
                elif place == (2 if own_side[j] > 0 else 1):
                    still_open.append(inside)
                    inside = np.int64(-1)
                    break
            if inside >= 0:
                cx.label[inside, 0] = 0
        open_cells = still_open
    return sets[1], np.array(open_cells)


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
