"""Readings: the value of one target in one image, its uncertainty by source, or why there is none."""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from aspectgraph.entities.entity_rules import PARAMETERS
from errors.checks import covariance_root
from errors.measurands import Circle, Geometry, Line, Measurand
from errors.measurands.geometry import Frame
from errors.measurands.measurand import COVERAGE
from errors.registration import rests_on_prior, variance_by_input
from ground.convert import NOT_STORED, Key, Meta
from planner.camera.camera import Camera, tangents_of
from planner.camera.pose import world_to_cam
from planner.measuring.breaks import (
    Breaks,
    FoundPoints,
    break_shifts,
    entity_breaks,
    levels_beside,
    lit_breaks,
    two_steps,
)
from planner.measuring.corners import ARM_SHARE, arms_of, ends_of, ideal_images, near_corner
from planner.measuring.fit import (
    CORRELATION_PX,
    Fit,
    carried_back,
    fit_entities,
    floor_modes,
    robust_fit,
    uneven_px,
)
from planner.measuring.images import Picture
from planner.measuring.register import signs_of
from planner.measuring.registered import Faces, NumberOrNull, Registered, displaced
from planner.measuring.samples import (
    ALONG_VARIANCE,
    MOST_BY_SLOPES_PX,
    MOST_IF_SHARP_PX,
    PART_WORDS,
    POSE,
    STATE_TEXTS,
    PartEdge,
    PartModel,
    Samples,
    Scans,
    State,
    across_of,
    numbers_of_parts,
    parts_of,
    pixels_of,
)
from planner.measuring.verdict import BESIDE_PX, Sampled, beside_shadows, stretches_of
from planner.request.edge_state import SHARP, EdgeState, spread_of
from planner.text_table import share_text

Array = NDArray[np.float64]

# Scans of one entity of a target in one image, and what was found of it.


LEAST_POINTS = 8
"""Fewer found points are no entity."""
_MARGIN_PX = 4.0
# share of an entity's samples at which nothing is found, of one that is elsewhere
_ABSENT = 0.8
# share of white: a lamp that makes such a step would show an edge
_SURE_STEP = 0.06
# edges around an entity: so near to it, px, but not it; so many of their samples; so many of them found
_AROUND_PX = 150.0
_OWN_PX = 6.0
_EVERY = 8
_FEWEST_AROUND = 40
_FOUND_AROUND = 0.9
# of an entity's size: difference quotients across it in the image
_AHEAD = 1e-5

# in the structured array of points
POINT = np.dtype(
    [
        ("u", float),
        ("v", float),
        ("nu", float),
        ("nv", float),
        ("x", float),
        ("y", float),
        ("z", float),
        ("share", float),
        ("residual_px", float),
        ("state", np.int64),
    ]
)


@dataclass(frozen=True)
class EntityScan:
    """What was found of an entity.

    Attributes
    ----------
    edge : PartEdge
        The entity.
    points : structured array (m,)
        u, v: found place, px, less what a stated break moves it (of what was not found, the place of the model).
        nu, nv: unit vector across. x, y, z: the sample, mm. share: where on the entity. residual_px: distance from the
        fit. state: see `State`.
    directions : array (k, 2)
        x/z and y/z of the rays of found points.
    origins : array (k, 3)
        Points of the planes they are carried back to, mm.
    px_per_mm : array (k,)
        Pixels of a millimetre across the entity, at each.
    fit : Fit or None
        None if too little was found.
    reason : str
        Why there is no fit; empty if there is one.
    spacing_px : float
        Distance of neighbouring samples in the image.
    breaks : Breaks or None
        Where the steps of found points are if the entity is broken; None if it was not asked.
    moved : bool
        Whether no edge is where the model has one, though the light would show it.
    slopes_px : float
        What is not known of how far slopes of light move the entity, px; 0 unless its edges are stated as sharp, as
        breaks count for more.
    """

    edge: PartEdge
    points: NDArray[np.void]
    directions: Array
    origins: Array
    px_per_mm: Array
    fit: Fit | None
    reason: str
    spacing_px: float
    breaks: Breaks | None = None
    moved: bool = False
    slopes_px: float = 0.0

    def common_px(self, floor_px: float) -> float:
        """Return what all points of the entity may be off in one direction, given the floor of this, px."""
        state = self.points["state"]
        residual = self.points["residual_px"][state == State.FOUND]
        uneven = uneven_px(residual[np.isfinite(residual)], self.spacing_px)
        return math.hypot(floor_px, uneven, self.slopes_px)

    @property
    def n_found(self) -> int:
        """Number of found points."""
        return int(np.sum(self.points["state"] == State.FOUND))

    @property
    def found_share(self) -> float:
        """Share of the samples that were found."""
        return self.n_found / len(self.points) if len(self.points) else 0.0

    @property
    def counts(self) -> dict[str, int]:
        """Number of samples by state, in words."""
        return {
            STATE_TEXTS[state]: int(n)
            for state in State
            if (n := np.sum(self.points["state"] == state))
        }


def entity_samples(
    model: PartModel,
    edges: list[PartEdge],
    registered: Registered,
    camera: Camera,
    half_px: float,
) -> Samples:
    """Return the samples of entities, and which are apart from all lines of the part that a scan could reach."""
    pose = registered.cam2world
    samples = model.edges.samples(pose, camera, edges, _MARGIN_PX)
    shown = model.shown(pose, camera)
    samples.apart[:] = shown.apart(
        edges, samples.edge, pixels_of(samples.points, pose, camera), half_px
    )
    return samples


def scan_entity(
    model: PartModel,
    edge: PartEdge,
    frame: Frame,
    samples: Samples,
    picture: Picture,
    registered: Registered,
    *,
    half_px: float,
    coverage: float,
    edge_state: EdgeState = SHARP,
    in_each_part: bool = True,
) -> EntityScan:
    """Look for an entity in an image, and fit it.

    Parameters
    ----------
    model : PartModel
        The part.
    edge : PartEdge
        The entity.
    frame : Frame
        The plane that it is fitted in.
    samples : Samples
        Its samples.
    picture : Picture
        The image.
    registered : Registered
        Its pose.
    half_px : float
        How far from its prediction it is searched, px.
    coverage : float
        Share of its samples that must be found.
    edge_state : EdgeState
        By how much it is broken.
    in_each_part : bool
        Whether something must be found in each of its parts, see `parts_of`.
    """
    camera = picture.camera
    pose = registered.cam2world
    places = registered.moved(model, edge, samples.points)
    centres = pixels_of(places, pose, camera)
    across = across_of(places, samples.tangents, pose, camera)
    breaks = entity_breaks(edge, frame, samples, edge_state, places, across, pose, camera)
    if not edge_state.is_sharp:
        breaks = _lit(breaks, samples, model, picture, registered, (centres, across))
    # steps of stated breaks are searched where they are expected, and carried back to the edge of the model
    seen = centres + breaks.expected[:, None] * across
    scans = _searched(picture, edge, (seen, across), samples, half_px, breaks)
    _expect(scans, edge, breaks, edge_state, (centres, across))
    scans.state[:] = _without_shadows(
        model, edge, samples, picture, registered, (seen, across), scans, breaks.band_px
    )
    pixels = centres + np.where(scans.state == State.FOUND, scans.offset, 0.0)[:, None] * across
    normal = np.cross(frame.x, frame.y)
    origins = samples.points + ((places - samples.points) @ normal)[:, None] * normal
    state = scans.state.copy()
    residual = np.full(len(state), np.nan)
    fit = None
    is_found = state == State.FOUND
    scale = entity_scale(edge.geometry, frame, places, across, pose, camera)
    if is_found.sum() >= LEAST_POINTS:
        directions = tangents_of(camera, pixels)
        flat = carried_back(directions[is_found], pose, origins[is_found], normal, frame)
        fit, good = robust_fit(edge.geometry, flat, scale[is_found])
        residual[is_found] = fit.residual
        state[np.flatnonzero(is_found)[~good]] = State.OUTLIER
    points = _points_of(samples, pixels, across, residual, state)
    reason = _incomplete(edge, points, coverage, breaks.assumed_px, in_each_part)
    is_found = state == State.FOUND
    sampled = Sampled(model.edges.scene, camera, pose, [edge], _alone(samples))
    moved = bool(reason) and _is_moved(sampled, picture, registered, (centres, across), state)
    return EntityScan(
        edge,
        points,
        tangents_of(camera, pixels[is_found]),
        origins[is_found],
        scale[is_found],
        None if reason else fit,
        _moved_text(edge, half_px) if moved else reason,
        spacing_of(centres),
        breaks.of(is_found),
        moved,
        float(scans.slopes_px[is_found].mean()) if is_found.any() else 0.0,
    )


def _expect(
    scans: Scans,
    edge: PartEdge,
    breaks: Breaks,
    edge_state: EdgeState,
    where: tuple[Array, Array],
) -> None:
    """Correct what was found, in place: two steps of a break are no fault, and the blur of a curved step moves it."""
    double = two_steps(breaks.ends, edge_state) & (scans.state == State.TWO_STEPS)
    scans.state[double] = State.FOUND
    if isinstance(edge.geometry, Circle):
        scans.offset[:] -= _curvature(*where) / 2 * _along_variance(scans)


def _moved_text(edge: PartEdge, half_px: float) -> str:
    """Return the reason of an entity that the light would show, and that is not where it was searched."""
    place = f"where the model has {_word(edge)} {edge.name}"
    return f"no edge is {place} (moved more than {half_px:.0f} px?)"


def _points_of(
    samples: Samples, pixels: Array, across: Array, residual: Array, state: NDArray[np.int64]
) -> NDArray[np.void]:
    """Return samples as a structured array, see `EntityScan`."""
    points = np.zeros(len(state), dtype=POINT)
    points["u"], points["v"] = pixels.T
    points["nu"], points["nv"] = across.T
    points["x"], points["y"], points["z"] = samples.points.T
    points["share"] = samples.share
    points["residual_px"] = residual
    points["state"] = state
    return points


def _lit(
    breaks: Breaks,
    samples: Samples,
    model: PartModel,
    picture: Picture,
    registered: Registered,
    where: tuple[Array, Array],
) -> Breaks:
    """Return breaks with what the lamp tells that fits the image, if there is one."""
    lamp = registered.lamps.get(picture.name)
    if lamp is None or not len(breaks.ends):
        return breaks
    eye = registered.cam2world[:3, 3]
    middle = samples.points.mean(axis=0)
    faces = Faces(samples.points, breaks.normals[:, 0], eye, middle, model.edges.scene)
    levels = levels_beside(picture, *where, breaks)
    return lit_breaks(breaks, samples, lamp, faces, levels, registered.blur_px)


def _is_moved(
    sampled: Sampled,
    picture: Picture,
    registered: Registered,
    where: tuple[Array, Array],
    state: NDArray[np.int64],
) -> bool:
    """Tell whether the light would show an entity of which nothing is found, so that it must be elsewhere.

    Where no lamp explains the image, the edges around it tell: nearly all of them are found.
    """
    is_lost = np.isin(state, (State.WEAK, State.AT_END))
    if not len(state) or is_lost.mean() < _ABSENT:
        return False
    lamp = registered.lamps.get(picture.name)
    if lamp is not None:
        faces, on_part = sampled.beside(where[1], BESIDE_PX)
        shaded = np.where(on_part, faces.shaded(lamp), lamp.background)
        would_show = np.abs(shaded[1] - shaded[0]) >= _SURE_STEP
        return bool(would_show[is_lost].mean() >= _ABSENT)
    others = registered.samples
    if not len(others):
        return False
    away = np.stack([others["u"], others["v"]], axis=1)
    distance = np.linalg.norm(away[:, None] - where[0][::_EVERY][None], axis=2).min(axis=1)
    beside = (distance > _OWN_PX) & (distance < _AROUND_PX)
    if beside.sum() < _FEWEST_AROUND:
        return False
    return bool(np.mean(others["state"][beside] == State.FOUND) >= _FOUND_AROUND)


def _alone(samples: Samples) -> Samples:
    """Return samples of one entity, with the number 0."""
    return replace(samples, edge=np.zeros_like(samples.edge))


def _word(edge: PartEdge) -> str:
    return "edge" if isinstance(edge.geometry, Line) else "rim"


def _searched(
    picture: Picture,
    edge: PartEdge,
    where: tuple[Array, Array],
    samples: Samples,
    half_px: float,
    breaks: Breaks,
) -> Scans:
    """Scan twice, at places and across: the sign of the step is that of most of the stretch that a sample is in.

    Around a bore, a lit wall is brighter than the face around it here, and darker there. Slopes of light leave nothing
    unknown of edges that may be broken, as breaks count for more.
    """
    usable = samples.usable
    state = np.where(samples.visible, int(State.NEAR_LINE), int(State.HIDDEN))
    offset, step, blur, slopes = np.zeros((4, len(state)))
    if usable.any():
        centres, across = (each[usable] for each in where)
        reach_px = breaks.half_px(half_px)
        stretch = stretches_of(edge, samples.share)[usable]
        sign = signs_of(picture, centres, across, reach_px, stretch)
        is_sharp = breaks.state.is_sharp
        most_px = MOST_IF_SHARP_PX if is_sharp else MOST_BY_SLOPES_PX
        scans = picture.find(centres, across, reach_px, sign, most_px)
        state[usable] = scans.state
        offset[usable] = scans.offset
        step[usable] = scans.step
        blur[usable] = scans.blur_px
        slopes[usable] = scans.slopes_px if is_sharp else 0.0
    return Scans(offset, state, step, blur, slopes)


def _without_shadows(
    model: PartModel,
    edge: PartEdge,
    samples: Samples,
    picture: Picture,
    registered: Registered,
    where: tuple[Array, Array],
    found: Scans,
    band_px: float = 0.0,
) -> NDArray[np.int64]:
    """Return what became of samples (m,) if a shadow that ends beside the edge does not count as the edge."""
    lamp = registered.lamps.get(picture.name)
    good = found.state == State.FOUND
    if lamp is None or not good.any():
        return found.state
    pose = registered.cam2world
    sampled = Sampled(model.edges.scene, picture.camera, pose, [edge], _alone(samples), band_px)
    edges = where[0] + np.where(good, found.offset, 0.0)[:, None] * where[1]
    stretch = stretches_of(edge, samples.share)
    shadows = beside_shadows(lamp, sampled, picture, (edges, where[1]), good, stretch)
    return np.where(good & shadows, int(State.SHADOW), found.state)


def _along_variance(found: Scans) -> float:
    """Return the variance of where along an edge its grey values come from, px²."""
    good = found.state == State.FOUND
    blur = float(np.median(found.blur_px[good])) if good.any() else 0.0
    return ALONG_VARIANCE + blur**2


def _curvature(centres: Array, across: Array) -> Array:
    """Return the curvature of an image at samples in order (m,), 1/px: positive if its centre is across."""
    if len(centres) < 3:
        return np.zeros(len(centres))
    first = np.gradient(centres, axis=0)
    # the ends of a rim's samples have one neighbour in order
    second = centres[2:] - 2 * centres[1:-1] + centres[:-2]
    second = np.concatenate([second[:1], second, second[-1:]])
    return np.asarray((second * across).sum(axis=1) / (first**2).sum(axis=1))


def spacing_of(centres: Array) -> float:
    """Return the distance of neighbouring samples in the image, px."""
    if len(centres) < 2:
        return 1.0
    return max(float(np.median(np.linalg.norm(np.diff(centres, axis=0), axis=1))), 0.1)


def entity_scale(
    geometry: Geometry, frame: Frame, places: Array, across: Array, pose: Array, camera: Camera
) -> Array:
    """Return how many pixels across an entity's image a millimetre across it is (m,)."""
    if not len(places):
        return np.empty(0)
    if isinstance(geometry, Line):
        way = np.tile(frame.y, (len(places), 1))
    else:
        way = places - geometry.centre
        way = way - (way @ geometry.axis)[:, None] * geometry.axis
        way = way / np.linalg.norm(way, axis=1, keepdims=True)
    step = _AHEAD * float(np.median(world_to_cam(places, pose)[:, 2]))
    moved = pixels_of(places + step * way, pose, camera) - pixels_of(
        places - step * way, pose, camera
    )
    return np.asarray(np.abs((moved * across).sum(axis=1)) / (2 * step))


def _incomplete(
    edge: PartEdge,
    points: NDArray[np.void],
    coverage: float,
    assumed_px: float,
    in_each_part: bool,
) -> str:
    """Say why what was found of an entity is not enough; empty if it is.

    What is off the fit by no more than an assumed break is found, too, though it is not fitted: U counts with that
    break all along the entity.
    """
    word = _word(edge)
    if not len(points):
        return f"the image of {word} {edge.name} is too short"
    is_found = points["state"] == State.FOUND
    is_within = np.abs(points["residual_px"]) <= assumed_px
    is_covered = is_found | (points["state"] == State.OUTLIER) & is_within
    share = float(is_covered.mean())
    if share < coverage or is_found.sum() < LEAST_POINTS:
        counts = {state: int(np.sum(points["state"] == state)) for state in State}
        del counts[State.FOUND]
        worst = max(counts, key=lambda state: counts[state])
        if counts[worst] >= 0.9 * len(points):
            return f"{word} {edge.name} is {STATE_TEXTS[worst]}"
        main_reason = f"{100 * counts[worst] / len(points):.0f} % is {STATE_TEXTS[worst]}"
        # as results state it, without outliers that a break explains
        found_text = share_text(float(is_found.mean()), coverage)
        return f"only {found_text} % of {word} {edge.name} was found; {main_reason}"
    n_parts = parts_of(len(points)) if in_each_part else 1
    part = numbers_of_parts(points["share"], n_parts)
    missing = set(part.tolist()) - set(part[is_covered].tolist())
    if missing:
        return f"a {PART_WORDS[n_parts - 2]} of {word} {edge.name} was not found"
    return ""


def largest_state(counts: Mapping[str, int]) -> str:
    """Return the state that most samples have which were not found; empty if all were found."""
    others = {name: n for name, n in counts.items() if name != STATE_TEXTS[State.FOUND]}
    return max(others, key=lambda name: others[name]) if others else ""


# The uncertainty of a reading by drawing (JCGM 101): the check of the one by derivatives.
#
# Poses, surfaces and points are drawn from their distributions and go through the same fit and
# value. Points are thinned, and their errors made smaller by the root of how many each stands
# for, so that the fit is as sure as with all of them.


DRAWS = 5_000
"""Draws: the spread is then known to 1 % and the interval to 2 %."""
TOLERATED = 0.05
"""Difference of the two uncertainties, as a share, from which on a reading has a note."""
COVERED = 0.9545
"""Share of the draws in the interval of U, that of two standard deviations of a normal distribution."""

_POINTS = 24


def drawn_uncertainty(
    measurand: Measurand,
    scans: Sequence[EntityScan],
    registered: Registered,
    model: PartModel,
    noise: Sequence[tuple[float, float]],
    seed: int,
    edges: float = 0.0,
) -> float:
    """Return half the width of the interval that holds 95.45 % of the drawn values.

    Parameters
    ----------
    measurand : Measurand
        The value.
    scans : sequence of EntityScan
        Its entities, each with a fit.
    registered : Registered
        The image.
    model : PartModel
        The part.
    noise : sequence of (float, float)
        For each entity the standard deviation of an independent point, and the floor, px.
    seed : int
        Of the draws.
    edges : float
        Standard deviation of the value by broken edges, in its unit.
    """
    rng = np.random.default_rng(seed)
    scan_unknowns = [model.unknowns_of(scan.edge) for scan in scans]
    unknowns = np.unique(np.concatenate([np.arange(POSE), *scan_unknowns]))
    root = covariance_root(registered.covariance[np.ix_(unknowns, unknowns)])
    moves = rng.standard_normal((DRAWS, len(unknowns))) @ root.T
    fits = []
    for scan, frame, surfaces, (sigma, floor) in zip(
        scans, measurand.frames, scan_unknowns, noise, strict=True
    ):
        columns = np.searchsorted(unknowns, surfaces)
        drawn = np.concatenate([moves[:, :POSE], moves[:, columns]], axis=1)
        fits.append(_drawn_fits(scan, frame, registered, model, drawn, (sigma, floor), rng))
    values = measurand.value(fits) + edges * rng.standard_normal(DRAWS)
    tail = (1 - COVERED) / 2
    low, high = np.quantile(values, [tail, 1 - tail])
    return float(high - low) / 2


def _drawn_fits(
    scan: EntityScan,
    frame: Frame,
    registered: Registered,
    model: PartModel,
    moves: Array,
    noise: tuple[float, float],
    rng: np.random.Generator,
) -> Array:
    """Return what is fitted in each draw (n, p)."""
    count = len(scan.directions)
    thin = np.unique(np.linspace(0, count - 1, min(count, _POINTS)).round().astype(int))
    normal = np.cross(frame.x, frame.y)
    counted = scan.points["state"] == 0
    samples = np.stack([scan.points[name][counted][thin] for name in "xyz"], axis=1)
    lift = np.einsum("mij,i->mj", model.displacement(scan.edge, samples), normal)
    origins = scan.origins[thin] + (moves[:, POSE:] @ lift.T)[..., None] * normal
    poses = displaced(registered.cam2world, moves[:, :POSE])
    directions = np.broadcast_to(scan.directions[thin], (len(moves), len(thin), 2))
    flat = carried_back(directions, poses, origins, normal, frame)
    sigma, floor = noise
    weight = scan.px_per_mm[thin]
    _, design, _ = fit_entities(scan.edge.geometry, flat[:1], weight**2)
    modes = floor_modes(scan.edge.geometry, design)
    off = sigma * np.sqrt(len(thin) / count) * rng.standard_normal(flat.shape[:2])
    off += floor * rng.standard_normal((len(moves), modes.shape[1])) @ modes.T
    flat = flat + (off / weight)[..., None] * _across(scan.edge.geometry, flat)
    return fit_entities(scan.edge.geometry, flat, weight**2)[0]


def _across(geometry: Geometry, flat: Array) -> Array:
    """Return unit vectors across an entity in its frame, at points (n, m, 2)."""
    if isinstance(geometry, Circle):
        return np.asarray(flat / np.linalg.norm(flat, axis=-1, keepdims=True))
    return np.broadcast_to(np.array([0.0, 1.0]), flat.shape)


# Readings: the value of one target in one image.


SOURCES = (
    *("pose", "surfaces", "registration", "localisation", "localisation floor"),
    "response",
    "edge state",
)
"""What the variance of a reading comes from: independent errors, so no part is negative.

The pose and the surfaces are those before registration, as far as it leaves their errors in the value. Registration
stands for the errors of the points that it is from. A pose that is planned or given has none.

That of the response is known only after all images are read, see `planner.measuring.response`.
"""

# steps of difference quotients, mm and rad
_STEP = np.array([1e-3] * 3 + [1e-5] * 3 + [1e-3] * 2 * PARAMETERS)
_FITTED_STEP = 1e-5


@dataclass(frozen=True)
class Reading:
    """One target in one image.

    Attributes
    ----------
    name : str
        The target.
    image : str
        The image.
    setting : int
        Number of the setting, from 0.
    value : float
        mm (angles: degrees), as everything here; nan if it was not measured.
    standard_uncertainty : float
        Its u.
    budget : dict of str to float
        Variance by `SOURCES`.
    reason : str
        Why it was not measured; empty if it was.
    found_share : float
        Share of the samples that were found, of the entity of which least was found.
    rms_px : float
        Root mean square distance of found points from the fit.
    counts : dict of str to int
        Samples by what became of them.
    points : tuple of structured array
        The samples of each entity.
    gradient : array (n,)
        Of the value by the unknowns of the image.
    drawn_uncertainty : float
        U by drawing instead of derivatives, see `drawn_uncertainty`.
    notes : tuple of str
        What the user should know.
    edge_shift : float
        How far the value moves at most if all edges that it is measured at are broken by 1 mm; nan of a sharp part.
    advice : str
        What to change in the shop if it was not measured; empty if nothing is known.
    moved : bool
        Whether no edge is where the model has one, though the light would show it.
    deviation_mm : tuple of float
        Of a position its deviation e from the true one, in the axes of the datum reference frame; otherwise empty.
    covariance_mm2 : tuple of tuple of float
        Covariance of these, and of the size if there is one; otherwise empty.
    size_mm : float
        Of a position with a material condition, the diameter of its hole or pin, measured on the same rim.
    entity : str
        The entity, if the value is what it would be if only this one of several was off; otherwise empty.
    break_mean : float
        Mean shift by breaks that nobody stated, with its sign; its square is part of the variance.
    """

    name: Annotated[str, NOT_STORED]
    image: str
    setting: Annotated[int, NOT_STORED]
    value: NumberOrNull = math.nan
    standard_uncertainty: Annotated[NumberOrNull, Key("u")] = math.nan
    budget: Annotated[dict[str, float], Key("variance")] = field(default_factory=dict)
    reason: str = ""
    found_share: Annotated[float, Meta(ge=0, le=1)] = 0.0
    rms_px: NumberOrNull = math.nan
    counts: Annotated[dict[str, Annotated[int, Meta(ge=1)]], Key("samples")] = field(
        default_factory=dict
    )
    points: Annotated[tuple[NDArray[np.void], ...], NOT_STORED] = ()
    gradient: Annotated[Array, NOT_STORED] = field(default_factory=lambda: np.empty(0))
    drawn_uncertainty: Annotated[NumberOrNull, Key("U_drawn")] = math.nan
    notes: tuple[str, ...] = ()
    edge_shift: Annotated[NumberOrNull, Key("by_mm_of_break")] = math.nan
    advice: str = ""
    moved: Annotated[bool, NOT_STORED] = False
    deviation_mm: tuple[float, ...] = ()
    covariance_mm2: tuple[tuple[float, ...], ...] = ()
    size_mm: NumberOrNull = math.nan
    entity: str = ""
    break_mean: Annotated[float, NOT_STORED] = 0.0

    def __repr__(self) -> str:
        """Return a one-line summary."""
        value = f"{self.value:.6g}, u = {self.standard_uncertainty:.2g}"
        if not self.measured:
            value = "not measured"
        return f"<Reading of {self.name!r} in {self.image!r}: {value}>"

    @property
    def measured(self) -> bool:
        """Whether it has a value."""
        return not self.reason

    @property
    def overexposed_share(self) -> float:
        """Share of the samples that are overexposed."""
        total = sum(self.counts.values())
        return self.counts.get(STATE_TEXTS[State.CLIPPED], 0) / total if total else 0.0


def read_value(
    where: tuple[str, str, int],
    measurand: Measurand,
    scans: Sequence[EntityScan],
    registered: Registered,
    model: PartModel,
    floor_px: float,
    camera: Camera,
) -> Reading:
    """Return the reading of a target from what was found of its entities.

    Parameters
    ----------
    where : (str, str, int)
        Names of target and image, and number of the setting.
    measurand : Measurand
        The value.
    scans : sequence of EntityScan
        Its entities.
    registered : Registered
        The image.
    model : PartModel
        The part.
    floor_px : float
        Error across an entity that all of its points have in common, px.
    camera : Camera
        The camera.
    """
    counts = counts_of(scans)
    share = min(scan.found_share for scan in scans)
    points = tuple(scan.points for scan in scans)
    reasons = [scan.reason for scan in scans if scan.reason]
    if reasons:
        reason = next((scan.reason for scan in scans if scan.moved), reasons[0])
        lost = Reading(*where, reason=reason, found_share=share, counts=counts, points=points)
        return replace(lost, moved=any(scan.moved for scan in scans))
    fits = [scan.fit for scan in scans if scan.fit is not None]
    value = measurand.nominal + float(measurand.value([fit.fitted[None] for fit in fits])[0])
    by_fitted = slopes_by_fitted(measurand, [fit.fitted for fit in fits])
    random = 0.0
    floor = 0.0
    gradient = np.zeros(model.n_unknowns)
    rms = []
    noise = []
    for scan, fit, frame, slope in zip(scans, fits, measurand.frames, by_fitted, strict=True):
        counted = np.isfinite(scan.points["residual_px"]) & (scan.points["state"] == 0)
        residual = scan.points["residual_px"][counted]
        variance = float((residual**2).sum() / max(len(residual) - len(slope), 1))
        rms.append(float((residual**2).mean()))
        alike = max(1.0, CORRELATION_PX / scan.spacing_px)
        # such errors have one direction, so their mean over the entity is about as large as they are
        common_px = scan.common_px(floor_px)
        noise.append((math.sqrt(variance * alike), common_px))
        random += variance * alike * float(slope @ fit.covariance @ slope)
        floor += common_px**2 * float(((slope @ fit.common) ** 2).sum())
        unknowns, rows = _fitted_by_unknowns(scan, frame, registered, model)
        np.add.at(gradient, unknowns, slope @ rows)
    broken = edge_effect(scans, measurand.frames, by_fitted, registered, camera)
    budget = budget_of(gradient, registered, random, floor, broken.variance)
    u = math.sqrt(max(math.fsum(budget.values()), 0.0))
    # of the name, so that no other target changes the draws
    seed = zlib.crc32(where[0].encode())
    edge_sigma = math.sqrt(broken.variance)
    drawn = drawn_uncertainty(measurand, scans, registered, model, noise, seed, edge_sigma)
    return Reading(
        *where,
        value=value - broken.shift,
        standard_uncertainty=u,
        budget=budget,
        found_share=share,
        rms_px=math.sqrt(float(np.mean(rms))),
        counts=counts,
        points=points,
        gradient=gradient,
        drawn_uncertainty=drawn,
        notes=_notes(COVERAGE * u, drawn, gradient, registered),
        edge_shift=broken.by_mm,
        break_mean=broken.mean,
    )


class EdgeEffect(NamedTuple):
    """What broken edges do to a value.

    Attributes
    ----------
    shift : float
        What is corrected.
    variance : float
        Of what remains.
    by_mm : float
        How far the value moves at most if all edges are broken by 1 mm; nan of a sharp part.
    mean : float
        Mean shift that is not corrected because nobody stated the breaks; its square is part of the variance.
    """

    shift: float
    variance: float
    by_mm: float
    mean: float = 0.0


def edge_effect(
    scans: Sequence[EntityScan],
    frames: Sequence[Frame],
    slopes: Sequence[Array],
    registered: Registered,
    camera: Camera,
) -> EdgeEffect:
    """Return what broken edges do to a value.

    Parameters
    ----------
    scans : sequence of EntityScan (e,)
        Its entities, each with a fit.
    frames : sequence of Frame (e,)
        The planes that they are fitted in.
    slopes : sequence of array (e,)
        Derivatives of the value by what is fitted of each.
    registered : Registered
        The image.
    camera : Camera
        The camera.
    """
    shifts = []
    state = SHARP
    for scan, frame, slope in zip(scans, frames, slopes, strict=True):
        if scan.breaks is None or scan.breaks.state.is_sharp or scan.fit is None:
            continue
        state = scan.breaks.state
        counted = scan.points[scan.points["state"] == State.FOUND]
        pixels = np.stack([counted["u"], counted["v"]], axis=1)
        across = np.stack([counted["nu"], counted["nv"]], axis=1)
        points = FoundPoints(pixels, across, scan.origins, scan.px_per_mm)
        pose = registered.cam2world
        shifts.append(break_shifts(scan.breaks, scan.edge, frame, points, pose, camera, slope))
    if not shifts:
        return EdgeEffect(0.0, 0.0, math.nan)
    shift, variance = spread_of(
        np.array([shift.mean for shift in shifts]),
        np.array([shift.mean_square for shift in shifts]),
        state,
    )
    ends = np.array([shift.ends for shift in shifts])
    by_mm = max(float(ends.max(axis=1).sum()), -float(ends.min(axis=1).sum()))
    mean = 0.0 if state.stated else math.fsum(shift.mean for shift in shifts)
    return EdgeEffect(shift, variance, by_mm, mean)


def _notes(
    expanded: float, drawn: float, gradient: Array, registered: Registered
) -> tuple[str, ...]:
    notes = []
    if abs(drawn - expanded) > TOLERATED * expanded:
        notes.append(f"U is {drawn:.4g} by drawing and {expanded:.4g} by derivatives")
    if registered.prior is not None and rests_on_prior(
        registered.covariance, registered.prior, gradient, expanded / COVERAGE
    ):
        notes.append("rests on the robot's pose, not on the image")
    return tuple(notes)


def counts_of(scans: Sequence[EntityScan]) -> dict[str, int]:
    """Return the number of samples of several entities by what became of them."""
    total: dict[str, int] = {}
    for scan in scans:
        for name, n in scan.counts.items():
            total[name] = total.get(name, 0) + n
    return total


def budget_of(
    gradient: Array, registered: Registered, random: float, floor: float, edges: float = 0.0
) -> dict[str, float]:
    """Return the variance of a value by `SOURCES`, given its gradient by the unknowns of a registered image."""
    covariance = registered.covariance
    prior = covariance if registered.prior is None else registered.prior
    parts = (
        *variance_by_input(covariance, prior, gradient, POSE),
        random,
        floor,
        0.0,
        edges,
    )
    return dict(zip(SOURCES, parts, strict=True))


def slopes_by_fitted(measurand: Measurand, fitted: Sequence[Array]) -> list[Array]:
    """Return the value's derivatives by what is fitted of each entity."""
    derivatives = []
    for k, parameters in enumerate(fitted):
        slopes = np.empty(len(parameters))
        for i in range(len(parameters)):
            values = []
            for sign in (1, -1):
                moved = [fit_values[None].copy() for fit_values in fitted]
                moved[k][0, i] += sign * _FITTED_STEP
                values.append(float(measurand.value(moved)[0]))
            slopes[i] = (values[0] - values[1]) / (2 * _FITTED_STEP)
        derivatives.append(slopes)
    return derivatives


def _fitted_by_unknowns(
    scan: EntityScan, frame: Frame, registered: Registered, model: PartModel
) -> tuple[NDArray[np.int64], Array]:
    """Return the unknowns that move a fitted entity (k,), and its derivatives by them (p, k)."""
    unknowns = np.concatenate([np.arange(POSE), model.unknowns_of(scan.edge)])
    signs = np.repeat([1.0, -1.0], len(_STEP))
    moves = signs[:, None] * np.tile(np.diag(_STEP), (2, 1))
    fitted = fits_after(scan, frame, registered, model, moves)
    n = len(_STEP)
    return unknowns, ((fitted[:n] - fitted[n:]) / (2 * _STEP[:, None])).T


def fits_after(
    scan: EntityScan, frame: Frame, registered: Registered, model: PartModel, moves: Array
) -> Array:
    """Return what is fitted (n, p) if the pose and the entity's surfaces were displaced by moves (n, 12)."""
    normal = np.cross(frame.x, frame.y)
    counted = scan.points["state"] == 0
    samples = np.stack([scan.points[name][counted] for name in "xyz"], axis=1)
    lift = np.einsum("mij,i->mj", model.displacement(scan.edge, samples), normal)
    lifted = moves[:, POSE:] @ lift.T
    origins = scan.origins + lifted[..., None] * normal
    poses = displaced(registered.cam2world, moves[:, :POSE])
    directions = np.broadcast_to(scan.directions, (len(moves), *scan.directions.shape))
    flat = carried_back(directions, poses, origins, normal, frame)
    return fit_entities(scan.edge.geometry, flat, scan.px_per_mm**2)[0]


# The length of an edge in an image: its line and a line that leaves each of its ends, intersected
# at the corners.
#
# The value is the plan's: the nominal length times the length of the image over that at the
# registered pose. Lines are fitted in planes through them that face the camera, so that every
# edge is seen across; corners are intersected in the image of a lens without distortion.


_LENGTH_STEP = 1e-4
# mm and rad
_UNKNOWN_STEPS = np.array([1e-3] * 3 + [1e-5] * 3 + [1e-3] * 6)


def read_length(
    where: tuple[str, str, int],
    measurand: Measurand,
    edge: PartEdge,
    picture: Picture,
    registered: Registered,
    model: PartModel,
    how: tuple[float, float, float],
    edge_state: EdgeState = SHARP,
) -> Reading:
    """Return the reading of an edge's length.

    Parameters
    ----------
    where : (str, str, int)
        Names of target and image, and number of the setting.
    measurand : Measurand
        The length.
    edge : PartEdge
        The edge.
    picture : Picture
        The image.
    registered : Registered
        Its pose.
    model : PartModel
        The part.
    how : (float, float, float)
        How far from their predictions lines are searched, px; share of the edge that must be found; error that all
        points of a line have in common, px.
    edge_state : EdgeState
        By how much edges are broken.
    """
    half_px, coverage, floor_px = how
    length_scan = _scan(model, edge, picture, registered, (half_px, coverage, None), edge_state)
    scans = [length_scan]
    reasons = [length_scan.reason]
    for end in ends_of(edge):
        arm = _arm(model, edge, end, picture, registered, half_px, edge_state)
        reasons.append("" if arm else "no line that leaves a corner was found")
        scans += [arm] if arm else []
    counts = counts_of(scans)
    points = tuple(scan.points for scan in scans)
    reason = next(filter(None, reasons), "")
    if reason:
        return Reading(
            *where,
            reason=reason,
            found_share=length_scan.found_share,
            counts=counts,
            points=points,
            moved=length_scan.moved,
        )
    fitted = np.concatenate([scan.fit.fitted for scan in scans if scan.fit is not None])
    planned = _planned_ends(model, edge, registered, picture.camera, np.zeros(POSE + 6))

    def value(parameters: Array) -> float:
        corners = _corners(scans, parameters, registered, picture.camera)
        pitch = np.array(picture.camera.pixel_pitch_mm)
        return float(measurand.image_value(corners[None] * pitch, planned * pitch)[0])

    by_fitted = _slopes(value, fitted)
    random, floor = _localisation(by_fitted, scans, floor_px)
    frames = [_facing(scan.edge, registered) for scan in scans]
    broken = edge_effect(scans, frames, list(by_fitted.reshape(-1, 2)), registered, picture.camera)
    length = measurand.nominal + value(fitted) - broken.shift
    unknowns, slopes = _by_unknowns(model, edge, registered, picture.camera, length)
    gradient = np.zeros(model.n_unknowns)
    np.add.at(gradient, unknowns, slopes)
    budget = budget_of(gradient, registered, random, floor, broken.variance)
    return Reading(
        *where,
        value=length,
        standard_uncertainty=math.sqrt(max(math.fsum(budget.values()), 0.0)),
        budget=budget,
        found_share=length_scan.found_share,
        rms_px=_rms(length_scan),
        counts=counts,
        points=points,
        gradient=gradient,
        edge_shift=broken.by_mm,
    )


def _facing(edge: PartEdge, registered: Registered) -> Frame:
    """Return the plane through an edge that faces the camera."""
    line = edge.geometry
    assert isinstance(line, Line)
    view = line.middle - registered.cam2world[:3, 3]
    across = np.cross(view, line.direction)
    return Frame(line.middle, line.direction, across / np.linalg.norm(across))


def _scan(
    model: PartModel,
    edge: PartEdge,
    picture: Picture,
    registered: Registered,
    how: tuple[float, float, Array | None],
    edge_state: EdgeState,
) -> EntityScan:
    """Scan a line; near a point only, if one is given."""
    half_px, coverage, near = how
    samples = entity_samples(model, [edge], registered, picture.camera, half_px)
    if near is not None and len(samples.edge):
        samples = near_corner(samples, near, registered.cam2world, picture.camera)
    return scan_entity(
        model,
        edge,
        _facing(edge, registered),
        samples,
        picture,
        registered,
        half_px=half_px,
        coverage=coverage,
        edge_state=edge_state,
        # U counts how far a line is extended to its corner
        in_each_part=near is None,
    )


def _arm(
    model: PartModel,
    edge: PartEdge,
    end: Array,
    picture: Picture,
    registered: Registered,
    half_px: float,
    edge_state: EdgeState,
) -> EntityScan | None:
    """Return the line that leaves an end of an edge and is found best; None if there is none."""
    best = None
    share = 0.0
    for other, sine in arms_of(model, edge, end, registered.cam2world, picture.camera):
        scan = _scan(model, other, picture, registered, (half_px, ARM_SHARE, end), edge_state)
        worth = sine * scan.n_found
        if scan.fit is not None and worth > share:
            best = scan
            share = worth
    return best


def _corners(
    scans: Sequence[EntityScan], parameters: Array, registered: Registered, camera: Camera
) -> Array:
    """Return both corners (2, 2), px: the edge's line with that of each arm."""
    lines = []
    for k, scan in enumerate(scans):
        frame = _facing(scan.edge, registered)
        offset, slope = parameters[2 * k : 2 * k + 2]
        line = scan.edge.geometry
        assert isinstance(line, Line)
        at = np.array([-0.5, 0.5]) * line.length
        points = frame.origin + at[:, None] * frame.x + (offset + slope * at)[:, None] * frame.y
        # a line that deviates lies in the plane of its estimate
        lift = _lift(scan, frame)
        images = ideal_images(points + lift, registered.cam2world, camera)
        lines.append(np.cross(np.append(images[0], 1.0), np.append(images[1], 1.0)))
    corners = [np.cross(lines[0], arm) for arm in lines[1:]]
    return np.array([corner[:2] / corner[2] for corner in corners])


def _lift(scan: EntityScan, frame: Frame) -> Array:
    """Return how far the planes of a line's points lie off its frame, mm; the mean, along the normal."""
    normal = np.cross(frame.x, frame.y)
    return np.asarray(float(((scan.origins - frame.origin) @ normal).mean()) * normal)


def _planned_ends(
    model: PartModel, edge: PartEdge, registered: Registered, camera: Camera, move: Array
) -> Array:
    """Return the images of an edge's ends (2, 2) at the registered pose and surfaces, displaced by a move (12,)."""
    ends = np.array(ends_of(edge))
    places = registered.moved(model, edge, ends) + model.displacement(edge, ends) @ move[POSE:]
    return ideal_images(places, displaced(registered.cam2world, move[:POSE])[0], camera)


def _by_unknowns(
    model: PartModel, edge: PartEdge, registered: Registered, camera: Camera, length: float
) -> tuple[NDArray[np.int64], Array]:
    """Return the unknowns that move the length that is compared with, and the value's derivatives by them."""
    pitch = np.array(camera.pixel_pitch_mm)

    def compared(move: Array) -> float:
        ends = _planned_ends(model, edge, registered, camera, move) * pitch
        return float(np.linalg.norm(ends[1] - ends[0]))

    before = compared(np.zeros(len(_UNKNOWN_STEPS)))
    steps = np.diag(_UNKNOWN_STEPS)
    slopes = np.array([compared(step) - compared(-step) for step in steps]) / (2 * _UNKNOWN_STEPS)
    unknowns = np.concatenate([np.arange(POSE), model.unknowns_of(edge)])
    return unknowns, -length / before * slopes


def _slopes(value: Callable[[Array], float], fitted: Array) -> Array:
    """Return the derivatives of a length by what is fitted of all lines."""
    slopes = np.empty(len(fitted))
    for i in range(len(fitted)):
        step = np.zeros(len(fitted))
        step[i] = _LENGTH_STEP
        slopes[i] = (value(fitted + step) - value(fitted - step)) / (2 * _LENGTH_STEP)
    return slopes


def _localisation(
    slopes: Array, scans: Sequence[EntityScan], floor_px: float
) -> tuple[float, float]:
    """Return the variances of a value by single points and by the floor of each line, given its derivatives."""
    random = 0.0
    floor = 0.0
    for k, scan in enumerate(scans):
        slope = slopes[2 * k : 2 * k + 2]
        assert scan.fit is not None
        alike = max(1.0, CORRELATION_PX / scan.spacing_px)
        random += _rms(scan) ** 2 * alike * float(slope @ scan.fit.covariance @ slope)
        floor += scan.common_px(floor_px) ** 2 * float(((slope @ scan.fit.common) ** 2).sum())
    return random, floor


def _rms(scan: EntityScan) -> float:
    residual = scan.points["residual_px"][scan.points["state"] == 0]
    return math.sqrt(float((residual**2).sum()) / max(len(residual) - 2, 1))
