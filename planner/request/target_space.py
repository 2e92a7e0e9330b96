"""Where what is to be inspected is observable from: of a dimension, where all of its entities are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from aspectgraph import CellSet, Solid
    from planner.request.space import Space


class Segment(NamedTuple):
    """Two points that are seen wherever a dimension is inspected, as an edge's ends are."""

    endpoints: NDArray[np.float64]


class TargetSpace:
    """The regions of dimensions, as intersections of the regions of their entities.

    Parameters
    ----------
    space : VisibilityRegions or EntityAspectGraph
        Where the entities are observable from.
    needs : mapping of str to sequence of str
        Names of the entities of each dimension.
    segments : mapping of str to array (2, 3)
        For each dimension two points of it, mm.
    """

    def __init__(
        self,
        space: Space,
        needs: Mapping[str, Sequence[str]],
        segments: Mapping[str, NDArray[np.float64]],
    ):
        self.space = space
        self.needs = {name: tuple(entities) for name, entities in needs.items()}
        self.segments = dict(segments)

    @property
    def solid(self) -> Solid:
        """The part."""
        return self.space.solid

    @property
    def workspace(self) -> NDArray[np.float64]:
        """Lowest and highest corner of where the camera may be, mm; (2, 3)."""
        return self.space.workspace

    @property
    def entities(self) -> Mapping[str, Segment]:
        """Two points of each dimension by its name."""
        return {name: Segment(ends) for name, ends in self.segments.items()}

    @property
    def entity_names(self) -> tuple[str, ...]:
        """Names of the dimensions, in order."""
        return tuple(self.needs)

    def observable(
        self, points: NDArray[np.float64], names: Sequence[str] | None = None
    ) -> NDArray[np.bool_]:
        """Return which dimensions have all their entities observable from which viewpoints (n, 3); (n, k) bool."""
        names = self.entity_names if names is None else names
        wanted = self.entities_of(names)
        column = {name: i for i, name in enumerate(wanted)}
        seen = self.space.observable(points, wanted)
        result = np.ones((len(seen), len(names)), dtype=bool)
        for k, name in enumerate(names):
            result[:, k] = seen[:, [column[entity] for entity in self.needs[name]]].all(axis=1)
        return result

    def covering_cells(self, names: Sequence[str]) -> CellSet:
        """Return from where all entities of all named dimensions are observable, as convex cells."""
        return self.space.covering_cells(self.entities_of(names))

    def entities_of(self, names: Sequence[str]) -> list[str]:
        """Return the entities of dimensions, each once, in order."""
        return list(dict.fromkeys(entity for name in names for entity in self.needs[name]))

    def subset(self, names: Sequence[str]) -> TargetSpace:
        """Return the space of some dimensions only; it remembers no cells of the whole."""
        entities = self.entities_of(names)
        space = self.space.subset(entities) if hasattr(self.space, "subset") else self.space
        return TargetSpace(
            space,
            {name: self.needs[name] for name in names},
            {name: self.segments[name] for name in names},
        )
