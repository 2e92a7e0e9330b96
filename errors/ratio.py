"""Ratio of correlated normal variables with a zero-mean numerator (Hinkley 1969): the law behind eqs 10-11.

Notation
--------
N, D        numerator ~ N(0, var_n) and denominator ~ N(mu, var_d), covariance cov, mu > 0
s^2         variance of N - wD:  var_n - 2 w cov + w^2 var_d
det         var_n var_d - cov^2
T(h, a)     Owen's function

    pdf  f(w) = mu (var_n - w cov) / (sqrt(2 pi) s^3) exp(-mu^2 w^2 / 2 s^2) erf(mu (var_n - w cov) / (s sqrt(2 det)))
                + sqrt(det) / (pi s^2) exp(-mu^2 var_n / (2 det))
    cdf  F(w) = [w >= 0] - 2 T(mu w / s, (var_n - w cov) / (w sqrt(det))) - 2 T(mu / sqrt(var_d), cov / sqrt(det))

The pdf is the paper's, with a, b, c and k = exp((b^2 - c a^2) / (2 (1 - rho^2) a^2)) multiplied out: in this form
nothing is divided by 1 - rho^2 or by a standard deviation, so rho = +-1 and var_d = 0 are ordinary cases.

References
----------
D. V. Hinkley, "On the ratio of two correlated normal random variables", Biometrika 56, 1969.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import erf, owens_t

from errors.arrays import ArrayField, FloatArray
from errors.checks import check_finite
from errors.exceptions import CovarianceError, InvalidParameterError

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
        slope, rest = self._regression()
        d = np.sqrt(self.var_d) * z[0]
        return (slope * d + np.sqrt(rest) * z[1]) / (self.mean_d + d)

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
        slope, rest = self._regression()
        d = np.sqrt(self.var_d)[..., None] * _Z
        denominator = np.maximum(self.mean_d[..., None] + d, 0.1 * self.mean_d[..., None])
        return slope[..., None] * d / denominator, rest[..., None] / denominator**2

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
