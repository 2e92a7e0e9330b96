"""Scans of one entity of a target in one image, and what was found of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from errors.checks import covariance_root
from errors.measurands import Circle, Geometry, Line, Measurand
from errors.measurands.geometry import Frame
from planner.camera.camera import Camera
from planner.camera.imaging import tangents_of
from planner.camera.pose import world_to_cam
from planner.detectability.image_check import SECTORS
from planner.measuring.fit import Fit, carried_back, fit_entities, floor_modes, robust_fit
from planner.measuring.images import Picture
from planner.measuring.registered import Registered, displaced
from planner.measuring.samples import POSE, PartEdge, PartModel, Samples, across_of, pixels_of
from planner.measuring.scans import ALONG_VARIANCE, STATE_TEXTS, Scans, State
from planner.measuring.verdict import Sampled, beside_shadows, stretches_of

Array = NDArray[np.float64]

LEAST_POINTS = 8
"""Fewer found points are no entity."""
_MARGIN_PX = 4.0
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
        u, v: found place, px (of what was not found, where it was looked for). nu, nv: unit vector across. x, y, z: the
        sample, mm. share: where on the entity. residual_px: distance from the fit. state: see `State`.
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
    """

    edge: PartEdge
    points: NDArray[np.void]
    directions: Array
    origins: Array
    px_per_mm: Array
    fit: Fit | None
    reason: str
    spacing_px: float

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
    own = model.edges.samples(pose, camera, edges, _MARGIN_PX)
    shown = model.shown(pose, camera)
    own.apart[:] = shown.apart(edges, own.edge, pixels_of(own.points, pose, camera), half_px)
    return own


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
    """
    camera = picture.camera
    pose = registered.cam2world
    places = registered.moved(model, edge, samples.points)
    centres = pixels_of(places, pose, camera)
    across = across_of(places, samples.tangents, pose, camera)
    found = _searched(picture, centres, across, samples, half_px)
    if isinstance(edge.geometry, Circle):
        found.offset[:] -= _curvature(centres, across) / 2 * _along_variance(found)
    found.state[:] = _without_shadows(
        model, edge, samples, picture, registered, (centres, across), found
    )
    pixels = centres + np.where(found.state == State.FOUND, found.offset, 0.0)[:, None] * across
    normal = np.cross(frame.x, frame.y)
    # the plane is where the entity is, along the plane's normal
    origins = samples.points + ((places - samples.points) @ normal)[:, None] * normal
    state = found.state.copy()
    residual = np.full(len(state), np.nan)
    fit = None
    kept = state == State.FOUND
    scale = _px_per_mm(edge.geometry, frame, places, across, pose, camera)
    if kept.sum() >= LEAST_POINTS:
        directions = tangents_of(camera, pixels)
        flat = carried_back(directions[kept], pose, origins[kept], normal, frame)
        fit, good = robust_fit(edge.geometry, flat, scale[kept])
        residual[kept] = fit.residual
        state[np.flatnonzero(kept)[~good]] = State.OUTLIER
    points = np.zeros(len(state), dtype=POINT)
    points["u"], points["v"] = pixels.T
    points["nu"], points["nv"] = across.T
    points["x"], points["y"], points["z"] = samples.points.T
    points["share"] = samples.share
    points["residual_px"] = residual
    points["state"] = state
    reason = _incomplete(edge, points, coverage)
    kept = state == State.FOUND
    directions = tangents_of(camera, pixels[kept])
    fit = None if reason else fit
    return EntityScan(
        edge, points, directions, origins[kept], scale[kept], fit, reason, _spacing(centres)
    )


def _searched(
    picture: Picture, centres: Array, across: Array, samples: Samples, half_px: float
) -> Scans:
    """Scan twice: the sign of the step is that of most of the entity."""
    usable = samples.usable
    state = np.where(samples.visible, int(State.NEAR_LINE), int(State.HIDDEN))
    offset, step, blur = np.zeros((3, len(state)))
    if usable.any():
        first = picture.find(centres[usable], across[usable], half_px)
        sign = np.full(len(first.step), sign_of(first), dtype=np.int64)
        found = picture.find(centres[usable], across[usable], half_px, sign)
        state[usable] = found.state
        offset[usable] = found.offset
        step[usable] = found.step
        blur[usable] = found.blur_px
    return Scans(offset, state, step, blur)


def _without_shadows(
    model: PartModel,
    edge: PartEdge,
    samples: Samples,
    picture: Picture,
    registered: Registered,
    where: tuple[Array, Array],
    found: Scans,
) -> NDArray[np.int64]:
    """Return what became of samples (m,) if a shadow that ends beside the edge does not count as the edge."""
    lamp = registered.lamps.get(picture.name)
    good = found.state == State.FOUND
    if lamp is None or not good.any():
        return found.state
    own = replace(samples, edge=np.zeros_like(samples.edge))
    pose = registered.cam2world
    sampled = Sampled(model.edges.scene, picture.camera, pose, [edge], own)
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


def sign_of(scans: Scans) -> int:
    """Return the sign of an edge's step: that of its strongest scans."""
    good = scans.state == State.FOUND
    strong = scans.step[good] if good.any() else scans.step[np.isfinite(scans.step)]
    if not len(strong):
        return 0
    limit = np.quantile(np.abs(strong), 0.5)
    total = float(np.sign(strong[np.abs(strong) >= limit]).sum())
    return int(np.sign(total))


def _spacing(centres: Array) -> float:
    """Return the distance of neighbouring samples in the image, px."""
    if len(centres) < 2:
        return 1.0
    return max(float(np.median(np.linalg.norm(np.diff(centres, axis=0), axis=1))), 0.1)


def _px_per_mm(
    geometry: Geometry, frame: Frame, places: Array, across: Array, pose: Array, camera: Camera
) -> Array:
    """Return how many pixels across an entity's image a millimetre across it is (m,)."""
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


def _incomplete(edge: PartEdge, points: NDArray[np.void], coverage: float) -> str:
    """Say why what was found of an entity is not enough; empty if it is."""
    what = "edge" if isinstance(edge.geometry, Line) else "rim"
    if not len(points):
        return f"the image of {what} {edge.name} is too short"
    found = points["state"] == State.FOUND
    share = float(found.mean())
    if share < coverage or found.sum() < LEAST_POINTS:
        counts = {state: int(np.sum(points["state"] == state)) for state in State}
        del counts[State.FOUND]
        worst = max(counts, key=lambda state: counts[state])
        if counts[worst] >= 0.9 * len(points):
            return f"{what} {edge.name} is {STATE_TEXTS[worst]}"
        rest = f"{100 * counts[worst] / len(points):.0f} % is {STATE_TEXTS[worst]}"
        return f"only {100 * share:.0f} % of {what} {edge.name} was found; {rest}"
    low = points["share"].min()
    high = points["share"].max()
    sector = np.minimum(
        ((points["share"] - low) / max(high - low, 1e-12) * SECTORS).astype(int), SECTORS - 1
    )
    missing = set(sector.tolist()) - set(sector[found].tolist())
    if missing:
        return f"a twelfth of {what} {edge.name} was not found"
    return ""


def largest_state(counts: Mapping[str, int]) -> str:
    """Return the state that most samples have which were not found; empty if all were found."""
    rest = {name: n for name, n in counts.items() if name != STATE_TEXTS[State.FOUND]}
    return max(rest, key=lambda name: rest[name]) if rest else ""


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
    """
    rng = np.random.default_rng(seed)
    own = [model.unknowns_of(scan.edge) for scan in scans]
    unknowns = np.unique(np.concatenate([np.arange(POSE), *own]))
    root = covariance_root(registered.covariance[np.ix_(unknowns, unknowns)])
    moves = rng.standard_normal((DRAWS, len(unknowns))) @ root.T
    fits = []
    for scan, frame, surfaces, (sigma, floor) in zip(
        scans, measurand.frames, own, noise, strict=True
    ):
        columns = np.searchsorted(unknowns, surfaces)
        drawn = np.concatenate([moves[:, :POSE], moves[:, columns]], axis=1)
        fits.append(_drawn_fits(scan, frame, registered, model, drawn, (sigma, floor), rng))
    values = measurand.value(fits)
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
    kept = scan.points["state"] == 0
    samples = np.stack([scan.points[name][kept][thin] for name in "xyz"], axis=1)
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
