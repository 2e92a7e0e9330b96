"""The entity-based aspect graph: viewing domains as nodes, common boundaries as edges, and its files.

Every domain's list was confirmed by rays, and doubts were settled exactly. A graph written to GraphML and read again is
the same.
"""

from aspectgraph.graph.aspect_graph import (
    EntityAspectGraph,
    JointEstimate,
    JointForecast,
    PartitionSurface,
    build_aspect_graph,
    estimate_graph,
    graph_of,
)
from aspectgraph.graph.complete_graph import complete_aspect_graph
from aspectgraph.graph.graphml import read_graphml, write_graphml

__all__ = [
    "EntityAspectGraph",
    "JointEstimate",
    "JointForecast",
    "PartitionSurface",
    "build_aspect_graph",
    "complete_aspect_graph",
    "estimate_graph",
    "graph_of",
    "read_graphml",
    "write_graphml",
]
