"""A plan whose unreached settings are replaced by other poses that inspect the same, and that the robot reaches."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.argument_kinds import check_count, check_kinds
from planner.motion.other_poses.equivalent_poses import EquivalentPoses, why_no_other_poses
from planner.progress import Progress, report
from planner.robot.reachability import CellRegion, reachability_of

if TYPE_CHECKING:
    from aspectgraph import Solid
    from planner.plan import InspectionPlan
    from planner.robot import Cell
    from planner.setting.sensor_setting import SensorSetting

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
        self._found = EquivalentPoses(plan, solid, seed)
        self._region = CellRegion(inside)

    def reached(
        self,
        k: int,
        fixturings: Sequence[str],
        why: str,
        accepts: Callable[[np.ndarray, str], bool] | None = None,
    ) -> OtherSetting | None:
        """Return the nearest other pose for setting k that is reached in some fixturings; None if none was found.

        ``accepts(branch, fixturing)`` says whether joints (6,) or (7,) are good enough. Default: all are.
        """
        poses = self._found.poses(k)
        # near ones and far ones: what is not reached from one side is from another
        poses = poses[np.unique(np.linspace(0, len(poses) - 1, min(_MOST, len(poses))).astype(int))]
        tries = 0
        for start in range(0, len(poses), _AT_ONCE):
            some = poses[start : start + _AT_ONCE]
            for row, name in self._reached_rows(k, some, fixturings, accepts):
                found = self._found.setting(k, some[row])
                if found is not None:
                    return OtherSetting(found, name, *self._found.distance(k, some[row]), why)
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
        segments = self._found.request(k).at_pose(poses[0], names).constraints.segments
        rows: dict[int, str] = {}
        for name in fixturings:
            left = np.array([row for row in range(len(poses)) if row not in rows], dtype=int)
            told = self._region.told(poses[left], segments, name, all_branches=accepts is not None)
            for row, one in zip(left.tolist(), told, strict=True):
                if one.reached and (accepts is None or any(accepts(q, name) for q in one.branches)):
                    rows[row] = name
        return sorted(rows.items())


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
    told = reachability_of(inside, plan)
    left = np.flatnonzero(~told.reached.any(axis=1)).tolist()
    unreached = {k: told.why_not(k) for k in left}
    note = why_no_other_poses(plan) if left else ""
    if note or not left:
        return ReachedPlan(plan, {}, unreached, note)
    others = OtherPoses(plan, solid, inside, seed)
    # where most settings are reached, the part must not be put another way
    counts = told.reached.sum(axis=0)
    names = [list(told.poses)[f] for f in np.argsort(-counts, kind="stable")]
    replaced = {}
    for done, k in enumerate(left):
        report(progress, done, len(left), "other poses")
        found = others.reached(k, names, told.why_not(k))
        if found is not None:
            replaced[k] = found
            del unreached[k]
    report(progress, len(left), len(left), "other poses")
    return ReachedPlan(with_settings(plan, replaced, solid), replaced, unreached)


def with_settings(
    plan: InspectionPlan, replaced: Mapping[int, OtherSetting], solid: Solid
) -> InspectionPlan:
    """Return a plan with other settings, simulated again if it was; the plan itself if there are none."""
    if not replaced:
        return plan
    settings = [
        replaced[k].setting if k in replaced else one for k, one in enumerate(plan.settings)
    ]
    changed: dict[str, Any] = {"settings": tuple(settings), "simulation": None}
    result = replace(plan, **changed)
    before = plan.simulation
    if before is None:
        return result
    shown_of = None if before.shown is None else solid
    return result.simulated(before.n, 0 if before.seed is None else before.seed, solid=shown_of)
