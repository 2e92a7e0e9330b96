"""Exceptions of the package; each also inherits the builtin a caller would expect."""

from __future__ import annotations

from ground.broken_rule import RuleError


class MeasurementModelError(RuleError):
    """Base class of everything this package raises on purpose."""


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
