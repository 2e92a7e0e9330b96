"""The course of a run as it is written down, and the decision to stop that is read from it."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ga.population import Brood, frozen
from ga.result import GAResult, Generation, History

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
