"""Boxes cut by random planes."""

import itertools

import numpy as np

from aspectgraph.cells.arrays import CROSSED, add_box, allocate
from aspectgraph.cells.split import cell_side, leaves, split_cell

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
