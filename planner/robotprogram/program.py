"""A robot program as data: per fixturing the round, its moves and stops; no maker's language. And its file."""

from __future__ import annotations

import hashlib
import json
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from planner.argument_kinds import shown
from planner.exceptions import PlanFileError, RobotError
from planner.files import encoded, read_json
from planner.robotcell.arm import ControllerAxes
from planner.verify.simulate_plan import promises_too_much
from planner.verify.simulate_setting import SuccessRate

if TYPE_CHECKING:
    from planner.plan import InspectionPlan

# How long a straight joint move takes: all joints start, accelerate and stop together.
#
# A straight line from p to q is one number s from 0 to 1, with joints p + s (q - p). With speeds
# v and accelerations a of the joints, s may change at V = min v / abs(q - p) per second and A =
# min a / abs(q - p) per second squared. From rest to rest it takes 1 / V + V / A if the speed V
# is reached, 2 sqrt(1 / A) otherwise: a trapezoid or a triangle of speed.


class JointRates(NamedTuple):
    """How fast the joints may turn.

    Attributes
    ----------
    speeds : array (k,)
        Largest speed of each joint, rad/s.
    accelerations : array (k,)
        Largest acceleration of each joint, rad/s².
    """

    speeds: np.ndarray
    accelerations: np.ndarray

    def scaled(self, share: float) -> JointRates:
        """Return the rates with a share of the speeds; accelerations stay."""
        return JointRates(self.speeds * share, self.accelerations)


def move_times(starts: np.ndarray, ends: np.ndarray, rates: JointRates) -> np.ndarray:
    """Return how long straight joint moves take, from rest to rest.

    Parameters
    ----------
    starts, ends : array (..., k)
        Joints, rad; the shapes are broadcast.
    rates : JointRates
        Of the robot.

    Returns
    -------
    array (...)
        Seconds.
    """
    distances = np.abs(np.asarray(ends) - np.asarray(starts))
    # seconds at full speed, and seconds squared at full acceleration, of the joint that limits
    cruise = (distances / rates.speeds).max(axis=-1)
    square = (distances / rates.accelerations).max(axis=-1)
    # the speed is reached where 1 / V >= V / A
    reached = cruise * cruise >= square
    at_speed = cruise + np.divide(square, cruise, out=np.zeros_like(square), where=cruise > 0)
    return np.where(reached, at_speed, 2.0 * np.sqrt(square))


class LeadingAxis(NamedTuple):
    """Speed and acceleration of the joint that turns farthest in a move.

    Attributes
    ----------
    speed : float
        rad/s.
    acceleration : float
        rad/s².
    """

    speed: float
    acceleration: float


def leading_axis(start: np.ndarray, end: np.ndarray, rates: JointRates) -> LeadingAxis:
    """Return the rates that a controller must give the joint that turns farthest; the others follow.

    Parameters
    ----------
    start, end : array (k,)
        Joints, rad.
    rates : JointRates
        Of the robot.

    Returns
    -------
    LeadingAxis
        A move at these rates takes as long as `move_times` says.
    """
    distances = np.abs(np.asarray(end) - np.asarray(start))
    largest = float(distances.max())
    if largest == 0.0:
        return LeadingAxis(float(rates.speeds.min()), float(rates.accelerations.min()))
    cruise = float((distances / rates.speeds).max())
    square = float((distances / rates.accelerations).max())
    return LeadingAxis(largest / cruise, largest / square)


class Profile(NamedTuple):
    """A straight joint move in time: between its instants the acceleration is constant.

    Attributes
    ----------
    seconds : array (m,)
        Instants from 0; three for a triangle of speed, four for a trapezoid.
    shares : array (m,)
        Share of the way that is driven.
    rates : array (m,)
        How fast this share grows, 1/s; 0 at both ends.
    """

    seconds: np.ndarray
    shares: np.ndarray
    rates: np.ndarray


def profile(start: np.ndarray, end: np.ndarray, rates: JointRates) -> Profile:
    """Return how a straight joint move runs from rest to rest.

    Parameters
    ----------
    start, end : array (k,)
        Joints, rad; they differ.
    rates : JointRates
        Of the robot.

    Returns
    -------
    Profile
        It ends after the time that `move_times` says.
    """
    distances = np.abs(np.asarray(end) - np.asarray(start))
    cruise = float((distances / rates.speeds).max())
    square = float((distances / rates.accelerations).max())
    total = float(move_times(start, end, rates))
    if cruise * cruise < square:
        peak = 2.0 / total
        return Profile(
            np.array([0.0, total / 2, total]), np.array([0.0, 0.5, 1.0]), np.array([0.0, peak, 0.0])
        )
    rising = square / cruise
    driven = rising / cruise / 2
    return Profile(
        np.array([0.0, rising, total - rising, total]),
        np.array([0.0, driven, 1.0 - driven, 1.0]),
        np.array([0.0, 1.0 / cruise, 1.0 / cruise, 0.0]),
    )


FORMAT = "aspectgraph robot program"
VERSION = 2
LARGEST_TOLERANCE_RAD = 0.01
"""A program never starts if an axis is farther from home."""

LEAST_TOLERANCE_RAD = 1e-4
"""Less than this of an axis no operator and no controller can hold."""

LEAST_SPEED = 0.001
"""Least share of the joints' largest speeds that a program is made for."""

TURNTABLE = "turntable"
"""Name of the column of its angle."""
_UNITS = {"joints": "rad", "time": "s", "length": "mm", "flange": "tip to base"}


def plan_digest(plan: InspectionPlan) -> str:
    """Return the SHA-256 of what a plan's file says.

    Parameters
    ----------
    plan : InspectionPlan
        The plan.
    """
    text = json.dumps(encoded(plan.to_dict()), sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


@dataclass(frozen=True, eq=False)
class Move:
    """Straight joint moves from one stop to the next, each proven free.

    Attributes
    ----------
    joints : array (m, k)
        Joints from start to end, rad: two rows, or more if the move is a detour. On a turntable its
        angle is the last column.
    seconds : float
        Time of the whole move, with a stop at each row.
    """

    joints: np.ndarray
    seconds: float

    def __post_init__(self) -> None:
        joints = np.array(self.joints, dtype=np.float64)
        joints.setflags(write=False)
        object.__setattr__(self, "joints", joints)

    @property
    def is_detour(self) -> bool:
        """Whether the straight move is blocked, so that this one goes around."""
        return len(self.joints) > 2


@dataclass(frozen=True)
class ArmState:
    """What is known of the arm at a stop.

    Attributes
    ----------
    clearance_mm : float
        Distance of the closest two bodies.
    closest : (str, str)
        These bodies.
    to_limit_rad : float
        Least distance of a joint from its limits.
    singular_value : float
        Smallest singular value of the Jacobian, lengths divided by 500 mm. Near 0 the arm is
        singular.
    """

    clearance_mm: float
    closest: tuple[str, str]
    to_limit_rad: float
    singular_value: float

    def to_dict(self) -> dict[str, Any]:
        """Return the fields as plain values, ready for JSON."""
        return {
            "clearance_mm": self.clearance_mm,
            "closest": list(self.closest),
            "to_limit_rad": self.to_limit_rad,
            "singular_value": self.singular_value,
        }


@dataclass(frozen=True, eq=False)
class Stop:
    """A setting of the plan, and the move that leads to it.

    Attributes
    ----------
    setting_idx : int
        Index of the setting in the plan, from 0. Its image is named after it.
    move : Move
        The way there; the last row holds the joints of the stop.
    arm : ArmState
        Distances, limits and singularity there.
    flange : array (4, 4)
        Pose of the robot's tip in its base, mm, to compare with the controller.
    covariance : array (6, 6) or None
        Covariance of the camera's pose with this arm, as `PoseUncertainty` has it; None if the
        uncertainty of the arm was not given.
    probability : dict of str to float
        P of each target of the setting with this covariance; empty without.
    simulated : dict of str to SuccessRate
        The same by simulation; empty if it was not simulated.
    """

    setting_idx: int
    move: Move
    arm: ArmState
    flange: np.ndarray
    covariance: np.ndarray | None = None
    probability: Mapping[str, float] = field(default_factory=dict)
    simulated: Mapping[str, SuccessRate] = field(default_factory=dict)

    @property
    def joints(self) -> np.ndarray:
        """Joints (k,) of the stop, rad."""
        return self.move.joints[-1]

    def to_dict(self) -> dict[str, Any]:
        """Return the stop as plain values, ready for JSON; ``setting`` counts from 1."""
        fields: dict[str, Any] = {
            "setting": self.setting_idx + 1,
            "joints": self.joints.tolist(),
            "flange": self.flange.tolist(),
            "move": _move_dict(self.move),
            "arm": self.arm.to_dict(),
        }
        if self.covariance is not None:
            fields["covariance"] = self.covariance.tolist()
            fields["probability"] = dict(self.probability)
        if self.simulated:
            fields["simulated"] = {
                name: {
                    "successes": rate.successes,
                    "n": rate.n,
                    "frequency": rate.frequency,
                    "low": rate.low,
                    "high": rate.high,
                    "confidence": rate.confidence,
                    "outside": rate.outside,
                }
                for name, rate in self.simulated.items()
            }
        return fields


def _rates_dict(rates: JointRates) -> dict[str, Any]:
    return {"speeds": rates.speeds.tolist(), "accelerations": rates.accelerations.tolist()}


def _controller_dict(controller: ControllerAxes) -> dict[str, Any]:
    fields = {}
    if controller.coupled:
        fields["coupled"] = [list(row) for row in controller.coupled]
    if controller.limits:
        fields["axis_limits"] = [list(row) for row in controller.limits]
    return fields


def _move_dict(move: Move) -> dict[str, Any]:
    return {"seconds": move.seconds, "joints": move.joints.tolist()}


@dataclass(frozen=True, eq=False)
class FixturedTour:
    """The round through the settings of one fixturing, from home to home.

    Attributes
    ----------
    fixturing : str
        Name of the fixturing in the cell.
    stops : tuple of Stop
        In the order of the visits.
    back : Move
        From the last stop to home.
    turntable : JointRates or None
        Largest speed and acceleration (1,) of the turntable, where the part lies on one. Its angle
        is the last joint of all rows, and 0 at home.
    """

    fixturing: str
    stops: tuple[Stop, ...]
    back: Move
    turntable: JointRates | None = None

    @property
    def moves(self) -> tuple[Move, ...]:
        """All moves, the way back last."""
        return (*(stop.move for stop in self.stops), self.back)

    @property
    def seconds(self) -> float:
        """Time of all moves."""
        return sum(move.seconds for move in self.moves)

    def to_dict(self) -> dict[str, Any]:
        """Return the round as plain values, ready for JSON."""
        return {
            "fixturing": self.fixturing,
            "seconds": self.seconds,
            "stops": [stop.to_dict() for stop in self.stops],
            "back": _move_dict(self.back),
            **({} if self.turntable is None else {"turntable": _rates_dict(self.turntable)}),
        }


@dataclass(frozen=True)
class HomeStart:
    """How a program begins: the robot stands near home, or it is driven there at the operator's word.

    **Guarantee.** All joints whose axes are within ``tolerance_rad`` of home keep ``keep_mm`` of the
    program, and so does every way from them to home.

    Attributes
    ----------
    tolerance_rad : float
        How far each axis of the controller may be from home, rad.
    speed : float
        Largest speed of an axis on the way to home, rad/s.
    """

    tolerance_rad: float
    speed: float

    def to_dict(self) -> dict[str, Any]:
        """Return the fields as plain values, ready for JSON."""
        return {"tolerance_rad": self.tolerance_rad, "speed": self.speed}


@dataclass(frozen=True, eq=False, repr=False)
class RobotProgram:
    """What a robot drives to take the images of a plan.

    **Guarantee.** Every row of joints is within the limits. Every move between two rows is straight
    in joints. In the cell's model it keeps at least ``keep_mm`` to the part and obstacles, and links
    do not touch each other, proven and not only checked at steps. Each setting that is not in
    ``unreached`` is visited once.

    Attributes
    ----------
    part, robot : str
        Names of the part and of the robot.
    joint_names : tuple of str
        The joints, in the order of all rows.
    home : array (k,)
        Joints at which each round begins and ends, rad.
    tours : tuple of FixturedTour
        One round for each fixturing, in the order of the cell.
    rates : JointRates
        Speeds and accelerations of the joints, with ``speed`` applied.
    speed : float
        Share of the robot's largest joint speeds.
    keep_mm : float
        Distance that moves keep to part and obstacles, mm. Links of the arm only do not touch.
    unreached : mapping of int to str
        Index of each setting that is not visited, from 0, and the reason.
    coverage : tuple of int
        Number of settings that one fixturing reaches, that two reach, and so on.
    digests : mapping of str to str
        Digests of plan, part and cell.
    start : HomeStart
        How near home the robot must stand.
    controller : ControllerAxes
        The axes that the controller counts. All rows hold joints.
    warnings : tuple of str
        Points to look at before driving.
    replaced : mapping of int to str
        Index of each setting that another pose stands for, from 0, and how far that is away. Images
        must then be measured with ``plan``.
    plan : InspectionPlan or None
        With other poses, the plan that the program drives.

    Examples
    --------
    >>> from aspectgraph import read_solid
    >>> from planner import Cell, read_plan, robot_program
    >>> plan = read_plan("examples/two_pocket_block_plan.json")
    >>> block = read_solid("examples/two_pocket_block.off")
    >>> program = robot_program(plan, block, Cell.from_toml("examples/cell.toml"))
    >>> program.complete, len(program.tours[0].moves), program.coverage
    (True, 2, (1,))
    """

    part: str
    robot: str
    joint_names: tuple[str, ...]
    home: np.ndarray
    tours: tuple[FixturedTour, ...]
    rates: JointRates
    speed: float
    keep_mm: float
    unreached: Mapping[int, str]
    coverage: tuple[int, ...]
    digests: Mapping[str, str]
    start: HomeStart
    controller: ControllerAxes = field(default_factory=ControllerAxes)
    warnings: tuple[str, ...] = ()
    replaced: Mapping[int, str] = field(default_factory=dict)
    plan: InspectionPlan | None = None

    def __repr__(self) -> str:
        """Return a one-line summary."""
        names = ", ".join(tour.fixturing for tour in self.tours)
        missing = f", {len(self.unreached)} not reached" if self.unreached else ""
        return (
            f"<RobotProgram of {self.part!r} for {self.robot!r}: {self.n_stops} settings{missing}, "
            f"fixturings {names or 'none'}, moves {self.seconds:.1f} s>"
        )

    @property
    def n_stops(self) -> int:
        """Number of settings that are visited."""
        return sum(len(tour.stops) for tour in self.tours)

    @property
    def seconds(self) -> float:
        """Time of all moves; settling, images and the change of fixturings come on top."""
        return sum(tour.seconds for tour in self.tours)

    @property
    def turns(self) -> bool:
        """Whether a turntable turns in one of the rounds."""
        return any(tour.turntable is not None for tour in self.tours)

    def rates_of(self, tour: FixturedTour) -> JointRates:
        """Return the rates of all columns of a round's joints.

        Parameters
        ----------
        tour : FixturedTour
            One of the rounds.

        Returns
        -------
        JointRates
            With those of the turntable behind those of the joints.
        """
        if tour.turntable is None:
            return self.rates
        both = zip(self.rates, tour.turntable, strict=True)
        return JointRates(*(np.concatenate(pair) for pair in both))

    def home_of(self, tour: FixturedTour) -> np.ndarray:
        """Return the joints at which a round begins and ends.

        Parameters
        ----------
        tour : FixturedTour
            One of the rounds.

        Returns
        -------
        array (k,)
            With the angle 0 of the turntable behind the joints, rad.
        """
        return self.home if tour.turntable is None else np.append(self.home, 0.0)

    def names_of(self, tour: FixturedTour) -> tuple[str, ...]:
        """Return the names of all columns of a round's joints.

        Parameters
        ----------
        tour : FixturedTour
            One of the rounds.

        Returns
        -------
        tuple of str
            With ``turntable`` behind the joints where there is one.
        """
        return self.joint_names if tour.turntable is None else (*self.joint_names, TURNTABLE)

    @property
    def complete(self) -> bool:
        """Whether every setting of the plan is visited."""
        return not self.unreached

    def to_dict(self) -> dict[str, Any]:
        """Return the program as plain Python values, ready for JSON.

        Returns
        -------
        dict
            With format, version and units. Settings count from 1, as in the names of images.
        """
        return {
            "format": FORMAT,
            "version": VERSION,
            "units": dict(_UNITS),
            "part": self.part,
            "robot": self.robot,
            "digests": dict(self.digests),
            "joint_names": list(self.joint_names),
            "home": self.home.tolist(),
            "speed": self.speed,
            "rates": _rates_dict(self.rates),
            "keep_mm": self.keep_mm,
            "start": self.start.to_dict(),
            **_controller_dict(self.controller),
            "seconds": self.seconds,
            "coverage": list(self.coverage),
            "unreached": {str(k + 1): why for k, why in self.unreached.items()},
            **(
                {"replaced": {str(k + 1): text for k, text in self.replaced.items()}}
                if self.replaced
                else {}
            ),
            "warnings": list(self.warnings),
            "tours": [tour.to_dict() for tour in self.tours],
        }


# What a person should look at before driving a program.


NEAR_LIMIT_RAD = 0.05
"""A joint is near its limit if less than this is left, rad."""

NEAR_SINGULAR = 0.05
"""The arm is nearly singular if its smallest singular value is less, lengths divided by 500 mm."""


def program_warnings(tours: Sequence[FixturedTour], probability: float) -> tuple[str, ...]:
    """Return sentences on the stops of a program, in the order of the plan's settings.

    Parameters
    ----------
    tours : sequence of FixturedTour
        Its rounds.
    probability : float
        The probability that the plan requires.
    """
    stops = [stop for tour in tours for stop in tour.stops]
    stops.sort(key=lambda stop: stop.setting_idx)
    return tuple(
        f"setting {stop.setting_idx + 1}: {text}"
        for stop in stops
        for text in _warnings(stop, probability)
    )


def _warnings(stop: Stop, probability: float) -> Iterator[str]:
    low = [f"{name} {p:.3f}" for name, p in stop.probability.items() if p < probability]
    if low:
        yield f"P with this arm is below {probability:g} for {', '.join(low)}."
    broken = [
        f"{name} {rate.frequency:.3f}"
        for name, rate in stop.simulated.items()
        if promises_too_much(rate)
    ]
    if broken:
        yield f"a simulation with this arm finds less than P for {', '.join(broken)}."
    if stop.arm.to_limit_rad < NEAR_LIMIT_RAD:
        yield f"a joint is {np.degrees(stop.arm.to_limit_rad):.1f} degrees from its limit."
    if stop.arm.singular_value < NEAR_SINGULAR:
        yield "the arm is nearly singular."


# Reading a program file: everything that it says is checked, and what contradicts itself is refused.


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
        program = data.get("format") if isinstance(data, Mapping) else data
        raise _wrong("format", f"must be {FORMAT!r}", program)
    if data.get("version") != VERSION or isinstance(data.get("version"), bool):
        rule = f"must be {VERSION}"
        hint = "" if data.get("version") != 1 else "; make the program again from its plan"
        raise PlanFileError(f"version {rule}. Got {shown(data.get('version'))}{hint}.")
    for name, kind in _FIELDS.items():
        _of_kind(data.get(name), kind, name)
    names = [_of_kind(item, str, "joint_names") for item in data["joint_names"]]
    home = _numbers(data["home"], (len(names),), "home")
    rates = _rates(data["rates"], len(names), "rates")
    if not 0.0 < data["speed"] <= 1.0:
        raise _wrong("speed", "must be above 0 and at most 1", data["speed"])
    tours = tuple(_tour(item, home, rates, f"tours.{k}") for k, item in enumerate(data["tours"]))
    program = RobotProgram(
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
        warnings=tuple(_of_kind(item, str, "warnings") for item in data["warnings"]),
        replaced=_by_setting(data.get("replaced", {}), "replaced"),
    )
    _check_settings(program)
    _check_axes(program)
    _same_seconds(data["seconds"], program.seconds, "seconds")
    return program


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
    for k, item in enumerate(_of_kind(fields.get("stops"), list, f"{where}.stops")):
        stops.append(_stop(item, here, rates, f"{where}.stops.{k}"))
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
    shortest = float(move_times(joints[:-1], joints[1:], rates).sum())
    _same_seconds(fields.get("seconds"), shortest, f"{where}.seconds")
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
    rates = {}
    for name, rate in _of_kind(data, dict, where).items():
        at = f"{where}.{name}"
        fields = _of_kind(rate, dict, at)
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
        rates[name] = SuccessRate(*stated, probability[name])
    return rates


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
    start = HomeStart(
        *(_number(data.get(key), f"start.{key}") for key in ("tolerance_rad", "speed"))
    )
    if not 0.0 < start.tolerance_rad <= LARGEST_TOLERANCE_RAD:
        rule = f"must be above 0 and at most {LARGEST_TOLERANCE_RAD:g}"
        raise _wrong("start.tolerance_rad", rule, start.tolerance_rad)
    if start.speed <= 0.0:
        raise _wrong("start.speed", "must be positive", start.speed)
    return start


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
    texts = {}
    for key, text in _of_kind(data, dict, where).items():
        if not key.isdecimal() or int(key) < 1:
            raise _wrong(where, "must have numbers of settings from 1 as keys", key)
        texts[int(key) - 1] = _of_kind(text, str, f"{where}.{key}")
    return texts


def _rates(data: Any, count: int, where: str) -> JointRates:
    fields = _of_kind(data, dict, where)
    names = ("speeds", "accelerations")
    values = [_numbers(fields.get(name), (count,), f"{where}.{name}") for name in names]
    for name, rates in zip(names, values, strict=True):
        if not (rates > 0).all():
            raise _wrong(f"{where}.{name}", "must be positive", rates.tolist())
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
        numbers = np.array(value)
    except ValueError:
        raise _wrong(where, rule, value) from None
    if numbers.shape != shape or numbers.dtype.kind not in "fi" or not np.isfinite(numbers).all():
        raise _wrong(where, rule, value)
    return numbers.astype(np.float64)


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
