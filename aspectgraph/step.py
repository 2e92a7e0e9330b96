"""STEP files: read with OCCT, solid by solid, in millimetres."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from aspectgraph.exceptions import MissingExtraError, NonManifoldError, ReadError, SelfIntersectionError, SolidError
from aspectgraph.facets import Tessellation, assemble
from aspectgraph.solid import Solid
from aspectgraph.validation import RELATIVE_PLANARITY

RELATIVE_CHORD = 1e-3
"""Default chord tolerance as a fraction of the bounding box diagonal of the solids read."""

_MAX_REFINEMENTS = 3


def read_step(
    path: Path,
    *,
    chord_tolerance_mm: float | None = None,
    angular_tolerance_deg: float = 30.0,
    planarity_mm: float | None = None,
    solids: Sequence[int] | None = None,
    name: str = "",
) -> Solid:
    """Read the solids of a STEP file as one polyhedral solid, in mm.

    Parameters
    ----------
    path : Path
        An uncompressed STEP file.
    chord_tolerance_mm : float, optional
        Largest distance between a curved face and the flat facets that stand for it. Default: a thousandth of the
        bounding box diagonal. If the facets of neighbouring walls would run into each other, a quarter of it is tried,
        up to three times; a tolerance given is never exceeded.
    angular_tolerance_deg : float
        Largest turn between neighbouring chords of a curve.
    planarity_mm : float, optional
        Facets this close to one plane become one face; see `assemble`.
    solids : sequence of int, optional
        Which solids of the file to read, counted from 0; default: all.
    name : str
        Name of the part.

    Raises
    ------
    MissingExtraError
        The package cadquery-ocp-novtk is not installed.
    ReadError
        The file is not a STEP file, or holds no closed solid.
    SolidError
        A solid is not valid, or solids overlap or touch.
    """
    shapes, left_out = _load_solids(path)
    shapes = _select(shapes, solids, path)
    diagonal = _diagonal_mm(shapes)
    chord = diagonal * RELATIVE_CHORD if chord_tolerance_mm is None else float(chord_tolerance_mm)
    options = {"angle_deg": angular_tolerance_deg, "flat_mm": diagonal * RELATIVE_PLANARITY, "name": name}
    options["notes"] = left_out
    try:
        for _ in range(_MAX_REFINEMENTS):
            solid = _build(shapes, chord, planarity_mm, last=False, **options)
            if solid is not None:
                return solid
            chord /= 4.0
        return _build(shapes, chord, planarity_mm, last=True, **options)
    except (SelfIntersectionError, NonManifoldError) as error:
        if len(shapes) == 1:
            raise
        hint = f"The file holds {len(shapes)} solids; read some of them with solids=[...]."
        raise type(error)(f"{error} {hint}") from error


def _build(shapes, chord_mm: float, planarity_mm, *, last: bool, angle_deg: float, flat_mm: float, name: str, notes):
    """Return the solid, or None if its facets run into each other and a finer chord tolerance could help."""
    from aspectgraph.brep import tessellate

    parts = [tessellate(shape, chord_mm, math.radians(angle_deg), flat_mm) for shape in shapes]
    curved = any(part.curved_patch.any() for part in parts)
    notes = list(notes)
    if curved:
        notes.append(f"curved faces tessellated with a chord tolerance of {chord_mm:.4g} mm and {angle_deg:g} degrees")
    if len(shapes) > 1:
        notes.append(f"{len(shapes)} solids")
    try:
        return assemble(_concatenate(parts), name=name, planarity_mm=planarity_mm, notes=notes)
    except SolidError:
        if last or not curved:
            raise
        return None


def _concatenate(parts: list[Tessellation]) -> Tessellation:
    first_vertex = np.cumsum([0] + [len(part.vertices) for part in parts]).tolist()
    first_patch = np.cumsum([0] + [len(part.curved_patch) for part in parts]).tolist()
    curved = {(a + v, b + v) for part, v in zip(parts, first_vertex, strict=False) for a, b in part.curved_edges}
    return Tessellation(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([part.triangles + v for part, v in zip(parts, first_vertex, strict=False)]),
        np.concatenate([part.patch + p for part, p in zip(parts, first_patch, strict=False)]),
        np.concatenate([part.curved_patch for part in parts]),
        curved,
    )


def _load_solids(path: Path) -> tuple[list, list[str]]:
    """Return the solids of the file, each once, in file order, and notes on what is left out."""
    try:
        from OCP.IFSelect import IFSelect_ReturnStatus
        from OCP.Interface import Interface_Static
        from OCP.STEPControl import STEPControl_Reader
        from OCP.TopAbs import TopAbs_ShapeEnum

        from aspectgraph.brep import explore
    except ImportError as error:
        raise MissingExtraError(
            f"STEP files need the package cadquery-ocp-novtk, 8 or newer. Got {error}; "
            "install it with: pip install aspectgraph[step]"
        ) from error
    with _quiet():
        reader = STEPControl_Reader()
        Interface_Static.SetCVal_s("xstep.cascade.unit", "MM")
        if reader.ReadFile(str(path)) != IFSelect_ReturnStatus.IFSelect_RetDone:
            raise ReadError(f"a .step or .stp file must be a STEP file. Got {path.name}, which OCCT cannot read.")
        _check_model(reader.Model(), path)
        reader.TransferRoots()
    shape = reader.OneShape()
    if shape is None or shape.IsNull():
        raise ReadError(f"a STEP file must hold at least one closed solid. Got {path.name} without any shape.")
    solids = explore(shape, TopAbs_ShapeEnum.TopAbs_SOLID)
    if not solids:
        n = len(explore(shape, TopAbs_ShapeEnum.TopAbs_FACE))
        raise ReadError(f"a STEP file must hold at least one closed solid. Got {path.name} with {n} loose faces only.")
    return solids, _left_out(shape)


def _left_out(shape) -> list[str]:
    """Return a note on faces and edges that belong to no solid, such as annotations."""
    from OCP.TopAbs import TopAbs_ShapeEnum

    from aspectgraph.brep import explore

    n_faces = len(explore(shape, TopAbs_ShapeEnum.TopAbs_FACE, outside=TopAbs_ShapeEnum.TopAbs_SOLID))
    n_edges = len(explore(shape, TopAbs_ShapeEnum.TopAbs_EDGE, outside=TopAbs_ShapeEnum.TopAbs_FACE))
    return [f"left out {n_faces} faces and {n_edges} edges that belong to no solid"] if n_faces or n_edges else []


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep OCCT from printing; what it would say is checked and raised instead."""
    from OCP.Message import Message

    messenger = Message.DefaultMessenger_s()
    printers = [messenger.Printers().Value(k) for k in range(1, messenger.Printers().Length() + 1)]
    for printer in printers:
        messenger.RemovePrinter(printer)
    try:
        yield
    finally:
        for printer in printers:
            messenger.AddPrinter(printer)


def _check_model(model, path: Path) -> None:
    """Refuse files whose geometry is damaged; OCCT would leave such faces out without a word.

    Errors in other entities (annotations, styles) are common in good files and do no harm.
    """
    n_fails = model.GlobalCheck().NbFails()
    if n_fails:
        raise ReadError(f"a STEP file must be whole. Got {path.name} with {n_fails} syntax errors or missing entities.")
    kinds = [model.Value(i).DynamicType().Name() for i in range(1, model.NbEntities() + 1) if model.IsErrorEntity(i)]
    damaged = sorted({kind.split("_", 1)[1] for kind in kinds if kind.startswith(("StepShape_", "StepGeom_"))})
    if damaged:
        raise ReadError(
            f"the geometry of a STEP file must be whole. Got {path.name} with errors in {', '.join(damaged)}."
        )


def _select(shapes: list, wanted: Sequence[int] | None, path: Path) -> list:
    if wanted is None:
        return shapes
    bad = [i for i in wanted if not 0 <= i < len(shapes)]
    if bad or not len(wanted):
        raise ReadError(f"solids must name some of 0..{len(shapes) - 1} of {path.name}. Got {list(wanted)}.")
    return [shapes[i] for i in wanted]


def _diagonal_mm(shapes: list) -> float:
    from OCP.Bnd import Bnd_Box
    from OCP.BRepBndLib import BRepBndLib

    box = Bnd_Box()
    for shape in shapes:
        BRepBndLib.AddOptimal_s(shape, box, False, False)
    low, high = box.CornerMin(), box.CornerMax()
    return math.dist((low.X(), low.Y(), low.Z()), (high.X(), high.Y(), high.Z()))
