"""The kinds of dimensions, one a file; a new one is imported here and is then known everywhere."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from errors.checks import MIN_IMAGE_LENGTH_MM
from errors.exceptions import MeasurandError
from errors.measurands.geometry import (
    Frame,
    Line,
    Localisation,
    MeasuredCircle,
    add_product,
    add_square,
    plane_row,
    point_row,
)
from errors.measurands.measurand import Expansion, Image, Measurand, circles_of, kind, lines_of
from ground.decorators import njit

# Whether directions are parallel, as far as a drawing means it.


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


# Diameter and radius of a rim or arc, fitted in its own plane.


def circle_frame(circle: MeasuredCircle) -> Frame:
    """Return the plane of a circle: x towards its start."""
    return Frame(circle.centre, *circle.basis)


class _CircleSize(Measurand):
    takes = (MeasuredCircle,)
    factor = 1.0

    def describe(self) -> tuple[float, tuple[Frame, ...], NDArray[np.float64], NDArray[np.float64]]:
        """Return nominal value, frames, and the derivatives by what is fitted, see `Measurand`."""
        (circle,) = circles_of(self.geometry)
        gradient = np.array([0.0, 0.0, self.factor])
        return self.factor * circle.radius_mm, (circle_frame(circle),), gradient, np.zeros((3, 3))

    def value(self, fitted: list[NDArray[np.float64]]) -> NDArray[np.float64]:
        """Return deviations (n,) by what is fitted."""
        (circle,) = circles_of(self.geometry)
        return np.asarray(self.factor * (fitted[0][:, 2] - circle.radius_mm))


@kind("radius")
class Radius(_CircleSize):
    """Radius of a rim or arc, mm."""


@kind("diameter")
class Diameter(_CircleSize):
    """Diameter of a rim or arc, mm."""

    factor = 2.0


# Angle of two edges.


_DEGREES = 180.0 / math.pi


@kind("angle")
class Angle(Measurand):
    """Angle of two lines, degrees in (0, 90]; each is fitted in the plane through it that is parallel to both."""

    unit = "deg"
    takes = (Line, Line)

    def describe(self) -> tuple[float, tuple[Frame, ...], NDArray[np.float64], NDArray[np.float64]]:
        """Return nominal value, frames, and the derivatives by what is fitted, see `Measurand`."""
        first, second = lines_of(self.geometry)
        direction = first.direction
        other = second.direction
        if are_parallel(direction, other):
            raise MeasurandError(
                "the edges of an angle must not be parallel. "
                f"Got {degrees_between(direction, other):.4g} degrees between them."
            )
        other = -other if direction @ other < 0 else other
        normal = np.cross(direction, other)
        normal = normal / np.linalg.norm(normal)
        frames = (
            Frame(first.middle, direction, np.cross(normal, direction)),
            Frame(second.middle, other, np.cross(normal, other)),
        )
        return (
            degrees_between(direction, other),
            frames,
            _DEGREES * np.array([0.0, -1.0, 0.0, 1.0]),
            np.zeros((4, 4)),
        )

    def value(self, fitted: list[NDArray[np.float64]]) -> NDArray[np.float64]:
        """Return deviations (n,) by what is fitted."""
        first, second = fitted
        return np.asarray(_DEGREES * (np.arctan(second[:, 1]) - np.arctan(first[:, 1])))


# Distance of the centres of two rims or arcs in parallel planes, seen along their axes.


@kind("centre_distance")
class CentreDistance(Measurand):
    """Distance of two centres across their common axis, mm; given a direction, along it."""

    takes = (MeasuredCircle, MeasuredCircle)

    def describe(self) -> tuple[float, tuple[Frame, ...], NDArray[np.float64], NDArray[np.float64]]:
        """Return nominal value, frames, and the derivatives by what is fitted, see `Measurand`."""
        first, second = circles_of(self.geometry)
        if not are_parallel(first.axis, second.axis):
            raise MeasurandError(
                "the rims of a centre_distance must lie in parallel planes. "
                f"Got {degrees_between(first.axis, second.axis):.4g} degrees between them."
            )
        across = second.centre - first.centre
        across = across - (across @ first.axis) * first.axis
        if self.direction is not None:
            way = self.direction - (self.direction @ first.axis) * first.axis
            if not np.linalg.norm(way) > 1e-9:
                raise MeasurandError(
                    "direction must not run along the rims' axis. Got one that does."
                )
            way = way / np.linalg.norm(way) * (-1.0 if way @ across < 0 else 1.0)
            nominal = float(across @ way)
            bend = 0.0
        else:
            nominal = float(np.linalg.norm(across))
            way = across / max(nominal, 1e-300)
            bend = 1.0
        if not nominal > 1e-9 * (first.radius_mm + second.radius_mm):
            raise MeasurandError(
                "the centres of a centre_distance must lie apart. Got two on one axis."
            )
        self._way = way
        self._side = np.cross(first.axis, way)
        self._nominal = nominal
        self._bent = bend > 0
        return (
            nominal,
            tuple(map(circle_frame, (first, second))),
            *self._derivatives(bend / nominal),
        )

    def _derivatives(self, bend: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return derivatives by both centres: the distance grows along the way, and by the square of what is across."""
        frames = [circle_frame(circle) for circle in circles_of(self.geometry)]
        along = np.zeros(6)
        side = np.zeros(6)
        for k, frame in enumerate(frames):
            sign = 2 * k - 1
            along[3 * k : 3 * k + 2] = sign * np.array([frame.x @ self._way, frame.y @ self._way])
            side[3 * k : 3 * k + 2] = sign * np.array([frame.x @ self._side, frame.y @ self._side])
        return along, bend * np.outer(side, side)

    def value(self, fitted: list[NDArray[np.float64]]) -> NDArray[np.float64]:
        """Return deviations (n,) by what is fitted."""
        apart = np.zeros((len(fitted[0]), 3))
        for k, circle in enumerate(circles_of(self.geometry)):
            frame = circle_frame(circle)
            apart += (2 * k - 1) * (fitted[k][:, :1] * frame.x + fitted[k][:, 1:2] * frame.y)
        along = self._nominal + apart @ self._way
        side = apart @ self._side
        return np.asarray((np.hypot(along, side) if self._bent else along) - self._nominal)


# Distance from the centre of a rim or arc to an edge.


@kind("centre_to_edge")
class CentreToEdge(Measurand):
    """Distance from a centre to the line of an edge that is parallel to the rim's plane, seen along the axis, mm."""

    takes = (MeasuredCircle, Line)

    def describe(self) -> tuple[float, tuple[Frame, ...], NDArray[np.float64], NDArray[np.float64]]:
        """Return nominal value, frames, and the derivatives by what is fitted, see `Measurand`."""
        (circle,) = circles_of(self.geometry)
        (line,) = lines_of(self.geometry)
        along = line.direction
        if not are_perpendicular(along, circle.axis):
            raise MeasurandError(
                "the edge of a centre_to_edge must be parallel to the rim's plane. "
                f"Got {90 - degrees_between(along, circle.axis):.4g} degrees between them."
            )
        across = np.cross(circle.axis, along)
        apart = circle.centre - line.middle
        across = across / np.linalg.norm(across) * (-1.0 if across @ apart < 0 else 1.0)
        nominal = float(apart @ across)
        self._at = float(apart @ along)
        if not nominal > 1e-9 * (circle.radius_mm + line.length):
            raise MeasurandError(
                "the centre of a centre_to_edge must lie off the edge's line. Got 0 mm."
            )
        frame = circle_frame(circle)
        self._nominal = nominal
        self._across = np.array([frame.x @ across, frame.y @ across])
        self._along = np.array([frame.x @ along, frame.y @ along])
        gradient = np.array([*self._across, 0.0, -1.0, -self._at])
        hessian = np.zeros((5, 5))
        hessian[:2, 4] = hessian[4, :2] = -self._along
        hessian[4, 4] = -nominal
        return nominal, (frame, Frame(line.middle, along, across)), gradient, hessian

    def value(self, fitted: list[NDArray[np.float64]]) -> NDArray[np.float64]:
        """Return deviations (n,) by what is fitted."""
        centre, line = fitted
        across = self._nominal + centre[:, :2] @ self._across
        along = self._at + centre[:, :2] @ self._along
        return np.asarray(
            (across - line[:, 0] - line[:, 1] * along) / np.hypot(1.0, line[:, 1]) - self._nominal
        )


# Distance of two parallel edges, along a direction across them.


@kind("distance")
class Distance(Measurand):
    """Distance of two parallel edges, mm, halfway: across what is fitted; given a direction, along it.

    Each is fitted in the plane that it spans with the direction of the distance: one plane for both by default, or two
    parallel ones with a known offset across them.
    """

    takes = (Line, Line)

    def describe(self) -> tuple[float, tuple[Frame, ...], NDArray[np.float64], NDArray[np.float64]]:
        """Return nominal value, frames, and the derivatives by what is fitted, see `Measurand`."""
        first, second = lines_of(self.geometry)
        if not are_parallel(first.direction, second.direction):
            raise MeasurandError(
                "the edges of a distance must be parallel. "
                f"Got {degrees_between(first.direction, second.direction):.4g} degrees between them."
            )
        along = first.direction
        apart = second.middle - first.middle
        way = apart if self.direction is None else self.direction
        way = way - (way @ along) * along
        size = float(np.linalg.norm(way))
        if not size > 1e-9 * max(1.0, float(np.linalg.norm(apart))):
            if self.direction is not None:
                raise MeasurandError(
                    "direction must not run along the edges of a distance. Got one that does."
                )
            raise MeasurandError("the edges of a distance must lie apart. Got one line.")
        way = way / size * (-1.0 if way @ apart < 0 else 1.0)
        nominal = float(apart @ way)
        if not nominal > 1e-9 * float(np.linalg.norm(apart)):
            raise MeasurandError(
                "the edges of a distance must lie apart along its direction. Got 0 mm."
            )
        half_way = (first.middle + second.middle) / 2
        # where between the two each line is read, along it from its own middle
        self._at = (
            float((half_way - first.middle) @ along),
            float((half_way - second.middle) @ along),
        )
        self._bent = self.direction is None
        self._nominal = nominal
        frames = Frame(first.middle, along, way), Frame(second.middle, along, way)
        hessian = np.zeros((4, 4))
        if self._bent:
            hessian[1::2, 1::2] = -nominal / 4
        return nominal, frames, np.array([-1.0, -self._at[0], 1.0, self._at[1]]), hessian

    def value(self, fitted: list[NDArray[np.float64]]) -> NDArray[np.float64]:
        """Return deviations (n,) by what is fitted."""
        first, second = fitted
        more = second[:, 0] + second[:, 1] * self._at[1] - first[:, 0] - first[:, 1] * self._at[0]
        if not self._bent:
            return np.asarray(more)
        # lines that turned together are no farther apart
        slope = (first[:, 1] + second[:, 1]) / 2
        return np.asarray((self._nominal + more) / np.hypot(1.0, slope) - self._nominal)


# Length of an edge by the length of its image: the paper's measurement.


@kind("length")
class Length(Measurand):
    """Length of an edge, mm: the nominal length times the length of its image over that at the nominal pose.

    Both ends must be found; nothing is carried back. The error is expanded as a logarithm, see `errors.model`.

    An end is a corner with another line, which has a floor of its own: along the edge each end is wrong by it. The edge
    may lie off its place in both directions across it, each as far as a surface does.
    """

    takes = (Line,)
    in_image = True

    def describe(self) -> tuple[float, tuple[Frame, ...], NDArray[np.float64], NDArray[np.float64]]:
        """Return nominal value, frames, and the derivatives by what is fitted, see `Measurand`."""
        (line,) = lines_of(self.geometry)
        side = np.cross(line.direction, np.eye(3)[int(np.argmin(np.abs(line.direction)))])
        frame = Frame(line.middle, line.direction, side / np.linalg.norm(side))
        return line.length, (frame,), np.zeros(2), np.zeros((2, 2))

    def image_value(
        self, images: NDArray[np.float64], planned: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return deviations (n,) by images of the ends (n, 2, 2)."""
        length = np.linalg.norm(images[:, 1] - images[:, 0], axis=1)
        return np.asarray(self.nominal * (length / np.linalg.norm(planned[1] - planned[0]) - 1))

    def expansion(
        self,
        poses: NDArray[np.float64],
        image: Image,
        localisation: Localisation,
        surfaces_mm: float = 0.0,
    ) -> Expansion:
        """Return the error of the length at poses (n, 4, 4)."""
        (line,) = lines_of(self.geometry)
        n = len(poses)
        gradient = np.zeros((n, 6))
        hessian = np.zeros((n, 6, 6))
        tangent = np.zeros((n, 3))
        ends = (
            np.array([line.p, line.q]) @ np.swapaxes(poses[:, :3, :3], 1, 2) + poses[:, None, :3, 3]
        )
        _expand_lengths(np.ascontiguousarray(ends), image.distance_mm, gradient, hessian, tangent)
        length = tangent[:, 0]
        steps = np.abs(tangent[:, 1:]) * image.pitch_mm
        variance = np.zeros((n, 3))
        if localisation.model == "rounding":
            widths = steps
        else:
            widths = np.zeros((n, 2))
            sigma = localisation.sigma_px
            if localisation.model == "fit":
                sigma = max(sigma, localisation.floor_px)
            variance[:, 0] = 2 * sigma**2 * (steps**2).sum(axis=1)
            # pixels in a millimetre along the image
            per_mm = np.hypot(*(tangent[:, 1:] / image.pitch_mm).T)
            common = localisation.common_px / np.where(per_mm > 0, per_mm, np.inf)
            variance[:, 1] = 2 * common**2
        # moving the edge is moving the camera against it; along itself it makes no error
        by_place = gradient[:, :3]
        along = np.einsum("ni,nij,j->n", by_place, poses[:, :3, :3], line.direction)
        across = np.maximum((by_place**2).sum(axis=1) - along**2, 0.0)
        variance[:, 2] = surfaces_mm**2 * across
        seen = length > MIN_IMAGE_LENGTH_MM
        return Expansion(
            seen, gradient, hessian, variance, widths, length / self.nominal, logarithmic=True
        )


@njit(error_model="numpy")
def _expand_lengths(ends, distance, gradient, hessian, tangent):
    n = np.array([0.0, 0.0, 1.0])
    e = np.zeros(3)
    side = np.zeros(3)
    w = np.empty(3)
    s = np.empty(6)
    row = np.empty(6)
    turn = np.empty(6)
    for i in range(len(ends)):
        first = ends[i, 0]
        last = ends[i, 1]
        if not (first[2] > 0.0 and last[2] > 0.0):
            continue
        du = distance * (last[0] / last[2] - first[0] / first[2])
        dv = distance * (last[1] / last[2] - first[1] / first[2])
        length = math.sqrt(du * du + dv * dv)
        tangent[i, 0] = length
        if not length > MIN_IMAGE_LENGTH_MM:
            continue
        tangent[i, 1] = du / length
        tangent[i, 2] = dv / length
        e[0] = du / length
        e[1] = dv / length
        side[0] = -dv / length
        side[1] = du / length
        g = gradient[i]
        h = hessian[i]
        turn[:] = 0.0
        for k in range(2):
            p = ends[i, k]
            scale = (2 * k - 1) * distance / p[2]
            plane_row(n, p[2], p, s)
            point_row(side, n, p[2], p, w, row)
            turn += scale * row
            point_row(e, n, p[2], p, w, row)
            g += scale * row
            add_square(h, w, p, s, row, scale)
        # a turn in the image lengthens in second order
        add_product(h, turn, turn, 0.5 / length)
        # of L ln(L' / L), whose Hessian is H - g g' / L
        add_product(h, g, g, -0.5 / length)
