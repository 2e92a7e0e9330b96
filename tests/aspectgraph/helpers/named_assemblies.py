"""An assembly with names of all kinds as a STEP file, and what XCAF of the kernel says about any file.

XCAF is the kernel's own reader of names: it shares no code with the reader of the text.

Imports OCP.
"""

from __future__ import annotations

from OCP.Bnd import Bnd_Box
from OCP.BRepBndLib import BRepBndLib
from OCP.BRepPrimAPI import BRepPrimAPI_MakeBox
from OCP.collections import Sequence_TDF_Label
from OCP.gp import gp_Trsf, gp_Vec
from OCP.STEPCAFControl import STEPCAFControl_Reader, STEPCAFControl_Writer
from OCP.STEPControl import STEPControl_StepModelType
from OCP.TCollection import TCollection_ExtendedString
from OCP.TDataStd import TDataStd_Name
from OCP.TDF import TDF_Label
from OCP.TDocStd import TDocStd_Document
from OCP.TopAbs import TopAbs_ShapeEnum
from OCP.TopLoc import TopLoc_Location
from OCP.XCAFApp import XCAFApp_Application
from OCP.XCAFDoc import XCAFDoc_DocumentTool, XCAFDoc_ShapeTool

from aspectgraph.read.step.solids import explore, quiet


def _document():
    document = TDocStd_Document(TCollection_ExtendedString("doc"))
    XCAFApp_Application.GetApplication_s().NewDocument(
        TCollection_ExtendedString("MDTV-XCAF"), document
    )
    return document, XCAFDoc_DocumentTool.ShapeTool_s(document.Main())


def _place(x, y, z):
    move = gp_Trsf()
    move.SetTranslation(gp_Vec(x, y, z))
    return TopLoc_Location(move)


def _name(label, text):
    TDataStd_Name.Set_s(label, TCollection_ExtendedString(text, True))


def write_assembly(path):
    """Write blocks: "Gehäuse, groß" once, "12" thrice in each of two groups, and two named alike.

    The groups hold the same pins at the same places, so only the way to a pin tells them apart.
    """
    document, tool = _document()
    root = tool.NewShape()
    _name(root, "root")
    shapes = {}
    for text, size in (
        ("Gehäuse, groß", (30, 20, 10)),
        ("12", (2, 3, 4)),
        ('sub "A"', (5, 5, 6)),
        ("twin", (7, 8, 9)),
    ):
        shapes[text] = tool.AddShape(BRepPrimAPI_MakeBox(*map(float, size)).Shape(), False)
        _name(shapes[text], text)
    twin = tool.AddShape(BRepPrimAPI_MakeBox(9.0, 8.0, 7.0).Shape(), False)
    _name(twin, "twin")
    groups = []
    for text in ("left", "right"):
        group = tool.NewShape()
        _name(group, text)
        for k in range(3):
            _name(tool.AddComponent(group, shapes["12"], _place(5.0 * k, 0, 0)), f"pin-{k + 1}")
        groups.append(group)
    for group, x in zip(groups, (0.0, 50.0), strict=True):
        _name(tool.AddComponent(root, group, _place(x, 60, 0)), f"group-{x:g}")
    for k, label in enumerate((shapes["Gehäuse, groß"], shapes['sub "A"'], shapes["twin"], twin)):
        _name(tool.AddComponent(root, label, _place(0, 0, 40.0 * k)), f"inst{k}")
    tool.UpdateAssemblies()
    _write(document, path)


def _write(document, path):
    writer = STEPCAFControl_Writer()
    writer.SetNameMode(True)
    with quiet():
        writer.Transfer(document, STEPControl_StepModelType.STEPControl_AsIs)
        writer.Write(str(path))


def _text(label):
    attribute = TDataStd_Name()
    if not label.FindAttribute(TDataStd_Name.GetID_s(), attribute):
        return ""
    return attribute.Get().ToExtString()


def corner(shape):
    """Return the lowest corner of the box around a shape, rounded."""
    box = Bnd_Box()
    BRepBndLib.AddOptimal_s(shape, box, False, False)
    low = box.CornerMin()
    return tuple(round(x, 3) + 0.0 for x in (low.X(), low.Y(), low.Z()))


def xcaf_names(path):
    """Return product, names of the instances, and the lowest corner of each solid, as XCAF has them."""
    document, tool = _document()
    reader = STEPCAFControl_Reader()
    reader.SetNameMode(True)
    with quiet():
        reader.ReadFile(str(path))
        reader.Transfer(document)
    labels = Sequence_TDF_Label()
    tool.GetFreeShapes(labels)
    rows = []

    def walk(label, place, names):
        parts = Sequence_TDF_Label()
        if XCAFDoc_ShapeTool.IsAssembly_s(label):
            XCAFDoc_ShapeTool.GetComponents_s(label, parts)
            for k in range(1, parts.Length() + 1):
                part = parts.Value(k)
                product = TDF_Label()
                XCAFDoc_ShapeTool.GetReferredShape_s(part, product)
                inside = place.Multiplied(XCAFDoc_ShapeTool.GetLocation_s(part))
                walk(product, inside, (*names, _text(part)))
            return
        shape = XCAFDoc_ShapeTool.GetShape_s(label).Moved(place)
        for solid in explore(shape, TopAbs_ShapeEnum.TopAbs_SOLID):
            rows.append((_text(label), names, corner(solid)))

    for k in range(1, labels.Length() + 1):
        walk(labels.Value(k), TopLoc_Location(), ())
    return rows
