"""Details of a part against its grid: nothing that is apart may come so near that snapping could make it one.

Where snapping displaces vertices, by less than a step each, whatever lies within the grid's resolution (four steps) of
a plane counts as lying on it. A gap, a step or a wall of that size would vanish, and with it what it hides or shows. So
vertices, edges and faces that do not meet must be at least `LEAST_STEPS` apart on the grid.

Then the snapped solid has the shape of the given one: move every vertex on a straight line from its given place to its
snapped one. Two places of the surface come nearer by less than two steps on the way, so nothing that is apart touches,
crosses, flips or vanishes. Where snapping displaces nothing, every decision is exact and no distance is too small.

Notation
--------
p   vertices in steps of the grid, (n, 3) doubles of whole numbers
A pair is (kind, i, j): of two edges, of a vertex and an edge, or of a vertex and a triangle over whose inside it lies.
Pairs that share a vertex do not count, nor do a vertex and a face that it belongs to.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
import shapely

from aspectgraph.exact.grid import Grid
from aspectgraph.exceptions import ResolutionError
from aspectgraph.solid.checks import segment_distance, side_distances
from aspectgraph.solid.solid import Solid
from aspectgraph.solid.topology import Face, describe_edge, describe_point

# The part's own axes: a frame that turns with the part, so that a turned copy is laid on its grid
# the same way.
#
# The first axis is the direction in which most of the surface looks; the second, across it, that
# in which most of the rest does, or else the longest edges run. Of directions that tie, and of
# the two senses of each, those are taken in which a generic sum over the edges, the entities
# among them counting more, is largest; where the sums tie too, the part is symmetric and any will
# do.
#
# Tolerances stand here only to tell equal from different in the presence of rounding. They choose
# between frames that are all valid: whatever the choice, everything after it is exact, and none
# of them decides topology.


# Directions closer than this (radians) are one; sums of areas or lengths closer than this share tie.
_SAME_DIRECTION = 1e-7
_TIE = 1e-7
# entries of the frame that differ from 0 or 1 by less are rounding
_AXIS_ALIGNED = 1e-12
_MAX_CANDIDATES = 4096

# generic linear forms of the two ends of an edge
_FORMS = np.array(
    [
        [1.618034, 0.701711, 2.236068, 0.447214, 1.154701, 0.309017],
        [0.577350, 1.879385, 0.267949, 1.414214, 0.351207, 2.080084],
        [2.094551, 0.414214, 1.324718, 0.754878, 1.732051, 0.861500],
    ]
)


def own_frame(solid: Solid, marks: Sequence[Sequence[int]] = ()) -> np.ndarray:
    """Rows are the part's own axes in the user's frame: own = frame @ user, a rotation, shape (3, 3).

    Of an axis-aligned part it is exactly a signed permutation.

    Parameters
    ----------
    solid : Solid
    marks : sequence of sequence of int
        Groups of edges, each told from all others: what the part is symmetric but for.
    """
    directions, weights = _classes(_area_vectors(solid))
    edges = np.array([edge.vertices for edge in solid.edges])
    runs = solid.vertices[edges[:, 1]] - solid.vertices[edges[:, 0]]
    frames: list[np.ndarray] = []
    for first in directions[_ties(weights)]:
        across = np.abs(directions @ first) < _SAME_DIRECTION
        seconds = directions[across]
        their_weights = weights[across]
        if not len(seconds):
            lengths = np.linalg.norm(runs, axis=1)
            seconds, their_weights = _classes(
                runs[np.abs(runs @ first) < _SAME_DIRECTION * lengths]
            )
        for second in seconds[_ties(their_weights)]:
            frames += _right_handed(first, second)
    candidates = np.array(frames[:_MAX_CANDIDATES])
    ends = solid.vertices[edges]
    ends = ends - ends.mean(axis=(0, 1))
    weights = np.ones(len(edges))
    for k, mark in enumerate(marks):
        weights[list(mark)] += (k + 1) / len(marks)
    return _exact_where_aligned(candidates[np.argmax(_signatures(candidates, ends, weights))])


def _area_vectors(solid: Solid) -> np.ndarray:
    corners = solid.vertices[solid.triangles]
    doubled = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    total = np.zeros((len(solid.faces), 3))
    np.add.at(total, solid.triangle_face, 0.5 * doubled)
    return total


def _classes(vectors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Directions of vectors, up to sign, and the sum of lengths of each."""
    lengths = np.linalg.norm(vectors, axis=1)
    rows = np.argsort(-lengths, kind="stable")
    directions = []
    weights = []
    while len(rows):
        leader = vectors[rows[0]] / lengths[rows[0]]
        cosine = vectors[rows] @ leader
        off = np.linalg.norm(vectors[rows] - cosine[:, None] * leader, axis=1)
        alike = off <= _SAME_DIRECTION * lengths[rows]
        total = (vectors[rows[alike]] * np.sign(cosine[alike])[:, None]).sum(axis=0)
        directions.append(total / np.linalg.norm(total))
        weights.append(lengths[rows[alike]].sum())
        rows = rows[~alike]
    return np.array(directions), np.array(weights)


def _ties(weights: np.ndarray) -> np.ndarray:
    return weights >= (1.0 - _TIE) * weights.max()


def _right_handed(first: np.ndarray, second: np.ndarray) -> list[np.ndarray]:
    """The four frames with z along the first and x along the second direction."""
    second = second - (second @ first) * first
    second /= np.linalg.norm(second)
    third = np.cross(first, second)
    return [np.array([s * second, r * s * third, r * first]) for r in (1, -1) for s in (1, -1)]


def _signatures(candidates: np.ndarray, ends: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """A generic smooth function of each edge in each frame, weighted and summed over the edges of the part."""
    size = np.linalg.norm(ends, axis=-1).max()
    sums = np.empty(len(candidates))
    for k, frame in enumerate(candidates):
        local_ends = (ends @ frame.T) / size
        forward = local_ends.reshape(-1, 6)
        backward = local_ends[:, ::-1].reshape(-1, 6)
        sums[k] = weights @ (
            np.sin(forward @ _FORMS.T + 0.3) + np.sin(backward @ _FORMS.T + 0.3)
        ).sum(axis=1)
    return sums


def _exact_where_aligned(frame: np.ndarray) -> np.ndarray:
    rounded = np.rint(frame)
    return rounded if np.abs(frame - rounded).max() < _AXIS_ALIGNED else frame


# One order for the vertices and faces of a part, whatever order its user lists them in.
#
# Vertices are ranked by their places on the grid, loops start at their least vertex, and faces
# and holes are sorted by the ranks of theirs. Whatever depends on an order of work (which plane
# of several that agree is kept, how a face is cut into pieces, in which order cells are cut) then
# depends on the part alone. Numbers stay the user's everywhere.


class Listing(NamedTuple):
    """The part's own order.

    Attributes
    ----------
    rank : ndarray of int, shape (n,)
        Of each vertex.
    vertex : ndarray of int, shape (n,)
        The vertex of each rank.
    faces : tuple of Face
        The user's faces, sorted, their loops in ranks.
    face : ndarray of int, shape (f,)
        The user's number of each of them.
    """

    rank: np.ndarray
    vertex: np.ndarray
    faces: tuple[Face, ...]
    face: np.ndarray


def list_solid(solid: Solid, points: np.ndarray) -> Listing:
    """Order a solid by its vertices' places on the grid, (n, 3) integers."""
    vertex = np.lexsort(points.T[::-1])
    rank = np.empty_like(vertex)
    rank[vertex] = np.arange(len(vertex))
    faces = []
    for number, face in enumerate(solid.faces):
        outer, *holes = (_from_least(loop, rank) for loop in face.loops)
        faces.append((outer, tuple(sorted(holes)), number))
    faces.sort()
    return Listing(
        rank,
        vertex,
        tuple(Face(outer, holes) for outer, holes, _ in faces),
        np.array([number for *_, number in faces]),
    )


def _from_least(loop: Iterable[int], rank: np.ndarray) -> tuple[int, ...]:
    ranks = rank[list(loop)].tolist()
    start = ranks.index(min(ranks))
    return (*ranks[start:], *ranks[:start])


LEAST_STEPS = 16.0
"""Features nearer than this, in grid steps, cannot be told apart where snapping displaces vertices.

Four times the resolution. Measured: answers for small steps, slots, walls, bumps and pockets were those for the snapped
solid from 10 steps on, and wrong in places up to 9; real parts have no two features nearer than 120.
"""

EDGE_EDGE, VERTEX_EDGE, VERTEX_FACE = range(3)


class Nearest(NamedTuple):
    """The nearest pair of features.

    Attributes
    ----------
    steps : float
        Their distance in grid steps; infinite if no pair is nearer than asked for.
    kind : int
        EDGE_EDGE, VERTEX_EDGE or VERTEX_FACE.
    i, j : int
        Edge or vertex, and edge or triangle.
    n : int
        How many pairs are nearer than asked for.
    """

    steps: float
    kind: int = -1
    i: int = -1
    j: int = -1
    n: int = 0


def resolving_grid(solid: Solid, frame: np.ndarray) -> Grid:
    """Lay a grid over a solid that tells its features apart: the usual one, or else the finest.

    Raises
    ------
    ResolutionError
        If features are too near each other for both; the message tells where, how near, and the grid's step.
    """
    used = np.unique(solid.triangles)
    for finest in (False, True):
        grid = Grid.over(solid.vertices, frame, used, finest=finest)
        nearest = nearest_features(solid, grid.points) if grid.resolution else Nearest(np.inf)
        if not nearest.n:
            return grid
    raise ResolutionError(_complaint(solid, grid, nearest))


def nearest_features(solid: Solid, points: np.ndarray, within: float = LEAST_STEPS) -> Nearest:
    """Return the nearest two features of a solid that do not meet and are nearer than `within`.

    Parameters
    ----------
    solid : Solid
    points : ndarray, shape (n, 3)
        Places of its vertices in grid steps.
    within : float
        Distance in grid steps.
    """
    shape = _Shape(solid)
    points = np.asarray(points, float)
    vertices, edges, triangles = (_Boxes(points[corners], within) for corners in shape.corners)
    vertex_by_edge = vertices.meeting(edges)
    vertex_by_triangle = vertices.meeting(triangles)
    pairs = {
        EDGE_EDGE: shape.edges_apart(*edges.meeting(edges)),
        VERTEX_EDGE: (shape.used[vertex_by_edge[0]], vertex_by_edge[1]),
        VERTEX_FACE: shape.off_the_face(shape.used[vertex_by_triangle[0]], vertex_by_triangle[1]),
    }
    best = Nearest(np.inf)
    n = 0
    for kind, (i, j) in pairs.items():
        distance = shape.distance(kind, points, i, j)
        near = np.flatnonzero(distance < within)
        n += len(near)
        if len(near) and distance[near].min() < best.steps:
            first = near[np.argmin(distance[near])]
            best = Nearest(float(distance[first]), kind, int(i[first]), int(j[first]))
    return best._replace(n=n)


class _Boxes:
    """Bounding boxes of features, grown by half the distance looked for."""

    def __init__(self, corners: np.ndarray, within: float) -> None:
        self.low = corners.min(axis=1) - 0.5 * within
        self.high = corners.max(axis=1) + 0.5 * within
        self.shapes = shapely.box(self.low[:, 0], self.low[:, 1], self.high[:, 0], self.high[:, 1])

    def meeting(self, other: _Boxes) -> tuple[np.ndarray, np.ndarray]:
        """Return the pairs of own and other boxes that meet."""
        boxes, others = shapely.STRtree(other.shapes).query(self.shapes)
        keep = (self.low[boxes, 2] <= other.high[others, 2]) & (
            self.high[boxes, 2] >= other.low[others, 2]
        )
        return boxes[keep], others[keep]


class _Shape:
    """Features of a solid, their pairs and distances."""

    def __init__(self, solid: Solid) -> None:
        self.solid = solid
        self.ends = np.array([edge.vertices for edge in solid.edges])
        self.used = np.unique(self.ends)
        self.corners = self.used[:, None], self.ends, solid.triangles

    def edges_apart(self, i: np.ndarray, j: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Of pairs of edges, keep those without a common vertex, each once."""
        keep = (i < j) & (self.ends[i][:, :, None] != self.ends[j][:, None, :]).all(axis=(1, 2))
        return i[keep], j[keep]

    def off_the_face(
        self, vertex: np.ndarray, triangle: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Of pairs of vertex and triangle, keep those whose vertex is none of the triangle's face."""
        member = {
            (v, f) for f, face in enumerate(self.solid.faces) for loop in face.loops for v in loop
        }
        pairs = zip(vertex.tolist(), self.solid.triangle_face[triangle].tolist(), strict=True)
        keep = np.fromiter((pair not in member for pair in pairs), bool, len(vertex))
        return vertex[keep], triangle[keep]

    def distance(self, kind: int, at: np.ndarray, i: np.ndarray, j: np.ndarray) -> np.ndarray:
        """Return the distances of pairs, vertices being at (n, 3) places."""
        if kind == EDGE_EDGE:
            return segment_distance(*(at[self.ends[edge, k]] for edge in (i, j) for k in (0, 1)))
        if kind == VERTEX_EDGE:
            start = at[self.ends[j, 0]]
            end = at[self.ends[j, 1]]
            is_end = (self.ends[j] == i[:, None]).any(axis=1)
            return np.where(
                is_end,
                np.linalg.norm(end - start, axis=1),
                segment_distance(at[i], at[i], start, end),
            )
        corners = at[self.solid.triangles[j]]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
        height = np.abs(np.einsum("ij,ij->i", at[i] - corners[:, 0], normals))
        return np.where((side_distances(at[i], corners, normals) >= 0).all(axis=1), height, np.inf)

    def describe(self, nearest: Nearest) -> tuple[str, str]:
        """Return the two features of a pair in words."""
        at = self.solid.vertices
        i = nearest.i
        j = nearest.j
        feature = (
            describe_edge(at, *self.ends[i])
            if nearest.kind == EDGE_EDGE
            else f"vertex {describe_point(at[i])}"
        )
        if nearest.kind == VERTEX_FACE:
            return feature, f"face {self.solid.triangle_face[j]}"
        return feature, describe_edge(at, *self.ends[j])

    def are_of_two_shells(self, nearest: Nearest) -> bool:
        """Whether the features of a pair belong to different pieces of surface."""
        shell = np.empty(len(self.solid.vertices), int)
        shell[self.solid.triangles] = self.solid.face_shell[self.solid.triangle_face][:, None]
        vertex = self.ends[nearest.i, 0] if nearest.kind == EDGE_EDGE else nearest.i
        other = (
            self.solid.triangles[nearest.j, 0]
            if nearest.kind == VERTEX_FACE
            else self.ends[nearest.j, 0]
        )
        return bool(shell[vertex] != shell[other])


def _complaint(solid: Solid, grid: Grid, nearest: Nearest) -> str:
    """What is too near to what, how near it was given, and what can be done."""
    shape = _Shape(solid)
    distance_mm = shape.distance(
        nearest.kind, solid.vertices, np.array([nearest.i]), np.array([nearest.j])
    )[0]
    feature, other = shape.describe(nearest)
    more = f" ({nearest.n} such pairs)" if nearest.n > 1 else ""
    cure = "leave the detail out, or make it larger"
    if shape.are_of_two_shells(nearest):
        cure = "merge the solids in the CAD model, leave one out, or widen the gap"
    steps = " x ".join(dict.fromkeys(f"{step:.3g}" for step in grid.steps_mm))
    return (
        f"parts of the surface must be at least {LEAST_STEPS:g} grid steps of {steps} mm apart. "
        f"Got {distance_mm:.3g} mm between {feature} and {other}{more}; {cure}."
    )
