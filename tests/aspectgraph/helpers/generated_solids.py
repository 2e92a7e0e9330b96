"""Seeded solids with integer vertices and exactly planar faces, and the solids whose graphs are known.

Every solid is a `Part`: plain data, from which a test builds `aspectgraph.Solid(part.vertices, part.faces)`.
"""

from __future__ import annotations

from collections import Counter
from itertools import pairwise, product
from math import atan2, gcd
from typing import NamedTuple

import numpy as np
from solids import L_PROFILE, SLOT_PROFILE


class Part(NamedTuple):
    """A solid as plain data: integer vertices, faces as (outer loop, (hole, ...))."""

    name: str
    vertices: tuple[tuple[int, int, int], ...]
    faces: tuple[tuple[tuple[int, ...], tuple[tuple[int, ...], ...]], ...]

    def edges(self) -> list[tuple[int, int]]:
        """Return all edges as sorted vertex pairs."""
        loops = [loop for outer, holes in self.faces for loop in (outer, *holes)]
        return sorted({tuple(sorted(e)) for loop in loops for e in pairwise((*loop, loop[0]))})

    def edge_between(self, p, q) -> tuple[int, int]:
        """Return the vertex pair of the edge with end points p, q."""
        pair = (self.vertices.index(tuple(p)), self.vertices.index(tuple(q)))
        if tuple(sorted(pair)) not in self.edges():
            raise ValueError(f"{p}, {q} must be the ends of an edge.")
        return pair

    def mapped(self, matrix, name: str) -> Part:
        """Return the image under an integer matrix of positive determinant."""
        vertices = (np.array(self.vertices) @ np.array(matrix).T).tolist()
        return Part(name, tuple(map(tuple, vertices)), self.faces)


# ------------------------------------------------------------------------------------------------------ prisms


def prism(profile, height: int, name: str = "prism") -> Part:
    """Return the prism over a counter-clockwise profile, from z = 0 to z = height."""
    n = len(profile)
    vertices = [(x, y, 0) for x, y in profile] + [(x, y, height) for x, y in profile]
    faces = [(tuple(reversed(range(n))), ()), (tuple(range(n, 2 * n)), ())]
    faces += [((i, (i + 1) % n, n + (i + 1) % n, n + i), ()) for i in range(n)]
    return Part(name, tuple(vertices), tuple(faces))


def pyramid(profile, apex, name: str = "pyramid") -> Part:
    """Return the pyramid over a profile at z = 0; the profile must be star-shaped about the apex's foot."""
    n = len(profile)
    vertices = (*((x, y, 0) for x, y in profile), tuple(apex))
    return Part(
        name,
        vertices,
        ((tuple(reversed(range(n))), ()), *(((i, (i + 1) % n, n), ()) for i in range(n))),
    )


def block_with_pocket(profile, half: int, height: int, depth: int, name: str = "pocket") -> Part:
    """Return a block |x|, |y| ≤ half, 0 ≤ z ≤ height, with a pocket (depth > 0) or boss (depth < 0) on its top."""
    corners = [(-half, -half), (half, -half), (half, half), (-half, half)]
    block = prism(corners, height)
    n = len(profile)
    rim = tuple(range(8, 8 + n))
    vertices = (
        *block.vertices,
        *((x, y, height) for x, y in profile),
        *((x, y, height - depth) for x, y in profile),
    )
    walls = [((8 + i, 8 + (i + 1) % n, 8 + n + (i + 1) % n, 8 + n + i), ()) for i in range(n)]
    floor = (tuple(range(8 + n, 8 + 2 * n)), ())
    faces = [
        block.faces[0],
        (block.faces[1][0], (tuple(reversed(rim)),)),
        *block.faces[2:],
        *walls,
        floor,
    ]
    return Part(name, vertices, tuple(faces))


def star_profile(rng: np.random.Generator, n: int, radius: int):
    """Return a simple counter-clockwise integer polygon, star-shaped about the origin and strictly around it."""
    while True:
        points = {tuple(p) for p in rng.integers(-radius, radius + 1, (n, 2)).tolist()} - {(0, 0)}
        rays: dict[tuple[int, int], tuple[int, int]] = {}
        for x, y in sorted(points):
            rays[x // gcd(x, y), y // gcd(x, y)] = (x, y)
        profile = sorted(rays.values(), key=lambda p: atan2(p[1], p[0]))
        turns = [p[0] * q[1] - p[1] * q[0] for p, q in pairwise((*profile, profile[0]))]
        if len(profile) >= 3 and min(turns) > 0:
            return profile


def comb_profile(rng: np.random.Generator, n: int):
    """Return an axis-parallel profile with a random height over each of n columns: steps and slots."""
    x = np.cumsum([0, *rng.integers(1, 4, n)]).tolist()
    y = rng.integers(1, 6, n).tolist()
    top = [corner for i in reversed(range(n)) for corner in ((x[i + 1], y[i]), (x[i], y[i]))]
    profile = [(x[0], 0), (x[-1], 0), *top]
    return [
        p
        for before, p, after in zip(
            (profile[-1], *profile[:-1]), profile, (*profile[1:], profile[0]), strict=True
        )
        if (p[0] - before[0]) * (after[1] - p[1]) != (p[1] - before[1]) * (after[0] - p[0])
    ]


# ------------------------------------------------------------------------------- solids made of rectangular cells


def cell_solid(full: np.ndarray, ticks, name: str = "cells") -> Part | None:
    """Return the union of the full boxes of a rectangular grid, coplanar faces joined; None if it is no manifold.

    Parameters
    ----------
    full : ndarray of bool, shape (nx, ny, nz)
        Which boxes are material.
    ticks : three increasing sequences of int
        The grid planes, nx + 1, ny + 1 and nz + 1 of them.
    """
    full = np.pad(full, 1)
    corners = list(product(*(range(n) for n in np.array(full.shape) - 1)))
    octants = {c: full[c[0] : c[0] + 2, c[1] : c[1] + 2, c[2] : c[2] + 2] for c in corners}
    if not all(_is_manifold(block) for block in octants.values()) or _count_pieces(~full) != 1:
        return None
    vertices = [
        c
        for c, block in octants.items()
        if not any((block == np.flip(block, k)).all() for k in range(3))
    ]
    number = {c: i for i, c in enumerate(vertices)}
    faces = []
    for axis, outward in product(range(3), (1, -1)):
        for level in range(full.shape[axis] - 1):
            here = np.take(full, level, axis)
            there = np.take(full, level + 1, axis)
            mask = (here & ~there) if outward > 0 else (there & ~here)
            for piece in _pieces(mask):
                loops = [
                    _corner_loop(loop, axis, level, outward, number) for loop in _outlines(piece)
                ]
                loops.sort(key=lambda loop: -_extent(loop, vertices))
                faces.append((loops[0], tuple(loops[1:])))
    places = tuple(tuple(ticks[k][c[k]] for k in range(3)) for c in vertices)
    return Part(name, places, tuple(faces))


def _is_manifold(block: np.ndarray) -> bool:
    """Return whether material and air each form one piece around a grid corner (2, 2, 2), and along its edges."""
    sides = [np.take(block, level, axis) for axis in range(3) for level in (0, 1)]
    diagonal = any(s[0, 0] == s[1, 1] and s[0, 1] == s[1, 0] and s[0, 0] != s[0, 1] for s in sides)
    touching = any(
        mask[0, 0] == mask[1, 1] and mask[0, 1] == mask[1, 0] and mask[0, 0] != mask[0, 1]
        for axis in range(3)
        for a, b in [(np.take(block, 0, axis), np.take(block, 1, axis))]
        for mask in (a & ~b, b & ~a)
    )
    return (
        not diagonal and not touching and _count_pieces(block) <= 1 and _count_pieces(~block) <= 1
    )


def _pieces(mask: np.ndarray) -> list[set[tuple[int, ...]]]:
    """Return the connected pieces of the true cells, neighbours across sides."""
    left = set(map(tuple, np.argwhere(mask).tolist()))
    pieces = []
    while left:
        stack = [left.pop()]
        piece = set(stack)
        while stack:
            cell = stack.pop()
            for axis, step in product(range(len(cell)), (1, -1)):
                near = (*cell[:axis], cell[axis] + step, *cell[axis + 1 :])
                if near in left:
                    left.remove(near)
                    piece.add(near)
                    stack.append(near)
        pieces.append(piece)
    return sorted(pieces, key=min)


def _count_pieces(mask: np.ndarray) -> int:
    return len(_pieces(mask))


def _outlines(piece: set) -> list[list[tuple[int, int]]]:
    """Return the boundary loops of a set of unit squares, squares on the left; (i, j) also names the low corner."""
    step = {}
    for i, j in piece:
        square = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)]
        for (p, q), near in zip(
            pairwise((*square, square[0])),
            [(i, j - 1), (i + 1, j), (i, j + 1), (i - 1, j)],
            strict=True,
        ):
            if near not in piece:
                step[p] = q
    loops = []
    while step:
        loop = [min(step)]
        while loop[-1] in step:
            loop.append(step.pop(loop[-1]))
        loops.append(loop[:-1])
    return loops


def _corner_loop(loop, axis, level, outward, number) -> tuple[int, ...]:
    """Return the solid's vertex numbers along an outline in the grid plane `level` of `axis`."""
    corners = []
    for u, w in loop:
        corner = [u - 1, w - 1]
        corner.insert(axis, level)
        corners.append(tuple(corner))
    forward = (outward > 0) == (axis != 1)
    return tuple(number[c] for c in (corners if forward else reversed(corners)) if c in number)


def _extent(loop, vertices) -> int:
    points = np.array([vertices[i] for i in loop])
    return int(np.ptp(points, axis=0).sum())


def random_cell_solid(rng: np.random.Generator, shape, fill: float, name: str) -> Part:
    """Return a random manifold union of boxes."""
    while True:
        full = rng.random(shape) < fill
        ticks = [np.cumsum([0, *rng.integers(1, 4, n)]).tolist() for n in shape]
        part = cell_solid(full, ticks, name) if full.any() else None
        if part is not None:
            return part


def carved_block(rng: np.random.Generator, cuts: int, name: str) -> Part:
    """Return a block with random pockets, slots and steps cut from its outside."""
    while True:
        shape = tuple(rng.integers(3, 6, 3))
        full = np.ones(shape, dtype=bool)
        for _ in range(cuts):
            low = rng.integers(0, shape)
            high = np.minimum(low + rng.integers(1, 3, 3), shape)
            axis = rng.integers(3)
            low[axis] = 0 if rng.random() < 0.5 else low[axis]
            high[axis] = shape[axis] if low[axis] else high[axis]
            full[low[0] : high[0], low[1] : high[1], low[2] : high[2]] = False
        ticks = [np.cumsum([0, *rng.integers(1, 4, n)]).tolist() for n in shape]
        part = cell_solid(full, ticks, name) if full.any() else None
        if part is not None:
            return part


def touching_union(rng: np.random.Generator, name: str) -> Part:
    """Return a union of two or three boxes, each touching the last along part of a plane."""
    while True:
        full = np.zeros((6, 6, 6), dtype=bool)
        low = rng.integers(1, 4, 3)
        size = rng.integers(1, 3, 3)
        for _ in range(rng.integers(2, 4)):
            full[tuple(slice(a, a + s) for a, s in zip(low, size, strict=True))] = True
            axis = rng.integers(3)
            new = rng.integers(1, 3, 3)
            shift = rng.integers(-1, 2, 3)
            shift[axis] = size[axis] if rng.random() < 0.5 else -new[axis]
            low = np.maximum(low + shift, 0)
            size = new
        part = cell_solid(
            full, [np.cumsum([0, *rng.integers(1, 4, 6)]).tolist() for _ in range(3)], name
        )
        if part is not None:
            return part


# ----------------------------------------------------------------------------------------------- images, series


def rotation(quaternion) -> np.ndarray:
    """Return the integer matrix that rotates by an integer quaternion and scales by its squared norm."""
    w, x, y, z = quaternion
    return np.array(
        [
            [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
        ]
    )


def _sheared(rng: np.random.Generator, part: Part, name: str) -> Part:
    while True:
        matrix = rng.integers(-2, 4, (3, 3))
        if round(np.linalg.det(matrix)) > 0:
            return part.mapped(matrix, name)


def generated_solid(seed: int) -> Part:
    """Return solid number `seed` of an endless series that runs through the families."""
    rng = np.random.default_rng(seed)
    family = seed % 10
    if family == 0:
        part = prism(
            star_profile(rng, int(rng.integers(4, 9)), 8), int(rng.integers(1, 9)), "star prism"
        )
    elif family == 1:
        part = prism(
            comb_profile(rng, int(rng.integers(2, 6))), int(rng.integers(1, 9)), "comb prism"
        )
    elif family == 2:
        part = pyramid(
            star_profile(rng, int(rng.integers(3, 8)), 8),
            (0, 0, int(rng.integers(2, 9))),
            "pyramid",
        )
    elif family == 3:
        part = block_with_pocket(
            star_profile(rng, 6, 5), 7, 6, int(rng.choice([1, 2, 4, -1, -3])), "block and pocket"
        )
    elif family == 4:
        part = random_cell_solid(rng, (3, 2, 2), 0.6, "cells")
    elif family in (5, 6):
        part = carved_block(rng, int(rng.integers(1, 4)), "carved block")
    elif family == 7:
        part = touching_union(rng, "touching union")
    elif family == 8:
        part = _sheared(
            rng, generated_solid(seed + 10_000 * 10 + 7 - int(rng.integers(0, 8))), "sheared"
        )
    else:
        quaternion = rng.permutation(
            [(1, 1, 0, 0), (2, 1, 0, 0), (1, 1, 1, 0), (1, 2, 0, 1)][rng.integers(4)]
        )
        part = generated_solid(seed + 20_000 * 10 - 2 - int(rng.integers(0, 7))).mapped(
            rotation(quaternion), "rotated"
        )
    return part._replace(name=f"{part.name} {seed}")


def check_part(part: Part) -> None:
    """Assert that each edge is traversed once in each direction, and that holes of faces run the other way."""
    loops = [loop for outer, holes in part.faces for loop in (outer, *holes)]
    uses = Counter(edge for loop in loops for edge in pairwise((*loop, loop[0])))
    assert max(uses.values()) == 1, part.name
    assert all((j, i) in uses for i, j in uses), part.name


# --------------------------------------------------------------------------------- solids whose graphs are known

CUBE = prism([(0, 0), (2, 0), (2, 2), (0, 2)], 2, "cube")
L_BLOCK = prism(L_PROFILE, 2, "L-block")
SLOTTED_BLOCK = prism(SLOT_PROFILE, 6, "slotted block")


def _two_pocket_block() -> Part:
    ticks = [[0, 2, 4, 5, 6], [0, 2, 4, 5, 6], [0, 1, 3, 4]]
    full = np.ones((4, 4, 3), dtype=bool)
    full[3, 1, 1] = full[1, 3, 1] = False
    return cell_solid(full, ticks, "two-pocket block")


TWO_POCKET_BLOCK = _two_pocket_block()


def pocket_plate(n: int) -> tuple[Part, list[tuple[int, int]]]:
    """Return a plate with n × n pockets 2 × 2 × 2 deep, 3 mm apart, and two floor edges of each pocket."""
    ticks = sorted([0, *(3 * i + 1 for i in range(n)), *(3 * i + 3 for i in range(n)), 3 * n + 1])
    full = np.ones((2 * n + 1, 2 * n + 1, 2), dtype=bool)
    full[1::2, 1::2, 1] = False
    part = cell_solid(full, [ticks, ticks, [0, 1, 3]], f"plate {n}x{n}")
    corners = [(3 * i + 1, 3 * j + 1) for i in range(n) for j in range(n)]
    floor = [[((x, y, 1), (x + 2, y, 1)), ((x, y, 1), (x, y + 2, 1))] for x, y in corners]
    return part, [part.edge_between(p, q) for pair in floor for p, q in pair]
