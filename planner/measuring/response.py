"""Whether grey values are proportional to light, tested on the edges of the images themselves.

A step of light that is blurred by a symmetric kernel is symmetric. Gamma bends it: its steepest place moves to the dark
side. So the power of the grey values that makes all edges symmetric is the camera's response. Single edges are
asymmetric for other reasons, too: what is broken, shaded or lit by its neighbours. So the standard deviation of the
power is that of its spread over edges, not over points.

Notation
--------
t   place across an edge, in blurs from its middle      P(t)   the normal distribution function
L   light, as a share of full exposure                  a, b   light on the dark and on the bright side

Each profile is fitted by L = a + (b - a) (P + B P (1 - P)), least squares in a, b, B, middle and blur. B is its
asymmetry. Light to the power 1 + e is L + e L ln L to the first order. The same fit to L ln L of the fitted step gives
K. So B = e K + what is wrong with the edge.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation
from scipy.special import ndtr, stdtrit

from ground.convert import Key, Meta
from planner.camera.response import LINEAR, VIDEO_BLACK, Response
from planner.measuring.images import ASSUMED, FILE, STATED, Picture
from planner.measuring.reading import Reading
from planner.measuring.registered import NumberOrNull, Registered
from planner.measuring.samples import PartModel, State, across_of, pixels_of, profiles_of

Array = NDArray[np.float64]

EDGES = "edges"
"""The origin of a response that the edges of the images show."""
CURVED = 0.1
"""Grey values are clearly not proportional to light if gamma is off by more than this."""
CURVED_SIGMAS = 2.5
"""And so many standard deviations more."""
LEAST_CURVED = 0.3
"""Cameras with gamma are off by more than this: gamma 1.4 and more. What is less is from broken edges."""
LARGEST_GAMMA = 3.5
"""No usual camera has a larger one, so broken edges are likelier."""
TOLD = 0.3
"""With a larger standard deviation of gamma, edges do not show it well enough for nothing to be said."""
REFUSED_SD = 0.4
"""With a larger standard deviation, values in light by a gamma from edges are not measured."""
MOST_SD = 0.8
"""Standard deviation of gamma that is assumed where edges show nothing: cameras have 1 or about 2.2."""
MOST_SHARE = 0.8
"""A gamma from edges may make this share of a value's variance at most; otherwise the value is not measured."""
LEAST_SD = 0.05
"""Least standard deviation of a gamma from edges: on rendered parts with true steps it is off by about this much."""
USUAL_BLACK = -0.02
"""Black of usual cameras, a share of full exposure: 0 of a gamma, -0.055 of sRGB, -0.1 of Rec. 709, 0.06 of video."""
BLACK_SD = 0.045
"""Its standard deviation."""
SOURCE = "response"
"""The part of a value's variance that is from the response."""

MOST_PROFILES = 3000
"""So many profiles are fitted at most."""
FEWEST_EDGES = 4
"""From fewer edges nothing is estimated."""

# sections of an edge that count on their own: light changes along it
_SECTIONS = 12
_OF_SECTION = 6
# the usual spread of profiles counts as much as so many profiles of a section
_FEW = 5.0
# of this spread, what is wrong with an edge itself is this share at least
_OWN_SHARE = 0.2
_FIT_ROUNDS = 5
# half of what is fitted of a profile, in blurs, and its limits in px
_HALF = 2.8
_LEAST_HALF_PX = 2.5
_MOST_HALF_PX = 4.25
_MOST_OFF_PX = 0.75
_BLURS_PX = (0.4, 3.5)
# variance of linear interpolation between pixels, and places and shares that have it
_BETWEEN_PX2 = 1 / 6
_BETWEEN = ((-math.sqrt(0.5), 1 / 6), (0.0, 2 / 3), (math.sqrt(0.5), 1 / 6))
_LEAST_SHARE = 0.25
_MOST_ASYMMETRY = 4.0
_MOST_MISFIT = 0.06
_TIMES_MISFIT = 2.5
_DARKEST = 2e-3
_RIDGE = 1e-9
# columns of a symmetric step; the next one is what makes it asymmetric
_SYMMETRIC = 4
_TUKEY = 4.685
# of the search for the curve: limits, largest steps, and what is as good as its end
_POWERS = (0.4, 4.0)
_BLACKS = (-0.12, 0.1)
_MOST_STEP = 0.4
_SHIFT = 0.05
_SEARCH_ROUNDS = 12
_STILL = 0.004
_NEARLY_STILL = 0.02
_SLOPE_TIMES = 1.15
_TIMES_UNCLEAR = 2.0
_LEAST_SLOPE = 0.3
_TAIL = 0.975
_USUAL = 1.96
# half of a profile, which is as long as it is sampled
_REACH_PX = 4.5
_FEWEST_OF_SECTION = 3


class Places(NamedTuple):
    """Where edges were found in an image.

    Attributes
    ----------
    centres, across : array (n, 2)
        Places, px, and unit vectors across.
    edge, section : array of int (n,)
        Numbers of the part's edge, and of its section.
    blur_px : array (n,)
        Blur across.
    """

    centres: Array
    across: Array
    edge: NDArray[np.int64]
    section: NDArray[np.int64]
    blur_px: Array


class Steps(NamedTuple):
    """Fitted profiles (n,): their asymmetry B, their K for power and black (n, 2), and which are steps at all."""

    asymmetry: Array
    sensitivity: Array
    good: NDArray[np.bool_]


class PowerEstimate(NamedTuple):
    """The power of light that is left.

    Attributes
    ----------
    excess : float
        e: light as it is now is the right one to the power 1 + e.
    sd : float
        Its standard deviation, from the spread over edges; infinite if these are too few.
    edges : int
        Edges that it is from.
    """

    excess: float
    sd: float
    edges: int


def found_places(
    model: PartModel, picture: Picture, registered: Registered, half_px: float
) -> Places:
    """Return where the edges of a part are found in a registered image, both creases and outlines.

    Parameters
    ----------
    model : PartModel
        The part.
    picture : Picture
        The image.
    registered : Registered
        Its pose.
    half_px : float
        How far from their predictions edges are searched, px.
    """
    camera = picture.camera
    pose = registered.cam2world
    shown = model.shown(pose, camera)
    edges = model.edges.edges
    samples = shown.samples.chosen(
        shown.apart(edges, shown.samples.edge, shown.pixels, min(half_px, 5.0))
    )
    points = samples.points.copy()
    for k in np.unique(samples.edge):
        of_edge = samples.edge == k
        points[of_edge] = registered.moved(model, edges[k], points[of_edge])
    centres = pixels_of(points, pose, camera)
    across = across_of(points, samples.tangents, pose, camera)
    scans = picture.find(centres, across, half_px)
    places = np.flatnonzero(scans.state == State.FOUND)
    section = np.minimum((samples.share * _SECTIONS).astype(np.int64), _SECTIONS - 1)
    return Places(
        centres[places] + scans.offset[places, None] * across[places],
        across[places],
        samples.edge[places],
        section[places],
        scans.blur_px[places],
    )


def thinned(places: Sequence[Places]) -> list[Places]:
    """Return evenly fewer places of each image, so that all together are not too many."""
    total = sum(len(image.edge) for image in places)
    step = max(1, math.ceil(total / MOST_PROFILES))
    return [
        Places(
            image.centres[::step],
            image.across[::step],
            image.edge[::step],
            image.section[::step],
            image.blur_px[::step],
        )
        for image in places
    ]


def fitted_steps(places: Array, light: Array, blur_px: Array, response: Response = LINEAR) -> Steps:
    """Return the asymmetry of profiles.

    Parameters
    ----------
    places : array (k,)
        Places along profiles, px.
    light : array (n, k)
        Light there, as a share of full exposure; nan off the image.
    blur_px : array (n,)
        About their blur.
    response : Response
        By what grey values became this light: a power.
    """
    inside = np.asarray(np.isfinite(light).all(axis=1))
    light = np.where(inside[:, None], light, 0.0)
    blur = np.clip(np.hypot(blur_px, 0.5), *_BLURS_PX)
    middle = np.zeros(len(light))
    half = np.clip(_HALF * blur, _LEAST_HALF_PX, _MOST_HALF_PX)
    # a symmetric step is fitted: its middle, and what makes it asymmetric, can hardly be told apart in a few pixels
    for _ in range(_FIT_ROUNDS):
        columns, counts = _columns(places, middle, blur, half)
        numbers = _solved(columns[..., :_SYMMETRIC], counts, light)
        height = np.where(np.abs(numbers[:, 1]) > 1e-9, numbers[:, 1], 1e-9)
        # density and its slope are what a shift and a wider blur change
        middle = middle + np.clip(-numbers[:, 2] / height * blur, -0.4, 0.4)
        blur = np.clip(blur * np.clip(1 - numbers[:, 3] / height, 0.7, 1.4), *_BLURS_PX)
    # asymmetry and sensitivity are shares of one and the same column at this step
    columns, counts = _columns(places, middle, blur, half)
    numbers = _solved(columns, counts, light)
    height = np.where(np.abs(numbers[:, 1]) > 1e-9, numbers[:, 1], 1e-9)
    residual = light - (columns @ numbers[..., None])[..., 0]
    misfit = np.sqrt((counts * residual**2).sum(axis=1) / counts.sum(axis=1)) / np.abs(height)
    asymmetry = numbers[:, _SYMMETRIC] / height
    # light is bent at pixels, and what is between them is interpolated after that
    before = np.sqrt(np.maximum(blur**2 - _BETWEEN_PX2, _LEAST_SHARE * blur**2))
    bent = np.zeros((*light.shape, 2))
    for shift, share in _BETWEEN:
        at = (places + shift - middle[:, None]) / before[:, None]
        smooth = np.maximum(numbers[:, :1] + height[:, None] * ndtr(at), _DARKEST)
        bent[..., 0] += share * smooth * np.log(smooth)
        bent[..., 1] += share * _by_black(smooth, response)
    of_bent = [_solved(columns, counts, bent[..., k])[:, _SYMMETRIC] for k in range(2)]
    sensitivity = np.stack(of_bent, axis=1) / height[:, None]
    good = inside & (np.abs(middle) < _MOST_OFF_PX) & (misfit < _MOST_MISFIT)
    usual = float(np.median(misfit[good])) if good.any() else 0.0
    good &= misfit < _TIMES_MISFIT * usual
    good &= (blur > _BLURS_PX[0]) & (blur < _BLURS_PX[1]) & (np.abs(asymmetry) < _MOST_ASYMMETRY)
    return Steps(asymmetry, sensitivity, good)


def _columns(places: Array, middle: Array, blur: Array, half: Array) -> tuple[Array, Array]:
    """Return what profiles are made of (n, k, 5), what is asymmetric last, and which places count (n, k).

    Parameters
    ----------
    places : array (k,)
        Places along profiles, px.
    middle, blur, half : array (n,)
        Of each step; places count up to ``half`` from its middle, px.
    """
    t = (places - middle[:, None]) / blur[:, None]
    counts = (np.abs(places - middle[:, None]) <= half[:, None]).astype(np.float64)
    density = np.exp(-0.5 * t**2) / math.sqrt(2 * math.pi)
    step = ndtr(t)
    parts = [np.ones_like(step), step, density, density * t, step * (1 - step)]
    return np.stack(parts, axis=2), counts


def _solved(columns: Array, counts: Array, light: Array) -> Array:
    """Return how much of each column (n, k, c) profiles (n, k) have, by least squares over the places that count."""
    weighted = (columns * counts[..., None]).transpose(0, 2, 1)
    normal = weighted @ columns + _RIDGE * np.eye(columns.shape[2])
    return np.asarray(np.linalg.solve(normal, weighted @ light[..., None])[..., 0])


def _by_black(light: Array, response: Response) -> Array:
    """Return how light (...) changes with the black that it is computed with, less what leaves edges symmetric."""
    # nothing is known of black that is raised to a power below 1
    gamma = max(response.gamma, 1.0)
    return np.asarray(gamma / (1 - response.black) * light ** (1 - 1 / gamma))


class Sections(NamedTuple):
    """Medians of the profiles of sections of edges (m,).

    Attributes
    ----------
    asymmetry, sensitivity : array (m,), (m, 2)
        As those of `Steps`.
    sigma : array (m,)
        Standard deviation of the asymmetry.
    edge : array of int (m,)
        Numbers of the edges, from 0.
    edges : int
        How many there are.
    """

    asymmetry: Array
    sensitivity: Array
    sigma: Array
    edge: NDArray[np.int64]
    edges: int

    @classmethod
    def of(
        cls,
        steps: Steps,
        edge: NDArray[np.int64],
        section: NDArray[np.int64],
        phase: Array | None = None,
    ) -> Sections:
        """Return the sections of profiles (n,); takes what `estimated_power` takes."""
        good = np.flatnonzero(steps.good)
        order = good[np.lexsort((section[good], edge[good]))]
        ends = np.diff(edge[order]) + np.diff(section[order]) != 0
        groups = np.split(order, np.flatnonzero(ends) + 1)
        groups = [group for group in groups if len(group) >= _FEWEST_OF_SECTION]
        if not groups:
            nothing = np.zeros(0)
            return cls(nothing, np.zeros((0, 2)), nothing, np.zeros(0, np.int64), 0)
        names, cluster = np.unique(
            np.array([edge[group[0]] for group in groups], dtype=np.int64), return_inverse=True
        )
        asymmetry = np.array([np.median(steps.asymmetry[group]) for group in groups])
        sensitivity = np.array([np.median(steps.sensitivity[group], axis=0) for group in groups])
        size = np.array([len(group) for group in groups], dtype=np.float64)
        spread = [
            1.4826 * np.median(np.abs(steps.asymmetry[group] - middle))
            for group, middle in zip(groups, asymmetry, strict=True)
        ]
        usual = float(np.median(spread))
        # a few profiles hardly show their own spread
        noise = (np.array(spread) * size + usual * _FEW) / (size + _FEW)
        common = np.full(len(groups), _OWN_SHARE)
        if phase is not None:
            # pixels sample all profiles of a section in the same way where an edge runs along them
            turns = np.exp(2j * math.pi * phase)
            common = np.hypot(common, [abs(turns[group].mean()) for group in groups])
        sigma = np.sqrt(noise**2 / size + (common * usual) ** 2)
        return cls(asymmetry, sensitivity, np.maximum(sigma, 1e-6), cluster, len(names))


def estimated_power(
    steps: Steps,
    edge: NDArray[np.int64],
    section: NDArray[np.int64],
    phase: Array | None = None,
) -> PowerEstimate:
    """Return the power that is left in the light of profiles.

    Medians of sections of edges are what counts, robustly (Tukey). The standard deviation is from the spread over edges
    and enlarged by Student's factor, because a broken edge is asymmetric as a whole.

    Parameters
    ----------
    steps : Steps
        Fitted profiles (n,).
    edge, section : array of int (n,)
        Numbers of the edge of each, the same in all images, and of its section.
    phase : array (n,), optional
        Where each step is between pixels, px. Default: anywhere.
    """
    sections = Sections.of(steps, edge, section, phase)
    if sections.edges < FEWEST_EDGES:
        return PowerEstimate(0.0, math.inf, sections.edges)
    fit, covariance = _robust_fit(sections, np.zeros((1, 1)), np.zeros(1))
    return PowerEstimate(float(fit[0]), math.sqrt(covariance[0, 0]), sections.edges)


def _robust_fit(sections: Sections, precision: Array, expected: Array) -> tuple[Array, Array]:
    """Return the power that is left and, if wanted, the black (p,), and their covariance.

    Parameters
    ----------
    sections : Sections
        The sections.
    precision, expected : array (p, p), (p,)
        Of what is known beforehand.
    """
    count = len(expected)
    x = sections.sensitivity[:, :count] / sections.sigma[:, None]
    y = sections.asymmetry / sections.sigma
    fit: Array = np.zeros(count)
    fit[0] = _median_slope(x[:, 0], y)
    for _ in range(_FIT_ROUNDS):
        residual = y - x @ fit
        scale = max(1.4826 * float(np.median(np.abs(residual))), 1e-6)
        weight = np.maximum(1 - (residual / (_TUKEY * scale)) ** 2, 0.0) ** 2 / scale**2
        normal = x.T @ (weight[:, None] * x) + precision
        right = x.T @ (weight * y) + precision @ expected
        fit = np.asarray(np.linalg.solve(normal, right), dtype=np.float64)
    # what edges push the fit by, each as a whole
    scores = np.zeros((sections.edges, count))
    np.add.at(scores, sections.edge, (weight * (y - x @ fit))[:, None] * x)
    inverse = np.linalg.inv(normal)
    # without an edge the others would have fitted it worse
    factor = float(stdtrit(sections.edges - 1, _TAIL)) / _USUAL
    meat = sections.edges / (sections.edges - 1) * (scores.T @ scores) + precision
    return fit, factor**2 * inverse @ meat @ inverse


def _median_slope(x: Array, y: Array) -> float:
    """Return the slope of a line through the origin for which the sum of absolute residuals is least."""
    slopes = y / np.where(x == 0, 1e-9, x)
    order = np.argsort(slopes)
    total = np.cumsum(np.abs(x[order]))
    return float(slopes[order][np.searchsorted(total, total[-1] / 2)])


class Curve(NamedTuple):
    """The response that edges show: a power of grey values above black.

    Attributes
    ----------
    gamma, black : float
        The power, and black as a share of full exposure. sRGB is nearly 2.4 and -0.055.
    covariance : array (2, 2)
        Of the logarithm of gamma and of black.
    """

    gamma: float
    black: float
    covariance: Array

    @property
    def response(self) -> Response:
        """The response."""
        return Response.power(self.gamma, self.black)

    @property
    def usual_gamma(self) -> float:
        """The gamma that is nearest at half of full exposure: people know responses by it."""
        return self.gamma * 0.5 / (0.5 - self.black)

    @property
    def sd(self) -> float:
        """Standard deviation of this."""
        slope = np.array([1.0, 1 / (0.5 - self.black)])
        return self.usual_gamma * math.sqrt(float(slope @ self.covariance @ slope))

    @property
    def is_bent(self) -> bool:
        """Whether it is no straight line; otherwise edges are asymmetric for other reasons, such as chamfers."""
        return abs(self.usual_gamma - 1) > CURVED_SIGMAS * self.sd

    def others(self) -> list[Response]:
        """Return responses one standard deviation away, along both axes of the covariance."""
        sizes, axes = np.linalg.eigh(self.covariance)
        moves = (axes * np.sqrt(np.maximum(sizes, 0.0))).T
        return [
            Response.power(
                float(np.clip(self.gamma * math.exp(move[0]), *_POWERS)),
                float(np.clip(self.black + move[1], *_BLACKS)),
            )
            for move in moves
        ]


class Profiles:
    """The profiles of found edges of several images.

    Parameters
    ----------
    pictures : sequence of Picture
        The images.
    places : sequence of Places
        Where edges are in each.
    """

    def __init__(self, pictures: Sequence[Picture], places: Sequence[Places]) -> None:
        self._pictures = list(pictures)
        self._places = thinned(places)
        none = np.zeros(0, dtype=np.int64)
        self._edge = np.concatenate([none, *(image.edge for image in self._places)])
        section = np.concatenate([none, *(image.section for image in self._places)])
        self._blur = np.concatenate([np.zeros(0), *(image.blur_px for image in self._places)])
        # sections of one edge in several images are several, and the edge is one
        image = np.repeat(
            np.arange(len(self._places)), [len(image_places.edge) for image_places in self._places]
        )
        self._section = section + _SECTIONS * image
        self._phase = np.concatenate([np.zeros(0), *map(_phase, self._places)])
        self._near = [
            np.flatnonzero(_near(image_places, picture.levels.shape))
            for image_places, picture in zip(self._places, self._pictures, strict=True)
        ]

    @classmethod
    def found(
        cls,
        model: PartModel,
        pictures: Mapping[str, Picture],
        registered: Mapping[str, Registered],
        half_px: float,
    ) -> Profiles:
        """Return the profiles of all found edges of registered images, see `found_places`; others do not count."""
        names = [name for name in pictures if name in registered]
        places = [found_places(model, pictures[name], registered[name], half_px) for name in names]
        return cls([pictures[name] for name in names], places)

    def steps(self, response: Response | None = None, coarse: int | None = None) -> Steps:
        """Return the fitted steps in the light of a response, or as images have it.

        Parameters
        ----------
        response : Response, optional
            By what grey values become light. Default: that of each image.
        coarse : int, optional
            Which neighbours are made equal: an even grey value and the next one (0), or an odd one (1). Default: none.
        """
        places = np.zeros(1)
        parts = []
        for picture, image_places, near in zip(
            self._pictures, self._places, self._near, strict=True
        ):
            image = picture.grey
            if response is not None or coarse is not None:
                # what is between pixels is interpolated in light; most pixels are not near an edge
                image = np.zeros_like(picture.levels)
                levels = picture.levels.ravel()[near]
                if coarse is not None:
                    levels = 2 * np.floor((levels + coarse) / 2) - coarse + np.float32(0.5)
                image.ravel()[near] = (response or picture.response).applied(levels, picture.white)
            places, values = profiles_of(image, image_places.centres, image_places.across, 1.0)
            parts.append(values / picture.white)
        return fitted_steps(places, np.concatenate(parts), self._blur, response or LINEAR)

    def power(self, response: Response | None = None) -> PowerEstimate:
        """Return the power that is left in the light of a response, or as images have it.

        Faces of one brightness are rounded alike, so edges do not show by their spread what rounding does. It is the
        more, the darker an image is. So it is tried: grey values of half as many levels are off by the square root of
        three times as much again.
        """
        if not len(self._edge):
            return PowerEstimate(0.0, math.inf, 0)
        power = self._power(self.steps(response))
        if not math.isfinite(power.sd) or min(picture.white for picture in self._pictures) <= 1:
            return power
        shifts = [
            self._power(self.steps(response, coarse)).excess - power.excess for coarse in (0, 1)
        ]
        rounding = math.hypot(*shifts) / math.sqrt(2 * 3)
        return power._replace(sd=math.hypot(power.sd, rounding))

    def _power(self, steps: Steps) -> PowerEstimate:
        return estimated_power(steps, self._edge, self._section, self._phase)

    def curve(self) -> Curve | None:
        """Return the response that edges show; None if there is none that explains them."""
        gamma = 1.0
        black = 0.0
        precision = np.diag([0.0, 1 / BLACK_SD**2])
        covariance = np.zeros((2, 2))
        step = 0.0
        share = 1.0
        for _ in range(_SEARCH_ROUNDS):
            steps = self.steps(Response.power(gamma, black))
            sections = Sections.of(steps, self._edge, self._section, self._phase)
            if sections.edges < FEWEST_EDGES:
                return None
            expected = np.array([0.0, USUAL_BLACK - black])
            (excess, shift), covariance = _robust_fit(sections, precision, expected)
            if excess * step < 0:
                # robust weights jump near the end, and steps would go to and fro
                share /= 2
            step = share * min(max(float(excess), -_MOST_STEP), _MOST_STEP)
            gamma = float(np.clip(gamma * math.exp(-step), *_POWERS))
            black = float(np.clip(black + min(max(float(shift), -_SHIFT), _SHIFT), *_BLACKS))
            if abs(step) < _STILL and abs(shift) < _STILL:
                break
        if abs(step) > _NEARLY_STILL:
            return None
        # a larger power is a smaller gamma
        scale = np.diag([-1 / self._slope(gamma, black), 1.0])
        floor = np.diag([LEAST_SD**2, 0.0])
        return Curve(gamma, black, scale @ covariance @ scale + floor)

    def _slope(self, gamma: float, black: float) -> float:
        """Return by how much the power that is left changes with the logarithm of gamma: 1 without noise."""
        low, high = (
            self._power(self.steps(Response.power(gamma * times, black))).excess
            for times in (1 / _SLOPE_TIMES, _SLOPE_TIMES)
        )
        slope = (high - low) / (2 * math.log(_SLOPE_TIMES))
        return float(np.clip(slope, _LEAST_SLOPE, 1.0))


def _phase(places: Places) -> Array:
    """Return where edges cross the nearest row of pixels (n,), px; of edges nearer to a row's direction, the column."""
    rows = np.abs(places.across[:, :1]) >= np.abs(places.across[:, 1:])
    centres = np.where(rows, places.centres, places.centres[:, ::-1])
    across = np.where(rows, places.across, places.across[:, ::-1])
    off = centres[:, 1] - np.round(centres[:, 1])
    return np.asarray(centres[:, 0] + off * across[:, 1] / across[:, 0])


def _near(places: Places, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Return the pixels (h, w) that profiles are interpolated from."""
    mask = np.zeros(shape, dtype=bool)
    along = np.stack([-places.across[:, 1], places.across[:, 0]], axis=1)
    reach = np.arange(-_REACH_PX, _REACH_PX + 0.25, 0.5)
    for side in (-1.0, -0.5, 0.0, 0.5, 1.0):
        start = places.centres + side * along
        points = start[:, None] + reach[:, None] * places.across[:, None]
        u, v = np.floor(points).astype(np.int64).reshape(-1, 2).T
        inside = (u >= 0) & (v >= 0) & (u < shape[1]) & (v < shape[0])
        mask[v[inside], u[inside]] = True
    # what is between steps, and the neighbours that are interpolated with
    return binary_dilation(mask, np.ones((3, 3), dtype=bool))


@dataclass(frozen=True)
class ResponseRecord:
    """The response of an image, and what says so.

    The camera does, the image file, or the edges; it is assumed where these show nothing. The gamma that edges show in
    what is measured is 1 within its standard deviation.
    """

    curve: str
    black: float
    origin: Annotated[str, Key("from"), Meta(pattern="^(camera|file|edges|assumed)$")]
    remaining_gamma: NumberOrNull = math.nan
    gamma_sd: NumberOrNull = math.nan


def _position_vector(reading: Reading) -> Array:
    """Return what is measured of a position: its deviation, and its size if there is one."""
    has_size = len(reading.covariance_mm2) > len(reading.deviation_mm)
    return np.array([*reading.deviation_mm, *((reading.size_mm,) * has_size)])


def _apart(reading: Reading, other: Reading) -> Array:
    """Return the covariance that a position has by how it differs in another image; all of it if it is not there."""
    if not other.measured:
        return np.array(reading.covariance_mm2)
    apart = _position_vector(other) - _position_vector(reading)
    return np.outer(apart, apart)


@dataclass(frozen=True)
class JudgedResponse:
    """What the edges of all images say of the response.

    Attributes
    ----------
    pictures : dict of str to Picture
        The images, in the light that is measured.
    gamma : float
        Gamma that edges show in it; 1 of light.
    sd : float
        Its standard deviation.
    others : list of dict of str to Picture
        The images in light that is one standard deviation off, each in another way; none where the user states the
        response.
    note : str
        What the user should know; empty if nothing.
    reason : str
        Why values are not measured in which the response counts too much; empty if they are.
    is_changed : bool
        Whether the light is not the one before.
    """

    pictures: dict[str, Picture]
    gamma: float
    sd: float
    others: list[dict[str, Picture]] = field(default_factory=list)
    note: str = ""
    reason: str = ""
    is_changed: bool = False

    @property
    def is_refused(self) -> bool:
        """Whether nothing is measured at all."""
        return bool(self.reason) and not math.isfinite(self.sd)

    def counted(self, reading: Reading, others: Sequence[Reading]) -> Reading:
        """Return a reading whose variance has the part of the response.

        Parameters
        ----------
        reading : Reading
            The reading.
        others : sequence of Reading
            The same in each of the other images.
        """
        if not reading.measured:
            return reading
        if self.is_refused:
            return _refused(reading, self.reason)
        variance = 0.0
        covariance = np.array(reading.covariance_mm2)
        for other in others:
            # what is not measured there at all is off by as much as it is uncertain
            off = other.value - reading.value if other.measured else reading.standard_uncertainty
            variance += off**2
            if reading.deviation_mm:
                apart = _position_vector(other) - _position_vector(reading)
                # as a share of what is known of it
                missing = np.array(reading.covariance_mm2)
                covariance += np.outer(apart, apart) if other.measured else missing
        total = reading.standard_uncertainty**2 + variance
        if self.reason and variance > MOST_SHARE * total:
            return _refused(reading, self.reason)
        u = math.sqrt(total)
        times = u / reading.standard_uncertainty if reading.standard_uncertainty > 0 else 1.0
        return replace(
            reading,
            standard_uncertainty=u,
            budget={**reading.budget, SOURCE: variance},
            drawn_uncertainty=times * reading.drawn_uncertainty,
            covariance_mm2=tuple(map(tuple, covariance.tolist())),
        )

    def notes(self, readings: Mapping[str, Sequence[Reading]]) -> list[str]:
        """Return what the user should know, given all readings: of an uncertainty only if a value has one."""
        has_value = any(reading.measured for group in readings.values() for reading in group)
        return [self.note] if self.note and (has_value or self.reason) else []

    def records(self) -> dict[str, ResponseRecord]:
        """Return what files say of it, by image."""
        return {
            name: ResponseRecord(
                picture.response.text,
                picture.response.black,
                picture.response_from,
                _finite(self.gamma),
                _finite(self.sd),
            )
            for name, picture in self.pictures.items()
        }


def _finite(value: float) -> float:
    return value if math.isfinite(value) else math.nan


def _refused(reading: Reading, reason: str) -> Reading:
    return replace(
        reading,
        value=math.nan,
        standard_uncertainty=math.nan,
        budget={},
        reason=reason,
        drawn_uncertainty=math.nan,
        notes=(),
    )


def judge_response(
    model: PartModel,
    pictures: Mapping[str, Picture],
    registered: Mapping[str, Registered],
    half_px: float,
    is_broken: bool = False,
) -> JudgedResponse:
    """Test the response of the images of one camera by all edges that are found in them.

    A user is believed, and contradicted in a note. A file, and that grey values are proportional to light where nothing
    is stated, is believed unless edges clearly show another gamma. Then this one is used, unless edges are broken.

    Parameters
    ----------
    model, pictures, registered, half_px
        As of `found_places`.
    is_broken : bool
        Whether images show that edges are broken, or the user states it: such edges are asymmetric in light.
    """
    area = model.edges.area
    untold = PowerEstimate(0.0, math.inf, 0) if area is not None and area.on_metal else None
    profiles = Profiles.found(model, pictures, registered, half_px)
    power = untold or profiles.power()
    origins = {picture.response_from for picture in pictures.values()}
    stated = " and ".join(sorted({picture.response.words for picture in pictures.values()}))
    if STATED in origins or not registered:
        note = ""
        if is_clear(power):
            note = f"edges contradict the stated response ({stated}): {_left_text(power)}; measured as stated"
        elif untold is None and not is_broken and (gamma := _linear_after_all(profiles, pictures)):
            note = (
                f"edges contradict the stated response ({stated}): grey values look proportional to light "
                f"(gamma {gamma}); measured as stated"
            )
        return JudgedResponse(dict(pictures), *_gamma_of(power), note=note)
    if not is_clear(power):
        return _believed(pictures, power, FILE in origins)
    plain = {name: picture.under(LINEAR, EDGES) for name, picture in pictures.items()}
    if FILE not in origins:
        return _measured_curve(profiles, plain, "", is_broken)
    power = profiles.power(LINEAR)
    if is_clear(power):
        return _measured_curve(profiles, plain, f"the files state {stated}, but ", is_broken)
    note = (
        f"the files state {stated}, but grey values are proportional to light (gamma {_gamma_text(power)}): "
        "measured so; state response"
    )
    return replace(_believed(plain, power, True), note=note, is_changed=True)


def _linear_after_all(profiles: Profiles, pictures: Mapping[str, Picture]) -> str:
    """Return the gamma that edges show in the grey values themselves; empty unless it is 1 and the stated one is not.

    Light that a wrong response bends a lot is too far from light for the powers to be of first order. Grey values that
    are proportional to light are not.
    """
    power = profiles.power(LINEAR)
    if is_clear(power):
        return ""
    powers = [1 / picture.response.power_at_half - 1 for picture in pictures.values()]
    is_bent = all(abs(power.excess - e) > CURVED + CURVED_SIGMAS * power.sd for e in powers)
    return _gamma_text(power) if is_bent else ""


def is_clear(power: PowerEstimate) -> bool:
    """Return whether edges clearly show that light is not what it is taken for."""
    return abs(power.excess) > CURVED + CURVED_SIGMAS * power.sd


def _gamma_of(power: PowerEstimate) -> tuple[float, float]:
    """Return the gamma that is left, and its standard deviation: light to the power of 1 / gamma is what is there."""
    gamma = 1 / max(1 + power.excess, 0.1)
    return gamma, power.sd * gamma


def _left_text(power: PowerEstimate) -> str:
    """Say which gamma edges show in the light of a response, if a camera may have it."""
    if not 1 / LARGEST_GAMMA <= _gamma_of(power)[0] <= LARGEST_GAMMA:
        return "no gamma explains what they show, as if light was uneven next to them"
    return f"gamma {_gamma_text(power)} is left in its light"


def _gamma_text(power: PowerEstimate) -> str:
    gamma, sd = _gamma_of(power)
    return f"{gamma:.2g} ± {2 * sd:.1g}"


def _believed(
    pictures: Mapping[str, Picture], power: PowerEstimate, is_stated: bool
) -> JudgedResponse:
    """Return what is measured in the light as it is taken."""
    doubt = min(max(power.sd, abs(power.excess)), MOST_SD)
    note = ""
    if doubt > TOLD:
        note = (
            "edges do not show whether grey values are proportional to light: "
            f"U allows for a gamma off by {doubt:.1g}; state response"
        )
        if is_stated:
            note = (
                "edges do not show whether the response that the files state is right: "
                f"U allows for a gamma off by {doubt:.1g}; state response"
            )
    chosen = dict(pictures)
    for name, picture in pictures.items():
        if picture.response_from == ASSUMED and doubt <= TOLD:
            chosen[name] = replace(picture, response_from=EDGES)
    bent = {name: picture.raised(1 + doubt) for name, picture in pictures.items()}
    return JudgedResponse(chosen, *_gamma_of(power), [bent], note)


def _measured_curve(
    profiles: Profiles, plain: Mapping[str, Picture], but: str, is_broken: bool
) -> JudgedResponse:
    """Return what is measured in the light of the response that edges show.

    Parameters
    ----------
    profiles : Profiles
        Of the images.
    plain : mapping of str to Picture
        The images as if grey values were light.
    but : str
        How a note begins.
    is_broken : bool
        Whether edges are broken.
    """
    curve = profiles.curve()
    power = profiles.power(LINEAR)
    is_straight = power.excess > -LEAST_CURVED or (curve is not None and not curve.is_bent)
    # what no response explains is light that changes next to edges, such as that of a ring
    if is_broken or is_straight or curve is None:
        # the power that symmetric edges would show may be twice as large
        power = power._replace(sd=_TIMES_UNCLEAR * max(power.sd, abs(power.excess)))
        straight = _believed(plain, power, bool(but))
        note = (
            f"{but}edges are not symmetric, because of gamma, uneven light or breaks: "
            f"U allows for a gamma off by {min(power.sd, MOST_SD):.1g}; state response"
        )
        return replace(straight, note=note, is_changed=bool(but))
    gamma = curve.usual_gamma
    about = f" (gamma about {gamma:.2g})"
    reason = f"grey values are not proportional to light{about}: switch gamma off or state response"
    if not curve.sd < REFUSED_SD:
        return JudgedResponse(dict(plain), math.nan, math.inf, note=f"{but}{reason}", reason=reason)
    black = ""
    if curve.black > VIDEO_BLACK / 2:
        black = f", black about {255 * curve.black:.0f} of 255"
    what_to_do = "state response or switch gamma off"
    if gamma > LARGEST_GAMMA:
        what_to_do = "no camera has it, so edges may be broken; state edges and response"
    note = (
        f"{but}grey values are not proportional to light (gamma about {gamma:.2g} ± {2 * curve.sd:.1g}{black}): "
        f"measured with this gamma; {what_to_do}"
    )
    images = [
        {name: picture.under(response, EDGES) for name, picture in plain.items()}
        for response in (curve.response, *curve.others())
    ]
    return JudgedResponse(
        images[0], 1.0, curve.sd / gamma, images[1:], note, reason, is_changed=True
    )
