"""Stretches of edges in place of whole edges: a metrologist looks at a short piece of each side of a wide slot.

A distance of 1.3 mm between edges of 35 mm asks for a picture of 35 mm, all of it in focus and unhidden, if the whole
edges must be seen. The value is there on any short piece of both. What is measured is the distance at that place: the
form of the faces is not averaged (two-point size, ISO 14405-1).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from aspectgraph import Entity, Solid, Stretch

MOST_PIECES = 12
"""Pieces of an edge at most."""
_AT_STRETCHES = ("distance", "angle", "centre_to_edge")


def stretch_ways(
    solid: Solid, kind: str, way: Sequence[Entity], stretch_mm: float
) -> list[tuple[Any, ...]]:
    """Return sets of entities with stretches in place of long edges, along the edges.

    Parameters
    ----------
    solid : Solid
        The part.
    kind : str
        Kind of the dimension. A length needs the whole edge.
    way : sequence of Entity
        Entities that give the value.
    stretch_mm : float
        Edges and stretches longer than this, mm, are cut into pieces of about this length.

    Returns
    -------
    list of tuple
        Items as `Dimension` takes them: a `Stretch` of each long edge, beside that of the other edge; the rest as it
        is. None, if no edge is long.
    """
    if kind not in _AT_STRETCHES:
        return []
    cut = [k for k, entity in enumerate(way) if _is_long(entity, stretch_mm)]
    if not cut:
        return []
    pieces = {k: _pieces(solid, way[k], stretch_mm) for k in cut}
    if any(not own for own in pieces.values()):
        return []
    longest, *others = sorted(cut, key=lambda k: -len(pieces[k]))
    found = []
    for stretch, middle in pieces[longest]:
        chosen: dict[int, Any] = {longest: stretch}
        for k in others:
            chosen[k] = _nearest(pieces[k], middle)
        found.append(tuple(chosen.get(k, entity) for k, entity in enumerate(way)))
    return list(dict.fromkeys(found))


def _is_long(entity: Entity, stretch_mm: float) -> bool:
    """Tell whether an entity is one edge or stretch that is worth cutting: into two pieces at least."""
    if entity.kind != "edge" or len(entity.edge_ids) != 1:
        return False
    return _length(entity) > 1.5 * stretch_mm


def _length(entity: Entity) -> float:
    return float(np.linalg.norm(entity.endpoints[1] - entity.endpoints[0]))


def _pieces(
    solid: Solid, entity: Entity, stretch_mm: float
) -> list[tuple[Stretch, NDArray[np.float64]]]:
    """Return the pieces of an edge or of a stretch of one, and the middle of each, mm."""
    from aspectgraph import Stretch, pieces_of_edge

    edge = entity.edge_ids[0]
    start, end = solid.edge_points(edge)
    cut: Sequence[Stretch]
    if isinstance(entity.part, Stretch):
        whole = entity.part
        n = min(MOST_PIECES, math.ceil(_length(entity) / stretch_mm - 1e-9))
        cuts = [whole.start + Fraction(k, n) * whole.share for k in range(n + 1)]
        cut = [Stretch(edge, *ends) for ends in pairwise(cuts)]
    else:
        cut = pieces_of_edge(solid, edge, stretch_mm, at_most=MOST_PIECES)
    return [(one, start + float(one.start + one.end) / 2 * (end - start)) for one in cut]


def _nearest(
    pieces: Sequence[tuple[Stretch, NDArray[np.float64]]], place: NDArray[np.float64]
) -> Stretch:
    """Return the piece whose middle is nearest; of equally near ones the first."""
    away = [round(float(np.linalg.norm(middle - place)), 6) for _, middle in pieces]
    return pieces[int(np.argmin(away))][0]
