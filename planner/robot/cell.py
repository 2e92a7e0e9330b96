"""The cell: a robot with a camera in its hand, the part in its fixturings, and what stands around."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.argument_kinds import NOT_NEGATIVE, check_kinds, check_number, shown
from planner.exceptions import RobotError
from planner.robot.arm import Robot
from planner.robot.bodies import Body, Box, Surface, hull_of, mesh_of
from planner.robot.cell_checks import (
    check_hand_eye,
    check_home,
    check_names,
    check_part_stands_free,
    pairs_by_design,
)
from planner.robot.cell_file import cell_fields
from planner.robot.collisions import (
    HAND,
    Arm,
    Closeness,
    Moving,
    Surroundings,
)
from planner.robot.pose_reach import ArmAt, PoseReach, Reacher, most_often
from planner.robot.reachability import Reachability, reachability_of
from planner.robot.standing import Fixturing, Standing, standing_bodies
from planner.robot.transforms import carry, compose, invert

if TYPE_CHECKING:
    from aspectgraph import Solid

# of a cell without anything that may be touched; a file holds no infinite number
_FAR_MM = 1e6


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
    obstacles : mapping of str to Box, path or (corners, triangles)
        What stands in the cell in every fixturing, in the base frame, mm.
    clearance_mm : float
        Smallest distance to keep.
    fixturings : mapping of str to Fixturing
        The ways the part lies, at least one, by name.
    home : sequence of float, optional
        Joints (6,) at which programs begin and end, rad.

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
        obstacles: Mapping[str, Body] | None = None,
        clearance_mm: float = 10.0,
        fixturings: Mapping[str, Fixturing],
        home: Sequence[float] | None = None,
    ) -> None:
        check_kinds(robot=(robot, "Robot"))
        self.robot = robot
        robot.check_solvable()
        self.cam2flange = check_hand_eye(cam2flange)
        self.clearance_mm = check_number("clearance_mm", clearance_mm, NOT_NEGATIVE)
        self.fixturings = dict(fixturings)
        self.home = check_home(home, robot)
        self._camera_body = tuple(camera_body)
        self._obstacles = dict(obstacles or {})
        check_names(self.fixturings, self._obstacles, robot)
        self._part: Standing | None = None
        self._standing = standing_bodies(self._obstacles, "obstacle")
        self._arm = Arm([*_links(robot), *self._camera()])
        self._left_out = pairs_by_design(robot, self._arm)
        self._with_it = {
            name: standing_bodies(one.obstacles, "obstacle")
            for name, one in self.fixturings.items()
        }
        self._reachers: dict[str, Reacher] = {}
        self.check()

    @classmethod
    def from_toml(cls, path: str | PathLike[str]) -> Cell:
        """Read a cell file; see docs/guides/robot-cells.md for its fields."""
        return cls(**cell_fields(path))

    def with_part(self, solid: Solid, *, check: bool = True) -> Cell:
        """Return the cell with the part in it, so that nothing may touch the part either.

        Parameters
        ----------
        solid : Solid
            The part.
        check : bool
            Whether to look at once if it stands free; otherwise `check` does so.

        Raises
        ------
        RobotError
            If a fixturing puts the part through an obstacle or the base of the robot.
        """
        surface = Surface(solid.vertices, solid.triangles, closed=True)
        cell = self._copy()
        cell._part = Standing("part", np.eye(4), surface)
        if check:
            cell.check()
        return cell

    def check(self) -> None:
        """Raise `RobotError` if the part goes through an obstacle or the robot's base, or home is not free."""
        bases = [body for body in self._arm.bodies if body.segment == 0]
        for name, fixturing in self.fixturings.items():
            if self._part is not None:
                placed = self._part.at(fixturing.part2base)
                check_part_stands_free(name, placed, [*self._standing, *self._with_it[name]], bases)
            words = "" if self.home is None else self.blocked_by(self.home, name)
            if words:
                rule = f"must be free of collisions in fixturing {name!r}"
                raise RobotError.of_rule("home", rule, words)

    def with_fixturings(self, fixturings: Mapping[str, Fixturing]) -> Cell:
        """Return the cell with other fixturings; the arm and the part are not built again."""
        cell = self._copy()
        cell.fixturings = dict(fixturings)
        check_names(cell.fixturings, self._obstacles, self.robot)
        cell._with_it = {
            name: standing_bodies(one.obstacles, "obstacle") for name, one in fixturings.items()
        }
        return cell

    def moved(self, motion: np.ndarray) -> Cell:
        """Return the cell with all fixturings, their obstacles too, moved by a pose (4, 4) of the base, mm.

        Nothing is built again, and nothing is checked; `check` does so.
        """
        cell = self._copy()
        cell.fixturings = {name: one.moved(motion) for name, one in self.fixturings.items()}
        cell._with_it = {
            name: tuple(body.at(compose(motion, body.pose)) for body in bodies)
            for name, bodies in self._with_it.items()
        }
        return cell

    def with_home(self, q: Sequence[float]) -> Cell:
        """Return the cell with other joints (6,) at which programs begin and end, rad."""
        cell = self._copy()
        cell.home = check_home(q, self.robot)
        cell.check()
        return cell

    def flange(self, cam2world: np.ndarray, fixturing: str) -> np.ndarray:
        """Return the poses of the tip in the base, (n, 4, 4) or (4, 4), for poses of the camera in the part's frame."""
        camera = compose(self._fixturing(fixturing).part2base, np.asarray(cam2world, dtype=float))
        return compose(camera, invert(self.cam2flange))

    def cam2world(self, q: np.ndarray, fixturing: str) -> np.ndarray:
        """Return the camera's poses (n, 4, 4) in the part's frame for joints (n, 6)."""
        camera = compose(self.robot.forward(q), self.cam2flange)
        return compose(invert(self._fixturing(fixturing).part2base), camera)

    def reach(
        self, cam2world: np.ndarray, fixturing: str, *, all_branches: bool = False
    ) -> list[PoseReach]:
        """Return by which joints the robot brings the camera to poses, or why it does not.

        Parameters
        ----------
        cam2world : array, shape (n, 4, 4)
            Poses of the camera in the part's frame, mm.
        fixturing : str
            Which way the part lies.
        all_branches : bool
            Whether to look for all joints without collision. Default: the first ones.

        Returns
        -------
        list of PoseReach
            One for each pose.
        """
        poses = np.asarray(cam2world, dtype=np.float64).reshape(-1, 4, 4)
        return self._reacher(fixturing).reach(self.flange(poses, fixturing), all_branches)

    def hidden_by(self, cam2world: np.ndarray, segments: np.ndarray, fixturing: str) -> np.ndarray:
        """Return which obstacle hides segments from cameras.

        Parameters
        ----------
        cam2world : array, shape (n, 4, 4)
            Poses of the camera in the part's frame, mm.
        segments : array, shape (s, 2, 3)
            Segments in the part's frame, mm.
        fixturing : str
            Which way the part lies.

        Returns
        -------
        array of str, shape (n, s)
            Names; empty where no obstacle is in the way.
        """
        part2base = self._fixturing(fixturing).part2base
        eyes = carry(part2base, cam2world[:, :3, 3])
        placed = carry(part2base, segments.reshape(-1, 3)).reshape(-1, 2, 3)
        names = np.full((len(eyes), len(segments)), "", dtype=object)
        for body in (*self._standing, *self._with_it[fixturing]):
            names[(names == "") & body.hides(eyes, placed)] = body.name
        return names

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
        for name in self.fixturings:
            left = np.flatnonzero(best.sum(axis=1) < wanted.sum(axis=1))
            told = self.reach(cam2world[left], name)
            left = left[[one.reached for one in told]]
            hidden = self.hidden_by(cam2world[left], segments, name) != ""
            seen = wanted[left]
            for target in range(wanted.shape[1]):
                seen[:, target] &= ~hidden[:, owner == target].any(axis=1)
            better = seen.sum(axis=1) > best[left].sum(axis=1)
            best[left[better]] = seen[better]
        return best

    def explain(self, cam2world: np.ndarray, segments: np.ndarray) -> str:
        """Return why poses (n, 4, 4) are not reached with all segments (s, 2, 3) in sight, in words."""
        parts = []
        for name in self.fixturings:
            hidden = self.hidden_by(cam2world, segments, name)
            reasons = [
                one.why or next((f"{body} hides it" for body in row if body), "")
                for one, row in zip(self.reach(cam2world, name), hidden, strict=True)
            ]
            words = most_often([reason for reason in reasons if reason])
            parts.append(f"{words} ({reasons.count(words)} of {len(reasons)} poses in {name!r})")
        return ", ".join(parts)

    def placed(self, cam2world: np.ndarray, segments: np.ndarray) -> dict[str, ArmAt]:
        """Return how the robot stands at a pose (4, 4) with all segments (s, 2, 3) in sight, by fixturing."""
        found = {}
        for name in self.fixturings:
            branches = self.reach(cam2world[None], name)[0].branches
            if len(branches) and not (self.hidden_by(cam2world[None], segments, name) != "").any():
                q = branches[:1]
                near = self.clearance(q[0], name)
                found[name] = ArmAt(
                    tuple(q[0].tolist()),
                    min(near.mm, _FAR_MM),
                    f"{near.first} and {near.second}" if near.first else "",
                    float(self.robot.to_limit_rad(q)[0]),
                    float(self.robot.singular_value(q)[0]),
                )
        return found

    def travel_seconds(self, joints: np.ndarray) -> np.ndarray:
        """Return the least time (n, n) between joints (n, 6), at full speed, s."""
        turns = np.abs(joints[:, None] - joints[None])
        return np.asarray((turns / self.robot.speeds).max(axis=-1))

    def to_dict(self) -> dict[str, Any]:
        """Return what a plan file says of the cell."""
        return {
            "robot": self.robot.name,
            "digest": self.state_name.split()[-1],
            "fixturings": {name: one.part2base.tolist() for name, one in self.fixturings.items()},
        }

    def pose_margin(self, cam2world: np.ndarray) -> np.ndarray:
        """Return 1 for poses (n, 4, 4) that are reached in some fixturing, otherwise -1; (n,)."""
        margin = np.full(len(cam2world), -1.0)
        for name in self.fixturings:
            left = np.flatnonzero(margin < 0)
            if left.size:
                told = self.reach(cam2world[left], name)
                margin[left[[one.reached for one in told]]] = 1.0
        return margin

    def free(self, q: np.ndarray, fixturing: str) -> np.ndarray:
        """Return which joints (n, 6) are within limits and keep the clearance; (n,) bool."""
        return self._reacher(fixturing).free(np.asarray(q, dtype=np.float64))

    def blocked_by(self, q: np.ndarray, fixturing: str) -> str:
        """Return what is wrong with joints (6,), in words; empty if they are free."""
        return self._reacher(fixturing).blocked_by(np.asarray(q, dtype=np.float64))

    def clearance(self, q: np.ndarray, fixturing: str) -> Closeness:
        """Return the closest two objects at joints (6,), and their distance in mm."""
        return Closeness(*self._reacher(fixturing).closest(np.asarray(q, dtype=np.float64)))

    def slack_bound(
        self, q: np.ndarray, fixturing: str, enough_mm: float = np.inf, *, share: float = 1.0
    ) -> np.ndarray:
        """Return by how much all distances exceed those required, at least, for joints (n, 6).

        Parameters
        ----------
        q : array, shape (n, 6)
            Joints, rad.
        fixturing : str
            Which way the part lies.
        enough_mm : float
            Below this the result is exact; above, a quick lower bound.
        share : float
            Share of the clearance that is required.

        Returns
        -------
        array, shape (n,)
            Millimetres; negative if the clearance is not kept, -inf if objects touch.
        """
        reacher = self._reacher(fixturing)
        return reacher.slack(np.asarray(q, dtype=np.float64), share * reacher.required, enough_mm)

    def in_fixturing(self, fixturing: str) -> Reacher:
        """Return the robot in one fixturing, as moves are checked in it.

        Parameters
        ----------
        fixturing : str
            Which way the part lies.

        Returns
        -------
        Reacher
            Built when it is first needed.
        """
        return self._reacher(fixturing)

    def distance_bound(
        self, q: np.ndarray, fixturing: str, enough_mm: float = np.inf
    ) -> np.ndarray:
        """Return a lower bound (n,) of the distance of any two objects, as `slack_bound` does without a clearance."""
        return np.maximum(self.slack_bound(q, fixturing, enough_mm, share=0.0), 0.0)

    @property
    def levers_mm(self) -> np.ndarray:
        """How far from each joint's axis (6,) a point of the arm or the camera can be, at most."""
        offsets = np.sqrt((self.robot.chain.steps[:, :3, 3] ** 2).sum(axis=1))
        farthest = np.zeros(HAND + 1)
        for body in self._arm.bodies:
            size = float(np.sqrt((body.hull.corners**2).sum(axis=1)).max())
            farthest[body.segment] = max(farthest[body.segment], size)
        levers = np.zeros(HAND)
        for joint in range(HAND):
            lengths = np.concatenate([[0.0], np.cumsum(offsets[joint + 1 :])])
            levers[joint] = (lengths + farthest[joint + 1 :]).max()
        return levers

    def reachability(self, plan: Any, solid: Solid, *, all_branches: bool = False) -> Reachability:
        """Return which settings of a plan the robot reaches in which fixturing, or why not.

        A setting is not reached either where an obstacle hides one of its targets.

        Parameters
        ----------
        plan : InspectionPlan
            A plan, made with this cell or without one.
        solid : Solid
            The part.
        all_branches : bool
            Whether to look for all joints without collision. Default: the first ones.
        """
        return reachability_of(self.with_part(solid), plan, all_branches=all_branches)

    @property
    def state_name(self) -> str:
        """Digest of everything that decides what is reached."""
        digest = hashlib.sha256(self.robot.state_name.encode())
        digest.update(repr((self.clearance_mm, self.cam2flange.tolist())).encode())
        digest.update(repr(None if self.home is None else self.home.tolist()).encode())
        for body in self._arm.bodies:
            digest.update(body.hull.corners.tobytes())
        places = [("", np.eye(4), self._standing)]
        places += [
            (name, one.part2base, self._with_it[name]) for name, one in self.fixturings.items()
        ]
        for name, pose, bodies in places:
            digest.update(repr((name, pose.tolist())).encode())
            for standing in bodies:
                shape = standing.shape
                digest.update(repr((standing.name, standing.pose.tolist())).encode())
                digest.update(shape.corners.tobytes())
                digest.update(shape.triangles.astype("<i8").tobytes())
        return f"cell {digest.hexdigest()}"

    def _camera(self) -> list[Moving]:
        """Return the bodies that the hand carries."""
        in_hand = compose(self.robot.chain.tip, self.cam2flange)
        bodies = []
        for body in self._camera_body:
            points = body.corners() if isinstance(body, Box) else mesh_of(body, "camera_body")[0]
            bodies.append(Moving("camera", HAND, hull_of(carry(in_hand, points), "camera_body")))
        return bodies

    def _fixturing(self, name: str) -> Fixturing:
        if name not in self.fixturings:
            rule = f"must be one of {', '.join(map(repr, self.fixturings))}"
            raise RobotError.of_rule("fixturing", rule, shown(name))
        return self.fixturings[name]

    def _reacher(self, name: str) -> Reacher:
        """Return the robot in one fixturing; built when it is first asked for."""
        if name not in self._reachers:
            standing = [*self._standing, *self._with_it.get(name, ())]
            pose = self._fixturing(name).part2base
            if self._part is not None:
                standing.append(self._part.at(pose))
            around = Surroundings(self._arm, standing, self.clearance_mm, self._left_out)
            rest = np.clip(0.0, self.robot.lower, self.robot.upper)
            self._reachers[name] = Reacher(
                self.robot, around, rest if self.home is None else self.home
            )
        return self._reachers[name]

    def _copy(self) -> Cell:
        cell = object.__new__(Cell)
        cell.__dict__.update(self.__dict__)
        cell._reachers = {}
        return cell

    def __getstate__(self) -> dict[str, Any]:
        """Leave geometry behind that cannot cross a process boundary; it is built again on demand."""
        part = (
            None if self._part is None else (self._part.shape.corners, self._part.shape.triangles)
        )
        return {
            "robot": self.robot,
            "cam2flange": self.cam2flange,
            "camera_body": self._camera_body,
            "obstacles": self._obstacles,
            "clearance_mm": self.clearance_mm,
            "fixturings": self.fixturings,
            "home": self.home,
            "part": part,
        }

    def __setstate__(self, state: dict[str, Any]) -> None:
        part = state.pop("part")
        self.__init__(**state)  # type: ignore[misc]
        if part is not None:
            self._part = Standing("part", np.eye(4), Surface(part[0], part[1], closed=True))
            self._reachers = {}

    def __repr__(self) -> str:
        return f"<Cell {self.robot.name!r}, fixturings {', '.join(self.fixturings)}>"


def _links(robot: Robot) -> list[Moving]:
    """Return the links of an arm."""
    return [
        Moving(name, segment, hull)
        for segment, (name, hulls) in enumerate(zip(robot.segment_names, robot.hulls, strict=True))
        for hull in hulls
    ]
