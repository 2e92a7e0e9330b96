"""RAPID for ABB controllers: a module with one joint target for each move."""

from __future__ import annotations

from datetime import date

import numpy as np

from planner.motion.program_record import FixturedTour, RobotProgram
from planner.output.programs.driving import (
    N_AXES,
    CameraSignals,
    Drive,
    degrees,
    head_lines,
    plain,
    steps_of,
    time_text,
    tolerance_deg,
)

_NO_AXIS = "9E9"
_N_EXTERNAL = 6
_LEAST_S = 0.001


def rapid_text(program: RobotProgram, signals: CameraSignals, made: date) -> str:
    """Return the program in RAPID; joints in degrees, the time of each move as its speed.

    Parameters
    ----------
    program : RobotProgram
        The program.
    signals : CameraSignals
        Times of trigger and answer; the signals are called ``doCamera`` and ``diCamera``.
    made : date
        The day, for the head.
    """
    home = np.append(program.home, 0.0) if program.turns else program.home
    targets = [
        f"  CONST jointtarget jHome:={_target(program.controller.of(home))};",
        # of the tool in mm/s and degrees/s; the other numbers are of external axes
        "  CONST speeddata vHome:=[100,5,100,5];",
    ]
    body: list[str] = []
    for tour in program.tours:
        _add_round(tour, program, targets, body)
    lines = [
        "MODULE Inspection",
        *(f"  ! {line}" for line in head_lines(program, made)),
        f"  ! doCamera is digital output {signals.trigger_output}, diCamera is digital input {signals.ready_input}.",
        "  ! Replace tool0 by a tool with the mass of the camera.",
        *(["  ! eax_a is the turntable; at 0 the part is put on it."] if program.turns else []),
        *targets,
        "  PROC main()",
        *body,
        "  ENDPROC",
        *_go_home(program),
        *_take_image(signals),
        "ENDMODULE",
    ]
    return "\n".join(lines) + "\n"


def _target(joints: np.ndarray) -> str:
    """Return a target; the angle of a turntable is the first external axis."""
    angles = degrees(joints)
    external = [*angles[N_AXES:], *[_NO_AXIS] * _N_EXTERNAL][:_N_EXTERNAL]
    return f"[[{','.join(angles[:N_AXES])}],[{','.join(external)}]]"


def _add_round(
    tour: FixturedTour, program: RobotProgram, targets: list[str], body: list[str]
) -> None:
    """Add the targets and the statements of a round."""
    body.append(f'    UIMsgBox "Part in fixturing {plain(tour.fixturing, 40)}?";')
    body.append("    GoHome;")
    for step in steps_of(tour, program):
        if isinstance(step, Drive):
            name = f"j{len(targets) - 1:04d}"
            targets.append(f"  CONST jointtarget {name}:={_target(step.axes)};")
            # the controller drives in no time of 0
            seconds = max(step.seconds, _LEAST_S)
            body.append(f"    MoveAbsJ {name},v1000\\T:={seconds:.3f},fine,tool0;")
        else:
            body.append(f'    TakeImage "{step.image}";')


def _go_home(program: RobotProgram) -> list[str]:
    """Return how the robot is driven to home: from near it, or where the operator lets it."""
    tolerance = tolerance_deg(program)
    far = [f"Abs(now.robax.rax_{k}-jHome.robax.rax_{k})>{tolerance}" for k in range(1, 7)]
    if program.turns:
        far.append(f"Abs(now.extax.eax_a-jHome.extax.eax_a)>{tolerance}")
    return [
        "  PROC GoHome()",
        "    VAR jointtarget now;",
        "    VAR bool isFar:=FALSE;",
        "    VAR btnres answer;",
        "    now:=CJointT();",
        *(
            line
            for test in far
            for line in (
                f"    IF {test} THEN",
                "      isFar:=TRUE;",
                "    ENDIF",
            )
        ),
        "    IF isFar THEN",
        '      UIMsgBox\\Header:="The robot is not at home",'
        '"The way to home is not checked."'
        '\\MsgLine2:="OK: it is free, drive there slowly."'
        '\\MsgLine3:="Cancel: stop the program."'
        "\\Buttons:=btnOKCancel\\Icon:=iconWarning\\Result:=answer;",
        "      IF answer<>resOK THEN",
        "        EXIT;",
        "      ENDIF",
        "    ENDIF",
        "    MoveAbsJ jHome,vHome,fine,tool0;",
        "  ENDPROC",
    ]


def _take_image(signals: CameraSignals) -> list[str]:
    """Return how an image is taken."""
    return [
        "  PROC TakeImage(string name)",
        f"    WaitTime\\InPos,{time_text(signals.settle_s)};",
        "    TPWrite name;",
        f"    PulseDO\\PLength:={time_text(signals.pulse_s)},doCamera;",
        f"    WaitDI diCamera,1\\MaxTime:={time_text(signals.timeout_s)};",
        "  ENDPROC",
    ]
