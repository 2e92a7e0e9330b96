"""RAPID for ABB controllers: a module with one joint target for each move."""

from __future__ import annotations

import math
from datetime import date

import numpy as np

from planner.motion.program_record import FixturedTour, RobotProgram
from planner.output.programs.driving import (
    HOME_TOLERANCE_RAD,
    N_AXES,
    CameraSignals,
    Drive,
    degrees,
    head_lines,
    plain,
    steps_of,
)

_NO_AXIS = "9E9"
_N_EXTERNAL = 6


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
    targets = [f"  CONST jointtarget jHome:={_target(home)};"]
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
        *_procedures(signals, program.turns),
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
    body.append("    CheckHome;")
    for step in steps_of(tour, program.rates_of(tour)):
        if isinstance(step, Drive):
            name = f"j{len(targets):04d}"
            targets.append(f"  CONST jointtarget {name}:={_target(step.joints)};")
            body.append(f"    MoveAbsJ {name},v1000\\T:={step.seconds:.3f},fine,tool0;")
        else:
            body.append(f'    TakeImage "{step.image}";')


def _procedures(signals: CameraSignals, turns: bool) -> list[str]:
    """Return the check of home, and how an image is taken."""
    tolerance = math.degrees(HOME_TOLERANCE_RAD)
    far = [f"Abs(now.robax.rax_{k}-jHome.robax.rax_{k})>{tolerance:.3f}" for k in range(1, 7)]
    if turns:
        far.append(f"Abs(now.extax.eax_a-jHome.extax.eax_a)>{tolerance:.3f}")
    return [
        "  PROC CheckHome()",
        "    VAR jointtarget now;",
        "    now:=CJointT();",
        *(
            line
            for test in far
            for line in (
                f"    IF {test} THEN",
                '      TPWrite "The robot must stand at home.";',
                "      EXIT;",
                "    ENDIF",
            )
        ),
        "  ENDPROC",
        "  PROC TakeImage(string name)",
        f"    WaitTime\\InPos,{signals.settle_s:g};",
        "    TPWrite name;",
        f"    PulseDO\\PLength:={signals.pulse_s:g},doCamera;",
        f"    WaitDI diCamera,1\\MaxTime:={signals.timeout_s:g};",
        "  ENDPROC",
    ]
