"""A run of the genetic algorithm and its result."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ga import bits as checks
from ga.bits import (
    SCALINGS,
    SELECTIONS,
    Breeding,
    Brood,
    Feasible,
    Fitness,
    Sampler,
    Scaling,
    Selection,
    evaluate,
    frozen,
    initial_population,
    next_generation,
)
from ga.exceptions import ParameterError

# What a run shows while it runs and hands back when it ends.


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


# The genetic algorithm itself: `maximize`.


def maximize(
    fitness: Fitness,
    n_bits: int,
    population: int = 100,
    crossover: float = 0.9,
    mutation: float = 0.1,
    feasible: Feasible | None = None,
    initial: np.ndarray | Sampler | None = None,
    *,
    rng: int | np.random.Generator | None = 0,
    callback: Callable[[Generation], object] | None = None,
    selection: Selection = "roulette",
    scaling: Scaling = "proportional",
    elitism: int = 0,
    duplicates: bool = True,
    epsilon: float = 1e-3,
    patience: int = 5,
    max_stall: int | None = None,
    target: float | None = None,
    max_generations: int = 1000,
    max_nfev: int | None = None,
    attempts: int = 20,
    initial_attempts: int = 100,
) -> GAResult:
    """Maximise a function of bits by the genetic algorithm of Yang and Ciarallo (2001, section 4).

    With the default options this is the paper's algorithm. It uses roulette-wheel selection,
    one-point crossover, mutation of every bit and elimination of infeasible offspring. It ends when
    the total fitness of the population has settled. It returns the best individual ever evaluated,
    whether or not it survived.

    Guarantee: `feasible` is called before `fitness`, and `fitness` only on individuals that are feasible, different
    from each other and not in the previous population (their fitness is known). Every population, the first included,
    has exactly `population` individuals, all feasible. The same arguments with the same integer `rng` give the same
    result, bit for bit.

    Parameters
    ----------
    fitness : callable
        ``fitness(bits) -> values``: bits (k, n_bits) bool, read-only, 1 <= k <= population; values (k,) finite,
        higher is better. It must depend on the bits alone. For values that can be negative, see `scaling`.
    n_bits : int
        Length of the bit string, at least 1.
    population : int
        Individuals in every generation (N), at least 2.
    crossover : float
        Probability P_c in [0, 1] of crossing a couple, at a point uniform in [1, n_bits - 1].
    mutation : float
        Probability P_m in [0, 1] that a bit flips, independently for each bit.
    feasible : callable, optional
        ``feasible(bits) -> mask``: bits as for `fitness`; mask (k,) bool. Default: everything is feasible.
    initial : array or callable, optional
        First individuals: (n, n_bits) of 0 and 1 with n <= population, all feasible, the rest being drawn; or a
        sampler ``initial(n, rng) -> (m, n_bits)``. Infeasible draws are discarded and redrawn. Default: even random
        bits.

    Returns
    -------
    GAResult
        Best bits and fitness, reason of the end, history, last population and seed.

    Other Parameters
    ----------------
    rng : int, numpy.random.Generator or None
        Seed, or source of chance. None takes a fresh seed, which the result states.
    callback : callable, optional
        ``callback(generation)``, see `ga.Generation`, after the initial population and after every generation. A true
        return value or ``StopIteration`` ends the run.
    selection : {"roulette", "sus"}
        Independent spins of the wheel, or stochastic universal sampling.
    scaling : {"proportional", "window", "rank"}
        Slots of the wheel: the fitness itself, the fitness above the lowest, or the rank. If a
        fitness is negative, "proportional" raises all by the lowest of the population. If all are
        zero, the chances are even.
    elitism : int
        Number of best individuals that pass unchanged to the next generation, in [0, population -
        1].
    duplicates : bool
        If False, eliminate an offspring that equals another individual of the new population. If
        all draws fail, the parent stays even if it equals another individual.
    epsilon : float
        The run has converged when the total fitness changes by less than this (or not at all) in
        `patience` consecutive generations. It is absolute as in the paper: total of the whole
        population, in units of the fitness.
    patience : int
        Generations for `epsilon`, at least 1.
    max_stall : int, optional
        Also stop after this many generations without a better best fitness.
    target : float, optional
        Also stop as soon as the best fitness of the run is at least this.
    max_generations : int
        Cap on generations.
    max_nfev : int, optional
        Cap on evaluated individuals, at least `population`; never exceeded: no generation begins that might exceed
        it.
    attempts : int
        Largest number of offspring drawn for one member of the next generation. After that, the
        parent of the last one stays.
    initial_attempts : int
        Largest number of times the whole initial population is drawn.

    Raises
    ------
    ParameterError
        When a parameter breaks its rule (also a ValueError).
    FitnessError
        When `fitness` or `feasible` return the wrong shape or type, or a fitness is nan or infinite (also a
        ValueError).
    InfeasiblePopulationError
        When given individuals are infeasible or too few feasible ones are found to begin (also a ValueError).

    Examples
    --------
    >>> from ga import maximize
    >>> result = maximize(lambda bits: bits.sum(axis=1), 20, mutation=0.02, elitism=1, max_stall=50)
    >>> result.fun
    20.0
    """
    checks.check_callable("fitness", fitness)
    checks.check_callable("feasible", feasible, optional=True)
    checks.check_callable("callback", callback, optional=True)
    n_bits = checks.check_integer("n_bits", n_bits, 1)
    size = checks.check_integer("population", population, 2)
    breeding = Breeding(
        crossover=checks.check_probability("crossover", crossover),
        mutation=checks.check_probability("mutation", mutation),
        weigh=SCALINGS[checks.check_choice("scaling", scaling, SCALINGS)],
        select=SELECTIONS[checks.check_choice("selection", selection, SELECTIONS)],
        elitism=checks.check_integer("elitism", elitism, 0, size - 1),
        duplicates=checks.check_flag("duplicates", duplicates),
        attempts=checks.check_integer("attempts", attempts, 1),
        feasible=feasible,
    )
    if not breeding.duplicates and n_bits < size.bit_length() and 2**n_bits < size:
        raise ParameterError(
            f"population must be at most 2**n_bits = {2**n_bits} without duplicates. Got {size}."
        )
    stopping = Stopping(
        epsilon=checks.check_nonnegative("epsilon", epsilon),
        patience=checks.check_integer("patience", patience, 1),
        max_stall=checks.check_limit("max_stall", max_stall, 1),
        target=None if target is None else checks.check_finite("target", target),
        max_generations=checks.check_integer("max_generations", max_generations, 1),
        max_nfev=checks.check_limit("max_nfev", max_nfev, size),
        evaluations_ahead=size - breeding.elitism,
    )
    most_draws = checks.check_integer("initial_attempts", initial_attempts, 1)
    generator, seed = checks.check_rng(rng)
    first = initial_population(
        initial, (size, n_bits), feasible, most_draws, not breeding.duplicates, generator
    )
    record, reason = _evolve(fitness, first, breeding, stopping, callback, generator)
    return stopping.result(record, reason, seed)


def _evolve(
    fitness: Fitness,
    first: Brood,
    breeding: Breeding,
    stopping: Stopping,
    callback: Callable[[Generation], object] | None,
    rng: np.random.Generator,
) -> tuple[Record, str]:
    """Evaluate and breed until there is a reason to stop; return what happened and that reason."""
    record = Record()
    record.add(first, *evaluate(fitness, first.population, first.population[:0], np.empty(0)))
    while True:
        reason = _ask(callback, record) or stopping.reason(record)
        if reason:
            return record, reason
        brood = next_generation(record.population, record.fitness, breeding, rng)
        record.add(brood, *evaluate(fitness, brood.population, record.population, record.fitness))


def _ask(callback: Callable[[Generation], object] | None, record: Record) -> str | None:
    """Show the generation to the callback; "callback" if it wants to stop."""
    if callback is None:
        return None
    try:
        return "callback" if callback(record.generation()) else None
    except StopIteration:
        return "callback"
