"""Flatness and profile tolerances of a STEP file: how wide their zones are, and on which faces.

A profile tolerance with datums says where a face is. Flatness, and a profile without datums, says how flat or true to
form it is; the face of a datum is where the datum is, so there this says where the face is, too.

Only tolerances of whole faces count. A flatness per unit of length or area allows more over the whole face, and is left
out. Cylindricity and roundness are left out, too: they belong to what is measured, not to the plane that carries it.

Reference: ISO 10303-242, geometric_tolerance, datum_feature; ISO 1101.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from aspectgraph.read.step.semantic.attached_items import list_items_below
from aspectgraph.read.step.semantic.attached_shapes import AttachedShapes
from aspectgraph.read.step.semantic.instances import AmbiguousInstanceError, Instances
from aspectgraph.read.step.semantic.stated_dimensions import read_measure
from aspectgraph.read.step.text import StepEntity

_TOLERANCES = {"FLATNESS_TOLERANCE": "flatness", "SURFACE_PROFILE_TOLERANCE": "profile"}
_WITH_DATUMS = "GEOMETRIC_TOLERANCE_WITH_DATUM_REFERENCE"
_UNEQUAL = "UNEQUALLY_DISPOSED_GEOMETRIC_TOLERANCE"
_PER_UNIT = "GEOMETRIC_TOLERANCE_WITH_DEFINED_UNIT"
# magnitude and what has the tolerance: in the part of a complex entity, and in a simple one
_FIELDS = r"\s*\(\s*''\s*,\s*(?:''|\$)\s*,\s*#([0-9]+)\s*,\s*#([0-9]+)"
_HEAD = re.compile(r"(?<![A-Z_])GEOMETRIC_TOLERANCE" + _FIELDS, re.IGNORECASE)
_START = re.compile(r"^\s*[A-Z_]+" + _FIELDS, re.IGNORECASE)
_MOVED = re.compile(_UNEQUAL + r"\s*\(\s*#([0-9]+)", re.IGNORECASE)


@dataclass(frozen=True)
class SurfaceTolerance:
    """A flatness or profile tolerance as the text states it.

    Attributes
    ----------
    tolerance : str
        "flatness" or "profile".
    width_mm : float
        Width of the zone. Of one that lies unequally about the surface, the width of an equal one that holds it.
    with_datums : bool
        It refers to datums.
    items : tuple of int
        Numbers of the faces and other items that it is attached to.
    """

    tolerance: str
    width_mm: float
    with_datums: bool
    items: tuple[int, ...]


def list_surface_tolerances(entities: dict[int, StepEntity]) -> list[SurfaceTolerance]:
    """Return the flatness and profile tolerances of a file in its order.

    Parameters
    ----------
    entities : dict
        See `text.parse_entities`.
    """
    below = list_items_below(entities)
    found = []
    for entity in entities.values():
        kinds = entity.kinds
        words = [word for kind, word in _TOLERANCES.items() if kind in kinds]
        if not words or _PER_UNIT in kinds:
            continue
        width = _width_mm(entities, entity)
        items = tuple(item for aspect in _aspect(entity) for item in below(aspect))
        if width is not None and items:
            found.append(SurfaceTolerance(words[0], width, _WITH_DATUMS in kinds, items))
    return found


def list_datum_items(entities: dict[int, StepEntity]) -> set[int]:
    """Return the numbers of the items that are features of datums."""
    below = list_items_below(entities)
    return {
        item
        for number, entity in entities.items()
        if "DATUM_FEATURE" in entity.kinds
        for item in below(number)
    }


def place_surface_tolerances(
    entities: dict[int, StepEntity], attached: AttachedShapes, instances: Instances
) -> Iterator[tuple[dict[str, Any], Any]]:
    """Yield what is stated of each toleranced face, and the face in each place in the assembly.

    Parameters
    ----------
    entities : dict
        See `text.parse_entities`.
    attached : AttachedShapes
        Knows the shapes that were made from items.
    instances : Instances
        Where they are.
    """
    of_datums = list_datum_items(entities)
    for stated in list_surface_tolerances(entities):
        for item in stated.items:
            row = {
                "tolerance": stated.tolerance,
                "width_mm": stated.width_mm,
                "places": stated.with_datums or item in of_datums,
            }
            for shape in attached.made_from(item):
                try:
                    occurrences = instances.of([shape])
                except AmbiguousInstanceError:
                    continue
                yield from ((row, one.shape) for instance in occurrences for one in instance)


def _width_mm(entities: dict[int, StepEntity], entity: StepEntity) -> float | None:
    """Return the width of a zone in mm; None if it is none."""
    width = _first_measure(entities, _HEAD.search(entity.text) or _START.search(entity.text))
    if width is None or width <= 0.0:
        return None
    if _UNEQUAL not in entity.kinds:
        return width
    moved = _first_measure(entities, _MOVED.search(entity.text))
    if moved is None:
        return None
    # writers state what lies outside the material, or how far the middle is off: the wider of both
    return 2.0 * max(abs(moved), abs(width - moved), 0.5 * width + abs(moved))


def _first_measure(entities: dict[int, StepEntity], found: re.Match[str] | None) -> float | None:
    number = int(found[1]) if found else 0
    return read_measure(entities, number)


def _aspect(entity: StepEntity) -> list[int]:
    """Return the number of what has a tolerance, if there is one."""
    found = _HEAD.search(entity.text) or _START.search(entity.text)
    return [int(found[2])] if found else []
