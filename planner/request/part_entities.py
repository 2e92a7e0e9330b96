"""The entities of a part that plans measure, found again by their lines and circles.

A plan names its entities as its request does, and such a name says nothing about an id. Their geometry does.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from aspectgraph.entities.entity import Entity, resolve_entities
from aspectgraph.solid.rims import Arc, Rim
from errors.measurands import Circle
from planner.exceptions import RequestError

if TYPE_CHECKING:
    from aspectgraph import Solid
    from planner.request.targets import Target

# a circle of a plan is that of a rim if they differ by less than this share of the part's size
_SAME = 1e-6


def parts_of(target: Target, solid: Solid, name: str) -> tuple[Entity, ...]:
    """Return the edges, rims and arcs that something measured consists of."""
    return tuple(
        _curve(solid, name, item)
        if isinstance(item, Circle)
        else _line(solid, name, (item.p, item.q))
        for item in target.geometry
    )


def _line(solid: Solid, name: str, ends: Any) -> Entity:
    from aspectgraph.exceptions import EntityError

    points = np.asarray(ends, dtype=np.float64)
    try:
        return resolve_entities(solid, {name: points})[name]
    except EntityError as error:
        # a stretch is lit where the whole edge is
        edge = _edge_through(solid, points)
        if edge is not None:
            return resolve_entities(solid, {name: edge})[name]
        raise RequestError(f"solid must be the plan's part. {error}") from error


def _edge_through(solid: Solid, points: NDArray[np.float64]) -> int | None:
    """Return the id of an edge that both points (2, 3) lie on; None if there is none."""
    size = _SAME * float(np.linalg.norm(np.ptp(solid.bounds, axis=0)))
    for edge in solid.edges:
        start, end = solid.edge_points(edge.id)
        along = end - start
        shares = np.clip((points - start) @ along / (along @ along), 0.0, 1.0)
        if np.linalg.norm(start + shares[:, None] * along - points, axis=1).max() <= size:
            return edge.id
    return None


def _curve(solid: Solid, name: str, circle: Circle) -> Entity:
    """Return the rim or arc with a circle."""
    size = _SAME * float(np.linalg.norm(np.ptp(solid.bounds, axis=0)))
    around = [arc for arc in (*solid.arcs(), *solid.rims()) if _is_on(arc, circle, size)]
    for arc in around:
        if (circle.start is None) != isinstance(arc, Rim):
            continue
        entity = resolve_entities(solid, {name: arc.id})[name]
        if (
            circle.start is None
            or np.linalg.norm(entity.points[0] - circle.points(np.zeros(1))[0]) < 1e3 * size
        ):
            return entity
    if around and circle.start is not None:
        # a run is lit where the whole rim or arc is
        return resolve_entities(solid, {name: around[-1].id})[name]
    raise RequestError(
        f"solid must be the plan's part. Got no rim or arc of {name!r} in {solid.name!r}."
    )


def _is_on(arc: Arc, circle: Circle, size: float) -> bool:
    """Tell whether an arc or rim lies on a circle, to within a size, mm."""
    off = max(
        float(np.linalg.norm(arc.centre - circle.centre)), abs(arc.radius_mm - circle.radius_mm)
    )
    return bool(off <= size and abs(abs(arc.axis @ circle.axis) - 1) <= _SAME)
