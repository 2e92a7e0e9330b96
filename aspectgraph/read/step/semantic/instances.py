"""Where the instances of a part are: from a face of a part to the face of each of its solids in the assembly.

The kernel attaches dimensions to the faces and edges of a part before the part is placed. One part may be placed
several times, inside assemblies that are placed several times themselves. So every face, edge and vertex is looked up
in every placed solid. Those of one dimension belong together where they are in the same instance.

Imports OCP; import this module only in the kernel's process.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from OCP.collections import IndexedMap_TopoDS_Shape_TopTools_ShapeMapHasher as ShapeMap
from OCP.gp import gp_TrsfForm
from OCP.TopAbs import TopAbs_ShapeEnum
from OCP.TopoDS import TopoDS_Iterator

from aspectgraph.read.step.shapes import explore, unplaced

_KINDS = (
    TopAbs_ShapeEnum.TopAbs_FACE,
    TopAbs_ShapeEnum.TopAbs_EDGE,
    TopAbs_ShapeEnum.TopAbs_VERTEX,
)
_LOOSE = "it is attached to geometry that belongs to no solid"


@dataclass(frozen=True)
class Occurrence:
    """A face, edge or vertex of one placed solid.

    Attributes
    ----------
    path : tuple of int
        Its place in the assembly: which child at each level; the last one is the solid.
    solid : int or None
        Number of the solid in the file; None of geometry that belongs to none.
    shape : TopoDS_Shape
        Where it is in the assembly.
    """

    path: tuple[int, ...]
    solid: int | None
    shape: Any


class AmbiguousInstanceError(Exception):
    """The file does not say which instances of parts belong together; the message says how many there are."""


class Instances:
    """Finds the instances of faces, edges and vertices in an assembly.

    Parameters
    ----------
    assembly : TopoDS_Shape
        All that the file holds, in place.
    numbers : sequence of int
        The number of each of its solids in the file, in the order in which they are found in the assembly.
    """

    def __init__(self, assembly: Any, numbers: Sequence[int]):
        self._solids = [
            (path, number, solid)
            for (path, solid), number in zip(_placed_solids(assembly), numbers, strict=True)
        ]
        self._parts = ShapeMap()
        self._contents: list[dict[int, list[Any]]] = []
        self._known: list[Any] = []
        self._any_is_placed = any(not _is_in_place(solid) for _, _, solid in self._solids)
        for _, _, solid in self._solids:
            self._index(unplaced(solid))

    def of(self, shapes: Sequence[Any]) -> list[list[Occurrence]]:
        """Return where some shapes are: for each instance one occurrence of every shape, in their order.

        Parameters
        ----------
        shapes : sequence of TopoDS_Shape
            Faces, edges or vertices of parts.

        Returns
        -------
        list of list of Occurrence
            Instances in the order of the assembly.

        Raises
        ------
        AmbiguousInstanceError
            A shape is in no solid, or shapes lie in parts of which the file does not say which belong together.
        """
        found = [list(self._occurrences(shape)) for shape in shapes]
        if not all(found):
            if self._any_is_placed:
                raise AmbiguousInstanceError(_LOOSE)
            # auxiliary geometry is where it is stated, as all parts are
            loose = [Occurrence((), None, shape) for shape in shapes]
            found = [row or [one] for row, one in zip(found, loose, strict=True)]
        return _together(found, 0)

    def _index(self, part: Any) -> None:
        """Remember where the faces, edges and vertices of a part are, once for each part."""
        if self._parts.FindIndex(part):
            return
        self._parts.Add(part)
        known = ShapeMap()
        content: dict[int, list[Any]] = {}
        for kind in _KINDS:
            for shape in explore(part, kind):
                places = content.setdefault(known.Add(unplaced(shape)), [])
                if not any(shape.IsSame(other) for other in places):
                    places.append(shape)
        self._known.append(known)
        self._contents.append(content)

    def _occurrences(self, shape: Any) -> Iterator[Occurrence]:
        bare = unplaced(shape)
        for path, number, solid in self._solids:
            part = self._parts.FindIndex(unplaced(solid)) - 1
            place = self._known[part].FindIndex(bare)
            for inside in self._contents[part].get(place, ()):
                yield Occurrence(path, number, inside.Moved(solid.Location()))


def _is_in_place(shape: Any) -> bool:
    """Return whether a shape is where its part states it: it was neither moved nor turned."""
    location = shape.Location()
    return bool(
        location.IsIdentity() or location.Transformation().Form() == gp_TrsfForm.gp_Identity
    )


def _placed_solids(shape: Any, path: tuple[int, ...] = ()) -> Iterator[tuple[tuple[int, ...], Any]]:
    """Go through the solids of an assembly with their places in it, in the order in which `explore` finds them."""
    if shape.ShapeType() == TopAbs_ShapeEnum.TopAbs_SOLID:
        yield path, shape
        return
    children = TopoDS_Iterator(shape)
    place = 0
    while children.More():
        yield from _placed_solids(children.Value(), (*path, place))
        place += 1
        children.Next()


def _together(found: Sequence[Sequence[Occurrence]], depth: int) -> list[list[Occurrence]]:
    """Return the occurrences that belong together: of every shape one, below the lowest node that holds all of them."""
    places = sorted(
        {one.path[depth] for places in found for one in places if len(one.path) > depth}
    )
    below = [
        [[one for one in row if one.path[depth : depth + 1] == (place,)] for row in found]
        for place in places
    ]
    whole = [rows for rows in below if all(rows)]
    if whole:
        return [instance for rows in whole for instance in _together(rows, depth + 1)]
    if all(len(row) == 1 for row in found):
        return [[row[0] for row in found]]
    counts = sorted({len(row) for row in found})
    raise AmbiguousInstanceError(
        f"it is attached to parts that are there {' and '.join(map(str, counts))} times, "
        "and the file does not say which of them belong together"
    )
