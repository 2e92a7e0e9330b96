"""Camera poses, their uncertainty, and the two camera frames.

Frames
------
world   the part's frame, millimetres.
cam     OpenCV camera frame: origin at the front nodal point, x right, y down, z forward along the optical axis.
paper   the frame of Yang & Ciarallo (2001), eqs 4–9: C1 right, C2 up, C3 backwards, origin on the image plane, lens
        centre at C3 = f. With S = diag(1, −1, −1) and e3 = (0, 0, 1): C = S·X + f·e3, where f is the image distance.

`cam2world` (4, 4) maps cam coordinates to world coordinates; its last column is the position of the front nodal point.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from planner.exceptions import UncertaintyError

_CAM_TO_PAPER = np.diag([1.0, -1.0, -1.0])
_NAMES = ("dx", "dy", "dz", "phi_x", "phi_y", "phi_z")
MAX_SIGMA_MM = 100.0
MAX_SIGMA_RAD = 1.0


@dataclass(frozen=True, eq=False)
class PoseUncertainty:
    """How far the camera's real pose may be from the planned one.

    The real pose is ``cam2world @ D`` with D the rotation by the vector (phi_x, phi_y, phi_z) and the translation
    (dx, dy, dz): a displacement about the front nodal point, in the camera's own OpenCV axes, normal with mean zero.

    Parameters
    ----------
    covariance : array (6, 6)
        Over (dx, dy, dz, phi_x, phi_y, phi_z), in mm², mm·rad and rad².

    Raises
    ------
    UncertaintyError
        If it is not (6, 6), finite, symmetric and positive semi-definite, or if a standard deviation exceeds 100 mm or
        1 rad, which is the mark of wrong units.
    """

    covariance: np.ndarray

    def __post_init__(self):
        object.__setattr__(self, "covariance", _check_covariance(self.covariance))

    @classmethod
    def isotropic(cls, *, translation_mm: float, rotation_rad: float) -> PoseUncertainty:
        """Return independent, equal standard deviations along and about the three axes."""
        sigmas = np.repeat([translation_mm, rotation_rad], 3).astype(float)
        for name, value in (("translation_mm", translation_mm), ("rotation_rad", rotation_rad)):
            if not (np.isfinite(value) and value >= 0):
                raise UncertaintyError(f"{name} must be finite and not negative. Got {value!r}.")
        return cls(np.diag(sigmas**2))

    @classmethod
    def robot_hand_eye(
        cls,
        *,
        robot_translation_mm: float,
        robot_rotation_rad: float,
        hand_eye_translation_mm: float,
        hand_eye_rotation_rad: float,
        cam2flange,
    ) -> PoseUncertainty:
        """Combine the robot's repeatability at its flange with the uncertainty of the hand-eye calibration.

        Parameters
        ----------
        robot_translation_mm, robot_rotation_rad : float
            Standard deviations of the flange's pose, per axis, about the flange's origin.
        hand_eye_translation_mm, hand_eye_rotation_rad : float
            Standard deviations of the calibrated camera pose, per axis, about the nodal point.
        cam2flange : array (4, 4)
            The calibrated pose of the camera in the flange's frame. Its lever arm turns flange rotations into
            translations of the camera, correlated with the rotation.
        """
        cam2flange = np.asarray(cam2flange, dtype=float)
        if cam2flange.shape != (4, 4):
            raise UncertaintyError(f"cam2flange must have the shape (4, 4). Got {cam2flange.shape}.")
        robot = cls.isotropic(translation_mm=robot_translation_mm, rotation_rad=robot_rotation_rad).covariance
        hand_eye = cls.isotropic(translation_mm=hand_eye_translation_mm, rotation_rad=hand_eye_rotation_rad).covariance
        rotation, lever = cam2flange[:3, :3].T, cam2flange[:3, 3]
        jacobian = np.zeros((6, 6))
        jacobian[:3, :3] = jacobian[3:, 3:] = rotation
        jacobian[:3, 3:] = -rotation @ cross_matrix(lever)
        return cls(jacobian @ robot @ jacobian.T + hand_eye)

    @property
    def sigmas(self) -> np.ndarray:
        """Standard deviations (6,) of dx, dy, dz in mm and phi_x, phi_y, phi_z in rad."""
        return np.sqrt(np.diag(self.covariance))

    def paper_covariance(self, image_distance_mm: float) -> np.ndarray:
        """Return the covariance (6, 6) of the object's displacement (d, φ) in the paper's frame, eqs 6–9."""
        jacobian = paper_displacement_jacobian(image_distance_mm)
        covariance = jacobian @ self.covariance @ jacobian.T
        return (covariance + covariance.T) / 2

    def to_dict(self) -> dict:
        """Return the covariance as nested lists, ready for JSON."""
        return {"covariance": self.covariance.tolist()}

    @classmethod
    def from_dict(cls, data: Mapping) -> PoseUncertainty:
        """Build from the result of `to_dict`."""
        if "covariance" not in data:
            raise UncertaintyError(f"covariance must be given. Got {', '.join(map(str, data)) or 'nothing'}.")
        return cls(data["covariance"])

    def __eq__(self, other) -> bool:
        if not isinstance(other, PoseUncertainty):
            return NotImplemented
        return np.array_equal(self.covariance, other.covariance)

    def __hash__(self) -> int:
        return hash(self.covariance.tobytes())


def _check_covariance(covariance) -> np.ndarray:
    try:
        cov = np.array(covariance, dtype=np.float64)
    except (TypeError, ValueError):
        raise UncertaintyError(f"covariance must be a (6, 6) array of numbers. Got {covariance!r}.") from None
    if cov.shape != (6, 6):
        raise UncertaintyError(f"covariance must have the shape (6, 6). Got {cov.shape}.")
    if not np.isfinite(cov).all():
        raise UncertaintyError(f"covariance must be finite. Got {cov[~np.isfinite(cov)][0]}.")
    scale = np.abs(cov).max()
    if not np.allclose(cov, cov.T, rtol=0, atol=1e-9 * scale):
        raise UncertaintyError(f"covariance must be symmetric. Got a difference of {np.abs(cov - cov.T).max():g}.")
    cov = (cov + cov.T) / 2
    _check_semidefinite(cov)
    for name, sigma, limit, unit in zip(
        _NAMES,
        np.sqrt(np.diag(cov).clip(0)),
        [MAX_SIGMA_MM] * 3 + [MAX_SIGMA_RAD] * 3,
        ["mm"] * 3 + ["rad"] * 3,
        strict=True,
    ):
        if sigma > limit:
            raise UncertaintyError(
                f"covariance must have standard deviations of at most {limit:g} {unit} for {name} "
                f"(are its units mm and rad?). Got {sigma:g} {unit}."
            )
    cov.setflags(write=False)
    return cov


def _check_semidefinite(cov: np.ndarray) -> None:
    """Test the correlation matrix, so that millimetres and radians weigh the same."""
    variances = np.diag(cov)
    if variances.min() < 0:
        raise UncertaintyError(f"covariance must have non-negative variances. Got {variances.min():g}.")
    scale = np.where(variances > 0, np.sqrt(variances), 1.0)
    lowest = np.linalg.eigvalsh(cov / np.outer(scale, scale)).min()
    if lowest < -1e-9:
        raise UncertaintyError(f"covariance must be positive semi-definite. Got the (scaled) eigenvalue {lowest:g}.")


def cross_matrix(vector) -> np.ndarray:
    """Return the matrix (3, 3) of the map x -> vector × x."""
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def paper_displacement_jacobian(image_distance_mm: float) -> np.ndarray:
    """Return d(d, φ)/d(t, θ) (6, 6): the paper's object displacement caused by a displacement of the camera.

    A camera displaced by translation t and rotation θ about its nodal point sees, to first order, X' = X − θ×X − t.
    With C = S·X + f·e3 that is C' = C + φ×C + d for φ = −Sθ and d = −St + (Sθ)×(f·e3).
    """
    jacobian = np.zeros((6, 6))
    jacobian[:3, :3] = jacobian[3:, 3:] = -_CAM_TO_PAPER
    jacobian[:3, 3:] = -cross_matrix([0.0, 0.0, image_distance_mm]) @ _CAM_TO_PAPER
    return jacobian


def cam_to_paper(points_cam, image_distance_mm: float) -> np.ndarray:
    """Convert points (..., 3) from the OpenCV camera frame to the paper's: (x, −y, f − z)."""
    return np.asarray(points_cam, dtype=float) * [1.0, -1.0, -1.0] + [0.0, 0.0, image_distance_mm]


def world_to_cam(points, cam2world) -> np.ndarray:
    """Express world points in camera frames.

    Parameters
    ----------
    points : array (..., 3)
        World points, mm.
    cam2world : array (4, 4) or (n, 4, 4)
        Camera poses.

    Returns
    -------
    array (..., 3) or (n, ..., 3)
        The points in each camera's OpenCV frame, mm.
    """
    points, cam2world = np.asarray(points, dtype=float), np.asarray(cam2world, dtype=float)
    poses = cam2world.reshape(-1, 4, 4)
    flat = points.reshape(-1, 3)
    local = (flat[None] - poses[:, None, :3, 3]) @ poses[:, :3, :3]
    return local.reshape(cam2world.shape[:-2] + points.shape)


def aim(positions, target) -> np.ndarray:
    """Return rotations (n, 3, 3), cam to world, that look from positions (n, 3) to a target (3,) or (n, 3).

    The camera's x axis is level (perpendicular to the world's z axis) unless it looks along z; then it follows world x.
    """
    positions = np.asarray(positions, dtype=float)
    forward = np.asarray(target, dtype=float) - positions
    length = np.linalg.norm(forward, axis=-1, keepdims=True)
    forward = np.where(length > 0, forward / np.where(length > 0, length, 1.0), [0.0, 0.0, 1.0])
    # forward × z vanishes in a vertical view; world x, only nearly perpendicular then, is set upright below
    size = np.hypot(forward[..., 0], forward[..., 1])[..., None]
    level = np.stack([forward[..., 1], -forward[..., 0], np.zeros(size.shape[:-1])], axis=-1)
    right = np.where(size > 1e-9, level / np.where(size > 1e-9, size, 1.0), [1.0, 0.0, 0.0])
    down = _cross(forward, right)
    down /= np.linalg.norm(down, axis=-1, keepdims=True)
    return np.stack([_cross(down, forward), down, forward], axis=-1)


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return a × b (..., 3); several times faster than `np.cross` on the small arrays of one generation."""
    (ax, ay, az), (bx, by, bz) = np.moveaxis(a, -1, 0), np.moveaxis(b, -1, 0)
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)


def look_at(positions, target, pan=0.0, tilt=0.0, roll=0.0) -> np.ndarray:
    """Return poses (n, 4, 4) that look from positions at a target, then turn.

    Parameters
    ----------
    positions : array (n, 3)
        Front nodal points, mm.
    target : array (3,) or (n, 3)
        World point on the optical axis before turning, mm.
    pan, tilt, roll : array (n,) or float
        Rotations in rad, applied in this order about the camera's own y, x and z axes.
    """
    positions = np.atleast_2d(np.asarray(positions, dtype=float))
    n = len(positions)
    cam2world = np.tile(np.eye(4), (n, 1, 1))
    cam2world[:, :3, 3] = positions
    pan, tilt, roll = (np.broadcast_to(angle, (n,)) for angle in (pan, tilt, roll))
    cam2world[:, :3, :3] = (
        aim(positions, target) @ _axis_rotations(pan, 1) @ _axis_rotations(tilt, 0) @ _axis_rotations(roll, 2)
    )
    return cam2world


def _axis_rotations(angles: np.ndarray, axis: int) -> np.ndarray:
    """Return right-handed rotations (n, 3, 3) about one coordinate axis."""
    i, j = [(1, 2), (2, 0), (0, 1)][axis]
    rotation = np.zeros((len(angles), 3, 3))
    rotation[:, axis, axis] = 1.0
    rotation[:, i, i] = rotation[:, j, j] = np.cos(angles)
    rotation[:, j, i] = np.sin(angles)
    rotation[:, i, j] = -rotation[:, j, i]
    return rotation
