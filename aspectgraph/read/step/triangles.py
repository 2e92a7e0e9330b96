"""From an OCCT solid to triangles that share their vertices along every edge.

The mesher cuts each edge once and uses the same points for the faces on both sides. Its nodes are therefore identified
by what they *are* (a vertex, the k-th point of an edge, a point inside a face), never by where they lie.

Imports OCP; import this module only when a boundary representation is at hand.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from OCP.BRep import BRep_Builder, BRep_Tool
from OCP.BRepAdaptor import BRepAdaptor_Curve, BRepAdaptor_Surface
from OCP.BRepMesh import BRepMesh_IncrementalMesh
from OCP.BRepTools import BRepTools, BRepTools_ReShape
from OCP.collections import IndexedMap_TopoDS_Shape_TopTools_ShapeMapHasher as ShapeMap
from OCP.Geom import Geom_ConicalSurface, Geom_Line, Geom_SurfaceOfRevolution
from OCP.GeomAbs import GeomAbs_CurveType, GeomAbs_SurfaceType
from OCP.gp import gp_Dir, gp_Pnt, gp_Vec
from OCP.TopAbs import TopAbs_Orientation, TopAbs_ShapeEnum
from OCP.TopExp import TopExp
from OCP.TopLoc import TopLoc_Location
from OCP.TopoDS import TopoDS, TopoDS_Iterator

from aspectgraph.exceptions import NonManifoldError, OpenSolidError, ReadError
from aspectgraph.read.join_faces import Tessellation
from aspectgraph.read.step.solids import explore, face_mesh, xyz
from aspectgraph.solid.rims import Circle, CircularEdge, fit_circle
from aspectgraph.solid.topology import describe_point

# How far the facets of a face leave its surface.
#
# The mesher takes a chord tolerance as an aim: on tori it was seen to miss it by a factor of two.
#
# Imports OCP; import this module only in the kernel's process.


_SAMPLES = np.array(
    [
        (0.5, 0.5, 0.0),
        (0.0, 0.5, 0.5),
        (0.5, 0.0, 0.5),
        (1 / 3, 1 / 3, 1 / 3),
        (0.6, 0.2, 0.2),
        (0.2, 0.6, 0.2),
        (0.2, 0.2, 0.6),
    ]
)
"""Where on a facet the distance is taken, as weights of its corners; corners are on the surface."""

_MAX_STEPS = 8


def deviation_mm(face: Any, surface: Any, enough_mm: float) -> float:
    """Return how far the facets of a face leave a surface, at the samples of every facet.

    Parameters
    ----------
    face : TopoDS_Face
        A face with triangles.
    surface : BRepAdaptor_Surface
        Where its facets should be, with the parameters of the face's own surface.
    enough_mm : float
        A distance of at most this may come out too large: the exact one costs time.

    Returns
    -------
    float
        In mm. No less than the true one at the samples.
    """
    kind = surface.GetType()
    if kind == GeomAbs_SurfaceType.GeomAbs_Plane:
        return 0.0
    mesh, _, points, corners = face_mesh(face)
    tested = _sampled(points, corners)
    if kind in _DISTANCES:
        return float(_DISTANCES[kind](surface, tested).max())
    if not mesh.HasUVNodes():
        return 0.0
    pairs = [mesh.UVNode(k) for k in range(1, mesh.NbNodes() + 1)]
    parameters = np.array([(pair.X(), pair.Y()) for pair in pairs])
    return _to_any(surface, tested, _sampled(parameters, corners), enough_mm)


def _sampled(rows: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Return rows of numbers at the samples of every facet, linear between its corners."""
    samples: np.ndarray = np.einsum("wc,tcx->twx", _SAMPLES, rows[corners])
    return samples.reshape(-1, rows.shape[1])


def _about(axis: Any, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return how far points are along an axis and from it."""
    direction = axis.Direction()
    foot = axis.Location()
    along = np.array(xyz(direction))
    offsets = points - xyz(foot)
    heights = offsets @ along
    return heights, np.linalg.norm(offsets - np.outer(heights, along), axis=1)


def _to_cylinder(surface: Any, points: np.ndarray) -> np.ndarray:
    cylinder = surface.Cylinder()
    _, radii = _about(cylinder.Axis(), points)
    return np.abs(radii - cylinder.Radius())


def _to_cone(surface: Any, points: np.ndarray) -> np.ndarray:
    """Return distances on the side of the apex where the points lie."""
    cone = surface.Cone()
    heights, radii = _about(cone.Axis(), points)
    true_radii = np.abs(cone.RefRadius() + heights * np.tan(cone.SemiAngle()))
    distances: np.ndarray = np.abs(radii - true_radii) * np.cos(cone.SemiAngle())
    return distances


def _to_sphere(surface: Any, points: np.ndarray) -> np.ndarray:
    sphere = surface.Sphere()
    centre = sphere.Location()
    offsets = points - xyz(centre)
    return np.abs(np.linalg.norm(offsets, axis=1) - sphere.Radius())


def _to_torus(surface: Any, points: np.ndarray) -> np.ndarray:
    torus = surface.Torus()
    heights, radii = _about(torus.Axis(), points)
    # a torus that meets itself has points whose circle is on the other side of the axis
    near, far = (
        np.abs(np.hypot(radii - centre, heights) - torus.MinorRadius())
        for centre in (torus.MajorRadius(), -torus.MajorRadius())
    )
    distances: np.ndarray = np.minimum(near, far)
    return distances


_DISTANCES = {
    GeomAbs_SurfaceType.GeomAbs_Cylinder: _to_cylinder,
    GeomAbs_SurfaceType.GeomAbs_Cone: _to_cone,
    GeomAbs_SurfaceType.GeomAbs_Sphere: _to_sphere,
    GeomAbs_SurfaceType.GeomAbs_Torus: _to_torus,
}


def _to_any(surface: Any, points: np.ndarray, parameters: np.ndarray, enough_mm: float) -> float:
    """Return the largest distance of points from a surface; `parameters` are near those of the nearest ones."""
    values = [surface.Value(u, v) for u, v in parameters.tolist()]
    near = np.array([xyz(value) for value in values])
    distances = np.linalg.norm(points - near, axis=1)
    for k in np.flatnonzero(distances > enough_mm).tolist():
        distances[k] = _to_foot(surface, points[k], parameters[k], enough_mm)
    return float(distances.max())


def _to_foot(surface: Any, point: np.ndarray, start: np.ndarray, enough_mm: float) -> float:
    """Return the distance of a point from a surface near a start; steps end once it is small enough."""
    value = gp_Pnt()
    along_u = gp_Vec()
    along_v = gp_Vec()
    parameters = start.copy()
    nearest = np.inf
    for _ in range(_MAX_STEPS):
        surface.D1(float(parameters[0]), float(parameters[1]), value, along_u, along_v)
        gap = point - xyz(value)
        nearest = min(nearest, float(np.linalg.norm(gap)))
        if nearest <= enough_mm:
            break
        slopes = np.array([xyz(along_u), xyz(along_v)]).T
        parameters += np.linalg.lstsq(slopes, gap, rcond=None)[0]
    return nearest


# The kernel's mesher, and what helps where it leaves a face without triangles, or too far from
# its surface.
#
# A whole cone has a seam: an edge with two curves in the surface's parameters, one period apart.
# Where these end a rounding error beside the curves of the rims, the mesher gives the cone up
# (OCCT #572), and says so nowhere. The same cone as a surface of revolution, with the same
# parameters and the same edges, is meshed. Finer tolerances come next.
#
# Facets of tori can leave their surface by more than the tolerance the mesher is given; twice as
# far was seen. A face whose facets do is meshed again with less of it.
#
# Imports OCP; import this module only in the kernel's process.


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


SMOOTH_DEG = 5.0
"""Two CAD faces, at least one of them curved, meet smoothly where their normals differ by less all along the edge.

Between planar faces the facets have the true angle, so the caller of ``straight_edges`` decides.
"""

ROUND_SHARE = 1e-3
"""A curve stored as no circle is one if it leaves it by no more than this share of its bow: the radius is known to
about as much."""

_N_SAMPLES = 7


@dataclass(frozen=True)
class _Use:
    """An edge as one face uses it."""

    edge: Any
    face: Any
    face_index: int
    nodes: tuple[int, ...]


def tessellate(
    solid: Any,
    chord_tolerance_mm: float,
    angular_tolerance_rad: float,
    flat_mm: float,
    measured: Any = None,
) -> Tessellation:
    """Return the triangles of an OCCT solid.

    Parameters
    ----------
    solid : TopoDS_Shape
        One solid.
    chord_tolerance_mm, angular_tolerance_rad : float
        Largest distance, and largest turn between neighbouring chords, of the triangles from the true surface.
    flat_mm : float
        Surfaces and curves that leave a plane or line by less are planar or straight, however they are stored.
    measured : map of TopoDS_Shape, optional
        The edges that can be entities. Default: all.

    Raises
    ------
    OpenSolidError, NonManifoldError
        An edge does not have two faces.
    ReadError
        A face could not be cut into triangles.
    """
    meshed = mesh_solid(solid, chord_tolerance_mm, angular_tolerance_rad)
    return _Collector(meshed, flat_mm, measured).collect()


class _Collector:
    """Gathers the mesher's nodes and triangles under shared ids."""

    def __init__(self, solid: Any, flat_mm: float, measured: Any) -> None:
        self.flat_mm = flat_mm
        self.measured = measured
        self.faces = [TopoDS.Face(face) for face in explore(solid, TopAbs_ShapeEnum.TopAbs_FACE)]
        self.edge_map = ShapeMap()
        self.vertex_map = ShapeMap()
        TopExp.MapShapes_s(solid, TopAbs_ShapeEnum.TopAbs_EDGE, self.edge_map)
        TopExp.MapShapes_s(solid, TopAbs_ShapeEnum.TopAbs_VERTEX, self.vertex_map)
        self.ids: dict[tuple[Any, ...], int] = {}
        self.parent: list[int] = []
        self.points: list[np.ndarray] = []
        self.uses: dict[int, list[_Use]] = {}
        self.surfaces: dict[int, Any] = {}

    def collect(self) -> Tessellation:
        blocks = [self._add_face(i, face) for i, face in enumerate(self.faces)]
        root = np.array([self._root(i) for i in range(len(self.parent))], dtype=np.int64)
        triangles = root[np.concatenate(blocks)]
        patch = np.repeat(np.arange(len(blocks)), [len(block) for block in blocks])
        whole = (triangles != np.roll(triangles, 1, axis=1)).all(axis=1)
        curved_patch = np.array([not is_planar(face, self.flat_mm) for face in self.faces])
        curved_edges, turns = self._sort_edges(root, curved_patch)
        return Tessellation(
            np.array(self.points),
            triangles[whole],
            patch[whole],
            curved_patch,
            curved_edges,
            self._circles(root),
            turns,
        )

    def _id(self, key: tuple[Any, ...], point: np.ndarray) -> int:
        if key not in self.ids:
            self.ids[key] = len(self.parent)
            self.parent.append(len(self.parent))
            self.points.append(point)
        return self.ids[key]

    def _root(self, i: int) -> int:
        while self.parent[i] != i:
            i = self.parent[i]
        return i

    def _add_face(self, face_index: int, face: Any) -> np.ndarray:
        """Number the nodes of a face; return its triangles in these numbers, outward."""
        mesh, location, points, corners = face_mesh(face)
        number = np.full(len(points), -1, dtype=np.int64)
        for shape in explore(face, TopAbs_ShapeEnum.TopAbs_EDGE):
            self._add_edge(TopoDS.Edge(shape), face, face_index, mesh, location, points, number)
        for k in np.flatnonzero(number < 0).tolist():
            number[k] = self._id(("inside", face_index, k), points[k])
        triangles = number[corners]
        is_mirrored = location.Transformation().IsNegative()
        turned = (face.Orientation() == TopAbs_Orientation.TopAbs_REVERSED) != is_mirrored
        return triangles[:, ::-1] if turned else triangles

    def _add_edge(
        self,
        edge: Any,
        face: Any,
        face_index: int,
        mesh: Any,
        location: Any,
        points: np.ndarray,
        number: Any,
    ) -> None:
        polygon = BRep_Tool.PolygonOnTriangulation_s(edge, mesh, location)
        if polygon is None:
            return
        nodes = [polygon.Node(k) - 1 for k in range(1, polygon.NbNodes() + 1)]
        edge_index = self.edge_map.FindIndex(edge)
        ends = [
            self.vertex_map.FindIndex(end(edge, False))
            for end in (TopExp.FirstVertex_s, TopExp.LastVertex_s)
        ]
        keys: list[tuple[Any, ...]] = [("edge", edge_index, k) for k in range(len(nodes))]
        keys[0] = ("vertex", ends[0])
        keys[-1] = ("vertex", ends[1])
        if BRep_Tool.Degenerated_s(edge):
            keys = [keys[0]] * len(keys)
        for node, key in zip(nodes, keys, strict=True):
            new = self._id(key, points[node])
            if number[node] >= 0:
                a, b = sorted((self._root(int(number[node])), self._root(new)))
                self.parent[b] = a
            number[node] = new
        if not BRep_Tool.Degenerated_s(edge):
            use = _Use(edge, face, face_index, tuple(int(number[node]) for node in nodes))
            self.uses.setdefault(edge_index, []).append(use)

    def _sort_edges(
        self, root: np.ndarray, curved_patch: np.ndarray
    ) -> tuple[set[tuple[int, int]], dict[tuple[int, int], float]]:
        """Return the chords of edges that are no entities, and the turns of others beside curved faces.

        No entities are those that are not straight, not sharp or not to be measured.
        Facets turn by less than the surfaces they stand for, so these decide.
        """
        chords: set[tuple[int, int]] = set()
        turns: dict[tuple[int, int], float] = {}
        for uses in self.uses.values():
            _check_uses(uses, self.points)
            on_curved = any(curved_patch[use.face_index] for use in uses)
            turn = self._turn_deg(uses) if on_curved else None
            chain = root[list(uses[0].nodes)].tolist()
            pairs = [(min(a, b), max(a, b)) for a, b in pairwise(chain)]
            smooth = turn is not None and turn < SMOOTH_DEG
            if (
                smooth
                or not self._is_measured(uses[0].edge)
                or not is_straight(uses[0].edge, self.flat_mm)
            ):
                chords.update(pairs)
            elif turn is not None:
                turns.update(dict.fromkeys(pairs, turn))
        return chords, turns

    def _turn_deg(self, uses: list[_Use]) -> float:
        """Return the largest turn of the outward normal across an edge, in degrees, over a few points of it."""
        normals = [_normals(use, self._surface(use.face_index)) for use in uses]
        cosines = [a @ b for a, b in zip(*normals, strict=True)]
        return float(np.degrees(np.arccos(np.clip(min(cosines), -1.0, 1.0))))

    def _surface(self, face_index: int) -> Any:
        """Return the surface of a face; the kernel goes along all edges of the face to make it."""
        if face_index not in self.surfaces:
            self.surfaces[face_index] = BRepAdaptor_Surface(self.faces[face_index])
        return self.surfaces[face_index]

    def _is_measured(self, edge: Any) -> bool:
        return self.measured is None or bool(self.measured.Contains(edge))

    def _circles(self, root: np.ndarray) -> list[CircularEdge]:
        """Return the circular edges, in the order in which the model holds them."""
        circles = []
        for _, uses in sorted(self.uses.items()):
            circle = (
                circle_of(uses[0].edge, self.flat_mm) if self._is_measured(uses[0].edge) else None
            )
            if circle is not None:
                chain = root[list(uses[0].nodes)].tolist()
                circles.append(CircularEdge(circle, tuple(chain), self._turn_deg(uses)))
        return circles


def _check_uses(uses: list[_Use], points: list[np.ndarray]) -> None:
    """Check that an edge has two faces that cut it into the same pieces."""
    ends = (
        f"{describe_point(points[uses[0].nodes[0]])} to {describe_point(points[uses[0].nodes[-1]])}"
    )
    if len(uses) == 1:
        raise OpenSolidError(
            f"every edge of a solid must have two faces. Got one at the edge from {ends}."
        )
    if len(uses) > 2:
        raise NonManifoldError(
            f"every edge of a solid must have two faces. Got {len(uses)} at the edge from {ends}."
        )
    if len(uses[0].nodes) != len(uses[1].nodes):
        raise ReadError(
            f"faces must cut a common edge alike. Got different pieces at the edge from {ends}."
        )


def is_planar(face: Any, flat_mm: float) -> bool:
    """Return whether the surface of a face stays within `flat_mm` of a plane."""
    surface = BRepAdaptor_Surface(face)
    if surface.GetType() == GeomAbs_SurfaceType.GeomAbs_Plane:
        return True
    if surface.GetType() in (
        GeomAbs_SurfaceType.GeomAbs_Cylinder,
        GeomAbs_SurfaceType.GeomAbs_Cone,
    ):
        return False
    us = np.linspace(surface.FirstUParameter(), surface.LastUParameter(), _N_SAMPLES)
    vs = np.linspace(surface.FirstVParameter(), surface.LastVParameter(), _N_SAMPLES)
    points = np.array([xyz(surface.Value(u, v)) for u in us for v in vs])
    centred = points - points.mean(axis=0)
    normal = np.linalg.svd(centred, full_matrices=False)[2][2]
    return bool(np.abs(centred @ normal).max() <= flat_mm)


def is_straight(edge: Any, flat_mm: float) -> bool:
    """Return whether an edge stays within `flat_mm` of the line between its ends."""
    curve = BRepAdaptor_Curve(edge)
    if curve.GetType() == GeomAbs_CurveType.GeomAbs_Line:
        return True
    parameters = np.linspace(curve.FirstParameter(), curve.LastParameter(), 2 * _N_SAMPLES)
    points = np.array([xyz(curve.Value(t)) for t in parameters])
    along = points[-1] - points[0]
    length = np.linalg.norm(along)
    if length <= flat_mm:
        return False
    return bool(
        np.linalg.norm(np.cross(points - points[0], along / length), axis=1).max() <= flat_mm
    )


def circle_of(edge: Any, flat_mm: float) -> Circle | None:
    """Return the circle of an edge, however it is stored, or None if it is none.

    A curve stored as another kind leaves the circle by `flat_mm` and `ROUND_SHARE` of its bow at most: any short and
    flat piece of a curve is near to some circle, whose radius means nothing.
    """
    curve = BRepAdaptor_Curve(edge)
    if curve.GetType() == GeomAbs_CurveType.GeomAbs_Circle:
        true = curve.Circle()
        axis = np.array(xyz(true.Axis().Direction()))
        return Circle(np.array(xyz(true.Location())), axis / np.linalg.norm(axis), true.Radius())
    if curve.GetType() == GeomAbs_CurveType.GeomAbs_Line or is_straight(edge, flat_mm):
        return None
    points = np.array(
        [
            xyz(curve.Value(t))
            for t in np.linspace(curve.FirstParameter(), curve.LastParameter(), 25)
        ]
    )
    fit = fit_circle(points)
    if fit is None:
        return None
    chord = points[-1] - points[0]
    offsets = points - points[0]
    square = chord @ chord
    along = np.outer(offsets @ chord / square, chord) if square > flat_mm**2 else 0.0
    bow = float(np.linalg.norm(offsets - along, axis=1).max())
    return fit if float(fit.distances_mm(points).max()) <= min(flat_mm, ROUND_SHARE * bow) else None


def _normals(use: _Use, surface: Any) -> list[np.ndarray]:
    """Return the outward normals of a face at a few points of an edge."""
    flip = -1.0 if use.face.Orientation() == TopAbs_Orientation.TopAbs_REVERSED else 1.0
    first, last = BRep_Tool.Range_s(use.edge, use.face)
    curve = BRep_Tool.CurveOnSurface_s(use.edge, use.face, first, last)
    normals = []
    for fraction in (0.2, 0.5, 0.8):
        uv = curve.Value(first + fraction * (last - first))
        point = gp_Pnt()
        along_u = gp_Vec()
        along_v = gp_Vec()
        surface.D1(uv.X(), uv.Y(), point, along_u, along_v)
        a, b, c = xyz(along_u)
        u, v, w = xyz(along_v)
        normal = np.array((b * w - c * v, c * u - a * w, a * v - b * u))
        length = np.linalg.norm(normal)
        normals.append(flip * normal / length if length > 0 else np.zeros(3))
    return normals


# How far apart the vertices, edges and faces of a solid lie that should meet.
#
# Every face states its surface, every edge its curve, every vertex its point, each with numbers
# of its own. Where they disagree the file does not say which of them is right, and the facets
# follow some of each.
#
# Imports OCP; import this module only when a boundary representation is at hand.


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
