"""OBJ and OFF files: text with shared vertices and polygons."""

from __future__ import annotations

import numpy as np

from aspectgraph.exceptions import ReadError

_OBJ_UNSUPPORTED = {"curv", "curv2", "surf", "cstype", "parm", "trim", "hole", "end"}


def parse_obj(data: bytes, notes: list[str]) -> tuple[np.ndarray, list[list[int]]]:
    """Return the vertices and polygons of a Wavefront OBJ file.

    Normals, texture coordinates, colours, groups and materials are not geometry and are skipped; negative indices count
    from the last vertex read so far.

    Raises
    ------
    ReadError
        A line is malformed, an index does not exist, or the file uses free-form surfaces.
    """
    vertices: list[list[float]] = []
    polygons: list[list[int]] = []
    n_lines = 0
    text = data.decode("latin-1").replace("\\\r\n", " ").replace("\\\n", " ")
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.split("#", 1)[0].split()
        if not words:
            continue
        if words[0] == "v":
            vertices.append(_floats(words[1:], number, "OBJ"))
        elif words[0] in ("f", "fo"):
            polygons.append([_obj_index(word, len(vertices), number) for word in words[1:]])
        elif words[0] in ("l", "p"):
            n_lines += 1
        elif words[0] in _OBJ_UNSUPPORTED:
            raise ReadError(f"an OBJ file must hold polygons. Got free-form geometry ({words[0]!r}) in line {number}.")
    if n_lines:
        notes.append(f"ignored {n_lines} loose lines and points")
    return _checked(vertices, polygons, "OBJ")


def _obj_index(word: str, n_vertices: int, number: int) -> int:
    try:
        index = int(word.split("/", 1)[0])
    except ValueError as error:
        raise ReadError(f"an OBJ face must list vertex numbers. Got {word!r} in line {number}.") from error
    return index - 1 if index > 0 else n_vertices + index if index < 0 else -1


def parse_off(data: bytes) -> tuple[np.ndarray, list[list[int]]]:
    """Return the vertices and polygons of a text OFF file; colours and normals after them are skipped.

    Raises
    ------
    ReadError
        The file is binary, cut off or malformed.
    """
    rows = [line.split("#", 1)[0].split() for line in data.decode("latin-1").splitlines()]
    rows = [(number, row) for number, row in enumerate(rows, start=1) if row]
    keyword = rows[0][1][0].upper() if rows else ""
    if not keyword.endswith("OFF") or "BINARY" in (word.upper() for word in rows[0][1]):
        raise ReadError(f"a text OFF file must begin with OFF. Got {keyword[:20]!r}.")
    head = rows[0][1][1:]
    body = rows[1:]
    if not head and body:
        head, body = body[0][1], body[1:]
    try:
        n_vertices, n_faces = int(head[0]), int(head[1])
    except (ValueError, IndexError) as error:
        raise ReadError(f"an OFF file must count its vertices and faces. Got {' '.join(head)[:40]!r}.") from error
    if n_vertices < 0 or n_faces < 0 or len(body) < n_vertices + n_faces:
        raise ReadError(
            f"an OFF file must hold the rows it counts. Got {n_vertices} + {n_faces} counted, {len(body)} present."
        )
    vertices = [_floats(row, number, "OFF") for number, row in body[:n_vertices]]
    polygons = [_off_polygon(row, number) for number, row in body[n_vertices : n_vertices + n_faces]]
    return _checked(vertices, polygons, "OFF")


def _off_polygon(row: list[str], number: int) -> list[int]:
    try:
        size = int(row[0])
        indices = [int(word) for word in row[1 : size + 1]]
    except ValueError as error:
        raise ReadError(
            f"an OFF face must list vertex numbers. Got {' '.join(row)[:40]!r} in line {number}."
        ) from error
    if len(indices) != size:
        raise ReadError(f"an OFF face must hold the indices it counts. Got {len(indices)} of {size} in line {number}.")
    return indices


def _floats(words: list[str], number: int, kind: str) -> list[float]:
    try:
        x, y, z = (float(word) for word in words[:3])
    except ValueError as error:
        text = " ".join(words)[:40]
        raise ReadError(f"an {kind} vertex must have three numbers. Got {text!r} in line {number}.") from error
    return [x, y, z]


def _checked(vertices: list, polygons: list[list[int]], kind: str) -> tuple[np.ndarray, list[list[int]]]:
    for f, polygon in enumerate(polygons):
        if len(polygon) < 3:
            raise ReadError(f"an {kind} face must have at least 3 vertices. Got {len(polygon)} in face {f}.")
        if min(polygon) < 0 or max(polygon) >= len(vertices):
            raise ReadError(
                f"an {kind} face must list existing vertices. Got {[v + 1 for v in polygon[:8]]} of {len(vertices)} "
                f"(counted from 1) in face {f}."
            )
    if not polygons:
        raise ReadError(f"an {kind} file must hold faces. Got 0.")
    return np.array(vertices, dtype=np.float64).reshape(-1, 3), polygons
