"""Feasible poses to begin with: the paper's restricted sampling, and a repair for requests where draws hardly ever fit.

Draws come from the covering domains (`ViewpointSampler`). Where too few of them satisfy all constraints, the least
violating ones are moved step by step towards feasibility: each round keeps the best poses and tries normal steps
around them, ever smaller. A pose that leaves the covering domains fails the visibility constraint, so it is never
among the feasible ones.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.effort.effort import NORMAL
from planner.effort.poses import Repair
from planner.request.constraints import Constraints
from planner.setting.pose_bits import PoseEncoding
from planner.setting.viewpoint_sampling import ViewpointSampler


@dataclass
class Start:
    """Feasible chromosomes, and what was tried to find them.

    Attributes
    ----------
    bits : array (n, n_bits)
        Feasible chromosomes.
    tried : array (m, 6)
        Parameters of poses that were tried and kept for an explanation: the least violating first.
    drawn, feasible_drawn : int
        Poses drawn from the covering domains, and how many of them were feasible.
    """

    bits: np.ndarray
    tried: np.ndarray
    drawn: int
    feasible_drawn: int


def draw_start(
    n: int,
    sampler: ViewpointSampler,
    encoding: PoseEncoding,
    constraints: Constraints,
    rng: np.random.Generator,
    max_draws: int = 8192,
    known: np.ndarray | None = None,
    repairing: Repair = NORMAL.search.repair,
) -> Start:
    """Return up to n feasible chromosomes: known poses (m, 4, 4) first, then draws, then the repair."""
    tried = [np.empty((0, 6)) if known is None else encoding.parameters_of(known)]
    bits, ok = snap(tried[0], encoding, constraints)
    found = [bits[ok]]
    drawn = 0
    hits = int(ok.sum())
    given = hits
    while hits < n and drawn < max_draws and not _gives_up(constraints, repairing):
        positions = sampler.sample(repairing.batch, rng)
        if not len(positions):
            break
        parameters = np.hstack([positions, encoding.draw_turns(len(positions), rng)])
        bits, ok = snap(parameters, encoding, constraints)
        drawn += len(bits)
        hits += int(ok.sum())
        found.append(bits[ok])
        tried.append(parameters)
        if len(positions) < repairing.batch:
            # viewpoints are so rare that more draws would take long
            break
    nearest = np.concatenate(tried)
    if hits < n and len(nearest) and not _gives_up(constraints, repairing):
        nearest = _least_violating(nearest, encoding, constraints, repairing)
        repaired, nearest = repair(n - hits, nearest, encoding, constraints, rng, repairing)
        found.append(repaired)
    return Start(np.concatenate(found)[:n], nearest, drawn, hits - given)


def snap(
    parameters: np.ndarray, encoding: PoseEncoding, constraints: Constraints
) -> tuple[np.ndarray, np.ndarray]:
    """Encode parameters (m, 6); return the bits and whether the pose *they* stand for is feasible."""
    bits = encoding.encode(parameters)
    return bits, constraints.feasible(encoding.decode(bits))


def repair(
    n: int,
    tried: np.ndarray,
    encoding: PoseEncoding,
    constraints: Constraints,
    rng: np.random.Generator,
    repairing: Repair,
) -> tuple[np.ndarray, np.ndarray]:
    """Move the least violating parameters towards feasibility; return up to n feasible bits, and the last pool."""
    pool = tried[: repairing.pool]
    found = []
    missed = _violation(pool, encoding, constraints)
    for step in np.geomspace(repairing.first_step, repairing.last_step, repairing.rounds):
        children = neighbours(pool, repairing.children, step, encoding, rng)
        bits, ok = snap(children, encoding, constraints)
        found.append(bits[ok])
        if sum(map(len, found)) >= n or _gives_up(constraints, repairing):
            break
        both = np.concatenate([missed, _violation(children, encoding, constraints)])
        best = np.argsort(both, kind="stable")[: repairing.pool]
        pool = np.concatenate([pool, children])[best]
        missed = both[best]
    return np.concatenate(found)[:n], pool


def _gives_up(constraints: Constraints, repairing: Repair) -> bool:
    """Return whether so many poses met all else and none was reached by the robot that no more are tried.

    Whether a pose is reached is a yes or no, which gives the repair no slope.
    """
    arm = constraints.arm
    return arm.n_reached == 0 and arm.n_asked >= repairing.most_unreached


def neighbours(
    pool: np.ndarray, n: int, step: float, encoding: PoseEncoding, rng: np.random.Generator
) -> np.ndarray:
    """Return n normal steps (n, 6) around members of the pool, of `step` times the range; roll wraps around."""
    span = encoding.high - encoding.low
    children = pool[rng.integers(len(pool), size=n)] + rng.normal(size=(n, 6)) * span * step
    children[:, 5] = (children[:, 5] + np.pi) % (2 * np.pi) - np.pi
    return np.clip(children, encoding.low, encoding.high)


def _least_violating(
    parameters: np.ndarray, encoding: PoseEncoding, constraints: Constraints, repairing: Repair
) -> np.ndarray:
    """Return those of the parameters (m, 6) whose poses violate least, sorted; at most so many as repair keeps.

    Images of ends cost little. What they miss is missed at least, so the costly rest is asked of the hopeful only.
    """
    at_least = constraints.violation(encoding.poses(parameters), images_only=True)
    best_first = np.argsort(at_least, kind="stable")
    some = best_first[: repairing.children]
    enough = np.sort(_violation(parameters[some], encoding, constraints))[: repairing.pool][-1]
    hopeful = np.flatnonzero(at_least <= enough)
    violation = _violation(parameters[hopeful], encoding, constraints)
    return parameters[hopeful[np.argsort(violation, kind="stable")[: repairing.pool]]]


def _violation(
    parameters: np.ndarray, encoding: PoseEncoding, constraints: Constraints
) -> np.ndarray:
    return constraints.violation(encoding.poses(parameters))
