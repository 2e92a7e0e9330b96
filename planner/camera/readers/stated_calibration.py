"""What a reader returns, and the checks that all readers share."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from planner.exceptions import CameraError

# tangent of half the field of view; lenses of the pinhole model see at most some 160 degrees
_WIDEST_TANGENT = 10.0


class Calibration(NamedTuple):
    """A camera as its calibration states it.

    Attributes
    ----------
    matrix : ndarray of shape (3, 3)
        Camera matrix K in OpenCV's convention, px of the delivered image.
    distortion : list of float or None
        Coefficients in OpenCV's order.
    image_size : tuple of int
        Width and height of the delivered image, px.
    binning : tuple of int
        How many pixels of the sensor make one of the image, across and down.
    """

    matrix: NDArray[np.float64]
    distortion: list[float] | None
    image_size: tuple[int, int]
    binning: tuple[int, int] = (1, 1)


def camera_matrix(fx: float, fy: float, cx: float, cy: float) -> NDArray[np.float64]:
    """Return the camera matrix of two scales and a principal point, px."""
    return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])


def check_finite(where: str, values: list[float], names: tuple[str, ...]) -> None:
    """Refuse a number that is NaN or infinite.

    Parameters
    ----------
    where : str
        File and field, as the message names them.
    values : list of float
        The numbers.
    names : tuple of str
        What each of them is.

    Raises
    ------
    CameraError
        If a number is not finite.
    """
    for value, name in zip(values, names, strict=False):
        if not math.isfinite(value):
            raise CameraError(f"{where} must hold finite numbers. Got {value} for {name}.")


def check_pixels(where: str, matrix: NDArray[np.float64], image_size: tuple[int, int]) -> None:
    """Refuse focal lengths that are not in pixels or not there, and a principal point elsewhere.

    Parameters
    ----------
    where : str
        File and field, as the message names them.
    matrix : ndarray of shape (3, 3)
        Camera matrix.
    image_size : tuple of int
        Width and height, px.

    Raises
    ------
    CameraError
        If a focal length is not positive, or so short that the lens would see all of a half space,
        or the principal point is not in the image.
    """
    for focal, size in zip((matrix[0, 0], matrix[1, 1]), image_size, strict=True):
        if not focal > 0.0:
            hint = ": the camera was not calibrated" if focal == 0.0 else ""
            raise CameraError(f"{where} must hold positive focal lengths. Got {focal:g}{hint}.")
        if size > 2.0 * _WIDEST_TANGENT * focal:
            raise CameraError(
                f"{where} must hold focal lengths in pixels. "
                f"Got {focal:g} for an image of {size} pixels."
            )
    if not is_in_image(matrix, image_size):
        raise CameraError(
            f"{where} must hold a principal point in the image of {image_size[0]} x "
            f"{image_size[1]} pixels. Got ({matrix[0, 2]:g}, {matrix[1, 2]:g})."
        )


def is_in_image(matrix: NDArray[np.float64], image_size: tuple[int, int]) -> bool:
    """Tell whether the principal point of a camera matrix is in an image, px."""
    width, height = image_size
    return bool(-0.5 < matrix[0, 2] < width - 0.5 and -0.5 < matrix[1, 2] < height - 0.5)
