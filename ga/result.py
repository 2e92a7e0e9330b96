"""What a run shows while it runs and hands back when it ends."""

from dataclasses import dataclass

import numpy as np


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
