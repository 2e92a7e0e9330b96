"""From where one entity is observable, and the regions of several entities laid over each other."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from itertools import groupby
from typing import NamedTuple

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
    bytes_in_use,
    tree_of,
    with_room,
)
from aspectgraph.cells.split import cell_side, n_leaves, simplify, split_cell, vertex_sign
from aspectgraph.entities.entity import Entity, Run, Stretch, resolve_entities
from aspectgraph.exact.grid import find_parallel, find_plane
from aspectgraph.solid.rims import Arc, Rim
from aspectgraph.solid.solid import Solid
from aspectgraph.visibility.blocked_sets import blockers, wedge_blockers
from aspectgraph.visibility.scene import CONTRAST, FACE, Blockers, Scene, check_deadline
from ground.decorators import entry_kernel, kernel, kernel_without_refcounts

# From where one entity is observable: its region, as an exact binary space partition.
#
# Guarantee: for every viewpoint that lies on none of the region's planes, the region holds it iff
# the open triangle of viewpoint and entity misses the interior of the solid; on a plane, iff a
# neighbouring viewpoint's does.


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
    sides_of = None
    if entity.kind != "edge":
        wedge = wedge_blockers(scene, solid, entity)
        remainder = _Left(_complex(wedge, box, deadline))
        if not remainder.any:
            return carved_region(wedge, box, deadline)
        sides_of = remainder.sides
    sets = blockers(scene, solid, entity, deadline, sides_of)
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


# The joint complex of several regions: one convex partition in which every entity is observable
# or not per cell.
#
# The regions' trees are laid over each other entity by entity; a cell is cut only where the next
# tree cuts it. Bit k of a cell's label says that entity k is observable from it. Since trees cut
# wider than the true boundary of their region, the result is simplified whenever the cells have
# multiplied.


# cells from which simplifying pays, and cells to reserve room for at first
_SIMPLIFY_OVERLAY_ABOVE = 1024
_OVERLAY_ROOM = 1 << 12

Watch = Callable[[int, int], None]
"""``watch(done, held)``: regions laid over each other so far, and bytes this holds; it may raise to end the work."""


class SharedPlanes(NamedTuple):
    """One plane table for several regions.

    Attributes
    ----------
    planes : ndarray of int64, shape (p, 4)
        The box, the faces of the solid, then what the regions add.
    number : list of ndarray of int32
        For each region, the shared number of each of its planes.
    flipped : list of ndarray of bool
        For each region, whether the shared plane has the opposite positive side.
    """

    planes: np.ndarray
    number: list[np.ndarray]
    flipped: list[np.ndarray]

    def extended(self, planes: np.ndarray) -> SharedPlanes:
        """The same with further planes, (n, 4), at the end of the table."""
        return self._replace(planes=np.concatenate([self.planes, planes]))


def share_planes(
    regions: Sequence[Region], scene: Scene, box: np.ndarray, order: Sequence[int] | None = None
) -> SharedPlanes:
    """Number the planes of all regions jointly, in some order; planes that agree at their defining points are one.

    Where snapping displaced vertices, planes parallel at those points to within the resolution become exactly parallel;
    otherwise they would meet far away. The planes of a single region stay as they were cast, so that its cells are
    exactly where its entity is observable.
    """
    room = len(box) + len(scene.planes) + sum(len(region.tree.planes) for region in regions)
    planes = np.empty((room, 4), np.int64)
    number_of: dict[tuple[int, ...], int] = {}
    n = 0
    displaced = scene.resolution > 0 and len(regions) > 1
    for plane in [*box, *scene.planes]:
        planes[n] = plane
        number_of.setdefault(_key(plane), n)
        n += 1
    numbers = [np.empty(0, np.int32)] * len(regions)
    for position in range(len(regions)) if order is None else order:
        region = regions[position]
        number = np.empty(len(region.tree.planes), np.int32)
        for k, (plane, origin) in enumerate(zip(region.tree.planes, region.origin, strict=True)):
            match = number_of.get(_key(plane), -1)
            if match < 0 and displaced and origin[0] not in (FACE, CONTRAST):
                trio = origin[1:].astype(np.int64)
                match = len(box) + find_plane(
                    planes[len(box) : n], n - len(box), scene.points, trio, scene.resolution
                )
                if match < len(box):
                    match = -1
                    plane = find_parallel(
                        planes[len(box) : n], scene.points, trio, scene.resolution, plane
                    )
            if match < 0:
                match = n
                n = n + 1
                planes[match] = plane
                number_of[_key(plane)] = match
            number[k] = match
        numbers[position] = number
    products = (
        planes[number, :3].astype(float) * region.tree.planes[:, :3]
        for number, region in zip(numbers, regions, strict=True)
    )
    flips = [product.sum(axis=1) < 0 for product in products]
    return SharedPlanes(planes[:n].copy(), numbers, flips)


def _key(plane: np.ndarray) -> tuple[int, ...]:
    coefficients = plane.tolist()
    leading = next(c for c in coefficients if c)
    return tuple(coefficients) if leading > 0 else tuple(-c for c in coefficients)


def n_words(n_entities: int) -> int:
    """Words of a label that holds one bit per entity and two flags."""
    return (n_entities + 2 + 63) // 64


def overlay(
    regions: Sequence[Region],
    shared: SharedPlanes,
    *,
    order: Sequence[int] | None = None,
    covering_only: bool = False,
    watch: Watch | None = None,
) -> Complex:
    """Lay regions over each other.

    Parameters
    ----------
    regions : sequence of k Region
    shared : SharedPlanes
        Their planes.
    order : sequence of int, optional
        In which they are laid over each other; it changes no label. Default: as given, as `covering_only` needs it.
    covering_only : bool
        Leave cells uncut from which some entity is not observable: enough to find where all of them are.
    watch : callable, optional
        Is told of every region, and of every step that takes memory.

    Returns
    -------
    Complex
        Bit k of a present cell's label is set iff entity k is observable from it. With `covering_only` all bits are set
        iff all entities are, and none otherwise.
    """
    order = range(len(regions)) if order is None else order
    return with_room(
        lambda n_cells: _overlay(regions, shared, order, covering_only, n_cells, watch),
        n_cells=max(_OVERLAY_ROOM, 64 * sum(region.n_leaves for region in regions)),
    )


def _overlay(
    regions: Sequence[Region],
    shared: SharedPlanes,
    order: Sequence[int],
    covering_only: bool,
    n_cells: int,
    watch: Watch | None,
) -> Complex:
    cx = allocate(shared.planes, n_cells, n_words(len(regions)))
    add_box(cx, _BOX)
    limit = _SIMPLIFY_OVERLAY_ABOVE
    for done, k in enumerate(order, start=1):
        tree = regions[k].tree
        inner = tree.plane >= 0
        plane = np.where(inner, shared.number[k][tree.plane], -1).astype(np.int32)
        child = tree.child.copy()
        swapped = inner & shared.flipped[k][tree.plane]
        child[swapped] = child[swapped][:, ::-1]
        _add_region(cx, plane, child, regions[k].observable, k, covering_only)
        if covering_only:
            _forget_uncovered(cx, k + 1)
        if watch is not None:
            watch(done, bytes_in_use(cx))
        if n_leaves(cx) > limit:
            cx = simplify(cx, _BOX, n_cells)
            limit = max(_SIMPLIFY_OVERLAY_ABOVE, 4 * n_leaves(cx))
    return simplify(cx, _BOX, n_cells)


@kernel
def _covers(label, k):
    """Whether the bits of entities 0 to k - 1 are all set."""
    for bit in range(k):
        if not (label[bit // 64] >> np.uint64(bit % 64)) & np.uint64(1):
            return False
    return True


@entry_kernel
def _forget_uncovered(cx, k):
    """Clear labels that lack one of the first k bits, so that simplifying joins their cells."""
    for c in range(cx.count[N_CELLS]):
        if cx.cell[c, CELL_CHILD] < 0 and not _covers(cx.label[c], k):
            cx.label[c] = 0


@entry_kernel
def _add_region(cx, plane, child, observable, k, covering_only):
    """Set bit k where region k holds the cell, cutting cells its tree cuts."""
    bit = np.uint64(1) << np.uint64(k % 64)
    stack = [(0, 0) for _ in range(0)]
    for c in range(cx.count[N_CELLS]):
        if cx.cell[c, CELL_CHILD] < 0 and not (covering_only and not _covers(cx.label[c], k)):
            stack.append((c, 0))
    while len(stack) > 0:
        cell, node = stack.pop()
        if plane[node] < 0:
            if observable[node]:
                cx.label[cell, k // 64] |= bit
            continue
        place = cell_side(cx, cell, plane[node])
        if place == CROSSED:
            split_cell(cx, cell, plane[node])
            stack.append((np.int64(cx.cell[cell, CELL_CHILD]), np.int64(child[node, 0])))
            stack.append((np.int64(cx.cell[cell, CELL_CHILD + 1]), np.int64(child[node, 1])))
        else:
            stack.append((cell, np.int64(child[node, 0 if place == POSITIVE else 1])))


# Regions of entities that consist of smaller pieces: each piece's region is computed once, and
# they are intersected.
#
# Statement: let ab be a segment, c a point of it, and v a viewpoint off its line. The open
# triangle (v, a, b) is the union of the open triangles (v, a, c) and (v, c, b) and of the open
# segment vc between them. The interior of a solid is open. So if it meets the large triangle, it
# meets one of the small ones, and ab is observable exactly where ac and cb are. The same holds
# for any number of pieces, and for chords of a rim by definition.
#
# On the grid, a cut may lie off its edge's line by less than a step (see `cuts`). The statement
# then holds for the pieces as they are on the grid, and the intersection is that of the broken
# line they form.


def intersection(
    scene: Scene, cube: np.ndarray, regions: Sequence[Region], deadline: float = math.inf
) -> Region:
    """Return the region of all viewpoints that every one of some regions holds, exactly.

    Parameters
    ----------
    scene : Scene
        The solid on its grid.
    cube : ndarray of int64, shape (6, 4)
        The box that the regions were cut from.
    regions : sequence of Region
        At least one.
    deadline : float
        Time (`time.time`) by which to end.

    Raises
    ------
    DeadlineError
        If the region is not complete by then.
    """
    check_deadline(deadline)
    if len(regions) == 1:
        return regions[0]
    # only planes that are equal become one: the pieces' regions stay as they are
    shared = share_planes(regions, scene._replace(resolution=0.0), cube)
    origin = np.full((len(shared.planes), 4), -1, np.int32)
    for region, number in zip(reversed(regions), reversed(shared.number), strict=True):
        origin[number] = region.origin
    cells = overlay(
        regions, shared, covering_only=True, watch=lambda _done, _held: check_deadline(deadline)
    )
    cells.label[:, 0] &= np.uint64(1)
    return compact(cells, origin)


def find_pieces(
    solid: Solid, entities: Mapping[str, Entity]
) -> tuple[dict[str, tuple[str, ...]], dict[str, Entity]]:
    """Find the entities that are best computed from pieces.

    A stretch is, if other stretches asked for make it up without gap or overlap. Rims and arcs of which runs are asked
    for are, as these runs are, if there are at least two of them: they overlap.

    Parameters
    ----------
    solid : Solid
        The part.
    entities : mapping of str to Entity
        All entities asked for.

    Returns
    -------
    composed : dict of str to tuple of str
        The names of the pieces of each such entity.
    hidden : dict of str to Entity
        The pieces that are not asked for themselves.
    """
    composed = _of_stretches(entities)
    hidden: dict[str, Entity] = {}
    of_runs = {e.part.curve for e in entities.values() if isinstance(e.part, Run)}
    curves = (*solid.rims(0.0), *solid.arcs(0.0)) if of_runs else ()
    for curve in (curve for curve in curves if curve.id in of_runs):
        chords = {
            name: set(entity.edge_ids) for name, entity in entities.items() if _is_of(entity, curve)
        }
        if len(chords) > 1:
            _compose_runs(solid, curve, chords, entities, composed, hidden)
    return composed, hidden


def _is_of(entity: Entity, curve: Arc) -> bool:
    """Return whether an entity is a rim or arc or a run of it."""
    if entity.part is None:
        return entity.edge_ids == curve.edge_ids
    return isinstance(entity.part, Run) and entity.part.curve == curve.id


def _of_stretches(entities: Mapping[str, Entity]) -> dict[str, tuple[str, ...]]:
    """Return which stretches others make up, and those: always the shortest there are."""
    composed: dict[str, tuple[str, ...]] = {}
    stretches = [
        (name, entity.part) for name, entity in entities.items() if isinstance(entity.part, Stretch)
    ]
    shortest_first = sorted(stretches, key=lambda item: item[1].share)
    base: dict[int, list[tuple[str, Stretch]]] = {}
    for name, stretch in shortest_first:
        pieces = base.setdefault(stretch.edge, [])
        path = _path(pieces, stretch.start, stretch.end)
        if path is None:
            pieces.append((name, stretch))
        else:
            composed[name] = tuple(path)
    return composed


def _path(
    pieces: Sequence[tuple[str, Stretch]], start: Fraction, end: Fraction
) -> list[str] | None:
    """Return the pieces that lead from one cut to another, or None."""
    came: dict[Fraction, tuple[str, Fraction]] = {}
    front = [start]
    while front:
        at = front.pop()
        for name, piece in pieces:
            if piece.start == at and piece.end <= end and piece.end not in came:
                came[piece.end] = (name, at)
                front.append(piece.end)
    if end not in came:
        return None
    path = []
    while end != start:
        name, end = came[end]
        path.append(name)
    return path[::-1]


def _compose_runs(
    solid: Solid,
    curve: Arc,
    chords: Mapping[str, set[int]],
    taken: Mapping[str, Entity],
    composed: dict[str, tuple[str, ...]],
    hidden: dict[str, Entity],
) -> None:
    """Add the pieces of a curve that no run asked for divides, and which of them make up which run."""
    pieces: dict[str, set[int]] = {}
    position = 0
    holders = [frozenset(name for name in chords if e in chords[name]) for e in curve.edge_ids]
    for held, group in groupby(holders):
        first = position
        position += len(list(group))
        chord_set = set(curve.edge_ids[first:position])
        same = next((name for name in sorted(held) if chords[name] == chord_set), None)
        if same is not None:
            pieces[same] = chord_set
        elif held:
            last = position % len(curve.edge_ids) if isinstance(curve, Rim) else position
            run = Run(curve.id, first, last)
            name = str(run)
            while name in taken:
                name += "+"
            hidden |= resolve_entities(solid, {name: run}, min_dihedral_deg=0.0)
            pieces[name] = chord_set
    for name, held_chords in chords.items():
        if name not in pieces:
            composed[name] = tuple(
                piece for piece, chord_set in pieces.items() if chord_set <= held_chords
            )
