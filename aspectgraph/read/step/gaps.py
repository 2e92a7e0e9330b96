"""How far apart the vertices, edges and faces of a solid lie that should meet.

Every face states its surface, every edge its curve, every vertex its point, each with numbers of its own. Where they
disagree the file does not say which of them is right, and the facets follow some of each.

Imports OCP; import this module only when a boundary representation is at hand.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from OCP.BRep import BRep_Tool
from OCP.BRepAdaptor import BRepAdaptor_Curve
from OCP.TopAbs import TopAbs_ShapeEnum
from OCP.TopExp import TopExp
from OCP.TopoDS import TopoDS

from aspectgraph.read.step.shapes import explore, xyz
from aspectgraph.read.step.triangles import is_planar

_N_SAMPLES = 7


@dataclass
class Gap:
    """The widest gap of a kind found so far.

    Attributes
    ----------
    gap_mm : float
    place : tuple of float
        A point at it.
    """

    gap_mm: float = 0.0
    place: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def widen(self, ones: np.ndarray, others: np.ndarray) -> None:
        """Take in the distances between points paired row by row, shape (n, 3)."""
        distances = np.linalg.norm(ones - others, axis=1)
        # not a number counts as infinitely far
        distances = np.where(np.isfinite(distances), distances, np.inf)
        k = int(np.argmax(distances))
        if distances[k] > self.gap_mm:
            self.gap_mm = float(distances[k])
            self.place = tuple(np.nan_to_num(others[k]).tolist())


def measure_gaps(solid: Any, flat_mm: float) -> dict[str, Gap]:
    """Return the widest gaps of a solid.

    Parameters
    ----------
    solid : TopoDS_Shape
        One solid.
    flat_mm : float
        See `triangles.tessellate`.

    Returns
    -------
    dict
        ``"vertex"``: between a vertex and the end of an edge; ``"planar"``: between an edge and a planar face it
        bounds; ``"curved"``: between an edge and a curved face.
    """
    gaps = {"vertex": Gap(), "planar": Gap(), "curved": Gap()}
    for shape in explore(solid, TopAbs_ShapeEnum.TopAbs_FACE):
        face = TopoDS.Face(shape)
        kind = "planar" if is_planar(face, flat_mm) else "curved"
        for edge in explore(face, TopAbs_ShapeEnum.TopAbs_EDGE):
            _measure_edge(TopoDS.Edge(edge), face, gaps["vertex"], gaps[kind])
    return gaps


def _measure_edge(edge: Any, face: Any, at_vertex: Gap, at_face: Gap) -> None:
    vertices = [TopExp.FirstVertex_s(edge, False), TopExp.LastVertex_s(edge, False)]
    if any(vertex.IsNull() for vertex in vertices):
        return
    ends = np.array([xyz(BRep_Tool.Pnt_s(vertex)) for vertex in vertices])
    on_face = _points_on_face(edge, face)
    if BRep_Tool.Degenerated_s(edge):
        at_face.widen(on_face, np.broadcast_to(ends[0], on_face.shape))
        return
    curve = BRepAdaptor_Curve(edge)
    (first, last) = BRep_Tool.Range_s(edge)
    points = np.array([xyz(curve.Value(t)) for t in np.linspace(first, last, _N_SAMPLES)])
    at_vertex.widen(points[[0, -1]], ends)
    at_face.widen(on_face, points)


def _points_on_face(edge: Any, face: Any) -> np.ndarray:
    """Return points of an edge as its face sees it, shape (n, 3)."""
    first, last = BRep_Tool.Range_s(edge, face)
    curve = BRep_Tool.CurveOnSurface_s(edge, face, first, last)
    surface = BRep_Tool.Surface_s(face)
    if curve is None:
        return np.full((_N_SAMPLES, 3), np.inf)
    places = [curve.Value(t) for t in np.linspace(first, last, _N_SAMPLES)]
    return np.array([xyz(surface.Value(uv.X(), uv.Y())) for uv in places])
