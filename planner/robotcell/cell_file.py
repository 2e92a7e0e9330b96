"""Cell files: a robot, its camera's place, fixturings and obstacles as one TOML file."""

from __future__ import annotations

import json
import os
import re
import tomllib
from collections.abc import Iterator, Mapping
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from aspectgraph.files import check_plain, read_text
from planner.argument_kinds import shown
from planner.exceptions import PlannerError, RobotError
from planner.robotcell.arm import Robot
from planner.robotcell.bodies import Body, Box, Fixturing, Grip, mesh_of
from planner.robotcell.urdf import carry, check_pose, compose, from_rpy

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
        field = f"{file}: {error.parameter or 'a field'}".rstrip()
        if not error.parameter:
            raise
        raise RobotError.of_rule(field, error.rule, error.got, hint=error.hint) from None


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
            name: read(_table(item, f"fixturings.{name}"), f"fixturings.{name}", folder)
            for name, item in _table(content["fixturings"], "fixturings").items()
        },
        "obstacles": _bodies(content.get("obstacles", {}), "obstacles", folder),
    }
    bodies = content.get("camera_body", [])
    if not isinstance(bodies, list):
        raise RobotError.of_rule("camera_body", "must be written [[camera_body]]", shown(bodies))
    fields["camera_body"] = tuple(_body(item, "camera_body", folder) for item in bodies)
    if "clearance_mm" in content:
        fields["clearance_mm"] = content["clearance_mm"]
    if "home_deg" in content:
        fields["home"] = np.radians(_numbers(content["home_deg"], 6, "home_deg"))
    return fields


def _robot(table: Mapping[str, Any], folder: Path) -> Robot:
    _check_keys(table, _ROBOT, "robot.", required=("urdf",))
    apart = ("urdf", "packages", "axis_limits_deg")
    arguments = {key: value for key, value in table.items() if key not in apart}
    if "axis_limits_deg" in table:
        arguments["axis_limits"] = _axis_limits(table["axis_limits_deg"])
    for key in ("tip", "base"):
        if key in arguments and not isinstance(arguments[key], str):
            raise RobotError.of_rule(
                f"robot.{key}", "must be the name of a link", shown(arguments[key])
            )
    packages = {
        name: folder / _text(value, f"robot.packages.{name}")
        for name, value in _table(table.get("packages", {}), "robot.packages").items()
    }
    return Robot.from_urdf(
        folder / _text(table["urdf"], "robot.urdf"), packages=packages, **arguments
    )


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
    arguments: dict[str, Any] = {key: table[key] for key in _TURNS if key in table}
    if "angles" in table and "angles_deg" in table:
        raise RobotError.of_rule(f"{name}.angles_deg", "must not be given with angles", "both")
    if "angles_deg" in table:
        listed = table["angles_deg"]
        count = len(listed) if isinstance(listed, list) else 1
        arguments["angles"] = np.radians(_numbers(listed, count, f"{name}.angles_deg")).tolist()
    if "axis" in table:
        axis = _table(table["axis"], f"{name}.axis")
        _check_keys(axis, _AXIS, f"{name}.axis.", required=_AXIS)
        arguments["axis"] = [_numbers(axis[key], 3, f"{name}.axis.{key}") for key in _AXIS]
    if "turning" in table:
        arguments["turning"] = _bodies(table["turning"], f"{name}.turning", folder)
    try:
        return Fixturing(part2base, obstacles, **arguments)
    except PlannerError as error:
        field = f"{name}.{getattr(error, 'parameter', '')}"
        raise RobotError.of_rule(field, error.rule, error.got, hint=error.hint) from None


def _grip(table: Mapping[str, Any], name: str, folder: Path) -> Grip:
    _check_keys(table, ("part2flange", "gripper"), f"{name}.", required=("part2flange",))
    part2flange = _pose(table["part2flange"], f"{name}.part2flange")
    return Grip(part2flange, _bodies(table.get("gripper", {}), f"{name}.gripper", folder))


def _bodies(tables: Any, name: str, folder: Path) -> dict[str, Body]:
    return {key: _body(body, f"{name}.{key}", folder) for key, body in _table(tables, name).items()}


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
