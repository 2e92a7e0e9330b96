"""GLB files: binary glTF 2.0 with plain triangles."""

from __future__ import annotations

import json
import struct

import numpy as np

from aspectgraph.exceptions import ReadError

_COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_TRIANGLES = 4


def parse_glb(data: bytes) -> tuple[np.ndarray, np.ndarray]:
    """Return the vertices and triangles of the scene of a GLB file, in the file's unit (the standard says metres).

    Raises
    ------
    ReadError
        The file is cut off or malformed, holds no triangles, or needs an extension (compression).
    """
    try:
        document, binary = _split_chunks(data)
        needed = document.get("extensionsRequired", [])
        if needed:
            raise ReadError(f"a GLB file must do without required extensions. Got {', '.join(needed)}.")
        vertices, triangles = [], []
        n = 0
        for matrix, mesh in _placed_meshes(document):
            for primitive in document["meshes"][mesh]["primitives"]:
                points, corners = _read_primitive(document, binary, primitive)
                vertices.append(points @ matrix[:3, :3].T + matrix[:3, 3])
                triangles.append(n + (corners[:, ::-1] if np.linalg.det(matrix[:3, :3]) < 0 else corners))
                n += len(points)
    except (KeyError, IndexError, TypeError, struct.error, json.JSONDecodeError, UnicodeDecodeError) as error:
        raise ReadError(
            f"a GLB file must be whole and follow glTF 2.0. Got {type(error).__name__}: {error}."
        ) from error
    if not triangles:
        raise ReadError("a GLB file must hold triangles. Got none.")
    return np.concatenate(vertices), np.concatenate(triangles)


def _split_chunks(data: bytes) -> tuple[dict, bytes]:
    magic, version, length = struct.unpack_from("<4sII", data)
    if magic != b"glTF" or version != 2 or length > len(data):
        raise ReadError(
            f"a GLB file must begin with glTF, version 2, and be {length} bytes long. Got {len(data)} bytes."
        )
    chunks, at = {}, 12
    while at + 8 <= length:
        size, kind = struct.unpack_from("<I4s", data, at)
        chunks.setdefault(kind, data[at + 8 : at + 8 + size])
        at += 8 + size
    return json.loads(chunks[b"JSON"].decode("utf-8")), chunks.get(b"BIN\0", b"")


def _placed_meshes(document: dict) -> list[tuple[np.ndarray, int]]:
    """Return every mesh of the scene with its 4x4 placement."""
    nodes = document.get("nodes", [])
    scenes = document.get("scenes")
    roots = scenes[document.get("scene", 0)].get("nodes", []) if scenes else _parentless(nodes)
    placed, pending = [], [(np.eye(4), root, 0) for root in reversed(roots)]
    while pending:
        parent, index, depth = pending.pop()
        if depth > len(nodes):
            raise ReadError("the nodes of a GLB file must form a tree. Got a cycle.")
        matrix = parent @ _local_matrix(nodes[index])
        if "mesh" in nodes[index]:
            placed.append((matrix, nodes[index]["mesh"]))
        pending.extend((matrix, child, depth + 1) for child in reversed(nodes[index].get("children", [])))
    return placed


def _parentless(nodes: list[dict]) -> list[int]:
    children = {child for node in nodes for child in node.get("children", [])}
    return [i for i in range(len(nodes)) if i not in children]


def _local_matrix(node: dict) -> np.ndarray:
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    x, y, z, w = node.get("rotation", (0.0, 0.0, 0.0, 1.0))
    matrix = np.eye(4)
    matrix[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    matrix[:3, :3] *= np.array(node.get("scale", (1.0, 1.0, 1.0)))
    matrix[:3, 3] = node.get("translation", (0.0, 0.0, 0.0))
    return matrix


def _read_primitive(document: dict, binary: bytes, primitive: dict) -> tuple[np.ndarray, np.ndarray]:
    mode = primitive.get("mode", _TRIANGLES)
    if mode != _TRIANGLES:
        raise ReadError(f"the primitives of a GLB file must be triangles (mode 4). Got mode {mode}.")
    points = _read_accessor(document, binary, primitive["attributes"]["POSITION"], 3).astype(np.float64)
    if "indices" in primitive:
        corners = _read_accessor(document, binary, primitive["indices"], 1).astype(np.int64).ravel()
    else:
        corners = np.arange(len(points))
    if len(corners) % 3 or (len(corners) and corners.max() >= len(points)):
        raise ReadError(f"GLB indices must be triples below {len(points)}. Got {len(corners)} up to {corners.max()}.")
    return points, corners.reshape(-1, 3)


def _read_accessor(document: dict, binary: bytes, index: int, width: int) -> np.ndarray:
    accessor = document["accessors"][index]
    if "sparse" in accessor or "bufferView" not in accessor:
        raise ReadError(f"GLB accessors must be plain. Got a sparse one, number {index}.")
    view = document["bufferViews"][accessor["bufferView"]]
    if view.get("buffer", 0) != 0 or "uri" in document["buffers"][0]:
        raise ReadError(f"a GLB file must hold its own data. Got buffer view {accessor['bufferView']} elsewhere.")
    dtype = np.dtype(_COMPONENTS[accessor["componentType"]])
    count, start = accessor["count"], view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
    stride = view.get("byteStride", dtype.itemsize * width)
    if count < 1 or start + (count - 1) * stride + dtype.itemsize * width > len(binary):
        raise ReadError(f"GLB accessors must lie inside the binary chunk. Got number {index} outside.")
    return np.ndarray((count, width), dtype, binary, start, (stride, dtype.itemsize))
