"""The robot: an arm of six or seven turning joints, read from a URDF."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from aspectgraph.files import read_text
from planner.argument_kinds import POSITIVE, shown
from planner.camera.calibration_files import tree_of
from planner.exceptions import CameraError, RobotError
from planner.robotcell.bodies import Hull, hull_of, read_triangles, round_points
from planner.robotcell.branches import Branches, Chain
from planner.robotcell.redundancy import RedundantBranches, branches_of
from planner.robotcell.urdf import (
    COLLADA,
    JOINT_COUNTS,
    LinkShape,
    UrdfArm,
    calibrated_text,
    carry,
    check_pose,
    check_rotations,
    collada_points,
    compose,
    rate_of_each,
    read_urdf,
)

# The axes that a controller counts, where they are not the joints of the URDF.
#
# A parallel rod, as of ABB's IRB 2400, keeps the forearm's angle to the horizon while joint 2
# turns. Its controller counts this angle as axis 3: joint 3 plus joint 2. Controllers of FANUC
# count so, too.


_LARGEST_FACTOR = 10.0
_LEAST_DETERMINANT = 1e-3


class ControllerAxes:
    """How the controller's axes follow from the joints: each is its joint, plus shares of others.

    Parameters
    ----------
    coupled : sequence of (int, int, float)
        Axis, joint and factor: the axis is its own joint plus the factor times this joint. Numbers from 1.
    limits : sequence of (int, float, float)
        Axis, its least and its largest angle, rad. The joints keep the limits of the URDF as well.
    n_joints : int
        Joints of the arm.

    Raises
    ------
    RobotError
        If one of them breaks its rule.

    Examples
    --------
    >>> import numpy as np
    >>> axes = ControllerAxes([(3, 2, 1.0)])
    >>> axes.of(np.array([0.0, 0.5, 0.1, 0.0, 0.0, 0.0]))
    array([0. , 0.5, 0.6, 0. , 0. , 0. ])
    """

    def __init__(
        self, coupled: Any = (), limits: Any = (), n_joints: int = JOINT_COUNTS[0]
    ) -> None:
        self.n_joints = n_joints
        rows = [
            _numbers("coupled", _COUPLED, row, n_joints)
            for row in _rows("coupled", _COUPLED, coupled)
        ]
        for row in rows:
            _check_coupled(row, n_joints)
        self.coupled = tuple((int(axis), int(joint), factor) for axis, joint, factor in rows)
        self.matrix = np.eye(n_joints)
        for axis, joint, factor in self.coupled:
            if self.matrix[axis - 1, joint - 1] != 0.0:
                got = f"axis {axis} and joint {joint} twice"
                raise RobotError.of_rule("coupled", "must name a pair once", got)
            self.matrix[axis - 1, joint - 1] = factor
        if abs(np.linalg.det(self.matrix)) < _LEAST_DETERMINANT:
            rule = "must leave joints that follow from the axes"
            raise RobotError.of_rule("coupled", rule, shown([list(row) for row in self.coupled]))
        self.inverse = np.linalg.inv(self.matrix)
        rows = [
            _numbers("axis_limits", _LIMITS, row, n_joints)
            for row in _rows("axis_limits", _LIMITS, limits)
        ]
        self.limits = tuple((int(axis), low, high) for axis, low, high in rows)
        self.lower = np.full(n_joints, -np.inf)
        self.upper = np.full(n_joints, np.inf)
        for axis, low, high in self.limits:
            if not low < high:
                got = f"{np.degrees(low):g} and {np.degrees(high):g} degrees for axis {axis}"
                raise RobotError.of_rule(
                    "axis_limits", "must go from a smaller angle to a larger one", got
                )
            self.lower[axis - 1] = low
            self.upper[axis - 1] = high

    @property
    def is_plain(self) -> bool:
        """Whether the axes are the joints, with their limits alone."""
        return not self.coupled and not self.limits

    def of(self, joints: np.ndarray) -> np.ndarray:
        """Return the axes of joints.

        Parameters
        ----------
        joints : array (..., k)
            Rad; what stands behind the joints is taken over.

        Returns
        -------
        array (..., k)
            Rad.
        """
        return _mapped(self.matrix, joints)

    def joints(self, axes: np.ndarray) -> np.ndarray:
        """Return the joints of axes, see `of`."""
        return _mapped(self.inverse, axes)

    def margin(self, joints: np.ndarray) -> np.ndarray:
        """Return how far the axes of joints (n, k) are from their limits (n,), rad; negative beyond one."""
        axes = self.of(joints[..., : self.n_joints])
        return np.asarray(np.minimum(axes - self.lower, self.upper - axes).min(axis=-1))

    def spread(self) -> np.ndarray:
        """Return by how much each joint (k,) may be off where every axis is off by 1, at least 1."""
        return np.asarray(np.maximum(np.abs(self.inverse).sum(axis=1), 1.0))

    def texts(self) -> list[str]:
        """Return in words what differs from the joints, an axis each."""
        texts = []
        for axis in sorted({row[0] for row in (*self.coupled, *self.limits)}):
            text = f"axis {axis} of the controller is joint {axis}"
            for k, joint, factor in self.coupled:
                if k == axis:
                    text += f" {'-' if factor < 0 else '+'} {abs(factor):g} x joint {joint}"
            for k, low, high in self.limits:
                if k == axis:
                    text += f", from {np.degrees(low):g} to {np.degrees(high):g} degrees"
            texts.append(text)
        return texts


_COUPLED = "must hold three numbers each: an axis, a joint and a factor"
_LIMITS = "must hold three numbers each: an axis, its least and its largest angle"


def _mapped(matrix: np.ndarray, values: np.ndarray) -> np.ndarray:
    vectors = np.asarray(values, dtype=np.float64)
    first = vectors[..., : len(matrix)] @ matrix.T
    return np.concatenate([first, vectors[..., len(matrix) :]], axis=-1)


def _rows(name: str, rule: str, value: Any) -> Sequence[Any]:
    if isinstance(value, str) or not isinstance(value, Sequence):
        raise RobotError.of_rule(name, rule, shown(value))
    return value


def _numbers(name: str, rule: str, row: Any, n_joints: int) -> tuple[float, float, float]:
    """Return an axis and two finite numbers."""
    try:
        first, second, third = (float(number) for number in row)
    except (TypeError, ValueError, OverflowError):
        raise RobotError.of_rule(name, rule, shown(row)) from None
    if isinstance(row, str) or any(isinstance(number, bool | str) for number in row):
        raise RobotError.of_rule(name, rule, shown(row))
    if not np.isfinite([first, second, third]).all():
        raise RobotError.of_rule(name, "must be finite", shown(row))
    if first not in range(1, n_joints + 1):
        rule = f"must begin with the number of an axis, from 1 to {n_joints}"
        raise RobotError.of_rule(name, rule, shown(row))
    return first, second, third


def _check_coupled(row: tuple[float, float, float], n_joints: int) -> None:
    axis, joint, factor = row
    if joint not in range(1, n_joints + 1) or joint == axis:
        rule = f"must name another joint, from 1 to {n_joints}"
        raise RobotError.of_rule("coupled", rule, shown(list(row)))
    if not 0.0 < abs(factor) <= _LARGEST_FACTOR:
        rule = f"must have a factor that is not 0 and at most {_LARGEST_FACTOR:g}"
        raise RobotError.of_rule("coupled", rule, shown(list(row)))


_LARGEST_LINK_MM = 20_000.0
_UNIT_LENGTH_MM = 500.0


@dataclass(frozen=True)
class Joint:
    """A turning joint.

    Attributes
    ----------
    name : str
        Its name in the URDF.
    lower, upper : float
        Limits, rad.
    speed : float
        Largest speed, rad/s.
    acceleration : float
        Largest acceleration, rad/s².
    """

    name: str
    lower: float
    upper: float
    speed: float
    acceleration: float


class Robot:
    """A serial arm of six or seven turning joints; `from_urdf` makes one.

    Lengths are in mm, angles in rad. The base is the frame of the base link. The tip is the frame
    of the link that carries the camera.

    **Guarantee.** Forward kinematics confirms each branch, to 10⁻⁶ rad and 10⁻³ mm. All branches
    are within the joints' limits. The same URDF gives the same branches in the same order.

    Parameters
    ----------
    text : str
        The URDF.
    tip : str
        Link that carries the camera.
    base : str or None
        Link whose frame is the base.
    accelerations : array (k,)
        Largest accelerations, rad/s².
    hulls : tuple of tuple of Hull
        Convex hulls of the links, in the frames of the joints.
    speeds : array (k,), optional
        Largest speeds, rad/s. Default: those of the URDF.
    bodiless_links : tuple of str
        Links behind joints that may have no geometry.
    controller : ControllerAxes, optional
        The axes that the controller counts. Default: the joints.
    file : str
        The file it was read from, for messages.

    Attributes
    ----------
    name : str
        Name in the URDF.
    tip : str
        Link that carries the camera.
    joints : tuple of Joint
        Six or seven, from the base to the tip.
    segment_names : tuple of str
        The base link and the links behind the joints.
    bodiless_links : tuple of str
        Links behind joints whose collisions cannot be checked: the URDF has no geometry of them.
    notes : tuple of str
        What of the URDF does not count, in words.
    pendant : array (4, 4) or None
        Frame of the URDF's link ``base`` in the base, mm: the pendant shows poses in it. None if the URDF has none.
    state_name : str
        Digest of everything that decides where the robot can be.

    Examples
    --------
    >>> import numpy as np
    >>> from planner import Robot
    >>> packages = {"made_robots": "examples/robots"}
    >>> robot = Robot.from_urdf("examples/robots/made_parallel.urdf", packages=packages)
    >>> flange = robot.forward(np.radians([20.0, -80.0, 110.0, -30.0, 40.0, 10.0]))
    >>> len(robot.branches(flange))
    8
    """

    def __init__(
        self,
        text: str,
        tip: str,
        base: str | None,
        accelerations: np.ndarray,
        hulls: Any,
        speeds: np.ndarray | None = None,
        bodiless_links: tuple[str, ...] = (),
        controller: ControllerAxes | None = None,
        file: str = "",
    ) -> None:
        arm = read_urdf(text, tip, base, speeds)
        self.name = arm.name
        self.tip = tip
        self.segment_names = arm.segments
        self.joints = tuple(
            Joint(joint.name, joint.lower, joint.upper, joint.speed, float(acceleration))
            for joint, acceleration in zip(arm.joints, accelerations, strict=True)
        )
        self.lower = _values(self.joints, "lower")
        self.upper = _values(self.joints, "upper")
        self.speeds = _values(self.joints, "speed")
        self.accelerations = _values(self.joints, "acceleration")
        self.chain = Chain.of(arm)
        self.hulls: tuple[tuple[Hull, ...], ...] = hulls
        moving = zip(arm.segments[1:], hulls[1:], strict=True)
        self.bodiless_links = tuple(name for name, link_hulls in moving if not link_hulls)
        self.notes = arm.notes
        self.pendant = arm.pendant
        self._stated_bodiless = bodiless_links
        self.controller = (
            ControllerAxes(n_joints=self.n_joints) if controller is None else controller
        )
        self._made_of = (
            text,
            tip,
            base,
            accelerations,
            hulls,
            speeds,
            bodiless_links,
            self.controller,
        )
        self._file = file
        self._branches: Branches | RedundantBranches | None = None

    @classmethod
    def from_urdf(
        cls,
        path: str | PathLike[str],
        *,
        tip: str = "tool0",
        base: str | None = None,
        packages: Mapping[str, str | PathLike[str]] | None = None,
        accelerations: float | Sequence[float] = 1.4,
        speeds: float | Sequence[float] | None = None,
        bodiless_links: str | Sequence[str] = (),
        coupled: Sequence[Sequence[float]] = (),
        axis_limits: Sequence[Sequence[float]] = (),
        calibration: str | PathLike[str] | None = None,
        joint_offsets: Sequence[float] = (),
    ) -> Robot:
        """Read a robot.

        Parameters
        ----------
        path : str or Path
            A URDF file. A xacro file must be expanded before.
        tip : str
            Link that carries the camera; ``flange`` and ``tool0`` of one robot may have different axes.
        base : str, optional
            Link whose frame is the robot's base. Default: ``base_link``, otherwise the first link. The pendant of a
            UR shows ``base``, which is turned by 180° about z.
        packages : mapping of str to path, optional
            Folders of the packages that ``package://`` names. Default: those that hold the file, or that are next to
            it or above.
        accelerations : float or sequence of floats, one a joint
            Largest accelerations of the joints, rad/s², which a URDF does not state.
        speeds : float or sequence of floats, one a joint, optional
            Largest speeds of the joints, rad/s. Default: those of the URDF.
        bodiless_links : sequence of str, or "all"
            Links that a cell accepts without geometry. Collisions of these are not checked. Default: a cell refuses a
            robot one of whose links behind a joint has no geometry.
        coupled : sequence of (int, int, float)
            Axis, joint, factor: the controller counts this axis as its joint plus the factor times the other joint.
        axis_limits : sequence of (int, float, float)
            Limits of the controller's axes, where it has others: axis, least and largest angle, rad.
        calibration : str or Path, optional
            A file that ``ur_calibration`` writes, or another in YAML. Under ``kinematics`` it has the measured origin
            of each joint in the link before it, by the joint or the link behind it: x, y and z in m, roll, pitch and
            yaw in rad. They replace those of the URDF.
        joint_offsets : sequence of float
            What each joint is farther than its controller counts, rad: a calibration of zeros alone.

        Returns
        -------
        Robot

        Raises
        ------
        RobotError
            The file cannot be read, or the arm is none that can be planned for.
        """
        file = Path(path)
        try:
            text = read_text(file)
        except OSError as error:
            raise RobotError.of_rule(
                "urdf", "must be a file that can be read", f"{str(file)!r}: {error.strerror}"
            ) from None
        except UnicodeDecodeError:
            raise RobotError.of_rule("urdf", "must be UTF-8 text", repr(str(file))) from None
        origins = None if calibration is None else _measured_origins(Path(calibration))
        if origins or len(joint_offsets):
            text = calibrated_text(text, tip, origins, joint_offsets)
        strongest = _checked_rates("accelerations", "rad/s²", accelerations)
        fastest = None if speeds is None else _checked_rates("speeds", "rad/s", speeds)
        try:
            arm = read_urdf(text, tip, base, fastest)
            hulls = _hulls(arm, file.parent, packages or {})
        except RobotError as error:
            if error.parameter != "urdf":
                raise
            named = f"urdf {file.name!r}"
            raise RobotError.of_rule(named, error.rule, error.got, hint=error.hint) from None
        n_joints = len(arm.joints)
        strongest = rate_of_each("accelerations", strongest, n_joints)
        fastest = None if fastest is None else rate_of_each("speeds", fastest, n_joints)
        stated = _checked_links(bodiless_links, arm.segments[1:])
        controller = ControllerAxes(coupled, axis_limits, n_joints)
        return cls(text, tip, base, strongest, hulls, fastest, stated, controller, str(file))

    def check_bodies(self) -> None:
        """Refuse a link behind a joint that has no geometry, unless it is stated.

        Raises
        ------
        RobotError
            If there is one.
        """
        missing = [name for name in self.bodiless_links if name not in self._stated_bodiless]
        if missing:
            every = len(missing) == self.n_joints
            field = 'bodiless_links = "all"' if every else f"bodiless_links = {_toml(missing)}"
            raise RobotError.of_rule(
                f"urdf of robot {self.name!r}",
                "must have geometry of every link behind a joint",
                f"none of {', '.join(missing)}",
                hint=f"{field} in [robot] of the cell file leaves their collisions unchecked",
            )

    @property
    def unchecked(self) -> str:
        """What a user must know of links without geometry, in one sentence; empty if there are none."""
        return unchecked_text(self.bodiless_links)

    @property
    def n_joints(self) -> int:
        """How many joints the arm has: six or seven."""
        return len(self.joints)

    def forward(self, q: Any) -> np.ndarray:
        """Return the pose of the tip in the base.

        Parameters
        ----------
        q : array_like, shape (n, k) or (k,)
            Joints, rad.

        Returns
        -------
        array, shape (n, 4, 4) or (4, 4)
            Poses, mm.
        """
        joints = np.asarray(q, dtype=np.float64)
        tips = self.chain.tips(self.chain.frames(joints.reshape(-1, self.n_joints)))
        return tips.reshape(*joints.shape[:-1], 4, 4)

    def link_poses(self, q: np.ndarray) -> np.ndarray:
        """Return the frames of the links of `segment_names` in the base.

        Parameters
        ----------
        q : array, shape (n, k)
            Joints, rad.

        Returns
        -------
        array, shape (n, k + 1, 4, 4)
            Poses, mm.
        """
        return compose(self.chain.frames(np.asarray(q, dtype=np.float64)), self.chain.links)

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        """Return the Jacobian of the tip.

        Parameters
        ----------
        q : array, shape (n, k)
            Joints, rad.

        Returns
        -------
        array, shape (n, 6, k)
            Rows 0 to 2: velocity of the tip, mm/rad; rows 3 to 5: its angular velocity. In the
            base's axes.
        """
        return self.chain.jacobian(self.chain.frames(np.asarray(q, dtype=np.float64)))

    def singular_value(self, q: np.ndarray) -> np.ndarray:
        """Return the smallest singular value of the Jacobian, its lengths divided by 500 mm.

        Parameters
        ----------
        q : array, shape (n, k)
            Joints, rad.

        Returns
        -------
        array, shape (n,)
            It is 0 where the arm is singular.
        """
        jacobian = self.jacobian(q)
        jacobian[:, :3] /= _UNIT_LENGTH_MM
        return np.asarray(np.linalg.svd(jacobian, compute_uv=False)[:, -1])

    def to_limit_rad(self, q: np.ndarray) -> np.ndarray:
        """Return how far the joints are from the nearest limit.

        Parameters
        ----------
        q : array, shape (n, k)
            Joints, rad.

        Returns
        -------
        array, shape (n,)
            Angles, rad; negative beyond a limit.
        """
        joints = np.asarray(q, dtype=np.float64)
        margin = np.minimum(joints - self.lower, self.upper - joints).min(axis=-1)
        return np.asarray(np.minimum(margin, self.controller.margin(joints)))

    def branches(self, flange: Any) -> np.ndarray:
        """Return all joints within limits that bring the tip to a pose.

        Parameters
        ----------
        flange : array_like, shape (4, 4)
            Pose of the tip in the base, mm.

        Returns
        -------
        array, shape (m, k)
            Joints, rad, in one order; m is 0 out of reach, and seldom more than 8 with six joints.
            With the axes of a wrist in line, a whole curve of joints leads to the pose. Those
            nearest to zero stand for all. With seven joints, some from all along the curve do.

        Raises
        ------
        RobotError
            If the pose is no rigid motion, or the arm is not near one with a closed form.
        """
        return self.branches_of(check_pose("flange", flange)[None])[0]

    def branches_of(self, flanges: np.ndarray) -> list[np.ndarray]:
        """Return the `branches` of many poses.

        Parameters
        ----------
        flanges : array, shape (n, 4, 4)
            Poses of the tip in the base, mm.

        Returns
        -------
        list of array (m, k)
            One for each pose.
        """
        q, owner = self.solutions(flanges)
        return np.split(q, np.searchsorted(owner, np.arange(1, len(flanges))))[: len(flanges)]

    def solutions(self, flanges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the branches of many poses in one array.

        Parameters
        ----------
        flanges : array, shape (n, 4, 4)
            Poses of the tip in the base, mm.

        Returns
        -------
        q : array, shape (m, k)
            Joints, rad.
        owner : array of int, shape (m,)
            Number of each one's pose.
        """
        q, owner = self._solver().of(check_rotations("flanges", flanges))
        if not self.controller.limits:
            return q, owner
        within = self.controller.margin(q) >= 0
        return q[within], owner[within]

    def check_solvable(self) -> None:
        """Raise `RobotError` if the arm is not near one with a closed form, or the extra is missing."""
        self._solver()

    def solvable(self, flanges: np.ndarray) -> np.ndarray:
        """Return to which poses joints lead, whatever their limits.

        Parameters
        ----------
        flanges : array, shape (n, 4, 4)
            Poses of the tip in the base, mm.

        Returns
        -------
        array of bool, shape (n,)
            True where there are joints.
        """
        return self._solver().exist(check_rotations("flanges", flanges))

    def turns(self, q: Any) -> np.ndarray:
        """Return all joints within limits that differ from given ones by full turns.

        Parameters
        ----------
        q : array_like, shape (k,)
            Joints, rad.

        Returns
        -------
        array, shape (t, k)
            Joints, rad, the given ones first.
        """
        turned = self._solver().turns(np.asarray(q, dtype=np.float64))
        return turned[self.controller.margin(turned) >= 0]

    def _solver(self) -> Branches | RedundantBranches:
        if self._branches is None:
            try:
                self._branches = branches_of(self.chain, self.lower, self.upper)
            except RobotError as error:
                if not (error.parameter and self._file):
                    raise
                name = f"{error.parameter} {self._file}"
                raise RobotError.of_rule(name, error.rule, error.got, hint=error.hint) from None
        return self._branches

    @property
    def state_name(self) -> str:
        """Digest of the URDF, the tip, the base, accelerations and hulls."""
        text, tip, base, accelerations, hulls, speeds, _, controller = self._made_of
        numbers = (
            [accelerations.tolist()]
            if speeds is None
            else [accelerations.tolist(), speeds.tolist()]
        )
        digest = hashlib.sha256(repr((text, tip, base, *numbers)).encode())
        if not controller.is_plain:
            digest.update(repr((controller.coupled, controller.limits)).encode())
        for hull in (hull for segment in hulls for hull in segment):
            digest.update(hull.corners.tobytes())
        return f"robot {self.name} {digest.hexdigest()}"

    def __reduce__(self) -> tuple[Any, ...]:
        """Leave the solver behind, which cannot cross a process boundary."""
        return Robot, (*self._made_of, self._file)

    def __repr__(self) -> str:
        return f"<Robot {self.name!r}, tip {self.tip!r}>"


def _measured_origins(file: Path) -> dict[str, Any]:
    """Return the origins of joints by name that a calibration file holds."""
    try:
        data = tree_of(file, read_text(file))
    except OSError as error:
        got = f"{str(file)!r}: {error.strerror}"
        raise RobotError.of_rule("calibration", "must be a file that can be read", got) from None
    except (CameraError, UnicodeDecodeError):
        raise RobotError.of_rule("calibration", "must be YAML", repr(str(file))) from None
    kinematics = data.get("kinematics") if isinstance(data, dict) else None
    # the digest of the arm is among its joints
    origins = kinematics if isinstance(kinematics, dict) else {}
    origins = {str(name): value for name, value in origins.items() if name != "hash"}
    if not origins:
        rule = "must hold the mapping kinematics, with an origin for each joint"
        raise RobotError.of_rule("calibration", rule, repr(str(file)))
    return origins


def _values(joints: Sequence[Joint], name: str) -> np.ndarray:
    """Return one number of every joint (k,), read-only."""
    values = np.array([getattr(joint, name) for joint in joints])
    values.flags.writeable = False
    return values


def unchecked_text(names: Sequence[str]) -> str:
    """Return a sentence on links without geometry, the names last: heads of programs cut long lines."""
    if not names:
        return ""
    return f"collisions of links without geometry in the URDF were NOT checked: {', '.join(names)}"


def _checked_rates(name: str, unit: str, given: Any) -> np.ndarray:
    """Return a speed or acceleration of all joints (), or one of each (k,)."""
    is_single = not isinstance(given, Sequence | np.ndarray)
    values = [given] if is_single else list(given)
    is_right = is_single or len(values) in JOINT_COUNTS
    if not is_right or not all(POSITIVE.accepts(value) for value in values):
        rule = f"must be a positive number of {unit}, or one for each joint"
        raise RobotError.of_rule(name, rule, shown(given))
    return np.array(given if is_single else values, dtype=np.float64)


def _checked_links(given: Any, links: Sequence[str]) -> tuple[str, ...]:
    """Return the names of links behind joints; ``"all"`` means each."""
    if given == "all":
        return tuple(links)
    rule = 'must be "all" or a list of links behind joints'
    if isinstance(given, str) or not isinstance(given, Sequence):
        raise RobotError.of_rule("bodiless_links", rule, shown(given))
    for name in given:
        if name not in links:
            hint = f"these are {', '.join(links)}"
            raise RobotError.of_rule("bodiless_links", rule, shown(name), hint=hint)
    return tuple(given)


def _toml(names: Sequence[str]) -> str:
    """Return names as a TOML file has them."""
    return "[" + ", ".join(f'"{name}"' for name in names) + "]"


def _hulls(
    arm: UrdfArm, folder: Path, packages: Mapping[str, str | PathLike[str]]
) -> tuple[tuple[Hull, ...], ...]:
    """Return the hulls of every segment in its frame F_k."""
    chain = Chain.of(arm)
    hulls = []
    for name, link, shapes in zip(arm.segments, chain.links, arm.shapes, strict=True):
        points = [_points(shape, folder, packages) for shape in shapes]
        placed = [
            carry(compose(link, shape.pose), corners)
            for shape, corners in zip(shapes, points, strict=True)
        ]
        for corners in placed:
            size = float(np.ptp(corners, axis=0).max())
            if size > _LARGEST_LINK_MM:
                raise RobotError.of_rule(
                    "urdf",
                    f"must have link {name!r} in metres",
                    f"a solid that is {size / 1000:,.0f} m long",
                    hint='is its mesh in mm? Give the mesh scale="0.001 0.001 0.001"',
                )
        hulls.append(tuple(hull_of(corners, f"link {name!r}") for corners in placed))
    return tuple(hulls)


def _points(
    shape: LinkShape, folder: Path, packages: Mapping[str, str | PathLike[str]]
) -> np.ndarray:
    """Return the corners (n, 3) of a shape in its own frame, mm."""
    if shape.kind == "box":
        signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
        return signs * np.array(shape.size) / 2
    if shape.kind == "mesh":
        path = _mesh_path(shape.file, folder, packages)
        if path.suffix.lower() == COLLADA:
            return collada_points(path.read_bytes(), path.name) * np.array(shape.size)
        corners, _ = read_triangles(path, "urdf")
        return corners * np.array(shape.size)
    radius, *length = shape.size
    return round_points(radius, length[0] if length else 0.0)


def _mesh_path(name: str, folder: Path, packages: Mapping[str, str | PathLike[str]]) -> Path:
    """Return where a mesh lies."""
    scheme, _, inner_path = name.rpartition("://")
    if scheme == "package":
        package, _, inside = inner_path.partition("/")
        stated = packages.get(package)
        place = _package_beside(package, inside, folder) if stated is None else Path(stated)
        if place is None:
            raise RobotError.of_rule(
                "packages",
                f"must name the folder of package {package!r}",
                shown(sorted(packages)),
                hint=f"the mesh {name} lies there",
            )
        path = place / inside
        if not path.is_file() and (place / package / inside).is_file():
            hint = f"the package is {place / package}"
            got = f"the folder above it, {place}"
            raise RobotError.of_rule(f"packages.{package}", "must be its folder", got, hint=hint)
    else:
        path = folder / inner_path
    if not path.is_file():
        raise RobotError.of_rule("urdf", f"must name meshes that exist: {name}", f"no {path}")
    return path


def _package_beside(package: str, inside: str, folder: Path) -> Path | None:
    """Return the folder of a package that a URDF in a folder is in, or that lies beside it or above; None without one.

    Makers keep a URDF in its package, or beside it: ``package/urdf/arm.urdf``.
    """
    for above in (folder.resolve(), *folder.resolve().parents):
        for place in (above / package, above):
            if place.name == package and (place / inside).is_file():
                return place
    return None
