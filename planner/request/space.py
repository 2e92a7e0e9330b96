"""Where entities are observable from, as far as a request asks for it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

if TYPE_CHECKING:
    from aspectgraph import CellSet, Solid


class Space(Protocol):
    """Where entities are observable from: `VisibilityRegions` or `EntityAspectGraph` of the package `aspectgraph`.

    Attributes
    ----------
    solid : Solid
        The part.
    workspace : array (2, 3)
        Lowest and highest corner of where the camera may be, mm.
    entities : mapping of str to Entity
        The entities by name, in order; ``entity_names`` are their names.
    """

    @property
    def solid(self) -> Solid:
        """The part."""

    @property
    def workspace(self) -> np.ndarray:
        """Corners of the box the camera may be in, (2, 3), mm."""

    @property
    def entities(self) -> Mapping[str, Any]:
        """The entities by name."""

    @property
    def entity_names(self) -> tuple[str, ...]:
        """Names of the entities, in order."""

    def observable(self, points: np.ndarray, names: Sequence[str] | None = None) -> np.ndarray:
        """Return which entities are observable from which viewpoints (n, 3); (n, k) bool."""

    def covering_cells(self, names: Sequence[str]) -> CellSet:
        """Return from where all named entities are observable, as convex cells."""


def observable_where(
    space: Space, points: np.ndarray, names: Sequence[str], wanted: np.ndarray
) -> np.ndarray:
    """Return which of the wanted pairs of viewpoints (n, 3) and entities hold; (n, k), False where it is not asked."""
    if hasattr(space, "observable_where"):
        return np.asarray(space.observable_where(points, names, wanted))
    result = np.zeros(wanted.shape, dtype=bool)
    for column in np.flatnonzero(wanted.any(axis=0)).tolist():
        rows = np.flatnonzero(wanted[:, column])
        result[rows, column] = space.observable(points[rows], [names[column]])[:, 0]
    return result


def cells_of(space: Space, names: Sequence[str]) -> CellSet:
    """Return the covering cells of entities (`CellSet`) without leaving them in the space's memory.

    A space remembers cells it was asked for. For a hundred entities those would be gigabytes, and no request here comes
    twice.
    """
    return (space.subset(names) if hasattr(space, "subset") else space).covering_cells(names)
