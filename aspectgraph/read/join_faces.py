"""From triangles to the faces of a solid: coplanar triangles joined, loops traced, idle vertices removed.

The notation is that of `coplanar`.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from aspectgraph.exceptions import SolidError
from aspectgraph.read.coplanar import find_twins, group_coplanar
from aspectgraph.read.curved_facets import find_curved
from aspectgraph.read.loops import drop_idle_vertices, trace_loops, turns_of_runs
from aspectgraph.read.tessellation import Tessellation
from aspectgraph.solid.checks import default_planarity_mm
from aspectgraph.solid.circles import CircularEdge
from aspectgraph.solid.solid import Solid
from aspectgraph.solid.topology import Face, check_fans, pair_edges
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
    corners = [Face(tuple(row)) for row in triangles.tolist()]
    pair_edges(vertices, corners)
    check_fans(vertices, corners)
    twin = find_twins(triangles)
    flat = ~tessellation.curved_patch[tessellation.patch]
    here = np.repeat(np.arange(len(triangles)), 3)
    there = twin // 3
    joinable = (tessellation.patch[here] == tessellation.patch[there]) | (flat[here] & flat[there])
    group = group_coplanar(vertices, triangles, twin, joinable, tolerance_mm)
    curved_edges = tessellation.curved_edges | _inner_edges(tessellation, twin)
    traced = trace_loops(triangles, twin, group)
    loops, curved_edges = drop_idle_vertices(vertices, traced, curved_edges, tolerance_mm)
    turns = turns_of_runs(traced, loops, tessellation.surface_turns)
    patches = tessellation.patch[np.unique(group, return_index=True)[1]]
    curved = tessellation.curved_patch[patches]
    faces = [
        _as_face(vertices, cycles, bool(flag)) for cycles, flag in zip(loops, curved, strict=True)
    ]
    facets = [k for k, p in enumerate(patches.tolist()) if p in tessellation.faceted_patches]
    faces, chords = _recognise(vertices, faces, facets, notes)
    used, faces, curved_edges = _renumber(faces, curved_edges | chords)
    new = {old: i for i, old in enumerate(used)}
    return (
        vertices[used],
        faces,
        curved_edges,
        new,
        {(new[a], new[b]): turn for (a, b), turn in turns.items()},
    )


def _recognise(
    vertices: np.ndarray, faces: list[Face], facets: list[int], notes: list[str]
) -> tuple[list[Face], set[tuple[int, int]]]:
    """Mark the facets of curved surfaces, of those faces that are facets; return also their chords."""
    if not facets:
        return faces, set()
    used, own, _ = _renumber([faces[k] for k in facets], set())
    marked, chords = find_curved(vertices[used], own)
    if chords:
        n = sum(face.curved for face in marked)
        notes.append(
            f"{n} faces taken for facets of curved surfaces; their chords are no candidates"
        )
    faces = list(faces)
    for k, face in zip(facets, marked, strict=True):
        faces[k] = replace(faces[k], curved=face.curved)
    return faces, {(used[a], used[b]) for a, b in chords}


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


def _as_face(vertices: np.ndarray, cycles: list[list[int]], curved: bool) -> Face:
    if not cycles:
        raise SolidError("a solid must have a volume. Got a closed surface that lies in one plane.")
    areas = np.array([newell_area_vector(vertices[cycle]) for cycle in cycles])
    total = areas.sum(axis=0)
    outer = int(np.argmax(areas @ total))
    holes = tuple(tuple(cycle) for i, cycle in enumerate(cycles) if i != outer)
    return Face(tuple(cycles[outer]), holes, curved)


def _renumber(
    faces: list[Face], curved_edges: set[tuple[int, int]]
) -> tuple[list[int], list[Face], set[tuple[int, int]]]:
    """Drop unused vertices: return the old indices in use, and faces and edges in new indices."""
    used = sorted({v for face in faces for loop in face.loops for v in loop})
    new = {old: i for i, old in enumerate(used)}
    faces = [
        Face(
            tuple(new[v] for v in face.outer),
            tuple(tuple(new[v] for v in h) for h in face.holes),
            face.curved,
        )
        for face in faces
    ]
    return used, faces, {(new[a], new[b]) for a, b in curved_edges if a in new and b in new}
