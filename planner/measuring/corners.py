"""Corners of lengths in an image: where the line of an edge meets one that leaves its end."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from errors.measurands import Line
from planner.camera.camera import Camera
from planner.camera.pose import world_to_cam
from planner.measuring.samples import PartEdge, PartModel, Samples

Array = NDArray[np.float64]

LEAST_ANGLE_DEG = 20.0
"""A corner is where another line leaves an edge at this angle at least, in the image."""
ARM_SHARE = 0.5
"""Share of the samples of such a line that must be found."""
ARM_PX = 200.0
"""Such a line is used up to this distance from the corner."""

# of an edge: where its direction in the image is taken, from its end
_NEAR_END = 1e-3


def arms_of(
    model: PartModel, edge: PartEdge, end: Array, cam2world: Array, camera: Camera
) -> list[tuple[PartEdge, float]]:
    """Return the straight edges that leave an end of an edge so that both meet in a corner of the image.

    Parameters
    ----------
    model : PartModel
        The part.
    edge : PartEdge
        The edge.
    end : array (3,)
        Its end, mm.
    cam2world : array (4, 4)
        The pose.
    camera : Camera
        The camera.

    Returns
    -------
    list of (PartEdge, float)
        Each with the sine of its angle with the edge in the image, at least that of `LEAST_ANGLE_DEG`.
    """
    along = _image_way(edge, end, cam2world, camera)
    arms = []
    for other in model.leaving(edge, end):
        way = _image_way(other, end, cam2world, camera)
        sine = abs(float(along[0] * way[1] - along[1] * way[0]))
        if sine >= np.sin(np.radians(LEAST_ANGLE_DEG)):
            arms.append((other, sine))
    return arms


def ends_of(edge: PartEdge) -> tuple[Array, Array]:
    """Return both ends (3,) of a straight edge, mm."""
    line = edge.geometry
    assert isinstance(line, Line)
    return line.p, line.q


def near_corner(samples: Samples, corner: Array, cam2world: Array, camera: Camera) -> Samples:
    """Return the samples that lie at most `ARM_PX` from a corner (3,) in the image."""
    places = ideal_images(samples.points, cam2world, camera)
    distance = np.linalg.norm(places - ideal_images(corner[None], cam2world, camera), axis=1)
    return samples.chosen(distance <= ARM_PX)


def ideal_images(points: Array, cam2world: Array, camera: Camera) -> Array:
    """Return images (n, 2) in px of a lens without distortion."""
    local = world_to_cam(points, cam2world)
    return np.asarray((local / local[:, 2:] @ camera.matrix.T)[:, :2])


def _image_way(edge: PartEdge, end: Array, cam2world: Array, camera: Camera) -> Array:
    """Return the unit vector along an edge in the image, away from one of its ends."""
    p, q = ends_of(edge)
    other = q if np.linalg.norm(p - end) < np.linalg.norm(q - end) else p
    images = ideal_images(np.array([end, end + _NEAR_END * (other - end)]), cam2world, camera)
    way = images[1] - images[0]
    return np.asarray(way / max(float(np.linalg.norm(way)), 1e-12))
