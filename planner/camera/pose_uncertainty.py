"""How far a camera's real pose may be from the planned one, and what that is in the paper's frame."""

from __future__ import annotations

import reprlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from planner.camera.pose import cross_matrix, paper_displacement_jacobian
from planner.exceptions import UncertaintyError

_NAMES = ("dx", "dy", "dz", "phi_x", "phi_y", "phi_z")
MAX_SIGMA_MM = 100.0
MAX_SIGMA_RAD = 1.0


@dataclass(frozen=True, eq=False)
class PoseUncertainty:
    """Uncertainty of a camera's real pose about the planned one.

    The real pose is ``cam2world @ D``. D is a displacement about the front nodal point, in the
    camera's own OpenCV axes. It rotates by the vector (phi_x, phi_y, phi_z) and translates by (dx,
    dy, dz). The six numbers are normal with mean zero.

    Parameters
    ----------
    covariance : array (6, 6)
        Covariance of (dx, dy, dz, phi_x, phi_y, phi_z), in mm², mm·rad and rad².

    Raises
    ------
    UncertaintyError
        If the covariance is not (6, 6), finite, symmetric and positive semi-definite. If a standard
        deviation exceeds 100 mm or 1 rad, which indicates wrong units.

    Examples
    --------
    >>> from planner import PoseUncertainty
    >>> PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.001).sigmas.tolist()
    [0.05, 0.05, 0.05, 0.001, 0.001, 0.001]
    """

    covariance: np.ndarray

    def __post_init__(self) -> None:
        object.__setattr__(self, "covariance", _check_covariance(self.covariance))

    @classmethod
    def isotropic(cls, *, translation_mm: float, rotation_rad: float) -> PoseUncertainty:
        """Make an uncertainty with independent errors, equal along and about the three axes.

        Parameters
        ----------
        translation_mm : float
            Standard deviation along each axis, mm.
        rotation_rad : float
            Standard deviation about each axis, rad.

        Returns
        -------
        PoseUncertainty
            With a diagonal covariance.

        Raises
        ------
        UncertaintyError
            If a value is negative, not finite or so large that its unit must be wrong.
        """
        sigmas = np.repeat([translation_mm, rotation_rad], 3).astype(float)
        for name, value in (("translation_mm", translation_mm), ("rotation_rad", rotation_rad)):
            if not (np.isfinite(value) and value >= 0):
                raise UncertaintyError.of_rule(name, "must be finite and not negative", repr(value))
        return cls(np.diag(sigmas**2))

    @classmethod
    def robot_hand_eye(
        cls,
        *,
        robot_translation_mm: float,
        robot_rotation_rad: float,
        hand_eye_translation_mm: float,
        hand_eye_rotation_rad: float,
        cam2flange: np.ndarray,
    ) -> PoseUncertainty:
        """Combine the robot's repeatability with the uncertainty of the hand-eye calibration.

        Parameters
        ----------
        robot_translation_mm, robot_rotation_rad : float
            Standard deviations of the flange's pose, per axis, about the flange's origin.
        hand_eye_translation_mm, hand_eye_rotation_rad : float
            Standard deviations of the calibrated camera pose, per axis, about the nodal point.
        cam2flange : array (4, 4)
            The calibrated pose of the camera in the flange's frame. Its lever arm turns flange rotations into
            translations of the camera, correlated with the rotation.

        Returns
        -------
        PoseUncertainty
            Uncertainty of the camera's pose about its nodal point.

        Raises
        ------
        UncertaintyError
            If `cam2flange` has another shape, or a standard deviation breaks the rule of `isotropic`.
        """
        cam2flange = np.asarray(cam2flange, dtype=float)
        if cam2flange.shape != (4, 4):
            raise UncertaintyError.of_rule(
                "cam2flange", "must have the shape (4, 4)", str(cam2flange.shape)
            )
        robot = cls.isotropic(
            translation_mm=robot_translation_mm, rotation_rad=robot_rotation_rad
        ).covariance
        hand_eye = cls.isotropic(
            translation_mm=hand_eye_translation_mm, rotation_rad=hand_eye_rotation_rad
        ).covariance
        rotation = cam2flange[:3, :3].T
        lever = cam2flange[:3, 3]
        jacobian = np.zeros((6, 6))
        jacobian[:3, :3] = jacobian[3:, 3:] = rotation
        jacobian[:3, 3:] = -rotation @ cross_matrix(lever)
        return cls(jacobian @ robot @ jacobian.T + hand_eye)

    @property
    def sigmas(self) -> np.ndarray:
        """Standard deviations (6,) of dx, dy, dz in mm and phi_x, phi_y, phi_z in rad."""
        return np.sqrt(np.diag(self.covariance))

    def paper_covariance(self, image_distance_mm: float) -> np.ndarray:
        """Return the covariance of the object's displacement (d, φ) in the paper's frame, eqs 6–9.

        Parameters
        ----------
        image_distance_mm : float
            Distance from the image plane to the lens centre, mm; `Camera.image_distance_mm`.

        Returns
        -------
        array, shape (6, 6)
            Over (dx, dy, dz, phi_x, phi_y, phi_z) in mm and rad, as `errors.success_probability` takes it.
        """
        jacobian = paper_displacement_jacobian(image_distance_mm)
        covariance = jacobian @ self.covariance @ jacobian.T
        return (covariance + covariance.T) / 2

    def to_dict(self) -> dict[str, Any]:
        """Return the covariance as nested lists, ready for JSON.

        Returns
        -------
        dict
            Under the key ``covariance``, six lists of six floats.
        """
        return {"covariance": self.covariance.tolist()}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> PoseUncertainty:
        """Build from the result of `to_dict`.

        Parameters
        ----------
        data : mapping of str to value
            With the key ``covariance``.

        Returns
        -------
        PoseUncertainty
            Equal to the one written.

        Raises
        ------
        UncertaintyError
            If the covariance is missing or breaks a rule.
        """
        if "covariance" not in data:
            raise UncertaintyError.of_rule(
                "covariance", "must be given", ", ".join(map(str, data)) or "nothing"
            )
        return cls(data["covariance"])

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, PoseUncertainty):
            return NotImplemented
        return np.array_equal(self.covariance, other.covariance)

    def __hash__(self) -> int:
        return hash(self.covariance.tobytes())


def _check_covariance(covariance: np.ndarray) -> np.ndarray:
    try:
        cov = np.array(covariance, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise UncertaintyError.of_rule(
            "covariance", "must be a (6, 6) array of numbers", reprlib.repr(covariance)
        ) from None
    if cov.shape != (6, 6):
        raise UncertaintyError.of_rule("covariance", "must have the shape (6, 6)", str(cov.shape))
    if not np.isfinite(cov).all():
        raise UncertaintyError.of_rule(
            "covariance", "must be finite", str(cov[~np.isfinite(cov)][0])
        )
    scale = np.abs(cov).max()
    if not np.allclose(cov, cov.T, rtol=0, atol=1e-9 * scale):
        raise UncertaintyError.of_rule(
            "covariance", "must be symmetric", f"a difference of {np.abs(cov - cov.T).max():g}"
        )
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
            raise UncertaintyError.of_rule(
                "covariance",
                f"must have standard deviations of at most {limit:g} {unit} for {name} "
                "(are its units mm and rad?)",
                f"{sigma:g} {unit}",
            )
    cov.setflags(write=False)
    return cov


def _check_semidefinite(cov: np.ndarray) -> None:
    """Test the correlation matrix, so that millimetres and radians weigh the same."""
    variances = np.diag(cov)
    if variances.min() < 0:
        raise UncertaintyError.of_rule(
            "covariance", "must have non-negative variances", f"{variances.min():g}"
        )
    scale = np.where(variances > 0, np.sqrt(variances), 1.0)
    lowest = np.linalg.eigvalsh(cov / np.outer(scale, scale)).min()
    if lowest < -1e-9:
        raise UncertaintyError.of_rule(
            "covariance", "must be positive semi-definite", f"the (scaled) eigenvalue {lowest:g}"
        )
