"""Regions of entities that consist of smaller pieces: each piece's region is computed once, and they are intersected.

Statement: let ab be a segment, c a point of it, and v a viewpoint off its line. The open triangle (v, a, b) is the
union of the open triangles (v, a, c) and (v, c, b) and of the open segment vc between them. The interior of a solid is
open. So if it meets the large triangle, it meets one of the small ones, and ab is observable exactly where ac and cb
are. The same holds for any number of pieces, and for chords of a rim by definition.

On the grid, a cut may lie off its edge's line by less than a step (see `cuts`). The statement then holds for the
pieces as they are on the grid, and the intersection is that of the broken line they form.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from fractions import Fraction
from itertools import groupby

import numpy as np

from aspectgraph.entities.parts import Run, Stretch
from aspectgraph.entities.straight_edges import Entity, resolve_entities
from aspectgraph.solid.rims import Arc, Rim
from aspectgraph.solid.solid import Solid
from aspectgraph.visibility.deadline import check_deadline
from aspectgraph.visibility.entity_region import Region, compact
from aspectgraph.visibility.overlay import overlay, share_planes
from aspectgraph.visibility.scene import Scene


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
        own = set(curve.edge_ids[first:position])
        same = next((name for name in sorted(held) if chords[name] == own), None)
        if same is not None:
            pieces[same] = own
        elif held:
            last = position % len(curve.edge_ids) if isinstance(curve, Rim) else position
            run = Run(curve.id, first, last)
            name = str(run)
            while name in taken:
                name += "+"
            hidden |= resolve_entities(solid, {name: run}, min_dihedral_deg=0.0)
            pieces[name] = own
    for name, held_chords in chords.items():
        if name not in pieces:
            composed[name] = tuple(piece for piece, own in pieces.items() if own <= held_chords)
