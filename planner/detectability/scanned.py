"""Which entities are scanned for lines and circles, and how near other lines may come to them.

A fit needs no corners: it takes points all along an entity. A point with another line nearby is left out. So a share of
the points may lie beside other lines, but not all of those of a twelfth: the far rim of a through hole crosses the
image of the near one in all oblique views.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from errors.measurands.geometry import Circle, Geometry

Array = NDArray[np.float64]
Pairs = NDArray[np.int64]

COVERAGE_SHARE = 0.8
"""Share of the points of an entity that must be found, at least."""
SECTORS = 12
"""Parts of an entity in each of which a point must be found."""
# points of an entity in a check: two in each twelfth
_POINTS = 2 * SECTORS
# of these so many may lie beside another line
_LOST = round((1.0 - COVERAGE_SHARE) * _POINTS - 0.5)


@dataclass(frozen=True)
class Scanned:
    """A line or circle of the part that is scanned for.

    Attributes
    ----------
    edge_ids : tuple of int
        Its edges in ``solid.edges``.
    points : array (24, 3)
        Points all along it, mm.
    """

    edge_ids: tuple[int, ...]
    points: Array = field(repr=False, compare=False)

    @classmethod
    def of(cls, edge_ids: Sequence[int], geometry: Geometry) -> Scanned:
        """Return what is scanned of an entity."""
        shares = (np.arange(_POINTS) + 0.5) / _POINTS
        if isinstance(geometry, Circle):
            return cls(tuple(edge_ids), geometry.points(shares * geometry.span_rad))
        way = np.asarray(geometry.q) - np.asarray(geometry.p)
        return cls(tuple(edge_ids), np.asarray(geometry.p) + shares[:, None] * way)


class Pieces(NamedTuple):
    """Pieces (c) of entities, each of which is asked how near other lines come.

    Attributes
    ----------
    ends : array (c, 2, 3)
        Of each: an edge, or twice the same point.
    line : array of int (c,)
        Number of the edges, of those that `of` returns, that it belongs to.
    first : array of int (k + 1,)
        Where those of each entity begin.
    """

    ends: Array
    line: NDArray[np.int64]
    first: NDArray[np.int64]

    @classmethod
    def of(
        cls,
        edge_ids: Sequence[Sequence[int] | None],
        ends: Array,
        scanned: Sequence[Sequence[Scanned]],
    ) -> tuple[Pieces, list[tuple[int, ...]]]:
        """Return the pieces of entities, and the edges that they belong to.

        Parameters
        ----------
        edge_ids : sequence of (sequence of int or None)
            Of each entity (k) that is an edge with ends.
        ends : array (k, 2, 3)
            Their ends, mm.
        scanned : sequence of sequence of Scanned
            What is scanned of the others.
        """
        places: list[Array] = []
        line: list[int] = []
        first = [0]
        lines: dict[tuple[int, ...], int] = {}
        for ids, own, parts in zip(edge_ids, ends, scanned, strict=True):
            if ids is not None:
                places.append(own[None])
                line.append(lines.setdefault(tuple(ids), len(lines)))
            for part in parts if ids is None else ():
                places.append(np.repeat(part.points[:, None], 2, axis=1))
                line.extend([lines.setdefault(part.edge_ids, len(lines))] * _POINTS)
            first.append(len(line))
        rows = np.concatenate([np.zeros((0, 2, 3)), *places])
        return cls(rows, np.array(line, np.int64), np.array(first, np.int64)), list(lines)

    def of_pairs(self, pairs: Pairs) -> PiecesOfPairs:
        """Return the pieces of pairs (p, 2) of a pose and an entity."""
        count = np.diff(self.first)[pairs[:, 1]]
        pair = np.repeat(np.arange(len(pairs)), count)
        begin = np.cumsum(count) - count
        piece = np.arange(len(pair)) - begin[pair] + self.first[pairs[pair, 1]]
        return PiecesOfPairs(
            np.column_stack([pairs[pair, 0], piece]), pair, (count > 1)[pair], len(pairs)
        )

    def batches(self, pairs: Pairs, most: int) -> Iterable[Pairs]:
        """Yield pairs, so many that they have about so many pieces."""
        number = np.cumsum(np.diff(self.first)[pairs[:, 1]]) // most
        cuts = np.flatnonzero(np.diff(number)) + 1
        return (some for some in np.split(pairs, cuts) if len(some))


class PiecesOfPairs(NamedTuple):
    """Pieces of pairs of a pose and an entity, and how the pairs follow from them.

    Attributes
    ----------
    rows : array of int (q, 2)
        Pose and piece.
    pair : array of int (q,)
        Which pair each is of.
    scanned : array of bool (q,)
        Whether it is one of the points that are scanned.
    n : int
        Number of pairs.
    """

    rows: Pairs
    pair: NDArray[np.int64]
    scanned: NDArray[np.bool_]
    n: int

    def least_distance(self, near: Array) -> Array:
        """Return how near other lines may be said to come to pairs, by how near they come to pieces (q,), px; (n,).

        To a whole edge that is the least distance. Of an entity that is scanned, it is the largest distance that
        enough points keep, and one in each twelfth.
        """
        found = np.full(self.n, np.inf)
        edges = ~self.scanned
        found[self.pair[edges]] = near[edges]
        if self.scanned.any():
            points = near[self.scanned].reshape(-1, _POINTS)
            enough = np.sort(points, axis=1)[:, _LOST]
            in_each = points.reshape(len(points), SECTORS, -1).max(axis=2).min(axis=1)
            whose = self.pair[self.scanned][::_POINTS]
            np.minimum.at(found, whose, np.minimum(enough, in_each))
        return found
