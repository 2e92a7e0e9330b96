"""How long an edge's image must be at least, whatever the pose and however small its uncertainty.

The measured length is wrong by x = q + e: q the quantization error of both ends, e what the displaced pose causes,
independent of it. An entity is measured accurately if x is in [L ln A, L ln(2 - A)] (`errors.joint`), an interval of
width 2h. The density of q is symmetric and falls from the middle, so no interval of that width is more probable than
[-h, h], and by averaging over e (Anderson 1955)

    P <= P(|q| <= h),    h = L (ln(2 - A) - ln A) / 2.

With the image in the direction t, q is r_x cos t T_1 + r_y sin t T_2, the T triangular on [-1, 1]. So P >= p needs
L >= min over t of the p-quantile of |q|, divided by (ln(2 - A) - ln A) / 2.
"""

from __future__ import annotations

import math

import numpy as np

_DIRECTIONS = np.radians(np.linspace(0.0, 90.0, 91))
_STEPS = 2000
# for the steps in direction and in the integral
_SAFETY = 0.99


def least_image_mm(judge) -> float:
    """Return the length on the sensor, mm, below which no image of an entity can satisfy a request (a `Judge`)."""
    half_width = 0.5 * (math.log(2.0 - judge.accuracy) - math.log(judge.accuracy))
    for_probability = quantization_quantile(judge.camera.pixel_pitch_mm, judge.threshold) / half_width
    return max(judge.constraints.min_length_mm, _SAFETY * for_probability)


def quantization_quantile(pixel_pitch_mm, probability: float) -> float:
    """Return the smallest h, mm, such that in some direction a length's quantization error is within h so probably."""
    across = pixel_pitch_mm[0] * np.cos(_DIRECTIONS)[:, None]
    down = np.maximum(pixel_pitch_mm[1] * np.sin(_DIRECTIONS)[:, None], 1e-6 * pixel_pitch_mm[1])
    t = (np.arange(_STEPS) + 0.5) / _STEPS * 2.0 - 1.0
    weight = (1.0 - np.abs(t)) * 2.0 / _STEPS
    low, high = np.zeros((len(_DIRECTIONS), 1)), np.full((len(_DIRECTIONS), 1), float(np.sum(pixel_pitch_mm)))
    for _ in range(40):
        h = (low + high) / 2
        inside = _triangular((h - across * t) / down) - _triangular((-h - across * t) / down)
        enough = (inside @ weight)[:, None] >= probability
        low, high = np.where(enough, low, h), np.where(enough, h, high)
    return float(low.min())


def _triangular(x: np.ndarray) -> np.ndarray:
    """Return the distribution function of the triangular law on [-1, 1]."""
    x = np.clip(x, -1.0, 1.0)
    return np.where(x < 0, (1.0 + x) ** 2 / 2, 1.0 - (1.0 - x) ** 2 / 2)
