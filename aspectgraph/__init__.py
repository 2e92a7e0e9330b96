"""Exact entity-based aspect graphs of polyhedral parts."""

from typing import TYPE_CHECKING, Any

from aspectgraph.cells.cell_set import Cell, CellSet
from aspectgraph.dimensions.read_dimensions import read_dimensions
from aspectgraph.dimensions.records import ModelDimension
from aspectgraph.dimensions.tolerance_classes import tolerance_class_deviations
from aspectgraph.entities.entity_files import read_entities
from aspectgraph.entities.entity_rules import select_entities
from aspectgraph.entities.parts import Run, Stretch, entity_order, parse_part
from aspectgraph.entities.pieces import facing_cuts, pieces_of_edge, runs_of
from aspectgraph.entities.resolve_parts import run_arc
from aspectgraph.entities.straight_edges import Entity, resolve_entities
from aspectgraph.exceptions import (
    AspectGraphError,
    ContradictionError,
    EntityError,
    GraphMLError,
    LightError,
    MemoryLimitError,
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
    ToleranceError,
    TouchingError,
    WidthError,
    WorkspaceError,
)
from aspectgraph.graph.analysis import (
    Crossing,
    ListOfEntities,
    domain_path,
    richest_domains,
    stability,
)
from aspectgraph.graph.aspect_graph import EntityAspectGraph, build_aspect_graph, graph_of
from aspectgraph.graph.complete_graph import complete_aspect_graph
from aspectgraph.graph.graphml import read_graphml, write_graphml
from aspectgraph.graph.joint_memory import JointEstimate, JointForecast, estimate_graph
from aspectgraph.graph.partition_surfaces import PartitionSurface
from aspectgraph.light.contrast import contrast
from aspectgraph.light.light_graph import LightGraph, build_light_graph, light_graph_of
from aspectgraph.light.light_regions import LightRegions, compute_light, light_region
from aspectgraph.plot.edge_ids import edge_figure, write_edge_picture
from aspectgraph.plot.graph_plot import GraphDrawing, plot_graph
from aspectgraph.plot.section import SectionDrawing, plot_section
from aspectgraph.plot.solid_view import plot_domains, plot_solid
from aspectgraph.read.limits import ReadLimits
from aspectgraph.read.part_file import read_solid
from aspectgraph.read.solid_choice import SolidChoice
from aspectgraph.solid.circles import Circle
from aspectgraph.solid.edge_ends import EdgeEnd
from aspectgraph.solid.rims import Arc, Rim
from aspectgraph.solid.solid import Solid
from aspectgraph.solid.topology import Edge, Face
from aspectgraph.visibility.visibility_regions import VisibilityRegions, compute_regions

__all__ = [
    "Arc",
    "AspectGraphError",
    "Cell",
    "CellSet",
    "Circle",
    "ContradictionError",
    "Crossing",
    "Edge",
    "EdgeEnd",
    "Entity",
    "EntityAspectGraph",
    "EntityError",
    "Face",
    "GraphDrawing",
    "GraphMLError",
    "JointEstimate",
    "JointForecast",
    "LightError",
    "LightGraph",
    "LightRegions",
    "ListOfEntities",
    "MemoryLimitError",
    "MissingExtraError",
    "ModelDimension",
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
    "Rim",
    "Run",
    "SectionDrawing",
    "SelfIntersectionError",
    "Solid",
    "SolidChoice",
    "SolidError",
    "Stretch",
    "ToleranceError",
    "TouchingError",
    "VisibilityRegions",
    "WidthError",
    "WorkspaceError",
    "build_aspect_graph",
    "build_light_graph",
    "complete_aspect_graph",
    "compute_light",
    "compute_regions",
    "contrast",
    "domain_path",
    "edge_figure",
    "entity_order",
    "estimate_graph",
    "facing_cuts",
    "light_graph_of",
    "light_region",
    "parse_part",
    "pieces_of_edge",
    "plot_domains",
    "plot_graph",
    "plot_section",
    "plot_solid",
    "graph_of",
    "read_dimensions",
    "read_entities",
    "read_graphml",
    "read_solid",
    "resolve_entities",
    "richest_domains",
    "run_arc",
    "runs_of",
    "select_entities",
    "stability",
    "tolerance_class_deviations",
    "write_edge_picture",
    "write_graphml",
]


if TYPE_CHECKING:
    __version__: str
else:

    def __getattr__(name: str) -> Any:
        """Look up the version, which is stated in the project's metadata only."""
        if name != "__version__":
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        from importlib.metadata import PackageNotFoundError, version

        try:
            return version("aspectgraph")
        except PackageNotFoundError:
            # run from its source without being installed
            return "unknown"


def __dir__() -> list[str]:
    """List the public names only."""
    return sorted([*__all__, *_OWN_NAMES])


_OWN_NAMES = ("__all__", "__doc__", "__file__", "__name__", "__path__", "__version__")
