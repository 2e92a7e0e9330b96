"""The geometric tolerances of a STEP file as its text states them.

This reader shares no code with the kernel's. `disagreements` compares the two.

Reference: ISO 10303-47, geometric_tolerance, and ISO 10303-242, datum_system, tolerance_zone; ISO 1101, ISO 2692 and
ISO 5459 for what they mean.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from aspectgraph.read.step.stated_dimensions import GEOMETRIC_TOLERANCES, read_measure
from aspectgraph.read.step.text import StepEntity, known_references

WITH_TEXTS = frozenset({*GEOMETRIC_TOLERANCES, "DATUM", "TOLERANCE_ZONE_FORM"})
"""Entities whose texts say something of a tolerance, see `text.parse_texts`."""

_FIELDS = r"\s*\(\s*(?:''|\$)\s*,\s*(?:''|\$)\s*,\s*#([0-9]+)\s*,\s*#([0-9]+)"
_IN_COMPLEX = re.compile(r"(?<![A-Z_])GEOMETRIC_TOLERANCE" + _FIELDS, re.IGNORECASE)
_SIMPLE = re.compile(r"^\s*[A-Z_]+" + _FIELDS, re.IGNORECASE)
_COMPARTMENTS = frozenset({"DATUM_REFERENCE_COMPARTMENT", "DATUM_REFERENCE_ELEMENT"})
TARGETS = frozenset({"PLACED_DATUM_TARGET_FEATURE", "DATUM_TARGET"})
"""Aspects that state a datum by points, lines or areas of its own."""

_OF_DATUMS = TARGETS | {"DATUM_FEATURE"}
_MAXIMUM = ("MAXIMUM_MATERIAL_REQUIREMENT", "MAXIMUM_MATERIAL_CONDITION")
_LEAST = ("LEAST_MATERIAL_REQUIREMENT", "LEAST_MATERIAL_CONDITION")

_KERNEL_WORDS = {
    "CircularityOrRoundness": "roundness",
    "CircularRunout": "circular run-out",
    "ProfileOfLine": "line profile",
    "ProfileOfSurface": "surface profile",
    "TotalRunout": "total run-out",
}
"""What the kernel calls a characteristic by another word than the others."""


@dataclass(frozen=True)
class StatedTolerance:
    """What the text says of one geometric tolerance.

    Attributes
    ----------
    number : int
        That of its entity.
    name : str
        As the file writes it; may be empty.
    characteristic : str
        Such as "position", see `stated_dimensions.GEOMETRIC_TOLERANCES`.
    zone_mm : float or None
        Width or diameter of its zone; None if the file states none.
    diametral : bool
        The zone is a cylinder or a circle.
    material : str
        "M" or "L" for the maximum or least material condition; otherwise empty.
    datums : tuple of str
        Its datums in their order, such as "A", "B(M)" or "A-B".
    projected_mm : float or None
        Height of a projected zone.
    per_unit : bool
        It holds for each unit of length or area.
    aspect : int
        Number of what it is attached to; 0 if the file does not say.
    """

    number: int
    name: str
    characteristic: str
    zone_mm: float | None
    diametral: bool
    material: str
    datums: tuple[str, ...]
    projected_mm: float | None
    per_unit: bool
    aspect: int


def list_stated_tolerances(
    entities: dict[int, StepEntity], texts: Mapping[int, tuple[str, ...]]
) -> list[StatedTolerance]:
    """Return the geometric tolerances of a file in its order.

    Parameters
    ----------
    entities : dict
        See `text.parse_entities`.
    texts : mapping
        Those of the entities in `WITH_TEXTS`, see `text.parse_texts`.
    """
    zones = _Zones(entities, texts)
    tolerances = []
    for number, entity in entities.items():
        kinds = GEOMETRIC_TOLERANCES.keys() & entity.kinds
        if not kinds:
            continue
        fields = _IN_COMPLEX.search(entity.text) or _SIMPLE.search(entity.text)
        strings = texts.get(number, ())
        tolerances.append(
            StatedTolerance(
                number,
                strings[0].strip() if strings else "",
                GEOMETRIC_TOLERANCES[min(kinds)],
                read_measure(entities, int(fields[1])) if fields else None,
                number in zones.diametral,
                _material(entity.text),
                _datums(entities, texts, entity),
                zones.projected_mm.get(number),
                "GEOMETRIC_TOLERANCE_WITH_DEFINED_UNIT" in entity.kinds,
                int(fields[2]) if fields else 0,
            )
        )
    return tolerances


def list_datum_features(
    entities: dict[int, StepEntity], texts: Mapping[int, tuple[str, ...]]
) -> dict[str, list[int]]:
    """Return the aspects that are features of each datum, by its letter: the datum itself and its features.

    Some writers attach the faces to the datum, others to its feature. Datum targets are among them.

    Parameters
    ----------
    entities : dict
        See `text.parse_entities`.
    texts : mapping
        Those of the datums.
    """
    features: dict[str, list[int]] = {}
    for number, entity in entities.items():
        if "DATUM" in entity.kinds:
            letter = "".join(texts.get(number, ())[-1:]).strip()
            features.setdefault(letter, []).append(number)
    for entity in entities.values():
        if "SHAPE_ASPECT_RELATIONSHIP" not in entity.kinds:
            continue
        ends = known_references(entities, entity)
        datums = [number for number in ends if "DATUM" in entities[number].kinds]
        aspects = [number for number in ends if not _OF_DATUMS.isdisjoint(entities[number].kinds)]
        for number in datums:
            letter = "".join(texts.get(number, ())[-1:]).strip()
            features.setdefault(letter, []).extend(aspects)
    return features


def disagreements(
    stated: Sequence[StatedTolerance], kernel: Sequence[tuple[str, float]]
) -> list[str]:
    """Return what the text and the kernel say differently of the tolerances of a file, in words.

    Parameters
    ----------
    stated : sequence of StatedTolerance
        Those of the text.
    kernel : sequence of (str, float)
        Those of the kernel: its type, and the zone in mm.

    Returns
    -------
    list of str
        Empty if both have the same characteristics with the same zones, in any order.
    """
    of_text = Counter(_key(tolerance.characteristic, tolerance.zone_mm) for tolerance in stated)
    of_kernel = Counter(
        _key(_KERNEL_WORDS.get(kind, kind.lower()), zone_mm) for kind, zone_mm in kernel
    )
    missing = (of_text - of_kernel).elements()
    added = (of_kernel - of_text).elements()
    return [
        *(
            f"the kernel does not read {word} {zone} mm, which the text states"
            for word, zone in missing
        ),
        *(
            f"the kernel reads {word} {zone} mm, which the text does not state"
            for word, zone in added
        ),
    ]


def _key(characteristic: str, zone_mm: float | None) -> tuple[str, str]:
    return characteristic, f"{zone_mm or 0.0:.6g}"


def _material(text: str) -> str:
    """Return the material condition that a text names, as a drawing writes it."""
    enumerated = frozenset(re.findall(r"\.([A-Z_]+)\.", text.upper()))
    if not enumerated.isdisjoint(_MAXIMUM):
        return "M"
    if not enumerated.isdisjoint(_LEAST):
        return "L"
    return ""


def _datums(
    entities: dict[int, StepEntity], texts: Mapping[int, tuple[str, ...]], tolerance: StepEntity
) -> tuple[str, ...]:
    """Return the datums of a tolerance in their order."""
    datums: list[str] = []
    for number in known_references(entities, tolerance):
        entity = entities[number]
        if "DATUM_SYSTEM" in entity.kinds:
            parts = known_references(entities, entity)
            datums += [
                _compartment(entities, texts, part)
                for part in parts
                if not _COMPARTMENTS.isdisjoint(entities[part].kinds)
            ]
        elif "DATUM_REFERENCE" in entity.kinds:
            datums.append(_compartment(entities, texts, number))
    return tuple(filter(None, datums))


def _compartment(
    entities: dict[int, StepEntity], texts: Mapping[int, tuple[str, ...]], number: int
) -> str:
    """Return the datum of a compartment; the letters of a common datum are joined by a hyphen."""
    entity = entities[number]
    names = []
    for reference in known_references(entities, entity):
        kinds = entities[reference].kinds
        if "DATUM" in kinds:
            names.append("".join(texts.get(reference, ())[-1:]).strip())
        elif not _COMPARTMENTS.isdisjoint(kinds):
            names.append(_compartment(entities, texts, reference))
    material = _material(entity.text)
    joined = "-".join(filter(None, names))
    return f"{joined}({material})" if material and joined else joined


class _Zones:
    """Which tolerances have a round or projected zone, by their number.

    Parameters
    ----------
    entities : dict
        See `text.parse_entities`.
    texts : mapping
        Those of the forms of zones.
    """

    def __init__(self, entities: dict[int, StepEntity], texts: Mapping[int, tuple[str, ...]]):
        self.diametral: set[int] = set()
        self.projected_mm: dict[int, float | None] = {}
        for entity in entities.values():
            if "TOLERANCE_ZONE" in entity.kinds:
                self.diametral |= self._of_round_zone(entities, texts, entity)
            if "PROJECTED_ZONE_DEFINITION" in entity.kinds:
                self._add_projected(entities, entity)

    @staticmethod
    def _of_round_zone(
        entities: dict[int, StepEntity], texts: Mapping[int, tuple[str, ...]], zone: StepEntity
    ) -> set[int]:
        references = known_references(entities, zone)
        forms = [" ".join(texts.get(number, ())).lower() for number in references]
        is_round = any("cylindrical" in form or "circular" in form for form in forms)
        return {number for number in references if is_round and _is_tolerance(entities[number])}

    def _add_projected(self, entities: dict[int, StepEntity], projected: StepEntity) -> None:
        references = known_references(entities, projected)
        height_mm = read_measure(entities, references[-1]) if references else None
        for zone in references[:1]:
            for number in known_references(entities, entities[zone]):
                if _is_tolerance(entities[number]):
                    self.projected_mm[number] = height_mm


def _is_tolerance(entity: StepEntity) -> bool:
    return not GEOMETRIC_TOLERANCES.keys().isdisjoint(entity.kinds)
