"""How probable it is that an edge is measured accurately on the sensor's own pixel grid: counted, not computed.

The paper's quantization error takes the phases of the grid as random (eqs 1-3). At one planned pose they are not: an
image of 50.2 px is read as 50 or 51 px and never as 49, however the camera is displaced along it. Where the tolerance
is less than about two pixels that decides, and no density is right. So poses are displaced, both ends of the image
rounded to whole pixels, and the accurate lengths counted. The displacements are the same for every pose and every run.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from aspectgraph.exact.lean import compiled, lean
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
        self._pitch, self._size = (
            np.array(camera.pixel_pitch_mm),
            np.array(camera.resolution, dtype=float),
        )
        self._camera, matrix = camera, camera.matrix
        self._lens = np.array([matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]])
        rng = np.random.default_rng(GRID.seed)
        moves = rng.multivariate_normal(
            np.zeros(6), pose_uncertainty.covariance, size=GRID.draws, method="eigh"
        )
        turns = Rotation.from_rotvec(moves[:, 3:]).as_matrix()
        # numbers of one kind beside each other, so that the compiler can take several draws at a time
        self._turns = np.ascontiguousarray(np.moveaxis(turns, 0, -1))
        self._shifts = np.ascontiguousarray(moves[:, :3].T)

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
                result[rows, i] = lowered(
                    self.frequencies(world_to_cam(self.ends[i], cam2world[rows]))
                )
        return result[wanted]

    def frequencies(self, ends_cam: np.ndarray) -> np.ndarray:
        """Return how often edges, given by their ends in camera frames (n, 2, 3), are measured accurately; (n,)."""
        if self._camera.distortion is not None:
            return np.array([self._distorted_frequency(ends) for ends in ends_cam])
        hits = np.empty(len(ends_cam))
        sensor = self._lens, self._pitch, self._size
        _count(
            np.ascontiguousarray(ends_cam), self._turns, self._shifts, sensor, self._allowed, hits
        )
        return hits / GRID.draws

    def _distorted_frequency(self, ends_cam: np.ndarray) -> float:
        """Return the frequency for an edge (2, 3) whose images are rounded to pixels of the distorted image."""
        camera = self._camera
        local = (ends_cam - self._shifts.T[:, None]) @ np.moveaxis(self._turns, -1, 0)
        depth = np.where(local[..., 2:] > 0, local[..., 2:], np.nan)
        pixels = image_of(camera, local / depth)
        lost = ~((pixels >= -0.5) & (pixels <= self._size - 0.5)).all(axis=(1, 2))
        ideal = np.concatenate(
            [undistorted_px(camera, np.rint(pixels)), self._nominal_px(ends_cam)[None]]
        )
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


def tolerance_px(
    ends: np.ndarray, cam2world: np.ndarray, camera: Camera, accuracy: float
) -> np.ndarray:
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


@compiled(error_model="numpy")
def _count(ends_cam, turns, shifts, sensor, allowed, hits):
    """Count the draws in which edges (n, 2, 3) are measured accurately; none if an end is behind the camera."""
    lens, pitch = sensor[0], sensor[1]
    for i in range(len(ends_cam)):
        one, other = ends_cam[i, 0], ends_cam[i, 1]
        hits[i] = 0.0
        if one[2] > 0.0 and other[2] > 0.0:
            x = (
                lens[0] * other[0] / other[2] + lens[2] - (lens[0] * one[0] / one[2] + lens[2])
            ) * pitch[0]
            y = (
                lens[1] * other[1] / other[2] + lens[3] - (lens[1] * one[1] / one[2] + lens[3])
            ) * pitch[1]
            hits[i] = _accurate(
                ends_cam[i], turns, shifts, sensor, (np.sqrt(x * x + y * y), allowed)
            )


@lean(error_model="numpy")
def _accurate(ends, turns, shifts, sensor, length):
    """Count the draws in which the length of an edge (2, 3) on whole pixels is accurate, with both ends on the sensor.

    Without a branch or a call in the loop, which the compiler then makes instructions for several draws at a time of.
    """
    (lens, pitch, size), (nominal, allowed) = sensor, length
    u_max, v_max, tolerance, n = size[0] - 0.5, size[1] - 0.5, allowed * nominal, 0
    for j in range(turns.shape[2]):
        x, y, z = ends[0, 0] - shifts[0, j], ends[0, 1] - shifts[1, j], ends[0, 2] - shifts[2, j]
        near = turns[0, 2, j] * x + turns[1, 2, j] * y + turns[2, 2, j] * z
        u = (
            lens[0] * (turns[0, 0, j] * x + turns[1, 0, j] * y + turns[2, 0, j] * z) / near
            + lens[2]
        )
        v = (
            lens[1] * (turns[0, 1, j] * x + turns[1, 1, j] * y + turns[2, 1, j] * z) / near
            + lens[3]
        )
        seen = (near > 0.0) & (u >= -0.5) & (v >= -0.5) & (u <= u_max) & (v <= v_max)
        x, y, z = ends[1, 0] - shifts[0, j], ends[1, 1] - shifts[1, j], ends[1, 2] - shifts[2, j]
        far = turns[0, 2, j] * x + turns[1, 2, j] * y + turns[2, 2, j] * z
        other_u = (
            lens[0] * (turns[0, 0, j] * x + turns[1, 0, j] * y + turns[2, 0, j] * z) / far + lens[2]
        )
        other_v = (
            lens[1] * (turns[0, 1, j] * x + turns[1, 1, j] * y + turns[2, 1, j] * z) / far + lens[3]
        )
        seen &= (
            (far > 0.0)
            & (other_u >= -0.5)
            & (other_v >= -0.5)
            & (other_u <= u_max)
            & (other_v <= v_max)
        )
        x, y = (
            (np.rint(other_u) - np.rint(u)) * pitch[0],
            (np.rint(other_v) - np.rint(v)) * pitch[1],
        )
        n += np.int64(seen & (abs(np.sqrt(x * x + y * y) - nominal) <= tolerance))
    return n
