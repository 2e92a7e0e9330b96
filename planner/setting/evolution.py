"""The evolution strategy with covariance matrix adaptation (CMA-ES), for few real numbers and a function with cliffs.

Reference: N. Hansen, "The CMA evolution strategy: a tutorial", arXiv:1604.00772, 2016. Names are those of the tutorial,
but that the root of the covariance is its lower triangular factor.

Sums are taken one after the other and no library for matrices is used: its last digits depend on processor and version,
and so would every pose that is planned.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

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
        for weight, one in zip(self._weights.tolist(), moves, strict=True):
            move = move + weight * one
            spread = spread + weight * (one[:, None] * one)
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
        left = float(covariance[j, j])
        for k in range(j):
            left -= float(factor[j, k]) ** 2
        factor[j, j] = math.sqrt(max(left, 0.0))
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
    found = np.zeros_like(vector)
    for i in range(len(vector)):
        value = float(vector[i])
        for k in range(i):
            value -= float(root[i, k] * found[k])
        found[i] = value / root[i, i] if root[i, i] > 0.0 else 0.0
    return found


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
