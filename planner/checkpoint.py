"""How far a long piece of work has got, in entries by name."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any


class Checkpoint:
    """Entries by name that an interrupted piece of work goes on from.

    Parameters
    ----------
    kept : dict, optional
        The entries of earlier work for the same request.
    keep : callable, optional
        ``keep(entries)`` gets all entries after each change; see `planner.records.packing.packed` for what they may
        hold.
    """

    def __init__(
        self,
        kept: dict[str, Any] | None = None,
        keep: Callable[[dict[str, Any]], None] | None = None,
    ):
        self._keep = keep
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
