"""Whether directions are parallel, as far as a drawing means it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

PARALLEL_DEG = 0.01
"""Angle between two directions up to which a dimension takes them as parallel, degrees."""


def degrees_between(first: NDArray[np.float64], second: NDArray[np.float64]) -> float:
    """Return the angle between two lines of unit directions, degrees in [0, 90]."""
    return math.degrees(
        math.atan2(float(np.linalg.norm(np.cross(first, second))), abs(float(first @ second)))
    )


def are_parallel(first: NDArray[np.float64], second: NDArray[np.float64]) -> bool:
    """Return whether two unit directions are parallel or opposite."""
    return degrees_between(first, second) <= PARALLEL_DEG


def are_perpendicular(first: NDArray[np.float64], second: NDArray[np.float64]) -> bool:
    """Return whether two unit directions are at a right angle."""
    return 90.0 - degrees_between(first, second) <= PARALLEL_DEG
