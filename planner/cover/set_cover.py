"""Minimum set cover with a proof of optimality, and the checker that does not trust it.

Notation: a *column* is a set of entities that one sensor setting can inspect; ``membership[c, e]`` is True where
column c contains entity e. A cover is a set of columns that together contain every entity.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import LinearConstraint, milp
from scipy.sparse import csr_matrix

from ground.decorators import entry_kernel
from planner.exceptions import CoverError

# the preferences of all chosen columns together stay below this, so they can never outweigh one column
_PREFERENCE = 0.5


@dataclass(frozen=True)
class Cover:
    """A set of columns that covers every entity.

    Attributes
    ----------
    chosen : tuple of int
        Indices of the chosen columns, ascending.
    lower_bound : int
        Proven lower bound of the number of columns.
    """

    chosen: tuple[int, ...]
    lower_bound: int

    @property
    def optimal(self) -> bool:
        """Whether the cover is proven minimal."""
        return len(self.chosen) == self.lower_bound


def min_cover(
    membership: np.ndarray,
    preference: np.ndarray | None = None,
    *,
    time_limit_s: float = 60.0,
    node_limit: int | None = None,
    slack: float = 0.0,
) -> Cover:
    """Find the fewest columns that cover every entity, by integer programming (HiGHS).

    **Guarantee.** The result covers every entity, and ``lower_bound`` is proven. Among covers of
    the same size, it has the largest total preference up to ``slack``. The result depends only on
    the arguments, unless the time limit ends the search.

    Parameters
    ----------
    membership : array_like of bool, shape (c, e)
        ``membership[c, e]``: column c contains entity e.
    preference : array_like, shape (c,), optional
        Numbers in [0, 1]. Between covers of equal size, a larger sum is better.
    time_limit_s : float
        After this many seconds, return the best cover and the bound so far.
    node_limit : int, optional
        The same limit in nodes of the solver's tree. It makes the result reproducible.
    slack : float
        Permitted loss of preference, as a share of its whole possible effect, in [0, 0.4]. Most of
        the solver's time goes into preferences, and it may stop sooner above 0. The size of the
        cover is the smallest in any case.

    Returns
    -------
    Cover
        The chosen columns and the proven bound.

    Raises
    ------
    CoverError
        If some entity is in no column.

    Examples
    --------
    >>> from planner import min_cover
    >>> columns = [[True, True, False], [False, True, True], [False, False, True]]
    >>> cover = min_cover(columns)
    >>> len(cover.chosen), cover.lower_bound
    (2, 2)
    """
    membership = check_membership(membership)
    n_columns, n_entities = membership.shape
    if n_entities == 0:
        return Cover((), 0)
    preference = np.zeros(n_columns) if preference is None else np.asarray(preference, dtype=float)
    cost = 1.0 + _PREFERENCE / (n_entities + 1) * (1.0 - preference)
    greedy = greedy_cover(membership)
    options = {"mip_rel_gap": slack / len(greedy), "time_limit": time_limit_s}
    if node_limit is not None:
        options["node_limit"] = node_limit
    result = milp(
        cost,
        integrality=np.ones(n_columns),
        bounds=(0, 1),
        constraints=LinearConstraint(csr_matrix(membership.T.astype(float)), lb=1.0),
        options=options,
    )
    chosen = greedy if result.x is None else np.flatnonzero(result.x > 0.5)
    chosen = _without_spare(membership, chosen, preference)
    bound = (
        len(chosen) if result.status == 0 else _bound_on_count(result.mip_dual_bound, n_entities)
    )
    return Cover(tuple(int(c) for c in chosen), bound)


def cover_within(
    membership: np.ndarray, size: int, *, node_limit: int
) -> tuple[np.ndarray | None, bool]:
    """Look for any cover of at most so many columns; much quicker than looking for the smallest one.

    Parameters
    ----------
    membership : array_like of bool, shape (c, e)
    size : int
        Columns at most.
    node_limit : int
        Nodes of the solver's tree at most.

    Returns
    -------
    chosen : ndarray of int or None
        Column indices, or None if no such cover was found.
    decided : bool
        False if the search ended before it was clear that there is none.
    """
    membership = check_membership(membership)
    greedy = greedy_cover(membership)
    if len(greedy) <= size:
        return greedy, True
    covers = LinearConstraint(csr_matrix(membership.T.astype(float)), lb=1.0)
    few = LinearConstraint(np.ones((1, len(membership))), ub=float(size))
    result = milp(
        np.ones(len(membership)),
        integrality=np.ones(len(membership)),
        bounds=(0, 1),
        constraints=[covers, few],
        # any solution will do
        options={"mip_rel_gap": 1.0, "node_limit": node_limit},
    )
    if result.x is None:
        return None, result.status == 2
    return np.flatnonzero(result.x > 0.5), True


def is_cover(membership: np.ndarray, chosen: Sequence[int] | np.ndarray) -> bool:
    """Return whether the chosen columns together contain every entity.

    Parameters
    ----------
    membership : array_like of bool, shape (c, e)
        ``membership[c, e]``: column c contains entity e.
    chosen : iterable of int
        Indices of the chosen columns.

    Returns
    -------
    bool
        Whether every entity is in a chosen column.

    Examples
    --------
    >>> from planner import is_cover
    >>> columns = [[True, True, False], [False, True, True], [False, False, True]]
    >>> is_cover(columns, [0, 2]), is_cover(columns, [1, 2])
    (True, False)
    """
    membership = np.asarray(membership, dtype=bool)
    seen: set[int] = set()
    for column in chosen:
        seen.update(np.flatnonzero(membership[column]).tolist())
    return seen == set(range(membership.shape[1]))


def greedy_cover(membership: np.ndarray) -> np.ndarray:
    """Cover by always taking the column with most entities still missing: the classical rival.

    Returns
    -------
    ndarray of int
        Column indices in the order they were taken; at most H(e) times the minimum (Chvatal 1979).
    """
    membership = check_membership(membership)
    missing = np.ones(membership.shape[1], dtype=bool)
    chosen = []
    while missing.any():
        chosen.append(int(np.argmax((membership & missing).sum(axis=1))))
        missing &= ~membership[chosen[-1]]
    return np.array(chosen, dtype=int)


def bound_columns(membership: np.ndarray) -> int:
    """Return a number of columns that no cover goes below, by two quick counts.

    A cover needs a column for each of several entities of which no column contains two.
    A greedy search finds some. Where no column contains all entities, a cover needs two.

    Parameters
    ----------
    membership : array of bool, shape (c, e)
        Every entity is in some column.

    Returns
    -------
    int
        0 where there is no entity.
    """
    if not membership.shape[1]:
        return 0
    # single precision counts far enough to tell none from some
    contains = membership.astype(np.float32)
    together = contains.T @ contains > 0
    n_together = together.sum(axis=1)
    free = np.ones(len(together), dtype=bool)
    n_apart = 0
    while free.any():
        candidates = np.flatnonzero(free)
        chosen = candidates[n_together[candidates].argmin()]
        free &= ~together[chosen]
        n_apart += 1
    return max(n_apart, 1 if membership.all(axis=1).any() else 2)


def maximal_columns(membership: np.ndarray) -> np.ndarray:
    """Return the indices of the columns contained in no other one; of equal columns the first.

    Parameters
    ----------
    membership : array_like of bool, shape (c, e)

    Returns
    -------
    ndarray of int, ascending
    """
    membership = np.asarray(membership, dtype=bool)
    first, _ = distinct_rows(membership)
    order = first[np.argsort(-membership[first].sum(axis=1), kind="stable")]
    return np.sort(order[_not_contained(_packed(membership[order]))])


@entry_kernel
def _not_contained(words):
    """Return which sets, given as rows of bits from large to small, are not empty and not in an earlier such one."""
    n, n_words = words.shape
    kept = np.zeros(n, dtype=np.bool_)
    kept_idx = np.empty(n, dtype=np.int64)
    n_kept = 0
    for i in range(n):
        empty = True
        for w in range(n_words):
            if words[i, w]:
                empty = False
                break
        contained = empty
        for k in range(n_kept):
            if contained:
                break
            contained = True
            for w in range(n_words):
                if words[i, w] & ~words[kept_idx[k], w]:
                    contained = False
                    break
        if not contained:
            kept[i] = True
            kept_idx[n_kept] = i
            n_kept += 1
    return kept


def distinct_rows(membership: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the indices (d,) of the first of every kind of row of a Boolean matrix (n, e), and each row's kind (n,).

    Kinds are numbered in an order that depends on the rows only. Rows are compared as machine words, which is far
    quicker than `numpy.unique` on many columns.
    """
    n = len(membership)
    if n == 0:
        return np.zeros(0, dtype=int), np.zeros(0, dtype=int)
    words = _packed(membership)
    # stable, so that the first of equal rows comes first
    order = np.lexsort(words.T[::-1])
    new = np.concatenate([[True], (words[order[1:]] != words[order[:-1]]).any(axis=1)])
    kind = np.empty(n, dtype=int)
    kind[order] = np.cumsum(new) - 1
    return order[new], kind


def _packed(membership: np.ndarray) -> np.ndarray:
    """Return the rows of a Boolean matrix (n, e) as bits of machine words (n, w)."""
    n, n_columns = membership.shape
    packed = np.zeros((n, max(1, -(-n_columns // 64)) * 8), dtype=np.uint8)
    packed[:, : -(-n_columns // 8)] = np.packbits(membership, axis=1)
    return packed.view(np.uint64)


def check_membership(membership: np.ndarray) -> np.ndarray:
    """Return the membership as a Boolean matrix in which every entity is in some column.

    Raises
    ------
    CoverError
        If it is not a matrix or some entity is in no column.
    """
    membership = np.asarray(membership, dtype=bool)
    if membership.ndim != 2:
        raise CoverError(f"membership must have shape (columns, entities). Got {membership.shape}.")
    missing = np.flatnonzero(~membership.any(axis=0))
    if missing.size:
        raise CoverError(
            f"every entity must be in some column. Entities {missing.tolist()} are in none."
        )
    return membership


def _without_spare(
    membership: np.ndarray, chosen: Iterable[int], preference: np.ndarray
) -> np.ndarray:
    """Drop chosen columns that the others make superfluous (only a stopped solver leaves any)."""
    kept = sorted(int(c) for c in chosen)
    for column in sorted(kept, key=lambda c: preference[c]):
        rest = [c for c in kept if c != column]
        if membership[rest].any(axis=0).all():
            kept = rest
    return np.array(kept, dtype=int)


def _bound_on_count(dual_bound: float | None, n_entities: int) -> int:
    """Turn the solver's bound on the cost (count plus less than one half) into one on the count."""
    if dual_bound is None or not np.isfinite(dual_bound):
        return 1
    worst_preference = _PREFERENCE * n_entities / (n_entities + 1)
    return max(1, int(np.ceil(dual_bound - worst_preference - 1e-9)))
