"""Dimensions that the tests of measurands share: one or two of every kind, off the origin and turned."""

import math

import numpy as np

from errors.measurands import Line, MeasuredCircle

F = 25.0
PITCH = (0.004, 0.005)

TILTED = np.array([0.0, math.sin(0.2), math.cos(0.2)])

# kind, plain geometry as `measured_exactly` takes it, direction
EXAMPLES = {
    "length": ("length", (("line", (-25, 4, 2), (22, -9, 6)),), None),
    "distance": (
        "distance",
        (("line", (-20, -15, 3), (20, -15, 3)), ("line", (24, 12, 3), (-8, 12, 3))),
        None,
    ),
    "distance, offset": (
        "distance",
        (("line", (-20, -15, 0), (20, -15, 0)), ("line", (-10, 12, 8), (20, 12, 8))),
        (0, 1, 0),
    ),
    "angle": (
        "angle",
        (("line", (-20, -5, 0), (15, -9, 0)), ("line", (-16, 12, 5), (12, -10, 5))),
        None,
    ),
    "right angle": (
        "angle",
        (("line", (-20, -5, 0), (15, -5, 0)), ("line", (3, 18, 0), (3, -10, 0))),
        None,
    ),
    "diameter": ("diameter", (("circle", (4, -3, 2), (0, 0, 1), 12.0, None, 2 * math.pi),), None),
    "diameter, tilted": (
        "diameter",
        (("circle", (4, -3, 2), tuple(TILTED), 7.0, None, 2 * math.pi),),
        None,
    ),
    "radius, arc": (
        "radius",
        (("circle", (-5, 2, 0), (0, 0, 1), 15.0, (0.6, 0.8, 0), math.radians(200)),),
        None,
    ),
    "centre_distance": (
        "centre_distance",
        (
            ("circle", (-15, 2, 0), (0, 0, 1), 6.0, None, 2 * math.pi),
            ("circle", (13, -7, 5), (0, 0, -1), 9.0, None, 2 * math.pi),
        ),
        None,
    ),
    "centre_distance, along": (
        "centre_distance",
        (
            ("circle", (-15, 2, 0), (0, 0, 1), 6.0, None, 2 * math.pi),
            ("circle", (13, -7, 5), (0, 0, 1), 9.0, None, 2 * math.pi),
        ),
        (1, 0, 0),
    ),
    "centre_to_edge": (
        "centre_to_edge",
        (
            ("circle", (2, 14, 4), (0, 0, 1), 8.0, None, 2 * math.pi),
            ("line", (-20, -6, 0), (18, -10, 0)),
        ),
        None,
    ),
}


def geometry_of(plain):
    """Return the records of the package for plain geometry."""
    return tuple(
        Line(*one[1:])
        if one[0] == "line"
        else MeasuredCircle(one[1], one[2], one[3], one[4], one[5])
        for one in plain
    )


def isotropic(translation_mm, rotation_rad):
    """Return the covariance (6, 6) of equal standard deviations."""
    return np.diag([translation_mm**2] * 3 + [rotation_rad**2] * 3)


def correlated(rng, translation_mm, rotation_rad):
    """Return a covariance (6, 6) with the given standard deviations and random correlations."""
    factor = rng.normal(size=(6, 12))
    covariance = factor @ factor.T
    std = np.array([translation_mm] * 3 + [rotation_rad] * 3) / np.sqrt(np.diag(covariance))
    return covariance * std[:, None] * std
