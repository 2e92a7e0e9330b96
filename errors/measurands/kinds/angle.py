"""Angle of two edges."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from errors.exceptions import MeasurandError
from errors.measurands.fitted import Frame
from errors.measurands.geometry import Line
from errors.measurands.measurand import Measurand, lines_of
from errors.measurands.parallel import are_parallel, degrees_between
from errors.measurands.registry import kind

_DEGREES = 180.0 / math.pi


@kind("angle")
class Angle(Measurand):
    """Angle of two lines, degrees in (0, 90]; each is fitted in the plane through it that is parallel to both."""

    unit = "deg"
    takes = (Line, Line)

    def describe(self) -> tuple[float, tuple[Frame, ...], NDArray[np.float64], NDArray[np.float64]]:
        """Return nominal value, frames, and the derivatives by what is fitted, see `Measurand`."""
        first, second = lines_of(self.geometry)
        one = first.direction
        other = second.direction
        if are_parallel(one, other):
            raise MeasurandError(
                "the edges of an angle must not be parallel. "
                f"Got {degrees_between(one, other):.4g} degrees between them."
            )
        other = -other if one @ other < 0 else other
        normal = np.cross(one, other)
        normal = normal / np.linalg.norm(normal)
        frames = (
            Frame(first.middle, one, np.cross(normal, one)),
            Frame(second.middle, other, np.cross(normal, other)),
        )
        return (
            degrees_between(one, other),
            frames,
            _DEGREES * np.array([0.0, -1.0, 0.0, 1.0]),
            np.zeros((4, 4)),
        )

    def value(self, fitted: list[NDArray[np.float64]]) -> NDArray[np.float64]:
        """Return deviations (n,) by what is fitted."""
        first, second = fitted
        return np.asarray(_DEGREES * (np.arctan(second[:, 1]) - np.arctan(first[:, 1])))
