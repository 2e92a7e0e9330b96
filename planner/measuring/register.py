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
import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from aspectgraph.entities.entity_rules import PARAMETERS
from errors.checks import chi_squared_quantile
from errors.registration import Posterior, Rows, bias_variance_of, posterior, surprise
from ground.decorators import njit
from planner.camera.pose import PoseUncertainty
from planner.measuring.images import Picture
from planner.measuring.registered import ImageEvidence, Lamp, Registered, prior_covariance
from planner.measuring.samples import (
    POSE,
    SAMPLING_PX,
    PartModel,
    State,
    gradients_of,
    median_shift,
    profiles_of,
)
from planner.measuring.task import (
    MOVE_SIGMAS,
    REPEATABILITY,
    ImageScan,
    NotRegisteredError,
    Scan,
    Task,
    check_one_pose,
    cost_of,
    noise_of,
    registration_task,
    rows_at,
    solved,
    with_breaks,
)
from planner.measuring.verdict import Attempt, judged
from planner.request.edge_state import SHARP, EdgeState
from planner.request.registration import LEAST_POSE
from planner.sensor_setting import setting_name

# The coarse shift: by how many pixels an image is off its prediction, before edges are told from
# each other.
#
# Every sample votes with the gradient along its scan. A shift of the whole image by (du, dv)
# moves an edge by its part across the edge, so the votes of all samples are added at this place
# of each scan. The shift with the most votes wins.


Array = NDArray[np.float64]

MOST_VOTE = 0.05
"""Largest gradient that a sample votes with, as a share of white per px: a few strong edges do not decide alone."""
STEP_PX = 0.5
"""Shifts are tried this far apart."""
_TOP = 0.98


def coarse_shift(
    pictures: list[Picture], centres: Array, across: Array, half_px: float
) -> tuple[Array, float]:
    """Return the shift of an image in px, and by how much it is better than another one.

    Parameters
    ----------
    pictures : list of Picture
        Images from one pose.
    centres, across : array (m, 2)
        Predicted places of samples, px, and unit vectors across their edges.
    half_px : float
        Largest shift that is tried, in each direction.

    Returns
    -------
    shift : array (2,)
        du and dv.
    lead : float
        Votes for it over the most votes for a shift that is at least 3 px away; 1 if both are as good.
    """
    n = int(np.ceil(half_px / STEP_PX))
    votes = np.zeros((2 * n + 1, 2 * n + 1))
    for picture in pictures:
        # a shift in both directions moves an edge by up to this much
        _, grey = profiles_of(picture.grey, centres, across, 1.5 * half_px)
        inside = np.asarray(np.isfinite(grey).all(axis=1))
        strength = np.abs(gradients_of(np.where(inside[:, None], grey, 0.0)))
        strength = np.minimum(strength, MOST_VOTE * picture.white) / picture.white
        strength[~inside] = 0.0
        _vote(np.ascontiguousarray(strength), np.ascontiguousarray(across), votes, STEP_PX)
    best = np.unravel_index(int(np.argmax(votes)), votes.shape)
    grid = (np.arange(2 * n + 1) - n) * STEP_PX
    far = np.hypot(*np.meshgrid(grid - grid[best[0]], grid - grid[best[1]], indexing="ij")) >= 3.0
    second = float(votes[far].max()) if far.any() else 0.0
    lead = float(votes[best]) / second if second > 0 else np.inf
    # strong edges are cut off and have a flat top: its middle
    top = (votes >= _TOP * votes[best]) & ~far
    i, j = np.nonzero(top)
    return np.array([grid[i].mean(), grid[j].mean()]), lead


@njit(error_model="numpy")
def _vote(strength: Array, across: Array, votes: Array, step: float) -> None:
    n = len(votes) // 2
    middle = strength.shape[1] // 2
    for k in range(len(strength)):
        for i in range(len(votes)):
            du = (i - n) * step * across[k, 0]
            for j in range(len(votes)):
                place = (du + (j - n) * step * across[k, 1]) / SAMPLING_PX + middle
                at = int(place + 0.5)
                if 0 <= at < strength.shape[1]:
                    votes[i, j] += strength[k, at]


WINDOWS_PX = (5.0, 4.0, 3.0, 3.0, 2.5, 2.5)
"""How far edges are searched in each round."""
NARROW_PX = (3.0, 3.0, 2.5, 2.5)
"""The same from a pose that is known, if shadows were found instead of edges."""
LEAST_CONTRADICTED = 0.005
"""Share of the samples from which on the rounds are done again without those that were found on shadows."""
MOST_REPEATS = 2
"""The rounds are done again so many times at most."""
BIAS_PX = 0.15
"""Standard deviation of where an edge is found as a whole: light and blur move it."""
BIAS_SHARE = 3.0
"""The same in the localisation's floor: lamps are chosen for the edges of targets, not for all that register."""
LEAST_BIAS_PX = 0.03
"""An edge's bias is taken to be this large at least."""
MOST_HALVINGS = 4
"""A step after which the images are explained worse is halved so many times at most."""
LITTLE_WORSE = 1.01
"""The last step, to larger biases, may cost so many times as much: they change what single points cost."""
LATE = 2
"""In so many of the last rounds edges count as a whole or not at all; if this is refused, it is tried without."""
LEAST_HOPEFUL = 0.4
"""Share of the samples from which on an image that does not convince is searched again, with a sign of each stretch.

Light from one side makes the wall of a bore brighter than the face around it here, and darker there. A sign of each
stretch finds both, and more shadows too, so the lamp must explain it.
"""
# the variance of biases is enlarged so many times at most, and while it grows by such a factor
_BIAS_ROUNDS = 12
_BIAS_STILL = 1.02
_COARSE_PX = 1.5
# an image that is farther from the common pose is compared by its own registration, px
_FAR_PX = 0.7
_SIGMAS = 3.0
_ROOM_PX = 2.0
MOST_WINDOW_PX = 60.0
"""How far an image may be off its prediction at most."""


class SearchStart(NamedTuple):
    """Where a search begins.

    Attributes
    ----------
    x : array (n,)
        Unknowns.
    lead : float
        Of the coarse shift that they are from.
    late : int
        In so many of the last rounds edges count as a whole or not at all.
    windows : tuple of float
        How far edges are searched in each round, px.
    """

    x: Array
    lead: float
    late: int = LATE
    windows: tuple[float, ...] = WINDOWS_PX


class Scanner:
    """Scans the images of a setting at unknowns.

    Parameters
    ----------
    task : Task
        What is registered.
    pictures : list of Picture
        The images.
    left_out : list of array of bool (m,)
        Samples of each image that do not count.
    """

    def __init__(
        self, task: Task, pictures: list[Picture], left_out: list[NDArray[np.bool_]]
    ) -> None:
        self._task = task
        self._pictures = pictures
        self._left_out = left_out
        self._signs: list[NDArray[np.int64]] = []

    def signed(self, x: Array, half: float, alike: NDArray[np.int64]) -> Scan:
        """Return what is found, after the sign of the steps of samples with the same number (m,) is determined."""
        places = self._task.predicted(x)
        self._signs = [signs_of(picture, *places, half, alike) for picture in self._pictures]
        return self.at(x, half)

    def at(self, x: Array, half: float) -> Scan:
        """Return what is found up to so many px from the prediction."""
        places = self._task.predicted(x)
        every = zip(self._pictures, self._signs, self._left_out, strict=True)
        double = self._task.two_steps
        scans = [_scanned(picture, places, half, sign, out, double) for picture, sign, out in every]
        return Scan(x, *places, scans)

    def no_worse(self, scan: Scan, last: Scan, half: float) -> Scan:
        """Return a scan, or one nearer to the last one if it is explained worse than that.

        What an image hardly tells lies along a curved valley, which steps can leave.
        """
        noise = noise_of(self._task, last.scans)
        largest_cost = cost_of(self._task, last.x, last.scans, noise)
        for _ in range(MOST_HALVINGS):
            if cost_of(self._task, scan.x, scan.scans, noise) <= largest_cost:
                break
            scan = self.at((last.x + scan.x) / 2, half)
        return scan


def signs_of(
    picture: Picture, centres: Array, across: Array, half: float, alike: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Return the sign of each sample's step: that of the strongest samples with the same number (m,)."""
    scans = picture.find(centres, across, half)
    good = (scans.state == State.FOUND) | (scans.state == State.AT_END)
    total = np.bincount(alike, np.where(good, scans.step, 0.0))
    return np.sign(total).astype(np.int64)[alike]


def _scanned(
    picture: Picture,
    places: tuple[Array, Array],
    half: float,
    sign: NDArray[np.int64],
    out: NDArray[np.bool_],
    two_steps: NDArray[np.bool_] | bool,
) -> ImageScan:
    scans = picture.find(*places, half, sign)
    state = np.where(two_steps & (scans.state == State.TWO_STEPS), int(State.FOUND), scans.state)
    state = np.where(out & (state == State.FOUND), int(State.SHADOW), state)
    return ImageScan(scans.offset, state == State.FOUND, state, scans.blur_px)


def bias_of(floor_px: float) -> float:
    """Return the standard deviation of edges' biases, px, that belongs to a floor of the localisation."""
    return max(BIAS_SHARE * floor_px, LEAST_BIAS_PX)


def register(
    model: PartModel,
    pictures: list[Picture],
    planned: Array,
    prior: Array,
    bias_px: float = BIAS_PX,
    edge_state: EdgeState = SHARP,
    repeatability: PoseUncertainty = REPEATABILITY,
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
    edge_state : EdgeState
        By how much edges are broken.
    repeatability : PoseUncertainty
        By how much the camera moves between images of the setting.

    Returns
    -------
    Registered
        The estimate and its joint covariance; of several images, each also has its own, see `Registered.of`.

    Raises
    ------
    NotRegisteredError
        If the images do not show the part from near the planned pose, or are from different poses.
    """
    task = registration_task(model, pictures[0].camera, planned, prior, bias_px, edge_state)
    start = _coarse(task, pictures)
    outcome = _best(task, pictures, start)
    if not outcome[0].accepted and outcome[0].share >= LEAST_HOPEFUL:
        # where little is found, half of an edge may be what is left
        other = _best(task, pictures, start._replace(late=0))
        outcome = other if other[0].accepted else outcome
    if not outcome[0].convincing and outcome[0].share >= LEAST_HOPEFUL:
        again = _by_lit_edges(outcome[0], start)
        outcome = (again, again.lamps) if again.accepted else outcome
    if outcome[0].convincing and not outcome[0].accepted:
        # a shadow next to an edge can turn the pose as far as it is found in the edge's place
        out = outcome[0].disagreeing
        alone = _attempted(task, pictures, start, task.samples.edge, out)
        outcome = (alone, alone.lamps) if alone.accepted else outcome
    attempt, lamps = outcome
    estimate, variance = _stated(attempt)
    evidence = ImageEvidence.of(
        itertools.chain.from_iterable(attempt.rows),
        variance,
        estimate.mean,
        partial(_rows_found, attempt, range(len(pictures))),
        planned=task.planned,
        pose_prior=task.prior[:POSE, :POSE],
        apart=np.zeros((POSE, POSE)),
    )
    registered = replace(judged(attempt, estimate), lamps=lamps, evidence=evidence)
    if len(pictures) > 1:
        of_images = _of_images(attempt, registered, estimate.mean, variance, repeatability)
        registered = replace(registered, of_images=of_images)
    return registered


def _of_images(
    attempt: Attempt,
    registered: Registered,
    x: Array,
    variance: float,
    repeatability: PoseUncertainty,
) -> dict[str, Registered]:
    """Return the registration of each image: the surfaces are the same ones, the camera may have moved a little.

    Each is also registered alone, so that one from quite another pose is found, as far as it shows enough of the part.
    Such images are refused. The others are moved a little from the common pose, at the unknowns x (n,).
    """
    task = attempt.task
    repeatability = with_breaks(repeatability, task.break_mm)
    compared, sources = _each_alone(attempt)
    rows = [[*source.rows[k]] for source, k in sources]
    n = len(task.prior)
    if len(compared) > 1:
        between = [MOVE_SIGMAS**2 * task.prior[:POSE, :POSE]] * (len(compared) - 1)
        first, *others = compared.values()
        moving = [first, *(_moved_too(other, n + POSE * i) for i, other in enumerate(others))]
        estimate, _ = _enlarged(block_diag(task.prior, *between), moving, variance)
        names = [attempt.pictures[k].name for k in compared]
        check_one_pose(names, estimate.mean[n:], estimate.covariance, repeatability)
    # half of the variance of what is between two of them
    around = repeatability.covariance / 2 + np.diag(LEAST_POSE**2)
    moving = [_moved_too(image_rows, n + POSE * k) for k, image_rows in enumerate(rows)]
    estimate, variance = _enlarged(block_diag(task.prior, *[around] * len(rows)), moving, variance)
    pose = slice(0, POSE)
    of_images = {}
    for k, picture in enumerate(attempt.pictures):
        move = slice(n + POSE * k, n + POSE * (k + 1))
        select = np.zeros((n, len(estimate.mean)))
        select[:, :n] = np.eye(n)
        select[pose, move] = np.eye(POSE)
        # the common pose and surfaces lie in a curved valley, so only what differs is from this one step
        own_x = x.copy()
        own_x[pose] += estimate.mean[move]
        prior = task.prior.copy()
        prior[pose, pose] += around
        evidence = ImageEvidence.of(
            rows[k],
            variance,
            own_x,
            partial(_rows_found, sources[k][0], [sources[k][1]]),
            planned=task.planned,
            pose_prior=task.prior[pose, pose],
            apart=around,
        )
        of_images[picture.name] = replace(
            registered,
            cam2world=task.places(own_x)[0],
            covariance=select @ estimate.covariance @ select.T,
            prior=prior,
            evidence=evidence,
        )
    return of_images


def _each_alone(attempt: Attempt) -> tuple[dict[int, list[Rows]], list[tuple[Attempt, int]]]:
    """Return the rows of images that are registered alone, by number, and the attempt that the rows of each are from.

    With each attempt stands the number of the image in it.
    """
    task = attempt.task
    alike = task.samples.edge
    sources = [(attempt, k) for k in range(len(attempt.pictures))]
    compared: dict[int, list[Rows]] = {}
    for k, picture in enumerate(attempt.pictures):
        alone = _attempted(task, [picture], SearchStart(attempt.scan.x, attempt.lead), alike)
        if not alone.convincing:
            # farther off than edges are searched
            alone = _attempted(task, [picture], _coarse(task, [picture]), alike)
        if not alone.convincing:
            continue
        compared[k] = alone.rows[0]
        if median_shift(alone.scan.centres, attempt.scan.centres) > _FAR_PX:
            # nearby, rows of all images are about the same unknowns
            sources[k] = alone, 0
    return compared, sources


def _rows_found(attempt: Attempt, images: Sequence[int], x: Array) -> list[Rows]:
    """Return the rows of what is found in some images of an attempt at unknowns (n,)."""
    _, across = attempt.task.predicted(x)
    rows = rows_at(attempt.task, x, across, attempt.found_at(x))
    return list(itertools.chain.from_iterable(rows[k] for k in images))


def _moved_too(rows: list[Rows], first: int) -> list[Rows]:
    """Return rows of an image whose camera also moves by unknowns of its own, from the first one on."""
    move = first + np.arange(POSE)
    return [
        row._replace(
            unknowns=np.concatenate([row.unknowns, move]),
            design=np.hstack([row.design, row.design[:, :POSE]]),
        )
        for row in rows
    ]


def _enlarged(prior: Array, rows: list[list[Rows]], variance: float) -> tuple[Posterior, float]:
    """Return an estimate with biases as large as the rows of images show, at least of a variance; and theirs."""
    every = list(itertools.chain.from_iterable(rows))
    estimate = posterior(prior, every, variance)
    for _ in range(_BIAS_ROUNDS):
        shown = bias_variance_of(every, estimate, variance)
        if shown <= _BIAS_STILL * variance:
            break
        variance = shown
        estimate = posterior(prior, every, variance)
    return estimate, variance


def _best(
    task: Task, pictures: list[Picture], start: SearchStart
) -> tuple[Attempt, dict[str, Lamp]]:
    """Return the best attempt from a start, and the lamps that fit its images."""
    alike = task.samples.edge
    attempt = _attempted(task, pictures, start, alike)
    if not attempt.convincing and attempt.share >= LEAST_HOPEFUL:
        other = _attempted(task, pictures, start, task.stretch)
        if other.explained:
            attempt = other
            alike = task.stretch
    first = attempt
    for _ in range(MOST_REPEATS):
        shadows = attempt.contradicted
        if attempt.share < LEAST_HOPEFUL or np.mean(shadows) < LEAST_CONTRADICTED:
            break
        out = [before | shadow for before, shadow in zip(attempt.left_out, shadows, strict=True)]
        start = start._replace(x=_without_pull(attempt, out))
        attempt = _attempted(task, pictures, start, alike, out)
    if np.any(attempt.left_out) and not attempt.convincing:
        # shadows farther from their edges are not found then
        start = SearchStart(
            _without_pull(attempt, attempt.left_out), start.lead, start.late, NARROW_PX
        )
        other = _attempted(task, pictures, start, alike)
        attempt = other if other.convincing else attempt
    return attempt, first.lamps if attempt.convincing else {}


def _by_lit_edges(attempt: Attempt, start: SearchStart) -> Attempt:
    """Return what is found if edges that the light does not show are left out at first.

    Of two lines a few pixels apart, the dark one takes the step of the other for its own. Both then hold back the
    surface that they share, which may have moved by as much. Without a lamp that fits, nothing is tried.
    """
    if all(light is None for light in attempt.light):
        return attempt
    dark = [
        np.zeros(len(out), dtype=np.bool_) if light is None else ~light.lit
        for light, out in zip(attempt.light, attempt.left_out, strict=True)
    ]
    alike = attempt.task.samples.edge
    lit = _attempted(attempt.task, attempt.pictures, start, alike, dark)
    near = SearchStart(lit.scan.x, start.lead, start.late, NARROW_PX)
    # all count again, so what is asked of it stays the same
    return _attempted(attempt.task, attempt.pictures, near, alike)


def _without_pull(attempt: Attempt, shadows: list[NDArray[np.bool_]]) -> Array:
    """Return unknowns of which surfaces are nominal that shadows pulled at: samples (m,) of images taken for edges."""
    x = attempt.scan.x.copy()
    edges = attempt.task.samples.edge[np.any(shadows, axis=0)]
    x[attempt.task.unknowns[np.unique(edges)]] = 0.0
    return x


def _attempted(
    task: Task,
    pictures: list[Picture],
    start: SearchStart,
    alike: NDArray[np.int64],
    left_out: list[NDArray[np.bool_]] | None = None,
) -> Attempt:
    """Return what is found from a start on; steps have one sign where samples have the same number (m,).

    Some samples (m,) of each image may be left out.
    """
    nothing = np.zeros(len(alike), dtype=np.bool_)
    out = left_out or [nothing for _ in pictures]
    first = task.predicted(np.zeros(len(task.prior)))[0]
    scanner = Scanner(task, pictures, out)
    scan = scanner.signed(start.x, start.windows[0], alike)
    rows: list[list[Rows]] = []
    for level in range(len(start.windows) - 1, -1, -1):
        x, rows = solved(
            task, scan.x, scan.across, scan.scans, going_on=level > 0, whole=level < start.late
        )
        half = start.windows[-max(level, 1)]
        if level == len(start.windows) - 1:
            scan = scanner.signed(x, half, alike)
        else:
            scan = scanner.no_worse(scanner.at(x, half), scan, half)
    last = start.windows[-1]
    return Attempt(
        task, pictures, scan, first, rows, out, start.lead, lambda x: scanner.at(x, last).scans
    )


def _window_px(task: Task, design: Array) -> float:
    """Return how far the image may be off its prediction, px."""
    pose = task.prior[:POSE, :POSE]
    variance = np.einsum("mi,ij,mj->m", design[:, :POSE], pose, design[:, :POSE])
    return min(_SIGMAS * float(np.sqrt(variance.max())) + _ROOM_PX, MOST_WINDOW_PX)


def _coarse(task: Task, pictures: list[Picture]) -> SearchStart:
    """Return the unknowns that explain the coarse shift."""
    nothing = np.zeros(len(task.prior))
    centres, across = task.predicted(nothing)
    design = task.design(nothing, across)
    half = _window_px(task, design)
    shift, lead = coarse_shift(pictures, centres, across, half)
    rows = [
        Rows(
            np.arange(POSE),
            design[samples][:, :POSE],
            across[samples] @ shift,
            np.full(
                samples.stop - samples.start, 1 / (_COARSE_PX**2 * (samples.stop - samples.start))
            ),
        )
        for samples in task.own
    ]
    x = nothing.copy()
    # surfaces are not moved by it
    x[:POSE] = posterior(task.prior[:POSE, :POSE], rows, 0.0).mean
    return SearchStart(x, lead)


def _stated(attempt: Attempt) -> tuple[Posterior, float]:
    """Return the estimate with biases of all modes, and as large as the edges show; the stated ones at least.

    Edges deviate more than light moves them if the part has an error of form, or surfaces deviate more than stated. And
    return the variance of the biases.
    """
    task = attempt.task
    estimate, variance = _enlarged(task.prior, attempt.rows, task.bias_px**2)
    # this step, too, may leave the valley
    x = estimate.mean
    noise = noise_of(task, attempt.scan.scans)
    largest_cost = LITTLE_WORSE * cost_of(task, attempt.scan.x, attempt.scan.scans, noise, variance)
    for _ in range(MOST_HALVINGS):
        if cost_of(task, x, attempt.found_at(x), noise, variance) <= largest_cost:
            break
        x = (x + attempt.scan.x) / 2
    return Posterior(x, estimate.covariance), variance


# Registration of a part whose faces deviate more than stated: it is repeated with what the image
# shows.


CREDIBLE = 0.999
"""Faces that deviate more than with this probability deviate more than stated."""
_ROUNDS = 3


def register_as_shown(
    model: PartModel,
    pictures: list[Picture],
    planned: Array,
    pose_covariance: Array,
    surfaces_mm: float,
    bias_px: float,
    edge_state: EdgeState = SHARP,
    repeatability: PoseUncertainty = REPEATABILITY,
) -> Registered:
    """Return the pose of a setting and the deviations of the part's surfaces, see `register`.

    If the image shows that faces deviate more than stated, U would promise too much. Then the registration is repeated
    with the deviation that it shows, and says so.

    Parameters
    ----------
    model, pictures, planned, bias_px, edge_state, repeatability
        As of `register`.
    pose_covariance : array (6, 6)
        Of the planned pose.
    surfaces_mm : float
        Stated standard deviation of the position of faces, mm.

    Returns
    -------
    Registered
        The estimate and its joint covariance.

    Raises
    ------
    NotRegisteredError
        If the images do not show the part from near the planned pose.
    """
    shown_mm = surfaces_mm
    for _ in range(_ROUNDS):
        prior = prior_covariance(model, pose_covariance, shown_mm, pictures[0].camera)
        registered = register(model, pictures, planned, prior, bias_px, edge_state, repeatability)
        more = times_more(model, registered, prior)
        if more <= 1:
            break
        shown_mm *= more
    registered = replace(registered, surfaces_mm=shown_mm)
    if shown_mm <= surfaces_mm:
        return registered
    note = edge_state.deviation_note("faces seem to deviate by about", shown_mm, surfaces_mm)
    return replace(registered, warnings=(note,))


def times_more(model: PartModel, found: Registered, prior: Array) -> float:
    """Return how many times more than stated the faces deviate that no target measures; 1 if it may be chance."""
    planes = [
        k
        for k, surface in enumerate(model.carriers.surfaces)
        if surface.is_plane and k not in model.free
    ]
    if not planes:
        return 1.0
    unknowns = (PARAMETERS * np.array(planes)[:, None] + np.arange(PARAMETERS)).ravel()
    at = np.ix_(POSE + unknowns, POSE + unknowns)
    total, n = surprise(found.deviations[unknowns], found.covariance[at], prior[at])
    if n == 0 or total <= chi_squared_quantile(CREDIBLE, n):
        return 1.0
    return math.sqrt(total / n)


# What an image shows that does not show its setting: another setting, turned, mirrored, without
# distortion.


BETTER_MISFIT = 0.8
"""An image is taken to be undistorted if its misfit falls to this share without the lens distortion."""
SIMILAR_USED = 0.9
"""Then, at least this share of the samples still agrees."""

_UNDISTORTED = (
    "it looks undistorted, and the plan's camera has lens distortion: "
    "use the images as the camera takes them"
)
# settings that an image is compared with
_MOST_LOOKS = 30
# a pose is looked for so many times as far away as it may be
_TIMES_AS_FAR = 4.0


def looks_like(
    model: PartModel, pictures: list[Picture], poses: list[Array], setting: int, prior: Array
) -> str:
    """Say what images show that do not show their setting; empty if that is not known.

    Parameters
    ----------
    model : PartModel
        The part.
    pictures : list of Picture
        Images of one setting.
    poses : list of array (4, 4)
        Planned poses of all settings.
    setting : int
        Which setting it should be.
    prior : array (n, n)
        What is known of pose and surfaces.

    Returns
    -------
    str
        Words after "it".
    """
    planned = poses[setting]
    return _looks_like_another(model, pictures, poses, setting, prior) or _is_far(
        model, pictures, planned, prior
    )


def _is_far(model: PartModel, pictures: list[Picture], planned: Array, prior: Array) -> str:
    """Say how far images are off their prediction that fit at a pose which is farther off than stated; else empty."""
    wider = prior.copy()
    wider[:POSE] *= _TIMES_AS_FAR
    wider[:, :POSE] *= _TIMES_AS_FAR
    try:
        far = register(model, pictures, planned, wider)
    except NotRegisteredError:
        return ""
    return (
        f"fits {far.shift_px:.0f} px off its prediction, more than the stated uncertainty of the pose allows: "
        "check the camera's pose, and whether the image is cropped"
    )


def _looks_like_another(
    model: PartModel, pictures: list[Picture], poses: list[Array], setting: int, prior: Array
) -> str:
    tried = [
        (f"looks like {setting_name(k)}", pictures, pose)
        for k, pose in enumerate(poses[:_MOST_LOOKS])
        if k != setting
    ]
    planned = poses[setting]
    tried.append(
        ("looks turned by 180 degrees", [picture.turned() for picture in pictures], planned)
    )
    tried.append(("looks mirrored", [picture.mirrored() for picture in pictures], planned))
    if pictures[0].camera.distortion is not None:
        tried.append((_UNDISTORTED.removeprefix("it "), _undistorted(pictures), planned))
    for text, shown, pose in tried:
        try:
            register(model, shown, pose, prior)
        except NotRegisteredError:
            continue
        return text
    return ""


def check_lens(
    model: PartModel,
    pictures: list[Picture],
    pose: Array,
    prior: Array,
    found: Registered,
    bias_px: float = BIAS_PX,
    edge_state: EdgeState = SHARP,
) -> None:
    """Refuse images without the lens distortion that the plan's camera has.

    Parameters
    ----------
    model : PartModel
        The part.
    pictures : list of Picture
        Images of one setting.
    pose : array (4, 4)
        Its planned pose.
    prior : array (n, n)
        What is known of pose and surfaces.
    found : Registered
        Their registration with the distortion.
    bias_px, edge_state
        As of `register`.

    Raises
    ------
    NotRegisteredError
        If the part fits much better without the distortion, and its faces deviate no more.
    """
    if pictures[0].camera.distortion is None:
        return
    try:
        other = register(model, _undistorted(pictures), pose, prior, bias_px, edge_state)
    except NotRegisteredError:
        return
    better = other.misfit_px < BETTER_MISFIT * found.misfit_px
    # faces that deviate raise the misfit, too: then they must deviate even more to make up for the lens
    is_likely = times_more(model, other, prior) <= times_more(model, found, prior)
    if better and is_likely and other.used >= SIMILAR_USED * found.used:
        raise NotRegisteredError(_UNDISTORTED)


def _undistorted(pictures: list[Picture]) -> list[Picture]:
    """Return images as those of a camera without distortion."""
    return [
        replace(picture, camera=replace(picture.camera, distortion=None)) for picture in pictures
    ]
