"""Exact entity-based aspect graphs of polyhedral parts."""

from aspectgraph.entities import Entity, read_entities, resolve_entities
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
    "Entity",
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
    "read_entities",
    "read_solid",
    "resolve_entities",
]
