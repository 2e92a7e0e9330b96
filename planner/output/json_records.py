"""What the commands say with ``--json``: plain values in mm and degrees, for other programs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from aspectgraph import Arc, Edge, EntityAspectGraph, Rim, Solid
from planner.plan import InspectionPlan


def part_record(
    solid: Solid, edges: Iterable[Edge], curves: Iterable[Arc], notes: Iterable[str] = ()
) -> dict[str, Any]:
    """Return what a part consists of: its box in mm, and its edges, rims and arcs by id; notes of its own and more."""
    return {
        "part": solid.name,
        "bounds": np.asarray(solid.bounds, dtype=float).tolist(),
        "faces": len(solid.faces),
        "notes": [*solid.notes, *notes],
        "edges": [
            {
                "id": edge.id,
                "ends": np.asarray(solid.edge_points(edge.id), dtype=float).tolist(),
                "length": float(solid.edge_length_mm(edge.id)),
                "turn": float(edge.turn_deg),
                "faces": list(edge.faces),
                "end_kinds": [{"kind": end.kind, "arc": end.arc} for end in solid.edge_ends(edge)],
            }
            for edge in edges
        ],
        "curves": [
            {
                "id": curve.id,
                "kind": "rim" if isinstance(curve, Rim) else "arc",
                "radius": float(curve.radius_mm),
                "centre": np.asarray(curve.centre, dtype=float).tolist(),
                "axis": np.asarray(curve.axis, dtype=float).tolist(),
            }
            for curve in curves
        ],
    }


def graph_record(result: EntityAspectGraph, path: str | Path) -> dict[str, Any]:
    """Return the viewing domains of a graph, which are adjacent, and where the GraphML is."""
    nodes = result.graph.nodes
    listed = result.regions.listed_as
    return {
        "entities": list(result.entity_names),
        "workspace": np.asarray(result.workspace, dtype=float).tolist(),
        "domains": [
            {"id": n, "volume": float(nodes[n]["volume"]), listed: sorted(nodes[n][listed])}
            for n in nodes
        ],
        "adjacent": [list(pair) for pair in result.graph.edges()],
        "file": str(path),
    }


def plan_record(
    plan: InspectionPlan, files: Sequence[str], not_planned: Mapping[str, str]
) -> dict[str, Any]:
    """Return a plan as in its file, the files written, and what could not be planned, with the reason.

    ``plan.features`` counts the characteristics, and those that are not planned.
    """
    return {"plan": plan.to_dict(), "files": list(files), "not_planned": dict(not_planned)}
