"""The semantic dimensions of a STEP file (AP242) with the shapes they are attached to, as the kernel finds them.

Objects that only draw a dimension, or label something, are left out: they say nothing a program could check.

Imports OCP; import this module only in the kernel's process.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from OCP.BRep import BRep_Tool
from OCP.BRepAdaptor import BRepAdaptor_Curve, BRepAdaptor_Surface
from OCP.collections import IndexedMap_TopoDS_Shape_TopTools_ShapeMapHasher as ShapeMap
from OCP.collections import Sequence_TDF_Label
from OCP.GeomAbs import GeomAbs_CurveType, GeomAbs_SurfaceType
from OCP.gp import gp_Circ, gp_Cone, gp_Cylinder, gp_Lin, gp_Pln, gp_Sphere, gp_TrsfForm
from OCP.IFSelect import IFSelect_ReturnStatus
from OCP.Interface import Interface_Static
from OCP.ShapeAnalysis import ShapeAnalysis_CanonicalRecognition
from OCP.STEPCAFControl import STEPCAFControl_Reader
from OCP.TCollection import TCollection_ExtendedString
from OCP.TDocStd import TDocStd_Document
from OCP.TopAbs import TopAbs_ShapeEnum
from OCP.TopoDS import TopoDS, TopoDS_Iterator
from OCP.XCAFApp import XCAFApp_Application
from OCP.XCAFDoc import (
    XCAFDoc_Dimension,
    XCAFDoc_DocumentTool,
    XCAFDoc_GeomTolerance,
    XCAFDoc_ShapeTool,
)

from aspectgraph.exceptions import ReadError
from aspectgraph.read.step.geometric_tolerances import (
    TARGETS,
    StatedTolerance,
    disagreements,
    list_datum_features,
    list_stated_tolerances,
)
from aspectgraph.read.step.solids import (
    explore,
    in_file_order,
    number_entities,
    number_solids,
    quiet,
    unplaced,
    xyz,
)
from aspectgraph.read.step.stated_dimensions import (
    LOCATIONS,
    SIZES,
    StatedDimension,
    list_dimensions,
    list_words,
    read_measure,
)
from aspectgraph.read.step.text import StepEntity, known_references, list_solids, reachable

# The items of the model that each dimension of a STEP file is attached to, as its text says.
#
# The kernel reads one item of each aspect. An aspect can have several: some writers attach a
# pattern of holes this way. So the text says which items there are.
#
# Reference: ISO 10303-242, geometric_item_specific_usage, composite_shape_aspect and
# shape_aspect_deriving_relationship.


_USAGES = frozenset({"GEOMETRIC_ITEM_SPECIFIC_USAGE", "ITEM_IDENTIFIED_REPRESENTATION_USAGE"})
_PARTS = frozenset({"SHAPE_ASPECT_RELATIONSHIP", "SHAPE_ASPECT_DERIVING_RELATIONSHIP"})
"""They lead from a composite aspect to its parts, and from a derived one to what it is derived from."""


def list_attached_items(entities: dict[int, StepEntity]) -> list[list[list[int]]]:
    """Return the items that each dimension is attached to.

    Parameters
    ----------
    entities : dict
        See `text.parse_entities`.

    Returns
    -------
    list of list of list of int
        For each dimension, in the order of `stated_dimensions.list_dimensions`, one list of numbers of entities for a
        size, and two for a location: one of each end. Each number is there once. They are in the order of the file.
    """
    items = _items_of_aspects(entities)
    parts = _parts_of_aspects(entities)
    sides = []
    for number, entity in entities.items():
        if not (SIZES | LOCATIONS) & entity.kinds:
            continue
        n_sides = 2 if LOCATIONS & entity.kinds else 1
        aspects = [
            reference
            for reference in known_references(entities, entity)
            if entities[reference].kind != "PRODUCT_DEFINITION_SHAPE"
        ]
        if not aspects:
            # the size of a datum feature is an aspect itself
            aspects = [number]
        sides.append(
            [list(dict.fromkeys(_below(aspect, items, parts))) for aspect in aspects[:n_sides]]
        )
    return sides


def list_items_below(entities: dict[int, StepEntity]) -> Callable[[int], list[int]]:
    """Return a function that lists the items of an aspect, each once, by the number of the aspect.

    Parameters
    ----------
    entities : dict
        See `text.parse_entities`.
    """
    items = _items_of_aspects(entities)
    parts = _parts_of_aspects(entities)
    return lambda aspect: list(dict.fromkeys(_below(aspect, items, parts)))


def _items_of_aspects(entities: dict[int, StepEntity]) -> dict[int, list[int]]:
    """Return the items of each aspect that has some, by its number."""
    items_of: dict[int, list[int]] = {}
    for entity in entities.values():
        if entity.kind in _USAGES and len(entity.references) > 2:
            aspect, _, *items = entity.references
            items_of.setdefault(aspect, []).extend(items)
    return items_of


def _parts_of_aspects(entities: dict[int, StepEntity]) -> dict[int, list[int]]:
    """Return the parts of each composite or derived aspect, by its number."""
    parts_of: dict[int, list[int]] = {}
    for entity in entities.values():
        if entity.kind in _PARTS and len(entity.references) == 2:
            whole, part = entity.references
            parts_of.setdefault(whole, []).append(part)
    return parts_of


def _below(start: int, items: dict[int, list[int]], parts: dict[int, list[int]]) -> Iterator[int]:
    """Go through the items of an aspect; those of its parts, of their parts and so on if it has none itself."""
    front = [start]
    aspects = {start}
    while front:
        aspect = front.pop(0)
        if aspect in items:
            yield from items[aspect]
            continue
        new = [part for part in parts.get(aspect, ()) if part not in aspects]
        aspects.update(new)
        front += new


# The shapes that the kernel leaves out: it reads one item of each aspect, the text of the file
# names all of them.
#
# Imports OCP; import this module only in the kernel's process.


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
class Semantic:
    """What a STEP file states about its part, in JSON values.

    Attributes
    ----------
    dimensions : list of dict
        See `read_semantic_dimensions`.
    surfaces : list of dict
        The faces with a flatness or profile tolerance.
    tolerances : list of dict
        All geometric tolerances, see `describe_tolerances`.
    datums : dict of str to list of dict
        The faces and edges of each datum, by its letter.
    disagreements : list of str
        What text and kernel say differently of these.
    """

    dimensions: list[dict[str, Any]] = field(default_factory=list)
    surfaces: list[dict[str, Any]] = field(default_factory=list)
    tolerances: list[dict[str, Any]] = field(default_factory=list)
    datums: dict[str, list[dict[str, Any]]] = field(default_factory=dict)
    disagreements: list[str] = field(default_factory=list)


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
        item_numbers = [{self._number(shape) for shape in side} - {None} for side in sides]
        for k in range(self._next_text, len(self._texts)):
            stated, items = self._texts[k]
            if self._fits(values, item_numbers, stated, items):
                self._next_text = k + 1
                return self._with_items(sides, item_numbers, k)
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
        self, sides: list[list[Any]], item_numbers: list[set[int | None]], text: int
    ) -> Completed:
        items = self._texts[text][1]
        whole = [list(side) for side in sides]
        unread = [0, 0]
        for k, side in enumerate(items):
            for item in side:
                if item in item_numbers[k] or self._is_whole_of(item, item_numbers[k]):
                    continue
                shapes = self.made_from(item)
                whole[k] += shapes
                unread[k] += not shapes
        return Completed(whole, unread, text)

    def _fits(
        self,
        values: Sequence[float] | None,
        item_numbers: list[set[int | None]],
        stated: Sequence[float],
        items: list[list[int]],
    ) -> bool:
        """Return whether the text of a dimension may be that of one of the kernel's."""
        if values and stated and not any(_same(a, b) for a in values for b in stated):
            return False
        named = {item for side in items for item in side}
        strangers = (item_numbers[0] | item_numbers[1]) - named
        return not strangers or strangers <= {
            part for item in named if self._is_group(item) for part in self._below(item)
        }

    def _is_group(self, item: int) -> bool:
        return item in self._entities and self._entities[item].kind not in _SHAPES

    def _below(self, item: int) -> set[int]:
        return reachable(self._entities, item)

    def _is_whole_of(self, item: int, item_numbers: set[int | None]) -> bool:
        """Return whether an item is a shell or the like, of which the kernel has the faces."""
        return self._is_group(item) and not item_numbers.isdisjoint(self._below(item))

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
        by_number: dict[int, list[Any]] = {}
        for shape in shapes:
            n_before = met.Extent()
            met.Add(unplaced(shape))
            number = self._number(shape) if met.Extent() > n_before else None
            if number is not None:
                by_number.setdefault(number, []).append(shape)
        return by_number


def _same(value: float, other: float) -> bool:
    return abs(abs(value) - abs(other)) <= _SAME * max(abs(value), 1.0)


# Where the instances of a part are: from a face of a part to the face of each of its solids in
# the assembly.
#
# The kernel attaches dimensions to the faces and edges of a part before the part is placed. One
# part may be placed several times, inside assemblies that are placed several times themselves. So
# every face, edge and vertex is looked up in every placed solid. Those of one dimension belong
# together where they are in the same instance.
#
# Imports OCP; import this module only in the kernel's process.


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
        occurrences = [list(self._occurrences(shape)) for shape in shapes]
        if not all(occurrences):
            if self._any_is_placed:
                raise AmbiguousInstanceError(_LOOSE)
            # auxiliary geometry is where it is stated, as all parts are
            loose = [Occurrence((), None, shape) for shape in shapes]
            occurrences = [
                row or [occurrence] for row, occurrence in zip(occurrences, loose, strict=True)
            ]
        return _together(occurrences, 0)

    def _index(self, part: Any) -> None:
        """Remember where the faces, edges and vertices of a part are, once for each part."""
        if self._parts.FindIndex(part):
            return
        self._parts.Add(part)
        index = ShapeMap()
        content: dict[int, list[Any]] = {}
        for kind in _KINDS:
            for shape in explore(part, kind):
                places = content.setdefault(index.Add(unplaced(shape)), [])
                if not any(shape.IsSame(other) for other in places):
                    places.append(shape)
        self._known.append(index)
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


def _together(occurrences: Sequence[Sequence[Occurrence]], depth: int) -> list[list[Occurrence]]:
    """Return the occurrences that belong together: of every shape one, below the lowest node that holds all of them."""
    places = sorted(
        {
            occurrence.path[depth]
            for places in occurrences
            for occurrence in places
            if len(occurrence.path) > depth
        }
    )
    below = [
        [
            [occurrence for occurrence in row if occurrence.path[depth : depth + 1] == (place,)]
            for row in occurrences
        ]
        for place in places
    ]
    whole = [rows for rows in below if all(rows)]
    if whole:
        return [instance for rows in whole for instance in _together(rows, depth + 1)]
    if all(len(row) == 1 for row in occurrences):
        return [[row[0] for row in occurrences]]
    counts = sorted({len(row) for row in occurrences})
    raise AmbiguousInstanceError(
        f"it is attached to parts that are there {' and '.join(map(str, counts))} times, "
        "and the file does not say which of them belong together"
    )


# Flatness and profile tolerances of a STEP file: how wide their zones are, and on which faces.
#
# A profile tolerance with datums says where a face is. Flatness, and a profile without datums,
# says how flat or true to form it is; the face of a datum is where the datum is, so there this
# says where the face is, too.
#
# Only tolerances of whole faces count. A flatness per unit of length or area allows more over the
# whole face, and is left out. Cylindricity and roundness are left out, too: they belong to what
# is measured, not to the plane that carries it.
#
# Reference: ISO 10303-242, geometric_tolerance, datum_feature; ISO 1101.


_TOLERANCES = {"FLATNESS_TOLERANCE": "flatness", "SURFACE_PROFILE_TOLERANCE": "profile"}
_WITH_DATUMS = "GEOMETRIC_TOLERANCE_WITH_DATUM_REFERENCE"
_UNEQUAL = "UNEQUALLY_DISPOSED_GEOMETRIC_TOLERANCE"
_PER_UNIT = "GEOMETRIC_TOLERANCE_WITH_DEFINED_UNIT"
# magnitude and what has the tolerance: in the part of a complex entity, and in a simple one
_FIELDS = r"\s*\(\s*''\s*,\s*(?:''|\$)\s*,\s*#([0-9]+)\s*,\s*#([0-9]+)"
_HEAD = re.compile(r"(?<![A-Z_])GEOMETRIC_TOLERANCE" + _FIELDS, re.IGNORECASE)
_START = re.compile(r"^\s*[A-Z_]+" + _FIELDS, re.IGNORECASE)
_MOVED = re.compile(_UNEQUAL + r"\s*\(\s*#([0-9]+)", re.IGNORECASE)


@dataclass(frozen=True)
class SurfaceTolerance:
    """A flatness or profile tolerance as the text states it.

    Attributes
    ----------
    tolerance : str
        "flatness" or "profile".
    width_mm : float
        Width of the zone. Of one that lies unequally about the surface, the width of an equal one that holds it.
    with_datums : bool
        It refers to datums.
    items : tuple of int
        Numbers of the faces and other items that it is attached to.
    """

    tolerance: str
    width_mm: float
    with_datums: bool
    items: tuple[int, ...]


def list_surface_tolerances(entities: dict[int, StepEntity]) -> list[SurfaceTolerance]:
    """Return the flatness and profile tolerances of a file in its order.

    Parameters
    ----------
    entities : dict
        See `text.parse_entities`.
    """
    below = list_items_below(entities)
    tolerances = []
    for entity in entities.values():
        kinds = entity.kinds
        words = [word for kind, word in _TOLERANCES.items() if kind in kinds]
        if not words or _PER_UNIT in kinds:
            continue
        width = _width_mm(entities, entity)
        items = tuple(item for aspect in _aspect(entity) for item in below(aspect))
        if width is not None and items:
            tolerances.append(SurfaceTolerance(words[0], width, _WITH_DATUMS in kinds, items))
    return tolerances


def list_datum_items(entities: dict[int, StepEntity]) -> set[int]:
    """Return the numbers of the items that are features of datums."""
    below = list_items_below(entities)
    return {
        item
        for number, entity in entities.items()
        if "DATUM_FEATURE" in entity.kinds
        for item in below(number)
    }


def place_surface_tolerances(
    entities: dict[int, StepEntity], attached: AttachedShapes, instances: Instances
) -> Iterator[tuple[dict[str, Any], Any]]:
    """Yield what is stated of each toleranced face, and the face in each place in the assembly.

    Parameters
    ----------
    entities : dict
        See `text.parse_entities`.
    attached : AttachedShapes
        Knows the shapes that were made from items.
    instances : Instances
        Where they are.
    """
    of_datums = list_datum_items(entities)
    for stated in list_surface_tolerances(entities):
        for item in stated.items:
            row = {
                "tolerance": stated.tolerance,
                "width_mm": stated.width_mm,
                "places": stated.with_datums or item in of_datums,
            }
            for shape in attached.made_from(item):
                try:
                    occurrences = instances.of([shape])
                except AmbiguousInstanceError:
                    continue
                yield from (
                    (row, occurrence.shape) for instance in occurrences for occurrence in instance
                )


def describe_tolerances(
    entities: dict[int, StepEntity],
    stated: Sequence[StatedTolerance],
    attached: AttachedShapes,
    instances: Instances,
) -> list[dict[str, Any]]:
    """Return all geometric tolerances in JSON values, with the faces or edges they are attached to.

    Parameters
    ----------
    entities : dict
        See `text.parse_entities`.
    stated : sequence of StatedTolerance
        What the text states.
    attached : AttachedShapes
        Knows the shapes that were made from items.
    instances : Instances
        Where they are.

    Returns
    -------
    list of dict
        The attributes of a `StatedTolerance`; ``shapes`` in all places in the assembly, see `describe`; ``unread``, the
        number of items that no shape is made from.
    """
    below = list_items_below(entities)
    rows = []
    for tolerance in stated:
        shapes: list[dict[str, Any]] = []
        n_unread = 0
        for item in below(tolerance.aspect):
            made = attached.made_from(item)
            n_unread += not made
            shapes += [describe(place) for shape in made for place in _places(shape, instances)]
        rows.append({**asdict(tolerance), "shapes": shapes, "unread": n_unread})
    return rows


def _describe_datums(
    entities: dict[int, StepEntity],
    features: Mapping[str, Sequence[int]],
    attached: AttachedShapes,
    instances: Instances,
) -> dict[str, list[dict[str, Any]]]:
    """Return the faces and edges of each datum, by its letter."""
    below = list_items_below(entities)
    shapes: dict[str, list[dict[str, Any]]] = {}
    for letter, aspects in features.items():
        shapes[letter] = [
            describe(place)
            for aspect in aspects
            for item in below(aspect)
            for shape in attached.made_from(item)
            for place in _places(shape, instances)
        ]
        if any(not TARGETS.isdisjoint(entities[aspect].kinds) for aspect in aspects):
            shapes[letter].append({"kind": "target"})
    return shapes


def _places(shape: Any, instances: Instances) -> list[Any]:
    """Return a shape in each of its places in the assembly; none if these are not known."""
    try:
        return [place.shape for instance in instances.of([shape]) for place in instance]
    except AmbiguousInstanceError:
        return []


def _kernel_tolerances(tool: Any) -> list[tuple[str, float]]:
    """Return the type and the zone in mm of each geometric tolerance that the kernel has."""
    labels = Sequence_TDF_Label()
    tool.GetGeomToleranceLabels(labels)
    pairs = []
    for k in range(1, labels.Length() + 1):
        read = XCAFDoc_GeomTolerance.Set_s(labels.Value(k)).GetObject()
        pairs.append((read.GetType().name.split("GeomToleranceType_")[-1], read.GetValue()))
    return pairs


def _width_mm(entities: dict[int, StepEntity], entity: StepEntity) -> float | None:
    """Return the width of a zone in mm; None if it is none."""
    width = _first_measure(entities, _HEAD.search(entity.text) or _START.search(entity.text))
    if width is None or width <= 0.0:
        return None
    if _UNEQUAL not in entity.kinds:
        return width
    moved = _first_measure(entities, _MOVED.search(entity.text))
    if moved is None:
        return None
    # writers state what lies outside the material, or how far the middle is off: the wider of both
    return 2.0 * max(abs(moved), abs(width - moved), 0.5 * width + abs(moved))


def _first_measure(entities: dict[int, StepEntity], match: re.Match[str] | None) -> float | None:
    number = int(match[1]) if match else 0
    return read_measure(entities, number)


def _aspect(entity: StepEntity) -> list[int]:
    """Return the number of what has a tolerance, if there is one."""
    match = _HEAD.search(entity.text) or _START.search(entity.text)
    return [int(match[2])] if match else []


CANONICAL_MM = 1e-3
"""A free-form face or edge that leaves a plane, cylinder, line or circle by less is one: some writers know no other."""

_ONLY_SHOWN = ("DimensionPresentation", "CommonLabel")


def read_semantic_dimensions(
    path: Path, name: str, entities: dict[int, StepEntity], texts: Mapping[int, tuple[str, ...]]
) -> Semantic:
    """Return the semantic dimensions of a STEP file, in its order, and its geometric tolerances.

    Parameters
    ----------
    path : Path
        An uncompressed STEP file.
    name : str
        What to call it in messages.
    entities : dict
        Its entities, see `text.parse_entities`.
    texts : mapping
        Those of the dimensions and tolerances, see `text.parse_texts`.

    Returns
    -------
    Semantic
        ``dimensions`` have ``type`` (of OCCT), ``words`` (of the file), ``name`` (of its drawing, or empty),
        ``values`` in mm or degrees or None, ``is_range``, ``has_bounds``, and ``sides``: two lists of shapes as in the
        part, see `describe`.
        ``unread`` is the number of items of each side that no shape is made from. ``compared`` says that the text was
        found, and with it all items.
        ``instances`` says where these are in the assembly: for each instance ``sides``, and ``solids``, their numbers.
        It is empty if this is not known; ``unresolved`` then says why.
        ``surfaces`` have ``tolerance``, ``width_mm``, ``places`` (it says where the face is), and ``face``.

    Raises
    ------
    ReadError
        The kernel cannot read the file.
    """
    document = TDocStd_Document(TCollection_ExtendedString("XmlXCAF"))
    XCAFApp_Application.GetApplication_s().InitDocument(document)
    reader = STEPCAFControl_Reader()
    reader.SetGDTMode(True)
    reader.SetColorMode(False)
    with quiet():
        Interface_Static.SetCVal_s("xstep.cascade.unit", "MM")
        read = reader.ReadFile(str(path)) == IFSelect_ReturnStatus.IFSelect_RetDone
        if not (read and reader.Transfer(document)):
            raise ReadError(
                f"a .step or .stp file must be a STEP file. Got {name}, which OCCT cannot read."
            )
    tool = XCAFDoc_DocumentTool.DimTolTool_s(document.Main())
    labels = Sequence_TDF_Label()
    tool.GetDimensionLabels(labels)
    words = list_words(entities, texts)
    tolerances = list_stated_tolerances(entities, texts)
    of_kernel = _kernel_tolerances(tool)
    if not (labels.Length() or words or tolerances or of_kernel):
        return Semantic()
    kernel = reader.ChangeReader()
    numbers = number_entities(kernel.Model(), entities, name)
    instances = _instances(kernel, numbers, entities, name)
    attached = AttachedShapes(kernel.WS().TransferReader(), numbers, entities, kernel.OneShape())
    stated = [_stated(tool, labels.Value(k)) for k in range(1, labels.Length() + 1)]
    completed = [
        (row, attached.complete(row["values"], sides))
        for row, sides in stated
        if row["type"] not in _ONLY_SHOWN
    ]
    dimensions = [
        _dimension(row, shapes, attached, instances)
        for row, shapes in _with_left_out(completed, list_dimensions(entities), words, attached)
    ]
    surfaces = [
        {**row, "face": describe(face)}
        for row, face in place_surface_tolerances(entities, attached, instances)
    ]
    described = describe_tolerances(entities, tolerances, attached, instances)
    features = list_datum_features(entities, texts)
    datums = _describe_datums(entities, features, attached, instances)
    differences = disagreements(tolerances, of_kernel)
    return Semantic(dimensions, surfaces, described, datums, differences)


def _instances(
    reader: Any, numbers: dict[Any, int], entities: dict[int, StepEntity], name: str
) -> Instances:
    """Return the instances of parts, with the numbers that the solids have where the part is read."""
    listed = {solid.number: solid for solid in list_solids(entities)}
    shape = reader.OneShape()
    numbered = number_solids(reader, shape, numbers)
    slots = in_file_order(numbered, listed, name)
    if len(slots) == len(numbered):
        return Instances(shape, range(len(numbered)))
    # without an assembly, every solid is there once
    place = {number: k for k, (_, number) in enumerate(slots)}
    return Instances(shape, [place[number] for _, number in numbered])


def _stated(tool: Any, label: Any) -> tuple[dict[str, Any], list[list[Any]]]:
    """Return what the kernel knows of a dimension, and the shapes of its two sides as in the part."""
    # FindAttribute leaves a null handle here; Set_s returns the attribute there is
    stated = XCAFDoc_Dimension.Set_s(label).GetObject()
    values = stated.GetValues()
    words = stated.GetSemanticName()
    title = stated.GetPresentationName()
    first = Sequence_TDF_Label()
    second = Sequence_TDF_Label()
    tool.GetRefShapeLabel_s(label, first, second)
    row = {
        "type": stated.GetType().name.split("DimensionType_")[-1],
        "words": words.ToCString() if words is not None else "",
        "name": title.ToCString() if title is not None else "",
        "values": None
        if values is None
        else [values.Value(k) for k in range(values.Lower(), values.Upper() + 1)],
        "is_range": stated.IsDimWithRange(),
        "has_bounds": stated.IsDimWithPlusMinusTolerance(),
    }
    return row, [_shapes(first), _shapes(second)]


def _with_left_out(
    dimensions: list[tuple[dict[str, Any], Completed]],
    texts: list[StatedDimension],
    words: list[tuple[str, str]],
    attached: AttachedShapes,
) -> list[tuple[dict[str, Any], Completed]]:
    """Return the kernel's dimensions with those that only the text has, in the order of the file."""
    text_numbers = {shapes.text for _, shapes in dimensions}
    # each of the kernel's dimensions without a text may be one of those
    unknown = [row["values"] or [] for row, shapes in dimensions if shapes.text is None]
    whole = list(dimensions)
    for k, (stated, (kind, word)) in enumerate(zip(texts, words, strict=True)):
        if k in text_numbers:
            continue
        row = _row_of_text(stated, kind, word)
        same = next((v for v in unknown if _shared(v, row["values"] or [])), None)
        if same is not None:
            unknown.remove(same)
            continue
        later = (i for i, (_, shapes) in enumerate(whole) if (shapes.text or 0) > k)
        whole.insert(next(later, len(whole)), (row, attached.of_text(k)))
    return whole


def _shared(values: list[float], others: list[float]) -> bool:
    """Return whether two dimensions state the same value, or none."""
    return any(math.isclose(a, b, rel_tol=1e-6) for a in values for b in others) or not (
        values or others
    )


def _row_of_text(stated: StatedDimension, kind: str, word: str) -> dict[str, Any]:
    """Return what the text says of a dimension that the kernel leaves out, in the form of the kernel."""
    values = [*stated.values, *map(abs, stated.bounds or ())] if stated.values else None
    return {
        "type": "".join(part.title() for part in kind.split("_")),
        "words": word,
        "name": "",
        "values": values,
        "is_range": len(stated.values) == 2,
        "has_bounds": stated.bounds is not None,
    }


def _dimension(
    row: dict[str, Any], completed: Completed, attached: AttachedShapes, instances: Instances
) -> dict[str, Any]:
    """Return a dimension with all that it is attached to."""
    placed = _placed(completed.sides, instances)
    if not any(completed.sides):
        placed["unresolved"] = attached.why_nothing(completed.text)
    return {
        **row,
        "unread": completed.unread,
        "compared": completed.text is not None,
        "sides": [[describe(shape) for shape in side] for side in completed.sides],
        **placed,
    }


def _placed(sides: list[list[Any]], instances: Instances) -> dict[str, Any]:
    """Return the shapes of a dimension for each instance of the part, or why they are not known."""
    n_first = len(sides[0])
    shapes = [*sides[0], *sides[1]]
    if not shapes:
        return {"instances": [], "unresolved": ""}
    try:
        placements = instances.of(shapes)
    except AmbiguousInstanceError as error:
        return {"instances": [], "unresolved": str(error)}
    return {
        "instances": [
            {
                "solids": sorted({place.solid for place in instance if place.solid is not None}),
                "sides": [
                    [describe(occurrence.shape) for occurrence in side]
                    for side in (instance[:n_first], instance[n_first:])
                ],
            }
            for instance in placements
        ],
        "unresolved": "",
    }


def _shapes(labels: Any) -> list[Any]:
    shapes: list[Any] = []
    for k in range(1, labels.Length() + 1):
        shapes += _simple_parts(XCAFDoc_ShapeTool.GetShape_s(labels.Value(k)))
    return shapes


def _simple_parts(shape: Any) -> list[Any]:
    """Return the faces, or failing these edges, or failing these vertices of a shape."""
    for kind in (
        TopAbs_ShapeEnum.TopAbs_FACE,
        TopAbs_ShapeEnum.TopAbs_EDGE,
        TopAbs_ShapeEnum.TopAbs_VERTEX,
    ):
        parts = explore(shape, kind)
        if parts:
            return parts
    return []


def describe(shape: Any) -> dict[str, Any]:
    """Return the geometry of a face, edge or vertex in JSON values: its kind, its numbers in mm, and its bounds.

    Parameters
    ----------
    shape : TopoDS_Shape
        A face, edge or vertex.

    Returns
    -------
    dict
        ``kind``: "plane", "cylinder", "cone" and "sphere", "line" and "circle", "point", or "free form". Planes have
        ``point`` and ``axis`` (the normal); the round ones ``point`` (on the axis), ``axis`` and ``radius``, cones
        ``angle_deg`` between opposite sides instead; lines ``ends``. Faces have ``edges``, each described likewise.
    """
    if shape.ShapeType() == TopAbs_ShapeEnum.TopAbs_VERTEX:
        return {"kind": "point", "point": list(xyz(BRep_Tool.Pnt_s(TopoDS.Vertex(shape))))}
    if shape.ShapeType() == TopAbs_ShapeEnum.TopAbs_EDGE:
        return _edge(TopoDS.Edge(shape))
    around = explore(shape, TopAbs_ShapeEnum.TopAbs_EDGE)
    edges = [_edge(edge) for edge in map(TopoDS.Edge, around) if not BRep_Tool.Degenerated_s(edge)]
    return _surface(TopoDS.Face(shape)) | {"edges": edges}


def _surface(face: Any) -> dict[str, Any]:
    surface = BRepAdaptor_Surface(face)
    kind = surface.GetType()
    if kind == GeomAbs_SurfaceType.GeomAbs_Plane:
        return _about("plane", surface.Plane())
    if kind == GeomAbs_SurfaceType.GeomAbs_Cylinder:
        return _about("cylinder", surface.Cylinder())
    if kind == GeomAbs_SurfaceType.GeomAbs_Cone:
        return _about("cone", surface.Cone())
    if kind == GeomAbs_SurfaceType.GeomAbs_Sphere:
        return _about("sphere", surface.Sphere())
    recognised = ShapeAnalysis_CanonicalRecognition(face)
    plane = gp_Pln()
    cylinder = gp_Cylinder()
    cone = gp_Cone()
    sphere = gp_Sphere()
    if recognised.IsPlane(CANONICAL_MM, plane):
        return _about("plane", plane)
    if recognised.IsCylinder(CANONICAL_MM, cylinder):
        return _about("cylinder", cylinder)
    if recognised.IsCone(CANONICAL_MM, cone):
        return _about("cone", cone)
    return (
        _about("sphere", sphere)
        if recognised.IsSphere(CANONICAL_MM, sphere)
        else {"kind": "free form"}
    )


def _edge(edge: Any) -> dict[str, Any]:
    curve = BRepAdaptor_Curve(edge)
    recognised = ShapeAnalysis_CanonicalRecognition(edge)
    line = gp_Lin()
    circle = gp_Circ()
    if curve.GetType() == GeomAbs_CurveType.GeomAbs_Line or recognised.IsLine(CANONICAL_MM, line):
        ends = [curve.Value(curve.FirstParameter()), curve.Value(curve.LastParameter())]
        return {"kind": "line", "ends": [list(xyz(end)) for end in ends]}
    if curve.GetType() == GeomAbs_CurveType.GeomAbs_Circle:
        return _about("circle", curve.Circle())
    return (
        _about("circle", circle)
        if recognised.IsCircle(CANONICAL_MM, circle)
        else {"kind": "free form"}
    )


def _about(kind: str, shape: Any) -> dict[str, Any]:
    row: dict[str, Any] = {"kind": kind, "point": list(xyz(shape.Location()))}
    if kind != "sphere":
        row["axis"] = list(xyz(shape.Axis().Direction()))
    if kind == "cone":
        row["angle_deg"] = 2.0 * math.degrees(abs(shape.SemiAngle()))
    elif kind != "plane":
        row["radius"] = shape.Radius()
    return row
