"""Crop a complex to the workspace.

Regions are computed in a cube along the grid's axes that is wide against any workspace (`Grid.cube_planes`), and cut to
the workspace at the end. So neither the turn nor the size of the workspace has a say in how the cells inside are cut.
"""

from __future__ import annotations

import numpy as np

from aspectgraph.cells.arrays import (
    CELL_CHILD,
    CROSSED,
    FACE_CHILD,
    FACE_PLANE,
    INSIDE,
    N_CELLS,
    N_FACES,
    NEGATIVE,
    POSITIVE,
    SIDES,
    Complex,
)
from aspectgraph.cells.split import cell_side, leaves, split_cell
from compiled.decorators import entry_kernel

N_LIMITS = 6


def crop(cx: Complex, first: int) -> None:
    """Cut cells along the planes first, …, first + 5 of a box; clear the labels outside and flag them as `INSIDE`.

    Parameters
    ----------
    cx : Complex
    first : int
        Number of the plane x_min; x_max, y_min, y_max, z_min, z_max follow, all with the same positive side.
    """
    _crop(cx, first, INSIDE)


@entry_kernel
def _crop(cx, first, flag):
    for leaf in leaves(cx):
        c = leaf
        for h in range(first, first + N_LIMITS):
            inner = (h - first) % 2
            place = cell_side(cx, c, h)
            if (place == POSITIVE) if inner == 0 else (place == NEGATIVE):
                continue
            outer = c
            if place == CROSSED:
                split_cell(cx, c, h)
                outer = np.int64(cx.cell[c, CELL_CHILD + 1 - inner])
                c = np.int64(cx.cell[c, CELL_CHILD + inner])
            cx.label[outer] = 0
            cx.label[outer, cx.label.shape[1] - 1] = flag
            if outer == c:
                break


def at_limits(cx: Complex, first: int) -> np.ndarray:
    """Whether each cell has a face on one of the planes it was cropped by, as (c,) bool."""
    faces = cx.face[: int(cx.count[N_FACES])]
    on_limit = (
        (faces[:, FACE_PLANE] >= first)
        & (faces[:, FACE_PLANE] < first + N_LIMITS)
        & (faces[:, FACE_CHILD] < 0)
    )
    result = np.zeros(int(cx.count[N_CELLS]), bool)
    sides = faces[on_limit, SIDES : SIDES + 2]
    result[sides[sides >= 0]] = True
    return result
