"""Boxes of camera poses, searched for one pose that inspects more than a given weight. Compiled loops.

What is dropped from a box is dropped for a proven reason: no pose of the box inspects it. The answer "none" is a proof,
the answer "found" comes with the pose.
"""

from planner.bound.boxes.conditions import exclusive_groups
from planner.bound.boxes.search import search
from planner.bound.boxes.view import Cells, Entities, View, entity_cells
from planner.bound.boxes.viewpoint_tree import Viewpoints, viewpoints_for

__all__ = [
    "Cells",
    "Entities",
    "View",
    "Viewpoints",
    "entity_cells",
    "exclusive_groups",
    "search",
    "viewpoints_for",
]
