"""P_all: how often a displaced camera measures targets accurately, counted, and what a count shows.

A stated P holds given that the image shows what it should. P_all asks for everything at once: from the displaced pose
each point is in the picture and in focus, the entities are visible as a whole, no line is too near, the corners are
wide enough, and the error is at most the permitted one. It is counted over displaced poses, with the rules of the
request but without its reserves, which are there to keep P_all high.

How long an image must be is a rule for planning and not asked again: a line of 19.99 px is as good as one of 20 px. The
same holds for what concerns the robot: workspace, reach and stand-off.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from planner.executors import check_on_the_way
from planner.request.camera_limits import NO_RESERVE
from planner.request.constraints import Constraints, Requirements
from planner.request.problem import Problem
from planner.request.targets import Target
from planner.verify.simulate_setting import (
    ValuePoses,
    accurate_in,
    clopper_pearson,
    displaced_poses,
)

CONFIDENCE = 0.999
"""One-sided confidence of the lower bounds that are stated."""

MOST_POSES = 200_000
"""Displaced poses at most: they can show a probability of 0.99996."""

MOST_REQUIRED = 0.9999
"""What is required of P_all at most, whatever is required: more cannot be counted in reasonable time."""

JOINT_POSES = 1000
"""Displaced poses at first in which everything must hold."""

JOINT_SURE_POSES = 20_000
"""The same where fewer do not decide, and at most for what a plan states."""

# how many displaced poses a count is looked at after. Each look costs little confidence, and most need not be the last.
_LOOKS = (JOINT_POSES, 2000, 4000, 8000, JOINT_SURE_POSES)

CONDITIONS = ("field of view", "focus", "visibility", "image")
"""What must hold beside the error, in the order in which it is asked."""

_POSES_AT_ONCE = 1000


@dataclass(frozen=True)
class JointCounts:
    """How often targets of a setting were measured accurately with every condition met.

    Attributes
    ----------
    names : tuple of str
        The targets (k).
    n : int
        Displaced poses.
    successes : tuple of int
        Of these, how often all held for each target.
    together : int
        How often all held for all targets at once.
    failures : dict of str to tuple of int
        For each of `CONDITIONS`, how often it was not met for each target, where those before it were; and "error".
    """

    names: tuple[str, ...]
    n: int
    successes: tuple[int, ...]
    together: int
    failures: dict[str, tuple[int, ...]]

    @cached_property
    def lower(self) -> dict[str, float]:
        """Lower confidence bound of P_all by target (Clopper and Pearson 1934)."""
        return self.lower_of(1)

    def lower_of(self, looks: int) -> dict[str, float]:
        """Return lower bounds by target that all hold with `CONFIDENCE`, where so many counts may each decide."""
        confidence = confidence_of_looks(looks)
        bounds = {hits: lower_bound(hits, self.n, confidence) for hits in set(self.successes)}
        return {name: bounds[hits] for name, hits in zip(self.names, self.successes, strict=True)}

    @property
    def lower_together(self) -> float:
        """The same of all targets at once."""
        return lower_bound(self.together, self.n)


def lower_bound(successes: int, n: int, confidence: float = CONFIDENCE) -> float:
    """Return the one-sided lower bound of a probability after so many successes in n trials."""
    return clopper_pearson(successes, n, 2.0 * confidence - 1.0)[0]


def successes_needed(bound: float, n: int, confidence: float = CONFIDENCE) -> int:
    """Return the fewest successes in n trials that have at least this lower bound, or n + 1; see `lower_bound`."""
    if bound <= 0.0:
        return 0
    # that of more successes is larger
    return bisect_left(range(n + 1), bound, key=lambda hits: lower_bound(hits, n, confidence))


def looks_of(probability: float) -> tuple[int, ...]:
    """Return after how many displaced poses a count is looked at to decide whether a probability is reached."""
    # a high probability takes more poses than the first looks have
    return tuple(sorted({poses_needed(probability, at_least) for at_least in _LOOKS}))


def confidence_of_looks(looks: int) -> float:
    """Return the confidence of each of so many looks, any of which may decide; `CONFIDENCE` together (Bonferroni)."""
    return 1.0 - (1.0 - CONFIDENCE) / looks


def share_to_show(probability: float, look: int = -1) -> float:
    """Return which share of a look's poses must succeed to show that a probability is reached.

    Parameters
    ----------
    probability : float
        What is required; of more than `MOST_REQUIRED` no more than that is to be shown.
    look : int
        Which of `looks_of`. Default: the last one, of which the smallest share is enough.
    """
    looks = looks_of(probability)
    required = min(probability, MOST_REQUIRED)
    needed = successes_needed(required, looks[look], confidence_of_looks(len(looks)))
    return needed / looks[look]


def without_reserves(requirements: Requirements) -> Requirements:
    """Return what an image must meet, without what planned poses keep for displacements."""
    return replace(
        requirements,
        field_margin_px=0.0,
        field_of_view="exact",
        visibility_radius_mm=0.0,
        focus_margin_mm=0.0,
        focus_reserve=NO_RESERVE,
        reach=None,
    )


class DisplacedChecks:
    """All that is asked of the image of a displaced camera, for some targets of a request.

    Parameters
    ----------
    problem : Problem
        What is asked.
    names : sequence of str
        Its targets (k).
    """

    def __init__(self, problem: Problem, names: Sequence[str]):
        restricted = problem.restricted_to(names)
        self.problem = replace(restricted, requirements=without_reserves(restricted.requirements))
        self._constraints: Constraints = self.problem.constraints
        self._targets = [self.problem.measured[name] for name in self.problem.names]

    def met(self, cam2world: NDArray[np.float64]) -> dict[str, NDArray[np.bool_]]:
        """Return which conditions poses (n, 4, 4) meet for which targets (n, k); by name, in order.

        What fails before is not asked again where that takes time, and counts as met there.
        """
        constraints = self._constraints
        margins = constraints.margins(cam2world, constraints.of_image)
        conditions = {
            "field of view": margins["field_of_view_px"] >= 0.0,
            "focus": margins["focus_mm"] >= 0.0,
        }
        hopeful = np.logical_and.reduce(list(conditions.values()))
        visible = np.ones_like(hopeful)
        rows = np.flatnonzero(hopeful.any(axis=1))
        visibility = constraints.margins(cam2world[rows], ["visibility"])["visibility"]
        visible[rows] = visibility >= 0.0
        conditions["visibility"] = visible
        shown = np.ones_like(hopeful)
        if constraints.shows:
            candidates = hopeful & visible
            shown = constraints.image.shown(cam2world, candidates) | ~candidates
        conditions["image"] = shown
        return conditions

    def count(
        self, cam2world: NDArray[np.float64], n: int, seed: int, needed: int = 0
    ) -> JointCounts:
        """Count over n displaced poses how often everything holds at a planned pose (4, 4).

        Each target has draws of its own, so what is counted for it depends on no other target.

        Parameters
        ----------
        cam2world : array (4, 4)
            The pose.
        n : int
            Displaced poses.
        seed : int
            Of the draws.
        needed : int
            The count ends as soon as a target cannot succeed this often any more. What was not displaced then counts
            as a success of all targets.
        """
        problem = self.problem
        rng = np.random.default_rng([seed, n])
        measured = self._measurements(cam2world, [seed, n])
        k = len(problem.names)
        successes = np.zeros(k, dtype=int)
        failures = {kind: np.zeros(k, dtype=int) for kind in (*CONDITIONS, "error")}
        together = 0
        for start in range(0, n, _POSES_AT_ONCE):
            check_on_the_way()
            size = min(_POSES_AT_ONCE, n - start)
            poses = displaced_poses(cam2world, problem.pose_uncertainty, size, rng)
            valid = np.ones((size, k), dtype=bool)
            for kind, met in (*self.met(poses).items(), ("error", measured.accurate(poses))):
                failures[kind] += (valid & ~met).sum(axis=0)
                valid &= met
            successes += valid.sum(axis=0)
            together += int(valid.all(axis=1).sum())
            remaining = n - start - size
            if successes.min() + remaining < needed:
                successes += remaining
                together += remaining
                break
        return JointCounts(
            problem.names,
            n,
            tuple(successes.tolist()),
            together,
            {kind: tuple(count.tolist()) for kind, count in failures.items()},
        )

    def held(
        self, cam2world: NDArray[np.float64], poses: NDArray[np.float64], seed: int
    ) -> NDArray[np.bool_]:
        """Return in which displaced poses everything holds of which target; (n, k).

        Parameters
        ----------
        cam2world : array (4, 4)
            The planned pose.
        poses : array (n, 4, 4)
            Displaced ones.
        seed : int
            Of the draws of measurements.
        """
        holds = self._measurements(cam2world, [seed, len(poses)]).accurate(poses)
        for met in self.met(poses).values():
            holds &= met
        return holds

    def _measurements(self, cam2world: NDArray[np.float64], seed: list[int]) -> _Measurements:
        return _Measurements(self.problem, self._targets, cam2world, seed)


class _Measurements:
    """Measurements of the targets of a problem from displaced poses; each target has draws of its own."""

    def __init__(
        self,
        problem: Problem,
        targets: Sequence[Target],
        cam2world: NDArray[np.float64],
        seed: list[int],
    ):
        self._problem = problem
        self._targets = targets
        self._planned = cam2world
        self._values = ValuePoses(cam2world, problem.known_at(cam2world, problem.names), seed)
        self._draws = [np.random.default_rng([*seed, *name.encode()]) for name in problem.names]

    def accurate(self, poses: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return whether the error is permitted, for displaced poses (n, 4, 4) and each target; (n, k)."""
        problem = self._problem
        values = self._values
        found_from = values.of(poses)
        return np.column_stack(
            [
                accurate_in(
                    target,
                    self._planned,
                    values.for_target(name, found_from),
                    problem.camera,
                    problem.accuracy,
                    draw,
                    values.by_surfaces(name),
                )
                for name, target, draw in zip(
                    problem.names, self._targets, self._draws, strict=True
                )
            ]
        )


def poses_needed(probability: float, at_least: int) -> int:
    """Return how many displaced poses can show a probability if all of them succeed, of `MOST_POSES` at most."""
    enough = math.log(1.0 / (1.0 - CONFIDENCE)) / -math.log(probability)
    # with room for as many failures again as the probability allows
    return int(min(max(at_least, math.ceil(4.0 * enough)), MOST_POSES))
