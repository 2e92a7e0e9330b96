"""Exact signs, and the part on an integer grid in its own frame, unit and order.

No sign computed here depends on rounding. A copy of the part that was turned, moved, scaled or listed in another order
gets the same integers.
"""

from aspectgraph.exact.canonical import Listing, list_solid, own_frame, resolving_grid
from aspectgraph.exact.grid import Grid, as_queries, turned
from aspectgraph.exact.planes import (
    face_planes,
    find_parallel,
    find_plane,
    height,
    plane_through,
    side_of,
)
from aspectgraph.exact.predicates import meet, sign_at_point, sign_at_vertex

__all__ = [
    "Grid",
    "Listing",
    "as_queries",
    "face_planes",
    "find_parallel",
    "find_plane",
    "height",
    "list_solid",
    "meet",
    "own_frame",
    "plane_through",
    "resolving_grid",
    "side_of",
    "sign_at_point",
    "sign_at_vertex",
    "turned",
]
