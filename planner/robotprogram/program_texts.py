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
from dataclasses import dataclass
from datetime import date
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from aspectgraph.entities.entity_rules import NumberText, table_text
from planner.argument_kinds import (
    ABOVE_0_TO_1,
    NOT_NEGATIVE,
    NumberRule,
    check_count,
    check_kinds,
    check_number,
    shown,
)
from planner.exceptions import RequestError
from planner.files import write_text
from planner.robotcell.arm import ControllerAxes
from planner.robotcell.urdf import compose, invert
from planner.robotprogram.program import (
    LEAST_SPEED,
    TURNTABLE,
    FixturedTour,
    JointRates,
    LeadingAxis,
    Move,
    RobotProgram,
    leading_axis,
    move_times,
    profile,
)
from planner.sensor_setting import image_name

# What every program does, in no maker's language: moves, images, and what stands at its head.


LEAST_SPEEDS = {"krl": 0.01}
"""Least share of the speeds that a language can say, where that is more than `LEAST_SPEED`: KRL has whole percents."""

LEAST_RATE = 1e-4
"""Least speed, rad/s, and acceleration, rad/s², of a joint that a program states."""

# controllers count milliseconds; a pulse of RAPID lasts 2000 s at most
_LEAST_S = 0.001
_MOST_S = {"settle_s": 3600.0, "pulse_s": 2000.0, "timeout_s": 3600.0}

# how often controllers look at the camera's answer, s
_POLL_S = 0.012
_AT_HOME = "At home the pendant shows"
_STILL_READY = "The camera still says that an image is taken."
_SILENT = "The camera does not answer."

NO_HOME_CHECK = "This file does not check where the robot stands: whoever drives it must."

PoseNotation = Callable[[np.ndarray], str]
"""Writes a pose (4, 4) in the words of a controller."""

CAUTION = "Run at reduced speed first. Checked against the model of the cell only."


@dataclass(frozen=True)
class CameraSignals:
    """How a program asks for an image, and waits for it.

    Parameters
    ----------
    settle_s : float
        Wait after each stop, s: 0, or from 0.001 to 3600. Programs state milliseconds.
    trigger_output : int
        Number of the digital output that triggers the camera.
    ready_input : int
        Number of the digital input at which the camera says that the image is taken.
    pulse_s : float
        Length of the trigger, from 0.001 to 2000 s.
    timeout_s : float
        The program stops if the camera is silent for longer: from 0.001 to 3600 s.

    Raises
    ------
    RequestError
        If a number breaks its rule.

    Examples
    --------
    >>> from planner import CameraSignals
    >>> CameraSignals(settle_s=1.0, trigger_output=4).ready_input
    1
    """

    settle_s: float = 0.5
    trigger_output: int = 1
    ready_input: int = 1
    pulse_s: float = 0.1
    timeout_s: float = 10.0

    def __post_init__(self) -> None:
        for name, longest in _MOST_S.items():
            seconds = check_number(name, getattr(self, name), NOT_NEGATIVE)
            if seconds != 0.0 or name != "settle_s":
                check_number(name, seconds, _from_to(_LEAST_S, longest, name == "settle_s"))
        for name in ("trigger_output", "ready_input"):
            check_count(name, getattr(self, name), 0, 4096)

    @property
    def longest_s(self) -> float:
        """How long an answer is waited for from the start of the trigger, s: never less than the trigger lasts."""
        return max(self.timeout_s, self.pulse_s)

    def words(self) -> str:
        """Return what a driver does at each image, for programs that leave it to one.

        Returns
        -------
        str
            In sentences.
        """
        return (
            f"At each image: wait {time_text(self.settle_s)} s. Wait until input {self.ready_input} is low, then "
            f"raise output {self.trigger_output} for {time_text(self.pulse_s)} s. Wait until the input rises, for at "
            f"most {time_text(self.longest_s)} s. If it does not, stop."
        )


def _from_to(least: float, most: float, or_zero: bool) -> NumberRule:
    text = f"must be {'0, or ' if or_zero else ''}from {least:g} to {most:g} s"
    return NumberRule(text, lambda number: least <= number <= most)


def check_program_speed(speed: float, language: str) -> None:
    """Refuse a share of the speeds that a language cannot say.

    Parameters
    ----------
    speed : float
        The share.
    language : str
        Name of the format.

    Raises
    ------
    RequestError
        If it is too small.
    """
    check_number("speed", speed, ABOVE_0_TO_1)
    slowest = LEAST_SPEEDS.get(language, LEAST_SPEED)
    if speed < slowest:
        rule = f"must be at least {slowest:g} for {language}"
        raise RequestError.of_rule("speed", rule, f"{speed:g}")


def time_text(seconds: float) -> str:
    """Return seconds to a millisecond, without an exponent."""
    return f"{seconds:.3f}".rstrip("0").rstrip(".")


def rate_text(value: float, name: str) -> str:
    """Return a speed in rad/s or an acceleration in rad/s² without an exponent.

    Raises
    ------
    RequestError
        If it is less than a controller drives at.
    """
    if value < LEAST_RATE:
        rule = f"must be at least {LEAST_RATE:g} for the slowest joint"
        raise RequestError.of_rule(name, rule, shown(value))
    return f"{value:.6f}" if value >= 1.0 else f"{value:.9f}"


@dataclass(frozen=True)
class Drive:
    """A straight joint move.

    Attributes
    ----------
    joints : array (k,)
        Where it ends, rad.
    axes : array (k,)
        The same as the controller counts, rad.
    seconds : float
        Its time.
    lead : LeadingAxis
        Rates of the controller's axis that turns farthest.
    """

    joints: np.ndarray
    axes: np.ndarray
    seconds: float
    lead: LeadingAxis


@dataclass(frozen=True)
class ImageStep:
    """An image to be taken.

    Attributes
    ----------
    setting_idx : int
        Index of the setting in the plan, from 0.
    """

    setting_idx: int

    @property
    def image(self) -> str:
        """Name of the file, after the plan's setting."""
        return image_name(self.setting_idx)

    @property
    def label(self) -> str:
        """The name without its suffix."""
        return self.image.rpartition(".")[0]


def steps_of(tour: FixturedTour, program: RobotProgram) -> Iterator[Drive | ImageStep]:
    """Yield the moves and images of a round in their order; it begins and ends at home."""
    rates = program.rates_of(tour)
    for stop in tour.stops:
        yield from _drives(stop.move, rates, program.controller)
        yield ImageStep(stop.setting_idx)
    yield from _drives(tour.back, rates, program.controller)


def _drives(move: Move, rates: JointRates, controller: ControllerAxes) -> Iterator[Drive]:
    for start, end in pairwise(move.joints):
        # a move to where the robot stands is none
        if np.array_equal(start, end):
            continue
        joints = leading_axis(start, end, rates)
        axes = controller.of(end)
        # an axis that is coupled may turn farther than any joint, in the same time
        farther = np.abs(axes - controller.of(start)).max() / np.abs(end - start).max()
        lead = LeadingAxis(joints.speed * farther, joints.acceleration * farther)
        yield Drive(end, axes, float(move_times(start, end, rates)), lead)


def head_lines(program: RobotProgram, made: date, notation: PoseNotation) -> list[str]:
    """Return the lines at the head of a program, without the signs of a comment.

    Parameters
    ----------
    program : RobotProgram
        The program.
    made : date
        The day.
    notation : callable
        Writes a pose (4, 4) as the pendant of the controller shows it.
    """
    lines = [
        f"Inspection of {plain(program.part or 'a part', 80)} with {plain(program.robot, 40)}",
        f"Made by aspectgraph on {made.isoformat()}.",
        CAUTION,
        *(f"Digest of the {name}: {value}" for name, value in program.digests.items()),
        "Joints: " + ", ".join(plain(name, 40) for name in program.joint_names),
        f"Settings: {program.n_stops}; moves take {program.seconds:.1f} s at the program's speed, "
        f"which is {100 * program.speed:.3g} % of the joints' speeds",
        *(_turntable_lines(program)),
        *_axes_lines(program),
        *_home_lines(program),
        f"Every move keeps {program.keep_mm:g} mm to part and obstacles in the model.",
        *pendant_lines(program, notation),
        *(
            f"Setting {k + 1} has another pose than in the first plan: {plain(text, 120)}"
            for k, text in program.replaced.items()
        ),
        *(f"Not reached: setting {k + 1}: {plain(w, 120)}" for k, w in program.unreached.items()),
        *(f"Warning: {plain(text, 160)}" for text in program.warnings),
    ]
    return lines


def _axes_lines(program: RobotProgram) -> Iterator[str]:
    for text in program.controller.texts():
        yield f"{text[0].upper()}{text[1:]}."


def _home_lines(program: RobotProgram) -> list[str]:
    """Return what the operator must know of the start."""
    tolerance = program.start.tolerance_rad
    return [
        f"Start with each axis within {tolerance:g} rad ({np.degrees(tolerance):.2g} degrees) of home. "
        f"From there every way to home keeps {program.keep_mm:g} mm in the model.",
        "The way to home from elsewhere is not checked: the operator drives there by hand, or looks "
        "whether the way is free.",
    ]


def tolerance_deg(program: RobotProgram) -> str:
    """Return how far an axis may be from home, in degrees, rounded down."""
    return f"{np.floor(np.degrees(program.start.tolerance_rad) * 1e4) / 1e4:.4f}"


def _turntable_lines(program: RobotProgram) -> Iterator[str]:
    for tour in program.tours:
        if tour.turntable is not None:
            speed = np.degrees(float(tour.turntable.speeds[0]))
            name = plain(tour.fixturing, 40)
            yield (
                f"Fixturing {name} is on a turntable, which turns with the robot by at most "
                f"{speed:.1f} degrees per second. At 0 the part is put on it."
            )


def pendant_lines(program: RobotProgram, notation: PoseNotation) -> Iterator[str]:
    """Yield what the pendant shows at home and at the first setting if the robot is as its model."""
    frame = "base of the URDF" if program.pendant is None else "link 'base' of the URDF"
    shown_in = np.eye(4) if program.pendant is None else invert(program.pendant)
    yield f"Set no tool and no work object. Poses of the flange in the {frame}, to compare with the pendant:"
    if program.home_flange is not None:
        yield f"  home: {notation(compose(shown_in, program.home_flange))}"
    for tour in program.tours[:1]:
        stop = tour.stops[0]
        yield f"  setting {stop.setting_idx + 1}: {notation(compose(shown_in, stop.flange))}"
    yield "If they differ, then mastering, the base or the tool differ from the model: do not drive."


def home_words(program: RobotProgram, notation: PoseNotation) -> str:
    """Return what the pendant shows at home, for the message at the start of a round; empty if that is not known."""
    if program.home_flange is None:
        return ""
    shown_in = np.eye(4) if program.pendant is None else invert(program.pendant)
    return f"{_AT_HOME} {notation(compose(shown_in, program.home_flange))}."


def quaternion_words(pose: np.ndarray) -> str:
    """Return a pose (4, 4) as ABB's and ROS's displays do: mm, and a quaternion."""
    x, y, z = pose[:3, 3]
    qx, qy, qz, qw = Rotation.from_matrix(pose[:3, :3]).as_quat(canonical=True)
    return f"x {x:.2f}, y {y:.2f}, z {z:.2f} mm, quaternion w {qw:.5f}, x {qx:.5f}, y {qy:.5f}, z {qz:.5f}"


def rotation_vector_words(pose: np.ndarray) -> str:
    """Return a pose (4, 4) as the pendant of a Universal Robot does: mm, and a rotation vector in rad."""
    x, y, z = pose[:3, 3]
    rx, ry, rz = Rotation.from_matrix(pose[:3, :3]).as_rotvec()
    return f"X {x:.2f}, Y {y:.2f}, Z {z:.2f} mm, RX {rx:.4f}, RY {ry:.4f}, RZ {rz:.4f} rad"


def euler_words(pose: np.ndarray) -> str:
    """Return a pose (4, 4) as KUKA's pendant does: mm, and angles about z, the new y and the new x in degrees."""
    x, y, z = pose[:3, 3]
    a, b, c = Rotation.from_matrix(pose[:3, :3]).as_euler("ZYX", degrees=True)
    return f"X {x:.2f}, Y {y:.2f}, Z {z:.2f} mm, A {a:.3f}, B {b:.3f}, C {c:.3f} degrees"


def plain(text: str, most: int = 60) -> str:
    """Return a name as every controller reads it: no quotes, no line breaks, ASCII, not too long."""
    name = re.sub(r"[^A-Za-z0-9 _.,:;()+/%=-]", "_", text)
    return name if len(name) <= most else f"{name[: most - 3]}..."


def degrees(joints: np.ndarray) -> list[str]:
    """Return joints in degrees with six decimals, which is less than 0.02 µrad."""
    return [_number(value, 6) for value in np.degrees(joints)]


def radians(joints: np.ndarray) -> list[str]:
    """Return joints in rad with eight decimals."""
    return [_number(value, 8) for value in joints]


def _number(value: float, decimals: int) -> str:
    text = f"{value:.{decimals}f}"
    # no controller needs to read -0
    return text.removeprefix("-") if float(text) == 0.0 else text


def _check_six_axes(program: RobotProgram, language: str) -> None:
    """Raise if an arm has more joints than a language drives."""
    if len(program.joint_names) > SIX_AXES:
        rule = f"must be rapid, ros, csv or json for an arm of {len(program.joint_names)} joints"
        raise RequestError.of_rule("format", rule, repr(language))


# KRL for KUKA controllers: point-to-point moves by axis angles.


_SLOW_PERCENT = 1


_KRL_NAME = "inspection"
# of programs of KRL
_MOST_KRL_LETTERS = 24


def format_of_file(path: Path, format: str | None, parameter: str) -> str:
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
        If the suffix is unknown or that of another language, or KRL does not allow the file's name.
    """
    of_suffix = _BY_SUFFIX.get(path.suffix.lower())
    if format is None and of_suffix is None:
        rule = f"must end in {', '.join(_BY_SUFFIX)}, or the format must be given"
        raise RequestError.of_rule(parameter, rule, shown(str(path)))
    language = format or str(of_suffix)
    usual = Path(FORMATS.get(language, "")).suffix
    if of_suffix is not None and usual not in ("", path.suffix.lower()):
        rule = f"must end in {usual} for {language}: {path.suffix} is that of {of_suffix}"
        raise RequestError.of_rule(parameter, rule, shown(path.name))
    if language == "krl" and not re.fullmatch(
        rf"[A-Za-z_]\w{{0,{_MOST_KRL_LETTERS - 1}}}", path.stem, re.ASCII
    ):
        rule = (
            f"must be named by up to {_MOST_KRL_LETTERS} letters, digits and _, not beginning with a digit: "
            "a program in KRL has the name of its file"
        )
        raise RequestError.of_rule(parameter, rule, shown(path.name))
    return language


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

    Raises
    ------
    RequestError
        If the arm has seven joints, which KRL does not drive.
    """
    _check_six_axes(program, "krl")
    percent = max(1, math.floor(100 * program.speed + 1e-9))
    lines = [
        f"DEF {_KRL_NAME}( )",
        *(f"; {line}" for line in head_lines(program, made, euler_words)),
        "; Compare signs and zeros of the axes with the robot before you drive.",
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
        *_speeds(_SLOW_PERCENT, program.turns),
        f"PTP {_axes(home)}",
        *_speeds(percent, program.turns),
    ]
    for step in steps_of(tour, program):
        if isinstance(step, Drive):
            lines.append(f"PTP {_axes(step.axes)}")
        else:
            lines += [f"; {step.image}", "take_image( )"]
    return lines


def _krl_image(signals: CameraSignals) -> list[str]:
    """Return a subprogram that takes an image; times are in milliseconds."""
    camera = f"$IN[{signals.ready_input}]"
    trigger = f"$OUT[{signals.trigger_output}]"
    step = round(1000 * _POLL_S)
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
        f"      ; {_STILL_READY} Start again to try once more.",
        "      HALT",
        "      waited=0",
        "    ENDIF",
        f"    WAIT SEC {time_text(_POLL_S)}",
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
        f"    WAIT SEC {time_text(_POLL_S)}",
        f"    waited=waited+{step}",
        "  ENDWHILE",
        f"  {trigger}=FALSE",
        "  IF NOT is_taken THEN",
        f"    ; {_SILENT} Start again to try once more.",
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
SIX_AXES = 6
"""Axes of the robot in a target of RAPID; a seventh one and a turntable are external axes behind them."""
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
            seconds = max(step.seconds, _LEAST_S)
            body.append(f"    MoveAbsJ {name},v1000\\T:={seconds:.3f},fine,tool0;")
        else:
            body.append(f'    TakeImage "{step.image}";')


def _home_message(program: RobotProgram) -> str:
    """Return the further lines of a message: what the pendant shows at home, in pieces that fit on it."""
    words = home_words(program, quaternion_words)
    if not words:
        return ""
    place, turn = words.split(" mm, quaternion ")
    place = place.removeprefix(f"{_AT_HOME} ")
    return f'\\MsgLine2:="{_AT_HOME}"\\MsgLine3:="{place} mm,"\\MsgLine4:="{turn}"'


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
        f'        UIMsgBox\\Header:=name,"{_STILL_READY}"'
        "\\Buttons:=btnRetryCancel\\Icon:=iconError\\Result:=answer;",
        "      ELSEIF isLate THEN",
        f'        UIMsgBox\\Header:=name,"{_SILENT}"'
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
                        _image(ImageStep(stop.setting_idx), signals),
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

    Raises
    ------
    RequestError
        If the part lies on a turntable, which URScript does not drive together with the joints, or
        the arm has seven joints.
    """
    _check_six_axes(program, "urscript")
    if program.turns:
        rule = "must be rapid, krl, ros, csv or json for a part on a turntable"
        hint = "URScript drives no external axis together with the joints"
        raise RequestError.of_rule("format", rule, "'urscript'", hint=hint)
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
    step = time_text(_POLL_S)

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
        f"          {ask(_STILL_READY)}",
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
        f"        {ask(_SILENT)}",
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
            lines.append(f'  take_image("{step.image}")')
    return lines


# Writing a robot program in one of the formats.


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
    chosen = CameraSignals() if signals is None else signals
    return _WRITERS[format](program, chosen, date.today() if made is None else made)


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
        If neither format nor suffix is known, they disagree, or KRL does not allow the file's name.
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
    write_text(path, text)
    return path
