"""Registration to the part's own edges: the pose of a setting and the deviations of surfaces, from its images.

Notation
--------
x   unknowns: displacement of the camera (6), then three numbers of each surface
p   predicted places of samples at x, px      n   unit vectors across the edges there
A   how far n·p moves with x                  r   where the edge was found along n, from p

Each round scans the images at the predictions and takes the posterior of x from the rows r + A x = A x' + bias + noise,
with Tukey's weights. Every edge has a bias of its own in every image: light and blur move all of its points alike.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from errors.measurands import Circle
from errors.registration import Posterior, Rows, bias_variance_of, posterior, undetermined
from planner.camera.camera import Camera
from planner.measuring.fit import TUKEY, scale_of, tukey_weights
from planner.measuring.image.picture import Picture
from planner.measuring.image.samples import (
    STEP_PX,
    Samples,
    across_of,
    apart_from,
    pixels_of,
)
from planner.measuring.image.scans import State
from planner.measuring.part_model import POSE, PartModel
from planner.measuring.poses.coarse import coarse_shift
from planner.measuring.poses.registered import SAMPLE, Registered, displaced

Array = NDArray[np.float64]

WINDOWS_PX = (5.0, 4.0, 3.0, 3.0, 2.5, 2.5)
"""How far edges are searched in each round."""
BIAS_PX = 0.15
"""Standard deviation of where an edge is found as a whole: light and blur move it."""
BIAS_SHARE = 3.0
"""The same in the localisation's floor: lamps are chosen for the edges of targets, not for all that register."""
LEAST_BIAS_PX = 0.03
"""An edge's bias is taken to be this large at least."""
LEAST_NOISE_PX = 0.05
"""Standard deviation that a single point has at least."""
CORRELATION_PX = 4.0
"""Found points nearer than this in the image are not independent."""
LEAST_SHARE = 0.6
"""Share of the samples that must be found where the registered part has them.

Images from poses that were 16 to 64 standard deviations off agreed with 0.33 to 0.56 of a plate at a wrong pose.
"""
LEAST_DOUBTFUL_SHARE = 0.7
"""The same where another shift of the image fits nearly as well: symmetric parts agree with much of a wrong image."""
MUCH_DARK = 0.2
"""Share of the samples without contrast from which on a refusal says so."""
CLEAR_LEAD = 1.05
"""Votes for the best shift over those for another one, from which on it is clear."""
MOST_CHI2 = 22.5
"""Largest square of the pose's displacement in standard deviations of its prior: 1 in 1,000 poses is beyond."""
LEAST_SAMPLES = 50
"""An image with fewer samples is not registered."""

_POSE_WORDS = (
    "position across, along its x axis",
    "position across, along its y axis",
    "distance from the part",
    "turn about its x axis",
    "turn about its y axis",
    "turn about its optical axis",
)
# the variance of biases is enlarged so many times at most, and while it grows by such a factor
_BIAS_ROUNDS = 12
_BIAS_STILL = 1.02
_COARSE_PX = 1.5
_SIGMAS = 3.0
_ROOM_PX = 2.0
_MOST_WINDOW_PX = 60.0
# difference quotients by the pose, mm and rad
_STEPS = np.array([1e-3] * 3 + [1e-5] * 3)


class NotRegisteredError(Exception):
    """An image does not show the part as the plan has it; says why."""


@dataclass
class _Task:
    """What one registration needs: the part, the camera, the planned pose, samples with their rows of surfaces."""

    model: PartModel
    camera: Camera
    planned: Array
    prior: Array
    samples: Samples
    # of the surfaces of each edge (e, 6)
    unknowns: NDArray[np.int64]
    moves: Array
    bias_px: float
    # angle of each edge that is round, rad; 0 of lines
    spans: list[float]

    @cached_property
    def own(self) -> list[slice]:
        """Where the samples of each edge are: they are in the order of the edges."""
        ends = np.searchsorted(self.samples.edge, np.arange(len(self.unknowns) + 1)).tolist()
        return [slice(first, last) for first, last in itertools.pairwise(ends)]

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


@dataclass
class _Found:
    """What was found in one image: offsets (m,) across, and which samples count."""

    offset: Array
    good: NDArray[np.bool_]
    state: NDArray[np.int64]
    blur_px: Array


def bias_of(floor_px: float) -> float:
    """Return the standard deviation of edges' biases, px, that belongs to a floor of the localisation."""
    return max(BIAS_SHARE * floor_px, LEAST_BIAS_PX)


def register(
    model: PartModel,
    pictures: list[Picture],
    planned: Array,
    prior: Array,
    bias_px: float = BIAS_PX,
) -> Registered:
    """Return the pose of a setting and the deviations of the part's surfaces.

    Parameters
    ----------
    model : PartModel
        The part.
    pictures : list of Picture
        Images of the setting; several under different lamps have one pose.
    planned : array (4, 4)
        Its planned pose.
    prior : array (n, n)
        What is known of pose and surfaces, see `prior_covariance`.
    bias_px : float
        Standard deviation of where an edge is found as a whole.

    Returns
    -------
    Registered
        The estimate and its joint covariance.

    Raises
    ------
    NotRegisteredError
        If the images do not show the part from near the planned pose.
    """
    task = _task(model, pictures[0].camera, planned, prior, bias_px)
    x, lead = _coarse(task, pictures)
    first = task.predicted(np.zeros(len(prior)))[0]
    signs: list[NDArray[np.int64]] = []
    estimate = Posterior(x, prior)
    rows: list[Rows] = []
    for number, half in enumerate(WINDOWS_PX):
        centres, across = task.predicted(x)
        if number < 2:
            signs = [_signs(task, picture, centres, across, half) for picture in pictures]
        found = [
            _scanned(task, picture, (centres, across), half, sign)
            for picture, sign in zip(pictures, signs, strict=True)
        ]
        final = number == len(WINDOWS_PX) - 1
        estimate, rows = _solved(task, x, across, found, final=final)
        x = estimate.mean
    checked = _checked(task, estimate, found, (first, centres, across), lead)
    return _with_biases_shown(task, rows, checked)


def _task(model: PartModel, camera: Camera, planned: Array, prior: Array, bias_px: float) -> _Task:
    edges = model.edges.edges
    every = model.edges.samples(planned, camera, edges, 0.0)
    shown = every.chosen(every.visible)
    pixels = pixels_of(shown.points, planned, camera)
    chosen = shown.chosen(apart_from(shown, edges, shown, edges, (pixels, pixels)))
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
    spans = [e.geometry.span_rad if isinstance(e.geometry, Circle) else 0.0 for e in kept]
    return _Task(model, camera, planned, prior, samples, unknowns, moves, bias_px, spans)


def _window_px(task: _Task, design: Array) -> float:
    """Return how far the image may be off its prediction, px."""
    pose = task.prior[:POSE, :POSE]
    variance = np.einsum("mi,ij,mj->m", design[:, :POSE], pose, design[:, :POSE])
    return min(_SIGMAS * float(np.sqrt(variance.max())) + _ROOM_PX, _MOST_WINDOW_PX)


def _coarse(task: _Task, pictures: list[Picture]) -> tuple[Array, float]:
    """Return the unknowns that explain the coarse shift, and its lead over another one."""
    nothing = np.zeros(len(task.prior))
    centres, across = task.predicted(nothing)
    design = task.design(nothing, across)
    half = _window_px(task, design)
    shift, lead = coarse_shift(pictures, centres, across, half)
    rows = [
        Rows(
            np.arange(POSE),
            design[own][:, :POSE],
            across[own] @ shift,
            np.full(own.stop - own.start, 1 / (_COARSE_PX**2 * (own.stop - own.start))),
        )
        for own in task.own
    ]
    x = nothing.copy()
    # surfaces are not moved by it
    x[:POSE] = posterior(task.prior[:POSE, :POSE], rows, 0.0).mean
    return x, lead


def _signs(
    task: _Task, picture: Picture, centres: Array, across: Array, half: float
) -> NDArray[np.int64]:
    """Return the sign of each sample's step: that of the strongest samples of its edge."""
    found = picture.find(centres, across, half)
    good = (found.state == State.FOUND) | (found.state == State.AT_END)
    weight = np.where(good, found.step, 0.0)
    total = np.bincount(task.samples.edge, weight, minlength=len(task.unknowns))
    return np.sign(total).astype(np.int64)[task.samples.edge]


def _scanned(
    task: _Task,
    picture: Picture,
    places: tuple[Array, Array],
    half: float,
    sign: NDArray[np.int64],
) -> _Found:
    found = picture.find(*places, half, sign)
    return _Found(found.offset, found.state == State.FOUND, found.state, found.blur_px)


def _solved(
    task: _Task, x: Array, across: Array, found: list[_Found], *, final: bool
) -> tuple[Posterior, list[Rows]]:
    """Return the posterior from what was found in all images, and its rows.

    Weights of a first solution make the second one. Each edge has one bias: as long as outliers are not left out, this
    finds the pose more surely than biases of more modes.
    """
    design = task.design(x, across)
    now = _moved(task, design, x)
    weights = [tukey_weights(one.offset, _scale(one.offset[one.good])) for one in found]
    estimate = Posterior(x, task.prior)
    for _ in range(3 if final else 2):
        rows = []
        noise = 0.0
        left = []
        for one, weight in zip(found, weights, strict=True):
            rest = one.offset - _moved(task, design, estimate.mean - x)
            left.append(rest - _edge_means(task, rest, one.good & (weight > 0)))
        noise = max(
            _scale(np.concatenate([own[one.good] for own, one in zip(left, found, strict=True)])),
            LEAST_NOISE_PX,
        )
        if estimate.mean is not x:
            weights = [tukey_weights(own, noise) for own in left]
        variance = noise**2 * max(1.0, CORRELATION_PX / STEP_PX)
        for one, weight in zip(found, weights, strict=True):
            rows += _rows(task, design, one.offset + now, one.good * weight / variance)
        alike = [one._replace(modes=None) for one in rows]
        estimate = posterior(task.prior, alike, task.bias_px**2)
    return estimate, rows


def _with_biases_shown(task: _Task, rows: list[Rows], checked: Registered) -> Registered:
    """Return a registration with biases of all modes, and as large as the edges show; the stated ones at least.

    Edges deviate more than light moves them if the part has an error of form, or surfaces deviate more than stated.
    """
    variance = task.bias_px**2
    estimate = posterior(task.prior, rows, variance)
    for _ in range(_BIAS_ROUNDS):
        shown = bias_variance_of(rows, estimate, variance)
        if shown <= _BIAS_STILL * variance:
            break
        variance = shown
        estimate = posterior(task.prior, rows, variance)
    pose = slice(0, POSE)
    return replace(
        checked,
        cam2world=task.places(estimate.mean)[0],
        deviations=estimate.mean[POSE:],
        covariance=estimate.covariance,
        notes=_little_known(estimate.covariance[pose, pose], task.prior[pose, pose]),
    )


def _scale(residual: Array) -> float:
    """Return a robust standard deviation of residuals about their median, px."""
    return scale_of(residual - np.median(residual)) if len(residual) else 1.0


def _moved(task: _Task, design: Array, step: Array) -> Array:
    """Return how far samples (m,) move across with a step of the unknowns."""
    by_surfaces = (design[:, POSE:] * task.of_surfaces(step)).sum(axis=1)
    return np.asarray(design[:, :POSE] @ step[:POSE] + by_surfaces)


def _edge_means(task: _Task, residual: Array, good: NDArray[np.bool_]) -> Array:
    """Return for each sample the median of its edge's residuals, px, as far as an edge's bias explains it."""
    means = np.zeros(len(task.unknowns))
    most = _SIGMAS * task.bias_px
    for k, own in enumerate(task.own):
        known = residual[own][good[own]]
        if len(known) >= 4:
            means[k] = min(max(float(np.median(known)), -most), most)
    return np.asarray(means[task.samples.edge])


def _rows(task: _Task, design: Array, residual: Array, weight: Array) -> list[Rows]:
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


def _bias_modes(task: _Task, edge: int, chosen: NDArray[np.int64]) -> Array:
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


def _checked(
    task: _Task,
    estimate: Posterior,
    found: list[_Found],
    places: tuple[Array, Array, Array],
    lead: float,
) -> Registered:
    """Return the registration if the image agrees with the part, or refuse it."""
    first, centres, _ = places
    agree = np.zeros(len(centres), dtype=bool)
    rests = []
    for one in found:
        rest = one.offset - _edge_means(task, one.offset, one.good)
        close = one.good & (np.abs(rest) <= TUKEY * max(_scale(rest[one.good]), LEAST_NOISE_PX))
        agree |= close
        rests.append(np.abs(one.offset[close]))
    misfit = float(np.median(np.concatenate(rests))) if agree.any() else np.inf
    displacement = estimate.mean[:POSE]
    chi2 = float(displacement @ np.linalg.solve(task.prior[:POSE, :POSE], displacement))
    share = float(agree.mean())
    if share < (LEAST_SHARE if lead >= CLEAR_LEAD else LEAST_DOUBTFUL_SHARE):
        raise NotRegisteredError(
            f"only {100 * share:.0f} % of the part's visible edges were found where it has them"
            f"{_dark_text(found)}"
        )
    if chi2 > MOST_CHI2:
        raise NotRegisteredError(
            f"its pose is {np.sqrt(chi2):.1f} standard deviations away from the planned one"
        )
    pose, _ = task.places(estimate.mean)
    return Registered(
        pose,
        estimate.mean[POSE:],
        estimate.covariance,
        "own edges",
        shift_px=float(np.median(np.linalg.norm(centres - first, axis=1))),
        used=int(agree.sum()),
        offered=len(agree),
        misfit_px=misfit,
        blur_px=float(np.median(np.concatenate([one.blur_px[one.good] for one in found]))),
        chi2=chi2,
        prior=task.prior,
        samples=_states(task, first, centres, agree, found),
    )


def _dark_text(found: list[_Found]) -> str:
    """Say how much of the edges the light does not show, if that is much; empty otherwise."""
    dark = np.all([one.state == State.WEAK for one in found], axis=0).mean()
    return f"; {100 * dark:.0f} % lack contrast" if dark >= MUCH_DARK else ""


def _little_known(covariance: Array, prior: Array) -> tuple[str, ...]:
    """Say what of the pose the image says little about."""
    sigmas = np.sqrt(np.diag(prior))
    names = {
        _POSE_WORDS[int(np.argmax(np.abs(direction) / sigmas))]
        for direction in undetermined(covariance, prior)
    }
    return tuple(f"the image says little about the camera's {name}" for name in sorted(names))


def _states(
    task: _Task, planned: Array, centres: Array, agree: NDArray[np.bool_], found: list[_Found]
) -> NDArray[np.void]:
    """Return samples with what became of them in the image in which most were found."""
    samples = np.zeros(len(centres), dtype=SAMPLE)
    samples["edge"] = task.samples.edge
    samples["planned_u"], samples["planned_v"] = planned.T
    samples["u"], samples["v"] = centres.T
    best = max(found, key=lambda one: int(one.good.sum()))
    lost = np.where(best.good, int(State.OUTLIER), best.state)
    samples["state"] = np.where(agree, int(State.FOUND), lost)
    return samples
