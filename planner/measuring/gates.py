"""What every pose must keep to, however it is known: it is rigid, near the planned one, and one for all images.

Each limit is passed by 999 of 1,000 poses that are as the plan states.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation
from scipy.stats import chi2 as chi_squared

from planner.exceptions import RequestError
from planner.measuring.samples import POSE
from planner.measuring.task import NotRegisteredError
from planner.plan_file import shown

Array = NDArray[np.float64]

CREDIBLE = 0.999
"""What is less probable than 1 minus this is not taken for chance."""
MOST_CHI2 = 22.5
"""Largest square of a pose's displacement in standard deviations of what is stated: 1 in 1,000 poses is beyond."""
MOVE_SIGMAS = 10.0
"""A camera may move between images so many standard deviations of its planned pose, where this is looked for."""

_RIGID = 1e-6
# far beyond any workspace; products of larger numbers overflow
_MOST_MM = 1e6


class TooFarError(NotRegisteredError):
    """A pose is too far from where something else says it is."""


def rigid_motion(value: ArrayLike, name: str) -> Array:
    """Return a pose (4, 4), mm.

    Parameters
    ----------
    value : array (4, 4)
        The pose.
    name : str
        What the caller calls it.

    Raises
    ------
    RequestError
        If it is no rigid motion.
    """
    try:
        pose = np.array(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        pose = np.empty(0)
    if pose.shape != (4, 4) or not np.isfinite(pose).all():
        raise RequestError.of_rule(name, "must be a matrix (4, 4) of numbers", _text(value))
    turn = pose[:3, :3]
    # beyond this, products overflow before they can be compared
    small = np.abs(turn).max() <= 2
    orthonormal = small and np.abs(turn @ turn.T - np.eye(3)).max() < _RIGID
    if not orthonormal or not np.array_equal(pose[3], [0.0, 0.0, 0.0, 1.0]):
        raise RequestError.of_rule(name, "must be a rotation and a translation", "another")
    if np.linalg.det(turn) < 0:
        raise RequestError.of_rule(name, "must be a rotation and a translation", "a mirrored one")
    if np.abs(pose[:3, 3]).max() > _MOST_MM:
        raise RequestError.of_rule(
            name, f"must be within {_MOST_MM:g} mm", _text(pose[:3, 3].tolist())
        )
    return pose


def _text(value: ArrayLike) -> str:
    return shown(value.tolist() if isinstance(value, np.ndarray) else value)


def distance_of(displacement: Array, covariance: Array) -> float:
    """Return the square of a displacement (n,) in standard deviations of its covariance (n, n)."""
    sigmas = np.sqrt(np.diag(covariance))
    # millimetres and radians are far apart
    units = displacement / sigmas
    return float(units @ np.linalg.solve(covariance / np.outer(sigmas, sigmas), units))


def displacement_between(planned: Array, pose: Array) -> Array:
    """Return by what (6,) a pose is displaced from the planned one, mm and rad, in the camera's own frame."""
    step = np.linalg.inv(planned) @ pose
    return np.concatenate([step[:3, 3], Rotation.from_matrix(step[:3, :3]).as_rotvec()])


def check_distance(chi2: float, what: str = "its pose", place: str = "the planned one") -> None:
    """Refuse a pose that is too far from another one.

    Parameters
    ----------
    chi2 : float
        Square of its displacement in standard deviations, see `distance_of`.
    what, place : str
        What is too far, and from where.

    Raises
    ------
    TooFarError
        If that is beyond the limit, or no number.
    """
    if not chi2 <= MOST_CHI2:
        raise TooFarError(f"{what} is {np.sqrt(chi2):.1f} standard deviations away from {place}")


def check_one_pose(names: Sequence[str], moves: Array, covariance: Array) -> None:
    """Refuse images of one setting that are from different poses.

    Parameters
    ----------
    names : sequence of str
        The images (n).
    moves : array (6 (n - 1),)
        Displacements of the camera in all but the first, as they were found.
    covariance : array
        Joint covariance of unknowns, of which these are the last ones.

    Raises
    ------
    NotRegisteredError
        If a displacement is beyond the limit.
    """
    most = chi_squared.ppf(CREDIBLE, POSE)
    first = len(covariance) - len(moves)
    for k, name in enumerate(names[1:]):
        own = slice(POSE * k, POSE * (k + 1))
        at = slice(first + own.start, first + own.stop)
        chi2 = distance_of(moves[own], covariance[at, at])
        if not chi2 <= most:
            raise NotRegisteredError(
                f"{names[0]} and {name} are from different poses: the camera moved by "
                f"{np.sqrt(chi2):.1f} standard deviations between them"
            )
