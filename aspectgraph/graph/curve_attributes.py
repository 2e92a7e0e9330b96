"""What a graph says of entities that are rims or arcs."""

from __future__ import annotations

from collections.abc import Collection

from aspectgraph.entities.straight_edges import Entity


def curve_attributes(entities: Collection[Entity]) -> dict[str, tuple[object, ...]]:
    """Return the attributes of a graph that say which of its entities are rims and arcs; none if all are edges.

    Parameters
    ----------
    entities : collection of Entity
        Those of the graph.

    Returns
    -------
    dict
        ``"kinds"`` of the entities, and ``"circles"``: centre, axis and radius of each, in mm; of an edge nothing.
    """
    if all(entity.kind == "edge" for entity in entities):
        return {}
    circles = [entity.circle for entity in entities]
    rows = [
        () if c is None else (*map(float, (*c.centre, *c.axis)), float(c.radius_mm))
        for c in circles
    ]
    return {"kinds": tuple(entity.kind for entity in entities), "circles": tuple(rows)}
