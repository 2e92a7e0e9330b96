"""Covariances against drawn joints, drawn hand-eye poses and drawn registrations, moved exactly."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from turning_arm import TurningArm

from planner import PoseUncertainty
from planner.exceptions import UncertaintyError
from planner.robotprogram.robot_program import ArmUncertainty, camera_jacobian

ARM = TurningArm()
JOINTS = np.array([[0.3, -1.1, 1.4, -0.7, 0.9, 0.2], [-1.0, -0.6, 1.9, 0.3, -1.2, 2.0]])
X = np.eye(4)
X[:3, :3] = Rotation.from_rotvec([0.2, -0.1, 0.8]).as_matrix()
X[:3, 3] = [20.0, 60.0, 120.0]
Y = np.eye(4)
Y[:3, :3] = Rotation.from_rotvec([0.0, 0.1, 1.0]).as_matrix()
Y[:3, 3] = [700.0, -100.0, 200.0]
N = 20_000


def motions(draws):
    """Rigid motions (n, 4, 4) by translation and rotation vector."""
    found = np.broadcast_to(np.eye(4), (len(draws), 4, 4)).copy()
    found[:, :3, :3] = Rotation.from_rotvec(draws[:, 3:]).as_matrix()
    found[:, :3, 3] = draws[:, :3]
    return found


def displacements(planned, real):
    """The six numbers of D in real = planned D."""
    moved = np.linalg.inv(planned) @ real
    return np.concatenate(
        [moved[:, :3, 3], Rotation.from_matrix(moved[:, :3, :3]).as_rotvec()], axis=1
    )


def assert_within_5_percent(covariance, drawn):
    found = np.cov(drawn.T)
    scale = np.sqrt(np.outer(np.diag(covariance), np.diag(covariance)))
    assert (np.abs(found - covariance) < 0.05 * scale).all()


@pytest.mark.parametrize("k", range(2))
def test_drawn_joints(k):
    rng = np.random.default_rng(k)
    sigmas = np.array([1e-4, 1e-4, 2e-4, 1e-4, 3e-4, 1e-4])
    covariance = ArmUncertainty(sigmas).covariances(ARM, JOINTS[[k]], X, Y)[0]
    drawn = JOINTS[k] + rng.normal(size=(N, 6)) * sigmas
    planned = ARM.forward(JOINTS[[k]])[0] @ X
    assert_within_5_percent(covariance, displacements(planned, ARM.forward(drawn) @ X))


def test_everything_is_drawn():
    rng = np.random.default_rng(9)
    hand_eye = PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.0005)
    part = PoseUncertainty(np.diag([0.1, 0.05, 0.02, 1e-4, 2e-4, 3e-4]) ** 2)
    given = ArmUncertainty(1e-4, hand_eye, part)
    covariance = given.covariances(ARM, JOINTS[[0]], X, Y)[0]
    joints = JOINTS[0] + rng.normal(size=(N, 6)) * 1e-4
    camera = ARM.forward(joints) @ X @ motions(rng.normal(size=(N, 6)) * hand_eye.sigmas)
    registered = Y @ motions(rng.normal(size=(N, 6)) * part.sigmas)
    planned = np.linalg.inv(Y) @ ARM.forward(JOINTS[[0]])[0] @ X
    assert_within_5_percent(covariance, displacements(planned, np.linalg.inv(registered) @ camera))


def test_first_joint_by_hand():
    """A turn about the base's axis moves the nodal point by its distance from that axis."""
    moves = camera_jacobian(ARM, JOINTS, X)
    camera = ARM.forward(JOINTS) @ X
    radius = np.linalg.norm(camera[:, :2, 3], axis=1)
    assert np.linalg.norm(moves[:, :3, 0], axis=1) == pytest.approx(radius, rel=1e-6)
    assert np.linalg.norm(moves[:, 3:, 0], axis=1) == pytest.approx(1.0, rel=1e-6)


@pytest.mark.parametrize("given", [-1e-4, np.nan, 2.0, "much", [[1e-4]]])
def test_wrong_sigmas_are_refused(given):
    with pytest.raises(UncertaintyError, match="joints_rad must be in"):
        ArmUncertainty(given)
