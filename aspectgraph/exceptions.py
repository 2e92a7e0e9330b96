"""Exceptions raised by :mod:`aspectgraph`; each also inherits the builtin one would expect."""

from __future__ import annotations

from ground.broken_rule import RuleError


def how_to_install(extra: str) -> str:
    """Say how to install an extra. Only a clone has it: the name on a package registry may be anybody's.

    Parameters
    ----------
    extra : str
        Name of the extra.
    """
    return f"install it from a clone of the repository: pip install '.[{extra}]'"


class AspectGraphError(RuleError):
    """Base of every error this package raises on purpose."""


class SolidError(AspectGraphError, ValueError):
    """The vertices and faces given do not describe a valid solid."""


class OpenSolidError(SolidError):
    """An edge has a face on one side only: the surface has a hole."""


class NonManifoldError(SolidError):
    """An edge has more than two faces, or a vertex more than one fan of faces."""


class OrientationError(SolidError):
    """Faces disagree about which side is outside, or the whole is inside out."""


class PlanarityError(SolidError):
    """The vertices of a face do not lie in one plane."""


class SelfIntersectionError(SolidError):
    """Parts of the surface cross each other, or solids overlap."""


class TouchingError(SelfIntersectionError):
    """Parts of the surface that are not neighbours touch without crossing."""


class ResolutionError(SolidError):
    """Details of the part are too small for its grid: snapping could merge separate ones."""


class ReadError(AspectGraphError, ValueError):
    """A part file cannot be read, or its content does not match its name."""


class PartFileNotFoundError(ReadError, FileNotFoundError):
    """There is no such part file."""


class MissingExtraError(ReadError, ImportError):
    """An optional package needed for this operation is not installed."""


class EntityError(AspectGraphError, ValueError):
    """An entity of interest is not a sharp straight edge of the solid."""


class WorkspaceError(AspectGraphError, ValueError):
    """The workspace is not a box around the solid, or a point lies outside it."""


class LightError(AspectGraphError, ValueError):
    """A lamp lies inside the part, or the required contrast is out of range."""


class GraphMLError(AspectGraphError, ValueError):
    """A graph cannot be written as GraphML without loss, or a GraphML file does not hold such a graph."""


class GraphFileNotFoundError(GraphMLError, FileNotFoundError):
    """There is no such GraphML file."""


class OutputError(AspectGraphError, OSError):
    """A file cannot be written."""


class PictureError(AspectGraphError, ValueError):
    """A picture cannot be made with these options."""


class ToleranceError(AspectGraphError, ValueError):
    """A tolerance class is not one of ISO 286, or has no limits for a nominal size."""


class WidthError(AspectGraphError, ValueError):
    """The least width is below the limit of the part's rounding, or above the workspace's."""


class ContradictionError(AspectGraphError, ArithmeticError):
    """Ray casting and exact arbitration refute a viewing domain's list."""


class MemoryLimitError(AspectGraphError, MemoryError):
    """The work would need more memory than the limit, or than is free."""
