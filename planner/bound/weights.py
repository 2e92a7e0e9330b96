"""Weights of entities for the linear bound, and what no pose may weigh.

The weights are the mean of several optimal duals of the cover by these columns: a single one rests on few entities, so
that a box either holds one more of them or does not, where with the mean every bit that it is smaller tells.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog
from scipy.sparse import csr_matrix

from planner.cover.relaxation import mean_dual
from planner.cover.set_cover import maximal_columns
from planner.effort.effort import NORMAL, Effort

# for rounding sums of weights
SLACK = 1e-6


def spread_weights(columns: NDArray[np.bool_], effort: Effort = NORMAL) -> NDArray[np.float64]:
    """Return weights (e,) of entities, the heaviest of the columns (c, e) weighing 1; small ones are made 0."""
    columns = columns[maximal_columns(columns)]
    weighing = effort.bound.weighing
    y = mean_dual(columns, weighing.bias, weighing.duals, effort.cover.relaxation)
    y[y < weighing.least] = 0.0
    return y / (columns @ y).max()


def limit_for(y: NDArray[np.float64], target: int, effort: Effort = NORMAL) -> float:
    """Return what no pose may weigh for weights y (e,) to prove so many settings, with some to spare."""
    weighing = effort.bound.weighing
    limit = float(y.sum()) / max(1, target - 1)
    spare = min(weighing.spare * limit, weighing.spare_of_room * abs(limit - 1.0))
    return limit - spare - SLACK


def relieved(
    y: NDArray[np.float64], sets: NDArray[np.bool_], limit: float, effort: Effort = NORMAL
) -> NDArray[np.float64]:
    """Return weights (e,) nowhere larger than y, such that none of the sets (s, e) weighs more than nearly a limit.

    Their sum is the largest there is.
    """
    excess = sets @ y - effort.bound.weighing.less * limit
    result = linprog(
        np.ones(len(y)),
        A_ub=csr_matrix(-sets[excess > 0.0].astype(float)),
        b_ub=-excess[excess > 0.0],
        bounds=np.stack([np.zeros(len(y)), y], axis=1),
    )
    return np.zeros_like(y) if result.x is None else np.clip(y - result.x, 0.0, y)
