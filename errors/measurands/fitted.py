"""Lines and circles fitted in planes of the part: arrays for compiled loops, and the loop over poses."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from compiled.cache import njit
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
        self._geometry = geometry

    def expand(
        self,
        poses: NDArray[np.float64],
        image_distance_mm: float,
        pitch_mm: tuple[float, float],
        localisation: Localisation,
    ) -> tuple[NDArray[np.bool_], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return where the value can be measured (n,), gradient (n, 6), Hessian (n, 6, 6) and variance of the noise."""
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
        seen = np.zeros(n, dtype=np.bool_)
        gradient = np.zeros((n, 6))
        hessian = np.zeros((n, 6, 6))
        variance = np.zeros(n)
        entities = self.shapes, self.frames, self.sizes, angles, solve
        _expand_all(
            np.ascontiguousarray(poses),
            entities,
            self.gradient,
            self.hessian,
            fit,
            (seen, gradient, hessian, variance),
        )
        return seen, gradient, hessian, variance


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
def _expand_all(poses, entities, of_value, bend, fit, out):
    shapes, frames, sizes, angles, solve = entities
    seen, gradient, hessian, variance = out
    count = len(of_value)
    at = np.empty((3, 3))
    rows = np.zeros((count, 6))
    for i in range(len(poses)):
        g = gradient[i]
        h = hessian[i]
        start = 0
        whole = True
        for e in range(len(shapes)):
            turned(frames[e], poses[i], at)
            n_fitted = 2 if shapes[e] == _LINE else 3
            own = of_value[start : start + n_fitted]
            if shapes[e] == _LINE:
                whole = expand_line(at, sizes[e], own, g, h, rows[start:])
                if whole:
                    variance[i] += line_noise(at, sizes[e], own, angles.shape[1], fit)
            else:
                whole = expand_circle(at, sizes[e], angles[e], solve[e], own, g, h, rows[start:])
                if whole:
                    closed = shapes[e] == _CIRCLE
                    variance[i] += circle_noise(at, sizes[e], angles[e], solve[e], own, fit, closed)
                    if not closed:
                        radius = np.array([0.0, 0.0, 1.0])
                        known = circle_noise(at, sizes[e], angles[e], solve[e], radius, fit, closed)
                        whole = known <= (_MOST_NOISE * sizes[e]) ** 2
            if not whole:
                break
            start += n_fitted
        seen[i] = whole
        if not whole:
            continue
        for j in range(count):
            for k in range(count):
                if bend[j, k] != 0.0:
                    for a in range(6):
                        for b in range(6):
                            h[a, b] += bend[j, k] * rows[j, a] * rows[k, b]
