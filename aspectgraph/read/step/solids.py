"""The solids of a STEP file as the kernel builds them, checked against what the file says it holds.

The kernel leaves out what it cannot build, and says so nowhere a program could look. So every solid the file lists must
come out, with as many faces and with every vertex in its place; every part of an assembly must be placed.

Imports OCP; import this module only when a boundary representation is at hand.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from OCP.Bnd import Bnd_Box
from OCP.BOPAlgo import BOPAlgo_CellsBuilder
from OCP.BRep import BRep_Tool
from OCP.BRepBndLib import BRepBndLib
from OCP.collections import IndexedMap_TopoDS_Shape_TopTools_ShapeMapHasher as ShapeMap
from OCP.collections import List_TopoDS_Shape as ShapeList
from OCP.gp import gp_Pnt
from OCP.IFSelect import IFSelect_ReturnStatus
from OCP.Interface import Interface_Static
from OCP.Message import Message
from OCP.STEPControl import STEPControl_Reader
from OCP.TopAbs import TopAbs_ShapeEnum
from OCP.TopExp import TopExp_Explorer
from OCP.TopLoc import TopLoc_Location
from OCP.TopoDS import TopoDS, TopoDS_Iterator

from aspectgraph.exceptions import ReadError, SelfIntersectionError
from aspectgraph.read.step.names import Occurrence, StepNames, read_names
from aspectgraph.read.step.text import (
    TESSELLATED_SOLIDS,
    ListedSolid,
    StatedFacets,
    StepEntity,
    check_nothing_loose,
    find_damage,
    linked_facets,
    list_loose,
    list_solids,
    notes_on_units,
    parse_entities,
)
from aspectgraph.solid.topology import describe_point
from ground.short_repr import count

# Small questions to shapes of the kernel: what they consist of, their points and their triangles.
#
# Imports OCP; import this module only when a boundary representation is at hand.


def explore(
    shape: Any, kind: TopAbs_ShapeEnum, outside: TopAbs_ShapeEnum = TopAbs_ShapeEnum.TopAbs_SHAPE
) -> list[Any]:
    """Return the sub-shapes of a kind that are in none of the kind `outside`, in file order, once for each use."""
    shapes = []
    explorer = TopExp_Explorer(shape, kind, outside)
    while explorer.More():
        shapes.append(explorer.Current())
        explorer.Next()
    return shapes


def unplaced(shape: Any) -> Any:
    """Return a shape as its part states it, before any placement."""
    return shape.Located(TopLoc_Location())


def xyz(point: Any) -> tuple[float, float, float]:
    """Return the coordinates of an OCCT point or vector."""
    return point.X(), point.Y(), point.Z()


def face_mesh(face: Any) -> tuple[Any, Any, np.ndarray, np.ndarray]:
    """Return the triangles of a face.

    Parameters
    ----------
    face : TopoDS_Face
        A face with triangles.

    Returns
    -------
    mesh : Poly_Triangulation
        As the kernel has it, before its placement.
    location : TopLoc_Location
        Its placement.
    points : ndarray, shape (n, 3)
        Its nodes in place, in mm.
    triangles : ndarray of int, shape (t, 3)
        Rows of `points`, as the surface turns.
    """
    location = TopLoc_Location()
    mesh = BRep_Tool.Triangulation_s(face, location)
    move = location.Transformation()
    nodes = [mesh.Node(k).Transformed(move) for k in range(1, mesh.NbNodes() + 1)]
    rows = [mesh.Triangle(k) for k in range(1, mesh.NbTriangles() + 1)]
    corners = [(row.Value(1), row.Value(2), row.Value(3)) for row in rows]
    return mesh, location, np.array([xyz(node) for node in nodes]), np.array(corners) - 1


READ_TEXT = "read the text of the file"
BUILD_SOLIDS = "build the solids"

RELATIVE_DISPLACEMENT = 1e-3
"""A vertex farther from where the file puts it, as a fraction of the solid's diagonal, is another vertex.

The kernel moves vertices that its healing merges, but by no more than the uncertainty of the file; a wrong unit or a
lost vertex leaves gaps of the size of an edge.
"""


@dataclass
class Slot:
    """A solid of the file, in its order.

    Attributes
    ----------
    shape : TopoDS_Shape or None
        None if the kernel did not build it.
    damage : str
        What is wrong with it; empty if nothing is.
    uncertainty_mm : float or None
        See `ListedSolid`.
    facets : StatedFacets or None
        Those of a tessellated solid, in their place; its shape has no surfaces and is good for nothing else.
    number : int or None
        Number of its entity; None if it is not known.
    instances : tuple of int
        Numbers of the occurrences of the assembly that place it, the outermost first.
    """

    shape: object | None
    damage: str = ""
    uncertainty_mm: float | None = None
    facets: StatedFacets | None = None
    number: int | None = None
    instances: tuple[int, ...] = ()

    def size_mm(self) -> list[float] | None:
        """Return the size of its box, in mm; None of a solid that was not built."""
        box = Bnd_Box()
        if self.facets is not None:
            return np.asarray(np.ptp(self.facets.vertices, axis=0)).tolist()
        if self.shape is None:
            return None
        BRepBndLib.AddOptimal_s(self.shape, box, False, False)
        if box.IsVoid():
            return None
        low = xyz(box.CornerMin())
        high = xyz(box.CornerMax())
        # without the width that the kernel adds
        return [round(b - a, 6) for a, b in zip(low, high, strict=True)]

    def n_faces(self) -> int:
        """Return the number of its faces; of facets if the file states only these."""
        if self.facets is not None:
            return len(self.facets.triangles)
        if self.shape is None:
            return 0
        return len(explore(self.shape, TopAbs_ShapeEnum.TopAbs_FACE))


@dataclass
class Inventory:
    """What a STEP file holds: its solids with their names, and notes on what belongs to none."""

    slots: list[Slot]
    notes: list[str] = field(default_factory=list)
    names: StepNames = field(default_factory=StepNames)


def load_solids(
    path: Path, name: str, report: Callable[[int, int, str], None] = lambda done, total, label: None
) -> Inventory:
    """Return the solids of a STEP file in mm, each once for every place it has, in the order of the file.

    Parameters
    ----------
    path : Path
        An uncompressed STEP file.
    name : str
        What to call the file in messages.
    report : callable
        Takes how much is done, of how much, and the name of the phase.

    Raises
    ------
    ReadError
        The file is not a STEP file, is damaged in more than one solid's own geometry, or holds no closed solid.
    """
    report(0, 1, READ_TEXT)
    data = Path(path).read_bytes()
    entities = parse_entities(data)
    listed = {solid.number: solid for solid in list_solids(entities)}
    names = read_names(data, entities, listed)
    report(1, 1, READ_TEXT)
    n_solids = max(len(listed), 1)
    report(0, n_solids, BUILD_SOLIDS)
    loose = list_loose(entities)
    if loose and not listed:
        raise ReadError(
            f"a STEP file must hold at least one closed solid. Got {name} with tessellated faces of "
            f"no solid only ({entities[loose[0]].kind} #{loose[0]}); export the part as a solid, or as a mesh."
        )
    reader = STEPControl_Reader()
    with quiet():
        Interface_Static.SetCVal_s("xstep.cascade.unit", "MM")
        Interface_Static.SetCVal_s("read.step.tessellated", _tessellation_mode(entities, name))
        if reader.ReadFile(str(path)) != IFSelect_ReturnStatus.IFSelect_RetDone:
            raise ReadError(
                f"a .step or .stp file must be a STEP file. Got {name}, which OCCT cannot read."
            )
        model = reader.Model()
        numbers = number_entities(model, entities, name)
        damage = find_damage(model, numbers, entities, listed, name)
        reader.TransferRoots()
    _check_assembly(reader, numbers, name)
    shape = reader.OneShape()
    if shape is None or shape.IsNull():
        raise ReadError(
            f"a STEP file must hold at least one closed solid. Got {name} without any shape."
        )
    solids = number_solids(reader, shape, numbers)
    if not solids and not damage.of_solids:
        n = len(explore(shape, TopAbs_ShapeEnum.TopAbs_FACE))
        raise ReadError(
            f"a STEP file must hold at least one closed solid. Got {name} with {n} loose faces only."
        )
    check_nothing_loose(
        damage, [number for _, number in solids if number not in listed], entities, name
    )
    instances = instances_of(reader, shape, numbers, names.occurrences)
    report(n_solids, n_solids, BUILD_SOLIDS)
    slots = []
    ordered = in_file_order(solids, listed, name)
    for k, (solid, number) in enumerate(ordered):
        report(k, len(ordered), "check the solids")
        slot = _slot(solid, listed.get(number), damage.of_solids.get(number, ""))
        slot.number = number
        if len(instances) == len(ordered):
            slot.instances = instances[k]
        slots.append(slot)
    report(len(ordered), len(ordered), "check the solids")
    notes = notes_on_units(listed.values()) + _left_out(shape, len(loose)) + damage.notes(entities)
    return Inventory(slots, notes, names)


def _tessellation_mode(entities: dict[int, StepEntity], name: str) -> str:
    """Return whether the kernel is to build tessellated solids.

    It builds a solid again for every tessellated one that draws it.
    """
    linked = linked_facets(entities)
    own_solids = {n for n, entity in entities.items() if entity.kind in TESSELLATED_SOLIDS} - linked
    if linked and own_solids:
        raise ReadError(
            "the tessellated solids of a STEP file must all draw other solids of it, or none. "
            f"Got {name}, where #{min(linked)} does and #{min(own_solids)} does not."
        )
    return "Off" if linked else "On"


def diagonal_mm(shapes: list[Any], points: Iterable[np.ndarray] = ()) -> float:
    """Return the diagonal of the box around some shapes, and some points, each of shape (n, 3)."""
    box = Bnd_Box()
    for shape in shapes:
        BRepBndLib.AddOptimal_s(shape, box, False, False)
    for rows in points:
        for corner in (rows.min(axis=0), rows.max(axis=0)):
            box.Add(gp_Pnt(*corner.tolist()))
    return math.dist(xyz(box.CornerMin()), xyz(box.CornerMax()))


def _check_assembly(reader: Any, handles: Iterable[Any], name: str) -> None:
    """Check that every part of an assembly was placed."""
    process = reader.WS().TransferReader().TransientProcess()
    placed = {
        process.Mapped(i)
        for i in range(1, process.NbMapped() + 1)
        if process.MapItem(i).HasResult()
    }
    lost = [
        h
        for h in handles
        if h.DynamicType().Name().endswith("NextAssemblyUsageOccurrence") and h not in placed
    ]
    if lost:
        raise ReadError(
            f"every part of an assembly must be placed. Got {len(lost)} lost parts in {name}."
        )


def number_entities(model: Any, entities: dict[int, StepEntity], name: str) -> dict[Any, int]:
    """Return the number of each entity by its handle.

    Keep it while the file is read: two handles of an entity are recognised as one by the object that wraps them.

    Parameters
    ----------
    model : Interface_InterfaceModel
        What the kernel read.
    entities : dict
        See `text.parse_entities`.
    name : str
        What to call the file in messages.

    Raises
    ------
    ReadError
        The kernel read more or fewer entities.
    """
    handles = [model.Value(i) for i in range(1, model.NbEntities() + 1)]
    if len(handles) != len(entities):
        raise ReadError(
            f"a STEP file must be whole. Got {name}: {len(handles)} of {len(entities)} entities read."
        )
    return dict(zip(handles, entities, strict=True))


def number_solids(reader: Any, shape: Any, numbers: dict[Any, int]) -> list[tuple[Any, int | None]]:
    """Return the solids of a shape in its order, each with the number of the entity that it was made from.

    Parameters
    ----------
    reader : STEPControl_Reader
        The reader that made the shape.
    shape : TopoDS_Shape
        What it made.
    numbers : dict
        The number of each entity in the file, by its handle.
    """
    transfer = reader.WS().TransferReader()
    return [
        (solid, numbers.get(transfer.EntityFromShapeResult(unplaced(solid), 1)))
        for solid in explore(shape, TopAbs_ShapeEnum.TopAbs_SOLID)
    ]


def instances_of(
    reader: Any, shape: Any, numbers: dict[Any, int], occurrences: dict[int, Occurrence]
) -> list[tuple[int, ...]]:
    """Return for each solid of a shape, in its order, the occurrences that lead to it, the outermost first.

    Parameters
    ----------
    reader : STEPControl_Reader
        The reader that made the shape.
    shape : TopoDS_Shape
        What it made.
    numbers : dict
        The number of each entity in the file, by its handle.
    occurrences : dict of int to Occurrence
        Those of the file, by number.
    """
    if not occurrences:
        return []
    transfer = reader.WS().TransferReader()
    paths: list[tuple[int, ...]] = []
    seen_parts = ShapeMap()
    makers: list[int] = []

    def maker(part: Any) -> int:
        """Return the number of what the kernel made a shape from, or -1."""
        position = seen_parts.FindIndex(part)
        if position:
            return makers[position - 1]
        seen_parts.Add(part)
        makers.append(numbers.get(transfer.EntityFromShapeResult(part, 1), -1))
        return makers[-1]

    def walk(whole: Any, assembly: int | None, path: tuple[int, ...]) -> None:
        remaining = [n for n, placed in occurrences.items() if placed.assembly == assembly]
        # without their places: a shape in an assembly is compared as the assembly holds it
        parts = TopoDS_Iterator(whole, False, False)
        while parts.More():
            part = parts.Value()
            parts.Next()
            number = maker(part)
            inside = assembly
            way = path
            if number in occurrences:
                product = occurrences[number].product
                if assembly is not None and number not in remaining:
                    # another assembly places the same product at the same place
                    same = (n for n in remaining if occurrences[n].product == product)
                    number = next(same, number)
                if number in remaining:
                    remaining.remove(number)
                inside = product
                way = (*path, number)
            elif number in definitions:
                inside = number
            if part.ShapeType() == TopAbs_ShapeEnum.TopAbs_SOLID:
                paths.append(way)
            else:
                walk(part, inside, way)

    definitions = {placed.assembly for placed in occurrences.values()}
    roots = definitions - {placed.product for placed in occurrences.values()}
    if shape.ShapeType() == TopAbs_ShapeEnum.TopAbs_SOLID:
        return [()]
    walk(shape, next(iter(roots)) if len(roots) == 1 else None, ())
    return paths


def in_file_order(solids: list[Any], listed: dict[int, ListedSolid], name: str) -> list[Any]:
    """Return the solids with their numbers; those that were not built stand where the file lists them, with None.

    Parameters
    ----------
    solids : list of tuple
        See `number_solids`.
    listed : dict of int to ListedSolid
        The solids that the file lists, by number.
    name : str
        What to call the file in messages.

    Raises
    ------
    ReadError
        A solid of an assembly was not built.
    """
    built = [number for _, number in solids]
    missing = [number for number in listed if number not in built]
    if not missing:
        return solids
    if [number for number in listed if number in built] != built:
        # their places among the parts of an assembly, and with them the numbers of the others, are not known
        raise ReadError(
            f"every solid of a STEP file must be built. Got {name}, of which OCCT leaves out #{missing[0]} "
            f"({len(missing)} such)."
        )
    shapes = dict(zip(built, (solid for solid, _ in solids), strict=True))
    return [(shapes.get(number), number) for number in listed]


def _slot(shape: Any, listed: ListedSolid | None, damage: str) -> Slot:
    if listed is None:
        return Slot(shape, damage)
    # the text says which facets are not read; of the same ones the kernel only says that they are wrong
    damage = listed.damage or damage
    if shape is not None and listed.facets is not None:
        move = shape.Location().Transformation()
        matrix = np.array([[move.Value(i, k) for k in (1, 2, 3, 4)] for i in (1, 2, 3)])
        return Slot(shape, damage, None, listed.facets.moved(matrix))
    if shape is None:
        return Slot(
            None, damage or f"#{listed.number}, which OCCT cannot build", listed.uncertainty_mm
        )
    return Slot(shape, damage or _compare(shape, listed), listed.uncertainty_mm)


def _compare(shape: Any, listed: ListedSolid) -> str:
    """Return how a solid differs from what the file lists, or nothing."""
    n_faces = len(explore(shape, TopAbs_ShapeEnum.TopAbs_FACE))
    if n_faces < listed.n_faces:
        return f"{n_faces} of the {listed.n_faces} faces that #{listed.number} lists"
    vertices = explore(unplaced(shape), TopAbs_ShapeEnum.TopAbs_VERTEX)
    points = np.array([xyz(BRep_Tool.Pnt_s(TopoDS.Vertex(vertex))) for vertex in vertices])
    points = points.reshape(-1, 3)
    distance_mm, place = _farthest(listed.points_mm, points)
    allowed = (
        RELATIVE_DISPLACEMENT * float(np.linalg.norm(np.ptp(points, axis=0)))
        if len(points)
        else 0.0
    )
    if distance_mm > allowed:
        return f"a vertex of #{listed.number} at {describe_point(place)} that is {distance_mm:.3g} mm off"
    return ""


def _farthest(expected: np.ndarray, points: np.ndarray) -> tuple[float, np.ndarray]:
    """Return the expected point that is farthest from all others, and how far that is."""
    point_set = set(map(tuple, points.tolist()))
    candidates = [p for p in expected.tolist() if tuple(p) not in point_set]
    worst = 0.0
    place = np.zeros(3)
    for point in candidates:
        distance = (
            float(np.sqrt(((points - point) ** 2).sum(axis=1).min())) if len(points) else math.inf
        )
        if not distance <= worst:
            worst = distance
            place = np.array(point)
    return worst, place


def _left_out(shape: Any, n_tessellated: int) -> list[str]:
    """Return notes on faces and edges that belong to no solid, such as annotations."""
    faces = explore(shape, TopAbs_ShapeEnum.TopAbs_FACE, outside=TopAbs_ShapeEnum.TopAbs_SOLID)
    # of tessellated faces the kernel builds some and leaves out others
    n_faces = sum(
        BRep_Tool.Surface_s(TopoDS.Face(face), TopLoc_Location()) is not None for face in faces
    )
    n_edges = len(
        explore(shape, TopAbs_ShapeEnum.TopAbs_EDGE, outside=TopAbs_ShapeEnum.TopAbs_FACE)
    )
    notes = []
    counts = [count(n, noun) for n, noun in ((n_faces, "face"), (n_edges, "edge")) if n]
    if counts:
        verb = "belongs" if n_faces + n_edges == 1 else "belong"
        notes.append(f"left out {' and '.join(counts)} that {verb} to no solid")
    if n_tessellated:
        noun = "face that belongs" if n_tessellated == 1 else "faces that belong"
        notes.append(f"left out {n_tessellated} tessellated {noun} to no solid")
    return notes


@contextmanager
def quiet() -> Iterator[None]:
    """Keep OCCT from printing; what it would say is checked and raised instead."""
    messenger = Message.DefaultMessenger_s()
    printers = [messenger.Printers().Value(k) for k in range(1, messenger.Printers().Length() + 1)]
    for printer in printers:
        messenger.RemovePrinter(printer)
    try:
        yield
    finally:
        for printer in printers:
            messenger.AddPrinter(printer)


# Solids that touch, made one body: the normal case of an assembly.
#
# The solids are cut against each other into cells, none of which two solids share unless they
# overlap; the walls between cells in contact are then taken away. What is left bounds the same
# volume. Edges inside a contact are gone, edges on its rim stay, and each of them is known by the
# edges it came from.
#
# Imports OCP; import this module only in the kernel's process.


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
        result = (
            _merged([shapes[k] for k in group], [numbers[k] for k in group], name)
            if len(group) > 1
            else None
        )
        if result is None:
            bodies.shapes.extend(shapes[k] for k in group)
            n_done += len(group)
            report(n_done)
            continue
        solids, builder = result
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
                label = [low if number == high else number for number in label]
    return [
        [k for k, number in enumerate(label) if number == group] for group in sorted(set(label))
    ]


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
        members = ShapeList()
        avoided = ShapeList()
        members.Append(shape)
        builder.AddToResult(members, avoided, 0, False)
        for cell in explore(builder.Shape(), TopAbs_ShapeEnum.TopAbs_SOLID):
            position = owner.FindIndex(cell)
            if position:
                raise SelfIntersectionError(
                    f"solids must not overlap. Got solids {owners[position - 1]} and {number} of {name}, which do."
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
