"""The columns found so far: distinct sets of entities, each with the best pose found for it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from planner.cover.set_cover import maximal_columns

Steady = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""``steady(poses, membership)``: what of columns (n, k) still holds where their poses (n, 4, 4) are displaced."""


class ColumnPool:
    """Distinct sets of entities, each with the best pose found for it.

    **Guarantee.** The pool depends on what was added in which order, on nothing else.
    """

    def __init__(self, n_entities: int):
        self.membership = np.zeros((0, n_entities), dtype=bool)
        self.poses = np.zeros((0, 4, 4))
        self.quality = np.zeros(0)

    def __len__(self) -> int:
        return len(self.membership)

    @property
    def inspected(self) -> np.ndarray:
        """Which entities (k,) are in some column."""
        return np.asarray(self.membership.any(axis=0))

    def to_dict(self) -> dict[str, Any]:
        """Return the arrays, for `from_dict`; they are not changed when something is added."""
        return {"membership": self.membership, "poses": self.poses, "quality": self.quality}

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> ColumnPool:
        """Build from the result of `to_dict`."""
        pool = cls(data["membership"].shape[1])
        pool.membership = data["membership"]
        pool.poses = data["poses"]
        pool.quality = data["quality"]
        return pool

    def add(
        self,
        membership: np.ndarray,
        poses: np.ndarray,
        probability: np.ndarray,
        steady: Steady | None = None,
    ) -> None:
        """Add columns (n, k) with their poses (n, 4, 4) and probabilities (n, k); keep the maximal ones.

        Of poses for the same set the one with the largest mean probability stays. ``steady(poses, membership)`` says
        what of columns can be kept; only those that would stay are asked for.
        """
        if steady is not None:
            membership = self._steady(membership, poses, probability, steady)
        some = membership.any(axis=1)
        membership = membership[some]
        poses = poses[some]
        probability = probability[some]
        quality = _mean_probability(membership, probability)
        kept = self._maximal(membership, quality)
        membership = np.concatenate([self.membership, membership])
        poses = np.concatenate([self.poses, poses])
        quality = np.concatenate([self.quality, quality])
        self.membership = membership[kept]
        self.poses = poses[kept]
        self.quality = quality[kept]

    def _maximal(self, membership: np.ndarray, quality: np.ndarray) -> np.ndarray:
        """Return the indices of the columns that stay, of those that are here and then of new ones."""
        both = np.concatenate([self.membership, membership])
        best_first = np.argsort(-np.concatenate([self.quality, quality]), kind="stable")
        return np.asarray(best_first[maximal_columns(both[best_first])])

    def _steady(
        self, membership: np.ndarray, poses: np.ndarray, probability: np.ndarray, steady: Steady
    ) -> np.ndarray:
        """Return new columns without what cannot be kept of them; those that would not stay are empty.

        A column that becomes smaller may no longer contain others, so these are asked for next.
        """
        membership = membership.copy()
        left = np.asarray(membership.any(axis=1))
        while True:
            stays = np.zeros(len(membership), dtype=bool)
            kept = self._maximal(membership, _mean_probability(membership, probability))
            stays[kept[kept >= len(self)] - len(self)] = True
            asked = np.flatnonzero(stays & left)
            if not asked.size:
                membership[left] = False
                return membership
            membership[asked] = steady(poses[asked], membership[asked])
            left[asked] = False

    def best_containing(self, column: np.ndarray) -> int | None:
        """Return the index of the best pose whose set contains a column (k,), or None."""
        containing = np.flatnonzero(self.membership[:, column].all(axis=1))
        return int(containing[np.argmax(self.quality[containing])]) if containing.size else None


def _mean_probability(membership: np.ndarray, probability: np.ndarray) -> np.ndarray:
    """Return the mean probability (n,) of what columns (n, k) contain; 0 of an empty one."""
    n_members = np.maximum(membership.sum(axis=1), 1)
    return np.asarray(np.where(membership, probability, 0.0).sum(axis=1) / n_members)
