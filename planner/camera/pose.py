"""Camera poses and the two camera frames.

Frames
------
world   the part's frame, millimetres.
cam     OpenCV camera frame: origin at the front nodal point, x right, y down, z forward along the optical axis.
paper   the frame of Yang & Ciarallo (2001), eqs 4–9: C1 right, C2 up, C3 backwards, origin on the image plane, lens
        centre at C3 = f. With S = diag(1, −1, −1) and e3 = (0, 0, 1): C = S·X + f·e3, where f is the image distance.

`cam2world` (4, 4) maps cam coordinates to world coordinates; its last column is the position of the front nodal point.
"""

from __future__ import annotations

import math
import reprlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ground.convert import Meta, Shape, to_plain
from planner.argument_kinds import NOT_NEGATIVE, kind_shown, shown, suggests_names, takes_names
from planner.exceptions import RequestError, UncertaintyError
from planner.plan_file import Pose

_CAM_TO_PAPER = np.diag([1.0, -1.0, -1.0])


def cross_matrix(vector: np.ndarray) -> np.ndarray:
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
    jacobian[:3, 3:] = -cross_matrix(np.array([0.0, 0.0, image_distance_mm])) @ _CAM_TO_PAPER
    return jacobian


def cam_to_paper(points_cam: np.ndarray, image_distance_mm: float) -> np.ndarray:
    """Convert points (..., 3) from the OpenCV camera frame to the paper's: (x, −y, f − z)."""
    return np.asarray(points_cam, dtype=float) * [1.0, -1.0, -1.0] + [0.0, 0.0, image_distance_mm]


def world_to_cam(points: np.ndarray, cam2world: np.ndarray) -> np.ndarray:
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
    points = np.asarray(points, dtype=float)
    cam2world = np.asarray(cam2world, dtype=float)
    poses = cam2world.reshape(-1, 4, 4)
    flat = points.reshape(-1, 3)
    local = (flat[None] - poses[:, None, :3, 3]) @ poses[:, :3, :3]
    return local.reshape(cam2world.shape[:-2] + points.shape)


def aim(positions: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Return rotations (n, 3, 3), cam to world, that look from positions (n, 3) to a target (3,) or (n, 3).

    The camera's x axis is level (perpendicular to the world's z axis) unless it looks along z; then it follows world x.
    """
    return aimed_poses(positions, target)[:, :3, :3]


@suggests_names
def look_at(
    positions: np.ndarray,
    target: np.ndarray,
    pan: np.ndarray | float = 0.0,
    tilt: np.ndarray | float = 0.0,
    roll: np.ndarray | float = 0.0,
) -> np.ndarray:
    """Return poses (n, 4, 4) that look from positions at a target, then turn.

    Parameters
    ----------
    positions : array (n, 3)
        Front nodal points, mm.
    target : array (3,) or (n, 3)
        World point on the optical axis before turning, mm.
    pan, tilt, roll : array (n,) or float
        Rotations in rad, applied in this order about the camera's own y, x and z axes.

    Returns
    -------
    array (n, 4, 4)
        Poses cam2world in OpenCV axes (x right, y down, z forward), mm. Before turning, the camera's x axis is level,
        unless it looks along the world's z axis; then it follows world x.

    Raises
    ------
    RequestError
        If an array has another shape or holds a number that is not finite. If a position is its target.

    Examples
    --------
    >>> from planner import look_at
    >>> pose = look_at([[0, 0, 100]], [0, 0, 0])[0]
    >>> pose[:3, 2].tolist(), pose[:3, 3].tolist()
    ([0.0, 0.0, -1.0], [0.0, 0.0, 100.0])
    """
    eyes = np.atleast_2d(_finite_numbers("positions", positions))
    if eyes.ndim != 2 or eyes.shape[1] != 3:
        raise RequestError.of_rule(
            "positions", "must have the shape (n, 3)", str(np.shape(positions))
        )
    n = len(eyes)
    points = _finite_numbers("target", target)
    if points.shape not in {(3,), (1, 3), (n, 3)}:
        rule = f"must have the shape (3,), or ({n}, 3) like positions"
        raise RequestError.of_rule("target", rule, str(points.shape))
    same = (eyes == points).all(axis=1)
    if same.any():
        shared = eyes[np.argmax(same)].tolist()
        raise RequestError.of_rule("target", "must not be the camera's position", str(shared))
    turns = {"pan": pan, "tilt": tilt, "roll": roll}
    for name, turn in turns.items():
        angles = _finite_numbers(name, turn)
        if angles.shape not in {(), (1,), (n,)}:
            rule = f"must be a number or have the shape ({n},)"
            raise RequestError.of_rule(name, rule, str(angles.shape))
    return aimed_poses(eyes, points, **turns)


def aimed_poses(
    positions: np.ndarray,
    target: np.ndarray,
    pan: np.ndarray | float = 0.0,
    tilt: np.ndarray | float = 0.0,
    roll: np.ndarray | float = 0.0,
) -> np.ndarray:
    """Return the poses (n, 4, 4) of `look_at` without its checks, for searches.

    A camera at its own target looks along the world's z axis.
    """
    # compiled, and so imported when first needed
    from planner.camera.pose_loops import look_along

    # of one layout, so that one version of the loop is compiled
    positions = np.array(positions, dtype=np.float64, order="C", ndmin=2)
    n = len(positions)
    # copied, so that the loop is compiled for one kind of array
    target = np.array(np.broadcast_to(target, (n, 3)), dtype=np.float64, order="C")
    turns = np.empty((3, n))
    turns[0] = pan
    turns[1] = tilt
    turns[2] = roll
    cam2world = np.zeros((n, 4, 4))
    look_along(positions, target, turns, cam2world)
    return cam2world


def _finite_numbers(name: str, value: Any) -> np.ndarray:
    """Return an array of finite numbers, or raise `RequestError` with the name of the parameter."""
    try:
        numbers = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise RequestError.of_rule(
            name, "must be an array of numbers", reprlib.repr(value)
        ) from None
    if not np.isfinite(numbers).all():
        raise RequestError.of_rule(name, "must be finite", str(numbers[~np.isfinite(numbers)][0]))
    return numbers


def pose_between(first: np.ndarray, last: np.ndarray, part: float) -> np.ndarray:
    """Return the pose (4, 4) after a part of the straight way and of the turn to another one, less than half a turn."""
    turn = [
        [math.fsum(float(first[k, i] * last[k, j]) for k in range(3)) for j in range(3)]
        for i in range(3)
    ]
    axis = [turn[2][1] - turn[1][2], turn[0][2] - turn[2][0], turn[1][0] - turn[0][1]]
    twice_sine = math.hypot(*axis)
    angle = math.atan2(twice_sine, turn[0][0] + turn[1][1] + turn[2][2] - 1.0)
    share = part * angle / twice_sine if twice_sine > 0.0 else 0.0
    between = moved(first, np.array([[0.0, 0.0, 0.0, *(share * x for x in axis)]]), 1.0)[0]
    between[:3, 3] = first[:3, 3] + part * (last[:3, 3] - first[:3, 3])
    return np.asarray(between)


def moved(cam2world: np.ndarray, moves: np.ndarray, unit_mm: float) -> np.ndarray:
    """Return the poses (n, 4, 4) reached from one pose (4, 4) by moves (n, 6) along and about its own axes.

    The first three entries are a translation in units of `unit_mm`, the others a rotation vector in rad.
    """
    from planner.camera.pose_loops import move

    poses = np.zeros((len(moves), 4, 4))
    move(cam2world, moves, unit_mm, poses)
    return poses


# How far a camera's real pose may be from the planned one, and what that is in the paper's frame.


_NAMES = ("dx", "dy", "dz", "phi_x", "phi_y", "phi_z")
MAX_SIGMA_MM = 100.0
PLAIN_SIGMA_RAD = 0.1
"""Standard deviations of a rotation above this were rather meant as mrad or degrees, rad."""
MAX_SIGMA_RAD = 1.0


Covariance = Annotated[NDArray[np.float64], Shape(6, 6), Meta(ge=-1e9, le=1e9)]
"""Over the camera's displacement (dx, dy, dz) and rotation (phi_x, phi_y, phi_z) in its own axes."""


@dataclass(frozen=True, eq=False)
class GivenPose:
    """A camera pose that exists, such as one that a robot was taught.

    Attributes
    ----------
    name : str
        What it is called where it comes from.
    cam2world : array (4, 4)
        Pose in OpenCV axes (x right, y down, z forward), mm, in the part's frame.

    Examples
    --------
    >>> from planner import GivenPose, look_at
    >>> GivenPose("taught", look_at([[0, 0, 300]], [0, 0, 0])[0])
    <GivenPose 'taught' from (0.0, 0.0, 300.0) mm>
    """

    name: str
    cam2world: Pose

    def __repr__(self) -> str:
        """Return a one-line summary."""
        place = ", ".join(f"{c:.1f}" for c in self.cam2world[:3, 3])
        return f"<GivenPose {self.name!r} from ({place}) mm>"


class HoldsPoses(Protocol):
    """What holds poses, such as a `PoseFile`."""

    @property
    def poses(self) -> tuple[GivenPose, ...]:
        """The poses."""


# noise of rotations that are computed
_OFF_RIGID = 1e-6


def _why_not_rigid(pose: Pose, off: float) -> str:
    """Say what keeps a pose from being rigid; ``off`` is the largest number of R Rᵀ − 1."""
    if not np.isfinite(pose).all():
        return "which holds a number that is not finite"
    determinant = f"the determinant {np.linalg.det(pose[:3, :3]):.6g}"
    if off < _OFF_RIGID:
        return f"which is mirrored: its rotation has {determinant}"
    return f"whose rotation R has {determinant}, and R Rᵀ is off the identity by {off:.2g}"


def checked_poses(poses: Any) -> tuple[GivenPose, ...]:
    """Return poses that are given, or raise `RequestError`.

    Parameters
    ----------
    poses : sequence of GivenPose, PoseFile, or array_like (n, 4, 4)
        An array gets the names pose_01, pose_02, and so on.
    """
    # what `read_poses` returns holds them
    held = getattr(poses, "poses", None)
    items = _named_poses(held if isinstance(held, tuple) else poses)
    names = [pose.name for pose in items]
    for pose in items:
        if pose.cam2world.shape != (4, 4):
            rule = "must have the shape (n, 4, 4)"
            raise RequestError.of_rule("poses", rule, f"{pose.cam2world.shape} for {pose.name!r}")
        turn = pose.cam2world[:3, :3]
        off = np.abs(turn @ turn.T - np.eye(3)).max()
        if not (np.isfinite(pose.cam2world).all() and off < _OFF_RIGID and np.linalg.det(turn) > 0):
            got = f"{pose.name!r}, {_why_not_rigid(pose.cam2world, off)}"
            raise RequestError.of_rule("poses", "must be rigid", got)
        last = pose.cam2world[3].tolist()
        if last != [0.0, 0.0, 0.0, 1.0]:
            is_turned = pose.cam2world[:, 3].tolist() == [0.0, 0.0, 0.0, 1.0]
            rule = "must have the last row [0, 0, 0, 1], and the position in the last column"
            got = f"{last} in {pose.name!r}{', which is transposed' * is_turned}"
            raise RequestError.of_rule("poses", rule, got)
        if names.count(pose.name) > 1:
            raise RequestError.of_rule("poses", "must have different names", f"{pose.name!r} twice")
    return tuple(items)


def _named_poses(poses: Any) -> list[GivenPose]:
    """Return poses with their names, not checked."""
    if isinstance(poses, str) or not isinstance(poses, Iterable):
        rule = "must be a list of GivenPose or an array (n, 4, 4)"
        raise RequestError.of_rule("poses", rule, kind_shown(poses))
    items = list(poses)
    if not items:
        raise RequestError.of_rule("poses", "must hold at least one pose", "none")
    if all(isinstance(pose, GivenPose) for pose in items):
        return items
    try:
        arrays = [np.array(pose, dtype=np.float64) for pose in items]
    except (TypeError, ValueError):
        rule = "must all be GivenPose, or arrays of numbers"
        raise RequestError.of_rule("poses", rule, shown(poses)) from None
    if arrays[0].ndim == 1:
        # rows, so that this is a pose and not a list of poses
        hint = "an array of one pose has the shape (1, 4, 4)"
        shape = f"({len(arrays)}, {len(arrays[0])})"
        raise RequestError.of_rule("poses", "must have the shape (n, 4, 4)", shape, hint=hint)
    return [GivenPose(f"pose_{k:02d}", array) for k, array in enumerate(arrays, 1)]


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

    covariance: Covariance

    def __repr__(self) -> str:
        """Return a one-line summary: the standard deviations."""
        shift, turn = (
            ", ".join(f"{sigma:.4g}" for sigma in part) for part in self.sigmas.reshape(2, 3)
        )
        return f"<PoseUncertainty: {shift} mm, {turn} rad>"

    def __post_init__(self) -> None:
        object.__setattr__(self, "covariance", _check_covariance(self.covariance))

    @classmethod
    @takes_names(
        "translation_mm in mm and rotation_rad in rad",
        "PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.001)",
    )
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
            If a value is negative, not finite or so large that its unit must be wrong: above 100 mm or
            0.1 rad (5.7°). A larger rotation is stated by its covariance.
        TypeError
            If a value is not named, missing or not known.
        """
        for name, value in (("translation_mm", translation_mm), ("rotation_rad", rotation_rad)):
            if not NOT_NEGATIVE.accepts(value):
                raise UncertaintyError.of_rule(name, NOT_NEGATIVE.text, shown(value))
        if translation_mm > MAX_SIGMA_MM:
            rule = f"must have standard deviations of at most {MAX_SIGMA_MM:g} mm"
            hint = f"{translation_mm:g} µm are {translation_mm / 1000:g} mm"
            raise UncertaintyError.of_rule(
                "translation_mm", rule, f"{translation_mm:g} mm", hint=hint
            )
        sigmas = np.repeat([translation_mm, rotation_rad], 3).astype(float)
        if rotation_rad > PLAIN_SIGMA_RAD:
            rule = f"must be at most {PLAIN_SIGMA_RAD} rad, or be stated by the covariance"
            got = f"{rotation_rad:g} rad, which are {math.degrees(rotation_rad):.3g}°"
            hint = f"{rotation_rad:g}° are {math.radians(rotation_rad):.3g} rad"
            raise UncertaintyError.of_rule("rotation_rad", rule, got, hint=hint)
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
        return to_plain(self)

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
