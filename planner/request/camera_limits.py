"""What a camera leaves to a plan: reserves of focus and motion, and defaults that follow from it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from numbers import Integral
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr

from planner.argument_kinds import NOT_NEGATIVE, check_count, check_number
from planner.camera.camera import Camera
from planner.camera.pose import PoseUncertainty
from planner.detectability.conditions import Detectability
from planner.exceptions import RequestError

if TYPE_CHECKING:
    from aspectgraph import Solid

# How much of its room a condition leaves: its slack as a share of what a practitioner would call
# full.
#
# The room of each condition, by the name of its margin:
#
# focus_mm half the depth of field, less the reserve on the axis field_of_view_px half the
# sensor's shorter side, less the strip along its sides resolution_mm the least length that is
# asked for clearance_mm the stand-off workspace_mm a tenth of the workspace's shortest side
# separation_px the separation asked for corner_deg the angle asked for
#
# The room of a probability is 1 - p. A share of 0 is at the limit. What is met or missed without
# a number, such as visibility, has no share.


# The reserve of focus: how far from the limits of the depth of field a point stays, so that it is
# sharp after all.
#
# A camera that is moved by t and turned by φ sees a point (x, y, z) of its own frame at the depth
#
# z - t_z + x φ_y - y φ_x        (first order; e.g. 100 mm off the axis, 1 mrad is .1 mm)
#
# so the variance of the depth is r Σ rᵀ with r = (0, 0, 1, y, -x, 0) and the pose's covariance Σ.
# It grows with the distance from the axis, and each point has a reserve of its own. The standard
# deviation is the length of a vector linear in (x, y), hence convex; where both ends of a segment
# keep their standard deviations, all of its points do.


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
        ceiling = np.maximum(self.most_mm, self.least_sigmas * sigma)
        return np.asarray(np.minimum(self.sigmas * sigma, ceiling))


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


# What every feasible setting satisfies, whatever its pose: the home of each necessary condition.
#
# Notation of `planner.request.constraints`: D_min, D_max the depth of field, d the image
# distance, θ the angle between the optical axis and the sensor's corner.


def focus_reach_mm(camera: Camera) -> tuple[float, float]:
    """Return the smallest and largest distance from the camera of a point that is sharp and in the image.

    A point at depth z is at most z / cos θ away, so the distances are D_min and D_max / cos θ.

    Parameters
    ----------
    camera : Camera
        Gives D_min, D_max and θ.

    Returns
    -------
    tuple of float
        Distances in mm; the larger one may be infinite.
    """
    nearest, farthest = camera.depth_of_field_mm
    return nearest, farthest / float(np.cos(camera.half_diagonal_rad))


def longest_image_mm(camera: Camera, lengths_mm: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how long the images of segments can be where the lens focuses.

    The projection stretches by at most d / (z·cos θ) at depth z, so no image is longer than d·L / (D_min·cos θ).

    Parameters
    ----------
    camera : Camera
        Gives d, D_min and θ.
    lengths_mm : array
        Lengths L of the segments, mm.

    Returns
    -------
    array
        Lengths on the sensor, mm, in the shape of ``lengths_mm``.
    """
    return lengths_mm * (
        camera.image_distance_mm
        / (camera.depth_of_field_mm[0] * math.cos(camera.half_diagonal_rad))
    )


def widest_view_mm(camera: Camera) -> float:
    """Return how far apart two points of one sharp image can be, mm.

    All of them lie between D_min and D_max in the pyramid of the image, so no two are farther apart than two of its
    corners.
    """
    nearest, farthest = camera.depth_of_field_mm
    slope = math.tan(camera.half_diagonal_rad)
    return max(2 * slope * farthest, math.hypot(slope * (nearest + farthest), farthest - nearest))


def boxes_reach(
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    points: NDArray[np.float64],
    near: float,
    far: float,
) -> NDArray[np.bool_]:
    """Return which boxes can hold a viewpoint at a distance in [near, far] of each of some points.

    Parameters
    ----------
    low, high : array (m, 3)
        Corners of the boxes, mm.
    points : array (p, 3)
        The points, mm.
    near, far : float
        See `focus_reach_mm`.

    Returns
    -------
    array of bool (m,)
        For every point alone; a box that reaches each may still hold no viewpoint that reaches all.
    """
    reaches = np.ones(len(low), dtype=bool)
    for point in points:
        closest = np.linalg.norm(np.maximum(np.maximum(low - point, point - high), 0.0), axis=1)
        remotest = np.linalg.norm(np.maximum(np.abs(low - point), np.abs(high - point)), axis=1)
        reaches &= (closest <= far) & (remotest >= near)
    return reaches


FULL = 1.0
"""Share beyond which more room is of no use."""

_WALL_SHARE = 10.0


def rooms(
    camera: Camera,
    workspace: NDArray[np.float64],
    requirements: Mapping[str, float],
    focus_reserve_mm: float = 0.0,
) -> dict[str, float]:
    """Return the room of each condition, in its own unit, by the name of its margin.

    Parameters
    ----------
    camera : Camera
        Gives depth of field and sensor.
    workspace : array (2, 3)
        Lowest and highest corner, mm.
    requirements : mapping of str to float
        As `Requirements.to_dict` returns them; conditions that it does not name have no room.
    focus_reserve_mm : float
        What points on the axis keep from both limits of the depth of field.
    """
    near, far = camera.depth_of_field_mm
    depth = (far - near) / 2 if np.isfinite(far) else camera.focus_distance_mm
    border_px = requirements.get("field_margin_px", 0.0) + requirements.get("surround_px", 0.0)
    room_by_name = {
        "focus_mm": depth - max(focus_reserve_mm, requirements.get("focus_margin_mm", 0.0)),
        "field_of_view_px": min(camera.resolution) / 2 - border_px,
        "resolution_mm": requirements.get("min_length_px", 0.0) * max(camera.pixel_pitch_mm),
        "clearance_mm": requirements.get("stand_off_mm", 0.0),
        "workspace_mm": float(np.ptp(np.asarray(workspace), axis=0).min()) / _WALL_SHARE,
        "separation_px": requirements.get("separation_px", 0.0),
        "corner_deg": requirements.get("min_corner_deg", 0.0),
    }
    return {name: float(room) for name, room in room_by_name.items() if room > 0.0}


def shares(margins: Mapping[str, Any], room: Mapping[str, float]) -> dict[str, NDArray[np.float64]]:
    """Return margins as shares of their rooms, `FULL` at most; of those conditions that have one."""
    return {
        name: np.minimum(np.asarray(margin) / room[name], FULL)
        for name, margin in margins.items()
        if name in room
    }


def probability_share(probability: ArrayLike, required: float) -> Any:
    """Return (P - p) / (1 - p) of probabilities, p the required one."""
    return (np.asarray(probability) - required) / (1.0 - required)


# What a request takes where nothing is said, and checks of what is said.


MOST_SEED = 10**300
"""Largest seed: plan.json holds no longer numbers."""


def default_workspace(solid: Solid, camera: Camera) -> np.ndarray:
    """Return the default workspace: a box around a part, as large as the lens can focus.

    Parameters
    ----------
    solid : Solid
        The part.
    camera : Camera
        Its depth of field and field of view limit the distance from the part.

    Returns
    -------
    array, shape (2, 3)
        Lowest and highest corner, mm. The box extends beyond the part's box by the same distance in
        all directions. This is the far limit of the depth of field in the image's corners. It is at
        most ten focus distances and at least the part's diagonal.

    Examples
    --------
    >>> from aspectgraph import read_solid
    >>> from planner import Camera, default_workspace
    >>> block = read_solid("examples/two_pocket_block.off")
    >>> box = default_workspace(block, Camera.named("basler-acA2440-20gm-8mm"))
    >>> bool((box[0] < block.bounds[0]).all() and (box[1] > block.bounds[1]).all())
    True
    """
    size = float(np.linalg.norm(solid.bounds[1] - solid.bounds[0]))
    distance = min(focus_reach_mm(camera)[1], 10 * camera.focus_distance_mm)
    return solid.bounds + np.array([[-1.0], [1.0]]) * max(distance, size)


def corner_margin_px(
    camera: Camera, pose_uncertainty: PoseUncertainty, sigmas: float = 4.0
) -> float:
    """Return the strip along the sensor's sides that pose uncertainty cannot take an image point across.

    An end that leaves the image cannot be measured, whatever its probability of being measured accurately. A camera
    moved by t and turned by phi moves the image (u, v) of a point at depth z, in units of the image distance, by
    (-t_x/z + u t_z/z + u v phi_x - (1 + u^2) phi_y + v phi_z, likewise down). The worst corner at the nearest depth
    counts.

    Parameters
    ----------
    camera : Camera
    pose_uncertainty : PoseUncertainty
    sigmas : float
        Width of the strip in standard deviations.

    Returns
    -------
    float
        Pixels; at most a quarter of the sensor's smaller side, so that something of it is left.
    """
    z = camera.depth_of_field_mm[0]
    widest = 0.0
    half = np.array(camera.sensor_size_mm) / 2 / camera.image_distance_mm
    stretch = 1.0
    if not camera.is_centred:
        (x_low, y_low, x_high, y_high) = camera.field().outer
        stretch = camera.field().most_stretch
        half = np.array([max(-x_low, x_high), max(-y_low, y_high)])
    for u, v in half * [[1, 1], [1, -1]]:
        across = [-1 / z, 0, u / z, u * v, -(1 + u * u), v]
        down = [0, -1 / z, v / z, 1 + v * v, -u * v, -u]
        for row, pitch in zip((across, down), camera.pixel_pitch_mm, strict=True):
            variance = np.array(row) @ pose_uncertainty.covariance @ row
            widest = max(
                widest, camera.image_distance_mm / pitch * float(np.sqrt(max(variance, 0.0)))
            )
    return min(sigmas * stretch * widest, min(camera.resolution) / 4)


def check_focus_margin(margin_mm: float, camera: Camera) -> float:
    """Return a margin that leaves something of the depth of field, or raise `RequestError`.

    Parameters
    ----------
    margin_mm : float
        Taken from both ends of the depth of field, mm.
    camera : Camera
        Gives the depth of field.

    Returns
    -------
    float
        The margin.

    Raises
    ------
    RequestError
        If it is negative, not finite, or at least half the depth of field.
    """
    nearest, farthest = camera.depth_of_field_mm
    check_number("focus_margin_mm", margin_mm, NOT_NEGATIVE)
    if not 2 * margin_mm < farthest - nearest:
        raise RequestError.of_rule(
            "focus_margin_mm",
            f"must be less than half the depth of field, {farthest - nearest:.4g} mm",
            f"{margin_mm:g}",
        )
    return float(margin_mm)


def check_seed(rng: object) -> int:
    """Return a seed: the integer itself, or one drawn from the generator."""
    if isinstance(rng, np.random.Generator):
        return int(rng.integers(2**31))
    if isinstance(rng, bool) or not isinstance(rng, Integral) or rng < 0:
        raise RequestError.of_rule(
            "rng", "must be a non-negative integer or a numpy Generator", repr(rng)
        )
    check_count("rng", rng, 0, MOST_SEED)
    return int(rng)


def pose_margin_px(camera: Camera, pose_uncertainty: PoseUncertainty) -> float:
    """Return three standard deviations, in px, of how far the pose uncertainty moves the image of a point.

    The point is on the optical axis at the focus distance; the axis with the finer pitch or larger spread counts.
    """
    d = camera.image_distance_mm
    s = camera.focus_distance_mm
    # a camera moved by dx and turned by phi_y about its nodal point moves the image of (0, 0, s) by −d·(dx/s + phi_y)
    rows = (
        np.array([[1 / s, 0, 0, 0, 1, 0], [0, 1 / s, 0, -1, 0, 0]])
        * (d / np.array(camera.pixel_pitch_mm))[:, None]
    )
    variances = np.diag(rows @ pose_uncertainty.covariance @ rows.T)
    return 3.0 * math.sqrt(max(variances.max(), 0.0))


def position_margin_mm(pose_uncertainty: PoseUncertainty) -> float:
    """Return three standard deviations of the position, in mm, in the direction where it is least certain."""
    return 3.0 * math.sqrt(
        max(float(np.linalg.eigvalsh(pose_uncertainty.covariance[:3, :3]).max()), 0.0)
    )


def check_showing(showing: Detectability, camera: Camera) -> Detectability:
    """Return conditions that fit into the image, or raise `RequestError`.

    Parameters
    ----------
    showing : Detectability
        What is asked of the image.
    camera : Camera
        Gives the image.

    Returns
    -------
    Detectability
        The conditions.

    Raises
    ------
    RequestError
        If it is something else, or lines or surroundings are wider than the image.
    """
    if not isinstance(showing, Detectability):
        raise RequestError.of_rule("showing", "must be a Detectability", repr(showing))
    side = min(camera.resolution)
    for name in ("separation_px", "surround_px"):
        value = getattr(showing, name)
        if 2 * value >= side:
            raise RequestError.of_rule(
                name, f"must be less than half the image's smaller side, {side} px", f"{value:g}"
            )
    return showing
