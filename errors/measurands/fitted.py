"""Lines and circles fitted in planes of the part: arrays for compiled loops, and the loop over poses."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from compiled.cache import njit
from errors.measurands.common_errors import by_surface, circle_floor, line_floor
from errors.measurands.fit_expansion import (
    circle_noise,
    expand_circle,
    expand_line,
    line_noise,
    turned,
)
from errors.measurands.geometry import Circle, Geometry, Line
from errors.measurands.localisation import POINTS, Localisation

_LINE = 0
_CIRCLE = 1
_ARC = 2
# of the radius: an arc that is known no better than that is not measured, as its fit is not near to linear there
_MOST_NOISE = 0.1
ONE_SURFACE_MM = 1e-3
"""Entities whose planes are no farther apart than this lie on one surface, and share its deviation."""


class Frame(NamedTuple):
    """The plane an entity is fitted in: origin, x and y (3,) each; of a line x runs along it and y across."""

    origin: NDArray[np.float64]
    x: NDArray[np.float64]
    y: NDArray[np.float64]


class FittedEntities:
    """What is fitted for a value, and the value's derivatives by it.

    Parameters
    ----------
    geometry : tuple of Line or Circle
        The entities.
    frames : tuple of Frame
        Their planes.
    gradient, hessian : array (p,), (p, p)
        Of the value by what is fitted, see `Measurand.describe`.
    """

    def __init__(
        self,
        geometry: tuple[Geometry, ...],
        frames: tuple[Frame, ...],
        gradient: NDArray[np.float64],
        hessian: NDArray[np.float64],
    ):
        self.gradient = np.ascontiguousarray(gradient, dtype=np.float64)
        self.hessian = np.ascontiguousarray(hessian, dtype=np.float64)
        self.shapes = np.array(
            [_LINE if isinstance(one, Line) else _CIRCLE + (not one.is_closed) for one in geometry]
        )
        self.frames = np.array([[frame.origin, frame.x, frame.y] for frame in frames])
        self.sizes = np.array(
            [one.length / 2 if isinstance(one, Line) else one.radius_mm for one in geometry]
        )
        self.surfaces, self.normals = _surfaces(frames)
        self._geometry = geometry

    def expand(
        self,
        poses: NDArray[np.float64],
        image_distance_mm: float,
        pitch_mm: tuple[float, float],
        localisation: Localisation,
        surfaces_mm: float = 0.0,
    ) -> tuple[NDArray[np.bool_], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return where the value can be measured (n,), gradient (n, 6), Hessian (n, 6, 6) and variances (n, 3).

        The variances are those of the noise, as of `errors.measurands.measurand.Expansion`.
        """
        points = localisation.points
        angles = np.zeros((len(self.shapes), points, 2))
        solve = np.zeros((len(self.shapes), 6, points))
        for k, one in enumerate(self._geometry):
            if isinstance(one, Circle):
                angles[k], solve[k] = circle_fit(one, points)
        n = len(poses)
        sigma = localisation.sigma_px
        per_length = 0.0
        floor = 0.0
        if localisation.model == "fit":
            per_length = image_distance_mm / (localisation.correlation_px * max(pitch_mm))
            floor = (localisation.floor_px / sigma) ** 2 if sigma > 0 else 0.0
        fit = np.array(
            [*(sigma * pitch / image_distance_mm for pitch in pitch_mm), per_length, floor]
        )
        common = np.array(
            [
                *(localisation.common_px * pitch / image_distance_mm for pitch in pitch_mm),
                surfaces_mm,
            ]
        )
        seen = np.zeros(n, dtype=np.bool_)
        gradient = np.zeros((n, 6))
        hessian = np.zeros((n, 6, 6))
        variance = np.zeros((n, 3))
        _expand_all(
            np.ascontiguousarray(poses),
            (self.shapes, self.frames, self.sizes, angles, solve, self.surfaces, self.normals),
            self.gradient,
            self.hessian,
            fit,
            common,
            (seen, gradient, hessian, variance),
        )
        return seen, gradient, hessian, variance

    def by_entity(self, poses: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the value's gradient by the displacement of the camera, of each entity alone; (n, e, 6)."""
        angles = np.zeros((len(self.shapes), POINTS, 2))
        solve = np.zeros((len(self.shapes), 6, POINTS))
        for k, one in enumerate(self._geometry):
            if isinstance(one, Circle):
                angles[k], solve[k] = circle_fit(one, POINTS)
        gradient = np.zeros((len(poses), len(self.shapes), 6))
        entities = (self.shapes, self.frames, self.sizes, angles, solve)
        _by_entity(np.ascontiguousarray(poses), entities, self.gradient, gradient)
        return gradient


def _surfaces(frames: tuple[Frame, ...]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return which entities lie on one surface, as the index of its first one, and the surfaces' normals (k, 3)."""
    index = np.arange(len(frames))
    normals = np.array([np.cross(frame.x, frame.y) for frame in frames])
    for k, frame in enumerate(frames):
        for j in range(k):
            # kinds fit their entities in parallel planes
            if abs((frame.origin - frames[j].origin) @ normals[j]) <= ONE_SURFACE_MM:
                index[k] = index[j]
                normals[k] = normals[j]
                break
    return index, normals


def circle_fit(
    one: Circle, points: int = POINTS
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return cosines and sines (m, 2) of the points that are fitted, and the linear fit (6, m) of `expand_circle`."""
    step = one.span_rad / points
    angles = (np.arange(points) + 0.5) * step
    design = np.stack([np.cos(angles), np.sin(angles), np.ones(points)])
    inverse = np.linalg.inv(design @ design.T)
    tangents = np.stack([-np.sin(angles), np.cos(angles)])
    return design[:2].T.copy(), np.concatenate([inverse @ design, inverse[:, :2] @ tangents])


def is_short(one: Geometry) -> bool:
    """Whether an entity is an arc of less than half a circle: its fit has no moments, only quantiles."""
    return isinstance(one, Circle) and one.span_rad < math.pi


@njit(error_model="numpy")
def _expand_all(poses, entities, of_value, bend, fit, common, out):
    shapes = entities[0]
    seen, gradient, hessian, variance = out
    count = len(of_value)
    rows = np.zeros((count, 6))
    by_surfaces = np.empty(len(shapes))
    before = np.empty(6)
    for i in range(len(poses)):
        g = gradient[i]
        h = hessian[i]
        start = 0
        whole = True
        by_surfaces[:] = 0.0
        for e in range(len(shapes)):
            n_fitted = 2 if shapes[e] == _LINE else 3
            own = of_value[start : start + n_fitted]
            before[:] = g
            whole = _expand_entity(
                poses[i], entities, e, own, fit, common, (g, h, rows[start:], variance[i])
            )
            if not whole:
                break
            # what lies on one surface is off by the same
            surface = entities[5][e]
            by_surfaces[surface] += by_surface(g, before, entities[6][surface], poses[i])
            start += n_fitted
        seen[i] = whole
        if not whole:
            continue
        for e in range(len(shapes)):
            variance[i, 2] += (by_surfaces[e] * common[2]) ** 2
        for j in range(count):
            for k in range(count):
                if bend[j, k] != 0.0:
                    for a in range(6):
                        for b in range(6):
                            h[a, b] += bend[j, k] * rows[j, a] * rows[k, b]


@njit(error_model="numpy")
def _expand_entity(pose, entities, e, own, fit, common, out):
    """Add an entity's share to gradient, Hessian and variances; return False if it cannot be measured."""
    shapes, frames, sizes, angles, solve, _, _ = entities
    g, h, rows, variance = out
    at = np.empty((3, 3))
    turned(frames[e], pose, at)
    if shapes[e] == _LINE:
        if not expand_line(at, sizes[e], own, g, h, rows):
            return False
        variance[0] += line_noise(at, sizes[e], own, angles.shape[1], fit)
        if common[0] > 0.0:
            variance[1] += line_floor(at, sizes[e], own, angles.shape[1], common) ** 2
        return True
    if not expand_circle(at, sizes[e], angles[e], solve[e], own, g, h, rows):
        return False
    closed = shapes[e] == _CIRCLE
    variance[0] += circle_noise(at, sizes[e], angles[e], solve[e], own, fit, closed)
    if common[0] > 0.0:
        variance[1] += circle_floor(at, sizes[e], angles[e], solve[e], own, common) ** 2
    if closed:
        return True
    radius = np.array([0.0, 0.0, 1.0])
    known = circle_noise(at, sizes[e], angles[e], solve[e], radius, fit, closed)
    return known <= (_MOST_NOISE * sizes[e]) ** 2


@njit(error_model="numpy")
def _by_entity(poses, entities, of_value, gradient):
    shapes, frames, sizes, angles, solve = entities
    at = np.empty((3, 3))
    unused = np.empty((6, 6))
    rows = np.empty((3, 6))
    for i in range(len(poses)):
        start = 0
        for e in range(len(shapes)):
            n_fitted = 2 if shapes[e] == _LINE else 3
            own = of_value[start : start + n_fitted]
            turned(frames[e], poses[i], at)
            g = gradient[i, e]
            if shapes[e] == _LINE:
                expand_line(at, sizes[e], own, g, unused, rows)
            else:
                expand_circle(at, sizes[e], angles[e], solve[e], own, g, unused, rows)
            start += n_fitted
