"""Readings: the value of one target in one image, its uncertainty by source, or why there is none."""

from __future__ import annotations

import math
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from aspectgraph.entities.carriers import PARAMETERS
from errors.measurands import Measurand
from errors.measurands.conformity import COVERAGE
from errors.measurands.fitted import Frame
from errors.registration import rests_on_prior
from planner.measuring.entity_scan import EntityScan
from planner.measuring.fit import CORRELATION_PX, carried_back, fit_entities, uneven_px
from planner.measuring.image.scans import STATE_TEXTS, State
from planner.measuring.monte_carlo import TOLERATED, drawn_uncertainty
from planner.measuring.part_model import POSE, PartModel
from planner.measuring.poses.registered import Registered, displaced

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
        U by drawing instead of derivatives, see `planner.measuring.monte_carlo`.
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
