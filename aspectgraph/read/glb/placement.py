"""Where a GLB file places its meshes: nodes and their instances."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from aspectgraph.exceptions import ReadError
from aspectgraph.read.glb.accessors import Accessors

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
