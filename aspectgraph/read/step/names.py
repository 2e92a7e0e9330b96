"""What the solids of a STEP file are called: their products, their bodies, and the instances of an assembly.

A solid has the name of the product that it shapes, the name that the file gives to the solid itself, and one for each
place of an assembly on the way to it. They are read from the text of the file, as everything that the kernel's result
is compared with.

Reference: ISO 10303-21:2016, 6.4.3 (texts); ISO 10303-44 (products and their occurrences).
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterable
from dataclasses import dataclass, field

from aspectgraph.read.step.text import (
    OCCURRENCES,
    SOLID_KINDS,
    StepEntity,
    known_references,
    parse_texts,
)

_FIRST_TWO = re.compile(r"\(\s*((?:'')+|\$|\*)\s*(?:,\s*((?:'')+|\$|\*))?")
_DIRECTIVE = re.compile(
    r"\\X2\\((?:[0-9A-F]{4})*)\\X0\\|\\X4\\((?:[0-9A-F]{8})*)\\X0\\|\\X\\([0-9A-F]{2})|\\S\\(.)"
    r"|\\P([A-I])\\|\\\\",
    re.DOTALL,
)
_LINE_BREAKS = re.compile(r"[\r\n]+")
# OCCT names an occurrence without a name by the label of its own document
_NO_NAME = re.compile(r"=>\[[0-9:]*\]")
_RELATION = "SHAPE_REPRESENTATION_RELATIONSHIP"


@dataclass(frozen=True)
class Occurrence:
    """A place of a product in an assembly.

    Attributes
    ----------
    assembly, product : int
        Numbers of the definitions of the assembly and of what is placed in it.
    name : str
        Its name; empty if it has none.
    """

    assembly: int
    product: int
    name: str


@dataclass(frozen=True)
class StepNames:
    """The names in a STEP file.

    Attributes
    ----------
    products : dict of int to str
        The name of the product that each solid shapes, by the number of the solid.
    bodies : dict of int to str
        The name of the solid itself.
    occurrences : dict of int to Occurrence
        Those of an assembly, by number.
    """

    products: dict[int, str] = field(default_factory=dict)
    bodies: dict[int, str] = field(default_factory=dict)
    occurrences: dict[int, Occurrence] = field(default_factory=dict)


def read_names(data: bytes, entities: dict[int, StepEntity], solids: Iterable[int]) -> StepNames:
    """Return what solids are called, and where the products are placed.

    Parameters
    ----------
    data : bytes
        The file.
    entities : dict
        See `text.parse_entities`, of the same file.
    solids : iterable of int
        Numbers of the solids.

    Returns
    -------
    StepNames
        A product without a name has its identifier instead.
    """
    texts = parse_texts(data, entities, SOLID_KINDS | OCCURRENCES | {"PRODUCT"})
    first_two = {number: _first_two(entities[number], texts[number]) for number in texts}
    names = StepNames()
    chain = _Chain(entities)
    for number in solids:
        names.bodies[number] = first_two.get(number, ("", ""))[0]
        identifier, name = first_two.get(chain.product_of(number), ("", ""))
        names.products[number] = name or identifier
    for number, entity in entities.items():
        definitions = known_references(entities, entity)
        if entity.kind in OCCURRENCES and len(definitions) > 1:
            name = first_two.get(number, ("", ""))[1]
            name = _NO_NAME.sub("", name)
            names.occurrences[number] = Occurrence(definitions[0], definitions[1], name)
    return names


def _first_two(entity: StepEntity, texts: tuple[str, ...]) -> tuple[str, str]:
    """Return the first two parameters of an entity as texts; one that is left out is empty."""
    match = _FIRST_TWO.search(entity.text)
    if match is None:
        return "", ""
    remaining = list(texts)
    values = ["", ""]
    for k in (0, 1):
        if (match[k + 1] or "").startswith("'") and remaining:
            values[k] = decode_text(remaining.pop(0)).strip()
    return values[0], values[1]


def decode_text(text: str) -> str:
    r"""Return a text of a STEP file in plain characters.

    Parameters
    ----------
    text : str
        As `text.parse_texts` returns it: a byte for each character.

    Returns
    -------
    str
        Line breaks are left out, as the standard says. Bytes that are UTF-8 are read as such, others as ISO 8859-1.

    Examples
    --------
    >>> decode_text(r"Geh\X2\00E4\X0\use"), decode_text(r"Geh\S\duse"), decode_text(r"Geh\X\E4use")
    ('Gehäuse', 'Gehäuse', 'Gehäuse')
    """
    plain = _LINE_BREAKS.sub("", text)
    with contextlib.suppress(UnicodeError):
        plain = plain.encode("latin-1").decode("utf-8")
    page = "A"

    def meant(match: re.Match[str]) -> str:
        nonlocal page
        if match[1] is not None:
            return bytes.fromhex(match[1]).decode("utf-16-be", "replace")
        if match[2] is not None:
            return bytes.fromhex(match[2]).decode("utf-32-be", "replace")
        if match[3] is not None:
            return chr(int(match[3], 16))
        if match[4] is not None:
            code = (ord(match[4]) & 0x7F) | 0x80
            return bytes([code]).decode(f"iso8859-{ord(page) - ord('A') + 1}", "replace")
        if match[5] is not None:
            page = match[5]
            return ""
        return "\\"

    return _DIRECTIVE.sub(meant, plain)


class _Chain:
    """Leads from a solid to its product.

    A representation holds the solid, others may be related to it without a move or use it as a mapped item; one of
    them is the shape of a product's definition.
    """

    def __init__(self, entities: dict[int, StepEntity]) -> None:
        self.entities = entities
        self._links: dict[int, list[int]] = {}
        self._definitions: dict[int, int] = {}
        for number, entity in entities.items():
            used = known_references(entities, entity)
            if entity.kind == _RELATION and len(used) > 1:
                self._link(used[0], used[1])
                self._link(used[1], used[0])
            elif entity.kind == "SHAPE_DEFINITION_REPRESENTATION" and len(used) > 1:
                self._define(used[0], used[1])
            elif entity.kind.endswith("REPRESENTATION"):
                # the last one is the context
                for reference in used[:-1]:
                    self._link(reference, number)
            elif entity.kind in ("REPRESENTATION_MAP", "MAPPED_ITEM") and used:
                self._link(used[-1 if entity.kind == "REPRESENTATION_MAP" else 0], number)

    def _link(self, start: int, end: int) -> None:
        self._links.setdefault(start, []).append(end)

    def _define(self, shape: int, representation: int) -> None:
        """Remember the product definition of a representation; those of faces and places are not."""
        for number in known_references(self.entities, self.entities[shape]):
            kind = self.entities[number].kind
            if kind.startswith("PRODUCT_DEFINITION") and kind not in OCCURRENCES:
                self._definitions.setdefault(representation, number)

    def product_of(self, solid: int) -> int:
        """Return the number of the product, or -1."""
        numbers = {solid}
        front = [solid]
        # the nearest one: what is linked later is farther
        for number in front:
            if number in self._definitions:
                return self._product(self._definitions[number])
            for linked in self._links.get(number, ()):
                if linked not in numbers:
                    numbers.add(linked)
                    front.append(linked)
        return -1

    def _product(self, definition: int) -> int:
        """Return the product of a definition, by way of its formation."""
        front = [definition]
        for _ in range(3):
            front = [k for n in front for k in known_references(self.entities, self.entities[n])]
            for number in front:
                if self.entities[number].kind == "PRODUCT":
                    return number
        return -1
