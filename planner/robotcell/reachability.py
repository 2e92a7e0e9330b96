"""Which camera poses a robot reaches and by which joints, and whether joints are free.

A pose is asked in this order, which changes no answer: the ball that the arm reaches; the hand
against what stands still, the same for all branches; the branches; the rest of the arm, branch
by branch.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ground.notebook import NotebookTable, NotebookView, ShownInNotebook, Toned
from ground.short_repr import LONGEST, count
from planner.robotcell.arm import Robot
from planner.robotcell.branches import SIX
from planner.robotcell.collisions import Advance, Surroundings
from planner.robotcell.urdf import carry, compose, invert

_AT_ONCE = 2048
TOO_FAR = "beyond the arm's reach"
NO_BRANCH = "no joints lead to this pose"
LIMITS = "joint limit"
CONSTANT_MM = 1.0
"""Two bodies whose distance changes by no more than this are equally near at all joints, mm."""

_FIRST_ANGLES = 24
_NEAR_LIMIT_RAD = 0.05


@dataclass(frozen=True, eq=False)
class PoseReach:
    """What is known of one camera pose.

    Attributes
    ----------
    branches : array (m, k), or (m, k + 1) on a turntable
        Joints that reach it without collision, the nearest to home first, rad. On a turntable its
        angle is the last number.
    why : str
        Why there are none; empty if there are.
    on_turntable : bool
        Whether the last number is the angle of a turntable.
    """

    branches: np.ndarray
    why: str = ""
    on_turntable: bool = False

    @property
    def reached(self) -> bool:
        """Whether the robot reaches the pose."""
        return not self.why

    @property
    def joints(self) -> np.ndarray:
        """The joints (m, k) of the robot alone."""
        return self.branches[:, :-1] if self.on_turntable else self.branches

    @property
    def angle_deg(self) -> float | None:
        """The angle of the turntable at the first joints, degrees; None without one."""
        return angle_deg(float(self.branches[0, -1])) if self.on_turntable else None

    def with_angle(self, angle: float) -> PoseReach:
        """Return the same with the angle of a turntable behind the joints."""
        angles = np.full((len(self.branches), 1), angle)
        return PoseReach(np.concatenate([self.joints, angles], axis=1), self.why, True)


class ArmAt(NamedTuple):
    """How the robot stands at a pose.

    Attributes
    ----------
    joints : tuple of float
        Of the robot, rad.
    clearance_mm : float
        Distance of the closest two bodies.
    closest : str
        Their names.
    to_limit_rad : float
        Distance of the joints from their nearest limit.
    singular_value : float
        The smallest of the Jacobian, lengths divided by 500 mm.
    angle_deg : float or None
        Angle of the turntable, degrees; None without one.
    """

    joints: tuple[float, ...]
    clearance_mm: float
    closest: str
    to_limit_rad: float
    singular_value: float
    angle_deg: float | None = None


class Reacher:
    """A robot in one fixturing.

    Parameters
    ----------
    robot : Robot
        The arm.
    around : Surroundings
        What may be touched.
    rest : array (k,)
        Joints that branches are compared with: the nearest comes first.
    """

    def __init__(self, robot: Robot, around: Surroundings, rest: np.ndarray) -> None:
        self._robot = robot
        self._around = around
        self._near_joints = rest
        first = robot.chain.steps[0][:3, 3]
        self._shoulder = first
        self._radius = float(robot.chain.reach_mm()[0]) * (1 + 1e-9)
        self._tip2hand = invert(robot.chain.tip)

    @property
    def required(self) -> np.ndarray:
        """The distances that all pairs must keep (p,), mm."""
        return self._around.all.required

    def reach(self, flanges: np.ndarray, all_branches: bool = False) -> list[PoseReach]:
        """Return what is known of poses (n, 4, 4) of the tip in the base."""
        pieces = range(0, len(flanges), _AT_ONCE)
        return [
            pose
            for start in pieces
            for pose in self._reach(flanges[start : start + _AT_ONCE], all_branches)
        ]

    def _reach(self, flanges: np.ndarray, all_branches: bool) -> list[PoseReach]:
        why = [""] * len(flanges)
        apart = np.sqrt(((flanges[:, :3, 3] - self._shoulder) ** 2).sum(axis=1))
        for i in np.flatnonzero(apart > self._radius):
            why[i] = TOO_FAR
        rows = np.flatnonzero(apart <= self._radius)
        rows = self._keep_free_hands(flanges, rows, why)
        q, owner = self._robot.solutions(flanges[rows])
        self._say_why_none(flanges, rows, owner, why)
        order = self._nearest_first(q, owner)
        q = q[order]
        owner = owner[order]
        is_free, blockers = self._free_branches(q, owner, all_branches)
        branches = [np.empty((0, self._robot.n_joints)) for _ in flanges]
        starts = np.searchsorted(owner, np.arange(len(rows) + 1))
        for pose, first, end in zip(rows, starts, starts[1:], strict=False):
            branches[pose] = q[first:end][is_free[first:end]]
            if first < end and not len(branches[pose]):
                pairs = [touching(*self._around.rest.names(k)) for k in blockers[first:end]]
                why[pose] = most_often(pairs)
        return [PoseReach(joints, reason) for joints, reason in zip(branches, why, strict=True)]

    def _free_branches(
        self, q: np.ndarray, owner: np.ndarray, all_branches: bool
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return which branches (m, k) are free, and the pair that blocks each other one.

        Without `all_branches` what comes behind the first free one of a pose is left out. One branch of every pose is
        looked at together, then the next of those without a free one.
        """
        group = self._around.rest
        is_free = np.zeros(len(q), dtype=bool)
        blockers = np.full(len(q), -1)
        starts = np.searchsorted(owner, owner)
        place = np.arange(len(q)) - starts
        done = np.zeros(len(q), dtype=bool)
        for turn in range(int(place.max(initial=-1)) + 1):
            rows = np.flatnonzero((place == turn) & ~done[starts])
            frames = self._robot.chain.frames(q[rows])
            bounds = group.bounds(frames)
            is_open = group.open_rows(bounds)
            for k, row in enumerate(rows):
                blockers[row] = group.blocker(frames[k], bounds[k]) if is_open[k] else -1
            is_free[rows] = blockers[rows] < 0
            if not all_branches:
                done[starts[rows]] |= is_free[rows]
        return is_free, blockers

    def _keep_free_hands(self, flanges: np.ndarray, rows: np.ndarray, why: list[str]) -> np.ndarray:
        """Return the numbers of poses whose hand touches nothing that stands still."""
        group = self._around.hand
        frames = np.zeros((len(rows), self._robot.n_joints + 1, 4, 4))
        frames[:, -1] = compose(flanges[rows], self._tip2hand)
        bounds = group.bounds(frames)
        is_free = np.ones(len(rows), dtype=bool)
        for row in np.flatnonzero(group.open_rows(bounds)):
            blocker = group.blocker(frames[row], bounds[row])
            if blocker >= 0:
                is_free[row] = False
                why[rows[row]] = touching(*group.names(blocker))
        return rows[is_free]

    def _say_why_none(
        self, flanges: np.ndarray, rows: np.ndarray, owner: np.ndarray, why: list[str]
    ) -> None:
        """Tell joint limits from poses that no joints lead to."""
        without = np.setdiff1d(np.arange(len(rows)), owner)
        if not len(without):
            return
        beyond = self._robot.solvable(flanges[rows[without]])
        for i, is_limit in zip(rows[without], beyond, strict=True):
            why[i] = LIMITS if is_limit else NO_BRANCH

    def _nearest_first(self, q: np.ndarray, owner: np.ndarray) -> np.ndarray:
        """Return an order of branches: by pose, then by the time from the rest to them.

        Of seven joints, those near a limit come last, since their curve goes on.
        """
        robot = self._robot
        seconds = (np.abs(q - self._near_joints) / robot.speeds).max(axis=1, initial=0.0)
        is_late = np.zeros(len(q), dtype=bool)
        if robot.n_joints > SIX:
            is_late = robot.to_limit_rad(q) < _NEAR_LIMIT_RAD
        return np.lexsort((np.round(seconds, 6), is_late, owner))

    def free(self, q: np.ndarray) -> np.ndarray:
        """Return which joints (n, k) keep the clearance and their limits (n,)."""
        within = self._robot.to_limit_rad(q) >= 0
        frames = self._robot.chain.frames(q)
        group = self._around.all
        bounds = group.bounds(frames)
        for row in np.flatnonzero(within & group.open_rows(bounds)):
            within[row] = group.blocker(frames[row], bounds[row]) < 0
        return np.asarray(within)

    def slack(self, q: np.ndarray, required: np.ndarray, enough_mm: float) -> np.ndarray:
        """Return lower bounds (n,) of distances beyond those required (p,), exact below `enough_mm`."""
        frames = self._robot.chain.frames(q)
        group = self._around.all
        bounds = group.bounds(frames)
        result = (bounds - required).min(axis=1, initial=np.inf)
        for row in np.flatnonzero(result < enough_mm):
            result[row] = group.closest(frames[row], bounds[row], required, enough_mm)[0]
        return result

    @cached_property
    def advance(self) -> Advance:
        """How far straight moves stay free."""
        return Advance(self._robot.chain, self._around.all.arm, self._around.all)

    def free_shares(
        self, q: np.ndarray, turn: np.ndarray, reach: np.ndarray, kept: float
    ) -> np.ndarray:
        """Return which share of a turn is proven free in both directions from joints.

        Parameters
        ----------
        q : array, shape (n, k)
            Joints, rad.
        turn : array, shape (k,)
            A straight move in joints, rad.
        reach : array, shape (n,)
            Largest shares of it that are of interest.
        kept : float
            Share of the clearance that must be kept.

        Returns
        -------
        array, shape (n,)
            Joints ``q + t * turn`` are free for all t of a smaller size. At most `reach`. It is not
            positive if the joints themselves are not free. Limits of joints do not count.
        """
        return self.advance.shares(self._robot.chain.frames(q), turn, reach, kept)

    def shapes(self, q: np.ndarray) -> list[tuple[str, bool, np.ndarray, np.ndarray]]:
        """Return everything at joints (k,): name, whether it moves, corners in the base, triangles."""
        frames = self._robot.chain.frames(q[None])[0]
        group = self._around.all
        moving = [
            (body.name, True, carry(frames[body.segment], body.hull.corners), body.hull.triangles)
            for body in group.arm.bodies
        ]
        standing = [
            (body.name, False, carry(body.pose, body.shape.corners), body.shape.triangles)
            for body in group.standing
        ]
        return moving + standing

    def closest(
        self, q: np.ndarray, links_mm: float, with_constant: bool = False
    ) -> tuple[float, str, str]:
        """Return the distance of the closest two bodies, and their names, for joints (k,).

        Of the arm's own pairs those count that are nearer than `links_mm`. Pairs that are equally near at all joints
        count `with_constant` only.
        """
        frames = self._robot.chain.frames(q[None])
        group = self._around.all
        bounds = group.bounds(frames)[0]
        if not with_constant:
            bounds[list(self.constant_pairs)] = np.inf
        of_arm = np.array([both for _, _, both in group.pairs], dtype=bool)
        nearest = (np.inf, -1)
        for chosen, below in ((~of_arm, np.inf), (of_arm, links_mm)):
            apart = np.where(chosen, bounds, np.inf)
            mm, pair = group.closest(frames[0], apart, np.zeros(len(of_arm)), np.inf)
            if pair >= 0 and mm < min(nearest[0], below):
                nearest = (mm, pair)
        mm, pair = nearest
        return (max(mm, 0.0), *group.names(pair)) if pair >= 0 else (np.inf, "", "")

    @cached_property
    def constant_pairs(self) -> dict[int, float]:
        """Distances of pairs that hardly change at any joints, mm, by their numbers.

        Only what the first joint alone moves, such as a turning base on its pedestal, can be one.
        """
        group = self._around.all
        bodies = group.arm.bodies
        first = [
            column
            for column, (number, _, both) in enumerate(group.pairs)
            if not both and bodies[number].segment == 1
        ]
        q = np.tile(self._near_joints, (_FIRST_ANGLES, 1))
        q[:, 0] = np.linspace(self._robot.lower[0], self._robot.upper[0], _FIRST_ANGLES)
        frames = self._robot.chain.frames(q)
        result = {}
        for column in first:
            apart = [group.distance(column, placed) for placed in frames]
            if max(apart) - min(apart) <= CONSTANT_MM:
                result[column] = min(apart)
        return result

    def constant(self) -> tuple[float, str, str]:
        """Return the distance of the closest pair that is equally near at all joints, and their names."""
        if not self.constant_pairs:
            return np.inf, "", ""
        pair = min(self.constant_pairs, key=lambda column: self.constant_pairs[column])
        return (self.constant_pairs[pair], *self._around.all.names(pair))

    def blocked_by(self, q: np.ndarray) -> str:
        """Return what is wrong with joints (k,) in words; empty if nothing is."""
        robot = self._robot
        for number, joint in enumerate(robot.joints):
            if not joint.lower <= q[number] <= joint.upper:
                return f"joint {number + 1} is beyond its limit"
        if robot.controller.margin(q) < 0:
            return "an axis of the controller is beyond its limit"
        frames = robot.chain.frames(q[None])
        group = self._around.all
        blocker = group.blocker(frames[0], group.bounds(frames)[0])
        if blocker < 0:
            return ""
        words = touching(*group.names(blocker))
        mm = group.distance(blocker, frames[0])
        if mm <= 0:
            return words
        required = float(group.required[blocker])
        return (
            words.replace(" touches ", f" is {mm:.3g} mm from ") + f"; {required:g} mm are required"
        )


def over_angles(
    reach_at: Callable[[float, np.ndarray], Sequence[PoseReach]],
    count: int,
    angles: Sequence[float],
    all_branches: bool,
) -> list[PoseReach]:
    """Return what is known of poses on a turntable.

    Parameters
    ----------
    reach_at : callable
        ``reach_at(angle, rows)`` returns what is known of some of the poses at one angle.
    count : int
        Number of poses.
    angles : sequence of float
        Angles, rad; the first ones are preferred.
    all_branches : bool
        Whether to ask for further angles where one has been found.
    """
    branches: list[list[np.ndarray]] = [[] for _ in range(count)]
    width = 0
    reasons: list[list[str]] = [[] for _ in range(count)]
    for angle in angles:
        rows = np.array([k for k in range(count) if all_branches or not branches[k]], dtype=int)
        for k, pose in zip(rows, reach_at(angle, rows), strict=True):
            width = pose.branches.shape[1] + 1
            if pose.reached:
                branches[k].append(pose.with_angle(angle).branches)
            else:
                reasons[k].append(pose.why)
    nothing = np.empty((0, width))
    return [
        PoseReach(np.concatenate([nothing, *joints]), "" if joints else most_often(why), True)
        for joints, why in zip(branches, reasons, strict=True)
    ]


def touching(first: str, second: str) -> str:
    """Return two bodies that are too near, in words; camera and light are named first."""
    if second in ("camera", "light"):
        first, second = second, first
    return f"{first} touches {second}"


def most_often(reasons: Sequence[str]) -> str:
    """Return the reason that is given most often; the first by the alphabet of equal ones."""
    counts = Counter(reasons)
    return min(counts, key=lambda text: (-counts[text], text)) if counts else ""


@dataclass(frozen=True, eq=False, repr=False)
class Reachability(ShownInNotebook):
    """What a cell reaches of a plan.

    Attributes
    ----------
    settings : tuple of str
        Names of the settings, as the plan's files name them.
    poses : mapping of str to tuple of PoseReach
        By fixturing, one for each setting.

    Examples
    --------
    >>> from aspectgraph import read_solid
    >>> from planner import Cell, read_plan
    >>> plan = read_plan("examples/two_pocket_block_plan.json")
    >>> cell = Cell.from_toml("examples/cell.toml")
    >>> told = cell.reachability(plan, read_solid("examples/two_pocket_block.off"))
    >>> told.complete, told.reached.tolist()
    (True, [[True, False]])
    """

    settings: tuple[str, ...]
    poses: dict[str, tuple[PoseReach, ...]]

    def __repr__(self) -> str:
        """Return a one-line summary: how many settings are reached in some fixturing, and in each."""
        reached = self.reached
        n_reached = int(reached.any(axis=1).sum())
        text = f"{n_reached} of {len(self.settings)} settings reached"
        counts = (f"{name}: {n}" for name, n in zip(self.poses, reached.sum(axis=0), strict=True))
        line = f"<Reachability: {text} ({', '.join(counts)})>"
        if len(line) <= LONGEST:
            return line
        return f"<Reachability: {text} ({count(len(self.poses), 'fixturing')})>"

    def _notebook_view(self) -> NotebookView:
        n_reached = int(self.reached.any(axis=1).sum())
        text = f"{n_reached} of {count(len(self.settings), 'setting')} reached."
        verdict = Toned(text, "good" if self.complete else "bad")
        line = "Joints are in degrees. Otherwise a cell says what is in the way."
        table = NotebookTable(("setting", *self.poses), self.rows())
        return NotebookView("What the robot reaches", (verdict, line), table)

    @property
    def reached(self) -> np.ndarray:
        """Which setting is reached in which fixturing, (settings, fixturings) bool."""
        columns = [[pose.reached for pose in poses] for poses in self.poses.values()]
        return np.array(columns, dtype=bool).reshape(len(columns), len(self.settings)).T

    @property
    def complete(self) -> bool:
        """Whether each setting is reached in some fixturing."""
        return bool(self.reached.any(axis=1).all())

    def most_in_the_way(self, fixturing: str) -> str:
        """Return the reason that most settings give in a fixturing.

        Parameters
        ----------
        fixturing : str
            Name of a fixturing.

        Returns
        -------
        str
            Empty if all are reached.
        """
        return most_often([pose.why for pose in self.poses[fixturing] if pose.why])

    def why_not(self, k: int) -> str:
        """Return why a setting is reached in no fixturing.

        Parameters
        ----------
        k : int
            Its index, from 0.

        Returns
        -------
        str
            One reason, or that of each fixturing; empty if it is reached.
        """
        reasons = {name: poses[k].why for name, poses in self.poses.items()}
        if not all(reasons.values()):
            return ""
        if len(set(reasons.values())) == 1:
            return next(iter(reasons.values()))
        return ", ".join(f"{name}: {why}" for name, why in reasons.items())

    def rows(self) -> list[tuple[str, ...]]:
        """Return the table: the setting, then for each fixturing its joints or why there are none.

        Returns
        -------
        list of tuple of str
            Joints are in degrees.
        """
        return [
            (name, *(_words(poses[number]) for poses in self.poses.values()))
            for number, name in enumerate(self.settings)
        ]

    def to_dict(self) -> dict[str, Any]:
        """Return the same as plain values.

        Returns
        -------
        dict
            By setting and fixturing: ``joints_rad``, and ``angle_deg`` on a turntable, or ``why``.
        """
        return {
            name: {
                fixturing: _values(pose)
                for fixturing, pose in ((key, poses[number]) for key, poses in self.poses.items())
            }
            for number, name in enumerate(self.settings)
        }


def _values(pose: PoseReach) -> dict[str, Any]:
    """Return the first joints of a pose as plain values, or why there are none."""
    if not pose.reached:
        return {"why": pose.why}
    angle = pose.angle_deg
    return {
        "joints_rad": pose.joints[0].tolist(),
        **({} if angle is None else {"angle_deg": angle}),
    }


def angle_deg(angle: float) -> float:
    """Return the angle of a turntable, rad, in degrees: a turn divided by a whole number gives no more digits."""
    return round(math.degrees(angle), 9) + 0.0


def _words(pose: PoseReach) -> str:
    if not pose.reached:
        return pose.why
    degrees = np.round(np.degrees(pose.joints[0]), 1) + 0.0
    angle = pose.angle_deg
    turned = "" if angle is None else f"table {angle:g}°: "
    return turned + " ".join(f"{angle:.1f}" for angle in degrees)
