"""Mutation: every bit flips by itself."""

import numpy as np


def flip_bits(bits: np.ndarray, probability: float, rng: np.random.Generator) -> np.ndarray:
    """Flip every bit of (N, n_bits) bool independently with `probability` (P_m); a new array is returned."""
    return bits ^ (rng.random(bits.shape) < probability)
