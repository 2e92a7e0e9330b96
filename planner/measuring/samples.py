"""Samples along edges, and the scans across them in images."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d, uniform_filter1d
from scipy.spatial import cKDTree
from scipy.special import erf

from aspectgraph.entities.entity_rules import PARAMETERS, Carriers, faces_along
from aspectgraph.light import DEFAULT_CONTRAST
from aspectgraph.solid.solid import RayScene
from errors.measurands import Circle, Geometry, Line, Measurand
from ground.decorators import njit
from planner.camera.camera import Camera, image_of
from planner.camera.pose import world_to_cam
from planner.detectability.image_check import SECTORS
from planner.exceptions import RequestError
from planner.light.area_light import AreaLight, EdgePoints, Sight
from planner.request.targets import Target

if TYPE_CHECKING:
    from aspectgraph import Arc, Solid

# Scans: grey values across an edge at each sample, and the sub-pixel place of the edge on each,
# or why it has none.


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

# places beside an edge between which light may rise or fall evenly, standard deviations of its blur, and px at least
_BESIDE = np.array([3.0, 4.5, 6.0])
_BESIDE_LEAST_PX = np.array([2.5, 3.75, 5.0])
MOST_BY_SLOPES_PX = 0.1
"""What moves an edge by more is the other side of a broken edge, or a shadow, and no slope of light."""
MOST_IF_SHARP_PX = 0.5
"""The same if edges are stated as sharp: walls of bores under a dome move their rims by 0.15 px and more."""
# slopes that move an edge by so much are certain
_SURE_PX = 0.05
# of what slopes are known to move an edge, this share is not known; and of the unknown, px count at most
_UNSURE_SHARE = 0.5
_MOST_DOUBT_PX = 0.2
# steps below this share of their edge's count only where slopes are known to move them little
_FADING_SHARE = 0.5
# steps of the other sign than most of their edge's count if they are this share of white: nothing fades in between
_CLEAR_SHARE = 15 / 255
# how far slopes are looked at: those of blurs up to 1.5 px
_SLOPES_PX = 9.0
# slopes of the halves of this differ by so many standard deviations of the noise over its width by chance
_UNEVEN_NOISES = 8.0

# places next to each other along an edge are at most so far apart, px, and so many are looked at together
_NEXT_PX = 10.0
_MEAN_OF = 15

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
    slopes_px : array (m,)
        What is not known of how far slopes of light beside the edge move its steepest place, px.
    """

    offset: Array
    state: NDArray[np.int64]
    step: Array
    blur_px: Array
    slopes_px: Array


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
    clipped: float | None = None,
    most_by_slopes_px: float = MOST_BY_SLOPES_PX,
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
    clipped : float, optional
        Grey value from which on a scan is clipped. Default: `CLIPPED_SHARE` of white.
    most_by_slopes_px : float, optional
        See `shift_by_slopes`.

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
    limit = CLIPPED_SHARE * white if clipped is None else clipped
    state[brightest >= limit] = State.CLIPPED
    # the filter sees the step of a sharp edge as this much gradient for each grey value
    weakest = max(WEAK_SHARE * white, NOISES * noise) / (np.sqrt(2 * np.pi) * 1.6 * SMOOTHING_PX)
    state[peak < weakest] = State.WEAK
    state[outside] = State.OUTSIDE
    width = np.abs(high - low) / np.maximum(np.sqrt(2 * np.pi) * peak, 1e-12)
    blur = _blur_of(width)
    step = high - low
    found = state == State.FOUND
    # how far an edge is searched must not decide whether what is beside it is seen
    around, grey = profiles_of(
        image, centres + offset[:, None] * across, across, _SLOPES_PX - BESIDE_PX
    )
    middle = np.full(len(grey), -around[0])
    steps = np.where(found, step, 0.0)
    by_slopes = shift_by_slopes(
        grey, middle, blur, steps, noise, centres, most_px=most_by_slopes_px
    )
    offset[found] -= by_slopes.px[found]
    state[found & _fades(steps / white, by_slopes.sure, centres)] = State.WEAK
    return Scans(offset, state, step / white, blur, by_slopes.unsure_px)


def _fades(step: Array, sure: NDArray[np.bool_], places: Array) -> NDArray[np.bool_]:
    """Return where an edge ends in a slope: samples (m,) at places (m, 2), px, from an open end of it on.

    A wall that turns away from the camera darkens towards the end of its arc. There steps vanish in slopes that are not
    known. So steps do not count that are less than half of the median of their edge, and not sure. Where the wall is in
    its own shadow, the step of the face around it is left, with the other sign. Such clear steps are compared with each
    other.
    """
    size = np.abs(step)
    result = np.zeros(len(step), dtype=bool)
    for run in _runs(places):
        seen = size[run][size[run] > 0]
        is_closed = len(run) > 2 and np.linalg.norm(places[run[0]] - places[run[-1]]) <= _NEXT_PX
        if is_closed or not len(seen):
            continue
        typical = np.full(len(run), np.median(seen))
        is_other = (step[run] * step[run].sum() < 0) & (size[run] >= _CLEAR_SHARE)
        if is_other.any():
            typical[is_other] = np.median(size[run][is_other])
        is_weak = (size[run] < _FADING_SHARE * typical) & ~sure[run]
        for way in (run, run[::-1]):
            lost = is_weak if way is run else is_weak[::-1]
            result[way[: len(lost) if lost.all() else int(np.argmin(lost))]] = True
    return result


class BySlopes(NamedTuple):
    """How far slopes of light move the steepest place of scans (m).

    Attributes
    ----------
    px : array (m,)
        How far, as far as it is known, px.
    sure : array of bool (m,)
        Whether that is all: slopes are seen, and move the place by no more than 0.05 px.
    unsure_px : array (m,)
        Half of it, and what light next to the edge tells beyond it, at most 0.2 px.
    """

    px: Array
    sure: NDArray[np.bool_]
    unsure_px: Array


def shift_by_slopes(
    grey: Array,
    at_px: Array,
    blur_px: Array,
    step: Array,
    noise: float,
    places: Array,
    *,
    most_px: float = MOST_BY_SLOPES_PX,
) -> BySlopes:
    """Return how far the steepest place of scans is off their edge because light beside it rises or falls.

    Let a step A be at 0, with slopes a before it and b after it, and s² be the variance of blur, sampling and the
    gradient's filter. The gradient A φ(t/s)/s + a Φ(-t/s) + b Φ(t/s) is largest at t = s² (b - a) / A. Walls of bores
    are brighter or darker towards their rim, so without this all diameters would be off in one direction.

    Where the halves of what is beside the edge differ by more than noise and slope, there is another step, which is not
    taken for a slope.

    Parameters
    ----------
    grey : array (m, k)
        Grey values along scans.
    at_px : array (m,)
        Steepest place on each, px from its first grey value.
    blur_px : array (m,)
        Blur of the image there, standard deviation.
    step : array (m,)
        Grey value after the edge less that before it; 0 where no edge was found.
    noise : float
        Standard deviation of the noise, in grey values.
    places : array (m, 2)
        Middles of the scans, px: those next to each other along an edge are looked at together.
    most_px : float, optional
        What moves an edge by more is no slope of light.

    Returns
    -------
    BySlopes
        0 where the image does not reach far enough, and where it would be more than ``most_px``: the other side of a
        broken edge does that. Less from half of this on.
    """
    sigma = np.sqrt(blur_px**2 + _SAMPLING_VARIANCE)
    beside = np.maximum(_BESIDE * sigma[:, None], _BESIDE_LEAST_PX)
    after = _between(grey, at_px[:, None] + beside)
    before = _between(grey, at_px[:, None] - beside)
    # slopes after the edge less those before it, over all of it and over its halves
    sums = after + before
    width = beside[:, -1] - beside[:, 0]
    bend = (sums[:, -1] - sums[:, 0]) / width
    nearer, farther = (np.diff(sums, axis=1) / np.diff(beside, axis=1)).T
    uneven = np.abs(nearer - farther)
    even = _share_below(uneven, np.maximum(np.abs(bend), _UNEVEN_NOISES * noise / width))
    variance = sigma**2 + SMOOTHING_PX**2
    # weak steps tell least of how far light moves them, and those with another step beside them nothing
    weight = _mean_along(even * step**2, places)
    bends = np.where(even > 0, variance * bend, 0.0)
    moment = _mean_along(even * bends * step, places)
    shift = even * np.where(weight > 0, moment / np.where(weight > 0, weight, 1.0), 0.0)
    squares = np.maximum(_mean_along(step**2, places), 1e-12)
    whole = np.abs(_mean_along(variance * bend * step, places) / squares)
    sure = np.isfinite(whole) & (whole <= _SURE_PX)
    px = _share_below(np.abs(shift), most_px) * shift
    # where another step is farther out, the nearer half still tells of the edge
    near = np.nan_to_num(_mean_along(np.nan_to_num(variance * nearer * step), places) / squares)
    unsure = _UNSURE_SHARE * np.abs(px) + np.abs(near - px)
    return BySlopes(px, sure, np.minimum(unsure, _MOST_DOUBT_PX))


def _share_below(value: Array, limit: Array | float) -> Array:
    """Return 1 up to half of a limit, falling to 0 at the limit, so that no place depends on which side noise falls."""
    return np.nan_to_num(np.clip(2.0 - 2.0 * value / np.maximum(limit, 1e-12), 0.0, 1.0))


def _mean_along(value: Array, places: Array) -> Array:
    """Return the means (m,) of values and their neighbours, at places (m, 2) along edges, px.

    Light beside an edge changes slowly along it. What differs between neighbours is noise, texture, or facets.
    """
    result = np.array(value)
    for run in _runs(places):
        result[run] = uniform_filter1d(value[run], _MEAN_OF, mode="nearest")
    return result


def _runs(places: Array) -> list[NDArray[np.int64]]:
    """Return the numbers of places (m, 2), px, that follow each other along an edge without a gap."""
    gaps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    return np.split(np.arange(len(places)), np.flatnonzero(gaps > _NEXT_PX) + 1)


def _between(grey: Array, at_px: Array) -> Array:
    """Return grey values (m, q) at places along scans, px from their first; nan beyond their ends."""
    at = at_px / SAMPLING_PX
    last = grey.shape[1] - 1
    index = np.clip(np.floor(at).astype(np.int64), 0, last - 1)
    share = at - index
    rows = np.arange(len(grey))[:, None]
    value = (1 - share) * grey[rows, index] + share * grey[rows, index + 1]
    return np.where((at >= 0) & (at <= last), value, np.nan)


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


# Samples: points of the part's sharp edges, rims and arcs, as one camera pose shows them.
#
# A sample is visible if the ray from the camera reaches a place just above it, outside the
# material. Where another line of the part lies close in the image, a sample says nothing certain:
# a scan across it could find the other line.


# Sharp edges of a part, and points on many of them at once.


_NOTHING = np.zeros(3)


@dataclass(frozen=True)
class PartEdge:
    """A sharp edge of the part.

    Attributes
    ----------
    name : str
        Its id, such as "e17", "r3" or "a5".
    geometry : Line or Circle
        Where it is, mm.
    edge_ids : tuple of int
        Edges of the solid: one, or the chords of a circle in their order.
    normals : array (n, 2, 3)
        Outward unit normals of both faces, for each of these.
    chord_mm : float
        Largest distance of a chord from the circle.
    convex : bool
        Whether its faces meet at a convex angle; a re-entrant edge is never broken.
    """

    name: str
    geometry: Geometry
    edge_ids: tuple[int, ...]
    normals: Array
    chord_mm: float = 0.0
    convex: bool = True

    def at(self, shares: Array) -> tuple[Array, Array, Array]:
        """Return points (n, 3), unit tangents (n, 3) and normals of both faces (n, 2, 3) at shares (n,) of it."""
        return EdgeTable([self]).at(np.zeros(len(shares), dtype=np.int64), shares)


class EdgeTable:
    """Some edges, as arrays.

    Parameters
    ----------
    edges : sequence of PartEdge
        The edges.

    Attributes
    ----------
    chord_mm : array (e,)
        Largest distance of each edge's chords from its circle.
    """

    def __init__(self, edges: Sequence[PartEdge]) -> None:
        self.edges = list(edges)
        self.chord_mm = np.array([edge.chord_mm for edge in edges])
        shapes = [edge.geometry for edge in edges]
        self._round = np.array([isinstance(shape, Circle) for shape in shapes])
        self._radius = np.array(
            [shape.radius_mm if isinstance(shape, Circle) else 1 for shape in shapes]
        )
        self._span = np.array(
            [shape.span_rad if isinstance(shape, Circle) else 0 for shape in shapes]
        )
        # where it starts or has its centre; the way along it, or two radii at right angles; its direction, or axis
        vectors = [
            (shape.p, shape.q - shape.p, _NOTHING, shape.direction)
            if isinstance(shape, Line)
            else (shape.centre, *shape.basis, shape.axis)
            for shape in shapes
        ]
        self._origin, self._x, self._y, self._way = np.array(vectors).transpose(1, 0, 2)
        self._count = np.array([len(edge.normals) for edge in edges])
        self._first = np.cumsum(self._count) - self._count
        self._normals = np.concatenate([edge.normals for edge in edges])

    def at(self, number: NDArray[np.int64], shares: Array) -> tuple[Array, Array, Array]:
        """Return points (n, 3), unit tangents (n, 3) and normals of both faces (n, 2, 3).

        Parameters
        ----------
        number : array of int (n,)
            Number of each point's edge.
        shares : array (n,)
            Where on it, in [0, 1].
        """
        origin = self._origin[number]
        x = self._x[number]
        points = origin + shares[:, None] * x
        tangents = self._way[number]
        curved = self._round[number]
        round_number = number[curved]
        angle = (shares[curved] * self._span[round_number])[:, None]
        radius = self._radius[round_number][:, None]
        points[curved] = origin[curved] + radius * (
            np.cos(angle) * x[curved] + np.sin(angle) * self._y[round_number]
        )
        tangents[curved] = (
            np.cross(self._way[round_number], points[curved] - origin[curved]) / radius
        )
        chord = np.clip((shares * self._count[number]).astype(int), 0, self._count[number] - 1)
        return points, tangents, self._normals[self._first[number] + chord]


STEP_PX = 2.5
"""Distance of samples along an edge in the image."""
APART_PX = 5.0
"""A sample with another line of the part at most this far away in the image is left out."""
END_PX = 6.0
"""Samples of a straight edge begin this far from its ends in the image: other lines meet there."""

LEAST_PART_PX = 12.0
"""In each twelfth of an edge something must be found, or in each part of this length, where twelfths are shorter.

Errors of points are alike over `planner.measuring.fit.CORRELATION_PX`. So a twelfth of a rim of 70 px is one or two
independent points, which may be outliers, and these are three.
"""
PART_WORDS = (
    *("half", "third", "quarter", "fifth", "sixth", "seventh"),
    *("eighth", "ninth", "tenth", "eleventh", "twelfth"),
)
"""What one of two, three and up to twelve equal parts is called."""

_OUTLINE = 65
# of an outline: how far an edge may go beyond it
_BEYOND = 0.01
# samples that an edge has at least
_LEAST = 4
# how far above the surface a sample is looked at
_LIFT_MM = 0.03
# of a length: steps along an edge that give its direction in the image
_AHEAD = 1e-4
# cosine from which on a face is level with a rim
_LEVEL = 0.999
# points that are looked at on a contour of a curved face, as many as the longest image has
_MOST_OF_CONTOUR = 4000
# where nothing is
_FAR_PX = -1e6
# samples that are looked at around each one
_NEIGHBOURS = 8


@dataclass(frozen=True)
class Samples:
    """Samples (m) of several edges in one image.

    Attributes
    ----------
    edge : array of int (m,)
        Which edge each is of.
    share : array (m,)
        Where on it, in [0, 1].
    points, tangents : array (m, 3)
        In the part's frame, mm; unit vectors.
    visible : array of bool (m,)
        Whether nothing hides it, and it is in the image.
    apart : array of bool (m,)
        Whether no other line is near.
    """

    edge: NDArray[np.int64]
    share: Array
    points: Array
    tangents: Array
    visible: NDArray[np.bool_]
    apart: NDArray[np.bool_]

    @property
    def usable(self) -> NDArray[np.bool_]:
        """Which samples are visible and apart from other lines (m,)."""
        return self.visible & self.apart

    def of(self, edge: int) -> Samples:
        """Return the samples of one edge, by its number."""
        return self.chosen(self.edge == edge)

    def chosen(self, which: NDArray[np.bool_]) -> Samples:
        """Return some of the samples, given which (m,)."""
        return Samples(
            self.edge[which],
            self.share[which],
            self.points[which],
            self.tangents[which],
            self.visible[which],
            self.apart[which],
        )


class PartEdges:
    """All sharp edges, rims and arcs of a part, and rays that tell what hides them.

    Parameters
    ----------
    solid : Solid
        The part.
    area : AreaLight, optional
        A light with an area: what it does not show counts as hidden.
    """

    def __init__(self, solid: Solid, area: AreaLight | None = None) -> None:
        self.solid = solid
        self.area = area
        self.scene = RayScene(solid.vertices, solid.triangles, n_threads=1)
        curves = [*solid.rims(), *solid.arcs()]
        chords = {edge_id for curve in curves for edge_id in curve.edge_ids}
        round_faces = [self._round_faces(curve) for curve in curves]
        straight = [
            edge
            for edge in solid.straight_edges()
            if edge.id not in chords
            and not any(faces.issuperset(edge.faces) for faces in round_faces)
        ]
        self.edges = [
            *(self.edge_of(f"e{e.id}", Line(*solid.edge_points(e.id)), (e.id,)) for e in straight),
            *(
                self.edge_of(c.id, circle_of(c), c.edge_ids, max(c.chord_mm, c.residual_mm))
                for c in curves
            ),
        ]

    @cached_property
    def _table(self) -> EdgeTable:
        return EdgeTable(self.edges)

    @cached_property
    def _turning(self) -> _Turning:
        """Where curved faces may turn away: the convex edges of the mesh that are no edge of the part."""
        listed = {edge_id for edge in self.edges for edge_id in edge.edge_ids}
        between = [e for e in self.solid.edges if e.dihedral_deg > 0 and e.id not in listed]
        faces = np.array([edge.faces for edge in between], np.int64).reshape(-1, 2)
        ends = np.array([self.solid.edge_points(edge.id) for edge in between], np.float64)
        return _Turning(ends.reshape(-1, 2, 3), self.solid.normals[faces])

    @cached_property
    def _outlines(self) -> Array:
        return outlines_of(self._table)

    def _round_faces(self, curve: Arc) -> set[int]:
        """Return the facets of the round surface beside a rim or arc: in a mesh, edges between them look sharp."""
        faces = np.array([self.solid.edges[i].faces for i in curve.edge_ids])
        level = np.abs(self.solid.normals[faces] @ curve.axis) > _LEVEL
        return set(faces[~level].tolist())

    def edge_of(
        self, name: str, geometry: Geometry, edge_ids: Sequence[int], chord_mm: float = 0.0
    ) -> PartEdge:
        """Return an edge with the normals of its faces."""
        if isinstance(geometry, Circle):
            faces = faces_along(self.solid, edge_ids, geometry.axis)
        else:
            faces = np.array([self.solid.edges[i].faces for i in edge_ids])
        turns = [self.solid.edges[i].dihedral_deg for i in edge_ids]
        normals = self.solid.normals[faces]
        return PartEdge(
            name, geometry, tuple(edge_ids), normals, chord_mm, float(np.median(turns)) > 0
        )

    def samples(
        self, cam2world: Array, camera: Camera, edges: Sequence[PartEdge], margin_px: float
    ) -> Samples:
        """Return the samples of some edges at a pose.

        Parameters
        ----------
        cam2world : array (4, 4)
            Pose of the camera.
        camera : Camera
            The camera.
        edges : sequence of PartEdge
            The edges.
        margin_px : float
            Samples keep this distance from the image's border.
        """
        table = EdgeTable(edges)
        images = pixels_of(outlines_of(table), cam2world, camera)
        return self._samples(table, images, cam2world, camera, margin_px)

    def shown(self, cam2world: Array, camera: Camera) -> ShownEdges:
        """Return all edges as they are seen from a pose.

        Parameters
        ----------
        cam2world : array (4, 4)
            Pose of the camera.
        camera : Camera
            The camera.
        """
        images = pixels_of(self._outlines, cam2world, camera)
        # between the points of an outline, an edge goes a little beyond them
        room = _BEYOND * np.ptp(images, axis=1) + 1.0
        low = images.min(axis=1) - room
        high = images.max(axis=1) + room
        outside = np.any((high < 0) | (low > np.array(camera.resolution)), axis=1)
        images[outside] = np.nan
        samples = self._samples(self._table, images, cam2world, camera, 0.0)
        samples = samples.chosen(samples.visible)
        pixels = pixels_of(samples.points, cam2world, camera)
        return ShownEdges(self.edges, samples, pixels, self.contours(cam2world, camera))

    def contours(self, cam2world: Array, camera: Camera) -> Array:
        """Return where contours of curved faces are seen, px (n, 2): where these turn away from the camera.

        No edge is there, and yet a line in the image, which touches the images of edges that it ends at.
        """
        ends, normals = self._turning
        eye = np.asarray(cam2world)[:3, 3]
        is_front = np.einsum("efk,ek->ef", normals, eye - ends[:, 0]) > 0
        local = world_to_cam(ends, cam2world)
        turns = (is_front[:, 0] != is_front[:, 1]) & (local[:, :, 2] > 0).all(axis=1)
        ends = ends[turns]
        normals = normals[turns]
        slopes = local[turns, :, :2] / local[turns, :, 2:]
        length_px = np.linalg.norm(
            (slopes[:, 1] - slopes[:, 0]) * camera.matrix[[0, 1], [0, 1]], axis=1
        )
        count = 2 + np.minimum(length_px / STEP_PX, _MOST_OF_CONTOUR).astype(int)
        of = np.repeat(np.arange(len(count)), count)
        share = (np.arange(len(of)) - np.repeat(np.cumsum(count) - count, count)) / (count[of] - 1)
        points = ends[of, 0] + share[:, None] * (ends[of, 1] - ends[of, 0])
        pixels = pixels_of(points, cam2world, camera)
        seen = in_image(pixels, camera, -APART_PX)
        seen[seen] = self._visible(points[seen], normals[of[seen]], np.zeros(seen.sum()), cam2world)
        return pixels[seen]

    def _samples(
        self, table: EdgeTable, images: Array, cam2world: Array, camera: Camera, margin_px: float
    ) -> Samples:
        """Return the samples of edges, given the images (e, k, 2) of their outlines; none where these are nan."""
        shares = sample_shares(table.edges, images)
        number = np.repeat(np.arange(len(shares)), [len(edge_shares) for edge_shares in shares])
        share = np.concatenate(shares)
        points, tangents, normals = table.at(number, share)
        visible = in_image(pixels_of(points, cam2world, camera), camera, margin_px)
        chord = table.chord_mm[number[visible]]
        visible[visible] = self._visible(points[visible], normals[visible], chord, cam2world)
        if self.area is not None and visible.any():
            sight = Sight.of(self.solid, camera, self.scene)
            of_edges = EdgePoints(points[visible], tangents[visible], normals[visible])
            eye = np.asarray(cam2world)[None, :3, 3]
            held = self.area.held(np.asarray(cam2world, dtype=np.float64))
            visible[visible] = held.contrasts(sight, of_edges, eye)[0][0] >= DEFAULT_CONTRAST
        return Samples(number, share, points, tangents, visible, np.ones_like(visible))

    def _visible(
        self, points: Array, normals: Array, chord_mm: Array, cam2world: Array
    ) -> NDArray[np.bool_]:
        """Return which points (n, 3) nothing hides."""
        above = normals.sum(axis=1)
        above /= np.maximum(np.linalg.norm(above, axis=1, keepdims=True), 1e-9)
        lifted = points + (_LIFT_MM + 2 * chord_mm)[:, None] * above
        origin = np.asarray(cam2world)[:3, 3]
        return np.asarray(~self.scene.blocked(origin, lifted - origin))


class _Turning(NamedTuple):
    """Edges (m) of a mesh between two facets: their ends (m, 2, 3), mm, and the normals of both facets (m, 2, 3)."""

    ends: Array
    normals: Array


class ShownEdges:
    """All edges of a part as one pose shows them, and which places of the image are apart from them.

    Parameters
    ----------
    edges : sequence of PartEdge
        All edges.
    samples : Samples
        Their visible samples (m).
    pixels : array (m, 2)
        Images of these, px.
    contours : array (n, 2)
        Where other lines are seen, px: contours of curved faces.
    """

    def __init__(
        self, edges: Sequence[PartEdge], samples: Samples, pixels: Array, contours: Array
    ) -> None:
        self.samples = samples
        self.pixels = pixels
        self.contours = contours
        places = np.concatenate([pixels, contours])
        self._tree = cKDTree(places) if len(places) else None
        # of no edge
        self._number = np.concatenate([samples.edge, np.full(len(contours), len(edges))])
        self._holders: dict[int, list[int]] = {}
        for number, edge in enumerate(edges):
            for edge_id in edge.edge_ids:
                self._holders.setdefault(edge_id, []).append(number)
        self._edges = edges

    def apart(
        self,
        edges: Sequence[PartEdge],
        number: NDArray[np.int64],
        pixels: Array,
        half_px: float = 0.0,
    ) -> NDArray[np.bool_]:
        """Return which places (n,) have no visible sample of another edge or contour near.

        Parameters
        ----------
        edges : sequence of PartEdge
            Edges that are asked about.
        number : array of int (n,)
            Which of them each place is on.
        pixels : array (n, 2)
            Where it is, px.
        half_px : float
            How far scans are searched: another line is apart if it lies farther away, and by `APART_PX` at least.
        """
        if self._tree is None:
            return np.ones(len(number), dtype=np.bool_)
        same = np.zeros((len(edges), len(self._edges) + 1), dtype=np.bool_)
        for k, edge in enumerate(edges):
            for edge_id in edge.edge_ids:
                same[k, self._holders.get(edge_id, [])] = True
        count = self._tree.n
        finite = np.where(np.isfinite(pixels), pixels, _FAR_PX)
        # an edge's own samples are near, too: the first ones of other edges are looked for among so many
        k = min(_NEIGHBOURS + 2 * int(max(half_px - APART_PX, 0.0)), count)
        distance, index = self._tree.query(finite, k=k, distance_upper_bound=max(APART_PX, half_px))
        distance = distance.reshape(len(finite), k)
        index = np.minimum(index.reshape(len(finite), k), count - 1)
        foreign = ~same[number[:, None], self._number[index]]
        return ~np.any(np.isfinite(distance) & foreign, axis=1)


def circle_of(curve: Arc) -> Circle:
    """Return a rim or arc as a circle that starts where its first chord does."""
    x = curve.reference
    y = np.cross(curve.axis, x)
    start = np.cos(curve.start_rad) * x + np.sin(curve.start_rad) * y
    span = min(curve.end_rad - curve.start_rad, 2 * np.pi)
    return Circle(curve.centre, curve.axis, curve.radius_mm, start, span)


def parts_of(n_samples: int) -> int:
    """Return in how many parts of an edge with so many samples something must be found: 12, or fewer of a short one."""
    return max(1, min(SECTORS, int(n_samples * STEP_PX / LEAST_PART_PX)))


def numbers_of_parts(share: Array, n_parts: int) -> NDArray[np.int64]:
    """Return in which of n equal parts of an edge its samples (m,) are, given where these are on it."""
    along = (share - share.min()) / max(float(np.ptp(share)), 1e-12)
    return np.minimum((along * n_parts).astype(np.int64), n_parts - 1)


def outlines_of(table: EdgeTable) -> Array:
    """Return points equally far apart on each edge (e, k, 3), mm."""
    count = len(table.edges)
    number = np.repeat(np.arange(count), _OUTLINE)
    shares = np.tile(np.linspace(0.0, 1.0, _OUTLINE), count)
    return table.at(number, shares)[0].reshape(count, _OUTLINE, 3)


def sample_shares(edges: Sequence[PartEdge], outlines: Array) -> list[Array]:
    """Return where samples lie on each edge, equally far apart in the image: shares (n,); none behind the camera.

    Parameters
    ----------
    edges : sequence of PartEdge
        The edges.
    outlines : array (e, k, 2)
        Images of their points of `outlines_of`, px.
    """
    steps = np.linalg.norm(np.diff(outlines, axis=1), axis=2)
    along = np.concatenate([np.zeros((len(steps), 1)), np.cumsum(steps, axis=1)], axis=1)
    ends = np.array([END_PX if isinstance(edge.geometry, Line) else 0.0 for edge in edges])
    room = along[:, -1] - 2 * ends
    # not a number behind the camera
    count = np.where(room > 0, room / STEP_PX, 0.0).astype(int)
    grid = np.linspace(0.0, 1.0, _OUTLINE)
    shares = [np.empty(0) for _ in edges]
    for k in np.flatnonzero(count >= _LEAST):
        places = ends[k] + (np.arange(count[k]) + 0.5) * room[k] / count[k]
        shares[k] = np.interp(places, along[k], grid)
    return shares


def pixels_of(points: Array, cam2world: Array, camera: Camera) -> Array:
    """Return images (n, 2) in px of points (n, 3) in mm; nan behind the camera."""
    local = world_to_cam(points, cam2world)
    depth = np.where(local[..., 2:] > 0, local[..., 2:], np.nan)
    return image_of(camera, local / depth)


def median_shift(before: Array, after: Array) -> float:
    """Return how far places in the image (n, 2) moved, px; nan, outside the lens's field, does not count."""
    return float(np.nanmedian(np.linalg.norm(after - before, axis=1)))


def across_of(points: Array, tangents: Array, cam2world: Array, camera: Camera) -> Array:
    """Return the unit vectors (n, 2) across edges in the image, to the right of where the tangents (n, 3) go."""
    size = np.linalg.norm(points - np.asarray(cam2world)[:3, 3], axis=1)[:, None]
    step = _AHEAD * size * tangents
    along = pixels_of(points + step, cam2world, camera) - pixels_of(
        points - step, cam2world, camera
    )
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
    return np.stack([-along[:, 1], along[:, 0]], axis=1)


def in_image(pixels: Array, camera: Camera, margin_px: float) -> NDArray[np.bool_]:
    """Return which places (n, 2) are on the sensor, with a margin."""
    limit = np.array(camera.resolution) - 1 - margin_px
    with np.errstate(invalid="ignore"):
        return np.asarray(np.all((pixels >= margin_px) & (pixels <= limit), axis=1))


# What measuring needs to know of a part, found once: its edges, the surfaces that carry them, the
# plan's targets.


POSE = 6
"""Numbers of a camera's displacement, which come first among the unknowns of an image."""

# a requested circle is the part's if centre and radius agree to this share of the radius
_SAME = 1e-3
# of arcs, rad
_ANGLE = 1e-3
# edges meet where their ends are this near
_MEETS_MM = 1e-3
# a stretch of an edge lies on it as near as this
_ON_MM = 1e-2
# cosine from which on a surface faces across an entity, and so moves its value
_ACROSS = 0.1


class PartModel:
    """Edges, surfaces and targets of a part.

    Parameters
    ----------
    solid : Solid
        The part.
    targets : mapping of str to Target
        What is measured, by name.
    area : AreaLight, optional
        See `PartEdges`.

    Attributes
    ----------
    edges : PartEdges
        All sharp edges, rims and arcs.
    measured : dict of str to tuple of PartEdge
        The entities of each target.
    carried_by : dict of str to (int, int)
        Numbers of the surfaces that carry each edge, by the edge's name.
    free_of : dict of str to set of int
        Surfaces whose deviation a target measures itself, by target.
    free : set of int
        Those of all targets.

    Raises
    ------
    RequestError
        If the part lacks an entity of a target.
    """

    def __init__(
        self, solid: Solid, targets: Mapping[str, Target], area: AreaLight | None = None
    ) -> None:
        self.solid = solid
        self.edges = PartEdges(solid, area)
        self.carriers = Carriers(solid)
        self._curves = {curve.id: curve for curve in (*solid.rims(), *solid.arcs())}
        self.carried_by: dict[str, tuple[int, int]] = {}
        for edge in self.edges.edges:
            self._carry(edge)
        self._shown: tuple[bytes, Camera, ShownEdges] | None = None
        self.measured = {
            name: tuple(self.entity(shape, name) for shape in target.geometry)
            for name, target in targets.items()
        }
        self.free_of = {
            name: self.free_surfaces(target.measurand, self.measured[name])
            for name, target in targets.items()
        }
        self.free = set().union(*self.free_of.values())

    @property
    def n_unknowns(self) -> int:
        """Number of unknowns of an image: the pose, and the deviations of all surfaces."""
        return POSE + PARAMETERS * len(self.carriers.surfaces)

    def unknowns_of(self, edge: PartEdge) -> NDArray[np.int64]:
        """Return which unknowns are those of the surfaces that carry an edge (6,)."""
        starts = POSE + PARAMETERS * np.array(self.carried_by[edge.name])
        return np.concatenate([start + np.arange(PARAMETERS) for start in starts])

    def displacement(self, edge: PartEdge, points: Array) -> Array:
        """Return how points (n, 3) of an edge move with `unknowns_of` it; (n, 3, 6)."""
        return self.carriers.displacement(self.carried_by[edge.name], points)

    def shown(self, cam2world: Array, camera: Camera) -> ShownEdges:
        """Return all edges as they are seen from a pose; what the pose asked for last shows is kept."""
        key = np.ascontiguousarray(cam2world).tobytes()
        if self._shown is None or self._shown[0] != key or self._shown[1] is not camera:
            self._shown = key, camera, self.edges.shown(cam2world, camera)
        return self._shown[2]

    def leaving(self, edge: PartEdge, end: Array) -> list[PartEdge]:
        """Return the straight edges that leave an end (3,) of an edge."""
        return [
            other
            for other in self.edges.edges
            if isinstance(other.geometry, Line)
            and not set(other.edge_ids) & set(edge.edge_ids)
            and min(np.linalg.norm(other.geometry.p - end), np.linalg.norm(other.geometry.q - end))
            < _MEETS_MM
        ]

    def _carry(self, edge: PartEdge) -> None:
        if edge.name in self._curves:
            pair = self.carriers.of_curve(self._curves[edge.name])
        else:
            pair = self.carriers.of_edge(edge.edge_ids[0])
        self.carried_by[edge.name] = pair

    def entity(self, geometry: Geometry, target: str) -> PartEdge:
        """Return the part's edge for an entity of a target."""
        if isinstance(geometry, Circle):
            return self._curve(geometry, target)
        from aspectgraph import resolve_entities
        from aspectgraph.exceptions import EntityError

        try:
            entity = resolve_entities(self.solid, {target: (geometry.p, geometry.q)})[target]
        except EntityError as error:
            if (stretch := self._stretch(geometry)) is not None:
                return stretch
            rule = "must be the one that was planned"
            raise RequestError.of_rule("part", rule, f"another: {error}".rstrip(".")) from error
        name = "+".join(f"e{i}" for i in entity.edge_ids)
        edge = self.edges.edge_of(name, geometry, entity.edge_ids)
        self._carry(edge)
        return edge

    def _stretch(self, line: Line) -> PartEdge | None:
        """Return the part's edge that a line is a stretch of, as long as the line; None if there is none."""
        for edge in self.edges.edges:
            shape = edge.geometry
            if not isinstance(shape, Line):
                continue
            ends = np.array([line.p, line.q]) - shape.p
            along = ends @ shape.direction
            off = np.linalg.norm(ends - along[:, None] * shape.direction, axis=1)
            if (
                off.max() <= _ON_MM
                and along.min() >= -_ON_MM
                and along.max() <= shape.length + _ON_MM
            ):
                return self.edges.edge_of(edge.name, line, edge.edge_ids)
        return None

    def _curve(self, geometry: Circle, target: str) -> PartEdge:
        allowed = _SAME * geometry.radius_mm
        for curve in self._curves.values():
            same_size = abs(curve.radius_mm - geometry.radius_mm) <= allowed
            if not same_size or np.linalg.norm(curve.centre - geometry.centre) > allowed:
                continue
            if _holds(curve, geometry):
                return next(edge for edge in self.edges.edges if edge.name == curve.id)
        raise RequestError.of_rule(
            "part", "must be the one that was planned", f"one without the rim or arc of {target!r}"
        )

    def free_surfaces(self, value: Measurand, edges: tuple[PartEdge, ...]) -> set[int]:
        """Return the surfaces whose deviation a value measures itself, given its entities."""
        if value.in_image:
            return self._free_ends(edges[0])
        free = set()
        for edge, frame in zip(edges, value.frames, strict=True):
            pair = self.carried_by[edge.name]
            if isinstance(edge.geometry, Line):
                for k in pair:
                    middle = edge.geometry.middle[None]
                    normal = self.carriers.surfaces[k].normals(middle)[0]
                    if abs(normal @ frame.y) > _ACROSS:
                        free.add(k)
            else:
                free.add(pair[1])
        return free

    def _free_ends(self, edge: PartEdge) -> set[int]:
        """Return the surfaces that end an edge: those of the edges that leave its ends, across it."""
        line = edge.geometry
        free: set[int] = set()
        if not isinstance(line, Line):
            return free
        for end in (line.p, line.q):
            for other in self.leaving(edge, end):
                for k in self.carried_by[other.name]:
                    normal = self.carriers.surfaces[k].normals(end[None])[0]
                    if abs(normal @ line.direction) > _ACROSS:
                        free.add(k)
        return free


def _holds(curve: Arc, geometry: Circle) -> bool:
    """Return whether a rim or arc is the one of a circle's angles: one circle may carry several arcs."""
    span = curve.end_rad - curve.start_rad
    if span < geometry.span_rad - _ANGLE:
        return False
    if span >= 2 * np.pi - _ANGLE:
        return True
    (middle,) = geometry.points(np.array([geometry.span_rad / 2])) - geometry.centre
    across = np.cross(curve.axis, curve.reference)
    angle = float(np.arctan2(middle @ across, middle @ curve.reference))
    return bool((angle - curve.start_rad) % (2 * np.pi) <= span)
