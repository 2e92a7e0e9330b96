"""PLY files, text and binary."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from aspectgraph.exceptions import ReadError

_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8",
}  # fmt: skip
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
    vertices, polygons = None, None
    for element in elements:
        rows = source.read(element)
        names = [prop[0] for prop in element.properties]
        if element.name == "vertex":
            vertices = _columns(rows, names)
        elif element.name == "face":
            column = next((names.index(n) for n in ("vertex_indices", "vertex_index") if n in names), None)
            if column is None:
                raise ReadError(f"a PLY face must have vertex_indices. Got {names}.")
            polygons = [[int(i) for i in row[column]] for row in rows]
    if vertices is None or not polygons:
        raise ReadError("a PLY file must hold vertices and faces. Got none.")
    for f, polygon in enumerate(polygons):
        if len(polygon) < 3 or min(polygon) < 0 or max(polygon) >= len(vertices):
            raise ReadError(f"a PLY face must list 3 or more existing vertices. Got {polygon[:8]} in face {f}.")
    return vertices, polygons


def _columns(rows: list, names: list[str]) -> np.ndarray:
    try:
        columns = [names.index(axis) for axis in "xyz"]
    except ValueError as error:
        raise ReadError(f"a PLY vertex must have x, y and z. Got {names}.") from error
    return np.array([[float(row[c]) for c in columns] for row in rows], dtype=np.float64).reshape(-1, 3)


def _parse_header(data: bytes) -> tuple[str, list[_Element], bytes]:
    end = data.find(b"end_header")
    if not data.startswith(b"ply") or end < 0:
        raise ReadError("a PLY file must begin with a header from ply to end_header. Got none.")
    line_end = data.find(b"\n", end)
    body = data[line_end + 1 :] if line_end >= 0 else b""
    order, elements = None, []
    for line in data[:end].decode("latin-1").splitlines():
        words = line.split()
        try:
            if words[:1] == ["format"]:
                order = _ORDERS[words[1]]
            elif words[:1] == ["element"]:
                elements.append(_Element(words[1], int(words[2])))
            elif words[:1] == ["property"]:
                *kind, name = words[1:]
                types = [_TYPES[word] for word in (kind[1:] if kind[0] == "list" else kind)]
                if len(types) != (2 if kind[0] == "list" else 1):
                    raise ValueError("wrong number of types")
                elements[-1].properties.append((name, *types))
        except (KeyError, IndexError, ValueError) as error:
            raise ReadError(f"a PLY header line must follow the format. Got {line.strip()[:60]!r}.") from error
    if order is None:
        raise ReadError("a PLY header must name its format. Got none.")
    return order, elements, body


class _TextSource:
    def __init__(self, body: bytes):
        self.words = iter(body.decode("latin-1").split())

    def read(self, element: _Element) -> list[list]:
        try:
            return [[self._value(prop) for prop in element.properties] for _ in range(element.count)]
        except StopIteration as error:
            raise ReadError(f"a PLY file must hold the rows it counts. Got too few of {element.name}.") from error
        except ValueError as error:
            raise ReadError(f"a PLY value must be a number. Got {error} in {element.name}.") from error

    def _value(self, prop: tuple[str, ...]):
        if len(prop) == 2:
            return float(next(self.words))
        return [float(next(self.words)) for _ in range(int(next(self.words)))]


class _BinarySource:
    def __init__(self, body: bytes, order: str):
        self.body, self.order, self.at = body, order, 0

    def read(self, element: _Element) -> list[list]:
        try:
            if all(len(prop) == 2 for prop in element.properties):
                fields = [(f"{i}", self.order + prop[1]) for i, prop in enumerate(element.properties)]
                return self._take(np.dtype(fields), element.count).tolist()
            return [[self._value(prop) for prop in element.properties] for _ in range(element.count)]
        except ValueError as error:
            raise ReadError(f"a PLY file must hold the rows it counts. Got too few of {element.name}.") from error

    def _take(self, dtype: np.dtype, count: int) -> np.ndarray:
        taken = np.frombuffer(self.body, dtype, count, self.at) if count else np.empty(0, dtype)
        self.at += dtype.itemsize * count
        return taken

    def _value(self, prop: tuple[str, ...]):
        if len(prop) == 2:
            return self._take(np.dtype(self.order + prop[1]), 1)[0]
        count = int(self._take(np.dtype(self.order + prop[1]), 1)[0])
        return self._take(np.dtype(self.order + prop[2]), count)
