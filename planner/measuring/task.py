"""What one registration needs: the samples of a part's edges at a planned pose, and how they move with the unknowns."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from errors.measurands import Circle
from errors.registration import Rows, posterior
from planner.camera.camera import Camera
from planner.measuring.fit import CORRELATION_PX, TUKEY, scale_of, tukey_weights
from planner.measuring.registered import displaced
from planner.measuring.samples import (
    POSE,
    STEP_PX,
    PartEdge,
    PartModel,
    Samples,
    across_of,
    pixels_of,
)

Array = NDArray[np.float64]

STRETCH_RAD = np.pi / 6
"""Angle of a round edge whose step has one sign.

Around a bore, its wall is brighter than the face here, and darker there.
"""
LEAST_SAMPLES = 50
"""An image with fewer samples is not registered."""
LEAST_NOISE_PX = 0.05
"""Standard deviation that a single point has at least."""

_MOST_BIASES = 3.0
# difference quotients by the pose, mm and rad
_STEPS = np.array([1e-3] * 3 + [1e-5] * 3)


class NotRegisteredError(Exception):
    """An image does not show the part as the plan has it; says why.

    Parameters
    ----------
    what : str
        What is wrong.
    perhaps : str
        What may be the reason, if no better one is found.

    Attributes
    ----------
    what : str
        What is wrong, without the reason.
    """

    def __init__(self, what: str, perhaps: str = "") -> None:
        super().__init__(f"{what}; {perhaps}" if perhaps else what)
        self.what = what


@dataclass
class Task:
    """What one registration needs.

    Attributes
    ----------
    model, camera
        The part and the camera.
    planned : array (4, 4)
        The planned pose.
    prior : array (n, n)
        What is known of pose and surfaces.
    samples : Samples
        Visible samples (m) that are apart from each other; their edges are numbered as in ``edges``.
    edges : list of PartEdge
        The edges that have samples, in the order of the samples.
    unknowns : array of int (e, 6)
        Unknowns of the surfaces of each edge.
    moves : array (m, 3, 6)
        How samples move with these.
    bias_px : float
        Standard deviation of where an edge is found as a whole.
    """

    model: PartModel
    camera: Camera
    planned: Array
    prior: Array
    samples: Samples
    edges: list[PartEdge]
    unknowns: NDArray[np.int64]
    moves: Array
    bias_px: float

    @cached_property
    def own(self) -> list[slice]:
        """Where the samples of each edge are: they are in the order of the edges."""
        ends = np.searchsorted(self.samples.edge, np.arange(len(self.edges) + 1)).tolist()
        return [slice(first, last) for first, last in itertools.pairwise(ends)]

    @cached_property
    def information(self) -> Array:
        """Inverse of the prior (n, n)."""
        return np.asarray(np.linalg.inv(self.prior))

    @cached_property
    def spans(self) -> list[float]:
        """Angle of each edge that is round, rad; 0 of lines."""
        shapes = (edge.geometry for edge in self.edges)
        return [one.span_rad if isinstance(one, Circle) else 0.0 for one in shapes]

    @cached_property
    def stretch(self) -> NDArray[np.int64]:
        """Number of the stretch (m,) that each sample is in: an edge, or `STRETCH_RAD` of a round one."""
        parts = np.maximum(np.round(np.array(self.spans) / STRETCH_RAD), 1).astype(np.int64)
        first = np.concatenate([[0], np.cumsum(parts)])
        edge = self.samples.edge
        within = (self.samples.share * parts[edge]).astype(np.int64)
        return np.asarray(first[edge] + np.minimum(within, parts[edge] - 1))

    def of_surfaces(self, x: Array) -> Array:
        """Return the unknowns of the surfaces that carry each sample (m, 6)."""
        return np.asarray(x[self.unknowns][self.samples.edge])

    def places(self, x: Array) -> tuple[Array, Array]:
        """Return pose (4, 4) and points (m, 3) at unknowns."""
        points = self.samples.points + np.einsum("mij,mj->mi", self.moves, self.of_surfaces(x))
        return displaced(self.planned, x[:POSE])[0], points

    def predicted(self, x: Array) -> tuple[Array, Array]:
        """Return predicted places and unit vectors across (m, 2)."""
        pose, points = self.places(x)
        return (
            pixels_of(points, pose, self.camera),
            across_of(points, self.samples.tangents, pose, self.camera),
        )

    def design(self, x: Array, across: Array) -> Array:
        """Return how far samples move across by the pose and by the six numbers of their surfaces; (m, 12)."""
        _, points = self.places(x)
        moved = displaced(self.planned, x[:POSE] + np.vstack([np.diag(_STEPS), -np.diag(_STEPS)]))
        images = np.array([pixels_of(points, pose, self.camera) for pose in moved])
        slopes = (images[:POSE] - images[POSE:]) / (2 * _STEPS[:, None, None])
        by_pose = np.einsum("kmi,mi->mk", slopes, across)
        turn = displaced(self.planned, x[:POSE])[0][:3, :3]
        # a point moves against the camera
        by_point = -by_pose[:, :3] @ turn.T
        by_surface = np.einsum("mi,mij->mj", by_point, self.moves)
        return np.concatenate([by_pose, by_surface], axis=1)

    def edge_means(self, residual: Array, good: NDArray[np.bool_]) -> Array:
        """Return for each sample the median of its edge's residuals, px, as far as an edge's bias explains it."""
        means = np.zeros(len(self.edges))
        most = _MOST_BIASES * self.bias_px
        for k, own in enumerate(self.own):
            known = residual[own][good[own]]
            if len(known) >= 4:
                means[k] = min(max(float(np.median(known)), -most), most)
        return np.asarray(means[self.samples.edge])


@dataclass
class Found:
    """What was found in one image: offsets (m,) across, and which samples count."""

    offset: Array
    good: NDArray[np.bool_]
    state: NDArray[np.int64]
    blur_px: Array


class Scan(NamedTuple):
    """What was found at some unknowns.

    Attributes
    ----------
    x : array (n,)
        Unknowns.
    centres, across : array (m, 2)
        Where the samples are predicted, px, and unit vectors across.
    found : list of Found
        What was found in each image.
    """

    x: Array
    centres: Array
    across: Array
    found: list[Found]


def registration_task(
    model: PartModel, camera: Camera, planned: Array, prior: Array, bias_px: float
) -> Task:
    """Return what a registration needs.

    Parameters
    ----------
    model, planned, prior, bias_px
        See `Task`.
    camera : Camera
        The camera.

    Raises
    ------
    NotRegisteredError
        If too few samples are visible.
    """
    edges = model.edges.edges
    shown = model.shown(planned, camera)
    chosen = shown.samples.chosen(shown.apart(edges, shown.samples.edge, shown.pixels))
    if len(chosen.edge) < LEAST_SAMPLES:
        raise NotRegisteredError(
            f"only {len(chosen.edge)} samples of edges are visible and apart from each other"
        )
    used = np.unique(chosen.edge)
    number = np.searchsorted(used, chosen.edge)
    kept = [edges[k] for k in used]
    moves = np.zeros((len(number), 3, 6))
    firsts = np.searchsorted(number, np.arange(len(kept) + 1))
    for edge, (first, last) in zip(kept, itertools.pairwise(firsts), strict=True):
        moves[first:last] = model.displacement(edge, chosen.points[first:last])
    samples = Samples(
        number, chosen.share, chosen.points, chosen.tangents, chosen.visible, chosen.apart
    )
    unknowns = np.array([model.unknowns_of(edge) for edge in kept])
    return Task(model, camera, planned, prior, samples, kept, unknowns, moves, bias_px)


def residual_scale(residual: Array) -> float:
    """Return a robust standard deviation of residuals about their median, px."""
    return scale_of(residual - np.median(residual)) if len(residual) else 1.0


# One round of a registration: the next unknowns from what was found, and how badly unknowns
# explain it.
#
# See `planner.measuring.register` for the notation.


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
