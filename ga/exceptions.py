"""What can go wrong in a run, each also a builtin so that callers need not know these names."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from typing_extensions import Self


class GAError(Exception):
    """Base of every error this package raises on purpose.

    Attributes
    ----------
    parameter : str
        The parameter that breaks its rule, as a call has it; empty if the error is of none.
    rule : str
        The rule, beginning with its verb.
    got : str
        The value that breaks it.
    hint : str
        What helps.
    """

    parameter: str = ""
    rule: str = ""
    got: str = ""
    hint: str = ""

    def __reduce__(self) -> tuple[Any, ...]:
        """Keep the data when the error crosses a process boundary, with Dask's pickling, too."""
        return type(self), self.args, dict(vars(self))

    @classmethod
    def of_rule(cls, parameter: str, rule: str, got: str, *, hint: str = "") -> Self:
        """Return the error of a broken rule: "PARAMETER RULE. Got GOT; HINT.".

        Parameters
        ----------
        parameter, rule, got, hint : str
            See the attributes.

        Returns
        -------
        GAError
            Of this class.
        """
        data = {"parameter": parameter, "rule": rule, "got": got, "hint": hint}
        error = cls(_sentence(parameter, data))
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
        return _sentence(name_of(self.parameter), vars(self)) if self.rule else str(self)


def _sentence(subject: str, data: Mapping[str, Any]) -> str:
    hint = f"; {data['hint']}" if data["hint"] else ""
    return f"{subject} {data['rule']}. Got {data['got']}{hint}."


class ParameterError(GAError, ValueError):
    """A parameter breaks its rule; the message names parameter, rule and value."""


class FitnessError(GAError, ValueError):
    """The fitness or feasibility function returned something that cannot be used."""


class InfeasiblePopulationError(GAError, ValueError):
    """No complete initial population of feasible individuals could be had."""
