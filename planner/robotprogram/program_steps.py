"""What every robot program does, in no maker's language: moves, images, signals, and what stands at its head."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import date
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from planner.argument_kinds import (
    ABOVE_0_TO_1,
    NOT_NEGATIVE,
    NumberRule,
    check_count,
    check_number,
    shown,
)
from planner.exceptions import RequestError
from planner.robotcell.arm import ControllerAxes
from planner.robotcell.urdf import compose, invert
from planner.robotprogram.program import (
    LEAST_SPEED,
    FixturedTour,
    JointRates,
    LeadingAxis,
    Move,
    RobotProgram,
    Stop,
    StopImage,
    leading_axis,
    move_times,
)
from planner.sensor_setting import image_name

LEAST_SPEEDS = {"krl": 0.01}
"""Least share of the speeds that a language can say, where that is more than `LEAST_SPEED`: KRL has whole percents."""

LEAST_RATE = 1e-4
"""Least speed, rad/s, and acceleration, rad/s², of a joint that a program states."""

# controllers count milliseconds; a pulse of RAPID lasts 2000 s at most
LEAST_S = 0.001
_MOST_S = {"settle_s": 3600.0, "pulse_s": 2000.0, "timeout_s": 3600.0}
# of these languages. FANUC counts hundredths of seconds of waits in 16 bits, tenths of pulses in 8
_MOST_S_OF = {"fanuc": {"settle_s": 327.67, "pulse_s": 25.5, "timeout_s": 327.67}}
_SIGNALS_OF = {"urscript": (0, 7), "krl": (1, 4096), "fanuc": (1, 4096)}

# how often controllers look at the camera's answer, s
POLL_S = 0.012
AT_HOME = "At home the pendant shows"
STILL_READY = "The camera still says that an image is taken."
SILENT = "The camera does not answer."

SWITCH_LAMPS = (
    "Some settings take several images, each with other lamps: before each of these images, only the lamps "
    "named with it must be on. This program switches no lamps."
)
NO_HOME_CHECK = "This file does not check where the robot stands: whoever drives it must."

SIX_AXES = 6
"""Axes of a robot that most languages drive; of RAPID, a seventh one and a turntable are external axes behind them."""

PoseNotation = Callable[[np.ndarray], str]
"""Writes a pose (4, 4) in the words of a controller."""

ZEROS = "Compare signs and zeros of the axes with the robot before you drive."
SLOW_PERCENT = 1
"""Of the axes' speeds on the way to home, which is not proven, where a language has a share of them."""
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
                check_number(name, seconds, _from_to(LEAST_S, longest, name == "settle_s"))
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


def check_signals(signals: CameraSignals, language: str) -> None:
    """Refuse signals that a language does not have, and times that its controllers cannot wait.

    Parameters
    ----------
    signals : CameraSignals
        Trigger and answer of the camera.
    language : str
        Name of the format.

    Raises
    ------
    RequestError
        If a number or a time is beyond what the language has.
    """
    for name, longest in _MOST_S_OF.get(language, {}).items():
        seconds = getattr(signals, name)
        if seconds > longest:
            rule = f"must be at most {longest:g} s for {language}"
            raise RequestError.of_rule(name, rule, shown(seconds))
    if language in _SIGNALS_OF:
        first, last = _SIGNALS_OF[language]
        for name in ("trigger_output", "ready_input"):
            number = getattr(signals, name)
            if not first <= number <= last:
                rule = f"must be from {first} to {last} for {language}"
                raise RequestError.of_rule(name, rule, f"{number}")


def check_axes(language: str, n_joints: int, *, turns: bool) -> None:
    """Refuse axes that a language does not drive.

    Parameters
    ----------
    language : str
        Name of the format.
    n_joints : int
        Number of the arm's joints.
    turns : bool
        Whether the part lies on a turntable.

    Raises
    ------
    RequestError
        If the arm has seven joints, or a turntable is to turn with it, and the language has no axis for it.
    """
    if n_joints > SIX_AXES and language in ("urscript", "krl", "fanuc"):
        rule = f"must be rapid, ros, csv or json for an arm of {n_joints} joints"
        raise RequestError.of_rule("format", rule, repr(language))
    if turns and language == "urscript":
        rule = "must be rapid, krl, fanuc, ros, csv or json for a part on a turntable"
        hint = "URScript drives no external axis together with the joints"
        raise RequestError.of_rule("format", rule, repr(language), hint=hint)


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
class ImageStep(StopImage):
    """An image to be taken; its lamps are stated where the setting takes several images.

    Attributes
    ----------
    setting_idx : int
        Index of the setting in the plan, from 0.
    """

    setting_idx: int

    @property
    def label(self) -> str:
        """The name without its suffix."""
        return self.image.rpartition(".")[0]


def images_of(stop: Stop) -> tuple[ImageStep, ...]:
    """Return the images that are taken at a stop: one, or several with other lamps."""
    k = stop.setting_idx
    if not stop.images:
        return (ImageStep(image_name(k), (), k),)
    return tuple(ImageStep(image.image, image.lamps, k) for image in stop.images)


def has_lamps(program: RobotProgram) -> bool:
    """Return whether lamps must be switched between the images of a stop."""
    stops = (stop for tour in program.tours for stop in tour.stops)
    return any(image.lamps for stop in stops for image in stop.images)


def steps_of(tour: FixturedTour, program: RobotProgram) -> Iterator[Drive | ImageStep]:
    """Yield the moves and images of a round in their order; it begins and ends at home."""
    rates = program.rates_of(tour)
    for stop in tour.stops:
        yield from _drives(stop.move, rates, program.controller)
        yield from images_of(stop)
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
        *([SWITCH_LAMPS] if has_lamps(program) else []),
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
    yield f"Set no tool and no work object. Poses of the flange in the {frame}, to compare with the pendant:"
    if program.home_flange is not None:
        yield f"  home: {notation(_on_pendant(program, program.home_flange))}"
    for tour in program.tours[:1]:
        stop = tour.stops[0]
        yield f"  setting {stop.setting_idx + 1}: {notation(_on_pendant(program, stop.flange))}"
    yield "If they differ, then mastering, the base or the tool differ from the model: do not drive."


def home_words(program: RobotProgram, notation: PoseNotation) -> str:
    """Return what the pendant shows at home, for the message at the start of a round; empty if that is not known."""
    if program.home_flange is None:
        return ""
    return f"{AT_HOME} {notation(_on_pendant(program, program.home_flange))}."


def _on_pendant(program: RobotProgram, flange: np.ndarray) -> np.ndarray:
    """Return a pose (4, 4) of the flange in the base as the pendant shows it."""
    if program.pendant is None:
        return flange
    return compose(invert(program.pendant), flange)


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
