"""What one registration needs: the samples of a part's edges at a planned pose, and how they move with the unknowns."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from errors.checks import chi_squared_quantile
from errors.measurands import Circle
from errors.registration import Rows, posterior
from ground.convert import shown
from planner.camera.camera import Camera
from planner.camera.pose import PoseUncertainty
from planner.exceptions import RequestError
from planner.measuring.breaks import registration_shift
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
from planner.request.edge_state import SHARP, EdgeState

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
    counts : mapping of str to int, optional
        Samples of all edges by what became of them, in words.

    Attributes
    ----------
    what : str
        What is wrong, without the reason.
    counts : mapping of str to int
        Samples of all edges by what became of them; empty if they were not looked for.
    """

    def __init__(
        self, what: str, perhaps: str = "", counts: Mapping[str, int] | None = None
    ) -> None:
        super().__init__(f"{what}; {perhaps}" if perhaps else what)
        self.what = what
        self.counts = counts or {}


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
    shift_px : array (m,) or float
        Where steps are expected across the edges of the model: broken edges are seen beside them.
    two_steps : array of bool (m,) or False
        Of which samples two steps are no fault.
    band_px : float
        How wide the bands of broken edges are.
    break_mm : float
        How large their breaks may be.
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
    shift_px: Array | float = 0.0
    two_steps: NDArray[np.bool_] | bool = False
    band_px: float = 0.0
    break_mm: float = 0.0

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
        return [shape.span_rad if isinstance(shape, Circle) else 0.0 for shape in shapes]

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
        across = across_of(points, self.samples.tangents, pose, self.camera)
        shift = np.broadcast_to(self.shift_px, len(points))
        return pixels_of(points, pose, self.camera) + shift[:, None] * across, across

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
        limit = _MOST_BIASES * self.bias_px
        for k, samples in enumerate(self.own):
            offsets = residual[samples][good[samples]]
            if len(offsets) >= 4:
                means[k] = min(max(float(np.median(offsets)), -limit), limit)
        return np.asarray(means[self.samples.edge])


@dataclass
class ImageScan:
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
    scans : list of ImageScan
        What was found in each image.
    """

    x: Array
    centres: Array
    across: Array
    scans: list[ImageScan]


def registration_task(
    model: PartModel,
    camera: Camera,
    planned: Array,
    prior: Array,
    bias_px: float,
    edge_state: EdgeState = SHARP,
) -> Task:
    """Return what a registration needs.

    Parameters
    ----------
    model, planned, prior, bias_px
        See `Task`.
    camera : Camera
        The camera.
    edge_state : EdgeState
        By how much edges are broken.

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
    used_edges = [edges[k] for k in used]
    moves = np.zeros((len(number), 3, 6))
    firsts = np.searchsorted(number, np.arange(len(used_edges) + 1))
    for edge, (first, last) in zip(used_edges, itertools.pairwise(firsts), strict=True):
        moves[first:last] = model.displacement(edge, chosen.points[first:last])
    samples = Samples(
        number, chosen.share, chosen.points, chosen.tangents, chosen.visible, chosen.apart
    )
    unknowns = np.array([model.unknowns_of(edge) for edge in used_edges])
    task = Task(model, camera, planned, prior, samples, used_edges, unknowns, moves, bias_px)
    if edge_state.is_sharp:
        return task
    across = across_of(samples.points, samples.tangents, planned, camera)
    effect = registration_shift(used_edges, samples, across, planned, camera, edge_state)
    return replace(
        task,
        bias_px=math.hypot(bias_px, effect.sigma_px),
        shift_px=effect.shift_px,
        two_steps=effect.two_steps,
        band_px=effect.band_px,
        break_mm=edge_state.high_mm,
    )


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
    task: Task, x: Array, across: Array, found: list[ImageScan], *, going_on: bool, whole: bool
) -> tuple[Array, list[list[Rows]]]:
    """Return the next unknowns, and the rows of each image that they are from.

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
    scans : list of ImageScan
        What was found there in each image.
    going_on : bool
        Whether rounds follow.
    whole : bool
        Whether edges count as a whole or not at all.
    """
    design = task.design(x, across)
    now = moved(task, design, x)
    weights = [tukey_weights(scan.offset, residual_scale(scan.offset[scan.good])) for scan in found]
    then = x
    for _ in range(2 if going_on else 3):
        offsets = [scan.offset - moved(task, design, then - x) for scan in found]
        counted = [scan.good & (weight > 0) for scan, weight in zip(found, weights, strict=True)]
        residuals = [
            offset - task.edge_means(offset, within)
            for offset, within in zip(offsets, counted, strict=True)
        ]
        noise = _noise(residuals, found)
        if then is not x:
            weights = [tukey_weights(residual, noise) for residual in residuals]
        if whole and then is not x:
            weights = [
                _of_whole_edges(task, scan, weight)
                for scan, weight in zip(found, weights, strict=True)
            ]
        variance = _correlated(noise)
        rows = [
            rows_of(task, design, scan.offset + now, scan.good * weight / variance)
            for scan, weight in zip(found, weights, strict=True)
        ]
        alike = [row._replace(modes=None) for of_image in rows for row in of_image]
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
        row._replace(residual=row.residual - row.design @ middle[row.unknowns]) for row in rows
    ]
    then = posterior(prior / nearer, from_middle, variance).mean + middle
    is_told = np.zeros(len(x), dtype=np.bool_)
    for row in rows:
        is_told[row.unknowns] = True
    return np.where(is_told, then, x)


def rows_at(task: Task, x: Array, across: Array, found: list[ImageScan]) -> list[list[Rows]]:
    """Return the rows of each image of what is found at unknowns that are nearly right.

    Parameters
    ----------
    task : Task
        What is registered.
    x : array (n,)
        The unknowns.
    across : array (m, 2)
        Unit vectors across the edges there.
    found : list of ImageScan
        What was found there in each image.
    """
    design = task.design(x, across)
    now = moved(task, design, x)
    residuals = [scan.offset - task.edge_means(scan.offset, scan.good) for scan in found]
    noise = _noise(residuals, found)
    variance = _correlated(noise)
    weights = [
        _of_whole_edges(task, scan, tukey_weights(residual, noise))
        for scan, residual in zip(found, residuals, strict=True)
    ]
    return [
        rows_of(task, design, scan.offset + now, scan.good * weight / variance)
        for scan, weight in zip(found, weights, strict=True)
    ]


def noise_of(task: Task, found: list[ImageScan]) -> float:
    """Return the standard deviation of found points about their edges, px."""
    return _noise([scan.offset - task.edge_means(scan.offset, scan.good) for scan in found], found)


def cost_of(
    task: Task, x: Array, found: list[ImageScan], noise: float, biases: float | None = None
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
    scans : list of ImageScan
        What was found there in each image.
    noise : float
        Standard deviation of found points, px.
    biases : float, optional
        Variance of the biases of each edge, of all modes, px². Default: it has one, with the variance of the task.
    """
    variance = _correlated(noise)
    farthest = (TUKEY * noise) ** 2 / variance
    each = task.bias_px**2 if biases is None else biases
    total = float(x @ task.information @ x)
    for scan in found:
        for k, samples in enumerate(task.own):
            at = samples.start + np.flatnonzero(scan.good[samples])
            if len(at):
                off = scan.offset[at]
                at = at[np.abs(off - np.median(off)) <= TUKEY * noise]
            lost = samples.stop - samples.start - len(at)
            square = 0.0
            if len(at):
                modes = np.ones((len(at), 1)) if biases is None else _bias_modes(task, k, at)
                square = _square(scan.offset[at], modes, variance, each)
            total += min(square + lost * farthest, (samples.stop - samples.start) * farthest)
    return total


def _square(offset: Array, modes: Array, variance: float, biases: float) -> float:
    """Return the square of offsets (m,) in their standard deviations, with biases along modes (m, q)."""
    common = modes.T @ offset / variance
    inner = np.eye(modes.shape[1]) / biases + modes.T @ modes / variance
    return float(offset @ offset / variance - common @ np.linalg.solve(inner, common))


def _noise(left: list[Array], found: list[ImageScan]) -> float:
    good = [residual[scan.good] for residual, scan in zip(left, found, strict=True)]
    return max(residual_scale(np.concatenate(good)), LEAST_NOISE_PX)


def _correlated(noise: float) -> float:
    """Return the variance of points that count as if they were independent."""
    return noise**2 * max(1.0, CORRELATION_PX / STEP_PX)


def _of_whole_edges(task: Task, one: ImageScan, weight: Array) -> Array:
    """Return weights of samples (m,), none of edges of which much of what was found is left out.

    What is left of such an edge is where it crosses the prediction, and it seems to lie there.
    """
    fitting = np.bincount(task.samples.edge, one.good & (weight > 0), len(task.edges))
    offered = np.bincount(task.samples.edge, one.good, len(task.edges))
    return np.asarray(weight * (fitting >= LEAST_KEPT * offered)[task.samples.edge])


def moved(task: Task, design: Array, step: Array) -> Array:
    """Return how far samples (m,) move across with a step of the unknowns."""
    by_surfaces = (design[:, POSE:] * task.of_surfaces(step)).sum(axis=1)
    return np.asarray(design[:, :POSE] @ step[:POSE] + by_surfaces)


def rows_of(task: Task, design: Array, residual: Array, weight: Array) -> list[Rows]:
    """Return the rows of each edge that was found."""
    rows = []
    for k, surfaces in enumerate(task.unknowns):
        at = task.own[k].start + np.flatnonzero(weight[task.own[k]] > 0)
        if not len(at):
            continue
        unknowns = np.concatenate([np.arange(POSE), surfaces])
        part = design[at]
        if surfaces[0] == surfaces[3]:
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


# What every pose must keep to, however it is known: it is rigid, near the planned one, and one for
# all images. Each limit is passed by 999 of 1,000 poses that are as the plan states.

CREDIBLE = 0.999
"""What is less probable than 1 minus this is not taken for chance."""
MOST_CHI2 = 22.5
"""Largest square of a pose's displacement in standard deviations of what is stated: 1 in 1,000 poses is beyond."""
MOVE_SIGMAS = 10.0
"""A camera may move between images so many standard deviations of its planned pose, where this is looked for."""

_RIGID = 1e-6
# far beyond any workspace; products of larger numbers overflow
_MOST_MM = 1e6


class TooFarError(NotRegisteredError):
    """A pose is too far from where something else says it is."""


def rigid_motion(value: ArrayLike, name: str) -> Array:
    """Return a pose (4, 4), mm.

    Parameters
    ----------
    value : array (4, 4)
        The pose.
    name : str
        What the caller calls it.

    Raises
    ------
    RequestError
        If it is no rigid motion.
    """
    try:
        pose = np.array(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        pose = np.empty(0)
    if pose.shape != (4, 4) or not np.isfinite(pose).all():
        raise RequestError.of_rule(name, "must be a matrix (4, 4) of numbers", _text(value))
    turn = pose[:3, :3]
    # beyond this, products overflow before they can be compared
    small = np.abs(turn).max() <= 2
    orthonormal = small and np.abs(turn @ turn.T - np.eye(3)).max() < _RIGID
    if not orthonormal or not np.array_equal(pose[3], [0.0, 0.0, 0.0, 1.0]):
        raise RequestError.of_rule(name, "must be a rotation and a translation", "another")
    if np.linalg.det(turn) < 0:
        raise RequestError.of_rule(name, "must be a rotation and a translation", "a mirrored one")
    if np.abs(pose[:3, 3]).max() > _MOST_MM:
        raise RequestError.of_rule(
            name, f"must be within {_MOST_MM:g} mm", _text(pose[:3, 3].tolist())
        )
    return pose


def _text(value: ArrayLike) -> str:
    return shown(value.tolist() if isinstance(value, np.ndarray) else value)


def distance_of(displacement: Array, covariance: Array) -> float:
    """Return the square of a displacement (n,) in standard deviations of its covariance (n, n)."""
    sigmas = np.sqrt(np.diag(covariance))
    # millimetres and radians are far apart
    units = displacement / sigmas
    return float(units @ np.linalg.solve(covariance / np.outer(sigmas, sigmas), units))


def displacement_between(planned: Array, pose: Array) -> Array:
    """Return by what (6,) a pose is displaced from the planned one, mm and rad, in the camera's own frame."""
    step = np.linalg.inv(planned) @ pose
    return np.concatenate([step[:3, 3], Rotation.from_matrix(step[:3, :3]).as_rotvec()])


def check_distance(chi2: float, what: str = "its pose", place: str = "the planned one") -> None:
    """Refuse a pose that is too far from another one.

    Parameters
    ----------
    chi2 : float
        Square of its displacement in standard deviations, see `distance_of`.
    what, place : str
        What is too far, and from where.

    Raises
    ------
    TooFarError
        If that is beyond the limit, or no number.
    """
    if not chi2 <= MOST_CHI2:
        raise TooFarError(f"{what} is {np.sqrt(chi2):.1f} standard deviations away from {place}")


REPEATABILITY = PoseUncertainty.isotropic(translation_mm=0.02, rotation_rad=1e-4)
"""Displacement of a camera that stands still between the images of a setting, or is brought back to its pose."""


def with_breaks(repeatability: PoseUncertainty, break_mm: float) -> PoseUncertainty:
    """Return by how much a camera seems to move between lamps, if edges are broken by up to a width, mm.

    A broken edge is bright where it faces the lamp, so the steps of all edges move towards the lamp or away from it.
    """
    seeming = np.repeat([break_mm**2, 0.0], 3)
    return PoseUncertainty(repeatability.covariance + np.diag(seeming))


def check_one_pose(
    names: Sequence[str],
    moves: Array,
    covariance: Array,
    repeatability: PoseUncertainty = REPEATABILITY,
) -> None:
    """Refuse images of one setting that are from different poses.

    Parameters
    ----------
    names : sequence of str
        The images (n).
    moves : array (6 (n - 1),)
        Displacements of the camera in all but the first, as they were found.
    covariance : array
        Joint covariance of unknowns, of which these are the last ones.
    repeatability : PoseUncertainty
        By how much the camera may move.

    Raises
    ------
    NotRegisteredError
        If a displacement is beyond the limit.
    """
    limit = chi_squared_quantile(CREDIBLE, POSE)
    first = len(covariance) - len(moves)
    for k, name in enumerate(names[1:]):
        move = slice(POSE * k, POSE * (k + 1))
        at = slice(first + move.start, first + move.stop)
        chi2 = distance_of(moves[move], covariance[at, at] + repeatability.covariance)
        if not chi2 <= limit:
            raise NotRegisteredError(
                f"{names[0]} and {name} do not fit one pose: the camera seems to have moved between them by "
                f"{np.sqrt(chi2):.1f} standard deviations of its repeatability. Hold camera and part still, or state "
                "a larger --repeatability; if nothing moved and edges are broken, state by how much (--edges)"
            )
