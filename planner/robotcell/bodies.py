"""Solid bodies: convex hulls of links, boxes and meshes; and what stands still: obstacles, the part, its fixturings.

A mesh has no inside: what is small enough lies within a link unnoticed. So links, the camera and boxes are convex
hulls, which do have one. Obstacles given as meshes keep their shape, and their inside is asked for by a distance.
Each hull is covered by a few spheres.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import ConvexHull, HalfspaceIntersection, QhullError

from aspectgraph.exceptions import ReadError
from aspectgraph.read.mesh import parse_obj, parse_off, parse_ply, parse_stl
from aspectgraph.solid.solid import RayScene
from ground.short_repr import short_repr
from planner.argument_kinds import POSITIVE, check_number, shown
from planner.exceptions import RobotError
from planner.robotcell.branches import needed
from planner.robotcell.urdf import carry, check_pose, compose, invert

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

    __repr__ = short_repr

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
        qhull = ConvexHull(points)
    except (QhullError, ValueError):
        raise RobotError.of_rule(
            parameter, "must be a solid with a volume", f"{len(points)} points in a plane"
        ) from None
    numbers = np.sort(qhull.vertices)
    place = np.zeros(len(points), dtype=np.int64)
    place[numbers] = np.arange(len(numbers))
    corners = points[numbers]
    triangles = place[qhull.simplices]
    normals = qhull.equations[:, :3]
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
        vertices, faces = body  # type: ignore[misc]
        corners = np.array(vertices, dtype=np.float64)
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


# A turntable: an axis in the base of the robot, the angles at which images are taken, and how
# fast it turns.


_MOST_ANGLES = 360
DEFAULT_ANGLES = 24


@dataclass(frozen=True, eq=False)
class Turntable:
    """An axis that carries the part.

    Attributes
    ----------
    point, direction : array (3,)
        A point of the axis in the base, mm, and its direction, a unit vector.
    angles : tuple of float
        Angles at which images may be taken, rad; 0 is where ``part2base`` holds. The nearest to 0 come first.
    speed, acceleration : float
        Largest ones, rad/s and rad/s².
    """

    point: np.ndarray
    direction: np.ndarray
    angles: tuple[float, ...]
    speed: float
    acceleration: float

    @classmethod
    def checked(
        cls, axis: Any, angles: Any, turn_speed: float, turn_acceleration: float
    ) -> Turntable:
        """Return a turntable, or raise `RobotError` that names the argument of `Fixturing`.

        Raises
        ------
        RobotError
            An argument breaks its rule.
        """
        point, direction = _axis(axis)
        return cls(
            point,
            direction,
            _angles(DEFAULT_ANGLES if angles is None else angles),
            check_number("turn_speed", turn_speed, POSITIVE),
            check_number("turn_acceleration", turn_acceleration, POSITIVE),
        )

    def pose(self, angle: float) -> np.ndarray:
        """Return the motion (4, 4) of what turns by an angle, mm; exactly the identity at 0."""
        x, y, z = self.direction
        across = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        twice = np.einsum("ij,jk->ik", across, across)
        result = np.eye(4)
        result[:3, :3] += math.sin(angle) * across + (1.0 - math.cos(angle)) * twice
        result[:3, 3] = self.point - np.einsum("ij,j->i", result[:3, :3], self.point)
        return result

    def moved(self, motion: np.ndarray) -> Turntable:
        """Return the same turntable elsewhere in the base, by a motion (4, 4)."""
        point = np.einsum("ij,j->i", motion[:3, :3], self.point) + motion[:3, 3]
        direction = np.einsum("ij,j->i", motion[:3, :3], self.direction)
        return Turntable(point, direction, self.angles, self.speed, self.acceleration)

    def radius_mm(self, points: np.ndarray) -> float:
        """Return the largest distance of points (n, 3) of the base from the axis."""
        apart = points - self.point
        along = np.einsum("ni,i->n", apart, self.direction)
        across = apart - along[:, None] * self.direction
        return float(np.sqrt((across**2).sum(axis=1)).max())

    @property
    def range(self) -> tuple[float, float]:
        """The least and the largest angle of all moves, rad: programs begin and end at 0."""
        return min(0.0, *self.angles), max(0.0, *self.angles)

    @property
    def numbers(self) -> tuple[Any, ...]:
        """Everything that decides what is reached, as plain values."""
        return (
            self.point.tolist(),
            self.direction.tolist(),
            self.angles,
            self.speed,
            self.acceleration,
        )


def _axis(axis: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return a point and a unit vector."""
    rule = "must be a point in mm and a direction, each of three finite numbers"
    try:
        point, direction = (np.array(vector, dtype=np.float64) for vector in axis)
    except (TypeError, ValueError):
        raise RobotError.of_rule("axis", rule, shown(axis)) from None
    if point.shape != (3,) or direction.shape != (3,):
        raise RobotError.of_rule("axis", rule, shown(axis))
    if not (np.isfinite(point).all() and np.isfinite(direction).all()):
        raise RobotError.of_rule("axis", rule, shown(axis))
    length = float(np.sqrt((direction**2).sum()))
    if length == 0.0:
        raise RobotError.of_rule("axis", "must have a direction other than 0", shown(axis))
    return point, direction / length


def _angles(given: Any) -> tuple[float, ...]:
    """Return angles, the nearest to 0 first."""
    rule = f"must be a number from 1 to {_MOST_ANGLES} or a list of so many angles within a turn"
    if isinstance(given, int | np.integer) and not isinstance(given, bool):
        if not 1 <= given <= _MOST_ANGLES:
            raise RobotError.of_rule("angles", rule, shown(given))
        steps = np.arange(given)
        steps[steps > given // 2] -= given
        values = (2.0 * math.pi / int(given) * steps).tolist()
    else:
        values = _listed(given, rule)
    return tuple(sorted(values, key=lambda angle: (round(abs(angle), 9), -angle)))


def _listed(given: Any, rule: str) -> list[float]:
    if not isinstance(given, Sequence | np.ndarray) or isinstance(given, str):
        raise RobotError.of_rule("angles", rule, shown(given))
    try:
        values = [float(angle) for angle in given]
    except (TypeError, ValueError):
        raise RobotError.of_rule("angles", rule, shown(given)) from None
    within = all(math.isfinite(value) and abs(value) <= 2.0 * math.pi for value in values)
    if not 1 <= len(values) <= _MOST_ANGLES or not within:
        hint = "are they in degrees?" if values and not within else ""
        raise RobotError.of_rule("angles", rule, shown(given), hint=hint)
    if len(set(values)) < len(values):
        raise RobotError.of_rule("angles", "must differ from each other", shown(given))
    return values


SKIN_MM = 1.0
"""Depth up to which a part may sink into what it lies on, and to which that hides nothing."""

_POINTS = 17
# triangles of a surface at whose corners and centres its depth in another body is taken
_SAMPLES = 8_000


@dataclass(frozen=True, eq=False)
class Fixturing:
    """One way the part lies in the cell, on a table that stands still or that turns.

    Parameters
    ----------
    part2base : array_like, shape (4, 4)
        The part's frame in the robot's base, mm; on a turntable at the angle 0.
    obstacles : mapping of str to Box, path or (corners, triangles)
        What comes with it, such as a table or a clamp, in the base frame, mm. It stands still.
    axis : (point, direction), optional
        Of a turntable that carries the part: a point of the axis in the base, mm, and the direction
        of the axis. Positive angles are right-handed. Default: the part does not turn.
    angles : int or sequence of float, optional
        With `axis`, the angles at which images may be taken: so many, spread over a turn, or a list
        in rad. Default: 24.
    turning : mapping of str to Box, path or (corners, triangles)
        With `axis`, what turns with the part, such as the plate or a clamp, in the base frame at
        the angle 0, mm.
    turn_speed, turn_acceleration : float
        With `axis`, the largest ones of the turntable, rad/s and rad/s².

    Raises
    ------
    RobotError
        If `part2base` is no rigid motion, or a number of the turntable breaks its rule.

    Examples
    --------
    >>> from planner import Box, Fixturing
    >>> part2base = [[1, 0, 0, 600], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
    >>> up = Fixturing(part2base, {"table": Box((300, -500, -50), (900, 500, 0))})
    >>> list(up.obstacles)
    ['table']
    >>> turning = Fixturing(part2base, axis=((600, 0, 0), (0, 0, 1)), angles=4)
    >>> turning.at(turning.angles[1]).part2base.round(6).tolist()[0]
    [0.0, -1.0, 0.0, 600.0]
    """

    part2base: np.ndarray
    obstacles: Mapping[str, Body] = field(default_factory=dict)
    axis: Any = None
    angles: Any = None
    turning: Mapping[str, Body] = field(default_factory=dict)
    turn_speed: float = 0.5
    turn_acceleration: float = 0.5

    __repr__ = short_repr

    def __post_init__(self) -> None:
        object.__setattr__(self, "part2base", check_pose("part2base", self.part2base))
        object.__setattr__(self, "obstacles", dict(self.obstacles))
        object.__setattr__(self, "turning", dict(self.turning))
        table = self._checked_table()
        object.__setattr__(self, "_table", table)
        object.__setattr__(self, "angles", (0.0,) if table is None else table.angles)

    def _checked_table(self) -> Turntable | None:
        if self.axis is not None:
            return Turntable.checked(
                self.axis, self.angles, self.turn_speed, self.turn_acceleration
            )
        for name in ("angles", "turning"):
            value = getattr(self, name)
            if value and value != (0.0,):
                raise RobotError.of_rule(name, "must be given with axis only", shown(value))
        return None

    @property
    def table(self) -> Turntable | None:
        """The turntable; None if the part stands still."""
        return vars(self)["_table"]

    def at(self, angle: float) -> Fixturing:
        """Return the fixturing as it stands at an angle of its turntable, without a turntable.

        Parameters
        ----------
        angle : float
            Angle, rad.

        Returns
        -------
        Fixturing
            What turns with the part is among its obstacles.
        """
        if self.table is None:
            return self
        motion = self.table.pose(angle)
        turned = {name: _moved(name, body, motion) for name, body in self.turning.items()}
        return Fixturing(compose(motion, self.part2base), {**self.obstacles, **turned})

    def moved(self, motion: np.ndarray) -> Fixturing:
        """Return the same fixturing, moved in the base.

        Parameters
        ----------
        motion : array, shape (4, 4)
            The motion, mm.

        Returns
        -------
        Fixturing
            With its obstacles and its turntable moved, too.
        """
        obstacles = {name: _moved(name, body, motion) for name, body in self.obstacles.items()}
        part2base = compose(motion, self.part2base)
        if self.table is None:
            return Fixturing(part2base, obstacles)
        table = self.table.moved(motion)
        return Fixturing(
            part2base,
            obstacles,
            axis=(table.point, table.direction),
            angles=table.angles,
            turning={name: _moved(name, body, motion) for name, body in self.turning.items()},
            turn_speed=table.speed,
            turn_acceleration=table.acceleration,
        )


@dataclass(frozen=True, eq=False)
class Grip:
    """One way the robot holds the part before a camera that stands still, for a `HeldPartCell`.

    Parameters
    ----------
    part2flange : array_like, shape (4, 4)
        The part's frame in the robot's tip, mm.
    gripper : mapping of str to Box, path or (corners, triangles)
        What holds the part, in the frame of the tip, mm. Each counts as its convex hull. It may hide
        targets.

    Raises
    ------
    RobotError
        If `part2flange` is no rigid motion.

    Examples
    --------
    >>> from planner import Box, Grip
    >>> part2flange = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 80], [0, 0, 0, 1]]
    >>> list(Grip(part2flange, {"jaws": Box((-40, -20, 0), (40, 20, 80))}).gripper)
    ['jaws']
    """

    part2flange: np.ndarray
    gripper: Mapping[str, Body] = field(default_factory=dict)

    table = None
    angles = (0.0,)

    __repr__ = short_repr

    def __post_init__(self) -> None:
        object.__setattr__(self, "part2flange", check_pose("part2flange", self.part2flange))
        object.__setattr__(self, "gripper", dict(self.gripper))


class Standing:
    """A body that stands still in a fixturing: an obstacle or the part.

    Parameters
    ----------
    name : str
        Its name.
    pose : array (4, 4)
        Its frame in the base, mm.
    shape : Hull or Surface
        Its shape in its frame.
    geometry : fcl geometry
        The same for fcl, where it has been made before.
    """

    def __init__(
        self, name: str, pose: np.ndarray, shape: Hull | Surface, geometry: Any = None
    ) -> None:
        self.name = name
        self.pose = pose
        self.shape = shape
        self.low = shape.corners.min(axis=0)
        self.high = shape.corners.max(axis=0)
        self.geometry = geometry_of(shape) if geometry is None else geometry
        self.placed = needed("fcl").CollisionObject(self.geometry, transform_of(pose))
        self._inverse = invert(pose)
        self._scenes: list[RayScene] = []

    def at(self, pose: np.ndarray) -> Standing:
        """Return the same body elsewhere; its geometry is shared."""
        moved = Standing(self.name, pose, self.shape, self.geometry)
        moved._scenes = self._scenes
        return moved

    def distance_bound(self, points: np.ndarray) -> np.ndarray:
        """Return lower bounds (...) of the distance of points (..., 3) of the base, by the box about the body."""
        turned = np.einsum("ij,...j->...i", self._inverse[:3, :3], points) + self._inverse[:3, 3]
        outside = np.maximum(np.maximum(self.low - turned, turned - self.high), 0.0)
        return np.sqrt((outside**2).sum(axis=-1))

    def holds(self, point: np.ndarray) -> bool:
        """Return whether a point (3,) of the base is inside a closed surface."""
        if isinstance(self.shape, Hull) or not self.shape.closed:
            return False
        turned = self._inverse[:3, :3] @ point + self._inverse[:3, 3]
        if (turned < self.low).any() or (turned > self.high).any():
            return False
        return bool(self._rays().signed_distance(turned[None])[0] < 0)

    def hides(self, eyes: np.ndarray, segments: np.ndarray) -> np.ndarray:
        """Return which segments (s, 2, 3) the body hides from eyes (n, 3), in the base, mm; (n, s) bool.

        A segment is hidden if a part of the triangle between it and the eye is inside the body, by more than
        `SKIN_MM`: a part lies on a table, and edges below it are not hidden by that.
        """
        eyes = carry(self._inverse, eyes)
        ends = carry(self._inverse, segments.reshape(-1, 3)).reshape(-1, 2, 3)
        if isinstance(self.shape, Hull):
            return _cut_by_box(eyes, ends, self.low + SKIN_MM, self.high - SKIN_MM)
        shares = np.linspace(0.0, 1.0, _POINTS)[:, None]
        points = ends[:, None, 0] + shares * (ends[:, 1] - ends[:, 0])[:, None]
        rays = points[None] - eyes[:, None, None]
        lengths = np.sqrt((rays**2).sum(axis=-1))
        # as far as to shortly before the point
        rays *= np.maximum(1.0 - SKIN_MM / np.maximum(lengths, SKIN_MM), 0.0)[..., None]
        origins = np.broadcast_to(eyes[:, None, None], rays.shape)
        return np.asarray(self._rays().blocked(origins, rays).any(axis=-1))

    def _rays(self) -> RayScene:
        if not self._scenes:
            self._scenes.append(RayScene(self.shape.corners, self.shape.triangles, n_threads=1))
        return self._scenes[0]

    def depth_of(self, other: Standing, least_mm: float = 0.0, enough_mm: float = np.inf) -> float:
        """Return how deep the surface of another body is inside this one at its deepest, mm; 0 if nowhere.

        Depths up to `least_mm` may be told as less. Beyond `enough_mm` any depth that was found will do.
        """
        if not isinstance(self.shape, Hull) and not self.shape.closed:
            return 0.0
        corners = carry(self._inverse, carry(other.pose, other.shape.corners))
        depth = 0.0
        # what is near the box about the body is near its surface, too
        low = self.low + least_mm
        high = self.high - least_mm
        for points in _finer_points(corners[other.shape.triangles], low, high):
            depth = max(depth, self._deepest(points))
            if depth > enough_mm:
                break
        return depth

    def _deepest(self, points: np.ndarray) -> float:
        """Return how deep the deepest of points (n, 3) in the own frame is inside, mm; negative outside."""
        if not isinstance(self.shape, Hull):
            return float(-self._rays().signed_distance(points).min())
        sides = self.shape.corners[self.shape.triangles]
        normals = np.cross(sides[:, 1] - sides[:, 0], sides[:, 2] - sides[:, 0])
        normals /= np.sqrt((normals**2).sum(axis=1, keepdims=True))
        heights = np.full(len(points), -np.inf)
        for normal, corner in zip(normals, sides[:, 0], strict=True):
            np.maximum(heights, np.einsum("nj,j->n", points - corner, normal), out=heights)
        return float(-heights.min())


class StandingBoxes(NamedTuple):
    """The boxes about bodies that stand still.

    Attributes
    ----------
    turns, shifts : array (b, 3, 3), (b, 3)
        From the base to the frame of each body, mm.
    lows, highs : array (b, 3)
        The box about each in its frame, mm.
    """

    turns: np.ndarray
    shifts: np.ndarray
    lows: np.ndarray
    highs: np.ndarray

    @classmethod
    def of(cls, bodies: Sequence[Standing]) -> StandingBoxes:
        """Return those of bodies."""
        inverses = np.array([invert(body.pose) for body in bodies]).reshape(-1, 4, 4)
        lows = np.array([body.low for body in bodies]).reshape(-1, 3)
        highs = np.array([body.high for body in bodies]).reshape(-1, 3)
        turns = np.ascontiguousarray(inverses[:, :3, :3])
        return cls(turns, np.ascontiguousarray(inverses[:, :3, 3]), lows, highs)

    def distance_bounds(self, points: np.ndarray) -> np.ndarray:
        """Return lower bounds (n, b, s) of the distances of points (n, s, 3) of the base from each body, mm."""
        turned = np.einsum("bij,nsj->nbsi", self.turns, points) + self.shifts[:, None]
        lows = self.lows[:, None]
        highs = self.highs[:, None]
        outside = np.maximum(np.maximum(lows - turned, turned - highs), 0.0)
        return np.asarray(np.sqrt((outside**2).sum(axis=-1)))


def sunk_mm(
    first: Standing, second: Standing, least_mm: float = 0.0, enough_mm: float = np.inf
) -> float:
    """Return how deep two solids are inside each other, mm: the deepest point of either's surface in the other.

    It is exact to the distance of samples, which is `SKIN_MM` on small surfaces. A mesh that is not closed has no
    inside, but may be inside another body. `least_mm` and `enough_mm` save time, see `Standing.depth_of`.
    """
    depth = first.depth_of(second, least_mm, enough_mm)
    if depth > enough_mm:
        return depth
    return max(depth, second.depth_of(first, least_mm, enough_mm))


def _finer_points(triangles: np.ndarray, low: np.ndarray, high: np.ndarray) -> Iterator[np.ndarray]:
    """Yield points (n, 3) of triangles (t, 3, 3) where they are within a box, closer to each other each time."""
    while True:
        apart = (triangles.min(axis=1) >= high) | (triangles.max(axis=1) <= low)
        triangles = triangles[~apart.any(axis=1)]
        if not len(triangles):
            return
        yield np.concatenate([triangles.reshape(-1, 3), triangles.mean(axis=1)])
        sides = np.roll(triangles, -1, axis=1) - triangles
        longest = np.sqrt((sides**2).sum(axis=-1)).max(axis=1)
        longest_side = float(longest.max())
        if longest_side <= SKIN_MM or len(triangles) >= _SAMPLES:
            return
        large = longest > longest_side / 2
        triangles = np.concatenate([triangles[~large], _quartered(triangles[large])])


def _quartered(triangles: np.ndarray) -> np.ndarray:
    """Return four triangles of each one (t, 3, 3)."""
    middles = (triangles + np.roll(triangles, -1, axis=1)) / 2
    a, b, c = np.moveaxis(triangles, 1, 0)
    ab, bc, ca = np.moveaxis(middles, 1, 0)
    fours = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return np.concatenate([np.stack(four, axis=1) for four in fours])


def standing_bodies(bodies: Mapping[str, Body], parameter: str) -> tuple[Standing, ...]:
    """Return obstacles by name in the base frame, mm."""
    return tuple(_standing(name, body, f"{parameter} {name!r}") for name, body in bodies.items())


def _standing(name: str, body: Body, parameter: str) -> Standing:
    if isinstance(body, Box):
        unplaced = Box(body.low, body.high)
        return Standing(name, body.pose, hull_of(unplaced.corners(), parameter))
    return Standing(name, np.eye(4), surface_of(*mesh_of(body, parameter)))


def hidden_by(
    standing: Sequence[Standing], part2base: np.ndarray, eyes: np.ndarray, segments: np.ndarray
) -> np.ndarray:
    """Return the names (n, s) of what hides segments (s, 2, 3) of a part from eyes (n, 3) in its frame; else empty."""
    eyes = carry(part2base, eyes)
    placed = carry(part2base, segments.reshape(-1, 3)).reshape(-1, 2, 3)
    names = np.full((len(eyes), len(segments)), "", dtype=object)
    for body in standing:
        names[(names == "") & body.hides(eyes, placed)] = body.name
    return names


def _cut_by_box(
    eyes: np.ndarray, ends: np.ndarray, low: np.ndarray, high: np.ndarray
) -> np.ndarray:
    """Return which triangles between eyes (n, 3) and segments (s, 2, 3) meet a box; (n, s) bool.

    They do not if they are apart along a side of the box, the triangle's normal, or a product of their sides.
    """
    shape = (len(eyes), len(ends))
    if (low >= high).any():
        return np.zeros(shape, dtype=bool)
    centre = (low + high) / 2
    half = (high - low) / 2
    corners = np.empty((*shape, 3, 3))
    corners[..., 0, :] = (eyes - centre)[:, None]
    corners[..., 1:, :] = ends - centre
    apart = (corners.min(axis=2) > half) | (corners.max(axis=2) < -half)
    meets = ~apart.any(axis=-1)
    candidates = corners[meets]
    sides = np.roll(candidates, -1, axis=1) - candidates
    axes = np.cross(sides[:, :, None], np.eye(3)).reshape(len(candidates), 9, 3)
    normal = np.cross(sides[:, 0], sides[:, 1])[:, None]
    axes = np.concatenate([axes, normal], axis=1)
    along = np.einsum("mcj,maj->mac", candidates, axes)
    reach = np.einsum("maj,j->ma", np.abs(axes), half)
    split = (along.min(axis=2) > reach) | (along.max(axis=2) < -reach)
    meets[meets] = ~split.any(axis=1)
    return meets


def _moved(name: str, body: Body, motion: np.ndarray) -> Body:
    if isinstance(body, Box):
        return replace(body, pose=compose(motion, body.pose))
    corners, triangles = mesh_of(body, name)
    return carry(motion, corners), triangles


def geometry_of(shape: Hull | Surface) -> Any:
    """Return a shape as fcl takes it."""
    fcl = needed("fcl")
    corners = np.ascontiguousarray(shape.corners, dtype=np.float64)
    if isinstance(shape, Hull):
        count = len(shape.triangles)
        faces = np.concatenate([np.full((count, 1), 3), shape.triangles], axis=1).ravel()
        return fcl.Convex(corners, count, faces)
    model = fcl.BVHModel()
    model.beginModel(len(corners), len(shape.triangles))
    model.addSubModel(corners, np.ascontiguousarray(shape.triangles))
    model.endModel()
    return model


def transform_of(pose: np.ndarray) -> Any:
    """Return a pose (4, 4) as fcl takes it."""
    return needed("fcl").Transform(
        np.ascontiguousarray(pose[:3, :3]), np.ascontiguousarray(pose[:3, 3])
    )
