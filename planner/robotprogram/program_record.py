"""A robot program as data: per fixturing the round, its moves and stops; no maker's language."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.files import encoded
from planner.robotcell.arm import ControllerAxes
from planner.robotprogram.tour import JointRates
from planner.verify.simulate_plan import promises_too_much
from planner.verify.simulate_setting import SuccessRate

if TYPE_CHECKING:
    from planner.plan import InspectionPlan


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
        found: dict[str, Any] = {
            "setting": self.setting_idx + 1,
            "joints": self.joints.tolist(),
            "flange": self.flange.tolist(),
            "move": _move_dict(self.move),
            "arm": self.arm.to_dict(),
        }
        if self.covariance is not None:
            found["covariance"] = self.covariance.tolist()
            found["probability"] = dict(self.probability)
        if self.simulated:
            found["simulated"] = {
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
        return found


def _rates_dict(rates: JointRates) -> dict[str, Any]:
    return {"speeds": rates.speeds.tolist(), "accelerations": rates.accelerations.tolist()}


def _controller_dict(controller: ControllerAxes) -> dict[str, Any]:
    found = {}
    if controller.coupled:
        found["coupled"] = [list(row) for row in controller.coupled]
    if controller.limits:
        found["axis_limits"] = [list(row) for row in controller.limits]
    return found


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
