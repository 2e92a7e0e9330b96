"""The uncertainty of a reading by drawing (JCGM 101): the check of the one by derivatives.

Poses, surfaces and points are drawn from their distributions and go through the same fit and value. Points are thinned,
and their errors made smaller by the root of how many each stands for, so that the fit is as sure as with all of them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from errors.covariance import covariance_root
from errors.measurands import Circle, Geometry, Measurand
from errors.measurands.fitted import Frame
from planner.measuring.entity_scan import EntityScan
from planner.measuring.fit import carried_back, fit_entities, floor_modes
from planner.measuring.part_model import POSE, PartModel
from planner.measuring.poses.registered import Registered, displaced

Array = NDArray[np.float64]

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
