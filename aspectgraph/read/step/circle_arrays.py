"""Circular edges as arrays, the way they leave the kernel's process."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from aspectgraph.solid.circles import Circle, CircularEdge


def pack_circles(
    edges: Sequence[CircularEdge],
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Return circular edges as arrays.

    Returns
    -------
    numbers : ndarray, shape (n, 8)
        Centre, axis, radius and turn of each.
    vertices : ndarray of int, shape (m,)
        Their vertices, one edge after the other.
    first : ndarray of int, shape (n + 1,)
        Where those of each edge start.
    """
    rows = [
        [*edge.circle.centre, *edge.circle.axis, edge.circle.radius_mm, edge.turn_deg]
        for edge in edges
    ]
    vertices = [v for edge in edges for v in edge.vertices]
    first = np.cumsum([0] + [len(edge.vertices) for edge in edges])
    return (
        np.array(rows, dtype=np.float64).reshape(-1, 8),
        np.array(vertices, dtype=np.int64),
        first,
    )


def unpack_circles(
    numbers: npt.NDArray[np.float64], vertices: npt.NDArray[np.int64], first: npt.NDArray[np.int64]
) -> list[CircularEdge]:
    """Return the circular edges that `pack_circles` packed."""
    return [
        CircularEdge(
            Circle(row[:3], row[3:6], float(row[6])), tuple(vertices[i:j].tolist()), float(row[7])
        )
        for row, i, j in zip(numbers, first, first[1:], strict=False)
    ]
