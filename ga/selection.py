"""Who becomes a parent: chances proportional to weights, weights made from fitness.

Every method has a part without chance (weights; slots of the wheel), tested by hand, and a thin part that draws.
"""

from collections.abc import Callable

import numpy as np


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
