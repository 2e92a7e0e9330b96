"""From one generation to the next: select, cross, mutate, eliminate, replace."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ga.bits import Brood, Feasible, call_feasible, first_seen, frozen

# One-point crossover.


def exchange_tails(
    first: np.ndarray, second: np.ndarray, cuts: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Two children of each couple: the parents with their bits from the cut on exchanged.

    Parameters
    ----------
    first, second : (n, n_bits) bool
        The parents of each couple.
    cuts : (n,) int
        How many leading bits each child keeps; n_bits leaves the couple as it is.

    Returns
    -------
    (n, n_bits) bool, (n, n_bits) bool
        The child that begins like `first`, and the one that begins like `second`.
    """
    tail = np.arange(first.shape[1]) >= cuts[:, None]
    return np.where(tail, second, first), np.where(tail, first, second)


def draw_cuts(n: int, n_bits: int, probability: float, rng: np.random.Generator) -> np.ndarray:
    """Cuts of `n` couples: with `probability` a place Y uniform in [1, n_bits - 1], else n_bits (no crossover)."""
    crossed = rng.random(n) < probability
    if n_bits == 1:  # there is no place to cut
        return np.ones(n, dtype=np.int64)
    return np.where(crossed, rng.integers(1, n_bits, n), n_bits)


def one_point(
    first: np.ndarray, second: np.ndarray, probability: float, rng: np.random.Generator
) -> np.ndarray:
    """Cross each couple at one random place, with a given probability.

    Parameters
    ----------
    first, second : (n, n_bits) bool
        The parents of each couple.
    probability : float
        P_c: how likely a couple is crossed rather than copied.
    rng : numpy.random.Generator
        Source of chance.

    Returns
    -------
    (2 n, n_bits) bool
        Row 2 i begins like ``first[i]``, row 2 i + 1 like ``second[i]``.
    """
    cuts = draw_cuts(len(first), first.shape[1], probability, rng)
    children = exchange_tails(first, second, cuts)
    return np.stack(children, axis=1).reshape(-1, first.shape[1])


# Mutation: every bit flips by itself.


def flip_bits(bits: np.ndarray, probability: float, rng: np.random.Generator) -> np.ndarray:
    """Flip every bit by itself, with the same probability.

    A probability of 0.5 forgets the parent altogether. Above it offspring resemble their parent's complement, so 0.9
    keeps as much of a parent as 0.1 does, every other generation.

    Parameters
    ----------
    bits : (N, n_bits) bool
        Individuals; left as they are.
    probability : float
        P_m of the paper.
    rng : numpy.random.Generator
        Source of chance.

    Returns
    -------
    (N, n_bits) bool
        The mutated individuals.
    """
    return bits ^ (rng.random(bits.shape) < probability)


# Who becomes a parent: chances proportional to weights, weights made from fitness.
#
# Every method has a part without chance (weights; slots of the wheel), tested by hand, and a thin
# part that draws.


def proportional_weights(fitness: np.ndarray) -> np.ndarray:
    """Weights of the paper: the fitness itself.

    A wheel has no negative slots. When any fitness is negative, all are shifted up by the lowest, whose weight
    becomes zero; without a negative value nothing is shifted. When all weights would be zero, all become one: an even
    chance.

    Parameters
    ----------
    fitness : (N,) float64
        Finite values, higher is better.

    Returns
    -------
    (N,) float64
        Weights in [0, 1], scaled so that no sum of them can overflow.
    """
    largest = np.abs(fitness).max()
    if largest == 0.0:
        return np.ones(len(fitness))
    # The power of two keeps ratios exact; halves leave room for the difference of two extremes.
    weights = np.ldexp(fitness, -np.frexp(largest)[1] - 1)
    weights = weights - min(weights.min(), 0.0)
    return weights if weights.any() else np.ones(len(fitness))


def window_weights(fitness: np.ndarray) -> np.ndarray:
    """Weights above the worst: fitness minus the lowest of the population, shape (N,).

    Keeps the pressure up when all of a population is good: 0.95 against 0.94 is hardly a difference to
    `proportional_weights`. All equal: an even chance.
    """
    halves = fitness / 2.0
    return proportional_weights(halves - halves.min())


def rank_weights(fitness: np.ndarray) -> np.ndarray:
    """Weights by rank: 1 for the worst to N for the best, equal fitness sharing the mean of their ranks; shape (N,).

    Only the order counts, so the pressure is the same in every generation and for every scale of the fitness.
    """
    _, inverse, counts = np.unique(fitness, return_inverse=True, return_counts=True)
    last = np.cumsum(counts)
    return (last - (counts - 1) / 2.0)[inverse]


def spin(weights: np.ndarray, positions: np.ndarray) -> np.ndarray:
    """Slots of the wheel at given positions.

    Parameters
    ----------
    weights : (N,) float64
        Not negative, at least one positive: the width of each slot.
    positions : (n,) float64
        Places on the wheel in [0, 1).

    Returns
    -------
    (n,) int64
        Index of the slot at each position; a slot is closed on its left and open on its right, so one of zero width
        is never met.
    """
    # the power of two changes no share, and keeps the least of weights apart
    edges = np.cumsum(np.ldexp(weights, -np.frexp(weights.max())[1]))
    slots = np.searchsorted(edges, positions * edges[-1], side="right")
    # A position just below 1 may round up to the very end of the wheel.
    result: np.ndarray = np.minimum(slots, np.flatnonzero(weights)[-1])
    return result


def roulette(weights: np.ndarray, n: int, rng: np.random.Generator) -> np.ndarray:
    """Roulette wheel: `n` independent spins; indices of shape (n,)."""
    return spin(weights, rng.random(n))


def stochastic_universal(weights: np.ndarray, n: int, rng: np.random.Generator) -> np.ndarray:
    """Stochastic universal sampling: one spin of a wheel with `n` evenly spaced pointers; indices of shape (n,).

    Guarantee: an individual with the share s of all weight is chosen floor(n s) or ceil(n s) times. The result is
    shuffled, so that pairs of neighbours are pairs at random. J. E. Baker, "Reducing bias and inefficiency in the
    selection algorithm", Proc. 2nd Int. Conf. on Genetic Algorithms, 1987.
    """
    positions = (np.arange(n) + rng.random()) / n
    return rng.permutation(spin(weights, positions))


SCALINGS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "proportional": proportional_weights,
    "window": window_weights,
    "rank": rank_weights,
}
SELECTIONS: dict[str, Callable[[np.ndarray, int, np.random.Generator], np.ndarray]] = {
    "roulette": roulette,
    "sus": stochastic_universal,
}


@dataclass(frozen=True)
class Breeding:
    """How offspring are made; checked by `ga.maximize`, whose parameters these are.

    `weigh` and `select` are the functions behind the names in `ga.operators.SCALINGS` and `SELECTIONS`.
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
    population: np.ndarray,
    weights: np.ndarray,
    n: int,
    breeding: Breeding,
    rng: np.random.Generator,
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
    breeding : Breeding
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
    parents = breeding.select(weights, n + n % 2, rng)
    children = one_point(
        population[parents[0::2]], population[parents[1::2]], breeding.crossover, rng
    )
    return flip_bits(children, breeding.mutation, rng)[:n], parents[:n]


def next_generation(
    population: np.ndarray, fitness: np.ndarray, breeding: Breeding, rng: np.random.Generator
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
    breeding : Breeding
        Operators, probabilities and rules.
    rng : numpy.random.Generator
        Source of chance.

    Returns
    -------
    Brood
        The new population, (N, n_bits) bool, and counts.
    """
    weights = breeding.weigh(fitness)
    elite = np.argsort(-fitness, kind="stable")[: breeding.elitism]
    following = population.copy()
    following[: breeding.elitism] = population[elite]
    taken = np.arange(len(population)) < breeding.elitism
    parents = np.zeros(len(population), dtype=np.int64)
    drawn = eliminated = 0
    for _ in range(breeding.attempts):
        places = np.flatnonzero(~taken)
        if not places.size:
            break
        following[places], parents[places] = breed(population, weights, places.size, breeding, rng)
        drawn += places.size
        if breeding.feasible is not None:
            places = places[call_feasible(breeding.feasible, frozen(following[places]))]
            eliminated += int((~taken).sum()) - places.size
        if not breeding.duplicates:
            places = places[_is_new(following, taken, places)]
        taken[places] = True
    gaps = np.flatnonzero(~taken)
    following[gaps] = population[parents[gaps]]
    return Brood(following, drawn, eliminated, gaps.size)


def _is_new(bits: np.ndarray, taken: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Which rows at `places` equal no taken row and no earlier row at `places`; shape (len(places),) bool."""
    n_taken = int(taken.sum())
    first = first_seen(np.concatenate([bits[taken], bits[places]]))[n_taken:]
    result: np.ndarray = first == np.arange(n_taken, n_taken + places.size)
    return result
