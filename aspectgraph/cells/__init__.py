"""A convex cell complex, cut by planes exactly.

The leaves always tile the starting box without gap or overlap, neighbours share their faces, and where a point lies is
decided without rounding. Sizes are doubles, for weighting and for users' eyes, and decide no topology.
"""

from aspectgraph.cells.arrays import (
    Complex,
    Tree,
    cell_centre,
    cell_sizes,
    cell_triangles,
    face_polygon,
    half_spaces,
    holds,
    inner_balls,
    interfaces,
    locate,
    measured,
    tree_of,
)
from aspectgraph.cells.cell_set import Cell, CellSet
from aspectgraph.cells.split import (
    at_limits,
    cell_side,
    crop,
    face_side,
    leaves,
    n_leaves,
    partition,
    simplify,
    split_cell,
    split_face,
)

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
