"""From triangles to the faces of a solid: coplanar triangles joined, loops traced, idle vertices removed.

Notation
--------
Half-edge ``h = 3 t + k`` runs from corner k of triangle t to the next corner. ``twin[h]`` is the half-edge on the other
side, which runs the other way. A *group* is a set of triangles that becomes one face.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from aspectgraph.solid import Solid
from aspectgraph.topology import Face, check_fans, pair_edges
from aspectgraph.triangulate import newell_area_vector
from aspectgraph.validation import default_planarity_mm


@dataclass
class Tessellation:
    """Triangles of a closed surface and what is known of the surface behind them.

    Attributes
    ----------
    vertices : ndarray, shape (n, 3)
        In mm.
    triangles : ndarray of int, shape (t, 3)
        Counter-clockwise seen from outside.
    patch : ndarray of int, shape (t,)
        The surface each triangle belongs to, 0..p-1 (all 0 if unknown).
    curved_patch : ndarray of bool, shape (p,)
        Which of them are curved; triangles of two curved ones, or of a curved and a planar one, are never joined.
    curved_edges : set of (int, int)
        Vertex pairs, lower index first, of chords of curved or smooth edges.
    """

    vertices: np.ndarray
    triangles: np.ndarray
    patch: np.ndarray
    curved_patch: np.ndarray
    curved_edges: set[tuple[int, int]] = field(default_factory=set)


def assemble(
    tessellation: Tessellation, name: str = "", planarity_mm: float | None = None, notes: Iterable[str] = ()
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
    tolerance = default_planarity_mm(tessellation.vertices) if planarity_mm is None else planarity_mm
    vertices, faces, curved_edges = join_facets(tessellation, tolerance)
    return Solid(vertices, faces, curved_edges=curved_edges, name=name, planarity_mm=2 * tolerance, notes=notes)


def join_facets(tessellation: Tessellation, tolerance_mm: float) -> tuple[np.ndarray, list[Face], set[tuple[int, int]]]:
    """Join coplanar triangles into faces; see `assemble`.

    Returns
    -------
    vertices : ndarray, shape (m, 3)
        Those still in use.
    faces : list of Face
    curved_edges : set of (int, int)

    Raises
    ------
    SolidError
        The triangles do not bound a closed, oriented, manifold surface.
    """
    vertices, triangles = tessellation.vertices, tessellation.triangles
    corners = [Face(tuple(row)) for row in triangles.tolist()]
    pair_edges(vertices, corners)
    check_fans(vertices, corners)
    twin = find_twins(triangles)
    group = group_coplanar(tessellation, twin, tolerance_mm)
    curved_edges = tessellation.curved_edges | _inner_edges(tessellation, twin)
    loops, curved_edges = drop_idle_vertices(vertices, trace_loops(triangles, twin, group), curved_edges, tolerance_mm)
    curved = tessellation.curved_patch[tessellation.patch[_first_member(group)]]
    faces = [_as_face(vertices, cycles, bool(flag)) for cycles, flag in zip(loops, curved, strict=True)]
    used, faces, curved_edges = _renumber(faces, curved_edges)
    return vertices[used], faces, curved_edges


def find_twins(triangles: np.ndarray) -> np.ndarray:
    """Return the twin of every half-edge of closed, oriented triangles, shape (3 t,)."""
    start = triangles.astype(np.int64).ravel()
    end = np.roll(triangles, -1, axis=1).astype(np.int64).ravel()
    n = int(start.max()) + 1
    forward, backward = start * n + end, end * n + start
    order = np.argsort(forward)
    return order[np.searchsorted(forward, backward, sorter=order)]


def _first_member(group: np.ndarray) -> np.ndarray:
    return np.unique(group, return_index=True)[1]


def _inner_edges(tessellation: Tessellation, twin: np.ndarray) -> set[tuple[int, int]]:
    """Return the edges inside curved patches."""
    patch = np.repeat(tessellation.patch, 3)
    inner = (patch == patch[twin]) & tessellation.curved_patch[patch]
    start = tessellation.triangles.ravel()[inner]
    end = np.roll(tessellation.triangles, -1, axis=1).ravel()[inner]
    return {(a, b) for a, b in zip(start.tolist(), end.tolist(), strict=True) if a < b}


def group_coplanar(tessellation: Tessellation, twin: np.ndarray, tolerance_mm: float) -> np.ndarray:
    """Label triangles that lie in one plane and hang together; labels in order of each group's first triangle.

    Groups grow from the largest triangle left. The plane is refitted whenever the area has doubled; a group that ends
    up uneven all the same is taken apart again.
    """
    triangles, patch = tessellation.triangles, tessellation.patch
    points = tessellation.vertices - tessellation.vertices.mean(axis=0)
    corners = points[triangles]
    area_vectors = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    neighbour = (twin // 3).reshape(-1, 3)
    flat = ~tessellation.curved_patch[patch]
    joinable = (patch[neighbour] == patch[:, None]) | (flat[neighbour] & flat[:, None])
    grower = _Grower(corners, area_vectors, np.where(joinable, neighbour, -1), tolerance_mm)
    for seed in np.argsort(-np.linalg.norm(area_vectors, axis=1), kind="stable").tolist():
        if grower.label[seed] < 0:
            grower.grow(seed)
    _adopt_slivers(grower, corners, neighbour)
    return _in_order(grower.label)


def _in_order(label: np.ndarray) -> np.ndarray:
    _, first, inverse = np.unique(label, return_index=True, return_inverse=True)
    rank = np.empty(len(first), dtype=np.int64)
    rank[np.argsort(first)] = np.arange(len(first))
    return rank[inverse]


class _Grower:
    """State of `group_coplanar`."""

    def __init__(self, corners, area_vectors, neighbour, tolerance_mm):
        self.corners, self.area_vectors = corners, area_vectors
        self.areas = np.linalg.norm(area_vectors, axis=1)
        self.neighbour = neighbour.tolist()
        self.tolerance_mm = tolerance_mm
        self.label = np.full(len(corners), -1, dtype=np.int64)
        self.n_groups = 0

    def grow(self, seed: int) -> None:
        """Collect a new group around triangle `seed`."""
        members = self._flood(seed, 2.0 * self.tolerance_mm)
        if len(members) > 1 and self._unevenness(members) > self.tolerance_mm:
            members = self._flood(seed, 0.5 * self.tolerance_mm)
            if self._unevenness(members) > self.tolerance_mm:
                members = [seed]
        self.label[members] = self.n_groups
        self.n_groups += 1

    def _flood(self, seed: int, band_mm: float) -> list[int]:
        members, seen = [seed], {seed}
        total, fitted_area = self.area_vectors[seed].copy(), self.areas[seed]
        normal, height = self._plane(total, members)
        front = [seed]
        while front:
            for t in self.neighbour[front.pop()]:
                if t < 0 or t in seen or self.label[t] >= 0:
                    continue
                if not self._fits(t, normal, height, band_mm):
                    continue
                seen.add(t)
                members.append(t)
                front.append(t)
                total += self.area_vectors[t]
                if np.linalg.norm(total) > 2.0 * fitted_area:
                    fitted_area = np.linalg.norm(total)
                    normal, height = self._plane(total, members)
        return members

    def _fits(self, t: int, normal: np.ndarray, height: float, band_mm: float) -> bool:
        if np.abs(self.corners[t] @ normal - height).max() > band_mm:
            return False
        longest = np.ptp(self.corners[t], axis=0).max()
        return self.area_vectors[t] @ normal > -band_mm * longest

    def _plane(self, total: np.ndarray, members: list[int]) -> tuple[np.ndarray, float]:
        length = np.linalg.norm(total)
        normal = total / length if length > 0 else total
        heights = self.corners[members] @ normal
        return normal, 0.5 * float(heights.min() + heights.max())

    def _unevenness(self, members: list[int]) -> float:
        normal, height = self._plane(self.area_vectors[members].sum(axis=0), members)
        return float(np.abs(self.corners[members] @ normal - height).max())


def _adopt_slivers(grower: _Grower, corners: np.ndarray, neighbour: np.ndarray) -> None:
    """Give triangles without width that stayed alone to the group across their longest side."""
    sides = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    alone = np.bincount(grower.label)[grower.label] == 1
    thin = 2.0 * grower.areas <= grower.tolerance_mm * 1e-3 * sides.max(axis=1)
    for t in np.flatnonzero(alone & thin):
        grower.label[t] = grower.label[neighbour[t, int(np.argmax(sides[t]))]]


def trace_loops(triangles: np.ndarray, twin: np.ndarray, group: np.ndarray) -> list[list[list[int]]]:
    """Return the boundary cycles of every group; the group lies to the left, no cycle visits a vertex twice."""
    start = triangles.ravel().tolist()
    of_half_edge = np.repeat(group, 3)
    rim = of_half_edge != of_half_edge[twin]
    pending, twins = rim.tolist(), twin.tolist()
    loops: list[list[list[int]]] = [[] for _ in range(int(group.max()) + 1)]
    for first in np.flatnonzero(rim).tolist():
        cycle, h = [], first
        while pending[h]:
            pending[h] = False
            cycle.append(start[h])
            h = _after(h)
            while not rim[h]:
                h = _after(twins[h])
        if cycle:
            loops[of_half_edge[first]].extend(_split_at_repeats(cycle))
    return loops


def _after(h: int) -> int:
    """Return the next half-edge of the same triangle."""
    return h - 2 if h % 3 == 2 else h + 1


def _split_at_repeats(cycle: list[int]) -> list[list[int]]:
    """Cut a cycle that touches itself in vertices into cycles that do not."""
    simple, path, place = [], [], {}
    for v in cycle:
        if v in place:
            cut = place[v]
            simple.append(path[cut:])
            for w in path[cut:]:
                del place[w]
            del path[cut:]
        place[v] = len(path)
        path.append(v)
    return [*simple, path]


def drop_idle_vertices(
    vertices: np.ndarray, loops: list[list[list[int]]], curved_edges: set[tuple[int, int]], tolerance_mm: float
) -> tuple[list[list[list[int]]], set[tuple[int, int]]]:
    """Remove vertices on a straight run between two faces.

    Returns
    -------
    loops, curved_edges
        Without the removed vertices; a run keeps whether it is curved.
    """
    idle = _idle_vertices(vertices, loops, curved_edges, tolerance_mm)
    kept_loops, kept_curved = [], set()
    for cycles in loops:
        kept_cycles = []
        for cycle in cycles:
            kept = [v for v in cycle if v not in idle]
            kept = kept if len(kept) >= 3 else cycle
            kept_cycles.append(kept)
            kept_curved |= _curved_runs(cycle, kept, curved_edges)
        kept_loops.append(kept_cycles)
    return kept_loops, kept_curved


def _curved_runs(cycle: list[int], kept: list[int], curved_edges: set[tuple[int, int]]) -> set[tuple[int, int]]:
    """Return the edges of `kept` that stand for curved edges of `cycle`."""
    following = dict(zip(cycle, [*cycle[1:], cycle[0]], strict=True))
    pairs = zip(kept, [*kept[1:], kept[0]], strict=True)
    return {_pair(a, b) for a, b in pairs if _pair(a, following[a]) in curved_edges}


def _pair(a: int, b: int) -> tuple[int, int]:
    return (a, b) if a < b else (b, a)


def _idle_vertices(vertices, loops, curved_edges, tolerance_mm) -> set[int]:
    neighbours: dict[int, set[int]] = {}
    visits: dict[int, int] = {}
    for cycles in loops:
        for cycle in cycles:
            for before, at, after in zip([cycle[-1], *cycle[:-1]], cycle, [*cycle[1:], cycle[0]], strict=True):
                neighbours.setdefault(at, set()).update((before, after))
                visits[at] = visits.get(at, 0) + 1
    passing = {v for v, n in visits.items() if n == 2 and len(neighbours[v]) == 2}
    passing = {v for v in passing if len({_pair(v, w) in curved_edges for w in neighbours[v]}) == 1}
    passing = {v for v in passing if _is_between(vertices, v, neighbours[v], tolerance_mm)}
    idle: set[int] = set()
    for v in sorted(passing):
        if v not in idle:
            idle |= _idle_inside(vertices, _run_through(v, neighbours, passing), tolerance_mm)
    return _spare_short_cycles(loops, idle)


def _idle_inside(vertices: np.ndarray, run: list[int], tolerance_mm: float) -> set[int]:
    """Return the vertices inside a run that a polyline within the tolerance can do without (Douglas and Peucker)."""
    if len(run) < 3:
        return set()
    points = vertices[run]
    if _is_straight(points, tolerance_mm):
        return set(run[1:-1])
    along = points[-1] - points[0]
    far = 1 + int(np.argmax(np.linalg.norm(np.cross(points[1:-1] - points[0], along), axis=1)))
    return _idle_inside(vertices, run[: far + 1], tolerance_mm) | _idle_inside(vertices, run[far:], tolerance_mm)


def _spare_short_cycles(loops, idle: set[int]) -> set[int]:
    """Keep all vertices of cycles that would lose too many."""
    for cycles in loops:
        for cycle in cycles:
            if sum(v not in idle for v in cycle) < 3:
                idle = idle - set(cycle)
    return idle


def _is_between(vertices: np.ndarray, v: int, ends: set[int], tolerance_mm: float) -> bool:
    a, b = (vertices[w] for w in ends)
    return bool((vertices[v] - a) @ (b - vertices[v]) > 0) and _is_straight(np.array([a, vertices[v], b]), tolerance_mm)


def _is_straight(points: np.ndarray, tolerance_mm: float) -> bool:
    along = points[-1] - points[0]
    length = np.linalg.norm(along)
    if length <= tolerance_mm:
        return False
    off = np.cross(points[1:-1] - points[0], along / length)
    return bool(np.linalg.norm(off, axis=1).max() <= tolerance_mm)


def _run_through(v: int, neighbours: dict[int, set[int]], passing: set[int]) -> list[int]:
    """Return the run of passing vertices through `v` with the two vertices that end it."""
    run = [v]
    for _ in range(2):
        run.reverse()
        while True:
            ahead = [w for w in neighbours[run[-1]] if w not in run]
            if not ahead or run[-1] not in passing:
                break
            run.append(ahead[0])
    return run


def _as_face(vertices: np.ndarray, cycles: list[list[int]], curved: bool) -> Face:
    areas = np.array([newell_area_vector(vertices[cycle]) for cycle in cycles])
    total = areas.sum(axis=0)
    outer = int(np.argmax(areas @ total))
    holes = tuple(tuple(cycle) for i, cycle in enumerate(cycles) if i != outer)
    return Face(tuple(cycles[outer]), holes, curved)


def _renumber(faces: list[Face], curved_edges: set[tuple[int, int]]):
    """Drop unused vertices: return the old indices in use, and faces and edges in new indices."""
    used = sorted({v for face in faces for loop in face.loops for v in loop})
    new = {old: i for i, old in enumerate(used)}
    faces = [
        Face(tuple(new[v] for v in face.outer), tuple(tuple(new[v] for v in h) for h in face.holes), face.curved)
        for face in faces
    ]
    return used, faces, {(new[a], new[b]) for a, b in curved_edges if a in new and b in new}
