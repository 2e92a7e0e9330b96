"""Mesh files: good ones give the solid they were made of, damaged ones one clear error."""

from __future__ import annotations

import gzip

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
from solids import cube, hollow_box, l_block, plate, slotted_block, two_boxes, two_pocket_block

from aspectgraph import (
    NonManifoldError,
    OpenSolidError,
    OrientationError,
    PartFileNotFoundError,
    ReadError,
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
