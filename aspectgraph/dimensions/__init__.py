"""Dimensions that a CAD model states: values, tolerances, and the entities of the solid that measure them.

Every stated value is compared with the geometry it is attached to. What disagrees, or cannot be measured by sharp
edges, rims and arcs in one image, says why.
"""

from aspectgraph.dimensions.read_dimensions import read_dimensions
from aspectgraph.dimensions.records import ModelDimension, SurfaceZone

__all__ = [
    "ModelDimension",
    "SurfaceZone",
    "read_dimensions",
]
