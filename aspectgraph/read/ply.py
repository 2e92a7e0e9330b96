"""PLY files, text and binary."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from aspectgraph.exceptions import ReadError
from aspectgraph.read.numbers import decode_text, parse_integer, parse_real

_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8",
}  # fmt: skip
_REALS = ("f4", "f8")
_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": ""}


@dataclass
class _Element:
    """One table of the file; a property is (name, type) or (name, count type, item type)."""

    name: str
    count: int
    properties: list[tuple[str, ...]] = field(default_factory=list)


def parse_ply(data: bytes) -> tuple[np.ndarray, list[list[int]]]:
    """Return the vertices and polygons of a PLY file.

    Raises
    ------
    ReadError
        The file is cut off or malformed, or holds no polygons.
    """
    order, elements, body = _parse_header(data)
    source = _TextSource(body) if not order else _BinarySource(body, order)
    vertices = None
    polygons = None
    for element in elements:
        rows = source.read(element)
        names = [prop[0] for prop in element.properties]
        if element.name == "vertex":
            vertices = _columns(rows, names)
        elif element.name == "face":
            column = next(
                (names.index(n) for n in ("vertex_indices", "vertex_index") if n in names), None
            )
            if column is None or len(element.properties[column]) != 3:
                raise ReadError(f"a PLY face must have a list of vertex_indices. Got {names}.")
            polygons = [_polygon(row[column], f) for f, row in enumerate(rows)]
    source.check_end()
    if vertices is None or not polygons:
        raise ReadError("a PLY file must hold vertices and faces. Got none.")
    for f, polygon in enumerate(polygons):
        if len(polygon) < 3 or min(polygon) < 0 or max(polygon) >= len(vertices):
            raise ReadError(
                f"a PLY face must list 3 or more existing vertices. Got {polygon[:8]} in face {f}."
            )
    return vertices, polygons


def _polygon(values: Sequence[float], f: int) -> list[int]:
    """Return the vertex numbers of a face; a file may store them as real numbers, but not fractions."""
    values = list(values)
    if not all(math.isfinite(value) and value == int(value) for value in values):
        raise ReadError(f"a PLY face must list whole vertex numbers. Got {values[:8]} in face {f}.")
    return [int(value) for value in values]


def _columns(rows: list[Any], names: list[str]) -> np.ndarray:
    try:
        columns = [names.index(axis) for axis in "xyz"]
        return np.array(
            [[float(row[c]) for c in columns] for row in rows], dtype=np.float64
        ).reshape(-1, 3)
    except TypeError as error:
        raise ReadError("the x, y and z of a PLY vertex must be numbers. Got lists.") from error
    except ValueError as error:
        raise ReadError(f"a PLY vertex must have x, y and z. Got {names}.") from error


def _parse_header(data: bytes) -> tuple[str, list[_Element], bytes]:
    data = data.removeprefix(b"\xef\xbb\xbf")
    end = data.find(b"end_header")
    if not data.startswith(b"ply") or end < 0:
        raise ReadError("a PLY file must begin with a header from ply to end_header. Got none.")
    line_end = data.find(b"\n", end)
    body = data[line_end + 1 :] if line_end >= 0 else b""
    order: str | None = None
    elements: list[_Element] = []
    for line in decode_text(data[:end]).splitlines():
        words = line.split()
        try:
            if words[:1] == ["format"]:
                order = _ORDERS[words[1]]
            elif words[:1] == ["element"]:
                _check_new(words[1], [element.name for element in elements])
                elements.append(_Element(words[1], _count(words[2])))
            elif words[:1] == ["property"]:
                *kind, name = words[1:]
                _check_new(name, [prop[0] for prop in elements[-1].properties])
                types = [_TYPES[word] for word in (kind[1:] if kind[0] == "list" else kind)]
                if len(types) != (2 if kind[0] == "list" else 1) or (
                    len(types) == 2 and types[0] in _REALS
                ):
                    raise ValueError("wrong types")
                elements[-1].properties.append((name, *types))
            elif words and words[0] not in ("ply", "comment", "obj_info"):
                raise ValueError("no keyword")
        except (KeyError, IndexError, ValueError) as error:
            raise ReadError(
                f"a PLY header line must follow the format. Got {line.strip()[:60]!r}."
            ) from error
    if order is None:
        raise ReadError("a PLY header must name its format. Got none.")
    return order, elements, body


def _check_new(name: str, names: list[str]) -> None:
    if name in names:
        raise ValueError("a name used twice")


def _count(word: str) -> int:
    count = parse_integer(word)
    if count < 0:
        raise ValueError("a negative count")
    return count


class _TextSource:
    def __init__(self, body: bytes) -> None:
        self.words = decode_text(body).split()
        self.at = 0

    def read(self, element: _Element) -> list[list[Any]]:
        # every value is a word, and every list begins with one: no more rows than that are ever made
        if not element.properties:
            return []
        if element.count * len(element.properties) > len(self.words) - self.at:
            raise _too_few(element)
        try:
            return [
                [self._value(prop) for prop in element.properties] for _ in range(element.count)
            ]
        except IndexError as error:
            raise _too_few(element) from error
        except ValueError as error:
            raise ReadError(
                f"a PLY value must be a number of its type. Got {error} in {element.name}."
            ) from error

    def _value(self, prop: tuple[str, ...]) -> Any:
        if len(prop) == 2:
            return self._next(prop[1])
        count = self._next(prop[1])
        if count < 0:
            raise ValueError(f"a list of {count}")
        return [self._next(prop[2]) for _ in range(int(count))]

    def _next(self, kind: str) -> int | float:
        self.at += 1
        word = self.words[self.at - 1]
        return parse_real(word) if kind in _REALS else parse_integer(word)

    def check_end(self) -> None:
        if self.at < len(self.words):
            raise ReadError(
                f"a PLY file must count all its rows. Got {self.words[self.at][:20]!r} after the last one."
            )


class _BinarySource:
    def __init__(self, body: bytes, order: str) -> None:
        self.body = body
        self.order = order
        self.at = 0

    def read(self, element: _Element) -> list[list[Any]]:
        if not element.properties:
            return []
        if element.count * len(element.properties) > len(self.body) - self.at:
            raise _too_few(element)
        try:
            if all(len(prop) == 2 for prop in element.properties):
                fields = [
                    (f"{i}", self.order + prop[1]) for i, prop in enumerate(element.properties)
                ]
                return self._take(np.dtype(fields), element.count).tolist()
            return [
                [self._value(prop) for prop in element.properties] for _ in range(element.count)
            ]
        except ValueError as error:
            raise _too_few(element) from error

    def _take(self, dtype: np.dtype, count: int) -> np.ndarray:
        if count < 0:
            raise ValueError("a negative count")
        taken = np.frombuffer(self.body, dtype, count, self.at) if count else np.empty(0, dtype)
        self.at += dtype.itemsize * count
        return taken

    def _value(self, prop: tuple[str, ...]) -> Any:
        if len(prop) == 2:
            return self._take(np.dtype(self.order + prop[1]), 1)[0]
        count = int(self._take(np.dtype(self.order + prop[1]), 1)[0])
        return self._take(np.dtype(self.order + prop[2]), count).tolist()

    def check_end(self) -> None:
        rest = len(self.body[self.at :].strip(b"\0\r\n "))
        if rest:
            raise ReadError(
                f"a PLY file must count all its rows. Got {rest} bytes after the last one."
            )


def _too_few(element: _Element) -> ReadError:
    return ReadError(f"a PLY file must hold the rows it counts. Got too few of {element.name}.")
