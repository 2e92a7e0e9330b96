"""Which settings of a plan a robot reaches, in which fixturing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from planner.robot.pose_reach import PoseReach, most_often


class _Cell(Protocol):
    @property
    def fixturings(self) -> Mapping[str, Any]: ...

    def reach(
        self, cam2world: np.ndarray, fixturing: str, *, all_branches: bool = False
    ) -> list[PoseReach]: ...

    def hidden_by(
        self, cam2world: np.ndarray, segments: np.ndarray, fixturing: str
    ) -> np.ndarray: ...


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


@dataclass(frozen=True, eq=False)
class Reachability:
    """What a cell reaches of a plan.

    Attributes
    ----------
    settings : tuple of str
        Names of the settings, as the plan's files name them.
    poses : mapping of str to tuple of PoseReach
        By fixturing, one for each setting.
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
        """Return the reason that most settings give in a fixturing; empty if all are reached."""
        return most_often([pose.why for pose in self.poses[fixturing] if pose.why])

    def rows(self) -> list[tuple[str, ...]]:
        """Return the table: the setting, then for each fixturing its joints in degrees or why there are none."""
        return [
            (name, *(_words(poses[number]) for poses in self.poses.values()))
            for number, name in enumerate(self.settings)
        ]

    def to_dict(self) -> dict[str, Any]:
        """Return the same as plain values; joints in rad."""
        return {
            name: {
                fixturing: {"joints_rad": pose.branches[0].tolist()}
                if pose.reached
                else {"why": pose.why}
                for fixturing, pose in ((key, poses[number]) for key, poses in self.poses.items())
            }
            for number, name in enumerate(self.settings)
        }


def reachability_of(cell: _Cell, plan: _Plan, *, all_branches: bool = False) -> Reachability:
    """Return what a cell with the part in it reaches of a plan, by the first joints or by all."""
    names = tuple(f"setting_{number:02d}" for number in range(1, len(plan.settings) + 1))
    cam2world = np.array([setting.cam2world for setting in plan.settings]).reshape(-1, 4, 4)
    poses = {}
    for name in cell.fixturings:
        told = cell.reach(cam2world, name, all_branches=all_branches)
        poses[name] = tuple(
            _if_in_sight(cell, plan, setting, one, name)
            for setting, one in zip(plan.settings, told, strict=True)
        )
    return Reachability(names, poses)


def _if_in_sight(
    cell: _Cell, plan: _Plan, setting: _Setting, told: PoseReach, fixturing: str
) -> PoseReach:
    """Return what is known of a setting, given that all its entities must be seen past obstacles."""
    if not told.reached:
        return told
    segments = np.array([plan.entities[name] for name in setting.entities])
    bodies = cell.hidden_by(setting.cam2world[None], segments, fixturing)[0]
    for name, body in zip(setting.entities, bodies, strict=True):
        if body:
            return PoseReach(np.empty((0, 6)), f"{body} hides {name}")
    return told


def _words(pose: PoseReach) -> str:
    if not pose.reached:
        return pose.why
    degrees = np.round(np.degrees(pose.branches[0]), 1) + 0.0
    return " ".join(f"{angle:.1f}" for angle in degrees)
