"""Mesh files: their formats, and how their facets become a solid."""

from __future__ import annotations

import heapq
import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from aspectgraph.exceptions import OrientationError, ReadError
from aspectgraph.files import ReadLimits, more_of
from aspectgraph.phases import phase
from aspectgraph.read.glb import parse_glb
from aspectgraph.read.join_faces import Tessellation, assemble, find_twins
from aspectgraph.solid.checks import (
    check_vertices,
    default_planarity_mm,
    face_area_vectors,
    face_outwards,
)
from aspectgraph.solid.solid import Solid
from aspectgraph.solid.topology import (
    FaceLoops,
    describe_edge,
    label_shells,
    pair_edges,
    triangulate_faces,
)

# STL files, binary and text, read strictly: what is damaged is refused, never shortened.


# Numbers in text files, read strictly.
#
# Python's own ``float`` and ``int`` take more than any mesh format allows: ``1_0`` for 10, digits
# of other scripts. What is no number in the format is a damaged number, and must not become
# another one.


_REAL = re.compile(r"[+-]?(?:(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?|nan|inf(?:inity)?)")
_INTEGER = re.compile(r"[+-]?[0-9]{1,18}")
_BYTE_ORDER_MARK = b"\xef\xbb\xbf"


def parse_real(word: str) -> float:
    """Return a decimal number; ``nan`` and ``inf`` are numbers too, for the reader to refuse where they matter.

    Raises
    ------
    ValueError
        The word is not a number.
    """
    if not _REAL.fullmatch(word.lower()):
        raise ValueError(f"{word[:40]!r}")
    return float(word)


def parse_integer(word: str) -> int:
    """Return an integer of at most 18 digits.

    Raises
    ------
    ValueError
        The word is not one.
    """
    if not _INTEGER.fullmatch(word):
        raise ValueError(f"{word[:40]!r}")
    return int(word)


def decode_text(data: bytes) -> str:
    """Return a file as text, without the byte order mark some editors put in front.

    Keywords and numbers are ASCII in every format; names may be in any encoding, so each byte becomes one character.
    """
    return data.removeprefix(_BYTE_ORDER_MARK).decode("latin-1")


# OBJ and OFF files: text with shared vertices and polygons.


_OBJ_UNSUPPORTED = {"curv", "curv2", "surf", "cstype", "parm", "trim", "hole", "end"}
_OBJ_SKIPPED = {
    "vt", "vn", "vp", "g", "o", "s", "mg", "mtllib", "usemtl", "maplib", "usemap", "bevel", "c_interp", "d_interp",
    "lod", "shadow_obj", "trace_obj", "ctech", "stech", "call", "csh", "deg", "bmat", "step", "con", "sp", "scrv",
    "bzp", "bsp", "cdc", "cdp", "res",
}  # fmt: skip
_MTL_LINES = {
    "ka", "kd", "ks", "ke", "ns", "ni", "d", "tr", "tf", "illum", "sharpness", "aniso",
    "anisor", "pr", "pm", "ps", "pc", "pcr", "map_ka", "map_kd", "map_ks", "map_ke", "map_ns",
    "map_d", "map_tr", "map_aat", "map_bump", "map_opacity", "map_refl", "map_pr", "map_pm",
    "map_ps", "map_rma", "map_orm", "bump", "disp", "decal", "refl", "norm",
}  # fmt: skip
"""Keywords of a material, in small letters: some programs write materials into the file itself."""

_OFF_KEYWORD = re.compile("(ST)?C?N?OFF|off")


def parse_obj(data: bytes, notes: list[str]) -> tuple[np.ndarray, list[list[int]]]:
    """Return the vertices and polygons of a Wavefront OBJ file.

    Normals, texture coordinates, colours, groups and materials are not geometry and are skipped; negative indices count
    from the last vertex read so far. Materials may stand in the file itself: ``newmtl`` and the lines that follow it.
    Any other line that begins with no keyword of the format is refused, for a vertex that is overlooked shifts the
    numbers of all others.

    Raises
    ------
    ReadError
        A line is malformed, an index does not exist, or the file uses free-form surfaces.
    """
    vertices: list[list[float]] = []
    polygons: list[list[int]] = []
    n_lines = 0
    in_material = False
    text = decode_text(data).replace("\\\r\n", " ").replace("\\\n", " ")
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.split("#", 1)[0].split()
        if not words:
            continue
        in_material = words[0] == "newmtl" or (in_material and words[0].lower() in _MTL_LINES)
        if in_material:
            continue
        if words[0] == "v":
            vertices.append(_obj_vertex(words[1:], number))
        elif words[0] in ("f", "fo"):
            polygons.append([_obj_index(word, len(vertices), number) for word in words[1:]])
        elif words[0] in ("l", "p"):
            n_lines += 1
        elif words[0] in _OBJ_UNSUPPORTED:
            raise ReadError(
                f"an OBJ file must hold polygons. Got free-form geometry ({words[0]!r}) in line {number}."
            )
        elif words[0] not in _OBJ_SKIPPED:
            raise ReadError(
                f"an OBJ line must begin with a keyword. Got {words[0][:20]!r} in line {number}."
            )
    if n_lines:
        notes.append(f"ignored {n_lines} loose lines and points")
    return _checked(vertices, polygons, "OBJ")


def _obj_vertex(words: list[str], number: int) -> list[float]:
    """Return the coordinates of a vertex; a weight or a colour may follow."""
    values = _floats(words, number, "OBJ")
    if len(values) not in (3, 4, 6, 7) or (len(values) in (4, 7) and values[3] != 1.0):
        text = " ".join(words)[:40]
        raise ReadError(
            f"an OBJ vertex must have three numbers and no weight but 1. Got {text!r} in line {number}."
        )
    return values[:3]


def _obj_index(word: str, n_vertices: int, number: int) -> int:
    try:
        index = parse_integer(word.split("/", 1)[0])
    except ValueError as error:
        raise ReadError(
            f"an OBJ face must list vertex numbers. Got {word!r} in line {number}."
        ) from error
    if index > 0:
        return index - 1
    return n_vertices + index if index < 0 else -1


def parse_off(data: bytes) -> tuple[np.ndarray, list[list[int]]]:
    """Return the vertices and polygons of a text OFF file; colours, normals and texture coordinates are skipped.

    Raises
    ------
    ReadError
        The file is binary, of another dimension than three, cut off or malformed.
    """
    lines = [line.split("#", 1)[0].split() for line in decode_text(data).splitlines()]
    rows = [(number, row) for number, row in enumerate(lines, start=1) if row]
    keyword = rows[0][1][0] if rows else ""
    if not _OFF_KEYWORD.fullmatch(keyword) or "BINARY" in (word.upper() for word in rows[0][1]):
        raise ReadError(
            f"a text OFF file must begin with OFF, COFF, NOFF or STOFF. Got {keyword[:20]!r}."
        )
    head = rows[0][1][1:]
    body = rows[1:]
    if not head and body:
        head = body[0][1]
        body = body[1:]
    try:
        n_vertices = parse_integer(head[0])
        n_faces = parse_integer(head[1])
    except (ValueError, IndexError) as error:
        raise ReadError(
            f"an OFF file must count its vertices and faces. Got {' '.join(head)[:40]!r}."
        ) from error
    if n_vertices < 0 or n_faces < 0 or len(body) != n_vertices + n_faces:
        raise ReadError(
            f"an OFF file must hold the rows it counts. Got {n_vertices} + {n_faces} counted, {len(body)} present."
        )
    vertices = [_off_vertex(row, number, keyword) for number, row in body[:n_vertices]]
    polygons = [_off_polygon(row, number) for number, row in body[n_vertices:]]
    return _checked(vertices, polygons, "OFF")


def _off_vertex(row: list[str], number: int, keyword: str) -> list[float]:
    values = _floats(row, number, "OFF")
    # four and five numbers would be a weight, or texture coordinates that the keyword does not announce
    if keyword in ("OFF", "off") and len(values) not in (3, 6, 7):
        text = " ".join(row)[:40]
        raise ReadError(
            f"an OFF vertex must have three numbers, or three and a colour. Got {text!r} in line {number}."
        )
    return values[:3]


def _off_polygon(row: list[str], number: int) -> list[int]:
    try:
        size = parse_integer(row[0])
        indices = [parse_integer(word) for word in row[1 : size + 1]]
    except ValueError as error:
        raise ReadError(
            f"an OFF face must list vertex numbers. Got {' '.join(row)[:40]!r} in line {number}."
        ) from error
    if len(indices) != size:
        raise ReadError(
            f"an OFF face must hold the indices it counts. Got {len(indices)} of {size} in line {number}."
        )
    return indices


def _floats(words: list[str], number: int, kind: str) -> list[float]:
    """Return the numbers of a row, three at least."""
    try:
        values = [parse_real(word) for word in words]
        if len(values) < 3:
            raise ValueError("too few")
    except ValueError as error:
        text = " ".join(words)[:40]
        raise ReadError(
            f"an {kind} vertex must have three numbers. Got {text!r} in line {number}."
        ) from error
    return values


def _checked(
    vertices: list[Any], polygons: list[list[int]], kind: str
) -> tuple[np.ndarray, list[list[int]]]:
    for f, polygon in enumerate(polygons):
        if len(polygon) < 3:
            raise ReadError(
                f"an {kind} face must have at least 3 vertices. Got {len(polygon)} in face {f}."
            )
        if min(polygon) < 0 or max(polygon) >= len(vertices):
            raise ReadError(
                f"an {kind} face must list existing vertices. Got {[v + 1 for v in polygon[:8]]} of {len(vertices)} "
                f"(counted from 1) in face {f}."
            )
    if not polygons:
        raise ReadError(f"an {kind} file must hold faces. Got 0.")
    return np.array(vertices, dtype=np.float64).reshape(-1, 3), polygons


# PLY files, text and binary.


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
        n_bytes = len(self.body[self.at :].strip(b"\0\r\n "))
        if n_bytes:
            raise ReadError(
                f"a PLY file must count all its rows. Got {n_bytes} bytes after the last one."
            )


def _too_few(element: _Element) -> ReadError:
    return ReadError(f"a PLY file must hold the rows it counts. Got too few of {element.name}.")


_HEADER = 84
_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def parse_stl(data: bytes, notes: list[str]) -> tuple[np.ndarray, np.ndarray]:
    """Return the corners and triangles of an STL file.

    A file whose length fits its facet count is binary, whatever its header says; so is one that does not begin with
    ``solid`` or that holds a zero byte. A few bytes after the last facet, less than another one, are ignored and noted.

    Parameters
    ----------
    data : bytes
        The file.
    notes : list of str
        Extended by what was noticed.

    Returns
    -------
    vertices : ndarray, shape (3 t, 3)
        Three corners per facet, not yet welded.
    triangles : ndarray of int, shape (t, 3)

    Raises
    ------
    ReadError
        The file is cut off, or a line is not STL.
    """
    count = int.from_bytes(data[80:_HEADER], "little") if len(data) >= _HEADER else -1
    fits = count >= 0 and len(data) == _HEADER + _FACET.itemsize * count
    text = b"\0" not in data and data.lstrip(b"\xef\xbb\xbf \t\r\n")[:5].lower() == b"solid"
    corners = (
        _parse_text(decode_text(data)) if text and not fits else _parse_binary(data, count, notes)
    )
    if not len(corners):
        raise ReadError("an STL file must hold facets. Got 0.")
    return corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3)


def _parse_binary(data: bytes, count: int, notes: list[str]) -> np.ndarray:
    if count < 0:
        raise ReadError(f"a binary STL file must have at least {_HEADER} bytes. Got {len(data)}.")
    room, spare = divmod(len(data) - _HEADER, _FACET.itemsize)
    if not count and room:
        raise ReadError(f"a binary STL file must count its facets. Got 0 counted, {room} present.")
    if count != room:
        raise ReadError(
            f"a binary STL file must hold the facets its header counts. Got {count} counted, {room} whole ones present."
        )
    if spare:
        notes.append(f"ignored {spare} bytes after the last facet")
    return np.frombuffer(data, _FACET, count, _HEADER)["corners"].astype(np.float64)


def _parse_text(text: str) -> np.ndarray:
    corners: list[list[list[float]]] = []
    loop: list[list[float]] | None = None
    closed = False
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.lower().split()
        keyword = words[0] if words else ""
        if keyword == "facet":
            if loop is not None:
                raise ReadError(
                    f"an STL facet must end before the next begins. Got a new one in line {number}."
                )
            loop = []
        elif keyword == "vertex" and loop is not None:
            loop.append(_numbers(words, number))
        elif keyword in ("endfacet", "end_facet"):
            corners.append(_whole(loop, number))
            loop = None
        elif keyword not in (
            "",
            "solid",
            "endsolid",
            "end_solid",
            "outer",
            "endloop",
            "end_loop",
            "color",
        ):
            raise ReadError(
                f"a text STL file must hold facets of vertex lines. Got {line.strip()[:40]!r} in line {number}."
            )
        closed = keyword in ("endsolid", "end_solid") or (closed and not keyword)
    if loop is not None or not closed:
        raise ReadError(
            f"a text STL file must end with endsolid. Got an end after {len(corners)} facets."
        )
    return np.array(corners).reshape(-1, 3, 3)


def _numbers(words: list[str], number: int) -> list[float]:
    try:
        x, y, z = (parse_real(word) for word in words[1:])
    except ValueError as error:
        raise ReadError(
            f"an STL vertex must have three numbers. Got {' '.join(words)!r} in line {number}."
        ) from error
    return [x, y, z]


def _whole(loop: list[list[float]] | None, number: int) -> list[list[float]]:
    if loop is None or len(loop) != 3:
        n = 0 if loop is None else len(loop)
        raise ReadError(f"an STL facet must have 3 vertices. Got {n} before line {number}.")
    return loop


# Triangle meshes: welded, cleaned, turned outwards and joined into faces. Every repair is noted,
# nothing is guessed.
#
# What is done, in this order
# ---------------------------
# 1. Coordinates are converted to mm; polygons are cut into triangles; equal vertices become one.
# 2. Facets that use a vertex twice, and repetitions of a facet, are dropped.
# 3. If the surface is not closed then: facets without area are dropped; then vertices closer than ``weld_mm`` become
#    one. A step is kept only if the surface is closed after it. A T-junction or a missing facet stays an error.
# 4. Facets that disagree with their neighbours are reversed, then bodies that are inside out.
# 5. Facets without area that are left are taken out by turning their longest sides, where no vertex need move.
# 6. Coplanar facets become faces, and facets of curved surfaces are recognised (see `curved_facets`).


# Facets without area taken out of a closed surface, without moving a vertex.
#
# A facet whose corners lie on one line has its middle corner on its longest side. The facet on
# the other side of that side passes the corner by. Turning the side (an edge flip) makes it end
# at the corner, and the facet without area is gone; the surface is the same. Longest facets go
# first: where two without area are neighbours, the side turned is then the longest of both, and
# it becomes shorter.


_MOST_TURNS = 50
"""Turns tried for every facet without area, before what is left is left as it is."""


def turn_thin(
    vertices: np.ndarray, triangles: np.ndarray, width_mm: float, notes: list[str]
) -> np.ndarray:
    """Take out the facets no wider than `width_mm` by turning their longest sides; note how many.

    Parameters
    ----------
    vertices : ndarray, shape (n, 3)
        In mm.
    triangles : ndarray of int, shape (t, 3)
        Closed and oriented.
    width_mm : float
        Facets no wider have no area; the surface moves by no more than this.
    notes : list of str
        Gets a line if anything was done.

    Returns
    -------
    ndarray of int, shape (t', 3)
        Closed and oriented, with the same vertices in use. A facet whose middle corner is as close as `width_mm` to
        another one stays, and so does one whose turn would join two vertices a second time.
    """
    n_thin = _count_thin(vertices, triangles, width_mm)
    if not n_thin:
        return triangles
    surface = _Turner(vertices, triangles, width_mm)
    for _ in range(_MOST_TURNS * n_thin):
        if not surface.turn_next():
            break
    rows = surface.rows()
    n_gone = n_thin - _count_thin(vertices, rows, width_mm)
    if n_gone:
        notes.append(f"took out {n_gone} facets without area by turning their longest sides")
    return rows


def _count_thin(vertices: np.ndarray, triangles: np.ndarray, width_mm: float) -> int:
    return int((_widths(vertices, triangles)[0] <= width_mm).sum())


def _widths(vertices: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the heights of triangles over their longest sides, and these, in mm."""
    corners = vertices[triangles]
    doubled_area = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    longest = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).max(axis=1)
    return np.divide(doubled_area, longest, out=np.zeros_like(longest), where=longest > 0), longest


class _Turner:
    """State of `turn_thin`: the triangles, their directed sides, and the thin ones in order."""

    def __init__(self, vertices: np.ndarray, triangles: np.ndarray, width_mm: float) -> None:
        self.vertices = vertices
        self.width_mm = width_mm
        self.triangles: list[tuple[int, int, int]] = [tuple(row) for row in triangles.tolist()]
        self.side = {pair: t for t, row in enumerate(self.triangles) for pair in _sides(row)}
        self.queue: list[tuple[float, int, tuple[int, int, int]]] = []
        self._note_thin(range(len(self.triangles)))

    def rows(self) -> np.ndarray:
        """Return the triangles as an array."""
        return np.array(self.triangles, dtype=np.int64).reshape(-1, 3)

    def turn_next(self) -> bool:
        """Turn the longest side of the next thin triangle, if it may be; return whether there was one."""
        if not self.queue:
            return False
        _, t, row = heapq.heappop(self.queue)
        if self.triangles[t] != row:
            return True
        p, q, apex = self._longest_side(row)
        across = self.side[q, p]
        far = next(v for v in self.triangles[across] if v not in (p, q))
        joined = far == apex or (far, apex) in self.side or (apex, far) in self.side
        if joined or not self._between(p, q, apex):
            return True
        for pair in (*_sides(row), *_sides(self.triangles[across])):
            del self.side[pair]
        for k, new in ((t, (p, far, apex)), (across, (far, q, apex))):
            self.triangles[k] = new
            self.side.update(dict.fromkeys(_sides(new), k))
        self._note_thin((t, across))
        return True

    def _note_thin(self, which: Iterable[int]) -> None:
        index = np.array(list(which), dtype=np.int64)
        width, length = _widths(
            self.vertices, np.array([self.triangles[t] for t in index.tolist()])
        )
        for t, size in zip(
            index[width <= self.width_mm].tolist(), length[width <= self.width_mm], strict=True
        ):
            heapq.heappush(self.queue, (-float(size), t, self.triangles[t]))

    def _longest_side(self, row: tuple[int, int, int]) -> tuple[int, int, int]:
        sizes = [float(np.linalg.norm(self.vertices[b] - self.vertices[a])) for a, b in _sides(row)]
        k = int(np.argmax(sizes))
        return row[k], row[(k + 1) % 3], row[(k + 2) % 3]

    def _between(self, p: int, q: int, apex: int) -> bool:
        """Return whether a vertex lies between two others, and not at one of them."""
        start, end, middle = self.vertices[[p, q, apex]]
        return bool(
            min(np.linalg.norm(middle - start), np.linalg.norm(middle - end)) > self.width_mm
        )


def _sides(row: tuple[int, int, int]) -> tuple[tuple[int, int], ...]:
    a, b, c = row
    return (a, b), (b, c), (c, a)


# Vertices made one, and facets that say nothing dropped.


def weld(vertices: np.ndarray, distance_mm: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Merge vertices that are equal or, if a distance is given, linked by steps no longer than it.

    Returns
    -------
    vertices : ndarray, shape (m, 3)
        In order of first appearance; of merged ones the first stays where it is.
    new : ndarray of int, shape (n,)
        The new index of every old vertex.
    """
    if distance_mm > 0:
        pairs = cKDTree(vertices).query_pairs(distance_mm, output_type="ndarray")
        n = len(vertices)
        links = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
        label = connected_components(links, directed=False)[1]
    else:
        label = _label_rows(vertices)
    _, first = np.unique(label, return_index=True)
    order = np.argsort(first)
    rank = np.empty(len(first), dtype=np.int64)
    rank[order] = np.arange(len(first))
    return vertices[first[order]], rank[label]


def _label_rows(rows: np.ndarray) -> np.ndarray:
    """Number the rows of an array, equal ones alike."""
    order = np.lexsort(rows.T)
    ordered = rows[order]
    label = np.zeros(len(rows), dtype=np.int64)
    label[order[1:]] = np.cumsum((ordered[1:] != ordered[:-1]).any(axis=1))
    return label


def is_closed(triangles: np.ndarray) -> bool:
    """Return whether every edge, whichever way it runs, has exactly two triangles."""
    if not len(triangles):
        return False
    start = triangles.ravel()
    end = np.roll(triangles, -1, axis=1).ravel()
    key = np.minimum(start, end) * (int(triangles.max()) + 1) + np.maximum(start, end)
    return bool((np.unique(key, return_counts=True)[1] == 2).all())


def drop_repetitions(triangles: np.ndarray, notes: list[str]) -> np.ndarray:
    """Drop triangles that use a vertex twice, and all but the first of equal ones; note how many."""
    whole = (triangles != np.roll(triangles, 1, axis=1)).all(axis=1)
    if not whole.all():
        notes.append(f"dropped {int((~whole).sum())} facets that use a vertex twice")
        triangles = triangles[whole]
    if not len(triangles):
        return triangles
    turn = np.argmin(triangles, axis=1)[:, None] + np.arange(3)
    canonical = np.take_along_axis(triangles, turn % 3, axis=1)
    first = np.unique(_label_rows(canonical), return_index=True)[1]
    first.sort()
    if len(first) < len(triangles):
        notes.append(f"dropped {len(triangles) - len(first)} repeated facets")
    return triangles[first]


def drop_thin(
    vertices: np.ndarray, triangles: np.ndarray, width_mm: float, notes: list[str]
) -> np.ndarray:
    """Drop triangles no wider than `width_mm`; note how many."""
    corners = vertices[triangles]
    doubled_area = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    longest = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).max(axis=1)
    thin = doubled_area <= width_mm * longest
    if thin.any():
        notes.append(f"dropped {int(thin.sum())} facets without area")
    return triangles[~thin]


UNITS_MM = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "um": 1e-3, "inch": 25.4, "ft": 304.8}
"""Millimetres in one of each unit."""

_RELATIVE_WIDTH = 1e-3
"""Facets narrower than this share of the planarity tolerance have no area."""


def read_mesh(
    data: bytes,
    suffix: str,
    *,
    units: str | None = None,
    planarity_mm: float | None = None,
    name: str = "",
    limits: ReadLimits | None = None,
) -> Solid:
    """Return the solid bounded by the triangles of a mesh file.

    Parameters
    ----------
    data : bytes
        The file, unpacked.
    suffix : {".stl", ".obj", ".ply", ".off", ".glb"}
        Its format.
    units : str, optional
        A key of `UNITS_MM`; default "m" for .glb, "mm" otherwise.
    planarity_mm : float, optional
        See `assemble`; also the ``weld_mm`` of the module's description. Default: 10⁻⁶ of the bounding box diagonal.
    name : str
        Name of the part.
    limits : ReadLimits, optional
        Most triangles to make of the file.

    Raises
    ------
    ReadError
        The file is damaged or exceeds a limit, a coordinate is not finite, or `units` is unknown.
    SolidError
        The surface is open, not manifold, or crosses or touches itself.
    """
    notes: list[str] = []
    scale = _scale(units, suffix)
    max_triangles = (limits or ReadLimits()).triangles
    # a signalling NaN warns when it is widened; numbers that are not finite are refused below
    with phase("read the facets"), np.errstate(all="ignore"):
        vertices, polygons = _parse(data, suffix, notes, max_triangles)
    bad = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
    if len(bad):
        raise ReadError(
            f"coordinates must be finite. Got {vertices[bad[0]].tolist()} at vertex {bad[0]} of the file."
        )
    with np.errstate(over="ignore"):
        vertices = check_vertices(vertices * scale)
    with phase("repair the facets"):
        mesh, tolerance = repair_facets(vertices, polygons, planarity_mm, notes)
    return assemble(mesh, name=name, planarity_mm=tolerance, notes=notes)


def repair_facets(
    vertices: np.ndarray, polygons: Any, planarity_mm: float | None, notes: list[str]
) -> tuple[Tessellation, float]:
    """Do steps 1 to 5 of the module's description.

    Parameters
    ----------
    vertices : ndarray, shape (n, 3)
        In mm.
    polygons : ndarray of int, shape (t, 3), or list of list of int
        Triangles, or polygons of any size.
    planarity_mm : float, optional
        See `read_mesh`.
    notes : list of str
        Extended by what was repaired.

    Returns
    -------
    facets : Tessellation
        One patch of facets, closed, oriented outwards.
    tolerance_mm : float
        The planarity tolerance, or its default.

    Raises
    ------
    ReadError
        There are fewer than four facets.
    SolidError
        The surface is open, not manifold, or has one side only.
    """
    vertices, triangles = _welded_triangles(vertices, polygons, notes)
    if len(triangles) < 4:
        raise ReadError(f"a closed mesh must have at least 4 facets. Got {len(triangles)}.")
    tolerance = default_planarity_mm(vertices) if planarity_mm is None else planarity_mm
    vertices, triangles = _close(vertices, triangles, tolerance, notes)
    triangles = turn_thin(
        vertices, _orient(vertices, triangles, notes), tolerance * _RELATIVE_WIDTH, notes
    )
    patch = np.zeros(len(triangles), dtype=np.int64)
    flat = np.zeros(1, dtype=bool)
    return Tessellation(vertices, triangles, patch, flat, faceted_patches={0}), tolerance


def _parse(
    data: bytes, suffix: str, notes: list[str], most_triangles: int
) -> tuple[np.ndarray, np.ndarray | list[list[int]]]:
    """Return vertices and polygons as the format has them."""
    if suffix == ".glb":
        return parse_glb(data, notes, most_triangles)
    polygons: np.ndarray | list[list[int]]
    if suffix == ".stl":
        vertices, polygons = parse_stl(data, notes)
    elif suffix == ".obj":
        vertices, polygons = parse_obj(data, notes)
    else:
        vertices, polygons = (parse_ply if suffix == ".ply" else parse_off)(data)
    n = (
        len(polygons)
        if isinstance(polygons, np.ndarray)
        else sum(len(polygon) - 2 for polygon in polygons)
    )
    if n > most_triangles:
        raise ReadError.of_rule(
            "",
            f"a mesh file must hold at most triangles={most_triangles} triangles",
            str(n),
            **more_of("triangles"),
        )
    return vertices, polygons


def check_units(units: str) -> None:
    """Refuse a unit that is not known.

    Parameters
    ----------
    units : str
        Must be a key of `UNITS_MM`.

    Raises
    ------
    ReadError
        If it is not.
    """
    if units not in UNITS_MM:
        raise ReadError.of_rule("units", f"must be one of {', '.join(UNITS_MM)}", repr(units))


def _scale(units: str | None, suffix: str) -> float:
    units = units or ("m" if suffix == ".glb" else "mm")
    check_units(units)
    return UNITS_MM[units]


def _welded_triangles(
    vertices: np.ndarray, polygons: Any, notes: list[str]
) -> tuple[np.ndarray, np.ndarray]:
    """Merge equal vertices and cut polygons into triangles."""
    vertices, new = weld(vertices)
    if isinstance(polygons, np.ndarray):
        return vertices, drop_repetitions(new[polygons], notes)
    loops = [_without_repetitions([int(new[v]) for v in polygon]) for polygon in polygons]
    # what has no area stays as a triangle without one
    triangles = [np.repeat(new[polygon[0]], 3)[None] for polygon in polygons]
    whole = [f for f, loop in enumerate(loops) if len(loop) >= 3]
    for f, cut in zip(whole, _cut_polygons(vertices, loops, whole), strict=True):
        triangles[f] = cut
    return vertices, drop_repetitions(np.concatenate(triangles).astype(np.int64), notes)


def _without_repetitions(loop: list[int]) -> list[int]:
    """Return a loop without vertices that follow themselves."""
    return [v for v, before in zip(loop, [loop[-1], *loop[:-1]], strict=True) if v != before]


def _cut_polygons(
    vertices: np.ndarray, polygons: list[list[int]], whole: list[int]
) -> tuple[np.ndarray, ...]:
    """Return the triangles of these polygons, by their numbers in the file."""
    if not whole:
        return ()
    loops = FaceLoops.of_cycles([[polygons[f]] for f in whole])
    normals = face_area_vectors(vertices, loops)
    for f, normal in zip(whole, normals, strict=True):
        loop = polygons[f]
        if len(loop) > 3 and (len(set(loop)) < len(loop) or not normal.any()):
            raise ReadError(
                f"a polygon must be simple and have an area. Got polygon {f} of the file."
            )
    return triangulate_faces(
        vertices, loops, normals, lambda face: f"polygon {whole[face]} of the file"
    )


def _close(
    vertices: np.ndarray, triangles: np.ndarray, weld_mm: float, notes: list[str]
) -> tuple[np.ndarray, np.ndarray]:
    """Try the repairs of step 3; return the mesh unchanged if none of them closes it."""
    if is_closed(triangles):
        return vertices, triangles
    attempt_notes: list[str] = []
    attempt = drop_thin(vertices, triangles, weld_mm * _RELATIVE_WIDTH, attempt_notes)
    if is_closed(attempt):
        notes.extend(attempt_notes)
        return vertices, attempt
    merged, new = weld(vertices, weld_mm)
    if len(merged) < len(vertices):
        attempt_notes = [
            f"merged {len(vertices) - len(merged)} vertices closer than {weld_mm:.3g} mm to another"
        ]
        attempt = drop_repetitions(new[triangles], attempt_notes)
        if not is_closed(attempt):
            attempt = drop_thin(merged, attempt, weld_mm * _RELATIVE_WIDTH, attempt_notes)
        if is_closed(attempt):
            notes.extend(attempt_notes)
            return merged, attempt
    _complain(vertices, triangles)
    return vertices, triangles


def _complain(vertices: np.ndarray, triangles: np.ndarray) -> None:
    """Raise what is wrong with a surface that is not closed, with the place."""
    pair_edges(vertices, FaceLoops.of_triangles(triangles))


def _orient(vertices: np.ndarray, triangles: np.ndarray, notes: list[str]) -> np.ndarray:
    triangles, n_reversed = _agree(vertices, triangles)
    if n_reversed:
        notes.append(f"reversed {n_reversed} facets that disagreed with their neighbours")
    twin = find_twins(triangles)
    pairs = np.stack([np.arange(len(twin)) // 3, twin // 3], axis=1)
    triangles, n_turned = face_outwards(vertices, triangles, label_shells(len(triangles), pairs))
    if n_turned:
        notes.append(f"turned {n_turned} bodies that were inside out")
    return triangles


def _agree(vertices: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, int]:
    """Reverse facets until neighbours agree; in every piece the larger party stays."""
    neighbours, agrees = _neighbours(triangles)
    if agrees.all():
        return triangles, 0
    party = np.full(len(triangles), -1, dtype=np.int64)
    turn = np.zeros(len(triangles), dtype=bool)
    for seed in range(len(triangles)):
        if party[seed] >= 0:
            continue
        party[seed] = 0
        front = [seed]
        piece = [seed]
        while front:
            t = front.pop()
            for k in range(3):
                n = neighbours[t, k]
                side = party[t] ^ (not agrees[t, k])
                if party[n] < 0:
                    party[n] = side
                    front.append(n)
                    piece.append(n)
                elif party[n] != side:
                    text = describe_edge(vertices, *np.roll(triangles[t], -k)[:2].tolist())
                    raise OrientationError(
                        f"a surface must have two sides. Got one side only at the {text}."
                    )
        minority = 1 if 2 * party[piece].sum() <= len(piece) else 0
        turn[piece] = party[piece] == minority
    return np.where(turn[:, None], triangles[:, ::-1], triangles), int(turn.sum())


def _neighbours(triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return for every half-edge of a closed surface the triangle across, and whether it runs the other way there."""
    start = triangles.ravel()
    end = np.roll(triangles, -1, axis=1).ravel()
    key = np.minimum(start, end) * (int(triangles.max()) + 1) + np.maximum(start, end)
    order = np.argsort(key, kind="stable").reshape(-1, 2)
    across = np.empty(len(key), dtype=np.int64)
    across[order[:, 0]] = order[:, 1]
    across[order[:, 1]] = order[:, 0]
    return (across // 3).reshape(-1, 3), (start == end[across]).reshape(-1, 3)
