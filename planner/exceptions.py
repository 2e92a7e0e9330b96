"""Errors raised by the planner; each also inherits the builtin a caller would expect."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from typing_extensions import Self


class PlannerError(Exception):
    """Base of every error the planner raises on purpose.

    Attributes
    ----------
    parameter : str
        The parameter that breaks its rule, as a call has it; empty if the error is of none.
    rule : str
        The rule, beginning with its verb. Other parameters in it stand as ``{name}`` or ``{name=}``.
    got : str
        The value that breaks it.
    hint : str
        What helps, in the words of a call.
    shell_hint : str or None
        What helps, in the words of a shell; None: the same.
    mentions : tuple of str
        The other parameters in `rule`.
    place : str
        File or item in which that is, if the text begins with it.
    """

    parameter: str = ""
    rule: str = ""
    got: str = ""
    hint: str = ""
    shell_hint: str | None = None
    mentions: tuple[str, ...] = ()
    place: str = ""

    def __reduce__(self) -> tuple[Any, ...]:
        """Keep the data when the error crosses a process boundary, with Dask's pickling, too."""
        return type(self), self.args, dict(vars(self))

    @classmethod
    def of_rule(
        cls,
        parameter: str,
        rule: str,
        got: str,
        *,
        hint: str = "",
        shell_hint: str | None = None,
        mentions: tuple[str, ...] = (),
    ) -> Self:
        """Return the error of a broken rule: "PARAMETER RULE. Got GOT; HINT.".

        Parameters
        ----------
        parameter, rule, got, hint : str
            See the attributes; without a parameter, the rule is the whole sentence.
        shell_hint : str, optional
            Default: as `hint`.
        mentions : tuple of str
            Other parameters in the rule.

        Returns
        -------
        PlannerError
            Of this class.
        """
        data = {
            "parameter": parameter,
            "rule": rule,
            "got": got,
            "hint": hint,
            "shell_hint": shell_hint,
            "mentions": mentions,
        }
        error = cls(_sentence(data, str, hint))
        vars(error).update(data)
        return error

    def for_shell(self, name_of: Callable[[str], str]) -> str:
        """Return the text for somebody at a shell.

        Parameters
        ----------
        name_of : callable
            Gives the option of a parameter.

        Returns
        -------
        str
            One or two sentences.
        """
        if not self.rule:
            return str(self)
        hint = self.hint if self.shell_hint is None else self.shell_hint
        text = _sentence(vars(self), name_of, hint)
        return f"{self.place}: {text}" if self.place else text

    def within(self, place: object) -> Self:
        """Return the error with the file or item that it is in; it keeps its data.

        Parameters
        ----------
        place : object
            Named in front of the text.

        Returns
        -------
        PlannerError
            Of this class.
        """
        error = type(self)(f"{place}: {self}")
        vars(error).update(vars(self))
        error.place = f"{place}: {self.place}" if self.place else str(place)
        return error


def _sentence(data: Mapping[str, Any], name_of: Callable[[str], str], hint: str) -> str:
    """Return the text of a broken rule, its parameters named as somebody knows them."""
    rule = data["rule"]
    for name in data["mentions"]:
        shown = name_of(name)
        rule = rule.replace(f"{{{name}}}", shown)
        # a value follows: `gap_mm=1` of a call is `--gap-mm 1` at a shell
        rule = rule.replace(f"{{{name}=}}", f"{shown}=" if shown == name else f"{shown} ")
    parameter = data["parameter"]
    subject = f"{name_of(parameter)} " if parameter else ""
    if not hint:
        return f"{subject}{rule}. Got {data['got']}."
    # a hint is a sentence of its own if it begins like one
    mark = "." if hint[0].isupper() else ";"
    return f"{subject}{rule}. Got {data['got']}{mark} {hint}."


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
    proven : bool
        Whether no pose at all meets the constraint; otherwise none was found that does.
    together : bool
        Whether each constraint can be met by itself, so that `constraint` is only the one missed by most.
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
    ):
        super().__init__(message)
        self.proven = proven
        self.together = together
        self.constraint = constraint
        self.entity = entity
        self.margin = margin


class CoverError(PlannerError, ValueError):
    """A set-cover problem that is malformed or cannot be covered."""


class PlanFileError(PlannerError, ValueError):
    """A plan or state file that cannot be read, is malformed, or belongs to another problem."""


class OutputError(PlannerError, OSError):
    """A file or folder that cannot be written."""
