"""Distance of the centres of two rims or arcs in parallel planes, seen along their axes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from errors.exceptions import MeasurandError
from errors.measurands.fitted import Frame
from errors.measurands.geometry import Circle
from errors.measurands.kinds.circle_size import circle_frame
from errors.measurands.measurand import Measurand, circles_of
from errors.measurands.parallel import are_parallel, degrees_between
from errors.measurands.registry import kind


@kind("centre_distance")
class CentreDistance(Measurand):
    """Distance of two centres across their common axis, mm; given a direction, along it."""

    takes = (Circle, Circle)

    def describe(self) -> tuple[float, tuple[Frame, ...], NDArray[np.float64], NDArray[np.float64]]:
        """Return nominal value, frames, and the derivatives by what is fitted, see `Measurand`."""
        first, second = circles_of(self.geometry)
        if not are_parallel(first.axis, second.axis):
            raise MeasurandError(
                "the rims of a centre_distance must lie in parallel planes. "
                f"Got {degrees_between(first.axis, second.axis):.4g} degrees between them."
            )
        across = second.centre - first.centre
        across = across - (across @ first.axis) * first.axis
        if self.direction is not None:
            way = self.direction - (self.direction @ first.axis) * first.axis
            if not np.linalg.norm(way) > 1e-9:
                raise MeasurandError(
                    "direction must not run along the rims' axis. Got one that does."
                )
            way = way / np.linalg.norm(way) * (-1.0 if way @ across < 0 else 1.0)
            nominal = float(across @ way)
            bend = 0.0
        else:
            nominal = float(np.linalg.norm(across))
            way = across / max(nominal, 1e-300)
            bend = 1.0
        if not nominal > 1e-9 * (first.radius_mm + second.radius_mm):
            raise MeasurandError(
                "the centres of a centre_distance must lie apart. Got two on one axis."
            )
        self._way = way
        self._side = np.cross(first.axis, way)
        self._nominal = nominal
        self._bent = bend > 0
        return (
            nominal,
            tuple(map(circle_frame, (first, second))),
            *self._derivatives(bend / nominal),
        )

    def _derivatives(self, bend: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return derivatives by both centres: the distance grows along the way, and by the square of what is across."""
        frames = [circle_frame(circle) for circle in circles_of(self.geometry)]
        along = np.zeros(6)
        side = np.zeros(6)
        for k, frame in enumerate(frames):
            sign = 2 * k - 1
            along[3 * k : 3 * k + 2] = sign * np.array([frame.x @ self._way, frame.y @ self._way])
            side[3 * k : 3 * k + 2] = sign * np.array([frame.x @ self._side, frame.y @ self._side])
        return along, bend * np.outer(side, side)

    def value(self, fitted: list[NDArray[np.float64]]) -> NDArray[np.float64]:
        """Return deviations (n,) by what is fitted."""
        apart = np.zeros((len(fitted[0]), 3))
        for k, circle in enumerate(circles_of(self.geometry)):
            frame = circle_frame(circle)
            apart += (2 * k - 1) * (fitted[k][:, :1] * frame.x + fitted[k][:, 1:2] * frame.y)
        along = self._nominal + apart @ self._way
        side = apart @ self._side
        return np.asarray((np.hypot(along, side) if self._bent else along) - self._nominal)
