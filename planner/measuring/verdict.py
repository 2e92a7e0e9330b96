"""Whether an image that was registered shows the part: how much of it agrees, and what became of every sample."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from aspectgraph.solid.solid import RayScene
from errors.measurands import Circle
from errors.registration import Posterior, Rows, undetermined
from planner.camera.camera import Camera, tangents_of
from planner.measuring.fit import TUKEY
from planner.measuring.images import Picture
from planner.measuring.registered import LEAST_KNOWN, SAMPLE, Faces, Lamp, Registered, fitted
from planner.measuring.samples import (
    POSE,
    STATE_TEXTS,
    PartEdge,
    Samples,
    State,
    across_of,
    median_shift,
    pixels_of,
    profiles_of,
)
from planner.measuring.task import (
    LEAST_NOISE_PX,
    MOST_CHI2,
    STRETCH_RAD,
    ImageScan,
    NotRegisteredError,
    Scan,
    Task,
    check_distance,
    distance_of,
    residual_scale,
)
from planner.text_table import enumerated

# Whether a lamp explains an image: that edges are found where it makes a step, and only there.
#
# Where two faces are equally bright, or both are in a shadow, their edge does not show, and that
# speaks for a pose. The lamp that fits the image predicts the step of every edge. What was found
# with quite another step is a shadow that ends beside the edge.


Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

BESIDE_PX = 3.0
"""Faces and grey values are looked at this far from an edge."""
NEAR_PX = 1.5
"""Faces are looked at this far from an edge to tell whether a shadow ends beside it."""
NEAR_GREY_PX = 2.0
"""Grey values are then taken this far from it: nearer, the edge is blurred."""
LEAST_STEP = 0.03
"""A lamp shows an edge if it makes a step of this share of white at least: half more than scans need."""
STEP_ERROR = 0.35
"""A step is as predicted if it is off by this share of it, or by `LEAST_STEP`."""
LEAST_ALIKE = 0.9
"""Share of the found samples whose step must be as the lamp makes it: 0.95 and more at right poses without shadows.

At a pose that was off along four long edges, it was 0.84.
"""
LEAST_SHOWN = 0.75
"""Share of the samples that the lamp shows which must be found, with the step that it makes.

It was 0.77 and more at right poses, and at most 0.71 at wrong ones of which the found steps were alike.
"""
SURELY_ALIKE = 0.95
"""The same as `LEAST_ALIKE` where less is found than of images otherwise: it was at most 0.91 at wrong poses."""
SURELY_SHOWN = 0.8
"""The same as `LEAST_SHOWN` then: it was at most 0.71 at wrong poses."""
MOST_DARK = 0.1
"""Share of the samples that the lamp does not show which may be found then: it was 0.28 and more at wrong poses."""
LEAST_LIT = 0.3
"""Share of all samples that the lamp must show."""
LEAST_FITTING = 0.9
"""Share of the found samples without quite another step whose step must be as a lamp makes it, if it fits."""
MOST_OTHERS = 0.4
"""Share of the found samples that may have quite another step where a lamp fits: one long shadow has many."""
CONTRARY_STEP = 0.15
"""A step is quite another one if it is off by this share of white, and by `CONTRARY_SHARE` of what the lamp makes."""
CONTRARY_SHARE = 0.6
"""See `CONTRARY_STEP`."""
MOST_CONTRARY = 0.5
"""Share of the found samples of a stretch that may have quite another step."""

_SIDES = (-1.0, 1.0)
# a line is compared with the light in so many stretches
_LINE_PARTS = 8
# sagittae of chords that a ray keeps from a rounded edge of the mesh
_CHORDS = 1.1


@dataclass(frozen=True)
class Sampled:
    """Samples (m) of edges, and the pose that an image shows them from.

    Attributes
    ----------
    scene : RayScene
        The part.
    camera : Camera
        The camera.
    pose : array (4, 4)
        Its pose.
    edges : sequence of PartEdge
        The edges.
    samples : Samples
        Their samples, with numbers of these edges.
    band_px : float
        How wide the bands of broken edges are.
    """

    scene: RayScene
    camera: Camera
    pose: Array
    edges: Sequence[PartEdge]
    samples: Samples
    band_px: float = 0.0

    def beside(self, across: Array, beside_px: float) -> tuple[Faces, Bools]:
        """Return the faces on both sides of edges (2, m), the first against the vectors across, and which are any."""
        # rays meet the nominal part, so they start from nominal edges, not from where deviations put them
        centres = pixels_of(self.samples.points, self.pose, self.camera)
        inward = self._sagitta_px()
        eye = self.pose[:3, 3].copy()
        points = np.zeros((2, len(centres), 3))
        normals = np.zeros((2, len(centres), 3))
        on_part = np.zeros((2, len(centres)), dtype=np.bool_)
        for k, side in enumerate(_SIDES):
            away = beside_px + np.where(np.sign(inward) == side, np.abs(inward), 0.0)
            seen = tangents_of(self.camera, centres + side * away[:, None] * across)
            is_imaged = np.asarray(np.isfinite(seen).all(axis=1))
            seen = np.where(is_imaged[:, None], seen, 0.0)
            ways = np.column_stack([seen, np.ones(len(seen))]) @ self.pose[:3, :3].T
            hit = self.scene.cast(eye, ways)
            on_part[k] = is_imaged & np.isfinite(hit["t_hit"])
            points[k] = eye + np.where(on_part[k], hit["t_hit"], 1.0)[:, None] * ways
            normal = hit["primitive_normals"].astype(np.float64)
            normals[k] = np.where(((normal * ways).sum(axis=1) > 0)[:, None], -normal, normal)
        middle = np.median(points[on_part], axis=0) if on_part.any() else eye + self.pose[:3, 2]
        return Faces(points, normals, eye, middle, self.scene), on_part

    def _sagitta_px(self) -> Array:
        """Return how far chords of the mesh lie inside of round edges (m,), px: positive if inside is along across."""
        points = self.samples.points
        across = across_of(points, self.samples.tangents, self.pose, self.camera)
        chords = np.array([edge.chord_mm for edge in self.edges])
        middles = np.array(
            [
                edge.geometry.centre if isinstance(edge.geometry, Circle) else edge.geometry.middle
                for edge in self.edges
            ]
        )
        number = self.samples.edge
        inward = pixels_of(middles[number], self.pose, self.camera)
        side = np.sign(((inward - pixels_of(points, self.pose, self.camera)) * across).sum(axis=1))
        depth = (points - self.pose[:3, 3]) @ self.pose[:3, 2]
        scale = float(self.camera.matrix[0, 0])
        return np.nan_to_num(_CHORDS * chords[number] * scale / np.maximum(depth, 1.0) * side)


@dataclass(frozen=True)
class Shown:
    """How the steps of found edges compare with those that the best lamp makes, for samples (m).

    Attributes
    ----------
    lamp : Lamp
        It.
    agree : array of bool (m,)
        Which samples were found.
    lit : array of bool (m,)
        Whether the lamp shows them.
    alike, contrary : array of bool (m,)
        Whether they were found with the step that the lamp makes, or with quite another one.
    """

    lamp: Lamp
    agree: Bools
    lit: Bools
    alike: Bools
    contrary: Bools

    @property
    def fits(self) -> bool:
        """Whether the lamp makes the steps of nearly all found edges but those that are quite other ones."""
        others = self.agree & ~self.contrary
        few = self.contrary[self.agree].mean() <= MOST_OTHERS
        return bool(few and self.alike[others].mean() >= LEAST_FITTING)

    @property
    def explains(self) -> bool:
        """Whether it makes those of nearly all that were found, and nearly all that it shows were found."""
        enough = self.lit.mean() >= LEAST_LIT and self.alike[self.agree].mean() >= LEAST_ALIKE
        return bool(enough and self.alike[self.lit].mean() >= LEAST_SHOWN)

    @property
    def surely(self) -> bool:
        """Whether it does so of all but few, and hardly anything was found that it does not show."""
        if not self.explains:
            return False
        dark = ~self.lit
        dark_found = self.agree[dark].mean() if dark.any() else 0.0
        alike = self.alike[self.agree].mean() >= SURELY_ALIKE
        return bool(
            alike and self.alike[self.lit].mean() >= SURELY_SHOWN and dark_found <= MOST_DARK
        )

    def contradicted(self, stretch: NDArray[np.int64]) -> Bools:
        """Return which samples are of stretches (m,) that were mostly found with quite another step; none without fit.

        What was found there is a shadow, or another edge.
        """
        if not self.fits:
            return np.zeros(len(stretch), dtype=np.bool_)
        return _mostly(self.contrary, self.agree, stretch)


def shown(
    task: Task, pose: Array, picture: Picture, where: tuple[Array, Array], agree: Bools
) -> Shown | None:
    """Return how an image compares with the light of the lamp that fits it best.

    Parameters
    ----------
    task : Task
        What is registered.
    pose : array (4, 4)
        The registered pose.
    picture : Picture
        The image.
    where : pair of array (m, 2)
        Where the edges are in the image, px, and unit vectors across.
    agree : array of bool (m,)
        Which samples were found.

    Returns
    -------
    Shown or None
        None if too little is known to tell.
    """
    sampled = Sampled(
        task.model.edges.scene, task.camera, pose, task.edges, task.samples, task.band_px
    )
    faces, on_part = sampled.beside(where[1], BESIDE_PX + task.band_px)
    grey = _grey(picture, *where, BESIDE_PX + task.band_px)
    finite = np.isfinite(grey)
    is_known = np.asarray(on_part & finite & agree)
    if is_known.sum() < LEAST_KNOWN:
        return None
    lamp = fitted(faces.chosen(is_known), grey[is_known])
    around = grey[finite & ~on_part & agree]
    lamp = replace(lamp, background=float(np.median(around)) if len(around) else 0.0)
    shaded = np.where(on_part, faces.shaded(lamp), lamp.background)
    off, size = _compared(shaded, grey, on_part)
    # a shadow that ends beside an edge is taken for it
    near_off, near_size = _compared_near(lamp, sampled, picture, where)
    alike = off <= np.maximum(LEAST_STEP, STEP_ERROR * size)
    alike |= near_off <= np.maximum(LEAST_STEP, STEP_ERROR * near_size)
    other = _quite_other(near_off, near_size)
    lit = np.abs(shaded[1] - shaded[0]) >= LEAST_STEP
    return Shown(lamp, agree, lit, agree & alike, agree & other)


def beside_shadows(
    lamp: Lamp,
    sampled: Sampled,
    picture: Picture,
    where: tuple[Array, Array],
    found: Bools,
    stretch: NDArray[np.int64],
) -> Bools:
    """Return which samples (m,) are of stretches that were mostly found with quite another step than a lamp makes.

    Parameters
    ----------
    lamp : Lamp
        The lamp that fits the image.
    sampled : Sampled
        The samples.
    picture : Picture
        The image.
    where : pair of array (m, 2)
        Where the edges are in the image, px, and unit vectors across.
    found : array of bool (m,)
        Which samples were found.
    stretch : array of int (m,)
        Number of the stretch of each sample.
    """
    other = _quite_other(*_compared_near(lamp, sampled, picture, where))
    return _mostly(found & other, found, stretch)


def stretches_of(edge: PartEdge, share: Array) -> NDArray[np.int64]:
    """Return the number of the stretch (m,) that samples at shares (m,) of an edge are in."""
    shape = edge.geometry
    parts = round(shape.span_rad / STRETCH_RAD) if isinstance(shape, Circle) else _LINE_PARTS
    return np.minimum((share * max(parts, 1)).astype(np.int64), max(parts, 1) - 1)


def _quite_other(off: Array, size: Array) -> Bools:
    """Return which steps (m,) are quite other ones, given by how much they are off and what a lamp makes."""
    return np.asarray(off > np.maximum(CONTRARY_STEP, CONTRARY_SHARE * size))


def _mostly(other: Bools, found: Bools, stretch: NDArray[np.int64]) -> Bools:
    """Return which samples (m,) are of stretches in which more of what was found is another step than may be."""
    is_mostly = np.bincount(stretch, other) > MOST_CONTRARY * np.bincount(stretch, found)
    return np.asarray(is_mostly[stretch])


def _compared_near(
    lamp: Lamp, sampled: Sampled, picture: Picture, where: tuple[Array, Array]
) -> tuple[Array, Array]:
    """Compare steps with those of a lamp as `_compared` does, as near to the edges as the blur allows."""
    near, on_part = sampled.beside(where[1], NEAR_PX + sampled.band_px)
    shaded = np.where(on_part, near.shaded(lamp), lamp.background)
    grey = _grey(picture, *where, NEAR_GREY_PX + sampled.band_px)
    return _compared(shaded, grey, on_part)


def _compared(shaded: Array, grey: Array, on_part: Bools) -> tuple[Array, Array]:
    """Return by how much steps of grey values (2, m) are not those of a lamp, and the size of these; (m,).

    Behind a silhouette may be anything, so only the face counts.
    """
    predicted = shaded[1] - shaded[0]
    both = on_part.all(axis=0)
    alone = np.where(on_part, np.abs(grey - shaded), 0.0).sum(axis=0)
    off = np.where(both, np.abs(grey[1] - grey[0] - predicted), alone)
    size = np.where(both, np.abs(predicted), np.where(on_part, shaded, 0.0).sum(axis=0))
    return off, size


def _grey(picture: Picture, edges: Array, across: Array, beside_px: float) -> Array:
    """Return the grey values on both sides of edges (2, m), as a share of white; nan off the image."""
    places, grey = profiles_of(picture.grey, edges, across, beside_px)
    at = [int(np.argmin(np.abs(places - side * beside_px))) for side in _SIDES]
    return np.asarray(grey[:, at].T / picture.white)


LEAST_AGREEING = 0.9
"""Share of what is found of an edge that must be on one line, where the pose would be improbable."""
LEAST_SHARE = 0.6
"""Share of the samples that must be found where the registered part has them.

Images from poses that were 16 to 64 standard deviations off agreed with 0.33 to 0.56 of a plate at a wrong pose.
"""
LEAST_DOUBTFUL_SHARE = 0.7
"""The same where another shift of the image fits nearly as well, and no lamp explains what is not found.

Symmetric parts agree with much of a wrong image.
"""
LEAST_LIT_SHARE = 0.3
"""The same where a lamp surely explains what is found and what is not: much of the part may lie in the dark."""
MUCH_DARK = 0.2
"""Share of the samples without contrast from which on a refusal says so."""
CLEAR_LEAD = 1.1
"""Votes for the best shift over those for another one, from which on it is clear."""

_POSE_WORDS = (
    "position across, along its x axis",
    "position across, along its y axis",
    "distance from the part",
    "turn about its x axis",
    "turn about its y axis",
    "turn about its optical axis",
)


@dataclass(frozen=True, eq=False)
class Attempt:
    """A registration that is to be judged.

    Attributes
    ----------
    task : Task
        What it is of.
    pictures : list of Picture
        The images.
    scan : Scan
        What was found at the registered unknowns.
    first : array (m, 2)
        Where the samples are planned, px.
    rows : list of list of Rows
        What the unknowns are from, of each image.
    left_out : list of array of bool (m,)
        Which samples did not count in each image, as a shadow was taken for their edge before.
    lead : float
        Of the coarse shift that it starts from, see `coarse_shift`.
    found_at : callable
        Returns what is found in each image at other unknowns.
    """

    task: Task
    pictures: list[Picture]
    scan: Scan
    first: Array
    rows: list[list[Rows]]
    left_out: list[Bools]
    lead: float
    found_at: Callable[[Array], list[ImageScan]]

    @cached_property
    def agreeing(self) -> list[Bools]:
        """Which samples (m,) each image shows where the part has them, but for their edge's bias."""
        return [self._agreeing(scan) for scan in self.scan.scans]

    @cached_property
    def share(self) -> float:
        """Share of the samples that some image shows there, of those that count; shadows show nothing."""
        counted = ~np.all(self.left_out, axis=0)
        if not counted.any():
            return 0.0
        share = float(np.any(self.agreeing, axis=0)[counted].mean())
        if share < LEAST_LIT_SHARE:
            return share
        edges = [
            agreeing & ~other
            for agreeing, other in zip(self.agreeing, self.contradicted, strict=True)
        ]
        return float(np.any(edges, axis=0)[counted].mean())

    @cached_property
    def light(self) -> list[Shown | None]:
        """How each image compares with the light of the lamp that fits it best."""
        return [
            self._light(picture, scan, agreeing)
            for picture, scan, agreeing in zip(
                self.pictures, self.scan.scans, self.agreeing, strict=True
            )
        ]

    @property
    def explained(self) -> bool:
        """Whether enough is found, and a lamp explains what is and what is not, in the image in which most is found."""
        return self.share >= LEAST_SHARE and self._shown is not None and self._shown.explains

    @cached_property
    def contradicted(self) -> list[Bools]:
        """Which samples (m,) of each image are of stretches with another step than the lamp makes."""
        nothing = np.zeros(len(self.task.stretch), dtype=np.bool_)
        return [
            nothing if light is None else light.contradicted(self.task.stretch)
            for light in self.light
        ]

    @property
    def lamps(self) -> dict[str, Lamp]:
        """The lamps of images that one fits."""
        return {
            picture.name: light.lamp
            for picture, light in zip(self.pictures, self.light, strict=True)
            if light is not None and light.fits
        }

    @property
    def convincing(self) -> bool:
        """Whether so much is found that the pose is not another one."""
        if self.share < LEAST_SHARE:
            enough = self.share >= LEAST_LIT_SHARE
            return enough and self._shown is not None and self._shown.surely
        return self.lead >= CLEAR_LEAD or self.share >= LEAST_DOUBTFUL_SHARE or self.explained

    @property
    def chi2(self) -> float:
        """Square of the pose's displacement in standard deviations of its prior."""
        return distance_of(self.scan.x[:POSE], self.task.prior[:POSE, :POSE])

    @property
    def accepted(self) -> bool:
        """Whether it is convincing, and as near to the planned pose as it should be."""
        return self.convincing and self.chi2 <= MOST_CHI2

    @property
    def disagreeing(self) -> list[Bools]:
        """Samples (m,) of each image on edges of which more than a tenth of what is found is somewhere else."""
        edges = self.task.samples.edge
        result = []
        for scan, agree in zip(self.scan.scans, self.agreeing, strict=True):
            agreeing = np.bincount(edges, agree, len(self.task.edges))
            offered = np.bincount(edges, scan.good, len(self.task.edges))
            result.append(np.asarray((agreeing < LEAST_AGREEING * offered)[edges]))
        return result

    @cached_property
    def _shown(self) -> Shown | None:
        """How the image in which most is found compares with the light."""
        return self.light[int(np.argmax([int(agreeing.sum()) for agreeing in self.agreeing]))]

    def _light(self, picture: Picture, one: ImageScan, agree: Bools) -> Shown | None:
        if self.task.model.edges.area is not None:
            # no lamp made this light, and the samples are those that it shows
            return None
        pose, _ = self.task.places(self.scan.x)
        across = self.scan.across
        edges = self.scan.centres + np.where(agree, one.offset, 0.0)[:, None] * across
        return shown(self.task, pose, picture, (edges, across), agree)

    def _agreeing(self, one: ImageScan) -> Bools:
        residual = one.offset - self.task.edge_means(one.offset, one.good)
        scale = max(residual_scale(residual[one.good]), LEAST_NOISE_PX)
        return np.asarray(one.good & (np.abs(residual) <= TUKEY * scale))


def judged(attempt: Attempt, estimate: Posterior) -> Registered:
    """Return the registration if the image agrees with the part.

    Parameters
    ----------
    attempt : Attempt
        The registration.
    estimate : Posterior
        Pose and deviations that it states.

    Returns
    -------
    Registered
        They, with how well the image agrees.

    Raises
    ------
    NotRegisteredError
        If too little agrees, or the pose is too far from the planned one.
    """
    task = attempt.task
    scans = attempt.scan.scans
    # of what is stated: biases of more modes count in it
    chi2 = distance_of(estimate.mean[:POSE], task.prior[:POSE, :POSE])
    if not attempt.convincing:
        raise NotRegisteredError(
            _found_text(attempt.share),
            _dark_text(scans),
            _counts(_states(attempt, np.any(attempt.agreeing, axis=0))["state"]),
        )
    check_distance(chi2)
    agree = np.any(attempt.agreeing, axis=0)
    rests = [
        np.abs(scan.offset[agreeing])
        for scan, agreeing in zip(scans, attempt.agreeing, strict=True)
    ]
    covariance = estimate.covariance
    pose = slice(0, POSE)
    return Registered(
        task.places(estimate.mean)[0],
        estimate.mean[POSE:],
        covariance,
        "own edges",
        shift_px=median_shift(attempt.first, attempt.scan.centres),
        used=int(agree.sum()),
        offered=len(agree),
        misfit_px=float(np.median(np.concatenate(rests))),
        blur_px=float(np.median(np.concatenate([scan.blur_px[scan.good] for scan in scans]))),
        chi2=chi2,
        notes=_little_known(covariance[pose, pose], task.prior[pose, pose]),
        prior=task.prior,
        samples=_states(attempt, agree),
    )


def _counts(states: NDArray[np.int64]) -> dict[str, int]:
    """Return the number of samples (m,) by state, in words."""
    counts = {STATE_TEXTS[state]: int(np.sum(states == state)) for state in State}
    return {text: n for text, n in counts.items() if n}


def _found_text(share: float) -> str:
    """Say how much of the edges was found."""
    percents = 100 * share
    text = f"only {percents:.0f} %" if percents >= 0.5 else "none"
    return f"{text} of the part's visible edges were found where the model has them"


def _dark_text(found: list[ImageScan]) -> str:
    """Say how much of the edges the light does not show, if that is much; empty otherwise."""
    dark = np.all([scan.state == State.WEAK for scan in found], axis=0).mean()
    if dark < MUCH_DARK:
        return ""
    return "they lack contrast" if dark > 0.995 else f"{100 * dark:.0f} % lack contrast"


def _little_known(covariance: Array, prior: Array) -> tuple[str, ...]:
    """Say in a note what of the pose the image says little about, given its covariance (6, 6) after and before."""
    sigmas = np.sqrt(np.diag(prior))
    names = {
        _POSE_WORDS[int(np.argmax(np.abs(direction) / sigmas))]
        for direction in undetermined(covariance, prior)
    }
    if not names:
        return ()
    return (
        f"the image says little about the camera's {enumerated(sorted(names))}: "
        "there, the uncertainty that is stated for the pose remains",
    )


def _states(attempt: Attempt, agree: Bools) -> NDArray[np.void]:
    """Return samples with what became of them in the image in which most were found."""
    samples = np.zeros(len(agree), dtype=SAMPLE)
    samples["edge"] = attempt.task.samples.edge
    samples["planned_u"], samples["planned_v"] = attempt.first.T
    samples["u"], samples["v"] = attempt.scan.centres.T
    best = max(attempt.scan.scans, key=lambda one: int(one.good.sum()))
    lost = np.where(best.good, int(State.OUTLIER), best.state)
    samples["state"] = np.where(agree, int(State.FOUND), lost)
    return samples
