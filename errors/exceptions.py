"""Exceptions of the package; each also inherits the builtin a caller would expect."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from typing_extensions import Self


class MeasurementModelError(Exception):
    """Base class of everything this package raises on purpose.

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
        MeasurementModelError
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


class InvalidParameterError(MeasurementModelError, ValueError):
    """A number is outside the range its meaning allows, or is not finite."""


class InvalidShapeError(InvalidParameterError):
    """An array does not have the shape the call documents."""


class CovarianceError(InvalidParameterError):
    """A covariance matrix is not symmetric or not positive semi-definite."""


class BehindLensError(InvalidParameterError):
    """An end point lies at or behind the lens centre, so it has no image."""


class DegenerateSegmentError(InvalidParameterError):
    """The image of an edge is a single point, so it has neither length nor angle."""


class MeasurandError(InvalidParameterError):
    """A dimension of an unknown kind, or one that its entities do not define."""
