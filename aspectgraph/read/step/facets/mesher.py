"""The kernel's mesher, and what helps where it leaves a face without triangles.

A whole cone has a seam: an edge with two curves in the surface's parameters, one period apart. Where these end a
rounding error beside the curves of the rims, the mesher gives the cone up (OCCT #572), and says so nowhere. The same
cone as a surface of revolution, with the same parameters and the same edges, is meshed. Finer tolerances come next.

Imports OCP; import this module only in the kernel's process.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from OCP.BRep import BRep_Builder, BRep_Tool
from OCP.BRepAdaptor import BRepAdaptor_Surface
from OCP.BRepMesh import BRepMesh_IncrementalMesh
from OCP.BRepTools import BRepTools, BRepTools_ReShape
from OCP.Geom import Geom_ConicalSurface, Geom_Line, Geom_SurfaceOfRevolution
from OCP.gp import gp_Dir, gp_Pnt, gp_Vec
from OCP.TopAbs import TopAbs_Orientation, TopAbs_ShapeEnum
from OCP.TopExp import TopExp_Explorer
from OCP.TopLoc import TopLoc_Location
from OCP.TopoDS import TopoDS, TopoDS_Iterator

from aspectgraph.exceptions import ReadError
from aspectgraph.solid.places import describe_point

_SHARES = (1.0, 0.9, 0.8, 0.65, 0.5, 0.35, 0.25)
"""Shares of the chord tolerance that are tried where the tolerance itself leaves a face without triangles."""

_FORWARD = TopAbs_Orientation.TopAbs_FORWARD


def mesh_solid(solid: Any, chord_tolerance_mm: float, angular_tolerance_rad: float) -> Any:
    """Give every face of a solid triangles.

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
        The mesher leaves a face without triangles, whatever is tried.
    """
    _mesh(solid, chord_tolerance_mm, angular_tolerance_rad)
    bare = _bare_faces(solid)
    if not bare:
        return solid
    cones = {}
    twin = solid
    for index in bare:
        face = TopoDS.Face(_faces(twin)[index].Oriented(_FORWARD))
        surface = BRep_Tool.Surface_s(face)
        if isinstance(surface, Geom_ConicalSurface):
            cones[index] = surface
            twin = _with_revolved(twin, face, surface)
    for share in _SHARES:
        _mesh(twin, share * chord_tolerance_mm, angular_tolerance_rad)
        if not _bare_faces(twin) and _is_close(twin, cones, chord_tolerance_mm):
            return twin
    raise ReadError(
        f"every face must be tessellated. Got no triangles for face {bare[0]} of the solid, "
        f"{_describe(_faces(solid)[bare[0]])}; OCCT meshes it with none of the chord tolerances "
        f"from {_SHARES[-1] * chord_tolerance_mm:.3g} to {chord_tolerance_mm:.3g} mm. "
        "Try a larger one with chord_tolerance_mm=..., or export the part as a mesh."
    )


def _mesh(solid: Any, chord_mm: float, angle_rad: float) -> None:
    BRepTools.Clean_s(solid)
    # Chords of circles turn by half of the angle the mesher is given.
    BRepMesh_IncrementalMesh(solid, chord_mm, False, 2.0 * angle_rad, False)


def _explore(shape: Any, kind: TopAbs_ShapeEnum) -> Iterator[Any]:
    explorer = TopExp_Explorer(shape, kind)
    while explorer.More():
        yield explorer.Current()
        explorer.Next()


def _faces(solid: Any) -> list[Any]:
    return [TopoDS.Face(face) for face in _explore(solid, TopAbs_ShapeEnum.TopAbs_FACE)]


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
    for shape in _explore(face, TopAbs_ShapeEnum.TopAbs_EDGE):
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


def _is_close(solid: Any, cones: dict[int, Any], chord_mm: float) -> bool:
    """Return whether the facets of some faces leave their cones by no more than the chord tolerance.

    That holds at the middle of every side and of every facet, where facets are farthest off.
    """
    faces = _faces(solid)
    for index, surface in cones.items():
        place = TopLoc_Location()
        mesh = BRep_Tool.Triangulation_s(faces[index], place)
        move = place.Transformation()
        nodes = [mesh.Node(k).Transformed(move) for k in range(1, mesh.NbNodes() + 1)]
        points = np.array([(node.X(), node.Y(), node.Z()) for node in nodes])
        rows = [mesh.Triangle(k) for k in range(1, mesh.NbTriangles() + 1)]
        corners = points[np.array([[row.Value(i) for i in (1, 2, 3)] for row in rows]) - 1]
        sides = 0.5 * (corners + np.roll(corners, 1, axis=1))
        tested = np.concatenate([sides.reshape(-1, 3), corners.mean(axis=1)])
        if not _distances_mm(tested, surface.Cone()).max() <= chord_mm:
            return False
    return True


def _distances_mm(points: np.ndarray, cone: Any) -> np.ndarray:
    """Return how far points are from a cone, on the side of its apex where they lie."""
    axis = cone.Axis().Direction()
    foot = cone.Location()
    along = np.array([axis.X(), axis.Y(), axis.Z()])
    offsets = points - (foot.X(), foot.Y(), foot.Z())
    heights = offsets @ along
    radii = np.linalg.norm(offsets - np.outer(heights, along), axis=1)
    true_radii = np.abs(cone.RefRadius() + heights * np.tan(cone.SemiAngle()))
    distances: np.ndarray = np.abs(radii - true_radii) * np.cos(cone.SemiAngle())
    return distances


def _describe(face: Any) -> str:
    """Return what kind of surface a face has, and a point of it."""
    surface = BRepAdaptor_Surface(face)
    kind = surface.GetType().name.removeprefix("GeomAbs_").removesuffix("Surface").lower()
    u = 0.5 * (surface.FirstUParameter() + surface.LastUParameter())
    v = 0.5 * (surface.FirstVParameter() + surface.LastVParameter())
    point = surface.Value(u, v)
    place = np.array([point.X(), point.Y(), point.Z()])
    return f"a surface of the kind {kind} at {describe_point(place)}"
