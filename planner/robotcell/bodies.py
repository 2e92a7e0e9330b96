"""Solid bodies: convex hulls of links, boxes and meshes, each covered by a few spheres.

A mesh has no inside: what is small enough lies within a link unnoticed. So links, the camera and boxes are convex
hulls, which do have one. Obstacles given as meshes keep their shape, and their inside is asked for by a distance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull, HalfspaceIntersection, QhullError

from aspectgraph.exceptions import ReadError
from aspectgraph.read.mesh import parse_obj, parse_off, parse_ply, parse_stl
from planner.argument_kinds import shown
from planner.exceptions import RobotError
from planner.robotcell.urdf import carry, check_pose

_SUFFIXES = (".stl", ".obj", ".ply", ".off")
_SLICES = 5
# a body this much longer than wide is covered by one more sphere
_SLIM = 0.6
_ROUND = 24
_FEW_SIDES = 60


@dataclass(frozen=True, eq=False)
class Box:
    """A box, axis-parallel in its own frame.

    Parameters
    ----------
    low, high : sequence of float
        Opposite corners (3,), mm.
    pose : array (4, 4), optional
        The box's frame in the frame of what it belongs to. Default: the same.

    Raises
    ------
    RobotError
        If `low` is not below `high` in every coordinate, or `pose` is no rigid motion.

    Examples
    --------
    >>> from planner import Box
    >>> Box((0, 0, -20), (800, 600, 0)).corners().shape
    (8, 3)
    """

    low: Sequence[float]
    high: Sequence[float]
    pose: np.ndarray = field(default_factory=lambda: np.eye(4))

    def __post_init__(self) -> None:
        corners = []
        for name in ("low", "high"):
            value = getattr(self, name)
            try:
                corner = tuple(float(number) for number in value)
            except (TypeError, ValueError):
                corner = ()
            if len(corner) != 3 or not np.isfinite(corner).all():
                raise RobotError.of_rule(name, "must be three finite numbers", shown(value))
            corners.append(corner)
        low, high = corners
        if not all(a < b for a, b in zip(low, high, strict=True)):
            raise RobotError.of_rule(
                "low", "must be below high in every coordinate", f"{low} and {high}"
            )
        object.__setattr__(self, "low", low)
        object.__setattr__(self, "high", high)
        object.__setattr__(self, "pose", check_pose("pose", self.pose))

    def corners(self) -> np.ndarray:
        """Return the corners.

        Returns
        -------
        array, shape (8, 3)
            In the frame of what the box belongs to, mm.
        """
        sides = np.array([self.low, self.high])
        every = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
        return carry(self.pose, sides[every, np.arange(3)])


Body = Box | str | PathLike[str] | tuple[Any, Any]
"""A box, a mesh file in mm, or corners (v, 3) and triangles (t, 3)."""


@dataclass(frozen=True, eq=False)
class Hull:
    """A convex solid.

    Attributes
    ----------
    corners : array (v, 3)
        Its corners, mm.
    triangles : array of int (t, 3)
        Its surface, counter-clockwise from outside.
    centres, radii : array (s, 3), (s,)
        Spheres that cover it.
    """

    corners: np.ndarray
    triangles: np.ndarray
    centres: np.ndarray
    radii: np.ndarray


def hull_of(points: np.ndarray, parameter: str) -> Hull:
    """Return the convex hull of points (n, 3), or raise `RobotError` if it is flat."""
    try:
        found = ConvexHull(points)
    except (QhullError, ValueError):
        raise RobotError.of_rule(
            parameter, "must be a solid with a volume", f"{len(points)} points in a plane"
        ) from None
    numbers = np.sort(found.vertices)
    place = np.zeros(len(points), dtype=np.int64)
    place[numbers] = np.arange(len(numbers))
    corners = points[numbers]
    triangles = place[found.simplices]
    normals = found.equations[:, :3]
    sides = corners[triangles]
    turned = np.cross(sides[:, 1] - sides[:, 0], sides[:, 2] - sides[:, 0])
    inward = (turned * normals).sum(axis=1) < 0
    triangles[inward] = triangles[inward][:, ::-1]
    centres, radii = _covering_spheres(corners, triangles)
    return Hull(corners, triangles, centres, radii)


def grown(hull: Hull, mm: float) -> Hull:
    """Return a hull that contains all points up to a distance from another one, and few more."""
    signs = np.array([[x, y, z] for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1)])
    directions = np.delete(signs, 13, axis=0).astype(np.float64)
    sides = hull.corners[hull.triangles]
    normals = np.cross(sides[:, 1] - sides[:, 0], sides[:, 2] - sides[:, 0])
    if len(normals) <= _FEW_SIDES:
        directions = np.concatenate([normals, directions])
    else:
        directions = np.concatenate([round_points(1.0, 0.0), directions])
    directions /= np.sqrt((directions**2).sum(axis=1, keepdims=True))
    heights = np.einsum("dj,cj->dc", directions, hull.corners).max(axis=1) + mm
    planes = np.concatenate([directions, -heights[:, None]], axis=1)
    return hull_of(HalfspaceIntersection(planes, hull.corners.mean(axis=0)).intersections, "body")


def _covering_spheres(corners: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return spheres that cover a hull: one for each slice across its longest side."""
    low = corners.min(axis=0)
    extent = corners.max(axis=0) - low
    axis = int(extent.argmax())
    width = float(np.sort(extent)[1])
    count = int(min(_SLICES, max(1.0, np.ceil(_SLIM * extent[axis] / max(width, 1e-9)))))
    borders = low[axis] + extent[axis] * np.arange(count + 1) / count
    starts = corners[triangles].reshape(-1, 3)
    ends = corners[np.roll(triangles, -1, axis=1)].reshape(-1, 3)
    centres = []
    radii = []
    for below, above in pairwise(borders):
        points = [corners[(corners[:, axis] >= below) & (corners[:, axis] <= above)]]
        for border in (below, above):
            first = starts[:, axis] - border
            last = ends[:, axis] - border
            crosses = first * last < 0
            share = (first[crosses] / (first[crosses] - last[crosses]))[:, None]
            points.append(starts[crosses] + share * (ends - starts)[crosses])
        slab = np.concatenate(points)
        centre = (slab.min(axis=0) + slab.max(axis=0)) / 2
        centres.append(centre)
        radii.append(np.sqrt(((slab - centre) ** 2).sum(axis=1)).max())
    # what was computed of borders and corners is good to the last digits only
    return np.array(centres), np.array(radii) * (1 + 1e-9) + 1e-9


@dataclass(frozen=True, eq=False)
class Surface:
    """A body that keeps its shape.

    Attributes
    ----------
    corners : array (v, 3)
        Corners, mm.
    triangles : array of int (t, 3)
        Its triangles.
    closed : bool
        Whether they enclose a volume, so that something can be inside.
    """

    corners: np.ndarray
    triangles: np.ndarray
    closed: bool


def surface_of(corners: np.ndarray, triangles: np.ndarray) -> Surface:
    """Return a surface; it is closed if each side runs once in each direction."""
    pairs = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2).reshape(-1, 2)
    there = {(int(a), int(b)) for a, b in pairs}
    closed = len(there) == len(pairs) and all((b, a) in there for a, b in there)
    return Surface(corners, triangles, closed)


def mesh_of(body: Body, parameter: str) -> tuple[np.ndarray, np.ndarray]:
    """Return corners (v, 3) in mm and triangles (t, 3) of a body that is no box.

    Raises
    ------
    RobotError
        A file cannot be read, or arrays are no triangles.
    """
    if isinstance(body, str | PathLike):
        return read_triangles(Path(body), parameter)
    try:
        given, faces = body  # type: ignore[misc]
        corners = np.array(given, dtype=np.float64)
        triangles = np.array(faces, dtype=np.int64)
    except (TypeError, ValueError):
        rule = "must be a Box, a mesh file, or corners and triangles"
        raise RobotError.of_rule(parameter, rule, shown(body)) from None
    shapes = corners.ndim == triangles.ndim == 2 and corners.shape[1] == triangles.shape[1] == 3
    if not shapes or not len(triangles) or not np.isfinite(corners).all():
        rule = "must have corners (v, 3) that are finite and triangles (t, 3)"
        raise RobotError.of_rule(parameter, rule, f"{corners.shape} and {triangles.shape}")
    if triangles.min() < 0 or triangles.max() >= len(corners):
        raise RobotError.of_rule(
            parameter, "must number its corners from 0", f"{int(triangles.max())} of {len(corners)}"
        )
    return corners, triangles


def round_points(radius: float, length: float) -> np.ndarray:
    """Return points whose hull contains a cylinder along z about the origin, or a ball if the length is 0; mm."""
    turns = 2 * np.pi * np.arange(_ROUND) / _ROUND
    outer = radius / np.cos(np.pi / _ROUND)
    ring = np.stack([outer * np.cos(turns), outer * np.sin(turns), np.zeros(_ROUND)], axis=1)
    if length > 0:
        shift = np.array([0.0, 0.0, length / 2])
        return np.concatenate([ring - shift, ring + shift])
    tilts = np.pi * (np.arange(_ROUND // 2 + 1) / (_ROUND // 2) - 0.5)
    points = np.array(
        [
            [np.cos(tilt) * np.cos(turn), np.cos(tilt) * np.sin(turn), np.sin(tilt)]
            for tilt in tilts
            for turn in turns
        ]
    )
    points = np.unique(np.round(points, 12), axis=0)
    nearest = -ConvexHull(points).equations[:, 3].max()
    return radius / nearest * points


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
