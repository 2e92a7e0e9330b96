"""Seeded plates with prismatic holes and bosses, and viewpoint–rim pairs to compare the engine with the referee on.

A circle through points with integer coordinates, such as 3² + 4² = 5², gives polygons of 8, 12 and 16 corners: rims
that lie on circles exactly, all in integers. For the comparison see `engine_pairs`; a rim is observable if all its
chords are.
"""

from __future__ import annotations

from math import atan2
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
from generated_solids import Part, rotation

from aspectgraph.visibility.visibility_regions import compute_regions

PITCH = 20
"""Distance of neighbouring features in mm."""


def lattice_circle(square: int) -> list[tuple[int, int]]:
    """Return the integer points on x² + y² = square, counter-clockwise."""
    reach = range(-int(square**0.5), int(square**0.5) + 1)
    points = [(x, y) for x in reach for y in reach if x * x + y * y == square]
    return sorted(points, key=lambda p: atan2(p[1], p[0]))


INNER = (5,)
OUTER = (25, 50, 65)
"""Squared radii of inner and outer features; the largest inner one fits into the smallest outer one."""


class Rimmed(NamedTuple):
    """A part, and the circles of its rims as (centre, squared radius), in the part's coordinates before turning."""

    part: Part
    circles: list[tuple[tuple[int, int, int], int]]


class PlateBuilder:
    """A plate from z = 0 to `height` with features at integer places."""

    def __init__(self, n_x: int, n_y: int, height: int):
        self.height = height
        self.size = (PITCH * n_x, PITCH * n_y)
        self.index: dict[tuple[int, int, int], int] = {}
        self.faces: list = []
        self.holes: dict[str, list] = {"top": [], "bottom": []}
        self.circles: list[tuple[tuple[int, int, int], int]] = []

    def _loop(self, points) -> tuple[int, ...]:
        return tuple(self.index.setdefault(tuple(map(int, p)), len(self.index)) for p in points)

    def _ring(self, centre, square: int, z: int):
        self.circles.append(((*centre, z), square))
        return [(centre[0] + x, centre[1] + y, z) for x, y in lattice_circle(square)]

    def _walls(self, low, high, outward: bool) -> None:
        for k in range(len(low)):
            m = (k + 1) % len(low)
            quad = [low[k], low[m], high[m], high[k]]
            self.faces.append((self._loop(quad if outward else quad[::-1]), ()))

    def feature(self, centre, square: int, z: int, to: int, inner: tuple[int, int] | None = None):
        """Add a hole (`to` below `z`) or boss (above) to a face at z; return the loop to leave out of that face.

        A hole down to 0 goes through. `inner`: squared radius and level of a feature in the end face of this one.
        """
        start = self._ring(centre, square, z)
        if to == 0:
            end = self._ring(centre, square, 0)
            self._walls(end, start, outward=False)
            self.holes["bottom"].append(self._loop(end))
            return self._loop(start[::-1])
        end = self._ring(centre, square, to)
        self._walls(*((start, end) if to > z else (end, start)), outward=to > z)
        inside = () if inner is None else (self.feature(centre, inner[0], to, inner[1]),)
        self.faces.append((self._loop(end), inside))
        return self._loop(start[::-1])

    def add(self, centre, square: int, to: int, inner: tuple[int, int] | None = None) -> None:
        """Add a feature to the top of the plate."""
        self.holes["top"].append(self.feature(centre, square, self.height, to, inner))

    def part(self, name: str) -> Part:
        """Return the part."""
        (x, y) = self.size
        h = self.height
        low = [(0, 0, 0), (x, 0, 0), (x, y, 0), (0, y, 0)]
        high = [(*p[:2], h) for p in low]
        self._walls(low, high, outward=True)
        self.faces.append((self._loop(low[::-1]), tuple(self.holes["bottom"])))
        self.faces.append((self._loop(high), tuple(self.holes["top"])))
        return Part(name, tuple(self.index), tuple(self.faces))


def rimmed_solid(seed: int) -> Rimmed:
    """Return plate number `seed` of an endless series: one to four features, half of the plates turned."""
    rng = np.random.default_rng([seed, 7])
    n_x = int(rng.integers(1, 3))
    n_y = int(rng.integers(1, 3))
    height = int(rng.integers(3, 12))
    builder = PlateBuilder(n_x, n_y, height)
    for i in range(n_x):
        for j in range(n_y):
            centre = (PITCH * i + PITCH // 2 + int(rng.integers(-1, 2)), PITCH * j + PITCH // 2)
            levels = [0, int(rng.integers(1, height)), height + int(rng.integers(1, 9))]
            to = levels[rng.integers(3)]
            inner = None
            if to and rng.random() < 0.5:
                inner = (
                    int(rng.choice(INNER)),
                    int(rng.choice([level for level in range(to + 5) if level != to])),
                )
            builder.add(centre, int(rng.choice(OUTER)), to, inner)
    part = builder.part(f"rimmed plate {seed}")
    if seed % 2:
        quaternion = [(1, 1, 0, 0), (2, 1, 0, 0), (1, 1, 1, 0), (1, 2, 0, 1)][rng.integers(4)]
        part = part.mapped(rotation(quaternion), f"{part.name}, turned")
    return Rimmed(part, builder.circles)


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
    solid = solid_of(part)
    workspace = workspace_of(part)
    rims = solid.rims()
    rims = [rims[i] for i in rng.permutation(len(rims))[:n_rims]]
    chords = {rim.id: [solid.edges[e].vertices for e in rim.edge_ids] for rim in rims}
    checker = ExactChecker(part.vertices, part.faces, STEPS_PER_MM)
    near = viewpoints_near_partition_planes(
        rng, part, [pair for pairs in chords.values() for pair in pairs], workspace, n_points // 3
    )
    front = _in_front(rng, rims, workspace, n_points // 3)
    points = np.concatenate([uniform_viewpoints(rng, workspace, n_points // 3), near, front])
    points = points[checker.generic(points)]
    regions = compute_regions(solid, rims, workspace)
    assert regions.grid.snapping_mm == 0.0
    engine = regions.observable(points)
    referee = np.column_stack(
        [checker.observable(points, own).all(axis=1) for own in chords.values()]
    )
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
    return any(
        dot(n, point) == offset for pair in pairs for n, offset in partition_planes(checker, *pair)
    )
