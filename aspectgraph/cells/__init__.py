"""A convex cell complex, cut by planes exactly.

The leaves always tile the starting box without gap or overlap, neighbours share their faces, and where a point lies is
decided without rounding. Sizes are doubles, for weighting and for users' eyes, and decide no topology.
"""

from aspectgraph.cells.arrays import Complex
from aspectgraph.cells.cell_set import Cell, CellSet
from aspectgraph.cells.crop import at_limits, crop
from aspectgraph.cells.measure import (
    cell_centre,
    cell_sizes,
    cell_triangles,
    face_polygon,
    half_spaces,
    inner_balls,
    interfaces,
    measured,
)
from aspectgraph.cells.point_location import Tree, holds, locate, tree_of
from aspectgraph.cells.simplify import n_leaves, partition, simplify
from aspectgraph.cells.split import cell_side, face_side, leaves, split_cell, split_face

__all__ = [
    "Cell",
    "CellSet",
    "Complex",
    "Tree",
    "at_limits",
    "cell_centre",
    "cell_side",
    "cell_sizes",
    "cell_triangles",
    "crop",
    "face_polygon",
    "face_side",
    "half_spaces",
    "holds",
    "inner_balls",
    "interfaces",
    "leaves",
    "locate",
    "measured",
    "n_leaves",
    "partition",
    "simplify",
    "split_cell",
    "split_face",
    "tree_of",
]
