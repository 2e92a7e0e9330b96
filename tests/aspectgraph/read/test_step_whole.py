"""A STEP file is read as what it says it holds, or not at all; what is left out must be asked for."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from one_kernel import one_kernel
from part_mutants import damaged_numbers

from aspectgraph import AspectGraphError, ReadError, read_solid
from aspectgraph.read.step.fit import check_fit
from aspectgraph.read.step.text import list_solids, parse_entities

pytest.importorskip("OCP")
from OCP.BRep import BRep_Builder
from OCP.BRepPrimAPI import BRepPrimAPI_MakeBox
from OCP.gp import gp_Pnt, gp_Trsf, gp_Vec
from OCP.STEPControl import STEPControl_StepModelType, STEPControl_Writer
from OCP.TopLoc import TopLoc_Location
from OCP.TopoDS import TopoDS_Compound

EXAMPLES = Path(__file__).parents[3] / "examples"


@pytest.fixture(scope="module", autouse=True)
def _one_kernel():
    with one_kernel():
        yield


def box(x, size):
    return BRepPrimAPI_MakeBox(gp_Pnt(float(x), 1.0, 2.0), *map(float, size)).Shape()


def moved(shape, x):
    shift = gp_Trsf()
    shift.SetTranslation(gp_Vec(float(x), 0, 0))
    return shape.Moved(TopLoc_Location(shift))


def together(*shapes):
    builder = BRep_Builder()
    compound = TopoDS_Compound()
    builder.MakeCompound(compound)
    for shape in shapes:
        builder.Add(compound, shape)
    return compound


def step_text(folder, *shapes) -> str:
    writer = STEPControl_Writer()
    for shape in shapes:
        writer.Transfer(shape, STEPControl_StepModelType.STEPControl_AsIs)
    writer.Write(str(folder / "written.step"))
    return (folder / "written.step").read_text()


@pytest.fixture(scope="module")
def two_boxes(tmp_path_factory) -> str:
    """A file of a box of 24 mm³ and one of 210 mm³."""
    return step_text(tmp_path_factory.mktemp("two"), box(0, (2, 3, 4)), box(9, (5, 6, 7)))


@pytest.fixture(scope="module")
def assembly(tmp_path_factory) -> str:
    """A file of one box in three places and another one."""
    one = box(0, (2, 3, 4))
    inner = moved(together(one, moved(one, 10)), 20)
    return step_text(tmp_path_factory.mktemp("assembly"), together(one, inner, box(50, (5, 6, 7))))


def read(tmp_path, text, **options):
    (tmp_path / "part.step").write_text(text)
    return read_solid(tmp_path / "part.step", **options)


def in_second_solid(text: str, pattern: str, new: str) -> str:
    start = text.rindex("MANIFOLD_SOLID_BREP")
    changed = re.sub(pattern, new, text[start:], count=1)
    assert changed != text[start:]
    return text[:start] + changed


DAMAGES = [
    (r"DIRECTION\('',\([^)]*\)\)", "DIRECTION('',(0.,0.,0.))", "#[0-9]+, which OCCT cannot build"),
    (
        r"CARTESIAN_POINT\('',\(9\.",
        "CARTESIAN_POINT('',(9.E300",
        "#[0-9]+, which OCCT cannot build",
    ),
    (r"CLOSED_SHELL\('',\(#\d+,", "CLOSED_SHELL('',(", "#[0-9]+, which OCCT cannot build"),
    ("ADVANCED_FACE", "ADVANCED_FARCE", "errors in ClosedShell"),
    (r"(EDGE_CURVE\('',#\d+,#\d+),#\d+", r"\1,#1", "errors in EdgeCurve"),
]


@pytest.mark.parametrize(("pattern", "new", "what"), DAMAGES)
def test_a_damaged_solid_is_left_out_only_if_the_others_are_asked_for(
    tmp_path, two_boxes, pattern, new, what
):
    text = in_second_solid(two_boxes, pattern, new)
    with pytest.raises(
        ReadError, match=rf"{what} \(solid 1 of 0\.\.1\)\. Ask for the whole ones with solids=\[0\]"
    ):
        read(tmp_path, text)
    with pytest.raises(ReadError, match=r"solids=\[0\]") as caught:
        read(tmp_path, text, solids=[0, 1])
    assert caught.value.mentions == ("solids=[0]",)
    assert read(tmp_path, text, solids=[0]).volume == pytest.approx(24)


def test_the_others_keep_their_numbers(tmp_path, two_boxes):
    # the first solid is damaged, and the second one stays solid 1
    text = two_boxes.replace("ADVANCED_FACE", "ADVANCED_FARCE", 1)
    with pytest.raises(ReadError, match=r"solid 0 of 0\.\.1\).*solids=\[1\]"):
        read(tmp_path, text)
    assert read(tmp_path, text, solids=[1]).volume == pytest.approx(210)
    assert read(tmp_path, two_boxes, solids=[1]).volume == pytest.approx(210)


@pytest.mark.parametrize(
    ("pattern", "new", "rule"),
    [
        (
            "MANIFOLD_SOLID_BREP",
            "MANIFOLD_SOLID_BREQ",
            "closed shells of a STEP file must belong to solids",
        ),
        (r"\(9\.,", "(9.O,", "Got '9.O' where a number"),
        (r"\(9\.,", "(9_0.,", "where a number"),
        (r"\(9\.,", "(9 0.,", "where a number"),
        (r"#(\d+) = DIRECTION", "#1 = DIRECTION", r"must have numbers of their own\. Got #1 twice"),
        (
            r"\.MILLI\.,\.METRE\.",
            ".MILLY.,.METRE.",
            "length unit of a STEP file must be a multiple of the metre",
        ),
    ],
)
def test_damage_that_no_choice_of_solids_avoids(tmp_path, two_boxes, pattern, new, rule):
    text = in_second_solid(two_boxes, pattern, new)
    for solids in (None, [0]):
        with pytest.raises(ReadError, match=rule) as caught:
            read(tmp_path, text, solids=solids)
        assert "\n" not in str(caught.value)


def test_a_solid_that_its_representation_does_not_list(tmp_path, two_boxes):
    text = re.sub(
        r"(ADVANCED_BREP_SHAPE_REPRESENTATION\('',\(#\d+),#\d+", r"\1", two_boxes, count=1
    )
    with pytest.raises(ReadError, match="must be items of a representation"):
        read(tmp_path, text)


def test_an_assembly_is_read_whole(tmp_path, assembly):
    assert read(tmp_path, assembly).volume == pytest.approx(3 * 24 + 210)
    assert read(tmp_path, assembly, solids=[3]).volume == pytest.approx(210)


@pytest.mark.parametrize(
    "kind", ["NEXT_ASSEMBLY_USAGE_OCCURRENCE", "CONTEXT_DEPENDENT_SHAPE_REPRESENTATION"]
)
def test_a_part_of_an_assembly_that_is_not_placed(tmp_path, assembly, kind):
    with pytest.raises(
        ReadError, match="every placement in the assembly of a STEP file must be that of a part"
    ):
        read(tmp_path, assembly.replace(kind, kind.replace("E", "O", 1), 1))


def test_the_numbers_of_a_damaged_assembly_are_not_known(tmp_path, assembly):
    text = in_second_solid(assembly, r"CLOSED_SHELL\('',\(#\d+,", "CLOSED_SHELL('',(")
    for solids in (None, [0]):
        with pytest.raises(ReadError, match=r"every solid of a STEP file must be built\. Got part"):
            read(tmp_path, text, solids=solids)


def test_no_damaged_number_takes_anything_away(tmp_path, two_boxes):
    """Every mutant is the same solids, as many solids in other places, or refused."""
    rng = np.random.default_rng(20240229)
    start = two_boxes.index("DATA;")
    messages = []
    for _ in range(10):
        data = damaged_numbers(two_boxes[start:].encode(), rng)
        (tmp_path / "part.step").write_bytes(two_boxes[:start].encode() + data)
        try:
            solid = read_solid(tmp_path / "part.step")
            assert (solid.n_shells, len(solid.faces), len(solid.edges)) == (2, 12, 24)
        except AspectGraphError as error:
            messages.append(str(error))
    assert len(messages) > 3
    assert not any("\n" in message for message in messages)


# ------------------------------------------------------------------------------------------- vertices, edges and faces


def displaced(text: str, x: float) -> str:
    """The first vertex of the block, moved; the lines of its edges stay."""
    points = re.findall(r"VERTEX_POINT\('',#(\d+)\)", text)
    place = re.search(rf"(#{points[0]} = CARTESIAN_POINT\('',\()([-0-9.E]+)", text)
    return text[: place.start(2)] + repr(float(place[2]) + x) + text[place.end(2) :]


def test_a_vertex_off_its_edges_is_refused_with_its_place(tmp_path):
    text = displaced((EXAMPLES / "mfcad_6-11-11-19.step").read_text(), 0.3)
    with pytest.raises(
        ReadError,
        match=r"must meet within gap_mm=1\.73e-05 mm\. Got a gap of 0\.3 mm between a vertex",
    ):
        read(tmp_path, text)


def test_a_wider_gap_can_be_permitted_and_is_noted(tmp_path):
    text = displaced((EXAMPLES / "mfcad_6-11-11-19.step").read_text(), 1e-3)
    with pytest.raises(
        ReadError, match=r"Got a gap of 0\.001 mm between a vertex and its edge at \("
    ):
        read(tmp_path, text)
    solid = read(tmp_path, text, gap_mm=2e-3)
    assert solid.notes[0].startswith("a gap of 0.001 mm between a vertex and its edge")
    with pytest.raises(ReadError, match="gap_mm must be positive"):
        read(tmp_path, text, gap_mm=0.0)


def test_a_gap_within_the_stated_uncertainty_is_no_gap(tmp_path):
    text = displaced((EXAMPLES / "mfcad_6-11-11-19.step").read_text(), 1e-3)
    text = text.replace("LENGTH_MEASURE(1.E-07)", "LENGTH_MEASURE(2.E-03)")
    assert not any("gap" in note for note in read(tmp_path, text).notes)


def test_a_plane_off_its_edges(tmp_path, two_boxes):
    plane = re.findall(r"PLANE\('',#(\d+)\)", two_boxes)[-1]
    other = re.findall(r"AXIS2_PLACEMENT_3D\('',#(\d+)", two_boxes)[0]
    text = re.sub(
        rf"#{plane} = AXIS2_PLACEMENT_3D\('',#\d+",
        f"#{plane} = AXIS2_PLACEMENT_3D('',#{other}",
        two_boxes,
    )
    with pytest.raises(ReadError, match="between an edge and its planar face"):
        read(tmp_path, text)


def fit(kind, gap, uncertainty):
    gaps = {
        "vertex": [0.0, [0, 0, 0]],
        "planar": [0.0, [0, 0, 0]],
        "curved": [0.0, [0, 0, 0]],
        kind: [gap, [1, 2, 3]],
    }
    return [{"uncertainty_mm": uncertainty, "gaps": gaps}]


def check(kind, gap, uncertainty, gap_mm=None):
    """A part of 1000 mm: planarity 0.001 mm, default chord tolerance 1 mm."""
    return check_fit(fit(kind, gap, uncertainty), [4], 1000.0, gap_mm, "part.step")


def test_gaps_that_are_permitted():
    assert check("vertex", 0.0099, 0.01) == []
    assert check("curved", 0.02, 0.01) == [
        "a gap of 0.02 mm between an edge and its curved face at (1, 2, 3) of solid 4; the file states 0.01 mm"
    ]
    assert len(check("vertex", 0.5, 0.01, gap_mm=0.6)) == 1


@pytest.mark.parametrize(
    ("kind", "gap", "uncertainty"),
    [
        ("vertex", 0.02, 0.01),
        ("planar", 0.02, 0.01),
        ("curved", 0.11, 0.01),
        # no file may state its way out
        ("vertex", 1.1, 1e9),
        # what is taken for granted where nothing is stated
        ("vertex", 0.0011, None),
        ("vertex", np.inf, 0.01),
        ("vertex", np.nan, 0.01),
    ],
)
def test_gaps_that_are_refused(kind, gap, uncertainty):
    with pytest.raises(ReadError, match=r"at \(1, 2, 3\) of solid 4 of part\.step"):
        check(kind, gap, uncertainty)


# ------------------------------------------------------------------------------------------------------- the text


def test_units_and_uncertainty_are_read_from_the_text(two_boxes):
    entities = parse_entities(two_boxes.encode())
    one, other = list_solids(entities)
    assert (one.n_faces, other.n_faces) == (6, 6)
    assert np.ptp(one.points_mm, axis=0) == pytest.approx([2, 3, 4])
    assert one.uncertainty_mm == pytest.approx(1e-7)
    in_metres = two_boxes.replace("SI_UNIT(.MILLI.,.METRE.)", "SI_UNIT($,.METRE.)")
    one, _ = list_solids(parse_entities(in_metres.encode()))
    assert np.ptp(one.points_mm, axis=0) == pytest.approx([2000, 3000, 4000])
    assert one.uncertainty_mm == pytest.approx(1e-4)


def test_comments_and_texts_hold_no_entities():
    data = b"DATA;\n#1=A('it''s; #2=B()',/* #3=C(); ' */(1.,-2.E-3,$,*,.T.));\n#2 = (B() C(#1));\nENDSEC;"
    entities = parse_entities(data)
    assert [(n, e.kind, e.references) for n, e in entities.items()] == [(1, "A", []), (2, "B", [1])]
    assert entities[1].numbers == [1.0, -2e-3]
    assert entities[2].kinds == {"B", "C"}


@pytest.mark.parametrize(
    "line",
    [
        "#1=A(1_0);",
        "#1=A(1.0.0);",
        "#1=A(1 2);",
        "#1=A(,1);",
        "#1=A(#-1);",
        "#1=A('x);",
        "#1=;",
        "1=A();",
        "#1=A(\x1a);",
    ],
)
def test_what_is_no_entity(line):
    with pytest.raises(ReadError, match="a STEP file must be whole"):
        parse_entities(f"DATA;{line}ENDSEC;".encode())
