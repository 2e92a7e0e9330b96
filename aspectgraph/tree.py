"""Exact point location in a binary space partition, vectorised over query points."""

from __future__ import annotations

from typing import NamedTuple

import numba as nb
import numpy as np

from .complex import CELL_CHILD, CELL_PLANE, N_CELLS, Complex
from .predicates import sign_at_point


class Tree(NamedTuple):
    """A binary space partition; inner nodes cut, leaves are the cells.

    Attributes
    ----------
    planes : ndarray of int64, shape (p, 4)
        Planes in grid steps.
    plane : ndarray of int32, shape (n,)
        Plane of each node, -1 at leaves.
    child : ndarray of int32, shape (n, 2)
        Positive and negative child of inner nodes.
    """

    planes: np.ndarray
    plane: np.ndarray
    child: np.ndarray


def tree_of(cx: Complex) -> Tree:
    """The partition whose leaves are the present cells of a complex; node numbers are cell numbers."""
    n = int(cx.count[N_CELLS])
    return Tree(cx.planes, cx.cell[:n, CELL_PLANE].copy(), cx.cell[:n, CELL_CHILD : CELL_CHILD + 2].copy())


@nb.njit(cache=True)
def holds(tree, flag, points):
    """Whether the closure of a flagged leaf holds each of (n, 3) int64 query points (`Grid.to_points`), as (n,) bool.

    A point on a plane belongs to both sides of it.
    """
    result = np.zeros(len(points), np.bool_)
    stack = np.empty(len(tree.plane) + 1, np.int64)
    for k in range(len(points)):
        stack[0], size = 0, 1
        while size > 0 and not result[k]:
            size -= 1
            node = stack[size]
            while tree.plane[node] >= 0:
                s = sign_at_point(tree.planes, tree.plane[node], points[k])
                if s == 0:
                    stack[size] = tree.child[node, 1]
                    size += 1
                node = tree.child[node, 0] if s >= 0 else tree.child[node, 1]
            result[k] = flag[node]
    return result


@nb.njit(cache=True)
def locate(tree, points):
    """Leaf that holds each of (n, 3) int64 query points, as (n,) int64; on a plane, the leaf on its positive side."""
    result = np.empty(len(points), np.int64)
    for k in range(len(points)):
        node = np.int64(0)
        while tree.plane[node] >= 0:
            s = sign_at_point(tree.planes, tree.plane[node], points[k])
            node = np.int64(tree.child[node, 0] if s >= 0 else tree.child[node, 1])
        result[k] = node
    return result
