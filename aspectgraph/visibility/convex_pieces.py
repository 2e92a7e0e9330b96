"""Convex pieces of a solid's faces: what can stand in the way of a line of sight.

Triangles of a face are joined across their common sides as long as the result stays convex (Hertel and Mehlhorn,
"Fast triangulation of simple polygons", FCT 1983: at most four times as many pieces as the fewest possible). Convexity
is decided by exact integer orientation in the face's projection along its dominant axis.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from aspectgraph.exact.canonical_order import Listing
from aspectgraph.exceptions import SolidError
from aspectgraph.solid.solid import Solid
from aspectgraph.solid.topology import Face
from aspectgraph.solid.triangulate import triangulate_face


class Pieces(NamedTuple):
    """Convex polygons, counter-clockwise seen from outside.

    Attributes
    ----------
    vertices : ndarray of int32
        Vertex numbers of all loops, one after the other.
    first : ndarray of int32, shape (n + 1,)
        Where each loop starts.
    face : ndarray of int32, shape (n,)
        The face of the solid each piece belongs to.
    """

    vertices: np.ndarray
    first: np.ndarray
    face: np.ndarray


def convex_pieces(
    solid: Solid, points: np.ndarray, normals: np.ndarray, listing: Listing
) -> Pieces:
    """Cut every face of a solid into convex pieces, in the part's own order.

    Parameters
    ----------
    solid : Solid
    points : ndarray of int64, shape (n, 3)
        Its vertices on the grid.
    normals : ndarray of int64, shape (f, 3)
        Outward normals of its faces on the grid, of any length.
    listing : Listing
    """
    ranked = points[listing.vertex]
    drawn: dict[tuple[int, bool], list[list[int]]] = {}
    loops: list[list[int]] = []
    faces: list[int] = []
    for face, number in zip(listing.faces, listing.face.tolist(), strict=True):
        axis = int(np.abs(normals[number]).argmax())
        view = axis, bool(normals[number][axis] < 0)
        xy = drawn[view] = drawn.get(view) or _project(ranked, *view)
        if not face.holes and _is_convex(face.outer, xy):
            parts = [list(face.outer)]
        else:
            parts = _join(
                _triangles(
                    ranked, face, normals[number], listing.rank[solid.face_triangles[number]]
                ),
                xy,
            )
        loops += parts
        faces += [number] * len(parts)
    first = np.concatenate([[0], np.cumsum([len(loop) for loop in loops])])
    vertices = listing.vertex[np.concatenate(loops)]
    return Pieces(vertices.astype(np.int32), first.astype(np.int32), np.array(faces, np.int32))


def _is_convex(loop: Sequence[int], xy: list[list[int]]) -> bool:
    return _convex_at(loop, range(len(loop)), xy)


def _triangles(
    points: np.ndarray, face: Face, normal: np.ndarray, known: np.ndarray
) -> list[list[int]]:
    """Triangles of a face as it lies on the grid, or the known ones where a corner snapped straight leaves too few."""
    try:
        return triangulate_face(points.astype(float), face, normal).tolist()
    except SolidError:
        return known.tolist()


def _project(points: np.ndarray, axis: int, from_below: bool) -> list[list[int]]:
    """Drop an axis, seen from above or from below it."""
    keep = [(axis + 1) % 3, (axis + 2) % 3]
    if from_below:
        keep.reverse()
    return points[:, keep].tolist()


def _join(triangles: list[list[int]], xy: list[list[int]]) -> list[list[int]]:
    """Join triangles to convex polygons, longest common sides first."""
    loops: dict[int, list[int]] = dict(enumerate(triangles))
    owner = {(loop[k - 1], loop[k]): n for n, loop in loops.items() for k in range(len(loop))}
    sides = [side for side in owner if side[0] < side[1] and side[::-1] in owner]
    sides.sort(
        key=lambda side: (
            -((xy[side[0]][0] - xy[side[1]][0]) ** 2 + (xy[side[0]][1] - xy[side[1]][1]) ** 2)
        )
    )
    for i, j in sides:
        n = owner[i, j]
        m = owner[j, i]
        if n == m:
            continue
        merged = _merge(loops[n], loops[m], i, j)
        if merged is None or not _convex_at(merged, (merged.index(i), merged.index(j)), xy):
            continue
        for k in range(len(loops[m])):
            owner[loops[m][k - 1], loops[m][k]] = n
        loops[n] = merged
        del loops[m]
    return list(loops.values())


def _merge(loop: list[int], other: list[int], i: int, j: int) -> list[int] | None:
    """Splice `other`, which runs j to i, into `loop`, which runs i to j; None if they meet elsewhere too."""
    if len(set(loop) & set(other)) != 2:
        return None
    at = loop.index(j)
    back = other.index(i)
    return loop[at:] + loop[:at] + (other[back:] + other[:back])[1:-1]


def _convex_at(loop: Sequence[int], places: Iterable[int], xy: list[list[int]]) -> bool:
    for k in places:
        (ax, ay) = xy[loop[k - 1]]
        (bx, by) = xy[loop[k]]
        (cx, cy) = xy[loop[(k + 1) % len(loop)]]
        if (bx - ax) * (cy - by) - (by - ay) * (cx - bx) < 0:
            return False
    return True
