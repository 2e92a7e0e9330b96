"""STL files, binary and text, read strictly: what is damaged is refused, never shortened."""

from __future__ import annotations

import numpy as np

from aspectgraph.exceptions import ReadError
from aspectgraph.read.numbers import decode_text, parse_real

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
