"""What can be measured: named straight edges, rims and arcs of a solid.

Every entity is an edge, or a chain of collinear edges, that is sharp and belongs to no curve; or all chords of a sharp
circular edge, closed (a rim) or open (an arc), with the circle they stand for. None is named twice.
"""

from aspectgraph.entities.entity import Entity, resolve_entities
from aspectgraph.entities.entity_files import read_entities
from aspectgraph.entities.entity_rules import select_entities

__all__ = [
    "Entity",
    "read_entities",
    "resolve_entities",
    "select_entities",
]
