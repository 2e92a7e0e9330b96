"""What a request measures, as simulation and plan keep it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from planner.request.request import Request

if TYPE_CHECKING:
    from planner.wanted.planned import PlannedDimension


def measured_items(request: Request) -> dict[str, NDArray[np.float64] | PlannedDimension]:
    """Return both ends (2, 3) of each edge, and each dimension, by name."""
    items: dict[str, NDArray[np.float64] | PlannedDimension] = dict(
        zip(request.names, request.ends, strict=True)
    )
    if request.dimensions:
        items |= planned_dimensions(request)
    return items


def planned_dimensions(request: Request) -> dict[str, PlannedDimension]:
    """Return the dimensions of a request as a plan keeps them, by name."""
    if not request.dimensions:
        return {}
    from planner.wanted.planned import PlannedDimension

    return {
        item.name: PlannedDimension.of(item, request.localisation)
        for item in request.dimensions.values()
    }
