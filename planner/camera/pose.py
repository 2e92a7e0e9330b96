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

import numpy as np

_CAM_TO_PAPER = np.diag([1.0, -1.0, -1.0])


def cross_matrix(vector: np.ndarray) -> np.ndarray:
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
    jacobian[:3, 3:] = -cross_matrix(np.array([0.0, 0.0, image_distance_mm])) @ _CAM_TO_PAPER
    return jacobian


def cam_to_paper(points_cam: np.ndarray, image_distance_mm: float) -> np.ndarray:
    """Convert points (..., 3) from the OpenCV camera frame to the paper's: (x, −y, f − z)."""
    return np.asarray(points_cam, dtype=float) * [1.0, -1.0, -1.0] + [0.0, 0.0, image_distance_mm]


def world_to_cam(points: np.ndarray, cam2world: np.ndarray) -> np.ndarray:
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
    points = np.asarray(points, dtype=float)
    cam2world = np.asarray(cam2world, dtype=float)
    poses = cam2world.reshape(-1, 4, 4)
    flat = points.reshape(-1, 3)
    local = (flat[None] - poses[:, None, :3, 3]) @ poses[:, :3, :3]
    return local.reshape(cam2world.shape[:-2] + points.shape)


def aim(positions: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Return rotations (n, 3, 3), cam to world, that look from positions (n, 3) to a target (3,) or (n, 3).

    The camera's x axis is level (perpendicular to the world's z axis) unless it looks along z; then it follows world x.
    """
    return look_at(positions, target)[:, :3, :3]


def look_at(
    positions: np.ndarray,
    target: np.ndarray,
    pan: np.ndarray | float = 0.0,
    tilt: np.ndarray | float = 0.0,
    roll: np.ndarray | float = 0.0,
) -> np.ndarray:
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

    Examples
    --------
    >>> from planner import look_at
    >>> pose = look_at([[0, 0, 100]], [0, 0, 0])[0]
    >>> pose[:3, 2].tolist(), pose[:3, 3].tolist()
    ([0.0, 0.0, -1.0], [0.0, 0.0, 100.0])
    """
    # compiled, and so imported when first needed
    from planner.camera.pose_loops import look_along

    # of one layout, so that one version of the loop is compiled
    positions = np.array(positions, dtype=np.float64, order="C", ndmin=2)
    n = len(positions)
    # copied, so that the loop is compiled for one kind of array
    target = np.array(np.broadcast_to(target, (n, 3)), dtype=np.float64, order="C")
    turns = np.empty((3, n))
    turns[0] = pan
    turns[1] = tilt
    turns[2] = roll
    cam2world = np.zeros((n, 4, 4))
    look_along(positions, target, turns, cam2world)
    return cam2world


def pose_between(first: np.ndarray, last: np.ndarray, part: float) -> np.ndarray:
    """Return the pose (4, 4) after a part of the straight way and of the turn to another one, less than half a turn."""
    turn = [
        [math.fsum(float(first[k, i] * last[k, j]) for k in range(3)) for j in range(3)]
        for i in range(3)
    ]
    axis = [turn[2][1] - turn[1][2], turn[0][2] - turn[2][0], turn[1][0] - turn[0][1]]
    twice_sine = math.hypot(*axis)
    angle = math.atan2(twice_sine, turn[0][0] + turn[1][1] + turn[2][2] - 1.0)
    share = part * angle / twice_sine if twice_sine > 0.0 else 0.0
    between = moved(first, np.array([[0.0, 0.0, 0.0, *(share * x for x in axis)]]), 1.0)[0]
    between[:3, 3] = first[:3, 3] + part * (last[:3, 3] - first[:3, 3])
    return np.asarray(between)


def moved(cam2world: np.ndarray, moves: np.ndarray, unit_mm: float) -> np.ndarray:
    """Return the poses (n, 4, 4) reached from one pose (4, 4) by moves (n, 6) along and about its own axes.

    The first three entries are a translation in units of `unit_mm`, the others a rotation vector in rad.
    """
    from planner.camera.pose_loops import move

    poses = np.zeros((len(moves), 4, 4))
    move(cam2world, moves, unit_mm, poses)
    return poses
