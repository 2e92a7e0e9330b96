"""Cell files: a robot, its camera's place, fixturings and obstacles as one TOML file."""

from __future__ import annotations

import json
import os
import re
import tomllib
from collections.abc import Callable, Iterator, Mapping
from copy import deepcopy
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from aspectgraph.files import check_plain, read_text
from ground.convert import Meta, from_plain
from planner.exceptions import PlannerError, RobotError
from planner.robotcell.arm import Robot
from planner.robotcell.bodies import Body, Box, Fixturing, Grip, mesh_of
from planner.robotcell.camera_body import CableCapsule, CameraBody
from planner.robotcell.cell_light import CarriedLight, LightBox
from planner.robotcell.urdf import carry, check_pose, compose, from_rpy

_INLINE = ("cam2flange", "part2base", "pose", "axis", "packages", "cable")

# The tables of a cell file; a value without a rule here is checked by what is made of it.


Triple = Annotated[tuple[float, float, float], Meta(title="must be 3 finite numbers")]
FileName = Annotated[str, Meta(min_length=1, title="must be the name of a file or folder")]
Angles = Annotated[
    tuple[float, ...], Meta(min_length=1, title="must be finite numbers, one for each joint")
]


@dataclass(frozen=True)
class PoseTable:
    """A pose as a place, mm, and turns about fixed x, then y, then z, degrees."""

    xyz: Triple
    rpy_deg: Triple = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class BodyTable:
    """A box or a mesh."""

    low: Any = None
    high: Any = None
    mesh: FileName = ""
    pose: Any = None

    def __post_init__(self) -> None:
        corners = _stated(self, "low", "high")
        if self.mesh and corners:
            got = ", ".join([*corners, "mesh"])
            raise RobotError.of_rule("", "must have either a mesh or low and high", got)
        if not self.mesh and len(corners) < 2:
            missing = "high" if "low" in corners else "low"
            raise RobotError.of_rule("", "must have a mesh, or low and high", f"no {missing}")
        pose = None if self.pose is None else _pose("pose", self.pose)
        object.__setattr__(self, "pose", pose)
        if corners:
            # refuses what is no box, and the path of this table then stands before it
            Box(**corners)

    def body(self, folder: Path, name: str) -> Body:
        """Return the body; a mesh is in a folder."""
        if not self.mesh:
            return Box(**_stated(self, "low", "high", "pose"))
        if self.pose is None:
            return folder / self.mesh
        corners, triangles = mesh_of(folder / self.mesh, f"{name}.mesh")
        return carry(self.pose, corners), triangles


@dataclass(frozen=True)
class BacklightTable:
    """A backlight of the catalogue below the part."""

    name: Any
    pose: Any
    thickness_mm: Any = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "pose", _pose("pose", self.pose))
        # refuses what is no backlight, and the path of this table then stands before it
        self.body()

    def body(self) -> LightBox:
        """Return the backlight as an obstacle."""
        return LightBox.of(self.name, self.pose, **_stated(self, "thickness_mm"))


@dataclass(frozen=True)
class CarriedLightTable:
    """A light of the catalogue that the camera carries."""

    name: Any
    distance_mm: Any
    thickness_mm: Any = None

    def __post_init__(self) -> None:
        self.light()

    def light(self) -> CarriedLight:
        """Return the light."""
        return CarriedLight(self.name, self.distance_mm, **_stated(self, "thickness_mm"))


@dataclass(frozen=True)
class CableTable:
    """What the camera's cable may take up."""

    to_mm: Any
    radius_mm: Any

    def __post_init__(self) -> None:
        self.capsule()

    def capsule(self) -> CableCapsule:
        """Return it."""
        return CableCapsule(self.to_mm, self.radius_mm)


@dataclass(frozen=True)
class CameraTable:
    """The outside of the camera, from the catalogue or by its sizes."""

    housing: Any
    lens: Any
    nodal_mm: Any
    cable: CableTable | None = None

    def __post_init__(self) -> None:
        self.bodies()

    def bodies(self) -> tuple[Body, ...]:
        """Return its solids."""
        cable = None if self.cable is None else self.cable.capsule()
        return CameraBody(self.housing, self.lens, self.nodal_mm, cable).bodies()


@dataclass(frozen=True)
class AxisTable:
    """The axis of a turntable: a point, mm, and a direction."""

    point: Triple
    direction: Triple


@dataclass(frozen=True)
class FixturingTable:
    """One way the part lies."""

    part2base: Any
    obstacles: Mapping[str, BodyTable] = field(default_factory=dict)
    turning: Mapping[str, BodyTable] = field(default_factory=dict)
    light: BacklightTable | None = None
    axis: AxisTable | None = None
    angles: Any = None
    angles_deg: tuple[float, ...] | None = None
    turn_speed: Any = None
    turn_acceleration: Any = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "part2base", _pose("part2base", self.part2base))
        if self.angles_deg is None:
            return
        if self.angles is not None:
            raise RobotError.of_rule("angles_deg", "must not be given with angles", "both")
        object.__setattr__(self, "angles", np.radians(self.angles_deg).tolist())

    def fixturing(self, folder: Path, name: str) -> Fixturing:
        """Return the fixturing."""
        obstacles = _bodies(self.obstacles, folder, f"{name}.obstacles")
        turning = _bodies(self.turning, folder, f"{name}.turning")
        if self.light is not None:
            if "light" in {**obstacles, **turning}:
                rule = "must have names that no other object has"
                raise RobotError.of_rule("obstacles", rule, "'light'")
            around = obstacles if self.axis is None else turning
            around["light"] = self.light.body()
        return Fixturing(
            self.part2base,
            obstacles,
            None if self.axis is None else (self.axis.point, self.axis.direction),
            turning=turning,
            **_stated(self, "angles", "turn_speed", "turn_acceleration"),
        )


@dataclass(frozen=True)
class GripTable:
    """One way the robot holds the part."""

    part2flange: Any
    gripper: Mapping[str, BodyTable] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "part2flange", _pose("part2flange", self.part2flange))

    def fixturing(self, folder: Path, name: str) -> Grip:
        """Return the grip."""
        return Grip(self.part2flange, _bodies(self.gripper, folder, f"{name}.gripper"))


@dataclass(frozen=True)
class RobotTable:
    """The robot: a URDF, and what it does not state."""

    urdf: FileName
    tip: Any = None
    base: Any = None
    packages: Mapping[str, FileName] = field(default_factory=dict)
    accelerations: Any = None
    speeds: Any = None
    bodiless_links: Any = None
    coupled: Any = None
    axis_limits_deg: tuple[Triple, ...] = ()
    calibration: FileName | None = None
    joint_offsets_deg: tuple[float, ...] = ()

    def robot(self, folder: Path) -> Robot:
        """Return the robot, which is read from its files."""
        names = ("tip", "base", "accelerations", "speeds", "bodiless_links", "coupled")
        return Robot.from_urdf(
            folder / self.urdf,
            packages={name: folder / path for name, path in self.packages.items()},
            axis_limits=[
                [axis, *np.radians([low, high]).tolist()]
                for axis, low, high in self.axis_limits_deg
            ],
            calibration=None if self.calibration is None else folder / self.calibration,
            joint_offsets=np.radians(self.joint_offsets_deg).tolist(),
            **_stated(self, *names),
        )


@dataclass(frozen=True, kw_only=True)
class CellTable:
    """What a cell has, whatever its hand carries."""

    robot: RobotTable
    camera: CameraTable | None = None
    camera_body: Annotated[
        tuple[BodyTable, ...], Meta(title="must be written [[camera_body]]")
    ] = ()
    light: CarriedLightTable | None = None
    obstacles: Mapping[str, BodyTable] = field(default_factory=dict)
    clearance_mm: Any = None
    home_deg: Angles = ()


@dataclass(frozen=True, kw_only=True)
class CameraInHandTable(CellTable):
    """A cell whose hand carries the camera."""

    cam2flange: Any
    fixturings: Mapping[str, FixturingTable]


@dataclass(frozen=True, kw_only=True)
class PartInHandTable(CellTable):
    """A cell whose camera stands still, while the hand holds the part."""

    cam2base: Any
    fixturings: Mapping[str, GripTable]


def _stated(table: Any, *names: str) -> dict[str, Any]:
    """Return those fields of a table that a file states, as arguments."""
    values = {name: getattr(table, name) for name in names}
    return {name: value for name, value in values.items() if value is not None}


def _bodies(tables: Mapping[str, BodyTable], folder: Path, name: str) -> dict[str, Body]:
    return {key: table.body(folder, f"{name}.{key}") for key, table in tables.items()}


def _pose(name: str, value: Any) -> np.ndarray:
    """Return a pose from four rows, or from a `PoseTable`."""
    if not isinstance(value, Mapping):
        return check_pose(name, value)
    try:
        table = from_plain(PoseTable, value, RobotError)
    except RobotError as error:
        raise RobotError.of_rule(f"{name}.{error.parameter}", error.rule, error.got) from None
    return from_rpy(np.array(table.xyz), np.radians(table.rpy_deg))


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
    if "cam2base" in content and "cam2flange" in content:
        name = f"{file}: cam2base"
        raise RobotError.of_rule(name, "must not be given with cam2flange", "both")
    camera = "cam2base" if "cam2base" in content else "cam2flange"
    kind = PartInHandTable if camera == "cam2base" else CameraInHandTable
    table: Any = from_plain(kind, content, RobotError, str(file))
    try:
        return {camera: _pose(camera, content[camera]), **_arguments(table, file.parent)}
    except RobotError as error:
        if not error.parameter:
            raise
        name = f"{file}: {error.parameter}"
        raise RobotError.of_rule(name, error.rule, error.got, hint=error.hint) from None


def made_of_file(
    kind: Callable[..., Any], fields: Mapping[str, Any], path: str | PathLike[str]
) -> Any:
    """Return a cell made of its fields.

    Parameters
    ----------
    kind : callable
        Makes it.
    fields : mapping
        As `cell_fields` returns them.
    path : str or Path
        The file that states them.

    Raises
    ------
    RobotError
        A field breaks a rule; the message begins with the file's name.
    """
    try:
        return kind(**fields)
    except RobotError as error:
        if error.parameter not in fields:
            raise
        name = f"{Path(path)}: {error.parameter}"
        raise RobotError.of_rule(name, error.rule, error.got, hint=error.hint) from None


def _arguments(table: CameraInHandTable | PartInHandTable, folder: Path) -> dict[str, Any]:
    """Return the arguments of a cell, but for its camera's place."""
    robot = table.robot.robot(folder)
    home = {}
    if table.home_deg:
        if len(table.home_deg) != robot.n_joints:
            rule = f"must be {robot.n_joints} numbers, one for each joint of the robot"
            raise RobotError.of_rule("home_deg", rule, f"{len(table.home_deg)}")
        home["home"] = np.radians(table.home_deg)
    light = {} if table.light is None else {"light": table.light.light()}
    outside = () if table.camera is None else table.camera.bodies()
    solids = [body.body(folder, "camera_body") for body in table.camera_body]
    return {
        "robot": robot,
        "fixturings": {
            name: _fixturing(way, folder, f"fixturings.{name}")
            for name, way in table.fixturings.items()
        },
        "obstacles": _bodies(table.obstacles, folder, "obstacles"),
        "camera_body": (*outside, *solids),
        **_stated(table, "clearance_mm"),
        **light,
        **home,
    }


def _fixturing(table: FixturingTable | GripTable, folder: Path, name: str) -> Fixturing | Grip:
    try:
        return table.fixturing(folder, name)
    except PlannerError as error:
        parameter = f"{name}.{getattr(error, 'parameter', '')}"
        raise RobotError.of_rule(parameter, error.rule, error.got, hint=error.hint) from None


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
        pose = compose(motion, _pose("part2base", fixturing["part2base"]))
        fixturing["part2base"] = pose.tolist()
        for body in (
            *fixturing.get("obstacles", {}).values(),
            *fixturing.get("turning", {}).values(),
            *([fixturing["light"]] if "light" in fixturing else []),
        ):
            before = _pose("pose", body["pose"]) if "pose" in body else np.eye(4)
            body["pose"] = compose(motion, before).tolist()
        if "axis" in fixturing:
            axis = fixturing["axis"]
            direction = np.einsum("ij,j->i", motion[:3, :3], np.array(axis["direction"], float))
            axis["point"] = carry(motion, np.array([axis["point"]], float))[0].tolist()
            axis["direction"] = direction.tolist()
    _name_files_from(content, file.parent, folder)
    return content


def laid_cell(
    path: str | PathLike[str], fixturings: Mapping[str, Fixturing], folder: Path
) -> dict[str, Any]:
    """Return what a cell file states, with other fixturings.

    Parameters
    ----------
    path : str or Path
        A cell file that `cell_fields` takes.
    fixturings : mapping of str to Fixturing
        Objects that the first fixturing of the file has stay as they are there; others are boxes. A turntable is
        that of the file.
    folder : Path
        Names of other files are made relative to it.
    """
    file = Path(path)
    content = _read(file)
    first = next(iter(content["fixturings"].values()))
    content["fixturings"] = {name: _laid(lying, first) for name, lying in fixturings.items()}
    _name_files_from(content, file.parent, folder)
    return content


_TABLE_KEYS = ("axis", "angles", "angles_deg", "turn_speed", "turn_acceleration")
_LIGHT = "light"


def _laid(fixturing: Fixturing, before: Mapping[str, Any]) -> dict[str, Any]:
    """Return a fixturing for a cell file, with what stays of one that the file had."""
    stated: dict[str, Any] = {"part2base": fixturing.part2base.tolist()}
    stated |= {key: before[key] for key in _TABLE_KEYS if key in before}
    if _LIGHT in before:
        stated[_LIGHT] = before[_LIGHT]
    for kind in ("obstacles", "turning"):
        bodies = {
            name: deepcopy(before.get(kind, {}).get(name)) or _box_table(body)
            for name, body in getattr(fixturing, kind).items()
            if not isinstance(body, LightBox)
        }
        if bodies:
            stated[kind] = bodies
    return stated


def _box_table(box: Any) -> dict[str, Any]:
    return {"low": list(box.low), "high": list(box.high), "pose": box.pose.tolist()}


def _name_files_from(content: dict[str, Any], old: Path, new: Path) -> None:
    """Make names of files that are relative to one folder relative to another one."""
    robot = content["robot"]
    places = [(robot, key) for key in ("urdf", "calibration") if key in robot]
    places += [(robot["packages"], key) for key in robot.get("packages", {})]
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
        pairs = [f"{_key(key)} = {_value(item, digits)}" for key, item in value.items()]
        return "{ " + ", ".join(pairs) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(_value(item, digits) for item in value) + "]"
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
