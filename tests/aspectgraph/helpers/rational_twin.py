"""The aspect graph computed plainly, in rational arithmetic: the engine's twin and the referee's second opinion."""

from __future__ import annotations

from fractions import Fraction
from itertools import combinations, pairwise
from math import gcd, lcm
from typing import NamedTuple

from exact_checker import ExactChecker, cross, dot, minus

# Convex cells in plain rational arithmetic.
#
# Notation
# --------
# point   (x, y, z, w), w > 0: the rational point (x, y, z) / w. Integers without common factor, or Fractions and w = 1
# plane   (n0, n1, n2, d) integers: value at a point n·(x, y, z) − d·w, positive in front
# loop    corners of a convex polygon in order
# cell    list of (plane, loop): value ≤ 0 in the cell, loop counter-clockwise seen from outside


def reduced(numbers) -> tuple[int, ...]:
    """Return the integers divided by their greatest common divisor."""
    divisor = gcd(*numbers)
    return tuple(x // divisor for x in numbers)


def at(plane, point) -> int:
    """Return the value of a plane at a point (times the point's w)."""
    return plane[0] * point[0] + plane[1] * point[1] + plane[2] * point[2] - plane[3] * point[3]


def opposite(plane) -> tuple[int, ...]:
    """Return the same plane facing the other way."""
    return tuple(-x for x in plane)


def key(plane) -> tuple[int, ...]:
    """Return the plane facing the way that makes its first non-zero coefficient positive."""
    return max(plane, opposite(plane))


def between(p, value_p, q, value_q) -> tuple[int, ...]:
    """Return the point of pq where a plane with values of opposite sign at p and q vanishes."""
    a = abs(value_q)
    b = abs(value_p)
    numbers = [a * x + b * y for x, y in zip(p, q, strict=True)]
    return (
        tuple(x / numbers[3] for x in numbers) if isinstance(p[3], Fraction) else reduced(numbers)
    )


def through(p, q, r) -> tuple[int, ...] | None:
    """Return the plane through three points, or None if they are collinear."""
    normal = cross(difference(q, p), difference(r, p))
    if normal == (0, 0, 0):
        return None
    coefficients = [*(n * p[3] for n in normal), dot(normal, p)]
    common = lcm(*(Fraction(x).denominator for x in coefficients))
    return reduced([int(x * common) for x in coefficients])


def difference(q, p) -> tuple[int, int, int]:
    return tuple(x * p[3] - y * q[3] for x, y in zip(q[:3], p[:3], strict=True))


def clip(loop, plane) -> list | None:
    """Return the part of a convex polygon where value ≥ 0, or None if none of it has value > 0."""
    values = [at(plane, p) for p in loop]
    if max(values) <= 0:
        return None
    if min(values) >= 0:
        return loop
    part = []
    for i, (p, value) in enumerate(zip(loop, values, strict=True)):
        if value * values[i - 1] < 0:
            part.append(between(loop[i - 1], values[i - 1], p, value))
        if value >= 0:
            part.append(p)
    return part


# --------------------------------------------------------------------------------------------------------- cells


def box_cell(low, high, number=int) -> list:
    """Return the box between two integer corners as a cell, its points of the given kind of number."""
    corner = [
        (x, y, z, 1)
        for x in (low[0], high[0])
        for y in (low[1], high[1])
        for z in (low[2], high[2])
    ]
    corner = [tuple(map(number, p)) for p in corner]
    loops = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    planes = [
        (*(side * (k == axis) for k in range(3)), side * (low, high)[side > 0][axis])
        for axis in range(3)
        for side in (-1, 1)
    ]
    return [(plane, [corner[i] for i in loop]) for plane, loop in zip(planes, loops, strict=True)]


def split(cell, plane) -> tuple[list | None, list | None]:
    """Return the parts of a cell in front of a plane and behind it; None where there is no such part."""
    values = [at(plane, p) for _, loop in cell for p in loop]
    if max(values) <= 0:
        return None, cell
    if min(values) >= 0:
        return cell, None
    return half(cell, plane), half(cell, opposite(plane))


def half(cell, plane) -> list:
    """Return the part of a cell in front of a plane that cuts it."""
    part = []
    follows = {}
    for outward, loop in cell:
        kept = clip(loop, plane)
        if kept is not None:
            part.append((outward, kept))
            for p, q in pairwise((*kept, kept[0])):
                if at(plane, p) == 0 == at(plane, q):
                    follows[q] = p
    lid = [next(iter(follows))]
    while (corner := follows[lid[-1]]) != lid[0]:
        lid.append(corner)
    return [*part, (opposite(plane), lid)]


def cut_out(cell, obstacle) -> tuple[list | None, list]:
    """Return the part of a cell inside an obstacle (or None), and the parts outside."""
    corners = {p for _, loop in cell for p in loop}
    if any(max(at(plane, p) for p in corners) <= 0 for plane in obstacle):
        return None, [cell]
    inside = cell
    outside = []
    for plane in obstacle:
        inside, rest = split(inside, plane)
        if inside is None:
            return None, [cell]
        if rest is not None:
            outside.append(rest)
    return inside, outside


def volume(cell) -> Fraction:
    """Return the exact volume of a cell."""
    first = plain(cell[0][1][0])
    total = Fraction(0)
    for _, loop in cell:
        p, *rest = (minus(plain(corner), first) for corner in loop)
        total += sum(dot(p, cross(q, r)) for q, r in pairwise(rest))
    return total / 6


def plain(point) -> tuple[Fraction, Fraction, Fraction]:
    return tuple(Fraction(x, point[3]) for x in point[:3])


def centre(cell) -> tuple[Fraction, Fraction, Fraction]:
    """Return the mean of a cell's corners, an inner point."""
    corners = [plain(p) for p in {p for _, loop in cell for p in loop}]
    return tuple(sum(c) / len(corners) for c in zip(*corners, strict=True))


def overlaps(polygon, cell, shared=None) -> bool:
    """Return whether a polygon and a cell (but for its facet in the plane `shared`) have an area in common."""
    for outward, _ in cell:
        if outward != shared:
            polygon = clip(polygon, opposite(outward))
            if polygon is None:
                return False
    return True


# The aspect graph computed plainly, in rational arithmetic: the engine's twin and the reference
# of its speed.
#
# No simplification, no shared faces, no compiled code. Every entity's blocked sets are cut, one
# after the other, out of one growing list of convex cells; a blocked cell is not cut again for
# that entity, and a blocked set that misses a cell does not cut it. Then cells with equal lists
# that share a piece of facet are merged.
#
# An *obstacle* is a list of planes: the open convex set where all their values are positive. For
# points, planes and cells see `rational_twin`.
#
# For an occluder O (a convex piece of a face) with a, b in front of its plane, the blocked set B
# = {q + t(q − p) : q ∈ O, p ∈ ab, t ≥ 0} = O + cone(O − ab) is the intersection of half-spaces
# bounded by: the plane of O (behind it); planes through an edge of O and an end of ab, and planes
# through ab and a vertex of O, which have O on one side (≥ 0) and ab on the other (≤ 0). If the
# plane of O separates a from b, only the part of ab in front counts: a ray from the other part
# meets O from behind, and has left S through it. A front end on that plane adds no plane.


class TwinGraph(NamedTuple):
    """Domains: their lists, their cells, and the pairs of domains that share a piece of surface."""

    lists: list[frozenset[str]]
    cells: list[list]
    adjacencies: set[tuple[int, int]]

    @property
    def n_cells(self) -> int:
        """Number of convex cells before merging, without those inside the solid."""
        return sum(map(len, self.cells))

    def volumes(self) -> list[Fraction]:
        """Return the exact volume of every domain."""
        return [sum(map(volume, cells)) for cells in self.cells]


# ------------------------------------------------------------------------------------------------------ obstacles


def convex_pieces(solid: ExactChecker, face: int, box) -> list[list]:
    """Return convex polygons that make up a face, holes left out.

    The face's plane, as far as it lies in the box, is cut along the lines of the face's edges; a piece is cut only if
    the edge itself runs through it.
    """
    normal, offset = solid.planes[face]
    pieces = [half(box, (*normal, offset))[-1][1]]
    for i, j in solid.face_edges[face]:
        p = solid.vertices[i]
        q = solid.vertices[j]
        inward = cross(normal, minus(q, p))
        line = (*inward, dot(inward, p))
        pieces = [part for piece in pieces for part in _cut_along(piece, line, p, q)]
    return [piece for piece in pieces if _is_on_face(solid, face, piece)]


def _cut_along(piece, line, p, q) -> list[list]:
    values = [at(line, corner) for corner in piece]
    if max(values) <= 0 or min(values) >= 0:
        return [piece]
    part = clip(piece, line)
    axis = max(range(3), key=lambda k: abs(q[k] - p[k]))
    chord = sorted(Fraction(corner[axis], corner[3]) for corner in part if at(line, corner) == 0)
    if max(chord[0], min(p[axis], q[axis])) < min(chord[-1], max(p[axis], q[axis])):
        return [part, clip(piece, opposite(line))]
    return [piece]


def _is_on_face(solid: ExactChecker, face: int, piece) -> bool:
    """Return whether the middle of a piece lies on the face: an odd number of edges to one side of it."""
    points = [plain(p) for p in piece]
    middle = tuple(sum(c) / len(points) for c in zip(*points, strict=True))
    normal = solid.planes[face][0]
    drop = max(range(3), key=lambda k: abs(normal[k]))
    u, w = (k for k in range(3) if k != drop)
    odd = False
    for i, j in solid.face_edges[face]:
        p = solid.vertices[i]
        q = solid.vertices[j]
        if (p[w] > middle[w]) != (q[w] > middle[w]):
            side = (q[u] - p[u]) * (middle[w] - p[w]) - (middle[u] - p[u]) * (q[w] - p[w])
            odd ^= (side > 0) == (q[w] > p[w])
    return odd


def wedge_obstacles(solid: ExactChecker, pair) -> list[list]:
    """Return where an edge is hidden by its own two faces.

    Behind both at a convex edge, behind either at a re-entrant one.
    """
    pair = tuple(sorted(pair))
    behind = [
        opposite((*normal, d)) for normal, d in (solid.planes[f] for f in solid.edge_faces[pair])
    ]
    return [behind] if solid.convexity[pair] > 0 else [[plane] for plane in behind]


def blocked_set(piece, plane, a, b) -> list | None:
    """Return the obstacle behind a convex occluder for the segment ab, or None if no part of ab is in front of it."""
    s_a = at(plane, a)
    s_b = at(plane, b)
    if s_a <= 0 and s_b <= 0:
        return None
    if s_a < 0 or s_b < 0:
        cut = between(a, s_a, b, s_b)
        a, b = (cut, b) if s_a < 0 else (a, cut)
    candidates = [through(p, q, end) for p, q in pairwise((*piece, piece[0])) for end in (a, b)]
    candidates += [through(a, b, corner) for corner in piece]
    planes = {opposite(plane)}
    for candidate in filter(None, candidates):
        for side in (candidate, opposite(candidate)):
            if (
                min(at(side, p) for p in piece) == 0 < max(at(side, p) for p in piece)
                and max(at(side, a), at(side, b)) <= 0
            ):
                planes.add(side)
    return sorted(planes)


def entity_obstacles(solid: ExactChecker, pieces, path) -> list[list]:
    """Return the obstacles whose union is the region from which an entity cannot be seen whole.

    `path` are the vertex indices along the entity, two for a single edge.
    """
    a, b = ((*solid.vertices[i], 1) for i in (path[0], path[-1]))
    found = [obstacle for pair in pairwise(path) for obstacle in wedge_obstacles(solid, pair)]
    for (normal, offset), polygons in zip(solid.planes, pieces, strict=True):
        found += filter(
            None, (blocked_set(polygon, (*normal, offset), a, b) for polygon in polygons)
        )
    return found


# ---------------------------------------------------------------------------------------------------------- graph


def insert(labelled, obstacles, name):
    """Cut cells (list, cell) along an entity's obstacles and add its name to the list of those left free."""
    result = []
    for names, cell in labelled:
        free = [cell]
        for obstacle in obstacles:
            parts = [cut_out(part, obstacle) for part in free]
            result += [(names, inside) for inside, _ in parts if inside is not None]
            free = [part for _, outside in parts for part in outside]
        result += [(names | {name}, part) for part in free]
    return result


def outside_parts(solid: ExactChecker, pieces, cell) -> list:
    """Return the parts of a cell outside the solid, cut along the faces that run through it."""
    for (normal, offset), polygons in zip(solid.planes, pieces, strict=True):
        for polygon in polygons:
            if _runs_through(polygon, (*normal, offset), cell):
                parts = split(cell, (*normal, offset))
                return [piece for part in parts for piece in outside_parts(solid, pieces, part)]
    return [] if solid.contains_point(centre(cell)) else [cell]


def _runs_through(polygon, plane, cell) -> bool:
    values = [at(plane, p) for _, loop in cell for p in loop]
    return min(values) < 0 < max(values) and overlaps(polygon, cell)


def contacts(cells):
    """Yield the pairs of cells that share a piece of facet."""
    front = {}
    back = {}
    for i, cell in enumerate(cells):
        for plane, loop in cell:
            (front if plane == key(plane) else back).setdefault(key(plane), []).append(
                (i, loop, _bounds(loop))
            )
    for plane in front.keys() & back.keys():
        for i, loop, (low, high) in front[plane]:
            for j, _, (other_low, other_high) in back[plane]:
                near = all(
                    x <= y for x, y in zip((*low, *other_low), (*other_high, *high), strict=True)
                )
                if near and overlaps(loop, cells[j], opposite(plane)):
                    yield i, j


def _bounds(loop, margin=1e-6):
    """Return a box certainly around a polygon: floats, used only to skip pairs that are far apart."""
    columns = list(zip(*([c / p[3] for c in p[:3]] for p in loop), strict=True))
    return [min(c) - margin for c in columns], [max(c) + margin for c in columns]


def twin_graph(
    solid: ExactChecker, entities: dict[str, tuple[int, ...]], low, high, number=int
) -> TwinGraph:
    """Return the aspect graph of entities in a box.

    Parameters
    ----------
    solid : ExactChecker
        With one step per mm.
    entities : dict
        Name -> vertex indices along the entity, two for a single edge.
    low, high : tuple of 3 ints
        Corners of the workspace.
    number : {int, Fraction}
        Arithmetic of the points. The answer is the same; `Fraction` is the plain way, int several times as fast.
    """
    box = box_cell(low, high, number)
    pieces = [convex_pieces(solid, f, box) for f in range(len(solid.planes))]
    labelled = [(frozenset(), box)]
    for name, path in entities.items():
        labelled = insert(labelled, entity_obstacles(solid, pieces, path), name)
    # Inside the solid every entity is hidden, so only cells with the empty list need carving.
    carved = [
        (names, part)
        for names, cell in labelled
        for part in ([cell] if names else outside_parts(solid, pieces, cell))
    ]
    return merge([names for names, _ in carved], [cell for _, cell in carved])


def merge(labels, cells) -> TwinGraph:
    """Join touching cells of equal label into domains."""
    parent = list(range(len(cells)))

    def root(i):
        while parent[i] != i:
            parent[i] = i = parent[parent[i]]
        return i

    walls = []
    for i, j in contacts(cells):
        if labels[i] == labels[j]:
            parent[root(i)] = root(j)
        else:
            walls.append((i, j))
    members: dict[int, list] = {}
    for i, cell in enumerate(cells):
        members.setdefault(root(i), []).append(cell)
    number = {r: k for k, r in enumerate(members)}
    pairs = {tuple(sorted((number[root(i)], number[root(j)]))) for i, j in walls}
    return TwinGraph([labels[r] for r in members], list(members.values()), pairs)


def facets_by_brute_force(piece, a, b) -> set[tuple[int, ...]]:
    """Return all facet planes of O + cone(O − ab), value ≥ 0 inside, trying every three generators."""
    rays = [
        (*reduced(difference(o, end)), 0)
        for o in piece
        for end in (a, b)
        if difference(o, end) != (0, 0, 0)
    ]
    generators = [*piece, *rays]
    found = set()
    for three in combinations(generators, 3):
        plane = _homogeneous_plane(three)
        for side in (plane, opposite(plane)):
            values = [at(side, g) for g in generators]
            if any(side[:3]) and min(values) == 0 < max(values):
                found.add(side)
    return found


def _homogeneous_plane(three) -> tuple[int, ...]:
    """Return the plane through three points, some of them perhaps at infinity (w = 0); zeros if there is none."""
    minors = [[[row[k] for k in range(4) if k != skip] for row in three] for skip in range(4)]
    x, y, z, w = (dot(m[0], cross(m[1], m[2])) for m in minors)
    return reduced((x, -y, z, w)) if any((x, y, z, w)) else (0, 0, 0, 0)
