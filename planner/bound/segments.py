"""A request as the bound's loops take it: what the camera takes in, and two points of each item to be in view."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from planner.bound.boxes.view import Frustum, Segments, View
from planner.bound.least_image import least_images_mm
from planner.camera.camera import Camera
from planner.request.request import Request


def sensor_tangents(camera: Camera, margin_px: float) -> NDArray[np.float64]:
    """Return the tangents (2,) of the half angles of view, less a margin at the sides of the sensor.

    Off centre or with distortion the view is as wide to the one side as it is to the other, wider one: more than the
    camera takes in, so what is proven of it holds.
    """
    if not camera.is_centred:
        left, top, right, bottom = camera.field(margin_px).outer
        return np.maximum([max(-left, right), max(-top, bottom)], 0.0)
    half = np.array(camera.sensor_size_mm) / 2 - margin_px * np.array(camera.pixel_pitch_mm)
    return np.maximum(half, 0.0) / camera.image_distance_mm


def frustum_of(request: Request) -> Frustum:
    """Return what the camera of a request takes in; the depth of field may have no end.

    The margin of focus that every setting keeps is taken from it, and not the reserve of ends off the axis.
    """
    near, far = request.camera.depth_of_field_mm
    near = near + request.requirements.focus_margin_mm
    far = far - request.requirements.focus_margin_mm
    tan_x, tan_y = sensor_tangents(request.camera, request.requirements.border_px).tolist()
    return Frustum(float(near), float(far), tan_x, tan_y, math.atan(math.hypot(tan_x, tan_y)))


def view_of(request: Request) -> View:
    """Return what the camera of a request takes in, no deeper than the workspace is wide."""
    low, high = (np.asarray(corner, dtype=float) for corner in request.space.workspace)
    near, far, tan_x, tan_y, _ = frustum_of(request)
    # nothing is farther from a viewpoint in the workspace, which holds the part, than its corners are from each other
    far = min(far, max(float(np.linalg.norm(high - low)), 1.01 * near))
    middle = (near + far) / 2
    corners = np.array(
        [
            [x * tan_x * z, y * tan_y * z, z - middle]
            for x in (-1, 1)
            for y in (-1, 1)
            for z in (near, far)
        ]
    )
    return View(near, far, middle, tan_x, tan_y, float(np.linalg.norm(corners, axis=1).max()))


def segments_of(request: Request, entity_idx: NDArray[np.int_]) -> Segments:
    """Return the segments of some items of a request, in their order."""
    ends = np.ascontiguousarray(request.ends[entity_idx])
    ratio = least_images_mm(request)[entity_idx] / request.camera.image_distance_mm
    return Segments(ends, np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1), ratio)
