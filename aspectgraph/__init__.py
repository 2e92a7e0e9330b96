"""Exact entity-based aspect graphs of polyhedral parts."""

from aspectgraph.cellset import Cell, CellSet
from aspectgraph.complete import complete_aspect_graph
from aspectgraph.edge_picture import edge_figure, write_edge_picture
from aspectgraph.entities import Entity, read_entities, resolve_entities
from aspectgraph.exceptions import (
    AspectGraphError,
    ContradictionError,
    EntityError,
    GraphMLError,
    MissingExtraError,
    NonManifoldError,
    OpenSolidError,
    OrientationError,
    OutputError,
    PartFileNotFoundError,
    PictureError,
    PlanarityError,
    ReadError,
    ResolutionError,
    SelfIntersectionError,
    SolidError,
    TouchingError,
    WidthError,
    WorkspaceError,
)
from aspectgraph.graph import EntityAspectGraph, build_aspect_graph, graph_of
from aspectgraph.graphml import read_graphml, write_graphml
from aspectgraph.limits import ReadLimits
from aspectgraph.partition import PartitionSurface
from aspectgraph.plot import GraphDrawing, plot_graph
from aspectgraph.plot3d import plot_domains, plot_solid
from aspectgraph.plot_section import SectionDrawing, plot_section
from aspectgraph.reader import read_solid
from aspectgraph.regions import VisibilityRegions, compute_regions
from aspectgraph.solid import Solid
from aspectgraph.topology import Edge, Face

__all__ = [
    "AspectGraphError",
    "Cell",
    "CellSet",
    "ContradictionError",
    "Edge",
    "Entity",
    "EntityAspectGraph",
    "EntityError",
    "Face",
    "GraphDrawing",
    "GraphMLError",
    "MissingExtraError",
    "NonManifoldError",
    "OpenSolidError",
    "OrientationError",
    "OutputError",
    "PartFileNotFoundError",
    "PartitionSurface",
    "PictureError",
    "PlanarityError",
    "ReadError",
    "ReadLimits",
    "ResolutionError",
    "SectionDrawing",
    "SelfIntersectionError",
    "Solid",
    "SolidError",
    "TouchingError",
    "VisibilityRegions",
    "WidthError",
    "WorkspaceError",
    "build_aspect_graph",
    "complete_aspect_graph",
    "compute_regions",
    "edge_figure",
    "plot_domains",
    "plot_graph",
    "plot_section",
    "plot_solid",
    "graph_of",
    "read_entities",
    "read_graphml",
    "read_solid",
    "resolve_entities",
    "write_edge_picture",
    "write_graphml",
]
