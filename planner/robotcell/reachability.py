"""Which settings of a plan a robot reaches in which fixturing, and what planning asks of a cell."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol

import numpy as np

from planner.robotcell.arm import Robot
from planner.robotcell.collisions import Closeness
from planner.robotcell.joint_checks import ArmAt, PoseReach, most_often, over_angles
from planner.robotcell.urdf import N_JOINTS


class _Cell(Protocol):
    robot: Robot

    @property
    def fixturings(self) -> Mapping[str, Any]: ...

    @property
    def state_name(self) -> str: ...

    def to_dict(self) -> dict[str, Any]: ...

    def angles(self, fixturing: str) -> tuple[float, ...]: ...

    def rates(self, fixturing: str) -> tuple[np.ndarray, np.ndarray]: ...

    def clearance(self, q: np.ndarray, fixturing: str) -> Closeness: ...

    def reach(
        self,
        cam2world: np.ndarray,
        fixturing: str,
        *,
        all_branches: bool = False,
        angle: float | None = None,
    ) -> list[PoseReach]: ...

    def hidden_by(
        self, cam2world: np.ndarray, segments: np.ndarray, fixturing: str, angle: float = 0.0
    ) -> np.ndarray: ...


# of a cell without anything that may be touched; a file holds no infinite number
_FAR_MM = 1e6


class _Setting(Protocol):
    @property
    def cam2world(self) -> np.ndarray: ...
    @property
    def entities(self) -> tuple[str, ...]: ...


class _Plan(Protocol):
    @property
    def settings(self) -> Sequence[_Setting]: ...
    @property
    def entities(self) -> Mapping[str, np.ndarray]: ...
    def ends_of(self, setting: Any, name: str) -> np.ndarray: ...


@dataclass(frozen=True, eq=False)
class Reachability:
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


def reachability_of(cell: _Cell, plan: _Plan, *, all_branches: bool = False) -> Reachability:
    """Return what a cell with the part in it reaches of a plan, by the first joints or by all."""
    names = tuple(f"setting_{number:02d}" for number in range(1, len(plan.settings) + 1))
    cam2world = np.array([setting.cam2world for setting in plan.settings]).reshape(-1, 4, 4)
    segments = [
        np.array([plan.ends_of(setting, name) for name in setting.entities])
        for setting in plan.settings
    ]

    def hidden(fixturing: str, angle: float, row: int) -> str:
        bodies = cell.hidden_by(cam2world[row][None], segments[row], fixturing, angle)[0]
        both = zip(plan.settings[row].entities, bodies, strict=True)
        return next((f"{body} hides {name}" for name, body in both if body), "")

    poses = {
        name: tuple(_in_sight(cell, cam2world, partial(hidden, name), name, all_branches))
        for name in cell.fixturings
    }
    return Reachability(names, poses)


def _in_sight(
    cell: _Cell,
    cam2world: np.ndarray,
    hidden: Callable[[float, int], str],
    fixturing: str,
    all_branches: bool = False,
) -> list[PoseReach]:
    """Return what is known of poses (n, 4, 4) in a fixturing, given that nothing may hide their targets.

    ``hidden(angle, row)`` tells in words what hides a target of a pose at an angle of the turntable; empty if nothing.
    """

    def asked(angle: float, rows: np.ndarray) -> list[PoseReach]:
        told = cell.reach(cam2world[rows], fixturing, all_branches=all_branches, angle=angle)
        words = [
            hidden(angle, int(row)) if one.reached else ""
            for row, one in zip(rows, told, strict=True)
        ]
        return [
            PoseReach(np.empty((0, N_JOINTS)), word) if word else one
            for one, word in zip(told, words, strict=True)
        ]

    if cell.fixturings[fixturing].table is None:
        return asked(0.0, np.arange(len(cam2world)))
    return over_angles(asked, len(cam2world), cell.angles(fixturing), all_branches)


def _values(pose: PoseReach) -> dict[str, Any]:
    """Return the first joints of a pose as plain values, or why there are none."""
    if not pose.reached:
        return {"why": pose.why}
    angle = angle_deg(pose.branches[0])
    return {
        "joints_rad": pose.joints[0].tolist(),
        **({} if angle is None else {"angle_deg": angle}),
    }


def angle_deg(branch: np.ndarray) -> float | None:
    """Return the angle of the turntable behind joints (6,) or (7,), degrees; None without one."""
    if len(branch) == N_JOINTS:
        return None
    # a turn divided by a whole number gives no more digits
    return round(float(np.degrees(branch[N_JOINTS])), 9) + 0.0


def _words(pose: PoseReach) -> str:
    if not pose.reached:
        return pose.why
    degrees = np.round(np.degrees(pose.joints[0]), 1) + 0.0
    angle = angle_deg(pose.branches[0])
    turned = "" if angle is None else f"table {angle:g}°: "
    return turned + " ".join(f"{angle:.1f}" for angle in degrees)


class CellRegion:
    """A `planner.request.reach.PoseRegion`.

    Parameters
    ----------
    cell : Cell
        With the part in it.
    """

    def __init__(self, cell: _Cell) -> None:
        self._cell = cell

    @property
    def state_name(self) -> str:
        """Digest of the cell."""
        return self._cell.state_name

    def to_dict(self) -> dict[str, Any]:
        """Return what a plan file says of the cell."""
        return self._cell.to_dict()

    def inspectable(
        self, cam2world: np.ndarray, segments: np.ndarray, owner: np.ndarray, wanted: np.ndarray
    ) -> np.ndarray:
        """Return which targets the camera sees from poses that the robot reaches.

        Parameters
        ----------
        cam2world : array, shape (n, 4, 4)
            Poses of the camera in the part's frame, mm.
        segments : array, shape (s, 2, 3)
            Segments that show the targets, mm.
        owner : array of int, shape (s,)
            Number of each segment's target.
        wanted : array of bool, shape (n, k)
            The targets of interest.

        Returns
        -------
        array of bool, shape (n, k)
            Which of them no obstacle hides, in the fixturing that shows most of them.
        """
        best = np.zeros_like(wanted)
        for name, angle in self._ways:
            left = np.flatnonzero(best.sum(axis=1) < wanted.sum(axis=1))
            if not left.size:
                break
            told = self._cell.reach(cam2world[left], name, angle=angle)
            left = left[[one.reached for one in told]]
            hidden = self._cell.hidden_by(cam2world[left], segments, name, angle) != ""
            seen = wanted[left]
            for target in range(wanted.shape[1]):
                seen[:, target] &= ~hidden[:, owner == target].any(axis=1)
            better = seen.sum(axis=1) > best[left].sum(axis=1)
            best[left[better]] = seen[better]
        return best

    @property
    def _ways(self) -> list[tuple[str, float]]:
        """The fixturings, each at all angles of its turntable."""
        cell = self._cell
        return [(name, angle) for name in cell.fixturings for angle in cell.angles(name)]

    def told(
        self,
        cam2world: np.ndarray,
        segments: np.ndarray,
        name: str,
        *,
        all_branches: bool = False,
    ) -> list[PoseReach]:
        """Return what is known of poses (n, 4, 4) in a fixturing, with all segments (s, 2, 3) in sight."""

        def hidden(angle: float, row: int) -> str:
            bodies = self._cell.hidden_by(cam2world[row][None], segments, name, angle)[0]
            return next((f"{body} hides it" for body in bodies if body), "")

        return _in_sight(self._cell, cam2world, hidden, name, all_branches)

    def explain(self, cam2world: np.ndarray, segments: np.ndarray) -> str:
        """Return why poses (n, 4, 4) are not reached with all segments (s, 2, 3) in sight, in words."""
        parts = []
        for name in self._cell.fixturings:
            reasons = [one.why for one in self.told(cam2world, segments, name)]
            words = most_often([reason for reason in reasons if reason])
            parts.append(f"{words} ({reasons.count(words)} of {len(reasons)} poses in {name!r})")
        return ", ".join(parts)

    def placed(self, cam2world: np.ndarray, segments: np.ndarray) -> dict[str, ArmAt]:
        """Return how the robot stands at a pose (4, 4) with all segments (s, 2, 3) in sight, by fixturing."""
        found = {}
        for name in self._cell.fixturings:
            told = self.told(cam2world[None], segments, name)[0]
            if told.reached:
                found[name] = self._standing(told, name)
        return found

    def _standing(self, told: PoseReach, name: str) -> ArmAt:
        near = self._cell.clearance(told.branches[0], name)
        q = told.joints[:1]
        return ArmAt(
            tuple(q[0].tolist()),
            min(near.mm, _FAR_MM),
            f"{near.first} and {near.second}" if near.first else "",
            float(self._cell.robot.to_limit_rad(q)[0]),
            float(self._cell.robot.singular_value(q)[0]),
            angle_deg(told.branches[0]),
        )

    def travel_seconds(self, joints: np.ndarray, fixturing: str) -> np.ndarray:
        """Return the least time (n, n) between joints (n, 6) or (n, 7) in a fixturing, at full speed, s."""
        turns = np.abs(joints[:, None] - joints[None])
        return np.asarray((turns / self._cell.rates(fixturing)[0]).max(axis=-1))

    def pose_margin(self, cam2world: np.ndarray) -> np.ndarray:
        """Return 1 for poses (n, 4, 4) that are reached in some fixturing, otherwise -1; (n,)."""
        margin = np.full(len(cam2world), -1.0)
        for name in self._cell.fixturings:
            left = np.flatnonzero(margin < 0)
            if left.size:
                told = self._cell.reach(cam2world[left], name)
                margin[left[[one.reached for one in told]]] = 1.0
        return margin
