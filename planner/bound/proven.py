"""What is proven of all targets of a cover, and what that says of some of them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from planner.bound.weights import SLACK


@dataclass(frozen=True, eq=False)
class ProvenBound:
    """How many settings some targets need at least.

    Attributes
    ----------
    n : int
        So many.
    proof : str
        What that rests on.
    of : array of bool (k,)
        The targets.
    weights : array (k,) or None
        Weights of targets of which no pose inspects more than 1 together, where the proof gives some.
    """

    n: int
    proof: str
    of: NDArray[np.bool_] = field(repr=False)
    weights: NDArray[np.float64] | None = field(default=None, repr=False)

    def for_some(self, kept: NDArray[np.bool_]) -> int:
        """Return how many settings are needed for some targets (k,) at least.

        A plan for these and one setting for each of the others is a plan for all, so the bound falls by the number of
        those that are not kept. Or it is the sum of the weights of those that are: what holds for all sets of targets
        that poses inspect holds without some of their members.
        """
        bounds = [self.n - int((self.of & ~kept).sum()), int(kept.any())]
        if self.weights is not None:
            bounds.append(math.ceil(math.fsum(self.weights[kept].tolist()) - SLACK))
        return min(self.n, max(bounds))


def of_all(weights: NDArray[np.float64], of: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return weights of some of the targets as weights of all, given which (k,) they are."""
    found = np.zeros(len(of))
    found[of] = weights
    return found
