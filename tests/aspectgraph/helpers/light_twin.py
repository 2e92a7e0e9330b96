"""The light domains' twin: whether an edge shows under a lamp, in integers and fractions throughout.

The two irradiances a = N₁·v / √m₁ and b = N₂·v / √m₂ (m = N·N, v from the edge to the lamp) differ by the contrast c or
more exactly where a ≥ k b or b ≥ k a with k = (1 + c) / (1 - c); squared, this is a comparison of rational numbers. It
shares nothing with the engine: no planes through the edge, no cells. Whether the edge is lit, `exact_checker` tells.
"""

from __future__ import annotations

from fractions import Fraction
from math import isqrt

import numpy as np
from engine_pairs import (
    Comparison,
    are_rounded,
    entities_of,
    sharp_edges,
    solid_of,
    uniform_viewpoints,
    viewpoints_near_partition_planes,
    workspace_of,
)
from exact_checker import ExactChecker, dot, minus
from generated_solids import Part

from aspectgraph import compute_light

STEPS_PER_MM = 64


def excess(checker: ExactChecker, pair: tuple[int, int], lamp, contrast: Fraction) -> Fraction:
    """Return by which share the brighter face's squared irradiance exceeds k² times the darker one's; -1 if dark."""
    towards = minus(lamp, checker.vertices[pair[0]])
    squares = []
    for face in checker.edge_faces[tuple(sorted(pair))]:
        normal = checker.planes[face][0]
        squares.append(Fraction(max(dot(normal, towards), 0) ** 2, dot(normal, normal)))
    low, high = sorted(squares)
    k = (1 + contrast) / (1 - contrast)
    return (high - k * k * low) / high if high else Fraction(-1)


def is_rational(checker: ExactChecker, pair: tuple[int, int]) -> bool:
    """Return whether the lengths of the two faces' integer normals have a rational ratio."""
    normals = [checker.planes[face][0] for face in checker.edge_faces[tuple(sorted(pair))]]
    ratio = Fraction(*(dot(normal, normal) for normal in normals))
    return all(isqrt(x) ** 2 == x for x in (ratio.numerator, ratio.denominator))


def lamps_near_the_wedge(
    rng, checker: ExactChecker, edges, workspace, contrast: Fraction, n: int
) -> np.ndarray:
    """Return points within about a step of where the contrast of an edge is that asked for."""
    k = float((1 + contrast) / (1 - contrast))
    points = []
    for _ in range(n):
        pair = tuple(sorted(edges[rng.integers(len(edges))]))
        a, b = (np.array(checker.vertices[v], float) / checker.steps_per_mm for v in pair)
        one, other = (
            np.array(checker.planes[f][0], float) for f in rng.permuted(checker.edge_faces[pair])
        )
        across = one / np.linalg.norm(one) - k * other / np.linalg.norm(other)
        along = (b - a) / np.linalg.norm(b - a)
        out = np.cross(across, along)
        out *= np.sign(
            out @ (one / np.linalg.norm(one) + other / np.linalg.norm(other))
        ) / np.linalg.norm(out)
        size = np.linalg.norm(b - a) * rng.choice([1, 4])
        points.append(
            a
            + size * (rng.normal() * along + abs(rng.normal()) * out)
            + rng.integers(-1, 2, 3) / 64
        )
    points = np.rint(np.array(points).reshape(-1, 3) * STEPS_PER_MM) / STEPS_PER_MM
    return points[((points >= workspace[0]) & (points <= workspace[1])).all(axis=1)]


def compare_light(part: Part, seed: int, n_points: int, n_edges: int, contrasts: tuple[str, str]):
    """Return answers of engine and twin, (n, k) bool, and where they may differ: rounded, or turned by rounding.

    The contrasts of both are given apart, so that a test can see the comparison fail.
    """
    rng = np.random.default_rng([seed, 2])
    checker = ExactChecker(part.vertices, part.faces, STEPS_PER_MM)
    edges = sharp_edges(part, checker)
    edges = [edges[i] for i in rng.permutation(len(edges))[:n_edges]]
    workspace = workspace_of(part)
    asked = Fraction(contrasts[1])
    third = n_points // 3
    points = np.concatenate(
        [
            uniform_viewpoints(rng, workspace, third),
            viewpoints_near_partition_planes(rng, part, edges, workspace, third),
            lamps_near_the_wedge(rng, checker, edges, workspace, asked, third),
        ]
    )
    points = points[checker.generic(points)]
    solid = solid_of(part)
    regions = compute_light(solid, entities_of(solid, edges), float(contrasts[0]), workspace)
    lamps = np.rint(points * STEPS_PER_MM).astype(int).tolist()
    above = [[excess(checker, pair, lamp, asked) for pair in edges] for lamp in lamps]
    shares = np.array(above, object).reshape(len(lamps), len(edges))
    # by its docstring a plane leans by less than 10⁻⁶; where it is exact nothing may differ but for a rounded lamp
    exact = (
        np.array([is_rational(checker, pair) for pair in edges]) & (regions.grid.scale == 1.0).all()
    )
    rounded = are_rounded(regions.grid, points)
    near = np.abs(shares.astype(float)) < np.where(exact, 1e-9 * rounded[:, None], 1e-4)
    engine = regions.showing(points)
    twin = checker.observable(points, edges) & (shares >= 0).astype(bool)
    seen = Comparison(part, checker, points, edges, engine, twin, rounded)
    for i, k in np.argwhere((engine != twin) & rounded[:, None]):
        near[i, k] |= seen._is_on_partition_plane(i, k)
    return engine, twin, near
