"""Parts as STEP files: assemblies with semantic dimensions, and rings of revolved profiles."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

# STEP files of assemblies: one part with a semantic dimension, placed as often and as deep as a
# test asks.
#
# The part is the plate of `dim_two_instances.step`: holes of diameter 12 at (20, 20) and (60,
# 20), z from 0 to 12. The dimension belongs to the first one. Placements are 4 x 4 matrices;
# their products say where the hole must be.


CASES = Path(__file__).parents[2] / "cases"
RADIUS_MM = 6.0
HOLE = np.array([[20.0, 20.0, 0.0, 1.0], [20.0, 20.0, 12.0, 1.0]])
"""The centres of its two rims in the part's frame, homogeneous, shape (2, 4)."""

_PART_SHAPE = 30
_PART_DEFINITION = 31
_PART_REPRESENTATION = 36
_ORIGIN = 11
_CONTEXT = 535
_STATEMENT = re.compile(r"#(\d+) = (.*?);\s*(?=#\d+ = |ENDSEC)", re.DOTALL)
_ASSEMBLY = {3, 4, 5, 10, *range(15, 23), *range(23, 28), *range(540, 545), *range(546, 551)}


def placement(origin, z=(0, 0, 1), x=(1, 0, 0)) -> np.ndarray:
    """Return the matrix of an AXIS2_PLACEMENT_3D, shape (4, 4), for orthogonal z and x."""
    matrix = np.eye(4)
    matrix[:3, 2] = np.array(z) / np.linalg.norm(z)
    matrix[:3, 0] = np.array(x) / np.linalg.norm(x)
    matrix[:3, 1] = np.cross(matrix[:3, 2], matrix[:3, 0])
    matrix[:3, 3] = origin
    return matrix


def mirrored(origin) -> np.ndarray:
    """Return the matrix that mirrors x and then moves, shape (4, 4)."""
    matrix = np.diag([-1.0, 1.0, 1.0, 1.0])
    matrix[:3, 3] = origin
    return matrix


def step_assembly(tree: dict[str, list[tuple[str, np.ndarray]]]) -> str:
    """Return a STEP file.

    Parameters
    ----------
    tree : dict
        For each assembly its children and their matrices; the child "plate" is the part. The first one is the root.
    """
    text = (CASES / "dim_two_instances.step").read_text()
    head, data = text.split("DATA;\n")
    kept = [
        f"#{number} = {body};"
        for number, body in _STATEMENT.findall(data)
        if int(number) not in _ASSEMBLY
    ]
    writer = _Writer(kept)
    definitions = {"plate": (_PART_DEFINITION, _PART_REPRESENTATION)}
    for name in tree:
        definitions[name] = writer.product(name)
    for name, children in tree.items():
        for child, matrix in children:
            writer.place(definitions[child], definitions[name], matrix)
    return head + "DATA;\n" + "\n".join(writer.lines) + "\nENDSEC;\nEND-ISO-10303-21;\n"


class _Writer:
    def __init__(self, lines: list[str]):
        self.lines = lines
        self.number = 2000

    def add(self, body: str) -> int:
        self.number += 1
        self.lines.append(f"#{self.number} = {body};")
        return self.number

    def product(self, name: str) -> tuple[int, int]:
        """Write an assembly; return the numbers of its definition and of its representation."""
        context = self.add("PRODUCT_CONTEXT('',#2,'mechanical')")
        product = self.add(f"PRODUCT('{name}','{name}','',(#{context}))")
        formation = self.add(f"PRODUCT_DEFINITION_FORMATION('','',#{product})")
        definition = self.add(f"PRODUCT_DEFINITION('design','',#{formation},#35)")
        shape = self.add(f"PRODUCT_DEFINITION_SHAPE('','',#{definition})")
        representation = self.add(f"SHAPE_REPRESENTATION('',(#{_ORIGIN}),#{_CONTEXT})")
        self.add(f"SHAPE_DEFINITION_REPRESENTATION(#{shape},#{representation})")
        return definition, representation

    def place(self, child: tuple[int, int], parent: tuple[int, int], matrix: np.ndarray) -> None:
        """Write an occurrence of a child in its parent."""
        operator = self._transformation(matrix)
        relation = self.add(
            f"( REPRESENTATION_RELATIONSHIP('','',#{child[1]},#{parent[1]}) "
            f"REPRESENTATION_RELATIONSHIP_WITH_TRANSFORMATION(#{operator}) "
            "SHAPE_REPRESENTATION_RELATIONSHIP() )"
        )
        occurrence = self.add(
            f"NEXT_ASSEMBLY_USAGE_OCCURRENCE('{self.number}','','',#{parent[0]},#{child[0]},$)"
        )
        shape = self.add(f"PRODUCT_DEFINITION_SHAPE('Placement','',#{occurrence})")
        self.add(f"CONTEXT_DEPENDENT_SHAPE_REPRESENTATION(#{relation},#{shape})")

    def _transformation(self, matrix: np.ndarray) -> int:
        x, y, z, origin = matrix[:3].T
        if np.linalg.det(matrix[:3, :3]) > 0.0:
            axis = self._placement(origin, z, x)
            return self.add(f"ITEM_DEFINED_TRANSFORMATION('','',#{_ORIGIN},#{axis})")
        point = self.add(f"CARTESIAN_POINT('',{_numbers(origin)})")
        axes = [self.add(f"DIRECTION('',{_numbers(axis)})") for axis in (x, y, z)]
        return self.add(
            f"CARTESIAN_TRANSFORMATION_OPERATOR_3D('','','',#{axes[0]},#{axes[1]},#{point},1.,#{axes[2]})"
        )

    def _placement(self, origin: np.ndarray, z: np.ndarray, x: np.ndarray) -> int:
        point = self.add(f"CARTESIAN_POINT('',{_numbers(origin)})")
        axis = self.add(f"DIRECTION('',{_numbers(z)})")
        reference = self.add(f"DIRECTION('',{_numbers(x)})")
        return self.add(f"AXIS2_PLACEMENT_3D('',#{point},#{axis},#{reference})")


def _numbers(values: np.ndarray) -> str:
    return "(" + ",".join(f"{value:.12f}" for value in values) + ")"


# Rings as STEP files: a profile revolved about an axis, each face on a surface with a frame of
# its own.
#
# Kernels write the frames of a ring alike. Other programs do not, and the pcurves that the kernel
# then computes end a rounding error beside each other.


_HEAD = (
    "ISO-10303-21;\nHEADER;\nFILE_DESCRIPTION((''),'2;1');\nFILE_NAME('','',(''),(''),'','','');\n"
)
_SCHEMA = "FILE_SCHEMA(('AUTOMOTIVE_DESIGN { 1 0 10303 214 1 1 1 1 }'));\nENDSEC;\nDATA;\n"


class Corner(NamedTuple):
    """A corner of a profile and what leads to the next one.

    Attributes
    ----------
    r, z : float
        Distance from the axis and place along it, in mm.
    arc : (float, float, float) or None
        Centre (r, z) and radius of the arc to the next corner, shorter than half a turn; None for a line.
    """

    r: float
    z: float
    arc: tuple[float, float, float] | None = None


@dataclass(frozen=True)
class Frames:
    """How a ring's curves and surfaces are turned about its axis.

    Attributes
    ----------
    axes : ndarray, shape (3, 3)
        Rows are the x, y and z axes of the ring.
    centre : tuple of float
    seam_deg, circles_deg, surfaces_deg : float
        Where the seams are, and where the reference directions of circles and surfaces point.
    circles_down, surfaces_down : bool
        Whether the axes of circles, and of surfaces but cones, point against the ring's.
    cone_at_large_end : bool
        Where the frame of a cone is.
    """

    axes: np.ndarray
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)
    seam_deg: float = 0.0
    circles_deg: float = 0.0
    surfaces_deg: float = 0.0
    circles_down: bool = False
    surfaces_down: bool = False
    cone_at_large_end: bool = False


def write_ring(path: Path, profile: list[Corner], frames: Frames) -> Path:
    """Write a ring; the profile runs counter-clockwise with r to the right and z up, and holds no point of the axis."""
    path.write_text(_RingWriter(frames).text(profile))
    return path


class _RingWriter:
    def __init__(self, frames: Frames) -> None:
        self.frames = frames
        self.lines: list[str] = []

    def text(self, profile: list[Corner]) -> str:
        n = len(profile)
        vertices = [self._vertex(corner) for corner in profile]
        circles = [
            self._circle(corner, vertex) for corner, vertex in zip(profile, vertices, strict=True)
        ]
        faces = []
        for i, corner in enumerate(profile):
            following = profile[(i + 1) % n]
            ends = (vertices[i], vertices[(i + 1) % n])
            faces.append(self._face(corner, following, ends, (circles[i], circles[(i + 1) % n])))
        shell = self._add(f"CLOSED_SHELL('',({','.join(faces)}))")
        solid = self._add(f"MANIFOLD_SOLID_BREP('',{shell})")
        self._add_product(solid)
        return _HEAD + _SCHEMA + "\n".join(self.lines) + "\nENDSEC;\nEND-ISO-10303-21;\n"

    def _add(self, text: str) -> str:
        self.lines.append(f"#{len(self.lines) + 1}={text};")
        return f"#{len(self.lines)}"

    def _point(self, point: np.ndarray) -> str:
        place = np.asarray(point) @ self.frames.axes + self.frames.centre
        return self._add(f"CARTESIAN_POINT('',{_triple(place)})")

    def _direction(self, direction: np.ndarray) -> str:
        return self._add(f"DIRECTION('',{_triple(np.asarray(direction) @ self.frames.axes)})")

    def _frame(self, z: float, down: bool, reference_deg: float) -> str:
        parts = [
            self._point(np.array([0.0, 0.0, z])),
            self._direction(np.array([0.0, 0.0, -1.0 if down else 1.0])),
            self._direction(_around(1.0, reference_deg, 0.0)),
        ]
        return self._add(f"AXIS2_PLACEMENT_3D('',{','.join(parts)})")

    def _vertex(self, corner: Corner) -> str:
        point = self._point(_around(corner.r, self.frames.seam_deg, corner.z))
        return self._add(f"VERTEX_POINT('',{point})")

    def _circle(self, corner: Corner, vertex: str) -> str:
        frame = self._frame(corner.z, self.frames.circles_down, self.frames.circles_deg)
        circle = self._add(f"CIRCLE('',{frame},{_real(corner.r)})")
        return self._add(f"EDGE_CURVE('',{vertex},{vertex},{circle},.T.)")

    def _face(
        self, corner: Corner, following: Corner, ends: tuple[str, str], circles: tuple[str, str]
    ) -> str:
        dr = following.r - corner.r
        dz = following.z - corner.z
        forward = ".F." if self.frames.circles_down else ".T."
        backward = ".T." if self.frames.circles_down else ".F."
        first = self._add(f"ORIENTED_EDGE('',*,*,{circles[0]},{forward})")
        last = self._add(f"ORIENTED_EDGE('',*,*,{circles[1]},{backward})")
        if corner.arc is None and dz == 0.0:
            loops = [[first], [last]] if dr < 0 else [[last], [first]]
            surface = self._add(f"PLANE('',{self._surface_frame(corner.z)})")
            same = (-dr > 0) != self.frames.surfaces_down
        else:
            seam = self._seam(corner, following, ends)
            up = self._add(f"ORIENTED_EDGE('',*,*,{seam},.T.)")
            down = self._add(f"ORIENTED_EDGE('',*,*,{seam},.F.)")
            loops = [[first, up, last, down]]
            surface, same = self._round_surface(corner, following)
        bounds = []
        for kind, loop in zip(("FACE_OUTER_BOUND", "FACE_BOUND"), loops, strict=False):
            edges = self._add(f"EDGE_LOOP('',({','.join(loop)}))")
            bounds.append(self._add(f"{kind}('',{edges},.T.)"))
        flag = ".T." if same else ".F."
        return self._add(f"ADVANCED_FACE('',({','.join(bounds)}),{surface},{flag})")

    def _surface_frame(self, z: float) -> str:
        return self._frame(z, self.frames.surfaces_down, self.frames.surfaces_deg)

    def _seam(self, corner: Corner, following: Corner, ends: tuple[str, str]) -> str:
        a = _around(corner.r, self.frames.seam_deg, corner.z)
        b = _around(following.r, self.frames.seam_deg, following.z)
        if corner.arc is None:
            along = self._direction((b - a) / np.linalg.norm(b - a))
            vector = self._add(f"VECTOR('',{along},1.)")
            curve = self._add(f"LINE('',{self._point(a)},{vector})")
        else:
            r, z, radius = corner.arc
            centre = _around(r, self.frames.seam_deg, z)
            axis = np.cross(a - centre, b - centre)
            parts = [
                self._point(centre),
                self._direction(axis / np.linalg.norm(axis)),
                self._direction((a - centre) / np.linalg.norm(a - centre)),
            ]
            frame = self._add(f"AXIS2_PLACEMENT_3D('',{','.join(parts)})")
            curve = self._add(f"CIRCLE('',{frame},{_real(radius)})")
        return self._add(f"EDGE_CURVE('',{ends[0]},{ends[1]},{curve},.T.)")

    def _round_surface(self, corner: Corner, following: Corner) -> tuple[str, bool]:
        """Return a curved surface, and whether its normal points out of the ring."""
        dr = following.r - corner.r
        dz = following.z - corner.z
        if corner.arc is not None:
            r, z, radius = corner.arc
            outward = dz * (0.5 * (corner.r + following.r) - r) - dr * (
                0.5 * (corner.z + following.z) - z
            )
            frame = self._surface_frame(z)
            kind = f"SPHERICAL_SURFACE('',{frame},"
            if r > 0.0:
                kind = f"TOROIDAL_SURFACE('',{frame},{_real(r)},"
            return self._add(f"{kind}{_real(radius)})"), outward > 0
        if dr == 0.0:
            frame = self._surface_frame(corner.z)
            return self._add(f"CYLINDRICAL_SURFACE('',{frame},{_real(corner.r)})"), dz > 0
        larger, smaller = (corner, following) if dr < 0 else (following, corner)
        foot = larger if self.frames.cone_at_large_end else smaller
        frame = self._frame(foot.z, larger.z < smaller.z, self.frames.surfaces_deg)
        angle = math.atan2(abs(dr), abs(dz))
        return self._add(f"CONICAL_SURFACE('',{frame},{_real(foot.r)},{_real(angle)})"), dz > 0

    def _add_product(self, solid: str) -> None:
        mm = self._add("(LENGTH_UNIT() NAMED_UNIT(*) SI_UNIT(.MILLI.,.METRE.))")
        radian = self._add("(NAMED_UNIT(*) PLANE_ANGLE_UNIT() SI_UNIT($,.RADIAN.))")
        steradian = self._add("(NAMED_UNIT(*) SI_UNIT($,.STERADIAN.) SOLID_ANGLE_UNIT())")
        uncertainty = self._add(
            f"UNCERTAINTY_MEASURE_WITH_UNIT(LENGTH_MEASURE(1.E-4),{mm},'distance_accuracy_value','')"
        )
        context = self._add(
            "(GEOMETRIC_REPRESENTATION_CONTEXT(3) "
            f"GLOBAL_UNCERTAINTY_ASSIGNED_CONTEXT(({uncertainty})) "
            f"GLOBAL_UNIT_ASSIGNED_CONTEXT(({mm},{radian},{steradian})) REPRESENTATION_CONTEXT('',''))"
        )
        shape = self._add(f"ADVANCED_BREP_SHAPE_REPRESENTATION('',({solid}),{context})")
        application = self._add("APPLICATION_CONTEXT('automotive design')")
        product_context = self._add(f"PRODUCT_CONTEXT('',{application},'mechanical')")
        product = self._add(f"PRODUCT('ring','ring','',({product_context}))")
        formation = self._add(f"PRODUCT_DEFINITION_FORMATION('','',{product})")
        view = self._add(f"PRODUCT_DEFINITION_CONTEXT('',{application},'design')")
        definition = self._add(f"PRODUCT_DEFINITION('','',{formation},{view})")
        defined = self._add(f"PRODUCT_DEFINITION_SHAPE('','',{definition})")
        self._add(f"SHAPE_DEFINITION_REPRESENTATION({defined},{shape})")


def _around(r: float, angle_deg: float, z: float) -> np.ndarray:
    quarters, rest = divmod(angle_deg, 90.0)
    cosine = math.cos(math.radians(rest))
    sine = math.sin(math.radians(rest))
    for _ in range(int(quarters) % 4):
        cosine, sine = -sine, cosine
    return np.array([r * cosine, r * sine, z])


def _triple(point: np.ndarray) -> str:
    return f"({','.join(_real(float(x)) for x in point)})"


def _real(value: float) -> str:
    text = repr(value + 0.0)
    return text.replace("e", "E") if "." in text else text.replace("e", ".E")
