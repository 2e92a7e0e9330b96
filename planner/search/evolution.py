"""The evolution strategy with covariance matrix adaptation (CMA-ES), for few real numbers and a function with cliffs.

Reference: N. Hansen, "The CMA evolution strategy: a tutorial", arXiv:1604.00772, 2016. Names are those of the tutorial,
but that the root of the covariance is its lower triangular factor.

Sums are taken one after the other and no library for matrices is used: its last digits depend on processor and version,
and so would every pose that is planned.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from planner.camera.pose import moved, world_to_cam
from planner.effort import Effort
from planner.request.camera_limits import FULL, probability_share, rooms, shares
from planner.request.problem import Problem

# poses of a generation
_POPULATION = 24
# a search ends after this many generations without a gain
_PATIENCE = 15
# τ of the soft minimum of the shares
_SOFTNESS = 0.04
# number of the best poses of a generation whose lines must show from displaced poses, too
_STEADY_TRIED = 3
# how far these are displaced, in standard deviations
_SIGMAS = 3.0
# weight of the share of the part's outline that is outside the picture
_OUTLINE = 0.3
# first standard deviations of the moves, of one search after the other: turns in rad, shifts as
# shares of the distance. A search of few generations leaves out the finest.
_STEPS = (0.02, 0.005, 0.001)
_FEW_GENERATIONS = 15


Array = NDArray[np.float64]


class EvolutionStrategy:
    """Draws points around a mean, and adapts mean, step and covariance to how good they are.

    Parameters
    ----------
    start : array (d,)
        First mean.
    step : float
        First standard deviation of every coordinate.
    population : int
        Points of a generation.
    rng : numpy.random.Generator
        Source of chance.
    """

    def __init__(self, start: Array, step: float, population: int, rng: np.random.Generator):
        n = len(start)
        self._rng = rng
        self._population = population
        self._mean = np.array(start, dtype=np.float64)
        self._step = step
        parents = population // 2
        weights = [math.log(parents + 0.5) - math.log(i + 1) for i in range(parents)]
        self._weights = np.array(weights) / math.fsum(weights)
        mu = 1.0 / math.fsum(float(weight) ** 2 for weight in self._weights)
        # learning rates and damping of table 1
        self._c_sigma = (mu + 2) / (n + mu + 5)
        self._damping = 1 + 2 * max(0.0, math.sqrt((mu - 1) / (n + 1)) - 1) + self._c_sigma
        self._c_c = (4 + mu / n) / (n + 4 + 2 * mu / n)
        self._c_1 = 2 / ((n + 1.3) ** 2 + mu)
        self._c_mu = min(1 - self._c_1, 2 * (mu - 2 + 1 / mu) / ((n + 2) ** 2 + mu))
        self._mu = mu
        self._length = math.sqrt(n) * (1 - 1 / (4 * n) + 1 / (21 * n**2))
        self._path_sigma = np.zeros(n)
        self._path_c = np.zeros(n)
        self._cov = np.eye(n)
        self._generation = 0

    def ask(self) -> Array:
        """Return the points (population, d) of the next generation."""
        self._root = triangular_factor(self._cov)
        draws = self._rng.standard_normal((self._population, len(self._mean)))
        return self._mean + self._step * _times(draws, self._root)

    def tell(self, points: Array, values: Array) -> None:
        """Adapt to the values (population,) of these points, the largest is best."""
        self._generation += 1
        order = np.argsort(-values, kind="stable")[: len(self._weights)]
        moves = (points[order] - self._mean) / self._step
        move = np.zeros_like(self._mean)
        spread = np.zeros_like(self._cov)
        for weight, chosen_move in zip(self._weights.tolist(), moves, strict=True):
            move = move + weight * chosen_move
            spread = spread + weight * (chosen_move[:, None] * chosen_move)
        self._mean = self._mean + self._step * move
        c_sigma = self._c_sigma
        along = math.sqrt(c_sigma * (2 - c_sigma) * self._mu)
        self._path_sigma = (1 - c_sigma) * self._path_sigma + along * _solved(self._root, move)
        norm = _length(self._path_sigma)
        faded = 1 - (1 - c_sigma) ** (2 * self._generation)
        n = len(self._mean)
        goes_on = norm / math.sqrt(faded) < (1.4 + 2 / (n + 1)) * self._length
        self._path_c = (1 - self._c_c) * self._path_c
        if goes_on:
            self._path_c = self._path_c + math.sqrt(self._c_c * (2 - self._c_c) * self._mu) * move
        stalled = 0.0 if goes_on else self._c_c * (2 - self._c_c)
        self._cov = (
            (1 - self._c_1 - self._c_mu + self._c_1 * stalled) * self._cov
            + self._c_1 * (self._path_c[:, None] * self._path_c)
            + self._c_mu * spread
        )
        self._step *= math.exp(min(1.0, (c_sigma / self._damping) * (norm / self._length - 1)))


def triangular_factor(covariance: Array) -> Array:
    """Return the lower triangular factor (d, d) of a covariance, with zeros where there is no spread."""
    n = len(covariance)
    factor = np.zeros((n, n))
    for j in range(n):
        remainder = float(covariance[j, j])
        for k in range(j):
            remainder -= float(factor[j, k]) ** 2
        factor[j, j] = math.sqrt(max(remainder, 0.0))
        for i in range(j + 1, n if factor[j, j] > 0.0 else 0):
            value = float(covariance[i, j])
            for k in range(j):
                value -= float(factor[i, k] * factor[j, k])
            factor[i, j] = value / factor[j, j]
    return factor


def _times(rows: Array, root: Array) -> Array:
    """Return rows (n, d) times the transpose of a factor (d, d)."""
    product = np.zeros_like(rows)
    for k in range(rows.shape[1]):
        product = product + rows[:, k, None] * root[:, k]
    return product


def _solved(root: Array, vector: Array) -> Array:
    """Return the vector (d,) that a lower triangular factor maps to a given one; 0 where it has no spread."""
    solution = np.zeros_like(vector)
    for i in range(len(vector)):
        value = float(vector[i])
        for k in range(i):
            value -= float(root[i, k] * solution[k])
        solution[i] = value / root[i, i] if root[i, i] > 0.0 else 0.0
    return solution


def _length(vector: Array) -> float:
    return math.sqrt(math.fsum(float(value) ** 2 for value in vector))


class Schedule(NamedTuple):
    """How long is searched.

    Attributes
    ----------
    population, generations : int
        Points of a generation; generations at most.
    patience : int
        The search ends after so many generations without a gain.
    gain : float
        What counts as a gain.
    tried : int
        So many points of a generation are confirmed, if they are better than the best so far.
    """

    population: int
    generations: int
    patience: int
    gain: float = 1e-3
    tried: int = 3


def evolve(
    value: Callable[[Array], Array],
    start: Array,
    step: float,
    rng: np.random.Generator,
    schedule: Schedule,
    confirm: Callable[[Array], NDArray[np.bool_]] | None = None,
) -> tuple[Array, float]:
    """Maximise a function of a few real numbers.

    Parameters
    ----------
    value : callable
        Values (n,) of points (n, d).
    start : array (d,)
        Where to begin.
    step : float
        First standard deviation.
    rng : numpy.random.Generator
        Source of chance.
    schedule : Schedule
        How long is searched.
    confirm : callable, optional
        Tells which points (n, d) are really as good as their values say; asked of few. Those that are not get the least
        value of their generation.

    Returns
    -------
    point : array (d,)
        The best one seen, ``start`` if none is better.
    value : float
        Its value.
    """
    strategy = EvolutionStrategy(start, step, schedule.population, rng)
    best = np.array(start, dtype=np.float64)
    best_value = float(value(best[None])[0])
    reference = best_value
    waited = 0
    for _ in range(schedule.generations):
        points = strategy.ask()
        values = value(points)
        better = np.argsort(-values, kind="stable")[: schedule.tried]
        better = better[values[better] > best_value]
        if better.size and confirm is not None:
            confirmed = confirm(points[better])
            values[better[~confirmed]] = values.min()
            better = better[confirmed]
        if better.size:
            best_value = float(values[better[0]])
            best = points[better[0]]
        strategy.tell(points, values)
        waited += 1
        if best_value > reference + schedule.gain:
            reference = best_value
            waited = 0
        if waited >= schedule.patience:
            break
    return best, best_value


# The margin step: a pose that inspects the same targets and stands as far from every limit as it
# can.
#
# a search ends where the probability is highest, often on a limit, and a limit may be missed when
# the camera is a little elsewhere. So the planned pose moves to where the least *share* of room
# is largest (`planner.request.camera_limits`), as long as no probability falls by more than is given up.
# The least share has kinks; its soft minimum
#
# -τ log Σ exp(-share / τ)
#
# is climbed instead. Corners and separations even jump, when a line comes into view; a pose
# counts only if lines show from poses three standard deviations away, too.


@dataclass(frozen=True)
class LeastShare:
    """The condition of a pose that leaves the least of its room.

    Attributes
    ----------
    condition : str
        Name of its margin, or "probability".
    share : float
        What is left of its room, see `planner.request.camera_limits`.
    """

    condition: str
    share: float


class Centring(NamedTuple):
    """How long the margin step searches, and what it may give up.

    Attributes
    ----------
    give_up : float
        No probability falls by more than this. At 0 there is no margin step.
    generations : int
        Generations of a search at most.
    steps : tuple of float
        First standard deviation of the moves, of one search after the other: turns in rad, shifts
        as shares of the distance.
    """

    give_up: float
    generations: int
    steps: tuple[float, ...]

    @classmethod
    def of(cls, effort: Effort) -> Centring:
        """Return the margin step of a request."""
        few = effort.margin_generations <= _FEW_GENERATIONS
        return cls(effort.give_up, effort.margin_generations, _STEPS[:2] if few else _STEPS)

    def shorter(self) -> Centring:
        """Return what is done where a time limit has ended the search: about a fifth of it."""
        return Centring(self.give_up, max(1, self.generations // 4), self.steps[:2])


def centred(problem: Problem, cam2world: Array, centring: Centring, seed: int) -> Array:
    """Move a pose away from its limits.

    Parameters
    ----------
    problem : Problem
        What is asked of the targets that the pose inspects, and of no others.
    cam2world : array (4, 4)
        The planned pose.
    centring : Centring
        How long to search, and what may be given up. No probability falls below the required one.
    seed : int
        Seed of the search: the same arguments give the same pose.

    Returns
    -------
    array (4, 4)
        The pose; the planned one if none with a larger least share was found.
    """
    step = _MarginStep(problem, np.array(cam2world, dtype=np.float64), centring.give_up)
    before = step.least_share(step.start[None])
    if before is None or centring.give_up <= 0.0:
        return step.start
    move = np.zeros(6)
    rng = np.random.default_rng([seed, centring.generations])
    # in a corner of several limits only short moves are feasible
    schedule = Schedule(_POPULATION, centring.generations, _PATIENCE, tried=_STEADY_TRIED)
    for size in centring.steps:
        move, _ = evolve(
            step.value, move, size, rng, schedule, lambda moves: step.is_steady(step.poses(moves))
        )
    if not move.any():
        return step.start
    pose = step.poses(move[None])
    after = step.least_share(pose)
    improved = after is not None and after.share > before.share
    return np.asarray(pose[0]) if improved else step.start


def least_share(problem: Problem, cam2world: Array) -> LeastShare | None:
    """Return the condition of a pose (4, 4) that leaves least; None if it breaks one."""
    pose = np.array(cam2world, dtype=np.float64)
    return _MarginStep(problem, pose, 1.0).least_share(pose[None])


class _MarginStep:
    """The shares of poses around a planned one."""

    def __init__(self, problem: Problem, start: Array, give_up: float) -> None:
        self.start = start
        self._request = problem
        self._constraints = problem.constraints
        need = problem.requirements
        self._rooms = rooms(
            problem.camera, problem.space.workspace, need.to_dict(), need.focus_reserve.on_axis_mm
        )
        constraints = self._constraints
        self._distance = math.dist(start[:3, 3], constraints.sphere_centre) or 1.0
        self._first = [
            name
            for name in constraints.constraint_names
            if name not in constraints.shows and name != "visibility"
        ]
        self._floor = np.maximum(problem.probability, self._sure(start[None])[0] - give_up)
        self._outline = _hull_points(problem)
        self._around = self._displaced()

    def poses(self, moves: Array) -> Array:
        """Return the poses (n, 4, 4) after moves (n, 6)."""
        return moved(self.start, moves, self._distance)

    def value(self, moves: Array) -> Array:
        """Return the soft minimum of the shares of moves (n, 6), less what the outline costs; else -1 or less."""
        poses = self.poses(moves)
        values, room = self._shares(poses)
        feasible = np.flatnonzero(np.isfinite(room).all(axis=1) & (room >= 0.0).all(axis=1))
        if feasible.size:
            soft = [_soft_minimum(row, _SOFTNESS) for row in room[feasible].tolist()]
            values[feasible] = np.array(soft) - _OUTLINE * self._cut_off(poses[feasible])
        return values

    def least_share(self, pose: Array) -> LeastShare | None:
        """Return the condition of a pose (1, 4, 4) that leaves the least of its room; None if it breaks one."""
        _, room = self._shares(pose)
        if not (np.isfinite(room).all() and (room >= 0.0).all()):
            return None
        k = int(np.argmin(room[0]))
        return LeastShare(self._names[k], float(room[0, k]))

    def _shares(self, poses: Array) -> tuple[Array, Array]:
        """Return how badly poses fail (n,), and their shares (n, s); nan where an earlier condition failed.

        Cheap conditions come first, and the costly ones see only what is left.
        """
        constraints = self._constraints
        margins = constraints.margins(poses, self._first)
        self._names = [
            *shares(dict.fromkeys(margins, 0.0), self._rooms),
            "probability",
            *(name for name in constraints.shows if name in self._rooms),
        ]
        broken = np.zeros(len(poses))
        for name, margin in margins.items():
            missed = np.maximum(-margin.min(axis=1), 0.0)
            broken += np.minimum(missed / constraints.scale(name), FULL)
        values = -2.0 - broken
        result = np.full((len(poses), len(self._names)), np.nan)
        feasible = np.flatnonzero(broken == 0.0)
        if feasible.size:
            seen = (
                constraints.margins(poses[feasible], ["visibility"])["visibility"].min(axis=1) > 0.0
            )
            values[feasible] = -1.5
            feasible = feasible[seen]
        if feasible.size:
            sure = self._sure(poses[feasible])
            lacking = np.maximum(self._floor - sure, 0.0).max(axis=1)
            enough = lacking == 0.0
            values[feasible] = -1.0 - lacking / 4.0
            feasible = feasible[enough]
            probable = probability_share(sure[enough].min(axis=1), self._request.probability)
        if not feasible.size:
            return values, result
        last = constraints.margins(poses[feasible], constraints.shows)
        remaining = {name: margin[feasible] for name, margin in margins.items()}
        room = {**shares(remaining, self._rooms), "probability": probable[:, None]}
        room.update(shares(last, self._rooms))
        for column, name in enumerate(self._names):
            result[feasible, column] = room[name].min(axis=1)
        values[feasible] = -1.0
        return values, result

    def _sure(self, poses: Array) -> Array:
        """Return P (n, k) times the probability of being in focus."""
        return np.asarray(
            self._request.objective.probability(poses) * self._constraints.focus_probability(poses)
        )

    def is_steady(self, poses: Array) -> NDArray[np.bool_]:
        """Return from which poses (n, 4, 4) all lines show after all displacements, too; a robot must reach them."""
        constraints = self._constraints
        reached = constraints.is_reached(poses)
        if not constraints.shows or not reached.any():
            return reached
        displaced = (poses[:, None] @ self._around).reshape(-1, 4, 4)
        shown = constraints.image.show_all(displaced).reshape(len(poses), -1).all(axis=1)
        return np.asarray(shown & reached)

    def _displaced(self) -> Array:
        """Return displacements (12, 4, 4) of three standard deviations: along the columns of a root, both ways."""
        factor = triangular_factor(self._request.pose_uncertainty.covariance)
        moves = np.ascontiguousarray(_SIGMAS * factor.T)
        return moved(np.eye(4), np.concatenate([moves, -moves]), 1.0)

    def _cut_off(self, poses: Array) -> Array:
        """Return which share (n,) of the part's outline is outside the picture; 0 where it cannot all be in it."""
        local = world_to_cam(self._outline, poses)
        depth = local[..., 2]
        x_low, y_low, x_high, y_high = self._request.camera.field().inner
        x = local[..., 0] / np.where(depth > 0, depth, np.nan)
        y = local[..., 1] / np.where(depth > 0, depth, np.nan)
        inside = (x >= x_low) & (x <= x_high) & (y >= y_low) & (y <= y_high)
        diagonal = float(np.linalg.norm(np.ptp(self._outline, axis=0)))
        fits = diagonal <= depth.mean(axis=1) * min(x_high - x_low, y_high - y_low)
        return np.where(fits, 1.0 - inside.mean(axis=1), 0.0)


def _soft_minimum(shares_left: list[float], tau: float) -> float:
    """Return -τ log Σ exp(-share / τ), with the same last digits on every machine."""
    lowest = min(shares_left)
    return lowest - tau * math.log(
        math.fsum(math.exp(-(share - lowest) / tau) for share in shares_left)
    )


def _hull_points(problem: Problem) -> Array:
    """Return the vertices of the part's convex hull (m, 3), mm."""
    from scipy.spatial import ConvexHull

    points = np.asarray(problem.space.solid.vertices, dtype=np.float64)
    return np.asarray(points[ConvexHull(points).vertices])
