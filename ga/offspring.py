"""From one generation to the next: select, cross, mutate, eliminate, replace."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ga.checks import call_feasible
from ga.crossover import one_point
from ga.mutation import flip_bits
from ga.population import Brood, Feasible, first_seen, frozen


@dataclass(frozen=True)
class Breeding:
    """How offspring are made; checked by `ga.maximize`, whose parameters these are.

    `weigh` and `select` are the functions behind the names in `ga.selection.SCALINGS` and `SELECTIONS`.
    """

    crossover: float
    mutation: float
    weigh: Callable[..., np.ndarray]
    select: Callable[..., np.ndarray]
    elitism: int
    duplicates: bool
    attempts: int
    feasible: Feasible | None


def breed(
    population: np.ndarray, weights: np.ndarray, n: int, how: Breeding, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Draw `n` offspring, feasible or not.

    Parameters
    ----------
    population : (N, n_bits) bool
        The generation parents are chosen from.
    weights : (N,) float64
        Their slots on the wheel.
    n : int
        Offspring wanted.
    how : Breeding
        Operators and probabilities.
    rng : numpy.random.Generator
        Source of chance.

    Returns
    -------
    children : (n, n_bits) bool
        The offspring. Couples have two; of an odd number the last child is dropped.
    parents : (n,) int64
        Index of the parent whose leading bits a child has.
    """
    parents = how.select(weights, n + n % 2, rng)
    children = one_point(population[parents[0::2]], population[parents[1::2]], how.crossover, rng)
    return flip_bits(children, how.mutation, rng)[:n], parents[:n]


def next_generation(
    population: np.ndarray, fitness: np.ndarray, how: Breeding, rng: np.random.Generator
) -> Brood:
    """Make the next population, of the same size and all feasible.

    The best `elitism` individuals come first, unchanged. Every other place draws an offspring; one that is infeasible
    (or, without `duplicates`, equal to an individual already in the new population) is eliminated and the place draws
    again, up to `attempts` times in all. A place that has drawn in vain goes to the parent of its last offspring,
    which is feasible.

    Parameters
    ----------
    population : (N, n_bits) bool
        Feasible individuals.
    fitness : (N,) float64
        Their fitness.
    how : Breeding
        Operators, probabilities and rules.
    rng : numpy.random.Generator
        Source of chance.

    Returns
    -------
    Brood
        The new population, (N, n_bits) bool, and counts.
    """
    weights = how.weigh(fitness)
    elite = np.argsort(-fitness, kind="stable")[: how.elitism]
    following = population.copy()
    following[: how.elitism] = population[elite]
    taken = np.arange(len(population)) < how.elitism
    parents = np.zeros(len(population), dtype=np.int64)
    drawn = eliminated = 0
    for _ in range(how.attempts):
        places = np.flatnonzero(~taken)
        if not places.size:
            break
        following[places], parents[places] = breed(population, weights, places.size, how, rng)
        drawn += places.size
        if how.feasible is not None:
            places = places[call_feasible(how.feasible, frozen(following[places]))]
            eliminated += int((~taken).sum()) - places.size
        if not how.duplicates:
            places = places[_is_new(following, taken, places)]
        taken[places] = True
    left = np.flatnonzero(~taken)
    following[left] = population[parents[left]]
    return Brood(following, drawn, eliminated, left.size)


def _is_new(bits: np.ndarray, taken: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Which rows at `places` equal no taken row and no earlier row at `places`; shape (len(places),) bool."""
    n_taken = int(taken.sum())
    first = first_seen(np.concatenate([bits[taken], bits[places]]))[n_taken:]
    result: np.ndarray = first == np.arange(n_taken, n_taken + places.size)
    return result
