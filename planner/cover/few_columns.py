"""Choosing few columns, and the sets of entities that would make them fewer if some pose inspected them.

Sets that a pose nearly inspects are optimistic columns. Those that were tried in vain are refuted, with all that
contains them. Which ones are worth a try is told in two ways: what a single other column would have to contain to make
a cover of realised ones, by exchange; and a cover by realised and optimistic columns, by integer programming.
"""

from __future__ import annotations

import numpy as np

from planner.cover.exchange_search import exchange_columns
from planner.cover.relaxation import columns_of_covers, core_columns
from planner.cover.set_cover import bound_columns, min_cover
from planner.effort.cover import Covering
from planner.effort.effort import NORMAL


def few_columns(
    membership: np.ndarray,
    nodes: int,
    rng: np.random.Generator,
    quality: np.ndarray | None = None,
    covering: Covering = NORMAL.cover,
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
    covering : Covering
        How long few columns are looked for.

    Returns
    -------
    array of int
        Column indices.
    """
    core = core_columns(membership, covering.relaxation)
    chosen = _cover(membership, core, nodes, quality, covering)
    fewest = bound_columns(membership)
    while len(chosen) > fewest:
        found = exchange_columns(membership, len(chosen) - 1, steps=covering.exchanges, rng=rng)
        if found.missing:
            break
        again = _cover(membership, np.union1d(core, found.chosen), nodes, quality, covering)
        chosen = again if len(again) <= len(found.chosen) else np.sort(found.chosen)
    return chosen


def sets_to_realise(
    realised: np.ndarray,
    near: np.ndarray,
    refuted: np.ndarray,
    enough: int,
    nodes: int,
    rng: np.random.Generator,
    covering: Covering = NORMAL.cover,
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
    covering : Covering
        How long few columns are looked for.

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
        chosen, missing, wanted = exchange_columns(
            realised, enough - 1, steps=covering.exchanges, rng=rng
        )
        enough = enough if missing else len(chosen)
    wanted = wanted[~_contain(wanted, refuted)]
    wanted = wanted[_contained(wanted, near)]
    if len(wanted):
        return list(wanted[np.argsort(wanted.sum(axis=1), kind="stable")[: covering.at_once]])
    return _of_cover(realised, near, enough, nodes, covering)


def _of_cover(
    realised: np.ndarray, near: np.ndarray, enough: int, nodes: int, covering: Covering
) -> list[np.ndarray]:
    """Choose a cover with optimistic columns; return what these are to inspect if it is small enough."""
    both = np.concatenate([realised, near])
    usable = columns_of_covers(both, enough - 1, covering.relaxation)
    if not both[usable].any(axis=0).all():
        return []
    # of small covers one with many realised columns: the fewer are left to realise, the better the chances
    core = np.union1d(
        usable[core_columns(both[usable], covering.relaxation)],
        core_columns(realised, covering.relaxation),
    )
    chosen = _cover(both, core, nodes, np.arange(len(both)) < len(realised), covering)
    if len(chosen) >= enough:
        return []
    left = ~both[chosen[chosen < len(realised)]].any(axis=0)
    wanted = []
    for column in both[chosen[chosen >= len(realised)]]:
        wanted.append(column & left)
        left &= ~column
    return [column for column in wanted if column.any()]


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
    covering: Covering,
) -> np.ndarray:
    """Choose few of the core columns by integer programming."""
    quality = None if quality is None else quality[core]
    slack = covering.quality_slack
    cover = min_cover(membership[core], quality, time_limit_s=np.inf, node_limit=nodes, slack=slack)
    return core[list(cover.chosen)]
