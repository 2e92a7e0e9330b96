"""Errors raised by the planner; each also inherits the builtin a caller would expect."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from typing import Self


class PlannerError(Exception):
    """Base of every error the planner raises on purpose.

    Attributes
    ----------
    parameter : str
        The parameter that breaks its rule; empty if there is none.
    rule : str
        The rule, beginning with its verb.
    got : str
        The value that breaks it.
    hint : str
        Advice, without a full stop.
    mentions : tuple of str
        Other parameters in `rule` and `hint`, in the form used there, such as ``partial=True``.
    """

    parameter: str = ""
    rule: str = ""
    got: str = ""
    hint: str = ""
    mentions: tuple[str, ...] = ()

    @classmethod
    def of_rule(
        cls,
        parameter: str,
        rule: str,
        got: str,
        *,
        hint: str = "",
        mentions: tuple[str, ...] = (),
    ) -> Self:
        """Return the error of a broken rule: "PARAMETER RULE. Got GOT; HINT.".

        Parameters
        ----------
        parameter, rule, got, hint : str
            See the attributes.
        mentions : tuple of str
            See the attributes.

        Returns
        -------
        PlannerError
            Of this class.
        """
        error = cls(f"{parameter} {rule}. Got {got}.".lstrip())
        vars(error).update(parameter=parameter, rule=rule, got=got, hint=hint, mentions=mentions)
        return error

    def __str__(self) -> str:
        """Return the text, with the hint behind it: a sentence of its own if it begins like one."""
        text = super().__str__()
        if not self.hint:
            return text
        hint = self.hint if self.hint.endswith("?") else f"{self.hint}."
        if hint[0].isupper():
            return f"{text} {hint}"
        return f"{text.removesuffix('.')}; {hint}"


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
