"""In plans for a robot cell: in which fixturing each setting is taken, by which joints, and in which order."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np

from planner.request.reach import PoseRegion
from planner.request.request import Request
from planner.setting.sensor_setting import SensorSetting
from planner.travel import order_by

# all choices of so many fixturings are tried; there are seldom more than three
_MOST_TRIED = 12


def in_order_of_arm(
    request: Request, settings: Sequence[SensorSetting], *, unfinished: bool
) -> list[SensorSetting]:
    """Return settings with fixturing and joints: the fewest fixturings that do, one after the other.

    Parameters
    ----------
    request : Request
        Has a cell.
    settings : sequence of SensorSetting
        All of them are reached.
    unfinished : bool
        A better plan follows, so the order is not worth seconds.
    """
    cell = request.requirements.cell
    assert cell is not None
    placed = [
        cell.placed(
            one.cam2world, request.at_pose(one.cam2world, one.entities).constraints.segments
        )
        for one in settings
    ]
    chosen = fewest_fixturings([set(ways) for ways in placed], list(cell.to_dict()["fixturings"]))
    result: list[SensorSetting] = []
    for name in chosen:
        group = [
            _standing(setting, name, ways[name])
            for setting, ways in zip(settings, placed, strict=True)
            if next((one for one in chosen if one in ways), "") == name
        ]
        result += _ordered(cell, group, name, unfinished)
    # what a cell forbids after all is told by the plan's reachability
    result += [one for one, ways in zip(settings, placed, strict=True) if not ways]
    return result


def fewest_fixturings(ways: Sequence[set[str]], every: Sequence[str]) -> tuple[str, ...]:
    """Return the fewest of all names such that each set that is not empty holds one; the first of equal choices.

    Beyond a dozen names, they are chosen greedily.
    """
    left = [names for names in ways if names]
    if len(every) <= _MOST_TRIED:
        for count in range(len(every) + 1):
            for chosen in combinations(every, count):
                if all(names.intersection(chosen) for names in left):
                    return chosen
    picked: list[str] = []
    while left:
        best = max(every, key=lambda name: sum(name in names for names in left))
        picked.append(best)
        left = [names for names in left if best not in names]
    return tuple(picked)


def _standing(setting: SensorSetting, fixturing: str, arm: Any) -> SensorSetting:
    return replace(
        setting,
        fixturing=fixturing,
        joints=arm.joints,
        angle_deg=arm.angle_deg,
        arm={
            "clearance_robot_mm": arm.clearance_mm,
            "closest": arm.closest,
            "to_limit_rad": arm.to_limit_rad,
            "singular_value": arm.singular_value,
        },
    )


def _ordered(
    cell: PoseRegion, group: Sequence[SensorSetting], fixturing: str, unfinished: bool
) -> Iterable[SensorSetting]:
    """Return the settings of one fixturing in the order that takes the least time."""
    if not group:
        return ()
    seconds = cell.travel_seconds(np.array([one.axes for one in group]), fixturing)
    order = order_by(seconds, starts=1) if unfinished else order_by(seconds)
    return [group[i] for i in order]
