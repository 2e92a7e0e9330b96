"""Weights of entities for the linear bound, and what no pose may weigh.

The weights are the mean of several optimal duals of the cover by these columns: a single one rests on few entities, so
that a box either holds one more of them or does not, where with the mean every bit that it is smaller tells.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog
from scipy.sparse import csr_matrix

from planner.cover.relaxation import mean_dual
from planner.cover.set_cover import maximal_columns

# for rounding sums of weights
SLACK = 1e-6


@dataclass(frozen=True)
class Weighing:
    """How the weights are made, and how near to them the limit lies.

    Attributes
    ----------
    duals : int
        Optimal duals of the cover of which the weights are the mean: a single one rests on few entities.
    bias : float
        They are found by maximising the weights times factors from 1 to this.
    least : float
        Smaller weights are made 0: they would only lengthen the search.
    spare : float
        No pose may weigh more than this share less than would do, so that a few that do need no new weights.
    spare_of_room : float
        But that is at most this share of what the limit is above 1.
    less : float
        Weights keep away from the limit by this factor where poses were found to exceed it.
    """

    duals: int = 16
    bias: float = 1.5
    least: float = 1e-3
    spare: float = 0.01
    spare_of_room: float = 0.25
    less: float = 0.999


WEIGHING = Weighing()


def spread_weights(columns: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return weights (e,) of entities, the heaviest of the columns (c, e) weighing 1; small ones are made 0."""
    columns = columns[maximal_columns(columns)]
    y = mean_dual(columns, WEIGHING.bias, WEIGHING.duals)
    y[y < WEIGHING.least] = 0.0
    return y / (columns @ y).max()


def limit_for(y: NDArray[np.float64], target: int) -> float:
    """Return what no pose may weigh for weights y (e,) to prove so many settings, with some to spare."""
    limit = float(y.sum()) / max(1, target - 1)
    return limit - min(WEIGHING.spare * limit, WEIGHING.spare_of_room * abs(limit - 1.0)) - SLACK


def relieved(y: NDArray[np.float64], sets: NDArray[np.bool_], limit: float) -> NDArray[np.float64]:
    """Return weights (e,) nowhere larger than y, such that none of the sets (s, e) weighs more than nearly a limit.

    Their sum is the largest there is.
    """
    excess = sets @ y - WEIGHING.less * limit
    result = linprog(
        np.ones(len(y)),
        A_ub=csr_matrix(-sets[excess > 0.0].astype(float)),
        b_ub=-excess[excess > 0.0],
        bounds=np.stack([np.zeros(len(y)), y], axis=1),
    )
    return np.zeros_like(y) if result.x is None else np.clip(y - result.x, 0.0, y)
