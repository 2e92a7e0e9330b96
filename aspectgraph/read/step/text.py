"""The text of a STEP file: its entities, what they refer to, and whether every character is part of one.

The kernel skips what it does not understand. This reader understands little, but skips nothing: it is what the kernel's
result is checked against.

Reference: ISO 10303-21:2016, clear text encoding of the exchange structure.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from aspectgraph.exceptions import ReadError

_STRING_OR_COMMENT = re.compile(r"'[^']*'|/\*.*?\*/", re.DOTALL)
_DATA = re.compile(r"\bDATA\s*(?:\([^;]*\))?\s*;(.*?)\bENDSEC\s*;", re.DOTALL)
_NEXT = r"(?=\s*[,)])"
_TOKEN = re.compile(
    rf"""\s+|\((?=\s*[^,;\s])|,(?=\s*[^,);\s])|\)(?=\s*[,);A-Z!])|;|=(?=\s*[(A-Z!])
    |(?:'')+{_NEXT}|"[0-9A-F]*"{_NEXT}|[$*]{_NEXT}|\.[A-Z_][A-Z0-9_]*\.{_NEXT}|!?[A-Z_][A-Z0-9_]*(?=\s*\()
    |\#[0-9]+(?=\s*[,)=])|[+-]?[0-9]+(?:\.[0-9]*(?:E[+-]?[0-9]+)?)?{_NEXT}""",
    re.VERBOSE | re.IGNORECASE | re.ASCII,
)
_STRING = re.compile(r"'(?:[^']|'')*'")
_STATEMENT = re.compile(r"#([0-9]+)\s*=((?:[^;']|'[^']*')*);")
_ENTITY = re.compile(r"\s*#([0-9]+)\s*=\s*(.*)", re.DOTALL)
_NAME = re.compile(r"([A-Z_][A-Z0-9_]*)\s*\(", re.IGNORECASE)
_REFERENCE = re.compile(r"#([0-9]+)")
_NUMBER = re.compile(r"(?<=[(,\s])[+-]?[0-9]+(?:\.[0-9]*(?:E[+-]?[0-9]+)?)?", re.IGNORECASE)


@dataclass(frozen=True)
class StepEntity:
    """One entity of a STEP file.

    Attributes
    ----------
    kind : str
        Its type in capitals; of a complex entity, the first one.
    text : str
        All of it after the equals sign; texts in it are empty.
    """

    kind: str
    text: str

    @property
    def references(self) -> list[int]:
        """The numbers of the entities referred to, in order."""
        return [int(number) for number in _REFERENCE.findall(self.text)]

    @property
    def numbers(self) -> list[float]:
        """The numbers in it, in order."""
        return [float(number) for number in _NUMBER.findall(self.text)]

    @property
    def kinds(self) -> frozenset[str]:
        """All type names in it."""
        return frozenset(name.upper() for name in _NAME.findall(self.text))


def parse_entities(data: bytes) -> dict[int, StepEntity]:
    """Return the entities of a STEP file by number, in file order.

    Parameters
    ----------
    data : bytes
        The file.

    Raises
    ------
    ReadError
        There is no data section, something in it is no token of the format, or a number is used twice.
    """
    text = _STRING_OR_COMMENT.sub(
        lambda match: "''" if match[0][0] == "'" else " ", data.decode("latin-1")
    )
    sections = _DATA.findall(text)
    if not sections:
        raise ReadError(
            "a STEP file must hold a data section from DATA to ENDSEC. Got none that is whole."
        )
    entities: dict[int, StepEntity] = {}
    for section in sections:
        _check_tokens(section)
        for statement in section.split(";"):
            _add(entities, statement)
    return entities


def _check_tokens(section: str) -> None:
    remainder = _TOKEN.sub("", section)
    if remainder:
        raise ReadError(
            f"a STEP file must be whole. Got {remainder[:20]!r} where a number, text or name should be."
        )


def _add(entities: dict[int, StepEntity], statement: str) -> None:
    if not statement.strip():
        return
    match = _ENTITY.fullmatch(statement)
    name = _NAME.search(match[2]) if match else None
    if not match or not name:
        raise ReadError(
            f"a STEP file must be whole. Got {statement.strip()[:40]!r} where an entity should be."
        )
    number = int(match[1])
    if number in entities:
        raise ReadError(
            f"the entities of a STEP file must have numbers of their own. Got #{number} twice."
        )
    entities[number] = StepEntity(name[1].upper(), match[2])


def parse_texts(
    data: bytes, entities: dict[int, StepEntity], kinds: Iterable[str]
) -> dict[int, tuple[str, ...]]:
    """Return the texts in entities of some kinds by number, which `parse_entities` leaves out.

    Parameters
    ----------
    data : bytes
        The file.
    entities : dict
        See `parse_entities`, of the same file.
    kinds : iterable of str
        Types in capitals.

    Returns
    -------
    dict of int to tuple of str
        The texts of each entity in their order, with single quotation marks.
    """
    kind_set = frozenset(kinds)
    numbers = {number for number, entity in entities.items() if kind_set & entity.kinds}
    if not numbers:
        return {}
    text = _STRING_OR_COMMENT.sub(
        lambda match: match[0] if match[0][0] == "'" else " ", data.decode("latin-1")
    )
    texts_of: dict[int, tuple[str, ...]] = {}
    for number, statement in _STATEMENT.findall(text):
        if int(number) in numbers:
            texts = (string[1:-1].replace("''", "'") for string in _STRING.findall(statement))
            texts_of[int(number)] = tuple(texts)
    return texts_of


def known_references(entities: dict[int, StepEntity], entity: StepEntity) -> list[int]:
    """Return what an entity refers to and the file holds."""
    return [number for number in entity.references if number in entities]


def reachable(entities: dict[int, StepEntity], start: int) -> set[int]:
    """Return the numbers of the entities that one refers to, directly or through others, and its own."""
    numbers = {start}
    front = [start]
    while front:
        for number in entities[front.pop()].references:
            if number in entities and number not in numbers:
                numbers.add(number)
                front.append(number)
    return numbers


# Tessellated solids of AP242: facets that the file states, with no surface behind them.
#
# They are taken from the text, as the file has them. The kernel only says where an assembly puts
# them: it crashes when asked for anything else of a face without a surface.
#
# Reference: ISO 10303-42, tessellated geometry.


TESSELLATED_SOLIDS = frozenset({"TESSELLATED_SOLID"})

_WITH_AREA = frozenset(
    f"{prefix}TRIANGULATED_{suffix}"
    for prefix in ("", "COMPLEX_", "CUBIC_BEZIER_")
    for suffix in ("FACE", "SURFACE_SET")
)
_SETS = frozenset({"TESSELLATED_GEOMETRIC_SET", "TESSELLATED_SHELL"})
_WITHOUT_AREA = frozenset({"TESSELLATED_CONNECTING_EDGE", "TESSELLATED_EDGE", "TESSELLATED_VERTEX"})
_STATED_TOKEN = re.compile(r"[(),]|''|\$|\*|#[0-9]+|[-+0-9.Ee]+|\.[A-Za-z_0-9]+\.|[A-Za-z_0-9]+")


@dataclass(frozen=True)
class StatedFacets:
    """The facets of a tessellated solid.

    Attributes
    ----------
    vertices : ndarray, shape (n, 3)
        In mm; every face of the solid may have its own copies.
    triangles : ndarray of int, shape (t, 3)
        In either orientation.
    """

    vertices: np.ndarray
    triangles: np.ndarray

    def moved(self, matrix: np.ndarray) -> StatedFacets:
        """Return the facets where an assembly puts them.

        Parameters
        ----------
        matrix : ndarray, shape (3, 4)
            The placement, in mm.
        """
        return StatedFacets(self.vertices @ matrix[:, :3].T + matrix[:, 3], self.triangles)


class UnreadFacetsError(Exception):
    """A tessellated solid has something that is not read; the message says what."""


def is_linked(entities: dict[int, StepEntity], number: int) -> bool:
    """Return whether a tessellated solid or shell only draws another one of the file."""
    parameters = _parameters(entities[number].text)
    link = parameters[2] if len(parameters) > 2 else None
    return isinstance(link, str) and link.startswith("#") and int(link[1:]) in entities


def list_loose(entities: dict[int, StepEntity]) -> list[int]:
    """Return the tessellated faces that belong to no solid and draw none, and are no part of an annotation."""
    # few files have any; to look for the words first saves a third of a second for 20,000 entities
    faces = [
        number
        for number, entity in entities.items()
        if "TRIANGULATED" in entity.text.upper() and not _WITH_AREA.isdisjoint(entity.kinds)
    ]
    if not faces:
        return []
    owned: set[int] = set()
    for number, entity in entities.items():
        is_solid = not TESSELLATED_SOLIDS.isdisjoint(entity.kinds)
        is_drawing = entity.kind == "TESSELLATED_SHELL" and is_linked(entities, number)
        if is_solid or is_drawing or any("ANNOTATION" in kind for kind in entity.kinds):
            owned.update(entity.references)
    for number in sorted(owned & set(entities)):
        if not _SETS.isdisjoint(entities[number].kinds):
            owned.update(entities[number].references)
    return [number for number in faces if number not in owned]


def read_facets(entities: dict[int, StepEntity], number: int, unit_mm: float) -> StatedFacets:
    """Return the facets of a tessellated solid, before any placement in an assembly.

    Parameters
    ----------
    entities : dict
        Those of the file.
    number : int
        The solid's.
    unit_mm : float
        Millimetres in the unit of the solid's context.

    Raises
    ------
    UnreadFacetsError
        The solid has an item that is not read, or one that is damaged.
    """
    vertices: list[np.ndarray] = []
    triangles: list[np.ndarray] = []
    n = 0
    for item in entities[number].references:
        face = entities.get(item)
        if face is not None and face.kind in _WITHOUT_AREA:
            continue
        try:
            points, corners = _read_face(entities, item, face)
        except (IndexError, TypeError, ValueError) as error:
            kind = "nothing" if face is None else face.kind
            raise UnreadFacetsError(f"{kind} #{item}, which is damaged") from error
        vertices.append(points * unit_mm)
        triangles.append(corners + n)
        n += len(points)
    if not triangles:
        raise UnreadFacetsError(f"#{number} without facets")
    return StatedFacets(np.concatenate(vertices), np.concatenate(triangles))


def _read_face(
    entities: dict[int, StepEntity], number: int, face: StepEntity | None
) -> tuple[np.ndarray, np.ndarray]:
    """Return the points and the corners of the triangles of a face."""
    if face is None:
        raise ValueError("a reference to nothing")
    if face.text.lstrip().startswith("("):
        raise UnreadFacetsError(f"{'+'.join(sorted(face.kinds))[:80]} #{number}, which is not read")
    if face.kind not in ("TRIANGULATED_FACE", "COMPLEX_TRIANGULATED_FACE"):
        raise UnreadFacetsError(f"{face.kind} #{number}, which is not read")
    parameters = _parameters(face.text)
    points = _read_points(entities, parameters[1])
    rows = parameters[6]
    if face.kind == "COMPLEX_TRIANGULATED_FACE":
        rows = [*_strips(parameters[6]), *_fans(parameters[7])]
    corners = _whole_numbers(rows).reshape(-1, 3) - 1
    index = parameters[5]
    if index:
        corners = _picked(_whole_numbers(index) - 1, corners)
    _picked(points, corners)
    return points, corners


def _whole_numbers(values: Any) -> np.ndarray:
    numbers = np.array(values, dtype=np.float64)
    if (numbers != np.floor(numbers)).any():
        raise ValueError("a vertex number that is not whole")
    return numbers.astype(np.int64)


def _picked(rows: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Return rows by their places from 0; numpy would count negative ones from the end."""
    if places.size and int(places.min()) < 0:
        raise IndexError("a number below one")
    picked: np.ndarray = rows[places]
    return picked


def _strips(strips: Sequence[Sequence[float]]) -> list[list[float]]:
    """Return the triangles of strips; every other one runs the other way round."""
    rows = []
    for strip in strips:
        for k in range(len(strip) - 2):
            a, b, c = strip[k : k + 3]
            rows.append([a, b, c] if k % 2 == 0 else [b, a, c])
    return rows


def _fans(fans: Sequence[Sequence[float]]) -> list[list[float]]:
    return [[fan[0], fan[k], fan[k + 1]] for fan in fans for k in range(1, len(fan) - 1)]


def _read_points(entities: dict[int, StepEntity], reference: str) -> np.ndarray:
    listed = entities.get(int(reference[1:]))
    if listed is None or listed.kind != "COORDINATES_LIST":
        raise ValueError("no list of coordinates")
    _, count, rows = _parameters(listed.text)[:3]
    points = np.array(rows, dtype=np.float64).reshape(-1, 3)
    if len(points) != count or not np.isfinite(points).all():
        raise ValueError("a wrong count of points, or a point that is none")
    return points


def _parameters(text: str) -> list[Any]:
    """Return the parameters of an entity: numbers, lists, and words as they are."""
    stack: list[list[Any]] = [[]]
    for token in _STATED_TOKEN.findall(text[text.index("(") :]):
        if token == "(":
            stack.append([])
        elif token == ")":
            closed = stack.pop()
            stack[-1].append(closed)
        elif token != ",":
            stack[-1].append(float(token) if token[0] in "+-0123456789" else token)
    parameters: list[Any] = stack[0][0]
    return parameters


# Parts that a STEP file mirrors or scales: the kernel turns the first and tears the second apart,
# and says nothing.
#
# A part is placed by two coordinate systems, or by a transformation operator. Only the operator
# can mirror and scale.
#
# Reference: ISO 10303-42, cartesian_transformation_operator_3d and the function base_axis.


SAME_SCALE = 1e-9
"""A scale that differs from 1 by less, relatively, is 1 with rounded digits."""

_OPERATOR = "CARTESIAN_TRANSFORMATION_OPERATOR_3D"
_ARGUMENTS = re.compile(rf"{_OPERATOR}\s*\(([^()]*)\)", re.IGNORECASE)
_RELATION = "REPRESENTATION_RELATIONSHIP_WITH_TRANSFORMATION"


def check_operators(entities: dict[int, StepEntity], solid_kinds: frozenset[str]) -> None:
    """Check that no operator that places a part mirrors or scales it.

    Parameters
    ----------
    entities : dict
        See `text.parse_entities`.
    solid_kinds : frozenset of str
        The types that are solids.

    Raises
    ------
    ReadError
        A part is mirrored or scaled; the message names the operator.
    """
    for number in sorted(set(_placing_operators(entities, solid_kinds))):
        arguments = _arguments(entities[number])
        if arguments is None:
            continue
        axis1, axis2, _, scale, axis3 = arguments
        size = 1.0 if scale == "$" else float(scale)
        if abs(size - 1.0) > SAME_SCALE:
            raise ReadError(
                "the parts of a STEP file must be placed in their own size. "
                f"Got #{number}, which scales a part by {size:g}."
            )
        if _mirrors(*(_direction(entities, axis) for axis in (axis1, axis2, axis3))):
            raise ReadError(
                "the parts of a STEP file must be moved and turned only. "
                f"Got #{number}, which mirrors a part; export the mirrored part as one of its own."
            )


def _placing_operators(
    entities: dict[int, StepEntity], solid_kinds: frozenset[str]
) -> Iterator[int]:
    """Go through the operators that place a part; those of drawings and views place none."""
    for entity in entities.values():
        if _RELATION not in entity.kinds and "MAPPED_ITEM" not in entity.kinds:
            continue
        used = known_references(entities, entity)
        operators = [number for number in used if _OPERATOR in entities[number].kinds]
        if not operators:
            continue
        if _RELATION in entity.kinds or any(
            entities[inner].kind in solid_kinds
            for number in used
            for inner in reachable(entities, number)
        ):
            yield from operators


def _arguments(entity: StepEntity) -> list[str] | None:
    """Return axis 1 and 2, origin, scale and axis 3 as the file writes them; None if it has another form."""
    match = _ARGUMENTS.search(entity.text)
    if match is None:
        return None
    arguments = [argument.strip() for argument in match[1].split(",")]
    return arguments[-5:] if len(arguments) >= 5 else None


def _direction(entities: dict[int, StepEntity], reference: str) -> np.ndarray | None:
    """Return the numbers of a direction, shape (3,); None if it is not given."""
    entity = entities.get(int(reference[1:])) if reference.startswith("#") else None
    if entity is None or len(entity.numbers) != 3:
        return None
    return np.array(entity.numbers)


def _mirrors(axis1: np.ndarray | None, axis2: np.ndarray | None, axis3: np.ndarray | None) -> bool:
    """Return whether the axes of an operator are left-handed; the second one decides, if it is given."""
    if axis2 is None:
        return False
    z = np.array([0.0, 0.0, 1.0]) if axis3 is None else axis3
    if axis1 is None:
        along_x = not z[1] and not z[2]
        axis1 = np.array([0.0, 1.0, 0.0] if along_x else [1.0, 0.0, 0.0])
    return bool(np.cross(axis1, axis2) @ z < 0.0)


# What a STEP file says it holds, read from its text: solids with faces and vertices, the unit,
# its uncertainty.


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
UNIT_NOTE = "lengths in the file are in"
"""How the note of a solid begins whose file is not in mm."""
_UNIT_NAMES = {1.0: "mm", 10.0: "cm", 25.4: "inches", 304.8: "feet", 1e3: "m", 1e-3: "µm"}
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
    unit_mm : float
        Millimetres in the unit of its lengths.
    """

    number: int
    entities: set[int]
    n_faces: int
    points_mm: np.ndarray
    uncertainty_mm: float | None
    facets: StatedFacets | None = None
    damage: str = ""
    unit_mm: float = 1.0


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
    numbers: set[int] = set()
    front = list(solids)
    while front:
        for number in users.get(front.pop(), ()):
            if number in numbers:
                continue
            numbers.add(number)
            front.append(number)
            entity = entities[number]
            # what other representations hold is theirs; their context has the unit
            used = known_references(entities, entity)
            held = entity.kind.endswith("REPRESENTATION") and entity.kind not in _PLACING
            for reference in used[-1:] if held else used:
                if not entities[reference].kind.endswith("REPRESENTATION"):
                    numbers |= _reachable_without_representations(entities, reference)
                elif reference not in numbers:
                    numbers.add(reference)
                    front.append(reference)
    return numbers


def _reachable_without_representations(entities: dict[int, StepEntity], start: int) -> set[int]:
    """Return the numbers of what an entity refers to, and its own, but nothing that representations hold."""
    numbers = {start}
    front = [start]
    while front:
        for number in known_references(entities, entities[front.pop()]):
            if number not in numbers and not entities[number].kind.endswith("REPRESENTATION"):
                numbers.add(number)
                front.append(number)
    return numbers


def _is_complex_solid(entity: StepEntity) -> bool:
    return entity.text.lstrip().startswith("(") and not SOLID_KINDS.isdisjoint(entity.kinds)


def _listed(entities: dict[int, StepEntity], number: int, context: int | None) -> ListedSolid:
    inside = reachable(entities, number)
    unit_mm, uncertainty_mm = _units(entities, context)
    n_faces = sum(_count_faces(entities, ref) for ref in entities[number].references)
    points = [_point(entities, i) for i in sorted(inside) if entities[i].kind == "VERTEX_POINT"]
    if entities[number].kind in TESSELLATED_SOLIDS:
        return _listed_facets(entities, number, inside, unit_mm)
    coordinates = np.array([p for p in points if p is not None], dtype=np.float64).reshape(-1, 3)
    coordinates *= unit_mm
    return ListedSolid(number, inside, n_faces, coordinates, uncertainty_mm, unit_mm=unit_mm)


def _listed_facets(
    entities: dict[int, StepEntity], number: int, inside: set[int], unit_mm: float
) -> ListedSolid:
    nowhere = np.empty((0, 3))
    try:
        facets = read_facets(entities, number, unit_mm)
    except UnreadFacetsError as error:
        damage = f"tessellated geometry only (#{number}), of it {error}"
        return ListedSolid(number, inside, 0, nowhere, None, None, damage, unit_mm)
    return ListedSolid(number, inside, 0, nowhere, None, facets, unit_mm=unit_mm)


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
    values = [x for x in uncertainties if x is not None]
    return lengths[0] if lengths else 1.0, max(values, default=None)


def _uncertainty_mm(entities: dict[int, StepEntity], number: int) -> float | None:
    entity = entities[number]
    units = [
        ref for ref in entity.references if ref in entities and "LENGTH_UNIT" in entities[ref].kinds
    ]
    value = entity.numbers[0] * unit_mm(entities, units[0]) if units and entity.numbers else -1.0
    return value if value > 0 and math.isfinite(value) else None


def notes_on_units(solids: Iterable[ListedSolid]) -> list[str]:
    """Return a note if lengths of the file are not in mm: a reader would not find its numbers."""
    lengths = sorted({solid.unit_mm for solid in solids})
    if lengths in ([], [1.0]):
        return []
    names = [_UNIT_NAMES.get(round(length, 6), f"units of {length:.6g} mm") for length in lengths]
    return [f"{UNIT_NOTE} {' and '.join(names)}; here all are in mm"]


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


# Which errors of a STEP file are damage of its solids, and which only of what is written about
# them.
#
# The kernel marks every entity that it cannot read. A solid depends on what it refers to, and on
# what places it. The rest of a file are dimensions, tolerances, annotations, styles and
# properties: a solid is the same without them.


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
