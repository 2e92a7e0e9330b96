"""KRL for KUKA controllers: point-to-point moves by axis angles."""

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
    percent = max(1, math.floor(100 * program.speed))
    lines = [
        "DEF inspection( )",
        *(f"; {line}" for line in head_lines(program, made)),
        "; Compare signs and zeros of the axes with the robot before you drive.",
        "; $VEL_AXIS is a share of this controller's speeds, so times differ from those above.",
        "INT i",
        "BAS(#INITMOV,0)",
        "FOR i=1 TO 6",
        f"  $VEL_AXIS[i]={percent}",
        f"  $ACC_AXIS[i]={percent}",
        "ENDFOR",
    ]
    if program.turns:
        lines += [
            "; E1 is the turntable, in degrees; 0 is where the part is put on it.",
            f"$VEL_EXTAX[1]={percent}",
            f"$ACC_EXTAX[1]={percent}",
        ]
    for tour in program.tours:
        lines += _round(tour, program, signals)
    return "\n".join([*lines, "END"]) + "\n"


def _axes(joints: np.ndarray) -> str:
    return f"{{{','.join(f'{axis} {value}' for axis, value in _named(joints))}}}"


def _named(joints: np.ndarray) -> list[tuple[str, str]]:
    """Return the axes with their angles in degrees; a turntable is E1."""
    names = [*(f"A{k}" for k in range(1, N_AXES + 1)), "E1"]
    return list(zip(names, degrees(joints), strict=False))


def _round(tour: FixturedTour, program: RobotProgram, signals: CameraSignals) -> list[str]:
    lines = [
        f"; Put the part in fixturing {plain(tour.fixturing, 40)}, then start again.",
        "HALT",
        *_home_check(program.home_of(tour)),
        # the first move is to where the robot stands, as the controller asks for it
        f"PTP {_axes(program.home_of(tour))}",
    ]
    for step in steps_of(tour, program.rates_of(tour)):
        if isinstance(step, Drive):
            lines.append(f"PTP {_axes(step.joints)}")
        else:
            lines += [
                f"; {step.image}",
                f"WAIT SEC {signals.settle_s:g}",
                f"$OUT[{signals.trigger_output}]=TRUE",
                f"WAIT SEC {signals.pulse_s:g}",
                f"$OUT[{signals.trigger_output}]=FALSE",
                f"WAIT FOR $IN[{signals.ready_input}]",
            ]
    return lines


def _home_check(home: np.ndarray) -> list[str]:
    """Return a loop that halts until the robot stands at home."""
    tolerance = math.degrees(HOME_TOLERANCE_RAD)
    far = " OR ".join(
        f"(ABS($AXIS_ACT.{axis}-({value}))>{tolerance:.3f})" for axis, value in _named(home)
    )
    return [
        f"WHILE {far}",
        "  ; The robot must stand at home: drive it there by hand, then start again.",
        "  HALT",
        "ENDWHILE",
    ]
