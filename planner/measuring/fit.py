"""Lines and circles through found points, each in its own freedoms: a line has two, a circle three.

Points are found across an edge in the image, so only their distance across it counts. They are carried back along their
rays to the plane of the entity and fitted there; a point's weight is the square of the pixels that a millimetre across
the entity has in the image.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from errors.measurands import Geometry, MeasuredCircle
from errors.measurands.geometry import Frame

Array = NDArray[np.float64]

TUKEY = 4.685
"""Residuals beyond this many standard deviations have no weight in robust fits."""
CORRELATION_PX = 4.0
"""Found points nearer than this in the image are not independent."""
LEAST_SCALE_PX = 0.03
"""Smallest standard deviation that residuals of robust fits are taken to have."""

_ROUNDS = 12
_STILL = 1e-10
# so many subsets of three points: one without wrong points is among them if half of the points are right
_SUBSETS = 60


class Fit(NamedTuple):
    """An entity that was fitted.

    Attributes
    ----------
    fitted : array (2,) or (3,)
        Offset and slope of a line; centre and radius of a circle; in its frame, mm.
    covariance : array (p, p)
        Of these for independent errors of 1 px across.
    common : array (p, q)
        How they move if all points move by 1 px across, and if they move by half a px across in ways that a fit cannot
        tell from the entity's own: the ends of a line against each other, opposite sides of a circle together.
    residual : array (m,)
        Distance of each point from the fit across the edge, px.
    """

    fitted: Array
    covariance: Array
    common: Array
    residual: Array


def floor_modes(geometry: Geometry, design: Array) -> Array:
    """Return how far points (m, q) are off in each mode of the localisation's floor, px."""
    if isinstance(geometry, MeasuredCircle):
        return np.stack([np.ones(len(design)), *(0.5 * design[:, :2].T)], axis=1)
    along = design[:, 1]
    low = along.min()
    high = along.max()
    share = (2 * along - low - high) / max(high - low, 1e-12)
    return np.stack([np.ones(len(design)), 0.5 * share], axis=1)


def tukey_weights(residual: Array, scale: float) -> Array:
    """Return Tukey's weights (m,) of residuals, 1 at 0 and 0 from `TUKEY` scales on."""
    share = np.clip(np.abs(residual) / (TUKEY * scale), 0.0, 1.0)
    return np.asarray((1 - share**2) ** 2)


def scale_of(residual: Array) -> float:
    """Return a robust standard deviation of residuals, px: from the median of their sizes."""
    if not len(residual):
        return LEAST_SCALE_PX
    spread = 1.4826 * float(np.median(np.abs(residual)))
    return max(spread, LEAST_SCALE_PX)


def uneven_px(residual: Array, spacing_px: float) -> float:
    """Return how far points of an entity, in order, are off more than those near them differ, px.

    Points that are `CORRELATION_PX` apart err independently, so they differ as much as points that are far apart. Where
    a shadow ends near an edge, a whole stretch is off, and in one direction. The difference of the mean square and half
    the mean square of these differences is the variance of such errors (von Neumann, Ann. Math. Stat. 12, 1941).

    Parameters
    ----------
    residual : array (m,)
        Distances from the fit, px.
    spacing_px : float
        Distance of neighbours.
    """
    apart = math.ceil(CORRELATION_PX / spacing_px)
    if len(residual) <= apart:
        return 0.0
    alone = float(((residual[apart:] - residual[:-apart]) ** 2).mean()) / 2
    return math.sqrt(max(float((residual**2).mean()) - alone, 0.0))


def carried_back(
    directions: Array, cam2world: Array, origins: Array, normal: Array, frame: Frame
) -> Array:
    """Return where rays meet planes that are parallel to a frame's, as coordinates in it.

    Parameters
    ----------
    directions : array (..., m, 2)
        x/z and y/z of the rays in the camera's frame.
    cam2world : array (..., 4, 4)
        Poses of the camera.
    origins : array (..., m, 3)
        A point of each ray's plane.
    normal : array (3,)
        Its unit normal.
    frame : Frame
        The frame.

    Returns
    -------
    array (..., m, 2)
        In mm.
    """
    ones = np.ones((*directions.shape[:-1], 1))
    rays = np.concatenate([directions, ones], axis=-1) @ np.swapaxes(cam2world[..., :3, :3], -1, -2)
    centre = cam2world[..., None, :3, 3]
    depth = ((origins - centre) @ normal) / (rays @ normal)
    local = centre + depth[..., None] * rays - frame.origin
    return np.asarray(np.stack([local @ frame.x, local @ frame.y], axis=-1))


def fit_entities(geometry: Geometry, flat: Array, weight: Array) -> tuple[Array, Array, Array]:
    """Fit a line or circle to points in its frame, many times at once.

    Parameters
    ----------
    geometry : Line or MeasuredCircle
        What is fitted.
    flat : array (n, m, 2)
        Points, mm.
    weight : array (m,)
        Their weights.

    Returns
    -------
    fitted : array (n, p)
        Offset and slope, or centre and radius.
    design : array (m, p)
        How far each point is off, across the entity, for each unit of these; of the first fit.
    residual : array (n, m)
        Distances, mm.
    """
    if isinstance(geometry, MeasuredCircle):
        return _circles(flat, weight, geometry.radius_mm)
    along = flat[..., 0]
    columns = [np.ones_like(along), along]
    fitted = _solved(columns, flat[..., 1], weight)
    residual = flat[..., 1] - fitted[:, :1] - fitted[:, 1:] * along
    # of a slope, what a point is off across the line; slopes are small
    return fitted, _first(columns), residual


def _circles(flat: Array, weight: Array, radius: float) -> tuple[Array, Array, Array]:
    fitted = np.tile([0.0, 0.0, radius], (len(flat), 1))
    x, y = (np.ascontiguousarray(flat[..., k]) for k in (0, 1))
    ones = np.ones_like(x)
    for _ in range(_ROUNDS):
        dx = x - fitted[:, :1]
        dy = y - fitted[:, 1:2]
        distance = np.maximum(np.sqrt(dx**2 + dy**2), 1e-9 * radius)
        columns = [dx / distance, dy / distance, ones]
        residual = distance - fitted[:, 2:]
        step = _solved(columns, residual, weight)
        fitted = fitted + step
        if np.abs(step).max() <= _STILL * radius:
            break
    return fitted, _first(columns), residual


def _first(columns: Sequence[Array]) -> Array:
    """Return the design (m, p) of the first fit, given its columns (n, m)."""
    return np.stack([column[0] for column in columns], axis=-1)


def _solved(columns: Sequence[Array], right: Array, weight: Array) -> Array:
    """Return weighted least squares solutions (n, p) by columns (n, m); the shortest where some do not decide."""
    p = len(columns)
    normal = np.empty((len(right), p, p))
    sides = np.empty((len(right), p, 1))
    for i, column in enumerate(columns):
        for j in range(i + 1):
            normal[:, i, j] = normal[:, j, i] = (column * columns[j]) @ weight
        sides[:, i, 0] = (column * right) @ weight
    try:
        return np.asarray(np.linalg.solve(normal, sides)[..., 0])
    except np.linalg.LinAlgError:
        # points drawn at random may lie on one line
        return np.asarray((np.linalg.pinv(normal, hermitian=True) @ sides)[..., 0])


def robust_fit(geometry: Geometry, flat: Array, px_per_mm: Array) -> tuple[Fit, NDArray[np.bool_]]:
    """Fit a line or circle to points of which some are wrong.

    Parameters
    ----------
    geometry : Line or MeasuredCircle
        What is fitted.
    flat : array (m, 2)
        Points in its frame, mm; enough of them.
    px_per_mm : array (m,)
        Pixels of a millimetre across the entity.

    Returns
    -------
    Fit
        The fit to the points that are kept.
    kept : array of bool (m,)
        Which these are.
    """
    off = _first_residual(geometry, flat, px_per_mm)
    scale = scale_of(off)
    weight = tukey_weights(off, scale)
    for _ in range(_ROUNDS):
        fitted, design, residual = fit_entities(geometry, flat[None], weight * px_per_mm**2)
        off = residual[0] * px_per_mm
        scale = scale_of(off[weight > 0])
        before = weight
        weight = tukey_weights(off, scale)
        if np.abs(weight - before).max() < 1e-4:
            break
    within = np.abs(off) <= TUKEY * scale
    final = within * px_per_mm**2
    fitted, design, residual = fit_entities(geometry, flat[None], final)
    rows = design * (px_per_mm * within)[:, None]
    covariance = np.asarray(np.linalg.inv(rows.T @ rows), dtype=np.float64)
    common = covariance @ (rows.T @ (floor_modes(geometry, design) * within[:, None]))
    return Fit(fitted[0], covariance, common, residual[0] * px_per_mm), within


def _first_residual(geometry: Geometry, flat: Array, px_per_mm: Array) -> Array:
    """Return distances (m,), px, from the fit through a few points that has the least median of them.

    A quarter of a rim may be a shadow: a fit to all points lies between both, and weights do not leave it again.
    Rousseeuw, Least median of squares regression, J. Am. Stat. Assoc. 79 (1984).
    """
    count = 3 if isinstance(geometry, MeasuredCircle) else 2
    # the same subsets for the same number of points
    rng = np.random.default_rng(len(flat))
    # one point of each of several equal parts, so that no subset is narrow
    part = len(flat) // count
    chosen = rng.integers(0, part, (_SUBSETS, count)) + part * np.arange(count)
    shifted = (chosen + rng.integers(0, len(flat), (_SUBSETS, 1))) % len(flat)
    chosen = shifted if count == 3 else chosen
    fitted, _, _ = fit_entities(geometry, flat[chosen], np.ones(count))
    good = np.isfinite(fitted).all(axis=1)
    if isinstance(geometry, MeasuredCircle):
        away = flat - fitted[good, None, :2]
        residual = np.hypot(away[..., 0], away[..., 1]) - fitted[good, 2:]
    else:
        residual = flat[:, 1] - fitted[good, :1] - fitted[good, 1:] * flat[:, 0]
    residual = residual * px_per_mm
    return np.asarray(residual[int(np.argmin(np.median(np.abs(residual), axis=1)))])
