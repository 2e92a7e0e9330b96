"""Where entities end on the grid: at vertices, or at cuts inside an edge, where a stretch ends.

A cut is the point of the grid on the edge's line nearest to its share of the edge, if that is within a step; then
everything is exact as for edges. Otherwise it is the grid's nearest point, off the line by less than a step. Then the
vertices of the solid count as lying on a plane within the resolution of a displaced part, as if snapping had displaced
the end of an edge.
"""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction
from math import gcd
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from aspectgraph.entities.parts import Stretch
from aspectgraph.exceptions import EntityError

if TYPE_CHECKING:
    from aspectgraph.entities.straight_edges import Entity
    from aspectgraph.solid.solid import Solid

_Point = tuple[int, int, int]


class Cut(NamedTuple):
    """A point of the grid at which an edge is cut, and whether it is on the edge's line."""

    point: _Point
    on_line: bool


def cut_point(start: Iterable[int], end: Iterable[int], share: Fraction) -> Cut:
    """Return the grid's point for a share of an edge, the same for the edge the other way round.

    Parameters
    ----------
    start, end : iterable of 3 int
        Ends of the edge on the grid.
    share : Fraction
        From the start, between 0 and 1.
    """
    a = tuple(int(x) for x in start)
    b = tuple(int(x) for x in end)
    if b < a:
        a, b = b, a
        share = 1 - share
    way = [q - p for p, q in zip(a, b, strict=True)]
    parts = gcd(*way)
    whole = round(share * parts)
    miss = abs(share - Fraction(whole, parts))
    if miss * miss * sum(x * x for x in way) <= 1:
        x, y, z = (p + w // parts * whole for p, w in zip(a, way, strict=True))
        return Cut((x, y, z), on_line=True)
    x, y, z = (round(p + share * w) for p, w in zip(a, way, strict=True))
    return Cut((x, y, z), on_line=False)


def with_cuts(solid: Solid, points: np.ndarray, entities: Iterable[Entity]) -> np.ndarray:
    """Return the vertices on the grid, int64, (n, 3), and after them the cuts of all stretches, each once, in order.

    Raises
    ------
    EntityError
        If a stretch has no length on the grid.
    """
    found: set[_Point] = set()
    for entity in entities:
        if not isinstance(entity.part, Stretch):
            continue
        ends = _end_points(solid, points, entity.part)
        if ends[0] == ends[1]:
            raise EntityError(f"a stretch must be longer than a grid step. Got {entity.part}.")
        vertices = {tuple(points[v].tolist()) for v in solid.edges[entity.part.edge].vertices}
        found |= {end for end in ends if end not in vertices}
    if not found:
        return points
    return np.concatenate([points, np.array(sorted(found), np.int64)])


def _end_points(solid: Solid, points: np.ndarray, stretch: Stretch) -> tuple[_Point, _Point]:
    a, b = (points[v].tolist() for v in solid.edges[stretch.edge].vertices)
    return cut_point(a, b, stretch.start).point, cut_point(a, b, stretch.end).point


def cut_numbers(
    solid: Solid, points: np.ndarray, stretch: Stretch, line: tuple[int, int]
) -> tuple[int, int]:
    """Return the numbers of a stretch's ends among vertices and cuts, sorted by their places; `line` ends its edge."""
    first, last = sorted(_end_points(solid, points, stretch))
    return _number(solid, points, line, first), _number(solid, points, line, last)


def _number(solid: Solid, points: np.ndarray, line: tuple[int, int], point: _Point) -> int:
    for v in line:
        if tuple(points[v].tolist()) == point:
            return v
    first = len(solid.vertices)
    (rows,) = np.nonzero((points[first:] == point).all(axis=1))
    return first + int(rows[0])


def cuts_on_line(solid: Solid, points: np.ndarray, stretch: Stretch) -> bool:
    """Return whether both ends of a stretch are on its edge's line."""
    a, b = (points[v].tolist() for v in solid.edges[stretch.edge].vertices)
    return all(cut_point(a, b, share).on_line for share in (stretch.start, stretch.end))


def cut_displacement_mm(
    solid: Solid, points: np.ndarray, stretch: Stretch, steps_mm: np.ndarray
) -> float:
    """Return the larger distance of a stretch's ends from their shares of the edge on the grid, in mm."""
    largest = 0.0
    a, b = (points[v].tolist() for v in solid.edges[stretch.edge].vertices)
    for share in (stretch.start, stretch.end):
        cut = cut_point(a, b, share).point
        off = [float(p + share * (q - p) - x) for p, q, x in zip(a, b, cut, strict=True)]
        largest = max(largest, float(np.linalg.norm(off * steps_mm)))
    return largest
