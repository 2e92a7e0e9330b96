"""Viewpoint–rim pairs on which the engine is compared with the exact referee, chord by chord.

See `engine_pairs`; a rim is observable if all its chords are.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from engine_pairs import (
    STEPS_PER_MM,
    are_rounded,
    partition_planes,
    solid_of,
    uniform_viewpoints,
    viewpoints_near_partition_planes,
    workspace_of,
)
from exact_checker import ExactChecker, dot
from rimmed_solids import rimmed_solid

from aspectgraph.visibility.visibility_regions import compute_regions


class RimComparison(NamedTuple):
    """Answers of both programs for one solid, (n, k) bool, and the pairs that differ and must not."""

    name: str
    engine: np.ndarray
    referee: np.ndarray
    disagreements: list[tuple[str, tuple, str]]


def compare_rims(seed: int, n_points: int, n_rims: int) -> RimComparison:
    """Ask both programs about one plate: viewpoints anywhere, near partition planes, and in front of the rims."""
    part, _ = rimmed_solid(seed)
    rng = np.random.default_rng([seed, 8])
    solid, workspace = solid_of(part), workspace_of(part)
    rims = solid.rims()
    rims = [rims[i] for i in rng.permutation(len(rims))[:n_rims]]
    chords = {rim.id: [solid.edges[e].vertices for e in rim.edge_ids] for rim in rims}
    checker = ExactChecker(part.vertices, part.faces, STEPS_PER_MM)
    near = viewpoints_near_partition_planes(rng, part, sum(chords.values(), []), workspace, n_points // 3)
    front = _in_front(rng, rims, workspace, n_points // 3)
    points = np.concatenate([uniform_viewpoints(rng, workspace, n_points // 3), near, front])
    points = points[checker.generic(points)]
    regions = compute_regions(solid, rims, workspace)
    assert regions.grid.snapping_mm == 0.0
    engine = regions.observable(points)
    referee = np.column_stack([checker.observable(points, pairs).all(axis=1) for pairs in chords.values()])
    rounded = are_rounded(regions.grid, points)
    wrong = [
        (part.name, tuple(points[i]), rims[k].id)
        for i, k in np.argwhere(engine != referee)
        if not (rounded[i] and _is_on_a_plane(checker, chords[rims[k].id], points[i]))
    ]
    return RimComparison(part.name, engine, referee, wrong)


def _in_front(rng: np.random.Generator, rims, workspace, n: int) -> np.ndarray:
    """Return points on the grid in the prisms over and under the rims."""
    rows = []
    for _ in range(n):
        rim = rims[rng.integers(len(rims))]
        aside = rng.normal(size=3) * 0.4 * rim.radius_mm
        rows.append(rim.centre + aside + rng.normal() * 3.0 * rim.radius_mm * rim.axis)
    points = np.rint(np.array(rows) * STEPS_PER_MM) / STEPS_PER_MM
    return points[((points >= workspace[0]) & (points <= workspace[1])).all(axis=1)]


def _is_on_a_plane(checker: ExactChecker, pairs, viewpoint) -> bool:
    point = [int(c) for c in viewpoint * checker.steps_per_mm]
    return any(dot(n, point) == offset for pair in pairs for n, offset in partition_planes(checker, *pair))
