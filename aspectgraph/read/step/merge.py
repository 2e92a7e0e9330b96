"""Solids that touch, made one body: the normal case of an assembly.

The solids are cut against each other into cells, none of which two solids share unless they overlap; the walls between
cells in contact are then taken away. What is left bounds the same volume. Edges inside a contact are gone, edges on its
rim stay, and each of them is known by the edges it came from.

Imports OCP; import this module only in the kernel's process.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

from OCP.Bnd import Bnd_Box
from OCP.BOPAlgo import BOPAlgo_CellsBuilder
from OCP.BRepBndLib import BRepBndLib
from OCP.collections import IndexedMap_TopoDS_Shape_TopTools_ShapeMapHasher as ShapeMap
from OCP.collections import List_TopoDS_Shape as ShapeList
from OCP.TopAbs import TopAbs_ShapeEnum

from aspectgraph.exceptions import SelfIntersectionError
from aspectgraph.read.step.shapes import explore


@dataclass
class Bodies:
    """Solids after those in contact became one.

    Attributes
    ----------
    shapes : list of TopoDS_Shape
        Solids, none in contact with another one along a face.
    edges : dict of int to list of TopoDS_Shape
        What became of the edges of every solid given, by its place.
    merged : list of list of int
        The places of solids that became one.
    """

    shapes: list[Any]
    edges: dict[int, list[Any]]
    merged: list[list[int]] = field(default_factory=list)


def merge_touching(
    shapes: Sequence[Any],
    numbers: Sequence[int],
    name: str,
    report: Callable[[int], None] = lambda done: None,
) -> Bodies:
    """Return solids with those that touch made one body.

    Parameters
    ----------
    shapes : sequence of TopoDS_Shape
        Solids.
    numbers : sequence of int
        Their numbers in the file, for messages.
    name : str
        Name of the file, for messages.
    report : callable
        Takes how many of them are done.

    Raises
    ------
    SelfIntersectionError
        Two solids overlap.
    """
    n_done = 0
    report(n_done)
    bodies = Bodies(
        [], {k: explore(shape, TopAbs_ShapeEnum.TopAbs_EDGE) for k, shape in enumerate(shapes)}
    )
    for group in _near(shapes):
        found = (
            _merged([shapes[k] for k in group], [numbers[k] for k in group], name)
            if len(group) > 1
            else None
        )
        if found is None:
            bodies.shapes.extend(shapes[k] for k in group)
            n_done += len(group)
            report(n_done)
            continue
        solids, builder = found
        bodies.shapes.extend(solids)
        bodies.merged.append(group)
        for k in group:
            bodies.edges[k] = list(_images(builder, bodies.edges[k]))
        n_done += len(group)
        report(n_done)
    return bodies


def edge_map(edges: Iterable[Any]) -> Any:
    """Return a map that tells whether it holds an edge."""
    held = ShapeMap()
    for edge in edges:
        held.Add(edge)
    return held


def _near(shapes: Sequence[Any]) -> list[list[int]]:
    """Return the places of solids whose boxes hang together, in the order of the first of each group."""
    boxes = []
    for shape in shapes:
        box = Bnd_Box()
        # with the tolerances of the shape, within which things are in contact
        BRepBndLib.Add_s(shape, box, False)
        boxes.append(box)
    label = list(range(len(shapes)))
    for i in range(len(shapes)):
        for k in range(i):
            if label[i] != label[k] and not boxes[i].IsOut(boxes[k]):
                low, high = sorted((label[i], label[k]))
                label = [low if one == high else one for one in label]
    return [[k for k, one in enumerate(label) if one == group] for group in sorted(set(label))]


def _merged(
    shapes: Sequence[Any], numbers: Sequence[int], name: str
) -> tuple[list[Any], Any] | None:
    """Return the bodies of solids that may touch, and what tells where edges went; None if none do."""
    builder = BOPAlgo_CellsBuilder()
    for shape in shapes:
        builder.AddArgument(shape)
    builder.SetNonDestructive(True)
    builder.SetRunParallel(False)
    builder.Perform()
    if builder.HasErrors():
        # nothing is known of them then; the checks of the whole solid decide
        return None
    _check_apart(builder, shapes, numbers, name)
    builder.AddAllToResult(1, False)
    builder.RemoveInternalBoundaries()
    solids = explore(builder.Shape(), TopAbs_ShapeEnum.TopAbs_SOLID)
    return (solids, builder) if 0 < len(solids) < len(shapes) else None


def _check_apart(builder: Any, shapes: Sequence[Any], numbers: Sequence[int], name: str) -> None:
    """Check that no cell belongs to two solids."""
    owner = ShapeMap()
    owners: list[int] = []
    for shape, number in zip(shapes, numbers, strict=True):
        wanted = ShapeList()
        avoided = ShapeList()
        wanted.Append(shape)
        builder.AddToResult(wanted, avoided, 0, False)
        for cell in explore(builder.Shape(), TopAbs_ShapeEnum.TopAbs_SOLID):
            known = owner.FindIndex(cell)
            if known:
                raise SelfIntersectionError(
                    f"solids must not overlap. Got solids {owners[known - 1]} and {number} of {name}, which do."
                )
            owner.Add(cell)
            owners.append(number)
        builder.RemoveAllFromResult()


def _images(builder: Any, edges: Iterable[Any]) -> Iterable[Any]:
    """Go through what edges became; those inside a contact are nothing any more."""
    for edge in edges:
        if not builder.IsDeleted(edge):
            images = list(builder.Modified(edge))
            yield from images or [edge]
