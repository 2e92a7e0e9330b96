"""Where a camera images points, and what a lens without distortion would have imaged there."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planner.camera.camera import Camera

# what is rounded to the last pixel lies half a pixel off the sensor, with a random phase a whole one
_BEYOND_PX = 1.0


def image_of(camera: Camera, directions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return where points are imaged.

    Parameters
    ----------
    camera : Camera
        The camera.
    directions : array (..., 3)
        Points in its frame over their depth, (x/z, y/z, 1).

    Returns
    -------
    array (..., 2)
        Pixels of the real, distorted image; nan where a lens with distortion has no field of view.
    """
    matrix = camera.matrix
    if camera.distortion is None:
        return np.asarray((directions @ matrix.T)[..., :2])
    x_low, y_low, x_high, y_high = camera.field(-_BEYOND_PX).outer
    x = directions[..., 0]
    y = directions[..., 1]
    inside = ((x >= x_low) & (x <= x_high) & (y >= y_low) & (y <= y_high))[..., None]
    distorted = camera.distortion.distort(np.where(inside, directions[..., :2], 0.0))
    return np.where(inside, distorted * np.diag(matrix)[:2] + matrix[:2, 2], np.nan)


def tangents_of(camera: Camera, pixels: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the directions that are seen at some pixels.

    Parameters
    ----------
    camera : Camera
        The camera.
    pixels : array (..., 2)
        Pixels of the real image.

    Returns
    -------
    array (..., 2)
        x/z and y/z; nan more than a pixel off the sensor where the lens distorts.
    """
    scale = np.diag(camera.matrix)[:2]
    centre = camera.matrix[:2, 2]
    if camera.distortion is None:
        return np.asarray((pixels - centre) / scale)
    limit = np.array(camera.resolution) - 0.5 + _BEYOND_PX
    inside = np.all((pixels >= -0.5 - _BEYOND_PX) & (pixels <= limit), axis=-1, keepdims=True)
    ideal = camera.distortion.undistort(np.where(inside, (pixels - centre) / scale, 0.0))
    return np.where(inside, ideal, np.nan)


def undistorted_px(camera: Camera, pixels: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return where a lens without distortion would have imaged what is seen at some pixels.

    Parameters
    ----------
    camera : Camera
        The camera.
    pixels : array (..., 2)
        Pixels of the real image.

    Returns
    -------
    array (..., 2)
        Pixels of the undistorted image; nan more than a pixel off the sensor where the lens distorts.
    """
    if camera.distortion is None:
        return pixels
    return tangents_of(camera, pixels) * np.diag(camera.matrix)[:2] + camera.matrix[:2, 2]
