"""A program with other poses where they serve the robot better, and the plan that it then drives."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ground.short_repr import short_repr
from planner.argument_kinds import check_count, check_kinds, suggests_names
from planner.exceptions import RequestError
from planner.measuring.planned_edges import registered_problem
from planner.options import InspectionOptions
from planner.progress import Progress, report
from planner.request.problem import Problem
from planner.request.reach import StatedRegion
from planner.resolve_request import problem_on, resolve_request
from planner.robotcell.cell import CellRegion, reachability_of
from planner.robotcell.reachability import angle_deg
from planner.robotprogram.program import (
    NEAR_LIMIT_RAD,
    NEAR_SINGULAR,
    RobotProgram,
    Stop,
)
from planner.search.columns import Judge, perturbed
from planner.search.plan_setting import setting_at
from planner.search.realise_column import joint_bounds, missing, promised_too_much
from planner.verify.setting_record import search_windows_px

if TYPE_CHECKING:
    from aspectgraph import Solid
    from planner.plan import InspectionPlan
    from planner.robotcell import Cell
    from planner.sensor_setting import SensorSetting


# Poses that inspect the same as a setting of a plan, by the rules of the request that the plan
# holds.
#
# A setting is rolled about its line of sight, and moved a little in all directions. Of these
# poses those are kept that the judge of the request accepts. Where the camera may be is computed
# anew, only around the setting.


_ROLLS = 72
_NEAR = 2000
# half the box around a setting in which the camera may be, mm
_AROUND_MM = 400.0
# beyond the part, which that box must contain, mm
_ROOM_MM = 50.0
# a turn of a radian is as far as so many millimetres
_MM_PER_RAD = 200.0
_MESSAGE = "another pose that inspects the same"


def why_no_other_poses(plan: InspectionPlan) -> str:
    """Return why no other poses can be found for a plan, in words; empty if they can."""
    request = plan.request
    if plan.light is not None or request.ring is not None:
        return "its lamps were chosen for its poses"
    if isinstance(request.requirements.reach, StatedRegion):
        return "the plan's request cannot be made again"
    if request.poses is not None:
        return "its poses were chosen from poses that exist"
    return ""


@dataclass(frozen=True)
class _Local:
    """What is asked of a setting, with where its targets are observable around it."""

    judge: Judge

    @property
    def problem(self) -> Problem:
        return self.judge.problem


class EquivalentPoses:
    """Other poses for the settings of one plan.

    Parameters
    ----------
    plan : InspectionPlan
        One for which `why_no_other_poses` is empty.
    solid : Solid
        Its part.
    seed : int
        Of the poses.
    """

    def __init__(self, plan: InspectionPlan, solid: Solid, seed: int = 0) -> None:
        self._plan = plan
        self._solid = solid
        self._seed = seed
        # the robot is asked apart
        need = replace(plan.request.requirements, cell=None)
        self._stated = replace(plan.request, requirements=need)
        self._locals: dict[int, _Local] = {}
        self._poses: dict[int, np.ndarray] = {}
        self._registered: Problem | None = None

    def problem(self, k: int) -> Problem:
        """Return what is asked of setting k, from 0."""
        return self._local(k).problem

    def poses(self, k: int) -> np.ndarray:
        """Return poses (n, 4, 4) that inspect what setting k does, the nearest first; the setting's own is left out."""
        if k not in self._poses:
            self._poses[k] = self._searched(k)
        return self._poses[k]

    def setting(self, k: int, cam2world: np.ndarray) -> SensorSetting | None:
        """Return another pose as a setting in the place of setting k; None if it promises less than is asked.

        Its probabilities and margins are stated again, and P_all where the plan states it.
        """
        before = self._plan.settings[k]
        names = before.entities
        judge = self._local(k).judge
        seed = before.seed or 0
        setting = setting_at(judge.problem, cam2world, names, _MESSAGE, before.seed)
        if min(setting.probability.values()) < self._plan.probability:
            return None
        if promised_too_much(judge, setting, seed):
            return None
        if before.p_all:
            bounds = joint_bounds(judge, cam2world, names, seed)
            if missing(judge, bounds):
                return None
            setting = _with_bounds(setting, bounds)
        return self._with_lines(k, setting)

    def distance(self, k: int, cam2world: np.ndarray) -> tuple[float, float]:
        """Return how far a pose (4, 4) is from setting k, mm, and by how much it is turned, rad."""
        shift, turn = _apart(self._plan.settings[k].cam2world, cam2world[None])
        return float(shift[0]), float(turn[0])

    def _searched(self, k: int) -> np.ndarray:
        planned = self._plan.settings[k].cam2world
        rng = np.random.default_rng([self._seed, k])
        far = self._plan.camera.focus_distance_mm
        first = np.concatenate(
            [_rolled(planned), perturbed(np.repeat(planned[None], _NEAR, 0), far, rng)]
        )
        poses = self._inspecting(k, first)
        if len(poses):
            again = poses[rng.integers(len(poses), size=_NEAR)]
            poses = np.concatenate([poses, self._inspecting(k, perturbed(again, far, rng))])
        shift, turn = _apart(planned, poses)
        # noise in the last digits must not decide the order
        return poses[np.argsort(np.round(shift + _MM_PER_RAD * turn, 6), kind="stable")]

    def _inspecting(self, k: int, poses: np.ndarray) -> np.ndarray:
        """Return those of poses (n, 4, 4) that inspect all that setting k does."""
        judge = self._local(k).judge
        low, high = np.asarray(self._plan.workspace, dtype=float)
        places = poses[:, :3, 3]
        poses = poses[((places >= low) & (places <= high)).all(axis=1)]
        inspects = judge(poses).inspects
        poses = poses[inspects.all(axis=1)]
        steady = judge.steady(poses, np.ones((len(poses), len(judge.names)), dtype=bool))
        return np.asarray(poses[steady.all(axis=1)])

    def _local(self, k: int) -> _Local:
        if k not in self._locals:
            self._locals[k] = _Local(Judge(self._problem(k), self._stated.effort))
        return self._locals[k]

    def _problem(self, k: int) -> Problem:
        from aspectgraph import compute_regions

        stated = self._stated
        setting = self._plan.settings[k]
        items = {name: self._plan.targets[name].item_of(self._solid) for name in setting.entities}
        options = InspectionOptions.of_request(stated)
        resolved = resolve_request(
            self._solid, items, stated.camera, stated.pose_uncertainty, options
        )
        regions = compute_regions(self._solid, resolved.entities, workspace=self._box(setting))
        if self._registered is None:
            # what registration tells depends on all targets of the plan
            every = problem_on(stated, regions, stated.targets)
            self._registered = registered_problem(every, stated.registration)
        registered = self._registered.registered
        return replace(
            problem_on(resolved.request, regions, resolved.request.targets), registered=registered
        )

    def _box(self, setting: SensorSetting) -> np.ndarray:
        """Return the workspace (2, 3) around a setting."""
        low, high = np.asarray(self._plan.workspace, dtype=float)
        centre = setting.position
        # the part must be inside
        first, last = np.asarray(self._solid.bounds, dtype=float)
        near = np.minimum(centre - _AROUND_MM, first - _ROOM_MM)
        far = np.maximum(centre + _AROUND_MM, last + _ROOM_MM)
        return np.array([np.maximum(low, near), np.minimum(high, far)])

    def _with_lines(self, k: int, setting: SensorSetting) -> SensorSetting:
        """Return a setting that tells of other visible lines in the search windows of edges."""
        request = self.problem(k)
        showing = request.requirements.showing
        if showing.asks_nothing:
            return setting
        windows = search_windows_px(self._plan, setting)
        widest = max(windows.values())
        check = request.first.constraints.image_check(replace(showing, separation_px=widest))
        targets = np.ones((1, len(request.names)), dtype=bool)
        apart = check.separations(setting.cam2world[None], targets, 0.0)[0] + widest
        near = dict(zip(request.names, apart.tolist(), strict=True))
        lines = {name: near[name] for name in setting.entities if near[name] < windows[name]}
        return replace(setting, lines_in_window_px=lines)


def _with_bounds(setting: SensorSetting, bounds: Mapping[str, tuple[float, int]]) -> SensorSetting:
    stated = {name: min(lower, setting.probability[name]) for name, (lower, _) in bounds.items()}
    # what is missed by one at least is missed by no more than all of them miss
    together = max(1.0 - sum(1.0 - p for p in stated.values()), 0.0)
    drawn = min(n for _, n in bounds.values())
    return replace(setting, p_all=stated, p_all_together=together, p_all_poses=drawn)


def _rolled(cam2world: np.ndarray) -> np.ndarray:
    """Return a pose (4, 4) turned about its line of sight, without the pose itself; (n, 4, 4)."""
    angles = 2 * np.pi / _ROLLS * np.arange(1, _ROLLS)
    turns = np.tile(np.eye(4), (len(angles), 1, 1))
    cosines = np.cos(angles)
    sines = np.sin(angles)
    turns[:, 0, 0] = cosines
    turns[:, 1, 1] = cosines
    turns[:, 0, 1] = -sines
    turns[:, 1, 0] = sines
    return np.einsum("ij,njk->nik", cam2world, turns)


def _apart(own: np.ndarray, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return distances (n,), mm, and angles (n,), rad, of poses (n, 4, 4) from one (4, 4)."""
    shift = np.sqrt(((poses[:, :3, 3] - own[:3, 3]) ** 2).sum(axis=1))
    trace = np.einsum("ij,nij->n", own[:3, :3], poses[:, :3, :3])
    return shift, np.arccos(np.clip((trace - 1.0) / 2.0, -1.0, 1.0))


# A plan whose unreached settings are replaced by other poses that inspect the same, and that the
# robot reaches.


_AT_ONCE = 64
_MOST = 768
# poses whose promise is looked at closely before a setting is given up
_TRIES = 12


@dataclass(frozen=True, eq=False)
class OtherSetting:
    """A setting instead of one that the robot does not reach.

    Attributes
    ----------
    setting : SensorSetting
        Inspects the same; P and margins are stated anew.
    fixturing : str
        In which the robot reaches it.
    moved_mm, turned_rad : float
        How far its pose is from the planned one.
    why : str
        Why the planned pose was left.
    """

    setting: SensorSetting
    fixturing: str
    moved_mm: float
    turned_rad: float
    why: str

    def __str__(self) -> str:
        turned = np.degrees(self.turned_rad)
        return (
            f"{self.moved_mm:.0f} mm and {turned:.0f}° from the planned pose, in "
            f"{self.fixturing!r} ({self.why})"
        )


@dataclass(frozen=True, eq=False)
class ReachedPlan:
    """A plan with other settings instead of those that were not reached.

    Attributes
    ----------
    plan : InspectionPlan
        With the other settings. It is the given plan if nothing was replaced.
    replaced : mapping of int to OtherSetting
        By the index of the setting, from 0.
    unreached : mapping of int to str
        Settings that no other pose was found for, and why their own is not reached.
    note : str
        Why no other poses were looked for; empty if they were.
    """

    plan: InspectionPlan
    replaced: Mapping[int, OtherSetting]
    unreached: Mapping[int, str]
    note: str = ""

    __repr__ = short_repr


class OtherPoses:
    """Looks for other poses that a robot reaches.

    Parameters
    ----------
    plan, solid
        The plan and its part.
    inside : Cell
        The cell with the part.
    seed : int
        Of the poses.
    """

    def __init__(self, plan: InspectionPlan, solid: Solid, inside: Cell, seed: int = 0) -> None:
        self._plan = plan
        self._equivalents = EquivalentPoses(plan, solid, seed)
        self._region = CellRegion(inside)

    def reached(
        self,
        k: int,
        fixturings: Sequence[str],
        why: str,
        accepts: Callable[[np.ndarray, str], bool] | None = None,
    ) -> OtherSetting | None:
        """Return the nearest other pose for setting k that is reached in some fixturings; None if none was found.

        ``accepts(branch, fixturing)`` says whether joints (k,) or (k + 1,) are good enough. Default: all are.
        """
        poses = self._equivalents.poses(k)
        # near ones and far ones: what is not reached from one side is from another
        poses = poses[np.unique(np.linspace(0, len(poses) - 1, min(_MOST, len(poses))).astype(int))]
        tries = 0
        for start in range(0, len(poses), _AT_ONCE):
            group = poses[start : start + _AT_ONCE]
            for row, name in self._reached_rows(k, group, fixturings, accepts):
                setting = self._equivalents.setting(k, group[row])
                if setting is not None:
                    return OtherSetting(
                        setting, name, *self._equivalents.distance(k, group[row]), why
                    )
                tries += 1
                if tries == _TRIES:
                    return None
        return None

    def _reached_rows(
        self,
        k: int,
        poses: np.ndarray,
        fixturings: Sequence[str],
        accepts: Callable[[np.ndarray, str], bool] | None,
    ) -> list[tuple[int, str]]:
        """Return which of poses (n, 4, 4) are reached with all in sight, and in which fixturing; the nearest first."""
        names = self._plan.settings[k].entities
        segments = self._equivalents.problem(k).at_pose(poses[0], names).constraints.segments
        rows: dict[int, str] = {}
        for name in fixturings:
            open_rows = np.array([row for row in range(len(poses)) if row not in rows], dtype=int)
            reaches = self._region.poses_in_sight(
                poses[open_rows], segments, name, all_branches=accepts is not None
            )
            for row, reach in zip(open_rows.tolist(), reaches, strict=True):
                if reach.reached and (
                    accepts is None or any(accepts(q, name) for q in reach.branches)
                ):
                    rows[row] = name
        return sorted(rows.items())


@suggests_names
def with_reached_settings(
    plan: InspectionPlan,
    solid: Solid,
    cell: Cell,
    *,
    seed: int = 0,
    progress: Progress | None = None,
) -> ReachedPlan:
    """Replace settings that a robot does not reach by other poses that inspect the same.

    A setting is rolled about its line of sight and moved a little. A pose replaces it if it
    inspects the same entities by all rules of the plan's request, and the robot reaches it. P and
    margins are stated anew, and the simulation of the plan is repeated if it has one.

    Parameters
    ----------
    plan : InspectionPlan
        The plan. It stays as it is.
    solid : Solid
        Its part.
    cell : Cell
        The robot cell.
    seed : int
        Of the poses that are tried.
    progress : callable, optional
        ``progress(done, total, label)``.

    Returns
    -------
    ReachedPlan
        The plan with the other settings, and which ones were replaced.

    Raises
    ------
    RequestError
        If an argument breaks its rule.

    Examples
    --------
    >>> from aspectgraph import read_solid
    >>> from planner import Cell, read_plan, with_reached_settings
    >>> plan = read_plan("examples/two_pocket_block_plan.json")
    >>> block = read_solid("examples/two_pocket_block.off")
    >>> found = with_reached_settings(plan, block, Cell.from_toml("examples/cell.toml"))
    >>> found.plan is plan, found.replaced, found.unreached
    (True, {}, {})
    """
    check_kinds(plan=(plan, "InspectionPlan"), solid=(solid, "Solid"), cell=(cell, "Cell"))
    check_count("seed", seed, 0)
    inside = cell.with_part(solid)
    reachability = reachability_of(inside, plan)
    missed = np.flatnonzero(~reachability.reached.any(axis=1)).tolist()
    unreached = {k: reachability.why_not(k) for k in missed}
    note = why_no_other_poses(plan) if missed else ""
    if note or not missed:
        return ReachedPlan(plan, {}, unreached, note)
    others = OtherPoses(plan, solid, inside, seed)
    # where most settings are reached, the part must not be put another way
    counts = reachability.reached.sum(axis=0)
    names = [list(reachability.poses)[f] for f in np.argsort(-counts, kind="stable")]
    replaced = {}
    for done, k in enumerate(missed):
        report(progress, done, len(missed), "other poses")
        other = others.reached(k, names, reachability.why_not(k))
        if other is not None:
            replaced[k] = other
            del unreached[k]
    report(progress, len(missed), len(missed), "other poses")
    return ReachedPlan(with_settings(plan, replaced, solid), replaced, unreached)


def with_settings(
    plan: InspectionPlan, replaced: Mapping[int, OtherSetting], solid: Solid
) -> InspectionPlan:
    """Return a plan with other settings, simulated again if it was; the plan itself if there are none."""
    if not replaced:
        return plan
    settings = [
        replaced[k].setting if k in replaced else setting for k, setting in enumerate(plan.settings)
    ]
    changed: dict[str, Any] = {"settings": tuple(settings), "simulation": None}
    result = replace(plan, **changed)
    before = plan.simulation
    if before is None:
        return result
    shown_of = None if before.shown is None else solid
    return result.simulated(before.n, 0 if before.seed is None else before.seed, solid=shown_of)


def program_with_other_poses(
    plan: InspectionPlan,
    solid: Solid,
    cell: Cell,
    make: Callable[[InspectionPlan], RobotProgram],
    seed: int,
) -> RobotProgram:
    """Return the program that ``make`` makes of a plan with other poses.

    Settings that are not reached are replaced first. Then those are tried again whose way is blocked, or whose joints
    are near a limit or nearly singular; the better program is kept.
    """
    note = why_no_other_poses(plan)
    if note:
        raise RequestError.of_rule("plan", "must allow other poses", "one without", hint=note)
    first = with_reached_settings(plan, solid, cell, seed=seed)
    made = make(first.plan)
    replaced = dict(first.replaced)
    again = _better(plan, solid, cell, made, seed)
    if again:
        changed = with_settings(plan, {**replaced, **again}, solid)
        other = make(changed)
        if _worth(other) < _worth(made):
            made = other
            replaced.update(again)
    driven = as_driven(with_settings(plan, replaced, solid), made, cell)
    words = {k: str(other_setting) for k, other_setting in sorted(replaced.items())}
    digests = {**made.digests, "plan": driven.digest}
    return replace(made, replaced=words, plan=driven, digests=digests)


def _better(
    plan: InspectionPlan, solid: Solid, cell: Cell, made: RobotProgram, seed: int
) -> Mapping[int, OtherSetting]:
    """Return other settings for those that are in trouble in a program."""
    troubles = _troubles(made)
    if not troubles:
        return {}
    robot = cell.robot

    def is_good(q: np.ndarray, fixturing: str) -> bool:
        joints = q[None, : robot.n_joints]
        far = robot.to_limit_rad(joints)[0] >= NEAR_LIMIT_RAD
        return bool(far and robot.singular_value(joints)[0] >= NEAR_SINGULAR)

    others = OtherPoses(plan, solid, cell.with_part(solid), seed)
    used = [tour.fixturing for tour in made.tours]
    names = [*used, *(name for name in cell.fixturings if name not in used)]
    settings = {k: others.reached(k, names, why, is_good) for k, why in troubles.items()}
    return {k: setting for k, setting in settings.items() if setting is not None}


def _troubles(made: RobotProgram) -> dict[int, str]:
    """Return the settings that a program does not drive, or drives near a limit or a singularity, and why."""
    troubles = dict(made.unreached)
    for tour in made.tours:
        for stop in tour.stops:
            if stop.arm.to_limit_rad < NEAR_LIMIT_RAD:
                troubles[stop.setting_idx] = "a joint was near its limit"
            elif stop.arm.singular_value < NEAR_SINGULAR:
                troubles[stop.setting_idx] = "the arm was nearly singular"
    return troubles


def _worth(made: RobotProgram) -> tuple[int, int, float]:
    """Return what programs are compared by: the smaller is the better."""
    return len(made.unreached), len(_troubles(made)), round(made.seconds, 6)


def as_driven(plan: InspectionPlan, made: RobotProgram, cell: Cell) -> InspectionPlan:
    """Return a plan whose settings state how a program drives to them; one that is not driven states nothing."""
    stops = {stop.setting_idx: (tour, stop) for tour in made.tours for stop in tour.stops}
    settings = []
    n_joints = cell.robot.n_joints
    for k, setting in enumerate(plan.settings):
        if k not in stops:
            blank = replace(setting, fixturing="", joints=(), angle_deg=None, arm={})
            settings.append(blank)
            continue
        tour, stop = stops[k]
        settings.append(
            replace(
                setting,
                fixturing=tour.fixturing,
                joints=tuple(stop.joints[:n_joints].tolist()),
                angle_deg=angle_deg(float(stop.joints[-1]))
                if stop.joints[n_joints:].size
                else None,
                arm=_arm(stop),
            )
        )
    return replace(plan, settings=tuple(settings), cell=cell.to_dict())


def _arm(stop: Stop) -> dict[str, float | str]:
    arm = stop.arm
    return {
        "clearance_robot_mm": arm.clearance_mm,
        "closest": " and ".join(arm.closest),
        "to_limit_rad": arm.to_limit_rad,
        "singular_value": arm.singular_value,
    }
