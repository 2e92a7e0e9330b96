"""Where a robot program takes its images: its stops, read from the text, and the poses of the camera there.

The programs are those that `planner.write_program` writes. A program holds joints, so a cell turns
them into poses. What takes an image in another program is not known, and such a program is refused.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, NoReturn

import numpy as np

from planner.argument_kinds import shown
from planner.camera.pose import GivenPose
from planner.exceptions import PoseFileError, RequestError
from planner.robotprogram.program import FORMAT, TURNTABLE, program_of
from planner.robotprogram.program_steps import SIX_AXES, plain
from planner.robotprogram.program_texts import from_rapid_order
from planner.sensor_setting import setting_name

if TYPE_CHECKING:
    from planner.robotcell import Cell

_LEAST_AXES = 6


class _Stop(NamedTuple):
    """An image in a program: its name, the fixturing in words, the line, and the angles of all axes, rad."""

    name: str
    fixturing: str
    line: int
    angles: tuple[float, ...]


_Text = Sequence[tuple[int, str]]
_NUMBER = r"[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?"
# several images of a stop are named setting_01_1 and so on, each with its lamps
_NAME = r"(setting_\d+)(?:_\d+)?\.png"
_IMAGE = re.compile(_NAME)
_REMARK = re.compile(_NAME + r"(?:: lamps? [\d, ]+ on)?\s*")


def is_program(text: str, data: Any) -> bool:
    """Tell whether a text, or the data of its JSON, is a robot program without the suffix of its language.

    Parameters
    ----------
    text : str
        The text.
    data : object
        What it holds as JSON; None if it is none.
    """
    if isinstance(data, Mapping):
        return data.get("format") == FORMAT or {"rounds", "start_at"} <= set(data)
    head = next((line for line in text.splitlines() if not line.startswith("#")), "")
    return head.startswith("fixturing,step,seconds")


def read_stops(path: Path, text: str, data: Any, cell: Cell | None) -> tuple[GivenPose, ...]:
    """Return the poses of the camera at the stops of a robot program.

    Parameters
    ----------
    path : Path
        The file, for messages.
    text : str
        The program.
    data : object
        What it holds as JSON; None if it is none.
    cell : Cell or None
        Gives kinematics, hand-eye calibration, and how the part lies.

    Raises
    ------
    PoseFileError
        If no image is taken in it, or a stop breaks a rule; names the line.
    RequestError
        If there is no cell.
    """
    stops = list(_stops(path, text, data))
    if not stops:
        raise PoseFileError(
            f"{path}: a robot program must take images as those of 'aspectgraph program' do. Got none "
            "that is known; write the poses of the camera as CSV or for ROS."
        )
    if cell is None:
        rule = "must be given for a robot program, which holds joints and no poses"
        raise RequestError.of_rule("cell", rule, "none")
    # several images of a stop have one pose
    first: dict[tuple[Any, ...], _Stop] = {}
    for stop in stops:
        first.setdefault((stop.name, stop.fixturing, stop.angles), stop)
    holds_axes = _holds_axes(path, data)
    return tuple(_pose_of(path, stop, cell, holds_axes) for stop in first.values())


def _stops(path: Path, text: str, data: Any) -> Iterator[_Stop]:
    lines = list(enumerate(text.splitlines(), 1))
    suffix = path.suffix.lower()
    if isinstance(data, Mapping):
        if data.get("format") == FORMAT:
            yield from _of_record(data)
        else:
            yield from _of_trajectories(path, data)
    elif suffix in SUFFIXES:
        yield from _READERS[suffix](path, lines)
    else:
        yield from _of_rows(path, lines)


def _holds_axes(path: Path, data: Any) -> bool:
    """Tell whether a program holds the axes that the controller counts, instead of joints."""
    return data is None and path.suffix.lower() in SUFFIXES


def _pose_of(path: Path, stop: _Stop, cell: Cell, holds_axes: bool) -> GivenPose:
    names = [name for name in cell.fixturings if plain(name, 40) == stop.fixturing]
    if len(names) != 1:
        fixturings = ", ".join(map(repr, cell.fixturings))
        _refuse(
            path,
            stop.line,
            f"fixturing must be one of the cell: {fixturings}",
            repr(stop.fixturing),
        )
    angles = np.array(stop.angles)
    n_joints = cell.robot.n_joints
    turns = len(cell.angles(names[0])) > 1
    if turns and len(angles) == n_joints:
        angles = np.append(angles, 0.0)
    if len(angles) != n_joints + turns:
        rule = f"a stop must have {n_joints + turns} axes in this cell"
        _refuse(path, stop.line, rule, str(len(angles)))
    if holds_axes:
        if path.suffix.lower() == ".mod" and n_joints > SIX_AXES:
            angles = from_rapid_order(angles)
        angles = cell.robot.controller.joints(angles)
    return GivenPose(stop.name, cell.cam2world(angles[None], names[0])[0])


def _refuse(path: Path, line: int, rule: str, got: str) -> NoReturn:
    place = f"{path}:{line}" if line else str(path)
    raise PoseFileError(f"{place}: {rule}. Got {got}.")


def _after_move(path: Path, line: int, angles: tuple[float, ...] | None) -> tuple[float, ...]:
    if angles is None:
        _refuse(path, line, "an image must follow a move of the robot", "none")
    return angles


# One reader for each language: the last move before an image is its stop.


def _of_urscript(path: Path, lines: _Text) -> Iterator[_Stop]:
    angles = None
    fixturing = ""
    for line, text in lines:
        if match := re.match(r"\s*# fixturing (.*)", text):
            fixturing = match[1].strip()
        elif match := re.match(r"\s*movej\(\[([^\]]*)\]", text):
            angles = _numbers(path, line, match[1].split(","))
        elif match := re.match(rf'\s*take_image\("{_NAME}"\)', text):
            yield _Stop(match[1], fixturing, line, _after_move(path, line, angles))


def _of_rapid(path: Path, lines: _Text) -> Iterator[_Stop]:
    targets: dict[str, tuple[float, ...]] = {}
    angles = None
    fixturing = ""
    for line, text in lines:
        if match := re.match(r"\s*CONST jointtarget (\w+)\s*:=\s*\[\[(.*?)\],\[(.*?)\]\]", text):
            external = [word for word in match[3].split(",") if word.strip().upper() != "9E9"]
            degrees = _numbers(path, line, [*match[2].split(","), *external])
            targets[match[1]] = tuple(np.radians(degrees).tolist())
        elif match := re.match(r'\s*UIMsgBox "Part in fixturing (.*?)\?"', text):
            fixturing = match[1]
        elif match := re.match(r"\s*MoveAbsJ (\w+)", text):
            if match[1] not in targets and match[1] != "jHome":
                _refuse(path, line, "a move must be to a target of the module", repr(match[1]))
            angles = targets.get(match[1])
        elif match := re.match(rf'\s*TakeImage "{_NAME}";', text):
            yield _Stop(match[1], fixturing, line, _after_move(path, line, angles))


def _of_krl(path: Path, lines: _Text) -> Iterator[_Stop]:
    angles = None
    fixturing = ""
    for line, text in lines:
        if match := re.match(r"; Put the part in fixturing (.*), then start again\.", text):
            fixturing = match[1]
        elif match := re.match(r"\s*PTP \{(.*)\}", text):
            words = [word.split()[-1] for word in match[1].split(",")]
            angles = tuple(np.radians(_numbers(path, line, words)).tolist())
        elif text.startswith("; ") and (match := _REMARK.fullmatch(text[2:])):
            yield _Stop(match[1], fixturing, line, _after_move(path, line, angles))


def _of_fanuc(path: Path, lines: _Text) -> Iterator[_Stop]:
    positions = _fanuc_positions(path, lines)
    remark = ""
    angles = None
    fixturing = ""
    for line, text in lines:
        statement = re.sub(r"^\s*\d+:\s*|\s*;\s*\Z", "", text)
        if statement.startswith("!"):
            remark = f"{remark} {statement[1:].strip()}".strip()
        elif statement.startswith("MESSAGE"):
            if match := re.match(r"Put the part in fixturing (.*), then start again\.", remark):
                fixturing = match[1]
        elif match := re.match(r"J P\[(\d+)\]", statement):
            if match[1] not in positions:
                _refuse(path, line, "a move must be to a position of the program", f"P[{match[1]}]")
            angles = positions[match[1]]
        elif match := _REMARK.fullmatch(remark):
            yield _Stop(match[1], fixturing, line - 1, _after_move(path, line, angles))
        if not statement.startswith("!"):
            remark = ""


def _fanuc_positions(path: Path, lines: _Text) -> dict[str, tuple[float, ...]]:
    """Return the axes of positions by their numbers, rad."""
    positions = {}
    number = ""
    words: list[str] = []
    for line, text in lines:
        if match := re.match(r"P\[(\d+)[^\]]*\]\{", text):
            number = match[1]
            words = []
        elif number and text.startswith("}"):
            positions[number] = tuple(np.radians(_numbers(path, line, words)).tolist())
            number = ""
        elif number:
            words += re.findall(r"\b[JE]\d\s*=\s*([-\d.]+)\s*deg", text)
    return positions


def _of_rows(path: Path, lines: _Text) -> Iterator[_Stop]:
    rows = [(line, text) for line, text in lines if text.strip() and not text.startswith("#")]
    heading = next(csv.reader([rows[0][1]]))
    first = heading.index("image") + 1
    columns = [
        k
        for k, name in enumerate(heading)
        if k >= first and name.endswith("_rad") and not name.endswith("_of_controller_rad")
    ]
    for line, text in rows[1:]:
        cells = next(csv.reader([text]))
        if len(cells) != len(heading):
            _refuse(path, line, f"a row must have {len(heading)} cells", str(len(cells)))
        if match := _IMAGE.fullmatch(cells[first - 1]):
            angles = _numbers(path, line, [cells[k] for k in columns if cells[k]])
            yield _Stop(match[1], cells[0], line, angles)


def _of_trajectories(path: Path, data: Mapping[str, Any]) -> Iterator[_Stop]:
    for k, tour in enumerate(data["rounds"]):
        angles = None
        for i, step in enumerate(tour.get("steps", ())):
            place = f"rounds[{k}].steps[{i}]"
            if "joint_trajectory" in step:
                points = step["joint_trajectory"].get("points") or [{}]
                words = points[-1].get("positions")
                if not isinstance(words, list):
                    _refuse(path, 0, f"{place}: a point must hold positions", shown(words))
                angles = _numbers(path, 0, words)
            elif match := _IMAGE.fullmatch(str(step.get("image", ""))):
                fixturing = plain(str(tour.get("fixturing", "")), 40)
                yield _Stop(match[1], fixturing, 0, _after_move(path, 0, angles))


def _of_record(data: Mapping[str, Any]) -> Iterator[_Stop]:
    for tour in program_of(data).tours:
        for stop in tour.stops:
            name = setting_name(stop.setting_idx)
            yield _Stop(name, plain(tour.fixturing, 40), 0, tuple(stop.joints.tolist()))


def _numbers(path: Path, line: int, words: Sequence[Any]) -> tuple[float, ...]:
    try:
        values = [float(word) for word in words]
    except (TypeError, ValueError):
        _refuse(path, line, "a target must hold numbers", shown(", ".join(map(str, words)), str))
    if len(values) < _LEAST_AXES or not np.isfinite(values).all():
        rule = f"a target must hold {_LEAST_AXES} finite axes, and a {TURNTABLE} behind them if there is one"
        _refuse(path, line, rule, str(len(values)))
    return tuple(values)


_READERS: dict[str, Callable[[Path, _Text], Iterator[_Stop]]] = {
    ".script": _of_urscript,
    ".mod": _of_rapid,
    ".src": _of_krl,
    ".ls": _of_fanuc,
}
SUFFIXES = frozenset(_READERS)
"""Suffixes of programs of robots."""
