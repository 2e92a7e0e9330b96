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

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import erf, owens_t

from errors.checks import (
    ArrayField,
    FloatArray,
    check_covariance,
    check_endpoints,
    check_finite,
    check_points,
    check_positive,
)
from errors.exceptions import CovarianceError, InvalidParameterError, InvalidShapeError
from ground.short_repr import short_repr

# Ratio of correlated normal variables with a zero-mean numerator (Hinkley 1969): the law behind
# eqs 10-11.
#
# Notation
# --------
# N, D        numerator ~ N(0, var_n) and denominator ~ N(mu, var_d), covariance cov, mu > 0
# s^2         variance of N - wD:  var_n - 2 w cov + w^2 var_d
# det         var_n var_d - cov^2
# T(h, a)     Owen's function
#
#     pdf  f(w) = mu (var_n - w cov) / (sqrt(2 pi) s^3) exp(-mu^2 w^2 / 2 s^2) erf(mu (var_n - w cov) / (s sqrt(2 det)))
#                 + sqrt(det) / (pi s^2) exp(-mu^2 var_n / (2 det))
#     cdf  F(w) = [w >= 0] - 2 T(mu w / s, (var_n - w cov) / (w sqrt(det))) - 2 T(mu / sqrt(var_d), cov / sqrt(det))
#
# The pdf is the paper's, with a, b, c and k = exp((b^2 - c a^2) / (2 (1 - rho^2) a^2)) multiplied
# out: in this form nothing is divided by 1 - rho^2 or by a standard deviation, so rho = +-1 and
# var_d = 0 are ordinary cases.
#
# References
# ----------
# D. V. Hinkley, "On the ratio of two correlated normal random variables", Biometrika 56, 1969.


# Reaches 7.1 standard deviations of the denominator; good to 1e-6 when that is a tenth of its mean, better below.
_Z, _WEIGHT = np.polynomial.hermite_e.hermegauss(32)
_WEIGHT = _WEIGHT / _WEIGHT.sum()


@dataclass(frozen=True, eq=False)
class NormalRatio:
    """The law of a ratio N/D of two normal variables.

    Parameters broadcast against each other and against the arguments.

    Parameters
    ----------
    var_n, var_d : array-like
        Variances of numerator and denominator, >= 0. A zero var_n puts the whole probability at 0.
    cov : array-like
        Their covariance; a correlation of +-1 is allowed.
    mean_d : array-like
        Mean of the denominator, > 0.

    Raises
    ------
    CovarianceError
        If a variance is negative or |cov| exceeds sqrt(var_n var_d).
    InvalidParameterError
        If the mean of the denominator is not positive or a value is not finite.

    Examples
    --------
    >>> from errors import NormalRatio
    >>> law = NormalRatio(var_n=4.0, var_d=0.0, cov=0.0, mean_d=2.0)
    >>> float(law.cdf(0.0)), round(float(law.cdf(1.0)), 4)
    (0.5, 0.8413)
    """

    var_n: ArrayField
    var_d: ArrayField
    cov: ArrayField
    mean_d: ArrayField

    __repr__ = short_repr

    def __post_init__(self) -> None:
        names = ("var_n", "var_d", "cov", "mean_d")
        arrays = np.broadcast_arrays(*[check_finite(getattr(self, name), name) for name in names])
        for name, array in zip(names, arrays, strict=True):
            object.__setattr__(self, name, array)
        for name in ("var_n", "var_d"):
            if (getattr(self, name) < 0.0).any():
                raise CovarianceError.of_rule(
                    name, "must be >= 0", str(float(getattr(self, name).min()))
                )
        if (self.mean_d <= 0.0).any():
            raise InvalidParameterError(f"mean_d must be > 0. Got {float(self.mean_d.min())}.")
        excess = np.abs(self.cov) - np.sqrt(self.var_n * self.var_d) * (1.0 + 1e-9)
        if (excess > 0.0).any():
            worst = float(self.cov.flat[np.argmax(excess)])
            raise CovarianceError(f"cov must satisfy cov^2 <= var_n var_d. Got {worst}.")

    @property
    def _root_det(self) -> FloatArray:
        return np.sqrt(np.maximum(self.var_n * self.var_d - self.cov**2, 0.0))

    def _spread(self, w: FloatArray) -> FloatArray:
        """Return s."""
        return np.sqrt(np.maximum(self.var_n - 2.0 * w * self.cov + w * w * self.var_d, 0.0))

    def pdf(self, w: ArrayLike) -> NDArray[np.float64]:
        """Return the density at w; infinite at 0 and zero elsewhere where var_n is 0.

        Parameters
        ----------
        w : array-like
            Ratios, any shape that broadcasts against the parameters.

        Returns
        -------
        array
            Densities f(w) of the module's notation, in the broadcast shape.
        """
        w = np.asarray(w, dtype=np.float64)
        s = self._spread(w)
        root = self._root_det
        slope = self.mean_d * (self.var_n - w * self.cov)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            first = (
                slope / (np.sqrt(2.0 * np.pi) * s**3) * np.exp(-0.5 * (self.mean_d * w / s) ** 2)
            )
            first = first * erf(slope / (np.sqrt(2.0) * s * root))
            second = root / (np.pi * s**2) * np.exp(-0.5 * self.mean_d**2 * self.var_n / root**2)
        # Undefined only where the density vanishes: det = 0 (no second term) or s = 0 (w never reached).
        density = np.nan_to_num(first, nan=0.0, posinf=0.0) + np.nan_to_num(
            second, nan=0.0, posinf=0.0
        )
        point_mass = np.where(w == 0.0, np.inf, 0.0)
        return np.where(self.var_n > 0.0, density, point_mass)

    def cdf(self, w: ArrayLike) -> NDArray[np.float64]:
        """Return the probability of a ratio up to w.

        Parameters
        ----------
        w : array-like
            Ratios, any shape that broadcasts against the parameters.

        Returns
        -------
        array
            Probabilities F(w) of the module's notation, in the broadcast shape.
        """
        w = np.asarray(w, dtype=np.float64)
        root = self._root_det
        step = np.where(w >= 0.0, 1.0, 0.0)
        height = _divide(self.mean_d * w, self._spread(w))
        slope = _divide(
            (self.var_n - w * self.cov) * np.where(w < 0.0, -1.0, 1.0), np.abs(w) * root
        )
        tail = owens_t(_divide(self.mean_d, np.sqrt(self.var_d)), _divide(self.cov, root))
        below = np.clip(step - 2.0 * owens_t(height, slope) - 2.0 * tail, 0.0, 1.0)
        return np.where(self.var_n > 0.0, below, step)

    def sample(self, n: int, rng: int | np.random.Generator = 0) -> NDArray[np.float64]:
        """Draw ratios.

        Parameters
        ----------
        n : int
            Number of draws.
        rng : int or numpy.random.Generator
            Seed or source of chance.

        Returns
        -------
        array, shape (n, ...)
            Ratios; the other axes are those of the parameters.
        """
        z = np.random.default_rng(rng).standard_normal((2, n, *self.var_n.shape))
        slope, residual_variance = self._regression()
        d = np.sqrt(self.var_d) * z[0]
        return (slope * d + np.sqrt(residual_variance) * z[1]) / (self.mean_d + d)

    def characteristic(self, t: ArrayLike) -> NDArray[np.complex128]:
        """Return E exp(it N/D), the characteristic function.

        It is computed by Gauss-Hermite quadrature over D, because N is normal for a given D. The
        mean of D must exceed eight of its standard deviations.

        Parameters
        ----------
        t : array-like
            Arguments, any shape that broadcasts against the parameters.

        Returns
        -------
        array of complex
            Values of the characteristic function, in the broadcast shape.
        """
        t = np.asarray(t, dtype=np.float64)[..., None]
        mean, variance = self._given_denominator()
        return (np.exp(1j * t * mean - 0.5 * t * t * variance) * _WEIGHT).sum(axis=-1)

    @property
    def std(self) -> NDArray[np.float64]:
        """Root mean square, without the event that D falls below a tenth of its mean.

        The moments of the full law do not exist.
        """
        mean, variance = self._given_denominator()
        return np.sqrt(((mean**2 + variance) * _WEIGHT).sum(axis=-1))

    def _given_denominator(self) -> tuple[FloatArray, FloatArray]:
        """Return mean and variance of N/D given D at each quadrature node."""
        slope, residual_variance = self._regression()
        d = np.sqrt(self.var_d)[..., None] * _Z
        denominator = np.maximum(self.mean_d[..., None] + d, 0.1 * self.mean_d[..., None])
        return slope[..., None] * d / denominator, residual_variance[..., None] / denominator**2

    def _regression(self) -> tuple[FloatArray, FloatArray]:
        """Return slope and residual variance of N on D."""
        slope = np.divide(
            self.cov, self.var_d, out=np.zeros(self.cov.shape), where=self.var_d > 0.0
        )
        return slope, np.maximum(self.var_n - slope * self.cov, 0.0)


def _divide(numerator: ArrayLike, denominator: ArrayLike) -> FloatArray:
    """Divide with x/0 = +-inf by the sign of x; where 0/0 occurs, Owen's function is zero by its other argument."""
    numerator, denominator = np.broadcast_arrays(numerator, denominator)
    sign = np.where(numerator < 0.0, -np.inf, np.inf)
    return np.divide(numerator, denominator, out=sign, where=denominator != 0.0)


# Perspective projection in the paper's camera frame (eqs 4-5).
#
# The camera frame has C1 to the right, C2 up and C3 backwards, towards the viewer. The image
# plane is C3 = 0, the lens centre is C3 = f, and what is looked at has C3 < 0, so the depth in
# front of the lens is f - C3. The image is upright.
#
# References
# ----------
# C. C. Yang and F. W. Ciarallo, "Optimized sensor placement for active visual inspection", J. Robotic Systems 18, 2001.


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

    def __repr__(self) -> str:
        """Return a one-line summary."""
        return short_repr(self)


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


def _bilinear(row_vector: FloatArray, matrix: FloatArray, column_vector: FloatArray) -> FloatArray:
    return np.einsum("...i,...ij,...j->...", row_vector, matrix, column_vector)
