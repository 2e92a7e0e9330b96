"""How far from its prediction a line may be in the image: where a detector has to look for it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planner.camera.camera import Camera
from planner.camera.imaging import image_of
from planner.camera.pose import world_to_cam
from planner.camera.pose_uncertainty import PoseUncertainty

Array = NDArray[np.float64]

SIGMAS = 3.0
"""Half the width of a search window, in standard deviations of the image's shift."""

# difference quotients of the lens's distortion
_STEP = 1e-6


def search_window_px(
    cam2world: Array,
    points: Array,
    camera: Camera,
    pose_uncertainty: PoseUncertainty,
    sigmas: float = SIGMAS,
) -> float:
    """Return within how many pixels of its prediction an image is found, if the pose is as uncertain as is said.

    A camera moved by t and turned by φ, both in its own axes, images the point x at P(x − t − φ × x) to first order,
    with the projection P(x) = (x/z, y/z). With its Jacobian J = [1/z, 0, −x/z²; 0, 1/z, −y/z²] the shift has the
    covariance J [−1, [x]×] Σ [−1, [x]×]ᵀ Jᵀ, in units of slope; scale and distortion of the camera make it pixels. The
    window is the largest standard deviation in any direction, at the point that moves farthest, times `sigmas`.

    Parameters
    ----------
    cam2world : array (4, 4)
        Planned pose.
    points : array (n, 3)
        Of an edge both ends; of other things points of all their entities. Part's frame, mm.
    camera : Camera
        The camera.
    pose_uncertainty : PoseUncertainty
        How far its real pose may be from the planned one.
    sigmas : float
        Standard deviations.

    Returns
    -------
    float
        Pixels, to either side.
    """
    local = world_to_cam(
        np.asarray(points, dtype=np.float64), np.asarray(cam2world, dtype=np.float64)
    )
    x, y, z = np.moveaxis(local, -1, 0)
    moved = np.zeros((len(local), 3, 6))
    moved[:, :, :3] = -np.eye(3)
    # −φ × x = x × φ
    moved[:, 0, 4] = -z
    moved[:, 0, 5] = y
    moved[:, 1, 3] = z
    moved[:, 1, 5] = -x
    moved[:, 2, 3] = -y
    moved[:, 2, 4] = x
    projected = np.zeros((len(local), 2, 3))
    projected[:, 0, 0] = projected[:, 1, 1] = 1.0 / z
    projected[:, 0, 2] = -x / z**2
    projected[:, 1, 2] = -y / z**2
    jacobian = _pixels_per_slope(camera, local / z[:, None]) @ projected @ moved
    covariance = jacobian @ pose_uncertainty.covariance @ np.swapaxes(jacobian, 1, 2)
    return sigmas * float(np.sqrt(max(np.linalg.eigvalsh(covariance).max(), 0.0)))


def _pixels_per_slope(camera: Camera, directions: Array) -> Array:
    """Return how pixels change with the slopes x/z and y/z of directions (n, 3); (n, 2, 2)."""
    if camera.distortion is None:
        return np.broadcast_to(np.diag(np.diag(camera.matrix)[:2]), (len(directions), 2, 2))
    columns = []
    for axis in range(2):
        step = np.zeros(3)
        step[axis] = _STEP
        columns.append(
            (image_of(camera, directions + step) - image_of(camera, directions - step))
            / (2 * _STEP)
        )
    return np.stack(columns, axis=-1)
