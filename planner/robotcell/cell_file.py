"""Cell files: a robot, its camera's place, fixturings and obstacles as one TOML file."""

from __future__ import annotations

import json
import os
import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import islice
from os import PathLike
from pathlib import Path
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from aspectgraph.files import check_plain, read_text
from planner.argument_kinds import shown
from planner.exceptions import PlannerError, RobotError
from planner.robotcell.arm import Robot
from planner.robotcell.bodies import Body, Box, mesh_of
from planner.robotcell.branches import needed
from planner.robotcell.collisions import Arm, Moving, PairGroup
from planner.robotcell.standing import SKIN_MM, Fixturing, Grip, Standing, Turntable, sunk_mm
from planner.robotcell.urdf import N_JOINTS, carry, check_pose, compose, from_rpy, invert

# Cells that cannot be meant are refused in one line.


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


_FILE = (
    "robot",
    "cam2flange",
    "cam2base",
    "fixturings",
    "camera_body",
    "obstacles",
    "clearance_mm",
    "home_deg",
)
_ROBOT = (
    "urdf",
    "tip",
    "base",
    "packages",
    "accelerations",
    "speeds",
    "bodiless_links",
    "coupled",
    "axis_limits_deg",
)
_TURNS = ("angles", "turn_speed", "turn_acceleration")
_FIXTURING = ("part2base", "obstacles", "axis", "angles_deg", "turning", *_TURNS)
_AXIS = ("point", "direction")
_INLINE = ("cam2flange", "part2base", "pose", "axis", "packages")
_BODY = ("low", "high", "pose", "mesh")


def cell_fields(path: str | PathLike[str]) -> dict[str, Any]:
    """Return the arguments of `Cell` that a file states.

    Parameters
    ----------
    path : str or Path
        A TOML file. Names of other files are relative to its folder.

    Raises
    ------
    RobotError
        The file cannot be read, or a field breaks its rule; the message begins with the file's name.
    """
    file = Path(path)
    content = _read(file)
    try:
        return _fields(content, file.parent)
    except RobotError as error:
        where = f"{file}: {error.parameter or 'a field'}".rstrip()
        if not error.parameter:
            raise
        raise RobotError.of_rule(where, error.rule, error.got, hint=error.hint) from None


def moved_cell(path: str | PathLike[str], motion: np.ndarray, folder: Path) -> dict[str, Any]:
    """Return what a cell file states, with all fixturings and their obstacles moved in the base.

    Parameters
    ----------
    path : str or Path
        A cell file that `cell_fields` takes.
    motion : array (4, 4)
        The motion, mm.
    folder : Path
        Names of other files are made relative to it.
    """
    file = Path(path)
    content = _read(file)
    for fixturing in content["fixturings"].values():
        pose = compose(motion, _pose(fixturing["part2base"], "part2base"))
        fixturing["part2base"] = pose.tolist()
        for body in (
            *fixturing.get("obstacles", {}).values(),
            *fixturing.get("turning", {}).values(),
        ):
            before = _pose(body["pose"], "pose") if "pose" in body else np.eye(4)
            body["pose"] = compose(motion, before).tolist()
        if "axis" in fixturing:
            axis = fixturing["axis"]
            direction = np.einsum("ij,j->i", motion[:3, :3], np.array(axis["direction"], float))
            axis["point"] = carry(motion, np.array([axis["point"]], float))[0].tolist()
            axis["direction"] = direction.tolist()
    _name_files_from(content, file.parent, folder)
    return content


def _name_files_from(content: dict[str, Any], old: Path, new: Path) -> None:
    """Make names of files that are relative to one folder relative to another one."""
    places = [(content["robot"], "urdf")]
    places += [(content["robot"]["packages"], key) for key in content["robot"].get("packages", {})]
    bodies = [*content.get("camera_body", []), *content.get("obstacles", {}).values()]
    for fixturing in content["fixturings"].values():
        for kind in ("obstacles", "turning"):
            bodies += fixturing.get(kind, {}).values()
    places += [(body, "mesh") for body in bodies if "mesh" in body]
    for table, key in places:
        if not Path(table[key]).is_absolute():
            table[key] = _relative(old / table[key], new)


def _relative(path: Path, folder: Path) -> str:
    try:
        return Path(os.path.relpath(path.resolve(), folder.resolve())).as_posix()
    except ValueError:
        # on another drive of Windows
        return path.resolve().as_posix()


def toml_lines(
    table: Mapping[str, Any], digits: int | None = None, name: str = ""
) -> Iterator[str]:
    """Yield the lines of a cell file.

    Parameters
    ----------
    table : mapping
        What it states.
    digits : int, optional
        Digits behind the point. Default: all.
    name : str
        Where the table is in the file, such as ``fixturings``; empty at the top.
    """
    plain = {key: value for key, value in table.items() if not _is_section(key, value)}
    if name and (plain or not table):
        yield f"[{name}]"
    for key, value in plain.items():
        yield f"{_key(key)} = {_value(value, digits)}"
    if plain:
        yield ""
    for key, value in table.items():
        section = f"{name}.{_key(key)}" if name else _key(key)
        if key == "camera_body" and not name:
            for body in value:
                yield f"[[{section}]]"
                yield from toml_lines(body, digits)
        elif key not in plain:
            yield from toml_lines(value, digits, section)


def _is_section(key: str, value: Any) -> bool:
    """Return whether a field is written under a heading of its own."""
    return key == "camera_body" or (isinstance(value, Mapping) and key not in _INLINE)


def _key(name: str) -> str:
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else json.dumps(name, ensure_ascii=False)


def _value(value: Any, digits: int | None) -> str:
    if isinstance(value, Mapping):
        pairs = [f"{_key(key)} = {_value(one, digits)}" for key, one in value.items()]
        return "{ " + ", ".join(pairs) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(_value(one, digits) for one in value) + "]"
    if isinstance(value, float) and digits is not None:
        return repr(round(value, digits) + 0.0)
    return json.dumps(value, ensure_ascii=False)


def _read(file: Path) -> dict[str, Any]:
    try:
        content = tomllib.loads(read_text(file))
        check_plain(content)
    except OSError as error:
        raise RobotError(f"{file}: cell file cannot be read: {error.strerror}.") from None
    except UnicodeDecodeError:
        raise RobotError(f"{file}: cell file must be UTF-8 text.") from None
    except (ValueError, RecursionError) as error:
        raise RobotError(f"{file}: cell file must be TOML. Got: {error}.") from None
    return content


def _fields(content: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    # the camera is in the hand, or stands still while the hand holds the part
    camera = "cam2base" if "cam2base" in content else "cam2flange"
    _check_keys(content, _FILE, "", required=("robot", camera, "fixturings"))
    if "cam2base" in content and "cam2flange" in content:
        raise RobotError.of_rule("cam2base", "must not be given with cam2flange", "both")
    read = _grip if camera == "cam2base" else _fixturing
    fields: dict[str, Any] = {
        "robot": _robot(_table(content["robot"], "robot"), folder),
        camera: _pose(content[camera], camera),
        "fixturings": {
            name: read(_table(one, f"fixturings.{name}"), f"fixturings.{name}", folder)
            for name, one in _table(content["fixturings"], "fixturings").items()
        },
        "obstacles": _bodies(content.get("obstacles", {}), "obstacles", folder),
    }
    bodies = content.get("camera_body", [])
    if not isinstance(bodies, list):
        raise RobotError.of_rule("camera_body", "must be written [[camera_body]]", shown(bodies))
    fields["camera_body"] = tuple(_body(one, "camera_body", folder) for one in bodies)
    if "clearance_mm" in content:
        fields["clearance_mm"] = content["clearance_mm"]
    if "home_deg" in content:
        fields["home"] = np.radians(_numbers(content["home_deg"], 6, "home_deg"))
    return fields


def _robot(table: Mapping[str, Any], folder: Path) -> Robot:
    _check_keys(table, _ROBOT, "robot.", required=("urdf",))
    apart = ("urdf", "packages", "axis_limits_deg")
    given = {key: value for key, value in table.items() if key not in apart}
    if "axis_limits_deg" in table:
        given["axis_limits"] = _axis_limits(table["axis_limits_deg"])
    for key in ("tip", "base"):
        if key in given and not isinstance(given[key], str):
            raise RobotError.of_rule(
                f"robot.{key}", "must be the name of a link", shown(given[key])
            )
    packages = {
        name: folder / _text(value, f"robot.packages.{name}")
        for name, value in _table(table.get("packages", {}), "robot.packages").items()
    }
    return Robot.from_urdf(folder / _text(table["urdf"], "robot.urdf"), packages=packages, **given)


def _axis_limits(rows: Any) -> list[list[float]]:
    """Return limits of the controller's axes in rad."""
    name = "robot.axis_limits_deg"
    if not isinstance(rows, list):
        raise RobotError.of_rule(name, "must be a list", shown(rows))
    read = [_numbers(row, 3, name) for row in rows]
    return [[axis, *np.radians([low, high]).tolist()] for axis, low, high in read]


def _fixturing(table: Mapping[str, Any], name: str, folder: Path) -> Fixturing:
    _check_keys(table, _FIXTURING, f"{name}.", required=("part2base",))
    part2base = _pose(table["part2base"], f"{name}.part2base")
    obstacles = _bodies(table.get("obstacles", {}), f"{name}.obstacles", folder)
    given: dict[str, Any] = {key: table[key] for key in _TURNS if key in table}
    if "angles" in table and "angles_deg" in table:
        raise RobotError.of_rule(f"{name}.angles_deg", "must not be given with angles", "both")
    if "angles_deg" in table:
        listed = table["angles_deg"]
        count = len(listed) if isinstance(listed, list) else 1
        given["angles"] = np.radians(_numbers(listed, count, f"{name}.angles_deg")).tolist()
    if "axis" in table:
        axis = _table(table["axis"], f"{name}.axis")
        _check_keys(axis, _AXIS, f"{name}.axis.", required=_AXIS)
        given["axis"] = [_numbers(axis[key], 3, f"{name}.axis.{key}") for key in _AXIS]
    if "turning" in table:
        given["turning"] = _bodies(table["turning"], f"{name}.turning", folder)
    try:
        return Fixturing(part2base, obstacles, **given)
    except PlannerError as error:
        where = f"{name}.{getattr(error, 'parameter', '')}"
        raise RobotError.of_rule(where, error.rule, error.got, hint=error.hint) from None


def _grip(table: Mapping[str, Any], name: str, folder: Path) -> Grip:
    _check_keys(table, ("part2flange", "gripper"), f"{name}.", required=("part2flange",))
    part2flange = _pose(table["part2flange"], f"{name}.part2flange")
    return Grip(part2flange, _bodies(table.get("gripper", {}), f"{name}.gripper", folder))


def _bodies(tables: Any, name: str, folder: Path) -> dict[str, Body]:
    return {key: _body(one, f"{name}.{key}", folder) for key, one in _table(tables, name).items()}


def _body(table: Any, name: str, folder: Path) -> Body:
    fields = _table(table, name)
    _check_keys(fields, _BODY, f"{name}.")
    if "mesh" in fields:
        if "low" in fields or "high" in fields:
            rule = "must have either a mesh or low and high"
            raise RobotError.of_rule(name, rule, ", ".join(fields))
        mesh = folder / _text(fields["mesh"], f"{name}.mesh")
        if "pose" not in fields:
            return mesh
        corners, triangles = mesh_of(mesh, f"{name}.mesh")
        return carry(_pose(fields["pose"], f"{name}.pose"), corners), triangles
    for key in ("low", "high"):
        if key not in fields:
            raise RobotError.of_rule(name, "must have a mesh, or low and high", f"no {key}")
    low, high = (_numbers(fields[key], 3, f"{name}.{key}") for key in ("low", "high"))
    pose = _pose(fields["pose"], f"{name}.pose") if "pose" in fields else np.eye(4)
    return Box(low, high, pose)


def _pose(value: Any, name: str) -> np.ndarray:
    """Return a pose from four rows, or from xyz in mm and rpy_deg."""
    if isinstance(value, Mapping):
        _check_keys(value, ("xyz", "rpy_deg"), f"{name}.", required=("xyz",))
        xyz = _numbers(value["xyz"], 3, f"{name}.xyz")
        rpy = _numbers(value.get("rpy_deg", (0.0, 0.0, 0.0)), 3, f"{name}.rpy_deg")
        return from_rpy(np.array(xyz), np.radians(rpy))
    return check_pose(name, value)


def _check_keys(
    table: Mapping[str, Any], known: tuple[str, ...], prefix: str, required: tuple[str, ...] = ()
) -> None:
    for key in table:
        if key not in known:
            hint = f"the fields are {', '.join(known)}"
            raise RobotError.of_rule(f"{prefix}{key}", "must be a field of a cell", key, hint=hint)
    for key in required:
        if key not in table:
            raise RobotError.of_rule(f"{prefix}{key}", "must be given", "none")


def _table(value: Any, name: str) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise RobotError.of_rule(name, "must be a table", shown(value))
    return value


def _text(value: Any, name: str) -> str:
    if not isinstance(value, str) or not value:
        raise RobotError.of_rule(name, "must be the name of a file or folder", shown(value))
    return value


def _numbers(value: Any, count: int, name: str) -> tuple[float, ...]:
    try:
        numbers = tuple(float(number) for number in value)
    except (TypeError, ValueError):
        numbers = ()
    if len(numbers) != count or isinstance(value, str) or not np.isfinite(numbers).all():
        raise RobotError.of_rule(name, f"must be {count} finite numbers", shown(value))
    return numbers
