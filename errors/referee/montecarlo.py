"""The referee: exact displaced poses, drawn at random, against which the other models are judged.

Every draw turns the edge by an exact rotation (rotation vector phi, Rodrigues' formula), shifts it by d, projects both
ends (eqs 4-5), quantizes them to pixels and compares the length of what is left with the nominal image length.

All edges of a batch share the same draws: their probabilities can be compared with less noise than their confidence
intervals suggest, and the draws are made once.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import betaincinv

from errors.checks import (
    check_count,
    check_covariance,
    check_endpoints,
    check_leading_shapes,
    check_pixel_pitch,
    check_positive,
    check_probability,
    covariance_root,
)
from errors.exceptions import InvalidParameterError
from errors.formatting import frequency_text, interval_text
from ground.loop_cache import njit

# Draws held in memory at a time.
_CHUNK = 1 << 16
QUANTIZATIONS = ("uniform", "grid", "none")


@dataclass(frozen=True, repr=False)
class MonteCarloEstimate:
    """Success frequencies with exact (Clopper-Pearson) confidence intervals.

    Attributes
    ----------
    probability, lower, upper : array, shape (...)
        Success frequency and the ends of its confidence interval.
    samples : int
        Number of displaced poses drawn.
    confidence : float
        Coverage of the interval.
    """

    probability: NDArray[np.float64]
    lower: NDArray[np.float64]
    upper: NDArray[np.float64]
    samples: int
    confidence: float

    def __repr__(self) -> str:
        """Return a one-line summary."""
        shape = np.shape(self.probability)
        found = f"shape {shape}"
        if not shape:
            drawn = frequency_text(round(float(self.probability) * self.samples), self.samples)
            found = f"{drawn}, in {interval_text(float(self.lower), float(self.upper))}"
        return (
            f"<MonteCarloEstimate: {found}, confidence {self.confidence:g}, {self.samples} samples>"
        )


def simulate_success(
    endpoints: ArrayLike,
    *,
    focal_length_mm: float,
    pixel_pitch_mm: ArrayLike,
    pose_covariance: ArrayLike,
    accuracy: float,
    samples: int = 100_000,
    rng: int | np.random.Generator = 0,
    confidence: float = 0.95,
    quantization: str = "uniform",
) -> MonteCarloEstimate:
    """Estimate P(|L' - L| <= (1 - A) L) by drawing displaced poses.

    Parameters
    ----------
    endpoints : array-like, shape (..., 2, 3)
        Edge ends in the paper's camera frame, in mm.
    focal_length_mm : float
        Distance from the image plane to the lens centre, in mm.
    pixel_pitch_mm : array-like, shape (2,)
        Pixel pitch (r_x, r_y) in mm.
    pose_covariance : array-like, shape (6, 6) or (..., 6, 6)
        Covariance of (dx, dy, dz, phi_x, phi_y, phi_z) in mm and rad; see `success_probability`.
    accuracy : float
        A in (0, 1): the length may be off by the fraction 1 - A of it.
    samples : int
        Number of displaced poses.
    rng : int or numpy.random.Generator
        Seed or generator; the same seed gives the same numbers.

    Returns
    -------
    MonteCarloEstimate
        Success frequency per edge and its interval. A pose that puts an end point behind the lens is a failure.

    Other Parameters
    ----------------
    confidence : float
        Coverage of the confidence interval, in (0, 1).
    quantization : {"uniform", "grid", "none"}
        "uniform" rounds every coordinate on a grid of its own random phase, which is the paper's model (errors uniform
        in +-r/2 and independent); "grid" rounds to the fixed grid through the image's origin, so that a length can
        only take the values the grid has; "none" leaves the projected points as they are.

    Raises
    ------
    InvalidParameterError
        As `success_probability`, and for samples, confidence or quantization outside their range.

    Examples
    --------
    >>> import numpy as np
    >>> from errors import simulate_success
    >>> estimate = simulate_success(
    ...     [[-20, 0, -90], [20, 0, -90]],
    ...     focal_length_mm=10.0,
    ...     pixel_pitch_mm=(0.005, 0.005),
    ...     pose_covariance=np.diag([0.01, 0.01, 0.01, 1e-6, 1e-6, 1e-6]),
    ...     accuracy=0.98,
    ...     samples=1000,
    ... )
    >>> bool(estimate.probability > 0.99)
    True
    """
    f = check_positive(focal_length_mm, "focal_length_mm")
    endpoints = check_endpoints(endpoints, f)
    pitch = check_pixel_pitch(pixel_pitch_mm)
    covariance = check_covariance(pose_covariance)
    accuracy = check_probability(accuracy, "accuracy")
    samples = check_count(samples, "samples")
    confidence = check_probability(confidence, "confidence")
    if quantization not in QUANTIZATIONS:
        raise InvalidParameterError(
            f"quantization must be one of {QUANTIZATIONS}. Got {quantization!r}."
        )
    lead = check_leading_shapes(endpoints, covariance)
    root = covariance_root(covariance)
    flat_ends = np.ascontiguousarray(np.broadcast_to(endpoints, (*lead, 2, 3))).reshape(-1, 2, 3)
    flat_root = (
        root[None] if root.ndim == 2 else np.broadcast_to(root, (*lead, 6, 6)).reshape(-1, 6, 6)
    )
    hits = _count(
        flat_ends,
        f,
        pitch,
        flat_root,
        1.0 - accuracy,
        samples,
        np.random.default_rng(rng),
        quantization,
    )
    lower, upper = binomial_interval(hits, samples, confidence)
    probability, lower, upper = (array.reshape(lead) for array in (hits / samples, lower, upper))
    return MonteCarloEstimate(probability, lower, upper, samples=samples, confidence=confidence)


def binomial_interval(
    hits: ArrayLike, samples: int, confidence: float = 0.95
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the Clopper-Pearson interval of a success probability.

    Parameters
    ----------
    hits : array-like
        Numbers of successes, any shape, each in [0, samples].
    samples : int
        Number of trials, at least 1.
    confidence : float
        Coverage of the interval, in (0, 1).

    Returns
    -------
    lower : array
        Lower ends, in the shape of `hits`; 0 without successes.
    upper : array
        Upper ends; 1 without failures.

    References
    ----------
    C. J. Clopper and E. S. Pearson, "The use of confidence or fiducial limits illustrated in the case of the binomial",
    Biometrika 26, 1934.

    Examples
    --------
    >>> from errors import binomial_interval
    >>> low, high = binomial_interval(50, 100)
    >>> round(float(low), 3), round(float(high), 3)
    (0.398, 0.602)
    """
    hits = np.asarray(hits, dtype=np.float64)
    tail = 0.5 * (1.0 - confidence)
    lower = np.where(hits > 0, betaincinv(np.maximum(hits, 1), samples - hits + 1, tail), 0.0)
    upper = np.where(
        hits < samples, betaincinv(hits + 1, np.maximum(samples - hits, 1), 1.0 - tail), 1.0
    )
    return lower, upper


def _count(ends, f, pitch, root, tolerance, samples, rng, quantization):
    hits = np.zeros(len(ends), dtype=np.int64)
    for start in range(0, samples, _CHUNK):
        n = min(_CHUNK, samples - start)
        normal = rng.standard_normal((n, 6))
        uniform = (
            rng.uniform(-0.5, 0.5, (n, 2, 2)) if quantization == "uniform" else np.zeros((1, 2, 2))
        )
        _count_chunk(ends, f, pitch, root, tolerance, normal, uniform, quantization == "grid", hits)
    return hits


@njit(error_model="numpy")
def _count_chunk(ends, f, pitch, root, tolerance, normal, uniform, grid, hits):
    delta = np.empty(6)
    before = np.empty((2, 2))
    after = np.empty((2, 2))
    for i in range(len(ends)):
        s = root[0] if len(root) == 1 else root[i]
        delta[:] = 0.0
        length = _image_length(ends[i], f, delta, before)
        for k in range(len(normal)):
            for a in range(6):
                delta[a] = 0.0
                for j in range(6):
                    delta[a] += s[a, j] * normal[k, j]
            if _image_length(ends[i], f, delta, after) < 0.0:
                continue
            for p in range(2):
                for a in range(2):
                    if grid:
                        after[p, a] = math.floor(after[p, a] / pitch[a] + 0.5) * pitch[a]
                    else:
                        after[p, a] += uniform[k % len(uniform), p, a] * pitch[a]
            measured = math.hypot(after[1, 0] - after[0, 0], after[1, 1] - after[0, 1])
            if abs(measured - length) <= tolerance * length:
                hits[i] += 1


@njit(error_model="numpy")
def _image_length(ends, f, delta, image):
    """Write the image of both ends after the displacement; return their distance, or -1 when one is behind the lens."""
    x = delta[3]
    y = delta[4]
    z = delta[5]
    angle2 = x * x + y * y + z * z
    if angle2 > 1e-12:
        angle = math.sqrt(angle2)
        first = math.sin(angle) / angle
        second = (1.0 - math.cos(angle)) / angle2
    else:
        first = 1.0
        second = 0.5
    for p in range(2):
        c1, c2, c3 = ends[p]
        t1 = y * c3 - z * c2
        t2 = z * c1 - x * c3
        t3 = x * c2 - y * c1
        depth = f - (c3 + first * t3 + second * (x * t2 - y * t1) + delta[2])
        if depth <= 0.0:
            return -1.0
        image[p, 0] = f * (c1 + first * t1 + second * (y * t3 - z * t2) + delta[0]) / depth
        image[p, 1] = f * (c2 + first * t2 + second * (z * t1 - x * t3) + delta[1]) / depth
    return math.hypot(image[1, 0] - image[0, 0], image[1, 1] - image[0, 1])
