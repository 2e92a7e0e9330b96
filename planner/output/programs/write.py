"""Writing a robot program in one of the formats."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from datetime import date
from pathlib import Path

from planner.argument_kinds import check_kinds, shown
from planner.exceptions import RequestError
from planner.files import write_text
from planner.motion.program_record import RobotProgram
from planner.output.programs.driving import CameraSignals, check_program_speed
from planner.output.programs.krl import krl_text
from planner.output.programs.rapid import rapid_text
from planner.output.programs.ros_trajectory import ros_text
from planner.output.programs.table import csv_text
from planner.output.programs.urscript import urscript_text

_Writer = Callable[[RobotProgram, CameraSignals, date], str]


def _json_text(program: RobotProgram, signals: CameraSignals, made: date) -> str:
    return json.dumps(program.to_dict(), indent=1, allow_nan=False) + "\n"


_WRITERS: dict[str, _Writer] = {
    "urscript": urscript_text,
    "rapid": rapid_text,
    "krl": krl_text,
    "ros": ros_text,
    "csv": csv_text,
    "json": _json_text,
}
FORMATS = {
    "urscript": "inspection.script",
    "rapid": "inspection.mod",
    "krl": "inspection.src",
    "ros": "inspection_ros.json",
    "csv": "inspection.csv",
    "json": "program.json",
}
"""The formats, and the usual name of a file in each."""

_BY_SUFFIX = {".script": "urscript", ".mod": "rapid", ".src": "krl", ".csv": "csv", ".json": "json"}


def program_text(
    program: RobotProgram,
    format: str,
    *,
    signals: CameraSignals | None = None,
    made: date | None = None,
) -> str:
    """Return a robot program as text.

    Parameters
    ----------
    program : RobotProgram
        The program.
    format : str
        "urscript", "rapid", "krl", "ros" (trajectories as JSON), "csv" or "json" (all data).
    signals : CameraSignals, optional
        Trigger and answer of the camera. Default: output 1, input 1.
    made : datetime.date, optional
        The day at the head of the program. Default: today.

    Returns
    -------
    str
        Joints in rad, except "rapid" and "krl", which are in degrees.

    Raises
    ------
    RequestError
        If the format is unknown, an argument has the wrong type, or the language cannot say the
        program's speed.

    Examples
    --------
    >>> from aspectgraph import read_solid
    >>> from planner import Cell, program_text, read_plan, robot_program
    >>> plan = read_plan("examples/two_pocket_block_plan.json")
    >>> block = read_solid("examples/two_pocket_block.off")
    >>> program = robot_program(plan, block, Cell.from_toml("examples/cell.toml"))
    >>> program_text(program, "rapid").splitlines()[0]
    'MODULE Inspection'
    """
    check_kinds(program=(program, "RobotProgram"))
    if format not in _WRITERS:
        rule = f"must be one of {', '.join(_WRITERS)}"
        raise RequestError.of_rule("format", rule, shown(format))
    check_program_speed(program.speed, format)
    given = CameraSignals() if signals is None else signals
    return _WRITERS[format](program, given, date.today() if made is None else made)


def write_program(
    program: RobotProgram,
    path: str | os.PathLike[str],
    *,
    format: str | None = None,
    signals: CameraSignals | None = None,
) -> Path:
    """Write a robot program. The file appears whole or not at all.

    Parameters
    ----------
    program : RobotProgram
        The program.
    path : str or os.PathLike
        The file; an existing one is replaced.
    format : str, optional
        As for `program_text`. Default: by the suffix .script, .mod, .src, .csv or .json.
    signals : CameraSignals, optional
        Trigger and answer of the camera.

    Returns
    -------
    pathlib.Path
        The file.

    Raises
    ------
    RequestError
        If neither format nor suffix is known.
    OutputError
        If it cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> from aspectgraph import read_solid
    >>> from planner import Cell, read_plan, robot_program, write_program
    >>> plan = read_plan("examples/two_pocket_block_plan.json")
    >>> block = read_solid("examples/two_pocket_block.off")
    >>> program = robot_program(plan, block, Cell.from_toml("examples/cell.toml"))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_program(program, folder + "/inspection.src").name
    'inspection.src'
    """
    path = Path(path)
    if format is None:
        format = _BY_SUFFIX.get(path.suffix.lower())
    if format is None:
        rule = f"must end in {', '.join(_BY_SUFFIX)}, or format must be given"
        raise RequestError.of_rule("path", rule, shown(str(path)))
    write_text(path, program_text(program, format, signals=signals))
    return path
