"""GLB files: binary glTF 2.0 with triangles, in the pose that its nodes state.

Read are instances (EXT_mesh_gpu_instancing), quantized coordinates (KHR_mesh_quantization), sparse accessors and morph
targets with their weights. Skins are refused, and so is what `extensions` does not know. Animations are left out.
"""

from __future__ import annotations

import json
import math
import struct
from typing import Any

import numpy as np

from aspectgraph.exceptions import ReadError
from aspectgraph.read.glb.accessors import Accessors, item_at
from aspectgraph.read.glb.extensions import check_extensions, unread_extensions
from aspectgraph.read.glb.placement import instance_matrices, local_matrix
from aspectgraph.read.limits import more_of

_TRIANGLES = 4


def parse_glb(
    data: bytes, notes: list[str], most_triangles: int = 5_000_000
) -> tuple[np.ndarray, np.ndarray]:
    """Return the vertices and triangles of the scene of a GLB file, in the file's unit (the standard says metres).

    Parameters
    ----------
    data : bytes
        The file.
    notes : list of str
        Extended by what was left out.
    most_triangles : int
        See `ReadLimits`. A mesh may be placed any number of times, so a small file can hold very many.

    Raises
    ------
    ReadError
        The file is cut off or malformed, holds no triangles or too many, has skins, or an extension that may change
        the shape and is not read.
    """
    try:
        document, binary = _split_chunks(data)
        needed = unread_extensions(document.get("extensionsRequired", []))
        if needed:
            raise ReadError(
                "a GLB file must do without extensions that may change the shape and are not read. "
                f"Got {', '.join(needed)[:80]}, which it requires."
            )
        check_extensions(document, "the whole file")
        n_animations = len(document.get("animations", []))
        if n_animations:
            notes.append(f"left out {n_animations} animations; the pose is the one the nodes state")
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
    vertices = []
    triangles = []
    n = n_triangles = 0
    accessors = Accessors(document, binary, 3 * most_triangles)
    for matrix, index in _placed_meshes(document):
        node = document["nodes"][index]
        parts = _read_mesh(document, accessors, node)
        for placement in instance_matrices(accessors, node, index, matrix):
            turned = np.linalg.det(placement[:3, :3]) < 0
            for points, corners in parts:
                n_triangles += len(corners)
                if n_triangles > most_triangles or n + len(points) > 3 * most_triangles:
                    raise ReadError.of_rule(
                        "",
                        f"a GLB file must place at most triangles={most_triangles} triangles",
                        "more",
                        **more_of("triangles"),
                    )
                vertices.append(points.astype(np.float64) @ placement[:3, :3].T + placement[:3, 3])
                corners = corners.astype(np.int64)
                triangles.append(n + (corners[:, ::-1] if turned else corners))
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


def _placed_meshes(document: dict[str, Any]) -> list[tuple[np.ndarray, int]]:
    """Return the number of every node of the scene that has a mesh, with its 4x4 placement.

    The standard has nodes form trees, so each is visited once: the work is bounded by the size of the file.
    """
    nodes = document.get("nodes", [])
    scenes = document.get("scenes")
    if scenes:
        scene = item_at(scenes, document.get("scene", 0))
        check_extensions(scene, f"scene {document.get('scene', 0)}")
        roots = scene.get("nodes", [])
    else:
        roots = _parentless(nodes)
    placed = []
    pending = [(np.eye(4), root) for root in reversed(roots)]
    seen = set()
    while pending:
        parent, index = pending.pop()
        node = item_at(nodes, index)
        if index in seen:
            raise ReadError(
                f"the nodes of a GLB file must form trees. Got node {index} in two places."
            )
        seen.add(index)
        check_extensions(node, f"node {index}")
        matrix = parent @ local_matrix(node)
        if "mesh" in node:
            _check_skin(node, index)
            placed.append((matrix, index))
        pending.extend((matrix, child) for child in reversed(node.get("children", [])))
    return placed


def _check_skin(node: dict[str, Any], index: int) -> None:
    if "skin" in node:
        raise ReadError(
            f"the meshes of a GLB file must have no skin, which bends them. Got skin {str(node['skin'])[:20]} "
            f"at node {index}; apply it and export the part again."
        )


def _parentless(nodes: list[dict[str, Any]]) -> list[int]:
    children = {child for node in nodes for child in node.get("children", [])}
    return [i for i in range(len(nodes)) if i not in children]


def _read_mesh(
    document: dict[str, Any], accessors: Accessors, node: dict[str, Any]
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return the points and triangles of every primitive of a node's mesh."""
    mesh = item_at(document["meshes"], node["mesh"])
    check_extensions(mesh, f"mesh {node['mesh']}")
    weights = node.get("weights", mesh.get("weights", []))
    parts = []
    for primitive in mesh["primitives"]:
        check_extensions(primitive, f"a primitive of mesh {node['mesh']}")
        points, corners = _read_primitive(accessors, primitive)
        parts.append((_morphed(points, accessors, primitive, weights), corners))
    return parts


def _read_primitive(
    accessors: Accessors, primitive: dict[str, Any]
) -> tuple[np.ndarray, np.ndarray]:
    """Return the points (n, 3) and the triangles (t, 3) of a primitive."""
    mode = primitive.get("mode", _TRIANGLES)
    if type(mode) is not int or mode != _TRIANGLES:
        raise ReadError(
            f"the primitives of a GLB file must be triangles (mode 4). Got mode {str(mode)[:40]}."
        )
    points = accessors.positions(primitive["attributes"]["POSITION"])
    corners = np.arange(len(points))
    if "indices" in primitive:
        corners = accessors.indices(primitive["indices"])
    if len(corners) % 3 or corners.max() >= len(points):
        raise ReadError(
            f"GLB indices must be triples below {len(points)}. Got {len(corners)} up to {corners.max()}."
        )
    return points, corners.reshape(-1, 3)


def _morphed(
    points: np.ndarray, accessors: Accessors, primitive: dict[str, Any], weights: list[Any]
) -> np.ndarray:
    """Return the points of a primitive with its morph targets added, each by its weight."""
    targets = primitive.get("targets", [])
    numbers = all(type(weight) in (int, float) and math.isfinite(weight) for weight in weights)
    if not numbers or (weights and len(weights) != len(targets)):
        raise ReadError(
            f"the weights of a GLB mesh must be a finite number for each of its {len(targets)} morph targets. "
            f"Got {str(weights)[:60]}."
        )
    for target, weight in zip(targets, weights, strict=False):
        if weight and "POSITION" in target:
            shifts = accessors.positions(target["POSITION"])
            if len(shifts) != len(points):
                raise ReadError(
                    f"a GLB morph target must move each of the {len(points)} points. Got {len(shifts)} shifts."
                )
            points = points.astype(np.float64) + float(weight) * shifts
    return points
