"""Pictures of parts, domains and graphs.

They are drawn in doubles and decide nothing. matplotlib and plotly are imported when a picture is asked for.
"""

from aspectgraph.plot.clip import domain_facets
from aspectgraph.plot.graph_plot import GraphDrawing, plot_graph
from aspectgraph.plot.picker import edge_figure, write_edge_picture
from aspectgraph.plot.traces import (
    is_feature,
    line_trace,
    part_traces,
    point_text,
    scene_figure,
    surface_trace,
    xyz,
)
from aspectgraph.plot.views import SectionDrawing, plot_domains, plot_section, plot_solid

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
