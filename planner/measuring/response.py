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
from dataclasses import dataclass, replace
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr
from scipy.stats import t as student

from ground.convert import Key, Meta
from planner.camera.response import LINEAR, VIDEO_BLACK, Response
from planner.measuring.images import ASSUMED, FILE, STATED, Picture
from planner.measuring.reading import Reading
from planner.measuring.registered import NumberOrNull, Registered
from planner.measuring.samples import PartModel, State, across_of, pixels_of, profiles_of

Array = NDArray[np.float64]

EDGES = "edges"
"""The origin of a response that the edges of the images show."""
CURVED = 0.15
"""Grey values are clearly not proportional to light if gamma is off by more than this."""
CURVED_SIGMAS = 3.0
"""And by more than so many standard deviations."""
TOLD = 0.3
"""With a larger standard deviation of gamma, edges do not show it well enough for nothing to be said."""
MOST_SD = 0.8
"""Standard deviation of gamma that is assumed where edges show nothing: cameras have 1 or about 2.2."""
MOST_SHARE = 0.5
"""A gamma from edges may make this share of a value's variance at most; otherwise the value is not measured."""
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
_MOST_ASYMMETRY = 4.0
_MOST_MISFIT = 0.06
_TIMES_MISFIT = 2.5
_DARKEST = 2e-3
_RIDGE = 1e-9
_TUKEY = 4.685
# of the search for the power, and what is as good as its end
_POWERS = (0.4, 4.0)
_SEARCH_ROUNDS = 12
_STILL = 0.01
_TAIL = 0.975
_USUAL = 1.96
# pixels of a share of the image may be darker than black
_DARKER_SHARE = 1e-3
_TO_BLACK = 1.5 / 255


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
    """Fitted profiles (n,): their asymmetry B and the K of their light; which are steps at all."""

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
    misfit : float
        Spread of asymmetries that it leaves.
    edges : int
        Edges that it is from.
    """

    excess: float
    sd: float
    misfit: float
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
        own = samples.edge == k
        points[own] = registered.moved(model, edges[k], points[own])
    centres = pixels_of(points, pose, camera)
    across = across_of(points, samples.tangents, pose, camera)
    scans = picture.find(centres, across, half_px)
    found = np.flatnonzero(scans.state == State.FOUND)
    section = np.minimum((samples.share * _SECTIONS).astype(np.int64), _SECTIONS - 1)
    return Places(
        centres[found] + scans.offset[found, None] * across[found],
        across[found],
        samples.edge[found],
        section[found],
        scans.blur_px[found],
    )


def thinned(places: Sequence[Places]) -> list[Places]:
    """Return evenly fewer places of each image, so that all together are not too many."""
    total = sum(len(image.edge) for image in places)
    step = max(1, math.ceil(total / MOST_PROFILES))
    return [Places(*(column[::step] for column in image)) for image in places]


def fitted_steps(places: Array, light: Array, blur_px: Array) -> Steps:
    """Return the asymmetry of profiles.

    Parameters
    ----------
    places : array (k,)
        Places along profiles, px.
    light : array (n, k)
        Light there, as a share of full exposure; nan off the image.
    blur_px : array (n,)
        About their blur.
    """
    inside = np.isfinite(light).all(axis=1)
    light = np.where(inside[:, None], light, 0.0)
    blur = np.clip(np.hypot(blur_px, 0.5), *_BLURS_PX)
    middle = np.zeros(len(light))
    half = np.clip(_HALF * blur, _LEAST_HALF_PX, _MOST_HALF_PX)
    for _ in range(_FIT_ROUNDS):
        t = (places - middle[:, None]) / blur[:, None]
        counts = (np.abs(places - middle[:, None]) <= half[:, None]).astype(np.float64)
        density = np.exp(-0.5 * t**2) / math.sqrt(2 * math.pi)
        step = ndtr(t)
        design = np.stack(
            [np.ones_like(step), step, step * (1 - step), density, density * t], axis=2
        )
        weighted = design * counts[..., None]
        normal = weighted.transpose(0, 2, 1) @ design + _RIDGE * np.eye(5)
        right = weighted.transpose(0, 2, 1) @ light[..., None]
        solution = np.linalg.solve(normal, right)
        numbers = solution[..., 0]
        height = np.where(np.abs(numbers[:, 1]) > 1e-9, numbers[:, 1], 1e-9)
        # density and its slope are what a shift and a wider blur change
        middle = middle + np.clip(-numbers[:, 3] / height * blur, -0.4, 0.4)
        blur = np.clip(blur * np.clip(1 - numbers[:, 4] / height, 0.7, 1.4), *_BLURS_PX)
    left = light - (design @ solution)[..., 0]
    misfit = np.sqrt((counts * left**2).sum(axis=1) / counts.sum(axis=1)) / np.abs(height)
    asymmetry = numbers[:, 2] / height
    smooth = np.maximum(numbers[:, :1] + height[:, None] * step, _DARKEST)
    right = weighted.transpose(0, 2, 1) @ (smooth * np.log(smooth))[..., None]
    sensitivity = np.linalg.solve(normal, right)[:, 2, 0] / height
    good = inside & (np.abs(middle) < _MOST_OFF_PX) & (misfit < _MOST_MISFIT)
    usual = float(np.median(misfit[good])) if good.any() else 0.0
    good &= misfit < _TIMES_MISFIT * usual
    good &= (blur > _BLURS_PX[0]) & (blur < _BLURS_PX[1]) & (np.abs(asymmetry) < _MOST_ASYMMETRY)
    return Steps(asymmetry, sensitivity, good)


def estimated_power(
    steps: Steps, edge: NDArray[np.int64], section: NDArray[np.int64]
) -> PowerEstimate:
    """Return the power that is left in the light of profiles.

    Medians of sections of edges are what counts, robustly (Tukey). The standard deviation is the jackknife's, which
    leaves out one edge after another, enlarged by Student's factor: a broken edge is asymmetric as a whole.

    Parameters
    ----------
    steps : Steps
        Fitted profiles (n,).
    edge, section : array of int (n,)
        Numbers of the edge of each, the same in all images, and of its section.
    """
    good = np.flatnonzero(steps.good)
    nothing = PowerEstimate(0.0, math.inf, math.nan, len(np.unique(edge[good])))
    if nothing.edges < FEWEST_EDGES:
        return nothing
    order = good[np.lexsort((section[good], edge[good]))]
    new = np.diff(edge[order]) + np.diff(section[order]) != 0
    groups = [part for part in np.split(order, np.flatnonzero(new) + 1) if len(part) >= 3]
    number = np.array([edge[part[0]] for part in groups], dtype=np.int64)
    names, cluster = np.unique(number, return_inverse=True)
    if len(names) < FEWEST_EDGES:
        return nothing
    asymmetry = np.array([np.median(steps.asymmetry[part]) for part in groups])
    sensitivity = np.array([np.median(steps.sensitivity[part]) for part in groups])
    size = np.array([len(part) for part in groups], dtype=np.float64)
    spread = [np.median(np.abs(steps.asymmetry[part] - m)) for part, m in zip(groups, asymmetry)]
    usual = 1.4826 * float(np.median(spread))
    # a few profiles hardly show their own spread
    noise = (1.4826 * np.array(spread) * size + usual * _FEW) / (size + _FEW)
    own = _OWN_SHARE * usual
    sigma = np.sqrt(noise**2 / size + own**2)
    excess = _median_slope(sensitivity / sigma, asymmetry / sigma)
    for _ in range(_FIT_ROUNDS):
        left = np.abs(asymmetry - excess * sensitivity) / sigma
        scale = max(1.4826 * float(np.median(left)), 1e-6)
        weight = np.maximum(1 - (left / (_TUKEY * scale)) ** 2, 0.0) ** 2 / sigma**2
        excess = float((weight * sensitivity * asymmetry).sum() / (weight * sensitivity**2).sum())
    over = np.bincount(cluster, weight * sensitivity * asymmetry)
    under = np.bincount(cluster, weight * sensitivity**2)
    without = (over.sum() - over) / (under.sum() - under)
    count = len(names)
    variance = (count - 1) / count * float(((without - without.mean()) ** 2).sum())
    factor = float(student.ppf(_TAIL, count - 1)) / _USUAL
    return PowerEstimate(excess, factor * math.sqrt(variance), scale, count)


def _median_slope(x: Array, y: Array) -> float:
    """Return the slope of a line through the origin for which the sum of absolute residuals is least."""
    slopes = y / np.where(x == 0, 1e-9, x)
    order = np.argsort(slopes)
    total = np.cumsum(np.abs(x[order]))
    return float(slopes[order][np.searchsorted(total, total[-1] / 2)])


class Profiles:
    """The profiles of all found edges of several images.

    Parameters
    ----------
    model : PartModel
        The part.
    pictures : mapping of str to Picture
        The images, by name.
    registered : mapping of str to Registered
        Their poses; images without one do not count.
    half_px : float
        How far from their predictions edges are searched, px.
    """

    def __init__(
        self,
        model: PartModel,
        pictures: Mapping[str, Picture],
        registered: Mapping[str, Registered],
        half_px: float,
    ) -> None:
        self.names = [name for name in pictures if name in registered]
        self._places = thinned(
            [found_places(model, pictures[name], registered[name], half_px) for name in self.names]
        )
        joined = [np.concatenate(columns) for columns in zip(*self._places, strict=True)]
        self._edge, self._section, self._blur = joined[2:] if joined else [np.zeros(0)] * 3
        # sections of one edge in several images are several, and the edge is one
        image = np.repeat(np.arange(len(self.names)), [len(own.edge) for own in self._places])
        self._section = self._section + _SECTIONS * image

    def sampled(
        self, images: Mapping[str, tuple[NDArray[np.float32], float]]
    ) -> tuple[Array, Array]:
        """Return places along profiles (k,), px, and values (n, k) as shares of white, of images with their white."""
        places = np.zeros(1)
        parts = []
        for name, own in zip(self.names, self._places, strict=True):
            image, white = images[name]
            places, values = profiles_of(image, own.centres, own.across, 1.0)
            parts.append(values / white)
        return places, np.concatenate(parts)

    def power(self, pictures: Mapping[str, Picture]) -> PowerEstimate:
        """Return the power that is left in the light of images."""
        if not len(self._edge):
            return PowerEstimate(0.0, math.inf, math.nan, 0)
        return self._power(
            *self.sampled(
                {name: (pictures[name].grey, pictures[name].white) for name in self.names}
            )
        )

    def _power(self, places: Array, light: Array) -> PowerEstimate:
        return estimated_power(fitted_steps(places, light, self._blur), self._edge, self._section)

    def gamma(self, pictures: Mapping[str, Picture], black: float) -> PowerEstimate:
        """Return the gamma of grey values less 1, with the standard deviation of its logarithm.

        Profiles of grey values are raised to powers here. Those of the image that is raised tell a little more, because
        what is between pixels is interpolated: see `tested`.
        """
        places, levels = self.sampled(
            {name: (pictures[name].levels, pictures[name].white) for name in self.names}
        )
        # interpolated, a profile is nowhere below its pixels
        above = np.maximum((levels - black) / (1 - black), 0.0)
        low, high = _POWERS
        gamma = 1.0
        estimate = self._power(places, above)
        for _ in range(_SEARCH_ROUNDS):
            if estimate.excess < 0:
                low = gamma
            else:
                high = gamma
            then = gamma / (1 + min(max(estimate.excess, -0.5), 1.0))
            if not low < then < high:
                then = math.sqrt(low * high)
            is_still = abs(then - gamma) < _STILL * gamma
            gamma = then
            if is_still:
                break
            estimate = self._power(places, above**gamma)
        return estimate._replace(excess=gamma - 1)


@dataclass(frozen=True)
class ResponseRecord:
    """The response of an image, and what says so.

    The camera does, the image file, or the edges; it is assumed where these show nothing. The gamma that edges show in
    what is measured is 1 within its standard deviation.
    """

    curve: str
    origin: Annotated[str, Key("from"), Meta(pattern="^(camera|file|edges|assumed)$")]
    remaining_gamma: NumberOrNull = math.nan
    gamma_sd: NumberOrNull = math.nan


@dataclass(frozen=True)
class Tested:
    """What the edges of all images say of the response.

    Attributes
    ----------
    pictures : dict of str to Picture
        The images, in the light that is measured.
    gamma : float
        Gamma that edges show in it; 1 of light.
    sd : float
        Its standard deviation.
    doubt : float
        Standard deviation of the power of light that values have to answer for; 0 where the user states the response.
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
    doubt: float
    note: str = ""
    reason: str = ""
    is_changed: bool = False

    @property
    def is_refused(self) -> bool:
        """Whether nothing is measured at all."""
        return bool(self.reason) and self.sd > TOLD

    def bent(self) -> dict[str, Picture]:
        """Return the images if the power of their light is off by the doubt."""
        return {name: picture.raised(1 + self.doubt) for name, picture in self.pictures.items()}

    def counted(self, reading: Reading, bent: Reading | None) -> Reading:
        """Return a reading whose variance has the part of the response.

        Parameters
        ----------
        reading : Reading
            The reading.
        bent : Reading or None
            The same in the images of `bent`; None if there is no doubt.
        """
        if not reading.measured:
            return reading
        if self.is_refused:
            return _refused(reading, self.reason)
        variance = 0.0
        if bent is not None:
            # what is not measured there at all is off by as much as it is uncertain
            off = bent.value - reading.value if bent.measured else reading.standard_uncertainty
            variance = off**2
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
        )

    def records(self) -> dict[str, ResponseRecord]:
        """Return what files say of it, by image."""
        return {
            name: ResponseRecord(
                picture.response.text,
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


def tested(
    model: PartModel,
    pictures: Mapping[str, Picture],
    registered: Mapping[str, Registered],
    half_px: float,
) -> Tested:
    """Test the response of the images of one camera by all edges that are found in them.

    A user is believed, and contradicted in a note. A file, and that grey values are proportional to light where nothing
    is stated, is believed unless edges clearly show another gamma. Then this one is used.

    Parameters
    ----------
    model, pictures, registered, half_px
        As of `Profiles`.
    """
    profiles = Profiles(model, pictures, registered, half_px)
    left = profiles.power(pictures)
    origins = {pictures[name].response_from for name in profiles.names}
    stated = " and ".join(sorted({picture.response.words for picture in pictures.values()}))
    if STATED in origins or not profiles.names:
        note = ""
        if is_clear(left):
            note = (
                f"edges contradict the stated response ({stated}): gamma {_gamma_text(left)} is left in its light; "
                "measured as stated"
            )
        return Tested(dict(pictures), *_gamma_of(left), 0.0, note)
    if not is_clear(left):
        return _believed(pictures, left, origins)
    return _measured_gamma(profiles, pictures, stated if FILE in origins else "")


def is_clear(left: PowerEstimate) -> bool:
    """Return whether edges clearly show that light is not what it is taken for."""
    return abs(left.excess) > max(CURVED, CURVED_SIGMAS * left.sd)


def _gamma_of(left: PowerEstimate) -> tuple[float, float]:
    """Return the gamma that is left, and its standard deviation: light to the power of 1 / gamma is what is there."""
    gamma = 1 / max(1 + left.excess, 0.1)
    return gamma, left.sd * gamma


def _gamma_text(left: PowerEstimate) -> str:
    gamma, sd = _gamma_of(left)
    return f"{gamma:.2g} ± {2 * sd:.1g}"


def _believed(pictures: Mapping[str, Picture], left: PowerEstimate, origins: set[str]) -> Tested:
    """Return what is measured in the light as it is taken."""
    doubt = min(math.hypot(left.sd, left.excess), MOST_SD)
    note = ""
    if doubt > TOLD:
        stated = (
            "what files state of grey values"
            if FILE in origins
            else "grey values are proportional to light"
        )
        note = f"edges do not show whether {stated}: U contains a gamma off by {doubt:.1g}; state response"
        if FILE in origins:
            note = (
                f"edges do not show whether the response that the files state is right: "
                f"U contains a gamma off by {doubt:.1g}; state response"
            )
    chosen = {
        name: replace(picture, response_from=EDGES)
        if picture.response_from == ASSUMED and doubt <= TOLD
        else picture
        for name, picture in pictures.items()
    }
    return Tested(chosen, *_gamma_of(left), doubt, note)


def _measured_gamma(profiles: Profiles, pictures: Mapping[str, Picture], stated: str) -> Tested:
    """Return what is measured in the light of the gamma that edges show."""
    plain = {name: picture.under(LINEAR, EDGES) for name, picture in pictures.items()}
    left = profiles.power(plain)
    if stated and not is_clear(left):
        note = (
            f"the files state {stated}, but grey values are proportional to light (gamma {_gamma_text(left)}): "
            "measured so; state response"
        )
        return replace(_believed(plain, left, set()), note=note, is_changed=True)
    estimates = {black: profiles.gamma(plain, black) for black in _blacks(plain)}
    black = min(estimates, key=lambda one: estimates[one].misfit)
    gamma = 1 + estimates[black].excess
    bent = plain
    for _ in range(3):
        response = Response.power(gamma, black)
        bent = {name: picture.under(response, EDGES) for name, picture in plain.items()}
        left = profiles.power(bent)
        if abs(left.excess) < _STILL:
            break
        gamma = min(max(gamma / (1 + left.excess), _POWERS[0]), _POWERS[1])
    sd = left.sd * gamma
    told = f"gamma about {gamma:.2g} ± {2 * sd:.1g}" + (", black is 16" if black else "")
    files = f"the files state {stated}, but " if stated else ""
    note = (
        f"{files}grey values are not proportional to light ({told}): "
        "measured with this gamma; state response or switch gamma off"
    )
    reason = (
        f"grey values are not proportional to light (gamma about {gamma:.2g}): "
        "switch gamma off or state response"
    )
    doubt = min(math.hypot(left.sd, left.excess), MOST_SD)
    return Tested(bent, *_gamma_of(left), doubt, note, reason, is_changed=True)


def _blacks(pictures: Mapping[str, Picture]) -> list[float]:
    """Return what black may be: 0, and 16 of 255 where nothing is darker and something nearly as dark."""
    darkest = [
        float(np.quantile(picture.levels[::4, ::4], _DARKER_SHARE)) / picture.white
        for picture in pictures.values()
    ]
    is_video = VIDEO_BLACK - _TO_BLACK <= min(darkest, default=0.0) <= VIDEO_BLACK + 2 * _TO_BLACK
    return [0.0, VIDEO_BLACK] if is_video else [0.0]
