"""Quantization error of a length measured on the pixel grid (eqs 1-3).

A pixel belongs to the edge when more than half of it is covered, so each coordinate of an end point moves to the grid
by an error uniform in +-r/2. What counts for a length is the difference of two such errors.

References
----------
C. C. Yang and F. W. Ciarallo, "Optimized sensor placement for active visual inspection", J. Robotic Systems 18, 2001.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from errors.checks import ArrayField, FloatArray, check_finite, check_pixel_pitch, check_positive


@dataclass(frozen=True, eq=False)
class AxisQuantization:
    """Error along one image axis of the distance between two end points, eqs 1-2: triangular on [-r, r].

    Parameters
    ----------
    pitch_mm : float
        Pixel pitch r along the axis, in mm.

    Raises
    ------
    InvalidParameterError
        If the pitch is not positive.

    Examples
    --------
    >>> from errors import AxisQuantization
    >>> pixel = AxisQuantization(0.005)
    >>> float(pixel.cdf(0.0)), float(pixel.pdf(0.0))
    (0.5, 200.0)
    """

    pitch_mm: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "pitch_mm", check_positive(self.pitch_mm, "pitch_mm"))

    def pdf(self, error: ArrayLike) -> NDArray[np.float64]:
        """Return the density (1/r)(1 - |error|/r).

        Parameters
        ----------
        error : array-like
            Errors in mm, any shape.

        Returns
        -------
        array
            Densities per mm, in the shape of `error`; 0 beyond r.
        """
        z = np.abs(np.asarray(error, dtype=np.float64)) / self.pitch_mm
        return np.maximum(1.0 - z, 0.0) / self.pitch_mm

    def cdf(self, error: ArrayLike) -> NDArray[np.float64]:
        """Return the probability of an error up to the given one.

        Parameters
        ----------
        error : array-like
            Errors in mm, any shape.

        Returns
        -------
        array
            Probabilities in [0, 1], in the shape of `error`.
        """
        z = np.clip(np.asarray(error, dtype=np.float64) / self.pitch_mm, -1.0, 1.0)
        return 0.5 * (1.0 + z * (2.0 - np.abs(z)))

    def sample(self, n: int, rng: int | np.random.Generator = 0) -> NDArray[np.float64]:
        """Draw errors as differences of two uniform ones.

        Parameters
        ----------
        n : int
            Number of draws.
        rng : int or numpy.random.Generator
            Seed or source of chance.

        Returns
        -------
        array, shape (n,)
            Errors in mm.
        """
        ends = np.random.default_rng(rng).uniform(-0.5, 0.5, (2, n))
        return self.pitch_mm * (ends[1] - ends[0])


@dataclass(frozen=True, eq=False)
class SegmentQuantization:
    """Error of the length of a segment at an angle, eq 3: eps = eps_x cos(angle) + eps_y sin(angle).

    It is a sum of four uniform variables of widths a, a, b, b, with a >= b the two of r_x |cos|,
    r_y |sin|. Averaging the ramp over the narrower pair first keeps every term well conditioned as
    b -> 0. The law then becomes that of one axis.

    Parameters
    ----------
    angle_rad : array-like
        Angle of the image segment to the horizontal axis, any shape; it broadcasts against the errors.
    pixel_pitch_mm : array-like, shape (2,)
        Pixel pitch (r_x, r_y) in mm.

    Raises
    ------
    InvalidParameterError
        If a value is not finite or a pitch is not positive.

    Examples
    --------
    >>> from errors import SegmentQuantization
    >>> along_a_row = SegmentQuantization(0.0, (0.005, 0.005))
    >>> float(along_a_row.cdf(0.005)), float(along_a_row.pdf(0.0))
    (1.0, 200.0)
    """

    angle_rad: ArrayField
    pixel_pitch_mm: ArrayField

    def __post_init__(self) -> None:
        object.__setattr__(self, "angle_rad", check_finite(self.angle_rad, "angle_rad"))
        object.__setattr__(self, "pixel_pitch_mm", check_pixel_pitch(self.pixel_pitch_mm))

    @property
    def widths_mm(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Widths r_x |cos| and r_y |sin| of the uniform errors along the segment, in mm."""
        rx, ry = self.pixel_pitch_mm
        return rx * np.abs(np.cos(self.angle_rad)), ry * np.abs(np.sin(self.angle_rad))

    @property
    def std(self) -> NDArray[np.float64]:
        """Standard deviation in mm."""
        wx, wy = self.widths_mm
        return np.sqrt((wx**2 + wy**2) / 6.0)

    def pdf(self, error: ArrayLike) -> NDArray[np.float64]:
        """Return the density, which is piecewise cubic.

        Parameters
        ----------
        error : array-like
            Errors in mm, any shape that broadcasts against `angle_rad`.

        Returns
        -------
        array
            Densities per mm, in the broadcast shape.
        """
        error, a, b = self._broadcast(error)
        parts = (
            _smooth_ramp(error + a, b) - 2.0 * _smooth_ramp(error, b) + _smooth_ramp(error - a, b)
        )
        return np.where(np.abs(error) < a + b, np.maximum(parts, 0.0) / a**2, 0.0)

    def cdf(self, error: ArrayLike) -> NDArray[np.float64]:
        """Return the probability of an error up to the given one: piecewise quartic.

        Parameters
        ----------
        error : array-like
            Errors in mm, any shape that broadcasts against `angle_rad`.

        Returns
        -------
        array
            Probabilities in [0, 1], in the broadcast shape.
        """
        error, a, b = self._broadcast(error)
        # The lower half only, so that no large equal terms are subtracted; the law is symmetric.
        low = -np.abs(error)
        parts = _smooth_square(low + a, b) - 2.0 * _smooth_square(low, b)
        half = np.where(low > -(a + b), np.clip(parts / (2.0 * a**2), 0.0, 0.5), 0.0)
        return np.where(error > 0.0, 1.0 - half, half)

    def sample(self, n: int, rng: int | np.random.Generator = 0) -> NDArray[np.float64]:
        """Draw errors from the four uniform end-point errors.

        Parameters
        ----------
        n : int
            Number of draws.
        rng : int or numpy.random.Generator
            Seed or source of chance.

        Returns
        -------
        array, shape (n, ...)
            Errors in mm; the other axes are those of `angle_rad`.
        """
        ends = np.random.default_rng(rng).uniform(-0.5, 0.5, (2, 2, n, *np.shape(self.angle_rad)))
        difference = ends[1] - ends[0]
        rx, ry = self.pixel_pitch_mm
        return (
            rx * np.cos(self.angle_rad) * difference[0]
            + ry * np.sin(self.angle_rad) * difference[1]
        )

    def characteristic(self, t: ArrayLike) -> NDArray[np.float64]:
        """Return E exp(it error), real because the law is symmetric.

        Parameters
        ----------
        t : array-like
            Arguments per mm, any shape that broadcasts against `angle_rad`.

        Returns
        -------
        array
            Values of the characteristic function, in the broadcast shape.
        """
        wx, wy = self.widths_mm
        t = np.asarray(t, dtype=np.float64) / (2.0 * np.pi)
        return np.sinc(t * wx) ** 2 * np.sinc(t * wy) ** 2

    def _broadcast(self, error: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
        wx, wy = self.widths_mm
        wide = np.maximum(wx, wy)
        narrow = np.minimum(wx, wy)
        error, wide, narrow = np.broadcast_arrays(np.asarray(error, dtype=np.float64), wide, narrow)
        return error, wide, narrow


def _smooth_ramp(x: FloatArray, b: FloatArray) -> FloatArray:
    """Mean of max(x + bY, 0) for Y triangular on [-1, 1]; b may be 0."""
    z = np.divide(x, b, out=np.full(x.shape, 2.0), where=np.abs(x) < b)
    inside = ((z + 1.0) ** 3 - 2.0 * np.maximum(z, 0.0) ** 3) / 6.0
    return np.where(np.abs(x) < b, b * inside, np.maximum(x, 0.0))


def _smooth_square(x: FloatArray, b: FloatArray) -> FloatArray:
    """Mean of max(x + bY, 0)^2 for Y triangular on [-1, 1]; b may be 0."""
    z = np.divide(x, b, out=np.full(x.shape, 2.0), where=np.abs(x) < b)
    inside = ((z + 1.0) ** 4 - 2.0 * np.maximum(z, 0.0) ** 4) / 12.0
    outside = np.where(x > 0.0, x**2 + b**2 / 6.0, 0.0)
    return np.where(np.abs(x) < b, b**2 * inside, outside)
