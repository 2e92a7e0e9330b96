"""Robot programs in the languages of controllers.

**Guarantee.** All formats hold the same joints, in the same order. A pose target would leave the
branch to the controller, so there is none. A program of a controller stops at its start unless the
robot stands at home, because only moves from there are checked. Who lets it go on answers for the way
to home, which is driven slowly.
"""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Callable, Iterator, Sequence
from datetime import date
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np

from aspectgraph.entities.entity_rules import NumberText, table_text
from planner.argument_kinds import check_kinds, shown, suggests_names
from planner.exceptions import RequestError
from planner.files import write_text
from planner.robotprogram.fanuc_text import FANUC_NAME, MOST_FANUC_LETTERS, fanuc_text
from planner.robotprogram.program import (
    TURNTABLE,
    FixturedTour,
    JointRates,
    Move,
    RobotProgram,
    profile,
)
from planner.robotprogram.program_steps import (
    AT_HOME,
    LEAST_S,
    NO_HOME_CHECK,
    POLL_S,
    SILENT,
    SIX_AXES,
    SLOW_PERCENT,
    STILL_READY,
    ZEROS,
    CameraSignals,
    Drive,
    ImageStep,
    check_axes,
    check_program_speed,
    check_signals,
    degrees,
    euler_words,
    has_lamps,
    head_lines,
    home_words,
    images_of,
    plain,
    quaternion_words,
    radians,
    rate_text,
    rotation_vector_words,
    steps_of,
    time_text,
    tolerance_deg,
)

# KRL for KUKA controllers: point-to-point moves by axis angles.


_KRL_NAME = "inspection"


def krl_text(program: RobotProgram, signals: CameraSignals, made: date) -> str:
    """Return the program in KRL; joints in degrees, one speed for all moves.

    Parameters
    ----------
    program : RobotProgram
        The program.
    signals : CameraSignals
        Trigger and answer of the camera.
    made : date
        The day, for the head.
    """
    percent = max(1, math.floor(100 * program.speed + 1e-9))
    lines = [
        f"DEF {_KRL_NAME}( )",
        *(f"; {line}" for line in head_lines(program, made, euler_words)),
        f"; {ZEROS}",
        "; $VEL_AXIS is a share of this controller's speeds, so times differ from those above.",
        "INT i",
        "BAS(#INITMOV,0)",
    ]
    if program.turns:
        lines.append("; E1 is the turntable, in degrees; 0 is where the part is put on it.")
    for tour in program.tours:
        lines += _round(tour, program, percent)
    return "\n".join([*lines, "END", "", *_krl_image(signals)]) + "\n"


def _axes(joints: np.ndarray) -> str:
    return f"{{{','.join(f'{axis} {value}' for axis, value in _named(joints))}}}"


def _named(joints: np.ndarray) -> list[tuple[str, str]]:
    """Return the axes with their angles in degrees; a turntable is E1."""
    names = ["A1", "A2", "A3", "A4", "A5", "A6", "E1"]
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


def _round(tour: FixturedTour, program: RobotProgram, percent: int) -> list[str]:
    home = program.controller.of(program.home_of(tour))
    lines = [
        f"; Put the part in fixturing {plain(tour.fixturing, 40)}, then start again.",
        f"; {home_words(program, euler_words)}",
        "HALT",
        *_home_check(home, tolerance_deg(program)),
        *_speeds(SLOW_PERCENT, program.turns),
        f"PTP {_axes(home)}",
        *_speeds(percent, program.turns),
    ]
    for step in steps_of(tour, program):
        if isinstance(step, Drive):
            lines.append(f"PTP {_axes(step.axes)}")
        else:
            lines += [f"; {step.remark}", "take_image( )"]
    return lines


def _krl_image(signals: CameraSignals) -> list[str]:
    """Return a subprogram that takes an image; times are in milliseconds."""
    camera = f"$IN[{signals.ready_input}]"
    trigger = f"$OUT[{signals.trigger_output}]"
    step = round(1000 * POLL_S)
    pulse = round(1000 * signals.pulse_s)
    return [
        "DEF take_image( )",
        "INT waited",
        "BOOL is_taken",
        f"WAIT SEC {time_text(signals.settle_s)}",
        "is_taken=FALSE",
        "WHILE NOT is_taken",
        "  waited=0",
        f"  WHILE {camera}",
        f"    IF waited>{round(1000 * signals.timeout_s)} THEN",
        f"      ; {STILL_READY} Start again to try once more.",
        "      HALT",
        "      waited=0",
        "    ENDIF",
        f"    WAIT SEC {time_text(POLL_S)}",
        f"    waited=waited+{step}",
        "  ENDWHILE",
        f"  {trigger}=TRUE",
        "  waited=0",
        f"  WHILE (waited<={round(1000 * signals.longest_s)}) AND (NOT is_taken OR (waited<{pulse}))",
        f"    IF waited>={pulse} THEN",
        f"      {trigger}=FALSE",
        "    ENDIF",
        f"    IF {camera} THEN",
        "      is_taken=TRUE",
        "    ENDIF",
        f"    WAIT SEC {time_text(POLL_S)}",
        f"    waited=waited+{step}",
        "  ENDWHILE",
        f"  {trigger}=FALSE",
        "  IF NOT is_taken THEN",
        f"    ; {SILENT} Start again to try once more.",
        "    HALT",
        "  ENDIF",
        "ENDWHILE",
        "END",
    ]


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


# RAPID for ABB controllers: a module with one joint target for each move.


_NO_AXIS = "9E9"
_N_EXTERNAL = 6
# of a YuMi, joint 3 is eax_a: its axis 7 is between axes 2 and 3
_SEVENTH = 2


def from_rapid_order(axes: np.ndarray) -> np.ndarray:
    """Return joints (k,) of an arm of seven from the base to the tip, of RAPID's axes with the external ones behind."""
    seventh = axes[SIX_AXES : SIX_AXES + 1]
    return np.concatenate([axes[:_SEVENTH], seventh, axes[_SEVENTH:SIX_AXES], axes[SIX_AXES + 1 :]])


def _in_rapid_order(joints: np.ndarray, n_joints: int) -> np.ndarray:
    """Return RAPID's axes 1 to 6, and behind them the external ones, of joints from the base to the tip."""
    if n_joints == SIX_AXES:
        return joints
    others = [joints[:_SEVENTH], joints[_SEVENTH + 1 : n_joints]]
    return np.concatenate([*others, joints[_SEVENTH : _SEVENTH + 1], joints[n_joints:]])


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
    n_joints = len(program.joint_names)
    targets = [
        f"  CONST jointtarget jHome:={_target(program.controller.of(home), n_joints)};",
        # of the tool in mm/s and degrees/s; the other numbers are of external axes
        "  CONST speeddata vHome:=[100,5,100,5];",
    ]
    body: list[str] = []
    for tour in program.tours:
        _add_round(tour, program, targets, body)
    lines = [
        "MODULE Inspection",
        *(f"  ! {line}" for line in head_lines(program, made, quaternion_words)),
        f"  ! doCamera is digital output {signals.trigger_output}, diCamera is digital input {signals.ready_input}.",
        "  ! Replace tool0 by a tool with the mass of the camera.",
        *(f"  ! {line}" for line in _external_lines(program)),
        *targets,
        "  PROC main()",
        *body,
        "  ENDPROC",
        *_go_home(program),
        *_take_image(signals),
        "ENDMODULE",
    ]
    return "\n".join(lines) + "\n"


def _external_names(program: RobotProgram) -> list[str]:
    """Return the external axes: the seventh of an arm, then the turntable."""
    count = len(program.joint_names) - SIX_AXES + program.turns
    return [f"eax_{letter}" for letter in "ab"[:count]]


def _external_lines(program: RobotProgram) -> Iterator[str]:
    """Yield what the external axes are."""
    names = _external_names(program)
    if len(program.joint_names) > SIX_AXES:
        third = plain(program.joint_names[_SEVENTH], 40)
        yield f"{names[0]} is axis 7 of the arm, between its axes 2 and 3: joint {third}."
    if program.turns:
        yield f"{names[-1]} is the turntable; at 0 the part is put on it."


def _target(joints: np.ndarray, n_joints: int) -> str:
    """Return a target; a seventh axis of the arm is the first external one, the angle of a turntable the next."""
    angles = degrees(_in_rapid_order(joints, n_joints))
    external = [*angles[SIX_AXES:], *[_NO_AXIS] * _N_EXTERNAL][:_N_EXTERNAL]
    return f"[[{','.join(angles[:SIX_AXES])}],[{','.join(external)}]]"


def _add_round(
    tour: FixturedTour, program: RobotProgram, targets: list[str], body: list[str]
) -> None:
    """Add the targets and the statements of a round."""
    body.append(
        f'    UIMsgBox "Part in fixturing {plain(tour.fixturing, 40)}?"{_home_message(program)};'
    )
    body.append("    GoHome;")
    for step in steps_of(tour, program):
        if isinstance(step, Drive):
            name = f"j{len(targets) - 1:04d}"
            target = _target(step.axes, len(program.joint_names))
            targets.append(f"  CONST jointtarget {name}:={target};")
            # the controller drives in no time of 0
            seconds = max(step.seconds, LEAST_S)
            body.append(f"    MoveAbsJ {name},v1000\\T:={seconds:.3f},fine,tool0;")
        else:
            # a comment of RAPID has its own line
            body += [f"    ! {step.remark}"] * bool(step.lamps)
            body.append(f'    TakeImage "{step.image}";')


def _home_message(program: RobotProgram) -> str:
    """Return the further lines of a message: what the pendant shows at home, in pieces that fit on it."""
    words = home_words(program, quaternion_words)
    if not words:
        return ""
    place, turn = words.split(" mm, quaternion ")
    place = place.removeprefix(f"{AT_HOME} ")
    return f'\\MsgLine2:="{AT_HOME}"\\MsgLine3:="{place} mm,"\\MsgLine4:="{turn}"'


def _go_home(program: RobotProgram) -> list[str]:
    """Return how the robot is driven to home: from near it, or where the operator lets it."""
    tolerance = tolerance_deg(program)
    far = [f"Abs(now.robax.rax_{k}-jHome.robax.rax_{k})>{tolerance}" for k in range(1, 7)]
    far += [
        f"Abs(now.extax.{name}-jHome.extax.{name})>{tolerance}" for name in _external_names(program)
    ]
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
    """Return how an image is taken; the pulse runs while the answer is waited for."""
    timeout = time_text(signals.timeout_s)
    return [
        "  PROC TakeImage(string name)",
        "    VAR bool isLate:=TRUE;",
        "    VAR bool wasReady:=FALSE;",
        "    VAR btnres answer;",
        f"    WaitTime\\InPos,{time_text(signals.settle_s)};",
        "    TPWrite name;",
        "    WHILE isLate DO",
        f"      WaitDI diCamera,0\\MaxTime:={timeout}\\TimeFlag:=wasReady;",
        "      IF NOT wasReady THEN",
        f"        PulseDO\\PLength:={time_text(signals.pulse_s)},doCamera;",
        f"        WaitDI diCamera,1\\MaxTime:={time_text(signals.longest_s)}\\TimeFlag:=isLate;",
        "      ENDIF",
        "      IF wasReady THEN",
        f'        UIMsgBox\\Header:=name,"{STILL_READY}"'
        "\\Buttons:=btnRetryCancel\\Icon:=iconError\\Result:=answer;",
        "      ELSEIF isLate THEN",
        f'        UIMsgBox\\Header:=name,"{SILENT}"'
        "\\Buttons:=btnRetryCancel\\Icon:=iconError\\Result:=answer;",
        "      ENDIF",
        "      IF isLate AND answer=resCancel THEN",
        "        EXIT;",
        "      ENDIF",
        "    ENDWHILE",
        "  ENDPROC",
    ]


# ROS: trajectories as JSON, one for each move, in the fields of trajectory_msgs/JointTrajectory.
#
# Between the points of a trajectory the acceleration is constant, so a controller that
# interpolates with cubic splines drives exactly the trapezoid that was planned.


def ros_text(program: RobotProgram, signals: CameraSignals, made: date) -> str:
    """Return the program as JSON for ROS; joints in rad.

    Parameters
    ----------
    program : RobotProgram
        The program.
    signals : CameraSignals
        The settling time stands before each image.
    made : date
        The day, for the head.
    """
    data = {
        "about": [
            *head_lines(program, made, quaternion_words),
            NO_HOME_CHECK,
            signals.words(),
            *_driver_lines(program),
        ],
        "joint_names": list(program.joint_names),
        "start_at": _start_at(program.home, program),
        "rounds": [
            {
                "fixturing": tour.fixturing,
                **_start_of(tour, program),
                "steps": [
                    step
                    for stop in tour.stops
                    for step in (
                        _trajectory(stop.move, tour, program),
                        *(_image(picture, signals) for picture in images_of(stop)),
                    )
                ]
                + [_trajectory(tour.back, tour, program)],
            }
            for tour in program.tours
        ],
    }
    return json.dumps(data, indent=1) + "\n"


def _start_of(tour: FixturedTour, program: RobotProgram) -> dict[str, Any]:
    """Return where a round with a turntable starts: there is one joint more than above."""
    if tour.turntable is None:
        return {}
    return {
        "joint_names": list(program.names_of(tour)),
        "start_at": _start_at(program.home_of(tour), program),
    }


def _start_at(home: np.ndarray, program: RobotProgram) -> dict[str, Any]:
    """Return home, how near it the robot must stand, and how fast it may be driven there."""
    start = program.start
    return {
        "positions": home.tolist(),
        "tolerance": start.tolerance_rad,
        "speed_to_home": start.speed,
    }


def _driver_lines(program: RobotProgram) -> list[str]:
    """Return whose task coupled axes are."""
    if not program.controller.coupled:
        return []
    return ["All positions are joints of the URDF: the driver of the robot must couple its axes."]


def _image(picture: ImageStep, signals: CameraSignals) -> dict[str, Any]:
    return {
        "settle_s": signals.settle_s,
        "ready_must_be_low_within_s": signals.timeout_s,
        "trigger": picture.label,
        "trigger_s": signals.pulse_s,
        "image": picture.image,
        **({"lamps": list(picture.lamps)} if picture.lamps else {}),
        "wait_for_camera_s": signals.longest_s,
    }


def _trajectory(move: Move, tour: FixturedTour, program: RobotProgram) -> dict[str, Any]:
    points = [_point(move.joints[0], np.zeros_like(move.joints[0]), 0.0)]
    begun = 0.0
    for start, end in pairwise(move.joints):
        if np.array_equal(start, end):
            continue
        piece = _points(start, end, begun, program.rates_of(tour))
        begun += piece.pop("end")
        points += piece["points"]
    return {"joint_trajectory": {"joint_names": list(program.names_of(tour)), "points": points}}


def _points(start: np.ndarray, end: np.ndarray, begun: float, rates: JointRates) -> dict[str, Any]:
    course = profile(start, end, rates)
    turn = end - start
    points = []
    rows = list(zip(*course, strict=True))[1:]
    for k, (seconds, share, rate) in enumerate(rows):
        # the last one is exactly where the move ends
        place = end if k == len(rows) - 1 else start + share * turn
        points.append(_point(place, rate * turn, begun + seconds))
    return {"points": points, "end": float(course.seconds[-1])}


def _point(joints: np.ndarray, speeds: Sequence[float], seconds: float) -> dict[str, Any]:
    whole, nanoseconds = divmod(round(seconds * 1e9), 1_000_000_000)
    return {
        "positions": [float(value) for value in joints],
        "velocities": [float(value) for value in speeds],
        "time_from_start": {"sec": whole, "nanosec": nanoseconds},
    }


# A table of the moves and images, for spreadsheets and programs of your own.


_FIRST = ("fixturing", "step", "seconds", "setting", "image")
# where a setting takes several images: numbers of the lamps that must be on
_LAMPS = "lamps"


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
    lamps = [_LAMPS] if has_lamps(program) else []
    heading = [*_FIRST, *lamps, *columns, *(f"axis_{axis}_of_controller_rad" for axis in coupled)]
    table: list[list[str]] = []
    blank = [""] * len(lamps)
    for tour in program.tours:
        name = plain(tour.fixturing, 40)
        home = _angles(program.home_of(tour), program, coupled, len(names))
        table.append(_row(name, "start", 0.0, [*blank, *home]))
        for step in steps_of(tour, program):
            if isinstance(step, Drive):
                angles = _angles(step.joints, program, coupled, len(names))
                table.append(_row(name, "move", step.seconds, [*blank, *angles]))
            else:
                # the image is taken where the last move ended; a further one there has its own row
                if table[-1][1] == "image":
                    table.append([*table[-1][:2], NumberText("0.000"), *table[-1][3:]])
                first = [str(step.setting_idx + 1), step.image, " ".join(map(str, step.lamps))]
                table[-1][1] = "image"
                table[-1][3 : 5 + len(lamps)] = first[: 2 + len(lamps)]
    head = [
        *head_lines(program, made, quaternion_words),
        NO_HOME_CHECK,
        signals.words(),
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


# URScript for Universal Robots: a function that is sent to the controller as a whole.


def urscript_text(program: RobotProgram, signals: CameraSignals, made: date) -> str:
    """Return the program in URScript; joints in rad, rates of the leading joint in rad/s and rad/s².

    Parameters
    ----------
    program : RobotProgram
        The program.
    signals : CameraSignals
        Trigger and answer of the camera.
    made : date
        The day, for the head.
    """
    lines = [
        *(f"# {line}" for line in head_lines(program, made, rotation_vector_words)),
        "# Send it as a whole to port 30002, or load it as a script file and call inspection().",
        "def inspection():",
        f"  home = {_joints(program.controller.of(program.home))}",
        *_home_function(program),
        *_functions(signals),
    ]
    for tour in program.tours:
        lines += _round_of_urscript(tour, program)
    return "\n".join([*lines, "end"]) + "\n"


def _joints(joints: np.ndarray) -> str:
    return f"[{', '.join(radians(joints))}]"


def _home_function(program: RobotProgram) -> list[str]:
    """Return a function that drives to home: from near it, or where the operator lets it."""
    words = "The robot is not at home. The way there is not checked. Continue only if it is free."
    speed = rate_text(program.start.speed, "speed")
    acceleration = rate_text(float(program.rates.accelerations.min()), "accelerations")
    return [
        "  def go_home(joints):",
        "    actual = get_actual_joint_positions()",
        "    is_far = False",
        "    i = 0",
        "    while i < 6:",
        f"      if norm(actual[i] - joints[i]) > {program.start.tolerance_rad:g}:",
        "        is_far = True",
        "      end",
        "      i = i + 1",
        "    end",
        "    if is_far:",
        f'      popup("{words}", title="inspection", warning=True, blocking=True)',
        "    end",
        f"    movej(joints, a={acceleration}, v={speed})",
        "  end",
    ]


def _functions(signals: CameraSignals) -> list[str]:
    """Return the local function that takes an image."""
    camera = f"get_standard_digital_in({signals.ready_input})"
    trigger = f"set_standard_digital_out({signals.trigger_output}"
    pulse = time_text(signals.pulse_s)
    step = time_text(POLL_S)

    def ask(words: str) -> str:
        return f'popup("{words} Continue: try once more.", title="inspection", error=True, blocking=True)'

    return [
        "  def take_image(name):",
        f"    sleep({time_text(signals.settle_s)})",
        "    textmsg(name)",
        "    is_taken = False",
        "    while not is_taken:",
        "      waited = 0",
        f"      while {camera}:",
        f"        if waited > {time_text(signals.timeout_s)}:",
        f"          {ask(STILL_READY)}",
        "          waited = 0",
        "        end",
        f"        sleep({step})",
        f"        waited = waited + {step}",
        "      end",
        f"      {trigger}, True)",
        "      waited = 0",
        f"      while waited <= {time_text(signals.longest_s)} and (not is_taken or waited < {pulse}):",
        f"        if waited >= {pulse}:",
        f"          {trigger}, False)",
        "        end",
        f"        if {camera}:",
        "          is_taken = True",
        "        end",
        f"        sleep({step})",
        f"        waited = waited + {step}",
        "      end",
        f"      {trigger}, False)",
        "      if not is_taken:",
        f"        {ask(SILENT)}",
        "      end",
        "    end",
        "  end",
    ]


def _round_of_urscript(tour: FixturedTour, program: RobotProgram) -> list[str]:
    name = plain(tour.fixturing, 40)
    home = f" {home_words(program, rotation_vector_words)}".rstrip()
    lines = [
        f"  # fixturing {name}",
        f'  popup("Part in fixturing {name}?{home}", title="inspection", blocking=True)',
        "  go_home(home)",
    ]
    for step in steps_of(tour, program):
        if isinstance(step, Drive):
            acceleration = rate_text(step.lead.acceleration, "accelerations")
            speed = rate_text(step.lead.speed, "speed")
            lines.append(f"  movej({_joints(step.axes)}, a={acceleration}, v={speed})")
        else:
            lines += [f"  # {step.remark}"] * bool(step.lamps)
            lines.append(f'  take_image("{step.image}")')
    return lines


# Writing a robot program in one of the formats.


_Writer = Callable[[RobotProgram, CameraSignals, date], str]


def _json_text(program: RobotProgram, signals: CameraSignals, made: date) -> str:
    return json.dumps(program.to_dict(), indent=1, allow_nan=False) + "\n"


Format = Literal["urscript", "rapid", "krl", "fanuc", "ros", "csv", "json"]
_WRITERS: dict[Format, _Writer] = {
    "urscript": urscript_text,
    "rapid": rapid_text,
    "krl": krl_text,
    "fanuc": fanuc_text,
    "ros": ros_text,
    "csv": csv_text,
    "json": _json_text,
}
FORMATS: dict[Format, str] = {
    "urscript": "inspection.script",
    "rapid": "inspection.mod",
    "krl": "inspection.src",
    "fanuc": "inspection.ls",
    "ros": "inspection_ros.json",
    "csv": "inspection.csv",
    "json": "program.json",
}
"""The formats, and the usual name of a file in each."""

_BY_SUFFIX: dict[str, Format] = {
    ".script": "urscript",
    ".mod": "rapid",
    ".src": "krl",
    ".ls": "fanuc",
    ".csv": "csv",
    ".json": "json",
}


# languages whose programs have the name of their file, and its longest
_NAMED_AS_FILES = {"krl": 24, "fanuc": MOST_FANUC_LETTERS}


def format_of_file(path: Path, format: Format | None, parameter: str) -> Format:
    """Return the language of a program by its file, or check that both agree.

    Parameters
    ----------
    path : Path
        The file.
    format : str or None
        As for `program_text`; None takes that of the suffix.
    parameter : str
        What the caller knows the file as.

    Raises
    ------
    RequestError
        If the suffix is unknown or that of another language, or the language does not allow the file's name.
    """
    of_suffix = _BY_SUFFIX.get(path.suffix.lower())
    language = format or of_suffix
    if language is None:
        rule = f"must end in {', '.join(_BY_SUFFIX)}, or the format must be given"
        raise RequestError.of_rule(parameter, rule, shown(str(path)))
    usual = Path(FORMATS.get(language, "")).suffix
    if of_suffix is not None and usual not in ("", path.suffix.lower()):
        rule = f"must end in {usual} for {language}: {path.suffix} is that of {of_suffix}"
        raise RequestError.of_rule(parameter, rule, shown(path.name))
    letters = _NAMED_AS_FILES.get(language)
    if letters and not re.fullmatch(rf"[A-Za-z_]\w{{0,{letters - 1}}}", path.stem, re.ASCII):
        rule = (
            f"must be named by up to {letters} letters, digits and _, not beginning with a digit: "
            f"a program in {language} has the name of its file"
        )
        raise RequestError.of_rule(parameter, rule, shown(path.name))
    return language


@suggests_names
def program_text(
    program: RobotProgram,
    format: Format,
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
        "urscript", "rapid", "krl", "fanuc", "ros" (trajectories as JSON), "csv" or "json" (all data).
    signals : CameraSignals, optional
        Trigger and answer of the camera. Default: output 1, input 1.
    made : datetime.date, optional
        The day at the head of the program. Default: today.

    Returns
    -------
    str
        Joints in rad, except "rapid", "krl" and "fanuc", which are in degrees.

    Raises
    ------
    RequestError
        If the format is unknown, an argument has the wrong type, or the language cannot say the
        program's speed, a signal or a wait, or does not drive an axis.

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
    check_axes(format, len(program.joint_names), turns=program.turns)
    chosen = CameraSignals() if signals is None else signals
    check_signals(chosen, format)
    return _WRITERS[format](program, chosen, date.today() if made is None else made)


@suggests_names
def write_program(
    program: RobotProgram,
    path: str | os.PathLike[str],
    *,
    format: Format | None = None,
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
        As for `program_text`. Default: by the suffix .script, .mod, .src, .ls, .csv or .json.
    signals : CameraSignals, optional
        Trigger and answer of the camera.

    Returns
    -------
    pathlib.Path
        The file.

    Raises
    ------
    RequestError
        If neither format nor suffix is known, they disagree, or the language does not allow the file's name.
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
    language = format_of_file(path, format, "path")
    text = program_text(program, language, signals=signals)
    if language == "krl":
        text = text.replace(f"DEF {_KRL_NAME}( )", f"DEF {path.stem}( )", 1)
    if language == "fanuc":
        text = text.replace(f"/PROG  {FANUC_NAME}", f"/PROG  {path.stem.upper()}", 1)
    write_text(path, text)
    return path
