"""What a run shows while it runs and hands back when it ends."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ga.bits import Brood, frozen


@dataclass(frozen=True, repr=False)
class Generation:
    """State of a run that the callback gets after every generation.

    The first one is the initial population (nit = 0).

    Attributes
    ----------
    nit : int
        Generations so far.
    population : (N, n_bits) bool, read-only
        The individuals.
    fitness : (N,) float64, read-only
        Their fitness.
    x : (n_bits,) bool, read-only
        Best bits of the run so far.
    fun : float
        Their fitness.
    nfev : int
        Individuals evaluated so far.
    """

    nit: int
    population: np.ndarray
    fitness: np.ndarray
    x: np.ndarray
    fun: float
    nfev: int

    def __repr__(self) -> str:
        """Return a one-line summary."""
        return f"<Generation {self.nit}: best fitness {self.fun:.6g}, {self.nfev} evaluations>"


@dataclass(frozen=True, repr=False)
class History:
    """The course of a run: one entry per generation, the initial population first.

    Every array has shape (nit + 1,).

    Attributes
    ----------
    best, mean, total : float64
        Highest, mean and summed fitness of the population of that generation.
    nfev : int64
        Individuals evaluated up to and including that generation.
    drawn : int64
        Offspring drawn (initial population: individuals drawn).
    eliminated : int64
        Number of infeasible ones among them. ``1 - eliminated / drawn`` is the feasible fraction.
    kept : int64
        Number of parents that stayed because all their offspring were eliminated.
    """

    best: np.ndarray
    mean: np.ndarray
    total: np.ndarray
    nfev: np.ndarray
    drawn: np.ndarray
    eliminated: np.ndarray
    kept: np.ndarray

    def __repr__(self) -> str:
        """Return a one-line summary."""
        return f"<History: {len(self.best) - 1} generations, best fitness {self.best.max():.6g}>"

    @property
    def best_so_far(self) -> np.ndarray:
        """Best fitness of the run up to each generation, shape (nit + 1,)."""
        return np.maximum.accumulate(self.best)


@dataclass(frozen=True, repr=False)
class GAResult:
    """Outcome of `ga.maximize`.

    Attributes
    ----------
    x : (n_bits,) bool
        Best bits ever evaluated. Among equals, the earliest.
    fun : float
        Their fitness.
    success : bool
        Whether the run converged, stalled or reached its target. False if a limit or the callback
        ended it.
    reason : str
        Why it stopped: "converged", "target", "stalled", "max_generations", "max_nfev" or "callback".
    message : str
        The same as a sentence, with the numbers.
    nit : int
        Generations.
    nfev : int
        Individuals evaluated.
    history : History
        Course of the run.
    population : (N, n_bits) bool
        The last population.
    fitness : (N,) float64
        Its fitness.
    seed : int or None
        Seed that reproduces the run bit for bit. None for a given Generator.
    """

    x: np.ndarray
    fun: float
    success: bool
    reason: str
    message: str
    nit: int
    nfev: int
    history: History
    population: np.ndarray
    fitness: np.ndarray
    seed: int | None

    def __repr__(self) -> str:
        """Return a one-line summary."""
        effort = f"{self.nit} generations, {self.nfev} evaluations"
        return f"<GAResult: best fitness {self.fun:.6g} after {effort}, {self.reason}>"


# The course of a run as it is written down, and the decision to stop that is read from it.


MESSAGES = {
    "converged": "The total fitness changed by less than epsilon = {epsilon:g} in {patience} generations running.",
    "target": "The best fitness reached the target of {target:g}.",
    "stalled": "The best fitness did not improve in max_stall = {max_stall} generations.",
    "max_generations": "The cap of max_generations = {max_generations} was reached.",
    "max_nfev": "Another generation might exceed max_nfev = {max_nfev} evaluations.",
    "callback": "The callback stopped the run.",
}


class Record:
    """What is remembered of a run: numbers of every generation, the last population, the best of all."""

    def __init__(self) -> None:
        self._rows: list[tuple[Any, ...]] = []
        self.population = self.fitness = self.x = np.empty(0)
        self.fun = -np.inf
        self.nfev = 0
        self.improved = 0

    @property
    def nit(self) -> int:
        """Generations so far, the initial population not counted."""
        return len(self._rows) - 1

    @property
    def totals(self) -> list[float]:
        """Total fitness of each generation so far."""
        return [row[2] for row in self._rows]

    def add(self, brood: Brood, fitness: np.ndarray, nfev: int) -> None:
        """Write down a generation, its fitness (N,) and how many individuals were evaluated for it."""
        self.population = frozen(brood.population)
        self.fitness = frozen(fitness)
        self.nfev += nfev
        best = int(np.argmax(fitness))
        total = float(fitness.sum())
        counts = (self.nfev, brood.drawn, brood.eliminated, brood.kept)
        self._rows.append((float(fitness[best]), total / len(fitness), total, *counts))
        if fitness[best] > self.fun:
            self.x = frozen(self.population[best].copy())
            self.fun = float(fitness[best])
            self.improved = self.nit

    def generation(self) -> Generation:
        """Return the present state, as the callback sees it."""
        return Generation(self.nit, self.population, self.fitness, self.x, self.fun, self.nfev)

    def history(self) -> History:
        """Return the numbers of all generations."""
        columns = list(zip(*self._rows, strict=True))
        floats = (np.array(column, dtype=np.float64) for column in columns[:3])
        integers = (np.array(column, dtype=np.int64) for column in columns[3:])
        return History(*floats, *integers)


@dataclass(frozen=True)
class Stopping:
    """When a run ends; checked by `ga.maximize`, whose parameters these are.

    `evaluations_ahead` is the largest number of evaluations another generation can take.
    """

    epsilon: float
    patience: int
    max_stall: int | None
    target: float | None
    max_generations: int
    max_nfev: int | None
    evaluations_ahead: int

    def reason(self, record: Record) -> str | None:
        """Return the first reason to stop, in the order of `MESSAGES`, or None."""
        if settled(record.totals[-self.patience - 1 :], self.epsilon, self.patience):
            return "converged"
        if self.target is not None and record.fun >= self.target:
            return "target"
        if self.max_stall is not None and record.nit - record.improved >= self.max_stall:
            return "stalled"
        if record.nit >= self.max_generations:
            return "max_generations"
        if self.max_nfev is not None and record.nfev + self.evaluations_ahead > self.max_nfev:
            return "max_nfev"
        return None

    def result(self, record: Record, reason: str, seed: int | None) -> GAResult:
        """Sum up a run that ended for `reason`."""
        return GAResult(
            x=record.x.copy(),
            fun=record.fun,
            success=reason in ("converged", "target", "stalled"),
            reason=reason,
            message=MESSAGES[reason].format(**vars(self)),
            nit=record.nit,
            nfev=record.nfev,
            history=record.history(),
            population=record.population.copy(),
            fitness=record.fitness.copy(),
            seed=seed,
        )


def settled(totals: list[float], epsilon: float, patience: int) -> bool:
    """Whether each of the last `patience` changes of the total is less than `epsilon`, or none at all."""
    if len(totals) <= patience:
        return False
    changes = np.abs(np.diff(totals[-patience - 1 :]))
    return bool(np.all((changes < epsilon) | (changes == 0.0)))
