"""Image length of an edge as a function of the camera's displacement, to second order.

Notation
--------
delta = (d, phi)   displacement: translation d (mm) and rotation vector phi (rad), both in the camera frame
C' = R(phi) C + d  displaced end point, R the exact rotation: C + phi x C + d + 1/2 phi x (phi x C) + O(3)
w = 1 / (f - C3)   inverse depth
e, n               unit vectors along and across the image segment
a                  gradient of e . (u, v) in C:  f w (e1, e2, w (e1 C1 + e2 C2));  its Hessian is w (a z' + z a')
A = (a, C x a)     the same gradient in delta, because a . (phi x C) = phi . (C x a)
Z = (z, C x z)     gradient of C3 in delta, z = (0, 0, 1)
B                  difference of the two ends' A with n instead of e: how far the segment turns

With ' for transpose, + for the second and - for the first end point:

    gradient  g = A2 - A1
    Hessian   H = sum +- [ w (A Z' + Z A') + rotation block (1/2 (a C' + C a') - (a . C) I) ] + B B' / L
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from compiled.cache import njit
from errors.checks import check_endpoints, check_positive


def length_expansion(
    endpoints: ArrayLike, *, focal_length_mm: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return image length, its gradient and its Hessian in the displacement (dx, dy, dz, phi_x, phi_y, phi_z).

    Guarantee: the derivatives are those of the exact length under C' = R(phi) C + d with R the rotation by the vector
    phi, at zero displacement. Turning about the optical axis (phi_z) changes no length, so the last entry of the
    gradient is zero up to round-off.

    Parameters
    ----------
    endpoints : array-like, shape (..., 2, 3)
        Edge ends in the paper's camera frame, in mm.
    focal_length_mm : float
        Distance from the image plane to the lens centre, in mm.

    Returns
    -------
    length : array, shape (...)
        Image length in mm.
    gradient : array, shape (..., 6)
        Per mm for the first three, per radian for the last three.
    hessian : array, shape (..., 6, 6)
        Symmetric.

    Raises
    ------
    BehindLensError, DegenerateSegmentError, InvalidParameterError
        As `success_probability`.

    Examples
    --------
    >>> from errors import length_expansion
    >>> length, gradient, _ = length_expansion([[-20, 0, -90], [20, 0, -90]], focal_length_mm=10.0)
    >>> float(length), gradient.round(6).tolist()
    (4.0, [0.0, 0.0, 0.04, 0.0, 0.0, 0.0])
    """
    f = check_positive(focal_length_mm, "focal_length_mm")
    endpoints = check_endpoints(endpoints, f)
    lead = endpoints.shape[:-2]
    flat = np.ascontiguousarray(endpoints).reshape(-1, 2, 3)
    length = np.empty(len(flat))
    gradient = np.empty((len(flat), 6))
    hessian = np.empty((len(flat), 6, 6))
    _expand_all(flat, f, length, gradient, hessian)
    return length.reshape(lead), gradient.reshape((*lead, 6)), hessian.reshape((*lead, 6, 6))


@njit(error_model="numpy")
def expand(ends, f, g, h, work):
    """Write gradient (6,) and Hessian (6, 6) of one edge's image length; return length and direction (L, e1, e2).

    `work` is scratch of shape (3, 6): the vectors A, Z and B of the module's notation.
    """
    w1 = 1.0 / (f - ends[0, 2])
    w2 = 1.0 / (f - ends[1, 2])
    du = f * (ends[1, 0] * w2 - ends[0, 0] * w1)
    dv = f * (ends[1, 1] * w2 - ends[0, 1] * w1)
    length = math.sqrt(du * du + dv * dv)
    e1 = du / length
    e2 = dv / length
    g[:] = 0.0
    h[:] = 0.0
    work[2, :] = 0.0
    _add_end(ends[0], w1, f, e1, e2, -1.0, g, h, work)
    _add_end(ends[1], w2, f, e1, e2, 1.0, g, h, work)
    for i in range(6):
        for j in range(i + 1):
            h[i, j] += work[2, i] * work[2, j] / length
            h[j, i] = h[i, j]
    return length, e1, e2


@njit(error_model="numpy")
def _add_end(c, w, f, e1, e2, sign, g, h, work):
    """Add one end point's share (sign -1 first, +1 second) to g, to the lower triangle of h and to B."""
    a = work[0]
    _point_gradient(c, w, f, -e2, e1, a)
    for i in range(6):
        work[2, i] += sign * a[i]
    _point_gradient(c, w, f, e1, e2, a)
    z = work[1]
    z[0] = 0.0
    z[1] = 0.0
    z[2] = 1.0
    z[3] = c[1]
    z[4] = -c[0]
    z[5] = 0.0
    sw = sign * w
    for i in range(6):
        g[i] += sign * a[i]
        for j in range(i + 1):
            h[i, j] += sw * (a[i] * z[j] + z[i] * a[j])
    dot = a[0] * c[0] + a[1] * c[1] + a[2] * c[2]
    for i in range(3):
        for j in range(i + 1):
            h[3 + i, 3 + j] += sign * 0.5 * (a[i] * c[j] + c[i] * a[j])
        h[3 + i, 3 + i] -= sign * dot


@njit(error_model="numpy")
def _point_gradient(c, w, f, e1, e2, out):
    """Write A = (a, C x a): the derivative of e . (u, v) by the displacement."""
    a1 = f * w * e1
    a2 = f * w * e2
    a3 = f * w * w * (e1 * c[0] + e2 * c[1])
    out[0] = a1
    out[1] = a2
    out[2] = a3
    out[3] = c[1] * a3 - c[2] * a2
    out[4] = c[2] * a1 - c[0] * a3
    out[5] = c[0] * a2 - c[1] * a1


@njit(error_model="numpy")
def _expand_all(endpoints, f, length, gradient, hessian):
    work = np.empty((3, 6))
    for i in range(len(endpoints)):
        length[i] = expand(endpoints[i], f, gradient[i], hessian[i], work)[0]
