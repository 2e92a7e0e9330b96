"""What looks like a good mesh file but says something else must not be read as another part."""

from __future__ import annotations

import gzip
import json
import struct

import numpy as np
import pytest
from mesh_files import corners, glb_bytes, obj_text, off_text, ply_bytes, stl_bytes, stl_text
from part_mutants import with_json
from solids import cube, l_block, two_boxes

from aspectgraph import ReadError, ReadLimits, read_solid

BYTE_ORDER_MARK = b"\xef\xbb\xbf"
CUBE = cube()
LOOPS = [face.outer for face in CUBE.faces]
OBJ = obj_text(CUBE.vertices, LOOPS)
OFF = off_text(CUBE.vertices, LOOPS)
PLY = ply_bytes(CUBE.vertices, LOOPS)
STL = stl_text(corners(CUBE))
GLB = glb_bytes(CUBE.vertices, CUBE.triangles)


def read(tmp_path, name, data, **options):
    path = tmp_path / name
    path.write_bytes(data)
    return read_solid(path, **options)


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("text.stl", STL),
        ("part.obj", OBJ[OBJ.index(b"v ") :]),
        ("part.off", OFF),
        ("text.ply", PLY),
        ("binary.ply", ply_bytes(CUBE.vertices, LOOPS, "binary_little_endian")),
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
    data = bytearray(stl_bytes(corners(CUBE)))
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
    rows = off_text(CUBE.vertices, LOOPS).split(b"\n")
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
        (put("scenes", 0, "nodes", [0, 0]), "must form trees. Got node 0 in two places"),
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
