"""Whether an image that was registered shows the part: how much of it agrees, and what became of every sample."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from errors.registration import Posterior, Rows, undetermined
from planner.measuring.fit import TUKEY
from planner.measuring.image.picture import Picture
from planner.measuring.image.scans import State
from planner.measuring.part_model import POSE
from planner.measuring.poses.gates import MOST_CHI2, check_distance, distance_of
from planner.measuring.poses.lamp import Lamp
from planner.measuring.poses.registered import SAMPLE, Registered
from planner.measuring.poses.shadows import Shown, shown
from planner.measuring.poses.task import (
    LEAST_NOISE_PX,
    Found,
    NotRegisteredError,
    Scan,
    Task,
    residual_scale,
)

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

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
    rows : list of Rows
        What the unknowns are from.
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
    rows: list[Rows]
    left_out: list[Bools]
    lead: float
    found_at: Callable[[Array], list[Found]]

    @cached_property
    def agreeing(self) -> list[Bools]:
        """Which samples (m,) each image shows where the part has them, but for their edge's bias."""
        return [self._agreeing(one) for one in self.scan.found]

    @cached_property
    def share(self) -> float:
        """Share of the samples that some image shows there, of those that count; shadows show nothing."""
        counted = ~np.all(self.left_out, axis=0)
        if not counted.any():
            return 0.0
        share = float(np.any(self.agreeing, axis=0)[counted].mean())
        if share < LEAST_LIT_SHARE:
            return share
        edges = [own & ~other for own, other in zip(self.agreeing, self.contradicted, strict=True)]
        return float(np.any(edges, axis=0)[counted].mean())

    @cached_property
    def light(self) -> list[Shown | None]:
        """How each image compares with the light of the lamp that fits it best."""
        return [
            self._light(picture, one, own)
            for picture, one, own in zip(self.pictures, self.scan.found, self.agreeing, strict=True)
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
            nothing if one is None else one.contradicted(self.task.stretch) for one in self.light
        ]

    @property
    def lamps(self) -> dict[str, Lamp]:
        """The lamps of images that one fits."""
        return {
            picture.name: one.lamp
            for picture, one in zip(self.pictures, self.light, strict=True)
            if one is not None and one.fits
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

    @cached_property
    def _shown(self) -> Shown | None:
        """How the image in which most is found compares with the light."""
        return self.light[int(np.argmax([int(own.sum()) for own in self.agreeing]))]

    def _light(self, picture: Picture, one: Found, agree: Bools) -> Shown | None:
        pose, _ = self.task.places(self.scan.x)
        across = self.scan.across
        edges = self.scan.centres + np.where(agree, one.offset, 0.0)[:, None] * across
        return shown(self.task, pose, picture, (edges, across), agree)

    def _agreeing(self, one: Found) -> Bools:
        rest = one.offset - self.task.edge_means(one.offset, one.good)
        scale = max(residual_scale(rest[one.good]), LEAST_NOISE_PX)
        return np.asarray(one.good & (np.abs(rest) <= TUKEY * scale))


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
    found = attempt.scan.found
    chi2 = attempt.chi2
    if not attempt.convincing:
        raise NotRegisteredError(
            f"only {100 * attempt.share:.0f} % of the part's visible edges were found where it has them",
            _dark_text(found),
        )
    check_distance(chi2)
    agree = np.any(attempt.agreeing, axis=0)
    rests = [np.abs(one.offset[own]) for one, own in zip(found, attempt.agreeing, strict=True)]
    shift = np.linalg.norm(attempt.scan.centres - attempt.first, axis=1)
    covariance = estimate.covariance
    pose = slice(0, POSE)
    return Registered(
        task.places(estimate.mean)[0],
        estimate.mean[POSE:],
        covariance,
        "own edges",
        shift_px=float(np.median(shift)),
        used=int(agree.sum()),
        offered=len(agree),
        misfit_px=float(np.median(np.concatenate(rests))),
        blur_px=float(np.median(np.concatenate([one.blur_px[one.good] for one in found]))),
        chi2=chi2,
        notes=_little_known(covariance[pose, pose], task.prior[pose, pose]),
        prior=task.prior,
        samples=_states(attempt, agree),
    )


def _dark_text(found: list[Found]) -> str:
    """Say how much of the edges the light does not show, if that is much; empty otherwise."""
    dark = np.all([one.state == State.WEAK for one in found], axis=0).mean()
    return f"{100 * dark:.0f} % lack contrast" if dark >= MUCH_DARK else ""


def _little_known(covariance: Array, prior: Array) -> tuple[str, ...]:
    """Say what of the pose the image says little about, given its covariance (6, 6) after and before."""
    sigmas = np.sqrt(np.diag(prior))
    names = {
        _POSE_WORDS[int(np.argmax(np.abs(direction) / sigmas))]
        for direction in undetermined(covariance, prior)
    }
    return tuple(f"the image says little about the camera's {name}" for name in sorted(names))


def _states(attempt: Attempt, agree: Bools) -> NDArray[np.void]:
    """Return samples with what became of them in the image in which most were found."""
    samples = np.zeros(len(agree), dtype=SAMPLE)
    samples["edge"] = attempt.task.samples.edge
    samples["planned_u"], samples["planned_v"] = attempt.first.T
    samples["u"], samples["v"] = attempt.scan.centres.T
    best = max(attempt.scan.found, key=lambda one: int(one.good.sum()))
    lost = np.where(best.good, int(State.OUTLIER), best.state)
    samples["state"] = np.where(agree, int(State.FOUND), lost)
    return samples
