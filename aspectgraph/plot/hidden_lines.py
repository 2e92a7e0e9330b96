"""Parallel views of a part by casting rays: its triangles as an image, and which points they do not hide."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from aspectgraph.solid.ray_scene import RayScene

_PIXELS = 800
# what hides a point by less than this share of the picture's size is the surface the point lies on
_ON_SURFACE = 1e-4


class ParallelView:
    """Triangles seen by a viewer far up the third axis.

    Parameters
    ----------
    corners : ndarray, shape (t, 3, 3)
        Triangles that face the viewer, counter-clockwise in the picture, in view coordinates.
    """

    def __init__(self, corners: np.ndarray) -> None:
        points = corners.reshape(-1, 3)
        self._low = points.min(axis=0)
        self._high = points.max(axis=0)
        self._scene = RayScene(points, np.arange(len(points)).reshape(-1, 3))

    def render(self, shades: np.ndarray) -> tuple[np.ndarray, tuple[float, float, float, float]]:
        """Paint the triangles into an image, the nearest on top.

        Parameters
        ----------
        shades : ndarray, shape (t,)
            Grey of each triangle.

        Returns
        -------
        image : ndarray, shape (h, w)
            White where there is nothing; the first row is the lowest.
        extent : tuple of float
            Left, right, bottom and top of the image in view coordinates.
        """
        low = self._low[:2]
        high = self._high[:2]
        pixel = float((high - low).max()) / _PIXELS
        low = low - 2 * pixel
        high = high + 2 * pixel
        width, height = np.ceil((high - low) / pixel).astype(int)
        x, y = np.meshgrid(
            low[0] + (np.arange(width) + 0.5) * pixel, low[1] + (np.arange(height) + 0.5) * pixel
        )
        above = np.full_like(x, self._high[2] + _PIXELS * pixel)
        downwards = np.broadcast_to([0.0, 0.0, -1.0], (*x.shape, 3))
        hit = self._scene.cast(np.stack([x, y, above], axis=-1), downwards)
        image = np.append(shades, 1.0)[np.minimum(hit["primitive_ids"], len(shades))]
        return image, (low[0], low[0] + width * pixel, low[1], low[1] + height * pixel)

    def is_seen(self, points: np.ndarray) -> np.ndarray:
        """Return which points, shape (n, 3) in view coordinates, no triangle hides; (n,) bool."""
        lift = _ON_SURFACE * float((self._high - self._low).max())
        upwards = np.broadcast_to([0.0, 0.0, 1.0], points.shape)
        return np.isinf(self._scene.cast(points + lift * upwards, upwards)["t_hit"])


def view_axes(direction: ArrayLike) -> np.ndarray:
    """Return the picture's right, up and towards-the-viewer axes as rows, shape (3, 3); z points up if it can."""
    towards = np.asarray(direction, dtype=np.float64)
    towards = towards / np.linalg.norm(towards)
    up = np.array([0.0, 0.0, 1.0]) if abs(towards[2]) < 0.999 else np.array([0.0, 1.0, 0.0])
    right = np.cross(up, towards)
    right /= np.linalg.norm(right)
    return np.array([right, np.cross(towards, right), towards])
