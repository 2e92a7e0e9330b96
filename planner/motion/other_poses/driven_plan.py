"""A program with other poses where they serve the robot better, and the plan that it then drives."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from planner.exceptions import RequestError
from planner.motion.other_poses.equivalent_poses import why_no_other_poses
from planner.motion.other_poses.reached_plan import (
    OtherPoses,
    OtherSetting,
    with_reached_settings,
    with_settings,
)
from planner.motion.program_record import RobotProgram, Stop, plan_digest
from planner.motion.program_warnings import NEAR_LIMIT_RAD, NEAR_SINGULAR

if TYPE_CHECKING:
    from aspectgraph import Solid
    from planner.plan import InspectionPlan
    from planner.robot import Cell

_N_JOINTS = 6


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
    words = {k: str(one) for k, one in sorted(replaced.items())}
    digests = {**made.digests, "plan": plan_digest(driven)}
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
        own = q[None, :_N_JOINTS]
        far = robot.to_limit_rad(own)[0] >= NEAR_LIMIT_RAD
        return bool(far and robot.singular_value(own)[0] >= NEAR_SINGULAR)

    others = OtherPoses(plan, solid, cell.with_part(solid), seed)
    used = [tour.fixturing for tour in made.tours]
    names = [*used, *(name for name in cell.fixturings if name not in used)]
    found = {k: others.reached(k, names, why, is_good) for k, why in troubles.items()}
    return {k: one for k, one in found.items() if one is not None}


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
    for k, setting in enumerate(plan.settings):
        if k not in stops:
            blank = replace(setting, fixturing="", joints=(), angle_deg=None, arm={})
            settings.append(blank)
            continue
        tour, stop = stops[k]
        turned = None
        if tour.turntable is not None:
            turned = round(float(np.degrees(stop.joints[_N_JOINTS])), 9) + 0.0
        settings.append(
            replace(
                setting,
                fixturing=tour.fixturing,
                joints=tuple(stop.joints[:_N_JOINTS].tolist()),
                angle_deg=turned,
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
