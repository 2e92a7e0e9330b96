"""What is repaired in a mesh without changing its shape: vertices made one, facets that say nothing taken out."""

from aspectgraph.read.repair.thin_facets import turn_thin
from aspectgraph.read.repair.weld import drop_repetitions, drop_thin, is_closed, weld

__all__ = [
    "drop_repetitions",
    "drop_thin",
    "is_closed",
    "turn_thin",
    "weld",
]
