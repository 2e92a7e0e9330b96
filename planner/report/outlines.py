"""Lines of pictures: edges of the part, its circles, and the lines and circles that a plan measures."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from errors.measurands import Circle, Geometry
from planner.wanted.planned import targets_of

if TYPE_CHECKING:
    from aspectgraph import Arc, Solid
    from planner.plan import InspectionPlan
    from planner.setting.sensor_setting import SensorSetting

_PARTS_OF_CIRCLE = 96


def polylines(
    plan: InspectionPlan, name: str, setting: SensorSetting | None = None
) -> list[NDArray[np.float64]]:
    """Return one polyline (n, 3) per edge, line or circle of what is measured, mm.

    Parameters
    ----------
    plan : InspectionPlan
        The plan.
    name : str
        One of its entities or dimensions.
    setting : SensorSetting, optional
        Measures it. Default: the first that does.

    Returns
    -------
    list of array (n, 3)
        Two points of a line, a fine polygon of a circle or arc.
    """
    if setting is None:
        setting = next((one for one in plan.settings if name in one.entities), None)
    targets = plan.targets if setting is None else targets_of(plan.targets, setting)
    return lines_of(targets[name].geometry)


def lines_of(geometry: Iterable[Geometry]) -> list[NDArray[np.float64]]:
    """Return one polyline (n, 3) per line or circle, mm.

    Parameters
    ----------
    geometry : iterable of Line or Circle
        What is measured.
    """
    found = []
    for one in geometry:
        if isinstance(one, Circle):
            n = max(2, round(_PARTS_OF_CIRCLE * one.span_rad / (2 * np.pi)))
            found.append(one.points(np.linspace(0.0, one.span_rad, n + 1)))
        else:
            found.append(np.array([one.p, one.q]))
    return found


def drawn(
    plan: InspectionPlan, names: Iterable[str], setting: SensorSetting | None = None
) -> dict[str, NDArray[np.float64]]:
    """Return what a picture highlights by name: ends of an edge (2, 3), segments of a dimension (s, 2, 3), mm.

    Parameters
    ----------
    plan : InspectionPlan
        The plan.
    names : iterable of str
        Some of its entities and dimensions.
    setting : SensorSetting, optional
        Measures them. Default: of each the first that does.

    Returns
    -------
    dict of str to array
        In the order given.
    """
    found = {}
    for name in names:
        lines = polylines(plan, name, setting)
        pairs = [np.stack([line[:-1], line[1:]], axis=1) for line in lines]
        # the ends of an edge are marked
        found[name] = lines[0] if plan.targets[name].in_image else np.concatenate(pairs)
    return found


def chord_circles(solid: Solid) -> dict[int, Arc]:
    """Return the rim or arc of each chord, by the number of the edge in ``solid.edges``.

    Parameters
    ----------
    solid : Solid
        The part.
    """
    number = {edge.id: k for k, edge in enumerate(solid.edges)}
    curves = (*solid.rims(), *solid.arcs())
    return {number[edge]: curve for curve in curves for edge in curve.edge_ids}


def on_circle(
    points_cam: NDArray[np.float64], circle: Arc, cam2world: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Move points along the radius of a circle onto it.

    Parameters
    ----------
    points_cam : ndarray, shape (n, 3)
        Points in the camera's frame, mm.
    circle : Arc
        A rim or arc of the part.
    cam2world : ndarray, shape (4, 4)
        Pose of the camera.

    Returns
    -------
    ndarray, shape (n, 3)
        Points in the part's frame, mm.
    """
    from_centre = points_cam @ cam2world[:3, :3].T + cam2world[:3, 3] - circle.centre
    across = from_centre - np.outer(from_centre @ circle.axis, circle.axis)
    distance = np.linalg.norm(across, axis=1, keepdims=True)
    return np.asarray(circle.centre + circle.radius_mm * across / np.maximum(distance, 1e-300))
