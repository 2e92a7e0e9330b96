"""GLB files: binary glTF 2.0 with plain triangles."""

from __future__ import annotations

import json
import math
import struct
from typing import Any

import numpy as np

from aspectgraph.exceptions import ReadError

_INDEX_TYPES = {5121: "<u1", 5123: "<u2", 5125: "<u4"}
_REAL_TYPES = {5126: "<f4"}
_TRIANGLES = 4
_UNIT_LENGTH = 1e-3
"""How far the length of a rotation's quaternion may be from one."""


def parse_glb(data: bytes, most_triangles: int = 5_000_000) -> tuple[np.ndarray, np.ndarray]:
    """Return the vertices and triangles of the scene of a GLB file, in the file's unit (the standard says metres).

    Parameters
    ----------
    data : bytes
        The file.
    most_triangles : int
        See `ReadLimits`. A mesh may be placed any number of times, so a small file can hold very many.

    Raises
    ------
    ReadError
        The file is cut off or malformed, holds no triangles or too many, or needs an extension (compression).
    """
    try:
        document, binary = _split_chunks(data)
        needed = document.get("extensionsRequired", [])
        if needed:
            raise ReadError(
                f"a GLB file must do without required extensions. Got {', '.join(map(str, needed))[:80]}."
            )
        # what overflows is not finite, and refused as such
        with np.errstate(all="ignore"):
            return _gather(document, binary, most_triangles)
    except ReadError:
        raise
    except (
        ArithmeticError, AttributeError, LookupError, RecursionError, TypeError, ValueError, struct.error,
    ) as error:  # fmt: skip
        # a value of another type than the standard says, or none
        text = " ".join(str(error).split())[:100]
        raise ReadError(
            f"a GLB file must be whole and follow glTF 2.0. Got {type(error).__name__}: {text}."
        ) from error


def _gather(
    document: dict[str, Any], binary: bytes, most_triangles: int
) -> tuple[np.ndarray, np.ndarray]:
    vertices, triangles = [], []
    n = n_triangles = 0
    for matrix, mesh in _placed_meshes(document):
        for primitive in _at(document["meshes"], mesh)["primitives"]:
            points, corners = _read_primitive(document, binary, primitive)
            n_triangles += len(corners)
            if n_triangles > most_triangles or n + len(points) > 3 * most_triangles:
                raise ReadError(
                    f"a GLB file must place at most triangles={most_triangles} triangles. Got more; "
                    "allow more with limits=ReadLimits(triangles=...)."
                )
            vertices.append(points.astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3])
            corners = corners.astype(np.int64)
            triangles.append(
                n + (corners[:, ::-1] if np.linalg.det(matrix[:3, :3]) < 0 else corners)
            )
            n += len(points)
    if not triangles:
        raise ReadError("a GLB file must hold triangles. Got none.")
    return np.concatenate(vertices), np.concatenate(triangles)


def _split_chunks(data: bytes) -> tuple[dict[str, Any], bytes]:
    magic, version, length = struct.unpack_from("<4sII", data)
    if magic != b"glTF" or version != 2 or length > len(data):
        raise ReadError(
            f"a GLB file must begin with glTF, version 2, and be {length} bytes long. Got {len(data)} bytes."
        )
    chunks: dict[bytes, bytes] = {}
    at = 12
    while at + 8 <= length:
        size, kind = struct.unpack_from("<I4s", data, at)
        chunks.setdefault(kind, data[at + 8 : at + 8 + size])
        at += 8 + size
    return json.loads(chunks[b"JSON"].decode("utf-8")), chunks.get(b"BIN\0", b"")


def _at(items: list[Any], index: int) -> Any:
    """Return an item of a list of the document; Python would take -1 and True as well."""
    if type(index) is not int or not 0 <= index < len(items):
        raise ReadError(
            f"the numbers in a GLB file must be those of things in it. Got {str(index)[:40]}."
        )
    return items[index]


def _natural(value: object) -> int:
    if type(value) is not int or value < 0:
        raise ReadError(
            f"counts and offsets in a GLB file must be whole numbers from 0. Got {str(value)[:40]}."
        )
    return value


def _placed_meshes(document: dict[str, Any]) -> list[tuple[np.ndarray, int]]:
    """Return every mesh of the scene with its 4x4 placement.

    The standard has nodes form trees, so each is visited once: the work is bounded by the size of the file.
    """
    nodes = document.get("nodes", [])
    scenes = document.get("scenes")
    roots = _at(scenes, document.get("scene", 0)).get("nodes", []) if scenes else _parentless(nodes)
    placed, pending, seen = [], [(np.eye(4), root) for root in reversed(roots)], set()
    while pending:
        parent, index = pending.pop()
        node = _at(nodes, index)
        if index in seen:
            raise ReadError(
                f"the nodes of a GLB file must form trees. Got node {index} in two places."
            )
        seen.add(index)
        matrix = parent @ _local_matrix(node)
        if "mesh" in node:
            placed.append((matrix, node["mesh"]))
        pending.extend((matrix, child) for child in reversed(node.get("children", [])))
    return placed


def _parentless(nodes: list[dict[str, Any]]) -> list[int]:
    children = {child for node in nodes for child in node.get("children", [])}
    return [i for i in range(len(nodes)) if i not in children]


def _local_matrix(node: dict[str, Any]) -> np.ndarray:
    if "matrix" in node:
        matrix = _reals(node["matrix"], 16).reshape(4, 4).T
        if (matrix[3] != (0, 0, 0, 1)).any():
            raise ReadError(
                f"the matrix of a GLB node must end in 0, 0, 0, 1. Got {matrix[3].tolist()}."
            )
        return matrix
    x, y, z, w = rotation = _reals(node.get("rotation", (0.0, 0.0, 0.0, 1.0)), 4)
    if not abs(np.linalg.norm(rotation) - 1.0) <= _UNIT_LENGTH:
        raise ReadError(
            f"the rotation of a GLB node must be a unit quaternion. Got {rotation.tolist()}."
        )
    matrix = np.eye(4)
    matrix[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    matrix[:3, :3] *= _reals(node.get("scale", (1.0, 1.0, 1.0)), 3)
    matrix[:3, 3] = _reals(node.get("translation", (0.0, 0.0, 0.0)), 3)
    return matrix


def _reals(values: Any, n: int) -> np.ndarray:
    numbers = len(values) == n and all(
        type(value) in (int, float) and math.isfinite(value) for value in values
    )
    if not numbers:
        raise ReadError(
            f"the placement of a GLB node must be {n} finite numbers. Got {str(values)[:60]}."
        )
    return np.array(values, dtype=np.float64)


def _read_primitive(
    document: dict[str, Any], binary: bytes, primitive: dict[str, Any]
) -> tuple[np.ndarray, np.ndarray]:
    """Return views of the points (n, 3) and the triangles (t, 3) of a primitive."""
    mode = primitive.get("mode", _TRIANGLES)
    if type(mode) is not int or mode != _TRIANGLES:
        raise ReadError(
            f"the primitives of a GLB file must be triangles (mode 4). Got mode {str(mode)[:40]}."
        )
    points = _read_accessor(document, binary, primitive["attributes"]["POSITION"], "VEC3")
    if "indices" in primitive:
        corners = _read_accessor(document, binary, primitive["indices"], "SCALAR").ravel()
    else:
        corners = np.arange(len(points))
    if len(corners) % 3 or corners.max() >= len(points):
        raise ReadError(
            f"GLB indices must be triples below {len(points)}. Got {len(corners)} up to {corners.max()}."
        )
    return points, corners.reshape(-1, 3)


def _read_accessor(document: dict[str, Any], binary: bytes, index: int, kind: str) -> np.ndarray:
    accessor = _at(document["accessors"], index)
    if "sparse" in accessor or "bufferView" not in accessor:
        raise ReadError(f"GLB accessors must be plain. Got a sparse one, number {index}.")
    view = _at(document["bufferViews"], accessor["bufferView"])
    if _natural(view.get("buffer", 0)) != 0 or "uri" in document["buffers"][0]:
        raise ReadError(
            f"a GLB file must hold its own data. Got buffer view {accessor['bufferView']} elsewhere."
        )
    types, width = (_REAL_TYPES, 3) if kind == "VEC3" else (_INDEX_TYPES, 1)
    if accessor.get("type") != kind or accessor.get("componentType") not in types:
        raise ReadError(
            f"a GLB accessor must be {kind} of a legal component type. Got number {index}, which is not."
        )
    dtype = np.dtype(types[accessor["componentType"]])
    count, start = _natural(accessor["count"]), _natural(accessor.get("byteOffset", 0))
    size, offset = _natural(view["byteLength"]), _natural(view.get("byteOffset", 0))
    row = dtype.itemsize * width
    stride = _natural(view.get("byteStride", row))
    outside = start + (count - 1) * stride + row > size or offset + size > len(binary)
    if count < 1 or stride < row or outside:
        raise ReadError(
            f"GLB accessors must lie inside the binary chunk. Got number {index} outside."
        )
    return np.ndarray((count, width), dtype, binary, offset + start, (stride, dtype.itemsize))
