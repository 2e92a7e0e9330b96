"""Faces and edges of the kernel in JSON values: primitives made there, as they are and as free-form surfaces."""

from __future__ import annotations

import math

import pytest

pytest.importorskip("OCP")

from OCP.BRepBuilderAPI import (
    BRepBuilderAPI_MakeEdge,
    BRepBuilderAPI_MakeVertex,
    BRepBuilderAPI_NurbsConvert,
)
from OCP.BRepPrimAPI import (
    BRepPrimAPI_MakeBox,
    BRepPrimAPI_MakeCone,
    BRepPrimAPI_MakeCylinder,
    BRepPrimAPI_MakeSphere,
    BRepPrimAPI_MakeTorus,
)
from OCP.gp import gp_Ax2, gp_Dir, gp_Elips, gp_Pnt
from OCP.TopAbs import TopAbs_ShapeEnum

from aspectgraph.read.step.semantic_dimensions import describe
from aspectgraph.read.step.solids import explore

AT = gp_Ax2(gp_Pnt(1.0, 2.0, 3.0), gp_Dir(0.0, 0.0, 1.0))
# a frustum whose radius grows from 2 to 4 over a height of 2: sides at 45 degrees
SHAPES = {
    "box": lambda: BRepPrimAPI_MakeBox(gp_Pnt(1.0, 2.0, 3.0), 4.0, 5.0, 6.0),
    "cylinder": lambda: BRepPrimAPI_MakeCylinder(AT, 4.0, 5.0),
    "cone": lambda: BRepPrimAPI_MakeCone(AT, 2.0, 4.0, 2.0),
    "sphere": lambda: BRepPrimAPI_MakeSphere(AT, 4.0),
    "torus": lambda: BRepPrimAPI_MakeTorus(AT, 9.0, 2.0),
}


def faces_of(name, free_form):
    shape = SHAPES[name]().Shape()
    if free_form:
        shape = BRepBuilderAPI_NurbsConvert(shape).Shape()
    return [describe(face) for face in explore(shape, TopAbs_ShapeEnum.TopAbs_FACE)]


@pytest.mark.parametrize("free_form", [False, True])
def test_a_box_has_six_planes_of_four_lines(free_form):
    faces = faces_of("box", free_form)
    assert [face["kind"] for face in faces] == ["plane"] * 6
    for face in faces:
        assert [edge["kind"] for edge in face["edges"]] == ["line"] * 4
        assert sorted(math.dist(*edge["ends"]) for edge in face["edges"])[::2] in (
            [4, 5],
            [4, 6],
            [5, 6],
        )


@pytest.mark.parametrize("free_form", [False, True])
@pytest.mark.parametrize(
    ("name", "number", "value"),
    [("cylinder", "radius", 4.0), ("cone", "angle_deg", 90.0), ("sphere", "radius", 4.0)],
)
def test_round_faces_have_their_numbers(name, number, value, free_form):
    (face,) = [face for face in faces_of(name, free_form) if face["kind"] != "plane"]
    assert face["kind"] == name
    assert face[number] == pytest.approx(value, abs=1e-3)
    assert ("axis" in face) == (name != "sphere")
    if name == "sphere":
        assert face["point"] == pytest.approx([1.0, 2.0, 3.0], abs=1e-3)
    else:
        assert [abs(c) for c in face["axis"]] == pytest.approx([0.0, 0.0, 1.0], abs=1e-6)
        assert face["point"][:2] == pytest.approx([1.0, 2.0], abs=1e-3)
        rims = sorted(edge["radius"] for edge in face["edges"] if edge["kind"] == "circle")
        assert rims == pytest.approx([4.0, 4.0] if name == "cylinder" else [2.0, 4.0], abs=1e-3)


def test_what_is_none_of_these_is_free_form():
    (torus,) = faces_of("torus", False)
    assert torus["kind"] == "free form"
    ellipse = BRepBuilderAPI_MakeEdge(gp_Elips(AT, 3.0, 2.0)).Edge()
    assert describe(ellipse) == {"kind": "free form"}


def test_a_vertex_is_a_point():
    vertex = BRepBuilderAPI_MakeVertex(gp_Pnt(1.0, 2.0, 3.0)).Vertex()
    assert describe(vertex) == {"kind": "point", "point": [1.0, 2.0, 3.0]}
