"""Dimensions measured as a program on the robot would: points found, carried back with the planned pose, fitted.

It shares the definition of a dimension with the prediction (its planes and its value by what is fitted), and no
computation: exact displaced poses, the camera's matrix, least squares by iteration. Every draw has its own faces off
their place, and its own error across each edge that all points of it have in common.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from errors.measurands import Circle, Geometry, Localisation
from planner.camera.camera import Camera
from planner.camera.imaging import image_of, undistorted_px
from planner.camera.pose import world_to_cam
from planner.verify.circle_fits import fit_circles
from planner.verify.point_loops import carry_back, image_points
from planner.wanted.planned import PlannedDimension, sample_points

# of an entity's size: how far ahead its direction in the image is taken
_AHEAD = 1e-5


def measured_errors(
    dimension: PlannedDimension,
    planned: NDArray[np.float64],
    poses: NDArray[np.float64],
    camera: Camera,
    rng: np.random.Generator,
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Measure a dimension from displaced poses.

    Parameters
    ----------
    dimension : PlannedDimension
        What is measured.
    planned : array (4, 4)
        The pose it is carried back with.
    poses : array (n, 4, 4)
        Where the camera is.
    camera : Camera
        The camera.
    rng : numpy.random.Generator
        For errors of localisation, and for the phases of the pixel grid.

    Returns
    -------
    error : array (n,)
        Measured value minus what is measured at the planned pose, mm (angles: degrees); nan without an image.
    outside : array of bool (n,)
        Whether a point of the entities is outside the image.
    """
    value = dimension.measurand
    outside = np.zeros(len(poses), dtype=bool)
    fits = []
    real = _before_real_faces(dimension, poses, rng)
    for one, frame, seen_from in zip(dimension.geometry, value.frames, real, strict=True):
        points = _points(one, dimension, planned, camera)
        pixels = _pixels(points, seen_from, camera)
        outside |= ~_on_sensor(pixels, camera)
        found = _localised(pixels, dimension.localisation, value.in_image, rng)
        if dimension.localisation.common_px > 0:
            ahead = _pixels(points + _forward(one, points), seen_from, camera) - pixels
            found = found + _common(ahead, dimension.localisation, value.in_image, rng)
        if value.in_image:
            pitch = np.array(camera.pixel_pitch_mm)
            nominal = undistorted_px(camera, _pixels(points, planned[None], camera)[0])
            return value.image_value(
                undistorted_px(camera, found) * pitch, nominal * pitch
            ), outside
        flat = _carried_back(found, planned, camera, np.array([frame.origin, frame.x, frame.y]))
        fits.append(_circles(flat, one.radius_mm) if isinstance(one, Circle) else _lines(flat))
    return value.value(fits), outside


def _before_real_faces(
    dimension: PlannedDimension, poses: NDArray[np.float64], rng: np.random.Generator
) -> list[NDArray[np.float64]]:
    """Return for each entity the poses (n, 4, 4) from which it looks as it does where its face is off its place.

    A face that is off by a vector is seen as from a camera that is off by the opposite one.
    """
    sigma = dimension.surfaces_mm
    value = dimension.measurand
    if not sigma > 0:
        return [poses] * len(dimension.geometry)
    if value.in_image:
        (line,) = dimension.geometry
        off = rng.normal(0.0, sigma, (len(poses), 3))
        along = line.direction  # type: ignore[union-attr]
        # across the edge alone: where it ends is the length
        return [_moved(poses, off - (off @ along)[:, None] * along)]
    index, normals = value.surfaces
    offs = {k: rng.normal(0.0, sigma, len(poses)) for k in dict.fromkeys(index.tolist())}
    return [
        _moved(poses, offs[k][:, None] * normal)
        for k, normal in zip(index.tolist(), normals, strict=True)
    ]


def _moved(poses: NDArray[np.float64], off: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return poses moved against vectors (n, 3) in the part's frame."""
    moved = poses.copy()
    moved[:, :3, 3] -= off
    return moved


def _forward(one: Geometry, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return small steps (m, 3) along an entity from points of it."""
    if isinstance(one, Circle):
        return np.asarray(_AHEAD * np.cross(one.axis, points - one.centre))
    return np.tile(_AHEAD * (one.q - one.p), (len(points), 1))


def _common(
    ahead: NDArray[np.float64], how: Localisation, each_end: bool, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Return how far (n, m, 2) all points of an entity are found across it, px; each end of a length along it.

    ``ahead`` (n, m, 2) are steps along its image.
    """
    way = ahead / np.sqrt(ahead[..., :1] ** 2 + ahead[..., 1:] ** 2)
    n, points, _ = ahead.shape
    if each_end:
        return np.asarray(rng.normal(0.0, how.common_px, (n, points, 1)) * way)
    across = np.stack([-way[..., 1], way[..., 0]], axis=2)
    return np.asarray(rng.normal(0.0, how.common_px, (n, 1, 1)) * across)


def _points(
    one: Geometry, dimension: PlannedDimension, planned: NDArray[np.float64], camera: Camera
) -> NDArray[np.float64]:
    """Return the points (m, 3) that are looked for on an entity."""
    if dimension.measurand.in_image:
        return np.array([one.p, one.q])  # type: ignore[union-attr]
    how = dimension.localisation
    if how.model != "fit":
        return sample_points(one, how.points)
    outline = _pixels(sample_points(one, 200), planned[None], camera)[0]
    # of what is outside the field of a lens with distortion there is no image
    along = float(np.nansum(np.linalg.norm(np.diff(outline, axis=0), axis=1)))
    independent = max(3, round(along / how.correlation_px))
    if how.floor_px > 0:
        independent = min(independent, max(3, round((how.sigma_px / how.floor_px) ** 2)))
    return sample_points(one, independent)


def _pixels(
    points: NDArray[np.float64], poses: NDArray[np.float64], camera: Camera
) -> NDArray[np.float64]:
    """Return images (n, m, 2) in px of points (m, 3) from poses (n, 4, 4); nan behind the camera."""
    if camera.distortion is None:
        # copies, so that the loops are compiled for one kind of arrays
        found = np.empty((len(poses), len(points), 2))
        image_points(
            np.array(points, np.float64, order="C"),
            np.array(poses, np.float64, order="C"),
            _scale(camera),
            found,
        )
        return found
    local = world_to_cam(points, poses)
    depth = np.where(local[..., 2:] > 0, local[..., 2:], np.nan)
    return image_of(camera, local / depth)


def _scale(camera: Camera) -> NDArray[np.float64]:
    """Return focal lengths and principal point, px."""
    matrix = camera.matrix
    return np.array([matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]])


def _on_sensor(pixels: NDArray[np.float64], camera: Camera) -> NDArray[np.bool_]:
    inside = (pixels >= -0.5) & (pixels <= np.array(camera.resolution) - 0.5)
    return np.asarray(inside.all(axis=(1, 2)))


def _localised(
    pixels: NDArray[np.float64], how: Localisation, each_end: bool, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Return where points of images (n, m, 2) are found instead of where they are.

    Whole pixels are those of a grid that is shifted at random: once for each end where the length of an image is
    measured, otherwise once for all points of an entity. So a line along the rows keeps its own error, because all of
    its points are rounded to the same side.
    """
    if how.model == "rounding":
        n, points, _ = pixels.shape
        shift = rng.uniform(-0.5, 0.5, (n, points if each_end else 1, 2))
        return np.asarray(np.rint(pixels + shift) - shift)
    return np.asarray(pixels + rng.normal(0.0, how.sigma_px, pixels.shape))


def _carried_back(
    pixels: NDArray[np.float64],
    planned: NDArray[np.float64],
    camera: Camera,
    frame: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return coordinates (n, m, 2) in a plane (3, 3: origin, x, y) where rays from the planned pose meet it."""
    ideal = np.ascontiguousarray(undistorted_px(camera, pixels), np.float64)
    found = np.empty(ideal.shape)
    carry_back(ideal, np.array(planned, np.float64, order="C"), _scale(camera), frame, found)
    return found


def _lines(flat: NDArray[np.float64]) -> NDArray[np.float64]:
    """Fit lines to points (n, m, 2) by squares of distances; return offset at x = 0 and slope (n, 2)."""
    middle = flat.mean(axis=1)
    off = flat - middle[:, None]
    spread = np.einsum("nmi,nmj->nij", off, off)
    # direction of the larger spread, which is that of x but for a small turn
    turn = 0.5 * np.arctan2(2 * spread[:, 0, 1], spread[:, 0, 0] - spread[:, 1, 1])
    slope = np.tan(turn)
    return np.stack([middle[:, 1] - slope * middle[:, 0], slope], axis=1)


def _circles(flat: NDArray[np.float64], radius: float) -> NDArray[np.float64]:
    """Fit circles to points (n, m, 2) by squares of distances; return centre and radius (n, 3)."""
    found = np.empty((len(flat), 3))
    fit_circles(np.ascontiguousarray(flat), float(radius), found)
    return found
