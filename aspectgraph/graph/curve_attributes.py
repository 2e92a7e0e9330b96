"""What a graph says of entities that are rims, arcs or parts."""

from __future__ import annotations

from collections.abc import Collection

from aspectgraph.entities.straight_edges import Entity


def curve_attributes(entities: Collection[Entity]) -> dict[str, tuple[object, ...]]:
    """Return the attributes of a graph that say which of its entities are rims, arcs or parts; none if all are edges.

    Parameters
    ----------
    entities : collection of Entity
        Those of the graph.

    Returns
    -------
    dict
        ``"kinds"`` of the entities, and ``"circles"``: centre, axis and radius of each, in mm; of an edge nothing.
        If there are parts, ``"parts"``: the text of each, such as ``17[0:1/4]``; of a whole entity nothing.
    """
    attributes: dict[str, tuple[object, ...]] = {}
    if any(entity.part is not None for entity in entities):
        attributes["parts"] = tuple("" if e.part is None else str(e.part) for e in entities)
    if all(entity.kind == "edge" for entity in entities):
        return attributes
    circles = [entity.circle for entity in entities]
    rows = [
        () if c is None else (*map(float, (*c.centre, *c.axis)), float(c.radius_mm))
        for c in circles
    ]
    kinds = tuple(entity.kind for entity in entities)
    return {"kinds": kinds, "circles": tuple(rows), **attributes}
