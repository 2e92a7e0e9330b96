"""A small graph made by hand, with the values that files find hard."""

import networkx as nx

from aspectgraph.graph.aspect_graph import PartitionSurface

SURFACE_A = PartitionSurface("A", "e1", (), (), (4,), (0.0, 0.6, 0.8, 1 / 3))
SURFACE_B = PartitionSurface("B", "side <e2>", (3,), (), (), (1.0, 0.0, 0.0, -2.5))


def node(names, volume=1.5):
    return {
        "observable": names,
        "volume": volume,
        "unbounded": not names,
        "viewpoint": (0.1, -2.0, 1e-7),
        "clearance": 0.1 + 0.2,
        "bbox_min": (-60.0, -60.0, -60.0),
        "bbox_max": (61.0, 60.0, 1 / 3),
        "n_cells": 3,
        "confirmed": True,
        "n_rays": 64,
        "n_arbitrated": 0,
    }


def small_graph():
    graph = nx.Graph(
        part="plate & block",
        entities=("e1", "side <e2>"),
        endpoints=((0.0, 0.0, 0.0, 1.0, 0.0, 0.1), (0.0, 0.0, 0.0, 0.0, 1 / 3, 0.0)),
        workspace_min=(-60.0, -60.0, -60.0),
        workspace_max=(61.0, 61.0, 61.0),
        grid_mm=2.0**-15,
        snapping_mm=0.0,
        min_width_mm=1e-4,
        n_slivers=2,
    )
    graph.add_node(0, **node(()))
    graph.add_node(1, **node(("e1",), 1e300))
    graph.add_node(2, **node(("e1", "side <e2>"), 2.5e-308))
    graph.add_edge(0, 1, area=2.0, surfaces=(SURFACE_A,))
    graph.add_edge(1, 2, area=0.1, surfaces=(SURFACE_A, SURFACE_B))
    return graph
