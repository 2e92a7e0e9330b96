"""Lines and circles in the part's frame, and how they are fitted to what an image shows."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from errors.exceptions import InvalidParameterError
from ground.convert import Meta, Shape, check_fields
from ground.decorators import njit

# Lines and circles in the part's frame, as a measurement knows them.


# products of larger coordinates overflow
Vector = Annotated[NDArray[np.float64], Shape(3), Meta(ge=-1e9, le=1e9)]


_UNIT = 1e-9
# by how much a unit vector changes when it is divided by its length again
_ROUNDED = 1e-15


@dataclass(frozen=True, eq=False)
class Line:
    """A straight edge.

    Parameters
    ----------
    p, q : array (3,)
        Its ends, mm.

    Raises
    ------
    InvalidParameterError
        If the ends are the same point, or not finite.
    """

    p: Vector
    q: Vector

    def __post_init__(self) -> None:
        object.__setattr__(self, "p", _vector("p", self.p))
        object.__setattr__(self, "q", _vector("q", self.q))
        if not self.length > 0:
            raise InvalidParameterError(
                f"a line must have two different ends. Got {self.p.tolist()} twice."
            )

    @property
    def length(self) -> float:
        """Distance of the ends, mm."""
        return float(np.linalg.norm(self.q - self.p))

    @property
    def direction(self) -> NDArray[np.float64]:
        """Unit vector from p to q; (3,)."""
        return (self.q - self.p) / self.length

    @property
    def middle(self) -> NDArray[np.float64]:
        """Point half way, mm; (3,)."""
        return (self.p + self.q) / 2


@dataclass(frozen=True, eq=False)
class Circle:
    """A rim, or an arc of it.

    Parameters
    ----------
    centre : array (3,)
        Centre, mm.
    axis : array (3,)
        Unit normal of its plane.
    radius_mm : float
        Radius, mm.
    start : array (3,), optional
        Unit vector from the centre to where an arc begins; it runs to the left about the axis. None is a whole circle.
    span_rad : float
        Angle of the arc, 2 pi for a whole circle.

    Raises
    ------
    InvalidParameterError
        If the radius or the angle is not positive, a vector is not finite, or the start runs along the axis.
    """

    centre: Vector
    axis: Vector
    radius_mm: float
    start: Vector | None = None
    span_rad: float = 2 * math.pi

    def __post_init__(self) -> None:
        object.__setattr__(self, "centre", _vector("centre", self.centre))
        axis = _vector("axis", self.axis)
        size = float(np.linalg.norm(axis))
        if not size > _UNIT:
            raise InvalidParameterError(f"axis must have a length. Got {axis.tolist()}.")
        object.__setattr__(self, "axis", axis / size)
        if not (math.isfinite(self.radius_mm) and self.radius_mm > 0):
            raise InvalidParameterError.of_rule(
                "radius_mm", "must be positive", repr(self.radius_mm)
            )
        if not 0 < self.span_rad <= 2 * math.pi + _UNIT:
            raise InvalidParameterError(f"span_rad must be in (0, 2 pi]. Got {self.span_rad!r}.")
        if self.start is not None:
            across = _vector("start", self.start)
            across = across - (across @ self.axis) * self.axis
            size = float(np.linalg.norm(across))
            if not size > _UNIT:
                raise InvalidParameterError(
                    f"start must not run along the axis. Got {np.asarray(self.start).tolist()}."
                )
            object.__setattr__(self, "start", across / size)

    @classmethod
    def as_stored(cls, **values: Any) -> Circle:
        """Return the circle of a file: a unit vector there is not rounded once more, so the file stays as it is."""
        circle = cls(**values)
        for name in ("axis", "start"):
            unit = getattr(circle, name)
            if unit is not None and np.abs(unit - values[name]).max() <= _ROUNDED:
                object.__setattr__(circle, name, _vector(name, values[name]))
        return circle

    @property
    def is_closed(self) -> bool:
        """Whether it is a whole circle."""
        return self.start is None

    @cached_property
    def basis(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Two unit vectors that span its plane, the first one towards the start; (3,) each."""
        x = self.start
        if x is None:
            x = np.eye(3)[int(np.argmin(np.abs(self.axis)))]
            x = x - (x @ self.axis) * self.axis
            x = x / np.linalg.norm(x)
        return x, np.cross(self.axis, x)

    def points(self, angles: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
        """Return points (n, 3) at angles (n,) from the start, rad."""
        x, y = self.basis
        return self.centre + self.radius_mm * (
            np.cos(angles)[:, None] * x + np.sin(angles)[:, None] * y
        )


Geometry = Line | Circle


def _vector(name: str, value: object) -> NDArray[np.float64]:
    vector = np.array(value, dtype=np.float64)
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise InvalidParameterError.of_rule(name, "must be three finite numbers", repr(value))
    vector.setflags(write=False)
    return vector


# How well points on an edge are found in the image.


POINTS = 16
"""Points that are found on an entity, where a model does not tell their number."""

FLOOR_PX = 0.05
"""Error that all points of an edge or rim have in common, px, where it is not given.

In path-traced images, edges over a whole rim were found 0.02 to 0.10 px off their position, and lines up to 0.04 px. It
stands for what is not known of real edges, too.
"""
DETECTOR_FLOOR_PX = 0.01
"""The same of the detector alone, on sharp edges, px: where the state of the edges is an error of its own.

In path-traced images of sharp edges, lines and rims were found 0.005 to 0.01 px off after registration.
"""

NotNegative = Annotated[float, Meta(ge=0, title="must be finite and not negative")]


@dataclass(frozen=True)
class Localisation:
    """A model of the errors of image points on an edge.

    Make it with one of its class methods.

    Attributes
    ----------
    model : {"rounding", "gaussian", "fit"}
        Its name.
    sigma_px : float
        Standard deviation of a point's position along each axis of the image, px. For rounding it
        is 1 / sqrt(12).
    points : int
        Number of independent points on a fitted line or circle. For ``fit`` it follows from the
        image's length.
    correlation_px : float
        Length in the image within which errors are correlated, px.
    floor_px : float
        Error that does not average out, px. ``gaussian``: standard deviation of an error across
        the edge that all points of an edge, rim or arc have in common. ``fit``: smallest standard
        deviation of a fit, however long the image is.

    Raises
    ------
    InvalidParameterError
        If the model is unknown, or a number breaks its rule.

    Examples
    --------
    >>> from planner import Localisation
    >>> found = Localisation.gaussian(0.1)
    >>> found.sigma_px, found.floor_px
    (0.1, 0.05)
    """

    model: Annotated[
        str,
        Meta(pattern="^(rounding|gaussian|fit)$", title="must be one of rounding, gaussian, fit"),
    ]
    sigma_px: NotNegative
    points: Annotated[int, Meta(ge=3, title="must be an integer of at least 3")] = POINTS
    correlation_px: NotNegative = 0.0
    floor_px: NotNegative = 0.0

    def __post_init__(self) -> None:
        check_fields(self, InvalidParameterError)
        if self.model == "rounding" and self.floor_px != 0:
            raise InvalidParameterError.of_rule(
                "floor_px", "must be 0 with rounding", repr(self.floor_px)
            )
        if self.model == "fit" and self.correlation_px == 0:
            raise InvalidParameterError("correlation_px must be positive. Got 0.")

    @classmethod
    def rounding(cls, points: int = POINTS) -> Localisation:
        """Return the paper's model: points rounded to whole pixels. It suits binary images.

        Parameters
        ----------
        points : int
            Number of points found on a line or circle.

        Returns
        -------
        Localisation
            The model.
        """
        return cls("rounding", 1 / math.sqrt(12), points)

    @classmethod
    def gaussian(
        cls, sigma_px: float = 0.1, points: int = POINTS, *, floor_px: float = FLOOR_PX
    ) -> Localisation:
        """Return independent normal errors of every end or point, and a common one of an entity.

        Sub-pixel line fits and corner detectors reached 0.04 to 0.11 px in rendered images. Over a
        whole rim the edge was off by 0.02 to 0.10 px, over a line by up to 0.04 px; see
        ``docs/showing.md``.

        Parameters
        ----------
        sigma_px : float
            Standard deviation of a point along each axis of the image, px.
        points : int
            Independent points on a fitted line or circle.
        floor_px : float
            Standard deviation of the error across the edge that all points of an entity have in
            common, px. A rim is found larger or smaller by it, a line is shifted, and each end of a
            length is shifted along the edge. It is independent between entities.

        Returns
        -------
        Localisation
            The model.
        """
        return cls("gaussian", sigma_px, points, floor_px=floor_px)

    @classmethod
    def fit(
        cls, sigma_px: float = 0.3, correlation_px: float = 2.0, floor_px: float = 0.02
    ) -> Localisation:
        """Return errors that average out over the length of the image, but not below a floor.

        Parameters
        ----------
        sigma_px : float
            Standard deviation of a point along each axis of the image, px.
        correlation_px : float
            Length in the image per independent point, px.
        floor_px : float
            Smallest standard deviation of a fit, px.

        Returns
        -------
        Localisation
            The model.
        """
        return cls("fit", sigma_px, POINTS, correlation_px, floor_px)

    @property
    def common_px(self) -> float:
        """Standard deviation of the error that all points of an entity have in common, px."""
        return self.floor_px if self.model == "gaussian" else 0.0

    def __str__(self) -> str:
        """Return what a report says of it."""
        if self.model == "rounding":
            return "rounding to whole pixels"
        if self.model == "gaussian":
            common = f", {self.floor_px:g} px per entity" if self.floor_px else ""
            return f"gaussian, {self.sigma_px:g} px per point{common}"
        return f"fit, {self.sigma_px:g} px per {self.correlation_px:g} px of image, {self.floor_px:g} px at best"


# Lines and circles fitted in planes of the part: arrays for compiled loops, and the loop over
# poses.


# Values fitted to what is carried back, to second order in the displacement of the pose.
#
# Notation (camera frame, nominal pose)
# -------------------------------------
# delta = (t, phi)   the real camera stands at the nominal pose times (R(phi), t): C' = R(phi)' (C - t)
# n, c               plane of an entity: n.X = c; a measured point is carried back along its ray to it
# X(delta)           = C' c / (n.C'), for C on the plane: C + u1 + u2
# e                  a unit vector of the plane;  w = e - n (e.C)/c: e.P with P the projection along the ray of C
# a = (-w, w x C)    row of e.u1 in delta;  s = (-n, n x C)/c the same of n.C'/c - 1
# e.u2               = w.(phi x t) + 1/2 [(phi.w)(phi.C) - (w.C) phi.phi] - (s.delta)(a.delta)
#
# A **line** goes to the line through its displaced ends. With y across and x along it, l its
# length:
#
#     offset in the middle   h = (y_p + y_q)/2 - (x_p + x_q)/2 (y_q - y_p)/l
#     slope                  k = (y_q - y_p)/l - (y_q - y_p)(x_q - x_p)/l^2
#
# A **circle** is fitted by least squares of distances. With a_i, b_i the radial and tangential
# displacement of point i, A the rows (cos, sin, 1), q_i = b_i - tangential part of the first-
# order centre, and r_i = a_i - (A theta_1)_i:
#
#     theta = (centre x, centre y, radius) = (A'A)^-1 [A'(a + q^2 / 2 rho) + sum r_i q_i (-sin_i, cos_i, 0) / rho]
#
# Noise of a point, sigma_x and sigma_y on the image, moves it in the plane by (z / d) P(sigma_x x
# + sigma_y y), with z its depth and d the image distance: to first order independent of the
# pose's error.


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
    # mean square of the places of the points along the line
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
        # from the first to the last middle of m equal parts is (m - 1) / m of the arc
        along *= m / (m - 1.0)
    return total * _fewer(m, along, fit)


@njit(error_model="numpy")
def _fewer(points, along, fit):
    """Return by what factor variance differs because other than ``points`` independent ones are found."""
    if fit[2] == 0.0:
        return 1.0
    independent = max(3.0, along * fit[2])
    return max(points / independent, fit[3] * points)


# Errors that all points of an entity have in common, so that no number of points averages them
# out.
#
# Floor: every point is found wrong by the same number of pixels along the edge's normal in the
# image. All points of a rim move outward or inward, and a line is shifted. (t_x, t_y) is the
# direction of the image at a point, one image distance away; s_x and s_y are the error in px
# times the pixel pitch over the image distance. The point moves there by
#
#     (-s_x t_y / s_y, s_y t_x / s_x) / hypot(t_x / s_x, t_y / s_y).
#
# Surface: the face that carries an entity lies off its plane by the same distance everywhere.
# Moving an entity along its plane's normal is moving the camera against it. So the response of a
# value is minus its gradient by the camera's translation, of this entity alone, along the normal.


@njit(error_model="numpy")
def line_floor(at, half, of_value, points, common):
    """Return what a value changes by when a line is found wrong by one standard deviation of the floor.

    Arguments as of `errors.measurands.geometry.line_noise`; ``common`` holds s_x and s_y.
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


_LINE = 0
_CIRCLE = 1
_ARC = 2
# of the radius: an arc that is known no better than that is not measured, as its fit is not near to linear there
_MOST_NOISE = 0.1
ONE_SURFACE_MM = 1e-3
"""Entities whose planes are no farther apart than this lie on one surface, and share its deviation."""


class Frame(NamedTuple):
    """The plane an entity is fitted in: origin, x and y (3,) each; of a line x runs along it and y across."""

    origin: NDArray[np.float64]
    x: NDArray[np.float64]
    y: NDArray[np.float64]


class FittedEntities:
    """What is fitted for a value, and the value's derivatives by it.

    Parameters
    ----------
    geometry : tuple of Line or Circle
        The entities.
    frames : tuple of Frame
        Their planes.
    gradient, hessian : array (p,), (p, p)
        Of the value by what is fitted, see `Measurand.describe`.
    """

    def __init__(
        self,
        geometry: tuple[Geometry, ...],
        frames: tuple[Frame, ...],
        gradient: NDArray[np.float64],
        hessian: NDArray[np.float64],
    ):
        self.gradient = np.ascontiguousarray(gradient, dtype=np.float64)
        self.hessian = np.ascontiguousarray(hessian, dtype=np.float64)
        self.shapes = np.array(
            [
                _LINE if isinstance(shape, Line) else _CIRCLE + (not shape.is_closed)
                for shape in geometry
            ]
        )
        self.frames = np.array([[frame.origin, frame.x, frame.y] for frame in frames])
        self.sizes = np.array(
            [shape.length / 2 if isinstance(shape, Line) else shape.radius_mm for shape in geometry]
        )
        self.surfaces, self.normals = _surfaces(frames)
        self._geometry = geometry

    def expand(
        self,
        poses: NDArray[np.float64],
        image_distance_mm: float,
        pitch_mm: tuple[float, float],
        localisation: Localisation,
        surfaces_mm: float = 0.0,
    ) -> tuple[NDArray[np.bool_], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return where the value can be measured (n,), gradient (n, 6), Hessian (n, 6, 6) and variances (n, 3).

        The variances are those of the noise, as of `errors.measurands.measurand.Expansion`.
        """
        points = localisation.points
        angles = np.zeros((len(self.shapes), points, 2))
        solve = np.zeros((len(self.shapes), 6, points))
        for k, shape in enumerate(self._geometry):
            if isinstance(shape, Circle):
                angles[k], solve[k] = circle_fit(shape, points)
        n = len(poses)
        sigma = localisation.sigma_px
        per_length = 0.0
        floor = 0.0
        if localisation.model == "fit":
            per_length = image_distance_mm / (localisation.correlation_px * max(pitch_mm))
            floor = (localisation.floor_px / sigma) ** 2 if sigma > 0 else 0.0
        fit = np.array(
            [*(sigma * pitch / image_distance_mm for pitch in pitch_mm), per_length, floor]
        )
        common = np.array(
            [
                *(localisation.common_px * pitch / image_distance_mm for pitch in pitch_mm),
                surfaces_mm,
            ]
        )
        seen = np.zeros(n, dtype=np.bool_)
        gradient = np.zeros((n, 6))
        hessian = np.zeros((n, 6, 6))
        variance = np.zeros((n, 3))
        _expand_all(
            np.ascontiguousarray(poses),
            (self.shapes, self.frames, self.sizes, angles, solve, self.surfaces, self.normals),
            self.gradient,
            self.hessian,
            fit,
            common,
            (seen, gradient, hessian, variance),
        )
        return seen, gradient, hessian, variance

    def by_entity(self, poses: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the value's gradient by the displacement of the camera, of each entity alone; (n, e, 6)."""
        angles = np.zeros((len(self.shapes), POINTS, 2))
        solve = np.zeros((len(self.shapes), 6, POINTS))
        for k, shape in enumerate(self._geometry):
            if isinstance(shape, Circle):
                angles[k], solve[k] = circle_fit(shape, POINTS)
        gradient = np.zeros((len(poses), len(self.shapes), 6))
        entities = (self.shapes, self.frames, self.sizes, angles, solve)
        _by_entity(np.ascontiguousarray(poses), entities, self.gradient, gradient)
        return gradient


def _surfaces(frames: tuple[Frame, ...]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return which entities lie on one surface, as the index of its first one, and the surfaces' normals (k, 3)."""
    index = np.arange(len(frames))
    normals = np.array([np.cross(frame.x, frame.y) for frame in frames])
    for k, frame in enumerate(frames):
        for j in range(k):
            # kinds fit their entities in parallel planes
            if abs((frame.origin - frames[j].origin) @ normals[j]) <= ONE_SURFACE_MM:
                index[k] = index[j]
                normals[k] = normals[j]
                break
    return index, normals


def circle_fit(
    circle: Circle, points: int = POINTS
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return cosines and sines (m, 2) of the points that are fitted, and the linear fit (6, m) of `expand_circle`."""
    step = circle.span_rad / points
    angles = (np.arange(points) + 0.5) * step
    design = np.stack([np.cos(angles), np.sin(angles), np.ones(points)])
    inverse = np.linalg.inv(design @ design.T)
    tangents = np.stack([-np.sin(angles), np.cos(angles)])
    return design[:2].T.copy(), np.concatenate([inverse @ design, inverse[:, :2] @ tangents])


def is_short(shape: Geometry) -> bool:
    """Whether an entity is an arc of less than half a circle: its fit has no moments, only quantiles."""
    return isinstance(shape, Circle) and shape.span_rad < math.pi


@njit(error_model="numpy")
def _expand_all(poses, entities, of_value, bend, fit, common, out):
    shapes = entities[0]
    seen, gradient, hessian, variance = out
    count = len(of_value)
    rows = np.zeros((count, 6))
    by_surfaces = np.empty(len(shapes))
    before = np.empty(6)
    for i in range(len(poses)):
        g = gradient[i]
        h = hessian[i]
        start = 0
        whole = True
        by_surfaces[:] = 0.0
        for e in range(len(shapes)):
            n_fitted = 2 if shapes[e] == _LINE else 3
            by_fit = of_value[start : start + n_fitted]
            before[:] = g
            whole = _expand_entity(
                poses[i], entities, e, by_fit, fit, common, (g, h, rows[start:], variance[i])
            )
            if not whole:
                break
            # what lies on one surface is off by the same
            surface = entities[5][e]
            by_surfaces[surface] += by_surface(g, before, entities[6][surface], poses[i])
            start += n_fitted
        seen[i] = whole
        if not whole:
            continue
        for e in range(len(shapes)):
            variance[i, 2] += (by_surfaces[e] * common[2]) ** 2
        for j in range(count):
            for k in range(count):
                if bend[j, k] != 0.0:
                    for a in range(6):
                        for b in range(6):
                            h[a, b] += bend[j, k] * rows[j, a] * rows[k, b]


@njit(error_model="numpy")
def _expand_entity(pose, entities, e, by_fit, fit, common, out):
    """Add an entity's share to gradient, Hessian and variances; return False if it cannot be measured."""
    shapes, frames, sizes, angles, solve, _, _ = entities
    g, h, rows, variance = out
    at = np.empty((3, 3))
    turned(frames[e], pose, at)
    if shapes[e] == _LINE:
        if not expand_line(at, sizes[e], by_fit, g, h, rows):
            return False
        variance[0] += line_noise(at, sizes[e], by_fit, angles.shape[1], fit)
        if common[0] > 0.0:
            variance[1] += line_floor(at, sizes[e], by_fit, angles.shape[1], common) ** 2
        return True
    if not expand_circle(at, sizes[e], angles[e], solve[e], by_fit, g, h, rows):
        return False
    closed = shapes[e] == _CIRCLE
    variance[0] += circle_noise(at, sizes[e], angles[e], solve[e], by_fit, fit, closed)
    if common[0] > 0.0:
        variance[1] += circle_floor(at, sizes[e], angles[e], solve[e], by_fit, common) ** 2
    if closed:
        return True
    radius = np.array([0.0, 0.0, 1.0])
    radius_variance = circle_noise(at, sizes[e], angles[e], solve[e], radius, fit, closed)
    return radius_variance <= (_MOST_NOISE * sizes[e]) ** 2


@njit(error_model="numpy")
def _by_entity(poses, entities, of_value, gradient):
    shapes, frames, sizes, angles, solve = entities
    at = np.empty((3, 3))
    unused = np.empty((6, 6))
    rows = np.empty((3, 6))
    for i in range(len(poses)):
        start = 0
        for e in range(len(shapes)):
            n_fitted = 2 if shapes[e] == _LINE else 3
            by_fit = of_value[start : start + n_fitted]
            turned(frames[e], poses[i], at)
            g = gradient[i, e]
            if shapes[e] == _LINE:
                expand_line(at, sizes[e], by_fit, g, unused, rows)
            else:
                expand_circle(at, sizes[e], angles[e], solve[e], by_fit, g, unused, rows)
            start += n_fitted
