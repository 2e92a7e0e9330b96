"""What every feasible setting satisfies, whatever its pose: the home of each necessary condition.

Notation of `planner.request.constraints`: D_min, D_max the depth of field, d the image distance, θ the angle between
the optical axis and the sensor's corner.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from planner.camera.camera import Camera


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
