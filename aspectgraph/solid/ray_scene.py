"""Rays against triangles, with Open3D: the one place that builds its scene.

Rays are float32: about 10⁻⁷ of the part's size. That is for confirming, looking and keeping clear of things; what is
observable is decided exactly, by the regions.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import ArrayLike


class RayScene:
    """Triangles that rays are cast at.

    Parameters
    ----------
    vertices : array_like, shape (v, 3)
        Corners, mm.
    triangles : array_like of int, shape (t, 3)
        Vertex numbers, outward counter-clockwise.
    n_threads : int
        Threads for each call; 0: one for each processor.
    """

    def __init__(self, vertices: ArrayLike, triangles: ArrayLike, n_threads: int = 0) -> None:
        with _existing_folder():
            import open3d as o3d

        corners = np.asarray(vertices, dtype=np.float64)
        # float32 loses digits far from the origin, so everything is computed around the triangles' own centre
        self._centre = (corners.min(axis=0) + corners.max(axis=0)) / 2
        self._n_threads = n_threads
        self._scene = o3d.t.geometry.RaycastingScene(nthreads=n_threads)
        self._scene.add_triangles(_packed(corners - self._centre), _packed(triangles, np.uint32))

    def cast(self, origins: ArrayLike, directions: np.ndarray) -> dict[str, np.ndarray]:
        """Return what each ray hits first.

        Parameters
        ----------
        origins : array_like
            Where rays start, mm; broadcasts against `directions`.
        directions : ndarray, shape (..., 3)
            Where they go; the length is the unit of ``t_hit``.

        Returns
        -------
        dict of str to ndarray
            ``t_hit``: lengths to the hit, inf without one; ``primitive_ids``: the triangle, the largest uint32 without
            one; ``primitive_normals``: its unit normal. Shapes (...) and (..., 3).
        """
        hits = self._scene.cast_rays(self._rays(origins, directions), nthreads=self._n_threads)
        return {key: hits[key].numpy() for key in ("t_hit", "primitive_ids", "primitive_normals")}

    def blocked(self, origins: ArrayLike, directions: np.ndarray, up_to: float = 1.0) -> np.ndarray:
        """Return which rays hit anything on their way; in half the time of `cast`, as the first hit need not be found.

        Parameters
        ----------
        origins, directions : array_like
            See `cast`.
        up_to : float
            How far they go, in lengths of the directions.

        Returns
        -------
        ndarray of bool, shape (...)
        """
        rays = self._rays(origins, directions)
        hits = self._scene.test_occlusions(rays, 0.0, up_to, nthreads=self._n_threads)
        return np.asarray(hits.numpy())

    def _rays(self, origins: ArrayLike, directions: np.ndarray) -> Any:
        rays = np.empty((*directions.shape[:-1], 6), dtype=np.float32)
        rays[..., :3] = np.asarray(origins, dtype=np.float64) - self._centre
        rays[..., 3:] = directions
        return rays

    def signed_distance(self, points: ArrayLike) -> np.ndarray:
        """Return the distance (n,) in mm of points (n, 3) to a closed surface, negative inside."""
        local = _packed(np.asarray(points, dtype=np.float64) - self._centre)
        if not len(local):
            return np.empty(0)
        distance = self._scene.compute_signed_distance(local, nsamples=3, nthreads=self._n_threads)
        return np.asarray(distance.numpy(), dtype=np.float64)


def _packed(array: ArrayLike, dtype: type[np.generic] = np.float32) -> Any:
    """Return an array as Open3D takes it; its stubs know tensors only."""
    return np.ascontiguousarray(array, dtype=dtype)


@contextmanager
def _existing_folder() -> Iterator[None]:
    """Leave the current folder for the block if it is deleted; Open3D ends the process there as it loads."""
    try:
        os.getcwd()
    except OSError:
        pass
    else:
        yield
        return
    # a deleted folder has no name to return to, but a handle
    deleted = os.open(".", os.O_RDONLY)
    os.chdir(os.sep)
    try:
        yield
    finally:
        os.fchdir(deleted)
        os.close(deleted)
