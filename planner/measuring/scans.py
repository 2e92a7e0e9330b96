"""Scans: grey values across an edge at each sample, and the sub-pixel place of the edge on each, or why it has none."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from scipy.special import erf

from ground.decorators import njit

Array = NDArray[np.float64]

SAMPLING_PX = 0.25
"""Distance of grey values on a scan."""
SMOOTHING_PX = 1.0
"""Standard deviation of the Gaussian whose derivative is the gradient."""
BESIDE_PX = 2.5
"""Grey values to either side of an edge are taken this far from it."""
WEAK_SHARE = 5 / 255
"""Smallest step of grey values of an edge that counts, as a share of white."""
NOISES = 5.0
"""An edge's step is at least this many standard deviations of the image's noise."""
CLIPPED_SHARE = 251 / 255
"""A scan with a grey value from here on, as a share of white, is clipped."""
SECOND_SHARE = 0.5
"""A second gradient on a scan this strong, as a share of the first, makes its place uncertain."""

_ALONG = (-1.0, -0.5, 0.0, 0.5, 1.0)
_APART_PX = 1.5
# px²: interpolation between pixels, and their size
_SAMPLING_VARIANCE = 1 / 6 + 1 / 12

# px: blurs that can be told apart
_BLURS = np.linspace(0.0, 5.0, 101)

ALONG_VARIANCE = sum(step**2 for step in _ALONG) / len(_ALONG) + _SAMPLING_VARIANCE
"""Variance of where along an edge grey values come from, px², besides the image's blur.

What is averaged along a curve of the curvature c appears nearer to its centre, by c/2 times this variance.
"""


class State(IntEnum):
    """What became of a sample."""

    FOUND = 0
    WEAK = 1
    CLIPPED = 2
    AT_END = 3
    TWO_STEPS = 4
    OUTLIER = 5
    OUTSIDE = 6
    HIDDEN = 7
    NEAR_LINE = 8
    SHADOW = 9


STATE_TEXTS = {
    State.FOUND: "found",
    State.WEAK: "weak",
    State.CLIPPED: "overexposed",
    State.AT_END: "at the window's end",
    State.TWO_STEPS: "two steps",
    State.OUTLIER: "outlier",
    State.OUTSIDE: "outside the image",
    State.HIDDEN: "hidden",
    State.NEAR_LINE: "next to another line",
    State.SHADOW: "next to a shadow",
}
"""States in the words of reports."""


@dataclass(frozen=True)
class Scans:
    """What was found on scans (m).

    Attributes
    ----------
    offset : array (m,)
        Where the edge is along the scan, px from its middle.
    state : array of int (m,)
        `State` of each.
    step : array (m,)
        Grey value on the scan's far side of the edge less that on its near side, as a share of white.
    blur_px : array (m,)
        Standard deviation of the image's blur across the edge, from the gradient's height, at most 5; 0 of an edge that
        is sharper than the pixels.
    """

    offset: Array
    state: NDArray[np.int64]
    step: Array
    blur_px: Array


def noise_of(image: NDArray[Any]) -> float:
    """Return the standard deviation of an image's noise, in its grey values: robust, from a few rows of differences."""
    rows = np.asarray(image[:: max(1, len(image) // 200)], dtype=np.float64)
    second = rows[:, 2:] - 2 * rows[:, 1:-1] + rows[:, :-2]
    return float(1.4826 * np.median(np.abs(second)) / np.sqrt(6))


def profiles_of(
    image: NDArray[Any], centres: Array, across: Array, half_px: float
) -> tuple[Array, Array]:
    """Return places along scans (k,), px, and grey values (m, k) there, averaged along the edge; nan off the image.

    Parameters
    ----------
    image : array (h, w)
        Grey values, float32.
    centres, across : array (m, 2)
        Middle of each scan, px, and its unit direction.
    half_px : float
        How far it is searched; scans are longer, for the values beside an edge.
    """
    reach = half_px + BESIDE_PX + 1.0
    n = int(np.ceil(reach / SAMPLING_PX))
    places = np.asarray(np.arange(-n, n + 1) * SAMPLING_PX, dtype=np.float64)
    grey = np.empty((len(centres), len(places)))
    _sample(
        image,
        np.ascontiguousarray(centres),
        np.ascontiguousarray(across),
        places,
        np.array(_ALONG),
        grey,
    )
    return places, grey


@njit(error_model="numpy")
def _sample(image, centres, across, places, along, grey):
    height, width = image.shape
    for i in range(len(centres)):
        ex = across[i, 0]
        ey = across[i, 1]
        for j in range(len(places)):
            total = 0.0
            for k in range(len(along)):
                x = centres[i, 0] + places[j] * ex - along[k] * ey
                y = centres[i, 1] + places[j] * ey + along[k] * ex
                if not (x >= 0.0 and y >= 0.0 and x < width - 1 and y < height - 1):
                    total = np.nan
                    break
                u = int(x)
                v = int(y)
                a = x - u
                b = y - v
                upper = (1 - a) * image[v, u] + a * image[v, u + 1]
                lower = (1 - a) * image[v + 1, u] + a * image[v + 1, u + 1]
                total += (1 - b) * upper + b * lower
            grey[i, j] = total / len(along)


def gradients_of(grey: Array) -> Array:
    """Return smoothed derivatives (m, k) of grey values along scans, per px."""
    sigma = SMOOTHING_PX / SAMPLING_PX
    return np.asarray(gaussian_filter1d(grey, sigma, axis=1, order=1, mode="nearest") / SAMPLING_PX)


def find_edges(
    image: NDArray[Any],
    centres: Array,
    across: Array,
    half_px: float,
    *,
    white: float,
    noise: float,
    sign: NDArray[np.int64] | None = None,
) -> Scans:
    """Scan an image across edges.

    Parameters
    ----------
    image : array (h, w)
        Grey values, float32.
    centres, across : array (m, 2)
        Predicted places, px, and unit vectors across the edges.
    half_px : float
        How far to either side an edge is searched.
    white : float
        Grey value of full exposure.
    noise : float
        Standard deviation of the noise, in grey values.
    sign : array of int (m,), optional
        Sign of the step that is searched along each scan; 0 is either.

    Returns
    -------
    Scans
        Place and state for each.
    """
    places, grey = profiles_of(image, centres, across, half_px)
    outside = np.asarray(~np.isfinite(grey).all(axis=1))
    grey = np.where(outside[:, None], 0.0, grey)
    slope = gradients_of(grey)
    polarity = np.zeros(len(grey), dtype=np.int64) if sign is None else sign
    strength = np.where(polarity[:, None] == 0, np.abs(slope), slope * polarity[:, None])
    inside = np.asarray(np.abs(places) <= half_px)
    best = np.argmax(np.where(inside, strength, -np.inf), axis=1)
    rows = np.arange(len(grey))
    before, peak, after = (strength[rows, best + k] for k in (-1, 0, 1))
    bend = before - 2 * peak + after
    shift = np.where(bend < 0, 0.5 * (before - after) / np.where(bend < 0, bend, -1.0), 0.0)
    offset = places[best] + SAMPLING_PX * np.clip(shift, -1.0, 1.0)
    beside = round(BESIDE_PX / SAMPLING_PX)
    low, high = (grey[rows, np.clip(best + k, 0, len(places) - 1)] for k in (-beside, beside))
    near = np.abs(np.arange(len(places)) - best[:, None]) <= beside + 2
    brightest = np.where(near, grey, 0.0).max(axis=1)
    state = np.full(len(grey), int(State.FOUND))
    others = _second_strength(np.abs(slope), best, inside)
    second = np.asarray(others >= SECOND_SHARE * peak)
    state[second] = State.TWO_STEPS
    state[np.abs(offset) > half_px - 0.5] = State.AT_END
    state[brightest >= CLIPPED_SHARE * white] = State.CLIPPED
    # the filter sees the step of a sharp edge as this much gradient for each grey value
    weakest = max(WEAK_SHARE * white, NOISES * noise) / (np.sqrt(2 * np.pi) * 1.6 * SMOOTHING_PX)
    state[peak < weakest] = State.WEAK
    state[outside] = State.OUTSIDE
    width = np.abs(high - low) / np.maximum(np.sqrt(2 * np.pi) * peak, 1e-12)
    return Scans(offset, state, (high - low) / white, _blur_of(width))


def _blur_of(width: Array) -> Array:
    """Return the blur of edges, px, by their step over their steepest gradient times sqrt(2 pi), px.

    Of a step A with a blur of the variance s², the grey values at a distance of b to both sides differ by
    A erf(b / sqrt(2 (s² + c))) with c the variance of the sampling. The gradient is A / sqrt(2 pi (s² + c + g²)) with g
    the standard deviation of its filter. Their ratio rises with s.
    """
    grey = _BLURS**2 + _SAMPLING_VARIANCE
    seen = erf(BESIDE_PX / np.sqrt(2 * grey)) * np.sqrt(grey + SMOOTHING_PX**2)
    return np.asarray(np.interp(width, seen, _BLURS))


def _second_strength(strength: Array, best: NDArray[np.int64], inside: NDArray[np.bool_]) -> Array:
    """Return the strongest gradient (m,) at local maxima of a scan that are away from its strongest one."""
    peak = np.zeros(strength.shape, dtype=bool)
    peak[:, 1:-1] = (strength[:, 1:-1] > strength[:, :-2]) & (strength[:, 1:-1] >= strength[:, 2:])
    away = np.abs(np.arange(strength.shape[1]) - best[:, None]) * SAMPLING_PX >= _APART_PX
    return np.asarray(np.where(peak & away & inside, strength, 0.0).max(axis=1))
