"""Values fitted to what is carried back, to second order in the displacement of the pose.

Notation (camera frame, nominal pose)
-------------------------------------
delta = (t, phi)   the real camera stands at the nominal pose times (R(phi), t): C' = R(phi)' (C - t)
n, c               plane of an entity: n.X = c; a measured point is carried back along its ray to it
X(delta)           = C' c / (n.C'), for C on the plane: C + u1 + u2
e                  a unit vector of the plane;  w = e - n (e.C)/c: e.P with P the projection along the ray of C
a = (-w, w x C)    row of e.u1 in delta;  s = (-n, n x C)/c the same of n.C'/c - 1
e.u2               = w.(phi x t) + 1/2 [(phi.w)(phi.C) - (w.C) phi.phi] - (s.delta)(a.delta)

A **line** goes to the line through its displaced ends. With y across and x along it, l its length:

    offset in the middle   h = (y_p + y_q)/2 - (x_p + x_q)/2 (y_q - y_p)/l
    slope                  k = (y_q - y_p)/l - (y_q - y_p)(x_q - x_p)/l^2

A **circle** is fitted by least squares of distances. With a_i, b_i the radial and tangential displacement of point i,
A the rows (cos, sin, 1), q_i = b_i - tangential part of the first-order centre, and r_i = a_i - (A theta_1)_i:

    theta = (centre x, centre y, radius) = (A'A)^-1 [A'(a + q^2 / 2 rho) + sum r_i q_i (-sin_i, cos_i, 0) / rho]

Noise of a point, sigma_x and sigma_y on the image, moves it in the plane by (z / d) P(sigma_x x + sigma_y y), with z
its depth and d the image distance: to first order independent of the pose's error.
"""

from __future__ import annotations

import numpy as np

from compiled.cache import njit


@njit(error_model="numpy")
def add_square(h, w, p, s, a, weight):
    """Add to h (6, 6) the Hessian of weight times e.u2; p is the point C, its row a, the plane's row s."""
    dot = w[0] * p[0] + w[1] * p[1] + w[2] * p[2]
    for i in range(3):
        for j in range(3):
            h[3 + i, 3 + j] += weight * 0.5 * (w[i] * p[j] + p[i] * w[j])
        h[3 + i, 3 + i] -= weight * dot
    # w . (phi x t)
    h[0, 4] -= weight * w[2]
    h[0, 5] += weight * w[1]
    h[1, 3] += weight * w[2]
    h[1, 5] -= weight * w[0]
    h[2, 3] -= weight * w[1]
    h[2, 4] += weight * w[0]
    h[4, 0] -= weight * w[2]
    h[5, 0] += weight * w[1]
    h[3, 1] += weight * w[2]
    h[5, 1] -= weight * w[0]
    h[3, 2] -= weight * w[1]
    h[4, 2] += weight * w[0]
    for i in range(6):
        for j in range(6):
            h[i, j] -= weight * (s[i] * a[j] + a[i] * s[j])


@njit(error_model="numpy")
def add_product(h, a, b, weight):
    """Add to h (6, 6) the Hessian of weight times (a.delta)(b.delta)."""
    for i in range(6):
        for j in range(6):
            h[i, j] += weight * (a[i] * b[j] + b[i] * a[j])


@njit(error_model="numpy")
def point_row(e, n, c, p, w, row):
    """Write w and the row a of e.u1 for a point p of the plane n.X = c."""
    part = (e[0] * p[0] + e[1] * p[1] + e[2] * p[2]) / c
    for i in range(3):
        w[i] = e[i] - n[i] * part
        row[i] = -w[i]
    row[3] = w[1] * p[2] - w[2] * p[1]
    row[4] = w[2] * p[0] - w[0] * p[2]
    row[5] = w[0] * p[1] - w[1] * p[0]


@njit(error_model="numpy")
def plane_row(n, c, p, row):
    """Write the row s of n.C'/c - 1 for a point p of the plane."""
    for i in range(3):
        row[i] = -n[i] / c
    row[3] = (n[1] * p[2] - n[2] * p[1]) / c
    row[4] = (n[2] * p[0] - n[0] * p[2]) / c
    row[5] = (n[0] * p[1] - n[1] * p[0]) / c


@njit(error_model="numpy")
def noise(w, depth, scale_x, scale_y):
    """Return the variance of e.X by the image noise of one point; the scales are sigma / d."""
    along_x = depth * scale_x * w[0]
    along_y = depth * scale_y * w[1]
    return along_x * along_x + along_y * along_y


@njit(error_model="numpy")
def turned(frame, pose, out):
    """Write origin, x, y of an entity (3, 3) in the camera frame of a pose world to camera (4, 4)."""
    for k in range(3):
        for i in range(3):
            total = pose[i, 3] if k == 0 else 0.0
            for j in range(3):
                total += pose[i, j] * frame[k, j]
            out[k, i] = total


@njit(error_model="numpy")
def plane_of(at, n):
    """Write the normal of an entity's plane; return its distance c from the lens."""
    x = at[1]
    y = at[2]
    n[0] = x[1] * y[2] - x[2] * y[1]
    n[1] = x[2] * y[0] - x[0] * y[2]
    n[2] = x[0] * y[1] - x[1] * y[0]
    return n[0] * at[0, 0] + n[1] * at[0, 1] + n[2] * at[0, 2]


@njit(error_model="numpy")
def expand_line(at, half, of_value, g, h, rows):
    """Add a line's share of a value to gradient g and Hessian h, and write the rows of (offset, slope) in delta.

    ``at`` holds middle, x along and y across; ``of_value`` is the value's gradient by (offset, slope). Return False if
    the plane or an end cannot be carried back.
    """
    n = np.empty(3)
    w = np.empty(3)
    p = np.empty(3)
    s = np.empty(6)
    y_row = np.empty((2, 6))
    x_row = np.empty((2, 6))
    c = plane_of(at, n)
    length = 2.0 * half
    for k in range(2):
        for i in range(3):
            p[i] = at[0, i] + (2 * k - 1) * half * at[1, i]
        if not (p[2] > 0.0 and c != 0.0):
            return False
        plane_row(n, c, p, s)
        point_row(at[1], n, c, p, w, x_row[k])
        point_row(at[2], n, c, p, w, y_row[k])
        add_square(h, w, p, s, y_row[k], 0.5 * of_value[0] + (2 * k - 1) * of_value[1] / length)
    rise = y_row[1] - y_row[0]
    stretch = x_row[1] - x_row[0]
    shift = x_row[0] + x_row[1]
    add_product(h, shift, rise, -0.5 * of_value[0] / length)
    add_product(h, rise, stretch, -of_value[1] / (length * length))
    for i in range(6):
        rows[0, i] = 0.5 * (y_row[0, i] + y_row[1, i])
        rows[1, i] = rise[i] / length
        g[i] += of_value[0] * rows[0, i] + of_value[1] * rows[1, i]
    return True


@njit(error_model="numpy")
def expand_circle(at, radius, angles, solve, of_value, g, h, rows):
    """Add a circle's share of a value to gradient and Hessian, and write the rows of (centre x, y, radius) in delta.

    ``angles`` (m, 2) are cosines and sines; ``solve`` (6, m) is (A'A)^-1 A' and, below it, (A'A)^-1 times the tangents.
    """
    m = len(angles)
    n = np.empty(3)
    w = np.empty(3)
    p = np.empty(3)
    e = np.empty(3)
    s = np.empty(6)
    a_row = np.empty((m, 6))
    b_row = np.empty((m, 6))
    q = np.empty(6)
    r = np.empty(6)
    c = plane_of(at, n)
    rows[:3] = 0.0
    for k in range(m):
        co = angles[k, 0]
        si = angles[k, 1]
        for i in range(3):
            p[i] = at[0, i] + radius * (co * at[1, i] + si * at[2, i])
            e[i] = -si * at[1, i] + co * at[2, i]
        if not (p[2] > 0.0 and c != 0.0):
            return False
        point_row(e, n, c, p, w, b_row[k])
        for i in range(3):
            e[i] = co * at[1, i] + si * at[2, i]
        point_row(e, n, c, p, w, a_row[k])
        plane_row(n, c, p, s)
        weight = of_value[0] * solve[0, k] + of_value[1] * solve[1, k] + of_value[2] * solve[2, k]
        add_square(h, w, p, s, a_row[k], weight)
        for j in range(3):
            for i in range(6):
                rows[j, i] += solve[j, k] * a_row[k, i]
    for k in range(m):
        co = angles[k, 0]
        si = angles[k, 1]
        for i in range(6):
            q[i] = b_row[k, i] + si * rows[0, i] - co * rows[1, i]
            r[i] = a_row[k, i] - co * rows[0, i] - si * rows[1, i] - rows[2, i]
        weight = of_value[0] * solve[0, k] + of_value[1] * solve[1, k] + of_value[2] * solve[2, k]
        turn = of_value[0] * solve[3, k] + of_value[1] * solve[4, k] + of_value[2] * solve[5, k]
        add_product(h, q, q, 0.5 * weight / radius)
        add_product(h, q, r, turn / radius)
    for i in range(6):
        g[i] += of_value[0] * rows[0, i] + of_value[1] * rows[1, i] + of_value[2] * rows[2, i]
    return True


@njit(error_model="numpy")
def line_noise(at, half, of_value, points, fit):
    """Return the variance of a value by a line's localisation.

    ``points`` are as many as are fitted, at the middles of equal parts; ``fit`` holds sigma_x / d, sigma_y / d, and how
    many independent points there are per length of image over d (0: as many as points), and the floor as a factor.
    """
    n = np.empty(3)
    w = np.empty(3)
    p = np.empty(3)
    row = np.empty(6)
    c = plane_of(at, n)
    spread = half * half * (1.0 - 1.0 / (points * points)) / 3.0
    total = 0.0
    for k in range(points):
        x = half * ((2 * k + 1.0) / points - 1.0)
        for i in range(3):
            p[i] = at[0, i] + x * at[1, i]
        point_row(at[2], n, c, p, w, row)
        share = (of_value[0] + of_value[1] * x / spread) / points
        total += share * share * noise(w, p[2], fit[0], fit[1])
    first = at[0] - half * at[1]
    last = at[0] + half * at[1]
    along = np.hypot(
        last[0] / last[2] - first[0] / first[2], last[1] / last[2] - first[1] / first[2]
    )
    return total * _fewer(points, along, fit)


@njit(error_model="numpy")
def circle_noise(at, radius, angles, solve, of_value, fit, closed):
    """Return the variance of a value by a circle's localisation; arguments as of the others."""
    n = np.empty(3)
    w = np.empty(3)
    p = np.empty(3)
    e = np.empty(3)
    row = np.empty(6)
    c = plane_of(at, n)
    m = len(angles)
    total = 0.0
    along = 0.0
    u = 0.0
    v = 0.0
    u_first = 0.0
    v_first = 0.0
    for k in range(m):
        for i in range(3):
            e[i] = angles[k, 0] * at[1, i] + angles[k, 1] * at[2, i]
            p[i] = at[0, i] + radius * e[i]
        point_row(e, n, c, p, w, row)
        weight = of_value[0] * solve[0, k] + of_value[1] * solve[1, k] + of_value[2] * solve[2, k]
        total += weight * weight * noise(w, p[2], fit[0], fit[1])
        u_next = p[0] / p[2]
        v_next = p[1] / p[2]
        if k == 0:
            u_first = u_next
            v_first = v_next
        else:
            along += np.hypot(u_next - u, v_next - v)
        u = u_next
        v = v_next
    if closed:
        along += np.hypot(u_first - u, v_first - v)
    else:
        along *= m / (m - 1.0)
    return total * _fewer(m, along, fit)


@njit(error_model="numpy")
def _fewer(points, along, fit):
    """Return by what factor variance differs because other than ``points`` independent ones are found."""
    if fit[2] == 0.0:
        return 1.0
    independent = max(3.0, along * fit[2])
    return max(points / independent, fit[3] * points)
