"""Circles: the true one that a chain of chords stands for, and the one fitted to points.

Reference: I. Kåsa, A circle fitting procedure and its error analysis, IEEE Trans. Instrum. Meas. 25 (1976), for the
linear fit, which is exact where the points lie on a circle.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from aspectgraph.solid.topology import Edge

FloatArray = npt.NDArray[np.float64]


class EdgedSurface(Protocol):
    """What finding circular edges needs of a `Solid`: its vertices, edges and outward unit normals."""

    vertices: FloatArray
    edges: tuple[Edge, ...]
    normals: FloatArray


class Circle(NamedTuple):
    """A circle in space.

    Attributes
    ----------
    centre : ndarray, shape (3,)
        In mm.
    axis : ndarray, shape (3,)
        Unit normal of its plane.
    radius_mm : float
        In mm.
    """

    centre: FloatArray
    axis: FloatArray
    radius_mm: float

    def distances_mm(self, points: FloatArray) -> FloatArray:
        """Return the distances of points from the circle.

        Parameters
        ----------
        points : ndarray, shape (n, 3)
            In mm.

        Returns
        -------
        ndarray of float64, shape (n,)
            In mm.
        """
        offset = points - self.centre
        along = offset @ self.axis
        across = np.linalg.norm(offset - along[:, None] * self.axis, axis=1)
        return np.asarray(np.hypot(along, across - self.radius_mm), dtype=np.float64)

    def flipped(self) -> Circle:
        """Return the circle with the opposite axis.

        Returns
        -------
        Circle
            The same circle with its axis the other way.
        """
        return Circle(self.centre, -self.axis, self.radius_mm)


class CircularEdge(NamedTuple):
    """A circular edge of the CAD model and its chords.

    Attributes
    ----------
    circle : Circle
        The true circle.
    vertices : tuple of int
        Ends of its chords in order; of a closed one, the first comes again at the end.
    turn_deg : float
        How far the true surfaces' normals turn across it, in degrees.
    """

    circle: Circle
    vertices: tuple[int, ...]
    turn_deg: float


def fit_circle(points: FloatArray) -> Circle | None:
    """Fit a circle to points in space: their plane by least squares, then the circle in it.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        At least three, in mm.

    Returns
    -------
    Circle or None
        None if the points lie on a line.
    """
    middle = points.mean(axis=0)
    _, spread, axes = np.linalg.svd(points - middle, full_matrices=False)
    if spread[1] <= 1e-9 * spread[0]:
        return None
    flat = (points - middle) @ axes[:2].T
    system = np.column_stack([2.0 * flat, np.ones(len(flat))])
    x, y, rest = np.linalg.lstsq(system, (flat**2).sum(axis=1), rcond=None)[0]
    radius = float(np.sqrt(max(rest + x * x + y * y, 0.0)))
    return Circle(middle + x * axes[0] + y * axes[1], axes[2], radius)
