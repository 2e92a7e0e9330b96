"""The values and tolerances of dimensions as the text of a STEP file states them.

The kernel loses the signs of tolerances, and takes limits in the wrong order for a range. So both are read from the
text as well, which says what was meant.

Reference: ISO 10303-242, dimensional_characteristic_representation and plus_minus_tolerance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from aspectgraph.exceptions import ReadError
from aspectgraph.read.step.listing import OCCURRENCES, unit_mm
from aspectgraph.read.step.text import StepEntity, known_references

SIZES = frozenset(
    {
        "ANGULAR_SIZE",
        "DIMENSIONAL_SIZE",
        "DIMENSIONAL_SIZE_WITH_DATUM_FEATURE",
        "DIMENSIONAL_SIZE_WITH_PATH",
    }
)
LOCATIONS = frozenset(
    {
        "ANGULAR_LOCATION",
        "DIMENSIONAL_LOCATION",
        "DIMENSIONAL_LOCATION_WITH_PATH",
        "DIRECTED_DIMENSIONAL_LOCATION",
    }
)
_ROUNDED_DEGREE = 1e-6
"""Files state the degree as 0.0174532925 rad or with more digits; what is as close to it is the degree."""


@dataclass(frozen=True)
class StatedDimension:
    """What the text says of one dimension.

    Attributes
    ----------
    location : bool
        It lies between two features; otherwise it is the size of one.
    values : tuple of float
        All values stated, in mm or degrees, in the order of the file.
    bounds : tuple of float or None
        Lower and upper bound of the deviation as the file writes them, be they in order or not.
    of_occurrence : bool
        It belongs to one occurrence of a part in an assembly, not to the part.
    """

    location: bool
    values: tuple[float, ...]
    bounds: tuple[float, float] | None
    of_occurrence: bool = False


def list_dimensions(entities: dict[int, StepEntity]) -> list[StatedDimension]:
    """Return the dimensions of a file in its order.

    Parameters
    ----------
    entities : dict
        See `text.parse_entities`.

    Returns
    -------
    list of StatedDimension
        Empty for a file without semantic dimensions.
    """
    values = _values(entities)
    bounds = _bounds(entities)
    return [
        StatedDimension(
            bool(LOCATIONS & entity.kinds),
            values.get(number, ()),
            bounds.get(number),
            _is_of_occurrence(entities, entity),
        )
        for number, entity in entities.items()
        if (SIZES | LOCATIONS) & entity.kinds
    ]


def _is_of_occurrence(entities: dict[int, StepEntity], dimension: StepEntity) -> bool:
    """Return whether an aspect that a dimension is attached to is one of an occurrence, not of a part."""
    kinds = [
        entities[owner].kind
        for aspect in known_references(entities, dimension)
        for shape in known_references(entities, entities[aspect])
        if entities[shape].kind == "PRODUCT_DEFINITION_SHAPE"
        for owner in known_references(entities, entities[shape])
    ]
    return not OCCURRENCES.isdisjoint(kinds)


def _values(entities: dict[int, StepEntity]) -> dict[int, tuple[float, ...]]:
    """Return the values stated for each dimension, by its number."""
    found: dict[int, tuple[float, ...]] = {}
    for entity in entities.values():
        if (
            entity.kind == "DIMENSIONAL_CHARACTERISTIC_REPRESENTATION"
            and len(entity.references) == 2
        ):
            dimension, representation = entity.references
            items = entities[representation].references if representation in entities else []
            measured = [_measure(entities, item) for item in items]
            found.setdefault(dimension, tuple(value for value in measured if value is not None))
    return found


def _bounds(entities: dict[int, StepEntity]) -> dict[int, tuple[float, float]]:
    """Return the bounds of the deviation stated for each dimension, by its number."""
    found: dict[int, tuple[float, float]] = {}
    for entity in entities.values():
        if entity.kind != "PLUS_MINUS_TOLERANCE" or len(entity.references) != 2:
            continue
        limits, dimension = entity.references
        if limits in entities and entities[limits].kind == "TOLERANCE_VALUE":
            pair = [_measure(entities, number) for number in entities[limits].references]
            if len(pair) == 2 and pair[0] is not None and pair[1] is not None:
                found[dimension] = (pair[0], pair[1])
    return found


def _measure(entities: dict[int, StepEntity], number: int) -> float | None:
    """Return a measure with a unit in mm or degrees; None if it is none."""
    entity = entities.get(number)
    if (
        entity is None
        or not any(kind.endswith("MEASURE_WITH_UNIT") for kind in entity.kinds)
        or not entity.numbers
    ):
        return None
    for unit in entity.references:
        kinds = entities[unit].kinds if unit in entities else frozenset()
        if "LENGTH_UNIT" in kinds:
            return entity.numbers[0] * unit_mm(entities, unit)
        if "PLANE_ANGLE_UNIT" in kinds:
            return entity.numbers[0] * _unit_deg(entities, unit)
    return None


def _unit_deg(entities: dict[int, StepEntity], number: int) -> float:
    """Return the degrees in a unit of plane angle, which is the radian or stated in terms of it."""
    for measure in (entities[ref] for ref in entities[number].references if ref in entities):
        if measure.kind.endswith("MEASURE_WITH_UNIT") and measure.numbers:
            degrees = math.degrees(measure.numbers[0])
            return 1.0 if abs(degrees - 1.0) < _ROUNDED_DEGREE else degrees
    if "SI_UNIT" in entities[number].kinds:
        return math.degrees(1.0)
    raise ReadError(
        f"the angle unit of a STEP file must be a multiple of the radian. Got #{number}={entities[number].text[:60]}."
    )
