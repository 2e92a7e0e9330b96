"""Known solids and cut boxes shared by the tests: each function returns a new one."""

from __future__ import annotations

import itertools
import math
from itertools import product

import numpy as np

from aspectgraph import Solid
from aspectgraph.cells.arrays import CROSSED, add_box, allocate
from aspectgraph.cells.split import cell_side, leaves, split_cell

# Known solids shared by the tests: each function returns a new Solid, each *_ENTITIES names edges
# by end points.


L_PROFILE = [(0, 0), (3, 0), (3, 1), (1, 1), (1, 2), (0, 2)]
SLOT_PROFILE = [
    (0, 0),
    (10, 0),
    (10, 1),
    (8, 1),
    (8, 3),
    (6, 3),
    (6, 2),
    (4, 2),
    (4, 3),
    (2, 3),
    (2, 1),
    (0, 1),
]


class FaceBuilder:
    """Collects faces given by coordinates."""

    def __init__(self):
        self.index: dict[tuple[float, ...], int] = {}
        self.faces: list = []

    def loop(self, points) -> list[int]:
        return [self.index.setdefault(tuple(float(c) for c in p), len(self.index)) for p in points]

    def add(self, points, holes=()):
        self.faces.append((self.loop(points), [self.loop(hole) for hole in holes]))

    def solid(self, name: str) -> Solid:
        return Solid(list(self.index), self.faces, name=name)


def prism_faces(profile, height, holes=(), base=0.0) -> FaceBuilder:
    """Faces of a prism: profile counter-clockwise, holes clockwise, in the xy plane."""
    builder = FaceBuilder()
    add_prism(builder, profile, height, holes, base)
    return builder


def add_prism(builder: FaceBuilder, profile, height, holes=(), base=0.0) -> None:
    def at(points, z):
        return [(x, y, z) for x, y in points]

    top = base + height
    builder.add(at(profile[::-1], base), [at(hole[::-1], base) for hole in holes])
    builder.add(at(profile, top), [at(hole, top) for hole in holes])
    for ring in (profile, *holes):
        for (x0, y0), (x1, y1) in zip(ring, [*ring[1:], ring[0]], strict=True):
            builder.add([(x0, y0, base), (x1, y1, base), (x1, y1, top), (x0, y0, top)])


def prism(profile, height, holes=(), name="prism") -> Solid:
    """Prism along z; holes go right through."""
    return prism_faces(
        [tuple(p) for p in profile], height, [[tuple(p) for p in hole] for hole in holes]
    ).solid(name)


def ring(radius, n, centre=(0.0, 0.0), clockwise=False):
    """Corners of a regular polygon."""
    angles = 2 * np.pi * np.arange(n) / n
    points = [(centre[0] + radius * np.cos(a), centre[1] + radius * np.sin(a)) for a in angles]
    return points[::-1] if clockwise else points


def box_with_pockets(size, pockets=(), name="box") -> Solid:
    """Box from the origin to `size` with pockets ``(axis, u0, u1, v0, v1, depth)`` in its upper faces.

    u and v are the next axes in turn: pockets in the face x = size[0] are given by y and z, and so on.
    """
    builder = FaceBuilder()
    for axis in range(3):
        u = (axis + 1) % 3
        v = (axis + 2) % 3

        def point(a, b, c, axis=axis, u=u, v=v):
            p = [0.0, 0.0, 0.0]
            p[axis] = a
            p[u] = b
            p[v] = c
            return tuple(p)

        def square(a, u0, u1, v0, v1, point=point):
            return [point(a, u0, v0), point(a, u1, v0), point(a, u1, v1), point(a, u0, v1)]

        top = size[axis]
        mine = [pocket[1:] for pocket in pockets if pocket[0] == axis]
        builder.add(square(0, 0, size[u], 0, size[v])[::-1])
        builder.add(
            square(top, 0, size[u], 0, size[v]), [square(top, *pocket[:4])[::-1] for pocket in mine]
        )
        for *rim, depth in mine:
            high = square(top, *rim)
            low = square(top - depth, *rim)
            builder.add(low)
            for k in range(4):
                m = (k + 1) % 4
                builder.add([high[k], high[m], low[m], low[k]])
    return builder.solid(name)


def plain_box(size) -> Solid:
    """Box from the origin, its faces at x = 0, x = size, y = 0 and so on, in this order."""
    corners = list(product(*((0, side) for side in size)))
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return Solid(corners, faces, name="box")


def cube(side=2.0) -> Solid:
    return box_with_pockets((side, side, side), name="cube")


def l_block(profile=L_PROFILE, height=2.0) -> Solid:
    return prism(profile, height, name="L-block")


def slotted_block() -> Solid:
    """Reconstruction of the paper's first example; its drawing carries no dimensions."""
    return prism(SLOT_PROFILE, 6.0, name="slotted block")


def two_pocket_block() -> Solid:
    """Reconstruction of the paper's second example; its drawing carries no dimensions."""
    return box_with_pockets(
        (6, 6, 4), [(0, 2, 4, 1, 3, 1), (1, 1, 3, 2, 4, 1)], name="two-pocket block"
    )


def plate(n: int) -> Solid:
    """Plate with n x n pockets, 2 x 2 and 2 deep, in a 3 mm grid."""
    starts = [1 + 3 * i for i in range(n)]
    pockets = [(2, x, x + 2, y, y + 2, 2) for x in starts for y in starts]
    return box_with_pockets((3 * n + 1, 3 * n + 1, 3), pockets, name=f"plate {n}x{n}")


def plate_entities(n: int, count: int) -> dict:
    """The first `count` entities of ``plate(n)``: two floor edges that meet, pocket by pocket."""
    entities = {}
    for k in range(n * n):
        x = 1 + 3 * (k // n)
        y = 1 + 3 * (k % n)
        corner = (x, y, 1)
        entities[f"e{2 * k + 1}"] = (corner, (x + 2, y, 1))
        entities[f"e{2 * k + 2}"] = (corner, (x, y + 2, 1))
    return dict(list(entities.items())[:count])


def two_boxes(gap=1.0) -> Solid:
    """Two disjoint cubes beside each other."""
    builder = FaceBuilder()
    for x in (0.0, 2.0 + gap):
        add_prism(builder, [(x, 0), (x + 2, 0), (x + 2, 2), (x, 2)], 2.0)
    return builder.solid("two boxes")


def hollow_box() -> Solid:
    """A 4 mm cube with a closed void of 2 mm."""
    builder = prism_faces([(0, 0), (4, 0), (4, 4), (0, 4)], 4.0)
    outside = builder.faces
    builder.faces = []
    add_prism(builder, [(1, 1), (3, 1), (3, 3), (1, 3)], 2.0, base=1.0)
    inside = [(outer[::-1], [hole[::-1] for hole in holes]) for outer, holes in builder.faces]
    builder.faces = outside + inside
    return builder.solid("hollow box")


def all_edges(solid: Solid) -> dict:
    """Every straight edge, named by its id."""
    return {f"e{edge.id}": edge.id for edge in solid.straight_edges()}


STEP_ENTITIES = {
    "e1": ((1, 1, 0), (1, 1, 2)),
    "e2": ((1, 1, 0), (1, 2, 0)),
    "e3": ((1, 1, 2), (1, 2, 2)),
    "e4": ((1, 2, 0), (1, 2, 2)),
    "e5": ((1, 1, 0), (3, 1, 0)),
    "e6": ((1, 1, 2), (3, 1, 2)),
    "e7": ((3, 1, 0), (3, 1, 2)),
}
"""The seven edges of the two faces of the L-block's step."""

SLOT_ENTITIES = {
    "e1": ((6, 2, 0), (6, 2, 6)),
    "e2": ((4, 2, 0), (4, 2, 6)),
    "e3": ((8, 1, 0), (8, 1, 6)),
    "e4": ((2, 1, 0), (2, 1, 6)),
}

SLOT_LISTS = [{"e1", "e2"}, {"e2"}, {"e1"}, {"e2", "e3"}, {"e3"}, {"e1", "e4"}, {"e4"}, set()]
"""Table I of the paper."""

TWO_POCKET_ENTITIES = {
    "e1": ((6, 2, 1), (6, 4, 1)),
    "e2": ((6, 2, 1), (6, 2, 3)),
    "e3": ((6, 2, 1), (5, 2, 1)),
    "e4": ((2, 6, 1), (4, 6, 1)),
    "e5": ((2, 6, 1), (2, 6, 3)),
    "e6": ((2, 6, 1), (2, 5, 1)),
}

TWO_POCKET_LISTS = [
    {"e1", "e2", "e3"},
    {"e1", "e2"},
    {"e4", "e5", "e6"},
    {"e4", "e5"},
    {"e1", "e2", "e4", "e5"},
    {"e1", "e2", "e3", "e4", "e5", "e6"},
    {"e1", "e2", "e4", "e5", "e6"},
    {"e1", "e2", "e3", "e4", "e5"},
    set(),
]
"""Table II of the paper."""


# A block of 40 × 30 × 20 mm with a round hole of radius 5 mm, as a mesh knows it.


HOLE_CHORDS = 32


def drilled_block():
    return with_hole([(5.0, 0.0), (5.0, 20.0)])


def countersunk_block():
    """Above 14 mm, the hole widens by 45°, to a radius of 11 mm."""
    return with_hole([(5.0, 0.0), (5.0, 14.0), (11.0, 20.0)])


def with_hole(rings):
    """A block whose hole has these radii at these heights, from the lowest."""
    outline = [(0.0, 0.0), (40.0, 0.0), (40.0, 30.0), (0.0, 30.0)]
    angles = -2 * math.pi * np.arange(HOLE_CHORDS) / HOLE_CHORDS
    vertices = [(*p, z) for z in (0.0, 20.0) for p in outline]
    loops = [list(range(4)), list(range(4, 8))]
    holes = []
    for radius, z in rings:
        holes.append([len(vertices) + i for i in range(HOLE_CHORDS)])
        vertices += [(20 + radius * math.cos(a), 15 + radius * math.sin(a), z) for a in angles]
    faces = [(loops[1], [holes[-1]]), (loops[0][::-1], [holes[0][::-1]])]
    for bottom, top in [tuple(loops), *itertools.pairwise(holes)]:
        n = len(bottom)
        for i in range(n):
            j = (i + 1) % n
            faces.append([bottom[i], bottom[j], top[j], top[i]])
    return Solid(np.array(vertices), faces, name="block")


# Boxes cut by random planes.


HALF = 1000


def random_planes(n, seed, degenerate=False):
    rng = np.random.default_rng(seed)
    if degenerate:
        normals = rng.integers(-1, 2, (4 * n, 3))
        normals = normals[normals.any(axis=1)][:n]
        return np.column_stack([normals, rng.integers(-1, 2, len(normals)) * 300])
    points = rng.integers(-HALF, HALF, (n, 3, 3))
    normals = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
    return np.column_stack([normals, (normals * points[:, 0]).sum(axis=1)])


def cut_box(planes, n_cells=4096):
    box = np.zeros((6, 4), np.int64)
    for axis, side in itertools.product(range(3), range(2)):
        box[2 * axis + side, axis] = 1
        box[2 * axis + side, 3] = HALF * (2 * side - 1)
    cx = allocate(np.concatenate([box, planes]).astype(np.int64), n_cells)
    add_box(cx, np.arange(6))
    for h in range(6, 6 + len(planes)):
        for c in leaves(cx):
            if cell_side(cx, c, h) == CROSSED:
                split_cell(cx, c, h)
    return cx
