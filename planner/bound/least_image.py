"""How long the image of an item must be at least, whatever the pose and however small its uncertainty.

The measured length of an edge is wrong by x = q + e: q the quantization error of both ends, e what the displaced pose
causes, independent of it. It is measured accurately if x is in [L ln A, L ln(2 - A)] (`errors.joint`), an interval of
width 2h. The density of q is symmetric and falls from the middle, so no interval of that width is more probable than
[-h, h], and by averaging over e (Anderson 1955)

    P <= P(|q| <= h),    h = L (ln(2 - A) - ln A) / 2.

With the image in the direction t, q is r_x cos t T_1 + r_y sin t T_2, the T triangular on [-1, 1]. So P >= p needs
L >= min over t of the p-quantile of |q|, divided by (ln(2 - A) - ln A) / 2.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from errors import SegmentQuantization
from planner.request.request import Request

_STEP = math.pi / 1800
_DIRECTIONS = np.arange(901) * _STEP
_BISECTIONS = 60
# more than is needed: the steps in direction and the error of the probability are allowed for one by one
_SAFETY = 0.99
# of the probability that a request computes, 5e-5, and of the law here
_PROBABILITY_ERROR = 6e-5


def least_images_mm(request: Request) -> NDArray[np.float64]:
    """Return the lengths on the sensor below which no image of an item's segment can satisfy a request.

    Parameters
    ----------
    request : Request
        The request, of k items.

    Returns
    -------
    array (k,)
        Lengths, mm; 0 asks for none.
    """
    quantile = _SAFETY * quantization_quantile(
        request.camera.finest_pitch_mm, request.probability - _PROBABILITY_ERROR
    )
    shortest = request.constraints.min_length_mm
    return np.array(
        [target.least_image_mm(request.accuracy, quantile, shortest) for target in request.targets]
    )


def quantization_quantile(pixel_pitch_mm: tuple[float, float], probability: float) -> float:
    """Return h, mm, such that in no direction a length's quantization error is within less than h so probably.

    The exact law gives the least h of directions a step apart. From any direction up to 45 degrees to the next lower
    one, or from any other to the next higher one, r_x cos t and r_y sin t grow by a factor of 1 + step at most. So does
    |q| (Anderson 1955), and h between the directions is smaller by no more than that.
    """
    law = SegmentQuantization(_DIRECTIONS, pixel_pitch_mm)
    low = np.zeros(len(_DIRECTIONS))
    high = np.full(len(_DIRECTIONS), float(np.sum(pixel_pitch_mm)))
    for _ in range(_BISECTIONS):
        h = (low + high) / 2
        enough = 2.0 * law.cdf(h) - 1.0 >= probability
        low = np.where(enough, low, h)
        high = np.where(enough, h, high)
    return float(low.min()) / (1.0 + _STEP)
