"""The position of a hole, pin or slot against datums, in the plane of its rim.

A datum reference frame is found in this plane from what is fitted: each datum in its order fixes what is still free of
a rotation and two translations. The error e of the position is a vector of two components, in the axes of the frame, so
a rotation of the camera about the normal of the plane changes no e.

Lines and circles are fitted (least squares), and not touched at their highest points. A rim shows where the hole is in
the plane of its rim, and not its axis.

Reference: ISO 5459 and ASME Y14.5, datum reference frames; ISO 1101, position.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from errors.checks import (
    check_covariance,
    check_not_negative,
    check_pixel_pitch,
    check_positive,
    covariance_root,
)
from errors.exceptions import InvalidShapeError, MeasurandError
from errors.measurands.disc import disc_probability, quadratic_disc_probability
from errors.measurands.geometry import Circle, FittedEntities, Frame, Geometry, Line, Localisation
from errors.model import quadratic_probability

Floats = NDArray[np.float64]

PARALLEL_RAD = 1e-3
"""Angle up to which datums are taken as parallel to the plane of the rim, or lines as across each other."""

Slot: TypeAlias = tuple[Line, Line]
Datum: TypeAlias = Line | Circle | Slot


class Jet:
    """A number with its gradient and Hessian by n variables: arithmetic that differentiates exactly to second order.

    Parameters
    ----------
    value : float
        The number.
    gradient : array (n,)
        First derivatives.
    hessian : array (n, n)
        Second derivatives.
    """

    def __init__(self, value: float, gradient: Floats, hessian: Floats):
        self.value = value
        self.gradient = gradient
        self.hessian = hessian

    @classmethod
    def variables(cls, n: int) -> list[Jet]:
        """Return n variables at 0."""
        return [cls(0.0, np.eye(n)[k], np.zeros((n, n))) for k in range(n)]

    def __add__(self, other: Jet | float) -> Jet:
        if not isinstance(other, Jet):
            return Jet(self.value + other, self.gradient, self.hessian)
        return Jet(
            self.value + other.value, self.gradient + other.gradient, self.hessian + other.hessian
        )

    def __mul__(self, other: Jet | float) -> Jet:
        if not isinstance(other, Jet):
            return Jet(self.value * other, self.gradient * other, self.hessian * other)
        cross = np.outer(self.gradient, other.gradient)
        return Jet(
            self.value * other.value,
            self.value * other.gradient + other.value * self.gradient,
            self.value * other.hessian + other.value * self.hessian + cross + cross.T,
        )

    __radd__ = __add__
    __rmul__ = __mul__

    def __neg__(self) -> Jet:
        return self * -1.0

    def __sub__(self, other: Jet | float) -> Jet:
        return self + (-other)

    def __rsub__(self, other: float) -> Jet:
        return -self + other

    def of(self, value: float, slope: float, bend: float) -> Jet:
        """Return a function of it, by its value and its first two derivatives there."""
        square = np.outer(self.gradient, self.gradient)
        return Jet(value, slope * self.gradient, slope * self.hessian + bend * square)

    def inverse(self) -> Jet:
        """Return 1 / it."""
        return self.of(1.0 / self.value, -(self.value**-2), 2.0 * self.value**-3)

    def root(self) -> Jet:
        """Return its square root."""
        root = math.sqrt(self.value)
        return self.of(root, 0.5 / root, -0.25 / root**3)


Point: TypeAlias = tuple[Jet, Jet]


def _minus(a: Point, b: Point) -> Point:
    return a[0] - b[0], a[1] - b[1]


def _dot(a: Point, b: Point) -> Jet:
    return a[0] * b[0] + a[1] * b[1]


def _unit(a: Point) -> Point:
    scale = _dot(a, a).root().inverse()
    return a[0] * scale, a[1] * scale


def _cross(a: Floats, b: Floats) -> float:
    return float(a[0] * b[1] - a[1] * b[0])


def _plain(point: Point) -> Floats:
    return np.array([point[0].value, point[1].value])


@dataclass
class _Free:
    """What datums have fixed so far, as it was fitted and as it is in the model.

    Attributes
    ----------
    direction : (Point, array (2,)) or None
        Fitted and nominal direction that fixes the rotation.
    anchors : list of (Point, array (2,), array (2,))
        Translations: a fitted point, the nominal one, and the nominal direction along which it fixes the frame.
    """

    direction: tuple[Point, Floats] | None = None
    anchors: list[tuple[Point, Floats, Floats]] = field(default_factory=list)


class PositionFrame:
    """A datum reference frame in the plane of a rim, and the error of the rim's position in it.

    Parameters
    ----------
    rim : Circle or (Line, Line)
        What has the position: a rim, or the two edges of a slot or tab.
    datums : sequence of Line, Circle or (Line, Line)
        In their order, without those that are parallel to the plane of the rim: an edge shows a plane across, a rim a
        hole or pin, two edges a slot.

    Attributes
    ----------
    free : tuple of str
        What the datums leave free: "rotation", "translation". About a hole as the only datum, the deviation counts
        along the radius only.
    components : int
        2, or 1 where only the deviation across a slot or along a radius counts.

    Raises
    ------
    MeasurandError
        A datum is inclined to the plane of the rim, or fixes nothing, or a translation stays free.
    """

    def __init__(self, rim: Circle | Slot, datums: Sequence[Datum]):
        self.rim = rim
        self.datums = tuple(datums)
        if not self.datums:
            raise MeasurandError("a position needs a datum in the plane of its rim. Got none.")
        shapes: list[Geometry] = []
        for item in (rim, *self.datums):
            shapes += item if isinstance(item, tuple) else (item,)
        self.geometry = tuple(shapes)
        self.origin, self.axes = self._plane()
        self.frames = tuple(self._frame(shape) for shape in self.geometry)
        self._check_parallel()
        self.free: tuple[str, ...] = ()
        self.components = 2
        self.errors = self._errors()

    def _plane(self) -> tuple[Floats, Floats]:
        """Return origin and axes (2, 3) of the plane of the rim; of a slot, the plane of both edges."""
        if isinstance(self.rim, Circle):
            return self.rim.centre, np.stack(self.rim.basis)
        first, second = self.rim
        apart = second.middle - first.middle
        across = apart - (apart @ first.direction) * first.direction
        return 0.5 * (first.middle + second.middle), np.stack(
            [first.direction, across / np.linalg.norm(across)]
        )

    def _frame(self, shape: Geometry) -> Frame:
        """Return the plane in which an entity is fitted; all are parallel to that of the rim."""
        if isinstance(shape, Circle):
            return Frame(shape.centre, *shape.basis)
        normal = np.cross(*self.axes)
        return Frame(shape.middle, shape.direction, np.cross(normal, shape.direction))

    def _check_parallel(self) -> None:
        normal = np.cross(*self.axes)
        for shape in self.geometry:
            if isinstance(shape, Circle):
                lean = float(np.linalg.norm(np.cross(shape.axis, normal)))
            else:
                lean = abs(float(shape.direction @ normal))
            if lean > PARALLEL_RAD:
                raise MeasurandError(
                    "datums must lie in planes parallel to that of the rim. Got one that is inclined by "
                    f"{math.degrees(math.asin(min(1.0, lean))):.3g} degrees."
                )

    def _flat(self, vector: Floats) -> Floats:
        return self.axes @ vector

    def _fitted(self) -> list[tuple[Point, Point]]:
        """Return for each entity a fitted point and direction in the plane; of a circle the direction is its x axis."""
        n = sum(2 if isinstance(shape, Line) else 3 for shape in self.geometry)
        variables = Jet.variables(n)
        fitted = []
        start = 0
        for shape, frame in zip(self.geometry, self.frames, strict=True):
            at = self._flat(frame.origin - self.origin)
            x, y = self._flat(frame.x), self._flat(frame.y)
            p, q = variables[start], variables[start + 1]
            if isinstance(shape, Line):
                point = (p * y[0] + at[0], p * y[1] + at[1])
                along = (q * y[0] + x[0], q * y[1] + x[1])
                fitted.append((point, _unit(along)))
                start += 2
            else:
                centre = (p * x[0] + q * y[0] + at[0], p * x[1] + q * y[1] + at[1])
                fitted.append((centre, centre))
                start += 3
        return fitted

    def _errors(self) -> tuple[Jet, ...]:
        """Return the components of e with their derivatives by what is fitted."""
        fitted = self._fitted()
        n_rim = len(self.rim) if isinstance(self.rim, tuple) else 1
        place = self._middle(fitted[:n_rim])[0]
        fixed = _Free()
        start = n_rim
        for datum in self.datums:
            n = len(datum) if isinstance(datum, tuple) else 1
            before = (fixed.direction is None, len(fixed.anchors))
            self._fix(fixed, datum, fitted[start : start + n])
            if before == (fixed.direction is None, len(fixed.anchors)):
                raise MeasurandError(
                    "each datum must fix what is still free of rotation and translations. "
                    f"Got datum {self.datums.index(datum) + 1}, which fixes nothing."
                )
            start += n
        return self._deviation(fixed, place, fitted[0][1])

    @staticmethod
    def _middle(fitted: Sequence[tuple[Point, Point]]) -> tuple[Point, Point]:
        """Return point and direction of an entity; of two lines, those of their mid-line."""
        if len(fitted) == 1:
            return fitted[0]
        (a, u), (b, v) = fitted
        if _plain(u) @ _plain(v) < 0.0:
            v = (-v[0], -v[1])
        middle = ((a[0] + b[0]) * 0.5, (a[1] + b[1]) * 0.5)
        return middle, _unit((u[0] + v[0], u[1] + v[1]))

    def _fix(self, fixed: _Free, datum: Datum, fitted: Sequence[tuple[Point, Point]]) -> None:
        """Let a datum fix what is still free."""
        point, along = self._middle(fitted)
        at = _plain(point)
        if isinstance(datum, Circle):
            if not fixed.anchors:
                fixed.anchors += [
                    (point, at, np.array([1.0, 0.0])),
                    (point, at, np.array([0.0, 1.0])),
                ]
            elif len(fixed.anchors) == 1:
                # along what is free yet, if the rotation is fixed; a plane that came first fixed it
                normal = fixed.anchors[0][2]
                fixed.anchors.append((point, at, np.array([-normal[1], normal[0]])))
            elif fixed.direction is None:
                origin, nominal, _ = fixed.anchors[0]
                apart = at - nominal
                if float(np.linalg.norm(apart)) > 0.0:
                    fixed.direction = _unit(_minus(point, origin)), apart / np.linalg.norm(apart)
            return
        nominal_along = _plain(along)
        normal = np.array([-nominal_along[1], nominal_along[0]])
        if fixed.direction is None:
            fixed.direction = along, nominal_along
        # a line fixes the translation across it, if no datum did
        normals = [anchor[2] for anchor in fixed.anchors]
        across = all(abs(_cross(other, normal)) > PARALLEL_RAD for other in normals)
        if len(normals) < 2 and across:
            fixed.anchors.append((point, at, normal))

    def _deviation(self, fixed: _Free, place: Point, rim_along: Point) -> tuple[Jet, ...]:
        """Return the deviation of a place from its true position in the frame."""
        nominal = _plain(place)
        if fixed.direction is None:
            return self._radial(fixed, place, nominal)
        fitted_along, along = fixed.direction
        # the frame is turned by the rotation that takes the nominal direction to the fitted one
        cosine = fitted_along[0] * along[0] + fitted_along[1] * along[1]
        sine = fitted_along[1] * along[0] - fitted_along[0] * along[1]
        rows = []
        normals = []
        for point, at, normal in fixed.anchors:
            apart = _minus(place, point)
            # in the axes of the frame
            turned = (
                apart[0] * cosine + apart[1] * sine,
                apart[1] * cosine - apart[0] * sine,
            )
            true = float(normal @ (nominal - at))
            rows.append(turned[0] * normal[0] + turned[1] * normal[1] - true)
            normals.append(normal)
        if isinstance(self.rim, tuple):
            return self._across(rows, normals)
        if len(rows) < 2:
            raise MeasurandError(
                "datums must fix both translations in the plane of the rim. Got one that is free: "
                "the position along the datum edge has no true value."
            )
        inverse = np.linalg.inv(np.stack(normals))
        return tuple(
            rows[0] * float(inverse[k, 0]) + rows[1] * float(inverse[k, 1]) for k in range(2)
        )

    def _across(self, rows: list[Jet], normals: list[Floats]) -> tuple[Jet, ...]:
        """Return the deviation of a mid-line across it."""
        self.components = 1
        wanted = np.array([0.0, 1.0])
        if len(rows) == 2:
            shares = np.linalg.solve(np.stack(normals).T, wanted)
            return (rows[0] * float(shares[0]) + rows[1] * float(shares[1]),)
        if abs(_cross(normals[0], wanted)) > PARALLEL_RAD:
            raise MeasurandError(
                "a datum must fix the translation across the slot. Got one that is free."
            )
        return (rows[0] * float(normals[0] @ wanted),)

    def _radial(self, fixed: _Free, place: Point, nominal: Floats) -> tuple[Jet, ...]:
        """Return the deviation of the distance from the datum's centre: about it the rotation is free."""
        centre, at, _ = fixed.anchors[0]
        apart = _minus(place, centre)
        distance = float(np.linalg.norm(nominal - at))
        self.free = ("rotation",)
        if isinstance(self.rim, tuple):
            raise MeasurandError("a datum must fix the rotation for a slot. Got one that is free.")
        if distance <= 1e-9 * self._size():
            # coaxial circles: every direction counts
            return apart
        self.components = 1
        return (_dot(apart, apart).root() - distance,)

    def _size(self) -> float:
        return max(shape.radius_mm for shape in self.geometry if isinstance(shape, Circle))

    def error(self, fitted: Sequence[ArrayLike]) -> Floats:
        """Return e of what was fitted, to second order.

        Parameters
        ----------
        fitted : sequence of array
            Per entity in the order of ``geometry``: offset and slope of a line, centre and radius of a circle as
            deviations from the model, in the entity's frame.

        Returns
        -------
        array (components,)
            mm.
        """
        d = np.concatenate([np.asarray(values, dtype=np.float64) for values in fitted])
        return np.array(
            [jet.value + jet.gradient @ d + 0.5 * d @ jet.hessian @ d for jet in self.errors]
        )


@dataclass(frozen=True)
class PositionPrediction:
    """How sure a position is measured from one pose.

    Attributes
    ----------
    probability : float
        P(‖e‖ at most the permitted error); 0 without an image.
    covariance : array (c, c)
        Of the components of e, mm².
    bias : array (c,)
        Their mean errors, of second order, mm.
    """

    probability: float
    covariance: Floats
    bias: Floats


class PositionModel:
    """The joint second-order model of a position's error in one image.

    Parameters
    ----------
    frame : PositionFrame
        Rim and datums.
    image_distance_mm : float
        From the lens to the image plane, mm.
    pixel_pitch_mm : array_like (2,)
        Pixel pitch, mm.
    pose_covariance : array_like (6, 6)
        As `errors.measurands.MeasurandModel` takes it.
    localisation : Localisation
        How well points are found.
    permitted_error : float
        Largest ‖e‖ that counts as accurate, mm.
    surfaces_mm : float
        Standard deviation of a face's position along its normal, mm.

    Raises
    ------
    InvalidParameterError, InvalidShapeError
        A number breaks its rule.
    """

    def __init__(
        self,
        frame: PositionFrame,
        *,
        image_distance_mm: float,
        pixel_pitch_mm: ArrayLike,
        pose_covariance: ArrayLike,
        localisation: Localisation,
        permitted_error: float,
        surfaces_mm: float = 0.0,
    ):
        self.frame = frame
        pitch = check_pixel_pitch(pixel_pitch_mm)
        self.pitch_mm = (float(pitch[0]), float(pitch[1]))
        self.image_distance_mm = check_positive(image_distance_mm, "image_distance_mm")
        covariance = check_covariance(pose_covariance)
        if covariance.shape != (6, 6):
            raise InvalidShapeError.of_rule(
                "pose_covariance", "must have shape (6, 6)", f"shape {covariance.shape}"
            )
        self._root = covariance_root(covariance)
        self.localisation = localisation
        self.permitted_error = check_positive(permitted_error, "permitted_error")
        self.surfaces_mm = check_not_negative(surfaces_mm, "surfaces_mm")
        jets = list(frame.errors)
        if len(jets) == 2:
            # variances of the sum tell the covariances
            jets.append(jets[0] + jets[1])
        self._entities = [
            FittedEntities(frame.geometry, frame.frames, jet.gradient, jet.hessian) for jet in jets
        ]

    def describe(self, world_to_camera: ArrayLike) -> PositionPrediction:
        """Return how sure the position is measured from one pose.

        Parameters
        ----------
        world_to_camera : array_like (4, 4)
            Planned pose.

        Returns
        -------
        PositionPrediction
            Probability, covariance and bias.
        """
        pose = np.asarray(world_to_camera, dtype=np.float64)
        if pose.shape != (4, 4):
            raise InvalidShapeError.of_rule(
                "world_to_camera", "must have shape (4, 4)", str(pose.shape)
            )
        n = self.frame.components
        rows = [
            entities.expand(
                pose[None],
                self.image_distance_mm,
                self.pitch_mm,
                self.localisation,
                self.surfaces_mm,
            )
            for entities in self._entities
        ]
        if not all(seen[0] for seen, _, _, _ in rows):
            nothing = np.full((n, n), math.inf)
            return PositionPrediction(0.0, nothing, np.full(n, math.nan))
        gradient = np.stack([g[0] @ self._root for _, g, _, _ in rows[:n]])
        hessian = np.stack([self._root.T @ h[0] @ self._root for _, _, h, _ in rows[:n]])
        noise = np.diag([float(v[0].sum()) for _, _, _, v in rows[:n]])
        if n == 2:
            both = float(rows[2][3][0].sum())
            noise[0, 1] = noise[1, 0] = 0.5 * (both - noise[0, 0] - noise[1, 1])
        covariance = gradient @ gradient.T + noise
        covariance = covariance + 0.5 * np.einsum("aij,bji->ab", hessian, hessian)
        bias = 0.5 * np.einsum("aii->a", hessian)
        return PositionPrediction(self._probability(gradient, hessian, noise), covariance, bias)

    def _probability(self, gradient: Floats, hessian: Floats, noise: Floats) -> float:
        radius = self.permitted_error
        if self.frame.components == 2:
            if not hessian.any():
                return disc_probability(gradient @ gradient.T + noise, radius)
            return quadratic_disc_probability(gradient, hessian, noise, radius)
        parts = np.array([[0.0, 0.0, noise[0, 0]]])
        limits = np.array([[-radius, radius]])
        return float(quadratic_probability(gradient, hessian, np.eye(6), parts, limits)[0])
