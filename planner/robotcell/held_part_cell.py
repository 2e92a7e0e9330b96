"""A cell whose robot holds the part before a camera that stands still.

It is the mirror image of a camera in the hand: tip(q) · part2flange · cam2world = cam2base. So the same reach, the same
collisions and the same moves serve, with the part as the hand and the camera among what stands still.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.argument_kinds import NOT_NEGATIVE, check_kinds, check_number
from planner.exceptions import RobotError
from planner.robotcell.arm import Robot
from planner.robotcell.bodies import Body, Surface, hull_of
from planner.robotcell.cell import Cell, bodiless, digest_of, short_digest
from planner.robotcell.cell_file import (
    arm_with_mount,
    check_grips,
    check_home,
    check_home_is_free,
    check_part_stands_free,
    pairs_by_design,
)
from planner.robotcell.collisions import HAND, Moving, Surroundings, bodies_of
from planner.robotcell.joint_checks import Reacher
from planner.robotcell.standing import Grip, Standing, hidden_by, standing_bodies
from planner.robotcell.urdf import carry, check_pose, check_rotations, compose, invert

if TYPE_CHECKING:
    from aspectgraph import Solid


class HeldPartCell(Cell):
    """A robot that holds the part before a camera that stands still, and everything it must not touch.

    **Guarantee.** As that of `Cell`, with the part in the hand. The part in the hand counts as its
    convex hull. So poses are refused at which the camera would look out of a hollow of the part.

    Parameters
    ----------
    robot : Robot
        The arm.
    cam2base : array_like, shape (4, 4)
        The camera's frame in the robot's base, mm.
    camera_body : sequence of Box, path or (corners, triangles)
        Camera, lens and lamps, in the camera's frame, mm.
    obstacles : mapping of str to Box, path or (corners, triangles)
        What else stands in the cell, in the base frame, mm.
    clearance_mm : float
        Smallest distance to keep.
    fixturings : mapping of str to Grip
        The ways the robot holds the part, at least one, by name.
    home : sequence of float, optional
        Joints (6,) at which programs begin and end, rad.

    Raises
    ------
    RobotError
        If a parameter breaks its rule, or the extra ``robot`` is not installed.

    Examples
    --------
    >>> import numpy as np
    >>> from planner import Grip, HeldPartCell, Robot
    >>> packages = {"made_robots": "examples/robots"}
    >>> robot = Robot.from_urdf("examples/robots/made_parallel.urdf", packages=packages)
    >>> cam2base = np.eye(4)
    >>> cam2base[:3, 3] = [600.0, 0.0, 100.0]
    >>> grip = Grip(np.eye(4))
    >>> cell = HeldPartCell(robot, cam2base, fixturings={"grip": grip})
    >>> camera = np.diag([1.0, -1.0, -1.0, 1.0])
    >>> camera[:3, 3] = [0.0, 0.0, 300.0]
    >>> cell.reach(camera[None], "grip")[0].reached
    True
    """

    camera_field = "cam2base"

    def __init__(
        self,
        robot: Robot,
        cam2base: Any,
        *,
        camera_body: Sequence[Body] = (),
        obstacles: Mapping[str, Body] | None = None,
        clearance_mm: float = 10.0,
        fixturings: Mapping[str, Grip],
        home: Sequence[float] | None = None,
    ) -> None:
        check_kinds(robot=(robot, "Robot"))
        self.robot = robot
        robot.check_bodies()
        robot.check_solvable()
        self.cam2base = check_pose("cam2base", cam2base)
        self.clearance_mm = check_number("clearance_mm", clearance_mm, NOT_NEGATIVE)
        self.grips = dict(fixturings)
        self.fixturings: dict[str, Any] = self.grips
        self.home = check_home(home, robot)
        self._camera_body = tuple(camera_body)
        self._obstacles = dict(obstacles or {})
        check_grips(self.grips, self._obstacles, robot)
        self._standing = standing_bodies(self._obstacles, "obstacle")
        given = {f"camera {k}": body for k, body in enumerate(self._camera_body)}
        self._own_camera = standing_bodies(given, "camera_body")
        # all by the name of the camera
        self._eye = tuple(
            Standing("camera", compose(self.cam2base, one.pose), one.shape, one.geometry)
            for one in self._own_camera
        )
        self._grippers = {
            name: standing_bodies(grip.gripper, "gripper") for name, grip in self.grips.items()
        }
        self._held: np.ndarray | None = None
        self._in_grip: Standing | None = None
        self._build()
        self.check()

    def _build(self) -> None:
        """Build the arm with what each grip holds."""
        self._reachers = {}
        self._advances = {}
        links = bodies_of(self.robot, np.eye(4), ())
        self._arms = {
            name: arm_with_mount(self.robot, [*links, *self._in_hand(name)], self.clearance_mm)
            for name in self.grips
        }
        self._arm = next(iter(self._arms.values()))
        self._left_out = pairs_by_design(self.robot, self._arm)

    def _in_hand(self, name: str) -> list[Moving]:
        """Return the gripper and the part as they move with the flange."""
        tip = self.robot.chain.tip
        bodies = []
        for body in self._grippers[name]:
            corners = carry(compose(tip, body.pose), body.shape.corners)
            bodies.append(Moving(body.name, HAND, hull_of(corners, "gripper"), True))
        if self._held is not None:
            placed = carry(compose(tip, self.grips[name].part2flange), self._held)
            bodies.append(Moving("part", HAND, hull_of(placed, "part"), True))
        return bodies

    def with_part(self, solid: Solid, *, check: bool = True) -> HeldPartCell:
        """Return the cell with the part in the hand.

        Parameters
        ----------
        solid : Solid
            The part.
        check : bool
            Whether to `check` at once that home is free.

        Returns
        -------
        HeldPartCell
            What stands still is shared.
        """
        cell = self._copy()
        cell._held = np.asarray(solid.vertices, dtype=np.float64)
        surface = Surface(cell._held, solid.triangles, closed=True)
        cell._in_grip = Standing("part", np.eye(4), surface)
        cell._build()
        if check:
            cell.check()
        return cell

    def _copy(self) -> HeldPartCell:
        cell = object.__new__(HeldPartCell)
        cell.__dict__.update(self.__dict__)
        return cell

    def check_fixturings(self) -> None:
        """Look at the part in its grippers.

        Raises
        ------
        RobotError
            If a gripper goes through the part.
        """
        for name, grip in self.grips.items():
            if self._in_grip is not None:
                part = self._in_grip.at(grip.part2flange)
                check_part_stands_free(name, part, self._grippers[name], (), "part2flange")

    def check_place(self) -> None:
        """Look at home.

        Raises
        ------
        RobotError
            If home is not free.
        """
        for name in self.grips:
            if self.home is not None:
                check_home_is_free(name, self.blocked_by(self.home, name))

    def fixture_depths(
        self, enough_mm: float = np.inf
    ) -> Iterator[tuple[tuple[str, str, str], float]]:
        """Yield nothing, since grips bring nothing that stands still.

        Parameters
        ----------
        enough_mm : float
            Not used.

        Returns
        -------
        iterator
            Empty.
        """
        return iter(())

    def with_home(self, q: Sequence[float]) -> HeldPartCell:
        """Return the cell with another home.

        Parameters
        ----------
        q : sequence of float
            Joints (6,), rad.

        Returns
        -------
        HeldPartCell
            All geometry is shared.

        Raises
        ------
        RobotError
            If a joint is beyond its limit, or the arm touches something there.
        """
        cell = self._copy()
        cell.home = check_home(q, self.robot)
        cell._build()
        cell.check()
        return cell

    def with_fixturings(self, fixturings: Mapping[str, Any]) -> HeldPartCell:
        """Return the cell with other grips.

        Parameters
        ----------
        fixturings : mapping of str to Grip
            At least one.

        Returns
        -------
        HeldPartCell
            Without a part.
        """
        return HeldPartCell(**{**self._arguments(), "fixturings": fixturings})

    def moved(self, motion: np.ndarray) -> HeldPartCell:
        """Raise, since there is no part to be placed.

        Parameters
        ----------
        motion : array, shape (4, 4)
            Not used.

        Raises
        ------
        RobotError
            Always.
        """
        rule = "must have the part lying in it to look for its place"
        raise RobotError.of_rule("cell", rule, "a part in the hand")

    def part2base(self, fixturing: str, angle: float = 0.0) -> np.ndarray:
        """Return where the part is at home, or where all joints are 0 without one.

        Parameters
        ----------
        fixturing : str
            Name of a grip.
        angle : float
            Not used.

        Returns
        -------
        array, shape (4, 4)
            The part's frame in the base, mm.
        """
        return self.part_at(np.zeros(6) if self.home is None else self.home, fixturing)

    def part_at(self, q: np.ndarray, fixturing: str) -> np.ndarray:
        """Return where the part is at joints.

        Parameters
        ----------
        q : array, shape (6,)
            Joints, rad.
        fixturing : str
            Name of a grip.

        Returns
        -------
        array, shape (4, 4)
            The part's frame in the base, mm.
        """
        return compose(self.robot.forward(q), self._grip(fixturing).part2flange)

    def flange(self, cam2world: np.ndarray, fixturing: str, angle: float = 0.0) -> np.ndarray:
        """Return the poses of the tip for poses of the camera in the part's frame.

        Parameters
        ----------
        cam2world : array, shape (n, 4, 4) or (4, 4)
            Poses of the camera in the part's frame, mm.
        fixturing : str
            Name of a grip.
        angle : float
            Not used.

        Returns
        -------
        array, shape (n, 4, 4) or (4, 4)
            Poses of the tip in the base, mm.
        """
        part = compose(self.cam2base, invert(check_rotations("cam2world", cam2world)))
        return compose(part, invert(self._grip(fixturing).part2flange))

    def cam2world(self, q: np.ndarray, fixturing: str) -> np.ndarray:
        """Return the poses of the camera in the part's frame for joints.

        Parameters
        ----------
        q : array, shape (n, 6)
            Joints, rad.
        fixturing : str
            Name of a grip.

        Returns
        -------
        array, shape (n, 4, 4)
            Poses, mm.
        """
        part = compose(self.robot.forward(q), self._grip(fixturing).part2flange)
        return compose(invert(part), self.cam2base)

    def hidden_by(
        self, cam2world: np.ndarray, segments: np.ndarray, fixturing: str, angle: float = 0.0
    ) -> np.ndarray:
        """Return which obstacle, or which object of the gripper, hides segments from cameras.

        Parameters
        ----------
        cam2world : array, shape (n, 4, 4)
            Poses of the camera in the part's frame, mm.
        segments : array, shape (s, 2, 3)
            Segments in the part's frame, mm.
        fixturing : str
            Name of a grip.
        angle : float
            Not used.

        Returns
        -------
        array of str, shape (n, s)
            Names; empty where nothing is in the way.
        """
        poses = np.asarray(cam2world, dtype=np.float64)
        part2flange = self._grip(fixturing).part2flange
        names = hidden_by(self._grippers[fixturing], part2flange, poses[:, :3, 3], segments)
        for row, pose in enumerate(poses if self._standing else ()):
            part = compose(self.cam2base, invert(pose))
            others = hidden_by(self._standing, part, pose[None, :3, 3], segments)[0]
            names[row] = np.where(names[row] == "", others, names[row])
        return names

    def _reacher(self, name: str, angle: float = 0.0) -> Reacher:
        """Return the robot with one grip; built when it is first asked for."""
        self._grip(name)
        key = (name, 0.0)
        if key not in self._reachers:
            standing = [*self._standing, *self._eye]
            around = Surroundings(self._arms[name], standing, self.clearance_mm, self._left_out)
            rest = np.clip(0.0, self.robot.lower, self.robot.upper)
            self._reachers[key] = Reacher(
                self.robot, around, rest if self.home is None else self.home
            )
        return self._reachers[key]

    def _grip(self, name: str) -> Grip:
        self._fixturing(name)
        return self.grips[name]

    @property
    def state_name(self) -> str:
        """Digest of everything that decides what is reached."""
        return f"cell {short_digest(('held', self.robot.state_name, self.parts), 64)}"

    @property
    def parts(self) -> dict[str, str]:
        """Short digests of what the cell consists of, by name."""
        home = None if self.home is None else self.home.tolist()
        still = digest_of((), None, [("", np.eye(4), self._standing)])
        grips = {
            f"fixturing {name}": short_digest(
                digest_of((), None, [(name, grip.part2flange, self._grippers[name])])
            )
            for name, grip in self.grips.items()
        }
        return {
            "robot": short_digest(self.robot.state_name),
            "cam2base": short_digest(self.cam2base.tolist()),
            "camera_body": short_digest(digest_of((), None, [("", np.eye(4), self._own_camera)])),
            "clearance_mm": short_digest(self.clearance_mm),
            "home": short_digest(home),
            "obstacles": short_digest(still),
            **grips,
        }

    def to_dict(self) -> dict[str, Any]:
        """Return what a plan file says of the cell.

        Returns
        -------
        dict
            As that of a `Cell`, with ``cam2base``; the poses of fixturings are ``part2flange``.
        """
        return {
            "robot": self.robot.name,
            "digest": self.state_name.split()[-1],
            "fixturings": {name: grip.part2flange.tolist() for name, grip in self.grips.items()},
            "parts": self.parts,
            "cam2base": self.cam2base.tolist(),
            **bodiless(self.robot),
        }

    def _arguments(self) -> dict[str, Any]:
        return {
            "robot": self.robot,
            "cam2base": self.cam2base,
            "camera_body": self._camera_body,
            "obstacles": self._obstacles,
            "clearance_mm": self.clearance_mm,
            "fixturings": self.grips,
            "home": self.home,
        }

    def __getstate__(self) -> dict[str, Any]:
        """Leave geometry behind that cannot cross a process boundary; it is built again."""
        return {**self._arguments(), "part": self._held}

    def __setstate__(self, state: dict[str, Any]) -> None:
        part = state.pop("part")
        self.__init__(**state)  # type: ignore[misc]
        if part is not None:
            self._held = part
            self._build()

    def __repr__(self) -> str:
        return f"<HeldPartCell {self.robot.name!r}, grips {', '.join(self.grips)}>"
