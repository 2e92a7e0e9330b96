"""Camera poses and the two camera frames.

Frames
------
world   the part's frame, millimetres.
cam     OpenCV camera frame: origin at the front nodal point, x right, y down, z forward along the optical axis.
paper   the frame of Yang & Ciarallo (2001), eqs 4–9: C1 right, C2 up, C3 backwards, origin on the image plane, lens
        centre at C3 = f. With S = diag(1, −1, −1) and e3 = (0, 0, 1): C = S·X + f·e3, where f is the image distance.

`cam2world` (4, 4) maps cam coordinates to world coordinates; its last column is the position of the front nodal point.
"""

from __future__ import annotations

import math

import numba as nb
import numpy as np

_CAM_TO_PAPER = np.diag([1.0, -1.0, -1.0])
# squares of smaller numbers lose digits
_TINY = 1e-150
# sine of the angle to the world's z axis below which a view is taken as vertical, for the choice of the level axis
_VERTICAL = 1e-9


def cross_matrix(vector) -> np.ndarray:
    """Return the matrix (3, 3) of the map x -> vector × x."""
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def paper_displacement_jacobian(image_distance_mm: float) -> np.ndarray:
    """Return d(d, φ)/d(t, θ) (6, 6): the paper's object displacement caused by a displacement of the camera.

    A camera displaced by translation t and rotation θ about its nodal point sees, to first order, X' = X − θ×X − t.
    With C = S·X + f·e3 that is C' = C + φ×C + d for φ = −Sθ and d = −St + (Sθ)×(f·e3).
    """
    jacobian = np.zeros((6, 6))
    jacobian[:3, :3] = jacobian[3:, 3:] = -_CAM_TO_PAPER
    jacobian[:3, 3:] = -cross_matrix([0.0, 0.0, image_distance_mm]) @ _CAM_TO_PAPER
    return jacobian


def cam_to_paper(points_cam, image_distance_mm: float) -> np.ndarray:
    """Convert points (..., 3) from the OpenCV camera frame to the paper's: (x, −y, f − z)."""
    return np.asarray(points_cam, dtype=float) * [1.0, -1.0, -1.0] + [0.0, 0.0, image_distance_mm]


def world_to_cam(points, cam2world) -> np.ndarray:
    """Express world points in camera frames.

    Parameters
    ----------
    points : array (..., 3)
        World points, mm.
    cam2world : array (4, 4) or (n, 4, 4)
        Camera poses.

    Returns
    -------
    array (..., 3) or (n, ..., 3)
        The points in each camera's OpenCV frame, mm.
    """
    points, cam2world = np.asarray(points, dtype=float), np.asarray(cam2world, dtype=float)
    poses = cam2world.reshape(-1, 4, 4)
    flat = points.reshape(-1, 3)
    local = (flat[None] - poses[:, None, :3, 3]) @ poses[:, :3, :3]
    return local.reshape(cam2world.shape[:-2] + points.shape)


def aim(positions, target) -> np.ndarray:
    """Return rotations (n, 3, 3), cam to world, that look from positions (n, 3) to a target (3,) or (n, 3).

    The camera's x axis is level (perpendicular to the world's z axis) unless it looks along z; then it follows world x.
    """
    return look_at(positions, target)[:, :3, :3]


def look_at(positions, target, pan=0.0, tilt=0.0, roll=0.0) -> np.ndarray:
    """Return poses (n, 4, 4) that look from positions at a target, then turn.

    Parameters
    ----------
    positions : array (n, 3)
        Front nodal points, mm.
    target : array (3,) or (n, 3)
        World point on the optical axis before turning, mm.
    pan, tilt, roll : array (n,) or float
        Rotations in rad, applied in this order about the camera's own y, x and z axes.

    Returns
    -------
    array (n, 4, 4)
        Poses cam2world in OpenCV axes (x right, y down, z forward), mm. Before turning, the camera's x axis is level,
        unless it looks along the world's z axis; then it follows world x.
    """
    positions = np.atleast_2d(np.asarray(positions, dtype=np.float64))
    n = len(positions)
    target = np.broadcast_to(np.asarray(target, dtype=np.float64), (n, 3))
    turns = np.empty((3, n))
    turns[0], turns[1], turns[2] = pan, tilt, roll
    cam2world = np.zeros((n, 4, 4))
    _look_at(positions, target, turns, cam2world)
    return cam2world


def moved(cam2world: np.ndarray, moves: np.ndarray, unit_mm: float) -> np.ndarray:
    """Return the poses (n, 4, 4) reached from one pose (4, 4) by moves (n, 6) along and about its own axes.

    The first three entries are a translation in units of `unit_mm`, the others a rotation vector in rad.
    """
    poses = np.zeros((len(moves), 4, 4))
    _move(cam2world, moves, unit_mm, poses)
    return poses


@nb.njit(cache=True, error_model="numpy")
def _look_at(positions, target, turns, out):
    right, down, forward = np.empty(3), np.empty(3), np.empty(3)
    turn = np.empty((3, 3))
    for i in range(len(positions)):
        for k in range(3):
            forward[k] = target[i, k] - positions[i, k]
        if not _normalise(forward):
            forward[0], forward[1], forward[2] = 0.0, 0.0, 1.0
        # forward × z vanishes in a vertical view; world x, only nearly perpendicular then, is set upright below
        size = math.hypot(forward[0], forward[1])
        if size > _VERTICAL:
            right[0], right[1], right[2] = forward[1] / size, -forward[0] / size, 0.0
        else:
            right[0], right[1], right[2] = 1.0, 0.0, 0.0
        _cross(forward, right, down)
        _normalise(down)
        _cross(down, forward, right)
        _pan_tilt_roll(turns[0, i], turns[1, i], turns[2, i], turn)
        for row in range(3):
            for column in range(3):
                out[i, row, column] = (
                    right[row] * turn[0, column] + down[row] * turn[1, column] + forward[row] * turn[2, column]
                )
            out[i, row, 3] = positions[i, row]
        out[i, 3, 3] = 1.0


@nb.njit(cache=True, error_model="numpy")
def _pan_tilt_roll(pan, tilt, roll, out):
    """Write the product of the rotations by pan about y, by tilt about x and by roll about z."""
    cp, sp, ct, st = math.cos(pan), math.sin(pan), math.cos(tilt), math.sin(tilt)
    cr, sr = math.cos(roll), math.sin(roll)
    out[0, 0], out[0, 1], out[0, 2] = cp * cr + sp * st * sr, sp * st * cr - cp * sr, sp * ct
    out[1, 0], out[1, 1], out[1, 2] = ct * sr, ct * cr, -st
    out[2, 0], out[2, 1], out[2, 2] = cp * st * sr - sp * cr, sp * sr + cp * st * cr, cp * ct


@nb.njit(cache=True, error_model="numpy")
def _move(cam2world, moves, unit, out):
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


@nb.njit(cache=True, error_model="numpy")
def _rotation(x, y, z, out):
    """Write the rotation by a vector (Rodrigues): cos a·I + sin a/a·[v]× + (1 − cos a)/a²·v v'."""
    squared = x * x + y * y + z * z
    angle = math.sqrt(squared)
    half = math.sin(0.5 * angle)
    along = math.sin(angle) / angle if angle > 0.0 else 1.0
    outer = 2.0 * half * half / squared if squared > 0.0 else 0.5
    cosine = 1.0 - 2.0 * half * half
    out[0, 0], out[0, 1], out[0, 2] = cosine + outer * x * x, outer * x * y - along * z, outer * x * z + along * y
    out[1, 0], out[1, 1], out[1, 2] = outer * x * y + along * z, cosine + outer * y * y, outer * y * z - along * x
    out[2, 0], out[2, 1], out[2, 2] = outer * x * z - along * y, outer * y * z + along * x, cosine + outer * z * z


@nb.njit(cache=True, error_model="numpy")
def _cross(a, b, out):
    out[0], out[1], out[2] = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@nb.njit(cache=True, error_model="numpy")
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
