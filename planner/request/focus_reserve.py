"""The reserve of focus: how far from the limits of the depth of field a point stays, so that it is sharp after all.

A camera that is moved by t and turned by φ sees a point (x, y, z) of its own frame at the depth

    z - t_z + x φ_y - y φ_x        (first order; e.g. 100 mm off the axis, 1 mrad is .1 mm)

so the variance of the depth is r Σ rᵀ with r = (0, 0, 1, y, -x, 0) and the pose's covariance Σ. It grows with the
distance from the axis, and each point has a reserve of its own. The standard deviation is the length of a vector linear
in (x, y), hence convex; where both ends of a segment keep their standard deviations, all of its points do.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr

from planner.camera.camera import Camera
from planner.camera.pose_uncertainty import PoseUncertainty

SIGMAS = 3.0
"""Standard deviations of its depth that a point keeps from both limits, where the depth of field has room for them."""

LEAST_SIGMAS = 1.645
"""What it keeps at least, however narrow the depth of field: one limit is kept in 95 % of poses, both in 90 %."""

_SHARE = 8.0


class FocusReserve(NamedTuple):
    """How far a point stays from both limits of the depth of field: a multiple of its own standard deviation.

    With the standard deviation s of its depth that is min(sigmas·s, max(most_mm, least_sigmas·s)). More than an eighth
    of the depth of field at either end would leave too little of a narrow one, so ``most_mm`` is that.

    Parameters
    ----------
    sigmas, least_sigmas : float
        See `SIGMAS` and `LEAST_SIGMAS`. 0: there is no such reserve.
    most_mm : float
        An eighth of the depth of field; infinite where that has no end.
    along, along_x, along_y, turn_x, turn_xy, turn_y : float
        Covariance of the displacement t_z, φ_x, φ_y: (t_z, t_z), (t_z, φ_x), (t_z, φ_y), (φ_x, φ_x), (φ_x, φ_y),
        (φ_y, φ_y), in mm², mm·rad and rad².
    """

    sigmas: float = 0.0
    least_sigmas: float = 0.0
    most_mm: float = 0.0
    along: float = 0.0
    along_x: float = 0.0
    along_y: float = 0.0
    turn_x: float = 0.0
    turn_xy: float = 0.0
    turn_y: float = 0.0

    @classmethod
    def of(cls, camera: Camera, pose_uncertainty: PoseUncertainty) -> FocusReserve:
        """Return the reserve where nothing is said.

        Parameters
        ----------
        camera : Camera
            Gives the depth of field.
        pose_uncertainty : PoseUncertainty
            Gives the covariance.
        """
        nearest, farthest = camera.depth_of_field_mm
        cov = pose_uncertainty.covariance
        pairs = [(2, 2), (2, 3), (2, 4), (3, 3), (3, 4), (4, 4)]
        return cls(
            SIGMAS,
            LEAST_SIGMAS,
            (farthest - nearest) / _SHARE,
            *(float(cov[i, j]) for i, j in pairs),
        )

    @property
    def on_axis_mm(self) -> float:
        """The reserve of a point on the optical axis, mm, where turns do not matter."""
        return float(self.margin_mm([0.0, 0.0, 1.0]))

    def sigma_mm(self, points_cam: ArrayLike) -> NDArray[np.float64]:
        """Return the standard deviation of the depth of points.

        Parameters
        ----------
        points_cam : array-like, shape (..., 3)
            Points in the camera's frame, mm.

        Returns
        -------
        array, shape (...)
            Standard deviations, mm.
        """
        points = np.asarray(points_cam, dtype=np.float64)
        x = points[..., 0]
        y = points[..., 1]
        variance = (
            self.along
            + 2.0 * (y * self.along_x - x * self.along_y)
            + y * y * self.turn_x
            + x * x * self.turn_y
            - 2.0 * x * y * self.turn_xy
        )
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)))

    def margin_mm(self, points_cam: ArrayLike) -> NDArray[np.float64]:
        """Return how far points stay from both limits of the depth of field.

        Parameters
        ----------
        points_cam : array-like, shape (..., 3)
            Points in the camera's frame, mm.

        Returns
        -------
        array, shape (...)
            Reserves, mm.
        """
        sigma = self.sigma_mm(points_cam)
        most = np.maximum(self.most_mm, self.least_sigmas * sigma)
        return np.asarray(np.minimum(self.sigmas * sigma, most))


NO_RESERVE = FocusReserve()


def probability_between(
    to_near_mm: ArrayLike, to_far_mm: ArrayLike, sigma_mm: ArrayLike
) -> NDArray[np.float64]:
    """Return the probability that a normal depth stays between two limits at these distances; 0 or 1 without spread."""
    near = np.asarray(to_near_mm, dtype=np.float64)
    far = np.asarray(to_far_mm, dtype=np.float64)
    sigma = np.asarray(sigma_mm, dtype=np.float64)
    surely = np.where(np.minimum(near, far) >= 0.0, np.inf, -np.inf)
    spread = sigma > 0.0
    low = np.divide(near, sigma, out=surely.copy(), where=spread)
    high = np.divide(far, sigma, out=surely.copy(), where=spread)
    return np.asarray(np.maximum(ndtr(low) - ndtr(-high), 0.0))


def sigmas_left(points_cam: ArrayLike, camera: Camera, pose_uncertainty: PoseUncertainty) -> float:
    """Return how many standard deviations of its own depth the least sure point is from a limit of focus.

    Parameters
    ----------
    points_cam : array-like, shape (n, 3)
        Points in the camera's frame, mm.
    camera : Camera
        Gives the depth of field.
    pose_uncertainty : PoseUncertainty
        Gives the standard deviations.

    Returns
    -------
    float
        Negative if a point is out of focus; infinite without uncertainty.
    """
    nearest, farthest = camera.depth_of_field_mm
    depth = np.asarray(points_cam, dtype=np.float64)[..., 2]
    sigma = FocusReserve.of(camera, pose_uncertainty).sigma_mm(points_cam)
    slack = np.minimum(depth - nearest, farthest - depth)
    sure = np.where(slack >= 0.0, math.inf, -math.inf)
    return float(np.divide(slack, sigma, out=sure, where=sigma > 0.0).min(initial=math.inf))
