"""Readings: the value of one target in one image, its uncertainty by source, or why there is none."""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2 as chi_squared

from aspectgraph.entities.entity_rules import PARAMETERS
from errors.measurands import (
    Decision,
    DecisionRule,
    Line,
    Measurand,
    conformance_probability,
    decide,
)
from errors.measurands.geometry import Frame
from errors.measurands.measurand import COVERAGE
from errors.registration import rests_on_prior
from planner.camera.camera import Camera
from planner.camera.pose import world_to_cam
from planner.measuring.entity_scan import (
    TOLERATED,
    EntityScan,
    drawn_uncertainty,
    entity_samples,
    scan_entity,
)
from planner.measuring.fit import CORRELATION_PX, carried_back, fit_entities, uneven_px
from planner.measuring.images import Picture
from planner.measuring.registered import Registered, displaced
from planner.measuring.samples import POSE, PartEdge, PartModel
from planner.measuring.scans import STATE_TEXTS, State
from planner.request.planned import PlannedTarget

Array = NDArray[np.float64]

SOURCES = ("pose", "surfaces", "pose with surfaces", "localisation", "localisation floor")
"""What the variance of a reading comes from. What pose and surfaces have in common may be negative."""

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
        U by drawing instead of derivatives, see `planner.measuring.entity_scan`.
    notes : tuple of str
        What the user should know.
    """

    name: str
    image: str
    setting: int
    value: float = math.nan
    standard_uncertainty: float = math.nan
    budget: dict[str, float] = field(default_factory=dict)
    reason: str = ""
    found_share: float = 0.0
    rms_px: float = math.nan
    counts: dict[str, int] = field(default_factory=dict)
    points: tuple[NDArray[np.void], ...] = ()
    gradient: Array = field(default_factory=lambda: np.empty(0))
    drawn_uncertainty: float = math.nan
    notes: tuple[str, ...] = ()

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
    """
    counts = counts_of(scans)
    share = min(scan.found_share for scan in scans)
    points = tuple(scan.points for scan in scans)
    reasons = [scan.reason for scan in scans if scan.reason]
    if reasons:
        return Reading(*where, reason=reasons[0], found_share=share, counts=counts, points=points)
    fits = [scan.fit for scan in scans if scan.fit is not None]
    value = measurand.nominal + float(measurand.value([fit.fitted[None] for fit in fits])[0])
    by_fitted = _by_fitted(measurand, [fit.fitted for fit in fits])
    random = 0.0
    floor = 0.0
    gradient = np.zeros(model.n_unknowns)
    rms = []
    noise = []
    for scan, fit, frame, own in zip(scans, fits, measurand.frames, by_fitted, strict=True):
        kept = np.isfinite(scan.points["residual_px"]) & (scan.points["state"] == 0)
        residual = scan.points["residual_px"][kept]
        variance = float((residual**2).sum() / max(len(residual) - len(own), 1))
        rms.append(float((residual**2).mean()))
        alike = max(1.0, CORRELATION_PX / scan.spacing_px)
        # such errors have one direction, so their mean over the entity is about as large as they are
        common_px = math.hypot(floor_px, uneven_px(residual, scan.spacing_px))
        noise.append((math.sqrt(variance * alike), common_px))
        random += variance * alike * float(own @ fit.covariance @ own)
        floor += common_px**2 * float(((own @ fit.common) ** 2).sum())
        unknowns, rows = _fitted_by_unknowns(scan, frame, registered, model)
        np.add.at(gradient, unknowns, own @ rows)
    budget = budget_of(gradient, registered.covariance, random, floor)
    u = math.sqrt(max(math.fsum(budget.values()), 0.0))
    # of the name, so that no other target changes the draws
    seed = zlib.crc32(where[0].encode())
    drawn = drawn_uncertainty(measurand, scans, registered, model, noise, seed)
    return Reading(
        *where,
        value=value,
        standard_uncertainty=u,
        budget=budget,
        found_share=share,
        rms_px=math.sqrt(float(np.mean(rms))),
        counts=counts,
        points=points,
        gradient=gradient,
        drawn_uncertainty=drawn,
        notes=_notes(COVERAGE * u, drawn, gradient, registered),
    )


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


def budget_of(gradient: Array, covariance: Array, random: float, floor: float) -> dict[str, float]:
    """Return the variance of a value by `SOURCES`, given its gradient by the unknowns and their covariance."""
    by_pose = gradient[:POSE]
    by_surface = gradient[POSE:]
    parts = (
        float(by_pose @ covariance[:POSE, :POSE] @ by_pose),
        float(by_surface @ covariance[POSE:, POSE:] @ by_surface),
        2 * float(by_pose @ covariance[:POSE, POSE:] @ by_surface),
        random,
        floor,
    )
    return dict(zip(SOURCES, parts, strict=True))


def _by_fitted(measurand: Measurand, fitted: Sequence[Array]) -> list[Array]:
    """Return the value's derivatives by what is fitted of each entity."""
    found = []
    for k, own in enumerate(fitted):
        slopes = np.empty(len(own))
        for i in range(len(own)):
            values = []
            for sign in (1, -1):
                moved = [one[None].copy() for one in fitted]
                moved[k][0, i] += sign * _FITTED_STEP
                values.append(float(measurand.value(moved)[0]))
            slopes[i] = (values[0] - values[1]) / (2 * _FITTED_STEP)
        found.append(slopes)
    return found


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
    kept = scan.points["state"] == 0
    samples = np.stack([scan.points[name][kept] for name in "xyz"], axis=1)
    lift = np.einsum("mij,i->mj", model.displacement(scan.edge, samples), normal)
    lifted = moves[:, POSE:] @ lift.T
    origins = scan.origins + lifted[..., None] * normal
    poses = displaced(registered.cam2world, moves[:, :POSE])
    directions = np.broadcast_to(scan.directions, (len(moves), *scan.directions.shape))
    flat = carried_back(directions, poses, origins, normal, frame)
    return fit_entities(scan.edge.geometry, flat, scan.px_per_mm**2)[0]


def covariance_of(readings: Mapping[str, Reading], covariance: Array) -> Array:
    """Return the covariance (n, n) of readings of one image by what they have in common: pose and surfaces."""
    gradients = np.array([one.gradient for one in readings.values()])
    return np.asarray(gradients @ covariance @ gradients.T)


# Results: the readings of one target merged, its expanded uncertainty, and the decision.


CONSISTENT = 0.99
"""Readings of one target that differ more than with this probability are said to disagree."""

# errors that readings from several images have in common
_COMMON = ("surfaces", "localisation floor")


@dataclass(frozen=True)
class Result:
    """One target, measured.

    Attributes
    ----------
    name, kind, unit : str
        The target.
    nominal : float
        Nominal value, mm (angles: degrees), as everything here.
    tolerance : (float, float) or None
        Lower and upper deviation that the drawing allows.
    value : float
        Measured value; nan if it was not measured.
    standard_uncertainty : float
        Its u.
    decision : Decision
        What it says of the part.
    conformance_probability : float
        Probability that the part is within its tolerance; nan without value or tolerance.
    reason : str
        Why it was not measured; empty if it was.
    readings : tuple of Reading
        In the order of the images.
    notes : tuple of str
        What the user should know.
    """

    name: str
    kind: str
    unit: str
    nominal: float
    tolerance: tuple[float, float] | None
    value: float
    standard_uncertainty: float
    decision: Decision
    conformance_probability: float
    reason: str
    readings: tuple[Reading, ...]
    notes: tuple[str, ...] = field(default=())

    @property
    def measured(self) -> bool:
        """Whether it has a value."""
        return not self.reason

    @property
    def deviation(self) -> float:
        """Measured value minus nominal value."""
        return self.value - self.nominal

    @property
    def expanded_uncertainty(self) -> float:
        """U, two standard uncertainties."""
        return COVERAGE * self.standard_uncertainty

    @property
    def budget(self) -> dict[str, float]:
        """Variance by source of the reading with the smallest uncertainty; empty if none was measured."""
        measured = [one for one in self.readings if one.measured]
        if not measured:
            return {}
        return min(measured, key=lambda one: one.standard_uncertainty).budget


def merged(
    name: str,
    target: PlannedTarget,
    readings: Sequence[Reading],
    rule: DecisionRule,
    missing: str = "",
) -> Result:
    """Return the result of a target.

    Readings are weighted by their variances. What pose and single points do is independent between images. The
    deviations of surfaces and the floor of the localisation are common, and do not average out.

    Parameters
    ----------
    name : str
        The target's name.
    target : PlannedTarget
        The target.
    readings : sequence of Reading
        Its readings.
    rule : DecisionRule
        How it is decided.
    missing : str
        Why there is no reading at all.
    """
    known = (name, target.kind, target.unit, target.nominal, target.tolerance)
    good = [one for one in readings if one.measured]
    if not good:
        reason = missing or "; ".join(dict.fromkeys(f"{r.image}: {r.reason}" for r in readings))
        nothing = (math.nan, math.nan, Decision.NOT_MEASURED, math.nan)
        return Result(*known, *nothing, reason or "no image shows it", tuple(readings))
    value, u, notes = _weighted(good)
    notes += tuple(dict.fromkeys(note for one in good for note in one.notes))
    deviation = value - target.nominal
    decision = decide(deviation, u, target.tolerance, rule)
    probability = math.nan
    if target.tolerance is not None:
        probability = conformance_probability(deviation, u, target.tolerance)
    return Result(*known, value, u, decision, probability, "", tuple(readings), notes)


def _weighted(readings: Sequence[Reading]) -> tuple[float, float, tuple[str, ...]]:
    """Return the weighted mean of readings, its standard uncertainty, and notes."""
    if len(readings) == 1:
        return readings[0].value, readings[0].standard_uncertainty, ()
    inverse = [1 / max(one.standard_uncertainty, 1e-12) ** 2 for one in readings]
    weights = [one / math.fsum(inverse) for one in inverse]
    value = math.fsum(w * one.value for w, one in zip(weights, readings, strict=True))
    common = math.fsum(
        w * math.sqrt(math.fsum(one.budget[source] for source in _COMMON))
        for w, one in zip(weights, readings, strict=True)
    )
    own = math.fsum(
        w**2 * (one.standard_uncertainty**2 - math.fsum(one.budget[s] for s in _COMMON))
        for w, one in zip(weights, readings, strict=True)
    )
    u = math.sqrt(max(common**2 + own, 0.0))
    spread = math.fsum(
        (one.value - value) ** 2 * i for one, i in zip(readings, inverse, strict=True)
    )
    freedoms = len(readings) - 1
    if spread <= chi_squared.ppf(CONSISTENT, freedoms):
        return value, u, ()
    note = f"{len(readings)} readings disagree: u is enlarged by their spread"
    return value, u * math.sqrt(spread / freedoms), (note,)


# The length of an edge in an image: its line and a line that leaves each of its ends, intersected
# at the corners.
#
# The value is the plan's: the nominal length times the length of the image over that at the
# registered pose. Lines are fitted in planes through them that face the camera, so that every
# edge is seen across; corners are intersected in the image of a lens without distortion.


LEAST_ANGLE_DEG = 20.0
"""A corner is where another line leaves an edge at this angle at least, in the image."""
ARM_SHARE = 0.5
"""Share of the samples of such a line that must be found."""
ARM_PX = 200.0
"""Such a line is used up to this distance from the corner."""

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
    """
    half_px, coverage, floor_px = how
    own = _scan(model, edge, picture, registered, (half_px, coverage, None))
    scans = [own]
    reasons = [own.reason]
    for end in _ends(edge):
        arm = _arm(model, edge, end, picture, registered, half_px)
        reasons.append("" if arm else "no line that leaves a corner was found")
        scans += [arm] if arm else []
    counts = counts_of(scans)
    points = tuple(scan.points for scan in scans)
    reason = next(filter(None, reasons), "")
    if reason:
        return Reading(
            *where, reason=reason, found_share=own.found_share, counts=counts, points=points
        )
    fitted = np.concatenate([scan.fit.fitted for scan in scans if scan.fit is not None])
    planned = _planned_ends(model, edge, registered, picture.camera, np.zeros(POSE + 6))

    def value(parameters: Array) -> float:
        corners = _corners(scans, parameters, registered, picture.camera)
        pitch = np.array(picture.camera.pixel_pitch_mm)
        return float(measurand.image_value(corners[None] * pitch, planned * pitch)[0])

    random, floor = _localisation(value, fitted, scans, floor_px)
    length = measurand.nominal + value(fitted)
    unknowns, slopes = _by_unknowns(model, edge, registered, picture.camera, length)
    gradient = np.zeros(model.n_unknowns)
    np.add.at(gradient, unknowns, slopes)
    budget = budget_of(gradient, registered.covariance, random, floor)
    return Reading(
        *where,
        value=length,
        standard_uncertainty=math.sqrt(max(math.fsum(budget.values()), 0.0)),
        budget=budget,
        found_share=own.found_share,
        rms_px=_rms(own),
        counts=counts,
        points=points,
        gradient=gradient,
    )


def _ends(edge: PartEdge) -> tuple[Array, Array]:
    line = edge.geometry
    assert isinstance(line, Line)
    return line.p, line.q


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
) -> EntityScan:
    """Scan a line; near a point only, if one is given."""
    half_px, coverage, near = how
    samples = entity_samples(model, [edge], registered, picture.camera, half_px)
    if near is not None and len(samples.edge):
        pose = registered.cam2world
        places = _images(samples.points, pose, picture.camera)
        close = np.linalg.norm(places - _images(near[None], pose, picture.camera), axis=1) <= ARM_PX
        samples = samples.chosen(close)
    return scan_entity(
        model,
        edge,
        _facing(edge, registered),
        samples,
        picture,
        registered,
        half_px=half_px,
        coverage=coverage,
    )


def _arm(
    model: PartModel,
    edge: PartEdge,
    end: Array,
    picture: Picture,
    registered: Registered,
    half_px: float,
) -> EntityScan | None:
    """Return the line that leaves an end of an edge and is found best; None if there is none."""
    best = None
    share = 0.0
    along = _image_way(edge, end, registered, picture.camera)
    for other in model.leaving(edge, end):
        way = _image_way(other, end, registered, picture.camera)
        sine = abs(float(along[0] * way[1] - along[1] * way[0]))
        if sine < math.sin(math.radians(LEAST_ANGLE_DEG)):
            continue
        scan = _scan(model, other, picture, registered, (half_px, ARM_SHARE, end))
        worth = sine * scan.n_found
        if scan.fit is not None and worth > share:
            best = scan
            share = worth
    return best


def _image_way(edge: PartEdge, end: Array, registered: Registered, camera: Camera) -> Array:
    """Return the unit vector along an edge in the image, away from one of its ends."""
    p, q = _ends(edge)
    other = q if np.linalg.norm(p - end) < np.linalg.norm(q - end) else p
    images = _images(np.array([end, end + 1e-3 * (other - end)]), registered.cam2world, camera)
    way = images[1] - images[0]
    return np.asarray(way / max(float(np.linalg.norm(way)), 1e-12))


def _images(points: Array, pose: Array, camera: Camera) -> Array:
    """Return images (n, 2) in px of a lens without distortion."""
    local = world_to_cam(points, pose)
    return np.asarray((local / local[:, 2:] @ camera.matrix.T)[:, :2])


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
        images = _images(points + lift, registered.cam2world, camera)
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
    ends = np.array(_ends(edge))
    places = registered.moved(model, edge, ends) + model.displacement(edge, ends) @ move[POSE:]
    return _images(places, displaced(registered.cam2world, move[:POSE])[0], camera)


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


def _localisation(
    value: Callable[[Array], float], fitted: Array, scans: Sequence[EntityScan], floor_px: float
) -> tuple[float, float]:
    """Return the variances of the value by single points and by the floor of each line."""
    slopes = np.empty(len(fitted))
    for i in range(len(fitted)):
        step = np.zeros(len(fitted))
        step[i] = _LENGTH_STEP
        slopes[i] = (value(fitted + step) - value(fitted - step)) / (2 * _LENGTH_STEP)
    random = 0.0
    floor = 0.0
    for k, scan in enumerate(scans):
        own = slopes[2 * k : 2 * k + 2]
        assert scan.fit is not None
        alike = max(1.0, CORRELATION_PX / scan.spacing_px)
        random += _rms(scan) ** 2 * alike * float(own @ scan.fit.covariance @ own)
        residual = scan.points["residual_px"][scan.points["state"] == 0]
        common_px = math.hypot(floor_px, uneven_px(residual, scan.spacing_px))
        floor += common_px**2 * float(((own @ scan.fit.common) ** 2).sum())
    return random, floor


def _rms(scan: EntityScan) -> float:
    residual = scan.points["residual_px"][scan.points["state"] == 0]
    return math.sqrt(float((residual**2).sum()) / max(len(residual) - 2, 1))
