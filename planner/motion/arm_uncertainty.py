"""How far the camera is from its planned pose, by the joints of the arm that holds it.

Σ(q) = A diag(σ²) Aᵀ + H + B Σ_part Bᵀ, about the nodal point and in the camera's own axes, as
`planner.PoseUncertainty`. A maps small turns of the joints to a displacement of the camera, through
the lever of the hand-eye pose; H is the uncertainty of that pose; B carries the part's registration
from the part's origin to the camera.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from planner.camera.pose_uncertainty import MAX_SIGMA_RAD, PoseUncertainty
from planner.exceptions import UncertaintyError


class Kinematics(Protocol):
    """What Σ(q) needs of a robot; `planner.robot.Robot` has it."""

    def forward(self, joints: np.ndarray) -> np.ndarray:
        """Return the poses (n, 4, 4) of the tip in the base, mm."""

    def jacobian(self, joints: np.ndarray) -> np.ndarray:
        """Return (n, 6, k): translation of the tip in mm/rad, then its rotation, in the base's axes."""


@dataclass(frozen=True)
class ArmUncertainty:
    """Standard deviations of an arm, of its hand-eye calibration and of the part's registration.

    Errors of joints are usually systematic: an offset of a joint is the same in all settings.

    Parameters
    ----------
    joints_rad : float or array (k,)
        Standard deviation of each joint, rad.
    hand_eye : PoseUncertainty, optional
        Of the camera on the flange, about the nodal point, in the camera's axes. Default: none.
    part : PoseUncertainty, optional
        Of the part in the base, about the part's origin, in the part's axes. Default: none.

    Raises
    ------
    UncertaintyError
        If `joints_rad` is negative, not finite or above 1 rad.

    Examples
    --------
    >>> from planner import ArmUncertainty, PoseUncertainty
    >>> hand_eye = PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.0005)
    >>> ArmUncertainty(0.0001, hand_eye).joints_rad
    0.0001
    """

    joints_rad: ArrayLike
    hand_eye: PoseUncertainty | None = None
    part: PoseUncertainty | None = None

    def __post_init__(self) -> None:
        sigmas = np.asarray(self.joints_rad)
        is_number = sigmas.dtype.kind in "fiu" and sigmas.ndim <= 1
        if not (is_number and (sigmas >= 0).all() and (sigmas <= MAX_SIGMA_RAD).all()):
            rule = f"must be in [0, {MAX_SIGMA_RAD:g}] rad, one number or one per joint"
            raise UncertaintyError.of_rule("joints_rad", rule, repr(self.joints_rad))

    def covariances(
        self, robot: Kinematics, joints: np.ndarray, cam2flange: np.ndarray, part2base: np.ndarray
    ) -> np.ndarray:
        """Return Σ(q) for joints.

        Parameters
        ----------
        robot : Robot
            Its kinematics.
        joints : array (n, k)
            Joints, rad.
        cam2flange : array (4, 4)
            Camera on the flange, mm.
        part2base : array (4, 4)
            The part in the robot's base, mm.

        Returns
        -------
        array (n, 6, 6)
            Covariances of (dx, dy, dz, phi_x, phi_y, phi_z), mm and rad.
        """
        by_joints = camera_jacobian(robot, joints, cam2flange)
        sigmas = np.broadcast_to(np.asarray(self.joints_rad, dtype=float), (joints.shape[-1],))
        scaled = by_joints * sigmas
        found = np.einsum("nij,nkj->nik", scaled, scaled)
        if self.hand_eye is not None:
            found = found + self.hand_eye.covariance
        if self.part is not None:
            camera = robot.forward(joints) @ cam2flange
            by_part = registration_jacobian(np.linalg.inv(part2base) @ camera)
            found = found + by_part @ self.part.covariance @ by_part.transpose(0, 2, 1)
        return (found + found.transpose(0, 2, 1)) / 2

    def covariances_held(
        self, robot: Kinematics, joints: np.ndarray, part2flange: np.ndarray, cam2part: np.ndarray
    ) -> np.ndarray:
        """Return Σ(q) for joints of an arm that holds the part before a camera that stands still.

        `hand_eye` is then the uncertainty of the camera in the base, about the nodal point and in
        the camera's axes. `part` is that of the part in the hand, about the part's origin.

        Parameters
        ----------
        robot : Robot
            Its kinematics.
        joints : array (n, k)
            Joints, rad.
        part2flange : array (4, 4)
            The part in the robot's tip, mm.
        cam2part : array (4, 4)
            The camera in the part's frame, mm: that of a setting.

        Returns
        -------
        array (n, 6, 6)
            As of `covariances`.
        """
        by_part = registration_jacobian(cam2part[None])
        sigmas = np.broadcast_to(np.asarray(self.joints_rad, dtype=float), (joints.shape[-1],))
        # the joints move the part as they would move a camera in its place
        scaled = by_part @ camera_jacobian(robot, joints, part2flange) * sigmas
        found = np.einsum("nij,nkj->nik", scaled, scaled)
        if self.hand_eye is not None:
            found = found + self.hand_eye.covariance
        if self.part is not None:
            found = found + by_part @ self.part.covariance @ by_part.transpose(0, 2, 1)
        return (found + found.transpose(0, 2, 1)) / 2


def camera_jacobian(robot: Kinematics, joints: np.ndarray, cam2flange: np.ndarray) -> np.ndarray:
    """Return what small turns of the joints do to the camera, about its nodal point and in its axes.

    Parameters
    ----------
    robot : Robot
        Its kinematics.
    joints : array (n, k)
        Joints, rad.
    cam2flange : array (4, 4)
        Camera on the flange, mm.

    Returns
    -------
    array (n, 6, k)
        Translation in mm/rad, then rotation.
    """
    tips = robot.forward(joints)
    moves = robot.jacobian(joints)
    turns = moves[:, 3:]
    lever = tips[:, :3, :3] @ cam2flange[:3, 3]
    # a turn about an axis through the tip moves the nodal point by turn × lever
    shifts = moves[:, :3] + np.cross(turns, lever[:, :, None], axis=1)
    to_camera = (tips[:, :3, :3] @ cam2flange[:3, :3]).transpose(0, 2, 1)
    return np.concatenate([to_camera @ shifts, to_camera @ turns], axis=1)


def registration_jacobian(cam2part: np.ndarray) -> np.ndarray:
    """Return what a small motion of the part does to cameras, as seen from the part.

    Parameters
    ----------
    cam2part : array (n, 4, 4)
        Camera poses in the part's frame, mm.

    Returns
    -------
    array (n, 6, 6)
        From a motion about the part's origin to one about the nodal point, in the camera's axes.
    """
    to_camera = cam2part[:, :3, :3].transpose(0, 2, 1)
    axes = np.eye(3)[None]
    place = cam2part[:, :3, 3][:, :, None]
    found = np.zeros((len(cam2part), 6, 6))
    found[:, :3, :3] = -to_camera
    found[:, 3:, 3:] = -to_camera
    found[:, :3, 3:] = -to_camera @ np.cross(axes, place, axis=1)
    return found
