"""Where targets are observable from: where all entities of any of their witnesses are."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from planner.request.space import observable_where

if TYPE_CHECKING:
    from aspectgraph import CellSet, Solid
    from planner.request.space import Space
    from planner.wanted.targets import Target


class Seen(NamedTuple):
    """What must be seen of a target.

    Attributes
    ----------
    witnesses : sequence of sequence of str
        Names of entities; those of any witness suffice, together.
    endpoints : array (2, 3)
        Two points that are seen wherever the first witness is inspected, as an edge's ends are; mm.
    """

    witnesses: Sequence[Sequence[str]]
    endpoints: NDArray[np.float64]

    def is_entity(self, name: str) -> bool:
        """Return whether this is one entity, of this name."""
        return len(self.witnesses) == 1 and tuple(self.witnesses[0]) == (name,)


class TargetSpace:
    """The regions of targets, made of the regions of their entities.

    Parameters
    ----------
    space : VisibilityRegions or EntityAspectGraph
        Where the entities are observable from.
    entities : mapping of str to Seen
        What must be seen of each target, by its name.
    """

    def __init__(self, space: Space, entities: Mapping[str, Seen]):
        self.space = space
        self.entities = dict(entities)

    @classmethod
    def of(cls, space: Space, targets: Iterable[Target]) -> TargetSpace:
        """Return where targets are observable from that were resolved on the part."""
        return cls(
            space,
            {
                target.name: Seen(
                    [witness.entities for witness in target.witnesses],
                    target.witnesses[0].ends,
                )
                for target in targets
            },
        )

    @property
    def solid(self) -> Solid:
        """The part."""
        return self.space.solid

    @property
    def workspace(self) -> NDArray[np.float64]:
        """Lowest and highest corner of where the camera may be, mm; (2, 3)."""
        return self.space.workspace

    @property
    def entity_names(self) -> tuple[str, ...]:
        """Names of the targets, in order."""
        return tuple(self.entities)

    def observable(
        self, points: NDArray[np.float64], names: Sequence[str] | None = None
    ) -> NDArray[np.bool_]:
        """Return which targets are observable from which viewpoints (n, 3); (n, k) bool."""
        names = self.entity_names if names is None else names
        wanted = self.entities_of(names)
        column = {name: i for i, name in enumerate(wanted)}
        seen = self.space.observable(points, wanted)
        if all(self.entities[name].is_entity(name) for name in names):
            return seen
        result = np.zeros((len(seen), len(names)), dtype=bool)
        for k, name in enumerate(names):
            for witness in self.entities[name].witnesses:
                result[:, k] |= seen[:, [column[entity] for entity in witness]].all(axis=1)
        return result

    def observable_where(
        self, points: NDArray[np.float64], names: Sequence[str], wanted: NDArray[np.bool_]
    ) -> NDArray[np.bool_]:
        """Return which wanted pairs of viewpoints (n, 3) and targets hold; (n, k), False where it is not asked."""
        entities = self.entities_of(names)
        if all(self.entities[name].is_entity(name) for name in names):
            return observable_where(self.space, points, entities, wanted)
        column = {name: i for i, name in enumerate(entities)}
        asked = np.zeros((len(wanted), len(entities)), dtype=bool)
        for k, name in enumerate(names):
            for entity in self.entities_of([name]):
                asked[:, column[entity]] |= wanted[:, k]
        seen = observable_where(self.space, points, entities, asked)
        result = np.zeros_like(wanted)
        for k, name in enumerate(names):
            for witness in self.entities[name].witnesses:
                result[:, k] |= seen[:, [column[entity] for entity in witness]].all(axis=1)
        return result & wanted

    def covering_cells(self, names: Sequence[str]) -> CellSet:
        """Return from where all named targets are observable, as convex cells; each has one witness."""
        for name in names:
            (_,) = self.entities[name].witnesses
        return self.space.covering_cells(self.entities_of(names))

    def entities_of(self, names: Sequence[str]) -> list[str]:
        """Return the entities of targets, each once, in order."""
        return list(
            dict.fromkeys(
                entity
                for name in names
                for witness in self.entities[name].witnesses
                for entity in witness
            )
        )

    def choosing(self, chosen: Mapping[str, int]) -> TargetSpace:
        """Return the space in which some targets are observable by one of their witnesses only, given by number."""
        return TargetSpace(
            self.space,
            {
                name: seen._replace(witnesses=[seen.witnesses[chosen[name]]])
                if name in chosen
                else seen
                for name, seen in self.entities.items()
            },
        )

    def subset(self, names: Sequence[str]) -> TargetSpace:
        """Return the space of some targets only; it remembers no cells of the whole."""
        entities = self.entities_of(names)
        space = self.space.subset(entities) if hasattr(self.space, "subset") else self.space
        return TargetSpace(space, {name: self.entities[name] for name in names})


def entity_space(space: Space) -> Space:
    """Return the space of entities below a space of targets; a space of entities is itself."""
    return space.space if isinstance(space, TargetSpace) else space
