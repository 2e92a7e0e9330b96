"""A robot program as data: per fixturing the round, its moves and stops; no maker's language. And its file."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from errors.checks import probability_text
from ground.convert import (
    FROM_ONE,
    NOT_STORED,
    Key,
    Meta,
    Shape,
    field_name,
    from_plain,
    to_plain,
)
from ground.notebook import NotebookTable, NotebookView, ShownInNotebook, Toned
from ground.short_repr import count
from planner.argument_kinds import shown
from planner.exceptions import PlanFileError
from planner.files import read_json
from planner.robotcell.arm import ControllerAxes
from planner.sensor_setting import image_name
from planner.verify.simulate_plan import promises_too_much
from planner.verify.simulate_setting import SuccessRate

Vector = Annotated[NDArray[np.float64], Shape(None)]
Share = Annotated[float, Meta(ge=0, le=1, title="must be from 0 to 1")]
Count = Annotated[int, Meta(ge=0, title="must be an integer that is not negative")]

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

    speeds: Annotated[Vector, Meta(gt=0)]
    accelerations: Annotated[Vector, Meta(gt=0)]

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


FORMAT: Final = "aspectgraph robot program"
VERSION: Final = 2
LARGEST_TOLERANCE_RAD = 0.01
"""A program never starts if an axis is farther from home."""

LEAST_TOLERANCE_RAD = 1e-4
"""Less than this of an axis no operator and no controller can hold."""

LEAST_SPEED = 0.001
"""Least share of the joints' largest speeds that a program is made for."""

TURNTABLE = "turntable"
"""Name of the column of its angle."""
# what a notebook shows of a program
_SHOWN_STOPS = 12
_UNITS = {"joints": "rad", "time": "s", "length": "mm", "flange": "tip to base"}


@dataclass(frozen=True, eq=False)
class Move:
    """Straight joint moves from one stop to the next, each proven free.

    Attributes
    ----------
    seconds : float
        Time of the whole move, with a stop at each row.
    joints : array (m, k)
        Joints from start to end, rad: two rows, or more if the move is a detour. On a turntable its
        angle is the last column.
    """

    seconds: float
    joints: Annotated[NDArray[np.float64], Shape(None, None)]

    def __post_init__(self) -> None:
        if len(self.joints) < 2:
            raise PlanFileError.of_rule(
                "joints", "must hold two rows at least", str(len(self.joints))
            )
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
    closest: Annotated[tuple[str, str], Meta(title="must be two names")]
    to_limit_rad: float
    singular_value: float


@dataclass(frozen=True)
class StopRate:
    """How often a simulation with this arm measured a target accurately.

    Attributes
    ----------
    successes, n, outside : int
        Accurate measurements, displaced poses, and those with an end outside the image.
    frequency : float
        Share of accurate measurements.
    low, high, confidence : float
        Confidence interval of the probability of success, and its level.
    """

    successes: Count
    n: Annotated[int, Meta(ge=1)]
    frequency: float = field(init=False)
    low: Share
    high: Share
    confidence: Share
    outside: Count

    def __post_init__(self) -> None:
        if self.successes + self.outside > self.n:
            raise PlanFileError.of_rule("n", "must be all displaced poses", shown(self.n))
        object.__setattr__(self, "frequency", self.successes / self.n)
        if not self.low <= self.frequency <= self.high:
            raise PlanFileError.of_rule("low", "must be at most the frequency", shown(self.low))

    @classmethod
    def of(cls, rate: SuccessRate) -> StopRate:
        """Return what a program states of a simulation."""
        return cls(rate.successes, rate.n, rate.low, rate.high, rate.confidence, rate.outside)

    def of_promise(self, probability: float) -> SuccessRate:
        """Return the same, compared with a probability."""
        return SuccessRate(
            self.successes,
            self.n,
            self.low,
            self.high,
            self.confidence,
            self.outside,
            probability,
        )


@dataclass(frozen=True)
class StopImage:
    """One of several images that are taken at a stop, each with other lamps.

    Attributes
    ----------
    image : str
        Name of the file.
    lamps : tuple of int
        Numbers of the lamps that must be on, from 1 as in the plan's tables. None of a light with an area.
    """

    image: str
    lamps: tuple[Annotated[int, Meta(ge=1, title="must be an integer from 1")], ...]

    @property
    def remark(self) -> str:
        """The name, and which lamps must be on, such as "setting_01_2.png: lamp 2 on"."""
        if not self.lamps:
            return self.image
        numbers = ", ".join(map(str, self.lamps))
        return f"{self.image}: lamp{'s' * (len(self.lamps) > 1)} {numbers} on"


@dataclass(frozen=True, eq=False)
class Stop:
    """A setting of the plan, and the move that leads to it.

    Attributes
    ----------
    setting_idx : int
        Index of the setting in the plan, from 0. Its image is named after it.
    joints : array (k,)
        Joints of the stop, rad: where the move ends.
    flange : array (4, 4)
        Pose of the robot's tip in its base, mm, to compare with the controller.
    move : Move
        The way there.
    arm : ArmState
        Distances, limits and singularity there.
    covariance : array (6, 6) or None
        Covariance of the camera's pose with this arm, as `PoseUncertainty` has it; None if the
        uncertainty of the arm was not given.
    probability : dict of str to float
        P of each target of the setting with this covariance; empty without.
    simulated : dict of str to StopRate
        The same by simulation; empty if it was not simulated.
    images : tuple of StopImage
        Where the setting takes several images, each with other lamps; empty if it takes one.
    """

    setting_idx: Annotated[
        int, Key("setting"), FROM_ONE, Meta(ge=1, title="must be an integer from 1")
    ]
    joints: Vector = field(init=False)
    flange: Annotated[NDArray[np.float64], Shape(4, 4)]
    move: Move
    arm: ArmState
    covariance: Annotated[NDArray[np.float64] | None, Shape(6, 6)] = None
    probability: Mapping[str, Share] = field(default_factory=dict)
    simulated: Mapping[str, StopRate] = field(default_factory=dict)
    images: tuple[StopImage, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "joints", self.move.joints[-1])
        for i, image in enumerate(self.images):
            name = image_name(self.setting_idx, i)
            if image.image != name:
                place = field_name("images", i, "image")
                raise PlanFileError.of_rule(place, f"must be {name}", shown(image.image))
        for name in self.simulated:
            if name not in self.probability:
                rule = "must be of a name with a probability"
                raise PlanFileError.of_rule(field_name("simulated", name), rule, shown(name))


@dataclass(frozen=True, eq=False)
class FixturedTour:
    """The round through the settings of one fixturing, from home to home.

    Attributes
    ----------
    fixturing : str
        Name of the fixturing in the cell.
    seconds : float
        Time of all moves.
    stops : tuple of Stop
        In the order of the visits.
    back : Move
        From the last stop to home.
    turntable : JointRates or None
        Largest speed and acceleration (1,) of the turntable, where the part lies on one. Its angle
        is the last joint of all rows, and 0 at home.
    """

    fixturing: str
    seconds: float = field(init=False)
    stops: Annotated[tuple[Stop, ...], Meta(min_length=1, title="must hold a stop")]
    back: Move
    turntable: JointRates | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "seconds", sum(move.seconds for move in self.moves))

    @property
    def moves(self) -> tuple[Move, ...]:
        """All moves, the way back last."""
        return (*(stop.move for stop in self.stops), self.back)


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

    tolerance_rad: Annotated[
        float,
        Meta(
            gt=0,
            le=LARGEST_TOLERANCE_RAD,
            title=f"must be above 0 and at most {LARGEST_TOLERANCE_RAD:g}",
        ),
    ]
    speed: Annotated[float, Meta(gt=0, title="must be positive")]


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class RobotProgram(ShownInNotebook):
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
        Digests of plan, part and cell. That of the plan is the SHA-256 of its file.
    start : HomeStart
        How near home the robot must stand.
    home_flange : array (4, 4) or None
        Pose of the robot's tip at home in its base, mm.
    pendant : array (4, 4) or None
        Frame in which the pendant shows poses, in the base, mm; None if the URDF does not say.
    coupled, axis_limits : tuple of tuple
        What the controller counts otherwise, see `ControllerAxes`.
    seconds : float
        Time of all moves; settling, images and the change of fixturings come on top.
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

    format: Literal["aspectgraph robot program"] = field(init=False)
    version: Literal[2] = field(init=False)
    units: Mapping[str, str] = field(init=False)
    part: str
    robot: str
    digests: Mapping[str, str]
    joint_names: tuple[str, ...]
    home: Vector
    speed: Annotated[float, Meta(gt=0, le=1, title="must be above 0 and at most 1")]
    rates: JointRates
    keep_mm: float
    start: HomeStart
    home_flange: Annotated[NDArray[np.float64] | None, Shape(4, 4)] = None
    pendant: Annotated[NDArray[np.float64] | None, Shape(4, 4)] = None
    coupled: tuple[tuple[int, int, float], ...] = ()
    axis_limits: tuple[tuple[int, float, float], ...] = ()
    seconds: float = field(init=False)
    coverage: tuple[int, ...]
    unreached: Annotated[Mapping[int, str], FROM_ONE]
    replaced: Annotated[Mapping[int, str], FROM_ONE] = field(default_factory=dict)
    warnings: tuple[str, ...]
    tours: tuple[FixturedTour, ...]
    controller: Annotated[ControllerAxes, NOT_STORED] = field(init=False)
    plan: Annotated[Any, NOT_STORED] = None

    def __post_init__(self) -> None:
        derived = {
            "format": FORMAT,
            "version": VERSION,
            "units": dict(_UNITS),
            "seconds": sum(tour.seconds for tour in self.tours),
            "controller": ControllerAxes(self.coupled, self.axis_limits, len(self.joint_names)),
        }
        for name, value in derived.items():
            object.__setattr__(self, name, value)

    def __repr__(self) -> str:
        """Return a one-line summary."""
        names = ", ".join(tour.fixturing for tour in self.tours)
        fixturings = "fixturing" if len(self.tours) == 1 else "fixturings"
        missing = f", {len(self.unreached)} not reached" if self.unreached else ""
        return (
            f"<RobotProgram of {self.part!r} for {self.robot!r}: {count(self.n_stops, 'setting')}{missing}, "
            f"{fixturings} {names or 'none'}, moves {self.seconds:.1f} s>"
        )

    def _notebook_view(self) -> NotebookView:
        """Return a table of the stops in the order of the visits, and what to look at before driving."""
        stops = [(tour, stop) for tour in self.tours for stop in tour.stops]
        rows = [_stop_row(tour, stop) for tour, stop in stops[:_SHOWN_STOPS]]
        total = self.n_stops + len(self.unreached)
        verdict = f"The program visits {self.n_stops} of {count(total, 'setting')}."
        detours = sum(move.is_detour for tour in self.tours for move in tour.moves)
        around = f", {count(detours, 'move')} around something" if detours else ""
        drive = (
            f"{count(len(self.tours), 'round')} from home to home, moves {self.seconds:.1f} s at "
            f"{100 * self.speed:.3g} % of the joints' speeds{around}; all keep {self.keep_mm:g} mm."
        )
        more = len(stops) - len(rows)
        note = f"and {more} more: program.tours holds all." if more else ""
        states_p = any(stop.probability for _, stop in stops)
        headings = ["part lies", "setting", "joints (degrees)", "move (s)"]
        headings += ["smallest P"] * states_p
        items = {
            f"setting {stop.setting_idx + 1} takes": "; ".join(
                image.remark for image in stop.images
            )
            for _, stop in stops[:_SHOWN_STOPS]
            if stop.images
        }
        items |= {f"setting {k + 1} is not reached": why for k, why in self.unreached.items()}
        items |= {f"setting {k + 1} has another pose": text for k, text in self.replaced.items()}
        items |= {f"warning {n}": text for n, text in enumerate(self.warnings, start=1)}
        return NotebookView(
            f"Program of {self.part or 'a part'} for {self.robot}",
            (Toned(verdict, "good" if self.complete else "bad"), drive),
            NotebookTable(
                headings, [row[: len(headings)] for row in rows], right=(1, 4, 5), note=note
            ),
            items,
        )

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, RobotProgram):
            return NotImplemented
        # a file holds no plan, and the controller's axes follow from others
        return self.to_dict() == other.to_dict()

    __hash__ = None  # type: ignore[assignment]

    @property
    def n_stops(self) -> int:
        """Number of settings that are visited."""
        return sum(len(tour.stops) for tour in self.tours)

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
        return to_plain(self)


def _stop_row(tour: FixturedTour, stop: Stop) -> tuple[Any, ...]:
    """Return what a notebook shows of a stop; last the smallest P, empty if the arm's uncertainty is not given."""
    angles = ", ".join(f"{angle:.1f}" for angle in np.round(np.degrees(stop.joints), 1) + 0.0)
    smallest = min(stop.probability.values(), default=None)
    stated = "" if smallest is None else probability_text(smallest)
    return (tour.fixturing, stop.setting_idx + 1, angles, f"{stop.move.seconds:.1f}", stated)


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
        if promises_too_much(rate.of_promise(stop.probability[name]))
    ]
    if broken:
        yield f"a simulation with this arm finds less than P for {', '.join(broken)}."
    if stop.arm.to_limit_rad < NEAR_LIMIT_RAD:
        yield f"a joint is {np.degrees(stop.arm.to_limit_rad):.1f} degrees from its limit."
    if stop.arm.singular_value < NEAR_SINGULAR:
        yield "the arm is nearly singular."


# Reading a program file: everything that it says is checked, and what contradicts itself is refused.


_SAME = 1e-6


def read_program(path: str | os.PathLike[str]) -> RobotProgram:
    """Read ``program.json``, which `RobotProgram.to_dict` or the format "json" wrote.

    Parameters
    ----------
    path : str or os.PathLike
        The file.

    Returns
    -------
    RobotProgram
        Equal to the one written; ``plan``, which is not compared, is None.

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
    >>> again == program
    True
    """
    data = read_json(path, "program file")
    try:
        return program_of(data)
    except PlanFileError as error:
        raise PlanFileError(f"{os.fspath(path)}: {error}") from None


def program_of(data: Any) -> RobotProgram:
    """Return the program that plain values hold; see `read_program`.

    Raises
    ------
    PlanFileError
        If they contradict themselves; names the field.
    """
    program = from_plain(RobotProgram, data, PlanFileError)
    n_joints = len(program.joint_names)
    _check_length(program.home, n_joints, "home")
    _check_rates(program.rates, n_joints, "rates")
    for k, tour in enumerate(program.tours):
        _check_tour(program, tour, ("tours", k))
    _check_settings(program)
    return program


def _check_rates(rates: JointRates, count: int, *path: object) -> None:
    for name, values in rates._asdict().items():
        _check_length(values, count, *path, name)


def _check_length(values: np.ndarray, count: int, *path: object) -> None:
    if values.shape[-1] != count:
        raise _wrong(path, f"must have {count} numbers", values.shape[-1])


def _check_tour(program: RobotProgram, tour: FixturedTour, path: tuple[object, ...]) -> None:
    """Check that moves begin where the last one ended, take their time, and end at home within the axes."""
    if tour.turntable is not None:
        _check_rates(tour.turntable, 1, *path, "turntable")
    rates = program.rates_of(tour)
    home = program.home_of(tour)
    here = home
    for k, move in enumerate(tour.moves):
        inner = ("stops", k, "move") if k < len(tour.stops) else ("back",)
        place = (*path, *inner, "joints")
        _check_length(move.joints, len(home), *place)
        if not np.array_equal(move.joints[0], here):
            rule = "must begin where the last move ended"
            raise _wrong(place, rule, move.joints[0].tolist())
        seconds = float(move_times(move.joints[:-1], move.joints[1:], rates).sum())
        if abs(move.seconds - seconds) > _SAME:
            rule = f"must be the time of the moves, {seconds:.6f}"
            raise _wrong((*path, *inner, "seconds"), rule, move.seconds)
        if (program.controller.margin(move.joints) < -_SAME).any():
            got = f"{field_name(*path)} beyond one"
            raise _wrong(("axis_limits",), "must hold all joints of the moves", got)
        here = move.joints[-1]
    if not np.array_equal(here, home):
        raise _wrong((*path, "back", "joints"), "must end at home", here.tolist())


def _check_settings(program: RobotProgram) -> None:
    """Check that each setting is visited once, or is not reached."""
    visited = [stop.setting_idx for tour in program.tours for stop in tour.stops]
    for k in visited:
        if visited.count(k) > 1:
            raise _wrong(("tours",), "must visit each setting once", f"setting {k + 1} again")
        if k in program.unreached:
            raise _wrong(("unreached",), "must hold settings that are not visited", k + 1)


def _wrong(path: Sequence[object], rule: str, got: object) -> PlanFileError:
    return PlanFileError.of_rule(field_name(*path), rule, shown(got))
