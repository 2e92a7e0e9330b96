"""What can go wrong in a run, each also a builtin so that callers need not know these names."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from typing import Self


class GAError(Exception):
    """Base of every error this package raises on purpose.

    Attributes
    ----------
    parameter : str
        The parameter that breaks its rule; empty if the error is of none.
    rule : str
        The rule, beginning with its verb.
    got : str
        The value that breaks it.
    """

    parameter: str = ""
    rule: str = ""
    got: str = ""

    @classmethod
    def of_rule(cls, parameter: str, rule: str, got: str) -> Self:
        """Return the error of a broken rule: "PARAMETER RULE. Got GOT.".

        Parameters
        ----------
        parameter, rule, got : str
            See the attributes.

        Returns
        -------
        GAError
            Of this class.
        """
        error = cls(f"{parameter} {rule}. Got {got}.")
        vars(error).update(parameter=parameter, rule=rule, got=got)
        return error


class ParameterError(GAError, ValueError):
    """A parameter breaks its rule; the message names parameter, rule and value."""


class FitnessError(GAError, ValueError):
    """The fitness or feasibility function returned something that cannot be used."""


class InfeasiblePopulationError(GAError, ValueError):
    """No complete initial population of feasible individuals could be had."""
