"""The kinds of dimensions, one a file; a new one is imported here and is then known everywhere."""

from errors.measurands.kinds import (
    angle,
    centre_distance,
    centre_to_edge,
    circle_size,
    distance,
    length,
)

__all__ = ["angle", "centre_distance", "centre_to_edge", "circle_size", "distance", "length"]
