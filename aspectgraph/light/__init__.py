"""From where a lamp makes edges show: the whole edge lit, and enough contrast between the two faces next to it.

Matt faces of one albedo, point lamps, no light from other faces. Then the light domain of an edge is its region with
the lamp as viewpoint, without one wedge through the edge's line: planes only, and all exact, as for viewpoints.
"""

from aspectgraph.light.light_graph import LightGraph, build_light_graph, light_graph_of
from aspectgraph.light.light_regions import (
    LightRegions,
    check_contrast,
    check_lamps,
    compute_light,
    contrast,
    light_region,
    silhouettes_from,
)

__all__ = [
    "LightGraph",
    "LightRegions",
    "build_light_graph",
    "check_contrast",
    "check_lamps",
    "compute_light",
    "contrast",
    "light_graph_of",
    "light_region",
    "silhouettes_from",
]
