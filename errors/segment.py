"""Error of an edge's image length in the paper's model, which takes its two ends as independent (eqs 12-15).

Kept for comparison: one displaced pose moves both ends together, so their displacements nearly cancel in the length,
and this model overstates the error of a typical edge a hundredfold (see `errors.joint` for the model to use).

Sums of independent variables multiply characteristic functions, so each law here is a product of those of `NormalRatio`
(eqs 10-11) and `SegmentQuantization` (eq 3), inverted on equidistant nodes (Davies 1973).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from errors.checks import FloatArray, check_covariance, check_endpoints, check_positive
from errors.displacement import image_segment, point_displacement
from errors.exceptions import InvalidParameterError
from errors.quantization import SegmentQuantization

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
