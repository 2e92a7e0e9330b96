"""Viewpoint–entity pairs on which the engine is compared with the referee.

Generated solids have integer vertices, viewpoints lie on a grid of 1/64 mm. The engine turns both into the part's own
frame, where vertices come to lie on its grid exactly, and so do most viewpoints on its finer grid of queries: both
programs get the same numbers. Where a viewpoint does not, as with many oblique parts, the engine answers for one about
10⁻¹² mm aside; then the two may differ if the viewpoint lies exactly on a partition plane, and only then.
"""

from __future__ import annotations

from fractions import Fraction
from itertools import chain
from typing import NamedTuple

import numpy as np
from exact_checker import ExactChecker, cross, dot, minus
from generated_solids import Part, generated_solid

from aspectgraph.entities.entity import Entity, Stretch, resolve_entities
from aspectgraph.exact.grid import POINT_BITS, Grid, turned
from aspectgraph.solid.solid import Solid
from aspectgraph.visibility.visibility_regions import compute_regions

STEPS_PER_MM = 64


class Comparison(NamedTuple):
    """Answers of both programs for one solid, (n, k) bool, what they were asked, and which viewpoints were rounded."""

    part: Part
    checker: ExactChecker
    points: np.ndarray
    edges: list[tuple[int, int]]
    engine: np.ndarray
    referee: np.ndarray
    rounded: np.ndarray

    def disagreements(self) -> list[tuple[str, tuple, tuple, bool]]:
        """Return (solid, viewpoint, edge's end points, engine's answer) for every pair that differs and must not."""
        return [
            (
                self.part.name,
                tuple(self.points[i]),
                tuple(self.part.vertices[v] for v in self.edges[k]),
                self.engine[i, k],
            )
            for i, k in np.argwhere(self.engine != self.referee)
            if not (self.rounded[i] and self._is_on_partition_plane(i, k))
        ]

    def _is_on_partition_plane(self, i: int, k: int) -> bool:
        planes = partition_planes(self.checker, *self.edges[k])
        point = [int(c) for c in self.points[i] * self.checker.steps_per_mm]
        return any(dot(normal, point) == offset for normal, offset in planes)


def partition_planes(checker: ExactChecker, a: int, b: int) -> list[tuple]:
    """Return planes (normal, offset) through ab and a vertex, or an end of ab and an edge, in the checker's steps."""
    points = checker.vertices
    trios = chain(
        ((a, b, w) for w in range(len(points))),
        ((end, i, j) for end in (a, b) for i, j in checker.edge_faces),
    )
    normals = [
        (cross(minus(points[q], points[p]), minus(points[r], points[p])), points[p])
        for p, q, r in trios
    ]
    return [(normal, dot(normal, base)) for normal, base in normals if any(normal)]


def are_rounded(grid: Grid, points: np.ndarray) -> np.ndarray:
    """Return which viewpoints do not lie on the engine's grid of queries; rounding of doubles is 10⁻³ of its step."""
    queries = (turned(grid.frame, points) - grid.origin_mm) / grid.steps_mm * 2.0**POINT_BITS
    return (np.abs(queries - np.rint(queries)) > 0.01).any(axis=1)


def solid_of(part: Part) -> Solid:
    """Return the part as the package's solid."""
    return Solid(part.vertices, part.faces, name=part.name)


def sharp_edges(part: Part, checker: ExactChecker) -> list[tuple[int, int]]:
    """Return the edges whose faces are not coplanar."""
    return [pair for pair in part.edges() if checker.convexity[pair]]


def entities_of(solid: Solid, edges) -> dict[str, Entity]:
    """Return vertex pairs as entities, however slightly their faces turn."""
    points = {f"e{i}": solid.vertices[list(pair)] for i, pair in enumerate(edges)}
    return resolve_entities(solid, points, min_dihedral_deg=1e-3)


def workspace_of(part: Part) -> np.ndarray:
    """Return a box with one diagonal of room, so that most partition surfaces matter in it."""
    low = np.min(part.vertices, axis=0)
    high = np.max(part.vertices, axis=0)
    room = int(np.ceil(np.linalg.norm(high - low)))
    return np.array([low - room, high + room], dtype=float)


def uniform_viewpoints(
    rng: np.random.Generator, workspace, n: int, steps_per_mm: int = STEPS_PER_MM
) -> np.ndarray:
    """Return points on the grid, uniform in the workspace."""
    return (
        rng.integers(workspace[0] * steps_per_mm, workspace[1] * steps_per_mm + 1, (n, 3))
        / steps_per_mm
    )


def viewpoints_near_partition_planes(
    rng: np.random.Generator, part: Part, edges, workspace, n: int, steps_per_mm: int = STEPS_PER_MM
) -> np.ndarray:
    """Return points on the grid about a grid step from planes through entity and vertex, or entity's end and edge."""
    vertices = np.array(part.vertices, dtype=float)
    all_edges = part.edges()
    points = []
    for _ in range(n):
        a, b = edges[rng.integers(len(edges))]
        if rng.random() < 0.5:
            base = vertices[a]
            span = vertices[[b, rng.integers(len(vertices))]]
        else:
            base = vertices[rng.choice([a, b])]
            span = vertices[list(all_edges[rng.integers(len(all_edges))])]
        weights = rng.normal(size=2) * rng.choice([1, 4, 16])
        points.append(base + weights @ (span - base) + rng.integers(-1, 2, 3) / steps_per_mm)
    points = np.rint(np.array(points).reshape(-1, 3) * steps_per_mm) / steps_per_mm
    return points[((points >= workspace[0]) & (points <= workspace[1])).all(axis=1)]


def compare(seed: int, n_points: int, n_edges: int) -> Comparison:
    """Ask both programs about one generated solid."""
    return compare_part(generated_solid(seed), np.random.default_rng([seed, 1]), n_points, n_edges)


def compare_part(
    part: Part,
    rng: np.random.Generator,
    n_points: int,
    n_edges: int,
    steps_per_mm: int = STEPS_PER_MM,
) -> Comparison:
    """Ask both programs about random viewpoints and edges of a part."""
    checker = ExactChecker(part.vertices, part.faces, steps_per_mm)
    edges = sharp_edges(part, checker)
    edges = [edges[i] for i in rng.permutation(len(edges))[:n_edges]]
    workspace = workspace_of(part)
    near = viewpoints_near_partition_planes(
        rng, part, edges, workspace, n_points // 2, steps_per_mm
    )
    points = np.concatenate(
        [uniform_viewpoints(rng, workspace, n_points - len(near), steps_per_mm), near]
    )
    points = points[checker.generic(points)]
    solid = solid_of(part)
    regions = compute_regions(solid, entities_of(solid, edges), workspace)
    assert regions.grid.snapping_mm == 0.0
    answers = regions.observable(points), checker.observable(points, edges)
    return Comparison(part, checker, points, edges, *answers, are_rounded(regions.grid, points))


def stretched(
    part: Part, checker: ExactChecker, edges, shares
) -> tuple[Part, ExactChecker, list[tuple[int, int]]]:
    """Return part and checker with the ends of stretches as further points, and the stretches as pairs of these.

    `shares` are exact, from the first vertex of each pair to the second; their points must lie on the checker's grid.
    """
    points = []
    for (a, b), own in zip(edges, shares, strict=True):
        p, q = (part.vertices[v] for v in (a, b))
        points += [[x + share * (y - x) for x, y in zip(p, q, strict=True)] for share in own]
    first = len(part.vertices)
    pairs = [(first + 2 * k, first + 2 * k + 1) for k in range(len(edges))]
    extended = part._replace(vertices=(*part.vertices, *(tuple(map(float, p)) for p in points)))
    return extended, checker.with_points(points), pairs


def compare_stretches(
    seed: int, n_points: int, n_edges: int, parts: int, factor: int = 1
) -> tuple[Comparison, np.ndarray]:
    """Ask both programs about stretches between random multiples of 1/parts of a generated solid's edges.

    Returns the comparison, and the referee's answers for the whole edges.
    """
    rng = np.random.default_rng([seed, parts])
    part = generated_solid(seed)
    checker = ExactChecker(part.vertices, part.faces, STEPS_PER_MM * factor)
    edges = sharp_edges(part, checker)
    edges = [edges[i] for i in rng.permutation(len(edges))[:n_edges]]
    shares = [_two_shares(rng, parts) for _ in edges]
    extended, checker, pairs = stretched(part, checker, edges, shares)
    workspace = workspace_of(part)
    near = viewpoints_near_partition_planes(rng, extended, pairs, workspace, n_points // 2)
    points = np.concatenate([uniform_viewpoints(rng, workspace, n_points - len(near)), near])
    points = points[checker.generic(points)]
    solid = solid_of(part)
    ids = {tuple(sorted(edge.vertices)): edge.id for edge in solid.edges}
    named = {}
    for k, (pair, (start, end)) in enumerate(zip(edges, shares, strict=True)):
        edge = solid.edges[ids[tuple(sorted(pair))]]
        ends = (start, end) if edge.vertices == tuple(pair) else (1 - end, 1 - start)
        named[f"s{k}"] = Stretch(edge.id, *ends)
    entities = resolve_entities(solid, named, min_dihedral_deg=1e-3)
    regions = compute_regions(solid, entities, workspace)
    answers = regions.observable(points), checker.observable(points, pairs)
    rounded = are_rounded(regions.grid, points) | (regions.cutting_mm > 0.0)
    comparison = Comparison(extended, checker, points, pairs, *answers, rounded)
    return comparison, checker.observable(points, edges)


def _two_shares(rng: np.random.Generator, parts: int) -> tuple[Fraction, Fraction]:
    """Return two different multiples of 1/parts in order, not both ends."""
    while True:
        start, end = sorted(rng.integers(0, parts + 1, 2).tolist())
        if 0 < end - start < parts:
            return Fraction(start, parts), Fraction(end, parts)
