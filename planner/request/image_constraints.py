"""Constraints that the image puts on a pose: long enough, sharp, inside the sensor.

Every function takes the entities' ends in the camera frame, ``ends_cam`` (n, k, 2, 3), and returns slacks as
`planner.request.constraints` describes them. The three that ask for nothing but the ends are computed together in one
compiled pass, as a search asks for few poses very often: column by column of `image_slacks`,

0       eq 16: image length minus the smallest allowed, mm; an entity not wholly in front has an image of length 0
1–2     eq 17: depth of each end minus D_min, less the reserve of focus, mm
3–4     eq 18: D_max minus that depth, less the reserve of focus, mm
5–12    each end's image from the left, right, upper and lower side of the sensor, less a margin, px; with distortion
        undistorted images, and the sides of a rectangle that the sensor surely holds (`Camera.field`)

L_w·[(r1 − r_v) × u] × v of eq 16 has the length of the first two components of r1 × (r2 − r1) = r1 × r2.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ground.decorators import entry_kernel, kernel
from planner.camera.camera import Camera
from planner.request.camera_limits import NO_RESERVE, FocusReserve

RESOLUTION = slice(0, 1)
FOCUS = slice(1, 5)
FIELD_OF_VIEW = slice(5, 13)

# behind the camera there is no image
_NOT_IMAGED_PX = -1e6


class Lens(NamedTuple):
    """What the slacks depend on beside the ends: lengths in mm on the part's or the sensor's side, the rest in px.

    The reserve of focus of an end is ``focus_margin_mm``, or what ``reserve`` asks for if that is more.
    """

    image_distance_mm: float
    min_length_mm: float
    nearest_mm: float
    farthest_mm: float
    focus_margin_mm: float
    reserve: FocusReserve
    scale_x_px: float
    scale_y_px: float
    centre_x_px: float
    centre_y_px: float
    left_px: float
    top_px: float
    right_px: float
    bottom_px: float
    margin_px: float

    @classmethod
    def of(
        cls,
        camera: Camera,
        min_length_mm: float = 0.0,
        margin_px: float = 0.0,
        focus_margin_mm: float = 0.0,
        reserve: FocusReserve = NO_RESERVE,
    ) -> Lens:
        """Return the numbers of a camera and of what is asked of its image."""
        matrix = camera.matrix
        (width, height) = camera.resolution
        # pixel centres are whole numbers, so the sensor's sides are at -0.5 and count - 0.5
        sides = -0.5, -0.5, width - 0.5, height - 0.5
        if camera.distortion is not None:
            # the margin is counted in pixels of the real image, the sides in those of the undistorted one
            tangents = np.array(camera.field(margin_px).inner).reshape(2, 2)
            margin_px = 0.0
            x_low, y_low, x_high, y_high = (
                (tangents * np.diag(matrix)[:2] + matrix[:2, 2]).ravel().tolist()
            )
            sides = x_low, y_low, x_high, y_high
        scales = float(matrix[0, 0]), float(matrix[1, 1]), float(matrix[0, 2]), float(matrix[1, 2])
        near, far = map(float, camera.depth_of_field_mm)
        return cls(
            camera.image_distance_mm,
            float(min_length_mm),
            near,
            far,
            float(focus_margin_mm),
            reserve,
            *scales,
            *sides,
            float(margin_px),
        )


def image_slacks(lens: Lens, ends_cam: np.ndarray) -> np.ndarray:
    """Return all slacks (n, k, 13) of ends in the camera frame (n, k, 2, 3), in the columns listed above."""
    out = np.empty((*ends_cam.shape[:2], 13))
    _image_slacks(lens, np.ascontiguousarray(ends_cam, dtype=np.float64), out)
    return out


def least_slacks(slacks: np.ndarray, first: np.ndarray) -> np.ndarray:
    """Return the least slacks (n, k, c) of each item over its segments, from those of all segments (n, s, c).

    ``first`` (k,) are the items' first segments.
    """
    out = np.empty((len(slacks), len(first), slacks.shape[2]))
    _least_slacks(slacks, np.append(first, slacks.shape[1]), out)
    return out


def resolution_slacks(camera: Camera, ends_cam: np.ndarray, min_length_mm: float) -> np.ndarray:
    """Eq 16: length of each entity's image minus the smallest allowed, mm on the sensor; (n, k, 1)."""
    return image_slacks(Lens.of(camera, min_length_mm=min_length_mm), ends_cam)[..., RESOLUTION]


def focus_slacks(camera: Camera, ends_cam: np.ndarray) -> np.ndarray:
    """Eqs 17–18: depth of each end minus D_min, and D_max minus that depth, mm; (n, k, 4)."""
    return image_slacks(Lens.of(camera), ends_cam)[..., FOCUS]


def field_of_view_slacks(camera: Camera, ends_cam: np.ndarray, margin_px: float) -> np.ndarray:
    """Distance of each end's image from the four sides of the sensor, less a margin, px; (n, k, 8).

    The image of a segment is the segment between the images of its ends, so both ends inside means all of it inside.
    Behind the camera there is no image; the slack is then a large negative number.
    """
    return image_slacks(Lens.of(camera, margin_px=margin_px), ends_cam)[..., FIELD_OF_VIEW]


@kernel(error_model="numpy")
def _focus_margin(least, reserve, x, y):
    """Return the reserve of focus of an end at (x, y) of the camera's frame, mm, as `FocusReserve.margin_mm`."""
    if reserve.sigmas <= 0.0:
        return least
    variance = (
        reserve.along
        + 2.0 * (y * reserve.along_x - x * reserve.along_y)
        + y * y * reserve.turn_x
        + x * x * reserve.turn_y
        - 2.0 * x * y * reserve.turn_xy
    )
    sigma = math.sqrt(max(variance, 0.0))
    ceiling = max(reserve.most_mm, reserve.least_sigmas * sigma)
    return max(least, min(reserve.sigmas * sigma, ceiling))


@entry_kernel(error_model="numpy")
def _image_slacks(lens, ends_cam, out):
    for i in range(ends_cam.shape[0]):
        for j in range(ends_cam.shape[1]):
            a = ends_cam[i, j, 0]
            b = ends_cam[i, j, 1]
            row = out[i, j]
            length = 0.0
            if a[2] > 0.0 and b[2] > 0.0:
                x = a[0] * b[2] - b[0] * a[2]
                y = a[1] * b[2] - b[1] * a[2]
                length = lens.image_distance_mm * math.hypot(x, y) / (a[2] * b[2])
            row[0] = length - lens.min_length_mm
            for e in range(2):
                x, y, z = ends_cam[i, j, e]
                margin = _focus_margin(lens.focus_margin_mm, lens.reserve, x, y)
                row[1 + e] = z - (lens.nearest_mm + margin)
                row[3 + e] = (lens.farthest_mm - margin) - z
                if z <= 0.0:
                    row[5 + e] = row[7 + e] = row[9 + e] = row[11 + e] = _NOT_IMAGED_PX
                    continue
                u = lens.scale_x_px * x / z + lens.centre_x_px
                v = lens.scale_y_px * y / z + lens.centre_y_px
                row[5 + e] = u - lens.left_px - lens.margin_px
                row[7 + e] = lens.right_px - u - lens.margin_px
                row[9 + e] = v - lens.top_px - lens.margin_px
                row[11 + e] = lens.bottom_px - v - lens.margin_px


@entry_kernel(error_model="numpy")
def _least_slacks(slacks, first, out):
    for i in range(slacks.shape[0]):
        for k in range(out.shape[1]):
            for c in range(slacks.shape[2]):
                smallest = slacks[i, first[k], c]
                for j in range(first[k] + 1, first[k + 1]):
                    value = slacks[i, j, c]
                    # what is no number stays none, as numpy has it
                    if value < smallest or value != value:
                        smallest = value
                out[i, k, c] = smallest


def cone_slacks(camera: Camera, centre_cam: np.ndarray, radius_mm: float) -> np.ndarray:
    """Eqs 19–20: the sphere around the entities lies in the cone of the smaller sensor side; mm, (n, 1, 1).

    With α = 2·atan(I_min / 2d) and r_k = r_s − (R_s / sin(α/2))·v the slack is (r_k − r_v)·v − ‖r_k − r_v‖·cos(α/2).

    Parameters
    ----------
    camera : Camera
        Gives I_min, the smaller side of the sensor, and d; off centre, the side nearest to the axis counts.
    centre_cam : array (n, 3)
        Centre r_s of the sphere in the camera frame, mm.
    radius_mm : float
        Its radius R_s.
    """
    half = math.atan(min(camera.sensor_size_mm) / (2 * camera.image_distance_mm))
    if not camera.is_centred:
        x_low, y_low, x_high, y_high = camera.field().inner
        half = math.atan(min(-x_low, -y_low, x_high, y_high))
    apex = centre_cam - [0.0, 0.0, radius_mm / math.sin(half)]
    return (apex[..., 2] - np.linalg.norm(apex, axis=-1) * math.cos(half))[:, None, None]
