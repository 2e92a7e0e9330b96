"""From witnesses to targets in the proof: a target may be inspected where any of its witnesses may be.

The boxes of poses know witnesses only, each with its own region and its own points. A pose that inspects targets
inspects one witness of each. So nothing is lost if of the witnesses of one target only one is counted at a pose: here
they *exclude each other*, like entities of which no pose inspects two. The weight of a set of witnesses that is counted
so is at least that of the targets, and a necessary condition is used for a target only if every witness implies it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planner.request.request import Request


class WitnessSets:
    """Which target (k) each witness (w) belongs to.

    Parameters
    ----------
    owner : array of int (w,)
        The target of each witness, ascending; every target has one at least.
    """

    def __init__(self, owner: NDArray[np.int_]):
        self.owner = np.asarray(owner)
        self._first = np.flatnonzero(np.diff(self.owner, prepend=-1))
        self.trivial = len(self._first) == len(self.owner)

    @classmethod
    def of(cls, request: Request) -> WitnessSets:
        """Return the witnesses of a request."""
        return cls(request.owner)

    def of_columns(self, columns: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return columns (c, w) of witnesses for columns (c, k) of targets: all witnesses of what they hold."""
        return np.asarray(columns)[:, self.owner]

    def to_targets(self, sets: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return of which targets sets (n, w) hold a witness; (n, k)."""
        if self.trivial or not len(sets):
            return sets[:, self._first]
        return np.asarray(np.logical_or.reduceat(sets, self._first, axis=1))

    def one_each(self, conflict: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return pairs of witnesses (w, w) that exclude each other, with those of one target."""
        same = self.owner[:, None] == self.owner
        np.fill_diagonal(same, False)
        return np.asarray(conflict | same)

    def targets_apart(self, conflict: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return which targets (k, k) exclude each other: by every pair of their witnesses."""
        if self.trivial:
            return conflict
        rows = np.logical_and.reduceat(conflict, self._first, axis=0)
        apart = np.array(np.logical_and.reduceat(rows, self._first, axis=1))
        np.fill_diagonal(apart, False)
        return apart
