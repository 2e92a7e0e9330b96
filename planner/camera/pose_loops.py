"""Compiled loops of `planner.camera.pose`, apart so that a camera can be had without the compiler."""

from __future__ import annotations

import math

import numpy as np

from ground.decorators import entry_kernel, kernel_without_refcounts

# squares of smaller numbers lose digits
_TINY = 1e-150
# sine of the angle to the world's z axis below which a view is taken as vertical, for the choice of the level axis
_VERTICAL = 1e-9


@entry_kernel(error_model="numpy")
def look_along(positions, target, turns, out):
    """Write the poses (n, 4, 4) of `planner.camera.pose.look_at`; ``turns`` (3, n) are pan, tilt and roll."""
    right = np.empty(3)
    down = np.empty(3)
    forward = np.empty(3)
    turn = np.empty((3, 3))
    for i in range(len(positions)):
        for k in range(3):
            forward[k] = target[i, k] - positions[i, k]
        if not _normalise(forward):
            forward[0] = 0.0
            forward[1] = 0.0
            forward[2] = 1.0
        # forward × z vanishes in a vertical view; world x, only nearly perpendicular then, is set upright below
        size = math.hypot(forward[0], forward[1])
        if size > _VERTICAL:
            right[0] = forward[1] / size
            right[1] = -forward[0] / size
            right[2] = 0.0
        else:
            right[0] = 1.0
            right[1] = 0.0
            right[2] = 0.0
        _cross(forward, right, down)
        _normalise(down)
        _cross(down, forward, right)
        _pan_tilt_roll(turns[0, i], turns[1, i], turns[2, i], turn)
        for row in range(3):
            for column in range(3):
                out[i, row, column] = (
                    right[row] * turn[0, column]
                    + down[row] * turn[1, column]
                    + forward[row] * turn[2, column]
                )
            out[i, row, 3] = positions[i, row]
        out[i, 3, 3] = 1.0


@kernel_without_refcounts(error_model="numpy")
def _pan_tilt_roll(pan, tilt, roll, out):
    """Write the product of the rotations by pan about y, by tilt about x and by roll about z."""
    cp = math.cos(pan)
    sp = math.sin(pan)
    ct = math.cos(tilt)
    st = math.sin(tilt)
    cr = math.cos(roll)
    sr = math.sin(roll)
    out[0, 0] = cp * cr + sp * st * sr
    out[0, 1] = sp * st * cr - cp * sr
    out[0, 2] = sp * ct
    out[1, 0] = ct * sr
    out[1, 1] = ct * cr
    out[1, 2] = -st
    out[2, 0] = cp * st * sr - sp * cr
    out[2, 1] = sp * sr + cp * st * cr
    out[2, 2] = cp * ct


@entry_kernel(error_model="numpy")
def move(cam2world, moves, unit, out):
    """Write the poses (n, 4, 4) of `planner.camera.pose.moved`."""
    turn = np.empty((3, 3))
    for i in range(len(moves)):
        _rotation(moves[i, 3], moves[i, 4], moves[i, 5], turn)
        for row in range(3):
            step = 0.0
            for k in range(3):
                step += cam2world[row, k] * moves[i, k]
                total = 0.0
                for inner in range(3):
                    total += cam2world[row, inner] * turn[inner, k]
                out[i, row, k] = total
            out[i, row, 3] = cam2world[row, 3] + unit * step
        out[i, 3, 3] = 1.0


@kernel_without_refcounts(error_model="numpy")
def _rotation(x, y, z, out):
    """Write the rotation by a vector (Rodrigues): cos a·I + sin a/a·[v]× + (1 − cos a)/a²·v v'."""
    squared = x * x + y * y + z * z
    angle = math.sqrt(squared)
    half = math.sin(0.5 * angle)
    along = math.sin(angle) / angle if angle > 0.0 else 1.0
    outer = 2.0 * half * half / squared if squared > 0.0 else 0.5
    cosine = 1.0 - 2.0 * half * half
    out[0, 0] = cosine + outer * x * x
    out[0, 1] = outer * x * y - along * z
    out[0, 2] = outer * x * z + along * y
    out[1, 0] = outer * x * y + along * z
    out[1, 1] = cosine + outer * y * y
    out[1, 2] = outer * y * z - along * x
    out[2, 0] = outer * x * z - along * y
    out[2, 1] = outer * y * z + along * x
    out[2, 2] = cosine + outer * z * z


@kernel_without_refcounts(error_model="numpy")
def _cross(a, b, out):
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@kernel_without_refcounts(error_model="numpy")
def _normalise(vector):
    """Scale a vector to length 1; False if it has none."""
    largest = max(abs(vector[0]), abs(vector[1]), abs(vector[2]))
    if 0.0 < largest < _TINY:
        # its squares would lose digits, or all of them
        for k in range(3):
            vector[k] /= largest
    length = math.sqrt(vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2])
    if length > 0.0:
        for k in range(3):
            vector[k] /= length
    return length > 0.0
