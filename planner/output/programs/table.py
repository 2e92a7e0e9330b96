"""A table of the moves and images, for spreadsheets and programs of your own."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import date

import numpy as np

from aspectgraph.entities.spreadsheet_text import NumberText, table_text
from planner.motion.program_record import TURNTABLE, RobotProgram
from planner.output.programs.driving import (
    NO_HOME_CHECK,
    CameraSignals,
    Drive,
    head_lines,
    plain,
    radians,
    steps_of,
    time_text,
)

_FIRST = ("fixturing", "step", "seconds", "setting", "image")


def csv_text(program: RobotProgram, signals: CameraSignals, made: date) -> str:
    """Return a row for each move; joints and the angle of a turntable in rad. Lines of the head begin with ``#``.

    Parameters
    ----------
    program : RobotProgram
        The program.
    signals : CameraSignals
        The settling time stands in the head.
    made : date
        The day, for the head.
    """
    names = [*program.joint_names, *([TURNTABLE] if program.turns else [])]
    coupled = sorted({axis for axis, _, _ in program.controller.coupled})
    columns = [f"{plain(name, 40)}_rad" for name in names]
    heading = [*_FIRST, *columns, *(f"axis_{axis}_of_controller_rad" for axis in coupled)]
    table: list[list[str]] = []
    for tour in program.tours:
        name = plain(tour.fixturing, 40)
        home = _angles(program.home_of(tour), program, coupled, len(names))
        table.append(_row(name, "start", 0.0, home))
        for step in steps_of(tour, program):
            if isinstance(step, Drive):
                angles = _angles(step.joints, program, coupled, len(names))
                table.append(_row(name, "move", step.seconds, angles))
            else:
                # the image is taken where the last move ended
                table[-1][1] = "image"
                table[-1][3] = str(step.setting_idx + 1)
                table[-1][4] = step.image
    head = [
        *head_lines(program, made),
        NO_HOME_CHECK,
        f"Wait {time_text(signals.settle_s)} s before each image.",
    ]
    return table_text(heading, table, head, "\n")


def _row(fixturing: str, step: str, seconds: float, angles: Sequence[str]) -> list[str]:
    return [fixturing, step, *map(NumberText, [f"{seconds:.3f}", "", "", *angles])]


def _angles(
    joints: np.ndarray, program: RobotProgram, coupled: Sequence[int], width: int
) -> list[str]:
    """Return the joints, and behind them the controller's axes that are coupled."""
    angles = radians(joints)
    axes = radians(program.controller.of(joints))
    # a round without a turntable leaves its column empty
    return [*angles, *[""] * (width - len(angles)), *(axes[axis - 1] for axis in coupled)]
