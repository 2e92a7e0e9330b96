"""The error of a segment's image: quantization, displacement along the axes, and both together."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from errors.checks import (
    ArrayField,
    FloatArray,
    check_covariance,
    check_endpoints,
    check_finite,
    check_pixel_pitch,
    check_positive,
)
from errors.displacement import image_segment, point_displacement
from errors.exceptions import InvalidParameterError
from ground.short_repr import short_repr

# Quantization error of a length measured on the pixel grid (eqs 1-3).
#
# A pixel belongs to the edge when more than half of it is covered, so each coordinate of an end
# point moves to the grid by an error uniform in +-r/2. What counts for a length is the difference
# of two such errors.
#
# References
# ----------
# C. C. Yang and F. W. Ciarallo, "Optimized sensor placement for active visual inspection", J. Robotic Systems 18, 2001.


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

    __repr__ = short_repr

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


# Error of an edge's image length in the paper's model, which takes its two ends as independent
# (eqs 12-15).
#
# Kept for comparison: one displaced pose moves both ends together, so their displacements nearly
# cancel in the length, and this model overstates the error of a typical edge a hundredfold (see
# `errors.model` for the model to use).
#
# Sums of independent variables multiply characteristic functions, so each law here is a product
# of those of `NormalRatio` (eqs 10-11) and `SegmentQuantization` (eq 3), inverted on equidistant
# nodes (Davies 1973).


# Half a period of the inversion in standard deviations, its largest number of nodes and where the sum may stop.
_REACH = 12.0
_MAX_NODES = 512
_TAIL = 1e-9


class _FourierLaw:
    """A law known by `characteristic(t)` and `std`: density and distribution by inversion."""

    @property
    def std(self) -> NDArray[np.float64]:
        """Standard deviation in mm."""
        raise NotImplementedError

    def characteristic(self, t: ArrayLike) -> NDArray[np.complex128]:
        """Return E exp(it error)."""
        raise NotImplementedError

    def pdf(self, error: ArrayLike) -> NDArray[np.float64]:
        """Return the density at an error.

        Parameters
        ----------
        error : array-like
            Errors in mm, any shape that broadcasts against the law's.

        Returns
        -------
        array
            Densities per mm, in the broadcast shape; infinite at 0 where the law has no spread.
        """
        error = np.asarray(error, dtype=np.float64)
        std = self.std
        step = _step(std)
        total = 0.0
        for k, value in self._values(step):
            total = total + (value * np.exp(-1j * (k + 0.5) * step * error)).real
        density = np.where(np.abs(error) < _REACH * std, np.maximum(total * step / np.pi, 0.0), 0.0)
        return np.where((std == 0.0) & (error == 0.0), np.inf, density)

    def cdf(self, error: ArrayLike) -> NDArray[np.float64]:
        """Return the probability of an error up to the given one.

        Parameters
        ----------
        error : array-like
            Errors in mm, any shape that broadcasts against the law's.

        Returns
        -------
        array
            Probabilities in [0, 1], in the broadcast shape.
        """
        error = np.asarray(error, dtype=np.float64)
        std = self.std
        step = _step(std)
        total = 0.0
        for k, value in self._values(step):
            total = total + (value * np.exp(-1j * (k + 0.5) * step * error)).imag / (k + 0.5)
        inside = np.clip(0.5 - total / np.pi, 0.0, 1.0)
        return np.where(np.abs(error) < _REACH * std, inside, np.where(error >= 0.0, 1.0, 0.0))

    def _values(self, step: FloatArray) -> Iterator[tuple[int, NDArray[np.complex128]]]:
        """Yield (k, characteristic function at (k + 1/2) step) until it has died away for every law of the batch."""
        small = 0
        for k in range(_MAX_NODES):
            value = self.characteristic((k + 0.5) * step)
            yield k, value
            # Twice in a row: a sinc factor may pass through zero.
            small = small + 1 if np.max(np.abs(value), initial=0.0) < _TAIL else 0
            if small == 2:
                return


def _step(std: FloatArray) -> FloatArray:
    """Return the spacing of the nodes; any will do for a law without spread, which is a point mass."""
    return np.pi / (_REACH * np.where(std > 0.0, std, 1.0))


class AxisDisplacement(_FourierLaw):
    """Displacement error of an edge's extent along one image axis, eqs 12-13: second end minus first, independent.

    Parameters
    ----------
    endpoints : array-like, shape (..., 2, 3)
        Edge ends in the paper's camera frame, in mm.
    axis : {"u", "v"}
        Image axis: eq 12 for u, eq 13 for v.
    focal_length_mm : float
        Distance from the image plane to the lens centre, in mm.
    pose_covariance : array-like, shape (6, 6) or (..., 6, 6)
        Covariance of (dx, dy, dz, phi_x, phi_y, phi_z) in mm and rad; see `success_probability`.

    Raises
    ------
    BehindLensError, CovarianceError, InvalidParameterError
        As `success_probability`.
    """

    def __init__(
        self, endpoints: ArrayLike, axis: str, *, focal_length_mm: float, pose_covariance: ArrayLike
    ) -> None:
        if axis not in ("u", "v"):
            raise InvalidParameterError(f"axis must be 'u' or 'v'. Got {axis!r}.")
        along_u, along_v = _end_laws(endpoints, focal_length_mm, pose_covariance)
        self._ends = along_u if axis == "u" else along_v

    @property
    def std(self) -> NDArray[np.float64]:
        """Standard deviation in mm, shape (...)."""
        return np.sqrt(self._ends[0].std ** 2 + self._ends[1].std ** 2)

    def characteristic(self, t: ArrayLike) -> NDArray[np.complex128]:
        """Return E exp(it error), the characteristic function.

        Parameters
        ----------
        t : array-like
            Arguments per mm, any shape that broadcasts against the law's.

        Returns
        -------
        array of complex
            Values of the characteristic function, in the broadcast shape.
        """
        return self._ends[1].characteristic(t) * np.conj(self._ends[0].characteristic(t))

    def sample(self, n: int, rng: int | np.random.Generator = 0) -> NDArray[np.float64]:
        """Draw errors.

        Parameters
        ----------
        n : int
            How many to draw.
        rng : int or numpy.random.Generator
            Seed or source of chance.

        Returns
        -------
        array, shape (n, ...)
            Errors in mm; the other axes are those of the edges.
        """
        rng = np.random.default_rng(rng)
        return self._ends[1].sample(n, rng) - self._ends[0].sample(n, rng)


class SegmentDisplacement(_FourierLaw):
    """Displacement error of an edge's image length, eq 14: the two axes' errors combined by the segment's angle.

    Parameters
    ----------
    endpoints : array-like, shape (..., 2, 3)
        Edge ends in the paper's camera frame, in mm.
    focal_length_mm : float
        Distance from the image plane to the lens centre, in mm.
    pose_covariance : array-like, shape (6, 6) or (..., 6, 6)
        Covariance of (dx, dy, dz, phi_x, phi_y, phi_z) in mm and rad; see `success_probability`.

    Raises
    ------
    BehindLensError, CovarianceError, DegenerateSegmentError, InvalidParameterError
        As `success_probability`.
    """

    def __init__(
        self, endpoints: ArrayLike, *, focal_length_mm: float, pose_covariance: ArrayLike
    ) -> None:
        kwargs: dict[str, Any] = {
            "focal_length_mm": focal_length_mm,
            "pose_covariance": pose_covariance,
        }
        angle = image_segment(endpoints, focal_length_mm=focal_length_mm)[1]
        self._cosine = np.cos(angle)
        self._sine = np.sin(angle)
        self._u = AxisDisplacement(endpoints, "u", **kwargs)
        self._v = AxisDisplacement(endpoints, "v", **kwargs)

    @property
    def std(self) -> NDArray[np.float64]:
        """Standard deviation in mm, shape (...)."""
        return np.hypot(self._cosine * self._u.std, self._sine * self._v.std)

    def characteristic(self, t: ArrayLike) -> NDArray[np.complex128]:
        """Return E exp(it error), the characteristic function.

        Parameters
        ----------
        t : array-like
            Arguments per mm, any shape that broadcasts against the law's.

        Returns
        -------
        array of complex
            Values of the characteristic function, in the broadcast shape.
        """
        return self._u.characteristic(t * self._cosine) * self._v.characteristic(t * self._sine)

    def sample(self, n: int, rng: int | np.random.Generator = 0) -> NDArray[np.float64]:
        """Draw errors.

        Parameters
        ----------
        n : int
            How many to draw.
        rng : int or numpy.random.Generator
            Seed or source of chance.

        Returns
        -------
        array, shape (n, ...)
            Errors in mm; the other axes are those of the edges.
        """
        rng = np.random.default_rng(rng)
        return self._cosine * self._u.sample(n, rng) + self._sine * self._v.sample(n, rng)


class SegmentError(_FourierLaw):
    """Total error of an edge's image length, eq 15: displacement (eq 14) and quantization (eq 3) added.

    Parameters
    ----------
    endpoints : array-like, shape (..., 2, 3)
        Edge ends in the paper's camera frame, in mm.
    focal_length_mm : float
        Distance from the image plane to the lens centre, in mm.
    pixel_pitch_mm : array-like, shape (2,)
        Pixel pitch (r_x, r_y) in mm.
    pose_covariance : array-like, shape (6, 6) or (..., 6, 6)
        Covariance of (dx, dy, dz, phi_x, phi_y, phi_z) in mm and rad; see `success_probability`.

    Raises
    ------
    BehindLensError, CovarianceError, DegenerateSegmentError, InvalidParameterError
        As `success_probability`.
    """

    def __init__(
        self,
        endpoints: ArrayLike,
        *,
        focal_length_mm: float,
        pixel_pitch_mm: ArrayLike,
        pose_covariance: ArrayLike,
    ) -> None:
        angle = image_segment(endpoints, focal_length_mm=focal_length_mm)[1]
        self.quantization = SegmentQuantization(angle, pixel_pitch_mm)
        self.displacement = SegmentDisplacement(
            endpoints, focal_length_mm=focal_length_mm, pose_covariance=pose_covariance
        )

    @property
    def std(self) -> NDArray[np.float64]:
        """Standard deviation in mm, shape (...)."""
        return np.hypot(self.displacement.std, self.quantization.std)

    def characteristic(self, t: ArrayLike) -> NDArray[np.complex128]:
        """Return E exp(it error), the characteristic function.

        Parameters
        ----------
        t : array-like
            Arguments per mm, any shape that broadcasts against the law's.

        Returns
        -------
        array of complex
            Values of the characteristic function, in the broadcast shape.
        """
        return self.displacement.characteristic(t) * self.quantization.characteristic(t)

    def sample(self, n: int, rng: int | np.random.Generator = 0) -> NDArray[np.float64]:
        """Draw errors.

        Parameters
        ----------
        n : int
            How many to draw.
        rng : int or numpy.random.Generator
            Seed or source of chance.

        Returns
        -------
        array, shape (n, ...)
            Errors in mm; the other axes are those of the edges.
        """
        rng = np.random.default_rng(rng)
        return self.displacement.sample(n, rng) + self.quantization.sample(n, rng)


def independent_probability(
    endpoints: NDArray[np.float64],
    focal_length_mm: float,
    pixel_pitch_mm: NDArray[np.float64],
    pose_covariance: NDArray[np.float64],
    accuracy: float,
) -> NDArray[np.float64]:
    """Return P(|error| <= (1 - A) L) under eqs 10-15, shape (...)."""
    law = SegmentError(
        endpoints,
        focal_length_mm=focal_length_mm,
        pixel_pitch_mm=pixel_pitch_mm,
        pose_covariance=pose_covariance,
    )
    tolerance = (1.0 - accuracy) * image_segment(endpoints, focal_length_mm=focal_length_mm)[0]
    return law.cdf(tolerance) - law.cdf(-tolerance)


def _end_laws(endpoints: ArrayLike, focal_length_mm: float, pose_covariance: ArrayLike) -> Any:
    """Return ((first, second) along u, (first, second) along v)."""
    f = check_positive(focal_length_mm, "focal_length_mm")
    endpoints = check_endpoints(endpoints, f)
    covariance = check_covariance(pose_covariance)
    kwargs: dict[str, Any] = {"focal_length_mm": f, "pose_covariance": covariance}
    ends = [point_displacement(endpoints[..., i, :], **kwargs) for i in (0, 1)]
    return tuple(zip(*ends, strict=True))
