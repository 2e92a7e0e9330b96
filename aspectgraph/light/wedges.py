r"""The wedge of lamp positions around the bisector of an edge's two faces from which its contrast is too small.

For p - x = v and a least contrast c, the contrast is below c while a face is lit exactly where

    [(1 - c) n₁ - (1 + c) n₂]·v < 0  and  [(1 - c) n₂ - (1 + c) n₁]·v < 0.

Both together imply n₁·v > 0 and n₂·v > 0: with k = (1 + c) / (1 - c) > 1 they say n₁·v < k n₂·v and n₂·v < k n₁·v, so
n₁·v < k² n₁·v, which is wrong unless n₁·v > 0; likewise for n₂. So the wedge is one convex set, bounded by two planes
through the edge's line, and is blocked like the shadow of an occluder.

On the grid, face normals are integer triples N of length |N|, and the first plane is q N₁ - p N₂ with p / q for
k |N₁| / |N₂|. Where that ratio is rational with terms up to 2²⁰, as between faces along the axes for a contrast
of few digits, p / q is that ratio and the plane is exact. Else the larger of p / q and q / p is the nearest such
fraction; or, where the coefficients leave no room or snapping displaced the edge from its face's plane, the plane goes
through the edge's ends and the nearest grid point 2²⁰ steps away. It then leans by less than 10⁻⁶ rad from where it
should, on a grid of equal steps, and always holds the ends exactly. Whatever plane was taken, everything after is
decided exactly by its integers.
"""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from math import isqrt

import numpy as np

from aspectgraph.entities.straight_edges import Entity
from aspectgraph.exact.grid import Grid
from aspectgraph.exact.planes import plane_through
from aspectgraph.light.contrast import NONE
from aspectgraph.solid.solid import Solid
from aspectgraph.visibility.blocked_sets import blockers
from aspectgraph.visibility.casting import CONTRAST, FACE
from aspectgraph.visibility.scene import Scene, chords, line_ends
from aspectgraph.visibility.united_sets import Blockers, united

_REACH_BITS = 20
# least room that exact signs need, see `predicates`
_COEFFICIENT_BITS = 42
_OFFSET_BITS = 62


def light_sets(
    scene: Scene,
    grid: Grid,
    solid: Solid,
    entity: Entity,
    contrast: float,
    silhouettes: Mapping[int, int] = NONE,
) -> Blockers:
    """Return the sets of lamp positions from which an entity is not lit as a whole or has too little contrast.

    Parameters
    ----------
    scene, grid, solid
        The solid on its grid, the grid, and itself.
    entity : Entity
        A rim or arc has as many wedges as chords, each with the flat faces next to it.
    contrast : float
        Least contrast, strictly between 0 and 1.
    silhouettes : mapping of int to int
        Edges of the entity that are seen as silhouettes, and the face that is seen: it must be lit, no more.
    """
    sets = [blockers(scene, solid, entity)]
    for chord in chords(entity):
        sets += _wedges(scene, grid, solid, chord, contrast, silhouettes)
        sets += [
            _behind(scene, silhouettes[edge_id])
            for edge_id in chord.edge_ids
            if edge_id in silhouettes
        ]
    return united(sets)


def _behind(scene: Scene, face: int) -> Blockers:
    """Everything behind a face."""
    number = scene.plane_of_face[face]
    return Blockers(
        np.array([0, 1], np.int32),
        np.zeros(1, np.int32),
        np.array([-scene.side_of_face[face]], np.int8),
        scene.planes[[number]],
        np.array([[FACE, face, -1, -1]], np.int32),
    )


def _wedges(
    scene: Scene,
    grid: Grid,
    solid: Solid,
    chord: Entity,
    contrast: float,
    silhouettes: Mapping[int, int],
) -> list[Blockers]:
    """One set for each pair of face planes next to a straight entity that is seen as a crease."""
    ends = line_ends(scene, solid, chord)
    found: dict[frozenset[int], Blockers] = {}
    for edge_id in (e for e in chord.edge_ids if e not in silhouettes):
        one, other = solid.edges[edge_id].faces
        pair = frozenset((int(scene.plane_of_face[one]), int(scene.plane_of_face[other])))
        if pair not in found:
            planes = [
                contrast_plane(scene, grid, ends, (f, g), contrast)
                for f, g in ((one, other), (other, one))
            ]
            origin = [[CONTRAST, *ends, f] for f in (one, other)]
            found[pair] = Blockers(
                np.array([0, 2], np.int32),
                np.array([0, 1], np.int32),
                np.array([-1, -1], np.int8),
                np.array(planes, np.int64),
                np.array(origin, np.int32),
            )
    return list(found.values())


def contrast_plane(
    scene: Scene, grid: Grid, ends: tuple[int, int], faces: tuple[int, int], contrast: float
) -> np.ndarray:
    """Return the plane (a, b, c, d) through an edge where its first face has just the contrast, positive side bright.

    Parameters
    ----------
    scene, grid
        The solid on its grid, and the grid.
    ends : tuple of int
        Vertices of the edge.
    faces : tuple of int
        Brighter and darker face.
    contrast : float
        Least contrast.
    """
    # Python integers, which do not overflow
    one, other = (
        [int(c) * int(scene.side_of_face[f]) for c in scene.planes[scene.plane_of_face[f]]]
        for f in faces
    )
    asked = Fraction(repr(contrast))
    ratio = (1 + asked) / (1 - asked) * _length_ratio(one[:3], other[:3], grid.scale)
    # of the larger of ratio and reciprocal, so that the error is relative
    if ratio < 1:
        ratio = 1 / (1 / ratio).limit_denominator(1 << _REACH_BITS)
    else:
        ratio = ratio.limit_denominator(1 << _REACH_BITS)
    points = [[int(x) for x in scene.points[v]] for v in ends]
    if all(
        sum(a * x for a, x in zip(plane, p, strict=False)) == plane[3]
        for plane in (one, other)
        for p in points
    ):
        combined = [
            ratio.denominator * a - ratio.numerator * b for a, b in zip(one, other, strict=True)
        ]
        divisor = int(np.gcd.reduce([abs(c) for c in combined[:3]]))
        combined = [c // divisor for c in combined]
        if (
            max(map(abs, combined[:3])) < 1 << _COEFFICIENT_BITS
            and abs(combined[3]) < 1 << _OFFSET_BITS
        ):
            return np.array(combined, np.int64)
    return _through_ends(scene.points[list(ends)], (one, other), float(ratio), grid.scale)


def _length_ratio(one: list[int], other: list[int], scale: np.ndarray) -> Fraction:
    """|N₁| / |N₂| of two plane normals, exact where it is rational and the grid's steps are equal."""
    if (scale == 1.0).all():
        square = Fraction(sum(c * c for c in one), sum(c * c for c in other))
        root = Fraction(isqrt(square.numerator), isqrt(square.denominator))
        if root * root == square:
            return root
    lengths = [float(np.linalg.norm(np.array(normal, float) / scale)) for normal in (one, other)]
    return Fraction(lengths[0] / lengths[1])


def _through_ends(
    ends: np.ndarray, planes: tuple[list[int], list[int]], ratio: float, scale: np.ndarray
) -> np.ndarray:
    """Return the plane through both ends and the grid point nearest to where the exact one is, far from the edge."""
    one, other = (np.array(plane[:3], float) / scale for plane in planes)
    normal = one - ratio * other
    across = np.cross((ends[1] - ends[0]) * scale, normal / np.abs(normal).max()) / scale
    away = np.rint(across / np.abs(across).max() * (1 << _REACH_BITS)).astype(np.int64)
    plane = plane_through(ends[0], ends[1], ends[0] + away)
    return plane if (plane[:3] / scale) @ normal > 0 else -plane
