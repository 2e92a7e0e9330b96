"""The kernel's mesher, and what helps where it leaves a face without triangles, or too far from its surface.

A whole cone has a seam: an edge with two curves in the surface's parameters, one period apart. Where these end a
rounding error beside the curves of the rims, the mesher gives the cone up (OCCT #572), and says so nowhere. The same
cone as a surface of revolution, with the same parameters and the same edges, is meshed. Finer tolerances come next.

Facets of tori can leave their surface by more than the tolerance the mesher is given; twice as far was seen. A face
whose facets do is meshed again with less of it.

Imports OCP; import this module only in the kernel's process.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from OCP.BRep import BRep_Builder, BRep_Tool
from OCP.BRepAdaptor import BRepAdaptor_Surface
from OCP.BRepMesh import BRepMesh_IncrementalMesh
from OCP.BRepTools import BRepTools, BRepTools_ReShape
from OCP.Geom import Geom_ConicalSurface, Geom_Line, Geom_SurfaceOfRevolution
from OCP.gp import gp_Dir, gp_Pnt, gp_Vec
from OCP.TopAbs import TopAbs_Orientation, TopAbs_ShapeEnum
from OCP.TopLoc import TopLoc_Location
from OCP.TopoDS import TopoDS, TopoDS_Iterator

from aspectgraph.exceptions import ReadError
from aspectgraph.read.step.facets.deviation import deviation_mm
from aspectgraph.read.step.shapes import explore, xyz
from aspectgraph.solid.places import describe_point

_SHARES = (1.0, 0.9, 0.8, 0.65, 0.5, 0.35, 0.25)
"""Shares of the chord tolerance that are tried where the tolerance itself leaves a face without triangles."""

_FINER = 0.75
"""What share of its last tolerance a face gets next whose facets leave its surface by more than the chord tolerance."""

_MAX_REFINEMENTS = 12

_FORWARD = TopAbs_Orientation.TopAbs_FORWARD


def mesh_solid(solid: Any, chord_tolerance_mm: float, angular_tolerance_rad: float) -> Any:
    """Give every face of a solid triangles that leave its surface by no more than the chord tolerance.

    Parameters
    ----------
    solid : TopoDS_Shape
        One solid.
    chord_tolerance_mm, angular_tolerance_rad : float
        See `triangles.tessellate`. They hold for every attempt.

    Returns
    -------
    TopoDS_Shape
        The solid with its triangles. Cones that the mesher gives up are surfaces of revolution in it; edges and
        vertices are those of the solid given.

    Raises
    ------
    ReadError
        The mesher leaves a face without triangles, or with triangles too far from it, whatever is tried.
    """
    _mesh(solid, chord_tolerance_mm, angular_tolerance_rad)
    surfaces = [BRepAdaptor_Surface(face) for face in _faces(solid)]
    twin = solid
    for index in _bare_faces(solid):
        face = TopoDS.Face(_faces(twin)[index].Oriented(_FORWARD))
        surface = BRep_Tool.Surface_s(face)
        if isinstance(surface, Geom_ConicalSurface):
            twin = _with_revolved(twin, face, surface)
    for share in _SHARES:
        if twin is not solid or share < 1.0:
            _mesh(twin, share * chord_tolerance_mm, angular_tolerance_rad)
        bare = _bare_faces(twin)
        if bare:
            continue
        wide = _refine(twin, surfaces, share, chord_tolerance_mm, angular_tolerance_rad)
        if not wide:
            return twin
    if bare:
        raise ReadError(
            f"every face must be tessellated. Got no triangles for face {bare[0]} of the solid, "
            f"{_describe(surfaces[bare[0]])}; OCCT meshes it with none of the chord tolerances "
            f"from {_SHARES[-1] * chord_tolerance_mm:.3g} to {chord_tolerance_mm:.3g} mm. "
            "Try a larger one with chord_tolerance_mm=..., or export the part as a mesh."
        )
    raise ReadError(
        f"facets must leave their surface by at most chord_tolerance_mm={chord_tolerance_mm:.3g}. "
        f"Got more on face {wide[0]} of the solid, {_describe(surfaces[wide[0]])}, however finely "
        "OCCT meshes it. Try a larger one, or export the part as a mesh."
    )


def _refine(
    solid: Any, surfaces: list[Any], share: float, chord_mm: float, angle_rad: float
) -> list[int]:
    """Mesh the faces again that leave their surfaces by more than the chord tolerance.

    Parameters
    ----------
    solid : TopoDS_Shape
        A solid whose faces all have triangles.
    surfaces : list of BRepAdaptor_Surface
        Where the facets of each face should be.
    share : float
        What share of the chord tolerance the mesher was given.
    chord_mm, angle_rad : float
        See `mesh_solid`.

    Returns
    -------
    list of int
        The faces that still leave their surfaces, or have no triangles.
    """
    finer: dict[int, float] = {}
    for _ in range(_MAX_REFINEMENTS):
        wide = [
            index
            for index, face in enumerate(_faces(solid))
            if not deviation_mm(face, surfaces[index], chord_mm) <= chord_mm
        ]
        if not wide:
            return []
        for index in wide:
            finer[index] = _FINER * finer.get(index, share)
        BRepTools.Clean_s(solid)
        # where a face is finer, its edges are, and the mesher takes them as they are for its neighbours
        for index in sorted(finer, key=lambda index: (finer[index], index)):
            _cut(_faces(solid)[index], finer[index] * chord_mm, angle_rad)
        _cut(solid, share * chord_mm, angle_rad)
        bare = _bare_faces(solid)
        if bare:
            return bare
    return wide


def _mesh(solid: Any, chord_mm: float, angle_rad: float) -> None:
    BRepTools.Clean_s(solid)
    _cut(solid, chord_mm, angle_rad)


def _cut(shape: Any, chord_mm: float, angle_rad: float) -> None:
    """Give the faces of a shape triangles, but those that have some as fine."""
    # Chords of circles turn by half of the angle the mesher is given.
    BRepMesh_IncrementalMesh(shape, chord_mm, False, 2.0 * angle_rad, False)


def _faces(solid: Any) -> list[Any]:
    return [TopoDS.Face(face) for face in explore(solid, TopAbs_ShapeEnum.TopAbs_FACE)]


def _bare_faces(solid: Any) -> list[int]:
    """Return the places of the faces without triangles."""
    bare = []
    for index, face in enumerate(_faces(solid)):
        mesh = BRep_Tool.Triangulation_s(face, TopLoc_Location())
        if mesh is None or mesh.NbTriangles() == 0:
            bare.append(index)
    return bare


def _with_revolved(solid: Any, face: Any, cone: Any) -> Any:
    """Return a solid with one of its faces on a line revolved about the axis of its cone, same in every parameter."""
    start = gp_Pnt()
    along_u = gp_Vec()
    along_v = gp_Vec()
    cone.D1(0.0, 0.0, start, along_u, along_v)
    revolved = Geom_SurfaceOfRevolution(Geom_Line(start, gp_Dir(along_v)), cone.Axis())
    builder = BRep_Builder()
    twin = TopoDS.Face(face.EmptyCopied())
    builder.UpdateFace(twin, revolved, TopLoc_Location(), BRep_Tool.Tolerance_s(face))
    wires = TopoDS_Iterator(face)
    while wires.More():
        builder.Add(twin, wires.Value())
        wires.Next()
    for shape in explore(face, TopAbs_ShapeEnum.TopAbs_EDGE):
        _add_parameter_curves(TopoDS.Edge(shape), face, twin)
    exchange = BRepTools_ReShape()
    exchange.Replace(face, twin)
    return exchange.Apply(solid)


def _add_parameter_curves(edge: Any, face: Any, twin: Any) -> None:
    """Give an edge of a face the same curves in the parameters of the face's twin."""
    builder = BRep_Builder()
    first, last = BRep_Tool.Range_s(edge, face)
    curve = BRep_Tool.CurveOnSurface_s(edge, face, first, last)
    tolerance = BRep_Tool.Tolerance_s(edge)
    if BRep_Tool.IsClosed_s(edge, face):
        if edge.Orientation() != _FORWARD:
            # done with the other use of the seam
            return
        reverse = TopoDS.Edge(edge.Reversed())
        other = BRep_Tool.CurveOnSurface_s(reverse, face, first, last)
        builder.UpdateEdge(edge, curve, other, twin, tolerance)
    else:
        builder.UpdateEdge(edge, curve, twin, tolerance)
    builder.Range(edge, twin, first, last)


def _describe(surface: Any) -> str:
    """Return the kind of a surface, and a point of it."""
    kind = surface.GetType().name.removeprefix("GeomAbs_").removesuffix("Surface").lower()
    u = 0.5 * (surface.FirstUParameter() + surface.LastUParameter())
    v = 0.5 * (surface.FirstVParameter() + surface.LastVParameter())
    point = surface.Value(u, v)
    return f"a surface of the kind {kind} at {describe_point(np.array(xyz(point)))}"
