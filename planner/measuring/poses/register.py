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

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from errors.registration import Posterior, Rows, bias_variance_of, posterior
from planner.measuring.fit import CORRELATION_PX, tukey_weights
from planner.measuring.image.picture import Picture
from planner.measuring.image.samples import STEP_PX
from planner.measuring.image.scans import State
from planner.measuring.part_model import POSE, PartModel
from planner.measuring.poses.coarse import coarse_shift
from planner.measuring.poses.lamp import Lamp
from planner.measuring.poses.registered import Registered
from planner.measuring.poses.task import (
    LEAST_NOISE_PX,
    Found,
    Task,
    registration_task,
    residual_scale,
)
from planner.measuring.poses.verdict import Attempt, Places, judged, little_known

Array = NDArray[np.float64]

WINDOWS_PX = (5.0, 4.0, 3.0, 3.0, 2.5, 2.5)
"""How far edges are searched in each round."""
LEAST_CONTRADICTED = 0.005
"""Share of the samples from which on the rounds are done again without those that were found on shadows."""
BIAS_PX = 0.15
"""Standard deviation of where an edge is found as a whole: light and blur move it."""
BIAS_SHARE = 3.0
"""The same in the localisation's floor: lamps are chosen for the edges of targets, not for all that register."""
LEAST_BIAS_PX = 0.03
"""An edge's bias is taken to be this large at least."""
LATE = 2
"""In so many of the last rounds edges count as a whole or not at all; if this is refused, it is tried without."""
LEAST_KEPT = 0.6
"""An edge counts then if this share of its found samples fits the others at least."""
LEAST_HOPEFUL = 0.4
"""Share of the samples from which on an image that does not convince is searched again, with a sign of each stretch.

Light from one side makes the wall of a bore brighter than the face around it here, and darker there. A sign of each
stretch finds both, and more shadows too, so the lamp must explain it.
"""
# the variance of biases is enlarged so many times at most, and while it grows by such a factor
_BIAS_ROUNDS = 12
_BIAS_STILL = 1.02
_COARSE_PX = 1.5
_SIGMAS = 3.0
_ROOM_PX = 2.0
_MOST_WINDOW_PX = 60.0


class Start(NamedTuple):
    """Where a search begins.

    Attributes
    ----------
    x : array (n,)
        Unknowns.
    lead : float
        Of the coarse shift that they are from.
    late : int
        In so many of the last rounds edges count as a whole or not at all.
    """

    x: Array
    lead: float
    late: int = LATE


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
    task = registration_task(model, pictures[0].camera, planned, prior, bias_px)
    start = _coarse(task, pictures)
    found = _best(task, pictures, start)
    if not found[0].accepted and found[0].share >= LEAST_HOPEFUL:
        # where little is found, half of an edge may be what is left
        other = _best(task, pictures, start._replace(late=0))
        found = other if other[0].accepted else found
    attempt, lamps = found
    return replace(_with_biases_shown(attempt, judged(attempt)), lamps=lamps)


def _best(task: Task, pictures: list[Picture], start: Start) -> tuple[Attempt, dict[str, Lamp]]:
    """Return the best attempt from a start, and the lamps that fit its images."""
    alike = task.samples.edge
    attempt = _attempted(task, pictures, start, alike)
    if not attempt.convincing and attempt.share >= LEAST_HOPEFUL:
        other = _attempted(task, pictures, start, task.stretch)
        if other.explained:
            attempt = other
            alike = task.stretch
    lamps = attempt.lamps if attempt.convincing else {}
    if attempt.convincing and np.mean(attempt.contradicted) >= LEAST_CONTRADICTED:
        # shadows that were taken for edges pulled at the estimate
        start = start._replace(x=attempt.estimate.mean)
        attempt = _attempted(task, pictures, start, alike, attempt.contradicted)
    return attempt, lamps


def _attempted(
    task: Task,
    pictures: list[Picture],
    start: Start,
    alike: NDArray[np.int64],
    left_out: list[NDArray[np.bool_]] | None = None,
) -> Attempt:
    """Return what is found from a start on; steps have one sign where samples have the same number (m,).

    Some samples (m,) of each image may be left out.
    """
    nothing = np.zeros(len(alike), dtype=np.bool_)
    out = left_out or [nothing for _ in pictures]
    first = task.predicted(np.zeros(len(task.prior)))[0]
    signs: list[NDArray[np.int64]] = []
    x = start.x
    estimate = Posterior(x, task.prior)
    rows: list[Rows] = []
    for number, half in enumerate(WINDOWS_PX):
        centres, across = task.predicted(x)
        if number < 2:
            signs = [_signs(picture, centres, across, half, alike) for picture in pictures]
        found = [
            _scanned(picture, (centres, across), half, sign, own)
            for picture, sign, own in zip(pictures, signs, out, strict=True)
        ]
        left = len(WINDOWS_PX) - 1 - number
        estimate, rows = _solved(task, x, across, found, (left > 0, left < start.late))
        x = estimate.mean
    places = Places(first, centres, across)
    return Attempt(task, pictures, estimate, rows, found, places, out, start.lead)


def _window_px(task: Task, design: Array) -> float:
    """Return how far the image may be off its prediction, px."""
    pose = task.prior[:POSE, :POSE]
    variance = np.einsum("mi,ij,mj->m", design[:, :POSE], pose, design[:, :POSE])
    return min(_SIGMAS * float(np.sqrt(variance.max())) + _ROOM_PX, _MOST_WINDOW_PX)


def _coarse(task: Task, pictures: list[Picture]) -> Start:
    """Return the unknowns that explain the coarse shift."""
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
    return Start(x, lead)


def _signs(
    picture: Picture, centres: Array, across: Array, half: float, alike: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Return the sign of each sample's step: that of the strongest samples with the same number (m,)."""
    found = picture.find(centres, across, half)
    good = (found.state == State.FOUND) | (found.state == State.AT_END)
    total = np.bincount(alike, np.where(good, found.step, 0.0))
    return np.sign(total).astype(np.int64)[alike]


def _scanned(
    picture: Picture,
    places: tuple[Array, Array],
    half: float,
    sign: NDArray[np.int64],
    out: NDArray[np.bool_],
) -> Found:
    found = picture.find(*places, half, sign)
    state = np.where(out & (found.state == State.FOUND), int(State.SHADOW), found.state)
    return Found(found.offset, state == State.FOUND, state, found.blur_px)


def _solved(
    task: Task, x: Array, across: Array, found: list[Found], when: tuple[bool, bool]
) -> tuple[Posterior, list[Rows]]:
    """Return the posterior from what was found in all images, and its rows.

    Weights of a first solution make the second one. Each edge has one bias: as long as outliers are not left out, this
    finds the pose more surely than biases of more modes. ``when`` says whether rounds follow, and whether edges count
    as a whole or not at all.
    """
    going_on, whole = when
    design = task.design(x, across)
    now = _moved(task, design, x)
    weights = [tukey_weights(one.offset, residual_scale(one.offset[one.good])) for one in found]
    estimate = Posterior(x, task.prior)
    for _ in range(2 if going_on else 3):
        rows = []
        noise = 0.0
        left = []
        for one, weight in zip(found, weights, strict=True):
            rest = one.offset - _moved(task, design, estimate.mean - x)
            left.append(rest - task.edge_means(rest, one.good & (weight > 0)))
        noise = max(
            residual_scale(
                np.concatenate([own[one.good] for own, one in zip(left, found, strict=True)])
            ),
            LEAST_NOISE_PX,
        )
        if estimate.mean is not x:
            weights = [tukey_weights(own, noise) for own in left]
        if whole and estimate.mean is not x:
            weights = [
                _of_whole_edges(task, one, weight)
                for one, weight in zip(found, weights, strict=True)
            ]
        variance = noise**2 * max(1.0, CORRELATION_PX / STEP_PX)
        for one, weight in zip(found, weights, strict=True):
            rows += _rows(task, design, one.offset + now, one.good * weight / variance)
        alike = [one._replace(modes=None) for one in rows]
        estimate = posterior(task.prior, alike, task.bias_px**2)
    return estimate, rows


def _of_whole_edges(task: Task, one: Found, weight: Array) -> Array:
    """Return weights of samples (m,), none of edges of which much of what was found is left out.

    What is left of such an edge is where it crosses the prediction, and it seems to lie there.
    """
    kept = np.bincount(task.samples.edge, one.good & (weight > 0), len(task.edges))
    offered = np.bincount(task.samples.edge, one.good, len(task.edges))
    return np.asarray(weight * (kept >= LEAST_KEPT * offered)[task.samples.edge])


def _with_biases_shown(attempt: Attempt, checked: Registered) -> Registered:
    """Return a registration with biases of all modes, and as large as the edges show; the stated ones at least.

    Edges deviate more than light moves them if the part has an error of form, or surfaces deviate more than stated.
    """
    task = attempt.task
    rows = attempt.rows
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
        notes=little_known(estimate.covariance[pose, pose], task.prior[pose, pose]),
    )


def _moved(task: Task, design: Array, step: Array) -> Array:
    """Return how far samples (m,) move across with a step of the unknowns."""
    by_surfaces = (design[:, POSE:] * task.of_surfaces(step)).sum(axis=1)
    return np.asarray(design[:, :POSE] @ step[:POSE] + by_surfaces)


def _rows(task: Task, design: Array, residual: Array, weight: Array) -> list[Rows]:
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
