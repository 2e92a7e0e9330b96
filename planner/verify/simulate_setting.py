"""Settings simulated: how often each target, and all of them together, are measured accurately."""

from __future__ import annotations

import math
import reprlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from scipy.special import betaincinv

from errors.measurands import Circle, End, Geometry, Localisation
from ground.convert import STATED
from ground.decorators import entry_kernel, kernel_without_refcounts
from planner.argument_kinds import check_count, suggests_names
from planner.camera.camera import Camera, image_of, undistorted_px
from planner.camera.pose import PoseUncertainty, world_to_cam
from planner.exceptions import RequestError
from planner.plan_file import Count, Draws, Fraction, Share
from planner.request.edge_state import EdgeState
from planner.request.registration import PoseKnowledge
from planner.request.targets import PlannedDimension, sample_points

# What a plan promises, checked by doing it: displaced poses, pixels, measured lengths.
#
# Nothing here uses the package `errors`: poses are displaced by exact rotations, points projected
# by the camera matrix, and image coordinates rounded to whole pixels. Agreement with the
# predicted probability is therefore evidence.
#
# The pixel grid lies at random. A stated probability is that of a part whose length is not known
# to a fraction of a pixel, and no real part is exactly nominal. So every end is rounded on a grid
# shifted by up to half a pixel, in every draw anew. On the sensor's one grid the nominal part has
# an image of definite phases: 50.2 px are 50 or 51 px and never 49. What is counted there holds
# for that length only, and may be false for an edge that is .1 px longer.


# Points to pixels of displaced cameras, and pixels back to planes, as compiled loops.


@entry_kernel(error_model="numpy")
def image_points(points: Any, poses: Any, scale: Any, found: Any) -> None:
    """Write the images of points, without distortion.

    Parameters
    ----------
    points : array (m, 3)
        In the part's frame, mm.
    poses : array (n, 4, 4)
        Cam2world.
    scale : array (4,)
        Focal lengths and principal point, px.
    found : array (n, m, 2)
        Gets the pixels; no numbers behind the camera.
    """
    for k in range(len(poses)):
        for j in range(len(points)):
            x = points[j, 0] - poses[k, 0, 3]
            y = points[j, 1] - poses[k, 1, 3]
            z = points[j, 2] - poses[k, 2, 3]
            depth = x * poses[k, 0, 2] + y * poses[k, 1, 2] + z * poses[k, 2, 2]
            if not depth > 0.0:
                found[k, j, 0] = np.nan
                found[k, j, 1] = np.nan
                continue
            across = x * poses[k, 0, 0] + y * poses[k, 1, 0] + z * poses[k, 2, 0]
            down = x * poses[k, 0, 1] + y * poses[k, 1, 1] + z * poses[k, 2, 1]
            found[k, j, 0] = across / depth * scale[0] + scale[2]
            found[k, j, 1] = down / depth * scale[1] + scale[3]


@entry_kernel(error_model="numpy")
def carry_back(pixels: Any, planned: Any, scale: Any, frame: Any, found: Any) -> None:
    """Write where rays of the planned pose meet a plane.

    Parameters
    ----------
    pixels : array (n, m, 2)
        Images without distortion.
    planned : array (4, 4)
        Cam2world.
    scale : array (4,)
        Focal lengths and principal point, px.
    frame : array (3, 3)
        Origin of the plane, and its axes.
    found : array (n, m, 2)
        Gets the coordinates in the plane, mm.
    """
    normal = np.empty(3)
    for i in range(3):
        j = (i + 1) % 3
        k = (i + 2) % 3
        normal[i] = frame[1, j] * frame[2, k] - frame[1, k] * frame[2, j]
    height = 0.0
    off = np.empty(3)
    for i in range(3):
        off[i] = planned[i, 3] - frame[0, i]
        height -= off[i] * normal[i]
    local = np.empty(3)
    for k in range(len(pixels)):
        for j in range(pixels.shape[1]):
            x = (pixels[k, j, 0] - scale[2]) / scale[0]
            y = (pixels[k, j, 1] - scale[3]) / scale[1]
            along = 0.0
            for i in range(3):
                local[i] = x * planned[i, 0] + y * planned[i, 1] + planned[i, 2]
                along += local[i] * normal[i]
            depth = height / along
            first = 0.0
            second = 0.0
            for i in range(3):
                place = off[i] + depth * local[i]
                first += place * frame[1, i]
                second += place * frame[2, i]
            found[k, j, 0] = first
            found[k, j, 1] = second


# Circles fitted to points by least squares of distances, many at once, as compiled loops.


_ROUNDS = 30
_STILL = 1e-10
# of the radius: nearer to the centre, a point has no direction from there
_CLOSE = 1e-9
_SMALL = 1e-12


@entry_kernel(error_model="numpy")
def fit_circles(flat: Any, radius: float, found: Any) -> None:
    """Fit circles to points (Gauss–Newton).

    Parameters
    ----------
    flat : array (n, m, 2)
        The points of each circle.
    radius : float
        About the radius of all circles.
    found : array (n, 3)
        Gets the centre and the radius; no numbers, where a point is none.
    """
    step = np.empty(3)
    for k in range(len(flat)):
        _start(flat[k], radius, step, found[k])
        for _ in range(_ROUNDS):
            _gauss_newton(flat[k], radius, found[k], step)
            largest = 0.0
            for i in range(3):
                found[k, i] += step[i]
                largest = max(largest, abs(step[i]))
            if not largest > _STILL * radius:
                break


@kernel_without_refcounts(error_model="numpy")
def _start(points: Any, radius: float, solved: Any, found: Any) -> None:
    """Write the algebraic fit to points (m, 2), which needs no start."""
    m = len(points)
    x = 0.0
    y = 0.0
    for j in range(m):
        x += points[j, 0] / m
        y += points[j, 1] / m
    xx = xy = yy = 0.0
    x1 = y1 = 0.0
    right_x = right_y = right_1 = 0.0
    for j in range(m):
        u = points[j, 0] - x
        v = points[j, 1] - y
        square = u * u + v * v
        xx += u * u
        xy += u * v
        yy += v * v
        x1 += u
        y1 += v
        right_x += u * square
        right_y += v * square
        right_1 += square
    normal = (4.0 * xx, 4.0 * xy, 2.0 * x1, 4.0 * yy, 2.0 * y1, float(m))
    _solve(normal, (2.0 * right_x, 2.0 * right_y, right_1), solved)
    square = solved[2] + solved[0] * solved[0] + solved[1] * solved[1]
    found[0] = x + solved[0]
    found[1] = y + solved[1]
    found[2] = np.sqrt(max(square, _SMALL * radius * radius))


@kernel_without_refcounts(error_model="numpy")
def _gauss_newton(points: Any, radius: float, found: Any, step: Any) -> None:
    """Write the step from a circle (3,) towards the one that fits points (m, 2)."""
    xx = xy = yy = 0.0
    x1 = y1 = 0.0
    right_x = right_y = right_1 = 0.0
    for j in range(len(points)):
        u = points[j, 0] - found[0]
        v = points[j, 1] - found[1]
        distance = max(np.sqrt(u * u + v * v), _CLOSE * radius)
        u /= distance
        v /= distance
        residual = distance - found[2]
        xx += u * u
        xy += u * v
        yy += v * v
        x1 += u
        y1 += v
        right_x += u * residual
        right_y += v * residual
        right_1 += residual
    normal = (xx, xy, x1, yy, y1, float(len(points)))
    _solve(normal, (right_x, right_y, right_1), step)


@kernel_without_refcounts(error_model="numpy")
def _solve(normal: Any, right: Any, solved: Any) -> None:
    """Solve three equations whose matrix is symmetric and positive: (xx, xy, x1, yy, y1, 11)."""
    xx, xy, x1, yy, y1, n_points = normal
    low = xy / xx
    lower = x1 / xx
    middle = yy - low * xy
    last = (y1 - low * x1) / middle
    corner = n_points - lower * x1 - last * (y1 - low * x1)
    second = right[1] - low * right[0]
    third = right[2] - lower * right[0] - last * second
    solved[2] = third / corner
    solved[1] = second / middle - last * solved[2]
    solved[0] = (right[0] - xy * solved[1] - x1 * solved[2]) / xx


# Dimensions measured as a program on the robot would: points found, carried back with the planned
# pose, fitted.
#
# It shares the definition of a dimension with the prediction (its planes and its value by what is
# fitted), and no computation: exact displaced poses, the camera's matrix, least squares by
# iteration. Every draw has its own faces off their place, and its own error across each edge that
# all points of it have in common.


# of an entity's size: how far ahead its direction in the image is taken
_AHEAD = 1e-5
# along which images of broken edges move
_AHEAD_MM = 1e-4


def measured_errors(
    dimension: PlannedDimension,
    planned: NDArray[np.float64],
    poses: NDArray[np.float64],
    camera: Camera,
    rng: np.random.Generator,
    off_mm: Sequence[NDArray[np.float64]] | None = None,
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
    off_mm : sequence of array (n, 3), optional
        Of each entity: how far its face is off its place. Default: drawn from ``surfaces_mm`` of the dimension.

    Returns
    -------
    error : array (n,) or (n, c)
        Measured value minus what is measured at the planned pose, mm (angles: degrees); nan without an image. Of one
        end of a value: its components, which add up over the ends.
    outside : array of bool (n,)
        Whether a point of the entities is outside the image.
    """
    value = dimension.measurand
    outside = np.zeros(len(poses), dtype=bool)
    fits = []
    if off_mm is None:
        real = _before_real_faces(dimension, poses, rng)
    else:
        real = [_moved(poses, off) for off in off_mm]
    for geometry, frame, seen_from in zip(dimension.geometry, value.frames, real, strict=True):
        points = _points(geometry, dimension, planned, camera)
        pixels = _pixels(points, seen_from, camera)
        if not dimension.edges.is_sharp:
            way = _away(geometry, frame.y, points, value.in_image)
            ahead = _pixels(points + _AHEAD_MM * way, seen_from, camera)
            off = _broken_mm(dimension.edges, len(points) if value.in_image else 1, len(poses), rng)
            pixels = pixels + (ahead - pixels) / _AHEAD_MM * off[..., None]
        outside |= ~_on_sensor(pixels, camera)
        errors = _localised(pixels, dimension.localisation, value.in_image, rng)
        if dimension.localisation.common_px > 0:
            ahead = _pixels(points + _forward(geometry, points), seen_from, camera) - pixels
            errors = errors + _common(ahead, dimension.localisation, value.in_image, rng)
        if value.in_image:
            pitch = np.array(camera.pixel_pitch_mm)
            nominal = undistorted_px(camera, _pixels(points, planned[None], camera)[0])
            return value.image_value(
                undistorted_px(camera, errors) * pitch, nominal * pitch
            ), outside
        flat = _carried_back(errors, planned, camera, np.array([frame.origin, frame.x, frame.y]))
        fits.append(
            _circles(flat, geometry.radius_mm) if isinstance(geometry, Circle) else _lines(flat)
        )
    if isinstance(value, End) and off_mm is not None:
        return value.components_of(fits), outside
    return value.value(fits), outside


def _broken_mm(
    edges: EdgeState, count: int, n: int, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Return how far steps of broken edges are off (n, count), mm, less what is corrected.

    The step is anywhere between the edge and a break away, for an edge as a whole.
    """
    breaks = rng.uniform(edges.low_mm, edges.high_mm, (n, count))
    corrected = 0.5 * (edges.low_mm + edges.high_mm) / 2 if edges.stated else 0.0
    return np.asarray(breaks * rng.uniform(0.0, 1.0, (n, count)) - corrected)


def _away(
    one: Geometry, across: NDArray[np.float64], points: NDArray[np.float64], each_end: bool
) -> NDArray[np.float64]:
    """Return unit vectors (m, 3) along which steps of an entity move; those of the ends of a length along it."""
    if isinstance(one, Circle):
        off = points - one.centre
        return np.asarray(off / np.linalg.norm(off, axis=1, keepdims=True))
    if each_end:
        return np.array([-one.direction, one.direction])
    return np.tile(across, (len(points), 1))


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
    localisation = dimension.localisation
    if localisation.model != "fit":
        return sample_points(one, localisation.points)
    outline = _pixels(sample_points(one, 200), planned[None], camera)[0]
    # of what is outside the field of a lens with distortion there is no image
    along = float(np.nansum(np.linalg.norm(np.diff(outline, axis=0), axis=1)))
    independent = max(3, round(along / localisation.correlation_px))
    if localisation.floor_px > 0:
        independent = min(
            independent, max(3, round((localisation.sigma_px / localisation.floor_px) ** 2))
        )
    return sample_points(one, independent)


def _pixels(
    points: NDArray[np.float64], poses: NDArray[np.float64], camera: Camera
) -> NDArray[np.float64]:
    """Return images (n, m, 2) in px of points (m, 3) from poses (n, 4, 4); nan behind the camera."""
    if camera.distortion is None:
        # copies, so that the loops are compiled for one kind of arrays
        pixels = np.empty((len(poses), len(points), 2))
        image_points(
            np.array(points, np.float64, order="C"),
            np.array(poses, np.float64, order="C"),
            _scale(camera),
            pixels,
        )
        return pixels
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
    carried = np.empty(ideal.shape)
    carry_back(ideal, np.array(planned, np.float64, order="C"), _scale(camera), frame, carried)
    return carried


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
    circles = np.empty((len(flat), 3))
    fit_circles(np.ascontiguousarray(flat), float(radius), circles)
    return circles


# What a simulation needs to know of a plan, and of a setting: rooms above this one have both.


class Posed(Protocol):
    """A pose and what is measured from it, such as a `SensorSetting`."""

    @property
    def cam2world(self) -> np.ndarray:
        """The pose, (4, 4)."""

    @property
    def entities(self) -> Sequence[str]:
        """Names of what is measured."""

    @property
    def probability(self) -> Mapping[str, float]:
        """Promised probability by name."""


class Planned(Protocol):
    """Settings and what they are for, such as an `InspectionPlan`."""

    @property
    def settings(self) -> Sequence[Posed]:
        """The settings, in order."""

    @property
    def targets(self) -> Mapping[str, Any]:
        """What is measured, by name, as `Target`."""

    @property
    def camera(self) -> Camera:
        """The camera."""

    @property
    def pose_uncertainty(self) -> PoseUncertainty:
        """How far the camera may be from where it should be."""

    @property
    def accuracy(self) -> float:
        """Accuracy asked of lengths."""

    @property
    def requirements(self) -> Mapping[str, float]:
        """Limits of the plan by name."""


_BATCH = 100_000
# of dimensions, which have more points
_FEWER = 10_000
# draws of registered poses, apart from the others
_REGISTERED = b"registered"
# The probability is of second order in the displacement: within 0.002 of exact rotations up to 0.03 rad, and within
# 0.004 up to 0.055 rad (`errors.success_probability`).
MODEL_TOLERANCE = 0.005

# what a simulation can say of a stated probability
CONFIRMED = "confirmed"
CONSERVATIVE = "conservative"
TOLERATED = "within the model's tolerance"
CONTRADICTED = "contradicted"
UNSTATED = "not stated"
VERDICTS = (CONFIRMED, CONSERVATIVE, TOLERATED, CONTRADICTED, UNSTATED)


@dataclass(frozen=True)
class SuccessRate:
    """How often a simulation measured an entity accurately.

    Attributes
    ----------
    successes, n : int
        Accurate measurements among n displaced poses.
    low, high : float
        Clopper–Pearson confidence interval of the probability of success.
    confidence : float
        Its confidence level.
    outside : int
        Number of poses with an end outside the image. They count as failures unless
        ``sensor_limits`` is False.
    predicted : float
        The probability that the setting states; nan if it states none.
    """

    successes: Count
    n: Draws
    low: Share
    high: Share
    confidence: Fraction
    outside: Count
    predicted: Annotated[Share, STATED] = float("nan")

    @property
    def frequency(self) -> float:
        """Fraction of accurate measurements."""
        return self.successes / self.n

    @property
    def confirms(self) -> bool:
        """Whether the predicted probability is inside the confidence interval."""
        return self.low <= self.predicted <= self.high

    @property
    def verdict(self) -> str:
        """Verdict of the simulation on the prediction, one of `VERDICTS`.

        "confirmed": the prediction is inside the interval. "conservative": it is below, so the
        measurement is better than stated. "within the model's tolerance": it is above by at most
        `MODEL_TOLERANCE`. "contradicted": it is above by more. "not stated": there is no
        prediction.
        """
        if math.isnan(self.predicted):
            return UNSTATED
        if self.confirms:
            return CONFIRMED
        if self.predicted < self.low:
            return CONSERVATIVE
        return TOLERATED if self.predicted <= self.high + MODEL_TOLERANCE else CONTRADICTED


@suggests_names
def simulate_setting(
    setting: Posed,
    entities: Mapping[str, Any],
    camera: Camera,
    pose_uncertainty: PoseUncertainty,
    *,
    accuracy: float = 0.98,
    n: int = 10_000,
    rng: int | np.random.Generator = 0,
    confidence: float = 0.99,
    sensor_limits: bool = True,
) -> dict[str, SuccessRate]:
    """Simulate one setting: measure its entities from n displaced poses.

    Parameters
    ----------
    setting : SensorSetting
        The planned pose, its entities and their predicted probabilities. With registration, also how well its pose is
        known when values are read.
    entities : mapping
        Name to `Entity`, to its two ends (2, 3) in mm, or to a `Target`, for at least the setting's entities.
    camera : Camera
        The camera.
    pose_uncertainty : PoseUncertainty
        Distribution of the displacements.
    accuracy : float
        Required accuracy A in (0, 1).
    n : int
        Displaced poses.
    rng : int or numpy.random.Generator
        Seed or source of chance.

    Returns
    -------
    dict of str to SuccessRate
        One per entity of the setting. An entity behind the displaced camera always counts as a
        failure.

    Other Parameters
    ----------------
    confidence : float
        Confidence level of the intervals, in (0, 1).
    sensor_limits : bool
        Whether a pose that pushes an end out of the image is a failure.

    Raises
    ------
    RequestError
        If an argument breaks its rule.

    Examples
    --------
    >>> from planner import read_plan, simulate_setting
    >>> plan = read_plan("examples/two_pocket_block_plan.json")
    >>> rates = simulate_setting(
    ...     plan.settings[0], plan.entities, plan.camera, plan.pose_uncertainty, accuracy=0.95, n=500
    ... )
    >>> {name: rate.verdict for name, rate in rates.items()}
    {'e1': 'confirmed', 'e4': 'confirmed'}
    """
    for name, value in (("accuracy", accuracy), ("confidence", confidence)):
        if not 0 < value < 1:
            raise RequestError.of_rule(name, "must be in (0, 1)", repr(value))
    check_count("n", n, 1)
    rng = np.random.default_rng(rng)
    dimensions = {
        name: entities[name]
        for name in setting.entities
        if not getattr(entities[name], "in_image", True)
    }
    edges = [name for name in setting.entities if name not in dimensions]
    counts = _edge_successes(
        setting,
        {name: entities[name] for name in edges},
        camera,
        pose_uncertainty,
        accuracy,
        n,
        rng,
        sensor_limits,
    )
    for name, dimension in dimensions.items():
        counts[name] = _dimension_successes(
            setting, name, dimension, camera, pose_uncertainty, n, rng, sensor_limits
        )
    return {
        name: SuccessRate(
            counts[name][0],
            n,
            *clopper_pearson(counts[name][0], n, confidence),
            confidence,
            counts[name][1],
            float(setting.probability.get(name, np.nan)),
        )
        for name in setting.entities
    }


def _dimension_successes(
    setting: Posed,
    name: str,
    dimension: Any,
    camera: Camera,
    pose_uncertainty: PoseUncertainty,
    n: int,
    rng: np.random.Generator,
    sensor_limits: bool,
) -> tuple[int, int]:
    """Measure a dimension from n displaced poses; return how often that is accurate, and how often not all in view."""
    hits = lost = 0
    planned = np.asarray(setting.cam2world, dtype=float)
    values = _values_of(setting, rng)
    for start in range(0, n, _FEWER):
        poses = displaced_poses(planned, pose_uncertainty, min(_FEWER, n - start), rng)
        error, outside = value_errors(
            dimension, planned, values.of(poses), camera, rng, values.by_surfaces(name)
        )
        if values.registered:
            _, outside = measured_errors(dimension, planned, poses, camera, rng)
        accurate = np.abs(error) <= dimension.permitted_error
        hits += int((accurate & ~outside if sensor_limits else accurate).sum())
        lost += int(outside.sum())
    return hits, lost


def _edge_successes(
    setting: Posed,
    entities: Mapping[str, Any],
    camera: Camera,
    pose_uncertainty: PoseUncertainty,
    accuracy: float,
    n: int,
    rng: np.random.Generator,
    sensor_limits: bool,
) -> dict[str, Any]:
    """The same for lengths of edges, all from the same poses."""
    if not entities:
        return {}
    ends = np.array([_ends_of(name, entity) for name, entity in entities.items()])
    planned = np.asarray(setting.cam2world, dtype=float)
    successes = np.zeros(len(ends), dtype=int)
    outside = np.zeros(len(ends), dtype=int)
    values = _values_of(setting, rng)
    for start in range(0, n, _BATCH):
        poses = displaced_poses(planned, pose_uncertainty, min(_BATCH, n - start), rng)
        found_from = values.of(poses)
        if values.registered:
            each = [
                _accurate_lengths(
                    ends[k : k + 1],
                    planned,
                    values.for_target(name, found_from),
                    camera,
                    accuracy,
                    rng,
                )[0]
                for k, name in enumerate(entities)
            ]
            accurate = np.concatenate(each, axis=1)
            lost = ~_in_image(_project(ends, poses, camera), camera)
        else:
            accurate, lost = _accurate_lengths(ends, planned, found_from, camera, accuracy, rng)
        successes += (accurate & ~lost if sensor_limits else accurate).sum(axis=0)
        outside += lost.sum(axis=0)
    return {
        name: (int(hits), int(lost))
        for name, hits, lost in zip(entities, successes, outside, strict=True)
    }


def _accurate_lengths(
    ends: np.ndarray,
    planned: np.ndarray,
    poses: np.ndarray,
    camera: Camera,
    accuracy: float,
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray]:
    """Measure the lengths of edges (k, 2, 3); return which are accurate, and which have an end outside; (n, k)."""
    nominal = _image_lengths(_project(ends, planned[None], camera), camera)[0]
    pixels = _project(ends, poses, camera)
    phase = rng.uniform(-0.5, 0.5, pixels.shape)
    error = _image_lengths(np.rint(pixels + phase) - phase, camera) - nominal
    return np.abs(error) <= (1 - accuracy) * nominal, ~_in_image(pixels, camera)


def accurate_in(
    target: Any,
    planned: np.ndarray,
    poses: np.ndarray,
    camera: Camera,
    accuracy: float,
    rng: np.random.Generator,
    by_surfaces: float | None = None,
) -> np.ndarray:
    """Measure a target from displaced poses.

    Parameters
    ----------
    target : Target
        What is measured.
    planned : array (4, 4)
        The pose it is measured with.
    poses : array (n, 4, 4)
        Where the camera is.
    camera : Camera
        The camera.
    accuracy : float
        Required accuracy of lengths.
    rng : numpy.random.Generator
        For errors of localisation, and for the phases of the pixel grid.
    by_surfaces : float, optional
        Standard deviation of its value by surfaces, where it is known.

    Returns
    -------
    array of bool (n,)
        Whether the error is at most the permitted one; false without an image.
    """
    if target.in_image:
        ends = _ends_of(target.name, target)[None]
        return _accurate_lengths(ends, planned, poses, camera, accuracy, rng)[0][:, 0]
    error, _ = value_errors(target, planned, poses, camera, rng, by_surfaces)
    return np.asarray(np.abs(error) <= target.permitted_error)


def value_errors(
    dimension: Any,
    planned: np.ndarray,
    poses: np.ndarray,
    camera: Camera,
    rng: np.random.Generator,
    by_surfaces: float | None,
) -> tuple[np.ndarray, np.ndarray]:
    """Return what `measured_errors` returns; with errors by surfaces as they are known, instead of faces off place."""
    if by_surfaces is None:
        return measured_errors(dimension, planned, poses, camera, rng)
    exact = replace(dimension, surfaces_mm=0.0)
    error, outside = measured_errors(exact, planned, poses, camera, rng)
    return error + rng.normal(0.0, by_surfaces, len(error)), outside


class ValuePoses:
    """Where the camera is, as far as values are concerned: off the planned pose by what registration leaves unknown.

    Values are read with the pose that registration finds. Their errors are those of values that are read with the
    planned pose while the camera is off by the error of registration.

    Parameters
    ----------
    planned : array (4, 4)
        The planned pose.
    known : PoseKnowledge or None
        What is known after registration; None without it.
    seed : list of int
        Of the draws.
    """

    def __init__(self, planned: np.ndarray, known: PoseKnowledge | None, seed: Sequence[int]):
        self._planned = planned
        self._known = known
        self._rng = np.random.default_rng([*seed, *_REGISTERED])
        self._before = self._rng.bit_generator.state

    @property
    def registered(self) -> bool:
        """Whether there is a registration."""
        return self._known is not None

    def of(self, poses: np.ndarray) -> np.ndarray:
        """Return as many poses as are given; these without registration."""
        if self._known is None:
            return poses
        self._before = self._rng.bit_generator.state
        return displaced_poses(self._planned, self._known.pose_uncertainty, len(poses), self._rng)

    def for_target(self, name: str, drawn: np.ndarray) -> np.ndarray:
        """Return the poses that were drawn last (n, 4, 4) as a target knows them: the same draws, scaled."""
        if self._known is None or name not in self._known.by_edge:
            return drawn
        again = np.random.default_rng()
        again.bit_generator.state = self._before
        uncertainty = PoseUncertainty(self._known.by_edge[name])
        return displaced_poses(self._planned, uncertainty, len(drawn), again)

    def by_surfaces(self, name: str) -> float | None:
        """Return the standard deviation of a value by surfaces, where it is known."""
        return None if self._known is None else self._known.by_surfaces.get(name)


def _values_of(setting: Posed, rng: np.random.Generator) -> ValuePoses:
    registered = getattr(setting, "registered", None)
    # without registration nothing more is drawn
    seed = [] if registered is None else rng.integers(2**31, size=2).tolist()
    return ValuePoses(np.asarray(setting.cam2world, dtype=float), registered, seed)


def _ends_of(name: str, item: Any) -> np.ndarray:
    """Return both ends (2, 3) of an edge, an entity or a planned length; ends are their own."""
    pair = getattr(item, "ends", getattr(item, "endpoints", item))
    try:
        ends = np.asarray(pair, dtype=float)
    except (OverflowError, TypeError, ValueError):
        ends = np.empty(0)
    if ends.shape != (2, 3):
        rule = "must be entities, or two ends of the shape (2, 3)"
        text = " ".join(reprlib.repr(pair).split())
        raise RequestError.of_rule("entities", rule, f"{text} for {name!r}")
    return ends


def displaced_poses(
    cam2world: np.ndarray, pose_uncertainty: PoseUncertainty, n: int, rng: np.random.Generator
) -> np.ndarray:
    """Return n poses (n, 4, 4) drawn around a planned pose (4, 4); rotations are exact, not linearised."""
    moves = rng.multivariate_normal(np.zeros(6), pose_uncertainty.covariance, size=n, method="eigh")
    displacement = np.tile(np.eye(4), (n, 1, 1))
    displacement[:, :3, 3] = moves[:, :3]
    displacement[:, :3, :3] = Rotation.from_rotvec(moves[:, 3:]).as_matrix()
    return np.asarray(cam2world, dtype=float) @ displacement


def clopper_pearson(successes: int, n: int, confidence: float) -> tuple[float, float]:
    """Return the exact confidence interval of a probability after so many successes in n trials."""
    tail = (1 - confidence) / 2
    low = betaincinv(successes, n - successes + 1, tail) if successes else 0.0
    high = betaincinv(successes + 1, n - successes, 1 - tail) if successes < n else 1.0
    return float(low), float(high)


def _project(ends: np.ndarray, poses: np.ndarray, camera: Camera) -> np.ndarray:
    """Return the images (n, k, 2, 2) in px of ends (k, 2, 3); nan behind the camera."""
    local = world_to_cam(ends, poses)
    depth = np.where(local[..., 2:] > 0, local[..., 2:], np.nan)
    return image_of(camera, local / depth)


def _image_lengths(pixels: np.ndarray, camera: Camera) -> np.ndarray:
    """Return the lengths (n, k) in mm on the sensor, without distortion, between image ends (n, k, 2, 2) in px."""
    ideal = undistorted_px(camera, pixels)
    difference = (ideal[..., 1, :] - ideal[..., 0, :]) * camera.pixel_pitch_mm
    return np.hypot(difference[..., 0], difference[..., 1])


def _in_image(pixels: np.ndarray, camera: Camera) -> np.ndarray:
    """Return whether both ends fall on a pixel; (n, k) bool."""
    on_sensor = (pixels >= -0.5) & (pixels <= np.array(camera.resolution) - 0.5)
    return np.asarray(on_sensor.all(axis=(-1, -2)))
