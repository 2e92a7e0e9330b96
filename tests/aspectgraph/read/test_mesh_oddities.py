"""Odd mesh files: those that are a cube all the same, and those that are refused with the reason."""

from __future__ import annotations

import numpy as np
import pytest
from mesh_files import corners, obj_text, off_text, ply_bytes, stl_bytes, stl_text
from solids import cube

from aspectgraph import ReadError, read_solid

CUBE = cube()
LOOPS = [face.outer for face in CUBE.faces]
OBJ = obj_text(CUBE.vertices, LOOPS)
OFF = off_text(CUBE.vertices, LOOPS)
PLY = ply_bytes(CUBE.vertices, LOOPS)
BINARY = ply_bytes(CUBE.vertices, LOOPS, "binary_little_endian")
# three points of a straight line somewhere beside the cube: a facet without area, open on all sides
NEEDLE = np.array([[[9.0, 9.0, 9.0], [10.0, 9.0, 9.0], [11.0, 9.0, 9.0]]])


def read(tmp_path, name, data):
    path = tmp_path / name
    path.write_bytes(data)
    return read_solid(path)


def with_needle(torn):
    """The cube's facets, one corner of one of them displaced or not, and the needle."""
    facets = corners(CUBE).astype(float)
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
    solid = read(tmp_path, "needle.stl", stl_bytes(np.concatenate([corners(CUBE), NEEDLE])))
    assert solid.volume == pytest.approx(8.0)
