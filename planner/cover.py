"""Few columns that contain every entity: exactly with a proof, by exchange without one, and the linear relaxation."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.optimize import LinearConstraint, linprog, milp
from scipy.sparse import csr_matrix

from ground.decorators import entry_kernel
from ground.short_repr import short_repr
from planner.argument_kinds import suggests_names
from planner.exceptions import CoverError
from planner.executors import THREADS

# Minimum set cover with a proof of optimality, and the checker that does not trust it.
#
# Notation: a *column* is a set of entities that one sensor setting can inspect; ``membership[c,
# e]`` is True where column c contains entity e. A cover is a set of columns that together contain
# every entity.


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

    __repr__ = short_repr

    @property
    def optimal(self) -> bool:
        """Whether the cover is proven minimal."""
        return len(self.chosen) == self.lower_bound


@suggests_names
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
    maximal = np.zeros(n, dtype=np.bool_)
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
            maximal[i] = True
            kept_idx[n_kept] = i
            n_kept += 1
    return maximal


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
    needed = sorted(int(c) for c in chosen)
    for column in sorted(needed, key=lambda c: preference[c]):
        others = [c for c in needed if c != column]
        if membership[others].any(axis=0).all():
            needed = others
    return np.array(needed, dtype=int)


def _bound_on_count(dual_bound: float | None, n_entities: int) -> int:
    """Turn the solver's bound on the cost (count plus less than one half) into one on the count."""
    if dual_bound is None or not np.isfinite(dual_bound):
        return 1
    worst_preference = _PREFERENCE * n_entities / (n_entities + 1)
    return max(1, int(np.ceil(dual_bound - worst_preference - 1e-9)))


# Choosing few columns, and the sets of entities that would make them fewer if some pose inspected
# them.
#
# Sets that a pose nearly inspects are optimistic columns. Those that were tried in vain are
# refuted, with all that contains them. Which ones are worth a try is told in two ways: what a
# single other column would have to contain to make a cover of realised ones, by exchange; and a
# cover by realised and optimistic columns, by integer programming.


# bias and number of the duals that exclude columns. Their mean is nearer to the middle of all
# optimal duals than a single one.
_FIXING_BIAS = 1.05
_FIXING_DUALS = 4
# a column stays if its reduced cost is at most this
_CORE_SLACK = 0.1
# of an entity in none of these columns, this many of the heaviest columns stay
_CORE_OF_ENTITY = 5
# columns in the first linear program, and violated columns added at a time. Few are ever needed.
_FIRST_COLUMNS = 300
_MORE_COLUMNS = 100
# a smaller violation of a dual constraint is rounding
_BROKEN = 1e-9
# groups of duals solved in parallel. Each dual starts with the columns of the one before in its
# group, so the result depends on this number and not on the machine.
_SHARES = 2
# the solver stops when better poses can gain at most this share in the cover
_QUALITY_SLACK = 0.3
# steps of the exchange search for a cover of one column less
_EXCHANGES = 1000
# sets tried before the next exchange, because each realised set changes the value of the others
_AT_ONCE = 4

# The linear relaxation of the set cover and its dual: weights of entities, no column weighing
# more than 1.
#
# Few columns bind, so the linear programs are solved by constraint generation: with some columns
# at first, then with the heaviest of those that the weights break, too, until they break none.


def fractional_cover(
    membership: np.ndarray,
    bias: np.ndarray | None = None,
    guess: np.ndarray | None = None,
) -> tuple[float, np.ndarray]:
    """Solve the linear relaxation and its dual.

    Parameters
    ----------
    membership : array_like of bool, shape (c, e)
    bias : array_like, shape (e,), optional
        Positive factors; the dual maximises the weights times these. Default: all 1, which gives the relaxation's
        value.
    guess : array_like, shape (e,), optional
        Weights of a similar problem; they make it quicker.

    Returns
    -------
    value : float
        Sum of the weights; no cover has fewer than ``ceil(value)`` columns.
    weights : ndarray, shape (e,)
        The dual: non-negative weights of the entities, no column weighing more than 1.

    Raises
    ------
    CoverError
        If some entity is in no column.
    """
    membership = check_membership(membership)
    n_entities = membership.shape[1]
    if n_entities == 0:
        return 0.0, np.zeros(0)
    bias = np.ones(n_entities) if bias is None else np.asarray(bias, dtype=float)
    active = _first_columns(membership, guess)
    weights = _dual(membership, bias, active)
    weights /= max(1.0, float((membership @ weights).max()))
    return float(weights.sum()), weights


def mean_dual(membership: np.ndarray, bias: float, n: int) -> np.ndarray:
    """Return the mean (e,) of several duals of the fractional cover, no column weighing more than 1.

    A single one often rests on few entities, and gives nearly every column the same weight.

    Parameters
    ----------
    membership : array_like of bool, shape (c, e)
    bias : float
        Every dual maximises the weights times random factors from 1 to this; with 1, their sum.
    n : int
        Number of duals.

    Raises
    ------
    CoverError
        If some entity is in no column.
    """
    membership = check_membership(membership)
    if membership.shape[1] == 0:
        return np.zeros(0)
    factors = 1.0 + (bias - 1.0) * np.random.default_rng(0).random((n, membership.shape[1]))
    with ThreadPoolExecutor(THREADS) as pool:
        # in a fixed number of shares, so that the result does not depend on the machine
        weights = pool.map(
            lambda k: _duals(membership, factors[k::_SHARES]),
            range(min(n, _SHARES)),
        )
        weights = np.mean(np.concatenate(list(weights)), axis=0)
    return weights / max(1.0, float((membership @ weights).max(initial=0.0)))


def columns_of_covers(membership: np.ndarray, size: int) -> np.ndarray:
    """Return the columns that a cover of at most so many may use (reduced-cost fixing).

    With weights y that give no column more than 1, a cover with a column of weight 1 - r has at least sum(y) + r.

    Parameters
    ----------
    membership : array_like of bool, shape (c, e)
    size : int

    Returns
    -------
    ndarray of int, ascending
        None if there is no such cover.

    Raises
    ------
    CoverError
        If some entity is in no column.
    """
    weights = _fixing_dual(membership)
    return np.flatnonzero(membership @ weights >= 1.0 - (size - float(weights.sum())) - 1e-6)


def core_columns(membership: np.ndarray) -> np.ndarray:
    """Return the columns worth looking at for a small cover; they contain every entity.

    Those of least reduced cost (the core problem of large set covers; Caprara, Fischetti & Toth 1999). Integer
    programming is much quicker on them. That the smallest cover is among them is likely, not proven.

    Parameters
    ----------
    membership : array_like of bool, shape (c, e)

    Returns
    -------
    ndarray of int, ascending

    Raises
    ------
    CoverError
        If some entity is in no column.
    """
    membership = check_membership(membership)
    weight = membership @ _fixing_dual(membership)
    core = weight >= 1.0 - _CORE_SLACK
    # of an entity in none of them, the heaviest columns there are
    for entity in np.flatnonzero(~membership[core].any(axis=0)):
        holders = np.flatnonzero(membership[:, entity])
        core[holders[np.argsort(-weight[holders], kind="stable")[:_CORE_OF_ENTITY]]] = True
    return np.flatnonzero(core)


def _fixing_dual(membership: np.ndarray) -> np.ndarray:
    """Return the weights (e,) that columns are left out by."""
    return mean_dual(membership, _FIXING_BIAS, _FIXING_DUALS)


def _duals(membership: np.ndarray, factors: np.ndarray) -> np.ndarray:
    """Solve the dual for each row (f, e) of factors; the columns of one are those that the next one starts with."""
    active = _first_columns(membership)
    return np.array([_dual(membership, factor, active) for factor in factors])


def _first_columns(membership: np.ndarray, guess: np.ndarray | None = None) -> np.ndarray:
    """Return which columns (c,) to start with: the heaviest by a guess or the largest, and one for every entity."""
    active = np.zeros(len(membership), dtype=bool)
    heavy = membership.sum(axis=1) if guess is None else membership @ np.asarray(guess, dtype=float)
    active[np.argsort(-heavy, kind="stable")[:_FIRST_COLUMNS]] = True
    active[np.argmax(membership, axis=0)] = True
    return active


def _dual(membership: np.ndarray, bias: np.ndarray, active: np.ndarray) -> np.ndarray:
    """Return the dual (e,); ``active`` (c,) is changed to the columns it was solved with."""
    while True:
        result = linprog(
            -bias,
            A_ub=csr_matrix(membership[active].astype(float)),
            b_ub=np.ones(int(active.sum())),
            bounds=(0.0, 1.0),
        )
        weights = np.clip(result.x, 0.0, None)
        weight = membership @ weights
        broken = np.flatnonzero((weight > 1.0 + _BROKEN) & ~active)
        if not broken.size:
            return weights
        active[broken[np.argsort(-weight[broken], kind="stable")[:_MORE_COLUMNS]]] = True


# Covers by exchange: a local search with weights, for pools too large for integer programming. It
# proves nothing.
#
# A state is a given number of columns. Every step exchanges one of them for one that contains a
# missing entity, such that the weight of what is missing is the least, and then adds to the
# weights of what is missing still (row weighting; Gao, Weise & Li 2015,
# https://doi.org/10.1016/j.ejor.2015.05.038). A state that misses little tells, too, what a
# single column would have to contain to make it a cover.


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
    missing_sets : array of bool (w, e)
        Distinct sets. Each contains one entity that a state with so few missing misses, and what one of its columns
        alone contains: a column that contains the set could take that one's place, and one entity fewer were missing.
    """

    chosen: np.ndarray
    missing: int
    missing_sets: np.ndarray


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
    wishes: list[np.ndarray] = []
    for step in range(steps + 1):
        count = membership[chosen].sum(axis=0)
        missing = np.flatnonzero(count == 0)
        alone = membership[chosen] & (count == 1)
        if len(missing) < best.missing:
            best = best._replace(chosen=chosen.copy(), missing=len(missing))
            wishes = []
        if not missing.size or step == steps:
            break
        if len(missing) == best.missing:
            wishes.append(_one_more(alone, missing))
        weights[missing] += 1.0
        comes = np.flatnonzero(membership[:, rng.choice(missing)])
        comes = _free(comes, free_from[comes], step)
        leaves = _free(np.arange(len(chosen)), free_from[chosen], step)
        i, k = _least(alone[leaves], count == 0, contains[comes], weights, rng)
        free_from[chosen[leaves[i]]] = step + rng.integers(2, _LEFT)
        free_from[comes[k]] = step + rng.integers(1, _CAME)
        chosen[leaves[i]] = comes[k]
    if wishes:
        sets = np.concatenate(wishes)
        best = best._replace(missing_sets=sets[np.sort(distinct_rows(sets)[0])])
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
    uncovered = to_cover.sum(axis=1)[:, None] - to_cover @ contains.T
    lightest = np.argwhere(uncovered <= uncovered.min() + 0.5)
    return tuple(lightest[rng.integers(len(lightest))])


def few_columns(
    membership: np.ndarray,
    nodes: int,
    rng: np.random.Generator,
    quality: np.ndarray | None = None,
) -> np.ndarray:
    """Choose few columns that cover every entity; the work is limited by counting: the choice is repeatable.

    Parameters
    ----------
    membership : array of bool (c, e)
    nodes : int
        Nodes of the integer programming solver's tree, at most.
    rng : numpy.random.Generator
    quality : array (c,), optional
        In [0, 1]; larger is better among covers of equal size.

    Returns
    -------
    array of int
        Column indices.
    """
    core = core_columns(membership)
    chosen = _cover(membership, core, nodes, quality)
    fewest = bound_columns(membership)
    while len(chosen) > fewest:
        exchange = exchange_columns(membership, len(chosen) - 1, steps=_EXCHANGES, rng=rng)
        if exchange.missing:
            break
        again = _cover(membership, np.union1d(core, exchange.chosen), nodes, quality)
        chosen = again if len(again) <= len(exchange.chosen) else np.sort(exchange.chosen)
    return chosen


def sets_to_realise(
    realised: np.ndarray,
    near: np.ndarray,
    refuted: np.ndarray,
    enough: int,
    nodes: int,
    rng: np.random.Generator,
) -> list[np.ndarray]:
    """Choose sets of entities of which poses would make a cover of fewer columns than are enough, or nearly so.

    Parameters
    ----------
    realised, near, refuted : array of bool (c, e)
        Columns of poses known, columns that poses nearly inspect, and sets tried in vain.
    enough : int
        Columns of a cover known.
    nodes : int
        Nodes of the integer programming solver's tree, at most.
    rng : numpy.random.Generator

    Returns
    -------
    list of array of bool (e,)
        None if there is no hope.
    """
    near = near[~_contain(near, refuted)]
    missing = 0
    while missing == 0:
        if enough == 1:
            return []
        chosen, missing, sets = exchange_columns(realised, enough - 1, steps=_EXCHANGES, rng=rng)
        enough = enough if missing else len(chosen)
    sets = sets[~_contain(sets, refuted)]
    sets = sets[_contained(sets, near)]
    if len(sets):
        return list(sets[np.argsort(sets.sum(axis=1), kind="stable")[:_AT_ONCE]])
    return _of_cover(realised, near, enough, nodes)


def _of_cover(realised: np.ndarray, near: np.ndarray, enough: int, nodes: int) -> list[np.ndarray]:
    """Choose a cover with optimistic columns; return what these are to inspect if it is small enough."""
    both = np.concatenate([realised, near])
    usable = columns_of_covers(both, enough - 1)
    if not both[usable].any(axis=0).all():
        return []
    # of small covers one with many realised columns: the fewer are left to realise, the better the chances
    core = np.union1d(
        usable[core_columns(both[usable])],
        core_columns(realised),
    )
    chosen = _cover(both, core, nodes, np.arange(len(both)) < len(realised))
    if len(chosen) >= enough:
        return []
    uncovered = ~both[chosen[chosen < len(realised)]].any(axis=0)
    sets = []
    for column in both[chosen[chosen >= len(realised)]]:
        sets.append(column & uncovered)
        uncovered &= ~column
    return [column for column in sets if column.any()]


def _contain(columns: np.ndarray, sets: np.ndarray) -> np.ndarray:
    """Tell which columns (c, e) contain any of some sets (s, e)."""
    # products of numbers are much quicker than comparisons
    return (~columns @ sets.T.astype(float) == 0).any(axis=1)


def _contained(sets: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Tell which sets (s, e) any of some columns (c, e) contains."""
    return (sets @ (~columns).T.astype(float) == 0).any(axis=1)


def _cover(
    membership: np.ndarray,
    core: np.ndarray,
    nodes: int,
    quality: np.ndarray | None,
) -> np.ndarray:
    """Choose few of the core columns by integer programming."""
    quality = None if quality is None else quality[core]
    cover = min_cover(
        membership[core], quality, time_limit_s=np.inf, node_limit=nodes, slack=_QUALITY_SLACK
    )
    return core[list(cover.chosen)]
