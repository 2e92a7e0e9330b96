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
from OCP.BRep import BRep_Tool
from OCP.BRepAdaptor import BRepAdaptor_Curve, BRepAdaptor_Surface
from OCP.collections import IndexedMap_TopoDS_Shape_TopTools_ShapeMapHasher as ShapeMap
from OCP.GeomAbs import GeomAbs_CurveType, GeomAbs_SurfaceType
from OCP.gp import gp_Pnt, gp_Vec
from OCP.TopAbs import TopAbs_Orientation, TopAbs_ShapeEnum
from OCP.TopExp import TopExp
from OCP.TopoDS import TopoDS

from aspectgraph.exceptions import NonManifoldError, OpenSolidError, ReadError
from aspectgraph.read.step.facets.mesher import mesh_solid
from aspectgraph.read.step.shapes import explore, face_mesh, xyz
from aspectgraph.read.tessellation import Tessellation
from aspectgraph.solid.circles import Circle, CircularEdge, fit_circle
from aspectgraph.solid.places import describe_point

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
        found = []
        for _, uses in sorted(self.uses.items()):
            circle = (
                circle_of(uses[0].edge, self.flat_mm) if self._is_measured(uses[0].edge) else None
            )
            if circle is not None:
                chain = root[list(uses[0].nodes)].tolist()
                found.append(CircularEdge(circle, tuple(chain), self._turn_deg(uses)))
        return found


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
