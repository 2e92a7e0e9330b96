"""Entities of which no two can be inspected together: a bound without any search."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

# greedy cliques from every entity, this many times
_ROUNDS = 5
# the first time by degree, then with so much chance in it
_CHANCE = 1.5


def large_clique(conflict: NDArray[np.bool_]) -> NDArray[np.int_]:
    """Return entities that exclude each other pairwise, as many as a greedy search finds.

    No setting inspects two of them, so each needs one of its own.

    Parameters
    ----------
    conflict : array of bool (e, e)
        Symmetric, false on the diagonal.

    Returns
    -------
    array of int, ascending
    """
    conflict = np.asarray(conflict, dtype=bool)
    rng = np.random.default_rng(0)
    best = np.zeros(0, dtype=int)
    for trial in range(_ROUNDS * len(conflict)):
        clique = [trial % len(conflict)]
        left = np.flatnonzero(conflict[trial % len(conflict)])
        while len(left) and len(clique) + len(left) > len(best):
            # the one that leaves most to choose from
            leaves = conflict[np.ix_(left, left)].sum(axis=1) + _CHANCE * rng.random(len(left)) * (
                trial >= len(conflict)
            )
            chosen = left[np.argmax(leaves)]
            clique.append(int(chosen))
            left = left[conflict[chosen, left]]
        if len(clique) > len(best):
            best = np.sort(clique)
    return best
