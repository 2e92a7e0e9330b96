"""ROS: trajectories as JSON, one for each move, in the fields of trajectory_msgs/JointTrajectory.

Between the points of a trajectory the acceleration is constant, so a controller that interpolates
with cubic splines drives exactly the trapezoid that was planned.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from datetime import date
from itertools import pairwise
from typing import Any

import numpy as np

from planner.motion.move_time import JointRates, profile
from planner.motion.program_record import FixturedTour, Move, RobotProgram
from planner.output.programs.driving import (
    NO_HOME_CHECK,
    CameraSignals,
    Picture,
    head_lines,
)


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
        "about": [*head_lines(program, made), NO_HOME_CHECK, *_driver_lines(program)],
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
                        _image(Picture(stop.setting_idx), signals),
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


def _image(picture: Picture, signals: CameraSignals) -> dict[str, Any]:
    return {
        "settle_s": signals.settle_s,
        "trigger": picture.label,
        "image": picture.image,
        "wait_for_camera_s": signals.timeout_s,
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
    found = profile(start, end, rates)
    turn = end - start
    points = []
    rows = list(zip(*found, strict=True))[1:]
    for k, (seconds, share, rate) in enumerate(rows):
        # the last one is exactly where the move ends
        place = end if k == len(rows) - 1 else start + share * turn
        points.append(_point(place, rate * turn, begun + seconds))
    return {"points": points, "end": float(found.seconds[-1])}


def _point(joints: np.ndarray, speeds: Sequence[float], seconds: float) -> dict[str, Any]:
    whole, nanoseconds = divmod(round(seconds * 1e9), 1_000_000_000)
    return {
        "positions": [float(value) for value in joints],
        "velocities": [float(value) for value in speeds],
        "time_from_start": {"sec": whole, "nanosec": nanoseconds},
    }
