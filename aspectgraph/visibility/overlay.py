"""The joint complex of several regions: one convex partition in which every entity is observable or not per cell.

The regions' trees are laid over each other entity by entity; a cell is cut only where the next tree cuts it. Bit k of a
cell's label says that entity k is observable from it. Since trees cut wider than the true boundary of their region,
the result is simplified whenever the cells have multiplied.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from itertools import groupby
from typing import NamedTuple

import numpy as np

from aspectgraph.cells.arrays import (
    CELL_CHILD,
    CROSSED,
    N_CELLS,
    POSITIVE,
    Complex,
    add_box,
    allocate,
    bytes_in_use,
    with_room,
)
from aspectgraph.cells.split import cell_side, n_leaves, simplify, split_cell
from aspectgraph.entities.entity import Entity, Run, Stretch, resolve_entities
from aspectgraph.exact.planes import find_parallel, find_plane
from aspectgraph.solid.rims import Arc, Rim
from aspectgraph.solid.solid import Solid
from aspectgraph.visibility.casting import CONTRAST, FACE
from aspectgraph.visibility.entity_region import Region, compact
from aspectgraph.visibility.scene import Scene, check_deadline
from ground.decorators import entry_kernel, kernel

_BOX = np.arange(6)
# cells from which simplifying pays, and cells to reserve room for at first
_SIMPLIFY_ABOVE = 1024
_ROOM = 1 << 12

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
        n_cells=max(_ROOM, 64 * sum(region.n_leaves for region in regions)),
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
    limit = _SIMPLIFY_ABOVE
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
            limit = max(_SIMPLIFY_ABOVE, 4 * n_leaves(cx))
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
