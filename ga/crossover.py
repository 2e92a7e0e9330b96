"""One-point crossover."""

import numpy as np


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
