"""Exceptions of the package; each also inherits the builtin a caller would expect."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from typing import Self


class MeasurementModelError(Exception):
    """Base class of everything this package raises on purpose.

    Attributes
    ----------
    parameter : str
        The parameter that breaks its rule; empty if there is none.
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
        MeasurementModelError
            Of this class.
        """
        error = cls(f"{parameter} {rule}. Got {got}.")
        vars(error).update(parameter=parameter, rule=rule, got=got)
        return error


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
