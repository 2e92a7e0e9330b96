"""How far a long piece of work has got, and what its caller learns while it goes on."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np


class Checkpoint:
    """Entries by name that an interrupted piece of work goes on from; and two calls that a proof makes on the way.

    Parameters
    ----------
    improve : callable, optional
        ``improve(poses)`` gets poses (f, 4, 4) that a proof comes across. It returns the columns (c, e) that are known
        to be realisable from then on.
    kept : dict, optional
        The entries of earlier work for the same request.
    keep : callable, optional
        ``keep(entries)`` gets all entries after each change; see `planner.resume.PlanningState.keep` for what they may
        hold.
    on_bound : callable, optional
        ``on_bound(bound)`` gets every number of settings that is proven.
    """

    def __init__(
        self,
        improve: Callable[[np.ndarray], np.ndarray] | None = None,
        kept: dict[str, Any] | None = None,
        keep: Callable[[dict[str, Any]], None] | None = None,
        on_bound: Callable[[int], None] | None = None,
    ):
        self.improve = improve
        self._keep = keep
        self._on_bound = on_bound
        self._kept = kept or {}
        # an entry that is not replaced still holds
        self._entries = dict(self._kept)

    def get(self, name: str) -> Any:
        """Return the last entry of the earlier work under a name, or None."""
        return self._kept.get(name)

    def put(self, name: str, entry: Any) -> None:
        """Replace the entry under a name."""
        self._entries = {**self._entries, name: entry}
        if self._keep is not None:
            self._keep(self._entries)

    def on_bound(self, bound: int) -> None:
        """Pass on that at least this many settings are needed."""
        if self._on_bound is not None:
            self._on_bound(bound)
