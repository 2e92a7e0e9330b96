"""OBJ and OFF files: text with shared vertices and polygons."""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from aspectgraph.exceptions import ReadError
from aspectgraph.read.numbers import decode_text, parse_integer, parse_real

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
