"""P_all: the probability that a displaced camera can measure a target, and does so accurately.

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

from planner.request.camera_limits import NO_RESERVE
from planner.request.constraints import Constraints, Requirements
from planner.request.problem import Problem
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

CONDITIONS = ("field of view", "focus", "visibility", "image")
"""What must hold beside the error, in the order in which it is asked."""

_BATCH = 1000


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
        bounds = {hits: lower_bound(hits, self.n) for hits in set(self.successes)}
        return {name: bounds[hits] for name, hits in zip(self.names, self.successes, strict=True)}

    @property
    def lower_together(self) -> float:
        """The same of all targets at once."""
        return lower_bound(self.together, self.n)


def lower_bound(successes: int, n: int) -> float:
    """Return the one-sided lower bound of a probability after so many successes in n trials."""
    return clopper_pearson(successes, n, 2.0 * CONFIDENCE - 1.0)[0]


def successes_needed(bound: float, n: int) -> int:
    """Return the fewest successes in n trials that have at least this lower bound, or n + 1; see `lower_bound`."""
    if bound <= 0.0:
        return 0
    # that of more successes is larger
    return bisect_left(range(n + 1), bound, key=lambda hits: lower_bound(hits, n))


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
        values = ValuePoses(cam2world, problem.known_at(cam2world, problem.names), [seed, n])
        draws = [np.random.default_rng([seed, n, *name.encode()]) for name in problem.names]
        k = len(problem.names)
        successes = np.zeros(k, dtype=int)
        failures = {kind: np.zeros(k, dtype=int) for kind in (*CONDITIONS, "error")}
        together = 0
        for start in range(0, n, _BATCH):
            size = min(_BATCH, n - start)
            poses = displaced_poses(cam2world, problem.pose_uncertainty, size, rng)
            valid = np.ones((size, k), dtype=bool)
            for kind, met in self.met(poses).items():
                failures[kind] += (valid & ~met).sum(axis=0)
                valid &= met
            found_from = values.of(poses)
            accurate = np.column_stack(
                [
                    accurate_in(
                        target,
                        cam2world,
                        found_from,
                        problem.camera,
                        problem.accuracy,
                        draw,
                        values.by_surfaces(name),
                    )
                    for name, target, draw in zip(problem.names, self._targets, draws, strict=True)
                ]
            )
            failures["error"] += (valid & ~accurate).sum(axis=0)
            valid &= accurate
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


def poses_needed(probability: float, at_least: int) -> int:
    """Return how many displaced poses can show a probability if all of them succeed, of `MOST_POSES` at most."""
    enough = math.log(1.0 / (1.0 - CONFIDENCE)) / -math.log(probability)
    # with room for as many failures again as the probability allows
    return int(min(max(at_least, math.ceil(4.0 * enough)), MOST_POSES))
