"""Errors raised by the planner; each also inherits the builtin a caller would expect."""

from __future__ import annotations

from typing import Any


class PlannerError(Exception):
    """Base of every error the planner raises on purpose."""


class CameraError(PlannerError, ValueError):
    """A camera that cannot exist, an unknown camera name, or a camera file that cannot be read."""


class UncertaintyError(PlannerError, ValueError):
    """A pose covariance of the wrong shape, not positive semi-definite, or in the wrong units."""


class RequestError(PlannerError, ValueError):
    """An argument of a planning call that breaks its stated rule."""


class InfeasibleError(PlannerError, RuntimeError):
    """No sensor setting can meet the constraints.

    Parameters
    ----------
    message : str
        What to tell the user.

    Attributes
    ----------
    constraint : str
        Name of the constraint that fails, as in the keys of `SensorSetting.margins`.
    entity : str
        Entity for which it fails, or an empty string when it does not depend on the entity.
    margin : float
        Largest margin that was found (negative), in the unit the constraint's name ends with.
    """

    def __init__(
        self, message: str, *, constraint: str = "", entity: str = "", margin: float = float("nan")
    ):
        super().__init__(message)
        self.constraint = constraint
        self.entity = entity
        self.margin = margin

    def __reduce__(self) -> tuple[Any, ...]:
        """Keep the attributes when the error crosses a process boundary."""
        state = {"constraint": self.constraint, "entity": self.entity, "margin": self.margin}
        return type(self), (str(self),), state


class CoverError(PlannerError, ValueError):
    """A set-cover problem that is malformed or cannot be covered."""


class PlanFileError(PlannerError, ValueError):
    """A plan or state file that cannot be read, is malformed, or belongs to another problem."""


class OutputError(PlannerError, OSError):
    """A file or folder that cannot be written."""
