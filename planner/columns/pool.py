"""The columns found so far: distinct sets of entities, each with the best pose found for it."""

from __future__ import annotations

from typing import Any

import numpy as np

from planner.cover.set_cover import maximal_columns


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

    def add(self, membership: np.ndarray, poses: np.ndarray, probability: np.ndarray) -> None:
        """Add columns (n, k) with their poses (n, 4, 4) and probabilities (n, k); keep the maximal ones.

        Of poses for the same set the one with the largest mean probability stays.
        """
        some = membership.any(axis=1)
        membership = membership[some]
        poses = poses[some]
        probability = probability[some]
        quality = np.where(membership, probability, 0.0).sum(axis=1) / np.maximum(
            membership.sum(axis=1), 1
        )
        membership = np.concatenate([self.membership, membership])
        poses = np.concatenate([self.poses, poses])
        quality = np.concatenate([self.quality, quality])
        best_first = np.argsort(-quality, kind="stable")
        kept = best_first[maximal_columns(membership[best_first])]
        self.membership = membership[kept]
        self.poses = poses[kept]
        self.quality = quality[kept]

    def best_containing(self, column: np.ndarray) -> int | None:
        """Return the index of the best pose whose set contains a column (k,), or None."""
        containing = np.flatnonzero(self.membership[:, column].all(axis=1))
        return int(containing[np.argmax(self.quality[containing])]) if containing.size else None
