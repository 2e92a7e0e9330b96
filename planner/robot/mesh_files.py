"""Meshes of robots and of things in the cell: triangles as they are, closed or not."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from aspectgraph.exceptions import ReadError
from aspectgraph.read.obj_off import parse_obj, parse_off
from aspectgraph.read.ply import parse_ply
from aspectgraph.read.stl import parse_stl
from planner.exceptions import RobotError

_SUFFIXES = (".stl", ".obj", ".ply", ".off")


def read_triangles(path: Path, parameter: str) -> tuple[np.ndarray, np.ndarray]:
    """Return corners (v, 3) in the unit of a mesh file and triangles (t, 3).

    Parameters
    ----------
    path : Path
        A .stl, .obj, .ply or .off file.
    parameter : str
        What the caller calls it.

    Raises
    ------
    RobotError
        The file is missing, of another kind or damaged.
    """
    suffix = path.suffix.lower()
    if suffix not in _SUFFIXES:
        raise RobotError.of_rule(
            parameter, f"must be a mesh file ({', '.join(_SUFFIXES)})", repr(str(path))
        )
    try:
        data = path.read_bytes()
    except OSError as error:
        raise RobotError.of_rule(
            parameter, "must be a file that can be read", f"{str(path)!r}: {error.strerror}"
        ) from None
    try:
        vertices, polygons = _parse(data, suffix)
    except ReadError as error:
        raise RobotError.of_rule(parameter, "must be an intact mesh", f"{path}: {error}") from None
    if not len(polygons) or not np.isfinite(vertices).all():
        raise RobotError.of_rule(parameter, "must have facets with finite corners", str(path))
    triangles = [
        (polygon[0], polygon[i], polygon[i + 1])
        for polygon in polygons
        for i in range(1, len(polygon) - 1)
    ]
    corners, place = np.unique(vertices, axis=0, return_inverse=True)
    return corners, place.reshape(-1)[np.array(triangles, dtype=np.int64)]


def _parse(data: bytes, suffix: str) -> tuple[np.ndarray, list[list[int]] | np.ndarray]:
    """Return corners and polygons."""
    if suffix == ".stl":
        return parse_stl(data, [])
    if suffix == ".obj":
        return parse_obj(data, [])
    if suffix == ".ply":
        return parse_ply(data)
    return parse_off(data)
