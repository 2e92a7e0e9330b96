"""The reading of a position: both components of its deviation, and their covariance."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from errors.measurands import Measurand, Position
from planner.measuring.reading import Reading


def read_with(value: Measurand, read: Callable[[Measurand], Reading]) -> Reading:
    """Return the reading of a value; a position is read by its components.

    Parameters
    ----------
    value : Measurand
        The value.
    read : callable
        Reads a value that is nearly linear in what is fitted.

    Returns
    -------
    Reading
        Of a position 2‖e‖ the uncertainty is that along e, and ``deviation_mm`` and ``covariance_mm2`` are those of e.
    """
    if not isinstance(value, Position):
        return read(value)
    n = len(value.frame.errors)
    components = [read(value.along(np.eye(n)[k])) for k in range(n)]
    if not components[0].measured:
        return components[0]
    e = np.array([component.value for component in components])
    covariance = np.diag([component.standard_uncertainty**2 for component in components])
    if n == 2:
        both = read(value.along(np.ones(2))).standard_uncertainty ** 2
        covariance[0, 1] = covariance[1, 0] = 0.5 * (both - np.trace(covariance))
    axis = np.linalg.eigh(covariance)[1][:, -1]
    distance = float(np.linalg.norm(e))
    if distance > 0.0:
        axis = e / distance
    reading = read(value.along(2.0 * axis))
    return replace(
        reading,
        value=2.0 * distance,
        deviation_mm=tuple(e.tolist()),
        covariance_mm2=tuple(map(tuple, covariance.tolist())),
    )
