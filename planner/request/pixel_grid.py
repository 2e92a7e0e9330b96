"""How probable it is that an edge is measured accurately on the sensor's own pixel grid: counted, not computed.

The paper's quantization error takes the phases of the grid as random (eqs 1-3). At one planned pose they are not: an
image of 50.2 px is read as 50 or 51 px and never as 49, however the camera is displaced along it. Where the tolerance
is less than about two pixels that decides, and no density is right. So poses are displaced, both ends of the image
rounded to whole pixels, and the accurate lengths counted. The displacements are the same for every pose and every run.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba as nb
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from planner.camera.camera import Camera
from planner.camera.imaging import image_of, undistorted_px
from planner.camera.pose import world_to_cam
from planner.camera.pose_uncertainty import PoseUncertainty
from planner.request.objective import Objective


@dataclass(frozen=True)
class GridRule:
    """When and how the pixel grid decides.

    Attributes
    ----------
    below_px : float
        The grid decides where the permitted error of a length is less, in pixels of the larger pitch: from two pixels
        on the density is right to 0.01 on average.
    draws : int
        Displaced poses counted.
    errors : float
        The frequency is lowered by so many standard errors: of thousands of poses the best is chosen, and what is best
        by luck must not be promised.
    seed : int
        Of the displacements.
    """

    below_px: float = 2.0
    draws: int = 4000
    errors: float = 3.0
    seed: int = 2001


GRID = GridRule()


class GridObjective(Objective):
    """An objective that counts on the pixel grid for some entities; its fitness, which must be smooth, stays.

    Parameters
    ----------
    smooth : Objective
        Answers for the other entities.
    counted : sequence of int
        Columns of the entities that are counted.
    camera, pose_uncertainty, accuracy
        As in `Objective`.
    """

    def __init__(
        self,
        smooth: Objective,
        counted: NDArray[np.int_],
        camera: Camera,
        pose_uncertainty: PoseUncertainty,
        accuracy: float,
    ):
        # what of it is not overridden, is the smooth one's
        self.__dict__.update(smooth.__dict__)
        self._smooth, self._counted, self._allowed = smooth, counted, 1.0 - accuracy
        self._pitch, self._size = np.array(camera.pixel_pitch_mm), np.array(camera.resolution, dtype=float)
        self._camera, matrix = camera, camera.matrix
        self._lens = np.array([matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]])
        rng = np.random.default_rng(GRID.seed)
        moves = rng.multivariate_normal(np.zeros(6), pose_uncertainty.covariance, size=GRID.draws, method="eigh")
        self._turns = np.ascontiguousarray(Rotation.from_rotvec(moves[:, 3:]).as_matrix())
        self._shifts = np.ascontiguousarray(moves[:, :3])

    def probability(self, cam2world: np.ndarray) -> np.ndarray:
        """Return P (n, k) of poses (n, 4, 4), smooth: what the search climbs."""
        return self._smooth.probability(cam2world)

    def probability_where(self, cam2world: np.ndarray, wanted: np.ndarray) -> np.ndarray:
        """Return P of poses (n, 4, 4) for those entities that are wanted (n, k), one after the other, row by row."""
        result, own = np.zeros(wanted.shape), wanted.copy()
        own[:, self._counted] = False
        if own.any():
            result[own] = self._smooth.probability_where(cam2world, own)
        for i in self._counted:
            rows = np.flatnonzero(wanted[:, i])
            if rows.size:
                result[rows, i] = lowered(self.frequencies(world_to_cam(self.ends[i], cam2world[rows])))
        return result[wanted]

    def frequencies(self, ends_cam: np.ndarray) -> np.ndarray:
        """Return how often edges, given by their ends in camera frames (n, 2, 3), are measured accurately; (n,)."""
        if self._camera.distortion is not None:
            return np.array([self._distorted_frequency(ends) for ends in ends_cam])
        hits = np.empty(len(ends_cam))
        draws = self._turns, self._shifts
        _count(np.ascontiguousarray(ends_cam), draws, self._lens, self._pitch, self._size, self._allowed, hits)
        return hits / GRID.draws

    def _distorted_frequency(self, ends_cam: np.ndarray) -> float:
        """Return the frequency for an edge (2, 3) whose images are rounded to pixels of the distorted image."""
        camera = self._camera
        local = (ends_cam - self._shifts[:, None]) @ self._turns
        depth = np.where(local[..., 2:] > 0, local[..., 2:], np.nan)
        pixels = image_of(camera, local / depth)
        lost = ~((pixels >= -0.5) & (pixels <= self._size - 0.5)).all(axis=(1, 2))
        ideal = np.concatenate([undistorted_px(camera, np.rint(pixels)), self._nominal_px(ends_cam)[None]])
        length = np.linalg.norm((ideal[:, 1] - ideal[:, 0]) * self._pitch, axis=-1)
        accurate = np.abs(length[:-1] - length[-1]) <= self._allowed * length[-1]
        return float((accurate & ~lost).sum() / GRID.draws)

    def _nominal_px(self, ends_cam: np.ndarray) -> np.ndarray:
        """Return the undistorted images (2, 2) of ends (2, 3) at the planned pose."""
        return np.asarray((ends_cam / ends_cam[:, 2:] @ self._camera.matrix.T)[:, :2])


def lowered(frequency: np.ndarray) -> np.ndarray:
    """Return what may be promised after a frequency was counted."""
    error = np.sqrt(frequency * (1.0 - frequency) / GRID.draws)
    return np.clip(frequency - GRID.errors * error, 0.0, 1.0)


def tolerance_px(ends: np.ndarray, cam2world: np.ndarray, camera: Camera, accuracy: float) -> np.ndarray:
    """Return the permitted errors of edges' images in pixels of the larger pitch.

    Parameters
    ----------
    ends : array (k, 2, 3)
        Ends of the edges, mm.
    cam2world : array (n, 4, 4)
        Poses that see them.
    camera : Camera
        The camera.
    accuracy : float
        Required accuracy A.

    Returns
    -------
    array (n, k)
        (1 - A) times the length of the image.
    """
    local = world_to_cam(ends, cam2world)
    image = camera.image_distance_mm * local[..., :2] / local[..., 2:]
    length = np.linalg.norm(image[..., 1, :] - image[..., 0, :], axis=-1)
    return (1.0 - accuracy) * length / max(camera.pixel_pitch_mm)


@nb.njit(cache=True, error_model="numpy")
def _count(ends_cam, draws, lens, pitch, size, allowed, hits):
    turns, shifts = draws
    for i in range(len(ends_cam)):
        nominal = _length(ends_cam[i], np.eye(3), np.zeros(3), lens, pitch, size, False)
        n = 0
        for j in range(len(turns)):
            length = _length(ends_cam[i], turns[j], shifts[j], lens, pitch, size, True)
            n += abs(length - nominal) <= allowed * nominal
        hits[i] = n


@nb.njit(cache=True, error_model="numpy", inline="always")
def _length(ends, turn, shift, lens, pitch, size, on_pixels):
    """Length of the image, mm; nan if an end is behind the camera or, on pixels, on none of them."""
    # no arrays of two: to allocate them takes longer than all the rest
    u, v = _pixel(ends[0], turn, shift, lens, size, on_pixels)
    other_u, other_v = _pixel(ends[1], turn, shift, lens, size, on_pixels)
    x, y = (other_u - u) * pitch[0], (other_v - v) * pitch[1]
    return np.sqrt(x * x + y * y)


@nb.njit(cache=True, error_model="numpy", inline="always")
def _pixel(end, turn, shift, lens, size, on_pixels):
    """Image of a point, px."""
    x, y, z = end[0] - shift[0], end[1] - shift[1], end[2] - shift[2]
    depth = turn[0, 2] * x + turn[1, 2] * y + turn[2, 2] * z
    u = lens[0] * (turn[0, 0] * x + turn[1, 0] * y + turn[2, 0] * z) / depth + lens[2]
    v = lens[1] * (turn[0, 1] * x + turn[1, 1] * y + turn[2, 1] * z) / depth + lens[3]
    if depth <= 0.0 or (on_pixels and (u < -0.5 or v < -0.5 or u > size[0] - 0.5 or v > size[1] - 0.5)):
        u, v = np.nan, np.nan
    elif on_pixels:
        u, v = np.rint(u), np.rint(v)
    return u, v
