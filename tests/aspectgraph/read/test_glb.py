"""What in a GLB file changes the shape: read, or refused by name, whether or not the file requires it."""

from __future__ import annotations

import json
import struct

import numpy as np
import pytest
from solids import cube

from aspectgraph import ReadError
from aspectgraph.read.mesh import read_mesh

FLOAT = 5126


class Glb:
    """A GLB file of one unit cube, to be changed and written."""

    def __init__(self):
        solid = cube(1.0)
        self.points = solid.vertices - solid.vertices.min(axis=0)
        self.binary = b""
        self.document = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}]}
        self.document |= {"nodes": [{"mesh": 0}], "accessors": [], "bufferViews": []}
        position = self.add(self.points, "<f4", FLOAT, "VEC3")
        indices = self.add(solid.triangles.ravel(), "<u2", 5123, "SCALAR")
        self.primitive = {"attributes": {"POSITION": position}, "indices": indices}
        self.document["meshes"] = [{"primitives": [self.primitive]}]

    def view(self, rows, dtype):
        data = np.asarray(rows).astype(dtype).tobytes()
        at = len(self.binary)
        self.binary += data + b"\0" * (-len(data) % 4)
        self.document["bufferViews"].append(
            {"buffer": 0, "byteOffset": at, "byteLength": len(data)}
        )
        return len(self.document["bufferViews"]) - 1

    def add(self, rows, dtype, component, kind, **extra):
        accessor = {"bufferView": self.view(rows, dtype), "componentType": component}
        accessor |= {"count": len(rows), "type": kind, **extra}
        self.document["accessors"].append(accessor)
        return len(self.document["accessors"]) - 1

    @property
    def node(self):
        return self.document["nodes"][0]

    def read(self):
        self.document["buffers"] = [{"byteLength": len(self.binary)}]
        head = json.dumps(self.document).encode()
        head += b" " * (-len(head) % 4)
        total = 12 + 8 + len(head) + 8 + len(self.binary)
        data = struct.pack("<4sII", b"glTF", 2, total)
        data += struct.pack("<I4s", len(head), b"JSON") + head
        data += struct.pack("<I4s", len(self.binary), b"BIN\0") + self.binary
        return read_mesh(data, ".glb", units="mm")


def spans(solid):
    """The box of every cube of a file, in the order of their x."""
    corners = solid.vertices[np.argsort(solid.vertices[:, 0], kind="stable")].reshape(-1, 8, 3)
    return [(part.min(axis=0).tolist(), part.max(axis=0).tolist()) for part in corners]


@pytest.mark.parametrize("required", [False, True])
def test_instances(required):
    glb = Glb()
    half = np.sqrt(0.5)
    attributes = {
        "TRANSLATION": glb.add([[0, 0, 0], [10, 0, 0], [20, 0, 0]], "<f4", FLOAT, "VEC3"),
        "ROTATION": glb.add([[0, 0, 0, 1], [0, 0, half, half], [0, 0, 0, 1]], "<f4", FLOAT, "VEC4"),
        "SCALE": glb.add([[1, 1, 1], [1, 2, 1], [1, 1, -4]], "<f4", FLOAT, "VEC3"),
        "_ID": 99,
    }
    glb.node["scale"] = [2, 1, 1]
    glb.node["extensions"] = {"EXT_mesh_gpu_instancing": {"attributes": attributes}}
    glb.document["extensionsUsed"] = ["EXT_mesh_gpu_instancing"]
    if required:
        glb.document["extensionsRequired"] = ["EXT_mesh_gpu_instancing"]
    solid = glb.read()
    assert solid.volume == pytest.approx(2.0 * (1 + 2 + 4))
    # scaled by 1 2 1, turned to the side of -x, moved to 10, then doubled along x
    expected = [([0, 0, 0], [2, 1, 1]), ([16, 0, 0], [20, 1, 1]), ([40, 0, -4], [42, 1, 0])]
    for found, (low, high) in zip(spans(solid), expected, strict=True):
        assert np.allclose(found, (low, high), atol=1e-5)


def test_quantized_numbers():
    glb = Glb()
    glb.document["extensionsUsed"] = ["KHR_mesh_quantization"]
    glb.document["extensionsRequired"] = ["KHR_mesh_quantization"]
    for rows, dtype, component, extra, size in (
        (glb.points * 200, "<u1", 5121, {}, 200.0),
        (glb.points * -5, "<i2", 5122, {}, 5.0),
        (glb.points * 65535, "<u2", 5123, {"normalized": True}, 1.0),
        (glb.points * 127, "<i1", 5120, {"normalized": True}, 1.0),
    ):
        # rows of three bytes are padded to four in a file
        wide = np.zeros((8, 4))
        wide[:, :3] = rows
        index = glb.add(wide, dtype, component, "VEC3", **extra)
        view = glb.document["bufferViews"][glb.document["accessors"][index]["bufferView"]]
        view["byteStride"] = 4 * np.dtype(dtype).itemsize
        glb.primitive["attributes"]["POSITION"] = index
        assert glb.read().volume == pytest.approx(size**3)
    del glb.document["extensionsUsed"]
    with pytest.raises(ReadError, match="legal component type"):
        glb.read()


def test_sparse_accessors():
    glb = Glb()
    accessor = glb.document["accessors"][glb.primitive["attributes"]["POSITION"]]
    top = np.flatnonzero(glb.points[:, 2] == 1.0)
    sparse = {
        "count": len(top),
        "indices": {"bufferView": glb.view(top, "<u2"), "componentType": 5123},
        "values": {"bufferView": glb.view(glb.points[top] * (1, 1, 3), "<f4")},
    }
    accessor["sparse"] = sparse
    assert glb.read().volume == pytest.approx(3.0)
    # without rows of its own: all are zero but those replaced
    rest = np.flatnonzero(glb.points.any(axis=1))
    sparse["count"] = len(rest)
    sparse["indices"]["bufferView"] = glb.view(rest, "<u2")
    sparse["values"]["bufferView"] = glb.view(glb.points[rest], "<f4")
    view = accessor.pop("bufferView")
    assert glb.read().volume == pytest.approx(1.0)
    accessor["count"] = 10**12
    with pytest.raises(ReadError, match="without data must have 1 to 15000000 rows"):
        glb.read()
    accessor |= {"bufferView": view, "count": 8}
    sparse["indices"]["bufferView"] = glb.view(rest[::-1], "<u2")
    with pytest.raises(ReadError, match="must ascend and be below 8"):
        glb.read()


def test_morph_targets_count_with_their_weights():
    glb = Glb()
    taller = glb.add(glb.points * (0, 0, 2), "<f4", FLOAT, "VEC3")
    glb.primitive["targets"] = [{"POSITION": taller}, {"NORMAL": 0}]
    assert glb.read().volume == pytest.approx(1.0)
    glb.document["meshes"][0]["weights"] = [0.5, 1.0]
    assert glb.read().volume == pytest.approx(2.0)
    glb.node["weights"] = [0.0, 1.0]
    assert glb.read().volume == pytest.approx(1.0)
    glb.node["weights"] = [1.0]
    with pytest.raises(ReadError, match="for each of its 2 morph targets"):
        glb.read()


def test_skins_are_refused():
    glb = Glb()
    glb.node["skin"] = 0
    with pytest.raises(
        ReadError, match=r"must have no skin, which bends them\. Got skin 0 at node 0"
    ):
        glb.read()


def test_animations_are_left_out_with_a_note():
    glb = Glb()
    glb.document["animations"] = [{"channels": [], "samplers": []}]
    solid = glb.read()
    assert solid.volume == pytest.approx(1.0)
    assert solid.notes == ("left out 1 animations; the pose is the one the nodes state",)


@pytest.mark.parametrize(
    ("path", "name", "where"),
    [
        (["meshes", 0, "primitives", 0], "KHR_draco_mesh_compression", "a primitive of mesh 0"),
        (["bufferViews", 0], "EXT_meshopt_compression", "buffer view 0"),
        (["bufferViews", 0], "KHR_meshopt_compression", "buffer view 0"),
        (["accessors", 1], "ACME_accessor", "accessor 1"),
        (["nodes", 0], "KHR_node_visibility", "node 0"),
        (["meshes", 0], "ACME_bend", "mesh 0"),
        (["scenes", 0], "ACME_scene", "scene 0"),
        ([], "CESIUM_RTC", "the whole file"),
    ],
)
def test_extensions_that_may_change_the_shape_are_refused_by_name(path, name, where):
    glb = Glb()
    thing = glb.document
    for key in path:
        thing = thing[key]
    thing["extensions"] = {name: {}}
    with pytest.raises(ReadError, match=f"Got {name} at {where}"):
        glb.read()
    thing["extensions"] = {"KHR_materials_variants": {}, "KHR_xmp_json_ld": {}}
    assert glb.read().volume == pytest.approx(1.0)


def test_extensions_of_materials_and_textures_are_harmless():
    glb = Glb()
    glb.document["materials"] = [{"extensions": {"ACME_paint": {}}}]
    glb.document["extensionsUsed"] = ["ACME_paint", "KHR_texture_transform"]
    glb.document["extensionsRequired"] = ["KHR_texture_transform"]
    assert glb.read().volume == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("attributes", "rule"),
    [
        (
            {"TRANSLATION": [[0, 0, 0]], "SCALE": [[1, 1, 1], [1, 1, 1]]},
            "one count. Got \\[1, 2\\]",
        ),
        ({}, "one count. Got \\[\\]"),
        ({"ROTATION": [[0, 0, 0, 2]]}, "must be unit quaternions"),
        ({"SHEAR": [[0, 0, 0]]}, "Got SHEAR at node 0"),
    ],
)
def test_instances_that_are_refused(attributes, rule):
    glb = Glb()
    numbers = {
        name: glb.add(rows, "<f4", FLOAT, f"VEC{len(rows[0])}") for name, rows in attributes.items()
    }
    glb.node["extensions"] = {"EXT_mesh_gpu_instancing": {"attributes": numbers}}
    with pytest.raises(ReadError, match=rule):
        glb.read()
