"""Products of poses, summed in one order everywhere: what BLAS adds up differs between its versions."""

from __future__ import annotations

from typing import Any

import numpy as np

from planner.argument_kinds import shown
from planner.exceptions import RobotError

_ROTATION = 2e-6
"""Rounding a rotation to 6 decimals changes R·Rᵀ by at most 5e-7 · 2√3 = 1.74e-6."""
_POLAR = 2
_NO_NOISE = 1e-14


def compose(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return the poses (..., 4, 4) first · second; shapes broadcast."""
    return np.einsum("...ij,...jk->...ik", first, second)


def invert(pose: np.ndarray) -> np.ndarray:
    """Return the inverses of poses (..., 4, 4)."""
    result = np.zeros_like(pose)
    turned = np.swapaxes(pose[..., :3, :3], -1, -2)
    result[..., :3, :3] = turned
    result[..., :3, 3] = -np.einsum("...ij,...j->...i", turned, pose[..., :3, 3])
    result[..., 3, 3] = 1.0
    return result


def carry(pose: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return points (m, 3) moved by poses (..., 4, 4); (..., m, 3)."""
    return np.einsum("...ij,mj->...mi", pose[..., :3, :3], points) + pose[..., None, :3, 3]


def from_rpy(xyz: np.ndarray, rpy: np.ndarray) -> np.ndarray:
    """Return a pose (4, 4) of URDF's numbers: turned about fixed x, then y, then z, then shifted."""
    roll, pitch, yaw = (float(angle) for angle in rpy)
    cr = np.cos(roll)
    sr = np.sin(roll)
    cp = np.cos(pitch)
    sp = np.sin(pitch)
    cy = np.cos(yaw)
    sy = np.sin(yaw)
    pose = np.eye(4)
    pose[:3, :3] = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    pose[:3, 3] = xyz
    return pose


def to_axis(axis: np.ndarray) -> np.ndarray:
    """Return a pose (4, 4) without shift whose z axis is a unit vector; the identity for z itself."""
    pose = np.eye(4)
    if np.array_equal(axis, (0.0, 0.0, 1.0)):
        return pose
    least = np.zeros(3)
    least[int(np.abs(axis).argmin())] = 1.0
    across = np.cross(least, axis)
    across /= np.sqrt((across**2).sum())
    pose[:3, 0] = across
    pose[:3, 1] = np.cross(axis, across)
    pose[:3, 2] = axis
    return pose


def about(axis: np.ndarray, angle: float) -> np.ndarray:
    """Return the rotation (3, 3) about a unit vector, by the formula of Rodrigues."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return (
        np.eye(3)
        + np.sin(angle) * cross
        + (1 - np.cos(angle)) * np.einsum("ij,jk->ik", cross, cross)
    )


def check_rotations(name: str, value: np.ndarray) -> np.ndarray:
    """Return poses (..., 4, 4) with the rotations nearest to theirs; those without noise stay as they are.

    The polar factor by the iteration X (3 - XᵀX) / 2 of Björck and Bowie (1971): an error e becomes 3/4 e².

    Raises
    ------
    RobotError
        A rotation is none to 6 decimals.
    """
    poses = np.array(value, dtype=np.float64)
    turns = poses[..., :3, :3]
    noise = np.abs(np.einsum("...ij,...kj->...ik", turns, turns) - np.eye(3)).max(axis=(-2, -1))
    if not (noise <= _ROTATION).all():
        wrong = turns[~(noise <= _ROTATION)][0]
        hint = "give 6 decimals, or divide the columns by the scale"
        raise RobotError.of_rule(name, "must hold a rotation", shown(wrong.tolist()), hint=hint)
    is_noisy = noise > _NO_NOISE
    noisy = turns[is_noisy]
    for _ in range(_POLAR):
        square = np.einsum("nji,njk->nik", noisy, noisy)
        noisy = 1.5 * noisy - 0.5 * np.einsum("nij,njk->nik", noisy, square)
    turns[is_noisy] = noisy
    return poses


def check_pose(name: str, value: Any) -> np.ndarray:
    """Return a pose (4, 4) with the nearest rotation, or raise `RobotError` if it is no rigid motion.

    A rotation is one to 6 decimals. What is left of its digits' noise is taken out.

    Raises
    ------
    RobotError
        Shape, a number that is not finite, the last row, a mirror image or a rotation that is none.
    """
    try:
        pose = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        pose = np.empty(0)
    if pose.shape != (4, 4):
        got = str(pose.shape) if pose.size else shown(value)
        raise RobotError.of_rule(name, "must have shape (4, 4)", got)
    if not np.isfinite(pose).all():
        raise RobotError.of_rule(name, "must hold finite numbers", shown(pose.tolist()))
    if not np.array_equal(pose[3], (0.0, 0.0, 0.0, 1.0)):
        raise RobotError.of_rule(name, "must have the last row 0 0 0 1", shown(pose[3].tolist()))
    pose = check_rotations(name, pose)
    turn = pose[:3, :3]
    handed = float(np.einsum("i,i->", np.cross(turn[0], turn[1]), turn[2]))
    if handed < 0:
        hint = "an axis points the wrong way"
        raise RobotError.of_rule(
            name, "must have a determinant of 1, not a mirror image", "-1", hint=hint
        )
    pose.flags.writeable = False
    return pose
