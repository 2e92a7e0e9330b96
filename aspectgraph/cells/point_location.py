"""Exact point location in a binary space partition, vectorised over query points."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from aspectgraph.cells.arrays import CELL_CHILD, CELL_PLANE, N_CELLS, Complex
from aspectgraph.exact.predicates import POINT_BITS, sign_at_point
from compiled.decorators import entry_kernel, kernel

_POINT_STEP = 2.0**-POINT_BITS
# see predicates: rounding of four coefficients, three coordinates, three products and three sums
_FILTER = 16 * np.finfo(np.float64).eps


class Tree(NamedTuple):
    """A binary space partition; inner nodes cut, leaves are the cells.

    Attributes
    ----------
    planes : ndarray of int64, shape (p, 4)
        Planes in grid steps.
    plane : ndarray of int32, shape (n,)
        Plane of each node, -1 at leaves.
    child : ndarray of int32, shape (n, 2)
        Positive and negative child of inner nodes, -1 at leaves.
    """

    planes: np.ndarray
    plane: np.ndarray
    child: np.ndarray


def tree_of(cx: Complex) -> Tree:
    """The partition whose leaves are the present cells of a complex; node numbers are cell numbers."""
    n = int(cx.count[N_CELLS])
    return Tree(
        cx.planes, cx.cell[:n, CELL_PLANE].copy(), cx.cell[:n, CELL_CHILD : CELL_CHILD + 2].copy()
    )


@kernel
def _rows(tree, points):
    """For every node its plane in doubles, and the value it must exceed at any of the points for a certain sign."""
    reach = 0.0
    for k in range(len(points)):
        for axis in range(3):
            reach = max(reach, abs(np.float64(points[k, axis])))
    reach *= _POINT_STEP
    rows = np.zeros((len(tree.plane), 5))
    for node in range(len(tree.plane)):
        if tree.plane[node] >= 0:
            for column in range(4):
                rows[node, column] = np.float64(tree.planes[tree.plane[node], column])
            a = abs(rows[node, 0])
            b = abs(rows[node, 1])
            c = abs(rows[node, 2])
            d = abs(rows[node, 3])
            rows[node, 4] = ((a + b + c) * reach + d) * _FILTER
    return rows


@entry_kernel
def holds(tree, flag, points):
    """Whether the closure of a flagged leaf holds each of (n, 3) int64 query points (`Grid.to_points`), as (n,) bool.

    A point on a plane belongs to both sides of it.
    """
    planes = tree.planes
    plane = tree.plane
    child = tree.child
    rows = _rows(tree, points)
    result = np.zeros(len(points), np.bool_)
    waiting = np.empty(len(plane) + 1, np.int64)
    for k in range(len(points)):
        x = points[k, 0] * _POINT_STEP
        y = points[k, 1] * _POINT_STEP
        z = points[k, 2] * _POINT_STEP
        # unsigned, so that indexing need not look for negative numbers
        node = np.uint64(0)
        n_waiting = 0
        while True:
            if plane[node] >= 0:
                value = rows[node, 0] * x + rows[node, 1] * y + rows[node, 2] * z - rows[node, 3]
                if abs(value) > rows[node, 4]:
                    node = np.uint64(child[node, np.uint64(value < 0)])
                    continue
                s = sign_at_point(planes, plane[node], points[k])
                if s == 0:
                    waiting[n_waiting] = child[node, 1]
                    n_waiting += 1
                node = np.uint64(child[node, np.uint64(s < 0)])
            elif flag[node]:
                result[k] = True
                break
            elif n_waiting == 0:
                break
            else:
                n_waiting -= 1
                node = np.uint64(waiting[n_waiting])
    return result


@entry_kernel
def locate(tree, points):
    """Leaf that holds each of (n, 3) int64 query points, as (n,) int64; on a plane, the leaf on its positive side."""
    planes = tree.planes
    plane = tree.plane
    child = tree.child
    rows = _rows(tree, points)
    result = np.empty(len(points), np.int64)
    for k in range(len(points)):
        x = points[k, 0] * _POINT_STEP
        y = points[k, 1] * _POINT_STEP
        z = points[k, 2] * _POINT_STEP
        node = np.uint64(0)
        while plane[node] >= 0:
            value = rows[node, 0] * x + rows[node, 1] * y + rows[node, 2] * z - rows[node, 3]
            behind = value < 0
            if abs(value) <= rows[node, 4]:
                behind = sign_at_point(planes, plane[node], points[k]) < 0
            node = np.uint64(child[node, np.uint64(behind)])
        result[k] = node
    return result
