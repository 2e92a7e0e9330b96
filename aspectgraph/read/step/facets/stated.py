"""Tessellated solids of AP242: facets that the file states, with no surface behind them.

They are taken from the text, as the file has them. The kernel only says where an assembly puts them: it crashes when
asked for anything else of a face without a surface.

Reference: ISO 10303-42, tessellated geometry.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from aspectgraph.read.step.text import StepEntity

TESSELLATED_SOLIDS = frozenset({"TESSELLATED_SOLID"})

_WITH_AREA = frozenset(
    f"{prefix}TRIANGULATED_{suffix}"
    for prefix in ("", "COMPLEX_", "CUBIC_BEZIER_")
    for suffix in ("FACE", "SURFACE_SET")
)
_SETS = frozenset({"TESSELLATED_GEOMETRIC_SET", "TESSELLATED_SHELL"})
_WITHOUT_AREA = frozenset({"TESSELLATED_CONNECTING_EDGE", "TESSELLATED_EDGE", "TESSELLATED_VERTEX"})
_TOKEN = re.compile(r"[(),]|''|\$|\*|#[0-9]+|[-+0-9.Ee]+|\.[A-Za-z_0-9]+\.|[A-Za-z_0-9]+")


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
    for token in _TOKEN.findall(text[text.index("(") :]):
        if token == "(":
            stack.append([])
        elif token == ")":
            closed = stack.pop()
            stack[-1].append(closed)
        elif token != ",":
            stack[-1].append(float(token) if token[0] in "+-0123456789" else token)
    parameters: list[Any] = stack[0][0]
    return parameters
