"""Distance of two parallel edges, along a direction across them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from errors.exceptions import MeasurandError
from errors.measurands.fitted import Frame
from errors.measurands.geometry import Line
from errors.measurands.measurand import Measurand, lines_of
from errors.measurands.parallel import are_parallel, degrees_between
from errors.measurands.registry import kind


@kind("distance")
class Distance(Measurand):
    """Distance of two parallel edges, mm, halfway: across what is fitted; given a direction, along it.

    Each is fitted in the plane that it spans with the direction of the distance: one plane for both by default, or two
    parallel ones with a known offset across them.
    """

    takes = (Line, Line)

    def describe(self) -> tuple[float, tuple[Frame, ...], NDArray[np.float64], NDArray[np.float64]]:
        """Return nominal value, frames, and the derivatives by what is fitted, see `Measurand`."""
        first, second = lines_of(self.geometry)
        if not are_parallel(first.direction, second.direction):
            raise MeasurandError(
                "the edges of a distance must be parallel. "
                f"Got {degrees_between(first.direction, second.direction):.4g} degrees between them."
            )
        along = first.direction
        apart = second.middle - first.middle
        way = apart if self.direction is None else self.direction
        way = way - (way @ along) * along
        size = float(np.linalg.norm(way))
        if not size > 1e-9 * max(1.0, float(np.linalg.norm(apart))):
            if self.direction is not None:
                raise MeasurandError(
                    "direction must not run along the edges of a distance. Got one that does."
                )
            raise MeasurandError("the edges of a distance must lie apart. Got one line.")
        way = way / size * (-1.0 if way @ apart < 0 else 1.0)
        nominal = float(apart @ way)
        if not nominal > 1e-9 * float(np.linalg.norm(apart)):
            raise MeasurandError(
                "the edges of a distance must lie apart along its direction. Got 0 mm."
            )
        half_way = (first.middle + second.middle) / 2
        # where between the two each line is read, along it from its own middle
        self._at = (
            float((half_way - first.middle) @ along),
            float((half_way - second.middle) @ along),
        )
        self._bent = self.direction is None
        self._nominal = nominal
        frames = Frame(first.middle, along, way), Frame(second.middle, along, way)
        hessian = np.zeros((4, 4))
        if self._bent:
            hessian[1::2, 1::2] = -nominal / 4
        return nominal, frames, np.array([-1.0, -self._at[0], 1.0, self._at[1]]), hessian

    def value(self, fitted: list[NDArray[np.float64]]) -> NDArray[np.float64]:
        """Return deviations (n,) by what is fitted."""
        first, second = fitted
        more = second[:, 0] + second[:, 1] * self._at[1] - first[:, 0] - first[:, 1] * self._at[0]
        if not self._bent:
            return np.asarray(more)
        # lines that turned together are no farther apart
        slope = (first[:, 1] + second[:, 1]) / 2
        return np.asarray((self._nominal + more) / np.hypot(1.0, slope) - self._nominal)
