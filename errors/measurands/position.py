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
from itertools import pairwise
from typing import Any, ClassVar, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from errors.exceptions import MeasurandError
from errors.measurands.disc import quadratic_disc_probability
from errors.measurands.geometry import Circle, FittedEntities, Frame, Geometry, Line
from errors.measurands.measurand import (
    BREAKS_WIDER,
    COVERAGE,
    SOURCES,
    Expansion,
    Measurand,
    MeasurandModel,
    Prediction,
    kind,
)
from errors.model import quadratic_probability
from errors.registration import KnownPoses

Floats = NDArray[np.float64]

PARALLEL_RAD = 1e-3
"""Angle up to which datums are taken as parallel to the plane of the rim, or lines as across each other."""

_SAME = 1e-9
"""Circles that are apart by a smaller share of the largest radius have one axis."""

SAME_MIDDLE_MM = 0.001
"""Mid-lines of a model that are apart by no more are those of one plane."""

_RADIUS = 2
"""Place of the radius in what is fitted of a circle."""

Slot: TypeAlias = tuple[Line, Line]
HolePattern: TypeAlias = tuple[Circle, ...]
Datum: TypeAlias = Line | Circle | Slot | HolePattern


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
    datums : sequence of Line, Circle, (Line, Line) or tuple of Circle
        In their order, without those that are parallel to the plane of the rim: an edge shows a plane across, a rim a
        hole or pin, two edges a slot, several rims a pattern of holes, which is fitted by least squares.
    pattern : sequence of Circle
        The other rims of a pattern whose positions are asked for together. What the datums leave free is fitted to all
        of its rims by least squares.

    Attributes
    ----------
    free : tuple of str
        What the datums leave free: "rotation", "translation". About a hole as the only datum, the deviation counts
        along the radius only.
    components : int
        2, or 1 where only the deviation across a slot or along a radius counts.
    size_mm : float
        Nominal diameter of the rim, or width of the slot.
    by_size : array (p,)
        Derivatives of this size by what is fitted, entity after entity.

    Raises
    ------
    MeasurandError
        A datum is inclined to the plane of the rim, or fixes nothing, or a translation stays free.
    """

    def __init__(self, rim: Circle | Slot, datums: Sequence[Datum], pattern: Sequence[Circle] = ()):
        self.rim = rim
        self.datums = tuple(datums)
        self.pattern = tuple(pattern)
        if self.pattern and not isinstance(rim, Circle):
            raise MeasurandError("a pattern must be one of rims. Got a slot with a pattern.")
        if not self.datums and not self.pattern:
            raise MeasurandError("a position needs a datum in the plane of its rim. Got none.")
        shapes: list[Geometry] = []
        for item in (rim, *self.datums, *self.pattern):
            shapes += item if isinstance(item, tuple) else (item,)
        self.geometry = tuple(shapes)
        self.origin, self.axes = self._plane()
        self.frames = tuple(self._frame(shape) for shape in self.geometry)
        self._check_parallel()
        self.size_mm, self.by_size = self._size_of()
        self.free: tuple[str, ...] = ()
        self.components = 2
        self.errors = self._errors()

    def _plane(self) -> tuple[Floats, Floats]:
        """Return origin and axes (2, 3) of the plane of the rim; of a slot, the plane of both edges."""
        if isinstance(self.rim, Circle):
            return self.rim.centre, self._axes_about(self.rim)
        first, second = self.rim
        apart = second.middle - first.middle
        across = apart - (apart @ first.direction) * first.direction
        return 0.5 * (first.middle + second.middle), np.stack(
            [first.direction, across / np.linalg.norm(across)]
        )

    def _size_of(self) -> tuple[float, Floats]:
        """Return the nominal diameter or width, and its derivatives by what is fitted."""
        by_size = np.zeros(sum(2 if isinstance(s, Line) else 3 for s in self.geometry))
        if isinstance(self.rim, Circle):
            by_size[_RADIUS] = 2.0
            return 2.0 * self.rim.radius_mm, by_size
        first, second = self.rim
        across = self.axes[1]
        # offset and slope of the first edge, then those of the second one
        by_size[0] = -float(self.frames[0].y @ across)
        by_size[2] = float(self.frames[1].y @ across)
        return float((second.middle - first.middle) @ across), by_size

    def _axes_about(self, rim: Circle) -> Floats:
        """Return axes in the plane of a rim: x along the first edge among the datums, if there is one."""
        for datum in self.datums:
            if isinstance(datum, Line):
                along = datum.direction - (datum.direction @ rim.axis) * rim.axis
                if float(np.linalg.norm(along)) > PARALLEL_RAD:
                    x = along / np.linalg.norm(along)
                    return np.stack([x, np.cross(rim.axis, x)])
        return np.stack(rim.basis)

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
            x = self._flat(frame.x)
            y = self._flat(frame.y)
            p = variables[start]
            q = variables[start + 1]
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
            if isinstance(datum, tuple) and isinstance(datum[0], Circle):
                places = [point for point, _ in fitted[start : start + n]]
                self._fix_by_pattern(fixed, places)
            else:
                self._fix(fixed, datum, fitted[start : start + n])
            if before == (fixed.direction is None, len(fixed.anchors)):
                raise MeasurandError(
                    "each datum must fix what is still free of rotation and translations. "
                    f"Got datum {self.datums.index(datum) + 1}, which fixes nothing."
                )
            start += n
        if self.pattern:
            self._fix_by_pattern(fixed, [place, *(point for point, _ in fitted[start:])])
        return self._deviation(fixed, place, fitted[0][1])

    @staticmethod
    def _fix_by_pattern(fixed: _Free, places: Sequence[Point]) -> None:
        """Fit what datums have left free to all rims of a pattern, by least squares."""
        share = 1.0 / len(places)
        middle = places[0][0] * share, places[0][1] * share
        for place in places[1:]:
            middle = middle[0] + place[0] * share, middle[1] + place[1] * share
        at = _plain(middle)
        if not fixed.anchors:
            fixed.anchors += [
                (middle, at, np.array([1.0, 0.0])),
                (middle, at, np.array([0.0, 1.0])),
            ]
        elif len(fixed.anchors) == 1:
            normal = fixed.anchors[0][2]
            fixed.anchors.append((middle, at, np.array([-normal[1], normal[0]])))
        if fixed.direction is not None:
            return
        # the turn about the fixed point that brings the rims nearest to their places
        origin, about, _ = fixed.anchors[0]
        cosine: Jet | float = 0.0
        sine: Jet | float = 0.0
        for place in places:
            apart = _minus(place, origin)
            x, y = _plain(place) - about
            cosine = cosine + apart[0] * float(x) + apart[1] * float(y)
            sine = sine + apart[1] * float(x) - apart[0] * float(y)
        if isinstance(cosine, Jet) and isinstance(sine, Jet) and cosine.value > 0.0:
            fixed.direction = _unit((cosine, sine)), np.array([1.0, 0.0])

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
                if float(np.linalg.norm(apart)) > _SAME * self._size():
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
        across_slot = np.array([0.0, 1.0])
        if len(rows) == 2:
            shares = np.linalg.solve(np.stack(normals).T, across_slot)
            return (rows[0] * float(shares[0]) + rows[1] * float(shares[1]),)
        if abs(_cross(normals[0], across_slot)) > PARALLEL_RAD:
            raise MeasurandError(
                "a datum must fix the translation across the slot. Got one that is free."
            )
        return (rows[0] * float(normals[0] @ across_slot),)

    def _radial(self, fixed: _Free, place: Point, nominal: Floats) -> tuple[Jet, ...]:
        """Return the deviation of the distance from the datum's centre: about it the rotation is free."""
        centre, at, _ = fixed.anchors[0]
        apart = _minus(place, centre)
        distance = float(np.linalg.norm(nominal - at))
        self.free = ("rotation",)
        if isinstance(self.rim, tuple):
            raise MeasurandError("a datum must fix the rotation for a slot. Got one that is free.")
        if distance <= _SAME * self._size():
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


@kind("position")
class Position(Measurand):
    """Position 2‖e‖ of a rim, mm, against datums in their order: edges of planes across, rims of holes or pins.

    Parameters
    ----------
    geometry : tuple of Line or Circle
        The rim, or the two edges of a slot or tab. Then each datum in its order. Then the other rims of a pattern.
    direction : None
        It has none.
    groups : tuple of int
        Number of entities of each datum: 2 of a slot or tab, those of a pattern of holes, otherwise 1. Entities beyond
        them are the other rims of the pattern that has the position. Empty if each datum has one, and there is no
        pattern.
    """

    takes: ClassVar[tuple[type, ...]] = (Circle,)
    and_more = True
    n_first: ClassVar[int] = 1
    """Number of entities that have the position."""

    def __init__(
        self, geometry: tuple[Geometry, ...], direction: Any = None, groups: tuple[int, ...] = ()
    ):
        self.groups = tuple(groups)
        first, datums, pattern = self._items(tuple(geometry))
        self.frame = PositionFrame(first, datums, pattern)
        super().__init__(geometry, direction)
        jets = list(self.frame.errors)
        if len(jets) == 2:
            # variances of the sum tell the covariances
            jets.append(jets[0] + jets[1])
        self.components = [
            FittedEntities(geometry, self.frames, jet.gradient, jet.hessian) for jet in jets
        ]

    def _items(
        self, geometry: tuple[Geometry, ...]
    ) -> tuple[Circle | Slot, list[Datum], list[Circle]]:
        """Return what has the position, its datums, and the other rims of its pattern."""
        first: Any = _item(geometry[: self.n_first])
        if isinstance(first, Line):
            raise MeasurandError("a position must have a rim first. Got a straight edge.")
        others = geometry[self.n_first :]
        groups = self.groups or self._usual_groups(others)
        n_datums = sum(groups)
        pattern = [shape for shape in others[n_datums:] if isinstance(shape, Circle)]
        if n_datums > len(others) or len(pattern) < len(others) - n_datums:
            raise MeasurandError(
                f"groups must count the entities of the datums, and a pattern must be one of rims. Got {groups} "
                f"for {len(others)} entities after the first."
            )
        datums: list[Datum] = []
        start = 0
        for n in groups:
            # a pattern without datums states one of no entities
            if n:
                datums.append(_item(others[start : start + n]))
            start += n
        return first, datums, pattern

    def datum_names(self, names: Sequence[str]) -> list[str]:
        """Return the names of each datum's entities, given the names of all entities in their order.

        Parameters
        ----------
        names : sequence of str
            Names of what has the position, of the datums and of the pattern.
        """
        others = names[self.n_first :]
        groups = self.groups or self._usual_groups(self.geometry[self.n_first :])
        ends = np.cumsum([0, *groups]).tolist()
        parts = [others[a:b] for a, b in pairwise(ends)]
        return ["-".join(part) for part in parts if part]

    def _usual_groups(self, others: Sequence[Geometry]) -> tuple[int, ...]:
        return (1,) * len(others)

    def __getstate__(self) -> dict[str, Any]:
        return {**super().__getstate__(), "groups": self.groups}

    def __setstate__(self, state: dict[str, Any]) -> None:
        type(self).__init__(self, state["geometry"], state["direction"], state["groups"])

    def describe(self) -> tuple[float, tuple[Frame, ...], Floats, Floats]:
        """Return nominal value, frames, and the derivatives of the first component of e."""
        jet = self.frame.errors[0]
        return 0.0, self.frame.frames, jet.gradient, jet.hessian

    @property
    def size_mm(self) -> float:
        """Nominal diameter of the rim or width of the slot, mm."""
        return self.frame.size_mm

    def deviations(self, fitted: list[Floats]) -> Floats:
        """Return what is fitted (n, p) as deviations from the model, entity after entity."""
        parts = []
        for shape, values in zip(self.geometry, fitted, strict=True):
            nominal = np.zeros(values.shape[1])
            if isinstance(shape, Circle):
                nominal[2] = shape.radius_mm
            parts.append(values - nominal)
        return np.concatenate(parts, axis=1)

    def error(self, fitted: list[Floats]) -> Floats:
        """Return e (n, c) by what is fitted, in the axes of the frame."""
        d = self.deviations(fitted)
        columns = [
            jet.value + d @ jet.gradient + 0.5 * np.einsum("ni,ij,nj->n", d, jet.hessian, d)
            for jet in self.frame.errors
        ]
        return np.stack(columns, axis=1)

    def along(self, shares: ArrayLike, size: float = 0.0) -> PositionComponent:
        """Return a sum of components of e, which is a number that is nearly linear in what is fitted.

        Parameters
        ----------
        shares : array_like (c,)
            Of each component.
        size : float
            Share of the deviation of diameter or width, which counts where a material condition widens the zone.
        """
        return PositionComponent(self, np.asarray(shares, dtype=np.float64), size)

    def value(self, fitted: list[Floats]) -> Floats:
        """Return positions (n,) by what is fitted."""
        return np.asarray(2.0 * np.linalg.norm(self.error(fitted), axis=1))

    def model(self, **means: Any) -> PositionModel:
        """Return how surely it is measured, see `MeasurandModel`."""
        return PositionModel(self, **means)


def _item(shapes: Sequence[Geometry]) -> Datum:
    """Return one rim or edge, the two edges of a slot or tab, or the rims of a pattern."""
    if len(shapes) == 1:
        return shapes[0]
    if len(shapes) == 2 and isinstance(shapes[0], Line) and isinstance(shapes[1], Line):
        return shapes[0], shapes[1]
    rims = tuple(shape for shape in shapes if isinstance(shape, Circle))
    if len(rims) == len(shapes) > 1:
        return rims
    raise MeasurandError(
        "a datum must be a rim, an edge, the two edges of a slot, or the rims of a pattern. Got others."
    )


@kind("width_position")
class WidthPosition(Position):
    """Position 2|e| of the mid-line of a slot or tab across it, mm, against datums in their order."""

    takes = (Line, Line)
    n_first = 2


@kind("symmetry")
class Symmetry(WidthPosition):
    """Symmetry 2|e| of a slot or tab, mm: how far its mid-line is off that of the datum's slot or tab."""

    def __init__(
        self, geometry: tuple[Geometry, ...], direction: Any = None, groups: tuple[int, ...] = ()
    ):
        super().__init__(geometry, direction, groups)
        if len(geometry) == 4:
            middles = [(line.p + line.q) / 2 for line in geometry if isinstance(line, Line)]
            apart = middles[0] + middles[1] - middles[2] - middles[3]
            apart_mm = abs(float(apart @ self.frames[0].y)) / 2
            if apart_mm > SAME_MIDDLE_MM:
                raise MeasurandError(
                    f"a symmetry must have one mid-line for both slots. Got two, {apart_mm:.4g} mm apart."
                )

    def _usual_groups(self, others: Sequence[Geometry]) -> tuple[int, ...]:
        return (2,) if len(others) == 2 else super()._usual_groups(others)


@kind("coaxiality")
class Coaxiality(Position):
    """Coaxiality 2‖e‖ of two circles in parallel planes, mm, in the plane of the first one."""

    takes = (Circle, Circle)

    def __init__(
        self, geometry: tuple[Geometry, ...], direction: Any = None, groups: tuple[int, ...] = ()
    ):
        super().__init__(geometry, direction, groups)
        if self.frame.components != 2 or len(geometry) != 2:
            raise MeasurandError(
                "a coaxiality must have two circles about one axis. Got circles that are apart, or more."
            )


class PositionComponent(Measurand):
    """A sum of components of a position's error e and of the deviation of its size, mm.

    Parameters
    ----------
    position : Position
        The position.
    shares : array (c,)
        Of each component.
    size : float
        Of the deviation of diameter or width.
    """

    kind = "position"

    def __init__(self, position: Position, shares: Floats, size: float = 0.0):
        self.position = position
        self.shares = shares
        self.size = size
        super().__init__(position.geometry)

    def describe(self) -> tuple[float, tuple[Frame, ...], Floats, Floats]:
        """Return nominal value, frames, and the derivatives by what is fitted, see `Measurand`."""
        jets = self.position.frame.errors
        gradient = sum(share * jet.gradient for share, jet in zip(self.shares, jets, strict=True))
        hessian = sum(share * jet.hessian for share, jet in zip(self.shares, jets, strict=True))
        gradient = np.asarray(gradient) + self.size * self.position.frame.by_size
        return 0.0, self.position.frames, gradient, np.asarray(hessian)

    def value(self, fitted: list[Floats]) -> Floats:
        """Return the sums (n,) by what is fitted."""
        size = self.position.deviations(fitted) @ self.position.frame.by_size
        return np.asarray(self.position.error(fitted) @ self.shares + self.size * size)


class QuadraticError(NamedTuple):
    """An error Gδ + ½ δ'Hδ + noise in independent standard normal variates δ (k).

    Attributes
    ----------
    gradient, hessian : array (c, k), (c, k, k)
        Of each component.
    noise : array (c, c)
        Covariance of the noise, mm².
    """

    gradient: Floats
    hessian: Floats
    noise: Floats

    @property
    def covariance(self) -> Floats:
        """Covariance of the error (c, c), mm²."""
        g, h, noise = self
        return np.asarray(g @ g.T + noise + 0.5 * np.einsum("aij,bji->ab", h, h))


class PositionModel(MeasurandModel):
    """The joint second-order model of a position's error e in one image.

    It takes what `MeasurandModel` takes. The value is 2‖e‖, so e must stay within half of the permitted error.

    Attributes
    ----------
    measurand : Position
        The position.
    """

    measurand: Position

    def probability(self, world_to_camera: ArrayLike) -> Floats:
        """Return the probability that ‖e‖ is at most half the permitted error.

        Parameters
        ----------
        world_to_camera : array_like (n, 4, 4)
            Planned poses.

        Returns
        -------
        array (n,)
            In [0, 1]; 0 without an image.
        """
        poses = np.asarray(world_to_camera, dtype=np.float64)
        return self._probabilities(poses, np.broadcast_to(self._root, (len(poses), 6, 6)))

    def probability_at(
        self, world_to_camera: ArrayLike, poses: KnownPoses, excess: Floats
    ) -> Floats:
        """Return the same with a covariance of each pose.

        Parameters
        ----------
        world_to_camera : array_like (n, 4, 4)
            Planned poses.
        poses : KnownPoses
            Their covariances, with roots.
        excess : array (n,)
            Does not count here: the surfaces are those of the request, whatever the registration tells of them.

        Returns
        -------
        array (n,)
            In [0, 1].
        """
        return self._probabilities(np.asarray(world_to_camera, dtype=np.float64), poses.root)

    def scale(self, world_to_camera: ArrayLike) -> float:
        """Return 1; 0 without an image."""
        seen, _, _, _ = self._expand(np.asarray(world_to_camera, dtype=np.float64))
        return float(seen[0])

    def covariance_at(self, world_to_camera: ArrayLike) -> Floats:
        """Return the covariance of e at one pose.

        Parameters
        ----------
        world_to_camera : array_like (4, 4)
            Planned pose.

        Returns
        -------
        array (c, c)
            mm²; infinite without an image.
        """
        error = self.in_unit_variates(world_to_camera)
        if error is None:
            n = len(self.measurand.frame.errors)
            return np.full((n, n), math.inf)
        return error.covariance

    def in_unit_variates(self, world_to_camera: ArrayLike) -> QuadraticError | None:
        """Return e at one pose as a quadratic form of the camera's displacement; None without an image.

        Parameters
        ----------
        world_to_camera : array_like (4, 4)
            Planned pose.
        """
        pose = np.asarray(world_to_camera, dtype=np.float64)[None]
        seen, gradient, hessian, noise = self._expand(pose)
        if not seen[0]:
            return None
        h = np.einsum("ji,ajk,kl->ail", self._root, hessian[0], self._root)
        return QuadraticError(gradient[0] @ self._root, h, noise[0].sum(axis=0))

    def describe(self, world_to_camera: ArrayLike) -> Prediction:
        """Return how sure the position is measured from one pose, along the axis in which e is largest.

        Parameters
        ----------
        world_to_camera : array_like (4, 4)
            Planned pose.

        Returns
        -------
        Prediction
            Uncertainty and budget are those of 2‖e‖ where e lies along that axis.
        """
        pose = np.asarray(world_to_camera, dtype=np.float64)[None]
        seen, gradient, hessian, noise = self._expand(pose)
        if not seen[0]:
            nothing = dict.fromkeys(SOURCES, math.inf)
            return Prediction(0.0, self.permitted_error, 0.0, math.inf, math.inf, math.nan, nothing)
        _, axes = np.linalg.eigh(self.covariance_at(pose[0]))
        axis = 2.0 * axes[:, -1]
        expansion = Expansion(
            seen,
            np.einsum("a,nai->ni", axis, gradient),
            np.einsum("a,naij->nij", axis, hessian),
            np.einsum("a,nsab,b->ns", axis, noise, axis),
            np.zeros((1, 2)),
            np.ones(1),
        )
        budget, bias = self._budget(expansion)
        u = math.sqrt(math.fsum(budget.values()))
        probability = float(self.probability(pose)[0])
        return Prediction(0.0, self.permitted_error, probability, u, COVERAGE * u, bias, budget)

    def _expand(self, poses: Floats) -> tuple[NDArray[np.bool_], Floats, Floats, Floats]:
        """Return where there is an image (n,), derivatives of e (n, c, 6) and (n, c, 6, 6), and noise (n, 3, c, c)."""
        surfaces_mm = self.surfaces_mm
        rows = [
            entities.expand(
                poses, self.image.distance_mm, self.image.pitch_mm, self.localisation, surfaces_mm
            )
            for entities in self.measurand.components
        ]
        n = len(self.measurand.frame.errors)
        gradient = np.stack([g for _, g, _, _ in rows[:n]], axis=1)
        hessian = np.stack([h for _, _, h, _ in rows[:n]], axis=1)
        noise = np.zeros((len(poses), 3, n, n))
        for k in range(n):
            noise[:, :, k, k] = rows[k][3]
        if n == 2:
            both = 0.5 * (rows[2][3] - rows[0][3] - rows[1][3])
            noise[:, :, 0, 1] = both
            noise[:, :, 1, 0] = both
        return rows[0][0], gradient, hessian, noise

    def _probabilities(self, poses: Floats, roots: Floats) -> Floats:
        seen, gradient, hessian, noise = self._expand(poses)
        radius = 0.5 * self.permitted_error
        n = gradient.shape[1]
        # of 2‖e‖, along both axes
        broken = (0.5 * BREAKS_WIDER * self.by_edges) ** 2 * np.eye(n)
        result = np.zeros(len(poses))
        for i in np.flatnonzero(seen):
            g = gradient[i] @ roots[i]
            h = np.einsum("ji,ajk,kl->ail", roots[i], hessian[i], roots[i])
            extra = noise[i].sum(axis=0) + broken
            if n == 2:
                result[i] = quadratic_disc_probability(g, h, extra, radius)
                continue
            parts = np.array([[0.0, 0.0, extra[0, 0]]])
            limits = np.array([[-radius, radius]])
            result[i] = quadratic_probability(g, h, np.eye(6), parts, limits)[0]
        return result
