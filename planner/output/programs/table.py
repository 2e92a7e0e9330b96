"""A table of the moves and images, for spreadsheets and programs of your own."""

from __future__ import annotations

from datetime import date

import numpy as np

from aspectgraph.entities.spreadsheet_text import NumberText, table_text
from planner.motion.program_record import TURNTABLE, RobotProgram
from planner.output.programs.driving import (
    CameraSignals,
    Drive,
    head_lines,
    plain,
    radians,
    steps_of,
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
    heading = [*_FIRST, *(f"{plain(name, 40)}_rad" for name in names)]
    table: list[list[str]] = []
    for tour in program.tours:
        name = plain(tour.fixturing, 40)
        table.append(_row(name, "start", 0.0, program.home_of(tour)))
        for step in steps_of(tour, program.rates_of(tour)):
            if isinstance(step, Drive):
                table.append(_row(name, "move", step.seconds, step.joints))
            else:
                # the image is taken where the last move ended
                table[-1][1] = "image"
                table[-1][3] = str(step.setting_idx + 1)
                table[-1][4] = step.image
    # a round without a turntable leaves its column empty
    rows = [[*row, *[""] * (len(heading) - len(row))] for row in table]
    head = [*head_lines(program, made), f"Wait {signals.settle_s:g} s before each image."]
    return table_text(heading, rows, head, "\n")


def _row(fixturing: str, step: str, seconds: float, joints: np.ndarray) -> list[str]:
    numbers = [f"{seconds:.3f}", "", "", *radians(joints)]
    return [fixturing, step, *map(NumberText, numbers)]
