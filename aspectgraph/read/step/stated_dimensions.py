"""The values and tolerances of dimensions as the text of a STEP file states them.

The kernel loses the signs of tolerances, and takes limits in the wrong order for a range. So both are read from the
text as well, which says what was meant. The kernel leaves out whether a dimension is a reference or a basic one, and
takes the letters of a tolerance class for others. These are read from the text only.

Reference: ISO 10303-242, dimensional_characteristic_representation, plus_minus_tolerance and limits_and_fits; the
"dimensional note" of a dimension is one of the CAx-IF recommended practices for PMI.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from aspectgraph.exceptions import ReadError
from aspectgraph.read.step.text import OCCURRENCES, StepEntity, known_references, unit_mm

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
GEOMETRIC_TOLERANCES = {
    "ANGULARITY_TOLERANCE": "angularity",
    "CIRCULAR_RUNOUT_TOLERANCE": "circular run-out",
    "COAXIALITY_TOLERANCE": "coaxiality",
    "CONCENTRICITY_TOLERANCE": "concentricity",
    "CYLINDRICITY_TOLERANCE": "cylindricity",
    "FLATNESS_TOLERANCE": "flatness",
    "LINE_PROFILE_TOLERANCE": "line profile",
    "PARALLELISM_TOLERANCE": "parallelism",
    "PERPENDICULARITY_TOLERANCE": "perpendicularity",
    "POSITION_TOLERANCE": "position",
    "ROUNDNESS_TOLERANCE": "roundness",
    "STRAIGHTNESS_TOLERANCE": "straightness",
    "SURFACE_PROFILE_TOLERANCE": "surface profile",
    "SYMMETRY_TOLERANCE": "symmetry",
    "TOTAL_RUNOUT_TOLERANCE": "total run-out",
}
"""Entities that are geometric tolerances (ISO 10303-47), and the words of the trade for them."""

_ROUNDED_DEGREE = 1e-6
"""Files state the degree as 0.0174532925 rad or with more digits; what is as close to it is the degree."""

WITH_TEXTS = frozenset({"DESCRIPTIVE_REPRESENTATION_ITEM", "LIMITS_AND_FITS"})
"""Entities whose texts say something of a dimension, see `text.parse_texts`."""

_ROLES = {
    "auxiliary": "reference",
    "reference": "reference",
    "theoretical": "basic",
    "theoretically exact": "basic",
    "basic": "basic",
}
"""What the notes of a dimension call it, and what it is: for information only, or exact by definition."""

_FORM = re.compile(r"([A-Za-z]{1,2}) ?([0-9]{0,2})")
_HOLES = ("hole", "h")
_SHAFTS = ("shaft", "s")


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
    tolerance_class : str
        Its class as the file writes it, such as "H7"; empty if there is none.
    role : str
        "reference" or "basic" if its notes say so; otherwise empty.
    notes : tuple of str
        Its other notes.
    """

    location: bool
    values: tuple[float, ...]
    bounds: tuple[float, float] | None
    of_occurrence: bool = False
    tolerance_class: str = ""
    role: str = ""
    notes: tuple[str, ...] = ()


def list_dimensions(
    entities: dict[int, StepEntity], texts: Mapping[int, tuple[str, ...]] | None = None
) -> list[StatedDimension]:
    """Return the dimensions of a file in its order.

    Parameters
    ----------
    entities : dict
        See `text.parse_entities`.
    texts : mapping, optional
        Those of the entities in `WITH_TEXTS`, see `text.parse_texts`. Without them, roles, notes and classes are empty.

    Returns
    -------
    list of StatedDimension
        Empty for a file without semantic dimensions.
    """
    values = _values(entities)
    bounds = _bounds(entities)
    notes = _notes(entities, texts or {})
    classes = _classes(entities, texts or {})
    return [
        StatedDimension(
            bool(LOCATIONS & entity.kinds),
            values.get(number, ()),
            bounds.get(number),
            _is_of_occurrence(entities, entity),
            classes.get(number, ""),
            next((_ROLES[note] for note in notes.get(number, ()) if note in _ROLES), ""),
            tuple(note for note in notes.get(number, ()) if note not in _ROLES),
        )
        for number, entity in entities.items()
        if (SIZES | LOCATIONS) & entity.kinds
    ]


def list_geometric_tolerances(entities: dict[int, StepEntity]) -> list[tuple[int, str]]:
    """Return the number of the entity of each geometric tolerance in the order of the file, and its word.

    Parameters
    ----------
    entities : dict
        See `text.parse_entities`. A tolerance with a datum or a material condition is one entity of several kinds.
    """
    rows = []
    for number, entity in entities.items():
        kinds = GEOMETRIC_TOLERANCES.keys() & entity.kinds
        if kinds:
            rows.append((number, GEOMETRIC_TOLERANCES[min(kinds)]))
    return rows


def list_words(
    entities: dict[int, StepEntity], texts: Mapping[int, tuple[str, ...]]
) -> list[tuple[str, str]]:
    """Return the type of each dimension in the order of the file, and the word for it, such as "diameter".

    Parameters
    ----------
    entities : dict
        See `text.parse_entities`.
    texts : mapping
        Those of the dimensions, see `text.parse_texts`.
    """
    rows = []
    for number, entity in entities.items():
        kinds = (SIZES | LOCATIONS) & entity.kinds
        if kinds:
            words = texts.get(number, ())
            # a size of a datum feature has the name and the description of the feature before its own word
            place = slice(0, 1) if LOCATIONS & kinds else slice(-1, None)
            rows.append((min(kinds, key=len), "".join(words[place])))
    return rows


def _notes(
    entities: dict[int, StepEntity], texts: Mapping[int, tuple[str, ...]]
) -> dict[int, list[str]]:
    """Return the texts in the representation of each dimension, by its number; roles in small letters."""
    by_dimension: dict[int, list[str]] = {}
    for dimension, items in _items_of_dimensions(entities):
        for item in items:
            if "DESCRIPTIVE_REPRESENTATION_ITEM" in getattr(entities.get(item), "kinds", ()):
                stripped = [text.strip() for text in texts.get(item, ())]
                notes = [text.lower() if text.lower() in _ROLES else text for text in stripped]
                by_dimension.setdefault(dimension, []).extend(note for note in notes if note)
    return by_dimension


def _classes(
    entities: dict[int, StepEntity], texts: Mapping[int, tuple[str, ...]]
) -> dict[int, str]:
    """Return the tolerance class stated for each dimension, by its number."""
    by_dimension: dict[int, str] = {}
    for entity in entities.values():
        if entity.kind != "PLUS_MINUS_TOLERANCE" or len(entity.references) != 2:
            continue
        fits, dimension = entity.references
        if fits in entities and entities[fits].kind == "LIMITS_AND_FITS":
            by_dimension[dimension] = _class_text(texts.get(fits, ()))
    return by_dimension


def _class_text(texts: tuple[str, ...]) -> str:
    """Return the class of limits and fits: form variance, zone variance, grade and source.

    The grade may stand behind the letter, as "G6", and be written as "IT6". The zone says "hole" or "shaft", where
    files differ in whether the letter is a capital one.
    """
    form, zone, grade = (*(text.strip() for text in texts), "", "", "")[:3]
    grade = re.sub(r"^IT ?", "", grade.upper())
    matched = _FORM.fullmatch(form)
    if matched is None:
        return " ".join(text for text in (form, grade) if text)
    letters = matched[1]
    if zone.lower() in _HOLES:
        letters = letters.upper()
    elif zone.lower() in _SHAFTS:
        letters = letters.lower()
    return letters + (grade or matched[2])


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
    by_dimension: dict[int, tuple[float, ...]] = {}
    for dimension, items in _items_of_dimensions(entities):
        measured = [read_measure(entities, item) for item in items]
        by_dimension.setdefault(dimension, tuple(value for value in measured if value is not None))
    return by_dimension


def _items_of_dimensions(entities: dict[int, StepEntity]) -> Iterator[tuple[int, list[int]]]:
    """Go through the representations of dimensions: number of the dimension, and its items."""
    for entity in entities.values():
        if (
            entity.kind == "DIMENSIONAL_CHARACTERISTIC_REPRESENTATION"
            and len(entity.references) == 2
        ):
            dimension, representation = entity.references
            yield (
                dimension,
                entities[representation].references if representation in entities else [],
            )


def _bounds(entities: dict[int, StepEntity]) -> dict[int, tuple[float, float]]:
    """Return the bounds of the deviation stated for each dimension, by its number."""
    by_dimension: dict[int, tuple[float, float]] = {}
    for entity in entities.values():
        if entity.kind != "PLUS_MINUS_TOLERANCE" or len(entity.references) != 2:
            continue
        limits, dimension = entity.references
        if limits in entities and entities[limits].kind == "TOLERANCE_VALUE":
            pair = [read_measure(entities, number) for number in entities[limits].references]
            if len(pair) == 2 and pair[0] is not None and pair[1] is not None:
                by_dimension[dimension] = (pair[0], pair[1])
    return by_dimension


def read_measure(entities: dict[int, StepEntity], number: int) -> float | None:
    """Return a measure with a unit in mm or degrees; None if it is none.

    Parameters
    ----------
    entities : dict
        See `text.parse_entities`.
    number : int
        That of the measure.
    """
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
