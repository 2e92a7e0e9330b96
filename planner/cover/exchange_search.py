"""Covers by exchange: a local search with weights, for pools too large for integer programming. It proves nothing.

A state is a given number of columns. Every step exchanges one of them for one that contains a missing entity, such that
the weight of what is missing is the least, and then adds to the weights of what is missing still (row weighting; Gao,
Weise & Li 2015, https://doi.org/10.1016/j.ejor.2015.05.038). A state that misses little tells, too, what a single
column would have to contain to make it a cover.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from planner.cover.set_cover import check_membership, distinct_rows, greedy_cover

# steps for which a column that has left does not come back, and for which one that has come does not leave; below
_LEFT = 6
_CAME = 3


class Exchange(NamedTuple):
    """What a search by exchange came across.

    Attributes
    ----------
    chosen : array of int
        The columns of a state that misses the fewest entities.
    missing : int
        How many it misses; 0: they are a cover.
    wanted : array of bool (w, e)
        Distinct sets. Each contains one entity that a state with so few missing misses, and what one of its columns
        alone contains: a column that contains the set could take that one's place, and one entity fewer were missing.
    """

    chosen: np.ndarray
    missing: int
    wanted: np.ndarray


def exchange_columns(
    membership: np.ndarray, size: int, *, steps: int, rng: int | np.random.Generator = 0
) -> Exchange:
    """Look for a cover of a given size, or for what would make one.

    Parameters
    ----------
    membership : array_like of bool, shape (c, e)
        ``membership[c, e]``: column c contains entity e.
    size : int
        Columns of the cover, one at least.
    steps : int
        Exchanges at most; fewer if a cover is found.
    rng : int or numpy.random.Generator

    Raises
    ------
    CoverError
        If some entity is in no column.
    """
    membership = check_membership(membership)
    rng = np.random.default_rng(rng)
    # products of real numbers are much quicker than sums of Booleans
    contains = membership.astype(float)
    chosen = greedy_cover(membership)[:size]
    weights = np.ones(membership.shape[1])
    free_from = np.zeros(len(membership), dtype=int)
    best = Exchange(chosen, membership.shape[1] + 1, membership[:0])
    wanted: list[np.ndarray] = []
    for step in range(steps + 1):
        count = membership[chosen].sum(axis=0)
        missing = np.flatnonzero(count == 0)
        alone = membership[chosen] & (count == 1)
        if len(missing) < best.missing:
            best = best._replace(chosen=chosen.copy(), missing=len(missing))
            wanted = []
        if not missing.size or step == steps:
            break
        if len(missing) == best.missing:
            wanted.append(_one_more(alone, missing))
        weights[missing] += 1.0
        comes = np.flatnonzero(membership[:, rng.choice(missing)])
        comes = _free(comes, free_from[comes], step)
        leaves = _free(np.arange(len(chosen)), free_from[chosen], step)
        i, k = _least(alone[leaves], count == 0, contains[comes], weights, rng)
        free_from[chosen[leaves[i]]] = step + rng.integers(2, _LEFT)
        free_from[comes[k]] = step + rng.integers(1, _CAME)
        chosen[leaves[i]] = comes[k]
    if wanted:
        sets = np.concatenate(wanted)
        best = best._replace(wanted=sets[np.sort(distinct_rows(sets)[0])])
    return best


def _one_more(alone: np.ndarray, missing: np.ndarray) -> np.ndarray:
    """Return what each column alone contains (k, e), together with each of the missing entities."""
    sets = np.repeat(alone, len(missing), axis=0)
    sets[np.arange(len(sets)), np.tile(missing, len(alone))] = True
    return sets


def _free(columns: np.ndarray, free_from: np.ndarray, step: int) -> np.ndarray:
    """Return the columns that may take part in this step; all if none may."""
    free = columns[free_from <= step]
    return free if free.size else columns


def _least(
    alone: np.ndarray,
    missing: np.ndarray,
    contains: np.ndarray,
    weights: np.ndarray,
    rng: np.random.Generator,
) -> tuple[int, int]:
    """Return which of the chosen columns (k, e) to exchange for which other one (c, e); equal ones at random."""
    to_cover = (alone | missing) * weights
    left = to_cover.sum(axis=1)[:, None] - to_cover @ contains.T
    least = np.argwhere(left <= left.min() + 0.5)
    return tuple(least[rng.integers(len(least))])
