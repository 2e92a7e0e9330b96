"""Reading a program file: everything that it says is checked, and what contradicts itself is refused."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from planner.argument_kinds import shown
from planner.exceptions import PlanFileError, RobotError
from planner.files import read_json
from planner.robotcell.arm import ControllerAxes
from planner.robotprogram.program_record import (
    FORMAT,
    LARGEST_TOLERANCE_RAD,
    VERSION,
    ArmState,
    FixturedTour,
    HomeStart,
    Move,
    RobotProgram,
    Stop,
)
from planner.robotprogram.tour import JointRates, move_times
from planner.verify.simulate_setting import SuccessRate

_SAME = 1e-6
_FIELDS = {
    "part": str,
    "robot": str,
    "digests": dict,
    "joint_names": list,
    "home": list,
    "speed": float,
    "rates": dict,
    "keep_mm": float,
    "start": dict,
    "seconds": float,
    "coverage": list,
    "unreached": dict,
    "warnings": list,
    "tours": list,
}


def read_program(path: str | os.PathLike[str]) -> RobotProgram:
    """Read ``program.json``, which `RobotProgram.to_dict` or the format "json" wrote.

    Parameters
    ----------
    path : str or os.PathLike
        The file.

    Returns
    -------
    RobotProgram
        Equal to the one written, without its ``plan``.

    Raises
    ------
    PlanFileError
        If the file cannot be read, or contradicts itself; names the field.

    Examples
    --------
    >>> import tempfile
    >>> from aspectgraph import read_solid
    >>> from planner import Cell, read_plan, read_program, robot_program, write_program
    >>> plan = read_plan("examples/two_pocket_block_plan.json")
    >>> block = read_solid("examples/two_pocket_block.off")
    >>> program = robot_program(plan, block, Cell.from_toml("examples/cell.toml"))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     again = read_program(write_program(program, folder + "/program.json"))
    >>> again.to_dict() == program.to_dict()
    True
    """
    data = read_json(path, "program file")
    try:
        return program_of(data)
    except PlanFileError as error:
        raise PlanFileError(f"{Path(path)}: {error}") from None


def program_of(data: Any) -> RobotProgram:
    """Return the program that plain values hold; see `read_program`.

    Raises
    ------
    PlanFileError
        If they contradict themselves; names the field.
    """
    if not isinstance(data, Mapping) or data.get("format") != FORMAT:
        found = data.get("format") if isinstance(data, Mapping) else data
        raise _wrong("format", f"must be {FORMAT!r}", found)
    if data.get("version") != VERSION or isinstance(data.get("version"), bool):
        rule = f"must be {VERSION}"
        hint = "" if data.get("version") != 1 else "; make the program again from its plan"
        raise PlanFileError(f"version {rule}. Got {shown(data.get('version'))}{hint}.")
    for name, kind in _FIELDS.items():
        _of_kind(data.get(name), kind, name)
    names = [_of_kind(one, str, "joint_names") for one in data["joint_names"]]
    home = _numbers(data["home"], (len(names),), "home")
    rates = _rates(data["rates"], len(names), "rates")
    if not 0.0 < data["speed"] <= 1.0:
        raise _wrong("speed", "must be above 0 and at most 1", data["speed"])
    tours = tuple(_tour(one, home, rates, f"tours.{k}") for k, one in enumerate(data["tours"]))
    found = RobotProgram(
        part=data["part"],
        robot=data["robot"],
        joint_names=tuple(names),
        home=home,
        tours=tours,
        rates=rates,
        speed=float(data["speed"]),
        keep_mm=float(data["keep_mm"]),
        unreached=_by_setting(data["unreached"], "unreached"),
        coverage=tuple(data["coverage"]),
        digests=dict(data["digests"]),
        start=_start(data["start"]),
        controller=_controller(data),
        warnings=tuple(_of_kind(one, str, "warnings") for one in data["warnings"]),
        replaced=_by_setting(data.get("replaced", {}), "replaced"),
    )
    _check_settings(found)
    _check_axes(found)
    _same_seconds(data["seconds"], found.seconds, "seconds")
    return found


def _tour(data: Any, home: np.ndarray, rates: JointRates, where: str) -> FixturedTour:
    fields = _of_kind(data, dict, where)
    fixturing = _of_kind(fields.get("fixturing"), str, f"{where}.fixturing")
    table = None
    if "turntable" in fields:
        table = _rates(fields["turntable"], 1, f"{where}.turntable")
        home = np.append(home, 0.0)
        rates = JointRates(*(np.concatenate(pair) for pair in zip(rates, table, strict=True)))
    stops = []
    here = home
    for k, one in enumerate(_of_kind(fields.get("stops"), list, f"{where}.stops")):
        stops.append(_stop(one, here, rates, f"{where}.stops.{k}"))
        here = stops[-1].joints
    if not stops:
        raise _wrong(f"{where}.stops", "must hold a stop", stops)
    back = _move(fields.get("back"), here, rates, f"{where}.back")
    if not np.array_equal(back.joints[-1], home):
        raise _wrong(f"{where}.back.joints", "must end at home", back.joints[-1].tolist())
    tour = FixturedTour(fixturing, tuple(stops), back, table)
    _same_seconds(fields.get("seconds"), tour.seconds, f"{where}.seconds")
    return tour


def _stop(data: Any, here: np.ndarray, rates: JointRates, where: str) -> Stop:
    fields = _of_kind(data, dict, where)
    setting = fields.get("setting")
    if not isinstance(setting, int) or isinstance(setting, bool) or setting < 1:
        raise _wrong(f"{where}.setting", "must be an integer from 1", setting)
    move = _move(fields.get("move"), here, rates, f"{where}.move")
    joints = _numbers(fields.get("joints"), here.shape, f"{where}.joints")
    if not np.array_equal(joints, move.joints[-1]):
        raise _wrong(f"{where}.joints", "must be those at which its move ends", joints.tolist())
    covariance = None
    if "covariance" in fields:
        covariance = _numbers(fields["covariance"], (6, 6), f"{where}.covariance")
    probability = _of_kind(fields.get("probability", {}), dict, f"{where}.probability")
    for name, value in probability.items():
        if not 0.0 <= _number(value, f"{where}.probability.{name}") <= 1.0:
            raise _wrong(f"{where}.probability.{name}", "must be from 0 to 1", value)
    return Stop(
        setting - 1,
        move,
        _state(fields.get("arm"), f"{where}.arm"),
        _numbers(fields.get("flange"), (4, 4), f"{where}.flange"),
        covariance,
        dict(probability),
        _simulated(fields.get("simulated", {}), probability, f"{where}.simulated"),
    )


def _move(data: Any, here: np.ndarray, rates: JointRates, where: str) -> Move:
    """Return a move that begins where the last one ended, and takes the time that its rates allow."""
    fields = _of_kind(data, dict, where)
    rows = _of_kind(fields.get("joints"), list, f"{where}.joints")
    joints = _numbers(rows, (len(rows), len(here)), f"{where}.joints")
    if len(joints) < 2:
        raise _wrong(f"{where}.joints", "must hold two rows at least", rows)
    if not np.array_equal(joints[0], here):
        rule = "must begin where the last move ended"
        raise _wrong(f"{where}.joints", rule, joints[0].tolist())
    least = float(move_times(joints[:-1], joints[1:], rates).sum())
    _same_seconds(fields.get("seconds"), least, f"{where}.seconds")
    return Move(joints, float(fields["seconds"]))


def _state(data: Any, where: str) -> ArmState:
    fields = _of_kind(data, dict, where)
    names = ("clearance_mm", "to_limit_rad", "singular_value")
    mm, limit, singular = (_number(fields.get(name), f"{where}.{name}") for name in names)
    closest = _of_kind(fields.get("closest"), list, f"{where}.closest")
    if len(closest) != 2 or not all(isinstance(one, str) for one in closest):
        raise _wrong(f"{where}.closest", "must be two names", closest)
    return ArmState(mm, (closest[0], closest[1]), limit, singular)


def _simulated(data: Any, probability: Mapping[str, float], where: str) -> dict[str, SuccessRate]:
    """Return what a simulation found: how often of how many poses, and the interval that was stated."""
    found = {}
    for name, one in _of_kind(data, dict, where).items():
        at = f"{where}.{name}"
        fields = _of_kind(one, dict, at)
        n, successes, outside = (
            _count(fields.get(key), f"{at}.{key}") for key in ("n", "successes", "outside")
        )
        low, high, confidence = (
            _number(fields.get(key), f"{at}.{key}") for key in ("low", "high", "confidence")
        )
        if not 0 < n >= successes + outside:
            raise _wrong(f"{at}.n", "must be all displaced poses", n)
        if not 0.0 <= low <= successes / n <= high <= 1.0:
            raise _wrong(f"{at}.low", "must be at most the frequency", low)
        if name not in probability:
            raise _wrong(at, "must be of a name with a probability", name)
        stated = (successes, n, low, high, confidence, outside)
        found[name] = SuccessRate(*stated, probability[name])
    return found


def _check_settings(found: RobotProgram) -> None:
    """Check that each setting is visited once, or is not reached."""
    visited = [stop.setting_idx for tour in found.tours for stop in tour.stops]
    for k in visited:
        if visited.count(k) > 1:
            raise _wrong("tours", "must visit each setting once", f"setting {k + 1} again")
        if k in found.unreached:
            raise _wrong("unreached", "must hold settings that are not visited", k + 1)


def _start(data: Mapping[str, Any]) -> HomeStart:
    """Return how the program begins."""
    found = HomeStart(
        *(_number(data.get(key), f"start.{key}") for key in ("tolerance_rad", "speed"))
    )
    if not 0.0 < found.tolerance_rad <= LARGEST_TOLERANCE_RAD:
        rule = f"must be above 0 and at most {LARGEST_TOLERANCE_RAD:g}"
        raise _wrong("start.tolerance_rad", rule, found.tolerance_rad)
    if found.speed <= 0.0:
        raise _wrong("start.speed", "must be positive", found.speed)
    return found


def _controller(data: Mapping[str, Any]) -> ControllerAxes:
    """Return the axes of the controller."""
    try:
        return ControllerAxes(data.get("coupled", ()), data.get("axis_limits", ()))
    except RobotError as error:
        raise _wrong_axes(error) from None


def _wrong_axes(error: RobotError) -> PlanFileError:
    return PlanFileError(f"{error.parameter} {error.rule}. Got {error.got}.")


def _check_axes(found: RobotProgram) -> None:
    """Check that all joints are within the limits of the controller's axes."""
    for k, tour in enumerate(found.tours):
        for move in tour.moves:
            if (found.controller.margin(move.joints) < -_SAME).any():
                got = f"tours.{k} beyond one"
                raise _wrong("axis_limits", "must hold all joints of the moves", got)


def _by_setting(data: Any, where: str) -> dict[int, str]:
    found = {}
    for key, text in _of_kind(data, dict, where).items():
        if not key.isdecimal() or int(key) < 1:
            raise _wrong(where, "must have numbers of settings from 1 as keys", key)
        found[int(key) - 1] = _of_kind(text, str, f"{where}.{key}")
    return found


def _rates(data: Any, count: int, where: str) -> JointRates:
    fields = _of_kind(data, dict, where)
    names = ("speeds", "accelerations")
    values = [_numbers(fields.get(name), (count,), f"{where}.{name}") for name in names]
    for name, one in zip(names, values, strict=True):
        if not (one > 0).all():
            raise _wrong(f"{where}.{name}", "must be positive", one.tolist())
    return JointRates(*values)


def _same_seconds(given: Any, computed: float, where: str) -> None:
    if abs(_number(given, where) - computed) > _SAME:
        raise _wrong(where, f"must be the time of the moves, {computed:.6f}", given)


def _numbers(value: Any, shape: tuple[int, ...], where: str) -> np.ndarray:
    """Return finite numbers of a shape."""
    rule = f"must hold finite numbers of the shape {shape}"
    if not isinstance(value, Sequence) or isinstance(value, str):
        raise _wrong(where, rule, value)
    try:
        found = np.array(value)
    except ValueError:
        raise _wrong(where, rule, value) from None
    if found.shape != shape or found.dtype.kind not in "fi" or not np.isfinite(found).all():
        raise _wrong(where, rule, value)
    return found.astype(np.float64)


def _number(value: Any, where: str) -> float:
    if not isinstance(value, int | float) or isinstance(value, bool) or not math.isfinite(value):
        raise _wrong(where, "must be a finite number", value)
    return float(value)


def _count(value: Any, where: str) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or value < 0:
        raise _wrong(where, "must be an integer that is not negative", value)
    return value


def _of_kind(value: Any, kind: type, where: str) -> Any:
    if kind is float:
        return _number(value, where)
    if not isinstance(value, kind):
        words = {"str": "a text", "dict": "an object", "list": "a list"}
        raise _wrong(where, f"must be {words[kind.__name__]}", value)
    return value


def _wrong(where: str, rule: str, got: Any) -> PlanFileError:
    return PlanFileError(f"{where} {rule}. Got {shown(got)}.")
