"""The referee: is the open sight triangle (v, a, b) disjoint from the interior of the solid S? In integers throughout.

Notation
--------
T    the open triangle (v, a, b); Π its plane; ab is an edge of S, a part of one, or a chain of collinear ones
F°   the relative interior of a face F (holes excluded); g° the open segment of an edge g
s_x  the value n·x − d of a point x against a face plane n·x = d, n outward
h_x  the value N·(x − a) of a point x against Π, N = (a − v) × (b − v)

Assumption: v lies on no face plane ("generic" below). v may lie on any other plane, partition planes included.

Theorem. For generic v outside S, T meets int S if and only if
  (1) T meets F° for some face F, or
  (2) some edge g lies in Π, T meets g°, and S is not, near g, a convex wedge that Π only touches along g
      (that is: not [g convex and v in front of exactly one of the two faces of g]).

Proof. As v is on no face plane and ab lies in a face plane, v, a, b are not collinear and Π is no face plane.
*If.* (1) At a point of T ∩ F° the plane Π crosses F's plane, so T has points just behind F°, in int S. (2) Near a
point of g°, S is a wedge bounded by two half-planes neither of which lies in Π, and Π contains g: the two directions of
Π away from g are u (towards v) and −u. u is inside a convex wedge iff v is behind both faces, −u iff v is in front of
both; at a re-entrant edge "or" replaces "and", so one of u, −u always is inside; at a flat edge (coplanar faces) too.
*Only if.* Let T meet int S. v is outside the closed set S, hence so are all points of T near v. T is connected and
stays so without any finite set of points, hence T minus (vertices of S, and points where an edge crosses Π) contains a
point y on the boundary of T ∩ int S. y lies on the boundary of S, on some F° — which is (1) — or on some g° with g in
Π, and then S has interior points in Π arbitrarily near y, so one of u, −u is inside: (2). ∎

Points inside S count as not observable. Whether v is inside is decided by the parity of faces above it.

The second program, :func:`observable_by_section`, shares none of this: it cuts T by every face plane and asks for one
inner point of each piece whether it is inside S.
"""

from __future__ import annotations

from copy import copy
from fractions import Fraction
from itertools import combinations, pairwise
from math import gcd

import numpy as np


def sign(x) -> int:
    """Return -1, 0 or 1."""
    return (x > 0) - (x < 0)


def cross(u, w):
    """Return the cross product of two triples of Python numbers."""
    return (u[1] * w[2] - u[2] * w[1], u[2] * w[0] - u[0] * w[2], u[0] * w[1] - u[1] * w[0])


def dot(u, w):
    """Return the dot product of two triples of Python numbers."""
    return u[0] * w[0] + u[1] * w[1] + u[2] * w[2]


def minus(u, w):
    """Return u − w."""
    return (u[0] - w[0], u[1] - w[1], u[2] - w[2])


def loop_edges(loop):
    """Return the directed edges of a loop of vertex indices."""
    return list(pairwise((*loop, loop[0])))


class ExactChecker:
    """Exact whole-edge observability for a solid with integer vertices after multiplication by `steps_per_mm`.

    Parameters
    ----------
    vertices : array_like, shape (n, 3)
        In mm; multiples of 1 / steps_per_mm.
    faces : sequence of (outer loop, [hole, ...])
        Exactly planar, counter-clockwise seen from outside.
    steps_per_mm : int
        Grid of the vertices and of every viewpoint asked for.
    """

    def __init__(self, vertices, faces, steps_per_mm: int = 1):
        self.steps_per_mm = steps_per_mm
        self.vertices = [tuple(row) for row in self._to_grid(vertices)]
        self.loops = [[tuple(outer), *map(tuple, holes)] for outer, holes in faces]
        self.planes = [self._plane(i) for i in range(len(self.loops))]
        self.edge_faces = self._pair_edges()
        self.convexity = {pair: self._convexity(pair) for pair in self.edge_faces}
        self.face_edges = [
            [edge for loop in loops for edge in loop_edges(loop)] for loops in self.loops
        ]

    @classmethod
    def of(cls, solid, steps_per_mm: int = 1) -> ExactChecker:
        """Return the checker of an `aspectgraph.Solid`."""
        return cls(solid.vertices, [(face.outer, face.holes) for face in solid.faces], steps_per_mm)

    def with_points(self, points) -> ExactChecker:
        """Return the same solid with further points on its edges, exact, in mm: segments may end there, too.

        The theorem asks ab to lie on an edge, not to be a whole one.
        """
        steps = [[Fraction(x) * self.steps_per_mm for x in point] for point in points]
        if any(x.denominator > 1 for point in steps for x in point):
            raise ValueError(f"points must be multiples of 1/{self.steps_per_mm} mm.")
        more = copy(self)
        more.vertices = [*self.vertices, *(tuple(map(int, point)) for point in steps)]
        return more

    def _to_grid(self, points) -> list[list[int]]:
        scaled = np.asarray(points, dtype=float) * self.steps_per_mm
        if (scaled != np.rint(scaled)).any() or np.abs(scaled).max(initial=0) > 2**52:
            raise ValueError(f"points must be multiples of 1/{self.steps_per_mm} mm.")
        return scaled.astype(np.int64).tolist()

    def _plane(self, face: int) -> tuple[tuple[int, int, int], int]:
        outer = [self.vertices[i] for i in self.loops[face][0]]
        normal = [0, 0, 0]
        for p, q in pairwise((*outer, outer[0])):
            normal = [m + c for m, c in zip(normal, cross(p, q), strict=True)]
        divisor = gcd(*normal)
        normal = tuple(m // divisor for m in normal)
        offset = dot(normal, outer[0])
        if any(dot(normal, self.vertices[i]) != offset for loop in self.loops[face] for i in loop):
            raise ValueError(f"face {face} must be exactly planar.")
        return normal, offset

    def _pair_edges(self) -> dict[tuple[int, int], tuple[int, int]]:
        side = {}
        for f, loops in enumerate(self.loops):
            for edge in (edge for loop in loops for edge in loop_edges(loop)):
                if edge in side:
                    raise ValueError(f"edge {edge} must be traversed once in each direction.")
                side[edge] = f
        return {(i, j): (f, side[j, i]) for (i, j), f in side.items() if i < j}

    def _convexity(self, pair) -> int:
        """Return 1 at a convex edge, -1 at a re-entrant one, 0 where the faces are coplanar."""
        left, right = (self.planes[f][0] for f in self.edge_faces[pair])
        return sign(dot(cross(left, right), minus(self.vertices[pair[1]], self.vertices[pair[0]])))

    # ------------------------------------------------------------------------------------------- the question

    def generic(self, points) -> np.ndarray:
        """Return which points lie on no face plane, bool, shape (n,)."""
        return (self._plane_values(self._exact_array(self._to_grid(points))) != 0).all(axis=1)

    def contains(self, points) -> np.ndarray:
        """Return which points lie inside S, bool, shape (n,). Points must be generic."""
        return np.array([self.contains_point(p) for p in self._to_grid(points)], dtype=bool)

    def observable(self, points, segments) -> np.ndarray:
        """Return whether each segment can be seen whole from each point.

        Parameters
        ----------
        points : array_like, shape (n, 3)
            In mm; multiples of 1 / steps_per_mm; on no face plane.
        segments : sequence of (int, int)
            Vertex indices of the end points.

        Returns
        -------
        ndarray of bool, shape (n, len(segments))
        """
        points = self._exact_array(self._to_grid(points))
        s_v = self._plane_values(points)
        if (s_v == 0).any():
            raise ValueError("viewpoints must lie on no face plane.")
        outside = np.array([not self.contains_point(p) for p in points.tolist()], dtype=bool)
        result = np.zeros((len(points), len(segments)), dtype=bool)
        for column, (a, b) in enumerate(segments):
            result[outside, column] = self._segment_observable(points[outside], s_v[outside], a, b)
        return result

    def _exact_array(self, points) -> np.ndarray:
        """Return points as int64 where no value formed below can overflow, else as Python integers."""
        largest = max(abs(c) for p in [*points, *self.vertices] for c in p)
        normals = max(abs(c) for normal, _ in self.planes for c in normal)
        fits = 48 * largest**3 < 2**63 and 6 * largest * normals < 2**63
        return np.array(points, dtype=np.int64 if fits else object).reshape(-1, 3)

    def _plane_values(self, points) -> np.ndarray:
        normals = np.array([normal for normal, _ in self.planes], dtype=points.dtype)
        offsets = np.array([offset for _, offset in self.planes], dtype=points.dtype)
        return points @ normals.T - offsets

    def _segment_observable(self, points, s_v, a, b) -> np.ndarray:
        """Return whether (v, a, b) misses int S for each row v of `points`, all outside S."""
        vertices = np.array(self.vertices, dtype=points.dtype)
        to_a = vertices[a] - points
        to_b = vertices[b] - points
        normal = np.stack(
            [to_a[:, i - 2] * to_b[:, i - 1] - to_a[:, i - 1] * to_b[:, i - 2] for i in range(3)],
            axis=1,
        )
        heights = normal @ (vertices - vertices[a]).T
        s_a, s_b = (
            np.array([dot(n, self.vertices[i]) - d for n, d in self.planes], dtype=object)
            for i in (a, b)
        )
        faces = self._faces_between(s_v, s_a, s_b, heights)
        flat = self._edges_in_plane(heights, a, b)
        visible = np.ones(len(points), dtype=bool)
        for row, (v, n, h, signs) in enumerate(
            zip(points.tolist(), normal.tolist(), heights.tolist(), s_v.tolist(), strict=True)
        ):
            ends = (v, self.vertices[a], self.vertices[b])
            visible[row] = not any(
                self._crosses(int(f), ends, (int(signs[f]), s_a[f], s_b[f]), n, h)
                for f in np.flatnonzero(faces[row])
            ) and not any(self._pierces(edge, ends, n, signs) for edge in flat.get(row, ()))
        return visible

    def _faces_between(self, s_v, s_a, s_b, heights) -> np.ndarray:
        """Return which faces T can meet: T on both sides of the face's plane, the face on both sides of Π."""
        ahead = (s_a > 0) | (s_b > 0)
        behind = (s_a < 0) | (s_b < 0)
        faces = np.where(s_v > 0, behind.astype(bool), ahead.astype(bool))
        for f, loops in enumerate(self.loops):
            h = heights[:, list(loops[0])]
            faces[:, f] &= (h > 0).any(axis=1) & (h < 0).any(axis=1)
        return faces

    def _edges_in_plane(self, heights, a, b) -> dict[int, list[tuple[int, int]]]:
        """Return for each row the edges of S that lie in Π but not on the line ab."""
        line = minus(self.vertices[b], self.vertices[a])
        on_line = [cross(minus(w, self.vertices[a]), line) == (0, 0, 0) for w in self.vertices]
        zero = heights == 0
        found: dict[int, list[tuple[int, int]]] = {}
        for i, j in self.edge_faces:
            if not (on_line[i] and on_line[j]):
                for row in np.flatnonzero(zero[:, i] & zero[:, j]):
                    found.setdefault(int(row), []).append((i, j))
        return found

    # ---------------------------------------------------------------------------------------- T against a face

    def _crosses(self, face, ends, s, n, h) -> bool:
        """Return whether T meets F°: clause (1).

        T ∩ plane(F) is an open segment of the line ℓ = Π ∩ plane(F), cut off by two sides of T. F° ∩ ℓ is a union of
        open intervals. Points of ℓ are named by one coordinate that varies along it.
        """
        along = cross(n, self.planes[face][0])
        axis = max(range(3), key=lambda k: abs(along[k]))
        cuts = {Fraction(ends[i][axis]) for i in (1, 2) if s[i] == 0}
        for i, j in combinations(range(3), 2):
            if s[i] * s[j] < 0:
                cuts.add(Fraction(ends[i][axis] * s[j] - ends[j][axis] * s[i], s[j] - s[i]))
        low = min(cuts)
        high = max(cuts)
        return any(max(low, t0) < min(high, t1) for t0, t1 in self._intervals(face, axis, h))

    def _intervals(self, face, axis, h):
        """Yield the open intervals of F° ∩ ℓ, up to finitely many points.

        A point of ℓ that is no vertex and no crossing is in F° iff the polygon is present just above *and* just below
        ℓ: where ℓ runs along an edge of F it is present on one side only. Present: an odd number of edges passed.
        """
        toggles: dict[Fraction, list[int]] = {}
        for i, j in self.face_edges[face]:
            above = (h[i] > 0) != (h[j] > 0)
            below = (h[i] < 0) != (h[j] < 0)
            if above or below:
                p = self.vertices[i][axis]
                q = self.vertices[j][axis]
                toggle = toggles.setdefault(Fraction(p * h[j] - q * h[i], h[j] - h[i]), [0, 0])
                toggle[0] ^= above
                toggle[1] ^= below
        up = down = 0
        for t0, t1 in pairwise(sorted(toggles)):
            up ^= toggles[t0][0]
            down ^= toggles[t0][1]
            if up and down:
                yield t0, t1

    def _pierces(self, pair, ends, n, signs) -> bool:
        """Return whether T meets g° for an edge g in Π across which S is more than touched: clause (2)."""
        left, right = self.edge_faces[pair]
        if self.convexity[pair] > 0 and sign(signs[left]) != sign(signs[right]):
            return False
        p, q = (self.vertices[i] for i in pair)
        low = Fraction(0)
        high = Fraction(1)
        for i in range(3):
            inward = cross(n, minus(ends[i - 1], ends[i - 2]))
            at_p, at_q = (dot(inward, minus(w, ends[i - 2])) for w in (p, q))
            if at_p <= 0 and at_q <= 0:
                return False
            if at_p < 0 or at_q < 0 or at_p == 0 or at_q == 0:
                root = Fraction(at_p, at_p - at_q)
                low, high = (max(low, root), high) if at_q > at_p else (low, min(high, root))
        return low < high

    def contains_point(self, v) -> bool:
        """Return whether a generic point (Python ints or Fractions) is inside S: odd number of faces straight above.

        The rule on the edges' projections is the limit of shifting v by (ε, ε², 0).
        """
        inside = False
        for (normal, offset), edges in zip(self.planes, self.face_edges, strict=True):
            if normal[2] and sign(dot(normal, v) - offset) == -sign(normal[2]):
                inside ^= self._projection_covers(edges, v)
        return inside

    def _projection_covers(self, edges, v) -> bool:
        odd = False
        for i, j in edges:
            p = self.vertices[i]
            q = self.vertices[j]
            if (p[1] > v[1]) != (q[1] > v[1]):
                side = (q[0] - p[0]) * (v[1] - p[1]) - (v[0] - p[0]) * (q[1] - p[1])
                odd ^= side != 0 and (side > 0) == (q[1] > p[1])
        return odd


def observable_by_section(checker: ExactChecker, v, a: int, b: int) -> bool:
    """Answer the same question slowly: cut T by all face planes; is an inner point of any piece inside S?

    Parameters
    ----------
    checker : ExactChecker
        Used for the planes and for the inside of S.
    v : tuple of 3 ints
        Viewpoint in grid steps.
    a, b : int
        Vertex indices of the end points.
    """
    if checker.contains_point(v):
        return False
    pieces = [[tuple(map(Fraction, p)) for p in (v, checker.vertices[a], checker.vertices[b])]]
    for normal, offset in set(checker.planes):
        sides = [(polygon, [dot(normal, p) - offset for p in polygon]) for polygon in pieces]
        pieces = [part for polygon, s in sides for part in _halves(polygon, s)]
    centres = [
        tuple(sum(c) / len(polygon) for c in zip(*polygon, strict=True)) for polygon in pieces
    ]
    return not any(checker.contains_point(c) for c in centres)


def _halves(polygon, s):
    """Yield the parts of a convex polygon where s > 0 and s < 0."""
    for side in (1, -1):
        if any(side * value > 0 for value in s):
            part = []
            for i, (p, value) in enumerate(zip(polygon, s, strict=True)):
                before = polygon[i - 1]
                other = s[i - 1]
                if value * other < 0:
                    t = other / (other - value)
                    part.append(tuple(x + t * (y - x) for x, y in zip(before, p, strict=True)))
                if side * value >= 0:
                    part.append(p)
            yield part
