"""Displacement of an image point when the camera is displaced (eqs 6-11).

Notation
--------
delta = (dx, dy, dz, phi_x, phi_y, phi_z)    C' = C + phi x C + d    (eqs 6-7)
u' - u = N_u / D,  v' - v = N_v / D          (eqs 8-9, exact for this C')

    N_u = f [C1 C2 phi_x + ((f - C3) C3 - C1^2) phi_y - C2 (f - C3) phi_z + (f - C3) dx + C1 dz]
    N_v = f [(C2^2 - (f - C3) C3) phi_x - C1 C2 phi_y + C1 (f - C3) phi_z + (f - C3) dy + C2 dz]
    D   = (f - C3) [(f - C3) - C2 phi_x + C1 phi_y - dz]

N_v follows as N_u does: the numerator f [C2' (f - C3) - C2 (f - C3')] with C2' = C2 + phi_z C1 - phi_x C3 + dy and
C3' = C3 + phi_x C2 - phi_y C1 + dz. For normal delta each component is a ratio of correlated normals (eqs 10-11).

References
----------
C. C. Yang and F. W. Ciarallo, "Optimized sensor placement for active visual inspection", J. Robotic Systems 18, 2001.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from errors.arrays import FloatArray
from errors.checks import check_covariance, check_finite, check_points, check_positive
from errors.exceptions import InvalidShapeError
from errors.ratio import NormalRatio


class DisplacementTerms(NamedTuple):
    """Coefficients of the displacement (dx, dy, dz, phi_x, phi_y, phi_z) in eqs 8-9.

    Attributes
    ----------
    n_u, n_v : array, shape (..., 6)
        N_u = n_u . delta and N_v = n_v . delta.
    d_mean : array, shape (...)
        Denominator at zero displacement, (f - C3)^2, in mm2.
    d : array, shape (..., 6)
        D = d_mean + d . delta.
    """

    n_u: NDArray[np.float64]
    n_v: NDArray[np.float64]
    d_mean: NDArray[np.float64]
    d: NDArray[np.float64]


def displace(points: ArrayLike, displacement: ArrayLike) -> NDArray[np.float64]:
    """Return points as seen from the displaced camera, C' = R(phi) C + d with the exact rotation.

    Parameters
    ----------
    points : array-like, shape (..., 3)
        Points in the paper's camera frame, in mm.
    displacement : array-like, shape (..., 6)
        (dx, dy, dz, phi_x, phi_y, phi_z) in mm and rad, phi a rotation vector; broadcasts against the points.

    Returns
    -------
    array, shape (..., 3)
        Displaced points in mm.

    Raises
    ------
    InvalidShapeError
        If a last dimension is not 3 or 6.
    InvalidParameterError
        If a value is not finite.

    Examples
    --------
    >>> import math
    >>> from errors import displace
    >>> displace([10.0, 0.0, -90.0], [1.0, 2.0, 3.0, 0, 0, math.pi / 2]).round(9).tolist()
    [1.0, 12.0, -87.0]
    """
    points = check_finite(points, "points")
    displacement = check_finite(displacement, "displacement")
    for name, array, size in (("points", points, 3), ("displacement", displacement, 6)):
        if array.ndim < 1 or array.shape[-1] != size:
            raise InvalidShapeError.of_rule(
                name, f"must have shape (..., {size})", f"shape {array.shape}"
            )
    phi = displacement[..., 3:]
    angle = np.linalg.norm(phi, axis=-1, keepdims=True)
    # np.sinc(x) = sin(pi x) / (pi x), finite at 0: Rodrigues' formula without a special case.
    first = np.sinc(angle / np.pi)
    second = 0.5 * np.sinc(0.5 * angle / np.pi) ** 2
    turned = np.cross(phi, points)
    return points + first * turned + second * np.cross(phi, turned) + displacement[..., :3]


def displacement_terms(points: ArrayLike, *, focal_length_mm: float) -> DisplacementTerms:
    """Return numerators and denominator of an image point's displacement, eqs 8-9.

    Parameters
    ----------
    points : array-like, shape (..., 3)
        Points in the paper's camera frame, in mm.
    focal_length_mm : float
        Distance from the image plane to the lens centre, in mm.

    Returns
    -------
    DisplacementTerms
        Linear coefficients, each with the points' leading shape.

    Raises
    ------
    BehindLensError, InvalidParameterError
        As `project`.

    Examples
    --------
    >>> from errors import displacement_terms
    >>> float(displacement_terms([10.0, 0.0, -90.0], focal_length_mm=10.0).d_mean)
    10000.0
    """
    f = check_positive(focal_length_mm, "focal_length_mm")
    c1, c2, c3 = np.moveaxis(check_points(points, f), -1, 0)
    depth = f - c3
    zero = np.zeros_like(c1)
    n_u = f * np.stack([depth, zero, c1, c1 * c2, depth * c3 - c1**2, -c2 * depth], axis=-1)
    n_v = f * np.stack([zero, depth, c2, c2**2 - depth * c3, -c1 * c2, c1 * depth], axis=-1)
    d = depth[..., None] * np.stack([zero, zero, -np.ones_like(c1), -c2, c1, zero], axis=-1)
    return DisplacementTerms(n_u, n_v, depth**2, d)


def point_displacement(
    points: ArrayLike, *, focal_length_mm: float, pose_covariance: ArrayLike
) -> tuple[NormalRatio, NormalRatio]:
    """Return the laws of a point's image displacement along u and along v, eqs 10-11.

    Parameters
    ----------
    points : array-like, shape (..., 3)
        Points in the paper's camera frame, in mm.
    focal_length_mm : float
        Distance from the image plane to the lens centre, in mm.
    pose_covariance : array-like, shape (..., 6, 6)
        Covariance of (dx, dy, dz, phi_x, phi_y, phi_z) in mm and rad.

    Returns
    -------
    along_u : NormalRatio
        Law of the displacement along u in mm, with the points' leading shape.
    along_v : NormalRatio
        The same along v.

    Raises
    ------
    BehindLensError, CovarianceError, InvalidParameterError
        As `success_probability`.

    Examples
    --------
    >>> import numpy as np
    >>> from errors import point_displacement
    >>> covariance = np.diag([0.01, 0.01, 0.0, 0.0, 0.0, 0.0])
    >>> law, _ = point_displacement([0, 0, -90.0], focal_length_mm=10.0, pose_covariance=covariance)
    >>> round(float(law.std), 6)
    0.01
    """
    covariance = check_covariance(pose_covariance)
    n_u, n_v, d_mean, d = displacement_terms(points, focal_length_mm=focal_length_mm)
    # Everything divided by the mean denominator: N and D then stay near one whatever the units.
    scale = d_mean[..., None]
    var_d = _bilinear(d / scale, covariance, d / scale)
    laws = []
    for n in (n_u / scale, n_v / scale):
        var_n = _bilinear(n, covariance, n)
        cov = _bilinear(n, covariance, d / scale)
        laws.append(NormalRatio(var_n, var_d, cov, np.ones_like(var_n)))
    return laws[0], laws[1]


def _bilinear(left: FloatArray, matrix: FloatArray, right: FloatArray) -> FloatArray:
    return np.einsum("...i,...ij,...j->...", left, matrix, right)
