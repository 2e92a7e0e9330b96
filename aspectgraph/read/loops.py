"""Boundary cycles of groups of triangles, and the vertices on them that say nothing.

The notation is that of `coplanar`.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import chain

import numpy as np

from aspectgraph.solid.face_loops import FaceLoops


def trace_loops(
    triangles: np.ndarray, twin: np.ndarray, group: np.ndarray
) -> list[list[list[int]]]:
    """Return the boundary cycles of every group; the group lies to the left, no cycle visits a vertex twice."""
    start = triangles.ravel().tolist()
    of_half_edge = np.repeat(group, 3)
    on_rim = of_half_edge != of_half_edge[twin]
    # a triangle alone is its own boundary
    alone = (np.bincount(group) == 1)[group] & on_rim.reshape(-1, 3).all(axis=1)
    loops: list[list[list[int]]] = [[] for _ in range(int(group.max()) + 1)]
    for g, corners in zip(group[alone].tolist(), triangles[alone].tolist(), strict=True):
        loops[g].append(corners)
    pending = (on_rim & ~np.repeat(alone, 3)).tolist()
    rim = on_rim.tolist()
    twins = twin.tolist()
    for first in np.flatnonzero(pending).tolist():
        cycle = []
        h = first
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
    simple: list[list[int]] = []
    path: list[int] = []
    place: dict[int, int] = {}
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
    vertices: np.ndarray,
    loops: list[list[list[int]]],
    curved_edges: set[tuple[int, int]],
    tolerance_mm: float,
) -> tuple[list[list[list[int]]], set[tuple[int, int]]]:
    """Remove vertices on a straight run between two faces.

    Returns
    -------
    loops, curved_edges
        Without the removed vertices; a run keeps whether it is curved.
    """
    idle = _idle_vertices(vertices, loops, curved_edges, tolerance_mm)
    if not idle and not curved_edges:
        return loops, set()
    kept_loops = []
    kept_curved = set()
    for cycles in loops:
        kept_cycles = []
        for cycle in cycles:
            kept = cycle if idle.isdisjoint(cycle) else [v for v in cycle if v not in idle]
            kept = kept if len(kept) >= 3 else cycle
            kept_cycles.append(kept)
            if curved_edges:
                kept_curved |= _curved_runs(cycle, kept, curved_edges)
        kept_loops.append(kept_cycles)
    return kept_loops, kept_curved


def _curved_runs(
    cycle: list[int], kept: list[int], curved_edges: set[tuple[int, int]]
) -> set[tuple[int, int]]:
    """Return the edges of `kept` that stand for curved edges of `cycle`."""
    following = dict(zip(cycle, [*cycle[1:], cycle[0]], strict=True))
    pairs = zip(kept, [*kept[1:], kept[0]], strict=True)
    return {_pair(a, b) for a, b in pairs if _pair(a, following[a]) in curved_edges}


def turns_of_runs(
    traced: list[list[list[int]]], kept: list[list[list[int]]], turns: dict[tuple[int, int], float]
) -> dict[tuple[int, int], float]:
    """Return the turns at the edges that are left: the largest along the run of chords each stands for."""
    left: dict[tuple[int, int], float] = {}
    if not turns:
        return left
    for whole, short in zip(chain.from_iterable(traced), chain.from_iterable(kept), strict=True):
        following = dict(zip(whole, [*whole[1:], whole[0]], strict=True))
        for a, b in zip(short, [*short[1:], short[0]], strict=True):
            at = a
            found = []
            while at != b:
                found.append(turns.get(_pair(at, following[at])))
                at = following[at]
            known = [turn for turn in found if turn is not None]
            if known:
                left[_pair(a, b)] = max(known)
    return left


def _pair(a: int, b: int) -> tuple[int, int]:
    return (a, b) if a < b else (b, a)


def _idle_vertices(
    vertices: np.ndarray,
    loops: list[list[list[int]]],
    curved_edges: Iterable[tuple[int, int]],
    tolerance_mm: float,
) -> set[int]:
    all_loops = FaceLoops.of_cycles(loops)
    start = all_loops.start
    twice = np.bincount(start) == 2
    visits = np.flatnonzero(twice[start])
    neighbours: dict[int, set[int]] = {}
    for before, at, after in zip(
        start[all_loops.preceding[visits]].tolist(),
        start[visits].tolist(),
        all_loops.end[visits].tolist(),
        strict=True,
    ):
        neighbours.setdefault(at, set()).update((before, after))
    passing = {v for v, around in neighbours.items() if len(around) == 2}
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
    return _idle_inside(vertices, run[: far + 1], tolerance_mm) | _idle_inside(
        vertices, run[far:], tolerance_mm
    )


def _spare_short_cycles(loops: list[list[list[int]]], idle: set[int]) -> set[int]:
    """Keep all vertices of cycles that would lose too many."""
    for cycle in chain.from_iterable(loops):
        if not idle.isdisjoint(cycle) and sum(v not in idle for v in cycle) < 3:
            idle = idle - set(cycle)
    return idle


def _is_between(vertices: np.ndarray, v: int, ends: set[int], tolerance_mm: float) -> bool:
    a, b = (vertices[w] for w in ends)
    return bool((vertices[v] - a) @ (b - vertices[v]) > 0) and _is_straight(
        np.array([a, vertices[v], b]), tolerance_mm
    )


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
        while run[-1] in passing:
            ahead = [w for w in neighbours[run[-1]] if w not in run]
            if not ahead:
                break
            run.append(ahead[0])
    return run
