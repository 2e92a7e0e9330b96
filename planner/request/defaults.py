"""What a request takes where nothing is said, and checks of what is said."""

from __future__ import annotations

import math
from numbers import Integral
from typing import TYPE_CHECKING

import numpy as np

from planner.argument_kinds import NOT_NEGATIVE, check_count, check_number
from planner.camera.camera import Camera
from planner.camera.pose import PoseUncertainty
from planner.detectability.conditions import Detectability
from planner.exceptions import RequestError
from planner.request.camera_limits import focus_reach_mm

if TYPE_CHECKING:
    from aspectgraph import Solid


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
