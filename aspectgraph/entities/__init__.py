"""What can be measured: named straight edges of a solid.

Every entity is an edge, or a chain of collinear edges, that is sharp and belongs to no curve; no edge is named twice.
"""

from aspectgraph.entities.entity_files import read_entities
from aspectgraph.entities.straight_edges import Entity, resolve_entities

__all__ = [
    "Entity",
    "read_entities",
    "resolve_entities",
]
