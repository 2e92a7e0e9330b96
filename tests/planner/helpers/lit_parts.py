"""Parts to be lit: the block of the hand-made plans, a step, and a bore."""

from itertools import product

import numpy as np

from aspectgraph import Solid

QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
# of the step
RIM = {"rim": [[30.0, 0, 10], [30.0, 40, 10]]}


def block():
    """The part of the hand-made plans."""
    return Solid(list(product((0.0, 80), (0.0, 50), (0.0, 60))), QUADS, name="block")


def step():
    """Two flat floors, z = 10 for x < 30 and z = 0 beyond, both seen from above."""
    outline = [(0, -5), (60, -5), (60, 0), (30, 0), (30, 10), (0, 10)]
    n = len(outline)
    vertices = [(x, y, z) for y in (0.0, 40.0) for x, z in outline]
    sides = [(k, (k + 1) % n, n + (k + 1) % n, n + k) for k in range(n)]
    return Solid(
        vertices,
        [tuple(range(n)), tuple(range(2 * n - 1, n - 1, -1)), *[q[::-1] for q in sides]],
        name="step",
    )


def bore(radius, depth, n=48):
    """A wide block with a round blind bore from z = 0 down around the origin; the edges of its rim come first."""
    angles = -2 * np.pi * np.arange(n) / n
    ring = np.column_stack([radius * np.cos(angles), radius * np.sin(angles)])
    corners = 30 * radius * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    vertices = [(*p, z) for z in (-3 * depth, 0.0) for p in corners]
    vertices += [(*p, z) for z in (0.0, -depth) for p in ring]
    low, top, rim, floor = np.split(np.arange(8 + 2 * n), [4, 8, 8 + n])
    low, top, rim, floor = (loop.tolist() for loop in (low, top, rim, floor))
    faces = [(top, [rim]), low[::-1], floor[::-1]]
    for a, b in ((low, top), (floor, rim)):
        m = len(a)
        faces += [[a[i], a[(i + 1) % m], b[(i + 1) % m], b[i]] for i in range(m)]
    return Solid(np.array(vertices), faces, name="bore")
