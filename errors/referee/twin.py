"""Digital twin of a measurement: displaced pose, synthetic image, detected ends, length.

Is the predicted probability true? `success_probability` models what a pixel grid does to a length by four independent
uniform errors (eq 3). The twin does not: it draws a displaced pose, makes the pixel image of the edge on the one fixed
grid of the sensor, finds the edge's ends in it by the paper's rule and compares the length with the nominal one. Where
both agree the model holds.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from errors.checks import (
    check_count,
    check_covariance,
    check_endpoints,
    check_positive,
    check_probability,
    covariance_root,
)
from errors.displacement import displace, image_segment, project
from errors.exceptions import InvalidShapeError
from errors.referee.montecarlo import MonteCarloEstimate, binomial_interval
from errors.referee.pixels import measure_lengths

_CHUNK = 1 << 14


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
    detector: str = "axes",
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
        How ends are found in the image; see `errors.referee.pixels`.
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
    for start in range(0, samples, _CHUNK):
        normal = rng.standard_normal((min(_CHUNK, samples - start), 6))
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
