"""Targets as a request keeps them: which entities of the part, and which error is permitted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.wanted.dimension import Dimension
from planner.wanted.targets import DimensionTarget, Target

if TYPE_CHECKING:
    from aspectgraph import Entity, Solid

EDGE = "edge"


@dataclass(frozen=True)
class EntityRecord:
    """An entity of the part.

    Attributes
    ----------
    name : str
        Its name.
    kind : str
        "edge", "rim" or "arc".
    edges : tuple of int
        Ids of its edges in the part.
    part : str
        What it is a part of an edge, rim or arc, such as ``17[0:1/4]``; empty if it is a whole one.
    """

    name: str
    kind: str
    edges: tuple[int, ...]
    part: str = ""

    @classmethod
    def of(cls, name: str, entity: Any) -> EntityRecord:
        """Return the record of an entity of a space."""
        edges = tuple(int(edge) for edge in getattr(entity, "edge_ids", ()))
        part = getattr(entity, "part", None)
        return cls(name, getattr(entity, "kind", EDGE), edges, "" if part is None else str(part))

    def entity_of(self, solid: Solid) -> Entity:
        """Return the entity of the part under its name."""
        from aspectgraph import resolve_entities

        return resolve_entities(solid, {self.name: self._given(solid)})[self.name]

    def _given(self, solid: Solid) -> Any:
        from aspectgraph import Entity, parse_part

        if self.part:
            return parse_part(self.part)
        if self.kind != EDGE:
            curves = {curve.edge_ids: curve for curve in (*solid.rims(), *solid.arcs())}
            return curves[self.edges]
        if len(self.edges) == 1:
            return self.edges[0]
        first = solid.edge_points(self.edges[0])
        last = solid.edge_points(self.edges[-1])
        # of a chain of collinear edges the ends are farthest apart
        apart = np.linalg.norm(first[:, None] - last, axis=-1)
        begin, end = np.unravel_index(np.argmax(apart), apart.shape)
        return Entity(self.name, np.array([first[begin], last[end]]), self.edges)


@dataclass(frozen=True, eq=False)
class TargetRecord:
    """An edge or a dimension that is wanted.

    Attributes
    ----------
    name : str
        Its name.
    kind : str
        "edge", whose length is measured as in the paper, or the kind of dimension.
    ends : array (2, 3)
        Two points of it, mm.
    entities : tuple of EntityRecord
        What must be seen.
    permitted_error : float or None
        Of a dimension, mm (angles: degrees).
    tolerance : tuple of float or None
        Lower and upper deviation that the drawing allows.
    share : float or None
        Part of the tolerance's half width that is permitted as error.
    direction : tuple of float or None
        Of a distance.
    alternatives : tuple of tuple of EntityRecord
        Other sets of entities that give the value.
    surfaces_mm : float or None
        Standard deviation of the position of its faces, mm; None if it is that of the request.
    surfaces_from : str
        The tolerance of the model that this follows from.
    """

    name: str
    kind: str
    ends: np.ndarray
    entities: tuple[EntityRecord, ...]
    permitted_error: float | None = None
    tolerance: tuple[float, float] | None = None
    share: float | None = None
    direction: tuple[float, float, float] | None = None
    alternatives: tuple[tuple[EntityRecord, ...], ...] = ()
    surfaces_mm: float | None = None
    surfaces_from: str = ""

    @classmethod
    def of(cls, target: Target, entities: Mapping[str, Any]) -> TargetRecord:
        """Return the record of a target whose entities are known by name."""
        witness = target.witnesses[0]
        seen, *others = (
            tuple(EntityRecord.of(name, entities[name]) for name in one.entities)
            for one in target.witnesses
        )
        if not isinstance(target, DimensionTarget):
            return cls(target.name, EDGE, witness.ends, seen)
        dimension = target.dimension
        return cls(
            target.name,
            dimension.kind,
            witness.ends,
            seen,
            float(target.max_error),
            dimension.tolerance,
            None if dimension.tolerance is None else dimension.share,
            dimension.direction,
            tuple(others),
            dimension.surfaces_mm,
            dimension.surfaces_from,
        )

    def item_of(self, solid: Solid) -> Any:
        """Return the target as `plan_inspection` takes it."""
        entities, *others = (
            tuple(record.entity_of(solid) for record in way)
            for way in (self.entities, *self.alternatives)
        )
        if self.kind == EDGE:
            return entities[0]
        if self.tolerance is None:
            error: dict[str, Any] = {"max_error": self.permitted_error}
        else:
            error = {"tolerance": self.tolerance, "share": self.share}
        return Dimension(
            self.kind,
            entities,
            direction=self.direction,
            alternatives=tuple(others),
            surfaces_mm=self.surfaces_mm,
            surfaces_from=self.surfaces_from,
            **error,
        )


def target_records(
    entities: Mapping[str, Any], targets: Sequence[Target]
) -> tuple[TargetRecord, ...]:
    """Return the records of targets whose entities are known by name."""
    return tuple(TargetRecord.of(target, entities) for target in targets)
