"""Which edges show as lines, and how a straight one ends: at a corner, or smoothly in an arc.

Rules
-----
* An edge *shows* if the surface turns there: a straight edge by `SHARP_DEG`, a chord of a curve by `FEATURE_DEG`, a
  chord between two facets of curved surfaces by `CURVED_FEATURE_DEG`, as facets meet at angles that the part has not.
  So every edge that can be an entity shows.
* An end of an edge is a *corner* if another edge that shows leaves it at `CORNER_DEG` or more from the edge's line,
  either way. Otherwise it is *tangent*: the edge runs on smoothly, and an image has no point to measure a length to.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from aspectgraph.solid.rims import SHARP_DEG
from aspectgraph.solid.topology import Edge, Face

FEATURE_DEG = 20.0
"""Smallest turn of the normal at which a chord of a curve shows, in degrees: above half of 30, by which facets turn.

A smooth seam beside a curved face turns by as much as half a facet."""

CURVED_FEATURE_DEG = 40.0
"""The same of a chord between two facets of curved surfaces."""

CORNER_DEG = 25.0
"""Smallest angle at which another edge leaves a corner, in degrees: below 17 an image's end is off by two pixels."""


class _Surface(Protocol):
    """What this module needs to know of a solid."""

    @property
    def vertices(self) -> NDArray[np.float64]:
        """Coordinates (n, 3), mm."""

    @property
    def faces(self) -> tuple[Face, ...]:
        """The faces."""

    @property
    def edges(self) -> tuple[Edge, ...]:
        """The edges."""


@dataclass(frozen=True)
class EdgeEnd:
    """One end of a straight edge: a corner or a tangent arc.

    Attributes
    ----------
    kind : str
        ``"corner"`` or ``"tangent"``, see the module's rules.
    vertex : int
        The vertex where it ends.
    angle_deg : float
        Largest angle between its line and another visible edge there, 0 to 90 degrees. It is 0 if
        there is none.
    arc : str or None
        For a tangent end, the rim or arc that continues the edge. None if it is not a circle.
    """

    kind: str
    vertex: int
    angle_deg: float
    arc: str | None = None

    @property
    def text(self) -> str:
        """The kind in words, with the arc: ``"corner"``, ``"tangent (a21)"``."""
        return f"{self.kind} ({self.arc})" if self.arc else self.kind


def edges_that_show(solid: _Surface) -> NDArray[np.bool_]:
    """Return which edges show as lines wherever they are seen, shape (e,).

    Parameters
    ----------
    solid : Solid
        The part.

    Returns
    -------
    ndarray of bool, shape (e,)
        In the order of ``solid.edges``.
    """
    turns = np.array([abs(edge.turn_deg) for edge in solid.edges])
    curved = np.array([edge.curved for edge in solid.edges], dtype=bool)
    on_curved = np.array([face.curved for face in solid.faces], dtype=bool)
    inside = on_curved[[edge.faces for edge in solid.edges]].all(axis=1)
    of_chords = np.where(inside, CURVED_FEATURE_DEG, FEATURE_DEG)
    return np.asarray(turns >= np.where(curved, of_chords, SHARP_DEG))


def edges_at_vertices(solid: _Surface) -> dict[int, list[Edge]]:
    """Return the edges at each vertex, those that show."""
    found: dict[int, list[Edge]] = {}
    for edge_id in np.flatnonzero(edges_that_show(solid)):
        edge = solid.edges[edge_id]
        for vertex in edge.vertices:
            found.setdefault(vertex, []).append(edge)
    return found


def find_edge_ends(
    solid: _Surface, edge: Edge, showing: Mapping[int, Sequence[Edge]], arc_of: Mapping[int, str]
) -> tuple[EdgeEnd, ...]:
    """Return how an edge ends at both of its vertices.

    Parameters
    ----------
    solid : Solid
        The part.
    edge : Edge
        One of its edges.
    showing : mapping
        Of each vertex, the edges that show there, see `edges_at_vertices`.
    arc_of : mapping
        Id of an edge to that of the rim or arc it is a chord of.

    Returns
    -------
    tuple of EdgeEnd
        In the order of ``edge.vertices``.
    """
    return tuple(
        _end(solid, edge, vertex, showing.get(vertex, ()), arc_of) for vertex in edge.vertices
    )


def _end(
    solid: _Surface, edge: Edge, vertex: int, showing: Sequence[Edge], arc_of: Mapping[int, str]
) -> EdgeEnd:
    others = [other for other in showing if other.id != edge.id]
    line = _direction(solid, edge, vertex)
    cosines = [float(line @ _direction(solid, other, vertex)) for other in others]
    angles = [float(np.degrees(np.arccos(min(1.0, abs(cosine))))) for cosine in cosines]
    widest = max(angles, default=0.0)
    if widest >= CORNER_DEG:
        return EdgeEnd("corner", vertex, widest)
    # of the edges it may run on in, the one that bends least
    ahead = sorted((cosine, other.id) for cosine, other in zip(cosines, others, strict=True))
    arc = next((arc_of[other] for _, other in ahead if other in arc_of), None)
    return EdgeEnd("tangent", vertex, widest, arc)


def _direction(solid: _Surface, edge: Edge, vertex: int) -> NDArray[np.float64]:
    """Return the unit vector along an edge away from one of its vertices."""
    a, b = edge.vertices
    along = solid.vertices[b if vertex == a else a] - solid.vertices[vertex]
    return np.asarray(along / np.linalg.norm(along), dtype=np.float64)
