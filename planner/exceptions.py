"""Errors raised by the planner; each also inherits the builtin a caller would expect."""

from __future__ import annotations

from ground.broken_rule import RuleError


class PlannerError(RuleError):
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
        Message for the user.

    Attributes
    ----------
    constraint : str
        Name of the constraint that fails, as in the keys of `SensorSetting.margins`; "light" where poses see the
        entity, but the light does not show it.
    entity : str
        Entity for which it fails, or an empty string when it does not depend on the entity.
    margin : float
        Largest margin found (negative), in the unit the constraint's name ends with.
    proven : bool
        Whether it is proven that no pose meets the constraint. Otherwise the search found none.
    together : bool
        Whether poses meet each constraint alone. Then `constraint` is the one that fails by most.
    why : str
        The reason in a sentence that names neither constraint nor entity. Default: the message.
    """

    def __init__(
        self,
        message: str,
        *,
        constraint: str = "",
        entity: str = "",
        margin: float = float("nan"),
        proven: bool = False,
        together: bool = False,
        why: str = "",
    ):
        super().__init__(message)
        self.why = why or message
        self.proven = proven
        self.together = together
        self.constraint = constraint
        self.entity = entity
        self.margin = margin


class CoverError(PlannerError, ValueError):
    """A set-cover problem that is malformed or cannot be covered."""


class PlanFileError(PlannerError, ValueError):
    """A plan or state file that cannot be read, is malformed, or belongs to another problem."""


class PoseFileError(PlannerError, ValueError):
    """A file of camera poses that cannot be read, or leaves open which poses it means."""


class OutputError(PlannerError, OSError):
    """A file or folder that cannot be written."""


class RobotError(PlannerError, ValueError):
    """A robot or a cell that cannot be used, or a file of one that cannot be read."""
