"""A turntable: an axis in the base of the robot, the angles at which images are taken, and how fast it turns."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from planner.argument_kinds import POSITIVE, check_number, shown
from planner.exceptions import RobotError

_MOST_ANGLES = 360
DEFAULT_ANGLES = 24


@dataclass(frozen=True, eq=False)
class Turntable:
    """An axis that carries the part.

    Attributes
    ----------
    point, direction : array (3,)
        A point of the axis in the base, mm, and its direction, a unit vector.
    angles : tuple of float
        Angles at which images may be taken, rad; 0 is where ``part2base`` holds. The nearest to 0 come first.
    speed, acceleration : float
        Largest ones, rad/s and rad/s².
    """

    point: np.ndarray
    direction: np.ndarray
    angles: tuple[float, ...]
    speed: float
    acceleration: float

    @classmethod
    def checked(
        cls, axis: Any, angles: Any, turn_speed: float, turn_acceleration: float
    ) -> Turntable:
        """Return a turntable, or raise `RobotError` that names the argument of `Fixturing`.

        Raises
        ------
        RobotError
            An argument breaks its rule.
        """
        point, direction = _axis(axis)
        return cls(
            point,
            direction,
            _angles(DEFAULT_ANGLES if angles is None else angles),
            check_number("turn_speed", turn_speed, POSITIVE),
            check_number("turn_acceleration", turn_acceleration, POSITIVE),
        )

    def pose(self, angle: float) -> np.ndarray:
        """Return the motion (4, 4) of what turns by an angle, mm; exactly the identity at 0."""
        x, y, z = self.direction
        across = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        twice = np.einsum("ij,jk->ik", across, across)
        result = np.eye(4)
        result[:3, :3] += math.sin(angle) * across + (1.0 - math.cos(angle)) * twice
        result[:3, 3] = self.point - np.einsum("ij,j->i", result[:3, :3], self.point)
        return result

    def moved(self, motion: np.ndarray) -> Turntable:
        """Return the same turntable elsewhere in the base, by a motion (4, 4)."""
        point = np.einsum("ij,j->i", motion[:3, :3], self.point) + motion[:3, 3]
        direction = np.einsum("ij,j->i", motion[:3, :3], self.direction)
        return Turntable(point, direction, self.angles, self.speed, self.acceleration)

    def radius_mm(self, points: np.ndarray) -> float:
        """Return the largest distance of points (n, 3) of the base from the axis."""
        apart = points - self.point
        along = np.einsum("ni,i->n", apart, self.direction)
        across = apart - along[:, None] * self.direction
        return float(np.sqrt((across**2).sum(axis=1)).max())

    @property
    def range(self) -> tuple[float, float]:
        """The least and the largest angle of all moves, rad: programs begin and end at 0."""
        return min(0.0, *self.angles), max(0.0, *self.angles)

    @property
    def numbers(self) -> tuple[Any, ...]:
        """Everything that decides what is reached, as plain values."""
        return (
            self.point.tolist(),
            self.direction.tolist(),
            self.angles,
            self.speed,
            self.acceleration,
        )


def _axis(axis: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return a point and a unit vector."""
    rule = "must be a point in mm and a direction, each of three finite numbers"
    try:
        point, direction = (np.array(one, dtype=np.float64) for one in axis)
    except (TypeError, ValueError):
        raise RobotError.of_rule("axis", rule, shown(axis)) from None
    if point.shape != (3,) or direction.shape != (3,):
        raise RobotError.of_rule("axis", rule, shown(axis))
    if not (np.isfinite(point).all() and np.isfinite(direction).all()):
        raise RobotError.of_rule("axis", rule, shown(axis))
    length = float(np.sqrt((direction**2).sum()))
    if length == 0.0:
        raise RobotError.of_rule("axis", "must have a direction other than 0", shown(axis))
    return point, direction / length


def _angles(given: Any) -> tuple[float, ...]:
    """Return angles, the nearest to 0 first."""
    rule = f"must be a number from 1 to {_MOST_ANGLES} or a list of so many angles within a turn"
    if isinstance(given, int | np.integer) and not isinstance(given, bool):
        if not 1 <= given <= _MOST_ANGLES:
            raise RobotError.of_rule("angles", rule, shown(given))
        steps = np.arange(given)
        steps[steps > given // 2] -= given
        values = (2.0 * math.pi / int(given) * steps).tolist()
    else:
        values = _listed(given, rule)
    return tuple(sorted(values, key=lambda angle: (round(abs(angle), 9), -angle)))


def _listed(given: Any, rule: str) -> list[float]:
    if not isinstance(given, Sequence | np.ndarray) or isinstance(given, str):
        raise RobotError.of_rule("angles", rule, shown(given))
    try:
        values = [float(angle) for angle in given]
    except (TypeError, ValueError):
        raise RobotError.of_rule("angles", rule, shown(given)) from None
    within = all(math.isfinite(one) and abs(one) <= 2.0 * math.pi for one in values)
    if not 1 <= len(values) <= _MOST_ANGLES or not within:
        hint = "are they in degrees?" if values and not within else ""
        raise RobotError.of_rule("angles", rule, shown(given), hint=hint)
    if len(set(values)) < len(values):
        raise RobotError.of_rule("angles", "must differ from each other", shown(given))
    return values
