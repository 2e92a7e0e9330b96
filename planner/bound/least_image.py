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

from errors import SegmentQuantization

_STEP = math.pi / 1800
_DIRECTIONS = np.arange(901) * _STEP
_BISECTIONS = 60
# excludes no image at all, and is no zero to divide by
_NO_LENGTH_MM = 1e-9
# more than is needed: the steps in direction and the error of the probability are allowed for one by one
_SAFETY = 0.99
# of the probability that a judge computes, 5e-5, and of the law here
_PROBABILITY_ERROR = 6e-5


def least_image_mm(judge) -> float:
    """Return the length on the sensor, mm, below which no image of an entity can satisfy a request (a `Judge`).

    Of dimensions nothing is claimed: how short an image of two of their points may be, follows from no constraint.
    """
    if judge.request.dimensions:
        return _NO_LENGTH_MM
    half_width = 0.5 * (math.log(2.0 - judge.accuracy) - math.log(judge.accuracy))
    quantile = quantization_quantile(judge.camera.pixel_pitch_mm, judge.threshold - _PROBABILITY_ERROR)
    return max(judge.constraints.min_length_mm, _SAFETY * quantile / half_width)


def quantization_quantile(pixel_pitch_mm, probability: float) -> float:
    """Return h, mm, such that in no direction a length's quantization error is within less than h so probably.

    The exact law gives the least h of directions a step apart. From any direction up to 45 degrees to the next lower
    one, or from any other to the next higher one, r_x cos t and r_y sin t grow by a factor of 1 + step at most. So does
    |q| (Anderson 1955), and h between the directions is smaller by no more than that.
    """
    law = SegmentQuantization(_DIRECTIONS, pixel_pitch_mm)
    low, high = np.zeros(len(_DIRECTIONS)), np.full(len(_DIRECTIONS), float(np.sum(pixel_pitch_mm)))
    for _ in range(_BISECTIONS):
        h = (low + high) / 2
        enough = 2.0 * law.cdf(h) - 1.0 >= probability
        low, high = np.where(enough, low, h), np.where(enough, h, high)
    return float(low.min()) / (1.0 + _STEP)
