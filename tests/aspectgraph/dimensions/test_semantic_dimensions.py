"""Faces and edges of the kernel in JSON values: primitives made there, as they are and as free-form surfaces."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from real_parts import real_part

from aspectgraph import Solid, read_dimensions, read_solid
from aspectgraph.dimensions.features import Attachments, SurfaceZone, SurfaceZones, unique_names
from aspectgraph.dimensions.read_dimensions import _Reader
from aspectgraph.dimensions.tolerances import (
    Statement,
    is_in_hole,
    read_statements,
    resolve_stated_class,
)
from aspectgraph.read.step.semantic_dimensions import (
    SurfaceTolerance,
    list_datum_items,
    list_surface_tolerances,
)
from aspectgraph.read.step.stated_dimensions import (
    WITH_TEXTS,
    StatedDimension,
    list_dimensions,
    list_geometric_tolerances,
)
from aspectgraph.read.step.text import parse_entities, parse_texts
from tests.aspectgraph.helpers.solids import plain_box

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


# What a file states of a dimension, from the kernel's rows and from those of the text.


# as OCCT gives them: the lower deviation with its sign turned; swapped ones as a range
PLAIN = {"values": [35.0, 0.2, 0.0], "is_range": False, "has_bounds": True}
SWAPPED = {"values": [9.525, 0.127], "is_range": True, "has_bounds": False}
LIMITS = {"values": [34.8, 35.2], "is_range": True, "has_bounds": False}
BARE = {"values": None, "is_range": False, "has_bounds": False}
TEXT = {
    "plain": {"location": False, "values": (35.0,), "bounds": (-0.2, 0.0), "of_occurrence": False},
    "swapped": {
        "location": False,
        "values": (9.525,),
        "bounds": (0.127, -0.127),
        "of_occurrence": False,
    },
    "limits": {"location": False, "values": (34.8, 35.2), "bounds": None, "of_occurrence": False},
    "bare": {"location": True, "values": (), "bounds": None, "of_occurrence": False},
    "left out": {"location": False, "values": (12.0,), "bounds": None, "of_occurrence": False},
}


def test_the_text_is_paired_by_order_and_value():
    rows = [PLAIN, SWAPPED, LIMITS, BARE]
    texts = [TEXT[name] for name in ("left out", "plain", "left out", "swapped", "limits", "bare")]
    plain, swapped, limits, bare = read_statements(rows, texts)
    assert plain == Statement(35.0, (-0.2, 0.0))
    assert (swapped.nominal, swapped.tolerance) == (9.525, (-0.127, 0.127))
    assert (
        swapped.note
        == "the file states +0.127 as the lower and -0.127 as the upper deviation; taken in order"
    )
    assert limits == Statement(limits=(34.8, 35.2))
    assert bare == Statement()


def test_without_the_text_swapped_bounds_are_a_fault():
    """A nominal value of 4.826, the middle of 9.525 and 0.127, would be nonsense."""
    plain, swapped, limits, bare = read_statements([PLAIN, SWAPPED, LIMITS, BARE], [TEXT["plain"]])
    assert (plain.nominal, plain.tolerance) == (35.0, (-0.2, 0.0))
    assert plain.note.startswith("the text of the file could not be compared")
    assert swapped == Statement(fault="its limits are in the wrong order: 9.525 above 0.127")
    assert limits == Statement(limits=(34.8, 35.2))
    assert bare == Statement()


def test_a_tolerance_is_not_paired_with_a_bare_value():
    texts = [
        {"location": False, "values": (35.0,), "bounds": None, "of_occurrence": False},
        TEXT["plain"],
    ]
    assert read_statements([PLAIN], texts) == [Statement(35.0, (-0.2, 0.0))]


def test_three_values_are_limits_around_the_nominal_one():
    text = {"location": False, "values": (35.0, 35.2, 34.8), "bounds": None, "of_occurrence": False}
    assert read_statements([LIMITS], [text]) == [Statement(35.0, (-0.2, 0.2))]


def test_units_of_the_text():
    """An inch has 25.4 mm, a radian 180/pi degrees; a degree written with few digits is a degree."""
    data = b"""DATA;
#1=(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.MILLI.,.METRE.));
#2=LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(25.4),#1);
#3=(CONVERSION_BASED_UNIT('INCH',#2)LENGTH_UNIT()NAMED_UNIT(#9));
#4=(NAMED_UNIT(*)PLANE_ANGLE_UNIT()SI_UNIT($,.RADIAN.));
#5=PLANE_ANGLE_MEASURE_WITH_UNIT(PLANE_ANGLE_MEASURE(0.01745329),#4);
#6=(CONVERSION_BASED_UNIT('DEGREE',#5)NAMED_UNIT(#9)PLANE_ANGLE_UNIT());
#10=DIMENSIONAL_SIZE(#9,'diameter');
#11=ANGULAR_LOCATION('angle',$,#9,#9,.SMALL.);
#12=ANGULAR_SIZE(#9,'angle',.SMALL.);
#20=LENGTH_MEASURE_WITH_UNIT(POSITIVE_LENGTH_MEASURE(2.),#3);
#21=PLANE_ANGLE_MEASURE_WITH_UNIT(PLANE_ANGLE_MEASURE(30.),#6);
#22=PLANE_ANGLE_MEASURE_WITH_UNIT(PLANE_ANGLE_MEASURE(1.),#4);
#23=LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(-0.5),#3);
#24=LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(0.25),#1);
#30=SHAPE_DIMENSION_REPRESENTATION('',(#20),#9);
#31=SHAPE_DIMENSION_REPRESENTATION('',(#21),#9);
#32=SHAPE_DIMENSION_REPRESENTATION('',(#22),#9);
#33=DIMENSIONAL_CHARACTERISTIC_REPRESENTATION(#10,#30);
#34=DIMENSIONAL_CHARACTERISTIC_REPRESENTATION(#11,#31);
#35=DIMENSIONAL_CHARACTERISTIC_REPRESENTATION(#12,#32);
#36=TOLERANCE_VALUE(#23,#24);
#37=PLUS_MINUS_TOLERANCE(#36,#10);
ENDSEC;"""
    assert list_dimensions(parse_entities(data)) == [
        StatedDimension(False, (50.8,), (-12.7, 0.25)),
        StatedDimension(True, (30.0,), None),
        StatedDimension(False, (57.29577951308232,), None),
    ]


def test_names_are_unique():
    assert unique_names(["a", "b", "a", "a #2", "a"]) == ["a", "b", "a #2", "a #2 #2", "a #3"]


# Tolerance classes, reference and basic dimensions in the text of a file, and what becomes of
# them.


N = 12
H7 = (0.0, 0.021)


@pytest.fixture(scope="module")
def ring():
    """A ring whose profile is a rhombus: radius 6 within, 10 outside, and 8 at its upper and lower edge."""
    profile = ((10.0, 0.0), (8.0, 4.0), (6.0, 0.0), (8.0, -4.0))
    turn = 2.0 * np.pi * np.arange(N) / N
    corners = [[r * np.cos(t), r * np.sin(t), z] for r, z in profile for t in turn]
    n = len(profile)
    faces = [
        (k * N + i, k * N + (i + 1) % N, (k + 1) % n * N + (i + 1) % N, (k + 1) % n * N + i)
        for k in range(n)
        for i in range(N)
    ]
    return Solid(corners, faces, name="ring")


def test_a_rim_is_in_a_hole_where_its_walls_face_the_axis(ring):
    found = {round(rim.radius_mm, 6): is_in_hole(ring, rim) for rim in ring.rims()}
    # at the radius of 8 mm one wall faces the axis and one faces away
    assert found == {10.0: False, 6.0: True, 8.0: None}


def file(*lines):
    """Two diameters of 20 mm with what the lines add: the notes #40 are those of the first."""
    return (
        "DATA;\n"
        "#1=(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.MILLI.,.METRE.));\n"
        "#10=DIMENSIONAL_SIZE(#9,'diameter');\n"
        "#11=DIMENSIONAL_SIZE(#9,'diameter');\n"
        "#20=LENGTH_MEASURE_WITH_UNIT(POSITIVE_LENGTH_MEASURE(20.),#1);\n"
        "#30=SHAPE_DIMENSION_REPRESENTATION('',(#20,#40),#9);\n"
        "#31=SHAPE_DIMENSION_REPRESENTATION('',(#20),#9);\n"
        "#33=DIMENSIONAL_CHARACTERISTIC_REPRESENTATION(#10,#30);\n"
        "#34=DIMENSIONAL_CHARACTERISTIC_REPRESENTATION(#11,#31);\n"
        "#41=PLUS_MINUS_TOLERANCE(#42,#10);\n" + "\n".join(lines) + "\nENDSEC;"
    ).encode()


def listed(*lines):
    data = file(*lines)
    entities = parse_entities(data)
    first, second = list_dimensions(entities, parse_texts(data, entities, WITH_TEXTS))
    assert (second.tolerance_class, second.role, second.notes) == ("", "", ())
    return first


@pytest.mark.parametrize(
    ("fits", "expected"),
    [
        # as ISO 10303 and its recommended practices have it
        ("'H','hole','7',''", "H7"),
        ("'g','shaft','6',''", "g6"),
        # as files of NIST have it: STC-10 and FTC-10
        ("'G','','6',''", "G6"),
        ("'G6','hole','',''", "G6"),
        # the zone has the last word
        ("'h','hole','7',''", "H7"),
        ("'JS','shaft','9',''", "js9"),
        ("'H','H','IT7',''", "H7"),
        ("'zc','s','IT 11','ISO 286'", "zc11"),
        ("'D','','01',''", "D01"),
        ("'what''s this?','','7',''", "what's this? 7"),
        ("'','','',''", ""),
    ],
)
def test_limits_and_fits_are_a_class(fits, expected):
    assert listed(f"#42=LIMITS_AND_FITS({fits});").tolerance_class == expected


@pytest.mark.parametrize(
    ("note", "role"),
    [
        ("DESCRIPTIVE_REPRESENTATION_ITEM('dimensional note','auxiliary')", "reference"),
        ("DESCRIPTIVE_REPRESENTATION_ITEM('dimensional note','Reference ')", "reference"),
        ("DESCRIPTIVE_REPRESENTATION_ITEM('dimensional note','theoretical')", "basic"),
        (
            "(DESCRIPTIVE_REPRESENTATION_ITEM('theoretical')REPRESENTATION_ITEM('dimensional note'))",
            "basic",
        ),
        ("DESCRIPTIVE_REPRESENTATION_ITEM('dimensional note','statistical')", ""),
    ],
)
def test_notes_make_a_dimension_a_reference_or_a_basic_one(note, role):
    assert listed(f"#40={note};").role == role


def test_texts_are_read_as_they_are_written():
    """Semicolons and quotation marks in texts, comments between, and a text that looks like an entity."""
    data = file(
        "#40=DESCRIPTIVE_REPRESENTATION_ITEM('it''s; #42=X', /* '; */ 'b');",
        "#50=OTHER('#40=DESCRIPTIVE_REPRESENTATION_ITEM(''c'')');",
    )
    entities = parse_entities(data)
    assert parse_texts(data, entities, WITH_TEXTS) == {40: ("it's; #42=X", "b")}
    assert parse_texts(data, entities, ("OTHER",)) == {
        50: ("#40=DESCRIPTIVE_REPRESENTATION_ITEM('c')",)
    }
    assert parse_texts(data, entities, ("NONE",)) == {}


def test_class_role_and_notes_reach_the_statement():
    row = {"values": [20.0], "is_range": False, "has_bounds": False}
    text = {
        "location": False,
        "values": (20.0,),
        "bounds": None,
        "of_occurrence": False,
        "tolerance_class": "H7",
        "role": "reference",
        "notes": ("2x",),
    }
    (found,) = read_statements([row], [text])
    assert found == Statement(20.0, tolerance_class="H7", role="reference", notes=("2x",))


@pytest.mark.parametrize(
    ("notes", "title", "expected"),
    [
        ((), "Ø20 H7", "H7"),
        ((), "20H7", "H7"),
        ((), "D = 20,0 H7 THRU", "H7"),
        (("H7",), "", "H7"),
        (("dimensional note", "20 H7"), "", "H7"),
        # other sizes, threads, products and numbers are no classes
        ((), "25 H7", None),
        ((), "H7", None),
        ((), "Linear Size.20", None),
        (("M6",), "20 x5", None),
        ((), "20 R5", None),
        ((), "20 C1", None),
        ((), "20 H75", None),
        ((), "120 H7", None),
        ((), "20 H7.5", None),
    ],
)
def test_a_class_in_notes_and_names_stands_behind_the_nominal_value(notes, title, expected):
    found = resolve_stated_class(Statement(20.0, notes=notes), title, "diameter", 20.0, None)
    assert (found.name, found.fault) == (expected, None)
    assert found.deviations == (H7 if expected else None)


def resolve(name, kind="diameter", nominal=20.0, in_hole=None, **stated):
    statement = Statement(nominal, tolerance_class=name, **stated)
    return resolve_stated_class(statement, "", kind, nominal, in_hole)


@pytest.mark.parametrize(
    ("found", "fault"),
    [
        (resolve("q7"), "the file states the tolerance class 'q7', which is none of ISO 286"),
        (resolve("t6"), "the file states 20 t6: t is defined over 24 and up to 3150 mm"),
        (resolve("H7", nominal=4000.0), "the file states 4000 H7: must be over 0 and up to 3150"),
        (resolve("H7", "angle"), "the file states the tolerance class H7, which is for diameters"),
        (resolve("H7", nominal=None), "the file states the tolerance class H7 without a size"),
        (
            resolve("g6", in_hole=True),
            "the file states g6, a class of shafts, and its geometry is a hole",
        ),
        (
            resolve("H7", in_hole=False),
            "the file states H7, a class of holes, and its geometry is a shaft",
        ),
    ],
)
def test_classes_that_give_no_tolerance_are_faults(found, fault):
    assert found.fault is not None
    assert found.fault.startswith(fault)


def test_deviations_beside_a_class_are_compared():
    assert resolve("H7", tolerance=(0.0, 0.021)).note == ""
    assert resolve("H7", tolerance=(0.0, 0.0205)).note == ""
    assert resolve("H7", tolerance=(0.0, 0.03)).note == (
        "the file states H7, which is +0 and +0.021 mm, and other deviations; these are taken"
    )


def row(radius):
    circle = {"kind": "circle", "point": [0.0, 0.0, 0.0], "axis": [0.0, 0.0, 1.0], "radius": radius}
    return {
        "words": "diameter",
        "type": "Size_Diameter",
        "name": "bore",
        "sides": [[circle], []],
        "solids": [0],
        "unread": [0, 0],
        "compared": True,
        "unresolved": "",
    }


def test_a_dimension_has_the_limits_of_its_class(ring):
    """12 H7 is +18 and 0 µm, 20 g6 is -7 and -20 µm."""
    reader = _Reader(ring, 0.01, 0.05)
    bore = reader.dimension(row(6.0), Statement(12.0, tolerance_class="H7"))
    assert (bore.tolerance, bore.tolerance_class, bore.reason) == ((0.0, 0.018), "H7", None)
    assert bore.to_dict()["tolerance_class"] == "H7"
    outside = reader.dimension(row(10.0), Statement(20.0, tolerance_class="g6"))
    assert (outside.tolerance, outside.tolerance_class) == ((-0.02, -0.007), "g6")
    wrong = reader.dimension(row(6.0), Statement(12.0, tolerance_class="g6"))
    assert wrong.entities is None
    assert wrong.reason == "the file states g6, a class of shafts, and its geometry is a hole"
    # where the file states no value, the class is that of the geometry's
    assert reader.dimension(row(6.0), Statement(tolerance_class="H7")).tolerance == (0.0, 0.018)


def test_stated_deviations_come_before_those_of_a_class(ring):
    reader = _Reader(ring, 0.01, 0.05)
    stated = Statement(12.0, (0.0, 0.05), tolerance_class="H7", role="reference")
    bore = reader.dimension(row(6.0), stated)
    assert (bore.tolerance, bore.role) == ((0.0, 0.05), "reference")
    assert bore.note.startswith("the file states H7, which is +0 and +0.018 mm")
    limits = reader.dimension(row(6.0), Statement(limits=(12.0, 12.018), tolerance_class="H7"))
    assert (limits.tolerance, limits.note) == (
        (0.0, 0.018),
        "the file states no nominal value; this is the geometry's",
    )


# Flatness and profile tolerances: what the text states, and which dimensions they concern.


ZONES_TEXT = """ISO-10303-21;
HEADER;
ENDSEC;
DATA;
#1=(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.MILLI.,.METRE.));
#2=LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(0.2),#1);
#3=LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(0.05),#1);
#4=LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(0.),#1);
#10=SHAPE_ASPECT('','',#99,.T.);
#11=DATUM_FEATURE('','',#99,.T.);
#20=GEOMETRIC_ITEM_SPECIFIC_USAGE('','',#10,#98,#40);
#21=GEOMETRIC_ITEM_SPECIFIC_USAGE('','',#11,#98,#41);
#40=ADVANCED_FACE('',(#97),#96,.T.);
#41=ADVANCED_FACE('',(#97),#96,.T.);
#50=FLATNESS_TOLERANCE('Flat (1)','',#3,#11);
#51=(GEOMETRIC_TOLERANCE('P','',#2,#10)GEOMETRIC_TOLERANCE_WITH_DATUM_REFERENCE((#60))
 SURFACE_PROFILE_TOLERANCE());
#52=(FLATNESS_TOLERANCE()GEOMETRIC_TOLERANCE('','',#2,#10)
 GEOMETRIC_TOLERANCE_WITH_DEFINED_UNIT(#3));
#53=(GEOMETRIC_TOLERANCE('','',#2,#10)SURFACE_PROFILE_TOLERANCE()
 UNEQUALLY_DISPOSED_GEOMETRIC_TOLERANCE(#4));
#54=CYLINDRICITY_TOLERANCE('','',#2,#10);
#55=SURFACE_PROFILE_TOLERANCE('','',#4,#10);
ENDSEC;
END-ISO-10303-21;
"""


def test_the_text_states_kind_width_datums_and_faces():
    """A zone all on one side of the surface lies in one of twice its width about it."""
    entities = parse_entities(ZONES_TEXT.encode())
    assert list_surface_tolerances(entities) == [
        SurfaceTolerance("flatness", 0.05, False, (41,)),
        SurfaceTolerance("profile", 0.2, True, (40,)),
        SurfaceTolerance("profile", 0.4, False, (40,)),
    ]
    assert list_datum_items(entities) == {41}


def plane_row(z, corners, *, width, places):
    """Return the row of a horizontal face with straight edges between corners (x, y)."""
    loop = [(*corner, z) for corner in corners]
    ends = [[list(a), list(b)] for a, b in zip(loop, [*loop[1:], loop[0]], strict=True)]
    edges = [{"kind": "line", "ends": pair} for pair in ends]
    face = {"kind": "plane", "point": [0.0, 0.0, z], "axis": [0.0, 0.0, 1.0], "edges": edges}
    return {"tolerance": "profile", "width_mm": width, "places": places, "face": face}


CORNERS = ((0, 0), (30, 0), (30, 20), (0, 20))


def edges_at(solid, z):
    """Return the ids of the two edges along y at a height, by x."""
    found = [
        edge.id
        for edge in solid.straight_edges()
        if {point[2] for point in solid.edge_points(edge.id)} == {z}
        and len({point[0] for point in solid.edge_points(edge.id)}) == 1
    ]
    return sorted(found, key=lambda one: solid.edge_points(one)[0][0])


@pytest.fixture(scope="module")
def block():
    return plain_box((30.0, 20.0, 10.0))


def test_the_face_that_carries_both_edges_counts_and_no_other(block):
    """Two edges of the top face, 30 mm apart: their plane is the top face's. Those below have no zone."""
    zones = SurfaceZones(Attachments(block), [plane_row(10.0, CORNERS, width=0.2, places=True)])
    top = tuple(edges_at(block, 10.0))
    below = tuple(edges_at(block, 0.0))
    assert zones.of_way(top, (1, 0, 0)) == SurfaceZone("profile", 0.2, True)
    assert zones.of_way(below, (1, 0, 0)) is None
    # measured upwards, the two edges of one side lie in its plane, which has no tolerance
    assert zones.of_way((top[0], below[0]), (0, 0, 1)) is None
    # a length has no plane of its own
    assert zones.of_way(top[:1], None) is None


def test_a_zone_of_one_of_two_planes_says_not_where_both_are(block):
    rows = [plane_row(10.0, CORNERS, width=0.2, places=True)]
    way = (edges_at(block, 0.0)[0], edges_at(block, 10.0)[1])
    assert SurfaceZones(Attachments(block), rows).of_way(way, (1, 0, 0)) == SurfaceZone(
        "profile", 0.2, False
    )
    rows.append(plane_row(0.0, CORNERS, width=0.1, places=True))
    assert SurfaceZones(Attachments(block), rows).of_way(way, (1, 0, 0)) == SurfaceZone(
        "profile", 0.2, True
    )


def test_of_several_zones_of_a_face_the_widest_that_places_it_counts(block):
    """A lower row of a composite profile is narrower, and only turns the face."""
    rows = [
        plane_row(10.0, CORNERS, width=width, places=places)
        for width, places in ((0.5, False), (0.1, True), (0.2, True))
    ]
    way = tuple(edges_at(block, 10.0))
    found = SurfaceZones(Attachments(block), rows).of_way(way, (1, 0, 0))
    assert found == SurfaceZone("profile", 0.2, True)


def test_a_part_of_nist_states_the_zone_of_its_holes():
    """Read off the drawing of CTC 03 (.010 and .030 in), and off its text: the flatness is per area."""
    path = "examples/nist_ctc_03_ap242.stp.gz"
    zones = {one.name: one.surfaces for one in read_dimensions(path, read_solid(path))}
    inch = 25.4
    (bore,) = zones["Linear Size.6"]
    assert (bore.tolerance, bore.places) == ("profile", True)
    assert bore.width_mm == pytest.approx(0.030 * inch)
    (hole,) = zones["Linear Size.1"]
    # it lies in the face of datum A, and the datum is where its face is
    assert (hole.tolerance, hole.places) == ("profile", True)
    assert hole.width_mm == pytest.approx(0.010 * inch)
    assert not any(zone and zone.tolerance == "flatness" for own in zones.values() for zone in own)


@pytest.mark.parametrize(
    ("part", "hole", "zone"),
    [
        ("nist_ctc_02_ap242.stp", "Linear Size.4", ("flatness", 0.05, True)),
        # its face at z = 40 is one of the four faces of datum G
        ("nist_ctc_02_ap242.stp", "Linear Size.6", ("profile", 0.1, True)),
        ("nist_d2mi_827-9999-904.stp", "Hole Dimension (193)", ("profile", 0.016 * 25.4, True)),
    ],
)
def test_larger_parts_state_the_zones_of_their_drawings(part, hole, zone):
    """The face of datum A of CTC 02 is flat to 0.05 mm; D2MI has a profile of .016 in all over."""
    path = real_part(part)
    (found,) = {one.name: one.surfaces for one in read_dimensions(path, read_solid(path))}[hole]
    assert (found.tolerance, found.places) == (zone[0], zone[2])
    assert found.width_mm == pytest.approx(zone[1])


def test_the_text_lists_every_geometric_tolerance():
    data = Path("examples/nist_ctc_01_ap242.stp").read_bytes()
    words = [word for _, word in list_geometric_tolerances(parse_entities(data))]
    # counted with grep in the text of the file
    assert sorted(words) == [
        "flatness",
        "perpendicularity",
        "position",
        "position",
        "surface profile",
        "surface profile",
    ]
