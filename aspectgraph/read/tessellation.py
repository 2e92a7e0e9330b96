"""Triangles on their way from a reader to a solid."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from aspectgraph.solid.circles import CircularEdge


@dataclass
class Tessellation:
    """Triangles of a closed surface and what is known of the surface behind them.

    Attributes
    ----------
    vertices : ndarray, shape (n, 3)
        In mm.
    triangles : ndarray of int, shape (t, 3)
        Counter-clockwise seen from outside.
    patch : ndarray of int, shape (t,)
        The surface each triangle belongs to, 0..p-1 (all 0 if unknown).
    curved_patch : ndarray of bool, shape (p,)
        Which of them are curved; triangles of two curved ones, or of a curved and a planar one, are never joined.
    curved_edges : set of (int, int)
        Vertex pairs, lower index first, of chords of curved or smooth edges.
    circular_edges : list of CircularEdge or None
        The circular edges of the CAD model; None where they are not known.
    surface_turns : dict of (int, int) to float
        Vertex pairs, lower index first, of the chords of sharp straight edges beside curved patches, and the turn of
        the surfaces' normal there in degrees.
    faceted_patches : set of int
        Patches that are facets without a surface behind them; facets of curved surfaces are recognised among them (see
        `curved_facets`).
    """

    vertices: np.ndarray
    triangles: np.ndarray
    patch: np.ndarray
    curved_patch: np.ndarray
    curved_edges: set[tuple[int, int]] = field(default_factory=set)
    circular_edges: list[CircularEdge] | None = None
    surface_turns: dict[tuple[int, int], float] = field(default_factory=dict)
    faceted_patches: set[int] = field(default_factory=set)
