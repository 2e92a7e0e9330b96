"""From triangles to the faces of a solid: coplanar triangles joined, loops traced, idle vertices removed.

The notation is that of `coplanar`.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from aspectgraph.exceptions import SolidError
from aspectgraph.phases import phase
from aspectgraph.read.coplanar import find_twins, group_coplanar
from aspectgraph.read.curved_facets import find_curved
from aspectgraph.read.loops import drop_idle_vertices, trace_loops, turns_of_runs
from aspectgraph.read.tessellation import Tessellation
from aspectgraph.solid.checks import default_planarity_mm
from aspectgraph.solid.circles import CircularEdge
from aspectgraph.solid.face_loops import FaceLoops
from aspectgraph.solid.solid import Solid
from aspectgraph.solid.topology import check_fans, faces_of, pair_edges
from aspectgraph.solid.triangulate import newell_area_vector


def assemble(
    tessellation: Tessellation,
    name: str = "",
    planarity_mm: float | None = None,
    notes: Iterable[str] = (),
) -> Solid:
    """Join coplanar triangles into faces and return the validated solid.

    Parameters
    ----------
    tessellation : Tessellation
        Closed, oriented triangles.
    name : str
        Name of the part.
    planarity_mm : float, optional
        Triangles whose corners lie in a plane to within this distance are joined; an edge vertex this close to the line
        between its neighbours is removed where only two faces meet. Default: 10⁻⁶ of the bounding box diagonal.
    notes : iterable of str
        Passed on to the solid.

    Raises
    ------
    SolidError
        The triangles do not bound a valid solid.
    """
    tolerance = (
        default_planarity_mm(tessellation.vertices) if planarity_mm is None else planarity_mm
    )
    notes = list(notes)
    vertices, faces, curved_edges, new, turns = _joined(tessellation, tolerance, notes)
    circular = tessellation.circular_edges
    return Solid(
        vertices,
        faces,
        curved_edges=curved_edges,
        name=name,
        planarity_mm=2 * tolerance,
        notes=notes,
        circular_edges=None
        if circular is None
        else [_with_vertices(edge, new) for edge in circular],
        surface_turns=turns,
    )


def _joined(tessellation: Tessellation, tolerance_mm: float, notes: list[str]) -> Any:
    """Return vertices, faces and curved edges, the new index of every vertex in use, and the turns at edges left."""
    vertices = tessellation.vertices
    triangles = tessellation.triangles
    corners = FaceLoops.of_triangles(triangles)
    pair_edges(vertices, corners)
    check_fans(vertices, corners)
    twin = find_twins(triangles)
    flat = ~tessellation.curved_patch[tessellation.patch]
    here = np.repeat(np.arange(len(triangles)), 3)
    there = twin // 3
    joinable = (tessellation.patch[here] == tessellation.patch[there]) | (flat[here] & flat[there])
    with phase("join coplanar facets"):
        group = group_coplanar(vertices, triangles, twin, joinable, tolerance_mm)
    curved_edges = tessellation.curved_edges | _inner_edges(tessellation, twin)
    with phase("trace the faces"):
        traced = trace_loops(triangles, twin, group)
        cycles, curved_edges = drop_idle_vertices(vertices, traced, curved_edges, tolerance_mm)
    turns = turns_of_runs(traced, cycles, tessellation.surface_turns)
    patches = tessellation.patch[np.unique(group, return_index=True)[1]]
    curved = tessellation.curved_patch[patches]
    loops = FaceLoops.of_cycles([_outer_first(vertices, own) for own in cycles])
    facets = np.isin(patches, list(tessellation.faceted_patches))
    curved, chords = _recognise(vertices, loops, curved, facets, notes)
    pairs = np.array([*curved_edges], dtype=np.int64).reshape(-1, 2)
    used, loops, pairs = _renumber(loops, np.concatenate([pairs, chords]))
    new = {old: i for i, old in enumerate(used.tolist())}
    return (
        vertices[used],
        faces_of(loops, curved.tolist()),
        pairs,
        new,
        {(new[a], new[b]): turn for (a, b), turn in turns.items()},
    )


def _recognise(
    vertices: np.ndarray,
    loops: FaceLoops,
    curved: np.ndarray,
    facets: np.ndarray,
    notes: list[str],
) -> tuple[np.ndarray, np.ndarray]:
    """Find the facets of curved surfaces, of those faces that are facets.

    Returns
    -------
    curved : ndarray of bool, shape (f,)
        As given, and these.
    chords : ndarray of int, shape (e, 2)
        Their edges that are no candidates.
    """
    if not facets.any():
        return curved, np.empty((0, 2), dtype=np.int64)
    used, own, _ = _renumber(loops.only(facets), np.empty((0, 2), dtype=np.int64))
    with phase("find curved surfaces"):
        marked, chords = find_curved(vertices[used], own)
    if len(chords):
        notes.append(
            f"{int(marked.sum())} faces taken for facets of curved surfaces; their chords are no candidates"
        )
    curved = curved.copy()
    curved[facets] = marked
    return curved, used[chords]


def _with_vertices(edge: CircularEdge, new: dict[int, int]) -> CircularEdge:
    """Return a circular edge in new vertex indices, without the vertices that are not used any more."""
    return edge._replace(vertices=tuple(new[v] for v in edge.vertices if v in new))


def _inner_edges(tessellation: Tessellation, twin: np.ndarray) -> set[tuple[int, int]]:
    """Return the edges inside curved patches."""
    patch = np.repeat(tessellation.patch, 3)
    inner = (patch == patch[twin]) & tessellation.curved_patch[patch]
    start = tessellation.triangles.ravel()[inner]
    end = np.roll(tessellation.triangles, -1, axis=1).ravel()[inner]
    return {(a, b) for a, b in zip(start.tolist(), end.tolist(), strict=True) if a < b}


def _outer_first(vertices: np.ndarray, cycles: list[list[int]]) -> list[list[int]]:
    """Return the cycles of a face with the outer one first."""
    if len(cycles) == 1:
        return cycles
    if not cycles:
        raise SolidError("a solid must have a volume. Got a closed surface that lies in one plane.")
    areas = np.array([newell_area_vector(vertices[cycle]) for cycle in cycles])
    outer = int(np.argmax(areas @ areas.sum(axis=0)))
    return [cycles[outer], *cycles[:outer], *cycles[outer + 1 :]]


def _renumber(loops: FaceLoops, pairs: np.ndarray) -> tuple[np.ndarray, FaceLoops, np.ndarray]:
    """Drop unused vertices: return the old indices in use, and loops and vertex pairs in new indices."""
    used = np.unique(loops.start)
    new = np.full(max(int(used[-1]), int(pairs.max(initial=0))) + 1, -1)
    new[used] = np.arange(len(used))
    pairs = new[pairs]
    return (
        used,
        FaceLoops(new[loops.start], loops.size, loops.loop_face),
        pairs[(pairs >= 0).all(axis=1)],
    )
