"""No damage to a mesh file leads to anything but a solid or one of the package's own errors."""

from __future__ import annotations

import numpy as np
import pytest
from mesh_files import corners, glb_bytes, obj_text, off_text, ply_bytes, stl_bytes, stl_text
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


def damaged(data: bytes, rng: np.random.Generator) -> bytes:
    """One to three cuts, losses, repetitions or changed bytes."""
    for _ in range(rng.integers(1, 4)):
        at, other = rng.integers(len(data), size=2)
        kind = rng.integers(5)
        if kind == 0:
            data = data[:at]
        elif kind == 1:
            data = data[:at] + data[at + rng.integers(1, 40) :]
        elif kind == 2:
            data = data[:at] + data[other : other + 30] + data[at:]
        else:
            new = rng.integers(256) if kind == 3 else rng.choice(list(b"0123456789.-e \n"))
            data = data[:at] + bytes([new]) + data[at + 1 :]
        data = data or b"x"
    return data


@pytest.mark.parametrize("name", FILES)
def test_damage(tmp_path, name):
    rng = np.random.default_rng(20240229)
    path = tmp_path / name
    messages = []
    for _ in range(120):
        path.write_bytes(damaged(FILES[name], rng))
        try:
            assert isinstance(read_solid(path), Solid)
        except AspectGraphError as error:
            messages.append(str(error))
    assert len(messages) > 60
    assert not any("\n" in message for message in messages)
