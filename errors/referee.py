"""Referees of the laws: Monte Carlo with exact rotations, and measurement in simulated pixels.

Nothing here uses the densities it judges.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import betaincinv

from errors.checks import (
    FloatArray,
    check_count,
    check_covariance,
    check_endpoints,
    check_finite,
    check_leading_shapes,
    check_pixel_pitch,
    check_positive,
    check_probability,
    covariance_root,
    frequency_text,
    interval_text,
)
from errors.displacement import displace, image_segment, project
from errors.exceptions import InvalidParameterError, InvalidShapeError
from ground.decorators import njit

# The referee: exact displaced poses, drawn at random, against which the other models are judged.
#
# Every draw turns the edge by an exact rotation (rotation vector phi, Rodrigues' formula), shifts
# it by d, projects both ends (eqs 4-5), quantizes them to pixels and compares the length of what
# is left with the nominal image length.
#
# All edges of a batch share the same draws: their probabilities can be compared with less noise
# than their confidence intervals suggest, and the draws are made once.


# Draws held in memory at a time.
_CHUNK = 1 << 16
Quantization = Literal["uniform", "grid", "none"]
QUANTIZATIONS = get_args(Quantization)


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
        estimate = f"shape {shape}"
        if not shape:
            drawn = frequency_text(round(float(self.probability) * self.samples), self.samples)
            estimate = f"{drawn}, in {interval_text(float(self.lower), float(self.upper))}"
        return f"<MonteCarloEstimate: {estimate}, confidence {self.confidence:g}, {self.samples} samples>"


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
    quantization: Quantization = "uniform",
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

    Raises
    ------
    InvalidParameterError
        If a number of successes is not in [0, samples], or another argument breaks its rule.

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
    samples = check_count(samples, "samples")
    confidence = check_probability(confidence, "confidence")
    hits = check_finite(hits, "hits")
    wrong = hits[(hits < 0) | (hits > samples) | (hits % 1 != 0)]
    if wrong.size:
        rule = f"must be integers from 0 to samples, {samples}"
        raise InvalidParameterError.of_rule("hits", rule, f"{wrong[0]:g}")
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


# A straight edge on the pixel grid: its image, the pixels that belong to it, and the length read
# off them.
#
# The paper's rule: a pixel belongs to the edge when more than half of it is covered. Two ways to
# apply it:
#
# * "axes": per image axis, as in the paper's one-dimensional figure. A column belongs when more than half of its width
#   lies between the two ends, a row likewise; the extents are whole columns and rows.
# * "area": as a detector meets it. The edge is a band a few pixels wide, a pixel's value is the exact covered area; of
#   the pixels above one half the thin chain is kept, one per column (per row for steep edges), and each end of the
#   chain is taken to lie half a column beyond the centre of its last pixel.
#
# Pixel (i, j) covers [i r_x, (i + 1) r_x] x [j r_y, (j + 1) r_y]: the optical axis meets a corner
# of four pixels.


Detector = Literal["axes", "area"]
DETECTORS = get_args(Detector)

# Columns looked at on each side of an end; the chain's last pixel is within two of it.
_SEARCH = 4


def measure_lengths(
    segments: ArrayLike,
    *,
    pixel_pitch_mm: ArrayLike,
    detector: Detector = "axes",
    band_px: float = 3.0,
) -> NDArray[np.float64]:
    """Return the lengths a detector reads off the pixel images of straight segments.

    Parameters
    ----------
    segments : array-like, shape (..., 2, 2)
        Image end points (u, v) in mm.
    pixel_pitch_mm : array-like, shape (2,)
        Pixel pitch (r_x, r_y) in mm.
    detector : {"axes", "area"}
        See the module's description.
    band_px : float
        Width of the edge's image in the larger pitch, for "area".

    Returns
    -------
    array, shape (...)
        Lengths in mm; NaN where no pixel of a segment is above one half.

    Raises
    ------
    InvalidParameterError
        If a value is not finite or out of range, or the detector is unknown.

    Examples
    --------
    >>> from errors import measure_lengths
    >>> segment = [[0.003, 0.003], [0.103, 0.003]]
    >>> round(float(measure_lengths(segment, pixel_pitch_mm=(0.005, 0.005))), 6)
    0.1
    """
    segments = check_finite(segments, "segments")
    pitch = check_pixel_pitch(pixel_pitch_mm)
    band = check_positive(band_px, "band_px") * pitch.max()
    if segments.ndim < 2 or segments.shape[-2:] != (2, 2):
        raise InvalidShapeError(
            f"segments must have shape (..., 2, 2). Got shape {segments.shape}."
        )
    if detector not in DETECTORS:
        raise InvalidParameterError(f"detector must be one of {DETECTORS}. Got {detector!r}.")
    if detector == "axes":
        extents = _whole_pixels(segments / pitch) * pitch
        return np.hypot(extents[..., 0], extents[..., 1])
    flat = np.ascontiguousarray(segments).reshape(-1, 2, 2)
    out = np.empty(len(flat))
    _measure_chains(flat, pitch, band, out)
    return out.reshape(segments.shape[:-2])


def coverage_image(
    segment: ArrayLike, *, pixel_pitch_mm: ArrayLike, band_px: float = 3.0, margin_px: int = 3
) -> tuple[NDArray[np.float64], tuple[int, int]]:
    """Return the image of a segment: the covered fraction of every pixel, exact.

    Parameters
    ----------
    segment : array-like, shape (2, 2)
        Image end points (u, v) in mm.
    pixel_pitch_mm : array-like, shape (2,)
        Pixel pitch (r_x, r_y) in mm.
    band_px : float
        Width of the band in the larger pitch.
    margin_px : int
        Pixels around the segment's bounding box.

    Returns
    -------
    image : array, shape (rows, columns)
        Covered fractions in [0, 1]; the row index grows with v.
    origin : tuple of int
        Indices (i, j) of the pixel in column 0, row 0.

    Raises
    ------
    InvalidParameterError
        If a value is not finite, or a pitch is not positive.

    Examples
    --------
    >>> from errors import coverage_image
    >>> band = [[0.0, 0.005], [0.1, 0.005]]
    >>> image, origin = coverage_image(band, pixel_pitch_mm=(0.005, 0.005), band_px=2.0, margin_px=1)
    >>> image.shape, origin, [round(float(x), 3) for x in image[:, 10]]
    ((3, 23), (-1, 0), [1.0, 1.0, 0.0])
    """
    segment = check_finite(segment, "segment")
    pitch = check_pixel_pitch(pixel_pitch_mm)
    low = np.floor(segment.min(axis=0) / pitch).astype(int) - margin_px
    high = np.ceil(segment.max(axis=0) / pitch).astype(int) + margin_px
    image = np.empty((high[1] - low[1] + 1, high[0] - low[0] + 1))
    _render(np.ascontiguousarray(segment), pitch, band_px * pitch.max(), low[0], low[1], image)
    return image, (int(low[0]), int(low[1]))


def _whole_pixels(ends: FloatArray) -> FloatArray:
    """Count, per axis, the pixels more than half of which lies between the two ends; ends (..., 2, 2) in pixels."""
    low = ends.min(axis=-2)
    high = ends.max(axis=-2)
    # More than half covered means that the pixel's centre lies between the ends, unless both are within half a pixel.
    centres = np.ceil(high - 0.5) - np.floor(low - 0.5) - 1.0
    return np.where(high - low > 0.5, centres, 0.0)


@njit(error_model="numpy")
def _render(segment, pitch, band, first_i, first_j, image):
    corners = _band_corners(segment, band)
    scratch = np.empty((2, 12, 2))
    for j in range(image.shape[0]):
        for i in range(image.shape[1]):
            image[j, i] = _coverage(
                corners,
                (first_i + i + 0.5) * pitch[0],
                (first_j + j + 0.5) * pitch[1],
                pitch,
                scratch,
            )


@njit(error_model="numpy")
def _band_corners(segment, band):
    """Return the four corners of the band, counter-clockwise."""
    du = segment[1, 0] - segment[0, 0]
    dv = segment[1, 1] - segment[0, 1]
    scale = 0.5 * band / math.hypot(du, dv)
    nu = -dv * scale
    nv = du * scale
    corners = np.empty((4, 2))
    corners[0, 0] = segment[0, 0] - nu
    corners[0, 1] = segment[0, 1] - nv
    corners[1, 0] = segment[1, 0] - nu
    corners[1, 1] = segment[1, 1] - nv
    corners[2, 0] = segment[1, 0] + nu
    corners[2, 1] = segment[1, 1] + nv
    corners[3, 0] = segment[0, 0] + nu
    corners[3, 1] = segment[0, 1] + nv
    return corners


@njit(error_model="numpy")
def _coverage(corners, u, v, pitch, scratch):
    """Return the fraction of the pixel centred at (u, v) inside a convex counter-clockwise quadrangle, by clipping."""
    polygon = scratch[0]
    clipped = scratch[1]
    n = 4
    for k in range(4):
        polygon[k, 0] = u + pitch[0] * (0.5 if k in (1, 2) else -0.5)
        polygon[k, 1] = v + pitch[1] * (0.5 if k >= 2 else -0.5)
    for k in range(4):
        a = corners[k]
        b = corners[(k + 1) % 4]
        m = 0
        for i in range(n):
            p = polygon[i]
            q = polygon[(i + 1) % n]
            # twice a signed area: positive inside, left of the side from a to b
            sp = (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])
            sq = (b[0] - a[0]) * (q[1] - a[1]) - (b[1] - a[1]) * (q[0] - a[0])
            if sp >= 0.0:
                clipped[m, 0] = p[0]
                clipped[m, 1] = p[1]
                m += 1
            if (sp > 0.0 and sq < 0.0) or (sp < 0.0 and sq > 0.0):
                w = sp / (sp - sq)
                clipped[m, 0] = p[0] + w * (q[0] - p[0])
                clipped[m, 1] = p[1] + w * (q[1] - p[1])
                m += 1
        polygon, clipped, n = clipped, polygon, m
    area = 0.0
    for i in range(n):
        p = polygon[i]
        q = polygon[(i + 1) % n]
        # triangles about the centre of the pixel
        area += 0.5 * ((p[0] - u) * (q[1] - v) - (p[1] - v) * (q[0] - u))
    return area / (pitch[0] * pitch[1])


@njit(error_model="numpy")
def _measure_chains(segments, pitch, band, out):
    last = np.empty((2, 2))
    scratch = np.empty((2, 12, 2))
    for n in range(len(segments)):
        segment = segments[n]
        du = segment[1, 0] - segment[0, 0]
        dv = segment[1, 1] - segment[0, 1]
        major = 0 if abs(du) * pitch[1] >= abs(dv) * pitch[0] else 1
        corners = _band_corners(segment, band)
        is_complete = True
        for end in range(2):
            is_complete = (
                _last_pixel(segment, corners, pitch, major, end, scratch, last[end]) and is_complete
            )
        if not is_complete:
            out[n] = np.nan
            continue
        cu = last[1, 0] - last[0, 0]
        cv = last[1, 1] - last[0, 1]
        # Half a column beyond each end pixel's centre, along the chain.
        extent = abs(cu) if major == 0 else abs(cv)
        length = math.hypot(cu, cv)
        out[n] = length * (1.0 + pitch[major] / extent) if extent > 0.0 else pitch[major]


@njit(error_model="numpy")
def _last_pixel(segment, corners, pitch, major, end, scratch, centre):
    """Write the centre of the chain's last pixel at one end; False when no pixel near it belongs to the edge."""
    minor = 1 - major
    here = segment[end]
    other = segment[1 - end]
    outward = 1 if here[major] > other[major] else -1
    slope = (other[minor] - here[minor]) / (other[major] - here[major])
    start = math.floor(here[major] / pitch[major])
    for step in range(_SEARCH, -_SEARCH - 1, -1):
        centre[major] = (start + outward * step + 0.5) * pitch[major]
        on_line = here[minor] + slope * (centre[major] - here[major])
        centre[minor] = (math.floor(on_line / pitch[minor]) + 0.5) * pitch[minor]
        if _coverage(corners, centre[0], centre[1], pitch, scratch) > 0.5:
            return True
    return False


# Digital twin of a measurement: displaced pose, synthetic image, detected ends, length.
#
# Is the predicted probability true? `success_probability` models what a pixel grid does to a
# length by four independent uniform errors (eq 3). The twin does not: it draws a displaced pose,
# makes the pixel image of the edge on the one fixed grid of the sensor, finds the edge's ends in
# it by the paper's rule and compares the length with the nominal one. Where both agree the model
# holds.


_PARTS_AT_ONCE = 1 << 14


def simulate_measurement(
    endpoints: ArrayLike,
    *,
    focal_length_mm: float,
    pixel_pitch_mm: ArrayLike,
    pose_covariance: ArrayLike,
    accuracy: float,
    samples: int = 10_000,
    rng: int | np.random.Generator = 0,
    confidence: float = 0.95,
    detector: Detector = "axes",
    band_px: float = 3.0,
) -> MonteCarloEstimate:
    """Measure one edge in synthetic images from displaced poses and return how often the length is accurate.

    Parameters
    ----------
    endpoints : array-like, shape (2, 3)
        Edge ends in the paper's camera frame, in mm.
    focal_length_mm : float
        Distance from the image plane to the lens centre, in mm.
    pixel_pitch_mm : array-like, shape (2,)
        Pixel pitch (r_x, r_y) in mm.
    pose_covariance : array-like, shape (6, 6)
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
        Success frequency (a scalar) and its interval. An edge that is not found, or a pose that puts an end behind the
        lens, is a failure.

    Other Parameters
    ----------------
    confidence : float
        Coverage of the confidence interval, in (0, 1).
    detector : {"axes", "area"}
        How ends are found in the image; see `errors.referee`.
    band_px : float
        Width of the edge's image in the larger pitch, for "area".

    Raises
    ------
    InvalidShapeError
        If there is more than one edge or one covariance.
    InvalidParameterError
        As `success_probability` and `measure_lengths`.

    Examples
    --------
    >>> import numpy as np
    >>> from errors import simulate_measurement
    >>> covariance = np.diag([0.05] * 3 + [0.001] * 3) ** 2
    >>> edge = [[-20.0, 0.0, -500.0], [20.0, 0.0, -500.0]]
    >>> estimate = simulate_measurement(
    ...     edge,
    ...     focal_length_mm=25.0,
    ...     pixel_pitch_mm=(0.005, 0.005),
    ...     pose_covariance=covariance,
    ...     accuracy=0.98,
    ...     samples=1000,
    ... )
    >>> estimate
    <MonteCarloEstimate: 1000 of 1000, in 0.9963 or more, confidence 0.95, 1000 samples>
    """
    f = check_positive(focal_length_mm, "focal_length_mm")
    endpoints = check_endpoints(endpoints, f)
    covariance = check_covariance(pose_covariance)
    for name, array, shape in (
        ("endpoints", endpoints, (2, 3)),
        ("pose_covariance", covariance, (6, 6)),
    ):
        if array.shape != shape:
            raise InvalidShapeError.of_rule(
                name, f"must have shape {shape}", f"shape {array.shape}"
            )
    tolerance = 1.0 - check_probability(accuracy, "accuracy")
    samples = check_count(samples, "samples")
    confidence = check_probability(confidence, "confidence")
    length = image_segment(endpoints, focal_length_mm=f)[0]
    rng = np.random.default_rng(rng)
    hits = 0
    for start in range(0, samples, _PARTS_AT_ONCE):
        normal = rng.standard_normal((min(_PARTS_AT_ONCE, samples - start), 6))
        ends = displace(endpoints, (normal @ covariance_root(covariance).T)[:, None, :])
        ends = ends[(ends[..., 2] < f).all(axis=1)]
        images = project(ends, focal_length_mm=f)
        measured = measure_lengths(
            images, pixel_pitch_mm=pixel_pitch_mm, detector=detector, band_px=band_px
        )
        hits += int((np.abs(measured - length) <= tolerance * length).sum())
    lower, upper = binomial_interval(hits, samples, confidence)
    return MonteCarloEstimate(
        np.asarray(hits / samples)[()], lower[()], upper[()], samples=samples, confidence=confidence
    )
