"""What is drawn of that which a plan measures: edges, and the lines and circles that are fitted."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from errors.measurands import Circle

if TYPE_CHECKING:
    from planner.plan import InspectionPlan

_PARTS_OF_CIRCLE = 96


def polylines(plan: InspectionPlan, name: str) -> list[NDArray[np.float64]]:
    """Return one polyline (n, 3) per edge, line or circle of what is measured, mm.

    Parameters
    ----------
    plan : InspectionPlan
        The plan.
    name : str
        One of its entities or dimensions.

    Returns
    -------
    list of array (n, 3)
        Two points of a line, a fine polygon of a circle or arc.
    """
    found = []
    for one in plan.targets[name].geometry:
        if isinstance(one, Circle):
            n = max(2, round(_PARTS_OF_CIRCLE * one.span_rad / (2 * np.pi)))
            found.append(one.points(np.linspace(0.0, one.span_rad, n + 1)))
        else:
            found.append(np.array([one.p, one.q]))
    return found


def drawn(plan: InspectionPlan, names: Iterable[str]) -> dict[str, NDArray[np.float64]]:
    """Return what a picture highlights by name: ends of an edge (2, 3), segments of a dimension (s, 2, 3), mm.

    Parameters
    ----------
    plan : InspectionPlan
        The plan.
    names : iterable of str
        Some of its entities and dimensions.

    Returns
    -------
    dict of str to array
        In the order given.
    """
    found = {}
    for name in names:
        lines = polylines(plan, name)
        pairs = [np.stack([line[:-1], line[1:]], axis=1) for line in lines]
        # the ends of an edge are marked
        found[name] = lines[0] if plan.targets[name].in_image else np.concatenate(pairs)
    return found
