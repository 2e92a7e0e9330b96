"""Whole populations: telling rows apart, evaluating what is new, drawing the first one."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ga.checks import call_feasible, call_fitness, check_population
from ga.exceptions import InfeasiblePopulationError, ParameterError

Fitness = Callable[[np.ndarray], np.ndarray]
Feasible = Callable[[np.ndarray], np.ndarray]
Sampler = Callable[[int, np.random.Generator], np.ndarray]


@dataclass(frozen=True)
class Brood:
    """A population just made, not evaluated yet, and how it came about; counts as in `ga.History`."""

    population: np.ndarray
    drawn: int
    eliminated: int
    kept: int


def row_keys(bits: np.ndarray) -> np.ndarray:
    """One comparable key per row of (N, n_bits) bool: equal keys exactly for equal rows; shape (N,)."""
    packed = np.packbits(bits, axis=1)
    return packed.view(f"V{packed.shape[1]}").ravel()


def first_seen(bits: np.ndarray) -> np.ndarray:
    """Index of the first row equal to each row of (N, n_bits) bool; shape (N,)."""
    _, first, inverse = np.unique(row_keys(bits), return_index=True, return_inverse=True)
    return first[inverse.ravel()]


def evaluate(
    fitness: Fitness, bits: np.ndarray, known_bits: np.ndarray, known: np.ndarray
) -> tuple[np.ndarray, int]:
    """Fitness of every row, calling `fitness` once, and only for what is not known yet.

    Parameters
    ----------
    fitness : callable
        ``fitness((k, n_bits) bool) -> (k,)``, a function of the bits alone.
    bits : (N, n_bits) bool
        The rows asked for.
    known_bits : (m, n_bits) bool
        Rows whose fitness is known.
    known : (m,) float64
        Their fitness.

    Returns
    -------
    values : (N,) float64
        Fitness of each row.
    k : int
        How many rows `fitness` was called on: different ones, none of them known.
    """
    n_known = len(known_bits)
    first = first_seen(np.concatenate([known_bits, bits]))[n_known:]
    new = np.flatnonzero(first == np.arange(n_known, n_known + len(bits)))
    values = np.concatenate([known, np.empty(len(bits))])
    if new.size:
        values[n_known + new] = call_fitness(fitness, frozen(bits[new]))
    return values[first], int(new.size)


def frozen(array: np.ndarray) -> np.ndarray:
    """Return `array` made read-only: what callers are shown, they cannot change."""
    array.flags.writeable = False
    return array


def uniform_sampler(n_bits: int) -> Sampler:
    """Return a sampler whose bits are all independent and even."""
    return lambda n, rng: rng.random((n, n_bits)) < 0.5


def initial_population(
    initial: np.ndarray | Sampler | None,
    shape: tuple[int, int],
    feasible: Feasible | None,
    attempts: int,
    distinct: bool,
    rng: np.random.Generator,
) -> Brood:
    """First population: given rows, then feasible draws until it is full.

    Parameters
    ----------
    initial : (n, n_bits) array of 0 and 1, callable, or None
        Rows to begin with, n <= N, all feasible; or ``initial(n, rng) -> (n, n_bits)``, a sampler to draw from; None:
        even random bits.
    shape : (N, n_bits)
        Size of the population.
    feasible : callable or None
        ``feasible((k, n_bits) bool) -> (k,) bool``.
    attempts : int
        How many times N individuals are drawn at most.
    distinct : bool
        Whether all rows must differ; of equal ones the first stays.
    rng : numpy.random.Generator
        Source of chance.

    Returns
    -------
    Brood
        Feasible rows (N, n_bits) bool, and counts.

    Raises
    ------
    ParameterError
        When given rows have the wrong shape or hold an infeasible row.
    InfeasiblePopulationError
        When too few feasible rows were drawn.
    """
    size, n_bits = shape
    sampler = initial if callable(initial) else uniform_sampler(n_bits)
    rows = np.empty((0, n_bits), dtype=bool)
    if initial is not None and not callable(initial):
        rows = _given_rows(initial, size, n_bits, feasible)
    if distinct:
        rows = _distinct(rows)
    drawn = eliminated = 0
    for _ in range(attempts):
        if len(rows) >= size:
            break
        candidates = check_population("initial(n, rng)", sampler(size, rng), n_bits)
        drawn += len(candidates)
        if feasible is not None:
            kept = candidates[call_feasible(feasible, frozen(candidates))]
            eliminated += len(candidates) - len(kept)
            candidates = kept
        rows = np.concatenate([rows, candidates])
        if distinct:
            rows = _distinct(rows)
    if len(rows) < size:
        kind = "distinct feasible" if distinct else "feasible"
        raise InfeasiblePopulationError(
            f"initial population must hold {size} {kind} individuals. Got {len(rows)} after {drawn} draws, "
            f"{eliminated} of them infeasible."
        )
    return Brood(rows[:size].copy(), drawn, eliminated, kept=0)


def _distinct(rows: np.ndarray) -> np.ndarray:
    result: np.ndarray = rows[first_seen(rows) == np.arange(len(rows))]
    return result


def _given_rows(
    initial: np.ndarray, size: int, n_bits: int, feasible: Feasible | None
) -> np.ndarray:
    rows = check_population("initial", initial, n_bits)
    if len(rows) > size:
        raise ParameterError(
            f"initial must have at most {size} rows, the population size. Got {len(rows)}."
        )
    if feasible is not None and len(rows):
        infeasible = np.flatnonzero(~call_feasible(feasible, frozen(rows.copy())))
        if infeasible.size:
            raise InfeasiblePopulationError(
                f"initial must hold only feasible individuals. "
                f"Got {infeasible.size} infeasible of {len(rows)}, the first in row {infeasible[0]}."
            )
    return rows
