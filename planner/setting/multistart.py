"""Local refinement from many starts: which poses to begin with, which to follow, and where to look again.

A sum of probabilities has few local optima, but some of them hide. Between two optima with the view turned to either
side of the entities lies the straight view, and most feasible draws are straight views. So there are four kinds of
starts: the best of the genetic algorithm; the best of its first population around positions far from each other; poses
drawn in the covering domains with the view turned anyhow, feasible or not; and, once an optimum is found, the same with
its pan and tilt to the other side.

From every start a few steps are taken (`approach`). The most promising ends that are apart are refined, first inside
their convex cell of the covering domains and then onward as far as all constraints hold.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from planner.effort.effort import NORMAL
from planner.effort.poses import Search, Starts
from planner.request.constraints import Constraints
from planner.request.objective import Objective
from planner.setting.pose_bits import PoseEncoding
from planner.setting.refine import approach, refine
from planner.setting.viewpoint_sampling import ViewpointSampler

# turned views: shares of the encoded range of pan, tilt and roll
_TURN = np.array([0.5, 0.5, 1.0])
_MIRRORINGS = ((-1.0, 1.0), (1.0, -1.0), (-1.0, -1.0))
_NO_WALLS = np.empty((0, 4))


@dataclass
class Ascent:
    """Refinement of poses with an account of the best one.

    Attributes
    ----------
    sampler, encoding, objective, constraints
        The request.
    enough : float
        Fitness at which to stop.
    cam2world, fitness : array (4, 4), float
        The best feasible pose so far.
    nfev : int
        Poses evaluated so far.
    search : Search
        Which starts are followed, and how they climb.
    """

    sampler: ViewpointSampler
    encoding: PoseEncoding
    objective: Objective
    constraints: Constraints
    enough: float
    cam2world: np.ndarray
    fitness: float
    nfev: int = 0
    search: Search = NORMAL.search

    def consider(self, poses: np.ndarray) -> None:
        """Take the best of feasible poses (m, 4, 4) if it is better."""
        if len(poses):
            values = self.objective.fitness(poses)
            self.nfev += len(poses)
            self._keep(poses[values.argmax()], float(values.max()))

    def climb(self, starts: np.ndarray) -> None:
        """Refine the most promising of the starts (m, 4, 4), feasible or not, and the best pose."""
        ends = [(self.fitness, self.cam2world)]
        for pose in starts:
            walls = self.sampler.cell_of(pose[:3, 3])
            if self.fitness < self.enough and walls is not None:
                ends.append(self._approach(pose, walls))
        for pose in self._promising(ends):
            self._follow(pose)

    def mirror(self) -> None:
        """Try the best pose with the view turned to the other side, as long as that gains."""
        found = -np.inf
        while found < self.fitness < self.enough:
            found = self.fitness
            for signs in _MIRRORINGS:
                parameters = self.encoding.parameters_of(self.cam2world[None])
                parameters[:, 3:5] *= signs
                merit, pose = self._approach(
                    self.encoding.poses(parameters)[0], _NO_WALLS, self.search.starts.steps_mirrored
                )
                if merit > self.search.starts.promising * self.fitness and self._is_apart(
                    pose, [self.cam2world]
                ):
                    self._follow(pose)

    def _approach(
        self, pose: np.ndarray, walls: np.ndarray, steps: int | None = None
    ) -> tuple[float, np.ndarray]:
        if steps is None:
            steps = self.search.starts.steps
        pose, merit, nfev = approach(
            pose, walls, self.objective, self.constraints, steps, self.search.climbing
        )
        self.nfev += nfev
        return merit, pose

    def _promising(self, ends: list[Any]) -> list[np.ndarray]:
        """Return the best few poses of (merit, pose), nearly equally good and apart."""
        starts = self.search.starts
        chosen: list[np.ndarray] = []
        ranked = sorted(ends, key=lambda end: -end[0])
        for merit, pose in ranked:
            if merit < starts.promising * ranked[0][0] or len(chosen) == starts.followed:
                break
            if self._is_apart(pose, chosen):
                chosen.append(pose)
        return chosen

    def _is_apart(self, pose: np.ndarray, others: list[Any]) -> bool:
        """Whether position or direction of view, or both, differ by a tenth from those of all other poses."""
        apart = self.search.starts.apart
        far = apart * np.linalg.norm(pose[:3, 3] - self.constraints.sphere_centre)
        return all(
            np.linalg.norm(pose[:3, 3] - other[:3, 3]) > far
            or np.linalg.norm(pose[:3, 2] - other[:3, 2]) > apart
            for other in others
        )

    def _follow(self, pose: np.ndarray) -> None:
        """Refine a pose in its cell, and then again and again without walls while it gains."""
        starts = self.search.starts
        fitness = -np.inf
        walls = self.sampler.cell_of(pose[:3, 3])
        for _ in range(starts.onward_rounds):
            if self.fitness >= self.enough:
                return
            last = fitness
            pose, fitness, nfev = refine(
                pose,
                _NO_WALLS if walls is None else walls,
                self.objective,
                self.constraints,
                climbing=self.search.climbing,
            )
            self.nfev += nfev
            self._keep(pose, fitness)
            if walls is None and fitness <= last * (1.0 + starts.onward_gain):
                return
            walls = None

    def _keep(self, pose: np.ndarray, fitness: float) -> None:
        if fitness > self.fitness:
            self.cam2world = pose
            self.fitness = fitness


def best_apart(
    bits: np.ndarray,
    fitness: np.ndarray,
    encoding: PoseEncoding,
    n: int,
    starts: Starts = NORMAL.search.starts,
) -> np.ndarray:
    """Return up to n chromosomes, best first, that are apart from each other.

    Apart means by a tenth of some parameter's range: neighbours would be refined to the same optimum.
    """
    bits = bits[np.argsort(-fitness, kind="stable")]
    places = encoding.parameters(bits) / np.where(
        encoding.high > encoding.low, encoding.high - encoding.low, 1.0
    )
    chosen: list[int] = []
    for i in range(len(bits)):
        if len(chosen) < n and np.all(
            np.abs(places[chosen] - places[i]).max(axis=1, initial=0.0) > starts.apart
        ):
            chosen.append(i)
    return bits[chosen]


def best_around(poses: np.ndarray, fitness: np.ndarray, n: int) -> np.ndarray:
    """Return up to n of the poses (m, 4, 4): the best of each group around positions as far apart as can be."""
    centres, group = spread(poses[:, :3, 3], n, int(fitness.argmax()))
    members = [np.flatnonzero(group == g) for g in range(len(centres))]
    return poses[[own[fitness[own].argmax()] for own in members]]


def spread(positions: np.ndarray, n: int, first: int = 0) -> tuple[list[int], np.ndarray]:
    """Choose up to n of positions (m, 3), each the farthest from those before; return them and the nearest of each."""
    centres = [first][:n]
    distance = np.linalg.norm(positions - positions[centres].sum(axis=0), axis=1)
    group = np.zeros(len(positions), dtype=int)
    while len(centres) < n and distance.max() > 0:
        centres.append(int(distance.argmax()))
        to_new = np.linalg.norm(positions - positions[centres[-1]], axis=1)
        group[to_new < distance] = len(centres) - 1
        distance = np.minimum(distance, to_new)
    return centres, group


def turned_views(
    n: int,
    sampler: ViewpointSampler,
    encoding: PoseEncoding,
    rng: np.random.Generator,
    starts: Starts = NORMAL.search.starts,
) -> np.ndarray:
    """Draw up to n poses (m, 4, 4), feasible or not, in the covering domains.

    Positions are far apart; pan and tilt are at most half of what they may be, roll is anything.
    """
    positions = sampler.sample(starts.pool * n, rng)
    if n == 0 or not len(positions):
        return np.empty((0, 4, 4))
    positions = positions[spread(positions, n)[0]]
    turns = rng.uniform(encoding.low[3:], encoding.high[3:], (len(positions), 3)) * _TURN
    return encoding.poses(np.hstack([positions, turns]))
