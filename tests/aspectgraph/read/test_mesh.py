"""Mesh files: good ones give the solid they were made of, damaged ones one clear error."""

from __future__ import annotations

import gzip
import json
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mesh_files import (
    corners,
    glb_bytes,
    obj_text,
    off_text,
    ply_bytes,
    quartered,
    stl_bytes,
    stl_text,
)
from part_mutants import damaged_bytes, damaged_glb, damaged_numbers, with_json
from solids import cube, hollow_box, l_block, plate, slotted_block, two_boxes, two_pocket_block

from aspectgraph import (
    AspectGraphError,
    NonManifoldError,
    OpenSolidError,
    OrientationError,
    PartFileNotFoundError,
    ReadError,
    ReadLimits,
    SelfIntersectionError,
    Solid,
    read_solid,
)
from aspectgraph.read import mesh

MAKERS = [cube, l_block, slotted_block, two_pocket_block, two_boxes, hollow_box, lambda: plate(2)]


def read(tmp_path, name, data, **options):
    path = tmp_path / name
    path.write_bytes(data)
    return read_solid(path, **options)


def edge_set(solid: Solid, digits=4) -> set:
    return {
        tuple(sorted(map(tuple, (solid.edge_points(e.id).round(digits) + 0.0).tolist())))
        for e in solid.edges
    }


def same_solid(one: Solid, other: Solid) -> bool:
    """Same edges and the same loops, whatever their numbering."""

    def faces(solid):
        names = [tuple(p) for p in (solid.vertices.round(4) + 0.0).tolist()]
        return {
            frozenset((names[a], names[b]) for a, b in face.directed_edges())
            for face in solid.faces
        }

    return edge_set(one) == edge_set(other) and faces(one) == faces(other)


@pytest.mark.parametrize("make", MAKERS)
def test_binary_stl_gives_back_the_faces_with_their_holes(tmp_path, make):
    solid = make()
    found = read(tmp_path, "part.stl", stl_bytes(corners(solid)))
    assert same_solid(found, solid)
    assert found.name == "part"
    assert found.notes == ()


@pytest.mark.parametrize("make", MAKERS)
def test_subdivision_leaves_no_trace(tmp_path, make):
    solid = make()
    found = read(tmp_path, "part.stl", stl_bytes(quartered(quartered(corners(solid)))))
    assert same_solid(found, solid)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10**6))
def test_rotated_float32_meshes_keep_their_faces(tmp_path_factory, seed):
    rng = np.random.default_rng(seed)
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    axes[0] *= np.sign(np.linalg.det(axes))
    solid = two_pocket_block()
    turned = Solid(100 * solid.vertices @ axes.T + rng.normal(size=3), solid.faces)
    found = read(tmp_path_factory.mktemp("mesh"), "part.stl", stl_bytes(quartered(corners(turned))))
    assert (len(found.vertices), len(found.edges), len(found.faces)) == (24, 36, 16)
    assert found.volume == pytest.approx(turned.volume, rel=1e-6)
    assert len(found.straight_edges()) == 36


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("text.stl", lambda s: stl_text(corners(s))),
        ("crlf_upper.STL", lambda s: stl_text(corners(s), newline="\r\n", upper=True)),
        ("header_says_solid.stl", lambda s: stl_bytes(corners(s), header=b"solid but binary")),
        ("not_utf8.stl", lambda s: stl_bytes(corners(s), header=b"\xff\xfe\xfa solid")),
        ("negative.obj", lambda s: obj_text(s.vertices, [f.outer for f in s.faces], negative=True)),
        ("quads.obj", lambda s: obj_text(s.vertices, [f.outer for f in s.faces])),
        ("triangles.obj", lambda s: obj_text(s.vertices, s.triangles.tolist())),
        ("part.off", lambda s: off_text(s.vertices, [f.outer for f in s.faces])),
        ("text.ply", lambda s: ply_bytes(s.vertices, [f.outer for f in s.faces])),
        (
            "little.ply",
            lambda s: ply_bytes(s.vertices, [f.outer for f in s.faces], "binary_little_endian"),
        ),
        (
            "big.ply",
            lambda s: ply_bytes(s.vertices, [f.outer for f in s.faces], "binary_big_endian"),
        ),
        ("packed.stl.gz", lambda s: gzip.compress(stl_bytes(corners(s)))),
    ],
)
def test_formats(tmp_path, name, data):
    solid = l_block()
    assert same_solid(read(tmp_path, name, data(solid)), solid)


def test_glb_is_in_metres_and_follows_its_nodes(tmp_path):
    solid = l_block()
    turn = {
        "rotation": [0, 0, np.sqrt(0.5), np.sqrt(0.5)],
        "scale": [2, 2, 2],
        "translation": [0, 5, 0],
    }
    found = read(tmp_path, "part.glb", glb_bytes(solid.vertices, solid.triangles, turn))
    x, y, z = solid.vertices.T
    expected = Solid(1000 * np.stack([1 - 2 * y, 5 + 2 * x, 2 * z], axis=1), solid.faces)
    assert found.volume == pytest.approx(expected.volume)
    assert found.bounds == pytest.approx(expected.bounds)
    mirrored = {"matrix": np.diag([-1.0, 1, 1, 1]).ravel().tolist()}
    found = read(
        tmp_path, "part.glb", glb_bytes(solid.vertices, solid.triangles, mirrored), units="mm"
    )
    assert found.volume == pytest.approx(8.0)
    assert found.notes == ()


@pytest.mark.parametrize(
    ("units", "factor"), [("mm", 1), ("cm", 10), ("m", 1000), ("inch", 25.4), ("ft", 304.8)]
)
def test_units(tmp_path, units, factor):
    assert read(
        tmp_path, "part.stl", stl_bytes(corners(cube())), units=units
    ).volume == pytest.approx(8 * factor**3)


@pytest.mark.parametrize("scale", [1e9, 1e-6])
def test_extreme_sizes(tmp_path, scale):
    found = read(tmp_path, "part.stl", stl_bytes(corners(two_pocket_block()) * scale))
    assert (len(found.faces), len(found.straight_edges())) == (16, 36)


def test_edge_ids_are_stable(tmp_path):
    data = stl_bytes(quartered(corners(plate(2))))
    first, second = (read(tmp_path, "part.stl", data) for _ in range(2))
    assert first.edges == second.edges
    assert (first.vertices == second.vertices).all()


def test_inverted_and_disagreeing_facets_are_turned_and_noted(tmp_path):
    triangles = corners(l_block())
    found = read(tmp_path, "part.stl", stl_bytes(triangles[:, ::-1]))
    assert found.notes == ("turned 1 bodies that were inside out",)
    assert same_solid(found, l_block())
    triangles[[3, 7]] = triangles[[3, 7], ::-1]
    found = read(tmp_path, "part.stl", stl_bytes(triangles))
    assert found.notes == ("reversed 2 facets that disagreed with their neighbours",)
    assert same_solid(found, l_block())


def test_only_the_inverted_one_of_two_bodies_is_turned(tmp_path):
    solid = two_boxes()
    triangles = corners(solid)
    second = solid.face_shell[solid.triangle_face] == 1
    triangles[second] = triangles[second, ::-1]
    found = read(tmp_path, "part.stl", stl_bytes(triangles))
    assert same_solid(found, solid)
    assert found.notes == ("turned 1 bodies that were inside out",)


def test_an_inverted_hollow_body_is_turned_as_a_whole(tmp_path):
    found = read(tmp_path, "part.stl", stl_bytes(corners(hollow_box())[:, ::-1]))
    assert same_solid(found, hollow_box())
    assert found.volume == pytest.approx(56.0)


def test_useless_facets_are_dropped_and_noted(tmp_path):
    triangles = corners(cube())
    point = triangles[:1].copy()
    point[0, 1] = point[0, 0]
    found = read(
        tmp_path, "part.stl", stl_bytes(np.concatenate([triangles, point, triangles[2:5]]))
    )
    assert same_solid(found, cube())
    assert found.notes == ("dropped 1 facets that use a vertex twice", "dropped 3 repeated facets")


def test_a_facet_without_area_that_closes_the_surface_is_used(tmp_path):
    # The lower side of the front is cut at its middle, the bottom is not; a facet without area joins them.
    a = (0, 0, 0)
    b = (2, 0, 0)
    m = (1, 0, 0)
    c = (2, 0, 2)
    d = (0, 0, 2)
    rest = [t for t in corners(cube()) if not (t[:, 1] == 0).all()]
    front = [(a, m, d), (m, c, d), (m, b, c), (a, b, m)]
    found = read(
        tmp_path, "part.stl", stl_bytes(np.concatenate([rest, np.array(front, dtype=float)]))
    )
    assert same_solid(found, cube())
    with pytest.raises(OpenSolidError, match="one face only"):
        read(
            tmp_path,
            "part.stl",
            stl_bytes(np.concatenate([rest, np.array(front[:3], dtype=float)])),
        )


def test_nearly_equal_vertices_are_merged_and_noted(tmp_path):
    triangles = corners(cube()).astype(np.float32)
    triangles[0, 0] += np.float32(1e-6)
    found = read(tmp_path, "part.stl", stl_bytes(triangles))
    assert found.notes == ("merged 1 vertices closer than 3.46e-06 mm to another",)
    assert len(found.edges) == 12
    triangles[0, 0] += np.float32(1e-3)
    with pytest.raises(OpenSolidError, match="one face only"):
        read(tmp_path, "part.stl", stl_bytes(triangles))


def test_bytes_after_the_last_facet_are_noted(tmp_path):
    found = read(tmp_path, "part.stl", stl_bytes(corners(cube()), tail=b"\0" * 7))
    assert found.notes == ("ignored 7 bytes after the last facet",)


CUBE = corners(cube())
NAN = np.where(np.arange(12)[:, None, None] == 4, np.nan, CUBE)


@pytest.mark.parametrize(
    ("name", "data", "error", "rule"),
    [
        ("empty.stl", b"", ReadError, "must not be empty. Got empty.stl with 0 bytes"),
        ("blank.stl", b"solid x\nendsolid x\n", ReadError, "must hold facets. Got 0"),
        ("none.stl", stl_bytes(CUBE[:0]), ReadError, "must hold facets. Got 0"),
        ("short.stl", b"\x00" + b"x" * 40, ReadError, "at least 84 bytes. Got 41"),
        ("cut.stl", stl_bytes(CUBE)[:-120], ReadError, "Got 12 counted, 9 whole ones present"),
        (
            "liar.stl",
            stl_bytes(CUBE, count=4 * 10**9),
            ReadError,
            "Got 4000000000 counted, 12 whole",
        ),
        ("zero.stl", stl_bytes(CUBE, count=0), ReadError, "Got 0 counted, 12 present"),
        (
            "cut_text.stl",
            stl_text(CUBE)[:-100],
            ReadError,
            "must end with endsolid|must have 3 vertices",
        ),
        ("word.stl", stl_text(CUBE).replace(b"2.0", b"two"), ReadError, "must have three numbers"),
        ("prose.stl", b"solid advice\nfor everyone\n", ReadError, "'for everyone' in line 2"),
        (
            "nan.stl",
            stl_bytes(NAN),
            ReadError,
            r"must be finite. Got \[nan, nan, nan\] at vertex 12",
        ),
        ("inf.off", off_text([(0, 0, np.inf)] * 3, [(0, 1, 2)] * 4), ReadError, "must be finite"),
        ("sheet.stl", stl_bytes(CUBE[:2]), ReadError, "at least 4 facets. Got 2"),
        (
            "open.stl",
            stl_bytes(CUBE[1:]),
            OpenSolidError,
            r"edge from \(.*\) to \(.*\) .* \(3 such edges\)",
        ),
        (
            "wrong.obj",
            obj_text(cube().vertices, [(0, 1, 99)]),
            ReadError,
            r"Got \[1, 2, 100\] of 8 \(counted from 1\) in face 0",
        ),
        (
            "zero.obj",
            b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 0 1 2\n",
            ReadError,
            "must list existing vertices",
        ),
        ("two.obj", b"v 0 0 0\nv 1 0 0\nf 1 2\n", ReadError, "at least 3 vertices. Got 2"),
        ("bare.obj", b"v 0 0 0\n", ReadError, "must hold faces. Got 0"),
        ("text.obj", b"v 0 0\n", ReadError, "must have three numbers"),
        ("nurbs.obj", b"v 0 0 0\ncstype bspline\n", ReadError, "free-form geometry"),
        (
            "cut.off",
            off_text(cube().vertices, cube().triangles.tolist())[:-60],
            ReadError,
            "rows it counts|indices it counts",
        ),
        ("other.off", b"NOT A MESH", ReadError, "must begin with OFF"),
        (
            "cut.ply",
            ply_bytes(cube().vertices, cube().triangles.tolist())[:-30],
            ReadError,
            "Got too few of face",
        ),
        (
            "cut2.ply",
            ply_bytes(cube().vertices, cube().triangles.tolist(), "binary_little_endian")[:-3],
            ReadError,
            "Got too few of face",
        ),
        ("head.ply", b"ply\nformat ascii 1.0\n", ReadError, "from ply to end_header"),
        ("kind.ply", b"ply\nformat morse 1.0\nend_header\n", ReadError, "'format morse 1.0'"),
        ("cloud.ply", ply_bytes(cube().vertices, []), ReadError, "vertices and faces. Got none"),
        ("cut.glb", glb_bytes(cube().vertices, cube().triangles)[:-40], ReadError, "GLB file must"),
        ("json.glb", b"{}", ReadError, "GLB file must be whole"),
        (
            "draco.glb",
            glb_bytes(
                cube().vertices, cube().triangles, extensionsRequired=["KHR_draco_mesh_compression"]
            ),
            ReadError,
            "Got KHR_draco_mesh_compression",
        ),
        ("part.off.gz", b"x", ReadError, "must be a whole gzip file"),
        (
            "part.stl.gz",
            gzip.compress(stl_bytes(CUBE), mtime=0)[:-20],
            ReadError,
            "must be a whole gzip file",
        ),
        ("part.3mf", b"x", ReadError, r"must end in one of .step, .stp, .stl.*Got 'part.3mf'"),
    ],
)
def test_damaged_files(tmp_path, name, data, error, rule):
    with pytest.raises(error, match=rule) as caught:
        read(tmp_path, name, data)
    assert caught.type is error
    assert "\n" not in str(caught.value)


def test_bodies_in_contact(tmp_path):
    def pair(shift):
        return stl_bytes(np.concatenate([CUBE, CUBE + np.array(shift, dtype=float)]))

    with pytest.raises(NonManifoldError, match="touch along an edge or a face"):
        read(tmp_path, "face.stl", pair((2, 0, 0)))
    with pytest.raises(NonManifoldError, match="touch in a point"):
        read(tmp_path, "vertex.stl", pair((2, 2, 2)))
    with pytest.raises(SelfIntersectionError, match="solids must not overlap"):
        read(tmp_path, "overlap.stl", pair((1, 1, 1)))


def test_a_crossed_polygon(tmp_path):
    polygons = [list(face.outer) for face in cube().faces]
    polygons[0][1:3] = polygons[0][2:0:-1]
    with pytest.raises(ReadError, match=r"must be simple and have an area\. Got polygon 0"):
        read(tmp_path, "part.obj", obj_text(cube().vertices, polygons))


def test_a_one_sided_surface(tmp_path):
    # The minimal closed surface with one side: the projective plane of six vertices, placed anywhere.
    faces = [
        (0, 1, 2),
        (0, 2, 3),
        (0, 3, 4),
        (0, 4, 5),
        (0, 5, 1),
        (1, 2, 4),
        (2, 3, 5),
        (3, 4, 1),
        (4, 5, 2),
        (5, 1, 3),
    ]
    points = [(0, 0, 9), (5, 0, 1), (1, 4, 0), (-4, 3, 2), (-3, -4, 1), (2, -5, 3)]
    with pytest.raises(OrientationError, match="must have two sides"):
        read(tmp_path, "part.off", off_text(points, faces))


def test_parameters_that_do_not_apply(tmp_path):
    data = stl_bytes(CUBE)
    with pytest.raises(PartFileNotFoundError, match="existing part file") as caught:
        read_solid(tmp_path / "missing.stl")
    assert isinstance(caught.value, FileNotFoundError)
    with pytest.raises(PartFileNotFoundError, match=r"existing part file\. Got the folder '"):
        read_solid(tmp_path)
    with pytest.raises(ReadError, match=r"units must be one of mm.* Got 'parsec'"):
        read(tmp_path, "part.stl", data, units="parsec")
    with pytest.raises(ReadError, match="solids applies to STEP files"):
        read(tmp_path, "part.stl", data, solids=[0])
    with pytest.raises(ReadError, match="planarity_mm must be positive"):
        read(tmp_path, "part.stl", data, planarity_mm=-1.0)
    with pytest.raises(ReadError, match="chord_tolerance_mm must be positive and finite"):
        read(tmp_path, "part.stl", data, chord_tolerance_mm=float("nan"))
    with pytest.raises(ReadError, match=r"angular_tolerance_deg must be in \(0, 90\]"):
        read(tmp_path, "part.stl", data, angular_tolerance_deg=120)


@pytest.mark.parametrize("name", ["chord_tolerance_mm", "planarity_mm", "gap_mm"])
@pytest.mark.parametrize(("value", "got"), [("0.1", "'0.1'"), ([1], "a list"), (True, "True")])
def test_a_tolerance_is_a_number(tmp_path, name, value, got):
    with pytest.raises(ReadError) as info:
        read(tmp_path, "part.stl", stl_bytes(CUBE), **{name: value})
    assert str(info.value) == f"{name} must be positive and finite. Got {got}."
    with pytest.raises(ReadError, match=r"^angular_tolerance_deg must be in \(0, 90\]\. Got '30'"):
        read(tmp_path, "part.stl", stl_bytes(CUBE), angular_tolerance_deg="30")


def test_all_polygons_of_a_file_are_cut_together(tmp_path, monkeypatch):
    """Because each call costs as much as a hundred polygons."""
    calls = []
    cut = mesh.triangulate_faces

    def counted(vertices, loops, normals, name):
        calls.append(len(normals))
        return cut(vertices, loops, normals, name)

    monkeypatch.setattr(mesh, "triangulate_faces", counted)
    solid = l_block()
    polygons = [face.outer for face in solid.faces]
    read_back = read(tmp_path, "block.off", off_text(solid.vertices, polygons))
    assert same_solid(solid, read_back)
    assert calls == [len(solid.faces)]


# What looks like a good mesh file but says something else must not be read as another part.


BYTE_ORDER_MARK = b"\xef\xbb\xbf"
CUBE_SOLID = cube()
LOOPS = [face.outer for face in CUBE_SOLID.faces]
OBJ = obj_text(CUBE_SOLID.vertices, LOOPS)
OFF = off_text(CUBE_SOLID.vertices, LOOPS)
PLY = ply_bytes(CUBE_SOLID.vertices, LOOPS)
STL = stl_text(corners(CUBE_SOLID))
GLB = glb_bytes(CUBE_SOLID.vertices, CUBE_SOLID.triangles)


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("text.stl", STL),
        ("part.obj", OBJ[OBJ.index(b"v ") :]),
        ("part.off", OFF),
        ("text.ply", PLY),
        ("binary.ply", ply_bytes(CUBE_SOLID.vertices, LOOPS, "binary_little_endian")),
    ],
)
def test_a_byte_order_mark_changes_nothing(tmp_path, name, data):
    plain = read(tmp_path, name, data)
    marked = read(tmp_path, name, BYTE_ORDER_MARK + data)
    assert (marked.vertices == plain.vertices).all()
    assert marked.faces == plain.faces


MATERIAL = b"""newmtl steel
Kd 0.5 0.5 0.5
Ns 10
map_Kd steel.png
"""


def test_materials_inside_an_obj_file_carry_no_geometry(tmp_path):
    """Some programs write the lines of the .mtl file into the part; trimesh reads them so, too."""
    plain = read(tmp_path, "plain.obj", OBJ)
    embedded = read(tmp_path, "embedded.obj", MATERIAL + b"usemtl steel\n" + OBJ)
    assert embedded.faces == plain.faces
    assert embedded.volume == plain.volume
    with pytest.raises(ReadError, match=r"must begin with a keyword\. Got 'Kd'"):
        read(tmp_path, "loose.obj", OBJ + b"Kd 0.5 0.5 0.5\n")


def test_a_signalling_nan_is_one_error_and_no_warning(tmp_path):
    """Widening its 32 bits raises the processor's flag, which numpy reports as a warning."""
    data = bytearray(stl_bytes(corners(CUBE_SOLID)))
    data[84 + 12 : 84 + 16] = bytes([1, 0, 0x80, 0x7F])
    with pytest.raises(ReadError, match="coordinates must be finite"):
        read(tmp_path, "part.stl", bytes(data))


def with_column(text: bytes, keyword: bytes, extra: bytes) -> bytes:
    lines = text.split(b"\n")
    return b"\n".join(line + extra if line.startswith(keyword) else line for line in lines)


def test_colours_and_a_weight_of_one_are_no_harm(tmp_path):
    assert read(
        tmp_path, "rgb.obj", with_column(OBJ, b"v ", b" 0.1 0.2 0.3")
    ).volume == pytest.approx(8)
    assert read(tmp_path, "one.obj", with_column(OBJ, b"v ", b" 1.0")).volume == pytest.approx(8)
    rows = off_text(CUBE_SOLID.vertices, LOOPS).split(b"\n")
    rows[3:11] = [row + b" 0.1 0.2 0.3 1.0" for row in rows[3:11]]
    for keyword in (b"OFF", b"COFF", b"STNOFF"):
        assert read(tmp_path, "part.off", b"\n".join([keyword, *rows[1:]])).volume == pytest.approx(
            8
        )


FRACTION = PLY.replace(b"list uchar int", b"list uchar float")


@pytest.mark.parametrize(
    ("name", "data", "rule"),
    [
        ("weight.obj", with_column(OBJ, b"v ", b" 2.0"), "no weight but 1"),
        ("five.obj", with_column(OBJ, b"v ", b" 1.0 1.0"), "must have three numbers"),
        (
            "keyword.obj",
            OBJ.replace(b"v ", b"w ", 1),
            "must begin with a keyword. Got 'w' in line 3",
        ),
        ("underscore.obj", OBJ.replace(b"2.0", b"2_0", 1), "an OBJ vertex must have three numbers"),
        ("index.obj", OBJ.replace(b"8//8", b"0_8//8", 1), "must list vertex numbers. Got '0_8//8'"),
        ("four.off", OFF.replace(b"OFF", b"4OFF"), "must begin with OFF.*Got '4OFF'"),
        ("n.off", OFF.replace(b"OFF", b"nOFF"), "Got 'nOFF'"),
        ("weight.off", OFF.replace(b"0.0 0.0 0.0\n", b"0.0 0.0 0.0 2.0\n"), "three and a colour"),
        ("more.off", OFF.replace(b"8 6 0", b"8 5 0"), "8 \\+ 5 counted, 14 present"),
        ("underscore.off", OFF.replace(b"2.0", b"2_0", 1), "must have three numbers"),
        ("underscore.stl", STL.replace(b"2.0", b"2_0", 1), "must have three numbers"),
        ("digits.stl", STL.replace(b"2.0", "٢".encode(), 1), "must have three numbers"),
        ("four.stl", with_column(STL, b"  vertex", b" 4"), "must have three numbers"),
        (
            "fraction.ply",
            FRACTION.replace(b"4 0 ", b"4 0.5 ", 1),
            "whole vertex numbers. Got \\[0.5",
        ),
        ("inf.ply", FRACTION.replace(b"4 0 ", b"4 inf ", 1), "whole vertex numbers. Got \\[inf"),
        (
            "truncated.ply",
            PLY.replace(b"4 0 ", b"4 0.5 ", 1),
            "number of its type. Got '0.5' in face",
        ),
        (
            "inf_count.ply",
            PLY.replace(b"4 0 ", b"inf 0 ", 1),
            "number of its type. Got 'inf' in face",
        ),
        (
            "underscore.ply",
            PLY.replace(b"7 ", b"7_0 ", 1),
            "number of its type. Got '7_0' in vertex",
        ),
        ("less.ply", PLY.replace(b"element face 6", b"element face 5"), "must count all its rows"),
        (
            "header.ply",
            PLY.replace(b"element face", b"elexment face"),
            "header line must follow the format",
        ),
        (
            "twice.ply",
            PLY.replace(b"property double y", b"property double x"),
            "header line must follow the format",
        ),
        (
            "scalar.ply",
            PLY.replace(b"list uchar int", b"int"),
            "must have a list of vertex_indices",
        ),
        (
            "rows.ply",
            PLY.replace(b"element face 6", b"element face 999999999999"),
            "rows it counts",
        ),
    ],
)
def test_what_is_refused(tmp_path, name, data, rule):
    assert data not in (OBJ, OFF, PLY, STL)
    with pytest.raises(ReadError, match=rule) as caught:
        read(tmp_path, name, data)
    assert "\n" not in str(caught.value)


def test_an_element_without_properties_has_no_rows(tmp_path):
    data = PLY.replace(b"element face", b"element nothing 999999999999999\nelement face")
    assert read(tmp_path, "part.ply", data).volume == pytest.approx(8)


def test_facets_that_the_header_does_not_count(tmp_path):
    # the first of two boxes is closed, so the lie would go unnoticed
    triangles = corners(two_boxes())
    with pytest.raises(ReadError, match="Got 12 counted, 24 whole ones present"):
        read(tmp_path, "part.stl", stl_bytes(triangles, count=12))


def changed(change) -> bytes:
    size = struct.unpack_from("<I", GLB, 12)[0]
    document = json.loads(GLB[20 : 20 + size])
    change(document)
    return with_json(document, GLB[20 + size :])


def put(*path_and_value):
    *path, last, value = path_and_value

    def change(document):
        for key in path:
            document = document[key]
        document[last] = value

    return change


@pytest.mark.parametrize(
    ("change", "rule"),
    [
        (put("scene", -1), "must be those of things in it. Got -1"),
        (put("scenes", 0, "nodes", [0, 0]), "must form trees. Got node 0 as a child of two nodes"),
        (put("nodes", 1, "children", [0]), "must form trees"),
        (put("nodes", 1, "mesh", True), "must be those of things in it. Got True"),
        (put("nodes", 1, "matrix", [1e300] * 15 + [1]), "must end in 0, 0, 0, 1"),
        (put("nodes", 1, "matrix", [1.0] * 15), "must be 16 finite numbers"),
        (put("nodes", 1, "rotation", [0, 0, 0, 2]), "must be a unit quaternion"),
        (put("nodes", 1, "scale", [1e300, 1e300, "x"]), "must be 3 finite numbers"),
        (put("nodes", 0, "translation", [float("inf"), 0, 0]), "must be 3 finite numbers"),
        (put("nodes", 7), "follow glTF 2.0. Got TypeError"),
        (put("accessors", 0, "count", 10**30), "must lie inside the binary chunk"),
        (put("accessors", 0, "count", -3), "whole numbers from 0. Got -3"),
        (put("accessors", 0, "componentType", 5121), "legal component type"),
        (put("accessors", 1, "componentType", 5126), "legal component type"),
        (put("accessors", 0, "byteOffset", -12), "whole numbers from 0. Got -12"),
        (put("bufferViews", 0, "byteStride", 1), "must lie inside"),
        (put("bufferViews", 0, "byteLength", 10**9), "must lie inside"),
    ],
)
def test_glb_documents_that_are_refused(tmp_path, change, rule):
    with pytest.raises(ReadError, match=rule) as caught:
        read(tmp_path, "part.glb", changed(change))
    assert "\n" not in str(caught.value)


def test_glb_numbers_too_large_to_multiply(tmp_path):
    data = changed(lambda document: [node.update(scale=[1e300] * 3) for node in document["nodes"]])
    with pytest.raises(ReadError, match="must be finite"):
        read(tmp_path, "part.glb", data)


def test_a_small_glb_that_unfolds_into_very_many_triangles(tmp_path):
    # twelve levels of ten children each: 10^12 cubes
    levels = [{"children": [level + 1] * 10} for level in range(12)]
    with pytest.raises(ReadError, match="must form trees"):
        read(tmp_path, "tower.glb", changed(put("nodes", [*levels, {"mesh": 0}])))
    nodes = [
        {"children": list(range(1, 1001))},
        *({"mesh": 0, "translation": [3 * i, 0, 0]} for i in range(1000)),
    ]
    with pytest.raises(
        ReadError, match=r"at most triangles=5000 triangles.*ReadLimits\(triangles=...\)"
    ):
        read(tmp_path, "many.glb", changed(put("nodes", nodes)), limits=ReadLimits(triangles=5000))


def test_triangles_of_other_formats_are_limited_too(tmp_path):
    with pytest.raises(ReadError, match=r"at most triangles=11 triangles\. Got 12"):
        read(tmp_path, "part.obj", OBJ, limits=ReadLimits(triangles=11))


def test_a_packed_file_is_unpacked_no_further_than_the_limit(tmp_path, monkeypatch):
    data = gzip.compress(b"solid " + b" " * 30_000_000)
    taken = []
    plain_read = gzip.GzipFile.read
    monkeypatch.setattr(
        gzip.GzipFile, "read", lambda file, n=-1: (taken.append(n), plain_read(file, n))[1]
    )
    with pytest.raises(
        ReadError, match=r"at most file_mb=1 MB, unpacked. Got part.stl.gz with more"
    ):
        read(tmp_path, "part.stl.gz", data, limits=ReadLimits(file_mb=1))
    assert taken == [1_000_001]
    with pytest.raises(ReadError, match=r"at most file_mb=0\.0001 MB"):
        read(tmp_path, "part.off", OFF, limits=ReadLimits(file_mb=1e-4))


def test_limits_are_checked():
    for name in ("time_s", "memory_mb", "file_mb", "triangles"):
        for value in (0, -1.0, np.inf, np.nan):
            with pytest.raises(
                ReadError, match=f"{name} of the limits must be positive and finite"
            ):
                ReadLimits(**{name: value})


def test_a_good_part_is_read_as_before(tmp_path):
    assert read(tmp_path, "part.stl", stl_bytes(corners(l_block()), tail=b"\r\n")).notes == (
        "ignored 2 bytes after the last facet",
    )


# Odd mesh files: those that are a cube all the same, and those that are refused with the reason.


BINARY = ply_bytes(CUBE_SOLID.vertices, LOOPS, "binary_little_endian")
# three points of a straight line somewhere beside the cube: a facet without area, open on all sides
NEEDLE = np.array([[[9.0, 9.0, 9.0], [10.0, 9.0, 9.0], [11.0, 9.0, 9.0]]])


def with_needle(torn):
    """The cube's facets, one corner of one of them displaced or not, and the needle."""
    facets = corners(CUBE_SOLID).astype(float)
    facets[0, 0] += [torn, 0.0, 0.0]
    return stl_text(np.concatenate([facets, NEEDLE]))


@pytest.mark.parametrize(
    ("name", "data", "note"),
    [
        ("loose.obj", OBJ + b"l 1 2\np 3\n", "ignored 2 loose lines and points"),
        ("repeated.obj", OBJ + b"f 1 2 2 1\n", "dropped 1 facets that use a vertex twice"),
        ("needle.stl", with_needle(0.0), "without area"),
        ("torn.stl", with_needle(1e-7), "merged 1 vertices closer than"),
        ("empty.ply", BINARY.replace(b"element face", b"element edge 3\nelement face"), None),
    ],
)
def test_it_is_the_cube_all_the_same(tmp_path, name, data, note):
    solid = read(tmp_path, name, data)
    assert solid.volume == pytest.approx(8.0, rel=1e-6)
    assert len(solid.faces) == 6
    assert note is None or any(note in one for one in solid.notes), solid.notes


def test_a_round_mesh_says_that_its_facets_are_taken_for_a_surface(tmp_path):
    """24 walls around an axis: no chord of a rim is offered as a straight edge."""
    n = 24
    turn = 2.0 * np.pi * np.arange(24) / 24
    ring = np.column_stack([10.0 * np.cos(turn), 10.0 * np.sin(turn)])
    points = [[x, y, z] for z in (0.0, 30.0) for x, y in ring]
    loops = [
        range(n)[::-1],
        range(n, 2 * n),
        *((i, (i + 1) % n, (i + 1) % n + n, i + n) for i in range(n)),
    ]
    solid = read(tmp_path, "round.obj", obj_text(points, [tuple(loop) for loop in loops]))
    assert solid.notes == (
        "24 faces taken for facets of curved surfaces; their chords are no candidates",
    )
    assert solid.straight_edges() == ()
    assert len(solid.faces) == n + 2


@pytest.mark.parametrize(
    ("name", "data", "rule"),
    [
        ("free.obj", OBJ + b"cstype bezier\n", r"must hold polygons\. Got free-form geometry \('cstype'\) in line"),
        ("short.off", OFF.replace(b"\n4 ", b"\n9 ", 1), r"must hold the indices it counts\. Got 7 of 9 in line"),
        ("lists.ply", PLY.replace(b"property double x", b"property list uchar double x").replace(b"\n7 ", b"\n7 1 "),
         r"the x, y and z of a PLY vertex must be numbers\. Got lists"),
        ("real.ply", PLY.replace(b"list uchar int", b"list float int"), r"Got 'property list float"),
        ("count.ply", PLY.replace(b"vertex 8", b"vertex -8"), r"follow the format\. Got 'element vertex -8'"),
        ("minus.ply", PLY.replace(b"list uchar", b"list char").replace(b"\n4 ", b"\n-1 ", 1), r"a list of -1 in face"),
        ("minus_binary.ply", BINARY.replace(b"list uchar", b"list char").replace(b"\x04\x00", b"\xff\x00", 1), "face"),
        ("polygon.obj", OBJ + b"f 1 2 3 1 2 3\n", r"must be simple and have an area\. Got polygon 6 of the file"),
    ],
)  # fmt: skip
def test_what_is_refused_says_why(tmp_path, name, data, rule):
    with pytest.raises(ReadError, match=rule):
        read(tmp_path, name, data)


def test_a_binary_needle_is_no_harm_either(tmp_path):
    solid = read(tmp_path, "needle.stl", stl_bytes(np.concatenate([corners(CUBE_SOLID), NEEDLE])))
    assert solid.volume == pytest.approx(8.0)


# No damage to a mesh file leads to anything but a solid or one of the package's own errors.


SOLID = l_block()
L_LOOPS = [face.outer for face in SOLID.faces]
FILES = {
    "binary.stl": stl_bytes(corners(SOLID)),
    "text.stl": stl_text(corners(SOLID)),
    "part.obj": obj_text(SOLID.vertices, L_LOOPS),
    "part.off": off_text(SOLID.vertices, L_LOOPS),
    "text.ply": ply_bytes(SOLID.vertices, L_LOOPS),
    "binary.ply": ply_bytes(SOLID.vertices, L_LOOPS, "binary_big_endian"),
    "part.glb": glb_bytes(SOLID.vertices, SOLID.triangles),
}


def read_damaged(path, n: int, damage) -> list[str]:
    """Read a file damaged in n ways; return the messages of the errors."""
    rng = np.random.default_rng(20240229)
    messages = []
    for _ in range(n):
        path.write_bytes(damage(FILES[path.name], rng))
        try:
            assert isinstance(read_solid(path), Solid)
        except AspectGraphError as error:
            messages.append(str(error))
    assert not any("\n" in message for message in messages)
    return messages


@pytest.mark.parametrize("name", FILES)
def test_damaged_bytes(tmp_path, name):
    assert len(read_damaged(tmp_path / name, 120, damaged_bytes)) > 60


@pytest.mark.parametrize(
    "name", [name for name in FILES if "binary" not in name and "glb" not in name]
)
def test_damaged_numbers(tmp_path, name):
    assert len(read_damaged(tmp_path / name, 120, damaged_numbers)) > 40


def test_damaged_glb_documents(tmp_path):
    assert len(read_damaged(tmp_path / "part.glb", 300, damaged_glb)) > 150
