"""Circular chains of chords in a solid that no longer says what its edges were.

Rules
-----
* A chord is an edge across which the normal turns by at least `SHARP_MESH_DEG`.
* At a vertex, two chords continue each other if they turn by at most `MAX_TURN_DEG`, the normal turns the same way
  across both, and neither turns less into any third edge of that kind.
* A run of chords is circular if its vertices leave one circle by no more than `RELATIVE_RESIDUAL` of the radius and no
  chord is longer than `UNEVEN` times the median: the flat of a D is not part of its arc.
* A closed run is a rim if it has `MIN_CHORDS` chords or more, an open one an arc from `MIN_ARC_CHORDS`.

A prism that really has eight or more sides is therefore offered as a rim; read it from STEP to be sure.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from aspectgraph.solid.circles import CircularEdge, EdgedSurface, fit_circle

SHARP_MESH_DEG = 33.0
"""Gentler edges may lie inside a curved surface: twelve facets to a full turn, and some rounding."""

MIN_CHORDS = 8
"""Squares and hexagons are common as squares and hexagons (slots, sockets, nuts); circles have more chords than six."""

MIN_ARC_CHORDS = 3
"""A quarter circle of twelve chords to the full turn; with fewer, any two even chamfers would do."""

MAX_TURN_DEG = 360.0 / MIN_CHORDS + 1.0
"""What eight chords turn by at a vertex, and some rounding."""

UNEVEN = 1.5
"""How much longer than the median a chord of a circle may be; exporters leave a short one over, not a long one."""

RELATIVE_RESIDUAL = 1e-3
"""Coordinates with four digits; the sagitta of sixty chords to the full turn."""


def fitted_chains(solid: EdgedSurface) -> list[CircularEdge]:
    """Return the circular chains of a solid with the circles fitted to them, by their lowest edge."""
    following = _continuations(solid)
    chains = [run for path in _paths(solid, following) for run in _circular_runs(solid, path)]
    found = [_chain(solid, run) for run in chains]
    edge_of = {
        frozenset(edge.vertices): edge.id
        for edge in solid.edges
        if abs(edge.dihedral_deg) >= SHARP_MESH_DEG
    }
    lowest = [min(edge_of[frozenset(p)] for p in pairwise(c.vertices)) for c in found]
    return [found[i] for i in np.argsort(lowest, kind="stable").tolist()]


def _chain(solid: EdgedSurface, run: list[int]) -> CircularEdge:
    circle = fit_circle(solid.vertices[run])
    assert circle is not None, "a circular run has a circle"
    # the turn is that of the chords, which the caller measures
    return CircularEdge(circle, tuple(run), 180.0)


def _continuations(solid: EdgedSurface) -> dict[tuple[int, int], int]:
    """Return for a chord walked from u to v, as (u, v), the vertex w that continues it, if any."""
    ends: dict[int, list[tuple[int, bool]]] = {}
    for edge in solid.edges:
        if abs(edge.dihedral_deg) >= SHARP_MESH_DEG:
            a, b = edge.vertices
            ends.setdefault(a, []).append((b, edge.dihedral_deg > 0))
            ends.setdefault(b, []).append((a, edge.dihedral_deg > 0))
    following: dict[tuple[int, int], int] = {}
    for v, around in ends.items():
        offsets = solid.vertices[[w for w, _ in around]] - solid.vertices[v]
        unit = offsets / np.linalg.norm(offsets, axis=1, keepdims=True)
        convex = np.array([flag for _, flag in around])
        # turn between walking in along one and out along the other
        turn = np.degrees(np.arccos(np.clip(-(unit @ unit.T), -1.0, 1.0)))
        turn[convex[:, None] != convex[None, :]] = np.inf
        np.fill_diagonal(turn, np.inf)
        nearest = np.argmin(turn, axis=1)
        for i, j in enumerate(nearest.tolist()):
            if nearest[j] == i and turn[i, j] <= MAX_TURN_DEG:
                following[around[i][0], v] = around[j][0]
    return following


def _paths(solid: EdgedSurface, following: dict[tuple[int, int], int]) -> list[list[int]]:
    """Return the maximal paths of chords that continue each other, as vertices; closed ones end where they start."""
    done: set[frozenset[int]] = set()
    paths = []
    for edge in solid.edges:
        if frozenset(edge.vertices) in done or abs(edge.dihedral_deg) < SHARP_MESH_DEG:
            continue
        path = list(edge.vertices)
        while len(path) < 3 or path[0] != path[-1]:
            ahead = following.get((path[-2], path[-1]))
            if ahead is None:
                break
            path.append(ahead)
        if path[0] != path[-1] or following.get((path[-2], path[-1])) != path[1]:
            path.reverse()
            while (ahead := following.get((path[-2], path[-1]))) is not None and ahead not in path:
                path.append(ahead)
        done |= {frozenset(pair) for pair in pairwise(path)}
        paths.append(path)
    return paths


def _circular_runs(solid: EdgedSurface, path: list[int]) -> list[list[int]]:
    """Return the circular runs of a path: all of a closed one, or the longest that follow each other."""
    closed = path[0] == path[-1]
    if closed and _is_circular(solid, path):
        return [path] if len(path) - 1 >= MIN_CHORDS else []
    if closed:
        path = _from_a_corner(solid, path)
    runs = []
    start = 0
    while start + MIN_ARC_CHORDS < len(path):
        end = start + MIN_ARC_CHORDS
        if not _is_circular(solid, path[start : end + 1]):
            start += 1
            continue
        while end + 1 < len(path) and _is_circular(solid, path[start : end + 2]):
            end += 1
        runs.append(path[start : end + 1])
        start = end
    return runs


def _from_a_corner(solid: EdgedSurface, path: list[int]) -> list[int]:
    """Return a closed path turned so that it starts at the end of its longest chord, where no arc is cut in two."""
    lengths = np.linalg.norm(np.diff(solid.vertices[path], axis=0), axis=1)
    start = int(np.argmax(lengths)) + 1
    return path[start:-1] + path[: start + 1]


def _is_circular(solid: EdgedSurface, run: list[int]) -> bool:
    points = solid.vertices[run]
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    if lengths.max() > UNEVEN * np.median(lengths):
        return False
    circle = fit_circle(points)
    return circle is not None and bool(
        circle.distances_mm(points).max() <= RELATIVE_RESIDUAL * circle.radius_mm
    )
