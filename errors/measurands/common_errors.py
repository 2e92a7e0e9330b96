"""Errors that all points of an entity have in common, so that no number of points averages them out.

Floor: every point is found wrong by the same number of pixels along the edge's normal in the image.
All points of a rim move outward or inward, and a line is shifted. (t_x, t_y) is the direction of the
image at a point, one image distance away; s_x and s_y are the error in px times the pixel pitch over
the image distance. The point moves there by

    (-s_x t_y / s_y, s_y t_x / s_x) / hypot(t_x / s_x, t_y / s_y).

Surface: the face that carries an entity lies off its plane by the same distance everywhere. Moving an
entity along its plane's normal is moving the camera against it. So the response of a value is minus
its gradient by the camera's translation, of this entity alone, along the normal.
"""

from __future__ import annotations

import numpy as np

from compiled.cache import njit
from errors.measurands.fit_expansion import plane_of


@njit(error_model="numpy")
def line_floor(at, half, of_value, points, common):
    """Return what a value changes by when a line is found wrong by one standard deviation of the floor.

    Arguments as of `errors.measurands.fit_expansion.line_noise`; ``common`` holds s_x and s_y.
    """
    n = np.empty(3)
    p = np.empty(3)
    shift = np.empty(2)
    c = plane_of(at, n)
    spread = half * half * (1.0 - 1.0 / (points * points)) / 3.0
    # the image of a line has one direction
    _across(at[0], at[1], common, shift)
    total = 0.0
    for k in range(points):
        x = half * ((2 * k + 1.0) / points - 1.0)
        for i in range(3):
            p[i] = at[0, i] + x * at[1, i]
        share = (of_value[0] + of_value[1] * x / spread) / points
        total += share * _moved(at[2], n, c, p, shift)
    return total


@njit(error_model="numpy")
def circle_floor(at, radius, angles, solve, of_value, common):
    """Return the same for a circle, all of whose points are found farther out."""
    n = np.empty(3)
    p = np.empty(3)
    e = np.empty(3)
    along = np.empty(3)
    shift = np.empty(2)
    c = plane_of(at, n)
    total = 0.0
    for k in range(len(angles)):
        co = angles[k, 0]
        si = angles[k, 1]
        for i in range(3):
            e[i] = co * at[1, i] + si * at[2, i]
            along[i] = co * at[2, i] - si * at[1, i]
            p[i] = at[0, i] + radius * e[i]
        _across(p, along, common, shift)
        weight = of_value[0] * solve[0, k] + of_value[1] * solve[1, k] + of_value[2] * solve[2, k]
        total += weight * _moved(e, n, c, p, shift)
    return total


@njit(error_model="numpy")
def _moved(e, n, c, p, shift):
    """Return how far along e a point of the plane n.X = c is carried back when its image is shifted."""
    part = (e[0] * p[0] + e[1] * p[1] + e[2] * p[2]) / c
    return p[2] * ((e[0] - n[0] * part) * shift[0] + (e[1] - n[1] * part) * shift[1])


@njit(error_model="numpy")
def _across(p, along, common, shift):
    """Write how far the image of a point is found across a direction in space, over the image distance."""
    tx = along[0] - along[2] * p[0] / p[2]
    ty = along[1] - along[2] * p[1] / p[2]
    size = np.hypot(tx / common[0], ty / common[1])
    # an edge that is seen as a point has no direction
    if size > 0.0:
        shift[0] = -common[0] * ty / common[1] / size
        shift[1] = common[1] * tx / common[0] / size
    else:
        shift[:] = 0.0


@njit(error_model="numpy")
def by_surface(gradient, before, normal, pose):
    """Return what a value changes by when an entity lies one unit along a normal (part's frame) off its plane.

    ``gradient`` and ``before`` are the value's by the camera's displacement, with this entity and without it.
    """
    total = 0.0
    for i in range(3):
        along = 0.0
        for j in range(3):
            along += pose[i, j] * normal[j]
        total -= (gradient[i] - before[i]) * along
    return total
