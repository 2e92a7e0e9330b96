"""Which ideal image points a lens with distortion brings onto the sensor: a rectangle inside and one around them.

Ideal points are directions (x/z, y/z). The field is the connected set of them around the middle of the sensor whose
images lie on it. Its border is curved; loops and proofs want rectangles. Both are *checked* by interval arithmetic:

* inner: the Jacobian J of the distortion is positive definite in it, so its image is bounded by the image of its
  border, and that lies on the sensor. A segment with both ends in it is imaged whole.
* outer: its border is imaged off the sensor, so the field, which is connected, does not cross it.

J is symmetric. Where it is positive definite on a convex set, no two points share an image: the lens does not fold.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from planner.camera.distortion import Distortion
from planner.exceptions import CameraError

# points of a side, pieces of a side and cells along a side of a rectangle
_POINTS = 129
_PIECES = 1024
_CELLS = 96
# first slack of a rectangle as a share of its size, and how often it is doubled
_SLACK = 1e-5
_DOUBLINGS = 12
_ROUNDING = 1e-12

Rectangle = tuple[float, float, float, float]
_Interval = tuple[NDArray[np.float64], NDArray[np.float64]]


class Field(NamedTuple):
    """Field of view, as tangents left, top, right, bottom of the optical axis.

    Attributes
    ----------
    inner, outer : tuple of float
        Rectangles inside the field and around it.
    least : float
        Least stretch by the lens in the inner one: smallest eigenvalue of J.
    most : float
        Largest stretch in the outer one.
    """

    inner: Rectangle
    outer: Rectangle
    least: float = 1.0
    most: float = 1.0


@lru_cache(maxsize=64)
def field_of(lens: Distortion, sides: Rectangle) -> Field:
    """Return the field of a lens before a sensor.

    Parameters
    ----------
    lens : Distortion
        The lens.
    sides : tuple of float
        Left, top, right and bottom side of the sensor as its images are measured: tangents with distortion.

    Returns
    -------
    Field
        Sides without an inside have no field: the rectangles are the sides.

    Raises
    ------
    CameraError
        If the lens model folds within the field.
    """
    left, top, right, bottom = sides
    if not (left < right and top < bottom):
        return Field(sides, sides)
    along = np.linspace(0.0, 1.0, _POINTS)
    x = left + (right - left) * along
    y = top + (bottom - top) * along
    walls = [
        np.stack(np.broadcast_arrays(*wall), axis=-1)
        for wall in ((left, y), (x, top), (right, y), (x, bottom))
    ]
    ideal = [lens.undistort(wall) for wall in walls]
    every = np.concatenate(ideal)
    size = np.ptp(every, axis=0)
    widest = np.concatenate([every.min(axis=0), every.max(axis=0)])
    outer = _first(widest, np.concatenate([-size, size]), lambda box: _off_sensor(lens, box, sides))
    narrowest = np.array(
        [ideal[0][:, 0].max(), ideal[1][:, 1].max(), ideal[2][:, 0].min(), ideal[3][:, 1].min()]
    )
    inner = _first(
        narrowest, np.concatenate([size, -size]), lambda box: _on_sensor(lens, box, sides)
    )
    if outer is None or inner is None or _stretch(lens, outer)[0] <= 0.0:
        raise CameraError.of_rule("distortion", "must not fold within the field of view", str(lens))
    return Field(inner, outer, _stretch(lens, inner)[0], _stretch(lens, outer)[1])


def _first(
    start: NDArray[np.float64], step: NDArray[np.float64], holds: Callable[[Rectangle], bool]
) -> Rectangle | None:
    """Return the first of ever wider, or narrower, rectangles that passes a check."""
    for k in range(_DOUBLINGS):
        left, top, right, bottom = (start + _SLACK * 2**k * step).tolist()
        if holds((left, top, right, bottom)):
            return left, top, right, bottom
    return None


def _off_sensor(lens: Distortion, box: Rectangle, sides: Rectangle) -> bool:
    (x_low, x_high), (y_low, y_high) = _border_images(lens, box)
    left, top, right, bottom = sides
    gap = _ROUNDING
    off = (
        (x_high < left - gap)
        | (x_low > right + gap)
        | (y_high < top - gap)
        | (y_low > bottom + gap)
    )
    return bool(off.all())


def _on_sensor(lens: Distortion, box: Rectangle, sides: Rectangle) -> bool:
    if not (box[0] < box[2] and box[1] < box[3]):
        return False
    (x_low, x_high), (y_low, y_high) = _border_images(lens, box)
    left, top, right, bottom = sides
    gap = _ROUNDING
    on = (
        (x_low > left + gap)
        & (x_high < right - gap)
        & (y_low > top + gap)
        & (y_high < bottom - gap)
    )
    return bool(on.all()) and _stretch(lens, box)[0] > 0.0


def _border_images(lens: Distortion, box: Rectangle) -> tuple[_Interval, _Interval]:
    """Return bounds of the images of a rectangle's border, piece by piece: the middle's, and J times half a piece."""
    left, top, right, bottom = box
    xs = np.linspace(left, right, _PIECES + 1)
    ys = np.linspace(top, bottom, _PIECES + 1)
    pieces = [(_still(wall, _PIECES), (ys[:-1], ys[1:])) for wall in (left, right)]
    pieces += [((xs[:-1], xs[1:]), _still(wall, _PIECES)) for wall in (top, bottom)]
    x = (
        np.concatenate([piece[0][0] for piece in pieces]),
        np.concatenate([piece[0][1] for piece in pieces]),
    )
    y = (
        np.concatenate([piece[1][0] for piece in pieces]),
        np.concatenate([piece[1][1] for piece in pieces]),
    )
    middle = lens.distort(np.stack([(x[0] + x[1]) / 2, (y[0] + y[1]) / 2], axis=-1))
    half_x = (x[1] - x[0]) / 2
    half_y = (y[1] - y[0]) / 2
    mean, half, mixed = _jacobian(lens, x, y)
    across = _largest(_plus(mean, half)) * half_x + _largest(mixed) * half_y
    down = _largest(mixed) * half_x + _largest(_plus(mean, _times(-1.0, half))) * half_y
    return (middle[:, 0] - across, middle[:, 0] + across), (
        middle[:, 1] - down,
        middle[:, 1] + down,
    )


def _stretch(lens: Distortion, box: Rectangle) -> tuple[float, float]:
    """Return bounds of the eigenvalues of J in a rectangle: mean -+ sqrt(half² + mixed²), cell by cell."""
    xs = np.linspace(box[0], box[2], _CELLS + 1)
    ys = np.linspace(box[1], box[3], _CELLS + 1)
    x = tuple(np.repeat(side, _CELLS) for side in (xs[:-1], xs[1:]))
    y = tuple(np.tile(side, _CELLS) for side in (ys[:-1], ys[1:]))
    mean, half, mixed = _jacobian(lens, (x[0], x[1]), (y[0], y[1]))
    root = np.hypot(_largest(half), _largest(mixed))
    return float((mean[0] - root).min()) - _ROUNDING, float((mean[1] + root).max()) + _ROUNDING


def _jacobian(
    lens: Distortion, x: _Interval, y: _Interval
) -> tuple[_Interval, _Interval, _Interval]:
    """Return bounds of (J_xx + J_yy)/2, (J_xx - J_yy)/2 and J_xy."""
    xx = _square(x)
    yy = _square(y)
    r2 = _plus(xx, yy)
    radial = _polynomial((1.0, lens.k1, lens.k2, lens.k3), r2)
    slope = _polynomial((2.0 * lens.k1, 4.0 * lens.k2, 6.0 * lens.k3), r2)
    mean = _plus(
        _plus(radial, _times(0.5, _product(slope, r2))),
        _plus(_times(4 * lens.p1, y), _times(4 * lens.p2, x)),
    )
    half = _times(0.5, _product(slope, _plus(xx, _times(-1.0, yy))))
    half = _plus(half, _plus(_times(2 * lens.p2, x), _times(-2 * lens.p1, y)))
    mixed = _plus(
        _product(slope, _product(x, y)), _plus(_times(2 * lens.p1, x), _times(2 * lens.p2, y))
    )
    return mean, half, mixed


def _still(value: float, n: int) -> _Interval:
    return np.full(n, value), np.full(n, value)


def _plus(a: _Interval, b: _Interval) -> _Interval:
    return a[0] + b[0], a[1] + b[1]


def _times(factor: float, a: _Interval) -> _Interval:
    return (factor * a[0], factor * a[1]) if factor >= 0 else (factor * a[1], factor * a[0])


def _product(a: _Interval, b: _Interval) -> _Interval:
    every = np.stack([a[0] * b[0], a[0] * b[1], a[1] * b[0], a[1] * b[1]])
    return every.min(axis=0), every.max(axis=0)


def _square(a: _Interval) -> _Interval:
    low = np.square(a[0])
    high = np.square(a[1])
    return np.where((a[0] <= 0) & (a[1] >= 0), 0.0, np.minimum(low, high)), np.maximum(low, high)


def _polynomial(coefficients: tuple[float, ...], a: _Interval) -> _Interval:
    """Return bounds of a polynomial of a, which is not negative, by its rising and its falling terms."""
    low = np.zeros_like(a[0])
    high = np.zeros_like(a[0])
    for k, c in enumerate(coefficients):
        low = low + c * a[0 if c >= 0 else 1] ** k
        high = high + c * a[1 if c >= 0 else 0] ** k
    return low, high


def _largest(a: _Interval) -> NDArray[np.float64]:
    return np.maximum(np.abs(a[0]), np.abs(a[1]))
