"""Windows: where a pose of a box must look to have an entity in focus and on the sensor. Compiled loops.

Notation
--------
q, c      the point looked at, at the middle depth z0 on the camera's axis; the nodal point c = q - z0 a, a the axis
R         camera to part: the rotation of the quaternion (1, v), or of that followed by half a turn about the part's x
          axis. These two charts, |v_i| <= 1, are all rotations but for half a turn about the camera's axis, under which
          the sensor is symmetric.
box       q in q0 +- h and v in v0 +- u. With R0 the middle rotation, d = v - v0 and N = 1 + |v0|^2, R = R0 R(t), t
          being the Rodrigues vector W d / (N + v0.d), W d = d - v0 x d
s, w      of a point p: s = R0'(p - q0); and of the point looked at, w = R(t)' R0'(q - q0)

From a pose of the box, p is at R(t)'s - w from the point looked at, in the camera's axes. It is in focus and on the
sensor if six forms n.(R(t)'s - w) + k are not negative: so n.w may be at most n.R(t)'s + k, which is at most

    n.s + k + (2/N) |W'(n x s)|.u + t^2 (|n| |s| - n.s) + 2 t (t^2 + nu) |n x s|       t = max |t|,  nu = max |v0.d| / N

((1 + t^2) R(-t)s = (1 + t^2) s + 2 s x t + 2 t x (t x s), where n.(t x (t x s)) = (n.t)(t.s) - t^2 n.s is at most
t^2 (|n| |s| - n.s) / 2; and t - W d / N is at most t nu). The forms depend on w in the same way for all points, so each
entity has a *window* of w, a frustum upside down. What one pose inspects has windows that meet
(`planner.bound.boxes.shifted_windows`). How far a point may be at most is the lens's limit or, if that is nearer, where
the image of its entity would be too short (`farthest`). Only the turn makes the windows larger than they are; how large
the box of q is matters for visibility, for the length of images, and for the length of s. That the camera turns about
what it looks at, and not about itself, keeps s and so the turn's effect small.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from compiled.decorators import kernel, kernel_without_refcounts
from planner.bound.boxes.view import BOTTOM, FAR, LEFT, NEAR, RIGHT, TOP

_EPS = 1e-9
# t of a box in which |v0.d| / N may be nearly 1
_TURN_UNBOUNDED = 1e3
# the most that one side of one window counts in a coordinate's score
_MOST_SCORE = 4.0
# of the turn, rad: while it may be larger, a smaller box of q does not make windows smaller for certain
_MUCH_TURN = 0.5


class Turn(NamedTuple):
    """The turns of a box: v0, u, N, and the largest t and nu."""

    v: np.ndarray
    u: np.ndarray
    n: float
    t: float
    nu: float


@kernel_without_refcounts
def rotation(chart, v, matrix):
    """Write the rotation R of a chart and a vector v; return N."""
    n = 1.0 + v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
    x = v[0]
    y = v[1]
    z = v[2]
    matrix[0, 0] = 1 + x * x - y * y - z * z
    matrix[0, 1] = 2 * (x * y - z)
    matrix[0, 2] = 2 * (x * z + y)
    matrix[1, 0] = 2 * (x * y + z)
    matrix[1, 1] = 1 - x * x + y * y - z * z
    matrix[1, 2] = 2 * (y * z - x)
    matrix[2, 0] = 2 * (x * z - y)
    matrix[2, 1] = 2 * (y * z + x)
    matrix[2, 2] = 1 - x * x - y * y + z * z
    for i in range(3):
        sign = -1.0 if chart == 1 and i > 0 else 1.0
        for j in range(3):
            matrix[i, j] *= sign / n
    return n


@kernel_without_refcounts
def turned_back(matrix, x, y, z):
    """Return R' (x, y, z), in an order of sums that does not depend on the machine."""
    return (
        matrix[0, 0] * x + matrix[1, 0] * y + matrix[2, 0] * z,
        matrix[0, 1] * x + matrix[1, 1] * y + matrix[2, 1] * z,
        matrix[0, 2] * x + matrix[1, 2] * y + matrix[2, 2] * z,
    )


@kernel_without_refcounts
def most_turn(v, u, n):
    """Return the largest |t| and the largest |v0.d| / N of a box."""
    nu = (abs(v[0]) * u[0] + abs(v[1]) * u[1] + abs(v[2]) * u[2]) / n
    if nu >= 0.99:
        return _TURN_UNBOUNDED, nu
    return math.sqrt((u[0] ** 2 + u[1] ** 2 + u[2] ** 2) / n) / (1.0 - nu), nu


@kernel_without_refcounts
def extent(matrix, h, t, room):
    """Write how far each coordinate of w may be from 0."""
    more = min(2.0 * t, 2.0) * math.sqrt(h[0] ** 2 + h[1] ** 2 + h[2] ** 2)
    for i in range(3):
        room[i] = (
            abs(matrix[0, i]) * h[0] + abs(matrix[1, i]) * h[1] + abs(matrix[2, i]) * h[2] + more
        )


@kernel_without_refcounts
def seen_from(ends, q, matrix, s):
    """Write s (2, 3) for the ends of an entity."""
    for i in range(2):
        for j in range(3):
            s[i, j] = 0.0
            for k in range(3):
                s[i, j] += matrix[k, j] * (ends[i, k] - q[k])


@kernel_without_refcounts
def window(s, far, turn, view, room, least, weight, scores):
    """Write the least values (6,) of the forms -n.w that both ends of an entity, as deep as ``far`` (2,), allow.

    In the order of w's coordinates: x - tan_x z and -x - tan_x z, the same for y, then -z and z; that is RIGHT, LEFT,
    BOTTOM, TOP, NEAR, FAR of the view. To ``scores`` (6,) is added, times the weight, what each coordinate of the box
    does to the sides of the window that cut the room, as a share of how wide the view is.
    """
    v, u, n, t, nu = turn
    of_0 = math.sqrt(s[0, 0] ** 2 + s[0, 1] ** 2 + s[0, 2] ** 2)
    of_1 = math.sqrt(s[1, 0] ** 2 + s[1, 1] ** 2 + s[1, 2] ** 2)
    most_0 = most_1 = most_2 = 0.0
    spans = u[0] + u[1] + u[2]
    for c in range(6):
        n0, n1, n2, k, width, outside = form(c, view, room)
        size = math.sqrt(n0 * n0 + n1 * n1 + n2 * n2)
        least[c] = -np.inf
        for i in range(2):
            g0 = n1 * s[i, 2] - n2 * s[i, 1]
            g1 = n2 * s[i, 0] - n0 * s[i, 2]
            g2 = n0 * s[i, 1] - n1 * s[i, 0]
            first_0 = 2.0 / n * abs(g0 + v[1] * g2 - v[2] * g1) * u[0]
            first_1 = 2.0 / n * abs(g1 + v[2] * g0 - v[0] * g2) * u[1]
            first_2 = 2.0 / n * abs(g2 + v[0] * g1 - v[1] * g0) * u[2]
            along = n0 * s[i, 0] + n1 * s[i, 1] + n2 * s[i, 2]
            whole = size * (of_0 if i == 0 else of_1)
            across = math.sqrt(g0 * g0 + g1 * g1 + g2 * g2)
            rest = min(t * t * (whole - along) + 2.0 * t * (t * t + nu) * across, 2.0 * whole)
            k_end = far[i] - view.middle if c == FAR else k
            value = -(k_end + along)
            value -= first_0 + first_1 + first_2 + rest + _EPS
            if value > least[c]:
                least[c] = value
                most_0 = first_0 + rest * u[0] / spans
                most_1 = first_1 + rest * u[1] / spans
                most_2 = first_2 + rest * u[2] / spans
        if least[c] > outside:
            scores[3] += weight * min(most_0 / width, _MOST_SCORE)
            scores[4] += weight * min(most_1 / width, _MOST_SCORE)
            scores[5] += weight * min(most_2 / width, _MOST_SCORE)
            for j in range(3):
                # a smaller box of q has smaller s; but that says nothing while the turn is large
                scores[j] += weight * 2.0 * t * size / width if t < _MUCH_TURN else 0.0


@kernel_without_refcounts
def form(c, view, room):
    """Return the form n.(R(t)'s - w) + k of a side of the view: n, k; half the width; the least -n.w there is."""
    sign = -1.0 if c % 2 == 0 else 1.0
    if c in (RIGHT, LEFT):
        width = view.tan_x * view.middle
        return sign, 0.0, view.tan_x, width, width, -room[0] - view.tan_x * room[2]
    if c in (BOTTOM, TOP):
        width = view.tan_y * view.middle
        return 0.0, sign, view.tan_y, width, width, -room[1] - view.tan_y * room[2]
    k = view.middle - view.near if c == NEAR else view.far - view.middle
    return 0.0, 0.0, -sign, k, (view.far - view.near) / 2, -room[2]


@kernel_without_refcounts
def is_empty(least, room, view):
    """Tell whether a window lies outside the box; it is widest at the least depth of the point looked at."""
    z = max(least[FAR], -room[2])
    return (
        z > min(-least[NEAR], room[2])
        or max(least[RIGHT] + view.tan_x * z, -room[0])
        > min(-least[LEFT] - view.tan_x * z, room[0])
        or max(least[BOTTOM] + view.tan_y * z, -room[1])
        > min(-least[TOP] - view.tan_y * z, room[1])
    )


@kernel
def swings(matrix, v, u, n, t, nu, middle, swing):
    """Write how each coordinate of the turn moves the nodal point, (3, 3); return the remainder of second order."""
    w = np.empty(3)
    for k in range(3):
        w[k] = 1.0
        w[(k + 1) % 3] = -v[(k + 2) % 3]
        w[(k + 2) % 3] = v[(k + 1) % 3]
        for i in range(3):
            swing[k, i] = 2.0 / n * middle * u[k] * (matrix[i, 0] * w[1] - matrix[i, 1] * w[0])
    return middle * min(2.0 * (t * t + t * nu), 2.0)


@kernel_without_refcounts
def farthest(s, length, ratio, t, room, view, far, opened):
    """Write how deep each end (2,) may be from any pose of a box for the image of the entity to be long enough.

    With e from the one end to the other in the camera's axes, p the image of the first and z the depth of the second
    end, the image is |e_xy - p e_z| / z long (equal to eq 16). Either end may be the first. ``opened`` (2,) becomes
    how much of these depths is there only because the point looked at is not known, and only because the turn is not.
    ``ratio`` is the least length over the image distance; where it is 0, only the lens limits the depth.
    """
    turn = min(2.0 * t, 2.0)
    least = ratio * (1.0 - _EPS)
    opened[:] = 0.0
    if least <= 0.0:
        far[:] = view.far
        return
    for i in range(2):
        a = s[i]
        b = s[1 - i]
        moved = turn * math.sqrt(a[0] ** 2 + a[1] ** 2 + a[2] ** 2)
        middle = a[2] + view.middle
        depth = max(view.near, middle - room[2] - moved)
        deepest = max(depth, min(view.far, middle + room[2] + moved))
        left, right = _directions(a[0], room[0] + moved, depth, deepest, view.tan_x)
        low, high = _directions(a[1], room[1] + moved, depth, deepest, view.tan_y)
        e_x = b[0] - a[0]
        e_y = b[1] - a[1]
        e_z = b[2] - a[2]
        x = max(abs(e_x - left * e_z), abs(e_x - right * e_z))
        y = max(abs(e_y - low * e_z), abs(e_y - high * e_z))
        across = math.sqrt(x * x + y * y)
        # e is turned by so much, and is never longer
        whole = length * math.sqrt(
            1.0 + max(left * left, right * right) + max(low * low, high * high)
        )
        spread = max(min(turn * whole, whole - across), 0.0)
        far[1 - i] = min(view.far, (across + spread) / least)
        if far[1 - i] < view.far:
            x = e_x - 0.5 * (left + right) * e_z
            y = e_y - 0.5 * (low + high) * e_z
            opened[0] = max(opened[0], (across - math.sqrt(x * x + y * y)) / least)
            opened[1] = max(opened[1], spread / least)


@kernel_without_refcounts
def _directions(x, slack, depth, deepest, tangent):
    """Return between which tangents a point at x, give or take the slack, is seen on the sensor from these depths."""
    low = x - slack
    high = x + slack
    left = low / (depth if low < 0.0 else deepest)
    right = high / (depth if high > 0.0 else deepest)
    return max(left, -tangent), min(right, tangent)
