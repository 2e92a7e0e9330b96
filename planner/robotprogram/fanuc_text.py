"""Programs for FANUC controllers, as ASCII files (``.ls``) that the controller or its tools load.

The syntax is that of files that controllers write: ``/PROG``, ``/ATTR``, statements behind ``/MN``, and positions
behind ``/POS``. Angles have three decimals, as there: each axis is at most 0.0005 degrees off. Of waits that time out
see Lincoln Electric, "Wait instructions"; of moves with a stated time Haber, "Basics of Fanuc motion instructions".
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterator
from datetime import date

import numpy as np
from scipy.spatial.transform import Rotation

from planner.robotprogram.program import FixturedTour, RobotProgram
from planner.robotprogram.program_steps import (
    SILENT,
    SLOW_PERCENT,
    STILL_READY,
    ZEROS,
    CameraSignals,
    Drive,
    head_lines,
    home_words,
    plain,
    steps_of,
)

FANUC_NAME = "INSPECTION"
MOST_FANUC_LETTERS = 36
"""Of the name of a program."""

# of a remark, and of a message on the pendant
_REMARK = 32
_MESSAGE = 24
# digits of angles, degrees
_DECIMALS = 3
# a position register and a register that the check of home overwrites
_REGISTER = 90
# whole milliseconds of a move, then tenths of seconds
_MOST_MSEC = 32000


class _Statements:
    """The statements of a program, its positions, and the next free label."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.positions: list[np.ndarray] = []
        self._labels = 0

    def add(self, *statements: str) -> None:
        """Add statements; a motion has no blanks behind its number."""
        for statement in statements:
            blanks = "" if statement.startswith("J ") else "  "
            self.lines.append(f"{len(self.lines) + 1:4d}:{blanks}{statement} ;")

    def remark(self, text: str) -> None:
        """Add a comment in as many lines as it needs."""
        # a semicolon would end the statement
        for line in textwrap.wrap(text.replace(";", ","), _REMARK - 1):
            self.add(f"! {line}"[: _REMARK + 1])

    def ask(self, message: str, words: str) -> None:
        """Stop until the operator starts again, with a message on the pendant and the reason as comments."""
        self.remark(words)
        self.add(f"MESSAGE[{message[:_MESSAGE]}]", "PAUSE")

    def label(self) -> int:
        """Return a new label."""
        self._labels += 1
        return self._labels

    def move(self, axes: np.ndarray, speed: str) -> None:
        """Add a joint move that stops at its end."""
        self.positions.append(axes)
        self.add(f"J P[{len(self.positions)}] {speed} FINE")


def fanuc_text(program: RobotProgram, signals: CameraSignals, made: date) -> str:
    """Return the program as an ASCII file of FANUC; axes in degrees, the time of each move as its speed.

    Parameters
    ----------
    program : RobotProgram
        The program.
    signals : CameraSignals
        Trigger and answer of the camera. Waits are rounded up to 0.01 s, and the trigger to 0.1 s.
    made : date
        The day, for the head.
    """
    statements = _Statements()
    for line in (*head_lines(program, made, wpr_words), *_axes_lines(program)):
        statements.remark(line)
    statements.add("UFRAME_NUM=0", "UTOOL_NUM=0")
    statements.add(f"$WAITTMOUT={_hundredths(signals.longest_s)}")
    for tour in program.tours:
        _add_round(statements, tour, program, signals)
    return "\n".join([*_attributes(len(statements.lines), made), *_body(statements)]) + "\n"


def wpr_words(pose: np.ndarray) -> str:
    """Return a pose (4, 4) as FANUC's pendant does: mm, and angles about the fixed x, y and z in degrees."""
    x, y, z = pose[:3, 3]
    w, p, r = Rotation.from_matrix(pose[:3, :3]).as_euler("xyz", degrees=True)
    return f"X {x:.2f}, Y {y:.2f}, Z {z:.2f} mm, W {w:.3f}, P {p:.3f}, R {r:.3f} degrees"


def _axes_lines(program: RobotProgram) -> Iterator[str]:
    yield ZEROS
    if not any(axis == 3 for axis, _, _ in program.controller.coupled):
        yield (
            "J3 is joint 3 of the URDF. Controllers of FANUC count J3 from the horizon: if yours does, state "
            "robot.coupled in the cell file."
        )
    if program.pendant is None:
        yield "The pendant counts z from the height of axis 2."
    yield f"The check of home overwrites R[{_REGISTER}] and PR[{_REGISTER}]."
    if program.turns:
        yield "E1 is the turntable. At 0 the part is put on it."


def _attributes(n_lines: int, made: date) -> list[str]:
    """Return what stands before the statements."""
    day = f"DATE {made:%y-%m-%d}  TIME 00:00:00"
    return [
        f"/PROG  {FANUC_NAME}",
        "/ATTR",
        "OWNER\t\t= MNEDITOR;",
        'COMMENT\t\t= "aspectgraph";',
        "PROG_SIZE\t= 0;",
        f"CREATE\t\t= {day};",
        f"MODIFIED\t= {day};",
        "FILE_NAME\t= ;",
        "VERSION\t\t= 0;",
        f"LINE_COUNT\t= {n_lines};",
        "MEMORY_SIZE\t= 0;",
        "PROTECT\t\t= READ_WRITE;",
        "TCD:  STACK_SIZE\t= 0,",
        "      TASK_PRIORITY\t= 50,",
        "      TIME_SLICE\t= 0,",
        "      BUSY_LAMP_OFF\t= 0,",
        "      ABORT_REQUEST\t= 0,",
        "      PAUSE_REQUEST\t= 0;",
        "DEFAULT_GROUP\t= 1,*,*,*,*;",
        "CONTROL_CODE\t= 00000000 00000000;",
    ]


def _body(statements: _Statements) -> list[str]:
    """Return statements and positions."""
    lines = ["/MN", *statements.lines, "/POS"]
    for number, axes in enumerate(statements.positions, start=1):
        named = [f"{name}={value:>10} deg" for name, value in _named(axes)]
        lines += [f"P[{number}]{{", "   GP1:", "\tUF : 0, UT : 0,\t"]
        rows = [named[k : k + 3] for k in range(0, len(named), 3)]
        lines += ["\t" + ",\t".join(row) + "," for row in rows[:-1]]
        lines += ["\t" + ",\t".join(rows[-1]), "};"]
    return [*lines, "/END"]


def _named(axes: np.ndarray) -> list[tuple[str, str]]:
    """Return the axes with their angles in degrees; a turntable is E1."""
    names = ["J1", "J2", "J3", "J4", "J5", "J6", "E1"]
    angles = [f"{angle:.{_DECIMALS}f}" for angle in np.round(np.degrees(axes), _DECIMALS) + 0.0]
    return list(zip(names, angles, strict=False))


def _add_round(
    statements: _Statements, tour: FixturedTour, program: RobotProgram, signals: CameraSignals
) -> None:
    """Add the statements and positions of a round."""
    home = program.controller.of(program.home_of(tour))
    name = plain(tour.fixturing, 40)
    words = f"Put the part in fixturing {name}, then start again. {home_words(program, wpr_words)}"
    statements.ask("Put in the part", words.rstrip())
    _check_home(statements, home, math.degrees(program.start.tolerance_rad))
    statements.move(home, f"{SLOW_PERCENT}%")
    for step in steps_of(tour, program):
        if isinstance(step, Drive):
            statements.move(step.axes, _duration(step.seconds))
        else:
            statements.remark(step.remark)
            _add_image(statements, signals)


def _check_home(statements: _Statements, home: np.ndarray, tolerance: float) -> None:
    """Add a stop where the robot is not at home; who starts again answers for the way there."""
    far = statements.label()
    near = statements.label()
    statements.add(f"PR[{_REGISTER}]=JPOS")
    unit = 10.0**_DECIMALS
    for axis, angle in enumerate(np.degrees(home).tolist(), start=1):
        # rounded inwards: what passes is within what is proven
        high = math.floor((angle + tolerance) * unit) / unit
        low = math.ceil((angle - tolerance) * unit) / unit
        statements.add(f"R[{_REGISTER}]=PR[{_REGISTER},{axis}]")
        statements.add(f"IF R[{_REGISTER}]>{_constant(high)},JMP LBL[{far}]")
        statements.add(f"IF R[{_REGISTER}]<{_constant(low)},JMP LBL[{far}]")
    statements.add(f"JMP LBL[{near}]", f"LBL[{far}]")
    words = (
        "The robot is not at home, and the way there is not checked. Drive there by hand. Or start again only if "
        "the way is free: the robot drives there slowly."
    )
    statements.ask("Not at home", words)
    statements.add(f"LBL[{near}]")


def _add_image(statements: _Statements, signals: CameraSignals) -> None:
    """Add what takes an image; the pulse runs while the answer is waited for."""
    again, still, silent, taken = (statements.label() for _ in range(4))
    camera = f"DI[{signals.ready_input}]"
    if signals.settle_s:
        statements.add(f"WAIT {_seconds(signals.settle_s)}(sec)")
    pulse = math.ceil(round(10 * signals.pulse_s, 6)) / 10
    statements.add(
        f"LBL[{again}]",
        f"WAIT {camera}=OFF TIMEOUT,LBL[{still}]",
        f"DO[{signals.trigger_output}]=PULSE,{pulse:.1f}sec",
        f"WAIT {camera}=ON TIMEOUT,LBL[{silent}]",
        f"JMP LBL[{taken}]",
        f"LBL[{still}]",
    )
    statements.ask("Camera is still high", f"{STILL_READY} Start again to try once more.")
    statements.add(f"JMP LBL[{again}]", f"LBL[{silent}]")
    statements.ask("Camera is silent", f"{SILENT} Start again to try once more.")
    statements.add(f"JMP LBL[{again}]", f"LBL[{taken}]")


def _duration(seconds: float) -> str:
    """Return the time of a move, rounded up: whole milliseconds, and tenths of a second if it is long."""
    milliseconds = max(1, math.ceil(round(1000 * seconds, 6)))
    if milliseconds <= _MOST_MSEC:
        return f"{milliseconds}msec"
    return f"{math.ceil(round(10 * seconds, 6)) / 10:.1f}sec"


def _hundredths(seconds: float) -> int:
    return math.ceil(round(100 * seconds, 6))


def _seconds(seconds: float) -> str:
    """Return a wait in hundredths of a second, rounded up, as controllers write it."""
    return f"{_hundredths(seconds) / 100:.2f}".removeprefix("0").rjust(6)


def _constant(value: float) -> str:
    """Return a number of a comparison; a negative one is in parentheses."""
    text = f"{value + 0.0:.{_DECIMALS}f}"
    return f"({text})" if value < 0 else text
