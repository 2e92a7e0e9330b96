"""What a plan promises, checked by doing it: displaced poses, pixels, measured lengths.

Nothing here uses the package `errors`: poses are displaced by exact rotations, points projected by the camera matrix,
and image coordinates rounded to whole pixels. Agreement with the predicted probability is therefore evidence.

The pixel grid lies at random. A stated probability is that of a part whose length is not known to a fraction of a
pixel, and no real part is exactly nominal. So every end is rounded on a grid shifted by up to half a pixel, in every
draw anew. On the sensor's one grid the nominal part has an image of definite phases: 50.2 px are 50 or 51 px and never
49. What is counted there holds for that length only, and may be false for an edge that is .1 px longer.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import beta

from planner.camera.camera import Camera
from planner.camera.imaging import image_of, undistorted_px
from planner.camera.pose import world_to_cam
from planner.camera.pose_uncertainty import PoseUncertainty
from planner.exceptions import RequestError
from planner.verify.measure_dimension import measured_errors
from planner.verify.simulated import Posed
from planner.wanted.pose_knowledge import PoseKnowledge

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

    successes: int
    n: int
    low: float
    high: float
    confidence: float
    outside: int
    predicted: float = float("nan")

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
        Name to `Entity`, to its two ends (2, 3) in mm, or to a `PlannedTarget`, for at least the setting's entities.
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
    if n < 1:
        raise RequestError.of_rule("n", "must be at least 1", repr(n))
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
            setting, (name, dimension), camera, pose_uncertainty, n, rng, sensor_limits
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
    named: tuple[str, Any],
    camera: Camera,
    pose_uncertainty: PoseUncertainty,
    n: int,
    rng: np.random.Generator,
    sensor_limits: bool,
) -> tuple[int, int]:
    """Measure a dimension from n displaced poses; return how often that is accurate, and how often not all in view."""
    name, dimension = named
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
    ends = np.array([_ends_of(one) for one in entities.values()], dtype=float)
    planned = np.asarray(setting.cam2world, dtype=float)
    successes = np.zeros(len(ends), dtype=int)
    outside = np.zeros(len(ends), dtype=int)
    values = _values_of(setting, rng)
    for start in range(0, n, _BATCH):
        poses = displaced_poses(planned, pose_uncertainty, min(_BATCH, n - start), rng)
        accurate, lost = _accurate_lengths(ends, planned, values.of(poses), camera, accuracy, rng)
        if values.registered:
            lost = ~_in_image(_project(ends, poses, camera), camera)
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
    target : PlannedTarget
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
        ends = np.asarray(_ends_of(target), dtype=float)[None]
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

    @property
    def registered(self) -> bool:
        """Whether there is a registration."""
        return self._known is not None

    def of(self, poses: np.ndarray) -> np.ndarray:
        """Return as many poses as are given; these without registration."""
        if self._known is None:
            return poses
        return displaced_poses(self._planned, self._known.pose_uncertainty, len(poses), self._rng)

    def by_surfaces(self, name: str) -> float | None:
        """Return the standard deviation of a value by surfaces, where it is known."""
        return None if self._known is None else self._known.by_surfaces.get(name)


def _values_of(setting: Posed, rng: np.random.Generator) -> ValuePoses:
    known = getattr(setting, "registered", None)
    # without registration nothing more is drawn
    seed = [] if known is None else rng.integers(2**31, size=2).tolist()
    return ValuePoses(np.asarray(setting.cam2world, dtype=float), known, seed)


def _ends_of(item: Any) -> Any:
    """Return both ends of an edge, an entity or a planned length; ends are their own."""
    return getattr(item, "ends", getattr(item, "endpoints", item))


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
    low = beta.ppf(tail, successes, n - successes + 1) if successes else 0.0
    high = beta.ppf(1 - tail, successes + 1, n - successes) if successes < n else 1.0
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
