"""Exact entity-based aspect graphs of polyhedral parts."""

from aspectgraph.exceptions import (
    AspectGraphError,
    EntityError,
    MissingExtraError,
    NonManifoldError,
    OpenSolidError,
    OrientationError,
    PartFileNotFoundError,
    PlanarityError,
    ReadError,
    SelfIntersectionError,
    SolidError,
    TouchingError,
    WorkspaceError,
)
from aspectgraph.reader import read_solid
from aspectgraph.solid import Solid
from aspectgraph.topology import Edge, Face

__all__ = [
    "AspectGraphError",
    "Edge",
    "EntityError",
    "Face",
    "MissingExtraError",
    "NonManifoldError",
    "OpenSolidError",
    "OrientationError",
    "PartFileNotFoundError",
    "PlanarityError",
    "ReadError",
    "SelfIntersectionError",
    "Solid",
    "SolidError",
    "TouchingError",
    "WorkspaceError",
    "read_solid",
]
