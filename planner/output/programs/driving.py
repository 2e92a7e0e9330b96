"""What every program does, in no maker's language: moves, images, and what stands at its head."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import date
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from planner.argument_kinds import NOT_NEGATIVE, check_count, check_number
from planner.motion.move_time import JointRates, LeadingAxis, leading_axis, move_times
from planner.motion.program_record import FixturedTour, Move, RobotProgram
from planner.setting.image_names import image_name

HOME_TOLERANCE_RAD = 0.01
"""A program starts only if each joint is within this much of home."""

N_AXES = 6
"""Joints of the robot; behind them may be the angle of a turntable."""

CAUTION = "Run at reduced speed first. Checked against the model of the cell only."


@dataclass(frozen=True)
class CameraSignals:
    """How a program asks for an image, and waits for it.

    Parameters
    ----------
    settle_s : float
        Wait after each stop, s.
    trigger_output : int
        Number of the digital output that triggers the camera.
    ready_input : int
        Number of the digital input at which the camera says that the image is taken.
    pulse_s : float
        Length of the trigger, s.
    timeout_s : float
        The program stops if the camera is silent for longer, s.

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
        for name in ("settle_s", "pulse_s", "timeout_s"):
            check_number(name, getattr(self, name), NOT_NEGATIVE)
        for name in ("trigger_output", "ready_input"):
            check_count(name, getattr(self, name), 0, 4096)


@dataclass(frozen=True)
class Drive:
    """A straight joint move.

    Attributes
    ----------
    joints : array (k,)
        Where it ends, rad.
    seconds : float
        Its time.
    lead : LeadingAxis
        Rates of the joint that turns farthest.
    """

    joints: np.ndarray
    seconds: float
    lead: LeadingAxis


@dataclass(frozen=True)
class Picture:
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


def steps_of(tour: FixturedTour, rates: JointRates) -> Iterator[Drive | Picture]:
    """Yield the moves and images of a round in their order; it begins and ends at home."""
    for stop in tour.stops:
        yield from _drives(stop.move, rates)
        yield Picture(stop.setting_idx)
    yield from _drives(tour.back, rates)


def _drives(move: Move, rates: JointRates) -> Iterator[Drive]:
    for start, end in pairwise(move.joints):
        # a move to where the robot stands is none
        if not np.array_equal(start, end):
            seconds = float(move_times(start, end, rates))
            yield Drive(end, seconds, leading_axis(start, end, rates))


def head_lines(program: RobotProgram, made: date) -> list[str]:
    """Return the lines at the head of a program, without the signs of a comment.

    Parameters
    ----------
    program : RobotProgram
        The program.
    made : date
        The day.
    """
    lines = [
        f"Inspection of {plain(program.part or 'a part', 80)} with {plain(program.robot, 40)}",
        f"Made by aspectgraph on {made.isoformat()}.",
        CAUTION,
        *(f"Digest of the {name}: {value}" for name, value in program.digests.items()),
        "Joints: " + ", ".join(plain(name, 40) for name in program.joint_names),
        f"Settings: {program.n_stops}; moves take {program.seconds:.1f} s at the program's speed, "
        f"which is {100 * program.speed:.0f} % of the joints' speeds",
        *(_turntable_lines(program)),
        f"Every move keeps {program.keep_mm:g} mm to part and obstacles in the model.",
        *(_flange_line(program)),
        *(
            f"Setting {k + 1} has another pose than in the first plan: {plain(text, 120)}"
            for k, text in program.replaced.items()
        ),
        *(f"Not reached: setting {k + 1}: {plain(w, 120)}" for k, w in program.unreached.items()),
        *(f"Warning: {plain(text, 160)}" for text in program.warnings),
    ]
    return lines


def _turntable_lines(program: RobotProgram) -> Iterator[str]:
    for tour in program.tours:
        if tour.turntable is not None:
            speed = np.degrees(float(tour.turntable.speeds[0]))
            name = plain(tour.fixturing, 40)
            yield (
                f"Fixturing {name} is on a turntable, which turns with the robot by at most "
                f"{speed:.1f} degrees per second. At 0 the part is put on it."
            )


def _flange_line(program: RobotProgram) -> Iterator[str]:
    for tour in program.tours[:1]:
        stop = tour.stops[0]
        x, y, z = stop.flange[:3, 3]
        qx, qy, qz, qw = Rotation.from_matrix(stop.flange[:3, :3]).as_quat(canonical=True)
        yield (
            f"Compare with the pendant: at setting {stop.setting_idx + 1} the flange is at "
            f"x {x:.2f}, y {y:.2f}, z {z:.2f} mm, "
            f"quaternion w {qw:.5f}, x {qx:.5f}, y {qy:.5f}, z {qz:.5f}"
        )


def plain(text: str, most: int = 60) -> str:
    """Return a name as every controller reads it: no quotes, no line breaks, ASCII, not too long."""
    found = re.sub(r"[^A-Za-z0-9 _.,:;()+/%=-]", "_", text)
    return found if len(found) <= most else f"{found[: most - 3]}..."


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
