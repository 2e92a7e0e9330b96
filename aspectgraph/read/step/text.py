"""The text of a STEP file: its entities, what they refer to, and whether every character is part of one.

The kernel skips what it does not understand. This reader understands little, but skips nothing: it is what the kernel's
result is checked against.

Reference: ISO 10303-21:2016, clear text encoding of the exchange structure.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass

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
        lambda found: "''" if found[0][0] == "'" else " ", data.decode("latin-1")
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
    rest = _TOKEN.sub("", section)
    if rest:
        raise ReadError(
            f"a STEP file must be whole. Got {rest[:20]!r} where a number, text or name should be."
        )


def _add(entities: dict[int, StepEntity], statement: str) -> None:
    if not statement.strip():
        return
    found = _ENTITY.fullmatch(statement)
    name = _NAME.search(found[2]) if found else None
    if not found or not name:
        raise ReadError(
            f"a STEP file must be whole. Got {statement.strip()[:40]!r} where an entity should be."
        )
    number = int(found[1])
    if number in entities:
        raise ReadError(
            f"the entities of a STEP file must have numbers of their own. Got #{number} twice."
        )
    entities[number] = StepEntity(name[1].upper(), found[2])


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
    wanted = frozenset(kinds)
    numbers = {number for number, entity in entities.items() if wanted & entity.kinds}
    if not numbers:
        return {}
    text = _STRING_OR_COMMENT.sub(
        lambda found: found[0] if found[0][0] == "'" else " ", data.decode("latin-1")
    )
    found: dict[int, tuple[str, ...]] = {}
    for number, statement in _STATEMENT.findall(text):
        if int(number) in numbers:
            texts = (one[1:-1].replace("''", "'") for one in _STRING.findall(statement))
            found[int(number)] = tuple(texts)
    return found


def known_references(entities: dict[int, StepEntity], entity: StepEntity) -> list[int]:
    """Return what an entity refers to and the file holds."""
    return [number for number in entity.references if number in entities]


def reachable(entities: dict[int, StepEntity], start: int) -> set[int]:
    """Return the numbers of the entities that one refers to, directly or through others, and its own."""
    found = {start}
    front = [start]
    while front:
        for number in entities[front.pop()].references:
            if number in entities and number not in found:
                found.add(number)
                front.append(number)
    return found
