"""STEP files: exact planar faces, watertight facets, and what is refused."""

from __future__ import annotations

import gzip
import re
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from one_kernel import one_kernel

from aspectgraph import (
    EntityError,
    ReadError,
    SelfIntersectionError,
    Solid,
    read_entities,
    read_solid,
    resolve_entities,
)

pytest.importorskip("OCP")
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
from OCP.TopoDS import TopoDS

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
    assert np.ptp(read_solid(path).bounds, axis=0) == pytest.approx([10, 20, 30])


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
        match=r"solids must not overlap.*holds 3 solids.*instance, solids=\[0\]",
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
    assert solid.notes == ("left out 1 faces and 0 edges that belong to no solid",)


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
