"""Parallel views of a part in doubles: triangles painted into an image, and which points they do not hide."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

_PIXELS = 800


def render(corners: np.ndarray, shades: np.ndarray) -> tuple[np.ndarray, tuple[float, float, float, float]]:
    """Paint triangles into an image, the nearest on top.

    Parameters
    ----------
    corners : ndarray, shape (t, 3, 3)
        Triangles that face the viewer, in view coordinates.
    shades : ndarray, shape (t,)
        Grey of each triangle.

    Returns
    -------
    image : ndarray, shape (h, w)
        White where there is nothing; the first row is the lowest.
    extent : tuple of float
        Left, right, bottom and top of the image in view coordinates.
    """
    low, high = corners.reshape(-1, 3).min(axis=0)[:2], corners.reshape(-1, 3).max(axis=0)[:2]
    pixel = float((high - low).max()) / _PIXELS
    low, high = low - 2 * pixel, high + 2 * pixel
    width, height = np.ceil((high - low) / pixel).astype(int)
    image, depth = np.ones((height, width)), np.full((height, width), -np.inf)
    for triangle, shade in zip(corners, shades, strict=True):
        first = np.floor((triangle[:, :2].min(axis=0) - low) / pixel).astype(int)
        last = np.ceil((triangle[:, :2].max(axis=0) - low) / pixel).astype(int) + 1
        x = low[0] + (np.arange(first[0], last[0]) + 0.5) * pixel
        y = low[1] + (np.arange(first[1], last[1]) + 0.5) * pixel
        weights = _weights(np.stack(np.meshgrid(x, y), axis=-1), *triangle)
        inside = (weights >= -1e-9).all(axis=0)
        z = np.einsum("kyx,k->yx", weights, triangle[:, 2])
        window = np.s_[first[1] : last[1], first[0] : last[0]]
        nearer = inside & (z > depth[window])
        depth[window][nearer] = z[nearer]
        image[window][nearer] = shade
    return image, (low[0], low[0] + width * pixel, low[1], low[1] + height * pixel)


def _weights(p: np.ndarray, a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Return the barycentric weights of points seen along the third axis, first axis 3."""
    a, b, c, p = (x[..., :2] for x in (a, b, c, p))
    return np.stack([_cross(b - p, c - p), _cross(c - p, a - p), _cross(a - p, b - p)]) / _cross(b - a, c - a)


def view_axes(direction: ArrayLike) -> np.ndarray:
    """Return the picture's right, up and towards-the-viewer axes as rows, shape (3, 3); z points up if it can."""
    towards = np.asarray(direction, dtype=np.float64)
    towards = towards / np.linalg.norm(towards)
    up = np.array([0.0, 0.0, 1.0]) if abs(towards[2]) < 0.999 else np.array([0.0, 1.0, 0.0])
    right = np.cross(up, towards)
    right /= np.linalg.norm(right)
    return np.array([right, np.cross(towards, right), towards])


def is_seen(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Return which points no triangle hides from a viewer far up the third axis.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        In view coordinates.
    corners : ndarray, shape (t, 3, 3)
        Triangles that face the viewer, counter-clockwise in the picture.

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    a, b, c = corners.swapaxes(0, 1)
    extent = float(np.ptp(corners.reshape(-1, 3), axis=0).max())
    seen = np.empty(len(points), dtype=bool)
    for n, p in enumerate(points):
        weights = _weights(p, a, b, c)
        height = np.einsum("kt,kt->t", weights, np.stack([a[:, 2], b[:, 2], c[:, 2]]))
        hiding = (weights > 1e-6).all(axis=0) & (height > p[2] + 1e-4 * extent)
        seen[n] = not hiding.any()
    return seen


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
