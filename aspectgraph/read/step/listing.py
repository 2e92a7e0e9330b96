"""What a STEP file says it holds, read from its text: solids with faces and vertices, the unit, its uncertainty."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from aspectgraph.exceptions import ReadError
from aspectgraph.read.step.facets.stated import (
    TESSELLATED_SOLIDS,
    StatedFacets,
    UnreadFacetsError,
    is_linked,
    read_facets,
)
from aspectgraph.read.step.mirrored_parts import check_operators
from aspectgraph.read.step.text import StepEntity, known_references, reachable

SOLID_KINDS = frozenset(
    {
        "BREP_WITH_VOIDS", "CSG_SOLID", "EXTRUDED_AREA_SOLID", "EXTRUDED_FACE_SOLID", "FACETED_BREP",
        "MANIFOLD_SOLID_BREP", "REVOLVED_AREA_SOLID", "REVOLVED_FACE_SOLID", "SOLID_REPLICA",
        "SURFACE_CURVE_SWEPT_AREA_SOLID", "SWEPT_DISK_SOLID", "TESSELLATED_SOLID",
    }
)  # fmt: skip
"""The types that are solids, those the kernel cannot build among them."""

OCCURRENCES = frozenset({"NEXT_ASSEMBLY_USAGE_OCCURRENCE", "SPECIFIED_HIGHER_USAGE_OCCURRENCE"})
"""The types that place a part in an assembly."""

_PLACING = frozenset(
    {
        "CONTEXT_DEPENDENT_SHAPE_REPRESENTATION", "MAPPED_ITEM", "REPRESENTATION_MAP", "REPRESENTATION_RELATIONSHIP",
        "REPRESENTATION_RELATIONSHIP_WITH_TRANSFORMATION", "SHAPE_DEFINITION_REPRESENTATION",
        "SHAPE_REPRESENTATION_RELATIONSHIP",
    }
)  # fmt: skip
"""The types that lead from a representation to what uses it in an assembly, to its part, and to its place."""

_SHELL_KINDS = {"CLOSED_SHELL", "OPEN_SHELL", "ORIENTED_CLOSED_SHELL", "ORIENTED_OPEN_SHELL"}
_PREFIX_MM = {
    "": 1e3, "KILO": 1e6, "HECTO": 1e5, "DECA": 1e4, "DECI": 1e2, "CENTI": 1e1, "MILLI": 1.0, "MICRO": 1e-3,
    "NANO": 1e-6,
}  # fmt: skip
_SI_METRE = re.compile(r"SI_UNIT\s*\(\s*(?:\$|\.([A-Z]+)\.)\s*,\s*\.METRE\.\s*\)", re.IGNORECASE)


@dataclass(frozen=True)
class ListedSolid:
    """A solid as the file states it.

    Attributes
    ----------
    number : int
        Its entity number.
    entities : set of int
        All it is made of.
    n_faces : int
        Faces in its shells.
    points_mm : ndarray, shape (n, 3)
        Its vertices, before any placement in an assembly.
    uncertainty_mm : float or None
        How closely its vertices, edges and faces fit together, if the file says so.
    facets : StatedFacets or None
        Those of a tessellated solid, before any placement in an assembly.
    damage : str
        What of its facets is not read; empty if nothing.
    """

    number: int
    entities: set[int]
    n_faces: int
    points_mm: np.ndarray
    uncertainty_mm: float | None
    facets: StatedFacets | None = None
    damage: str = ""


def list_solids(entities: dict[int, StepEntity]) -> list[ListedSolid]:
    """Return the solids in the order of the representations that hold them.

    That is the order in which the kernel finds the solids of a file without an assembly.

    Raises
    ------
    ReadError
        A closed shell belongs to no solid, a solid to no representation, or a placement to no part; or the length unit
        is not one of length; or a part is mirrored or scaled.
    """
    holders = _holders(entities)
    listed = [_listed(entities, number, context) for number, context in holders.items()]
    used = set().union(*(solid.entities for solid in listed))
    loose = _closed_shells(entities) - used - _shells_of_surfaces(entities)
    if loose:
        raise ReadError(
            f"the closed shells of a STEP file must belong to solids. Got #{min(loose)}, which does not."
        )
    _check_placements(entities)
    check_operators(entities, SOLID_KINDS)
    return listed


def _check_placements(entities: dict[int, StepEntity]) -> None:
    """Check that every placement in an assembly is that of a part, or the kernel would leave it out or unmoved."""
    placements = [
        entity
        for entity in entities.values()
        if entity.kind == "CONTEXT_DEPENDENT_SHAPE_REPRESENTATION"
    ]
    parts = [entity for entity in entities.values() if entity.kind in OCCURRENCES]
    if not placements and not parts:
        return
    used = {ref for placement in placements for ref in placement.references}
    moves = {
        n
        for n, entity in entities.items()
        if "REPRESENTATION_RELATIONSHIP_WITH_TRANSFORMATION" in entity.kinds
    }
    for number in moves:
        _check_transformation(entities, number)
    placed = [
        [
            entities[part].kind
            for shape in placement.references[1:2]
            if shape in entities
            for part in known_references(entities, entities[shape])
        ]
        for placement in placements
    ]
    wrong = [kinds for kinds in placed if not OCCURRENCES.intersection(kinds)]
    if wrong or moves - used:
        raise ReadError(
            "every placement in the assembly of a STEP file must be that of a part. "
            f"Got {len(wrong) + len(moves - used)} that are not."
        )


def _check_transformation(entities: dict[int, StepEntity], relation: int) -> None:
    """Check that a part is placed by two coordinate systems; of others the kernel takes none, and says nothing."""
    for number in known_references(entities, entities[relation]):
        if entities[number].kind != "ITEM_DEFINED_TRANSFORMATION":
            continue
        items = known_references(entities, entities[number])
        kinds = [entities[item].kind for item in items]
        if kinds != ["AXIS2_PLACEMENT_3D", "AXIS2_PLACEMENT_3D"]:
            raise ReadError(
                "a part of a STEP file must be placed by two coordinate systems (AXIS2_PLACEMENT_3D). "
                f"Got ITEM_DEFINED_TRANSFORMATION #{number} with {' and '.join(kinds) or 'none'}."
            )


def _holders(entities: dict[int, StepEntity]) -> dict[int, int]:
    """Return the number of every solid, and of the context of the representation that lists it."""
    solids = {
        number
        for number, entity in entities.items()
        if entity.kind in SOLID_KINDS or _is_complex_solid(entity)
    }
    solids -= linked_facets(entities)
    holders: dict[int, int] = {}
    for entity in entities.values():
        if "REPRESENTATION" in entity.text.upper() and any(
            "REPRESENTATION" in kind for kind in entity.kinds
        ):
            references = entity.references
            holders.update(
                {n: references[-1] for n in references[:-1] if n in solids and n not in holders}
            )
    # a solid may be part of another one, as that of a replica is
    inner = (
        set().union(*(reachable(entities, number) for number in holders))
        if solids - set(holders)
        else set()
    )
    lost = solids - set(holders) - inner
    if lost:
        raise ReadError(
            f"the solids of a STEP file must be items of a representation. Got #{min(lost)}, which is not."
        )
    return holders


def list_placing(entities: dict[int, StepEntity], solids: Iterable[int]) -> set[int]:
    """Return the numbers of the entities that say where solids are, and of which part each is.

    These are the representations that hold them, the relations and maps that lead from one representation to another,
    the transformations in these, and the occurrences of parts. Drawings and annotations refer to solids, too, but
    place none.

    Parameters
    ----------
    entities : dict
        See `text.parse_entities`.
    solids : iterable of int
        Numbers of the solids.
    """
    users: dict[int, list[int]] = {}
    for number, entity in entities.items():
        shapes = entity.kind == "REPRESENTATION" or entity.kind.endswith("SHAPE_REPRESENTATION")
        if shapes or not _PLACING.isdisjoint(entity.kinds):
            for reference in known_references(entities, entity):
                users.setdefault(reference, []).append(number)
    found: set[int] = set()
    front = list(solids)
    while front:
        for number in users.get(front.pop(), ()):
            if number in found:
                continue
            found.add(number)
            front.append(number)
            entity = entities[number]
            # what other representations hold is theirs; their context has the unit
            used = known_references(entities, entity)
            held = entity.kind.endswith("REPRESENTATION") and entity.kind not in _PLACING
            for reference in used[-1:] if held else used:
                if not entities[reference].kind.endswith("REPRESENTATION"):
                    found |= _reachable_without_representations(entities, reference)
                elif reference not in found:
                    found.add(reference)
                    front.append(reference)
    return found


def _reachable_without_representations(entities: dict[int, StepEntity], start: int) -> set[int]:
    """Return the numbers of what an entity refers to, and its own, but nothing that representations hold."""
    found = {start}
    front = [start]
    while front:
        for number in known_references(entities, entities[front.pop()]):
            if number not in found and not entities[number].kind.endswith("REPRESENTATION"):
                found.add(number)
                front.append(number)
    return found


def _is_complex_solid(entity: StepEntity) -> bool:
    return entity.text.lstrip().startswith("(") and not SOLID_KINDS.isdisjoint(entity.kinds)


def _listed(entities: dict[int, StepEntity], number: int, context: int | None) -> ListedSolid:
    inside = reachable(entities, number)
    unit_mm, uncertainty_mm = _units(entities, context)
    n_faces = sum(_count_faces(entities, ref) for ref in entities[number].references)
    points = [_point(entities, i) for i in sorted(inside) if entities[i].kind == "VERTEX_POINT"]
    if entities[number].kind in TESSELLATED_SOLIDS:
        return _listed_facets(entities, number, inside, unit_mm)
    kept = np.array([p for p in points if p is not None], dtype=np.float64).reshape(-1, 3)
    return ListedSolid(number, inside, n_faces, kept * unit_mm, uncertainty_mm)


def _listed_facets(
    entities: dict[int, StepEntity], number: int, inside: set[int], unit_mm: float
) -> ListedSolid:
    nowhere = np.empty((0, 3))
    try:
        facets = read_facets(entities, number, unit_mm)
    except UnreadFacetsError as error:
        damage = f"tessellated geometry only (#{number}), of it {error}"
        return ListedSolid(number, inside, 0, nowhere, None, None, damage)
    return ListedSolid(number, inside, 0, nowhere, None, facets)


def linked_facets(entities: dict[int, StepEntity]) -> set[int]:
    """Return the numbers of the tessellated solids that only draw other solids of the file."""
    return {
        number
        for number, entity in entities.items()
        if entity.kind in TESSELLATED_SOLIDS and is_linked(entities, number)
    }


def _count_faces(entities: dict[int, StepEntity], number: int, depth: int = 0) -> int:
    entity = entities.get(number)
    if entity is None or depth > 2 or entity.kind not in _SHELL_KINDS:
        return 0
    if entity.kind.startswith("ORIENTED"):
        return sum(_count_faces(entities, ref, depth + 1) for ref in entity.references)
    return len(set(entity.references))


def _point(entities: dict[int, StepEntity], vertex: int) -> list[float] | None:
    places = [entities[ref] for ref in entities[vertex].references if ref in entities]
    numbers = places[0].numbers if places and places[0].kind == "CARTESIAN_POINT" else []
    return numbers if len(numbers) == 3 else None


def _closed_shells(entities: dict[int, StepEntity]) -> set[int]:
    return {number for number, entity in entities.items() if entity.kind == "CLOSED_SHELL"}


def _shells_of_surfaces(entities: dict[int, StepEntity]) -> set[int]:
    """Return the shells that are surfaces by intent, such as supplemental geometry."""
    models = [entity for entity in entities.values() if entity.kind.endswith("SURFACE_MODEL")]
    return {ref for model in models for ref in model.references}


def _units(entities: dict[int, StepEntity], context: int | None) -> tuple[float, float | None]:
    """Return millimetres per unit, 1 if the file states none, and the uncertainty in mm."""
    stated = (
        [ref for ref in entities[context].references if ref in entities]
        if context in entities
        else []
    )
    lengths = [unit_mm(entities, ref) for ref in stated if "LENGTH_UNIT" in entities[ref].kinds]
    uncertainties = [
        _uncertainty_mm(entities, ref) for ref in stated if "UNCERTAINTY" in entities[ref].kind
    ]
    known = [x for x in uncertainties if x is not None]
    return lengths[0] if lengths else 1.0, max(known, default=None)


def _uncertainty_mm(entities: dict[int, StepEntity], number: int) -> float | None:
    entity = entities[number]
    units = [
        ref for ref in entity.references if ref in entities and "LENGTH_UNIT" in entities[ref].kinds
    ]
    value = entity.numbers[0] * unit_mm(entities, units[0]) if units and entity.numbers else -1.0
    return value if value > 0 and math.isfinite(value) else None


def unit_mm(entities: dict[int, StepEntity], number: int, depth: int = 0) -> float:
    """Return the millimetres in a unit of length."""
    entity = entities[number]
    si = _SI_METRE.search(entity.text)
    if si and (si[1] or "").upper() in _PREFIX_MM:
        return _PREFIX_MM[(si[1] or "").upper()]
    for measure in (entities[ref] for ref in entity.references if ref in entities):
        if "MEASURE_WITH_UNIT" in measure.kind and measure.numbers and depth < 4:
            factors = [
                unit_mm(entities, ref, depth + 1) for ref in measure.references if ref in entities
            ]
            if factors and measure.numbers[0] > 0:
                return measure.numbers[0] * factors[0]
    raise ReadError(
        f"the length unit of a STEP file must be a multiple of the metre. Got #{number}={entity.text[:60]}."
    )
