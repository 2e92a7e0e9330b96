"""From a plan to a robot program: fixturings, rounds of proven moves, uncertainty at each stop."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ground.short_repr import short_repr
from planner.argument_kinds import (
    ABOVE_0_TO_1,
    NumberRule,
    check_count,
    check_kinds,
    check_number,
    suggests_names,
)
from planner.camera.pose import MAX_SIGMA_RAD, PoseUncertainty
from planner.exceptions import InfeasibleError, RequestError, UncertaintyError
from planner.progress import Progress, report
from planner.request.models import EdgeModels
from planner.request.registration import OWN_EDGES, means_at
from planner.request.targets import EdgeTarget, targets_of
from planner.robotcell.branches import SIX
from planner.robotcell.cell import HeldPartCell, reachability_of
from planner.robotprogram.moves import (
    KEPT_SHARE,
    Detours,
    FixturedArm,
    TourChecker,
    few_branches,
    straight_costs,
)
from planner.robotprogram.other_poses import program_with_other_poses
from planner.robotprogram.program import (
    LARGEST_TOLERANCE_RAD,
    LEAST_SPEED,
    LEAST_TOLERANCE_RAD,
    NEAR_LIMIT_RAD,
    NEAR_SINGULAR,
    ArmState,
    FixturedTour,
    HomeStart,
    JointRates,
    Move,
    RobotProgram,
    Stop,
    StopImage,
    StopRate,
    program_warnings,
)
from planner.sensor_setting import image_name
from planner.travel import EXACT_UP_TO, quick_length, shortest_tour
from planner.verify.simulate_setting import simulate_setting

if TYPE_CHECKING:
    from aspectgraph import Solid
    from planner.plan import InspectionPlan
    from planner.robotcell import Cell, Reachability, Robot
    from planner.sensor_setting import SensorSetting


# How far the camera is from its planned pose, by the joints of the arm that holds it.
#
# Σ(q) = A diag(σ²) Aᵀ + H + B Σ_part Bᵀ, about the nodal point and in the camera's own axes, as
# `planner.PoseUncertainty`. A maps small turns of the joints to a displacement of the camera,
# through the lever of the hand-eye pose; H is the uncertainty of that pose; B carries the part's
# registration from the part's origin to the camera.


@dataclass(frozen=True)
class ArmUncertainty:
    """Standard deviations of an arm, of its hand-eye calibration and of the part's registration.

    Errors of joints are usually systematic: an offset of a joint is the same in all settings.

    Parameters
    ----------
    joints_rad : float or array (k,)
        Standard deviation of each joint, rad.
    hand_eye : PoseUncertainty, optional
        Of the camera on the flange, about the nodal point, in the camera's axes. Default: none.
    part : PoseUncertainty, optional
        Of the part in the base, about the part's origin, in the part's axes. Default: none.

    Raises
    ------
    UncertaintyError
        If `joints_rad` is negative, not finite or above 1 rad.

    Examples
    --------
    >>> from planner import ArmUncertainty, PoseUncertainty
    >>> hand_eye = PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.0005)
    >>> ArmUncertainty(0.0001, hand_eye).joints_rad
    0.0001
    """

    joints_rad: ArrayLike
    hand_eye: PoseUncertainty | None = None
    part: PoseUncertainty | None = None

    __repr__ = short_repr

    def __post_init__(self) -> None:
        sigmas = np.asarray(self.joints_rad)
        is_number = sigmas.dtype.kind in "fiu" and sigmas.ndim <= 1
        if not (is_number and (sigmas >= 0).all() and (sigmas <= MAX_SIGMA_RAD).all()):
            rule = f"must be in [0, {MAX_SIGMA_RAD:g}] rad, one number or one per joint"
            raise UncertaintyError.of_rule("joints_rad", rule, repr(self.joints_rad))

    def covariances(
        self, robot: Robot, joints: np.ndarray, cam2flange: np.ndarray, part2base: np.ndarray
    ) -> np.ndarray:
        """Return Σ(q) for joints.

        Parameters
        ----------
        robot : Robot
            Its kinematics.
        joints : array (n, k)
            Joints, rad.
        cam2flange : array (4, 4)
            Camera on the flange, mm.
        part2base : array (4, 4)
            The part in the robot's base, mm.

        Returns
        -------
        array (n, 6, 6)
            Covariances of (dx, dy, dz, phi_x, phi_y, phi_z), mm and rad.
        """
        camera = robot.forward(joints) @ cam2flange
        by_part = registration_jacobian(np.linalg.inv(part2base) @ camera)
        return self._added(camera_jacobian(robot, joints, cam2flange), by_part)

    def covariances_held(
        self, robot: Robot, joints: np.ndarray, part2flange: np.ndarray, cam2part: np.ndarray
    ) -> np.ndarray:
        """Return Σ(q) for joints of an arm that holds the part before a camera that stands still.

        `hand_eye` is then the uncertainty of the camera in the base, about the nodal point and in
        the camera's axes. `part` is that of the part in the hand, about the part's origin.

        Parameters
        ----------
        robot : Robot
            Its kinematics.
        joints : array (n, k)
            Joints, rad.
        part2flange : array (4, 4)
            The part in the robot's tip, mm.
        cam2part : array (4, 4)
            The camera in the part's frame, mm: that of a setting.

        Returns
        -------
        array (n, 6, 6)
            As of `covariances`.
        """
        by_part = registration_jacobian(cam2part[None])
        # the joints move the part as they would move a camera in its place
        return self._added(by_part @ camera_jacobian(robot, joints, part2flange), by_part)

    def _added(self, by_joints: np.ndarray, by_part: np.ndarray) -> np.ndarray:
        """Return the sum of all covariances, by what joints and part do to the camera."""
        sigmas = np.broadcast_to(np.asarray(self.joints_rad, dtype=float), by_joints.shape[-1:])
        scaled = by_joints * sigmas
        total = np.einsum("nij,nkj->nik", scaled, scaled)
        if self.hand_eye is not None:
            total = total + self.hand_eye.covariance
        if self.part is not None:
            total = total + by_part @ self.part.covariance @ by_part.transpose(0, 2, 1)
        return (total + total.transpose(0, 2, 1)) / 2


def camera_jacobian(robot: Robot, joints: np.ndarray, cam2flange: np.ndarray) -> np.ndarray:
    """Return what small turns of the joints do to the camera, about its nodal point and in its axes.

    Parameters
    ----------
    robot : Robot
        Its kinematics.
    joints : array (n, k)
        Joints, rad.
    cam2flange : array (4, 4)
        Camera on the flange, mm.

    Returns
    -------
    array (n, 6, k)
        Translation in mm/rad, then rotation.
    """
    tips = robot.forward(joints)
    moves = robot.jacobian(joints)
    turns = moves[:, 3:]
    lever = tips[:, :3, :3] @ cam2flange[:3, 3]
    # a turn about an axis through the tip moves the nodal point by turn × lever
    shifts = moves[:, :3] + np.cross(turns, lever[:, :, None], axis=1)
    to_camera = (tips[:, :3, :3] @ cam2flange[:3, :3]).transpose(0, 2, 1)
    return np.concatenate([to_camera @ shifts, to_camera @ turns], axis=1)


def registration_jacobian(cam2part: np.ndarray) -> np.ndarray:
    """Return what a small motion of the part does to cameras, as seen from the part.

    Parameters
    ----------
    cam2part : array (n, 4, 4)
        Camera poses in the part's frame, mm.

    Returns
    -------
    array (n, 6, 6)
        From a motion about the part's origin to one about the nodal point, in the camera's axes.
    """
    to_camera = cam2part[:, :3, :3].transpose(0, 2, 1)
    axes = np.eye(3)[None]
    place = cam2part[:, :3, 3][:, :, None]
    jacobian = np.zeros((len(cam2part), 6, 6))
    jacobian[:, :3, :3] = -to_camera
    jacobian[:, 3:, 3:] = -to_camera
    jacobian[:, :3, 3:] = -to_camera @ np.cross(axes, place, axis=1)
    return jacobian


def stated_probabilities(
    plan: InspectionPlan, setting: SensorSetting, covariances: np.ndarray
) -> list[dict[str, float]]:
    """Return P of the targets of a setting for several covariances of the camera's pose.

    Parameters
    ----------
    plan : InspectionPlan
        Gives targets, camera and accuracy.
    setting : SensorSetting
        One of its settings.
    covariances : array (n, 6, 6)
        As `PoseUncertainty` has them.

    Returns
    -------
    list of dict of str to float
        P by target for each covariance, given that the image shows the target.
    """
    return [
        _probabilities(plan, _of_arm(plan, setting, covariance), covariance)
        for covariance in covariances
    ]


def _of_arm(plan: InspectionPlan, setting: SensorSetting, covariance: np.ndarray) -> SensorSetting:
    """Return a setting whose registration begins with the uncertainty of an arm."""
    registered = setting.registered
    registration = plan.request.registration
    if registered is None or registration is None or registration.method != OWN_EDGES:
        return setting
    return replace(
        setting, registered=registered.with_prior(plan.pose_uncertainty.covariance, covariance)
    )


def _probabilities(
    plan: InspectionPlan, setting: SensorSetting, covariance: np.ndarray
) -> dict[str, float]:
    by_arm = replace(plan.means, pose_uncertainty=PoseUncertainty(covariance))
    targets = targets_of(plan.targets, setting)
    probabilities = {}
    for name in setting.entities:
        target = targets[name]
        means = means_at(by_arm, setting, name)
        if isinstance(target, EdgeTarget):
            target_means = replace(means, accuracy=target.accuracy)
            model = EdgeModels(target.ends[None], target_means)
            seen = model.probability_where(setting.cam2world[None], np.ones((1, 1), dtype=bool))
            probabilities[name] = float(seen[0])
        else:
            probabilities[name] = float(target.describe(setting.cam2world, means).probability)
    return probabilities


def shortfalls(probabilities: Sequence[dict[str, float]]) -> np.ndarray:
    """Return how much worse each of several branches is than the best: 0 for the best, at most 1.

    Parameters
    ----------
    probabilities : sequence of dict of str to float
        P by target for each branch.

    Returns
    -------
    array (n,)
        Differences of the smallest P.
    """
    worst = np.array([min(by_target.values(), default=1.0) for by_target in probabilities])
    return worst.max(initial=0.0) - worst


def simulated_rates(
    plan: InspectionPlan,
    setting: SensorSetting,
    stated: Mapping[str, float],
    covariance: np.ndarray,
    n: int,
    seed: list[int],
) -> dict[str, StopRate]:
    """Measure the targets of a setting from displaced poses of an arm.

    Parameters
    ----------
    plan : InspectionPlan
        Gives targets, camera and accuracy.
    setting : SensorSetting
        One of its settings.
    stated : mapping of str to float
        P by target, which the result is compared with.
    covariance : array (6, 6)
        Of the camera's pose with this arm.
    n : int
        Displaced poses.
    seed : list of int
        Of these poses.

    Returns
    -------
    dict of str to StopRate
        By target. A target outside of the image counts as a failure.
    """
    rates = simulate_setting(
        replace(_of_arm(plan, setting, covariance), probability=dict(stated), p_all={}),
        plan.targets,
        plan.camera,
        PoseUncertainty(covariance),
        accuracy=plan.accuracy,
        n=n,
        rng=np.random.default_rng(seed),
    )
    return {name: StopRate.of(rate) for name, rate in rates.items()}


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
    reachable = int(reached.any(axis=1).sum())
    coverage = []
    sets: list[tuple[int, ...]] = [()]
    for size in range(1, f + 1):
        sized = list(combinations(range(f), size))
        counts = [int(reached[:, chosen].any(axis=1).sum()) for chosen in sized]
        coverage.append(max(counts))
        if coverage[-1] == reachable:
            sets = [c for c, count in zip(sized, counts, strict=True) if count == reachable]
            break
    if reachable == 0:
        return FixturingChoice((-1,) * n, tuple(coverage[:1]))
    assignments = [_assigned(reached, chosen, seconds) for chosen in sets]
    _, of_setting = min(assignments, key=lambda one: one[0])
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

    def total(of_setting: tuple[int, ...]) -> float:
        groups = [(f, tuple(k for k in range(n) if of_setting[k] == f)) for f in chosen]
        return sum(seconds(f, settings) if settings else 0.0 for f, settings in groups)

    shortest = total(best)
    while True:
        shorter = [(total(other), other) for other in _moved(best, usable)]
        if not shorter or min(shorter)[0] >= shortest - 1e-9:
            return shortest, best
        shortest, best = min(shorter)


def _moved(of_setting: tuple[int, ...], usable: list[list[int]]) -> Iterator[tuple[int, ...]]:
    """Yield the assignments that differ in one setting."""
    for k, options in enumerate(usable):
        for f in options:
            if f != of_setting[k]:
                yield (*of_setting[:k], f, *of_setting[k + 1 :])


_SPEED = NumberRule(f"must be from {LEAST_SPEED:g} to 1", lambda speed: LEAST_SPEED <= speed <= 1)
# no point of the arm or the camera is faster on the way to home: the reduced speed of ISO 10218-1
_REDUCED_MM_S = 250.0
# by how much of its time a round may be longer to have branches with a better P
_LONGER = 0.05


@suggests_names
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


@suggests_names
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


def _stop_images(plan: InspectionPlan, k: int) -> tuple[StopImage, ...]:
    """Return the images of setting k, from 0, each with its lamps; none if it takes one image."""
    lit = () if plan.light is None else plan.light.images[k]
    if len(lit) < 2:
        return ()
    return tuple(
        StopImage(image_name(k, i), tuple(lamp + 1 for lamp in image.lamps))
        for i, image in enumerate(lit)
    )


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
        self._empty_cell = cell
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
        # by fixturing: times of straight moves between settings, and of the rounds that were solved
        self._costs: dict[int, np.ndarray] = {}
        self._seconds_of: dict[tuple[int, tuple[int, ...]], float] = {}

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
        table = np.array(
            [[bool(len(setting.branches)) for setting in row] for row in self._reached]
        ).T
        choice = choose_fixturings(table, self._seconds)
        unreached = {
            k: self._reachability.why_not(k) for k, f in enumerate(choice.of_setting) if f < 0
        }
        tours = []
        for f, name in enumerate(self._names):
            report(progress, steps + f, 2 * steps, f"moves in fixturing {name}")
            settings = [k for k, chosen in enumerate(choice.of_setting) if chosen == f]
            if settings:
                tours.append(self._tour(f, settings, unreached))
        report(progress, 2 * steps, 2 * steps, "robot program")
        driven = tuple(tour for tour in tours if tour.stops)
        if not driven:
            reasons = [f"setting {k + 1}: {why}" for k, why in sorted(unreached.items())]
            raise InfeasibleError(
                f"the robot must reach a setting. Got none: {'; '.join(reasons[:3])}."
            )
        return RobotProgram(
            part=self._plan.part,
            robot=self._cell.robot.name,
            joint_names=tuple(joint.name for joint in self._cell.robot.joints),
            home=self._home,
            tours=driven,
            rates=self._rates,
            speed=self._speed,
            keep_mm=KEPT_SHARE * self._cell.clearance_mm,
            unreached=dict(sorted(unreached.items())),
            coverage=choice.coverage,
            digests=self._digests(),
            start=self._start(driven),
            home_flange=self._cell.robot.forward(self._home),
            pendant=self._cell.robot.pendant,
            coupled=self._cell.robot.controller.coupled,
            axis_limits=self._cell.robot.controller.limits,
            warnings=self._warnings(driven),
        )

    def _reach(self, fixturing: str) -> list[_Reached]:
        """Return by which joints the settings are reached in a fixturing."""
        poses = self._reachability.poses[fixturing]
        branches = [self._at_ease(self._near_home(pose.branches)) for pose in poses]
        turns = self._cell.fixturings[fixturing].table is not None
        if turns or len(self._home) > SIX:
            rates = self._rates_in(fixturing)
            branches = few_branches(branches, self._home_in(fixturing), rates, turns=turns)
        return [
            self._rated(k, group, pose.why, fixturing)
            for k, (group, pose) in enumerate(zip(branches, poses, strict=True))
        ]

    @cached_property
    def _reachability(self) -> Reachability:
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
                home[None], turn, np.ones(1), KEPT_SHARE, fixturing=tour.fixturing
            )
            shares.append(float(share[0]))
        tolerance = _rounded_down(LARGEST_TOLERANCE_RAD * min(shares))
        if tolerance < LEAST_TOLERANCE_RAD:
            name = tours[int(np.argmin(shares))].fixturing
            closest = cell.clearance(self._home_in(name), name, links_mm=np.inf, with_constant=True)
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

    def _at_ease(self, branches: np.ndarray) -> np.ndarray:
        """Return the branches of an arm of seven joints far from limits and singularities, or all if there are none."""
        robot = self._cell.robot
        if robot.n_joints == SIX:
            return branches
        joints = branches[:, : robot.n_joints]
        is_far = robot.to_limit_rad(joints) >= NEAR_LIMIT_RAD
        is_far &= robot.singular_value(joints) >= NEAR_SINGULAR
        return branches[is_far] if is_far.any() else branches

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
        joints = branches[:, : len(self._home)]
        if isinstance(cell, HeldPartCell):
            camera = self._plan.settings[k].cam2world
            part2flange = cell.fixturings[fixturing].part2flange
            covariances = self._uncertainty.covariances_held(
                cell.robot, joints, part2flange, camera
            )
        else:
            parts = np.array([cell.part_at(q, fixturing) for q in branches])
            covariances = self._uncertainty.covariances(cell.robot, joints, cell.cam2flange, parts)
        stated = stated_probabilities(self._plan, self._plan.settings[k], covariances)
        return _Reached(branches, why, covariances, stated, shortfalls(stated))

    def _seconds(self, f: int, settings: tuple[int, ...]) -> float:
        """Return about the time of a round of straight moves; none is solved twice."""
        if (f, settings) not in self._seconds_of:
            places = [0, *(k + 1 for k in settings)]
            widest = max(len(self._reached[f][k].branches) for k in settings)
            costs = self._costs_in(f)[np.ix_(places, places)][:, :, :widest, :widest]
            is_short = len(settings) <= EXACT_UP_TO
            seconds = shortest_tour(costs).seconds if is_short else quick_length(costs)
            self._seconds_of[f, settings] = seconds
        return self._seconds_of[f, settings]

    def _costs_in(self, f: int) -> np.ndarray:
        """Return the times of straight moves between all settings in a fixturing."""
        if f not in self._costs:
            name = self._names[f]
            branches = [reached.branches for reached in self._reached[f]]
            self._costs[f] = straight_costs(self._home_in(name), branches, self._rates_in(name))
        return self._costs[f]

    def _tour(self, f: int, settings: list[int], unreached: dict[int, str]) -> FixturedTour:
        """Return the round through settings in a fixturing; adds to ``unreached`` what has no free way."""
        name = self._names[f]
        reached = [self._reached[f][k] for k in settings]
        branches = [setting.branches for setting in reached]
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
        back = tour.moves[-1] if stops else Move(0.0, np.array([home, home]))
        return FixturedTour(name, stops, back, self._table_rates(name))

    def _table_rates(self, fixturing: str) -> JointRates | None:
        rates = self._rates_in(fixturing)
        n = len(self._home)
        turned = len(rates.speeds) > n
        return JointRates(rates.speeds[n:], rates.accelerations[n:]) if turned else None

    def _penalties(self, reached: Sequence[_Reached], seconds: float) -> np.ndarray:
        """Return seconds (n, b) for branches with a smaller P; all of a round add up to 5 % of its time."""
        width = max(len(setting.branches) for setting in reached)
        shares = np.zeros((len(reached), width))
        for k, setting in enumerate(reached):
            shares[k, : len(setting.branches)] = setting.shortfalls
        return shares * (_LONGER * seconds / len(reached))

    def _stop(self, f: int, k: int, branch: int, move: Move) -> Stop:
        name = self._names[f]
        reached = self._reached[f][k]
        joints = reached.branches[branch]
        closest = self._cell.clearance(joints, name)
        robot = self._cell.robot
        robot_joints = joints[: len(self._home)]
        state = ArmState(
            closest.mm,
            (closest.first, closest.second),
            float(robot.to_limit_rad(robot_joints[None])[0]),
            float(robot.singular_value(robot_joints[None])[0]),
        )
        flange = robot.forward(robot_joints)
        images = _stop_images(self._plan, k)
        if reached.covariances is None:
            return Stop(k, flange, move, state, images=images)
        covariance = reached.covariances[branch]
        stated = reached.probabilities[branch]
        rates = {}
        if self._simulate:
            setting = self._plan.settings[k]
            rates = simulated_rates(
                self._plan, setting, stated, covariance, self._simulate, [self._seed, k]
            )
        return Stop(k, flange, move, state, covariance, stated, rates, images)

    def _digests(self) -> dict[str, str]:
        digests = {"plan": self._plan.digest}
        part = self._plan.request.part
        if part is not None:
            digests["part"] = part.digest
        digests["cell"] = self._empty_cell.to_dict()["digest"]
        return digests

    def _warnings(self, tours: Sequence[FixturedTour]) -> tuple[str, ...]:
        unchecked = self._empty_cell.unchecked
        sentences = program_warnings(tours, self._plan.probability)
        sentences = (*(f"{text}." for text in unchecked), *sentences)
        changed = self._empty_cell.difference(self._plan.cell)
        if changed:
            return (f"the cell of the plan differs from the cell given, in {changed}.", *sentences)
        return sentences
