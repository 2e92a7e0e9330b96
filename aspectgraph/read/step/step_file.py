"""STEP files: read with OCCT in a process of its own, solid by solid, in millimetres."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from aspectgraph.exceptions import NonManifoldError, ReadError, SelfIntersectionError, SolidError
from aspectgraph.read.join_faces import assemble
from aspectgraph.read.limits import ReadLimits
from aspectgraph.read.step.circles import unpack_circles
from aspectgraph.read.step.client import StepKernel
from aspectgraph.read.step.fit import RELATIVE_CHORD, check_fit
from aspectgraph.read.tessellation import Tessellation
from aspectgraph.solid.checks import RELATIVE_PLANARITY
from aspectgraph.solid.solid import Solid

_MAX_REFINEMENTS = 3
_HOW_TO_CHOOSE = "solids={0} (on the command line --solids {1})"


def read_step(
    path: Path,
    *,
    chord_tolerance_mm: float | None = None,
    angular_tolerance_deg: float | None = None,
    planarity_mm: float | None = None,
    gap_mm: float | None = None,
    solids: Sequence[int] | None = None,
    name: str = "",
    limits: ReadLimits | None = None,
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
    angular_tolerance_deg : float, optional
        Largest turn between neighbouring chords of a curve. Default: 30.
    planarity_mm : float, optional
        Facets this close to one plane become one face; see `assemble`.
    gap_mm : float, optional
        How far apart vertices, edges and faces that should meet may lie; default: by the rule of `step_fit`.
    solids : sequence of int, optional
        Which solids of the file to read, counted from 0 in the order of the file, damaged ones included; default: all.
    name : str
        Name of the file, without its ending.
    limits : ReadLimits, optional
        What the kernel may take.

    Raises
    ------
    MissingExtraError
        The package cadquery-ocp-novtk is not installed.
    ReadError
        The file is not a STEP file, holds no closed solid, a solid asked for is damaged, or a limit is exceeded.
    SolidError
        A solid is not valid, or solids overlap or touch.
    """
    angle_deg = 30.0 if angular_tolerance_deg is None else float(angular_tolerance_deg)
    with StepKernel(Path(path).name, limits or ReadLimits()) as kernel:
        loaded, _ = kernel.ask("load", path=str(Path(path).absolute()), name=Path(path).name)
        chosen = _select(loaded["damage"], solids, Path(path).name)
        size, _ = kernel.ask("select", solids=chosen, relative_planarity=RELATIVE_PLANARITY)
        diagonal = size["diagonal_mm"]
        notes = loaded["notes"] + check_fit(size["fits"], chosen, diagonal, gap_mm, Path(path).name)
        chord = diagonal * RELATIVE_CHORD if chord_tolerance_mm is None else float(chord_tolerance_mm)
        try:
            for attempt in range(_MAX_REFINEMENTS + 1):
                parts = _tessellate(kernel, chord / 4.0**attempt, angle_deg)
                solid = _build(
                    parts,
                    chord_mm=chord / 4.0**attempt,
                    angle_deg=angle_deg,
                    planarity_mm=planarity_mm,
                    notes=notes,
                    name=name,
                    last=attempt == _MAX_REFINEMENTS,
                )
                if solid is not None:
                    return solid
        except (SelfIntersectionError, NonManifoldError) as error:
            if len(chosen) == 1:
                raise
            hint = (
                f"The file holds {len(chosen)} solids; read some of them with {_HOW_TO_CHOOSE.format('[...]', '...')}."
            )
            raise type(error)(f"{error} {hint}") from error
    raise AssertionError("the last attempt returns or raises")


def _tessellate(kernel: StepKernel, chord_mm: float, angle_deg: float) -> list[Tessellation]:
    answer, arrays = kernel.ask("tessellate", chord_mm=chord_mm, angle_rad=math.radians(angle_deg))
    parts = []
    for k in range(answer["n"]):
        vertices, triangles, patch, curved_patch, chords, *circles, pairs, turns = (
            arrays[f"{k}_{i}"] for i in range(10)
        )
        curved_edges = set(map(tuple, chords.tolist()))
        surface_turns = dict(zip(map(tuple, pairs.tolist()), turns.tolist(), strict=True))
        circular = unpack_circles(*circles)
        parts.append(Tessellation(vertices, triangles, patch, curved_patch, curved_edges, circular, surface_turns))
    return parts


def _build(
    parts: list[Tessellation],
    *,
    chord_mm: float,
    angle_deg: float,
    planarity_mm: float | None,
    notes: list[str],
    name: str,
    last: bool,
) -> Solid | None:
    """Return the solid, or None if its facets run into each other and a finer chord tolerance could help."""
    curved = any(part.curved_patch.any() for part in parts)
    notes = list(notes)
    if curved:
        notes.append(f"curved faces tessellated with a chord tolerance of {chord_mm:.4g} mm and {angle_deg:g} degrees")
    if len(parts) > 1:
        notes.append(f"{len(parts)} solids")
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
    turns = {
        (a + v, b + v): turn
        for part, v in zip(parts, first_vertex, strict=False)
        for (a, b), turn in part.surface_turns.items()
    }
    circular = [
        edge._replace(vertices=tuple(a + v for a in edge.vertices))
        for part, v in zip(parts, first_vertex, strict=False)
        for edge in part.circular_edges or ()
    ]
    return Tessellation(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([part.triangles + v for part, v in zip(parts, first_vertex, strict=False)]),
        np.concatenate([part.patch + p for part, p in zip(parts, first_patch, strict=False)]),
        np.concatenate([part.curved_patch for part in parts]),
        curved,
        circular,
        turns,
    )


def _select(damage: list[str], wanted: Sequence[int] | None, name: str) -> list[int]:
    """Return the solids to read; a damaged one among them is refused."""
    n = len(damage)
    chosen = list(range(n)) if wanted is None else [int(i) for i in wanted]
    bad = [i for i in chosen if not 0 <= i < n]
    if bad or not chosen:
        raise ReadError(f"solids must name some of 0..{n - 1} of {name}. Got {chosen}.")
    if len(set(chosen)) < len(chosen):
        raise ReadError(f"solids must name each solid once. Got {chosen}.")
    for i in chosen:
        if damage[i]:
            whole = [k for k in range(n) if not damage[k]]
            ask = _HOW_TO_CHOOSE.format(whole, ",".join(map(str, whole)))
            hint = f" Ask for the whole ones with {ask}." if whole else ""
            which = f" (solid {i} of 0..{n - 1})" if n > 1 else ""
            raise ReadError(f"the geometry of a STEP file must be whole. Got {name} with {damage[i]}{which}.{hint}")
    return chosen
