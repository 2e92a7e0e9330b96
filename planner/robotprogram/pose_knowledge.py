"""P of a setting's targets with the uncertainty that the arm has at this setting."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import ArrayLike

from planner.camera.pose import MAX_SIGMA_RAD, PoseUncertainty
from planner.exceptions import UncertaintyError
from planner.request.models import EdgeModels
from planner.request.registration import OWN_EDGES, means_at
from planner.request.targets import EdgeTarget, targets_of
from planner.verify.simulate_setting import SuccessRate, simulate_setting

if TYPE_CHECKING:
    from planner.plan import InspectionPlan
    from planner.sensor_setting import SensorSetting


# How far the camera is from its planned pose, by the joints of the arm that holds it.
#
# Σ(q) = A diag(σ²) Aᵀ + H + B Σ_part Bᵀ, about the nodal point and in the camera's own axes, as
# `planner.PoseUncertainty`. A maps small turns of the joints to a displacement of the camera,
# through the lever of the hand-eye pose; H is the uncertainty of that pose; B carries the part's
# registration from the part's origin to the camera.


class Kinematics(Protocol):
    """What Σ(q) needs of a robot; `planner.robotcell.Robot` has it."""

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


def stated_probabilities(
    plan: InspectionPlan, setting: SensorSetting, covariances: np.ndarray
) -> list[dict[str, float]]:
    """Return P of the targets of a setting for several covariances of the camera's pose.

    Parameters
    ----------
    plan : InspectionPlan
        Gives targets, camera and accuracy.
    setting : SensorSetting
        One of its settings.
    covariances : array (n, 6, 6)
        As `PoseUncertainty` has them.

    Returns
    -------
    list of dict of str to float
        P by target for each covariance, given that the image shows the target.
    """
    return [_probabilities(plan, _of_arm(plan, setting, one), one) for one in covariances]


def _of_arm(plan: InspectionPlan, setting: SensorSetting, covariance: np.ndarray) -> SensorSetting:
    """Return a setting whose registration begins with the uncertainty of an arm."""
    known = setting.registered
    registration = plan.request.registration
    if known is None or registration is None or registration.method != OWN_EDGES:
        return setting
    return replace(
        setting, registered=known.with_prior(plan.pose_uncertainty.covariance, covariance)
    )


def _probabilities(
    plan: InspectionPlan, setting: SensorSetting, covariance: np.ndarray
) -> dict[str, float]:
    by_arm = replace(plan.means, pose_uncertainty=PoseUncertainty(covariance))
    targets = targets_of(plan.targets, setting)
    found = {}
    for name in setting.entities:
        target = targets[name]
        means = means_at(by_arm, setting, name)
        if isinstance(target, EdgeTarget):
            own = replace(means, accuracy=target.accuracy)
            model = EdgeModels(target.ends[None], own)
            seen = model.probability_where(setting.cam2world[None], np.ones((1, 1), dtype=bool))
            found[name] = float(seen[0])
        else:
            found[name] = float(target.describe(setting.cam2world, means).probability)
    return found


def shortfalls(probabilities: Sequence[dict[str, float]]) -> np.ndarray:
    """Return how much worse each of several branches is than the best: 0 for the best, at most 1.

    Parameters
    ----------
    probabilities : sequence of dict of str to float
        P by target for each branch.

    Returns
    -------
    array (n,)
        Differences of the smallest P.
    """
    worst = np.array([min(found.values(), default=1.0) for found in probabilities])
    return worst.max(initial=0.0) - worst


def simulated_rates(
    plan: InspectionPlan,
    setting: SensorSetting,
    stated: Mapping[str, float],
    covariance: np.ndarray,
    n: int,
    seed: list[int],
) -> dict[str, SuccessRate]:
    """Measure the targets of a setting from displaced poses of an arm.

    Parameters
    ----------
    plan : InspectionPlan
        Gives targets, camera and accuracy.
    setting : SensorSetting
        One of its settings.
    stated : mapping of str to float
        P by target, which the result is compared with.
    covariance : array (6, 6)
        Of the camera's pose with this arm.
    n : int
        Displaced poses.
    seed : list of int
        Of these poses.

    Returns
    -------
    dict of str to SuccessRate
        By target. A target outside of the image counts as a failure.
    """
    return simulate_setting(
        replace(_of_arm(plan, setting, covariance), probability=dict(stated), p_all={}),
        plan.targets,
        plan.camera,
        PoseUncertainty(covariance),
        accuracy=plan.accuracy,
        n=n,
        rng=np.random.default_rng(seed),
    )
