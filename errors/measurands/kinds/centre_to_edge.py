"""Distance from the centre of a rim or arc to an edge."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from errors.exceptions import MeasurandError
from errors.measurands.fitted import Frame
from errors.measurands.geometry import Circle, Line
from errors.measurands.kinds.circle_size import circle_frame
from errors.measurands.measurand import Measurand, circles_of, lines_of
from errors.measurands.parallel import are_perpendicular, degrees_between
from errors.measurands.registry import kind


@kind("centre_to_edge")
class CentreToEdge(Measurand):
    """Distance from a centre to the line of an edge that is parallel to the rim's plane, seen along the axis, mm."""

    takes = (Circle, Line)

    def describe(self) -> tuple[float, tuple[Frame, ...], NDArray[np.float64], NDArray[np.float64]]:
        """Return nominal value, frames, and the derivatives by what is fitted, see `Measurand`."""
        (circle,) = circles_of(self.geometry)
        (line,) = lines_of(self.geometry)
        along = line.direction
        if not are_perpendicular(along, circle.axis):
            raise MeasurandError(
                "the edge of a centre_to_edge must be parallel to the rim's plane. "
                f"Got {90 - degrees_between(along, circle.axis):.4g} degrees between them."
            )
        across = np.cross(circle.axis, along)
        apart = circle.centre - line.middle
        across = across / np.linalg.norm(across) * (-1.0 if across @ apart < 0 else 1.0)
        nominal = float(apart @ across)
        self._at = float(apart @ along)
        if not nominal > 1e-9 * (circle.radius_mm + line.length):
            raise MeasurandError(
                "the centre of a centre_to_edge must lie off the edge's line. Got 0 mm."
            )
        frame = circle_frame(circle)
        self._nominal = nominal
        self._across = np.array([frame.x @ across, frame.y @ across])
        self._along = np.array([frame.x @ along, frame.y @ along])
        gradient = np.array([*self._across, 0.0, -1.0, -self._at])
        hessian = np.zeros((5, 5))
        hessian[:2, 4] = hessian[4, :2] = -self._along
        hessian[4, 4] = -nominal
        return nominal, (frame, Frame(line.middle, along, across)), gradient, hessian

    def value(self, fitted: list[NDArray[np.float64]]) -> NDArray[np.float64]:
        """Return deviations (n,) by what is fitted."""
        centre, line = fitted
        across = self._nominal + centre[:, :2] @ self._across
        along = self._at + centre[:, :2] @ self._along
        return np.asarray(
            (across - line[:, 0] - line[:, 1] * along) / np.hypot(1.0, line[:, 1]) - self._nominal
        )
