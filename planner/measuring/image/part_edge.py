"""Sharp edges of a part, and points on many of them at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from errors.measurands import Circle, Geometry, Line

Array = NDArray[np.float64]

_NOTHING = np.zeros(3)


@dataclass(frozen=True)
class PartEdge:
    """A sharp edge of the part.

    Attributes
    ----------
    name : str
        Its id, such as "e17", "r3" or "a5".
    geometry : Line or Circle
        Where it is, mm.
    edge_ids : tuple of int
        Edges of the solid: one, or the chords of a circle in their order.
    normals : array (n, 2, 3)
        Outward unit normals of both faces, for each of these.
    chord_mm : float
        Largest distance of a chord from the circle.
    """

    name: str
    geometry: Geometry
    edge_ids: tuple[int, ...]
    normals: Array
    chord_mm: float = 0.0

    def at(self, shares: Array) -> tuple[Array, Array, Array]:
        """Return points (n, 3), unit tangents (n, 3) and normals of both faces (n, 2, 3) at shares (n,) of it."""
        return EdgeTable([self]).at(np.zeros(len(shares), dtype=np.int64), shares)


class EdgeTable:
    """Some edges, as arrays.

    Parameters
    ----------
    edges : sequence of PartEdge
        The edges.

    Attributes
    ----------
    chord_mm : array (e,)
        Largest distance of each edge's chords from its circle.
    """

    def __init__(self, edges: Sequence[PartEdge]) -> None:
        self.edges = list(edges)
        self.chord_mm = np.array([edge.chord_mm for edge in edges])
        shapes = [edge.geometry for edge in edges]
        self._round = np.array([isinstance(one, Circle) for one in shapes])
        self._radius = np.array([one.radius_mm if isinstance(one, Circle) else 1 for one in shapes])
        self._span = np.array([one.span_rad if isinstance(one, Circle) else 0 for one in shapes])
        # where it starts or has its centre; the way along it, or two radii at right angles; its direction, or axis
        vectors = [
            (one.p, one.q - one.p, _NOTHING, one.direction)
            if isinstance(one, Line)
            else (one.centre, *one.basis, one.axis)
            for one in shapes
        ]
        self._origin, self._x, self._y, self._way = np.array(vectors).transpose(1, 0, 2)
        self._count = np.array([len(edge.normals) for edge in edges])
        self._first = np.cumsum(self._count) - self._count
        self._normals = np.concatenate([edge.normals for edge in edges])

    def at(self, number: NDArray[np.int64], shares: Array) -> tuple[Array, Array, Array]:
        """Return points (n, 3), unit tangents (n, 3) and normals of both faces (n, 2, 3).

        Parameters
        ----------
        number : array of int (n,)
            Number of each point's edge.
        shares : array (n,)
            Where on it, in [0, 1].
        """
        origin = self._origin[number]
        x = self._x[number]
        points = origin + shares[:, None] * x
        tangents = self._way[number]
        curved = self._round[number]
        own = number[curved]
        angle = (shares[curved] * self._span[own])[:, None]
        radius = self._radius[own][:, None]
        points[curved] = origin[curved] + radius * (
            np.cos(angle) * x[curved] + np.sin(angle) * self._y[own]
        )
        tangents[curved] = np.cross(self._way[own], points[curved] - origin[curved]) / radius
        chord = np.clip((shares * self._count[number]).astype(int), 0, self._count[number] - 1)
        return points, tangents, self._normals[self._first[number] + chord]
