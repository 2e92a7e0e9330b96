"""From a plan to a robot program: fixturings, rounds of proven moves, uncertainty at each stop."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from planner.argument_kinds import ABOVE_0_TO_1, NumberRule, check_count, check_kinds, check_number
from planner.exceptions import InfeasibleError, RequestError
from planner.progress import Progress, report
from planner.robotcell.held_part_cell import HeldPartCell
from planner.robotcell.reachability import reachability_of
from planner.robotprogram.moves import Detours, TourChecker, straight_costs
from planner.robotprogram.other_poses import program_with_other_poses
from planner.robotprogram.pose_knowledge import (
    ArmUncertainty,
    shortfalls,
    simulated_rates,
    stated_probabilities,
)
from planner.robotprogram.program_record import (
    LARGEST_TOLERANCE_RAD,
    LEAST_SPEED,
    LEAST_TOLERANCE_RAD,
    ArmState,
    FixturedTour,
    HomeStart,
    Move,
    RobotProgram,
    Stop,
    plan_digest,
    program_warnings,
)
from planner.robotprogram.tour import (
    EXACT_UP_TO,
    JointRates,
    few_branches,
    quick_length,
    shortest_tour,
)

if TYPE_CHECKING:
    from aspectgraph import Solid
    from planner.plan import InspectionPlan
    from planner.robotcell import Cell, Reachability


# Which fixturings a plan needs: as many settings as can be reached, then few fixturings, then
# time.


class FixturingChoice(NamedTuple):
    """Fixturings for the settings of a plan.

    Attributes
    ----------
    of_setting : tuple of int
        Fixturing of each setting; -1 if none reaches it.
    coverage : tuple of int
        Number of settings that the best single fixturing reaches, the best two, and so on.
    """

    of_setting: tuple[int, ...]
    coverage: tuple[int, ...]


def choose_fixturings(
    reached: np.ndarray, seconds: Callable[[int, tuple[int, ...]], float]
) -> FixturingChoice:
    """Choose the fewest fixturings that reach all settings which any fixturing reaches.

    **Guarantee.** No smaller set of fixturings reaches as many settings. Among the sets of this
    size, the time is the least that moving single settings between fixturings finds.

    Parameters
    ----------
    reached : array of bool (n, f)
        Whether a fixturing reaches a setting.
    seconds : callable
        ``seconds(fixturing, settings)`` returns the time of a round through settings.

    Returns
    -------
    FixturingChoice
        The first one, in the order of the fixturings, where several are as good.
    """
    n, f = reached.shape
    most = int(reached.any(axis=1).sum())
    coverage = []
    sets: list[tuple[int, ...]] = [()]
    for size in range(1, f + 1):
        sized = list(combinations(range(f), size))
        counts = [int(reached[:, chosen].any(axis=1).sum()) for chosen in sized]
        coverage.append(max(counts))
        if coverage[-1] == most:
            sets = [c for c, count in zip(sized, counts, strict=True) if count == most]
            break
    if most == 0:
        return FixturingChoice((-1,) * n, tuple(coverage[:1]))
    found = [_assigned(reached, chosen, seconds) for chosen in sets]
    _, of_setting = min(found, key=lambda one: one[0])
    return FixturingChoice(of_setting, tuple(coverage))


def _assigned(
    reached: np.ndarray,
    chosen: tuple[int, ...],
    seconds: Callable[[int, tuple[int, ...]], float],
) -> tuple[float, tuple[int, ...]]:
    """Give each setting one of the chosen fixturings; move settings while that saves time."""
    n = len(reached)
    usable = [[f for f in chosen if reached[k, f]] for k in range(n)]
    best = tuple(options[0] if options else -1 for options in usable)
    times: dict[tuple[int, tuple[int, ...]], float] = {}

    def total(of_setting: tuple[int, ...]) -> float:
        rounds = []
        for f in chosen:
            key = (f, tuple(k for k in range(n) if of_setting[k] == f))
            if key not in times:
                times[key] = seconds(*key) if key[1] else 0.0
            rounds.append(times[key])
        return sum(rounds)

    least = total(best)
    while True:
        shorter = [(total(other), other) for other in _moved(best, usable)]
        if not shorter or min(shorter)[0] >= least - 1e-9:
            return least, best
        least, best = min(shorter)


def _moved(of_setting: tuple[int, ...], usable: list[list[int]]) -> Iterator[tuple[int, ...]]:
    """Yield the assignments that differ in one setting."""
    for k, options in enumerate(usable):
        for f in options:
            if f != of_setting[k]:
                yield (*of_setting[:k], f, *of_setting[k + 1 :])


# moves keep this share of the distances that poses keep: near a pose at the limit, none could start
_KEPT_SHARE = 0.5
_SPEED = NumberRule(f"must be from {LEAST_SPEED:g} to 1", lambda speed: LEAST_SPEED <= speed <= 1)
# of an axis that stands at its limit, rad
_ROUNDED = 1e-9
# no point of the arm or the camera is faster on the way to home: the reduced speed of ISO 10218-1
_REDUCED_MM_S = 250.0
# by how much of its time a round may be longer to have branches with a better P
_LONGER = 0.05


@dataclass(frozen=True)
class FixturedArm:
    """The arm in one fixturing of a cell, as moves are checked in it.

    Attributes
    ----------
    cell : Cell
        With the part.
    fixturing : str
        One of its fixturings.
    """

    cell: Cell
    fixturing: str

    @property
    def lower(self) -> np.ndarray:
        """Least joints (k,), rad."""
        return self.cell.limits(self.fixturing)[0]

    @property
    def upper(self) -> np.ndarray:
        """Largest joints (k,), rad."""
        return self.cell.limits(self.fixturing)[1]

    def free_shares(self, joints: np.ndarray, turn: np.ndarray, reach: np.ndarray) -> np.ndarray:
        """Return which share of a turn (k,) is free to both sides of joints (n, k): at most reach (n,)."""
        shares = self.cell.free_shares(joints, turn, reach, _KEPT_SHARE, fixturing=self.fixturing)
        return np.minimum(shares, self._within_axes(joints, turn))

    def _within_axes(self, joints: np.ndarray, turn: np.ndarray) -> np.ndarray:
        """Return which share of a turn keeps the controller's axes (n,) within their limits, to both sides."""
        controller = self.cell.robot.controller
        n = len(controller.lower)
        axes = controller.of(joints[:, :n])
        speeds = np.abs(controller.of(turn[:n]))
        left = np.minimum(axes - controller.lower, controller.upper - axes) + _ROUNDED
        with np.errstate(divide="ignore"):
            shares = np.where(left < 0, -1.0, left / speeds)
        return np.asarray(shares.min(axis=1))


def robot_program(
    plan: InspectionPlan,
    solid: Solid,
    cell: Cell,
    *,
    speed: float = 1.0,
    uncertainty: ArmUncertainty | None = None,
    simulate: int = 10_000,
    seed: int = 0,
    progress: Progress | None = None,
) -> RobotProgram:
    """Make the program that takes the images of a plan.

    The program uses the fewest fixturings that reach all settings that can be reached. It chooses
    joints and order so that the moves take little time. Every move is proven free of collisions.

    Parameters
    ----------
    plan : InspectionPlan
        The plan, made with this cell or without one.
    solid : Solid
        Its part.
    cell : Cell
        The robot cell; it must have a ``home``.
    speed : float
        Share of the robot's largest joint speeds, from 0.001 to 1.
    uncertainty : ArmUncertainty, optional
        Of the joints, the hand-eye calibration and the registration. With it, the program states P
        at each stop, and prefers the better branch where that costs at most 5 % of the time.
    simulate : int
        With `uncertainty`, check P at each stop with this many displaced poses; 0 for none.
    seed : int
        Of the ways around obstacles, and of the displaced poses.
    progress : callable, optional
        ``progress(done, total, label)``.

    Returns
    -------
    RobotProgram
        Its ``unreached`` names the settings that the robot does not reach, with reasons.

    Raises
    ------
    RequestError
        If an argument breaks its rule, the part is another one, or the cell has no ``home``.
    RobotError
        If a fixturing puts the part through something.
    InfeasibleError
        If no setting is reached.

    Examples
    --------
    >>> from aspectgraph import read_solid
    >>> from planner import Cell, read_plan, robot_program
    >>> plan = read_plan("examples/two_pocket_block_plan.json")
    >>> block = read_solid("examples/two_pocket_block.off")
    >>> program = robot_program(plan, block, Cell.from_toml("examples/cell.toml"))
    >>> program.n_stops, [tour.fixturing for tour in program.tours]
    (1, ['up'])
    """
    _check_asked(plan, solid, cell, speed=speed, simulate=simulate, seed=seed)
    maker = _ProgramMaker(plan, solid, cell, speed, seed=seed)
    maker.state_uncertainty(uncertainty, simulate)
    return maker.program(progress)


def robot_program_with_other_poses(
    plan: InspectionPlan,
    solid: Solid,
    cell: Cell,
    *,
    speed: float = 1.0,
    uncertainty: ArmUncertainty | None = None,
    simulate: int = 10_000,
    seed: int = 0,
    progress: Progress | None = None,
) -> RobotProgram:
    """Make a program like `robot_program`, with other poses that inspect the same where they help.

    A setting is replaced where the robot does not reach it, its way is blocked, or its joints are
    near a limit or singular. The program's ``replaced`` names these settings, and its ``plan`` is
    the plan that it drives.

    Parameters
    ----------
    plan : InspectionPlan
        The plan; it must hold its request.
    solid : Solid
        Its part.
    cell : Cell
        The robot cell, with a ``home``.
    speed : float
        Share of the largest joint speeds, from 0.001 to 1.
    uncertainty : ArmUncertainty, optional
        Of the arm, see `robot_program`.
    simulate : int
        Displaced poses for the check of P at each stop; 0 for none.
    seed : int
        Of the program, and of the other poses.
    progress : callable, optional
        ``progress(done, total, label)``.

    Returns
    -------
    RobotProgram
        With ``replaced`` and ``plan``.

    Raises
    ------
    RequestError
        As `robot_program`, and if the plan allows no other poses, for example because of its lamps.
    RobotError, InfeasibleError
        As `robot_program`.

    Examples
    --------
    >>> from aspectgraph import read_solid
    >>> from planner import Cell, read_plan, robot_program_with_other_poses
    >>> plan = read_plan("examples/two_pocket_block_plan.json")
    >>> block = read_solid("examples/two_pocket_block.off")
    >>> cell = Cell.from_toml("examples/cell.toml")
    >>> program = robot_program_with_other_poses(plan, block, cell)
    >>> program.complete, program.replaced
    (True, {})
    """
    _check_asked(plan, solid, cell, speed=speed, simulate=simulate, seed=seed)

    def make(one: InspectionPlan) -> RobotProgram:
        return robot_program(
            one,
            solid,
            cell,
            speed=speed,
            uncertainty=uncertainty,
            simulate=simulate,
            seed=seed,
            progress=progress,
        )

    return program_with_other_poses(plan, solid, cell, make, seed)


def _check_asked(
    plan: InspectionPlan, solid: Solid, cell: Cell, *, speed: float, simulate: int, seed: int
) -> None:
    """Check what is asked of a program, before the work."""
    check_kinds(plan=(plan, "InspectionPlan"), solid=(solid, "Solid"), cell=(cell, "Cell"))
    check_number("speed", speed, ABOVE_0_TO_1)
    check_number("speed", speed, _SPEED)
    check_count("simulate", simulate, 0, 10**9)
    check_count("seed", seed, 0)
    _check_part(plan, solid)
    if cell.home is None:
        hint = "programs begin and end there; Cell.with_home sets it"
        raise RequestError.of_rule("cell.home", "must be given for a program", "none", hint=hint)
    if not plan.settings:
        raise RequestError.of_rule("plan", "must have settings", "none")


def _check_part(plan: InspectionPlan, solid: Solid) -> None:
    """Refuse a part that is not the plan's."""
    why = plan.request.other_part(solid)
    if why:
        got = f"{solid.name!r}, {why}"
        raise RequestError.of_rule("solid", "must be the part of the plan", got)


def _rounded_down(value: float) -> float:
    """Return a positive number with two digits, not larger."""
    if value <= 0.0:
        return 0.0
    step = 10.0 ** (np.floor(np.log10(value)) - 1)
    return float(f"{np.floor(value / step * (1 + 1e-12)) * step:.1e}")


@dataclass(frozen=True)
class _Reached:
    """How a setting is reached in one fixturing."""

    branches: np.ndarray
    why: str
    covariances: np.ndarray | None
    probabilities: Sequence[Mapping[str, float]]
    shortfalls: np.ndarray


class _ProgramMaker:
    """Makes the program of one plan in one cell."""

    def __init__(
        self,
        plan: InspectionPlan,
        solid: Solid,
        cell: Cell,
        speed: float,
        *,
        seed: int,
    ):
        robot = cell.robot
        self._plan = plan
        self._given = cell
        self._cell = cell.with_part(solid)
        self._home = np.array(cell.home, dtype=np.float64)
        self._speed = speed
        self._rates = JointRates(robot.speeds, robot.accelerations).scaled(speed)
        self._uncertainty: ArmUncertainty | None = None
        self._simulate = 0
        self._seed = seed
        self._names = list(cell.fixturings)
        # reached[f][k]: setting k in fixturing f
        self._reached: list[list[_Reached]] = []

    def state_uncertainty(self, uncertainty: ArmUncertainty | None, simulate: int) -> None:
        """State P at each stop with the uncertainty of the arm, and simulate it."""
        self._uncertainty = uncertainty
        self._simulate = simulate

    def program(self, progress: Progress | None) -> RobotProgram:
        """Return the program."""
        steps = len(self._names)
        for done, name in enumerate(self._names):
            report(progress, done, 2 * steps, f"joints in fixturing {name}")
            self._reached.append(self._reach(name))
        table = np.array([[bool(len(one.branches)) for one in row] for row in self._reached]).T
        choice = choose_fixturings(table, self._seconds)
        unreached = {k: self._told.why_not(k) for k, f in enumerate(choice.of_setting) if f < 0}
        tours = []
        for f, name in enumerate(self._names):
            report(progress, steps + f, 2 * steps, f"moves in fixturing {name}")
            own = [k for k, chosen in enumerate(choice.of_setting) if chosen == f]
            if own:
                tours.append(self._tour(f, own, unreached))
        report(progress, 2 * steps, 2 * steps, "robot program")
        kept = tuple(tour for tour in tours if tour.stops)
        if not kept:
            reasons = [f"setting {k + 1}: {why}" for k, why in sorted(unreached.items())]
            raise InfeasibleError(
                f"the robot must reach a setting. Got none: {'; '.join(reasons[:3])}."
            )
        return RobotProgram(
            part=self._plan.part,
            robot=self._cell.robot.name,
            joint_names=tuple(joint.name for joint in self._cell.robot.joints),
            home=self._home,
            tours=kept,
            rates=self._rates,
            speed=self._speed,
            keep_mm=_KEPT_SHARE * self._cell.clearance_mm,
            unreached=dict(sorted(unreached.items())),
            coverage=choice.coverage,
            digests=self._digests(),
            start=self._start(kept),
            controller=self._cell.robot.controller,
            warnings=self._warnings(kept),
        )

    def _reach(self, fixturing: str) -> list[_Reached]:
        """Return by which joints the settings are reached in a fixturing."""
        found = self._told.poses[fixturing]
        branches = [self._near_home(one.branches) for one in found]
        if self._cell.fixturings[fixturing].table is not None:
            rates = self._rates_in(fixturing)
            branches = few_branches(branches, self._home_in(fixturing), rates)
        return [
            self._rated(k, own, one.why, fixturing)
            for k, (own, one) in enumerate(zip(branches, found, strict=True))
        ]

    @cached_property
    def _told(self) -> Reachability:
        """By which joints the settings are reached with all their targets in sight."""
        return reachability_of(self._cell, self._plan, all_branches=True)

    def _start(self, tours: Sequence[FixturedTour]) -> HomeStart:
        """Return how near home the robot must stand, in all rounds.

        All joints in a box about home are proven free: each body moves at most by the box's turns times its levers.
        """
        cell = self._cell
        spread = cell.robot.controller.spread()
        shares = []
        for tour in tours:
            home = self._home_in(tour.fixturing)
            turn = LARGEST_TOLERANCE_RAD * np.append(spread, 1.0)[: len(home)]
            share = cell.free_shares(
                home[None], turn, np.ones(1), _KEPT_SHARE, fixturing=tour.fixturing
            )
            shares.append(float(share[0]))
        tolerance = _rounded_down(LARGEST_TOLERANCE_RAD * min(shares))
        if tolerance < LEAST_TOLERANCE_RAD:
            name = tours[int(np.argmin(shares))].fixturing
            closest = cell.clearance(self._home_in(name), name, links_mm=np.inf)
            rule = f"must stay free if each axis is {LEAST_TOLERANCE_RAD:g} rad off"
            got = f"{closest.first} {closest.mm:.2g} mm from {closest.second} in fixturing {name!r}"
            raise RequestError.of_rule("cell.home", rule, got)
        slow = _REDUCED_MM_S / float(cell.levers_mm @ spread)
        return HomeStart(tolerance, _rounded_down(min(slow, float(self._rates.speeds.min()))))

    def _rates_in(self, fixturing: str) -> JointRates:
        return JointRates(*self._cell.rates(fixturing)).scaled(self._speed)

    def _home_in(self, fixturing: str) -> np.ndarray:
        """Return home, with the angle 0 of a turntable behind it."""
        turned = self._cell.fixturings[fixturing].table is not None
        return np.append(self._home, 0.0) if turned else self._home

    def _near_home(self, branches: np.ndarray) -> np.ndarray:
        """Return the same configurations, each joint at the full turn nearest to home: cables wind least."""
        robot = self._cell.robot
        whole = 2 * np.pi
        joints = branches[:, : len(self._home)]
        turned = joints + whole * np.round((self._home - joints) / whole)
        turned = np.where(turned > robot.upper, turned - whole, turned)
        turned = np.where(turned < robot.lower, turned + whole, turned)
        within = (turned >= robot.lower) & (turned <= robot.upper)
        near = np.where(within, turned, joints)
        near = np.where(robot.controller.margin(near)[:, None] >= 0, near, joints)
        return np.concatenate([near, branches[:, len(self._home) :]], axis=1)

    def _rated(self, k: int, branches: np.ndarray, why: str, fixturing: str) -> _Reached:
        if self._uncertainty is None or not len(branches):
            return _Reached(branches, why, None, (), np.zeros(len(branches)))
        cell = self._cell
        own = branches[:, : len(self._home)]
        if isinstance(cell, HeldPartCell):
            camera = self._plan.settings[k].cam2world
            part2flange = cell.grips[fixturing].part2flange
            covariances = self._uncertainty.covariances_held(cell.robot, own, part2flange, camera)
        else:
            parts = np.array([cell.part_at(q, fixturing) for q in branches])
            covariances = self._uncertainty.covariances(cell.robot, own, cell.cam2flange, parts)
        stated = stated_probabilities(self._plan, self._plan.settings[k], covariances)
        return _Reached(branches, why, covariances, stated, shortfalls(stated))

    def _seconds(self, f: int, settings: tuple[int, ...]) -> float:
        """Return about the time of a round of straight moves."""
        name = self._names[f]
        branches = [self._reached[f][k].branches for k in settings]
        costs = straight_costs(self._home_in(name), branches, self._rates_in(name))
        return shortest_tour(costs).seconds if len(settings) <= EXACT_UP_TO else quick_length(costs)

    def _tour(self, f: int, settings: list[int], unreached: dict[int, str]) -> FixturedTour:
        """Return the round through settings in a fixturing; adds to ``unreached`` what has no free way."""
        name = self._names[f]
        reached = [self._reached[f][k] for k in settings]
        branches = [one.branches for one in reached]
        home = self._home_in(name)
        detours = Detours(FixturedArm(self._cell, name), self._rates_in(name))
        penalties = self._penalties(reached, self._seconds(f, tuple(settings)))
        tour = TourChecker(detours, home, branches, penalties, self._seed).run()
        for i in tour.dropped:
            unreached[settings[i]] = f"{name}: no way without collision was found"
        stops = tuple(
            self._stop(f, settings[i], branch, move)
            for i, branch, move in zip(tour.order, tour.branches, tour.moves[:-1], strict=True)
        )
        back = tour.moves[-1] if stops else Move(np.array([home, home]), 0.0)
        return FixturedTour(name, stops, back, self._table_rates(name))

    def _table_rates(self, fixturing: str) -> JointRates | None:
        rates = self._rates_in(fixturing)
        n = len(self._home)
        turned = len(rates.speeds) > n
        return JointRates(rates.speeds[n:], rates.accelerations[n:]) if turned else None

    def _penalties(self, reached: Sequence[_Reached], seconds: float) -> np.ndarray:
        """Return seconds (n, b) for branches with a smaller P; all of a round add up to 5 % of its time."""
        most = max(len(one.branches) for one in reached)
        found = np.zeros((len(reached), most))
        for k, one in enumerate(reached):
            found[k, : len(one.branches)] = one.shortfalls
        return found * (_LONGER * seconds / len(reached))

    def _stop(self, f: int, k: int, branch: int, move: Move) -> Stop:
        name = self._names[f]
        reached = self._reached[f][k]
        joints = reached.branches[branch]
        closest = self._cell.clearance(joints, name)
        robot = self._cell.robot
        own = joints[: len(self._home)]
        state = ArmState(
            closest.mm,
            (closest.first, closest.second),
            float(robot.to_limit_rad(own[None])[0]),
            float(robot.singular_value(own[None])[0]),
        )
        flange = robot.forward(own)
        if reached.covariances is None:
            return Stop(k, move, state, flange)
        covariance = reached.covariances[branch]
        stated = reached.probabilities[branch]
        rates = {}
        if self._simulate:
            setting = self._plan.settings[k]
            rates = simulated_rates(
                self._plan, setting, stated, covariance, self._simulate, [self._seed, k]
            )
        return Stop(k, move, state, flange, covariance, stated, rates)

    def _digests(self) -> dict[str, str]:
        digests = {"plan": plan_digest(self._plan)}
        part = self._plan.request.part
        if part is not None:
            digests["part"] = part.digest
        digests["cell"] = self._given.to_dict()["digest"]
        return digests

    def _warnings(self, tours: Sequence[FixturedTour]) -> tuple[str, ...]:
        unchecked = self._given.robot.unchecked
        found = program_warnings(tours, self._plan.probability)
        found = (*((f"{unchecked}.",) if unchecked else ()), *found)
        changed = self._given.difference(self._plan.cell)
        if changed:
            return (f"the cell of the plan differs from the cell given, in {changed}.", *found)
        return found
