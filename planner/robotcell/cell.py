"""The cell: a robot, what its hand carries, and what stands around; and the region of poses that it reaches."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.argument_kinds import NOT_NEGATIVE, check_kinds, check_number, shown
from planner.exceptions import RobotError
from planner.robotcell.arm import Robot
from planner.robotcell.bodies import Body, Fixturing, Grip, Standing, Surface
from planner.robotcell.camera_body import unchecked_of
from planner.robotcell.cell_file import cell_fields, made_of_file
from planner.robotcell.cell_light import BACKLIGHT, CarriedLight, LightBox
from planner.robotcell.collisions import (
    Arm,
    Closeness,
    Surroundings,
    TurnedAdvance,
    farthest_points,
)
from planner.robotcell.hand import (
    CameraInHand,
    Fittings,
    Hand,
    PartInHand,
    check_hand_eye,
    check_home,
    check_home_is_free,
    check_names,
    light_of,
    pairs_by_design,
    part_words,
    parts_of,
)
from planner.robotcell.reachability import (
    ArmAt,
    PoseReach,
    Reachability,
    Reacher,
    most_often,
    over_angles,
)
from planner.robotcell.urdf import check_pose, compose, invert

if TYPE_CHECKING:
    from aspectgraph import Solid

LINKS_NEAR_MM = 5.0
"""Two links of the arm are named as the closest objects only if they are nearer than this."""


class Cell:
    """A robot that holds a camera, and everything it must not touch.

    The tip of the robot is the flange: tip(q) · cam2flange = part2base · cam2world.

    **Guarantee.** Joints that `reach` returns are within their limits and bring the camera to the
    pose. Arm and camera keep `clearance_mm` to obstacles and part, and so does the camera to the
    arm. Links of the arm that are no neighbours do not touch. Links and the camera count as their
    convex hulls.

    Parameters
    ----------
    robot : Robot
        The arm.
    cam2flange : array_like, shape (4, 4)
        Hand-eye calibration: the camera's frame in the robot's tip, mm.
    camera_body : sequence of Box, path or (corners, triangles)
        Camera, lens, lamps, bracket and a box for the loop of the cable, in the camera's frame (x right, y down, z
        forward, origin at the front nodal point), mm. Each counts as its convex hull.
    light : CarriedLight, optional
        The light that moves with the camera. A plan for the cell is lit by it. Default: none. A backlight is a
        `LightBox` among the obstacles of a fixturing.
    obstacles : mapping of str to Box, path or (corners, triangles)
        What stands in the cell in every fixturing, in the base frame, mm.
    clearance_mm : float
        Smallest distance to keep.
    fixturings : mapping of str to Fixturing
        The ways the part lies, at least one, by name.
    home : sequence of float, optional
        Joints (k,) at which programs begin and end, rad.

    Raises
    ------
    RobotError
        If a parameter breaks its rule, or the extra ``robot`` is not installed.
    """

    def __init__(
        self,
        robot: Robot,
        cam2flange: Any,
        *,
        camera_body: Sequence[Body] = (),
        light: CarriedLight | None = None,
        obstacles: Mapping[str, Body] | None = None,
        clearance_mm: float = 10.0,
        fixturings: Mapping[str, Fixturing],
        home: Sequence[float] | None = None,
    ) -> None:
        self._check_robot(robot)
        self.cam2flange = check_hand_eye(cam2flange)
        fittings = _fittings(robot, camera_body, obstacles, clearance_mm, light)
        self._assemble(CameraInHand, self.cam2flange, fittings, fixturings, home)

    @staticmethod
    def _check_robot(robot: Robot) -> None:
        check_kinds(robot=(robot, "Robot"))
        robot.check_bodies()
        robot.check_solvable()

    def _assemble(
        self,
        hand: type[Hand],
        camera: np.ndarray,
        fittings: Fittings,
        fixturings: Mapping[str, Any],
        home: Sequence[float] | None,
    ) -> None:
        """Put the cell together, and check it."""
        self.robot = fittings.robot
        self.clearance_mm = fittings.clearance_mm
        self.home = check_home(home, self.robot)
        check_names(hand, fittings, dict(fixturings))
        self._fittings = fittings
        self._hand: Hand = hand(fittings, camera, dict(fixturings))
        self._left_out = pairs_by_design(self.robot, self._arm)
        self._forget()
        light_of(fittings, self.fixturings)
        self.check()

    def _forget(self) -> None:
        """Leave behind what was built of fixturings, when these, home or the hand change."""
        self._reachers: dict[tuple[str, float], Reacher] = {}
        self._advances: dict[str, TurnedAdvance] = {}

    def _with_hand(self, hand: Hand) -> Cell:
        cell = self._copy()
        cell._hand = hand
        return cell

    def _copy(self) -> Cell:
        cell = object.__new__(type(self))
        cell.__dict__.update(self.__dict__)
        cell._forget()
        return cell

    @property
    def fixturings(self) -> dict[str, Any]:
        """The ways the part lies or is held, by name: each a `Fixturing`, or a `Grip`."""
        return self._hand.fixturings

    @property
    def light(self) -> CarriedLight | LightBox | None:
        """The light of the cell, by which its plans are lit: carried by the camera, or below the part, in its frame."""
        return light_of(self._fittings, self.fixturings)

    @property
    def _arm(self) -> Arm:
        """The arm with what it carries in the first fixturing."""
        return next(iter(self._hand.arms.values()))

    @classmethod
    def from_toml(cls, path: str | PathLike[str]) -> Cell:
        """Read a cell file; see docs/guides/robot-cells.md for its fields.

        Parameters
        ----------
        path : str or Path
            A TOML file.

        Returns
        -------
        Cell
            The cell.

        Raises
        ------
        RobotError
            The file cannot be read, or a field breaks its rule.
        """
        fields = cell_fields(path)
        kind = HeldPartCell if PartInHand.field in fields else Cell
        return made_of_file(kind, fields, path)

    def with_part(self, solid: Solid, *, check: bool = True) -> Cell:
        """Return the cell with the part in it or in the hand, so that nothing may touch the part either.

        Parameters
        ----------
        solid : Solid
            The part.
        check : bool
            Whether to `check` at once that it stands free, and home with it.

        Returns
        -------
        Cell
            Everything but the part is shared.

        Raises
        ------
        RobotError
            If a fixturing puts the part through an obstacle or the base of the robot.
        """
        corners = np.asarray(solid.vertices, dtype=np.float64)
        return self._holding(Surface(corners, solid.triangles, closed=True), check=check)

    def _holding(self, part: Surface, *, check: bool) -> Cell:
        cell = self._with_hand(self._hand.with_part(Standing("part", np.eye(4), part)))
        if check:
            cell.check()
        return cell

    def check(self) -> None:
        """Look at the part and at home.

        Raises
        ------
        RobotError
            If the part goes through an obstacle or the robot's base, or home is not free.
        """
        self.check_fixturings()
        self.check_place()

    def check_fixturings(self) -> None:
        """Look at the part among what comes with its fixtures, wherever these stand, or in its grippers.

        Raises
        ------
        RobotError
            If the part goes through something that moves with it, or a gripper through the part.
        """
        for name in self.fixturings:
            self._hand.check_fixturing(name)

    def check_place(self) -> None:
        """Look at the part among what stands in the cell, at turntables, and at home.

        Raises
        ------
        RobotError
            If the part goes through an obstacle or the robot's base, a turntable turns it into one, or home is not
            free.
        """
        for name in self.fixturings:
            self._hand.check_place(name)
            if self.home is not None:
                check_home_is_free(name, self.blocked_by(self.home, name))

    def fixture_depths(
        self, enough_mm: float = np.inf
    ) -> Iterator[tuple[tuple[str, str, str], float]]:
        """Return how deep the part and the objects of fixturings are in what stands in every one.

        Parameters
        ----------
        enough_mm : float
            Beyond this any depth that was found will do.

        Returns
        -------
        iterator of ((str, str, str), float)
            The fixturing, the part or an object around it, and an obstacle or the link at the base.
            Their depth in each other, mm; 0 where they are apart. Up to 1 mm it may be larger. Grips
            bring nothing that stands still, so theirs is empty.
        """
        return self._hand.depths(enough_mm)

    def with_fixturings(self, fixturings: Mapping[str, Any]) -> Cell:
        """Return the cell with other fixturings; the arm and the part are shared.

        Parameters
        ----------
        fixturings : mapping of str to Fixturing or Grip
            At least one.

        Returns
        -------
        Cell
            With these fixturings only.

        Raises
        ------
        RobotError
            If there is none, or two objects have one name.
        """
        check_names(type(self._hand), self._fittings, fixturings)
        return self._with_hand(self._hand.with_fixturings(fixturings))

    def moved(self, motion: np.ndarray) -> Cell:
        """Return the cell with all fixturings, including their obstacles, moved in the base.

        Parameters
        ----------
        motion : array, shape (4, 4)
            The motion, mm. The result is not checked; `check` does so.

        Returns
        -------
        Cell
            All geometry is shared.

        Raises
        ------
        RobotError
            If the part is in the hand.
        """
        return self._with_hand(self._hand.moved(motion))

    def with_home(self, q: Sequence[float]) -> Cell:
        """Return the cell with another home.

        Parameters
        ----------
        q : sequence of float
            Joints (k,) at which programs begin and end, rad.

        Returns
        -------
        Cell
            All geometry is shared.

        Raises
        ------
        RobotError
            If a joint is beyond its limit, or the arm touches something there.
        """
        cell = self._copy()
        cell.home = check_home(q, self.robot)
        cell.check()
        return cell

    def reach(
        self,
        cam2world: np.ndarray,
        fixturing: str,
        *,
        all_branches: bool = False,
        angle: float | None = None,
    ) -> list[PoseReach]:
        """Return by which joints the robot brings the camera to poses, or why it does not.

        Parameters
        ----------
        cam2world : array, shape (n, 4, 4)
            Poses of the camera in the part's frame, mm.
        fixturing : str
            Name of a fixturing.
        all_branches : bool
            Whether to look for all joints without collision. Default: the first ones.
        angle : float, optional
            The angle of the turntable, rad. Default: all of the fixturing, the nearest to 0 first.

        Returns
        -------
        list of PoseReach
            One for each pose.
        """
        poses = np.asarray(cam2world, dtype=np.float64).reshape(-1, 4, 4)
        if angle is not None or self._fixturing(fixturing).table is None:
            at = 0.0 if angle is None else angle
            flanges = self.flange(poses, fixturing, at)
            return self._reacher(fixturing, at).reach(flanges, all_branches)
        return over_angles(
            lambda one, rows: self.reach(
                poses[rows], fixturing, all_branches=all_branches, angle=one
            ),
            len(poses),
            self.angles(fixturing),
            all_branches,
        )

    def angles(self, fixturing: str) -> tuple[float, ...]:
        """Return the angles at which images may be taken.

        Parameters
        ----------
        fixturing : str
            Name of a fixturing.

        Returns
        -------
        tuple of float
            Angles of its turntable, rad, the nearest to 0 first; 0 alone without one.
        """
        return tuple(self._fixturing(fixturing).angles)

    def region(self, solid: Solid) -> CellRegion:
        """Return the poses that the robot reaches, as planning asks for them.

        Parameters
        ----------
        solid : Solid
            The part.

        Returns
        -------
        CellRegion
            Of the cell with the part in it.
        """
        return CellRegion(self.with_part(solid))

    def part2base(self, fixturing: str, angle: float = 0.0) -> np.ndarray:
        """Return where the part is: in the hand at home, or where all joints are 0 without one.

        Parameters
        ----------
        fixturing : str
            Name of a fixturing.
        angle : float
            Angle of its turntable, rad.

        Returns
        -------
        array, shape (4, 4)
            The part's frame in the base, mm.
        """
        home = np.zeros(self.robot.n_joints) if self.home is None else self.home
        return self.part_at(np.append(home, angle), fixturing)

    def part_at(self, q: np.ndarray, fixturing: str) -> np.ndarray:
        """Return where the part is at joints.

        Parameters
        ----------
        q : array_like, shape (k,), or (k + 1,) on a turntable
            Joints, rad.
        fixturing : str
            Name of a fixturing.

        Returns
        -------
        array, shape (4, 4)
            The part's frame in the base, mm.
        """
        self._fixturing(fixturing)
        return self._hand.parts_at(np.asarray(q, dtype=np.float64), fixturing)

    def flange(self, cam2world: np.ndarray, fixturing: str, angle: float = 0.0) -> np.ndarray:
        """Return the poses of the tip for poses of the camera.

        Parameters
        ----------
        cam2world : array, shape (n, 4, 4) or (4, 4)
            Poses of the camera in the part's frame, mm.
        fixturing : str
            Name of a fixturing.
        angle : float
            Angle of its turntable, rad.

        Returns
        -------
        array, shape (n, 4, 4) or (4, 4)
            Poses of the tip in the base, mm.
        """
        self._fixturing(fixturing)
        return self._hand.tips(cam2world, fixturing, angle)

    def cam2world(self, q: np.ndarray, fixturing: str) -> np.ndarray:
        """Return the poses of the camera for joints.

        Parameters
        ----------
        q : array, shape (n, k), or (n, k + 1) on a turntable
            Joints, rad.
        fixturing : str
            Name of a fixturing.

        Returns
        -------
        array, shape (n, 4, 4)
            Poses of the camera in the part's frame, mm.
        """
        self._fixturing(fixturing)
        joints = np.asarray(q, dtype=np.float64)
        parts = self._hand.parts_at(joints, fixturing)
        return compose(invert(parts), self._hand.cameras_at(joints[:, : self.robot.n_joints]))

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
            Name of a fixturing.
        angle : float
            Angle of its turntable, rad.

        Returns
        -------
        array of str, shape (n, s)
            Names; empty where nothing is in the way.
        """
        self._fixturing(fixturing)
        return self._hand.hidden_by(cam2world, segments, fixturing, angle)

    def limits(self, fixturing: str) -> tuple[np.ndarray, np.ndarray]:
        """Return the least and the largest joints of moves.

        Parameters
        ----------
        fixturing : str
            Name of a fixturing.

        Returns
        -------
        array, shape (k,), or (k + 1,) on a turntable
            Least joints, rad.
        array, shape (k,), or (k + 1,) on a turntable
            Largest joints, rad.
        """
        table = self._fixturing(fixturing).table
        if table is None:
            return self.robot.lower, self.robot.upper
        low, high = table.range
        return np.append(self.robot.lower, low), np.append(self.robot.upper, high)

    def rates(self, fixturing: str) -> tuple[np.ndarray, np.ndarray]:
        """Return the largest speeds and accelerations.

        Parameters
        ----------
        fixturing : str
            Name of a fixturing.

        Returns
        -------
        array, shape (k,), or (k + 1,) on a turntable
            Speeds, rad/s.
        array, shape (k,), or (k + 1,) on a turntable
            Accelerations, rad/s².
        """
        robot = self.robot
        table = self._fixturing(fixturing).table
        if table is None:
            return robot.speeds, robot.accelerations
        return (
            np.append(robot.speeds, table.speed),
            np.append(robot.accelerations, table.acceleration),
        )

    def free(self, q: np.ndarray, fixturing: str) -> np.ndarray:
        """Return which joints are within limits and keep the clearance.

        Parameters
        ----------
        q : array, shape (n, k), or (n, k + 1) on a turntable
            Joints, rad.
        fixturing : str
            Name of a fixturing.

        Returns
        -------
        array of bool, shape (n,)
            True where nothing is too near.
        """
        joints = np.asarray(q, dtype=np.float64)
        result = np.zeros(len(joints), dtype=bool)
        for rows, reacher, robot_joints in self._by_angle(joints, fixturing):
            result[rows] = reacher.free(robot_joints)
        return result

    def blocked_by(self, q: np.ndarray, fixturing: str) -> str:
        """Return what is wrong with joints, in words.

        Parameters
        ----------
        q : array_like, shape (k,), or (k + 1,) on a turntable
            Joints, rad.
        fixturing : str
            Name of a fixturing.

        Returns
        -------
        str
            Empty if they are free.
        """
        reacher, joints = self._at(q, fixturing)
        return reacher.blocked_by(joints)

    def clearance(
        self,
        q: np.ndarray,
        fixturing: str,
        *,
        links_mm: float = LINKS_NEAR_MM,
        with_constant: bool = False,
    ) -> Closeness:
        """Return what arm or camera is nearest to: the part, an obstacle, or a link of the arm that is very near.

        Parameters
        ----------
        q : array_like, shape (k,), or (k + 1,) on a turntable
            Joints, rad.
        fixturing : str
            Name of a fixturing.
        links_mm : float
            Pairs of the arm's own links count only if they are nearer than this: some are near in all joints.
        with_constant : bool
            Whether objects count that are equally near at all joints, as the turning base and its pedestal.

        Returns
        -------
        Closeness
            Names of the closest two objects and their distance, mm.
        """
        reacher, joints = self._at(q, fixturing)
        return Closeness(*reacher.closest(joints, links_mm, with_constant))

    def constant_clearance(self, fixturing: str) -> Closeness:
        """Return the closest two objects whose distance is the same at all joints, within 1 mm.

        Parameters
        ----------
        fixturing : str
            Name of a fixturing.

        Returns
        -------
        Closeness
            Their names and distance, mm; infinite and without names if there are none.
        """
        return Closeness(*self._reacher(fixturing).constant())

    def slack_bound(
        self, q: np.ndarray, fixturing: str, enough_mm: float = np.inf, *, share: float = 1.0
    ) -> np.ndarray:
        """Return by how much all distances exceed those required, at least, for joints (n, k).

        Parameters
        ----------
        q : array, shape (n, k), or (n, k + 1) on a turntable
            Joints, rad.
        fixturing : str
            Name of a fixturing.
        enough_mm : float
            Below this the result is exact; above, a quick lower bound.
        share : float
            Share of the clearance that is required.

        Returns
        -------
        array, shape (n,)
            Millimetres; negative if the clearance is not kept, -inf if objects touch.
        """
        joints = np.asarray(q, dtype=np.float64)
        result = np.empty(len(joints))
        for rows, reacher, robot_joints in self._by_angle(joints, fixturing):
            result[rows] = reacher.slack(robot_joints, share * reacher.required, enough_mm)
        return result

    def free_shares(
        self, q: np.ndarray, turn: np.ndarray, reach: np.ndarray, kept: float, *, fixturing: str
    ) -> np.ndarray:
        """Return which share of a straight move is proven free in both directions from joints.

        Parameters
        ----------
        q : array, shape (n, k), or (n, k + 1) on a turntable
            Joints, rad.
        turn : array, shape (k,), or (k + 1,) on a turntable
            The move, rad.
        reach : array, shape (n,)
            Largest shares of it that are of interest.
        kept : float
            Share of the clearance that must be kept.
        fixturing : str
            Name of a fixturing.

        Returns
        -------
        array, shape (n,)
            See `Reacher.free_shares`.
        """
        if self._fixturing(fixturing).table is None:
            return self._reacher(fixturing).free_shares(q, turn, reach, kept)
        frames = self.robot.chain.frames(q[:, :-1])
        return self._turned(fixturing).shares(frames, q[:, -1], turn, reach, kept)

    def shapes(
        self, q: np.ndarray, fixturing: str
    ) -> list[tuple[str, bool, np.ndarray, np.ndarray]]:
        """Return everything at joints: name, whether it moves, corners in the base, triangles.

        Parameters
        ----------
        q : array_like, shape (k,), or (k + 1,) on a turntable
            Joints, rad.
        fixturing : str
            Name of a fixturing.

        Returns
        -------
        list of tuple
            The arm first.
        """
        reacher, joints = self._at(q, fixturing)
        return reacher.shapes(joints)

    def reachability(self, plan: Any, solid: Solid, *, all_branches: bool = False) -> Reachability:
        """Return which settings of a plan the robot reaches in which fixturing, or why not.

        A setting also counts as not reached where an obstacle hides one of its targets.

        Parameters
        ----------
        plan : InspectionPlan
            A plan, made with this cell or without one.
        solid : Solid
            The part.
        all_branches : bool
            Whether to look for all joints without collision. Default: the first ones.

        Returns
        -------
        Reachability
            A table of settings and fixturings.
        """
        check_kinds(solid=(solid, "Solid"))
        return reachability_of(self.with_part(solid), plan, all_branches=all_branches)

    @property
    def pairs_left_out(self) -> tuple[tuple[str, str], ...]:
        """Links that are not compared: they touch in nearly all joints, or nowhere, because the arm is built so."""
        names = [body.name for body in self._arm.bodies]
        return tuple((names[first], names[second]) for first, second in self._left_out)

    @property
    def obstacles(self) -> tuple[str, ...]:
        """Names of what stands in the cell in every fixturing."""
        return tuple(self._fittings.obstacles)

    @property
    def bodies_around(self) -> dict[str, Body]:
        """What stands in the cell in every fixturing, by name, in the base frame, mm."""
        return dict(self._fittings.obstacles)

    @property
    def near_by_mount(self) -> tuple[str, ...]:
        """What the mount leaves less than the clearance, in words: there, only touching is refused."""
        bodies = self._arm.bodies
        nearest: dict[tuple[str, str], float] = {}
        for (first, second), mm in self._arm.near_by_mount.items():
            pair = (bodies[second].name, bodies[first].name)
            nearest[pair] = min(mm, nearest.get(pair, np.inf))
        return tuple(
            f"{held} is mounted {mm:.3g} mm from {link}, nearer than clearance_mm = {self.clearance_mm:g} mm: "
            "these two must only not touch"
            for (held, link), mm in nearest.items()
        )

    @property
    def unchecked(self) -> tuple[str, ...]:
        """What a user must know of objects whose collisions are not checked, in sentences."""
        has_body = bool(self._fittings.camera_body)
        return unchecked_of(self.robot.unchecked, has_camera_body=has_body)

    @property
    def levers_mm(self) -> np.ndarray:
        """How far from each joint's axis (k,) a point of the arm or the camera can be, at most, mm."""
        return farthest_points(self.robot.chain, self._arm)

    @property
    def state_name(self) -> str:
        """Digest of everything that decides what is reached."""
        return f"cell {self._hand.digest(self._home_values)}"

    @property
    def parts(self) -> dict[str, str]:
        """Short digests of what the cell consists of, by name."""
        return parts_of(self._hand, self._home_values)

    @property
    def _home_values(self) -> list[float] | None:
        return None if self.home is None else self.home.tolist()

    def to_dict(self) -> dict[str, Any]:
        """Return what a plan file says of the cell.

        Returns
        -------
        dict
            Name of the robot, digest of the cell, and the pose of the part in each fixturing:
            ``part2base``, or ``part2flange`` with ``cam2base`` where the hand holds the part. The
            axes of turntables. ``parts`` are short digests, which show what was changed.
            ``bodiless_links`` are those whose collisions were not checked.
        """
        bodiless = list(self.robot.bodiless_links)
        return {
            "robot": self.robot.name,
            "digest": self.state_name.split()[-1],
            "fixturings": {name: pose.tolist() for name, pose in self._hand.poses().items()},
            "parts": self.parts,
            **self._hand.stated(),
            **({"bodiless_links": bodiless} if bodiless else {}),
        }

    def difference(self, stated: Mapping[str, Any]) -> str:
        """Return in what this cell differs from the one of a plan.

        Parameters
        ----------
        stated : mapping
            What the plan says of its cell, ``plan.cell``; empty without one.

        Returns
        -------
        str
            Such as "cam2flange and fixturing 'up'"; empty if nothing differs.
        """
        now = self.to_dict()
        if not stated or stated["digest"] == now["digest"]:
            return ""
        before = stated.get("parts", {})
        names = {**before, **now["parts"]} if before else {}
        changed = [name for name in names if before.get(name) != now["parts"].get(name)]
        words = [part_words(name, before, now["parts"]) for name in changed]
        if not words:
            return "something that the plan does not name"
        return " and ".join([", ".join(words[:-1]), words[-1]] if words[:-1] else words)

    def _fixturing(self, name: str) -> Any:
        if name not in self.fixturings:
            rule = f"must be one of {', '.join(map(repr, self.fixturings))}"
            raise RobotError.of_rule("fixturing", rule, shown(name))
        return self.fixturings[name]

    def _at(self, q: np.ndarray, fixturing: str) -> tuple[Reacher, np.ndarray]:
        """Return what knows a fixturing at the angle of joints (k,) or (k + 1,), and the robot's joints."""
        joints = np.asarray(q, dtype=np.float64)
        n_joints = self.robot.n_joints
        return self._reacher(fixturing, float(joints[n_joints:].sum())), joints[:n_joints]

    def _by_angle(
        self, q: np.ndarray, fixturing: str
    ) -> Iterator[tuple[np.ndarray, Reacher, np.ndarray]]:
        """Yield the rows of joints (n, k) or (n, k + 1) at each angle, what knows it, and the robot's joints."""
        n_joints = self.robot.n_joints
        angles = q[:, n_joints:].sum(axis=1)
        for angle in dict.fromkeys(angles.tolist()):
            rows = np.flatnonzero(angles == angle)
            yield rows, self._reacher(fixturing, angle), q[rows, :n_joints]

    def _reacher(self, name: str, angle: float = 0.0) -> Reacher:
        """Return the robot in one fixturing at an angle of its turntable; built when it is first needed."""
        self._fixturing(name)
        reacher = self._reachers.get((name, angle))
        if reacher is not None:
            return reacher
        around = self._around(name, self._hand.standing(name, angle))
        rest_joints = np.clip(0.0, self.robot.lower, self.robot.upper)
        built = Reacher(self.robot, around, rest_joints if self.home is None else self.home)
        return self._reachers.setdefault((name, angle), built)

    def _around(self, name: str, standing: Sequence[Standing]) -> Surroundings:
        """Return the arm of a fixturing among bodies."""
        return Surroundings(self._hand.arms[name], standing, self.clearance_mm, self._left_out)

    def _turned(self, name: str) -> TurnedAdvance:
        """Return how far moves on a turntable stay free."""
        if name not in self._advances:
            table = self._fixturing(name).table
            around = self._around(name, self._hand.still(name))
            turning = self._hand.turning(name)
            self._advances[name] = TurnedAdvance(
                self.robot.chain, around.all, turning, table, self.clearance_mm
            )
        return self._advances[name]

    def __getstate__(self) -> dict[str, Any]:
        """Leave geometry behind that cannot cross a process boundary; it is built again on demand."""
        hand = self._hand
        part = None if hand.part is None else (hand.part.shape.corners, hand.part.shape.triangles)
        return {
            "robot": self.robot,
            hand.field: hand.pose,
            "camera_body": self._fittings.camera_body,
            "light": self._fittings.light,
            "obstacles": self._fittings.obstacles,
            "clearance_mm": self.clearance_mm,
            "fixturings": self.fixturings,
            "home": self.home,
            "part": part,
        }

    def __setstate__(self, state: dict[str, Any]) -> None:
        part = state.pop("part")
        self.__init__(**state)  # type: ignore[misc]
        if part is not None:
            surface = Surface(part[0], part[1], closed=True)
            self._hand = self._hand.with_part(Standing("part", np.eye(4), surface))
            self._forget()

    def __repr__(self) -> str:
        names = ", ".join(self.fixturings)
        return f"<{type(self).__name__} {self.robot.name!r}, {self._hand.holds} {names}>"


class HeldPartCell(Cell):
    """A robot that holds the part before a camera that stands still, and everything it must not touch.

    **Guarantee.** As that of `Cell`, with the part in the hand, which keeps its shape.

    Parameters
    ----------
    robot : Robot
        The arm.
    cam2base : array_like, shape (4, 4)
        The camera's frame in the robot's base, mm.
    camera_body : sequence of Box, path or (corners, triangles)
        Camera, lens and lamps, in the camera's frame, mm.
    light : CarriedLight, optional
        The light of the camera, which stands still with it. A plan for the cell is lit by it. Default: none.
    obstacles : mapping of str to Box, path or (corners, triangles)
        What else stands in the cell, in the base frame, mm.
    clearance_mm : float
        Smallest distance to keep.
    fixturings : mapping of str to Grip
        The ways the robot holds the part, at least one, by name.
    home : sequence of float, optional
        Joints (k,) at which programs begin and end, rad.

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

    def __init__(
        self,
        robot: Robot,
        cam2base: Any,
        *,
        camera_body: Sequence[Body] = (),
        light: CarriedLight | None = None,
        obstacles: Mapping[str, Body] | None = None,
        clearance_mm: float = 10.0,
        fixturings: Mapping[str, Grip],
        home: Sequence[float] | None = None,
    ) -> None:
        self._check_robot(robot)
        self.cam2base = check_pose("cam2base", cam2base)
        fittings = _fittings(robot, camera_body, obstacles, clearance_mm, light)
        self._assemble(PartInHand, self.cam2base, fittings, fixturings, home)


def _fittings(
    robot: Robot,
    camera_body: Sequence[Body],
    obstacles: Mapping[str, Body] | None,
    clearance_mm: float,
    light: CarriedLight | None,
) -> Fittings:
    clearance = check_number("clearance_mm", clearance_mm, NOT_NEGATIVE)
    if light is not None:
        check_kinds(light=(light, "CarriedLight"))
    return Fittings(robot, tuple(camera_body), dict(obstacles or {}), clearance, light)


# Which settings of a plan a robot reaches in which fixturing, and what planning asks of a cell.


# of a cell without anything that may be touched; a file holds no infinite number
_FAR_MM = 1e6
_SAME_MM = 1e-3


def reachability_of(cell: Cell, plan: Any, *, all_branches: bool = False) -> Reachability:
    """Return what a cell with the part in it reaches of a plan, by the first joints or by all."""
    names = tuple(f"setting_{number:02d}" for number in range(1, len(plan.settings) + 1))
    cam2world = np.array([setting.cam2world for setting in plan.settings]).reshape(-1, 4, 4)
    segments = [
        np.array([plan.ends_of(setting, name) for name in setting.entities])
        for setting in plan.settings
    ]
    unlit = _unlit_of(plan)
    is_there = unlit is not None and _is_where(cell.light, plan.light.area)

    def hidden(fixturing: str, angle: float, row: int) -> str:
        bodies = cell.hidden_by(cam2world[row][None], segments[row], fixturing, angle)[0]
        names = plan.settings[row].entities
        both = zip(names, bodies, strict=True)
        words = next((f"{body} hides {name}" for name, body in both if body), "")
        if words or unlit is None:
            return words
        between, met = cell._hand.before_light(
            cam2world[row][None], segments[row], fixturing, angle
        )
        # where the plan has the backlight, it has decided itself what shows
        met |= is_there
        for name, body, is_met in zip(names, between[0], met[0], strict=True):
            if name not in unlit[row] and not is_met:
                return f"the backlight is not behind {name}"
            if name not in unlit[row] and body:
                return f"{body} hides the backlight behind {name}"
        return ""

    poses = {
        name: tuple(_in_sight(cell, cam2world, partial(hidden, name), name, all_branches))
        for name in cell.fixturings
    }
    return Reachability(names, poses)


def _unlit_of(plan: Any) -> Sequence[Any] | None:
    """Return what a backlight leaves dark in each setting; None of a plan that no backlight shows as outlines."""
    light = getattr(plan, "light", None)
    if light is None or light.kind != BACKLIGHT or light.area.on_metal:
        return None
    return tuple(light.unlit)


def _is_where(light: Any, area: Any) -> bool:
    """Return whether the light of a cell is where a plan has its backlight below the part."""
    return isinstance(light, LightBox) and np.allclose(light.rectangle, area.outline, atol=_SAME_MM)


def _in_sight(
    cell: Cell,
    cam2world: np.ndarray,
    hidden: Callable[[float, int], str],
    fixturing: str,
    all_branches: bool = False,
) -> list[PoseReach]:
    """Return what is known of poses (n, 4, 4) in a fixturing, given that nothing may hide their targets.

    ``hidden(angle, row)`` tells in words what hides a target of a pose at an angle of the turntable; empty if nothing.
    """

    def reach_at(angle: float, rows: np.ndarray) -> list[PoseReach]:
        poses = cell.reach(cam2world[rows], fixturing, all_branches=all_branches, angle=angle)
        words = [
            hidden(angle, int(row)) if pose.reached else ""
            for row, pose in zip(rows, poses, strict=True)
        ]
        return [
            PoseReach(np.empty((0, cell.robot.n_joints)), word) if word else pose
            for pose, word in zip(poses, words, strict=True)
        ]

    if cell.fixturings[fixturing].table is None:
        return reach_at(0.0, np.arange(len(cam2world)))
    return over_angles(reach_at, len(cam2world), cell.angles(fixturing), all_branches)


class CellRegion:
    """A `planner.request.reach.PoseRegion`.

    Parameters
    ----------
    cell : Cell
        With the part in it.
    """

    def __init__(self, cell: Cell) -> None:
        self._cell = cell

    @property
    def state_name(self) -> str:
        """Digest of the cell."""
        return self._cell.state_name

    def to_dict(self) -> dict[str, Any]:
        """Return what a plan file says of the cell."""
        return self._cell.to_dict()

    def inspectable(
        self, cam2world: np.ndarray, segments: np.ndarray, owner: np.ndarray, wanted: np.ndarray
    ) -> np.ndarray:
        """Return which targets the camera sees from poses that the robot reaches.

        Parameters
        ----------
        cam2world : array, shape (n, 4, 4)
            Poses of the camera in the part's frame, mm.
        segments : array, shape (s, 2, 3)
            Segments that show the targets, mm.
        owner : array of int, shape (s,)
            Number of each segment's target.
        wanted : array of bool, shape (n, k)
            The targets of interest.

        Returns
        -------
        array of bool, shape (n, k)
            Which of them no obstacle hides, in the fixturing that shows most of them.
        """
        best = np.zeros_like(wanted)
        for name, angle in self._ways:
            rows = np.flatnonzero(best.sum(axis=1) < wanted.sum(axis=1))
            if not rows.size:
                break
            poses = self._cell.reach(cam2world[rows], name, angle=angle)
            rows = rows[[pose.reached for pose in poses]]
            hidden = self._cell.hidden_by(cam2world[rows], segments, name, angle) != ""
            hidden |= self._cell._hand.before_light(cam2world[rows], segments, name, angle)[0] != ""
            seen = wanted[rows]
            for target in range(wanted.shape[1]):
                seen[:, target] &= ~hidden[:, owner == target].any(axis=1)
            better = seen.sum(axis=1) > best[rows].sum(axis=1)
            best[rows[better]] = seen[better]
        return best

    @property
    def _ways(self) -> list[tuple[str, float]]:
        """The fixturings, each at all angles of its turntable."""
        cell = self._cell
        return [(name, angle) for name in cell.fixturings for angle in cell.angles(name)]

    def poses_in_sight(
        self,
        cam2world: np.ndarray,
        segments: np.ndarray,
        name: str,
        *,
        all_branches: bool = False,
    ) -> list[PoseReach]:
        """Return what is known of poses (n, 4, 4) in a fixturing, with all segments (s, 2, 3) in sight."""

        def hidden(angle: float, row: int) -> str:
            views = cam2world[row][None]
            bodies = self._cell.hidden_by(views, segments, name, angle)[0]
            between = self._cell._hand.before_light(views, segments, name, angle)[0][0]
            words = [f"{body} hides it" for body in bodies if body]
            words += [f"{body} hides the backlight behind it" for body in between if body]
            return next(iter(words), "")

        return _in_sight(self._cell, cam2world, hidden, name, all_branches)

    def explain(self, cam2world: np.ndarray, segments: np.ndarray) -> str:
        """Return why poses (n, 4, 4) are not reached with all segments (s, 2, 3) in sight, in words."""
        parts = []
        for name in self._cell.fixturings:
            reasons = [pose.why for pose in self.poses_in_sight(cam2world, segments, name)]
            words = most_often([reason for reason in reasons if reason])
            parts.append(f"{words} ({reasons.count(words)} of {len(reasons)} poses in {name!r})")
        return ", ".join(parts)

    def placed(self, cam2world: np.ndarray, segments: np.ndarray) -> dict[str, ArmAt]:
        """Return how the robot stands at a pose (4, 4) with all segments (s, 2, 3) in sight, by fixturing."""
        arms = {}
        for name in self._cell.fixturings:
            pose = self.poses_in_sight(cam2world[None], segments, name)[0]
            if pose.reached:
                arms[name] = self._standing(pose, name)
        return arms

    def _standing(self, pose: PoseReach, name: str) -> ArmAt:
        near = self._cell.clearance(pose.branches[0], name)
        q = pose.joints[:1]
        return ArmAt(
            tuple(q[0].tolist()),
            min(near.mm, _FAR_MM),
            f"{near.first} and {near.second}" if near.first else "",
            float(self._cell.robot.to_limit_rad(q)[0]),
            float(self._cell.robot.singular_value(q)[0]),
            pose.angle_deg,
        )

    def travel_seconds(self, joints: np.ndarray, fixturing: str) -> np.ndarray:
        """Return the least time (n, n) between joints (n, k) or (n, k + 1) in a fixturing, at full speed, s."""
        turns = np.abs(joints[:, None] - joints[None])
        return np.asarray((turns / self._cell.rates(fixturing)[0]).max(axis=-1))

    def pose_margin(self, cam2world: np.ndarray) -> np.ndarray:
        """Return 1 for poses (n, 4, 4) that are reached in some fixturing, otherwise -1; (n,)."""
        margin = np.full(len(cam2world), -1.0)
        for name in self._cell.fixturings:
            rows = np.flatnonzero(margin < 0)
            if rows.size:
                poses = self._cell.reach(cam2world[rows], name)
                margin[rows[[pose.reached for pose in poses]]] = 1.0
        return margin
