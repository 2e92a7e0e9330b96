"""Which errors of a STEP file are damage of its solids, and which only of what is written about them.

The kernel marks every entity that it cannot read. A solid depends on what it refers to, and on what places it. The
rest of a file are dimensions, tolerances, annotations, styles and properties: a solid is the same without them.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from aspectgraph.exceptions import ReadError
from aspectgraph.read.step.listing import ListedSolid, list_placing
from aspectgraph.read.step.text import StepEntity

_HARMLESS = ("ShapeRepresentation", "MechanicalDesignAndDraughtingRelationship")
_STRUCTURE = (
    "Transformation",
    "RepresentationRelationship",
    "RepresentationMap",
    "MappedItem",
    "UsageOccurrence",
)
_PMI = re.compile(
    r"DIMENSION(?!AL_EXPONENTS)|TOLERANCE|DATUM|ANGULAR_|LIMITS_AND_FITS|SHAPE_ASPECT|ANNOTATION|CALLOUT|DRAUGHTING"
    r"|LEADER|SYMBOL|TEXT_LITERAL|CAMERA|ITEM_IDENTIFIED_REPRESENTATION_USAGE|GEOMETRIC_ITEM_SPECIFIC_USAGE"
)
"""What the types of PMI and annotations have in their names."""

_NO_LABEL = re.compile(
    r"Parameter n0\.\d+ \((?:\w+\.)?(?:name|description|id)\) not a quoted String$"
)
_NO_ENTITY = re.compile(r"\) not an Entity$")
_TYPED_ITEMS = re.compile(r"\b(?:SET|LIST)_REPRESENTATION_ITEM\s*\(\s*\(", re.IGNORECASE)
_UNRESOLVED = "Unresolved Reference"


@dataclass
class Damage:
    """What is wrong with a file.

    Attributes
    ----------
    of_solids : dict of int to str
        What is wrong with the entities that solids consist of, by solid.
    pmi : list of int
        Numbers of the entities of PMI and annotations that the kernel cannot read.
    loose : list of int
        Those of damaged geometry that no listed solid depends on.
    other : list of int
        Those of other data that refer to what is not there.
    """

    of_solids: dict[int, str] = field(default_factory=dict)
    pmi: list[int] = field(default_factory=list)
    loose: list[int] = field(default_factory=list)
    other: list[int] = field(default_factory=list)

    def notes(self, entities: dict[int, StepEntity]) -> list[str]:
        """Return notes on the errors that do no harm to a solid."""
        places = {"PMI": self.pmi, "geometry of no solid": self.loose}
        places["data that no solid needs"] = self.other
        notes = []
        for place, numbers in places.items():
            if not numbers:
                continue
            first = f"{entities[numbers[0]].kind} #{numbers[0]}"
            if len(numbers) == 1:
                notes.append(f"1 error in {place} was ignored, in {first}")
            else:
                notes.append(f"{len(numbers)} errors in {place} were ignored, the first in {first}")
        return notes


def find_damage(
    model: Any,
    numbers: dict[Any, int],
    entities: dict[int, StepEntity],
    listed: dict[int, ListedSolid],
    name: str,
) -> Damage:
    """Return what is wrong with a file.

    Parameters
    ----------
    model : Interface_InterfaceModel
        What the kernel read.
    numbers : dict
        The number of each entity in the file, by its handle.
    entities : dict
        See `text.parse_entities`.
    listed : dict of int to ListedSolid
        The solids that the file lists, by number.
    name : str
        What to call the file in messages.

    Raises
    ------
    ReadError
        Something that places solids is damaged.
    """
    placing = list_placing(entities, listed)
    needed = placing.union(*(solid.entities for solid in listed.values()))
    missing = _unresolved(model, entities, needed, name)
    kinds_of_solids: dict[int, set[str]] = {}
    damage = Damage()
    for i, (handle, number) in enumerate(numbers.items(), start=1):
        if not model.IsErrorEntity(i) and number not in missing:
            continue
        if number not in missing and _is_right(model.ReportEntity(i).Check(), entities[number]):
            continue
        family, _, kind = handle.DynamicType().Name().partition("_")
        owners = [solid for solid in listed.values() if number in solid.entities]
        for solid in owners:
            kinds_of_solids.setdefault(solid.number, set()).add(kind)
        if owners:
            continue
        geometry = _is_geometry(family, kind)
        if geometry and number in placing:
            raise ReadError(
                f"the geometry of a STEP file must be whole. Got {name} with errors in {kind} #{number}."
            )
        if any(map(_PMI.search, entities[number].kinds)):
            damage.pmi.append(number)
        elif geometry:
            damage.loose.append(number)
        elif number in missing:
            damage.other.append(number)
    damage.of_solids = {
        number: f"errors in {', '.join(sorted(kinds))}" for number, kinds in kinds_of_solids.items()
    }
    return damage


def check_nothing_loose(
    damage: Damage,
    built: Sequence[int | None],
    entities: dict[int, StepEntity],
    name: str,
) -> None:
    """Check that damaged geometry of no listed solid is in none that the kernel has built on its own.

    Parameters
    ----------
    damage : Damage
        What is wrong with the file.
    built : sequence of int or None
        Numbers of the solids that the kernel built and the file does not list; None where it is not known.
    entities : dict
        See `text.parse_entities`.
    name : str
        What to call the file in messages.

    Raises
    ------
    ReadError
        It may be.
    """
    if damage.loose and built:
        number = damage.loose[0]
        raise ReadError(
            "the geometry of a STEP file must be whole. "
            f"Got {name} with errors in {entities[number].kind} #{number}."
        )


def _is_geometry(family: str, kind: str) -> bool:
    """Return whether an entity of the kernel is of a shape, or of the structure of an assembly."""
    shapes = family in ("StepShape", "StepGeom")
    structure = any(part in kind for part in _STRUCTURE)
    return (shapes or structure) and not kind.endswith(_HARMLESS)


def _is_right(check: Any, entity: StepEntity) -> bool:
    """Return whether an entity is whole but for a name, description or id, or has a list the kernel does not know."""
    fails = [str(check.CFail(k)) for k in range(1, check.NbFails() + 1)]
    pattern = _NO_ENTITY if _TYPED_ITEMS.search(entity.text) else _NO_LABEL
    return bool(fails) and all(map(pattern.search, fails))


def _unresolved(
    model: Any, entities: dict[int, StepEntity], needed: set[int], name: str
) -> set[int]:
    """Return the numbers of the entities that refer to missing ones; refuse needed ones, and errors of syntax."""
    check = model.GlobalCheck()
    fails = [str(check.CFail(k)) for k in range(1, check.NbFails() + 1)]
    missing = {
        number
        for number, entity in entities.items()
        if any(reference not in entities for reference in entity.references)
    }
    n_syntax = sum(not fail.startswith(_UNRESOLVED) for fail in fails)
    if n_syntax or not needed.isdisjoint(missing) or (fails and not missing):
        raise ReadError(
            f"a STEP file must be whole. Got {name} with {max(len(fails), 1)} syntax errors or missing entities."
        )
    return missing
