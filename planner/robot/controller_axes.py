"""The axes that a controller counts, where they are not the joints of the URDF.

A parallel rod, as of ABB's IRB 2400, keeps the forearm's angle to the horizon while joint 2 turns. Its controller
counts this angle as axis 3: joint 3 plus joint 2. Controllers of FANUC count so, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from planner.argument_kinds import shown
from planner.exceptions import RobotError
from planner.robot.urdf import N_JOINTS

_LARGEST_FACTOR = 10.0
_LEAST_DETERMINANT = 1e-3


class ControllerAxes:
    """How the controller's axes follow from the joints: each is its joint, plus shares of others.

    Parameters
    ----------
    coupled : sequence of (int, int, float)
        Axis, joint and factor: the axis is its own joint plus the factor times this joint. Numbers from 1.
    limits : sequence of (int, float, float)
        Axis, its least and its largest angle, rad. The joints keep the limits of the URDF as well.

    Raises
    ------
    RobotError
        If one of them breaks its rule.

    Examples
    --------
    >>> import numpy as np
    >>> axes = ControllerAxes([(3, 2, 1.0)])
    >>> axes.of(np.array([0.0, 0.5, 0.1, 0.0, 0.0, 0.0]))
    array([0. , 0.5, 0.6, 0. , 0. , 0. ])
    """

    def __init__(self, coupled: Any = (), limits: Any = ()) -> None:
        rows = [_numbers("coupled", _COUPLED, row) for row in _rows("coupled", _COUPLED, coupled)]
        for row in rows:
            _check_coupled(row)
        self.coupled = tuple((int(axis), int(joint), factor) for axis, joint, factor in rows)
        self.matrix = np.eye(N_JOINTS)
        for axis, joint, factor in self.coupled:
            if self.matrix[axis - 1, joint - 1] != 0.0:
                got = f"axis {axis} and joint {joint} twice"
                raise RobotError.of_rule("coupled", "must name a pair once", got)
            self.matrix[axis - 1, joint - 1] = factor
        if abs(np.linalg.det(self.matrix)) < _LEAST_DETERMINANT:
            rule = "must leave joints that follow from the axes"
            raise RobotError.of_rule("coupled", rule, shown([list(row) for row in self.coupled]))
        self.inverse = np.linalg.inv(self.matrix)
        rows = [
            _numbers("axis_limits", _LIMITS, row) for row in _rows("axis_limits", _LIMITS, limits)
        ]
        self.limits = tuple((int(axis), low, high) for axis, low, high in rows)
        self.lower = np.full(N_JOINTS, -np.inf)
        self.upper = np.full(N_JOINTS, np.inf)
        for axis, low, high in self.limits:
            if not low < high:
                got = shown([axis, low, high])
                raise RobotError.of_rule(
                    "axis_limits", "must go from a smaller angle to a larger one", got
                )
            self.lower[axis - 1] = low
            self.upper[axis - 1] = high

    @property
    def is_plain(self) -> bool:
        """Whether the axes are the joints, with their limits alone."""
        return not self.coupled and not self.limits

    def of(self, joints: np.ndarray) -> np.ndarray:
        """Return the axes of joints.

        Parameters
        ----------
        joints : array (..., k)
            Rad; what stands behind the sixth one is taken over.

        Returns
        -------
        array (..., k)
            Rad.
        """
        return _mapped(self.matrix, joints)

    def joints(self, axes: np.ndarray) -> np.ndarray:
        """Return the joints of axes, see `of`."""
        return _mapped(self.inverse, axes)

    def margin(self, joints: np.ndarray) -> np.ndarray:
        """Return how far the axes of joints (n, 6) are from their limits (n,), rad; negative beyond one."""
        axes = self.of(joints[..., :N_JOINTS])
        return np.asarray(np.minimum(axes - self.lower, self.upper - axes).min(axis=-1))

    def spread(self) -> np.ndarray:
        """Return by how much each joint (6,) may be off where every axis is off by 1, at least 1."""
        return np.asarray(np.maximum(np.abs(self.inverse).sum(axis=1), 1.0))

    def texts(self) -> list[str]:
        """Return in words what differs from the joints, an axis each."""
        found = []
        for axis in sorted({row[0] for row in (*self.coupled, *self.limits)}):
            text = f"axis {axis} of the controller is joint {axis}"
            for k, joint, factor in self.coupled:
                if k == axis:
                    text += f" {'-' if factor < 0 else '+'} {abs(factor):g} x joint {joint}"
            for k, low, high in self.limits:
                if k == axis:
                    text += f", from {np.degrees(low):g} to {np.degrees(high):g} degrees"
            found.append(text)
        return found


_COUPLED = "must hold three numbers each: an axis, a joint and a factor"
_LIMITS = "must hold three numbers each: an axis, its least and its largest angle"


def _mapped(matrix: np.ndarray, values: np.ndarray) -> np.ndarray:
    given = np.asarray(values, dtype=np.float64)
    first = given[..., :N_JOINTS] @ matrix.T
    return np.concatenate([first, given[..., N_JOINTS:]], axis=-1)


def _rows(name: str, rule: str, value: Any) -> Sequence[Any]:
    if isinstance(value, str) or not isinstance(value, Sequence):
        raise RobotError.of_rule(name, rule, shown(value))
    return value


def _numbers(name: str, rule: str, row: Any) -> tuple[float, float, float]:
    """Return an axis and two finite numbers."""
    try:
        first, second, third = (float(number) for number in row)
    except (TypeError, ValueError, OverflowError):
        raise RobotError.of_rule(name, rule, shown(row)) from None
    if isinstance(row, str) or any(isinstance(number, bool | str) for number in row):
        raise RobotError.of_rule(name, rule, shown(row))
    if not np.isfinite([first, second, third]).all():
        raise RobotError.of_rule(name, "must be finite", shown(row))
    if first not in range(1, N_JOINTS + 1):
        raise RobotError.of_rule(
            name, "must begin with the number of an axis, from 1 to 6", shown(row)
        )
    return first, second, third


def _check_coupled(row: tuple[float, float, float]) -> None:
    axis, joint, factor = row
    if joint not in range(1, N_JOINTS + 1) or joint == axis:
        raise RobotError.of_rule(
            "coupled", "must name another joint, from 1 to 6", shown(list(row))
        )
    if not 0.0 < abs(factor) <= _LARGEST_FACTOR:
        rule = f"must have a factor that is not 0 and at most {_LARGEST_FACTOR:g}"
        raise RobotError.of_rule("coupled", rule, shown(list(row)))
