"""Mutation: every bit flips by itself."""

import numpy as np


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
