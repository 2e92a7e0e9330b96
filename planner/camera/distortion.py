"""Brown-Conrady lens distortion as OpenCV states it, and its inverse.

Coordinates are those of the image plane at unit distance: x across, y down, without unit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.exceptions import CameraError

_STEPS = 50
_RESIDUAL = 1e-12


@dataclass(frozen=True)
class Distortion:
    """Lens distortion as in OpenCV: radial (k1, k2, k3) and tangential (p1, p2) coefficients.

    Parameters
    ----------
    k1, k2, p1, p2, k3 : float
        Coefficients without unit. All zero means no distortion.

    Raises
    ------
    CameraError
        If a coefficient is not finite.

    Examples
    --------
    >>> from planner import Distortion
    >>> Distortion(k1=-0.1).k1
    -0.1
    """

    k1: float = 0.0
    k2: float = 0.0
    p1: float = 0.0
    p2: float = 0.0
    k3: float = 0.0

    def __post_init__(self) -> None:
        for name in ("k1", "k2", "p1", "p2", "k3"):
            if not np.isfinite(getattr(self, name)):
                raise CameraError.of_rule(name, "must be finite", repr(getattr(self, name)))

    @classmethod
    def of(cls, values: Distortion | ArrayLike | None) -> Distortion | None:
        """Return a distortion from coefficients in OpenCV's order, or None where all are zero.

        Parameters
        ----------
        values : Distortion, array_like or None
            k1, k2, p1, p2 and an optional fifth, k3. Further values must be zero, because OpenCV's
            rational, thin-prism and tilted models are not supported.

        Returns
        -------
        Distortion or None
            None means a lens without distortion.

        Raises
        ------
        CameraError
            If there are fewer than four numbers, or others than the first five are not zero.
        """
        if values is None:
            return None
        if isinstance(values, Distortion):
            return values if any(values.coefficients) else None
        try:
            numbers = np.asarray(values, dtype=float).ravel()
        except (TypeError, ValueError):
            numbers = np.empty(0)
        if len(numbers) < 4:
            raise CameraError.of_rule(
                "distortion", "must be four or five numbers k1, k2, p1, p2, k3", repr(values)
            )
        if np.any(numbers[5:]):
            raise CameraError.of_rule(
                "distortion",
                "must have no coefficients beyond k1, k2, p1, p2, k3",
                repr(values),
            )
        return cls.of(cls(*map(float, numbers[:5])))

    @property
    def coefficients(self) -> tuple[float, float, float, float, float]:
        """The coefficients k1, k2, p1, p2, k3 in OpenCV's order."""
        return self.k1, self.k2, self.p1, self.p2, self.k3

    def distort(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return where the lens images points of the ideal image plane.

        Parameters
        ----------
        points : array_like of shape (..., 2)
            Ideal coordinates x/z, y/z.

        Returns
        -------
        ndarray of shape (..., 2)
            x(1 + k1 r² + k2 r⁴ + k3 r⁶) + 2 p1 xy + p2 (r² + 2x²), and y likewise with p1, p2 exchanged.
        """
        x, y = np.moveaxis(np.asarray(points, dtype=float), -1, 0)
        r2 = x * x + y * y
        radial = 1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3))
        across = x * radial + 2.0 * self.p1 * x * y + self.p2 * (r2 + 2.0 * x * x)
        down = y * radial + self.p1 * (r2 + 2.0 * y * y) + 2.0 * self.p2 * x * y
        return np.stack([across, down], axis=-1)

    def _jacobian(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        x, y = np.moveaxis(points, -1, 0)
        r2 = x * x + y * y
        radial = 1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3))
        slope = 2.0 * (self.k1 + r2 * (2.0 * self.k2 + 3.0 * r2 * self.k3))
        xx = radial + slope * x * x + 2.0 * self.p1 * y + 6.0 * self.p2 * x
        xy = slope * x * y + 2.0 * self.p1 * x + 2.0 * self.p2 * y
        yy = radial + slope * y * y + 6.0 * self.p1 * y + 2.0 * self.p2 * x
        return np.stack([np.stack([xx, xy], -1), np.stack([xy, yy], -1)], -2)

    def undistort(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the ideal points of distorted images, by Newton's method.

        Parameters
        ----------
        points : array_like of shape (..., 2)
            Distorted coordinates.

        Returns
        -------
        ndarray of shape (..., 2)
            Ideal coordinates.

        Raises
        ------
        CameraError
            If the iteration finds no ideal point: the lens model folds before it.
        """
        wanted = np.asarray(points, dtype=float)
        found = wanted.copy()
        for _ in range(_STEPS):
            rest = self.distort(found) - wanted
            if not np.all(np.isfinite(rest)) or np.max(np.abs(rest), initial=0.0) <= _RESIDUAL:
                break
            jacobian = self._jacobian(found)
            if np.any(np.linalg.det(jacobian) <= 0.0):
                break
            found = found - np.linalg.solve(jacobian, rest[..., None])[..., 0]
        if not np.max(np.abs(self.distort(found) - wanted), initial=0.0) <= _RESIDUAL:
            raise CameraError(
                f"points must be images of the lens model before it folds. Got {self}."
            )
        return found
