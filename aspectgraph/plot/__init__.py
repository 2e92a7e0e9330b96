"""Pictures of parts, domains and graphs.

They are drawn in doubles and decide nothing. matplotlib and plotly are imported when a picture is asked for.
"""

from aspectgraph.plot.clip import domain_facets
from aspectgraph.plot.edge_ids import edge_figure, write_edge_picture
from aspectgraph.plot.graph_plot import GraphDrawing, plot_graph
from aspectgraph.plot.section import SectionDrawing, plot_section
from aspectgraph.plot.solid_view import plot_domains, plot_solid
from aspectgraph.plot.style import is_feature
from aspectgraph.plot.traces import (
    line_trace,
    part_traces,
    point_text,
    scene_figure,
    surface_trace,
    xyz,
)

__all__ = [
    "GraphDrawing",
    "SectionDrawing",
    "domain_facets",
    "edge_figure",
    "is_feature",
    "line_trace",
    "part_traces",
    "plot_domains",
    "plot_graph",
    "plot_section",
    "plot_solid",
    "point_text",
    "scene_figure",
    "surface_trace",
    "write_edge_picture",
    "xyz",
]
