"""Diameter and radius of a rim or arc, fitted in its own plane."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from errors.measurands.fitted import Frame
from errors.measurands.geometry import Circle
from errors.measurands.measurand import Measurand, circles_of
from errors.measurands.registry import kind


def circle_frame(circle: Circle) -> Frame:
    """Return the plane of a circle: x towards its start."""
    return Frame(circle.centre, *circle.basis)


class _CircleSize(Measurand):
    takes = (Circle,)
    factor = 1.0

    def describe(self) -> tuple[float, tuple[Frame, ...], NDArray[np.float64], NDArray[np.float64]]:
        """Return nominal value, frames, and the derivatives by what is fitted, see `Measurand`."""
        (circle,) = circles_of(self.geometry)
        gradient = np.array([0.0, 0.0, self.factor])
        return self.factor * circle.radius_mm, (circle_frame(circle),), gradient, np.zeros((3, 3))

    def value(self, fitted: list[NDArray[np.float64]]) -> NDArray[np.float64]:
        """Return deviations (n,) by what is fitted."""
        (circle,) = circles_of(self.geometry)
        return np.asarray(self.factor * (fitted[0][:, 2] - circle.radius_mm))


@kind("radius")
class Radius(_CircleSize):
    """Radius of a rim or arc, mm."""


@kind("diameter")
class Diameter(_CircleSize):
    """Diameter of a rim or arc, mm."""

    factor = 2.0
