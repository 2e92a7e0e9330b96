"""KRL for KUKA controllers: point-to-point moves by axis angles."""

from __future__ import annotations

import math
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

_SLOW_PERCENT = 1


def krl_text(program: RobotProgram, signals: CameraSignals, made: date) -> str:
    """Return the program in KRL; joints in degrees, one speed for all moves.

    Parameters
    ----------
    program : RobotProgram
        The program.
    signals : CameraSignals
        Trigger and answer of the camera; KRL waits for the answer without an end.
    made : date
        The day, for the head.
    """
    percent = max(1, math.floor(100 * program.speed + 1e-9))
    lines = [
        "DEF inspection( )",
        *(f"; {line}" for line in head_lines(program, made)),
        "; Compare signs and zeros of the axes with the robot before you drive.",
        "; $VEL_AXIS is a share of this controller's speeds, so times differ from those above.",
        "INT i",
        "BAS(#INITMOV,0)",
    ]
    if program.turns:
        lines.append("; E1 is the turntable, in degrees; 0 is where the part is put on it.")
    for tour in program.tours:
        lines += _round(tour, program, signals, percent)
    return "\n".join([*lines, "END"]) + "\n"


def _axes(joints: np.ndarray) -> str:
    return f"{{{','.join(f'{axis} {value}' for axis, value in _named(joints))}}}"


def _named(joints: np.ndarray) -> list[tuple[str, str]]:
    """Return the axes with their angles in degrees; a turntable is E1."""
    names = [*(f"A{k}" for k in range(1, N_AXES + 1)), "E1"]
    return list(zip(names, degrees(joints), strict=False))


def _speeds(percent: int, turns: bool) -> list[str]:
    """Return the statements that set the shares of the axes' speeds and accelerations."""
    lines = [
        "FOR i=1 TO 6",
        f"  $VEL_AXIS[i]={percent}",
        f"  $ACC_AXIS[i]={percent}",
        "ENDFOR",
    ]
    return [*lines, f"$VEL_EXTAX[1]={percent}", f"$ACC_EXTAX[1]={percent}"] if turns else lines


def _round(
    tour: FixturedTour, program: RobotProgram, signals: CameraSignals, percent: int
) -> list[str]:
    home = program.controller.of(program.home_of(tour))
    lines = [
        f"; Put the part in fixturing {plain(tour.fixturing, 40)}, then start again.",
        "HALT",
        *_home_check(home, tolerance_deg(program)),
        *_speeds(_SLOW_PERCENT, program.turns),
        f"PTP {_axes(home)}",
        *_speeds(percent, program.turns),
    ]
    for step in steps_of(tour, program):
        if isinstance(step, Drive):
            lines.append(f"PTP {_axes(step.axes)}")
        else:
            lines += [
                f"; {step.image}",
                f"WAIT SEC {time_text(signals.settle_s)}",
                f"$OUT[{signals.trigger_output}]=TRUE",
                f"WAIT SEC {time_text(signals.pulse_s)}",
                f"$OUT[{signals.trigger_output}]=FALSE",
                f"WAIT FOR $IN[{signals.ready_input}]",
            ]
    return lines


def _home_check(home: np.ndarray, tolerance: str) -> list[str]:
    """Return a halt where the robot is not at home; who starts again answers for the way there."""
    far = " OR ".join(
        f"(ABS($AXIS_ACT.{axis}-({value}))>{tolerance})" for axis, value in _named(home)
    )
    return [
        f"IF {far} THEN",
        "  ; The robot is not at home, and the way there is not checked.",
        "  ; Drive there by hand. Or start again only if the way is free: the robot drives there slowly.",
        "  HALT",
        "ENDIF",
    ]
