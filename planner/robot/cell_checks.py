"""Cells that cannot be meant are refused in one line."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import islice
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from planner.argument_kinds import shown
from planner.exceptions import RobotError
from planner.robot.arm import Robot
from planner.robot.branches import needed
from planner.robot.collisions import Arm, Moving, PairGroup
from planner.robot.standing import SKIN_MM, Standing, sunk_mm
from planner.robot.transforms import check_pose, compose, invert
from planner.robot.turning.turntable import Turntable
from planner.robot.urdf import N_JOINTS

_LEAST_LEVER_MM = 5.0
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
    """Return joints (6,) within limits, or None."""
    if home is None:
        return None
    try:
        q = np.array(home, dtype=np.float64)
    except (TypeError, ValueError):
        q = np.empty(0)
    if q.shape != (N_JOINTS,) or not np.isfinite(q).all():
        raise RobotError.of_rule("home", "must be six finite angles in rad", shown(home))
    for number, joint in enumerate(robot.joints):
        if not joint.lower <= q[number] <= joint.upper:
            rule = f"must be within the limits of joint {number + 1}"
            limits = f"[{joint.lower:.4g}, {joint.upper:.4g}]"
            raise RobotError.of_rule(
                "home", rule, f"{q[number]:.4g} rad, limits {limits}", hint="is it in degrees?"
            )
    q.flags.writeable = False
    return q


def check_names(fixturings: Mapping[str, Any], obstacles: Mapping[str, Any], robot: Robot) -> None:
    """Raise unless there is a fixturing, and every body has a name of its own."""
    if not fixturings:
        raise RobotError.of_rule("fixturings", "must name at least one way the part lies", "none")
    taken = {"camera", "part", *robot.segment_names}
    for name, fixturing in fixturings.items():
        if type(fixturing).__name__ != "Fixturing":
            held = type(fixturing).__name__ == "Grip"
            hint = "a Grip needs a HeldPartCell, whose camera stands still" if held else ""
            rule = f"must hold a Fixturing for {name!r}"
            raise RobotError.of_rule("fixturings", rule, shown(fixturing), hint=hint)
        own = [*fixturing.obstacles, *fixturing.turning]
        for obstacle in (*obstacles, *own):
            if obstacle in taken or [*obstacles, *own].count(obstacle) > 1:
                rule = "must have names that no other body has"
                raise RobotError.of_rule("obstacles", rule, repr(obstacle))


def check_grips(grips: Mapping[str, Any], obstacles: Mapping[str, Any], robot: Robot) -> None:
    """Raise unless there is a grip, and every body has a name of its own."""
    if not grips:
        rule = "must name at least one way the robot holds the part"
        raise RobotError.of_rule("fixturings", rule, "none")
    taken = {"camera", "part", *robot.segment_names}
    for name, grip in grips.items():
        if type(grip).__name__ != "Grip":
            rule = f"must hold a Grip for {name!r} where the camera stands still"
            raise RobotError.of_rule("fixturings", rule, shown(grip))
        names = [*obstacles, *grip.gripper]
        for body in names:
            if body in taken or names.count(body) > 1:
                rule = "must have names that no other body has"
                raise RobotError.of_rule("obstacles", rule, repr(body))


def pairs_by_design(robot: Robot, arm: Arm) -> list[tuple[int, int]]:
    """Return pairs of the arm's bodies that need not be looked at.

    These are links that touch in nearly all of many drawn joints, and links with two joints between them that touch
    nowhere on a grid of these joints: the arm is built so.
    """
    if robot in _BY_DESIGN:
        return _BY_DESIGN[robot]
    drawn = np.random.default_rng(0).random((_DRAWS, N_JOINTS))
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
    arm = Arm(bodies)
    for pair in arm.own_pairs:
        segments = [arm.bodies[number].segment for number in pair]
        between = max(segments) - min(segments)
        if clearance_mm > 0 and arm.keeps_clearance(*pair) and between <= len(_MOUNT_STEPS):
            least = _mounted_mm(robot, arm, pair, clearance_mm)
            if least is not None:
                arm.near_by_mount[pair] = least
    return arm


def _mounted_mm(robot: Robot, arm: Arm, pair: tuple[int, int], clearance_mm: float) -> float | None:
    """Return the least distance over the last joints that a mount leaves a pair, mm; None if it keeps the clearance."""
    between = abs(arm.bodies[pair[0]].segment - arm.bodies[pair[1]].segment)
    steps = np.linspace(0.0, 1.0, _MOUNT_STEPS[between - 1])
    shares = np.full((len(steps) ** between, N_JOINTS), 0.5)
    grid = np.meshgrid(*[steps] * between)
    shares[:, N_JOINTS - between :] = np.stack([axis.ravel() for axis in grid], axis=1)
    frames = robot.chain.frames(_drawn_joints(robot, shares))
    group = PairGroup(arm, (), (), [pair], 0.0)
    far = group.bounds(frames)[:, 0] >= clearance_mm
    # spheres tell of most cameras that they are far enough
    if far.all() or (between > 1 and far.any()):
        return None
    distances = [group.distance(0, one) for one in frames]
    never_touches = between == 1 and 0 < min(distances) < clearance_mm
    return min(distances) if max(distances) < clearance_mm or never_touches else None


def _drawn_joints(robot: Robot, shares: np.ndarray) -> np.ndarray:
    """Return joints (n, 6) that are shares of their ranges, a turn at most."""
    lower = np.maximum(robot.lower, -np.pi)
    upper = np.minimum(robot.upper, np.pi)
    return np.asarray(lower + (upper - lower) * shares)


def _always_touch(robot: Robot, arm: Arm, pair: tuple[int, int], drawn: np.ndarray) -> bool:
    """Return whether two links touch in nearly all of drawn joints."""
    most = int((1 - _ALWAYS) * len(drawn))
    apart = (True for touch in _touches(robot, arm, pair, drawn) if not touch)
    return sum(islice(apart, most + 1)) <= most


def _never_touch(robot: Robot, arm: Arm, pair: tuple[int, int]) -> bool:
    """Return whether two links touch nowhere on a grid of the two joints between them."""
    first, second = (arm.bodies[number].segment for number in pair)
    if second != first + 2:
        return False
    steps = (np.arange(_GRID) + 0.5) / _GRID
    shares = np.full((_GRID**2, N_JOINTS), 0.5)
    shares[:, first] = np.repeat(steps, _GRID)
    shares[:, first + 1] = np.tile(steps, _GRID)
    return not any(_touches(robot, arm, pair, shares))


def _touches(robot: Robot, arm: Arm, pair: tuple[int, int], shares: np.ndarray) -> Iterator[bool]:
    """Yield whether a pair touches; joints are shares (n, 6) of their ranges, a turn at most."""
    frames = robot.chain.frames(_drawn_joints(robot, shares))
    group = PairGroup(arm, (), (), [pair], 0.0)
    for row, near in enumerate(group.bounds(frames)[:, 0] <= 0):
        yield bool(near) and group.distance(0, frames[row]) <= 0


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
    for body in arm:
        if body.segment > 0:
            continue
        base = Standing(body.name, np.eye(4), body.hull)
        if fcl.collide(part.placed, base.placed) or part.holds(body.hull.corners.mean(axis=0)):
            raise RobotError.of_rule(parameter, rule, f"it is in {body.name}")
    for other in others:
        depth = sunk_mm(part, other, SKIN_MM)
        if depth > SKIN_MM:
            got = f"{depth:.3g} mm deep in {other.name}, {SKIN_MM:g} mm permitted"
            raise RobotError.of_rule(parameter, rule, got)


def check_turns_free(
    fixturing: str,
    table: Turntable,
    turning: Iterable[Standing],
    others: Iterable[Standing],
    arm: Iterable[Moving],
) -> None:
    """Raise if what turns with the part hits what stands still at an angle of its turntable.

    Bodies that touch at the angle 0 may touch; of these the part may only not sink in. Angles are looked at in steps.
    """
    fcl = needed("fcl")
    low, high = table.range
    steps = max(1, int(np.ceil((high - low) / _STEP)))
    angles = [*table.angles, *np.linspace(low, high, steps + 1).tolist()]
    still = [Standing(one.name, np.eye(4), one.hull) for one in arm if one.segment == 0]
    for body in turning:
        pairs = [(other, _meet(fcl, body, other)) for other in (*others, *still)]
        for angle in angles:
            turned = body.at(compose(table.pose(angle), body.pose))
            for other, touched in pairs:
                is_part = body.name == "part"
                if touched and not (is_part and sunk_mm(turned, other, SKIN_MM, SKIN_MM) > SKIN_MM):
                    continue
                if touched or _meet(fcl, turned, other):
                    degrees = np.degrees(angle)
                    rule = f"must not turn {body.name} into other objects in {fixturing!r}"
                    raise RobotError.of_rule("axis", rule, f"{other.name} at {degrees:.0f} degrees")


def _meet(fcl: Any, first: Standing, second: Standing) -> bool:
    return bool(fcl.collide(first.placed, second.placed))


def check_home_is_free(fixturing: str, words: str) -> None:
    """Raise if something is wrong with home in a fixturing, in words."""
    if words:
        rule = f"must be free of collisions in fixturing {fixturing!r}"
        raise RobotError.of_rule("home", rule, words)
