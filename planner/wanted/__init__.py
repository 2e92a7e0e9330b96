"""What is to be inspected: edges, and dimensions over one or more entities.

Guarantee: what a dimension asks for is checked before anything is planned, and an error names it.
"""

from planner.wanted.dimension import Dimension
from planner.wanted.targets import Target, edge_target

__all__ = ["Dimension", "Target", "edge_target"]
