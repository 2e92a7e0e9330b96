"""GLB files: binary glTF 2.0 with triangles."""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from aspectgraph.exceptions import ReadError
from aspectgraph.files import more_of

# Extensions of glTF: those that leave the shape alone, those that are read, and all others, which
# are refused.
#
# An extension may change the shape whether or not the file *requires* it: writers list as
# required only what a viewer cannot show without. So an extension that is not known is refused
# wherever the shape comes from: the document, its scenes, nodes, meshes, primitives, accessors
# and buffers. On materials, textures, cameras and images it does no harm.


HARMLESS_EXTENSIONS = frozenset(
    {
        "ADOBE_materials_clearcoat_specular", "ADOBE_materials_clearcoat_tint",
        "ADOBE_materials_thin_transparency", "CESIUM_primitive_outline", "EXT_instance_features",
        "EXT_lights_ies", "EXT_lights_image_based", "EXT_mesh_features", "EXT_mesh_manifold",
        "EXT_structural_metadata", "EXT_texture_avif", "EXT_texture_webp", "KHR_animation_pointer",
        "KHR_lights_punctual", "KHR_node_hoverability", "KHR_node_selectability",
        "KHR_techniques_webgl", "KHR_texture_basisu", "KHR_texture_transform", "KHR_xmp",
        "KHR_xmp_json_ld", "MSFT_lod", "MSFT_packing_normalRoughnessMetallic",
        "MSFT_packing_occlusionRoughnessMetallic", "MSFT_texture_dds",
    }
)  # fmt: skip
"""Light, texture, metadata, and coarser copies beside the finest: the shape is the same without them."""

READ_EXTENSIONS = frozenset({"EXT_mesh_gpu_instancing", "KHR_mesh_quantization"})
"""Those that change the shape and are read."""

_MATERIAL_PREFIX = "KHR_materials_"


def check_extensions(thing: dict[str, Any], place: str) -> None:
    """Check that the extensions of a thing in a GLB document leave its shape alone, or are read.

    Parameters
    ----------
    thing : dict
        Anything with ``extensions``.
    place : str
        What to call it in messages.

    Raises
    ------
    ReadError
        One of them may change the shape.
    """
    unread = unread_extensions(thing.get("extensions", {}))
    if unread:
        raise ReadError(
            "a GLB file must do without extensions that may change the shape and are not read. "
            f"Got {unread[0][:60]} at {place}; export the part without it."
        )


def unread_extensions(names: Iterable[str]) -> list[str]:
    """Return the extensions that may change the shape and are not read."""
    return [
        name
        for name in map(str, names)
        if name not in HARMLESS_EXTENSIONS | READ_EXTENSIONS
        and not name.startswith(_MATERIAL_PREFIX)
    ]


# The numbers of a GLB file: accessors, plain and sparse, with their bounds checked.


_TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}
_FLOAT = 5126
_UNSIGNED = (5121, 5123, 5125)
_SMALL_INTEGERS = (5120, 5121, 5122, 5123)
_QUANTIZATION = "KHR_mesh_quantization"


def item_at(items: list[Any], index: int) -> Any:
    """Return an item of a list of the document; Python would take -1 and True as well.

    Raises
    ------
    ReadError
        There is no such item.
    """
    if type(index) is not int or not 0 <= index < len(items):
        raise ReadError(
            f"the numbers in a GLB file must be those of things in it. Got {str(index)[:40]}."
        )
    return items[index]


def as_natural(value: object) -> int:
    """Return a whole number from 0.

    Raises
    ------
    ReadError
        It is none.
    """
    if type(value) is not int or value < 0:
        raise ReadError(
            f"counts and offsets in a GLB file must be whole numbers from 0. Got {str(value)[:40]}."
        )
    return value


class Accessors:
    """The accessors of a GLB document.

    Parameters
    ----------
    document : dict
        The JSON chunk.
    binary : bytes
        The binary chunk.
    most_rows : int
        Most rows of an accessor without data of its own, whose rows are zeros and cost the file nothing.
    """

    def __init__(self, document: dict[str, Any], binary: bytes, most_rows: int) -> None:
        self.document = document
        self.binary = binary
        self.most_rows = most_rows
        self.quantized = _QUANTIZATION in document.get("extensionsUsed", [])

    def positions(self, index: int) -> np.ndarray:
        """Return points or displacements, shape (n, 3)."""
        types = (_FLOAT, *_SMALL_INTEGERS) if self.quantized else (_FLOAT,)
        return self._reals(index, "VEC3", types)

    def indices(self, index: int) -> np.ndarray:
        """Return vertex numbers, shape (n,)."""
        return self._values(index, "SCALAR", _UNSIGNED).ravel()

    def instance_vectors(self, index: int) -> np.ndarray:
        """Return translations or scales of instances, shape (n, 3)."""
        return self._reals(index, "VEC3", (_FLOAT,))

    def instance_rotations(self, index: int) -> np.ndarray:
        """Return quaternions of instances, shape (n, 4)."""
        return self._reals(index, "VEC4", (_FLOAT, 5120, 5122))

    def _reals(self, index: int, kind: str, types: tuple[int, ...]) -> np.ndarray:
        values = self._values(index, kind, types)
        if values.dtype.kind == "f" or not self._accessor(index).get("normalized", False):
            return values
        return np.maximum(values / float(np.iinfo(values.dtype).max), -1.0)

    def _accessor(self, index: int) -> dict[str, Any]:
        accessor: dict[str, Any] = item_at(self.document["accessors"], index)
        return accessor

    def _values(self, index: int, kind: str, types: tuple[int, ...]) -> np.ndarray:
        accessor = self._accessor(index)
        check_extensions(accessor, f"accessor {index}")
        component = accessor.get("componentType")
        if accessor.get("type") != kind or component not in types:
            raise ReadError(
                f"a GLB accessor must be {kind} of a legal component type. "
                f"Got number {index}, which is not."
            )
        dtype = np.dtype(_TYPES[component])
        count = as_natural(accessor["count"])
        if "bufferView" in accessor:
            rows = self._rows(accessor, index, count, dtype, _WIDTHS[kind])
        else:
            rows = self._zeros(index, count, dtype, _WIDTHS[kind])
        return self._substituted(accessor, index, rows) if "sparse" in accessor else rows

    def _zeros(self, index: int, count: int, dtype: np.dtype, width: int) -> np.ndarray:
        if not 1 <= count <= self.most_rows:
            raise ReadError(
                f"a GLB accessor without data must have 1 to {self.most_rows} rows. "
                f"Got number {index} with {count}."
            )
        return np.zeros((count, width), dtype)

    def _rows(
        self, source: dict[str, Any], index: int, count: int, dtype: np.dtype, width: int
    ) -> np.ndarray:
        """Return a view of the rows that an accessor, or a part of a sparse one, has in the binary chunk."""
        view = item_at(self.document["bufferViews"], source["bufferView"])
        check_extensions(view, f"buffer view {source['bufferView']}")
        check_extensions(item_at(self.document["buffers"], 0), "buffer 0")
        if as_natural(view.get("buffer", 0)) != 0 or "uri" in self.document["buffers"][0]:
            raise ReadError(
                "a GLB file must hold its own data. "
                f"Got buffer view {source['bufferView']} elsewhere."
            )
        start = as_natural(source.get("byteOffset", 0))
        size = as_natural(view["byteLength"])
        offset = as_natural(view.get("byteOffset", 0))
        row = dtype.itemsize * width
        stride = as_natural(view.get("byteStride", row))
        outside = start + (count - 1) * stride + row > size or offset + size > len(self.binary)
        if count < 1 or stride < row or outside:
            raise ReadError(
                f"GLB accessors must lie inside the binary chunk. Got number {index} outside."
            )
        strides = (stride, dtype.itemsize)
        return np.ndarray((count, width), dtype, self.binary, offset + start, strides)

    def _substituted(self, accessor: dict[str, Any], index: int, rows: np.ndarray) -> np.ndarray:
        """Return the rows of a sparse accessor: those of its base, some of them replaced."""
        sparse = accessor["sparse"]
        count = as_natural(sparse["count"])
        component = sparse["indices"]["componentType"]
        if component not in _UNSIGNED:
            raise ReadError(
                "the indices of a sparse GLB accessor must be of a legal component type. "
                f"Got number {index}, whose are not."
            )
        for part in (sparse, sparse["indices"], sparse["values"]):
            check_extensions(part, f"accessor {index}")
        places = self._rows(sparse["indices"], index, count, np.dtype(_TYPES[component]), 1).ravel()
        values = self._rows(sparse["values"], index, count, rows.dtype, rows.shape[1])
        ascending = (places[1:] > places[:-1]).all()
        if not ascending or int(places[-1]) >= len(rows):
            raise ReadError(
                f"the indices of a sparse GLB accessor must ascend and be below {len(rows)}. "
                f"Got number {index}, whose do not."
            )
        whole = rows.copy()
        whole[places] = values
        return whole


# Where a GLB file places its meshes: nodes and their instances.


INSTANCING = "EXT_mesh_gpu_instancing"

_INSTANCE_ATTRIBUTES = ("TRANSLATION", "ROTATION", "SCALE")
_UNIT_LENGTH = 1e-3
"""How far the length of a rotation's quaternion may be from one."""

_ROUNDED_UNIT_LENGTH = 0.02
"""Likewise of instances, whose numbers may be rounded to a byte: four of them, by 1/254 each."""


def local_matrix(node: dict[str, Any]) -> np.ndarray:
    """Return the 4x4 placement of a node relative to its parent.

    Raises
    ------
    ReadError
        It is no placement.
    """
    if "matrix" in node:
        matrix = _reals(node["matrix"], 16).reshape(4, 4).T
        if (matrix[3] != (0, 0, 0, 1)).any():
            raise ReadError(
                f"the matrix of a GLB node must end in 0, 0, 0, 1. Got {matrix[3].tolist()}."
            )
        return matrix
    rotation = _reals(node.get("rotation", (0.0, 0.0, 0.0, 1.0)), 4)
    if not abs(np.linalg.norm(rotation) - 1.0) <= _UNIT_LENGTH:
        raise ReadError(
            f"the rotation of a GLB node must be a unit quaternion. Got {rotation.tolist()}."
        )
    scale = _reals(node.get("scale", (1.0, 1.0, 1.0)), 3)
    translation = _reals(node.get("translation", (0.0, 0.0, 0.0)), 3)
    return _compose(translation, rotation, scale)


def instance_matrices(
    accessors: Accessors, node: dict[str, Any], index: int, matrix: np.ndarray
) -> Iterator[np.ndarray]:
    """Go through the 4x4 placements of a node's mesh: one, or one for each instance.

    Parameters
    ----------
    accessors : Accessors
        Those of the document.
    node : dict
        A node with a mesh.
    index : int
        Its number, for messages.
    matrix : ndarray, shape (4, 4)
        Placement of the node.

    Raises
    ------
    ReadError
        The attributes of the instances do not fit together, or are not known.
    """
    instancing = node.get("extensions", {}).get(INSTANCING)
    if instancing is None:
        yield matrix
        return
    attributes = instancing["attributes"]
    # names that begin with an underscore, and colours, are for the shader of the program that wrote them
    unknown = [
        name
        for name in attributes
        if name not in _INSTANCE_ATTRIBUTES and not name.startswith(("_", "COLOR_"))
    ]
    if unknown:
        raise ReadError(
            f"the instances of a GLB node must have {', '.join(_INSTANCE_ATTRIBUTES)}. "
            f"Got {unknown[0][:40]} at node {index}."
        )
    columns = {}
    for name in _INSTANCE_ATTRIBUTES:
        if name in attributes:
            read = accessors.instance_vectors
            if name == "ROTATION":
                read = accessors.instance_rotations
            columns[name] = read(attributes[name])
    counts = {len(column) for column in columns.values()}
    if len(counts) != 1:
        raise ReadError(
            "the attributes of a GLB node's instances must have one count. "
            f"Got {sorted(counts)} at node {index}."
        )
    rotations = _unit_rotations(columns.get("ROTATION"), index)
    for k in range(counts.pop()):
        translation = columns["TRANSLATION"][k] if "TRANSLATION" in columns else np.zeros(3)
        rotation = np.array((0.0, 0.0, 0.0, 1.0)) if rotations is None else rotations[k]
        scale = columns["SCALE"][k] if "SCALE" in columns else np.ones(3)
        yield matrix @ _compose(translation, rotation, scale)


def _unit_rotations(quaternions: np.ndarray | None, index: int) -> np.ndarray | None:
    """Return quaternions made unit: those of a file are rounded, to single precision or to a byte."""
    if quaternions is None:
        return None
    lengths = np.linalg.norm(quaternions.astype(np.float64), axis=1)
    wrong = np.flatnonzero(~(np.abs(lengths - 1.0) <= _ROUNDED_UNIT_LENGTH))
    if len(wrong):
        raise ReadError(
            "the rotations of a GLB node's instances must be unit quaternions. "
            f"Got {quaternions[wrong[0]].tolist()} at node {index}."
        )
    return quaternions / lengths[:, None]


def _compose(translation: np.ndarray, rotation: np.ndarray, scale: np.ndarray) -> np.ndarray:
    x, y, z, w = rotation
    matrix = np.eye(4)
    matrix[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    matrix[:3, :3] *= scale
    matrix[:3, 3] = translation
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


# GLB files: binary glTF 2.0 with triangles, in the pose that its nodes state.
#
# Read are instances (EXT_mesh_gpu_instancing), quantized coordinates (KHR_mesh_quantization),
# sparse accessors and morph targets with their weights. Skins are refused, and so is what
# `extensions` does not know. Animations are left out.


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
                        f"a GLB file must have at most triangles={most_triangles} triangles",
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
                f"the nodes of a GLB file must form trees. Got node {index} as a child of two nodes."
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
