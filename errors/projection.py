"""Perspective projection in the paper's camera frame (eqs 4-5).

The camera frame has C1 to the right, C2 up and C3 backwards, towards the viewer. The image plane is C3 = 0, the lens
centre is C3 = f, and what is looked at has C3 < 0, so the depth in front of the lens is f - C3. The image is upright.

References
----------
C. C. Yang and F. W. Ciarallo, "Optimized sensor placement for active visual inspection", J. Robotic Systems 18, 2001.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from errors.checks import check_endpoints, check_points, check_positive


def project(points: ArrayLike, *, focal_length_mm: float) -> NDArray[np.float64]:
    """Project camera-frame points onto the image plane, eqs 4-5: u = f C1 / (f - C3), v = f C2 / (f - C3).

    Parameters
    ----------
    points : array-like, shape (..., 3)
        Points in the paper's camera frame, in mm.
    focal_length_mm : float
        Distance from the image plane to the lens centre, in mm.

    Returns
    -------
    array, shape (..., 2)
        Image coordinates (u, v) in mm.

    Raises
    ------
    BehindLensError
        If a point has C3 >= focal_length_mm.
    InvalidParameterError
        If a value is not finite or the focal length is not positive.

    Examples
    --------
    >>> from errors import project
    >>> project([10.0, 5.0, -90.0], focal_length_mm=10.0).tolist()
    [1.0, 0.5]
    """
    f = check_positive(focal_length_mm, "focal_length_mm")
    points = check_points(points, f)
    return f * points[..., :2] / (f - points[..., 2:])


def image_segment(
    endpoints: ArrayLike, *, focal_length_mm: float
) -> tuple[NDArray[np.float64] | np.float64, NDArray[np.float64] | np.float64]:
    """Return length and angle of the image of an edge.

    Parameters
    ----------
    endpoints : array-like, shape (..., 2, 3)
        Edge ends in the paper's camera frame, in mm.
    focal_length_mm : float
        Distance from the image plane to the lens centre, in mm.

    Returns
    -------
    length : array, shape (...)
        Image length in mm.
    angle : array, shape (...)
        Angle to the image's horizontal axis in radians, in (-pi, pi].

    Raises
    ------
    BehindLensError, DegenerateSegmentError, InvalidParameterError
        As `success_probability`.

    Examples
    --------
    >>> from errors import image_segment
    >>> length, angle = image_segment([[0, 0, -90], [30, 40, -90]], focal_length_mm=10.0)
    >>> float(length), round(float(angle), 4)
    (5.0, 0.9273)
    """
    f = check_positive(focal_length_mm, "focal_length_mm")
    image = project(check_endpoints(endpoints, f), focal_length_mm=f)
    difference = image[..., 1, :] - image[..., 0, :]
    return np.hypot(difference[..., 0], difference[..., 1]), np.arctan2(
        difference[..., 1], difference[..., 0]
    )
