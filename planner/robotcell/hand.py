"""What the hand of a robot carries: the camera before a part that lies, or the part before a camera that stands still.

The one is the mirror image of the other: tip(q) · cam2flange = part2base · cam2world, and
tip(q) · part2flange · cam2world = cam2base. So the same reach, the same collisions and the same moves serve both.
A `Cell` holds one of the two, which knows all in which they differ.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from itertools import islice
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from planner.argument_kinds import shown
from planner.exceptions import RobotError
from planner.robotcell.arm import Robot
from planner.robotcell.bodies import (
    SKIN_MM,
    Body,
    Box,
    Fixturing,
    Grip,
    Standing,
    Surface,
    Turntable,
    hidden_by,
    hull_of,
    mesh_of,
    standing_bodies,
    sunk_mm,
)
from planner.robotcell.branches import needed
from planner.robotcell.cell_light import CarriedLight, LightBox
from planner.robotcell.collisions import Arm, Moving, PairGroup, bodies_of
from planner.robotcell.urdf import (
    carry,
    check_pose,
    check_rotations,
    compose,
    invert,
)

_SHORT = 16
FIXTURING = "fixturing "
"""What the name of a fixturing begins with among the parts of a cell."""


@dataclass(frozen=True, eq=False)
class Fittings:
    """What a cell has, whatever its hand carries.

    Attributes
    ----------
    robot : Robot
        The arm.
    camera_body : tuple of Box, path or (corners, triangles)
        Camera, lens and lamps, in the camera's frame, mm.
    obstacles : mapping of str to Box, path or (corners, triangles)
        What stands in the cell in every fixturing, in the base frame, mm.
    clearance_mm : float
        Smallest distance to keep.
    light : CarriedLight or None
        The light that moves with the camera.
    """

    robot: Robot
    camera_body: tuple[Body, ...]
    obstacles: Mapping[str, Body]
    clearance_mm: float
    light: CarriedLight | None = None

    @property
    def light_bodies(self) -> tuple[Body, ...]:
        """The solids of the light that moves with the camera, in the camera's frame, mm."""
        return () if self.light is None else self.light.bodies()

    def standing(self) -> tuple[Standing, ...]:
        """Return the obstacles as bodies."""
        return standing_bodies(self.obstacles, "obstacle")


_Places = list[tuple[str, np.ndarray, Sequence[Standing]]]


class CameraInHand:
    """The hand carries the camera; the part lies in fixturings.

    Parameters
    ----------
    fittings : Fittings
        Robot, camera and obstacles.
    cam2flange : array (4, 4)
        The camera's frame in the robot's tip, mm.
    fixturings : mapping of str to Fixturing
        The ways the part lies; `check_names` has accepted them.

    Attributes
    ----------
    obstacles : tuple of Standing
        What stands in the cell in every fixturing.
    pose : array (4, 4)
        Of the camera, `cam2flange`.
    part : Standing or None
        The part in its own frame.
    arms : dict of str to Arm
        The arm with what it carries, by fixturing.
    """

    field = "cam2flange"
    holds = "fixturings"

    def __init__(
        self, fittings: Fittings, cam2flange: np.ndarray, fixturings: Mapping[str, Fixturing]
    ) -> None:
        self.fittings = fittings
        self.obstacles = fittings.standing()
        self.pose = cam2flange
        self.part: Standing | None = None
        bodies = bodies_of(fittings.robot, cam2flange, fittings.camera_body, fittings.light_bodies)
        self._arm = arm_with_mount(fittings.robot, bodies, fittings.clearance_mm)
        self._stand(fixturings)

    def _stand(self, fixturings: Mapping[str, Fixturing]) -> None:
        """Build what comes with the fixturings."""
        self.fixturings = dict(fixturings)
        self.arms = dict.fromkeys(self.fixturings, self._arm)
        self._beside = {
            name: standing_bodies(fixturing.obstacles, "obstacle")
            for name, fixturing in self.fixturings.items()
        }
        self._turning = {
            name: standing_bodies(fixturing.turning, "turning")
            for name, fixturing in self.fixturings.items()
        }

    def with_part(self, part: Standing) -> CameraInHand:
        """Return the same with the part in its fixturings."""
        result = copy(self)
        result.part = part
        return result

    def with_fixturings(self, fixturings: Mapping[str, Fixturing]) -> CameraInHand:
        """Return the same with other fixturings."""
        result = copy(self)
        result._stand(fixturings)
        return result

    def moved(self, motion: np.ndarray) -> CameraInHand:
        """Return the same with all fixturings and what comes with them moved in the base; geometry is shared."""
        result = copy(self)
        result.fixturings = {
            name: fixturing.moved(motion) for name, fixturing in self.fixturings.items()
        }
        result._beside = _moved(self._beside, motion)
        result._turning = _moved(self._turning, motion)
        return result

    def parts_at(self, q: np.ndarray, fixturing: str) -> np.ndarray:
        """Return where the part is in the base (..., 4, 4), for joints (..., k) and a turntable's angle behind them."""
        if q.ndim > 1:
            return np.array([self.parts_at(row, fixturing) for row in q]).reshape(-1, 4, 4)
        lying = self.fixturings[fixturing]
        if lying.table is None:
            return lying.part2base
        angle = float(np.sum(q[self.fittings.robot.n_joints :]))
        return compose(lying.table.pose(angle), lying.part2base)

    def cameras_at(self, q: np.ndarray) -> np.ndarray:
        """Return where the camera is in the base for joints (n, k)."""
        return compose(self.fittings.robot.forward(q), self.pose)

    def tips(self, cam2world: np.ndarray, fixturing: str, angle: float) -> np.ndarray:
        """Return the poses (..., 4, 4) of the tip for poses of the camera in the part's frame."""
        part = self._part2base(fixturing, angle)
        camera = compose(part, check_rotations("cam2world", cam2world))
        return compose(camera, invert(self.pose))

    def _part2base(self, fixturing: str, angle: float) -> np.ndarray:
        return self.parts_at(np.append(np.zeros(self.fittings.robot.n_joints), angle), fixturing)

    def hidden_by(
        self, cam2world: np.ndarray, segments: np.ndarray, fixturing: str, angle: float
    ) -> np.ndarray:
        """Return the names (n, s) of what hides segments (s, 2, 3) from cameras (n, 4, 4); empty where nothing does."""
        part2base = self._part2base(fixturing, angle)
        bodies = self._all_obstacles(fixturing, angle)
        return hidden_by(bodies, part2base, cam2world[:, :3, 3], segments)

    def before_light(
        self, cam2world: np.ndarray, segments: np.ndarray, fixturing: str, angle: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return what is between segments (s, 2, 3) and the backlight, and whether that is behind them, (n, s).

        It is behind them where the lines of sight past both ends meet the bright rectangle. The part itself does not
        count as between. Without a backlight, nothing is between, and it counts as behind.
        """
        shape = (len(cam2world), len(segments))
        names = np.full(shape, "", dtype=object)
        light = _backlight_of(fixturing, self.fixturings[fixturing])
        if light is None:
            return names, np.ones(shape, dtype=bool)
        lying = self.fixturings[fixturing]
        around = {**lying.obstacles, **lying.turning}
        lights = [name for name, body in around.items() if isinstance(body, LightBox)]
        ends, met = light.behind(cam2world[:, :3, 3], segments)
        part2base = self._part2base(fixturing, angle)
        bodies = [body for body in self._all_obstacles(fixturing, angle) if body.name not in lights]
        for row in np.flatnonzero(met.any(axis=1)).tolist():
            eye = cam2world[row, :3, 3][None]
            columns = np.flatnonzero(met[row])
            names[row, columns] = hidden_by(bodies, part2base, eye, ends[row, columns])[0]
        return names, met

    def still(self, fixturing: str) -> list[Standing]:
        """Return what does not turn with the part."""
        return [*self.obstacles, *self._beside[fixturing]]

    def turning(self, fixturing: str) -> list[Standing]:
        """Return what turns with the part, and the part, at the angle 0."""
        part = [] if self.part is None else [self.part.at(self._part2base(fixturing, 0.0))]
        return [*self._turning[fixturing], *part]

    def standing(self, fixturing: str, angle: float) -> list[Standing]:
        """Return all that stands still, with the part, where it is at an angle of the turntable."""
        bodies = self._all_obstacles(fixturing, angle)
        if self.part is not None:
            bodies.append(self.part.at(self._part2base(fixturing, angle)))
        return bodies

    def _all_obstacles(self, fixturing: str, angle: float) -> list[Standing]:
        table = self.fixturings[fixturing].table
        turned: Sequence[Standing] = self._turning[fixturing]
        if table is not None:
            motion = table.pose(angle)
            turned = [body.at(compose(motion, body.pose)) for body in turned]
        return [*self.still(fixturing), *turned]

    def check_fixturing(self, name: str) -> None:
        """Raise if the part goes through what comes with its fixture."""
        if self.part is not None:
            part = self.part.at(self.fixturings[name].part2base)
            coming = [*self._beside[name], *self._turning[name]]
            check_part_stands_free(name, part, coming, ())

    def check_place(self, name: str) -> None:
        """Raise if the part goes through an obstacle or the robot's base, or a turntable turns it into one."""
        fixturing = self.fixturings[name]
        links = self._arm.bodies
        if self.part is not None:
            part = self.part.at(fixturing.part2base)
            check_part_stands_free(name, part, self.obstacles, links)
        if fixturing.table is not None:
            turning = self.turning(name)
            check_turns_free(name, fixturing.table, turning, self.still(name), links)

    def depths(self, enough_mm: float) -> Iterator[tuple[tuple[str, str, str], float]]:
        """Yield how deep the part and the objects of fixturings are in what stands in every one."""
        base = [
            Standing(body.name, np.eye(4), body.hull)
            for body in self._arm.bodies
            if body.segment == 0
        ]
        for name in self.fixturings:
            for body in (*self._beside[name], *self.turning(name)):
                for other in (*self.obstacles, *base):
                    yield (name, body.name, other.name), sunk_mm(body, other, SKIN_MM, enough_mm)

    def digest(self, home: list[float] | None) -> str:
        """Return the SHA-256 of everything that decides what is reached."""
        fittings = self.fittings
        numbers = (fittings.robot.state_name, fittings.clearance_mm, self.pose.tolist(), home)
        places: _Places = [("", np.eye(4), self.obstacles)]
        places += [self._place(name) for name in self.fixturings]
        places += [table for name in self.fixturings for table in self._table(name)]
        return digest_of(numbers, self._arm, places)

    def camera_digest(self) -> str:
        """Return a short digest of the camera's body."""
        bodies = self.fittings.camera_body
        corners = [
            body.corners() if isinstance(body, Box) else mesh_of(body, "camera_body")[0]
            for body in bodies
        ]
        return short_digest([points.tolist() for points in corners])

    def places(self, name: str) -> _Places:
        """Return what comes with a fixturing, as places of a digest."""
        return [self._place(name), *self._table(name)]

    def _place(self, name: str) -> tuple[str, np.ndarray, Sequence[Standing]]:
        return name, self.fixturings[name].part2base, self._beside[name]

    def _table(self, name: str) -> _Places:
        """Return what turns in a fixturing; nothing without a turntable."""
        table = self.fixturings[name].table
        if table is None:
            return []
        return [(repr((name, table.numbers)), np.eye(4), self._turning[name])]

    def poses(self) -> dict[str, np.ndarray]:
        """Return the pose of the part in the base for each fixturing."""
        return {name: fixturing.part2base for name, fixturing in self.fixturings.items()}

    def stated(self) -> dict[str, Any]:
        """Return what else a plan file says: the axes of turntables."""
        axes = axes_of(self.fixturings)
        return {"turntables": axes} if axes else {}


class PartInHand:
    """The hand carries the part, in grips; the camera stands still.

    Parameters
    ----------
    fittings : Fittings
        Robot, camera and obstacles.
    cam2base : array (4, 4)
        The camera's frame in the robot's base, mm.
    fixturings : mapping of str to Grip
        The ways the robot holds the part; `check_names` has accepted them.

    Attributes
    ----------
    obstacles : tuple of Standing
        What stands in the cell in every fixturing.
    pose : array (4, 4)
        Of the camera, `cam2base`.
    part : Standing or None
        The part in its own frame.
    arms : dict of str to Arm
        The arm with what it carries, by grip.
    """

    field = "cam2base"
    holds = "grips"

    def __init__(
        self, fittings: Fittings, cam2base: np.ndarray, fixturings: Mapping[str, Grip]
    ) -> None:
        self.fittings = fittings
        self.obstacles = fittings.standing()
        self.pose = cam2base
        self.part: Standing | None = None
        bodies = {f"camera {k}": body for k, body in enumerate(fittings.camera_body)}
        self._camera = standing_bodies(bodies, "camera_body")
        lights = {f"light {k}": body for k, body in enumerate(fittings.light_bodies)}
        # all by the name of the camera, or of its light
        self._placed_camera = tuple(
            Standing(name, compose(cam2base, body.pose), body.shape, body.geometry)
            for name, carried in (
                ("camera", self._camera),
                ("light", standing_bodies(lights, "light")),
            )
            for body in carried
        )
        self._grip(fixturings)

    def _grip(self, fixturings: Mapping[str, Grip]) -> None:
        self.fixturings = dict(fixturings)
        self._grippers = {
            name: standing_bodies(grip.gripper, "gripper") for name, grip in self.fixturings.items()
        }
        self._build()

    def _build(self) -> None:
        """Build the arm with what each grip holds."""
        robot = self.fittings.robot
        links = bodies_of(robot, np.eye(4), ())
        self.arms = {
            name: arm_with_mount(robot, [*links, *self._carried(name)], self.fittings.clearance_mm)
            for name in self.fixturings
        }

    def _carried(self, name: str) -> list[Moving]:
        """Return the gripper and the part as they move with the flange."""
        robot = self.fittings.robot
        tip = robot.chain.tip
        bodies = []
        for body in self._grippers[name]:
            corners = carry(compose(tip, body.pose), body.shape.corners)
            bodies.append(Moving(body.name, robot.n_joints, hull_of(corners, "gripper"), True))
        if self.part is not None:
            pose = compose(tip, self.fixturings[name].part2flange)
            placed = carry(pose, self.part.shape.corners)
            surface = Surface(placed, self.part.shape.triangles, closed=True)
            hull = hull_of(placed, "part")
            bodies.append(Moving("part", robot.n_joints, hull, True, surface))
        return bodies

    def with_part(self, part: Standing) -> PartInHand:
        """Return the same with the part in the hand."""
        result = copy(self)
        result.part = part
        result._build()
        return result

    def with_fixturings(self, fixturings: Mapping[str, Grip]) -> PartInHand:
        """Return the same with other grips."""
        result = copy(self)
        result._grip(fixturings)
        return result

    def moved(self, motion: np.ndarray) -> PartInHand:
        """Raise, since there is no part to be placed."""
        rule = "must hold the part on a fixturing to search for its position"
        raise RobotError.of_rule("cell", rule, "a part in the hand")

    def parts_at(self, q: np.ndarray, fixturing: str) -> np.ndarray:
        """Return where the part is in the base (..., 4, 4), for joints (..., k)."""
        flange = self.fittings.robot.forward(q[..., : self.fittings.robot.n_joints])
        return compose(flange, self.fixturings[fixturing].part2flange)

    def cameras_at(self, q: np.ndarray) -> np.ndarray:
        """Return where the camera is in the base (4, 4), whatever the joints."""
        return self.pose

    def tips(self, cam2world: np.ndarray, fixturing: str, angle: float) -> np.ndarray:
        """Return the poses (..., 4, 4) of the tip for poses of the camera in the part's frame."""
        part = compose(self.pose, invert(check_rotations("cam2world", cam2world)))
        return compose(part, invert(self.fixturings[fixturing].part2flange))

    def hidden_by(
        self, cam2world: np.ndarray, segments: np.ndarray, fixturing: str, angle: float
    ) -> np.ndarray:
        """Return the names (n, s) of what hides segments (s, 2, 3) from cameras (n, 4, 4); the gripper's first."""
        poses = np.asarray(cam2world, dtype=np.float64)
        part2flange = self.fixturings[fixturing].part2flange
        names = hidden_by(self._grippers[fixturing], part2flange, poses[:, :3, 3], segments)
        obstacles = self.obstacles
        for row, pose in enumerate(poses if obstacles else ()):
            part = compose(self.pose, invert(pose))
            others = hidden_by(obstacles, part, pose[None, :3, 3], segments)[0]
            names[row] = np.where(names[row] == "", others, names[row])
        return names

    def before_light(
        self, cam2world: np.ndarray, segments: np.ndarray, fixturing: str, angle: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return that nothing is between segments (s, 2, 3) and a backlight: there is none."""
        shape = (len(cam2world), len(segments))
        return np.full(shape, "", dtype=object), np.ones(shape, dtype=bool)

    def still(self, fixturing: str) -> list[Standing]:
        """Return what stands still: obstacles and the camera."""
        return [*self.obstacles, *self._placed_camera]

    def turning(self, fixturing: str) -> list[Standing]:
        """Return what turns on a table: nothing."""
        return []

    def standing(self, fixturing: str, angle: float) -> list[Standing]:
        """Return all that stands still."""
        return self.still(fixturing)

    def check_fixturing(self, name: str) -> None:
        """Raise if a gripper goes through the part."""
        if self.part is not None:
            part = self.part.at(self.fixturings[name].part2flange)
            check_part_stands_free(name, part, self._grippers[name], (), "part2flange")

    def check_place(self, name: str) -> None:
        """Accept what stands in the cell: the part is not among it."""

    def depths(self, enough_mm: float) -> Iterator[tuple[tuple[str, str, str], float]]:
        """Yield nothing, since grips bring nothing that stands still."""
        return iter(())

    def digest(self, home: list[float] | None) -> str:
        """Return the SHA-256 of everything that decides what is reached."""
        return short_digest(("held", self.fittings.robot.state_name, parts_of(self, home)), 64)

    def camera_digest(self) -> str:
        """Return a short digest of the camera's body."""
        return short_digest(digest_of((), None, [("", np.eye(4), self._camera)]))

    def places(self, name: str) -> _Places:
        """Return what comes with a grip, as places of a digest."""
        return [(name, self.fixturings[name].part2flange, self._grippers[name])]

    def poses(self) -> dict[str, np.ndarray]:
        """Return the pose of the part in the robot's tip for each grip."""
        return {name: grip.part2flange for name, grip in self.fixturings.items()}

    def stated(self) -> dict[str, Any]:
        """Return what else a plan file says: where the camera is."""
        return {"cam2base": self.pose.tolist()}


Hand = CameraInHand | PartInHand


def _moved(
    bodies: Mapping[str, Sequence[Standing]], motion: np.ndarray
) -> dict[str, tuple[Standing, ...]]:
    """Return what comes with each fixturing, moved in the base."""
    return {
        name: tuple(body.at(compose(motion, body.pose)) for body in group)
        for name, group in bodies.items()
    }


def axes_of(fixturings: Mapping[str, Fixturing]) -> dict[str, Any]:
    """Return point and direction of the turntables, by fixturing."""
    tables = {name: fixturing.table for name, fixturing in fixturings.items() if fixturing.table}
    return {
        name: {"point": table.point.tolist(), "direction": table.direction.tolist()}
        for name, table in tables.items()
    }


# Digests of what a cell consists of.


def parts_of(hand: Hand, home: list[float] | None) -> dict[str, str]:
    """Return short digests of what a cell consists of, by name."""
    fittings = hand.fittings
    fixturings = {
        FIXTURING + name: short_digest(digest_of((), None, hand.places(name)))
        for name in hand.fixturings
    }
    return {
        "robot": short_digest(fittings.robot.state_name),
        hand.field: short_digest(hand.pose.tolist()),
        "camera_body": hand.camera_digest(),
        "clearance_mm": short_digest(fittings.clearance_mm),
        "home": short_digest(home),
        "obstacles": short_digest(digest_of((), None, [("", np.eye(4), hand.obstacles)])),
        **({} if fittings.light is None else {"light": short_digest(fittings.light)}),
        **fixturings,
    }


def part_words(name: str, before: Mapping[str, str], now: Mapping[str, str]) -> str:
    """Return the name of a part of the cell as its file has it, and whether it is new or gone."""
    word = name
    if name.startswith(FIXTURING):
        word = f"fixturing {name.removeprefix(FIXTURING)!r}"
    if name not in before:
        return f"{word} (new)"
    return word if name in now else f"{word} (gone)"


def has_camera_body(parts: Mapping[str, str]) -> bool:
    """Return whether a cell states the outside of its camera, by what a plan file says of its parts."""
    return parts.get("camera_body") != short_digest([])


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
        for obstacle in standing:
            digest.update(repr((obstacle.name, obstacle.pose.tolist())).encode())
            digest.update(obstacle.shape.corners.tobytes())
            digest.update(obstacle.shape.triangles.astype("<i8").tobytes())
    return digest.hexdigest()


# Cells that cannot be meant are refused in one line.


_LEAST_LEVER_MM = 5.0
# two places of a backlight below the part are the same within this
_SAME_MM = 1e-6
# places of parts are farther from the base: shorter ones are in metres
_SHORTEST_MM = 10.0
# bodies so near to each other at the angle 0 of a turntable touch
_TOUCHING_MM = 0.01
_INWARDS = 0.866
"""Cosine of the angle to the flange within which a camera would look at it."""

_DRAWS = 200
_ALWAYS = 0.95
_GRID = 72
# of a turntable, rad
_STEP = np.radians(5.0)

# steps of the last joint, and of each of the last two, at which a mount is looked at
_MOUNT_STEPS = (72, 24)

# links are the first bodies of every arm, whatever camera it carries
_BY_DESIGN: WeakKeyDictionary[Robot, list[tuple[int, int]]] = WeakKeyDictionary()


def check_hand_eye(value: Any) -> np.ndarray:
    """Return cam2flange (4, 4), or raise `RobotError` if it is in metres or the wrong way round."""
    pose = check_pose("cam2flange", value)
    shift = pose[:3, 3]
    lever = float(np.sqrt((shift**2).sum()))
    if lever == 0:
        return pose
    if lever < _LEAST_LEVER_MM:
        raise RobotError.of_rule(
            "cam2flange", "must be in mm", f"a lever of {lever:.3g} mm", hint="is it in metres?"
        )
    flange = invert(pose)[:3, 3]
    if flange[2] > _INWARDS * lever:
        raise RobotError.of_rule(
            "cam2flange",
            "must map the camera's frame to the flange",
            "a camera that looks at its own flange",
            hint="is it the inverse, flange2cam?",
        )
    return pose


def check_home(home: Any, robot: Robot) -> np.ndarray | None:
    """Return joints (k,) within limits, or None."""
    if home is None:
        return None
    try:
        q = np.array(home, dtype=np.float64)
    except (TypeError, ValueError):
        q = np.empty(0)
    if q.shape != (robot.n_joints,) or not np.isfinite(q).all():
        raise RobotError.of_rule(
            "home", f"must be {robot.n_joints} finite angles in rad", shown(home)
        )
    for number, joint in enumerate(robot.joints):
        if not joint.lower <= q[number] <= joint.upper:
            rule = f"must be within the limits of joint {number + 1}"
            limits = f"[{joint.lower:.4g}, {joint.upper:.4g}]"
            raise RobotError.of_rule(
                "home", rule, f"{q[number]:.4g} rad, limits {limits}", hint="is it in degrees?"
            )
    q.flags.writeable = False
    return q


def check_names(hand: type[Hand], fittings: Fittings, fixturings: Mapping[str, Any]) -> None:
    """Raise unless there is a fixturing of the right kind, and every body has a name of its own."""
    lies = hand is CameraInHand
    if not fixturings:
        way = "the part lies" if lies else "the robot holds the part"
        raise RobotError.of_rule("fixturings", f"must name at least one way {way}", "none")
    taken = {"camera", "part", *fittings.robot.segment_names}
    if fittings.light is not None:
        taken.add("light")
    for name, fixturing in fixturings.items():
        _check_kind(name, fixturing, lies=lies)
        coming = [*fixturing.obstacles, *fixturing.turning] if lies else [*fixturing.gripper]
        names = [*fittings.obstacles, *coming]
        for body in names:
            if body in taken or names.count(body) > 1:
                rule = "must have names that no other object has"
                raise RobotError.of_rule("obstacles", rule, repr(body))


def light_of(
    fittings: Fittings, fixturings: Mapping[str, Fixturing | Grip]
) -> CarriedLight | LightBox | None:
    """Return the light of a cell, or None; a backlight in the frame of the part.

    Raises
    ------
    RobotError
        If there is more than one light, or the part lies on its backlight in different ways.
    """
    backlights = {
        name: _backlight_of(name, fixturing)
        for name, fixturing in fixturings.items()
        if isinstance(fixturing, Fixturing)
    }
    first = next((light for light in backlights.values() if light is not None), None)
    if first is None:
        return fittings.light
    if fittings.light is not None:
        got = f"{fittings.light.name} and {first.name}"
        raise RobotError.of_rule("light", "must be the only light of the cell", got)
    for name, light in backlights.items():
        same = light is not None and light.name == first.name
        if light is None or not same or not np.allclose(light.pose, first.pose, atol=_SAME_MM):
            rule = "must be under the part in every fixturing, at the same position under it"
            hint = "plan each fixturing by a cell of its own"
            raise RobotError.of_rule("light", rule, f"another one in {name!r}", hint=hint)
    return first


def _backlight_of(name: str, fixturing: Fixturing) -> LightBox | None:
    """Return the backlight of a fixturing in the frame of the part; None without one."""
    standing = [body for body in fixturing.obstacles.values() if isinstance(body, LightBox)]
    if standing and fixturing.table is not None:
        rule = f"must turn with the part in fixturing {name!r}, which is on a turntable"
        raise RobotError.of_rule("light", rule, "one that stands still")
    lights = [
        *standing,
        *(body for body in fixturing.turning.values() if isinstance(body, LightBox)),
    ]
    if not lights:
        return None
    if len(lights) > 1:
        rule = f"must be the only light in fixturing {name!r}"
        raise RobotError.of_rule("light", rule, f"{len(lights)} backlights")
    return replace(lights[0], pose=compose(invert(fixturing.part2base), lights[0].pose))


def _check_kind(name: str, fixturing: Any, *, lies: bool) -> None:
    if lies and not isinstance(fixturing, Fixturing):
        is_grip = isinstance(fixturing, Grip)
        hint = "a Grip needs a HeldPartCell, whose camera stands still" if is_grip else ""
        rule = f"must hold a Fixturing for {name!r}"
        raise RobotError.of_rule("fixturings", rule, shown(fixturing), hint=hint)
    if not lies and not isinstance(fixturing, Grip):
        rule = f"must hold a Grip for {name!r} where the camera stands still"
        raise RobotError.of_rule("fixturings", rule, shown(fixturing))


def pairs_by_design(robot: Robot, arm: Arm) -> list[tuple[int, int]]:
    """Return pairs of the arm's bodies that need not be looked at.

    These are links that touch in nearly all of many drawn joints, and links with two joints between them that touch
    nowhere on a grid of these joints: the arm is built so.
    """
    if robot in _BY_DESIGN:
        return _BY_DESIGN[robot]
    drawn = np.random.default_rng(0).random((_DRAWS, robot.n_joints))
    pairs = []
    for pair in arm.own_pairs:
        first, second = (arm.bodies[number] for number in pair)
        if first.is_held or second.is_held:
            continue
        if _always_touch(robot, arm, pair, drawn) or _never_touch(robot, arm, pair):
            pairs.append(pair)
    _BY_DESIGN[robot] = pairs
    return pairs


def arm_with_mount(robot: Robot, bodies: Sequence[Moving], clearance_mm: float) -> Arm:
    """Return an arm that knows which links its camera is mounted so near to that no joints keep the clearance.

    The distance of what the hand carries from the link before it depends on the last joint alone, and from the link
    before that on the last two. A pair need keep no clearance if it never has it. Nor need it if only the last joint
    moves it, and never to a touch. It must not touch.
    """
    arm = Arm(bodies, robot.n_joints)
    for pair in arm.own_pairs:
        segments = [arm.bodies[number].segment for number in pair]
        between = max(segments) - min(segments)
        if clearance_mm > 0 and arm.keeps_clearance(*pair) and between <= len(_MOUNT_STEPS):
            mm = _mounted_mm(robot, arm, pair, clearance_mm)
            if mm is not None:
                arm.near_by_mount[pair] = mm
    return arm


def _mounted_mm(robot: Robot, arm: Arm, pair: tuple[int, int], clearance_mm: float) -> float | None:
    """Return the least distance over the last joints that a mount leaves a pair, mm; None if it keeps the clearance."""
    between = abs(arm.bodies[pair[0]].segment - arm.bodies[pair[1]].segment)
    steps = np.linspace(0.0, 1.0, _MOUNT_STEPS[between - 1])
    shares = np.full((len(steps) ** between, robot.n_joints), 0.5)
    grid = np.meshgrid(*[steps] * between)
    shares[:, robot.n_joints - between :] = np.stack([axis.ravel() for axis in grid], axis=1)
    frames = robot.chain.frames(_drawn_joints(robot, shares))
    group = PairGroup(arm, (), (), [pair], 0.0)
    far = group.bounds(frames)[:, 0] >= clearance_mm
    # spheres tell of most cameras that they are far enough
    if far.all() or (between > 1 and far.any()):
        return None
    distances = [group.distance(0, frame) for frame in frames]
    never_touches = between == 1 and 0 < min(distances) < clearance_mm
    return min(distances) if max(distances) < clearance_mm or never_touches else None


def _drawn_joints(robot: Robot, shares: np.ndarray) -> np.ndarray:
    """Return joints (n, k) that are shares of their ranges, a turn at most."""
    lower = np.maximum(robot.lower, -np.pi)
    upper = np.minimum(robot.upper, np.pi)
    return np.asarray(lower + (upper - lower) * shares)


def _always_touch(robot: Robot, arm: Arm, pair: tuple[int, int], drawn: np.ndarray) -> bool:
    """Return whether two links touch in nearly all of drawn joints."""
    limit = int((1 - _ALWAYS) * len(drawn))
    apart = (True for touch in _touches(robot, arm, pair, drawn) if not touch)
    return sum(islice(apart, limit + 1)) <= limit


def _never_touch(robot: Robot, arm: Arm, pair: tuple[int, int]) -> bool:
    """Return whether two links touch nowhere on a grid of the two joints between them."""
    first, second = (arm.bodies[number].segment for number in pair)
    if second != first + 2:
        return False
    steps = (np.arange(_GRID) + 0.5) / _GRID
    shares = np.full((_GRID**2, robot.n_joints), 0.5)
    shares[:, first] = np.repeat(steps, _GRID)
    shares[:, first + 1] = np.tile(steps, _GRID)
    return not any(_touches(robot, arm, pair, shares))


def _touches(robot: Robot, arm: Arm, pair: tuple[int, int], shares: np.ndarray) -> Iterator[bool]:
    """Yield whether a pair touches; joints are shares (n, k) of their ranges, a turn at most."""
    frames = robot.chain.frames(_drawn_joints(robot, shares))
    group = PairGroup(arm, (), (), [pair], 0.0)
    for row, near in enumerate(group.bounds(frames)[:, 0] <= 0):
        yield bool(near) and group.distance(0, frames[row]) <= 0


def _in_millimetres(pose: np.ndarray) -> str:
    """Return a hint for a pose (4, 4) whose place may be in metres: nothing where a coordinate is 10 mm or more."""
    largest = max(pose[:3, 3], key=abs)
    if not 0 < abs(largest) < _SHORTEST_MM:
        return ""
    return f"{largest:.6g} m are {1000 * largest:.6g}"


def check_part_stands_free(
    fixturing: str,
    part: Standing,
    others: Iterable[Standing],
    arm: Iterable[Moving],
    parameter: str = "part2base",
) -> None:
    """Raise if a fixturing puts the part through an obstacle or the robot's base.

    An obstacle may touch the part, and sink in up to `SKIN_MM`.
    """
    fcl = needed("fcl")
    rule = f"must not put the part through other objects in fixturing {fixturing!r}"
    place = f"({', '.join(f'{x:.6g}' for x in part.pose[:3, 3])}) mm"
    for body in arm:
        if body.segment > 0:
            continue
        base = Standing(body.name, np.eye(4), body.hull)
        if fcl.collide(part.placed, base.placed) or part.holds(body.hull.corners.mean(axis=0)):
            got = f"{place}, where the part is inside {body.name}"
            raise RobotError.of_rule(parameter, rule, got, hint=_in_millimetres(part.pose))
    for other in others:
        depth = sunk_mm(part, other, SKIN_MM)
        if depth > SKIN_MM:
            got = f"{place}, where the part is {depth:.3g} mm deep in {other.name}, {SKIN_MM:g} mm permitted"
            hint = "reach --place --table NAME lays the part on a table"
            hint = _in_millimetres(part.pose) or hint
            raise RobotError.of_rule(parameter, rule, got, hint=hint)


def check_turns_free(
    fixturing: str,
    table: Turntable,
    turning: Iterable[Standing],
    others: Iterable[Standing],
    arm: Iterable[Moving],
) -> None:
    """Raise if what turns with the part hits what stands still on the way to an angle of its turntable.

    Between the angles that are looked at, no body goes deeper than `SKIN_MM` into another one, which follows from
    distances. Bodies that touch at the angle 0 may touch. Of these the part may only not sink in, which is looked at
    in steps.
    """
    fcl = needed("fcl")
    still = [Standing(link.name, np.eye(4), link.hull) for link in arm if link.segment == 0]
    for body in turning:
        for other in (*others, *still):
            # a plate may lie on its drive: what collides there is up to rounding
            if fcl.distance(body.placed, other.placed) > _TOUCHING_MM:
                angle = _angle_of_touch(body, other, table)
            elif body.name == "part":
                angle = _angle_of_sinking(body, other, table)
            else:
                angle = None
            if angle is not None:
                degrees = np.degrees(angle)
                rule = f"must not turn {body.name} into other objects in {fixturing!r}"
                raise RobotError.of_rule("axis", rule, f"{other.name} at {degrees:.0f} degrees")


def _angle_of_touch(body: Standing, other: Standing, table: Turntable) -> float | None:
    """Return an angle at which a turning body touches another one, rad; None if it does not in the table's range.

    A body that is d away cannot touch before its farthest point has moved by d. Where d is smaller than the skin, the
    angle by which it moves by the skin is taken instead.
    """
    fcl = needed("fcl")
    radius = max(table.radius_mm(carry(body.pose, body.shape.corners)), SKIN_MM)
    for end in table.range:
        angle = 0.0
        while abs(angle) < abs(end):
            turned = body.at(compose(table.pose(angle), body.pose))
            if fcl.collide(turned.placed, other.placed):
                return angle
            free = max(float(fcl.distance(turned.placed, other.placed)), SKIN_MM) / radius
            angle += np.copysign(free, end)
        turned = body.at(compose(table.pose(end), body.pose))
        if fcl.collide(turned.placed, other.placed):
            return end
    return None


def _angle_of_sinking(part: Standing, other: Standing, table: Turntable) -> float | None:
    """Return an angle at which a part that touches a body goes deeper than its skin, rad; None if it does not."""
    low, high = table.range
    steps = max(1, int(np.ceil((high - low) / _STEP)))
    for angle in (*table.angles, *np.linspace(low, high, steps + 1).tolist()):
        turned = part.at(compose(table.pose(angle), part.pose))
        if sunk_mm(turned, other, SKIN_MM, SKIN_MM) > SKIN_MM:
            return float(angle)
    return None


def check_home_is_free(fixturing: str, words: str) -> None:
    """Raise if something is wrong with home in a fixturing, in words."""
    if words:
        rule = f"must be free of collisions in fixturing {fixturing!r}"
        raise RobotError.of_rule("home", rule, words)
