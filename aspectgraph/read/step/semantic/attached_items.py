"""The items of the model that each dimension of a STEP file is attached to, as its text says.

The kernel reads one item of each aspect. An aspect can have several: some writers attach a pattern of holes this way.
So the text says which items there are.

Reference: ISO 10303-242, geometric_item_specific_usage, composite_shape_aspect and shape_aspect_deriving_relationship.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

from aspectgraph.read.step.semantic.stated_dimensions import LOCATIONS, SIZES
from aspectgraph.read.step.text import StepEntity, known_references

_USAGE = "GEOMETRIC_ITEM_SPECIFIC_USAGE"
_PARTS = frozenset({"SHAPE_ASPECT_RELATIONSHIP", "SHAPE_ASPECT_DERIVING_RELATIONSHIP"})
"""They lead from a composite aspect to its parts, and from a derived one to what it is derived from."""


def list_attached_items(entities: dict[int, StepEntity]) -> list[list[list[int]]]:
    """Return the items that each dimension is attached to.

    Parameters
    ----------
    entities : dict
        See `text.parse_entities`.

    Returns
    -------
    list of list of list of int
        For each dimension, in the order of `stated_dimensions.list_dimensions`, one list of numbers of entities for a
        size, and two for a location: one of each end. Each number is there once. They are in the order of the file.
    """
    items = _items_of_aspects(entities)
    parts = _parts_of_aspects(entities)
    sides = []
    for number, entity in entities.items():
        if not (SIZES | LOCATIONS) & entity.kinds:
            continue
        n_sides = 2 if LOCATIONS & entity.kinds else 1
        aspects = [
            reference
            for reference in known_references(entities, entity)
            if entities[reference].kind != "PRODUCT_DEFINITION_SHAPE"
        ]
        if not aspects:
            # the size of a datum feature is an aspect itself
            aspects = [number]
        sides.append(
            [list(dict.fromkeys(_below(aspect, items, parts))) for aspect in aspects[:n_sides]]
        )
    return sides


def list_items_below(entities: dict[int, StepEntity]) -> Callable[[int], list[int]]:
    """Return a function that lists the items of an aspect, each once, by the number of the aspect.

    Parameters
    ----------
    entities : dict
        See `text.parse_entities`.
    """
    items = _items_of_aspects(entities)
    parts = _parts_of_aspects(entities)
    return lambda aspect: list(dict.fromkeys(_below(aspect, items, parts)))


def _items_of_aspects(entities: dict[int, StepEntity]) -> dict[int, list[int]]:
    """Return the items of each aspect that has some, by its number."""
    items_of: dict[int, list[int]] = {}
    for entity in entities.values():
        if entity.kind == _USAGE and len(entity.references) > 2:
            aspect, _, *items = entity.references
            items_of.setdefault(aspect, []).extend(items)
    return items_of


def _parts_of_aspects(entities: dict[int, StepEntity]) -> dict[int, list[int]]:
    """Return the parts of each composite or derived aspect, by its number."""
    parts_of: dict[int, list[int]] = {}
    for entity in entities.values():
        if entity.kind in _PARTS and len(entity.references) == 2:
            whole, part = entity.references
            parts_of.setdefault(whole, []).append(part)
    return parts_of


def _below(start: int, items: dict[int, list[int]], parts: dict[int, list[int]]) -> Iterator[int]:
    """Go through the items of an aspect; those of its parts, of their parts and so on if it has none itself."""
    front = [start]
    known = {start}
    while front:
        aspect = front.pop(0)
        if aspect in items:
            yield from items[aspect]
            continue
        new = [part for part in parts.get(aspect, ()) if part not in known]
        known.update(new)
        front += new
