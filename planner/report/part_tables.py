"""What a part consists of: records for ``--json``, and tables for the terminal. `info` loads nothing of plans."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from aspectgraph import Arc, Edge, Rim, Solid
from planner.text_table import Column, count, print_table, print_text, words

if TYPE_CHECKING:
    from aspectgraph import EdgeEnd, SolidEntry


def part_record(
    solid: Solid, edges: Iterable[Edge], curves: Iterable[Arc], notes: Iterable[str] = ()
) -> dict[str, Any]:
    """Return what a part consists of: its box in mm, and its edges, rims and arcs by id; notes of its own and more."""
    return {
        "part": solid.name,
        "bounds": np.asarray(solid.bounds, dtype=float).tolist(),
        "faces": len(solid.faces),
        "cad_faces": _n_cad_faces(solid) or None,
        "notes": [*solid.notes, *notes],
        "solids": solid_records(file_entries(solid)),
        "edges": [
            {
                "id": edge.id,
                "ends": np.asarray(solid.edge_points(edge.id), dtype=float).tolist(),
                "length": float(solid.edge_length_mm(edge.id)),
                "turn": float(edge.turn_deg),
                "faces": list(edge.faces),
                "end_kinds": [{"kind": end.kind, "arc": end.arc} for end in solid.edge_ends(edge)],
            }
            for edge in edges
        ],
        "curves": [
            {
                "id": curve.id,
                "kind": "rim" if isinstance(curve, Rim) else "arc",
                "radius": float(curve.radius_mm),
                "diameter": 2.0 * float(curve.radius_mm),
                "centre": np.asarray(curve.centre, dtype=float).tolist(),
                "axis": np.asarray(curve.axis, dtype=float).tolist(),
            }
            for curve in curves
        ],
    }


def _n_cad_faces(solid: Solid) -> int:
    """Return the number of faces of the CAD model; 0 where there is no such model."""
    return 0 if solid.file_solids is None else solid.file_solids.n_faces


def file_entries(solid: Solid) -> tuple[SolidEntry, ...]:
    """Return the solids of the part's STEP file; nothing if it holds one only, or there is no such file."""
    if solid.file_solids is None or len(solid.file_solids.entries) < 2:
        return ()
    return solid.file_solids.entries


def solid_records(entries: Iterable[SolidEntry]) -> list[dict[str, Any]]:
    """Return the solids of a STEP file: numbers, names, and sizes in mm."""
    return [
        {
            "number": entry.number,
            "name": entry.label,
            "product": entry.product,
            "instance": entry.instance,
            "body": entry.body,
            "size": None if entry.size_mm is None else list(entry.size_mm),
            "faces": entry.n_faces,
            "placed": entry.n_placed,
        }
        for entry in entries
    ]


def print_solids(entries: Sequence[SolidEntry]) -> None:
    """Print the solids of a STEP file, with the names that ``--solids`` takes."""
    rows = []
    for entry in entries:
        size = "" if entry.size_mm is None else vector_text(np.array(entry.size_mm), " x ")
        names = (entry.label, entry.instance, entry.body)
        rows.append((entry.number, *names, size, entry.n_faces, entry.n_placed))
    print_table(_SOLID_COLUMNS, rows)


def print_part(solid: Solid, edges: Sequence[Edge], curves: Sequence[Any]) -> None:
    """Print what a part consists of, its straight edges, its rims and its arcs."""
    size = np.ptp(solid.bounds, axis=0)
    n = len(solid.straight_edges())
    chosen = "" if len(edges) == n else f"{len(edges)} of "
    # curved faces of a CAD model are many facets here; without them, every edge is sharp and straight
    is_curved = solid.circular_edges is not None and len(solid.edges) > n
    faces = count(len(solid.faces), "facet" if is_curved else "face")
    n_cad = _n_cad_faces(solid)
    if n_cad and (is_curved or n_cad != len(solid.faces)):
        faces = f"{count(n_cad, 'CAD face')}, {faces}"
    between = " between facets" if is_curved else ""
    text = (
        f"{solid.name}: {count(solid.n_shells, 'shell')}, {faces}, "
        f"{count(len(solid.edges), 'edge')}{between}, {chosen}{count(n, 'sharp straight edge')}, "
        f"{vector_text(size, ' x ')} mm"
    )
    print_text(words(text, [f"{solid.name}:"]))
    for note in solid.notes:
        print_text(f"note: {note}")
    if entries := file_entries(solid):
        print_solids(entries)
    ends = {edge.id: solid.edge_ends(edge) for edge in edges}
    rows = [
        (
            edge.id,
            *solid.edge_points(edge.id),
            solid.edge_length_mm(edge.id),
            edge.turn_deg,
            words(_ends_text(ends[edge.id])),
        )
        for edge in edges
    ]
    print_table(_EDGE_COLUMNS, rows)
    n_tangent = sum(any(end.kind == "tangent" for end in pair) for pair in ends.values())
    if n_tangent:
        print_text(
            f"note: {n_tangent} of {count(len(edges), 'edge')} end in a tangent arc, such as a3, so their length "
            "is undefined; distances and angles are not affected"
        )
    if len(solid.edges) > n:
        print_text(
            "note: ids also count the edges that are not listed, such as those of curved faces; 'aspectgraph info "
            "--help' explains the columns"
        )
    for kind in ("rim", "arc"):
        _print_curves(
            kind, [curve for curve in curves if isinstance(curve, Rim) == (kind == "rim")]
        )


# no -0.00 among coordinates
COORDINATES = "z.2f"
_SOLID_COLUMNS = (
    Column("solid", right=True),
    Column("name"),
    Column("instance"),
    Column("body"),
    Column("size", right=True, unit="mm"),
    Column("faces", right=True),
    Column("placed", right=True),
)
_EDGE_COLUMNS = (
    Column("id", right=True),
    Column("from", right=True, unit="mm", spec=COORDINATES),
    Column("to", right=True, unit="mm", spec=COORDINATES),
    Column("length", right=True, unit="mm", spec=".3f"),
    Column("turn", right=True, unit="deg", spec="+.1f"),
    Column("ends"),
)


def _ends_text(ends: Sequence[EdgeEnd]) -> str:
    """Return both ends of an edge: "corner", the id of a tangent arc, or "tangent"; one if equal."""
    texts = [end.arc or end.kind for end in ends]
    return ", ".join(dict.fromkeys(texts))


def _print_curves(kind: str, curves: Sequence[Any]) -> None:
    """Print the rims or arcs of a part, if it has any."""
    if not curves:
        return
    n_chords = sum(len(curve.edge_ids) for curve in curves)
    print(f"{count(len(curves), kind)}, {count(n_chords, 'chord')}")
    columns = (
        Column("id", right=True),
        Column("diameter", right=True, unit="mm", spec=".3f"),
        Column("radius", right=True, unit="mm", spec=".3f"),
        Column("centre", right=True, unit="mm", spec=COORDINATES),
        Column("axis", right=True, spec=COORDINATES),
        Column("chords", right=True),
        Column("off by", right=True, unit="mm", spec=".3f"),
    )
    rows = [
        (
            curve.id,
            2.0 * curve.radius_mm,
            curve.radius_mm,
            curve.centre,
            curve.axis,
            len(curve.edge_ids),
            curve.chord_mm,
        )
        for curve in curves
    ]
    print_table(columns, rows)
    if curves[0].fitted:
        print_text(
            f"note: these {kind}s are circles fitted to chords, because the mesh holds no circles"
        )


def vector_text(values: Iterable[float], separator: str = " ", digits: int = 2) -> str:
    """Return numbers with so many digits each; none is -0.00."""
    return separator.join(f"{value + 0.0:.{digits}f}" for value in np.round(list(values), digits))
