"""A set of entities that gives the value of a dimension, as a plan keeps it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from errors.measurands.geometry import Geometry, from_dict, to_dict


@dataclass(frozen=True)
class PlannedWitness:
    """A set of entities that gives the value of a dimension.

    Attributes
    ----------
    entities : tuple of str
        Ids of the entities that must be visible.
    geometry : tuple of Line or Circle
        Their lines and circles, mm, in the part's frame.
    """

    entities: tuple[str, ...]
    geometry: tuple[Geometry, ...] = field(repr=False, compare=False)

    def to_dict(self) -> dict[str, Any]:
        """Return the fields as plain values, ready for JSON."""
        return {
            "entities": list(self.entities),
            "geometry": [to_dict(item) for item in self.geometry],
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> PlannedWitness:
        """Build from the result of `to_dict`."""
        return cls(tuple(data["entities"]), tuple(from_dict(item) for item in data["geometry"]))
