"""Points to pixels of displaced cameras, and pixels back to planes, as compiled loops."""

from __future__ import annotations

from typing import Any

import numpy as np

from ground.decorators import entry_kernel, kernel_without_refcounts


@entry_kernel(error_model="numpy")
def image_points(points: Any, poses: Any, scale: Any, found: Any) -> None:
    """Write the images of points, without distortion.

    Parameters
    ----------
    points : array (m, 3)
        In the part's frame, mm.
    poses : array (n, 4, 4)
        Cam2world.
    scale : array (4,)
        Focal lengths and principal point, px.
    found : array (n, m, 2)
        Gets the pixels; no numbers behind the camera.
    """
    for k in range(len(poses)):
        for j in range(len(points)):
            x = points[j, 0] - poses[k, 0, 3]
            y = points[j, 1] - poses[k, 1, 3]
            z = points[j, 2] - poses[k, 2, 3]
            depth = x * poses[k, 0, 2] + y * poses[k, 1, 2] + z * poses[k, 2, 2]
            if not depth > 0.0:
                found[k, j, 0] = np.nan
                found[k, j, 1] = np.nan
                continue
            across = x * poses[k, 0, 0] + y * poses[k, 1, 0] + z * poses[k, 2, 0]
            down = x * poses[k, 0, 1] + y * poses[k, 1, 1] + z * poses[k, 2, 1]
            found[k, j, 0] = across / depth * scale[0] + scale[2]
            found[k, j, 1] = down / depth * scale[1] + scale[3]


@entry_kernel(error_model="numpy")
def carry_back(pixels: Any, planned: Any, scale: Any, frame: Any, found: Any) -> None:
    """Write where rays of the planned pose meet a plane.

    Parameters
    ----------
    pixels : array (n, m, 2)
        Images without distortion.
    planned : array (4, 4)
        Cam2world.
    scale : array (4,)
        Focal lengths and principal point, px.
    frame : array (3, 3)
        Origin of the plane, and its axes.
    found : array (n, m, 2)
        Gets the coordinates in the plane, mm.
    """
    normal = np.empty(3)
    for i in range(3):
        j = (i + 1) % 3
        k = (i + 2) % 3
        normal[i] = frame[1, j] * frame[2, k] - frame[1, k] * frame[2, j]
    height = 0.0
    off = np.empty(3)
    for i in range(3):
        off[i] = planned[i, 3] - frame[0, i]
        height -= off[i] * normal[i]
    local = np.empty(3)
    for k in range(len(pixels)):
        for j in range(pixels.shape[1]):
            x = (pixels[k, j, 0] - scale[2]) / scale[0]
            y = (pixels[k, j, 1] - scale[3]) / scale[1]
            along = 0.0
            for i in range(3):
                local[i] = x * planned[i, 0] + y * planned[i, 1] + planned[i, 2]
                along += local[i] * normal[i]
            depth = height / along
            first = 0.0
            second = 0.0
            for i in range(3):
                place = off[i] + depth * local[i]
                first += place * frame[1, i]
                second += place * frame[2, i]
            found[k, j, 0] = first
            found[k, j, 1] = second


# Circles fitted to points by least squares of distances, many at once, as compiled loops.


_ROUNDS = 30
_STILL = 1e-10
# of the radius: nearer to the centre, a point has no direction from there
_CLOSE = 1e-9
_SMALL = 1e-12


@entry_kernel(error_model="numpy")
def fit_circles(flat: Any, radius: float, found: Any) -> None:
    """Fit circles to points (Gauss–Newton).

    Parameters
    ----------
    flat : array (n, m, 2)
        The points of each circle.
    radius : float
        About the radius of all circles.
    found : array (n, 3)
        Gets the centre and the radius; no numbers, where a point is none.
    """
    step = np.empty(3)
    for k in range(len(flat)):
        _start(flat[k], radius, step, found[k])
        for _ in range(_ROUNDS):
            _gauss_newton(flat[k], radius, found[k], step)
            largest = 0.0
            for i in range(3):
                found[k, i] += step[i]
                largest = max(largest, abs(step[i]))
            if not largest > _STILL * radius:
                break


@kernel_without_refcounts(error_model="numpy")
def _start(points: Any, radius: float, solved: Any, found: Any) -> None:
    """Write the algebraic fit to points (m, 2), which needs no start."""
    m = len(points)
    x = 0.0
    y = 0.0
    for j in range(m):
        x += points[j, 0] / m
        y += points[j, 1] / m
    xx = xy = yy = 0.0
    x1 = y1 = 0.0
    right_x = right_y = right_1 = 0.0
    for j in range(m):
        u = points[j, 0] - x
        v = points[j, 1] - y
        square = u * u + v * v
        xx += u * u
        xy += u * v
        yy += v * v
        x1 += u
        y1 += v
        right_x += u * square
        right_y += v * square
        right_1 += square
    normal = (4.0 * xx, 4.0 * xy, 2.0 * x1, 4.0 * yy, 2.0 * y1, float(m))
    _solve(normal, (2.0 * right_x, 2.0 * right_y, right_1), solved)
    square = solved[2] + solved[0] * solved[0] + solved[1] * solved[1]
    found[0] = x + solved[0]
    found[1] = y + solved[1]
    found[2] = np.sqrt(max(square, _SMALL * radius * radius))


@kernel_without_refcounts(error_model="numpy")
def _gauss_newton(points: Any, radius: float, found: Any, step: Any) -> None:
    """Write the step from a circle (3,) towards the one that fits points (m, 2)."""
    xx = xy = yy = 0.0
    x1 = y1 = 0.0
    right_x = right_y = right_1 = 0.0
    for j in range(len(points)):
        u = points[j, 0] - found[0]
        v = points[j, 1] - found[1]
        distance = max(np.sqrt(u * u + v * v), _CLOSE * radius)
        u /= distance
        v /= distance
        residual = distance - found[2]
        xx += u * u
        xy += u * v
        yy += v * v
        x1 += u
        y1 += v
        right_x += u * residual
        right_y += v * residual
        right_1 += residual
    normal = (xx, xy, x1, yy, y1, float(len(points)))
    _solve(normal, (right_x, right_y, right_1), step)


@kernel_without_refcounts(error_model="numpy")
def _solve(normal: Any, right: Any, solved: Any) -> None:
    """Solve three equations whose matrix is symmetric and positive: (xx, xy, x1, yy, y1, 11)."""
    xx, xy, x1, yy, y1, one = normal
    low = xy / xx
    lower = x1 / xx
    middle = yy - low * xy
    last = (y1 - low * x1) / middle
    corner = one - lower * x1 - last * (y1 - low * x1)
    second = right[1] - low * right[0]
    third = right[2] - lower * right[0] - last * second
    solved[2] = third / corner
    solved[1] = second / middle - last * solved[2]
    solved[0] = (right[0] - xy * solved[1] - x1 * solved[2]) / xx
