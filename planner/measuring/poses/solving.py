"""One round of a registration: the next unknowns from what was found, and how badly unknowns explain it.

See `planner.measuring.poses.register` for the notation.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from errors.registration import Rows, posterior
from planner.measuring.fit import CORRELATION_PX, TUKEY, tukey_weights
from planner.measuring.image.samples import STEP_PX
from planner.measuring.part_model import POSE
from planner.measuring.poses.task import LEAST_NOISE_PX, Found, Task, residual_scale

Array = NDArray[np.float64]

DAMPING = 1.0
"""Each round keeps unknowns near those of the last one, this share of how the prior keeps them near zero.

What an image hardly tells lies along a curved valley, in which steps would be too long otherwise.
"""
LEAST_KEPT = 0.6
"""Where edges count as a whole, one counts if this share of its found samples fits the others at least."""


def solved(
    task: Task, x: Array, across: Array, found: list[Found], *, going_on: bool, whole: bool
) -> tuple[Array, list[Rows]]:
    """Return the next unknowns, and the rows that they are from.

    Weights of a first solution make the second one. Each edge has one bias: as long as outliers are not left out, this
    finds the pose more surely than biases of more modes.

    Parameters
    ----------
    task : Task
        What is registered.
    x : array (n,)
        The unknowns.
    across : array (m, 2)
        Unit vectors across the edges there.
    found : list of Found
        What was found there in each image.
    going_on : bool
        Whether rounds follow.
    whole : bool
        Whether edges count as a whole or not at all.
    """
    design = task.design(x, across)
    now = moved(task, design, x)
    weights = [tukey_weights(one.offset, residual_scale(one.offset[one.good])) for one in found]
    then = x
    for _ in range(2 if going_on else 3):
        rows = []
        offsets = [one.offset - moved(task, design, then - x) for one in found]
        counted = [one.good & (weight > 0) for one, weight in zip(found, weights, strict=True)]
        left = [
            rest - task.edge_means(rest, own) for rest, own in zip(offsets, counted, strict=True)
        ]
        noise = _noise(left, found)
        if then is not x:
            weights = [tukey_weights(own, noise) for own in left]
        if whole and then is not x:
            weights = [
                _of_whole_edges(task, one, weight)
                for one, weight in zip(found, weights, strict=True)
            ]
        variance = _correlated(noise)
        for one, weight in zip(found, weights, strict=True):
            rows += rows_of(task, design, one.offset + now, one.good * weight / variance)
        alike = [one._replace(modes=None) for one in rows]
        then = damped(task.prior, x, alike, task.bias_px**2)
    return then, rows


def damped(prior: Array, x: Array, rows: list[Rows], variance: float) -> Array:
    """Return the mean of the posterior if the unknowns are also known to be near x.

    This is Levenberg's damping (1944) in the metric of the prior. What no row tells of stays where it was: an edge that
    is left out for now must be found again.
    """
    nearer = 1 + DAMPING
    middle = x * DAMPING / nearer
    from_middle = [
        one._replace(residual=one.residual - one.design @ middle[one.unknowns]) for one in rows
    ]
    then = posterior(prior / nearer, from_middle, variance).mean + middle
    told = np.zeros(len(x), dtype=np.bool_)
    for one in rows:
        told[one.unknowns] = True
    return np.where(told, then, x)


def noise_of(task: Task, found: list[Found]) -> float:
    """Return the standard deviation of found points about their edges, px."""
    return _noise([one.offset - task.edge_means(one.offset, one.good) for one in found], found)


def cost_of(
    task: Task, x: Array, found: list[Found], noise: float, biases: float | None = None
) -> float:
    """Return how badly unknowns explain what was found: -2 log of the density, but for a constant.

    Points that are far off their edge's median cost as much as where Tukey's weights end, and so do those not found. No
    edge costs more than if all of its points were so.

    Parameters
    ----------
    task : Task
        What is registered.
    x : array (n,)
        The unknowns.
    found : list of Found
        What was found there in each image.
    noise : float
        Standard deviation of found points, px.
    biases : float, optional
        Variance of the biases of each edge, of all modes, px². Default: it has one, with the variance of the task.
    """
    variance = _correlated(noise)
    most = (TUKEY * noise) ** 2 / variance
    each = task.bias_px**2 if biases is None else biases
    total = float(x @ task.information @ x)
    for one in found:
        for k, own in enumerate(task.own):
            at = own.start + np.flatnonzero(one.good[own])
            if len(at):
                off = one.offset[at]
                at = at[np.abs(off - np.median(off)) <= TUKEY * noise]
            lost = own.stop - own.start - len(at)
            square = 0.0
            if len(at):
                modes = np.ones((len(at), 1)) if biases is None else _bias_modes(task, k, at)
                square = _square(one.offset[at], modes, variance, each)
            total += min(square + lost * most, (own.stop - own.start) * most)
    return total


def _square(offset: Array, modes: Array, variance: float, biases: float) -> float:
    """Return the square of offsets (m,) in their standard deviations, with biases along modes (m, q)."""
    common = modes.T @ offset / variance
    inner = np.eye(modes.shape[1]) / biases + modes.T @ modes / variance
    return float(offset @ offset / variance - common @ np.linalg.solve(inner, common))


def _noise(left: list[Array], found: list[Found]) -> float:
    good = [own[one.good] for own, one in zip(left, found, strict=True)]
    return max(residual_scale(np.concatenate(good)), LEAST_NOISE_PX)


def _correlated(noise: float) -> float:
    """Return the variance of points that count as if they were independent."""
    return noise**2 * max(1.0, CORRELATION_PX / STEP_PX)


def _of_whole_edges(task: Task, one: Found, weight: Array) -> Array:
    """Return weights of samples (m,), none of edges of which much of what was found is left out.

    What is left of such an edge is where it crosses the prediction, and it seems to lie there.
    """
    kept = np.bincount(task.samples.edge, one.good & (weight > 0), len(task.edges))
    offered = np.bincount(task.samples.edge, one.good, len(task.edges))
    return np.asarray(weight * (kept >= LEAST_KEPT * offered)[task.samples.edge])


def moved(task: Task, design: Array, step: Array) -> Array:
    """Return how far samples (m,) move across with a step of the unknowns."""
    by_surfaces = (design[:, POSE:] * task.of_surfaces(step)).sum(axis=1)
    return np.asarray(design[:, :POSE] @ step[:POSE] + by_surfaces)


def rows_of(task: Task, design: Array, residual: Array, weight: Array) -> list[Rows]:
    """Return the rows of each edge that was found."""
    rows = []
    for k, own in enumerate(task.unknowns):
        at = task.own[k].start + np.flatnonzero(weight[task.own[k]] > 0)
        if not len(at):
            continue
        unknowns = np.concatenate([np.arange(POSE), own])
        part = design[at]
        if own[0] == own[3]:
            # both faces on one surface
            unknowns = unknowns[: POSE + 3]
            part = part[:, : POSE + 3]
        rows.append(Rows(unknowns, part, residual[at], weight[at], _bias_modes(task, k, at)))
    return rows


def _bias_modes(task: Task, edge: int, chosen: NDArray[np.int64]) -> Array:
    """Return how far the biases of an edge move its samples (m, q): as `floor_modes` of an entity do.

    All alike; and by half, the ends of a line against each other, or opposite sides of a circle together.
    """
    share = task.samples.share[chosen]
    if task.spans[edge]:
        angle = task.spans[edge] * share
        return np.stack([np.ones(len(share)), 0.5 * np.cos(angle), 0.5 * np.sin(angle)], axis=1)
    low = share.min()
    high = share.max()
    along = (2 * share - low - high) / max(high - low, 1e-12)
    return np.stack([np.ones(len(share)), 0.5 * along], axis=1)
