"""STEP files: exact planar faces, watertight facets, and what is refused."""

from __future__ import annotations

import gzip
import math
import re
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from part_mutants import damaged_numbers
from step_kernels import one_kernel
from step_parts import CASES, HOLE, placement, step_assembly

from aspectgraph import (
    AspectGraphError,
    EntityError,
    ReadError,
    SelfIntersectionError,
    Solid,
    SolidChoice,
    SolidError,
    read_dimensions,
    read_entities,
    read_solid,
    resolve_entities,
)
from aspectgraph.read.step.fit import check_fit
from aspectgraph.read.step.text import list_solids, parse_entities

pytest.importorskip("OCP")
from OCP.BRep import BRep_Builder
from OCP.BRepAlgoAPI import BRepAlgoAPI_Cut
from OCP.BRepBuilderAPI import BRepBuilderAPI_NurbsConvert, BRepBuilderAPI_Transform
from OCP.BRepFilletAPI import BRepFilletAPI_MakeFillet
from OCP.BRepPrimAPI import (
    BRepPrimAPI_MakeBox,
    BRepPrimAPI_MakeCone,
    BRepPrimAPI_MakeCylinder,
    BRepPrimAPI_MakeSphere,
)
from OCP.gp import gp_Ax1, gp_Ax2, gp_Dir, gp_Pnt, gp_Trsf, gp_Vec
from OCP.STEPControl import STEPControl_StepModelType, STEPControl_Writer
from OCP.TopAbs import TopAbs_ShapeEnum
from OCP.TopLoc import TopLoc_Location
from OCP.TopoDS import TopoDS, TopoDS_Compound

from aspectgraph.read.step.solids import explore

EXAMPLES = Path(__file__).parents[3] / "examples"


@pytest.fixture(scope="module", autouse=True)
def _one_kernel():
    with one_kernel():
        yield


def write(path, *shapes):
    writer = STEPControl_Writer()
    for shape in shapes:
        writer.Transfer(shape, STEPControl_StepModelType.STEPControl_AsIs)
    writer.Write(str(path))
    return path


def box(x, y, z, at=(0, 0, 0)):
    return BRepPrimAPI_MakeBox(gp_Pnt(*map(float, at)), float(x), float(y), float(z)).Shape()


def cylinder(radius, height, at=(0, 0, 0)):
    return BRepPrimAPI_MakeCylinder(
        gp_Ax2(gp_Pnt(*map(float, at)), gp_Dir(0, 0, 1)), radius, height
    ).Shape()


@pytest.fixture(scope="module")
def ctc01() -> Solid:
    return read_solid(EXAMPLES / "nist_ctc_01_ap242.stp")


def test_nist_ctc_01(ctc01):
    # Counted in the file: 117 faces, 56 of them planes, 116 sharp straight edges, 800 x 450 x 150 mm.
    assert np.ptp(ctc01.bounds, axis=0) == pytest.approx([800, 450, 150])
    assert len(ctc01.straight_edges()) == 116
    assert sum(not face.curved for face in ctc01.faces) == 56
    assert ctc01.n_shells == 1
    assert "chord tolerance of 0.9301 mm and 30 degrees" in ctc01.notes[0]


def test_a_finer_chord_tolerance_keeps_the_candidates_and_the_volume(ctc01):
    fine = read_solid(
        EXAMPLES / "nist_ctc_01_ap242.stp", chord_tolerance_mm=0.05, angular_tolerance_deg=10
    )

    def ends(solid):
        points = [solid.edge_points(edge.id).round(6) + 0.0 for edge in solid.straight_edges()]
        return {tuple(sorted(map(tuple, pair.tolist()))) for pair in points}

    assert ends(fine) == ends(ctc01)
    assert len(fine.faces) > 2 * len(ctc01.faces)
    # The volume of the part, integrated by OCCT over the exact surfaces with a chord tolerance of 0.01 mm.
    assert fine.volume == pytest.approx(1.46448e7, rel=2e-4)
    assert ctc01.volume == pytest.approx(1.46448e7, rel=2e-3)


@pytest.mark.parametrize(
    ("name", "n_faces", "n_edges", "volume"),
    [("mfcad_4-5-5-6-9-23.step", 23, 60, 629.314), ("mfcad_6-11-11-19.step", 8, 18, 384.99)],
)
def test_planar_parts_are_exact(name, n_faces, n_edges, volume):
    solid = read_solid(EXAMPLES / name)
    assert (len(solid.faces), len(solid.edges), len(solid.straight_edges())) == (
        n_faces,
        n_edges,
        n_edges,
    )
    assert solid.volume == pytest.approx(volume, abs=2e-3)
    assert solid.notes == ()


def test_edge_ids_are_stable(ctc01):
    again = read_solid(EXAMPLES / "nist_ctc_01_ap242.stp")
    assert again.edges == ctc01.edges
    assert (again.vertices == ctc01.vertices).all()


def test_a_packed_file(tmp_path):
    plain = EXAMPLES / "mfcad_6-11-11-19.step"
    packed = tmp_path / "part.step.gz"
    packed.write_bytes(gzip.compress(plain.read_bytes()))
    assert read_solid(packed).edges == read_solid(plain).edges
    assert read_solid(packed).name == "part"


def test_a_hole_becomes_a_ring_of_flat_strips(tmp_path):
    shape = BRepAlgoAPI_Cut(box(20, 20, 5), cylinder(4.0, 5.0, (10, 10, 0))).Shape()
    solid = read_solid(write(tmp_path / "part.step", shape), chord_tolerance_mm=1.0)
    assert Counter(face.curved for face in solid.faces) == {False: 6, True: 12}
    assert all(len(face.outer) == 4 for face in solid.faces)
    assert sorted(len(face.holes) for face in solid.faces)[-2:] == [1, 1]
    assert len(solid.straight_edges()) == 12
    assert solid.volume == pytest.approx(5 * (400 - 0.5 * 12 * 16 * np.sin(2 * np.pi / 12)))


def test_all_edges_of_a_cylinder_are_none(tmp_path):
    solid = read_solid(write(tmp_path / "part.step", cylinder(10.0, 8.0)))
    rule = r"entities must name rims or arcs .* Got 'all' for one with 2 rims and 0 arcs\."
    with pytest.raises(EntityError, match=rule):
        read_entities("all", solid)
    assert list(read_entities("r0, r1", solid)) == ["r0", "r1"]


@pytest.mark.parametrize("chord_mm", [0.5, 0.05, 0.005])
def test_facets_keep_the_chord_tolerance(tmp_path, chord_mm):
    path = write(tmp_path / "part.step", cylinder(10.0, 8.0))
    solid = read_solid(path, chord_tolerance_mm=chord_mm, angular_tolerance_deg=90)
    middles = [
        solid.edge_points(e.id).mean(axis=0)
        for e in solid.edges
        if np.ptp(solid.edge_points(e.id)[:, 2]) == 0
    ]
    sagitta = 10.0 - np.linalg.norm(np.array(middles)[:, :2], axis=1)
    assert sagitta.max() <= chord_mm
    assert sagitta.max() > chord_mm / 10
    assert solid.straight_edges() == ()


def test_fillets_are_smooth_and_straight_rims_stay(tmp_path):
    block = box(20, 20, 10)
    fillet = BRepFilletAPI_MakeFillet(block)
    fillet.Add(3.0, TopoDS.Edge(explore(block, TopAbs_ShapeEnum.TopAbs_EDGE)[0]))
    solid = read_solid(write(tmp_path / "part.step", fillet.Shape()))
    # One of twelve edges is gone, its neighbours at both ends are shorter, the ends of the fillet are arcs.
    assert len(solid.straight_edges()) == 11
    assert all(abs(e.dihedral_deg) == pytest.approx(90.0) for e in solid.straight_edges())


@pytest.mark.parametrize("chord_mm", [0.1, 0.03, 0.003])
@pytest.mark.parametrize(("angle_deg", "n_edges"), [(8.0, 16), (4.0, 14)])
def test_sharpness_is_that_of_the_surfaces_not_of_their_facets(
    tmp_path, angle_deg, n_edges, chord_mm
):
    # A groove in the top of a box, part of a cylinder that meets the plane under a known angle: twelve edges of the
    # box, two of them in two pieces, and the two of the groove if they are sharp.
    angle = np.radians(angle_deg)
    radius = 20.0
    roller = BRepPrimAPI_MakeCylinder(
        gp_Ax2(gp_Pnt(10, -1, 10 + radius * np.cos(angle)), gp_Dir(0, 1, 0)), radius, 22.0
    )
    shape = BRepAlgoAPI_Cut(box(20, 20, 10), roller.Shape()).Shape()
    solid = read_solid(write(tmp_path / "part.step", shape), chord_tolerance_mm=chord_mm)
    found = solid.straight_edges()
    assert len(found) == n_edges
    groove = [edge for edge in found if abs(edge.turn_deg) < 60.0]
    assert [edge.turn_deg for edge in groove] == pytest.approx(
        [angle_deg] * (n_edges - 14), abs=1e-6
    )
    assert all(edge.dihedral_deg < edge.turn_deg for edge in groove), "the facets turn by less"
    assert set(resolve_entities(solid, found)) == {f"e{edge.id}" for edge in found}
    assert len(solid.straight_edges(min_dihedral_deg=8.5)) == 14


def test_planes_stored_as_splines_are_planar(tmp_path):
    shape = BRepBuilderAPI_NurbsConvert(
        BRepAlgoAPI_Cut(box(6, 6, 4), box(2, 2, 2, (1, 1, 2))).Shape()
    ).Shape()
    solid = read_solid(write(tmp_path / "part.step", shape))
    assert (len(solid.faces), len(solid.straight_edges()), solid.notes) == (11, 24, ())
    assert solid.volume == pytest.approx(144 - 8)


def test_poles_and_apexes(tmp_path):
    ball = read_solid(write(tmp_path / "ball.step", BRepPrimAPI_MakeSphere(5.0).Shape()))
    assert ball.volume == pytest.approx(4 / 3 * np.pi * 125, rel=0.05)
    assert ball.straight_edges() == ()
    cone = read_solid(write(tmp_path / "cone.step", BRepPrimAPI_MakeCone(5.0, 0.0, 8.0).Shape()))
    assert cone.volume == pytest.approx(np.pi * 25 * 8 / 3, rel=0.06)
    assert cone.straight_edges() == ()


def test_moved_and_mirrored_solids(tmp_path):
    part = BRepAlgoAPI_Cut(box(6, 6, 4), box(2, 2, 2, (1, 1, 2))).Shape()
    mirror = gp_Trsf()
    mirror.SetMirror(gp_Ax2(gp_Pnt(0, 0, 0), gp_Dir(1, 0, 0)))
    mirrored = BRepBuilderAPI_Transform(part, mirror, True).Shape()
    shift = gp_Trsf()
    shift.SetTranslation(gp_Vec(20, 0, 0))
    moved = BRepBuilderAPI_Transform(part, shift).Shape()
    solid = read_solid(write(tmp_path / "part.step", mirrored, moved))
    assert solid.n_shells == 2
    assert solid.volume == pytest.approx(2 * 136)
    assert "2 solids" in solid.notes
    assert read_solid(tmp_path / "part.step", solids=[1]).volume == pytest.approx(136)


def test_files_in_inches_come_out_in_mm(tmp_path):
    path = write(tmp_path / "part.step", box(1, 2, 3))
    text = path.read_text()
    assert ".MILLI.,.METRE." in text
    path.write_text(text.replace("SI_UNIT(.MILLI.,.METRE.)", "SI_UNIT(.CENTI.,.METRE.)"))
    solid = read_solid(path)
    assert np.ptp(solid.bounds, axis=0) == pytest.approx([10, 20, 30])
    assert "lengths in the file are in cm; here all are in mm" in solid.notes
    inch = "(CONVERSION_BASED_UNIT('INCH',#9001)LENGTH_UNIT()NAMED_UNIT(*))"
    unit = re.search(r"#(\d+)\s*=\s*\(\s*LENGTH_UNIT[^;]*;", text)
    stated = (
        f"#{unit[1]}={inch};\n#9001=LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(25.4),#9002);\n"
        f"#9002{unit[0].removeprefix('#' + unit[1])}"
    )
    path.write_text(text.replace(unit[0], stated))
    solid = read_solid(path)
    assert np.ptp(solid.bounds, axis=0) == pytest.approx([25.4, 50.8, 76.2])
    assert "lengths in the file are in inches; here all are in mm" in solid.notes


def test_thin_walls_are_refined_until_they_hold(tmp_path):
    # A tube whose wall is thinner than the chord tolerance; its seams are turned apart, so coarse chords would cross.
    turn = gp_Trsf()
    turn.SetRotation(gp_Ax1(gp_Pnt(0, 0, 0), gp_Dir(0, 0, 1)), np.radians(5))
    inner = BRepBuilderAPI_Transform(cylinder(49.9, 5.0), turn, True).Shape()
    shape = BRepAlgoAPI_Cut(cylinder(50.0, 5.0), inner).Shape()
    solid = read_solid(write(tmp_path / "part.step", shape), chord_tolerance_mm=1.0)
    assert float(solid.notes[0].split("tolerance of ")[1].split()[0]) < 0.1
    assert solid.volume == pytest.approx(np.pi * (50**2 - 49.9**2) * 5, rel=0.05)


def test_solids_that_touch_or_overlap(tmp_path):
    path = write(
        tmp_path / "part.step", box(2, 2, 2), box(2, 2, 2, (1, 1, 1)), box(2, 2, 2, (9, 0, 0))
    )
    with pytest.raises(
        SelfIntersectionError,
        match=r"solids must not overlap.*holds 3 solids: 0 .*instance, solids=\[0\]",
    ):
        read_solid(path)
    assert read_solid(path, solids=[0, 2]).volume == pytest.approx(16)
    with pytest.raises(ReadError, match=r"solids must name some of 0..2 of part.step. Got \[3\]"):
        read_solid(path, solids=[3])
    with pytest.raises(ReadError, match=r"Got \[\]"):
        read_solid(path, solids=[])


def test_broken_files(tmp_path):
    text = (EXAMPLES / "mfcad_6-11-11-19.step").read_text()
    cases = {
        "prose.step": ("no step", "must begin with ISO-10303-21"),
        "unknown.step": (
            text.replace("ADVANCED_FACE", "ADVANCED_FARCE", 1),
            "geometry of a STEP file must be whole",
        ),
        "reference.step": (
            text.replace("#17,", "#1799,", 1),
            "must be whole. Got reference.step with 1 syntax errors",
        ),
        "header.step": (text[:300], "STEP file"),
        "cut.step": (text[: len(text) // 2], "STEP file"),
    }
    for name, (content, rule) in cases.items():
        path = tmp_path / name
        path.write_text(content)
        with pytest.raises(ReadError, match=rule) as caught:
            read_solid(path)
        assert "\n" not in str(caught.value)


def test_loose_faces_only(tmp_path):
    face = explore(box(2, 2, 2), TopAbs_ShapeEnum.TopAbs_FACE)[0]
    with pytest.raises(
        ReadError, match=r"at least one closed solid\. Got part.step with 1 loose faces only"
    ):
        read_solid(write(tmp_path / "part.step", face))


def test_loose_faces_beside_a_solid_are_noted(tmp_path):
    face = explore(box(9, 9, 9), TopAbs_ShapeEnum.TopAbs_FACE)[0]
    solid = read_solid(write(tmp_path / "part.step", box(2, 2, 2), face))
    assert solid.volume == pytest.approx(8)
    assert solid.notes == ("left out 1 face that belongs to no solid",)
    edges = explore(face, TopAbs_ShapeEnum.TopAbs_EDGE)[:2]
    solid = read_solid(write(tmp_path / "edges.step", box(2, 2, 2), *edges))
    assert solid.notes == ("left out 2 edges that belong to no solid",)
    apart = explore(box(3, 3, 3), TopAbs_ShapeEnum.TopAbs_EDGE)[0]
    solid = read_solid(write(tmp_path / "both.step", box(2, 2, 2), face, apart))
    assert solid.notes == ("left out 1 face and 1 edge that belong to no solid",)


def test_units_belong_to_meshes():
    with pytest.raises(ReadError, match="a STEP file states its own"):
        read_solid(EXAMPLES / "mfcad_6-11-11-19.step", units="mm")


def test_rims_of_the_example_are_those_of_its_model():
    """The file states each of its 25 and 35 mm circles in two halves; ids do not depend on how finely it is cut."""
    path = Path(__file__).parents[3] / "examples" / "nist_ctc_01_ap242.stp"
    stated = re.findall(r"=\s*CIRCLE\s*\(\s*'[^']*'\s*,\s*#\d+\s*,\s*([0-9.E+]+)", path.read_text())
    sizes = [round(2 * float(radius), 9) for radius in stated]
    solid = read_solid(path)
    rims = solid.rims()
    diameters = [round(2 * rim.radius_mm, 9) for rim in rims]
    assert diameters.count(25.0) == sizes.count(25.0) / 2 > 0
    assert diameters.count(35.0) == sizes.count(35.0) / 2 > 0
    assert set(diameters) <= set(sizes)
    assert max(rim.residual_mm for rim in rims) < 1e-9
    assert not any(rim.fitted for rim in rims)
    finer = read_solid(path, chord_tolerance_mm=0.2)
    for rim, fine in zip(rims, finer.rims(), strict=True):
        assert (rim.id, rim.radius_mm) == (fine.id, fine.radius_mm)
        assert fine.centre == pytest.approx(rim.centre)
        assert len(fine.edge_ids) > len(rim.edge_ids)
        assert fine.chord_mm <= 0.2


# A STEP file is read as what it says it holds, or not at all; what is left out must be asked for.


def box_at(x, size):
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
    return step_text(tmp_path_factory.mktemp("two"), box_at(0, (2, 3, 4)), box_at(9, (5, 6, 7)))


@pytest.fixture(scope="module")
def assembly(tmp_path_factory) -> str:
    """A file of one box in three places and another one."""
    one = box_at(0, (2, 3, 4))
    inner = moved(together(one, moved(one, 10)), 20)
    return step_text(
        tmp_path_factory.mktemp("assembly"), together(one, inner, box_at(50, (5, 6, 7)))
    )


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


# Assemblies: solids in contact become one body, and some of them may only stand in the way.


def box_of(size, at):
    return BRepPrimAPI_MakeBox(gp_Pnt(*map(float, at)), *map(float, size)).Shape()


@pytest.fixture
def boss_on_plate(tmp_path):
    """A plate, a boss in the middle of its top, and a block apart."""
    return write(
        tmp_path / "assembly.step",
        box_of((8, 8, 2), (0, 0, 0)),
        box_of((4, 4, 3), (2, 2, 2)),
        box_of((1, 1, 1), (20, 0, 0)),
    )


def lengths(solid):
    return sorted(round(solid.edge_length_mm(edge.id), 9) for edge in solid.straight_edges())


def test_solids_in_contact_are_one_body(boss_on_plate):
    solid = read_solid(boss_on_plate)
    # the top of the plate has a hole, the bottom of the boss is gone
    assert (solid.n_shells, len(solid.faces), len(solid.edges)) == (2, 6 + 5 + 6, 12 + 12 + 12)
    assert solid.volume == pytest.approx(8 * 8 * 2 + 4 * 4 * 3 + 1, rel=1e-12)
    assert "solids 0 and 1 touch and are one body; edges inside a contact are gone" in solid.notes
    assert lengths(solid) == sorted([8.0] * 8 + [2.0] * 4 + [4.0] * 8 + [3.0] * 4 + [1.0] * 12)


@pytest.mark.parametrize(
    ("choice", "expected", "n_shells"),
    [
        (SolidChoice([0], "all"), [8.0] * 8 + [2.0] * 4, 2),
        (SolidChoice([1], [0]), [4.0] * 8 + [3.0] * 4, 1),
        (SolidChoice(None, [0]), [4.0] * 8 + [3.0] * 4 + [1.0] * 12, 2),
        (SolidChoice([2], [1]), [1.0] * 12, 2),
    ],
)
def test_edges_of_occluders_are_no_entities(boss_on_plate, choice, expected, n_shells):
    solid = read_solid(boss_on_plate, solids=choice)
    assert lengths(solid) == sorted(expected)
    assert solid.n_shells == n_shells
    assert any(note.endswith("in the way only") for note in solid.notes)
    other = next(edge.id for edge in solid.edges if edge not in solid.straight_edges())
    with pytest.raises(EntityError, match="of an occluder"):
        resolve_entities(solid, [other])


def test_edges_flush_with_an_occluder_end_where_the_contact_ends(tmp_path):
    # The upper of two boxes of the same section: its vertical edges go on in those of the lower one, whose are no
    # entities; its lower edges lie between coplanar faces and are none either.
    path = write(
        tmp_path / "stack.step", box_of((4, 4, 2), (0, 0, 0)), box_of((4, 4, 3), (0, 0, 2))
    )
    assert lengths(read_solid(path, solids=SolidChoice([1], "all"))) == [3.0] * 4 + [4.0] * 4
    assert lengths(read_solid(path)) == [4.0] * 8 + [5.0] * 4
    assert read_solid(path).volume == pytest.approx(4 * 4 * 5, rel=1e-12)


def test_a_pin_in_its_hole(tmp_path):
    plate = BRepAlgoAPI_Cut(box_of((20, 20, 4), (0, 0, 0)), cylinder(3.0, 4.0, (10, 10, 0))).Shape()
    path = write(tmp_path / "pin.step", plate, cylinder(3.0, 10.0, (10, 10, 0)))
    solid = read_solid(path, solids=SolidChoice([0], [1]), chord_tolerance_mm=0.02)
    assert solid.n_shells == 1
    assert lengths(solid) == [4.0] * 4 + [20.0] * 8
    # the plate is full, and six millimetres of the pin stand out of it
    assert solid.volume == pytest.approx(20 * 20 * 4 + 6 * np.pi * 9, rel=2e-3)
    # the plate's two rims of the hole: where the pin ends flush there is none to be seen
    assert [round(rim.radius_mm, 9) for rim in solid.rims()] == [3.0]


def test_solids_apart_stay_as_they_were(tmp_path):
    path = write(
        tmp_path / "apart.step", box_of((2, 2, 2), (0, 0, 0)), box_of((2, 2, 2), (1, 0, 5))
    )
    solid = read_solid(path)
    assert (solid.n_shells, len(solid.edges), solid.notes) == (2, 24, ("2 solids",))


def test_solids_that_overlap_are_refused_by_number(tmp_path):
    path = write(
        tmp_path / "part.step",
        box_of((9, 9, 9), (0, 0, 0)),
        box_of((1, 1, 1), (20, 0, 0)),
        box_of((2, 2, 2), (3, 3, 3)),
    )
    with pytest.raises(
        SelfIntersectionError, match=r"must not overlap. Got solids 0 and 2 of part.step, which do"
    ):
        read_solid(path)
    assert read_solid(path, solids=[0, 1]).volume == pytest.approx(730)


@pytest.mark.parametrize("at", [(2, 2, 0), (2, 2, 2)])
def test_contact_in_a_line_or_a_point_is_refused(tmp_path, at):
    path = write(tmp_path / "part.step", box_of((2, 2, 2), (0, 0, 0)), box_of((2, 2, 2), at))
    with pytest.raises(SolidError, match=r"holds 2 solids: 0 .*; read some of them"):
        read_solid(path)


def test_choices_that_are_none(boss_on_plate):
    with pytest.raises(
        ReadError, match=r"occluders must be 'all', or a list of numbers or names. Got 'most'"
    ):
        SolidChoice([0], "most")
    with pytest.raises(
        ReadError, match="must be numbers or names where solids does not say which are measured"
    ):
        SolidChoice(None, "all")
    with pytest.raises(ReadError, match=r"measured or an occluder. Got solid 1 as both"):
        SolidChoice([0, 1], [1])
    with pytest.raises(
        ReadError, match=r"^occluders must name some of 0..2 of assembly.step. Got \[7\]"
    ):
        read_solid(boss_on_plate, solids=SolidChoice([0], [7]))
    with pytest.raises(
        ReadError, match=r"^occluders must leave a solid to measure. Got \[0, 1, 2\]"
    ):
        read_solid(boss_on_plate, solids=SolidChoice(None, [0, 1, 2]))


# Damage of a STEP file: only that of the solids and of their places refuses it; what is ignored
# is told. The plate is 100 x 40 x 12 mm with two holes of diameter 12.


VOLUME = 100.0 * 40.0 * 12.0 - 2.0 * math.pi * 6.0**2 * 12.0
"""A finer chord tolerance than the default brings the facets within 10^-3 of it."""

PLACES = [placement((0.0, 0.0, 0.0)), placement((10.0, 80.0, 30.0), z=(0, 1, 0))]
LAYOUTS = {
    # as ST-Developer writes for Fusion 360: no names of transformations, relations and shapes
    "Fusion 360": {
        r"(ITEM_DEFINED_TRANSFORMATION)\('','',": r"\1($,$,",
        r"(REPRESENTATION_RELATIONSHIP)\('','',": r"\1($,$,",
        r"(PRODUCT_DEFINITION_SHAPE)\('','',": r"\1('',$,",
        r"(NEXT_ASSEMBLY_USAGE_OCCURRENCE)\('(\d+)','','',(.*),\$\)": r"\1('\2:1','\2:1','\2:1',\3,'\2:1')",
    },
    # as the Scania files of the same writer: nothing of a shape is named
    "unnamed shapes": {
        r"(ITEM_DEFINED_TRANSFORMATION)\('','',": r"\1($,$,",
        r"(PRODUCT_DEFINITION_SHAPE)\('[^']*','',": r"\1($,$,",
    },
    "SolidWorks": {
        r"(ITEM_DEFINED_TRANSFORMATION)\('','',": r"\1('NONE','NONE',",
        r"(REPRESENTATION_RELATIONSHIP)\('','',": r"\1('NONE','NONE',",
        r"(PRODUCT_DEFINITION_SHAPE)\('','',": r"\1('NONE','NONE',",
        r"(NEXT_ASSEMBLY_USAGE_OCCURRENCE)\('(\d+)','',''": r"\1('NAUO\2','','NONE'",
        r"((?:CARTESIAN_POINT|DIRECTION|AXIS2_PLACEMENT_3D))\(''": r"\1('NONE'",
    },
    "FreeCAD": {
        r"(NEXT_ASSEMBLY_USAGE_OCCURRENCE)\('(\d+)','',''": r"\1('\2','=>[0:1:1:2]',''",
    },
    "Onshape": {
        r"(ITEM_DEFINED_TRANSFORMATION)\('','',": r"\1('',$,",
        r"(REPRESENTATION_RELATIONSHIP)\('','',": r"\1(' ',' ',",
        r"(PRODUCT_DEFINITION_SHAPE)\('','',": r"\1(' ',' ',",
    },
}


def written(folder, text):
    path = folder / "part.step"
    path.write_text(text)
    return path


def assembly_of_plates():
    return step_assembly({"root": [("plate", matrix) for matrix in PLACES]})


def with_dimension():
    return (CASES / "dim_with_datum_feature.step").read_text()


@pytest.mark.parametrize("layout", LAYOUTS)
def test_parts_are_where_the_file_puts_them_whoever_wrote_it(layout, tmp_path):
    text = assembly_of_plates()
    for pattern, new in LAYOUTS[layout].items():
        text, n = re.subn(pattern, new, text)
        assert n
    solid = read_solid(written(tmp_path, text))
    centres = np.array([rim.centre for rim in solid.rims()])
    assert len(centres) == 8
    for matrix in PLACES:
        for centre in (HOLE @ matrix.T)[:, :3]:
            assert np.linalg.norm(centres - centre, axis=1).min() < 1e-6
    assert not [note for note in solid.notes if "error" in note]


def test_solids_without_any_label_are_whole(tmp_path):
    head, data = (CASES / "dim_moved_reason.step").read_text().split("DATA;", 1)
    named = read_solid(written(tmp_path, head + "DATA;" + data))
    bare = read_solid(written(tmp_path, head + "DATA;" + data.replace("('',", "($,")))
    assert bare.volume == named.volume
    assert bare.edges == named.edges


def test_errors_in_pmi_are_ignored_and_told(tmp_path):
    """The size of a datum feature is the aspect itself, which the kernel does not know: three entities refer to it."""
    solid = read_solid(CASES / "dim_with_datum_feature.step", chord_tolerance_mm=0.001)
    assert solid.volume == pytest.approx(VOLUME, rel=1e-4)
    assert solid.notes[0] == (
        "3 errors in PMI were ignored, the first in GEOMETRIC_ITEM_SPECIFIC_USAGE #520"
    )


def test_a_missing_reference_in_pmi_is_ignored_and_one_in_a_face_is_not(tmp_path):
    text = with_dimension()
    pmi = text.replace("PLUS_MINUS_TOLERANCE(#527,", "PLUS_MINUS_TOLERANCE(#9527,")
    assert read_solid(written(tmp_path, pmi)).notes[0].startswith("3 errors in PMI")
    face = re.sub(r"(#459 = ADVANCED_FACE\('',)\(#\d+", r"\1(#9460", text)
    assert face != text
    with pytest.raises(ReadError, match="must be whole"):
        read_solid(written(tmp_path, face))


@pytest.mark.parametrize(
    ("pattern", "new", "message"),
    [
        (r"(ITEM_DEFINED_TRANSFORMATION\('','',#11,)#\d+", r"\1#12", "two coordinate systems"),
        (r"(ITEM_DEFINED_TRANSFORMATION\('','',#11,)#\d+", r"\1$", "must be whole|two coordinate"),
        (r"(ITEM_DEFINED_TRANSFORMATION\('','',#11,)#\d+", r"\1#9999", "must be whole|two coord"),
        (r"(REPRESENTATION_RELATIONSHIP\('','',)#\d+,", r"\1#12,", "must be whole"),
        (r"(NEXT_ASSEMBLY_USAGE_OCCURRENCE\('\d+','','',)#\d+,", r"\1#12,", "must be|lost"),
        (r"(SHAPE_DEFINITION_REPRESENTATION\(#\d+,)#36", r"\1#9999", "must be placed"),
    ],
)
def test_damage_of_what_places_a_part_is_refused(pattern, new, message, tmp_path):
    text, n = re.subn(pattern, new, assembly_of_plates(), count=1)
    assert n == 1
    with pytest.raises(ReadError, match=message):
        read_solid(written(tmp_path, text))


def test_dimensions_that_the_kernel_drops_are_listed_with_what_is_known(tmp_path):
    name = "dim_on_thread_curve.step"
    solid = read_solid(CASES / name)
    hole, thread = read_dimensions(CASES / name, solid)
    assert (hole.nominal, hole.tolerance, hole.reason) == (12.0, (-0.05, 0.05), None)
    # the file states 13 +-0.02 on a circle of a curve set
    assert (thread.kind, thread.nominal, thread.tolerance) == ("diameter", 13.0, (-0.02, 0.02))
    assert (thread.entities, thread.reason) == (None, "it is attached to a curve, no face")
    # a size that is a datum feature is attached to the face of its hole
    solid = read_solid(CASES / "dim_with_datum_feature.step")
    (bore,) = read_dimensions(CASES / "dim_with_datum_feature.step", solid)
    rims = {rim.id: rim for rim in solid.rims()}
    assert (bore.kind, bore.nominal, bore.tolerance) == ("diameter", 12.0, (-0.05, 0.05))
    assert rims[bore.entities[0]].radius_mm == pytest.approx(6.0)
    text = (CASES / name).read_text()
    nothing = re.sub(r"#611 = GEOMETRIC_ITEM_SPECIFIC_USAGE\([^;]*;", "", text)
    path = written(tmp_path, nothing)
    assert [one.reason for one in read_dimensions(path, read_solid(path))] == [
        None,
        "it is attached to nothing",
    ]
