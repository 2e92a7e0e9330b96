"""What a proof tells its caller while it goes on, and what it finds there of an earlier, interrupted one."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np


class Ledger:
    """Poses that a proof comes across go to the caller; so does how far it has got, to go on from there another time.

    Parameters
    ----------
    improve : callable, optional
        ``improve(poses)`` is told of poses (f, 4, 4) worth knowing; it returns the columns (c, e) known to be
        realisable from then on.
    kept : dict, optional
        What an earlier proof for the same request told last; this one goes on from there.
    keep : callable, optional
        ``keep(entries)`` is given all that was told so far; see `planner.resume.PlanningState.keep` for what it may
        hold.
    raised : callable, optional
        ``raised(bound)`` is told of every number of settings that is proven.
    """

    def __init__(
        self,
        improve: Callable[[np.ndarray], np.ndarray] | None = None,
        kept: dict[str, Any] | None = None,
        keep: Callable[[dict[str, Any]], None] | None = None,
        raised: Callable[[int], None] | None = None,
    ):
        self.improve = improve
        self._keep = keep
        self._raised = raised
        self._kept = kept or {}
        # what is not told anew still holds
        self._told = dict(self._kept)

    def __call__(self, name: str) -> Any:
        """Return what was told last under a name by the earlier proof, or None."""
        return self._kept.get(name)

    def tell(self, name: str, entry: Any) -> None:
        """Tell how far this proof has got, in place of what it told under the same name before."""
        self._told = {**self._told, name: entry}
        if self._keep is not None:
            self._keep(self._told)

    def proven(self, bound: int) -> None:
        """Tell that so many settings are needed at least."""
        if self._raised is not None:
            self._raised(bound)
