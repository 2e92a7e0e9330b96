"""The shapes that the kernel leaves out: it reads one item of each aspect, the text of the file names all of them.

Imports OCP; import this module only in the kernel's process.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from OCP.collections import IndexedMap_TopoDS_Shape_TopTools_ShapeMapHasher as ShapeMap
from OCP.TopAbs import TopAbs_ShapeEnum

from aspectgraph.read.step.semantic.attached_items import list_attached_items
from aspectgraph.read.step.semantic.stated_dimensions import list_dimensions
from aspectgraph.read.step.shapes import explore, unplaced
from aspectgraph.read.step.text import StepEntity, reachable

_SHAPES = {
    "ADVANCED_FACE": TopAbs_ShapeEnum.TopAbs_FACE,
    "FACE_SURFACE": TopAbs_ShapeEnum.TopAbs_FACE,
    "EDGE_CURVE": TopAbs_ShapeEnum.TopAbs_EDGE,
    "VERTEX_POINT": TopAbs_ShapeEnum.TopAbs_VERTEX,
}
_CURVES = frozenset({"LINE", "CIRCLE", "ELLIPSE", "HYPERBOLA", "PARABOLA", "POLYLINE"})
_SAME = 1e-6
"""Relative difference of a value as the kernel and as the text state it."""


@dataclass(frozen=True)
class Completed:
    """What a dimension is attached to.

    Attributes
    ----------
    sides : list of list of TopoDS_Shape
        The faces, edges or vertices of each side: first the kernel's, then those that it left out.
    unread : list of int
        For each side the number of items that the text names and no shape of the part is made from.
    text : int or None
        Which of the dimensions in the text it is, counted from 0; None if that is not known.
    """

    sides: list[list[Any]]
    unread: list[int] = field(default_factory=lambda: [0, 0])
    text: int | None = None


class AttachedShapes:
    """Completes the shapes of dimensions; these must come in the order of the file.

    Parameters
    ----------
    transfer : XSControl_TransferReader
        Of the reader that made the shapes.
    numbers : dict
        The number of each entity in the file, by its handle.
    entities : dict
        See `text.parse_entities`.
    assembly : TopoDS_Shape
        All that the file holds.
    """

    def __init__(
        self, transfer: Any, numbers: dict[Any, int], entities: dict[int, StepEntity], assembly: Any
    ):
        self._transfer = transfer
        self._numbers = numbers
        self._entities = entities
        self._assembly = assembly
        values = [stated.values for stated in list_dimensions(entities)]
        self._texts = list(zip(values, list_attached_items(entities), strict=True))
        self._next_text = 0
        self._made: dict[TopAbs_ShapeEnum, dict[int, list[Any]]] = {}

    def complete(self, values: Sequence[float] | None, sides: list[list[Any]]) -> Completed:
        """Return the shapes of a dimension with those that the kernel left out.

        Parameters
        ----------
        values : sequence of float or None
            Those of the kernel.
        sides : list of list of TopoDS_Shape
            The kernel's two sides, as in the part.
        """
        known = [{self._number(shape) for shape in side} - {None} for side in sides]
        for k in range(self._next_text, len(self._texts)):
            stated, items = self._texts[k]
            if self._fits(values, known, stated, items):
                self._next_text = k + 1
                return self._with_items(sides, known, k)
        return Completed(sides)

    def of_text(self, text: int) -> Completed:
        """Return the shapes of a dimension that the kernel leaves out.

        Parameters
        ----------
        text : int
            Which of the dimensions in the text it is, counted from 0.
        """
        return self._with_items([[], []], [set(), set()], text)

    def why_nothing(self, text: int | None) -> str:
        """Return why a dimension has no shapes.

        Parameters
        ----------
        text : int or None
            See `Completed`.
        """
        items = [] if text is None else [item for side in self._texts[text][1] for item in side]
        if not items:
            return "it is attached to nothing"
        kind = self._entities[items[0]].kind if items[0] in self._entities else "an item"
        if kind in _SHAPES:
            return f"it is attached to {kind} #{items[0]}, which is in no part that was built"
        if "CURVE" in kind or kind in _CURVES:
            return "it is attached to a curve, no face"
        return f"it is attached to {kind} #{items[0]}, no face"

    def _with_items(
        self, sides: list[list[Any]], known: list[set[int | None]], text: int
    ) -> Completed:
        items = self._texts[text][1]
        whole = [list(side) for side in sides]
        unread = [0, 0]
        for k, side in enumerate(items):
            for item in side:
                if item in known[k] or self._is_whole_of(item, known[k]):
                    continue
                shapes = self.made_from(item)
                whole[k] += shapes
                unread[k] += not shapes
        return Completed(whole, unread, text)

    def _fits(
        self,
        values: Sequence[float] | None,
        known: list[set[int | None]],
        stated: Sequence[float],
        items: list[list[int]],
    ) -> bool:
        """Return whether the text of a dimension may be that of one of the kernel's."""
        if values and stated and not any(_same(a, b) for a in values for b in stated):
            return False
        named = {item for side in items for item in side}
        rest = (known[0] | known[1]) - named
        return not rest or rest <= {
            part for item in named if self._is_group(item) for part in self._below(item)
        }

    def _is_group(self, item: int) -> bool:
        return item in self._entities and self._entities[item].kind not in _SHAPES

    def _below(self, item: int) -> set[int]:
        return reachable(self._entities, item)

    def _is_whole_of(self, item: int, known: set[int | None]) -> bool:
        """Return whether an item is a shell or the like, of which the kernel has the faces."""
        return self._is_group(item) and not known.isdisjoint(self._below(item))

    def _number(self, shape: Any) -> int | None:
        """Return the number of the entity that a shape was made from."""
        return self._numbers.get(self._transfer.EntityFromShapeResult(unplaced(shape), 1))

    def made_from(self, item: int) -> list[Any]:
        """Return the faces, edges or vertices that were made from an entity; none if it is something else.

        Parameters
        ----------
        item : int
            Number of the entity.
        """
        kind = _SHAPES.get(self._entities[item].kind) if item in self._entities else None
        if kind is None:
            return []
        if kind not in self._made:
            self._made[kind] = self._by_number(kind)
        return self._made[kind].get(item, [])

    def _by_number(self, kind: TopAbs_ShapeEnum) -> dict[int, list[Any]]:
        parts = explore(self._assembly, TopAbs_ShapeEnum.TopAbs_SOLID)
        shapes = [shape for part in parts for shape in explore(unplaced(part), kind)]
        if kind != TopAbs_ShapeEnum.TopAbs_VERTEX:
            shapes += explore(self._assembly, kind, outside=TopAbs_ShapeEnum.TopAbs_SOLID)
        met = ShapeMap()
        found: dict[int, list[Any]] = {}
        for shape in shapes:
            n_before = met.Extent()
            met.Add(unplaced(shape))
            number = self._number(shape) if met.Extent() > n_before else None
            if number is not None:
                found.setdefault(number, []).append(shape)
        return found


def _same(one: float, other: float) -> bool:
    return abs(abs(one) - abs(other)) <= _SAME * max(abs(one), 1.0)
