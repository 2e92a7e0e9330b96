"""A table of the moves and images, for spreadsheets and programs of your own."""

from __future__ import annotations

import csv
import io
from datetime import date

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
    stream = io.StringIO()
    for line in [*head_lines(program, made), f"Wait {signals.settle_s:g} s before each image."]:
        stream.write(f"# {line}\n")
    writer = csv.writer(stream, lineterminator="\n")
    names = [*program.joint_names, *([TURNTABLE] if program.turns else [])]
    writer.writerow([*_FIRST, *(f"{plain(name, 40)}_rad" for name in names)])
    for tour in program.tours:
        name = plain(tour.fixturing, 40)
        rows = [[name, "start", "0.000", "", "", *radians(program.home_of(tour))]]
        for step in steps_of(tour, program.rates_of(tour)):
            if isinstance(step, Drive):
                rows.append([name, "move", f"{step.seconds:.3f}", "", "", *radians(step.joints)])
            else:
                # the image is taken where the last move ended
                rows[-1][1] = "image"
                rows[-1][3] = str(step.setting_idx + 1)
                rows[-1][4] = step.image
        # a round without a turntable leaves its column empty
        width = len(_FIRST) + len(names)
        writer.writerows([*row, *[""] * (width - len(row))] for row in rows)
    return stream.getvalue()
