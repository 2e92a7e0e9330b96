"""The linear relaxation of the set cover and its dual: weights of entities, no column weighing more than 1.

Few columns bind, so the linear programs are solved by constraint generation: with some columns at first, then with the
heaviest of those that the weights break, too, until they break none.
"""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
from scipy.optimize import linprog
from scipy.sparse import csr_matrix

from planner.cover.set_cover import check_membership
from planner.effort.cover import Relaxation
from planner.effort.effort import NORMAL
from planner.executors import THREADS


def fractional_cover(
    membership: np.ndarray,
    bias: np.ndarray | None = None,
    guess: np.ndarray | None = None,
    relaxation: Relaxation = NORMAL.cover.relaxation,
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
    relaxation : Relaxation
        How it is solved.

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
    active = _first_columns(membership, relaxation, guess)
    weights = _dual(membership, bias, active, relaxation)
    weights /= max(1.0, float((membership @ weights).max()))
    return float(weights.sum()), weights


def mean_dual(
    membership: np.ndarray, bias: float, n: int, relaxation: Relaxation = NORMAL.cover.relaxation
) -> np.ndarray:
    """Return the mean (e,) of several duals of the fractional cover, no column weighing more than 1.

    A single one often rests on few entities, and gives nearly every column the same weight.

    Parameters
    ----------
    membership : array_like of bool, shape (c, e)
    bias : float
        Every dual maximises the weights times random factors from 1 to this; with 1, their sum.
    n : int
        Number of duals.
    relaxation : Relaxation
        How each is solved.

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
            lambda k: _duals(membership, factors[k :: relaxation.shares], relaxation),
            range(min(n, relaxation.shares)),
        )
        weights = np.mean(np.concatenate(list(weights)), axis=0)
    return weights / max(1.0, float((membership @ weights).max(initial=0.0)))


def columns_of_covers(
    membership: np.ndarray, size: int, relaxation: Relaxation = NORMAL.cover.relaxation
) -> np.ndarray:
    """Return the columns that a cover of at most so many may use (reduced-cost fixing).

    With weights y that give no column more than 1, a cover with a column of weight 1 - r has at least sum(y) + r.

    Parameters
    ----------
    membership : array_like of bool, shape (c, e)
    size : int
    relaxation : Relaxation
        By how many duals columns are left out.

    Returns
    -------
    ndarray of int, ascending
        None if there is no such cover.

    Raises
    ------
    CoverError
        If some entity is in no column.
    """
    weights = _fixing_dual(membership, relaxation)
    return np.flatnonzero(membership @ weights >= 1.0 - (size - float(weights.sum())) - 1e-6)


def core_columns(
    membership: np.ndarray, relaxation: Relaxation = NORMAL.cover.relaxation
) -> np.ndarray:
    """Return the columns worth looking at for a small cover; they contain every entity.

    Those of least reduced cost (the core problem of large set covers; Caprara, Fischetti & Toth 1999). Integer
    programming is much quicker on them. That the smallest cover is among them is likely, not proven.

    Parameters
    ----------
    membership : array_like of bool, shape (c, e)
    relaxation : Relaxation
        How many columns are worth looking at.

    Returns
    -------
    ndarray of int, ascending

    Raises
    ------
    CoverError
        If some entity is in no column.
    """
    membership = check_membership(membership)
    weight = membership @ _fixing_dual(membership, relaxation)
    kept = weight >= 1.0 - relaxation.core_slack
    # of an entity in none of them, the heaviest columns there are
    for entity in np.flatnonzero(~membership[kept].any(axis=0)):
        own = np.flatnonzero(membership[:, entity])
        kept[own[np.argsort(-weight[own], kind="stable")[: relaxation.core_of_entity]]] = True
    return np.flatnonzero(kept)


def _fixing_dual(membership: np.ndarray, relaxation: Relaxation) -> np.ndarray:
    """Return the weights (e,) that columns are left out by."""
    return mean_dual(membership, relaxation.fixing_bias, relaxation.fixing_duals, relaxation)


def _duals(membership: np.ndarray, factors: np.ndarray, relaxation: Relaxation) -> np.ndarray:
    """Solve the dual for each row (f, e) of factors; the columns of one are those that the next one starts with."""
    active = _first_columns(membership, relaxation)
    return np.array([_dual(membership, factor, active, relaxation) for factor in factors])


def _first_columns(
    membership: np.ndarray, relaxation: Relaxation, guess: np.ndarray | None = None
) -> np.ndarray:
    """Return which columns (c,) to start with: the heaviest by a guess or the largest, and one for every entity."""
    active = np.zeros(len(membership), dtype=bool)
    heavy = membership.sum(axis=1) if guess is None else membership @ np.asarray(guess, dtype=float)
    active[np.argsort(-heavy, kind="stable")[: relaxation.first_columns]] = True
    active[np.argmax(membership, axis=0)] = True
    return active


def _dual(
    membership: np.ndarray, bias: np.ndarray, active: np.ndarray, relaxation: Relaxation
) -> np.ndarray:
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
        broken = np.flatnonzero((weight > 1.0 + relaxation.broken) & ~active)
        if not broken.size:
            return weights
        active[broken[np.argsort(-weight[broken], kind="stable")[: relaxation.more_columns]]] = True
