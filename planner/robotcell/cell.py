"""The cell: a robot with a camera in its hand, the part in its fixturings, and what stands around."""

from __future__ import annotations

import hashlib
from abc import ABC
from collections.abc import Iterable, Iterator, Mapping, Sequence
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.argument_kinds import NOT_NEGATIVE, check_kinds, check_number, shown
from planner.exceptions import RobotError
from planner.robotcell.arm import Robot
from planner.robotcell.bodies import Body, Box, Surface, mesh_of
from planner.robotcell.cell_file import (
    arm_with_mount,
    cell_fields,
    check_hand_eye,
    check_home,
    check_home_is_free,
    check_names,
    check_part_stands_free,
    check_turns_free,
    pairs_by_design,
)
from planner.robotcell.collisions import (
    Arm,
    Surroundings,
    TurnedAdvance,
    bodies_of,
    farthest_points,
)
from planner.robotcell.joint_checks import JointChecks, PoseReach, Reacher, over_angles
from planner.robotcell.reachability import CellRegion, Reachability, reachability_of
from planner.robotcell.standing import (
    SKIN_MM,
    Fixturing,
    Standing,
    hidden_by,
    standing_bodies,
    sunk_mm,
)
from planner.robotcell.urdf import compose

if TYPE_CHECKING:
    from aspectgraph import Solid


# The digest of a cell, what a plan file says of it, and in what another cell differs.


_SHORT = 16
_FIXTURING = "fixturing "


class CellIdentity(ABC):
    """What a `Cell` says of itself."""

    robot: Robot
    cam2flange: np.ndarray
    clearance_mm: float
    home: np.ndarray | None
    fixturings: dict[str, Fixturing]
    _arm: Arm
    _camera_body: tuple[Body, ...]
    _standing: tuple[Standing, ...]
    _with_it: dict[str, tuple[Standing, ...]]
    _turning: dict[str, tuple[Standing, ...]]

    @property
    def state_name(self) -> str:
        """Digest of everything that decides what is reached."""
        own = (self.robot.state_name, self.clearance_mm, self.cam2flange.tolist())
        places: list[tuple[str, np.ndarray, Sequence[Standing]]]
        places = [("", np.eye(4), self._standing)]
        places += [
            (name, one.part2base, self._with_it[name]) for name, one in self.fixturings.items()
        ]
        places += [place for name in self.fixturings for place in self._table_of(name)]
        return f"cell {digest_of((*own, self._home_values), self._arm, places)}"

    @property
    def _home_values(self) -> list[float] | None:
        return None if self.home is None else self.home.tolist()

    def _table_of(self, name: str) -> list[tuple[str, np.ndarray, Sequence[Standing]]]:
        """Return what turns in a fixturing, as a place of the digest; nothing without a turntable."""
        table = self.fixturings[name].table
        if table is None:
            return []
        return [(repr((name, table.numbers)), np.eye(4), self._turning[name])]

    @property
    def parts(self) -> dict[str, str]:
        """Short digests of what the cell consists of, by name."""
        camera = [
            one.corners() if isinstance(one, Box) else mesh_of(one, "camera_body")[0]
            for one in self._camera_body
        ]
        found = {
            "robot": short_digest(self.robot.state_name),
            "cam2flange": short_digest(self.cam2flange.tolist()),
            "camera_body": short_digest([corners.tolist() for corners in camera]),
            "clearance_mm": short_digest(self.clearance_mm),
            "home": short_digest(self._home_values),
            "obstacles": short_digest(digest_of((), None, [("", np.eye(4), self._standing)])),
        }
        for name, one in self.fixturings.items():
            place = [(name, one.part2base, self._with_it[name]), *self._table_of(name)]
            found[_FIXTURING + name] = short_digest(digest_of((), None, place))
        return found

    def to_dict(self) -> dict[str, Any]:
        """Return what a plan file says of the cell.

        Returns
        -------
        dict
            Name of the robot, digest of the cell, and ``part2base`` of each fixturing; with the
            axes of turntables. ``parts`` are short digests, which show what was changed.
            ``bodiless_links`` are those whose collisions were not checked.
        """
        tables = {name: one.table for name, one in self.fixturings.items() if one.table}
        axes = {
            name: {"point": table.point.tolist(), "direction": table.direction.tolist()}
            for name, table in tables.items()
        }
        return {
            "robot": self.robot.name,
            "digest": self.state_name.split()[-1],
            "fixturings": {name: one.part2base.tolist() for name, one in self.fixturings.items()},
            "parts": self.parts,
            **({"turntables": axes} if axes else {}),
            **bodiless(self.robot),
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
        # plans of earlier versions name no parts
        before = stated.get("parts", {})
        names = [name for name in {**before, **now["parts"]} if name in before or before]
        changed = [name for name in names if before.get(name) != now["parts"].get(name)]
        words = [_named(name, before, now["parts"]) for name in changed]
        if not words:
            return "something that the plan does not name"
        return " and ".join([", ".join(words[:-1]), words[-1]] if words[:-1] else words)


def bodiless(robot: Robot) -> dict[str, list[str]]:
    """Return what a plan file says of links without geometry; empty if each has some."""
    return {"bodiless_links": list(robot.bodiless_links)} if robot.bodiless_links else {}


def _named(name: str, before: Mapping[str, str], now: Mapping[str, str]) -> str:
    """Return the name of a part of the cell as its file has it, and whether it is new or gone."""
    word = name
    if name.startswith(_FIXTURING):
        word = f"fixturing {name.removeprefix(_FIXTURING)!r}"
    if name not in before:
        return f"{word} (new)"
    return word if name in now else f"{word} (gone)"


def short_digest(value: Any, digits: int = _SHORT) -> str:
    """Return the first hexadecimal digits of the SHA-256 of a plain value."""
    return hashlib.sha256(repr(value).encode()).hexdigest()[:digits]


def digest_of(
    numbers: tuple[Any, ...],
    arm: Arm | None,
    places: Iterable[tuple[str, np.ndarray, Sequence[Standing]]],
) -> str:
    """Return the SHA-256 of an arm, of numbers, and of what stands still by name and pose."""
    digest = hashlib.sha256(repr(numbers).encode())
    for body in () if arm is None else arm.bodies:
        digest.update(body.hull.corners.tobytes())
    for name, pose, standing in places:
        digest.update(repr((name, pose.tolist())).encode())
        for one in standing:
            digest.update(repr((one.name, one.pose.tolist())).encode())
            digest.update(one.shape.corners.tobytes())
            digest.update(one.shape.triangles.astype("<i8").tobytes())
    return digest.hexdigest()


class Cell(JointChecks, CellIdentity):
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

    camera_field = "cam2flange"

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
        robot.check_bodies()
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
        bodies = bodies_of(robot, self.cam2flange, self._camera_body)
        self._arm = arm_with_mount(robot, bodies, self.clearance_mm)
        self._left_out = pairs_by_design(robot, self._arm)
        self._stand()
        self._reachers: dict[tuple[str, float], Reacher] = {}
        self._advances: dict[str, TurnedAdvance] = {}
        self.check()

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
        # a cell whose camera stands still is another class
        known: list[type[Cell]] = [Cell, *Cell.__subclasses__()]
        kinds = [one for one in known if one.camera_field in fields]
        return kinds[0](**fields)

    def with_part(self, solid: Solid, *, check: bool = True) -> Cell:
        """Return the cell with the part in it, so that nothing may touch the part either.

        Parameters
        ----------
        solid : Solid
            The part.
        check : bool
            Whether to `check` at once that it stands free.

        Returns
        -------
        Cell
            Everything but the part is shared.

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
        """Look at the part and at home.

        Raises
        ------
        RobotError
            If the part goes through an obstacle or the robot's base, or home is not free.
        """
        self.check_fixturings()
        self.check_place()

    def check_fixturings(self) -> None:
        """Look at the part among what comes with its fixtures, wherever these stand.

        Raises
        ------
        RobotError
            If the part goes through something that moves with it.
        """
        for name, fixturing in self.fixturings.items():
            if self._part is not None:
                part = self._part.at(fixturing.part2base)
                check_part_stands_free(name, part, self._coming_with(name), ())

    def check_place(self) -> None:
        """Look at the part among what stands in the cell, at turntables, and at home.

        Raises
        ------
        RobotError
            If the part goes through an obstacle or the robot's base, a turntable turns it into one, or home is not
            free.
        """
        for name, fixturing in self.fixturings.items():
            if self._part is not None:
                part = self._part.at(fixturing.part2base)
                check_part_stands_free(name, part, self._standing, self._arm.bodies)
            if fixturing.table is not None:
                still = [*self._standing, *self._with_it[name]]
                check_turns_free(
                    name, fixturing.table, self._turned_bodies(name), still, self._arm.bodies
                )
            if self.home is not None:
                check_home_is_free(name, self.blocked_by(self.home, name))

    def fixture_depths(
        self, enough_mm: float = np.inf
    ) -> Iterator[tuple[tuple[str, str, str], float]]:
        """Yield how deep the part and the objects of fixturings are in what stands in every one.

        Parameters
        ----------
        enough_mm : float
            Beyond this any depth that was found will do.

        Yields
        ------
        names : (str, str, str)
            The fixturing, the part or an object around it, and an obstacle or the link at the base.
        depth : float
            Their depth in each other, mm; 0 where they are apart. Up to 1 mm it may be larger.
        """
        base = [
            Standing(body.name, np.eye(4), body.hull)
            for body in self._arm.bodies
            if body.segment == 0
        ]
        for name in self.fixturings:
            for body in (*self._with_it[name], *self._turned_bodies(name)):
                for other in (*self._standing, *base):
                    yield (name, body.name, other.name), sunk_mm(body, other, SKIN_MM, enough_mm)

    def _coming_with(self, name: str) -> list[Standing]:
        """Return what a fixturing brings along at the angle 0."""
        return [*self._with_it[name], *self._turning[name]]

    def with_fixturings(self, fixturings: Mapping[str, Fixturing]) -> Cell:
        """Return the cell with other fixturings; the arm and the part are shared.

        Parameters
        ----------
        fixturings : mapping of str to Fixturing
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
        cell = self._copy()
        cell.fixturings = dict(fixturings)
        check_names(cell.fixturings, self._obstacles, self.robot)
        cell._stand()
        return cell

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
        """
        cell = self._copy()
        cell.fixturings = {name: one.moved(motion) for name, one in self.fixturings.items()}
        for of_cell in ("_with_it", "_turning"):
            moved = {
                name: tuple(body.at(compose(motion, body.pose)) for body in bodies)
                for name, bodies in getattr(self, of_cell).items()
            }
            setattr(cell, of_cell, moved)
        return cell

    def with_home(self, q: Sequence[float]) -> Cell:
        """Return the cell with another home.

        Parameters
        ----------
        q : sequence of float
            Joints (6,) at which programs begin and end, rad.

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

    def hidden_by(
        self, cam2world: np.ndarray, segments: np.ndarray, fixturing: str, angle: float = 0.0
    ) -> np.ndarray:
        """Return which obstacle hides segments from cameras.

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
            Names; empty where no obstacle is in the way.
        """
        part2base = self.part2base(fixturing, angle)
        standing = self._bodies_at(fixturing, angle)
        return hidden_by(standing, part2base, cam2world[:, :3, 3], segments)

    @property
    def pairs_left_out(self) -> tuple[tuple[str, str], ...]:
        """Links that are not compared: they touch in nearly all joints, or nowhere, because the arm is built so."""
        names = [body.name for body in self._arm.bodies]
        return tuple((names[first], names[second]) for first, second in self._left_out)

    @property
    def obstacles(self) -> tuple[str, ...]:
        """Names of what stands in the cell in every fixturing."""
        return tuple(self._obstacles)

    @property
    def near_by_mount(self) -> tuple[str, ...]:
        """What the mount leaves less than the clearance, in words: there, only touching is refused."""
        bodies = self._arm.bodies
        least: dict[tuple[str, str], float] = {}
        for (first, second), mm in self._arm.near_by_mount.items():
            pair = (bodies[second].name, bodies[first].name)
            least[pair] = min(mm, least.get(pair, np.inf))
        return tuple(
            f"{held} is mounted {mm:.3g} mm from {link}, clearance {self.clearance_mm:g}: "
            "these two must only not touch"
            for (held, link), mm in least.items()
        )

    @property
    def levers_mm(self) -> np.ndarray:
        """How far from each joint's axis (6,) a point of the arm or the camera can be, at most, mm."""
        return farthest_points(self.robot.chain, self._arm)

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
        return reachability_of(self.with_part(solid), plan, all_branches=all_branches)

    def _fixturing(self, name: str) -> Fixturing:
        if name not in self.fixturings:
            rule = f"must be one of {', '.join(map(repr, self.fixturings))}"
            raise RobotError.of_rule("fixturing", rule, shown(name))
        return self.fixturings[name]

    def _stand(self) -> None:
        """Build what comes with the fixturings."""
        self._with_it = {
            name: standing_bodies(one.obstacles, "obstacle")
            for name, one in self.fixturings.items()
        }
        self._turning = {
            name: standing_bodies(one.turning, "turning") for name, one in self.fixturings.items()
        }

    def _bodies_at(self, name: str, angle: float) -> list[Standing]:
        """Return all obstacles of a fixturing where they are at an angle of its turntable."""
        table = self._fixturing(name).table
        turned: Sequence[Standing] = self._turning[name]
        if table is not None:
            motion = table.pose(angle)
            turned = [body.at(compose(motion, body.pose)) for body in turned]
        return [*self._standing, *self._with_it[name], *turned]

    def _turned_bodies(self, name: str) -> list[Standing]:
        """Return what turns with the part, and the part, at the angle 0."""
        part = [] if self._part is None else [self._part.at(self.part2base(name))]
        return [*self._turning[name], *part]

    def _reacher(self, name: str, angle: float = 0.0) -> Reacher:
        """Return the robot in one fixturing; built when it is first asked for."""
        known = self._reachers.get((name, angle))
        if known is not None:
            return known
        standing = self._bodies_at(name, angle)
        if self._part is not None:
            standing.append(self._part.at(self.part2base(name, angle)))
        around = Surroundings(self._arm, standing, self.clearance_mm, self._left_out)
        rest = np.clip(0.0, self.robot.lower, self.robot.upper)
        built = Reacher(self.robot, around, rest if self.home is None else self.home)
        return self._reachers.setdefault((name, angle), built)

    def _turned(self, name: str) -> TurnedAdvance:
        """Return how far moves on a turntable stay free."""
        if name not in self._advances:
            table = self._fixturing(name).table
            assert table is not None
            still = [*self._standing, *self._with_it[name]]
            around = Surroundings(self._arm, still, self.clearance_mm, self._left_out)
            turning = self._turned_bodies(name)
            self._advances[name] = TurnedAdvance(
                self.robot.chain, around.all, turning, table, self.clearance_mm
            )
        return self._advances[name]

    def _copy(self) -> Cell:
        cell = object.__new__(type(self))
        cell.__dict__.update(self.__dict__)
        cell._reachers = {}
        cell._advances = {}
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
            self._advances = {}

    def __repr__(self) -> str:
        return f"<Cell {self.robot.name!r}, fixturings {', '.join(self.fixturings)}>"
