"""No damage to a mesh file leads to anything but a solid or one of the package's own errors."""

from __future__ import annotations

import numpy as np
import pytest
from mesh_files import corners, glb_bytes, obj_text, off_text, ply_bytes, stl_bytes, stl_text
from part_mutants import damaged_bytes, damaged_glb, damaged_numbers
from solids import l_block

from aspectgraph import AspectGraphError, Solid, read_solid

SOLID = l_block()
LOOPS = [face.outer for face in SOLID.faces]
FILES = {
    "binary.stl": stl_bytes(corners(SOLID)),
    "text.stl": stl_text(corners(SOLID)),
    "part.obj": obj_text(SOLID.vertices, LOOPS),
    "part.off": off_text(SOLID.vertices, LOOPS),
    "text.ply": ply_bytes(SOLID.vertices, LOOPS),
    "binary.ply": ply_bytes(SOLID.vertices, LOOPS, "binary_big_endian"),
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
