"""A plate with bores, a slot, a step and a boss, whose sizes deviate and whose edges may be broken.

The part of `real_images`. The kernel builds the solid from its sizes, so the true value of each dimension follows from
these in closed form. Edges are broken on the deviating solid: all convex ones, by a chamfer or a radius. The model that
is planned has nominal sizes and sharp edges.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

CHORD_MM = 0.001
TURN_RAD = 0.15
# around an edge's middle, so far from it, places are tested for being inside
_ROUND_MM = 0.02
_PLACES = 32
_BORES = ("small", "middle", "large", "blind", "boss")


@dataclass
class Sizes:
    """Places of planes, and centre and radius of each round surface, mm."""

    left: float = 0.0
    right: float = 80.0
    front: float = 0.0
    back: float = 60.0
    bottom: float = 0.0
    top: float = 15.0
    shelf: float = 9.0
    wall: float = 65.0
    boss_top: float = 23.0
    blind_floor: float = 9.0
    slot_front: float = 27.0
    slot_back: float = 33.0
    small: tuple[float, float, float] = (12.0, 12.0, 3.3)
    middle: tuple[float, float, float] = (34.0, 14.0, 6.0)
    large: tuple[float, float, float] = (20.0, 40.0, 10.0)
    blind: tuple[float, float, float] = (55.0, 12.0, 5.0)
    boss: tuple[float, float, float] = (48.0, 47.0, 8.0)

    @classmethod
    def drawn(cls, rng, planes_mm: float, round_mm: float) -> Sizes:
        """Return sizes with normal deviations of each plane, radius and centre."""
        sizes = cls()
        for field in fields(cls):
            nominal = getattr(sizes, field.name)
            if isinstance(nominal, tuple):
                value = tuple(float(x) for x in np.add(nominal, rng.normal(0.0, round_mm, 3)))
            else:
                value = float(nominal + rng.normal(0.0, planes_mm))
            setattr(sizes, field.name, value)
        return sizes

    @property
    def values(self) -> dict[str, float]:
        """The value of each dimension, mm."""
        across = np.subtract(self.large[:2], self.middle[:2])
        return {
            **{f"diameter {name}": 2 * getattr(self, name)[2] for name in _BORES},
            "length": self.right - self.left,
            "width": self.back - self.front,
            "upper length": self.wall - self.left,
            "slot": self.slot_back - self.slot_front,
            "step": self.top - self.shelf,
            "thickness": self.top - self.bottom,
            "centres": float(np.hypot(*across)),
        }


def dimensions_of(solid, tolerance_mm: float, share: float):
    """Return the dimensions of the nominal part by name, as `planner.Dimension`."""
    from planner import Dimension

    asked = {"tolerance_mm": (-tolerance_mm, tolerance_mm), "share": share}
    # seen at a slant
    high = {"tolerance_mm": (-2 * tolerance_mm, 2 * tolerance_mm), "share": share}
    sizes = Sizes()
    heights = dict.fromkeys(_BORES, sizes.top) | {"boss": sizes.boss_top}
    rims = {name: _rim(solid, (*getattr(sizes, name)[:2], heights[name])) for name in _BORES}
    left = ((0, 0, 15), (0, 60, 15))
    right = ((80, 0, 9), (80, 60, 9))
    wall = ((65, 0, 15), (65, 60, 15))
    front = ((0, 0, 15), (65, 0, 15))
    back = ((0, 60, 15), (65, 60, 15))
    slot = ((42, 27, 15), (60, 27, 15)), ((42, 33, 15), (60, 33, 15))
    return {
        **{f"diameter {name}": Dimension.diameter(rims[name], **asked) for name in _BORES},
        "length": Dimension.distance(left, right, direction=(1, 0, 0), **high),
        "width": Dimension.distance(front, back, **asked),
        "upper length": Dimension.distance(left, wall, **asked),
        "slot": Dimension.distance(*slot, **asked),
        "step": Dimension.distance(front, ((65, 0, 9), (80, 0, 9)), **high),
        "thickness": Dimension.distance(front, ((0, 0, 0), (80, 0, 0)), **high),
        "centres": Dimension.centre_distance(rims["large"], rims["middle"], **asked),
    }


def _rim(solid, centre) -> str:
    rim = min(solid.rims(), key=lambda rim: np.linalg.norm(rim.centre - np.asarray(centre)))
    if np.linalg.norm(rim.centre - np.asarray(centre)) > 1e-3:
        raise ValueError(f"the part must have a rim at {centre}. Got {rim.centre}.")
    return rim.id


def solid_of(sizes: Sizes, kind: str = "sharp", break_mm: float = 0.0):
    """Return the kernel's solid, all convex edges of it broken.

    Parameters
    ----------
    sizes : Sizes
        Of the part.
    kind : str
        "sharp", "chamfer" (a leg of `break_mm` on each face) or "radius".
    break_mm : float
        Leg or radius, mm.
    """
    from OCP.BRepCheck import BRepCheck_Analyzer
    from OCP.BRepFilletAPI import BRepFilletAPI_MakeChamfer, BRepFilletAPI_MakeFillet

    solid = _sharp(sizes)
    if kind == "sharp":
        return solid
    makers = {"chamfer": BRepFilletAPI_MakeChamfer, "radius": BRepFilletAPI_MakeFillet}
    maker = makers[kind](solid)
    for edge in _convex_edges(solid):
        maker.Add(break_mm, edge)
    maker.Build()
    broken = maker.Shape()
    if not BRepCheck_Analyzer(broken).IsValid():
        raise ValueError(f"edges must be breakable. Got {kind} {break_mm:g} mm.")
    return broken


def _sharp(sizes: Sizes):
    from OCP.BRepAlgoAPI import BRepAlgoAPI_Cut, BRepAlgoAPI_Fuse

    def without(shape, tool):
        return BRepAlgoAPI_Cut(shape, tool).Shape()

    more = 1.0
    low = sizes.bottom - more
    high = sizes.top + more
    shape = _box((sizes.left, sizes.front, sizes.bottom), (sizes.right, sizes.back, sizes.top))
    beyond = (sizes.right + more, sizes.back + more, high)
    shape = without(shape, _box((sizes.wall, sizes.front - more, sizes.shelf), beyond))
    for bore in (sizes.small, sizes.middle, sizes.large):
        shape = without(shape, _cylinder(bore, low, high))
    shape = without(shape, _cylinder(sizes.blind, sizes.blind_floor, high))
    radius = (sizes.slot_back - sizes.slot_front) / 2
    middle = (sizes.slot_back + sizes.slot_front) / 2
    shape = without(shape, _box((42.0, sizes.slot_front, low), (60.0, sizes.slot_back, high)))
    for x in (42.0, 60.0):
        shape = without(shape, _cylinder((x, middle, radius), low, high))
    boss = _cylinder(sizes.boss, sizes.top - more, sizes.boss_top)
    return BRepAlgoAPI_Fuse(shape, boss).Shape()


def _box(low, high):
    from OCP.BRepPrimAPI import BRepPrimAPI_MakeBox
    from OCP.gp import gp_Pnt

    return BRepPrimAPI_MakeBox(gp_Pnt(*low), gp_Pnt(*high)).Shape()


def _cylinder(bore, low: float, high: float):
    from OCP.BRepPrimAPI import BRepPrimAPI_MakeCylinder
    from OCP.gp import gp_Ax2, gp_Dir, gp_Pnt

    x, y, radius = bore
    frame = gp_Ax2(gp_Pnt(x, y, low), gp_Dir(0, 0, 1))
    return BRepPrimAPI_MakeCylinder(frame, radius, high - low).Shape()


def _convex_edges(solid) -> list:
    """Return the edges around whose middle less than half of a small circle is inside."""
    from OCP.BRepAdaptor import BRepAdaptor_Curve
    from OCP.BRepClass3d import BRepClass3d_SolidClassifier
    from OCP.gp import gp_Pnt, gp_Vec
    from OCP.TopAbs import TopAbs_ShapeEnum, TopAbs_State
    from OCP.TopExp import TopExp_Explorer
    from OCP.TopoDS import TopoDS

    explorer = TopExp_Explorer(solid, TopAbs_ShapeEnum.TopAbs_EDGE)
    edges: list = []
    while explorer.More():
        edge = TopoDS.Edge(explorer.Current())
        if not any(edge.IsSame(other) for other in edges):
            edges.append(edge)
        explorer.Next()
    classifier = BRepClass3d_SolidClassifier(solid)
    convex = []
    for edge in edges:
        curve = BRepAdaptor_Curve(edge)
        point = gp_Pnt()
        tangent = gp_Vec()
        middle = (curve.FirstParameter() + curve.LastParameter()) / 2
        curve.D1(middle + 0.01, point, tangent)
        along = np.array([tangent.X(), tangent.Y(), tangent.Z()])
        along /= np.linalg.norm(along)
        x = np.cross(along, np.eye(3)[np.argmin(np.abs(along))])
        x /= np.linalg.norm(x)
        y = np.cross(along, x)
        inside = 0
        for turn in 2 * np.pi * (np.arange(_PLACES) + 0.37) / _PLACES:
            off = _ROUND_MM * (np.cos(turn) * x + np.sin(turn) * y)
            place = gp_Pnt(point.X() + off[0], point.Y() + off[1], point.Z() + off[2])
            classifier.Perform(place, 1e-7)
            inside += classifier.State() == TopAbs_State.TopAbs_IN
        # a seam of a cylinder, or a joint of tangent faces, has half
        if inside < 0.4 * _PLACES:
            convex.append(edge)
    return convex


def mesh_of(solid) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices (v, 3), mm, and triangles (t, 3) of the kernel's solid."""
    from OCP.BRep import BRep_Tool
    from OCP.BRepMesh import BRepMesh_IncrementalMesh
    from OCP.TopAbs import TopAbs_ShapeEnum
    from OCP.TopExp import TopExp_Explorer
    from OCP.TopLoc import TopLoc_Location
    from OCP.TopoDS import TopoDS

    BRepMesh_IncrementalMesh(solid, CHORD_MM, False, TURN_RAD, False)
    explorer = TopExp_Explorer(solid, TopAbs_ShapeEnum.TopAbs_FACE)
    vertices = []
    triangles = []
    count = 0
    while explorer.More():
        mesh = BRep_Tool.Triangulation_s(TopoDS.Face(explorer.Current()), TopLoc_Location())
        nodes = [mesh.Node(i + 1) for i in range(mesh.NbNodes())]
        vertices.append(np.array([(node.X(), node.Y(), node.Z()) for node in nodes]))
        corners = [mesh.Triangle(i + 1) for i in range(mesh.NbTriangles())]
        numbers = np.array([[corner.Value(k) for k in (1, 2, 3)] for corner in corners])
        triangles.append(numbers - 1 + count)
        count += len(nodes)
        explorer.Next()
    return np.concatenate(vertices), np.concatenate(triangles)


def write_step(solid, path: Path) -> None:
    """Write a solid as a STEP file, in mm."""
    from OCP.STEPControl import STEPControl_StepModelType, STEPControl_Writer

    writer = STEPControl_Writer()
    writer.Transfer(solid, STEPControl_StepModelType.STEPControl_AsIs)
    writer.Write(str(path))
