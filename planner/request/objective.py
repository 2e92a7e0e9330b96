"""The objective: how probable it is that every target is measured accurately from a pose."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from planner.argument_kinds import check_fraction
from planner.exceptions import RequestError
from planner.wanted.models import Means
from planner.wanted.targets import Target, edge_target


class Objective:
    """Success probabilities of poses, and the fitness made of them.

    Parameters
    ----------
    targets : sequence of Target
        What is measured (k targets).
    means : Means
        With what, and how accurately.
    kind : {"sum", "min"}
        Fitness: the sum of the probabilities (the paper), or the smallest.

    Raises
    ------
    RequestError
        If the accuracy or the kind breaks its rule.
    """

    def __init__(self, targets: Sequence[Target], means: Means, kind: str = "sum"):
        check_fraction("accuracy", means.accuracy)
        if kind not in ("sum", "min"):
            raise RequestError.of_rule("objective", "must be 'sum' or 'min'", repr(kind))
        self.n_targets = len(targets)
        self.means = means
        self.kind = kind
        # targets of one kind are evaluated together
        self._models = []
        for own in dict.fromkeys(type(target) for target in targets):
            columns = [i for i, target in enumerate(targets) if type(target) is own]
            self._models.append((columns, own.models([targets[i] for i in columns], means)))

    @classmethod
    def of_edges(cls, ends: np.ndarray, means: Means, kind: str = "sum") -> Objective:
        """Return the objective of edges whose ends (k, 2, 3) are given, mm."""
        return cls([edge_target(f"edge {i}", pair) for i, pair in enumerate(ends)], means, kind)

    def probability(self, cam2world: np.ndarray) -> np.ndarray:
        """Return P (n, k) of poses (n, 4, 4); 0 for a target not wholly in front of the camera."""
        wanted = np.ones((len(cam2world), self.n_targets), dtype=bool)
        return self.probability_where(cam2world, wanted).reshape(wanted.shape)

    def probability_where(self, cam2world: np.ndarray, wanted: np.ndarray) -> np.ndarray:
        """Return P of poses (n, 4, 4) for those targets that are wanted (n, k), one after the other, row by row."""
        result = np.zeros(wanted.shape)
        for columns, models in self._models:
            own = np.zeros_like(wanted)
            own[:, columns] = wanted[:, columns]
            if own.any():
                result[own] = models.probability_where(cam2world, own[:, columns])
        return result[wanted]

    @property
    def highest(self) -> float:
        """The fitness when every probability is 1."""
        return float(self.n_targets) if self.kind == "sum" else 1.0

    def fitness(self, cam2world: np.ndarray) -> np.ndarray:
        """Return the fitness (n,) of poses (n, 4, 4): eq 22, or the smallest probability."""
        probability = self.probability(cam2world)
        return probability.sum(axis=1) if self.kind == "sum" else probability.min(axis=1)
