"""The semantic dimensions of a STEP file (AP242) with the shapes they are attached to, as the kernel finds them.

Objects that only draw a dimension, or label something, are left out: they say nothing a program could check.

Imports OCP; import this module only in the kernel's process.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from OCP.BRep import BRep_Tool
from OCP.BRepAdaptor import BRepAdaptor_Curve, BRepAdaptor_Surface
from OCP.collections import Sequence_TDF_Label
from OCP.GeomAbs import GeomAbs_CurveType, GeomAbs_SurfaceType
from OCP.gp import gp_Circ, gp_Cone, gp_Cylinder, gp_Lin, gp_Pln, gp_Sphere
from OCP.IFSelect import IFSelect_ReturnStatus
from OCP.Interface import Interface_Static
from OCP.ShapeAnalysis import ShapeAnalysis_CanonicalRecognition
from OCP.STEPCAFControl import STEPCAFControl_Reader
from OCP.TCollection import TCollection_ExtendedString
from OCP.TDocStd import TDocStd_Document
from OCP.TopAbs import TopAbs_ShapeEnum
from OCP.TopoDS import TopoDS
from OCP.XCAFApp import XCAFApp_Application
from OCP.XCAFDoc import XCAFDoc_Dimension, XCAFDoc_DocumentTool, XCAFDoc_ShapeTool

from aspectgraph.exceptions import ReadError
from aspectgraph.read.step.listing import list_solids
from aspectgraph.read.step.semantic.attached_shapes import AttachedShapes, Completed
from aspectgraph.read.step.semantic.instances import AmbiguousInstanceError, Instances
from aspectgraph.read.step.semantic.stated_dimensions import (
    StatedDimension,
    list_dimensions,
    list_words,
)
from aspectgraph.read.step.semantic.surface_tolerances import place_surface_tolerances
from aspectgraph.read.step.shapes import explore, xyz
from aspectgraph.read.step.solids import in_file_order, number_entities, number_solids, quiet
from aspectgraph.read.step.text import StepEntity

CANONICAL_MM = 1e-3
"""A free-form face or edge that leaves a plane, cylinder, line or circle by less is one: some writers know no other."""

_ONLY_SHOWN = ("DimensionPresentation", "CommonLabel")


def read_semantic_dimensions(
    path: Path, name: str, entities: dict[int, StepEntity], texts: Mapping[int, tuple[str, ...]]
) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Return the semantic dimensions of a STEP file, in its order, and the faces with a flatness or profile tolerance.

    Parameters
    ----------
    path : Path
        An uncompressed STEP file.
    name : str
        What to call it in messages.
    entities : dict
        Its entities, see `text.parse_entities`.
    texts : mapping
        Those of the dimensions, see `text.parse_texts`.

    Returns
    -------
    dimensions : list of dict
        ``type`` (of OCCT), ``words`` (of the file), ``name`` (of its drawing, or empty), ``values`` in mm or degrees or
        None, ``is_range``, ``has_bounds``, and ``sides``: two lists of shapes as in the part, see `describe`.
        ``unread`` is the number of items of each side that no shape is made from. ``compared`` says that the text was
        found, and with it all items.
        ``instances`` says where these are in the assembly: for each instance ``sides``, and ``solids``, their numbers.
        It is empty if this is not known; ``unresolved`` then says why.
    surfaces : list of dict
        ``tolerance``, ``width_mm``, ``places`` (it says where the face is), and ``face``, see `describe`.

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
    if not labels.Length() and not words:
        return [], []
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
    return dimensions, surfaces


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
    found: list[tuple[dict[str, Any], Completed]],
    texts: list[StatedDimension],
    words: list[tuple[str, str]],
    attached: AttachedShapes,
) -> list[tuple[dict[str, Any], Completed]]:
    """Return the kernel's dimensions with those that only the text has, in the order of the file."""
    known = {shapes.text for _, shapes in found}
    # each of the kernel's dimensions without a text may be one of those
    unknown = [row["values"] or [] for row, shapes in found if shapes.text is None]
    whole = list(found)
    for k, (stated, (kind, word)) in enumerate(zip(texts, words, strict=True)):
        if k in known:
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
        found = instances.of(shapes)
    except AmbiguousInstanceError as error:
        return {"instances": [], "unresolved": str(error)}
    return {
        "instances": [
            {
                "solids": sorted({one.solid for one in instance if one.solid is not None}),
                "sides": [
                    [describe(occurrence.shape) for occurrence in side]
                    for side in (instance[:n_first], instance[n_first:])
                ],
            }
            for instance in found
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
