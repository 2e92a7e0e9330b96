"""The part: a closed, oriented surface of planar faces.

Whoever holds a `Solid` may rely on its rules, for its constructor checked them all: every edge runs once in each
direction, faces are planar and have an area, shells face outwards, and the surface neither crosses nor touches itself.
What breaks a rule is refused with its place.
"""

from aspectgraph.solid.checks import (
    check_vertices,
    default_planarity_mm,
    face_area_vectors,
    face_outwards,
    segment_distance,
    side_distances,
)
from aspectgraph.solid.ray_scene import RayScene
from aspectgraph.solid.rims import (
    CORNER_DEG,
    SHARP_DEG,
    Arc,
    Circle,
    CircularEdge,
    EdgeEnd,
    Rim,
    fit_circle,
)
from aspectgraph.solid.solid import Solid
from aspectgraph.solid.topology import (
    Edge,
    Face,
    check_fans,
    describe_edge,
    describe_point,
    label_shells,
    newell_area_vector,
    pair_edges,
    signed_dihedrals_deg,
    triangulate_face,
)

__all__ = [
    "CORNER_DEG",
    "SHARP_DEG",
    "Arc",
    "Circle",
    "CircularEdge",
    "Edge",
    "EdgeEnd",
    "Face",
    "RayScene",
    "Rim",
    "Solid",
    "check_fans",
    "check_vertices",
    "default_planarity_mm",
    "describe_edge",
    "describe_point",
    "face_area_vectors",
    "face_outwards",
    "fit_circle",
    "label_shells",
    "newell_area_vector",
    "pair_edges",
    "segment_distance",
    "side_distances",
    "signed_dihedrals_deg",
    "triangulate_face",
]
